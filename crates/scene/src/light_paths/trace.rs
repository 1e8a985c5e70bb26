//! One photon from its lamp over mirrors and through glass, and what it leaves where it lands and in media on its way.

use super::emission::{Emission, Start};
use super::volume_map::VolumePhoton;
use crate::material::Scattering;
use crate::medium::Medium;
use crate::radiance::{MOST_FACES, past};
use crate::scene::Scene;
use diopter_light::random::{Sampler, Set};
use diopter_light::wavelength::{FIRST_NM, LAST_NM};
use diopter_light::{Ray, Sampled, Wavelengths};
use glam::{Vec2, Vec3};

/// A photon that has landed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Photon {
    /// Where, m.
    pub point: Vec3,
    /// Unit direction it came from.
    from: [i16; 2],
    /// Geometric unit normal on the side where it arrived.
    normal: [i16; 2],
    /// Power over the lamp's spectrum, at its four wavelengths.
    relative: [f32; 4],
    /// The first of its wavelengths, nm; the others follow at equal steps. Not used for colours.
    hero_nm: f32,
    /// When, s within the exposure.
    pub time_s: f32,
    /// Number of its lamp.
    pub lamp: u32,
    /// Scattering events between the lamp and here.
    pub events: u16,
    spectrum: Lanes,
}

/// What the four lanes of a photon are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lanes {
    /// Red, green, blue.
    Colors,
    /// Nearly the same at all wavelengths.
    Even,
    /// Wavelengths that differ.
    Different,
    /// Only the first counts.
    Hero,
}

impl Lanes {
    /// Of a power at wavelengths of which only the first counts where it is `dispersed`.
    fn of(wavelengths: &Wavelengths, dispersed: bool, power: Sampled) -> Lanes {
        match (wavelengths.is_rgb(), dispersed) {
            (true, _) => Lanes::Colors,
            (false, true) => Lanes::Hero,
            (false, false) if power.max_element() - power.min_element() <= EVEN * power.max_element() => Lanes::Even,
            _ => Lanes::Different,
        }
    }
}

/// Difference of the four wavelengths, relative to the largest, up to which a photon is taken for linear between them. Clear glass and
/// aluminium stay below, coloured glass does not; the error of a straight line between wavelengths 100 nm apart is a fraction of it.
const EVEN: f32 = 0.1;

/// Half width of the triangular kernel (nm) that brings the wavelengths of photons and of camera paths together where they differ. Its
/// standard deviation is 10 nm: that much spectra of coloured glass and rainbows are blurred.
const KERNEL_NM: f32 = 25.0;

/// Distance between a photon's wavelengths, nm: they are uniform over the visible range.
const STEP_NM: f32 = 0.25 * (LAST_NM - FIRST_NM);

impl Photon {
    /// One at a point, with nothing else to it.
    #[cfg(test)]
    pub fn for_tests(point: Vec3) -> Photon {
        let up = packed(Vec3::Y);
        let (relative, hero_nm, spectrum) = ([1.0; 4], FIRST_NM, Lanes::Even);
        Photon { point, from: up, normal: up, relative, hero_nm, time_s: 0.0, lamp: 0, events: 1, spectrum }
    }

    /// Unit direction it came from.
    #[inline]
    pub fn from(&self) -> Vec3 {
        unpacked(self.from)
    }

    /// Geometric unit normal on the side where it arrived.
    #[inline]
    pub fn normal(&self) -> Vec3 {
        unpacked(self.normal)
    }

