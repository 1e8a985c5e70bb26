//! CODE V sequence files (.seq): commands, `;` between them, `!` before comments, `&` before a continued line.
//!
//! Written from the command names as the files show them and as ray-optics reads them. Without `RDM` (or with `RDM N`) surfaces
//! carry curvatures, with it radii. Words of more than three letters are known by their first three (`TITLE`, `STOP`).
//!
//! | command | what is done |
//! |---|---|
//! | RDM, TIT, DIM, EPD, FNO, NAO, WL, REF, YAN, VUY, VLY, PRV PWL END | read |
//! | NA | read as the f-number 1/(2 NA) |
//! | SO, S, SI; STO, RDY, CUY, THI, GLA, RMD | read; a distance may be `inf` or `infinity` |
//! | SPH, CON, ASP with K, A to J | read |
//! | CYL, YTO with RDX or CUX | read |
//! | AAS with K or KY, KX | read as a biconic; its higher terms AR, BR, CR, DR: error unless 0 |
//! | XDE, YDE, ZDE, ADE, BDE, CDE with DAR, REV, BEN or alone | read, on SI too; see layout.rs. ADE and BDE follow the left hand |
//! | CIR, CIR OBS, CIR HOL | read; a hole blocks, since light that passes it is not followed |
//! | REX REY, ELX ELY | approximated by the circle around them, with a note; as OBS or HOL: error |
//! | names NAME_VENDOR; codes 517.642, 517642.1, 1.5168:64.17; private glasses | read; aliases with a note (glass/alias.rs) |
//! | XAN, YIM, YOB, XIM, XOB, XRI, YRI | left out (fields in x, or heights), with a note where it matters |
//! | PUI, PUX, PUY, TEL | left out, with a note |
//! | curvature of SI | taken for plane, with a note |
//! | solves, couplings, weights, tolerances, drawing, coatings (`HARMLESS`) | ignored: rays do not change |
//! | after GO | commands that are not read are skipped, named in a note |
//! | ZOO, AFI; all others | error |

use super::layout::{Placed, ahead, lay_out, moved_then_turned};
use super::{Skipped, drop_dummies, stem};
use crate::glass::{Glass, parse_foreign};
use crate::prescription::{ApertureKind, Prescription, PrescriptionError, Surface};
use crate::surface::Profile;
use glam::{DAffine3, DVec3};
use std::collections::HashMap;

/// Commands that do not change the lens: solves that have been solved, couplings, variables, tolerances, drawing, weights.
const HARMLESS: &[&str] = &[
    "LEN", "INI", "WTW", "WTF", "WTX", "WTY", "VUX", "VLX", "CUM", "THM", "PIM", "PIB", "PIK", "SLB", "DER", "VAL", "TEM", "PRE",
    "CLS", "CWL", "CA", "CCY", "CCX", "CUC", "RDC", "THC", "GLC", "KC", "KXC", "KYC", "AC", "BC", "CC", "DC", "EC", "FC", "GC",
    "HC", "JC", "ARC", "BRC", "CRC", "DRC", "APC", "BPC", "CPC", "DPC", "XDC", "YDC", "ZDC", "ADC", "BDC", "CDC", "XOC", "YOC",
    "ZOC", "POL", "PFR", "SET", "EDI", "UNI", "AFC", "CRT", "CVY", "IMG", "WID", "RAY", "LIN", "SAV", "LIS", "FTY", "XFN", "PTP",
    "MFL", "DSP", "CIN", "CIX", "GL1", "CTE", "COM", "DLT", "DLF", "DLR", "DLN", "DLX", "DLY", "DLZ", "DLA", "DLB", "DLG", "DLS",
    "DLV", "DLC", "BTX", "BTY", "CMP", "MNT", "MXT", "MNE", "MXE",
];
/// Commands of shapes and places that are not read, and what they are.
const REFUSED: &[(&str, &str)] = &[
    ("ZOO", "zoomed CODE V lenses are not read: save one position"),
    ("AFI", "an afocal lens has no film"),
    ("GRI", "gradient-index glass is not traced"),
    ("DIF", "diffractive surfaces are not traced"),
    ("HOE", "diffractive surfaces are not traced"),
    ("GRT", "diffraction gratings are not traced"),
    ("SPS", "special surfaces are not read"),
    ("XTO", "a toroid with its polynomial in x is not read: turn the lens and write YTO"),
    ("ZRN", "Zernike surfaces are not read"),
    ("NSS", "only sequential lenses are read"),
    ("GLB", "global coordinates are not read: write decenters of each surface"),
    ("RET", "a return to another surface's coordinates is not read: write REV with the same figures"),
    ("CIG", "grouped apertures are not read"),
    ("REG", "grouped apertures are not read"),
    ("ELG", "grouped apertures are not read"),
];

