//! One segment of a path through a medium: what it emits, the light of lamps that it scatters into the ray, and where the path goes on.
//!
//! In homogeneous media light that arrives from a lamp after one scattering is estimated by three strategies, joined by the power heuristic (E. Veach 1997):
//!
//! * distance: a scattering vertex by extinction, there a light and a point on it (next-event estimation);
//! * phase: the same vertex, a direction by the phase function that meets the lamp;
//! * equi-angular: a light for the whole segment, the distance as that light sees it ([`crate::light::segment`]; C. Kulla, M. Fajardo 2012), from there a
//!   point on the light. Near a lamp 1/r² stands in its density, so that lamps in fog leave no single bright samples.
//!
//! * joint ([`super::joint`]), where the segment begins at another scattering event: its direction is drawn about a light, too, the distance as that light sees it
//!   (I. Georgiev et al. 2013).
//!
//! Densities are compared per metre of the segment and per solid angle at the place of scattering and where the segment begins. All strategies draw a point of a light by the same
//! density, which therefore cancels. Lights at infinity are left to the first two.
//!
//! In media that differ from place to place the distance is found by tracking ([`crate::medium::tracking`]), whose density nobody knows: there the
//! first two strategies do without the others.

use super::joint::Vertex;
use super::medium_segment::MediumSegment;
use super::prev_scatter::{PrevScatter, SegmentStart};
use super::tally::Tally;
use super::to_light::ShadowRay;
use super::weights::mis;
use crate::light::LightRef;
use crate::light::segment::{EquiAngular, Pivot, Segment};
use crate::medium::tracking::Track;
use crate::medium::{DistanceSample, Sigma, Volume, phase, scattered};
use crate::medium_stack::MediumId;
use crate::russian_roulette::{self, MOST_SURVIVAL};
use crate::scene::Scene;
use diopter_light::random::Dimensions;
use diopter_light::{Ray, SampledSpectrum};
use glam::Vec3;

/// Optical depth beyond which lights are left to the other strategies: 1e-7 of the light is left there.
const DEEPEST: f32 = 16.0;

/// Optical depth from which most of what a segment scatters towards the camera comes.
const USUAL_DEPTH: f32 = 6.0;

/// Angle (rad) under which a light must see the segment for an equi-angular sample to be taken always. The irradiance changes little along what is seen
/// under less, and samples by extinction do as well.
const WIDE: f32 = 0.5;

/// Least fraction of the segments on which a sample is taken: what makes it rare must not make it bright.
const RAREST: f32 = 0.05;

/// How a free flight along a segment in a medium ended.
pub(super) enum Flight {
    /// At the end of the segment.
    Through,
    /// Where the medium scatters.
    Scattered(MediumScatter),
}

/// How a path goes on from where a medium scattered it.
pub(super) struct Onward {
    /// The ray that it goes on with.
    pub ray: Ray,
    /// The vertex, where lights were sampled from there.
    pub last: Option<PrevScatter>,
}

/// A segment as equi-angular samples see it.
#[derive(Clone, Copy)]
struct Inscatter {
    segment: Segment,
    asymmetry: f32,
    /// Mean extinction, 1/m.
    extinction: f32,
    start: Option<SegmentStart>,
    /// Whether a sample is taken whatever the light sees of the segment.
    always: bool,
    time_s: f32,
    flash: bool,
}

/// A segment on which a path was scattered: what equi-angular sampling would have done there.
#[derive(Clone, Copy)]
pub(super) struct MediumScatter {
    inscatter: Option<Inscatter>,
    /// Distance of the vertex, m.
    distance: f32,
    /// Density of that distance by extinction, 1/m.
    density: f32,
}

/// A place in a medium that scatters a path.
pub(super) struct MediumVertex<'a> {
    pub segment: MediumSegment<'a>,
    pub on: MediumScatter,
}

impl MediumScatter {
    /// Density of an equi-angular sample of a light at the vertex over that of the vertex, the density of the direction not included.
    #[inline]
    pub fn equiangular(&self, scene: &Scene, light: LightRef) -> f32 {
        self.inscatter.map_or(0.0, |i| i.density(scene, light, self.distance) / self.density)
    }
}

impl Inscatter {
    /// Fraction of the segments on which a sample of a light is taken.
    fn fraction(&self, light: &Pivot) -> f32 {
        if self.always {
            return 1.0;
        }
        let s = &self.segment;
        (light.angle(s, s.near + USUAL_DEPTH / s.extinction) / WIDE).clamp(RAREST, 1.0)
    }

