//! Light fields against conventional photographs of the same scene through the same lens.

use crate::common::{Pattern, cards, lens};
use diopter::camera::look_at;
use diopter::develop::{Developer, Recipe};
use diopter::expose::ProgressReporter;
use diopter::image::{ExposureFacts, FocalPlane, PictureSource, Raster, RawImage};
use diopter::lens::microlens::MicrolensArray;
use diopter::lens::{Focus, Lens};
use diopter::light::lattice::Arrangement;
use diopter::light::units::Millimeters;
use diopter::scene::Scene;
use diopter::sensor::{Reading, Sensor, read_out};
use diopter::{Camera, CameraMotion, Film, Response, Settings, Shutter, expose};
use glam::{DVec2, Vec3};
use std::sync::atomic::AtomicBool;

/// Distance of the microlenses, mm; lenses across and down; pixels across one of them.
const PITCH: f64 = 0.4;
const LENSES: [usize; 2] = [60, 40];
const PIXELS: usize = 12;
/// Film under them, mm.
const PIECE: [f64; 2] = [PITCH * LENSES[0] as f64, PITCH * LENSES[1] as f64];

fn at(distance_m: f64) -> Focus {
    Focus::Distance(Millimeters(1000.0 * distance_m))
}

/// In colour.
const BAYER: &str = "canon-5d-mark-iv";
/// Without colour filters and nearly without noise, so that what differs is the picture.
const GREY: &str = "imx455";

fn take(body: &str, scene: &Scene, lens: &Lens, film: Film, spp: u32) -> FocalPlane {
    let motion = CameraMotion::still(look_at(Vec3::ZERO, Vec3::NEG_Z, Vec3::Y).unwrap());
    let camera = Camera { lens: lens.clone(), film, motion };
    let sensor = Sensor::named(body).unwrap();
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    let facts = ExposureFacts {
        focal_length_mm: lens.focal_length().0,
        f_number: lens.f_number(),
        t_number: lens.t_number(),
        extension_mm: lens.extension().0,
        body: body.into(),
        light_field: camera.light_field_facts(),
        ..Default::default()
    };
    let settings = Settings { truth: false, ..Settings::new(spp) };
    expose(scene, &camera, &Shutter::global(0.01), &Response::sensor(&sensor), &settings, &facts, &watch).unwrap()
}

/// A sensor of pixels as large as can be counted: electrons a pixel of the same area for both films.
fn film(columns: usize, rows: usize) -> Film {
    Film { pixel_area_mm2: 1e-4, ..Film::new(PIECE[0], PIECE[1], columns, rows) }
}

fn plenoptic(arrangement: Arrangement, lens: &Lens) -> Film {
    let gap = 0.97 * PITCH / (2.0 * lens.pupil_slope());
    let array = MicrolensArray::new(arrangement, [PITCH, gap, gap], PIECE).unwrap();
    Film { microlenses: Some(array), ..film(LENSES[0] * PIXELS, LENSES[1] * PIXELS) }
}

/// Signal of each microlens: what its image holds, over the area of the lens; and the variance of that.
fn under_lenses(plane: &FocalPlane, array: &MicrolensArray, lens: &Lens) -> Vec<[f64; 2]> {
    let mut sums = vec![[0.0; 2]; LENSES[0] * LENSES[1]];
    let pixel = PITCH / PIXELS as f64;
    let magnification = 1.0 + array.gap * lens.exit_curvature();
    let variance = plane.variance();
    for y in 0..plane.height() {
        for x in 0..plane.width() {
            let at = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) * pixel - 0.5 * DVec2::from_array(PIECE);
            let lens = (at / magnification / PITCH + 0.5 * DVec2::new(LENSES[0] as f64, LENSES[1] as f64)).floor();
            let i = lens.y as usize * LENSES[0] + lens.x as usize;
            let fraction = (pixel / PITCH).powi(2);
            sums[i][0] += fraction * f64::from(plane.mean.pixel(x, y)[1]);
            sums[i][1] += fraction * fraction * f64::from(variance.pixel(x, y)[1]);
        }
    }
    sums
}

