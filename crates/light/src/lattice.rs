//! Points of the plane at equal distances, in squares or hexagons.

use glam::DVec2;

/// How the points are laid out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Arrangement {
    /// Rows and columns.
    #[default]
    Square,
    /// Rows, each second one shifted by half a pitch.
    Hexagonal,
}

impl Arrangement {
    /// Names and what they mean.
    pub const NAMES: [(&str, Arrangement); 2] = [("square", Arrangement::Square), ("hexagonal", Arrangement::Hexagonal)];

    /// By name, one of [`Arrangement::NAMES`]; `None` for another.
    pub fn named(name: &str) -> Option<Arrangement> {
        Self::NAMES.into_iter().find(|n| n.0 == name).map(|n| n.1)
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::NAMES.into_iter().find(|n| n.1 == self).map_or("", |n| n.0)
    }
}

/// A lattice of points: the middles of lenses, or of their images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    /// Layout.
    pub arrangement: Arrangement,
    /// Distance of neighbours.
    pub pitch: f64,
    /// One of the points.
    pub origin: DVec2,
}

impl Lattice {
    /// Distance of rows, in the unit of the pitch.
    pub fn row_pitch(&self) -> f64 {
        match self.arrangement {
            Arrangement::Square => self.pitch,
            Arrangement::Hexagonal => self.pitch * 0.75f64.sqrt(),
        }
    }

    /// Area of the cell around a point, in the square of the unit of the pitch.
    pub fn cell_area(&self) -> f64 {
        self.pitch * self.row_pitch()
    }

    /// Farthest that a place of a cell lies from its middle, in the unit of the pitch.
    pub fn cell_radius(&self) -> f64 {
        match self.arrangement {
            Arrangement::Square => self.pitch * 0.5f64.sqrt(),
            Arrangement::Hexagonal => self.pitch / 3f64.sqrt(),
        }
    }

    /// Centre of the cell of a column and row, in the units of the pitch: to the right and down, where that of column 0 in row 0 is the origin of the lattice.
    pub fn point(&self, column: i64, row: i64) -> DVec2 {
        let shift = match self.arrangement {
            Arrangement::Hexagonal if row.rem_euclid(2) == 1 => 0.5,
            _ => 0.0,
        };
        self.origin + DVec2::new((column as f64 + shift) * self.pitch, row as f64 * self.row_pitch())
    }

    /// Points of a row from one place across to another.
    fn columns(&self, row: i64, from: f64, to: f64) -> impl Iterator<Item = DVec2> + use<> {
        let (lattice, first) = (*self, self.point(0, row).x);
        let column = |x: f64| (x - first) / lattice.pitch;
        (column(from).ceil() as i64..=column(to).floor() as i64).map(move |i| lattice.point(i, row))
    }

    /// All points not farther than `reach` from a place (both in the unit of the pitch), row by row.
    pub fn within(&self, at: DVec2, reach: f64) -> impl Iterator<Item = DVec2> + use<> {
        let (lattice, rows) = (*self, self.row_pitch());
        let row = |y: f64| (y - lattice.origin.y) / rows;
        (row(at.y - reach).ceil() as i64..=row(at.y + reach).floor() as i64)
            .flat_map(move |j| lattice.columns(j, at.x - reach, at.x + reach))
            .filter(move |p| p.distance_squared(at) <= reach * reach)
    }

    /// The nearest point.
    pub fn nearest(&self, at: DVec2) -> DVec2 {
        let row = (at.y - self.origin.y) / self.row_pitch();
        let in_row = |row: f64| {
            let first = self.point(0, row as i64);
            first + DVec2::X * (((at.x - first.x) / self.pitch).round() * self.pitch)
        };
        match self.arrangement {
            Arrangement::Square => in_row(row.round()),
            Arrangement::Hexagonal => {
                let (a, b) = (in_row(row.floor()), in_row(row.floor() + 1.0));
                if a.distance_squared(at) <= b.distance_squared(at) { a } else { b }
            }
        }
    }

    /// A place of the cell around a point, by two uniform numbers in [0, 1); uniform over its area.
    pub fn place_in_cell(&self, point: DVec2, [u, v]: [f32; 2]) -> DVec2 {
        // A box of a pitch and a row holds each place of a cell once, some of them as a neighbour's.
        let at = point + DVec2::new((u as f64 - 0.5) * self.pitch, (v as f64 - 0.5) * self.row_pitch());
        point + (at - self.nearest(at))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_place_belongs_to_its_nearest_point() {
        for arrangement in [Arrangement::Square, Arrangement::Hexagonal] {
            let l = Lattice { arrangement, pitch: 0.3, origin: DVec2::new(0.1, 0.05) };
            for i in 1..500 {
                let [u, v] = [0.754_877_666, 0.569_840_291].map(|a: f64| (0.001 + 0.998 * (a * i as f64).fract()) as f32);
                let at = DVec2::new(u as f64 * 5.0 - 2.0, v as f64 * 4.0 - 3.0);
                let found = l.nearest(at);
                let all = l.within(at, 2.0 * l.pitch);
                let best = all.min_by(|a, b| a.distance(at).total_cmp(&b.distance(at))).unwrap();
                assert!(found.distance(best) < 1e-9, "{at} {found} {best}");
                assert!(at.distance(found) <= l.cell_radius() + 1e-12);
                let inside = l.place_in_cell(found, [u, v]);
                assert!(l.nearest(inside).distance(found) < 1e-9);
            }
            // Points about a place are as many as their cells fill it.
            let count = l.within(DVec2::new(0.1, 0.2), 5.0).count() as f64;
            assert!((count * l.cell_area() / (25.0 * std::f64::consts::PI) - 1.0).abs() < 0.02, "{count}");
        }
    }
}
