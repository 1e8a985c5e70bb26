//! What a lens as it stands would have measured: by the bench, in the plane of each row's direction on the film.

use super::illumination::Light;
use super::sheet::{AZIMUTH_DEG, Origin};
use super::{Place, Row, Table};
use crate::analysis::{Beam, Bench};
use crate::iris::Iris;
use crate::system::System;
use crate::trace::at_plane;
use glam::{DAffine3, DQuat, DVec2, DVec3};
use rayon::prelude::*;

/// How near to a height (mm) a chief ray is brought.
const HEIGHT_TOLERANCE: f64 = 1e-9;
/// Steps of the secant method.
const MOST_STEPS: usize = 40;

/// What predictions take besides the lens.
#[derive(Clone, Debug)]
pub(super) struct Conditions {
    /// Distance in focus from the entrance pupil, mm; `None` for infinity.
    pub distance: Option<f64>,
    /// Wavelengths (nm) with weights.
    pub colors: Vec<(f64, f64)>,
    /// Number of that of distortion and illumination.
    pub reference: usize,
    /// What the heights of the distortion table count from.
    pub origin: Origin,
    /// Focal length that per cents are held against, mm.
    pub focal_mm: Option<f64>,
    /// Contrasts of spots alone.
    pub geometric: bool,
}

/// Rows at one place, which share their rays.
#[derive(Clone, Debug)]
pub(super) struct Group {
    azimuth_deg: f64,
    place: Place,
    rows: Vec<usize>,
}

/// Rows by their places.
pub(super) fn groups(rows: &[Row]) -> Vec<Group> {
    let mut all: Vec<Group> = vec![];
    for (i, row) in rows.iter().enumerate() {
        let (azimuth_deg, place) = (row.measured.azimuth_deg, row.measured.place);
        match all.iter_mut().find(|g| g.azimuth_deg == azimuth_deg && g.place == place) {
            Some(group) => group.rows.push(i),
            None => all.push(Group { azimuth_deg, place, rows: vec![i] }),
        }
    }
    all
}

/// A system turned about the axis, degrees from +x towards +y.
fn turned(system: &System, angle_deg: f64) -> System {
    let turn = DAffine3::from_quat(DQuat::from_rotation_z(angle_deg.to_radians()));
    let mut system = system.clone();
    let blades = !matches!(system.iris.shape, Iris::Round);
    for (i, s) in system.surfaces.iter_mut().enumerate() {
        let round = s.profile.is_rotational()
            && s.apertures.is_empty()
            && s.diffractive.as_ref().is_none_or(|d| d.phase().is_rotational())
            && !(blades && i == system.stop);
        if s.frame.is_none() && round {
            continue;
        }
        let before = s.frame.as_ref().map_or(DAffine3::from_translation(DVec3::new(0.0, 0.0, s.z)), |f| f.0);
        let frame = turn * before;
        s.frame = Some(Box::new((frame, frame.inverse())));
    }
    system
}

/// What each row would read; `None` where the lens does not see its place.
pub(super) fn predict(system: &System, conditions: &Conditions, rows: &[Row], groups: &[Group]) -> Vec<Option<f64>> {
    let same = system.is_rotational() && matches!(system.iris.shape, Iris::Round);
    let mut azimuths: Vec<f64> = vec![];
    for g in groups {
        if !same && !azimuths.contains(&g.azimuth_deg) {
            azimuths.push(g.azimuth_deg);
        }
    }
    let systems: Vec<(f64, System)> = azimuths.iter().map(|a| (*a, turned(system, AZIMUTH_DEG - a))).collect();
    let middle = groups.iter().any(|g| g.rows.iter().any(|i| rows[*i].measured.table.is_illumination()));
    let middle = middle.then(|| {
        let bench = bench_of(system, conditions);
        bench.chief_beam(0.0, conditions.colors[conditions.reference].0).map_or(0.0, |b| light(&bench, conditions, 0.0, &b))
    });
    let found: Vec<Vec<(usize, Option<f64>)>> = groups
        .par_iter()
        .map(|g| {
            let system = systems.iter().find(|s| s.0 == g.azimuth_deg).map_or(system, |s| &s.1);
            at_place(&bench_of(system, conditions), conditions, rows, g, middle.unwrap_or(0.0))
        })
        .collect();
    let mut all = vec![None; rows.len()];
    for (i, value) in found.into_iter().flatten() {
        all[i] = value.filter(|v: &f64| v.is_finite());
    }
    all
}

fn bench_of<'a>(system: &'a System, conditions: &Conditions) -> Bench<'a> {
    let nm = conditions.colors[conditions.reference].0;
    let entrance = || crate::paraxial::FirstOrder::of(system, &system.indices(nm)).entrance_pupil_z;
    Bench { system, object_distance: conditions.distance.map(|d| d - entrance()) }
}

/// Light at a height whose chief ray is known, sr.
fn light(bench: &Bench, conditions: &Conditions, height: f64, beam: &Beam) -> f64 {
    let direction = beam.image.direction;
    let near = -direction.truncate() / direction.z.abs();
    Light::new(bench.system, conditions.colors[conditions.reference].0).irradiance(DVec2::new(0.0, height), near)
}

