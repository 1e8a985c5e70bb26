//! What of a medium differs from place to place: factors on its coefficients, on grids or by formula, and what shines in it.
//!
//! A volume lies in a space of its own, within a box; outside there is nothing. The box is divided into cells, for each of which the least and the
//! greatest factors are known: rays step from cell to cell, and what they meet is bounded by those (majorant grid, PBR 4ed §11.4.4).
//!
//! Sources: M. Pharr, W. Jakob, G. Humphreys, "Physically Based Rendering" 4th ed., §11.4 (grids, colours, the cloud); pbrt-v4's behaviour where
//! the book is silent (black bodies by temperature).

use super::blend::{NOTHING, ROUNDING, joined, trilinear};
use super::sparse::SparseGrid;
use crate::bvh::Bounds;
use crate::exact::{Exact, Sink, Source, exact_struct, field};
use crate::motion::Parts;
use crate::noise::noise;
use diopter_light::color::srgb_of_light;
use diopter_light::spectrum::blackbody;
use diopter_light::upsample::Sigmoid;
use diopter_light::{SampledSpectrum, SampledWavelengths, Spectrum};
use glam::{Affine3A, IVec3, Vec3};
use rayon::prelude::*;
use serde_json::Value;
use std::ops::{Add, Mul};
use std::sync::{Arc, OnceLock};

/// What of a medium differs from place to place. Copies share their data.
#[derive(Clone, Debug)]
pub struct Volume {
    /// Where its space is.
    pub place: VolumePlace,
    content: Arc<Content>,
}

#[derive(Debug)]
struct Content {
    field: Field,
    glow: Option<Glow>,
    bounds: Bounds,
    cells: Cells,
}

/// Where the space of a volume is in the world.
#[derive(Clone, Debug)]
pub struct VolumePlace {
    world_from_own: Affine3A,
    own_from_world: Affine3A,
    motion: Option<Box<InstanceMotion>>,
}

/// A motion from one place to another: straight, and turning evenly.
#[derive(Clone, Debug)]
struct InstanceMotion {
    world_from_parent: Affine3A,
    times_s: [f64; 2],
    keys: [Parts; 2],
}

/// Numbers in space that are not negative.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Scalars {
    /// On a regular grid.
    Grid(Grid<f32>),
    /// On a grid of which most is empty.
    Sparse(SparseGrid),
}

/// The factors on the coefficients of a medium: on absorption and on scattering.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Field {
    /// The same number on both.
    Density(Scalars),
    /// A procedural cloud.
    Cloud(Cloud),
    /// Spectra for each; 1 where there are none.
    Colors {
        /// Factors on absorption.
        absorption: Option<Grid<Tint>>,
        /// Factors on scattering.
        scattering: Option<Grid<Tint>>,
    },
}

/// Where a volume shines: radiance of an endless depth of it. Absorption times this is emitted a metre.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Glow {
    /// The medium's own emission everywhere, or times a factor.
    Scaled(Option<Grid<f32>>),
    /// Colours of light, cd/m² of linear sRGB, times a factor.
    Colors(Grid<Tint>, f32),
    /// A black body of a temperature.
    BlackBody {
        /// Temperature before `offset` and `factor`.
        temperature: Scalars,
        /// Subtracted first.
        offset: f32,
        /// Kelvin = (temperature − offset) × factor; nothing shines up to 100 K.
        factor: f32,
        /// Spectral radiance at the wavelength where the body is brightest, W·m⁻²·sr⁻¹·nm⁻¹, whatever its temperature (as pbrt does).
        peak_radiance: f32,
    },
}

/// Values at the middles of the cells of a regular grid over a box, x first; between them trilinear, 0 outside.
#[derive(Clone, Debug)]
pub struct Grid<T> {
    size: [usize; 3],
    values: Vec<T>,
    min: Vec3,
    cells_per_m: Vec3,
}

/// A spectrum of any size that was given as a colour: a scaled sigmoid (PBR 4ed §4.6.6).
#[derive(Clone, Copy, Debug)]
pub struct Tint {
    scale: f32,
    sigmoid: Sigmoid,
}

