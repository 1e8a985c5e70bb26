//! Gaussian splats: places captured from photographs as many small 3D Gaussians that shine and cover (Kerbl et al. 2023, "3D Gaussian Splatting for
//! Real-Time Radiance Field Rendering").
//!
//! Each Gaussian has an opacity, a covariance and a colour by spherical harmonics of the direction of view. A ray meets it where its response along
//! the ray is largest and is covered there with probability α = o · exp(−½ dᵀ Σ⁻¹ d) (Moenne-Loccoz et al. 2024, "3D Gaussian Ray Tracing", §4: the
//! same point, the same α). Instead of sorting what a ray meets and blending it from front to back, each Gaussian is there or not, by a number that is
//! a hash of ray and Gaussian, and the nearest that is there is seen: stochastic transparency (Enderton et al. 2010; Kheradmand et al. 2025,
//! "StochasticSplats"). The mean is the same sum Σ cᵢ αᵢ Π (1 − αⱼ) over what lies before, exactly and in any order of the file, and Gaussians are
//! surfaces like all others: seen through lenses, in mirrors and through glass, hiding and hidden, casting shadows, lighting what is around them.
//!
//! As the rasteriser does that captures are trained with: α is at most 0.99 and what is below 1/255 is not there; a Gaussian ends where it falls
//! below that. What it doesn't: it also widens each Gaussian by 0.3 pixels² and sorts by the depth of centres.
//!
//! Limits: light is composited, while captures are trained to be composited in display values, so that soft borders between light and dark are somewhat
//! lighter than in the program that made them. The light of the place is in the colours: lamps and shadows do not change it.

use crate::bvh::{Bounds, Primitive, Primitives};
use crate::exact::{Exact, Sink, Source, exact_enum, field};
use diopter_light::color::srgb_decode;
use glam::{Mat3, Quat, Vec3};
use rayon::prelude::*;
use serde_json::Value;
use std::sync::OnceLock;

/// A Gaussian as it is described.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Splat {
    /// Middle, m.
    pub center: Vec3,
    /// From its axes to the space of the set; any length.
    pub rotation: Quat,
    /// Standard deviations along its axes, m.
    pub scale: Vec3,
    /// α in its middle, 0 to 1.
    pub opacity: f32,
}

/// What a ray meets it by.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Ellipsoid {
    center: Vec3,
    opacity: f32,
    /// Axes over standard deviations: they take an offset from the centre to units of these.
    rows: [Vec3; 3],
    /// Square of the distance in standard deviations at which α is [`LEAST_ALPHA`].
    cut2: f32,
}

/// How colours of a set are meant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColorCurve {
    /// Display values by the curve of sRGB.
    #[default]
    Srgb,
    /// Linear, 1 for display white.
    Linear,
}

/// A set of Gaussians.
#[derive(Clone, Debug)]
pub struct Splats {
    degree: u32,
    curve: ColorCurve,
    ellipsoids: Vec<Ellipsoid>,
    /// Coefficients of spherical harmonics as 16-bit floats, `[splat][coefficient][channel]`. Rounding moves a coefficient by at most 1 part in 2048,
    /// a display value of 1 by less than a sixteenth of a code of 8 bits.
    harmonics: Vec<u16>,
    core: OnceLock<Bounds>,
}

/// Least α that counts and largest there is (Kerbl et al. 2023, their rasteriser).
pub const LEAST_ALPHA: f32 = 1.0 / 255.0;
const MOST_ALPHA: f32 = 0.99;
/// Highest degree of spherical harmonics.
pub const MOST_DEGREE: u32 = 3;
/// Most Gaussians of a set: numbers of primitives have 30 bits.
pub const MOST_SPLATS: usize = 1 << 30;
/// Least standard deviation, as a fraction of the largest of the same Gaussian: discs stay invertible in single precision.
const THINNEST: f32 = 1e-5;
/// Largest standard deviations that are taken for meant, and places, m.
const SIZES: std::ops::RangeInclusive<f32> = 1e-9..=1e9;
const FARTHEST: f32 = 1e9;
/// Fraction of the centres, at each end of an axis, that is left out of [`Splats::core_bounds`]: captures have stray Gaussians far away.
const OUTLIERS: f64 = 0.05;
/// Sets of fewer are framed as a whole.
const FEW: usize = 100;

/// Where a ray meets a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplatHit {
    /// Where its response is largest, in units of the ray's direction.
    pub t: f32,
    /// Probability of being covered there.
    pub alpha: f32,
}

impl Ellipsoid {
    fn new(center: Vec3, opacity: f32, rows: [Vec3; 3]) -> Self {
        Ellipsoid { center, opacity, rows, cut2: 2.0 * (opacity / LEAST_ALPHA).ln() }
    }
}

exact_enum!(ColorCurve { Srgb, Linear });