    /// Its power over the lamp's spectrum, per nm, at the wavelengths of a camera path: an estimate whose mean over the photon's own
    /// wavelengths is right where spectra are smooth.
    #[inline]
    pub fn at(&self, wavelengths: &Wavelengths) -> Sampled {
        let relative = Sampled::from_array(self.relative);
        match self.spectrum {
            Lanes::Colors => relative,
            Lanes::Even => Sampled::from_array(wavelengths.nm.to_array().map(|nm| self.between(nm))),
            Lanes::Different => Sampled::from_array(wavelengths.nm.to_array().map(|nm| {
                let (nearest, nm_away) = self.nearest(nm);
                relative[nearest] * kernel(nm, nm_away) * STEP_NM
            })),
            // The factor for the other three wavelengths is in the power already.
            Lanes::Hero => {
                relative.x
                    * STEP_NM
                    * Sampled::from_array(wavelengths.nm.to_array().map(|nm| kernel(nm, (nm - self.hero_nm).abs())))
            }
        }
    }

    /// Place of a wavelength among the photon's own ones, in steps from the shortest; and which lane that is.
    #[inline]
    fn place(&self, nm: f32) -> (f32, usize) {
        let hero = (self.hero_nm - FIRST_NM) / STEP_NM;
        let below = (hero as usize).min(3);
        ((nm - FIRST_NM) / STEP_NM - (hero - below as f32), below)
    }

    /// Linear between its wavelengths.
    #[inline]
    fn between(&self, nm: f32) -> f32 {
        let (x, below) = self.place(nm);
        let x = x.clamp(0.0, 3.0);
        let k = (x as usize).min(2);
        let at = |k: usize| self.relative[(k + 4 - below) & 3];
        at(k) + (at(k + 1) - at(k)) * (x - k as f32)
    }

    /// The lane whose wavelength is nearest, and the distance, nm.
    #[inline]
    fn nearest(&self, nm: f32) -> (usize, f32) {
        let (x, below) = self.place(nm);
        let k = x.round().clamp(0.0, 3.0);
        ((k as usize + 4 - below) & 3, (x - k).abs() * STEP_NM)
    }
}

/// Triangular kernel, 1/nm, over a distance (nm) from a wavelength; normalised to what of it lies in the visible range.
#[inline]
fn kernel(nm: f32, away: f32) -> f32 {
    if away >= KERNEL_NM {
        return 0.0;
    }
    let beyond = |inside: f32| 0.5 * (1.0 - inside / KERNEL_NM).max(0.0).powi(2);
    let whole = 1.0 - beyond(nm - FIRST_NM) - beyond(LAST_NM - nm);
    (1.0 - away / KERNEL_NM) / (KERNEL_NM * whole)
}

/// A unit vector in four bytes: on an octahedron. Source: Cigolle et al. 2014, "A Survey of Efficient Representations for Independent Unit
/// Vectors", JCGT 3(2).
fn packed(v: Vec3) -> [i16; 2] {
    let p = Vec2::new(v.x, v.y) / (v.x.abs() + v.y.abs() + v.z.abs());
    let sign = Vec2::new(1f32.copysign(p.x), 1f32.copysign(p.y));
    let p = if v.z < 0.0 { (Vec2::ONE - Vec2::new(p.y, p.x).abs()) * sign } else { p };
    p.to_array().map(|c| (c * 32767.0).round() as i16)
}

fn unpacked(p: [i16; 2]) -> Vec3 {
    let [x, y] = p.map(|c| f32::from(c) / 32767.0);
    let z = 1.0 - x.abs() - y.abs();
    let t = (-z).max(0.0);
    Vec3::new(x - t.copysign(x), y - t.copysign(y), z).normalize()
}

/// Photons of some lamps, where they are after specular scattering by a caster.
#[derive(Default)]
pub(super) struct Traced<'a> {
    /// On surfaces.
    pub landed: Vec<Photon>,
    /// In media that gather photons ([`Medium::scatters_homogeneously`]): one on each segment.
    pub in_media: Vec<VolumePhoton<'a>>,
}

