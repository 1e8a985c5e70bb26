//! Balanced camera signals → XYZ (D50) → linear sRGB.
//!
//! Source of the choice of a matrix: DNG 1.6, chapter 6, "Mapping camera color space to CIE XYZ space": between two calibrations
//! by the reciprocal of the colour temperature of the shot's neutral.

use crate::region::Planes;
use diopter_image::RawHeader;
use diopter_image::raw::{self, ColorCalibration};
use diopter_light::color::{D50_XY, D65_XY, RgbSpace, bradford, kelvin_from_xy, xy_from_xyz, xyz_from_xy};
use glam::{DMat3, DVec3, Vec3};

/// Linear sRGB of each balanced channel. `neutral`: camera signals of white.
pub fn to_srgb(header: &RawHeader, neutral: &[f64]) -> Vec<Vec3> {
    let to_srgb = RgbSpace::Srgb.xyz_from_rgb().inverse() * bradford(D50_XY, D65_XY);
    forward(header, neutral).iter().map(|c| (to_srgb * *c).as_vec3()).collect()
}

/// Turns camera channels into linear sRGB. `columns`: as [`to_srgb`] gives them.
pub fn apply(channels: &Planes, columns: &[Vec3]) -> Planes {
    let n = channels.region.area();
    let mut rgb: [Vec<f32>; 3] = std::array::from_fn(|_| vec![0.0; n]);
    for (k, plane) in rgb.iter_mut().enumerate() {
        for (channel, column) in channels.planes.iter().zip(columns) {
            let factor = column[k];
            plane.iter_mut().zip(channel).for_each(|(to, v)| *to += factor * v);
        }
    }
    Planes { region: channels.region, planes: rgb.into() }
}

/// Rows of the colour matrix at a temperature; `None` without calibrations.
fn camera_from_xyz(header: &RawHeader, kelvin: f64) -> Option<Vec<DVec3>> {
    Some(raw::camera_from_xyz(&header.calibrations, kelvin)?.into_iter().map(DVec3::from_array).collect())
}

/// Chromaticity (CIE 1931 x, y) of the light that gives a neutral signal; D50 where the file does not tell.
pub fn xy_of_neutral(header: &RawHeader, neutral: &[f64]) -> (f64, f64) {
    // The temperature depends on the matrix it is found with: a few rounds settle it.
    let mut xy = D50_XY;
    for _ in 0..20 {
        let found = camera_from_xyz(header, kelvin_from_xy(xy)).and_then(|rows| xyz_of_signal(&rows, neutral));
        match found.filter(|xyz| xyz.element_sum() > 0.0) {
            Some(xyz) => xy = xy_from_xyz(xyz),
            None => return D50_XY,
        }
    }
    xy
}

/// Camera signal of a white surface in light of a chromaticity; `None` without calibrations. A signal a channel, for white of Y = 1.
pub fn neutral_of_xy(header: &RawHeader, xy: (f64, f64)) -> Option<Vec<f64>> {
    let rows = camera_from_xyz(header, kelvin_from_xy(xy))?;
    Some(rows.iter().map(|r| r.dot(xyz_from_xy(xy))).collect())
}

/// XYZ (D50) of each balanced channel, where `neutral` is the camera signal of white.
pub fn forward(header: &RawHeader, neutral: &[f64]) -> Vec<DVec3> {
    let n = header.cfa.channel_count();
    let Some(last) = header.calibrations.last() else {
        // Without colour all channels are white together.
        return vec![xyz_from_xy(D50_XY) / n as f64; n];
    };
    let Some(fraction) = raw::fraction_of_first(&header.calibrations, kelvin_from_xy(xy_of_neutral(header, neutral))) else {
        return matrix(last, neutral);
    };
    let (a, b) = (matrix(&header.calibrations[0], neutral), matrix(last, neutral));
    a.iter().zip(&b).map(|(a, b)| *a * fraction + *b * (1.0 - fraction)).collect()
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
            baseline_ev: 0.0,
            framing: Default::default(),
            opcodes: vec![],
            warnings: vec![],
            as_shot_neutral: neutral,
            calibrations: vec![calibration(LightSource::A, 1.0), calibration(LightSource::D65, 0.0)],
            noise: vec![],
            facts: ExposureFacts::default(),
        }
    }

    #[test]
    fn matrices_are_mixed_by_reciprocal_temperature() {
        // Whites of A, D50, D65 (CIE 15): the blue of the matrix says how much of A's is taken.
        for (xyz, fraction) in [
            ([1.0985, 1.0, 0.3558], 1.0),
            ([0.9642, 1.0, 0.8251], (1.0 / 5003.0 - 1.0 / 6504.0) / (1.0 / 2856.0 - 1.0 / 6504.0)),
            ([0.9505, 1.0, 1.0891], 0.0),
        ] {
            let got = forward(&header(xyz.to_vec()), &xyz)[2].z;
            assert!((got - fraction).abs() < 0.01, "{xyz:?}: {got} {fraction}");
        }
    }

    #[test]
    fn color_matrices_alone_make_white_white() {
        let mut h = header(vec![1.0985, 1.0, 0.3558]);
        h.calibrations.iter_mut().for_each(|c| c.xyz_d50_from_balanced.clear());
        let white: DVec3 = forward(&h, &h.as_shot_neutral).into_iter().sum();
        assert!((white - xyz_from_xy(D50_XY)).length() < 1e-9, "{white}");
    }
}
