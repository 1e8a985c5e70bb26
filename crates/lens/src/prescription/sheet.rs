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
//! or `{ infinity, close }` of either. Q-type aspheres have `q_con` or `q_bfs = { radius = 9, terms = [0.02, -0.01] }` instead of
//! `asphere` (see `forbes.rs`). A gap of graded glass has `gradient = { radial = [r², r⁴, ...], axial = [z, z², ...], squared = true }` (see
//! `gradient.rs`). `departure` is a polynomial on the shape, `diffractive` a phase or grating (see `phases.rs`), `fresnel` lays the slopes of the shape
//! into a plane. Other keys: `radius_x` (toroid; with `conic_x` biconic), `mirror`, `ideal_focal_length` (a thin lens without aberrations), `obstruction`, `absorption` (1/mm), `decenter`,
//! `tilt_deg`; `[iris]`, `[[element]]` (decentre and tilt of several surfaces), `[object_axis]` with `decenter` (mm) and `tilt_deg` (about x, y, z: the base ray before mirrors off the axis, seen from the
//! lens), `stabiliser = [first, last]` (surfaces of the group that moves against shake), `year`; `coating` of the lens or of a surface (see
//! `coatings.rs`); `apertures` and `obscurations` of a surface (see `apertures.rs`); how surfaces and walls scatter: `[stray]` with `roughness_nm`,
//! `cleanliness` (both also of a surface) and `wall_reflectance`, and `[hood]` with `length` and `diameter` (see `glare`, `hood.rs`).

