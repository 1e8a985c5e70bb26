//! Hair and fur: what a fibre with a scaled cuticle and pigment within does with light.
//!
//! Light is reflected (R), goes through (TT), is reflected once within (TRT), or more often. Each lobe is a product of a distribution along the fibre
//! (longitudinal, in θ) and one around it (azimuthal, in φ). Source: M. Chiang, B. Bitterli, C. Tappan, B. Burley 2016, "A Practical and
//! Controllable Hair and Fur Model for Production Path Tracing" (CGF 35(2)), as pbrt-v4 has it (M. Pharr 2016, "The Implementation of a Hair
//! Scattering Model"); longitudinal distributions are those of E. d'Eon et al. 2011, "An Energy-Conserving Hair Reflectance Model". In the local
//! frame x runs along the fibre towards its tip; θ is the angle to the plane across it, φ the angle in that plane.
//!
//! Differences from pbrt: the modified Bessel function is computed to single precision, which takes the error of energy from 2 % to rounding, and
//! absorption by melanin is upsampled for each of its two kinds. Limits: fibres are round, their medulla is not modelled.

use super::inputs::{inputs_enum, inputs_struct};
use super::local_scatter::LocalScatter;
use super::microfacet::fresnel_dielectric;
use crate::shape::Surface;
use crate::texture::{Color, Graph, Scalar};
use diopter_light::spectrum::Table;
use diopter_light::upsample::Sigmoid;
use diopter_light::{SampledSpectrum, SampledWavelengths, Spectrum};
use glam::Vec3;
use std::f32::consts::{PI, TAU};
use std::sync::Arc;

/// Lobes: R, TT, TRT, and all that are reflected within more often.
const LOBES: usize = 4;
/// Absorption by eumelanin (brown, black) and pheomelanin (red) of concentration 1, linear sRGB, per radius of the fibre. Source: E. d'Eon et al.
/// 2011, §6.1.
const MELANIN: [Vec3; 2] = [Vec3::new(0.419, 0.697, 1.37), Vec3::new(0.187, 0.4, 1.05)];
/// Least roughness: below it lobes are narrower than single precision can tell directions apart.
const LEAST_BETA: f32 = 0.01;
/// Least reflectance that an absorption is derived from.
const LEAST_REFLECTANCE: f32 = 1e-5;

/// A fibre.
#[derive(Clone, Debug)]
pub struct Hair {
    /// What absorbs light in it.
    pub pigment: Pigment,
    /// Index of refraction.
    pub eta: f32,
    /// Roughness along the fibre, 0 to 1.
    pub beta_m: Scalar,
    /// Roughness around it, 0 to 1.
    pub beta_n: Scalar,
    /// Tilt of the cuticle's scales, degrees.
    pub alpha: Scalar,
}

inputs_struct!(Hair { pigment, beta_m, beta_n, alpha } without { eta });

/// What absorbs light in a fibre.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Pigment {
    /// An absorption coefficient, per radius of the fibre.
    Absorption(Spectrum),
    /// The same that differs from place to place, as linear sRGB.
    AbsorptionMap(Arc<Graph>),
    /// The colour that much hair of this kind has together under even light.
    Reflectance(Color),
    /// Concentrations of eumelanin and pheomelanin; made by [`Pigment::melanin`].
    Melanin {
        /// Of eumelanin: 0.3 blond, 1.3 brown, 8 black.
        eumelanin: Scalar,
        /// Of pheomelanin: red.
        pheomelanin: Scalar,
        /// Absorption of each at concentration 1.
        spectra: Box<[Spectrum; 2]>,
    },
}

inputs_enum!(Pigment {
    Absorption(spectrum),
    AbsorptionMap(graph),
    Reflectance(color),
    Melanin { eumelanin, pheomelanin, spectra },
});

impl Pigment {
    /// Melanin of two concentrations, each at least 0 (eumelanin: 0.3 blond, 1.3 brown, 8 black).
    pub fn melanin(eumelanin: Scalar, pheomelanin: Scalar) -> Self {
        Pigment::Melanin { eumelanin, pheomelanin, spectra: Box::new(MELANIN.map(absorption_spectrum)) }
    }
}

