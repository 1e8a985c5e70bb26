//! Mirrors off the axis, laid out about their base ray.
//!
//! Schiefspiegler, off-axis paraboloids and three-mirror anastigmats have no axis from object to film. What they have is a base ray: from the middle of the field through the
//! middle of the stop to the film. The film's normal through the place where it lands is taken for the z along which surfaces are counted, every surface
//! stands in a frame of its own, and the base ray before the lens becomes the axis of the object ([`ObjectAxis`]).

use super::placed::{Placed, half_turn, rounded, tilts};
use crate::at_stop::{chief_from, place_at_stop};
use crate::prescription::{Gap, Misalignment, ObjectAxis, Prescription};
use crate::ray::{Apertures, TraceDirection, TracedRay};
use crate::system::{State, System};
use crate::trace::Event;
use glam::{DAffine3, DMat3, DVec2, DVec3};

/// Places along x and y from which the base ray is looked for.
const GRID: usize = 41;
/// Farthest from the origin of the file that it is looked for where no surface has a size, mm.
const WITHOUT_SIZES_MM: f64 = 500.0;
/// Step of a place before the lens in which the turn of the picture is seen, mm.
const STEP_MM: f64 = 1e-3;

/// Middle of the fields in y, degrees.
pub(super) fn middle_of_fields(p: &Prescription) -> f64 {
    let fields = &p.usage.field_angles_deg;
    let (low, high) = fields.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), f| (a.min(*f), b.max(*f)));
    // Fields on one side alone are the half of a round picture, but where none is on the axis.
    if low * high > 0.0 { 0.5 * (low + high) } else { 0.0 }
}

/// Writes surfaces, film, object axis and notes into `p`, if there is a base ray; gives the rows back where there is none.
pub(super) fn lay_out(rows: Vec<Placed>, film: DAffine3, p: &mut Prescription) -> Result<(), Vec<Placed>> {
    let field = middle_of_fields(p);
    let Some(found) = BaseRay::of(&rows, film, field, p) else { return Err(rows) };
    let count = rows.len();
    let z = |i: usize| found.places.get(i).map_or(found.film_z, |place| place.z);
    for (i, row) in rows.into_iter().enumerate() {
        let mut row = Placed { frame: found.lens.inverse() * row.frame, ..row };
        // Light runs along the local z as the number of mirrors before it says.
        if row.frame.matrix3.z_axis.dot(found.before[i]) * found.runs[i] < 0.0 {
            row.turn_over();
        }
        let mut surface = row.surface;
        surface.gap = Gap::fixed(rounded(z(i + 1) - z(i)));
        let decenter = row.frame.translation - DVec3::Z * z(i);
        let tilt = tilts(&row.frame.matrix3, surface.looks_round());
        p.misalignments.push(Misalignment { first: i, last: i, decenter: decenter.to_array().map(rounded), tilt });
        p.surfaces.push(surface);
    }
    let axis = &found.axis;
    p.object_axis = Some(ObjectAxis { decenter: axis.translation.to_array().map(rounded), tilt: tilts(&axis.matrix3, false) });
    p.usage.field_angles_deg.iter_mut().for_each(|f| *f = rounded(*f - field));
    if let Some(d) = &mut p.usage.object_distance {
        *d += found.way_before;
    }
    let aside = if field == 0.0 { String::new() } else { format!(" of the field at {field} degrees, from which fields count") };
    p.notes.push(format!(
        "{count} surfaces off a common axis: the axis is the base ray{aside}, which turns by {:.3} degrees from object to film and meets the film at {:.3} degrees to its normal, \
         {:.4} mm from the middle that the file gives it",
        found.turn_deg, found.askew_deg, found.beside_mm
    ));
    Ok(())
}

/// The base ray of a file's surfaces, and where lens and object stand by it.
struct BaseRay {
    /// The file's coordinates from the lens's.
    lens: DAffine3,
    /// Where each surface is met, in lens space.
    places: Vec<DVec3>,
    /// Directions before each surface there.
    before: Vec<DVec3>,
    /// Way of the light along z before each surface, by the mirrors.
    runs: Vec<f64>,
    film_z: f64,
    /// Lens space from that of the object.
    axis: DAffine3,
    /// What the way from the object to the first surface along the ray is longer than the file's distance of the object, mm.
    way_before: f64,
    turn_deg: f64,
    askew_deg: f64,
    beside_mm: f64,
}

