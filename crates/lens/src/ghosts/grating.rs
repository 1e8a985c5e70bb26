//! What the microlenses of a sensor make of the light that it throws back: orders of a grating ("red dots", "petals" around a lamp).
//!
//! A microlens stands on every pixel: a periodic bump, whose reflection is a phase of period `pitch` in x and in y. Light that comes in a direction (l, m) leaves in the directions (l + i λ / pitch_x,
//! m + j λ / pitch_y) (grating equation; Born & Wolf §8.6.1), and each order's power is the square of the Fourier coefficient of the reflected phase over one pixel. That sensors act so, and that
//! their orders are the ghosts that are seen, by electromagnetic simulation of pixels and ray tracing: Optics Express 29 (2021) 37639.
//!
//! Nobody publishes the shape of a sensor's microlenses: here they are spheres of a radius of one pitch without gaps (to second order, h = −(x² + y²) / 2R, which is exact enough where R is a pitch,
//! and separates x from y), that reflect half of what the sensor reflects; cover glass and filters, which are plane, the other half. Orders are taken at normal incidence. The period of colour filters
//! (two pitches), whose orders are coloured, is not in it.

use super::GhostTracer;
use std::f64::consts::PI;

/// Part of what a sensor reflects that its microlenses reflect: a figure of order, not of a product.
pub const MICROLENS_FRACTION: f64 = 0.5;
/// Radius of curvature of a microlens, in pitches: one of resin (n = 1.55) focuses 2.8 pitches behind itself.
const RADIUS_IN_PITCHES: f64 = 1.0;
/// Pixels larger than this have orders so near to one another that they are not dots, mm.
const LARGEST_PITCH_MM: f64 = 0.02;
/// Places across a pixel over which its phase is summed, for each order that there is.
const PLACES: usize = 64;

/// The grating at one wavelength.
#[derive(Clone, Debug, PartialEq)]
pub struct Grating {
    /// Change of the direction cosines in x and y from order to order.
    step: [f64; 2],
    /// Fraction of the light of orders 0, ±1, ±2, ... along x and along y.
    efficiency: [Vec<f64>; 2],
}

impl Grating {
    /// The grating of pixels of these pitches (mm), at a wavelength in nm; `None` for pixels too large or too small to be a grating.
    pub fn new(pitch_mm: [f64; 2], nm: f64) -> Option<Grating> {
        let wavelength = nm * 1e-6;
        let fits = |pitch: f64| pitch > 0.5 * wavelength && pitch <= LARGEST_PITCH_MM;
        pitch_mm.iter().all(|p| fits(*p)).then(|| Grating {
            step: pitch_mm.map(|pitch| wavelength / pitch),
            efficiency: pitch_mm.map(|pitch| efficiencies(pitch / wavelength)),
        })
    }

    /// Change of the direction cosines of an order.
    pub fn turn(&self, order: [i32; 2]) -> [f64; 2] {
        [0, 1].map(|k| f64::from(order[k]) * self.step[k])
    }

    /// Fraction of the light that microlenses reflect that goes into an order.
    pub fn efficiency(&self, order: [i32; 2]) -> f64 {
        let along = |k: usize| self.efficiency[k].get(order[k].unsigned_abs() as usize).copied().unwrap_or(0.0);
        along(0) * along(1)
    }

    /// Highest orders in x and y that some light can leave in.
    pub fn highest(&self) -> [i32; 2] {
        [0, 1].map(|k| self.efficiency[k].len() as i32 - 1)
    }
}

/// Efficiencies of orders 0, 1, 2, ... of one row of cylindrical bumps whose pitch is so many wavelengths; those of −1, −2, ... are the same.
fn efficiencies(pitch: f64) -> Vec<f64> {
    // No direction cosine changes by more than 2.
    let highest = (2.0 * pitch) as usize;
    let places = PLACES * (highest + 1);
    let of = |order: usize| {
        let (mut re, mut im) = (0.0, 0.0);
        for i in 0..places {
            let x = (i as f64 + 0.5) / places as f64 - 0.5;
            // Twice the depth below the top, in wavelengths: the way there and back.
            let phase = 2.0 * PI * pitch * x * x / RADIUS_IN_PITCHES;
            // Symmetric: the sine drops out.
            let wave = (2.0 * PI * order as f64 * x).cos() / places as f64;
            (re, im) = (re + phase.cos() * wave, im + phase.sin() * wave);
        }
        re * re + im * im
    };
    (0..=highest).map(of).collect()
}

