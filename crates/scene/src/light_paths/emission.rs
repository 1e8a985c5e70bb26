//! Lamps as sources of photons: which lamp, from where, which way, with how much power.
//!
//! A photon's power is kept in two factors: the lamp's own spectrum (the *carrier*: of a lamp with one spectrum that spectrum, of coloured
//! pictures D65), which is looked up at the wavelengths of whoever gathers the photon, and what is relative to it, which is smooth. Lines of
//! a fluorescent tube so stay where they are. Power per nm of lamps with area: L cos θ A / density (W·nm⁻¹; L in W·m⁻²·sr⁻¹·nm⁻¹); of
//! points: I / density; of parallel light: E / density over the area that faces it. Source: PBR 4ed §12 (`SampleLe`), Jensen 2001 §5.2.

use super::casters::{Casters, Facing};
use super::{CausticSettings, Lamps};
use crate::light::punctual::{disc_density, disc_sr, within_disc};
use crate::light::{AreaLight, Modulation, PunctualKind};
use crate::medium::Air;
use crate::medium_stack::MediumStack;
use crate::scene::Scene;
use crate::shape::offset_origin;
use diopter_light::random::{Dimensions, Sampler};
use diopter_light::sampling::Discrete;
use diopter_light::{Ray, SampledSpectrum, SampledWavelengths, Spectrum};
use glam::Vec3;

/// Solid angle (sr) up to which lamps are left to photons where lamps are chosen by the scene: of larger ones chance finds more than one path in
/// twelve.
const SMALL_LAMP_SR: f32 = 0.5;

/// Areas of a lamp along their normals whose sum is below so much of its surface close a body.
const CLOSED: f32 = 0.05;

/// Least distance from which a lamp is judged, in radii of the scene: light of a bulb's filament lands far from its glass.
const LEAST_DISTANCE: f32 = 0.2;

/// The same of a disc at infinity: its half angle, rad. The sun's is 0.0047. Up to it light paths take its light for parallel.
pub(super) const SMALL_DISC: f32 = 0.17;

/// Least probability of a lamp, relative to the mean: estimates of what it sends to the casters can be far off.
const LEAST_CHANCE: f32 = 1e-2;

/// A lamp whose caustics are made by photons.
pub(super) struct Lamp<'a> {
    source: Source,
    /// Its spectrum; `None`: D65 of 1 cd/m².
    carrier: Option<&'a Spectrum>,
    modulation: Modulation,
    /// When it shines, s within the exposure.
    pub window: [f32; 2],
    /// Whether no ray can meet it.
    pub is_delta: bool,
    /// The bodies that it stands in.
    medium_stack: MediumStack,
}

#[derive(Clone, Copy, PartialEq)]
enum Source {
    Area(u32),
    Punctual(u32),
}

impl Lamp<'_> {
    /// Its spectrum at the wavelengths of a path, at a moment.
    pub fn spectrum(&self, scene: &Scene, wavelengths: &SampledWavelengths, time_s: f32) -> SampledSpectrum {
        let steady = match self.carrier {
            Some(spectrum) => spectrum.sample_light(wavelengths),
            None => wavelengths.d65_one_nit(),
        };
        steady * scene.modulated(&self.modulation, time_s)
    }
}

/// A photon that leaves its lamp.
pub(super) struct EmittedPhoton {
    pub ray: Ray,
    pub lamp: u32,
    /// Power over the lamp's spectrum and over the density of the ray.
    pub relative: SampledSpectrum,
    pub medium_stack: MediumStack,
}

/// All lamps whose caustics are made by photons.
pub(super) struct PhotonEmission<'a> {
    scene: &'a Scene,
    pub casters: Casters,
    pub lamps: Vec<Lamp<'a>>,
    choice: Discrete,
    /// Of each area light and of each punctual light, whether it is one of them.
    area: Vec<bool>,
    punctual: Vec<bool>,
    /// Middle and radius (m) of a sphere around everything.
    around: (Vec3, f32),
    span_s: f32,
}

impl<'a> PhotonEmission<'a> {
    /// Whether some lamps have no extent.
    pub fn has_delta_lamps(&self) -> bool {
        self.lamps.iter().any(|l| l.is_delta)
    }

