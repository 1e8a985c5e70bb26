//! Modes: who chooses aperture, time and speed for the light that was metered.
//!
//! The program line shares the light evenly between aperture and time, from a corner on: the lens fully open at one over the focal
//! length (as on 36 × 24 mm). Darker than that, the time grows; where the aperture is at its smallest, the time shrinks alone. Canon's
//! EOS 10D with a 50 mm f/1.4 does the same: EV 11.5 → f/3.5, 1/250 s (its manual, p. 165); ours gives f/3.3, 1/270 s. With automatic ISO the
//! speed rises, up to its limit, before the time grows beyond the slowest that hands can hold.

use crate::metering::shutter_for;
use crate::stops::{self, Step};

/// Who chooses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Mode {
    /// All is set by hand.
    Manual,
    /// Aperture by hand, time by the camera.
    AperturePriority,
    /// Time by hand, aperture by the camera.
    ShutterPriority,
    /// Both by the camera.
    Program,
}

impl Mode {
    /// Letters on the dial.
    pub const NAMES: [(&'static str, Mode); 4] =
        [("M", Mode::Manual), ("A", Mode::AperturePriority), ("S", Mode::ShutterPriority), ("P", Mode::Program)];

    /// Its letter.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|n| n.1 == self).map_or("", |n| n.0)
    }

    /// The mode of a letter; `Av` and `Tv` are A and S. `None` of others.
    pub fn named(name: &str) -> Option<Mode> {
        match name.trim().to_uppercase().as_str() {
            "AV" => Some(Mode::AperturePriority),
            "TV" => Some(Mode::ShutterPriority),
            letter => Self::NAMES.iter().find(|n| n.0 == letter).map(|n| n.1),
        }
    }
}

/// What the camera may choose from. Apertures are of brightness (T-stops): what the light goes by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Widest and smallest aperture.
    pub aperture: [f64; 2],
    /// Shortest and longest time, s.
    pub time_s: [f64; 2],
    /// ISO speeds of automatic ISO; the same twice when it is set by hand.
    pub iso: [f64; 2],
    /// The slowest time that hands can hold, s: automatic ISO keeps to it while it can, the program turns there.
    pub handheld_s: f64,
    /// Dials that click.
    pub step: Option<Step>,
    /// By how much longer light comes in than the time's dial says, s.
    pub beyond_mark_s: f64,
    /// T-stop over f-number of the lens: its dial has f-numbers.
    pub t_per_f: f64,
}

/// Aperture, time and speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chosen {
    /// f-number (T).
    pub aperture: f64,
    /// s
    pub time_s: f64,
    /// ISO speed.
    pub iso: f64,
}

