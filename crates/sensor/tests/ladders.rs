//! Read-noise ladders of real cameras, measured on the simulated ones: darks and flats through the whole read-out.

use diopter_image::{ExposureFacts, FocalPlane};
use diopter_light::cie::illuminant;
use diopter_sensor::{Reading, Sensor, read_out};

/// ISO, read noise in DN and in e⁻.
type Ladder = [(f64, f64, f64)];

/// Source: C. Buil, astrosurf.com/buil/50d/test.htm (40D, 50D, 5D, 5D Mark II; e⁻ printed to one decimal) and ELD camera
/// parameters (Wei et al., CVPR 2020) for the 700D.
const LADDERS: &[(&str, &Ladder)] = &[
    ("canon-40d", &[(100.0, 5.66, 19.0), (200.0, 6.31, 10.6), (400.0, 8.15, 6.8), (800.0, 12.59, 5.3), (1600.0, 21.37, 4.5)]),
    ("canon-50d", &[(100.0, 6.59, 15.0), (200.0, 7.15, 8.2), (400.0, 8.56, 4.9), (800.0, 12.08, 3.4), (1600.0, 19.04, 2.7)]),
    ("canon-5d", &[(100.0, 1.88, 30.0), (200.0, 1.92, 15.3), (400.0, 2.06, 8.2), (800.0, 2.55, 5.1), (1600.0, 3.77, 3.8)]),
    (
        "canon-5d-mark-ii",
        &[(100.0, 6.66, 26.9), (200.0, 6.71, 13.5), (400.0, 7.18, 7.3), (800.0, 8.27, 4.2), (1600.0, 11.15, 2.8)],
    ),
    (
        "canon-700d",
        &[
            (100.0, 4.737, 10.583),
            (200.0, 7.446, 8.317),
            (400.0, 11.704, 6.537),
            (800.0, 18.397, 5.137),
            (1600.0, 28.917, 4.037),
            (3200.0, 45.453, 3.173),
            (6400.0, 71.445, 2.494),
        ],
    ),
];

const SIDE: usize = 300;

/// Mean and standard deviation, DN, of an even field.
fn read(sensor: &Sensor, electrons: f32, iso: f64) -> (f64, f64) {
    let bands = sensor.bands();
    let signal = vec![electrons; bands.len()];
    let plane = FocalPlane::even(bands, &signal, [SIDE, SIDE], ExposureFacts { exposure_s: 0.001, ..Default::default() });
    let raw = read_out(&plane, sensor, &Reading::new(iso, 5), &illuminant("D65").unwrap()).unwrap();
    let n = (SIDE * SIDE) as f64;
    let mean = raw.mosaic.data.iter().map(|d| f64::from(*d)).sum::<f64>() / n;
    let variance = raw.mosaic.data.iter().map(|d| (f64::from(*d) - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean - raw.header.black_level, variance.sqrt())
}

/// A body as its ladder was measured: noise of rows and fixed patterns set aside.
fn body(name: &str) -> Sensor {
    let mut sensor = Sensor::named(name).unwrap();
    sensor.prnu = 0.0;
    sensor.iso.iter_mut().for_each(|i| i.row_noise_e = 0.0);
    sensor
}

#[test]
fn read_noise_is_the_measured_one_at_every_iso() {
    // 90 000 pixels give σ within 0.24 %; the printed figures are rounded by up to 1.5 % (15.0 stands for 15.02, 2.7 for 2.71).
    for (name, ladder) in LADDERS {
        let sensor = body(name);
        for (iso, dn, electrons) in ladder.iter() {
            let (_, sigma) = read(&sensor, 0.0, *iso);
            let gain = sensor.at_iso(*iso).unwrap().gain_e_per_dn;
            assert!((sigma / dn - 1.0).abs() < 0.03, "{name} ISO {iso}: {sigma} DN, measured {dn}");
            assert!((sigma * gain / electrons - 1.0).abs() < 0.03, "{name} ISO {iso}: {} e-, measured {electrons}", sigma * gain);
        }
    }
}

#[test]
fn equal_light_is_noisier_at_low_iso_and_equal_brightness_at_high_iso() {
    for (name, ladder) in LADDERS {
        let sensor = body(name);
        // The same light, within range at every setting: less read noise at higher ISO.
        let mut last = 0.0;
        for (iso, _, electrons) in ladder.iter().take(5) {
            let light = 300.0f32;
            let (mean, sigma) = read(&sensor, light, *iso);
            let expected = f64::from(light) / (f64::from(light) + electrons * electrons).sqrt();
            assert!((mean / sigma / expected - 1.0).abs() < 0.02, "{name} ISO {iso}: {} {expected}", mean / sigma);
            assert!(mean / sigma > last, "{name} ISO {iso}");
            last = mean / sigma;
        }
        // The same brightness in the picture, half the light a step: S/N falls by what table and photons say.
        let middle = 0.1 * sensor.saturation_e(&sensor.at_iso(100.0).unwrap());
        let (first, _) = read(&sensor, middle as f32, 100.0);
        for (iso, _, electrons) in ladder.iter() {
            let light = middle * 100.0 / iso;
            let (mean, sigma) = read(&sensor, light as f32, *iso);
            assert!((mean / first - 1.0).abs() < 0.01, "{name}: ISO {iso} needs {iso}/100 less light for the same numbers");
            let expected = light / (light + electrons * electrons).sqrt();
            assert!((mean / sigma / expected - 1.0).abs() < 0.02, "{name} ISO {iso}: {} {expected}", mean / sigma);
        }
    }
}
