//! Spatial frequency response of slanted edges (e-SFR), by ISO 12233:2023.
//!
//! Rows across the edge are differentiated and windowed; their centroids, fitted by a polynomial, are the edge. Every pixel is projected along it
//! into bins of a quarter of a pixel: the edge spread function (ESF), oversampled 4 times. Its derivative, windowed, is the line spread function
//! (LSF); the magnitude of that one's Fourier transform, 1 at frequency 0, is the response. Frequencies are cycles a pixel *across the edge*
//! (those along the rows, over the cosine of the slant). Two things are divided out: the derivative filter [−½ 0 ½], and the bins, by the mean
//! of exp(−2πi f δ) over the places δ of the samples within them (sinc(f/4) where they lie evenly). The standard corrects for the first only;
//! the second is 2.5 % at half a cycle a pixel.
//!
//! The mosaic of a raw image needs no demosaicing: only pixels of one channel are projected. Where a channel has fewer pixels the edge must be
//! longer for the same noise, and what its pixels alias moves the edge: red and blue of a Bayer pattern are good to about 0.03.
//!
//! Sources: ISO 12233:2023, Photography – Electronic still picture imaging – Resolution and spatial frequency responses, clause on e-SFR and its
//! annex; P. D. Burns, "Slanted-edge MTF for digital camera and scanner analysis", PICS 2000; P. D. Burns, K. Masaoka, K. Parulski &
//! D. Wueller, "Updated camera spatial frequency response for ISO 12233", EI 2022 (fits of higher order, Tukey window).

mod find;

pub use self::find::{find, measure_at};

use super::fit::{polynomial, value};
use super::{MeasureError, Plane, Region};
use serde::Serialize;
use std::f64::consts::{PI, TAU};

/// Bins of a pixel. Source: ISO 12233.
const OVERSAMPLING: f64 = 4.0;
/// Smallest side of a region, pixels.
pub const LEAST_SIDE: usize = 16;
/// Least distance of the edge from the sides of its region, pixels: the LSF must come to its end.
const LEAST_REACH: f64 = 6.0;
/// Fraction of a region's samples that may be clipped.
const MOST_CLIPPED: f64 = 0.02;
/// Fraction of the variance of a region that its edge must explain, for the edge to be one.
const LEAST_EXPLAINED: f64 = 0.9;
/// Fraction of all bins that may hold no sample: they are interpolated.
const MOST_EMPTY: f64 = 0.05;
/// Largest deviation of the outer eighths of the edge spread function from their means, of the step.
const MOST_UNEVEN: f64 = 0.15;
/// A row whose pixels deviate from the edge spread function by a mean square of this many times that of the row in the middle, and by this
/// fraction of the step from dark to light, shows something else: a corner, another edge. Noise alone stays far below: of 30 pixels a row its mean
/// square deviates by a quarter.
const MOST_ROW_RATIO: f64 = 4.0;
const LEAST_ROW_DEVIATION: f64 = 0.02;
/// Root mean square of the distance of the rows' centroids from the fitted edge, pixels, beyond which it is none.
const MOST_RESIDUAL: f64 = 1.0;
/// The same where rows beside one another deviate alike, by this ratio of the squares of their differences to those of the deviations (2 of noise; J. Durbin & G. S. Watson, "Testing
/// for serial correlation in least squares regression", Biometrika 37, 1950): a stepped edge, or another shape.
const MOST_STEPPED: f64 = 0.2;
const LEAST_ROUGHNESS: f64 = 0.4;
/// How often the edge is fitted: each window is centred by the fit before. The first two fits are straight lines.
const FITS: usize = 5;
/// Steps of the response, up to one cycle a pixel.
const STEPS: usize = 100;
/// What the line spread function is multiplied by.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Window {
    /// Flat, with sides of half a cosine: `alpha` is how much of it the sides take, 1 makes it a Hann window.
    Tukey {
        /// 0 to 1.
        alpha: f64,
    },
    /// 0.54 + 0.46 cos, as in the editions before 2023.
    Hamming,
}

impl Window {
    /// Its value at −1 to 1; 0 beyond.
    pub(super) fn at(self, u: f64) -> f64 {
        let u = u.abs();
        if u >= 1.0 {
            return 0.0;
        }
        match self {
            Window::Hamming => 0.54 + 0.46 * (PI * u).cos(),
            Window::Tukey { alpha } => {
                let flat = 1.0 - alpha;
                if u <= flat { 1.0 } else { 0.5 + 0.5 * (PI * (u - flat) / alpha).cos() }
            }
        }
    }
}

