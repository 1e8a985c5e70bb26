//! Packets of camera samples through a lens: film places and colours in, rays into the scene out.

use super::CompoundLens;
use super::REFERENCE_NM;
use crate::batch::single::{Indices, LANES, Packet};
use crate::pupil::{self, PupilTable, Region, Turn};
use crate::ray::TraceDirection;
use glam::{DVec2, Vec2};

/// Camera samples, one a lane.
#[derive(Clone, Debug)]
pub struct Samples {
    /// Film points, mm.
    pub film: [DVec2; LANES],
    /// Places in the unit square that choose the place in the pupil.
    pub pupil: [[f32; 2]; LANES],
    /// Wavelengths, nm; the first is the hero.
    pub nm: [[f32; 4]; LANES],
}

impl Default for Samples {
    fn default() -> Self {
        Samples { film: [DVec2::ZERO; LANES], pupil: [[0.5; 2]; LANES], nm: [[550.0; 4]; LANES] }
    }
}

/// Rays into the scene of a packet of film samples; those that the lens blocks have no bit in `passed`.
#[derive(Clone, Debug)]
pub struct ExitRays {
    /// A bit for every sample that reaches the scene.
    pub passed: u32,
    /// Whether wavelengths land on film points of their own; if not, all have the first one's weight.
    pub spread: bool,
    /// Rays towards the scene, as [`LensRay`](crate::LensRay): origins in mm from the entrance pupil, unit directions.
    pub origin: [[f32; 3]; LANES],
    /// Unit directions.
    pub direction: [[f32; 3]; LANES],
    /// Film point of each wavelength, mm.
    pub film_points: [[[f32; 2]; 4]; LANES],
    /// Its slope there, towards the lens. With the film point over the distance of the exit pupil ([`crate::Lens::exit_curvature`]) it
    /// tells the place in the pupil.
    pub slopes: [[[f32; 2]; 4]; LANES],
    /// Weight of each wavelength, sr; 0 where it does not come through. The irradiance of the film is the sum over samples of
    /// radiance × weight / (samples per area).
    pub weight: [[f32; 4]; LANES],
    /// Density with which each wavelength, as the hero, would have drawn this ray, 1 / (mm² sr) of étendue; 0 where it could not have.
    pub density: [[f32; 4]; LANES],
}

impl Default for ExitRays {
    fn default() -> Self {
        ExitRays {
            passed: 0,
            spread: false,
            origin: [[0.0; 3]; LANES],
            direction: [[0.0; 3]; LANES],
            film_points: [[[0.0; 2]; 4]; LANES],
            slopes: [[[0.0; 2]; 4]; LANES],
            weight: [[0.0; 4]; LANES],
            density: [[0.0; 4]; LANES],
        }
    }
}

impl ExitRays {
    /// Takes over samples that passed in `other` and not here.
    pub fn fill_missing(&mut self, other: &ExitRays) {
        let new = other.passed & !self.passed;
        self.passed |= new;
        for k in (0..LANES).filter(|k| new >> k & 1 == 1) {
            self.origin[k] = other.origin[k];
            self.direction[k] = other.direction[k];
            self.film_points[k] = other.film_points[k];
            self.slopes[k] = other.slopes[k];
            self.weight[k] = other.weight[k];
            self.density[k] = other.density[k];
        }
    }
}

/// How directions from the film are drawn for a packet of samples.
pub trait PupilSampler {
    /// Slope towards the lens of a lane's ray, and how many samples are drawn for a unit of slope about it (of one a unit of area); `None`
    /// where no light can come from.
    fn draw(&self, pupils: &PupilTable, lane: usize, film: DVec2) -> Option<(DVec2, f64)>;

    /// The same number for any film point and slope of a lane; 0 where nothing is drawn.
    fn density(&self, pupils: &PupilTable, lane: usize, film: DVec2, slope: DVec2) -> f64;
}

/// Even over the part of the pupil that light passes, from film points all over what collects light.
pub(super) struct ThroughPupil<'a, F> {
    pub(super) places: &'a [[f32; 2]; LANES],
    pub(super) collects: F,
}

impl<F: Fn(usize, DVec2) -> bool> PupilSampler for ThroughPupil<'_, F> {
    #[inline]
    fn draw(&self, pupils: &PupilTable, lane: usize, film: DVec2) -> Option<(DVec2, f64)> {
        let (region, turn) = pupils.region(film);
        let area = region.fan.area();
        (area > 0.0).then(|| (pupils.slope(film, region.fan.sample(self.places[lane]), turn), 1.0 / area))
    }

    #[inline]
    fn density(&self, pupils: &PupilTable, lane: usize, film: DVec2, _: DVec2) -> f64 {
        let area = if (self.collects)(lane, film) { pupils.region(film).0.fan.area() } else { 0.0 };
        if area > 0.0 { 1.0 / area } else { 0.0 }
    }
}

/// Buffers of [`CompoundLens::trace_to_scene`], to be kept between calls.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    pub(super) packet: Packet,
    pub(super) forward: Packet,
    pub(super) n: Indices,
    pub(super) n_forward: Indices,
}