/// Chooses what a mode leaves open for a metered EV100 (compensation subtracted); `set` holds what is set by hand, and the start for
/// the rest. Apertures are T-numbers, times s. What is chosen keeps within `limits`, so that the exposure can miss the EV; limits that are no numbers limit nothing.
pub fn choose(mode: Mode, ev100: f64, set: Chosen, limits: &Limits) -> Chosen {
    let clamp = |v: f64, [a, b]: [f64; 2]| v.min(b.max(a)).max(a);
    let ev_of_iso = |iso: f64| (iso / 100.0).log2();
    let mut iso = limits.iso[0];
    let automatic = limits.iso[1] > limits.iso[0];
    // The speed that makes a pair right, within its limits.
    let speed_for = |aperture: f64, time: f64| clamp(aperture * aperture / time * 100.0 / ev100.exp2(), limits.iso);
    let click = |marks: fn(Step) -> Vec<stops::Mark>, v: f64| limits.step.map_or(v, |s| stops::nearest(&marks(s), v).value);
    let click_time = |t: f64| match limits.step {
        Some(_) => click(stops::times, (t - limits.beyond_mark_s).max(f64::MIN_POSITIVE)) + limits.beyond_mark_s,
        None => t,
    };
    // Hands need not hold longer than the shortest time there is.
    let handheld_s = limits.handheld_s.max(limits.time_s[0]);
    let click_aperture = |t: f64| click(stops::apertures, t / limits.t_per_f) * limits.t_per_f;
    let (mut aperture, mut time);
    match mode {
        Mode::Manual => {
            (aperture, time) = (set.aperture, set.time_s);
            iso = if automatic { speed_for(aperture, time) } else { iso };
        }
        Mode::AperturePriority => {
            aperture = set.aperture;
            if automatic && shutter_for(ev100, aperture, iso) > handheld_s {
                iso = speed_for(aperture, handheld_s);
            }
            time = clamp(shutter_for(ev100, aperture, iso), limits.time_s);
        }
        Mode::ShutterPriority => {
            time = set.time_s;
            let wanted = |iso: f64| (time * ev100.exp2() * iso / 100.0).sqrt();
            if automatic && wanted(iso) < limits.aperture[0] {
                iso = speed_for(limits.aperture[0], time);
            }
            aperture = clamp(wanted(iso), limits.aperture);
        }
        Mode::Program => {
            let corner = (limits.aperture[0].powi(2) / handheld_s).log2();
            if automatic && ev100 + ev_of_iso(iso) < corner {
                iso = speed_for(limits.aperture[0], handheld_s);
            }
            let above = (ev100 + ev_of_iso(iso) - corner).max(0.0);
            aperture = clamp(limits.aperture[0] * (0.25 * above).exp2(), limits.aperture);
            if limits.step.is_some() {
                aperture = clamp(click_aperture(aperture), limits.aperture);
            }
            time = shutter_for(ev100, aperture, iso);
            if time < limits.time_s[0] {
                // Too bright even for the shortest time: the aperture closes as far as it can.
                aperture = clamp((limits.time_s[0] * ev100.exp2() * iso / 100.0).sqrt(), limits.aperture);
            }
            time = clamp(time, limits.time_s);
        }
    }
    if mode == Mode::ShutterPriority {
        aperture = clamp(click_aperture(aperture), limits.aperture);
    } else if mode != Mode::Manual {
        time = clamp(click_time(time), limits.time_s);
    }
    if automatic {
        // What the other dial was rounded by is made up for by the speed, where that had been raised.
        if limits.step.is_some() && mode != Mode::Manual && iso > limits.iso[0] {
            iso = speed_for(aperture, time);
        }
        iso = clamp(click(stops::speeds, iso), limits.iso);
    }
    Chosen { aperture, time_s: time, iso }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metering::ev100_of_setting;

    const LIMITS: Limits = Limits {
        aperture: [1.4, 22.0],
        time_s: [1.0 / 8000.0, 30.0],
        iso: [100.0; 2],
        handheld_s: 1.0 / 50.0,
        step: None,
        beyond_mark_s: 0.0,
        t_per_f: 1.0,
    };
    const SET: Chosen = Chosen { aperture: 4.0, time_s: 1.0 / 125.0, iso: 100.0 };

    fn ev(c: Chosen) -> f64 {
        ev100_of_setting(c.aperture, c.time_s, c.iso)
    }

    #[test]
    fn every_automatic_mode_exposes_what_was_metered_within_its_limits() {
        for k in -20..=80 {
            let metered = f64::from(k) / 4.0;
            let a = choose(Mode::AperturePriority, metered, SET, &LIMITS);
            assert!(a.aperture == 4.0 && (metered < -0.9 || (ev(a) - metered).abs() < 1e-9 || metered > 16.9), "{metered} {a:?}");
            let s = choose(Mode::ShutterPriority, metered, SET, &LIMITS);
            assert!(s.time_s == 1.0 / 125.0 && ((ev(s) - metered).abs() < 1e-9 || s.aperture == 1.4 || s.aperture == 22.0));
            let p = choose(Mode::Program, metered, SET, &LIMITS);
            assert!((-3.9..=21.8).contains(&metered) == ((ev(p) - metered).abs() < 1e-9), "{metered} {p:?}");
            assert_eq!(choose(Mode::Manual, metered, SET, &LIMITS), SET);
        }
    }

    #[test]
    fn the_program_turns_where_hands_cannot_hold() {
        let p = |ev100| choose(Mode::Program, ev100, SET, &LIMITS);
        let corner = (1.4f64 * 1.4 * 50.0).log2();
        assert!((p(corner).aperture - 1.4).abs() < 1e-9 && (p(corner).time_s * 50.0 - 1.0).abs() < 1e-9);
        assert!(p(corner - 2.0).aperture == 1.4 && (p(corner - 2.0).time_s * 12.5 - 1.0).abs() < 1e-9);
        // Canon's example, within a quarter of a stop.
        assert!((2.0 * (p(11.5).aperture / 3.5).log2()).abs() < 0.25 && (p(11.5).time_s * 250.0).log2().abs() < 0.25);
    }

    #[test]
    fn automatic_iso_keeps_times_short_while_it_can() {
        let limits = Limits { iso: [100.0, 1600.0], ..LIMITS };
        let a = choose(Mode::AperturePriority, 6.0, SET, &limits);
        assert!((a.time_s * 50.0 - 1.0).abs() < 1e-9 && a.iso > 100.0 && (ev(a) - 6.0).abs() < 1e-9, "{a:?}");
        let dark = choose(Mode::AperturePriority, 0.0, SET, &limits);
        assert!(dark.iso == 1600.0 && dark.time_s > 1.0 / 50.0 && (ev(dark)).abs() < 1e-9);
        let m = choose(Mode::Manual, 9.0, SET, &limits);
        assert!((ev(m) - 9.0).abs() < 1e-9 && m.iso > 100.0);
    }

    #[test]
    fn a_clicked_time_has_the_speed_that_goes_with_it() {
        let limits = Limits { iso: [100.0, 25600.0], step: Some(Step::Full), ..LIMITS };
        for handheld in 40..300 {
            let limits = Limits { handheld_s: 1.0 / f64::from(handheld), ..limits };
            for k in 0..40 {
                let metered = 4.0 + 0.2 * f64::from(k);
                for mode in [Mode::AperturePriority, Mode::Program, Mode::ShutterPriority] {
                    let c = choose(mode, metered, SET, &limits);
                    // Half a step of the dial that is left; the aperture's marks are not even.
                    assert!((ev(c) - metered).abs() <= 0.5 + 0.03, "{mode:?} {handheld} {metered}: {c:?}");
                }
            }
        }
    }

    #[test]
    fn dials_click() {
        let limits = Limits { step: Some(Step::Third), ..LIMITS };
        for k in 0..60 {
            let metered = f64::from(k) * 0.27;
            let c = choose(Mode::Program, metered, SET, &limits);
            let thirds = (c.time_s.log2() * 3.0).fract().abs();
            assert!(!(1e-6..1.0 - 1e-6).contains(&thirds) && (ev(c) - metered).abs() <= 1.0 / 6.0 + 1e-6, "{metered}: {c:?}");
        }
    }
}
