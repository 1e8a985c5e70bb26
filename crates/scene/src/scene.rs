//! A scene: described as plain data, then built once and only read.

mod captured;
mod check;
mod description;
mod hits;
mod lights;
mod strands;

pub use description::{Description, FilmHints, LensTable, MissingTexture, Object, Shape, Sight, Variant, Viewpoint};
pub(crate) use lights::{AreaLights, LightMotion, area_lights};

use crate::SceneError;
use crate::animated::AnimatedInstances;
use crate::bvh::{Bounds, Bvh, Primitive, Primitives};
use crate::light::{Lights, Modulation, Placed};
use crate::material::pictures::Filtering;
use crate::material::{Coverage, Material};
use crate::medium::Air;
use crate::motion::{Local, Motion};
use crate::shape::Mesh;
use crate::shape::curves::CurvePieces;
use crate::shape::splats::SplatBoxes;
use check::{check, clean, settle};
use glam::{Affine3A, Vec2, Vec3};
use hits::Placement;
use std::sync::Arc;
use strands::StrandTree;

/// A scene ready to be photographed. Copies share what does not depend on the moment (geometry, materials, hierarchies, lights that stand still):
/// built once, it is posed for many exposures.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Shared until the flash of one exposure is put somewhere ([`Scene::place_node`], [`Scene::modulate`]).
    description: Arc<Description>,
    /// Everything: triangles of meshes used once (in world space), and others by object number.
    top: Arc<Bvh>,
    /// Hierarchies of meshes used more than once, by mesh.
    shared: Arc<[Option<Bvh>]>,
    /// Hierarchies of the sets of curves.
    strands: Arc<[StrandTree]>,
    /// Hierarchies of the sets of Gaussian splats.
    clouds: Arc<[Bvh]>,
    /// First triangle number in `top` of each object that is in it, rising, and the object.
    flat: Arc<[(u32, u32)]>,
    placements: Arc<[Placement]>,
    /// How pictures are filtered, by object.
    filtering: Arc<[Option<Filtering>]>,
    lights: Arc<Lights>,
    /// Area light of each triangle of emissive objects; `first_light` of the object says where its own begin.
    light_of: Arc<[u32]>,
    /// How each area light moves; empty when none does.
    light_motions: Arc<[LightMotion]>,
    /// What fills the world around its bodies.
    air: Option<Air>,
    /// What moves, over the exposure it was posed for.
    animated: Arc<AnimatedInstances>,
    /// When that exposure begins, s.
    open_s: f64,
    /// Whether light may go straight through a face: of media, of thin dielectrics.
    has_straight_transmission: bool,
    /// Whether a lamp's light changes with time.
    flickers: bool,
    /// When flashes burn.
    flashes: Vec<Modulation>,
}

