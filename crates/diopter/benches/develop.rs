//! How long development takes: 24 megapixels, medians of five.
//!
//! `cargo bench -p diopter --bench develop [RAW.dng]`; without a file a Bayer mosaic made by code. Beside other programs: `validation/converters_speed.py`.

mod shared;

use diopter::develop::lut::Lut;
use diopter::develop::{Developer, Interpolation, LutInput, Recipe, bake};
use diopter::image::raw::Cfa;
use diopter::image::{ExposureFacts, PictureSource, Raster, RawHeader, RawImage, dng, jpeg};
use shared::median;
use std::hint::black_box;

const SIZE: [usize; 2] = [6000, 4000];

/// Waves of several sizes and a little noise.
fn mosaic() -> RawImage {
    let value = |i: usize| {
        let (x, y) = ((i % SIZE[0]) as f32, (i / SIZE[0]) as f32);
        let wave = (x / 37.0).sin() * (y / 29.0).cos() + 0.5 * (x / 211.0 + y / 173.0).sin();
        let noise = (i.wrapping_mul(0x9e37_79b9) >> 7) as u16 % 97;
        (4000.0 + 2500.0 * wave) as u16 + noise
    };
    let cfa = Cfa::parse("RG/GB").unwrap_or_else(Cfa::monochrome);
    RawImage {
        mosaic: Raster { width: SIZE[0], height: SIZE[1], channels: 1, data: (0..SIZE[0] * SIZE[1]).map(value).collect() },
        header: RawHeader {
            cfa,
            bits: 14,
            black_level: 512.0,
            white_level: 15_000.0,
            as_shot_neutral: vec![0.5, 1.0, 0.7],
            calibrations: vec![],
            baseline_ev: 0.0,
            framing: Default::default(),
            opcodes: vec![],
            warnings: vec![],
            noise: vec![[1e-4, 1e-7]; 3],
            facts: ExposureFacts::default(),
        },
    }
}

fn main() {
    let path = std::env::args().skip(1).find(|a| a.ends_with(".dng"));
    let raw = match &path {
        Some(p) => dng::read(std::fs::File::open(p).expect("the file opens")).expect("it is a DNG"),
        None => mosaic(),
    };
    let (w, h) = (raw.mosaic.width, raw.mosaic.height);
    println!("{w} × {h} pixels, {} threads, seconds:", rayon::current_num_threads());
    let run = |name: &str, recipe: &Recipe, lut: Option<Lut>| {
        let mut bytes = 0;
        let t = median(|| {
            let mut file = Vec::new();
            let developer = Developer::new(&raw, recipe, lut.clone()).expect("the recipe fits");
            jpeg::write(&developer, 92, &mut file).expect("it is written");
            bytes = file.len();
        });
        println!("  {name:<24} raw → JPEG {t:.2}   ({:.1} MB)", bytes as f64 * 1e-6);
    };
    for preset in Recipe::PRESETS {
        run(preset, &Recipe::preset(preset).expect("a preset"), None);
    }
    for (name, value) in [
        ("demosaic.method", "rcd"),
        ("demosaic.method", "malvar-he-cutler"),
        ("demosaic.method", "half"),
        ("tone.curve", "aces-1.3"),
        ("tone.curve", "aces-2.0"),
        ("tone.curve", "agx"),
        ("resize.long_edge", "1920"),
    ] {
        run(value, &Recipe::default().with(name, value).expect("a setting"), None);
    }
    let baked = bake(&Recipe::default(), None, 33, LutInput::Log);
    let mut looked = Recipe::default();
    looked.lut.input = LutInput::Log;
    run("a baked 33³ table", &looked, Some(baked.lut.clone()));
    let developer = Recipe::default();
    let picture = Developer::new(&raw, &developer, None).expect("the recipe fits").whole();
    for how in [Interpolation::Tetrahedral, Interpolation::Trilinear] {
        let mut pixels = picture.pixels.data.clone();
        let t = median(|| baked.lut.apply(black_box(&mut pixels), how));
        println!("  33³ table on the picture, {how:?}: {t:.3}");
    }
}
