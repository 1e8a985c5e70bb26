//! Veiling glare in the picture: what becomes of the light of its own points.
//!
//! The glare spread function of the lens ([`diopter_lens::glare::GlareSpread`], traced once for the lens as it is set) is applied to the mean of the exposure, apart
//! from it, and light is moved, not made: what scatter takes from a point is missing there. Scatter near a point is a convolution in cells twice as large for twice the
//! distance, round and of the same shape over the field, its strength by field; what goes farther, and what surfaces reflect, is looked up between
//! fields on a coarse grid. Every step is linear in the picture, so parts of the samples merge to the whole.
//!
//! Limits: kernels are those of distant points at three wavelengths, weighted by what a band sees of an even spectrum; detail below 1/512 of the
//! picture's width is not drawn; things beyond the frame scatter into it only if they are lamps.

use crate::camera::Film;
use crate::expose::response::Response;
use diopter_image::Raster;
use diopter_lens::System;
use diopter_lens::ghosts::SENSOR_REFLECTANCE;
use diopter_lens::glare::{BINS_NM, GlareSpread, Kind, Unfit};
use diopter_light::wavelength::{FIRST_NM, LAST_NM};
use glam::DVec2;
use rayon::prelude::*;

/// Most columns of the raster that glare is drawn in.
const COLUMNS: usize = 512;
/// Columns of the grid for what goes far.
const COARSE: usize = 36;
/// Points of the image, from the axis to the corner, and rays over the front for each and each wavelength.
pub(super) const FIELDS: usize = 7;
/// See [`FIELDS`].
pub(super) const RAYS: usize = 1280;
/// Cells of a kernel of what goes far, from the axis to the corner.
const KERNEL: usize = 20;
/// What is nearer than this part of the corner's distance is a convolution; from half of it on, less and less.
const NEAR: f64 = 0.25;
/// Distance in cells up to which the finest convolution goes; each next twice as far.
const TAPS: f64 = 4.0;

/// Three numbers a band: what part of it each wavelength of [`BINS_NM`] stands for.
pub(super) fn parts_of_bands(response: &Response) -> Vec<[f64; 3]> {
    let parts = |curve: &diopter_light::spectrum::Table| {
        let mut sums = [0.0; 3];
        for k in 0..((LAST_NM - FIRST_NM) / 5.0) as usize {
            let nm = FIRST_NM + 5.0 * (k as f32 + 0.5);
            sums[bin_of(f64::from(nm))] += f64::from(curve.at(nm)).max(0.0);
        }
        let all: f64 = sums.iter().sum();
        if all > 0.0 { sums.map(|s| s / all) } else { [1.0 / 3.0; 3] }
    };
    response.curves.iter().map(parts).collect()
}

/// The wavelength that stands for one.
pub(super) fn bin_of(nm: f64) -> usize {
    let off = |k: &usize| (BINS_NM[*k] - nm).abs();
    (0..3).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(0)
}

/// Places of a raster over the film: film points, mm from the axis.
#[derive(Clone, Copy, Debug)]
struct Grid {
    columns: usize,
    rows: usize,
    size: DVec2,
    middle: DVec2,
}

impl Grid {
    fn over(film: &Film, columns: usize) -> Grid {
        let columns = columns.clamp(1, film.columns.max(1));
        let rows = (columns * film.rows).div_ceil(film.columns.max(1)).max(1);
        Grid { columns, rows, size: DVec2::new(film.width_mm, film.height_mm), middle: DVec2::from_array(film.center_mm) }
    }

    fn cell(&self) -> DVec2 {
        self.size / DVec2::new(self.columns as f64, self.rows as f64)
    }

    /// The picture stands upside down on the film.
    fn point(&self, column: f64, row: f64) -> DVec2 {
        let (x, y) = (0.5 - column / self.columns as f64, row / self.rows as f64 - 0.5);
        DVec2::new(x, y) * self.size - self.middle
    }

    /// Where a film point lies, in cells.
    fn place(&self, at: DVec2) -> DVec2 {
        let at = (at + self.middle) / self.size;
        DVec2::new((0.5 - at.x) * self.columns as f64, (0.5 + at.y) * self.rows as f64)
    }
}

