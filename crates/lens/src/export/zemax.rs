//! Zemax OpticStudio files (.zmx): the keywords that [`crate::import`] reads.
//!
//! Decentred and tilted surfaces stand between two coordinate breaks, the second of which undoes the first. Every rim is a circular
//! aperture (CLAP), since DIAM alone stops no light in that program.

use super::{
    Only, Opening, Sheet, Stance, apertures, ascii, model_figures, only, replaces_rim, same_index, terms, unknown_profile,
};
use crate::aperture::Outline;
use crate::diffractive::Diffractive;
use crate::glass::{Glass, GlassKind, parse_foreign};
use crate::prescription::{ApertureKind, PrescriptionError, Surface};
use crate::surface::Profile;
use std::fmt::Write;

/// Largest error of an index over the visible spectrum that is not worth a note.
const INDEX_ROUNDING: f64 = 1e-7;

type Params = Vec<(usize, f64)>;

/// The file and its notes.
pub(super) fn write(sheet: &Sheet) -> Result<(String, Vec<String>), PrescriptionError> {
    let p = sheet.p;
    let mut t = String::from("VERS 140124 258 36214\nMODE SEQ\n");
    let mut notes = vec![];
    let _ = writeln!(t, "NAME {}\nUNIT MM X W X CM MR CPMM", ascii(&p.name));
    let _ = match sheet.opening() {
        Opening::Stated(ApertureKind::EntrancePupil(d)) => writeln!(t, "ENPD {d}"),
        Opening::Stated(ApertureKind::FNumber(n)) => writeln!(t, "FNUM {n} 0"),
        Opening::Stated(ApertureKind::ObjectNa(na)) => writeln!(t, "OBNA {na} 0"),
        // Float by stop size: the DIAM of the stop.
        Opening::Stop => writeln!(t, "FLOA"),
    };
    let vendors = vendors(sheet);
    if !vendors.is_empty() {
        let _ = writeln!(t, "GCAT {}", vendors.join(" ").to_uppercase());
    }
    let fields = sheet.fields_deg();
    let each = |v: &mut dyn Iterator<Item = f64>| v.map(|v| format!(" {v}")).collect::<String>();
    let _ = writeln!(t, "FTYP 0 0 {} {} 0 0 0", fields.len(), sheet.wavelengths_nm.len());
    let _ = writeln!(t, "XFLN{}", each(&mut fields.iter().map(|_| 0.0)));
    let _ = writeln!(t, "YFLN{}", each(&mut fields.iter().copied()));
    // How far the pupil is moved and compressed: y′ = VDY + (1 − VCY) y.
    let vignetting = &p.usage.vignetting;
    if vignetting.iter().flatten().any(|v| *v != 0.0) {
        let _ = writeln!(t, "VDYN{}", each(&mut vignetting.iter().map(|[up, low]| 0.5 * (low - up))));
        let _ = writeln!(t, "VCYN{}", each(&mut vignetting.iter().map(|[up, low]| 0.5 * (low + up))));
    }
    for (i, nm) in sheet.wavelengths_nm.iter().enumerate() {
        let _ = writeln!(t, "WAVM {} {} 1", i + 1, nm / 1000.0);
    }
    let _ = writeln!(t, "PWAV {}", sheet.reference + 1);
    let mut number = 0;
    let mut block = |t: &mut String, lines: &str, gap: &str| {
        let _ = writeln!(t, "SURF {number}\n{lines}  DISZ {gap}");
        number += 1;
    };
    let object = p.usage.object_distance.map_or("INFINITY".to_owned(), |d| d.to_string());
    block(&mut t, "  TYPE STANDARD\n  CURV 0\n", &object);
    if let Some(Stance { decenter: [x, y, z], tilt: [a, b, c] }) = sheet.from_object {
        block(&mut t, "  TYPE COORDBRK\n  CURV 0\n", &z.to_string());
        block(&mut t, &coordinate_break([x, y, a, b, c], 0), "0");
    }
    for (i, s) in p.surfaces.iter().enumerate() {
        sheet.check_medium(i)?;
        let wrong = |what: String| sheet.wrong(i, what);
        let mut lines = String::new();
        let (kind, c, k, parameters, extra) = shape(&s.profile).map_err(wrong)?;
        let (kind, parameters, extra) = match &s.diffractive {
            Some(d) => phase(d, kind, parameters).map_err(wrong)?,
            None => (kind, parameters, extra),
        };
        // An ideal lens is a plane of another type.
        let (kind, parameters) = match s.ideal_focal_length {
            Some(focal) => ("PARAXIAL", vec![(1, focal)]),
            None => (kind, parameters),
        };
        if s.stop {
            lines += "  STOP\n";
        }
        let _ = writeln!(lines, "  TYPE {kind}\n  CURV {c}");
        if k != 0.0 {
            let _ = writeln!(lines, "  CONI {k}");
        }
        for (key, values) in [("PARM", parameters), ("XDAT", extra)] {
            for (i, v) in values {
                let tail = if key == "XDAT" { " 0 0" } else { "" };
                let _ = writeln!(lines, "  {key} {i} {v}{tail}");
            }
        }
        if s.mirror {
            lines += "  GLAS MIRROR 0 0 1.5 40 0 0 0\n";
        } else if s.glass.kind != GlassKind::Air {
            let (written, note) = glass(&s.glass, &vendors).map_err(wrong)?;
            let _ = writeln!(lines, "  GLAS {written}");
            notes.extend(note.map(|n| format!("surface {}: {n}", i + 1)));
        }
        lines += &rims(s).map_err(wrong)?;
        let mut gap = sheet.gaps[i];
        if i + 1 == p.surfaces.len() {
            gap += p.usage.defocus;
        }
        match &sheet.stances[i] {
            None => block(&mut t, &lines, &gap.to_string()),
            Some(stance) => {
                let Stance { decenter: [x, y, z], tilt: [a, b, c] } = *stance;
                let turn = |sign: f64, order: u32| coordinate_break([x, y, a, b, c].map(|v| v * sign), order);
                // Along the axis first, then aside and around; back in the other order.
                block(&mut t, "  TYPE COORDBRK\n  CURV 0\n", &z.to_string());
                block(&mut t, &turn(1.0, 0), "0");
                block(&mut t, &lines, "0");
                block(&mut t, &turn(-1.0, 1), &(gap - z).to_string());
            }
        }
    }
    block(&mut t, "  TYPE STANDARD\n  CURV 0\n", "0");
    Ok((t, notes))
}

