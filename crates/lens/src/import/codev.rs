//! CODE V sequence files (.seq): commands, `;` between them, `!` before comments, `&` before a continued line.
//!
//! Written from the command names as the files show them and as ray-optics reads them. Without `RDM` (or with `RDM N`) surfaces
//! carry curvatures, with it radii. Words of more than three letters are known by their first three (`TITLE`, `STOP`).
//!
//! | command | what is done |
//! |---|---|
//! | RDM, TIT, DIM, EPD, NAO, WL, REF, YAN, VUY, VLY, PRV PWL LAU END | read (other formulas of private glasses: error) |
//! | FNO, NA | on the image side: for an object at a finite distance the entrance pupil of the beam of that cone; NA of one at infinity is the f-number 1/(2 NA) |
//! | SO, S, SI; STO, RDY, CUY, THI, GLA, RMD | read; a distance may be `inf` or `infinity` |
//! | SPH, CON, ASP with K, A to J | read |
//! | CYL, YTO with RDX or CUX | read |
//! | DIF DOE with HOR, HWL, HCT R, HCO C1, C2, ... | read: path in lens units at HWL, of r², r⁴, ... |
//! | SPS XYP, SPS ZFR with SCO K, NRADIUS, Cn | read: powers of x and y; fringe Zernike terms from C4 (C1 conic constant, C3 radius) |
//! | AAS with K or KY, KX | read as a biconic; its higher terms AR, BR, CR, DR: error unless 0 |
//! | XDE, YDE, ZDE, ADE, BDE, CDE with DAR, REV, BEN or alone | read, on SI too; see layout.rs. ADE and BDE follow the left hand |
//! | CIR, CIR OBS, CIR HOL | read; a hole blocks, since light that passes it is not followed |
//! | REX REY, ELX ELY, also OBS and HOL; ADX, ADY (of CIR too) | read; one half width alone: the circle of it, with a note |
//! | names NAME_VENDOR; codes 517.642, 517642, 517642.1, 1.5168:64.17; private glasses | read; aliases with a note (glass/alias.rs) |
//! | XAN, YIM, YOB, XIM, XOB, XRI, YRI | read as the angles of them where the lens is round (fields.rs), with a note; else left out, with a note |
//! | PUI, PUX, PUY, TEL | left out, with a note |
//! | curvature of SI | taken for plane, with a note |
//! | solves of gaps and curvatures (THI HMY ...), pickups (PIK) | the figure of the surface's row stands, with a note |
//! | TEM, PRE other than 20 °C and 1 atm | left out, with a note |
//! | other solves, couplings, weights, tolerances, drawing, coatings (`HARMLESS`) | ignored: rays do not change |
//! | after GO | commands that are not read are skipped, named in a note |
//! | ZOO n, ZOO THI Sk ..., THI Sk Zi ... | gaps of zoom positions, or a near focus (configurations.rs) |
//! | other commands zoomed | the first position stands, with a note; shapes and glasses: error |
//! | AFI; HOE, GRT, other SPS; all others | error |

mod surface;
mod syntax;

use self::surface::{Decenter, Kind, Opening, Place, Special};
use self::syntax::{commands, is_qualifier, surface_number, words};
use super::configurations::{Configurations, MOST as MOST_CONFIGURATIONS};
use super::fields::{FieldKind, Fields};
use super::layout::{ahead, lay_out};
use super::placed::Placed;
use super::{Skipped, drop_dummies, other_pressure, other_temperature, stem};
use crate::aperture::Outline;
use crate::glass::{C_NM, D_NM, F_NM, G_NM, Glass, parse_foreign};
use crate::prescription::{ApertureKind, Prescription, PrescriptionError, Surface};
use crate::surface::Profile;
use glam::DAffine3;
use std::collections::HashMap;

