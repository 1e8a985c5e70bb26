//! A photographer's studio around a model: key, fill and rim light, a grey sweep to stand on, a little light from all around.
//!
//! The usual three-point lighting. Key: a soft box in front, to the left of the camera and above. Fill: larger, nearer to the camera's height on the other
//! side, a third of the key. Rim: behind the model, opposite the key. Each is a flat panel of even luminance that shines towards the model alone. Distances and sides
//! are in half diagonals of the model's box, luminances follow from the illuminance that each panel makes in its middle: large and small models are lit
//! alike, in lux. All light is D65. The sweep (cyclorama) runs from under the camera to behind the model and curves up to a wall; it darkens
//! with the distance from the lamps, so the background is graded. Lamps are moved upwards until the camera does not see them.
//!
//! The ratio of key to fill (3:1) is the common one of portraits and products; illuminances and sizes are chosen.

use crate::bvh::Bounds;
use crate::light::Environment;
use crate::material::{Material, Scattering};
use crate::scene::{Description, Object, Shape};
use crate::shape::{Mesh, Quad};
use crate::texture::Color;
use diopter_light::Spectrum;
use diopter_light::cie::d65_one_nit;
use glam::{Affine3A, Vec3};
use std::f32::consts::{FRAC_2_PI, FRAC_PI_2, PI};

/// Albedo of the sweep: white things are brighter than it, dark ones darker.
pub const ALBEDO: f32 = 0.3;
/// Luminance from all around, cd/m²: 63 lx on every face, so that nothing is black.
const AMBIENT: f32 = 20.0;

/// Name of the sweep.
const BACKDROP: &str = "studio backdrop";

/// A panel: where it stands seen from the model, and what it gives.
struct Panel {
    name: &'static str,
    /// To the right of the direction to the camera, as seen in the picture, degrees.
    azimuth_deg: f32,
    /// Least elevation, degrees.
    elevation_deg: f32,
    /// Half diagonals of the model's box.
    distance: f32,
    /// Width and height, the same unit.
    size: [f32; 2],
    /// On a plane in the model's middle that faces it, lx.
    illuminance_lx: f32,
}

/// Key, fill and rim.
static PANELS: [Panel; 3] = [
    Panel {
        name: "studio key light",
        azimuth_deg: -45.0,
        elevation_deg: 45.0,
        distance: 4.0,
        size: [2.5, 2.5],
        illuminance_lx: 1500.0,
    },
    Panel {
        name: "studio fill light",
        azimuth_deg: 55.0,
        elevation_deg: 25.0,
        distance: 5.0,
        size: [4.0, 4.0],
        illuminance_lx: 500.0,
    },
    Panel {
        name: "studio rim light",
        azimuth_deg: 145.0,
        elevation_deg: 45.0,
        distance: 4.0,
        size: [2.5, 1.2],
        illuminance_lx: 1000.0,
    },
];
/// Steps in which a panel is raised, and how high it goes at most, degrees.
const RAISE_DEG: f32 = 5.0;
const HIGHEST_DEG: f32 = 85.0;
/// A panel keeps so far out of the frame, as a fraction of half of it.
const MARGIN: f32 = 0.1;

/// Where the sweep begins to curve, behind the model's middle, and its radius there, in half diagonals.
const CURVE_AT: f32 = 3.0;
const CURVE_RADIUS: f32 = 3.0;
const CURVE_STEPS: usize = 24;

/// What a camera sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// It looks along −Z with +Y up.
    pub world_from_camera: Affine3A,
    /// Tangents of half the angles of view, across and up.
    pub tan_half: [f32; 2],
}

/// A studio for a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Studio {
    /// The box around the model; it stands on its lower face.
    pub subject: Bounds,
    /// The camera it is seen by.
    pub view: View,
    /// Of the sweep, 0 to 1.
    pub albedo: f32,
}

impl View {
    fn eye(&self) -> Vec3 {
        self.world_from_camera.translation.into()
    }

    /// Directions to the corners of the frame.
    fn corners(&self) -> [Vec3; 4] {
        let [x, y] = self.tan_half;
        [[-x, -y], [x, -y], [x, y], [-x, y]]
            .map(|[x, y]| self.world_from_camera.transform_vector3(Vec3::new(x, y, -1.0)).normalize_or_zero())
    }