/// How edges are measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Order of the polynomial that the edge is fitted by: 1 straight, 2 and more for edges that the lens bends.
    pub order: usize,
    /// Window of the line spread function. One that is flat in the middle does not broaden wide blurs, as a Hann window does.
    pub window: Window,
    /// Half of the window's width, pixels along the rows, at most; as wide as the region allows without. The narrower, the less noise, and the less
    /// is seen of halos and stray light.
    pub reach: Option<f64>,
}

impl Default for Options {
    fn default() -> Self {
        Options { order: 2, window: Window::Tukey { alpha: 0.5 }, reach: None }
    }
}

impl Options {
    fn check(&self) -> Result<(), MeasureError> {
        if !(1..=5).contains(&self.order) {
            return Err(MeasureError::unfit("order of the edge", self.order.to_string(), "1 (straight) to 5"));
        }
        if let Some(reach) = self.reach.filter(|r| !(*r >= LEAST_REACH)) {
            return Err(MeasureError::unfit(
                "half width of the window",
                format!("{reach} pixels"),
                format!("{LEAST_REACH} and more"),
            ));
        }
        match self.window {
            Window::Tukey { alpha } if !(0.0..=1.0).contains(&alpha) => {
                Err(MeasureError::unfit("Tukey window", format!("alpha {alpha}"), "0 (rectangle) to 1 (Hann)"))
            }
            _ => Ok(()),
        }
    }
}

/// An edge and its response.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EdgeMtf {
    /// Where it was measured.
    pub region: Region,
    /// Whether the edge runs nearer to the rows than to the columns (contrast across it is then mostly vertical).
    pub horizontal: bool,
    /// Its angle from the columns (from the rows, where [`EdgeMtf::horizontal`]), degrees; positive where it moves right going down (down, going
    /// right).
    pub angle_deg: f64,
    /// Direction across the edge: unit vector, right and down.
    pub across: [f64; 2],
    /// Middle of the edge in the picture, pixels (the middle of the upper left pixel is 0.5, 0.5).
    pub middle: [f64; 2],
    /// Root mean square of the distance of the rows' centroids from the fit, pixels.
    pub residual_px: f64,
    /// How far the fit bends away from a straight line within the region, pixels.
    pub bow_px: f64,
    /// Levels of both sides, dark and light.
    pub levels: [f64; 2],
    /// (light − dark) / (light + dark).
    pub contrast: f64,
    /// Root mean square of what the edge does not explain over the step from dark to light: mostly noise.
    pub noise: f64,
    /// Spatial frequencies, cycles a pixel: 0 to 1.
    pub frequencies: Vec<f64>,
    /// Response at them.
    pub mtf: Vec<f64>,
    /// Frequency at which the response first falls to one half, cycles a pixel; `None` where it does not up to 1.
    pub mtf50: Option<f64>,
    /// To one tenth: the limit of what is seen.
    pub mtf10: Option<f64>,
    /// At half a cycle a pixel.
    pub at_nyquist: f64,
    /// Edge spread function: distance across the edge (pixels) and level (0 dark to 1 light).
    pub esf: Vec<[f64; 2]>,
    /// Window of the line spread function, and half of its width across the edge, pixels: light that falls beyond is not seen, and the response is 1 at frequency 0
    /// without it.
    #[serde(skip)]
    pub window: (Window, f64),
    /// Distance from the edge up to which every row takes part, pixels.
    pub reach_px: f64,
}

impl EdgeMtf {
    /// Response at a frequency in cycles a pixel, interpolated; 0 beyond one cycle a pixel.
    pub fn at(&self, frequency: f64) -> f64 {
        let place = frequency.abs() * STEPS as f64;
        let first = place as usize;
        let Some(next) = self.mtf.get(first + 1) else { return if place <= STEPS as f64 { self.mtf[STEPS] } else { 0.0 } };
        self.mtf[first] + (next - self.mtf[first]) * (place - first as f64)
    }
}

/// The samples of a row of a region, as its edge crosses it: places and values.
type Row = Vec<(f64, f64)>;

