//! Ghosts of four reflections: of all that there are, those that come near the strongest of two.
//!
//! A lens of twenty surfaces has tens of thousands of them, nearly all far too weak to be seen: a reflection takes 96 to 99.5 % of the light. They are chosen by what first order knows: the
//! product of their reflectances, then the light on the axis over the area of the ghost.

use super::{GhostTracer, ParaxialGhost, pairs, reflects};

/// Ways that are looked at to first order, those with the largest product of reflectances.
const LOOKED_AT: usize = 2000;
/// Surfaces among which they are sought: those that reflect most.
const MOST_SURFACES: usize = 48;
/// Radius (mm) below which a ghost counts as no smaller: aberrations keep it from being a point.
const SMALLEST_MM: f64 = 0.05;

/// Four surfaces at which light is thrown back one after the other, towards the object first; the number of all surfaces: the sensor.
pub type Four = [usize; 4];

/// Ghosts of four reflections whose irradiance on the axis, to first order, is at least `fraction` of that of the strongest ghost of two; the strongest first, at most `most`.
pub fn strong_fours(tracer: &GhostTracer, fraction: f64, most: usize) -> Vec<Four> {
    let system = tracer.system();
    let count = system.surfaces.len();
    let irradiance = |turns: &[usize]| {
        let ghost = ParaxialGhost::of(tracer, turns)?;
        let radius = ghost.radius_mm().max(SMALLEST_MM);
        Some(ghost.fraction * (ghost.pupil_radius_mm / radius).powi(2)).filter(|v| v.is_finite())
    };
    let strongest = pairs(system).iter().filter_map(|p| irradiance(&[p.back, p.forth])).fold(0.0, f64::max);
    if strongest <= 0.0 || most == 0 {
        return vec![];
    }
    let reflectance: Vec<f64> = (0..=count).map(|i| tracer.axial_reflectance(i)).collect();
    let mut all: Vec<usize> = (0..count).filter(|i| reflects(system, *i)).chain([count]).collect();
    all.sort_by(|a, b| reflectance[*b].total_cmp(&reflectance[*a]));
    all.truncate(MOST_SURFACES);
    let mut found: Vec<(f64, Four)> = vec![];
    let strongest_first = |a: &(f64, Four), b: &(f64, Four)| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1));
    for &forth in &all {
        let behind = |i: &&usize| **i > forth;
        for &first in all.iter().filter(behind) {
            for &back in all.iter().filter(behind) {
                let three = reflectance[first] * reflectance[forth] * reflectance[back];
                found.extend(
                    all.iter().filter(|i| **i < back).map(|last| (three * reflectance[*last], [first, forth, back, *last])),
                );
                // No more than what is looked at is kept.
                if found.len() > 4 * LOOKED_AT {
                    found.select_nth_unstable_by(LOOKED_AT, strongest_first);
                    found.truncate(LOOKED_AT);
                }
            }
        }
    }
    found.sort_by(strongest_first);
    found.truncate(LOOKED_AT);
    let mut strong: Vec<(f64, Four)> = found
        .into_iter()
        .filter_map(|(_, four)| Some((irradiance(&four)?, four)))
        .filter(|(value, _)| *value >= fraction * strongest)
        .collect();
    strong.sort_by(strongest_first);
    strong.truncate(most);
    strong.into_iter().map(|(_, four)| four).collect()
}