    /// Density of a distance along the ray by equi-angular samples of a light, the choice of the light included, 1/m; joined by the power heuristic with
    /// that of joint samples.
    fn density(&self, scene: &Scene, light: LightRef, distance: f32) -> f32 {
        let Some(pivot) = scene.pivot(light, self.time_s) else { return 0.0 };
        let Some(distances) = EquiAngular::new(&self.segment, &pivot, self.asymmetry) else { return 0.0 };
        match distances.density(distance) {
            0.0 => 0.0,
            density => {
                let equiangular = scene.lights().probability_along(&self.segment, light, self.flash) * self.fraction(&pivot);
                density * equiangular.hypot(self.joint(scene, light, &pivot))
            }
        }
    }

    /// Density of the segment's direction by joint samples of a light over that with which it was drawn.
    fn joint(&self, scene: &Scene, light: LightRef, pivot: &Pivot) -> f32 {
        let Some(start) = &self.start else { return 0.0 };
        start.joint(scene, light, pivot, self.segment.direction, self.extinction, self.flash) / start.density
    }
}

impl MediumSegment<'_> {
    /// Adds the light of the segment to `radiance`, and takes the path to its end or to where it is scattered.
    pub fn fly(&self, throughput: &mut SampledSpectrum, radiance: &mut impl Tally) -> Flight {
        if let Some(volume) = &self.medium.volume {
            return self.track(volume, throughput, radiance);
        }
        let [near, far] = self.span;
        let sigma = self.medium.at(self.wavelengths);
        if let Some(emission) = &self.medium.emission {
            let light = *throughput * emission.sample_light(self.wavelengths) * sigma.absorption * sigma.depth(far - near);
            radiance.add(light, self.depth);
        }
        let before = *throughput;
        let inscatter = self.inscatter(&sigma, before);
        let [u, v, w, _] = self.sampler.get(Dimensions::Medium(self.segment_index));
        if let Some(inscatter) = &inscatter {
            self.add(radiance, self.equiangular(inscatter, &sigma, before, w));
        }
        match sigma.sample_distance(far - near, [u, v], before) {
            DistanceSample::Through(weight) => {
                *throughput *= weight;
                Flight::Through
            }
            DistanceSample::Scattered(distance, weight) => {
                *throughput *= weight;
                let density = sigma.density(distance, before);
                Flight::Scattered(MediumScatter { inscatter, distance: near + distance, density })
            }
        }
    }

    /// The same in a medium that differs from place to place.
    fn track(&self, volume: &Volume, throughput: &mut SampledSpectrum, radiance: &mut impl Tally) -> Flight {
        let moment_s = self.scene.moment_s(self.ray.time_s);
        let track = Track::new(self.medium, volume, &self.ray, self.span, self.wavelengths, moment_s);
        let mut stream = self.sampler.stream(Dimensions::Tracking(self.segment_index));
        match radiance.add_by(self.depth, |emitted| track.sample_distance(*throughput, &mut stream, emitted)) {
            DistanceSample::Through(weight) => {
                *throughput *= weight;
                Flight::Through
            }
            DistanceSample::Scattered(distance, weight) => {
                *throughput *= weight;
                Flight::Scattered(MediumScatter { inscatter: None, distance, density: 1.0 })
            }
        }
    }

    /// Whether light that is scattered where a path of a throughput was counts.
    pub fn may_scatter(&self, throughput: SampledSpectrum) -> bool {
        self.depth < self.settings.max_depth && throughput.max_element() > 0.0
    }

    /// Where on the segment a path was scattered.
    pub fn point(&self, on: &MediumScatter) -> Vec3 {
        self.ray.at(on.distance)
    }

    /// What is scattered towards where the segment comes from, of light from a direction, 1/sr.
    pub fn phase(&self, wi: Vec3) -> f32 {
        phase(self.ray.direction.dot(wi), self.medium.asymmetry)
    }

    /// Adds light of a lamp that arrives where a path was scattered.
    pub fn add_lamp(&self, on: &MediumScatter, throughput: SampledSpectrum, radiance: &mut impl Tally) {
        if !self.medium.is_subsurface {
            self.add(radiance, self.sample_ld(on, self.point(on), throughput));
        }
    }

    /// Adds light that was scattered here and once before, near a lamp ([`super::joint`]): from a direction it comes to the path as `response` says, and is added with the number of events and the direction. The medium, where it was sought.
    pub fn add_joint(
        &self,
        on: &MediumScatter,
        throughput: SampledSpectrum,
        response: impl Fn(f32) -> SampledSpectrum,
        add: impl FnOnce(SampledSpectrum, u32, Vec3),
    ) -> Option<MediumId> {
        if self.medium.is_subsurface || !self.medium.scatters_homogeneously() {
            return None;
        }
        let point = self.point(on);
        let scatter = |direction: Vec3| {
            let density = self.phase(direction);
            (response(density), density)
        };
        let vertex = Vertex { segment: self, point, depth: self.depth };
        let sought = vertex.joint(throughput, scatter, |_| (point, self.medium_stack), add);
        sought.then(|| self.medium_stack.medium(self.scene))
    }

    /// A direction in which a path goes on from where it was scattered, and its density, 1/sr.
    pub fn sample_phase(&self) -> (Vec3, f32) {
        let [u, v, ..] = self.sampler.get(Dimensions::Scatter(self.vertex));
        scattered(self.ray.direction, self.medium.asymmetry, [u, v])
    }

    /// Sends a path on in such a direction, unless Russian roulette ends it; `joint`: the medium in which lights were sought; `rate`: of going on ([`russian_roulette::RouletteRates`]).
    pub fn go_on(
        &self,
        on: &MediumScatter,
        (direction, density): (Vec3, f32),
        joint: Option<MediumId>,
        throughput: &mut SampledSpectrum,
        eta_scale: f32,
        rate: f32,
    ) -> Option<Onward> {
        let [.., u] = self.sampler.get(Dimensions::Scatter(self.vertex));
        let samples_lights = !self.medium.is_subsurface;
        // Walks within bodies end at the surface: no need to end those that bring as much as they began with.
        let (most, rate) = if samples_lights { (MOST_SURVIVAL, rate) } else { (1.0, 1.0) };
        if !russian_roulette::goes_on(throughput, eta_scale, self.vertex + 1, u, self.settings.roulette_depth, most, rate) {
            return None;
        }
        let point = self.point(on);
        let last = samples_lights.then_some(PrevScatter { point, normal: Vec3::ZERO, density, traveled: 0.0, joint });
        Some(Onward { ray: Ray { origin: point, direction, time_s: self.ray.time_s }, last })
    }

    /// Adds light of a lamp that is scattered on this segment.
    fn add(&self, radiance: &mut impl Tally, shadow_ray: Option<ShadowRay>) {
        if let Some(ShadowRay { light, thin_dielectrics, .. }) = shadow_ray {
            radiance.add(light, self.depth + 1 + thin_dielectrics);
        }
    }

    /// The segment for equi-angular samples; `None` where there is nothing to sample.
    fn inscatter(&self, sigma: &Sigma, throughput: SampledSpectrum) -> Option<Inscatter> {
        let worth = throughput.element_sum() > 0.0 && self.depth < self.settings.max_depth && !self.medium.is_subsurface;
        if sigma.scattering == SampledSpectrum::ZERO || !worth || !self.scene.lights().has_finite(self.flash) {
            return None;
        }
        let [near, far] = self.span;
        let extinction = (throughput / throughput.element_sum()).dot(sigma.extinction);
        let far = far.min(near + DEEPEST / sigma.extinction.min_element());
        if !(near < far && extinction > 0.0) {
            return None;
        }
        let segment = Segment { origin: self.ray.origin, direction: self.ray.direction, near, far, extinction };
        let (asymmetry, time_s, flash, start) = (self.medium.asymmetry, self.ray.time_s, self.flash, self.start);
        let (always, extinction) = (self.vertex == 0, 0.25 * sigma.extinction.element_sum());
        Some(Inscatter { segment, asymmetry, extinction, start, always, time_s, flash })
    }

    /// Light of a lamp that is scattered into the ray, by an equi-angular sample; `None` where there is none. `u` decides whether it is taken.
    fn equiangular(&self, inscatter: &Inscatter, sigma: &Sigma, throughput: SampledSpectrum, u: f32) -> Option<ShadowRay> {
        let (scene, segment) = (self.scene, &inscatter.segment);
        let [choice, along, place @ ..] = self.sampler.get(Dimensions::Inscatter(self.segment_index));
        let (light, chosen) = scene.lights().choose_along(segment, choice, self.flash)?;
        let pivot = scene.pivot(light, self.ray.time_s)?;
        let fraction = inscatter.fraction(&pivot);
        if u >= fraction {
            return None;
        }
        let distances = EquiAngular::new(segment, &pivot, inscatter.asymmetry)?;
        let distance = distances.sample(along);
        let density = chosen * fraction * distances.density(distance);
        let joint = inscatter.joint(scene, light, &pivot) * distances.density(distance);
        self.scattered_in(inscatter, sigma, throughput, light, distance, [density, joint], place)
    }

    /// Light of a lamp that is scattered into the ray, whose direction was drawn about the lamp; `None` where there is none. `throughput`: as of a path that had drawn
    /// the direction itself; `u`: for the distance and the point on the lamp.
    pub(super) fn sample_light_jointly(&self, light: LightRef, throughput: SampledSpectrum, u: [f32; 3]) -> Option<ShadowRay> {
        let sigma = self.medium.at(self.wavelengths);
        let inscatter = self.inscatter(&sigma, throughput)?;
        let pivot = self.scene.pivot(light, self.ray.time_s)?;
        let distances = EquiAngular::new(&inscatter.segment, &pivot, inscatter.asymmetry)?;
        let distance = distances.sample(u[0]);
        let along = distances.density(distance);
        let equiangular =
            self.scene.lights().probability_along(&inscatter.segment, light, self.flash) * inscatter.fraction(&pivot) * along;
        let joint = inscatter.joint(self.scene, light, &pivot) * along;
        self.scattered_in(&inscatter, &sigma, throughput, light, distance, [joint, equiangular], [u[1], u[2]])
    }

    /// What a lamp sends to a distance of the segment and into the ray, weighted; densities: of the strategy that drew it, of the other one that looks from the lamp.
    #[allow(clippy::too_many_arguments)]
    fn scattered_in(
        &self,
        inscatter: &Inscatter,
        sigma: &Sigma,
        throughput: SampledSpectrum,
        light: LightRef,
        distance: f32,
        [density, other]: [f32; 2],
        place: [f32; 2],
    ) -> Option<ShadowRay> {
        let (scene, near) = (self.scene, inscatter.segment.near);
        let point = self.ray.at(distance);
        let light_sample = scene.sample_li(light, point, place, self.ray.time_s)?;
        if !(density > 0.0 && density.is_finite()) {
            return None;
        }
        let phase = phase(self.ray.direction.dot(light_sample.wi), inscatter.asymmetry);
        let by_extinction = sigma.density(distance - near, throughput);
        let by_light = by_extinction * scene.lights().finite_probability(point, light, self.flash);
        let by_phase = if light_sample.has_extent { by_extinction * phase / light_sample.pdf } else { 0.0 };
        let weight = mis(density, by_light.hypot(by_phase).hypot(other));
        let left = throughput * sigma.scattering * sigma.transmittance(distance - near);
        let light = scene.incident_radiance(&light_sample, self.wavelengths, self.ray.time_s);
        Some(self.transmitted_from_light(point, left * light * (phase * weight / (density * light_sample.pdf)), &light_sample))
    }

    /// Light that arrives at a scattering vertex, by next-event estimation; `None` where there is none.
    fn sample_ld(&self, on: &MediumScatter, point: Vec3, throughput: SampledSpectrum) -> Option<ShadowRay> {
        let scene = self.scene;
        let u = self.sampler.get(Dimensions::Light(self.vertex));
        let (light, probability) = scene.lights().choose(point, Vec3::ZERO, u[2], self.flash)?;
        let light_sample = scene.sample_li(light, point, [u[0], u[1]], self.ray.time_s)?;
        let phase = phase(self.ray.direction.dot(light_sample.wi), self.medium.asymmetry);
        let density = probability * light_sample.pdf;
        let by_phase = if light_sample.has_extent { phase } else { 0.0 };
        let weight = mis(density, by_phase.hypot(on.equiangular(scene, light) * light_sample.pdf));
        let light = scene.incident_radiance(&light_sample, self.wavelengths, self.ray.time_s);
        Some(self.transmitted_from_light(point, throughput * light * (phase * weight / density), &light_sample))
    }

    /// What is left of light from a lamp at a place of the segment.
    fn transmitted_from_light(&self, point: Vec3, light: SampledSpectrum, light_sample: &crate::light::LightSample) -> ShadowRay {
        let thin_dielectrics = self.settings.max_depth - self.depth - 1;
        let stream = || self.sampler.stream(Dimensions::Transmittance(self.vertex));
        // What panes do to the polarisation is lost where the medium scatters.
        self.scene.shadow_ray(
            &mut (),
            light,
            point,
            point,
            light_sample,
            self.medium_stack,
            None,
            self.wavelengths,
            self.ray.time_s,
            thin_dielectrics,
            stream,
        )
    }
}
