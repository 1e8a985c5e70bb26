//! What is white: the camera's signals of a neutral surface, from the file, a light, a temperature, a grey patch, or the picture itself.
//!
//! Sources: DNG 1.6 chapter 6 (neutral of a chromaticity); the unit of tint, 1/3000 in CIE 1960 uv across the line of black bodies, as in
//! Adobe's DNG SDK; automatic balance: Finlayson & Trezzi 2004, "Shades of gray and colour constancy" (CIC 12), p = 6.

use crate::overview::Overview;
use crate::recipe::{RecipeError, White};
use crate::steps::camera_matrix;
use diopter_image::RawHeader;
use diopter_light::cie;
use diopter_light::color::{xy_from_xyz, xyz_of};

/// Tint of one unit of distance in uv.
const TINT: f64 = 3000.0;
/// Temperatures a picture may ask for, K.
const KELVIN: std::ops::RangeInclusive<f64> = 1500.0..=40_000.0;
/// Norm of the automatic balance.
const NORM: i32 = 6;

/// Camera signals of white, largest 1. `overview`: the picture in small, for balances that look at it.
pub fn neutral(header: &RawHeader, white: &White, overview: &dyn Fn() -> Overview) -> Result<Vec<f64>, RecipeError> {
    if header.cfa.is_monochrome() {
        return Ok(vec![1.0; header.cfa.channel_count()]);
    }
    if let Some(patch) = white.patch {
        let signal = overview().mean(patch);
        return normalised(signal).ok_or_else(|| RecipeError {
            place: "white.patch".into(),
            found: "a part of the picture that is dark or saturated".into(),
            expected: "a grey that all channels see".into(),
        });
    }
    let name = white.balance.trim();
    let signal = match name.to_lowercase().as_str() {
        "as-shot" if white.tint == 0.0 => return Ok(header.as_shot_neutral.clone()),
        "as-shot" => {
            let xy = camera_matrix::xy_of_neutral(header, &header.as_shot_neutral);
            let (kelvin, tint) = temperature(xy);
            camera_matrix::neutral_of_xy(header, xy_of(kelvin, tint + white.tint))
        }
        "auto" => Some(automatic(header, &overview())),
        _ => {
            let xy = light(name).ok_or_else(|| RecipeError {
                place: "white.balance".into(),
                found: format!("\"{name}\""),
                expected: format!(
                    "as-shot, auto, daylight, cloudy, shade, tungsten, fluorescent, flash, one of {}, or a temperature such as 5200 K",
                    cie::illuminant_names().join(", ")
                ),
            })?;
            let xy = if white.tint == 0.0 {
                xy
            } else {
                let (kelvin, tint) = temperature(xy);
                xy_of(kelvin, tint + white.tint)
            };
            camera_matrix::neutral_of_xy(header, xy)
        }
    };
    signal.and_then(normalised).ok_or_else(|| RecipeError {
        place: "white.balance".into(),
        found: format!("\"{name}\" for a file without colour matrices"),
        expected: "as-shot, auto, or white.patch".into(),
    })
}

/// Largest 1; `None` where a channel sees nothing.
fn normalised(signal: Vec<f64>) -> Option<Vec<f64>> {
    let largest = signal.iter().fold(0.0f64, |a, b| a.max(*b));
    let fine = largest > 0.0 && signal.iter().all(|v| v.is_finite() && *v > 1e-3 * largest);
    fine.then(|| signal.iter().map(|v| v / largest).collect())
}

/// Chromaticity of a named light or of a temperature ("5200 K", "5200").
fn light(name: &str) -> Option<(f64, f64)> {
    let illuminant = match name.to_lowercase().as_str() {
        "daylight" | "flash" => "D55",
        "cloudy" => "D65",
        "shade" => "D75",
        "tungsten" => "A",
        "fluorescent" => "FL2",
        _ => name,
    };
    if let Some(table) = cie::illuminant(&illuminant.to_uppercase()).or_else(|| cie::illuminant(illuminant)) {
        return Some(xy_from_xyz(xyz_of(|nm| table.at(nm))));
    }
    let number = name.trim_end_matches(['K', 'k', ' ']);
    let kelvin: f64 = number.parse().ok().filter(|k| KELVIN.contains(k))?;
    Some(xy_of(kelvin, 0.0))
}

/// CIE 1960 uv.
fn uv((x, y): (f64, f64)) -> [f64; 2] {
    let d = -2.0 * x + 12.0 * y + 3.0;
    [4.0 * x / d, 6.0 * y / d]
}

