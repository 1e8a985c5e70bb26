//! The self-timer: counts down before a picture is taken. It belongs to the camera: all pages see it, and it runs on when a page is closed. It has
//! no clock of its own; whoever holds it says what time it is.

use crate::problem::Problem;
use crate::series::Series;
use serde_json::{Value, json};
use std::time::{Duration, Instant};

/// Shortest and longest count-down, s.
const SECONDS: std::ops::RangeInclusive<f64> = 0.1..=60.0;

/// Fails on times, s, that no self-timer counts: below 0.1 s and above 60 s.
pub fn check(seconds: f64) -> Result<(), Problem> {
    match SECONDS.contains(&seconds) {
        true => Ok(()),
        false => {
            let expected = format!("{} to {} s, such as 2 or 10", SECONDS.start(), SECONDS.end());
            Err(Problem::new("self-timer", format!("{seconds} s"), expected))
        }
    }
}

/// A count-down that runs.
#[derive(Clone, Debug, PartialEq)]
pub struct Timer {
    due: Instant,
    /// From its beginning, s.
    seconds: f64,
    /// Seconds that are left, the begun one counted, as last told.
    left_s: u64,
    /// What is taken then.
    pub series: Option<Series>,
}

/// What a moment means for a count-down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tick {
    /// Nothing new.
    Same,
    /// Another second has begun.
    Second,
    /// It is over.
    Due,
}

impl Timer {
    /// One of so many seconds that [`check`] allows, from now on.
    pub fn new(seconds: f64, series: Option<Series>, now: Instant) -> Timer {
        let due = now + Duration::from_secs_f64(seconds);
        Timer { due, seconds, left_s: seconds.ceil() as u64, series }
    }

    /// Looks at the time.
    pub fn tick(&mut self, now: Instant) -> Tick {
        let left = self.due.saturating_duration_since(now);
        if left.is_zero() {
            return Tick::Due;
        }
        let left_s = left.as_secs_f64().ceil() as u64;
        match std::mem::replace(&mut self.left_s, left_s) == left_s {
            true => Tick::Same,
            false => Tick::Second,
        }
    }

    /// For pages.
    pub fn told(&self) -> Value {
        json!({ "seconds": self.seconds, "left_s": self.left_s, "series": self.series.is_some() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_tells_each_second_once_and_then_that_it_is_over() {
        let begin = Instant::now();
        let at = |ms: u64| begin + Duration::from_millis(ms);
        let mut timer = Timer::new(2.0, None, begin);
        assert_eq!(timer.told()["left_s"], 2);
        assert_eq!(timer.tick(at(0)), Tick::Same);
        assert_eq!(timer.tick(at(999)), Tick::Same);
        assert_eq!(timer.tick(at(1001)), Tick::Second);
        assert_eq!((timer.told()["left_s"].as_u64(), timer.tick(at(1500))), (Some(1), Tick::Same));
        assert_eq!(timer.tick(at(2000)), Tick::Due);
        // However late somebody looks.
        assert_eq!(Timer::new(10.0, None, begin).tick(at(100_000)), Tick::Due);
        let mut late = Timer::new(10.0, None, begin);
        assert_eq!((late.tick(at(7300)), late.told()["left_s"].as_u64()), (Tick::Second, Some(3)));
    }

    #[test]
    fn times_that_cannot_be_counted_are_refused() {
        for good in [2.0, 10.0, 0.5, 60.0] {
            assert!(check(good).is_ok());
        }
        for bad in [0.0, -2.0, 1e9, f64::NAN, f64::INFINITY] {
            assert!(check(bad).is_err(), "{bad}");
        }
    }
}