/// Commands that do not change the lens: solves that have been solved, couplings, variables, tolerances, drawing, weights.
const HARMLESS: &[&str] = &[
    "LEN", "INI", "WTW", "WTF", "WTX", "WTY", "VUX", "VLX", "CUM", "THM", "PIM", "PIB", "SLB", "DER", "VAL", "CLS", "CWL", "CA",
    "CCY", "CCX", "CUC", "RDC", "THC", "GLC", "KC", "KXC", "KYC", "AC", "BC", "CC", "DC", "EC", "FC", "GC", "HC", "JC", "ARC",
    "BRC", "CRC", "DRC", "APC", "BPC", "CPC", "DPC", "XDC", "YDC", "ZDC", "ADC", "BDC", "CDC", "XOC", "YOC", "ZOC", "POL", "PFR",
    "SET", "EDI", "UNI", "AFC", "CRT", "CVY", "IMG", "WID", "RAY", "LIN", "SAV", "LIS", "FTY", "XFN", "PTP", "MFL", "DSP", "CIN",
    "CIX", "GL1", "CTE", "COM", "DLT", "DLF", "DLR", "DLN", "DLX", "DLY", "DLZ", "DLA", "DLB", "DLG", "DLS", "DLV", "DLC", "HCC",
    "HWC", "SCC", "BTX", "BTY", "CMP", "MNT", "MXT", "MNE", "MXE",
];
/// Solves of a gap or a curvature by the height, slope or incidence of the marginal or the chief ray, and of the paraxial image; CODE V writes the
/// figure it has found in the surface's own row.
const SOLVES: &[&str] = &[
    "HMY", "HMX", "HCY", "HCX", "UMY", "UMX", "UCY", "UCX", "IMY", "IMX", "ICY", "ICX", "APY", "APX", "ECY", "ECX", "PIM", "PIY",
    "PIX",
];
/// Commands of the use of a lens, which may differ between zoom positions.
const UNSHAPED: &[&str] = &[
    "YAN", "XAN", "YIM", "XIM", "YOB", "XOB", "YRI", "XRI", "VUY", "VLY", "EPD", "FNO", "NA", "NAO", "WL", "REF", "CIR", "TIT",
    "PUI", "PUX", "PUY",
];
/// Commands of shapes and places that are not read, and what they are.
const REFUSED: &[(&str, &str)] = &[
    ("AFI", "an afocal lens has no film"),
    ("GRI", "gradient-index glass is not traced"),
    ("HOE", "of diffractive surfaces DIF DOE is read"),
    ("GRT", "diffraction gratings are not read"),
    ("XTO", "a toroid with its polynomial in x is not read: turn the lens and write YTO"),
    ("ZRN", "Zernike surfaces are not read"),
    ("NSS", "only sequential lenses are read"),
    ("GLB", "global coordinates are not read: write decenters of each surface"),
    ("RET", "a return to another surface's coordinates is not read: write REV with the same figures"),
    ("CIG", "grouped apertures are not read"),
    ("REG", "grouped apertures are not read"),
    ("ELG", "grouped apertures are not read"),
];

struct Current {
    surface: Surface,
    c: f64,
    k: f64,
    a: Vec<f64>,
    kind: Kind,
    c_x: Option<f64>,
    k_x: f64,
    place: Place,
    /// Opening, and what blocks (OBS, HOL).
    openings: [Opening; 2],
    /// A curvature or (true) radius given by name.
    written: Option<(f64, bool)>,
    special: Special,
}

/// What a command is about.
#[derive(Clone, Copy)]
enum Target {
    Nothing,
    Object,
    Image,
    Row(usize),
}

