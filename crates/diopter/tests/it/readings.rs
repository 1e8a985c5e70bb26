//! One exposure read more than once: split pixels and interleaved rows, against closed forms.

use crate::common::{Pattern, cards};
use diopter::develop::Recipe;
use diopter::expose::ProgressReporter;
use diopter::image::dng::{self, Storage};
use diopter::image::{FocalPlane, RawImage};
use diopter::raw_file;
use diopter::shot::{Inputs, Sequence, Shot, ShotFile};
use std::f64::consts::PI;
use std::io::Cursor;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Every picture of a sequence: plane and read-out.
fn taken(toml: &str, scene: Option<diopter::scene::Description>) -> Vec<(FocalPlane, RawImage)> {
    let mut file: ShotFile = toml::from_str(toml).unwrap();
    let sequence = Sequence::new(&mut file).unwrap();
    let inputs = Inputs { scene: scene.map(Arc::new), ..Inputs::default() };
    let mut shot = Shot::prepare_with(&file, inputs, &mut |_| ()).unwrap();
    sequence.check(&shot).unwrap();
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    shot.focus(&watch, &mut |_| ()).unwrap();
    shot.meter(&watch, &mut |_| ()).unwrap();
    (0..sequence.count())
        .map(|k| {
            sequence.turn(&mut shot, k, &mut |_| ()).unwrap();
            let plane = shot.expose(&watch).unwrap();
            let raw = shot.read_out(&plane).unwrap();
            (plane, raw)
        })
        .collect()
}

#[test]
fn small_pictures_to_look_at_are_read_in_full_color() {
    let settled = |toml: &str| {
        let mut shot = Shot::prepare(&toml::from_str(toml).unwrap(), &mut |_| ()).unwrap();
        shot.sample_pictures_in_full_color();
        shot.color_sampling
    };
    use diopter::sensor::ColorSampling::{Full, Mosaic};
    let size = |size: &str| format!("[render]\nsize = \"{size}\"\n");
    // 6720 × 4480 photosites: two and more for a pixel, or fewer.
    assert_eq!(settled(&size("3360x2240")), Full);
    assert_eq!(settled(&size("3600x2400")), Mosaic);
    // As asked; and mosaics that somebody wants to see demosaiced; and sensors without colours.
    for (asked, expected) in [
        ("[camera]\ncolor_sampling = \"mosaic\"\n", Mosaic),
        ("[develop.demosaic]\nmethod = \"bilinear\"\n", Mosaic),
        ("[camera]\nbody = \"imx249\"\n", Mosaic),
        ("[camera]\nbody = \"nikon-d850\"\n", Full),
    ] {
        assert_eq!(settled(&format!("{asked}{}", size("96x64"))), expected, "{asked}");
    }
    let e = Shot::prepare(&toml::from_str("[camera]\nbody = \"imx249\"\ncolor_sampling = \"full\"\n").unwrap(), &mut |_| ());
    assert!(e.err().is_some_and(|e| e.to_string().contains("color_sampling")));
}

#[test]
fn full_color_needs_no_demosaicing_and_comes_back_from_a_linear_dng() {
    let of = |sampling: &str| {
        taken(
            &asked("thin", &format!("color_sampling = \"{sampling}\"\n"), "48x32", 8)
                .replace("imx455", "canon-5d-mark-iv")
                .replace("390", "100"),
            Some(edge(2.0)),
        )
        .remove(0)
    };
    let (plane, full) = of("full");
    let (same, mosaic) = of("mosaic");
    assert!(plane == same && full.size() == mosaic.size() && full.mosaic.data.len() == 3 * mosaic.mosaic.data.len());
    // The number of a pixel's own filter has the light of that of the mosaic, with another draw of the noise.
    let cfa = &mosaic.header.cfa;
    let black = full.header.black_level;
    let (mut a, mut b) = (0.0, 0.0);
    for (i, dn) in mosaic.mosaic.data.iter().enumerate() {
        a += f64::from(*dn) - black;
        b += f64::from(full.mosaic.data[3 * i + cfa.channel_at(i % 48, i / 48)]) - black;
    }
    assert!((a / b - 1.0).abs() < 0.01, "{a} {b}");
    let mut bytes = Cursor::new(Vec::new());
    raw_file::write_image(&full, Storage::Packed, &Recipe::default(), &mut bytes).unwrap();
    bytes.set_position(0);
    let read = dng::read(bytes).unwrap();
    assert!(read.header.cfa.has_all_channels() && read.mosaic == full.mosaic);
}

