//! White balance, set or estimated: the camera's signals of a neutral surface, from the file, a light, a temperature, a grey patch, or the picture itself.
//!
//! Sources: DNG 1.6 chapter 6 (neutral of a chromaticity); the unit of tint, 1/3000 in CIE 1960 uv across the line of black bodies, as in
//! Adobe's DNG SDK; automatic balance: Finlayson & Trezzi 2004, "Shades of gray and colour constancy" (CIC 12), p = 6.

use crate::overview::Overview;
use crate::setting::{RecipeError, section};
use crate::steps::camera_matrix;
use diopter_image::RawHeader;
use diopter_light::cie;
use diopter_light::color::{xy_from_xyz, xyz_of};

section! {
    /// What is white.
    White "white" {
        balance: String = "as-shot".into(), "", Text,
            "as-shot, auto, daylight, cloudy, shade, tungsten, fluorescent, flash, an illuminant (D50) or a temperature (5200 K)";
        tint: f64 = 0.0, "1/3000 of uv", Number(-150.0, 150.0),
            "by which the light is taken to lie off the line of black bodies, to the green side above 0: the picture becomes more magenta then, greener below 0";
        patch: Option<[f64; 4]> = None, "fraction of the picture", Numbers(4, 0.0, 1.0),
            "left, top, width, height of a part that is grey; wins over white.balance";
    }
}

/// Tint of one unit of distance in uv.
const TINT: f64 = 3000.0;
/// Temperatures a picture may ask for, K.
const KELVIN: std::ops::RangeInclusive<f64> = 1500.0..=40_000.0;
/// Norm of the automatic balance.
const NORM: i32 = 6;

/// Camera signals of white, largest 1. `overview`: the picture in small, for balances that look at it. Fails on a balance of no known name, on a patch
/// that reaches out of the picture or is dark or saturated, and where a light or a tint is asked of a file without colour matrices.
pub fn neutral(header: &RawHeader, white: &White, overview: &dyn Fn() -> Overview) -> Result<Vec<f64>, RecipeError> {
    if header.cfa.is_colorless() {
        return Ok(vec![1.0; header.cfa.channel_count()]);
    }
    let tinted = |signal: Vec<f64>| {
        if white.tint == 0.0 {
            return Some(signal);
        }
        let (kelvin, tint) = temperature(camera_matrix::xy_of_neutral(header, &signal));
        camera_matrix::neutral_of_xy(header, xy_of(kelvin, tint + white.tint))
    };
    if let Some(patch) = white.patch {
        let [left, top, width, height] = patch;
        if !(width > 0.0 && height > 0.0 && left + width <= 1.0 + 1e-9 && top + height <= 1.0 + 1e-9) {
            return Err(RecipeError {
                place: "white.patch".into(),
                found: format!("{patch:?}"),
                expected: "left, top, width, height of a part inside the picture, as fractions of it".into(),
            });
        }
        let signal = normalised(overview().mean(in_mosaic(patch, header, overview().size())));
        return signal.and_then(tinted).and_then(normalised).ok_or_else(|| RecipeError {
            place: "white.patch".into(),
            found: "a part of the picture that is dark or saturated".into(),
            expected: "a grey that all channels see".into(),
        });
    }
    let name = white.balance.trim();
    let signal = match name.to_lowercase().as_str() {
        "as-shot" => tinted(header.as_shot_neutral.clone()),
        "auto" => tinted(automatic(header, &overview())),
        _ => {
            let xy = light(name).ok_or_else(|| unknown(name))?;
            camera_matrix::neutral_of_xy(header, xy).and_then(tinted)
        }
    };
    signal.and_then(normalised).ok_or_else(|| RecipeError {
        place: "white.balance".into(),
        found: format!("\"{name}\" for a file without colour matrices"),
        expected: "as-shot, auto, or white.patch, and no tint".into(),
    })
}

fn unknown(name: &str) -> RecipeError {
    RecipeError {
        place: "white.balance".into(),
        found: format!("\"{name}\""),
        expected: format!(
            "as-shot, auto, daylight, cloudy, shade, tungsten, fluorescent, flash, one of {}, or a temperature such as 5200 K",
            cie::illuminant_names().join(", ")
        ),
    }
}

/// What is taken for white, as the facts of a picture say it: `as_shot`, a name, `patch`.
pub fn name_of(white: &White, as_shot: &str) -> String {
    let name = white.balance.trim();
    match (white.patch, name.to_lowercase().as_str()) {
        (Some(_), _) => "patch".into(),
        (None, "as-shot") => as_shot.into(),
        (None, "auto") => "auto".into(),
        (None, _) => name.into(),
    }
}

