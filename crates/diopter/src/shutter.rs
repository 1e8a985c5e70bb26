//! When light may pass. One kind so far: everything opens and closes at once.

/// A shutter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shutter {
    /// Moment of opening, s of scene time.
    pub open_s: f64,
    /// Exposure time, s.
    pub exposure_s: f64,
}

impl Shutter {
    /// The open interval of a row of the film, s; the same for all rows of a global shutter.
    pub fn interval(&self, _row: usize) -> (f64, f64) {
        (self.open_s, self.open_s + self.exposure_s)
    }
}