impl Exact for Splats {
    fn write(&self, sink: &mut Sink) -> Value {
        let numbers = |e: &Ellipsoid| {
            let [a, b, c] = e.rows.map(|row| row.to_array());
            let [x, y, z] = e.center.to_array();
            [x, y, z, e.opacity, a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2]]
        };
        let ellipsoids: Vec<[f32; 13]> = self.ellipsoids.iter().map(numbers).collect();
        let object = [
            ("degree", self.degree.write(sink)),
            ("curve", self.curve.write(sink)),
            ("ellipsoids", ellipsoids.write(sink)),
            ("harmonics", self.harmonics.write(sink)),
        ];
        object.into_iter().map(|(k, v)| (k.to_owned(), v)).collect()
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        let degree: u32 = field(value, "degree", source)?;
        let numbers: Vec<[f32; 13]> = field(value, "ellipsoids", source)?;
        let harmonics: Vec<u16> = field(value, "harmonics", source)?;
        let fits = degree <= MOST_DEGREE && harmonics.len() == numbers.len() * 3 * ((degree + 1) * (degree + 1)) as usize;
        // Exponents of all ones are infinite or no numbers.
        if !fits || harmonics.iter().any(|h| h & 0x7c00 == 0x7c00) {
            return Err("Gaussian splats whose lists do not fit each other".into());
        }
        let ellipsoid = |v: [f32; 13]| {
            let vector = |from: usize| Vec3::new(v[from], v[from + 1], v[from + 2]);
            let e = Ellipsoid::new(vector(0), v[3], [vector(4), vector(7), vector(10)]);
            // As those that are added one by one; what rounding makes of the thinnest is allowed for.
            let sizes = e.rows.map(|row| row.length().recip());
            let largest = sizes.into_iter().fold(0.0, f32::max);
            let usable = e.center.abs().max_element() <= FARTHEST
                && (0.5 * SIZES.start()..=2.0 * SIZES.end()).contains(&largest)
                && sizes.iter().all(|s| *s >= 0.5 * THINNEST * largest)
                && e.opacity > LEAST_ALPHA
                && e.opacity <= 1.0;
            usable.then_some(e).ok_or("a Gaussian splat without extent or opacity, or too far away")
        };
        let ellipsoids = numbers.into_iter().map(ellipsoid).collect::<Result<_, _>>()?;
        Ok(Splats { degree, curve: field(value, "curve", source)?, ellipsoids, harmonics, core: OnceLock::new() })
    }
}

impl Splats {
    /// A set without Gaussians, whose colours have harmonics up to a degree of at most [`MOST_DEGREE`].
    pub fn new(degree: u32) -> Self {
        assert!(degree <= MOST_DEGREE, "harmonics of degree {degree}");
        Splats { degree, curve: ColorCurve::Srgb, ellipsoids: Vec::new(), harmonics: Vec::new(), core: OnceLock::new() }
    }

    /// The same with colours that are meant so.
    pub fn with_curve(self, curve: ColorCurve) -> Self {
        Splats { curve, ..self }
    }

    /// Coefficients of harmonics that each Gaussian has for each channel.
    pub fn coefficients(&self) -> usize {
        ((self.degree + 1) * (self.degree + 1)) as usize
    }

    /// Adds a Gaussian with its [`Splats::coefficients`] (red, green, blue), unless no ray could meet it: numbers that are not finite, no extent, or
    /// never above [`LEAST_ALPHA`]. Whether it was added.
    pub fn push(&mut self, splat: &Splat, harmonics: &[Vec3]) -> bool {
        assert_eq!(harmonics.len(), self.coefficients(), "coefficients of harmonics");
        let Splat { center, rotation, scale, opacity } = *splat;
        let largest = scale.max_element();
        let turns = rotation.length_squared().is_normal() && rotation.is_finite();
        let usable = center.is_finite()
            && center.abs().max_element() <= FARTHEST
            && scale.is_finite()
            && SIZES.contains(&largest)
            && turns
            && opacity > LEAST_ALPHA
            && harmonics.iter().all(|c| c.is_finite());
        if !usable {
            return false;
        }
        let axes = Mat3::from_quat(rotation.normalize());
        let scale = scale.max(Vec3::splat(THINNEST * largest));
        let opacity = opacity.min(1.0);
        let rows = [axes.x_axis / scale.x, axes.y_axis / scale.y, axes.z_axis / scale.z];
        self.ellipsoids.push(Ellipsoid::new(center, opacity, rows));
        self.harmonics.extend(harmonics.iter().flat_map(|c| c.to_array().map(half)));
        self.core = OnceLock::new();
        true
    }

    /// Adds all of another set of the same degree.
    pub fn append(&mut self, other: Splats) {
        assert_eq!(self.degree, other.degree, "degrees of harmonics");
        self.ellipsoids.extend(other.ellipsoids);
        self.harmonics.extend(other.harmonics);
        self.core = OnceLock::new();
    }

