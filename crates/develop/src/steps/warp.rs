//! A warp that the raw file asks for (opcode list 3 of a DNG): each pixel of the picture is taken from where the lens put it.

use super::lens::cubic;
use crate::region::{Planes, Region};
use diopter_image::dng::opcode::Warp;

/// The part of the taken picture that a region is made of. `size`: of the whole picture. Beyond its edges nothing is asked for.
pub fn source(warp: &Warp, region: Region, size: [usize; 2]) -> Region {
    let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
    // The mapping is smooth: a coarse grid and a margin hold it.
    let tick = |k: usize, n: usize| k as f64 / 8.0 * (n.max(1) - 1) as f64;
    for plane in 0..warp.radial.len().max(1) {
        for (row, column) in (0..=8).flat_map(|row| (0..=8).map(move |column| (row, column))) {
            let place = [region.left as f64 + tick(column, region.width), region.top as f64 + tick(row, region.height)];
            let from = warp.source(size, plane, place);
            for axis in 0..2 {
                low[axis] = low[axis].min(from[axis]);
                high[axis] = high[axis].max(from[axis]);
            }
        }
    }
    let side = |axis: usize| {
        let n = size[axis] as i64;
        let first = (low[axis].clamp(-1e9, 1e9).floor() as i64 - 4).clamp(-8, n);
        let end = (high[axis].clamp(-1e9, 1e9).ceil() as i64 + 5).clamp(first + 8, n + 16);
        (first, (end - first) as usize)
    };
    let ((left, width), (top, height)) = (side(0), side(1));
    Region { left, top, width, height }
}

/// A region of the corrected picture from the planes of [`source`].
pub fn apply(warp: &Warp, from: &Planes, region: Region, size: [usize; 2]) -> Planes {
    let mut out = Planes { region, planes: vec![vec![0.0; region.area()]; from.planes.len()] };
    for row in 0..region.height {
        let y = (region.top + row as i64) as f64;
        for column in 0..region.width {
            let x = (region.left + column as i64) as f64;
            let mut place = warp.source(size, 0, [x, y]);
            for (channel, (plane, to)) in from.planes.iter().zip(&mut out.planes).enumerate() {
                if channel > 0 && warp.radial.len() > 1 {
                    place = warp.source(size, channel, [x, y]);
                }
                // Far outside only the edge is seen.
                let [sx, sy] = place.map(|v| v.clamp(-1e6, 1e6) as f32);
                to[row * region.width + column] = cubic(plane, from.region, sx, sy);
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plane of a slope over a region.
    fn slope(region: Region) -> Planes {
        let value = |i: usize| {
            let (x, y) = (region.left + (i % region.width) as i64, region.top + (i / region.width) as i64);
            0.5 + 0.01 * x as f32 - 0.02 * y as f32
        };
        Planes { region, planes: vec![(0..region.area()).map(value).collect(); 3] }
    }

    #[test]
    fn pixels_come_from_where_the_lens_put_them() {
        let warp = Warp {
            radial: vec![[0.97, 0.02, 0.0, 0.0], [0.96, 0.02, 0.0, 0.0], [0.95, 0.02, 0.0, 0.0]],
            tangential: vec![[0.002, 0.001]; 3],
            center: [0.5, 0.45],
            fisheye: false,
        };
        let size = [120, 90];
        for region in [Region::whole(120, 90), Region { left: 30, top: 60, width: 17, height: 9 }] {
            let from = source(&warp, region, size);
            let got = apply(&warp, &slope(from), region, size);
            for (channel, plane) in got.planes.iter().enumerate() {
                for (i, v) in plane.iter().enumerate() {
                    let (x, y) =
                        ((region.left + (i % region.width) as i64) as f64, (region.top + (i / region.width) as i64) as f64);
                    let [sx, sy] = warp.source(size, channel, [x, y]);
                    let expected = 0.5 + 0.01 * sx - 0.02 * sy;
                    assert!((f64::from(*v) - expected).abs() < 1e-4, "{region:?} {channel} {x} {y}: {v} {expected}");
                }
            }
        }
    }

    #[test]
    fn a_warp_far_out_of_the_picture_asks_for_little() {
        let far = Warp { radial: vec![[50.0, 1e30, 0.0, 0.0]], tangential: vec![[0.0; 2]], center: [0.0; 2], fisheye: false };
        let from = source(&far, Region { left: 90, top: 60, width: 30, height: 30 }, [120, 90]);
        assert!(from.width <= 160 && from.height <= 130 && from.width >= 8 && from.height >= 8, "{from:?}");
        let out = apply(&far, &slope(from), Region::whole(120, 90), [120, 90]);
        assert!(out.planes[0].iter().all(|v| v.is_finite()));
    }
}
