//! EXIF: the facts of an exposure as tags that every viewer knows.
//!
//! Source: CIPA DC-008-2019 (EXIF 2.32). APEX values: Av = 2 log2 N, Tv = −log2 t, Bv = EV100 − 5.

use crate::tags::{Field, write_fields, written};
use crate::{Encoding, ExposureFacts, ImageError};
use diopter_light::color::RgbSpace;
use std::io::Cursor;
use tiff::encoder::TiffEncoder;

/// Tag of the main directory that holds the place of EXIF's own.
pub(crate) const EXIF_DIRECTORY: u16 = 34665;

/// Fields of the main directory (IFD0).
pub(crate) fn main_fields(f: &ExposureFacts) -> Vec<(u16, Field)> {
    let mut fields = vec![
        (271, Field::text(&f.make)),
        (272, Field::text(if f.model.is_empty() { &f.body } else { &f.model })),
        (274, Field::short(1)),
        (305, Field::text(&f.software)),
    ];
    fields.push((270, Field::Ascii(description(f))));
    if let Some(date) = &f.date {
        fields.push((306, Field::text(date)));
    }
    fields.retain(|(_, field)| !matches!(field, Field::Ascii(text) if text.is_empty()));
    fields
}

/// What is in the picture: the scene, and of split pixels which photodiodes.
fn description(f: &ExposureFacts) -> String {
    match (f.photodiodes.as_str(), f.scene.as_str()) {
        ("", scene) => scene.to_owned(),
        (side, "") => format!("{side} photodiodes of split pixels"),
        (side, scene) => format!("{scene} ({side} photodiodes of split pixels)"),
    }
}

/// The texts among them, in ASCII.
pub(crate) fn texts(f: &ExposureFacts) -> Vec<(u16, String)> {
    let text = |(tag, field)| match field {
        Field::Ascii(text) if !text.is_empty() => Some((tag, crate::tags::ascii(&text))),
        _ => None,
    };
    main_fields(f).into_iter().filter_map(text).collect()
}

/// Fields of EXIF's own directory.
pub(crate) fn exif_fields(f: &ExposureFacts) -> Vec<(u16, Field)> {
    let mut fields = vec![(36864, Field::Undefined(b"0232".to_vec()))];
    // Short times as one over something.
    let time = if f.exposure_s < 0.3 { 1.0 / round(1.0 / f.exposure_s.max(1e-9)) } else { round(f.exposure_s) };
    let known = if f.exposure_s > 0.0 { time } else { 0.0 };
    for (tag, value) in [(33434, known), (33437, round(f.f_number)), (37386, round(f.focal_length_mm))] {
        if value > 0.0 && value.is_finite() {
            fields.push((tag, Field::rational(value)));
        }
    }
    if f.iso > 0.0 {
        // The tag has 16 bits; larger speeds go into the one made for them.
        fields.push((34855, Field::short(f.iso.round().min(65_535.0) as u16)));
        fields.push((34864, Field::short(3)));
        fields.push((34867, Field::long(f.iso.round() as u32)));
    }
    if let Some(date) = &f.date {
        fields.push((36867, Field::text(date)));
        fields.push((36868, Field::text(date)));
        // The date is UTC.
        fields.extend([36880, 36881, 36882].map(|tag| (tag, Field::text("+00:00"))));
    }
    if f.exposure_s > 0.0 {
        fields.push((37377, Field::srational(round(-f.exposure_s.log2()))));
    }
    if f.f_number > 0.0 {
        fields.push((37378, Field::rational(round(2.0 * f.f_number.log2()))));
    }
    if let Some(ev) = f.metered_ev100 {
        fields.push((37379, Field::srational(round(ev - 5.0))));
        // What was asked for; where everything is set by hand that is 0, but for a bracket.
        fields.push((37380, Field::srational(round(f.compensation_ev + f.bracket_ev.unwrap_or(0.0)))));
        let pattern = match f.metering.as_str() {
            "" | "average" => 1,
            "centre-weighted" => 2,
            "spot" => 3,
            "matrix" => 5,
            _ => 255,
        };
        fields.push((37383, Field::short(pattern)));
    }
    let program = match f.mode.as_str() {
        "M" => Some(1),
        "P" => Some(2),
        "A" => Some(3),
        "S" => Some(4),
        _ => None,
    };
    if let Some(program) = program {
        fields.push((34850, Field::short(program)));
        fields.push((37385, Field::short(u16::from(f.flash))));
    }
    // ExposureMode: automatic, by hand, bracket.
    let mode = match (f.bracket_ev, f.mode.as_str()) {
        (Some(_), _) => 2,
        (None, "M") => 1,
        (None, _) => 0,
    };
    // WhiteBalance: automatic, by hand. SceneCaptureType: standard.
    let balance = u16::from(f.white != "auto");
    fields.extend([(41986, Field::short(mode)), (41987, Field::short(balance)), (41990, Field::short(0))]);
    fields.push((37382, Field::rational(f.focus_distance_m.map_or(f64::from(u32::MAX), round))));
    fields.push((37384, Field::short(crate::raw::LightSource::of_illuminant(&f.white).0)));
    if let Some(celsius) = f.temperature_c {
        fields.push((37888, Field::srational(round(celsius))));
    }
    let equivalent = f.focal_length_35mm_mm.round();
    if (1.0..65_536.0).contains(&equivalent) {
        fields.push((41989, Field::short(equivalent as u16)));
    }
    if let Some(info) = lens_info(f) {
        fields.push((42034, Field::Rationals(info.to_vec())));
    }
    for (tag, text) in [(42033, &f.serial), (42036, &f.lens)] {
        if !text.is_empty() {
            fields.push((tag, Field::text(text)));
        }
    }
    fields
}