    /// Whether some of a parallelogram may lie in the frame: not where all of it is beyond one of the frame's sides.
    fn may_see(&self, quad: &Quad) -> bool {
        let camera_from_world = self.world_from_camera.inverse();
        let corners = quad.corners().map(|p| camera_from_world.transform_point3(p));
        let [x, y] = self.tan_half.map(|t| t * (1.0 + MARGIN));
        let beyond = |outside: &dyn Fn(Vec3) -> bool| corners.iter().all(|c| outside(*c));
        !(beyond(&|c| c.x > -x * c.z)
            || beyond(&|c| -c.x > -x * c.z)
            || beyond(&|c| c.y > -y * c.z)
            || beyond(&|c| -c.y > -y * c.z)
            || beyond(&|c| c.z >= 0.0))
    }
}

/// Illuminance that an even panel of luminance 1 cd/m² makes at a point before its middle, on a plane parallel to it, lx.
///
/// π × the configuration factor; a, b: half its sides over the distance. Source: J. R. Howell, "A catalog of radiation heat transfer configuration
/// factors", plane element to parallel rectangle with its normal through a corner (four of these make the panel).
fn illuminance_of_panel(a: f32, b: f32) -> f32 {
    let part = |a: f32, b: f32| {
        let root = (1.0 + a * a).sqrt();
        a / root * (b / root).atan()
    };
    PI * FRAC_2_PI * (part(a, b) + part(b, a))
}

impl Studio {
    /// Whether an object belongs to a studio and not to the model.
    pub fn is_part(object: &Object) -> bool {
        match object.shape {
            Shape::Quad(_) => PANELS.iter().any(|p| p.name == object.name),
            Shape::Mesh { .. } => object.name == BACKDROP,
            Shape::Sphere(_) | Shape::Curves { .. } | Shape::Splats { .. } => false,
        }
    }

    /// Half the diagonal of the model's box, m.
    fn radius(&self) -> f32 {
        (0.5 * self.subject.size().length()).max(1e-6)
    }

    /// Level and of length 1: from the model towards the camera; of a camera straight above, towards the lower side of its picture.
    pub fn facing(&self) -> Vec3 {
        let level = |v: Vec3, least: f32| v.with_y(0.0).try_normalize().filter(|_| v.with_y(0.0).length() > least);
        let to = self.view.eye() - self.subject.center();
        let down = -Vec3::from(self.view.world_from_camera.matrix3.y_axis);
        level(to, 0.02 * to.length()).or_else(|| level(down, 0.0)).unwrap_or(Vec3::Z)
    }

    /// A panel at an elevation.
    fn place(&self, panel: &Panel, elevation_deg: f32) -> Quad {
        let (facing, radius) = (self.facing(), self.radius());
        // Right of the camera's direction as the picture shows it.
        let right = (-facing).cross(Vec3::Y);
        let (azimuth, elevation) = (panel.azimuth_deg.to_radians(), elevation_deg.to_radians());
        let level = facing * azimuth.cos() + right * azimuth.sin();
        let to = level * elevation.cos() + Vec3::Y * elevation.sin();
        let side = Vec3::Y.cross(level).normalize();
        let up = to.cross(side);
        let [width, height] = panel.size.map(|s| s * radius);
        // Outside is edge₀ × edge₁ = −to: it shines on the model.
        let edges = [up * height, side * width];
        Quad { corner: self.subject.center() + to * (panel.distance * radius) - 0.5 * (edges[0] + edges[1]), edges }
    }