/// An absorption given as linear sRGB: a scaled sigmoid over wavelength (pbrt-v4's `RGBUnboundedSpectrum`, PBR 4ed §4.6.6).
fn absorption_spectrum(rgb: Vec3) -> Spectrum {
    let scale = 2.0 * rgb.max_element();
    let sigmoid = Sigmoid::from_rgb(rgb / scale);
    let table = Table::new(380.0, 5.0, (0..=80).map(|i| scale * sigmoid.at(380.0 + 5.0 * i as f32)).collect());
    Spectrum::TableOfRgb { table, rgb }
}

/// The same at the wavelengths of a path.
fn absorption(rgb: Vec3, wavelengths: &SampledWavelengths) -> SampledSpectrum {
    let rgb = rgb.max(Vec3::ZERO);
    let scale = 2.0 * rgb.max_element();
    match wavelengths.is_rgb() {
        true => SampledWavelengths::lanes(rgb),
        false if scale > 0.0 => Sigmoid::from_rgb(rgb / scale).sample(wavelengths) * scale,
        false => SampledSpectrum::ZERO,
    }
}

/// −ln(reflectance) over this is √σ: a fit to the colour of many fibres together by the roughness around them. Source: Chiang et al. 2016, eq. 9.
fn color_slope(beta_n: f32) -> f32 {
    let b = beta_n;
    5.969 + b * (-0.215 + b * (2.532 + b * (-10.73 + b * (5.574 + b * 0.245))))
}

impl Hair {
    /// Brown hair: eumelanin of 1.3, roughness 0.3 both ways, index 1.55, scales tilted by 2°.
    pub fn brown() -> Self {
        let number = Scalar::Constant;
        Hair {
            pigment: Pigment::melanin(number(1.3), number(0.0)),
            eta: 1.55,
            beta_m: number(0.3),
            beta_n: number(0.3),
            alpha: number(2.0),
        }
    }

    fn beta(scalar: &Scalar, surface: &Surface) -> f32 {
        let b = scalar.at(surface);
        // What is not a number becomes the least.
        if b > LEAST_BETA { b.min(1.0) } else { LEAST_BETA }
    }

    /// Absorption coefficient at a place, per radius of the fibre.
    fn sigma_a(&self, surface: &Surface, beta_n: f32, wavelengths: &SampledWavelengths) -> SampledSpectrum {
        let at_least_0 = |s: SampledSpectrum| s.max(SampledSpectrum::ZERO);
        match &self.pigment {
            Pigment::Absorption(spectrum) => at_least_0(spectrum.sample(wavelengths)),
            Pigment::AbsorptionMap(graph) => absorption(graph.at(&surface.lookup()), wavelengths),
            Pigment::Reflectance(color) => {
                let reflectance =
                    color.sample(surface, wavelengths).clamp(SampledSpectrum::splat(LEAST_REFLECTANCE), SampledSpectrum::ONE);
                let root = SampledSpectrum::from_array(reflectance.to_array().map(f32::ln)) / color_slope(beta_n);
                root * root
            }
            Pigment::Melanin { eumelanin, pheomelanin, spectra } => {
                let [a, b] = [eumelanin, pheomelanin].map(|c| c.at(surface).max(0.0));
                at_least_0(spectra[0].sample(wavelengths) * a + spectra[1].sample(wavelengths) * b)
            }
        }
    }

    /// The colour that much hair of this kind has together, linear sRGB: [`Pigment::Reflectance`] solved for it.
    pub(super) fn albedo(&self, surface: &Surface) -> Vec3 {
        if let Pigment::Reflectance(color) = &self.pigment {
            return color.linear_srgb(surface);
        }
        let beta_n = Self::beta(&self.beta_n, surface);
        let sigma = self.sigma_a(surface, beta_n, &SampledWavelengths::rgb()).truncate();
        (-color_slope(beta_n) * sigma.map(f32::sqrt)).exp()
    }

    /// The lobes at a place seen from `wo` (local). `h`: where across the fibre, −1 to 1, in the direction of z × x for z on the side of `wo`.
    pub(super) fn at(&self, surface: &Surface, h: f32, wo: Vec3, wavelengths: &SampledWavelengths) -> HairLobes {
        let beta_n = Self::beta(&self.beta_n, surface);
        let sigma_a = self.sigma_a(surface, beta_n, wavelengths);
        let alpha = self.alpha.at(surface);
        let alpha = if alpha.is_finite() { alpha.to_radians() } else { 0.0 };
        HairLobes::new(&Fiber { eta: self.eta, beta_m: Self::beta(&self.beta_m, surface), beta_n, alpha }, h, sigma_a, wo)
    }
}

