//! Where the light of a path is summed: all of it, or direct light apart. Each has a path tracer of its own, so that what is not asked for costs nothing.

use diopter_light::Sampled;

/// Most scattering events of direct light.
pub(crate) const DIRECT_EVENTS: u32 = 1;

/// Sums of the light of a path.
pub(super) trait Tally: Default {
    /// Adds light that was scattered so many times between lamp and camera.
    fn add(&mut self, light: Sampled, events: u32);

    /// The same of what `work` adds to the sum of all light.
    fn add_by<R>(&mut self, events: u32, work: impl FnOnce(&mut Sampled) -> R) -> R;
}

impl Tally for Sampled {
    #[inline]
    fn add(&mut self, light: Sampled, _: u32) {
        *self += light;
    }

    #[inline]
    fn add_by<R>(&mut self, _: u32, work: impl FnOnce(&mut Sampled) -> R) -> R {
        work(self)
    }
}

/// All light, and that of at most [`DIRECT_EVENTS`].
#[derive(Default)]
pub(super) struct Apart {
    pub all: Sampled,
    pub direct: Sampled,
}

impl Tally for Apart {
    #[inline]
    fn add(&mut self, light: Sampled, events: u32) {
        self.all += light;
        if events <= DIRECT_EVENTS {
            self.direct += light;
        }
    }

    #[inline]
    fn add_by<R>(&mut self, events: u32, work: impl FnOnce(&mut Sampled) -> R) -> R {
        let before = self.all;
        let result = work(&mut self.all);
        if events <= DIRECT_EVENTS {
            self.direct += self.all - before;
        }
        result
    }
}