    /// Orders them along a curve through space (Morton 1966), so that what rays meet together lies together in memory: files have them in any order.
    pub fn order_in_space(&mut self) {
        const STEPS: f32 = 1023.0;
        let core = self.core_bounds();
        if core.is_empty() {
            return;
        }
        let size = core.size().max(Vec3::splat(f32::MIN_POSITIVE));
        let code = |center: Vec3| {
            let p = ((center - core.min) / size).clamp(Vec3::ZERO, Vec3::ONE) * STEPS;
            interleaved(p.x as u32) | interleaved(p.y as u32) << 1 | interleaved(p.z as u32) << 2
        };
        let mut order: Vec<(u32, u32)> =
            self.ellipsoids.par_iter().enumerate().map(|(i, e)| (code(e.center), i as u32)).collect();
        order.par_sort_unstable();
        let stride = 3 * self.coefficients();
        self.ellipsoids = order.iter().map(|(_, i)| self.ellipsoids[*i as usize]).collect();
        self.harmonics = order.iter().flat_map(|(_, i)| &self.harmonics[*i as usize * stride..][..stride]).copied().collect();
    }

    /// One of them, as it is held: opacity at most 1, scales at least 1e-5 of the largest.
    pub fn splat(&self, number: usize) -> Splat {
        let Ellipsoid { center, opacity, rows, .. } = self.ellipsoids[number];
        let mut axes = Mat3::from_cols(rows[0].normalize(), rows[1].normalize(), rows[2].normalize());
        if axes.determinant() < 0.0 {
            axes.z_axis = -axes.z_axis;
        }
        let scale = Vec3::from_array(rows.map(|row| row.length().recip()));
        Splat { center, rotation: Quat::from_mat3(&axes).normalize(), scale, opacity }
    }

    /// A coefficient of the harmonics of one of them: red, green, blue.
    pub fn harmonic(&self, number: usize, coefficient: usize) -> [f32; 3] {
        let first = 3 * (number * self.coefficients() + coefficient);
        [0, 1, 2].map(|c| from_half(self.harmonics[first + c]))
    }

    /// Degree of the harmonics.
    pub fn degree(&self) -> u32 {
        self.degree
    }

    /// How colours are meant.
    pub fn curve(&self) -> ColorCurve {
        self.curve
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.ellipsoids.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.ellipsoids.is_empty()
    }

    /// Bytes of memory held.
    pub fn memory(&self) -> usize {
        self.ellipsoids.capacity() * size_of::<Ellipsoid>() + self.harmonics.capacity() * 2
    }

    /// The box around one of them.
    fn bounds_of(&self, splat: usize) -> Bounds {
        let e = &self.ellipsoids[splat];
        // An axis times its standard deviation is its row times the variance.
        let spread = |row: Vec3| row / row.length_squared();
        let [a, b, c] = e.rows.map(|row| spread(row) * spread(row));
        let half = (a + b + c).map(|v| (v * e.cut2).sqrt());
        let half = half * (1.0 + 1e-5) + 4.0 * f32::EPSILON * e.center.abs().max_element();
        Bounds { min: e.center - half, max: e.center + half }
    }

    /// The box around all of them, strays included.
    pub fn bounds(&self) -> Bounds {
        (0..self.len()).map(|i| self.bounds_of(i)).fold(Bounds::EMPTY, Bounds::union)
    }

    /// The box that holds the middle nine tenths of the centres along each axis: what a picture of the place is to show.
    pub fn core_bounds(&self) -> Bounds {
        *self.core.get_or_init(|| {
            if self.len() < FEW {
                return self.bounds();
            }
            let cut = (self.len() as f64 * OUTLIERS) as usize;
            let mut box_ = Bounds { min: Vec3::ZERO, max: Vec3::ZERO };
            for axis in 0..3 {
                let mut places: Vec<f32> = self.ellipsoids.iter().map(|e| e.center[axis]).collect();
                let last = places.len() - 1;
                box_.min[axis] = *places.select_nth_unstable_by(cut, f32::total_cmp).1;
                box_.max[axis] = *places.select_nth_unstable_by(last - cut, f32::total_cmp).1;
            }
            box_
        })
    }

    /// Where a ray meets one of them with 0 < t < `t_max`, and how likely it is there.
    #[inline]
    pub fn intersect(&self, splat: u32, origin: Vec3, direction: Vec3, t_max: f32) -> Option<SplatHit> {
        let e = &self.ellipsoids[splat as usize];
        // From the nearest point to the centre onward: offsets stay small, and so does their rounding.
        let to = e.center - origin;
        let nearest = to.dot(direction) / direction.length_squared();
        let offset = direction * nearest - to;
        let in_units = |v: Vec3| Vec3::new(e.rows[0].dot(v), e.rows[1].dot(v), e.rows[2].dot(v));
        let (x, y) = (in_units(offset), in_units(direction));
        let further = -x.dot(y) / y.length_squared();
        let t = nearest + further;
        let distance2 = (x + y * further).length_squared();
        if !(distance2 < e.cut2 && t > 0.0 && t < t_max) {
            return None;
        }
        Some(SplatHit { t, alpha: (e.opacity * (-0.5 * distance2).exp()).min(MOST_ALPHA) })
    }