use super::apertures::{self, SheetApertures};
use super::coatings::{self, Names, SheetCoating};
use super::numbers::{list, number};
use super::phases::{self, SheetDiffractive, SheetPolynomial};
use super::{ApertureKind, Coating, Gap, Hood, Misalignment, ObjectAxis, Prescription, PrescriptionError, Surface, Usage};
use crate::forbes::{Forbes, ForbesKind};
use crate::freeform::Freeform;
use crate::glare::Finish;
use crate::glass::Glass;
use crate::gradient::Gradient;
use crate::iris::Iris;
use crate::surface::{Asphere, Profile};
use crate::toml_place::line_of;
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
    year: Option<u16>,
    coating: Option<SheetCoating>,
    #[serde(default)]
    coatings: BTreeMap<String, SheetCoating>,
    #[serde(default)]
    iris: SheetIris,
    #[serde(default)]
    element: Vec<SheetElement>,
    object_axis: Option<SheetObjectAxis>,
    #[serde(default)]
    stray: SheetStray,
    hood: Option<Hood>,
    stabiliser: Option<[usize; 2]>,
    #[serde(default)]
    usage: SheetUsage,
    surfaces: Vec<Spanned<SheetSurface>>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct SheetIris {
    blades: Option<u32>,
    rotation_deg: f32,
    curvature: f32,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct SheetStray {
    roughness_nm: Option<f64>,
    cleanliness: Option<f64>,
    wall_reflectance: Option<f64>,
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

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SheetObjectAxis {
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
    q_con: Option<SheetForbes>,
    q_bfs: Option<SheetForbes>,
    gap: Option<SheetGap>,
    #[serde(default)]
    glass: Option<String>,
    absorption: Option<f64>,
    gradient: Option<SheetGradient>,
    semi_diameter: Option<f64>,
    #[serde(default)]
    obstruction: f64,
    #[serde(default)]
    apertures: SheetApertures,
    #[serde(default)]
    obscurations: SheetApertures,
    #[serde(default)]
    stop: bool,
    #[serde(default)]
    mirror: bool,
    ideal_focal_length: Option<f64>,
    departure: Option<SheetPolynomial>,
    #[serde(default)]
    fresnel: bool,
    diffractive: Option<SheetDiffractive>,
    coating: Option<SheetCoating>,
    roughness_nm: Option<f64>,
    cleanliness: Option<f64>,
    #[serde(default)]
    decenter: [f64; 2],
    #[serde(default)]
    tilt_deg: [f64; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SheetGradient {
    #[serde(default)]
    radial: Vec<f64>,
    #[serde(default)]
    axial: Vec<f64>,
    #[serde(default)]
    squared: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SheetForbes {
    radius: f64,
    terms: Vec<f64>,
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

/// Reads a prescription; `file` is its name in errors.
pub fn read_toml(text: &str, file: &str) -> Result<Prescription, PrescriptionError> {
    let sheet: Sheet = toml::from_str(text).map_err(|e| {
        let line = e.span().map_or(0, |s| line_of(text, s.start));
        PrescriptionError::at(file, line, e.message().trim().replace('\n', " "))
    })?;
    let known = Prescription { patent: sheet.patent.clone(), year: sheet.year, ..Prescription::new("", vec![]) };
    let names = Names::read(sheet.coatings, known.known_year()).map_err(|what| PrescriptionError::at(file, 0, what))?;
    let coating = sheet.coating.map_or(Ok(Coating::None), |c| names.coating(c));
    let coating = coating.map_err(|what| PrescriptionError::at(file, 0, what))?;
    let stray = sheet.stray;
    let wrong = |what: String| PrescriptionError::at(file, 0, what);
    let all = finish(stray.roughness_nm, stray.cleanliness, Finish::default()).map_err(|e| wrong(format!("stray: {e}")))?;
    let wall_reflectance = stray.wall_reflectance.unwrap_or(super::WALL_REFLECTANCE);
    if !(0.0..1.0).contains(&wall_reflectance) {
        return Err(wrong(format!("stray: wall_reflectance {wall_reflectance}: expected 0 to below 1")));
    }
    if let Some(hood) = &sheet.hood {
        hood.check().map_err(&wrong)?;
    }
    let mut surfaces = Vec::with_capacity(sheet.surfaces.len());
    for (i, s) in sheet.surfaces.into_iter().enumerate() {
        let line = line_of(text, s.span().start);
        surfaces.push(
            surface(s.into_inner(), line, &names, all).map_err(|what| PrescriptionError::at(file, line, what).surface(i + 1))?,
        );
    }
    let u = sheet.usage;
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
    let stabiliser = match sheet.stabiliser {
        Some([0, _]) => return Err(wrong("stabiliser: surfaces are counted from 1".into())),
        other => other.map(|s| s.map(|number| number.wrapping_sub(1))),
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
        finish: all,
        wall_reflectance,
        hood: sheet.hood,
        year: sheet.year,
        surfaces,
        misalignments,
        object_axis: sheet.object_axis.map(|a| ObjectAxis { decenter: a.decenter, tilt: a.tilt_deg }),
        stabiliser,
        usage,
        notes: vec![],
    }
    .checked(file)
}

/// How something scatters: as `otherwise` where nothing is said.
fn finish(roughness_nm: Option<f64>, cleanliness: Option<f64>, otherwise: Finish) -> Result<Finish, String> {
    let found = Finish {
        roughness_nm: roughness_nm.unwrap_or(otherwise.roughness_nm),
        cleanliness: cleanliness.unwrap_or(otherwise.cleanliness),
    };
    match found {
        Finish { roughness_nm, .. } if !(0.0..=50.0).contains(&roughness_nm) => {
            Err(format!("roughness_nm {roughness_nm}: expected 0 to 50, in nm rms; polished glass has 0.5 to 2"))
        }
        Finish { cleanliness, .. } if !(0.0..=1500.0).contains(&cleanliness) => Err(format!(
            "cleanliness {cleanliness}: expected a level of IEST-STD-CC1246 from 0 to 1500; clean lenses have 100 to 300"
        )),
        found => Ok(found),
    }
}

fn surface(s: SheetSurface, line: usize, names: &Names, all: Finish) -> Result<Surface, String> {
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
        (None, c_x) => profile(c, s.conic, a.clone(), c_x),
        (Some(k_x), None) => return Err(format!("conic_x {k_x} without radius_x: a biconic needs both")),
        (Some(_), Some(_)) if a.iter().any(|v| *v != 0.0) => {
            return Err("conic_x with asphere: a biconic has no polynomial terms".into());
        }
        (Some(k_x), Some(c_x)) => biconic([c_x, k_x], [c, s.conic]),
    };
    let profile = match (s.q_con, s.q_bfs) {
        (None, None) => profile,
        (Some(_), Some(_)) => return Err("q_con and q_bfs: expected one of them".into()),
        _ if c_x.is_some() || a.iter().any(|v| *v != 0.0) => {
            return Err("q_con or q_bfs with asphere or radius_x: expected one kind of departure".into());
        }
        (Some(q), None) => Profile::Forbes(Forbes::new(ForbesKind::Conic, c, s.conic, q.radius, q.terms)?),
        (None, Some(q)) => Profile::Forbes(Forbes::new(ForbesKind::BestFitSphere, c, s.conic, q.radius, q.terms)?),
    };
    let profile = match (s.departure, s.fresnel) {
        (None, false) => profile,
        (Some(_), true) => return Err("departure with fresnel: expected one of them".into()),
        (Some(departure), false) => match asphere_of(&profile) {
            Some(base) => Profile::Freeform(Box::new(Freeform { base, departure: phases::polynomial(departure, "departure")? })),
            None => {
                return Err(
                    "departure on a toroid, biconic or Q-type asphere: expected radius, conic and asphere beside it".into()
                );
            }
        },
        (None, true) => match asphere_of(&profile) {
            Some(slopes) => Profile::Fresnel(slopes),
            None => {
                return Err("fresnel on a toroid, biconic or Q-type asphere: expected radius, conic and asphere beside it".into());
            }
        },
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
        gradient: s.gradient.map(|g| Gradient::new(g.squared, g.radial, g.axial)).transpose()?,
        semi_diameter: s.semi_diameter,
        obstruction: s.obstruction,
        apertures: apertures::read(s.apertures, s.obscurations)?,
        stop: s.stop,
        mirror: s.mirror,
        ideal_focal_length: s.ideal_focal_length,
        diffractive: s.diffractive.map(phases::diffractive).transpose()?,
        coating: s.coating.map(|c| names.coating(c)).transpose()?,
        finish: match (s.roughness_nm, s.cleanliness) {
            (None, None) => None,
            (roughness_nm, cleanliness) => Some(finish(roughness_nm, cleanliness, all)?),
        },
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

/// A rotational profile of conic and powers as an asphere; `None` of another one.
pub(crate) fn asphere_of(profile: &Profile) -> Option<Asphere> {
    profile.conic_and_powers().map(|(c, k, a)| Asphere { c, k, a: a.to_vec() })
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
        if self.finish != Finish::default() || self.wall_reflectance != super::WALL_REFLECTANCE {
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
