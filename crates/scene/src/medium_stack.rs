//! Which bodies a path is in: what fills them, and which of them counts where several overlap.
//!
//! Bodies with a priority may overlap or touch: where they do, the strongest is there, the faces of weaker ones within it are not, and light
//! is bent by the ratio of the indices on both sides. Source: C. Schmidt, B. Budge 2002, "Simple Nested Dielectrics in Ray Traced Images".
//! A body without a priority is bent against vacuum, and counts from where it is entered to where it is left.
//!
//! Bodies and media are known by the numbers of their materials, so that many paths can be kept without borrowing from the scene.

use crate::material::{Interior, Material, Principled, Scattering};
use crate::medium::Medium;
use crate::scene::Scene;
use crate::shape::{offset_origin, reach_of};
use diopter_light::Ray;
use glam::Vec3;

/// Bodies within bodies that are kept track of.
const MOST: usize = 8;

/// Most faces that are looked at between the outside and a place.
const MOST_FACES: u32 = 4096;

/// Which bodies a camera stands in: fog in a box, water, glass.
#[derive(Clone, Copy, Debug, Default)]
pub struct Immersion(pub(crate) MediumStack);

impl Immersion {
    /// None.
    pub const NONE: Immersion = Immersion(MediumStack { said: None, bodies: [0; MOST], count: 0 });
}

/// Where a path is; at first in the air around all bodies.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct MediumStack {
    /// What a face between two media said last; nothing until then.
    said: Option<Side>,
    /// Numbers of the materials of the bodies, in the order in which they were entered.
    bodies: [u32; MOST],
    count: u32,
}

/// A side of a face between two media.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Side {
    material: u32,
    is_inside: bool,
}

/// A medium of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MediumId {
    /// What fills the world around its bodies.
    Air,
    /// What fills bodies of a material, by its number.
    Body(u32),
    /// What is on a side of a face.
    Side(Side),
}

impl Scene {
    /// A medium by its name; `None` for a vacuum.
    #[inline]
    pub(crate) fn medium(&self, id: MediumId) -> Option<&Medium> {
        match id {
            MediumId::Air => self.air().map(|air| &air.medium),
            MediumId::Body(material) => match &self.material_at(material).interior {
                Interior::Body { medium, .. } => medium.as_deref(),
                _ => None,
            },
            MediumId::Side(side) => match &self.material_at(side.material).interior {
                Interior::Sides(sides) => sides[usize::from(!side.is_inside)].as_deref(),
                _ => None,
            },
        }
    }
}

impl Scene {
    /// The bodies at a point (m): those that straight ways to it from six sides enter and do not leave. None where these say different things, as beside sheets that bound nothing.
    pub fn immersion_at(&self, point: Vec3) -> Immersion {
        let bounds = self.bounds();
        let around = (bounds.center(), 0.5 * bounds.size().length() * 1.001);
        let has_bodies = self.description().materials.iter().any(|m| !matches!(m.interior, Interior::Same));
        if !has_bodies || !around.0.is_finite() || !around.1.is_finite() {
            return Immersion::NONE;
        }
        // Not along axes, on which edges and corners often lie.
        let towards = [Vec3::new(0.03, 1.0, 0.05), Vec3::new(1.0, 0.05, 0.03), Vec3::new(0.05, 0.03, 1.0)].map(Vec3::normalize);
        let all = [1.0, -1.0].map(|side: f32| towards.map(|normal| MediumStack::at(self, point, normal * side, around)));
        let first = all[0][0];
        let agrees = |other: &MediumStack| other.count == first.count && other.medium(self) == first.medium(self);
        if all.as_flattened().iter().all(agrees) { Immersion(first) } else { Immersion::NONE }
    }
}

