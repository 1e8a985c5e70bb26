//! `diopter measure` as a user meets it: charts photographed and measured.

use crate::common::Folder;
use serde_json::Value;

fn json(f: &Folder, args: &[&str]) -> Value {
    serde_json::from_slice(&f.ok(&[args, &["--json"][..]].concat()).stdout).unwrap()
}

#[test]
fn fall_off_and_distortion_are_those_of_the_bench() {
    let f = Folder::new("measure-bench");
    let lens = ["--lens", "double-gauss-50mm", "--aperture", "f/4", "--size", "96x64"];
    f.ok(&[&["shoot", "flat-field"], &lens[..], &["--spp", "256", "-o", "flat.dng"]].concat());
    let found = json(&f, &["measure", "vignetting", "flat.dng", "--lens", "double-gauss-50mm", "-o", "flat.svg"]);
    let bench = found["bench"].as_array().unwrap();
    let fit = |h: f64| {
        let a = found["vignetting"]["coefficients"].as_array().unwrap();
        (1..=3).fold(1.0, |sum, k| sum + a[k - 1].as_f64().unwrap() * h.powi(2 * k as i32))
    };
    // Corners lose a third; noise and the fit leave 2 %.
    assert!(bench.len() == 10 && bench[9]["illumination"].as_f64().unwrap() < 0.8, "{bench:?}");
    for point in bench {
        let (h, light) = (point["height"].as_f64().unwrap(), point["illumination"].as_f64().unwrap());
        assert!((fit(h) - light).abs() < 0.03, "{h}: {} {light}", fit(h));
    }
    assert!(String::from_utf8(f.read("flat.svg")).unwrap().contains("bench"));
    // Without a lens nothing stands beside it; through another one that is said.
    assert_eq!(json(&f, &["measure", "vignetting", "flat.dng"])["bench"], serde_json::json!([]));
    let other = f.ok(&["measure", "vignetting", "flat.dng", "--lens", "tessar-50mm-f2.8"]);
    assert!(String::from_utf8_lossy(&other.stderr).contains("was taken with the lens"), "{other:?}");
    let (code, message) = f.fails(&["measure", "vignetting", "flat.dng", "--lens", "no-such-lens"]);
    assert!(code == 2 && message.contains("no-such-lens"), "{code} {message}");

    f.ok(&[
        &["shoot", "dot-grid", "--lens", "double-gauss-50mm", "--aperture", "f/8", "--size", "600x400"],
        &["--spp", "16", "-o", "dots.dng"][..],
    ]
    .concat());
    let found = json(&f, &["measure", "distortion", "dots.dng", "--lens", "double-gauss-50mm"]);
    let (bench, curve) = (found["bench"].as_array().unwrap(), found["curve"].as_array().unwrap());
    assert!(bench.len() > 5);
    for point in bench {
        let (h, expected) = (point["height"].as_f64().unwrap(), point["percent"].as_f64().unwrap());
        let nearest = curve.iter().min_by(|a, b| {
            let off = |v: &serde_json::Value| (v["height"].as_f64().unwrap() - h).abs();
            off(a).total_cmp(&off(b))
        });
        let measured = nearest.unwrap()["percent"].as_f64().unwrap();
        // Half a pixel of 360.
        assert!((measured - expected).abs() < 0.1, "{h}: {measured} {expected}");
    }
}

