//! A prescription as it is set: zoom, aperture, iris, and the film where it is sharp.

use super::tilt::{Tilt, Turned};
use super::zoom::{NAME_TOLERANCE, focal_length_of, zoom_position};
use crate::batch::single::Batch;
use crate::f_number;
use crate::focusing::{AxialSpot, best_film_z};
use crate::iris::Iris;
use crate::paraxial::FirstOrder;
use crate::prescription::Prescription;
use crate::pupil::{self, Geometry};
use crate::system::{PlacedSurface, State, System};
use crate::{Focus, LensError};
use diopter_light::units::Millimeters;
use glam::{DVec2, DVec3};

/// Where the film stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FilmPlace {
    /// As the prescription says, at infinity focus.
    AsPublished,
    /// In the plane of the smallest axial spot of an object.
    Focused(Focus),
}

/// A system with zoom, aperture and focus set.
#[derive(Clone, Debug)]
pub struct Configured {
    /// The surfaces as they stand.
    pub system: System,
    /// Focus and zoom positions.
    pub state: State,
    /// Effective focal length at infinity focus, mm.
    pub efl: f64,
    /// f-number as set.
    pub f_number: f64,
    /// f-number fully open.
    pub widest: f64,
    /// Radius of the axial beam at the stop, mm; less than the iris's where a rim limits the beam.
    pub beam_radius: f64,
}

impl Configured {
    /// Moves the film of a zoom that stands between two printed positions into the plane of the smallest axial spot of an object (mm
    /// before the first vertex; `None` at infinity): gaps are interpolated there, and the focus is off by tenths of a millimetre.
    /// How far the film has moved along the light, mm; `None` at a printed position, whose film stays, and where no light comes through.
    pub fn refocus_between_positions(&mut self, object_distance: Option<f64>) -> Option<f64> {
        if self.state.zoom.fract() == 0.0 {
            return None;
        }
        let (z, _) = best_film_z(&self.system, object_distance.map(|d| -d))?;
        let run = self.system.film_run();
        if (z - self.system.last_z()) * run <= 0.0 {
            return None;
        }
        let moved = (z - self.system.film_z) * run;
        self.system.film_z = z;
        Some(moved)
    }

    /// Distance from the axis (mm) beyond which no light falls on the film, at most `most`: of a lens that is not round the shortest along
    /// x and y. `None` where the film touches the lens.
    pub fn image_circle_radius(&self, most: f64) -> Option<f64> {
        let first =
            FirstOrder { stop_radius: self.beam_radius, ..FirstOrder::of(&self.system, &self.system.reference_indices()) };
        let batch = Batch::new(&self.system);
        let geometry = geometry(&self.system, &batch, &first, DVec2::ZERO, DVec2::splat(most))?;
        let towards = [DVec2::X, DVec2::Y, DVec2::NEG_X, DVec2::NEG_Y];
        let count = if geometry.rotational { 1 } else { towards.len() };
        Some(towards[..count].iter().map(|d| pupil::image_circle_radius(&geometry, *d, most)).fold(most, f64::min))
    }
}

/// What finding pupils needs to know about a lens as it stands; `first` with the stop radius of the axial beam; `middle` as [`Geometry::middle`]. `None` where
/// the film does not lie behind the last surface.
pub(super) fn geometry<'a>(
    system: &System,
    batch: &'a Batch,
    first: &FirstOrder,
    middle: DVec2,
    film_half: DVec2,
) -> Option<Geometry<'a>> {
    // Distances count from the film towards the lens, whichever way the light comes.
    let run = system.film_run();
    let distance = (system.film_z - first.exit_pupil_z) * run;
    let curvature = if distance.is_finite() && distance.abs() > 1e-6 { 1.0 / distance } else { 0.0 };
    let rim = system.surfaces.last().map_or(([1.0, 1.0], 1.0), |s| rim_of(s, system.film_z, run));
    (rim.0[0] > 0.0).then(|| Geometry {
        batch,
        film_z: system.film_z,
        film_run: run,
        curvature,
        middle: middle + system.base_slope(&system.reference_indices()),
        slope: (first.exit_pupil_radius() / distance).abs().clamp(1e-4, 2.0),
        rim,
        film_half,
        rotational: system.is_rotational(),
        mirrored: system.is_centered(),
        iris_period: system.iris.shape.period(),
    })
}