/// What a decenter does to the surfaces after it.
#[derive(Clone, Copy, PartialEq)]
enum Decenter {
    /// They follow.
    Stays,
    /// They do not (DAR).
    Returns,
    /// The surface itself stays, what follows is turned back (REV).
    Reverses,
    /// For mirrors: the tilt acts once more after the surface (BEN).
    Bends,
}

/// Decentre and tilts of a surface as the file gives them, and what they do.
#[derive(Clone, Copy)]
struct Place {
    decenter: DVec3,
    /// ADE, BDE, CDE, degrees.
    tilt: [f64; 3],
    kind: Decenter,
    given: bool,
}

impl Place {
    const NONE: Place = Place { decenter: DVec3::ZERO, tilt: [0.0; 3], kind: Decenter::Stays, given: false };

    /// Turns about x and y follow the left hand, about z the right.
    fn turn(&self, decenter: DVec3) -> DAffine3 {
        let [a, b, c] = self.tilt;
        moved_then_turned(decenter, [-a, -b, c])
    }

    /// Where the surface stands and where its gap starts, seen from the coordinate system before it.
    fn around(&self, scale: f64) -> (DAffine3, DAffine3) {
        let whole = self.turn(self.decenter * scale);
        match self.kind {
            Decenter::Stays => (whole, whole),
            Decenter::Returns => (whole, DAffine3::IDENTITY),
            Decenter::Reverses => (DAffine3::IDENTITY, whole.inverse()),
            Decenter::Bends => (whole, whole * self.turn(DVec3::ZERO)),
        }
    }
}

/// Shape that a surface is said to have.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Rotational,
    /// CYL, YTO: a curvature in x of its own.
    Toroid,
    /// AAS: a curvature and a conic constant in x of their own.
    Anamorphic,
}

struct Current {
    surface: Surface,
    c: f64,
    k: f64,
    a: Vec<f64>,
    kind: Kind,
    c_x: Option<f64>,
    k_x: f64,
    place: Place,
    /// Half widths in x and y of an aperture that is not round.
    half_widths: [f64; 2],
    /// A curvature or (true) radius given by name.
    written: Option<(f64, bool)>,
}