#[test]
fn charts_are_photographed_and_measured() {
    let f = Folder::new("measure");
    f.ok(&["shoot", "slanted-edges", "--size", "600x400", "--spp", "8", "-o", "edges.dng"]);
    let found = json(&f, &["measure", "mtf", "edges.dng", "--pitch", "60", "--reach", "10", "-o", "mtf.svg"]);
    let edges = found["edges"].as_array().unwrap();
    assert!(edges.len() > 4 && found["channel"] == "green", "{} edges", edges.len());
    for edge in edges {
        // Turned by 5° and seen from the front, over 32 noisy rows: 0.2° each. A sharp lens before square pixels.
        assert!((edge["angle_deg"].as_f64().unwrap().abs() - 5.0).abs() < 1.5, "{}", edge["angle_deg"]);
        let mtf50 = edge["mtf50"].as_f64().unwrap();
        assert!((0.2..0.8).contains(&mtf50), "{mtf50}");
        assert!((edge["mtf50_per_mm"].as_f64().unwrap() * 0.06 / mtf50 - 1.0).abs() < 1e-9);
    }
    assert!(String::from_utf8(f.read("mtf.svg")).unwrap().starts_with("<svg"));

    let flat =
        ["shoot", "flat-field", "--size", "240x160", "--spp", "4", "--aperture", "f/8", "--shutter", "1/30", "--iso", "100"];
    f.ok(&[&flat[..], &["--seed", "1", "-o", "a.dng"]].concat());
    f.ok(&[&flat[..], &["--seed", "2", "-o", "b.dng"]].concat());
    let light = json(&f, &["measure", "vignetting", "a.dng"]);
    let rings = light["vignetting"]["rings"].as_array().unwrap();
    assert!(rings.len() > 10 && light["corner_ev"].as_f64().unwrap().abs() < 1.0, "{light}");
    let noise = json(&f, &["measure", "noise", "a.dng", "b.dng"]);
    let channels = noise["channels"].as_array().unwrap();
    assert!(channels.len() == 3 && channels.iter().all(|c| c["gain_dn_per_e"].as_f64().unwrap() > 0.0), "{noise}");
    // Beside it the sheet of the body that the files name. Two read-outs of one exposure: photon transfer of 4800 pixels, 2 % of a variance.
    f.ok(&[
        "expose",
        "flat-field",
        "--size",
        "240x160",
        "--spp",
        "16",
        "--aperture",
        "f/8",
        "--shutter",
        "1/30",
        "-o",
        "flat.exr",
    ]);
    f.ok(&["read-out", "flat.exr", "--iso", "100", "--seed", "1", "-o", "c.dng"]);
    f.ok(&["read-out", "flat.exr", "--iso", "100", "--seed", "2", "-o", "d.dng"]);
    let noise = json(&f, &["measure", "noise", "c.dng", "d.dng"]);
    let channels = noise["channels"].as_array().unwrap();
    let sheet = &noise["data_sheet"];
    let green = &channels.iter().find(|c| c["channel"] == "G").unwrap();
    let [told, seen] = [&sheet["gain_dn_per_e"], &green["gain_dn_per_e"]].map(|v| v.as_f64().unwrap());
    assert!(sheet["iso"] == 100.0 && (seen / told - 1.0).abs() < 0.08, "{noise}");
    let other = json(&f, &["measure", "noise", "c.dng", "d.dng", "--body", "canon-5d"]);
    assert!(other["data_sheet"]["body"] != sheet["body"], "{other}");

    let (code, message) = f.fails(&["measure", "oecf", "a.dng"]);
    assert!(code == 1 && message.contains("rank correlation"), "{code} {message}");

    f.ok(&["shoot", "color-chart", "--size", "300x200", "--spp", "8", "-o", "chart.png"]);
    let color = json(&f, &["measure", "color", "chart.png"]);
    assert_eq!(color["color"]["patches"].as_array().unwrap().len(), 24);
    // The default development is made to please: some units, but none of 20 on average.
    let mean = color["color"]["mean"].as_f64().unwrap();
    assert!(mean > 0.1 && mean < 20.0, "{mean}");
}

#[test]
fn charts_of_files_and_of_shots_are_photographed() {
    let f = Folder::new("measure-shot");
    // A black square, turned, 1 m before a camera.
    let scene = "[camera]\nlook_from = [0, 0, 1]\nlook_at = [0, 0, 0]\nfov = 27\n[sky]\nluminance = 500\n\
        [material]\nwhite = { color = 0.8 }\nblack = { color = 0.05 }\n\
        [[quad]]\nmaterial = \"white\"\ncorner = [-1, -1, 0]\nedges = [[2, 0, 0], [0, 2, 0]]\n\
        [[quad]]\nmaterial = \"black\"\ncorner = [-0.1, -0.12, 0.001]\nedges = [[0.24, 0.021, 0], [-0.021, 0.24, 0]]\n";
    std::fs::write(f.path("edge.scene"), scene).unwrap();
    let camera = ["--lens", "double-gauss-50mm", "--body", "canon-5d", "--size", "300x200", "--spp", "16"];
    let told = json(&f, &[&["measure", "mtf", "edge.scene", "--aperture", "f/8"][..], &camera].concat());
    let edges = told["edges"].as_array().unwrap();
    assert!(!edges.is_empty() && edges.iter().all(|e| e["predicted"]["largest_difference"].is_array()), "{told}");
    let shot = "[scene]\nfile = \"edge.scene\"\n[camera]\nlens = \"double-gauss-50mm\"\nbody = \"canon-5d\"\n\
        [exposure]\naperture = \"f/8\"\n[render]\nsize = \"300x200\"\nspp = 16\n";
    std::fs::write(f.path("shot.toml"), shot).unwrap();
    let shot = json(&f, &["measure", "mtf", "shot.toml"]);
    assert_eq!(shot["edges"], told["edges"]);
}