/// Distances from the film between which a surface lies within its rim, and how far its rim reaches from the axis, mm.
pub(super) fn rim_of(s: &PlacedSurface, film_z: f64, run: f64) -> ([f64; 2], f64) {
    let Some(frame) = &s.frame else {
        let sag = s.profile.sag(0.0, s.semi_diameter * (1.0 - 1e-9)).unwrap_or(0.0);
        let (vertex, edge) = ((film_z - s.z) * run, (film_z - s.z - sag) * run);
        return ([vertex.min(edge), vertex.max(edge)], s.semi_diameter);
    };
    /// Places around a rim; a polygon of so many corners holds its circle when it is larger by 1/cos(π/32).
    const AROUND: usize = 32;
    // Rims of surfaces that are not round have another sag elsewhere.
    let room = if s.profile.is_rotational() { 0.01 } else { 0.1 } * s.semi_diameter;
    // A part off the vertex has its own circle, which lies within that of the rim or not.
    let (middle, radius) = s.clear_circle();
    let is_part = middle != DVec2::ZERO;
    let sag = |at: DVec2| s.profile.sag(at.x, at.y);
    let edge = sag(DVec2::Y * s.semi_diameter * (1.0 - 1e-9)).unwrap_or(0.0);
    let circle = radius / (std::f64::consts::PI / AROUND as f64).cos();
    let rim = (0..AROUND).flat_map(|i| {
        let at = middle + DVec2::from_angle(std::f64::consts::TAU * i as f64 / AROUND as f64) * circle;
        if is_part { [at.extend(sag(at).unwrap_or(edge)); 2] } else { [at.extend(edge), at.extend(0.0)] }
    });
    let ends = if is_part { [middle.extend(sag(middle).unwrap_or(edge)); 2] } else { [DVec3::ZERO, DVec3::Z * edge] };
    let places = rim.chain(ends).map(|local| frame.0.transform_point3(local));
    let ([near, far], reach) = places.fold(([f64::INFINITY, f64::NEG_INFINITY], 0.0f64), |([near, far], reach), p| {
        let distance = (film_z - p.z) * run;
        ([near.min(distance), far.max(distance)], reach.max(p.truncate().length()))
    });
    ([near - room, far + room], reach + room)
}

/// Sets zoom (mm), aperture (f-number; fully open without), iris shape and film. Fails on what the lens cannot do, saying what it
/// can.
pub fn configure(
    p: &Prescription,
    focal_length: Option<f64>,
    f_number: Option<f64>,
    iris: Option<&Iris>,
    film: FilmPlace,
) -> Result<Configured, LensError> {
    configure_turned(p, focal_length, f_number, iris, film, Tilt::default())
}

