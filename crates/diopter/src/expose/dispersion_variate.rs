//! Control variate for dispersion: less noise of how many wavelengths arrive in a pixel.
//!
//! Behind a lens that disperses, the four wavelengths of a sample land at places of their own. How many land in a pixel is up to chance, and that alone
//! makes an even field noisy: pixels as small as the colours are spread have 0.5 / √n of noise from n samples. But how many land is known: over all film points of a
//! pixel from which samples start, a wavelength that goes through a place of the pupil lands evenly over a square as large as the pixel, displaced as the wavelength is.
//! So the part of a sample that could be predicted, c, is taken from where it landed and given to the pixels below the square, by how much of it each holds.
//! That changes no mean, whatever c is, as long as it does not depend on where in the pixel the sample started: c comes from the sample of the *other* replicate that
//! follows or precedes it and from the same two samples of pixels before, which are drawn independently (where pixels lend one another light they are not, and are not asked). So it does not depend on which samples are taken at once, either: parts
//! of an exposure that hold whole pairs merge to the whole.
//!
//! Sources: control variates, A. Owen 2013, "Monte Carlo theory, methods and examples", §8.9; the two replicates as in cross-fitting.
//! What is neglected: how much the displacement changes within one pixel (by lateral colour over image height, of the order of 1e-3 pixels).

use crate::camera::Film;
use diopter_light::random::SamplerKind;
use diopter_light::wavelength::{FIRST_NM, LAST_NM};
use glam::Vec4;
use std::ops::Range;

/// Bins of wavelengths in which what is to be expected is known.
const BINS: usize = 8;
const BIN_NM: f32 = (LAST_NM - FIRST_NM) / BINS as f32;
/// How much of what is known is kept from a pixel to the next, and what that of each of two neighbours counts for beside the other sample of the pixel itself.
const KEPT: f32 = 0.875;
const WEIGHT_OF_BEFORE: f32 = 0.25;

/// A square as large as a pixel, anywhere on the film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PixelFootprint {
    /// Column and row of the pixel that holds its upper left corner.
    first: [usize; 2],
    /// How much of it lies in the next column and row.
    beyond: [f32; 2],
}

impl PixelFootprint {
    /// The pixel at a column and row, displaced; `None` where not all of it lies on the film.
    pub fn new(film: &Film, pixel: [usize; 2], displaced_px: [f64; 2]) -> Option<PixelFootprint> {
        let mut footprint = PixelFootprint { first: [0; 2], beyond: [0.0; 2] };
        for (k, size) in [film.columns, film.rows].into_iter().enumerate() {
            let at = pixel[k] as f64 + displaced_px[k];
            if !(at >= 0.0 && at <= (size - 1) as f64) {
                return None;
            }
            footprint.first[k] = at as usize;
            footprint.beyond[k] = at.fract() as f32;
        }
        Some(footprint)
    }

    /// The pixels below it and how much of it lies in each.
    pub fn parts(&self) -> impl Iterator<Item = ([usize; 2], f32)> + use<> {
        let PixelFootprint { first: [x, y], beyond: [right, below] } = *self;
        let all = [
            ([x, y], (1.0 - right) * (1.0 - below)),
            ([x + 1, y], right * (1.0 - below)),
            ([x, y + 1], (1.0 - right) * below),
            ([x + 1, y + 1], right * below),
        ];
        all.into_iter().filter(|p| p.1 > 0.0)
    }
}

/// A wavelength of a sample, and where it landed.
#[derive(Clone, Copy, Debug)]
pub(super) struct WavelengthHit {
    pub nm: f32,
    pub radiance: f32,
    /// What a radiance is worth, without the response of a band.
    pub gain: f32,
    pub pixel: [usize; 2],
    pub footprint: PixelFootprint,
    /// When it arrives, s, and where in the pupil.
    pub time: f64,
    pub pupil: f64,
}

/// Square roots of radiances by bin: of them one bright sample changes the mean but little, and it is that of the radiances where they are even.
#[derive(Clone, Copy, Default)]
struct Roots {
    sum: [f32; BINS],
    /// Of the radiances themselves.
    squares: [f32; BINS],
    count: [f32; BINS],
}

impl Roots {
    fn add(&mut self, nm: f32, radiance: f32) {
        let (bin, radiance) = (bin(nm), radiance.max(0.0));
        self.sum[bin] += radiance.sqrt();
        self.squares[bin] += radiance;
        self.count[bin] += 1.0;
    }

