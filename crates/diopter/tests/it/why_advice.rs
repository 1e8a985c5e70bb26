//! What `why` advises, done: photographs with and without the change, measured as any picture is. The camera's model and its photographs share lens and sensor, but
//! neither the way blur is found (spots against e-SFR) nor noise (variances against the scatter of pixels).

use diopter::expose::ProgressReporter;
use diopter::image::RawImage;
use diopter::measure::{Measured, Plane, Region, mtf};
use diopter::shot::{Shot, ShotFile};
use diopter::why::why;
use std::sync::atomic::AtomicBool;

/// A shot focused and metered, and its raw image.
fn taken(file: &ShotFile) -> (Shot, RawImage) {
    let cancel = AtomicBool::new(false);
    let watch = ProgressReporter { cancel: &cancel, progress: &|_| () };
    let mut shot = Shot::prepare(file, &mut |_| ()).unwrap();
    shot.focus(&watch, &mut |_| ()).unwrap();
    shot.meter(&watch, &mut |_| ()).unwrap();
    let plane = shot.expose(&watch).unwrap();
    let raw = shot.read_out(&plane).unwrap();
    (shot, raw)
}

/// Half-contrast frequency of the edges of the square in the middle, cycles/pixel, and signal to noise within it.
fn measured(raw: &RawImage) -> (f64, f64) {
    let picture = Measured::Raw(Box::new(raw.clone()));
    let plane = picture.plane(picture.usual_channel()).unwrap();
    let middle = [0.5 * plane.width as f64, 0.5 * plane.height as f64];
    let options = mtf::Options { reach: Some(14.0), ..mtf::Options::default() };
    let near = |e: &mtf::EdgeMtf| (e.middle[0] - middle[0]).hypot(e.middle[1] - middle[1]) < 0.2 * plane.width as f64;
    let edges: Vec<f64> = mtf::find(&plane, &options).unwrap().iter().filter(|e| near(e)).filter_map(|e| e.mtf50).collect();
    assert!(edges.len() >= 2, "{} edges", edges.len());
    (edges.iter().sum::<f64>() / edges.len() as f64, signal_to_noise(&plane))
}

/// Of the middle of the square, 36 pixels a side.
fn signal_to_noise(plane: &Plane) -> f64 {
    let region = Region { x: plane.width / 2 - 18, y: plane.height / 2 - 18, width: 36, height: 36 };
    let all: Vec<f64> = plane.samples(region).collect();
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    let variance = all.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (all.len() - 1) as f64;
    mean / variance.sqrt()
}

#[test]
fn advice_does_to_photographs_what_it_says() {
    // A monochrome sensor in pixels of 38 µm; the chart is 5 cm behind the plane of focus: a disk of 47 µm at f/2.8.
    let mut file = ShotFile::default();
    let set = [
        ("scene", "slanted-edges"),
        ("body", "imx249"),
        ("lens", "double-gauss-50mm"),
        ("size", "300x188"),
        ("spp", "96"),
        ("aperture", "f/2.8"),
        ("shutter", "1/500"),
        ("iso", "650"),
        ("focus", "0.95m"),
        ("diffraction", "off"),
    ];
    for (name, value) in set {
        file = file.with(name, value).unwrap_or_else(|e| panic!("{name}: {e}"));
    }
    let (shot, raw) = taken(&file);
    let told = why(&shot, Some([0.5, 0.5]), None).unwrap();
    let (sharp, clean) = measured(&raw);
    let named = |what: &str| {
        told.advice.iter().find(|a| a.change.starts_with(what)).unwrap_or_else(|| panic!("{what}: {:?}", told.advice))
    };
    // What holds of the picture itself. The edges of a square whose sides are 5° off look along two directions of the eight that `why` averages.
    let mtf50 = told.blur.mtf50_per_px.unwrap();
    println!(
        "MTF50 {mtf50:.4} told, {sharp:.4} measured; signal to noise {:.2} told, {clean:.2} measured",
        told.noise.signal_to_noise
    );
    assert!((sharp / mtf50 - 1.0).abs() < 0.06, "{sharp} {mtf50}");
    // 1296 pixels tell a deviation to 2 %.
    assert!((clean / told.noise.signal_to_noise - 1.0).abs() < 0.08, "{clean} {:?}", told.noise);
    let down = named("two stops down");
    let here = named("focus here");
    for (advice, changes) in
        [(down, vec![("aperture", "f/5.6".to_owned()), ("iso", down.iso.to_string())]), (here, vec![("focus", "1m".to_owned())])]
    {
        let changed = changes.iter().fold(file.clone(), |f, (name, value)| f.with(name, value).unwrap());
        let (_, raw) = taken(&changed);
        let (then, noisy) = measured(&raw);
        // Blur radii are inverse to frequencies of half contrast.
        let (blur, noise) = (sharp / then, clean / noisy);
        println!(
            "{}: blur ×{:.3} told, ×{blur:.3} measured; noise ×{:.3} told, ×{noise:.3} measured",
            advice.change, advice.blur, advice.noise
        );
        assert!((blur / advice.blur - 1.0).abs() < 0.06, "{}: {blur} {}", advice.change, advice.blur);
        assert!((noise / advice.noise - 1.0).abs() < 0.08, "{}: {noise} {}", advice.change, advice.noise);
    }
}