/// Glare of a kind that goes far, for light of one field: per mm², `[v][|u|][band]`, u across and v along the way from the axis to the image.
type Far = Vec<f32>;

/// A convolution over cells of one size, `[row][column][band]`, of odd width.
#[derive(Clone, Debug)]
struct Level {
    width: usize,
    taps: Vec<f32>,
}

/// The glare of a lens on a film.
#[derive(Clone, Debug)]
pub(super) struct Veil {
    fine: Grid,
    coarse: Grid,
    bands: usize,
    reach: f64,
    /// Fraction that no surface scatters, by field and band.
    kept: Vec<Vec<f64>>,
    /// Fraction scattered near, by field and band; over their mean.
    strength: Vec<Vec<f64>>,
    levels: Vec<Level>,
    scatter: Vec<Far>,
    ghosts: Vec<Far>,
}

impl Veil {
    /// Of a lens as it is set. Fails where glare of the lens cannot be traced.
    pub(super) fn of(system: &System, film: &Film, response: &Response) -> Result<Veil, Unfit> {
        let reach = film.reach().length();
        let spread = GlareSpread::of(system, reach, SENSOR_REFLECTANCE, FIELDS, RAYS)?;
        let parts = parts_of_bands(response);
        let (bands, fields) = (parts.len(), spread.fields.len());
        let (fine, coarse) = (Grid::over(film, COLUMNS), Grid::over(film, COARSE));
        let near_mm = NEAR * reach;
        let cell = 0.5 * (fine.cell().x + fine.cell().y);
        let count = 1 + (near_mm / (2.0 * TAPS * cell)).log2().ceil().max(0.0) as usize;
        // What of light at a distance is a convolution.
        let near = |r: f64| {
            let t = ((r / near_mm - 0.5) / 0.5).clamp(0.0, 1.0);
            1.0 - t * t * (3.0 - 2.0 * t)
        };
        // Light by distance, from all fields, `[level][band]` in rings.
        const RINGS: usize = 48;
        let ring = |r: f64| {
            let low = 0.25 * cell;
            ((r / low).max(1.0).ln() / (near_mm / low).max(1.0 + 1e-9).ln() * RINGS as f64).min(RINGS as f64 - 1.0) as usize
        };
        let mut rings = vec![[0.0f64; 2]; RINGS * bands];
        let mut strength = vec![vec![0.0; bands]; fields];
        let mut kept = vec![vec![0.0; bands]; fields];
        let mut far: [Vec<Vec<f32>>; 2] = [Vec::new(), Vec::new()];
        let density = |k: f64| k / (reach / KERNEL as f64).powi(2);
        for (k, field) in spread.fields.iter().enumerate() {
            let mut tables = [0, 1].map(|_| vec![0.0f32; (KERNEL + 1) * (2 * KERNEL + 1) * bands]);
            for (band, parts) in parts.iter().enumerate() {
                kept[k][band] = (0..3).map(|bin| parts[bin] * field.kept[bin]).sum();
            }
            let image = DVec2::new(0.0, field.height_mm);
            for a in &field.arrivals {
                let r = a.at.distance(image);
                let close = if a.kind == Kind::Scatter { near(r) } else { 0.0 };
                for (band, parts) in parts.iter().enumerate() {
                    let light = parts[a.bin] * a.fraction;
                    strength[k][band] += light * close;
                    let ring = &mut rings[ring(r) * bands + band];
                    ring[0] += light * close;
                    ring[1] += light * close * r;
                    let table = &mut tables[usize::from(a.kind == Kind::Ghost)];
                    splat(table, a.at / reach * KERNEL as f64, density(light * (1.0 - close)) as f32, band, bands);
                }
            }
            let [scatter, ghosts] = tables;
            far[0].push(scatter);
            far[1].push(ghosts);
        }
        let mean: Vec<f64> = (0..bands).map(|b| strength.iter().map(|s| s[b]).sum::<f64>() / fields.max(1) as f64).collect();
        for of_field in &mut strength {
            of_field.iter_mut().zip(&mean).for_each(|(s, mean)| {
                if *mean > 0.0 {
                    *s /= mean
                }
            });
        }
        let levels = (0..count).map(|level| taps(level, count, cell, &rings, bands, fields.max(1))).collect();
        let [scatter, ghosts] = far;
        Ok(Veil { fine, coarse, bands, reach, kept, strength, levels, scatter, ghosts })
    }

