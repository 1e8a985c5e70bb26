//! Light from all around: one colour, or a lat-long map.
//!
//! The map's middle row is the horizon of its own frame: +y up, column 0 at +z, from there through −x to −z in the middle and on through +x, as seen from inside
//! (u = atan2(x, −z)/2π + ½, v = acos(y)/π). Directions are drawn in proportion to what exceeds the mean luminance, × sin θ; an even map is not
//! sampled: scattered rays find it better.

use super::{LightPoint, LightSample};
use crate::exact::{Exact, Sink, Source, field, field_or};
use diopter_image::Raster;
use diopter_light::color::{self, SRGB_LUMINANCE};
use diopter_light::sampling::Grid2;
use diopter_light::spectrum::Table;
use diopter_light::{SampledSpectrum, SampledWavelengths, Spectrum};
use glam::{Mat3, Vec2, Vec3};
use serde_json::Value;
use std::f32::consts::{PI, TAU};
use std::sync::Arc;

/// Surroundings infinitely far away.
#[derive(Clone, Debug)]
pub struct Environment {
    map: Arc<Raster<f32>>,
    /// Turns directions of the map into directions of the world.
    world_from_map: Mat3,
    scale: f32,
    /// Where light samples are drawn from.
    grid: Option<Arc<Grid2>>,
    /// Light of a map of one colour, at a scale of 1.
    even: Option<Spectrum>,
    mean_luminance: f32,
    /// Mean luminance of what is sampled.
    sampled_luminance: f32,
    /// Pixels with a number that counts as 0.
    invalid: usize,
    /// How its light is polarised; not at all without.
    sky: Option<RayleighSky>,
}

/// The polarisation of a clear sky as single Rayleigh scattering makes it: the field is perpendicular to the plane of sun and view, its degree
/// `maximum` sin² γ / (1 + cos² γ) at an angle γ from the sun. Light from below the horizon is not polarised.
///
/// Of single scattering by isotropic molecules `maximum` would be 1; scattering again and again, light from the ground, haze and the anisotropy of
/// molecules leave less. Neutral points near the sun are not followed. Source: K. L. Coulson 1988, "Polarization and Intensity of Light in the
/// Atmosphere"; the form of A. Wilkie, R. F. Tobin, C. Ulbricht, G. Zotti, W. Purgathofer 2004, "An Analytical Model for Skylight Polarisation".
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayleighSky {
    /// Unit direction towards the sun, in the world.
    pub sun: Vec3,
    /// Degree of polarisation at 90° from the sun.
    pub maximum: f32,
}

/// Light that is in part polarised linearly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LinearlyPolarized {
    /// Along what its field oscillates.
    pub axis: Vec3,
    /// Direction of the light: angles count about it.
    pub along: Vec3,
    /// Degree of polarisation.
    pub degree: f32,
}

impl RayleighSky {
    /// Degree of polarisation, 0 to 1, of light from a unit direction; 0 from below the horizon.
    pub fn degree(&self, direction: Vec3) -> f32 {
        let cos2 = self.sun.dot(direction).powi(2).min(1.0);
        if direction.y > 0.0 { self.maximum * (1.0 - cos2) / (1.0 + cos2) } else { 0.0 }
    }
}

