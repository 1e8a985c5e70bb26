//! Pictures and depth of a light field: its samples summed with a shift, through parts of the pupil.

use super::pupils::{Grid, Pupils};
use super::settings::LightField as Settings;
use super::{Focus, LightField};
use crate::region::{Planes, Region};
use crate::setting::RecipeError;
use crate::steps::demosaic::Mosaic;
use diopter_image::Raster;
use glam::{DVec2, Vec2};
use rayon::prelude::*;

/// Parts of the mosaic that are summed apart: a fixed number, so that sums do not depend on the threads.
const PARTS: usize = 16;
/// Planes a pixel of shift at the pupil's edge that depth is looked for in.
const PLANES_A_PIXEL: f64 = 4.0;
/// Each so many of them a picture is made of for one that is sharp all over: between them it is interpolated.
const PLANES_A_PICTURE: usize = 2;
/// Farthest place in the pupil, in its radii, from which light is taken.
const FARTHEST: f32 = 2.0;
/// Most views across the pupil that depth is looked for with.
const MOST_VIEWS: usize = 9;

/// Part of the pupil that a picture is made with.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Through {
    /// A disk about the middle, of this radius; 1 is all.
    Disk(f32),
    /// A small part about a place, so far to each side.
    View(Vec2, f32),
}

/// Distances found in a light field, a value a pixel of its pictures.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthMap {
    /// From the lens along its axis, m; infinite beyond what the lens can focus on.
    pub depth_m: Raster<f32>,
    /// How sure each is, 0 to 1: in what is even all over depth is filled in from around.
    pub confidence: Raster<f32>,
}

/// A balanced mosaic and the geometry it was taken with.
pub struct Decoder<'a> {
    /// Geometry.
    pub field: &'a LightField,
    /// The whole mosaic.
    pub mosaic: Mosaic<'a>,
}

/// What a part of the pupil shows.
struct Gathered {
    /// Of each channel.
    planes: Vec<Vec<f32>>,
    /// What it was made of in each pixel: samples, of all channels.
    weight: Vec<f32>,
}

/// A grey picture through a place of the pupil.
struct View {
    /// Where its light comes from on average, at places of the film ([`Decoder::grid`]).
    middles: Vec<Vec2>,
    /// Its pixels, and how much of the light of a view that nothing is cut from each is made of, 0 to 1.
    cells: Vec<[f32; 2]>,
}

/// Sums of weighted samples of some rows of a picture.
struct Sums {
    /// Their first row.
    first: usize,
    /// `[row][column][channel]`: signal and what it would be in even light.
    cells: Vec<[f32; 2]>,
}