/// The same of a lens that is turned against its film; the aperture is that of the lens on its own axis.
pub(super) fn configure_turned(
    p: &Prescription,
    focal_length: Option<f64>,
    f_number: Option<f64>,
    iris: Option<&Iris>,
    film: FilmPlace,
    tilt: Tilt,
) -> Result<Configured, LensError> {
    let range = |what, found: String, expected: String| Err(LensError::Setting { what, found, expected });
    let zoom = zoom_position(p, focal_length)?;
    let far = System::at(p, State { zoom, focus: 0.0 });
    let efl = focal_length_of(p, &far);
    if !(efl.abs() > 1e-3 && efl.abs() < 1e6) {
        return range(
            "lens",
            format!("\"{}\"", p.name),
            "a lens with a focal length: it is afocal (a telescope, a relay of two lenses), and what is far away has no image"
                .into(),
        );
    }
    if efl < 0.0 {
        let expected = "a positive focal length: lenses whose image of what is far away is virtual (diverging ones) or upright (relays, Gregorians) are not taken";
        return range("lens", format!("\"{}\" ({efl:.2} mm)", p.name), expected.into());
    }
    let (widest, by_rims) = widest_f_number(p, &far, efl).ok_or_else(|| LensError::Setting {
        what: "lens",
        found: format!("\"{}\"", p.name),
        expected: match far.object_axis.is_some() {
            true => "a lens that light along its base ray can pass: rims or openings stop it".into(),
            false => "a lens that light on the axis can pass".into(),
        },
    })?;
    let f_number = match f_number {
        None => widest,
        Some(asked) if !(asked > 0.0 && asked.is_finite()) => {
            return range("aperture", format!("f/{asked}"), "a positive number such as f/2.8".into());
        }
        // The f-number it is sold under is always granted: fully open is what it stands for.
        Some(asked) if asked * NAME_TOLERANCE < widest && p.f_number.is_none_or(|stated| asked < 0.99 * stated) => {
            return range(
                "aperture",
                format!("f/{asked}"),
                format!("f/{widest:.2} or a larger number: this lens opens no wider"),
            );
        }
        Some(asked) => asked.max(widest),
    };
    let mut opening = far.iris.clone();
    if let Some(shape) = iris {
        opening.shape = shape.clone();
    }
    let beam_radius = match stop_radius(&far, efl, f_number) {
        Some(radius) => radius.min(opening.radius),
        None if f_number <= widest => opening.radius,
        None => {
            let expected = "a lens whose axial beam meets its stop: it is too far off the axis to be closed";
            return range("aperture", format!("f/{f_number}"), expected.into());
        }
    };
    // Fully open a rim may limit the axial beam: the iris is then drawn back to the prescription's own stop, which beams from beside the
    // axis fill further than the axial beam does. An aperture picture stays around the disk of the f-number.
    let picture = matches!(opening.shape, Iris::Image(_));
    let radius = if by_rims && f_number <= widest && !picture { opening.radius } else { beam_radius };
    let opening = self::opening(opening.shape, radius, far.surfaces[far.stop].semi_diameter);
    let (system, state) = match film {
        // Nothing to focus: the film stays.
        FilmPlace::Focused(_) if p.is_openings_alone() => {
            let mut system = System { iris: opening, ..far };
            let pivot_z = system.surfaces[system.stop].z;
            tilt.apply(&mut system, pivot_z);
            (system, State { zoom, focus: 0.0 })
        }
        FilmPlace::Focused(focus) => focused(p, zoom, &opening, focus, tilt)?,
        FilmPlace::AsPublished => (System { iris: opening, ..far }, State { zoom, focus: 0.0 }),
    };
    Ok(Configured { system, state, efl, f_number, widest, beam_radius })
}

/// Smallest f-number at which an axial beam from infinity passes every rim, not smaller than the prescription states; and whether it is the
/// rims that set it.
pub(crate) fn widest_f_number(p: &Prescription, system: &System, efl: f64) -> Option<(f64, bool)> {
    let radius = f_number::widest_radius(system, &system.reference_indices(), efl)?;
    let rims = efl.abs() / (2.0 * radius);
    // Zooms state the f-number of one end: the other is as its rims say.
    let stated = p.f_number.filter(|_| p.zoom.len() < 2 || rims < p.f_number.unwrap_or(0.0));
    Some(stated.map_or((rims, true), |stated| (rims.max(stated), rims >= stated)))
}

/// Radius at the stop of the real axial beam of an f-number.
pub(crate) fn stop_radius(system: &System, efl: f64, f_number: f64) -> Option<f64> {
    f_number::stop_radius(system, &system.reference_indices(), efl, 0.5 * efl.abs() / f_number)
}

