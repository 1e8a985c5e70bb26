//! How fast a rolling shutter reads, from one picture.
//!
//! - Of a lamp that flickers with a known frequency, on an even field: rows exposed while it is bright are bright. The bands repeat after the rows that are read
//!   in one period, so that the picture is read in (bands in the picture) / frequency. Sine waves are fitted to the means of rows and of columns (a
//!   Lomb-Scargle periodogram with the field's own fall-off in the fit; J. T. VanderPlas 2018, ApJS 236, 16); what varies more says whether rows or columns
//!   follow each other. The fall-off dims bands and ground alike: in the end fall-off times wave is fitted, all at once (Gauss-Newton), and the error of the
//!   frequency is what that fit leaves open. Which line comes first one picture of a lamp cannot tell. An exposure of whole periods shows no bands, and what a
//!   polynomial without a wave explains as well is fall-off.
//! - Of a bright bar that moves sidewise with a known speed before a dark ground: it leans by the way that it goes from one row to the next. The lean's
//!   sign tells which row comes first.
//!
//! Source of the first: M. Meingast, C. Geyer & S. Sastry 2005, "Geometric models of rolling-shutter cameras", section on calibration by a flashing LED.

use super::fit::{least_squares, polynomial, value as polynomial_at};
use super::{MeasureError, Plane};
use serde::Serialize;
use std::f64::consts::TAU;

/// Fewest bands in a picture: with less, the fall-off of light passes for one.
const FEWEST_BANDS: f64 = 1.5;
/// Order of the polynomial that stands for the field's own fall-off.
const FALL_OFF: usize = 4;
/// Steps of the fit of fall-off times wave.
const STEPS: usize = 50;
/// How much of the variance a wave must explain to be one.
const LEAST_EXPLAINED: f64 = 0.3;
/// Fewest lines of a picture, and of a bar.
const FEWEST_LINES: usize = 16;
/// Lines whose bar is wider than the median by this are crossed by something else.
const WIDER: f64 = 1.4;
/// Lean in pixels across the picture below which none is seen.
const LEAST_LEAN: f64 = 0.3;

/// What the read-out was found by.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sign {
    /// Light of a lamp, Hz: of its flicker, which on mains of 50 Hz is 100 Hz.
    Flicker(f64),
    /// Motion of bars over the picture, pixels a second: to the right, and downwards.
    Motion([f64; 2]),
}

/// A read-out.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rolling {
    /// Whether columns (not rows) follow each other.
    pub columns: bool,
    /// `down`, `up`, `right` or `left`; `None` where the picture does not tell.
    pub direction: Option<&'static str>,
    /// From one line to the next, s.
    pub line_time_s: f64,
    /// Its standard error, by what the fit leaves, and by how far fall-off could pass for wave.
    pub line_time_error_s: f64,
    /// Of all lines, s.
    pub readout_s: f64,
    /// Lines.
    pub lines: usize,
    /// Of a lamp: lines from one band to the next.
    pub period_lines: Option<f64>,
    /// Of a lamp: amplitude of the bands over their mean.
    pub amplitude: Option<f64>,
    /// Of a bar: pixels by which it leans from the first to the last line.
    pub lean_px: Option<f64>,
    /// What was fitted: line and value (the mean of the line over the field's own fall-off, of a bar its place).
    pub points: Vec<(f64, f64)>,
    /// The fit at the same lines.
    pub fitted: Vec<f64>,
}

/// The read-out that a picture shows. Fails below 16 pixels a side, and where there are no bands of the lamp, or no leaning bar.
pub fn measure(plane: &Plane, sign: Sign) -> Result<Rolling, MeasureError> {
    if plane.width < FEWEST_LINES || plane.height < FEWEST_LINES {
        let found = format!("{} × {} pixels", plane.width, plane.height);
        return Err(MeasureError::unfit("picture", found, format!("at least {FEWEST_LINES} a side")));
    }
    match sign {
        Sign::Flicker(hz) => of_lamp(plane, hz),
        Sign::Motion(speed) => of_bars(plane, speed),
    }
}

