//! The part of the entrance pupil through which a lens passes light to the film, by direction.

use super::{LEAST_COSINE, of_lane};
use crate::camera::Camera;
use diopter_lens::Lens;
use diopter_lens::batch::single::LANES;
use diopter_lens::compound::{ExitRays, Samples, Scratch};
use glam::{DVec2, DVec3};

/// Film points across and down from which the pupil is looked at.
const FILM_POINTS: [usize; 2] = [48, 32];
/// Cells a side of the table of directions.
const CELLS: usize = 24;
/// Room around the places that were found, of their extent.
const ROOM: f64 = 0.04;

/// A rectangle of the plane of the entrance pupil, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rectangle {
    pub min: DVec2,
    pub max: DVec2,
}

impl Rectangle {
    fn union(self, other: Rectangle) -> Rectangle {
        Rectangle { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Its area, mm².
    pub fn area(&self) -> f64 {
        let size = self.max - self.min;
        size.x * size.y
    }
}

/// Which part of the plane of the entrance pupil passes light to the film, by direction: the way back of [`diopter_lens::pupil`], as loose as
/// rectangles are.
pub(super) struct Entrance {
    /// Largest angle to the axis, rad.
    largest: f64,
    /// `[row][column]` over the angle to the axis along x and y (equidistant).
    cells: Vec<Option<Rectangle>>,
}

impl Entrance {
    /// From rays that leave the lens: place in the plane of the entrance pupil and direction.
    fn new(rays: &[(DVec2, DVec3)]) -> Option<Entrance> {
        let angle = |d: &DVec3| d.truncate().length().atan2(-d.z);
        let largest = rays.iter().map(|r| angle(&r.1)).fold(0.0, f64::max) * (1.0 + 1e-9);
        if !(largest > 0.0) {
            return None;
        }
        let mut table = Entrance { largest, cells: vec![None; CELLS * CELLS] };
        for (at, direction) in rays {
            if let Some(cell) = table.cell(*direction) {
                let here = Rectangle { min: *at, max: *at };
                table.cells[cell] = Some(table.cells[cell].map_or(here, |r| r.union(here)));
            }
        }
        // The neighbours', too: lamps out of focus are seen under other angles from the rim of the pupil than from its middle.
        let around = |cell: usize| {
            let (x, y) = (cell % CELLS, cell / CELLS);
            let rows = y.saturating_sub(1)..(y + 2).min(CELLS);
            let all = rows.flat_map(|j| (x.saturating_sub(1)..(x + 2).min(CELLS)).map(move |i| j * CELLS + i));
            let found = all.filter_map(|cell| table.cells[cell]).reduce(Rectangle::union)?;
            let room = (found.max - found.min) * ROOM;
            let grown = Rectangle { min: found.min - room, max: found.max + room };
            (grown.area() > 0.0).then_some(grown)
        };
        let cells = (0..CELLS * CELLS).map(around).collect();
        Some(Entrance { cells, ..table })
    }

    /// The entrance of a camera, whose lens is thin or real.
    pub fn of(camera: &Camera) -> Option<Entrance> {
        let [across, down] = FILM_POINTS;
        let film = |k: usize| {
            let at = |i: usize, n: usize, pixels: usize| i as f64 / (n - 1) as f64 * pixels as f64;
            camera.film_point(at(k % across, across, camera.film.columns), at(k / across, down, camera.film.rows))
        };
        // Places of the pupil that go on from film point to film point (Roberts 2018, the R2 sequence).
        let place = |k: usize| [0.754_877_666, 0.569_840_296].map(|step: f64| ((k as f64 + 0.5) * step).fract() as f32);
        let mut rays = Vec::with_capacity(across * down * LANES);
        let mut found = |origin: DVec3, direction: DVec3| {
            if -direction.z > LEAST_COSINE {
                rays.push(((origin - direction * (origin.z / direction.z)).truncate(), direction));
            }
        };
        match &camera.lens {
            Lens::Compound(lens) => {
                let (mut samples, mut scratch, mut exits) = (Samples::default(), Scratch::default(), ExitRays::default());
                for k in 0..across * down {
                    samples.film = [film(k); LANES];
                    samples.pupil = std::array::from_fn(|i| place(k * LANES + i));
                    lens.trace_to_scene(&samples, |_, _| true, &mut scratch, &mut exits);
                    for i in (0..LANES).filter(|i| exits.passed >> i & 1 == 1) {
                        found(of_lane(exits.origin[i]), of_lane(exits.direction[i]));
                    }
                }
            }
            lens => {
                for k in 0..across * down * LANES {
                    if let Ok(ray) = lens.ray(film(k / LANES), place(k)) {
                        found(ray.origin_mm, ray.direction);
                    }
                }
            }
        }
        Entrance::new(&rays)
    }

    /// Cell of a direction towards the scene (of any length).
    fn cell(&self, direction: DVec3) -> Option<usize> {
        let across = direction.truncate();
        let length = across.length();
        let angle = length.atan2(-direction.z);
        if !(angle <= self.largest) {
            return None;
        }
        let place = if length > 0.0 { across * (angle / (length * self.largest)) } else { DVec2::ZERO };
        let [x, y] = place.to_array().map(|v| (((0.5 * v + 0.5) * CELLS as f64) as usize).min(CELLS - 1));
        Some(y * CELLS + x)
    }

    /// The part of the pupil for light from a place of the camera's frame.
    pub fn rectangle(&self, place: DVec3) -> Option<&Rectangle> {
        self.cells[self.cell(place)?].as_ref()
    }
}