impl Environment {
    /// From a lat-long map of linear sRGB in cd/m² (three channels, upper row first), times `scale`. Numbers that are negative or not finite count as 0; a map without
    /// pixels is dark.
    pub fn new(mut map: Raster<f32>, world_from_map: Mat3, scale: f32) -> Self {
        if map.data.is_empty() {
            map = Raster::new(1, 1, 3);
        }
        let valid = |v: &f32| *v >= 0.0 && v.is_finite();
        let invalid = map.data.chunks_exact(3).filter(|p| !p.iter().all(valid)).count();
        map.data.iter_mut().filter(|v| !valid(v)).for_each(|v| *v = 0.0);
        let (width, height) = (map.width, map.height);
        let mut weights = Vec::with_capacity(width * height);
        let luminance = |c: usize, r: usize| Vec3::from_slice(map.pixel(c, r)).dot(SRGB_LUMINANCE);
        let sine = |row: usize| (PI * (row as f32 + 0.5) / height as f32).sin();
        let total: f64 = (0..height).map(|r| sine(r) as f64 * width as f64).sum();
        let sum: f64 =
            (0..height).flat_map(|r| (0..width).map(move |c| (r, c))).map(|(r, c)| (luminance(c, r) * sine(r)) as f64).sum();
        let mean = (sum / total.max(1e-30)) as f32;
        // Sample only what is brighter than the mean: the even rest is found better by scattered rays, and multiple
        // importance sampling puts both together (Karlík et al. 2019, "MIS Compensation").
        let brightest = map.data.chunks_exact(3).map(|p| Vec3::from_slice(p).dot(SRGB_LUMINANCE)).fold(0.0, f32::max);
        let is_sampled = brightest > EVEN * mean;
        for row in 0..height {
            for column in 0..width {
                // Bilinear lookup reaches into the neighbours: so must the weight.
                let around = [
                    ((column + 1) % width, row),
                    ((column + width - 1) % width, row),
                    (column, (row + 1).min(height - 1)),
                    (column, row.saturating_sub(1)),
                ];
                let here = luminance(column, row);
                let reach = around.iter().map(|(c, r)| luminance(*c, *r)).fold(here, f32::max);
                weights.push((0.75 * here + 0.25 * reach - mean).max(0.0) * sine(row));
            }
        }
        let grid = is_sampled.then(|| Grid2::new(&weights, width));
        let excess = if is_sampled { (weights.iter().map(|w| *w as f64).sum::<f64>() / total.max(1e-30)) as f32 } else { 0.0 };
        let first = map.pixel(0, 0);
        let even = map.data.chunks_exact(3).all(|p| p == first).then(|| Spectrum::light_from_rgb(Vec3::from_slice(first)));
        let (mean_luminance, sampled_luminance) = (mean * scale, excess * scale);
        let (map, grid) = (Arc::new(map), grid.map(Arc::new));
        Environment { map, world_from_map, scale, grid, even, mean_luminance, sampled_luminance, invalid, sky: None }
    }

    /// The same linear sRGB colour (cd/m²) from everywhere.
    pub fn uniform(rgb: Vec3) -> Self {
        let mut map = Raster::new(8, 4, 3);
        map.data.chunks_exact_mut(3).for_each(|p| p.copy_from_slice(&rgb.to_array()));
        Environment::new(map, Mat3::IDENTITY, 1.0)
    }

    /// The same light from everywhere, W·m⁻²·sr⁻¹·nm⁻¹.
    pub fn even(light: Spectrum) -> Self {
        if let Spectrum::RgbLight { .. } = light {
            return Environment::uniform(light.sample(&SampledWavelengths::rgb()).truncate().max(Vec3::ZERO));
        }
        // Of as much light, also where its colour is none of sRGB.
        let rgb = color::srgb_of_light(|nm| light.at(nm)).max(Vec3::ZERO);
        let luminance = color::luminance(|nm| light.at(nm)).max(0.0) as f32;
        let shown = rgb.dot(SRGB_LUMINANCE);
        let map = Environment::uniform(if shown > 0.0 { rgb * (luminance / shown) } else { Vec3::ZERO });
        Environment { even: Some(light), ..map }
    }

    /// Its light at a wavelength, if it is the same from everywhere.
    fn even_at(&self) -> Option<impl Fn(f32) -> f32> {
        self.even.as_ref().map(|light| |nm: f32| light.at(nm) * self.scale)
    }