    /// Fields around a distance from the axis, and how much of the second.
    fn between(&self, height: f64) -> ([usize; 2], f64) {
        let last = self.kept.len().saturating_sub(1);
        let at = (height / self.reach * (FIELDS - 1) as f64).clamp(0.0, last as f64);
        let k = (at as usize).min(last.saturating_sub(1));
        ([k, (k + 1).min(last)], at - k as f64)
    }

    /// Factor on the light of a pixel's own place, by band: what is not scattered. `at`: of the film in fractions of a width and height.
    pub(super) fn kept_at(&self, x: f64, y: f64, factors: &mut [f32]) {
        if self.kept.is_empty() {
            factors.fill(1.0);
            return;
        }
        let at = self.fine.point(x * self.fine.columns as f64, y * self.fine.rows as f64);
        let ([a, b], t) = self.between(at.length());
        for (band, f) in factors.iter_mut().enumerate() {
            *f = (self.kept[a][band] + (self.kept[b][band] - self.kept[a][band]) * t) as f32;
        }
    }

    /// Glare of a picture, in its unit, on the fine raster. `seen`: the picture on the same raster ([`seen`]); `lamps`: light of lamps in it (film point, mm; per
    /// band the picture's unit × mm²) whose reflections are drawn as ghosts and left out here.
    pub(super) fn light(&self, seen: &Raster<f32>, lamps: &[(DVec2, Vec<f64>)]) -> Raster<f32> {
        let bands = self.bands;
        let mut out = Raster::new(self.fine.columns, self.fine.rows, bands);
        if self.kept.is_empty() {
            return out;
        }
        // Near: strength by field first, then one shape for all.
        let mut source = seen.clone();
        source.data.par_chunks_mut(bands * self.fine.columns).enumerate().for_each(|(row, line)| {
            for (column, pixel) in line.chunks_exact_mut(bands).enumerate() {
                let ([a, b], t) = self.between(self.fine.point(column as f64 + 0.5, row as f64 + 0.5).length());
                for (band, v) in pixel.iter_mut().enumerate() {
                    *v *= (self.strength[a][band] + (self.strength[b][band] - self.strength[a][band]) * t) as f32;
                }
            }
        });
        for (number, level) in self.levels.iter().enumerate() {
            if number > 0 {
                source = halved(&source);
            }
            add_enlarged(&convolved(&source, level), &mut out, 1 << number);
        }
        // Far.
        let light = self.far_light(seen, lamps);
        let (width, rows) = (self.fine.columns, self.fine.rows);
        out.data.par_chunks_mut(bands * width).enumerate().for_each(|(row, line)| {
            for (column, pixel) in line.chunks_exact_mut(bands).enumerate() {
                add_bilinear(&light, [(column as f64 + 0.5) / width as f64, (row as f64 + 0.5) / rows as f64], pixel);
            }
        });
        out
    }