    /// Key, fill and rim where they stand: above the floor and, where that can be, out of the frame.
    fn panels(&self) -> [(&'static Panel, Quad); 3] {
        let lowest = self.subject.min.y + 0.05 * self.radius();
        let above = |quad: &Quad| quad.corners().iter().all(|p| p.y > lowest);
        [0, 1, 2].map(|i: usize| {
            let panel = &PANELS[i];
            let steps = ((HIGHEST_DEG - panel.elevation_deg) / RAISE_DEG) as usize;
            let mut places =
                (0..=steps).map(|k| self.place(panel, panel.elevation_deg + RAISE_DEG * k as f32)).filter(above).peekable();
            // A camera that sees all around sees lamps, too.
            let first = places.peek().copied().unwrap_or_else(|| self.place(panel, HIGHEST_DEG));
            (panel, places.find(|q| !self.view.may_see(q)).unwrap_or(first))
        })
    }

    /// The sweep, if the camera is above the floor.
    fn backdrop(&self) -> Option<Mesh> {
        let (radius, center, eye) = (self.radius(), self.subject.center(), self.view.eye());
        // As far below the model as keeps the two apart by rounding.
        let floor = self.subject.min.y - 1e-4 * self.subject.size().max_element().max(1e-6);
        if eye.y < floor + 1e-3 * radius {
            return None;
        }
        let back = -self.facing();
        let right = back.cross(Vec3::Y);
        let wall = (CURVE_AT + CURVE_RADIUS) * radius;
        let to_eye = eye - center;
        // Wide and high enough to fill the frame, within reason.
        let most = 20.0 * (radius + to_eye.length());
        let (mut half_width, mut height) = (6.0 * radius, 6.0 * radius);
        for d in self.view.corners() {
            let along = d.dot(back);
            let reach = (wall - to_eye.dot(back)) / along;
            if along > 0.02 && reach > 0.0 {
                half_width = half_width.max((1.2 * (to_eye.dot(right) + reach * d.dot(right)).abs()).min(most));
                height = height.max((1.2 * (eye.y - floor + reach * d.y)).min(most));
            }
        }
        let front = (-to_eye.dot(back) + 2.0 * radius).min(most).max(6.0 * radius);
        // Profile: how far back, how high, and the normal there.
        let (at, r) = (CURVE_AT * radius, CURVE_RADIUS * radius);
        let mut profile = vec![([-front, 0.0], [0.0, 1.0])];
        profile.extend((0..=CURVE_STEPS).map(|k| {
            let (sin, cos) = (FRAC_PI_2 * k as f32 / CURVE_STEPS as f32).sin_cos();
            ([at + r * sin, r * (1.0 - cos)], [-sin, cos])
        }));
        profile.push(([wall, height.max(r * 1.5)], [-1.0, 0.0]));
        let origin = center.with_y(floor);
        let mut mesh = Mesh::default();
        for (i, ([u, v], [nu, nv])) in profile.into_iter().enumerate() {
            for side in [-half_width, half_width] {
                mesh.positions.push(origin + back * u + Vec3::Y * v + right * side);
                mesh.normals.push((back * nu + Vec3::Y * nv).normalize());
            }
            if let Some(before) = i.checked_sub(1) {
                let (a, b) = (2 * before as u32, 2 * i as u32);
                mesh.triangles.extend([[a, a + 1, b + 1], [a, b + 1, b]]);
            }
        }
        Some(mesh)
    }

    /// Puts the studio around a scene, instead of the environment it has; lamps of its own stay.
    pub fn add_to_scene(&self, scene: &mut Description) {
        for (panel, quad) in self.panels() {
            let [a, b] = panel.size.map(|s| 0.5 * s / panel.distance);
            let luminance = panel.illuminance_lx / illuminance_of_panel(a, b);
            scene.materials.push(Material::lamp(panel.name, Spectrum::Table(d65_one_nit().scaled(luminance))));
            scene.objects.push(Object::new(panel.name, Shape::Quad(quad), scene.materials.len() as u32 - 1));
        }
        if let Some(mesh) = self.backdrop() {
            scene.meshes.push(mesh.into());
            let color = Color::rgb(self.albedo, self.albedo, self.albedo);
            scene.materials.push(Material::new(BACKDROP, Scattering::Diffuse(color)));
            let shape = Shape::Mesh { mesh: scene.meshes.len() as u32 - 1, world_from_mesh: Affine3A::IDENTITY };
            scene.objects.push(Object::new(BACKDROP, shape, scene.materials.len() as u32 - 1));
        }
        scene.environment = Some(Environment::uniform(Vec3::splat(AMBIENT)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scene;
    use glam::Vec2;
    use glam::{Mat3A, Vec3A};

    /// A camera at a place, looking at another.
    fn view(eye: Vec3, at: Vec3, tan_half: [f32; 2]) -> View {
        let back = (eye - at).normalize();
        let right = Vec3::Y.cross(back).normalize();
        let axes = Mat3A::from_cols(right.into(), back.cross(right).into(), back.into());
        View { world_from_camera: Affine3A { matrix3: axes, translation: Vec3A::from(eye) }, tan_half }
    }

    /// Boxes and cameras: 50 mm across and upright, 16 mm, from above, small and large.
    fn studios() -> Vec<Studio> {
        let mut all = Vec::new();
        for (size, scale) in [(Vec3::ONE, 1.0), (Vec3::new(0.2, 2.0, 0.2), 0.01), (Vec3::new(3.0, 0.1, 2.0), 40.0)] {
            let subject = Bounds { min: Vec3::new(1.0, -2.0, 3.0) * scale, max: (Vec3::new(1.0, -2.0, 3.0) + size) * scale };
            let radius = 0.5 * subject.size().length();
            for (direction, distance, tan_half) in [
                (Vec3::new(0.5, 0.3, 0.85), 4.5, [0.36, 0.24]),
                (Vec3::new(0.5, 0.3, 0.85), 4.5, [0.24, 0.36]),
                (Vec3::new(-0.9, 0.2, -0.2), 2.0, [1.1, 0.75]),
                (Vec3::new(0.1, 0.9, 0.2), 4.5, [0.36, 0.24]),
            ] {
                let eye = subject.center() + direction.normalize() * (distance * radius);
                all.push(Studio { subject, view: view(eye, subject.center(), tan_half), albedo: ALBEDO });
            }
        }
        all
    }

    #[test]
    fn every_lamp_gives_the_illuminance_it_claims() {
        for studio in studios() {
            let mut d = Description::default();
            studio.add_to_scene(&mut d);
            for (panel, object) in PANELS.iter().zip(&d.objects) {
                let Shape::Quad(quad) = object.shape else { panic!("{} is a panel", object.name) };
                let emission = d.materials[object.material as usize].emission.as_ref().unwrap();
                let luminance = f64::from(emission.luminance(&[Vec2::ZERO; 2]));
                // ∫ L cos θ cos θ' / d² dA by midpoints, on a plane that faces the middle of the panel.
                let center = studio.subject.center().as_dvec3();
                let middle = quad.point(Vec2::splat(0.5)).as_dvec3();
                let (normal, facing) = (quad.normal().as_dvec3(), (middle - center).normalize());
                let n = 64;
                let sum: f64 = (0..n * n)
                    .map(|i| {
                        let p = Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32;
                        let to = quad.point(p).as_dvec3() - center;
                        let w = to.normalize();
                        w.dot(facing) * -w.dot(normal) / to.length_squared()
                    })
                    .sum();
                let lux = luminance * sum * f64::from(quad.area()) / f64::from(n * n);
                assert!((lux / f64::from(panel.illuminance_lx) - 1.0).abs() < 5e-3, "{}: {lux} lx", panel.name);
            }
        }
        // Key to fill is 3 to 1.
        assert_eq!(PANELS[0].illuminance_lx / PANELS[1].illuminance_lx, 3.0);
    }

    #[test]
    fn lamps_stand_above_the_floor_and_out_of_the_picture() {
        for studio in studios() {
            for (panel, quad) in studio.panels() {
                assert!(!studio.view.may_see(&quad), "{} is seen from {}", panel.name, studio.view.eye());
                let lowest = quad.corners().map(|p| p.y).into_iter().fold(f32::MAX, f32::min);
                assert!(lowest > studio.subject.min.y, "{}", panel.name);
                // The key comes from the left of the picture, the fill from the right, the rim from behind.
                let camera_from_world = studio.view.world_from_camera.inverse();
                let seen = camera_from_world.transform_vector3(quad.point(Vec2::splat(0.5)) - studio.subject.center());
                match panel.azimuth_deg {
                    a if a < 0.0 => assert!(seen.x < 0.0, "{seen}"),
                    a if a < 90.0 => assert!(seen.x > 0.0, "{seen}"),
                    _ => assert!((quad.point(Vec2::splat(0.5)) - studio.subject.center()).dot(studio.facing()) < 0.0),
                }
            }
        }
        // A panel in the frame is found.
        let view = view(Vec3::Z * 5.0, Vec3::ZERO, [0.4, 0.3]);
        let quad = |x: f32| Quad { corner: Vec3::new(x, -0.5, 0.0), edges: [Vec3::X, Vec3::Y] };
        assert!(view.may_see(&quad(-0.5)) && view.may_see(&quad(1.5)) && !view.may_see(&quad(2.5)) && !view.may_see(&quad(-3.5)));
    }

    #[test]
    fn the_sweep_fills_the_frame_behind_the_model() {
        for studio in studios() {
            let mesh = studio.backdrop().expect("the camera is above the floor");
            for (i, t) in mesh.triangles.iter().enumerate() {
                let [a, b, c] = mesh.corners(i);
                let normal = (b - a).cross(c - a);
                assert!(t.iter().all(|v| normal.dot(mesh.normals[*v as usize]) > 0.0), "triangle {i} faces away");
            }
            let mut d = Description::default();
            studio.add_to_scene(&mut d);
            let scene = Scene::build(d).unwrap();
            for direction in studio.view.corners() {
                let ray = diopter_light::Ray { origin: studio.view.eye(), direction, time_s: 0.0 };
                let hit = scene.first_surface(&ray).expect("no hole in the background");
                assert_eq!(scene.description().objects[hit.object as usize].name, BACKDROP);
            }
        }
        // A camera below the floor is not to look at its lower side.
        let subject = Bounds { min: Vec3::ZERO, max: Vec3::ONE };
        let below = view(Vec3::new(0.0, -1.0, 4.0), Vec3::splat(0.5), [0.36, 0.24]);
        assert!(Studio { subject, view: below, albedo: ALBEDO }.backdrop().is_none());
    }
}
