//! Zemax OpticStudio lens files (.zmx): keyword lines, a block a surface.
//!
//! Written from the format as its files show it and as ray-optics and optiland read it. DIAM is a semi-diameter.
//!
//! | keyword | what is done |
//! |---|---|
//! | MODE, NAME, UNIT, ENPD, FNUM, OBNA, FLOA, YFLN, VCYN, WAVM, PWAV, GCAT | read |
//! | FTYP | angles are read; heights and fields in x (XFLN) are left out, with a note |
//! | TYPE STANDARD, EVENASPH, ODDASPHE, XASPHERE, TOROIDAL, BICONICX | read |
//! | TYPE COORDBRK | read: decentre x, y; tilt about x, y, z; order (Zemax manual, "Coordinate Break"); see layout.rs |
//! | other TYPE: gratings, paraxial and diffractive surfaces, gradient indices, user surfaces | error |
//! | CURV, CONI, PARM, XDAT, DISZ, STOP, DIAM, CLAP, OBSC from 0 | read |
//! | OBSC of a ring, OBDC (aperture beside the vertex) | error |
//! | SQAP, ELAP, SQOB, ELOB, SPID | approximated by the circle of DIAM, with a note |
//! | GLAS | the catalogue's glass; an alias with a note (glass/alias.rs); the line's nd and Vd where neither is known, but for the placeholder 1.5, 40 |
//! | GLAS MIRROR | a mirror; plane ones that fold the axis are unfolded |
//! | SCBD (tilt of a surface of its own) | left out, with a note where it is not zero |
//! | MNUM above 1 | the configuration in which the surfaces stand; with a note |
//! | curved image surface | taken for plane, with a note |
//! | coatings, solves, pickups, tolerances, drawing, weights, ray aiming (`HARMLESS`, `HARMLESS_HEAD`) | ignored: rays do not change |
//! | all others | skipped, named in a note |

use super::layout::{Placed, ahead, lay_out, moved_then_turned, turned_then_moved};
use super::{Skipped, drop_dummies, stem};
use crate::glass::{D_NM, Glass, GlassError, parse_foreign};
use crate::prescription::{ApertureKind, Prescription, PrescriptionError, Surface};
use crate::surface::{Asphere, Profile};
use glam::{DAffine3, DVec3};
use std::collections::BTreeMap;

/// What Zemax writes as nd and Vd of a glass that it takes from a catalogue.
const PLACEHOLDER: (f64, f64) = (1.5, 40.0);

/// Keywords of surfaces that do not change its shape, place or medium.
const HARMLESS: &[&str] = &[
    "COMM", "HIDE", "MIRR", "SLAB", "POPS", "COAT", "PZUP", "MAZH", "FLAP", "BLNK", "MEMA", "PPAR", "VPAR", "PKUP", "PARP",
    "DIAP", "GLCZ", "OPDX", "USAP", "UDAP", "FIMP", "TOL", "TOLE", "NOTE", "SDRW", "HLGT", "CONF", "MOFF", "REAY", "EFLY",
    "EFFL", "WRSG", "CLRF", "SSAM", "ELDX", "PICB", "BORD", "FACE", "CONI",
];
/// Keywords of the head that do not change the lens.
const HARMLESS_HEAD: &[&str] = &[
    "VERS", "NOTE", "PFIL", "LANG", "ENVD", "GFAC", "RAIM", "PUSH", "SDMA", "ROPD", "PICB", "FWGN", "VDXN", "VDYN", "VCXN",
    "VANN", "POLS", "GLRS", "GSTD", "NSCD", "COFN", "COFP", "FCOM", "FTYP", "WWGT", "WWGN", "ZVDX", "ZVDY", "ZVCX", "ZVAN",
    "ZVCY", "FWGT", "VCXN", "RSCE", "RWRE", "CMSG", "EFFL", "TOL", "MNUM", "MOFF", "WAVL", "WAVN", "SWCN", "PUPD", "PUPZ",
    "EYES", "GRPH", "TCMM", "TCED", "MCED", "MEID", "BLNK", "AUTH", "PSEQ", "NSCS", "IMAG", "ZCUS", "REAY", "EFLY", "LOPT",
    "ISNA",
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
    /// Its semi-diameter is set, not computed from rays.
    fixed: bool,
    parameters: BTreeMap<u32, f64>,
    extra: BTreeMap<u32, f64>,
}