    /// These, and others that count for a weight.
    fn and(&self, others: &Roots, weight: f32) -> Roots {
        let sum = |a: &[f32; BINS], b: &[f32; BINS]| std::array::from_fn(|k| a[k] + weight * b[k]);
        Roots {
            sum: sum(&self.sum, &others.sum),
            squares: sum(&self.squares, &others.squares),
            count: sum(&self.count, &others.count),
        }
    }

    /// Radiance to be expected in each bin, where another sample of the same pixel had these: less than the mean where radiances differ within the bins, or the other sample
    /// is darker. Where they differ by all of their mean, as on both sides of an edge before the dark, nothing can be predicted, and light must not be taken from pixels
    /// that have none.
    fn expected(&self, other: &Roots) -> [f32; BINS] {
        let roots: [f32; BINS] = std::array::from_fn(|k| self.sum[k] / self.count[k].max(1e-6));
        let (mut squares, mut even, mut own, mut of_it) = (0.0, 0.0, 0.0, 0.0);
        for k in 0..BINS {
            squares += self.squares[k];
            even += roots[k] * self.sum[k];
            own += other.sum[k];
            of_it += roots[k] * other.count[k];
        }
        // From the relative variance of the roots.
        let evenness = if even > 0.0 { (2.0 - squares / even).clamp(0.0, 1.0) } else { 0.0 };
        let factor = if own < of_it { evenness * own / of_it } else { evenness };
        roots.map(|root| factor * root * root)
    }
}

fn bin(nm: f32) -> usize {
    (((nm - FIRST_NM) / BIN_NM) as usize).min(BINS - 1)
}

/// The wavelengths of a pixel's samples that landed anywhere, and what was before.
pub(super) struct DispersionVariate {
    /// First of the pairs of samples, and how many there are.
    first: u32,
    pairs: usize,
    /// Weight of what the pixels before had.
    weight_of_before: f32,
    /// First of the columns.
    left: usize,
    /// What the pixels up to one in each column had, those in the row above where there are none yet in this one: `[column][pair]`.
    before: Vec<Roots>,
    /// Those of the pixel under way, with the number of their sample, rising.
    hits: Vec<(u32, WavelengthHit)>,
    pixel: Option<[usize; 2]>,
    around: [Around; 2],
}

/// What is to be added to the pixels around one: few additions to the sums of the film instead of many.
#[derive(Default)]
struct Around {
    /// `[row][column][group of bands]`
    values: Vec<Vec4>,
    /// First and last column and row that have any.
    used: [[usize; 2]; 2],
}

/// Pixels before, and in all, a side of [`Around`].
const BEFORE: usize = 3;
const SIDE: usize = 8;

impl Around {
    /// The place of a pixel around another one, if it is near.
    #[inline]
    fn place(middle: [usize; 2], pixel: [usize; 2]) -> Option<[usize; 2]> {
        let [x, y] = [0, 1].map(|k| (pixel[k] + BEFORE).wrapping_sub(middle[k]));
        (x < SIDE && y < SIDE).then_some([x, y])
    }

    #[inline]
    fn add(&mut self, [x, y]: [usize; 2], value: &[Vec4], factor: f32) {
        let start = (y * SIDE + x) * value.len();
        for (sum, v) in self.values[start..start + value.len()].iter_mut().zip(value) {
            *sum += *v * factor;
        }
        let [first, last] = &mut self.used;
        *first = [first[0].min(x), first[1].min(y)];
        *last = [last[0].max(x), last[1].max(y)];
    }

    fn empty(&mut self, groups: usize) {
        self.values.resize(SIDE * SIDE * groups, Vec4::ZERO);
        self.used = [[SIDE; 2], [0; 2]];
    }

    /// Hands over all that was added.
    fn flush(&mut self, middle: [usize; 2], groups: usize, mut add: impl FnMut([usize; 2], &[Vec4])) {
        let [first, last] = self.used;
        for y in first[1]..=last[1] {
            for x in first[0]..=last[0] {
                let values = &mut self.values[(y * SIDE + x) * groups..][..groups];
                if values.iter().any(|v| *v != Vec4::ZERO) {
                    add([middle[0] + x - BEFORE, middle[1] + y - BEFORE], values);
                    values.fill(Vec4::ZERO);
                }
            }
        }
    }
}

