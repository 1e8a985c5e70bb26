//! Light that lamps send onto the front of the lens, as beams.

use super::{BIN_NM, BINS, MOST_BEAMS};
use crate::camera::Camera;
use crate::expose::response::Response;
use diopter_lens::CompoundLens;
use diopter_lens::ghosts::SourceBeam;
use diopter_light::SampledWavelengths;
use diopter_light::wavelength::FIRST_NM;
use diopter_scene::Scene;
use diopter_scene::light::{LightRef, Modulation, PunctualKind};
use diopter_scene::radiance::Incident;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Step in which spectra of lamps are looked at, nm.
pub(super) const STEP_NM: f32 = 10.0;

/// A lamp seen under a larger angle than this is cut into more cells, rad.
pub(super) const CELL_RAD: f32 = 0.07;

/// Light of a lamp, or of a part of one, on the front of the lens.
pub(super) struct Beam {
    pub(super) source: SourceBeam,
    /// From the edges of its cell of the lamp, half a cell away in two directions.
    pub(super) edges: [Option<SourceBeam>; 2],
    /// Whether camera rays meet the lamp.
    pub(super) visible: bool,
    pub(super) modulation: Modulation,
    /// What each band counts of its irradiance in each bin of wavelengths, e⁻ s⁻¹ m⁻².
    pub(super) counts: Vec<[f64; BINS]>,
}

impl Beam {
    pub(super) fn strength(&self) -> f64 {
        self.counts.iter().flatten().map(|v| v.abs()).sum()
    }
}
/// Beams of all lamps onto the front of the lens.
pub(super) fn beams(scene: &Scene, camera: &Camera, lens: &CompoundLens, response: &Response, time_s: f64) -> Vec<Beam> {
    let system = lens.system();
    let Some(front) = SourceBeam::new(system, DVec3::Z).map(|b| b.middle()) else { return vec![] };
    let pupil = lens.entrance_pupil();
    let world_from_lens = camera.motion.at(time_s);
    let lens_from_world = world_from_lens.inverse();
    let point: Vec3 = world_from_lens.transform_point3(((front - pupil) * 1e-3).as_vec3());
    let (lights, immersion) = (scene.lights(), scene.immersion_at(point));
    let area = (0..lights.area.len() as u32).map(LightRef::Area);
    let punctual = (0..lights.punctual.len() as u32).map(LightRef::Punctual);
    let towards = |lamp: LightRef, u: [f32; 2]| {
        let nm = SampledWavelengths::fixed([450.0, 520.0, 590.0, 660.0]);
        scene.incident(lamp, point, u, &nm, time_s as f32, 4, immersion)
    };
    // A lamp with extent is cut into cells: large ones into more, where there are few lamps.
    let most = ((MOST_BEAMS as f64 / lights.area.len().max(1) as f64).sqrt() as usize).clamp(1, 8);
    let side_of = |lamp: LightRef| {
        let corners = [[0.02, 0.02], [0.98, 0.02], [0.02, 0.98], [0.98, 0.98]].map(|u| towards(lamp, u).map(|l| l.direction));
        let seen: Vec<Vec3> = corners.into_iter().flatten().collect();
        let angle = seen.iter().flat_map(|a| seen.iter().map(|b| a.angle_between(*b))).fold(0.0, f32::max);
        ((angle / CELL_RAD).ceil() as usize).clamp(most.min(3), most)
    };
    let places: Vec<(LightRef, [f32; 2], f64)> = area
        .flat_map(|lamp| {
            let side = side_of(lamp);
            let cell = move |i: usize| (i as f32 + 0.5) / side as f32;
            (0..side * side).map(move |k| (lamp, [cell(k % side), cell(k / side)], 1.0 / (side * side) as f64))
        })
        // The middle of the sun stands for its disc: ghosts are larger, or the sun is small beside them.
        .chain(punctual.map(|lamp| {
            let disc =
                matches!(lamp, LightRef::Punctual(i) if matches!(lights.punctual[i as usize].kind, PunctualKind::Disc { .. }));
            (lamp, if disc { [0.0; 2] } else { [0.5; 2] }, 1.0)
        }))
        .collect();
    let beam = |(lamp, u, part): &(LightRef, [f32; 2], f64)| {
        let (mut counts, mut first) = (vec![[0.0; BINS]; response.curves.len()], None::<Incident>);
        let steps = (BINS as f32 * BIN_NM / STEP_NM) as usize;
        for k in (0..steps).step_by(4) {
            let nm: [f32; 4] = std::array::from_fn(|c| FIRST_NM + STEP_NM * ((k + c) as f32 + 0.5));
            // Dark at these four, or hidden.
            let Some(light) = scene.incident(*lamp, point, *u, &SampledWavelengths::fixed(nm), time_s as f32, 4, immersion)
            else {
                continue;
            };
            for (nm, irradiance) in nm.into_iter().zip(light.irradiance.to_array()) {
                let bin = (((nm - FIRST_NM) / BIN_NM) as usize).min(BINS - 1);
                for (band, curve) in counts.iter_mut().zip(&response.curves) {
                    band[bin] += f64::from(irradiance * curve.at(nm) * STEP_NM) * part;
                }
            }
            first.get_or_insert(light);
        }
        let light = first?;
        let beam_of = |light: &Incident| {
            if !light.distance.is_finite() {
                return SourceBeam::new(system, lens_from_world.transform_vector3(-light.direction).as_dvec3());
            }
            let lamp = lens_from_world.transform_point3(point + light.direction * light.distance);
            SourceBeam::from_point(system, lamp.as_dvec3() * 1e3 + pupil)
        };
        let source = beam_of(&light)?;
        // Of a lamp with extent, half a cell to either side: where it is hidden there, the other way.
        let half = 0.5 * part.sqrt() as f32;
        let edge = |du: f32, dv: f32| {
            let at = |sign: f32| {
                let edge = towards(*lamp, [u[0] + sign * du, u[1] + sign * dv])?;
                beam_of(&edge)
            };
            matches!(lamp, LightRef::Area(_)).then(|| at(0.999).or_else(|| at(-0.999))).flatten()
        };
        let edges = [edge(half, 0.0), edge(0.0, half)];
        let visible = match lamp {
            LightRef::Punctual(i) => matches!(lights.punctual[*i as usize].kind, PunctualKind::Disc { .. }),
            _ => true,
        };
        Some(Beam { source, edges, visible, modulation: light.modulation, counts })
    };
    let found: Vec<Option<Beam>> = places.par_iter().map(beam).collect();
    found.into_iter().flatten().filter(|b| b.strength() > 0.0).collect()
}
