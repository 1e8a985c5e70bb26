//! Colour profiles and code points that tell other programs what the numbers of a picture mean.
//!
//! Sources: ICC.1:2022; ITU-T H.273 (code points). Profiles are made by the `moxcms` crate.

use crate::encoding::{hlg_decode, pq_decode};
use crate::{Encoding, ImageError};
use diopter_light::color::{D50_XY, RgbSpace, bradford};
use moxcms::{ColorProfile, LocalizableString, Matrix3d, ProfileText, ToneReprCurve, Xyzd};

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
        // H.273 knows no display of these powers.
        Encoding::Gamma18 | Encoding::Gamma24 => return None,
        Encoding::Pq => 16,
        Encoding::Hlg => 18,
    };
    Some([primaries, transfer, 0, 1])
}

/// Points of the curves of HDR profiles.
const CURVE_POINTS: usize = 4096;

/// Where the header of a profile says when it was made (ICC.1 §7.2.8): year, month, day, hours, minutes, seconds.
const CREATED_AT: usize = 24;
const CREATED: [u16; 6] = [2026, 1, 1, 0, 0, 0];

/// White of the connection space, which is that of the medium, too, of displays: their own white is in the adaptation (ICC.1 §7.2.16, §9.2.36).
const PCS_WHITE: Xyzd = Xyzd { x: 0.9642, y: 1.0, z: 0.8249 };

/// An ICC profile of the codes that are written, named after what it describes. Light of HDR profiles is relative to their peak: 10 000 cd/m²
/// of PQ, the nominal peak of HLG. Fails where `moxcms` cannot encode it.
pub fn profile(space: RgbSpace, encoding: Encoding) -> Result<Vec<u8>, ImageError> {
    let (mut p, name) = match space {
        RgbSpace::Srgb => (ColorProfile::new_srgb(), "sRGB"),
        RgbSpace::DisplayP3 => (ColorProfile::new_display_p3(), "Display P3"),
        RgbSpace::Rec2020 => (ColorProfile::new_bt2020(), "Rec.2020"),
        RgbSpace::AcesCg => (ColorProfile::new_aces_cg_linear(), "ACEScg"),
    };
    let tabulated = |f: &dyn Fn(f32) -> f32| {
        let at = |i: usize| (f(i as f32 / (CURVE_POINTS - 1) as f32).clamp(0.0, 1.0) * 65_535.0 + 0.5) as u16;
        ToneReprCurve::Lut((0..CURVE_POINTS).map(at).collect())
    };
    let (curve, function) = match encoding {
        Encoding::Gamma18 => (ToneReprCurve::Parametric(vec![1.8]), "gamma 1.8"),
        Encoding::Gamma22 => (ToneReprCurve::Parametric(vec![2.2]), "gamma 2.2"),
        Encoding::Gamma24 => (ToneReprCurve::Parametric(vec![2.4]), "gamma 2.4"),
        Encoding::Linear => (ToneReprCurve::Parametric(vec![1.0]), "linear"),
        // Type 3 of ICC.1 §10.18: (a x + b)^g above d, c x below.
        Encoding::Srgb => (ToneReprCurve::Parametric(vec![2.4, 1.0 / 1.055, 0.055 / 1.055, 1.0 / 12.92, 0.040_45]), "sRGB curve"),
        Encoding::Pq => (tabulated(&|v| pq_decode(v) / 10_000.0), "PQ"),
        Encoding::Hlg => (tabulated(&hlg_decode), "HLG"),
    };
    (p.red_trc, p.green_trc, p.blue_trc) = (Some(curve.clone()), Some(curve.clone()), Some(curve));
    let white = space.chromaticities().1;
    // Rows.
    let adapted = bradford(white, D50_XY).transpose().to_cols_array_2d();
    p.chromatic_adaptation = Some(Matrix3d { v: adapted });
    (p.white_point, p.media_white_point) = (PCS_WHITE, Some(PCS_WHITE));
    let text = format!("{name}, {function}");
    p.description = Some(ProfileText::Localizable(vec![LocalizableString::new("en".into(), "US".into(), text)]));
    // A code point of another function would contradict the curve; pictures that need one have it beside the profile.
    p.cicp = None;
    let mut bytes = p.encode().map_err(|e| ImageError::Io(std::io::Error::other(format!("ICC profile: {e:?}"))))?;
    // The library writes the time of the call: the same picture would not be the same bytes.
    for (to, number) in bytes[CREATED_AT..].chunks_exact_mut(2).zip(CREATED) {
        to.copy_from_slice(&number.to_be_bytes());
    }
    Ok(bytes)
}

