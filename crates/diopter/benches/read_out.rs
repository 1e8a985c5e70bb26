//! How long a read-out and its file take: 24 megapixels, medians of five, ratios to the plain sum of the same rows.
//!
//! `cargo bench -p diopter --bench read_out`

mod shared;

use diopter::image::dng::Storage;
use diopter::image::{ExposureFacts, FocalPlane};
use diopter::light::cie::illuminant;
use diopter::sensor::noise::{mix, normal_quantile, poisson_quantile, unit};
use diopter::sensor::{Reading, Sensor, read_out};
use shared::median;

const SIZE: [usize; 2] = [6000, 4000];

/// A slanted ramp from nothing to twice the well: every path of the code is taken.
fn plane(sensor: &Sensor) -> FocalPlane {
    let bands = sensor.bands();
    let n = bands.len();
    let mut plane = FocalPlane::even(bands, &vec![0.0; n], SIZE, ExposureFacts { exposure_s: 1.0, ..Default::default() });
    let top = 2.0 * sensor.full_well_e as f32;
    for (i, pixel) in plane.mean.data.chunks_mut(n).enumerate() {
        let fraction = (i % SIZE[0]) as f32 / SIZE[0] as f32;
        pixel.fill(top * fraction.powi(4));
    }
    plane
}

fn main() {
    println!("{} × {} pixels, {} threads", SIZE[0], SIZE[1], rayon::current_num_threads());
    println!("one number, one thread, ns:");
    for mean in [0.1, 5.0, 20.0, 100.0, 1e4] {
        let mut sum = 0.0;
        let t = median(|| sum += (0..1_000_000).map(|i| poisson_quantile(mean, unit(mix(1, i)))).sum::<f64>());
        println!("  Poisson of mean {mean:<7} {:6.1}   (sum {sum:.0})", t * 1e3);
    }
    let mut sum = 0.0;
    let t = median(|| sum += (0..1_000_000).map(|i| normal_quantile(unit(mix(1, i)))).sum::<f64>());
    println!("  normal                  {:6.1}   (sum {sum:.0})", t * 1e3);
    let white = illuminant("D65").expect("D65 is embedded");
    for name in ["canon-t2i", "canon-5d-mark-iv", "imx249", "ideal"] {
        let sensor = Sensor::named(name).expect("an embedded body");
        let plane = plane(&sensor);
        let reading = Reading::new(sensor.iso[0].iso, 1);
        let mut raw = None;
        let t = median(|| raw = read_out(&plane, &sensor, &reading, &white).ok());
        println!("{name}: read-out {t:.2} s");
        let raw = raw.expect("it reads out");
        for storage in [Storage::Sixteen, Storage::Packed, Storage::Lossless] {
            let mut bytes = 0;
            let path = std::env::temp_dir().join("diopter-bench.dng");
            let t = median(|| {
                let file = std::io::BufWriter::new(std::fs::File::create(&path).expect("a temporary file"));
                diopter::raw_file::write_image(&raw, storage, &Default::default(), file).expect("it is written");
                bytes = std::fs::metadata(&path).map_or(0, |m| m.len());
            });
            println!("  DNG {storage:?}: {t:.2} s, {:.1} MB", bytes as f64 * 1e-6);
            let _ = std::fs::remove_file(&path);
        }
    }
}
