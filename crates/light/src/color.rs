//! RGB spaces, chromatic adaptation, CIELAB and colour difference.
//!
//! Sources: IEC 61966-2-1 (sRGB), SMPTE EG 432-1 (Display P3), ITU-R BT.2020, AMPAS S-2014-004 (ACEScg), Lindbloom
//! (RGB → XYZ from primaries, Bradford), Sharma, Wu & Dalal 2005 (ΔE2000). XYZ is relative with Y = 1 for white.

pub use crate::cie::{luminance, xyz_of};

use crate::table::Table;
use crate::units::LUMINOUS_EFFICACY;
use glam::{DMat3, DVec3, Vec3};

/// CIE xy of the D65 white point as the RGB standards round it.
pub const D65_XY: (f64, f64) = (0.3127, 0.3290);
/// CIE xy of D50 (ICC profile connection space).
pub const D50_XY: (f64, f64) = (0.345_67, 0.358_50);
/// xy of the primaries of ACES2065-1 (AP0). Source: SMPTE ST 2065-1.
pub const AP0_PRIMARIES: [(f64, f64); 3] = [(0.7347, 0.2653), (0.0, 1.0), (0.0001, -0.0770)];
/// CIE xy of the ACES white point.
pub const ACES_XY: (f64, f64) = (0.321_68, 0.337_67);

/// Luminance of linear sRGB (Rec.709) by component. Source: ITU-R BT.709.
pub const SRGB_LUMINANCE: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);

/// Linear sRGB of light over wavelength (nm), in its photometric unit: cd/m² of a spectral radiance, cd, lx. May be negative.
pub fn srgb_of_light(spectrum: impl Fn(f32) -> f32) -> Vec3 {
    (RgbSpace::Srgb.xyz_from_rgb().inverse() * (xyz_of(spectrum) * LUMINOUS_EFFICACY)).as_vec3()
}

impl Table {
    /// Linear sRGB of light of this spectrum, cd/m² of a spectral radiance; see [`srgb_of_light`]. Computed once for each table.
    pub fn srgb_of_light(&self) -> Vec3 {
        *self.srgb_of_light.get_or_init(|| srgb_of_light(|nm| self.at(nm)))
    }
}

/// An RGB space with linear components.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RgbSpace {
    /// sRGB and Rec.709 primaries, D65.
    Srgb,
    /// Display P3, D65.
    DisplayP3,
    /// ITU-R BT.2020, D65.
    Rec2020,
    /// ACEScg (AP1), ACES white.
    AcesCg,
}

impl RgbSpace {
    /// xy of the red, green and blue primary and of white.
    pub fn chromaticities(self) -> ([(f64, f64); 3], (f64, f64)) {
        match self {
            RgbSpace::Srgb => ([(0.64, 0.33), (0.30, 0.60), (0.15, 0.06)], D65_XY),
            RgbSpace::DisplayP3 => ([(0.680, 0.320), (0.265, 0.690), (0.150, 0.060)], D65_XY),
            RgbSpace::Rec2020 => ([(0.708, 0.292), (0.170, 0.797), (0.131, 0.046)], D65_XY),
            RgbSpace::AcesCg => ([(0.713, 0.293), (0.165, 0.830), (0.128, 0.044)], ACES_XY),
        }
    }

    /// What linear red, green and blue weigh in luminance; the sum is 1.
    pub fn luminance_weights(self) -> [f32; 3] {
        self.xyz_from_rgb().row(1).to_array().map(|v| v as f32)
    }

    /// XYZ (Y = 1 for this space's own white) from linear RGB, without adaptation.
    pub fn xyz_from_rgb(self) -> DMat3 {
        let (primaries, white) = self.chromaticities();
        xyz_from_primaries(primaries, white)
    }

    /// Linear RGB of this space from linear RGB of another, adapted (Bradford) where the whites differ.
    pub fn from_space(self, other: RgbSpace) -> DMat3 {
        let adapt = bradford(other.chromaticities().1, self.chromaticities().1);
        self.xyz_from_rgb().inverse() * adapt * other.xyz_from_rgb()
    }
}

/// XYZ (white with Y = 1) from linear RGB with these primaries (red, green, blue) and white, each CIE xy.
pub fn xyz_from_primaries(primaries: [(f64, f64); 3], white: (f64, f64)) -> DMat3 {
    let [r, g, b] = primaries.map(xyz_from_xy);
    let p = DMat3::from_cols(r, g, b);
    p * DMat3::from_diagonal(p.inverse() * xyz_from_xy(white))
}

/// XYZ with Y = 1 of a chromaticity CIE xy, y ≠ 0.
pub fn xyz_from_xy((x, y): (f64, f64)) -> DVec3 {
    DVec3::new(x / y, 1.0, (1.0 - x - y) / y)
}

