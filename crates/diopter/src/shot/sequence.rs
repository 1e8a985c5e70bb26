//! More than one picture: exposure series and films.

use super::file::ShotFile;
use super::{Shot, ShotError, value};
use crate::expose::Half;
use crate::program::Mode;
use crate::quantity::Seconds;

/// Most pictures of a series and of a film.
const MOST_PICTURES: u32 = 99;
const MOST_FRAMES: u32 = 1_000_000;
/// Frames a second by default: cinema.
pub(super) const FPS: f64 = 24.0;

/// What is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Sequence {
    /// One picture.
    Single,
    /// An exposure series about what was metered, the darkest first, one right after the other.
    Bracket {
        /// Pictures.
        count: u32,
        /// EV from one to the next.
        step_ev: f64,
        /// What differs; the mode says without.
        vary: Option<Vary>,
    },
    /// A focus series: the first as focused, each farther than the one before.
    Focus {
        /// Pictures.
        count: u32,
        /// From one to the next, in depths of focus; negative goes nearer.
        step: f64,
    },
    /// A film: exposed as the first frame was metered.
    Film {
        /// Frames.
        count: u32,
        /// Frames a second.
        fps: f64,
    },
    /// One exposure of a sensor whose pixels are split in two: what the left and what the right photodiode of each reads, that is the views through the left and
    /// the right half of the pupil.
    DualPixel,
    /// Exposures of falling length that a rolling sensor reads interleaved, row by row (staggered, or digital-overlap, HDR).
    Staggered {
        /// Exposures, 2 or 3.
        count: u32,
        /// How many times as long each is as the next.
        ratio: f64,
        /// Least time between the reading of a row and its next reset, s.
        gap_s: f64,
    },
}

/// Exposures that a sensor interleaves.
const STAGGERED: std::ops::RangeInclusive<u32> = 2..=3;
/// From one to the next of them by default: 4 EV, usual for digital overlap.
const STAGGERED_RATIO: f64 = 16.0;

/// What an exposure series varies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Vary {
    /// The exposure time.
    Time,
    /// The aperture.
    Aperture,
}

impl Vary {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Vary::Time => "time",
            Vary::Aperture => "aperture",
        }
    }
}

