//! Ways in which a sensor reads one exposure more than once: split pixels, interleaved rows.
//!
//! # Dual pixel
//!
//! Each pixel is two photodiodes under one microlens, which see the left and the right half of the exit pupil. Both gather light at the same time; the samples of one
//! half of the pupil are those that the other leaves out, so that the electrons of both add up to those of the whole pixel. Each photodiode is read by itself, as in
//! the captures of phones (Garg et al. 2019, "Learning Single Camera Depth Estimation Using Dual-Pixels") and the two frames of Canon's Dual Pixel RAW
//! (Abuolaim & Brown 2020, "Defocus Deblurring Using Dual-Pixel Data"): half the full well and half the dark current each, noise of its own, the whole read noise of
//! the ISO speed in each reading. The split is ideal: no light of one half reaches the other's photodiode, and diffraction is that of the whole pupil.
//!
//! # Staggered exposures
//!
//! [`super::Sequence::Staggered`]: rows are read as often as there are exposures, so that a line takes as many times as long.

use super::{Shot, ShotError, value};
use crate::expose::Half;
use crate::shutter::Mechanism;

impl Shot {
    /// Refuses what gives no two halves of the pupil, or would not add up.
    pub(super) fn can_split_pixels(&self) -> Result<(), ShotError> {
        let expected = if self.camera.lens.is_sharp_everywhere() {
            "a lens with an aperture: what is sharp everywhere has no halves of a pupil"
        } else if self.camera.film.microlenses.is_some() {
            "no microlens array before the sensor: it divides the pupil itself"
        } else if self.sensor.second_reading.is_some() {
            "a body whose pixels are read once: this one's are split into large and small ones"
        } else if self.file.render.quick {
            "no quick look: its blur is that of the whole pupil"
        } else if self.settings.stray.is_added() {
            "no stray light: which half of the pupil it comes through is not known"
        } else if self.settings.time_limit_s.is_some() {
            "no time limit: both halves take the same samples (--spp)"
        } else {
            return Ok(());
        };
        Err(value("dual_pixel", "split pixels", expected))
    }

    /// Reads one photodiode of each pixel from now on.
    pub(super) fn take_photodiode(&mut self, half: Half) {
        let name = match half {
            Half::Left => "left",
            Half::Right => "right",
        };
        if self.settings.half.is_none() {
            self.facts.serial.clone_from(&self.reading.serial);
            self.half_ev = self.sensor.brightening_of_half_ev();
            self.sensor.full_well_e *= 0.5;
            self.sensor.dark_current.points.iter_mut().for_each(|point| point[1] *= 0.5);
        }
        self.settings.half = Some(half);
        self.facts.photodiodes = name.into();
        // Fixed patterns and noise of its own: other draws of the same body.
        self.reading.serial = format!("{}, {name} photodiodes", self.facts.serial);
        self.reading.seed = self.settings.seed ^ if half == Half::Right { 0x9e37_79b9_7f4a_7c15 } else { 0 };
    }

    /// Refuses shutters whose rows do not follow each other.
    pub(super) fn can_stagger(&self) -> Result<(), ShotError> {
        let expected = "a rolling shutter whose rows are reset one after the other, such as --readout 15ms";
        match self.timing.mechanism {
            _ if self.timing.flash.is_some() => {
                Err(value("staggered", "interleaved exposures with a flash", "no flash: it would light one of them alone"))
            }
            Mechanism::Rolling { reset_s, readout_s, .. } if reset_s == readout_s => Ok(()),
            Mechanism::Rolling { .. } => Err(value("staggered", "a reset of all rows at once", expected)),
            _ => Err(value("staggered", "another shutter", expected)),
        }
    }

    /// Reads each row so many times before the next.
    pub(super) fn interleave(&mut self, count: u32) {
        if let Mechanism::Rolling { reset_s, readout_s, .. } = &mut self.timing.mechanism {
            *reset_s *= f64::from(count);
            *readout_s *= f64::from(count);
        }
    }

    /// From one row to the next as they are read, s; 0 where all are read at once.
    pub(super) fn line_time_s(&self) -> f64 {
        let Mechanism::Rolling { readout_s, direction, .. } = self.timing.mechanism else { return 0.0 };
        let film = &self.camera.film;
        readout_s / if direction.is_vertical() { film.rows } else { film.columns } as f64
    }

    /// Sets the exposure time, s.
    pub(super) fn set_time(&mut self, exposure_s: f64) {
        self.shutter = Some(exposure_s);
    }
}