impl DispersionVariate {
    /// A control variate for some samples of the pixels of some columns; `asks_neighbours`: whether samples of pixels before are independent of those of a pixel. `None` where a sample says something of where another one starts in its pixel, or where pixels have gaps between
    /// them.
    pub fn new(
        samples: &Range<u32>,
        columns: Range<usize>,
        sampler: SamplerKind,
        film: &Film,
        asks_neighbours: bool,
    ) -> Option<DispersionVariate> {
        let apply = matches!(sampler, SamplerKind::Sobol | SamplerKind::Independent) && film.gap_mm == [0.0; 2];
        let pairs = (samples.end.div_ceil(2) - samples.start / 2) as usize;
        apply.then(|| DispersionVariate {
            first: samples.start / 2,
            pairs,
            weight_of_before: if asks_neighbours { WEIGHT_OF_BEFORE } else { 0.0 },
            left: columns.start,
            before: vec![Roots::default(); pairs * columns.len()],
            hits: Vec::new(),
            pixel: None,
            around: Default::default(),
        })
    }

    /// Where what is known of a column is kept.
    fn place(&self, column: usize, pair: usize) -> usize {
        let columns = self.before.len() / self.pairs;
        (column - self.left).min(columns - 1) * self.pairs + pair
    }

    /// Whether samples belong to another pixel than those noted so far.
    pub fn is_of_other(&self, pixel: [usize; 2]) -> bool {
        self.pixel.is_some_and(|p| p != pixel)
    }

    /// Notes a wavelength of a sample of a pixel, of which even ones belong to one replicate, odd ones to the other.
    pub fn note(&mut self, pixel: [usize; 2], sample: u32, hit: WavelengthHit) {
        self.pixel = Some(pixel);
        self.hits.push((sample, hit));
    }