/// Measures the edge within a region. Fails on options out of range, on a region outside the picture or below [`LEAST_SIDE`] pixels a side, where more than 2 % of it is
/// clipped, and where it does not show one straight edge, slanted enough, between two even fields.
pub fn measure(plane: &Plane, region: Region, options: &Options) -> Result<EdgeMtf, MeasureError> {
    options.check()?;
    plane.check(region, LEAST_SIDE)?;
    let place = region.to_string();
    let no_edge = |found: String| {
        MeasureError::unfit(place.clone(), found, "one straight edge between two even fields, slanted by about 5°")
    };
    let [low, high] = plane.clipped(region);
    if low.max(high) > MOST_CLIPPED {
        let side = if low > high { "black" } else { "white" };
        return Err(MeasureError::unfit(
            place,
            format!("{:.1} % of its pixels are clipped to {side}", 100.0 * low.max(high)),
            "both sides of the edge between black and white: expose it otherwise",
        ));
    }

    // Rows across the edge: those of the region, or its columns.
    let horizontal = {
        let [along_x, along_y] = [false, true].map(|turned| mean_square_step(&rows_of(plane, region, turned)));
        along_y > along_x
    };
    let rows = rows_of(plane, region, horizontal);
    let [across, along] = if horizontal { [region.height, region.width] } else { [region.width, region.height] };
    let fit = Fit::new(&rows, across, options.order).ok_or_else(|| no_edge("no edge found".into()))?;
    let has_steps = fit.residual > MOST_STEPPED && fit.roughness < LEAST_ROUGHNESS;
    if fit.residual > MOST_RESIDUAL || has_steps {
        return Err(no_edge(format!("no straight edge: rows deviate by {:.1} pixels from the fit", fit.residual)));
    }

    // Whole periods of the pattern of phases, so that all of them count alike: the edge moves by whole pixels.
    let slope = fit.slope;
    let moves = (along as f64 * slope.abs() + 1e-9).floor();
    if moves < 1.0 {
        return Err(MeasureError::unfit(
            place,
            format!("the edge is too upright: it moves {:.2} pixels in {along}", along as f64 * slope.abs()),
            "one that moves by a pixel or more: slanted by about 5°, or a longer region",
        ));
    }
    let used = ((moves / slope.abs()).round() as usize).clamp(1, along);
    let first = (along - used) / 2;
    let edge: Vec<f64> = (0..along).map(|y| fit.at(y)).collect();
    let ends = edge[first..first + used].iter().fold([f64::MAX, f64::MIN], |[a, b], x| [a.min(*x), b.max(*x)]);
    // Distances at which every row takes part.
    let reach = ends[0].min(across as f64 - 1.0 - ends[1]);
    if reach < LEAST_REACH {
        let angle = slope.atan().to_degrees().abs();
        return Err(MeasureError::unfit(
            place,
            format!(
                "the edge is too steep or too near to the sides: at {angle:.1}° it comes within {:.1} pixels of them",
                reach.max(0.0)
            ),
            format!("{LEAST_REACH:.0} pixels and more: slanted by about 5°, in the middle of the region"),
        ));
    }

    // Project along the edge.
    let bins = 2 * (reach * OVERSAMPLING) as usize;
    let (mut sums, mut counts) = (vec![0.0; bins], vec![0.0f64; bins]);
    // Bin, place in it (pixels from its middle) and value of each sample; where rows end.
    let mut projected = Vec::new();
    let mut ends_of_rows = Vec::with_capacity(used);
    for (row, edge) in rows[first..first + used].iter().zip(&edge[first..first + used]) {
        for (x, v) in row {
            let scaled = (x - edge) * OVERSAMPLING;
            let bin = scaled.floor() + bins as f64 / 2.0;
            if (0.0..bins as f64).contains(&bin) {
                let bin = bin as usize;
                sums[bin] += v;
                counts[bin] += 1.0;
                projected.push((bin, (scaled - scaled.floor() - 0.5) / OVERSAMPLING, *v));
            }
        }
        ends_of_rows.push(projected.len());
    }
    let empty = counts.iter().filter(|n| **n == 0.0).count();
    if empty as f64 > MOST_EMPTY * bins as f64 {
        return Err(MeasureError::unfit(
            place,
            format!("{empty} of {bins} quarters of a pixel across the edge hold no sample at {:.1}°", slope.atan().to_degrees()),
            "another slant (about 5°) or a longer edge",
        ));
    }
    let mut esf: Vec<f64> = sums.iter().zip(&counts).map(|(s, n)| if *n > 0.0 { s / n } else { f64::NAN }).collect();
    fill_gaps(&mut esf);
    let distance = |bin: f64| (bin - bins as f64 / 2.0 + 0.5) / OVERSAMPLING;

    // How well the edge explains what is seen.
    let count = projected.len() as f64;
    let mean = projected.iter().map(|p| p.2).sum::<f64>() / count;
    let squares: Vec<f64> =
        projected.iter().map(|(bin, at, v)| (v - interpolated(&esf, *bin as f64 + at * OVERSAMPLING)).powi(2)).collect();
    let unexplained = squares.iter().sum::<f64>() / count;
    let variance = projected.iter().map(|p| (p.2 - mean).powi(2)).sum::<f64>() / count;
    if !(unexplained < (1.0 - LEAST_EXPLAINED) * variance) {
        let percent = 100.0 * (1.0 - unexplained / variance.max(1e-300)).max(0.0);
        return Err(no_edge(format!("no edge found: a straight one explains {percent:.0} % of what differs")));
    }
    let end = (bins / 8).max(1);
    let level = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    let (left, right) = (level(&esf[..end]), level(&esf[bins - end..]));
    let step = right - left;
    let range = esf.iter().fold([f64::MAX, f64::MIN], |[a, b], v| [a.min(*v), b.max(*v)]);
    // A line, or several edges, come back to where they started; overshoots of sharpening stay below half of the step.
    if !(step.abs() > 0.5 * (range[1] - range[0])) {
        return Err(no_edge("no single edge: a line, or several edges".into()));
    }

    // Wide blurs, and what lies beyond the fields beside the edge.
    let uneven = |part: &[f64], level: f64| part.iter().map(|v| (v - level).abs()).fold(0.0, f64::max) / step.abs();
    let worst = uneven(&esf[..end], left).max(uneven(&esf[bins - end..], right));
    if worst > MOST_UNEVEN {
        return Err(no_edge(format!(
            "{reach:.0} pixels from the edge it is not even (by {:.0} % of the step): the blur is wider, or something else begins",
            100.0 * worst
        )));
    }
    let starts = [0].into_iter().chain(ends_of_rows.iter().copied());
    let mut of_rows: Vec<f64> = starts
        .zip(&ends_of_rows)
        .filter(|(start, end)| start < end)
        .map(|(start, end)| squares[start..*end].iter().sum::<f64>() / (end - start) as f64)
        .collect();
    of_rows.sort_by(f64::total_cmp);
    let most = MOST_ROW_RATIO * of_rows[of_rows.len() / 2] + (LEAST_ROW_DEVIATION * step).powi(2);
    let others = of_rows.iter().filter(|v| **v > most).count();
    if others > 0 {
        return Err(no_edge(format!("{others} of {} rows across the edge show something else beside it", of_rows.len())));
    }

    // Differentiate, window, transform.
    let mut lsf = vec![0.0; bins];
    (1..bins - 1).for_each(|k| lsf[k] = 0.5 * (esf[k + 1] - esf[k - 1]));
    let hann = Window::Tukey { alpha: 1.0 };
    let weighed = |k: usize| lsf[k] * hann.at(distance(k as f64) / reach);
    let middle = (0..bins).map(|k| weighed(k) * distance(k as f64)).sum::<f64>() / (0..bins).map(weighed).sum::<f64>();
    let half = (reach - middle.abs()).max(0.5 * LEAST_REACH).min(options.reach.unwrap_or(f64::MAX));
    lsf.iter_mut().enumerate().for_each(|(k, v)| *v *= options.window.at((distance(k as f64) - middle) / half));
    let cos = slope.atan().cos();
    let offsets = Offsets::new(&projected, &lsf);
    let transform = |f: f64| {
        let (re, im) = lsf.iter().enumerate().fold((0.0, 0.0), |(re, im), (k, v)| {
            let (sin, cos) = (TAU * f * distance(k as f64)).sin_cos();
            (re + v * cos, im + v * sin)
        });
        f64::hypot(re, im)
    };
    let total = transform(0.0);
    let frequencies: Vec<f64> = (0..=STEPS).map(|k| k as f64 / STEPS as f64).collect();
    let response = |f: &f64| {
        // Along the rows it is lower.
        let f = f * cos;
        transform(f) / total / (sinc(2.0 * f / OVERSAMPLING) * offsets.transfer(f))
    };
    let mtf: Vec<f64> = frequencies.iter().map(response).collect();
    // Where it first falls to a level: between two steps by halving, since a wide blur falls in less than one.
    let falls_to = |level: f64| {
        let k = mtf.windows(2).position(|w| w[0] >= level && w[1] < level)?;
        let [mut low, mut high] = [frequencies[k], frequencies[k + 1]];
        for _ in 0..30 {
            let middle = 0.5 * (low + high);
            if response(&middle) >= level { low = middle } else { high = middle }
        }
        Some(0.5 * (low + high))
    };
    let [mtf50, mtf10] = [0.5, 0.1].map(falls_to);

    let (dark, light) = (left.min(right), left.max(right));
    let normal = [cos, -slope * cos];
    let middle_along = 0.5 * along as f64;
    let middle_across = fit.middle() + 0.5;
    let chord = |y: f64| edge[0] + (edge[along - 1] - edge[0]) * y / (along - 1) as f64;
    let bow_px = edge.iter().enumerate().map(|(y, x)| (x - chord(y as f64)).abs()).fold(0.0, f64::max);
    let turn = |v: [f64; 2]| if horizontal { [v[1], v[0]] } else { v };
    let [x, y] = turn([middle_across, middle_along]);
    let mut found = EdgeMtf {
        region,
        horizontal,
        angle_deg: slope.atan().to_degrees(),
        across: turn(normal),
        middle: [x + region.x as f64, y + region.y as f64],
        residual_px: fit.residual,
        bow_px,
        levels: [dark, light],
        contrast: (light - dark) / (light + dark),
        noise: unexplained.sqrt() / (light - dark),
        frequencies,
        mtf,
        mtf50,
        mtf10,
        at_nyquist: 0.0,
        esf: esf.iter().enumerate().map(|(k, v)| [distance(k as f64) * cos, (v - dark) / (light - dark)]).collect(),
        window: (options.window, half * cos),
        reach_px: reach * cos,
    };
    found.at_nyquist = found.at(0.5);
    Ok(found)
}

