//! Another unit of length: files in millimetres, centimetres or feet.
//!
//! Everything that is a length grows, everything per length shrinks, and lights without extent are made stronger or weaker as the square of
//! the factor (their illuminance falls off as the inverse square of the distance): all surfaces are lit as before, so that a picture of the
//! whole differs in nothing but its scale, which is what depth of field and focus ask for. What has no length stays: radiance of lamps and
//! of the environment, roughness, thickness of thin films (nm).

use crate::light::PunctualKind;
use crate::material::inputs::{InputMut, Inputs};
use crate::material::{BumpUnit, Interior, Material};
use crate::medium::{Coefficient, Medium};
use crate::motion::{Local, Node, Parts};
use crate::scene::{CameraProjection, Description, Shape};
use crate::texture::{Color, Graph, Mapping, Scalar};
use diopter_light::Spectrum;
use diopter_light::spectrum::Table;
use glam::{Affine3A, Vec3};
use std::collections::HashMap;
use std::sync::Arc;

/// A factor that no lengths can be multiplied by.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("scale {0}: expected a number above 0")]
pub struct InvalidScale(pub f32);

impl Description {
    /// Multiplies all lengths by a factor above 0: 0.001 turns millimetres into metres. Fails on another factor, and leaves everything as it is.
    pub fn scale(&mut self, factor: f32) -> Result<(), InvalidScale> {
        if !(factor > 0.0 && factor.is_finite()) {
            return Err(InvalidScale(factor));
        }
        let whole = Affine3A::from_scale(Vec3::splat(factor));
        // What hangs on nodes, key frames and skins included, follows from a node above all.
        if !self.nodes.is_empty() {
            let top = self.nodes.len() as u32;
            self.nodes.iter_mut().filter(|n| n.parent.is_none() && !n.free).for_each(|n| n.parent = Some(top));
            let rest = Local::Parts(Parts { scale: Vec3::splat(factor), ..Parts::IDENTITY });
            self.nodes.push(Node { rest, ..Node::new("") });
        }
        for object in &mut self.objects {
            match &mut object.shape {
                Shape::Mesh { world_from_mesh: place, .. }
                | Shape::Curves { world_from_curves: place, .. }
                | Shape::Splats { world_from_splats: place, .. } => *place = whole * *place,
                Shape::Sphere(s) => (s.center, s.radius) = (s.center * factor, s.radius * factor),
                Shape::Quad(q) => (q.corner, q.edges) = (q.corner * factor, q.edges.map(|e| e * factor)),
            }
        }
        for light in &mut self.punctual {
            // The place of a light that is carried is its node's.
            let carried = light.carrier.is_some();
            if let PunctualKind::Point { position } | PunctualKind::Spot { position, .. } = &mut light.kind {
                light.power = times(&light.power, factor * factor);
                if !carried {
                    *position *= factor;
                }
            }
        }
        for view in &mut self.cameras {
            view.world_from_camera.translation *= factor;
            view.lens = view.lens.map(|lens| lens.map(|length| length * factor));
            match &mut view.sight {
                CameraProjection::Orthographic { height } => *height *= factor,
                CameraProjection::Table(table) => table.focus_m *= f64::from(factor),
                CameraProjection::Perspective { .. } | CameraProjection::Panorama => {}
            }
        }
        // Media that are one stay one: their faces tell them apart by that.
        let mut media = HashMap::new();
        for material in &mut self.materials {
            scale_material(material, factor, &mut media);
        }
        if let Some(air) = &mut self.air {
            air.medium = thinned(&air.medium, factor);
            if let Some(bounds) = &mut air.bounds {
                (bounds.min, bounds.max) = (bounds.min * factor, bounds.max * factor);
            }
        }
        Ok(())
    }
}

/// Media by their old addresses.
type Media = HashMap<*const Medium, Arc<Medium>>;

/// A spectrum times a factor.
fn times(spectrum: &Spectrum, factor: f32) -> Spectrum {
    match spectrum {
        Spectrum::Constant(value) => Spectrum::Constant(value * factor),
        Spectrum::RgbLight { scale, color } => Spectrum::RgbLight { scale: scale * factor, color: *color },
        Spectrum::Table(table) => Spectrum::Table(table.scaled(factor)),
        Spectrum::TableOfRgb { table, rgb } => Spectrum::TableOfRgb { table: table.scaled(factor), rgb: *rgb * factor },
        Spectrum::Sigmoid(sigmoid) => {
            Spectrum::Table(Table::new(380.0, 5.0, (0..=80).map(|i| sigmoid.at(380.0 + 5.0 * i as f32) * factor).collect()))
        }
    }
}

