//! One pixel between two moments, in closed form.

use super::sheet::EventSensor;
use crate::noise::{mix, normal_quantile, unit};

/// Least threshold that a pixel may have whatever its mismatch; as in v2e (Hu, Liu & Delbruck 2021).
const LEAST_THRESHOLD: f64 = 0.01;

/// What a pixel knows.
#[derive(Clone, Debug)]
pub(super) struct Pixel {
    key: u64,
    /// Random numbers drawn so far.
    draws: u64,
    threshold_on: f64,
    threshold_off: f64,
    /// Logarithm of the current at the last moment.
    input: f64,
    /// What the photoreceptor made of it.
    level: f64,
    /// Level of the last event, as far as the leak has left it.
    reference: f64,
    /// The pixel is in reset up to here; then it remembers the level of that moment.
    free_s: f64,
    in_reset: bool,
    /// When noise is next tried.
    noise_s: f64,
}

/// What goes on from a moment on: the input rises straight, the level follows with its time constant, the reference leaks.
struct Course {
    from_s: f64,
    /// Of the input, 1/s.
    slope: f64,
    /// Time constant, s; 0: the level is the input.
    tau_s: f64,
    input: f64,
    /// Level − (input − slope τ) at `from_s`: what decays.
    decaying: f64,
    /// How fast the reference falls, 1/s.
    leak: f64,
}

impl Course {
    fn level(&self, t: f64) -> f64 {
        let dt = t - self.from_s;
        let decaying = if self.tau_s > 0.0 { self.decaying * (-dt / self.tau_s).exp() } else { 0.0 };
        self.input + self.slope * (dt - self.tau_s) + decaying
    }

    /// Level and what the reference has leaked: what a reference at `from_s` is subtracted from.
    fn raised(&self, t: f64) -> f64 {
        self.level(t) + self.leak * (t - self.from_s)
    }

    /// Where the raised level turns round, if it does: it does so once at most.
    fn turn(&self) -> Option<f64> {
        let slope = self.slope + self.leak;
        let x = self.decaying / (self.tau_s * slope);
        (self.tau_s > 0.0 && x > 0.0 && x.is_finite()).then(|| self.from_s + self.tau_s * x.ln())
    }

    /// The first moment from `t` to `end` at which the raised level is `low` or `high`, and whether it is `high`.
    fn crossing(&self, t: f64, end: f64, low: f64, high: f64) -> Option<(f64, bool)> {
        let turn = self.turn().filter(|x| *x > t && *x < end);
        let mut from = t;
        for to in turn.into_iter().chain([end]) {
            let reached = self.raised(to);
            if reached >= high {
                return Some((self.solve(from, to, high), true));
            }
            if reached <= low {
                return Some((self.solve(from, to, low), false));
            }
            from = to;
        }
        None
    }

    /// Where the raised level is `wanted`, between two moments with it in between: straight, or by bisection and Newton's steps.
    fn solve(&self, mut a: f64, mut b: f64, wanted: f64) -> f64 {
        let (fa, fb) = (self.raised(a) - wanted, self.raised(b) - wanted);
        if fa == 0.0 || a == b {
            return a;
        }
        if self.tau_s == 0.0 {
            return (a + (b - a) * fa / (fa - fb)).clamp(a, b);
        }
        let mut t = 0.5 * (a + b);
        for _ in 0..80 {
            let f = self.raised(t) - wanted;
            if f == 0.0 {
                return t;
            }
            if (f > 0.0) == (fb > 0.0) {
                b = t
            } else {
                a = t
            }
            let slope = self.slope + self.leak - self.decaying / self.tau_s * (-(t - self.from_s) / self.tau_s).exp();
            let newton = t - f / slope;
            let next = if newton >= a && newton <= b { newton } else { 0.5 * (a + b) };
            if (next - t).abs() <= 1e-15 + 1e-13 * t.abs() {
                return next;
            }
            t = next;
        }
        t
    }
}

