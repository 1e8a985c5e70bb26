//! Phase autofocus with split pixels: the pictures through the left and the right half of the pupil lie apart by what is out of focus.
//!
//! A film that stands Δ behind the image sees the halves of a pupil of working f-number N apart by 2 · 4/(3π) · Δ / (2N) = 0.424 Δ/N,
//! the distance of the centroids of two half disks (moments of a half disk; R. Garg et al. 2019, "Learning Single Camera Depth Estimation
//! using Dual-Pixels", ICCV, for the relation of disparity and defocus).

use super::measure::Frame;
use super::probe::Prober;
use super::{Autofocus, Failure, Found, Point, Range};
use crate::expose::{ExposeError, Half};

/// Distance of the centroids of the halves of a disk over its diameter.
const CENTROIDS: f64 = 4.0 / (3.0 * std::f64::consts::PI);
/// Cells of the wide view, and samples a cell.
const WIDE: [usize; 2] = [64, 20];
const SPP: u32 = 8;
/// Samples a cell of the close view: where it is sharp, a quarter of the depth of focus is a fraction of a cell.
const CLOSE_SPP: u32 = 16;
/// So much of itself a shift may be unsure by that only moves the lens.
const UNSURE: f64 = 0.4;
/// So many tolerances one may be unsure by that ends the search.
const DEVIATION: f64 = 1.5;
/// How far off a shift may be for what the pupil is not two halves of a disc (vignetting, the defocus of other depths in the view), as a fraction of itself.
const SYSTEMATIC: f64 = 0.12;
/// Defocus, in tolerances, from which on the last reading is not taken at its word: half the depth of focus.
const ENDS_WITHIN: f64 = 4.0;
/// Positions that are no farther apart than the depth of focus, in tolerances: where one is too near and the other too far, what is sharp lies between.
const BRACKET: f64 = 8.0;
/// The correlation of a shift that ends the search without a second look: noise pulls shifts towards none, alike in all rows.
const ENDS: f64 = 0.8;
/// Cells about the highest correlation in which it may lie without a group of rows.
const NEAR: usize = 4;
/// What is not sure is looked at again: samples of all looks together, over those of the first.
const LOOKS: [u32; 4] = [1, 2, 4, 16];
/// The look from which on a shift that is clear is taken as it is.
const ENOUGH: usize = 2;
/// Signal over noise that a look finds may be so many times too small: of few samples it is badly known.
const SIGNAL_GAIN: [f64; LOOKS.len()] = [4.0, 2.5, 1.5, 1.0];
/// Means over so many cells that are tried: what is far out of focus has no finer detail, only noise.
const SMOOTH: [usize; 3] = [1, 3, 7];
/// The least correlation that is believed, one that is as good as any, and how much lower any other shift must be.
const CORRELATED: f64 = 0.6;
const CLEAR: f64 = 0.8;
const ALONE: f64 = 0.12;
/// Moves that a search may make.
const MOST_MOVES: u32 = 4;

/// A shift between two pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shift {
    /// The right one lies so many cells to the right of the left one.
    pub cells: f64,
    /// Standard deviation of that, as far as rows differ.
    pub deviation: f64,
    /// Correlation there, −1 to 1.
    pub correlation: f64,
    /// The highest correlation at any other, distant shift.
    pub rival: f64,
}

