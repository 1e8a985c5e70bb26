//! Tone response, noise and dynamic range from a step wedge.
//!
//! Fields of known density lie in rows and columns (ISO 14524: the opto-electronic conversion function is the output over the logarithm of the light that comes in). Of each
//! the middle is averaged; its noise is what is left without a plane, so that fall-off of the lens within a field does not count. Of one picture that is the total noise; of two
//! and more of the same exposure the temporal noise is known apart, by what differs from picture to picture at each pixel (ISO 15739). The signal-to-noise ratio is that of the light: luminance times the incremental
//! gain over the noise, so that no tone curve changes it. The dynamic range is the luminance at which the output is saturated over that at which this ratio is 1 (ISO 15739; of one picture: by total noise).

use super::corners::{Corners, framed, projective};
use super::fit::least_squares;
use super::{Channel, MeasureError, Measured, Plane};
use diopter_scene::builtin::charts::{FRAMING, WEDGE_DENSITY, WEDGE_FIELD, WEDGE_GRID, WEDGE_STEP};
use diopter_sensor::noise::normal_quantile;
use glam::DVec2;
use serde::Serialize;

/// Fraction of a field's side that is averaged.
const MIDDLE: f64 = 0.6;
/// Samples that a field must have.
const LEAST: usize = 50;
/// Fraction of a field's samples that may be clipped before its mean is no measure any more.
const MOST_CLIPPED: f64 = 0.002;
/// Fraction of them below 0 where the signal equals its noise: Φ(−1).
const MOST_BLACK: f64 = 0.16;
/// Fields that can be read darken with their density at least by this rank correlation, or they are no wedge. Fall-off and noise exchange neighbours of a wedge (0.99 and more);
/// what is no wedge has any order (of 20 fields at random ±0.23).
const LEAST_RANK: f64 = 0.8;
/// Means of pictures of one exposure may differ by this fraction.
const MOST_DIFFERENCE: f64 = 0.05;
/// And by this fraction of white.
const LEAST_DIFFERENCE: f64 = 1e-3;

/// A field of the chart.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Field {
    /// log₁₀ of the clear light over its own; with a flat field that of the light which the lens brings there.
    pub density: f64,
    /// Mean output, linear: of raw images (DN − black) / (white − black), of pictures decoded values.
    pub signal: f64,
    /// Standard deviation of a pixel, in the same unit, without a plane through the field.
    pub total_noise: f64,
    /// The part of it that differs from picture to picture; `None` of one picture.
    pub temporal_noise: Option<f64>,
    /// Incremental gain: by how much the signal rises where the light does by a factor e; `None` of one field alone and of clipped ones.
    pub incremental_gain: Option<f64>,
    /// Signal-to-noise ratio of the light: the incremental gain (without it, the signal) over temporal noise (total noise of one picture).
    pub snr: f64,
    /// Whether more than 0.2 % of its samples are clipped at white.
    pub saturated: bool,
    /// Whether a sixth of its samples or more are clipped at black, as where the signal is no larger than its noise: their ratio is then told by how many.
    pub clipped_to_black: bool,
    /// Samples in each picture.
    pub samples: usize,
}

/// The response of one channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Response {
    /// Name of the channel.
    pub channel: &'static str,
    /// As they lie on the chart.
    pub fields: Vec<Field>,
    /// Density whose light would just saturate the output, by the two brightest fields that do not; negative where the clear field is not bright enough. `None`
    /// without such fields, or of outputs that know no limit.
    pub saturation_density: Option<f64>,
    /// Density at which the signal-to-noise ratio is 1; `None` where all fields stand above their noise.
    pub noise_density: Option<f64>,
    /// Between the two, stops.
    pub dynamic_range_stops: Option<f64>,
    /// Slope of log signal over log light by the fields that stand 10 times above noise and below saturation; 1 of what is linear.
    pub gamma: Option<f64>,
}

