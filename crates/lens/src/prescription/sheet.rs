//! The TOML form of a prescription.
//!
//! ```toml
//! name = "Triplet"
//! source = "..."
//! f_number = 4
//! surfaces = [
//!   { radius = 23.713, gap = 4.831, glass = "N-LAK9", semi_diameter = 8 },
//!   { radius = 7331.288, gap = 5.86, semi_diameter = 8 },
//!   { stop = true, gap = 1.0, semi_diameter = 5 },
//!   { radius = 30, conic = -1, asphere = { 4 = 1e-5, 6 = -2e-8 }, gap = { infinity = 40.1, close = 45.2 }, semi_diameter = 8 },
//! ]
//! ```
//!
//! A surface without `radius` is a plane, a gap without `glass` is air. `gap` is a number, a list over the positions of `zoom`,
//! or `{ infinity, close }` of either. Other keys: `radius_x` (toroid; with `conic_x` biconic), `mirror`, `obstruction`, `absorption` (1/mm), `decenter`,
//! `tilt_deg`; `[iris]`, `[[element]]` (decentre and tilt of several surfaces), `coating`.

use super::{ApertureKind, Coating, Gap, Misalignment, Prescription, PrescriptionError, Surface, Usage};
use crate::glass::Glass;
use crate::iris::Iris;
use crate::surface::{Asphere, Profile};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fmt::Write;
use toml::Spanned;

/// Highest power of an aspheric term.
const HIGHEST_POWER: u32 = 40;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Sheet {
    name: String,
    #[serde(default)]
    source: String,
    patent: Option<String>,
    focal_length: Option<f64>,
    f_number: Option<f64>,
    image_circle: Option<f64>,
    #[serde(default)]
    zoom: Vec<f64>,
    close_focus: Option<f64>,
    #[serde(default)]
    coating: SheetCoating,
    #[serde(default)]
    iris: SheetIris,
    #[serde(default)]
    element: Vec<SheetElement>,
    #[serde(default)]
    usage: SheetUsage,
    surfaces: Vec<Spanned<SheetSurface>>,
}