/// A medium whose coefficients hold for the new unit.
fn thinned(medium: &Medium, factor: f32) -> Medium {
    let coefficient = |c: &Coefficient| match c {
        Coefficient::Scaled(per_m, spectrum) => Coefficient::Scaled(per_m / factor, spectrum.clone()),
        Coefficient::Tint { color, distance_m } => Coefficient::Tint { color: *color, distance_m: distance_m * factor },
    };
    let place = Affine3A::from_scale(Vec3::splat(factor));
    let volume = medium.volume.as_ref().map(|v| Box::new(v.placed(place)));
    Medium { absorption: coefficient(&medium.absorption), scattering: coefficient(&medium.scattering), volume, ..medium.clone() }
}

fn scale_material(material: &mut Material, factor: f32, media: &mut Media) {
    let mut filling = |medium: &mut Option<Arc<Medium>>| {
        if let Some(medium) = medium {
            *medium = media.entry(Arc::as_ptr(medium)).or_insert_with(|| Arc::new(thinned(medium, factor))).clone();
        }
    };
    match &mut material.interior {
        Interior::Same => {}
        Interior::Body { medium, .. } => filling(medium),
        Interior::Sides(sides) => sides.iter_mut().for_each(filling),
    }
    if let Some(bump) = material.bump.as_deref_mut() {
        match &mut bump.unit {
            BumpUnit::Length(metres) => *metres *= factor,
            BumpUnit::Extent(_) => {}
        }
    }
    // Patterns that lie in space.
    material.each_input_mut(&mut |input| match input {
        InputMut::Color(Color::Graph(graph)) | InputMut::Colors(graph) | InputMut::Scalar(Scalar::Graph(graph)) => {
            *graph = scaled_graph(graph, factor);
        }
        InputMut::Color(_) | InputMut::Scalar(_) => {}
    });
}

