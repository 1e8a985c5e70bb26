//! Single pixels that still stand out of all their neighbours when a filter is done.
//!
//! Noise with rare samples of great weight makes places where both halves of the samples happen to agree, so that a filter takes them for detail: one in some
//! hundred pixels, a tenth and more too bright. A mosaic sees such a pixel in one colour. Lens, pixel and low-pass filter let no light of a scene
//! fall into one pixel alone, but for points as bright as stars: what stands out by little is noise, and is brought to its neighbours. The light it loses is
//! given back around it afterwards ([`super::keep_light`]).

use diopter_image::Raster;
use rayon::prelude::*;

/// Rows around a row that its result depends on.
pub const REACH: usize = 1;
/// How far a pixel may stand out of all its neighbours, of their value.
const STANDS_OUT: f32 = 0.02;
/// From here on it is a point of light.
const POINT: f32 = 4.0;
/// A pixel whose albedo stands out by more, of its neighbours', is detail of the surface.
const ALBEDO: f32 = 0.02;
/// Darker differences of albedo are none.
const LEAST_ALBEDO: f32 = 1e-4;

/// Factors for each band of each pixel, `[row][column][band]`, 1 where nothing is to be done. `mean`: filtered, not negative; `albedo`: of the first surfaces, linear sRGB.
pub fn factors(mean: &Raster<f32>, albedo: &Raster<f32>) -> Vec<f32> {
    let (w, h, n) = (mean.width, mean.height, mean.channels);
    let of_surface: Vec<f32> = albedo.data.chunks_exact(albedo.channels).map(|a| a.iter().sum()).collect();
    let mut factors = vec![1.0; mean.data.len()];
    factors.par_chunks_mut(w * n).enumerate().for_each(|(y, line)| {
        for (x, pixel) in line.chunks_exact_mut(n).enumerate() {
            let rows = y.saturating_sub(1)..(y + 2).min(h);
            let columns = x.saturating_sub(1)..(x + 2).min(w);
            // At a corner three neighbours say too little.
            if rows.len() * columns.len() < 6 {
                continue;
            }
            let around = || rows.clone().flat_map(|j| columns.clone().map(move |i| j * w + i)).filter(|i| *i != y * w + x);
            let own = of_surface[y * w + x];
            let surface = Ends::of(around().map(|i| of_surface[i]));
            if own > surface.most * (1.0 + ALBEDO) + LEAST_ALBEDO || own < surface.least * (1.0 - ALBEDO) - LEAST_ALBEDO {
                continue;
            }
            let mut is_point = false;
            for (band, factor) in pixel.iter_mut().enumerate() {
                let own = mean.data[(y * w + x) * n + band];
                let near = Ends::of(around().map(|i| mean.data[i * n + band]));
                let (low, high) = (near.least * (1.0 - STANDS_OUT), near.most * (1.0 + STANDS_OUT));
                is_point |= own >= POINT * near.most;
                if own > 0.0 {
                    *factor = own.clamp(low, high.max(low)) / own;
                }
            }
            // A point keeps its colour.
            if is_point {
                pixel.fill(1.0);
            }
        }
    });
    factors
}

/// The least and the largest of some numbers.
struct Ends {
    least: f32,
    most: f32,
}

impl Ends {
    fn of(values: impl Iterator<Item = f32>) -> Self {
        let none = Ends { least: f32::INFINITY, most: f32::NEG_INFINITY };
        values.fold(none, |e, v| Ends { least: e.least.min(v), most: e.most.max(v) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn changed(at: impl Fn(usize, usize) -> f32, albedo: impl Fn(usize, usize) -> f32) -> Vec<(usize, f32)> {
        let (w, h) = (12, 10);
        let mut mean = Raster::new(w, h, 1);
        let mut surface = Raster::new(w, h, 3);
        for i in 0..w * h {
            mean.data[i] = at(i % w, i / w);
            surface.data[3 * i..3 * i + 3].fill(albedo(i % w, i / w));
        }
        factors(&mean, &surface).into_iter().enumerate().filter(|(_, f)| *f != 1.0).collect()
    }

    #[test]
    fn a_single_pixel_comes_to_its_neighbours() {
        for (own, expected) in [(1.6, 1.02 / 1.6), (0.7, 0.98 / 0.7)] {
            let found = changed(|x, y| if (x, y) == (5, 4) { own } else { 1.0 }, |_, _| 0.5);
            assert!(found.len() == 1 && found[0].0 == 4 * 12 + 5 && (found[0].1 - expected).abs() < 1e-6, "{found:?}");
        }
    }

    #[test]
    fn lines_edges_pairs_points_of_light_and_texture_stay() {
        let even = |_: usize, _: usize| 0.5;
        assert!(changed(|x, _| if x == 5 { 2.0 } else { 1.0 }, even).is_empty(), "a line");
        assert!(changed(|x, y| if x + y == 9 { 2.0 } else { 1.0 }, even).is_empty(), "a line aslant");
        assert!(changed(|x, y| if x > 5 && y > 3 { 2.0 } else { 1.0 }, even).is_empty(), "a corner");
        assert!(changed(|x, y| if (x, y) == (5, 4) { 5.0 } else { 1.0 }, even).is_empty(), "a star");
        let mut star = Raster::new(3, 3, 2);
        star.data = [[1.0, 1.0]; 9].into_iter().flatten().collect();
        (star.data[8], star.data[9]) = (5.0, 3.0);
        assert!(factors(&star, &Raster::new(3, 3, 3)).iter().all(|f| *f == 1.0), "a star of a colour");
        assert!(changed(|x, y| if y == 4 && x > 5 { 2.0 } else { 1.0 }, even).is_empty(), "the end of a line");
        let dot = |x: usize, y: usize| if (x, y) == (5, 4) { 0.6 } else { 0.5 };
        assert!(changed(|x, y| 2.0 * dot(x, y), dot).is_empty(), "a dot of paint");
        assert!(changed(|x, y| (1.0 + 0.01 * (x * 7 + y * 5) as f32).powi(2), even).is_empty(), "a slope");
    }
}
