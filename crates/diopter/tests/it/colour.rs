//! Colours of a chart through the raw file and its development: 24 patches under several lights, several bodies.
//!
//! Reference: CIE XYZ of the patches (CIE 1931 observer) adapted to D65 by Bradford, as the developed picture is meant; ΔE2000 in CIELAB (D65).
//! Patches: BabelColor averages of the ColorChecker Classic; lights: CIE 15:2018. Signals are those of the sensor without noise.

use diopter::develop::{Demosaic, Recipe, develop};
use diopter::image::{ExposureFacts, Raster, RawHeader, RawImage};
use diopter::light::cie;
use diopter::light::color::{D65_XY, RgbSpace, bradford, delta_e_2000, lab, srgb_decode, xy_from_xyz, xyz_from_xy, xyz_of};
use diopter::sensor::calibration;
use diopter::shot::read_body;
use glam::DVec3;

const BODIES: [&str; 5] = ["canon-5d-mark-iv", "nikon-d850", "sony-a7s-ii", "pixel-4a", "canon-700d"];
const LIGHTS: [&str; 6] = ["D65", "D50", "A", "FL2", "LED-B1", "LED-B3"];
/// Fraction of saturation of the brightest channel for a perfect reflector, so that metered grey is shown as grey.
const WHITE: f64 = 10.0 / 78.0 / 0.18;
/// Pixels a side of a patch.
const SIDE: usize = 16;

/// ΔE2000 of each patch.
fn differences(body: &str, light: &str, white_balance: &str) -> Vec<f64> {
    let sensor = read_body(body).unwrap();
    let illuminant = cie::illuminant(light).unwrap();
    let in_range = |nm: f32| if (380.0..=780.0).contains(&nm) { illuminant.at(nm) } else { 0.0 };
    let responses = sensor.band_responses();
    let white = calibration::signals(&sensor, &responses, &in_range);
    let n = sensor.cfa.channel_count();
    let patches = cie::colorchecker();
    // The chart side by side, in a 16-bit raw image.
    let mut mosaic = Raster::new(SIDE * patches.len(), SIDE, 1);
    for (k, patch) in patches.iter().enumerate() {
        let signal = calibration::signals(&sensor, &responses, &|nm| in_range(nm) * patch.reflectance.at(nm));
        for y in 0..SIDE {
            for x in k * SIDE..(k + 1) * SIDE {
                let fraction = WHITE * signal[sensor.cfa.channel_at(x, y)] / white.max_element();
                mosaic.pixel_mut(x, y)[0] = (65_535.0 * fraction).round() as u16;
            }
        }
    }
    let header = RawHeader {
        cfa: sensor.cfa.clone(),
        bits: 16,
        black_level: 0.0,
        white_level: 65_535.0,
        as_shot_neutral: calibration::neutral(&sensor, &illuminant),
        calibrations: calibration::calibrations(&sensor),
        baseline_ev: 0.0,
        framing: Default::default(),
        opcodes: vec![],
        warnings: vec![],
        noise: vec![[0.0, 0.0]; n],
        facts: ExposureFacts::default(),
    };
    let mut recipe = Recipe::preset("plain").unwrap().with("white.balance", white_balance).unwrap();
    recipe.demosaic.method = Demosaic::Half;
    let picture = develop(&RawImage { mosaic, header }, &recipe, None).unwrap();
    let white_xyz = xyz_of(in_range);
    let adapt = bradford(xy_from_xyz(white_xyz), D65_XY);
    let d65 = xyz_from_xy(D65_XY);
    patches
        .iter()
        .enumerate()
        .map(|(k, patch)| {
            let code = picture.pixels.pixel(k * SIDE / 2 + SIDE / 4, SIDE / 4);
            let light = DVec3::from_array(std::array::from_fn(|c| f64::from(srgb_decode(code[c]))));
            let got = RgbSpace::Srgb.xyz_from_rgb() * light;
            let expected = adapt * (xyz_of(|nm| in_range(nm) * patch.reflectance.at(nm)) / white_xyz.y);
            // What lies outside sRGB cannot be shown: compared as it is clipped.
            let shown = RgbSpace::Srgb.xyz_from_rgb().inverse() * expected;
            let expected = RgbSpace::Srgb.xyz_from_rgb() * shown.clamp(DVec3::ZERO, DVec3::ONE);
            delta_e_2000(lab(got, d65), lab(expected, d65))
        })
        .collect()
}

#[test]
fn the_chart_keeps_its_colours() {
    let mut text = String::new();
    let mut fine = true;
    for body in BODIES {
        for light in LIGHTS {
            let e = differences(body, light, "as-shot");
            let (mean, worst) = (e.iter().sum::<f64>() / 24.0, e.iter().fold(0.0f64, |a, b| a.max(*b)));
            let k = e.iter().position(|v| *v == worst).unwrap();
            text += &format!("{body:18} {light:7} mean {mean:.2} worst {worst:.2} ({})\n", cie::colorchecker()[k].name);
            fine &= mean < 2.5 && worst < 6.0;
            // Neutral patches stay neutral whatever the light: the bottom row of the chart.
            let greys = e[18..24].iter().fold(0.0f64, |a, b| a.max(*b));
            assert!(greys < 1.0, "{body} {light}: greys {greys}");
        }
    }
    println!("{text}");
    assert!(fine, "\n{text}");
}

#[test]
fn a_named_light_balances_as_its_own_neutral_does() {
    for body in BODIES {
        for (light, name) in [("A", "tungsten"), ("D65", "cloudy"), ("D65", "6504 K"), ("A", "2856 K")] {
            let greys = &differences(body, light, name)[18..24];
            let worst = greys.iter().fold(0.0f64, |a, b| a.max(*b));
            // The daylight matrix is a compromise with tungsten: its white is exact, D65 by temperature lies 0.003 of uv beside.
            let tolerance = if name.ends_with('K') { 6.0 } else { 1.5 };
            assert!(worst < tolerance, "{body} {light} {name}: {worst}");
        }
    }
}
