//! A prescription written in its TOML form.

use crate::forbes::ForbesKind;
use crate::glare::Finish;
use crate::glass::Glass;
use crate::iris::Iris;
use crate::prescription::numbers::{list, number};
use crate::prescription::{ApertureKind, Coating, Prescription, Surface, Usage, WALL_REFLECTANCE};
use crate::prescription::{apertures, coatings, phases};
use crate::surface::Profile;
use std::fmt::Write;

impl Prescription {
    /// The lens in the TOML form; reading it back gives the same lens.
    pub fn to_toml(&self) -> String {
        let mut t = String::new();
        for note in &self.notes {
            let printable: String = note.chars().filter(|c| !c.is_control()).collect();
            let _ = writeln!(t, "# {printable}");
        }
        let text = |s: &str| toml::Value::from(s).to_string();
        let line = |t: &mut String, key: &str, value: String| {
            let _ = writeln!(t, "{key} = {value}");
        };
        line(&mut t, "name", text(&self.name));
        if let Some(p) = &self.patent {
            line(&mut t, "patent", text(p));
        }
        if !self.source.is_empty() {
            line(&mut t, "source", text(&self.source));
        }
        for (key, value) in [
            ("focal_length", self.focal_length),
            ("f_number", self.f_number),
            ("image_circle", self.image_circle),
            ("close_focus", self.close_focus),
        ] {
            if let Some(v) = value {
                line(&mut t, key, number(v));
            }
        }
        if !self.zoom.is_empty() {
            line(&mut t, "zoom", list(&self.zoom));
        }
        if let Some(year) = self.year {
            line(&mut t, "year", year.to_string());
        }
        if let Some([first, last]) = self.stabiliser {
            line(&mut t, "stabiliser", format!("[{}, {}]", first + 1, last + 1));
        }
        if self.coating != Coating::None {
            line(&mut t, "coating", coatings::written(&self.coating));
        }
        t.push_str("surfaces = [\n");
        for s in &self.surfaces {
            t.push_str(&format!("  {{ {} }},\n", surface_fields(s).join(", ")));
        }
        t.push_str("]\n");
        if let Iris::Blades(b) = &self.iris {
            let _ = writeln!(t, "\n[iris]\nblades = {}", b.count);
            let _ = writeln!(t, "rotation_deg = {}\ncurvature = {}", b.rotation.to_degrees(), b.curvature);
        }
        if self.finish != Finish::default() || self.wall_reflectance != WALL_REFLECTANCE {
            t.push_str("\n[stray]\n");
            line(&mut t, "roughness_nm", number(self.finish.roughness_nm));
            line(&mut t, "cleanliness", number(self.finish.cleanliness));
            line(&mut t, "wall_reflectance", number(self.wall_reflectance));
        }
        if let Some(hood) = &self.hood {
            t.push_str("\n[hood]\n");
            line(&mut t, "length", number(hood.length));
            hood.diameter.iter().for_each(|d| line(&mut t, "diameter", number(*d)));
        }
        for m in &self.misalignments {
            let _ = writeln!(t, "\n[[element]]\nsurfaces = [{}, {}]", m.first + 1, m.last + 1);
            let _ = writeln!(t, "decenter = {}\ntilt_deg = {}", list(&m.decenter), list(&m.tilt));
        }
        if let Some(axis) = &self.object_axis {
            let (decenter, tilt) = (list(&axis.decenter), list(&axis.tilt));
            let _ = writeln!(t, "\n[object_axis]\ndecenter = {decenter}\ntilt_deg = {tilt}");
        }
        if self.usage != Usage::default() {
            let u = &self.usage;
            t.push_str("\n[usage]\n");
            match u.aperture {
                Some(ApertureKind::EntrancePupil(d)) => line(&mut t, "entrance_pupil_diameter", number(d)),
                Some(ApertureKind::FNumber(n)) => line(&mut t, "f_number", number(n)),
                Some(ApertureKind::ObjectNa(n)) => line(&mut t, "object_na", number(n)),
                None => {}
            }
            if !u.wavelengths_nm.is_empty() {
                line(&mut t, "wavelengths_nm", list(&u.wavelengths_nm));
                line(&mut t, "reference_wavelength", (u.reference + 1).to_string());
            }
            if !u.field_angles_deg.is_empty() {
                line(&mut t, "fields_deg", list(&u.field_angles_deg));
            }
            if !u.vignetting.is_empty() {
                let each: Vec<String> = u.vignetting.iter().map(|v| list(v)).collect();
                line(&mut t, "vignetting", format!("[{}]", each.join(", ")));
            }
            if let Some(d) = u.object_distance {
                line(&mut t, "object_distance", number(d));
            }
            if u.defocus != 0.0 {
                line(&mut t, "defocus", number(u.defocus));
            }
        }
        t
    }
}