/// The opening of a stop: blades that are drawn back behind its rim leave a round hole.
pub(crate) fn opening(shape: Iris, radius: f64, rim: f64) -> crate::system::StopOpening {
    let Iris::Blades(b) = &shape else { return crate::system::StopOpening { shape, radius } };
    // Area of polygon ∩ rim for a polygon of equal-area radius r.
    let area = |r: f64| {
        const STEPS: usize = 2000;
        let sum: f64 = (0..STEPS)
            .map(|i| {
                let d = DVec2::from_angle(std::f64::consts::TAU * i as f64 / STEPS as f64);
                let side = |e: &[f64; 3]| {
                    let along = d.x * e[0] + d.y * e[1];
                    if along > 0.0 { e[2] * r / along } else { f64::INFINITY }
                };
                b.edges().iter().map(side).fold(rim, f64::min).powi(2)
            })
            .sum();
        0.5 * sum * std::f64::consts::TAU / STEPS as f64
    };
    let wanted = std::f64::consts::PI * radius * radius;
    if radius > rim * 0.9999 {
        return crate::system::StopOpening { shape: Iris::Round, radius: rim };
    }
    let (mut low, mut high) = (radius, 2.5 * radius);
    for _ in 0..40 {
        let mid = 0.5 * (low + high);
        if area(mid) < wanted { low = mid } else { high = mid }
    }
    crate::system::StopOpening { radius: 0.5 * (low + high), shape }
}

/// Distance from the entrance pupil that a lens with focus data is focused to at their near end (paraxially), mm.
pub fn nearest_focus(p: &Prescription, zoom: f64) -> Option<f64> {
    let s = System::at(p, State { zoom, focus: 1.0 });
    let f = FirstOrder::of(&s, &s.reference_indices());
    let behind = (s.film_z - s.last_z() - f.bfl) * s.film_run();
    // Newton: x x' = f², counted from the focal points.
    let distance = f.entrance_pupil_z - f.ffl + f.efl * f.efl / behind;
    (p.has_focus_data() && behind > 0.0 && distance > 0.0).then_some(distance)
}

/// Where, along the light from the film on, the image of a plane lies that is not behind the last surface: infinitely far behind the film where the plane is nearer than
/// the front focal point, and before it where a lens that is focused much nearer makes the image within itself.
fn unreal_image(s: &System, focus: Focus) -> f64 {
    let f = FirstOrder::of(s, &s.reference_indices());
    match focus {
        Focus::Distance(Millimeters(d)) if f.entrance_pupil_z - d >= f.ffl => f64::INFINITY,
        _ => f64::NEG_INFINITY,
    }
}

