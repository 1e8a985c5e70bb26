//! Shutters (global, leaf, focal-plane, rolling shutter): when light may pass, as a window of time for each place of the film, and of the pupil where blades open there.
//!
//! Times count from the moment the first light of the exposure passes. Places are those of the picture, 0 to 1 from its upper left
//! corner: *down* means that the top of the picture is exposed first.
//!
//! - Global: everything opens and closes at once.
//! - Leaf: blades before the pupil open from its middle outwards and close back. `exposure_s` is the effective time at the full aperture
//!   (∫ open fraction dt); smaller stops are cleared earlier and covered later and get more.
//! - Focal plane: one curtain uncovers the film, a second covers it again; both run at an even speed. Each point gets the marked
//!   time, different points at different moments.
//! - Rolling: rows of a sensor are reset one after the other, and read one after the other.
//!
//! Source: ISO 516:2019 (terms; efficiency = effective time / total time). Curtains are taken to lie on the film: no penumbra.

use diopter_image::{RowTimes, ShutterFacts};

/// Time of a curtain across the picture: Sony's A9 with its mechanical shutter, as measured by J. Kasson (about 3.5 ms).
pub const TRAVEL_S: f64 = 3.5e-3;
/// Read-out of a full frame: Nikon's Z 6, measured by horshack-dpreview (RollingShutter, full sensor).
pub const READOUT_S: f64 = 50.81e-3;
/// Blades of a leaf shutter, one way: a middle size; assumed (makers state 0.5 to 1.5 ms).
pub const RAMP_S: f64 = 1e-3;

/// Which way curtains or rows run, as seen in the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Direction {
    /// From the top.
    #[default]
    Down,
    /// From the bottom.
    Up,
    /// From the left.
    Right,
    /// From the right.
    Left,
}

impl Direction {
    /// Names as people write them.
    pub const NAMES: [(&'static str, Direction); 4] =
        [("down", Direction::Down), ("up", Direction::Up), ("right", Direction::Right), ("left", Direction::Left)];

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|n| n.1 == self).map_or("", |n| n.0)
    }

    /// Whether rows (not columns) follow each other.
    pub fn is_vertical(self) -> bool {
        matches!(self, Direction::Down | Direction::Up)
    }

    /// Whether the last line of the picture comes first.
    fn runs_backwards(self) -> bool {
        matches!(self, Direction::Up | Direction::Left)
    }

    /// How far along its way a place is, 0 to 1.
    fn along(self, [x, y]: [f64; 2]) -> f64 {
        match self {
            Direction::Down => y,
            Direction::Up => 1.0 - y,
            Direction::Right => x,
            Direction::Left => 1.0 - x,
        }
    }
}

/// How a shutter works.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum Mechanism {
    /// At once.
    #[default]
    Global,
    /// Blades at the pupil.
    Leaf {
        /// From closed to fully open, and from fully open to closed, s.
        ramp_s: f64,
    },
    /// Two curtains.
    FocalPlane {
        /// Time a curtain takes across the picture, s.
        travel_s: f64,
        /// The way it runs.
        direction: Direction,
    },
    /// Rows one after the other.
    Rolling {
        /// From the reset of the first row of the picture to what would be that of the row after its last, s; 0: all at once.
        reset_s: f64,
        /// The same for reading, s.
        readout_s: f64,
        /// The way it runs.
        direction: Direction,
    },
}

/// Shortest time that a shutter is set to, s.
const SHORTEST_S: f64 = 1e-7;

/// A shutter, set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shutter {
    /// How it works.
    pub mechanism: Mechanism,
    /// Marked exposure time, s.
    pub exposure_s: f64,
}

/// A place of the picture that light is gathered for.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// Column and row of the pixel.
    pub pixel: [usize; 2],
    /// Columns and rows of the picture.
    pub size: [usize; 2],
    /// Distance from the middle of the pupil, 1 at the rim of the fully open lens.
    pub pupil: f64,
}

impl Shutter {
    /// Opens and closes everywhere at once, for `exposure_s`.
    pub fn global(exposure_s: f64) -> Self {
        Shutter { mechanism: Mechanism::Global, exposure_s }
    }