/// Traces the photon that belongs to the numbers of a sampler, and adds it where it lands and on segments in media; `scale` multiplies its power.
pub(super) fn trace<'a>(
    emission: &Emission<'a>,
    scene: &'a Scene,
    sampler: &Sampler,
    wavelengths: &Wavelengths,
    max_depth: u32,
    scale: f32,
    traced: &mut Traced<'a>,
) {
    let Some(Start { mut ray, lamp, relative, mut medium_stack }) = emission.start(sampler, wavelengths) else { return };
    let mut power = relative * scale;
    let (mut hero_only, mut dispersed) = (wavelengths.is_rgb(), false);
    let (mut events, mut is_caustic) = (0, false);
    let mut numbers = None;
    for _ in 0..MOST_FACES {
        let surface = scene.intersect(&ray, f32::INFINITY);
        let reach = surface.as_ref().map_or(f32::INFINITY, |s| s.t);
        if let Some((medium, span)) = medium_stack.span(scene, &ray, reach) {
            if is_caustic && medium.scatters_homogeneously() && events < max_depth {
                let u = sampler.get(Set::Medium(events))[0];
                if let Some((distance, relative)) = on_segment(medium, span, power, wavelengths, u) {
                    let from = packed(-ray.direction);
                    let photon = Photon {
                        point: ray.at(distance),
                        from,
                        normal: from,
                        relative: relative.to_array(),
                        hero_nm: wavelengths.nm.x,
                        time_s: ray.time_s,
                        lamp,
                        events: events.min(u32::from(u16::MAX)) as u16,
                        spectrum: Lanes::of(wavelengths, dispersed, relative),
                    };
                    traced.in_media.push(VolumePhoton { photon, medium });
                }
            }
            // What is scattered on the way is no caustic any more.
            power *= medium.transmittance(&ray, span, wavelengths, scene.moment_s(ray.time_s), || {
                numbers.get_or_insert_with(|| sampler.stream(Set::Tracking(0)))
            });
        }
        let Some(surface) = surface else { return };
        let material = scene.material(surface.object);
        let entering = surface.ng.dot(ray.direction) < 0.0;
        if medium_stack.hides(scene, surface.object, entering) || matches!(material.scattering, Scattering::Interface) {
            medium_stack.cross(scene, surface.object, entering);
            ray.origin = past(&surface, ray.direction);
            continue;
        }
        let around = medium_stack.around(scene, surface.object);
        let Some(bsdf) = material.bsdf(&surface, -ray.direction, wavelengths, hero_only, around) else { return };
        // The event of the camera's path that gathers it is one more.
        if events + 1 > max_depth || !(power.max_element() > 0.0) {
            return;
        }
        let ng = bsdf.side_normal();
        // Strands are narrower than the discs within which photons are gathered.
        if is_caustic && !bsdf.is_specular() && !surface.is_strand() && power.is_finite() {
            traced.landed.push(Photon {
                point: surface.point,
                from: packed(-ray.direction),
                normal: packed(ng),
                relative: power.to_array(),
                hero_nm: wavelengths.nm.x,
                time_s: ray.time_s,
                lamp,
                events: events.min(u32::from(u16::MAX)) as u16,
                spectrum: Lanes::of(wavelengths, dispersed, power),
            });
        }
        // Only specular events make caustics.
        let u = sampler.get(Set::Scatter(events));
        let Some(scatter) = bsdf.sample(u).filter(|s| s.specular) else { return };
        let is_straight = scatter.transmitted && bsdf.straight_through().is_some();
        if !is_straight && !emission.casters.casts(surface.object) {
            return;
        }
        is_caustic |= !is_straight;
        let before = power.max_element();
        power *= scatter.weight * bsdf.shading_correction(scatter.wi);
        if scatter.transmitted {
            // Radiance changes by η² where it is bent, power does not (Veach 1997 §5.2).
            power *= scatter.eta_scale;
            medium_stack.cross(scene, surface.object, entering);
        }
        // Roulette keeps the power of photons alike.
        let survival = (power.max_element() / before).min(1.0);
        if !(u[3] < survival) {
            return;
        }
        power /= survival;
        if scatter.disperses && !hero_only {
            power *= wavelengths.hero_only();
            (hero_only, dispersed) = (true, true);
        }
        events += 1;
        let normal = if scatter.transmitted { -ng } else { ng };
        ray = Ray { origin: surface.leave(normal, scatter.wi), direction: scatter.wi, time_s: ray.time_s };
    }
}