impl Decoder<'_> {
    /// Camera channels of a picture. `f_number`: that of the shot. Fails on settings that this light field cannot give: a place outside the
    /// pupil, a view with an aperture beside it, an aperture wider than that of the shot or smaller than a pixel, a focus nearer than the lens can image.
    pub fn picture(&self, settings: &Settings, f_number: f64) -> Result<Planes, RecipeError> {
        self.field.check(settings, f_number)?;
        let focus = Focus::parse(&settings.focus).unwrap_or(Focus::AsTaken);
        let through = match (settings.view, settings.aperture) {
            // The film's picture is upside down: light through the right of the pupil comes from the left in it.
            (Some([x, y]), _) => Through::View(-Vec2::new(x as f32, y as f32), self.view_width()),
            (None, Some(n)) => Through::Disk((f_number / n) as f32),
            (None, None) => Through::Disk(1.0),
        };
        let planes = match focus {
            Focus::AsTaken => self.gather(through, 0.0).planes,
            Focus::At(distance) => self.gather(through, self.field.shift_for(distance)?).planes,
            Focus::Everything => self.all_in_focus(through),
        };
        let [width, height] = self.field.size;
        Ok(Planes { region: Region::whole(width, height), planes })
    }

    /// Half width of a view: it must hold all channels.
    fn view_width(&self) -> f32 {
        let period = self.mosaic.cfa.columns().max(self.mosaic.cfa.rows()) as f64;
        (period.max(1.0) / self.field.radius_px) as f32
    }

    /// Adds up what falls on each pixel of a picture when light through the pupil's edge is shifted by `shift` pixels.
    fn gather(&self, through: Through, shift: f64) -> Gathered {
        self.gather_all(&[through], shift).swap_remove(0)
    }

    /// The same through several parts of the pupil at once.
    fn gather_all(&self, through: &[Through], shift: f64) -> Vec<Gathered> {
        let f = self.field;
        let has_views = through.iter().any(|t| matches!(t, Through::View(..)));
        let [width, height] = f.size;
        let channels = self.mosaic.cfa.channel_count();
        let [columns, rows] = f.mosaic;
        let part = rows.div_ceil(PARTS);
        let row_of = |y: usize| y as f64 * f.facts.pixel_mm[1] / f.step_mm / f.magnification;
        // A lens is up to its own radius away, light moves by the shift, and is shared among two rows.
        let reach = 2.0 + shift.abs() * f64::from(FARTHEST);
        let middle = 0.5 * (height as f64 - row_of(rows));
        let parts: Vec<Vec<Sums>> = (0..PARTS)
            .into_par_iter()
            .map(|k| {
                let (from, to) = (k * part, ((k + 1) * part).min(rows));
                let row = |y: f64| y.clamp(0.0, height as f64) as usize;
                let (first, end) = (row(middle + row_of(from) - reach), row(middle + row_of(to) + reach + 1.0));
                let empty = || Sums { first, cells: vec![[0.0; 2]; (end - first.min(end)) * width * channels] };
                let mut sums: Vec<Sums> = through.iter().map(|_| empty()).collect();
                for y in from..to {
                    for x in 0..columns {
                        let (lens, q) = self.sample(x, y);
                        if q.length_squared() > FARTHEST * FARTHEST {
                            continue;
                        }
                        let at = self.place(lens) - (q * shift as f32).as_dvec2();
                        let channel = self.mosaic.cfa.channel_at(x, y);
                        let value = self.mosaic.data[y * columns + x];
                        let inside = if has_views { self.inside(lens, q) } else { 0.0 };
                        for (sums, through) in sums.iter_mut().zip(through) {
                            let (taken, expected) = weights(*through, q, inside, f.radius_px as f32);
                            if taken > 0.0 {
                                sums.splat(at, width, channels, channel, [taken * value, expected]);
                            }
                        }
                    }
                }
                sums
            })
            .collect();
        // Light that the lens gathers on the image of the pupil was spread over the whole lens on a film.
        let fraction = (std::f64::consts::PI * (f.facts.gap_mm * f.facts.pupil_slope).powi(2) / f.lattice.cell_area()) as f32;
        let plane = |i: usize, channel: usize, weight: &mut [f32]| {
            let mut plane: Vec<[f32; 2]> = vec![[0.0; 2]; width * height];
            for sums in parts.iter().map(|p| &p[i]) {
                for (to, from) in plane[(sums.first * width).min(width * height)..]
                    .iter_mut()
                    .zip(sums.cells.iter().skip(channel).step_by(channels))
                {
                    to[0] += from[0];
                    to[1] += from[1];
                }
            }
            weight.iter_mut().zip(&plane).for_each(|(sum, [_, w])| *sum += w);
            filled(plane, width).into_iter().map(|v| v * fraction).collect()
        };
        let gathered = |i: usize| {
            let mut weight = vec![0.0; width * height];
            Gathered { planes: (0..channels).map(|c| plane(i, c, &mut weight)).collect(), weight }
        };
        (0..through.len()).into_par_iter().map(gathered).collect()
    }

    /// The lens (mm on the film) that a pixel of the mosaic belongs to, and its place in the pupil, 1 at the edge.
    fn sample(&self, x: usize, y: usize) -> (DVec2, Vec2) {
        let f = self.field;
        let pixel = DVec2::from_array(f.facts.pixel_mm);
        let middle = DVec2::new(f.mosaic[0] as f64, f.mosaic[1] as f64) * 0.5;
        let sensor = (DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - middle) * pixel;
        let lens = f.lattice.nearest(sensor / f.magnification);
        let q = (lens - sensor) / f.facts.gap_mm + lens * f.facts.exit_curvature_per_mm;
        (lens, (q / f.facts.pupil_slope).as_vec2())
    }

    /// Place of a lens in a picture, pixels.
    fn place(&self, lens: DVec2) -> DVec2 {
        let [width, height] = self.field.size;
        lens / self.field.step_mm + 0.5 * DVec2::new(width as f64, height as f64)
    }

    /// How far a place in the pupil lies from the edge of what a lens (mm on the film) sees, inside above 0, in radii.
    fn inside(&self, lens: DVec2, q: Vec2) -> f32 {
        self.field.pupils.as_ref().map_or_else(|| 1.0 - q.length(), |pupils| pupils.inside(lens, q))
    }

    /// Places on the film at which the middles of views are known.
    fn grid(&self) -> Grid {
        self.field.pupils.as_ref().map_or(Grid::MIDDLE, Pupils::grid)
    }

    /// Grey, slightly soft pictures through places of the pupil, without shift.
    fn views(&self) -> Vec<View> {
        let across = self.field.views_across().min(MOST_VIEWS);
        let at = |i: usize| (2.0 * i as f32 + 1.0) / across as f32 - 1.0;
        let places: Vec<Vec2> = (0..across * across).map(|i| Vec2::new(at(i % across), at(i / across))).collect();
        let places: Vec<Vec2> = places.into_iter().filter(|p| p.length() <= 1.0 - 0.5 / across as f32).collect();
        let views: Vec<Through> = places.iter().map(|p| Through::View(*p, self.view_width())).collect();
        // Views hold detail finer than their pixels; taken between pixels it would look smoother, and so more alike, than on them.
        let soft = |plane: &[f32]| smoothed(plane, self.field.size[0], 0.8);
        let grey = |view: Gathered| {
            let mean = |i: usize| view.planes.iter().map(|p| p[i]).sum::<f32>() / view.planes.len() as f32;
            let signal: Vec<f32> = view.weight.iter().enumerate().map(|(i, w)| mean(i) * w).collect();
            (soft(&signal), soft(&view.weight))
        };
        let views: Vec<(Vec<f32>, Vec<f32>)> = self.gather_all(&views, 0.0).into_iter().map(grey).collect();
        // Of a view that nothing is cut from, somewhere.
        let whole = views.iter().flat_map(|(_, weight)| weight).fold(f32::MIN_POSITIVE, |a, b| a.max(*b));
        let cell = |(signal, weight): (&f32, &f32)| [if *weight > 0.0 { signal / weight } else { 0.0 }, weight / whole];
        let view = |(place, (signal, weight)): (&Vec2, &(Vec<f32>, Vec<f32>))| View {
            middles: self.middles_of_view(*place),
            cells: signal.iter().zip(weight).map(cell).collect(),
        };
        places.par_iter().zip(&views).map(view).collect()
    }

    /// Where in the pupil the light of a view about a place comes from on average, at each place of the grid: beyond the edge there is none, so views there are seen from
    /// farther inside.
    fn middles_of_view(&self, place: Vec2) -> Vec<Vec2> {
        /// Places across the view, and across a pixel, that are tried.
        const ACROSS: usize = 16;
        const WITHIN: usize = 4;
        let (radius_px, width) = (self.field.radius_px as f32, self.view_width());
        let middle_of = |i: usize, n: usize| (2.0 * i as f32 + 1.0) / n as f32 - 1.0;
        let grid = |n: usize| (0..n * n).map(move |i| Vec2::new(middle_of(i % n, n), middle_of(i / n, n)));
        let middle_at = |film: DVec2| {
            let (mut sum, mut total) = (Vec2::ZERO, 0.0);
            // What arrives in its pixels lies up to half a pixel beside it.
            for q in grid(ACROSS).map(|within| place + within * (width + 0.5 / radius_px)) {
                if self.inside(film, q) < 0.0 {
                    continue;
                }
                // The pixel that light arrives on counts by its middle.
                let taken = |within: Vec2| weights(Through::View(place, width), q + within * (0.5 / radius_px), 1.0, radius_px).0;
                let weight: f32 = grid(WITHIN).map(taken).sum();
                sum += q * weight;
                total += weight;
            }
            if total > 0.0 { sum / total } else { place }
        };
        self.grid().places().map(middle_at).collect()
    }

    /// Shifts that depth is looked for at: from infinity to where neighbouring pixels of the mosaic are shifted by a pixel.
    fn shifts(&self) -> Vec<f64> {
        let infinity = self.field.shift_at(0.0).max(-self.field.radius_px);
        let (low, high) = (infinity - 0.5, self.field.radius_px);
        let n = ((high - low) * PLANES_A_PIXEL).ceil() as usize;
        (0..=n).map(|i| low + (high - low) * i as f64 / n as f64).collect()
    }

    /// Shift at which each pixel is sharp, and how sure that is.
    fn shift_map(&self, shifts: &[f64]) -> (Vec<f32>, Vec<f32>) {
        let [width, height] = self.field.size;
        let views = self.views();
        let grid = self.grid();
        let film_of = |x: usize, y: usize| {
            (DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - 0.5 * DVec2::new(width as f64, height as f64)) * self.field.step_mm
        };
        let around: Vec<[(usize, f32); 4]> = (0..width * height).map(|i| grid.around(film_of(i % width, i / width))).collect();
        // How far the views differ, for each shift.
        let costs: Vec<Vec<f32>> = shifts
            .par_iter()
            .map(|shift| {
                let mut sums = vec![[0.0f32; 3]; width * height];
                for view in &views {
                    for y in 0..height {
                        for x in 0..width {
                            let i = y * width + x;
                            let q: Vec2 = around[i].iter().map(|(place, fraction)| view.middles[*place] * *fraction).sum();
                            let moved = Vec2::new(x as f32, y as f32) + q * *shift as f32;
                            let [v, weight] = bilinear(&view.cells, [width, height], moved);
                            let [total, sum, squares] = &mut sums[i];
                            *total += weight;
                            *sum += weight * v;
                            *squares += weight * v * v;
                        }
                    }
                }
                let spread =
                    |[n, sum, squares]: &[f32; 3]| if *n > 0.0 { (squares / n - (sum / n).powi(2)).max(0.0) } else { 0.0 };
                smoothed(&sums.iter().map(spread).collect::<Vec<f32>>(), width, 1.2)
            })
            .collect();
        let mut found = vec![0.0; width * height];
        let mut sure = vec![0.0; width * height];
        // What noise alone makes views differ by, at the least.
        let mut least: Vec<f32> = (0..width * height).map(|i| costs.iter().map(|c| c[i]).fold(f32::MAX, f32::min)).collect();
        let middle = least.len() / 2;
        let floor = *least.select_nth_unstable_by(middle, f32::total_cmp).1;
        for i in 0..width * height {
            let best = (0..costs.len()).min_by(|a, b| costs[*a][i].total_cmp(&costs[*b][i])).unwrap_or(0);
            let middle = costs[best][i];
            let (before, after) = (costs[best.saturating_sub(1)][i], costs[(best + 1).min(costs.len() - 1)][i]);
            let bend = before + after - 2.0 * middle;
            let part = if bend > 0.0 && best > 0 && best + 1 < costs.len() { 0.5 * (before - after) / bend } else { 0.0 };
            found[i] = (shifts[best] + f64::from(part) * (shifts[1] - shifts[0])) as f32;
            let mean = costs.iter().map(|c| c[i]).sum::<f32>() / costs.len() as f32;
            sure[i] = ((mean - middle) / (mean + middle + 4.0 * floor + 1e-12)).clamp(0.0, 1.0);
        }
        (middle_of_nine(&spread_out(&found, &sure, width), width), sure)
    }

    /// Depth from how the views differ.
    pub fn depth(&self) -> DepthMap {
        let [width, height] = self.field.size;
        let (shift, sure) = self.shift_map(&self.shifts());
        let raster = |data: Vec<f32>| Raster { width, height, channels: 1, data };
        let depth = shift.iter().map(|s| self.field.distance_at(f64::from(*s)) as f32).collect();
        DepthMap { depth_m: raster(depth), confidence: raster(sure) }
    }

    /// Each pixel from the picture that is focused on it.
    fn all_in_focus(&self, through: Through) -> Vec<Vec<f32>> {
        let shifts = self.shifts();
        let (found, _) = self.shift_map(&shifts);
        let step = (shifts[1] - shifts[0]) * PLANES_A_PICTURE as f64;
        let mut out = vec![vec![0.0; found.len()]; self.mosaic.cfa.channel_count()];
        for k in 0..shifts.len().div_ceil(PLANES_A_PICTURE) + 1 {
            let shift = shifts[0] + step * k as f64;
            // Between two planes their mean by distance.
            let fraction: Vec<f32> =
                found.iter().map(|s| (1.0 - ((f64::from(*s) - shift) / step).abs()).max(0.0) as f32).collect();
            if fraction.iter().all(|s| *s == 0.0) {
                continue;
            }
            for (to, from) in out.iter_mut().zip(self.gather(through, shift).planes) {
                to.iter_mut().zip(&from).zip(&fraction).for_each(|((to, v), s)| *to += v * s);
            }
        }
        out
    }
}

