//! Connections of camera vertices with light vertices, and what a camera path carries along for their weights (see [`super::vertices`]).
//!
//! A camera vertex looks at some vertices of the pool, keeps one in proportion to the light that it would bring if nothing were in the way (resampled
//! importance sampling; Talbot, Cline & Egbert 2005), and asks whether that one can be seen.

use super::can_connect::can_connect;
use super::vertices::{CANDIDATES, Candidate, LEAST_COSINE, LightVertices, Weights, squared};
use crate::light::{LightPoint, LightRef, LightSample};
use crate::material::{Bsdf, Material, Principled, Scatter};
use crate::medium_stack::MediumStack;
use crate::shape::{Surface, offset_origin};
use diopter_light::random::Stream;
use diopter_light::{Ray, SampledSpectrum, SampledWavelengths};
use glam::Vec3;

/// Partial sums of the multiple importance sampling weights of a camera subpath (Georgiev et al. 2012).
#[derive(Clone, Copy, Debug)]
pub(crate) struct CameraSubpath {
    /// After the last event: sum of the strategies that make its vertex and more from the lamp, over the squared density of its place.
    d_vc: f64,
    /// Where that was, the cosine to its normal and the density (1/sr) of the direction taken.
    point: Vec3,
    cos: f32,
    pdf: f32,
    /// Whether a connection could end there.
    connects: bool,
    /// Whether something is on the segment since that no light path passes.
    blocked: bool,
    /// Whether a thin dielectric is on it: only light from infinitely far comes through.
    through_thin_dielectrics: bool,
}

/// The same at a vertex that was met.
#[derive(Clone, Copy, Debug)]
pub(crate) struct VertexMis {
    /// Density of its place, 1/m².
    c: f64,
    /// What the squared density of the direction back is multiplied by.
    k: f64,
    /// Whether the vertex before could be connected with this one.
    up: f64,
}

/// Vertices of a pool that the vertices of one camera path choose among: fetched once, for they lie all over the pool.
pub(crate) struct CandidateSet {
    numbers: [usize; CANDIDATES as usize],
    candidates: [Candidate; CANDIDATES as usize],
}

impl CandidateSet {
    /// Candidates of a pool that is not empty.
    pub fn new(pool: &LightVertices, mut numbers: Stream) -> CandidateSet {
        let numbers = std::array::from_fn(|k| {
            let place = (k as f32 + numbers.draw()) / CANDIDATES as f32 * pool.len() as f32;
            (place as usize).min(pool.len() - 1)
        });
        // All at once: memory answers them together.
        CandidateSet { numbers, candidates: numbers.map(|number| pool.candidates[number]) }
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
    pub vertex_mis: VertexMis,
    pub medium_stack: MediumStack,
    pub wavelengths: &'v SampledWavelengths,
}

impl CameraSubpath {
    /// No light path connects: the path begins, or was scattered as light paths cannot be.
    pub const NONE: CameraSubpath = CameraSubpath {
        d_vc: 0.0,
        point: Vec3::ZERO,
        cos: 0.0,
        pdf: 0.0,
        connects: false,
        blocked: true,
        through_thin_dielectrics: false,
    };

    /// The segment goes through something that no light path passes.
    #[inline]
    pub fn block_light_paths(&mut self) {
        self.blocked = true;
    }

    /// The same behind a thin dielectric, through which the segment runs straight.
    #[inline]
    pub fn through_thin_dielectric(self) -> CameraSubpath {
        CameraSubpath { through_thin_dielectrics: true, ..self }
    }

    /// At the next surface.
    #[inline]
    pub fn mis_at(&self, surface: &Surface, direction: Vec3) -> VertexMis {
        if self.blocked || self.through_thin_dielectrics {
            return VertexMis { c: 1.0, k: 0.0, up: 0.0 };
        }
        let d2 = f64::from((surface.point - self.point).length_squared());
        VertexMis {
            c: f64::from(self.pdf * surface.ng.dot(direction).abs()) / d2,
            k: self.d_vc * squared(f64::from(self.cos) / d2),
            up: f64::from(u8::from(self.connects)),
        }
    }

