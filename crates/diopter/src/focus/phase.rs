//! Phase autofocus with split pixels: the pictures through the left and the right half of the pupil lie apart by what is out of focus.
//!
//! A film that stands Δ behind the image sees the halves of a pupil of working f-number N apart by 2 · 4/(3π) · Δ / (2N) = 0.424 Δ/N,
//! the distance of the centroids of two half disks (moments of a half disk; R. Garg et al. 2019, "Learning Single Camera Depth Estimation
//! using Dual-Pixels", ICCV, for the relation of disparity and defocus).

use super::measure::Frame;
use super::probe::{Look, Prober};
use super::{Autofocus, Failure, Found, Point, Range};
use crate::expose::{ExposeError, Half};

/// Distance of the centroids of the halves of a disk over its diameter.
const CENTROIDS: f64 = 4.0 / (3.0 * std::f64::consts::PI);
/// Cells of a view.
const CELLS: [usize; 2] = [64, 20];
/// Samples a cell that a wide and a close view begin with (with 8 or 16 a close view before fine detail is off by more than its noise says); they
/// are doubled while noise hides the answer, up to so many.
const SPP: [u32; 2] = [8, 32];
const MOST_SPP: [u32; 2] = [128, 512];
/// Above this reliability noise is not what keeps two pictures from being alike: more samples would not help.
const RELIABLE: f64 = 0.9;
/// Below this one correlations say nothing of pictures without noise.
const LEAST_RELIABLE: f64 = 0.5;
/// Standard deviation of a shift that is exact enough: of the wide view in cells of the close one, which it only has to meet; of the close view in
/// tolerances, of which there are eight in the depth of focus.
const WIDE_DEVIATION: f64 = 6.0;
const CLOSE_DEVIATION: f64 = 0.25;
/// Means over so many cells that are tried: what is far out of focus has no finer detail, only noise.
const SMOOTH: [usize; 3] = [1, 3, 7];
/// The least correlation that is believed, one that is as good as any, and how much lower any other shift must be.
const CORRELATED: f64 = 0.6;
const CLEAR: f64 = 0.8;
const ALONE: f64 = 0.12;
/// Moves that a search may make.
const MOST_MOVES: u32 = 3;

/// A shift between two pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shift {
    /// The right one lies so many cells to the right of the left one.
    pub cells: f64,
    /// Correlation there, −1 to 1.
    pub correlation: f64,
    /// The highest correlation at any other, distant shift.
    pub rival: f64,
    /// Fraction of the variance of the pictures that is not noise (geometric mean of both), 0 to 1: correlations are lower by this factor than
    /// those of pictures without noise (C. Spearman 1904, "The proof and measurement of association between two things").
    pub reliability: f64,
    /// Standard deviation of `cells` by noise: that of a shift of a known signal in white noise (the Cramér–Rao bound; e.g. D. Robinson &
    /// P. Milanfar 2004, "Fundamental performance limits in image registration", IEEE TIP 13(9)).
    pub deviation: f64,
}

impl Shift {
    /// The correlation and its rival as without noise, as far as that can be told.
    fn likeness(&self) -> [f64; 2] {
        [self.correlation, self.rival].map(|c| c / self.reliability.max(LEAST_RELIABLE))
    }

    fn is_sure(&self) -> bool {
        let [alike, rival] = self.likeness();
        alike > CORRELATED && alike - rival > ALONE
    }

    /// Whether more samples could make it sure or exact enough (`deviation`, cells).
    fn wants_more(&self, deviation: f64) -> bool {
        match self.is_sure() {
            true => self.deviation > deviation,
            false => self.reliability < RELIABLE,
        }
    }
}