/// Reads a sequence file; `file` is its name in errors. Fails, naming line and surface, on commands and figures that are not read (table above)
/// and on what [`Prescription::checked`] refuses.
pub fn read(text: &str, file: &str) -> Result<Prescription, PrescriptionError> {
    let mut p = Prescription::new(stem(file), vec![]);
    let mut skipped = Skipped::default();
    let mut radii: Option<bool> = None;
    let mut scale = 1.0;
    let mut rows: Vec<Current> = vec![];
    let mut object: Option<f64> = None;
    let mut image: Option<f64> = None;
    let mut image_place = Place::NONE;
    let mut image_curved = false;
    // Whether SI and GO have been read.
    let (mut ended, mut gone) = (false, false);
    let (mut upper, mut lower): (Vec<f64>, Vec<f64>) = (vec![], vec![]);
    // In x and in y.
    let (mut field_kind, mut fields): (FieldKind, [Vec<f64>; 2]) = (FieldKind::Angle, Default::default());
    // Tangent of the outermost ray at the image, and the f-number of that for an object at infinity.
    let mut image_cone: Option<[f64; 2]> = None;
    // Private catalogue: wavelengths, then names with indices.
    let (mut private, mut private_nm): (HashMap<String, PrivateGlass>, Vec<f64>) = (HashMap::new(), vec![]);
    let mut in_private = false;
    let mut configurations = Configurations::default();
    for (number, command) in commands(text) {
        let words = words(&command);
        let Some(first) = words.first() else { continue };
        let rest = &words[1..];
        let whole_key = first.to_uppercase();
        let surface_row = whole_key == "S" || (whole_key.len() > 1 && surface_number(&whole_key).is_some());
        let at_surface = rows.len() + usize::from(surface_row && !in_private);
        let wrong = |what: String| {
            let e = PrescriptionError::at(file, number, what);
            if at_surface > 0 { e.surface(at_surface) } else { e }
        };
        if in_private {
            match whole_key.as_str() {
                "END" => in_private = false,
                "PWL" => private_nm = rest.iter().filter_map(|w| w.parse().ok()).collect(),
                _ => {
                    let parse = |w: &String| distance(w).filter(|v| v.is_finite());
                    let laurent = rest.first().is_some_and(|w| w.eq_ignore_ascii_case("LAU"));
                    let n: Option<Vec<f64>> = rest[usize::from(laurent)..].iter().map(parse).collect();
                    let n = n.filter(|n| !laurent || n.len() == 6).ok_or_else(|| {
                        wrong(format!(
                            "private glass {first}: expected indices, one for each wavelength of PWL, or LAU and six coefficients"
                        ))
                    })?;
                    let found = if laurent { PrivateGlass::Laurent(n) } else { PrivateGlass::Indices(n) };
                    private.insert(whole_key.trim_matches('\'').to_owned(), found);
                }
            }
            continue;
        }
        let key: String = if surface_row { "S".into() } else { whole_key.chars().take(3).collect() };
        let number_of = |w: &str, what: &str| {
            distance(w).filter(|v| v.is_finite()).ok_or_else(|| wrong(format!("{what} \"{w}\": expected a number")))
        };
        // The last word; before it only which surface, zoom position or aperture is meant. A solve would have other words there.
        let value = || {
            let Some((last, before)) = rest.split_last() else {
                return Err(wrong(format!("{key}: expected a number after it")));
            };
            match before.iter().find(|w| !is_qualifier(w)) {
                Some(odd) => {
                    Err(wrong(format!("{key} {}: \"{odd}\" is not read: expected one number, no solve", rest.join(" "))))
                }
                None => number_of(last, &key),
            }
        };
        let numbers = || rest.iter().filter_map(|w| w.parse::<f64>().ok()).collect::<Vec<f64>>();
        match key.as_str() {
            "RDM" => radii = Some(rest.first().is_none_or(|w| !w.to_uppercase().starts_with('N'))),
            "TIT" => p.name = rest.join(" ").trim_matches(['\'', '"']).to_owned(),
            "DIM" => {
                scale = match rest.first().map(|w| w.to_uppercase()).as_deref() {
                    Some("M" | "MM") | None => 1.0,
                    Some("C" | "CM") => 10.0,
                    Some("I" | "IN") => 25.4,
                    Some(other) => return Err(wrong(format!("DIM {other}: expected M, C or I"))),
                }
            }
            "EPD" => (p.usage.aperture, image_cone) = (Some(ApertureKind::EntrancePupil(value()?)), None),
            "FNO" => {
                let n = value()?;
                image_cone = Some([0.5 / n, n]);
            }
            "NA" => {
                let na = value()?;
                if !(na > 0.0 && na < 1.0) {
                    return Err(wrong(format!("NA {na}: expected a number between 0 and 1")));
                }
                image_cone = Some([na / (1.0 - na * na).sqrt(), 0.5 / na]);
            }
            "NAO" => (p.usage.aperture, image_cone) = (Some(ApertureKind::ObjectNa(value()?)), None),
            "WL" => p.usage.wavelengths_nm = numbers(),
            "REF" => p.usage.reference = (value()? as usize).saturating_sub(1),
            "YAN" | "YIM" | "YOB" | "YRI" => (field_kind, fields[1]) = (kind_of_field(&key), numbers()),
            "XAN" | "XIM" | "XOB" | "XRI" => (field_kind, fields[0]) = (kind_of_field(&key), numbers()),
            "PUI" | "PUX" | "PUY" => note(&mut p, "the pupil's apodisation (PUI, PUX, PUY) is left out"),
            "TEM" | "PRE" => {
                // °C, and millimetres of mercury; in one zoom position or all.
                let value = rest.last().and_then(|w| w.parse::<f64>().ok());
                let other =
                    if key == "TEM" { value.and_then(other_temperature) } else { value.and_then(|v| other_pressure(v / 760.0)) };
                if let Some(text) = other {
                    note(&mut p, &text);
                }
            }
            "TEL" => note(&mut p, "TEL is left out: the stop alone says which rays pass"),
            "VUY" => upper = numbers(),
            "VLY" => lower = numbers(),
            "PRV" => in_private = true,
            "GO" => gone = true,
            "SO" => {
                object = rest
                    .get(1)
                    .map(|w| distance(w).ok_or_else(|| wrong(format!("object distance \"{w}\": expected a number or inf"))))
                    .transpose()?
            }
            "SI" => {
                ended = true;
                image = rest.get(1).map(|w| number_of(w, "image gap")).transpose()?;
                image_curved |= rest.first().map(|w| radius_or_curvature(w, &number_of)).transpose()?.is_some_and(|c| c != 0.0);
            }
            "S" => {
                if ended {
                    return Err(wrong("a surface after the image surface SI".into()));
                }
                if rows.len() >= crate::prescription::MOST_SURFACES {
                    return Err(wrong(format!("more than {} surfaces", crate::prescription::MOST_SURFACES)));
                }
                let shape = rest.first().map_or(Ok(0.0), |w| radius_or_curvature(w, &number_of))?;
                let gap = rest.get(1).map_or(Ok(0.0), |w| number_of(w, "gap"))?;
                let (mut glass, mut mirror) = (Glass::air(), false);
                for name in rest.iter().skip(2) {
                    match name.to_uppercase().as_str() {
                        "REFL" => mirror = true,
                        "REFR" => {}
                        upper => glass = self::glass(upper, &private, &private_nm, &mut p).map_err(&wrong)?,
                    }
                }
                let surface = Surface { line: number, mirror, ..Surface::new(Profile::Plane, gap, glass) };
                rows.push(Current {
                    surface,
                    c: shape,
                    k: 0.0,
                    a: vec![],
                    kind: Kind::Rotational,
                    c_x: None,
                    k_x: 0.0,
                    place: Place::NONE,
                    openings: [Opening::default(); 2],
                    written: None,
                    special: Special::default(),
                });
            }
            "ZOO" => {
                let Some(what) = rest.first() else { return Err(wrong("ZOO: expected a number of positions".into())) };
                if let Ok(count) = what.parse::<usize>() {
                    if !(1..=MOST_CONFIGURATIONS).contains(&count) {
                        return Err(wrong(format!("ZOO {count}: expected 1 to {MOST_CONFIGURATIONS} positions")));
                    }
                    configurations.count = count;
                    continue;
                }
                let what: String = what.to_uppercase().chars().take(3).collect();
                if what != "THI" {
                    if !(HARMLESS.contains(&what.as_str()) || UNSHAPED.contains(&what.as_str())) {
                        return Err(wrong(format!("ZOO {what}: of lenses only gaps (THI) are read in several positions")));
                    }
                    let values = rest[1..].join(" ");
                    configurations.other(&what, "", "");
                    configurations.other(&what, "", &values);
                    continue;
                }
                let target = target(&rest[1..], rows.len(), ended).map_err(|what| wrong(format!("ZOO THI {what}")))?;
                let values = rest[1..].iter().filter(|w| !is_qualifier(w));
                for (i, word) in values.enumerate() {
                    let value = distance(word).ok_or_else(|| wrong(format!("ZOO THI \"{word}\": expected a number")))?;
                    note_gap(&mut configurations, target, i, value).map_err(&wrong)?;
                }
            }
            // The figure stands as it is written; aspheric and zoomed figures have no solves.
            "THI" | "CUY" | "CUX" | "RDY" | "RDX" if rest.iter().any(|w| SOLVES.contains(&w.to_uppercase().as_str())) => {
                note(
                    &mut p,
                    &format!("the solve {key} {} is left out: the figure that the file has there stands", rest.join(" ")),
                );
            }
            "THI" if zoom_of(rest).is_some() => {
                let target = target(rest, rows.len(), ended).map_err(|what| wrong(format!("THI {what}")))?;
                let word = rest.last().map_or("", String::as_str);
                let value = distance(word).ok_or_else(|| wrong(format!("THI \"{word}\": expected a number")))?;
                note_gap(&mut configurations, target, zoom_of(rest).unwrap_or(1) - 1, value).map_err(&wrong)?;
            }
            "PIM" => note(
                &mut p,
                "the solve PIM (the image at the paraxial focus) is left out: the figure that the file has there stands",
            ),
            "PIK" => {
                note(&mut p, &format!("the pickup PIK {} is left out: the figure that the file has there stands", rest.join(" ")))
            }
            other if HARMLESS.contains(&other) => {}
            other => {
                if let Some(zoom) = zoom_of(rest).filter(|z| *z > 1) {
                    return Err(wrong(format!(
                        "{other} of zoom position {zoom}: of lenses only gaps (THI) are read in several positions"
                    )));
                }
                if let Some((_, why)) = REFUSED.iter().find(|r| r.0 == other) {
                    return Err(wrong(format!("{other}: {why}")));
                }
                let target = target(rest, rows.len(), ended).map_err(|what| wrong(format!("{other} {what}")))?;
                let row = match target {
                    Target::Row(i) => &mut rows[i],
                    Target::Image => {
                        match other {
                            "THI" => image = Some(value()?),
                            "CUY" | "CUX" | "RDY" | "RDX" | "K" | "A" | "B" | "C" | "D" => image_curved |= value()? != 0.0,
                            "SPH" | "CON" | "ASP" | "CIR" | "REX" | "REY" | "ELX" | "ELY" | "ADX" | "ADY" => {}
                            _ if place(&mut image_place, other, value)? => {}
                            _ if gone => skipped.add(other),
                            _ => return Err(wrong(format!("{other}: not read for the image surface"))),
                        }
                        continue;
                    }
                    Target::Object if other == "THI" => {
                        let last = rest.last().map_or("", String::as_str);
                        object = Some(distance(last).ok_or_else(|| wrong(format!("THI \"{last}\": expected a number or inf")))?);
                        continue;
                    }
                    Target::Object | Target::Nothing if gone => {
                        skipped.add(other);
                        continue;
                    }
                    Target::Object => return Err(wrong(format!("{other}: not read for the object surface"))),
                    Target::Nothing => return Err(wrong(unknown(other))),
                };
                let power = |row: &mut Current, power: usize| -> Result<(), PrescriptionError> {
                    row.a.resize(row.a.len().max(power + 1), 0.0);
                    row.a[power] = value()?;
                    Ok(())
                };
                let upper_rest: Vec<String> = rest.iter().map(|w| w.to_uppercase()).collect();
                let says = |word: &str| upper_rest.iter().any(|w| w == word);
                match other {
                    "STO" => row.surface.stop = true,
                    "K" | "KY" => row.k = value()?,
                    "KX" => row.k_x = value()?,
                    "ASP" | "SPH" | "CON" => {}
                    "A" => power(row, 4)?,
                    "B" => power(row, 6)?,
                    "C" => power(row, 8)?,
                    "D" => power(row, 10)?,
                    "E" => power(row, 12)?,
                    "F" => power(row, 14)?,
                    "G" => power(row, 16)?,
                    "H" => power(row, 18)?,
                    "J" => power(row, 20)?,
                    "RDY" | "CUY" => {
                        let v = value()?;
                        row.written = Some((v, other == "RDY"));
                    }
                    "THI" => row.surface.gap = crate::prescription::Gap::fixed(value()?),
                    "GLA" => {
                        let name = rest.last().map_or(String::new(), |w| w.to_uppercase());
                        row.surface.glass = self::glass(&name, &private, &private_nm, &mut p).map_err(wrong)?;
                    }
                    "RMD" => row.surface.mirror = says("REFL"),
                    // A cylinder is straight along x unless it is told otherwise.
                    "CYL" => {
                        row.kind = Kind::Toroid;
                        row.c_x = row.c_x.or(Some(0.0));
                    }
                    "YTO" => row.kind = Kind::Toroid,
                    "AAS" => row.kind = Kind::Anamorphic,
                    "DIF" => {
                        let what = rest.iter().find(|w| surface_number(w).is_none()).map(|w| w.to_uppercase());
                        if what.as_deref() != Some("DOE") {
                            let what = what.unwrap_or_default();
                            return Err(wrong(format!("DIF {what}: of diffractive surfaces DIF DOE is read")));
                        }
                        row.special.is_diffractive = true;
                    }
                    "HOR" => row.special.order = Some(value()?),
                    "HWL" => row.special.wavelength_nm = Some(value()?),
                    "HCT" => {
                        if !says("R") {
                            return Err(wrong(format!("HCT {}: expected R, powers of r²", rest.join(" "))));
                        }
                    }
                    "HCO" => {
                        let number = coefficient_number(rest).filter(|n| (1..=24).contains(n));
                        let number = number.ok_or_else(|| wrong("HCO: expected C1 to C24 and a number".into()))?;
                        row.special.path.resize(row.special.path.len().max(number), 0.0);
                        row.special.path[number - 1] = value()?;
                    }
                    "SPS" => {
                        row.special.shape = Some(match () {
                            _ if says("XYP") => "XYP",
                            _ if says("ZFR") => "ZFR",
                            _ => return Err(wrong(format!("SPS {}: of special surfaces XYP and ZFR are read", rest.join(" ")))),
                        });
                    }
                    "SCO" => {
                        let last = rest.last().map_or("", String::as_str);
                        let v = number_of(last, "SCO")?;
                        match coefficient_number(rest) {
                            _ if says("NRADIUS") => row.special.norm = Some(v),
                            _ if says("K") => row.k = v,
                            Some(n) if n <= 128 => {
                                row.special.coefficients.resize(row.special.coefficients.len().max(n), 0.0);
                                row.special.coefficients[n - 1] = v;
                            }
                            _ => return Err(wrong(format!("SCO {}: expected K, NRADIUS or C1 to C128", rest.join(" ")))),
                        }
                    }
                    "CUX" => row.c_x = Some(value()?),
                    "RDX" => {
                        let r = value()?;
                        row.c_x = Some(if r == 0.0 { 0.0 } else { 1.0 / r });
                    }
                    // Terms of an anamorphic asphere beyond the biconic, and the Fresnel base of an asphere.
                    "AR" | "BR" | "CR" | "DR" | "CUF" | "XOD" | "YOD" | "ZOD" | "ARO" => {
                        let v = value()?;
                        if v != 0.0 {
                            let what = match other {
                                "CUF" => "Fresnel surfaces are not traced",
                                "XOD" | "YOD" | "ZOD" => "a pivot beside the vertex is not read",
                                "ARO" => "an aperture that is turned is not read",
                                _ => "terms of an anamorphic asphere beyond the biconic are not read",
                            };
                            return Err(wrong(format!("{other} {v}: {what}: expected 0")));
                        }
                    }
                    // How those terms depend on the direction: nothing without them.
                    "AP" | "BP" | "CP" | "DP" => {}
                    "CIR" => {
                        if says("OBS") || says("HOL") {
                            // Nothing is there: light passes the hole beside the reflected path, or is lost.
                            row.surface.obstruction = value()?;
                        } else if !says("EDG") {
                            row.surface.semi_diameter = Some(value()?);
                        }
                    }
                    "REX" | "REY" | "ELX" | "ELY" => {
                        if !says("EDG") {
                            let opening = &mut row.openings[usize::from(says("OBS") || says("HOL"))];
                            let is_rectangle = other.starts_with('R');
                            // Another shape than before replaces it.
                            let mut half = opening.shape.filter(|s| s.0 == is_rectangle).map_or([0.0; 2], |s| s.1);
                            half[usize::from(other.ends_with('Y'))] = value()?;
                            opening.shape = Some((is_rectangle, half));
                        }
                    }
                    "ADX" | "ADY" => {
                        if !says("EDG") {
                            let opening = &mut row.openings[usize::from(says("OBS") || says("HOL"))];
                            opening.center[usize::from(other == "ADY")] = value()?;
                        }
                    }
                    _ if place(&mut row.place, other, value)? => {}
                    _ if gone => skipped.add(other),
                    _ => return Err(wrong(unknown(other))),
                }
            }
        }
    }
    if rows.is_empty() {
        return Err(PrescriptionError::at(file, 0, "no surfaces: expected S lines of curvature or radius, gap and glass"));
    }
    if !ended {
        let what = "no image surface SI behind the last surface: expected a whole file, is it cut short?";
        return Err(PrescriptionError::at(file, text.lines().count(), what));
    }
    let shapes: Vec<f64> = rows.iter().map(|r| r.c.abs()).filter(|c| *c > 0.0).collect();
    let by_radius = radii.unwrap_or_else(|| {
        // Curvatures all above 1/mm would be lenses smaller than a grain: someone forgot RDM.
        let radii = !shapes.is_empty() && shapes.iter().all(|c| *c > 1.0);
        if radii {
            p.notes.push("no RDM, but the figures can only be radii: read as radii".into());
        }
        radii
    });
    p.usage.object_distance = object.map(|d| d * scale).filter(|d| *d < 1e9);
    if p.usage.reference >= p.usage.wavelengths_nm.len() {
        p.usage.reference = 0;
    }
    // Where each surface stands, through the decenters.
    let moved = image_place.given || rows.iter().any(|r| r.place.given);
    let cuts = (0..upper.len().max(lower.len())).map(|i| [&upper, &lower].map(|of| of.get(i).copied().unwrap_or(0.0)));
    let fields = Fields::new(field_kind, [&fields[0], &fields[1]], cuts.collect(), scale);
    let has_others = !fields.set_angles(&mut p, moved);
    let mut placed: Vec<Placed> = vec![];
    let mut here = DAffine3::IDENTITY;
    let mut rims = vec![];
    for r in rows {
        let (line, number) = (r.surface.line, placed.len() + 1);
        let wrong = |what: &str| PrescriptionError::at(file, line, what).surface(number);
        let (figure, is_radius) = r.written.unwrap_or((r.c, by_radius));
        let c = if is_radius && figure != 0.0 { 1.0 / figure } else { figure } / scale;
        let c_x = r.c_x.map(|c| c / scale);
        let a: Vec<f64> = r.a.iter().enumerate().map(|(i, v)| v * f64::powi(scale, 1 - i as i32)).collect();
        let profile = match r.kind {
            Kind::Anamorphic if a.iter().any(|v| *v != 0.0) => {
                return Err(wrong("AAS with A, B, ...: an anamorphic asphere has AR, BR, ..."));
            }
            Kind::Anamorphic => crate::prescription::biconic([c_x.unwrap_or(c), r.k_x], [c, r.k]),
            Kind::Toroid if c_x.is_none() => return Err(wrong("YTO without RDX or CUX: expected its radius in x")),
            _ if r.k_x != 0.0 => return Err(wrong("KX without AAS: only an anamorphic asphere has a conic constant in x")),
            _ => crate::prescription::profile(c, r.k, a, c_x),
        };
        let mut s = r.surface;
        s.profile = r.special.freeform(c, r.k, scale).map_err(|e| wrong(&e))?.unwrap_or(profile);
        s.diffractive = r.special.diffractive(scale).map_err(|e| wrong(&e))?;
        if s.mirror {
            // A mirror goes on in what was before it.
            s.glass = placed.last().map_or(Glass::air(), |before| before.surface.glass.clone());
        }
        s.gap.values[0][0] *= scale;
        if let Some(opening) = r.openings[0].aperture(s.semi_diameter, false).map_err(|what| wrong(&what))? {
            s.apertures.push(opening.scaled(scale));
            s.semi_diameter = None;
        } else if let Some((_, [x, y])) = r.openings[0].shape {
            s.semi_diameter = Some(x.max(y));
            note(&mut p, &format!("surface {number}: its aperture has one half width; the circle of it is used"));
        }
        let blocked = Some(s.obstruction).filter(|o| *o > 0.0);
        if let Some(obscuration) = r.openings[1].aperture(blocked, true).map_err(|what| wrong(&what))? {
            s.apertures.push(obscuration.scaled(scale));
            if matches!(obscuration.outline(), Outline::Ring(_)) {
                s.obstruction = 0.0;
            }
        }
        s.semi_diameter = s.semi_diameter.map(|d| d * scale);
        s.obstruction *= scale;
        let (at, after) = r.place.around(scale);
        let gap = s.gap.at(0.0, 0.0);
        let rim = s.semi_diameter.is_some();
        placed.push(Placed { surface: s, frame: here * at, rim });
        here *= after * ahead(gap);
    }
    if moved {
        // The image surface stands where its thickness (defocus) puts it, and is decentred there.
        let film = here * ahead(image.unwrap_or(0.0) * scale) * image_place.around(scale).0;
        lay_out(placed, film, &mut p).map_err(|(line, what)| PrescriptionError::at(file, line, what))?;
    } else {
        rims = placed.iter().map(|r| r.rim).collect();
        p.surfaces = placed.into_iter().map(|r| r.surface).collect();
    }
    if moved && configurations.count > 1 {
        p.notes.push(format!(
            "the file has {} zoom positions and decentred surfaces: the first position is read",
            configurations.count
        ));
    } else {
        configurations.scale(scale);
        configurations.apply(&mut p);
    }
    if image_curved {
        p.notes.push("the image surface is curved in the file; the film is flat".into());
    }
    p.usage.aperture = p.usage.aperture.map(|a| match a {
        ApertureKind::EntrancePupil(d) => ApertureKind::EntrancePupil(d * scale),
        other => other,
    });
    p.usage.defocus = if moved { 0.0 } else { image.unwrap_or(0.0) * scale };
    if p.source.is_empty() {
        p.source = format!("{}, CODE V file", stem(file));
    }
    skipped.note(&mut p);
    if !moved {
        drop_dummies(&mut p, &rims);
    }
    if has_others {
        fields.set_others(&mut p);
    }
    p.clip_given_rims();
    if let Some([tangent, f_number]) = image_cone {
        super::set_image_cone(&mut p, tangent, f_number);
    }
    p.checked(file)
}

