//! What the film records: bands, and what a wavelength counts in each.

use crate::quantity::SpectralBands;
use diopter_image::focal_plane::{Band, BandUnit};
use diopter_light::spectrum::Table;
use diopter_light::wavelength::{FIRST_NM, LAST_NM, RGB_NM};

/// A linear analyser before the pixels of a band: light counts by I + contrast (Q cos 2θ + U sin 2θ).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Analyzer {
    /// θ: its transmission axis in the picture, degrees, counter-clockwise from the horizontal.
    pub angle_deg: f64,
    /// (E − 1) / (E + 1) of an extinction ratio E; 0 where there is no analyser.
    pub contrast: f64,
}

/// What the film records.
#[derive(Clone, Debug)]
pub struct Response {
    /// Names and unit of the bands.
    pub bands: Vec<Band>,
    /// For electrons: electrons per joule over nm. For radiance: dimensionless weight (or ȳ · 683 lm/W). Of unpolarised light.
    pub curves: Vec<Table>,
    /// What polarised light counts in each band; none where no band tells it from unpolarised light.
    pub analyzers: Vec<Analyzer>,
}

impl Response {
    /// A sensor's channels, in electrons.
    pub fn sensor(sensor: &diopter_sensor::Sensor) -> Self {
        let analyzers = match sensor.cfa.tells_polarization() {
            true => sensor.analyzers().into_iter().map(|(angle_deg, contrast)| Analyzer { angle_deg, contrast }).collect(),
            false => Vec::new(),
        };
        Response { bands: sensor.bands(), curves: sensor.band_responses(), analyzers }
    }

    /// Linear sRGB of the radiance, in cd/m² of D65: ∫ L (R, G, B matching functions) dλ × 683 lm/W. May be negative.
    pub fn linear_srgb() -> Self {
        let o = diopter_light::cie::observer();
        let m = diopter_light::color::RgbSpace::Srgb.xyz_from_rgb().inverse() * diopter_light::units::LUMINOUS_EFFICACY;
        let curve = |row: usize| {
            let at = |nm: f32| {
                let xyz = glam::DVec3::new(o.x.at(nm) as f64, o.y.at(nm) as f64, o.z.at(nm) as f64);
                m.row(row).dot(xyz) as f32
            };
            Table::new(380.0, 1.0, (0..=400).map(|i| at(380.0 + i as f32)).collect())
        };
        let band = |name: &str| Band { name: name.into(), unit: BandUnit::Radiance };
        Response { bands: ["R", "G", "B"].map(band).to_vec(), curves: (0..3).map(curve).collect(), analyzers: Vec::new() }
    }

    /// Mean spectral radiance in equal narrow bands, W·m⁻²·sr⁻¹·nm⁻¹: what a hyperspectral camera measures.
    ///
    /// A band counts fully between its limits, by half at them, and nothing from 1 nm beyond: bands side by side add up to one everywhere.
    /// Names are those of Fichet, Pacanowski & Wilkie 2021, "An OpenEXR layout for spectral images" (JCGT 10(3)): `S0.405,0nm`, by the middle.
    pub fn spectral(bands: &SpectralBands) -> Self {
        let [first, last] = [FIRST_NM as u32, LAST_NM as u32];
        let curve = |[from, to]: [u32; 2]| {
            let mean = 1.0 / (to - from) as f32;
            let at = |nm: u32| {
                // Light beyond the ends is not carried: there is no other half.
                let at_limit = (nm == from && nm > first) || (nm == to && nm < last);
                let within = (from..=to).contains(&nm);
                if at_limit {
                    0.5 * mean
                } else if within {
                    mean
                } else {
                    0.0
                }
            };
            Table::new(first as f32, 1.0, (first..=last + 1).map(at).collect())
        };
        let name =
            |[from, to]: [u32; 2]| format!("S0.{},{}nm", (from + to) / 2, if (from + to).is_multiple_of(2) { 0 } else { 5 });
        Response {
            bands: bands.limits().map(|b| Band { name: name(b), unit: BandUnit::Radiance }).collect(),
            curves: bands.limits().map(curve).collect(),
            analyzers: Vec::new(),
        }
    }