/// A cloud made of noise: PBR 4ed §11.4.6. Denser below, in y of its own space.
#[derive(Clone, Copy, Debug)]
pub struct Cloud {
    /// How much of the noise is cloud.
    pub density: f32,
    /// How much its edges are torn.
    pub wispiness: f32,
    /// Lumps a unit of length.
    pub frequency: f32,
}

/// The least and the greatest factors in a cell, at any wavelength.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    pub absorption: [f32; 2],
    pub scattering: [f32; 2],
}

#[derive(Debug)]
struct Cells {
    size: [usize; 3],
    limits: Vec<Limits>,
}

/// Values of a grid for each cell of limits along an axis.
const VALUES_A_CELL: usize = 4;
/// Most cells of limits along an axis.
const MOST_CELLS: usize = 64;
/// Temperature up to which nothing shines, K, as in pbrt-v4.
const COLDEST_K: f32 = 100.0;

impl VolumePlace {
    /// One that stands still; `None` if the transform cannot be inverted.
    pub fn still(world_from_own: Affine3A) -> Option<Self> {
        let own_from_world = world_from_own.inverse();
        let usable = world_from_own.is_finite() && own_from_world.is_finite();
        usable.then_some(VolumePlace { world_from_own, own_from_world, motion: None })
    }

    /// One that moves between two moments (s of the scene), and stands still before and after; `None` if the second is not later, or a scale is 0, not finite, or changes
    /// its sign.
    pub fn moving(times_s: [f64; 2], keys: [Parts; 2]) -> Option<Self> {
        let motion = InstanceMotion { world_from_parent: Affine3A::IDENTITY, times_s, keys };
        let usable = keys.iter().all(|k| k.scale.abs().min_element() > 0.0 && k.scale.is_finite()) && times_s[0] < times_s[1];
        let start = usable.then(|| VolumePlace::still(motion.at(times_s[0]))).flatten()?;
        // Scales that change their sign pass 0.
        let turns = keys[0].scale * keys[1].scale;
        (turns.min_element() > 0.0).then(|| VolumePlace { motion: Some(Box::new(motion)), ..start })
    }

    /// The same with its surroundings placed elsewhere.
    pub fn placed(&self, outer: Affine3A) -> Self {
        let world_from_own = outer * self.world_from_own;
        let motion = self
            .motion
            .as_ref()
            .map(|w| Box::new(InstanceMotion { world_from_parent: outer * w.world_from_parent, ..(**w).clone() }));
        VolumePlace { world_from_own, own_from_world: world_from_own.inverse(), motion }
    }

    /// Its space from the world at a moment, s.
    #[inline]
    pub fn own_from_world(&self, time_s: f64) -> Affine3A {
        match &self.motion {
            None => self.own_from_world,
            Some(motion) => motion.at(time_s).inverse(),
        }
    }
}

impl InstanceMotion {
    fn at(&self, time_s: f64) -> Affine3A {
        let [from, to] = self.times_s;
        let t = ((time_s - from) / (to - from)).clamp(0.0, 1.0) as f32;
        let [a, b] = &self.keys;
        let (scale, rotation) = (a.scale.lerp(b.scale, t), a.rotation.slerp(b.rotation, t));
        self.world_from_parent * Affine3A::from_scale_rotation_translation(scale, rotation, a.translation.lerp(b.translation, t))
    }
}

impl<T> Grid<T> {
    /// A grid over a box: `[z][y][x]`, x fastest, as many along x, y and z as `size` says; `None` where the values are not as many as that.
    pub fn new(size: [usize; 3], values: Vec<T>, bounds: &Bounds) -> Option<Self> {
        if size.iter().try_fold(1usize, |n, side| n.checked_mul(*side)) != Some(values.len()) {
            return None;
        }
        let count = Vec3::new(size[0] as f32, size[1] as f32, size[2] as f32);
        Some(Grid { size, values, min: bounds.min, cells_per_m: count / bounds.size() })
    }

    fn value(&self, at: IVec3) -> Option<&T> {
        let [nx, ny, nz] = self.size;
        let [x, y, z] = [at.x, at.y, at.z].map(|v| v as usize);
        // Negative numbers become large ones.
        (x < nx && y < ny && z < nz).then(|| &self.values[(z * ny + y) * nx + x])
    }

