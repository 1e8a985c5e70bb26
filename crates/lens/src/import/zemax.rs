//! Zemax OpticStudio lens files (.zmx): keyword lines, a block a surface.
//!
//! Written from the format as its files show it and as ray-optics and optiland read it. DIAM is a semi-diameter.
//!
//! | keyword | what is done |
//! |---|---|
//! | FNUM x 1 (paraxial working f-number), OBNA x 1 (half angle of the cone, degrees) | the entrance pupil of that beam, for an object at a finite distance |
//! | MODE, NAME, UNIT, ENPD, FNUM, OBNA, FLOA, YFLN, VCYN, VDYN, PWAV | read |
//! | WAVM | read; a wavelength of weight 0 is left out, other weights count as 1, with a note where they differ |
//! | VDXN, VCXN, VANN | left out, with a note where they are not zero |
//! | GCAT | the makers asked first; INFRARED, MISC, BIREFRINGENT: materials of no maker |
//! | WAVL (wavelengths of older files, in one line) | read where there is no WAVM |
//! | FTYP | numbers of fields and wavelengths; angles in y are read; heights and fields in x (XFLN) as the angles of them, where the lens is round (fields.rs), with a note |
//! | TYPE STANDARD, EVENASPH, ODDASPHE, XASPHERE, TOROIDAL, BICONICX, PARAXIAL (its OPD mode is not), GRINSUR1 to GRINSUR3, QED_TYPE | read |
//! | TYPE SZERNSAG, FZERNSAG (their Zernike decentre: error unless 0; terms go on beyond the normalisation radius), XPOLYNOM, FRESNELS | read |
//! | TYPE BINARY_1, BINARY_2 | read: phase in radians times the order, PARM 0 |
//! | TYPE DGRATING | read: order 1 sends light towards −y, as ray-optics and Optiland trace such files |
//! | TYPE COORDBRK | read: decentre x, y; tilt about x, y, z; order (Zemax manual, "Coordinate Break"); see layout.rs |
//! | other TYPE: BINARY_3, holograms, other gratings and gradient indices, user surfaces | error |
//! | CURV, CONI, PARM, XDAT, DISZ, STOP, DIAM, CLAP, FLAP (DIAM is an aperture) | read |
//! | SQAP, ELAP (instead of DIAM), OBSC, SQOB, ELOB, SPID, OBDC (their middle, also of CLAP) | read |
//! | GLAS | the catalogue's glass; an alias with a note (glass/alias.rs); the line's nd and Vd where neither is known, and of plastics without a maker (PMMA, POLYCARB, POLYSTYR) where they are others, but for the placeholder 1.5, 40 |
//! | GLAS MIRROR | a mirror; plane ones that fold the axis are unfolded |
//! | SCBD (tilt of a surface of its own) | left out, with a note where it is not zero |
//! | MNUM with THIC | gaps of configurations: zoom positions or a near focus (configurations.rs) |
//! | CRVT, GLSS, ... (`OPERANDS`) of configurations | the current one stands; with a note |
//! | COAT AR, MGF2; HEAR1, HEAR2 | a quarter wave of MgF₂; the broadband recipe (the layers stand in another file), with a note; those of mirrors and of other names: left out, with a note |
//! | curved image surface | taken for plane, with a note |
//! | ENVD other than 20 °C and 1 atm, where indices follow it | left out, with a note |
//! | solves, pickups, tolerances, drawing, weights, ray aiming (`HARMLESS`, `HARMLESS_HEAD`) | ignored: rays do not change |
//! | all others | skipped, named in a note |

use super::configurations::{Configurations, MOST as MOST_CONFIGURATIONS};
use super::fields::{FieldKind, Fields};
use super::layout::{ahead, lay_out, moved_then_turned, turned_then_moved};
use super::placed::Placed;
use super::{Skipped, drop_dummies, other_pressure, other_temperature, stem};
use crate::analysis::zernike::Numbering;
use crate::aperture::{Aperture, MOST_ARMS, Outline};
use crate::coating::{Coating, DESIGN_NM, Recipe};
use crate::diffractive::Diffractive;
use crate::forbes::{Forbes, ForbesKind};
use crate::freeform::Freeform;
use crate::glass::{D_NM, Glass, GlassError, parse_foreign};
use crate::gradient::Gradient;
use crate::polynomial::{Polynomial, Terms};
use crate::prescription::{ApertureKind, Prescription, PrescriptionError, Surface};
use crate::surface::{Asphere, Profile};
use glam::{DAffine3, DVec3};
use std::collections::BTreeMap;