    /// What goes far and what is reflected, on the coarse grid.
    fn far_light(&self, seen: &Raster<f32>, lamps: &[(DVec2, Vec<f64>)]) -> Raster<f32> {
        let (grid, bands) = (self.coarse, self.bands);
        let area = self.fine.cell().x * self.fine.cell().y;
        // Light in each coarse cell, all of it and without lamps.
        let mut whole = vec![0.0f64; grid.columns * grid.rows * bands];
        for (i, pixel) in seen.data.chunks_exact(bands).enumerate() {
            let (column, row) = (i % seen.width, i / seen.width);
            let cell = (row * grid.rows / seen.height) * grid.columns + column * grid.columns / seen.width;
            pixel.iter().enumerate().for_each(|(band, v)| whole[cell * bands + band] += f64::from(*v) * area);
        }
        let mut dull = whole.clone();
        for (at, light) in lamps {
            let place = grid.place(*at);
            let column = (place.x.max(0.0) as usize).min(grid.columns - 1);
            let row = (place.y.max(0.0) as usize).min(grid.rows - 1);
            for (band, light) in light.iter().enumerate() {
                dull[(row * grid.columns + column) * bands + band] -= light;
            }
        }
        struct From {
            along: DVec2,
            fields: [usize; 2],
            t: f64,
        }
        let sources: Vec<From> = (0..grid.columns * grid.rows)
            .map(|i| {
                let at = grid.point((i % grid.columns) as f64 + 0.5, (i / grid.columns) as f64 + 0.5);
                let (fields, t) = self.between(at.length());
                From { along: at.normalize_or(DVec2::Y), fields, t }
            })
            .collect();
        let mut out = Raster::new(grid.columns, grid.rows, bands);
        out.data.par_chunks_mut(bands).enumerate().for_each(|(i, to)| {
            let at = grid.point((i % grid.columns) as f64 + 0.5, (i / grid.columns) as f64 + 0.5);
            let mut sums = vec![0.0f64; bands];
            for (j, from) in sources.iter().enumerate() {
                let local = DVec2::new(at.perp_dot(from.along), at.dot(from.along)) / self.reach * KERNEL as f64;
                let (corner, weights) = corners(local);
                for (field, part) in from.fields.into_iter().zip([1.0 - from.t, from.t]) {
                    if part == 0.0 {
                        continue;
                    }
                    for (tables, light) in [(&self.scatter, &whole), (&self.ghosts, &dull)] {
                        for (place, weight) in corner.iter().zip(weights) {
                            let Some(place) = place else { continue };
                            for (band, sum) in sums.iter_mut().enumerate() {
                                let k = f64::from(tables[field][place * bands + band]);
                                *sum += part * weight * k * light[j * bands + band];
                            }
                        }
                    }
                }
            }
            to.iter_mut().zip(&sums).for_each(|(to, sum)| *to = *sum as f32);
        });
        out
    }
}

/// Cells of a kernel's table around a place (in cells from the axis, u across and v along), and their weights; `None` beyond the table.
fn corners(local: DVec2) -> ([Option<usize>; 4], [f64; 4]) {
    let at = DVec2::new(local.x.abs(), local.y + KERNEL as f64);
    let (first, t) = (at.floor(), at - at.floor());
    let cell = |dx: usize, dy: usize| {
        let (x, y) = (first.x as i64 + dx as i64, first.y as i64 + dy as i64);
        let holds = (0..=KERNEL as i64).contains(&x) && (0..=2 * KERNEL as i64).contains(&y);
        holds.then_some(y as usize * (KERNEL + 1) + x as usize)
    };
    (
        [cell(0, 0), cell(1, 0), cell(0, 1), cell(1, 1)],
        [(1.0 - t.x) * (1.0 - t.y), t.x * (1.0 - t.y), (1.0 - t.x) * t.y, t.x * t.y],
    )
}

/// Distributes light over the nodes around a place of a kernel's table, two cells wide; both halves of the kernel are one.
fn splat(table: &mut [f32], local: DVec2, light: f32, band: usize, bands: usize) {
    let at = DVec2::new(local.x.abs(), local.y + KERNEL as f64);
    let first = at.floor();
    for dy in -1..=2i64 {
        for dx in -1..=2i64 {
            let (x, y) = (first.x as i64 + dx, first.y as i64 + dy);
            // A tent of two cells: its weights add up to 1 over the nodes.
            let weight = [x as f64 - at.x, y as f64 - at.y].map(|d| 0.5 * (1.0 - 0.5 * d.abs()).max(0.0));
            let x = x.unsigned_abs() as usize;
            if x > KERNEL || !(0..=2 * KERNEL as i64).contains(&y) {
                continue;
            }
            // A node beside the middle stands for two, that on it for one.
            let half = if x == 0 { 1.0 } else { 0.5 };
            table[(y as usize * (KERNEL + 1) + x) * bands + band] += light * (weight[0] * weight[1] * half) as f32;
        }
    }
}