    /// The mean of the eight values around a place, by distance.
    #[inline]
    fn blend<V: Add<Output = V> + Mul<f32, Output = V>>(&self, p: Vec3, zero: V, of: impl Fn(&T) -> V) -> V {
        let g = (p - self.min) * self.cells_per_m - 0.5;
        let base = g.floor();
        trilinear(base.as_ivec3(), g - base, zero, |at| self.value(at).map(&of))
    }

    /// The least and the greatest value that [`Grid::blend`] can give in a box.
    fn limits(&self, cell: &Bounds, of: impl Fn(&T) -> [f32; 2]) -> [f32; 2] {
        let node = |p: Vec3, off: f32| ((p - self.min) * self.cells_per_m - 0.5 + off).floor().as_ivec3();
        let (low, high) = (node(cell.min, -ROUNDING), node(cell.max, ROUNDING) + 1);
        let last = IVec3::from_array(self.size.map(|n| n as i32 - 1));
        let (inner_low, inner_high) = (low.max(IVec3::ZERO), high.min(last));
        let mut limits = if low == inner_low && high == inner_high { NOTHING } else { [0.0; 2] };
        for z in inner_low.z..=inner_high.z {
            for y in inner_low.y..=inner_high.y {
                for x in inner_low.x..=inner_high.x {
                    if let Some(v) = self.value(IVec3::new(x, y, z)) {
                        limits = joined(limits, of(v));
                    }
                }
            }
        }
        limits
    }
}

impl Scalars {
    #[inline]
    fn at(&self, p: Vec3) -> f32 {
        match self {
            Scalars::Grid(grid) => grid.blend(p, 0.0, |v| *v),
            Scalars::Sparse(grid) => grid.at(p),
        }
    }

    fn limits(&self, cell: &Bounds) -> [f32; 2] {
        match self {
            Scalars::Grid(grid) => grid.limits(cell, |v| [*v; 2]),
            Scalars::Sparse(grid) => grid.limits(cell),
        }
    }

    /// Values along the axes of a box.
    fn resolution(&self, bounds: &Bounds) -> [usize; 3] {
        match self {
            Scalars::Grid(grid) => grid.size,
            Scalars::Sparse(grid) => grid.resolution(bounds),
        }
    }
}

impl Tint {
    /// The spectrum of a linear sRGB colour without upper bound; negative parts are 0.
    pub fn from_rgb(rgb: Vec3) -> Self {
        let rgb = rgb.max(Vec3::ZERO);
        let scale = 2.0 * rgb.max_element();
        match scale > 0.0 {
            true => Tint { scale, sigmoid: Sigmoid::from_rgb(rgb / scale) },
            false => Tint { scale: 0.0, sigmoid: Sigmoid::from_rgb(Vec3::ZERO) },
        }
    }

    #[inline]
    fn sample(&self, wavelengths: &SampledWavelengths) -> SampledSpectrum {
        self.sigmoid.sample(wavelengths) * self.scale
    }

    /// The least and the greatest value over the carried wavelengths and the three colours.
    fn limits(&self) -> [f32; 2] {
        let c = self.sigmoid.c;
        // S is monotonic: its extremes are those of the parabola, at the ends of 380 to 780 nm or at the vertex.
        let vertex = (-0.5 * c.y / c.x).clamp(-1.0, 1.0);
        let vertex = if vertex.is_finite() { vertex } else { 0.0 };
        let all = [-1.0, vertex, 1.0].map(|x: f32| self.sigmoid.at(580.0 + 200.0 * x));
        let rgb = self.sigmoid.rgb.to_array();
        let limits = all.into_iter().chain(rgb).fold(NOTHING, |l, v| joined(l, [v; 2]));
        // A little wider, for rounding.
        [limits[0] * 0.9999 * self.scale, limits[1] * 1.0001 * self.scale]
    }
}

impl Cloud {
    /// Density at a place of its space, 0 to 1.
    fn at(&self, p: Vec3) -> f32 {
        let mut q = p * self.frequency;
        if self.wispiness > 0.0 {
            let (mut strength, mut scale) = (0.05 * self.wispiness, 10.0);
            for _ in 0..2 {
                q += strength * noise_gradient(q * scale);
                strength *= 0.5;
                scale *= 1.99;
            }
        }
        let (mut sum, mut strength, mut scale) = (0.0, 0.5, 1.0);
        for _ in 0..5 {
            sum += strength * noise(q * scale);
            strength *= 0.5;
            scale *= 1.99;
        }
        self.by_height(p.y, sum)
    }

