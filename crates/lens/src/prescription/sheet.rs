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

mod write;

use super::apertures::{self, SheetApertures};
use super::coatings::{Names, SheetCoating};
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
use diopter_light::names::in_words;
use serde::Deserialize;
use std::collections::BTreeMap;
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

/// Reads a prescription; `file` is its name in errors. Fails, with line and surface where they are known, on other keys than these and on what [`Prescription::checked`] refuses.
pub fn read_toml(text: &str, file: &str) -> Result<Prescription, PrescriptionError> {
    let sheet: Sheet = toml::from_str(text).map_err(|e| {
        let line = e.span().map_or(0, |s| line_of(text, s.start));
        PrescriptionError::at(file, line, in_words(e.message()).trim().replace('\n', " "))
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