#[test]
fn light_behind_each_microlens_is_that_of_the_film() {
    let cases = [("thin", 2.8), ("double-gauss-50mm", 2.8)];
    for (name, n) in cases {
        let lens = lens(name, n, at(1.2));
        let scene =
            cards(&[(Pattern::Leaves, 1.0, [-1.0, 0.1, -1.0, 1.0]), (Pattern::Rough, 2.0, [-1.0, 1.0, -1.0, 1.0])], 8.0, 50.0);
        let with = plenoptic(Arrangement::Square, &lens);
        let light_field = take(BAYER, &scene, &lens, with, 8);
        let photograph = take(BAYER, &scene, &lens, film(LENSES[0], LENSES[1]), 512);
        let sums = under_lenses(&light_field, &with.microlenses.unwrap(), &lens);
        let (mut chi, mut count, mut all) = (0.0, 0.0, [0.0; 2]);
        let variance = photograph.variance();
        for row in 1..LENSES[1] - 1 {
            for column in 1..LENSES[0] - 1 {
                let [value, noise] = sums[row * LENSES[0] + column];
                let expected = f64::from(photograph.mean.pixel(column, row)[1]);
                // A variance of one degree of freedom says little by itself: never less than a percent of the signal.
                let claimed = noise + f64::from(variance.pixel(column, row)[1]) + (0.01 * expected).powi(2);
                chi += (value - expected).powi(2) / claimed;
                count += 1.0;
                all = [all[0] + value, all[1] + expected];
            }
        }
        assert!((all[0] / all[1] - 1.0).abs() < 0.003, "{name}: {}", all[0] / all[1]);
        assert!(chi / count < 1.5, "{name}: {}", chi / count);
    }
}

fn raw(plane: &FocalPlane) -> RawImage {
    let sensor = Sensor::named(&plane.facts.body).unwrap();
    let white = diopter::shot::white_point("D65").unwrap();
    read_out(plane, &sensor, &Reading::new(sensor.nearest_iso(100.0), 1), &white).unwrap()
}

fn developed(raw: &RawImage, settings: &[(&str, &str)]) -> Raster<f32> {
    let linear = Recipe::preset("plain").unwrap().linear_light();
    let recipe = settings.iter().fold(linear, |r, (name, value)| r.with(name, value).unwrap());
    Developer::new(raw, &recipe, None).unwrap().whole().pixels
}

/// Root mean square of the relative difference of green, and the ratio of the means.
fn compare(a: &Raster<f32>, b: &Raster<f32>) -> (f64, f64) {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let (mut squares, mut sums, mut n) = (0.0, [0.0; 2], 0.0);
    for y in 4..a.height - 4 {
        for x in 4..a.width - 4 {
            let [p, q] = [a, b].map(|r| f64::from(r.pixel(x, y)[1]));
            squares += (p - q).powi(2);
            sums = [sums[0] + p, sums[1] + q];
            n += 1.0;
        }
    }
    ((squares / n).sqrt() / (sums[1] / n), sums[0] / sums[1])
}

/// Boxes of pixels averaged, as a film of larger pixels would.
fn binned(from: &Raster<f32>, side: usize) -> Raster<f32> {
    let mut to = Raster::new(from.width / side, from.height / side, 3);
    for y in 0..to.height {
        for x in 0..to.width {
            for c in 0..3 {
                let sum: f32 = (0..side * side).map(|k| from.pixel(x * side + k % side, y * side + k / side)[c]).sum();
                to.pixel_mut(x, y)[c] = sum / (side * side) as f32;
            }
        }
    }
    to
}

