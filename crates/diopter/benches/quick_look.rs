//! The quick look of a picture of 1920 × 1280 pixels: `cargo bench -p diopter --bench quick_look`.
//!
//! A receding floor with balls before it, from 1 to 40 m, 50 mm f/2 focused at 3 m on 36 × 24 mm; medians.

use diopter::image::Raster;
use diopter::lens::Iris;
use diopter::quick_look::{Optics, quick_look};
use std::time::Instant;

fn main() {
    let (w, h) = (1920, 1280);
    let mut picture = Raster::<f32>::new(w, h, 3);
    let mut depth = vec![0.0f32; w * h];
    for i in 0..w * h {
        let (x, y) = (i % w, i / w);
        let tone = if (x / 40 + y / 40) % 2 == 0 { 0.8 } else { 0.2 };
        picture.data[3 * i..3 * i + 3].fill(tone);
        depth[i] = 1.2 / ((y as f32 + 40.0) / h as f32);
        let ball = (x as f32 - 700.0).hypot(y as f32 - 600.0) < 180.0;
        if ball {
            depth[i] = 1.5;
        }
    }
    for (name, iris) in [("round", Iris::Round), ("seven blades", Iris::blades(7, 0.0, 0.0).expect("blades"))] {
        let optics = Optics::thin(50.0, 2.0, 3.0, 36.0, &iris);
        let mut times: Vec<f64> = (0..5)
            .map(|_| {
                let begun = Instant::now();
                let out = quick_look(&picture, &depth, &optics).expect("a depth for each pixel");
                assert!(out.data[0].is_finite());
                begun.elapsed().as_secs_f64()
            })
            .collect();
        times.sort_by(f64::total_cmp);
        let radii: f64 = depth.iter().map(|z| optics.radius_px(f64::from(*z), w).abs()).sum::<f64>() / depth.len() as f64;
        println!("{name}: {:.2} s, mean radius {radii:.1} px", times[2]);
    }
}
