//! More than one picture: exposure series and films.

use super::file::ShotFile;
use super::{Shot, ShotError, value};
use crate::program::Mode;
use crate::quantity::Seconds;

/// Most pictures of a series and of a film.
const MOST_PICTURES: u32 = 99;
const MOST_FRAMES: u32 = 1_000_000;
/// Frames a second when nobody says: cinema.
pub(super) const FPS: f64 = 24.0;

/// What is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
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
}

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
    /// set too.
    pub fn new(file: &mut ShotFile) -> Result<Self, ShotError> {
        let s = file.sequence.clone();
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
            Sequence::Bracket { count, .. } | Sequence::Film { count, .. } | Sequence::Focus { count, .. } => count as usize,
        }
    }

    /// Makes a metered shot ready for a picture of the sequence; pictures must be taken in order, from 0.
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
                shot.turn_to(shot.begun_s() + k as f64 / fps, k as u64, warn)
            }
            Sequence::Focus { step, .. } => {
                let ended = if k == 0 { at } else { at + shot.shutter().total_s() };
                if k > 0 {
                    shot.refocus_by(-step * shot.depth_of_focus_mm(), warn)?;
                }
                shot.turn_to(ended, k as u64, warn)
            }
            Sequence::Bracket { count, step_ev, vary } => {
                let vary = vary.unwrap_or(shot.varies());
                let ended = if k == 0 { at } else { at + shot.shutter().total_s() };
                shot.expose_by(if k == 0 { -0.5 * f64::from(count - 1) * step_ev } else { step_ev }, vary, warn)?;
                shot.turn_to(ended, k as u64, warn)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quantity::Ev;

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
        let mut film = ShotFile::default();
        (film.sequence.frames, film.sequence.fps, film.sequence.shutter_angle_deg) = (Some(2), Some(50.0), Some(180.0));
        assert_eq!(Sequence::new(&mut film).unwrap(), Sequence::Film { count: 2, fps: 50.0 });
        assert_eq!(film.exposure.shutter, Some(Seconds(0.01)));
    }
}
