//! The quick look: depth of field made from one sharp exposure and its depth, in a fraction of a second.
//!
//! Every pixel spreads its light over the circle of confusion that a thin lens gives its depth, in the shape of the iris (as the place in
//! the picture sees it: cat's eyes, too). Shapes are laid down row by row as differences at their edges and summed along the row, so that
//! a large circle costs its height, not its area; edges fall between pixels exactly. Layers of depth are put together from the nearest
//! to the farthest: each takes what coverage is left, so that a sharp foreground does not bleed into what is behind it, a blurred
//! foreground covers it softly, and a surface that runs through several layers has no seam. What a blurred edge would uncover was never
//! seen; it is filled from what is seen beside it, and reflections and what is behind glass get the depth of the mirror and of the glass.
//!
//! Sources: circle of confusion C = A |z_s − z_i| / z_i (thin lens); row differences after Kosloff, Tao & Barsky 2009, "Depth of field
//! postprocessing for layered scenes using constant-time rectangle spreading" (Graphics Interface); coverage shared out without
//! correlation as in an A-buffer (Carpenter 1984).

use crate::Camera;
use crate::depth_of_field::circle_mm;
use diopter_image::{ExposureFacts, FocalPlane, Raster};
use diopter_lens::{Iris, Lens, Pinhole};
use diopter_light::instruction_set;
use diopter_light::units::Millimeters;
use diopter_sensor::format;
use fearless_simd::{Simd, dispatch, f64x4, prelude::*};
use glam::{DVec2, DVec4};
use rayon::prelude::*;

/// Rows of a shape's table.
const ROWS: usize = 256;
/// Layers of depth, at most, and the blur (pixels) from one to the next, at least.
const MOST_LAYERS: usize = 10;
const LAYER_PX: f64 = 2.0;
/// Largest radius that is drawn, as a fraction of the picture's width.
const LARGEST: f64 = 0.25;
/// Half planes that stand for a shape.
const SIDES: usize = 48;
/// Places of the picture that get shapes of their own through a real lens: over the radius, around.
const FIELD: [usize; 2] = [6, 24];
/// Coverage that is no more than rounding.
const LEAST: f64 = 1e-5;
/// Coverage from which on what is behind fills what was never seen.
const BEHIND: f64 = 0.05;

/// What blurs.
#[derive(Clone, Debug)]
pub struct Optics {
    /// mm.
    pub focal_mm: f64,
    /// f-number.
    pub f_number: f64,
    /// Distance of the sharp plane, m; infinite for infinity.
    pub focus_m: f64,
    /// Width of the film, mm.
    pub film_width_mm: f64,
    /// Shapes by place in the picture.
    shapes: Shapes,
}

impl Optics {
    /// A thin lens that is focused at `focus_m` (infinite for infinity). An aperture picture counts as a round iris.
    pub fn thin(focal_mm: f64, f_number: f64, focus_m: f64, film_width_mm: f64, iris: &Iris) -> Optics {
        let shape = |mirror: f64| match iris {
            Iris::Blades(b) => {
                let sides: Vec<[f64; 3]> = b.edges().iter().map(|e| [e[0] * mirror, e[1] * mirror, e[2]]).collect();
                Shape::new(&sides)
            }
            _ => Shape::round(),
        };
        Optics { focal_mm, f_number, focus_m, film_width_mm, shapes: Shapes { places: vec![[shape(1.0), shape(-1.0)]] } }
    }