/// Where the embedded chart lies in a picture of 3:2 that is framed by itself. Fails on another shape (by more than 3 %).
pub fn framed_wedge(size: [usize; 2]) -> Result<Corners, MeasureError> {
    // As its framing has it: a thin lens, focused on the chart.
    let seen = |n: usize| (f64::from(WEDGE_STEP) * (n as f64 - 1.0) + f64::from(WEDGE_FIELD)) * 1000.0;
    let (f, distance) = (FRAMING.focal_length_mm, 1000.0 * FRAMING.focus_m);
    let magnification = f / (distance - f);
    framed("step wedge", [seen(WEDGE_GRID[0]) * magnification / 36.0, seen(WEDGE_GRID[1]) * magnification / 24.0], size)
}

/// Measures one channel of pictures of the same exposure. `corners`: outer corners of the fields, pixels; the framing of the embedded chart without. `densities`: of the fields row
/// by row, log₁₀; those of the embedded chart without. `grid`: columns and rows.
/// `flat`: a picture of an even field by the same lens at the same aperture, whose fall-off is counted as density.
pub fn measure(
    pictures: &[Measured],
    channel: Channel,
    corners: Option<Corners>,
    grid: [usize; 2],
    densities: Option<&[f64]>,
    flat: Option<&Measured>,
) -> Result<Response, MeasureError> {
    let planes = pictures.iter().map(|p| p.plane(channel)).collect::<Result<Vec<Plane>, _>>()?;
    let Some(first) = planes.first() else {
        return Err(MeasureError::unfit("step wedge", "no pictures", "one picture, or several of the same exposure"));
    };
    if let Some(other) = planes.iter().find(|p| (p.width, p.height, p.limits) != (first.width, first.height, first.limits)) {
        return Err(MeasureError::unfit(
            "step wedge",
            format!(
                "pictures of {} × {} and {} × {} pixels, or of other levels",
                first.width, first.height, other.width, other.height
            ),
            "pictures of one camera and exposure",
        ));
    }
    let flat = flat.map(|f| f.plane(channel)).transpose()?;
    if let Some(f) = flat.as_ref().filter(|f| (f.width, f.height) != (first.width, first.height)) {
        return Err(MeasureError::unfit(
            "flat field",
            format!("{} × {} pixels; the chart's picture has {} × {}", f.width, f.height, first.width, first.height),
            "a picture of an even field of the same size",
        ));
    }
    let [columns, rows] = grid;
    let count = columns.checked_mul(rows).filter(|n| (2..=10_000).contains(n)).ok_or_else(|| {
        MeasureError::unfit("grid", format!("{columns} × {rows} fields"), "columns and rows of the fields, such as 5x4")
    })?;
    let embedded: Vec<f64> = (0..count).map(|k| WEDGE_DENSITY * k as f64).collect();
    let densities = densities.unwrap_or(&embedded);
    if densities.len() != count || densities.iter().any(|d| !d.is_finite()) {
        return Err(MeasureError::unfit(
            "densities",
            format!("{} numbers for {columns} × {rows} fields", densities.len()),
            "a density for each field, row by row from the upper left",
        ));
    }
    let corners = corners.map_or_else(|| framed_wedge([first.width, first.height]), Ok)?;
    let to_picture = projective(corners)
        .ok_or_else(|| MeasureError::unfit("corners", format!("{corners:?}"), "four corners of which no three are in line"))?;
    let fill = f64::from(WEDGE_FIELD / WEDGE_STEP);
    let extent = grid.map(|n| n as f64 - 1.0 + fill);
    let mut fields = densities
        .iter()
        .enumerate()
        .map(|(k, density)| {
            let middle = [(k % columns) as f64 + 0.5 * fill, (k / columns) as f64 + 0.5 * fill];
            let half = 0.5 * MIDDLE * fill;
            let corners = [[-half, -half], [half, -half], [half, half], [-half, half]]
                .map(|at| DVec2::from_array(to_picture([0, 1].map(|a| (middle[a] + at[a]) / extent[a]))));
            let seen = field(&planes, &corners, *density)?;
            let flat = flat.as_ref().map(|f| field(std::slice::from_ref(f), &corners, *density)).transpose()?;
            Ok((seen, flat))
        })
        .collect::<Result<Vec<(Field, Option<Field>)>, MeasureError>>()?;
    let brightest = fields.iter().filter_map(|(_, flat)| Some(flat.as_ref()?.signal)).fold(0.0, f64::max);
    for (seen, flat) in &mut fields {
        let Some(flat) = flat else { continue };
        if flat.saturated || flat.snr < 1.0 {
            let found = if flat.saturated { "clipped" } else { "dark" };
            let place = format!("flat field, at the field of density {}", seen.density);
            return Err(MeasureError::unfit(place, found, "an even field between black and white"));
        }
        seen.density += (brightest / flat.signal).log10();
    }
    let told: Vec<(f64, f64)> =
        fields.iter().map(|f| &f.0).filter(|f| !f.saturated && f.snr >= 1.0).map(|f| (f.density, f.signal)).collect();
    if let Some(rank) = rank_correlation(&told).filter(|rank| *rank > -LEAST_RANK) {
        return Err(MeasureError::unfit(
            "step wedge",
            format!("fields that do not darken as their densities say (rank correlation {:.2}, of a wedge -1)", rank + 0.0),
            "a photograph of the wedge: --corners x,y,x,y,x,y,x,y of its fields, --grid, --densities",
        ));
    }
    let fields = fields.into_iter().map(|f| f.0).collect();
    Ok(response(channel.name(), fields, f64::from(first.limits[1])))
}

