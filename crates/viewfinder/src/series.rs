//! Series: several pictures at one press of the release, an exposure bracket or a focus stack.
//!
//! The camera focuses and meters once, before the first picture. What it settled on is then written into a shot file for each picture, with its own time,
//! aperture or distance, its own seed and the moment at which it begins: each picture is the photograph of its own shot file, and is repeated by it alone.
//! A bracket is that of `[sequence] bracket` (the darkest first, one right after the other); a focus stack goes from near to far in equal steps
//! of 1 / distance, which are about equal steps of the focusing drive.

use crate::problem::Problem;
use diopter::quantity::{Distance, FNumber, FocusTo, Seconds};
use diopter::scene::light::Modulation;
use diopter::shot::sections::FocusSection;
use diopter::shot::{Shot, ShotFile, Vary};
use serde::{Deserialize, Serialize};

/// Fewest and most pictures of a series: as many as may wait.
pub const PICTURES: std::ops::RangeInclusive<u32> = 2..=36;
/// Largest step of a bracket, EV: that of the command line.
const LARGEST_STEP_EV: f64 = 10.0;
/// Nearest and farthest finite distances of a focus stack, m.
const DISTANCES_M: [f64; 2] = [1e-4, 1e9];

/// What is taken at one press of the release, beside a single picture.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Series {
    /// Exposures about the one that the camera would make, the darkest first.
    Bracket {
        /// Pictures.
        count: u32,
        /// From one to the next, EV.
        step_ev: f64,
    },
    /// Focus from one distance to another.
    Focus {
        /// Pictures.
        count: u32,
        /// The first, m from the lens.
        near_m: f64,
        /// The last, m; null or left out: infinity.
        far_m: Option<f64>,
    },
}

/// What a picture of a series differs in.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Differs {
    /// Its exposure, EV from that of the camera.
    Ev(f64),
    /// Its focus, m; `None`: infinity.
    FocusM(Option<f64>),
}

/// A picture of a series.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// The shot that takes it.
    pub file: ShotFile,
    /// What is its own.
    pub differs: Differs,
}

/// Whether a picture that begins at another moment is another one: the scene, the camera or light of the scene changes. A flash fires with the shutter.
pub(crate) fn changes_with_time(shot: &Shot) -> bool {
    let d = shot.scene.description();
    let changes = |m: &Modulation| !matches!(m, Modulation::Steady | Modulation::Pulse { .. });
    let flickers = d.materials.iter().any(|m| changes(&m.modulation())) || d.punctual.iter().any(|l| changes(&l.modulation));
    let carried = !shot.file().camera.path.is_empty() || shot.file().camera.shake.unwrap_or(0.0) != 0.0;
    flickers || carried || shot.scene.moves() || !shot.camera.motion.is_still()
}

impl Series {
    /// Fails on numbers that make no series.
    pub fn check(&self) -> Result<(), Problem> {
        let count = self.count();
        if !PICTURES.contains(&(count as u32)) {
            let expected = format!("{} to {} pictures", PICTURES.start(), PICTURES.end());
            return Err(Problem::new("series count", count.to_string(), expected));
        }
        match *self {
            Series::Bracket { step_ev, .. } if !(step_ev > 0.0 && step_ev <= LARGEST_STEP_EV) => {
                Err(Problem::new("series step", format!("{step_ev} EV"), format!("above 0 to {LARGEST_STEP_EV} EV")))
            }
            Series::Focus { near_m, far_m, .. } => {
                let [nearest, farthest] = DISTANCES_M;
                let far = far_m.unwrap_or(f64::INFINITY);
                if !(near_m >= nearest && near_m <= farthest) {
                    return Err(Problem::new("series near", format!("{near_m} m"), format!("a distance from {nearest} m on")));
                }
                if !(far > near_m && (far_m.is_none() || far <= farthest)) {
                    return Err(Problem::new(
                        "series far",
                        format!("{far} m"),
                        format!("a distance beyond {near_m} m, or infinity"),
                    ));
                }
                Ok(())
            }
            Series::Bracket { .. } => Ok(()),
        }
    }

    /// Number of pictures.
    pub fn count(&self) -> usize {
        match *self {
            Series::Bracket { count, .. } | Series::Focus { count, .. } => count as usize,
        }
    }