/// Value at a line and a place along it.
fn value(plane: &Plane, columns: bool, line: usize, along: usize) -> f64 {
    if columns { plane.at(line, along) } else { plane.at(along, line) }
}

/// Number of lines, and their length.
fn lines_of(plane: &Plane, columns: bool) -> [usize; 2] {
    if columns { [plane.width, plane.height] } else { [plane.height, plane.width] }
}

/// Means of lines, those without samples left out.
fn means(plane: &Plane, columns: bool) -> Vec<(f64, f64)> {
    let [lines, length] = lines_of(plane, columns);
    let mean = |line: usize| {
        let (sum, count) = (0..length)
            .map(|k| value(plane, columns, line, k))
            .filter(|v| !v.is_nan())
            .fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
        (count > 0.0).then(|| (line as f64, sum / count))
    };
    (0..lines).filter_map(mean).collect()
}

/// A wave on top of a polynomial.
struct Wave {
    /// Cycles a line.
    frequency: f64,
    /// Coefficients of the polynomial, then of cosine and sine.
    all: Vec<f64>,
    residual: f64,
}

/// Where a line lies, from -1 to 1.
fn place(line: f64, lines: f64) -> f64 {
    2.0 * (line + 0.5) / lines - 1.0
}

/// Coefficients of the unknowns at a line.
fn row(line: f64, lines: f64, frequency: f64) -> Vec<f64> {
    let x = place(line, lines);
    let (sin, cos) = (TAU * frequency * line).sin_cos();
    (0..=FALL_OFF as i32).map(|k| x.powi(k)).chain([cos, sin]).collect()
}

