//! From camera signals to colours: what a maker measures with a chart.
//!
//! The 24 ColorChecker patches are photographed under an illuminant (by integration, without noise); matrices are weighted
//! least squares over them. Source of the two matrices' meaning: DNG 1.6, ColorMatrix and ForwardMatrix.

use crate::Sensor;
use diopter_image::raw::{ColorCalibration, LightSource};
use diopter_light::cie::{colorchecker, illuminant};
use diopter_light::color::{D50_XY, bradford, xy_from_xyz, xyz_from_xy, xyz_of};
use diopter_light::spectrum::Table;
use glam::{DMat3, DMat4, DVec3, DVec4};

/// Signals of a sensor's channels (up to four; the rest 0) for light of a spectrum, on an even field. The spectrum is summed from
/// 380 to 780 nm, each nm.
pub fn signals(sensor: &Sensor, responses: &[Table], spectrum: &dyn Fn(f32) -> f32) -> DVec4 {
    let alone: Vec<f64> =
        responses.iter().map(|r| (380..=780).map(|nm| nm as f32).map(|nm| (r.at(nm) * spectrum(nm)) as f64).sum()).collect();
    let mixed = sensor.mixed_by_crosstalk(&alone);
    DVec4::from_array(std::array::from_fn(|c| mixed.get(c).copied().unwrap_or(0.0)))
}

/// Seven decimals, which the fractions of a raw file hold as they are.
fn short(value: f64) -> f64 {
    (value * 1e7).round() / 1e7
}

/// Signals of a perfect reflector under an illuminant (relative spectral power), a channel each, largest 1.
pub fn neutral(sensor: &Sensor, light: &Table) -> Vec<f64> {
    let n = sensor.cfa.channel_count();
    let white = signals(sensor, &sensor.band_responses(), &|nm| in_range(light, nm));
    (0..n).map(|c| short(white[c] / white.max_element())).collect()
}

fn in_range(light: &Table, nm: f32) -> f32 {
    if (380.0..=780.0).contains(&nm) { light.at(nm) } else { 0.0 }
}

/// Patches of a chart under a light: balanced signals, and XYZ adapted to D50.
fn patches(sensor: &Sensor, responses: &[Table], light: &Table) -> Vec<(DVec4, DVec3)> {
    let n = sensor.cfa.channel_count();
    let camera = |reflectance: &dyn Fn(f32) -> f32| signals(sensor, responses, &|nm| in_range(light, nm) * reflectance(nm));
    let white = camera(&|_| 1.0);
    let white_xyz = xyz_of(|nm| in_range(light, nm));
    let to_d50 = bradford(xy_from_xyz(white_xyz), D50_XY);
    let per_channel = DVec4::from_array(std::array::from_fn(|c| if c < n { 1.0 / white[c] } else { 0.0 }));
    colorchecker()
        .iter()
        .map(|p| {
            let signal = camera(&|nm| p.reflectance.at(nm)) * per_channel;
            let xyz = xyz_of(|nm| in_range(light, nm) * p.reflectance.at(nm)) / white_xyz.y;
            (signal, to_d50 * xyz)
        })
        .collect()
}

/// Weight of the patches under illuminant A in a colour matrix for daylight. Many converters (dcraw, LibRaw, darktable) know
/// that matrix only and use it under any light; the forward matrix, and how white comes out, do not depend on it.
const TUNGSTEN_WEIGHT: f64 = 0.35;

