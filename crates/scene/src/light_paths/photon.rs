//! Stored photons: position, and power at the wavelengths of camera paths.

use crate::medium::Medium;
use diopter_light::wavelength::{FIRST_NM, LAST_NM};
use diopter_light::{SampledSpectrum, SampledWavelengths};
use glam::{Vec2, Vec3};

/// A photon that has landed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Photon {
    /// Where, m.
    pub point: Vec3,
    /// Unit direction it came from.
    pub(super) from: [i16; 2],
    /// Geometric unit normal on the side where it arrived.
    pub(super) normal: [i16; 2],
    /// Power over the lamp's spectrum, at its four wavelengths.
    pub(super) relative: [f32; 4],
    /// The first of its wavelengths, nm; the others follow at equal steps. Not used for colours.
    pub(super) hero_nm: f32,
    /// When, s within the exposure.
    pub time_s: f32,
    /// Number of its lamp.
    pub lamp: u32,
    /// Scattering events between the lamp and here.
    pub events: u16,
    pub(super) spectrum: PhotonSpectrum,
}

/// What the four lanes of a photon are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PhotonSpectrum {
    /// Red, green, blue.
    Colors,
    /// Nearly the same at all wavelengths.
    Even,
    /// Wavelengths that differ.
    Different,
    /// Only the first counts.
    Hero,
}

impl PhotonSpectrum {
    /// Of a power at wavelengths of which only the first counts where it is `dispersed`.
    pub(super) fn of(wavelengths: &SampledWavelengths, dispersed: bool, power: SampledSpectrum) -> PhotonSpectrum {
        match (wavelengths.is_rgb(), dispersed) {
            (true, _) => PhotonSpectrum::Colors,
            (false, true) => PhotonSpectrum::Hero,
            (false, false) if power.max_element() - power.min_element() <= EVEN * power.max_element() => PhotonSpectrum::Even,
            _ => PhotonSpectrum::Different,
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
        let (relative, hero_nm, spectrum) = ([1.0; 4], FIRST_NM, PhotonSpectrum::Even);
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
    pub fn at(&self, wavelengths: &SampledWavelengths) -> SampledSpectrum {
        let relative = SampledSpectrum::from_array(self.relative);
        match self.spectrum {
            PhotonSpectrum::Colors => relative,
            PhotonSpectrum::Even => SampledSpectrum::from_array(wavelengths.nm.to_array().map(|nm| self.between(nm))),
            PhotonSpectrum::Different => SampledSpectrum::from_array(wavelengths.nm.to_array().map(|nm| {
                let (nearest, nm_away) = self.nearest(nm);
                relative[nearest] * kernel(nm, nm_away) * STEP_NM
            })),
            // The factor for the other three wavelengths is in the power already.
            PhotonSpectrum::Hero => {
                relative.x
                    * STEP_NM
                    * SampledSpectrum::from_array(wavelengths.nm.to_array().map(|nm| kernel(nm, (nm - self.hero_nm).abs())))
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
pub(super) fn packed(v: Vec3) -> [i16; 2] {
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

/// A photon in a medium.
#[derive(Clone, Copy, Debug)]
pub(super) struct VolumePhoton<'a> {
    /// Power as of photons that land, times m: over the density of its place along the segment. The normal means nothing.
    pub photon: Photon,
    pub medium: &'a Medium,
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_light::wavelength::WavelengthSampler;

    fn photon(spectrum: PhotonSpectrum, relative: impl Fn(f32) -> f32, w: &SampledWavelengths) -> Photon {
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
        let camera = SampledWavelengths::fixed([383.0, 470.0, 590.0, 779.0]);
        let uniform = WavelengthSampler::uniform();
        let n = 4000;
        for spectrum in [PhotonSpectrum::Even, PhotonSpectrum::Different, PhotonSpectrum::Hero] {
            let truth = |nm: f32| if spectrum == PhotonSpectrum::Even { line(nm) } else { smooth(nm) };
            let mut sum = SampledSpectrum::ZERO;
            for i in 0..n {
                let w = uniform.sample((i as f32 + 0.5) / n as f32);
                let mut p = photon(spectrum, truth, &w);
                if spectrum == PhotonSpectrum::Hero {
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