/// The numbers of a fibre at a place; the tilt in rad.
struct Fiber {
    eta: f32,
    beta_m: f32,
    beta_n: f32,
    alpha: f32,
}

/// A fibre at a place, seen from one direction.
#[derive(Clone)]
pub(super) struct HairLobes {
    /// Fraction of the light that leaves by each lobe.
    attenuation: [SampledSpectrum; LOBES],
    /// Probability of each lobe.
    fraction: [f32; LOBES],
    /// Sine and cosine of θ of the view as each lobe sees it: turned by the tilt of the scales.
    theta: [[f32; 2]; LOBES],
    /// Variance along the fibre of each lobe.
    variance: [f32; LOBES],
    /// Scale of the logistic distribution around it.
    scale: f32,
    phi_o: f32,
    /// Direction of each lobe around the fibre, relative to the view.
    phi: [f32; LOBES - 1],
}

impl HairLobes {
    fn new(fiber: &Fiber, h: f32, sigma_a: SampledSpectrum, wo: Vec3) -> Self {
        let Fiber { eta, beta_m: m, beta_n: n, alpha } = *fiber;
        let h = h.clamp(-1.0, 1.0);
        // Roughness to variance and scale: Chiang et al. 2016, eqs. 7 and 8.
        let root = 0.726 * m + 0.812 * m * m + 3.7 * m.powi(20);
        let v = root * root;
        let scale = (PI / 8.0).sqrt() * (0.265 * n + 1.194 * n * n + 5.372 * n.powi(22));

        // Into the fibre and out again (PBR 4ed §9.9.2); a modified index makes the way in the plane across it (Marschner et al. 2003, eq. 6).
        let (sin_o, cos_o) = (wo.x.clamp(-1.0, 1.0), safe_sqrt(1.0 - wo.x * wo.x));
        let (sin_t, gamma_o) = (sin_o / eta, h.asin());
        let cos_t = safe_sqrt(1.0 - sin_t * sin_t);
        let eta_p = safe_sqrt(eta * eta - sin_o * sin_o) / cos_o.max(1e-6);
        let sin_gamma_t = (h / eta_p).clamp(-1.0, 1.0);
        let (cos_gamma_t, gamma_t) = (safe_sqrt(1.0 - sin_gamma_t * sin_gamma_t), sin_gamma_t.asin());
        let way = 2.0 * cos_gamma_t / cos_t.max(1e-6);
        let inside = SampledSpectrum::from_array(sigma_a.to_array().map(|s| (-s * way).exp()));

        // What each lobe carries: Chiang et al. 2016, eqs. 11 to 13; the last is the rest of the geometric series.
        let f = fresnel_dielectric(cos_o * safe_sqrt(1.0 - h * h), eta);
        let second = inside * ((1.0 - f) * (1.0 - f));
        let third = second * inside * f;
        let rest = third * inside * f / (SampledSpectrum::ONE - inside * f).max(SampledSpectrum::splat(1e-6));
        let attenuation = [SampledSpectrum::splat(f), second, third, rest];
        let total: f32 = attenuation.iter().map(|a| a.element_sum()).sum();
        let fraction = attenuation.map(|a| if total > 0.0 { a.element_sum() / total } else { 1.0 / LOBES as f32 });

        let turned = |by: f32| {
            let (s, c) = by.sin_cos();
            [sin_o * c + cos_o * s, (cos_o * c - sin_o * s).abs()]
        };
        HairLobes {
            attenuation,
            fraction,
            // Towards the root by 2α where it is reflected, away from it by α and 4α within (Marschner et al. 2003, §4).
            theta: [turned(-2.0 * alpha), turned(alpha), turned(4.0 * alpha), [sin_o, cos_o]],
            variance: [v, 0.25 * v, 4.0 * v, 4.0 * v],
            scale,
            phi_o: wo.z.atan2(wo.y),
            phi: [0, 1, 2].map(|p| 2.0 * p as f32 * gamma_t - 2.0 * gamma_o + p as f32 * PI),
        }
    }