/// Spearman's coefficient of pairs, ties by their mean rank (C. Spearman, The proof and measurement of association between two things, 1904); `None` of fewer than four.
fn rank_correlation(pairs: &[(f64, f64)]) -> Option<f64> {
    let n = pairs.len() as f64;
    let ranks = |of: &dyn Fn(&(f64, f64)) -> f64| -> Vec<f64> {
        let rank = |v: f64| {
            let below = pairs.iter().filter(|p| of(p) < v).count() as f64;
            let same = pairs.iter().filter(|p| of(p) == v).count() as f64;
            below + 0.5 * (same - 1.0) - 0.5 * (n - 1.0)
        };
        pairs.iter().map(|p| rank(of(p))).collect()
    };
    let (a, b) = (ranks(&|p| p.0), ranks(&|p| p.1));
    let dot = |u: &[f64], v: &[f64]| u.iter().zip(v).map(|(x, y)| x * y).sum::<f64>();
    let [ab, aa, bb] = [dot(&a, &b), dot(&a, &a), dot(&b, &b)];
    // Fields of one density have no order; fields of one signal are no wedge.
    (pairs.len() >= 4 && aa > 0.0).then(|| if bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 })
}

/// The pixels whose middles lie within a quadrilateral.
fn within(corners: &[DVec2; 4], plane: &Plane) -> Option<Vec<usize>> {
    let low = corners.iter().copied().reduce(DVec2::min)?;
    let high = corners.iter().copied().reduce(DVec2::max)?;
    if !(low.min_element() >= 0.0 && high.x <= plane.width as f64 && high.y <= plane.height as f64) {
        return None;
    }
    let side = |at: DVec2, k: usize| (corners[(k + 1) % 4] - corners[k]).perp_dot(at - corners[k]);
    let mut found = Vec::new();
    for y in low.y as usize..(high.y.ceil() as usize).min(plane.height) {
        for x in low.x as usize..(high.x.ceil() as usize).min(plane.width) {
            let at = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            let sides = [0, 1, 2, 3].map(|k| side(at, k));
            if sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0) {
                found.push(y * plane.width + x);
            }
        }
    }
    Some(found)
}

