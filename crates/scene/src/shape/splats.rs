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
#[non_exhaustive]
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
    /// A set without Gaussians, whose colours have harmonics up to a degree, [`MOST_DEGREE`] at most.
    pub fn new(degree: u32) -> Self {
        let degree = degree.min(MOST_DEGREE);
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
    /// never above [`LEAST_ALPHA`]; nor with another number of coefficients. Gives whether it was added.
    pub fn push(&mut self, splat: &Splat, harmonics: &[Vec3]) -> bool {
        if harmonics.len() != self.coefficients() {
            return false;
        }
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

    /// Adds all of another set, unless its harmonics are of another degree. Gives whether they were added.
    pub fn append(&mut self, other: Splats) -> bool {
        if self.degree != other.degree {
            return false;
        }
        self.ellipsoids.extend(other.ellipsoids);
        self.harmonics.extend(other.harmonics);
        self.core = OnceLock::new();
        true
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

    /// One of them, as it is held: opacity at most 1, scales (m) at least 1e-5 of the largest. Panics on a number that is none's.
    pub fn splat(&self, number: usize) -> Splat {
        let Ellipsoid { center, opacity, rows, .. } = self.ellipsoids[number];
        let mut axes = Mat3::from_cols(rows[0].normalize(), rows[1].normalize(), rows[2].normalize());
        if axes.determinant() < 0.0 {
            axes.z_axis = -axes.z_axis;
        }
        let scale = Vec3::from_array(rows.map(|row| row.length().recip()));
        Splat { center, rotation: Quat::from_mat3(&axes).normalize(), scale, opacity }
    }

    /// A coefficient of the harmonics of one of them: red, green, blue. Panics where there is no such splat or coefficient.
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

    /// The box around all of them, m, strays included.
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

    /// Where a ray meets one of them with 0 < t < `t_max` (in lengths of the direction), and how likely it is there.
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
mod tests;