    /// f cos θ, and the density of [`HairLobes::sample`], both over the whole sphere.
    pub fn eval(&self, wi: Vec3) -> (SampledSpectrum, f32) {
        let (sin_i, cos_i) = (wi.x.clamp(-1.0, 1.0), safe_sqrt(1.0 - wi.x * wi.x));
        let phi = wi.z.atan2(wi.y) - self.phi_o;
        let (mut value, mut density) = (SampledSpectrum::ZERO, 0.0);
        for p in 0..LOBES {
            let along = longitudinal([sin_i, cos_i], self.theta[p], self.variance[p]);
            let around = self.phi.get(p).map_or(1.0 / TAU, |center| trimmed_logistic(wrapped(phi - center), self.scale));
            value += self.attenuation[p] * (along * around);
            density += self.fraction[p] * along * around;
        }
        (value, density)
    }

    /// Draws a direction; `u` = along and around the cone of a lobe (2), choice of the lobe and azimuth.
    pub fn sample(&self, u: [f32; 4]) -> Option<LocalScatter> {
        // Choose a lobe; what is left of its number chooses the azimuth.
        let (mut p, mut below) = (0, 0.0);
        while p + 1 < LOBES && (u[2] >= below + self.fraction[p] || self.fraction[p] <= 0.0) {
            below += self.fraction[p];
            p += 1;
        }
        let again = ((u[2] - below) / self.fraction[p].max(f32::MIN_POSITIVE)).clamp(0.0, 1.0 - f32::EPSILON);

        // Along: a cone about the mirrored direction, of cosine 1 + v ln(u + (1 − u) e^(−2/v)) (d'Eon et al. 2013, "Importance Sampling for
        // Physically-Based Hair Fiber Models").
        let ([sin_o, cos_o], v) = (self.theta[p], self.variance[p]);
        let drop = (-v * (u[0] + (1.0 - u[0]) * (-2.0 / v).exp()).max(f32::MIN_POSITIVE).ln()).clamp(0.0, 2.0);
        let (cos, sin) = (1.0 - drop, (drop * (2.0 - drop)).sqrt());
        let sin_i = (-cos * sin_o + sin * (TAU * u[1]).cos() * cos_o).clamp(-1.0, 1.0);
        let cos_i = safe_sqrt(1.0 - sin_i * sin_i);
        let around = self.phi.get(p).map_or(TAU * again, |center| center + sample_trimmed_logistic(again, self.scale));
        let (s, c) = (self.phi_o + around).sin_cos();
        let wi = Vec3::new(sin_i, cos_i * c, cos_i * s);
        let (value, pdf) = self.eval(wi);
        (pdf > 0.0 && pdf.is_finite()).then(|| LocalScatter { wi, weight: value / pdf, pdf, specular: false, disperses: false })
    }
}

fn safe_sqrt(v: f32) -> f32 {
    v.max(0.0).sqrt()
}

/// Distribution along the fibre, normalised so that ∫ M cos θi dθi = 1: csch(1/v) / 2v · exp(−sinθi sinθo / v) · I₀(cosθi cosθo / v). The exponents
/// are added before they are taken, so that narrow lobes neither overflow nor lose their digits. Source: d'Eon et al. 2011, eq. 7.
fn longitudinal([sin_i, cos_i]: [f32; 2], [sin_o, cos_o]: [f32; 2], v: f32) -> f32 {
    // cosθi cosθo − sinθi sinθo − 1 = −½ ((cosθi − cosθo)² + (sinθi + sinθo)²)
    let exponent = -0.5 * ((cos_i - cos_o).powi(2) + (sin_i + sin_o).powi(2)) / v;
    scaled_bessel(cos_i * cos_o / v) * exponent.exp() / (v * -(-2.0 / v).exp_m1())
}

/// e^−x I₀(x), x ≥ 0, to 2e-7. Source: Abramowitz & Stegun 1964, 9.8.1 and 9.8.2.
fn scaled_bessel(x: f32) -> f32 {
    let polynomial = |c: &[f32], t: f32| c.iter().rev().fold(0.0, |sum, c| sum * t + c);
    if x < 3.75 {
        let t = (x / 3.75).powi(2);
        return (-x).exp() * polynomial(&[1.0, 3.515_622_9, 3.089_942_4, 1.206_749_2, 0.265_973_2, 0.036_076_8, 0.004_581_3], t);
    }
    const LARGE: [f32; 9] = [
        0.398_942_3,
        0.013_285_92,
        0.002_253_19,
        -0.001_575_65,
        0.009_162_81,
        -0.020_577_06,
        0.026_355_37,
        -0.016_476_33,
        0.003_923_77,
    ];
    polynomial(&LARGE, 3.75 / x) / x.sqrt()
}