/// What the fields of a command are.
fn kind_of_field(command: &str) -> FieldKind {
    match &command[1..] {
        "OB" => FieldKind::ObjectHeight,
        "IM" => FieldKind::ParaxialHeight,
        "RI" => FieldKind::RealHeight,
        _ => FieldKind::Angle,
    }
}

/// Notes a gap of a zoom position (from 0).
fn note_gap(configurations: &mut Configurations, target: Target, position: usize, value: f64) -> Result<(), String> {
    if position >= configurations.count {
        return Err(format!("a gap of zoom position {}: expected 1 to {}", position + 1, configurations.count));
    }
    match target {
        Target::Row(i) => configurations.gap(i, position, value),
        Target::Object => configurations.object(position, value),
        Target::Image | Target::Nothing => {
            return Err("THI: a gap of the image or of no surface in several positions is not read".into());
        }
    }
    Ok(())
}

/// i of a word "Zi".
fn zoom_of(rest: &[String]) -> Option<usize> {
    let number = |w: &String| w.strip_prefix(['Z', 'z'])?.parse().ok().filter(|n| *n > 0);
    rest.iter().find_map(number)
}

/// n of a word "Cn".
fn coefficient_number(rest: &[String]) -> Option<usize> {
    rest.iter().find_map(|w| w.strip_prefix(['C', 'c'])?.parse().ok().filter(|n| *n > 0))
}