/// Largest difference of a profile's curve from that of an encoding, in light of white, for it to be that encoding: those of "sRGB" profiles with tables of few points differ by less.
const SAME_CURVE: f32 = 0.01;

/// The encoding of the codes of a picture with a profile, by the curve of its green (or grey); `None` of curves that are none of ours, and of profiles that cannot be read.
pub fn encoding_of(profile: &[u8]) -> Option<Encoding> {
    let read = ColorProfile::new_from_slice(profile).ok()?;
    let curve = read.green_trc.or(read.gray_trc)?;
    let light = |code: f32| -> Option<f32> {
        Some(match &curve {
            // Types 0, 3 and 4 of ICC.1 §10.18 as sRGB and powers have them.
            ToneReprCurve::Parametric(p) => match p[..] {
                [g] => code.powf(g),
                [_, _, _, c, d, ..] if code < d => c * code + p.get(6).copied().unwrap_or(0.0),
                [g, a, b, _, _, ..] => (a * code + b).powf(g) + p.get(5).copied().unwrap_or(0.0),
                _ => return None,
            },
            ToneReprCurve::Lut(points) => match points[..] {
                [] => code,
                // A number of 8.8 bits.
                [gamma] => code.powf(f32::from(gamma) / 256.0),
                _ => {
                    let at = code * (points.len() - 1) as f32;
                    let first = (at as usize).min(points.len() - 2);
                    let [a, b] = [points[first], points[first + 1]].map(f32::from);
                    (a + (b - a) * (at - first as f32)) / 65_535.0
                }
            },
        })
    };
    let differs = |encoding: &Encoding| {
        let white = encoding.decode(1.0);
        let ours = |code: f32| if *encoding == Encoding::Hlg { hlg_decode(code) } else { encoding.decode(code) / white };
        (1..20).try_fold(0.0f32, |most, k| {
            let code = k as f32 / 20.0;
            Some(most.max((light(code)? - ours(code)).abs()))
        })
    };
    let all = Encoding::ALL.into_iter().filter_map(|encoding| Some((encoding, differs(&encoding)?)));
    all.filter(|(_, d)| *d < SAME_CURVE).min_by(|a, b| a.1.total_cmp(&b.1)).map(|(encoding, _)| encoding)
}