fn field(planes: &[Plane], corners: &[DVec2; 4], density: f64) -> Result<Field, MeasureError> {
    let place = format!("field of density {density}");
    let plane = &planes[0];
    let pixels = within(corners, plane).ok_or_else(|| {
        MeasureError::unfit(&place, "it lies outside the picture", "all fields within the picture: --corners x,y,x,y,x,y,x,y")
    })?;
    let pixels: Vec<usize> = pixels.into_iter().filter(|i| !plane.values[*i].is_nan()).collect();
    let samples = pixels.len();
    if samples < LEAST {
        return Err(MeasureError::unfit(
            &place,
            format!("{samples} samples"),
            format!("{LEAST} and more: a larger picture of the chart"),
        ));
    }
    let (n, pictures) = (samples as f64, planes.len() as f64);
    let top = plane.limits[1];
    let samples_at =
        |side: usize| planes.iter().map(|p| pixels.iter().filter(|i| p.is_clipped(**i)[side]).count()).sum::<usize>();
    let [black, clipped] = [samples_at(0), samples_at(1)];
    let means: Vec<f64> = planes.iter().map(|p| pixels.iter().map(|i| f64::from(p.values[*i])).sum::<f64>() / n).collect();
    let signal = means.iter().sum::<f64>() / pictures;
    // What differs from picture to picture, pixel by pixel; the pictures' own means apart, since light may flicker.
    let temporal = (planes.len() > 1).then(|| {
        let squares: f64 = pixels
            .iter()
            .map(|i| {
                let values = planes.iter().zip(&means).map(|(p, mean)| f64::from(p.values[*i]) - mean);
                let (sum, squares) = values.fold((0.0, 0.0), |s, v| (s.0 + v, s.1 + v * v));
                squares - sum * sum / pictures
            })
            .sum();
        squares / ((pictures - 1.0) * (n - 1.0))
    });
    // Of the first picture, without a plane.
    let middle = DVec2::new((plane.width / 2) as f64, (plane.height / 2) as f64);
    let place_of = |i: usize| (DVec2::new((i % plane.width) as f64, (i / plane.width) as f64) - middle) / middle.max_element();
    let value = |i: usize| f64::from(plane.values[i]);
    let rows = pixels.iter().map(|i| (vec![1.0, place_of(*i).x, place_of(*i).y], value(*i) - means[0]));
    let slope = least_squares(rows, 3).unwrap_or_else(|| vec![0.0; 3]);
    let left = |i: usize| value(i) - means[0] - slope[0] - slope[1] * place_of(i).x - slope[2] * place_of(i).y;
    let total = pixels.iter().map(|i| left(*i).powi(2)).sum::<f64>() / (n - 3.0);
    let sure = 6.0 * (total / n).sqrt();
    // A thousandth of white is no difference of exposures: tone curves lead deep shadows to next to nothing.
    let least = if top.is_finite() { LEAST_DIFFERENCE * f64::from(top) } else { LEAST_DIFFERENCE };
    if let Some(other) = means.iter().find(|m| (*m - means[0]).abs() > (MOST_DIFFERENCE * signal.abs()).max(least) + sure) {
        return Err(MeasureError::unfit(
            &place,
            format!("means of {:.5} and {other:.5} of white", means[0]),
            "pictures of the same exposure, of the same chart in the same place",
        ));
    }
    let temporal_noise = temporal.map(f64::sqrt);
    let black = black as f64 / (n * pictures);
    let clipped_to_black = black > MOST_BLACK;
    // What is cut off at black has less noise than it had; how much is cut off says how many deviations the signal lay above 0.
    let snr = match clipped_to_black {
        true if black < 1.0 => normal_quantile(1.0 - black).max(0.0),
        true => 0.0,
        false => ratio(signal, temporal_noise.unwrap_or(total.sqrt())),
    };
    Ok(Field {
        density,
        signal,
        total_noise: total.sqrt(),
        temporal_noise,
        incremental_gain: None,
        snr,
        saturated: clipped as f64 > MOST_CLIPPED * n * pictures,
        clipped_to_black,
        samples,
    })
}

