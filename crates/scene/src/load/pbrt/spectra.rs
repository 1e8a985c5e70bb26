//! Spectra by name, from files, as lists and colours.

use super::context::Context;
use super::params::{Param, Params, Values};
use super::{Fault, Place};
use diopter_light::cie;
use diopter_light::color;
use diopter_light::spectrum::{Table, blackbody};
use diopter_light::units::LUMINOUS_EFFICACY;
use diopter_light::upsample::Sigmoid;
use diopter_light::{Spectrum, spectrum};
use glam::Vec3;

/// Optical constants as pbrt-v4 knows them (`util/spectrum.cpp`), metal by metal.
const METALS_CSV: &str = include_str!("metals.csv");

/// Sellmeier coefficients (B₁ B₂ B₃, C₁ C₂ C₃ in µm²) of the glasses that pbrt names. Source: Schott's catalogue by refractiveindex.info (CC0);
/// pbrt's F5, F10 and F11 are Schott's N-SF5, N-SF10 and N-SF11, its LASF9 is N-LASF9.
const GLASSES: [(&str, [f64; 6]); 7] = [
    ("BK7", [1.039_612_12, 0.231_792_344, 1.010_469_45, 0.006_000_698_67, 0.020_017_914_4, 103.560_653]),
    ("BAF10", [1.585_149_5, 0.143_559_385, 1.085_212_69, 0.009_266_812_82, 0.042_448_980_5, 105.613_573]),
    ("FK51A", [0.971_247_817, 0.216_901_417, 0.904_651_666, 0.004_723_019_95, 0.015_357_561_2, 168.681_33]),
    ("LASF9", [2.000_295_47, 0.298_926_886, 1.806_918_43, 0.012_142_601_7, 0.053_873_623_6, 156.530_829]),
    ("F5", [1.524_818_89, 0.187_085_527, 1.427_290_15, 0.011_254_756, 0.058_899_539_2, 129.141_675]),
    ("F10", [1.621_539_02, 0.256_287_842, 1.644_475_52, 0.012_224_145_7, 0.059_573_677_5, 147.468_793]),
    ("F11", [1.737_596_95, 0.313_747_346, 1.898_781_01, 0.013_188_707, 0.062_306_814_2, 155.236_29]),
];

/// How names of pbrt's own spectra begin.
const FAMILIES: [&str; 7] = ["stdillum-", "illum-", "glass-", "metal-", "canon_", "nikon_", "sony_"];
/// What a name may be.
const KNOWN: &str = "a spectrum that is known by name (stdillum-D65 or another of CIE's, glass-BK7, metal-Cu-eta ...), or a file of wavelengths and values";

/// What a spectrum is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Use {
    /// A reflectance: 0 to 1.
    Albedo,
    /// An index, an extinction.
    Unbounded,
    /// Light: 1 cd/m² (or candela, or lux) where it is given by anything but RGB.
    Light,
}

/// A spectrum of a parameter; a reflectance must be one.
pub fn of(context: &Context, p: &Param, purpose: Use) -> Result<Spectrum, Fault> {
    let spectrum = any(context, p, purpose)?;
    let bad = || (0..=80).map(|i| spectrum.at(380.0 + 5.0 * i as f32)).find(|v| !(-1e-4..=1.0001).contains(v));
    match bad().filter(|_| purpose == Use::Albedo) {
        Some(v) => Err(p.place.fault(format!("a reflectance of {v}"), "0 to 1 at all wavelengths")),
        None => Ok(spectrum),
    }
}

