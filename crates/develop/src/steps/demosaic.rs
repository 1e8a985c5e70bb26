//! Fills in the colours a pixel did not see.
//!
//! Source: Malvar, He & Cutler 2004, "High-quality linear interpolation for demosaicing of Bayer-patterned color images"
//! (ICASSP); bilinear is the mean of the nearest neighbours of each colour. Edges are mirrored.

use crate::recipe::Demosaic;
use diopter_image::{Cfa, Raster};
use rayon::prelude::*;

/// All channels of each pixel from a mosaic.
pub fn demosaic(mosaic: &Raster<f32>, cfa: &Cfa, method: Demosaic) -> Raster<f32> {
    let channels = cfa.channel_count();
    if channels == 1 {
        return mosaic.clone();
    }
    let mut full = Raster::new(mosaic.width, mosaic.height, channels);
    let width = mosaic.width;
    let gradients = cfa.is_bayer() && method == Demosaic::MalvarHeCutler;
    full.data.par_chunks_mut(width * channels).enumerate().for_each(|(row, line)| {
        for (column, pixel) in line.chunks_mut(channels).enumerate() {
            match gradients {
                true => pixel.copy_from_slice(&malvar(mosaic, cfa, column as i64, row as i64)),
                false => nearest_mean(mosaic, cfa, column as i64, row as i64, pixel),
            }
        }
    });
    full
}

/// Index reflected at the edges, without repeating the edge pixel (keeps the phase of a Bayer pattern).
fn mirror(i: i64, n: usize) -> usize {
    let n = n as i64;
    if n == 1 {
        return 0;
    }
    let period = 2 * (n - 1);
    let i = i.rem_euclid(period);
    (if i < n { i } else { period - i }) as usize
}

fn at(mosaic: &Raster<f32>, column: i64, row: i64) -> f32 {
    mosaic.pixel(mirror(column, mosaic.width), mirror(row, mosaic.height))[0]
}

/// Mean of each colour within the smallest square that holds it.
fn nearest_mean(mosaic: &Raster<f32>, cfa: &Cfa, column: i64, row: i64, pixel: &mut [f32]) {
    let own = cfa.channel_at(column as usize, row as usize);
    let reach = cfa.columns().max(cfa.rows()) as i64;
    for (channel, value) in pixel.iter_mut().enumerate() {
        *value = at(mosaic, column, row);
        if channel == own {
            continue;
        }
        for radius in 1..=reach {
            let (mut sum, mut n) = (0.0, 0.0);
            for dy in -radius..=radius {
                for dx in -radius..=radius {
                    let (c, r) = (mirror(column + dx, mosaic.width), mirror(row + dy, mosaic.height));
                    if cfa.channel_at(c, r) == channel {
                        // Nearer ones count more: the four sides before the corners.
                        let weight = 1.0 / (dx * dx + dy * dy) as f32;
                        sum += mosaic.pixel(c, r)[0] * weight;
                        n += weight;
                    }
                }
            }
            if n > 0.0 {
                *value = sum / n;
                break;
            }
        }
    }
}

fn malvar(mosaic: &Raster<f32>, cfa: &Cfa, x: i64, y: i64) -> [f32; 3] {
    let p = |dx: i64, dy: i64| at(mosaic, x + dx, y + dy);
    let own = cfa.channel_at(x as usize, y as usize);
    let here = p(0, 0);
    let cross1 = p(-1, 0) + p(1, 0) + p(0, -1) + p(0, 1);
    let cross2 = p(-2, 0) + p(2, 0) + p(0, -2) + p(0, 2);
    let diagonal = p(-1, -1) + p(1, -1) + p(-1, 1) + p(1, 1);
    let mut rgb = [0.0; 3];
    rgb[own] = here;
    if own == 1 {
        // Green: one of the others lies left and right, the other above and below.
        let beside = cfa.channel_at(x as usize + 1, y as usize);
        let other = 2 - beside;
        let (h1, v1) = (p(-1, 0) + p(1, 0), p(0, -1) + p(0, 1));
        let (h2, v2) = (p(-2, 0) + p(2, 0), p(0, -2) + p(0, 2));
        rgb[beside] = (5.0 * here + 4.0 * h1 - h2 - diagonal + 0.5 * v2) / 8.0;
        rgb[other] = (5.0 * here + 4.0 * v1 - v2 - diagonal + 0.5 * h2) / 8.0;
    } else {
        rgb[1] = (4.0 * here + 2.0 * cross1 - cross2) / 8.0;
        rgb[2 - own] = (6.0 * here + 2.0 * diagonal - 1.5 * cross2) / 8.0;
    }
    rgb
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mosaic_of(f: impl Fn(usize, usize) -> [f32; 3], cfa: &Cfa) -> Raster<f32> {
        let mut m = Raster::new(24, 16, 1);
        for row in 0..16 {
            for column in 0..24 {
                m.pixel_mut(column, row)[0] = f(column, row)[cfa.channel_at(column, row)];
            }
        }
        m
    }

    #[test]
    fn flat_colours_are_exact_in_every_phase() {
        for pattern in ["RG/GB", "GR/BG", "GB/RG", "BG/GR"] {
            let cfa = Cfa::parse(pattern).unwrap();
            // A coloured flat is exact for bilinear; the gradient-corrected filters keep it exact too.
            let mosaic = mosaic_of(|_, _| [0.2, 0.5, 0.8], &cfa);
            for method in [Demosaic::Bilinear, Demosaic::MalvarHeCutler] {
                let rgb = demosaic(&mosaic, &cfa, method);
                for (i, v) in rgb.data.iter().enumerate() {
                    assert!((v - [0.2, 0.5, 0.8][i % 3]).abs() < 1e-5, "{pattern} {method:?} pixel {} {v}", i / 3);
                }
            }
        }
    }

    #[test]
    fn grey_ramps_are_exact_inside() {
        let cfa = Cfa::parse("RG/GB").unwrap();
        let mosaic = mosaic_of(|c, r| [0.01 * c as f32 + 0.02 * r as f32; 3], &cfa);
        let rgb = demosaic(&mosaic, &cfa, Demosaic::MalvarHeCutler);
        for row in 2..14 {
            for column in 2..22 {
                let expected = 0.01 * column as f32 + 0.02 * row as f32;
                assert!(rgb.pixel(column, row).iter().all(|v| (v - expected).abs() < 1e-5));
            }
        }
    }

    #[test]
    fn one_pixel_and_odd_patterns_do_no_harm() {
        let cfa = Cfa::parse("RG/GB").unwrap();
        let one = Raster { width: 1, height: 1, channels: 1, data: vec![0.5f32] };
        assert_eq!(demosaic(&one, &cfa, Demosaic::MalvarHeCutler).data.len(), 3);
        let xtrans = Cfa::parse("GRGGBG/BGBRGR/GRGGBG/GBGGRG/RGRBGB/GBGGRG").unwrap();
        let rgb = demosaic(&mosaic_of(|_, _| [0.3; 3], &xtrans), &xtrans, Demosaic::MalvarHeCutler);
        assert!(rgb.data.iter().all(|v| (v - 0.3).abs() < 1e-6));
    }
}