impl Sums {
    /// Distributes a sample over the four pixels around its place.
    #[inline]
    fn splat(&mut self, at: DVec2, width: usize, channels: usize, channel: usize, [value, weight]: [f32; 2]) {
        let (x, y) = (at.x - 0.5, at.y - 0.5 - self.first as f64);
        let (left, top) = (x.floor(), y.floor());
        let (fx, fy) = ((x - left) as f32, (y - top) as f32);
        let rows = (self.cells.len() / (width * channels)) as i64;
        for (dy, wy) in [(0, 1.0 - fy), (1, fy)] {
            for (dx, wx) in [(0, 1.0 - fx), (1, fx)] {
                let (column, row) = (left as i64 + dx, top as i64 + dy);
                if (0..width as i64).contains(&column) && (0..rows).contains(&row) {
                    let cell = &mut self.cells[(row as usize * width + column as usize) * channels + channel];
                    cell[0] += wx * wy * value;
                    cell[1] += wx * wy * weight;
                }
            }
        }
    }
}

/// Fraction of a pixel that lies inside an edge so far from its middle, in radii of the pupil's image of so many pixels; outside below 0.
fn covered(inside: f32, radius_px: f32) -> f32 {
    (0.5 + inside * radius_px).clamp(0.0, 1.0)
}

