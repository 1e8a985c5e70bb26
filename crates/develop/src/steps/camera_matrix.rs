//! Balanced camera RGB → XYZ (D50) → linear sRGB.

use diopter_image::Raster;
use diopter_light::color::{D50_XY, D65_XY, RgbSpace, bradford};
use glam::{DMat3, DVec3, Mat3, Vec3};

/// Turns camera colours into linear sRGB, in place. `forward`: rows of the matrix from balanced camera RGB to XYZ (D50).
pub fn to_linear_srgb(rgb: &mut Raster<f32>, forward: &[[f64; 3]; 3]) {
    let forward =
        DMat3::from_cols(DVec3::from_array(forward[0]), DVec3::from_array(forward[1]), DVec3::from_array(forward[2])).transpose();
    let m: Mat3 = (RgbSpace::Srgb.xyz_from_rgb().inverse() * bradford(D50_XY, D65_XY) * forward).as_mat3();
    for pixel in rgb.data.chunks_exact_mut(3) {
        pixel.copy_from_slice(&(m * Vec3::from_slice(pixel)).to_array());
    }
}