impl Scene {
    /// Builds a scene. Fails when numbers do not fit: a material or mesh that is not there, nothing to see.
    pub fn build(mut description: Description) -> Result<Scene, SceneError> {
        check(&description)?;
        settle(&mut description);
        let had_surface = description.has_surface();
        clean(&mut description)?;
        if had_surface && !description.has_surface() {
            return Err(SceneError::File {
                place: description.name.clone(),
                found: "no surface: all its triangles are without area or not finite".into(),
                expected: "expected a triangle with an area".into(),
            });
        }
        crate::material::prepare(&mut description.materials);
        let d = &description;
        let mut uses = vec![0u32; d.meshes.len()];
        for object in &d.objects {
            if let Shape::Mesh { mesh, .. } = object.shape {
                // What is carried needs a hierarchy of its own, what bends makes one at each pose.
                uses[mesh as usize] += match object.motion {
                    Motion::Still => 1,
                    Motion::Carried { .. } => 2,
                    Motion::Deformed { .. } => 0,
                };
            }
        }

        // Meshes used once go into the top hierarchy as they stand; others get one of their own.
        let mut flat = Vec::new();
        let mut next = 0u32;
        for (i, object) in d.objects.iter().enumerate() {
            if let Shape::Mesh { mesh, .. } = object.shape
                && uses[mesh as usize] == 1
                && object.motion == Motion::Still
            {
                flat.push((next, i as u32));
                let count = d.meshes[mesh as usize].triangles.len();
                next = next.checked_add(count as u32).filter(|n| *n < 1 << 30).ok_or(SceneError::TooLarge(count))?;
            }
        }
        let shared: Vec<Option<Bvh>> = d
            .meshes
            .iter()
            .zip(&uses)
            .enumerate()
            .map(|(i, (mesh, uses))| {
                let filtered = d.objects.iter().any(|o| {
                    matches!(o.shape, Shape::Mesh { mesh, .. } if mesh as usize == i)
                        && !matches!(d.materials[o.material as usize].coverage, Coverage::Full)
                });
                (*uses > 1).then(|| Bvh::build(&MeshPrimitives { mesh, filtered }))
            })
            .collect();
        let strands: Vec<StrandTree> = d
            .curves
            .iter()
            .map(|curves| {
                let levels = curves.levels();
                StrandTree { bvh: Bvh::build(&CurvePieces { curves, levels }), levels }
            })
            .collect();
        let clouds: Vec<Bvh> = d.splats.iter().map(|s| Bvh::build(&SplatBoxes(s))).collect();
        let placements: Vec<Placement> = d.objects.iter().map(Placement::new).collect();
        let others: Vec<(u32, Bounds)> = d
            .objects
            .iter()
            .enumerate()
            .filter(|(_, object)| object.motion == Motion::Still)
            .filter_map(|(i, object)| {
                let bounds = match object.shape {
                    Shape::Sphere(s) => Bounds { min: s.center - s.radius, max: s.center + s.radius },
                    Shape::Quad(q) => {
                        // A flat box would be missed by rounding: give it a little depth.
                        let b = Bounds::around([Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE].map(|p| q.point(p)));
                        let pad = 1e-5 * b.size().max_element().max(b.max.abs().max(b.min.abs()).max_element());
                        Bounds { min: b.min - pad, max: b.max + pad }
                    }
                    Shape::Mesh { mesh, .. } => shared[mesh as usize].as_ref()?.bounds().placed(&placements[i].world_from_object),
                    Shape::Curves { curves, .. } => {
                        let local = strands[curves as usize].bvh.bounds();
                        Some(local).filter(|b| !b.is_empty())?.placed(&placements[i].world_from_object)
                    }
                    Shape::Splats { splats, .. } => {
                        let local = clouds[splats as usize].bounds();
                        Some(local).filter(|b| !b.is_empty())?.placed(&placements[i].world_from_object)
                    }
                };
                Some((i as u32, bounds))
            })
            .collect();
        let top = Bvh::build(&TopPrimitives { description: d, flat: &flat, triangles: next as usize, others: &others });

        let AreaLights { lights, ways, light_of, first } = area_lights(d, |e| e.is_light);
        let light_motions = if ways.iter().all(|w| matches!(w, LightMotion::Still)) { Vec::new() } else { ways };
        let placements = placements.into_iter().zip(first).map(|(p, first_light)| Placement { first_light, ..p }).collect();
        let mut all = Lights::default();
        (all.area, all.punctual, all.environment) = (lights, d.punctual.clone(), d.environment.clone());
        let by_material: Vec<Option<Filtering>> = d.materials.iter().map(Material::filter_pictures).collect();
        let filtering = d.objects.iter().map(|o| by_material[o.material as usize]).collect();
        let (animated, open_s, flickers, flashes) = (Arc::<AnimatedInstances>::default(), 0.0, false, Vec::new());
        let has_straight_transmission = d.objects.iter().any(|o| d.materials[o.material as usize].may_transmit_straight());
        let mut scene = Scene {
            top: Arc::new(top),
            shared: shared.into(),
            strands: strands.into(),
            clouds: clouds.into(),
            flat: flat.into(),
            placements,
            filtering,
            lights: Arc::new(all),
            light_of: light_of.into(),
            light_motions: light_motions.into(),
            air: description.air.clone(),
            animated,
            open_s,
            has_straight_transmission,
            flickers,
            flashes,
            description: Arc::new(description),
        };
        scene.note_modulations();
        scene.arrange(0.0, 0.0);
        Ok(scene)
    }

