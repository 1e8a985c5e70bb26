//! OSLO lens files (.len): commands, `;` between them, `//` before comments; `NXT` goes on to the next surface, the last is the image.
//!
//! Written from the file and command table of the OSLO user's guide (Sinclair Optics, "Assignment Commands") and as files of OSLO 5 and 6 show them. Lengths
//! are in units of `UNI` mm. Keywords beyond the last `END` of the lens (variables, operands, field points, drawing) are not read.
//!
//! | command | what is done |
//! |---|---|
//! | LEN NEW "name" focal length, surfaces; UNI | read |
//! | EBR (radius of the entering beam), NAO, FNO | read |
//! | ANG | read as the largest field angle in y; fields of 0, 0.7 and 1 of it |
//! | OBH, GIH (heights) | read as the angles of them where the lens is round (fields.rs), with a note |
//! | WV (µm; the first is the reference), WV2 to WV9; WW | read; weights ignored |
//! | RD, CV, TH, AIR, NXT, AST, GTO | read |
//! | GLA name; GLA n or n at each wavelength; GLA MOD name with nd, Vd or indices | read; catalogue aliases with a note |
//! | RFL, RFH, GLA REFLECT | a mirror |
//! | AP r, AP CHK r; APCK | read as semi-diameters: both stop light, but for planes in air, of which those with CHK do, and the stop, which without CHK is as large as the stated beam |
//! | CC; AD, AE, AF, AG; ASP ASR with AS1, AS2, ... (r², r⁴, ...); ASP ARA with AS1, AS2, ... (r, r², ...) | read |
//! | CVX, RDX | read as a toroid |
//! | PFL (perfect lens) | read as an ideal lens |
//! | DCX, DCY, DCZ, RCO without number | read |
//! | TLA, TLB, TLC other than 0, BEN | error: their sign is not known from a file with stated rays |
//! | PK RD, CV, TH, GLA, AP, CC with a relative surface number, CVM, THM (negative) | followed |
//! | PY, PU, PUC, PYC and other solves | the figure of the file stands; with TH or RD missing after PY or PU: solved paraxially |
//! | TEM, PRE other than 20 °C and 1 atm | left out, with a note |
//! | DES, SNO, drawing, coatings, tolerances (`HARMLESS`) | ignored |
//! | ASP of other kinds, GC, RCO n, gradients, gratings, diffractive surfaces, LMO, special apertures | error |
//! | all others | skipped, named in a note |

use super::fields::{FieldKind, Fields};
use super::layout::{ahead, lay_out};
use super::placed::Placed;
use super::{Skipped, drop_dummies, other_pressure, other_temperature, stem};
use crate::glass::{Glass, parse_foreign};
use crate::prescription::{ApertureKind, MOST_SURFACES, Prescription, PrescriptionError, Surface};
use crate::surface::Profile;
use glam::{DAffine3, DVec3};

/// Commands that do not change rays.
const HARMLESS: &[&str] = &[
    "DES", "CALLBACK", "GPRT", "WW", "APCK", "TCE", "DLRS", "DLVA", "DLAS", "DLNR", "DLNF", "DLMF", "DLFD", "DRW", "SDSZ",
    "DLAP", "AFO", "WRSP", "RAIM", "AMO", "OPDW", "SPWV", "CBK", "COTN", "COA", "DRE", "ZRS", "NOT", "SAS", "IMS", "ITE", "PXT",
    "NDP", "TEN", "DSP", "SVA", "GIB", "WAP", "PYC", "PUC", "PIC", "PI", "EC", "PLAN", "CMT", "ELE", "AFP", "AFC", "POLZ",
    "SASD", "EVZ", "XARM", "SSC",
];

/// A shape of polynomials.
#[derive(Clone, Copy, PartialEq)]
enum Powers {
    /// AD to AG: r⁴ to r¹⁰.
    Plain,
    /// ASP ASR: AS1 of r², AS2 of r⁴, ...
    Even,
    /// ASP ARA: AS1 of r, ...
    All,
}