    /// Linear sRGB that is seen along a unit direction (of the ray, in the space of the set), where 1 is display white.
    ///
    /// Display value ½ + Σ cᵢ Yᵢ, not below 0 (Kerbl et al. 2023), by the standard's curve (IEC 61966-2-1), which goes on above 1; as it is of a set whose
    /// colours are linear.
    pub fn color(&self, splat: u32, direction: Vec3) -> Vec3 {
        let count = self.coefficients();
        let own = &self.harmonics[splat as usize * count * 3..][..count * 3];
        let basis = basis(direction);
        let mut display = Vec3::splat(0.5);
        for (c, y) in own.as_chunks::<3>().0.iter().zip(&basis) {
            display += Vec3::from_array(c.map(from_half)) * *y;
        }
        match self.curve {
            ColorCurve::Srgb => display.max(Vec3::ZERO).map(srgb_decode),
            ColorCurve::Linear => display.max(Vec3::ZERO),
        }
    }

    /// The axis along which one is thinnest, of length 1: the normal of the surface that it stands for.
    pub fn normal(&self, splat: u32) -> Vec3 {
        let rows = &self.ellipsoids[splat as usize].rows;
        let thinner = |a: Vec3, b: Vec3| if b.length_squared() > a.length_squared() { b } else { a };
        thinner(thinner(rows[0], rows[1]), rows[2]).normalize()
    }
}

/// Real spherical harmonics up to degree 3 at a unit direction, in the order and with the signs of captures (l rising, m from −l to l, with the
/// Condon–Shortley phase). Source: P.-P. Sloan 2013, "Efficient Spherical Harmonic Evaluation" (JCGT 2(2)), appendix.
fn basis(d: Vec3) -> [f32; 16] {
    let Vec3 { x, y, z } = d;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        0.282_094_79,
        -0.488_602_5 * y,
        0.488_602_5 * z,
        -0.488_602_5 * x,
        1.092_548_4 * x * y,
        -1.092_548_4 * y * z,
        0.315_391_57 * (2.0 * zz - xx - yy),
        -1.092_548_4 * x * z,
        0.546_274_2 * (xx - yy),
        -0.590_043_6 * y * (3.0 * xx - yy),
        2.890_611_4 * x * y * z,
        -0.457_045_8 * y * (4.0 * zz - xx - yy),
        0.373_176_33 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -0.457_045_8 * x * (4.0 * zz - xx - yy),
        1.445_305_7 * z * (xx - yy),
        -0.590_043_6 * x * (xx - 3.0 * yy),
    ]
}

/// 2⁻¹¹², which brings the exponents of 16-bit floats to where those of 32 bits are read (IEEE 754: biases 15 and 127), and its inverse.
const TO_HALF: f32 = f32::from_bits(15 << 23);
const FROM_HALF: f32 = f32::from_bits(239 << 23);

/// The nearest 16-bit float of a finite number, ties to even; the largest (65504) beyond it.
fn half(v: f32) -> u16 {
    let bits = (v.abs().min(65504.0) * TO_HALF).to_bits();
    let rounded = (bits + 0xfff + (bits >> 13 & 1)) >> 13;
    rounded as u16 | if v.is_sign_negative() { 0x8000 } else { 0 }
}

/// The value of a finite 16-bit float.
#[inline]
fn from_half(h: u16) -> f32 {
    let magnitude = f32::from_bits(u32::from(h & 0x7fff) << 13) * FROM_HALF;
    if h & 0x8000 != 0 { -magnitude } else { magnitude }
}

/// The ten lower bits of a number with two zeros before each.
fn interleaved(v: u32) -> u32 {
    let v = (v | v << 16) & 0x0300_00ff;
    let v = (v | v << 8) & 0x0300_f00f;
    let v = (v | v << 4) & 0x030c_30c3;
    (v | v << 2) & 0x0924_9249
}

/// A set as primitives of its hierarchy.
pub(crate) struct SplatBoxes<'a>(pub &'a Splats);

