//! Rigs: stereo, triggers, files of other programs.

use diopter::calibration::parse_camera;
use diopter::expose::ProgressReporter;
use diopter::image::truth::Values;
use diopter::rig::Rig;
use diopter::rig::calibration::RigFormat;
use diopter::shot::Shot;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// A wall through (0, 0, −2), turned away to the right: z = −2 − 0.3 x.
const WALL: &str = "v -9 -9 0.7\nv 9 -9 -4.7\nv 9 9 -4.7\nv -9 9 0.7\nf 1 2 3 4\n";

const STEREO: &str = "[rig]\nlook_from = [0.1, 0.2, 1.0]\nlook_at = [0.1, 0.2, -2.0]\n[shot]\nscene = { file = \"wall.obj\", light = \"overcast\" }\n\
    camera = { lens = \"pinhole\", focal_length = \"40mm\" }\nexposure.shutter = \"1/100\"\nrender = { size = \"48x32\", spp = 2, denoise = false, truth_channels = \"position\" }\n\
    [[camera]]\nname = \"eye\"\nbaseline = \"12 cm\"\n";

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("wall.obj"), WALL).unwrap();
    folder
}

fn shots(rig: &Rig) -> Vec<Shot> {
    let go_on = AtomicBool::new(false);
    rig.shots(&ProgressReporter { cancel: &go_on, progress: &|_| () }, &mut |_| ()).unwrap()
}

#[test]
fn depth_of_a_stereo_pair_is_focal_length_times_baseline_over_disparity() {
    let folder = folder();
    let rig = Rig::new(STEREO, "rig.toml", folder.path()).unwrap();
    let mut shots = shots(&rig);
    // One scene for both.
    assert!(std::ptr::eq(shots[0].scene.description(), shots[1].scene.description()));
    let go_on = AtomicBool::new(false);
    let watch = ProgressReporter { cancel: &go_on, progress: &|_| () };
    let planes: Vec<_> = (0..2)
        .map(|k| {
            rig.turn(&mut shots[k], k, 0, &mut |_| ()).unwrap();
            shots[k].expose(&watch).unwrap()
        })
        .collect();
    let raster = |k: usize, name: &str| match planes[k].truth.values(name) {
        Some(Values::Float(raster)) => raster.clone(),
        _ => panic!("no {name}"),
    };
    let known = rig.calibration(&shots).unwrap();
    let f = known.cameras[0].calibration.model.focal().x;
    let mounts = [0, 1].map(|k| known.cameras[k].rig_from_camera.translation.x);
    let baseline = mounts[1] - mounts[0];
    assert!((baseline - 0.12).abs() < 1e-15);
    let (depth, left, right) = (raster(0, "depth"), raster(0, "position"), raster(1, "position"));
    let at = |r: &diopter::image::Raster<f32>, row: usize, column: usize| {
        let start = (row * 48 + column) * 3;
        [r.data[start], r.data[start + 1], r.data[start + 2]].map(f64::from)
    };
    let mut tested = 0;
    for row in [3, 16, 28] {
        for column in 12..44 {
            let p = at(&left, row, column);
            // Where the right camera sees the same place of the wall: between two of its pixels.
            let Some(c) = (0..47).find(|c| at(&right, row, *c)[0] <= p[0] && p[0] < at(&right, row, c + 1)[0]) else { continue };
            let (a, b) = (at(&right, row, c)[0], at(&right, row, c + 1)[0]);
            let seen = c as f64 + (p[0] - a) / (b - a);
            let z = f * baseline / (column as f64 - seen);
            let truth = f64::from(depth.data[row * 48 + column]);
            // Places are in single precision (1e-7 of 1 m against pixels of 4 cm), and on a wall that is turned the middle between two pixels is not the mean of their places: an
            // eighth of 1.2 % of a pixel at most, of a disparity of two pixels.
            assert!((z / truth - 1.0).abs() < 2e-3, "{row} {column}: {z} for {truth}");
            assert!((truth - (1.0 - p[2])).abs() < 1e-4);
            tested += 1;
        }
    }
    assert!(tested > 60, "{tested}");
}

