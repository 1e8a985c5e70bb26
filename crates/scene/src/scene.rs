//! A scene: described as plain data, then built once and only read.

mod build;
mod captured;
mod check;
pub(crate) mod description;
mod hits;
pub(crate) use hits::Visibility;
mod lights;
mod mirrors;
mod strands;

pub use description::{CameraProjection, Description, FilmHints, LensTable, MissingTexture, Object, Shape, Variant, Viewpoint};
pub(crate) use lights::{AreaLights, LightMotion, area_lights};
pub(crate) use mirrors::{Mirror, Mirrors};

use crate::animated::AnimatedInstances;
use crate::bvh::{Bounds, Bvh};
use crate::light::{Lights, Modulation, Placed};
use crate::material::Material;
use crate::material::pictures::Filtering;
use crate::medium::Air;
use crate::motion::{Local, Motion};
use glam::{Affine3A, Vec3};
use hits::Placement;
use std::sync::Arc;
use strands::StrandTree;

/// A scene ready to be photographed. Copies share what does not depend on the moment (geometry, materials, hierarchies, lights that stand still):
/// built once, it is posed for many exposures.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Shared until the flash of one exposure is put somewhere ([`Scene::place_node`], [`Scene::modulate`]).
    description: Arc<Description>,
    built: Arc<Built>,
    posed: Posed,
    /// What fills the world around its bodies.
    air: Option<Air>,
    /// Whether a lamp's light changes with time.
    flickers: bool,
    /// When flashes burn.
    flashes: Vec<Modulation>,
}

/// What is the same at all moments.
#[derive(Debug)]
struct Built {
    /// Everything: triangles of meshes used once (in world space), and others by object number.
    top: Bvh,
    /// Hierarchies of meshes used more than once, by mesh.
    shared: Vec<Option<Bvh>>,
    /// Hierarchies of the sets of curves.
    strands: Vec<StrandTree>,
    /// Hierarchies of the sets of Gaussian splats.
    clouds: Vec<Bvh>,
    /// First triangle number in `top` of each object that is in it, rising, and the object.
    flat: Vec<(u32, u32)>,
    placements: Vec<Placement>,
    /// How pictures are filtered, by object.
    filtering: Vec<Option<Filtering>>,
    /// Area light of each triangle of emissive objects; `first_light` of the object says where its own begin.
    light_of: Vec<u32>,
    /// How each area light moves; empty when none does.
    light_motions: Vec<LightMotion>,
    /// By object, whether a shadow ray that meets it may go on: faces of media, thin dielectrics, what lets rays through by chance.
    may_pass: Vec<bool>,
    /// Whether light may go straight through a face: of media, of thin dielectrics.
    has_straight_transmission: bool,
    /// Whether surfaces let rays through by chance.
    has_blends: bool,
    /// Of each object whether it is a clear body that bends light.
    is_clear_body: Vec<bool>,
    has_clear_bodies: bool,
    mirrors: Mirrors,
    /// Whether media of bodies do no more than absorb.
    media_only_absorb: bool,
    /// Whether a body may bend wavelengths differently.
    may_disperse: bool,
}

/// A scene over one exposure.
#[derive(Clone, Debug, Default)]
struct Posed {
    /// When it begins, s.
    open_s: f64,
    /// What moves.
    animated: Arc<AnimatedInstances>,
    lights: Arc<Lights>,
}

impl Scene {
    /// Makes what moves ready for an exposure that begins at `open_s` and takes `span_s` (both s). Times of rays count from its
    /// beginning. A scene is built posed for the moment 0.
    pub fn pose(&mut self, open_s: f64, span_s: f64) {
        self.posed.open_s = open_s;
        let d = &self.description;
        if d.objects.iter().any(|o| o.motion != Motion::Still) || d.punctual.iter().any(|l| l.carrier.is_some()) {
            self.arrange(open_s, span_s);
        }
    }

    fn arrange(&mut self, open_s: f64, span_s: f64) {
        let d = &self.description;
        let strands: Vec<Bounds> = self.built.strands.iter().map(|s| s.bvh.bounds()).collect();
        let clouds: Vec<Bounds> = self.built.clouds.iter().map(Bvh::bounds).collect();
        self.posed.animated =
            Arc::new(AnimatedInstances::new(d, &d.timeline(), &self.built.shared, [&strands, &clouds], open_s, span_s));
        let Lights { area, punctual, environment, .. } = Arc::unwrap_or_clone(std::mem::take(&mut self.posed.lights));
        let flash = |i: usize| {
            let emission = d.materials[area[i].material as usize].emission.as_ref();
            emission.is_some_and(|e| e.modulation.is_pulse())
        };
        let placed_area: Vec<Placed> = (0..area.len())
            .map(|i| {
                let motion = self.built.light_motions.get(i).copied().unwrap_or(LightMotion::Still);
                Placed { bounds: self.swept_light(&area[i], motion), flash: flash(i) }
            })
            .collect();
        let placed_punctual: Vec<Placed> = punctual
            .iter()
            .zip(&self.posed.animated.lights)
            .map(|(light, track)| {
                let track = track.as_ref();
                let bounds = track.and_then(|t| {
                    let boxes = (0..=64).map(|k| Vec3::from(t.at(k as f32 / 64.0).translation));
                    light.bounds().map(|b| b.anywhere_in(Bounds::around(boxes)))
                });
                Placed { bounds, flash: light.modulation.is_pulse() }
            })
            .collect();
        self.posed.lights = Arc::new(Lights::new(area, punctual, environment, &placed_area, &placed_punctual));
    }

    /// When the exposure that it was posed for begins, s.
    pub fn open_s(&self) -> f64 {
        self.posed.open_s
    }