/// Adds a note once.
fn note(p: &mut Prescription, text: &str) {
    if !p.notes.iter().any(|n| n == text) {
        p.notes.push(text.to_owned());
    }
}

fn unknown(command: &str) -> String {
    format!("unknown command {command}: it may change the lens; leave it out if it does not")
}

/// Takes a command of decentre or tilt into `place`; whether it was one.
fn place<E>(place: &mut Place, command: &str, value: impl Fn() -> Result<f64, E>) -> Result<bool, E> {
    match command {
        "XDE" => place.decenter.x = value()?,
        "YDE" => place.decenter.y = value()?,
        "ZDE" => place.decenter.z = value()?,
        "ADE" => place.tilt[0] = value()?,
        "BDE" => place.tilt[1] = value()?,
        "CDE" => place.tilt[2] = value()?,
        "DEC" => place.kind = Decenter::Stays,
        "DAR" => place.kind = Decenter::Returns,
        "REV" => place.kind = Decenter::Reverses,
        "BEN" => place.kind = Decenter::Bends,
        _ => return Ok(false),
    }
    place.given = true;
    Ok(true)
}

/// A number; "inf" and "infinity" are infinite.
fn distance(word: &str) -> Option<f64> {
    word.parse::<f64>().ok().filter(|v| !v.is_nan())
}