/// Signal over noise.
fn ratio(signal: f64, noise: f64) -> f64 {
    match noise > 0.0 {
        true => signal / noise,
        false if signal > 0.0 => f64::INFINITY,
        false => 0.0,
    }
}

/// Finds the incremental gain of fields by those beside them in density, and by it their signal-to-noise ratio.
fn weigh_by_gain(fields: &mut [Field]) {
    /// Fields of the same density are the same light.
    const SAME: f64 = 0.01;
    let mut known: Vec<(f64, f64)> = fields.iter().filter(|f| !f.saturated).map(|f| (f.density, f.signal)).collect();
    known.sort_by(|a, b| a.0.total_cmp(&b.0));
    for f in fields.iter_mut().filter(|f| !f.saturated) {
        let own = (f.density, f.signal);
        let brighter = known.iter().rev().find(|k| k.0 < own.0 - SAME).copied().unwrap_or(own);
        let darker = known.iter().find(|k| k.0 > own.0 + SAME).copied().unwrap_or(own);
        let apart = (darker.0 - brighter.0) * std::f64::consts::LN_10;
        if apart == 0.0 {
            continue;
        }
        // The slope of a power is found exactly where all three are above 0.
        let gain = match brighter.1 > 0.0 && own.1 > 0.0 && darker.1 > 0.0 {
            true => own.1 * (brighter.1 / darker.1).ln() / apart,
            false => (brighter.1 - darker.1) / apart,
        };
        f.incremental_gain = Some(gain);
        if !f.clipped_to_black {
            f.snr = ratio(gain, f.temporal_noise.unwrap_or(f.total_noise));
        }
    }
}

/// Density at which the straight line through two points (density, log value) meets a log value.
fn meets([a, b]: [(f64, f64); 2], value: f64) -> f64 {
    a.0 + (value - a.1) / (b.1 - a.1) * (b.0 - a.0)
}

