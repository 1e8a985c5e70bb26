//! The Fraunhofer pattern of an aperture: |Fourier transform|² as densities to draw from.
//!
//! The pupil function stands on an even grid of [`ACROSS`] × [`ACROSS`] cells over a square. Frequencies w are cycles across that square, so that one
//! table serves every wavelength and f-number. The transform is a product of matrices, which gives any part of the pattern at any spacing: R. Soummer et
//! al. 2007, "Fast computation of Lyot-style coronagraph propagation", Optics Express 15(24), eq. 7. Its middle is sampled finely, so that cells hardly
//! lower the contrast (a cell of 1/16 multiplies the MTF by sinc(x/16), x the frequency over the cut-off); the part around it at the Nyquist rate of
//! the intensity, 1/2, at which the sum of the samples is the integral.

use diopter_light::sampling::Grid2;
use glam::{DVec2, Vec2};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Cells of the pupil function across the square.
pub(super) const ACROSS: usize = 128;
/// Half width of the finely sampled middle.
const CORE: f64 = 8.0;
/// Cells across it.
const CORE_CELLS: usize = 256;
/// The same of a pupil with aberrations, of which there are many: an eighth multiplies the MTF by sinc(x/8).
const CORE_CELLS_WITH_PHASES: usize = 128;
/// Radius of the table. The transform of [`ACROSS`] cells repeats after as many cycles: here the nearest copy's middle is 88 away, and adds 4 %.
pub(super) const EXTENT: f64 = 40.0;
/// Cells across the table.
const EXTENT_CELLS: usize = 160;
/// Steps of the encircled energy, cycles.
const STEP: f64 = 1.0 / 16.0;

/// Density of the pattern over w, cycles across the square of the pupil function.
#[derive(Clone, Debug)]
pub(super) struct Pattern {
    core: Grid2,
    around: Arc<Grid2>,
    /// Its light over that of the pupil.
    around_light: f64,
    /// Fraction of the light in the middle.
    core_fraction: f32,
    /// Fraction of the light within circles of radii 0, [`STEP`], 2 · [`STEP`] ...
    encircled: Vec<f32>,
    /// The same densities without what lies within [`Pattern::wings_from`].
    wings: Option<Arc<Wings>>,
}

#[derive(Clone, Debug)]
struct Wings {
    core: Option<Grid2>,
    around: Grid2,
    core_fraction: f32,
}

impl Pattern {
    /// Of amplitudes from 0 to 1, rows from the lowest y.
    pub(super) fn new(amplitude: &[f64]) -> Pattern {
        let (core, around) = tables(amplitude);
        let around_light = sum(&around) * cell(EXTENT, EXTENT_CELLS).powi(2);
        let rings = rings(&around, EXTENT, EXTENT_CELLS);
        let around = Arc::new(Grid2::new(&around, EXTENT_CELLS));
        Pattern::of(&core, CORE_CELLS, around, around_light, &rings)
    }

    /// The same pupil with a phase, in turns, of each cell. It changes the middle alone: what goes far out comes from the edges.
    pub(super) fn with_phases(&self, amplitude: &[f64], turns: &[f64]) -> Pattern {
        let cells: Vec<[f64; 2]> = amplitude
            .iter()
            .zip(turns)
            .map(|(a, turns)| {
                let (s, c) = (TAU * turns).sin_cos();
                [a * c, a * s]
            })
            .collect();
        let core = intensity_with_phases(&cells, CORE, CORE_CELLS_WITH_PHASES);
        // The light around, ring by ring, as it was.
        let from = ((CORE / STEP) as usize).saturating_sub(1);
        let mut rings: Vec<f64> = vec![0.0; self.encircled.len()];
        let total = self.around_light / f64::from(1.0 - self.core_fraction).max(1e-9);
        for (ring, within) in rings.iter_mut().skip(1).zip(self.encircled.windows(2)).skip(from) {
            *ring = f64::from(within[1] - within[0]) * total;
        }
        let within: f64 = rings.iter().sum();
        rings.iter_mut().for_each(|r| *r *= self.around_light / within.max(1e-30));
        let pattern = Pattern::of(&core, CORE_CELLS_WITH_PHASES, self.around.clone(), self.around_light, &rings);
        Pattern { wings: self.wings.clone(), ..pattern }
    }

    /// Of intensities of the middle, of what lies around it, and the light of the latter in rings.
    fn of(core: &[f32], cells: usize, around: Arc<Grid2>, around_light: f64, around_rings: &[f64]) -> Pattern {
        let core_light = sum(core) * cell(CORE, cells).powi(2);
        let total = core_light + around_light;
        let mut within = 0.0;
        let add = |(core, around): (f64, &f64)| {
            within += (core + around) / total;
            within.min(1.0) as f32
        };
        let encircled = rings(core, CORE, cells).into_iter().zip(around_rings).map(add).collect();
        let core_fraction = (core_light / total) as f32;
        Pattern { core: Grid2::new(core, cells), around, around_light, core_fraction, encircled, wings: None }
    }

