//! Diffraction in the exposure.
//!
//! A sample of a pixel is drawn from a film point that is displaced by the aperture's Fraunhofer pattern ([`diopter_lens::diffraction`]): light that geometry
//! would bring there arrives here. The picture is the geometric one convolved with the pattern; even light stays as even as it was, since every pixel
//! gathers its own samples. The four wavelengths of a path share the displacement, which each of them could have drawn: they are weighted by their
//! density over the mean of the four (balance heuristic, Veach & Guibas 1995), behind a lens with dispersion together with the densities of the ray.
//!
//! Lamps are so bright that what they send far out would be noise of rare samples: see [`super::starbursts`].

use crate::camera::{Camera, Film};
use diopter_lens::Lens;
use glam::DVec2;

/// Whether light is diffracted at the aperture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum Diffraction {
    /// Rays only.
    #[default]
    Off,
    /// By the shape of the aperture. A pinhole has none, and behind microlenses it is left out.
    On {
        /// Electrons that saturate the film, of an exposure in electrons: samples at least as bright are lamps, whose light far from them is spread without
        /// their noise. Without it (and in exposures larger than memory) all light is treated alike.
        white_e: Option<f64>,
    },
}

/// Radius of the Airy disk over the distance of two pixels from which diffraction shows: it then takes a fifth of the contrast of the finest detail.
const SHOWS: f64 = 0.5;
/// Green light, mm.
const GREEN_MM: f64 = 550e-6;
/// Distance from a lamp to which its light is gathered sample by sample, pixels: what is nearer is saturated in any case.
const CORE_PX: f64 = 3.0;

/// Whether diffraction shows in a picture through a lens: where the first dark ring of green light, 1.22 λN from the middle, is at least half a pixel of the
/// picture away. Not through a pinhole, which stands for a camera that is sharp everywhere, nor behind microlenses.
pub fn diffraction_shows(lens: &Lens, film: &Film) -> bool {
    let pitch = film.width_mm / film.columns.max(1) as f64;
    let airy = 0.61 * GREEN_MM / lens.pupil_slope().max(1e-9);
    !matches!(lens, Lens::Pinhole(_)) && film.microlenses.is_none() && airy >= SHOWS * pitch
}

/// Diffraction of a camera.
#[derive(Clone, Debug)]
pub(super) struct Optics {
    pub lens: diopter_lens::Diffraction,
    /// Brightness from which samples are lamps.
    pub white_e: Option<f32>,
    /// Whether film points beyond the film have rays: of an ideal lens only.
    boundless: bool,
}

/// How a sample is displaced.
#[derive(Clone, Copy, Debug)]
pub(super) struct Displaced {
    /// On the film, mm.
    pub by: DVec2,
    /// Densities of this displacement by wavelength, 1/mm².
    pub densities: [f32; 4],
    /// Whether it is short enough to be gathered from lamps.
    pub in_core: bool,
    /// Fractions of the light within the core, by wavelength: by the densities, and in truth.
    pub core: [[f32; 2]; 4],
}

impl Optics {
    /// The diffraction of a camera; `None` where nothing is diffracted. `electrons`: the film counts electrons.
    pub fn of(camera: &Camera, setting: Diffraction, electrons: bool) -> Option<Optics> {
        let Diffraction::On { white_e } = setting else { return None };
        let film = &camera.film;
        if film.microlenses.is_some() {
            return None;
        }
        let core_mm = CORE_PX * film.width_mm / film.columns.max(1) as f64;
        Some(Optics {
            lens: diopter_lens::Diffraction::new(&camera.lens, film.reach(), core_mm)?,
            white_e: white_e.filter(|_| electrons).map(|e| e as f32),
            boundless: matches!(camera.lens, Lens::Thin(_)),
        })
    }

    /// The displacement of a sample of the pixel whose middle lies at a film point, mm.
    #[inline]
    pub fn displaced(&self, middle: DVec2, nm: [f32; 4], u: [f32; 2]) -> Displaced {
        let kernel = self.lens.at(middle);
        let by = kernel.draw(u, nm[0]);
        let core = match self.white_e {
            None => [[1.0; 2]; 4],
            Some(_) => nm.map(|nm| kernel.within_core(nm).map(|v| v as f32)),
        };
        let in_core = by.length() <= self.lens.core_mm();
        Displaced { by, densities: nm.map(|nm| kernel.density(by, nm)), in_core, core }
    }

    /// Where a film point is asked for: itself, or as far within the film as it lies beyond it. Real lenses and calibrations are known for the film alone;
    /// light that would arrive beyond its edge is taken for that of the other side.
    #[inline]
    pub fn on_film(&self, film: &Film, at: DVec2) -> DVec2 {
        if self.boundless {
            return at;
        }
        let middle = DVec2::from_array(film.center_mm);
        let half = 0.5 * DVec2::new(film.width_mm, film.height_mm);
        let fold = |v: f64, half: f64| if v.abs() > half { (2.0 * half).copysign(v) - v } else { v };
        let placed = at + middle;
        DVec2::new(fold(placed.x, half.x), fold(placed.y, half.y)).clamp(-half, half) - middle
    }
}

