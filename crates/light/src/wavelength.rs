//! Which wavelengths a path carries, and how they are weighted.
//!
//! Four wavelengths a path, hero-wavelength fashion (Wilkie et al. 2014, "Hero Wavelength Spectral Sampling", EGSR):
//! one uniform number places the first, the others follow at equal steps. The steps are equal in the cumulative
//! distribution of what the film will record, not in nm, so that the samples fall where the bands respond; with three
//! bands of similar weight each band then sees one or two of the four samples of every path, and colour noise nearly
//! vanishes. Light outside 380–780 nm is not carried.

use crate::cie::d65_one_nit;
use crate::table::Table;
use glam::Vec4;

/// A spectral quantity at the four wavelengths of a path.
pub type SampledSpectrum = Vec4;

/// Shortest wavelength carried, nm.
pub const FIRST_NM: f32 = 380.0;
/// Longest wavelength carried, nm.
pub const LAST_NM: f32 = 780.0;
const BINS: usize = 400;
const GUIDE: usize = 1024;

/// The four wavelengths of one path.
#[derive(Clone, Copy, Debug)]
pub struct SampledWavelengths {
    /// nm; the first is the hero.
    pub nm: Vec4,
    /// Monte Carlo weight 1 / (4 pdf), nm: ∫ f dλ ≈ Σ f(nmᵢ) weightᵢ.
    pub weight: Vec4,
    d65: Vec4,
    /// Factor on the hero alone once the other wavelengths are given up, see [`SampledWavelengths::hero_only`].
    hero_factor: f32,
    /// The lanes stand for red, green, blue (and green again, which counts nothing).
    rgb: bool,
}

/// Wavelengths (nm) that stand for red, green and blue where a spectrum has no colour, such as an index.
pub const RGB_NM: [f32; 3] = [611.0, 549.0, 465.0];

impl SampledWavelengths {
    /// Four given wavelengths (nm) of weight 1: for tests and tables.
    pub fn fixed(nm: [f32; 4]) -> Self {
        Self::new(Vec4::from_array(nm), Vec4::ONE)
    }

    fn new(nm: Vec4, weight: Vec4) -> Self {
        let white = d65_one_nit();
        let d65 = Vec4::new(white.at(nm.x), white.at(nm.y), white.at(nm.z), white.at(nm.w));
        SampledWavelengths { nm, weight, d65, hero_factor: 4.0, rgb: false }
    }

    /// The same wavelengths on a ray that each of them, as the hero, would have drawn with a density of its own (any common unit; the first
    /// is positive): as behind a lens with dispersion, whose weights hold 1 over the mean of the four densities.
    pub fn with_densities(self, densities: [f32; 4]) -> Self {
        let [hero, ..] = densities;
        let factor = densities.iter().sum::<f32>() / hero;
        SampledWavelengths { hero_factor: if factor.is_finite() { factor } else { 4.0 }, ..self }
    }

    /// What the throughput is multiplied by where a body disperses and the path goes on with its hero alone: of the four ways to draw this
    /// path only the hero's is left, so the balance heuristic's weight, the hero's density over the sum of all, is divided out. 4 where
    /// all had the same density. Source: Wilkie et al. 2014, eq. 5; pbrt-v4's `TerminateSecondary` is the case of equal densities. The other lanes are 0.
    #[inline]
    pub fn hero_only(&self) -> SampledSpectrum {
        Vec4::new(self.hero_factor, 0.0, 0.0, 0.0)
    }

    /// Three colours instead of wavelengths, as RGB renderers compute: to compare with them.
    pub fn rgb() -> Self {
        let [r, g, b] = RGB_NM;
        SampledWavelengths {
            nm: Vec4::new(r, g, b, g),
            weight: Vec4::new(1.0, 1.0, 1.0, 0.0),
            d65: Vec4::ONE,
            hero_factor: 4.0,
            rgb: true,
        }
    }

    /// Whether the lanes are colours ([`SampledWavelengths::rgb`]).
    #[inline]
    pub fn is_rgb(&self) -> bool {
        self.rgb
    }

    /// A linear sRGB colour as lanes ([`SampledWavelengths::rgb`]): red, green, blue, and green again.
    #[inline]
    pub fn lanes(rgb: glam::Vec3) -> SampledSpectrum {
        Vec4::new(rgb.x, rgb.y, rgb.z, rgb.y)
    }

    /// D65 of 1 cd/m² at these wavelengths, W·m⁻²·sr⁻¹·nm⁻¹; looked up once a path because every RGB light needs it.
    #[inline]
    pub fn d65_one_nit(&self) -> SampledSpectrum {
        self.d65
    }
}

/// Draws the wavelengths of a path in proportion to how much the film's bands respond to them.
#[derive(Clone, Debug)]
pub struct WavelengthSampler {
    /// Probability density per nm of each 1 nm bin from [`FIRST_NM`].
    pdf: Vec<f32>,
    /// Cumulative probability at the start of each bin; one more entry, 1.
    cdf: Vec<f32>,
    /// First bin to look at for each 1/[`GUIDE`] of probability.
    guide: Vec<u16>,
    /// Last bin that can be drawn.
    last: u16,
    /// Nothing is drawn: paths carry colours.
    rgb: bool,
}