    /// Sum of the squared densities of all connections over that of a chance hit of a light, on its face under a cosine (1 at infinity).
    #[inline]
    pub fn connection_ratio_to_hit(&self, pool: &LightVertices, light: LightRef, direction: Vec3, cos: f32) -> f32 {
        let blocked = self.blocked || (self.through_thin_dielectrics && matches!(light, LightRef::Area(_)));
        // Light paths end where the first surface mirrors.
        if blocked || !self.connects || self.d_vc == 0.0 {
            return 0.0;
        }
        let sent = pool.connections.emission_density(light, self.point, -direction, cos);
        if sent == 0.0 {
            return 0.0;
        }
        (squared(sent * f64::from(self.cos) / f64::from(self.pdf * cos.abs()).max(1e-30)) * self.d_vc) as f32
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
    fn camera_side_ratio(&self, from: Vec3) -> f64 {
        let VertexMis { k, up, .. } = self.vertex_mis;
        match k > 0.0 {
            true => up + squared(f64::from(self.material.pdf(self.surface, from, self.wo, self.wavelengths, self.around))) * k,
            false => up,
        }
    }

    /// The path goes on, not straight through a thin dielectric.
    pub fn scattered(&self, scatter: &Scatter) -> CameraSubpath {
        if !self.connects() || scatter.disperses {
            return CameraSubpath::NONE;
        }
        let sum = if scatter.specular { self.vertex_mis.k } else { self.camera_side_ratio(scatter.wi) };
        CameraSubpath {
            d_vc: sum / squared(self.vertex_mis.c),
            point: self.surface.point,
            cos: self.surface.ng.dot(scatter.wi).abs(),
            pdf: if scatter.specular { 1.0 } else { scatter.pdf },
            connects: !scatter.specular,
            blocked: false,
            through_thin_dielectrics: false,
        }
    }

    /// Sum of the squared densities of all connections over that of a light sample, chosen with a density (that of the light's choice included).
    pub fn connection_ratio_to_light_sample(
        &self,
        pool: &LightVertices,
        light: LightRef,
        sample: &LightSample,
        density: f32,
    ) -> f32 {
        let VertexMis { c, k, up } = self.vertex_mis;
        if (k == 0.0 && up == 0.0) || !self.connects() {
            return 0.0;
        }
        let (point, cos) = (self.surface.point, self.surface.ng.dot(sample.wi).abs());
        let scale = match sample.spot {
            // Both densities per area of the lamp: its cosine and the distance cancel but for the cosine of emission.
            LightPoint::Area(i, _) => {
                let lamp = &pool.connections.scene.lights().area[i as usize];
                let end = point + sample.wi * sample.distance;
                let cos_lamp = lamp.cosine(end, sample.wi).max(1e-6);
                pool.connections.emission_density(light, point, -sample.wi, cos_lamp) / f64::from(cos_lamp)
            }
            LightPoint::Punctual(_) => {
                let d2 = if sample.distance.is_finite() { f64::from(sample.distance).powi(2).max(1e-30) } else { 1.0 };
                pool.connections.emission_density(light, point, -sample.wi, 1.0) / d2
            }
            LightPoint::Environment(_) => return 0.0,
        };
        if scale == 0.0 {
            return 0.0;
        }
        (squared(scale * f64::from(cos) / (f64::from(density) * c)) * self.camera_side_ratio(sample.wi)) as f32
    }

    /// Light over connections with some vertices of a pool, times the throughput of the path; `most_events`: of the light path.
    pub fn connect(
        &self,
        pool: &LightVertices,
        candidate_set: &CandidateSet,
        throughput: SampledSpectrum,
        most_events: u32,
        time_s: f32,
        mut numbers: Stream,
    ) -> SampledSpectrum {
        let (mut total, mut chosen) = (0.0f32, None);
        for (number, y) in candidate_set.numbers.into_iter().zip(&candidate_set.candidates) {
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
                true => (y.diffuse, y.cos_incident * std::f32::consts::FRAC_1_PI),
                false => {
                    let (surface, material, around, to_prev) = pool.at(number);
                    match material.bsdf(surface, -wi, self.wavelengths, false, around) {
                        Some(bsdf) => {
                            let (f, pdf) = bsdf.eval(to_prev);
                            (0.25 * f.element_sum() / y.cos_incident.max(LEAST_COSINE), pdf)
                        }
                        None => continue,
                    }
                }
            };
            let geometry = out.abs() / d2;
            let before = light_side_ratio(&y.weights, pdf * geometry, to_lamp);
            let target = light * passed * y.flux * geometry / (1.0 + before) as f32;
            if target > 0.0 && target.is_finite() {
                total += target;
                if u * total < target {
                    chosen = Some((number, y, wi, d2, target));
                }
            }
        }
        let Some((number, y, wi, d2, target)) = chosen else { return SampledSpectrum::ZERO };

        // Whether it is seen.
        let ng = self.bsdf.side_normal();
        let through = wi.dot(ng) < 0.0;
        let origin = self.surface.leave(if through { -ng } else { ng }, wi);
        let end = offset_origin(y.point, if y.ng.dot(wi) < 0.0 { y.ng } else { -y.ng }, f32::INFINITY);
        let way = end - origin;
        let distance = way.length();
        let ray = Ray { origin, direction: way / distance, time_s };
        let scene = pool.connections.scene;
        let mut beyond = self.medium_stack;
        if through {
            beyond.cross(scene, self.surface.object, self.surface.ng.dot(self.wo) > 0.0);
        }
        if !ray.is_finite() || beyond.span(scene, &ray, distance).is_some() || scene.occluded(&ray, distance * (1.0 - SHORT)) {
            return SampledSpectrum::ZERO;
        }

        // What it brings.
        let Some(state) = pool.state_at(number, self.wavelengths, time_s) else { return SampledSpectrum::ZERO };
        let (surface, material, around, to_prev) = pool.at(number);
        let Some(bsdf) = material.bsdf(surface, -wi, self.wavelengths, false, around) else { return SampledSpectrum::ZERO };
        let (f, pdf) = self.bsdf.eval(wi);
        let (passed, to_lamp) = bsdf.eval(to_prev);
        let geometry = y.ng.dot(wi).abs() / d2;
        let from_lamp = material.pdf(surface, to_prev, -wi, self.wavelengths, around);
        let l = f64::from(from_lamp * self.surface.ng.dot(wi).abs() / d2);
        let above = squared(l / self.vertex_mis.c) * self.camera_side_ratio(wi);
        let weight = 1.0 / (1.0 + light_side_ratio(&state.weights, pdf * geometry, to_lamp) + above);
        let chance = total / (target * CANDIDATES as f32) * pool.len() as f32 / pool.paths as f32;
        let light = throughput * f * state.flux * passed;
        let light = light * (geometry / y.cos_incident.max(LEAST_COSINE) * chance * weight as f32);
        if light.is_finite() { light } else { SampledSpectrum::ZERO }
    }
}

/// Fraction of a connection's length that the shadow ray is shorter, beyond the offsets of both ends.
const SHORT: f32 = 1e-5;

/// Sum of the strategies that make less from the lamp than a light vertex, over the one that connects it; `c`: density of its place from the camera.
#[inline]
fn light_side_ratio(weights: &Weights, c: f32, to_lamp: f32) -> f64 {
    squared(f64::from(c)) * (weights.a + squared(f64::from(to_lamp)) * weights.j) * weights.over_l2
}