/// How much a sample counts, and how much of it even light would fill. `inside`: how far it lies from the edge of the pupil that its lens sees; asked of views alone.
fn weights(through: Through, q: Vec2, inside: f32, radius_px: f32) -> (f32, f32) {
    let r = q.length();
    match through {
        // All light, also what falls beside: what rims take is missing here as in a photograph.
        Through::Disk(1.0) => (1.0, covered(1.0 - r, radius_px)),
        Through::Disk(radius) => {
            let w = covered(radius - r, radius_px);
            (w, w * covered(1.0 - r, radius_px))
        }
        // As bright as the scene, wherever any of it is seen.
        Through::View(place, width) => {
            let d = 1.0 - (q - place).abs() / width;
            let w = d.x.max(0.0) * d.y.max(0.0);
            (w, w * covered(inside, radius_px))
        }
    }
}

/// Signal over weight; where nothing fell, or hardly anything beside the rest of the picture, from around.
fn filled(sums: Vec<[f32; 2]>, width: usize) -> Vec<f32> {
    /// Of the largest weight: less is noise.
    const ENOUGH: f32 = 0.03;
    let height = sums.len() / width;
    let most = sums.iter().map(|[_, w]| *w).fold(0.0, f32::max);
    let mut plane: Vec<f32> = sums.iter().map(|[v, w]| if *w > ENOUGH * most { v / w } else { f32::NAN }).collect();
    while plane.iter().any(|v| v.is_nan()) {
        let before = plane.clone();
        for (i, v) in plane.iter_mut().enumerate().filter(|(_, v)| v.is_nan()) {
            let (x, y) = (i % width, i / width);
            let near = (y.saturating_sub(1)..(y + 2).min(height))
                .flat_map(|r| before[r * width + x.saturating_sub(1)..r * width + (x + 2).min(width)].iter());
            let (sum, count) = near.filter(|v| !v.is_nan()).fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
            if count > 0.0 {
                *v = sum / count;
            }
        }
        // Nothing anywhere: dark.
        if plane.iter().all(|v| v.is_nan()) {
            plane.fill(0.0);
        }
    }
    plane
}