    /// The box that a moving object stays in during the exposure; `None` of one that stands still.
    pub(crate) fn swept_bounds(&self, object: u32) -> Option<Bounds> {
        Some(self.posed.animated.swept(self.posed.animated.instance(object)?))
    }

    /// The moment of the scene at a time of the exposure, s: stopped where its animations are.
    #[inline]
    pub(crate) fn moment_s(&self, time_s: f32) -> f64 {
        self.description.playing.frozen_at_s.unwrap_or(self.posed.open_s + f64::from(time_s))
    }

    /// Places a free node ([`crate::motion::Node::free`]) in the world, m. What hangs on it follows at the next [`Scene::pose`]. Gives whether the number is a free node's;
    /// nothing changes otherwise.
    pub fn place_node(&mut self, node: u32, world_from_node: Affine3A) -> bool {
        let node = Arc::make_mut(&mut self.description).nodes.get_mut(node as usize);
        let Some(node) = node.filter(|node| node.free && node.parent.is_none()) else { return false };
        node.rest = Local::Matrix(world_from_node);
        true
    }

    /// Changes how the lamps of a material shine with time. Gives whether the number is that of a material that shines; nothing changes otherwise.
    pub fn modulate(&mut self, material: u32, modulation: Modulation) -> bool {
        let material = Arc::make_mut(&mut self.description).materials.get_mut(material as usize);
        let Some(emission) = material.and_then(|material| material.emission.as_mut()) else { return false };
        emission.modulation = modulation;
        self.note_modulations();
        true
    }

    fn note_modulations(&mut self) {
        let d = &self.description;
        let all = || d.materials.iter().map(Material::modulation).chain(d.punctual.iter().map(|l| l.modulation));
        self.flickers = all().any(|m| m != Modulation::Steady);
        self.flashes = all().filter(Modulation::is_pulse).collect();
    }

    /// Whether something moves in more turns than its steps can follow in the exposure it was posed for.
    pub fn motion_is_coarse(&self) -> bool {
        self.posed.animated.coarse()
    }

    /// Whether anything moves while light is gathered.
    pub fn moves(&self) -> bool {
        !self.posed.animated.is_empty() || self.posed.animated.lights.iter().any(Option::is_some)
    }

    /// Whether a lamp's light changes with time.
    pub fn flickers(&self) -> bool {
        self.flickers
    }

    /// Whether a body may bend wavelengths differently.
    pub(crate) fn may_disperse(&self) -> bool {
        self.built.may_disperse
    }

    /// What the scene was built from.
    pub fn description(&self) -> &Description {
        &self.description
    }

    /// What moves, over the exposure it was posed for.
    pub(crate) fn animated(&self) -> &AnimatedInstances {
        &self.posed.animated
    }

    /// Its lights.
    pub fn lights(&self) -> &Lights {
        &self.posed.lights
    }

    /// The box around everything in the world, m, as it is when the exposure begins; what hangs on free nodes is left out.
    pub fn bounds(&self) -> Bounds {
        self.built.top.bounds().union(self.posed.animated.opening_bounds())
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

    /// Bytes held: by meshes, curves and splats together, and by hierarchies.
    pub fn memory(&self) -> (usize, usize) {
        let meshes: usize = self.description.meshes.iter().map(|m| m.memory()).sum();
        let curves: usize = self.description.curves.iter().map(|c| c.memory()).sum();
        let splats: usize = self.description.splats.iter().map(|s| s.memory()).sum();
        let below =
            self.built.shared.iter().flatten().chain(self.built.strands.iter().map(|s| &s.bvh)).chain(self.built.clouds.iter());
        let below = below.map(Bvh::memory).sum::<usize>();
        (meshes + curves + splats, self.built.top.memory() + below + self.posed.animated.memory())
    }

    /// Material of an object, by its number, as hits tell it. Panics on a number that is no object's.
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
        self.built.filtering[object as usize].as_ref()
    }

    /// Whether pictures on surfaces are filtered where rays have a width ([`crate::radiance::RayCone`]).
    pub fn filters_pictures(&self) -> bool {
        self.built.filtering.iter().any(Option::is_some)
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
        self.built.has_straight_transmission
    }

    /// Whether something may hide a light from a straight ray and yet let some of its light through.
    pub(crate) fn lets_some_light_through(&self) -> bool {
        self.built.has_straight_transmission || self.built.has_blends
    }

    /// Whether there are clear bodies that bend light, and nothing moves.
    #[inline]
    pub(crate) fn has_clear_bodies(&self) -> bool {
        self.built.has_clear_bodies && self.posed.animated.is_empty()
    }

    /// Its flat mirrors; `None` where there are none, or something moves.
    #[inline]
    pub(crate) fn mirrors(&self) -> Option<&Mirrors> {
        Some(&self.built.mirrors).filter(|mirrors| !mirrors.is_empty() && self.posed.animated.is_empty())
    }

    /// Whether an object is a clear body that bends light.
    #[inline]
    pub(crate) fn is_clear_body(&self, object: u32) -> bool {
        self.built.is_clear_body[object as usize]
    }

    /// Whether light may go through an object where a straight ray meets it.
    #[inline]
    pub(crate) fn may_pass(&self, object: u32) -> bool {
        self.built.may_pass[object as usize]
    }

    /// Whether no medium scatters, shines, or differs from place to place.
    #[inline]
    pub fn media_only_absorb(&self) -> bool {
        self.built.media_only_absorb && self.air.is_none()
    }

    /// Whether surfaces of some bodies let rays through by chance.
    pub(crate) fn has_blends(&self) -> bool {
        self.built.has_blends
    }
}
