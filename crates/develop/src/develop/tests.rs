use super::*;
use crate::recipe::{Demosaic, HighlightMethod};
use crate::tests::raw;
use diopter_image::raw::{Cfa, Framing, Orientation};

fn photo() -> RawImage {
    let cfa = Cfa::parse("RG/GB").unwrap();
    raw(700, 300, "RG/GB", |x, y| {
        let (fx, fy) = (x as f64, y as f64);
        100.0 + 90.0 * (fx / 17.0).sin() + 50.0 * (fy / 9.0).cos() + 40.0 * cfa.channel_at(x, y) as f64 + fx
    })
}

#[test]
fn rows_are_those_of_the_whole() {
    let image = photo();
    for (name, value) in [
        ("exposure.ev", "0.5"),
        ("noise.luminance", "0.5"),
        ("sharpen.amount", "1"),
        ("resize.width", "333"),
        ("local.compression", "0.4"),
    ] {
        let recipe = Recipe::default().with(name, value).unwrap();
        let developer = Developer::new(&image, &recipe, None).unwrap();
        let whole = developer.whole();
        let [w, h] = developer.size();
        assert_eq!([whole.pixels.width, whole.pixels.height], [w, h]);
        let part = developer.rows(h / 3, 21);
        let worst = part.iter().zip(&whole.pixels.data[h / 3 * w * 3..]).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 1e-5, "{name}: {worst}");
    }
}

#[test]
fn every_orientation_shows_the_same_picture() {
    let image = photo();
    let recipe = Recipe::default();
    let upright = develop(&image, &recipe, None).unwrap().pixels;
    // Where a corner of the stored picture goes: EXIF 2.32, table of tag 274 (row 0 and column 0 of what is stored).
    for (number, corner) in
        [(1, [0, 0]), (2, [1, 0]), (3, [1, 1]), (4, [0, 1]), (5, [0, 0]), (6, [1, 0]), (7, [1, 1]), (8, [0, 1])]
    {
        let mut turned = image.clone();
        turned.header.framing = Framing { orientation: Orientation::from_exif(number), ..Framing::default() };
        let got = develop(&turned, &recipe, None).unwrap().pixels;
        let expected = if number >= 5 { [300, 700] } else { [700, 300] };
        assert_eq!([got.width, got.height], expected, "{number}");
        let at = got.pixel(corner[0] * (got.width - 1), corner[1] * (got.height - 1));
        assert_eq!(at, upright.pixel(0, 0), "{number}");
    }
}

#[test]
fn grey_light_of_a_metered_shot_is_middle_grey() {
    // 10/78 of saturation in every channel.
    let image = raw(64, 64, "RG/GB", |_, _| 1000.0 * 10.0 / 78.0);
    for name in crate::recipe::Recipe::PRESETS.into_iter().filter(|n| *n != "film") {
        let picture = develop(&image, &Recipe::preset(name).unwrap(), None).unwrap();
        let code = picture.pixels.pixel(32, 32);
        assert!((code[1] - 0.4614).abs() < 0.01, "{name} {code:?}");
    }
}

/// A raw image with all channels in every pixel, of the tests' levels (black 100, saturated at 1100).
fn linear(width: usize, height: usize, dn: impl Fn(usize, usize, usize) -> f64) -> RawImage {
    // Numbers of "mono" are placed freely.
    let mut image = raw(3 * width, height, "mono", |x, y| dn(x / 3, y, x % 3));
    image.header.cfa = Cfa::linear_rgb();
    image.header.as_shot_neutral = vec![1.0; 3];
    image
}

#[test]
fn corrections_of_the_file_come_behind_the_demosaic() {
    let terms = [1.0, 0.0, 0.0, 0.0, 0.0];
    let vignette = Opcode { optional: false, action: Action::FixVignetteRadial { terms, center: [0.5, 0.5] } };
    // A warp that shows half of the picture: twice as large.
    let halves = Warp { radial: vec![[0.5, 0.0, 0.0, 0.0]], tangential: vec![[0.0; 2]], center: [0.5, 0.5], fisheye: false };
    let warp = Opcode { optional: false, action: Action::Warp(halves) };
    let recipe = Recipe::preset("plain").unwrap();
    let level = |x: usize| 100.0 + 2.0 * x as f64;
    for pattern in ["RG/GB", "mono"] {
        for half in [false, true] {
            let mut recipe = recipe.clone();
            recipe.demosaic.method = if half { Demosaic::Half } else { Demosaic::Linear };
            let seen = |opcodes: Vec<Opcode>, x: usize| {
                let mut image = raw(81, 61, pattern, |x, _| level(x));
                image.header.as_shot_neutral[0] = 0.5;
                image.header.opcodes = opcodes;
                let developer = Developer::new(&image, &recipe, None).unwrap();
                // Camera channels, shown by the sRGB function.
                let picture = developer.until(Step::LensCorrection).whole().pixels;
                let (x, y) = if half { (x / 2, 15) } else { (x, 30) };
                f64::from(encode::srgb_light(Vec3::splat(picture.pixel(x, y)[1])).x)
            };
            let plain = |x: usize| seen(vec![], x);
            let unit = 40f64.hypot(30.0);
            for x in [10, 40, 66] {
                let r2 = ((x as f64 + if half { 1.0 } else { 0.0 } - 40.0) / unit).powi(2);
                let bright = seen(vec![vignette.clone()], x);
                assert!((bright / plain(x) / (1.0 + r2) - 1.0).abs() < 0.01, "{pattern} {half} {x}: {bright}");
                let moved = seen(vec![warp.clone()], x);
                let from = plain((40.0 + 0.5 * (x as f64 - 40.0)).round() as usize);
                assert!((moved / from - 1.0).abs() < 0.03, "{pattern} {half} {x}: {moved} {from}");
                // Behind the warp brightness is by the place in the warped picture.
                let both = seen(vec![warp.clone(), vignette.clone()], x);
                assert!((both / moved / (1.0 + r2) - 1.0).abs() < 0.01, "{pattern} {half} {x}: {both}");
            }
        }
    }
}