    /// As a camera stands: of a real lens, pupils as each part of the picture sees them. `None` for a pinhole, which blurs nothing.
    pub fn of(camera: &Camera) -> Option<Optics> {
        let lens = &camera.lens;
        let (focal, n) = (lens.focal_length().0, lens.f_number());
        let focus_m = lens.focus_distance().map_or(f64::INFINITY, |d| d.0 / 1000.0);
        let width = camera.film.width_mm;
        match lens {
            // A calibrated camera is exposed as it is: its blur costs little.
            Lens::Pinhole(_) | Lens::Calibrated(_) => None,
            Lens::Thin(thin) => Some(Optics::thin(focal, n, focus_m, width, &thin.iris)),
            Lens::Compound(_) => {
                let radius = 0.5 * focal / n;
                let half = 0.5 * width.hypot(camera.film.height_mm);
                let places = (0..FIELD[0] * FIELD[1])
                    .into_par_iter()
                    .map(|i| {
                        // A place of the picture, to the right and up; on the film it lies upside down.
                        let angle = std::f64::consts::TAU * (i % FIELD[1]) as f64 / FIELD[1] as f64;
                        let film = -DVec2::from_angle(angle) * (half * ((i / FIELD[1]) as f64 + 0.5) / FIELD[0] as f64);
                        let sides = pupil_sides(lens, film, radius);
                        let mirrored: Vec<[f64; 3]> = sides.iter().map(|s| [-s[0], -s[1], s[2]]).collect();
                        [Shape::new(&sides), Shape::new(&mirrored)]
                    })
                    .collect();
                Some(Optics { focal_mm: focal, f_number: n, focus_m, film_width_mm: width, shapes: Shapes { places } })
            }
        }
    }

    /// Radius of the blur (pixels) of a depth (m, along the axis) in a picture of so many columns; negative before the sharp plane.
    pub fn radius_px(&self, depth_m: f64, columns: usize) -> f64 {
        // What has no depth is far away.
        let depth_m = if depth_m > 0.0 { depth_m } else { f64::INFINITY };
        if 1000.0 * depth_m <= self.focal_mm {
            // It has no image: as blurred as anything.
            return -LARGEST * columns as f64;
        }
        let circle = circle_mm(self.focal_mm, self.f_number, self.focus_m, depth_m);
        let radius = (0.5 * circle / self.film_width_mm * columns as f64).min(LARGEST * columns as f64);
        if depth_m < self.focus_m { -radius } else { radius }
    }
}

/// Support of the pupil in all directions, in units of the nominal radius.
fn pupil_sides(lens: &Lens, film: DVec2, radius: f64) -> Vec<[f64; 3]> {
    const SIDE: usize = 40;
    let mut points = Vec::with_capacity(SIDE * SIDE);
    for i in 0..SIDE * SIDE {
        let u = [(i % SIDE) as f32 + 0.5, (i / SIDE) as f32 + 0.5].map(|v| v / SIDE as f32);
        if let Ok(ray) = lens.ray(film, u) {
            let at = ray.origin_mm - ray.direction * (ray.origin_mm.z / ray.direction.z);
            points.push(at.truncate() / radius);
        }
    }
    (0..SIDES)
        .map(|k| {
            let normal = DVec2::from_angle(std::f64::consts::TAU * k as f64 / SIDES as f64);
            let reach = points.iter().map(|p| p.dot(normal)).fold(f64::NEG_INFINITY, f64::max);
            [normal.x, normal.y, if reach.is_finite() { reach } else { 0.0 }]
        })
        .collect()
}

/// A convex opening, cut into rows: how wide it is up to each row, and where its middle lies. x to the right, rows downwards, as the
/// picture shows the blur of what lies behind the sharp plane.
#[derive(Clone, Debug)]
struct Shape {
    /// Half of its height.
    reach: f64,
    /// ∫ width and ∫ width × middle from the top to each row.
    sums: Vec<[f64; 2]>,
}

impl Shape {
    fn round() -> Shape {
        Shape::from_rows(1.0, |t| {
            let half = (1.0 - t * t).max(0.0).sqrt();
            [-half, half]
        })
    }

    /// Of half planes x·n ≤ d in the pupil (y upwards).
    fn new(sides: &[[f64; 3]]) -> Shape {
        let row = |t: f64| {
            // Row t of the picture is y = −t of the pupil.
            let (mut left, mut right) = (-4.0f64, 4.0f64);
            for [nx, ny, d] in sides {
                let rest = d + ny * t;
                if nx.abs() < 1e-9 {
                    if rest < 0.0 {
                        return [0.0, 0.0];
                    }
                } else if *nx > 0.0 {
                    right = right.min(rest / nx);
                } else {
                    left = left.max(rest / nx);
                }
            }
            if left < right { [left, right] } else { [0.0, 0.0] }
        };
        let reach = (0..400)
            .map(|k| k as f64 / 200.0)
            .filter(|t| row(*t)[1] > row(*t)[0] || row(-t)[1] > row(-t)[0])
            .fold(0.005, f64::max);
        Shape::from_rows(reach + 0.005, row)
    }

