//! Metals by their complex index of refraction, smooth or rough (GGX).

use super::energy::{mirror_albedo_at, prepare_mirrors};
use super::inputs::inputs_struct;
use super::local_scatter::LocalScatter;
use super::microfacet::{Ggx, SMOOTH, fresnel_conductor, reflect};
use super::polarization::{Event, InPlane, conductor, s_axis};
use crate::shape::Surface;
use crate::texture::{Color, Scalar};
use diopter_light::color::srgb_of_light;
use diopter_light::spectrum::Table;
use diopter_light::{SampledSpectrum, SampledWavelengths, Spectrum};
use glam::Vec3;

/// A metal.
#[derive(Clone, Debug)]
pub struct Conductor {
    /// Index of refraction n(λ).
    pub n: Spectrum,
    /// Extinction coefficient k(λ).
    pub k: Spectrum,
    /// Width of the GGX distribution (the square of glTF's roughness); below 0.001 a mirror.
    pub alpha: Scalar,
    /// The width across the tangent, where it is another: `alpha` then is that along it.
    pub across: Option<Scalar>,
    /// What happens to light that meets several facets.
    pub bounces: FacetBounces,
    /// What each reflection is multiplied by, at all angles alike; 1 without.
    pub tint: Option<Box<Color>>,
}

inputs_struct!(Conductor { alpha, across, tint } without { n, k, bounces });

/// Light that bounces between the facets of a rough surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FacetBounces {
    /// Given back (Turquin 2019): a white metal reflects everything.
    Compensated,
    /// Lost, as in renderers with plain single scattering; to compare with them.
    Lost,
}

/// Optical constants of metals, `nm,<metal>_n,<metal>_k ...`, linear between the measured points of Johnson & Christy
/// 1972/1974 (Ag, Au, Cu, Cr, Ni, Ti, Fe) and Querry 1985 (brass of 30 % zinc), and of the fits of Rakić 1995 (Al) and 1998 (Pt, W) and Karlsson &
/// Ribbing 1982 (austenitic stainless steel), from refractiveindex.info @ ff11b58 (CC0).
const METALS_CSV: &str = include_str!("metals.csv");

impl Conductor {
    /// Whether it is smooth everywhere.
    pub(super) fn is_smooth(&self) -> bool {
        self.across.is_none() && matches!(self.alpha, Scalar::Constant(alpha) if alpha < SMOOTH)
    }

    /// Computes every table that rays will ask for.
    pub(super) fn prepare(&self) {
        prepare_mirrors(self.across.is_some());
    }

    /// Names of the metals whose optical constants are known.
    pub const METALS: [&str; 12] = [
        "silver",
        "gold",
        "copper",
        "aluminium",
        "chromium",
        "nickel",
        "titanium",
        "iron",
        "platinum",
        "tungsten",
        "brass",
        "stainless-steel",
    ];

    /// A measured metal with a GGX width α (0 to 1; below 0.001 a mirror), bounces compensated. `None` for a name not in [`Conductor::METALS`].
    pub fn metal(name: &str, alpha: f32) -> Option<Conductor> {
        let column = 1 + 2 * Self::METALS.iter().position(|m| *m == name)?;
        let (_, rows) = diopter_light::cie::tables::read_csv(METALS_CSV);
        let curve = |c: usize| Spectrum::Table(Table::new(380.0, 5.0, rows.iter().map(|r| r[c] as f32).collect()));
        let [n, k] = with_color(curve(column), curve(column + 1));
        Some(Conductor { n, k, alpha: Scalar::Constant(alpha), across: None, bounces: FacetBounces::Compensated, tint: None })
    }

    pub(super) fn at(&self, surface: &Surface, wavelengths: &SampledWavelengths) -> ConductorLobe {
        let (n, k) = (self.n.sample(wavelengths), self.k.sample(wavelengths));
        let along = self.alpha.at(surface).clamp(0.0, 1.0);
        let across = self.across.as_ref().map_or(along, |a| a.at(surface).clamp(0.0, 1.0));
        let tint = self.tint.as_ref().map_or(SampledSpectrum::ONE, |tint| tint.sample(surface, wavelengths));
        ConductorLobe { n, k, facets: Ggx::new(along, across), bounces: self.bounces, tint }
    }

