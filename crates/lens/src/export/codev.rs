//! CODE V sequence files (.seq): the commands that [`crate::import`] reads. Radii, or where one of them does not give back
//! its curvature to the last digit, curvatures (RDM N, which not every program that reads such files understands).

use super::{
    Only, Opening, Sheet, Stance, apertures, ascii, model_figures, only, replaces_rim, same_index, terms, unknown_profile,
};
use crate::aperture::Outline;
use crate::diffractive::Diffractive;
use crate::glass::{C_NM, D_NM, F_NM, G_NM, Glass, GlassKind, parse_foreign};
use crate::prescription::{ApertureKind, PrescriptionError, Surface};
use crate::surface::Profile;
use std::fmt::Write;

/// Commands of the coefficients of r⁴, r⁶, ... r²⁰.
const TERMS: [&str; 9] = ["A", "B", "C", "D", "E", "F", "G", "H", "J"];

/// The radius (0 for a plane) whose reciprocal is a curvature to the last bit, if there is one.
fn exact_radius(c: f64) -> Option<f64> {
    let r = if c == 0.0 { return Some(0.0) } else { 1.0 / c };
    [r, r.next_up(), r.next_down()].into_iter().find(|r| 1.0 / r == c)
}

/// The file and its notes.
pub(super) fn write(sheet: &Sheet) -> Result<(String, Vec<String>), PrescriptionError> {
    let p = sheet.p;
    let curvature_of = |s: &Surface| shape(&s.profile).map_or(0.0, |(c, _)| c);
    let radii: Option<Vec<f64>> = p.surfaces.iter().map(|s| exact_radius(curvature_of(s))).collect();
    let mut t = format!("{}\nLEN NEW\n", if radii.is_some() { "RDM" } else { "RDM N" });
    let _ = writeln!(t, "TITLE '{}'\nDIM M", ascii(&p.name));
    let _ = match sheet.opening() {
        Opening::Stated(ApertureKind::EntrancePupil(d)) => writeln!(t, "EPD {d}"),
        // CODE V's FNO is that of the beam which is used.
        Opening::Stated(ApertureKind::FNumber(n)) if p.usage.object_distance.is_some() => {
            writeln!(t, "EPD {}", sheet.entrance_pupil(Some(n)))
        }
        Opening::Stated(ApertureKind::FNumber(n)) => writeln!(t, "FNO {n}"),
        Opening::Stated(ApertureKind::ObjectNa(na)) => writeln!(t, "NAO {na}"),
        Opening::Stop => writeln!(t, "EPD {}", sheet.entrance_pupil(None)),
    };
    let each = |v: &mut dyn Iterator<Item = f64>| v.map(|v| format!(" {v}")).collect::<String>();
    let _ = writeln!(t, "WL{}\nREF {}", each(&mut sheet.wavelengths_nm.iter().copied()), sheet.reference + 1);
    let _ = writeln!(t, "YAN{}", each(&mut sheet.fields_deg().into_iter()));
    if p.usage.vignetting.iter().flatten().any(|v| *v != 0.0) {
        let _ = writeln!(t, "VUY{}", each(&mut p.usage.vignetting.iter().map(|v| v[0])));
        let _ = writeln!(t, "VLY{}", each(&mut p.usage.vignetting.iter().map(|v| v[1])));
    }
    // Glasses first: those that no name or pair of figures holds are private ones.
    let mut private: Vec<(Glass, String)> = vec![];
    let mut names = vec![];
    for (i, s) in p.surfaces.iter().enumerate() {
        sheet.check_medium(i)?;
        names.push(if s.mirror { "REFL".to_owned() } else { glass(&s.glass, &mut private).map_err(|w| sheet.wrong(i, w))? });
    }
    if !private.is_empty() {
        let _ = writeln!(t, "PRV\nPWL {D_NM} {C_NM} {F_NM} {G_NM}");
        for (glass, name) in &private {
            let indices = match glass.kind {
                GlassKind::Constant(n) => n.to_string(),
                _ => [D_NM, C_NM, F_NM, G_NM].map(|nm| glass.index(nm).to_string()).join(" "),
            };
            let _ = writeln!(t, "'{name}' {indices}");
        }
        t += "END\n";
    }
    let _ = writeln!(t, "SO 0 {}", p.usage.object_distance.unwrap_or(1e13));
    if let Some(stance) = &sheet.from_object {
        t += "S 0 0\n";
        t += &decenter(stance);
    }
    for (i, s) in p.surfaces.iter().enumerate() {
        let wrong = |what: String| sheet.wrong(i, what);
        if s.ideal_focal_length.is_some() {
            return Err(wrong("ideal lenses are not written for CODE V".into()));
        }
        let (c, commands) = shape(&s.profile).map_err(wrong)?;
        let row = format!("S {} {} {}", radii.as_ref().map_or(c, |r| r[i]), sheet.gaps[i], names[i]);
        let _ = writeln!(t, "{}", row.trim_end());
        for command in commands {
            let _ = writeln!(t, "  {command}");
        }
        if let Some(d) = &s.diffractive {
            phase(d, sheet.wavelengths_nm[sheet.reference]).map_err(wrong)?.iter().for_each(|command| {
                let _ = writeln!(t, "  {command}");
            });
        }
        if s.stop {
            t += "  STO\n";
        }
        t += &rims(s).map_err(wrong)?;
        if let Some(stance) = &sheet.stances[i] {
            // The next surface stands on the axis again.
            let _ = writeln!(t, "{}  DAR", decenter(stance));
        }
    }
    let _ = writeln!(t, "SI 0 {}\nGO", p.usage.defocus);
    Ok((t, vec![]))
}