/// A coordinate break: shifts in x and y (mm), turns about x, y and z (degrees), and whether the turns come first.
fn coordinate_break(values: [f64; 5], order: u32) -> String {
    let mut lines = String::from("  TYPE COORDBRK\n  CURV 0\n");
    for (i, v) in values.iter().enumerate() {
        let _ = writeln!(lines, "  PARM {} {v}", i + 1);
    }
    let _ = writeln!(lines, "  PARM 6 {order}");
    lines
}

/// Catalogues of the lens's glasses.
fn vendors(sheet: &Sheet) -> Vec<String> {
    let mut all: Vec<String> = vec![];
    for s in &sheet.p.surfaces {
        if let GlassKind::Catalogue { vendor, .. } = &s.glass.kind
            && !all.contains(vendor)
        {
            all.push(vendor.clone());
        }
    }
    all
}

/// Type, curvature, conic constant, PARM and XDAT values.
fn shape(profile: &Profile) -> Result<(&'static str, f64, f64, Params, Params), String> {
    let refused = || Err(unknown_profile(profile, "Zemax"));
    let radius = |c: f64| if c == 0.0 { 0.0 } else { 1.0 / c };
    Ok(match profile {
        Profile::Plane => ("STANDARD", 0.0, 0.0, vec![], vec![]),
        Profile::Sphere(c) => ("STANDARD", *c, 0.0, vec![], vec![]),
        Profile::Conic { c, k } => ("STANDARD", *c, *k, vec![], vec![]),
        Profile::Asphere(a) => {
            let terms = terms(&a.a);
            let highest = terms.last().map_or(0, |t| t.0);
            let is_even = terms.iter().all(|t| t.0 % 2 == 0);
            match (is_even, highest) {
                (true, ..=16) => ("EVENASPH", a.c, a.k, terms.iter().map(|(power, v)| (power / 2, *v)).collect(), vec![]),
                (_, ..=8) => ("ODDASPHE", a.c, a.k, terms, vec![]),
                // Terms of (r / 1 mm)²ⁱ.
                (true, ..=40) => {
                    let mut extra = vec![(1, (highest / 2) as f64), (2, 1.0)];
                    extra.extend(terms.iter().map(|(power, v)| (2 + power / 2, *v)));
                    ("XASPHERE", a.c, a.k, vec![], extra)
                }
                _ => return refused(),
            }
        }
        Profile::Toroid { y, c_x } => {
            let terms = terms(&y.a);
            if terms.iter().any(|(power, _)| power % 2 == 1 || *power > 14) {
                return refused();
            }
            let mut parameters = vec![(1, radius(*c_x))];
            parameters.extend(terms.iter().map(|(power, v)| (power / 2 + 1, *v)));
            ("TOROIDAL", y.c, y.k, parameters, vec![])
        }
        Profile::Biconic { c_x, k_x, c_y, k_y } => ("BICONICX", *c_y, *k_y, vec![(1, radius(*c_x)), (2, *k_x)], vec![]),
        Profile::Fresnel(a) => match even(&a.a) {
            Some(parameters) => ("FRESNELS", a.c, a.k, parameters, vec![]),
            None => return refused(),
        },
        Profile::Freeform(f) => {
            let (base, norm) = (&f.base, f.departure.norm_mm());
            let Some(parameters) = even(&base.a) else { return refused() };
            match only(&f.departure) {
                Some(Only::Noll(v)) => ("SZERNSAG", base.c, base.k, parameters, extra(norm, v)),
                Some(Only::Fringe(v)) => ("FZERNSAG", base.c, base.k, parameters, extra(norm, v)),
                Some(Only::Xy(v)) if parameters.is_empty() => ("XPOLYNOM", base.c, base.k, vec![], extra(norm, &v)),
                _ => return refused(),
            }
        }
        Profile::Forbes(q) => {
            let kind = if q.kind() == crate::forbes::ForbesKind::Conic { 1.0 } else { 0.0 };
            let mut values = vec![(1, kind), (2, q.terms().len() as f64), (3, q.norm_mm())];
            values.extend(q.terms().iter().enumerate().map(|(i, v)| (4 + i, *v)));
            ("QED_TYPE", q.c(), q.k(), vec![], values)
        }
    })
}

