use super::*;

/// Standard normal distribution: φ and Φ, by a series of positive terms (Abramowitz & Stegun 7.1.6).
fn normal(z: f64) -> (f64, f64) {
    let density = (-0.5 * z * z).exp() / TAU.sqrt();
    if z.abs() > 7.0 {
        return (density, f64::from(z > 0.0));
    }
    let (mut term, mut sum) = (z, z);
    for k in 1..200 {
        term *= z * z / f64::from(2 * k + 1);
        sum += term;
    }
    (density, 0.5 + density * sum)
}

/// An edge of Gaussian blur seen by square pixels, `angle` degrees from the columns, dark on the left: exact.
///
/// A square pixel is the convolution of boxes of cos θ and sin θ across the edge: second differences of the second integral of Φ.
fn edge(width: usize, height: usize, angle: f64, sigma: f64, bow: f64) -> Plane {
    let (b, a) = angle.to_radians().sin_cos();
    let second = |x: f64| {
        let (density, below) = normal(x / sigma);
        0.5 * ((x * x + sigma * sigma) * below + x * sigma * density)
    };
    let value = |i: usize| {
        let (x, y) = ((i % width) as f64 - 0.5 * width as f64, (i / width) as f64 - 0.5 * height as f64);
        let n = (x - 0.3 - bow * y * y) * a - y * b;
        let [p, q] = [0.5 * (a + b), 0.5 * (a - b)];
        let step = (second(n + p) - second(n + q) - second(n - q) + second(n - p)) / (a * b);
        (0.1 + 0.7 * step) as f32
    };
    Plane { width, height, values: (0..width * height).map(value).collect(), limits: [0.0, 1.0], clipped: None }
}

fn exact(f: f64, angle: f64, sigma: f64) -> f64 {
    let (sin, cos) = angle.to_radians().sin_cos();
    (-2.0 * (PI * sigma * f).powi(2)).exp() * (sinc(f * cos) * sinc(f * sin)).abs()
}

/// Largest error up to half a cycle a pixel.
fn error(found: &EdgeMtf, angle: f64, sigma: f64) -> f64 {
    (0..=50).map(|k| f64::from(k) / 100.0).map(|f| (found.at(f) - exact(f, angle, sigma)).abs()).fold(0.0, f64::max)
}

#[test]
fn edges_of_known_blur_have_their_response() {
    // 0.01: what is asked for; a prototype in numpy is within 0.0062 for these. Fields of 0.1 and 0.8 have a contrast of 7/9.
    for (width, height, angle, sigma) in [
        (64, 64, 5.0, 0.3),
        (64, 80, 5.0, 0.5),
        (64, 64, 5.0, 1.0),
        (80, 100, 5.0, 2.0),
        (100, 60, 20.0, 0.5),
        (64, 64, 14.036, 0.4),
    ] {
        let plane = edge(width, height, angle, sigma, 0.0);
        let found = measure(&plane, plane.whole(), &Options::default()).unwrap();
        assert!(error(&found, angle, sigma) < 0.01, "{angle}° {sigma}: {}", error(&found, angle, sigma));
        assert!((found.angle_deg - angle).abs() < 0.02 && !found.horizontal, "{}", found.angle_deg);
        assert!((found.contrast - 7.0 / 9.0).abs() < 1e-3 && (found.at(0.0) - 1.0).abs() < 1e-9, "{}", found.contrast);
        // Where it is one half, by bisection.
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            if exact(middle, angle, sigma) > 0.5 { low = middle } else { high = middle }
        }
        let mtf50 = found.mtf50.unwrap();
        assert!((mtf50 - low).abs() < 0.01, "{angle}° {sigma}: {mtf50} {low}");
    }
}