#[test]
fn refocused_it_is_the_photograph_focused_there() {
    let (f_number, taken) = (2.8, 1.0);
    let scene = cards(
        &[
            (Pattern::Rough, 0.8, [-1.0, -0.35, -1.0, 1.0]),
            (Pattern::Leaves, 1.0, [-0.5, 0.3, -1.0, 1.0]),
            (Pattern::Rough, 1.4, [0.0, 1.0, -1.0, 1.0]),
        ],
        5.0,
        50.0,
    );
    let focused = |distance: f64| lens("thin", f_number, at(distance));
    let light_field = raw(&take(GREY, &scene, &focused(taken), plenoptic(Arrangement::Square, &focused(taken)), 16));
    for distance in [0.8, 1.0, 1.4] {
        // The film of the other focus, cut so that it shows as much.
        let other = focused(distance);
        let scale = (50.0 + other.extension().0) / (50.0 + focused(taken).extension().0);
        let fine = film(LENSES[0] * PIXELS / 2, LENSES[1] * PIXELS / 2);
        let photograph = Film { width_mm: fine.width_mm * scale, height_mm: fine.height_mm * scale, ..fine };
        let photograph = binned(&developed(&raw(&take(GREY, &scene, &other, photograph, 64)), &[]), PIXELS / 2);
        let focus = format!("{distance} m");
        let refocused = developed(&light_field, &[("light_field.focus", &focus)]);
        let (off, ratio) = compare(&refocused, &photograph);
        println!("{distance} m: {off:.4} {ratio:.4}");
        // Magnification changes brightness with the film's distance, which a light field keeps.
        let brighter = scale * scale;
        assert!((ratio / brighter - 1.0).abs() < 0.01, "{distance}: {ratio} {brighter}");
        // Shot noise of some ten thousand electrons, the views' finite number and the pixels' tent.
        assert!(off < if distance == taken { 0.02 } else { 0.07 }, "{distance}: {off}");
    }
}

#[test]
fn depth_is_that_of_the_cards() {
    let taken = lens("thin", 2.0, at(1.0));
    let cards = |far: f64| {
        cards(
            &[
                (Pattern::Rough, 0.8, [-1.0, -0.35, -1.0, 1.0]),
                (Pattern::Leaves, 1.0, [-0.5, 0.3, -1.0, 1.0]),
                (Pattern::Rough, far, [0.0, 1.0, -1.0, 1.0]),
            ],
            8.0,
            50.0,
        )
    };
    for (arrangement, far) in [(Arrangement::Square, 1.5), (Arrangement::Hexagonal, 1.5), (Arrangement::Square, 3.0)] {
        let cards = cards(far);
        let light_field = raw(&take(BAYER, &cards, &taken, plenoptic(arrangement, &taken), 8));
        let recipe = Recipe::default().with("light_field.focus", "as-taken").unwrap();
        let map = Developer::new(&light_field, &recipe, None).unwrap().depth().unwrap();
        let (w, h) = (map.depth_m.width, map.depth_m.height);
        for (place, depth) in [(0.12, 0.8), (0.5, 1.0), (0.85, far)] {
            let columns = (w as f64 * place) as usize - 3..(w as f64 * place) as usize + 3;
            let mut found: Vec<f32> =
                columns.flat_map(|x| (4..h - 4).map(move |y| (x, y))).map(|(x, y)| map.depth_m.pixel(x, y)[0]).collect();
            found.sort_by(f32::total_cmp);
            let middle = f64::from(found[found.len() / 2]);
            println!("{arrangement:?} {depth}: {middle:.4}");
            // At three metres twelve pixels across a lens see a thirtieth of a dioptre.
            let most = if depth > 2.0 { 0.1 } else { 0.03 };
            assert!((middle / depth - 1.0).abs() < most, "{arrangement:?} {depth}: {middle}");
        }
    }
}