/// The convolution of one level: rings of light about a point, those of a distance shared between two levels.
fn taps(level: usize, count: usize, cell: f64, rings: &[[f64; 2]], bands: usize, fields: usize) -> Level {
    const AROUND: usize = 96;
    let size = cell * (1u64 << level) as f64;
    let half = (2.0 * TAPS).ceil() as usize + 1;
    let width = 2 * half + 1;
    let mut taps = vec![0.0f32; width * width * bands];
    for (i, [light, moment]) in rings.iter().enumerate() {
        if *light <= 0.0 {
            continue;
        }
        let (band, r) = (i % bands, moment / light);
        let at = (r / (TAPS * cell)).max(1.0).log2().min((count - 1) as f64);
        let part = (1.0 - (at - level as f64).abs()).max(0.0);
        if part == 0.0 {
            continue;
        }
        let each = light * part / (AROUND * fields) as f64;
        for k in 0..AROUND {
            let angle = std::f64::consts::TAU * (k as f64 + 0.5) / AROUND as f64;
            let p = DVec2::from_angle(angle) * (r / size) + half as f64;
            let p = p.clamp(DVec2::ZERO, DVec2::splat((width - 1) as f64));
            let (first, t) = (p.floor().min(DVec2::splat((width - 2) as f64)), p);
            let t = t - first;
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let weight = (if dx == 1 { t.x } else { 1.0 - t.x }) * (if dy == 1 { t.y } else { 1.0 - t.y });
                taps[((first.y as usize + dy) * width + first.x as usize + dx) * bands + band] += (each * weight) as f32;
            }
        }
    }
    Level { width, taps }
}

/// A picture on cells twice as large: their mean, darkness beyond the edge.
fn halved(from: &Raster<f32>) -> Raster<f32> {
    let (width, height, bands) = (from.width.div_ceil(2), from.height.div_ceil(2), from.channels);
    let mut out = Raster::new(width, height, bands);
    for (i, pixel) in from.data.chunks_exact(bands).enumerate() {
        let place = (i / from.width / 2 * width + i % from.width / 2) * bands;
        out.data[place..place + bands].iter_mut().zip(pixel).for_each(|(o, v)| *o += 0.25 * v);
    }
    out
}

fn convolved(from: &Raster<f32>, level: &Level) -> Raster<f32> {
    let (bands, half) = (from.channels, level.width / 2);
    let mut out = Raster::new(from.width, from.height, bands);
    out.data.par_chunks_mut(from.width * bands).enumerate().for_each(|(row, line)| {
        for dy in 0..level.width {
            let Some(y) = (row + dy).checked_sub(half).filter(|y| *y < from.height) else { continue };
            let source = &from.data[y * from.width * bands..(y + 1) * from.width * bands];
            for dx in 0..level.width {
                let tap = &level.taps[(dy * level.width + dx) * bands..][..bands];
                if tap.iter().all(|t| *t == 0.0) {
                    continue;
                }
                // Columns of the result whose source lies in the picture.
                let (first, last) = (half.saturating_sub(dx), (from.width + half).saturating_sub(dx).min(from.width));
                if first >= last {
                    continue;
                }
                let shift = (first + dx - half) * bands;
                let to = line[first * bands..last * bands].chunks_exact_mut(bands);
                for (to, from) in to.zip(source[shift..].chunks_exact(bands)) {
                    to.iter_mut().zip(from).zip(tap).for_each(|((to, from), tap)| *to += from * tap);
                }
            }
        }
    });
    out
}

/// Adds a picture on cells `times` as large, bilinear.
fn add_enlarged(from: &Raster<f32>, to: &mut Raster<f32>, times: usize) {
    let (width, bands) = (to.width, to.channels);
    to.data.par_chunks_mut(width * bands).enumerate().for_each(|(row, line)| {
        let y = (row as f64 + 0.5) / times as f64;
        for (column, pixel) in line.chunks_exact_mut(bands).enumerate() {
            let x = (column as f64 + 0.5) / times as f64;
            add_bilinear(from, [x / from.width as f64, y / from.height as f64], pixel);
        }
    });
}

/// Adds a picture of fewer cells over the same film.
pub(super) fn add_stretched(from: &Raster<f32>, to: &mut Raster<f32>) {
    let (width, height, bands) = (to.width, to.height, to.channels);
    to.data.chunks_exact_mut(bands).enumerate().for_each(|(i, pixel)| {
        let at = [((i % width) as f64 + 0.5) / width as f64, ((i / width) as f64 + 0.5) / height as f64];
        add_bilinear(from, at, pixel);
    });
}