impl Primitives for SplatBoxes<'_> {
    fn len(&self) -> usize {
        self.0.len()
    }
    fn get(&self, index: usize) -> Primitive {
        Primitive::Other { bounds: self.0.bounds_of(index), id: index as u32 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::{Bvh, Filter, Hit};
    use crate::material::Material;
    use crate::radiance::PathSettings;
    use crate::scene::{Description, Object, Scene, Shape};
    use crate::shape::Quad;
    use diopter_light::color::SRGB_LUMINANCE;
    use diopter_light::random::{Sampler, SamplerKind, mix, to_unit};
    use diopter_light::{Ray, Sampled, Spectrum, Wavelengths};
    use glam::{Affine3A, DMat3, DVec3};

    fn random(seed: u32) -> Vec3 {
        Vec3::from_array(std::array::from_fn(|k| to_unit(mix(seed.wrapping_mul(3).wrapping_add(k as u32)))))
    }

    fn random_splat(seed: u32) -> Splat {
        let turn = random(seed + 1000) - 0.5;
        Splat {
            center: random(seed),
            rotation: Quat::from_xyzw(turn.x, turn.y, turn.z, 0.3),
            scale: (random(seed + 2000) * 3.0 - 4.0).map(f32::exp),
            opacity: 0.05 + 0.95 * to_unit(mix(seed + 3000)),
        }
    }

    /// A coefficient of degree 0 that shows a linear colour.
    fn plain(linear: Vec3) -> Vec3 {
        let encoded = linear.map(|v| if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 });
        (encoded - 0.5) / 0.282_094_79
    }

    fn set(splats: &[(Splat, Vec3)]) -> Splats {
        let mut all = Splats::new(0);
        assert!(splats.iter().all(|(s, color)| all.push(s, &[plain(*color)])));
        all
    }

    /// Its white is 1 cd/m².
    fn scene(splats: Splats, others: impl IntoIterator<Item = (Shape, Material)>) -> Scene {
        let mut d = Description { splats: vec![splats.into()], ..Default::default() };
        let cloud = Shape::Splats { splats: 0, world_from_splats: Affine3A::IDENTITY };
        for (shape, material) in [(cloud, Material::captured("captured", 1.0))].into_iter().chain(others) {
            d.objects.push(Object::new("", shape, d.materials.len() as u32));
            d.materials.push(material);
        }
        Scene::build(d).unwrap()
    }

    fn round(z: f32, sigma: f32, opacity: f32) -> Splat {
        Splat { center: Vec3::Z * z, rotation: Quat::IDENTITY, scale: Vec3::splat(sigma), opacity }
    }

    /// Rays that differ in nothing but where on their line they begin, and so in their random numbers.
    fn along(start: Vec3, direction: Vec3, count: u32) -> impl Iterator<Item = Ray> {
        (0..count).map(move |i| Ray { origin: start - direction * (1.0 + to_unit(mix(i))), direction, time_s: 0.0 })
    }

    /// Mean linear sRGB (cd/m²) that rays see, and its standard error.
    fn seen(scene: &Scene, rays: impl Iterator<Item = Ray>) -> (Vec3, Vec3) {
        let (wavelengths, settings) = (Wavelengths::rgb(), PathSettings::default());
        let white = Spectrum::light_from_rgb(Vec3::ONE).sample(&wavelengths).truncate();
        let (mut sum, mut squares, mut n) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for (i, ray) in rays.enumerate() {
            let sampler = Sampler::new(SamplerKind::Independent, i as u64, (0, 0), 0, 1);
            let light: Sampled = scene.radiance(ray, &wavelengths, &sampler, &settings);
            let rgb = (light.truncate() / white).as_dvec3();
            (sum, squares, n) = (sum + rgb, squares + rgb * rgb, n + 1.0);
        }
        let mean: DVec3 = sum / n;
        let error = ((squares / n - mean * mean).max(DVec3::ZERO) / n).map(f64::sqrt);
        (mean.as_vec3(), error.as_vec3())
    }

    /// Within three standard errors, and what 16 bits and the table of spectra round.
    fn assert_seen((mean, error): (Vec3, Vec3), expected: Vec3, what: &str) {
        let allowed = 3.0 * error + 2e-3;
        assert!((mean - expected).abs().cmple(allowed).all(), "{what}: {mean} ± {error}, expected {expected}");
    }

    const COUNT: u32 = 20_000;

    #[test]
    fn a_ray_meets_a_gaussian_where_it_responds_most_with_the_closed_form_alpha() {
        let mut met = 0;
        for seed in 0..200 {
            let splat = random_splat(seed);
            let set = set(&[(splat, Vec3::ONE)]);
            let origin = random(seed + 50) * 8.0 - 4.0;
            let direction = splat.center + (random(seed + 70) - 0.5) * splat.scale.max_element() * 2.0 - origin;
            // In double precision by the inverse of the covariance, as the paper has it.
            let axes = DMat3::from_quat(splat.rotation.normalize().as_dquat());
            let variance = DMat3::from_diagonal((splat.scale * splat.scale).as_dvec3());
            let inverse = (axes * variance * axes.transpose()).inverse();
            let (o, d) = ((origin - splat.center).as_dvec3(), direction.as_dvec3());
            let t = -o.dot(inverse * d) / d.dot(inverse * d);
            let x = o + d * t;
            let alpha = (f64::from(splat.opacity) * (-0.5 * x.dot(inverse * x)).exp()).min(0.99);
            match set.intersect(0, origin, direction, f32::INFINITY) {
                Some(hit) => {
                    met += 1;
                    assert!((f64::from(hit.t) - t).abs() < 1e-4 * t.abs(), "{seed}: {} {t}", hit.t);
                    assert!((f64::from(hit.alpha) - alpha).abs() < 1e-3, "{seed}: {} {alpha}", hit.alpha);
                    assert!(set.intersect(0, origin, direction, hit.t * 0.999).is_none());
                    // Where it is met lies in its box.
                    let (p, b) = (origin + direction * hit.t, set.bounds());
                    let slack = Vec3::splat(1e-5);
                    assert!(p.cmpge(b.min - slack).all() && p.cmple(b.max + slack).all(), "{seed}: {p} {b:?}");
                }
                None => assert!(alpha < 1.01 / 255.0 || t <= 0.0, "{seed}: missed at {alpha}"),
            }
            assert!(set.intersect(0, origin, -direction, f32::INFINITY).is_none());
        }
        assert!(met > 120, "{met}");
    }

    #[test]
    fn the_box_of_a_turned_gaussian_is_as_small_as_it_can_be() {
        let splat = Splat { rotation: Quat::from_rotation_z(0.5), scale: Vec3::new(2.0, 0.5, 0.1), ..round(0.0, 1.0, 0.8) };
        let half = set(&[(splat, Vec3::ONE)]).bounds().size() * 0.5;
        let r = (2.0 * (0.8f32 * 255.0).ln()).sqrt();
        let (s, c) = 0.5f32.sin_cos();
        let expected = Vec3::new((2.0 * c).hypot(0.5 * s), (2.0 * s).hypot(0.5 * c), 0.1) * r;
        assert!((half / expected - 1.0).abs().max_element() < 1e-4, "{half} {expected}");
    }

    #[test]
    fn the_profile_of_one_gaussian_is_the_closed_form() {
        let scene = scene(set(&[(round(0.0, 0.5, 0.9), Vec3::ONE)]), []);
        for x in [0.0f32, 0.3, 0.6, 1.0, 1.5] {
            let expected = 0.9 * (-0.5 * (x / 0.5).powi(2)).exp();
            assert_seen(seen(&scene, along(Vec3::new(x, 0.0, -4.0), Vec3::Z, COUNT)), Vec3::splat(expected), &format!("at {x}"));
        }
        // Beyond 1/255 there is nothing.
        assert_eq!(seen(&scene, along(Vec3::new(1.7, 0.0, -4.0), Vec3::Z, 1000)).0, Vec3::ZERO);
        // α is at most 0.99.
        let dense = self::scene(set(&[(round(0.0, 0.5, 1.0), Vec3::ONE)]), []);
        let mean = seen(&dense, along(Vec3::NEG_Z * 4.0, Vec3::Z, COUNT)).0.x;
        assert!((mean - 0.99).abs() < 0.0025, "{mean}");
    }

    #[test]
    fn two_gaussians_composite_from_front_to_back_in_any_order_of_the_set() {
        let (red, green) = (Vec3::new(0.8, 0.1, 0.2), Vec3::new(0.2, 0.6, 0.1));
        let both = [(round(1.0, 0.5, 0.6), red), (round(2.0, 0.5, 0.7), green)];
        for splats in [both, [both[1], both[0]]] {
            let scene = scene(set(&splats), []);
            let front = red * 0.6 + green * (0.4 * 0.7);
            assert_seen(seen(&scene, along(Vec3::NEG_Z, Vec3::Z, COUNT)), front, "from the front");
            let back = green * 0.7 + red * (0.3 * 0.6);
            assert_seen(seen(&scene, along(Vec3::Z * 5.0, Vec3::NEG_Z, COUNT)), back, "from behind");
            // A shadow ray is stopped by either.
            let stopped = |to: f32| {
                let rays = along(Vec3::NEG_Z, Vec3::Z, COUNT);
                rays.filter(|r| scene.occluded(r, to - r.origin.z)).count() as f32 / COUNT as f32
            };
            // Three standard errors of a fraction.
            let error = 3.0 * (0.25 / COUNT as f32).sqrt();
            assert!(
                (stopped(9.0) - (1.0 - 0.4 * 0.3)).abs() < error && (stopped(1.5) - 0.6).abs() < error && stopped(0.9) == 0.0
            );
        }
    }

    #[test]
    fn gaussians_hide_meshes_and_are_hidden_by_them() {
        let color = Vec3::new(0.3, 0.5, 0.2);
        let lamp = |z: f32| {
            let corner = Vec3::new(-1.0, 1.0, z);
            let quad = Quad { corner, edges: [Vec3::X * 2.0, Vec3::NEG_Y * 2.0] };
            (Shape::Quad(quad), Material::lamp("lamp", Spectrum::light_from_rgb(Vec3::ONE)))
        };
        for (z, expected) in [(2.0, color * 0.6 + 0.4), (0.5, Vec3::ONE)] {
            let scene = scene(set(&[(round(1.0, 0.1, 0.6), color)]), [lamp(z)]);
            assert_seen(seen(&scene, along(Vec3::NEG_Z, Vec3::Z, COUNT)), expected, &format!("lamp at {z}"));
        }
    }

    #[test]
    fn a_placed_cloud_turns_with_its_colours() {
        // Bright to who looks along its +x, dark along −x: the third coefficient of degree 1 counts −x.
        let mut splats = Splats::new(1);
        let harmonics = [Vec3::ZERO, Vec3::ZERO, Vec3::ZERO, Vec3::splat(-0.6)];
        splats.push(&round(0.0, 0.2, 0.9), &harmonics);
        let along_x = splats.color(0, Vec3::X);
        let expected = srgb_decode(0.5 + 0.6 * 0.488_602_5);
        assert!((along_x - expected).abs().max_element() < 1e-3, "{along_x} {expected}");
        assert!(splats.color(0, Vec3::NEG_X).x < 0.1 * expected);
        let mut d =
            Description { splats: vec![splats.into()], materials: vec![Material::captured("", 1.0)], ..Default::default() };
        // Twice as large and turned so that its x is the world's z.
        let place = Affine3A::from_rotation_y(-std::f32::consts::FRAC_PI_2) * Affine3A::from_scale(Vec3::splat(2.0));
        d.objects.push(Object::new("", Shape::Splats { splats: 0, world_from_splats: place }, 0));
        let scene = Scene::build(d).unwrap();
        let alpha = 0.9 * (-0.5f32).exp();
        let rays = || along(Vec3::new(0.4, 0.0, -3.0), Vec3::Z, COUNT);
        assert_seen(seen(&scene, rays()), Vec3::splat(alpha * expected), "turned");
        let surface = rays().find_map(|r| Some((r, scene.intersect(&r, f32::INFINITY)?))).unwrap();
        assert!((surface.1.point.z).abs() < 1e-4 && surface.1.ng.dot(surface.0.direction) < 0.0);
    }

    struct All<'a>(&'a Splats, Vec3, Vec3);

    impl All<'_> {
        fn there(&self, id: u32, t_max: f32) -> Option<Hit> {
            let hit = self.0.intersect(id, self.1, self.2, t_max)?;
            let is_there = to_unit(mix(id ^ 0x55_1234)) < hit.alpha;
            is_there.then_some(Hit { t: hit.t, u: 0.0, v: 0.0, id, slot: 0, instance: 0 })
        }
    }

    impl Filter for All<'_> {
        fn accept(&self, _: u32, _: f32, _: f32) -> bool {
            true
        }
        fn intersect_other(&self, id: u32, t_max: f32, _: bool) -> Option<Hit> {
            self.there(id, t_max)
        }
    }

    #[test]
    fn the_hierarchy_finds_what_all_gaussians_one_by_one_have_nearest() {
        let splats: Vec<(Splat, Vec3)> = (0..800).map(|i| (random_splat(i * 7), Vec3::ONE)).collect();
        let set = set(&splats);
        let bvh = Bvh::build(&SplatBoxes(&set));
        let mut found = 0;
        for i in 0..300 {
            let origin = random(i ^ 0x5555) * 6.0 - 2.0;
            let all = All(&set, origin, random(i ^ 0x333) - origin);
            let one = (0..set.len() as u32).filter_map(|id| all.there(id, f32::INFINITY)).min_by(|a, b| a.t.total_cmp(&b.t));
            let fast = bvh.closest(all.1, all.2, f32::INFINITY, &all);
            assert_eq!(fast.map(|h| (h.id, h.t)), one.map(|h| (h.id, h.t)), "{i}");
            assert_eq!(bvh.any(all.1, all.2, f32::INFINITY, &all), one.is_some());
            found += u32::from(one.is_some());
        }
        assert!(found > 200, "{found}");
    }

    #[test]
    fn harmonics_are_orthonormal_and_signed_as_captures_have_them() {
        // Sums over a Fibonacci lattice of the sphere integrate polynomials of degree 6 to some parts in ten thousand.
        let n = 20_000;
        let mut products = [[0.0f64; 16]; 16];
        for k in 0..n {
            let z = 1.0 - (2.0 * k as f64 + 1.0) / n as f64;
            let angle = k as f64 * std::f64::consts::PI * (3.0 - 5f64.sqrt());
            let r = (1.0 - z * z).sqrt();
            let y = basis(DVec3::new(r * angle.cos(), r * angle.sin(), z).as_vec3());
            for (row, a) in products.iter_mut().zip(y) {
                row.iter_mut().zip(y).for_each(|(p, b)| *p += f64::from(a * b) * 4.0 * std::f64::consts::PI / f64::from(n));
            }
        }
        for (i, row) in products.iter().enumerate() {
            for (j, value) in row.iter().enumerate() {
                assert!((value - f64::from(u8::from(i == j))).abs() < 2e-3, "{i} {j}: {value}");
            }
        }
        let d = Vec3::new(0.6, 0.48, 0.64);
        let y = basis(d);
        // Signs of m = −l to l: those of the polynomials y, z, x; xy, yz, 2z²−x²−y², xz, x²−y²; ... times (−1)^m.
        let signs = [1, -1, 1, -1, 1, -1, 1, -1, 1, -1, 1, -1, -1, -1, 1, 1];
        assert!(y.iter().zip(signs).all(|(v, s)| v.signum() == s as f32), "{y:?}");
    }

    #[test]
    fn numbers_of_16_bits_are_the_nearest() {
        for (v, bits) in
            [(1.0, 0x3c00), (-2.0, 0xc000), (0.0, 0), (65504.0, 0x7bff), (1e9, 0x7bff), (6e-8, 1), (0.333_251_95, 0x3555)]
        {
            assert_eq!(half(v), bits, "{v}");
        }
        for i in 0..1000 {
            let v = (to_unit(mix(i)) - 0.5) * 8.0;
            assert!((from_half(half(v)) - v).abs() <= v.abs() / 2048.0 + 3e-8, "{v}");
        }
    }

    #[test]
    fn strays_do_not_frame_a_picture() {
        let mut all = Splats::new(0);
        for i in 0..1000 {
            let center = if i % 50 == 0 { (random(i) - 0.5) * 1e4 } else { random(i) };
            all.push(&Splat { center, ..round(0.0, 0.01, 0.5) }, &[Vec3::ZERO]);
        }
        let (core, whole) = (all.core_bounds(), all.bounds());
        assert!(
            core.min.cmpge(Vec3::ZERO).all() && core.max.cmple(Vec3::ONE).all() && core.size().min_element() > 0.8,
            "{core:?}"
        );
        assert!(whole.size().min_element() > 1000.0);
        let d = scene(all, []).description().clone();
        assert!(d.bounds_at(0.0, |_| true).size().max_element() < 1.1);
        let support = d.support_points(0.0, &[Vec3::X, Vec3::NEG_Y], |_| true);
        assert!((support[0].x - core.max.x).abs() < 1e-3 && (support[1].y - core.min.y).abs() < 1e-3);
    }

    #[test]
    fn ordered_in_space_they_are_the_same_and_neighbours_lie_together() {
        let mut all = Splats::new(1);
        for i in 0..2000 {
            all.push(&random_splat(i * 11), &[0, 1, 2, 3].map(|k| random(i * 5 + k)));
        }
        let of = |s: &Splats| -> Vec<(Vec3, Vec3, f32)> {
            (0..s.len()).map(|i| (s.ellipsoids[i].center, s.color(i as u32, Vec3::X), s.ellipsoids[i].opacity)).collect()
        };
        let steps = |s: &Splats| s.ellipsoids.windows(2).map(|w| (w[0].center - w[1].center).length()).sum::<f32>();
        let (mut before, far) = (of(&all), steps(&all));
        all.order_in_space();
        let mut after = of(&all);
        let key = |a: &(Vec3, Vec3, f32), b: &(Vec3, Vec3, f32)| a.0.x.total_cmp(&b.0.x).then(a.0.y.total_cmp(&b.0.y));
        before.sort_by(key);
        after.sort_by(key);
        assert_eq!(before, after);
        assert!(steps(&all) < 0.3 * far, "{} {far}", steps(&all));
        Splats::new(0).order_in_space();
    }

    #[test]
    fn gaussians_that_cannot_be_met_are_refused() {
        let good = round(1.0, 0.1, 0.5);
        let mut all = Splats::new(0);
        for bad in [
            Splat { center: Vec3::NAN, ..good },
            Splat { center: Vec3::new(0.0, f32::NAN, 0.0), ..good },
            Splat { rotation: Quat::from_array([0.0; 4]), ..good },
            Splat { scale: Vec3::ZERO, ..good },
            Splat { scale: Vec3::new(1.0, f32::INFINITY, 1.0), ..good },
            Splat { opacity: 1.0 / 256.0, ..good },
            Splat { opacity: f32::NAN, ..good },
        ] {
            assert!(!all.push(&bad, &[Vec3::ZERO]), "{bad:?}");
        }
        assert!(!all.push(&good, &[Vec3::NAN]) && all.is_empty());
        // A disc without thickness is one.
        assert!(all.push(&Splat { scale: Vec3::new(0.1, 0.1, 0.0), ..good }, &[Vec3::ZERO]));
        let hit = all.intersect(0, Vec3::new(0.05, 0.0, 0.0), Vec3::Z, 9.0).unwrap();
        assert!((hit.t - 1.0).abs() < 1e-5 && (hit.alpha - 0.5 * (-0.125f32).exp()).abs() < 1e-4, "{hit:?}");
    }

    #[test]
    fn captured_places_light_what_is_around_them() {
        // A black floor in between shows nothing; a grey one shows light that paths find by chance.
        let floor = Quad { corner: Vec3::new(-1.0, 0.0, 1.0), edges: [Vec3::X * 2.0, Vec3::NEG_Z * 2.0] };
        let grey = crate::material::Scattering::Diffuse(crate::texture::Color::rgb(0.5, 0.5, 0.5));
        // So wide that it stands for a half space of luminance 0.99 above the floor.
        let cloud = Splat { center: Vec3::Y, rotation: Quat::IDENTITY, scale: Vec3::new(1e4, 1e-3, 1e4), opacity: 1.0 };
        let scene = scene(set(&[(cloud, Vec3::ONE)]), [(Shape::Quad(floor), Material::new("floor", grey))]);
        let rays = (0..4000).map(|i| Ray {
            origin: Vec3::new(0.2, 0.4 + 0.2 * to_unit(mix(i)), 0.0),
            direction: Vec3::NEG_Y,
            time_s: 0.0,
        });
        let (mean, error) = seen(&scene, rays);
        let light = mean.dot(SRGB_LUMINANCE);
        assert!((light - 0.5 * 0.99).abs() < 3.0 * error.x + 2e-3, "{light} ± {}", error.x);
    }
}
