//! Lens files of other programs.
//!
//! Bytes in, checked [`Prescription`] out; every error names file, line and surface. Keywords that are known not to matter are
//! skipped silently, others are named in [`Prescription::notes`]; what would make another lens of it is an error.

mod codev;
mod configurations;
mod fields;
mod iset;
pub(crate) mod layout;
mod off_axis;
mod oslo;
mod pbrt;
pub(crate) mod placed;
mod zemax;

use crate::glass::{Glass, GlassError};
use crate::prescription::{ApertureKind, Prescription, PrescriptionError, Surface, read_toml};

/// Largest file that is read, bytes.
pub const LARGEST_FILE: usize = 16 << 20;

/// A format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Our own.
    Toml,
    /// pbrt and ISET tables (.dat).
    PbrtDat,
    /// Zemax OpticStudio (.zmx).
    Zemax,
    /// CODE V sequence (.seq).
    CodeV,
    /// OSLO (.len).
    Oslo,
    /// ISET (.json).
    Iset,
}

impl Format {
    /// By the ending of a file name.
    pub fn of(name: &str) -> Option<Format> {
        let ending = name.rsplit_once('.')?.1.to_ascii_lowercase();
        Some(match ending.as_str() {
            "toml" => Format::Toml,
            "dat" => Format::PbrtDat,
            "zmx" => Format::Zemax,
            "seq" => Format::CodeV,
            "len" => Format::Oslo,
            "json" => Format::Iset,
            _ => return None,
        })
    }

    /// Endings, for hints.
    pub const ENDINGS: &str = ".toml, .dat (pbrt), .zmx (Zemax), .seq (CODE V), .len (OSLO) or .json (ISET)";
}

/// Reads a lens file. `file` is its name, for errors and as the lens's name where the file has none. Fails on more than
/// [`LARGEST_FILE`] bytes, on what is not text, and on what its format or [`Prescription::checked`] refuses.
pub fn read(bytes: &[u8], format: Format, file: &str) -> Result<Prescription, PrescriptionError> {
    if bytes.len() > LARGEST_FILE {
        let what = format!("{} bytes: a lens file has at most {LARGEST_FILE}", bytes.len());
        return Err(PrescriptionError::at(file, 0, what));
    }
    let text = text(bytes, file)?;
    match format {
        Format::Toml => read_toml(&text, file),
        Format::PbrtDat => pbrt::read(&text, file),
        Format::Zemax => zemax::read(&text, file),
        Format::CodeV => codev::read(&text, file),
        Format::Oslo => oslo::read(&text, file),
        Format::Iset => iset::read(&text, file),
    }
}

/// A note on a temperature, °C, that is not that of the glass catalogues.
fn other_temperature(celsius: f64) -> Option<String> {
    let note = || format!("a temperature of {celsius} °C is not taken over: indices and lengths are those at 20 °C");
    ((celsius - 20.0).abs() > 0.1).then(note)
}

/// A note on a pressure of the air, atm, that is not that of the glass catalogues.
fn other_pressure(atm: f64) -> Option<String> {
    let note = || format!("a pressure of {atm:.3} atm is not taken over: indices are those in air of 1 atm");
    ((atm - 1.0).abs() > 1e-3).then(note)
}

/// UTF-8, UTF-16 with a byte-order mark (or without one, as Zemax sometimes writes), else Latin-1.
fn text(bytes: &[u8], file: &str) -> Result<String, PrescriptionError> {
    let utf16 = |bytes: &[u8], little: bool| {
        let unit = |p: &[u8]| if little { u16::from_le_bytes([p[0], p[1]]) } else { u16::from_be_bytes([p[0], p[1]]) };
        let units: Vec<u16> = bytes.chunks_exact(2).map(unit).collect();
        String::from_utf16_lossy(&units)
    };
    let text = match bytes {
        [0xFF, 0xFE, rest @ ..] => utf16(rest, true),
        [0xFE, 0xFF, rest @ ..] => utf16(rest, false),
        [a, 0, b, 0, ..] if *a != 0 && *b != 0 => utf16(bytes, true),
        [0, a, 0, b, ..] if *a != 0 && *b != 0 => utf16(bytes, false),
        [0xEF, 0xBB, 0xBF, rest @ ..] => String::from_utf8_lossy(rest).into_owned(),
        _ => match std::str::from_utf8(bytes) {
            Ok(text) => text.to_owned(),
            Err(_) => bytes.iter().map(|b| *b as char).collect(),
        },
    };
    // Ends of lines of old Macintosh files.
    let text = if text.contains('\r') && !text.contains('\n') { text.replace('\r', "\n") } else { text };
    let odd = text.chars().filter(|c| c.is_control() && !matches!(c, '\n' | '\r' | '\t' | '\u{c}' | '\u{1a}')).count();
    if odd * 50 > text.len() {
        return Err(PrescriptionError::at(file, 0, "this is not text: expected a lens file"));
    }
    Ok(text)
}

