//! The raster over the film that stray light is drawn in: light of a part of the front as triangles, smeared, splatted.

use crate::camera::Film;
use diopter_image::Raster;
use glam::{DVec2, Vec2};

/// Cells at the rim of a ghost are halved until they are so small (cells of the raster), at most so often.
pub(super) const RIM_CELLS: f32 = 1.5;
pub(super) const RIM_DEPTH: f32 = 4.0;

/// Halved so often or more, triangles hold all of the light.
pub(super) const RIM_SURE: u32 = 3;

/// Triangles smaller than this (raster cells) are splatted, not filled; filled are parts of cells, so many along each side.
pub(super) const SMALL: f32 = 0.5;
pub(super) const PARTS: usize = 2;

/// Some cells of the raster, `[row][column][band]`; those beyond its edges are there to be smeared.
pub(super) struct Patch {
    pub(super) left: i64,
    pub(super) top: i64,
    pub(super) columns: usize,
    pub(super) data: Vec<f32>,
}

impl Patch {
    /// Smears it evenly along a way, in cells.
    pub(super) fn smeared(self, way: Vec2, bands: usize) -> Patch {
        let length = way.abs().max_element();
        if !(length > 0.25) || self.columns == 0 {
            return self;
        }
        let steps = (length.ceil() as usize).clamp(2, 32);
        let margin = (0.5 * length).ceil() as usize + 1;
        let (rows, columns) = (self.data.len() / (self.columns * bands), self.columns + 2 * margin);
        let mut data = vec![0.0; columns * (rows + 2 * margin) * bands];
        for k in 0..steps {
            let shift = way * ((k as f32 + 0.5) / steps as f32 - 0.5) + margin as f32;
            let (first, t) = (shift.floor(), shift - shift.floor());
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let weight = (if dx == 1 { t.x } else { 1.0 - t.x }) * (if dy == 1 { t.y } else { 1.0 - t.y }) / steps as f32;
                for (row, line) in self.data.chunks_exact(self.columns * bands).enumerate() {
                    let start = ((row + first.y as usize + dy) * columns + first.x as usize + dx) * bands;
                    data[start..start + line.len()].iter_mut().zip(line).for_each(|(sum, v)| *sum += weight * v);
                }
            }
        }
        Patch { left: self.left - margin as i64, top: self.top - margin as i64, columns, data }
    }

    /// Adds what lies on a raster to it.
    pub(super) fn add_to(&self, raster: &mut Raster<f32>) {
        let bands = raster.channels;
        let (width, height) = (raster.width as i64, raster.height as i64);
        let (from, to) = ((-self.left).clamp(0, self.columns as i64), (width - self.left).clamp(0, self.columns as i64));
        if from >= to {
            return;
        }
        for (k, line) in self.data.chunks_exact(self.columns * bands).enumerate() {
            let row = self.top + k as i64;
            if (0..height).contains(&row) {
                let start = (row * width + self.left + from) as usize * bands;
                let line = &line[from as usize * bands..to as usize * bands];
                raster.data[start..start + line.len()].iter_mut().zip(line).for_each(|(sum, v)| *sum += v);
            }
        }
    }
}

/// Raster coordinates of a film point: the picture stands upside down on the film.
pub(super) fn on_raster(film: &Film, [columns, rows]: [usize; 2]) -> impl Fn(DVec2) -> Vec2 {
    let cells = DVec2::new(columns as f64, rows as f64);
    let (size, middle) = (DVec2::new(film.width_mm, film.height_mm), DVec2::from_array(film.center_mm));
    move |at: DVec2| {
        let at = (at + middle) / size;
        (DVec2::new(0.5 - at.x, 0.5 + at.y) * cells).as_vec2()
    }
}

/// Where light of a place on the front lands (cells of the raster), and how much it is for a unit of area there.
pub(super) type Node = (Vec2, f64);

/// Light of a part of the front as triangles on the film.
pub(super) struct Mesh {
    pub(super) triangles: Vec<([Vec2; 3], f64)>,
    /// Places so lonely that they make no triangle.
    pub(super) dots: Vec<Node>,
}