/// The first figure of a surface line: infinite radii are planes.
fn radius_or_curvature<E>(word: &str, number_of: &impl Fn(&str, &str) -> Result<f64, E>) -> Result<f64, E> {
    match distance(word) {
        Some(r) if r.is_infinite() => Ok(0.0),
        _ => number_of(word, "curvature"),
    }
}

/// What a command's words refer to: "S3" is surface 3 whatever was read last; without one it is the surface read last.
fn target(rest: &[String], count: usize, ended: bool) -> Result<Target, String> {
    for word in rest {
        let upper = word.to_uppercase();
        match upper.as_str() {
            "SI" => return Ok(Target::Image),
            "SO" | "S0" => return Ok(Target::Object),
            "SA" => return Err("SA: all surfaces at once are not read: name each".into()),
            _ if upper.starts_with('S') && upper.contains("..") => {
                return Err(format!("{upper}: a range of surfaces is not read: name each"));
            }
            _ => {}
        }
        if let Some(i) = surface_number(word) {
            if (1..=count).contains(&i) {
                return Ok(Target::Row(i - 1));
            }
            return Err(format!("S{i}: the surfaces read so far are 1 to {count}"));
        }
    }
    Ok(match count.checked_sub(1) {
        _ if ended => Target::Image,
        Some(last) => Target::Row(last),
        None => Target::Nothing,
    })
}