    /// Ends a pixel. `response`: of groups of bands to a wavelength (nm); `open`: whether a pixel takes what landed in another one at its time; `add`: told a pixel, a
    /// replicate, what is to be added there by groups of bands, and how many times.
    pub fn end_pixel(
        &mut self,
        groups: usize,
        response: impl Fn(usize, f32) -> Vec4,
        open: impl Fn([usize; 2], &WavelengthHit) -> bool,
        mut add: impl FnMut([usize; 2], usize, &[Vec4], f32),
    ) {
        let Some(middle) = self.pixel.take() else { return };
        let mut value = vec![Vec4::ZERO; groups];
        self.around.iter_mut().for_each(|around| around.empty(groups));
        for pair in self.hits.chunk_by(|a, b| a.0 / 2 == b.0 / 2) {
            let number = (pair[0].0 / 2 - self.first) as usize;
            let place = self.place(middle[0], number);
            // On the left, and above on the right: an edge that comes is seen there first.
            let left = self.before[if middle[0] > self.left { place - self.pairs } else { place }];
            let around_it = left.and(&self.before[self.place(middle[0] + 1, number)], 1.0);
            let mut own = [Roots::default(); 2];
            for (sample, hit) in pair {
                own[(sample % 2) as usize].add(hit.nm, hit.radiance);
            }
            for samples in pair.chunk_by(|a, b| a.0 == b.0) {
                let replicate = (samples[0].0 % 2) as usize;
                let other = &own[1 - replicate];
                let expected = other.and(&around_it, self.weight_of_before).expected(other);
                let around = &mut self.around[replicate];
                for (_, hit) in samples {
                    let expected = expected[bin(hit.nm)] * hit.gain;
                    if !(expected > 0.0 && expected.is_finite()) {
                        continue;
                    }
                    value.iter_mut().enumerate().for_each(|(group, v)| *v = response(group, hit.nm) * expected);
                    let taken = [(hit.pixel, -1.0)];
                    for (pixel, part) in taken.into_iter().chain(hit.footprint.parts()).filter(|p| open(p.0, hit)) {
                        match Around::place(middle, pixel) {
                            Some(place) => around.add(place, &value, part),
                            None => add(pixel, replicate, &value, part),
                        }
                    }
                }
            }
            self.before[place] = own[0].and(&own[1], 1.0).and(&left, KEPT);
        }
        self.hits.clear();
        for (replicate, around) in self.around.iter_mut().enumerate() {
            around.flush(middle, groups, |pixel, values| add(pixel, replicate, values, 1.0));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_lie_over_as_much_of_pixels_as_they_cover() {
        let film = Film::new(10.0, 8.0, 10, 8);
        let footprint = PixelFootprint::new(&film, [4, 3], [-1.25, 2.5]).unwrap();
        let parts: Vec<_> = footprint.parts().collect();
        assert_eq!(parts, [([2, 5], 0.125), ([3, 5], 0.375), ([2, 6], 0.125), ([3, 6], 0.375)]);
        // One that lies on a pixel, in the last corner too.
        assert!(PixelFootprint::new(&film, [9, 7], [0.0, 0.0]).unwrap().parts().eq([([9, 7], 1.0)]));
        for beyond in [[-4.1, 0.0], [5.1, 0.0], [0.0, -3.1], [0.0, 4.1], [f64::NAN, 0.0]] {
            assert_eq!(PixelFootprint::new(&film, [4, 3], beyond), None);
        }
    }

    #[test]
    fn what_is_expected_is_what_is_even() {
        let of = |radiances: &[f32]| {
            let mut roots = Roots::default();
            radiances.iter().for_each(|r| roots.add(580.0, *r));
            let found = roots.expected(&Roots::default());
            assert!(found.iter().enumerate().all(|(b, e)| b == 4 || *e == 0.0));
            found[4]
        };
        assert!((of(&[7.0; 5]) - 7.0).abs() < 1e-5);
        // An edge before the dark; a firefly.
        assert_eq!(of(&[0.0, 8.0]), 0.0);
        assert!(of(&[1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1e4]) < 10.0);
        assert_eq!(of(&[]), 0.0);
        assert_eq!(of(&[-1.0, 0.0]), 0.0);
    }

    #[test]
    fn light_is_moved_and_neither_made_nor_lost() {
        let film = Film::new(30.0, 30.0, 30, 30);
        let mut variate = DispersionVariate::new(&(4..12), 10..20, SamplerKind::Sobol, &film, true).unwrap();
        let pixel = [14, 15];
        for k in 0..8 {
            // Near and far.
            let far = [0.3, -0.6, 2.9, 9.3][k / 2];
            let footprint = PixelFootprint::new(&film, pixel, [far, 0.25]).unwrap();
            let landed = [(14.0 + far + 0.5) as usize, 15];
            let hit = WavelengthHit { nm: 450.0, radiance: 3.0, gain: 2.0, pixel: landed, footprint, time: 0.0, pupil: 0.0 };
            variate.note(pixel, 4 + k as u32, hit);
        }
        assert!(!variate.is_of_other(pixel) && variate.is_of_other([15, 15]));
        let mut sums = vec![[0.0f64; 2]; 900];
        let add = |[x, y]: [usize; 2], half: usize, values: &[Vec4], times: f32| {
            assert_eq!(values.len(), 2);
            assert_eq!(values[0] * 2.0, values[1]);
            sums[y * 30 + x][half] += f64::from(values[0].x * times);
        };
        variate.end_pixel(2, |group, _| Vec4::splat(1.0 + group as f32), |_, _| true, add);
        for half in 0..2 {
            let total: f64 = sums.iter().map(|s| s[half]).sum();
            assert!(total.abs() < 1e-5, "{total}");
            // Landed at 14, less what of the square lies there; the far one, added on its own.
            assert!((sums[15 * 30 + 14][half] - 6.0 * (-1.0 + 0.75 * (0.7 + 0.4))).abs() < 1e-5, "{:?}", sums[15 * 30 + 14]);
            assert!((sums[15 * 30 + 24][half] - 6.0 * 0.75 * 0.3).abs() < 1e-5);
        }
        // The next pixel knows what was before, even if its own samples are of one replicate.
        let hit =
            |footprint| WavelengthHit { nm: 450.0, radiance: 3.0, gain: 2.0, pixel: [15, 15], footprint, time: 0.0, pupil: 0.0 };
        variate.note([15, 15], 4, hit(PixelFootprint::new(&film, [15, 15], [0.5, 0.0]).unwrap()));
        let mut moved = 0.0;
        variate.end_pixel(
            1,
            |_, _| Vec4::ONE,
            |_, _| true,
            |[x, _], _, v, times| moved += if x == 16 { v[0].x * times } else { 0.0 },
        );
        assert!((moved - 3.0).abs() < 1e-5, "{moved}");
    }
}