/// The rows of a region, or its columns: places (from 0, the middle of the first pixel) and values.
fn rows_of(plane: &Plane, r: Region, turned: bool) -> Vec<Row> {
    let [across, along] = if turned { [r.height, r.width] } else { [r.width, r.height] };
    let value = |x: usize, y: usize| if turned { plane.at(r.x + y, r.y + x) } else { plane.at(r.x + x, r.y + y) };
    let row = |y: usize| (0..across).map(|x| (x as f64, value(x, y))).filter(|p| !p.1.is_nan()).collect();
    (0..along).map(row).collect()
}

/// Mean of the squares of the steps between neighbours in rows, a pixel apart or not.
fn mean_square_step(rows: &[Row]) -> f64 {
    let steps = rows.iter().flat_map(|row| row.windows(2).map(|w| (w[1].1 - w[0].1).powi(2) / (w[1].0 - w[0].0)));
    let (sum, count) = steps.fold((0.0, 0.0f64), |(s, n), v| (s + v, n + 1.0));
    sum / count.max(1.0)
}

/// The edge of a region: a polynomial.
struct Fit {
    coefficients: Vec<f64>,
    along: usize,
    /// Pixels to the right in a row, in the middle.
    slope: f64,
    residual: f64,
    /// Squares of the differences of the deviations of neighbours over those of the deviations.
    roughness: f64,
}