/// An angle between −π and π.
fn wrapped(angle: f32) -> f32 {
    angle - TAU * (angle / TAU).round()
}

/// Logistic distribution cut off at −π and π. Source: Chiang et al. 2016, eq. 10.
fn trimmed_logistic(x: f32, s: f32) -> f32 {
    let e = (-x.abs() / s).exp();
    e / (s * (1.0 + e) * (1.0 + e)) / (1.0 - 2.0 * logistic_below(s))
}

/// Fraction of the whole logistic distribution below −π.
fn logistic_below(s: f32) -> f32 {
    let e = (-PI / s).exp();
    e / (1.0 + e)
}

fn sample_trimmed_logistic(u: f32, s: f32) -> f32 {
    let below = logistic_below(s);
    // Of both halves the one below the middle keeps its digits.
    let (sign, u) = if u < 0.5 { (1.0, u) } else { (-1.0, 1.0 - u) };
    let x = below + u * (1.0 - 2.0 * below);
    (sign * s * (x / (1.0 - x)).max(f32::MIN_POSITIVE).ln()).clamp(-PI, PI)
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_light::random::{mix, to_unit};

    fn lobes(beta: [f32; 2], h: f32, sigma: f32, wo: Vec3) -> HairLobes {
        let fiber = Fiber { eta: 1.55, beta_m: beta[0], beta_n: beta[1], alpha: 2f32.to_radians() };
        HairLobes::new(&fiber, h, SampledSpectrum::splat(sigma), wo.normalize())
    }

    /// A view of the fibre: θ and φ, rad.
    fn view(theta: f32, phi: f32) -> Vec3 {
        Vec3::new(theta.sin(), theta.cos() * phi.cos(), theta.cos() * phi.sin())
    }

    /// Sums a function over the sphere: equal steps of sin θ and φ.
    fn integral(steps: [u32; 2], f: impl Fn(Vec3) -> f32) -> f64 {
        let mut sum = 0.0;
        for i in 0..steps[0] {
            for j in 0..steps[1] {
                let x = 2.0 * (i as f32 + 0.5) / steps[0] as f32 - 1.0;
                let (s, c) = (TAU * (j as f32 + 0.5) / steps[1] as f32).sin_cos();
                sum += f64::from(f(Vec3::new(x, safe_sqrt(1.0 - x * x) * c, safe_sqrt(1.0 - x * x) * s)));
            }
        }
        sum * 4.0 * std::f64::consts::PI / f64::from(steps[0] * steps[1])
    }

    #[test]
    fn hair_that_does_not_absorb_sends_on_all_light() {
        for beta in [[0.3, 0.3], [0.6, 0.2], [0.25, 0.9]] {
            for (theta, h) in [(0.0, 0.0), (0.5, 0.7), (-1.1, -0.4), (1.4, 0.95)] {
                let lobes = lobes(beta, h, 0.0, view(theta, 1.0));
                let energy = integral([300, 200], |wi| lobes.eval(wi).0.x);
                // Quadrature of the narrowest lobe, some 6°, with the root at the poles.
                assert!((energy - 1.0).abs() < 0.01, "{beta:?} {theta} {h}: {energy}");
            }
        }
    }

    #[test]
    fn the_density_integrates_to_one_and_darker_hair_sends_on_less() {
        for (sigma, beta) in [(0.2, [0.3, 0.3]), (2.0, [0.5, 0.3]), (50.0, [0.3, 0.6])] {
            let lobes = lobes(beta, 0.3, sigma, view(0.4, 2.0));
            let (density, energy) = (integral([300, 200], |w| lobes.eval(w).1), integral([300, 200], |w| lobes.eval(w).0.x));
            assert!((density - 1.0).abs() < 0.01, "{sigma}: {density}");
            // All but the surface reflection is absorbed in the end.
            let all: f32 = lobes.attenuation.iter().map(|a| a.x).sum();
            assert!((energy - f64::from(all)).abs() < 0.01 && all < 0.99, "{sigma}: {energy} {all}");
        }
        assert!(lobes([0.3; 2], 0.0, 1e4, Vec3::Z).attenuation[1].x < 1e-6);
    }

    #[test]
    fn values_are_those_of_mitsuba() {
        // f cos θ of the plugin `hair` of Mitsuba 3.9.1 (scalar_rgb, index 1.55), with its directions (x, y, z) written as (y, −x, −z) and h as its
        // normals have it: view, light, h, absorption, roughness along and around, tilt (degrees), value.
        type Row = ([f32; 3], [f32; 3], f32, f32, [f32; 2], f32, f32);
        const ROWS: [Row; 8] = [
            ([0.32357, 0.89603, -0.30404], [0.15101, 0.91146, -0.38266], 0.94697, 0.50, [0.30, 0.30], 2.0, 0.0196916),
            ([-0.92398, 0.38179, -0.02243], [0.88245, 0.03312, -0.46923], 0.99828, 0.10, [0.50, 0.40], 2.0, 0.00858454),
            ([0.96919, -0.16898, -0.17919], [0.47099, 0.74665, -0.46976], -0.68608, 1.50, [0.35, 0.70], 2.0, 3.91764e-05),
            ([0.03225, 0.86147, -0.50678], [-0.86365, -0.32149, 0.38827], 0.86192, 0.10, [0.50, 0.40], 2.0, 0.00189953),
            ([0.45366, -0.27837, -0.84659], [0.38477, 0.58420, 0.71461], -0.31236, 1.50, [0.35, 0.70], 2.0, 0.000134698),
            ([-0.59012, -0.78798, -0.17563], [0.80160, 0.59774, 0.01234], -0.97605, 0.50, [0.30, 0.30], 2.0, 0.517974),
            ([-0.70621, 0.15300, -0.69127], [0.48348, -0.48298, -0.73006], 0.21611, 0.10, [0.50, 0.40], 2.0, 0.0305467),
            ([-0.22712, 0.69015, -0.68710], [0.10269, -0.65121, -0.75192], 0.70867, 1.50, [0.35, 0.70], 0.0, 0.0353798),
        ];
        for (wo, wi, h, sigma, [beta_m, beta_n], tilt, expected) in ROWS {
            let fiber = Fiber { eta: 1.55, beta_m, beta_n, alpha: tilt.to_radians() };
            let lobes = HairLobes::new(&fiber, h, SampledSpectrum::splat(sigma), Vec3::from_array(wo).normalize());
            let found = lobes.eval(Vec3::from_array(wi).normalize()).0.x;
            // Five digits of directions, and its own Bessel function, good to 0.3 % at these roughnesses.
            assert!((found / expected - 1.0).abs() < 4e-3, "{wo:?} {wi:?}: {found} {expected}");
        }
    }

    #[test]
    fn draws_follow_the_density() {
        // χ² over bins of equal solid angle; the expected counts by quadrature.
        for (k, (beta, theta, h)) in [([0.3, 0.3], 0.4, 0.5), ([0.8, 0.2], -0.9, -0.8)].into_iter().enumerate() {
            let lobes = lobes(beta, h, 0.5, view(theta, 0.7));
            let (rows, columns, fine, draws) = (8usize, 12usize, 24u32, 40_000u32);
            let bin = |w: Vec3| {
                let x = ((0.5 * (w.x + 1.0) * rows as f32) as usize).min(rows - 1);
                let y = ((w.z.atan2(w.y).rem_euclid(TAU) / TAU * columns as f32) as usize).min(columns - 1);
                x * columns + y
            };
            let mut expected = vec![0.0f64; rows * columns];
            for i in 0..rows as u32 * fine {
                for j in 0..columns as u32 * fine {
                    let x = 2.0 * (i as f32 + 0.5) / (rows as u32 * fine) as f32 - 1.0;
                    let (s, c) = (TAU * (j as f32 + 0.5) / (columns as u32 * fine) as f32).sin_cos();
                    let w = Vec3::new(x, safe_sqrt(1.0 - x * x) * c, safe_sqrt(1.0 - x * x) * s);
                    expected[bin(w)] += f64::from(lobes.eval(w).1);
                }
            }
            let total: f64 = expected.iter().sum();
            let mut found = vec![0.0f64; rows * columns];
            for i in 0..draws {
                let u = [0, 1, 2, 3].map(|d| to_unit(mix(mix(4 * i + d) ^ k as u32)));
                let s = lobes.sample(u).expect("hair does not absorb a draw");
                let (value, pdf) = lobes.eval(s.wi);
                assert!((s.wi.length() - 1.0).abs() < 1e-4 && s.pdf == pdf && s.weight == value / pdf);
                found[bin(s.wi)] += 1.0;
            }
            let (mut chi2, mut bins) = (0.0, 0.0);
            for (e, f) in expected.iter().map(|e| e / total * f64::from(draws)).zip(found).filter(|(e, _)| *e >= 5.0) {
                chi2 += (f - e) * (f - e) / e;
                bins += 1.0;
            }
            // Five standard deviations of χ².
            assert!(bins > 20.0 && chi2 < bins + 5.0 * (2.0f64 * bins).sqrt(), "{k}: {chi2} of {bins} bins");
        }
    }

    #[test]
    fn narrow_lobes_keep_their_energy() {
        // ∫ M cosθ dθ = 1 down to the least roughness.
        for v in [1e-5f32, 1e-3, 0.05, 0.1, 0.5, 4.0] {
            for theta in [0.0f32, 0.8, 1.5] {
                let (width, n) = ((8.0 * v.sqrt()).min(1.6), 4000);
                let (from, to) = ((-theta - width).max(-PI / 2.0), (-theta + width).min(PI / 2.0));
                let step = (to - from) / n as f32;
                let at = |i: i32| from + (i as f32 + 0.5) * step;
                let one = |t: f32| longitudinal([t.sin(), t.cos()], [theta.sin(), theta.cos()], v) * t.cos() * step;
                let whole: f64 = (0..n).map(|i| f64::from(one(at(i)))).sum();
                // Wide lobes reach beyond what is summed only where that is the whole half circle.
                let complete = from <= -PI / 2.0 && to >= PI / 2.0 || v < 0.01;
                assert!(!complete || (whole - 1.0).abs() < 5e-3, "{v} {theta}: {whole}");
            }
        }
        // I₀: Abramowitz & Stegun, table 9.8.
        for (x, value) in [(0.0, 1.0), (1.0, 0.465_759_6), (3.75, 0.214_457_1), (10.0, 0.127_833_3)] {
            assert!((scaled_bessel(x) - value).abs() < 1e-4, "{x}: {}", scaled_bessel(x));
        }
    }

    #[test]
    fn a_reflectance_comes_back_as_the_colour_of_the_hair() {
        let color = Color::rgb(0.6, 0.35, 0.2);
        let mut hair = Hair { pigment: Pigment::Reflectance(color), ..Hair::brown() };
        let surface = Surface {
            point: Vec3::ZERO,
            t: 1.0,
            ng: Vec3::Z,
            ns: Vec3::Z,
            tangent: Vec3::X,
            handedness: -1.0,
            uv: [glam::Vec2::splat(0.5); 2],
            color: glam::Vec4::ONE,
            object: 0,
            triangle: 0,
            reach: 1.0,
            detail: crate::shape::Detail::None,
        };
        let sigma = hair.sigma_a(&surface, 0.3, &SampledWavelengths::rgb()).truncate();
        hair.pigment = Pigment::AbsorptionMap(Arc::new(Graph::Constant(sigma)));
        assert!(hair.albedo(&surface).abs_diff_eq(Vec3::new(0.6, 0.35, 0.2), 1e-4), "{}", hair.albedo(&surface));
        // Brown hair is dark, and darkest in the blue.
        let brown = Hair::brown().albedo(&surface);
        assert!(brown.x > brown.y && brown.y > brown.z && brown.x < 0.3 && brown.z > 0.0, "{brown}");
    }
}

