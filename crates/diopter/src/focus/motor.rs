//! The drive that moves the lens.

/// A focusing drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motor {
    /// Film displacement of a step, mm; 0 for one that stands anywhere.
    pub step_mm: f64,
    /// Play when the direction changes, mm.
    pub backlash_mm: f64,
    /// mm/s; infinite for one that takes no time.
    pub speed_mm_s: f64,
}

impl Motor {
    /// Exact, at once.
    pub const IDEAL: Motor = Motor { step_mm: 0.0, backlash_mm: 0.0, speed_mm_s: f64::INFINITY };
}

/// A motor at work. Positions are film displacements from infinity, mm.
#[derive(Clone, Debug)]
pub struct Drive {
    motor: Motor,
    /// Where the motor is, and where the lens is, which lags by the play.
    turned_mm: f64,
    stands_mm: f64,
    /// Way made, mm.
    pub travelled_mm: f64,
    /// Time spent moving and exposing, s.
    pub seconds: f64,
}

impl Drive {
    /// At rest somewhere.
    pub fn new(motor: Motor, at_mm: f64) -> Self {
        Drive { motor, turned_mm: at_mm, stands_mm: at_mm, travelled_mm: 0.0, seconds: 0.0 }
    }

    /// Where the lens stands.
    pub fn stands_mm(&self) -> f64 {
        self.stands_mm
    }

    /// Goes to a position, always from below where there is play: then it stands where the motor says.
    pub fn go(&mut self, to_mm: f64) {
        let m = self.motor;
        let target = if m.step_mm > 0.0 { (to_mm / m.step_mm).round() * m.step_mm } else { to_mm };
        if m.backlash_mm > 0.0 && target < self.turned_mm {
            self.turn(target - 2.0 * m.backlash_mm);
        }
        self.turn(target);
    }

    fn turn(&mut self, to: f64) {
        let way = (to - self.turned_mm).abs();
        self.travelled_mm += way;
        if self.motor.speed_mm_s.is_finite() {
            self.seconds += way / self.motor.speed_mm_s;
        }
        self.turned_mm = to;
        // The lens is pushed from below, or left where it is within the play.
        self.stands_mm = self.stands_mm.clamp(to, to + self.motor.backlash_mm);
    }

    /// Adds a time, s, to the clock of the drive.
    pub fn wait(&mut self, seconds: f64) {
        self.seconds += seconds;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn play_is_taken_out_by_always_coming_from_below() {
        let mut d = Drive::new(Motor { step_mm: 0.01, backlash_mm: 0.05, speed_mm_s: 10.0 }, 0.0);
        d.turn(1.0);
        assert_eq!(d.stands_mm(), 1.0);
        // Turned back, the lens stays behind by the play.
        d.turn(0.7);
        assert!((d.stands_mm() - 0.75).abs() < 1e-12);
        for to in [0.4, 0.523, 0.2, 0.9] {
            d.go(to);
            assert!((d.stands_mm() - (to * 100.0f64).round() / 100.0).abs() < 1e-12, "{to} {}", d.stands_mm());
        }
        assert!(d.travelled_mm > 2.0 && (d.seconds - d.travelled_mm / 10.0).abs() < 1e-9);
    }
}
