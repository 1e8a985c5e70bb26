//! Focal planes denoised by the built-in filter: processor seconds a megapixel, how much light is kept, and the error against a reference.
//!
//! `cargo bench -p diopter-develop --bench denoise -- PLANE.exr REFERENCE.exr ...`; relMSE = mean of (a - r)² / (r² + (0.01 of white)²) over pixels
//! and bands, less what the reference's own variance makes of it.

use diopter_develop::denoise;
use diopter_image::{FocalPlane, exr};
use std::fs::File;
use std::io::BufReader;
use std::time::Instant;

fn main() {
    let files: Vec<String> = std::env::args().skip(1).filter(|a| a.ends_with(".exr")).collect();
    let read = |p: &str| exr::read_focal_plane(BufReader::new(File::open(p).expect("the file opens"))).expect("a focal plane");
    println!("{} threads", rayon::current_num_threads());
    for pair in files.chunks_exact(2) {
        let (plane, reference) = (read(&pair[0]), read(&pair[1]));
        let (begun, processor) = (Instant::now(), processor_s());
        let out = denoise(&plane);
        let (wall, processor) = (begun.elapsed().as_secs_f64(), processor_s() - processor);
        let megapixels = 1e-6 * (plane.width() * plane.height()) as f64;
        println!(
            "{}: relMSE {:.5} -> {:.5}   light x {:.5}   {:.2} s, {:.2} processor s a megapixel",
            pair[0],
            relmse(&plane, &reference),
            relmse(&out, &reference),
            sum(&out) / sum(&plane),
            wall,
            processor / megapixels
        );
    }
}

fn sum(plane: &FocalPlane) -> f64 {
    plane.mean.data.iter().map(|v| f64::from(*v)).sum()
}

/// Error of a plane, scaled to the light of the reference band by band as a whole: exposure times that were metered differ a little.
fn relmse(plane: &FocalPlane, reference: &FocalPlane) -> f64 {
    let n = plane.bands.len();
    let scale = plane.facts.exposure_s / reference.facts.exposure_s;
    let mut error = 0.0;
    for b in 0..n {
        let (got, truth) = (plane.mean.channel(b), reference.mean.channel(b));
        let own = reference.half_difference.channel(b);
        let mut sorted = truth.clone();
        sorted.sort_by(f32::total_cmp);
        let floor = (0.01 * scale * f64::from(sorted[sorted.len() * 99 / 100])).powi(2);
        for i in 0..got.len() {
            let r = scale * f64::from(truth[i]);
            let noise = scale * f64::from(own[i]);
            error += ((f64::from(got[i]) - r).powi(2) - noise * noise) / (r * r + floor);
        }
    }
    error / plane.mean.data.len() as f64
}

/// Processor time of this process so far, s; that of the clock where the system does not say.
fn processor_s() -> f64 {
    let ticks = || {
        let text = std::fs::read_to_string("/proc/self/stat").ok()?;
        let fields: Vec<&str> = text.rsplit_once(')')?.1.split_whitespace().collect();
        Some((fields.get(11)?.parse::<f64>().ok()? + fields.get(12)?.parse::<f64>().ok()?) / 100.0)
    };
    ticks().unwrap_or_else(|| std::time::UNIX_EPOCH.elapsed().map_or(0.0, |t| t.as_secs_f64()))
}