    /// Makes what moves ready for an exposure that begins at `open_s` and takes `span_s` (both s). Times of rays count from its
    /// beginning. A scene is built posed for the moment 0.
    pub fn pose(&mut self, open_s: f64, span_s: f64) {
        self.open_s = open_s;
        let d = &self.description;
        if d.objects.iter().any(|o| o.motion != Motion::Still) || d.punctual.iter().any(|l| l.carrier.is_some()) {
            self.arrange(open_s, span_s);
        }
    }

    fn arrange(&mut self, open_s: f64, span_s: f64) {
        let d = &self.description;
        let strands: Vec<Bounds> = self.strands.iter().map(|s| s.bvh.bounds()).collect();
        let clouds: Vec<Bounds> = self.clouds.iter().map(Bvh::bounds).collect();
        self.animated = Arc::new(AnimatedInstances::new(d, &d.timeline(), &self.shared, [&strands, &clouds], open_s, span_s));
        let Lights { area, punctual, environment, .. } = Arc::unwrap_or_clone(std::mem::take(&mut self.lights));
        let flash = |i: usize| {
            let emission = d.materials[area[i].material as usize].emission.as_ref();
            emission.is_some_and(|e| e.modulation.is_pulse())
        };
        let placed_area: Vec<Placed> = (0..area.len())
            .map(|i| {
                let way = self.light_motions.get(i).copied().unwrap_or(LightMotion::Still);
                Placed { bounds: self.swept_light(&area[i], way), flash: flash(i) }
            })
            .collect();
        let placed_punctual: Vec<Placed> = punctual
            .iter()
            .zip(&self.animated.lights)
            .map(|(light, way)| {
                let track = way.as_ref();
                let bounds = track.and_then(|t| {
                    let boxes = (0..=64).map(|k| Vec3::from(t.at(k as f32 / 64.0).translation));
                    light.bounds().map(|b| b.anywhere_in(Bounds::around(boxes)))
                });
                Placed { bounds, flash: light.modulation.is_pulse() }
            })
            .collect();
        self.lights = Arc::new(Lights::new(area, punctual, environment, &placed_area, &placed_punctual));
    }

    /// When the exposure that it was posed for begins, s.
    pub fn open_s(&self) -> f64 {
        self.open_s
    }

    /// The box that a moving object stays in during the exposure; `None` of one that stands still.
    pub(crate) fn swept_bounds(&self, object: u32) -> Option<Bounds> {
        Some(self.animated.swept(self.animated.instance(object)?))
    }

    /// The moment of the scene at a time of the exposure, s: stopped where its animations are.
    #[inline]
    pub(crate) fn moment_s(&self, time_s: f32) -> f64 {
        self.description.playing.frozen_at_s.unwrap_or(self.open_s + f64::from(time_s))
    }

    /// Puts a free node ([`crate::motion::Node::free`]) somewhere. What hangs on it follows at the next [`Scene::pose`].
    pub fn place_node(&mut self, node: u32, world_from_node: Affine3A) {
        let node = &mut Arc::make_mut(&mut self.description).nodes[node as usize];
        assert!(node.free && node.parent.is_none(), "node \"{}\" is not free", node.name);
        node.rest = Local::Matrix(world_from_node);
    }

    /// Changes how the lamps of a material shine with time.
    pub fn modulate(&mut self, material: u32, modulation: Modulation) {
        if let Some(emission) = &mut Arc::make_mut(&mut self.description).materials[material as usize].emission {
            emission.modulation = modulation;
        }
        self.note_modulations();
    }

    fn note_modulations(&mut self) {
        let d = &self.description;
        let all = || d.materials.iter().map(Material::modulation).chain(d.punctual.iter().map(|l| l.modulation));
        self.flickers = all().any(|m| m != Modulation::Steady);
        self.flashes = all().filter(Modulation::is_pulse).collect();
    }

    /// Whether something moves in more turns than its steps can follow in the exposure it was posed for.
    pub fn motion_is_coarse(&self) -> bool {
        self.animated.coarse()
    }

    /// Whether anything moves while light is gathered.
    pub fn moves(&self) -> bool {
        !self.animated.is_empty() || self.animated.lights.iter().any(Option::is_some)
    }

    /// What the scene was built from.
    pub fn description(&self) -> &Description {
        &self.description
    }

    /// What moves, over the exposure it was posed for.
    pub(crate) fn animated(&self) -> &AnimatedInstances {
        &self.animated
    }