    fn from_rows(reach: f64, row: impl Fn(f64) -> [f64; 2]) -> Shape {
        const FINE: usize = 8;
        let step = 2.0 * reach / (ROWS * FINE) as f64;
        let mut sums = vec![[0.0; 2]];
        let mut sum = [0.0; 2];
        for k in 0..ROWS * FINE {
            let [a, b] = row(-reach + (k as f64 + 0.5) * step);
            sum = [sum[0] + (b - a) * step, sum[1] + 0.5 * (b * b - a * a) * step];
            if (k + 1) % FINE == 0 {
                sums.push(sum);
            }
        }
        Shape { reach, sums }
    }

    fn area(&self) -> f64 {
        self.sums[ROWS][0]
    }

    /// Sums up to a row.
    #[inline]
    fn up_to(&self, t: f64) -> [f64; 2] {
        let x = ((t + self.reach) / (2.0 * self.reach) * ROWS as f64).clamp(0.0, ROWS as f64 - 1e-9);
        let i = x as usize;
        let f = x - i as f64;
        let (a, b) = (self.sums[i], self.sums[i + 1]);
        [a[0] + (b[0] - a[0]) * f, a[1] + (b[1] - a[1]) * f]
    }
}

/// Shapes by place: behind and before the sharp plane.
#[derive(Clone, Debug)]
struct Shapes {
    places: Vec<[Shape; 2]>,
}

impl Shapes {
    /// Number of the shapes of a place: fractions of half the diagonal from the middle, to the right and up.
    fn index(&self, at: DVec2) -> usize {
        if self.places.len() == 1 {
            return 0;
        }
        let ring = ((at.length() * FIELD[0] as f64) as usize).min(FIELD[0] - 1);
        let turn = at.y.atan2(at.x).rem_euclid(std::f64::consts::TAU) / std::f64::consts::TAU * FIELD[1] as f64;
        ring * FIELD[1] + (turn.round() as usize) % FIELD[1]
    }
}

/// Radii are taken from this row: each so much larger than the one before.
const FIRST_RADIUS: f64 = 0.15;
const RADIUS_STEP: f64 = 1.02;

/// Number of the radius nearest to one.
fn radius_index(radius: f64) -> usize {
    ((radius.max(FIRST_RADIUS) / FIRST_RADIUS).ln() / RADIUS_STEP.ln()).round() as usize
}

fn radius_of(index: usize) -> f64 {
    FIRST_RADIUS * RADIUS_STEP.powi(index as i32)
}

/// Below this radius a blur is known by its second moment alone, r²/4.
const SMALL: f64 = 1.2;

/// A shape at all radii, cut into rows of pixels.
struct Spans {
    /// For each radius: where its rows begin in `rows`, how many lie on each side of its own, the area of all.
    of_radius: Vec<(u32, i32, f64)>,
    /// Half of the width and the middle of each row, pixels.
    rows: Vec<[f32; 2]>,
}

impl Spans {
    fn new(shape: &Shape, radii: usize) -> Spans {
        let (mut of_radius, mut rows) = (Vec::with_capacity(radii), Vec::new());
        for k in 0..radii {
            let (first, radius) = (rows.len(), radius_of(k));
            if radius < SMALL {
                // A fraction a goes up and down each, and as much to the sides, all of it in the own row: second moment 2a.
                let a = radius * radius / 8.0;
                let own = 0.5 / (1.0 - 2.0 * a / (1.0 - 2.0 * a));
                let beside = own * a / (1.0 - 2.0 * a);
                rows.extend([beside, own, beside].map(|half| [half as f32, 0.0]));
                of_radius.push((first as u32, 1, 2.0 * (own + 2.0 * beside)));
                continue;
            }
            // A disk has the second moment r²/4; drawn on pixels it has r²/4 + 1/12 and is read by pixels: smaller by that.
            let radius = (radius * radius - 1.0 / 3.0).sqrt();
            let side = (radius * shape.reach + 0.5).floor() as i32;
            for dy in -side..=side {
                let (a, b) = (shape.up_to((f64::from(dy) - 0.5) / radius), shape.up_to((f64::from(dy) + 0.5) / radius));
                let covered = b[0] - a[0];
                let middle = if covered > 0.0 { radius * (b[1] - a[1]) / covered } else { 0.0 };
                rows.push([(0.5 * covered * radius * radius) as f32, middle as f32]);
            }
            let area = rows[first..].iter().map(|r| 2.0 * f64::from(r[0])).sum::<f64>().max(1e-9);
            of_radius.push((first as u32, side, area));
        }
        Spans { of_radius, rows }
    }
}