impl WavelengthSampler {
    /// Density over 380–780 nm proportional to the sum over bands of |response|, each band of equal weight. Falls back to uniform when nothing responds.
    pub fn for_bands(bands: &[Table]) -> Self {
        let center = |bin: usize| FIRST_NM + bin as f32 + 0.5;
        let mut density = vec![0.0f64; BINS];
        for band in bands {
            // The larger of both ends and the middle, so that no bin in which a band responds is left out.
            let values: Vec<f64> = (0..BINS)
                .map(|i| [-0.5, 0.0, 0.5].map(|d| band.at(center(i) + d).abs()).into_iter().fold(0.0, f32::max) as f64)
                .collect();
            let sum: f64 = values.iter().sum();
            if sum > 0.0 {
                density.iter_mut().zip(&values).for_each(|(d, v)| *d += v / sum);
            }
        }
        let total: f64 = density.iter().sum();
        if total <= 0.0 {
            density = vec![1.0; BINS];
        }
        let total: f64 = density.iter().sum();
        let pdf: Vec<f32> = density.iter().map(|d| (d / total) as f32).collect();
        let mut sum = 0.0;
        let mut cdf: Vec<f32> = std::iter::once(0.0)
            .chain(density.iter().map(|d| {
                sum += d / total;
                sum as f32
            }))
            .collect();
        cdf[BINS] = 1.0;
        let last = pdf.iter().rposition(|p| *p > 0.0).unwrap_or(BINS - 1);
        let first_above = |v: f32| cdf.partition_point(|c| *c <= v).saturating_sub(1).min(last);
        let guide = (0..GUIDE).map(|g| first_above(g as f32 / GUIDE as f32) as u16).collect();
        WavelengthSampler { pdf, cdf, guide, last: last as u16, rgb: false }
    }

    /// Always [`SampledWavelengths::rgb`].
    pub fn rgb() -> Self {
        WavelengthSampler { rgb: true, ..Self::uniform() }
    }

    /// Equal density from 380 to 780 nm.
    pub fn uniform() -> Self {
        Self::for_bands(&[Table::new(FIRST_NM, 1.0, vec![1.0])])
    }

    /// The four wavelengths (nm) that belong to the uniform number `u` in [0, 1), with their weights 1 / (4 density).
    #[inline]
    pub fn sample(&self, u: f32) -> SampledWavelengths {
        if self.rgb {
            return SampledWavelengths::rgb();
        }
        let (mut nm, mut weight) = ([0.0; 4], [0.0; 4]);
        for i in 0..4 {
            let v = u + 0.25 * i as f32;
            let v = if v >= 1.0 { v - 1.0 } else { v };
            let mut bin = self.guide[(v * GUIDE as f32) as usize & (GUIDE - 1)] as usize;
            while bin < self.last as usize && self.cdf[bin + 1] <= v {
                bin += 1;
            }
            let density = self.pdf[bin];
            let within = ((v - self.cdf[bin]) / density).clamp(0.0, 0.999_999);
            nm[i] = FIRST_NM + bin as f32 + within;
            weight[i] = 0.25 / density;
        }
        SampledWavelengths::new(Vec4::from_array(nm), Vec4::from_array(weight))
    }

    /// Probability density at a wavelength (nm), 1/nm; 0 outside 380–780 nm.
    pub fn pdf(&self, nm: f32) -> f32 {
        let bin = nm - FIRST_NM;
        if (0.0..BINS as f32).contains(&bin) { self.pdf[bin as usize] } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cie::observer;

    fn xyz_sampler() -> WavelengthSampler {
        let o = observer();
        WavelengthSampler::for_bands(&[o.x.clone(), o.y.clone(), o.z.clone()])
    }

    #[test]
    fn integrates_the_observer_without_bias() {
        let sampler = xyz_sampler();
        let n = 4096;
        for band in [&observer().x, &observer().y, &observer().z] {
            let exact: f64 = (0..4000).map(|i| band.at(380.05 + 0.1 * i as f32) as f64 * 0.1).sum();
            let mut sum = 0.0;
            for i in 0..n {
                let w = sampler.sample((i as f32 + 0.5) / n as f32);
                sum += (0..4).map(|k| (band.at(w.nm[k]) * w.weight[k]) as f64).sum::<f64>();
            }
            assert!((sum / n as f64 / exact - 1.0).abs() < 1e-3, "{} {exact}", sum / n as f64);
        }
    }

    #[test]
    fn drawn_wavelengths_follow_the_density() {
        // χ² over 40 bins of 10 nm: 100 000 independent uniform numbers, the hero of each.
        let sampler = xyz_sampler();
        let mut counts = [0.0f64; 40];
        let draws = 100_000u32;
        for i in 0..draws {
            let u = crate::random::to_unit(crate::random::mix(i.wrapping_mul(0x9e37_79b9)));
            let w = sampler.sample(u);
            counts[((w.nm[0] - FIRST_NM) / 10.0) as usize] += 1.0;
        }
        let mut chi2 = 0.0;
        let mut bins = 0;
        for (b, count) in counts.iter().enumerate() {
            let expected: f64 =
                (0..10).map(|i| sampler.pdf(FIRST_NM + 10.0 * b as f32 + i as f32 + 0.5) as f64).sum::<f64>() * draws as f64;
            if expected > 5.0 {
                chi2 += (count - expected).powi(2) / expected;
                bins += 1;
            }
        }
        // 99.9 % quantile of χ² with ν degrees of freedom ≈ ν + 3.1 √(2ν) + 6.
        let nu = bins as f64 - 1.0;
        assert!(chi2 < nu + 3.1 * (2.0 * nu).sqrt() + 6.0, "χ² {chi2} for {nu} degrees of freedom");
    }

    #[test]
    fn the_end_of_the_range_can_be_drawn() {
        for u in [0.0, 0.249_999_99, 0.999_999_94] {
            let w = xyz_sampler().sample(u);
            assert!(w.nm.to_array().iter().all(|nm| (FIRST_NM..=LAST_NM).contains(nm)) && w.weight.is_finite());
        }
    }
}