/// Parameters of even powers up to 16; `None` where there are others.
fn even(a: &[f64]) -> Option<Params> {
    let terms = terms(a);
    let fits = terms.iter().all(|(power, _)| power % 2 == 0 && *power <= 16);
    fits.then(|| terms.iter().map(|(power, v)| (power / 2, *v)).collect())
}

/// Extra data: number of terms, normalisation radius, terms.
fn extra(norm: f64, values: &[f64]) -> Params {
    let head = [(1, values.len() as f64), (2, norm)];
    head.into_iter().chain(values.iter().enumerate().map(|(i, v)| (3 + i, *v))).collect()
}

/// Type, parameters and extra data of a phase on a surface of a type with parameters.
fn phase(d: &Diffractive, kind: &'static str, parameters: Params) -> Result<(&'static str, Params, Params), String> {
    if !matches!(kind, "STANDARD" | "EVENASPH") {
        return Err(format!("a phase on a surface of type {kind}: Zemax has none"));
    }
    let order = (0, f64::from(d.order()));
    let with_order = || [order].into_iter().chain(parameters.iter().copied()).collect();
    let norm = d.phase().norm_mm();
    match only(d.phase()) {
        Some(Only::Radial(v)) => Ok(("BINARY_2", with_order(), extra(norm, v))),
        // Lines along x, on a conic.
        Some(Only::Xy(v)) if kind == "STANDARD" && v.len() == 2 && v[0] == 0.0 => {
            let lines = -v[1] / (std::f64::consts::TAU * norm * 1000.0);
            Ok(("DGRATING", vec![(1, lines), (2, order.1)], vec![]))
        }
        Some(Only::Xy(v)) => Ok(("BINARY_1", with_order(), extra(norm, &v))),
        _ => Err("a phase of Zernike or mixed terms: Zemax has none that is written".into()),
    }
}