/// Where `right` lies relative to `left`: normalised cross-correlation along the rows, all rows and channels together, a parabola through
/// the highest; means of neighbouring cells where they correlate clearly better. `None` where there is nothing but noise.
pub fn shift(left: &Frame, right: &Frame) -> Option<Shift> {
    let clear = |s: &Shift| s.correlation.min(CLEAR) + (s.correlation - s.rival).min(2.0 * ALONE);
    let mut best: Option<Shift> = None;
    for over in SMOOTH {
        if let Some(found) = shift_of_means(left, right, over)
            && best.as_ref().is_none_or(|b| clear(&found) > clear(b) + 0.05)
        {
            best = Some(found);
        }
    }
    best
}

/// Means of `over` cells along the rows and (with less to gain) across them; of the sum of both readings, or of their difference: its noise.
fn smoothed(f: &Frame, over: usize, sign: f32) -> Vec<f64> {
    let (columns, rows, n) = (f.columns, f.rows, f.channels);
    let mut v: Vec<f64> = f.readings[0].iter().zip(&f.readings[1]).map(|(a, b)| f64::from(a + sign * b)).collect();
    for (stride, count, half) in [(n, columns, over / 2), (n * columns, rows, over / 4)] {
        let from = v.clone();
        for (i, to) in v.iter_mut().enumerate() {
            let at = i / stride % count;
            let (a, b) = (at.saturating_sub(half), (at + half).min(count - 1));
            *to = (a..=b).map(|k| from[i + k * stride - at * stride]).sum::<f64>() / (b - a + 1) as f64;
        }
    }
    v
}

