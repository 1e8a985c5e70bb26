//! Zemax OpticStudio lens files (.zmx): keyword lines, a block a surface.
//!
//! Written from the format as its files show it and as ray-optics and optiland read it. Surface types: STANDARD, EVENASPH,
//! ODDASPHE, XASPHERE, TOROIDAL, BICONICX; DIAM is a semi-diameter.

use super::{Skipped, drop_dummies, stem};
use crate::glass::{Glass, GlassError};
use crate::prescription::{ApertureKind, Prescription, PrescriptionError, Surface};
use crate::surface::{Asphere, Profile};
use std::collections::BTreeMap;

/// Keywords of surfaces that do not change its shape, place or medium.
const HARMLESS: &[&str] = &[
    "COMM", "HIDE", "MIRR", "SLAB", "POPS", "COAT", "PZUP", "MAZH", "FLAP", "BLNK", "SCBD", "MEMA", "PPAR", "VPAR", "PKUP",
    "PARP", "DIAP", "GLCZ", "OPDX", "USAP", "UDAP", "FIMP", "TOL", "TOLE", "NOTE", "SDRW", "HLGT", "CONF", "MOFF", "REAY",
    "EFLY", "EFFL", "WRSG", "CLRF", "SSAM", "ELDX", "PICB", "BORD", "FACE", "CONI",
];
/// Keywords of the head that do not change the lens.
const HARMLESS_HEAD: &[&str] = &[
    "VERS", "NOTE", "PFIL", "LANG", "ENVD", "GFAC", "RAIM", "PUSH", "SDMA", "ROPD", "PICB", "XFLN", "FWGN", "VDXN", "VDYN",
    "VCXN", "VANN", "POLS", "GLRS", "GSTD", "NSCD", "COFN", "COFP", "FCOM", "FTYP", "WWGT", "WWGN", "ZVDX", "ZVDY", "ZVCX",
    "ZVAN", "ZVCY", "XFLD", "FWGT", "VCXN", "RSCE", "RWRE", "CMSG", "EFFL", "TOL", "MNUM", "MOFF", "WAVL", "WAVN", "SWCN",
    "PUPD", "PUPZ", "EYES", "GRPH", "TCMM", "TCED", "MCED", "MEID", "BLNK", "AUTH", "PSEQ", "NSCS", "IMAG", "ZCUS", "REAY",
    "EFLY", "LOPT", "ISNA",
];

#[derive(Default)]
struct Block {
    line: usize,
    kind: Option<String>,
    curvature: f64,
    conic: f64,
    gap: f64,
    infinite: bool,
    glass: Option<Glass>,
    mirror: bool,
    stop: bool,
    semi_diameter: Option<f64>,
    obstruction: f64,
    clear: Option<f64>,
    parameters: BTreeMap<u32, f64>,
    extra: BTreeMap<u32, f64>,
}