#[derive(Clone)]
struct Row {
    line: usize,
    c: f64,
    c_x: Option<f64>,
    k: f64,
    plain: Vec<f64>,
    powers: Powers,
    terms: Vec<f64>,
    gap: f64,
    glass: Glass,
    /// The figures of GLA where they are one for each wavelength.
    indices: Vec<f64>,
    mirror: bool,
    stop: bool,
    semi_diameter: Option<f64>,
    /// Light is checked against its semi-diameter.
    checked: bool,
    ideal: Option<f64>,
    decenter: [f64; 3],
    returns: bool,
    moved: bool,
    /// The gap is given by the height (`false`) or the marginal ray's slope is given by the curvature (`true`), with the figure.
    solves: Vec<(bool, f64)>,
    given: [bool; 2],
}

impl Row {
    fn new(line: usize) -> Row {
        Row {
            line,
            c: 0.0,
            c_x: None,
            k: 0.0,
            plain: vec![],
            powers: Powers::Plain,
            terms: vec![],
            gap: 0.0,
            glass: Glass::air(),
            indices: vec![],
            mirror: false,
            stop: false,
            semi_diameter: None,
            checked: false,
            ideal: None,
            decenter: [0.0; 3],
            returns: false,
            moved: false,
            solves: vec![],
            given: [false; 2],
        }
    }
}

