//! Lens files for other programs.
//!
//! A prescription at one focus and zoom becomes text that our own importers ([`crate::import`]) read back to the same rays. What would make
//! another lens of it is an error that names the surface; what rays do not need (coatings, the shape of the iris, absorption) or what is
//! written nearly (partial dispersions in Zemax) is noted.

mod codev;
mod zemax;

use crate::analysis::Bench;
use crate::aperture::Aperture;
use crate::glass::{D_NM, F_NM, Glass, GlassKind};
use crate::import::placed::tilts;
use crate::iris::Iris;
use crate::prescription::{ApertureKind, Prescription, PrescriptionError, Surface};
use crate::surface::Profile;
use crate::system::{State, System};
use glam::DVec3;

/// Wavelengths that are written where the prescription has none: C, d and F.
const DEFAULT_NM: [f64; 3] = [crate::glass::C_NM, D_NM, F_NM];
/// Lengths (mm) and angles (degrees) below this are rounding.
const ROUNDING: f64 = 1e-12;

/// A format that is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ExportFormat {
    /// Zemax OpticStudio (.zmx).
    Zemax,
    /// CODE V sequence (.seq).
    CodeV,
}

impl ExportFormat {
    /// By the ending of a file name.
    pub fn of(name: &str) -> Option<ExportFormat> {
        let ending = name.rsplit_once('.')?.1.to_ascii_lowercase();
        match ending.as_str() {
            "zmx" => Some(ExportFormat::Zemax),
            "seq" => Some(ExportFormat::CodeV),
            _ => None,
        }
    }
}

/// A lens file.
#[derive(Clone, Debug, PartialEq)]
pub struct Exported {
    /// The file, ASCII.
    pub text: String,
    /// What it does not hold, or nearly.
    pub notes: Vec<String>,
}

/// Writes a checked prescription at a focus and zoom. Fails with the number of the surface that the format cannot hold.
pub fn write(p: &Prescription, state: State, format: ExportFormat) -> Result<Exported, PrescriptionError> {
    let bench = Sheet::new(p, state);
    let (text, mut notes) = match format {
        ExportFormat::Zemax => zemax::write(&bench)?,
        ExportFormat::CodeV => codev::write(&bench)?,
    };
    if !p.zoom.is_empty() {
        notes.push(format!("one zoom position of {} is written: {:.2}", p.zoom.len(), state.zoom + 1.0));
    }
    if p.has_focus_data() {
        notes.push("gaps that change with focus are written as they stand".into());
    }
    if p.iris != Iris::Round {
        notes.push("the shape of the iris is left out: the file's stop is round".into());
    }
    if p.coating != crate::Coating::None || p.surfaces.iter().any(|s| s.coating.is_some()) {
        notes.push("coatings are left out".into());
    }
    if p.surfaces.iter().any(|s| s.diffractive.as_ref().is_some_and(|d| d.blaze().is_some())) {
        notes.push("the blaze of diffractive surfaces is left out: all light goes into their order".into());
    }
    if p.surfaces.iter().any(|s| s.glass.own_absorption().is_some()) {
        notes.push("absorption is left out".into());
    }
    Ok(Exported { text, notes })
}

/// How a surface stands on the axis: moved by `decenter` from its place, then turned about its new x, y and z axes (degrees).
struct Stance {
    decenter: [f64; 3],
    tilt: [f64; 3],
}

/// What limits the light on the axis.
enum Opening {
    /// An aperture.
    Stated(ApertureKind),
    /// The stop as it stands.
    Stop,
}

/// A prescription at a focus and zoom, as both formats need it.
struct Sheet<'a> {
    p: &'a Prescription,
    state: State,
    /// Gap behind each surface, mm.
    gaps: Vec<f64>,
    /// Of surfaces that do not stand straight on the axis.
    stances: Vec<Option<Stance>>,
    /// How that axis stands before the object's, where it is another.
    from_object: Option<Stance>,
    wavelengths_nm: Vec<f64>,
    reference: usize,
}