    /// Luminance in cd/m².
    pub fn luminance() -> Self {
        let y = diopter_light::cie::observer().y.scaled(diopter_light::units::LUMINOUS_EFFICACY as f32);
        Response { bands: vec![Band { name: "Y".into(), unit: BandUnit::Radiance }], curves: vec![y], analyzers: Vec::new() }
    }

    /// Whether a band tells polarised light from unpolarised.
    pub fn tells_polarization(&self) -> bool {
        self.analyzers.iter().any(|a| a.contrast != 0.0)
    }

    /// What Q and U count in the bands of each group, I counting 1; nothing where no band tells them.
    pub(super) fn analyzer_groups(&self) -> Vec<[glam::Vec4; 2]> {
        if !self.tells_polarization() {
            return Vec::new();
        }
        let weights = |a: &Analyzer| {
            let (sin, cos) = (2.0 * a.angle_deg).to_radians().sin_cos();
            [cos, sin].map(|w| (a.contrast * w) as f32)
        };
        let group = |four: &[Analyzer]| {
            [0, 1].map(|q| glam::Vec4::from_array(std::array::from_fn(|b| four.get(b).map_or(0.0, |a| weights(a)[q]))))
        };
        self.analyzers.chunks(GROUP).map(group).collect()
    }
}

/// Bands of one vector.
pub(super) const GROUP: usize = 4;

/// Response curves at 1 nm, four bands side by side: one look-up a wavelength and group of bands.
pub(super) struct Curves {
    /// `[group][nm][band]`, the last group padded to four bands.
    groups: Vec<Vec<[f32; GROUP]>>,
}

impl Curves {
    pub(super) fn new(curves: &[Table]) -> Self {
        let group = |four: &[Table]| {
            let row = |nm: f32| -> [f32; GROUP] { std::array::from_fn(|b| four.get(b).map_or(0.0, |c| c.at(nm))) };
            (0..=401).map(|i| row(FIRST_NM + i as f32)).collect::<Vec<_>>()
        };
        Curves { groups: curves.chunks(GROUP).map(group).collect() }
    }

    /// Red, green and blue of paths that carry colours: each where it stands.
    pub(super) fn rgb() -> Self {
        let mut rows = vec![[0.0; GROUP]; 402];
        for (c, nm) in RGB_NM.into_iter().enumerate() {
            rows[(nm - FIRST_NM) as usize][c] = 1.0;
        }
        Curves { groups: vec![rows] }
    }

    /// Four bands at a wavelength.
    #[inline]
    pub(super) fn at(&self, group: usize, nm: f32) -> glam::Vec4 {
        let rows = &self.groups[group];
        let x = nm - FIRST_NM;
        let i = (x as u32 as usize).min(400);
        let (a, b) = (glam::Vec4::from_array(rows[i]), glam::Vec4::from_array(rows[i + 1]));
        a + (b - a) * (x - i as f32)
    }

    /// What the four wavelengths of a path are worth in four bands.
    #[inline]
    pub(super) fn value(&self, group: usize, nm: [f32; 4], weighted: [f32; 4]) -> glam::Vec4 {
        let mut value = glam::Vec4::ZERO;
        for c in 0..4 {
            value += self.at(group, nm[c]) * weighted[c];
        }
        value
    }
}

/// Adds the values of a group of bands to the sums of a pixel, `[band][half]`; the last group may have fewer than four.
#[inline]
pub(super) fn add_to(bands: &mut [[f64; 2]], half: usize, value: glam::Vec4) {
    for (sum, v) in bands.iter_mut().zip(value.to_array()) {
        sum[half] += v as f64;
    }
}