fn any(context: &Context, p: &Param, purpose: Use) -> Result<Spectrum, Fault> {
    match (&p.values, p.kind.as_str()) {
        (Values::Numbers(n), "rgb") => {
            let [r, g, b] = n[..] else { return Err(p.place.fault(format!("{} numbers of an rgb", n.len()), "3")) };
            let rgb = Vec3::new(r as f32, g as f32, b as f32);
            if rgb.min_element() < 0.0 || (purpose == Use::Albedo && rgb.max_element() > 1.0) {
                let allowed =
                    if purpose == Use::Albedo { "numbers from 0 to 1: it is a reflectance" } else { "numbers of at least 0" };
                return Err(p.place.fault(format!("rgb {r} {g} {b}"), allowed));
            }
            Ok(match purpose {
                Use::Albedo => Spectrum::Sigmoid(Sigmoid::from_rgb(rgb)),
                Use::Unbounded => unbounded(rgb),
                Use::Light => Spectrum::light_from_rgb(rgb),
            })
        }
        (Values::Numbers(n), "blackbody") => {
            let kelvin = n.first().copied().unwrap_or(0.0) as f32;
            if !(kelvin > 0.0) {
                return Err(p.place.fault(format!("a black body of {kelvin} K"), "a temperature above 0"));
            }
            Ok(match purpose {
                Use::Light => spectrum::blackbody_with_luminance(kelvin, 1.0),
                _ => {
                    // Of peak 1, wherever that lies. Source: Wien's displacement law.
                    let peak = blackbody(2.897_771_9e6 / kelvin, kelvin);
                    Spectrum::Table(Table::new(
                        380.0,
                        5.0,
                        (0..=80).map(|i| blackbody(380.0 + 5.0 * i as f32, kelvin) / peak).collect(),
                    ))
                }
            })
        }
        (Values::Numbers(n), "spectrum") => table(n, purpose, p.place).map(|t| lit(t, purpose)),
        (Values::Texts(names), "spectrum") => {
            let name = names.first().map_or("", String::as_str);
            match named(name) {
                Some(t) => Ok(lit(t, purpose)),
                None => {
                    let bytes = context.file(name, p.place).map_err(|fault| {
                        match FAMILIES.iter().any(|family| name.starts_with(family)) {
                            true => p.place.fault(format!("spectrum \"{name}\""), KNOWN),
                            false => fault,
                        }
                    })?;
                    let text = String::from_utf8_lossy(&bytes).into_owned();
                    let words = text.lines().map(|l| l.split('#').next().unwrap_or("")).flat_map(str::split_ascii_whitespace);
                    let numbers: Option<Vec<f64>> = words.map(|w| w.parse().ok()).collect();
                    let numbers = numbers.ok_or_else(|| {
                        p.place.fault(format!("{name}: something that is no number"), "wavelengths (nm) and values")
                    })?;
                    table(&numbers, purpose, p.place).map(|t| lit(t, purpose))
                }
            }
        }
        // No spectrum in pbrt; a number without bound is the same at all wavelengths, light has no such unit.
        (Values::Numbers(n), "float") if n.len() == 1 && purpose != Use::Light => Ok(Spectrum::Constant(n[0] as f32)),
        _ => Err(p
            .place
            .fault(format!("\"{} {}\"", p.kind, p.name), format!("\"rgb {0}\", \"spectrum {0}\" or \"blackbody {0}\"", p.name))),
    }
}

/// A spectrum of a list of parameters, or what it is without. Fails where it is of no type that is a spectrum, out of the range of its purpose, or its file cannot be
/// read.
pub fn get(context: &Context, params: &Params, name: &str, purpose: Use, default: Spectrum) -> Result<Spectrum, Fault> {
    params.get(name).map_or(Ok(default), |p| of(context, p, purpose))
}

/// An RGB triple without upper bound as a spectrum: a scaled sigmoid over wavelength (pbrt-v4's `RGBUnboundedSpectrum`, PBR 4ed §4.6.6), the
/// numbers themselves in RGB lanes.
fn unbounded(rgb: Vec3) -> Spectrum {
    // A grey is the same at every wavelength.
    if rgb.x == rgb.y && rgb.y == rgb.z {
        return Spectrum::Constant(rgb.x);
    }
    let scale = 2.0 * rgb.max_element();
    let sigmoid = Sigmoid::from_rgb(rgb / scale);
    let table = Table::new(380.0, 5.0, (0..=80).map(|i| scale * sigmoid.at(380.0 + 5.0 * i as f32)).collect());
    Spectrum::TableOfRgb { table, rgb }
}

/// Light is divided by its own luminance: only its colour counts.
fn lit(table: Table, purpose: Use) -> Spectrum {
    if purpose != Use::Light {
        return Spectrum::Table(table);
    }
    let luminance = color::luminance(|nm| table.at(nm));
    Spectrum::Table(if luminance > 0.0 { table.scaled((1.0 / luminance) as f32) } else { table })
}

/// Pairs of wavelength and value; 0 beyond, but an index goes on as it ends.
fn table(pairs: &[f64], purpose: Use, place: Place) -> Result<Table, Fault> {
    let (points, rest) = pairs.as_chunks::<2>();
    if points.is_empty()
        || !rest.is_empty()
        || points.windows(2).any(|w| w[0][0] >= w[1][0])
        || pairs.iter().any(|v| !v.is_finite())
    {
        return Err(place.fault(format!("{} numbers of a spectrum", pairs.len()), "pairs of rising wavelength (nm) and value"));
    }
    let at = |nm: f64| {
        let i = points.partition_point(|p| p[0] < nm);
        match (i.checked_sub(1).map(|k| points[k]), points.get(i)) {
            (_, Some(p)) if p[0] == nm => p[1],
            (Some(a), Some(b)) => a[1] + (b[1] - a[1]) * (nm - a[0]) / (b[0] - a[0]),
            (Some(end), None) | (None, Some(&end)) if purpose == Use::Unbounded => end[1],
            _ => 0.0,
        }
    };
    Ok(Table::new(380.0, 1.0, (380..=780).map(|nm| at(f64::from(nm)) as f32).collect()))
}