/// Calibrates a sensor under an illuminant (relative spectral power).
pub fn calibrate(sensor: &Sensor, light: &Table, source: LightSource) -> ColorCalibration {
    let n = sensor.cfa.channel_count();
    let responses = sensor.band_responses();
    let white = signals(sensor, &responses, &|nm| in_range(light, nm));
    let white_xyz = xyz_of(|nm| in_range(light, nm));
    let to_d50 = bradford(xy_from_xyz(white_xyz), D50_XY);
    // Channels there are not count as dark and leave a 1 on the diagonal.
    let used = DVec4::from_array(std::array::from_fn(|c| if c < n { 1.0 } else { 0.0 }));
    let own: Vec<(DVec4, DVec3, f64)> = patches(sensor, &responses, light).into_iter().map(|(s, x)| (s, x, 1.0)).collect();
    let forward = forward_matrix(&own, used);
    let mut shared = own;
    if source == LightSource::D65
        && let Some(tungsten) = illuminant("A")
    {
        shared.extend(patches(sensor, &responses, &tungsten).into_iter().map(|(s, x)| (s, x, TUNGSTEN_WEIGHT)));
    }
    let scale = white / white.max_element();
    let camera_from_xyz = match n {
        // XYZ under the illuminant from balanced signals, undone.
        3 => {
            let forward = forward_matrix(&shared, used);
            let balanced = DMat3::from_cols(forward[0], forward[1], forward[2]);
            let m = DMat3::from_diagonal(scale.truncate()) * (to_d50.inverse() * balanced).inverse();
            m.transpose().to_cols_array_2d().to_vec()
        }
        // More or fewer channels than three have no such inverse: fitted the other way round.
        _ => {
            let (mut a, mut b) = (DMat3::ZERO, [DVec3::ZERO; 4]);
            let under_light = to_d50.inverse();
            for (signal, xyz, weight) in &shared {
                let (weight, xyz) = (weight / xyz.y.max(0.02), under_light * *xyz);
                a += DMat3::from_cols(xyz * xyz.x, xyz * xyz.y, xyz * xyz.z) * weight;
                (0..n).for_each(|c| b[c] += xyz * signal[c] * weight);
            }
            // White gives the neutral exactly: least squares under a constraint.
            let (inverse, white) = (a.inverse(), under_light * xyz_from_xy(D50_XY));
            let towards = inverse * white / white.dot(inverse * white);
            let row = |c: usize| {
                let free = inverse * b[c];
                (free + towards * (1.0 - white.dot(free))) * scale[c]
            };
            (0..n).map(|c| row(c).to_array()).collect()
        }
    };
    ColorCalibration {
        light: source,
        camera_from_xyz: camera_from_xyz.into_iter().map(|row| row.map(short)).collect(),
        xyz_d50_from_balanced: (0..n).map(|c| forward[c].to_array().map(short)).collect(),
    }
}

/// The calibrations a raw file carries: illuminant A and D65; none for a monochrome sensor.
pub fn calibrations(sensor: &Sensor) -> Vec<ColorCalibration> {
    if sensor.cfa.is_colorless() {
        return Vec::new();
    }
    [("A", LightSource::A), ("D65", LightSource::D65)]
        .iter()
        .filter_map(|(name, source)| Some(calibrate(sensor, &illuminant(name)?, *source)))
        .collect()
}