impl Block {
    fn is_break(&self) -> bool {
        self.kind.as_deref() == Some("COORDBRK")
    }
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
                "XFLN" | "XFLD" => {
                    if numbers().iter().any(|x| *x != 0.0) {
                        notes.push("fields in x are not taken over, only those in y".into());
                    }
                }
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
            "DIAM" => {
                block.semi_diameter = Some(value(0)?).filter(|d| *d > 0.0);
                block.fixed = rest.get(1) == Some(&"1");
            }
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
            "OBDC" => {
                if numbers().iter().any(|v| *v != 0.0) {
                    return Err(wrong(format!("OBDC {}: an aperture beside the vertex is not read", rest.join(" "))));
                }
            }
            "SCBD" => {
                if numbers().iter().any(|v| *v != 0.0) {
                    let number = surface.unwrap_or(0);
                    notes.push(format!(
                        "surface {number}: SCBD (a tilt or decentre of its own) is left out; write COORDBRK instead"
                    ));
                }
            }
            "SQAP" | "ELAP" | "SQOB" | "ELOB" | "SPID" => {
                notes.push(format!("surface {}: aperture {key} is not round; its circle is used", surface.unwrap_or(0)));
            }
            "GLAS" => {
                if rest.first() == Some(&"MIRROR") {
                    block.mirror = true;
                    continue;
                }
                let preferred: Vec<&str> = vendors.iter().map(String::as_str).collect();
                block.glass = Some(glass(&rest, &preferred, &mut notes).map_err(wrong)?);
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
    // Where each surface stands, through the coordinate breaks.
    let mut rows: Vec<Placed> = vec![];
    let mut here = DAffine3::IDENTITY;
    let breaks = blocks[1..last].iter().any(Block::is_break);
    for (i, b) in blocks[1..last].iter().enumerate() {
        let wrong = |what: String| PrescriptionError::at(file, b.line, what).surface(i + 1);
        if b.infinite {
            return Err(wrong("an infinite gap inside the lens".into()));
        }
        let before = rows.last().map_or(Glass::air(), |r| r.surface.glass.clone());
        let (shape, medium) = match (&b.glass, b.mirror) {
            // A coordinate break bends nothing.
            _ if b.is_break() => (Profile::Plane, before),
            (Some(g), _) => (profile(b, scale).map_err(wrong)?, g.clone()),
            // A mirror goes on in what was before it.
            (None, true) => (profile(b, scale).map_err(wrong)?, before),
            (None, false) => (profile(b, scale).map_err(wrong)?, Glass::air()),
        };
        if b.is_break() {
            here *= coordinate_break(b, scale);
        }
        if !b.is_break() || b.stop {
            let surface = Surface {
                line: b.line,
                semi_diameter: b.clear.or(b.semi_diameter).map(|d| d * scale),
                obstruction: b.obstruction * scale,
                stop: b.stop,
                mirror: b.mirror && !b.is_break(),
                ..Surface::new(shape, b.gap * scale, medium)
            };
            rows.push(Placed { surface, frame: here, rim: b.mirror && (b.clear.is_some() || b.fixed) });
        }
        here *= ahead(b.gap * scale);
    }
    if breaks {
        lay_out(rows, here, &mut p).map_err(|(line, what)| PrescriptionError::at(file, line, what))?;
    } else {
        p.surfaces = rows.into_iter().map(|r| r.surface).collect();
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
    p.notes.extend(notes);
    skipped.note(&mut p);
    if p.source.is_empty() {
        p.source = format!("{}, Zemax file", stem(file));
    }
    if !breaks {
        drop_dummies(&mut p);
    }
    p.checked(file)
}

/// The coordinate system after a break, seen from the one before it: decentre, then tilts about x, y and z; with the order flag tilts
/// about z, y and x, then decentre. Angles follow the right hand (Zemax, "Rotation Matrix and Tilt About X/Y/Z in OpticStudio").
fn coordinate_break(b: &Block, scale: f64) -> DAffine3 {
    let parameter = |i: u32| b.parameters.get(&i).copied().unwrap_or(0.0);
    let decenter = DVec3::new(parameter(1), parameter(2), 0.0) * scale;
    let tilt = [parameter(3), parameter(4), parameter(5)];
    if parameter(6) == 0.0 { moved_then_turned(decenter, tilt) } else { turned_then_moved(decenter, tilt) }
}

/// The glass of a line "GLAS name model pickup nd Vd dPgF ...".
fn glass(rest: &[&str], vendors: &[&str], notes: &mut Vec<String>) -> Result<Glass, String> {
    let name = rest.first().copied().unwrap_or("");
    let n = numbers_from(rest, 1);
    let figure = |i: usize| n.get(i).copied().unwrap_or(0.0);
    let (nd, vd) = (figure(2), figure(3));
    let off_line = Some(figure(4)).filter(|d| d.abs() < 0.2).unwrap_or(0.0);
    let stated = nd > 1.0 && vd > 10.0 && (nd, vd) != PLACEHOLDER;
    let figures = || Glass::model(nd, vd, off_line).map_err(|e| e.to_string());
    if name.starts_with("___") || name == "BLANK" {
        let model = figure(0) == 1.0;
        if !stated && !model {
            return Err(format!("glass \"{name}\": expected a name, or the model flag with nd and Vd"));
        }
        return figures();
    }
    match parse_foreign(name, vendors) {
        Ok((found, note)) => {
            let (n_found, v_found) = (found.index(D_NM), found.abbe());
            let differs = stated && ((n_found - nd).abs() > 1e-3 || (v_found - vd).abs() > 0.5);
            match note {
                // Another glass of that name, then.
                Some(_) if differs => {
                    notes.push(format!("glass \"{name}\" is in no catalogue: the file's nd {nd}, Vd {vd} are used"));
                    return figures();
                }
                Some(note) if !notes.contains(&note) => notes.push(note),
                None if differs => notes.push(format!(
                    "glass \"{name}\": the file says nd {nd}, Vd {vd}; the catalogue's {n_found:.5}, {v_found:.2} are used"
                )),
                _ => {}
            }
            Ok(found)
        }
        Err(GlassError::Unknown { .. } | GlassError::NoFigures(_)) if stated => {
            notes.push(format!("glass \"{name}\" is in no catalogue: the file's nd {nd}, Vd {vd} are used"));
            figures()
        }
        Err(e) if (nd, vd) == PLACEHOLDER => {
            Err(format!("{e} (nd 1.5, Vd 40 on this line are what Zemax writes for any catalogue glass, not its figures)"))
        }
        Err(e) => Err(e.to_string()),
    }
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
            if let Some(terms) = b.extra.get(&1).filter(|t| **t > 0.0) {
                return Err(format!("TOROIDAL: {terms} Zernike terms: expected none"));
            }
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
        // Radius and conic constant in x are parameters 1 and 2; radius 0 is a plane in x.
        "BICONICX" => {
            let c_x = if parameter(1) == 0.0 { 0.0 } else { 1.0 / (parameter(1) * scale) };
            crate::prescription::biconic([c_x, parameter(2)], [c, b.conic])
        }
        other => return Err(refused(other)),
    })
}

/// Why a type of surface is not read.
fn refused(kind: &str) -> String {
    let why = match kind {
        k if k.contains("PARAX") => "an ideal lens has no glass to trace: give its real surfaces, or use the lens `thin`",
        k if k.contains("GRAT") || k.contains("ELLIPGR") => "diffraction gratings are not traced",
        k if k.starts_with("BINARY") || k.contains("HOLO") => "diffractive surfaces are not traced",
        k if k.starts_with("GRIN") || k == "GRADIUM" => "gradient-index glass is not traced",
        k if k.starts_with("NONSEQ") => "only sequential lenses are read",
        _ => "this shape is not known",
    };
    format!("surface type {kind}: {why}; expected STANDARD, EVENASPH, ODDASPHE, XASPHERE, TOROIDAL, BICONICX or COORDBRK")
}