#[test]
fn turned_and_mirrored_edges_have_the_same_response() {
    let plane = edge(64, 80, 5.0, 0.5, 0.0);
    let plain = measure(&plane, plane.whole(), &Options::default()).unwrap();
    let turned = (0..64 * 80).map(|i| plane.values[(i % 80) * 64 + i / 80]).collect();
    let turned = Plane { width: 80, height: 64, values: turned, limits: plane.limits, clipped: None };
    let found = measure(&turned, turned.whole(), &Options::default()).unwrap();
    assert!(found.horizontal && found.mtf == plain.mtf, "a transposed picture has the same rows");
    assert_eq!(found.across, [plain.across[1], plain.across[0]]);
    // Light and dark exchanged.
    let other = Plane { values: plane.values.iter().map(|v| 0.9 - v).collect(), ..plane.clone() };
    let found = measure(&other, other.whole(), &Options::default()).unwrap();
    assert!(found.mtf.iter().zip(&plain.mtf).all(|(a, b)| (a - b).abs() < 1e-3), "{} {}", found.at(0.5), plain.at(0.5));
}

#[test]
fn bent_edges_need_a_fit_of_second_order() {
    // A bow of 0.001 y² over ± 60 rows: 3.6 pixels.
    let plane = edge(96, 120, 5.0, 0.5, 0.001);
    let at = |order| {
        let found = measure(&plane, plane.whole(), &Options { order, ..Options::default() });
        found.map_or(1.0, |f| error(&f, 5.0, 0.5))
    };
    assert!(at(2) < 0.01 && at(1) > 0.05, "{} {}", at(2), at(1));
}

#[test]
fn green_pixels_of_a_mosaic_are_enough() {
    let mut plane = edge(96, 96, 5.0, 0.5, 0.0);
    (0..96 * 96).filter(|i| (i % 96 + i / 96) % 2 == 0).for_each(|i| plane.values[i] = f32::NAN);
    let found = measure(&plane, plane.whole(), &Options::default()).unwrap();
    // Half of the samples: 0.014 up to Nyquist, of the 0.02 that measurements are to be good to.
    assert!(error(&found, 5.0, 0.5) < 0.018, "{}", error(&found, 5.0, 0.5));
    // A quarter of the pixels: their own Nyquist frequency is half of it, and the edge is found with their aliases.
    (0..96 * 96).filter(|i| i / 96 % 2 == 1).for_each(|i| plane.values[i] = f32::NAN);
    let found = measure(&plane, plane.whole(), &Options::default()).unwrap();
    assert!(error(&found, 5.0, 0.5) < 0.04, "{}", error(&found, 5.0, 0.5));
}

#[test]
fn noise_does_not_move_the_response_far() {
    // Noise of 1 % of the step over 160 rows: the largest of 51 errors was 0.010 to 0.036 in six draws of a prototype in numpy.
    let mut plane = edge(160, 160, 5.0, 0.5, 0.0);
    let mut state = 7u64;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / f64::from(1 << 24)
    };
    for v in &mut plane.values {
        // Sum of twelve: variance 1.
        let normal = (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
        *v += (0.007 * normal) as f32;
    }
    let found = measure(&plane, plane.whole(), &Options::default()).unwrap();
    assert!(error(&found, 5.0, 0.5) < 0.06, "{}", error(&found, 5.0, 0.5));
    // A window of 10 pixels each way: 0.004 to 0.015 in the same draws.
    let narrow = measure(&plane, plane.whole(), &Options { reach: Some(10.0), ..Options::default() }).unwrap();
    assert!(error(&narrow, 5.0, 0.5) < 0.03, "{}", error(&narrow, 5.0, 0.5));
    assert!((found.noise - 0.01).abs() < 0.002, "{}", found.noise);
}