    /// Its lights.
    pub fn lights(&self) -> &Lights {
        &self.lights
    }

    /// The box around everything, as it is when the exposure begins; what hangs on free nodes is left out.
    pub fn bounds(&self) -> Bounds {
        self.top.bounds().union(self.animated.opening_bounds())
    }

    /// Triangles in meshes, each mesh counted once.
    pub fn triangle_count(&self) -> usize {
        self.description.meshes.iter().map(|m| m.triangles.len()).sum()
    }

    /// Segments of curves, each set counted once.
    pub fn segment_count(&self) -> usize {
        self.description.curves.iter().map(|c| c.segments.len()).sum()
    }

    /// Gaussian splats, each set counted once.
    pub fn splat_count(&self) -> usize {
        self.description.splats.iter().map(|s| s.len()).sum()
    }

    /// Bytes held by (meshes, curves and splats, hierarchies).
    pub fn memory(&self) -> (usize, usize) {
        let meshes: usize = self.description.meshes.iter().map(|m| m.memory()).sum();
        let curves: usize = self.description.curves.iter().map(|c| c.memory()).sum();
        let splats: usize = self.description.splats.iter().map(|s| s.memory()).sum();
        let below = self.shared.iter().flatten().chain(self.strands.iter().map(|s| &s.bvh)).chain(self.clouds.iter());
        let below = below.map(Bvh::memory).sum::<usize>();
        (meshes + curves + splats, self.top.memory() + below + self.animated.memory())
    }

    /// Material of an object.
    #[inline]
    pub fn material(&self, object: u32) -> &Material {
        self.material_at(self.material_number(object))
    }

    /// Number of the material of an object.
    #[inline]
    pub(crate) fn material_number(&self, object: u32) -> u32 {
        self.description.objects[object as usize].material
    }

    /// A material by its number.
    #[inline]
    pub(crate) fn material_at(&self, number: u32) -> &Material {
        &self.description.materials[number as usize]
    }

    /// How the pictures on an object are filtered.
    #[inline]
    pub(crate) fn filtering(&self, object: u32) -> Option<&Filtering> {
        self.filtering[object as usize].as_ref()
    }

    /// Whether pictures on surfaces are filtered where rays have a width ([`crate::radiance::RayCone`]).
    pub fn filters_pictures(&self) -> bool {
        self.filtering.iter().any(Option::is_some)
    }

    /// Fills the world around its bodies.
    pub fn fill_air(&mut self, air: Option<Air>) {
        self.air = air;
    }

    /// What fills the world around its bodies.
    pub fn air(&self) -> Option<&Air> {
        self.air.as_ref()
    }

    /// Whether some of its surfaces are the faces of media and nothing else.
    pub(crate) fn has_straight_transmission(&self) -> bool {
        self.has_straight_transmission
    }
}

struct MeshPrimitives<'a> {
    mesh: &'a Mesh,
    filtered: bool,
}

impl Primitives for MeshPrimitives<'_> {
    fn len(&self) -> usize {
        self.mesh.triangles.len()
    }
    fn get(&self, index: usize) -> Primitive {
        Primitive::Triangle { corners: self.mesh.corners(index), id: index as u32, filtered: self.filtered }
    }
}

struct TopPrimitives<'a> {
    description: &'a Description,
    flat: &'a [(u32, u32)],
    triangles: usize,
    others: &'a [(u32, Bounds)],
}

impl Primitives for TopPrimitives<'_> {
    fn len(&self) -> usize {
        self.triangles + self.others.len()
    }
    fn get(&self, index: usize) -> Primitive {
        if index >= self.triangles {
            let (id, bounds) = self.others[index - self.triangles];
            return Primitive::Other { bounds, id };
        }
        let (first, object) = self.flat[self.flat.partition_point(|(first, _)| *first <= index as u32) - 1];
        let object = &self.description.objects[object as usize];
        let Shape::Mesh { mesh, world_from_mesh } = object.shape else { unreachable!("flat objects are meshes") };
        let corners = self.description.meshes[mesh as usize].corners(index - first as usize);
        let filtered = !matches!(self.description.materials[object.material as usize].coverage, Coverage::Full);
        Primitive::Triangle { corners: corners.map(|c| world_from_mesh.transform_point3(c)), id: index as u32, filtered }
    }
}