fn response(channel: &'static str, mut fields: Vec<Field>, top: f64) -> Response {
    weigh_by_gain(&mut fields);
    let mut sorted: Vec<&Field> = fields.iter().collect();
    sorted.sort_by(|a, b| a.density.total_cmp(&b.density));
    // Brightest first, from where nothing is clipped.
    let kept: Vec<&Field> = sorted.iter().skip_while(|f| f.saturated).copied().filter(|f| !f.saturated).collect();
    let bright: Vec<(f64, f64)> = kept.iter().filter(|f| f.signal > 0.0).take(2).map(|f| (f.density, f.signal.ln())).collect();
    let saturation_density = match bright[..] {
        [a, b] if top.is_finite() && top > 0.0 && a.1 > b.1 => Some(meets([a, b], top.ln())),
        _ => None,
    };
    // The first field that drowns in noise, and the one before it. What its mean is worth there is little: a negative one counts as a tenth of the noise.
    let drowned = kept.iter().position(|f| f.snr < 1.0);
    let noise_density = drowned.filter(|k| *k > 0).map(|k| {
        let at = |f: &Field| (f.density, f.snr.max(0.1).ln());
        meets([at(kept[k - 1]), at(kept[k])], 0.0)
    });
    // Without noise there is no such density.
    let noise_density = noise_density.filter(|d| d.is_finite());
    let dynamic_range_stops = saturation_density.zip(noise_density).map(|(s, n)| (n - s) * 10f64.log2());
    let clear: Vec<(f64, f64)> =
        kept.iter().filter(|f| f.snr > 10.0 && f.signal > 0.0).map(|f| (-f.density, f.signal.log10())).collect();
    let gamma = (clear.len() > 1)
        .then(|| {
            let n = clear.len() as f64;
            let mean = clear.iter().fold((0.0, 0.0), |m, p| (m.0 + p.0 / n, m.1 + p.1 / n));
            let xx: f64 = clear.iter().map(|p| (p.0 - mean.0).powi(2)).sum();
            clear.iter().map(|p| (p.0 - mean.0) * (p.1 - mean.1)).sum::<f64>() / xx
        })
        .filter(|g| g.is_finite());
    Response { channel, fields, saturation_density, noise_density, dynamic_range_stops, gamma }
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_image::Raster;

    /// A picture of the wedge as a camera of 10 000 e⁻ at white and 3 e⁻ of read-out noise sees it, `lift` stops above the point where the clear field is white.
    fn picture(seed: u64, lift: f64, gamma: f64) -> Measured {
        let (width, height) = (600, 400);
        let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        let mut normal = || {
            // Sum of twelve even numbers: variance 1.
            (0..12)
                .map(|_| {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    (state >> 40) as f64 / (1u64 << 24) as f64
                })
                .sum::<f64>()
                - 6.0
        };
        let corners = framed_wedge([width, height]).unwrap();
        let mut pixels = Raster::new(width, height, 1);
        for (i, v) in pixels.data.iter_mut().enumerate() {
            let at = [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5];
            let cell = [0, 1].map(|a| {
                let extent = WEDGE_GRID[a] as f64 - 1.0 + f64::from(WEDGE_FIELD / WEDGE_STEP);
                (at[a] - corners[0][a]) / (corners[2][a] - corners[0][a]) * extent
            });
            let inside = cell.iter().zip(WEDGE_GRID).all(|(c, n)| *c >= 0.0 && *c < n as f64 && c.fract() < 0.909);
            let k = if inside { cell[0] as usize + WEDGE_GRID[0] * cell[1] as usize } else { 40 };
            let light = 1e4 * 2f64.powf(lift) * 10f64.powf(-WEDGE_DENSITY * k as f64);
            let electrons = light + (light + 9.0).sqrt() * normal();
            let linear = electrons / 1e4;
            *v = if gamma == 1.0 { linear.min(1.0) } else { linear.max(0.0).powf(1.0 / gamma).min(1.0) } as f32;
        }
        Measured::Light { pixels, bands: vec!["Y".into()], limits: [f32::NEG_INFINITY, 1.0], clipped: None, facts: None }
    }

    #[test]
    fn range_noise_and_slope_are_those_of_the_camera() {
        let pictures = [picture(1, 0.5, 1.0), picture(2, 0.5, 1.0)];
        let found = measure(&pictures, Channel::Clear, None, WEDGE_GRID, None, None).unwrap();
        assert_eq!(found.fields.len(), 20);
        // Half a stop too much: the clear field is clipped, white lies at a density of 0.1505.
        assert!(found.fields[0].saturated && !found.fields[1].saturated);
        assert!((found.saturation_density.unwrap() - 0.5 * 2f64.log10()).abs() < 0.003, "{:?}", found.saturation_density);
        assert!((found.gamma.unwrap() - 1.0).abs() < 0.003, "{:?}", found.gamma);
        for f in &found.fields[1..] {
            let electrons = 1e4 * 2f64.sqrt() * 10f64.powf(-f.density);
            let noise = (electrons + 9.0).sqrt() / 1e4;
            // About 2600 samples: deviations are known to 1 / √(2 · 2600) = 1.4 %, of two pictures alike.
            assert!((f.temporal_noise.unwrap() / noise - 1.0).abs() < 0.06, "{f:?} {noise}");
            assert!((f.total_noise / noise - 1.0).abs() < 0.06, "{f:?} {noise}");
        }
        // No curve changes what is known of the light, but for what rounding and clipping at 0 do in the dark.
        let curved = [picture(1, 0.5, 2.2), picture(2, 0.5, 2.2)];
        let curved = measure(&curved, Channel::Clear, None, WEDGE_GRID, None, None).unwrap();
        for (f, straight) in curved.fields.iter().zip(&found.fields).skip(1).filter(|(_, f)| f.snr > 10.0) {
            assert!((f.snr / straight.snr - 1.0).abs() < 0.03, "{f:?} {straight:?}");
            assert!((f.incremental_gain.unwrap() / (f.signal / 2.2) - 1.0).abs() < 0.02, "{f:?}");
        }
        let stops = |r: &Response| r.dynamic_range_stops.unwrap();
        assert!((stops(&curved) - stops(&found)).abs() < 0.5, "{} {}", stops(&curved), stops(&found));
        // Signal = noise: e² = e + 9, e = 3.541: 11.46 stops. Between two fields of 0.83 stops a straight line errs by a few hundredths.
        let wanted = (1e4f64 / 3.541_38).log2();
        assert!((found.dynamic_range_stops.unwrap() - wanted).abs() < 0.12, "{:?} {wanted}", found.dynamic_range_stops);
    }

    #[test]
    fn fall_off_is_counted_as_density() {
        let fall = |i: usize| {
            let at = [(i % 600) as f32 / 600.0 - 0.5, (i / 600) as f32 / 400.0 - 0.5];
            1.0 - 0.8 * (at[0] * at[0] + at[1] * at[1])
        };
        let Measured::Light { mut pixels, bands, limits, .. } = picture(1, -0.2, 1.0) else { panic!("light") };
        let mut even = Raster::new(600, 400, 1);
        for i in 0..pixels.data.len() {
            pixels.data[i] *= fall(i);
            even.data[i] = 0.7 * fall(i);
        }
        let of = |pixels| Measured::Light { pixels, bands: bands.clone(), limits, clipped: None, facts: None };
        let (dim, flat) = ([of(pixels)], of(even));
        let with = measure(&dim, Channel::Clear, None, WEDGE_GRID, None, Some(&flat)).unwrap();
        let without = measure(&dim, Channel::Clear, None, WEDGE_GRID, None, None).unwrap();
        // The rows of the middle are the denser ones to the left of the corners: without the flat field the slope is wrong by several times what it is with it.
        let off = |r: &Response| (r.gamma.unwrap() - 1.0).abs();
        assert!(off(&with) < 0.002 && off(&without) > 3.0 * off(&with), "{} {}", off(&with), off(&without));
        // A clear field in the corner gets 0.8 of the light of the middle or less.
        assert!(with.fields[0].density > 0.05 && with.fields[0].density < 0.15, "{}", with.fields[0].density);
        let small = of(Raster::new(60, 40, 1));
        assert!(measure(&dim, Channel::Clear, None, WEDGE_GRID, None, Some(&small)).unwrap_err().to_string().contains("60 × 40"));
    }

    #[test]
    fn a_curve_shows_its_slope_and_pictures_that_do_not_fit_are_named() {
        let curved = picture(1, -0.5, 2.2);
        let found = measure(std::slice::from_ref(&curved), Channel::Clear, None, WEDGE_GRID, None, None).unwrap();
        assert!((found.gamma.unwrap() - 1.0 / 2.2).abs() < 0.01, "{:?}", found.gamma);
        assert!((found.saturation_density.unwrap() + 0.5 * 2f64.log10()).abs() < 0.02, "{:?}", found.saturation_density);
        assert!(found.fields[0].temporal_noise.is_none());
        let told = |r: Result<Response, MeasureError>| r.unwrap_err().to_string();
        let other = [picture(1, 0.0, 1.0), picture(1, -1.0, 1.0)];
        assert!(told(measure(&other, Channel::Clear, None, WEDGE_GRID, None, None)).contains("same exposure"));
        assert!(told(measure(&other[..1], Channel::Clear, None, [4, 4], Some(&[0.0; 3]), None)).contains("3 numbers for 4 × 4"));
        let outside = Some([[-50.0, 0.0], [500.0, 0.0], [500.0, 300.0], [-50.0, 300.0]]);
        assert!(told(measure(&other[..1], Channel::Clear, outside, WEDGE_GRID, None, None)).contains("outside"));
        assert!(told(measure(&other[..1], Channel::Clear, Some([[1.0; 2]; 4]), WEDGE_GRID, None, None)).contains("in line"));
        assert!(told(measure(&[], Channel::Clear, None, WEDGE_GRID, None, None)).contains("no pictures"));
    }
}