fn surface_fields(s: &Surface) -> Vec<String> {
    let mut f = vec![];
    // The shortest figure that gives the curvature back to the last bit or nearly so.
    let radius = |c: f64| {
        let short = (6..17).map(|digits| format!("{:.digits$e}", 1.0 / c)).find_map(|t| {
            let r: f64 = t.parse().ok()?;
            ((1.0 / r - c).abs() <= 2.0 * f64::EPSILON * c.abs()).then_some(r)
        });
        number(short.unwrap_or(1.0 / c))
    };
    let radius_x = radius;
    let mut shape = |c: f64, k: f64, a: &[f64]| {
        if c != 0.0 {
            f.push(format!("radius = {}", radius(c)));
        }
        if k != 0.0 {
            f.push(format!("conic = {}", number(k)));
        }
        let terms: Vec<String> =
            a.iter().enumerate().filter(|(_, v)| **v != 0.0).map(|(i, v)| format!("{i} = {}", number(*v))).collect();
        if !terms.is_empty() {
            f.push(format!("asphere = {{ {} }}", terms.join(", ")));
        }
    };
    match &s.profile {
        Profile::Plane => {}
        Profile::Sphere(c) => shape(*c, 0.0, &[]),
        Profile::Conic { c, k } => shape(*c, *k, &[]),
        Profile::Asphere(a) => shape(a.c, a.k, &a.a),
        Profile::Fresnel(a) => {
            shape(a.c, a.k, &a.a);
            f.push("fresnel = true".into());
        }
        Profile::Freeform(free) => {
            let a = &free.base;
            shape(a.c, a.k, &a.a);
            f.push(phases::departure_written(&free.departure));
        }
        Profile::Forbes(q) => {
            shape(q.c(), q.k(), &[]);
            let key = match q.kind() {
                ForbesKind::Conic => "q_con",
                ForbesKind::BestFitSphere => "q_bfs",
            };
            f.push(format!("{key} = {{ radius = {}, terms = {} }}", number(q.norm_mm()), list(q.terms())));
        }
        Profile::Toroid { y, c_x } => {
            shape(y.c, y.k, &y.a);
            f.push(format!("radius_x = {}", if *c_x == 0.0 { "inf".into() } else { radius_x(*c_x) }));
        }
        Profile::Biconic { c_x, k_x, c_y, k_y } => {
            shape(*c_y, *k_y, &[]);
            f.push(format!("radius_x = {}", if *c_x == 0.0 { "inf".into() } else { radius_x(*c_x) }));
            f.push(format!("conic_x = {}", number(*k_x)));
        }
    }
    if s.stop {
        f.push("stop = true".into());
    }
    if s.mirror {
        f.push("mirror = true".into());
    }
    f.extend(phases::diffractive_written(s));
    if let Some(focal) = s.ideal_focal_length {
        f.push(format!("ideal_focal_length = {}", number(focal)));
    }
    let row = |r: &Vec<f64>| if let [one] = r[..] { number(one) } else { list(r) };
    f.push(match &s.gap.values[..] {
        [far, near, ..] => format!("gap = {{ infinity = {}, close = {} }}", row(far), row(near)),
        [only] => format!("gap = {}", row(only)),
        [] => "gap = 0".into(),
    });
    if s.glass != Glass::air() {
        f.push(format!("glass = {}", toml::Value::from(s.glass.written())));
        if let Some(alpha) = s.glass.own_absorption() {
            f.push(format!("absorption = {}", number(alpha)));
        }
    }
    if let Some(g) = &s.gradient {
        let parts = [("radial", g.radial()), ("axial", g.axial())].into_iter().filter(|(_, v)| !v.is_empty());
        let mut parts: Vec<String> = parts.map(|(key, v)| format!("{key} = {}", list(v))).collect();
        parts.extend(g.is_squared().then(|| "squared = true".into()));
        f.push(format!("gradient = {{ {} }}", parts.join(", ")));
    }
    if let Some(sd) = s.semi_diameter {
        f.push(format!("semi_diameter = {}", number(sd)));
    }
    if s.obstruction > 0.0 {
        f.push(format!("obstruction = {}", number(s.obstruction)));
    }
    f.extend(apertures::written(s));
    if let Some(coating) = &s.coating {
        f.push(format!("coating = {}", coatings::written(coating)));
    }
    if let Some(finish) = s.finish {
        f.push(format!("roughness_nm = {}", number(finish.roughness_nm)));
        f.push(format!("cleanliness = {}", number(finish.cleanliness)));
    }
    if s.decenter != [0.0; 2] {
        f.push(format!("decenter = {}", list(&s.decenter)));
    }
    if s.tilt != [0.0; 3] {
        f.push(format!("tilt_deg = {}", list(&s.tilt)));
    }
    f
}