#[derive(Deserialize, Default, Clone, Copy)]
enum SheetCoating {
    #[default]
    #[serde(rename = "none")]
    None,
    #[serde(rename = "MgF2")]
    MagnesiumFluoride,
    #[serde(rename = "multi")]
    Multilayer,
    #[serde(rename = "perfect")]
    Perfect,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct SheetIris {
    blades: Option<u32>,
    rotation_deg: f32,
    curvature: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SheetElement {
    surfaces: [usize; 2],
    #[serde(default)]
    decenter: [f64; 3],
    #[serde(default)]
    tilt_deg: [f64; 3],
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct SheetUsage {
    entrance_pupil_diameter: Option<f64>,
    f_number: Option<f64>,
    object_na: Option<f64>,
    wavelengths_nm: Vec<f64>,
    reference_wavelength: Option<usize>,
    fields_deg: Vec<f64>,
    vignetting: Vec<[f64; 2]>,
    object_distance: Option<f64>,
    defocus: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SheetSurface {
    radius: Option<f64>,
    radius_x: Option<f64>,
    #[serde(default)]
    conic: f64,
    conic_x: Option<f64>,
    #[serde(default)]
    asphere: BTreeMap<String, f64>,
    gap: Option<SheetGap>,
    #[serde(default)]
    glass: Option<String>,
    absorption: Option<f64>,
    semi_diameter: Option<f64>,
    #[serde(default)]
    obstruction: f64,
    #[serde(default)]
    stop: bool,
    #[serde(default)]
    mirror: bool,
    #[serde(default)]
    decenter: [f64; 2],
    #[serde(default)]
    tilt_deg: [f64; 3],
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "gap: expected a number, a list of numbers, or { infinity = .., close = .. }")]
enum SheetGap {
    Row(Row),
    Focus { infinity: Row, close: Row },
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a number or a list of numbers")]
enum Row {
    One(f64),
    Zoom(Vec<f64>),
}

impl From<Row> for Vec<f64> {
    fn from(row: Row) -> Self {
        match row {
            Row::One(v) => vec![v],
            Row::Zoom(v) => v,
        }
    }
}

/// Line, counted from 1, of a byte offset.
fn line_of(text: &str, offset: usize) -> usize {
    text.as_bytes()[..offset.min(text.len())].iter().filter(|b| **b == b'\n').count() + 1
}

/// Reads a prescription; `file` is its name in errors.
pub fn read_toml(text: &str, file: &str) -> Result<Prescription, PrescriptionError> {
    let sheet: Sheet = toml::from_str(text).map_err(|e| {
        let line = e.span().map_or(0, |s| line_of(text, s.start));
        PrescriptionError::at(file, line, e.message().trim().replace('\n', " "))
    })?;
    let mut surfaces = Vec::with_capacity(sheet.surfaces.len());
    for (i, s) in sheet.surfaces.into_iter().enumerate() {
        let line = line_of(text, s.span().start);
        surfaces.push(surface(s.into_inner(), line).map_err(|what| PrescriptionError::at(file, line, what).surface(i + 1))?);
    }
    let u = sheet.usage;
    let wrong = |what: String| PrescriptionError::at(file, 0, what);
    let reference = u.reference_wavelength.unwrap_or(1);
    if !u.wavelengths_nm.is_empty() && !(1..=u.wavelengths_nm.len()).contains(&reference) {
        return Err(wrong(format!("reference_wavelength {reference}: expected 1 to {}", u.wavelengths_nm.len())));
    }
    let apertures = [
        u.entrance_pupil_diameter.map(ApertureKind::EntrancePupil),
        u.f_number.map(ApertureKind::FNumber),
        u.object_na.map(ApertureKind::ObjectNa),
    ];
    if apertures.iter().flatten().count() > 1 {
        return Err(wrong("[usage]: expected one of entrance_pupil_diameter, f_number and object_na".into()));
    }
    let usage = Usage {
        aperture: apertures.into_iter().flatten().next(),
        wavelengths_nm: u.wavelengths_nm,
        reference: reference - 1,
        field_angles_deg: u.fields_deg,
        vignetting: u.vignetting,
        object_distance: u.object_distance,
        defocus: u.defocus,
    };
    let iris = match sheet.iris.blades {
        None if sheet.iris.curvature != 0.0 || sheet.iris.rotation_deg != 0.0 => {
            return Err(wrong("[iris]: curvature or rotation_deg without blades".into()));
        }
        None => Iris::Round,
        Some(count) => {
            Iris::blades(count, sheet.iris.rotation_deg.to_radians(), sheet.iris.curvature).map_err(|e| wrong(e.to_string()))?
        }
    };
    let misalignments = sheet
        .element
        .into_iter()
        .map(|e| {
            let [first, last] = e.surfaces;
            if first == 0 {
                return Err(wrong("element: surfaces are counted from 1".into()));
            }
            Ok(Misalignment { first: first - 1, last: last.wrapping_sub(1), decenter: e.decenter, tilt: e.tilt_deg })
        })
        .collect::<Result<_, _>>()?;
    let coating = match sheet.coating {
        SheetCoating::None => Coating::None,
        SheetCoating::MagnesiumFluoride => Coating::MagnesiumFluoride,
        SheetCoating::Multilayer => Coating::Multilayer,
        SheetCoating::Perfect => Coating::Perfect,
    };
    Prescription {
        name: sheet.name,
        patent: sheet.patent,
        source: sheet.source,
        focal_length: sheet.focal_length,
        f_number: sheet.f_number,
        image_circle: sheet.image_circle,
        zoom: sheet.zoom,
        close_focus: sheet.close_focus,
        iris,
        coating,
        surfaces,
        misalignments,
        usage,
        notes: vec![],
    }
    .checked(file)
}

fn surface(s: SheetSurface, line: usize) -> Result<Surface, String> {
    let curvature = |r: Option<f64>, what: &str| match r {
        None => Ok(0.0),
        Some(r) if r.is_infinite() => Ok(0.0),
        Some(r) if r == 0.0 || r.is_nan() => Err(format!("{what} {r}: expected a length in mm; leave it out for a plane")),
        Some(r) => Ok(1.0 / r),
    };
    let c = curvature(s.radius, "radius")?;
    if s.conic != 0.0 && c == 0.0 {
        return Err(format!("conic {} without a radius: a plane has no conic constant", s.conic));
    }
    let mut a = vec![];
    for (power, value) in &s.asphere {
        let power: u32 = power.parse().ok().filter(|p| (1..=HIGHEST_POWER).contains(p)).ok_or_else(|| {
            format!("asphere: power \"{power}\": expected a whole number from 1 to {HIGHEST_POWER}, such as {{ 4 = 1e-5 }}")
        })?;
        a.resize(a.len().max(power as usize + 1), 0.0);
        a[power as usize] = *value;
    }
    let c_x = s.radius_x.map(|r| curvature(Some(r), "radius_x")).transpose()?;
    let profile = match (s.conic_x, c_x) {
        (None, c_x) => profile(c, s.conic, a, c_x),
        (Some(k_x), None) => return Err(format!("conic_x {k_x} without radius_x: a biconic needs both")),
        (Some(_), Some(_)) if a.iter().any(|v| *v != 0.0) => {
            return Err("conic_x with asphere: a biconic has no polynomial terms".into());
        }
        (Some(k_x), Some(c_x)) => biconic([c_x, k_x], [c, s.conic]),
    };
    let mut glass = Glass::parse(s.glass.as_deref().unwrap_or("air")).map_err(|e| e.to_string())?;
    if let Some(alpha) = s.absorption {
        if !(alpha >= 0.0 && alpha.is_finite()) {
            return Err(format!("absorption {alpha}: expected 0 or more, in 1/mm"));
        }
        glass = glass.with_absorption(vec![(550.0, alpha)]);
    }
    let values = match s.gap {
        None => vec![vec![0.0]],
        Some(SheetGap::Row(row)) => vec![row.into()],
        Some(SheetGap::Focus { infinity, close }) => vec![infinity.into(), close.into()],
    };
    Ok(Surface {
        line,
        profile,
        gap: Gap { values },
        glass,
        semi_diameter: s.semi_diameter,
        obstruction: s.obstruction,
        stop: s.stop,
        mirror: s.mirror,
        decenter: s.decenter,
        tilt: s.tilt_deg,
    })
}

/// The simplest profile that these figures describe.
pub(crate) fn profile(c: f64, k: f64, a: Vec<f64>, c_x: Option<f64>) -> Profile {
    let flat = a.iter().all(|v| *v == 0.0);
    // Files carry conic constants of planes, where they mean nothing.
    let k = if c == 0.0 { 0.0 } else { k };
    match c_x {
        Some(c_x) if c_x != c || !flat || k != 0.0 => Profile::Toroid { y: Asphere { c, k, a }, c_x },
        _ if !flat => Profile::Asphere(Asphere { c, k, a }),
        _ if c == 0.0 => Profile::Plane,
        _ if k == 0.0 => Profile::Sphere(c),
        _ => Profile::Conic { c, k },
    }
}

/// A biconic from curvature and conic constant in x and in y; the simpler profile where they are the same.
pub(crate) fn biconic([c_x, k_x]: [f64; 2], [c_y, k_y]: [f64; 2]) -> Profile {
    // Conic constants of planes mean nothing.
    let of_plane = |c: f64, k: f64| if c == 0.0 { 0.0 } else { k };
    let (k_x, k_y) = (of_plane(c_x, k_x), of_plane(c_y, k_y));
    if (c_x, k_x) == (c_y, k_y) { profile(c_y, k_y, vec![], None) } else { Profile::Biconic { c_x, k_x, c_y, k_y } }
}

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
        match self.coating {
            Coating::None => {}
            Coating::MagnesiumFluoride => line(&mut t, "coating", text("MgF2")),
            Coating::Multilayer => line(&mut t, "coating", text("multi")),
            Coating::Perfect => line(&mut t, "coating", text("perfect")),
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
        for m in &self.misalignments {
            let _ = writeln!(t, "\n[[element]]\nsurfaces = [{}, {}]", m.first + 1, m.last + 1);
            let _ = writeln!(t, "decenter = {}\ntilt_deg = {}", list(&m.decenter), list(&m.tilt));
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

/// A number that TOML reads back as the same.
fn number(v: f64) -> String {
    if v != 0.0 && !(1e-4..1e15).contains(&v.abs()) { format!("{v:e}") } else { format!("{v}") }
}

fn list(v: &[f64]) -> String {
    format!("[{}]", v.iter().map(|v| number(*v)).collect::<Vec<_>>().join(", "))
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
    if let Some(sd) = s.semi_diameter {
        f.push(format!("semi_diameter = {}", number(sd)));
    }
    if s.obstruction > 0.0 {
        f.push(format!("obstruction = {}", number(s.obstruction)));
    }
    if s.decenter != [0.0; 2] {
        f.push(format!("decenter = {}", list(&s.decenter)));
    }
    if s.tilt != [0.0; 3] {
        f.push(format!("tilt_deg = {}", list(&s.tilt)));
    }
    f
}
