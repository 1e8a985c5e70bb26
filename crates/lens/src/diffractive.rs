//! Diffractive surfaces: ruled gratings, binary phases, holographic lenses, kinoforms.
//!
//! A surface of any shape carries a phase Ψ(x, y), radians for each order. Light of order m gets the path m λ Ψ / 2π, and its tangential momentum
//! changes by the gradient of that: n' d' = n d + m λ/2π ∇Ψ along the surface (Welford 1975, Opt. Commun. 14, 322, doi
//! 10.1016/0030-4018(75)90327-4; for a ruled grating the grating equation n' sin θ' = n sin θ + m λ / d). Ψ is the same at all wavelengths, so
//! that the power goes with λ: an Abbe number of −3.45. Lines stand on the surface as seen along its axis.
//!
//! One order is followed. How much light goes into it ([`Diffractive::efficiency`]): all, unless a blaze is given; then what scalar theory says
//! of a relief of the depth that sends everything of the blaze wavelength λ₀ there: with α = m (λ₀/λ) (Δn(λ)/Δn(λ₀)) order q gets sinc²(α − q), of a
//! staircase of N steps (sinc(q/N) sin π(α − q) / (N sin(π(α − q)/N)))² (Swanson 1989, MIT Lincoln
//! Laboratory Technical Report 854). Right where the zones are many wavelengths wide; shadows of steep zones, polarisation and light that the
//! relief throws back are not in it.

use crate::polynomial::Polynomial;
use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// Highest order.
pub const HIGHEST_ORDER: i32 = 1000;

/// The relief of a kinoform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blaze {
    /// Wavelength of which all light goes into the order, nm.
    pub nm: f64,
    /// Steps of a zone; `None` for a smooth relief.
    pub levels: Option<u32>,
}

/// A phase on a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Diffractive {
    order: i32,
    phase: Polynomial,
    blaze: Option<Blaze>,
}

/// A ray after a diffractive surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiffractedRay {
    /// Unit direction.
    pub direction: DVec3,
    /// Optical path that the surface adds, mm.
    pub path: f64,
}

impl Diffractive {
    /// `phase` in radians for each order. Fails beyond [`HIGHEST_ORDER`], and on a blaze outside 100 to 100 000 nm or of fewer than 2 or more than
    /// 1024 levels.
    pub fn new(order: i32, phase: Polynomial, blaze: Option<Blaze>) -> Result<Diffractive, String> {
        if order.abs() > HIGHEST_ORDER {
            return Err(format!("diffraction order {order}: expected -{HIGHEST_ORDER} to {HIGHEST_ORDER}"));
        }
        if let Some(b) = blaze {
            if !(b.nm >= 100.0 && b.nm <= 1e5) {
                return Err(format!("blaze wavelength {}: expected 100 to 100000 nm", b.nm));
            }
            if b.levels.is_some_and(|n| !(2..=1024).contains(&n)) {
                return Err(format!("{} levels: expected 2 to 1024", b.levels.unwrap_or(0)));
            }
        }
        Ok(Diffractive { order, phase, blaze })
    }

    /// The order that is followed.
    pub fn order(&self) -> i32 {
        self.order
    }

    /// Phase in radians for each order.
    pub fn phase(&self) -> &Polynomial {
        &self.phase
    }

    /// The relief, where one is given.
    pub fn blaze(&self) -> Option<Blaze> {
        self.blaze
    }

    /// Factor from the phase to the optical path (mm) at a wavelength in mm.
    pub(crate) fn path_per_phase(&self, wavelength_mm: f64) -> f64 {
        f64::from(self.order) * wavelength_mm / TAU
    }

    /// What becomes of a ray of a unit direction at a place where the surface has this unit normal; `n`: the indices before and after it, the
    /// same twice for a mirror. `None` where the order does not exist there. `place` in mm.
    pub fn bend(
        &self,
        place: DVec2,
        direction: DVec3,
        normal: DVec3,
        n: [f64; 2],
        mirror: bool,
        wavelength_mm: f64,
    ) -> Option<DiffractedRay> {
        let factor = self.path_per_phase(wavelength_mm);
        let (phase, by_x, by_y) = self.phase.at(place.x, place.y);
        let momentum = direction * n[0] + DVec3::new(by_x, by_y, 0.0) * factor;
        let along = momentum - normal * momentum.dot(normal);
        let rest = n[1] * n[1] - along.length_squared();
        if !(rest > 0.0) {
            return None;
        }
        let onwards = direction.dot(normal).signum() * if mirror { -1.0 } else { 1.0 };
        Some(DiffractedRay { direction: (along + normal * (onwards * rest.sqrt())) / n[1], path: factor * phase })
    }

    /// Fraction of the light of a wavelength (nm) that goes into an order. `steps`: index after less index before the surface (of a mirror twice the
    /// index before it), at that wavelength and at that of the blaze.
    pub fn efficiency(&self, order: i32, nm: f64, steps: [f64; 2]) -> f64 {
        let Some(blaze) = self.blaze else { return if order == self.order { 1.0 } else { 0.0 } };
        // Gratings within one medium have no relief of glass: their phase goes with 1/λ alone.
        let ratio = if steps[1] == 0.0 { 1.0 } else { steps[0] / steps[1] };
        let waves = f64::from(self.order) * blaze.nm / nm * ratio;
        match blaze.levels {
            None => sinc(waves - f64::from(order)).powi(2),
            Some(levels) => staircase(waves, order, levels),
        }
    }

    /// The phase in x where this one has that in y: what the y–z plane of the surface is in x–z.
    pub(crate) fn across(&self) -> Diffractive {
        let [across, along] = self.phase.curvatures();
        let mut phase = self.clone();
        if across != along {
            let radial = vec![0.5 * across * self.phase.norm_mm() * self.phase.norm_mm()];
            let terms = crate::polynomial::Terms { radial, ..Default::default() };
            if let Ok(round) = Polynomial::new(self.phase.norm_mm(), terms) {
                phase.phase = round;
            }
        }
        phase
    }

    /// Seen after half a turn about the x axis.
    pub(crate) fn turned_over(&self) -> Diffractive {
        Diffractive { phase: self.phase.turned_over(), ..self.clone() }
    }
}

/// sin πx / πx
fn sinc(x: f64) -> f64 {
    if x.abs() < 1e-9 { 1.0 } else { (PI * x).sin() / (PI * x) }
}

/// Fraction of the light that a staircase of N equal steps, `waves` (α) high over a whole zone, sends into order q: the sum of N steps of width 1/N,
/// (sinc(q/N) · sin π(α − q) / (N sin(π(α − q)/N)))².
fn staircase(waves: f64, order: i32, levels: u32) -> f64 {
    let (n, q) = (f64::from(levels), f64::from(order));
    let below = (PI * (waves - q) / n).sin();
    let sum = if below.abs() < 1e-9 { 1.0 } else { (PI * (waves - q)).sin() / (n * below) };
    (sinc(q / n) * sum).powi(2)
}
