//! Shapes of the pupil over the film: which light there is that a view through a part of it can be made of.

use diopter_image::PupilShapes;
use glam::{DVec2, Vec2};

/// Convex shapes of the pupil at places of the film, as [`PupilShapes`] has them; between them they are interpolated.
#[derive(Clone, Debug)]
pub(super) struct Pupils {
    grid: Grid,
    directions: Vec<Vec2>,
    /// For each place as many as there are directions; below 0 in the dark.
    extents: Vec<Vec<f32>>,
}

/// Places on the film, row by row from its upper left corner to its lower right one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    counts: [usize; 2],
    /// Size of the film, mm.
    film_mm: DVec2,
}

impl Grid {
    /// A single place, the middle of the film.
    pub const MIDDLE: Grid = Grid { counts: [1, 1], film_mm: DVec2::ONE };

    /// All of them, mm from the middle of the film, to the right and down.
    pub fn places(&self) -> impl Iterator<Item = DVec2> {
        let Grid { counts, film_mm } = *self;
        let at = |i: usize, n: usize| if n > 1 { i as f64 / (n - 1) as f64 - 0.5 } else { 0.0 };
        (0..counts[0] * counts[1]).map(move |k| DVec2::new(at(k % counts[0], counts[0]), at(k / counts[0], counts[1])) * film_mm)
    }

    /// The four around a place on the film, and the fractions that they have in it.
    #[inline]
    pub fn around(&self, place: DVec2) -> [(usize, f32); 4] {
        let last = self.counts.map(|n| n - 1);
        let cell = ((place / self.film_mm + 0.5) * DVec2::new(last[0] as f64, last[1] as f64)).max(DVec2::ZERO);
        let [left, top] = [(cell.x as usize).min(last[0]), (cell.y as usize).min(last[1])];
        let [right, bottom] = [(left + 1).min(last[0]), (top + 1).min(last[1])];
        let (x, y) = ((cell.x - left as f64).min(1.0) as f32, (cell.y - top as f64).min(1.0) as f32);
        let number = |column: usize, row: usize| row * self.counts[0] + column;
        [
            (number(left, top), (1.0 - x) * (1.0 - y)),
            (number(right, top), x * (1.0 - y)),
            (number(left, bottom), (1.0 - x) * y),
            (number(right, bottom), x * y),
        ]
    }
}

impl Pupils {
    /// Shapes over a film of a size; `None` where they make no sense.
    pub fn new(shapes: &PupilShapes, film_mm: DVec2) -> Option<Pupils> {
        let PupilShapes { counts, extents } = shapes;
        let count = extents.iter().map(Vec::len).max()?;
        let fits = extents.iter().all(|e| (e.is_empty() || e.len() == count) && e.iter().all(|v| v.is_finite()));
        if counts.iter().any(|n| *n < 2) || counts[0].checked_mul(counts[1]) != Some(extents.len()) || count < 3 || !fits {
            return None;
        }
        let directions = (0..count).map(|k| Vec2::from_angle(std::f32::consts::TAU * k as f32 / count as f32)).collect();
        let single = |e: &Vec<f64>| if e.is_empty() { vec![-1.0; count] } else { e.iter().map(|v| *v as f32).collect() };
        let extents = extents.iter().map(single).collect();
        Some(Pupils { grid: Grid { counts: *counts, film_mm }, directions, extents })
    }

    /// The places.
    pub fn grid(&self) -> Grid {
        self.grid
    }

    /// How far a place q in the pupil lies from the edge of what a place on the film (mm from its middle, to the right and down) sees, inside above 0, in radii of the pupil.
    pub fn inside(&self, film: DVec2, q: Vec2) -> f32 {
        let around = self.grid.around(film);
        let extent = |k: usize| around.iter().map(|(place, fraction)| fraction * self.extents[*place][k]).sum::<f32>();
        let distances = self.directions.iter().enumerate().map(|(k, direction)| extent(k) - direction.dot(q));
        distances.fold(f32::MAX, f32::min)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disk, of which a straight edge takes more and more towards the right of the film, and which is dark below its middle.
    fn shapes() -> PupilShapes {
        const N: usize = 64;
        let cut = |at: f64| (0..N).map(|k| if k == 0 { 1.0 - at } else { 1.0 }).collect::<Vec<f64>>();
        let extents = vec![cut(0.0), cut(0.4), cut(0.8), cut(0.0), cut(0.4), cut(0.8), vec![], vec![], vec![]];
        PupilShapes { counts: [3, 3], extents }
    }

    #[test]
    fn shapes_are_interpolated_over_the_film() {
        let pupils = Pupils::new(&shapes(), DVec2::new(8.0, 4.0)).unwrap();
        for (film, q, inside) in [
            ([-4.0, -2.0], [0.0, 0.0], 1.0),
            ([-4.0, -2.0], [0.3, 0.4], 0.5),
            ([-2.0, -1.0], [0.7, 0.0], 0.1),
            ([4.0, 0.0], [0.7, 0.0], -0.5),
            // Beyond the film as at its edge.
            ([9.0, 0.0], [0.7, 0.0], -0.5),
            ([-4.0, 2.0], [0.0, 0.0], -1.0),
        ] {
            let found = pupils.inside(DVec2::from_array(film), Vec2::from_array(q));
            assert!((found - inside).abs() < 2e-3, "{film:?} {q:?}: {found}");
        }
        for (place, (around, number)) in
            pupils.grid().places().map(|p| (p, pupils.grid().around(p))).zip(0..).map(|((p, a), n)| (p, (a, n)))
        {
            let own: f32 = around.iter().filter(|(k, _)| *k == number).map(|(_, fraction)| fraction).sum();
            assert_eq!(own, 1.0, "{place}");
        }
    }

    #[test]
    fn what_makes_no_sense_is_refused() {
        let wrong = |change: &dyn Fn(&mut PupilShapes)| {
            let mut shapes = shapes();
            change(&mut shapes);
            Pupils::new(&shapes, DVec2::ONE).is_none()
        };
        assert!(!wrong(&|_| ()));
        assert!(wrong(&|s| s.counts = [3, 4]));
        assert!(wrong(&|s| s.counts = [9, 1]));
        assert!(wrong(&|s| s.counts = [usize::MAX, 2]));
        assert!(wrong(&|s| s.extents[4].truncate(5)));
        assert!(wrong(&|s| s.extents[0][3] = f64::NAN));
        assert!(wrong(&|s| s.extents.iter_mut().for_each(Vec::clear)));
    }
}