/// A pixel that spreads.
#[derive(Clone, Copy)]
struct Source {
    /// Light and coverage a unit of area.
    light: [f32; 4],
    /// Where the rows of its shape begin among the spans; its own row is `side` further.
    rows: u32,
    side: u16,
    layer: u8,
    front: bool,
    place: u16,
}

/// A sharp picture, ready to be blurred.
struct Sharp {
    width: usize,
    height: usize,
    layers: usize,
    /// By place, behind and before the sharp plane.
    spans: Vec<[Spans; 2]>,
    sources: Vec<Source>,
    /// [`Source::side`] of all.
    sides: Vec<u16>,
    /// Of each row the largest, and of all.
    reach: Vec<usize>,
    farthest: usize,
}

impl Sharp {
    /// Lays down the edges of a row of what a source spreads, `dy` rows below it, as if it stood in a column that may be beyond the picture.
    #[inline(always)]
    fn spread<S: Simd>(&self, simd: S, source: &Source, dy: i64, column: i64, edges: &mut [[f64; 4]]) {
        let rows = &self.spans[source.place as usize][usize::from(source.front)].rows;
        let [half, middle] = rows[(i64::from(source.rows) + i64::from(source.side) + dy) as usize];
        let line = &mut edges[source.layer as usize * (self.width + 2)..][..self.width + 2];
        let middle = column as f32 + 0.5 + middle;
        // In double precision: what a lamp adds at one end must be gone after the other.
        let light = f64x4::from_slice(simd, &source.light.map(f64::from));
        for (at, light) in [(middle - half, light), (middle + half, -light)] {
            let at = at.clamp(0.0, self.width as f32);
            let i = at as usize;
            let second = light * f64::from(at - i as f32);
            let first = light - second;
            (f64x4::from_slice(simd, &line[i]) + first).store_slice(&mut line[i]);
            (f64x4::from_slice(simd, &line[i + 1]) + second).store_slice(&mut line[i + 1]);
        }
    }

    /// A row of the blurred picture, of `n` channels a pixel; `edges` is room for a row of each layer and two more pixels.
    #[inline(always)]
    fn row<S: Simd>(&self, simd: S, y: usize, n: usize, edges: &mut [[f64; 4]], row: &mut [f32]) {
        let Sharp { width, height, layers, farthest, .. } = *self;
        edges.fill([0.0; 4]);
        // Beyond the picture its border goes on: what is blurred there spreads into it.
        for from in y as i64 - farthest as i64..=(y + farthest) as i64 {
            let line_of = from.clamp(0, height as i64 - 1) as usize;
            let dy = y as i64 - from;
            let away = dy.unsigned_abs() as usize;
            if self.reach[line_of] < away {
                continue;
            }
            let start = line_of * width;
            let sides = &self.sides[start..start + width];
            for (x, side) in sides.iter().enumerate() {
                if *side as usize >= away {
                    self.spread(simd, &self.sources[start + x], dy, x as i64, edges);
                }
            }
            for (column, outside) in [(0, 1), (width - 1, -1i64)] {
                let side = sides[column] as usize;
                if side >= away {
                    for k in 1..=side as i64 {
                        self.spread(simd, &self.sources[start + column], dy, column as i64 - outside * k, edges);
                    }
                }
            }
        }
        // Sums along the row, then layers from the nearest on.
        let mut sums = [DVec4::ZERO; MOST_LAYERS];
        for (x, to) in row.chunks_exact_mut(n).enumerate() {
            let (mut left, mut all, mut behind) = (1.0, DVec4::ZERO, DVec4::ZERO);
            for (k, sum) in sums[..layers].iter_mut().enumerate() {
                *sum += DVec4::from_array(edges[k * (width + 2) + x]);
                let coverage = sum.w;
                if coverage <= LEAST || left <= 0.0 {
                    continue;
                }
                let taken = coverage.min(left);
                let part = *sum * (taken / coverage);
                if all.w > 0.0 {
                    behind += part;
                }
                all += part;
                left -= taken;
            }
            if left > 0.0 && all.w > 0.0 {
                let filler = if behind.w > BEHIND { behind } else { all };
                all += filler * (left / filler.w);
            }
            for (c, to) in to.iter_mut().enumerate() {
                *to = all[c].max(0.0) as f32;
            }
        }
    }
}