#[cfg(test)]
mod lit {
    //! Hair lit from all around: strands that absorb nothing cannot be seen.

    use super::*;
    use crate::light::{Environment, Modulation};
    use crate::material::{Emission, EmissionColor, Material, Scattering};
    use crate::shape::{CurveBasis, CurveKind, Curves, Quad};
    use crate::{Description, Object, PathSettings, Scene, Shape};
    use diopter_image::Raster;
    use diopter_light::Ray;
    use diopter_light::random::{Sampler, SamplerKind, mix, to_unit};
    use glam::{Affine3A, Mat3};

    /// A tangle of strands, 2 mm thick, in a box of 0.2 m, and what it is lit by.
    fn tangle(sigma_a: f32, kind: CurveKind) -> Description {
        let random = |seed: u32| Vec3::from_array(std::array::from_fn(|k| to_unit(mix(seed * 3 + k as u32)) - 0.5));
        let mut curves = Curves::new(kind, CurveBasis::BSpline);
        for strand in 0..400u32 {
            let points: Vec<Vec3> = (0..6).map(|i| random(strand * 8 + i) * 0.3).collect();
            curves.push(&points, [1e-3, 1e-3], &[]);
        }
        let hair = Hair {
            pigment: Pigment::Absorption(Spectrum::Constant(sigma_a)),
            beta_m: Scalar::Constant(0.4),
            beta_n: Scalar::Constant(0.5),
            ..Hair::brown()
        };
        Description {
            curves: vec![curves.into()],
            materials: vec![Material::new("hair", Scattering::Hair(Box::new(hair)))],
            objects: vec![Object::new("hair", Shape::Curves { curves: 0, world_from_curves: Affine3A::IDENTITY }, 0)],
            ..Default::default()
        }
    }