fn refused(toml: &str) -> String {
    let mut file: ShotFile = toml::from_str(toml).unwrap();
    let sequence = Sequence::new(&mut file).unwrap();
    let shot = Shot::prepare(&file, &mut |_| ()).unwrap();
    sequence.check(&shot).unwrap_err().to_string()
}

/// What the camera looks at: a dark card over the left half of the picture before an even sky.
fn edge(distance_m: f64) -> diopter::scene::Description {
    cards(&[(Pattern::Wall, distance_m, [-3.0, 0.0, -3.0, 3.0])], 10.0, 50.0).description().clone()
}

fn asked(lens: &str, more: &str, size: &str, spp: u32) -> String {
    format!(
        "[camera]\nlook_from = [0, 0, 0]\nlook_at = [0, 0, -1]\nlens = \"{lens}\"\nbody = \"imx455\"\nformat = \"36x24\"\n{more}\n\
         [exposure]\naperture = \"f/2\"\nshutter = \"1/500\"\niso = 390\n[focus]\ndistance = \"2 m\"\n\
         [render]\nsize = \"{size}\"\nspp = {spp}\nintegrator = \"path\"\n"
    )
}

/// Column at which the picture changes from dark to light: that of an edge whose blur has its centroid there.
fn place_of_edge(plane: &FocalPlane) -> f64 {
    let (width, bands) = (plane.width(), plane.bands.len());
    let mut columns = vec![0.0f64; width];
    for (i, pixel) in plane.mean.data.chunks(bands).enumerate() {
        columns[i % width] += pixel.iter().map(|v| f64::from(*v)).sum::<f64>();
    }
    let end = width / 16;
    let mean = |c: &[f64]| c.iter().sum::<f64>() / c.len() as f64;
    let (dark, light) = (mean(&columns[..end]), mean(&columns[width - end..]));
    columns.iter().map(|v| (light - v) / (light - dark)).sum()
}

#[test]
fn both_photodiodes_together_have_the_electrons_of_the_whole_pixel() {
    for lens in ["thin", "double-gauss-50mm"] {
        let whole = &taken(&asked(lens, "", "96x64", 16), Some(edge(1.2)))[0].0;
        let [left, right] = &taken(&asked(lens, "dual_pixel = true", "96x64", 16), Some(edge(1.2)))[..] else { panic!("two") };
        let (mut most, mut sum) = (0.0f32, [0.0f64; 2]);
        for ((w, l), r) in whole.mean.data.iter().zip(&left.0.mean.data).zip(&right.0.mean.data) {
            most = most.max((l + r - w).abs() / w.max(1.0));
            (sum[0], sum[1]) = (sum[0] + f64::from(*l), sum[1] + f64::from(*r));
        }
        // Sums in single precision.
        assert!(most < 1e-5, "{lens}: {most}");
        assert!((sum[0] / sum[1] - 1.0).abs() < 0.05, "{lens}: {sum:?}");
        assert_eq!(left.1.header.facts.serial, "000001");
        assert!((left.1.header.baseline_ev - right.1.header.baseline_ev).abs() < 1e-12);
    }
}

#[test]
fn files_say_which_photodiodes_they_hold() {
    let even = cards(&[(Pattern::Wall, 50.0, [-0.01, 0.01, -0.01, 0.01])], 10.0, 50.0).description().clone();
    let pair = taken(&asked("thin", "dual_pixel = true", "24x16", 2), Some(even.clone()));
    for ((plane, raw), side) in pair.iter().zip(["left", "right"]) {
        assert_eq!((plane.facts.photodiodes.as_str(), raw.header.facts.photodiodes.as_str()), (side, side));
        let mut file = Cursor::new(Vec::new());
        raw_file::write_image(raw, Storage::Lossless, &Recipe::default(), &mut file).unwrap();
        // For other programs in the description, for ours among the facts.
        let text = format!("{side} photodiodes of split pixels");
        assert!(file.get_ref().windows(text.len()).any(|bytes| bytes == text.as_bytes()), "{side}");
        file.set_position(0);
        assert_eq!(dng::read(file).unwrap().header.facts.photodiodes, side);
    }
    // Halves are no two parts of the samples of one picture.
    let e = FocalPlane::merge(&[pair[0].0.clone(), pair[1].0.clone()]).unwrap_err().to_string();
    assert!(e.contains("exposure"), "{e}");
    let whole = &taken(&asked("thin", "", "24x16", 2), Some(even))[0].1.header.facts;
    assert!(whole.photodiodes.is_empty() && !serde_json::to_string(whole).unwrap().contains("photodiodes"));
}

