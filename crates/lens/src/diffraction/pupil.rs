//! Exit pupils as pupil functions on even grids: of an iris alone, and traced through a lens from a film point.

use super::pattern::ACROSS;
use crate::Iris;
use crate::batch::single::{Batch, Indices, LANES, Packet};
use crate::compound::{CompoundLens, REFERENCE_NM};
use crate::pupil;
use crate::ray::TraceDirection;
use glam::DVec2;

/// Parts, each way, in which a cell on the edge of a pupil is looked at.
const PARTS: usize = 4;
/// Room around an aperture, of its half width: its edge must not touch that of the square.
const ROOM: f64 = 1.02;

/// Amplitudes on a grid of cells over a square.
#[derive(Clone, Debug)]
pub(super) struct PupilGrid {
    /// From 0 to 1, rows from the lowest y.
    pub amplitude: Vec<f64>,
    /// Middle of the square.
    pub center: DVec2,
    /// Its side.
    pub side: f64,
}

/// What a pupil looks like whatever its size: two shapes that agree in it have the same pattern at their own scale.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape([f64; 9]);

impl PupilGrid {
    /// Of an iris, in units of the radius of the disk of equal area.
    pub(super) fn of_iris(iris: &Iris) -> PupilGrid {
        // A picture fills the square.
        let half = match iris {
            Iris::Image(_) => 1.0,
            other => ROOM * other.reach(),
        };
        let mut fractions =
            |points: &[DVec2]| points.iter().map(|p| f64::from(iris.transmittance(p.x, p.y))).collect::<Vec<f64>>();
        PupilGrid::sampled(DVec2::ZERO, 2.0 * half, matches!(iris, Iris::Image(_)), &mut fractions)
    }

    /// As a film point (mm) sees it, over slopes plus the film point over the distance of the exit pupil ([`crate::pupil`]), in film axes; `None` where no light
    /// comes through.
    /// What glass and surfaces take lowers the amplitude.
    pub(super) fn traced(lens: &CompoundLens, batch: &Batch, film: DVec2) -> Option<PupilGrid> {
        let (region, turn) = lens.pupils().region(film);
        if region.fan.area() <= 0.0 {
            return None;
        }
        let shift = film * lens.pupils().curvature;
        let outline = region.fan.outline().iter().map(|p| lens.pupils().slope(film, *p, turn) + shift);
        let (low, high) = outline.fold((DVec2::MAX, DVec2::MIN), |(l, h), p| (l.min(p), h.max(p)));
        let system = lens.system();
        let mut n = Indices::default();
        let nm = [REFERENCE_NM as f32; LANES];
        batch.indices(&nm, &mut n);
        let mut packet = Packet::default();
        let mut fractions = |points: &[DVec2]| {
            let mut fractions = Vec::with_capacity(points.len());
            for chunk in points.chunks(LANES) {
                for lane in 0..LANES {
                    let slope = chunk[lane.min(chunk.len() - 1)] - shift;
                    pupil::start(&mut packet, lane, film, system.film_z, system.film_direction(slope));
                }
                let mask = batch.trace_light(&mut packet, &n, &nm, TraceDirection::ToObject);
                let fraction = |lane: usize| if mask >> lane & 1 == 1 { f64::from(packet.fraction[lane]) } else { 0.0 };
                fractions.extend((0..chunk.len()).map(fraction));
            }
            fractions
        };
        let picture = matches!(system.iris.shape, Iris::Image(_));
        let grid = PupilGrid::sampled(0.5 * (low + high), ROOM * (high - low).max_element(), picture, &mut fractions);
        grid.amplitude.iter().any(|a| *a > 0.0).then_some(grid)
    }