/// Adds the value of a raster at a place in fractions of its width and height.
fn add_bilinear(from: &Raster<f32>, at: [f64; 2], pixel: &mut [f32]) {
    let along = |t: f64, cells: usize| {
        let at = (t * cells as f64 - 0.5).clamp(0.0, (cells - 1) as f64);
        let i = (at as usize).min(cells.saturating_sub(2));
        (i, (i + 1).min(cells - 1), (at - i as f64) as f32)
    };
    let (x0, x1, fx) = along(at[0], from.width);
    let (y0, y1, fy) = along(at[1], from.height);
    let [a, b, c, d] = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)].map(|(x, y)| from.pixel(x, y));
    for (k, value) in pixel.iter_mut().enumerate() {
        let (top, bottom) = (a[k] + (b[k] - a[k]) * fx, c[k] + (d[k] - c[k]) * fx);
        *value += top + (bottom - top) * fy;
    }
}

/// A picture as glare looks at it, gathered row by row: the mean of its pixels on a raster of at most 512 columns.
#[derive(Clone, Debug)]
pub struct Seen {
    sums: Vec<f64>,
    counts: Vec<u32>,
    size: [usize; 2],
    film: [usize; 2],
    bands: usize,
}

impl Seen {
    /// What is seen of a film: nothing yet.
    pub fn new(film: &Film, bands: usize) -> Seen {
        let grid = Grid::over(film, COLUMNS);
        let cells = grid.columns * grid.rows;
        let size = [grid.columns, grid.rows];
        Seen { sums: vec![0.0; cells * bands], counts: vec![0; cells], size, film: [film.columns, film.rows], bands }
    }

    /// Some rows of the mean, from one on.
    pub fn add_rows(&mut self, mean: &Raster<f32>, first_row: usize) {
        let ([columns, rows], [film_columns, film_rows]) = (self.size, self.film);
        for (i, pixel) in mean.data.chunks_exact(self.bands).enumerate() {
            let (column, row) = (i % mean.width, first_row + i / mean.width);
            let cell = row * rows / film_rows * columns + column * columns / film_columns;
            self.counts[cell] += 1;
            let sums = &mut self.sums[cell * self.bands..][..self.bands];
            sums.iter_mut().zip(pixel).for_each(|(sum, v)| *sum += f64::from(*v));
        }
    }

    /// The raster.
    pub(super) fn raster(&self) -> Raster<f32> {
        let mut out = Raster::new(self.size[0], self.size[1], self.bands);
        for (i, (to, sum)) in out.data.iter_mut().zip(&self.sums).enumerate() {
            *to = (sum / f64::from(self.counts[i / self.bands].max(1))) as f32;
        }
        out
    }
}

/// Light of a lamp beyond the frame on the film: `found` (film point, mm, wavelength, light of each band × mm²) shared out over a coarse raster and enlarged to
/// `size`.
pub(super) fn of_lamp(film: &Film, found: &[(DVec2, Vec<f64>)], size: [usize; 2], bands: usize) -> Raster<f32> {
    let grid = Grid::over(film, COARSE);
    let mut coarse: Raster<f32> = Raster::new(grid.columns, grid.rows, bands);
    let area = grid.cell().x * grid.cell().y;
    for (at, light) in found {
        let place = grid.place(*at) - 0.5;
        let first = place.floor();
        for dy in -1..=2i64 {
            for dx in -1..=2i64 {
                let (x, y) = (first.x as i64 + dx, first.y as i64 + dy);
                let weight = [x as f64 - place.x, y as f64 - place.y].map(|d| 0.5 * (1.0 - 0.5 * d.abs()).max(0.0));
                if (0..grid.columns as i64).contains(&x) && (0..grid.rows as i64).contains(&y) {
                    let cell = (y as usize * grid.columns + x as usize) * bands;
                    for (to, light) in coarse.data[cell..cell + bands].iter_mut().zip(light) {
                        *to += (light * weight[0] * weight[1] / area) as f32;
                    }
                }
            }
        }
    }
    let mut out = Raster::new(size[0], size[1], bands);
    out.data.chunks_exact_mut(bands).enumerate().for_each(|(i, pixel)| {
        let at = [((i % size[0]) as f64 + 0.5) / size[0] as f64, ((i / size[0]) as f64 + 0.5) / size[1] as f64];
        add_bilinear(&coarse, at, pixel);
    });
    out
}