impl Sequence {
    /// What a shot file asks for. A shutter angle becomes an exposure time, which the camera then keeps (mode S) unless the aperture is
    /// set too. Fails on numbers out of range, on two series at once, and on a step or rate without the series that it belongs to.
    pub fn new(file: &mut ShotFile) -> Result<Self, ShotError> {
        let s = file.sequence.clone();
        if file.camera.dual_pixel || s.staggered.is_some() {
            let others = [s.bracket.is_some(), s.focus_bracket.is_some(), s.frames.is_some()];
            let both = file.camera.dual_pixel && s.staggered.is_some();
            let what = if s.staggered.is_some() { "staggered" } else { "dual_pixel" };
            if both || others.contains(&true) {
                let expected = "one of them: dual_pixel, staggered, bracket, focus_bracket, frames";
                return Err(value(what, "beside another series", expected));
            }
        }
        if let Some(count) = s.staggered {
            if !STAGGERED.contains(&count) {
                return Err(value("staggered", count, "2 or 3 exposures"));
            }
            let ratio = s.staggered_ratio.unwrap_or(STAGGERED_RATIO);
            if !(ratio > 1.0 && ratio <= 1000.0) {
                return Err(value(
                    "staggered_ratio",
                    ratio,
                    "above 1 to 1000: how many times as long each exposure is as the next",
                ));
            }
            let gap = s.staggered_gap.unwrap_or(Seconds(0.0));
            if !(0.0..=1.0).contains(&gap.0) {
                return Err(value("staggered_gap", gap, "0 s to 1 s between the reading of a row and its next reset"));
            }
            return Ok(Sequence::Staggered { count, ratio, gap_s: gap.0 });
        }
        if let Some(ratio) = s.staggered_ratio {
            return Err(value("staggered_ratio", ratio, "staggered beside it: how many exposures"));
        }
        if let Some(gap) = s.staggered_gap {
            return Err(value("staggered_gap", gap, "staggered beside it: how many exposures"));
        }
        if file.camera.dual_pixel {
            return Ok(Sequence::DualPixel);
        }
        if let Some(count) = s.focus_bracket {
            if s.bracket.is_some() || s.frames.is_some() {
                return Err(value("focus_bracket", count, "one series: of focus, of exposure (bracket) or a film (frames)"));
            }
            if !(1..=MOST_PICTURES).contains(&count) {
                return Err(value("focus_bracket", count, format!("1 to {MOST_PICTURES} pictures")));
            }
            let step = s.focus_step.unwrap_or(1.0);
            if !(step.is_finite() && step != 0.0 && step.abs() <= 1000.0) {
                return Err(value("focus_step", step, "up to 1000 depths of focus, not 0"));
            }
            return Ok(Sequence::Focus { count, step });
        }
        if let Some(step) = s.focus_step {
            return Err(value("focus_step", step, "focus_bracket beside it: how many pictures"));
        }
        if s.bracket.is_some() && s.frames.is_some() {
            return Err(value("bracket", s.bracket.unwrap_or(0), "either an exposure series or a film (frames), not both"));
        }
        if let Some(count) = s.bracket {
            if !(1..=MOST_PICTURES).contains(&count) {
                return Err(value("bracket", count, format!("1 to {MOST_PICTURES} pictures")));
            }
            let step_ev = s.step.map_or(1.0, |e| e.0);
            if !(step_ev.is_finite() && step_ev.abs() <= 10.0 && step_ev != 0.0) {
                return Err(value("step", step_ev, "up to 10 EV, not 0"));
            }
            let vary = match s.vary.as_deref() {
                None => None,
                Some("time") => Some(Vary::Time),
                Some("aperture") => Some(Vary::Aperture),
                Some(other) => return Err(value("vary", format!("\"{other}\""), "time or aperture")),
            };
            return Ok(Sequence::Bracket { count, step_ev: step_ev.abs(), vary });
        }
        if s.step.is_some() {
            return Err(value("step", s.step.map_or(0.0, |e| e.0), "bracket beside it: how many pictures"));
        }
        let fps = s.fps.unwrap_or(FPS);
        if !(fps > 0.0 && fps <= 1e7) {
            return Err(value("fps", fps, "above 0 frames a second"));
        }
        if let Some(angle) = s.shutter_angle_deg {
            if !(angle > 0.0 && angle <= 360.0) {
                return Err(value("shutter_angle", angle, "above 0 to 360 degrees: no frame is open longer than it lasts"));
            }
            if file.exposure.shutter.is_some() {
                return Err(value("shutter_angle", angle, "an angle or an exposure time, not both"));
            }
            file.exposure.shutter = Some(Seconds(angle / 360.0 / fps));
            if file.exposure.mode.is_none() && file.exposure.aperture.is_none() {
                file.exposure.mode = Some(Mode::ShutterPriority.name().into());
            }
            // The time stands for the angle from now on.
            file.sequence.shutter_angle_deg = None;
        }
        match s.frames {
            None if s.fps.is_some() && s.shutter_angle_deg.is_none() => Err(value("fps", fps, "frames beside it: how many")),
            None => Ok(Sequence::Single),
            Some(count) if (1..=MOST_FRAMES).contains(&count) => Ok(Sequence::Film { count, fps }),
            Some(count) => Err(value("frames", count, format!("1 to {MOST_FRAMES}"))),
        }
    }

    /// Number of pictures.
    pub fn count(&self) -> usize {
        match *self {
            Sequence::Single => 1,
            Sequence::DualPixel => 2,
            Sequence::Staggered { count, .. } => count as usize,
            Sequence::Bracket { count, .. } | Sequence::Film { count, .. } | Sequence::Focus { count, .. } => count as usize,
        }
    }

