//! A lens, a film and a place in the world.

use diopter_lens::Lens;
use glam::{Affine3A, Mat3A, Vec3, Vec3A};

/// The film: how large, and into how many pixels the picture is cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Film {
    /// mm.
    pub width_mm: f64,
    /// mm.
    pub height_mm: f64,
    /// Pixels a row.
    pub columns: usize,
    /// Rows.
    pub rows: usize,
    /// Area that collects the light of a pixel, mm². A picture of fewer pixels than the sensor has keeps the sensor's pixel:
    /// it shows what single pixels of the real sensor, spread over the format, would have counted.
    pub pixel_area_mm2: f64,
}

impl Film {
    /// A film whose pixels are as large as their share of the format.
    pub fn new(width_mm: f64, height_mm: f64, columns: usize, rows: usize) -> Self {
        let pixel_area_mm2 = width_mm * height_mm / (columns * rows) as f64;
        Film { width_mm, height_mm, columns, rows, pixel_area_mm2 }
    }
}

/// A camera ready to be exposed.
#[derive(Clone, Debug)]
pub struct Camera {
    /// Collects the light.
    pub lens: Lens,
    /// Records it.
    pub film: Film,
    /// Where it stands; it looks along −Z with +Y up.
    pub world_from_camera: Affine3A,
}

/// Why a camera cannot be placed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlacementError {
    /// Eye and target coincide.
    #[error("look-from and look-at are the same point {0}: move one of them")]
    NoDirection(Vec3),
    /// Up does not say how to turn.
    #[error("up {up} points along the direction of view {view}: choose an up across it, such as {hint}")]
    DegenerateUp {
        /// The up given.
        up: Vec3,
        /// Unit direction of view.
        view: Vec3,
        /// One that works.
        hint: Vec3,
    },
    /// Not a number.
    #[error("look-from, look-at and up must be finite numbers; found {0}")]
    NotFinite(Vec3),
}

/// Places a camera at `from`, looking at `at`, with `up` upwards in the picture.
pub fn look_at(from: Vec3, at: Vec3, up: Vec3) -> Result<Affine3A, PlacementError> {
    if let Some(bad) = [from, at, up].into_iter().find(|v| !v.is_finite()) {
        return Err(PlacementError::NotFinite(bad));
    }
    let view = (at - from).try_normalize().ok_or(PlacementError::NoDirection(from))?;
    let degenerate = || {
        let hint = if view.y.abs() < 0.9 { Vec3::Y } else { Vec3::Z };
        PlacementError::DegenerateUp { up, view, hint }
    };
    let right = view.cross(up.try_normalize().ok_or_else(degenerate)?);
    if right.length() < 1e-4 {
        return Err(degenerate());
    }
    let right = right.normalize();
    let true_up = right.cross(view);
    let axes = Mat3A::from_cols(right.into(), true_up.into(), (-view).into());
    Ok(Affine3A { matrix3: axes, translation: Vec3A::from(from) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looks_along_minus_z_with_x_to_the_right() {
        let m = look_at(Vec3::new(0.0, 0.0, 5.0), Vec3::ZERO, Vec3::Y).unwrap();
        assert!((m.matrix3 - Mat3A::IDENTITY).abs_diff_eq(Mat3A::ZERO, 1e-6));
        let m = look_at(Vec3::ZERO, Vec3::X, Vec3::Y).unwrap();
        assert!((m.transform_vector3(Vec3::NEG_Z) - Vec3::X).length() < 1e-6);
        assert!((m.transform_vector3(Vec3::X) - Vec3::Z).length() < 1e-6);
    }

    #[test]
    fn degenerate_up_is_an_error_with_a_hint() {
        let e = look_at(Vec3::ZERO, Vec3::Y, Vec3::Y).unwrap_err();
        assert!(e.to_string().contains("such as [0, 0, 1]"), "{e}");
        assert!(look_at(Vec3::ONE, Vec3::ONE, Vec3::Y).is_err());
        assert!(look_at(Vec3::ZERO, Vec3::X, Vec3::ZERO).is_err());
        assert!(look_at(Vec3::ZERO, Vec3::X * f32::NAN, Vec3::Y).is_err());
    }
}
