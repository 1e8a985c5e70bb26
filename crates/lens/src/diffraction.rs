//! Diffraction at the aperture, as it displaces light on the film.
//!
//! Light of wavelength λ that would arrive at a film point by geometry is spread over displacements d around it with the density |P̂(d/λ)|², where P is the
//! pupil function over the direction cosines at the film (Fraunhofer pattern of the exit pupil; Goodman, "Introduction to Fourier Optics", §6.1). For an
//! ideal lens this is exact: its image is the geometric one convolved with that pattern. For a real lens the aberrations in the plane of focus are taken
//! from the rays and put into the pupil function (`wavefront`), as long as they are no more than some waves. Where they are more, the geometric MTF is
//! multiplied by that of the aberration-free pupil, as ray-based MTFs "multiplied by the diffraction limit" are; so is the blur of what is out of focus (errors of
//! this: docs/decisions/diffraction.md).
//!
//! The pattern is scale-free: in u = d/λ it is the same at all wavelengths. The exit pupil is linearised about the chief ray, so that one table serves all
//! of the film where the pupil keeps its shape: frequencies u are mapped by the size of the pupil and its foreshortening. Where rims cut the pupil away the
//! table is that of the nearest film point of a grid.
//!
//! Limits: coherence is that of single points, always right for photographs; the pupil of all wavelengths is that of the d line; of an aperture picture
//! what is finer than 1/128 of its width is averaged; beyond 40 cycles across the aperture only straight and curved edges of blades are known (`tail`).

mod pattern;
mod pupil;
mod tail;
mod wavefront;

use crate::batch::single::Batch;
use crate::{CompoundLens, Iris, Lens};
use glam::{DMat2, DVec2, DVec3};
use pattern::{EXTENT, Pattern};
use pupil::{PupilGrid, Shape};
use std::f64::consts::PI;
use tail::Tail;
use wavefront::{Wavefront, foreshortening};

/// Distances from the axis at which the pupil of a real lens is traced.
const RINGS: usize = 6;
/// Directions from the axis in which it is traced, if they differ.
const DIRECTIONS: usize = 8;
/// Wavelengths for which patterns of aberrated pupils are made, nm: from, step, number. Between them they are scaled; the phase is then off by 5 %.
const COLORS_NM: [f32; 2] = [430.0, 60.0];
const COLORS: usize = 5;
/// Largest aberration that is put into the pupil function, frequencies of its table at the shortest wavelength; its middle reaches to 8.
const LARGEST: f64 = 6.0;
const SHORTEST_MM: f64 = 0.0004;
/// Phase of a pupil function below which it has none, turns.
const NO_PHASE: f64 = 0.004;
/// Longest wavelength that is carried, mm: wings must begin before what is drawn for them.
const LONGEST_MM: f64 = 0.00083;
/// Largest change of scale by foreshortening for which wings are drawn: cos³ of 37°.
const FORESHORTENED: f64 = 0.5;

/// Diffraction of a lens as it is set.
#[derive(Clone, Debug)]
pub struct Diffraction {
    pupils: PupilMap,
    patterns: Vec<Scaled>,
    tail: Option<Tail>,
    /// Radius beyond which light is wings, mm.
    core_mm: f64,
    /// Index of the film's medium, in which waves are shorter.
    film_index: f64,
}

/// A pattern and what its table needs to be scaled.
#[derive(Clone, Debug)]
struct Scaled {
    pattern: Pattern,
    /// Side of the square of the table over the root of the area of the aperture.
    side: f64,
    /// Where what is drawn for wings begins in the table: nearer than wings of any wavelength do.
    wings_from: f64,
}

/// Where on the film which pupil is seen.
#[derive(Clone, Debug)]
enum PupilMap {
    /// In the plane of a thin lens.
    Thin {
        /// Steps of one root of the pupil's area across and up, mm.
        axes: [DVec3; 2],
        /// mm.
        film_distance: f64,
    },
    /// The same everywhere: the root of the area as an angle.
    Even(f64),
    Traced(TracedPupils),
}