    /// Names of the pictures where they are no numbers.
    pub fn names(&self) -> Option<[&'static str; 2]> {
        matches!(self, Sequence::DualPixel).then_some(["left", "right"])
    }

    /// Whether its pictures can be merged into one of more range.
    pub fn is_mergeable(&self) -> bool {
        matches!(self, Sequence::Bracket { .. } | Sequence::Staggered { .. })
    }

    /// Refuses what a camera, as it is, cannot take. Fails on split pixels with a lens that is sharp everywhere, microlenses, a second reading, a quick look, stray light
    /// or a time limit, and on interleaved exposures with a flash or where rows are not reset one after the other.
    pub fn check(&self, shot: &Shot) -> Result<(), ShotError> {
        match self {
            Sequence::DualPixel => shot.can_split_pixels(),
            Sequence::Staggered { .. } => shot.can_stagger(),
            Sequence::Focus { count: 2.., .. } if shot.camera.lens.is_sharp_everywhere() => Err(value(
                "focus_bracket",
                "a lens that is sharp everywhere",
                "a lens that focuses: thin, a prescription, or a fisheye with --aperture",
            )),
            _ => Ok(()),
        }
    }

    /// Makes a metered shot ready for a picture of the sequence; pictures must be taken in order, from 0. Fails as [`Shot::advance_to`], and where the lens cannot be set.
    pub fn turn(&self, shot: &mut Shot, k: usize, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        let at = shot.at_s();
        match *self {
            Sequence::Single => Ok(()),
            Sequence::Film { fps, .. } => {
                let open = shot.shutter().exposure_s;
                if open > 1.0 / fps * (1.0 + 1e-9) {
                    warn(&format!(
                        "each frame is open for {open:.4} s, longer than it lasts at {fps} frames a second: they overlap"
                    ));
                }
                shot.advance_to(shot.begun_s() + k as f64 / fps, k as u64, warn)
            }
            Sequence::DualPixel => {
                shot.take_photodiode(if k == 0 { Half::Left } else { Half::Right });
                Ok(())
            }
            Sequence::Staggered { count, ratio, gap_s } => {
                let longest = shot.shutter().exposure_s * ratio.powi(k.saturating_sub(1) as i32);
                if k == 0 {
                    shot.interleave(count);
                } else {
                    shot.set_time(longest / ratio.powi(k as i32));
                }
                let times: Vec<f64> = (0..=k).map(|i| longest / ratio.powi(i as i32)).collect();
                let line_s = shot.line_time_s() / f64::from(count);
                let begins = staggered_starts(&times, line_s, count, gap_s);
                shot.advance_to(shot.begun_s() + begins[k], k as u64, warn)
            }
            Sequence::Focus { step, .. } => {
                let ended = if k == 0 { at } else { at + shot.shutter().total_s() };
                if k > 0 {
                    shot.refocus_by(-step * shot.depth_of_focus_mm(), warn)?;
                }
                shot.advance_to(ended, k as u64, warn)
            }
            Sequence::Bracket { count, step_ev, vary } => {
                let vary = vary.unwrap_or(shot.varies());
                let ended = if k == 0 { at } else { at + shot.shutter().total_s() };
                shot.bracket(k, count, step_ev, vary, warn)?;
                shot.advance_to(ended, k as u64, warn)
            }
        }
    }
}