    /// The time during which light may pass, s since the exposure began; empty (end before beginning) where blades never clear that part of the pupil.
    #[inline]
    pub fn window(&self, place: &Place) -> (f64, f64) {
        match self.mechanism {
            Mechanism::Global => (0.0, self.exposure_s),
            Mechanism::Leaf { ramp_s } => {
                let moving = self.blades(ramp_s);
                let cleared = place.pupil * ramp_s;
                (cleared, moving + moving.min(ramp_s) - cleared)
            }
            Mechanism::FocalPlane { travel_s, direction } => {
                // Curtains are where they are, not in steps of pixels; within a pixel the difference is nothing.
                let middle = |k: usize| (place.pixel[k] as f64 + 0.5) / place.size[k] as f64;
                let open = direction.along([middle(0), middle(1)]) * travel_s;
                (open, open + self.exposure_s)
            }
            Mechanism::Rolling { reset_s, readout_s, direction } => {
                let row = row_number(direction, place);
                (row * reset_s, row * readout_s + self.exposure_s)
            }
        }
    }

    /// Whether pixels are open at times of their own.
    pub(crate) fn differs_by_pixel(&self) -> bool {
        matches!(self.mechanism, Mechanism::FocalPlane { .. } | Mechanism::Rolling { .. })
    }

    /// From the first movement of the blades to the moment they turn back, s: with which the effective time at the full aperture is the marked one.
    ///
    /// A point at radius ρ is clear from ρ r to e + min(e, r) − ρ r; the mean over the disk is e − r / 3 when the blades open fully
    /// (e ≥ r), and 2 e³ / (3 r²) when they do not.
    fn blades(&self, ramp_s: f64) -> f64 {
        let full = self.exposure_s + ramp_s / 3.0;
        if full >= ramp_s { full } else { (1.5 * self.exposure_s * ramp_s * ramp_s).cbrt() }
    }

    /// From the first light to the last anywhere, s.
    pub fn total_s(&self) -> f64 {
        match self.mechanism {
            Mechanism::Global => self.exposure_s,
            Mechanism::Leaf { ramp_s } => {
                let moving = self.blades(ramp_s);
                moving + moving.min(ramp_s)
            }
            Mechanism::FocalPlane { travel_s, .. } => travel_s + self.exposure_s,
            Mechanism::Rolling { readout_s, .. } => readout_s + self.exposure_s,
        }
    }

    /// By how much longer the middle row is open than is set, s: where rows are reset faster than they are read.
    pub fn rows_beyond_s(&self) -> f64 {
        match self.mechanism {
            Mechanism::Rolling { reset_s, readout_s, .. } => 0.5 * (readout_s - reset_s),
            Mechanism::Global | Mechanism::Leaf { .. } | Mechanism::FocalPlane { .. } => 0.0,
        }
    }

    /// Mean time that a pupil of a radius (1: the fully open lens) is open, s, as the light through it counts it; where rows are open for different times, that of the middle one.
    pub fn effective_s(&self, pupil: f64) -> f64 {
        let ramp_s = match self.mechanism {
            Mechanism::Leaf { ramp_s } => ramp_s,
            Mechanism::Global | Mechanism::FocalPlane { .. } | Mechanism::Rolling { .. } => {
                return self.exposure_s + self.rows_beyond_s();
            }
        };
        let moving = self.blades(ramp_s);
        // ∫ (total − 2ρr) 2ρ dρ / R² up to R, or to where the blades reach.
        let (total, reach) = (moving + moving.min(ramp_s), pupil.min(if ramp_s > 0.0 { moving / ramp_s } else { 1.0 }));
        if pupil <= 0.0 {
            return total;
        }
        (total * reach.powi(2) - 4.0 / 3.0 * ramp_s * reach.powi(3)) / pupil.powi(2)
    }