/// A view between its pixels, weighted by the light that they are made of, and this light; beyond the edges the edge.
#[inline]
fn bilinear(cells: &[[f32; 2]], [width, height]: [usize; 2], at: Vec2) -> [f32; 2] {
    let x = at.x.clamp(0.0, width as f32 - 1.001);
    let y = at.y.clamp(0.0, height as f32 - 1.001);
    let (i, j) = (x as usize, y as usize);
    let (fx, fy) = (x - i as f32, y - j as f32);
    let (mut signal, mut total) = (0.0, 0.0);
    for (row, across) in [(j, 1.0 - fy), (j + 1, fy)] {
        for (column, fraction) in [(i, across * (1.0 - fx)), (i + 1, across * fx)] {
            let [value, weight] = cells[row * width + column];
            signal += fraction * weight * value;
            total += fraction * weight;
        }
    }
    [if total > 0.0 { signal / total } else { 0.0 }, total]
}

/// Gaussian blur, edges repeated.
fn smoothed(plane: &[f32], width: usize, sigma: f32) -> Vec<f32> {
    let height = plane.len() / width;
    let reach = (2.5 * sigma).ceil() as i64;
    let kernel: Vec<f32> = (-reach..=reach).map(|k| (-0.5 * (k as f32 / sigma).powi(2)).exp()).collect();
    let total: f32 = kernel.iter().sum();
    let pass = |from: &[f32], n: usize, stride: usize| -> Vec<f32> {
        (0..from.len())
            .map(|i| {
                let at = (i / stride % n) as i64;
                let tap = |(k, w): (usize, &f32)| {
                    let to = (at + k as i64 - reach).clamp(0, n as i64 - 1);
                    w * from[(i as i64 + (to - at) * stride as i64) as usize]
                };
                kernel.iter().enumerate().map(tap).sum::<f32>() / total
            })
            .collect()
    };
    pass(&pass(plane, width, 1), height, width)
}

