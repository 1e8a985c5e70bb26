//! Fresnel equations and the GGX distribution of normals, in a frame whose +z is the macroscopic normal.
//!
//! Sources: Walter et al. 2007 (refraction), Heitz 2014 (height-correlated shadowing), Dupuy & Benyoub 2023, "Sampling
//! Visible GGX Normals with Spherical Caps", Turquin 2019, "Practical multiple scattering compensation for microfacet
//! models". α is the width of the distribution (the square of glTF's roughness).

use diopter_light::SampledSpectrum;
use glam::Vec3;
use std::f32::consts::{PI, TAU};

/// Below this width a surface is treated as a perfect mirror.
pub const SMOOTH: f32 = 1e-3;

/// Reflectance, 0 to 1, of a dielectric interface for unpolarised light; `eta` = n beyond / n on the side light comes from, the sign of `cos_i` does not count. Source:
/// PBR 9.3.5.
#[inline]
pub fn fresnel_dielectric(cos_i: f32, eta: f32) -> f32 {
    let cos_i = cos_i.abs().min(1.0);
    let sin2_t = (1.0 - cos_i * cos_i) / (eta * eta);
    if sin2_t >= 1.0 {
        return 1.0;
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    let parallel = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    let perpendicular = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    0.5 * (parallel * parallel + perpendicular * perpendicular)
}

/// The cosine at which a smooth dielectric reflects a fraction: the angle at which facets of a rough one are met on the whole, by what it reflects.
pub(super) fn cosine_of(reflected: f32, ior: f32) -> f32 {
    let (mut low, mut high) = (0.0f32, 1.0f32);
    for _ in 0..10 {
        let middle = 0.5 * (low + high);
        if fresnel_dielectric(middle, ior) > reflected { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Reflectance, 0 to 1, of a conductor n + ik against air for unpolarised light, at four wavelengths; `cos_i` in 0..1. Source: PBR 9.3.6.
#[inline]
pub fn fresnel_conductor(cos_i: f32, n: SampledSpectrum, k: SampledSpectrum) -> SampledSpectrum {
    let c = cos_i.clamp(0.0, 1.0);
    let (c2, s2) = (c * c, 1.0 - c * c);
    let (n2, k2) = (n * n, k * k);
    let t0 = n2 - k2 - s2;
    let a2b2 = sqrt(t0 * t0 + n2 * k2 * 4.0);
    let t1 = a2b2 + c2;
    let a = sqrt(((a2b2 + t0) * 0.5).max(SampledSpectrum::ZERO));
    let t2 = a * (2.0 * c);
    let rs = (t1 - t2) / (t1 + t2);
    let t3 = a2b2 * c2 + s2 * s2;
    let t4 = t2 * s2;
    let rp = rs * (t3 - t4) / (t3 + t4);
    (rs + rp) * 0.5
}

fn sqrt(v: SampledSpectrum) -> SampledSpectrum {
    SampledSpectrum::new(v.x.sqrt(), v.y.sqrt(), v.z.sqrt(), v.w.sqrt())
}

/// Schlick's reflectance with `f0` at normal incidence and 1 at grazing; `cos_i` in 0..1. Source: Schlick 1994, "An Inexpensive BRDF Model".
#[inline]
pub fn fresnel_schlick(cos_i: f32, f0: SampledSpectrum) -> SampledSpectrum {
    let m = (1.0 - cos_i).clamp(0.0, 1.0);
    let m5 = (m * m) * (m * m) * m;
    f0 + (SampledSpectrum::ONE - f0) * m5
}

/// The GGX distribution of facets' normals: its widths α along the frame's x and y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ggx {
    /// Along x.
    pub x: f32,
    /// Along y.
    pub y: f32,
}

impl Ggx {
    /// The same width α (0 to 1) in all directions.
    #[inline]
    pub fn even(alpha: f32) -> Self {
        Ggx { x: alpha, y: alpha }
    }

    /// A distribution of two widths α (0 to 1), along x and y; a mirror is one in both directions or in none.
    #[inline]
    pub fn new(x: f32, y: f32) -> Self {
        if x.max(y) < SMOOTH { Ggx { x, y } } else { Ggx { x: x.max(SMOOTH), y: y.max(SMOOTH) } }
    }

    /// Whether this is a perfect mirror.
    #[inline]
    pub fn is_smooth(&self) -> bool {
        self.x.max(self.y) < SMOOTH
    }

    /// Whether both of its widths reach `least`.
    #[inline]
    pub fn is_wide(&self, least: f32) -> bool {
        self.x.min(self.y) >= least
    }

    /// √α of an even distribution that is about as wide: by the geometric mean.
    #[inline]
    pub fn roughness(&self) -> f32 {
        if self.x == self.y { self.x.sqrt() } else { (self.x * self.y).sqrt().sqrt() }
    }

    /// √α sideways of a direction, where it is oblique: tilts that way always bend light farther from the normal.
    pub fn roughness_aside(&self, w: Vec3) -> f32 {
        if self.x == self.y {
            return self.x.sqrt();
        }
        ((self.y * w.x).powi(2) + (self.x * w.y).powi(2) + self.x * self.y * w.z * w.z).sqrt().sqrt()
    }

    /// Density of normals D(h), 1/sr, of a unit normal h. Source: Walter et al. 2007, eq. 33; anisotropic as PBR 9.6.1.
    #[inline]
    pub fn d(&self, h: Vec3) -> f32 {
        let product = self.x * self.y;
        let (x2, y2) = if self.x == self.y { (1.0, 1.0) } else { (self.y / self.x, self.x / self.y) };
        let t = x2 * h.x * h.x + y2 * h.y * h.y + product * h.z * h.z;
        product / (PI * t * t)
    }

    #[inline]
    fn lambda(&self, w: Vec3) -> f32 {
        let z2 = w.z * w.z;
        if z2 == 0.0 {
            return f32::INFINITY;
        }
        let (x, y) = (self.x * w.x, self.y * w.y);
        0.5 * ((1.0 + (x * x + y * y) / z2).sqrt() - 1.0)
    }

    /// Fraction, 0 to 1, of microfacets with normal in the half space of the unit vector `w` that are visible from it (Smith). Source: Heitz 2014, eq. 43.
    #[inline]
    pub fn g1(&self, w: Vec3) -> f32 {
        1.0 / (1.0 + self.lambda(w))
    }

    /// Fraction, 0 to 1, visible from both, height-correlated. Source: Heitz 2014, eq. 99.
    #[inline]
    pub fn g2(&self, wo: Vec3, wi: Vec3) -> f32 {
        1.0 / (1.0 + self.lambda(wo) + self.lambda(wi))
    }

    /// Unit normal drawn, by two numbers in [0, 1), in proportion to its visibility from `wo` (unit, z > 0); density `G1 D max(wo·h, 0) / wo.z`, 1/sr. Source: Dupuy &
    /// Benyoub 2023.
    #[inline]
    pub fn sample_visible(&self, wo: Vec3, u: [f32; 2]) -> Vec3 {
        let v = Vec3::new(wo.x * self.x, wo.y * self.y, wo.z).normalize();
        let phi = TAU * u[0];
        let z = (1.0 - u[1]) * (1.0 + v.z) - v.z;
        let r = (1.0 - z * z).clamp(0.0, 1.0).sqrt();
        let h = Vec3::new(r * phi.cos(), r * phi.sin(), z) + v;
        Vec3::new(h.x * self.x, h.y * self.y, h.z.max(1e-7)).normalize()
    }

    /// Density of [`Ggx::sample_visible`] over half vectors, 1/sr.
    #[inline]
    pub fn visible_pdf(&self, wo: Vec3, h: Vec3) -> f32 {
        self.g1(wo) * self.d(h) * wo.dot(h).max(0.0) / wo.z.abs().max(1e-7)
    }
}

/// Mirror direction of `w` about the unit vector `h`; both point away from the surface.
#[inline]
pub fn reflect(w: Vec3, h: Vec3) -> Vec3 {
    h * (2.0 * w.dot(h)) - w
}

/// Unit direction of the unit vector `w` refracted about the unit normal `h` (w·h > 0) into a medium of relative index `eta` (n beyond / n before); `None` under total
/// reflection. Both directions point away from the surface. Source: Walter et al. 2007, eq. 40.
#[inline]
pub fn refract(w: Vec3, h: Vec3, eta: f32) -> Option<Vec3> {
    let cos_i = w.dot(h);
    let sin2_t = (1.0 - cos_i * cos_i).max(0.0) / (eta * eta);
    if sin2_t >= 1.0 {
        return None;
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    Some(h * (cos_i / eta - cos_t) - w / eta)
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_light::sampling;

    #[test]
    fn fresnel_has_its_textbook_values() {
        let cos = cosine_of(fresnel_dielectric(0.4, 1.5), 1.5);
        assert!((cos - 0.4).abs() < 1e-3, "{cos}");
        assert!((fresnel_dielectric(1.0, 1.5) - 0.04).abs() < 1e-6);
        assert!(fresnel_dielectric(0.0, 1.5) > 0.999);
        // Brewster's angle: p-polarised light vanishes, so R = Rs/2.
        let brewster = 1.5f32.atan().cos();
        let rs = ((1.0 - 2.25f32) / (1.0 + 2.25)).powi(2);
        assert!((fresnel_dielectric(brewster, 1.5) - rs / 2.0).abs() < 1e-5);
        // Inside glass beyond the critical angle.
        assert_eq!(fresnel_dielectric(0.5, 1.0 / 1.5), 1.0);
        // A conductor without absorption is a dielectric.
        let f = fresnel_conductor(0.4, SampledSpectrum::splat(1.5), SampledSpectrum::ZERO);
        assert!((f.x - fresnel_dielectric(0.4, 1.5)).abs() < 1e-5);
    }

    #[test]
    fn projected_normals_integrate_to_one() {
        // ∫ D(h) cos h dh = 1, in the projected hemisphere.
        for facets in [Ggx::even(0.05), Ggx::even(0.3), Ggx::even(1.0), Ggx::new(0.1, 0.5), Ggx::new(0.9, 0.2)] {
            let n = 600;
            let mut sum = 0.0;
            for i in 0..n {
                for j in 0..n {
                    let h = sampling::cosine_hemisphere([(i as f32 + 0.5) / n as f32, (j as f32 + 0.5) / n as f32]);
                    sum += (facets.d(h) * PI) as f64;
                }
            }
            let integral = sum / (n * n) as f64;
            assert!((integral - 1.0).abs() < 0.02, "{facets:?}: {integral}");
        }
    }

    #[test]
    fn visible_normals_follow_their_density() {
        // χ² over 12 × 24 bins of (cos θ, φ); the expected counts by midpoint integration within each bin.
        let cases = [(0.9f32, Ggx::even(0.2)), (0.4, Ggx::even(0.6)), (0.1, Ggx::even(1.0)), (0.6, Ggx::new(0.15, 0.6))];
        for (cos_o, facets) in cases {
            let sin = (1.0 - cos_o * cos_o).sqrt();
            let wo = Vec3::new(0.8 * sin, 0.6 * sin, cos_o);
            let (nz, nphi, draws) = (12, 24, 200);
            let mut counts = vec![0.0f64; nz * nphi];
            for i in 0..draws {
                for j in 0..draws {
                    let s = diopter_light::random::mix(i * draws + j);
                    let u =
                        [diopter_light::random::to_unit(s), diopter_light::random::to_unit(diopter_light::random::mix(s ^ 77))];
                    let h = facets.sample_visible(wo, u);
                    let phi = h.y.atan2(h.x).rem_euclid(TAU);
                    counts
                        [((h.z * nz as f32) as usize).min(nz - 1) * nphi + ((phi / TAU * nphi as f32) as usize).min(nphi - 1)] +=
                        1.0;
                }
            }
            let (mut chi2, mut bins) = (0.0, 0);
            let sub = 40;
            for (b, count) in counts.iter().enumerate() {
                let mut p = 0.0;
                for a in 0..sub {
                    for c in 0..sub {
                        let z = ((b / nphi) as f32 + (a as f32 + 0.5) / sub as f32) / nz as f32;
                        let phi = ((b % nphi) as f32 + (c as f32 + 0.5) / sub as f32) / nphi as f32 * TAU;
                        let r = (1.0 - z * z).sqrt();
                        p += facets.visible_pdf(wo, Vec3::new(r * phi.cos(), r * phi.sin(), z)) as f64;
                    }
                }
                let expected = p / (sub * sub) as f64 * TAU as f64 / (nz * nphi) as f64 * (draws * draws) as f64;
                if expected > 5.0 {
                    chi2 += (count - expected).powi(2) / expected;
                    bins += 1;
                }
            }
            let nu = bins as f64;
            assert!(chi2 < nu + 4.0 * (2.0 * nu).sqrt() + 8.0, "cos {cos_o} {facets:?}: χ² {chi2} of {nu} bins");
        }
    }

    #[test]
    fn refraction_obeys_snell() {
        let w = Vec3::new(0.6, 0.0, 0.8);
        let t = refract(w, Vec3::Z, 1.5).unwrap();
        assert!((t.x + 0.4).abs() < 1e-6 && t.z < 0.0 && (t.length() - 1.0).abs() < 1e-6);
        assert!(refract(Vec3::new(0.8, 0.0, 0.6), Vec3::Z, 1.0 / 1.5).is_none());
    }
}
