//! False colour: what every mosaic makes of details smaller than its cells, seen as coloured dots around glints and along hard edges.
//!
//! Where a channel changes strongly from pixel to pixel, ratios of red and of blue to green that are among the two least or largest of 3 × 3 pixels give way
//! to their median, pass by pass; green, most of the brightness, stays. Ratios and not differences, which change with brightness where the colour does not. Elsewhere nothing
//! is done: noise, fine coloured lines and soft edges are as the demosaic left them. Source: Freeman 1988, "Median filter for reconstructing missing color
//! samples" (US patent 4,724,395, expired), as dcraw's `-m` and the colour smoothing of darktable; conditions on ranks: Hardie &
//! Boncelet 1993, "LUM filters" (IEEE Trans. Signal Processing 41); the limit to strong contrast is ours.

use crate::region::{Planes, Region, cut};

/// Pixels around a pixel that one pass looks at.
pub const REACH: usize = 1;

/// Largest over least value of a channel in 3 × 3 pixels from which on colours are smoothed: an edge that a sharp lens draws from one pixel to the next. Of 2, 3, 4
/// and 6, with ranks of 1, 2 and all, one that leaves 0.013 % of coloured dots in the default photograph (0.055 % without) for half a decibel on photographs.
const CONTRAST: f32 = 4.0;

/// What is added to values before they are compared, of white: dark noise is no edge.
const DARK: f32 = 0.05;

/// How many of the other eight ratios may lie beyond one that gives way.
const BEYOND: usize = 1;

/// What is added to both sides of a ratio, of white.
const OFFSET: f32 = 0.01;

/// One pass over planes of red, green and blue, of which the result is smaller by [`REACH`] on each side.
pub fn pass(planes: &Planes) -> Planes {
    let from = planes.region;
    let region = Region {
        left: from.left + REACH as i64,
        top: from.top + REACH as i64,
        width: from.width - 2 * REACH,
        height: from.height - 2 * REACH,
    };
    let mut out = Planes { region, planes: planes.planes.iter().map(|p| cut(p, from, region)).collect() };
    let green = &planes.planes[1];
    let strong = edges(planes);
    for y in 0..region.height {
        for x in 0..region.width {
            let middle = (y + 1) * from.width + x + 1;
            if !strong[middle] {
                continue;
            }
            let rows = [middle - from.width, middle, middle + from.width];
            for channel in [0, 2] {
                let plane = &planes.planes[channel];
                let mut ratios = [0.0; 9];
                for (three, i) in ratios.as_chunks_mut::<3>().0.iter_mut().zip(rows) {
                    *three = std::array::from_fn(|k| (plane[i + k - 1].max(0.0) + OFFSET) / (green[i + k - 1].max(0.0) + OFFSET));
                }
                let own = ratios[4];
                let beyond = |is: fn(f32, f32) -> bool| ratios.iter().filter(|r| is(**r, own)).count();
                if beyond(|r, own| r < own).min(beyond(|r, own| r > own)) > BEYOND {
                    continue;
                }
                let median = *ratios.select_nth_unstable_by(4, f32::total_cmp).1;
                out.planes[channel][y * region.width + x] = median * (green[middle].max(0.0) + OFFSET) - OFFSET;
            }
        }
    }
    out
}

/// Whether a channel changes strongly among the 3 × 3 pixels around a pixel; not told at the border.
fn edges(planes: &Planes) -> Vec<bool> {
    let width = planes.region.width;
    let mut strong = vec![false; planes.region.area()];
    for plane in &planes.planes {
        // Least and largest of three pixels across, then of three such rows.
        let across: Vec<[f32; 2]> = (0..plane.len())
            .map(|i| ends(plane[i.saturating_sub(1)..(i + 2).min(plane.len())].iter().map(|v| [*v, *v])))
            .collect();
        for i in width..plane.len().saturating_sub(width) {
            let [least, most] = ends([across[i - width], across[i], across[i + width]].into_iter());
            strong[i] |= most + DARK > CONTRAST * (least.max(0.0) + DARK);
        }
    }
    strong
}

/// The least of least and the largest of largest values.
fn ends(pairs: impl Iterator<Item = [f32; 2]>) -> [f32; 2] {
    pairs.fold([f32::INFINITY, f32::NEG_INFINITY], |[least, most], [a, b]| [least.min(a), most.max(b)])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn planes(width: usize, height: usize, at: impl Fn(usize, usize) -> [f32; 3]) -> Planes {
        let plane = |c: usize| (0..width * height).map(|i| at(i % width, i / width)[c]).collect();
        Planes { region: Region::whole(width, height), planes: (0..3).map(plane).collect() }
    }

    #[test]
    fn a_coloured_dot_beside_a_glint_takes_the_colour_around() {
        // A grey field, a white glint of 3 × 3 pixels, and red at its rim where there is none.
        let glint = |x: usize, y: usize| (4..7).contains(&x) && (4..7).contains(&y);
        let field = planes(11, 11, |x, y| match (x, y) {
            (7, 5) => [0.6, 0.1, 0.1],
            _ if glint(x, y) => [0.9; 3],
            _ => [0.1; 3],
        });
        let out = pass(&field);
        // Pixel (7, 5) is (6, 4) without the border.
        let dot = out.planes.iter().map(|p| p[4 * 9 + 6]).collect::<Vec<_>>();
        assert!((dot[0] - 0.1).abs() < 1e-6 && dot[1] == 0.1, "{dot:?}");
        // The glint and the field stay what they are.
        for (x, y) in [(5, 5), (4, 4), (2, 8)] {
            assert!(out.planes.iter().all(|p| (p[(y - 1) * 9 + x - 1] - if glint(x, y) { 0.9 } else { 0.1 }).abs() < 1e-6));
        }
    }

    #[test]
    fn what_has_little_contrast_is_left_to_the_bit() {
        // Lines of one pixel in colour, noise, and the dark.
        let field = planes(40, 30, |x, y| match x % 10 {
            3 => [0.38, 0.3, 0.2],
            7 => [0.2 + 0.02 * (x * y % 7) as f32, 0.002 * (x + 3 * y) as f32 % 0.01 + 0.25, 0.3],
            _ => [0.2, 0.25 + 0.1 * ((x * 7 + y * 13) % 5) as f32 / 5.0, 0.3],
        });
        assert_eq!(pass(&field), field.clone().cut(Region { left: 1, top: 1, width: 38, height: 28 }));
        let dark = planes(12, 12, |x, y| [0.0, 0.004 * ((x * 5 + y * 3) % 4) as f32, 0.01]);
        assert_eq!(pass(&dark).planes, dark.clone().cut(Region { left: 1, top: 1, width: 10, height: 10 }).planes);
    }

    #[test]
    fn a_hard_edge_between_two_colours_stays_where_it_is() {
        let edge = planes(20, 9, |x, _| if x < 10 { [0.8, 0.1, 0.1] } else { [0.9, 0.9, 0.9] });
        let mut out = edge.clone();
        for _ in 0..3 {
            out = pass(&out);
        }
        let expected = edge.cut(out.region);
        for (a, b) in out.planes.iter().flatten().zip(expected.planes.iter().flatten()) {
            assert!((a - b).abs() < 1e-6, "{a} {b}");
        }
    }
}