    /// Both together, on the finer of the two maps; what polarises one of them is left out.
    pub fn plus(&self, other: &Environment) -> Environment {
        let is_rgb = |e: &Environment| matches!(e.even, Some(Spectrum::RgbLight { .. }));
        if let (Some(a), Some(b), false) = (self.even_at(), other.even_at(), is_rgb(self) && is_rgb(other)) {
            let sum = (380..=780).map(|nm| nm as f32).map(|nm| a(nm) + b(nm)).collect();
            return Environment::even(Spectrum::Table(Table::new(380.0, 1.0, sum)));
        }
        let (fine, coarse) = if self.map.width >= other.map.width { (self, other) } else { (other, self) };
        let (w, h) = (fine.map.width, fine.map.height);
        let mut map = Raster::new(w, h, 3);
        for row in 0..h {
            for column in 0..w {
                let place = Vec2::new((column as f32 + 0.5) / w as f32, (row as f32 + 0.5) / h as f32);
                let sum = fine.rgb_at(place) + coarse.rgb(fine.world_from_map * direction(place));
                map.pixel_mut(column, row).copy_from_slice(&sum.to_array());
            }
        }
        Environment::new(map, fine.world_from_map, 1.0)
    }

    /// The same, its light polarised as that of a sky.
    pub fn with_polarized_sky(self, sky: RayleighSky) -> Self {
        Environment { sky: Some(sky), ..self }
    }

    /// How light from a direction is polarised, if it is.
    pub(crate) fn polarization(&self, direction: Vec3) -> Option<LinearlyPolarized> {
        let sky = self.sky?;
        let axis = sky.sun.cross(direction).try_normalize()?;
        Some(LinearlyPolarized { axis, along: -direction, degree: sky.degree(direction) }).filter(|p| p.degree > 0.0)
    }

    /// Pixels of the map that were given with a number that is negative or not finite, which counts as 0.
    pub fn invalid_pixels(&self) -> usize {
        self.invalid
    }

    /// How many pixels the map has.
    pub fn pixels(&self) -> usize {
        self.map.width * self.map.height
    }

    /// Mean luminance over all directions, cd/m².
    pub fn mean_luminance(&self) -> f32 {
        self.mean_luminance
    }

    /// Mean over all directions of the luminance that light sampling covers (the map less its even part), cd/m².
    pub fn sampled_luminance(&self) -> f32 {
        self.sampled_luminance
    }

    /// Multiplies all of its light by a factor, at least 0.
    pub fn scale_light(&mut self, factor: f32) {
        self.scale *= factor;
        self.mean_luminance *= factor;
        self.sampled_luminance *= factor;
    }

    /// Turns it into its mirror image, z → −z.
    pub(crate) fn mirror(&mut self) {
        self.world_from_map = Mat3::from_diagonal(Vec3::new(1.0, 1.0, -1.0)) * self.world_from_map;
        self.sky = self.sky.map(|sky| RayleighSky { sun: sky.sun * Vec3::new(1.0, 1.0, -1.0), ..sky });
    }

    fn place(&self, direction: Vec3) -> Vec2 {
        let d = self.world_from_map.transpose() * direction;
        // atan2 keeps its digits near the poles, where acos would not.
        Vec2::new(d.x.atan2(-d.z) / TAU + 0.5, d.x.hypot(d.z).atan2(d.y) / PI)
    }

    /// Linear sRGB in cd/m² from a direction (of any length, in the world), bilinear.
    pub fn rgb(&self, direction: Vec3) -> Vec3 {
        self.rgb_at(self.place(direction))
    }

    /// Linear sRGB in cd/m² at a place of the map (0..1 across and down).
    pub fn rgb_at(&self, place: Vec2) -> Vec3 {
        let (w, h) = (self.map.width, self.map.height);
        let p = place * Vec2::new(w as f32, h as f32) - 0.5;
        let (x, y) = (p.x.floor(), p.y.floor());
        let (fx, fy) = (p.x - x, p.y - y);
        let column = |i: f32| (i as i64).rem_euclid(w as i64) as usize;
        let row = |i: f32| (i.max(0.0) as usize).min(h - 1);
        let at = |c: f32, r: f32| Vec3::from_slice(self.map.pixel(column(c), row(r)));
        let top = at(x, y).lerp(at(x + 1.0, y), fx);
        let bottom = at(x, y + 1.0).lerp(at(x + 1.0, y + 1.0), fx);
        top.lerp(bottom, fy) * self.scale
    }

