//! How the exposure of a shot is found: mode, metering, limits.

use super::file::ShotFile;
use super::{ShotError, value};
use crate::metering::Pattern;
use crate::program::Mode;
use crate::quantity::Seconds;
use diopter_sensor::Sensor;
use std::ops::RangeInclusive;

/// Compensation and filters that are taken for meant.
const COMPENSATION_EV: RangeInclusive<f64> = -20.0..=20.0;
/// Brightening that raw files can say, EV.
const BASELINE_EV: RangeInclusive<f64> = -10.0..=10.0;

const FILTER_STOPS: RangeInclusive<f64> = 0.0..=40.0;

/// Highest speed that automatic ISO goes to by default: where grain begins to be disliked.
const DEFAULT_HIGHEST_ISO: f64 = 6400.0;

/// How the exposure is found.
#[derive(Clone, Debug)]
pub(super) struct Exposing {
    pub mode: Mode,
    pub pattern: Pattern,
    pub at: [f64; 2],
    pub compensation_ev: f64,
    /// By which pictures are brightened when they are developed, where that is asked for.
    pub baseline_ev: Option<f64>,
    pub nd_stops: f64,
    /// Automatic ISO: its limits.
    pub auto_iso: Option<[f64; 2]>,
    /// The limits of real dials hold.
    pub dials: bool,
    pub slowest_s: Option<f64>,
    pub step: Option<crate::stops::Step>,
}

impl Exposing {
    /// Checks what was asked of a body. Fails on names that are not known, on numbers out of range, and without a time where the mode leaves it to the photographer.
    pub fn new(file: &ShotFile, sensor: &Sensor) -> Result<Self, ShotError> {
        let e = &file.exposure;
        let mode = match e.mode.as_deref() {
            Some(name) => Mode::named(name).ok_or_else(|| value("mode", format!("\"{name}\""), "M, A (Av), S (Tv) or P"))?,
            None if e.shutter.is_some() => Mode::Manual,
            None => Mode::AperturePriority,
        };
        if e.shutter.is_none() && matches!(mode, Mode::Manual | Mode::ShutterPriority) && !e.lens_cap {
            return Err(value(
                "mode",
                mode.name(),
                "an exposure time beside it (--shutter 1/125): in this mode the camera does not choose it",
            ));
        }
        let pattern = match e.metering.as_deref() {
            // A place to look at means the spot.
            None if e.metering_at.is_some() => Pattern::Spot,
            None => Pattern::default(),
            Some(name) => Pattern::named(name).ok_or_else(|| {
                value("metering", format!("\"{name}\""), format!("one of {}", Pattern::NAMES.map(|n| n.0).join(", ")))
            })?,
        };
        let at = e.metering_at.unwrap_or([0.5; 2]);
        if !at.iter().all(|v| (0.0..=1.0).contains(v)) {
            return Err(value("metering_at", format!("{},{}", at[0], at[1]), "a place in the picture: 0 to 1 across and down"));
        }
        let compensation_ev = e.compensation.map_or(0.0, |c| c.0);
        if !COMPENSATION_EV.contains(&compensation_ev) {
            return Err(value("compensation", compensation_ev, "-20 to 20 EV"));
        }
        let baseline_ev = e.baseline.map(|b| b.0);
        if let Some(bad) = baseline_ev.filter(|ev| !BASELINE_EV.contains(ev)) {
            return Err(value("baseline", bad, "-10 to 10 EV"));
        }
        let nd_stops = e.nd.map_or(0.0, |n| n.0);
        if !FILTER_STOPS.contains(&nd_stops) {
            return Err(value("nd", nd_stops, "a filter of 0 to 40 stops, such as ND8 or \"3 stops\""));
        }
        let range = sensor.iso_range();
        let auto_iso = match e.iso {
            Some(crate::quantity::IsoChoice::Auto) => {
                let highest = e.iso_max.map_or(range[1].min(DEFAULT_HIGHEST_ISO.max(range[0])), |i| i.0);
                let lowest = e.iso_min.map_or(range[0], |i| i.0);
                sensor.at_iso(lowest)?;
                sensor.at_iso(highest)?;
                if lowest > highest {
                    return Err(value("iso_max", highest, format!("at least the lowest speed, ISO {lowest}")));
                }
                Some([lowest, highest])
            }
            _ => None,
        };
        if auto_iso.is_none() && (e.iso_max.is_some() || e.iso_min.is_some()) {
            return Err(value(
                "iso_min or iso_max",
                e.iso_max.or(e.iso_min).map_or(String::new(), |i| i.to_string()),
                "--iso auto beside it",
            ));
        }
        let slowest_s = e.slowest.map(|s| s.0);
        if slowest_s.is_some_and(|s| !(s > 0.0 && s.is_finite())) {
            return Err(value("slowest", slowest_s.map_or(String::new(), |s| Seconds(s).to_string()), "a time above 0"));
        }
        let step = match e.dial.as_deref() {
            None => None,
            Some(name) => Some(
                crate::stops::Step::NAMES
                    .iter()
                    .find(|n| n.0 == name)
                    .map(|n| n.1)
                    .ok_or_else(|| value("dial", format!("\"{name}\""), "full, half or third"))?,
            ),
        };
        let dials = e.mode.is_some();
        Ok(Exposing { mode, pattern, at, compensation_ev, baseline_ev, nd_stops, auto_iso, dials, slowest_s, step })
    }
}