/// The system focused: gaps by the lens's focus data where it has any, the rest by moving the film.
fn focused(
    p: &Prescription,
    zoom: f64,
    iris: &crate::system::StopOpening,
    focus: Focus,
    tilt: Tilt,
) -> Result<(System, State), LensError> {
    // Frames do not change first-order data: those of a turned system are of the lens on its own axis.
    let turned_of = |s: &System| Turned::new(s, FirstOrder::of(s, &s.reference_indices()), false, tilt);
    turned_of(&System::at(p, State { zoom, focus: 0.0 }))?;
    let at = |t: f64| {
        let mut s = System::at(p, State { zoom, focus: t });
        s.iris = iris.clone();
        if !tilt.is_none() {
            let pivot_z = FirstOrder::of(&s, &s.reference_indices()).rear_principal_z;
            tilt.apply(&mut s, pivot_z);
        }
        s
    };
    if let Focus::Extension(Millimeters(e)) = focus {
        if !e.is_finite() {
            let expected = "a finite length in mm".into();
            return Err(LensError::Setting { what: "extension", found: format!("{e} mm"), expected });
        }
        let far = at(0.0);
        if p.has_focus_data() && e > 0.0 {
            let distance = turned_of(&far)?.distance_of(e);
            return focused(p, zoom, iris, Focus::Distance(Millimeters(distance)), tilt);
        }
        let (mut system, state) = focused(p, zoom, iris, Focus::Infinity, tilt)?;
        system.film_z += e * system.film_run();
        return Ok((system, state));
    }
    let impossible = |expected: String| LensError::Setting {
        what: "focus",
        found: match focus {
            Focus::Infinity => "infinity".into(),
            // To a micrometre: distances that were found have all digits.
            Focus::Distance(d) | Focus::Extension(d) => format!("{} mm", (d.0 * 1e3).round() / 1e3),
        },
        expected,
    };
    // How far behind the place the data gives the film, along the light, the best place lies; and that place.
    let offset = |s: &System| {
        let object = match focus {
            Focus::Infinity | Focus::Extension(_) => None,
            Focus::Distance(Millimeters(d)) => Some(turned_of(s).ok()?.entrance_pupil() - DVec3::Z * d),
        };
        let z = AxialSpot::of_point(s, object)?.best_z;
        let run = s.film_run();
        ((z - s.last_z()) * run > 0.0).then_some(((z - s.film_z) * run, z))
    };
    if let Focus::Distance(Millimeters(d)) = focus
        && !(d > 0.0 && d.is_finite())
    {
        return Err(impossible("a positive distance such as 2.5m, or inf".into()));
    }
    let no_image = || match focus {
        Focus::Distance(_) => {
            let s = at(0.0);
            let f = FirstOrder::of(&s, &s.reference_indices());
            let nearest = f.entrance_pupil_z - f.ffl;
            impossible(format!("more than about {nearest:.0} mm from the lens: nearer planes have no image"))
        }
        Focus::Infinity | Focus::Extension(_) => {
            impossible("a lens that forms a real image of distant objects behind its last surface".into())
        }
    };
    let mut t = 0.0;
    if p.has_focus_data() && focus != Focus::Infinity {
        // The film stays; the groups move until it lies in the best plane.
        let value = |t: f64| {
            let s = at(t);
            offset(&s).map_or_else(|| unreal_image(&s, focus), |o| o.0)
        };
        let far = value(0.0);
        // The end of the scale is itself a best plane of a distance; a little beyond it is allowed.
        const END: f64 = 1.02;
        let near = value(END);
        if far > 0.0 && near > 0.0 {
            return Err(impossible(match nearest_focus(p, zoom) {
                Some(nearest) => format!("{nearest:.0} mm from the entrance pupil or more: the lens focuses no nearer"),
                None => "a distance that the lens focuses to".into(),
            }));
        }
        // Otherwise beyond infinity by the rounding of the figures: there the scale ends.
        if (far > 0.0) != (near > 0.0) {
            let (mut low, mut high) = (0.0, END);
            for _ in 0..40 {
                let mid = 0.5 * (low + high);
                if (value(mid) > 0.0) == (far > 0.0) { low = mid } else { high = mid }
            }
            t = 0.5 * (low + high);
        }
    }
    let mut system = at(t);
    let (_, z) = offset(&system).ok_or_else(no_image)?;
    if (z - system.last_z()).abs() > 50.0 * (FirstOrder::of(&system, &system.reference_indices()).efl.abs() + 1.0) {
        return Err(no_image());
    }
    system.film_z = z;
    Ok((system, State { zoom, focus: t }))
}

#[cfg(test)]
mod image_circle_tests {
    use super::super::{CompoundLens, Setting};
    use super::*;
    use crate::glass::D_NM;
    use crate::{embedded, embedded_names};
    use std::sync::Arc;

    /// Lenses whose rims, estimated by those who collected the patents, stop the light before the stated image circle ends, with the height
    /// (mm) to which they are lit. Their chief rays go on when rims are ignored: the shapes are right, the semi-diameters too small.
    const DARK: [(&str, f64); 6] = [
        ("angenieux-50mm-f1.1", 20.9),
        ("biogon-21mm-f4.5", 15.3),
        ("fisheye-10.5mm-f2.8", 12.2),
        ("fisheye-15mm-f2.8", 15.6),
        ("rf-16mm-f2.8", 15.3),
        ("zoom-14-30mm-f4", 19.3),
    ];

    #[test]
    fn image_circles_are_lit_as_far_as_is_known() {
        let mut wrong = vec![];
        for (name, p) in embedded_names().filter_map(|name| Some((name, embedded(name)?))) {
            let Some(radius) = p.image_circle.map(|circle| 0.5 * circle) else { continue };
            let set = configure(&p, None, None, None, FilmPlace::AsPublished).unwrap();
            let lit = set.image_circle_radius(radius).unwrap();
            let dark = DARK.iter().find(|d| d.0 == name);
            println!("{name:<24} lit to {lit:.2} mm of {radius:.2}");
            // The circle itself may fall to nothing within 2 %; of those known to be dark the height holds within 1.5 mm.
            let expected = match dark {
                None => lit >= 0.98 * radius,
                Some((_, height)) => (lit - height).abs() < 1.5 && lit < 0.98 * radius,
            };
            if !expected {
                wrong.push(format!("{name}: lit to {lit:.2} mm of {radius:.2}"));
            }
        }
        assert!(wrong.is_empty(), "{wrong:#?}");
    }