const MOVING: &str = "[rig]\nlook_at = [0, 0, -2]\nends = \"free\"\n[[rig.path]]\ntime = 0\nlook_from = [0, 0, 1]\nlook_at = [0, 0, -9]\n\
    [[rig.path]]\ntime = 1\nlook_from = [0.5, 0, 1]\nlook_at = [0.5, 0, -9]\n[frames]\ncount = 2\nfps = 10\nfirst = \"0.1 s\"\n\
    [shot]\nscene = { file = \"wall.obj\", light = \"overcast\" }\ncamera = { lens = \"pinhole\", focal_length = \"40mm\" }\n\
    exposure.shutter = \"1/100\"\nrender = { size = \"24x16\", spp = 1, denoise = false }\n\
    [[camera]]\nname = \"a\"\n[[camera]]\nname = \"b\"\ntrigger_offset = \"20 ms\"\n[camera.shot]\nrender.size = \"32x16\"\nexposure.shutter = \"1/50\"\n\
    [imu]\nrate = \"100 Hz\"\nposition = [0.0, 0.1, 0.0]\n[write]\nfiles = [\"png\", \"depth.npy\"]\n";

#[test]
fn each_camera_has_noise_and_a_specimen_of_its_own() {
    let folder = folder();
    let text = format!(
        "{STEREO}[[camera]]\nname = \"wide\"\n[[camera]]\nname = \"own\"\n[camera.shot]\nrender.seed = 1\ncamera.serial = \"A7\"\n"
    );
    let rig = Rig::new(&text, "rig.toml", folder.path()).unwrap();
    let go_on = AtomicBool::new(false);
    let watch = ProgressReporter { cancel: &go_on, progress: &|_| () };
    let raws: Vec<_> = (shots(&rig).iter_mut().enumerate())
        .map(|(k, shot)| {
            rig.turn(shot, k, 0, &mut |_| ()).unwrap();
            shot.read_out(&shot.expose(&watch).unwrap()).unwrap()
        })
        .collect();
    let told: Vec<_> = raws.iter().map(|raw| (raw.header.facts.serial.as_str(), raw.header.facts.seed)).collect();
    assert_eq!(told, [("000001", 1), ("000002", 2), ("000003", 3), ("A7", 1)]);
    // The eyes stand 12 cm apart before an even wall: what they have in common is its light.
    let [left, right] = [0, 1].map(|k| raws[k].mosaic.data.iter().map(|dn| f64::from(*dn)).collect::<Vec<f64>>());
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    // Differences along a row to the pixel of the same colour leave noise.
    let noise = |v: &[f64]| v.chunks(48).flat_map(|row| row.windows(3).map(|w| w[2] - w[0])).collect::<Vec<f64>>();
    let (l, r) = (noise(&left), noise(&right));
    let product: Vec<f64> = l.iter().zip(&r).map(|(a, b)| a * b).collect();
    let squares = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>() / v.len() as f64;
    let correlation = mean(&product) / (squares(&l) * squares(&r)).sqrt();
    assert!(correlation.abs() < 0.2, "{correlation}");
}

#[test]
fn flow_is_from_one_frame_of_the_rig_to_the_next() {
    let flow = |fps: &str| {
        let folder = folder();
        let text = format!(
            "[rig]\nends = \"free\"\n[[rig.path]]\ntime = 0\nlook_from = [0.0, 0.2, 1.0]\nlook_at = [0.0, 0.2, -2.0]\n[[rig.path]]\ntime = \"2 s\"\n\
             look_from = [0.4, 0.2, 1.0]\nlook_at = [0.4, 0.2, -2.0]\n[frames]\nfirst = \"1 s\"\nfps = {fps}\n[shot]\nscene = {{ file = \"wall.obj\", light = \"overcast\" }}\n\
             camera = {{ lens = \"pinhole\", focal_length = \"40mm\" }}\nexposure.shutter = \"1/1000\"\n\
             render = {{ size = \"48x32\", spp = 1, denoise = false, truth_channels = \"flow\" }}\n[[camera]]\nname = \"eye\"\n"
        );
        let rig = Rig::new(&text, "rig.toml", folder.path()).unwrap();
        let mut shots = shots(&rig);
        rig.turn(&mut shots[0], 0, 0, &mut |_| ()).unwrap();
        let go_on = AtomicBool::new(false);
        let plane = shots[0].expose(&ProgressReporter { cancel: &go_on, progress: &|_| () }).unwrap();
        match plane.truth.values("flow") {
            Some(Values::Float(flow)) => f64::from(flow.data[(16 * 48 + 24) * 2]),
            _ => panic!("no flow"),
        }
    };
    // 0.2 m/s sideways before a wall 3 m away: x' = f v t / d.
    let (slow, fast) = (flow("5"), flow("20"));
    assert!((slow / fast - 4.0).abs() < 0.02 && fast.abs() > 0.1, "{slow} {fast}");
}