    /// Samples the fraction of the light that passes at each cell; on edges (or, of a picture, everywhere) at the middles of its parts. The amplitude of a
    /// cell is the mean of those of its parts.
    fn sampled(center: DVec2, side: f64, all_parts: bool, fractions: &mut dyn FnMut(&[DVec2]) -> Vec<f64>) -> PupilGrid {
        let corner = center - 0.5 * side;
        let step = side / ACROSS as f64;
        let at = |i: usize, within: DVec2| corner + (DVec2::new((i % ACROSS) as f64, (i / ACROSS) as f64) + within) * step;
        let middles: Vec<DVec2> = (0..ACROSS * ACROSS).map(|i| at(i, DVec2::splat(0.5))).collect();
        let mut amplitude: Vec<f64> = fractions(&middles).into_iter().map(f64::sqrt).collect();
        let lit = |row: usize, column: usize| row < ACROSS && column < ACROSS && amplitude[row * ACROSS + column] > 0.0;
        let on_edge = |i: &usize| {
            let (row, column) = (i / ACROSS, i % ACROSS);
            // Before 0 indices wrap to numbers beyond the last.
            let around = |v: usize| [v.wrapping_sub(1), v, v + 1];
            around(row).into_iter().any(|r| around(column).into_iter().any(|c| lit(r, c) != lit(row, column)))
        };
        let edges: Vec<usize> = (0..ACROSS * ACROSS).filter(|i| all_parts || on_edge(i)).collect();
        let part = |k: usize| DVec2::new((k % PARTS) as f64 + 0.5, (k / PARTS) as f64 + 0.5) / PARTS as f64;
        for some in edges.chunks(1024) {
            let points: Vec<DVec2> = some.iter().flat_map(|i| (0..PARTS * PARTS).map(|k| at(*i, part(k)))).collect();
            let found = fractions(&points);
            for (i, parts) in some.iter().zip(found.chunks_exact(PARTS * PARTS)) {
                amplitude[*i] = parts.iter().map(|s| s.sqrt()).sum::<f64>() / parts.len() as f64;
            }
        }
        let largest = amplitude.iter().copied().fold(0.0, f64::max);
        if largest > 0.0 {
            amplitude.iter_mut().for_each(|a| *a /= largest);
        }
        PupilGrid { amplitude, center, side }
    }

    /// Middles of the cells.
    pub(super) fn places(&self) -> impl Iterator<Item = DVec2> {
        let (corner, step) = (self.center - 0.5 * self.side, self.side / ACROSS as f64);
        (0..ACROSS * ACROSS).map(move |i| corner + (DVec2::new((i % ACROSS) as f64, (i / ACROSS) as f64) + 0.5) * step)
    }

    /// Whether light passes a place, −1 to 1 across the square.
    pub(super) fn is_lit(&self, at: DVec2) -> bool {
        let cell = ((at * 0.5 + 0.5) * ACROSS as f64).floor().clamp(DVec2::ZERO, DVec2::splat(ACROSS as f64 - 1.0));
        self.amplitude[cell.y as usize * ACROSS + cell.x as usize] > 0.0
    }

    /// Sum of the amplitudes over the square's cells: the area of a clear aperture, in units of the square.
    pub(super) fn filled(&self) -> f64 {
        self.amplitude.iter().sum::<f64>() / (ACROSS * ACROSS) as f64
    }

    /// Moments of second to fourth order about the middle of its light, in units of the root of its area.
    pub(super) fn shape(&self) -> Shape {
        let unit = |i: usize| DVec2::new((i % ACROSS) as f64, (i / ACROSS) as f64) / ACROSS as f64;
        let light = self.filled() * (ACROSS * ACROSS) as f64;
        let middle = self.amplitude.iter().enumerate().map(|(i, a)| *a * unit(i)).sum::<DVec2>() / light;
        let scale = self.filled().sqrt().recip();
        let mut moments = [0.0; 9];
        for (i, a) in self.amplitude.iter().enumerate().filter(|(_, a)| **a > 0.0) {
            let DVec2 { x, y } = (unit(i) - middle) * scale;
            let terms = [x * x, x * y, y * y, x * x * x, x * x * y, x * y * y, y * y * y, x.powi(4) + y.powi(4), x * x * y * y];
            moments.iter_mut().zip(terms).for_each(|(m, t)| *m += a * t / light);
        }
        Shape(moments)
    }
}

impl Shape {
    /// Whether two shapes agree to about a hundredth of their width.
    pub(super) fn agrees(&self, other: &Shape) -> bool {
        // Second moments of a disk of area 1 are 1/(4π) = 0.08; a change of width by 1 % changes them by 0.0016.
        self.0.iter().zip(other.0).all(|(a, b)| (a - b).abs() < 0.0016)
    }
}