#[test]
fn disparity_follows_defocus() {
    // Film distance v, pupil radius R: a ray through X of the pupil from z lands v X (1/z − 1/s) from where it would from the plane in focus; half disks have
    // their centroids ±4R/3π from the middle.
    let (f, s, columns) = (0.05, 2.0, 720.0);
    let v = 1.0 / (1.0 / f - 1.0 / s);
    let radius = f / (2.0 * 2.0);
    // A small film, on which light falls off by 0.9 % at most: the edge's place is counted by the light of the ends.
    let small = asked("thin", "dual_pixel = true\nfocal_length = \"50mm\"", "720x32", 64).replace("36x24", "7.2x0.32");
    for z in [1.2, 1.6, 2.0, 3.0, 6.0] {
        let [left, right] = &taken(&small, Some(edge(z)))[..] else { panic!("two") };
        let found = place_of_edge(&left.0) - place_of_edge(&right.0);
        let expected = v * 2.0 * 4.0 * radius / (3.0 * PI) * (1.0 / z - 1.0 / s) * columns / 0.0072;
        // Near things lie farther right as the left half sees them.
        println!("{z} m: {found:.3} px, expected {expected:.3}");
        // 64 samples a pixel over 32 rows: each column is known to ½ / √2048 = 0.011, 50 of them within the blur to 0.08 px; two edges, three deviations.
        assert!((found - expected).abs() < 0.01 * expected.abs() + 0.33, "{z} m: {found} px, expected {expected}");
    }
}

#[test]
fn photodiodes_have_noise_and_wells_of_their_own() {
    // An even sky: what differs from the mean is the noise of the read-out.
    let even = cards(&[(Pattern::Wall, 50.0, [-0.01, 0.01, -0.01, 0.01])], 10.0, 50.0).description().clone();
    let pair = taken(&asked("thin", "dual_pixel = true", "96x64", 4), Some(even.clone()));
    let noise: Vec<Vec<f64>> = pair
        .iter()
        .map(|(plane, raw)| {
            let each = raw.mosaic.data.iter().zip(&plane.mean.data);
            let pairs: Vec<(f64, f64)> = each.map(|(dn, e)| (f64::from(*dn), f64::from(*e))).collect();
            let scale = pairs.iter().map(|p| p.0 - raw.header.black_level).sum::<f64>() / pairs.iter().map(|p| p.1).sum::<f64>();
            pairs.iter().map(|(dn, e)| dn - raw.header.black_level - e * scale).collect()
        })
        .collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let r = dot(&noise[0], &noise[1]) / (dot(&noise[0], &noise[0]) * dot(&noise[1], &noise[1])).sqrt();
    // 6144 pixels: independent noise correlates by 1/√6144 = 0.013.
    assert!(r.abs() < 0.06, "{r}");
    // Far beyond saturation each holds half of what the whole pixel does.
    let long = |text: String| text.replace("1/500", "10s");
    let full = |raw: &RawImage| {
        raw.mosaic.data.iter().map(|v| f64::from(*v)).sum::<f64>() / raw.mosaic.data.len() as f64 - raw.header.black_level
    };
    let whole = full(&taken(&long(asked("thin", "", "24x16", 2)), Some(even.clone()))[0].1);
    let half = full(&taken(&long(asked("thin", "dual_pixel = true", "24x16", 2)), Some(even))[0].1);
    assert!(half < 0.6 * whole, "{half} {whole}");
}