fn made(text: &str) -> BTreeMap<String, Vec<u8>> {
    let folder = folder();
    let rig = Rig::new(text, "rig.toml", folder.path()).unwrap();
    let go_on = AtomicBool::new(false);
    let mut files = BTreeMap::new();
    let watch = ProgressReporter { cancel: &go_on, progress: &|_| () };
    let taken = rig.take(&watch, &mut |_| (), &mut |name, bytes| {
        files.insert(name.to_string_lossy().replace('\\', "/"), bytes.to_vec());
        Ok(())
    });
    assert_eq!(taken.unwrap().files.len(), files.len());
    files
}

#[test]
fn a_trigger_offset_moves_the_pose_along_the_path() {
    let folder = folder();
    let rig = Rig::new(MOVING, "rig.toml", folder.path()).unwrap();
    let mut shots = shots(&rig);
    for (k, moment) in [(0, 0.2), (1, 0.22)] {
        rig.turn(&mut shots[k], k, 1, &mut |_| ()).unwrap();
        // 0.5 m/s along x; renderers' poses are in single precision.
        let x = f64::from(shots[k].camera.motion.at(0.0).translation.x);
        assert!((x - 0.5 * moment).abs() < 1e-6 && (shots[k].at_s() - moment).abs() < 1e-12, "{x}");
    }
    let known = rig.calibration(&shots).unwrap();
    for (camera, middle) in known.cameras.iter().zip([0.005, 0.03]) {
        for (k, p) in camera.pictures.iter().enumerate() {
            let stamp = 0.1 + 0.1 * k as f64;
            assert!((p.stamp_s - stamp).abs() < 1e-12 && (p.moment_s - stamp - middle).abs() < 1e-12);
            assert!((p.world_from_camera.translation.x - 0.5 * p.moment_s).abs() < 1e-12);
        }
    }
}

#[test]
fn all_files_of_a_rig_are_there_and_say_what_it_is() {
    let files = made(MOVING);
    for name in [
        "a/000000.png",
        "a/000001.depth.npy",
        "b/000001.png",
        "a/data.csv",
        "imu0/data.csv",
        "imu0/imu.npy",
        "imu0/imu.yaml",
        "transforms.json",
        "state_groundtruth_estimate0/data.csv",
        "calibration/camchain.yaml",
        "calibration/stereo-a-b.yaml",
        "calibration/rig.json",
        "calibration/colmap/rig_config.json",
        "calibration/colmap/frames.txt",
    ] {
        assert!(files.contains_key(name), "{name} in {:?}", files.keys());
    }
    let text = |name: &str| String::from_utf8(files[name].clone()).unwrap();
    let json = |name: &str| -> Value { serde_json::from_slice(&files[name]).unwrap() };
    // Triggered one after the other on a rig that moves: no rig of COLMAP, a frame for each picture.
    let data =
        |name: &str| text(name).lines().filter(|l| !l.starts_with('#') && !l.is_empty()).map(str::to_owned).collect::<Vec<_>>();
    assert_eq!((data("calibration/colmap/rigs.txt").len(), data("calibration/colmap/frames.txt").len()), (2, 4));
    assert_eq!((data("calibration/colmap/images.txt").len(), data("calibration/colmap/cameras.txt").len()), (4, 2));
    let t = json("transforms.json");
    assert_eq!(
        (t["frames"].as_array().unwrap().len(), &t["frames"][3]["file_path"], &t["frames"][3]["w"]),
        (4, &Value::from("b/000001.png"), &Value::from(32))
    );
    let x = t["frames"][3]["transform_matrix"][0][3].as_f64().unwrap();
    assert!((x - 0.5 * 0.23).abs() < 1e-12, "{x}");
    // The first camera of a chain is read by ours; the shift of the second is offset and half its exposure.
    let chain = text("calibration/camchain.yaml");
    assert!(parse_camera(&chain, "camchain.yaml").is_ok() && chain.contains("cam1:\n  T_cn_cnm1:"), "{chain}");
    assert!(chain.contains("timeshift_cam_imu: 0.03\n") && chain.contains("timeshift_cam_imu: 0.005\n"), "{chain}");
    // At an even speed the IMU feels gravity alone, from the first frame to the end of the last exposure (0.1 to 0.24 s).
    let imu = data("imu0/truth.csv");
    assert!(imu.len() == 15 && imu[0].starts_with("100000000,"), "{imu:?}");
    let last: Vec<f64> = imu[14].split(',').map(|v| v.parse().unwrap()).collect();
    assert!(last[1..5].iter().all(|v| v.abs() < 1e-9) && (last[5] - 9.80665).abs() < 1e-9 && last[6].abs() < 1e-9, "{last:?}");
}