#[test]
fn a_rolling_shutter_reads_as_long_as_it_is_said_to() {
    let f = Folder::new("rolling");
    let shutter = ["--shutter-type", "rolling", "--readout", "40ms", "--shutter", "1/1000", "--spp", "16"];
    // Lamps on mains of 50 Hz: four bands in 40 ms.
    let flat = ["shoot", "flat-field", "--size", "48x96", "--iso", "1600", "--aperture", "f/2.8", "--flicker", "mains 50 Hz 0.8"];
    f.ok(&[&flat[..], &shutter, &["-o", "bands.dng"]].concat());
    let found = json(&f, &["measure", "rolling", "bands.dng", "--flicker", "100", "-o", "bands.svg"]);
    let [told, read] = [&found["readout_of_file_s"], &found["rolling"]["readout_s"]].map(|v| v.as_f64().unwrap());
    // Means of 48 pixels of 16 noisy samples; the error of the fit itself is below 0.5 %.
    assert!((told - 0.04).abs() < 1e-9 && (read / told - 1.0).abs() < 0.02, "{found}");
    assert!(found["rolling"]["direction"].is_null() && found["rolling"]["columns"] == false, "{found}");
    // Bars 2 m away at 1 m/s, at the image distance of 50 mm: 25.64 mm/s on a film of 36 mm with 240 pixels, 170.9 pixels/s, 6.8 pixels in 40 ms.
    let bars =
        ["shoot", "moving-bars", "--body", "ideal", "--size", "240x160", "--at", "0.48s", "--iso", "1600", "--aperture", "f/4"];
    for direction in ["down", "up"] {
        f.ok(&[&bars[..], &shutter, &["--shutter-direction", direction, "-o", "bars.exr"]].concat());
        let found = json(&f, &["measure", "rolling", "bars.exr", "--speed", "170.94,0"]);
        assert_eq!(found["rolling"]["direction"], direction, "{found}");
        let read = found["rolling"]["readout_s"].as_f64().unwrap();
        // A lean of 6.8 pixels is found to a tenth of a pixel; the bar is blurred by 0.2 pixels.
        assert!((read / 0.04 - 1.0).abs() < 0.03, "{found}");
    }
}

#[test]
fn what_cannot_be_measured_is_said() {
    let f = Folder::new("measure-wrong");
    f.ok(&["shoot", "flat-field", "--size", "96x64", "--spp", "2", "-o", "flat.png", "-o", "flat.dng"]);
    std::fs::copy(f.path("flat.dng"), f.path("again.dng")).unwrap();
    for (args, code, wanted) in [
        (&["measure", "mtf", "flat.png"][..], 1, "no slanted edge"),
        (&["measure", "mtf", "flat.png", "--at", "500,20"], 1, "96 × 64 pixels"),
        (&["measure", "mtf", "flat.png", "--region", "0,0,200,20"], 1, "96 × 64 pixels"),
        (&["measure", "mtf", "flat.dng", "--channel", "luminance"], 1, "one of red, green, blue"),
        (&["measure", "mtf", "flat.png", "--region", "1,2,3"], 2, "x,y,width,height"),
        (&["measure", "mtf", "flat.png", "--lens", "tessar-50mm-f2.8"], 2, "--body"),
        (&["measure", "mtf", "slanted-edges"], 2, "expected --lens and --body"),
        (&["measure", "mtf", "gone.png"], 1, "gone.png"),
        (&["measure", "mtf", "gone.scene"], 1, "gone.scene"),
        (&["measure", "mtf", "gone.toml"], 1, "gone.toml"),
        (&["measure", "mtf", "flat.png", "--size", "30x20"], 2, "a scene"),
        (&["measure", "mtf", "flat.png", "--motion", "1,0"], 2, "--lens"),
        (&["measure", "mtf", "flat.png", "--developed"], 2, "it is"),
        (&["measure", "mtf", "flat.png", "--set", "sharpen.amount=1"], 2, "--raw"),
        (&["measure", "mtf", "flat.png", "--shot", "gone.toml"], 2, "--raw"),
        (&["measure", "mtf", "flat.dng", "--raw", "flat.dng"], 2, "developed from it"),
        (&["measure", "mtf", "flat.dng", "--shot", "gone.toml"], 1, "gone.toml"),
        (
            &["measure", "mtf", "slanted-edges", "--lens", "tessar-50mm-f2.8", "--body", "canon-5d", "--raw", "flat.dng"],
            2,
            "taken before",
        ),
        (&["measure", "color", "flat.png"], 1, "correlation"),
        (&["measure", "noise", "flat.dng", "again.dng", "--body", "gone"], 2, "gone"),
        (&["measure", "noise", "flat.dng", "flat.dng"], 2, "named twice"),
        (&["measure", "rolling", "flat.png"], 2, "--flicker"),
        (&["measure", "rolling", "flat.png", "--flicker", "0"], 2, "such as 100"),
        (&["measure", "rolling", "flat.png", "--flicker", "100"], 1, "no bands"),
        (&["measure", "rolling", "flat.dng", "--flicker", "100"], 1, "everywhere at once"),
        (&["measure", "mtf", "flat.png", "-o", "plot.pdf"], 2, ".svg or .png"),
        (&["measure", "distortion", "flat.png"], 1, "dots"),
        (&["measure", "color", "flat.dng"], 1, "develop"),
        (&["measure", "noise", "flat.dng", "flat.dng", "flat.dng"], 2, "pairs"),
        (&["measure", "report", "canon-t2i", "tessar-50mm-f2.8", "-o", "report.txt"], 2, ".html or .pdf"),
        (&["measure", "report", "canon-t2i", "tessar-50mm-f2.8", "--readout", "0s", "-o", "report.html"], 2, "--readout"),
    ] {
        let (found, message) = f.fails(args);
        assert!(found == code && message.contains(wanted), "{args:?}: {found} {message}");
    }
}