/// A named spectrum that is known to be there; nothing of others.
pub fn named_or_nothing(name: &str) -> Spectrum {
    named(name).map_or(Spectrum::Constant(0.0), Spectrum::Table)
}

/// pbrt's named spectra.
fn named(name: &str) -> Option<Table> {
    if let Some(illuminant) = name.strip_prefix("stdillum-") {
        let ours = illuminant.strip_prefix('F').map_or(illuminant.to_owned(), |n| format!("FL{n}"));
        let curve = cie::illuminant(&ours)?;
        let luminance = color::luminance(|nm| curve.at(nm)) / LUMINOUS_EFFICACY;
        // Of as much light as an even spectrum of 1 (CIE Y integral 106.857).
        return Some(curve.scaled((106.856_895 / luminance) as f32));
    }
    if let Some(glass) = name.strip_prefix("glass-") {
        let (_, [b1, b2, b3, c1, c2, c3]) = GLASSES.iter().find(|g| g.0 == glass)?;
        let index = |nm: i32| {
            let l2 = (f64::from(nm) * 1e-3).powi(2);
            (1.0 + b1 * l2 / (l2 - c1) + b2 * l2 / (l2 - c2) + b3 * l2 / (l2 - c3)).sqrt() as f32
        };
        return Some(Table::new(380.0, 5.0, (0..=80).map(|i| index(380 + 5 * i)).collect()));
    }
    let metal = name.strip_prefix("metal-")?;
    let (metal, which) = metal.rsplit_once('-')?;
    let column = match which {
        "eta" => 2,
        "k" => 3,
        _ => return None,
    };
    let points: Vec<(f32, f32)> = METALS_CSV
        .lines()
        .map(|l| l.split(',').collect::<Vec<_>>())
        .filter(|c| c.len() == 4 && c[0] == metal)
        .filter_map(|c| Some((c[1].parse().ok()?, c[column].parse().ok()?)))
        .collect();
    (!points.is_empty()).then(|| Table::from_points(&points))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_have_the_numbers_of_their_sources() {
        // Schott: N-BK7 nd 1.51680, N-SF11 nd 1.78472.
        assert!((named("glass-BK7").unwrap().at(587.6) - 1.5168).abs() < 1e-4);
        assert!((named("glass-F11").unwrap().at(587.6) - 1.78472).abs() < 1e-4);
        // pbrt's silver at 550 nm.
        let (n, k) = (named("metal-Ag-eta").unwrap().at(550.0), named("metal-Ag-k").unwrap().at(550.0));
        assert!((n - 0.124).abs() < 0.01 && (k - 3.34).abs() < 0.03, "{n} {k}");
        assert!(["metal-X-eta", "glass-X", "metal-Cu", "stdillum-Q", "x"].iter().all(|n| named(n).is_none()));
    }

    #[test]
    fn metals_are_the_ones_that_were_checked() {
        let sum = METALS_CSV.bytes().fold(0xcbf2_9ce4_8422_2325u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3));
        assert_eq!(sum, CHECKED, "a table changed: compare it with its source, then update the checksum");
    }
    const CHECKED: u64 = 14148113310364826428;

    #[test]
    fn unbounded_colours_keep_their_three_numbers_and_a_smooth_spectrum() {
        use diopter_light::SampledWavelengths;
        // Copper's n and k as RGB.
        let rgb = Vec3::new(0.2, 0.924, 2.45);
        let spectrum = unbounded(rgb);
        assert_eq!(spectrum.sample(&SampledWavelengths::rgb()).truncate(), rgb);
        // At one wavelength a value of the spectrum, which is not a number of the triple.
        let at = spectrum.sample(&SampledWavelengths::fixed([460.0, 550.0, 620.0, 700.0]));
        assert!(at.x > at.y && at.y > at.z && at.z > 0.0 && at.x < 4.9, "{at}");
        assert_eq!([0.0, 1.5].map(|v| unbounded(Vec3::splat(v))), [0.0, 1.5].map(Spectrum::Constant));
    }

    #[test]
    fn lists_end_at_their_ends() {
        let t = table(&[400.0, 1.0, 500.0, 3.0], Use::Albedo, Place::default()).unwrap();
        assert_eq!([t.at(390.0), t.at(400.0), t.at(450.0), t.at(510.0)], [0.0, 1.0, 2.0, 0.0]);
        let index = table(&[400.0, 1.0, 500.0, 3.0], Use::Unbounded, Place::default()).unwrap();
        assert_eq!([index.at(390.0), index.at(510.0)], [1.0, 3.0]);
        for bad in [&[][..], &[400.0], &[500.0, 1.0, 400.0, 1.0], &[400.0, f64::NAN]] {
            assert!(table(bad, Use::Light, Place::default()).is_err());
        }
    }
}