fn scaled_graph(graph: &Arc<Graph>, factor: f32) -> Arc<Graph> {
    if !graph.is_in_space() {
        return graph.clone();
    }
    let from_metres = |place: &Affine3A| *place * Affine3A::from_scale(Vec3::splat(1.0 / factor));
    let mapping = |m: &Mapping| match m {
        Mapping::Uv(_) => *m,
        Mapping::Spherical(place) => Mapping::Spherical(from_metres(place)),
        Mapping::Cylindrical(place) => Mapping::Cylindrical(from_metres(place)),
        Mapping::Planar(place, axes, offset) => Mapping::Planar(from_metres(place), *axes, *offset),
    };
    let below = |g: &Arc<Graph>| scaled_graph(g, factor);
    Arc::new(match &**graph {
        Graph::Constant(c) => Graph::Constant(*c),
        Graph::Image { texture, scale, invert, as_number, mapping: place } => Graph::Image {
            texture: texture.clone(),
            scale: *scale,
            invert: *invert,
            as_number: *as_number,
            mapping: place.as_ref().map(mapping),
        },
        Graph::Scale(a, b) => Graph::Scale(below(a), below(b)),
        Graph::Mix(a, b, amount) => Graph::Mix(below(a), below(b), below(amount)),
        Graph::DirectionMix { along, across, direction } => {
            Graph::DirectionMix { along: below(along), across: below(across), direction: *direction }
        }
        Graph::Power(a, exponent) => Graph::Power(below(a), *exponent),
        Graph::Checkerboard { place, even, odd } => {
            Graph::Checkerboard { place: mapping(place), even: below(even), odd: below(odd) }
        }
        Graph::Bilinear { place, corners } => Graph::Bilinear { place: mapping(place), corners: *corners },
        Graph::Dots { place, inside, outside } => {
            Graph::Dots { place: mapping(place), inside: below(inside), outside: below(outside) }
        }
        Graph::Cubes { texture_from_world, even, odd } => {
            Graph::Cubes { texture_from_world: from_metres(texture_from_world), even: below(even), odd: below(odd) }
        }
        Graph::Noise { texture_from_world, pattern } => {
            Graph::Noise { texture_from_world: from_metres(texture_from_world), pattern: *pattern }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::{Environment, Punctual};
    use crate::material::Scattering;
    use crate::motion::Motion;
    use crate::scene::{Object, Scene};
    use crate::shape::{Mesh, Quad, Sphere};
    use diopter_image::Raster;
    use glam::Mat3;

    /// A triangle that hangs on a node, a quad with cubes, a sphere, a point light, an even sky.
    fn world() -> Description {
        let cubes = Graph::Cubes {
            // No face of a cube lies on a surface.
            texture_from_world: Affine3A::from_translation(Vec3::new(0.1, 0.2, 0.3)) * Affine3A::from_scale(Vec3::splat(2.0)),
            even: Arc::new(Graph::Constant(Vec3::splat(0.8))),
            odd: Arc::new(Graph::Constant(Vec3::splat(0.1))),
        };
        let mesh = Mesh { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y], triangles: vec![[0, 1, 2]], ..Default::default() };
        let carried = Object {
            motion: Motion::Carried { node: 1 },
            ..Object::new("triangle", Shape::Mesh { mesh: 0, world_from_mesh: Affine3A::IDENTITY }, 0)
        };
        let place = Parts { translation: Vec3::new(0.0, 2.0, 0.0), ..Parts::IDENTITY };
        let sky = Raster { width: 2, height: 1, channels: 3, data: vec![100.0; 6] };
        Description {
            name: "world".into(),
            meshes: vec![mesh.into()],
            materials: vec![Material::new("cubes", Scattering::Diffuse(Color::Graph(Arc::new(cubes))))],
            objects: vec![
                carried,
                Object::new(
                    "floor",
                    Shape::Quad(Quad { corner: Vec3::new(-4.0, -1.0, 4.0), edges: [Vec3::X * 8.0, Vec3::Z * -8.0] }),
                    0,
                ),
                Object::new("ball", Shape::Sphere(Sphere { center: Vec3::new(2.0, 0.0, 0.0), radius: 0.7 }), 0),
            ],
            punctual: vec![Punctual::new(
                "lamp",
                Spectrum::Constant(3.0),
                PunctualKind::Point { position: Vec3::new(0.5, 3.0, 1.0) },
            )],
            environment: Some(Environment::new(sky, Mat3::IDENTITY, 1.0)),
            nodes: vec![Node::new("root"), Node { parent: Some(0), rest: Local::Parts(place), ..Node::new("hook") }],
            ..Default::default()
        }
    }

    #[test]
    fn what_is_seen_of_a_scaled_scene_is_what_is_seen_of_the_whole() {
        let factor = 0.01;
        let (whole, mut small) = (world(), world());
        small.scale(factor).unwrap();
        let (a, b) = (whole.bounds_at(0.0, |_| true), small.bounds_at(0.0, |_| true));
        assert!((a.min * factor).abs_diff_eq(b.min, 1e-5) && (a.max * factor).abs_diff_eq(b.max, 1e-5), "{a:?} {b:?}");
        // Floor, ball and triangle: the same object, pattern and, in the new unit, distance.
        let seen = |d: Description, factor: f32| {
            let scene = Scene::build(d).unwrap();
            [Vec3::new(-1.3, -1.0, 0.7), Vec3::new(2.0, 0.2, 0.0), Vec3::new(0.3, 2.3, 0.0)].map(|at| {
                let eye = Vec3::new(0.1, 4.0, 6.0);
                let ray = diopter_light::Ray { origin: eye * factor, direction: (at - eye).normalize(), time_s: 0.0 };
                let hit = scene.first_surface(&ray).expect("something is there");
                (hit.object, hit.distance / factor, hit.albedo)
            })
        };
        for (i, (a, b)) in seen(whole, 1.0).into_iter().zip(seen(small, factor)).enumerate() {
            assert!(a.0 == b.0 && (a.1 - b.1).abs() < 1e-3 * a.1 && a.2.abs_diff_eq(b.2, 1e-4), "{i}: {a:?} {b:?}");
        }
    }

    #[test]
    fn lights_media_and_patterns_follow_the_unit() {
        let mut d = world();
        let tint = Medium::fog(10.0, 0.5, 0.0);
        let shared = Arc::new(tint);
        for _ in 0..2 {
            let interior = Interior::Body { medium: Some(shared.clone()), priority: None };
            d.materials.push(Material { interior, ..Material::glass("glass", 1.5, None) });
        }
        for bad in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            assert!(d.scale(bad).is_err());
        }
        d.scale(0.1).unwrap();
        // 3 at 3.0 away lights as 0.03 at 0.3 away.
        assert!(matches!(d.punctual[0].power, Spectrum::Constant(v) if (v - 0.03).abs() < 1e-6));
        assert!(matches!(d.punctual[0].kind, PunctualKind::Point { position } if (position.y - 0.3).abs() < 1e-6));
        let medium = |i: usize| match &d.materials[i].interior {
            Interior::Body { medium: Some(medium), .. } => medium.clone(),
            other => panic!("{other:?}"),
        };
        // Ten times as thick a metre, and still one medium.
        assert!(
            matches!(medium(1).scattering, Coefficient::Scaled(v, _) if (v / (3.912 / 10.0 * 0.5 * 10.0) - 1.0).abs() < 1e-5)
        );
        assert!(Arc::ptr_eq(&medium(1), &medium(2)));
        let Scattering::Diffuse(Color::Graph(graph)) = &d.materials[0].scattering else { panic!("it was a graph") };
        let value = |p: Vec3| {
            graph.at(&crate::texture::Lookup { uv: [glam::Vec2::ZERO; 2], point: p, normal: Vec3::Y, footprint: None }).x
        };
        // Cubes of 0.5 are cubes of 0.05.
        assert!((value(Vec3::splat(0.01)) - 0.8).abs() < 1e-6 && (value(Vec3::new(0.05, 0.01, 0.01)) - 0.1).abs() < 1e-6);
    }
}