/// Reads a lens file; `file` is its name in errors. Fails, naming line and surface, on commands and figures that are not read (table above) and on what
/// [`Prescription::checked`] refuses.
pub fn read(text: &str, file: &str) -> Result<Prescription, PrescriptionError> {
    let mut p = Prescription::new(stem(file), vec![]);
    let mut skipped = Skipped::default();
    let mut scale = 1.0;
    let mut rows = vec![Row::new(1)];
    let mut waves: Vec<f64> = vec![];
    let (mut opened, mut ended) = (false, false);
    let mut field_height: Option<(FieldKind, f64)> = None;
    for (line, words) in commands(text) {
        let Some((key, rest)) = words.split_first() else { continue };
        let key = key.to_uppercase();
        let number = rows.len() - 1;
        let wrong = |what: String| {
            let e = PrescriptionError::at(file, line, what);
            if number > 0 { e.surface(number) } else { e }
        };
        let figure = |i: usize| -> Result<f64, PrescriptionError> {
            let word = rest.get(i).ok_or_else(|| wrong(format!("{key}: expected a number after it")))?;
            word.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| wrong(format!("{key} {word}: expected a number")))
        };
        let numbers = || rest.iter().filter_map(|w| w.parse::<f64>().ok()).collect::<Vec<f64>>();
        if !opened && key != "LEN" {
            return Err(wrong(format!("{key}: expected LEN NEW \"name\" first")));
        }
        let row = rows.last_mut().ok_or_else(|| PrescriptionError::at(file, line, "no surface"))?;
        let curvature = |r: f64| if r == 0.0 { 0.0 } else { 1.0 / r };
        match key.as_str() {
            "LEN" => {
                opened = true;
                if let Some(name) = rest.get(1).map(|n| n.trim_matches('"')).filter(|n| !n.is_empty()) {
                    p.name = name.to_owned();
                }
                // The focal length of the head was computed by the program: reports say ours.
            }
            "UNI" => {
                scale = figure(0)?;
                if !(scale > 0.0 && scale < 1e6) {
                    return Err(wrong(format!("UNI {scale}: expected the millimetres of a unit")));
                }
            }
            "EBR" => p.usage.aperture = Some(ApertureKind::EntrancePupil(2.0 * figure(0)?)),
            "NAO" => p.usage.aperture = Some(ApertureKind::ObjectNa(figure(0)?)),
            "FNO" => p.usage.aperture = Some(ApertureKind::FNumber(figure(0)?)),
            "ANG" => {
                let most = figure(0)?.abs();
                field_height = None;
                p.usage.field_angles_deg = if most > 1e-3 { vec![0.0, 0.7 * most, most] } else { vec![0.0] };
            }
            "OBH" => field_height = Some((FieldKind::ObjectHeight, figure(0)?.abs())),
            "GIH" | "YIM" => field_height = Some((FieldKind::ParaxialHeight, figure(0)?.abs())),
            "WV" => waves = numbers(),
            _ if key.strip_prefix("WV").is_some_and(|d| d.parse::<u8>().is_ok()) => waves.extend(numbers()),
            "NXT" => {
                if rows.len() > MOST_SURFACES + 1 {
                    return Err(wrong(format!("more than {MOST_SURFACES} surfaces")));
                }
                rows.push(Row::new(line));
            }
            "GTO" => {
                let to = figure(0)?;
                if !(to >= number as f64 && to <= (MOST_SURFACES + 1) as f64 && to.fract() == 0.0) {
                    return Err(wrong(format!("GTO {to}: expected a surface after {number}")));
                }
                while rows.len() <= to as usize {
                    rows.push(Row::new(line));
                }
            }
            "END" => {
                ended = true;
                break;
            }
            "AIR" => row.glass = Glass::air(),
            "RD" => (row.c, row.given[1]) = (curvature(figure(0)?), true),
            "CV" => (row.c, row.given[1]) = (figure(0)?, true),
            "CVX" => row.c_x = Some(figure(0)?),
            "RDX" => row.c_x = Some(curvature(figure(0)?)),
            "TH" => (row.gap, row.given[0]) = (figure(0)?, true),
            "CC" => row.k = figure(0)?,
            "AD" | "AE" | "AF" | "AG" => {
                let i = usize::from(key.as_bytes()[1] - b'D');
                row.plain.resize(row.plain.len().max(i + 1), 0.0);
                row.plain[i] = figure(0)?;
            }
            "ASP" => {
                row.powers = match rest.first().map(|w| w.to_uppercase()).as_deref() {
                    Some("ASR") => Powers::Even,
                    Some("ARA") => Powers::All,
                    Some(other) => return Err(wrong(format!("ASP {other}: of aspheres ASR and ARA are read"))),
                    None => return Err(wrong("ASP: expected ASR or ARA".into())),
                }
            }
            _ if key.strip_prefix("AS").is_some_and(|d| d.parse::<usize>().is_ok_and(|n| n <= 40)) => {
                let i: usize = key[2..].parse().unwrap_or(0);
                row.terms.resize(row.terms.len().max(i + 1), 0.0);
                row.terms[i] = figure(0)?;
            }
            "AST" => row.stop = true,
            "RFL" | "RFH" => row.mirror = true,
            "GLA" => match rest.first().map(|w| w.to_uppercase()).as_deref() {
                Some("REFLECT" | "REFL") => row.mirror = true,
                Some("AIR") => row.glass = Glass::air(),
                // A name and figures.
                Some("MOD") => row.indices = numbers(),
                Some(word) if word.parse::<f64>().is_ok() => row.indices = numbers(),
                Some(name) => {
                    let found = parse_foreign(name, &[]).or_else(|e| parse_foreign(&rest[0], &[]).map_err(|_| e));
                    let (glass, alias) = found.map_err(|e| wrong(e.to_string()))?;
                    p.notes.extend(alias.filter(|a| !p.notes.contains(a)));
                    (row.glass, row.indices) = (glass, vec![]);
                }
                None => return Err(wrong("GLA: expected a glass".into())),
            },
            "AP" => {
                row.checked |= rest.first().is_some_and(|w| w.eq_ignore_ascii_case("CHK"));
                let radius = rest.last().and_then(|w| w.parse::<f64>().ok()).unwrap_or(0.0);
                // Sizes of objects at infinity are as large.
                row.semi_diameter = Some(radius).filter(|r| *r > 0.0 && *r < 1e5);
            }
            "PFL" => row.ideal = Some(figure(0)?),
            "DCX" | "DCY" | "DCZ" => (row.decenter[usize::from(key.as_bytes()[2] - b'X')], row.moved) = (figure(0)?, true),
            "TLA" | "TLB" | "TLC" if figure(0)? == 0.0 => {}
            "DT" => {}
            "RCO" if rest.is_empty() || figure(0)? == number as f64 => (row.returns, row.moved) = (true, true),
            "PY" | "PU" => {
                let solve = (key == "PU", figure(0)?);
                row.solves.push(solve);
            }
            "PK" => pick_up(&mut rows, rest).map_err(wrong)?,
            "GC" | "RCO" | "LMO" | "GRIN" | "GRD" | "DOE" | "DFR" | "DFX" | "TLA" | "TLB" | "TLC" | "BEN" | "DOR" | "DWV"
            | "GOR" | "GSP" | "GDT" | "SPL" | "ZRN" | "DLL" | "ATP" | "AX1" | "AAC" | "HOE" | "HOR" | "HV1" => {
                return Err(wrong(format!(
                    "{key} {}: not read (tilts, global coordinates, groups, gradients, gratings, diffractive surfaces, special apertures)",
                    rest.join(" ")
                )));
            }
            "TEM" => p.notes.extend(numbers().first().and_then(|t| other_temperature(*t))),
            "PRE" => p.notes.extend(numbers().first().and_then(|atm| other_pressure(*atm))),
            other if HARMLESS.contains(&other) || other.starts_with("SNO") => {}
            other => skipped.add(other),
        }
    }
    if rows.len() < 3 {
        return Err(PrescriptionError::at(
            file,
            0,
            "no surfaces: expected LEN NEW, and surfaces between object and image with NXT",
        ));
    }
    if !ended {
        let what = "no END behind the last surface: expected a whole file, is it cut short?";
        return Err(PrescriptionError::at(file, text.lines().count(), what));
    }
    // Units and media.
    if waves.is_empty() {
        waves = [crate::glass::D_NM, crate::glass::F_NM, crate::glass::C_NM].map(|nm| nm * 1e-3).to_vec();
    }
    waves.iter_mut().for_each(|um| *um *= 1000.0);
    for (i, row) in rows.iter_mut().enumerate() {
        let glass = medium(&row.indices, &waves, &mut p.notes);
        if let Some(glass) = glass.map_err(|what| PrescriptionError::at(file, row.line, what).surface(i))? {
            row.glass = glass;
        }
    }
    let object = rows[0].gap * scale;
    p.usage.object_distance = Some(object).filter(|d| *d < 1e8);
    p.usage.wavelengths_nm = waves;
    p.usage.aperture = p.usage.aperture.map(|a| match a {
        ApertureKind::EntrancePupil(d) => ApertureKind::EntrancePupil(d * scale),
        other => other,
    });
    solve(&mut rows, &p, scale);
    let image = rows.pop().unwrap_or(Row::new(0));
    let moved = rows.iter().skip(1).any(|r| r.moved) || image.moved;
    let mut placed: Vec<Placed> = vec![];
    let mut here = DAffine3::IDENTITY;
    let mut rims = vec![];
    for (i, row) in rows.into_iter().enumerate().skip(1) {
        let wrong = |what: String| PrescriptionError::at(file, row.line, what).surface(i);
        let before = placed.last().map_or(Glass::air(), |r| r.surface.glass.clone());
        let mut surface = surface(&row, scale).map_err(wrong)?;
        // The stated beam makes the stop as large as it needs to be.
        if row.stop && !row.checked && p.usage.aperture.is_some() {
            surface.semi_diameter = None;
        }
        if row.mirror {
            surface.glass = before;
        }
        let (at, after) = around(&row, scale);
        placed.push(Placed { rim: (row.mirror || row.checked) && surface.semi_diameter.is_some(), surface, frame: here * at });
        here *= after * ahead(row.gap * scale);
    }
    if moved {
        let film = here * around(&image, scale).0;
        lay_out(placed, film, &mut p).map_err(|(line, what)| PrescriptionError::at(file, line, what))?;
    } else {
        rims = placed.iter().map(|r| r.rim).collect();
        p.surfaces = placed.into_iter().map(|r| r.surface).collect();
        // The image surface's own gap is how far the film stands behind the focus.
        p.usage.defocus = image.gap * scale;
    }
    if image.c != 0.0 {
        p.notes.push("the image surface is curved in the file; the film is flat".into());
    }
    if p.source.is_empty() {
        p.source = format!("{}, OSLO file", stem(file));
    }
    skipped.note(&mut p);
    if !moved {
        drop_dummies(&mut p, &rims);
    }
    if let Some((kind, most)) = field_height {
        let heights: &[f64] = if most > 0.0 { &[0.0, 0.7 * most, most] } else { &[0.0] };
        Fields::new(kind, [&[], heights], vec![], scale).set_others(&mut p);
    }
    p.clip_given_rims();
    p.checked(file)
}