    /// Spectral radiance from a direction (in the world), W·m⁻²·sr⁻¹·nm⁻¹.
    #[inline]
    pub fn radiance(&self, direction: Vec3, wavelengths: &SampledWavelengths) -> SampledSpectrum {
        match &self.even {
            Some(light) => light.sample(wavelengths) * self.scale,
            None => Spectrum::light_from_rgb(self.rgb(direction)).sample(wavelengths),
        }
    }

    pub(super) fn sample_li(&self, u: [f32; 2]) -> Option<LightSample> {
        let (p, density) = self.grid.as_ref()?.sample(u);
        let (d, sin) = (direction(p), (p.y * PI).sin());
        let pdf = density / (2.0 * PI * PI * sin);
        let wi = self.world_from_map * d;
        (pdf > 0.0 && pdf.is_finite()).then_some(LightSample {
            wi,
            distance: f32::INFINITY,
            pdf,
            has_extent: true,
            spot: LightPoint::Environment(p),
            clearance: 0.0,
        })
    }

    /// Density in solid angle with which a direction is drawn, 1/sr; 0 where none is.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        let Some(grid) = &self.grid else { return 0.0 };
        let p = self.place(direction);
        let sin = (p.y * PI).sin();
        if sin > 0.0 { grid.pdf(p) / (2.0 * PI * PI * sin) } else { 0.0 }
    }
}

/// A map whose brightest place is less than so many times its mean is even.
const EVEN: f32 = 1.05;

/// The direction, in the map's own frame, of a place on it.
pub(crate) fn direction(place: Vec2) -> Vec3 {
    let (theta, phi) = (place.y * PI, (place.x - 0.5) * TAU);
    Vec3::new(theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos())
}