/// What Zemax writes as nd and Vd of a glass that it takes from a catalogue.
const PLACEHOLDER: (f64, f64) = (1.5, 40.0);

/// Plastics of no maker: what the catalogue has of them are measurements of one sample.
const PLASTICS: [&str; 3] = ["PMMA", "POLYCARB", "POLYSTYR"];

/// Keywords of surfaces that do not change its shape, place or medium.
const HARMLESS: &[&str] = &[
    "COMM", "HIDE", "MIRR", "SLAB", "POPS", "PZUP", "MAZH", "BLNK", "MEMA", "PPAR", "VPAR", "PKUP", "PARP", "DIAP", "GLCZ",
    "OPDX", "USAP", "UDAP", "FIMP", "TOL", "TOLE", "NOTE", "SDRW", "HLGT", "CONF", "MOFF", "REAY", "EFLY", "EFFL", "WRSG",
    "CLRF", "SSAM", "ELDX", "PICB", "BORD", "FACE", "CONI",
];
/// Keywords of the head that do not change the lens.
const HARMLESS_HEAD: &[&str] = &[
    "VERS", "NOTE", "PFIL", "LANG", "GFAC", "RAIM", "PUSH", "SDMA", "ROPD", "PICB", "FWGN", "VDXN", "VCXN", "VANN", "POLS",
    "GLRS", "GSTD", "NSCD", "COFN", "COFP", "FCOM", "FTYP", "WWGT", "WWGN", "ZVDX", "ZVDY", "ZVCX", "ZVAN", "ZVCY", "FWGT",
    "VCXN", "RSCE", "RWRE", "CMSG", "EFFL", "TOL", "MNUM", "MOFF", "WAVN", "SWCN", "PUPD", "PUPZ", "EYES", "GRPH", "TCMM",
    "TCED", "MCED", "MEID", "BLNK", "AUTH", "PSEQ", "NSCS", "IMAG", "ZCUS", "REAY", "EFLY", "LOPT", "ISNA",
];

/// Operands of configurations other than THIC.
const OPERANDS: &[&str] = &[
    "CRVT", "GLSS", "CONN", "PRAM", "PAR1", "PAR2", "PAR3", "PAR4", "PAR5", "PAR6", "PAR7", "PAR8", "EDVA", "APER", "WAVE",
    "WLWT", "PRWV", "STPS", "IGNR", "IGNM", "SDIA", "CSP1", "CSP2", "CHZN", "MCHI", "MCSD", "MIND", "MABB", "MDPG", "GPEX",
    "GPIN", "TEMP", "PRES", "XFIE", "YFIE", "FLWT", "FVDX", "FVDY", "FVCX", "FVCY", "FVAN", "FLTP", "FTAN", "CATN", "CBTX",
    "COTN", "AFOC", "APMN", "APMX", "APTP", "APDX", "APDY", "TELE", "RAAM", "HOLD", "LTTL", "MOFF",
];

#[derive(Default)]
struct Block {
    line: usize,
    kind: Option<String>,
    curvature: f64,
    conic: f64,
    gap: f64,
    has_gap: bool,
    infinite: bool,
    glass: Option<Glass>,
    mirror: bool,
    stop: bool,
    coating: Option<String>,
    semi_diameter: Option<f64>,
    obstruction: f64,
    clear: Option<f64>,
    /// Shape and whether it blocks, of an aperture that is no disk about the vertex.
    apertures: Vec<(Outline, bool)>,
    /// Where the middles of the apertures stand.
    aperture_center: [f64; 2],
    /// Its semi-diameter is an aperture.
    floats: bool,
    /// Its semi-diameter is set, not computed from rays.
    fixed: bool,
    parameters: BTreeMap<u32, f64>,
    extra: BTreeMap<u32, f64>,
}

impl Block {
    /// Number of a gradient surface that is read: 1, n = n₀ + nr2 r²; 2, n² = n₀ + nr2 r² to nr12 r¹²; 3, n = n₀ + nr2 r² to nr6 r⁶ + nz1 z to nz3 z³.
    fn gradient_kind(&self) -> Option<u32> {
        let number = self.kind.as_deref()?.strip_prefix("GRINSUR")?;
        number.parse().ok().filter(|n| (1..=3).contains(n))
    }