    /// Density by the height and the sum of the octaves, to which it need not rise evenly: above 1 it falls.
    fn by_height(&self, y: f32, noise: f32) -> f32 {
        let lumps = ((1.0 - y) * 4.5 * self.density * noise).clamp(0.0, 1.0);
        (lumps + 2.0 * (0.5 - y).max(0.0)).clamp(0.0, 1.0)
    }

    fn limits(&self, cell: &Bounds) -> [f32; 2] {
        // Perlin's noise stays below 1.04 (the octaves add up to 0.97 of it); both parts of the density are linear in y between 0.5's kink.
        const MOST: f32 = 1.1;
        let heights = [cell.min.y, cell.max.y, 0.5f32.clamp(cell.min.y, cell.max.y)];
        let lumps = heights.iter().map(|y| ((1.0 - y).abs() * 4.5 * self.density.abs() * MOST).min(1.0)).fold(0.0, f32::max);
        let base = heights.map(|y| 2.0 * (0.5 - y).max(0.0));
        let [least, most] = base.into_iter().fold(NOTHING, |l, v| joined(l, [v; 2]));
        [(least - 1e-4).clamp(0.0, 1.0), (most + lumps + 1e-4).clamp(0.0, 1.0)]
    }
}

/// Differences of noise along the axes, as pbrt takes them.
fn noise_gradient(p: Vec3) -> Vec3 {
    const STEP: f32 = 0.01;
    let here = noise(p);
    Vec3::from_array([Vec3::X, Vec3::Y, Vec3::Z].map(|axis| (noise(p + axis * STEP) - here) / STEP))
}

impl Field {
    fn limits(&self, cell: &Bounds) -> Limits {
        match self {
            Field::Density(scalars) => {
                let limits = scalars.limits(cell);
                Limits { absorption: limits, scattering: limits }
            }
            Field::Cloud(cloud) => {
                let limits = cloud.limits(cell);
                Limits { absorption: limits, scattering: limits }
            }
            Field::Colors { absorption, scattering } => {
                let of = |g: &Option<Grid<Tint>>| g.as_ref().map_or([1.0; 2], |g| g.limits(cell, Tint::limits));
                Limits { absorption: of(absorption), scattering: of(scattering) }
            }
        }
    }

    fn resolution(&self, bounds: &Bounds) -> [usize; 3] {
        match self {
            Field::Density(scalars) => scalars.resolution(bounds),
            // Only heights tell its cells apart.
            Field::Cloud(_) => [1, VALUES_A_CELL * 32, 1],
            Field::Colors { absorption, scattering } => absorption.as_ref().or(scattering.as_ref()).map_or([1; 3], |g| g.size),
        }
    }
}

impl Volume {
    /// Looks through a field over a box of its own space. The box must have a volume, values of grids must be finite and not negative.
    pub fn new(place: VolumePlace, bounds: Bounds, field: Field, glow: Option<Glow>) -> Self {
        let size = field.resolution(&bounds).map(|n| n.div_ceil(VALUES_A_CELL).clamp(1, MOST_CELLS));
        let step = bounds.size() / Vec3::new(size[0] as f32, size[1] as f32, size[2] as f32);
        let limits = (0..size[0] * size[1] * size[2])
            .into_par_iter()
            .map(|i| {
                let low = Vec3::new((i % size[0]) as f32, (i / size[0] % size[1]) as f32, (i / size[0] / size[1]) as f32);
                field.limits(&Bounds { min: bounds.min + low * step, max: bounds.min + (low + 1.0) * step })
            })
            .collect();
        Volume { place, content: Arc::new(Content { field, glow, bounds, cells: Cells { size, limits } }) }
    }

    /// The same with its surroundings placed elsewhere.
    pub fn placed(&self, outer: Affine3A) -> Self {
        Volume { place: self.place.placed(outer), content: self.content.clone() }
    }

    /// The box that holds it, in its own space.
    pub fn bounds(&self) -> &Bounds {
        &self.content.bounds
    }