    /// `None` where nothing throws caustics, or no lamp that photons should be emitted from.
    pub fn new(scene: &'a Scene, settings: &CausticSettings) -> Option<Self> {
        let casters = Casters::new(scene)?;
        let d = scene.description();
        let lights = scene.lights();
        let all = settings.lamps == Lamps::All;
        let everything = scene.bounds().union(casters.bounds());
        let around = (everything.center(), 0.5 * everything.size().length() * 1.001);
        if !around.0.is_finite() || !around.1.is_finite() {
            return None;
        }
        let span_s = settings.span_s as f32;

        // A lamp of many triangles is as large as all of them.
        let mut area = vec![all; lights.area.len()];
        if !all {
            for object in 0..d.objects.len() as u32 {
                let mut numbers: Vec<u32> = scene.area_lights_of(object).collect();
                numbers.dedup();
                let at = |n: &u32| &lights.area[*n as usize];
                let surface: f32 = numbers.iter().map(|n| at(n).area()).sum();
                // A convex closed body shows a quarter of its surface, on the mean of all directions (Cauchy 1832).
                let is_closed = numbers.iter().map(|n| at(n).area_vector()).sum::<Vec3>().length() < CLOSED * surface;
                let whole = if is_closed { 0.25 * surface } else { surface };
                let distance = |light: &AreaLight| casters.distance(light.center()).max(LEAST_DISTANCE * around.1);
                let seen = |light: &AreaLight| whole / distance(light).powi(2);
                let small = !numbers.is_empty() && numbers.iter().all(|n| seen(at(n)) < SMALL_LAMP_SR);
                numbers.iter().for_each(|n| area[*n as usize] = small);
            }
        }
        let small_disc = |k: PunctualKind| !matches!(k, PunctualKind::Disc { half_angle, .. } if half_angle > SMALL_DISC);
        let punctual: Vec<bool> = lights.punctual.iter().map(|l| all || small_disc(l.kind)).collect();

        let (mut lamps, mut chances) = (Vec::new(), Vec::new());
        let mean = |m: &Modulation| match m {
            Modulation::Pulse { energy, .. } if span_s > 0.0 => (*energy / f64::from(span_s)) as f32,
            _ => 1.0,
        };
        let window = |m: &Modulation| match m {
            Modulation::Pulse { start_s, length_s, .. } => {
                [*start_s, *start_s + *length_s].map(|t| (t as f32).clamp(0.0, span_s.max(0.0)))
            }
            _ => [0.0, span_s.max(0.0)],
        };
        for (i, light) in lights.area.iter().enumerate().filter(|(i, _)| area[*i]) {
            let material = &d.materials[light.material as usize];
            let Some(emission) = &material.emission else { continue };
            let placed = scene.area_light_at(i as u32, 0.0);
            let (facing, normal) = match placed.normal() {
                Some(n) if emission.two_sided => (Facing::Both(n), n),
                Some(n) => (Facing::Side(n), n),
                None => (Facing::All, Vec3::Y),
            };
            let flux = light.luminance * light.area() * casters.seen_from(placed.center(), facing);
            chances.push(flux * mean(&emission.modulation));
            let surface = match placed.normal() {
                Some(_) => placed.center(),
                None => placed.sample_surface([0.0, 0.0]).0,
            };
            let normal = if placed.normal().is_some() { normal } else { Vec3::Z };
            lamps.push(Lamp {
                source: Source::Area(i as u32),
                carrier: light.carrier(&d.materials),
                modulation: emission.modulation,
                window: window(&emission.modulation),
                is_delta: false,
                medium_stack: MediumStack::at(scene, surface, normal, around),
            });
        }
        for (i, light) in lights.punctual.iter().enumerate().filter(|(i, _)| punctual[*i]) {
            let kind = scene.punctual_place(i as u32, 0.0).map_or(light.kind, |p| light.kind.placed(&p));
            let (flux, medium_stack) = match kind {
                PunctualKind::Directional { .. } | PunctualKind::Disc { .. } => (casters.cross_section(), MediumStack::default()),
                PunctualKind::Point { position } | PunctualKind::Spot { position, .. } => {
                    (casters.seen_from(position, facing(kind)), MediumStack::at(scene, position, Vec3::Y, around))
                }
            };
            let picture = light.pattern.as_ref().map_or(1.0, |p| p.mean());
            chances.push(flux * light.illuminance() * picture * mean(&light.modulation));
            lamps.push(Lamp {
                source: Source::Punctual(i as u32),
                carrier: Some(&light.power),
                modulation: light.modulation,
                window: window(&light.modulation),
                is_delta: !matches!(kind, PunctualKind::Disc { .. }),
                medium_stack,
            });
        }
        if lamps.is_empty() {
            return None;
        }
        chances.iter_mut().for_each(|c| *c = if c.is_finite() { c.max(0.0) } else { 0.0 });
        let least = LEAST_CHANCE * chances.iter().sum::<f32>() / chances.len() as f32;
        chances.iter_mut().for_each(|c| *c = c.max(least));
        Some(PhotonEmission { scene, casters, lamps, choice: Discrete::new(&chances), area, punctual, around, span_s })
    }

    /// Whether photons stand for the caustics of an area light.
    #[inline]
    pub fn has_area(&self, light: u32) -> bool {
        self.area[light as usize]
    }