impl CompoundLens {
    /// Whether any of many directions spread over a region passes.
    pub(super) fn anything_passes(&self, film: DVec2, region: &Region, turn: Turn) -> bool {
        const PACKETS: usize = 16;
        // Steps of the plane that leave no gaps (Roberts 2018, R2).
        const STEPS: DVec2 = DVec2::new(0.754_877_666_246_692_8, 0.569_840_290_998_053_2);
        let mut n = Indices::default();
        self.batch.indices(&[REFERENCE_NM as f32; LANES], &mut n);
        let mut packet = Packet::default();
        (0..PACKETS).any(|k| {
            for i in 0..LANES {
                let u = (STEPS * (k * LANES + i + 1) as f64).fract();
                let slope = self.pupils.slope(film, region.fan.sample([u.x as f32, u.y as f32]), turn);
                crate::pupil::start(&mut packet, i, film, self.system.film_z, self.system.film_direction(slope));
            }
            self.batch.trace(&mut packet, &n, TraceDirection::ToObject) != 0
        })
    }

    /// Where a lane that came through lands on the film, its slope there towards the lens, and cos² of its angle to the axis.
    #[inline]
    pub(super) fn landing(&self, packet: &Packet, i: usize) -> ([f32; 2], [f32; 2], f32) {
        let t = (self.system.film_z as f32 - packet.z[i]) / packet.dz[i];
        let land = [packet.x[i] + packet.dx[i] * t, packet.y[i] + packet.dy[i] * t];
        let towards = -(self.system.film_run() as f32) / packet.dz[i];
        (land, [packet.dx[i] * towards, packet.dy[i] * towards], packet.dz[i] * packet.dz[i])
    }

    /// A packet of samples at once: what [`CompoundLens::ray`] answers, for four wavelengths each. `collects`: whether samples start at a
    /// film point (mm; by lane); elsewhere no density is counted.
    pub fn trace_to_scene(
        &self,
        samples: &Samples,
        collects: impl Fn(usize, DVec2) -> bool,
        scratch: &mut Scratch,
        out: &mut ExitRays,
    ) {
        self.trace_to_scene_sampled(samples, &ThroughPupil { places: &samples.pupil, collects }, scratch, out);
    }

    /// The same with directions drawn otherwise.
    pub fn trace_to_scene_sampled(
        &self,
        samples: &Samples,
        sampler: &impl PupilSampler,
        scratch: &mut Scratch,
        out: &mut ExitRays,
    ) {
        let Scratch { packet, forward, n, n_forward } = scratch;
        let film_z = self.system.film_z;
        let density = &mut out.density;
        let mut hero_nm = [0.0; LANES];
        for i in 0..LANES {
            let film = samples.film[i];
            let (slope, drawn) = sampler.draw(&self.pupils, i, film).unwrap_or((DVec2::ZERO, 0.0));
            out.slopes[i] = [slope.as_vec2().to_array(); 4];
            pupil::start(packet, i, film, film_z, self.system.film_direction(slope));
            let cos2 = packet.dz[i] * packet.dz[i];
            density[i] = [drawn as f32 / (cos2 * cos2), 0.0, 0.0, 0.0];
            hero_nm[i] = samples.nm[i][0];
        }
        self.batch.indices(&hero_nm, n);
        out.passed = self.batch.trace_light(packet, n, &hero_nm, TraceDirection::ToObject);
        out.spread = self.disperses;
        let [px, py, pz] = self.turned.entrance_pupil().as_vec3().to_array();
        for i in 0..LANES {
            if density[i][0] == 0.0 {
                out.passed &= !(1 << i);
            }
            out.origin[i] = [packet.x[i] - px, packet.y[i] - py, packet.z[i] - pz];
            out.direction[i] = [packet.dx[i], packet.dy[i], packet.dz[i]];
            let film = samples.film[i].as_vec2().to_array();
            out.film_points[i] = [film; 4];
            out.weight[i] = [0.0; 4];
        }
        if out.passed == 0 {
            return;
        }
        if !self.disperses {
            // One path for all: only what glass and surfaces take may differ, and for such glasses it is the same.
            for i in 0..LANES {
                if out.passed >> i & 1 == 1 {
                    density[i] = [density[i][0]; 4];
                    out.weight[i] = [self.film_gain as f32 * packet.fraction[i] / density[i][0]; 4];
                }
            }
            return;
        }
        let mut fractions = [[0.0f32; 4]; LANES];
        for i in 0..LANES {
            if out.passed >> i & 1 == 1 {
                fractions[i][0] = packet.fraction[i];
            }
        }
        for k in 1..4 {
            let mut nm = [0.0; LANES];
            for i in 0..LANES {
                nm[i] = samples.nm[i][k];
                // From the front towards the film: the reverse of what left.
                forward.set(i, [packet.x[i], packet.y[i], packet.z[i]], [-packet.dx[i], -packet.dy[i], -packet.dz[i]]);
            }
            self.batch.indices(&nm, n_forward);
            let through = self.batch.trace_light(forward, n_forward, &nm, TraceDirection::ToFilm) & out.passed;
            for i in 0..LANES {
                if through >> i & 1 == 0 {
                    continue;
                }
                let (land, slope, cos2) = self.landing(forward, i);
                (out.film_points[i][k], out.slopes[i][k]) = (land, slope);
                fractions[i][k] = forward.fraction[i];
                let [at, slope] = [land, slope].map(|v| Vec2::from_array(v).as_dvec2());
                density[i][k] = sampler.density(&self.pupils, i, at, slope) as f32 / (cos2 * cos2);
            }
        }
        for i in 0..LANES {
            let mean = 0.25 * (density[i][0] + density[i][1] + density[i][2] + density[i][3]);
            for k in 0..4 {
                out.weight[i][k] = if fractions[i][k] > 0.0 { self.film_gain as f32 * fractions[i][k] / mean } else { 0.0 };
            }
        }
    }
}
