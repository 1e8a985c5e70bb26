//! CODE V sequence files (.seq): commands, `;` between them, `!` before comments, `&` before a continued line.
//!
//! Written from the command names as the files show them and as ray-optics reads them. Without `RDM` (or with `RDM N`) surfaces
//! carry curvatures, with it radii.

use super::{Skipped, drop_dummies, stem};
use crate::glass::Glass;
use crate::prescription::{ApertureKind, Prescription, PrescriptionError, Surface};
use crate::surface::Profile;
use std::collections::HashMap;

/// Commands that do not change the lens: solves, variables, tolerances, drawing, weights.
const HARMLESS: &[&str] = &[
    "LEN", "INI", "WTW", "WTF", "VUX", "VLX", "CCY", "THC", "CUM", "THM", "PIM", "SLB", "DER", "VAL", "GO", "XAN", "XIM", "XOB",
    "TEM", "CLS", "PIK", "CA", "GLC", "CON", "KC", "AC", "BC", "CC", "DC", "EC", "FC", "GC", "HC", "JC", "XDC", "YDC", "ZDC",
    "ADC", "BDC", "CDC", "PRE", "POL", "PFR", "SET", "EDI", "UNI", "AFC", "CRT", "CVY", "IMG", "WID", "YRI", "XRI", "RAY", "LIN",
    "WTX", "WTY", "SAV", "LIS", "FTY", "XFN", "PTP", "MFL", "DSP", "CIN", "CIX", "GL1", "CTE", "COM", "TIT",
];

struct Current {
    surface: Surface,
    c: f64,
    k: f64,
    a: Vec<f64>,
    c_x: Option<f64>,
    returns: bool,
    tilted: bool,
    /// A curvature or (true) radius given by name.
    written: Option<(f64, bool)>,
}