/// Chromaticity CIE xy of XYZ of any scale; not a number where X + Y + Z is 0.
pub fn xy_from_xyz(xyz: DVec3) -> (f64, f64) {
    let sum = xyz.element_sum();
    (xyz.x / sum, xyz.y / sum)
}

/// Correlated colour temperature of a chromaticity, K, 1000 to 40 000. Source: McCamy 1992, "Correlated color temperature as an explicit function of
/// chromaticity coordinates" (Color Research & Application 17); within 2 K from 2856 to 6500.
pub fn kelvin_from_xy((x, y): (f64, f64)) -> f64 {
    let n = (x - 0.3320) / (0.1858 - y);
    (((449.0 * n + 3525.0) * n + 6823.3) * n + 5520.33).clamp(1000.0, 40_000.0)
}

/// Adapts XYZ seen under the first white to the second, each CIE xy (linear Bradford transform, Lam 1985).
pub fn bradford(from_xy: (f64, f64), to_xy: (f64, f64)) -> DMat3 {
    if from_xy == to_xy {
        return DMat3::IDENTITY;
    }
    let cone = DMat3::from_cols_array(&[
        0.8951, -0.7502, 0.0389, //
        0.2664, 1.7135, -0.0685, //
        -0.1614, 0.0367, 1.0296,
    ]);
    let gain = (cone * xyz_from_xy(to_xy)) / (cone * xyz_from_xy(from_xy));
    cone.inverse() * DMat3::from_diagonal(gain) * cone
}

/// sRGB transfer function: display code in 0..1 from linear light in 0..1; goes on beyond, and is linear below 0. Source: IEC 61966-2-1.
pub fn srgb_encode(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Linear light from an sRGB code in 0..1. Source: IEC 61966-2-1.
pub fn srgb_decode(code: f32) -> f32 {
    if code <= 0.040_45 { code / 12.92 } else { ((code + 0.055) / 1.055).powf(2.4) }
}

/// CIELAB (L*, a*, b*) of XYZ under a white, both of one scale; L* is 100 for the white. Source: CIE 015:2018 §8.2.1.
pub fn lab(xyz: DVec3, white: DVec3) -> DVec3 {
    let f = (xyz / white)
        .to_array()
        .map(|t| if t > (6.0f64 / 29.0).powi(3) { t.cbrt() } else { t / (3.0 * (6.0f64 / 29.0).powi(2)) + 4.0 / 29.0 });
    DVec3::new(116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2]))
}