impl Displaced {
    /// What each wavelength counts, given the densities with which each would have drawn the ray as the hero (any common unit): its density over the mean
    /// of the four.
    #[inline]
    pub fn factors(&self, rays: [f32; 4]) -> [f32; 4] {
        let all: f32 = rays.iter().sum();
        let joint: f32 = rays.iter().zip(self.densities).map(|(r, d)| r * d).sum();
        let factor = all / joint;
        // Between two cells of the table rounding may find the darker one.
        if factor.is_finite() { self.densities.map(|d| d * factor) } else { [1.0; 4] }
    }

    /// What each wavelength of a lamp counts in the pixel that gathers it: nothing beyond the core, all of what belongs there within.
    #[inline]
    pub fn gathered(&self) -> [f32; 4] {
        match self.in_core {
            true => self.core.map(|[table, truth]| if table > 0.0 { truth / table } else { 0.0 }),
            false => [0.0; 4],
        }
    }

    /// Fraction of the light of each wavelength that a lamp sends beyond the core.
    #[inline]
    pub fn wings(&self) -> [f32; 4] {
        self.core.map(|[_, truth]| 1.0 - truth)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CameraMotion;
    use diopter_lens::{Focus, Iris, Pinhole, ThinLens};
    use diopter_light::units::Millimeters;
    use glam::Vec3;

    fn camera(f_number: f64, columns: usize) -> Camera {
        let lens = ThinLens::new(Millimeters(50.0), f_number, Iris::Round, Focus::Infinity).unwrap();
        let place = crate::camera::look_at(Vec3::ZERO, Vec3::NEG_Z, Vec3::Y).unwrap();
        let film = Film::new(36.0, 24.0, columns, columns * 2 / 3);
        Camera { lens: Lens::Thin(lens), film, motion: CameraMotion::still(place) }
    }

    #[test]
    fn it_shows_where_the_airy_disk_is_no_smaller_than_a_pixel() {
        // 24 megapixels, 6 µm: 1.22 · 0.55 µm · N = 3 µm at f/4.5.
        let at = |n: f64, columns: usize| {
            let camera = camera(n, columns);
            diffraction_shows(&camera.lens, &camera.film)
        };
        assert!(!at(2.8, 6000) && !at(4.0, 6000) && at(5.6, 6000) && at(16.0, 6000));
        // A small picture does not resolve it.
        assert!(!at(16.0, 600));
        let hole = Lens::Pinhole(Pinhole::new(Millimeters(50.0), 16.0).unwrap());
        assert!(!diffraction_shows(&hole, &Film::new(36.0, 24.0, 6000, 4000)));
    }

    #[test]
    fn wavelengths_share_a_displacement_without_gain_or_loss() {
        // The mean of each wavelength's factor over displacements drawn by any of the four is 1.
        let camera = camera(16.0, 6000);
        let optics = Optics::of(&camera, Diffraction::On { white_e: Some(1e4) }, true).unwrap();
        let nm = [430.0f32, 510.0, 590.0, 670.0];
        let n = 1 << 12;
        let mut sums = [0.0f64; 4];
        let mut lamps = [0.0f64; 4];
        for i in 0..n {
            let u = [0.754_877_67f64, 0.569_840_3].map(|a| ((0.5 + a * f64::from(i / 4)).fract()) as f32);
            let hero = (i % 4) as usize;
            let turned: [f32; 4] = std::array::from_fn(|k| nm[(hero + k) % 4]);
            let d = optics.displaced(DVec2::new(4.0, 3.0), turned, u);
            let factors = d.factors([1.0; 4]);
            assert!((factors.iter().sum::<f32>() - 4.0).abs() < 1e-3, "{factors:?}");
            for k in 0..4 {
                sums[(hero + k) % 4] += f64::from(factors[k]) / f64::from(n);
                // A lamp in even surroundings: what is gathered and what is sent beyond.
                let lamp = factors[k] * (d.gathered()[k] + d.wings()[k]);
                lamps[(hero + k) % 4] += f64::from(lamp) / f64::from(n);
            }
        }
        // 1024 even displacements.
        assert!(sums.iter().all(|s| (s - 1.0).abs() < 0.01), "{sums:?}");
        assert!(lamps.iter().all(|s| (s - 1.0).abs() < 0.012), "{lamps:?}");
    }

    #[test]
    fn points_beyond_the_film_of_a_real_lens_are_folded_back() {
        let film = Film { center_mm: [2.0, 0.0], ..Film::new(36.0, 24.0, 600, 400) };
        let optics =
            Optics { boundless: false, ..Optics::of(&camera(16.0, 600), Diffraction::On { white_e: None }, true).unwrap() };
        assert_eq!(optics.on_film(&film, DVec2::new(3.0, -11.0)), DVec2::new(3.0, -11.0));
        let folded = optics.on_film(&film, DVec2::new(16.5, -12.25));
        assert!((folded - DVec2::new(15.5, -11.75)).length() < 1e-12, "{folded}");
        let ideal = Optics { boundless: true, ..optics };
        assert_eq!(ideal.on_film(&film, DVec2::new(16.5, -12.25)), DVec2::new(16.5, -12.25));
    }
}