impl Shift {
    fn is_sure(&self) -> bool {
        self.correlation > CORRELATED && self.correlation - self.rival > ALONE
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

/// Means of `over` cells along the rows and (with less to gain) across them.
fn smoothed(f: &Frame, over: usize) -> Vec<f64> {
    let [a, b] = [0, 1].map(|k| smoothed_reading(f, k, over));
    a.iter().zip(&b).map(|(a, b)| a + b).collect()
}

/// The same of one of the two readings, of square roots: photon noise is then alike in all cells (Anscombe 1948), and no single bright one decides.
fn smoothed_reading(f: &Frame, reading: usize, over: usize) -> Vec<f64> {
    let (columns, rows, n) = (f.columns, f.rows, f.channels);
    let mut v: Vec<f64> = f.readings[reading].iter().map(|v| f64::from(v.max(0.0)).sqrt()).collect();
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

/// Groups of rows of which one is left out at a time, to see how much the shift depends on it.
const GROUPS: usize = 5;

fn shift_of_means(left: &Frame, right: &Frame, over: usize) -> Option<Shift> {
    let (columns, rows, n) = (left.columns, left.rows, left.channels);
    let (a, b) = (smoothed(left, over), smoothed(right, over));
    let most = columns as i64 * 5 / 8;
    let sums: Vec<_> = (-most..=most).map(|k| products([&a, &b], [columns, rows, n], over, k)).collect();
    let without = |out: Option<usize>, i: usize| {
        let kept = (0..GROUPS).filter(|g| Some(*g) != out).map(|g| sums[i][g]);
        let [ab, aa, bb] = kept.fold([0.0; 3], add);
        if aa > 0.0 && bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
    };
    let all: Vec<f64> = (0..sums.len()).map(|i| without(None, i)).collect();
    let top = (0..all.len()).max_by(|i, j| all[*i].total_cmp(&all[*j]))?;
    if !all[top].is_finite() || all[top] <= 0.0 || top == 0 || top + 1 == all.len() {
        return None;
    }
    let between = |lower: f64, here: f64, upper: f64| {
        let bend = lower - 2.0 * here + upper;
        if bend < 0.0 { (0.5 * (lower - upper) / bend).clamp(-0.5, 0.5) } else { 0.0 }
    };
    let part = between(all[top - 1], all[top], all[top + 1]);
    // Jackknife over the groups of rows (Efron 1982): it sees a few bright cells that all rests on, which formulas for even noise do not.
    let near = top.saturating_sub(NEAR).max(1)..=(top + NEAR).min(all.len() - 2);
    let others: Vec<f64> = (0..GROUPS.min(rows))
        .filter_map(|out| {
            let value = |i: usize| without(Some(out), i);
            let i = near.clone().max_by(|i, j| value(*i).total_cmp(&value(*j)))?;
            Some(i as f64 + between(value(i - 1), value(i), value(i + 1)))
        })
        .collect();
    let count = others.len() as f64;
    let mean = others.iter().sum::<f64>() / count;
    let deviation = ((count - 1.0) / count * others.iter().map(|o| (o - mean).powi(2)).sum::<f64>()).sqrt();
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
    Some(Shift { cells: top as f64 - most as f64 + part, deviation, correlation: all[top], rival })
}

/// How much of what a frame shows is the same in its two readings: signal / (signal + noise) of their mean, of the smoothing that shows most (Spearman 1910, Brown 1910).
fn reliability(frame: &Frame) -> f64 {
    let reliability = |over: usize| {
        let [a, b] = [0, 1].map(|k| smoothed_reading(frame, k, over));
        let [ab, aa, bb] =
            products([&a, &b], [frame.columns, frame.rows, frame.channels], over, 0).into_iter().fold([0.0; 3], add);
        let r = if aa > 0.0 && bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 };
        (2.0 * r / (1.0 + r)).clamp(0.0, 1.0)
    };
    SMOOTH.into_iter().map(reliability).fold(0.0, f64::max)
}

fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// Σ a b, Σ a², Σ b² of the rows of each group, where `b` lies `k` cells to the right; each row and channel without its mean and slope: neither shading nor brightness
/// is a likeness.
fn products([a, b]: [&[f64]; 2], [columns, rows, n]: [usize; 3], over: usize, k: i64) -> [[f64; 3]; GROUPS] {
    // Means at the ends are of fewer cells, at the same place in both: they would speak for no shift.
    let (first, last) = (over as i64 / 2, columns as i64 - over as i64 / 2);
    let (from, to) = (first.max(first - k), last.min(last - k));
    let count = (to - from) as f64;
    let (middle, spread) = (0.5 * (from + to - 1) as f64, count * (count * count - 1.0) / 12.0);
    let mut groups = [[0.0; 3]; GROUPS];
    for row in 0..rows {
        let group = &mut groups[row * GROUPS / rows];
        for c in 0..n {
            let value = |v: &[f64], x: i64| v[(row * columns + x as usize) * n + c];
            let sums = (from..to).fold([0.0; 4], |m, x| {
                let (va, vb, d) = (value(a, x), value(b, x + k), x as f64 - middle);
                [m[0] + va, m[1] + va * d, m[2] + vb, m[3] + vb * d]
            });
            for x in from..to {
                let d = x as f64 - middle;
                let va = value(a, x) - sums[0] / count - sums[1] / spread * d;
                let vb = value(b, x + k) - sums[2] / count - sums[3] / spread * d;
                *group = add(*group, [va * vb, va * va, vb * vb]);
            }
        }
    }
    groups
}

/// Moves the lens by what the halves say.
pub(super) fn search(prober: &mut Prober, af: &Autofocus, zone: [f64; 4], range: Range) -> Result<Found, ExposeError> {
    let camera = prober.view.camera;
    let film = camera.film;
    let (f_number, focal) = (camera.lens.f_number(), camera.lens.focal_length().0);
    let mut curve: Vec<Point> = Vec::new();
    let start = range.start();
    prober.drive.go(start);
    // First the whole zone, then its middle in cells as fine as what counts as sharp.
    let fine = (0.8 * af.circle_mm).max(2.0 * prober.view.sensor.pitch_mm()[0]);
    let size = [film.width_mm * zone[2], film.height_mm * zone[3]];
    let part = [0, 1].map(|k| (WIDE[k] as f64 * fine / size[k]).min(1.0));
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
        let mut seen: Option<Shift> = None;
        let mut left_frame = None;
        let pitch = film.width_mm * piece[2] / WIDE[0] as f64;
        let working = f_number * (1.0 + at.max(0.0) / focal);
        let tolerated = tolerance * CENTROIDS / (pitch * working);
        // The close view decides.
        let first = if wide { SPP } else { CLOSE_SPP };
        let mut right_frame = None;
        for step in 0..LOOKS.len() {
            // What was seen before counts by its samples.
            let samples = |step: usize| first * LOOKS[step];
            let before = step.checked_sub(1).map_or(0, samples);
            let mut half = |h| prober.frame(piece, WIDE, samples(step) - before, Some(h));
            let (Some(left), Some(right)) = (half(Half::Left)?, half(Half::Right)?) else {
                return fail(at, Failure::Uncertain, moves, curve);
            };
            let joined = |new: Frame, old: &Option<Frame>| match old {
                Some(old) => new.joined(old, before as f32 / samples(step) as f32),
                None => new,
            };
            let (left, right) = (joined(left, &left_frame), joined(right, &right_frame));
            seen = shift(&left, &right);
            // Signal over noise grows with the samples: what even the last look would not show is not worth one.
            let reliable = reliability(&left).min(reliability(&right));
            let noise =
                reliable / (1.0 - reliable).max(1e-9) * f64::from(LOOKS[LOOKS.len() - 1] / LOOKS[step]) * SIGNAL_GAIN[step];
            (left_frame, right_frame) = (Some(left), Some(right));
            // What only says where to look closer need not be exact; rows of different depth differ however many samples there are.
            let exact = |s: Shift| match s.cells.abs() < ENDS_WITHIN * tolerated {
                true => s.correlation > ENDS && s.deviation.hypot(SYSTEMATIC * s.cells) < DEVIATION * tolerated,
                false => s.deviation < tolerated.max(UNSURE * s.cells.abs()),
            };
            if seen.is_some_and(|s| s.is_sure() && (wide || step >= ENOUGH || exact(s))) || noise / (1.0 + noise) < CORRELATED {
                break;
            }
        }
        let Some(left) = left_frame else { return fail(at, Failure::Uncertain, moves, curve) };
        let detail = left.sharpness(super::Measure::Variance, 1);
        if detail.significance() < 3.0 {
            let why = if detail.floor.sqrt() > 0.2 || left.mean() <= 0.0 { Failure::TooDark } else { Failure::NoContrast };
            return fail(at, why, moves, curve);
        }
        let Some(found) = seen else { return fail(at, Failure::NoContrast, moves, curve) };
        let defocus = found.cells * pitch * working / CENTROIDS;
        curve.push(Point { extension_mm: at, value: defocus, floor: found.correlation, level: u32::from(!wide) });
        if !found.is_sure() {
            let why = if found.correlation > CORRELATED { Failure::Ambiguous } else { Failure::NoContrast };
            return fail(at, why, moves, curve);
        }
        let mut to = at - defocus;
        let mut is_there = defocus.abs() < ENDS_WITHIN * tolerance;
        // Two close readings on both sides of it.
        if let [.., a, b] = curve.as_slice()
            && a.level == b.level
            && a.value * b.value < 0.0
        {
            to = a.extension_mm + (b.extension_mm - a.extension_mm) * a.value / (a.value - b.value);
            is_there |= (a.extension_mm - b.extension_mm).abs() < BRACKET * tolerance;
        }
        if to > range.high + tolerance {
            return fail(range.high, Failure::TooNear, moves, curve);
        }
        if to < range.low - tolerance {
            return fail(range.low, Failure::BeyondInfinity, moves, curve);
        }
        if wide {
            // Where in the zone the detail is decides where to look closer.
            let block = [0, 1].map(|k| ((part[k] * WIDE[k] as f64).round() as usize).clamp(3.min(WIDE[k]), WIDE[k]));
            let [x, y] = left.busiest_block(block[0], block[1]);
            let cell = [zone[2] / WIDE[0] as f64, zone[3] / WIDE[1] as f64];
            middle[0] = (zone[0] + x as f64 * cell[0]).min(zone[0] + zone[2] - middle[2]);
            middle[1] = (zone[1] + y as f64 * cell[1]).min(zone[1] + zone[3] - middle[3]);
        } else if is_there {
            // The last reading says how well.
            let sure = ((found.correlation - CORRELATED) / (1.0 - CORRELATED)).clamp(0.0, 1.0);
            let confidence = 0.5 + 0.5 * sure;
            return Ok(Found { zone, extension_mm: to, confidence, failure: None, method: "phase", moves, curve });
        }
        wide = false;
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

    fn frame(mut f: impl FnMut(f64, usize) -> f64) -> Frame {
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
    fn the_deviation_is_that_of_other_noise() {
        // Two pictures with noise of their own, many times: shifts scatter about as each of them says. Five groups of rows know a deviation to about a third.
        let scene =
            |x: f64, row: usize| FAR + 20.0 * (0.31 * x + row as f64).sin() + 15.0 * (0.13 * x * (1.0 + 0.2 * row as f64)).cos();
        let (mut squares, mut claimed, times) = (0.0, 0.0, 60);
        let mut noise = noise();
        for _ in 0..times {
            let (left, right) = (frame(|x, row| scene(x, row) + noise()), frame(|x, row| scene(x - 1.3, row) + noise()));
            let found = shift(&left, &right).unwrap();
            squares += (found.cells - 1.3).powi(2);
            claimed += found.deviation.powi(2);
        }
        let ratio = (claimed / squares).sqrt();
        assert!((0.6..1.6).contains(&ratio), "claimed {:.3}, seen {:.3} cells", (claimed / 60.0).sqrt(), (squares / 60.0).sqrt());
    }

    #[test]
    fn reliability_is_signal_over_signal_and_noise() {
        let mut noise = noise();
        // Variances of signal and of the mean of two readings' noise; the slope is no signal.
        let mut two = |signal: f64| {
            let mut reading = || -> Vec<f32> {
                (0..64 * 8)
                    .map(|i| (FAR + signal * f64::from(2 * ((i * 7 / 3) % 2) as u32) + 5.0 * (i % 64) as f64 + noise()) as f32)
                    .collect()
            };
            let readings = [reading(), reading()];
            reliability(&Frame { columns: 64, rows: 8, channels: 1, readings })
        };
        let (strong, none) = (two(20.0), two(0.0));
        // 400 / (400 + 133 / 2); of 512 cells within a few hundredths.
        assert!((strong - 0.857).abs() < 0.04, "{strong}");
        assert!(none < 0.35, "{none}");
    }

    /// Where square roots are as good as straight lines.
    const FAR: f64 = 1e5;

    /// Even noise of variance 133.
    fn noise() -> impl FnMut() -> f64 {
        let mut state = 1u64;
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 40) as f64 / (1u64 << 24) as f64 - 0.5) * 40.0
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