/// The glass of figures: one index, nd and Vd, or an index at each wavelength (nm). `None` where there are no figures.
fn medium(figures: &[f64], waves_nm: &[f64], notes: &mut Vec<String>) -> Result<Option<Glass>, String> {
    let told = |e: crate::glass::GlassError| e.to_string();
    match figures {
        [] => Ok(None),
        [n] => Glass::constant(*n).map(Some).map_err(told),
        // An Abbe number follows.
        [nd, vd] if *vd > 10.0 => Glass::model(*nd, *vd, 0.0).map(Some).map_err(told),
        all if all.len() > waves_nm.len() => Err(format!("GLA: {} indices for {} wavelengths", all.len(), waves_nm.len())),
        all if all.iter().all(|n| *n == all[0]) => Glass::constant(all[0]).map(Some).map_err(told),
        all => {
            let pairs: Vec<(f64, f64)> = waves_nm.iter().copied().zip(all.iter().copied()).collect();
            if !notes.iter().any(|n| n.starts_with("glasses of figures")) {
                notes.push("glasses of figures have indices between the file's wavelengths by interpolation".into());
            }
            Glass::through("figures", &pairs).map(Some).map_err(told)
        }
    }
}

/// The surface of a row.
fn surface(row: &Row, scale: f64) -> Result<Surface, String> {
    let mut a: Vec<f64> = vec![];
    let mut term = |power: usize, value: f64| {
        if value != 0.0 {
            a.resize(a.len().max(power + 1), 0.0);
            a[power] += value * scale.powi(1 - power as i32);
        }
    };
    row.plain.iter().enumerate().for_each(|(i, v)| term(4 + 2 * i, *v));
    if row.terms.first().is_some_and(|v| *v != 0.0) && row.powers != Powers::Plain {
        return Err(format!("AS0 {}: a constant sag is not read: expected 0", row.terms[0]));
    }
    match row.powers {
        Powers::Plain => {}
        Powers::Even => row.terms.iter().enumerate().for_each(|(i, v)| term(2 * i, *v)),
        Powers::All => row.terms.iter().enumerate().for_each(|(i, v)| term(i, *v)),
    }
    let (c, c_x) = (row.c / scale, row.c_x.map(|c| c / scale));
    let mut surface = Surface::new(crate::prescription::profile(c, row.k, a, c_x), row.gap * scale, row.glass.clone());
    surface.line = row.line;
    surface.stop = row.stop;
    surface.mirror = row.mirror;
    surface.semi_diameter = row.semi_diameter.map(|s| s * scale);
    surface.ideal_focal_length = row.ideal.map(|f| f * scale);
    if surface.ideal_focal_length.is_some() && surface.profile != Profile::Plane {
        return Err("PFL on a curved surface: expected a plane".into());
    }
    Ok(surface)
}

