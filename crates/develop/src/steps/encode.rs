//! Light of the display to codes, in the primaries and with the transfer function that were asked for.

use crate::setting::{names, section};
use diopter_image::Encoding;
use diopter_light::color::{RgbSpace, srgb_decode, srgb_encode};
use glam::{Mat3, Vec3};
use std::sync::LazyLock;

section! {
    /// What the numbers of the picture mean.
    Output "output" {
        space: Space = Space::Srgb, "", Names(Space::NAMES),
            "primaries; files tell it, by a profile or, sRGB, in their own words";
        encoding: diopter_image::Encoding = diopter_image::Encoding::Srgb, "", Names(&["srgb", "gamma-1.8", "gamma-2.2", "gamma-2.4", "linear", "pq", "hlg"]),
            "transfer function";
        peak: f64 = 4.926, "diffuse whites", Number(1.0, 49.26),
            "brightest light of an HDR picture: 1000 of 203 cd/m²";
    }
}

names! {
    /// Primaries a picture can have.
    Space {
        /// sRGB, Rec.709.
        Srgb = "srgb",
        /// Display P3.
        DisplayP3 = "display-p3",
        /// Rec.2020.
        Rec2020 = "rec2020",
    }
}

/// Steps of the tables of the sRGB functions: errors stay below 1/65535 of a code.
const STEPS: usize = 8192;

/// Both directions of the sRGB function as tables.
struct Tables {
    encode: Vec<f32>,
    decode: Vec<f32>,
}

static TABLES: LazyLock<Tables> = LazyLock::new(|| {
    let tabulated = |f: fn(f32) -> f32| (0..=STEPS + 1).map(|i| f(i as f32 / STEPS as f32)).collect();
    Tables { encode: tabulated(srgb_encode), decode: tabulated(srgb_decode) }
});

// Not `clamp`, which keeps what is not a number.
#[allow(clippy::manual_clamp)]
#[inline]
fn at(table: &[f32], v: f32) -> f32 {
    // Not a number becomes 0.
    let place = v.max(0.0).min(1.0) * STEPS as f32;
    let i = place as usize;
    let (a, b) = (table[i], table[i + 1]);
    a + (place - i as f32) * (b - a)
}

/// sRGB codes of light from 0 to 1; clipped beyond. IEC 61966-2-1, from a table.
#[inline]
pub fn srgb_codes(light: Vec3) -> Vec3 {
    let t = &TABLES.encode;
    Vec3::new(at(t, light.x), at(t, light.y), at(t, light.z))
}

/// Light of sRGB codes.
#[inline]
pub fn srgb_light(codes: Vec3) -> Vec3 {
    let t = &TABLES.decode;
    Vec3::new(at(t, codes.x), at(t, codes.y), at(t, codes.z))
}

/// sRGB codes that go on beyond 0 and 1 by the function itself, odd about 0: for what is graded and may be brighter than white.
#[inline]
pub fn open_codes(light: Vec3) -> Vec3 {
    if light.min_element() >= 0.0 && light.max_element() <= 1.0 {
        return srgb_codes(light);
    }
    light.map(|v| srgb_encode(v.abs()).copysign(v))
}

/// Light of such codes.
#[inline]
pub fn open_light(codes: Vec3) -> Vec3 {
    if codes.min_element() >= 0.0 && codes.max_element() <= 1.0 {
        return srgb_light(codes);
    }
    codes.map(|v| srgb_decode(v.abs()).copysign(v))
}

/// The primaries that a name stands for.
pub fn space(space: Space) -> RgbSpace {
    match space {
        Space::Srgb => RgbSpace::Srgb,
        Space::DisplayP3 => RgbSpace::DisplayP3,
        Space::Rec2020 => RgbSpace::Rec2020,
    }
}

/// The step made ready.
pub struct Encoder {
    from_srgb: Option<Mat3>,
    encoding: Encoding,
    luminance: [f32; 3],
}

impl Encoder {
    /// For what was asked.
    pub fn new(output: &Output) -> Self {
        let to = space(output.space);
        let from_srgb = (to != RgbSpace::Srgb).then(|| to.from_space(RgbSpace::Srgb).as_mat3());
        let luminance = to.luminance_weights();
        Encoder { from_srgb, encoding: output.encoding, luminance }
    }

    /// Codes of linear Rec.709 light.
    #[inline]
    pub fn apply(&self, light: Vec3) -> Vec3 {
        let light = match &self.from_srgb {
            Some(m) => *m * light,
            None => light,
        };
        match self.encoding {
            Encoding::Srgb => srgb_codes(light),
            Encoding::Linear => light,
            other => other.encode_pixel(light.to_array(), self.luminance).into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_as_good_as_the_functions() {
        for i in 0..100_000 {
            let v = i as f32 / 100_000.0;
            let v2 = v * v * v;
            // The largest error of the straight lines lies where the curve leaves its straight part.
            assert!((srgb_codes(Vec3::splat(v2)).x - srgb_encode(v2)).abs() < 1.2e-5, "{v2}");
            assert!((srgb_light(Vec3::splat(v)).x - srgb_decode(v)).abs() < 1e-6, "{v}");
        }
        assert!((srgb_codes(Vec3::new(-1.0, 2.0, f32::NAN)) - Vec3::new(0.0, 1.0, 0.0)).length() < 1e-6);
    }

    #[test]
    fn white_is_white_in_every_space() {
        for space in [Space::Srgb, Space::DisplayP3, Space::Rec2020] {
            let code = Encoder::new(&Output { space, ..Output::default() }).apply(Vec3::ONE);
            assert!((code - Vec3::ONE).length() < 1e-5, "{space:?} {code}");
        }
        // Pure sRGB red in Display P3: 0.9175 0.2003 0.1386 (CSS Color 4, examples).
        let red = Encoder::new(&Output { space: Space::DisplayP3, ..Output::default() }).apply(Vec3::X);
        assert!((red - Vec3::new(0.9175, 0.2003, 0.1386)).length() < 1e-3, "{red}");
    }
}