    /// The marked time, s, whose effective time is `effective_s` for a pupil of a radius (1: the fully open lens).
    pub fn marked_for(&self, effective_s: f64, pupil: f64) -> f64 {
        match self.mechanism {
            Mechanism::Leaf { .. } => {}
            Mechanism::Rolling { .. } => return (effective_s - self.rows_beyond_s()).max(SHORTEST_S),
            Mechanism::Global | Mechanism::FocalPlane { .. } => return effective_s,
        }
        let effective = |marked: f64| Shutter { exposure_s: marked, ..*self }.effective_s(pupil);
        // The effective time grows with the marked one, and is never less.
        let (mut low, mut high) = (0.0, effective_s);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if effective(middle) < effective_s { low = middle } else { high = middle }
        }
        high
    }

    /// The moments, if there are any, between which the whole picture is open, s since the exposure began.
    pub fn fully_open(&self) -> Option<(f64, f64)> {
        let (from, to) = match self.mechanism {
            Mechanism::Global => (0.0, self.exposure_s),
            Mechanism::Leaf { ramp_s } => (ramp_s, self.blades(ramp_s)),
            Mechanism::FocalPlane { travel_s, .. } => (travel_s, self.exposure_s),
            Mechanism::Rolling { reset_s, .. } => (reset_s, self.exposure_s),
        };
        (from <= to).then_some((from, to))
    }

    /// Facts for files: times at which each row (or column) opens and closes, s. `size`: columns, rows of the picture; `pupil`: radius of the lens's, 1 when
    /// fully open.
    pub fn facts(&self, size: [usize; 2], pupil: f64) -> ShutterFacts {
        let lines = |direction: Direction| size[usize::from(direction.is_vertical())] as f64;
        let rows = match self.mechanism {
            Mechanism::Global => RowTimes { open_s: [0.0; 2], close_s: [self.exposure_s, 0.0], columns: false },
            // The middle of the pupil, which is open longest.
            Mechanism::Leaf { .. } => RowTimes { open_s: [0.0; 2], close_s: [self.total_s(), 0.0], columns: false },
            Mechanism::FocalPlane { travel_s, direction } => {
                let step = travel_s / lines(direction);
                RowTimes::running(
                    direction.runs_backwards(),
                    lines(direction),
                    [0.5 * step, step],
                    [0.5 * step + self.exposure_s, step],
                )
                .of_columns(!direction.is_vertical())
            }
            Mechanism::Rolling { reset_s, readout_s, direction } => {
                let n = lines(direction);
                RowTimes::running(direction.runs_backwards(), n, [0.0, reset_s / n], [self.exposure_s, readout_s / n])
                    .of_columns(!direction.is_vertical())
            }
        };
        let kind = match self.mechanism {
            Mechanism::Global => "global",
            Mechanism::Leaf { .. } => "leaf",
            Mechanism::FocalPlane { .. } => "focal-plane",
            Mechanism::Rolling { .. } => "rolling",
        };
        ShutterFacts { kind: kind.into(), total_s: self.total_s(), effective_s: self.effective_s(pupil), rows }
    }
}

/// Number of the row (or column), as a fraction of all of them, counted the way they run.
fn row_number(direction: Direction, place: &Place) -> f64 {
    let [x, y] = place.pixel;
    let [columns, rows] = place.size;
    match direction {
        Direction::Down => y as f64 / rows as f64,
        Direction::Up => (rows - 1 - y) as f64 / rows as f64,
        Direction::Right => x as f64 / columns as f64,
        Direction::Left => (columns - 1 - x) as f64 / columns as f64,
    }
}

/// Draws the moment of a sample.
///
/// Most light of a flash comes in a moment that even draws over a long exposure would hardly ever find: half of the draws go there.
#[derive(Clone, Copy, Debug, Default)]
pub struct ShutterTimes {
    /// When a flash burns, s.
    pub flash: Option<(f64, f64)>,
}

impl ShutterTimes {
    /// The part of a window in which a flash burns, if it does so and not all the time.
    fn flash_within(&self, (open, close): (f64, f64)) -> Option<(f64, f64)> {
        let overlap = self.flash.map(|(a, b)| (a.max(open), b.min(close))).filter(|(a, b)| a < b);
        overlap.filter(|(a, b)| b - a < close - open)
    }

    /// A moment within a window (not empty) by an even number, and one over its density, s.
    #[inline]
    pub fn draw(&self, (open, close): (f64, f64), u: f64) -> (f64, f64) {
        let length = close - open;
        let moment = match self.flash_within((open, close)) {
            Some((a, b)) if u < 0.5 => a + (b - a) * (2.0 * u),
            Some(_) => open + length * (2.0 * u - 1.0),
            None => open + length * u,
        };
        (moment, self.seconds_at((open, close), moment))
    }