    /// The shots of all pictures. `shot`: focused and metered, and left at another setting; `settled`: its file with all written down that it chose
    /// ([`Shot::write_resolved`]). Fails where the lens cannot do what is asked.
    pub fn frames(&self, shot: &mut Shot, settled: &ShotFile) -> Result<Vec<Frame>, Problem> {
        // The mode is the camera's own until the file is settled; where nothing changes with time, the moment stays.
        let vary = shot.varies();
        let passes = changes_with_time(shot) && !settled.scene.frozen;
        let metered = light(shot);
        let (mut at_s, seed) = (shot.begun_s(), settled.render.seed.unwrap_or(1));
        let distances = match *self {
            Series::Focus { count, near_m, far_m } => {
                if shot.camera.lens.is_sharp_everywhere() {
                    return Err(Problem::new("series", "of focus, with a lens that has none", "a lens that focuses"));
                }
                let distances = distances(count, near_m, far_m);
                // Before anything is exposed: what the lens does not reach is told at once.
                for distance in distances.first().into_iter().chain(distances.last()) {
                    let focus = diopter::lens::Focus::at_mm(1000.0 * distance.unwrap_or(f64::INFINITY));
                    shot.camera.lens.refocused(focus).map_err(diopter::shot::ShotError::from)?;
                }
                distances
            }
            Series::Bracket { .. } => Vec::new(),
        };
        let mut frames = Vec::with_capacity(self.count());
        for k in 0..self.count() {
            let mut file = settled.clone();
            if k > 0 && passes {
                at_s += shot.shutter().total_s();
                file.scene.at = Some(Seconds(at_s));
            }
            file.render.seed = Some(seed.wrapping_add(k as u64));
            let differs = match *self {
                Series::Bracket { count, step_ev } => {
                    shot.bracket(k, count, step_ev, vary, &mut |_| ())?;
                    file.exposure.shutter = Some(Seconds(shot.facts().exposure_s));
                    if vary == Vary::Aperture {
                        file.exposure.aperture = Some(FNumber(shot.facts().f_number));
                    }
                    Differs::Ev((light(shot) / metered).log2())
                }
                Series::Focus { .. } => {
                    let distance = distances[k];
                    let to = FocusTo::Distance(Distance(distance.unwrap_or(f64::INFINITY)));
                    file.focus = FocusSection { distance: Some(to), ..Default::default() };
                    Differs::FocusM(distance)
                }
            };
            frames.push(Frame { file, differs });
        }
        Ok(frames)
    }
}

/// Light that a setting lets onto the film, relative: time over the square of the T-stop.
fn light(shot: &Shot) -> f64 {
    let facts = shot.facts();
    facts.exposure_s / facts.t_number.powi(2)
}