    /// Whether it shines.
    pub(super) fn shines(&self) -> bool {
        self.content.glow.is_some()
    }

    /// How many cells of limits lie along each axis.
    pub(super) fn cells(&self) -> [usize; 3] {
        self.content.cells.size
    }

    /// The limits in a cell.
    #[inline]
    pub(super) fn limits(&self, cell: [usize; 3]) -> &Limits {
        let Cells { size, limits } = &self.content.cells;
        &limits[(cell[2] * size[1] + cell[1]) * size[0] + cell[0]]
    }

    /// Factors on absorption and scattering at a place of its space.
    #[inline]
    pub(crate) fn factors(&self, p: Vec3, wavelengths: &SampledWavelengths) -> [SampledSpectrum; 2] {
        match &self.content.field {
            Field::Density(scalars) => [SampledSpectrum::splat(scalars.at(p)); 2],
            Field::Cloud(cloud) => [SampledSpectrum::splat(cloud.at(p)); 2],
            Field::Colors { absorption, scattering } => [absorption, scattering].map(|g| match g {
                None => SampledSpectrum::ONE,
                Some(grid) => grid.blend(p, SampledSpectrum::ZERO, |t| t.sample(wavelengths)),
            }),
        }
    }

    /// Radiance of an endless depth of what is at a place of its space, W·m⁻²·sr⁻¹·nm⁻¹; `own`: the medium's own emission.
    pub(super) fn radiance(&self, p: Vec3, wavelengths: &SampledWavelengths, own: Option<&Spectrum>) -> SampledSpectrum {
        match &self.content.glow {
            None => SampledSpectrum::ZERO,
            Some(Glow::Scaled(factor)) => {
                let radiance = own.map_or(SampledSpectrum::ZERO, |s| s.sample_light(wavelengths));
                factor.as_ref().map_or(radiance, |grid| radiance * grid.blend(p, 0.0, |v| *v))
            }
            Some(Glow::Colors(grid, factor)) => {
                let color = grid.blend(p, SampledSpectrum::ZERO, |t| t.sample(wavelengths));
                color * wavelengths.d65_one_nit() * *factor
            }
            Some(Glow::BlackBody { temperature, offset, factor, peak_radiance }) => {
                let kelvin = (temperature.at(p) - offset) * factor;
                if !(kelvin > COLDEST_K) { SampledSpectrum::ZERO } else { black_body(kelvin, wavelengths) * *peak_radiance }
            }
        }
    }
}

/// Wien's displacement constant, nm K. Source: CODATA 2018.
const WIEN_NM_K: f32 = 2.897_771_9e6;

/// A black body's radiance over that at its brightest wavelength; of colours its linear sRGB.
fn black_body(kelvin: f32, wavelengths: &SampledWavelengths) -> SampledSpectrum {
    if wavelengths.is_rgb() {
        return SampledWavelengths::lanes(black_body_rgb(kelvin));
    }
    let peak = 1.0 / blackbody(WIEN_NM_K / kelvin, kelvin);
    SampledSpectrum::from_array(wavelengths.nm.to_array().map(|nm| blackbody(nm, kelvin) * peak))
}

/// Linear sRGB of the same, from a table over the reciprocal temperature, by which the logarithm of Wien's approximation is linear.
fn black_body_rgb(kelvin: f32) -> Vec3 {
    const STEPS: usize = 2048;
    const HOTTEST_K: f32 = 50_000.0;
    static TABLE: OnceLock<Vec<Vec3>> = OnceLock::new();
    let table = TABLE.get_or_init(|| {
        let coldest = 1.0 / COLDEST_K;
        (0..=STEPS)
            .map(|i| {
                let kelvin = 1.0 / (1.0 / HOTTEST_K + (coldest - 1.0 / HOTTEST_K) * (i as f32 / STEPS as f32).powi(2));
                let peak = 1.0 / blackbody(WIEN_NM_K / kelvin, kelvin);
                srgb_of_light(|nm| blackbody(nm, kelvin) * peak)
            })
            .collect()
    });
    let (hot, cold) = (1.0 / HOTTEST_K, 1.0 / COLDEST_K);
    // Steps are finer where bodies are hot: half of them lie above 400 K.
    let x = ((1.0 / kelvin - hot) / (cold - hot)).clamp(0.0, 1.0).sqrt() * STEPS as f32;
    let i = (x as usize).min(STEPS - 1);
    table[i].lerp(table[i + 1], x - i as f32)
}