    #[test]
    fn the_lit_radius_is_where_the_bench_finds_no_light() {
        let p = embedded("biogon-21mm-f4.5").unwrap();
        let set = configure(&p, None, None, None, FilmPlace::AsPublished).unwrap();
        let lit = set.image_circle_radius(21.6).unwrap();
        let bench = crate::analysis::Bench::at_infinity(&set.system);
        // Bisected to 21.6 / 512 = 0.04 mm; a sliver narrower than 1/128 of the rim grows to that width within 0.3 mm.
        assert!(bench.illumination(lit - 0.6, D_NM).geometric > 0.0, "{lit}");
        assert_eq!(bench.illumination(lit + 0.6, D_NM).geometric, 0.0, "{lit}");
        // Within what is lit the answer is what was asked.
        assert_eq!(set.image_circle_radius(5.0), Some(5.0));
        // The lens of the camera finds the same in every direction.
        let focus = Focus::Infinity;
        let setting = Setting { focal_length: None, f_number: None, focus, iris: None, film_mm: [36.0, 24.0] };
        let lens = CompoundLens::new(Arc::new(p), &setting).unwrap();
        for angle in [0.0, 0.6, 2.0] {
            let there = lens.image_circle_radius(DVec2::from_angle(angle), 21.6);
            assert!((there - lit).abs() < 0.5, "{angle}: {there} {lit}");
        }
    }
}

#[cfg(test)]
mod focus_tests {
    use super::super::{CompoundLens, Setting};
    use super::*;
    use crate::embedded;
    use crate::pupil::PupilDetail;
    use std::sync::Arc;

    fn lens(name: &str, focus: Focus) -> CompoundLens {
        let setting = Setting { focal_length: None, f_number: Some(8.0), focus, iris: None, film_mm: [36.0, 24.0] };
        CompoundLens::new(Arc::new(embedded(name).unwrap()), &setting).unwrap()
    }

    #[test]
    fn an_extension_is_the_film_moved_back() {
        let far = lens("double-gauss-50mm", Focus::Infinity);
        let back = far.refocused(Focus::Extension(Millimeters(1.25))).unwrap();
        assert!((back.system().film_z - far.system().film_z - 1.25).abs() < 1e-9);
        // Set to the distance that this stands for, the lens puts its film there but for the change of its aberrations.
        let d = back.focus_distance().unwrap();
        let there = far.refocused(Focus::Distance(d)).unwrap();
        assert!((there.system().film_z - back.system().film_z).abs() < 0.01, "{}", there.system().film_z - back.system().film_z);
        assert!((there.extension().0 - 1.25).abs() < 1e-9);
    }

    #[test]
    fn a_film_moved_quickly_sees_what_one_moved_with_care_does() {
        for name in ["double-gauss-50mm", "fisheye-10mm", "telephoto-250mm"] {
            let far = lens(name, Focus::Infinity);
            let e = 0.03 * far.focal_length().0;
            let (quick, slow) = (far.with_extension(e).unwrap(), far.refocused(Focus::Extension(Millimeters(e))).unwrap());
            assert!((quick.system().film_z - slow.system().film_z).abs() < 1e-9);
            assert!(far.with_extension(f64::INFINITY).is_err() && far.with_extension(f64::NAN).is_err(), "{name}");
            for height in [0.0, 4.0, 9.0] {
                let film = DVec2::new(height, 0.3 * height);
                let light = |lens: &CompoundLens| {
                    let n = 256;
                    let ray =
                        |i: usize| lens.ray(film, [(i % n) as f32 + 0.5, (i / n) as f32 + 0.5].map(|v| v / n as f32), 550.0);
                    (0..n * n).filter_map(|i| ray(i).ok()).map(|r| r.weight_sr).sum::<f64>() / (n * n) as f64
                };
                let (a, b) = (light(&quick), light(&slow));
                assert!((a / b - 1.0).abs() < 0.004, "{name} at {height} mm: {a} {b}");
            }
        }
    }