    /// The glass of a gradient surface: its index on the axis, the same at every wavelength.
    fn graded_glass(&self) -> Result<Glass, String> {
        let n0 = self.parameters.get(&2).copied().unwrap_or(0.0);
        let n0 = if self.gradient_kind() == Some(2) { n0.max(0.0).sqrt() } else { n0 };
        Glass::constant(n0).map_err(|e| e.to_string())
    }

    fn gradient(&self, scale: f64) -> Result<Option<Gradient>, String> {
        let Some(kind) = self.gradient_kind() else { return Ok(None) };
        let parameter = |i: u32| self.parameters.get(&i).copied().unwrap_or(0.0);
        let radial = match kind {
            1 => 3..=3,
            2 => 3..=8,
            _ => 3..=5,
        };
        // Coefficients of the powers 2, 4, ... and 1, 2, ... of a length.
        let radial = radial.map(|i| parameter(i) / scale.powi(2 * (i as i32 - 2))).collect();
        let axial = if kind == 3 { (6..=8).map(|i| parameter(i) / scale.powi(i as i32 - 5)).collect() } else { vec![] };
        Gradient::new(kind == 2, radial, axial).map(Some)
    }

    fn parameter(&self, i: u32) -> f64 {
        self.parameters.get(&i).copied().unwrap_or(0.0)
    }

    /// Extra data: number of terms, normalisation radius, then the terms.
    fn series(&self, most: usize) -> Result<(f64, Vec<f64>), String> {
        let kind = self.kind.as_deref().unwrap_or("");
        let get = |i: u32| self.extra.get(&i).copied().unwrap_or(0.0);
        let count = get(1).max(0.0) as usize;
        if count > most {
            return Err(format!("{kind}: {count} terms: expected at most {most}"));
        }
        if count > 0 && !(get(2) > 0.0) {
            return Err(format!("{kind}: normalisation radius {}: expected a positive length", get(2)));
        }
        let norm = if count > 0 { get(2) } else { 1.0 };
        Ok((norm, (1..=count).map(|i| get(2 + i as u32)).collect()))
    }

    /// Phase in radians: XDAT 1 terms over the radius XDAT 2, of the order PARM 0 (without one 1).
    fn diffractive(&self, scale: f64) -> Result<Option<Diffractive>, String> {
        let kind = self.kind.as_deref().unwrap_or("");
        let (order, phase) = match kind {
            "BINARY_1" | "BINARY_2" => {
                let (norm, values) = self.series(if kind == "BINARY_1" { 230 } else { 24 })?;
                let terms = match kind {
                    "BINARY_1" => Terms { xy: xy_terms(&values), ..Terms::default() },
                    _ => Terms { radial: values, ..Terms::default() },
                };
                (self.parameters.get(&0).copied().unwrap_or(1.0), Polynomial::new(norm * scale, terms)?)
            }
            // Lines a micrometre.
            "DGRATING" => (self.parameter(2), crate::prescription::grating(-1000.0 * self.parameter(1), 0.0)?),
            _ => return Ok(None),
        };
        if order.fract() != 0.0 || order.abs() > f64::from(crate::diffractive::HIGHEST_ORDER) {
            return Err(format!("{kind}: diffraction order {order}: expected a whole number"));
        }
        Diffractive::new(order as i32, phase, None).map(Some)
    }

    fn ideal_focal_length(&self) -> Option<f64> {
        (self.kind.as_deref() == Some("PARAXIAL")).then(|| self.parameters.get(&1).copied().unwrap_or(0.0))
    }

    /// What an image surface, the last of every file, has not.
    fn is_no_image(&self) -> Option<&'static str> {
        match self {
            b if b.gap != 0.0 => Some("has a gap behind it (DISZ)"),
            b if !b.has_gap && (b.curvature != 0.0 || b.glass.is_some() || b.mirror || b.stop) => Some("has no DISZ"),
            _ => None,
        }
    }

    fn is_break(&self) -> bool {
        self.kind.as_deref() == Some("COORDBRK")
    }

    /// Apertures that are no disks about the vertex, in file units.
    fn apertures(&self) -> Result<Vec<Aperture>, String> {
        let mut shapes = self.apertures.clone();
        // Beside the vertex disks are no semi-diameters any more.
        if self.aperture_center != [0.0; 2] {
            shapes.extend((self.obstruction > 0.0).then_some((Outline::Ring([0.0, self.obstruction]), true)));
            shapes.extend(self.clear.map(|radius| (Outline::Ring([0.0, radius]), false)));
        }
        shapes.into_iter().map(|(outline, blocks)| Aperture::new(outline, blocks, self.aperture_center, 0.0)).collect()
    }
}

