//! From camera RGB to colours: what a maker measures with a chart.
//!
//! The 24 ColorChecker patches are photographed under an illuminant (by integration, without noise); matrices are weighted
//! least squares over them. Source of the two matrices' meaning: DNG 1.6, ColorMatrix and ForwardMatrix.

use crate::Sensor;
use diopter_light::cie::colorchecker;
use diopter_light::color::{D50_XY, bradford, xy_from_xyz, xyz_from_xy, xyz_of};
use diopter_light::spectrum::Table;
use glam::{DMat3, DVec3};

/// What a raw file says about colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Camera RGB of a perfect reflector under the illuminant, largest 1.
    pub neutral: DVec3,
    /// Camera RGB from XYZ, for the illuminant.
    pub camera_from_xyz: DMat3,
    /// XYZ under D50 from camera RGB divided by `neutral`; takes (1, 1, 1) to the D50 white.
    pub xyz_d50_from_balanced: DMat3,
}

/// Calibrates a sensor under an illuminant (relative spectral power).
pub fn calibrate(sensor: &Sensor, illuminant: &Table) -> Calibration {
    let responses = sensor.band_responses();
    let in_range = |nm: f32| if (380.0..=780.0).contains(&nm) { illuminant.at(nm) } else { 0.0 };
    let camera = |reflectance: &dyn Fn(f32) -> f32| {
        let channel = |c: usize| {
            let r = &responses[c.min(responses.len() - 1)];
            (380..=780).map(|nm| nm as f32).map(|nm| (r.at(nm) * in_range(nm) * reflectance(nm)) as f64).sum::<f64>()
        };
        DVec3::new(channel(0), channel(1), channel(2))
    };
    let white = camera(&|_| 1.0);
    let white_xyz = xyz_of(in_range);
    if responses.len() == 1 {
        return Calibration {
            neutral: DVec3::ONE,
            camera_from_xyz: DMat3::IDENTITY,
            xyz_d50_from_balanced: DMat3::from_diagonal(xyz_from_xy(D50_XY)),
        };
    }
    let to_d50 = bradford(xy_from_xyz(white_xyz), D50_XY);
    let patches: Vec<(DVec3, DVec3)> = colorchecker()
        .iter()
        .map(|p| {
            let rgb = camera(&|nm| p.reflectance.at(nm)) / white;
            let xyz = xyz_of(|nm| in_range(nm) * p.reflectance.at(nm)) / white_xyz.y;
            (rgb, to_d50 * xyz)
        })
        .collect();
    let neutral = white / white.max_element();
    let forward = least_squares(&patches);
    // XYZ under the illuminant from balanced RGB, undone: the ColorMatrix.
    let camera_from_xyz = DMat3::from_diagonal(neutral) * (to_d50.inverse() * forward).inverse();
    Calibration { neutral, camera_from_xyz, xyz_d50_from_balanced: forward }
}

/// M with M·rgb ≈ xyz over all pairs and M·(1, 1, 1) = D50 exactly. Each pair counts by 1/Y, nearer to how differences are
/// seen than equal weights.
fn least_squares(pairs: &[(DVec3, DVec3)]) -> DMat3 {
    let white = xyz_from_xy(D50_XY);
    let (mut a, mut b) = (DMat3::ZERO, DMat3::ZERO);
    let mut add = |rgb: DVec3, xyz: DVec3, weight: f64| {
        a += DMat3::from_cols(rgb * rgb.x, rgb * rgb.y, rgb * rgb.z) * weight;
        b += DMat3::from_cols(xyz * rgb.x, xyz * rgb.y, xyz * rgb.z) * weight;
    };
    for (rgb, xyz) in pairs {
        add(*rgb, *xyz, 1.0 / xyz.y.max(0.02));
    }
    // The constraint as a pair of overwhelming weight; what is left of its error is removed below.
    add(DVec3::ONE, white, 1e7);
    let m = b * a.inverse();
    DMat3::from_diagonal(white / (m * DVec3::ONE)) * m
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_light::cie::illuminant;
    use diopter_light::color::{delta_e_2000, lab};

    #[test]
    fn patches_come_out_in_their_colours() {
        for (body, limit) in [("canon-5d-mark-iv", 1.6), ("nikon-d850", 1.6), ("sony-a7s-ii", 1.6), ("canon-t2i", 2.0)] {
            for name in ["D65", "D50", "A"] {
                let light = illuminant(name).unwrap();
                let sensor = Sensor::named(body).unwrap();
                let c = calibrate(&sensor, &light);
                let responses = sensor.band_responses();
                let in_range = |nm: f32| if (380.0..=780.0).contains(&nm) { light.at(nm) } else { 0.0 };
                let white_xyz = xyz_of(in_range);
                let d50 = xyz_from_xy(D50_XY);
                let to_d50 = bradford(xy_from_xyz(white_xyz), D50_XY);
                let mut sum = 0.0;
                for patch in colorchecker() {
                    let rgb = |f: &dyn Fn(f32) -> f32| {
                        DVec3::from_array(std::array::from_fn(|k| {
                            (380..=780).map(|nm| nm as f32).map(|nm| (responses[k].at(nm) * in_range(nm) * f(nm)) as f64).sum()
                        }))
                    };
                    let balanced = rgb(&|nm| patch.reflectance.at(nm)) / rgb(&|_| 1.0);
                    let truth = to_d50 * (xyz_of(|nm| in_range(nm) * patch.reflectance.at(nm)) / white_xyz.y);
                    sum += delta_e_2000(lab(c.xyz_d50_from_balanced * balanced, d50), lab(truth, d50));
                }
                let mean = sum / 24.0;
                assert!(mean < limit, "{body} under {name}: mean ΔE2000 {mean:.2}");
                assert!((c.xyz_d50_from_balanced * DVec3::ONE - d50).length() < 1e-9);
            }
        }
    }
}