#[test]
fn what_rims_cut_from_views_changes_neither_colour_nor_depth() {
    // Wide open its rims cut the pupil towards the sides of this film.
    let taken = lens("double-gauss-50mm", 2.0, at(1.0));
    let take_card = |pattern: Pattern| {
        let card = cards(&[(pattern, 1.5, [-1.0, 1.0, -1.0, 1.0])], 8.0, 50.0);
        raw(&take(BAYER, &card, &taken, plenoptic(Arrangement::Square, &taken), 8))
    };
    // How far red and blue are from green near both sides of views, beside the middle: what is cut from one is cut from all.
    let cast = |light_field: &RawImage| {
        let mut most = 0.0f64;
        for place in ["-0.75,0", "0.75,0"] {
            let p = developed(light_field, &[("light_field.view", place)]);
            let mean = |columns: std::ops::Range<usize>, c: usize| {
                let rows = || 6..p.height - 6;
                let sum: f32 = columns.clone().flat_map(|x| rows().map(move |y| (x, y))).map(|(x, y)| p.pixel(x, y)[c]).sum();
                f64::from(sum) / (columns.len() * rows().len()) as f64
            };
            let w = p.width;
            for columns in [2..10, w - 10..w - 2] {
                let [r, g, b] = [0, 1, 2].map(|c| mean(columns.clone(), c) / mean(w / 2 - 8..w / 2 + 8, c));
                println!("{place} {columns:?}: {r:.3} {g:.3} {b:.3}");
                most = most.max((r / g - 1.0).abs()).max((b / g - 1.0).abs());
            }
        }
        most
    };
    let wall = take_card(Pattern::Wall);
    let mut as_a_disk = wall.clone();
    as_a_disk.header.facts.light_field.as_mut().unwrap().pupils = None;
    let [with, without] = [&wall, &as_a_disk].map(cast);
    println!("{with:.4}, with a disk {without:.4}");
    // Noise of some hundred pixels, and what interpolating the outline over the film leaves.
    assert!(with < 0.06 && without > 5.0 * with, "{with} {without}");

    let rough = take_card(Pattern::Rough);
    let recipe = Recipe::default().with("light_field.focus", "as-taken").unwrap();
    // Depth near the left and the right side, and in the middle.
    let depths = |light_field: &RawImage| {
        let map = Developer::new(light_field, &recipe, None).unwrap().depth().unwrap();
        let (w, h) = (map.depth_m.width, map.depth_m.height);
        [2..10, w / 2 - 8..w / 2 + 8, w - 10..w - 2].map(|columns| {
            let rows = || 4..h - 4;
            let mut found: Vec<f32> =
                columns.flat_map(|x| rows().map(move |y| (x, y))).map(|(x, y)| map.depth_m.pixel(x, y)[0]).collect();
            found.sort_by(f32::total_cmp);
            found[found.len() / 2]
        })
    };
    let mut as_a_disk = rough.clone();
    as_a_disk.header.facts.light_field.as_mut().unwrap().pupils = None;
    let [left, middle, right] = depths(&rough);
    let [disk_left, _, disk_right] = depths(&as_a_disk);
    println!("{left:.4} {middle:.4} {right:.4}, with a disk {disk_left:.4} {disk_right:.4}");
    // What is left at the sides comes with this lens, whose field is curved, among others: a thin one has 1.49 to 1.53 there.
    assert!((middle / 1.5 - 1.0).abs() < 0.03 && left.min(right) > 1.3, "{left} {middle} {right}");
    assert!(
        (left / right - 1.0).abs() < 0.03 && (disk_left / disk_right - 1.0).abs() > 0.06,
        "{left} {right}, with a disk {disk_left} {disk_right}"
    );
}

#[test]
fn everything_in_focus_is_sharper_than_any_one_plane() {
    let taken = lens("thin", 2.0, at(1.0));
    let cards =
        cards(&[(Pattern::Rough, 0.75, [-1.0, -0.1, -1.0, 1.0]), (Pattern::Rough, 1.5, [-0.5, 1.0, -1.0, 1.0])], 8.0, 50.0);
    let light_field = raw(&take(BAYER, &cards, &taken, plenoptic(Arrangement::Hexagonal, &taken), 8));
    let detail = |focus: &str, left: bool| {
        let p = developed(&light_field, &[("light_field.focus", focus)]);
        let (from, to) = if left { (4, p.width / 2 - 8) } else { (p.width / 2 + 8, p.width - 4) };
        let value = |x: usize, y: usize| f64::from(p.pixel(x, y)[1]);
        let laplacian =
            |x: usize, y: usize| 4.0 * value(x, y) - value(x - 1, y) - value(x + 1, y) - value(x, y - 1) - value(x, y + 1);
        (from..to).flat_map(|x| (4..p.height - 4).map(move |y| (x, y))).map(|(x, y)| laplacian(x, y).powi(2)).sum::<f64>()
    };
    let (near, far) = (detail("0.75 m", true), detail("1.5 m", false));
    let out = [detail("1.5 m", true) / near, detail("0.75 m", false) / far];
    assert!(out.iter().all(|d| *d < 0.5), "{out:?}");
    let all = [detail("all", true) / near, detail("all", false) / far];
    assert!(all.iter().all(|d| *d > 0.85), "{all:?}");
}