    /// Whether photons stand for the caustics of a punctual light.
    #[inline]
    pub fn has_punctual(&self, light: u32) -> bool {
        self.punctual[light as usize]
    }

    /// The photon that belongs to the numbers of a sampler; `None` where nothing is sent out.
    pub fn start(&self, sampler: &Sampler, wavelengths: &SampledWavelengths) -> Option<EmittedPhoton> {
        let [_, t, choose_lamp, choose_piece] = sampler.get(Dimensions::Time);
        let [a, b, c, d] = sampler.get(Dimensions::Camera);
        let (number, _) = self.choice.sample(choose_lamp);
        let chance = self.choice.probability(number);
        let lamp = &self.lamps[number];
        let [from, to] = lamp.window;
        let time_s = from + (to - from) * t;
        let (origin, direction, relative) = match lamp.source {
            Source::Area(i) => self.of_area(i, time_s, wavelengths, [a, b], choose_piece, [c, d])?,
            Source::Punctual(i) => self.of_punctual(i, time_s, wavelengths, [a, b], choose_piece, [c, d], sampler)?,
        };
        let relative = relative / chance;
        let ray = Ray { origin, direction, time_s };
        let bright = relative.max_element() > 0.0 && relative.is_finite();
        (bright && ray.is_finite()).then_some(EmittedPhoton {
            ray,
            lamp: number as u32,
            relative,
            medium_stack: lamp.medium_stack,
        })
    }

    fn of_area(
        &self,
        light: u32,
        time_s: f32,
        wavelengths: &SampledWavelengths,
        place: [f32; 2],
        choice: f32,
        u: [f32; 2],
    ) -> Option<(Vec3, Vec3, SampledSpectrum)> {
        let light = self.scene.area_light_at(light, time_s);
        let (point, normal, place) = light.sample_surface(place);
        let facing = if light.two_sided { Facing::Both(normal) } else { Facing::Side(normal) };
        let (direction, pdf) = self.casters.sample_direction(point, facing, choice, u)?;
        let cos = normal.dot(direction);
        if !(if light.two_sided { cos.abs() } else { cos } > 0.0) {
            return None;
        }
        let radiance = light.relative_radiance(place, &self.scene.description().materials, wavelengths);
        let origin = offset_origin(point, if cos > 0.0 { normal } else { -normal }, light.reach());
        Some((origin, direction, radiance * (cos.abs() * light.area() / pdf)))
    }

    #[allow(clippy::too_many_arguments)]
    fn of_punctual(
        &self,
        number: u32,
        time_s: f32,
        wavelengths: &SampledWavelengths,
        place: [f32; 2],
        choice: f32,
        u: [f32; 2],
        sampler: &Sampler,
    ) -> Option<(Vec3, Vec3, SampledSpectrum)> {
        let light = &self.scene.lights().punctual[number as usize];
        let node = self.scene.punctual_place(number, time_s);
        let kind = node.map_or(light.kind, |p| light.kind.placed(&p));
        let (direction, power) = match kind {
            PunctualKind::Point { position } | PunctualKind::Spot { position, .. } => {
                let (direction, pdf) = self.casters.sample_direction(position, facing(kind), choice, u)?;
                return Some((position, direction, light.relative_intensity(node.as_ref(), direction, wavelengths) / pdf));
            }
            PunctualKind::Directional { direction } => (direction, 1.0),
            PunctualKind::Disc { direction, half_angle } => {
                // Even over the solid angle, as it is aimed at; radiance is irradiance over the projected solid angle.
                let power = 1.0 / (disc_density(half_angle) * disc_sr(half_angle));
                (within_disc(direction, half_angle, place), power)
            }
        };
        let (point, pdf) = self.casters.sample_line(direction, choice, u)?;
        let (middle, radius) = self.around;
        let origin = point - direction * ((point - middle).dot(direction) + radius);
        let left = match self.scene.air() {
            // Endless air lets nothing through from infinity, or all of it.
            Some(Air { medium, bounds: None }) => {
                // From infinity to where the photon begins.
                let back = Ray { origin, direction: -direction, time_s };
                let mut stream = sampler.stream(Dimensions::Transmittance(0));
                medium.transmittance(&back, [0.0, f32::INFINITY], wavelengths, self.scene.moment_s(time_s), || &mut stream)
            }
            _ => SampledSpectrum::ONE,
        };
        Some((origin, direction, left * (power / pdf)))
    }

    /// How long the exposure takes, s.
    pub fn span_s(&self) -> f32 {
        self.span_s
    }
}

fn facing(kind: PunctualKind) -> Facing {
    match kind {
        PunctualKind::Spot { direction, cos_outer, .. } => Facing::Cone(direction, cos_outer.clamp(-1.0, 1.0).acos()),
        _ => Facing::All,
    }
}
