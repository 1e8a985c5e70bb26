//! Bayer by 5 × 5 linear filters that correct by the gradient of the known colour.
//!
//! Source: Malvar, He & Cutler 2004, "High-quality linear interpolation for demosaicing of Bayer-patterned color images" (ICASSP).

use super::Mosaic;
use crate::region::Region;

/// Red, green and blue of the pixels of `region`, `[channel][row × column]`, from a mosaic that reaches 2 pixels further on each side.
pub fn run(mosaic: &Mosaic, region: Region) -> Vec<Vec<f32>> {
    let w = mosaic.region.width;
    let (ox, oy) = ((region.left - mosaic.region.left) as usize, (region.top - mosaic.region.top) as usize);
    let mut planes = vec![vec![0.0; region.area()]; 3];
    for row in 0..region.height {
        for column in 0..region.width {
            let (x, y) = (ox + column, oy + row);
            let at = y * w + x;
            let p = |dx: isize, dy: isize| mosaic.data[(at as isize + dy * w as isize + dx) as usize];
            let here = p(0, 0);
            let (h1, v1) = (p(-1, 0) + p(1, 0), p(0, -1) + p(0, 1));
            let (h2, v2) = (p(-2, 0) + p(2, 0), p(0, -2) + p(0, 2));
            let diagonal = p(-1, -1) + p(1, -1) + p(-1, 1) + p(1, 1);
            let to = row * region.width + column;
            let own = mosaic.channel(x, y);
            planes[own][to] = here;
            if own == 1 {
                // Green: one of the others lies left and right, the other above and below.
                let beside = mosaic.channel(x + 1, y);
                planes[beside][to] = (5.0 * here + 4.0 * h1 - h2 - diagonal + 0.5 * v2) / 8.0;
                planes[2 - beside][to] = (5.0 * here + 4.0 * v1 - v2 - diagonal + 0.5 * h2) / 8.0;
            } else {
                planes[1][to] = (4.0 * here + 2.0 * (h1 + v1) - h2 - v2) / 8.0;
                planes[2 - own][to] = (6.0 * here + 2.0 * diagonal - 1.5 * (h2 + v2)) / 8.0;
            }
        }
    }
    planes
}