pub fn read(text: &str, file: &str) -> Result<Prescription, PrescriptionError> {
    let mut blocks: Vec<Block> = vec![];
    let mut p = Prescription::new(stem(file), vec![]);
    let mut scale = 1.0;
    let mut vendors: Vec<String> = vec![];
    let mut skipped = Skipped::default();
    let mut waves: BTreeMap<usize, f64> = BTreeMap::new();
    let (mut primary, mut field_kind, mut fields) = (1usize, 0.0, vec![]);
    let mut vignetting: Vec<f64> = vec![];
    let mut notes: Vec<String> = vec![];
    for (number, line) in text.lines().enumerate() {
        let number = number + 1;
        let mut words = line.split_whitespace();
        let Some(key) = words.next() else { continue };
        let rest: Vec<&str> = words.collect();
        let surface = blocks.len().checked_sub(1);
        let wrong = |what: String| {
            let e = PrescriptionError::at(file, number, what);
            if let Some(s) = surface { e.surface(s) } else { e }
        };
        let value = |i: usize| -> Result<f64, PrescriptionError> {
            let word = rest.get(i).ok_or_else(|| wrong(format!("{key}: expected a number after it")))?;
            word.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| wrong(format!("{key} {word}: expected a number")))
        };
        let numbers = || rest.iter().map_while(|w| w.parse::<f64>().ok()).collect::<Vec<f64>>();
        if key == "SURF" {
            if blocks.len() > crate::prescription::MOST_SURFACES + 2 {
                return Err(wrong(format!("more than {} surfaces", crate::prescription::MOST_SURFACES)));
            }
            blocks.push(Block { line: number, ..Block::default() });
            continue;
        }
        let Some(block) = blocks.last_mut() else {
            match key {
                "MODE" if rest.first().is_some_and(|m| *m != "SEQ") => {
                    return Err(wrong(format!("MODE {}: only sequential lenses (SEQ) are read", rest[0])));
                }
                "MODE" => {}
                "NAME" => p.name = rest.join(" "),
                "UNIT" => {
                    scale = match rest.first().copied() {
                        Some("MM") | None => 1.0,
                        Some("CM") => 10.0,
                        Some("IN") => 25.4,
                        Some("M" | "METER") => 1000.0,
                        Some(other) => return Err(wrong(format!("UNIT {other}: expected MM, CM, IN or METER"))),
                    }
                }
                "ENPD" => p.usage.aperture = Some(ApertureKind::EntrancePupil(value(0)?)),
                "FNUM" => p.usage.aperture = Some(ApertureKind::FNumber(value(0)?)),
                "OBNA" => p.usage.aperture = Some(ApertureKind::ObjectNa(value(0)?)),
                // The stop's own size is the aperture.
                "FLOA" => {}
                "FTYP" => field_kind = value(0).unwrap_or(0.0),
                "YFLN" | "YFLD" => fields = numbers(),
                "VCYN" => vignetting = numbers(),
                "WAVM" => {
                    waves.insert(value(0)? as usize, value(1)?);
                }
                "PWAV" => primary = value(0)? as usize,
                "GCAT" => vendors = rest.iter().map(|v| v.to_lowercase()).collect(),
                other if HARMLESS_HEAD.contains(&other) => {}
                other => skipped.add(other),
            }
            continue;
        };
        match key {
            "TYPE" => block.kind = rest.first().map(|s| (*s).to_owned()),
            "CURV" => block.curvature = value(0)?,
            "CONI" => block.conic = value(0)?,
            "DISZ" if rest.first() == Some(&"INFINITY") => block.infinite = true,
            "DISZ" => block.gap = value(0)?,
            "DIAM" => block.semi_diameter = Some(value(0)?).filter(|d| *d > 0.0),
            "STOP" => block.stop = true,
            "PARM" => {
                block.parameters.insert(value(0)? as u32, value(1)?);
            }
            "XDAT" => {
                block.extra.insert(value(0)? as u32, value(1)?);
            }
            "OBSC" => {
                if value(0)? > 0.0 && rest.len() > 1 {
                    return Err(wrong(format!(
                        "OBSC {}: a ring-shaped obstruction is not read, only a disk (from 0)",
                        rest.join(" ")
                    )));
                }
                block.obstruction = value(1).or_else(|_| value(0))?;
            }
            "CLAP" => {
                let (inner, outer) = (value(0)?, value(1)?);
                if outer > 0.0 {
                    (block.obstruction, block.clear) = (inner.max(0.0), Some(outer));
                }
            }
            "SQAP" | "ELAP" | "SQOB" | "ELOB" | "SPID" => {
                notes.push(format!("surface {}: aperture {key} is not round; its circle is used", surface.unwrap_or(0)));
            }
            "GLAS" => {
                let name = rest.first().copied().unwrap_or("");
                if name == "MIRROR" {
                    block.mirror = true;
                    continue;
                }
                let n = numbers_from(&rest, 1);
                // "GLAS name solve pickup nd Vd ...": the file's own figures serve where the name is in no catalogue.
                let (nd, vd) = (n.get(2).copied().unwrap_or(0.0), n.get(3).copied().unwrap_or(0.0));
                let off_line = n.get(4).copied().filter(|d| d.abs() < 0.2).unwrap_or(0.0);
                let figures = || Glass::model(nd, vd, off_line);
                let preferred: Vec<&str> = vendors.iter().map(String::as_str).collect();
                let glass = if name.starts_with("___") || name == "BLANK" {
                    figures()
                } else {
                    match Glass::parse_preferring(name, &preferred) {
                        Err(GlassError::Unknown { .. } | GlassError::NoFigures(_)) if nd > 1.0 && vd > 10.0 => {
                            notes.push(format!("glass \"{name}\" is in no catalogue: the file's nd {nd}, Vd {vd} are used"));
                            figures()
                        }
                        found => found,
                    }
                };
                block.glass = Some(glass.map_err(|e| wrong(e.to_string()))?);
            }
            "MNUM" => {
                if let Some(count) = numbers().first().filter(|n| **n > 1.0) {
                    notes.push(format!("the file has {count} configurations: the one its surfaces stand in is read"));
                }
            }
            other if HARMLESS.contains(&other) => {}
            other => skipped.add(other),
        }
    }
    if blocks.len() < 3 {
        let what = format!("{} surfaces: expected SURF blocks for object, lens and image", blocks.len());
        return Err(PrescriptionError::at(file, 0, what));
    }
    let object = &blocks[0];
    if !object.infinite && object.gap < 1e9 {
        p.usage.object_distance = Some(object.gap * scale);
    }
    let last = blocks.len() - 1;
    for (i, b) in blocks[1..last].iter().enumerate() {
        let wrong = |what: String| PrescriptionError::at(file, b.line, what).surface(i + 1);
        if b.infinite {
            return Err(wrong("an infinite gap inside the lens".into()));
        }
        let profile = profile(b, scale).map_err(wrong)?;
        let medium = match (&b.glass, b.mirror) {
            (Some(g), _) => g.clone(),
            // A mirror goes on in what was before it.
            (None, true) => p.surfaces.last().map_or(Glass::air(), |s: &Surface| s.glass.clone()),
            (None, false) => Glass::air(),
        };
        p.surfaces.push(Surface {
            line: b.line,
            semi_diameter: b.clear.or(b.semi_diameter).map(|d| d * scale),
            obstruction: b.obstruction * scale,
            stop: b.stop,
            mirror: b.mirror,
            ..Surface::new(profile, b.gap * scale, medium)
        });
    }
    if blocks[last].curvature != 0.0 {
        notes.push("the image surface is curved in the file; the film is flat".into());
    }
    p.usage.aperture = p.usage.aperture.map(|a| match a {
        ApertureKind::EntrancePupil(d) => ApertureKind::EntrancePupil(d * scale),
        other => other,
    });
    // Unused wavelengths are written as repeats of 0.55.
    let mut wavelengths: Vec<f64> = waves.values().map(|um| um * 1000.0).collect();
    while wavelengths.len() > primary.max(1) && wavelengths[wavelengths.len() - 1] == wavelengths[wavelengths.len() - 2] {
        wavelengths.pop();
    }
    if wavelengths.len() > primary.max(1) && waves.len() >= 12 && wavelengths.last() == Some(&550.0) {
        wavelengths.pop();
    }
    p.usage.reference = primary.saturating_sub(1).min(wavelengths.len().saturating_sub(1));
    p.usage.wavelengths_nm = wavelengths;
    if field_kind == 0.0 {
        while fields.len() > 1 && fields.last() == Some(&0.0) {
            fields.pop();
        }
        p.usage.vignetting = fields.iter().enumerate().map(|(i, _)| [vignetting.get(i).copied().unwrap_or(0.0); 2]).collect();
        p.usage.field_angles_deg = fields;
    } else {
        notes.push("fields are given as heights in the file; they are not taken over".into());
    }
    p.notes = notes;
    skipped.note(&mut p);
    if p.source.is_empty() {
        p.source = format!("{}, Zemax file", stem(file));
    }
    drop_dummies(&mut p);
    p.checked(file)
}