/// File name without folder and ending.
fn stem(file: &str) -> String {
    let name = file.rsplit(['/', '\\']).next().unwrap_or(file);
    name.rsplit_once('.').map_or(name, |(stem, _)| stem).to_owned()
}

/// What a row of the pbrt and ISET tables says by radius and index: the glass behind it, and whether it is the stop. Index 0
/// stands for "as before"; radius 0 without a change of medium is the stop, with one a plane surface.
fn table_row(before: Option<&Surface>, radius: f64, index: f64) -> Result<(Glass, bool), GlassError> {
    let medium = before.map_or(Glass::air(), |s| s.glass.clone());
    let glass = match index {
        0.0 => medium.clone(),
        1.0 => Glass::air(),
        n => Glass::constant(n)?,
    };
    let stop = radius == 0.0 && glass == medium;
    Ok((glass, stop))
}

/// Joins what came as dummy surfaces: planes in air that are not the stop only move what follows. Their sizes in files are drawn and stop no light, but for those of
/// `rims`, by the surfaces of the file; surfaces beyond it have none.
fn drop_dummies(p: &mut Prescription, rims: &[bool]) {
    let mut rims: Vec<bool> = (0..p.surfaces.len()).map(|i| rims.get(i) == Some(&true)).collect();
    let mut i = 0;
    let mut dropped = 0;
    let first_z = p.surfaces.iter().position(|s| s.glass != Glass::air() || s.stop || s.mirror);
    let object = p.usage.object_distance;
    let mut before_first = 0.0;
    while i < p.surfaces.len() {
        let s = &p.surfaces[i];
        let air_before = i == 0 || p.surfaces[i - 1].glass == Glass::air();
        let plain = s.profile == crate::surface::Profile::Plane && s.decenter == [0.0; 2] && s.tilt == [0.0; 3];
        let dummy = plain
            && air_before
            && s.glass == Glass::air()
            && !s.stop
            && !s.mirror
            && !rims[i]
            && !s.is_obscured_or_limited()
            && s.ideal_focal_length.is_none()
            && s.diffractive.is_none();
        if !dummy || p.surfaces.len() == 1 {
            i += 1;
            continue;
        }
        let gap = s.gap.at(0.0, 0.0);
        if i > 0 {
            let own = s.gap.clone();
            let before = &mut p.surfaces[i - 1].gap;
            // Whichever of the two has more positions.
            let rows = before.values.len().max(own.values.len());
            let columns = |g: &crate::prescription::Gap| g.values.iter().map(Vec::len).max().unwrap_or(1);
            let columns = columns(before).max(columns(&own));
            let sum = |row: usize, column: usize| before.at(column as f64, row as f64) + own.at(column as f64, row as f64);
            before.values = (0..rows).map(|r| (0..columns).map(|c| sum(r, c)).collect()).collect();
        } else if s.gap.values.iter().flatten().any(|g| *g != gap) {
            // What moves stays.
            i += 1;
            continue;
        } else if first_z.is_some() {
            before_first += gap;
        }
        p.surfaces.remove(i);
        rims.remove(i);
        dropped += 1;
    }
    if let Some(d) = object {
        p.usage.object_distance = Some(d + before_first);
    }
    if dropped > 0 {
        p.notes.push(format!("{dropped} dummy plane(s) in air left out; surfaces are numbered without them"));
    }
}

/// Sets the aperture of a file that states it on the image side: as the tangent of the angle to the axis at which the outermost ray of the axial beam comes to the
/// image, and as the f-number that this is for an object at infinity. With a nearer object the beam of that cone has an entrance pupil of its own.
fn set_image_cone(p: &mut Prescription, tangent: f64, f_number_at_infinity: f64) {
    p.usage.aperture = Some(ApertureKind::FNumber(f_number_at_infinity));
    if !(tangent > 0.0) {
        return;
    }
    match p.pupil_of_image_cone(tangent) {
        Some(diameter) => p.usage.aperture = Some(ApertureKind::EntrancePupil(diameter)),
        None if p.usage.object_distance.is_some() => p.notes.push(format!(
            "the aperture of the file, f/{f_number_at_infinity} at the image, has no entrance pupil for an object at this distance: it is read as for one at infinity"
        )),
        None => {}
    }
}

/// A list of names for a note, each once.
#[derive(Default)]
struct Skipped(Vec<String>);

impl Skipped {
    fn add(&mut self, name: &str) {
        let name: String = name.chars().take(24).collect();
        if self.0.len() < 40 && !self.0.contains(&name) {
            self.0.push(name);
        }
    }

    fn note(self, p: &mut Prescription) {
        if !self.0.is_empty() {
            p.notes.push(format!("keywords skipped, not known to change the lens: {}", self.0.join(", ")));
        }
    }
}
