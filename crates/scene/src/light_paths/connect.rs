//! Connections of camera vertices with light vertices, and what a camera path carries along for their weights (see [`super::vertices`]).
//!
//! A camera vertex looks at some vertices of the pool, keeps one in proportion to the light that it would bring if nothing were in the way (resampled
//! importance sampling; Talbot, Cline & Egbert 2005), and asks whether that one can be seen.

use super::can_connect::can_connect;
use super::vertices::{CANDIDATES, Candidate, LEAST_COSINE, LightVertices, Weights, squared};
use crate::light::{LightRef, LightSample, Spot};
use crate::material::{Bsdf, Material, Principled, Scatter};
use crate::medium_stack::MediumStack;
use crate::shape::{Surface, offset_origin};
use diopter_light::random::Stream;
use diopter_light::{Ray, Sampled, Wavelengths};
use glam::Vec3;

/// What a camera path knows of the strategies by which light paths could have made more of it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CameraState {
    /// After the last event: sum of the strategies that make its vertex and more from the lamp, over the squared density of its place.
    carry: f64,
    /// Where that was, the cosine to its normal and the density (1/sr) of the direction taken.
    point: Vec3,
    cos: f32,
    pdf: f32,
    /// Whether a connection could end there.
    connects: bool,
    /// Whether something is on the segment since that no light path passes.
    barred: bool,
    /// Whether a thin dielectric is on it: only light from infinitely far comes through.
    through_thin_dielectrics: bool,
}

/// The same at a vertex that was met.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Arrival {
    /// Density of its place, 1/m².
    c: f64,
    /// What the squared density of the direction back is multiplied by.
    k: f64,
    /// Whether the vertex before could be connected with this one.
    up: f64,
}

/// Vertices of a pool that the vertices of one camera path choose among: fetched once, for they lie all over the pool.
pub(crate) struct Picked {
    numbers: [usize; CANDIDATES as usize],
    candidates: [Candidate; CANDIDATES as usize],
}

impl Picked {
    /// Of a pool that is not empty.
    pub fn new(pool: &LightVertices, mut numbers: Stream) -> Picked {
        let numbers = std::array::from_fn(|k| {
            let place = (k as f32 + numbers.draw()) / CANDIDATES as f32 * pool.len() as f32;
            (place as usize).min(pool.len() - 1)
        });
        // All at once: memory answers them together.
        Picked { numbers, candidates: numbers.map(|number| pool.candidates[number]) }
    }
}

/// A camera vertex.
pub(crate) struct CameraVertex<'v, 'a> {
    pub surface: &'v Surface,
    pub material: &'a Material,
    pub around: Option<&'a Principled>,
    pub bsdf: &'v Bsdf<'a>,
    /// Unit direction back along the path.
    pub wo: Vec3,
    pub arrival: Arrival,
    pub medium_stack: MediumStack,
    pub wavelengths: &'v Wavelengths,
}

impl CameraState {
    /// Of a path that begins, or was scattered where no light path can be.
    pub const NONE: CameraState = CameraState {
        carry: 0.0,
        point: Vec3::ZERO,
        cos: 0.0,
        pdf: 0.0,
        connects: false,
        barred: true,
        through_thin_dielectrics: false,
    };

    /// The segment goes through something that no light path passes.
    #[inline]
    pub fn bar(&mut self) {
        self.barred = true;
    }

    /// The same behind a thin dielectric, through which the segment runs straight.
    #[inline]
    pub fn through_thin_dielectric(self) -> CameraState {
        CameraState { through_thin_dielectrics: true, ..self }
    }

    /// At the next surface.
    #[inline]
    pub fn arrive(&self, surface: &Surface, direction: Vec3) -> Arrival {
        if self.barred || self.through_thin_dielectrics {
            return Arrival { c: 1.0, k: 0.0, up: 0.0 };
        }
        let d2 = f64::from((surface.point - self.point).length_squared());
        Arrival {
            c: f64::from(self.pdf * surface.ng.dot(direction).abs()) / d2,
            k: self.carry * squared(f64::from(self.cos) / d2),
            up: f64::from(u8::from(self.connects)),
        }
    }

