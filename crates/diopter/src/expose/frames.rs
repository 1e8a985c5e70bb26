//! The frames before and after an exposure: what motion and optical flow are measured to.

use crate::camera_motion::CameraMotion;
use std::fmt;

/// When the frames before and after an exposure are taken, and where the camera is then.
#[derive(Clone, PartialEq)]
pub struct Frames {
    /// The exposure begins, s of scene time.
    pub at_s: f64,
    /// From the beginning of an exposure to that of the next, s.
    pub step_s: f64,
    /// Where the camera is during the frame after this one.
    pub next: CameraMotion,
    /// Where the camera is during the frame before this one.
    pub previous: CameraMotion,
}

impl fmt::Debug for Frames {
    /// Without the thousands of places of the camera.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Frames").field("at_s", &self.at_s).field("step_s", &self.step_s).finish_non_exhaustive()
    }
}