    /// Reflectance at normal incidence, 0 to 1, in red, green and blue ([`SampledWavelengths::rgb`]).
    pub fn normal_reflectance(&self) -> Vec3 {
        let rgb = SampledWavelengths::rgb();
        let tint = self.tint.as_ref().map_or(Vec3::ONE, |tint| tint.constant_rgb().unwrap_or(Vec3::ONE));
        fresnel_conductor(1.0, self.n.sample(&rgb), self.k.sample(&rgb)).truncate() * tint
    }
}

/// Measured n(λ) and k(λ) of a metal with numbers for red, green and blue of the colour that they give it in daylight (D65), seen straight on; three single wavelengths make copper
/// 7 % too dark in red. What is no pair of tables is as it was.
pub(crate) fn with_color(n: Spectrum, k: Spectrum) -> [Spectrum; 2] {
    /// Beyond it k grows without bound; gold's red lies outside sRGB.
    const MOST: f32 = 0.999;
    let (Spectrum::Table(n_table), Spectrum::Table(k_table)) = (&n, &k) else { return [n, k] };
    let Some(daylight) = diopter_light::cie::illuminant("D65") else { return [n, k] };
    let reflectance =
        |nm: f32| fresnel_conductor(1.0, SampledSpectrum::splat(n_table.at(nm)), SampledSpectrum::splat(k_table.at(nm))).x;
    let color = srgb_of_light(|nm| daylight.at(nm) * reflectance(nm)) / srgb_of_light(|nm| daylight.at(nm));
    // n of the wavelength that stands for each, and the k with which it reflects so much; where none does, what has no k.
    let n_rgb = n.sample(&SampledWavelengths::rgb()).truncate();
    let mut rgb = [Vec3::ZERO; 2];
    for c in 0..3 {
        let (r, n) = (color[c].clamp(0.0, MOST), n_rgb[c]);
        let k_squared = (r * (n + 1.0).powi(2) - (n - 1.0).powi(2)) / (1.0 - r);
        (rgb[0][c], rgb[1][c]) = match k_squared >= 0.0 {
            true => (n, k_squared.sqrt()),
            false => ((1.0 + r.sqrt()) / (1.0 - r.sqrt()), 0.0),
        };
    }
    let of = |table: &Table, rgb: Vec3| Spectrum::TableOfRgb { table: table.clone(), rgb };
    [of(n_table, rgb[0]), of(k_table, rgb[1])]
}

#[derive(Clone)]
pub(super) struct ConductorLobe {
    n: SampledSpectrum,
    k: SampledSpectrum,
    facets: Ggx,
    bounces: FacetBounces,
    tint: SampledSpectrum,
}

impl ConductorLobe {
    /// The metal as it is seen from within a dielectric.
    pub(super) fn within(self, ior: f32) -> Self {
        ConductorLobe { n: self.n / ior, k: self.k / ior, ..self }
    }

    pub(super) fn facets(&self) -> Ggx {
        self.facets
    }

    /// Reflectance of a smooth surface at a cosine.
    pub(super) fn normal(&self, cos: f32) -> SampledSpectrum {
        self.tint * fresnel_conductor(cos, self.n, self.k)
    }

    /// Fresnel reflectance, with what bounces between facets.
    fn reflectance(&self, wo: Vec3, h: Vec3) -> SampledSpectrum {
        let f = self.normal(wo.dot(h));
        if self.bounces == FacetBounces::Lost || self.facets.is_smooth() {
            return f;
        }
        let e = mirror_albedo_at(self.facets, wo);
        f * (SampledSpectrum::ONE + self.normal(1.0) * ((1.0 - e) / e))
    }

    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> (SampledSpectrum, f32) {
        if wi.z <= 0.0 || self.facets.is_smooth() {
            return (SampledSpectrum::ZERO, 0.0);
        }
        let h = (wo + wi).normalize();
        let d = self.facets.d(h) / (4.0 * wo.z);
        (self.reflectance(wo, h) * (d * self.facets.g2(wo, wi)), d * self.facets.g1(wo))
    }

    /// What facets mirror of each component at a cosine, and what bounces between them; both over what they send on of unpolarised light.
    pub(super) fn in_plane(&self, wo: Vec3, h: Vec3) -> (InPlane, SampledSpectrum) {
        let cos = wo.dot(h);
        let once = self.normal(cos) / self.reflectance(wo, h).max(SampledSpectrum::splat(1e-12));
        (conductor(cos, self.n, self.k).normalized().scaled(once), (SampledSpectrum::ONE - once).max(SampledSpectrum::ZERO))
    }