exact_struct!(InstanceMotion { world_from_parent, times_s, keys });
exact_struct!(Tint { scale, sigmoid });

impl Exact for VolumePlace {
    fn write(&self, sink: &mut Sink) -> Value {
        let object = [("world_from_own", self.world_from_own.write(sink)), ("way", self.motion.write(sink))];
        object.into_iter().map(|(k, v)| (k.to_owned(), v)).collect()
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        let place =
            VolumePlace::still(field(value, "world_from_own", source)?).ok_or("a volume in a place that cannot be inverted")?;
        Ok(VolumePlace { motion: field(value, "way", source)?, ..place })
    }
}

impl<T: Flat> Exact for Grid<T> {
    fn write(&self, sink: &mut Sink) -> Value {
        let object = [
            ("size", self.size.write(sink)),
            ("values", T::flat(&self.values).write(sink)),
            ("min", self.min.write(sink)),
            ("cells_per_m", self.cells_per_m.write(sink)),
        ];
        object.into_iter().map(|(k, v)| (k.to_owned(), v)).collect()
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        let size: [usize; 3] = field(value, "size", source)?;
        let values = T::of_flat(field(value, "values", source)?);
        let count = size[0].checked_mul(size[1]).and_then(|n| n.checked_mul(size[2]));
        if count != Some(values.len()) || values.is_empty() || !values.iter().all(T::is_valid) {
            return Err(format!("{} values for a grid of {size:?}, or some of them negative", values.len()));
        }
        Ok(Grid { size, values, min: field(value, "min", source)?, cells_per_m: field(value, "cells_per_m", source)? })
    }
}

/// What grids hold, as numbers.
trait Flat: Sized {
    fn flat(values: &[Self]) -> Vec<f32>;
    fn of_flat(numbers: Vec<f32>) -> Vec<Self>;
    fn is_valid(&self) -> bool;
}

impl Flat for f32 {
    fn flat(values: &[f32]) -> Vec<f32> {
        values.to_vec()
    }

    fn of_flat(numbers: Vec<f32>) -> Vec<f32> {
        numbers
    }

    fn is_valid(&self) -> bool {
        *self >= 0.0 && self.is_finite()
    }
}

impl Flat for Tint {
    fn flat(values: &[Tint]) -> Vec<f32> {
        let numbers =
            |t: &Tint| [t.scale, t.sigmoid.c.x, t.sigmoid.c.y, t.sigmoid.c.z, t.sigmoid.rgb.x, t.sigmoid.rgb.y, t.sigmoid.rgb.z];
        values.iter().flat_map(numbers).collect()
    }

    fn of_flat(numbers: Vec<f32>) -> Vec<Tint> {
        let tint = |n: &[f32; 7]| Tint {
            scale: n[0],
            sigmoid: Sigmoid { c: Vec3::new(n[1], n[2], n[3]), rgb: Vec3::new(n[4], n[5], n[6]) },
        };
        numbers.as_chunks().0.iter().map(tint).collect()
    }

    fn is_valid(&self) -> bool {
        self.scale >= 0.0 && self.scale.is_finite()
    }
}

impl Exact for Volume {
    fn write(&self, sink: &mut Sink) -> Value {
        let content = &self.content;
        let object = [
            ("place", self.place.write(sink)),
            ("bounds", content.bounds.write(sink)),
            ("field", content.field.write(sink)),
            ("glow", content.glow.write(sink)),
        ];
        object.into_iter().map(|(k, v)| (k.to_owned(), v)).collect()
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        let bounds: Bounds = field(value, "bounds", source)?;
        if !(bounds.size().min_element() > 0.0 && bounds.size().is_finite()) {
            return Err("a volume without a size".into());
        }
        let (place, content) = (field(value, "place", source)?, field(value, "field", source)?);
        Ok(Volume::new(place, bounds, content, field(value, "glow", source)?))
    }
}

#[cfg(test)]
mod tests;
