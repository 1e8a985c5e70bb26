//! How surfaces scatter: roughness and dust.

use super::random::Random;
use glam::DVec2;

/// Knee and slope of the scatter of polished glass. Typical values: L 10⁻⁴ to 0.01, S −0.5 to −2; these are the defaults of FRED's Harvey–Shack model
/// (its help, "Harvey-Shack").
const POLISH: [f64; 2] = [0.01, -1.5];
/// Of the light that dust takes one half is diffracted about specks of some 30 µm (550 nm / 30 µm; Airy's pattern falls as the third power).
const DIFFRACTED: [f64; 2] = [0.018, -3.0];
/// The other half, that specks reflect and refract, goes far. A stand-in for sums over Mie patterns.
const REFRACTED: [f64; 2] = [0.3, -2.0];

/// What the surfaces of a lens are like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Finish {
    /// Root mean square roughness, nm: polished glass has 0.5 to 2.
    pub roughness_nm: f64,
    /// Cleanliness level of IEST-STD-CC1246 (the largest specks, µm): about 100 to 300 for new lenses, 500 and more for dusty ones; 0 or 1: no dust.
    pub cleanliness: f64,
}

impl Default for Finish {
    /// 1 nm, level 300: a clean lens.
    fn default() -> Self {
        Finish { roughness_nm: 1.0, cleanliness: 300.0 }
    }
}

impl Finish {
    /// Neither rough nor dusty.
    pub const PERFECT: Finish = Finish { roughness_nm: 0.0, cleanliness: 0.0 };

    /// Fraction of the area that specks cover: log₁₀(100 · fraction) = −7.245 + 0.926 log₁₀² of the level (Ma, Fong & Lee 1989, as Fest 2013 gives it).
    pub fn dust_fraction(&self) -> f64 {
        if self.cleanliness <= 1.0 {
            return 0.0;
        }
        (10f64.powf(-7.245 + 0.926 * self.cleanliness.log10().powi(2)) / 100.0).min(0.5)
    }

    /// Fraction of the light that goes through a surface that roughness scatters: (2π σ Δn / λ)², Δn the step of index × cosine (total integrated scatter
    /// of a smooth surface). At most 0.5.
    pub fn rough_fraction(&self, step: f64, nm: f64) -> f64 {
        (2.0 * std::f64::consts::PI * self.roughness_nm * step / nm).powi(2).min(0.5)
    }
}

/// Light scattered about a direction, over the distance r of direction cosines (times the index) from it: ∝ (1 + (r / l)²)^(s / 2), Harvey and Shack's
/// form.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lobe {
    /// Knee.
    pub l: f64,
    /// Slope.
    pub s: f64,
}

impl Lobe {
    /// The lobe of roughness; the knee is a spatial frequency and grows with the wavelength.
    pub fn polish(nm: f64) -> Lobe {
        Lobe { l: POLISH[0] * nm / 550.0, s: POLISH[1] }
    }

    /// The lobe of dust; `u` from 0 to 1 chooses between what is diffracted and what is refracted.
    pub fn dust(u: f64, nm: f64) -> Lobe {
        match u < 0.5 {
            true => Lobe { l: DIFFRACTED[0] * nm / 550.0, s: DIFFRACTED[1] },
            false => Lobe { l: REFRACTED[0], s: REFRACTED[1] },
        }
    }

    /// Integral over the disk of radius `r`, but for a factor.
    fn within(&self, r: f64) -> f64 {
        let x = 1.0 + (r / self.l).powi(2);
        let power = 0.5 * (self.s + 2.0);
        if power.abs() < 1e-9 { x.ln() } else { (x.powf(power) - 1.0) / power }
    }

    /// Fraction of the light in a disk of radius `most` that lies within `r`; both in direction cosines times the index.
    pub fn fraction(&self, r: f64, most: f64) -> f64 {
        self.within(r) / self.within(most)
    }

    /// Distance within which a fraction `u` of what lies in a disk of radius `most` is.
    pub fn radius(&self, u: f64, most: f64) -> f64 {
        let all = self.within(most) * u;
        let power = 0.5 * (self.s + 2.0);
        let x = if power.abs() < 1e-9 { all.exp() } else { (1.0 + power * all).max(0.0).powf(1.0 / power) };
        self.l * (x - 1.0).max(0.0).sqrt()
    }

    /// Direction cosines along a surface, in a medium of an index, of light scattered about `from`; what would leave the half space is drawn again, so
    /// that no light is lost.
    pub(super) fn scatter(&self, from: DVec2, index: f64, random: &mut Random) -> DVec2 {
        for _ in 0..32 {
            let r = self.radius(random.draw(), 2.0 * index) / index;
            let to = from + DVec2::from_angle(std::f64::consts::TAU * random.draw()) * r;
            if to.length_squared() < 1.0 {
                return to;
            }
        }
        from
    }
}