    /// The same, ready to draw what lies farther out than `from` cycles.
    pub(super) fn wings_from(&mut self, amplitude: &[f64], from: f64) {
        let (mut core, mut around) = tables(amplitude);
        // A cell counts whole if any of it lies outside.
        let clear = |values: &mut [f32], half: f64, n: usize| {
            for (i, v) in values.iter_mut().enumerate() {
                if place(i, half, n).length() + cell(half, n) < from {
                    *v = 0.0;
                }
            }
            values.iter().map(|v| f64::from(*v)).sum::<f64>() * cell(half, n).powi(2)
        };
        let light = [clear(&mut core, CORE, CORE_CELLS), clear(&mut around, EXTENT, EXTENT_CELLS)];
        self.wings = (light[1] > 0.0).then(|| {
            Arc::new(Wings {
                core: (light[0] > 0.0).then(|| Grid2::new(&core, CORE_CELLS)),
                around: Grid2::new(&around, EXTENT_CELLS),
                core_fraction: (light[0] / (light[0] + light[1])) as f32,
            })
        });
    }

    /// The place that belongs to `u` in the unit square.
    #[inline]
    pub(super) fn draw(&self, u: [f32; 2]) -> DVec2 {
        draw(Some(&self.core), &self.around, self.core_fraction, u)
    }

    /// The same of what lies about as far out as [`Pattern::wings_from`] says and farther; `None` where the table ends before.
    #[inline]
    pub(super) fn draw_wings(&self, u: [f32; 2]) -> Option<DVec2> {
        self.wings.as_ref().map(|w| draw(w.core.as_ref(), &w.around, w.core_fraction, u))
    }

    /// Density at a place, for a unit of w²: the integral over the table is 1.
    #[inline]
    pub(super) fn density(&self, w: DVec2) -> f32 {
        let far = w.x.abs().max(w.y.abs());
        let unit = |half: f64| (w * (0.5 / half) + 0.5).as_vec2();
        let area = |half: f64| (4.0 * half * half) as f32;
        if far < CORE {
            self.core_fraction * self.core.pdf(unit(CORE)) / area(CORE)
        } else if far < EXTENT {
            (1.0 - self.core_fraction) * self.around.pdf(unit(EXTENT)) / area(EXTENT)
        } else {
            0.0
        }
    }

    /// Fraction of the light of the table within a circle.
    pub(super) fn encircled(&self, radius: f64) -> f64 {
        let at = (radius / STEP).max(0.0);
        let i = at as usize;
        match self.encircled.get(i..i + 2) {
            Some(&[a, b]) => f64::from(a) + f64::from(b - a) * (at - i as f64),
            _ => 1.0,
        }
    }
}

#[inline]
fn draw(core: Option<&Grid2>, around: &Grid2, core_fraction: f32, [u, v]: [f32; 2]) -> DVec2 {
    const BELOW_ONE: f32 = 0.999_999_9;
    let (grid, half, u) = match core {
        Some(core) if u < core_fraction => (core, CORE, u / core_fraction),
        _ => (around, EXTENT, (u - core_fraction) / (1.0 - core_fraction)),
    };
    let (p, _): (Vec2, f32) = grid.sample([u.clamp(0.0, BELOW_ONE), v]);
    (p.as_dvec2() * 2.0 - 1.0) * half
}

fn sum(values: &[f32]) -> f64 {
    values.iter().map(|v| f64::from(*v)).sum()
}

/// Light of a table in rings of [`STEP`]; the first is empty, so that sums are of what lies within 0, [`STEP`] ...
fn rings(values: &[f32], half: f64, n: usize) -> Vec<f64> {
    let mut rings = vec![0.0f64; (EXTENT * std::f64::consts::SQRT_2 / STEP).ceil() as usize + 2];
    for (i, v) in values.iter().enumerate() {
        rings[(place(i, half, n).length() / STEP) as usize + 1] += f64::from(*v) * cell(half, n).powi(2);
    }
    rings
}

fn cell(half: f64, n: usize) -> f64 {
    2.0 * half / n as f64
}

/// Middle of a cell of a table of `n` × `n` cells.
fn place(i: usize, half: f64, n: usize) -> DVec2 {
    (DVec2::new((i % n) as f64 + 0.5, (i / n) as f64 + 0.5) * (2.0 / n as f64) - 1.0) * half
}

/// Intensities of the middle, and of the table: a disk with nothing in its middle.
fn tables(amplitude: &[f64]) -> (Vec<f32>, Vec<f32>) {
    let core = intensity(amplitude, CORE, CORE_CELLS);
    let mut around = intensity(amplitude, EXTENT, EXTENT_CELLS);
    for (i, v) in around.iter_mut().enumerate() {
        let at = place(i, EXTENT, EXTENT_CELLS);
        // Beyond the disk the edges say what there is.
        if at.x.abs().max(at.y.abs()) < CORE || at.length() > EXTENT {
            *v = 0.0;
        }
    }
    (core, around)
}