fn wave(points: &[(f64, f64)], lines: f64, frequency: f64) -> Option<Wave> {
    let rows = points.iter().map(|(line, v)| (row(*line, lines, frequency), *v));
    let all = least_squares(rows, FALL_OFF + 3)?;
    let off = |(line, v): &(f64, f64)| v - dot(&row(*line, lines, frequency), &all);
    let residual = points.iter().map(|p| off(p).powi(2)).sum();
    Some(Wave { frequency, all, residual })
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The wave that explains most, and the fraction of the variance about the polynomial that it explains.
fn strongest(points: &[(f64, f64)], lines: f64) -> Option<(Wave, f64)> {
    let without = {
        let rows = points.iter().map(|(line, v)| (row(*line, lines, 0.0)[..=FALL_OFF].to_vec(), *v));
        let all = least_squares(rows, FALL_OFF + 1)?;
        points.iter().map(|(line, v)| (v - dot(&row(*line, lines, 0.0)[..=FALL_OFF], &all)).powi(2)).sum::<f64>()
    };
    // Peaks are 1 / lines wide: five steps to each.
    let step = 0.2 / lines;
    let first = FEWEST_BANDS / lines;
    let count = ((0.45 - first) / step).max(0.0) as usize;
    let tried = (0..=count).filter_map(|k| wave(points, lines, first + k as f64 * step));
    let best = tried.min_by(|a, b| a.residual.total_cmp(&b.residual))?;
    // Golden section within the peak.
    let g = 0.5 * (5f64.sqrt() - 1.0);
    let (mut low, mut high) = ((best.frequency - step).max(0.5 * first), best.frequency + step);
    let at = |f: f64| wave(points, lines, f).map_or(f64::INFINITY, |w| w.residual);
    for _ in 0..40 {
        let (a, b) = (high - g * (high - low), low + g * (high - low));
        if at(a) < at(b) { high = b } else { low = a }
    }
    let best = wave(points, lines, 0.5 * (low + high))?;
    let explained = if without > 0.0 { 1.0 - best.residual / without } else { 0.0 };
    Some((best, explained))
}

/// A wave that is dimmed as its ground is: G(x) (1 + a cos + b sin).
#[derive(Clone)]
struct Dimmed {
    lines: f64,
    /// Cycles a line.
    frequency: f64,
    /// Coefficients of G.
    ground: Vec<f64>,
    /// Of cosine and sine.
    bands: [f64; 2],
    residual: f64,
}

impl Dimmed {
    /// The nearest to means of lines, from a wave that is not dimmed; `None` where it finds none.
    fn fit(points: &[(f64, f64)], lines: f64, from: &Wave) -> Option<Dimmed> {
        let middle = from.all[0];
        if !(middle > 0.0) {
            return None;
        }
        let bands = [from.all[FALL_OFF + 1] / middle, from.all[FALL_OFF + 2] / middle];
        let ground = from.all[..=FALL_OFF].to_vec();
        let mut best = Dimmed { lines, frequency: from.frequency, ground, bands, residual: 0.0 };
        best.residual = best.left(points);
        for _ in 0..STEPS {
            let rows = points.iter().map(|p| (best.slopes(p.0), p.1 - best.at(p.0)));
            let step = least_squares(rows, FALL_OFF + 4)?;
            // Half as far until it is nearer.
            let nearer =
                (0..20).map(|half| best.moved(&step, 0.5f64.powi(half), points)).find(|next| next.residual < best.residual);
            let Some(next) = nearer else { break };
            let gain = 1.0 - next.residual / best.residual;
            best = next;
            if gain < 1e-12 {
                break;
            }
        }
        let is_lit = points.iter().all(|p| best.ground(p.0) > 0.0);
        // Two lines a cycle at least, and bands enough.
        (is_lit && (0.9 * FEWEST_BANDS / lines..0.5).contains(&best.frequency)).then_some(best)
    }

    fn ground(&self, line: f64) -> f64 {
        polynomial_at(&self.ground, place(line, self.lines))
    }

    fn band(&self, line: f64) -> f64 {
        let (sin, cos) = (TAU * self.frequency * line).sin_cos();
        1.0 + self.bands[0] * cos + self.bands[1] * sin
    }

    fn at(&self, line: f64) -> f64 {
        self.ground(line) * self.band(line)
    }

    fn left(&self, points: &[(f64, f64)]) -> f64 {
        points.iter().map(|p| (p.1 - self.at(p.0)).powi(2)).sum()
    }

    /// Amplitude of the bands over the ground.
    fn amplitude(&self) -> f64 {
        self.bands[0].hypot(self.bands[1])
    }

    /// Derivatives by the coefficients of G, by those of the bands, and by the phase that the frequency adds over the picture.
    fn slopes(&self, line: f64) -> Vec<f64> {
        let x = place(line, self.lines);
        let (sin, cos) = (TAU * self.frequency * line).sin_cos();
        let (ground, band) = (self.ground(line), self.band(line));
        let by_phase = ground * (self.bands[1] * cos - self.bands[0] * sin) * line / self.lines;
        (0..=FALL_OFF as i32).map(|k| band * x.powi(k)).chain([ground * cos, ground * sin, by_phase]).collect()
    }

    fn moved(&self, step: &[f64], part: f64, points: &[(f64, f64)]) -> Dimmed {
        let mut next = self.clone();
        next.ground.iter_mut().zip(step).for_each(|(c, s)| *c += part * s);
        next.bands.iter_mut().zip(&step[FALL_OFF + 1..]).for_each(|(c, s)| *c += part * s);
        next.frequency += part * step[FALL_OFF + 3] / (TAU * self.lines);
        next.residual = next.left(points);
        next
    }

    /// Standard error of the frequency, cycles a line: noise by what the fit leaves, over what of the derivative no other unknown explains.
    fn frequency_error(&self, points: &[(f64, f64)]) -> f64 {
        let last = FALL_OFF + 3;
        let rows: Vec<Vec<f64>> = points.iter().map(|p| self.slopes(p.0)).collect();
        let Some(others) = least_squares(rows.iter().map(|row| (row[..last].to_vec(), row[last])), last) else {
            return f64::INFINITY;
        };
        let own: f64 = rows.iter().map(|row| (row[last] - dot(&row[..last], &others)).powi(2)).sum();
        let variance = self.residual / (points.len() as f64 - last as f64 - 1.0).max(1.0);
        (variance / own).sqrt() / (TAU * self.lines)
    }
}

fn of_lamp(plane: &Plane, hz: f64) -> Result<Rolling, MeasureError> {
    // Columns, means of the lines, the wave, the fraction that it explains.
    type Found = (bool, Vec<(f64, f64)>, Wave, f64);
    let mut found: Option<Found> = None;
    for columns in [false, true] {
        let points = means(plane, columns);
        let lines = lines_of(plane, columns)[0] as f64;
        if let Some((wave, explained)) = strongest(&points, lines) {
            let amplitude = |w: &Wave| w.all[FALL_OFF + 1].hypot(w.all[FALL_OFF + 2]);
            // The larger wave, not the purer one: rows of a long exposure may be noisy.
            if found.as_ref().is_none_or(|f| amplitude(&wave) > amplitude(&f.2)) {
                found = Some((columns, points, wave, explained));
            }
        }
    }
    let expected = format!(
        "an evenly lit field under a lamp that flickers, at least {FEWEST_BANDS} bands high or wide, exposed for less than its period (and not for a whole one)"
    );
    let Some((columns, points, wave, _)) = found.filter(|f| f.3 > LEAST_EXPLAINED) else {
        return Err(MeasureError::unfit("picture", "no bands", expected));
    };
    let lines = lines_of(plane, columns)[0];
    let Some(wave) = Dimmed::fit(&points, lines as f64, &wave) else {
        return Err(MeasureError::unfit("picture", "no bands", expected));
    };
    // As many unknowns without a wave.
    let spread: Vec<(f64, f64)> = points.iter().map(|p| (place(p.0, lines as f64), p.1)).collect();
    let smooth = polynomial(&spread, FALL_OFF + 3)
        .map_or(f64::INFINITY, |all| spread.iter().map(|p| (p.1 - polynomial_at(&all, p.0)).powi(2)).sum());
    if wave.residual > smooth {
        return Err(MeasureError::unfit("picture", "no bands: it falls off smoothly", expected));
    }
    let relative = wave.amplitude();
    if relative > 2.0 {
        // Light is not negative: the first harmonic of the shortest flashes is twice their mean.
        return Err(MeasureError::unfit("picture", format!("waves of ± {:.0} % of the mean", 100.0 * relative), expected));
    }
    let line_time_s = wave.frequency / hz;
    let error = wave.frequency_error(&points);
    // The bands over the field's own fall-off.
    let fitted: Vec<f64> = points.iter().map(|p| wave.band(p.0)).collect();
    let points: Vec<(f64, f64)> = points.iter().map(|p| (p.0, p.1 / wave.ground(p.0))).collect();
    Ok(Rolling {
        columns,
        direction: None,
        line_time_s,
        line_time_error_s: error / hz,
        readout_s: line_time_s * lines as f64,
        lines,
        period_lines: Some(1.0 / wave.frequency),
        amplitude: Some(relative),
        lean_px: None,
        points,
        fitted,
    })
}

/// Where the light of a line lies and how wide it is, both in pixels; `None` of lines without samples or without contrast.
fn bar(plane: &Plane, columns: bool, line: usize, range: [f64; 2]) -> Option<(f64, f64)> {
    let length = lines_of(plane, columns)[1];
    let half = 0.5 * (range[0] + range[1]);
    let (mut sum, mut moment, mut width, mut samples) = (0.0, 0.0, 0.0, 0.0);
    for k in 0..length {
        let v = value(plane, columns, line, k);
        if v.is_nan() {
            continue;
        }
        samples += 1.0;
        let light = (v - range[0]).clamp(0.0, range[1] - range[0]);
        // Noise of the dark ground far from the bar would pull its middle.
        if light > 0.1 * (range[1] - range[0]) {
            sum += light;
            moment += light * k as f64;
        }
        width += f64::from(v > half);
    }
    let enough = samples > 0.0 && width > 0.0 && sum > 0.0;
    enough.then(|| (moment / sum, width * length as f64 / samples))
}

fn of_bars(plane: &Plane, speed: [f64; 2]) -> Result<Rolling, MeasureError> {
    let range = levels(plane);
    let mut all = Vec::new();
    // A bar that moves to the right leans over rows, one that moves down leans over columns.
    for (columns, speed) in [(false, speed[0]), (true, speed[1])] {
        if speed == 0.0 {
            continue;
        }
        let [lines, length] = lines_of(plane, columns);
        let found: Vec<(f64, f64, f64)> =
            (0..lines).filter_map(|line| bar(plane, columns, line, range).map(|(at, width)| (line as f64, at, width))).collect();
        let mut widths: Vec<f64> = found.iter().map(|f| f.2).collect();
        widths.sort_by(f64::total_cmp);
        let Some(median) = widths.get(widths.len() / 2).copied() else { continue };
        // Lines that another bar crosses, and bars that leave the picture.
        let whole = |f: &&(f64, f64, f64)| {
            f.2 < WIDER * median && f.2 > median / WIDER && f.1 > 0.5 * f.2 && f.1 < length as f64 - 0.5 * f.2
        };
        let points: Vec<(f64, f64)> = found.iter().filter(whole).map(|f| (f.0, f.1)).collect();
        if points.len() >= FEWEST_LINES && 2.0 * median < length as f64 {
            all.extend(lean(points, lines).map(|l| (columns, speed, l)));
        }
    }
    let strongest = all.into_iter().max_by(|a, b| (a.2.slope * a.2.lines).abs().total_cmp(&(b.2.slope * b.2.lines).abs()));
    let Some((columns, speed, lean)) = strongest.filter(|a| {
        let l = &a.2;
        (l.slope * l.lines).abs() > LEAST_LEAN && l.slope.abs() > 4.0 * l.error
    }) else {
        let expected = "a bright bar before a dark ground that moves fast enough to lean (\"moving-bars\"); a shutter that opens everywhere at once shows none";
        return Err(MeasureError::unfit("picture", "no bar that leans", expected));
    };
    // Within the picture a bar leans by no more than its width.
    let across = lines_of(plane, columns)[1];
    if (lean.slope * lean.lines).abs() > 2.0 * across as f64 {
        let found = format!("a bar that leans by {:.0} of {across} pixels", (lean.slope * lean.lines).abs());
        return Err(MeasureError::unfit(
            "picture",
            found,
            "a bar across the way it moves along: --speed is X,Y, to the right and down",
        ));
    }
    let forward = lean.slope * speed > 0.0;
    let direction = match (columns, forward) {
        (false, true) => "down",
        (false, false) => "up",
        (true, true) => "right",
        (true, false) => "left",
    };
    let line_time_s = (lean.slope / speed).abs();
    Ok(Rolling {
        columns,
        direction: Some(direction),
        line_time_s,
        line_time_error_s: (lean.error / speed).abs(),
        readout_s: line_time_s * lean.lines,
        lines: lean.lines as usize,
        period_lines: None,
        amplitude: None,
        lean_px: Some(lean.slope * lean.lines),
        fitted: lean.points.iter().map(|p| lean.offset + lean.slope * p.0).collect(),
        points: lean.points,
    })
}

/// A straight line through the places of a bar.
struct Lean {
    slope: f64,
    offset: f64,
    error: f64,
    lines: f64,
    points: Vec<(f64, f64)>,
}

/// Least squares; points farther than three deviations are left out, and it is fitted again.
fn lean(mut points: Vec<(f64, f64)>, lines: usize) -> Option<Lean> {
    for round in 0..4 {
        let middle = 0.5 * lines as f64;
        let rows = points.iter().map(|p| (vec![1.0, (p.0 - middle) / middle], p.1));
        let c = least_squares(rows, 2)?;
        let off = |p: &(f64, f64)| p.1 - c[0] - c[1] * (p.0 - middle) / middle;
        let n = points.len() as f64;
        let deviation = (points.iter().map(|p| off(p).powi(2)).sum::<f64>() / (n - 2.0).max(1.0)).sqrt();
        let slope = c[1] / middle;
        let kept: Vec<_> = points.iter().copied().filter(|p| off(p).abs() <= (3.0 * deviation).max(1e-9)).collect();
        if round == 3 || kept.len() == points.len() || kept.len() < FEWEST_LINES {
            let mean = points.iter().map(|p| p.0).sum::<f64>() / n;
            let spread = points.iter().map(|p| (p.0 - mean).powi(2)).sum::<f64>();
            let error = deviation / spread.sqrt().max(1e-9);
            return Some(Lean { slope, offset: c[0] - slope * middle, error, lines: lines as f64, points });
        }
        points = kept;
    }
    None
}

/// Dark ground and bright bar: the values that 10 % of the samples lie below and 2 % above.
fn levels(plane: &Plane) -> [f64; 2] {
    let mut all: Vec<f64> = plane.samples(plane.whole()).collect();
    all.sort_by(f64::total_cmp);
    let at = |part: f64| all.get((part * all.len() as f64) as usize).copied().unwrap_or(0.0);
    [at(0.1), at(0.98)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(width: usize, height: usize, of: impl Fn(usize, usize) -> f64) -> Plane {
        let values = (0..width * height).map(|i| of(i % width, i / width) as f32).collect();
        Plane { width, height, values, limits: [f32::NEG_INFINITY, f32::INFINITY], clipped: None }
    }

    /// Even numbers from 0 to 1, by a hash of two.
    fn noise(x: usize, y: usize) -> f64 {
        let mut h = (x as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (y as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
        h = (h ^ (h >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        ((h ^ (h >> 32)) & 0xffff_ffff) as f64 / 4_294_967_296.0
    }

    #[test]
    fn bands_tell_the_time_from_row_to_row() {
        // 100 µs a row, a lamp of 100 Hz: 100 rows a period; 2.4 bands in 240 rows, with fall-off and noise of 5 %.
        for (columns, line_time) in [(false, 1e-4), (true, 1e-4), (false, 3.7e-4)] {
            let picture = plane(240, 240, |x, y| {
                let (line, r2) = (if columns { x } else { y } as f64, (x as f64 - 120.0).powi(2) + (y as f64 - 120.0).powi(2));
                (1.0 - 1e-5 * r2) * (1.0 + 0.2 * (TAU * 100.0 * line_time * line + 0.4).sin()) + 0.1 * (noise(x, y) - 0.5)
            });
            let found = measure(&picture, Sign::Flicker(100.0)).unwrap();
            assert_eq!((found.columns, found.direction, found.lines), (columns, None, 240));
            // A row's mean has a noise of 0.19 %: the frequency is good to 0.1 %.
            assert!((found.line_time_s / line_time - 1.0).abs() < 5e-3, "{} {line_time}", found.line_time_s);
            assert!((found.amplitude.unwrap() - 0.2).abs() < 0.01 && found.line_time_error_s < 2e-3 * line_time, "{found:?}");
        }
    }

    #[test]
    fn bands_are_dimmed_as_their_ground_is() {
        // A portrait frame at cos⁴ of 27° in its corners, a lamp that nearly goes out: 2.4 bands, with noise and without.
        for (noisy, amplitude) in [(0.0, 0.787), (0.02, 0.787), (0.02, 0.2)] {
            let picture = plane(120, 240, |x, y| {
                let r2 = ((x as f64 - 60.0).powi(2) + (y as f64 - 120.0).powi(2)) / 120f64.powi(2);
                let light = (1.0 + 0.264 * r2).powi(-2) * (1.0 + amplitude * (TAU * 0.01 * y as f64 + 1.1).sin());
                light + noisy * (noise(x, y) - 0.5)
            });
            let found = measure(&picture, Sign::Flicker(100.0)).unwrap();
            assert!((found.line_time_s / 1e-4 - 1.0).abs() < 3e-3, "{amplitude}: {}", found.line_time_s);
            assert!((found.amplitude.unwrap() - amplitude).abs() < 0.01, "{found:?}");
            assert!((found.line_time_s - 1e-4).abs() < 5.0 * found.line_time_error_s + 2e-7, "{}", found.line_time_error_s);
        }
        // The same without a lamp.
        let picture = plane(120, 240, |x, y| {
            let r2 = ((x as f64 - 60.0).powi(2) + (y as f64 - 120.0).powi(2)) / 120f64.powi(2);
            (1.0 + 0.264 * r2).powi(-2)
        });
        assert!(measure(&picture, Sign::Flicker(100.0)).unwrap_err().to_string().contains("no bands"));
    }

    #[test]
    fn a_bar_leans_by_its_way_and_tells_which_row_comes_first() {
        // 2000 px/s and 50 µs a row: 0.1 px a row. Raw mosaics have every other pixel.
        for (columns, speed, line_time, direction) in [
            (false, [2000.0, 0.0], 5e-5, "down"),
            (false, [2000.0, 500.0], -5e-5, "up"),
            (true, [0.0, 2000.0], 5e-5, "right"),
            (true, [0.0, -2000.0], 5e-5, "right"),
            (true, [0.0, 2000.0], -5e-5, "left"),
        ] {
            let moving = if columns { speed[1] } else { speed[0] };
            let picture = plane(240, 160, |x, y| {
                if (x + y) % 2 == 1 {
                    return f64::NAN;
                }
                let (line, along) = if columns { (x, y) } else { (y, x) };
                let at = if columns { 80.0 } else { 120.0 } + moving * line_time * (line as f64 - 80.0);
                let edge = |d: f64| (0.5 + d).clamp(0.0, 1.0);
                0.03 + 0.8 * edge(12.0 - (along as f64 - at).abs()) + 0.02 * noise(x, y)
            });
            let found = measure(&picture, Sign::Motion(speed)).unwrap();
            assert_eq!((found.columns, found.direction), (columns, Some(direction)), "{found:?}");
            assert!((found.line_time_s / 5e-5 - 1.0).abs() < 0.01, "{}", found.line_time_s);
        }
    }

    #[test]
    fn pictures_without_a_sign_are_refused() {
        let told = |p: &Plane, sign| measure(p, sign).unwrap_err().to_string();
        let even = plane(64, 64, |x, y| 1.0 + 0.1 * noise(x, y));
        assert!(told(&even, Sign::Flicker(100.0)).contains("no bands"));
        // More than any light, as around a black level that is not that of the picture.
        let waves = plane(64, 64, |_, y| 0.3 + (0.4 * y as f64).cos());
        assert!(told(&waves, Sign::Flicker(100.0)).contains("% of the mean"), "{}", told(&waves, Sign::Flicker(100.0)));
        assert!(told(&even, Sign::Motion([100.0, 0.0])).contains("no bar"));
        let upright = plane(64, 64, |x, y| if (28..36).contains(&x) { 1.0 } else { 0.01 * noise(x, y) });
        assert!(told(&upright, Sign::Motion([100.0, 0.0])).contains("no bar that leans"));
        assert!(told(&plane(8, 8, |_, _| 1.0), Sign::Flicker(100.0)).contains("8 × 8"));
    }
}