impl GhostTracer<'_> {
    /// The same lens before a sensor whose microlenses are a grating, of pixels of these pitches, mm.
    pub fn with_microlenses(mut self, pitch_mm: [f64; 2]) -> Self {
        self.grating = Grating::new(pitch_mm, self.nm);
        self
    }

    /// The grating of the sensor, if it has one.
    pub fn grating(&self) -> Option<&Grating> {
        self.grating.as_ref()
    }

    /// Fraction of the light that the sensor throws back into an order.
    pub(super) fn sensor_reflectance(&self, order: [i32; 2]) -> f64 {
        let Some(grating) = &self.grating else {
            return if order == [0; 2] { self.sensor_reflectance } else { 0.0 };
        };
        let plane = if order == [0; 2] { 1.0 - MICROLENS_FRACTION } else { 0.0 };
        self.sensor_reflectance * (plane + MICROLENS_FRACTION * grating.efficiency(order))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_share_all_of_the_light() {
        for pitch in [0.9e-3, 1.4e-3, 3.76e-3, 5.36e-3, 8.4e-3] {
            let grating = Grating::new([pitch; 2], 550.0).unwrap();
            let [highest, _] = grating.highest();
            let sum: f64 = (-highest..=highest).map(|i| grating.efficiency([i, 0]) / grating.efficiency([0, 0]).sqrt()).sum();
            // A little goes beyond the orders that a parabola's slopes can reach: its edges diffract.
            assert!((sum - 1.0).abs() < 0.02, "{pitch}: {sum}");
            // The steepest slope, half a pitch over the radius, turns light by twice itself: that is order pitch / wavelength.
            let within = (pitch / 550e-6) as i32 + 1;
            let inner: f64 = (-within..=within).map(|i| grating.efficiency([i, 0]) / grating.efficiency([0, 0]).sqrt()).sum();
            assert!(inner > 0.9, "{pitch}: {inner}");
        }
        assert!(Grating::new([0.05; 2], 550.0).is_none() && Grating::new([0.0; 2], 550.0).is_none());
    }

    #[test]
    fn efficiencies_are_those_of_fresnel_s_integral() {
        // Order m of x² phase: |∫ exp(i 2π (p x² − m x)) dx|² over a pitch, by Fresnel's integrals C and S from the power series (Abramowitz & Stegun 7.3.11, 7.3.13).
        let fresnel = |z: f64| {
            let (mut c, mut s) = (0.0, 0.0);
            let t = 0.5 * PI * z * z;
            let (mut term, mut n) = (1.0, 0.0);
            while n < 400.0 {
                // term = t^n / n!
                match n as i32 % 4 {
                    0 => c += term / (2.0 * n + 1.0),
                    1 => s += term / (2.0 * n + 1.0),
                    2 => c -= term / (2.0 * n + 1.0),
                    _ => s -= term / (2.0 * n + 1.0),
                }
                n += 1.0;
                term *= t / n;
            }
            (z * c, z * s)
        };
        let pitch = 2.5;
        let found = efficiencies(pitch);
        for (order, found) in found.iter().enumerate().take(4) {
            // p x² − m x = p (x − m / 2p)² − const; u = 2 √p (x − m / 2p).
            let scale = 2.0 * f64::sqrt(pitch);
            let middle = order as f64 / (2.0 * pitch);
            let (a, b) = (fresnel(scale * (0.5 - middle)), fresnel(scale * (-0.5 - middle)));
            let expected = ((a.0 - b.0).powi(2) + (a.1 - b.1).powi(2)) / (scale * scale);
            assert!((found - expected).abs() < 1e-4, "{order}: {found} {expected}");
        }
    }
}