/// Blurs a sharp picture (`[row][column][channel]`, up to three channels of linear light) by its depth (m along the axis; infinite where
/// there is nothing), of which there is one a pixel. `None` with other numbers of channels or depths, and without pixels.
pub fn quick_look(picture: &Raster<f32>, depth: &[f32], optics: &Optics) -> Option<Raster<f32>> {
    let (width, height, n) = (picture.width, picture.height, picture.channels);
    if !(1..=3).contains(&n) || depth.is_empty() || depth.len() != width * height {
        return None;
    }
    let radii: Vec<f64> = depth.par_iter().map(|z| optics.radius_px(f64::from(*z), width)).collect();
    let (low, high) = radii.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |a, r| (a.0.min(*r), a.1.max(*r)));
    let layers = (((high - low) / LAYER_PX).ceil() as usize).clamp(1, MOST_LAYERS);
    let diagonal = 0.5 * (width as f64).hypot(height as f64);
    let axis_area = optics.shapes.places[0][0].area();
    let levels = radius_index(low.abs().max(high.abs())) + 1;
    let spans: Vec<[Spans; 2]> = optics.shapes.places.par_iter().map(|p| [0, 1].map(|k| Spans::new(&p[k], levels))).collect();
    let sources: Vec<Source> = radii
        .par_iter()
        .enumerate()
        .map(|(i, signed)| {
            let (x, y) = (i % width, i / width);
            let at = DVec2::new(x as f64 + 0.5 - 0.5 * width as f64, 0.5 * height as f64 - y as f64 - 0.5) / diagonal;
            let place = optics.shapes.index(at);
            let front = *signed < 0.0;
            let area = optics.shapes.places[place][usize::from(front)].area();
            let level = if area > 1e-6 { radius_index(signed.abs()) } else { 0 };
            let (rows, side, covers) = spans[place][usize::from(front)].of_radius[level];
            let layer = (((signed - low) / (high - low).max(1e-9) * layers as f64) as usize).min(layers - 1);
            let mut light = [0.0; 4];
            let spread = 1.0 / covers;
            for (to, from) in light.iter_mut().zip(picture.pixel(x, y)) {
                // One bad number must not poison a row.
                let from = if from.is_finite() { f64::from(*from) } else { 0.0 };
                *to = (from * spread * area / axis_area) as f32;
            }
            light[3] = spread as f32;
            Source { light, rows, side: side as u16, layer: layer as u8, front, place: place as u16 }
        })
        .collect();
    let sides: Vec<u16> = sources.iter().map(|s| s.side).collect();
    let reach: Vec<usize> = sides.par_chunks(width).map(|row| row.iter().copied().max().unwrap_or(0) as usize).collect();
    let farthest = reach.iter().copied().max().unwrap_or(0);
    let sharp = Sharp { width, height, layers, spans, sources, sides, reach, farthest };
    let mut out = Raster::<f32>::new(width, height, n);
    out.data.par_chunks_mut(width * n).enumerate().for_each_init(
        || vec![[0.0; 4]; layers * (width + 2)],
        |edges, (y, row)| dispatch!(instruction_set::widest(), simd => sharp.row(simd, y, n, edges, row)),
    );
    Some(out)
}