/// uv of a black body (Planck's law over the CIE 1931 observer).
fn black_body(kelvin: f64) -> [f64; 2] {
    const C2: f64 = 1.438_776_877e-2;
    let radiance = |nm: f32| {
        let m = f64::from(nm) * 1e-9;
        // The scale does not matter.
        (1e-32 / (m.powi(5) * ((C2 / (m * kelvin)).exp() - 1.0))) as f32
    };
    uv(xy_from_xyz(xyz_of(radiance)))
}

/// A point off the line of black bodies.
fn off_line(kelvin: f64, tint: f64) -> [f64; 2] {
    let mired = 1e6 / kelvin;
    let [at, before, after] = [mired, mired - 0.5, mired + 0.5].map(|m| black_body(1e6 / m));
    let (du, dv) = (after[0] - before[0], after[1] - before[1]);
    let length = du.hypot(dv);
    // Green lies to the left of the way to lower temperatures: larger v.
    [at[0] + dv / length * tint / TINT, at[1] - du / length * tint / TINT]
}

/// Chromaticity of a temperature (K) and tint.
pub fn xy_of(kelvin: f64, tint: f64) -> (f64, f64) {
    let [u, v] = off_line(kelvin, tint);
    let d = 2.0 * u - 8.0 * v + 4.0;
    (3.0 * u / d, 2.0 * v / d)
}

/// Correlated colour temperature (K) and tint of a chromaticity: the nearest black body in uv.
pub fn temperature(xy: (f64, f64)) -> (f64, f64) {
    let here = uv(xy);
    let distance = |mired: f64| {
        let [u, v] = black_body(1e6 / mired);
        (u - here[0]).hypot(v - here[1])
    };
    // Golden section over reciprocal temperature, after a coarse look.
    let (first, last) = (1e6 / KELVIN.end(), 1e6 / KELVIN.start());
    let steps = 40;
    let at = |i: usize| first + (last - first) * i as f64 / steps as f64;
    let nearest = (0..=steps).min_by(|a, b| distance(at(*a)).total_cmp(&distance(at(*b)))).unwrap_or(0);
    let (mut low, mut high) = (at(nearest.saturating_sub(1)), at((nearest + 1).min(steps)));
    for _ in 0..40 {
        let (a, b) = (high - 0.618 * (high - low), low + 0.618 * (high - low));
        if distance(a) < distance(b) { high = b } else { low = a }
    }
    let mired = 0.5 * (low + high);
    let (on, one) = (off_line(1e6 / mired, 0.0), off_line(1e6 / mired, 1.0));
    let (du, dv) = ((one[0] - on[0]) * TINT, (one[1] - on[1]) * TINT);
    let tint = ((here[0] - on[0]) * du + (here[1] - on[1]) * dv) * TINT;
    (1e6 / mired, tint)
}

/// Shades of grey, kept within what lights are like.
fn automatic(header: &RawHeader, overview: &Overview) -> Vec<f64> {
    let n = header.cfa.channel_count();
    let mut sums = vec![0.0f64; n];
    for cell in overview.cells().filter(|c| !c.saturated) {
        sums.iter_mut().zip(cell.signal).for_each(|(s, v)| *s += f64::from(v.max(0.0)).powi(NORM));
    }
    let found: Vec<f64> = sums.iter().map(|s| s.powf(1.0 / f64::from(NORM))).collect();
    let Some(found) = normalised(found) else { return header.as_shot_neutral.clone() };
    let (kelvin, tint) = temperature(camera_matrix::xy_of_neutral(header, &found));
    let xy = xy_of(kelvin.clamp(2000.0, 12_000.0), tint.clamp(-30.0, 40.0));
    camera_matrix::neutral_of_xy(header, xy).unwrap_or(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn temperatures_are_those_of_the_illuminants() {
        // CIE 15:2018: correlated colour temperatures.
        for (name, kelvin, tolerance) in [("A", 2856.0, 6.0), ("D50", 5003.0, 15.0), ("D65", 6504.0, 15.0), ("FL2", 4224.0, 25.0)]
        {
            let (k, _) = temperature(light(name).unwrap());
            assert!((k - kelvin).abs() < tolerance, "{name} {k}");
        }
        // D65 lies 0.0032 above the line of black bodies: greener.
        let (_, tint) = temperature((0.3127, 0.3290));
        assert!((-11.0..-8.0).contains(&tint), "{tint}");
    }

    #[test]
    fn temperature_and_tint_come_back() {
        for kelvin in [2000.0, 3200.0, 5000.0, 9000.0] {
            for tint in [-40.0, 0.0, 25.0] {
                let (k, t) = temperature(xy_of(kelvin, tint));
                assert!((k / kelvin - 1.0).abs() < 0.002 && (t - tint).abs() < 0.5, "{kelvin} {tint}: {k} {t}");
            }
        }
        assert!(light("5200 K").is_some() && light("100K").is_none() && light("nonsense").is_none());
    }
}