/// |A(w)|² at the middles of `n` × `n` cells of a square of half width `half`, A(w) = Σ P(x) exp(−2πi x·w) over the cells of the pupil over its light. A cell
/// holds the mean of what lies in it, which lowers the transform by sinc(w/[`ACROSS`]) along each axis: that is undone.
fn intensity(amplitude: &[f64], half: f64, n: usize) -> Vec<f32> {
    assert!(amplitude.len() == ACROSS * ACROSS && n.is_multiple_of(2), "{} cells, {n}", amplitude.len());
    // Of a real function the pattern is the same on both sides: half of the columns, and half of the rows, say all.
    let side = n / 2;
    let turn = |j: usize, i: usize| {
        let x = (j as f64 + 0.5) / ACROSS as f64 - 0.5;
        let w = (i as f64 + 0.5) * cell(half, n) - half;
        (-TAU * x * w).sin_cos()
    };
    // [cell of the pupil][frequency]: sine and cosine.
    let turns: Vec<(f64, f64)> = (0..ACROSS * n).map(|k| turn(k / n, k % n)).collect();
    // Along x: [row][frequency < 0].
    let mut lines = vec![[0.0f64; 2]; ACROSS * side];
    for (row, line) in amplitude.chunks_exact(ACROSS).zip(lines.chunks_exact_mut(side)) {
        for (p, turns) in row.iter().zip(turns.chunks_exact(n)).filter(|(p, _)| **p != 0.0) {
            for (sum, (s, c)) in line.iter_mut().zip(turns) {
                sum[0] += p * c;
                sum[1] += p * s;
            }
        }
    }
    // Along y.
    let light: f64 = amplitude.iter().map(|p| p * p).sum();
    let lowered: Vec<f64> = (0..n)
        .map(|i| {
            let x = std::f64::consts::PI * ((i as f64 + 0.5) * cell(half, n) - half) / ACROSS as f64;
            (x.sin() / x).powi(2)
        })
        .collect();
    let mut values = vec![0.0f32; n * n];
    let mut sums = vec![[0.0f64; 2]; side];
    for (m, lowered_y) in lowered.iter().enumerate() {
        sums.fill([0.0; 2]);
        for (k, line) in lines.chunks_exact(side).enumerate() {
            let (s, c) = turns[k * n + m];
            for (sum, [re, im]) in sums.iter_mut().zip(line) {
                sum[0] += re * c - im * s;
                sum[1] += re * s + im * c;
            }
        }
        for (i, [re, im]) in sums.iter().enumerate() {
            let v = ((re * re + im * im) / (light * (ACROSS * ACROSS) as f64 * lowered_y * lowered[i])) as f32;
            values[m * n + i] = v;
            values[(n - 1 - m) * n + n - 1 - i] = v;
        }
    }
    values
}

/// The same of complex cells.
fn intensity_with_phases(cells: &[[f64; 2]], half: f64, n: usize) -> Vec<f32> {
    let turn = |j: usize, i: usize| {
        let x = (j as f64 + 0.5) / ACROSS as f64 - 0.5;
        let w = (i as f64 + 0.5) * cell(half, n) - half;
        (-TAU * x * w).sin_cos()
    };
    let turns: Vec<(f64, f64)> = (0..ACROSS * n).map(|k| turn(k / n, k % n)).collect();
    let mut lines = vec![[0.0f64; 2]; ACROSS * n];
    for (row, line) in cells.chunks_exact(ACROSS).zip(lines.chunks_exact_mut(n)) {
        for ([a, b], turns) in row.iter().zip(turns.chunks_exact(n)).filter(|(p, _)| **p != [0.0; 2]) {
            for (sum, (s, c)) in line.iter_mut().zip(turns) {
                sum[0] += a * c - b * s;
                sum[1] += a * s + b * c;
            }
        }
    }
    let light: f64 = cells.iter().map(|[a, b]| a * a + b * b).sum();
    let mut values = vec![0.0f32; n * n];
    let mut sums = vec![[0.0f64; 2]; n];
    for (m, values) in values.chunks_exact_mut(n).enumerate() {
        sums.fill([0.0; 2]);
        for (k, line) in lines.chunks_exact(n).enumerate() {
            let (s, c) = turns[k * n + m];
            for (sum, [re, im]) in sums.iter_mut().zip(line) {
                sum[0] += re * c - im * s;
                sum[1] += re * s + im * c;
            }
        }
        for (v, [re, im]) in values.iter_mut().zip(&sums) {
            *v = ((re * re + im * im) / (light * (ACROSS * ACROSS) as f64)) as f32;
        }
    }
    values
}