/// Linear sRGB from linear colours of a picture with a profile, row by row: by the profile's primaries, adapted to the white that profiles have. `None` of profiles without primaries (grey
/// ones, tables alone), of those of sRGB itself, and of what cannot be read.
pub fn srgb_from(profile: &[u8]) -> Option<[[f32; 3]; 3]> {
    /// Of an entry of the matrix: "sRGB" profiles are rounded differently.
    const SAME: f64 = 3e-3;
    let read = ColorProfile::new_from_slice(profile).ok()?;
    let colorants = [read.red_colorant, read.green_colorant, read.blue_colorant];
    if colorants.iter().any(|c| !(c.y > 0.0)) {
        return None;
    }
    let matrix = read.transform_matrix(&ColorProfile::new_srgb()).v;
    let is_other = (0..3).any(|row| (0..3).any(|k| (matrix[row][k] - f64::from(u8::from(row == k))).abs() > SAME));
    let is_finite = matrix.iter().flatten().all(|v| v.is_finite());
    (is_other && is_finite).then(|| matrix.map(|row| row.map(|v| v as f32)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_encoding_is_read_back() {
        for space in [RgbSpace::Srgb, RgbSpace::Rec2020] {
            for encoding in Encoding::ALL {
                assert_eq!(encoding_of(&profile(space, encoding).unwrap()), Some(encoding), "{encoding:?}");
            }
        }
        assert_eq!(encoding_of(b"no profile"), None);
        // Of others: a power of 2.2 as Adobe RGB has it, 563/256.
        let mut p = ColorProfile::new_srgb();
        let curve = ToneReprCurve::Lut(vec![563]);
        (p.red_trc, p.green_trc, p.blue_trc) = (Some(curve.clone()), Some(curve.clone()), Some(curve));
        p.cicp = None;
        assert_eq!(encoding_of(&p.encode().unwrap()), Some(Encoding::Gamma22));
    }
    use diopter_light::color::D65_XY;

    #[test]
    fn colors_of_other_primaries_become_srgb() {
        assert_eq!(srgb_from(&profile(RgbSpace::Srgb, Encoding::Srgb).unwrap()), None);
        assert_eq!(srgb_from(b"no profile"), None);
        for space in [RgbSpace::Rec2020, RgbSpace::DisplayP3] {
            let matrix = srgb_from(&profile(space, Encoding::Gamma22).unwrap()).unwrap();
            // White stays white, and a colour is what the space itself makes of it.
            let times = |c: [f32; 3]| matrix.map(|row| row.iter().zip(c).map(|(m, v)| m * v).sum::<f32>());
            assert!(times([1.0; 3]).iter().all(|v| (v - 1.0).abs() < 2e-3), "{:?}", times([1.0; 3]));
            let color = [0.6f32, 0.3, 0.1];
            let expected = RgbSpace::Srgb.xyz_from_rgb().inverse() * space.xyz_from_rgb();
            let columns = expected.to_cols_array_2d();
            let expected: [f32; 3] = std::array::from_fn(|row| (0..3).map(|k| columns[k][row] as f32 * color[k]).sum());
            let near = times(color).iter().zip(expected).all(|(a, b)| (a - b).abs() < 3e-3);
            assert!(near, "{space:?} {:?} {expected:?}", times(color));
        }
    }

    #[test]
    fn profiles_say_what_the_codes_are() {
        for space in [RgbSpace::Srgb, RgbSpace::DisplayP3, RgbSpace::Rec2020] {
            for encoding in Encoding::ALL {
                let bytes = profile(space, encoding).unwrap();
                assert_eq!(bytes[24..36], [7, 234, 0, 1, 0, 1, 0, 0, 0, 0, 0, 0], "not the time of the call");
                let read = ColorProfile::new_from_slice(&bytes).unwrap();
                let curve = read.red_trc.as_ref().unwrap();
                let at = |code: f32| match curve {
                    ToneReprCurve::Parametric(p) if p.len() == 1 => code.powf(p[0]),
                    ToneReprCurve::Parametric(p) => {
                        if code >= p[4] {
                            (p[1] * code + p[2]).powf(p[0])
                        } else {
                            p[3] * code
                        }
                    }
                    ToneReprCurve::Lut(points) => {
                        f32::from(points[(code * (points.len() - 1) as f32).round() as usize]) / 65_535.0
                    }
                };
                let peak = match encoding {
                    Encoding::Pq => 10_000.0 / crate::encoding::HDR_WHITE_NITS,
                    _ => 1.0,
                };
                for code in [0.1, 0.5, 0.9] {
                    let expected = match encoding {
                        Encoding::Hlg => hlg_decode(code),
                        other => other.decode(code) / peak,
                    };
                    assert!((at(code) - expected).abs() < 2e-3, "{space:?} {encoding:?} {code}: {} {expected}", at(code));
                }
                // The primaries: red of the profile, adapted to D50, against ours.
                let adaptation = bradford(D65_XY, D50_XY);
                let rows = read.chromatic_adaptation.unwrap().v;
                // 1.0479 0.0229 -0.0502 (Lindbloom).
                assert!((rows[0][0] - 1.0479).abs() < 1e-3 && (rows[0][2] + 0.0502).abs() < 1e-3, "{rows:?}");
                // Black of the medium aside, white of the medium under the connection space, and from there back to D65.
                assert!(read.media_white_point.is_some_and(|w| (w.x - 0.9642).abs() < 1e-4 && (w.z - 0.8249).abs() < 1e-4));
                assert_eq!(bytes[68..80], [0, 0, 0xf6, 0xd6, 0, 1, 0, 0, 0, 0, 0xd3, 0x2d]);
                let red = adaptation * space.xyz_from_rgb().x_axis;
                let told = read.red_colorant;
                assert!((told.x - red.x).abs() < 1e-3 && (told.y - red.y).abs() < 1e-3, "{space:?} {told:?} {red}");
            }
        }
    }
}