/// Where a surface stands, and what follows it. Angles about x and y follow the left hand.
fn decenter(Stance { decenter: [x, y, z], tilt: [a, b, c] }: &Stance) -> String {
    format!("  XDE {x}; YDE {y}; ZDE {z}\n  ADE {}; BDE {}; CDE {c}\n", -a, -b)
}

/// Curvature in y, and the commands of the rest of a shape.
fn shape(profile: &Profile) -> Result<(f64, Vec<String>), String> {
    let polynomial = |k: f64, a: &[f64], commands: &mut Vec<String>| {
        if k != 0.0 {
            commands.push(format!("K {k}"));
        }
        for (power, v) in terms(a) {
            let name = TERMS.get((power / 2).wrapping_sub(2)).filter(|_| power % 2 == 0);
            let name = name.ok_or_else(|| unknown_profile(profile, "CODE V"))?;
            commands.push(format!("{name} {v}"));
        }
        Ok::<(), String>(())
    };
    let mut commands = vec![];
    let c = match profile {
        Profile::Plane => 0.0,
        Profile::Sphere(c) => *c,
        Profile::Conic { c, k } => {
            commands.push("CON".into());
            polynomial(*k, &[], &mut commands)?;
            *c
        }
        Profile::Asphere(a) => {
            commands.push("ASP".into());
            polynomial(a.k, &a.a, &mut commands)?;
            a.c
        }
        Profile::Toroid { y, c_x } => {
            commands.push("YTO".into());
            commands.push(format!("CUX {c_x}"));
            polynomial(y.k, &y.a, &mut commands)?;
            y.c
        }
        Profile::Biconic { c_x, k_x, c_y, k_y } => {
            commands.extend(["AAS".into(), format!("CUX {c_x}"), format!("K {k_y}"), format!("KX {k_x}")]);
            *c_y
        }
        Profile::Freeform(f) => {
            let refused = || Err(unknown_profile(profile, "CODE V"));
            if f.base.a.iter().any(|v| *v != 0.0) {
                return refused();
            }
            let (name, first, values) = match only(&f.departure) {
                Some(Only::Xy(v)) if v.len() <= 65 => ("XYP", 2, v),
                Some(Only::Fringe(v)) => ("ZFR", 4, v.to_vec()),
                _ => return refused(),
            };
            commands.extend([
                format!("SPS {name}"),
                format!("SCO K {}", f.base.k),
                format!("SCO NRADIUS {}", f.departure.norm_mm()),
            ]);
            commands.extend(values.iter().enumerate().filter(|t| *t.1 != 0.0).map(|(i, v)| format!("SCO C{} {v}", first + i)));
            f.base.c
        }
        Profile::Forbes(_) | Profile::Fresnel(_) => return Err(unknown_profile(profile, "CODE V")),
    };
    Ok((c, commands))
}