    /// One over the density with which [`ShutterTimes::draw`] draws a moment of a window, s.
    #[inline]
    pub fn seconds_at(&self, (open, close): (f64, f64), moment: f64) -> f64 {
        let length = close - open;
        match self.flash_within((open, close)) {
            None => length,
            Some((a, b)) => 1.0 / (0.5 / length + if (a..b).contains(&moment) { 0.5 / (b - a) } else { 0.0 }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(pixel: [usize; 2], pupil: f64) -> Place {
        Place { pixel, size: [8, 4], pupil }
    }

    #[test]
    fn rows_roll_the_way_they_should() {
        let rolling =
            |direction| Shutter { mechanism: Mechanism::Rolling { reset_s: 4.0, readout_s: 4.0, direction }, exposure_s: 0.5 };
        let first = |d, pixel| rolling(d).window(&at(pixel, 0.0)).0;
        assert_eq!(first(Direction::Down, [0, 0]), 0.0);
        assert_eq!(first(Direction::Down, [0, 3]), 3.0);
        assert_eq!(first(Direction::Up, [0, 3]), 0.0);
        assert_eq!(first(Direction::Right, [2, 0]), 1.0);
        assert_eq!(first(Direction::Left, [7, 0]), 0.0);
        // Global reset: later rows gather longer.
        let release = Shutter {
            mechanism: Mechanism::Rolling { reset_s: 0.0, readout_s: 4.0, direction: Direction::Down },
            exposure_s: 0.5,
        };
        assert_eq!(release.window(&at([0, 3], 0.0)), (0.0, 3.5));
        // What travels with the picture says the same.
        for d in Direction::NAMES.map(|d| d.1) {
            let facts = rolling(d).facts([8, 4], 1.0);
            for k in 0..4 {
                let line = if d.is_vertical() { [0, k] } else { [k, 0] };
                let (open, close) = rolling(d).window(&at(line, 0.0));
                let (o, c) = facts.rows.of(k);
                assert!((open - o).abs() < 1e-12 && (close - c).abs() < 1e-12, "{d:?} {k}");
            }
        }
    }

    #[test]
    fn the_effective_time_of_a_leaf_shutter_is_the_marked_one_when_fully_open() {
        for (exposure_s, ramp_s) in [(1.0 / 60.0, 1e-3), (1.0 / 500.0, 1e-3), (1.0 / 2000.0, 1e-3), (1e-4, 1e-3)] {
            let shutter = Shutter { mechanism: Mechanism::Leaf { ramp_s }, exposure_s };
            for stopped in [1.0, 0.5, 0.1] {
                let n = 4000;
                let mean = (0..n)
                    .map(|i| {
                        let (a, b) = shutter.window(&at([0, 0], stopped * ((f64::from(i) + 0.5) / f64::from(n)).sqrt()));
                        (b - a).max(0.0)
                    })
                    .sum::<f64>()
                    / f64::from(n);
                assert!((mean / shutter.effective_s(stopped) - 1.0).abs() < 2e-3, "{exposure_s} {stopped}");
                assert!((shutter.marked_for(mean, stopped) / exposure_s - 1.0).abs() < 5e-3);
                if stopped == 1.0 {
                    assert!((mean / exposure_s - 1.0).abs() < 2e-3, "{exposure_s}: {mean}");
                }
            }
        }
    }

    #[test]
    fn curtains_give_every_point_the_same_time() {
        let shutter = Shutter { mechanism: Mechanism::FocalPlane { travel_s: 3e-3, direction: Direction::Up }, exposure_s: 1e-3 };
        for y in 0..4 {
            let (a, b) = shutter.window(&at([3, y], 0.3));
            assert!((b - a - 1e-3).abs() < 1e-12 && (a - 3e-3 * (3.5 - y as f64) / 4.0).abs() < 1e-12);
        }
        assert_eq!(shutter.fully_open(), None);
    }

    #[test]
    fn moments_are_weighted_to_the_true_mean() {
        // Mean of t over the window, with and without a flash in it.
        for flash in [None, Some((0.7, 0.72)), Some((-1.0, 0.1)), Some((0.9, 3.0)), Some((5.0, 6.0)), Some((-1.0, 4.0))] {
            let shutter_times = ShutterTimes { flash };
            let n = 100_000;
            let (mut mass, mut mean) = (0.0, 0.0);
            for i in 0..n {
                let (t, weight) = shutter_times.draw((0.0, 2.0), (i as f64 + 0.5) / n as f64);
                assert!((0.0..=2.0).contains(&t));
                mass += weight / n as f64;
                mean += t * weight / n as f64;
            }
            assert!((mass - 2.0).abs() < 1e-3 && (mean - 2.0).abs() < 1e-3, "{flash:?}: {mass} {mean}");
        }
    }
}