/// Where a surface stands and where its gap starts, seen from the coordinate system before it.
fn around(row: &Row, scale: f64) -> (DAffine3, DAffine3) {
    let moved = DAffine3::from_translation(DVec3::from_array(row.decenter) * scale);
    (moved, if row.returns { DAffine3::IDENTITY } else { moved })
}

/// Takes a figure of an earlier surface over.
fn pick_up(rows: &mut [Row], rest: &[String]) -> Result<(), String> {
    let asked = rest.join(" ");
    let last = rows.len() - 1;
    let what = rest.first().map(|w| w.to_uppercase()).unwrap_or_default();
    let step: i64 = rest.get(1).and_then(|w| w.parse().ok()).ok_or_else(|| format!("PK {asked}: expected a surface"))?;
    // Relative where it is negative.
    let source = if step < 0 { last as i64 + step } else { step };
    let source = usize::try_from(source).ok().filter(|s| *s < last);
    let from = rows[source.ok_or_else(|| format!("PK {asked}: expected an earlier surface"))?].clone();
    let plus = rest.get(2).and_then(|w| w.parse::<f64>().ok()).unwrap_or(0.0);
    let row = &mut rows[last];
    match what.as_str() {
        "GLA" => (row.glass, row.indices, row.mirror) = (from.glass, from.indices, from.mirror),
        "CV" | "RD" | "CVM" => {
            let sign = if what == "CVM" { -1.0 } else { 1.0 };
            row.c = sign * from.c + plus;
            (row.k, row.powers) = (from.k, from.powers);
            row.plain = from.plain.iter().map(|v| v * sign).collect();
            row.terms = from.terms.iter().map(|v| v * sign).collect();
            row.given[1] = true;
        }
        "TH" => (row.gap, row.given[0]) = (from.gap + plus, true),
        "THM" => (row.gap, row.given[0]) = (plus - from.gap, true),
        "AP" => row.semi_diameter = from.semi_diameter,
        "CC" => row.k = from.k,
        _ => return Err(format!("PK {asked}: of pickups CV, CVM, TH, THM, GLA, AP and CC are read")),
    }
    Ok(())
}