/// Semi-diameter and apertures.
fn rims(s: &Surface) -> Result<String, String> {
    let mut t = String::new();
    let [opening, obscuration] = apertures(s)?;
    let semi_diameter = s.semi_diameter.unwrap_or(0.0);
    let _ = writeln!(t, "  DIAM {semi_diameter} 1 0 0 1");
    let aperture = match (opening, obscuration) {
        (None, None) => {
            let _ = writeln!(t, "  CLAP {} {semi_diameter} 0", s.obstruction);
            return Ok(t);
        }
        (Some(a), None) if s.obstruction == 0.0 && replaces_rim(&a, s) => a,
        // DIAM stays the rim.
        (None, Some(a)) if s.obstruction == 0.0 => a,
        _ => return Err("an aperture beside another limit of the light: a Zemax surface has one".into()),
    };
    let blocks = aperture.blocks();
    let _ = match aperture.outline() {
        Outline::Rectangle([x, y]) => writeln!(t, "  {} {x} {y}", if blocks { "SQOB" } else { "SQAP" }),
        Outline::Ellipse([x, y]) => writeln!(t, "  {} {x} {y}", if blocks { "ELOB" } else { "ELAP" }),
        Outline::Ring([inner, outer]) => writeln!(t, "  {} {inner} {outer} 0", if blocks { "OBSC" } else { "CLAP" }),
        Outline::Spider { arms, width } => writeln!(t, "  SPID {width} {arms}"),
    };
    if aperture.center() != [0.0; 2] {
        let [x, y] = aperture.center();
        let _ = writeln!(t, "  OBDC {x} {y}");
    }
    Ok(t)
}

/// What follows GLAS, and what it holds only nearly.
fn glass(glass: &Glass, vendors: &[String]) -> Result<(String, Option<String>), String> {
    match &glass.kind {
        GlassKind::Air => Ok(("___BLANK 1 0 1 0 0 0 0".into(), None)),
        // No Abbe number: no dispersion.
        GlassKind::Constant(n) => Ok((format!("___BLANK 1 0 {n} 0 0 0 0"), None)),
        GlassKind::Catalogue { .. } => {
            let preferred: Vec<&str> = vendors.iter().map(String::as_str).collect();
            match parse_foreign(&glass.name, &preferred) {
                Ok((found, None)) if same_index(&found, glass) && !glass.name.contains(char::is_whitespace) => {
                    Ok((format!("{} 0 0 {} {} 0 0 0", glass.name, glass.index(crate::glass::D_NM), glass.abbe()), None))
                }
                _ => Err(format!("glass \"{}\": its name alone means another glass in a Zemax file", glass.written())),
            }
        }
        GlassKind::Model { .. } => {
            let [nd, vd, off] = model_figures(glass).unwrap_or_default();
            let near = Glass::model(nd, vd, off).map_err(|e| e.to_string())?;
            let error = |nm: f64| (near.index(nm) - glass.index(nm)).abs();
            let most = (0..=40).map(|i| error(380.0 + 10.0 * i as f64)).fold(0.0, f64::max);
            let note =
                format!("nd, Vd and P_gF of its glass are written; other indices from 380 to 780 nm differ by up to {most:.1e}");
            Ok((format!("___BLANK 1 0 {nd} {vd} {off} 0 0"), (most > INDEX_ROUNDING).then_some(note)))
        }
    }
}