    /// Sum of the squared densities of all connections over that of a chance hit of a light, on its face under a cosine (1 at infinity).
    #[inline]
    pub fn beside_hit(&self, pool: &LightVertices, light: LightRef, direction: Vec3, cos: f32) -> f32 {
        let barred = self.barred || (self.through_thin_dielectrics && matches!(light, LightRef::Area(_)));
        // Light paths end where the first surface mirrors.
        if barred || !self.connects || self.carry == 0.0 {
            return 0.0;
        }
        let sent = pool.connections.emission_density(light, self.point, -direction, cos);
        if sent == 0.0 {
            return 0.0;
        }
        (squared(sent * f64::from(self.cos) / f64::from(self.pdf * cos.abs()).max(1e-30)) * self.carry) as f32
    }
}

impl<'a> CameraVertex<'_, 'a> {
    /// Whether light paths could be scattered here.
    #[inline]
    pub fn connects(&self) -> bool {
        can_connect(self.surface, self.material, self.around)
    }

    /// Sum of the strategies by which light paths make this vertex, seen from a direction, and more, over the one that connects to it.
    #[inline]
    fn upward(&self, from: Vec3) -> f64 {
        let Arrival { k, up, .. } = self.arrival;
        match k > 0.0 {
            true => up + squared(f64::from(self.material.pdf(self.surface, from, self.wo, self.wavelengths, self.around))) * k,
            false => up,
        }
    }

    /// The path goes on, not straight through a thin dielectric.
    pub fn scattered(&self, scatter: &Scatter) -> CameraState {
        if !self.connects() || scatter.disperses {
            return CameraState::NONE;
        }
        let sum = if scatter.specular { self.arrival.k } else { self.upward(scatter.wi) };
        CameraState {
            carry: sum / squared(self.arrival.c),
            point: self.surface.point,
            cos: self.surface.ng.dot(scatter.wi).abs(),
            pdf: if scatter.specular { 1.0 } else { scatter.pdf },
            connects: !scatter.specular,
            barred: false,
            through_thin_dielectrics: false,
        }
    }

    /// Sum of the squared densities of all connections over that of a light sample, chosen with a density (that of the light's choice included).
    pub fn beside_light_sample(&self, pool: &LightVertices, light: LightRef, sample: &LightSample, density: f32) -> f32 {
        let Arrival { c, k, up } = self.arrival;
        if (k == 0.0 && up == 0.0) || !self.connects() {
            return 0.0;
        }
        let (point, cos) = (self.surface.point, self.surface.ng.dot(sample.wi).abs());
        let scale = match sample.spot {
            // Both densities per area of the lamp: its cosine and the distance cancel but for the cosine of emission.
            Spot::Area(i, _) => {
                let lamp = &pool.connections.scene.lights().area[i as usize];
                let end = point + sample.wi * sample.distance;
                let cos_lamp = lamp.cosine(end, sample.wi).max(1e-6);
                pool.connections.emission_density(light, point, -sample.wi, cos_lamp) / f64::from(cos_lamp)
            }
            Spot::Punctual(_) => {
                let d2 = if sample.distance.is_finite() { f64::from(sample.distance).powi(2).max(1e-30) } else { 1.0 };
                pool.connections.emission_density(light, point, -sample.wi, 1.0) / d2
            }
            Spot::Environment(_) => return 0.0,
        };
        if scale == 0.0 {
            return 0.0;
        }
        (squared(scale * f64::from(cos) / (f64::from(density) * c)) * self.upward(sample.wi)) as f32
    }

    /// Light over connections with some vertices of a pool, times the throughput of the path; `most_events`: of the light path.
    pub fn connect(
        &self,
        pool: &LightVertices,
        picked: &Picked,
        throughput: Sampled,
        most_events: u32,
        time_s: f32,
        mut numbers: Stream,
    ) -> Sampled {
        let (mut total, mut chosen) = (0.0f32, None);
        for (number, y) in picked.numbers.into_iter().zip(&picked.candidates) {
            let u = numbers.draw();
            let to = y.point - self.surface.point;
            let d2 = to.length_squared();
            let wi = to / d2.sqrt();
            let out = -y.ng.dot(wi);
            if y.events > most_events || !(d2 > 0.0) || (y.diffuse >= 0.0 && out <= 0.0) {
                continue;
            }
            let (f, pdf) = self.bsdf.eval(wi);
            let light = (throughput * f).element_sum();
            if !(light > 0.0) {
                continue;
            }
            let (passed, to_lamp) = match y.diffuse >= 0.0 {
                true => (y.diffuse, y.arrives * std::f32::consts::FRAC_1_PI),
                false => {
                    let (surface, material, around, to_prev) = pool.at(number);
                    match material.bsdf(surface, -wi, self.wavelengths, false, around) {
                        Some(bsdf) => {
                            let (f, pdf) = bsdf.eval(to_prev);
                            (0.25 * f.element_sum() / y.arrives.max(LEAST_COSINE), pdf)
                        }
                        None => continue,
                    }
                }
            };
            let geometry = out.abs() / d2;
            let before = below(&y.weights, pdf * geometry, to_lamp);
            let target = light * passed * y.flux * geometry / (1.0 + before) as f32;
            if target > 0.0 && target.is_finite() {
                total += target;
                if u * total < target {
                    chosen = Some((number, y, wi, d2, target));
                }
            }
        }
        let Some((number, y, wi, d2, target)) = chosen else { return Sampled::ZERO };

        // Whether it is seen.
        let ng = self.bsdf.side_normal();
        let through = wi.dot(ng) < 0.0;
        let origin = self.surface.leave(if through { -ng } else { ng }, wi);
        let end = offset_origin(y.point, if y.ng.dot(wi) < 0.0 { y.ng } else { -y.ng });
        let way = end - origin;
        let distance = way.length();
        let ray = Ray { origin, direction: way / distance, time_s };
        let scene = pool.connections.scene;
        let mut beyond = self.medium_stack;
        if through {
            beyond.cross(scene, self.surface.object, self.surface.ng.dot(self.wo) > 0.0);
        }
        if !ray.is_finite() || beyond.span(scene, &ray, distance).is_some() || scene.occluded(&ray, distance * (1.0 - SHORT)) {
            return Sampled::ZERO;
        }

        // What it brings.
        let Some(state) = pool.state_at(number, self.wavelengths, time_s) else { return Sampled::ZERO };
        let (surface, material, around, to_prev) = pool.at(number);
        let Some(bsdf) = material.bsdf(surface, -wi, self.wavelengths, false, around) else { return Sampled::ZERO };
        let (f, pdf) = self.bsdf.eval(wi);
        let (passed, to_lamp) = bsdf.eval(to_prev);
        let geometry = y.ng.dot(wi).abs() / d2;
        let from_lamp = material.pdf(surface, to_prev, -wi, self.wavelengths, around);
        let l = f64::from(from_lamp * self.surface.ng.dot(wi).abs() / d2);
        let above = squared(l / self.arrival.c) * self.upward(wi);
        let weight = 1.0 / (1.0 + below(&state.weights, pdf * geometry, to_lamp) + above);
        let chance = total / (target * CANDIDATES as f32) * pool.len() as f32 / pool.paths as f32;
        let light = throughput * f * state.flux * passed;
        let light = light * (geometry / y.arrives.max(LEAST_COSINE) * chance * weight as f32);
        if light.is_finite() { light } else { Sampled::ZERO }
    }
}

/// Fraction of a connection's length that the shadow ray is shorter, beyond the offsets of both ends.
const SHORT: f32 = 1e-5;

/// Sum of the strategies that make less from the lamp than a light vertex, over the one that connects it; `c`: density of its place from the camera.
#[inline]
fn below(weights: &Weights, c: f32, to_lamp: f32) -> f64 {
    squared(f64::from(c)) * (weights.a + squared(f64::from(to_lamp)) * weights.j) * weights.over_l2
}
