//! Rays from the scene run through the lens onto the film: the camera samples that would have drawn them.
//!
//! The other way round than [`CompoundLens::trace_to_scene`], with the same numbers: a ray of the scene lands on a film point for each of four wavelengths, has
//! for each of them the density with which a camera sample would have drawn it, and the weight that such a sample would have had. Étendue
//! dA cosθ dω is the same on both sides of a lens in air, so that densities of rays drawn in the scene and of camera samples can be compared
//! (multiple importance sampling; Veach 1997, ch. 9; for lenses Hanika & Dachsbacher 2014, "Efficient Monte Carlo Rendering with Realistic Lenses").

use super::samples::ThroughPupil;
use super::{CompoundLens, ExitRays, PupilSampler, Scratch};
use crate::batch::single::LANES;
use crate::ray::{TraceDirection, TracedRay};
use glam::{DVec2, DVec3};

/// Rays between scene and lens, one a lane.
#[derive(Clone, Debug)]
pub struct EntryRays {
    /// A point on each ray, mm from the entrance pupil, as [`crate::LensRay::origin_mm`].
    pub origin: [DVec3; LANES],
    /// Unit directions towards the scene (the light comes against them).
    pub direction: [DVec3; LANES],
    /// Wavelengths, nm.
    pub nm: [[f32; 4]; LANES],
}

impl Default for EntryRays {
    fn default() -> Self {
        EntryRays { origin: [DVec3::ZERO; LANES], direction: [DVec3::NEG_Z; LANES], nm: [[550.0; 4]; LANES] }
    }
}

