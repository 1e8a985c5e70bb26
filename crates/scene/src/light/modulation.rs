//! Light that is not steady: mains, pulse-width modulation, flashes.

use std::f64::consts::TAU;

/// How a lamp's light changes with time; a factor on its emission.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum Modulation {
    /// Not at all.
    #[default]
    Steady,
    /// 1 + depth · sin(2π f t + phase): lamps on alternating current, which flicker at twice its frequency.
    Sine {
        /// Of the light, Hz.
        frequency_hz: f64,
        /// 0 steady to 1 dark once a period (Michelson's modulation, "percent flicker").
        depth: f64,
        /// rad
        phase: f64,
    },
    /// On for a fraction of each period, the brighter the shorter: the mean stays 1.
    Pwm {
        /// Hz
        frequency_hz: f64,
        /// Fraction of the period, above 0 to 1.
        duty: f64,
        /// Fractions of a period by which the lamp is ahead.
        phase: f64,
    },
    /// Once during the exposure; the lamp's emission is then per second of the pulse: radiance × time.
    Pulse {
        /// After the exposure began, s.
        start_s: f64,
        /// s
        length_s: f64,
        /// Factor on its energy.
        energy: f64,
    },
}

impl Modulation {
    /// The factor on a lamp's emission at a moment: `time_s` after the beginning of the exposure, which began at `open_s` (both s). Its mean is 1; of a pulse it is 1/s.
    #[inline]
    pub fn at(&self, open_s: f64, time_s: f32) -> f32 {
        let now = || open_s + f64::from(time_s);
        match *self {
            Modulation::Steady => 1.0,
            Modulation::Sine { frequency_hz, depth, phase } => (1.0 + depth * (TAU * frequency_hz * now() + phase).sin()) as f32,
            Modulation::Pwm { frequency_hz, duty, phase } => {
                if (frequency_hz * now() + phase).rem_euclid(1.0) < duty {
                    (1.0 / duty) as f32
                } else {
                    0.0
                }
            }
            Modulation::Pulse { start_s, length_s, energy } => {
                let t = f64::from(time_s) - start_s;
                if (0.0..length_s).contains(&t) { (energy / length_s) as f32 } else { 0.0 }
            }
        }
    }

    /// Whether this is a flash.
    pub fn is_pulse(&self) -> bool {
        matches!(self, Modulation::Pulse { .. })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flicker_keeps_the_mean_and_a_pulse_its_energy() {
        let lamps = [
            Modulation::Steady,
            Modulation::Sine { frequency_hz: 100.0, depth: 0.7, phase: 0.3 },
            Modulation::Pwm { frequency_hz: 240.0, duty: 0.25, phase: 0.1 },
            Modulation::Pulse { start_s: 0.3, length_s: 0.25, energy: 1.0 },
        ];
        for lamp in lamps {
            let n = 200_000;
            let mean = (0..n).map(|i| f64::from(lamp.at(7.0, (i as f32 + 0.5) / n as f32))).sum::<f64>() / f64::from(n);
            assert!((mean - 1.0).abs() < 1e-3, "{lamp:?}: {mean}");
        }
    }
}