/// What a command is about.
#[derive(Clone, Copy)]
enum Target {
    Nothing,
    Object,
    Image,
    Row(usize),
}

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
    let mut fields_are_angles = false;
    // Private catalogue: wavelengths, then names with indices.
    let (mut private, mut private_nm): (HashMap<String, Vec<f64>>, Vec<f64>) = (HashMap::new(), vec![]);
    let mut in_private = false;
    for (number, command) in commands(text) {
        let words = words(&command);
        let Some(first) = words.first() else { continue };
        let rest = &words[1..];
        let at_surface = rows.len();
        let wrong = |what: String| {
            let e = PrescriptionError::at(file, number, what);
            if at_surface > 0 { e.surface(at_surface) } else { e }
        };
        let whole_key = first.to_uppercase();
        if in_private {
            match whole_key.as_str() {
                "END" => in_private = false,
                "PWL" => private_nm = rest.iter().filter_map(|w| w.parse().ok()).collect(),
                _ => {
                    let parse = |w: &String| distance(w).filter(|v| v.is_finite());
                    let n: Option<Vec<f64>> = rest.iter().map(parse).collect();
                    let n = n.ok_or_else(|| {
                        wrong(format!("private glass {first}: expected indices, one for each wavelength of PWL"))
                    })?;
                    private.insert(whole_key.trim_matches('\'').to_owned(), n);
                }
            }
            continue;
        }
        let surface_row = whole_key == "S" || (whole_key.len() > 1 && surface_number(&whole_key).is_some());
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
            "EPD" => p.usage.aperture = Some(ApertureKind::EntrancePupil(value()?)),
            "FNO" => p.usage.aperture = Some(ApertureKind::FNumber(value()?)),
            "NA" => p.usage.aperture = Some(ApertureKind::FNumber(0.5 / value()?)),
            "NAO" => p.usage.aperture = Some(ApertureKind::ObjectNa(value()?)),
            "WL" => p.usage.wavelengths_nm = numbers(),
            "REF" => p.usage.reference = (value()? as usize).saturating_sub(1),
            "YAN" => (p.usage.field_angles_deg, fields_are_angles) = (numbers(), true),
            "YIM" | "YOB" | "YRI" => {
                fields_are_angles = false;
                note(&mut p, "fields are given as heights in the file; they are not taken over");
            }
            "XAN" | "XIM" | "XOB" | "XRI" => {
                if numbers().iter().any(|x| *x != 0.0) {
                    note(&mut p, "fields in x are not taken over, only those in y");
                }
            }
            "PUI" | "PUX" | "PUY" => note(&mut p, "the pupil's apodisation (PUI, PUX, PUY) is left out"),
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
                    half_widths: [0.0; 2],
                    written: None,
                });
            }
            other if HARMLESS.contains(&other) => {}
            other => {
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
                    "CUX" => row.c_x = Some(value()?),
                    "RDX" => {
                        let r = value()?;
                        row.c_x = Some(if r == 0.0 { 0.0 } else { 1.0 / r });
                    }
                    // Terms of an anamorphic asphere beyond the biconic, and the Fresnel base of an asphere.
                    "AR" | "BR" | "CR" | "DR" | "CUF" | "XOD" | "YOD" | "ZOD" | "ADX" | "ADY" | "ARO" => {
                        let v = value()?;
                        if v != 0.0 {
                            let what = match other {
                                "CUF" => "Fresnel surfaces are not traced",
                                "XOD" | "YOD" | "ZOD" => "a pivot beside the vertex is not read",
                                "ADX" | "ADY" | "ARO" => "an aperture that is shifted or turned is not read",
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
                        if says("OBS") || says("HOL") {
                            return Err(wrong(format!("{other} {}: only round obstructions are read (CIR OBS)", rest.join(" "))));
                        }
                        if !says("EDG") {
                            row.half_widths[usize::from(other.ends_with('Y'))] = value()?;
                            let [x, y] = row.half_widths;
                            // A rectangle reaches its corners, an ellipse its longer half axis.
                            let around = if other.starts_with('R') { x.hypot(y) } else { x.max(y) };
                            row.surface.semi_diameter = Some(around);
                            if let Target::Row(i) = target {
                                let number = i + 1;
                                note(
                                    &mut p,
                                    &format!("surface {number}: its aperture is not round; the circle around it is used"),
                                );
                            }
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
    // Where each surface stands, through the decenters.
    let moved = image_place.given || rows.iter().any(|r| r.place.given);
    let mut placed: Vec<Placed> = vec![];
    let mut here = DAffine3::IDENTITY;
    for r in rows {
        let wrong = |what: &str| PrescriptionError::at(file, r.surface.line, what).surface(placed.len() + 1);
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
        s.profile = profile;
        if s.mirror {
            // A mirror goes on in what was before it.
            s.glass = placed.last().map_or(Glass::air(), |before| before.surface.glass.clone());
        }
        s.gap.values[0][0] *= scale;
        s.semi_diameter = s.semi_diameter.map(|d| d * scale);
        s.obstruction *= scale;
        let (at, after) = r.place.around(scale);
        let gap = s.gap.at(0.0, 0.0);
        let rim = s.mirror && s.semi_diameter.is_some();
        placed.push(Placed { surface: s, frame: here * at, rim });
        here *= after * ahead(gap);
    }
    if moved {
        let film = here * image_place.around(scale).0;
        lay_out(placed, film, &mut p).map_err(|(line, what)| PrescriptionError::at(file, line, what))?;
    } else {
        p.surfaces = placed.into_iter().map(|r| r.surface).collect();
    }
    if image_curved {
        p.notes.push("the image surface is curved in the file; the film is flat".into());
    }
    if p.usage.reference >= p.usage.wavelengths_nm.len() {
        p.usage.reference = 0;
    }
    if !fields_are_angles {
        p.usage.field_angles_deg = vec![];
    }
    let fields = p.usage.field_angles_deg.len();
    p.usage.vignetting =
        (0..fields).map(|i| [upper.get(i).copied().unwrap_or(0.0), lower.get(i).copied().unwrap_or(0.0)]).collect();
    p.usage.aperture = p.usage.aperture.map(|a| match a {
        ApertureKind::EntrancePupil(d) => ApertureKind::EntrancePupil(d * scale),
        other => other,
    });
    p.usage.defocus = image.unwrap_or(0.0) * scale;
    if p.source.is_empty() {
        p.source = format!("{}, CODE V file", stem(file));
    }
    skipped.note(&mut p);
    if !moved {
        drop_dummies(&mut p);
    }
    p.checked(file)
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

/// Words that say which surface, zoom position, wavelength or aperture is meant.
fn is_qualifier(word: &str) -> bool {
    let upper = word.to_uppercase();
    let counted = |digits: &str| !digits.is_empty() && digits.chars().all(|c| c.is_ascii_digit());
    matches!(upper.as_str(), "CLR" | "EDG" | "OBS" | "HOL" | "SO" | "SI" | "SS")
        || upper.strip_prefix(['S', 'Z', 'W', 'C', 'L']).is_some_and(counted)
        || upper.strip_prefix('L').is_some_and(|label| label.starts_with(['\'', '"']))
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

/// n of "Sn".
fn surface_number(word: &str) -> Option<usize> {
    let digits = word.strip_prefix(['S', 's'])?;
    digits.parse().ok().filter(|_| digits.chars().all(|c| c.is_ascii_digit()))
}

/// Commands with their line numbers.
fn commands(text: &str) -> Vec<(usize, String)> {
    let mut commands = vec![];
    let mut open: Option<(usize, String)> = None;
    for (number, line) in text.lines().enumerate() {
        let code = without_comment(line);
        let (start, mut whole) = open.take().unwrap_or((number + 1, String::new()));
        match code.trim_end().strip_suffix('&') {
            Some(part) => {
                whole.push_str(part);
                whole.push(' ');
                open = Some((start, whole));
            }
            None => {
                whole.push_str(code);
                commands.extend(split(&whole).into_iter().map(|c| (start, c)));
            }
        }
    }
    commands.extend(open.into_iter().flat_map(|(start, whole)| split(&whole).into_iter().map(move |c| (start, c))));
    commands
}

fn without_comment(line: &str) -> &str {
    let mut quote = None;
    for (i, c) in line.char_indices() {
        match (quote, c) {
            (None, '!') => return &line[..i],
            (None, '\'' | '"') => quote = Some(c),
            (Some(q), c) if q == c => quote = None,
            _ => {}
        }
    }
    line
}

/// At semicolons outside quotes.
fn split(line: &str) -> Vec<String> {
    let mut parts = vec![String::new()];
    let mut quote = None;
    for c in line.chars() {
        match (quote, c) {
            (None, ';') => parts.push(String::new()),
            _ => {
                quote = match (quote, c) {
                    (None, '\'' | '"') => Some(c),
                    (Some(q), c) if q == c => None,
                    (q, _) => q,
                };
                if let Some(last) = parts.last_mut() {
                    last.push(c);
                }
            }
        }
    }
    parts
}

fn words(command: &str) -> Vec<String> {
    let mut words: Vec<String> = vec![];
    let mut quote: Option<char> = None;
    let mut fresh = true;
    for c in command.chars() {
        if quote.is_none() && c.is_whitespace() {
            fresh = true;
            continue;
        }
        if fresh {
            words.push(String::new());
            fresh = false;
        }
        quote = match (quote, c) {
            (None, '\'' | '"') => Some(c),
            (Some(q), c) if q == c => None,
            (q, _) => q,
        };
        if let Some(w) = words.last_mut() {
            w.push(c);
        }
    }
    words
}

/// A catalogue name, a private glass, or a code: "517.642" (nd 1.517, Vd 64.2), or figures "1.5168:64.17". Aliases are noted.
fn glass(name: &str, private: &HashMap<String, Vec<f64>>, private_nm: &[f64], p: &mut Prescription) -> Result<Glass, String> {
    let name = name.trim_matches('\'');
    if name == "AIR" {
        return Ok(Glass::air());
    }
    if let Some(n) = private.get(name) {
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
        let (n, v) = digits.split_once(':').or_else(|| digits.split_once('.'))?;
        let whole = |t: &str| (t.len() >= 3 && t.chars().all(|c| c.is_ascii_digit())).then(|| t.parse::<f64>().ok()).flatten();
        let figure = |t: &str| t.contains('.').then(|| t.parse::<f64>().ok()).flatten();
        let nd = figure(n).or_else(|| Some(1.0 + whole(n)? / 10f64.powi(n.len() as i32)))?;
        let vd = figure(v).or_else(|| Some(whole(v)? / 10f64.powi(v.len() as i32 - 2)))?;
        Some((nd, vd))
    };
    // "1.5168" is an index, not nd 1.1 and Vd 51.68.
    if let Some((nd, vd)) = coded(name) {
        return Glass::model(nd, vd, 0.0).map_err(|e| e.to_string());
    }
    let (glass, alias) = parse_foreign(name, &[]).map_err(|e| e.to_string())?;
    if let Some(alias) = alias {
        note(p, &alias);
    }
    Ok(glass)
}