fn shift_of_means(left: &Frame, right: &Frame, over: usize) -> Option<Shift> {
    let (columns, rows, n) = (left.columns, left.rows, left.channels);
    let (a, b) = (smoothed(left, over, 1.0), smoothed(right, over, 1.0));
    let most = columns as i64 * 5 / 8;
    // Means at the ends are of fewer cells, at the same place in both: they would speak for no shift.
    let (first, last) = (over as i64 / 2, columns as i64 - over as i64 / 2);
    let at = |k: i64| {
        let (from, to) = (first.max(first - k), last.min(last - k));
        let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
        for row in 0..rows {
            for c in 0..n {
                let value = |v: &[f64], x: i64| v[(row * columns + x as usize) * n + c];
                // Each without its mean and slope: neither shading nor brightness is a likeness.
                let count = (to - from) as f64;
                let middle = 0.5 * (from + to - 1) as f64;
                let sums = (from..to).fold([0.0; 4], |m, x| {
                    let (va, vb, d) = (value(&a, x), value(&b, x + k), x as f64 - middle);
                    [m[0] + va, m[1] + va * d, m[2] + vb, m[3] + vb * d]
                });
                let spread = count * (count * count - 1.0) / 12.0;
                for x in from..to {
                    let d = x as f64 - middle;
                    let va = value(&a, x) - sums[0] / count - sums[1] / spread * d;
                    let vb = value(&b, x + k) - sums[2] / count - sums[3] / spread * d;
                    ab += va * vb;
                    aa += va * va;
                    bb += vb * vb;
                }
            }
        }
        if aa > 0.0 && bb > 0.0 { (ab / (aa * bb).sqrt(), [aa, bb]) } else { (0.0, [0.0; 2]) }
    };
    let all: Vec<f64> = (-most..=most).map(|k| at(k).0).collect();
    let top = (0..all.len()).max_by(|i, j| all[*i].total_cmp(&all[*j]))?;
    if !all[top].is_finite() || all[top] <= 0.0 || top == 0 || top + 1 == all.len() {
        return None;
    }
    let bend = all[top - 1] - 2.0 * all[top] + all[top + 1];
    let part = if bend < 0.0 { (0.5 * (all[top - 1] - all[top + 1]) / bend).clamp(-0.5, 0.5) } else { 0.0 };
    // Other maxima: beyond where the correlation has stopped falling.
    let mut rival = -1.0f64;
    for side in [-1i64, 1] {
        let mut i = top as i64;
        while (0..all.len() as i64).contains(&(i + side)) && all[(i + side) as usize] <= all[i as usize] {
            i += side;
        }
        while (0..all.len() as i64).contains(&i) {
            if i != top as i64 {
                rival = rival.max(all[i as usize]);
            }
            i += side;
        }
    }
    // Noise of what overlaps, and the energy of its slopes without that of noise.
    let (cells, variances) = (top as i64 - most, at(top as i64 - most).1);
    let overlap = (last - first - cells.abs()).max(1) as f64 / columns as f64;
    let noise = [left, right].map(|f| smoothed(f, over, -1.0).iter().map(|v| v * v).sum::<f64>() * overlap);
    let reliable = |k: usize| (1.0 - noise[k] / variances[k].max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    let slopes = |v: &[f64]| -> f64 {
        let row = |r: usize| (1..columns - 1).map(move |x| (r * columns + x) * n);
        let squares = |i: usize| (0..n).map(|c| (0.5 * (v[i + n + c] - v[i - n + c])).powi(2)).sum::<f64>();
        (0..rows).flat_map(row).map(squares).sum::<f64>() * overlap
    };
    let of_noise = |f: &Frame| slopes(&smoothed(f, over, -1.0));
    let energy = 0.5 * (slopes(&a) + slopes(&b) - of_noise(left) - of_noise(right));
    let count = (rows * n) as f64 * overlap * columns as f64;
    // Means of neighbours share noise: about as if `over` cells were one.
    let deviation = if energy > 0.0 { ((noise[0] + noise[1]) / count * over as f64 / energy).sqrt() } else { f64::INFINITY };
    let reliability = (reliable(0) * reliable(1)).sqrt();
    Some(Shift { cells: cells as f64 + part, correlation: all[top], rival, reliability, deviation })
}

/// Moves the lens by what the halves say.
pub(super) fn search(prober: &mut Prober, af: &Autofocus, zone: [f64; 4], range: Range) -> Result<Found, ExposeError> {
    let camera = prober.view.camera;
    let film = camera.film;
    let (f_number, focal) = (camera.lens.f_number(), camera.lens.focal_length().0);
    let mut curve = Vec::new();
    let start = range.start();
    prober.drive.go(start);
    // First the whole zone, then its middle in cells as fine as what counts as sharp.
    let fine = (0.8 * af.circle_mm).max(2.0 * prober.view.sensor.pitch_mm()[0]);
    let size = [film.width_mm * zone[2], film.height_mm * zone[3]];
    let part = [0, 1].map(|k| (CELLS[k] as f64 * fine / size[k]).min(1.0));
    let mut middle = [
        zone[0] + 0.5 * zone[2] * (1.0 - part[0]),
        zone[1] + 0.5 * zone[3] * (1.0 - part[1]),
        zone[2] * part[0],
        zone[3] * part[1],
    ];
    let tolerance = 0.25 * f_number * af.circle_mm;
    let (mut moves, mut wide) = (0, true);
    let fail = |at: f64, why: Failure, moves: u32, curve: Vec<Point>| {
        Ok(Found { zone, extension_mm: at, confidence: 0.0, failure: Some(why), method: "phase", moves, curve })
    };
    loop {
        let at = prober.drive.stands_mm();
        let piece = if wide { zone } else { middle };
        let pitch = film.width_mm * piece[2] / CELLS[0] as f64;
        let working = f_number * (1.0 + at.max(0.0) / focal);
        let exact =
            if wide { WIDE_DEVIATION * fine / pitch } else { CLOSE_DEVIATION * tolerance * CENTROIDS / (pitch * working) };
        let most = MOST_SPP[usize::from(!wide)];
        let mut looks = [Half::Left, Half::Right].map(|half| Look::new(piece, CELLS, Some(half), most));
        let mut spp = SPP[usize::from(!wide)];
        let (left, seen) = loop {
            let [left, right] = &mut looks;
            let (Some(left), Some(right)) = (prober.look(left, spp)?, prober.look(right, spp)?) else {
                return fail(at, Failure::Uncertain, moves, curve);
            };
            let seen = shift(&left, &right);
            if spp >= most || seen.is_some_and(|s| !s.wants_more(exact)) {
                break (left, seen);
            }
            spp *= 2;
        };
        let detail = left.sharpness(super::Measure::Variance, 1);
        if detail.significance() < 3.0 {
            let why = if detail.floor.sqrt() > 0.2 || left.mean() <= 0.0 { Failure::TooDark } else { Failure::NoContrast };
            return fail(at, why, moves, curve);
        }
        let Some(found) = seen else { return fail(at, Failure::NoContrast, moves, curve) };
        let defocus = found.cells * pitch * working / CENTROIDS;
        curve.push(Point { extension_mm: at, value: defocus, floor: found.correlation, level: u32::from(!wide) });
        if !found.is_sure() {
            let why = if found.likeness()[0] > CORRELATED { Failure::Ambiguous } else { Failure::NoContrast };
            return fail(at, why, moves, curve);
        }
        let to = at - defocus;
        if wide {
            // Where in the zone the detail is decides where to look closer.
            let block = [0, 1].map(|k| ((part[k] * CELLS[k] as f64).round() as usize).clamp(3.min(CELLS[k]), CELLS[k]));
            let [x, y] = left.busiest_block(block[0], block[1]);
            let cell = [zone[2] / CELLS[0] as f64, zone[3] / CELLS[1] as f64];
            middle[0] = (zone[0] + x as f64 * cell[0]).min(zone[0] + zone[2] - middle[2]);
            middle[1] = (zone[1] + y as f64 * cell[1]).min(zone[1] + zone[3] - middle[3]);
        } else if defocus.abs() < 2.0 * tolerance {
            // There: the last reading says how well.
            let sure = ((found.likeness()[0] - CORRELATED) / (1.0 - CORRELATED)).clamp(0.0, 1.0);
            let confidence = 0.5 + 0.5 * sure;
            return Ok(Found { zone, extension_mm: to, confidence, failure: None, method: "phase", moves, curve });
        }
        wide = false;
        if to > range.high + tolerance {
            return fail(range.high, Failure::TooNear, moves, curve);
        }
        if to < range.low - tolerance {
            return fail(range.low, Failure::BeyondInfinity, moves, curve);
        }
        if defocus.abs() >= tolerance {
            moves += 1;
            if moves > MOST_MOVES {
                return fail(to, Failure::Uncertain, moves, curve);
            }
            prober.drive.go(to);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(f: impl Fn(f64, usize) -> f64) -> Frame {
        let (columns, rows) = (64, 8);
        let data: Vec<f32> = (0..columns * rows).map(|i| f((i % columns) as f64, i / columns) as f32).collect();
        Frame { columns, rows, channels: 1, readings: [data.clone(), data] }
    }

    #[test]
    fn shifts_are_found_between_cells() {
        let scene = |x: f64, row: usize| {
            100.0
                + 20.0 * (0.31 * x + row as f64).sin()
                + 15.0 * (0.13 * x * (1.0 + 0.2 * row as f64)).cos()
                + 9.0 * (0.71 * x).sin()
        };
        for by in [-11.3, -0.4, 0.0, 0.25, 3.5, 17.0] {
            let found = shift(&frame(scene), &frame(|x, row| scene(x - by, row))).unwrap();
            assert!((found.cells - by).abs() < 0.06 && found.is_sure(), "{by}: {found:?}");
        }
    }

    #[test]
    fn stripes_and_walls_are_not_believed() {
        let stripes = |x: f64, _: usize| 100.0 + 30.0 * (0.6 * x).sin();
        let found = shift(&frame(stripes), &frame(|x, r| stripes(x - 4.0, r))).unwrap();
        assert!(!found.is_sure(), "{found:?}");
        assert!(shift(&frame(|_, _| 5.0), &frame(|_, _| 5.0)).is_none());
        // Detail along the rows only says nothing about shifts along them.
        let lying = |_: f64, row: usize| 100.0 + 10.0 * row as f64;
        assert!(shift(&frame(lying), &frame(lying)).is_none_or(|s| !s.is_sure()));
    }
}