impl MediumStack {
    /// Where a point is: in what is entered and not left on a straight line from outside everything, which is within a radius about a middle (m), to the side of the point that `normal` shows.
    pub fn at(scene: &Scene, point: Vec3, normal: Vec3, (middle, radius): (Vec3, f32)) -> MediumStack {
        let mut medium_stack = MediumStack::default();
        let end = offset_origin(point, normal, reach_of([middle]) + radius);
        let direction = -normal;
        let mut origin = end + normal * ((middle - end).dot(normal).max(0.0) + 2.0 * radius);
        for _ in 0..MOST_FACES {
            let left = (end - origin).dot(direction);
            if left <= 0.0 {
                break;
            }
            let Some(face) = scene.intersect(&Ray { origin, direction, time_s: 0.0 }, left) else { break };
            let entering = face.ng.dot(direction) < 0.0;
            medium_stack.cross(scene, face.object, entering);
            origin = face.beside(if entering { -face.ng } else { face.ng });
        }
        medium_stack
    }

    fn bodies(&self) -> &[u32] {
        &self.bodies[..self.count as usize]
    }

    /// The body that counts: of those with the highest priority the one that was entered last.
    fn strongest(&self, scene: &Scene) -> Option<u32> {
        let priority = |material: u32| priority(scene.material_at(material));
        self.bodies().iter().copied().reduce(|best, b| if priority(b) >= priority(best) { b } else { best })
    }

    /// What fills the place.
    #[inline]
    pub fn medium(&self, scene: &Scene) -> MediumId {
        match (self.strongest(scene), self.said) {
            (Some(body), _) => MediumId::Body(body),
            (None, Some(side)) => MediumId::Side(side),
            (None, None) => MediumId::Air,
        }
    }

    /// Whether it is in no body, and no face has said what is around.
    #[inline]
    pub fn is_outside(&self) -> bool {
        self.count == 0 && self.said.is_none()
    }

    /// Whether it is in a body.
    #[inline]
    pub fn is_in_body(&self) -> bool {
        self.count > 0
    }

    /// The medium along a ray up to a distance, and the part of it in which it is.
    #[inline]
    pub fn span<'a>(&self, scene: &'a Scene, ray: &Ray, reach: f32) -> Option<(&'a Medium, [f32; 2])> {
        match self.medium(scene) {
            MediumId::Air => scene.air().and_then(|air| Some((&air.medium, air.span(ray, reach)?))),
            id => Some((scene.medium(id)?, [0.0, reach])),
        }
    }

    /// Whether a face of an object is not there: because a stronger body is, or because the same matter is on both sides, where bodies of one material
    /// overlap.
    pub fn hides(&self, scene: &Scene, object: u32, entering: bool) -> bool {
        let material = scene.material_number(object);
        let Some(own) = priority(scene.material_at(material)) else { return false };
        let held = self.bodies().iter().filter(|b| **b == material).count();
        match entering {
            true => held > 0 || self.bodies().iter().any(|b| priority(scene.material_at(*b)) > Some(own)),
            false => held > 1 || (held == 1 && self.strongest(scene).is_some_and(|b| b != material)),
        }
    }

    /// The dielectric on the outer side of an object's face, where both have priorities.
    pub fn around<'a>(&self, scene: &'a Scene, object: u32) -> Option<&'a Principled> {
        let material = scene.material_number(object);
        priority(scene.material_at(material))?;
        let outer = self.bodies().iter().filter(|b| **b != material).map(|b| scene.material_at(*b));
        let outer = outer.filter(|b| priority(b).is_some());
        let outer = outer.reduce(|best, b| if priority(b) >= priority(best) { b } else { best })?;
        match &outer.scattering {
            Scattering::Principled(p) => Some(p),
            _ => None,
        }
    }

    /// Goes through a face of an object.
    #[inline]
    pub fn cross(&mut self, scene: &Scene, object: u32, entering: bool) {
        let material = scene.material_number(object);
        match scene.material_at(material).interior {
            Interior::Same => {}
            Interior::Sides(_) => self.said = Some(Side { material, is_inside: entering }),
            Interior::Body { .. } if entering => {
                if let Some(next) = self.bodies.get_mut(self.count as usize) {
                    *next = material;
                    self.count += 1;
                }
            }
            Interior::Body { .. } => {
                if let Some(i) = self.bodies().iter().rposition(|b| *b == material) {
                    self.bodies.copy_within(i + 1..self.count as usize, i);
                    self.count -= 1;
                }
            }
        }
    }
}

fn priority(material: &Material) -> Option<i32> {
    match material.interior {
        Interior::Body { priority, .. } => priority,
        _ => None,
    }
}
