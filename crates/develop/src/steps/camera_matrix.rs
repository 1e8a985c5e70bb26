//! Balanced camera signals → XYZ (D50) → linear sRGB.
//!
//! Source of the choice of a matrix: DNG 1.6, chapter 6, "Mapping camera color space to CIE XYZ space": between two calibrations
//! by the reciprocal of the colour temperature of the shot's neutral.

use diopter_image::raw::ColorCalibration;
use diopter_image::{Raster, RawHeader};
use diopter_light::color::{D50_XY, D65_XY, RgbSpace, bradford, xy_from_xyz, xyz_from_xy};
use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

/// Turns camera channels into linear sRGB. `forward`: XYZ (D50) of each balanced channel.
pub fn to_linear_srgb(channels: &Raster<f32>, forward: &[DVec3]) -> Raster<f32> {
    let to_srgb = RgbSpace::Srgb.xyz_from_rgb().inverse() * bradford(D50_XY, D65_XY);
    let columns: Vec<Vec3> = forward.iter().map(|c| (to_srgb * *c).as_vec3()).collect();
    let mut rgb = Raster::new(channels.width, channels.height, 3);
    let n = channels.channels;
    rgb.data.par_chunks_mut(3 * 4096).zip(channels.data.par_chunks(n * 4096)).for_each(|(to, from)| {
        for (pixel, signal) in to.chunks_exact_mut(3).zip(from.chunks_exact(n)) {
            let sum: Vec3 = columns.iter().zip(signal).map(|(c, s)| *c * *s).sum();
            pixel.copy_from_slice(&sum.to_array());
        }
    });
    rgb
}

/// XYZ (D50) of each balanced channel under the light of the shot.
pub fn forward(header: &RawHeader) -> Vec<DVec3> {
    let n = header.cfa.channel_count();
    let [first, .., last] = header.calibrations.as_slice() else {
        return match header.calibrations.as_slice() {
            [only] => matrix(only, &header.as_shot_neutral),
            // Without colour all channels are white together.
            _ => vec![xyz_from_xy(D50_XY) / n as f64; n],
        };
    };
    let (Some(warm), Some(cool)) = (first.light.kelvin(), last.light.kelvin()) else {
        return matrix(last, &header.as_shot_neutral);
    };
    let share_at = |kelvin: f64| ((1.0 / kelvin - 1.0 / cool) / (1.0 / warm - 1.0 / cool)).clamp(0.0, 1.0);
    // The temperature of the neutral depends on the matrix it is found with: a few rounds settle it.
    let mut share = 0.5;
    for _ in 0..20 {
        let mixed: Vec<DVec3> = (first.camera_from_xyz.iter().zip(&last.camera_from_xyz))
            .map(|(a, b)| DVec3::from_array(*a) * share + DVec3::from_array(*b) * (1.0 - share))
            .collect();
        let Some(xyz) = xyz_of_signal(&mixed, &header.as_shot_neutral) else {
            share = 0.0;
            break;
        };
        share = share_at(kelvin_of(xy_from_xyz(xyz)));
    }
    let (a, b) = (matrix(first, &header.as_shot_neutral), matrix(last, &header.as_shot_neutral));
    a.iter().zip(&b).map(|(a, b)| *a * share + *b * (1.0 - share)).collect()
}

/// The forward matrix of a calibration; from the colour matrix where there is none.
fn matrix(c: &ColorCalibration, neutral: &[f64]) -> Vec<DVec3> {
    if !c.xyz_d50_from_balanced.is_empty() {
        return c.xyz_d50_from_balanced.iter().map(|c| DVec3::from_array(*c)).collect();
    }
    let rows: Vec<DVec3> = c.camera_from_xyz.iter().map(|r| DVec3::from_array(*r)).collect();
    let white = xyz_of_signal(&rows, neutral).filter(|w| w.y > 0.0).unwrap_or(xyz_from_xy(D50_XY));
    let to_d50 = bradford(xy_from_xyz(white), D50_XY);
    let of = |c: usize| {
        let mut alone = vec![0.0; neutral.len()];
        alone[c] = neutral[c];
        to_d50 * xyz_of_signal(&rows, &alone).unwrap_or(DVec3::ZERO) / white.y
    };
    (0..neutral.len()).map(of).collect()
}

/// The XYZ that gives a camera signal (least squares), from the rows of a colour matrix; `None` with fewer than three channels.
fn xyz_of_signal(rows: &[DVec3], signal: &[f64]) -> Option<DVec3> {
    let square = rows.iter().fold(DMat3::ZERO, |sum, r| sum + DMat3::from_cols(*r * r.x, *r * r.y, *r * r.z));
    let (size, scale) = (square.determinant(), square.col(0).x + square.col(1).y + square.col(2).z);
    (rows.len() >= 3 && size.abs() > 1e-12 * scale.powi(3)).then_some(())?;
    Some(square.inverse() * rows.iter().zip(signal).map(|(r, s)| *r * *s).sum::<DVec3>())
}

/// Correlated colour temperature, K. Source: McCamy 1992, "Correlated color temperature as an explicit function of
/// chromaticity coordinates" (Color Research & Application 17); within 2 K from 2856 to 6500.
fn kelvin_of((x, y): (f64, f64)) -> f64 {
    let n = (x - 0.3320) / (0.1858 - y);
    (((449.0 * n + 3525.0) * n + 6823.3) * n + 5520.33).clamp(1000.0, 40_000.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_image::raw::LightSource;
    use diopter_image::{Cfa, ExposureFacts};

    fn header(neutral: Vec<f64>) -> RawHeader {
        // A camera whose channels are XYZ themselves.
        let calibration = |light, blue: f64| ColorCalibration {
            light,
            camera_from_xyz: vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            xyz_d50_from_balanced: vec![[0.9642, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, blue]],
        };
        RawHeader {
            cfa: Cfa::parse("RG/GB").unwrap(),
            bits: 14,
            black_level: 0.0,
            white_level: 1000.0,
            as_shot_neutral: neutral,
            calibrations: vec![calibration(LightSource::A, 1.0), calibration(LightSource::D65, 0.0)],
            noise: vec![],
            facts: ExposureFacts::default(),
        }
    }

    #[test]
    fn matrices_are_mixed_by_reciprocal_temperature() {
        // Whites of A, D50, D65 (CIE 15): the blue of the matrix says how much of A's is taken.
        for (xyz, share) in [
            ([1.0985, 1.0, 0.3558], 1.0),
            ([0.9642, 1.0, 0.8251], (1.0 / 5003.0 - 1.0 / 6504.0) / (1.0 / 2856.0 - 1.0 / 6504.0)),
            ([0.9505, 1.0, 1.0891], 0.0),
        ] {
            let got = forward(&header(xyz.to_vec()))[2].z;
            assert!((got - share).abs() < 0.01, "{xyz:?}: {got} {share}");
        }
    }

    #[test]
    fn color_matrices_alone_make_white_white() {
        let mut h = header(vec![1.0985, 1.0, 0.3558]);
        h.calibrations.iter_mut().for_each(|c| c.xyz_d50_from_balanced.clear());
        let white: DVec3 = forward(&h).into_iter().sum();
        assert!((white - xyz_from_xy(D50_XY)).length() < 1e-9, "{white}");
    }
}