impl<'a> Sheet<'a> {
    fn new(p: &'a Prescription, state: State) -> Sheet<'a> {
        let system = System::at(p, state);
        let stance = |s: &crate::system::PlacedSurface| {
            let frame = &s.frame.as_ref()?.0;
            let decenter = frame.translation - DVec3::new(0.0, 0.0, s.z);
            let phase = s.diffractive.as_ref().is_none_or(|d| d.phase().is_rotational());
            let round = s.profile.is_rotational() && s.apertures.is_empty() && phase;
            let tilt = tilts(&frame.matrix3, round);
            let straight = decenter.abs().max_element() < ROUNDING && tilt.iter().all(|t| t.abs() < ROUNDING);
            (!straight).then_some(Stance { decenter: decenter.to_array(), tilt })
        };
        let stances = system.surfaces.iter().map(stance).collect();
        let from_object = system.object_axis.as_ref().map(|axis| {
            let lens = &axis.1;
            Stance { decenter: lens.translation.to_array(), tilt: tilts(&lens.matrix3, false) }
        });
        let gaps = p.surfaces.iter().map(|s| s.gap.at(state.zoom, state.focus)).collect();
        let (wavelengths_nm, reference) = match p.usage.wavelengths_nm.is_empty() {
            true => (DEFAULT_NM.to_vec(), 1),
            false => (p.usage.wavelengths_nm.clone(), p.usage.reference),
        };
        Sheet { p, state, gaps, stances, from_object, wavelengths_nm, reference }
    }

    /// Opening of the light: as the prescription states it, else by its f-number, else by the stop.
    fn opening(&self) -> Opening {
        let stated = self.p.usage.aperture.or(self.p.f_number.map(ApertureKind::FNumber));
        stated.map_or(Opening::Stop, Opening::Stated)
    }

    /// Diameter of the entrance pupil, mm: of an f-number for an object at infinity; without one that of the widest beam on the axis that rims and stop let pass,
    /// traced, or where none passes the paraxial one.
    fn entrance_pupil(&self, f_number: Option<f64>) -> f64 {
        let system = System::at(self.p, self.state);
        let n = system.reference_indices();
        let first = crate::paraxial::FirstOrder::of(&system, &n);
        match f_number {
            Some(f_number) => (first.efl / f_number).abs(),
            None => 2.0 * crate::f_number::widest_radius(&system, &n, first.efl).unwrap_or(first.entrance_pupil_radius()),
        }
    }

    /// Field angles in y, degrees: those of the prescription, else up to what falls on the edge of its image circle.
    fn fields_deg(&self) -> Vec<f64> {
        match self.p.image_circle {
            _ if !self.p.usage.field_angles_deg.is_empty() => self.p.usage.field_angles_deg.clone(),
            Some(circle) => {
                let system = System::at(self.p, self.state);
                let bench = Bench { system: &system, object_distance: self.p.usage.object_distance };
                let rounded = |deg: f64| (1e6 * deg).round() / 1e6;
                let most = rounded(bench.field_of_height(0.5 * circle));
                if most > 0.0 { vec![0.0, rounded(0.7 * most), most] } else { vec![0.0] }
            }
            None => vec![0.0],
        }
    }

    /// The medium before a surface.
    fn before(&self, i: usize) -> Glass {
        i.checked_sub(1).map_or(Glass::air(), |i| self.p.surfaces[i].glass.clone())
    }

    /// An error about a surface, by its index.
    fn wrong(&self, i: usize, what: impl Into<String>) -> PrescriptionError {
        PrescriptionError::at(&self.p.name, 0, what).surface(i + 1)
    }

    /// Media that neither format holds here: mirrors of both go on in the medium before them, gradients are not written.
    fn check_medium(&self, i: usize) -> Result<(), PrescriptionError> {
        let s = &self.p.surfaces[i];
        if s.gradient.is_some() {
            return Err(self.wrong(i, "gradient-index media are not written"));
        }
        match s.mirror && !same_index(&s.glass, &self.before(i)) {
            true => Err(self.wrong(i, "a mirror with another medium behind it than before it: lens files cannot say that")),
            false => Ok(()),
        }
    }
}

/// Whether two glasses bend light alike.
fn same_index(a: &Glass, b: &Glass) -> bool {
    a.kind == b.kind
}

/// The one opening and the one obscuration of a surface that are no disks about the vertex; fails where there are more.
fn apertures(s: &Surface) -> Result<[Option<Aperture>; 2], String> {
    let mut found = [None; 2];
    for a in &s.apertures {
        let slot = &mut found[usize::from(a.blocks())];
        if slot.replace(*a).is_some() {
            return Err("several apertures of a kind on one surface: lens files have one".into());
        }
        if a.rotation_deg() != 0.0 {
            return Err(format!("an aperture turned by {} degrees: lens files have none", a.rotation_deg()));
        }
    }
    Ok(found)
}

/// Whether an opening stands instead of the rim: all that it lets through lies within.
fn replaces_rim(opening: &Aperture, s: &Surface) -> bool {
    s.semi_diameter.is_none_or(|sd| opening.reach() <= sd * (1.0 + 1e-9))
}

/// Printable ASCII, for titles.
fn ascii(text: &str) -> String {
    text.chars().map(|c| if c.is_ascii() && !c.is_ascii_control() && c != '"' && c != '\'' { c } else { '?' }).collect()
}

/// Why a profile cannot be written.
fn unknown_profile(profile: &Profile, program: &str) -> String {
    match profile {
        Profile::Forbes(_) => format!("Q-type aspheres are not written for {program}"),
        Profile::Freeform(_) => format!("{program} files have no polynomial of these terms on this base"),
        Profile::Fresnel(_) => format!("Fresnel surfaces are not written for {program}"),
        Profile::Asphere(_) => format!("{program} files have no asphere of these powers"),
        _ => format!("{program} files have no such shape"),
    }
}

/// Powers and coefficients that are not 0.
fn terms(a: &[f64]) -> Vec<(usize, f64)> {
    a.iter().copied().enumerate().skip(1).filter(|t| t.1 != 0.0).collect()
}

/// Coefficients of x, y, x², xy, y², ... up to the highest that is not 0.
fn xy_values(xy: &std::collections::BTreeMap<(usize, usize), f64>) -> Vec<f64> {
    let number = |j: usize, k: usize| (j + k) * (j + k + 1) / 2 + k;
    let count = xy.iter().filter(|t| *t.1 != 0.0).map(|((j, k), _)| number(*j, *k)).max().unwrap_or(0);
    let mut values = vec![0.0; count];
    for ((j, k), v) in xy.iter().filter(|t| t.0 != &(0, 0) && *t.1 != 0.0) {
        values[number(*j, *k) - 1] = *v;
    }
    values
}

/// Which single kind of terms a polynomial has.
enum Only<'a> {
    Radial(&'a [f64]),
    /// x, y, x², xy, ...
    Xy(Vec<f64>),
    Noll(&'a [f64]),
    Fringe(&'a [f64]),
}

/// The one kind of terms of a polynomial; `None` where there are several, or a constant.
fn only(p: &crate::polynomial::Polynomial) -> Option<Only<'_>> {
    let t = p.terms();
    let some = |v: &[f64]| v.iter().any(|v| *v != 0.0);
    let xy = t.xy.values().any(|v| *v != 0.0);
    if t.xy.get(&(0, 0)).is_some_and(|v| *v != 0.0) {
        return None;
    }
    match (some(&t.radial), xy, some(&t.noll), some(&t.fringe)) {
        (_, false, false, false) => Some(Only::Radial(&t.radial)),
        (false, true, false, false) => Some(Only::Xy(xy_values(&t.xy))),
        (false, false, true, false) => Some(Only::Noll(&t.noll)),
        (false, false, false, true) => Some(Only::Fringe(&t.fringe)),
        _ => None,
    }
}

/// nd, Vd and the departure of P_gF from the normal line of a curve through published figures.
fn model_figures(glass: &Glass) -> Option<[f64; 3]> {
    let GlassKind::Model { nd, vd, .. } = &glass.kind else { return None };
    let n = |nm: f64| glass.index(nm);
    let relative = (n(crate::glass::G_NM) - n(F_NM)) / (n(F_NM) - n(crate::glass::C_NM));
    // The line of `Glass::model`, which 1e-9 off is rounding.
    let off = relative - (0.6438 - 0.001682 * vd);
    Some([*nd, *vd, if off.abs() < 1e-9 { 0.0 } else { off }])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{self, Format};
    use crate::paraxial::FirstOrder;
    use crate::ray::{Apertures, TraceDirection, TracedRay};
    use crate::trace::at_plane;
    use crate::{embedded, embedded_names};

    /// First order and where rays reach the film, as they go through whatever rims.
    fn compare(name: &str, a: &Prescription, b: &Prescription, nm: f64) -> usize {
        let state = State::default();
        let (sa, sb) = (System::at(a, state), System::at(b, state));
        let (na, nb) = (sa.indices(nm), sb.indices(nm));
        let (fa, fb) = (FirstOrder::of(&sa, &na), FirstOrder::of(&sb, &nb));
        // Groups out of place are left out of first order; in the files they stand surface by surface.
        if a.misalignments.is_empty() {
            assert!((fa.efl / fb.efl - 1.0).abs() < 1e-11, "{name}: {} {}", fa.efl, fb.efl);
        }
        let reach = sa.iris.radius;
        let mut met = 0;
        for i in 0..60 {
            let f = |k: usize| ((i * k % 61) as f64 / 30.0 - 1.0) * 0.7;
            let direction = DVec3::new(0.15 * f(17), 0.25 * f(29), 1.0).normalize();
            let at = DVec3::new(reach * f(7), reach * f(11), 0.0);
            // Dummy planes before the first surface move it: rays are given at the first vertex of each.
            let ray = TracedRay { position: at - direction * 20.0, direction };
            let [la, lb] = [(&sa, &na), (&sb, &nb)].map(|(s, n)| {
                let out = s.trace(ray, n, TraceDirection::ToFilm, Apertures::Ignore).ok()?;
                Some(at_plane(&out, s.film_z).truncate())
            });
            match (la, lb) {
                (Some(la), Some(lb)) => {
                    met += 1;
                    // Angles and places of decentred surfaces go through degrees and back.
                    assert!((la - lb).length() < 1e-9 * (1.0 + la.length()), "{name}: {la} {lb}");
                }
                (None, None) => {}
                other => panic!("{name}: {other:?}"),
            }
        }
        met
    }

    #[test]
    fn a_lens_without_an_f_number_keeps_its_real_one() {
        // Spheres at f/1.9 with the stop behind the glass: its paraxial entrance pupil is 4 % narrower than the beam that it lets pass.
        let text = "name = \"fast\"\nsurfaces = [\n  { radius = 40, gap = 8, glass = \"N-BK7\", semi_diameter = 16 },\n  { radius = -60, gap = 12, semi_diameter = 16 },\n  { stop = true, gap = 20, semi_diameter = 8 },\n]\n";
        let p = import::read(text.as_bytes(), Format::Toml, "fast.toml").unwrap();
        let real = |p: &Prescription| {
            let set = crate::compound::configure(p, None, None, None, crate::compound::FilmPlace::AsPublished).unwrap();
            p.used_f_number().unwrap_or(set.f_number)
        };
        let system = System::at(&p, State::default());
        let paraxial = FirstOrder::of(&system, &system.indices(D_NM)).f_number();
        assert!((paraxial / real(&p) - 1.0).abs() > 0.01, "{paraxial} {}", real(&p));
        for (format, back) in [(ExportFormat::Zemax, Format::Zemax), (ExportFormat::CodeV, Format::CodeV)] {
            let text = write(&p, State::default(), format).unwrap().text;
            let again = import::read(text.as_bytes(), back, "again").unwrap();
            assert!((real(&again) / real(&p) - 1.0).abs() < 2e-3, "{format:?}: {} {}\n{text}", real(&again), real(&p));
        }
        // An f-number for an object at infinity is no working f-number: with a nearer object CODE V gets the pupil.
        let near = "name = \"near\"\nf_number = 4\nsurfaces = [\n  { radius = 100, gap = 5, glass = \"N-BK7\", semi_diameter = 20, stop = true },\n  { radius = -100, gap = 187.4, semi_diameter = 20 },\n]\n[usage]\nobject_distance = 200\n";
        let p = import::read(near.as_bytes(), Format::Toml, "near.toml").unwrap();
        let text = write(&p, State::default(), ExportFormat::CodeV).unwrap().text;
        let again = import::read(text.as_bytes(), Format::CodeV, "again").unwrap();
        assert!((again.used_f_number().unwrap() / 4.0 - 1.0).abs() < 2e-3, "{text}");
    }

    #[test]
    fn embedded_lenses_come_back_from_both_formats() {
        let mut written = [0; 2];
        for name in embedded_names() {
            let p = embedded(name).unwrap();
            for (k, (format, back)) in
                [(ExportFormat::Zemax, Format::Zemax), (ExportFormat::CodeV, Format::CodeV)].iter().enumerate()
            {
                let exported = match write(&p, State::default(), *format) {
                    Ok(exported) => exported,
                    Err(e) => {
                        // What is refused says which surface.
                        assert!(e.surface.is_some(), "{name}: {e}");
                        continue;
                    }
                };
                assert!(exported.text.is_ascii());
                let read = import::read(exported.text.as_bytes(), *back, name);
                let read = read.unwrap_or_else(|e| panic!("{name} {format:?}: {e}\n{}", exported.text));
                assert!(compare(name, &p, &read, D_NM) > 10, "{name} {format:?}");
                written[k] += 1;
            }
        }
        // Odd powers up to the tenth keep one of the lenses out of both.
        let all = embedded_names().count();
        assert!(written.iter().all(|w| w + 1 >= all), "{written:?} of {all}");
    }

    fn lens(first: &str) -> Prescription {
        let text = format!(
            "name = \"Prüfling\"\nf_number = 4\nsurfaces = [\n{{ {first}, gap = 4, glass = \"N-BK7\" }},\n\
             {{ radius = -40, gap = 2, glass = \"1.62/36.3/0.004\", semi_diameter = 6 }},\n\
             {{ radius = -90, gap = 3, semi_diameter = 6 }},\n{{ stop = true, gap = 60, semi_diameter = 5 }},\n]\n\
             [[element]]\nsurfaces = [2, 3]\ndecenter = [0.1, -0.2, 0.05]\ntilt_deg = [1.5, -0.7, 0]\n"
        );
        crate::prescription::read_toml(&text, "x.toml").unwrap()
    }

    #[test]
    fn decentred_groups_toroids_and_apertures_come_back() {
        for (first, apertures) in [
            ("radius = 60, semi_diameter = 6, decenter = [0.2, 0.1], tilt_deg = [0, 2, 0]", 0),
            ("radius = 60, radius_x = 50, conic = -1, asphere = { 4 = 1e-6 }, semi_diameter = 6, tilt_deg = [0, 0, 25]", 0),
            ("radius = 60, radius_x = inf, semi_diameter = 6", 0),
            ("radius = 60, conic = 0.5, radius_x = 80, conic_x = -2, semi_diameter = 6", 0),
            ("radius = 60, conic = -2, asphere = { 4 = 1e-6, 20 = 1e-22 }, semi_diameter = 6", 0),
            ("radius = 60, apertures = { rectangle = [5, 3], center = [0.5, 0.2] }", 1),
            ("radius = 60, semi_diameter = 6, obscurations = { ellipse = [1, 2] }", 1),
            ("radius = 60, semi_diameter = 6, obstruction = 1.5", 0),
            (
                "radius = 60, conic = -0.5, semi_diameter = 6, departure = { radius = 7, xy = { x2 = 0.01, x1y2 = -0.02, y3 = 0.004 } }",
                0,
            ),
            (
                "radius = 60, conic = -0.5, semi_diameter = 6, departure = { radius = 7, fringe = [0, 0, 1e-3, 0, 2e-3, 1e-3, -2e-3] }, tilt_deg = [1, 0, 20]",
                0,
            ),
            (
                "radius = 60, semi_diameter = 6, asphere = { 4 = 1e-6 }, diffractive = { order = 2, phase = { radius = 6, radial = [-40, 3, 0.5] } }",
                0,
            ),
        ] {
            let p = lens(first);
            for (format, back) in [(ExportFormat::Zemax, Format::Zemax), (ExportFormat::CodeV, Format::CodeV)] {
                let exported = write(&p, State::default(), format).unwrap_or_else(|e| panic!("{first}: {e}"));
                let read = import::read(exported.text.as_bytes(), back, "x");
                let read = read.unwrap_or_else(|e| panic!("{first} {format:?}: {e}\n{}", exported.text));
                assert!(compare(first, &p, &read, D_NM) > 40, "{first}");
                let (a, b) = (&p.surfaces[0], &read.surfaces[0]);
                assert_eq!(b.apertures.len(), apertures, "{first} {format:?}");
                assert!(
                    a.obstruction == b.obstruction && (a.semi_diameter.unwrap() / b.semi_diameter.unwrap() - 1.0).abs() < 1e-12
                );
            }
        }
    }

    #[test]
    fn shapes_and_phases_that_zemax_alone_has_come_back() {
        for first in [
            "radius = 60, semi_diameter = 6, asphere = { 4 = 1e-6 }, departure = { radius = 7, noll = [0, 0, 0, 1e-3, 2e-3, 0, 1e-3] }",
            "radius = 60, conic = -1, semi_diameter = 6, q_con = { radius = 7, terms = [0.01, -0.02] }",
            "radius = 60, semi_diameter = 6, q_bfs = { radius = 7, terms = [0.01, -0.02] }",
            "radius = 60, conic = -1, asphere = { 4 = 1e-6 }, fresnel = true, semi_diameter = 6",
            "radius = 60, semi_diameter = 6, diffractive = { order = -1, lines_per_mm = 20 }",
            "radius = 60, semi_diameter = 6, diffractive = { phase = { radius = 6, xy = { x1 = 10, y2 = -30, x2y1 = 4 } } }",
        ] {
            let p = lens(first);
            let exported = write(&p, State::default(), ExportFormat::Zemax).unwrap_or_else(|e| panic!("{first}: {e}"));
            let read = import::read(exported.text.as_bytes(), Format::Zemax, "x");
            let read = read.unwrap_or_else(|e| panic!("{first}: {e}\n{}", exported.text));
            assert!(compare(first, &p, &read, D_NM) > 40, "{first}");
            assert!(write(&p, State::default(), ExportFormat::CodeV).unwrap_err().surface == Some(1), "{first}");
        }
    }

    #[test]
    fn what_a_format_cannot_hold_names_the_surface() {
        let refused = |first: &str, format| write(&lens(first), State::default(), format).unwrap_err();
        for format in [ExportFormat::Zemax, ExportFormat::CodeV] {
            let e = refused(
                "radius = 60, semi_diameter = 6, departure = { radius = 7, xy = { x2 = 0.01 }, fringe = [0, 1e-3] }",
                format,
            );
            assert!(e.surface == Some(1) && e.what.contains("polynomial of these terms"), "{e}");
            let e = refused("radius = 60, apertures = { rectangle = [5, 3], rotation_deg = 10 }", format);
            assert!(e.surface == Some(1) && e.what.contains("turned by 10"), "{e}");
        }
        let odd = "radius = 60, asphere = { 3 = 1e-5 }, semi_diameter = 6";
        assert_eq!(refused(odd, ExportFormat::CodeV).surface, Some(1));
        assert!(write(&lens(odd), State::default(), ExportFormat::Zemax).is_ok());
        assert!(
            refused("radius = 60, asphere = { 3 = 1e-5, 12 = 1e-15 }, semi_diameter = 6", ExportFormat::Zemax).surface == Some(1)
        );
    }
}
