//! EXIF: the facts of an exposure as tags that every viewer knows.
//!
//! Source: CIPA DC-008-2019 (EXIF 2.32). APEX values: Av = 2 log2 N, Tv = −log2 t, Bv = EV100 − 5.

use crate::tags::{Field, put, written};
use crate::{ExposureFacts, ImageError};
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
    if !f.scene.is_empty() {
        fields.push((270, Field::text(&f.scene)));
    }
    if let Some(date) = &f.date {
        fields.push((306, Field::text(date)));
    }
    fields
}

/// Fields of EXIF's own directory.
pub(crate) fn exif_fields(f: &ExposureFacts) -> Vec<(u16, Field)> {
    let mut fields = vec![(36864, Field::Undefined(b"0232".to_vec()))];
    let mut rational = |tag: u16, value: f64| {
        if value > 0.0 && value.is_finite() {
            fields.push((tag, Field::rational(value)));
        }
    };
    rational(33434, f.exposure_s);
    rational(33437, round(f.f_number));
    rational(37386, round(f.focal_length_mm));
    let mut fields = fields;
    if f.iso > 0.0 {
        // The tag has 16 bits; larger speeds go into the one made for them.
        fields.push((34855, Field::short(f.iso.round().min(65_535.0) as u16)));
        fields.push((34864, Field::short(3)));
        fields.push((34867, Field::long(f.iso.round() as u32)));
    }
    if let Some(date) = &f.date {
        fields.push((36867, Field::text(date)));
        fields.push((36868, Field::text(date)));
    }
    if f.exposure_s > 0.0 {
        fields.push((37377, Field::srational(round(-f.exposure_s.log2()))));
    }
    if f.f_number > 0.0 {
        fields.push((37378, Field::rational(round(2.0 * f.f_number.log2()))));
    }
    if let Some(ev) = f.metered_ev100 {
        fields.push((37379, Field::srational(round(ev - 5.0))));
        // What the exposure differs from what the meter asked for.
        if f.iso > 0.0 && f.f_number > 0.0 && f.exposure_s > 0.0 {
            let t = if f.t_number > 0.0 { f.t_number } else { f.f_number };
            let bias = ev - (t * t / f.exposure_s * 100.0 / f.iso).log2();
            fields.push((37380, Field::srational(round(bias))));
        }
        // Metering mode: average.
        fields.push((37383, Field::short(1)));
    }
    fields.push((37382, Field::rational(f.focus_distance_m.map_or(f64::from(u32::MAX), round))));
    fields.push((37384, Field::short(crate::raw::LightSource::of_illuminant(&f.white).0)));
    fields.push((41986, Field::short(u16::from(f.metered_ev100.is_none()))));
    if let Some(celsius) = f.temperature_c {
        fields.push((37888, Field::srational(round(celsius))));
    }
    let equivalent = f.focal_length_35mm_mm.round();
    if (1.0..65_536.0).contains(&equivalent) {
        fields.push((41989, Field::short(equivalent as u16)));
    }
    for (tag, text) in [(42033, &f.serial), (42036, &f.lens)] {
        if !text.is_empty() {
            fields.push((tag, Field::text(text)));
        }
    }
    fields
}

/// Four decimals: what a person would write, so that the fraction is short.
fn round(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}

/// The block that JPEG (APP1, after its signature) and PNG (`eXIf`) hold: a TIFF of two directories.
pub fn block(facts: &ExposureFacts) -> Result<Vec<u8>, ImageError> {
    let mut bytes = Cursor::new(Vec::new());
    let mut tiff = TiffEncoder::new(&mut bytes).map_err(written)?;
    let mut exif = tiff.extra_directory().map_err(written)?;
    put(&mut exif, &exif_fields(facts))?;
    let place = exif.finish_with_offsets().map_err(written)?.pointer.0 as u32;
    let mut main = tiff.image_directory().map_err(written)?;
    let mut fields = main_fields(facts);
    fields.push((EXIF_DIRECTORY, Field::long(place)));
    put(&mut main, &fields)?;
    main.finish().map_err(written)?;
    Ok(bytes.into_inner())
}