/// The focal plane of a sharp exposure as a lens would have blurred it: bands in groups of three. Its facts are those of that lens; its truth stays; its noise estimate is
/// blurred as if it were light, and no more than an estimate.
pub fn of_plane(plane: &FocalPlane, optics: &Optics) -> FocalPlane {
    let blurred = |raster: &Raster<f32>, signed: bool| {
        let mut out = raster.clone();
        for first in (0..raster.channels).step_by(3) {
            let n = (raster.channels - first).min(3);
            let mut part = Raster::<f32>::new(raster.width, raster.height, n);
            for (to, from) in part.data.chunks_exact_mut(n).zip(raster.data.chunks_exact(raster.channels)) {
                to.iter_mut().zip(&from[first..]).for_each(|(a, b)| *a = if signed { b.abs() } else { *b });
            }
            let Some(part) = quick_look(&part, &plane.truth.depth().data, optics) else { break };
            for (to, from) in out.data.chunks_exact_mut(raster.channels).zip(part.data.chunks_exact(n)) {
                to[first..first + n].copy_from_slice(from);
            }
        }
        out
    };
    let facts = ExposureFacts {
        focal_length_mm: optics.focal_mm,
        focal_length_35mm_mm: format::equivalent_35mm(
            optics.focal_mm,
            film_diagonal(optics.film_width_mm, plane.width(), plane.height()),
        ),
        f_number: optics.f_number,
        focus_distance_m: optics.focus_m.is_finite().then_some(optics.focus_m),
        extension_mm: 1.0 / (1.0 / optics.focal_mm - 1.0 / (1000.0 * optics.focus_m)) - optics.focal_mm,
        focus_mode: "manual".into(),
        ..plane.facts.clone()
    };
    FocalPlane {
        mean: blurred(&plane.mean, false),
        half_difference: blurred(&plane.half_difference, true),
        facts,
        ..plane.clone()
    }
}

/// Width of the film of a plane, mm, by its focal lengths; `None` where these are not known.
pub fn film_width_of(plane: &FocalPlane) -> Option<f64> {
    let facts = &plane.facts;
    let diagonal = format::FULL_FRAME_DIAGONAL_MM * facts.focal_length_mm / facts.focal_length_35mm_mm;
    (diagonal.is_finite() && diagonal > 0.0).then(|| diagonal / film_diagonal(1.0, plane.width(), plane.height()))
}

/// Diagonal of a film of a width with so many square pixels.
fn film_diagonal(film_width_mm: f64, width: usize, height: usize) -> f64 {
    film_width_mm * 1.0f64.hypot(height as f64 / width as f64)
}

/// Whether a camera's lens draws its corners elsewhere than a hole would (by more than 5 %), or leaves them dark.
pub fn is_bent(camera: &Camera) -> bool {
    let Lens::Compound(lens) = &camera.lens else { return false };
    let corner = 0.5 * DVec2::new(camera.film.width_mm, camera.film.height_mm);
    let drawn =
        |film: DVec2| lens.chief_ray(film).ok().map(|r| film.length() * (r.direction.z / r.direction.truncate().length()).abs());
    match (drawn(corner), drawn(corner * 1e-3)) {
        (Some(a), Some(b)) => (a / b - 1.0).abs() > 0.05,
        _ => true,
    }
}