/// A glass between PRV and END.
enum PrivateGlass {
    /// At the wavelengths of PWL.
    Indices(Vec<f64>),
    /// LAU, Laurent's series: n² = a₀ + a₁ λ² + a₂/λ² + a₃/λ⁴ + a₄/λ⁶ + a₅/λ⁸, λ in µm.
    Laurent(Vec<f64>),
}

/// A catalogue name, a private glass, or a code: "517.642" (nd 1.517, Vd 64.2), or figures "1.5168:64.17". Aliases are noted.
fn glass(name: &str, private: &HashMap<String, PrivateGlass>, private_nm: &[f64], p: &mut Prescription) -> Result<Glass, String> {
    let name = name.trim_matches('\'');
    if name == "AIR" {
        return Ok(Glass::air());
    }
    if let Some(PrivateGlass::Laurent(a)) = private.get(name) {
        let index = |nm: f64| {
            let l2 = (nm * 1e-3).powi(2);
            (a[0] + a[1] * l2 + a[2] / l2 + a[3] / l2.powi(2) + a[4] / l2.powi(3) + a[5] / l2.powi(4)).sqrt()
        };
        p.notes.push(format!("private glass {name}: a curve through what its series gives at the lines C, d, F and g"));
        return Glass::measured(index(D_NM), index(C_NM), index(F_NM), index(G_NM)).map_err(|e| e.to_string());
    }
    if let Some(PrivateGlass::Indices(n)) = private.get(name) {
        return match n[..] {
            [] => Err(format!("private glass {name} has no index")),
            [n] => Glass::constant(n).map_err(|e| e.to_string()),
            _ if n.len() != private_nm.len() => {
                Err(format!("private glass {name}: {} indices for {} wavelengths (PWL)", n.len(), private_nm.len()))
            }
            _ => {
                let pairs: Vec<(f64, f64)> = private_nm.iter().copied().zip(n.iter().copied()).collect();
                Glass::through(name, &pairs).map_err(|e| e.to_string())
            }
        };
    }
    let coded = |digits: &str| {
        // With a colon either side may be written out.
        let colon = digits.split_once(':');
        let (n, v) = colon.or_else(|| digits.split_once('.'))?;
        let whole = |t: &str, least: usize| {
            (t.len() >= least && t.chars().all(|c| c.is_ascii_digit())).then(|| t.parse::<f64>().ok()).flatten()
        };
        let figure = |t: &str| t.contains('.').then(|| t.parse::<f64>().ok()).flatten();
        let nd = figure(n).or_else(|| Some(1.0 + whole(n, 3)? / 10f64.powi(n.len() as i32)))?;
        let vd = figure(v).or_else(|| Some(whole(v, if colon.is_some() { 2 } else { 3 })? / 10f64.powi(v.len() as i32 - 2)))?;
        Some((nd, vd))
    };
    // "1.5168" is an index, not nd 1.1 and Vd 51.68. Six digits are a code without its point.
    let six_digits = || {
        let (n, v) = (name.len() == 6 && name.bytes().all(|b| b.is_ascii_digit())).then(|| name.split_at(3))?;
        Some((1.0 + n.parse::<f64>().ok()? / 1000.0, v.parse::<f64>().ok()? / 10.0))
    };
    if let Some((nd, vd)) = coded(name).or_else(six_digits) {
        return Glass::model(nd, vd, 0.0).map_err(|e| e.to_string());
    }
    let (glass, alias) = parse_foreign(name, &[]).map_err(|e| e.to_string())?;
    if let Some(alias) = alias {
        note(p, &alias);
    }
    Ok(glass)
}