/// Shortest and longest focal length, mm, and the least f-numbers there: EXIF's LensSpecification, DNG's LensInfo.
pub(crate) fn lens_info(f: &ExposureFacts) -> Option<[f64; 4]> {
    let set = [f.focal_length_mm, f.f_number];
    let [[short, wide], [long, tele]] = f.lens_range.unwrap_or([set; 2]);
    (f.focal_length_mm > 0.0).then(|| [short, long, wide, tele].map(|v| (v * 1e3).round() / 1e3))
}

/// Four decimals: what a person would write, so that the fraction is short.
fn round(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}

/// What holds a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Holder {
    /// JPEG (APP1, after its signature), of so many pixels: EXIF wants them said again.
    Jpeg {
        /// Pixels a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// PNG (`eXIf`).
    Png,
}

/// What the tag ColorSpace (40961) says of a picture: 1 sRGB, 65535 another ("uncalibrated"), which the profile beside it tells.
pub fn color_space(space: RgbSpace, encoding: Encoding) -> u16 {
    if space == RgbSpace::Srgb && encoding == Encoding::Srgb { 1 } else { 65_535 }
}

/// The block that picture files hold, of colours in `color_space` ([`color_space`]): a TIFF of two directories. Fails where the encoder of the `tiff` crate does.
pub fn block(facts: &ExposureFacts, holder: Holder, color_space: u16) -> Result<Vec<u8>, ImageError> {
    let mut bytes = Cursor::new(Vec::new());
    let mut tiff = TiffEncoder::new(&mut bytes).map_err(written)?;
    let mut fields = exif_fields(facts);
    fields.push((40961, Field::short(color_space)));
    if let Holder::Jpeg { width, height } = holder {
        fields.extend([
            (37121, Field::Undefined(vec![1, 2, 3, 0])),
            (40960, Field::Undefined(b"0100".to_vec())),
            (40962, Field::long(width)),
            (40963, Field::long(height)),
        ]);
    }
    let mut exif = tiff.extra_directory().map_err(written)?;
    write_fields(&mut exif, &fields)?;
    let place = exif.finish_with_offsets().map_err(written)?.pointer.0 as u32;
    let mut main = tiff.image_directory().map_err(written)?;
    let mut fields = main_fields(facts);
    fields.extend([(282, Field::rational(72.0)), (283, Field::rational(72.0)), (296, Field::short(2))]);
    if let Holder::Jpeg { .. } = holder {
        fields.push((531, Field::short(1)));
    }
    fields.push((EXIF_DIRECTORY, Field::long(place)));
    write_fields(&mut main, &fields)?;
    main.finish().map_err(written)?;
    Ok(bytes.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Fields of a directory: tag, type, count, four bytes of value or place.
    fn directory(bytes: &[u8], place: u32) -> Vec<(u16, u16, u32, u32)> {
        let short = |at: usize| u16::from_ne_bytes([bytes[at], bytes[at + 1]]);
        let long = |at: usize| u32::from_ne_bytes(bytes[at..at + 4].try_into().unwrap());
        let start = place as usize;
        (0..short(start) as usize)
            .map(|i| start + 2 + 12 * i)
            .map(|at| (short(at), short(at + 2), long(at + 4), long(at + 8)))
            .collect()
    }

    #[test]
    fn a_block_says_what_was_set() {
        let facts = ExposureFacts {
            make: "Maker".into(),
            model: "Model".into(),
            exposure_s: 1.0 / 60.0,
            f_number: 2.8,
            iso: 102_400.0,
            metered_ev100: Some(3.0),
            focal_length_35mm_mm: 80.6,
            ..Default::default()
        };
        let bytes =
            block(&facts, Holder::Jpeg { width: 7, height: 5 }, color_space(RgbSpace::DisplayP3, Encoding::Srgb)).unwrap();
        let main = directory(&bytes, u32::from_ne_bytes(bytes[4..8].try_into().unwrap()));
        assert!(main.windows(2).all(|w| w[0].0 < w[1].0), "tags rise");
        let find = |d: &[(u16, u16, u32, u32)], tag: u16| *d.iter().find(|f| f.0 == tag).unwrap_or_else(|| panic!("{tag}"));
        let make = find(&main, 271);
        assert_eq!((make.1, make.2, &bytes[make.3 as usize..][..6]), (2, 6, &b"Maker\0"[..]));
        let exif = directory(&bytes, find(&main, EXIF_DIRECTORY).3);
        assert!(exif.windows(2).all(|w| w[0].0 < w[1].0), "tags rise");
        let fraction = |tag: u16| {
            let (_, kind, _, place) = find(&exif, tag);
            let long = |at: usize| i32::from_ne_bytes(bytes[at..at + 4].try_into().unwrap());
            (kind, long(place as usize), long(place as usize + 4))
        };
        assert_eq!([fraction(33434), fraction(33437), fraction(37379)], [(5, 1, 60), (5, 14, 5), (10, -2, 1)]);
        // The old tag holds 65535 at most. A short value stands in the first bytes.
        let short = |tag: u16| u16::from_ne_bytes(find(&exif, tag).3.to_ne_bytes()[..2].try_into().unwrap());
        assert_eq!([short(34855), short(41989)], [65_535, 81]);
        // Display P3 is not sRGB, and nor are sRGB's primaries at another gamma.
        assert_eq!([short(40961), color_space(RgbSpace::Srgb, Encoding::Gamma22)], [65_535; 2]);
        assert_eq!(color_space(RgbSpace::Srgb, Encoding::Srgb), 1);
        assert_eq!([find(&exif, 34867).3, find(&exif, 40962).3], [102_400, 7]);
    }
}
