//! The numbers engraved on cameras, and what they stand for.
//!
//! Names are rounded by custom (f/5.6, 1/125 s, ISO 160); cameras aim at exact steps: f-numbers at powers of √2 (5.657), times and
//! speeds at powers of 2 (1/128 s, ISO 158.7). Half and third stops lie between. Sources: ISO 2720 and ISO 5763 (series); lists as
//! printed on cameras, by scantips.com ("Nominal f/stop and shutter speed values") and kameraarkasi.org.

/// How fine a dial is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// 1 EV.
    Full,
    /// 1/2 EV.
    Half,
    /// 1/3 EV.
    Third,
}

impl Step {
    /// Names as people write them.
    pub const NAMES: [(&'static str, Step); 3] = [("full", Step::Full), ("half", Step::Half), ("third", Step::Third)];

    /// Steps an EV.
    pub fn per_ev(self) -> i32 {
        match self {
            Step::Full => 1,
            Step::Half => 2,
            Step::Third => 3,
        }
    }
}

/// A mark on a dial.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mark {
    /// What is engraved.
    pub nominal: f64,
    /// What it stands for.
    pub value: f64,
}

/// Full, half and third stops; the first is f/1, the first of times 32 s ("30"), the first of speeds ISO 100.
const APERTURES: [&[f64]; 3] = [
    &[1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0, 22.0, 32.0, 45.0, 64.0],
    &[
        1.0, 1.2, 1.4, 1.7, 2.0, 2.4, 2.8, 3.3, 4.0, 4.8, 5.6, 6.7, 8.0, 9.5, 11.0, 13.0, 16.0, 19.0, 22.0, 27.0, 32.0, 38.0,
        45.0, 54.0, 64.0,
    ],
    &[
        1.0, 1.1, 1.2, 1.4, 1.6, 1.8, 2.0, 2.2, 2.5, 2.8, 3.2, 3.5, 4.0, 4.5, 5.0, 5.6, 6.3, 7.1, 8.0, 9.0, 10.0, 11.0, 13.0,
        14.0, 16.0, 18.0, 20.0, 22.0, 25.0, 29.0, 32.0, 36.0, 40.0, 45.0, 51.0, 57.0, 64.0,
    ],
];
/// Of times shorter than a second one over it is engraved: negative here.
const TIMES: [&[f64]; 3] = [
    &[
        30.0, 15.0, 8.0, 4.0, 2.0, 1.0, -2.0, -4.0, -8.0, -15.0, -30.0, -60.0, -125.0, -250.0, -500.0, -1000.0, -2000.0, -4000.0,
        -8000.0,
    ],
    &[
        30.0, 20.0, 15.0, 10.0, 8.0, 6.0, 4.0, 3.0, 2.0, 1.5, 1.0, 0.7, -2.0, 0.3, -4.0, -6.0, -8.0, -10.0, -15.0, -20.0, -30.0,
        -45.0, -60.0, -90.0, -125.0, -180.0, -250.0, -350.0, -500.0, -750.0, -1000.0, -1500.0, -2000.0, -3000.0, -4000.0,
        -6000.0, -8000.0,
    ],
    &[
        30.0, 25.0, 20.0, 15.0, 13.0, 10.0, 8.0, 6.0, 5.0, 4.0, 3.2, 2.5, 2.0, 1.6, 1.3, 1.0, 0.8, 0.6, -2.0, 0.4, 0.3, -4.0,
        -5.0, -6.0, -8.0, -10.0, -13.0, -15.0, -20.0, -25.0, -30.0, -40.0, -50.0, -60.0, -80.0, -100.0, -125.0, -160.0, -200.0,
        -250.0, -320.0, -400.0, -500.0, -640.0, -800.0, -1000.0, -1250.0, -1600.0, -2000.0, -2500.0, -3200.0, -4000.0, -5000.0,
        -6400.0, -8000.0,
    ],
];
/// ISO speeds from 100 to just below 200 (and so on by doubling, with the names of three digits and more rounded as cameras do).
const SPEEDS: [&[f64]; 3] = [
    &[100.0, 200.0, 400.0, 800.0, 1600.0, 3200.0, 6400.0, 12800.0, 25600.0, 51200.0, 102400.0],
    &[
        100.0, 140.0, 200.0, 280.0, 400.0, 560.0, 800.0, 1100.0, 1600.0, 2200.0, 3200.0, 4500.0, 6400.0, 9000.0, 12800.0,
        18000.0, 25600.0, 36000.0, 51200.0, 72000.0, 102400.0,
    ],
    &[
        100.0, 125.0, 160.0, 200.0, 250.0, 320.0, 400.0, 500.0, 640.0, 800.0, 1000.0, 1250.0, 1600.0, 2000.0, 2500.0, 3200.0,
        4000.0, 5000.0, 6400.0, 8000.0, 10000.0, 12800.0, 16000.0, 20000.0, 25600.0, 32000.0, 40000.0, 51200.0, 64000.0, 80000.0,
        102400.0,
    ],
];

fn series(list: &[f64], value: impl Fn(f64) -> f64, step: Step) -> Vec<Mark> {
    let mark = |(k, n): (usize, &f64)| Mark {
        nominal: if *n < 0.0 { -1.0 / n } else { *n },
        value: value(k as f64 / f64::from(step.per_ev())),
    };
    list.iter().enumerate().map(mark).collect()
}

/// f-numbers from f/1 to f/64: √2^k.
pub fn apertures(step: Step) -> Vec<Mark> {
    series(APERTURES[step as usize], |ev| (0.5 * ev).exp2(), step)
}

/// Exposure times from 32 s ("30") to 1/8192 s ("1/8000"): 2^(5−k).
pub fn times(step: Step) -> Vec<Mark> {
    series(TIMES[step as usize], |ev| (5.0 - ev).exp2(), step)
}

/// ISO speeds from 100 to 102 400: 100 · 2^k.
pub fn speeds(step: Step) -> Vec<Mark> {
    series(SPEEDS[step as usize], |ev| 100.0 * ev.exp2(), step)
}

/// What an engraved number stands for: looked up on the dial in use, then among full, third and half stops; a number that no dial has
/// is itself.
fn meant(of: fn(Step) -> Vec<Mark>, nominal: f64, dial: Option<Step>) -> f64 {
    let same = |m: &Mark| (m.nominal / nominal - 1.0).abs() < 1e-6;
    let mut dials = dial.into_iter().chain([Step::Full, Step::Third, Step::Half]);
    dials.find_map(|step| of(step).into_iter().find(same)).map_or(nominal, |m| m.value)
}

/// True f-number of an engraved one. `dial`: the dial in use, which is looked at first. A number that no dial has is itself.
pub fn true_aperture(nominal: f64, dial: Option<Step>) -> f64 {
    meant(apertures, nominal, dial)
}

/// True time of an engraved one, s. `dial`: as for [`true_aperture`].
pub fn true_time(nominal: f64, dial: Option<Step>) -> f64 {
    meant(times, nominal, dial)
}

/// True speed of an engraved one. `dial`: as for [`true_aperture`].
pub fn true_speed(nominal: f64, dial: Option<Step>) -> f64 {
    meant(speeds, nominal, dial)
}

/// The mark nearest to a value, in EV; without marks the value itself.
pub fn nearest(marks: &[Mark], value: f64) -> Mark {
    let off = |m: &Mark| (m.value / value).log2().abs();
    marks.iter().min_by(|a, b| off(a).total_cmp(&off(b))).copied().unwrap_or(Mark { nominal: value, value })
}

/// A time (s) as dials have it engraved: `1/125 s`, `2 s`.
pub fn time_name(nominal: f64) -> String {
    if nominal < 0.3 || nominal == 0.5 {
        format!("1/{:.0} s", 1.0 / nominal)
    } else {
        format!("{} s", (nominal * 10.0).round() / 10.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lie_near_what_they_mean() {
        for step in [Step::Full, Step::Half, Step::Third] {
            for (what, marks, ev) in [("f", apertures(step), 2.0), ("t", times(step), 1.0), ("iso", speeds(step), 1.0)] {
                for m in marks {
                    let off = ev * (m.nominal / m.value).log2();
                    // The worst is "0.3" s on a dial of half stops.
                    assert!(off.abs() < 0.24, "{what} {step:?} {} means {}: {off} EV", m.nominal, m.value);
                }
            }
        }
    }

    #[test]
    fn the_lecture_table_is_of_equal_exposure() {
        let rows =
            [(1.4, 1.0 / 500.0), (2.0, 1.0 / 250.0), (2.8, 1.0 / 125.0), (4.0, 1.0 / 60.0), (5.6, 1.0 / 30.0), (8.0, 1.0 / 15.0)]
                .into_iter()
                .chain([(11.0, 1.0 / 8.0), (16.0, 1.0 / 4.0), (22.0, 1.0 / 2.0), (32.0, 1.0)]);
        for (n, t) in rows {
            let h = true_time(t, None) / true_aperture(n, None).powi(2);
            assert!((h * 1024.0 - 1.0).abs() < 1e-9, "f/{n} {t}: {h}");
        }
        assert!((true_aperture(5.6, None) - 5.657).abs() < 1e-3 && (true_time(1.0 / 125.0, None) * 128.0 - 1.0).abs() < 1e-12);
        assert_eq!(true_aperture(3.7, None), 3.7);
        // The same mark on two dials.
        assert!((true_time(0.3, Some(Step::Half)) - 0.3536).abs() < 1e-4 && (true_time(0.3, None) - 0.315).abs() < 1e-3);
    }
}
