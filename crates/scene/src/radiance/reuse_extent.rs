//! How many paths of a group are lent what one of them found: the more, the brighter it is beside all light.
//!
//! Lent to n receivers, what would bring c to one of them leaves a variance of about c² / n, at the cost of n shadow rays: for the least of the one times the other n is in proportion to c. What n may depend on without
//! a bias: on what was found, as long as it is the same no matter which path found it, not on the path, and not on other finds of the group. Hence the scale is that of another group, whose pixels lie among
//! or beside those of this one; what is dim is lent within fixed parts of the group, each receiver of which could have found it and would have lent it to the same.

use super::receiver::Receiver;
use diopter_light::SampledSpectrum;
use std::ops::Range;

/// Receivers of what brings as much as all light of a pixel, on the mean: of surfaces, and of the sky, where a shadow ray is all that it takes.
const OF_SURFACES: f32 = 12.0;
const OF_SKY: f32 = 32.0;

/// Fewest paths of a part.
const FEWEST: usize = 8;

/// Places on lamps are lent where they bring, on the mean, so many times the direct light of a pixel: as many receivers are reckoned with. Products of error and time with and without: bathroom 0.81 to 0.89, living room 2
/// 0.90, Cornell box 0.90; lent to 8 everywhere: Cornell box 1.02, a small mesh 1.15.
const FEWEST_OF_LAMPS: f32 = 4.0;

/// Mean over the four wavelengths.
#[inline]
pub(super) fn mean(light: SampledSpectrum) -> f32 {
    0.25 * light.element_sum()
}

/// Light that a group of paths found before it is lent, by which another one reckons.
#[derive(Clone, Copy, Default)]
pub(super) struct LightLevel {
    paths: f32,
    /// Sum of the roots of the light of paths: one bright sample is not to decide.
    roots: f32,
    receivers: f32,
    /// Sum of what light at the next surface is multiplied by on its way to the film.
    onward: f32,
    /// Sum and number of the brightnesses of donors that are not diffuse.
    glossy: [f32; 2],
    /// Sum and number of what places on lamps bring to the paths that found them.
    lamps: [f32; 2],
}

impl LightLevel {
    /// Adds a path: all it would have alone, and its throughput behind its receiver, if it has one.
    pub fn add(&mut self, light: f32, onward: Option<f32>) {
        self.paths += 1.0;
        self.roots += light.max(0.0).sqrt();
        if let Some(onward) = onward {
            self.receivers += 1.0;
            self.onward += onward;
        }
    }

    /// Adds a donor that is not diffuse, by its mean radiance towards its receiver.
    pub fn add_glossy(&mut self, brightness: f32) {
        if brightness > 0.0 {
            self.glossy = [self.glossy[0] + brightness, self.glossy[1] + 1.0];
        }
    }

    /// Adds a place on a lamp, by what it brings to the path that found it.
    pub fn add_lamp(&mut self, brought: f32) {
        self.lamps = [self.lamps[0] + brought, self.lamps[1] + 1.0];
    }

    /// Receivers for a brightness at the next surface that is multiplied by `of`; not a number where nothing is known.
    #[inline]
    fn receivers(&self, brightness: f32, of: f32) -> f32 {
        of * brightness * (self.onward / self.receivers) / (self.roots / self.paths).powi(2)
    }

    /// The part of a group of so many paths to which light of a surface is lent that path `number` found; `brightness`: mean radiance towards all receivers.
    #[inline]
    pub fn part_for_surface(&self, brightness: f32, number: usize, paths: usize) -> Range<usize> {
        part(self.receivers(brightness, OF_SURFACES), number, paths)
    }

    /// The same of light whose density depends on the path that found it, so that its own brightness may not decide: that of lamps at surfaces that are not diffuse.
    #[inline]
    pub fn part_for_glossy(&self, number: usize, paths: usize) -> Range<usize> {
        self.part_for_surface(self.glossy[0] / self.glossy[1], number, paths)
    }

    /// The same of a place on a lamp, whose density depends on the receiver: by what such places bring to who found them, over direct light. A lamp that is seen from everywhere brings each path about as much, evenly spread by
    /// its own samples, which nothing that is lent makes better: then its part is the path alone.
    #[inline]
    pub fn part_for_lamp(&self, number: usize, paths: usize) -> Range<usize> {
        let receivers = self.lamps[0] / self.lamps[1] / (self.roots / self.paths).powi(2);
        if receivers < FEWEST_OF_LAMPS { number..number + 1 } else { part(receivers, number, paths) }
    }

    /// The same of light of the sky.
    #[inline]
    pub fn part_for_sky(&self, brightness: f32, number: usize, paths: usize) -> Range<usize> {
        part(self.receivers(brightness, OF_SKY), number, paths)
    }
}

/// The part of about so many paths, a power of two of them, that this one belongs to; all where that is not a number.
#[inline]
fn part(receivers: f32, number: usize, paths: usize) -> Range<usize> {
    let mut size = FEWEST;
    // To the nearest power of two.
    while size < paths && !(size as f32 * std::f32::consts::SQRT_2 >= receivers) {
        size *= 2;
    }
    let first = number / size * size;
    first..first + size
}

/// Where the receivers of a part are among all, which are in the order of their paths.
#[inline]
pub(super) fn within(receivers: &[Receiver], part: &Range<usize>) -> Range<usize> {
    receivers.partition_point(|r| r.path < part.start)..receivers.partition_point(|r| r.path < part.end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_brighter_is_lent_to_more() {
        let mut level = LightLevel::default();
        assert_eq!(level.part_for_surface(1.0, 40, 64), 0..64, "nothing is known");
        for _ in 0..9 {
            level.add(2.0, Some(0.5));
            level.add(2.0, None);
        }
        // 12 × 4 × 0.5 / 2.
        assert_eq!(level.part_for_surface(4.0, 40, 64), 32..48);
        assert_eq!(level.part_for_surface(8.0, 40, 64), 32..64);
        assert_eq!(level.part_for_surface(80.0, 40, 64), 0..64);
        assert_eq!(level.part_for_surface(0.0, 40, 64), 40..48);
        assert_eq!(level.part_for_surface(80.0, 40, 50), 0..64, "more than there are");
        // 32 × 2 × 0.5 / 2.
        assert_eq!(level.part_for_sky(2.0, 40, 64), 32..48);
        assert_eq!(level.part_for_glossy(40, 64), 0..64, "nothing is known");
        for brightness in [0.0, 2.0, 6.0] {
            level.add_glossy(brightness);
        }
        assert_eq!(level.part_for_glossy(40, 64), 32..48);
        assert_eq!(level.part_for_lamp(40, 64), 0..64, "nothing is known");
        // Seen by one path of four, and by one of fifty.
        level.add_lamp(7.9);
        assert_eq!(level.part_for_lamp(40, 64), 40..41);
        level.add_lamp(2.0 * 33.0 - 7.9);
        assert_eq!(level.part_for_lamp(40, 64), 32..48);
        // One bright path of many counts by its root.
        level.add(2.0e4, Some(0.5));
        assert_eq!(level.part_for_surface(8.0, 40, 64), 40..48);
    }
}
