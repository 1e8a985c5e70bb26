//! Layers by a rule: what lenses are coated with whose makers do not say.

use super::material::{Material, film};
use super::{Coating, DESIGN_NM, Layer, Stack};
use crate::glass::Glass;
use std::f64::consts::PI;

/// A rule for the layers on a glass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Recipe {
    /// A quarter wave of MgF₂.
    SingleLayer,
    /// Two layers, MgF₂ on ZrO₂, that reflect nothing at the design wavelength and much beside it: a "V" coat. On glass of high index, where
    /// no such pair exists and one layer does nearly as well, a quarter wave of MgF₂.
    TwoLayerV,
    /// A quarter wave of MgF₂, a half wave of ZrO₂, a quarter wave of what matches the glass (Al₂O₃ with ZrO₂): the first broadband
    /// coatings, of about 1970 to 2000 (Cox, Hass & Thelen 1962, doi 10.1364/JOSA.52.000965).
    ThreeLayer,
    /// Six layers of MgF₂, Ta₂O₅ and SiO₂: 0.1 to 0.2 % over 410–700 nm.
    Modern,
}

/// Thicknesses (nm, from the air: MgF₂, Ta₂O₅, SiO₂, Ta₂O₅, SiO₂, Ta₂O₅) of the modern recipe for 550 nm on glass of an index. Least squares
/// of the reflectance over 410–700 nm at 0° and, with half the weight, 35°, from 60 starts on n = 1.7 and then from glass to neighbouring
/// glass, so that thicknesses between the rows may be interpolated; own calculation with the indices of `data/materials.csv`.
const MODERN: [(f64, [f64; 6]); 12] = [
    (1.45, [99.4, 39.0, 7.4, 76.3, 37.5, 14.2]),
    (1.5, [99.9, 38.1, 8.3, 77.0, 33.9, 15.4]),
    (1.55, [100.4, 37.2, 9.2, 77.9, 30.7, 16.5]),
    (1.6, [100.9, 36.3, 10.0, 78.9, 27.6, 17.5]),
    (1.65, [101.3, 35.5, 10.8, 79.9, 24.8, 18.5]),
    (1.7, [101.7, 34.6, 11.5, 80.9, 22.1, 19.5]),
    (1.75, [102.1, 33.8, 12.3, 82.1, 19.6, 20.5]),
    (1.8, [102.5, 33.0, 13.0, 83.4, 17.1, 21.4]),
    (1.85, [102.9, 32.3, 13.6, 84.9, 14.8, 22.5]),
    (1.9, [103.2, 31.6, 14.3, 86.6, 12.6, 23.6]),
    (1.95, [103.6, 31.0, 14.9, 88.8, 10.4, 24.9]),
    (2.0, [103.9, 30.4, 15.4, 91.8, 8.3, 26.7]),
];

/// What lenses of a year were coated with: nothing before 1945 (Smakula's patent is of 1935, most lenses followed after the war), a single
/// layer to 1969, three layers to 1999 (the first lenses with several layers on every surface were sold about 1970), six since.
pub fn by_year(year: u16) -> Coating {
    match year {
        ..1945 => Coating::None,
        1945..1970 => Coating::MagnesiumFluoride,
        1970..2000 => Coating::Recipe(Recipe::ThreeLayer, DESIGN_NM),
        2000.. => Coating::Recipe(Recipe::Modern, DESIGN_NM),
    }
}

impl Recipe {
    /// Every one, with its name in prescriptions.
    pub const ALL: [(&'static str, Recipe); 4] = [
        ("single", Recipe::SingleLayer),
        ("V", Recipe::TwoLayerV),
        ("broadband", Recipe::ThreeLayer),
        ("modern", Recipe::Modern),
    ];

    /// Its name in prescriptions.
    pub fn name(self) -> &'static str {
        Recipe::ALL.iter().find(|r| r.1 == self).map_or("", |r| r.0)
    }

    /// As reports print it.
    pub fn describe(self) -> &'static str {
        match self {
            Recipe::SingleLayer => "a quarter wave of MgF2",
            Recipe::TwoLayerV => "two layers (V)",
            Recipe::ThreeLayer => "three layers (quarter, half, quarter)",
            Recipe::Modern => "six layers, broadband",
        }
    }

    /// The layers on a glass for a design wavelength in nm, from the air to the glass.
    pub fn stack(self, glass: &Glass, design_nm: f64) -> Stack {
        let named = |name: &str| Material::Film(film(name));
        let at_design = |m: &Material| m.index(design_nm).re;
        let wave = |material: Material, waves: f64| {
            let thickness_nm = waves * design_nm / at_design(&material);
            Layer { material, thickness_nm }
        };
        let fluoride = named("MgF2");
        let (n1, ns) = (at_design(&fluoride), glass.index(design_nm));
        let single = || Stack { layers: vec![wave(named("MgF2"), 0.25)] };
        match self {
            Recipe::SingleLayer => single(),
            Recipe::TwoLayerV => {
                let zirconia = named("ZrO2");
                let n2 = at_design(&zirconia);
                // Phase thicknesses for which the admittance of the whole is that of air (Macleod 2010 §4.1.2, n0 = 1).
                let common = (ns - 1.0) / (n1 * n1 * ns - n2 * n2);
                let outer2 = common * (n2 * n2 - ns) * n1 * n1 / (ns - n1 * n1);
                let inner2 = common * (ns - n1 * n1) * n2 * n2 / (n2 * n2 - ns);
                if !(outer2 > 0.0 && inner2 > 0.0 && outer2.is_finite()) {
                    return single();
                }
                // The thin one of the two solutions: tan δ1 tan δ2 = n1 n2 `common` tells the sign of the other tangent.
                let inner = inner2.sqrt().atan();
                let outer = (outer2.sqrt() * common.signum()).atan();
                let outer = if outer > 0.0 { outer } else { outer + PI };
                let layers = vec![wave(fluoride, outer / (2.0 * PI)), wave(zirconia, inner / (2.0 * PI))];
                Stack { layers }
            }
            Recipe::ThreeLayer => {
                // The half wave is absent at the design wavelength; the quarter waves cancel where n3 = n1 √ns.
                let of = ["Al2O3", "ZrO2"].map(film);
                let [low, high] = of.map(|i| at_design(&Material::Film(i)));
                let second = ((n1 * ns.sqrt() - low) / (high - low)).clamp(0.0, 1.0);
                let inner = Material::Mixture { of, second };
                Stack { layers: vec![wave(fluoride, 0.25), wave(named("ZrO2"), 0.5), wave(inner, 0.25)] }
            }
            Recipe::Modern => {
                let (first, step) = (MODERN[0].0, MODERN[1].0 - MODERN[0].0);
                let at = ((ns - first) / step).clamp(0.0, (MODERN.len() - 1) as f64);
                let i = (at as usize).min(MODERN.len() - 2);
                let f = at - i as f64;
                let materials = ["MgF2", "Ta2O5", "SiO2", "Ta2O5", "SiO2", "Ta2O5"];
                let layer = |k: usize| Layer {
                    material: named(materials[k]),
                    // All optical thicknesses go with the design wavelength.
                    thickness_nm: (MODERN[i].1[k] * (1.0 - f) + MODERN[i + 1].1[k] * f) * design_nm / DESIGN_NM,
                };
                Stack { layers: (0..materials.len()).map(layer).collect() }
            }
        }
    }
}