/// Colour difference CIEDE2000 between two CIELAB colours (L*, a*, b*), kL = kC = kH = 1; 1 is about what is just noticed.
///
/// Source: Sharma, Wu & Dalal, "The CIEDE2000 color-difference formula", Color Res. Appl. 30 (2005), eqs. 2–22.
pub fn delta_e_2000(lab1: DVec3, lab2: DVec3) -> f64 {
    let c_mean = (lab1.y.hypot(lab1.z) + lab2.y.hypot(lab2.z)) / 2.0;
    let g = 0.5 * (1.0 - (c_mean.powi(7) / (c_mean.powi(7) + 25f64.powi(7))).sqrt());
    let (a1, a2) = ((1.0 + g) * lab1.y, (1.0 + g) * lab2.y);
    let (c1, c2) = (a1.hypot(lab1.z), a2.hypot(lab2.z));
    let hue = |b: f64, a: f64| if a == 0.0 && b == 0.0 { 0.0 } else { b.atan2(a).to_degrees().rem_euclid(360.0) };
    let (h1, h2) = (hue(lab1.z, a1), hue(lab2.z, a2));
    let both_coloured = c1 * c2 != 0.0;

    let mut dh = h2 - h1;
    if !both_coloured {
        dh = 0.0;
    } else if dh > 180.0 {
        dh -= 360.0;
    } else if dh < -180.0 {
        dh += 360.0;
    }
    let big_dh = 2.0 * (c1 * c2).sqrt() * (dh / 2.0).to_radians().sin();

    let l_mean = (lab1.x + lab2.x) / 2.0;
    let c_mean = (c1 + c2) / 2.0;
    let h_mean = if !both_coloured {
        h1 + h2
    } else if (h1 - h2).abs() <= 180.0 {
        (h1 + h2) / 2.0
    } else if h1 + h2 < 360.0 {
        (h1 + h2 + 360.0) / 2.0
    } else {
        (h1 + h2 - 360.0) / 2.0
    };
    let cosd = |deg: f64| deg.to_radians().cos();
    let t = 1.0 - 0.17 * cosd(h_mean - 30.0) + 0.24 * cosd(2.0 * h_mean) + 0.32 * cosd(3.0 * h_mean + 6.0)
        - 0.20 * cosd(4.0 * h_mean - 63.0);
    let d_theta = 30.0 * (-((h_mean - 275.0) / 25.0).powi(2)).exp();
    let r_c = 2.0 * (c_mean.powi(7) / (c_mean.powi(7) + 25f64.powi(7))).sqrt();
    let s_l = 1.0 + 0.015 * (l_mean - 50.0).powi(2) / (20.0 + (l_mean - 50.0).powi(2)).sqrt();
    let s_c = 1.0 + 0.045 * c_mean;
    let s_h = 1.0 + 0.015 * c_mean * t;
    let r_t = -(2.0 * d_theta).to_radians().sin() * r_c;
    let (l, c, h) = ((lab2.x - lab1.x) / s_l, (c2 - c1) / s_c, big_dh / s_h);
    (l * l + c * c + h * h + r_t * c * h).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cie::{colorchecker, illuminant};

    #[test]
    fn matrices_agree_with_the_standards() {
        // colour-science 0.4.7, rows of the published matrices.
        let first_rows = [
            (RgbSpace::Srgb, [0.4124, 0.3576, 0.1805], 1e-4),
            (RgbSpace::DisplayP3, [0.486_570_948_6, 0.265_667_693_2, 0.198_217_285_2], 1e-9),
            (RgbSpace::Rec2020, [0.636_958_048_3, 0.144_616_903_6, 0.168_880_975_2], 1e-9),
            (RgbSpace::AcesCg, [0.662_454_181_1, 0.134_004_206_5, 0.156_187_687_0], 1e-9),
        ];
        for (space, row, tolerance) in first_rows {
            let ours = space.xyz_from_rgb().row(0).to_array();
            assert!(ours.iter().zip(row).all(|(a, b)| (a - b).abs() < tolerance), "{space:?} {ours:?}");
        }
        let to_acescg = RgbSpace::AcesCg.from_space(RgbSpace::Srgb).row(0).to_array();
        let published = [0.613_132_422_4, 0.339_538_015_8, 0.047_416_696];
        assert!(to_acescg.iter().zip(published).all(|(a, b)| (a - b).abs() < 2e-4), "{to_acescg:?}");
    }

    #[test]
    fn bradford_takes_illuminant_a_to_d65() {
        let m = bradford((0.447_561, 0.407_431), (0.312_727, 0.329_023));
        // colour-science 0.4.7; its matrix has one digit more than ours, hence 3e-4.
        let published = [0.844_668_46, -0.117_948_77, 0.394_934_3];
        assert!(m.row(0).to_array().iter().zip(published).all(|(a, b)| (a - b).abs() < 3e-4), "{m:?}");
    }

    #[test]
    fn delta_e_2000_agrees_with_sharma() {
        let pairs = [
            ([50.0, 2.6772, -79.7751], [50.0, 0.0, -82.7485], 2.0425),
            ([50.0, 2.5, 0.0], [73.0, 25.0, -18.0], 27.1492),
            ([60.2574, -34.0099, 36.2677], [60.4626, -34.1751, 39.4387], 1.2644),
            ([2.0776, 0.0795, -1.1350], [0.9033, -0.0636, -0.5514], 0.9082),
        ];
        for (a, b, published) in pairs {
            let ours = delta_e_2000(DVec3::from(a), DVec3::from(b));
            assert!((ours - published).abs() < 1e-4, "{ours} {published}");
        }
    }

    #[test]
    fn illuminants_have_their_chromaticity() {
        for (name, x, y) in [("A", 0.447_561, 0.407_431), ("D50", 0.345_684, 0.358_504), ("D65", 0.312_727, 0.329_023)] {
            let table = illuminant(name).unwrap();
            let xy = xy_from_xyz(xyz_of(|nm| if (380.0..=780.0).contains(&nm) { table.at(nm) } else { 0.0 }));
            assert!((xy.0 - x).abs() < 2e-4 && (xy.1 - y).abs() < 2e-4, "{name} {xy:?}");
        }
    }

    #[test]
    fn colorchecker_white_patch_has_its_published_xyz() {
        // dark skin under D65, Y of the illuminant = 100 (colour-science 0.4.7, 380–730 nm data).
        let d65 = illuminant("D65").unwrap();
        let white = xyz_of(|nm| d65.at(nm)).y;
        let dark_skin = &colorchecker()[0].reflectance;
        let xyz = xyz_of(|nm| d65.at(nm) * dark_skin.at(nm)) * (100.0 / white);
        assert!((xyz - DVec3::new(11.1476, 10.07272, 6.80399)).abs().max_element() < 0.05, "{xyz}");
    }

    #[test]
    fn srgb_transfer_runs_both_ways() {
        for i in 0..=255 {
            let code = i as f32 / 255.0;
            assert!((srgb_encode(srgb_decode(code)) - code).abs() < 1e-5);
        }
    }
}