fn numbers_from(words: &[&str], from: usize) -> Vec<f64> {
    words.iter().skip(from).map_while(|w| w.parse().ok()).collect()
}

fn profile(b: &Block, scale: f64) -> Result<Profile, String> {
    let c = b.curvature / scale;
    let parameter = |i: u32| b.parameters.get(&i).copied().unwrap_or(0.0);
    // A coefficient of rⁱ in file units.
    let term = |power: i32, value: f64| value * scale.powi(1 - power);
    let asphere = |terms: Vec<(usize, f64)>| {
        let mut a = vec![];
        for (power, value) in terms {
            if value != 0.0 {
                a.resize(a.len().max(power + 1), 0.0);
                a[power] = term(power as i32, value);
            }
        }
        crate::prescription::profile(c, b.conic, a, None)
    };
    Ok(match b.kind.as_deref().unwrap_or("STANDARD") {
        "STANDARD" => asphere(vec![]),
        "EVENASPH" => asphere((1..=8).map(|i| (2 * i as usize, parameter(i))).collect()),
        "ODDASPHE" => asphere((1..=8).map(|i| (i as usize, parameter(i))).collect()),
        // Extended asphere: number of terms, normalisation radius, then terms of (r/r₀)²ⁱ.
        "XASPHERE" => {
            let get = |i: u32| b.extra.get(&i).copied().unwrap_or(0.0);
            let (count, norm) = (get(1).max(0.0) as u32, get(2));
            if count > 20 {
                return Err(format!("XASPHERE: {count} terms: expected at most 20"));
            }
            if count > 0 && norm <= 0.0 {
                return Err(format!("XASPHERE: normalisation radius {norm}: expected a positive length"));
            }
            asphere((1..=count).map(|i| (2 * i as usize, get(2 + i) / norm.powi(2 * i as i32))).collect())
        }
        // A curve in y–z (even powers of y) turned about an axis at the radius of parameter 1; 0 there is a cylinder.
        "TOROIDAL" => {
            let mut a = vec![];
            for i in 2..=8 {
                if parameter(i) != 0.0 {
                    let power = 2 * (i as usize - 1);
                    a.resize(a.len().max(power + 1), 0.0);
                    a[power] = term(power as i32, parameter(i));
                }
            }
            let c_x = if parameter(1) == 0.0 { 0.0 } else { 1.0 / (parameter(1) * scale) };
            if c == 0.0 && c_x == 0.0 && a.is_empty() {
                Profile::Plane
            } else {
                Profile::Toroid { y: Asphere { c, k: b.conic, a }, c_x }
            }
        }
        "BICONICX" if b.conic == 0.0 && parameter(2) == 0.0 => {
            let c_x = if parameter(1) == 0.0 { 0.0 } else { 1.0 / (parameter(1) * scale) };
            crate::prescription::profile(c, 0.0, vec![], Some(c_x))
        }
        other => return Err(format!("surface type {other}: expected STANDARD, EVENASPH, ODDASPHE, XASPHERE or TOROIDAL")),
    })
}