impl Mesh {
    /// Of a rectangle of the front, by so many cells across; cells at the rim of what is lit are cut in halves until they are small on the film.
    pub(super) fn of(node: &impl Fn(DVec2) -> Option<Node>, [low, high]: [DVec2; 2], across: usize) -> Mesh {
        let side = across + 1;
        let step = (high - low) / across as f64;
        let at = |k: usize| low + step * DVec2::new((k % side) as f64, (k / side) as f64);
        let nodes: Vec<Option<Node>> = (0..side * side).map(|k| node(at(k))).collect();
        let lit = || nodes.iter().flatten().map(|n| n.0);
        let (least, most) = lit().fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
        let cell = (most - least).max_element() / across as f32;
        let depth = if cell.is_finite() { (cell / RIM_CELLS).max(1.0).log2().ceil().min(RIM_DEPTH) as u32 } else { 0 };
        let mut mesh = Mesh { triangles: vec![], dots: vec![] };
        for k in (0..side * across).filter(|k| k % side != across) {
            let corners = [k, k + 1, k + side, k + side + 1].map(|i| nodes[i]);
            mesh.cell(node, at(k), step, corners, depth);
        }
        let area = step.x * step.y;
        if mesh.triangles.is_empty() {
            mesh.dots = nodes.iter().flatten().map(|n| (n.0, n.1 * area)).collect();
        } else if depth < RIM_SURE {
            // What is lit ends somewhere beyond the last lit corners, on average half a cell: the sum of all places is right.
            let all: f64 = nodes.iter().flatten().map(|n| n.1 * area).sum();
            let filled: f64 = mesh.triangles.iter().map(|t| t.1).sum();
            mesh.triangles.iter_mut().for_each(|t| t.1 *= all / filled);
        }
        mesh
    }

    pub(super) fn cell(
        &mut self,
        node: &impl Fn(DVec2) -> Option<Node>,
        low: DVec2,
        size: DVec2,
        corners: [Option<Node>; 4],
        depth: u32,
    ) {
        let lit = corners.iter().flatten().count();
        if lit == 0 {
            return;
        }
        if lit < 4 && depth > 0 {
            let half = 0.5 * size;
            let at = |x: f64, y: f64| node(low + half * DVec2::new(x, y));
            let [a, b, c, d] = corners;
            let (ab, ac, bd, cd, middle) = (at(1.0, 0.0), at(0.0, 1.0), at(2.0, 1.0), at(1.0, 2.0), at(1.0, 1.0));
            for (x, y, four) in [
                (0.0, 0.0, [a, ab, ac, middle]),
                (1.0, 0.0, [ab, b, middle, bd]),
                (0.0, 1.0, [ac, middle, c, cd]),
                (1.0, 1.0, [middle, bd, cd, d]),
            ] {
                self.cell(node, low + half * DVec2::new(x, y), half, four, depth - 1);
            }
            return;
        }
        let area = size.x * size.y;
        for three in [[0, 1, 2], [3, 2, 1]] {
            if let [Some(a), Some(b), Some(c)] = three.map(|i| corners[i]) {
                self.triangles.push(([a.0, b.0, c.0], (a.1 + b.1 + c.1) / 6.0 * area));
            }
        }
        // Three lit corners whose dark one splits both triangles.
        if let [Some(a), None, Some(c), Some(d)] | [Some(a), Some(c), None, Some(d)] = corners {
            self.triangles.push(([a.0, c.0, d.0], (a.1 + c.1 + d.1) / 6.0 * area));
        }
    }

    /// Lower and upper corner of all of it.
    pub(super) fn bounds(&self) -> Option<[Vec2; 2]> {
        let places = self.triangles.iter().flat_map(|t| t.0).chain(self.dots.iter().map(|n| n.0));
        let (a, b) = places.fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
        (a.x <= b.x).then_some([a, b])
    }

    /// Onto a region, all of it times `scale`.
    pub(super) fn rasterise(&self, scale: f64, region: &mut Region) {
        self.triangles.iter().for_each(|(corners, light)| region.fill(*corners, (light * scale) as f32));
        self.dots.iter().for_each(|(at, light)| region.splat(*at, (light * scale) as f32));
    }
}

/// Draws light on a region: `nodes`, a square of `across` a side, tell where that of a cell of the front lands and how much it is, for each cell of `front` (cells of the raster).
pub(super) fn rasterise(nodes: &[Option<(Vec2, f64)>], across: usize, front: f64, region: &mut Region) {
    let mut triangles = vec![];
    let mut filled = 0.0;
    for k in 0..across * (across - 1) {
        if k % across + 1 == across {
            continue;
        }
        let corner = [k, k + 1, k + across, k + across + 1].map(|i| nodes[i]);
        for three in [[0, 1, 2], [3, 2, 1]] {
            if let [Some(a), Some(b), Some(c)] = three.map(|i| corner[i]) {
                let light = (a.1 + b.1 + c.1) / 6.0;
                filled += light;
                triangles.push(([a.0, b.0, c.0], light));
            }
        }
    }
    // Cells at the edge of the pupil are half a cell short: what nodes bring in all is kept.
    let all: f64 = nodes.iter().flatten().map(|n| n.1).sum();
    if filled > 0.0 {
        for (corners, light) in triangles {
            region.fill(corners, (light * all / filled * front) as f32);
        }
    } else {
        nodes.iter().flatten().for_each(|(at, light)| region.splat(*at, (light * front) as f32));
    }
}