#[derive(Clone, Debug)]
struct TracedPupils {
    /// Farthest film point, mm.
    radius: f64,
    /// Whether the pupil turns with the film point.
    round: bool,
    /// 1 / distance from the film to the exit pupil, 1/mm.
    curvature: f64,
    /// `[ring][direction]`
    zones: Vec<Zone>,
    /// Aberrations at each ring that are not left to the rays.
    wavefronts: Vec<Option<Wavefront>>,
}

#[derive(Clone, Copy, Debug)]
struct Zone {
    /// Number of its pattern, of the first of its [`COLORS`].
    pattern: usize,
    /// How many it has: one for all, or one for each of them.
    colors: usize,
    /// Middle of the pupil, as [`crate::pupil`] counts slopes.
    center: DVec2,
    /// Root of the area.
    size: f64,
}

/// Diffraction at a film point.
#[derive(Clone, Copy, Debug)]
pub struct Kernel<'a> {
    all: &'a Diffraction,
    /// Of all colours, or of each of [`COLORS`].
    scaled: &'a [Scaled],
    /// Frequencies of the table from those of the film.
    table_from_film: DMat2,
    film_from_table: DMat2,
    determinant: f64,
}

impl Diffraction {
    /// Diffraction of a lens over a film that reaches so far from the axis (mm) each way. Light that is displaced by more than `core_mm` counts as wings
    /// ([`Kernel::wing`]). `None` of a pinhole, whose hole has no size for rays, and where no light comes through.
    pub fn new(lens: &Lens, film_mm: DVec2, core_mm: f64) -> Option<Diffraction> {
        let root = PI.sqrt();
        let mut phased = vec![];
        let (map, grids, iris) = match lens {
            Lens::Pinhole(_) => return None,
            Lens::Thin(lens) => {
                let step = lens.radius() * root;
                let axes = [DVec3::X, DVec3::Y].map(|axis| lens.turned(axis) * step);
                let map = PupilMap::Thin { axes, film_distance: lens.film_distance().0 };
                (map, vec![PupilGrid::of_iris(&lens.iris)], lens.iris.clone())
            }
            Lens::Calibrated(lens) => {
                let iris = lens.pupil().map_or(Iris::Round, |p| p.iris.clone());
                (PupilMap::Even(0.5 / lens.f_number() * root), vec![PupilGrid::of_iris(&iris)], iris)
            }
            Lens::Compound(lens) => {
                let (map, grids, of_zones) = traced(lens, film_mm.length())?;
                phased = of_zones;
                (PupilMap::Traced(map), grids, lens.system().iris.shape.clone())
            }
        };
        let film_index = match lens {
            Lens::Compound(lens) => lens.system().film_index(&lens.system().reference_indices()),
            _ => 1.0,
        };
        // The area of a picture is that of all of its light; the map counts roots of the area of the f-number's disk.
        let by_iris = !matches!(map, PupilMap::Traced(_));
        let size = match &map {
            PupilMap::Thin { axes, film_distance } => axes[0].length() / film_distance,
            PupilMap::Even(size) => *size,
            PupilMap::Traced(t) => film_index * t.zones.iter().map(|z| z.size).fold(f64::INFINITY, f64::min),
        };
        let scaled = |grid: &PupilGrid| {
            let side = if by_iris { grid.side / root } else { grid.filled().sqrt().recip() };
            let mut pattern = Pattern::new(&grid.amplitude);
            let wings_from = FORESHORTENED * size * side * core_mm / LONGEST_MM;
            pattern.wings_from(&grid.amplitude, wings_from);
            Scaled { pattern, side, wings_from }
        };
        let mut map = map;
        let mut patterns: Vec<Scaled> = grids.iter().map(scaled).collect();
        if let PupilMap::Traced(traced) = &mut map {
            traced.add_aberrations(&phased, &mut patterns);
        }
        Some(Diffraction { pupils: map, patterns, tail: Tail::of(&iris), core_mm, film_index })
    }