impl Fit {
    /// Place along the edge, −1 to 1, of a row.
    fn relative(y: usize, along: usize) -> f64 {
        (2.0 * y as f64 + 1.0) / along as f64 - 1.0
    }

    /// Where the edge crosses a row.
    fn at(&self, y: usize) -> f64 {
        value(&self.coefficients, Self::relative(y, self.along))
    }

    /// Where it crosses the middle of the region.
    fn middle(&self) -> f64 {
        self.coefficients[0]
    }

    /// Through the centroids of the rows' derivatives.
    fn new(rows: &[Row], across: usize, order: usize) -> Option<Fit> {
        let along = rows.len();
        let half = 0.5 * across as f64;
        let mut fit = Fit { coefficients: vec![half - 0.5], along, slope: 0.0, residual: f64::MAX, roughness: 2.0 };
        let hann = Window::Tukey { alpha: 1.0 };
        for round in 0..FITS {
            let mut found = Vec::with_capacity(along);
            for (y, row) in rows.iter().enumerate() {
                let centre = fit.at(y);
                let (mut sum, mut moment) = (0.0, 0.0);
                for w in row.windows(2) {
                    let x = 0.5 * (w[0].0 + w[1].0);
                    let weighed = (w[1].1 - w[0].1) * hann.at((x - centre) / half);
                    sum += weighed;
                    moment += weighed * x;
                }
                if sum != 0.0 {
                    found.push((Self::relative(y, along), moment / sum, sum));
                }
            }
            // Rows whose step is small or of the other sign do not cross the edge.
            let mut steps: Vec<f64> = found.iter().map(|f| f.2).collect();
            steps.sort_by(f64::total_cmp);
            let median = *steps.get(steps.len() / 2)?;
            let good: Vec<(f64, f64)> = found.iter().filter(|f| f.2 / median > 0.3).map(|f| (f.0, f.1)).collect();
            let sampled = rows.iter().filter(|r| r.len() > 1).count();
            // At first the window hides what is far from the middle.
            let least = if round < 2 { 0.5 } else { 0.75 };
            if (good.len() as f64) < least * sampled as f64 {
                return None;
            }
            let order = if round < 2 { 1 } else { order };
            fit.coefficients = polynomial(&good, order)?;
            fit.slope = fit.coefficients[1] * 2.0 / along as f64;
            let off: Vec<f64> = good.iter().map(|(t, x)| x - value(&fit.coefficients, *t)).collect();
            let squares = off.iter().map(|d| d * d).sum::<f64>();
            fit.residual = (squares / good.len() as f64).sqrt();
            fit.roughness = off.windows(2).map(|d| (d[1] - d[0]).powi(2)).sum::<f64>() / squares.max(1e-300);
        }
        fit.residual.is_finite().then_some(fit)
    }
}