    #[test]
    fn a_draft_of_the_pupil_lets_the_same_light_pass() {
        // Fully open, where rims cut the pupil, with a round iris and one of few, straight blades.
        for (name, blades) in [("double-gauss-50mm", None), ("double-gauss-50mm", Some(5)), ("fisheye-10mm", None)] {
            let iris = blades.map(|count| crate::Iris::blades(count, 0.0, 0.0).unwrap());
            let setting = Setting {
                focal_length: None,
                f_number: blades.map(|_| 4.0),
                focus: Focus::Infinity,
                iris,
                film_mm: [36.0, 24.0],
            };
            let prescription = Arc::new(embedded(name).unwrap());
            let full = CompoundLens::new(prescription.clone(), &setting).unwrap();
            let draft = CompoundLens::with_detail(prescription, &setting, PupilDetail::Draft).unwrap();
            for film in [DVec2::new(1.3, 0.4), DVec2::new(7.1, 2.9), DVec2::new(-11.3, 8.2), DVec2::new(16.9, -10.7)] {
                let light = |lens: &CompoundLens| {
                    let n = 256;
                    let ray =
                        |i: usize| lens.ray(film, [(i % n) as f32 + 0.5, (i / n) as f32 + 0.5].map(|v| v / n as f32), 550.0);
                    (0..n * n).filter_map(|i| ray(i).ok()).map(|r| r.weight_sr).sum::<f64>() / (n * n) as f64
                };
                let (a, b) = (light(&draft), light(&full));
                // A grid of 256² tells an area within some 1/256 of its rim where its shape is cut: as for films that are moved quickly.
                assert!((a - b).abs() < 0.005 * b + 1e-9, "{name} {blades:?} at {film}: {a} {b}");
            }
            // It keeps to that when it is set otherwise.
            assert_eq!(draft.refocused(Focus::Extension(Millimeters(1.0))).unwrap().detail, PupilDetail::Draft);
        }
    }

    /// How far the film stands from where the groups want it (mm), the focal length, and the magnification, of a lens focused at a distance (mm).
    fn focused_at(name: &str, distance: f64) -> Result<(f64, f64, f64), LensError> {
        let p = embedded(name).unwrap();
        let set = configure(&p, None, None, None, FilmPlace::Focused(Focus::at_mm(distance)))?;
        let f = FirstOrder::of(&set.system, &set.system.reference_indices());
        let published = System::at(&p, set.state).film_z;
        Ok((set.system.film_z - published, f.efl, f.front_focal_length() / (distance - f.entrance_pupil_z + f.ffl)))
    }

    #[test]
    fn groups_focus_also_where_the_nearest_setting_has_no_real_image_of_what_is_far() {
        // At their near ends the macro lens makes the image of far things within itself, and the far end of the mirror lens none of near things.
        for name in ["macro-100mm-f2.8", "reflex-500mm-f8"] {
            let p = embedded(name).unwrap();
            let nearest = nearest_focus(&p, 0.0).unwrap();
            let mut last = f64::INFINITY;
            for times in [1.0, 1.2, 1.7, 2.5, 4.0, 10.0] {
                let (moved, _, magnification) =
                    focused_at(name, times * nearest).unwrap_or_else(|e| panic!("{name} {times}: {e}"));
                assert!(moved.abs() < 0.5, "{name} at {times} times {nearest:.0} mm: film moved by {moved}");
                assert!(magnification > 0.0 && magnification < last, "{name} {times}: {magnification} after {last}");
                last = magnification;
            }
            let e = focused_at(name, 0.7 * nearest).unwrap_err().to_string();
            assert!(e.contains("focuses no nearer"), "{name}: {e}");
        }
        let (_, efl, magnification) =
            focused_at("macro-100mm-f2.8", nearest_focus(&embedded("macro-100mm-f2.8").unwrap(), 0.0).unwrap()).unwrap();
        assert!(efl < 50.0 && magnification > 1.0, "its focal length shrinks as it goes beyond life size: {efl} {magnification}");
    }
}
