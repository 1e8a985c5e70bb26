//! What moves within a camera during an exposure: a group of its lens, or its sensor.

use diopter_lens::{CompoundLens, Lens, LensError};
use glam::{DMat2, DVec2};
use std::fmt::Write;

/// Most places at which a group is traced in an exposure.
pub const MOST_LENSES: usize = 64;

/// What moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum StabiliserPart {
    /// The sensor.
    Sensor,
    /// First and last surface of a group, 0 the first of the lens as it stands (a hood comes first).
    Group([usize; 2]),
}

/// What moves in a camera during an exposure.
#[derive(Clone, Debug, PartialEq)]
pub struct MovingPart {
    part: StabiliserPart,
    span_s: f64,
    /// Where it stands at equal steps, mm to the right and up as seen from behind the camera.
    path: Vec<DVec2>,
    /// The lens in the middle of equal parts of the exposure, and where its group stands there, mm; none where the sensor moves.
    lenses: Vec<(DVec2, Lens)>,
    /// How far the picture of what is in focus moves on the film (mm, in the axes of the lens) for a mm of it.
    image: DMat2,
    /// Whether it has come to its stop.
    stopped: bool,
}

/// A moment of what moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovingState {
    /// s since the exposure began.
    pub time_s: f64,
    /// mm to the right and up as seen from behind the camera.
    pub at_mm: DVec2,
    /// How far that moves the picture, pixels to the right and down.
    pub picture_px: DVec2,
}

impl MovingPart {
    /// What moves along a path (at equal steps of an exposure, mm to the right and up as seen from behind the camera); a mm of it moves the picture of what is in focus
    /// by a column of `image`, mm on the film in the axes of the lens. `stopped`: whether it came to its stop.
    pub(crate) fn new(part: StabiliserPart, span_s: f64, path: Vec<DVec2>, image: DMat2, stopped: bool) -> Self {
        MovingPart { part, span_s, path, lenses: Vec::new(), image, stopped }
    }

    /// The same with the lens traced where its group stands in the middle of equal parts of the exposure: as many as keep what is left below a pixel (mm), at most
    /// [`MOST_LENSES`]. Fails on groups that the lens does not have.
    pub(crate) fn traced(mut self, lens: &CompoundLens, group: [usize; 2], pixel_mm: f64) -> Result<Self, LensError> {
        let way: f64 = self.path.windows(2).map(|w| (self.image * (w[1] - w[0])).length()).sum();
        let count = ((way / pixel_mm).ceil() as usize).clamp(1, MOST_LENSES);
        let middle = |k: usize| self.at((k as f64 + 0.5) / count as f64 * self.span_s);
        let lenses = (0..count).map(|k| Ok((middle(k), Lens::Compound(Box::new(lens.with_group_at(group, middle(k))?)))));
        self.lenses = lenses.collect::<Result<_, LensError>>()?;
        Ok(self)
    }

    /// What moves.
    pub fn part(&self) -> StabiliserPart {
        self.part
    }

    /// Whether it came to its stop.
    pub fn stopped(&self) -> bool {
        self.stopped
    }

    /// Where it stands, mm to the right and up as seen from behind the camera, at a time since the exposure began, s.
    pub fn at(&self, time_s: f64) -> DVec2 {
        let last = self.path.len() - 1;
        if last == 0 || self.span_s <= 0.0 {
            return self.path[0];
        }
        let x = (time_s / self.span_s).clamp(0.0, 1.0) * last as f64;
        let k = (x as usize).min(last - 1);
        self.path[k].lerp(self.path[k + 1], x - k as f64)
    }

    /// Farthest that it stands from the axis, mm.
    pub fn farthest_mm(&self) -> f64 {
        self.path.iter().map(|at| at.length()).fold(0.0, f64::max)
    }

    /// Number of the part of the exposure that a time lies in, among those that have a lens of their own.
    pub(crate) fn index(&self, time_s: f64) -> usize {
        let count = self.lenses.len();
        if self.span_s <= 0.0 || count == 0 {
            return 0;
        }
        (((time_s / self.span_s).max(0.0) * count as f64) as usize).min(count - 1)
    }

    /// The lenses of equal parts of the exposure; none where the sensor moves.
    pub(crate) fn lenses(&self) -> impl ExactSizeIterator<Item = &Lens> {
        self.lenses.iter().map(|(_, lens)| lens)
    }

    /// The lens as it stands; `central`: with nothing moved.
    pub(crate) fn lens<'a>(&'a self, central: &'a Lens, time_s: f64) -> &'a Lens {
        self.lenses.get(self.index(time_s)).map_or(central, |(_, lens)| lens)
    }

    /// How far from its place on the film a pixel collects light through [`MovingPart::lens`], mm in the axes of the lens.
    pub(crate) fn film_shift(&self, time_s: f64) -> DVec2 {
        let from = self.lenses.get(self.index(time_s)).map_or(DVec2::ZERO, |(at, _)| *at);
        -(self.image * (self.at(time_s) - from))
    }

    /// Where it stands at some times (s since the exposure began), and what that does to the picture; `film_mm` and `size`: its width and height, mm and pixels.
    pub fn states(&self, times_s: impl IntoIterator<Item = f64>, film_mm: [f64; 2], size: [usize; 2]) -> Vec<MovingState> {
        let state = |time_s: f64| {
            let at_mm = self.at(time_s);
            let [x, y] = (self.image * at_mm).to_array();
            let picture_px = DVec2::new(-x * size[0] as f64 / film_mm[0], y * size[1] as f64 / film_mm[1]);
            MovingState { time_s, at_mm, picture_px }
        };
        times_s.into_iter().map(state).collect()
    }

    /// `count` + 1 moments at equal steps over the exposure, s since it began, both ends included.
    pub fn moments(&self, count: usize) -> Vec<f64> {
        (0..=count).map(|i| self.span_s * i as f64 / count as f64).collect()
    }
}

/// A table of what moves, as text: time (ns, scene time), place (mm), what that does to the picture (px). `at_s`: scene time at which the times of the states begin.
pub fn csv(states: &[MovingState], at_s: f64) -> String {
    let mut text = String::from("#timestamp [ns],x [mm],y [mm],picture_x [px],picture_y [px]\n");
    for s in states {
        let (ns, at, px) = (((at_s + s.time_s) * 1e9).round() as i64, s.at_mm, s.picture_px);
        let _ = writeln!(text, "{ns},{},{},{},{}", at.x, at.y, px.x, px.y);
    }
    text
}