#[test]
fn cameras_without_two_halves_are_refused() {
    let with =
        |more: &str| format!("[camera]\ndual_pixel = true\n{more}[exposure]\nshutter = \"1/60\"\n[render]\nsize = \"72x48\"\n");
    assert!(refused(&with("lens = \"pinhole\"\n")).contains("aperture"));
    assert!(refused(&with("lens = \"thin\"\n[camera.plenoptic]\npitch = \"4mm\"\n")).contains("microlens"));
    let staggered = "[sequence]\nstaggered = 2\n[exposure]\nshutter = \"1/60\"\n[render]\nsize = \"24x16\"\n";
    assert!(refused(staggered).contains("rolling"));
    assert!(refused(&format!("{staggered}[shutter]\nreadout = \"10ms\"\nreset = \"global\"\n")).contains("at once"));
}

#[test]
fn interleaved_exposures_see_a_moving_edge_at_their_own_times() {
    // The right edge of the bar crosses the middle at half a second, at 1 m/s, 2 m away: 50 mm × 0.5 = 25 mm of film a metre.
    let (columns, rows, film_mm) = (800.0, 32, 8.0);
    let text = format!(
        "[scene]\nfile = \"moving-bars\"\nat = \"480 ms\"\n[camera]\nlook_from = [0, 1, 2]\nlook_at = [0, 1, 0]\nlens = \"pinhole\"\nfocal_length = \"50mm\"\n\
         body = \"imx455\"\nformat = \"8x0.32\"\n[exposure]\naperture = \"f/8\"\nshutter = \"16ms\"\niso = 390\n[shutter]\nreadout = \"8ms\"\n\
         [sequence]\nstaggered = 3\nstaggered_ratio = 4\nstaggered_gap = \"1ms\"\n[render]\nsize = \"{columns}x{rows}\"\nspp = 64\n"
    );
    let frames = taken(&text, None);
    let mut before: Option<(f64, f64)> = None;
    for (k, (plane, raw)) in frames.iter().enumerate() {
        let facts = &raw.header.facts;
        let time = 16e-3 / 4f64.powi(k as i32);
        assert!((facts.exposure_s / time - 1.0).abs() < 1e-9, "{}", facts.exposure_s);
        let times = facts.shutter.as_ref().unwrap().rows;
        // Three readings a line.
        assert!((times.open_s[1] - 3.0 * 8e-3 / f64::from(rows)).abs() < 1e-12 && times.open_s[1] == times.close_s[1]);
        if let Some((_, closed)) = before {
            let waited = facts.at_s + times.open_s[0] - closed;
            assert!((1e-3..1e-3 + 3.0 * 8e-3 / f64::from(rows) + 1e-9).contains(&waited), "{waited}");
        }
        before = Some((facts.at_s, facts.at_s + times.close_s[0]));
        // Where the edge is in each row: the bar is left of it, its own left edge 0.1 m away is in the picture, too.
        let bands = plane.bands.len();
        let values: Vec<f64> = plane.mean.data.chunks(bands).map(|p| p.iter().map(|v| f64::from(*v)).sum()).collect();
        let mut sorted = values.clone();
        sorted.sort_by(f64::total_cmp);
        let (low, high) = (sorted[values.len() / 20], sorted[values.len() - values.len() / 20]);
        for row in [0, rows as usize / 2, rows as usize - 1] {
            let line = &values[row * columns as usize..(row + 1) * columns as usize];
            // From the middle of the bar on.
            let (open, close) = times.of(row);
            let seen_m = facts.at_s + 0.5 * (open + close) - 0.5;
            let px = columns / film_mm * 25.0;
            let expected = 0.5 * columns + seen_m * px;
            let from = (expected - 0.05 * px).max(0.0) as usize;
            let found = from as f64 + line[from..].iter().map(|v| (v - low) / (high - low)).sum::<f64>();
            // The wall's and the bar's light fall off a little across the picture; a hundredth of a pixel a column over the 100 summed ones.
            assert!((found - expected).abs() < 1.5, "exposure {k}, row {row}: {found} px, expected {expected}");
        }
    }
    // What a global shutter would show at once lies more than 100 px apart.
    assert!(frames[2].0.facts.at_s - frames[0].0.facts.at_s > 0.016);
}
