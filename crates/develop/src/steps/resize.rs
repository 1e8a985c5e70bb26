//! Another size, in linear light: Lanczos windows, widened when the picture gets smaller so that nothing finer than its pixels is left.
//!
//! Source: Turkowski 1990, "Filters for common resampling tasks" (Graphics Gems).

use crate::region::{Planes, Region};
use crate::setting::section;

section! {
    /// Size of the picture; with none of the lengths it stays.
    Resize "resize" {
        width: Option<u32> = None, "px", Number(1.0, 65_535.0),
            "width; with the height alone it follows the shape";
        height: Option<u32> = None, "px", Number(1.0, 65_535.0),
            "height";
        long_edge: Option<u32> = None, "px", Number(1.0, 65_535.0),
            "the longer side; wins over width and height";
    }
}

/// Zero crossings of the window.
const LOBES: f64 = 3.0;

/// Columns and rows of the picture from its own and the settings; a width or a height alone keeps the shape.
pub fn target([width, height]: [usize; 2], settings: &Resize) -> [usize; 2] {
    let (w, h) = (width as f64, height as f64);
    let scaled = |factor: f64| [(w * factor).round().max(1.0) as usize, (h * factor).round().max(1.0) as usize];
    match (settings.long_edge, settings.width, settings.height) {
        (Some(edge), ..) => scaled(f64::from(edge) / w.max(h)),
        (None, Some(a), Some(b)) => [a as usize, b as usize],
        (None, Some(a), None) => [a as usize, scaled(f64::from(a) / w)[1]],
        (None, None, Some(b)) => [scaled(f64::from(b) / h)[0], b as usize],
        (None, None, None) => [width, height],
    }
}

/// One direction: how a length becomes another.
#[derive(Clone, Copy, Debug)]
pub struct Axis {
    /// Pixels of the source for one of the result.
    scale: f64,
}

impl Axis {
    /// From a number of pixels to another.
    pub fn new(from: usize, to: usize) -> Self {
        Axis { scale: from as f64 / to as f64 }
    }

    fn reach(self) -> f64 {
        LOBES * self.scale.max(1.0)
    }

    /// The source pixels that `count` pixels from `first` on are made of.
    pub fn source(self, first: i64, count: usize) -> (i64, usize) {
        let low = (first as f64 + 0.5) * self.scale - self.reach();
        let high = (first as f64 + count as f64 - 0.5) * self.scale + self.reach();
        let low_pixel = low.floor() as i64 - 1;
        (low_pixel, (high.ceil() as i64 + 1 - low_pixel) as usize)
    }

    /// First source pixel and weights of one pixel of the result.
    fn weights(self, pixel: i64) -> (i64, Vec<f32>) {
        let center = (pixel as f64 + 0.5) * self.scale - 0.5;
        let first = (center - self.reach()).ceil() as i64;
        let last = (center + self.reach()).floor() as i64;
        let width = self.scale.max(1.0);
        let raw: Vec<f64> = (first..=last).map(|i| lanczos((i as f64 - center) / width)).collect();
        let sum: f64 = raw.iter().sum();
        (first, raw.iter().map(|v| (v / sum) as f32).collect())
    }
}

fn lanczos(x: f64) -> f64 {
    use std::f64::consts::PI;
    if x.abs() < 1e-9 {
        1.0
    } else if x.abs() >= LOBES {
        0.0
    } else {
        LOBES * (PI * x).sin() * (PI * x / LOBES).sin() / (PI * PI * x * x)
    }
}

/// The part of the source that a region of the result is made of.
pub fn source(region: Region, [x, y]: [Axis; 2]) -> Region {
    let (left, width) = x.source(region.left, region.width);
    let (top, height) = y.source(region.top, region.height);
    Region { left, top, width, height }
}

/// A region of the result from the planes of [`source`].
pub fn apply(from: &Planes, region: Region, [x, y]: [Axis; 2]) -> Planes {
    let columns: Vec<_> = (region.left..region.right()).map(|c| x.weights(c)).collect();
    let rows: Vec<_> = (region.top..region.bottom()).map(|r| y.weights(r)).collect();
    let (w, h) = (from.region.width, from.region.height);
    let planes = from.planes.iter().map(|plane| {
        let mut across = vec![0.0f32; region.width * h];
        for (line, to) in plane.chunks_exact(w).zip(across.chunks_exact_mut(region.width)) {
            for (v, (first, weights)) in to.iter_mut().zip(&columns) {
                let start = (first - from.region.left) as usize;
                *v = line[start..].iter().zip(weights).map(|(a, b)| a * b).sum();
            }
        }
        let mut out = vec![0.0f32; region.area()];
        for (to, (first, weights)) in out.chunks_exact_mut(region.width).zip(&rows) {
            let start = (first - from.region.top) as usize;
            for (k, weight) in weights.iter().enumerate() {
                let line = &across[(start + k) * region.width..][..region.width];
                to.iter_mut().zip(line).for_each(|(v, a)| *v += weight * a);
            }
        }
        out
    });
    Planes { region, planes: planes.collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn resized(f: impl Fn(i64, i64) -> f32, from: [usize; 2], to: [usize; 2]) -> Vec<f32> {
        let axes = [Axis::new(from[0], to[0]), Axis::new(from[1], to[1])];
        let region = Region::whole(to[0], to[1]);
        let around = source(region, axes);
        let at = |i: usize| f(around.left + (i % around.width) as i64, around.top + (i / around.width) as i64);
        let plane = (0..around.area()).map(at).collect();
        apply(&Planes { region: around, planes: vec![plane] }, region, axes).planes.remove(0)
    }

    #[test]
    fn flats_and_ramps_keep_their_values() {
        for to in [[7, 5], [40, 30], [100, 90], [400, 300]] {
            assert!(resized(|_, _| 0.7, [100, 90], to).iter().all(|v| (v - 0.7).abs() < 1e-5));
            let ramp = resized(|x, _| (x as f32 + 0.5) / 100.0, [100, 90], to);
            for (i, v) in ramp.iter().enumerate() {
                let expected = ((i % to[0]) as f32 + 0.5) / to[0] as f32;
                assert!((v - expected).abs() < 3e-3, "{to:?} {i}: {v} {expected}");
            }
        }
    }

    #[test]
    fn what_is_too_fine_becomes_even() {
        let stripes = resized(|x, _| (x.rem_euclid(2)) as f32, [100, 90], [25, 22]);
        assert!(stripes.iter().all(|v| (v - 0.5).abs() < 0.02), "{stripes:?}");
    }

    #[test]
    fn sizes_follow_what_is_asked() {
        let asked = |width, height, long_edge| target([6000, 4000], &Resize { width, height, long_edge });
        assert_eq!(asked(None, None, None), [6000, 4000]);
        assert_eq!(asked(Some(1500), None, None), [1500, 1000]);
        assert_eq!(asked(None, Some(1000), None), [1500, 1000]);
        assert_eq!(asked(Some(10), Some(1000), None), [10, 1000]);
        assert_eq!(asked(Some(7), None, Some(3000)), [3000, 2000]);
        assert_eq!(target([1, 5000], &Resize { long_edge: Some(10), ..Resize::default() }), [1, 10]);
    }
}