impl Exact for Environment {
    fn write(&self, sink: &mut Sink) -> Value {
        let object = [
            ("map", self.map.write(sink)),
            ("world_from_map", self.world_from_map.write(sink)),
            ("scale", self.scale.write(sink)),
            // Made by multiplication, maybe more than once.
            ("mean_luminance", self.mean_luminance.write(sink)),
            // By its first name, as files have it.
            ("aimed_luminance", self.sampled_luminance.write(sink)),
            ("invalid", self.invalid.write(sink)),
            ("even", self.even.write(sink)),
        ];
        object.into_iter().map(|(k, v)| (k.to_owned(), v)).collect()
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        let map: Raster<f32> = field(value, "map", source)?;
        if map.channels != 3 || map.data.is_empty() {
            return Err("surroundings that are no picture".into());
        }
        let plain = Environment::new(map, field(value, "world_from_map", source)?, field(value, "scale", source)?);
        Ok(Environment {
            mean_luminance: field(value, "mean_luminance", source)?,
            sampled_luminance: field(value, "aimed_luminance", source)?,
            invalid: field(value, "invalid", source)?,
            even: field_or(value, "even", source, plain.even.clone())?,
            ..plain
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_light::random::{mix, to_unit};

    fn gradient() -> Environment {
        let mut map = Raster::new(32, 16, 3);
        for row in 0..16 {
            for column in 0..32 {
                let v = if (row, column) == (4, 9) { 300.0 } else { 1.0 + row as f32 };
                map.pixel_mut(column, row).fill(v);
            }
        }
        Environment::new(map, Mat3::from_rotation_y(0.7), 2.0)
    }

    #[test]
    fn aims_have_the_density_they_claim() {
        let env = gradient();
        let n = 300u32;
        let stratum =
            |i: u32| [(i % n) as f32 + to_unit(mix(i)), (i / n) as f32 + to_unit(mix(i ^ 0xffff))].map(|x| x / n as f32);
        let mut bright = 0;
        for i in 0..n * n {
            let light_sample = env.sample_li(stratum(i)).unwrap();
            assert!(
                (env.pdf(light_sample.wi) / light_sample.pdf - 1.0).abs() < 0.05,
                "{} {}",
                env.pdf(light_sample.wi),
                light_sample.pdf
            );
            let LightPoint::Environment(place) = light_sample.spot else { panic!("the environment samples itself") };
            assert!((env.rgb_at(place) - env.rgb(light_sample.wi)).abs().max_element() < 0.02 * env.rgb(light_sample.wi).x + 0.5);
            bright += (env.rgb(light_sample.wi).x > 100.0) as u32;
        }
        // The one bright pixel has about 40 % of what exceeds the mean.
        assert!(bright > n * n / 5, "{bright}");
        // The density integrates to 1 over the sphere.
        let integral: f64 = (0..n * n).map(|i| env.pdf(diopter_light::sampling::sphere(stratum(i))) as f64).sum::<f64>();
        let integral = integral / (n * n) as f64 * 4.0 * std::f64::consts::PI;
        assert!((integral - 1.0).abs() < 0.03, "{integral}");
    }

    #[test]
    fn even_light_keeps_its_spectrum_and_its_luminance() {
        // A narrow blue, which no sRGB triple shows.
        let blue = Table::new(380.0, 1.0, (380..=780).map(|nm| f32::from(u8::from((440..=460).contains(&nm)))).collect());
        let luminance = color::luminance(|nm| blue.at(nm)) as f32;
        let env = Environment::even(Spectrum::Table(blue.clone()));
        assert!((env.mean_luminance() / luminance - 1.0).abs() < 1e-4, "{}", env.mean_luminance());
        let wavelengths = SampledWavelengths::fixed([430.0, 450.0, 550.0, 620.0]);
        assert_eq!(env.radiance(Vec3::X, &wavelengths).to_array(), [0.0, 1.0, 0.0, 0.0]);
        let both = env.plus(&env).plus(&Environment::uniform(Vec3::ONE));
        let white = Spectrum::light_from_rgb(Vec3::ONE);
        let expected = [430.0, 450.0, 550.0, 620.0].map(|nm| 2.0 * blue.at(nm) + white.at(nm));
        let found = both.radiance(Vec3::Y, &wavelengths).to_array();
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-4), "{found:?} {expected:?}");
    }

    #[test]
    fn the_mean_is_taken_over_directions() {
        let mut map = Raster::new(8, 4, 3);
        (0..8).for_each(|c| map.pixel_mut(c, 0).fill(8.0));
        // The upper quarter of the rows covers 1 − cos 45° of the upper half's 1, weighted at the middle of the rows.
        let sine = |r: f32| (PI * (r + 0.5) / 4.0).sin();
        let expected = 8.0 * sine(0.0) / (0..4).map(|r| sine(r as f32)).sum::<f32>();
        assert!((Environment::new(map, Mat3::IDENTITY, 1.0).mean_luminance() - expected).abs() < 1e-4);
    }

    #[test]
    fn pixels_that_are_no_light_are_counted() {
        let mut map = Raster::new(8, 4, 3);
        map.data.fill(2.0);
        map.pixel_mut(1, 1)[2] = f32::NAN;
        map.pixel_mut(2, 1).fill(f32::INFINITY);
        map.pixel_mut(3, 1)[0] = -1.0;
        let env = Environment::new(map, Mat3::IDENTITY, 1.0);
        assert_eq!((env.invalid_pixels(), env.pixels()), (3, 32));
        let middle = |column: usize| env.rgb_at(Vec2::new((column as f32 + 0.5) / 8.0, 1.5 / 4.0));
        assert_eq!([middle(1), middle(2)], [Vec3::new(2.0, 2.0, 0.0), Vec3::ZERO]);
        assert!(env.mean_luminance().is_finite());
    }

    #[test]
    fn up_is_the_top_row() {
        let mut map = Raster::new(8, 4, 3);
        map.pixel_mut(3, 0).fill(8.0);
        (0..8).for_each(|c| map.pixel_mut(c, 0).fill(8.0));
        let env = Environment::new(map, Mat3::IDENTITY, 1.0);
        assert_eq!(env.rgb(Vec3::Y).x, 8.0);
        assert_eq!(env.rgb(Vec3::NEG_Y).x, 0.0);
    }
}