impl CompoundLens {
    /// Where rays from the scene land, with the densities and weights that [`CompoundLens::trace_to_scene`] gives to camera samples along the same rays. `collects`
    /// as there. A lane passes where some wavelength comes through and could have been the hero of a camera sample; no wavelength has
    /// a place of its own among the four. Origins in `out` are on the first surface.
    pub fn trace_to_film(
        &self,
        rays: &EntryRays,
        collects: impl Fn(usize, DVec2) -> bool,
        scratch: &mut Scratch,
        out: &mut ExitRays,
    ) {
        let sampler = ThroughPupil { places: &[[0.5; 2]; LANES], collects };
        let (packet, n) = (&mut scratch.packet, &mut scratch.n);
        let pupil = self.entrance_pupil();
        (out.passed, out.spread) = (0, self.disperses);
        let Some(first) = self.system.surfaces.first().filter(|_| pupil.is_finite()) else { return };
        // Where they meet the first surface: they may be given by a point inside the lens.
        let mut starts = [[0.0f32; 3]; LANES];
        let mut met = 0u32;
        for i in 0..LANES {
            let ray = TracedRay { position: rays.origin[i] + pupil, direction: -rays.direction[i] };
            let ray = self.system.ray_from_object(ray);
            let (o, d) = first.to_local(ray.position, ray.direction);
            if let Some(m) = first.profile.intersect(o, d, self.system.runs[0]) {
                met |= 1 << i;
                let start = TracedRay { position: first.to_lens(m.point, d).0, direction: ray.direction };
                starts[i] = self.system.ray_to_object(start).position.as_vec3().to_array();
            }
            let [px, py, pz] = pupil.as_vec3().to_array();
            let [x, y, z] = starts[i];
            out.origin[i] = [x - px, y - py, z - pz];
            out.direction[i] = rays.direction[i].as_vec3().to_array();
            (out.film_points[i], out.slopes[i]) = ([[0.0; 2]; 4], [[0.0; 2]; 4]);
            (out.density[i], out.weight[i]) = ([0.0; 4], [0.0; 4]);
        }
        let mut fractions = [[0.0f32; 4]; LANES];
        for k in 0..if self.disperses { 4 } else { 1 } {
            let mut nm = [0.0; LANES];
            for i in 0..LANES {
                nm[i] = rays.nm[i][k];
                packet.set(i, starts[i], (-rays.direction[i]).as_vec3().to_array());
            }
            self.batch.indices(&nm, n);
            let through = self.batch.trace_light(packet, n, &nm, TraceDirection::ToFilm) & met;
            for i in (0..LANES).filter(|i| through >> i & 1 == 1) {
                let (land, slope, cos2) = self.landing(packet, i);
                (out.film_points[i][k], out.slopes[i][k]) = (land, slope);
                fractions[i][k] = packet.fraction[i];
                let [at, slope] = [land, slope].map(|v| glam::Vec2::from_array(v).as_dvec2());
                out.density[i][k] = sampler.density(&self.pupils, i, at, slope) as f32 / (cos2 * cos2);
            }
        }
        for i in 0..LANES {
            if !self.disperses {
                // One path for all, as for camera samples.
                (out.film_points[i], out.slopes[i]) = ([out.film_points[i][0]; 4], [out.slopes[i][0]; 4]);
                (out.density[i], fractions[i]) = ([out.density[i][0]; 4], [fractions[i][0]; 4]);
            }
            let mean = 0.25 * out.density[i].iter().sum::<f32>();
            if mean > 0.0 && mean.is_finite() && fractions[i].iter().any(|s| *s > 0.0) {
                out.passed |= 1 << i;
                out.weight[i] =
                    fractions[i].map(|fraction| if fraction > 0.0 { self.film_gain as f32 * fraction / mean } else { 0.0 });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compound::{Samples, Setting};
    use crate::{Focus, Iris, embedded};
    use diopter_light::units::Millimeters;
    use std::sync::Arc;

    #[test]
    fn rays_of_camera_samples_come_back_with_their_densities_and_weights() {
        let blades = Iris::blades(7, 0.3, 0.2).unwrap();
        for (name, f_number, iris, tilt) in [
            ("double-gauss-50mm", 2.0, None, [0.0; 2]),
            ("double-gauss-50mm", 5.6, Some(blades), [0.0; 2]),
            ("fisheye-10mm", 8.0, None, [0.0; 2]),
            ("double-gauss-50mm", 4.0, None, [0.14, -0.1]),
        ] {
            let setting = Setting {
                focal_length: None,
                f_number: Some(f_number),
                focus: Focus::Distance(Millimeters(1500.0)),
                iris,
                film_mm: [36.0, 24.0],
            };
            let lens = CompoundLens::new(Arc::new(embedded(name).unwrap()), &setting).unwrap().tilted(tilt).unwrap();
            let (mut scratch, mut exits, mut back) = (Scratch::default(), ExitRays::default(), ExitRays::default());
            let mut samples = Samples::default();
            let (mut passed, mut stepped) = (0, 0);
            for round in 0..24 {
                for i in 0..LANES {
                    let k = (round * LANES + i) as f64;
                    let part = |step: f64| (k * step).fract();
                    samples.film[i] = DVec2::new(34.0 * (part(0.7549) - 0.5), 22.0 * (part(0.5698) - 0.5));
                    samples.pupil[i] = [part(0.8192) as f32, part(0.6710) as f32];
                    samples.nm[i] = [450.0, 520.0, 590.0, 660.0].map(|nm| nm + 60.0 * part(0.5497) as f32);
                }
                let collects = |_: usize, at: DVec2| at.x.abs() <= 18.0 && at.y.abs() <= 12.0;
                lens.trace_to_scene(&samples, collects, &mut scratch, &mut exits);
                let mut rays = EntryRays { nm: samples.nm, ..EntryRays::default() };
                for i in 0..LANES {
                    let [o, d] = [exits.origin[i], exits.direction[i]].map(|v| glam::Vec3::from_array(v).as_dvec3());
                    // Any point of the ray says the same, also one within the lens.
                    (rays.origin[i], rays.direction[i]) = (o - d * (o.z / d.z), d.normalize());
                }
                lens.trace_to_film(&rays, collects, &mut scratch, &mut back);
                assert_eq!(back.spread, exits.spread);
                for i in (0..LANES).filter(|i| exits.passed >> i & 1 == 1) {
                    // A ray along a rim may be clipped one way only: rounding of single precision.
                    if back.passed >> i & 1 == 0 {
                        continue;
                    }
                    passed += 1;
                    for k in 0..4 {
                        if (exits.weight[i][k] > 0.0) != (back.weight[i][k] > 0.0) {
                            continue;
                        }
                        let off = |a: [f32; 2], b: [f32; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
                        if back.weight[i][k] > 0.0 {
                            // 1 µm: single precision over a path of some 100 mm.
                            let off = off(back.film_points[i][k], exits.film_points[i][k]);
                            assert!(off < 1e-3, "{name}: lands {off} mm away");
                        }
                        // The table of pupils steps from bin to bin: a place on the border may lie in either.
                        let near = |a: f32, b: f32| (a - b).abs() <= 1e-3 * b;
                        stepped += usize::from(!near(back.density[i][k], exits.density[i][k]));
                        stepped += usize::from(!near(back.weight[i][k], exits.weight[i][k]));
                    }
                    let off = (0..3).map(|c| (back.origin[i][c] - exits.origin[i][c]).abs()).fold(0.0, f32::max);
                    assert!(off < 1e-3, "{name}: starts {off} mm away");
                }
            }
            // Nearly all of those that pass one way pass the other.
            assert!(passed > 500, "{name}: {passed}");
            assert!(stepped < passed / 20, "{name}: {stepped} of {passed}");
        }
    }
}