#[test]
fn a_stereo_pair_is_one_rig_for_colmap_and_opencv() {
    let files = made(STEREO);
    let text = |name: &str| String::from_utf8(files[name].clone()).unwrap();
    let numbers = |line: &str| line.split([' ', ',', '[', ']']).filter_map(|w| w.parse::<f64>().ok()).collect::<Vec<_>>();
    let rigs = text("calibration/colmap/rigs.txt");
    let line = rigs.lines().last().unwrap();
    // The right camera from the left one: 12 cm to the left.
    let n = numbers(line);
    assert!(
        line.starts_with("1 2 CAMERA 1 CAMERA 2 1 ") && (n[n.len() - 3] + 0.12).abs() < 1e-15 && n[n.len() - 2].abs() < 1e-15,
        "{line}"
    );
    let frames = text("calibration/colmap/frames.txt");
    assert!(frames.lines().last().unwrap().ends_with(" 2 CAMERA 1 1 CAMERA 2 2"), "{frames}");
    let stereo = text("calibration/stereo-eye-left-eye-right.yaml");
    let t = stereo
        .split("\nT: ")
        .nth(1)
        .and_then(|s| s.split("data: [").nth(1))
        .map(|s| numbers(s.split(']').next().unwrap()))
        .unwrap();
    assert!((t[0] + 0.12).abs() < 1e-15 && t[1].abs() < 1e-15 && t[2].abs() < 1e-15, "{stereo}");
    assert!(RigFormat::NAMES.len() == 6);
}

#[test]
fn wrong_rigs_are_refused_with_place_and_hint() {
    let with = |from: &str, to: &str| {
        assert!(MOVING.contains(from), "{from}");
        Rig::new(&MOVING.replace(from, to), "my.toml", Path::new("")).map(|_| ()).unwrap_err().to_string()
    };
    for (from, to, told) in [
        ("time = 1\n", "time = 0\n", "times that rise"),
        ("ends = \"free\"", "ends = \"fre\"", "rest or free"),
        ("first = \"0.1 s\"", "first = \"2 s\"", "within the path"),
        ("name = \"b\"", "name = \"a\"", "twice"),
        ("name = \"b\"", "name = \"a/b\"", "letters, digits"),
        ("\"20 ms\"", "\"-200 ms\"", "begins at 0 s or later"),
        ("exposure.shutter = \"1/50\"", "exposure.shuter = \"1/50\"", "shuter"),
        ("exposure.shutter = \"1/50\"", "camera.look_from = [0, 0, 0]", "position and turn_deg"),
        ("exposure.shutter = \"1/50\"", "scene.file = \"cornell\"", "see the same"),
        ("files = [\"png\"", "files = [\"pngg\"", "did you mean \"png\""),
        ("rate = \"100 Hz\"", "rate = \"0 Hz\"", "above 0"),
        ("look_from = [0.5, 0, 1]\nlook_at = [0.5, 0, -9]", "look_from = [0.5, 0, 1]\nlook_at = [0.5, 9, 1]", "not along up"),
    ] {
        let e = with(from, to);
        assert!(e.contains("my.toml") && e.contains(told), "{to}: {e}");
    }
}

#[test]
fn a_shot_that_cannot_be_taken_names_its_camera() {
    let folder = folder();
    let rig = Rig::new(&MOVING.replace("exposure.shutter = \"1/50\"", "exposure.iso = 3"), "my.toml", folder.path()).unwrap();
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| {} };
    let error = rig.shots(&watch, &mut |_| ()).err().unwrap();
    assert!(error.is_request() && error.to_string().starts_with("camera b: ISO 3: expected 100 to"), "{error}");
}
