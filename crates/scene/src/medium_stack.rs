//! Which bodies a path is in: what fills them, and which of them counts where several overlap.
//!
//! Bodies with a priority may overlap or touch: where they do, the strongest is there, the faces of weaker ones within it are not, and light
//! is bent by the ratio of the indices on both sides. Source: C. Schmidt, B. Budge 2002, "Simple Nested Dielectrics in Ray Traced Images".
//! A body without a priority is bent against vacuum, and counts from where it is entered to where it is left.

use crate::material::{Interior, Material, Principled, Scattering};
use crate::medium::{Air, Medium};
use diopter_light::Ray;

/// Bodies within bodies that are kept track of.
const MOST: usize = 8;

/// Where a path is.
#[derive(Clone, Copy)]
pub(crate) struct MediumStack<'a> {
    air: Option<&'a Air>,
    /// What a face between two media said last; nothing until then.
    said: Option<Option<&'a Medium>>,
    bodies: [Option<&'a Material>; MOST],
    count: usize,
}

impl<'a> MediumStack<'a> {
    pub fn new(air: Option<&'a Air>) -> Self {
        MediumStack { air, said: None, bodies: [None; MOST], count: 0 }
    }

    fn bodies(&self) -> impl DoubleEndedIterator<Item = &'a Material> + '_ {
        self.bodies[..self.count].iter().filter_map(|b| *b)
    }

    /// The body that counts: of those with the highest priority the one that was entered last.
    fn strongest(&self) -> Option<&'a Material> {
        self.bodies().reduce(|best, b| if priority(b) >= priority(best) { b } else { best })
    }

    /// The medium along a ray up to a distance, and the part of it in which it is.
    #[inline]
    pub fn span(&self, ray: &Ray, reach: f32) -> Option<(&'a Medium, [f32; 2])> {
        if let Some(body) = self.strongest() {
            let Interior::Body { medium, .. } = &body.interior else { return None };
            return Some((medium.as_deref()?, [0.0, reach]));
        }
        match self.said {
            Some(medium) => Some((medium?, [0.0, reach])),
            None => self.air.and_then(|air| Some((&air.medium, air.span(ray, reach)?))),
        }
    }

    /// Whether a face is not there: because a stronger body is, or because the same matter is on both sides, where bodies of one material
    /// overlap.
    pub fn hides(&self, material: &Material, entering: bool) -> bool {
        let Some(own) = priority(material) else { return false };
        let held = self.bodies().filter(|b| std::ptr::eq(*b, material)).count();
        match entering {
            true => held > 0 || self.bodies().any(|b| priority(b) > Some(own)),
            false => held > 1 || (held == 1 && self.strongest().is_some_and(|b| !std::ptr::eq(b, material))),
        }
    }

    /// The dielectric on the outer side of a body's face, where both have priorities.
    pub fn around(&self, material: &Material) -> Option<&'a Principled> {
        priority(material)?;
        let outer = self.bodies().filter(|b| priority(b).is_some() && !std::ptr::eq(*b, material));
        let outer = outer.reduce(|best, b| if priority(b) >= priority(best) { b } else { best })?;
        match &outer.scattering {
            Scattering::Principled(p) => Some(p),
            _ => None,
        }
    }

    /// Goes through a face.
    #[inline]
    pub fn cross(&mut self, material: &'a Material, entering: bool) {
        match &material.interior {
            Interior::Same => {}
            Interior::Sides(sides) => self.said = Some(sides[usize::from(!entering)].as_deref()),
            Interior::Body { .. } if entering => {
                if self.count < MOST {
                    self.bodies[self.count] = Some(material);
                    self.count += 1;
                }
            }
            Interior::Body { .. } => {
                let found = (0..self.count).rev().find(|i| self.bodies[*i].is_some_and(|b| std::ptr::eq(b, material)));
                if let Some(i) = found {
                    self.bodies.copy_within(i + 1..self.count, i);
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
