//! Ghosts by paraxial matrices: where they focus, how large they are on the film, what limits them.
//!
//! Heights are counted in the y–z section from the axis, lengths along the light: a surface of curvature c met by light that runs along
//! r = ±1 (in z) bends it by n′u′ = nu − y (n′ − n) c r and reflects it by u′ = u + 2 y c r. Tilts and decentres are left out.

use super::GhostTracer;
use crate::ray::{TraceDirection, TracedRay};
use crate::system::System;
use glam::DVec3;

/// A ghost of a distant source, to first order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParaxialGhost {
    /// Where parallel light is focused, mm behind the film along the light; infinite where it stays parallel.
    pub focus_mm: f64,
    /// Height on the film over height at the first vertex, of parallel light: the size of a ghost is this times its pupil.
    pub spread: f64,
    /// Height on the film over the tangent of the field angle, of light through the middle of the first vertex, mm.
    pub shift_mm: f64,
    /// Radius of the axial beam at the first vertex that passes all rims, mm.
    pub pupil_radius_mm: f64,
    /// Number of the surface whose rim limits it.
    pub pupil_surface: usize,
    /// Fraction of the light along the axis that takes this way.
    pub fraction: f64,
}

impl ParaxialGhost {
    /// First-order data of a ghost at the tracer's wavelength, by the surfaces that reflect it one after the other (as [`GhostTracer::follow`]); `None` where the axis itself is blocked, and of lenses that have none.
    /// Its fraction is not a number for lenses with decentred, obstructed or masked surfaces.
    pub fn of(tracer: &GhostTracer, turns: &[usize]) -> Option<ParaxialGhost> {
        let n = tracer.indices();
        let system = tracer.system();
        // First order of ghosts is of uniform media without phases.
        if system.has_gradients() || system.has_diffractive() || system.object_axis.is_some() {
            return None;
        }
        let axis = TracedRay { position: DVec3::new(0.0, 0.0, -1.0), direction: DVec3::Z };
        let fraction = if system.surfaces.iter().all(|s| s.frame.is_none() && s.obstruction == 0.0 && s.apertures.is_empty()) {
            tracer.follow(axis, turns).ok()?.fraction
        } else {
            f64::NAN
        };
        // Two rays: height 1 without slope, slope 1 without height.
        let (mut y, mut u) = ([1.0, 0.0], [0.0, 1.0]);
        let mut z = system.surfaces.first()?.z;
        let (mut pupil, mut pupil_surface) = (f64::INFINITY, 0);
        walk(system, turns, |at, event| {
            let (place, curvature) = match at {
                Some(i) => (system.surfaces[i].z, system.surfaces[i].section_curvature()),
                None => (system.film_z, 0.0),
            };
            let length = (place - z) * event.run;
            z = place;
            for k in 0..2 {
                y[k] += u[k] * length;
            }
            if let Some(i) = at {
                let surface = &system.surfaces[i];
                let rim = if i == system.stop { surface.semi_diameter.min(system.iris.radius) } else { surface.semi_diameter };
                let limit = rim / y[0].abs();
                if limit < pupil {
                    (pupil, pupil_surface) = (limit, i);
                }
            }
            let bend = curvature * event.run;
            for k in 0..2 {
                match event.after {
                    None => u[k] += 2.0 * y[k] * bend,
                    Some(after) => {
                        let (n0, n1) = (n[event.before], n[after]);
                        u[k] = (n0 * u[k] - y[k] * (n1 - n0) * bend) / n1;
                    }
                }
            }
        });
        Some(ParaxialGhost {
            focus_mm: if u[0] == 0.0 { f64::INFINITY } else { -y[0] / u[0] },
            spread: y[0],
            shift_mm: y[1],
            pupil_radius_mm: pupil,
            pupil_surface,
            fraction,
        })
    }

    /// Radius of the axial ghost on the film, mm.
    pub fn radius_mm(&self) -> f64 {
        self.spread.abs() * self.pupil_radius_mm
    }

    /// Irradiance of the axial ghost on the film over that of the source at the front of the lens; without bound where the ghost is in focus.
    pub fn irradiance(&self) -> f64 {
        self.fraction / (self.spread * self.spread)
    }
}

/// What happens at a surface of a way.
struct Event {
    /// Gap that the light comes through.
    before: usize,
    /// Gap that it goes on through; `None` where it is reflected.
    after: Option<usize>,
    /// Along which sense of z it comes.
    run: f64,
}

/// Tells every surface (`None`: the film) that light of a ghost meets, in order; the last is the film.
fn walk(system: &System, turns: &[usize], mut visit: impl FnMut(Option<usize>, Event)) {
    let count = system.surfaces.len();
    let (mut gap, mut way) = (0, TraceDirection::ToFilm);
    let mut turns = turns.iter().copied().peekable();
    loop {
        let run = if way == TraceDirection::ToFilm { system.runs[gap] } else { -system.runs[gap] };
        let next = match way {
            TraceDirection::ToFilm => gap,
            // Turns lead to the film before.
            TraceDirection::ToObject if gap == 0 => return,
            TraceDirection::ToObject => gap - 1,
        };
        let at = (next < count).then_some(next);
        if turns.peek() == Some(&next) {
            turns.next();
            visit(at, Event { before: gap, after: None, run });
            way = if way == TraceDirection::ToFilm { TraceDirection::ToObject } else { TraceDirection::ToFilm };
            continue;
        }
        if at.is_none() {
            visit(None, Event { before: gap, after: Some(gap), run });
            return;
        }
        let after = if way == TraceDirection::ToFilm { gap + 1 } else { gap - 1 };
        let mirror = system.surfaces[next].mirror;
        visit(at, Event { before: gap, after: (!mirror).then_some(after), run });
        gap = after;
    }
}