/// Columns of M with M·signal ≈ xyz over all pairs and M·(1, 1, 1, 1) = D50 exactly (Lagrange). Each pair counts by 1/Y, nearer
/// to how differences are seen than equal weights. With more channels than three nearly the smallest M that does it.
fn forward_matrix(pairs: &[(DVec4, DVec3, f64)], used: DVec4) -> [DVec3; 4] {
    let mut a = DMat4::from_diagonal(DVec4::ONE - used);
    let mut b = [DVec3::ZERO; 4];
    for (s, xyz, weight) in pairs {
        let weight = weight / xyz.y.max(0.02);
        a += DMat4::from_cols(*s * s.x, *s * s.y, *s * s.z, *s * s.w) * weight;
        (0..4).for_each(|c| b[c] += *xyz * s[c] * weight);
    }
    // A little of the unit matrix keeps channels apart that see nearly the same.
    a += DMat4::from_diagonal(used * 1e-6);
    let inverse = a.inverse();
    let free: [DVec3; 4] = std::array::from_fn(|c| (0..4).map(|k| b[k] * inverse.col(c)[k]).sum());
    let missing = xyz_from_xy(D50_XY) - (0..4).map(|c| free[c] * used[c]).sum::<DVec3>();
    let towards = inverse * used / used.dot(inverse * used);
    std::array::from_fn(|c| free[c] + missing * towards[c])
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_light::color::{delta_e_2000, lab};

    fn mean_difference(sensor: &Sensor, name: &str) -> f64 {
        let light = illuminant(name).unwrap();
        let c = calibrate(sensor, &light, LightSource::OTHER);
        let responses = sensor.band_responses();
        let n = sensor.cfa.channel_count();
        let white = signals(sensor, &responses, &|nm| in_range(&light, nm));
        let white_xyz = xyz_of(|nm| in_range(&light, nm));
        let d50 = xyz_from_xy(D50_XY);
        let to_d50 = bradford(xy_from_xyz(white_xyz), D50_XY);
        let developed = |signal: DVec4| -> DVec3 {
            (0..n).map(|k| DVec3::from_array(c.xyz_d50_from_balanced[k]) * (signal[k] / white[k])).sum()
        };
        assert!((developed(white) - d50).length() < 1e-6);
        let difference = |reflectance: &Table| {
            let light_off = |nm: f32| in_range(&light, nm) * reflectance.at(nm);
            let truth = to_d50 * (xyz_of(light_off) / white_xyz.y);
            delta_e_2000(lab(developed(signals(sensor, &responses, &light_off)), d50), lab(truth, d50))
        };
        colorchecker().iter().map(|p| difference(&p.reflectance)).sum::<f64>() / 24.0
    }

    #[test]
    fn patches_come_out_in_their_colours() {
        for (body, limit) in [("canon-5d-mark-iv", 1.6), ("nikon-d850", 1.6), ("sony-a7s-ii", 1.6), ("canon-t2i", 2.0)] {
            for name in ["D65", "D50", "A"] {
                let mean = mean_difference(&Sensor::named(body).unwrap(), name);
                assert!(mean < limit, "{body} under {name}: mean ΔE2000 {mean:.2}");
            }
        }
    }

    #[test]
    fn crosstalk_and_clear_pixels_are_calibrated_too() {
        let mut s = Sensor::named("canon-5d-mark-iv").unwrap();
        s.crosstalk = 0.03;
        let mean = mean_difference(&s, "D65");
        assert!(mean < 1.6, "crosstalk: {mean:.2}");
        s.cfa = diopter_image::Cfa::parse("rgbw").unwrap();
        let clear = Table::new(
            380.0,
            5.0,
            (0..81).map(|i| s.quantum_efficiency.iter().map(|q| q.at(380.0 + 5.0 * i as f32)).sum()).collect(),
        );
        s.quantum_efficiency.push(clear);
        let mean = mean_difference(&s, "D65");
        assert!(mean < 1.8, "rgbw: {mean:.2}");
    }

    #[test]
    fn color_matrices_undo_forward_matrices() {
        // ColorMatrix of the white is the neutral: what converters find the white balance from.
        for (body, pattern) in [("nikon-d850", "RG/GB"), ("nikon-d850", "rgbw")] {
            let mut s = Sensor::named(body).unwrap();
            s.cfa = diopter_image::Cfa::parse(pattern).unwrap();
            if pattern == "rgbw" {
                s.quantum_efficiency.push(s.quantum_efficiency[1].scaled(1.1));
            }
            let light = illuminant("D65").unwrap();
            let c = calibrate(&s, &light, LightSource::D65);
            let white = xyz_of(|nm| in_range(&light, nm));
            let signal: Vec<f64> = c.camera_from_xyz.iter().map(|r| DVec3::from_array(*r).dot(white / white.y)).collect();
            for (a, b) in signal.iter().zip(neutral(&s, &light)) {
                assert!((a / b - 1.0).abs() < 2e-3, "{pattern}: {signal:?}");
            }
        }
    }
}