fn at_place(bench: &Bench, conditions: &Conditions, rows: &[Row], group: &Group, middle: f64) -> Vec<(usize, Option<f64>)> {
    let nm = conditions.colors[conditions.reference].0;
    let height = |beam: &Beam| at_plane(&beam.image, bench.system.film_z).y;
    let contrasts = contrasts(bench, conditions, rows, group);
    // Height of the image of the axis, where that counts.
    let axis = |origin: Origin| match origin {
        Origin::FilmMiddle => Some(0.0),
        Origin::PrincipalPoint => bench.chief_beam(0.0, nm).map(|b| height(&b)),
    };
    let one = |i: usize| -> Option<f64> {
        let from_axis = |origin: Origin, field: f64| Some(height(&bench.chief_beam(field, nm)?) - axis(origin)?);
        match (rows[i].measured.table, group.place) {
            (Table::Percent, place) => {
                let field = match place {
                    Place::Field(f) => f,
                    Place::Height(h) => field_of(bench, h + axis(conditions.origin)?, nm)?.0,
                };
                let point = bench.field_point(field, nm)?;
                let against = conditions.focal_mm.map_or(1.0, |f| f / bench.first_order(nm).efl);
                Some(((1.0 + 0.01 * point.distortion_percent()) / against - 1.0) * 100.0)
            }
            (Table::Height, Place::Field(f)) => from_axis(conditions.origin, f),
            (Table::CalibratedFromAxis, Place::Field(f)) => from_axis(Origin::PrincipalPoint, f),
            (Table::Calibrated, Place::Field(f)) => from_axis(Origin::FilmMiddle, f),
            (Table::Relative | Table::Ev, Place::Height(h)) => {
                let (_, beam) = field_of(bench, h, nm)?;
                let relative = light(bench, conditions, h, &beam) / middle;
                // Darkness has no logarithm: as dark as a file may say.
                Some(if rows[i].measured.table == Table::Ev { relative.max(2f64.powi(-16)).log2() } else { relative })
            }
            _ => None,
        }
    };
    group
        .rows
        .iter()
        .map(|i| match rows[*i].measured.table {
            Table::Contrast { frequency, tangential } => {
                let found = contrasts.iter().find(|c| c.0 == frequency);
                (*i, found.map(|c| c.1[tangential as usize]))
            }
            _ => (*i, one(*i)),
        })
        .collect()
}

/// Contrasts of a group's frequencies: sagittal, tangential.
fn contrasts(bench: &Bench, conditions: &Conditions, rows: &[Row], group: &Group) -> Vec<(f64, [f64; 2])> {
    let mut frequencies: Vec<f64> = vec![];
    for i in &group.rows {
        if let Table::Contrast { frequency, .. } = rows[*i].measured.table
            && !frequencies.contains(&frequency)
        {
            frequencies.push(frequency);
        }
    }
    let Place::Height(height) = group.place else { return vec![] };
    if frequencies.is_empty() {
        return vec![];
    }
    let nm = conditions.colors[conditions.reference].0;
    let Some((field, _)) = field_of(bench, height, nm) else { return vec![] };
    let found = match conditions.geometric {
        true => bench.geometric_mtf(field, &conditions.colors, &frequencies, 0.0),
        false => bench.diffraction_mtf(field, &conditions.colors, &frequencies, 0.0),
    };
    let Some(mtf) = found else { return vec![] };
    frequencies.into_iter().enumerate().map(|(k, f)| (f, [mtf.sagittal[k], mtf.tangential[k]])).collect()
}

/// The field angle (degrees) whose chief ray lands at a height on the film (mm), and its beam: by the secant method from the axis. `None` where none
/// does.
fn field_of(bench: &Bench, height: f64, nm: f64) -> Option<(f64, Beam)> {
    let at = |field: f64| {
        let beam = bench.chief_beam(field, nm)?;
        let y = at_plane(&beam.image, bench.system.film_z).y;
        Some((beam, y - height))
    };
    let (beam, off) = at(0.0)?;
    if off.abs() < HEIGHT_TOLERANCE {
        return Some((0.0, beam));
    }
    let mut before = (0.0, off);
    let mut field = (-off / bench.first_order(nm).efl).atan().to_degrees();
    for _ in 0..MOST_STEPS {
        let Some((beam, off)) = at(field) else {
            // Too far out: half way back.
            field = 0.5 * (field + before.0);
            continue;
        };
        if off.abs() < HEIGHT_TOLERANCE {
            return Some((field, beam));
        }
        let next = field - off * (field - before.0) / (off - before.1);
        before = (field, off);
        field = if next.is_finite() { next.clamp(field - 30.0, field + 30.0) } else { return None };
    }
    // Where a secant does not settle, the slow search.
    let field = bench.field_of_height(height.abs()) * height.signum();
    at(field).filter(|(_, off)| off.abs() < 1e-6).map(|(beam, _)| (field, beam))
}