/// Median of each pixel and its neighbours: single ones that are wrong are gone.
fn middle_of_nine(plane: &[f32], width: usize) -> Vec<f32> {
    let height = plane.len() / width;
    let at = |i: usize| {
        let (x, y) = ((i % width) as i64, (i / width) as i64);
        let mut near: [f32; 9] = std::array::from_fn(|k| {
            let column = (x + k as i64 % 3 - 1).clamp(0, width as i64 - 1) as usize;
            let row = (y + k as i64 / 3 - 1).clamp(0, height as i64 - 1) as usize;
            plane[row * width + column]
        });
        near.sort_by(f32::total_cmp);
        near[4]
    };
    (0..plane.len()).map(at).collect()
}

/// Values where they are sure; elsewhere means of what is sure around, the nearest first (a pyramid of widths).
fn spread_out(values: &[f32], sure: &[f32], width: usize) -> Vec<f32> {
    let weight: Vec<f32> = sure.iter().map(|s| s * s).collect();
    let weighted: Vec<f32> = values.iter().zip(&weight).map(|(v, w)| v * w).collect();
    let mut out = vec![0.0; values.len()];
    let mut left = vec![1.0f32; values.len()];
    let longest = width.max(values.len() / width) as f32;
    let mut sigma = 0.0;
    loop {
        let (v, w) = match sigma {
            0.0 => (weighted.clone(), weight.clone()),
            s => (smoothed(&weighted, width, s), smoothed(&weight, width, s)),
        };
        let last = sigma > 0.25 * longest;
        for i in 0..out.len() {
            // Sure beyond a quarter is sure enough.
            let take = if last { left[i] } else { left[i].min(w[i] / 0.06) };
            if w[i] > 1e-12 {
                out[i] += take * v[i] / w[i];
                left[i] -= take;
            }
        }
        if last {
            break;
        }
        sigma = if sigma == 0.0 { 1.0 } else { 2.0 * sigma };
    }
    out.iter().zip(&left).zip(values).map(|((o, l), v)| o + l * v).collect()
}