/// Gives gaps and curvatures that files leave to solves: PU the curvature that gives the marginal ray this slope behind the surface, PY the gap at
/// whose end it has this height. Figures that are there stand.
fn solve(rows: &mut [Row], p: &Prescription, scale: f64) {
    if !rows.iter().any(|r| r.solves.iter().any(|(curves, _)| !r.given[usize::from(*curves)])) {
        return;
    }
    let nm = p.usage.wavelengths_nm.first().copied().unwrap_or(crate::glass::D_NM);
    let object = rows[0].gap;
    let radius = match p.usage.aperture {
        Some(ApertureKind::EntrancePupil(d)) => 0.5 * d / scale,
        Some(ApertureKind::ObjectNa(na)) => object * na,
        _ => return,
    };
    let (mut y, mut u) = if object < 1e8 { (radius, radius / object) } else { (radius, 0.0) };
    let (mut n, mut run) = (1.0, 1.0);
    for row in rows.iter_mut().skip(1) {
        if row.mirror {
            run = -run;
        }
        let after = if row.mirror { -n } else { row.glass.index(nm) * run };
        for (curves, figure) in row.solves.clone() {
            if curves && !row.given[1] && y != 0.0 && after != n {
                // n' u' = n u − y c (n' − n)
                row.c = (n * u - after * figure) / (y * (after - n));
            }
        }
        u = (n * u - y * row.c * (after - n)) / after;
        for (curves, figure) in row.solves.clone() {
            if !curves && !row.given[0] && u != 0.0 {
                row.gap = (figure - y) / u;
            }
        }
        y += u * row.gap;
        n = after;
    }
}

/// Words of each command, with its line.
fn commands(text: &str) -> Vec<(usize, Vec<String>)> {
    let mut all = vec![];
    for (i, line) in text.lines().enumerate() {
        let mut words: Vec<String> = vec![];
        let (mut quoted, mut fresh) = (false, true);
        let mut rest = line.chars().peekable();
        while let Some(c) = rest.next() {
            match c {
                '"' => {
                    quoted = !quoted;
                    if fresh {
                        words.push(String::new());
                        fresh = false;
                    }
                }
                '/' if !quoted && rest.peek() == Some(&'/') => break,
                ';' if !quoted => {
                    all.push((i + 1, std::mem::take(&mut words)));
                    fresh = true;
                }
                c if c.is_whitespace() && !quoted => fresh = true,
                c => {
                    if fresh {
                        words.push(String::new());
                        fresh = false;
                    }
                    if let Some(word) = words.last_mut() {
                        word.push(c);
                    }
                }
            }
        }
        all.push((i + 1, words));
    }
    all.retain(|(_, words)| !words.is_empty());
    all
}