#[test]
fn what_is_no_edge_is_refused_by_name() {
    let good = edge(64, 64, 5.0, 0.5, 0.0);
    let told = |plane: &Plane, region: Region| measure(plane, region, &Options::default()).unwrap_err().to_string();
    let with = |value: &dyn Fn(usize, usize) -> f32| Plane {
        values: (0..64 * 64).map(|i| value(i % 64, i / 64)).collect(),
        ..good.clone()
    };
    let hash = |x: usize, y: usize| {
        let h = (x as u32).wrapping_mul(73_856_093) ^ (y as u32).wrapping_mul(19_349_663);
        let h = (h ^ (h >> 13)).wrapping_mul(0x5bd1_e995);
        ((h ^ (h >> 15)) & 1023) as f32 / 1023.0
    };
    let cases: [(Plane, &str); 7] = [
        (with(&|_, _| 0.5), "no edge"),
        (with(&|x, y| 0.2 + 0.6 * hash(x, y)), "no "),
        (with(&|x, _| if x < 32 { 0.2 } else { 0.8 }), "too upright"),
        (edge(64, 64, 44.0, 0.5, 0.0), "too steep"),
        (with(&|x, y| good.values[y * 64 + x].clamp(0.5, 0.75) * 2.0 - 0.5), "clipped"),
        // The corner of a square: eight rows without an edge.
        (with(&|x, y| if y < 56 { good.values[y * 64 + x] } else { 0.8 }), "no straight edge|rows across|explains|no edge"),
        (with(&|x, y| if (x as f32 - 20.0 - 0.1 * y as f32).abs() < 4.0 { 0.8 } else { 0.2 }), "edge"),
    ];
    for (plane, wanted) in cases {
        let told = told(&plane, plane.whole());
        assert!(wanted.split('|').any(|w| told.contains(w)) && told.contains("expected"), "{wanted}: {told}");
    }
    let outside = Region { x: 10, y: 0, width: 64, height: 64 };
    assert!(told(&good, outside).contains("64 × 64"));
    assert!(measure(&good, good.whole(), &Options { order: 9, ..Options::default() }).is_err());
    assert!(measure(&good, good.whole(), &Options { reach: Some(1.0), ..Options::default() }).is_err());
}

#[test]
fn edges_are_found_where_they_are() {
    // One edge of 80 × 80 pixels in a grey picture.
    let (width, height) = (320, 240);
    let mut plane = Plane { width, height, values: vec![0.45; width * height], limits: [0.0, 1.0], clipped: None };
    let patch = edge(80, 80, 5.0, 0.6, 0.0);
    for y in 0..80 {
        plane.values[(y + 100) * width + 180..][..80].copy_from_slice(&patch.values[y * 80..][..80]);
    }
    let found = find(&plane, &Options::default()).unwrap();
    assert!(!found.is_empty());
    for edge in &found {
        let r = edge.region;
        assert!(r.x + r.width > 180 && r.x < 260 && r.y + r.height > 100 && r.y < 180, "{r}");
    }
    // At a place: the middle of the patch.
    let at = measure_at(&plane, [220.0, 140.0], &Options::default()).unwrap();
    assert!(error(&at, 5.0, 0.6) < 0.02 && (at.middle[0] - 220.0).abs() < 3.0, "{} {:?}", error(&at, 5.0, 0.6), at.middle);
    let none = Plane { values: vec![0.45; width * height], ..plane };
    assert!(find(&none, &Options::default()).unwrap_err().to_string().contains("no slanted edge"));
}

#[test]
fn wide_blurs_are_measured_in_regions_in_which_they_end() {
    for sigma in [12.0, 20.0, 40.0] {
        let plane = edge(700, 700, 5.0, sigma, 0.0);
        let found = find(&plane, &Options::default()).unwrap();
        let mtf50 = (0.5f64.ln() / -2.0).sqrt() / (PI * sigma);
        for edge in &found {
            let off = edge.mtf50.unwrap() / mtf50 - 1.0;
            assert!(off.abs() < 0.03, "{sigma}: {off} in {}", edge.region);
        }
    }
    // Whole, by hand: what a grid of steps of 0.01 does not tell.
    let plane = edge(700, 700, 5.0, 40.0, 0.0);
    let found = measure(&plane, plane.whole(), &Options::default()).unwrap();
    assert!((found.mtf50.unwrap() / ((0.5f64.ln() / -2.0).sqrt() / (PI * 40.0)) - 1.0).abs() < 0.005, "{:?}", found.mtf50);
}

#[test]
fn a_step_in_an_upright_edge_is_no_slant() {
    let values = (0..128 * 128).map(|i| if (i % 128) < 62 + 4 * usize::from(i / 128 >= 64) { 0.2 } else { 0.8 }).collect();
    let plane = Plane { width: 128, height: 128, values, limits: [0.0, 1.0], clipped: None };
    assert!(measure(&plane, plane.whole(), &Options::default()).is_err());
}