    /// Diffraction at a film point, mm.
    #[inline]
    pub fn at(&self, film: DVec2) -> Kernel<'_> {
        // Direction cosines from roots of the area: columns.
        let (patterns, cosines) = match &self.pupils {
            PupilMap::Even(size) => (0..1, DMat2::from_diagonal(DVec2::splat(*size))),
            PupilMap::Thin { axes, film_distance } => {
                let chief = -film.extend(*film_distance);
                let distance = chief.length();
                let l = chief / distance;
                let column = |axis: DVec3| (axis.truncate() - l.truncate() * l.dot(axis)) / distance;
                (0..1, DMat2::from_cols(column(axes[0]), column(axes[1])))
            }
            PupilMap::Traced(map) => map.cosines(film),
        };
        let cosines = cosines * self.film_index;
        let scaled = &self.patterns[patterns];
        // The phase of a place x of the pupil is u · (C x): its frequency in the table is Cᵀ u times the table's side, the same for all colours.
        let table_from_film = cosines.transpose() * scaled[0].side;
        let determinant = table_from_film.determinant().abs();
        Kernel { all: self, scaled, table_from_film, film_from_table: table_from_film.inverse(), determinant }
    }

    /// Where on the film a ray must start, instead of at `film` (mm), so that the aberration of the lens in its plane of focus is left to the pattern. `u`: the
    /// place of the pupil that it goes through.
    #[inline]
    pub fn straightened(&self, lens: &CompoundLens, film: DVec2, u: [f32; 2]) -> DVec2 {
        let PupilMap::Traced(map) = &self.pupils else { return film };
        let (region, turn) = lens.pupils().region(film);
        if region.fan.area() <= 0.0 {
            return film;
        }
        let slope = lens.pupils().slope(film, region.fan.sample(u), turn);
        film + map.delta(film, slope + film * map.curvature)
    }

    /// Radius beyond which light counts as wings, mm.
    pub fn core_mm(&self) -> f64 {
        self.core_mm
    }
}

impl Kernel<'_> {
    #[inline]
    fn of(&self, nm: f32) -> &Scaled {
        let color = ((nm - COLORS_NM[0]) / COLORS_NM[1]).round().max(0.0) as usize;
        &self.scaled[color.min(self.scaled.len() - 1)]
    }

    /// Displacement on the film (mm) of a wavelength, by two even numbers. What lies beyond the table is drawn within it: 0.4 % of the light of a disk.
    #[inline]
    pub fn draw(&self, u: [f32; 2], nm: f32) -> DVec2 {
        self.film_from_table * self.of(nm).pattern.draw(u) * (f64::from(nm) * 1e-6)
    }

    /// Density of that displacement, 1/mm².
    #[inline]
    pub fn density(&self, displacement: DVec2, nm: f32) -> f32 {
        let mm = f64::from(nm) * 1e-6;
        let w = self.table_from_film * displacement / mm;
        self.of(nm).pattern.density(w) * (self.determinant / (mm * mm)) as f32
    }

    /// Fractions of the light of a wavelength within the core: as the table says, and in truth; the rest is wings.
    pub fn within_core(&self, nm: f32) -> [f64; 2] {
        let mm = f64::from(nm) * 1e-6;
        let scale = self.determinant.sqrt() / mm;
        let radius = self.all.core_mm * scale;
        let scaled = self.of(nm);
        let table = scaled.pattern.encircled(radius);
        // In units of the root of the aperture's area.
        let beyond = |w: f64| self.all.tail.as_ref().map_or(0.0, |tail| tail.beyond(w / scaled.side));
        let far = beyond(EXTENT);
        let outside = if radius < EXTENT { far + (1.0 - far) * (1.0 - table) } else { beyond(radius) };
        [table, 1.0 - outside]
    }

    /// A displacement on the film for a unit of wavelength (both mm), of the wings and of some of what lies nearer: to be multiplied by the wavelength, and
    /// left out if it is still within [`Diffraction::core_mm`]. By two even numbers, and two that need not be spread well. `None` where there are no wings.
    #[inline]
    pub fn wing(&self, [u, v]: [f32; 2], more: [f32; 2]) -> Option<DVec2> {
        // The same of all colours.
        let Scaled { pattern, side, wings_from } = &self.scaled[0];
        // Where the table ends before the wings begin, all of them are beyond it.
        let far = match &self.all.tail {
            None => 0.0,
            Some(_) if *wings_from >= EXTENT => 1.0,
            Some(tail) => {
                let far = tail.beyond(EXTENT / side);
                far / (far + (1.0 - far) * (1.0 - pattern.encircled(*wings_from)))
            }
        } as f32;
        let w = match &self.all.tail {
            Some(tail) if u < far => tail.draw(EXTENT.max(*wings_from) / side, [u / far, v], more) * *side,
            _ => pattern.draw_wings([((u - far) / (1.0 - far)).clamp(0.0, 0.999_999_9), v])?,
        };
        Some(self.film_from_table * w)
    }
}