/// Reads a lens file; `file` is its name in errors. Fails, naming line and surface, on keywords and figures that are not read (table above) and on what
/// [`Prescription::checked`] refuses.
pub fn read(text: &str, file: &str) -> Result<Prescription, PrescriptionError> {
    let mut blocks: Vec<Block> = vec![];
    let mut p = Prescription::new(stem(file), vec![]);
    let mut scale = 1.0;
    let mut vendors: Vec<String> = vec![];
    let mut skipped = Skipped::default();
    let mut waves: BTreeMap<usize, f64> = BTreeMap::new();
    let mut waves_in_a_line: Vec<f64> = vec![];
    let (mut primary, mut field_kind) = (1usize, 0.0);
    let (mut fields, mut fields_in_x): (Vec<f64>, Vec<f64>) = (vec![], vec![]);
    // Whether FNUM is the working f-number.
    let mut is_working = false;
    let (mut vignetting, mut pupil_shift): (Vec<f64>, Vec<f64>) = (vec![], vec![]);
    let (mut field_count, mut wave_count): (Option<usize>, Option<usize>) = (None, None);
    let mut weights: BTreeMap<usize, f64> = BTreeMap::new();
    let mut notes: Vec<String> = vec![];
    let mut configurations = Configurations::default();
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
            if rest.first().is_some_and(|n| n.parse() != Ok(blocks.len())) {
                return Err(wrong(format!("SURF {}: expected SURF {}, in their order", rest[0], blocks.len())));
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
                "FNUM" => {
                    p.usage.aperture = Some(ApertureKind::FNumber(value(0)?));
                    is_working = rest.get(1) == Some(&"1");
                }
                "OBNA" if rest.get(1) == Some(&"1") => {
                    let degrees = value(0)?;
                    if !(degrees > 0.0 && degrees < 90.0) {
                        return Err(wrong(format!(
                            "OBNA {degrees} 1: expected the half angle of the cone of light, above 0 and below 90 degrees"
                        )));
                    }
                    p.usage.aperture = Some(ApertureKind::ObjectNa(degrees.to_radians().sin()));
                }
                "OBNA" => p.usage.aperture = Some(ApertureKind::ObjectNa(value(0)?)),
                // The stop's own size is the aperture.
                "FLOA" => {}
                "FTYP" => {
                    field_kind = value(0).unwrap_or(0.0);
                    let count = |i: usize| value(i).ok().filter(|n| *n >= 1.0).map(|n| n as usize);
                    (field_count, wave_count) = (count(2), count(3));
                }
                "YFLN" | "YFLD" => fields = numbers(),
                "XFLN" | "XFLD" => fields_in_x = numbers(),
                "VCYN" => vignetting = numbers(),
                "VDYN" => pupil_shift = numbers(),
                "VDXN" | "VCXN" | "VANN" if numbers().iter().any(|v| *v != 0.0) => {
                    notes.push(format!("vignetting factors in x and turned ones ({key}) are not taken over"));
                }
                "WAVM" => {
                    waves.insert(value(0)? as usize, value(1)?);
                    weights.insert(value(0)? as usize, value(2).unwrap_or(1.0));
                }
                "WAVL" => waves_in_a_line = (0..rest.len()).map(&value).collect::<Result<_, _>>()?,
                "PWAV" => primary = value(0)? as usize,
                // Whether indices follow temperature and pressure stands behind them.
                "ENVD" if rest.get(2) == Some(&"1") => {
                    notes.extend(other_temperature(value(0)?).into_iter().chain(other_pressure(value(1)?)))
                }
                "ENVD" => {}
                "GCAT" => vendors = rest.iter().map(|v| catalogue(v)).collect(),
                other if HARMLESS_HEAD.contains(&other) => {}
                other => skipped.add(other),
            }
            continue;
        };
        match key {
            "TYPE" => block.kind = rest.first().map(|s| (*s).to_owned()),
            "CURV" => block.curvature = value(0)?,
            "CONI" => block.conic = value(0)?,
            "DISZ" if rest.first() == Some(&"INFINITY") => (block.infinite, block.has_gap) = (true, true),
            "DISZ" => (block.gap, block.has_gap) = (value(0)?, true),
            "DIAM" => {
                block.semi_diameter = Some(value(0)?).filter(|d| *d > 0.0);
                block.fixed = rest.get(1) == Some(&"1");
            }
            "STOP" => block.stop = true,
            "COAT" => {
                block.coating =
                    rest.first().map(|name| name.to_uppercase()).filter(|name| !["NULL", "NONE"].contains(&name.as_str()))
            }
            "PARM" => {
                block.parameters.insert(value(0)? as u32, value(1)?);
            }
            "XDAT" => {
                block.extra.insert(value(0)? as u32, value(1)?);
            }
            "OBSC" => match (value(0)?, value(1)) {
                (inner, Ok(outer)) if inner > 0.0 => block.apertures.push((Outline::Ring([inner, outer]), true)),
                (_, Ok(outer)) => block.obstruction = outer,
                (radius, Err(_)) => block.obstruction = radius,
            },
            "CLAP" => {
                let (inner, outer) = (value(0)?, value(1)?);
                if outer > 0.0 {
                    (block.obstruction, block.clear) = (inner.max(0.0), Some(outer));
                }
            }
            "FLAP" => block.floats = true,
            "OBDC" => {
                block.aperture_center = [value(0)?, value(1)?];
            }
            "SCBD" => {
                if numbers().iter().any(|v| *v != 0.0) {
                    let number = surface.unwrap_or(0);
                    notes.push(format!(
                        "surface {number}: SCBD (a tilt or decentre of its own) is left out; write COORDBRK instead"
                    ));
                }
            }
            "SQAP" | "SQOB" => block.apertures.push((Outline::Rectangle([value(0)?, value(1)?]), key == "SQOB")),
            "ELAP" | "ELOB" => block.apertures.push((Outline::Ellipse([value(0)?, value(1)?]), key == "ELOB")),
            // Width and number of arms.
            "SPID" => {
                let (width, arms) = (value(0)?, value(1)?);
                if !(1.0..=f64::from(MOST_ARMS)).contains(&arms) {
                    return Err(wrong(format!("SPID {}: expected a width, then 1 to {MOST_ARMS} arms", rest.join(" "))));
                }
                block.apertures.push((Outline::Spider { arms: arms as u32, width }, true));
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
                let count = value(0)?;
                if !(0.0..=MOST_CONFIGURATIONS as f64).contains(&count) {
                    return Err(wrong(format!("MNUM {count}: expected at most {MOST_CONFIGURATIONS} configurations")));
                }
                configurations.count = count as usize;
            }
            // Surface, configuration, value.
            "THIC" if configurations.count > 1 && rest.len() >= 3 => {
                let (surface, configuration) = (value(0)? as usize, value(1)? as usize);
                let mm = if rest[2] == "INFINITY" { 1e10 } else { value(2)? * scale };
                if !(1..=configurations.count).contains(&configuration) {
                    return Err(wrong(format!(
                        "THIC {}: expected a configuration from 1 to {}",
                        rest.join(" "),
                        configurations.count
                    )));
                }
                match surface.checked_sub(1) {
                    None => configurations.object(configuration - 1, mm),
                    Some(surface) => configurations.gap(surface, configuration - 1, mm),
                }
            }
            other if configurations.count > 1 && OPERANDS.contains(&other) => {
                if let (true, [about, _, value, ..]) = (other != "MOFF", &rest[..]) {
                    configurations.other(other, about, value);
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
    if let Some(what) = blocks.last().and_then(Block::is_no_image) {
        let what = format!("the last surface {what}: expected an image surface, is the file cut short?");
        return Err(PrescriptionError::at(file, text.lines().count(), what).surface(blocks.len() - 1));
    }
    let object = &blocks[0];
    if !object.infinite && object.gap < 1e9 {
        p.usage.object_distance = Some(object.gap * scale);
    }
    let last = blocks.len() - 1;
    if waves.is_empty() {
        waves = (1..).zip(waves_in_a_line).collect();
    }
    if let Some(count) = wave_count {
        waves.retain(|number, _| *number <= count);
        weights.retain(|number, _| *number <= count);
    }
    if !waves.is_empty() && !waves.contains_key(&primary) {
        notes.push(format!("PWAV {primary}: the file has no such wavelength; the last one is the reference"));
    }
    let counted: Vec<f64> = weights.values().copied().filter(|w| *w > 0.0).collect();
    if counted.iter().any(|w| *w != counted[0]) {
        notes.push("weights of wavelengths are not taken over: all count alike".into());
    }
    // None counts where all would be left out.
    if weights.values().any(|w| *w > 0.0) {
        waves.retain(|number, _| *number == primary || weights.get(number) != Some(&0.0));
        primary = waves.keys().take_while(|number| **number <= primary).count().max(1);
    }
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
    // Rows of fields are filled up with zeros.
    let count = field_count.unwrap_or_else(|| {
        let used = |of: &[f64]| of.iter().rposition(|v| *v != 0.0).map_or(of.len().min(1), |last| last + 1);
        used(&fields).max(used(&fields_in_x))
    });
    [&mut fields, &mut fields_in_x].into_iter().for_each(|of| of.truncate(count));
    // Places in the pupil are y′ = VDY + (1 − VCY) y: what that leaves out above and below.
    let figure = |of: &[f64], i: usize| of.get(i).copied().unwrap_or(0.0);
    let cut = |i: usize| [-1.0, 1.0].map(|side| figure(&vignetting, i) + side * figure(&pupil_shift, i));
    let kind = match field_kind {
        0.0 => Some(FieldKind::Angle),
        1.0 => Some(FieldKind::ObjectHeight),
        2.0 => Some(FieldKind::ParaxialHeight),
        3.0 => Some(FieldKind::RealHeight),
        _ => None,
    };
    let cuts = (0..vignetting.len().max(pupil_shift.len())).map(cut).collect();
    let fields = kind.map(|kind| Fields::new(kind, [&fields_in_x, &fields], cuts, scale));
    if fields.is_none() {
        notes.push(format!("fields of the kind {field_kind} (FTYP) are not taken over"));
    }
    // Where each surface stands, through the coordinate breaks.
    let mut rows: Vec<Placed> = vec![];
    let mut here = DAffine3::IDENTITY;
    let mut rims = vec![];
    let breaks = blocks[1..last].iter().any(Block::is_break);
    let others = fields.filter(|fields| !fields.set_angles(&mut p, breaks));
    for (i, b) in blocks[1..last].iter().enumerate() {
        let wrong = |what: String| PrescriptionError::at(file, b.line, what).surface(i + 1);
        if b.infinite {
            return Err(wrong("an infinite gap inside the lens".into()));
        }
        let before = rows.last().map_or(Glass::air(), |r| r.surface.glass.clone());
        let (shape, medium) = match (&b.glass, b.mirror) {
            // A coordinate break bends nothing.
            _ if b.is_break() => (Profile::Plane, before),
            // Its medium stands among its parameters.
            _ if b.gradient_kind().is_some() => (profile(b, scale).map_err(wrong)?, b.graded_glass().map_err(wrong)?),
            (Some(g), _) => (profile(b, scale).map_err(wrong)?, g.clone()),
            // A mirror goes on in what was before it.
            (None, true) => (profile(b, scale).map_err(wrong)?, before),
            (None, false) => (profile(b, scale).map_err(wrong)?, Glass::air()),
        };
        if b.is_break() {
            here *= coordinate_break(b, scale);
        }
        if !b.is_break() || b.stop {
            let apertures = b.apertures().map_err(wrong)?;
            // A surface aperture stands instead of the semi-diameter.
            let limited = apertures.iter().any(|a| !a.blocks());
            let centered = b.aperture_center == [0.0; 2];
            let semi_diameter = match centered {
                _ if limited => None,
                true => b.clear.or(b.semi_diameter),
                false => b.semi_diameter,
            };
            let surface = Surface {
                line: b.line,
                semi_diameter: semi_diameter.map(|d| d * scale),
                obstruction: if centered { b.obstruction * scale } else { 0.0 },
                apertures: apertures.into_iter().map(|a| a.scaled(scale)).collect(),
                stop: b.stop,
                mirror: b.mirror && !b.is_break(),
                gradient: b.gradient(scale).map_err(wrong)?,
                ideal_focal_length: b.ideal_focal_length().map(|f| f * scale),
                diffractive: b.diffractive(scale).map_err(wrong)?,
                coating: b.coating.as_deref().filter(|_| !b.mirror).and_then(coating),
                ..Surface::new(shape, b.gap * scale, medium)
            };
            rows.push(Placed { surface, frame: here, rim: b.clear.is_some() || b.floats || (b.mirror && b.fixed) });
        }
        here *= ahead(b.gap * scale);
    }
    if breaks {
        if configurations.count > 1 {
            notes.push(format!(
                "the file has {} configurations and coordinate breaks: the configuration its surfaces stand in is read",
                configurations.count
            ));
        }
        lay_out(rows, here, &mut p).map_err(|(line, what)| PrescriptionError::at(file, line, what))?;
    } else {
        rims = rows.iter().map(|r| r.rim).collect();
        p.surfaces = rows.into_iter().map(|r| r.surface).collect();
        configurations.apply(&mut p);
    }
    note_coatings(&blocks, &mut notes);
    if blocks[last].curvature != 0.0 {
        notes.push("the image surface is curved in the file; the film is flat".into());
    }
    p.usage.aperture = p.usage.aperture.map(|a| match a {
        ApertureKind::EntrancePupil(d) => ApertureKind::EntrancePupil(d * scale),
        other => other,
    });
    p.notes.extend(notes);
    skipped.note(&mut p);
    if p.source.is_empty() {
        p.source = format!("{}, Zemax file", stem(file));
    }
    if !breaks {
        drop_dummies(&mut p, &rims);
    }
    if let Some(fields) = others {
        fields.set_others(&mut p);
    }
    p.clip_given_rims();
    if let Some(ApertureKind::FNumber(n)) = p.usage.aperture.filter(|_| is_working) {
        super::set_image_cone(&mut p, 0.5 / n, n);
    }
    p.checked(file)
}

/// What our catalogue calls a catalogue of Zemax.
fn catalogue(name: &str) -> String {
    match name.to_lowercase().as_str() {
        "infrared" | "misc" | "birefringent" => "material".into(),
        other => other.into(),
    }
}

/// What stands for a coating by its name in Zemax's own file of coatings, upper case.
fn coating(name: &str) -> Option<Coating> {
    match name {
        "AR" | "MGF2" => Some(Coating::MagnesiumFluoride),
        "HEAR1" | "HEAR2" => Some(Coating::Recipe(Recipe::ThreeLayer, DESIGN_NM)),
        _ => None,
    }
}

/// Says what the coatings of a file are taken for, and which are left out.
fn note_coatings(blocks: &[Block], notes: &mut Vec<String>) {
    let mut left_out: Vec<String> = vec![];
    for b in blocks {
        let Some(name) = &b.coating else { continue };
        let found = coating(name).filter(|_| !b.mirror);
        let note = found.map(|found| format!("coating {name} is taken for {}", found.describe()));
        let list = if note.is_some() { &mut *notes } else { &mut left_out };
        let entry = note.unwrap_or_else(|| if b.mirror { format!("{name} of a mirror") } else { name.clone() });
        if !list.contains(&entry) {
            list.push(entry);
        }
    }
    if !left_out.is_empty() {
        notes.push(format!("coatings whose layers are not in the file are left out: {}", left_out.join(", ")));
    }
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
        // An Abbe number of 0 is Zemax's way to say that there is no dispersion.
        if model && vd == 0.0 {
            return Glass::constant(nd).map_err(|e| e.to_string());
        }
        return figures();
    }
    match parse_foreign(name, vendors) {
        Ok((found, note)) => {
            let (n_found, v_found) = (found.index(D_NM), found.abbe());
            let differs = stated && ((n_found - nd).abs() > 1e-3 || (v_found - vd).abs() > 0.5);
            match note {
                // Sold by many makers under one name: the file's figures are those of its own.
                None if differs && PLASTICS.contains(&found.name.as_str()) => {
                    notes.push(format!(
                        "glass \"{name}\": the file's nd {nd}, Vd {vd} are used; those of {} are {n_found:.5}, {v_found:.2}",
                        found.written()
                    ));
                    return figures();
                }
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

/// x, y, x², xy, y², x³, x²y, ... (Zemax "Extended Polynomial"; CODE V XYP).
pub(super) fn xy_terms(values: &[f64]) -> BTreeMap<(usize, usize), f64> {
    let powers = (1..).flat_map(|degree| (0..=degree).map(move |y| (degree - y, y)));
    powers.zip(values.iter().copied()).filter(|t| t.1 != 0.0).collect()
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
        "STANDARD" | "DGRATING" | "GRINSUR1" | "GRINSUR2" | "GRINSUR3" => asphere(vec![]),
        "PARAXIAL" => Profile::Plane,
        "EVENASPH" | "BINARY_1" | "BINARY_2" => asphere((1..=8).map(|i| (2 * i as usize, parameter(i))).collect()),
        "ODDASPHE" => asphere((1..=8).map(|i| (i as usize, parameter(i))).collect()),
        "FRESNELS" => match asphere((1..=8).map(|i| (2 * i as usize, parameter(i))).collect()) {
            Profile::Plane => Profile::Plane,
            slopes => Profile::Fresnel(crate::prescription::asphere_of(&slopes).ok_or("FRESNELS: no such slopes")?),
        },
        kind @ ("SZERNSAG" | "FZERNSAG" | "XPOLYNOM") => {
            let is_zernike = kind != "XPOLYNOM";
            if is_zernike && (parameter(9) != 0.0 || parameter(10) != 0.0) {
                return Err(format!("{kind}: a Zernike decentre of {}, {}: expected 0", parameter(9), parameter(10)));
            }
            let numbering = if kind == "SZERNSAG" { Numbering::Noll } else { Numbering::Fringe };
            let (norm, values) = b.series(if is_zernike { numbering.largest() } else { 230 })?;
            let values: Vec<f64> = values.iter().map(|v| v * scale).collect();
            let terms = match kind {
                "SZERNSAG" => Terms { noll: values, ..Terms::default() },
                "FZERNSAG" => Terms { fringe: values, ..Terms::default() },
                _ => Terms { xy: xy_terms(&values), ..Terms::default() },
            };
            let base = match is_zernike {
                true => asphere((1..=8).map(|i| (2 * i as usize, parameter(i))).collect()),
                false => asphere(vec![]),
            };
            let base = crate::prescription::asphere_of(&base).ok_or("no such base")?;
            Profile::Freeform(Box::new(Freeform { base, departure: Polynomial::new(norm * scale, terms)? }))
        }
        // Kind (0 mild, 1 strong), number of terms, normalisation radius, then the terms.
        "QED_TYPE" => {
            let get = |i: u32| b.extra.get(&i).copied().unwrap_or(0.0);
            let kind = match get(1) {
                0.0 => ForbesKind::BestFitSphere,
                1.0 => ForbesKind::Conic,
                other => return Err(format!("QED_TYPE: kind {other}: expected 0 (Q-bfs) or 1 (Q-con)")),
            };
            let count = get(2).max(0.0) as u32;
            if count > 64 {
                return Err(format!("QED_TYPE: {count} terms: expected at most 64"));
            }
            let terms = (0..count).map(|i| get(4 + i) * scale).collect();
            Profile::Forbes(Forbes::new(kind, c, b.conic, get(3) * scale, terms)?)
        }
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
        k if k.contains("PARAX") => "an ideal lens of two focal lengths is not read, only PARAXIAL",
        k if k.contains("GRAT") || k.contains("ELLIPGR") => "of gratings DGRATING is read",
        k if k.starts_with("BINARY") || k.contains("HOLO") || k.ends_with("PHA") => {
            "of diffractive surfaces BINARY_1 and BINARY_2 are read"
        }
        k if k.starts_with("GRIN") || k == "GRADIUM" => "of gradient-index media GRINSUR1, GRINSUR2 and GRINSUR3 are read",
        k if k.starts_with("NONSEQ") => "only sequential lenses are read",
        _ => "this shape is not known",
    };
    format!(
        "surface type {kind}: {why}; expected STANDARD, EVENASPH, ODDASPHE, XASPHERE, TOROIDAL, BICONICX, SZERNSAG, FZERNSAG, XPOLYNOM, QED_TYPE, FRESNELS, BINARY_1, BINARY_2, DGRATING, PARAXIAL, GRINSUR1 to 3 or COORDBRK"
    )
}