/// Irradiance on some cells of the raster, over that of the beam at the front.
pub(super) struct Region {
    pub(super) left: i64,
    pub(super) top: i64,
    pub(super) columns: usize,
    pub(super) rows: usize,
    pub(super) light: Vec<f32>,
}

impl Region {
    /// The cells of a raster, and `margin` cells around it, that a rectangle meets, with a cell around for splats; `None` beside them.
    pub(super) fn around(low: Vec2, high: Vec2, size: [usize; 2], margin: f32) -> Option<Region> {
        let (start, end) = (Vec2::splat(-margin), Vec2::new(size[0] as f32, size[1] as f32) + margin);
        if !(low.cmplt(end + 1.0).all() && high.cmpgt(start - 1.0).all()) {
            return None;
        }
        let first = (low.floor() - 1.0).clamp(start, end - 1.0);
        let last = (high.floor() + 1.0).clamp(start, end - 1.0);
        let [left, top, right, bottom] = [first.x, first.y, last.x, last.y].map(|v| v as i64);
        let (columns, rows) = ((right + 1 - left) as usize, (bottom + 1 - top) as usize);
        Some(Region { left, top, columns, rows, light: vec![0.0; columns * rows] })
    }

    /// Spreads light over a triangle.
    pub(super) fn fill(&mut self, [a, b, c]: [Vec2; 3], light: f32) {
        let twice = (b - a).perp_dot(c - a);
        let area = 0.5 * twice.abs();
        if area < SMALL {
            for at in [a + b, b + c, c + a] {
                self.splat(0.5 * at, light / 3.0);
            }
            return;
        }
        let sense = twice.signum();
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        // By parts of cells, whose middles lie within or not: triangles that meet at an edge share none of them, but for middles on the edge itself.
        let parts = PARTS as f32;
        let range = |low: f32, high: f32, start: i64, count: usize| {
            let part = |v: f32| (v - start as f32 * parts).clamp(0.0, (count * PARTS) as f32) as usize;
            part((low * parts - 0.5).ceil())..part((high * parts - 0.5).floor() + 1.0)
        };
        let even = light / area / (parts * parts);
        for row in range(low.y, high.y, self.top, self.rows) {
            for column in range(low.x, high.x, self.left, self.columns) {
                let p = Vec2::new(self.left as f32 + (column as f32 + 0.5) / parts, self.top as f32 + (row as f32 + 0.5) / parts);
                let side = |a: Vec2, b: Vec2| (b - a).perp_dot(p - a) * sense >= 0.0;
                if side(a, b) && side(b, c) && side(c, a) {
                    self.light[row / PARTS * self.columns + column / PARTS] += even;
                }
            }
        }
    }

    /// Distributes light over the four cells around a place.
    pub(super) fn splat(&mut self, at: Vec2, light: f32) {
        let corner = at - 0.5;
        let (first, part) = (corner.floor(), corner - corner.floor());
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let (x, y) = (first.x as i64 + dx - self.left, first.y as i64 + dy - self.top);
            let fraction = (if dx == 1 { part.x } else { 1.0 - part.x }) * (if dy == 1 { part.y } else { 1.0 - part.y });
            if (0..self.columns as i64).contains(&x) && (0..self.rows as i64).contains(&y) {
                self.light[y as usize * self.columns + x as usize] += light * fraction;
            }
        }
    }
}

/// Adds the value of a raster over the film at the middle of a pixel, bilinear.
pub(super) fn add_at(raster: &Raster<f32>, film: &Film, [column, row]: [usize; 2], scale: f32, pixel: &mut [f32]) {
    let along = |k: usize, pixels: usize, cells: usize| {
        let at = ((k as f32 + 0.5) * cells as f32 / pixels as f32 - 0.5).clamp(0.0, (cells - 1) as f32);
        let i = (at as usize).min(cells.saturating_sub(2));
        (i, (i + 1).min(cells - 1), at - i as f32)
    };
    let (x0, x1, fx) = along(column, film.columns, raster.width);
    let (y0, y1, fy) = along(row, film.rows, raster.height);
    let [a, b, c, d] = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)].map(|(x, y)| raster.pixel(x, y));
    for (k, value) in pixel.iter_mut().enumerate() {
        let (top, bottom) = (a[k] + (b[k] - a[k]) * fx, c[k] + (d[k] - c[k]) * fx);
        *value += scale * (top + (bottom - top) * fy);
    }
}
