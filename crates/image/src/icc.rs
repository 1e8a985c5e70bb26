//! Colour profiles and code points that tell other programs what the numbers of a picture mean.
//!
//! Sources: ICC.1:2022; ITU-T H.273 (code points). Profiles are made by the `moxcms` crate.

use crate::{Encoding, ImageError};
use diopter_light::color::RgbSpace;
use moxcms::{ColorProfile, ToneReprCurve};

/// Code points of H.273: primaries, transfer, matrix (RGB), full range. `None` of what has no code there.
pub fn code_points(space: RgbSpace, encoding: Encoding) -> Option<[u8; 4]> {
    let primaries = match space {
        RgbSpace::Srgb => 1,
        RgbSpace::DisplayP3 => 12,
        RgbSpace::Rec2020 => 9,
        RgbSpace::AcesCg => return None,
    };
    let transfer = match encoding {
        Encoding::Srgb => 13,
        Encoding::Linear => 8,
        Encoding::Gamma22 => 4,
        Encoding::Pq => 16,
        Encoding::Hlg => 18,
    };
    Some([primaries, transfer, 0, 1])
}

/// An ICC profile of the codes that are written.
pub fn profile(space: RgbSpace, encoding: Encoding) -> Result<Vec<u8>, ImageError> {
    let mut p = match (space, encoding) {
        (RgbSpace::Srgb, _) => ColorProfile::new_srgb(),
        (RgbSpace::DisplayP3, Encoding::Pq) => ColorProfile::new_display_p3_pq(),
        (RgbSpace::DisplayP3, _) => ColorProfile::new_display_p3(),
        (RgbSpace::Rec2020, Encoding::Pq) => ColorProfile::new_bt2020_pq(),
        (RgbSpace::Rec2020, Encoding::Hlg) => ColorProfile::new_bt2020_hlg(),
        (RgbSpace::Rec2020, _) => ColorProfile::new_bt2020(),
        (RgbSpace::AcesCg, _) => ColorProfile::new_aces_cg_linear(),
    };
    let curve = match encoding {
        Encoding::Gamma22 => Some(ToneReprCurve::Parametric(vec![2.2])),
        Encoding::Linear => Some(ToneReprCurve::Parametric(vec![1.0])),
        // Type 3 of ICC.1 §10.18: (a x + b)^g above d, c x below.
        Encoding::Srgb => Some(ToneReprCurve::Parametric(vec![2.4, 1.0 / 1.055, 0.055 / 1.055, 1.0 / 12.92, 0.040_45])),
        Encoding::Pq | Encoding::Hlg => None,
    };
    if let Some(curve) = curve {
        (p.red_trc, p.green_trc, p.blue_trc) = (Some(curve.clone()), Some(curve.clone()), Some(curve));
        // The curve is what counts: a code point of another function would contradict it.
        p.cicp = p.cicp.filter(|_| space == RgbSpace::Srgb && encoding == Encoding::Srgb);
    }
    p.encode().map_err(|e| ImageError::Io(std::io::Error::other(format!("ICC profile: {e:?}"))))
}