/// Commands of a phase, whose path is written at a wavelength (nm).
fn phase(d: &Diffractive, nm: f64) -> Result<Vec<String>, String> {
    let Some(Only::Radial(radial)) = only(d.phase()) else {
        return Err("a phase that is not radial: it is not written for CODE V".into());
    };
    let mut commands = vec!["DIF DOE".to_owned(), format!("HOR {}", d.order()), format!("HWL {nm}; HCT R")];
    let path = |i: usize, v: f64| v * nm * 1e-6 / (std::f64::consts::TAU * d.phase().norm_mm().powi(2 * (i as i32 + 1)));
    commands.extend(radial.iter().enumerate().map(|(i, v)| format!("HCO C{} {}", i + 1, path(i, *v))));
    Ok(commands)
}

/// Semi-diameter and apertures.
fn rims(s: &Surface) -> Result<String, String> {
    let mut t = String::new();
    let [opening, obscuration] = apertures(s)?;
    let semi_diameter = s.semi_diameter.unwrap_or(0.0);
    match opening {
        None => {
            let _ = writeln!(t, "  CIR {semi_diameter}");
        }
        Some(a) if !replaces_rim(&a, s) => return Err("an aperture beside the rim: a CODE V surface has one opening".into()),
        Some(_) => {}
    }
    if s.obstruction > 0.0 {
        let _ = writeln!(t, "  CIR OBS {}", s.obstruction);
        if obscuration.is_some() {
            return Err("two obscurations: a CODE V surface has one".into());
        }
    }
    for a in [opening, obscuration].into_iter().flatten() {
        let of = if a.blocks() { " OBS" } else { "" };
        let _ = match a.outline() {
            Outline::Rectangle([x, y]) => writeln!(t, "  REX{of} {x}; REY{of} {y}"),
            Outline::Ellipse([x, y]) => writeln!(t, "  ELX{of} {x}; ELY{of} {y}"),
            Outline::Ring([0.0, radius]) => writeln!(t, "  CIR{of} {radius}"),
            Outline::Ring(_) | Outline::Spider { .. } => {
                return Err("rings and spiders are not written for CODE V".into());
            }
        };
        let [x, y] = a.center();
        if [x, y] != [0.0; 2] {
            let _ = writeln!(t, "  ADX{of} {x}; ADY{of} {y}");
        }
    }
    Ok(t)
}

/// Name of a glass on a surface line; what no name says becomes a private glass.
fn glass(glass: &Glass, private: &mut Vec<(Glass, String)>) -> Result<String, String> {
    match &glass.kind {
        // Without a name it is air.
        GlassKind::Air => return Ok(String::new()),
        GlassKind::Catalogue { vendor, .. } => {
            let name = format!("{}_{}", glass.name, vendor).to_uppercase();
            let found = parse_foreign(&name, &[]).is_ok_and(|(found, _)| same_index(&found, glass));
            return match found && !name.contains(char::is_whitespace) {
                true => Ok(name),
                false => Err(format!("glass \"{}\": CODE V files have no name for it", glass.written())),
            };
        }
        GlassKind::Model { nd, vd, .. } => {
            let plain = model_figures(glass).is_some_and(|f| f[2] == 0.0)
                && Glass::model(*nd, *vd, 0.0).is_ok_and(|near| same_index(&near, glass));
            // Both sides of the colon need a point to be figures and not codes.
            if plain {
                return Ok(format!("{nd:?}:{vd:?}"));
            }
        }
        GlassKind::Constant(_) => {}
    }
    let known = private.iter().find(|(g, _)| same_index(g, glass)).map(|(_, name)| name.clone());
    Ok(known.unwrap_or_else(|| {
        let name = format!("GLASS{}", private.len() + 1);
        private.push((glass.clone(), name.clone()));
        name
    }))
}