impl Pixel {
    /// A pixel in steady light. `input`: natural logarithm of its current in e⁻/s, that of the dark included.
    pub fn new(sensor: &EventSensor, key: u64, input: f64, time_s: f64) -> Self {
        let mut pixel = Pixel {
            key,
            draws: 0,
            threshold_on: sensor.threshold_on,
            threshold_off: sensor.threshold_off,
            input,
            level: input,
            reference: input,
            free_s: f64::NEG_INFINITY,
            in_reset: false,
            noise_s: f64::INFINITY,
        };
        let mismatch = [pixel.uniform(), pixel.uniform()].map(|u| sensor.threshold_mismatch * normal_quantile(u));
        pixel.threshold_on = (pixel.threshold_on + mismatch[0]).max(LEAST_THRESHOLD);
        pixel.threshold_off = (pixel.threshold_off + mismatch[1]).max(LEAST_THRESHOLD);
        let (phase, wait) = (pixel.uniform(), pixel.uniform());
        if sensor.leak_hz > 0.0 {
            // Somewhere between two leak events: pixels do not begin all together.
            pixel.reference -= phase * pixel.threshold_on;
        }
        if let Some(noise) = sensor.shot_noise {
            pixel.noise_s = time_s - wait.ln() / noise.hz;
        }
        pixel
    }

    fn uniform(&mut self) -> f64 {
        self.draws += 1;
        unit(mix(self.key, self.draws))
    }

    /// Goes on from a moment to the next, at which the logarithm of the current is `input`; `tell` gets times and polarities.
    pub fn advance(&mut self, sensor: &EventSensor, from_s: f64, to_s: f64, input: f64, mut tell: impl FnMut(f64, bool)) {
        let slope = (input - self.input) / (to_s - from_s);
        // The time constant of the step is that of its middle.
        let middle = (0.5 * (input + self.input)).exp();
        let tau_s = sensor.bandwidth.map_or(0.0, |b| 1.0 / (std::f64::consts::TAU * b.at(middle)));
        let leak = sensor.leak_hz * self.threshold_on;
        let decaying = self.level - (self.input - slope * tau_s);
        let course = Course { from_s, slope, tau_s, input: self.input, decaying, leak };
        let mut t = from_s;
        loop {
            if self.in_reset {
                if self.free_s >= to_s {
                    break;
                }
                t = t.max(self.free_s);
                self.in_reset = false;
                self.reference = course.raised(t);
            }
            let (low, high) = (self.reference - self.threshold_off, self.reference + self.threshold_on);
            let signal = course.crossing(t, to_s, low, high);
            let noise_first = self.noise_s < signal.map_or(to_s, |s| s.0);
            let (at, on) = match (signal, noise_first) {
                (_, true) => match self.noise(sensor, &course) {
                    // Tried before now (in reset), or not accepted.
                    (tried, _) if tried < t => continue,
                    (tried, None) => {
                        t = tried;
                        continue;
                    }
                    (tried, Some(on)) => (tried, on),
                },
                (Some(found), false) => found,
                (None, false) => break,
            };
            tell(at, on);
            t = at;
            if sensor.refractory_s > 0.0 {
                (self.free_s, self.in_reset) = (at + sensor.refractory_s, true);
            } else if noise_first {
                self.reference = course.raised(at);
            } else {
                self.reference = if on { high } else { low };
            }
        }
        // Noise that was due while the pixel was in reset is lost.
        while self.noise_s < to_s {
            self.noise(sensor, &course);
        }
        self.level = course.level(to_s);
        self.reference -= leak * (to_s - from_s);
        self.input = input;
    }

    /// Tries the noise that is due: its time, and its polarity if there is any in this light. Rates that change with the light are made by thinning (Lewis & Shedler 1979).
    fn noise(&mut self, sensor: &EventSensor, course: &Course) -> (f64, Option<bool>) {
        let at = self.noise_s;
        let Some(noise) = sensor.shot_noise else {
            self.noise_s = f64::INFINITY;
            return (at, None);
        };
        let (chance, side, wait) = (self.uniform(), self.uniform(), self.uniform());
        self.noise_s = at - wait.ln() / noise.hz;
        let current = (course.input + course.slope * (at - course.from_s)).exp();
        (at, (chance * noise.hz < noise.at(current)).then_some(side < 0.5))
    }
}
