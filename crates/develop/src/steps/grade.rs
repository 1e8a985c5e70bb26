//! Grading of display codes: contrast about middle grey, slope, offset, power and saturation.
//!
//! Source: ASC Color Decision List 1.2; saturation about Rec.709 luma.

use super::tone::LUMA;
use crate::setting::section;
use glam::Vec3;

section! {
    /// Grading, by the ASC CDL (version 1.2): (code · slope + offset) ^ power, then saturation about Rec.709 luma.
    Grade "grade" {
        slope: [f64; 3] = [1.0; 3], "", Numbers(3, 0.0, 10.0),
            "factor of the codes of each channel (ASC CDL)";
        offset: [f64; 3] = [0.0; 3], "code", Numbers(3, -1.0, 1.0),
            "added to each channel (ASC CDL)";
        power: [f64; 3] = [1.0; 3], "", Numbers(3, 0.1, 10.0),
            "power of each channel (ASC CDL)";
        saturation: f64 = 1.0, "", Number(0.0, 4.0),
            "distance from grey (ASC CDL)";
        contrast: f64 = 1.0, "", Number(0.1, 4.0),
            "slope about the code of middle grey";
    }
}

/// sRGB code of 18 % grey, about which contrast turns.
const GREY_CODE: f32 = 0.461_356;

/// A grading made ready.
pub struct Grading {
    slope: Vec3,
    offset: Vec3,
    power: Vec3,
    saturation: f32,
    contrast: f32,
}

impl Grading {
    /// `None` where nothing is changed.
    pub fn new(grade: &Grade) -> Option<Self> {
        (*grade != Grade::default()).then(|| Grading {
            slope: Vec3::from(grade.slope.map(|v| v as f32)),
            offset: Vec3::from(grade.offset.map(|v| v as f32)),
            power: Vec3::from(grade.power.map(|v| v as f32)),
            saturation: grade.saturation as f32,
            contrast: grade.contrast as f32,
        })
    }

    /// Graded codes, 0 to `top`: 1, or more where the display can show more than white.
    pub fn apply(&self, code: Vec3, top: f32) -> Vec3 {
        let c = GREY_CODE + (code - GREY_CODE) * self.contrast;
        let c = (c * self.slope + self.offset).clamp(Vec3::ZERO, Vec3::splat(top));
        let c = Vec3::new(c.x.powf(self.power.x), c.y.powf(self.power.y), c.z.powf(self.power.z));
        let luma = Vec3::splat(c.dot(LUMA));
        (luma + (c - luma) * self.saturation).clamp(Vec3::ZERO, Vec3::splat(top))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_order_is_slope_offset_power_saturation() {
        let grade =
            Grade { slope: [1.2, 1.0, 0.8], offset: [0.02, 0.0, -0.02], power: [1.5, 1.0, 0.5], saturation: 0.5, contrast: 1.0 };
        let got = Grading::new(&grade).unwrap().apply(Vec3::new(0.4, 0.5, 0.6), 1.0);
        let v = [(0.4f32 * 1.2 + 0.02).powf(1.5), 0.5, (0.6f32 * 0.8 - 0.02).sqrt()];
        let luma = 0.2126 * v[0] + 0.7152 * v[1] + 0.0722 * v[2];
        for k in 0..3 {
            assert!((got[k] - (luma + 0.5 * (v[k] - luma))).abs() < 1e-6);
        }
        assert!(Grading::new(&Grade::default()).is_none());
    }

    #[test]
    fn contrast_keeps_middle_grey() {
        let grading = Grading::new(&Grade { contrast: 1.5, ..Grade::default() }).unwrap();
        assert!((grading.apply(Vec3::splat(GREY_CODE), 1.0).x - GREY_CODE).abs() < 1e-6);
        assert!(grading.apply(Vec3::splat(0.6), 1.0).x > 0.65);
        assert!((diopter_light::color::srgb_encode(0.18) - GREY_CODE).abs() < 1e-5);
    }
}