#[test]
fn a_view_moves_and_a_stop_sharpens() {
    let taken = lens("thin", 2.0, at(1.0));
    let cards = cards(&[(Pattern::Rough, 2.0, [-1.0, 1.0, -1.0, 1.0])], 8.0, 50.0);
    let light_field = raw(&take(BAYER, &cards, &taken, plenoptic(Arrangement::Square, &taken), 8));
    let view = |x: &str| developed(&light_field, &[("light_field.view", x)]);
    let (left, right) = (view("-0.6,0"), view("0.6,0"));
    // A thing behind the plane of focus moves with the eye; by how much, geometry says.
    let moved = |shift: i64| {
        let mut sum = 0.0;
        for y in 6..left.height - 6 {
            for x in 10..left.width - 10 {
                let other = (x as i64 + shift) as usize;
                sum += f64::from(left.pixel(x, y)[1] - right.pixel(other, y)[1]).powi(2);
            }
        }
        sum
    };
    let best = (-6..=6).min_by(|a, b| moved(*a).total_cmp(&moved(*b))).unwrap();
    // Blur circle of the card on the film: A · |v − v'| / v', with A = 25 mm; views are 1.2 radii apart.
    let (v, image) = (50.0 * 1000.0 / 950.0, 50.0 * 2000.0 / 1950.0);
    let expected = 0.6 * 25.0 * (v - image) / image / PITCH;
    assert!((best as f64 - expected).abs() < 0.75, "{best} {expected}");
    let contrast = |p: &Raster<f32>| {
        let values: Vec<f64> = p.data.iter().skip(1).step_by(3).map(|v| f64::from(*v)).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64, mean)
    };
    let (open, bright) = contrast(&developed(&light_field, &[("light_field.focus", "as-taken")]));
    let (stopped, same) = contrast(&developed(&light_field, &[("light_field.aperture", "8")]));
    assert!(stopped > 1.3 * open && (same / bright - 1.0).abs() < 0.02, "{open} {stopped} {bright} {same}");
}

#[test]
fn what_cannot_be_made_of_a_file_is_said() {
    let taken = lens("thin", 2.0, at(1.0));
    let cards = cards(&[(Pattern::Rough, 2.0, [-1.0, 1.0, -1.0, 1.0])], 8.0, 50.0);
    let light_field = raw(&take(BAYER, &cards, &taken, plenoptic(Arrangement::Square, &taken), 1));
    let error = |raw: &RawImage, name: &str, value: &str| {
        let recipe = Recipe::default().with(name, value)?;
        Developer::new(raw, &recipe, None).map(|_| ())
    };
    let photograph = raw(&take(BAYER, &cards, &taken, film(60, 40), 1));
    let told = |r: Result<(), diopter::develop::RecipeError>| r.unwrap_err().to_string();
    assert!(told(error(&photograph, "light_field.focus", "1 m")).contains("holds no light field"));
    assert!(told(error(&light_field, "light_field.focus", "0.01 m")).contains("at least"));
    assert!(told(error(&light_field, "light_field.focus", "near")).contains("as-taken"));
    assert!(told(error(&light_field, "light_field.aperture", "1.4")).contains("f/2"));
    assert!(told(error(&light_field, "light_field.view", "0.9,0.9")).contains("pupil"));
    let mut broken = light_field.clone();
    broken.header.facts.light_field.as_mut().unwrap().pitch_mm = f64::NAN;
    assert!(told(error(&broken, "light_field.focus", "1 m")).contains("impossible"));
}