/// The camera that takes the sharp exposure for a quick look at another: a hole in the middle of its pupil, as bright.
pub fn sharp_camera(camera: &Camera) -> Camera {
    let focal = camera.lens.focal_length().0;
    let film = match &camera.lens {
        // As large as it draws in the middle, however it is focused.
        Lens::Compound(lens) => {
            let height = 1e-3 * camera.film.width_mm;
            let drawn = lens.chief_ray(DVec2::new(height, 0.0)).ok().map(|r| height * (r.direction.z / r.direction.x).abs());
            drawn.filter(|d| d.is_finite() && *d > 0.0).unwrap_or(focal)
        }
        other => focal + other.extension().0,
    };
    // π / (4 N²) of light on the axis of a hole, π f² / (4 T² v²) of a lens.
    let f_number = camera.lens.t_number() * film / focal;
    match Pinhole::new(Millimeters(film), f_number) {
        Ok(hole) if !matches!(camera.lens, Lens::Pinhole(_)) => Camera { lens: Lens::Pinhole(hole), ..camera.clone() },
        _ => camera.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn optics() -> Optics {
        Optics::thin(50.0, 2.0, 2.0, 6.0, &Iris::Round)
    }

    #[test]
    fn a_point_becomes_an_even_disk_with_all_its_light() {
        let (w, h) = (101, 81);
        let mut picture = Raster::<f32>::new(w, h, 3);
        picture.pixel_mut(50, 40).fill(1.0);
        for depth in [1.6f32, 1.9, 2.0, 2.1, 4.0, 1000.0] {
            let out = quick_look(&picture, &vec![depth; w * h], &optics()).unwrap();
            let r = optics().radius_px(f64::from(depth), w).abs();
            let sum: f32 = out.data.iter().step_by(3).sum();
            assert!((sum - 1.0).abs() < 2e-3, "{depth}: {sum}");
            let moment: f64 = (0..w * h).map(|i| ((i % w) as f64 - 50.0).powi(2) * f64::from(out.data[3 * i])).sum();
            // That of the disk; circles of little more than a pixel are drawn a little tight.
            assert!((moment - 0.25 * r * r).abs() < 0.02 * r * r + 0.1, "{depth}: {moment} {r}");
        }
    }

    #[test]
    fn layers_cover_each_other_as_they_should() {
        // A sharp bright card (left) before a dark far wall: the wall gets none of its light; a blurred card before a sharp wall
        // covers half at its edge.
        let (w, h) = (120, 40);
        let picture = |card: f32, wall: f32| {
            let mut p = Raster::<f32>::new(w, h, 1);
            (0..w * h).for_each(|i| p.data[i] = if i % w < 60 { card } else { wall });
            p
        };
        let depths = |card: f32, wall: f32| (0..w * h).map(|i| if i % w < 60 { card } else { wall }).collect::<Vec<_>>();
        let sharp = quick_look(&picture(100.0, 1.0), &depths(2.0, 50.0), &optics()).unwrap();
        assert!((sharp.pixel(57, 20)[0] - 100.0).abs() < 1e-3 && (sharp.pixel(61, 20)[0] - 1.0).abs() < 1e-3);
        let soft = quick_look(&picture(100.0, 1.0), &depths(0.8, 2.0), &optics()).unwrap();
        let (edge, far) = (soft.pixel(60, 20)[0], soft.pixel(110, 20)[0]);
        assert!((edge - 50.0).abs() < 6.0 && (far - 1.0).abs() < 1e-3, "{edge} {far}");
    }

    #[test]
    fn a_lamp_leaves_the_rest_of_its_row_alone() {
        let (w, h) = (200, 60);
        for (lamp, depth) in [(1e7f32, 5.0f32), (f32::NAN, 5.0), (f32::INFINITY, 1.7), (1e6, f32::NAN)] {
            let mut picture = Raster::<f32>::new(w, h, 3);
            picture.data.fill(0.1);
            picture.pixel_mut(50, 30).fill(lamp);
            let out = quick_look(&picture, &vec![depth; w * h], &optics()).unwrap();
            for y in 0..h {
                assert!((120..w).all(|x| (out.pixel(x, y)[0] - 0.1).abs() < 1e-4), "{lamp} {depth}: row {y}");
            }
        }
    }

    #[test]
    fn a_receding_floor_has_no_seams() {
        let (w, h) = (90, 160);
        let mut picture = Raster::<f32>::new(w, h, 1);
        picture.data.fill(7.0);
        let depth: Vec<f32> = (0..w * h).map(|i| 1.0 + 6.0 * (i / w) as f32 / h as f32).collect();
        let out = quick_look(&picture, &depth, &optics()).unwrap();
        assert!(out.data.iter().all(|v| (v - 7.0).abs() < 1e-3), "{:?}", out.data.iter().copied().fold(7.0, f32::max));
    }

    #[test]
    fn shapes_have_the_area_of_the_disk_and_point_both_ways() {
        let blades = Iris::blades(3, std::f32::consts::FRAC_PI_2, 0.0).unwrap();
        let o = Optics::thin(50.0, 2.0, 2.0, 36.0, &blades);
        let [behind, before] = &o.shapes.places[0];
        assert!((behind.area() - std::f64::consts::PI).abs() < 0.02 && (before.area() - std::f64::consts::PI).abs() < 0.02);
        // A triangle with a corner up: behind the sharp plane the blur points up, before it down.
        assert!(behind.up_to(0.0)[0] < before.up_to(0.0)[0]);
    }
}