/// A place (m) on the part of a ray that is in a homogeneous medium, drawn by what is left there of a photon, and its power there over the density of the place,
/// times m. `None` where none is left.
fn on_segment(
    medium: &Medium,
    [near, far]: [f32; 2],
    power: Sampled,
    wavelengths: &Wavelengths,
    u: f32,
) -> Option<(f32, Sampled)> {
    let sigma = medium.at(wavelengths);
    let total = power.element_sum();
    if !(total > 0.0 && total.is_finite() && near < far) || sigma.scattering == Sampled::ZERO {
        return None;
    }
    // Exponential up to the end, of the mean extinction.
    let extinction = (power / total).dot(sigma.extinction);
    let depth = extinction * (far - near);
    let (distance, density) = match depth < 1e-3 {
        true => (u * (far - near), 1.0 / (far - near)),
        false => {
            let reaching = 1.0 - (-depth).exp();
            let distance = -(1.0 - u * reaching).ln() / extinction;
            (distance, extinction * (-extinction * distance).exp() / reaching)
        }
    };
    let relative = power * sigma.transmittance(distance) / density;
    (relative.is_finite() && relative.max_element() > 0.0).then_some((near + distance, relative))
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_light::wavelength::WavelengthSampler;

    fn photon(spectrum: Lanes, relative: impl Fn(f32) -> f32, w: &Wavelengths) -> Photon {
        let zero = packed(Vec3::Z);
        let relative = w.nm.to_array().map(relative);
        let hero_nm = w.nm.x;
        Photon { point: Vec3::ZERO, from: zero, normal: zero, relative, hero_nm, time_s: 0.0, lamp: 0, events: 1, spectrum }
    }

    #[test]
    fn directions_survive_packing() {
        for i in 0..2000u32 {
            let u = [0, 1].map(|k| diopter_light::random::to_unit(diopter_light::random::mix(2 * i + k)));
            let v = diopter_light::sampling::sphere(u);
            // Half a step of 1/32767 in both coordinates, stretched at most twofold.
            assert!((unpacked(packed(v)) - v).length() < 1e-4, "{v}");
        }
    }

    #[test]
    fn the_mean_over_a_photons_wavelengths_is_its_spectrum() {
        let smooth = |nm: f32| 1.0 + 0.3 * (nm / 60.0).sin();
        let line = |nm: f32| 1.0 + 0.0002 * (nm - 500.0);
        let camera = Wavelengths::fixed([383.0, 470.0, 590.0, 779.0]);
        let uniform = WavelengthSampler::uniform();
        let n = 4000;
        for spectrum in [Lanes::Even, Lanes::Different, Lanes::Hero] {
            let truth = |nm: f32| if spectrum == Lanes::Even { line(nm) } else { smooth(nm) };
            let mut sum = Sampled::ZERO;
            for i in 0..n {
                let w = uniform.sample((i as f32 + 0.5) / n as f32);
                let mut p = photon(spectrum, truth, &w);
                if spectrum == Lanes::Hero {
                    p.relative = [4.0 * p.relative[0], 0.0, 0.0, 0.0];
                }
                sum += p.at(&camera) / n as f32;
            }
            for (nm, found) in camera.nm.to_array().into_iter().zip(sum.to_array()) {
                // The kernel's blur of a wave of this length is 1.4 %; at the ends it leans inwards.
                let off = found / truth(nm) - 1.0;
                let limit = if (400.0..760.0).contains(&nm) { 0.01 } else { 0.05 };
                assert!(off.abs() < limit, "{spectrum:?} {nm}: {off}");
            }
        }
    }
}