    /// The event as a Mueller matrix, in the local frame.
    pub(super) fn polarization(&self, wo: Vec3, wi: Vec3) -> Event {
        let h = (wo + wi).try_normalize().unwrap_or(Vec3::Z);
        let (plane, rest) = self.in_plane(wo, h);
        Event::mixed(s_axis(h, wo), &plane, rest)
    }

    pub(super) fn sample(&self, wo: Vec3, u: [f32; 4]) -> Option<LocalScatter> {
        if self.facets.is_smooth() {
            let wi = Vec3::new(-wo.x, -wo.y, wo.z);
            return Some(LocalScatter { wi, weight: self.normal(wo.z), pdf: 1.0, specular: true, disperses: false });
        }
        let h = self.facets.sample_visible(wo, [u[0], u[1]]);
        let wi = reflect(wo, h);
        if wi.z <= 0.0 {
            return None;
        }
        let g1 = self.facets.g1(wo);
        let weight = self.reflectance(wo, h) * (self.facets.g2(wo, wi) / g1);
        let pdf = g1 * self.facets.d(h) / (4.0 * wo.z);
        Some(LocalScatter { wi, weight, pdf, specular: false, disperses: false })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metals_are_the_ones_that_were_checked() {
        let sum = METALS_CSV.bytes().fold(0xcbf2_9ce4_8422_2325u64, |h, b| (h ^ b as u64).wrapping_mul(0x100_0000_01b3));
        assert_eq!(sum, CHECKED, "a table changed: compare it with its source, then update the checksum");
        // Gold reflects red and not blue; silver reflects everything.
        let gold = Conductor::metal("gold", 0.0).unwrap().normal_reflectance();
        assert!(gold.x > 0.9 && gold.z < 0.5, "{gold}");
        assert!(Conductor::metal("silver", 0.0).unwrap().normal_reflectance().min_element() > 0.9);
        // Brass is yellow, steel reflects a good half of all colours, and nothing is without a table.
        let [brass, steel] = ["brass", "stainless-steel"].map(|m| Conductor::metal(m, 0.0).unwrap().normal_reflectance());
        assert!(brass.x > 0.8 && brass.y > 0.7 && brass.z < 0.6, "{brass}");
        assert!(steel.min_element() > 0.5 && steel.max_element() < 0.72, "{steel}");
        assert!(Conductor::METALS.iter().all(|m| Conductor::metal(m, 0.0).unwrap().normal_reflectance().min_element() > 0.3));
        assert!(Conductor::metal("unobtainium", 0.0).is_none());
    }

    #[test]
    fn metals_have_their_color_in_red_green_and_blue() {
        // Mitsuba 3.9.1 by spectra, with the numbers of other samples: copper under an even sky of D65.
        let copper = Conductor::metal("copper", 0.0).unwrap().normal_reflectance();
        assert!((copper - Vec3::new(0.955, 0.638, 0.538)).abs().max_element() < 0.03, "{copper}");
        // What absorbs nothing, and whose n is highest at the wavelengths that stand for green and blue: the n is another there, which reflects as much.
        let peaks: Vec<f32> = (0..=80).map(|i| 1.5 + if i % 10 == 0 { 1.0 } else { 0.0 }).collect();
        for values in [vec![1.5; 81], peaks] {
            let table = |values| Spectrum::Table(Table::new(380.0, 5.0, values));
            let [n, k] = with_color(table(values), table(vec![0.0; 81])).map(|s| s.sample(&SampledWavelengths::rgb()));
            let reflected = fresnel_conductor(1.0, n, k).truncate();
            assert!((reflected - 0.048).abs().max_element() < 0.015 && k.truncate().min_element() >= 0.0, "{n} {k}: {reflected}");
        }
    }

    #[test]
    fn smooth_and_rough_metals_have_the_same_tint() {
        let tint = SampledSpectrum::new(0.2, 0.5, 0.7, 0.0);
        let [n, k] = [0.2, 3.0].map(SampledSpectrum::splat);
        let wo = Vec3::new(0.3, 0.1, 0.9).normalize();
        for alpha in [0.0, 0.02] {
            let weight = |tint| {
                let lobe = ConductorLobe { n, k, facets: Ggx::new(alpha, alpha), bounces: FacetBounces::Lost, tint };
                lobe.sample(wo, [0.5, 0.5, 0.5, 0.5]).unwrap().weight
            };
            let ratio = weight(tint) / weight(SampledSpectrum::ONE);
            assert!((ratio - tint).abs().max_element() < 1e-5, "{alpha}: {ratio}");
        }
    }
    const CHECKED: u64 = 4960674038398548609;
}