/// When exposures of one row begin (s from the first), of times (s, the first the longest) that one converter reads.
///
/// A line lasts as long as all its exposures take to be read, `count` · `line_s`; exposure k has the k-th slot of each. It is read in the first slot of its own
/// that leaves its time and the gap since the exposure before was read, so that no two rows are read at once; it is reset its time before that. Rows
/// follow each other as those of the first do. Source: Sony, "DOL-HDR" (IMX sensors' data sheets): line-interleaved output with offsets between the exposures.
fn staggered_starts(times: &[f64], line_s: f64, count: u32, gap_s: f64) -> Vec<f64> {
    let period = f64::from(count) * line_s;
    let mut begins = vec![0.0];
    let mut read = times[0];
    for (k, time) in times.iter().enumerate().skip(1) {
        let (earliest, slot) = (read + gap_s + time, times[0] + k as f64 * line_s);
        read = match period > 0.0 {
            // A billionth of a line for what rounding leaves.
            true => slot + period * ((earliest - slot) / period - 1e-9).ceil().max(0.0),
            false => earliest,
        };
        begins.push(read - time);
    }
    begins
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quantity::Ev;

    #[test]
    fn interleaved_exposures_follow_each_other_and_never_share_a_slot() {
        for (times, line, gap) in
            [(vec![8e-3, 1e-3, 0.125e-3], 10e-6, 50e-6), (vec![2e-3, 1e-3], 15e-6, 0.0), (vec![1.0, 0.5, 0.25], 1e-3, 0.01)]
        {
            let count = times.len() as u32;
            let begins = staggered_starts(&times, line, count, gap);
            let reads: Vec<f64> = begins.iter().zip(&times).map(|(b, t)| b + t).collect();
            for k in 1..times.len() {
                let (waited, period) = (begins[k] - reads[k - 1], line * f64::from(count));
                // Not before the gap is over, and less than a line later.
                assert!(waited > gap - 1e-12 && waited < gap + period, "{waited} {gap}");
                // In its own slot of a line: that of the row read at the same time by another exposure is another.
                let slot = (reads[k] - reads[0]) / line;
                let off = (slot - k as f64).rem_euclid(f64::from(count));
                assert!(off.min(f64::from(count) - off) < 1e-6, "{k}: slot {slot}");
            }
        }
        // Without lines one follows right after the other.
        assert_eq!(staggered_starts(&[4.0, 2.0], 0.0, 2, 0.5), [0.0, 4.5]);
    }

    #[test]
    fn impossible_sequences_are_refused() {
        let with = |change: &dyn Fn(&mut ShotFile)| {
            let mut file = ShotFile::default();
            change(&mut file);
            Sequence::new(&mut file)
        };
        assert_eq!(with(&|_| ()).unwrap(), Sequence::Single);
        assert!(with(&|f| f.sequence.bracket = Some(0)).is_err());
        assert!(with(&|f| f.sequence.step = Some(Ev(1.0))).is_err());
        assert!(with(&|f| (f.sequence.frames, f.sequence.fps) = (Some(3), Some(-1.0))).is_err());
        assert!(with(&|f| (f.sequence.frames, f.sequence.bracket) = (Some(3), Some(3))).is_err());
        assert!(with(&|f| f.sequence.shutter_angle_deg = Some(400.0)).is_err());
        assert_eq!(with(&|f| f.camera.dual_pixel = true).unwrap(), Sequence::DualPixel);
        assert!(with(&|f| (f.camera.dual_pixel, f.sequence.frames) = (true, Some(3))).is_err());
        assert!(with(&|f| (f.camera.dual_pixel, f.sequence.staggered) = (true, Some(2))).is_err());
        let staggered = with(&|f| (f.sequence.staggered, f.sequence.staggered_ratio) = (Some(3), Some(8.0))).unwrap();
        assert_eq!(staggered, Sequence::Staggered { count: 3, ratio: 8.0, gap_s: 0.0 });
        assert!(with(&|f| f.sequence.staggered = Some(4)).is_err());
        assert!(with(&|f| (f.sequence.staggered, f.sequence.staggered_ratio) = (Some(2), Some(1.0))).is_err());
        assert!(with(&|f| f.sequence.staggered_gap = Some(Seconds(1e-3))).is_err());
        let mut film = ShotFile::default();
        (film.sequence.frames, film.sequence.fps, film.sequence.shutter_angle_deg) = (Some(2), Some(50.0), Some(180.0));
        assert_eq!(Sequence::new(&mut film).unwrap(), Sequence::Film { count: 2, fps: 50.0 });
        assert_eq!(film.exposure.shutter, Some(Seconds(0.01)));
    }
}