impl TracedPupils {
    fn zone(&self, film: DVec2) -> &Zone {
        let ring = ((film.length() / self.radius * (RINGS - 1) as f64).round() as usize).min(RINGS - 1);
        if self.round {
            return &self.zones[ring];
        }
        let turn = film.y.atan2(film.x) / std::f64::consts::TAU;
        let direction = (turn.rem_euclid(1.0) * DIRECTIONS as f64).round() as usize % DIRECTIONS;
        &self.zones[ring * DIRECTIONS + direction]
    }

    /// Patterns of a film point, and the direction cosines of a step of one root of the pupil's area.
    fn cosines(&self, film: DVec2) -> (std::ops::Range<usize>, DMat2) {
        let zone = self.zone(film);
        let x = film.try_normalize().filter(|_| self.round).unwrap_or(DVec2::X);
        let turned = DMat2::from_cols(x, x.perp());
        let s = turned * zone.center - film * self.curvature;
        (zone.pattern..zone.pattern + zone.colors, foreshortening(s) * turned * zone.size)
    }

    /// By how much a ray from a film point at a place of the pupil misses in the plane of focus, mm on the film; nothing where that is left to the rays.
    fn delta(&self, film: DVec2, q: DVec2) -> DVec2 {
        let place = film.length() / self.radius * (RINGS - 1) as f64;
        let ring = |i: f64| self.wavefronts[(i as usize).min(RINGS - 1)].as_ref();
        // What the pattern of the nearest ring does not hold is left to the rays.
        if ring(place.round()).is_none() {
            return DVec2::ZERO;
        }
        let x = film.try_normalize().unwrap_or(DVec2::X);
        let q = DVec2::new(x.dot(q), x.perp().dot(q));
        let [low, high] =
            [ring(place.floor()), ring(place.ceil())].map(|w| w.or(ring(place.round())).map_or(DVec2::ZERO, |w| w.delta(q)));
        let delta = low.lerp(high, place.fract());
        x * delta.x + x.perp() * delta.y
    }

    /// Gives zones with aberrations patterns of their own.
    fn add_aberrations(&mut self, grids: &[PupilGrid], patterns: &mut Vec<Scaled>) {
        let directions = self.zones.len() / RINGS;
        for (i, (zone, grid)) in self.zones.iter_mut().zip(grids).enumerate() {
            let Some(wavefront) = &self.wavefronts[i / directions] else { continue };
            // Frames of rings lie along the film point, and so do pupils that turn with it.
            let angle = std::f64::consts::TAU * (i % directions) as f64 / directions as f64;
            let into_ring = DVec2::from_angle(-angle);
            let paths: Vec<f64> = grid.places().map(|q| wavefront.path(into_ring.rotate(q))).collect();
            let lit = || paths.iter().zip(&grid.amplitude).filter(|(_, a)| **a > 0.0).map(|(p, _)| *p);
            let (low, high) = lit().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
            if high - low < NO_PHASE * SHORTEST_MM {
                continue;
            }
            let base = &patterns[zone.pattern];
            let Scaled { wings_from, .. } = *base;
            let side = grid.filled().sqrt().recip();
            let of_color = |k: usize| {
                let mm = f64::from(COLORS_NM[0] + COLORS_NM[1] * k as f32) * 1e-6;
                let turns: Vec<f64> = paths.iter().map(|p| p / mm).collect();
                Scaled { pattern: base.pattern.with_phases(&grid.amplitude, &turns), side, wings_from }
            };
            let own: Vec<Scaled> = (0..COLORS).map(of_color).collect();
            (zone.pattern, zone.colors) = (patterns.len(), COLORS);
            patterns.extend(own);
        }
    }
}

