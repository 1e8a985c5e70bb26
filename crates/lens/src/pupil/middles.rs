//! The middle of what passes, from any point of the film, without steps: the directions of chief rays.
//!
//! Regions of the table hold the shapes at their ends, so that their own middles jump from one to the next. Here the centroids of the shapes themselves are kept, at the corners of the table, and
//! between them go cubics through the neighbours (Catmull and Rom 1974), so that what stands on chief rays (calibrations, ST maps, flow) is as smooth as the lens.

use glam::DVec2;

/// What lies before the first and behind the last corner along an axis of the grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Edge {
    /// The axis of the lens is the first corner: what lies before it is behind it, mirrored. `[1, -1]`: only the second component keeps its sign.
    Mirrored([i8; 2]),
    /// It goes on evenly.
    Open,
    /// The last corner is the first one again.
    Periodic,
}

/// Middles at the corners of a grid over the film.
#[derive(Clone, Debug)]
pub(super) struct Middles {
    /// None where nothing passes.
    corners: Vec<Option<DVec2>>,
    counts: [usize; 2],
    edges: [Edge; 2],
}

impl Middles {
    /// Of corners, one line of `counts[0]` after the other.
    pub(super) fn new(corners: Vec<Option<DVec2>>, counts: [usize; 2], edges: [Edge; 2]) -> Middles {
        debug_assert_eq!(corners.len(), counts[0] * counts[1]);
        Middles { corners, counts, edges }
    }

    /// All of them times a number.
    pub(super) fn scaled(&self, scale: f64) -> Middles {
        Middles { corners: self.corners.iter().map(|c| c.map(|c| c * scale)).collect(), ..self.clone() }
    }

    /// The middle at a place, in steps of the grid from its first corner; `None` where nothing passes at any corner around it.
    pub(super) fn at(&self, place: DVec2) -> Option<DVec2> {
        let last = self.counts.map(|n| n.saturating_sub(2) as f64);
        let first = place.floor().clamp(DVec2::ZERO, DVec2::from_array(last));
        let t = (place - first).clamp(DVec2::ZERO, DVec2::ONE);
        let [i, j] = [first.x as isize, first.y as isize];
        let line = |j: isize| cubic(&|k| self.corner([i + k, j]), t.x);
        if self.counts[1] == 1 { line(0) } else { cubic(&|k| line(j + k), t.y) }
    }

    /// The middle at a corner; beyond the grid as its edges say.
    fn corner(&self, at: [isize; 2]) -> Option<DVec2> {
        for axis in 0..2 {
            let last = self.counts[axis] as isize - 1;
            let with = |k: isize| if axis == 0 { [k, at[1]] } else { [at[0], k] };
            let evenly = |edge: isize, next: isize| {
                let edge = self.corner(with(edge))?;
                Some(self.corner(with(next)).map_or(edge, |next| 2.0 * edge - next))
            };
            match (self.edges[axis], at[axis]) {
                (_, k) if (0..=last).contains(&k) => {}
                (Edge::Periodic, k) => return self.corner(with(k.rem_euclid(last))),
                (Edge::Mirrored([x, y]), k) if k < 0 => {
                    return self.corner(with(-k)).map(|c| c * DVec2::new(f64::from(x), f64::from(y)));
                }
                (_, k) if k < 0 => return evenly(0, 1),
                _ => return evenly(last, last - 1),
            }
        }
        self.corners[at[1] as usize * self.counts[0] + at[0] as usize]
    }
}

/// Between values at 0 and 1, with those at −1 and 2 beside them; where one of the outer ones is missing the way goes on evenly, where one of the inner ones is, the other counts.
fn cubic(at: &dyn Fn(isize) -> Option<DVec2>, t: f64) -> Option<DVec2> {
    let (b, c) = match (at(0), at(1)) {
        (Some(b), Some(c)) => (b, c),
        (one, other) => return one.or(other),
    };
    let a = at(-1).unwrap_or(2.0 * b - c);
    let d = at(2).unwrap_or(2.0 * c - b);
    let (from, to) = (0.5 * (c - a), 0.5 * (d - b));
    let (t2, t3) = (t * t, t * t * t);
    Some(b * (2.0 * t3 - 3.0 * t2 + 1.0) + from * (t3 - 2.0 * t2 + t) + c * (3.0 * t2 - 2.0 * t3) + to * (t3 - t2))
}

/// Centroid of the area of a polygon; `None` of fewer than three corners or no area.
pub(super) fn centroid(polygon: &[DVec2]) -> Option<DVec2> {
    let origin = *polygon.first()?;
    let (mut sum, mut area) = (DVec2::ZERO, 0.0);
    for pair in polygon.windows(2) {
        let (a, b) = (pair[0] - origin, pair[1] - origin);
        let twice = a.perp_dot(b);
        sum += (a + b) * twice;
        area += twice;
    }
    (area.abs() > 1e-24).then(|| origin + sum / (3.0 * area))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn centroids_are_those_of_the_area_however_many_corners_an_edge_has() {
        let triangle = [[0.0, 0.0], [3.0, 0.0], [1.0, 0.0], [0.0, 3.0]].map(DVec2::from_array);
        let corners = [triangle[0], triangle[2], triangle[1], triangle[3]];
        assert!((centroid(&corners).unwrap() - DVec2::ONE).length() < 1e-12);
        assert_eq!(centroid(&corners[..2]), None);
    }

    #[test]
    fn planes_and_periods_are_kept() {
        let plane = |x: f64, y: f64| DVec2::new(2.0 * x - y + 1.0, x + 3.0 * y);
        let corners = (0..20).map(|k| Some(plane((k % 5) as f64, (k / 5) as f64))).collect();
        let middles = Middles::new(corners, [5, 4], [Edge::Open, Edge::Open]);
        for (x, y) in [(0.0, 0.0), (0.3, 2.9), (4.0, 3.0), (3.7, 0.1), (2.0, 1.5)] {
            assert!((middles.at(DVec2::new(x, y)).unwrap() - plane(x, y)).length() < 1e-12, "{x} {y}");
        }
        let turning = (0..33).map(|k| Some(DVec2::from_angle(f64::from(k) / 32.0 * std::f64::consts::TAU))).collect();
        let middles = Middles::new(turning, [33, 1], [Edge::Periodic, Edge::Open]);
        for x in [0.0, 0.5, 31.5, 32.0] {
            let expected = DVec2::from_angle(x / 32.0 * std::f64::consts::TAU);
            assert!((middles.at(DVec2::new(x, 0.0)).unwrap() - expected).length() < 1e-4, "{x}");
        }
    }

    #[test]
    fn the_axis_is_passed_smoothly_and_the_dark_is_left_out() {
        let odd = |x: f64| DVec2::new(x * (1.0 + 0.01 * x * x), 0.0);
        let mut corners: Vec<_> = (0..6).map(|k| Some(odd(f64::from(k)))).collect();
        corners[5] = None;
        let middles = Middles::new(corners, [6, 1], [Edge::Mirrored([-1, -1]), Edge::Open]);
        assert!((middles.at(DVec2::new(0.5, 0.0)).unwrap() - odd(0.5)).length() < 5e-3);
        assert_eq!(middles.at(DVec2::new(4.9, 0.0)), Some(odd(4.0)));
        assert_eq!(Middles::new(vec![None; 4], [4, 1], [Edge::Open; 2]).at(DVec2::ZERO), None);
    }
}