/// Where samples lie in their bins, weighed by the LSF there: what averaging in bins does to frequencies.
struct Offsets {
    histogram: [f64; Self::CELLS],
}

impl Offsets {
    const CELLS: usize = 32;

    fn new(projected: &[(usize, f64, f64)], lsf: &[f64]) -> Self {
        let mut histogram = [0.0; Self::CELLS];
        for (bin, at, _) in projected {
            let cell = (at * OVERSAMPLING + 0.5) * Self::CELLS as f64;
            histogram[(cell as usize).min(Self::CELLS - 1)] += lsf[*bin].abs();
        }
        let total: f64 = histogram.iter().sum();
        histogram.iter_mut().for_each(|v| *v /= total);
        Offsets { histogram }
    }

    /// |mean of exp(−2πi f δ)|
    fn transfer(&self, f: f64) -> f64 {
        let (re, im) = self.histogram.iter().enumerate().fold((0.0, 0.0), |(re, im), (k, w)| {
            let at = ((k as f64 + 0.5) / Self::CELLS as f64 - 0.5) / OVERSAMPLING;
            let (sin, cos) = (TAU * f * at).sin_cos();
            (re + w * cos, im + w * sin)
        });
        f64::hypot(re, im)
    }
}

/// Puts straight lines where there are no numbers.
fn fill_gaps(values: &mut [f64]) {
    let known: Vec<usize> = (0..values.len()).filter(|k| !values[*k].is_nan()).collect();
    let [Some(first), Some(last)] = [known.first(), known.last()].map(|k| k.copied()) else { return };
    let (low, high) = (values[first], values[last]);
    values[..first].fill(low);
    values[last + 1..].fill(high);
    for pair in known.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        for k in a + 1..b {
            values[k] = values[a] + (values[b] - values[a]) * (k - a) as f64 / (b - a) as f64;
        }
    }
}

/// Value between numbers.
fn interpolated(values: &[f64], at: f64) -> f64 {
    let at = at.clamp(0.0, values.len() as f64 - 1.0);
    let first = (at as usize).min(values.len() - 2);
    values[first] + (values[first + 1] - values[first]) * (at - first as f64)
}

/// sin(πx) / (πx); 1 at 0.
pub fn sinc(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { (PI * x).sin() / (PI * x) }
}

#[cfg(test)]
mod tests;