/// Pupils of a real lens over a film that reaches so far, mm; those that differ in shape; and those of all zones.
fn traced(lens: &CompoundLens, reach: f64) -> Option<(TracedPupils, Vec<PupilGrid>, Vec<PupilGrid>)> {
    let batch = Batch::new(lens.system());
    let round = lens.system().is_rotational() && lens.system().iris.shape == Iris::Round;
    let directions = if round { 1 } else { DIRECTIONS };
    let place = |i: usize| {
        let angle = std::f64::consts::TAU * (i % directions) as f64 / directions as f64;
        DVec2::from_angle(angle) * (reach * (i / directions) as f64 / (RINGS - 1) as f64)
    };
    let mut found: Vec<Option<PupilGrid>> = vec![];
    for i in 0..RINGS * directions {
        // The axis is the same in all directions; where no light arrives it does not matter what it would look like: as nearer to the axis.
        let known = match i {
            0 => None,
            i if i < directions => found[0].clone(),
            _ => None,
        };
        let grid = known.or_else(|| PupilGrid::traced(lens, &batch, place(i)));
        found.push(grid.or_else(|| i.checked_sub(directions).and_then(|inner| found[inner].clone())));
    }
    let first = found.iter().flatten().next()?.clone();
    let of_zones: Vec<PupilGrid> = found.into_iter().map(|grid| grid.unwrap_or_else(|| first.clone())).collect();
    let (mut shapes, mut grids, mut zones): (Vec<Shape>, Vec<PupilGrid>, Vec<Zone>) = (vec![], vec![], vec![]);
    for grid in &of_zones {
        let shape = grid.shape();
        let pattern = shapes.iter().position(|s| s.agrees(&shape)).unwrap_or(shapes.len());
        zones.push(Zone { pattern, colors: 1, center: grid.center, size: grid.side * grid.filled().sqrt() });
        if pattern == shapes.len() {
            shapes.push(shape);
            grids.push(grid.clone());
        }
    }
    let curvature = lens.pupils().curvature;
    let wavefront = |ring: usize| {
        let (grid, radius) = (&of_zones[ring * directions], reach * ring as f64 / (RINGS - 1) as f64);
        let foreshortened = foreshortening(grid.center - DVec2::X * (radius * curvature));
        // Blades stand otherwise in other directions: all of the disk around them.
        let lit = |at: DVec2| if round { grid.is_lit(at) } else { at.length() <= 1.0 };
        let half = 0.5 * grid.side * if round { 1.0 } else { 1.1 };
        let wavefront = Wavefront::at(lens, radius, [grid.center, DVec2::splat(half)], foreshortened, lit)?;
        let frequencies = |mm: f64| mm * grid.side / SHORTEST_MM;
        (frequencies(wavefront.largest) < LARGEST && frequencies(wavefront.miss) < 0.2).then_some(wavefront)
    };
    let known = lens.system().is_rotational();
    let wavefronts = (0..RINGS).map(|ring| if known { wavefront(ring) } else { None }).collect();
    Some((TracedPupils { radius: reach, round, curvature, zones, wavefronts }, grids, of_zones))
}

#[cfg(test)]
mod tests;