impl BaseRay {
    fn of(rows: &[Placed], film: DAffine3, field_deg: f64, p: &Prescription) -> Option<BaseRay> {
        let mut trial = p.clone();
        trial.surfaces = rows.iter().map(|r| r.surface.clone()).collect();
        if !trial.surfaces.iter().any(|s| s.stop) {
            return None;
        }
        let mut system = System::at(&trial, State::default());
        for (placed, row) in system.surfaces.iter_mut().zip(rows) {
            placed.frame = Some(Box::new((row.frame, row.frame.inverse())));
        }
        let wavelength = p.usage.wavelengths_nm.get(p.usage.reference).copied().unwrap_or(crate::glass::D_NM);
        let n = system.indices(wavelength);
        let angle = field_deg.to_radians();
        let ray = |at: DVec2| match p.usage.object_distance.filter(|d| d.is_finite()) {
            None => TracedRay { position: at.extend(0.0), direction: DVec3::new(0.0, angle.sin(), angle.cos()) },
            Some(d) => TracedRay { position: DVec3::Z * -d, direction: (at.extend(0.0) + DVec3::Z * d).normalize() },
        };
        let at = middle_of_the_stop(&system, &n, rows, ray)?;
        let base = ray(at);
        let mut events: Vec<Event> = vec![];
        let end = system.trace_with(base, &n, TraceDirection::ToFilm, Apertures::Ignore, |e| events.push(e)).ok()?;
        let runs = system.runs.clone();
        let run = system.film_run();
        // The film's normal, on the side from which light comes as the number of mirrors says, through the place where the ray lands.
        let local = film.inverse();
        let (o, d) = (local.transform_point3(end.position), local.transform_vector3(end.direction));
        if d.z.abs() < 0.1 {
            return None;
        }
        let landing = o - d * (o.z / d.z);
        let turn = if d.z * run < 0.0 { half_turn() } else { DAffine3::IDENTITY };
        let on_film = film * DAffine3::from_translation(landing) * turn;
        // Surfaces count from the first.
        let back = on_film.inverse();
        let start = back.transform_point3(events.first()?.point).z;
        let lens = on_film * DAffine3::from_translation(DVec3::Z * start);
        let from_file = lens.inverse();
        let places: Vec<DVec3> = events.iter().map(|e| from_file.transform_point3(e.point)).collect();
        let ways = std::iter::once(base.direction).chain(events.iter().map(|e| e.direction));
        let before: Vec<DVec3> = ways.take(events.len()).map(|d| from_file.transform_vector3(d)).collect();
        let last = from_file.transform_vector3(end.direction);
        // Which way up the picture stands: the directions before the lens that the film's x and y belong to.
        let (u, v) = base.direction.any_orthonormal_pair();
        let slope = |by: DVec3| {
            let moved = TracedRay { position: base.position + by * STEP_MM, ..base };
            let out = system.trace(moved, &n, TraceDirection::ToFilm, Apertures::Ignore).ok()?;
            let d = from_file.transform_vector3(out.direction);
            Some(-(d / d.z.abs() - last / last.z.abs()).truncate() / STEP_MM)
        };
        let power = [slope(u)?, slope(v)?];
        let turn = f64::atan2(power[0].y - power[1].x, power[0].x + power[1].y);
        let (sin, cos) = turn.sin_cos();
        let x = from_file.transform_vector3(u * cos - v * sin);
        let z = before[0];
        let axis = DAffine3 { matrix3: DMat3::from_cols(x, z.cross(x), z), translation: places[0] };
        // From the object; one far away stays there.
        let way_before = match p.usage.object_distance.filter(|d| d.is_finite()) {
            Some(d) => (events[0].point - base.position).length() - d,
            None => 0.0,
        };
        Some(BaseRay {
            film_z: -start,
            places,
            runs,
            axis,
            way_before,
            turn_deg: z.dot(last).clamp(-1.0, 1.0).acos().to_degrees(),
            askew_deg: last.z.abs().min(1.0).acos().to_degrees(),
            beside_mm: landing.truncate().length(),
            before,
            lens,
        })
    }
}

/// Which ray of a family meets the middle of the stop: from the rays of a grid that come nearest to it.
fn middle_of_the_stop(system: &System, n: &[f64], rows: &[Placed], ray: impl Fn(DVec2) -> TracedRay) -> Option<DVec2> {
    let size = |row: &Placed| {
        let openings = row.surface.apertures.iter().filter(|a| !a.blocks()).map(|a| a.reach());
        row.surface.semi_diameter.into_iter().chain(openings).fold(0.0, f64::max)
    };
    let widest = rows.iter().map(size).filter(|s| s.is_finite()).fold(0.0, f64::max);
    // Rays that come in askew start beside what they meet.
    let deep = rows.iter().map(|r| r.frame.translation.length()).fold(0.0, f64::max);
    let direction = ray(DVec2::ZERO).direction;
    let aside = direction.truncate() / direction.z * -deep;
    let half = if widest > 0.0 { 1.5 * widest } else { WITHOUT_SIZES_MM };
    let mut places: Vec<(f64, DVec2)> = vec![];
    for middle in [DVec2::ZERO, aside] {
        for i in 0..GRID * GRID {
            let cell = DVec2::new((i % GRID) as f64, (i / GRID) as f64) * (2.0 / (GRID - 1) as f64) - 1.0;
            let at = middle + cell * half;
            places.extend(place_at_stop(system, n, ray(at)).map(|miss| (miss.length(), at)));
        }
    }
    places.sort_by(|a, b| a.0.total_cmp(&b.0));
    places.iter().take(8).find_map(|(_, at)| {
        let found = chief_from(system, n, *at, &ray)?;
        system.trace(ray(found), n, TraceDirection::ToFilm, Apertures::Ignore).is_ok().then_some(found)
    })
}