#[test]
fn pixels_that_are_not_square_become_so() {
    let mut image = photo();
    image.header.framing.scale = [1.0, 2.0];
    let size = |image: &RawImage| Developer::new(image, &Recipe::default(), None).unwrap().size();
    assert_eq!(size(&image), [700, 600]);
    image.header.framing.orientation = Orientation::from_exif(6);
    assert_eq!(size(&image), [600, 700]);
    let picture = develop(&image, &Recipe::default(), None).unwrap().pixels;
    assert_eq!([picture.width, picture.height], [600, 700]);
}

#[test]
fn linear_images_are_developed_without_a_demosaic() {
    let dn = |x: usize, y: usize, c: usize| 100.0 + 200.0 * c as f64 + ((x * 7 + y * 13) % 50) as f64;
    let image = linear(40, 30, dn);
    let recipe = Recipe::preset("plain").unwrap();
    let developer = Developer::new(&image, &recipe, None).unwrap();
    assert_eq!(developer.size(), [40, 30]);
    assert!(!developer.does(Step::Demosaic));
    // Camera channels as they are, shown by the sRGB function.
    let seen = Developer::new(&image, &recipe, None).unwrap().until(Step::LensCorrection).whole().pixels;
    for (x, y) in [(0, 0), (39, 29), (17, 5)] {
        let expected = encode::srgb_codes(Vec3::from_array(std::array::from_fn(|c| (dn(x, y, c) / 1000.0) as f32)));
        for (c, v) in seen.pixel(x, y).iter().enumerate() {
            assert!((v - expected[c]).abs() < 2e-3, "{x} {y} {c}: {v} {}", expected[c]);
        }
    }
    // All steps work on it, and halving it gives half the sides.
    let mut all = Recipe::default();
    (all.noise.luminance, all.defects.threshold, all.row_noise.amount, all.local.compression) = (0.5, 3.0, 1.0, 0.3);
    all.white.balance = "auto".into();
    for size in [[1, 1], [2, 3], [40, 30]] {
        let image = linear(size[0], size[1], |x, y, c| ((x * 37 + y * 91 + c * 300) % 1200) as f64);
        for method in crate::steps::demosaic::tests::ALL {
            all.demosaic.method = method;
            let picture = develop(&image, &all, None).unwrap();
            assert!(picture.pixels.data.iter().all(|v| (0.0..=1.0).contains(v)), "{size:?} {method:?}");
            let expected = if method == Demosaic::Half { size.map(|n| (n / 2).max(1)) } else { size };
            assert_eq!([picture.pixels.width, picture.pixels.height], expected, "{method:?}");
        }
    }
}

#[test]
fn all_methods_and_tiny_pictures_work() {
    for pattern in ["RG/GB", "x-trans", "quad", "rgbw", "rccc", "mono"] {
        for size in [[1, 1], [2, 3], [7, 5], [40, 30]] {
            let image = raw(size[0], size[1], pattern, |x, y| (x * 37 + y * 91) as f64 % 1200.0);
            for method in crate::steps::demosaic::tests::ALL {
                let mut recipe = Recipe::default();
                recipe.demosaic.method = method;
                recipe.noise.luminance = 0.5;
                recipe.defects.threshold = 3.0;
                recipe.row_noise.amount = 1.0;
                recipe.local.compression = 0.3;
                recipe.sharpen.amount = 0.5;
                recipe.resize.long_edge = Some(9);
                for highlights in [HighlightMethod::Clip, HighlightMethod::Recover] {
                    recipe.highlights.method = highlights;
                    let picture = develop(&image, &recipe, None).unwrap();
                    assert!(picture.pixels.data.iter().all(|v| (0.0..=1.0).contains(v)), "{pattern} {size:?} {method:?}");
                    assert_eq!(picture.pixels.width.max(picture.pixels.height), 9);
                }
            }
        }
    }
}

#[test]
fn halves_have_a_quarter_of_the_pixels() {
    let image = photo();
    let mut recipe = Recipe::default();
    recipe.demosaic.method = Demosaic::Half;
    let picture = develop(&image, &recipe, None).unwrap();
    assert_eq!([picture.pixels.width, picture.pixels.height], [350, 150]);
}

#[test]
fn steps_end_in_the_picture() {
    let image = photo();
    let recipe = Recipe::preset("camera").unwrap();
    let developer = || Developer::new(&image, &recipe, None).unwrap();
    let last = developer().whole();
    for step in Step::ALL {
        let picture = developer().until(step).whole();
        assert_eq!(picture.pixels.width, last.pixels.width);
        if step == Step::Encode {
            assert_eq!(picture, last);
        }
    }
}
