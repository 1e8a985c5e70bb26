//! Surfaces and gaps that light passes more than once: a prescription lists each pass, the glass has one of them, with one error.

use crate::prescription::Prescription;
use crate::system::{State, System};

/// Distance up to which two passes are at one place, mm.
const SAME_PLACE_MM: f64 = 1e-6;

/// Which surface of a prescription is the first pass through the same face, and which gap the first through the same thickness.
pub(super) struct Passes {
    faces: Vec<usize>,
    gaps: Vec<usize>,
}

impl Passes {
    /// By place and shape: two surfaces with a mirror between them that stand in one place, alike in shape, are one face.
    pub fn of(p: &Prescription) -> Passes {
        let count = p.surfaces.len();
        if !p.surfaces.iter().any(|s| s.mirror) {
            return Passes { faces: (0..count).collect(), gaps: (0..count).collect() };
        }
        let system = System::at(p, State::default());
        let is_same = |i: usize, k: usize| {
            let (a, b) = (&p.surfaces[i], &p.surfaces[k]);
            (system.surfaces[i].z - system.surfaces[k].z).abs() < SAME_PLACE_MM
                && a.profile == b.profile
                && (a.decenter, a.tilt, a.mirror) == (b.decenter, b.tilt, b.mirror)
                && p.surfaces[i..=k].iter().any(|s| s.mirror)
        };
        let faces: Vec<usize> = (0..count).map(|k| (0..k).find(|i| is_same(*i, k)).unwrap_or(k)).collect();
        // A gap lies between two faces, whichever way it is passed.
        let between = |gap: usize| faces.get(gap + 1).map(|next| (faces[gap].min(*next), faces[gap].max(*next)));
        let gaps = (0..count).map(|k| (0..k).find(|i| between(k).is_some() && between(*i) == between(k)).unwrap_or(k)).collect();
        Passes { faces, gaps }
    }

    /// Whether it is the first pass through its face.
    pub fn is_first_of_face(&self, surface: usize) -> bool {
        self.faces[surface] == surface
    }

    /// The first pass through the face of a surface.
    pub fn face(&self, surface: usize) -> usize {
        self.faces[surface]
    }

    /// The first pass through the thickness of a gap.
    pub fn gap(&self, gap: usize) -> usize {
        self.gaps[gap]
    }

    /// Whether it is the first pass through its thickness.
    pub fn is_first_of_gap(&self, gap: usize) -> bool {
        self.gaps[gap] == gap
    }

    /// All passes through the face of a surface, whichever of them is asked for.
    pub fn of_face(&self, surface: usize) -> impl Iterator<Item = usize> {
        let first = self.faces[surface];
        self.faces.iter().enumerate().filter(move |(_, face)| **face == first).map(|(k, _)| k)
    }

    /// All passes through the thickness of a gap, whichever of them is asked for.
    pub fn of_gap(&self, gap: usize) -> impl Iterator<Item = usize> {
        let first = self.gaps[gap];
        self.gaps.iter().enumerate().filter(move |(_, gap)| **gap == first).map(|(k, _)| k)
    }

    /// The least element that holds all passes through the faces of one, first and last surface.
    pub fn whole(&self, [first, last]: [usize; 2]) -> [usize; 2] {
        (first..=last).flat_map(|i| self.of_face(i)).fold([first, last], |[a, b], k| [a.min(k), b.max(k)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::embedded;

    #[test]
    fn a_mangin_mirror_has_one_front_and_one_thickness() {
        let passes = Passes::of(&embedded("reflex-500mm-f8").unwrap());
        // Surfaces 5 and 7, 8 and 10 as the patent counts; the gaps behind 5 and 6, 8 and 9.
        let later = |first: &dyn Fn(usize) -> bool| (0..16).filter(|i| !first(*i)).collect::<Vec<_>>();
        assert_eq!(later(&|i| passes.is_first_of_face(i)), [6, 9]);
        assert_eq!(later(&|i| passes.is_first_of_gap(i)), [5, 8]);
        assert_eq!(passes.of_face(4).collect::<Vec<_>>(), [4, 6]);
        assert_eq!(passes.of_gap(7).collect::<Vec<_>>(), [7, 8]);
        assert_eq!(passes.of_gap(8).collect::<Vec<_>>(), [7, 8]);
        assert_eq!((passes.whole([4, 5]), passes.whole([4, 6]), passes.whole([2, 3])), ([4, 6], [4, 6], [2, 3]));
    }

    #[test]
    fn a_lens_that_light_passes_once_has_no_second_pass() {
        let passes = Passes::of(&embedded("double-gauss-50mm").unwrap());
        assert!((0..11).all(|i| passes.is_first_of_face(i) && passes.is_first_of_gap(i)));
    }
}