pub fn read(text: &str, file: &str) -> Result<Prescription, PrescriptionError> {
    let mut p = Prescription::new(stem(file), vec![]);
    let mut skipped = Skipped::default();
    let mut radii: Option<bool> = None;
    let mut scale = 1.0;
    let mut rows: Vec<Current> = vec![];
    let mut object: Option<f64> = None;
    let mut image: Option<f64> = None;
    let (mut upper, mut lower): (Vec<f64>, Vec<f64>) = (vec![], vec![]);
    let mut fields_are_angles = false;
    // Private catalogue: wavelengths, then names with indices.
    let (mut private, mut private_nm): (HashMap<String, Vec<f64>>, Vec<f64>) = (HashMap::new(), vec![]);
    let mut in_private = false;
    for (number, command) in commands(text) {
        let words = words(&command);
        let Some(first) = words.first() else { continue };
        let key = first.to_uppercase();
        let rest = &words[1..];
        let at_surface = rows.len();
        let wrong = |what: String| {
            let e = PrescriptionError::at(file, number, what);
            if at_surface > 0 { e.surface(at_surface) } else { e }
        };
        let parse = |w: &String| {
            w.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| wrong(format!("{key} {w}: expected a number")))
        };
        // The last word, after qualifiers such as S3 or Z1.
        let value = || parse(rest.last().ok_or_else(|| wrong(format!("{key}: expected a number after it")))?);
        let numbers = || rest.iter().filter_map(|w| w.parse::<f64>().ok()).collect::<Vec<f64>>();
        if in_private {
            match key.as_str() {
                "END" => in_private = false,
                "PWL" => private_nm = numbers(),
                _ => {
                    let n: Vec<f64> = rest.iter().map(parse).collect::<Result<_, _>>()?;
                    private.insert(key.trim_matches('\'').to_owned(), n);
                }
            }
            continue;
        }
        let number_of = |w: &str, what: &str| {
            w.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| wrong(format!("{what} \"{w}\": expected a number")))
        };
        let surface_row = key == "S" || (key.len() > 1 && key.starts_with('S') && key[1..].chars().all(|c| c.is_ascii_digit()));
        match key.as_str() {
            "RDM" => radii = Some(rest.first().is_none_or(|w| !w.to_uppercase().starts_with('N'))),
            "TITLE" | "TIT" => p.name = rest.join(" ").trim_matches(['\'', '"']).to_owned(),
            "DIM" => {
                scale = match rest.first().map(|w| w.to_uppercase()).as_deref() {
                    Some("M") | None => 1.0,
                    Some("C") => 10.0,
                    Some("I") => 25.4,
                    Some(other) => return Err(wrong(format!("DIM {other}: expected M, C or I"))),
                }
            }
            "EPD" => p.usage.aperture = Some(ApertureKind::EntrancePupil(value()?)),
            "FNO" => p.usage.aperture = Some(ApertureKind::FNumber(value()?)),
            "NAO" => p.usage.aperture = Some(ApertureKind::ObjectNa(value()?)),
            "WL" => p.usage.wavelengths_nm = numbers(),
            "REF" => p.usage.reference = (value()? as usize).saturating_sub(1),
            "YAN" => (p.usage.field_angles_deg, fields_are_angles) = (numbers(), true),
            "YIM" | "YOB" => fields_are_angles = false,
            "VUY" => upper = numbers(),
            "VLY" => lower = numbers(),
            "PRV" => in_private = true,
            "SO" => object = rest.get(1).map(|w| number_of(w, "object distance")).transpose()?,
            "SI" => image = rest.get(1).map(|w| number_of(w, "image gap")).transpose()?,
            "ZOO" => return Err(wrong("ZOO: zoomed CODE V lenses are not read: save one position".into())),
            _ if surface_row => {
                if rows.len() >= crate::prescription::MOST_SURFACES {
                    return Err(wrong(format!("more than {} surfaces", crate::prescription::MOST_SURFACES)));
                }
                let shape = rest.first().map_or(Ok(0.0), |w| number_of(w, "curvature"))?;
                let gap = rest.get(1).map_or(Ok(0.0), |w| number_of(w, "gap"))?;
                let medium = rows.last().map_or(Glass::air(), |r| r.surface.glass.clone());
                let (mut glass, mut mirror) = (Glass::air(), false);
                for name in rest.iter().skip(2) {
                    match name.to_uppercase().as_str() {
                        "REFL" => (mirror, glass) = (true, medium.clone()),
                        "REFR" => {}
                        upper => glass = self::glass(upper, &private, &private_nm).map_err(&wrong)?,
                    }
                }
                let surface = Surface { line: number, mirror, ..Surface::new(Profile::Plane, gap, glass) };
                rows.push(Current {
                    surface,
                    c: shape,
                    k: 0.0,
                    a: vec![],
                    c_x: None,
                    returns: false,
                    tilted: false,
                    written: None,
                });
            }
            other => {
                // "K S1 -1" means surface 1 whatever was read last.
                let named = rest.iter().find_map(|w| surface_number(w));
                let count = rows.len();
                let target = match named {
                    None => rows.last_mut(),
                    Some(_) if HARMLESS.contains(&other) => rows.last_mut(),
                    Some(i) if (1..=count).contains(&i) => rows.get_mut(i - 1),
                    Some(i) => return Err(wrong(format!("{other} S{i}: the surfaces read so far are 1 to {count}"))),
                };
                let Some(row) = target else {
                    if !HARMLESS.contains(&other) {
                        skipped.add(other);
                    }
                    continue;
                };
                let power = |row: &mut Current, power: usize| -> Result<(), PrescriptionError> {
                    row.a.resize(row.a.len().max(power + 1), 0.0);
                    row.a[power] = value()?;
                    Ok(())
                };
                match other {
                    "STO" => row.surface.stop = true,
                    "K" => row.k = value()?,
                    "ASP" | "SPH" => {}
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
                        row.surface.glass = self::glass(&name, &private, &private_nm).map_err(wrong)?;
                    }
                    // A cylinder or toroid: curvature or radius in x.
                    "CYL" => row.c_x = Some(0.0),
                    "CUX" => row.c_x = Some(value()?),
                    "RDX" => row.c_x = Some(1.0 / value()?),
                    "XDE" => row.surface.decenter[0] = value()?,
                    "YDE" => row.surface.decenter[1] = value()?,
                    "ADE" => (row.surface.tilt[0], row.tilted) = (-value()?, true),
                    "BDE" => (row.surface.tilt[1], row.tilted) = (-value()?, true),
                    "CDE" => (row.surface.tilt[2], row.tilted) = (value()?, true),
                    "DAR" => row.returns = true,
                    "CIR" => {
                        let upper: Vec<String> = rest.iter().map(|w| w.to_uppercase()).collect();
                        if upper.iter().any(|w| w == "OBS") {
                            row.surface.obstruction = value()?;
                        } else if upper.iter().any(|w| w == "HOL") {
                            // Nothing is there: light passes the hole beside the reflected path, or is lost.
                            row.surface.obstruction = value()?;
                        } else if !upper.iter().any(|w| w == "EDG") {
                            row.surface.semi_diameter = Some(value()?);
                        }
                    }
                    "GRI" | "DIF" | "HOE" | "SPS" | "XTO" | "ZRN" | "NSS" | "DEC" | "BEN" | "REV" | "GLB" | "RAD" | "DDM"
                    | "ZDE" | "REX" | "REY" | "ADX" | "ADY" | "ELX" | "ELY" => {
                        return Err(wrong(format!("{other}: this kind of surface is not read")));
                    }
                    _ if HARMLESS.contains(&other) => {}
                    _ => skipped.add(other),
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
    for r in rows {
        let wrong = |what: &str| PrescriptionError::at(file, r.surface.line, what).surface(p.surfaces.len() + 1);
        let moved = r.surface.decenter != [0.0; 2] || r.tilted;
        if moved && !r.returns {
            return Err(wrong("decentre or tilt without DAR: surfaces after it would follow, which is not read"));
        }
        let (figure, is_radius) = r.written.unwrap_or((r.c, by_radius));
        let c = if is_radius && figure != 0.0 { 1.0 / figure } else { figure } / scale;
        let a: Vec<f64> = r.a.iter().enumerate().map(|(i, v)| v * f64::powi(scale, 1 - i as i32)).collect();
        let mut s = r.surface;
        s.profile = crate::prescription::profile(c, r.k, a, r.c_x.map(|c| c / scale));
        s.gap.values[0][0] *= scale;
        s.semi_diameter = s.semi_diameter.map(|d| d * scale);
        s.obstruction *= scale;
        s.decenter = s.decenter.map(|d| d * scale);
        p.surfaces.push(s);
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
    p.usage.object_distance = object.map(|d| d * scale).filter(|d| *d < 1e9);
    p.usage.defocus = image.unwrap_or(0.0) * scale;
    if p.source.is_empty() {
        p.source = format!("{}, CODE V file", stem(file));
    }
    skipped.note(&mut p);
    drop_dummies(&mut p);
    p.checked(file)
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

/// A catalogue name, a private glass, or a six-digit code "517.642" (nd 1.517, Vd 64.2).
fn glass(name: &str, private: &HashMap<String, Vec<f64>>, private_nm: &[f64]) -> Result<Glass, String> {
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
        let (n, v) = digits.split_once('.').or_else(|| digits.split_once(':'))?;
        let number = |t: &str| (t.len() >= 3 && t.chars().all(|c| c.is_ascii_digit())).then(|| t.parse::<f64>().ok()).flatten();
        let (nd, vd) = (number(n)?, number(v)?);
        Some((1.0 + nd / 10f64.powi(n.len() as i32), vd / 10f64.powi(v.len() as i32 - 2)))
    };
    // "1.5168" is an index, not nd 1.1 and Vd 51.68.
    if let Some((nd, vd)) = coded(name) {
        return Glass::model(nd, vd, 0.0).map_err(|e| e.to_string());
    }
    Glass::parse(name).map_err(|e| e.to_string())
}