/// Fails on a balance of no known name, before any file is read; with a patch the name does not count.
pub fn check(white: &White) -> Result<(), RecipeError> {
    let name = white.balance.trim();
    let fine = white.patch.is_some() || matches!(name.to_lowercase().as_str(), "as-shot" | "auto") || light(name).is_some();
    if fine { Ok(()) } else { Err(unknown(name)) }
}

/// A part of the picture as shown, in fractions of the mosaic.
fn in_mosaic([left, top, width, height]: [f64; 4], header: &RawHeader, [w, h]: [usize; 2]) -> [f64; 4] {
    let o = header.framing.orientation;
    let [across, down] = o.mirrors();
    // Undo the mirrors, then the change of columns and rows.
    let x = if across { 1.0 - left - width } else { left };
    let y = if down { 1.0 - top - height } else { top };
    let [x, y, width, height] = if o.transposes() { [y, x, height, width] } else { [x, y, width, height] };
    match header.framing.crop {
        None => [x, y, width, height],
        Some([cx, cy, cw, ch]) => {
            let (w, h) = (w as f64, h as f64);
            [(cx as f64 + x * cw as f64) / w, (cy as f64 + y * ch as f64) / h, width * cw as f64 / w, height * ch as f64 / h]
        }
    }
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

/// A point off the line of black bodies: to its green side for tints above 0, as Adobe's raw converters count.
fn off_line(kelvin: f64, tint: f64) -> [f64; 2] {
    let mired = 1e6 / kelvin;
    let [at, before, after] = [mired, mired - 0.5, mired + 0.5].map(|m| black_body(1e6 / m));
    let (du, dv) = (after[0] - before[0], after[1] - before[1]);
    let length = du.hypot(dv);
    // Green lies to the left of the way to lower temperatures: larger v.
    [at[0] - dv / length * tint / TINT, at[1] + du / length * tint / TINT]
}

/// Chromaticity (CIE 1931 x, y) of a temperature (K) and tint.
pub fn xy_of(kelvin: f64, tint: f64) -> (f64, f64) {
    let [u, v] = off_line(kelvin, tint);
    let d = 2.0 * u - 8.0 * v + 4.0;
    (3.0 * u / d, 2.0 * v / d)
}

/// Correlated colour temperature (K, 1500 to 40 000) and tint of a chromaticity (CIE 1931 x, y): the nearest black body in uv.
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
    let xy = xy_of(kelvin.clamp(2000.0, 12_000.0), tint.clamp(-40.0, 30.0));
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
        assert!((8.0..11.0).contains(&tint), "{tint}");
    }

    #[test]
    fn more_tint_is_of_a_greener_light_so_that_the_picture_becomes_more_magenta() {
        // What counts as neutral has more of Y then: a grey gets less green.
        let green = |tint: f64| {
            let (x, y) = xy_of(5500.0, tint);
            y / (x + (1.0 - x - y))
        };
        assert!(green(40.0) > 1.01 * green(0.0) && green(0.0) > 1.01 * green(-40.0));
    }

    #[test]
    fn patches_lie_where_the_picture_shows_them() {
        use diopter_image::raw::{Framing, Orientation};
        // Left half red, right half blue, seen by a camera whose channels are XYZ itself.
        let cfa = diopter_image::Cfa::parse("RG/GB").unwrap();
        let mut image = crate::tests::raw(400, 200, "RG/GB", |x, y| match (cfa.channel_at(x, y), x < 200) {
            (0, true) | (2, false) => 600.0,
            (1, _) => 500.0,
            _ => 300.0,
        });
        let left_is_red = |n: &[f64]| n[0] > n[2];
        let mut of = |framing: Framing, patch: [f64; 4]| {
            image.header.framing = framing;
            let white = White { patch: Some(patch), ..White::default() };
            neutral(&image.header, &white, &|| Overview::new(&image)).unwrap()
        };
        let upright = Framing::default();
        assert!(left_is_red(&of(upright, [0.1, 0.2, 0.2, 0.5])) && !left_is_red(&of(upright, [0.7, 0.2, 0.2, 0.5])));
        let turned = |n: u16| Framing { orientation: Orientation::from_exif(n), ..upright };
        // Upside down the left is the right; turned to the right the left is on top.
        assert!(!left_is_red(&of(turned(3), [0.1, 0.2, 0.2, 0.5])));
        assert!(left_is_red(&of(turned(6), [0.2, 0.1, 0.5, 0.2])) && !left_is_red(&of(turned(6), [0.2, 0.7, 0.5, 0.2])));
        let cropped = Framing { crop: Some([220, 20, 160, 160]), ..upright };
        assert!(!left_is_red(&of(cropped, [0.1, 0.2, 0.2, 0.5])));
        assert!(
            neutral(&image.header, &White { patch: Some([0.9, 0.9, 0.5, 0.5]), ..White::default() }, &|| Overview::new(&image))
                .is_err()
        );
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