/// Distances (m; `None`: infinity) of a focus stack, the nearest first, in equal steps of 1 / distance; the ends are exact.
fn distances(count: u32, near_m: f64, far_m: Option<f64>) -> Vec<Option<f64>> {
    let [near, far] = [1.0 / near_m, far_m.map_or(0.0, |m| 1.0 / m)];
    let last = count.max(2) - 1;
    (0..count)
        .map(|k| match k {
            0 => Some(near_m),
            k if k == last => far_m,
            k => Some(1.0 / (near + (far - near) * f64::from(k) / f64::from(last))),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter::expose::ProgressReporter;
    use std::sync::atomic::AtomicBool;

    #[test]
    fn a_stack_is_even_in_one_over_distance() {
        let to_infinity = distances(5, 0.5, None);
        assert_eq!((to_infinity[0], to_infinity[4]), (Some(0.5), None));
        let steps: Vec<f64> = to_infinity.iter().map(|d| d.map_or(0.0, |m| 1.0 / m)).collect();
        assert!(steps.windows(2).all(|w| (w[0] - w[1] - 0.5).abs() < 1e-12), "{steps:?}");
        assert_eq!(distances(2, 1.0, Some(3.0)), [Some(1.0), Some(3.0)]);
    }

    #[test]
    fn numbers_that_make_no_series_are_refused() {
        let bracket = |count, step_ev| Series::Bracket { count, step_ev };
        let focus = |count, near_m, far_m| Series::Focus { count, near_m, far_m };
        for good in [bracket(2, 1.0 / 3.0), bracket(36, 10.0), focus(5, 0.3, None), focus(2, 0.3, Some(0.4))] {
            assert_eq!(good.check(), Ok(()), "{good:?}");
        }
        for (bad, place) in [
            (bracket(1, 1.0), "series count"),
            (bracket(37, 1.0), "series count"),
            (bracket(u32::MAX, 1.0), "series count"),
            (bracket(3, 0.0), "series step"),
            (bracket(3, -1.0), "series step"),
            (bracket(3, f64::NAN), "series step"),
            (focus(3, 0.0, None), "series near"),
            (focus(3, f64::INFINITY, None), "series near"),
            (focus(3, 2.0, Some(1.0)), "series far"),
            (focus(3, 2.0, Some(2.0)), "series far"),
            (focus(3, 2.0, Some(f64::NAN)), "series far"),
        ] {
            let problem = bad.check().unwrap_err();
            assert_eq!(problem.place.as_deref(), Some(place), "{problem:?}");
        }
    }

    /// A small shot, focused and metered, and its settled file.
    fn metered(change: impl FnOnce(&mut ShotFile)) -> (Shot, ShotFile) {
        let mut file = ShotFile::default();
        file.scene.file = Some("color-chart".into());
        file.render.size = Some(diopter::quantity::Size { width: 24, height: 16 });
        change(&mut file);
        let mut shot = Shot::prepare(&file, &mut |_| ()).unwrap();
        let go_on = AtomicBool::new(false);
        let watch = ProgressReporter { cancel: &go_on, progress: &|_| () };
        shot.focus(&watch, &mut |_| ()).unwrap();
        shot.meter(&watch, &mut |_| ()).unwrap();
        shot.write_resolved(&mut file);
        (shot, file)
    }

    fn evs(frames: &[Frame]) -> Vec<f64> {
        frames
            .iter()
            .map(|f| match f.differs {
                Differs::Ev(ev) => ev,
                Differs::FocusM(_) => f64::NAN,
            })
            .collect()
    }

    #[test]
    fn a_bracket_varies_time_and_in_mode_s_the_aperture() {
        let series = Series::Bracket { count: 3, step_ev: 1.0 };
        let (mut shot, settled) = metered(|f| f.exposure.aperture = Some(FNumber(8.0)));
        let time = settled.exposure.shutter.unwrap().0;
        let frames = series.frames(&mut shot, &settled).unwrap();
        for (k, factor) in [0.5, 1.0, 2.0].iter().enumerate() {
            let file = &frames[k].file;
            assert!((file.exposure.shutter.unwrap().0 / time - factor).abs() < 1e-12);
            assert_eq!(file.exposure.aperture, settled.exposure.aperture);
            // Noise of its own; before a chart that stands still the moment is the same.
            assert_eq!(file.render.seed, Some(settled.render.seed.unwrap() + k as u64));
            assert_eq!(file.scene.at, settled.scene.at);
        }
        assert!(evs(&frames).iter().zip([-1.0, 0.0, 1.0]).all(|(a, b)| (a - b).abs() < 1e-9), "{frames:?}");

        let (mut shot, settled) = metered(|f| (f.exposure.mode, f.exposure.shutter) = (Some("S".into()), Some(Seconds(0.01))));
        let aperture = settled.exposure.aperture.unwrap().0;
        let frames = series.frames(&mut shot, &settled).unwrap();
        for (frame, ev) in frames.iter().zip([-1.0f64, 0.0, 1.0]) {
            let n = frame.file.exposure.aperture.unwrap().0;
            assert!(
                frame.file.exposure.shutter == Some(Seconds(0.01)) && (n / aperture - (-0.5 * ev).exp2()).abs() < 1e-6,
                "{n}"
            );
        }
    }

    #[test]
    fn pictures_of_what_moves_follow_one_another() {
        let (mut shot, settled) = metered(|f| {
            f.camera.shake = Some(0.6);
            (f.exposure.mode, f.exposure.shutter) = (Some("M".into()), Some(Seconds(0.1)));
        });
        let frames = Series::Bracket { count: 3, step_ev: 1.0 }.frames(&mut shot, &settled).unwrap();
        let begins: Vec<f64> = frames.iter().map(|f| f.file.scene.at.unwrap().0).collect();
        // Each begins when the shutter of the one before has closed, curtains included.
        assert!(begins[0] == 0.0 && begins[1] >= 0.05 && begins[2] - begins[1] >= 0.1 && begins[2] < 0.3, "{begins:?}");
    }

    #[test]
    fn a_stack_needs_a_lens_that_reaches_its_ends() {
        let series = |near_m| Series::Focus { count: 3, near_m, far_m: None };
        let (mut shot, settled) = metered(|f| f.camera.lens = Some("tessar-50mm-f2.8".into()));
        let frames = series(0.8).frames(&mut shot, &settled).unwrap();
        let differs: Vec<Differs> = frames.iter().map(|f| f.differs).collect();
        assert_eq!(differs, [Some(0.8), Some(1.6), None].map(Differs::FocusM));
        assert!(matches!(&frames[1].file.focus.distance, Some(FocusTo::Distance(d)) if d.0 == 1.6));
        assert!(frames.iter().all(|f| f.file.exposure == settled.exposure));
        let near = series(0.01).frames(&mut shot, &settled).unwrap_err();
        assert!(near.message.contains("focus"), "{near:?}");
        let (mut pinhole, settled) = metered(|f| f.camera.lens = Some("pinhole".into()));
        assert!(series(0.8).frames(&mut pinhole, &settled).is_err());
    }
}