    fn sky(d: &mut Description) {
        let even = Raster { width: 2, height: 1, channels: 3, data: vec![1.0; 6] };
        d.environment = Some(Environment::new(even, Mat3::IDENTITY, 1.0));
    }

    /// Six square lamps around it.
    fn box_of_lamps(d: &mut Description) {
        let emission = Emission {
            radiance: EmissionColor::Constant(Spectrum::light_from_rgb(Vec3::ONE)),
            two_sided: true,
            is_light: true,
            modulation: Modulation::Steady,
        };
        d.materials.push(Material { emission: Some(emission), ..Material::new("lamp", Scattering::Black) });
        for axis in 0..3 {
            for side in [-1.0f32, 1.0] {
                let [x, y, z] = [0, 1, 2].map(|k| Vec3::AXES[(axis + k) % 3]);
                let quad = Quad { corner: z * side - x - y, edges: [x * 2.0, y * 2.0] };
                d.objects.push(Object::new("lamp", Shape::Quad(quad), 1));
            }
        }
    }

    /// Mean radiance of a view of the middle, relative to the light, and the fraction of rays that met hair.
    fn seen(d: Description, samples: u32) -> (f64, f64) {
        let scene = Scene::build(d).unwrap();
        let wavelengths = SampledWavelengths::fixed([450.0, 520.0, 590.0, 660.0]);
        let (mut sum, mut met) = (0.0, 0.0);
        for i in 0..samples {
            let [x, y] = [mix(i), mix(i + 5_000_000)].map(|n| (to_unit(n) - 0.5) * 0.2);
            let ray = Ray { origin: Vec3::new(x, y, 0.9), direction: Vec3::new(0.01, 0.02, -1.0).normalize(), time_s: 0.0 };
            let sampler = Sampler::new(SamplerKind::Sobol, 5, (i, 0), 0, 1);
            let settings = PathSettings { max_depth: 200, ..Default::default() };
            let light = scene.radiance(ray, &wavelengths, &sampler, &settings) / wavelengths.d65_one_nit();
            sum += f64::from(light.element_sum() / 4.0) / f64::from(samples);
            let hit = scene.intersect(&ray, f32::INFINITY);
            met += f64::from(u8::from(hit.is_some_and(|s| s.is_strand()))) / f64::from(samples);
        }
        (sum, met)
    }

    #[test]
    fn strands_that_do_not_absorb_cannot_be_seen_in_even_light() {
        for kind in [CurveKind::Flat, CurveKind::Cylinder] {
            for lit in [sky, box_of_lamps] {
                let mut d = tangle(0.0, kind);
                lit(&mut d);
                let (light, met) = seen(d, 3000);
                // Noise of the estimate: 0.4 %.
                assert!(met > 0.8 && (light - 1.0).abs() < 0.02, "{kind:?}: {light}, {met} met hair");
            }
        }
    }

    #[test]
    fn strands_that_absorb_are_darker_and_never_brighter() {
        let light = [0.2, 2.0].map(|sigma| {
            let mut d = tangle(sigma, CurveKind::Flat);
            sky(&mut d);
            seen(d, 1500).0
        });
        assert!(light[0] < 0.9 && light[1] < 0.6 * light[0] && light[1] > 0.02, "{light:?}");
    }
}
