//! Scenes of files through their own cameras and ours, by daylight and in fog.

use diopter::expose::ProgressReporter;
use diopter::image::FocalPlane;
use diopter::lens::Lens;
use diopter::shot::{Shot, ShotFile};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// A double Gauss as pbrt's lens files have it. Source: US patent 2,673,491 (Tronnier), scaled to 50 mm (Kolb et al. 1995).
const DOUBLE_GAUSS: &str = "29.475 3.76 1.67 25.2\n84.83 0.12 1 25.2\n19.275 4.025 1.67 23\n40.77 3.275 1.699 23\n12.75 5.705 1 18\n0 4.5 0 17.1\n\
    -14.495 1.18 1.603 17\n40.77 6.065 1.658 20\n-20.385 0.19 1 20\n437.065 3.22 1.717 20\n-39.73 5 1 20\n";

const WORLD: &str = "WorldBegin\n\
    AttributeBegin AreaLightSource \"diffuse\" \"rgb L\" [9 8 7] \"bool twosided\" true Translate -0.5 1.2 0.5 Shape \"sphere\" \"float radius\" 0.4 AttributeEnd\n\
    Texture \"c\" \"spectrum\" \"checkerboard\" \"rgb tex1\" [0.8 0.7 0.2] \"rgb tex2\" [0.1 0.2 0.6] \"float uscale\" 12 \"float vscale\" 12\n\
    Material \"diffuse\" \"texture reflectance\" \"c\"\n\
    Shape \"bilinearmesh\" \"point3 P\" [-4 -1 -3  4 -1 -3  -4 -1 5  4 -1 5]\n\
    Shape \"bilinearmesh\" \"point3 P\" [-4 -1 5  4 -1 5  -4 4 5  4 4 5]\n\
    Material \"diffuse\" \"rgb reflectance\" [0.7 0.2 0.1] Translate 0.6 -0.4 2 Shape \"sphere\" \"float radius\" 0.6\n";

struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("diopter-scenes-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Folder(path)
    }

    fn write(&self, name: &str, text: &str) -> String {
        std::fs::write(self.0.join(name), text).unwrap();
        self.0.join(name).display().to_string()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        std::fs::remove_dir_all(&self.0).ok();
    }
}

fn shot(toml: &str) -> Shot {
    let file: ShotFile = toml::from_str(toml).unwrap();
    Shot::prepare(&file, &mut |_| {}).unwrap_or_else(|e| panic!("{e}"))
}

fn exposed(mut shot: Shot) -> FocalPlane {
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| {} };
    shot.meter(&watch, &mut |_| {}).unwrap();
    shot.expose(&watch).unwrap()
}

/// Mean square of the difference over its variance, in blocks of 8 × 8 pixels, and how the brightness of both differs.
fn compared(a: &FocalPlane, b: &FocalPlane) -> (f64, f64) {
    let (va, vb) = (a.variance(), b.variance());
    let (w, h, bands) = (a.mean.width, a.mean.height, a.mean.channels);
    let (mut chi, mut count) = (0.0, 0.0);
    for by in 0..h / 8 {
        for bx in 0..w / 8 {
            for band in 0..bands {
                let (mut difference, mut variance) = (0.0, 0.0);
                for i in 0..64 {
                    let at = ((by * 8 + i / 8) * w + bx * 8 + i % 8) * bands + band;
                    difference += f64::from(a.mean.data[at] - b.mean.data[at]);
                    variance += f64::from(va.data[at] + vb.data[at]);
                }
                if variance > 0.0 {
                    chi += difference * difference / variance;
                    count += 1.0;
                }
            }
        }
    }
    let sum = |p: &FocalPlane| p.mean.data.iter().map(|v| f64::from(*v)).sum::<f64>();
    (chi / count, sum(a) / sum(b) - 1.0)
}

#[test]
fn a_realistic_camera_takes_the_picture_of_our_own_shot() {
    let folder = Folder::new("realistic");
    folder.write("lens.dat", DOUBLE_GAUSS);
    let film = "Film \"rgb\" \"integer xresolution\" 96 \"integer yresolution\" 64 \"float diagonal\" 36\nLookAt 0.3 0.4 -5  0 0 2  0 1 0\n";
    let camera =
        "Camera \"realistic\" \"string lensfile\" \"lens.dat\" \"float aperturediameter\" 12 \"float focusdistance\" 6.5\n";
    let theirs = folder.write("realistic.pbrt", &format!("{film}{camera}{WORLD}"));
    let plain = folder.write("plain.pbrt", &format!("{film}Camera \"perspective\"\n{WORLD}"));
    // Errors of pixels are to be independent of one another.
    let rendered = |seed: u32| {
        shot(&format!(
            "[scene]\nfile = \"{theirs}\"\n[exposure]\nshutter = \"1 s\"\n[render]\nspp = 128\nseed = {seed}\nintegrator = \"path\""
        ))
    };
    let first = rendered(1);
    let Lens::Compound(lens) = &first.camera.lens else { panic!("a real lens") };
    // The film is where the file has its camera: our place is that of the entrance pupil.
    let behind = (lens.system().film_z - lens.first_order().entrance_pupil_z) * 1e-3;
    assert!((0.04..0.06).contains(&behind), "{behind}");
    assert!((lens.focus_distance().unwrap().0 * 1e-3 + behind - 6.5).abs() < 1e-3);
    assert!((2.8..3.0).contains(&lens.f_number()), "{}", lens.f_number());
    let (from, to) = (glam::DVec3::new(0.3, 0.4, -5.0), glam::DVec3::new(0.0, 0.0, 2.0));
    let eye = from + (to - from).normalize() * behind;
    // pbrt's world is left-handed here: z is turned over.
    let (w, h) = (36.0 * 1.5 / 3.25f64.sqrt(), 36.0 / 3.25f64.sqrt());
    let ours = |extra: &str| {
        shot(&format!(
            "[scene]\nfile = \"{plain}\"\n[camera]\nlens = \"{}\"\nformat = \"{w}x{h}\"\nlook_from = [{}, {}, {}]\nlook_at = [0.0, 0.0, -2.0]\n\
             [focus]\ndistance = \"{} m\"\n[exposure]\naperture = \"f/{}\"\nshutter = \"1 s\"\n[render]\nspp = 128\nseed = 9\nsize = \"96x64\"\nintegrator = \"path\"\n{extra}",
            Path::new(&plain).with_file_name("lens.dat").display(),
            eye.x,
            eye.y,
            -eye.z,
            6.5 - behind,
            lens.f_number(),
        ))
    };
    let theirs = exposed(rendered(1));
    let (chi, brightness) = compared(&theirs, &exposed(ours("")));
    assert!(chi < 1.3 && brightness.abs() < 0.01, "{chi} {brightness}");
    // The test tells pictures apart: a little out of focus it is another.
    let off = ours("").camera;
    let mut moved = ours("");
    moved.camera.lens = off.lens.refocused(diopter::lens::Focus::at_mm(4000.0)).unwrap();
    assert!(compared(&theirs, &exposed(moved)).0 > 2.0);
}

#[test]
fn a_files_angle_of_view_is_that_of_the_picture_however_near_its_camera_focuses() {
    let folder = Folder::new("near");
    // A square that is half as wide and half as high as the picture, in the plane of focus.
    for (distance, radius) in [(0.2, 0.002), (0.5, 0.01), (20.0, 0.02)] {
        let d = distance * 0.1;
        let file = folder.write(
            "near.pbrt",
            &format!(
                "LookAt 0 0 -{distance}  0 0 0  0 1 0\nCamera \"perspective\" \"float fov\" 22.61986 \"float lensradius\" {radius} \
                 \"float focaldistance\" {distance}\nFilm \"rgb\" \"integer xresolution\" 40 \"integer yresolution\" 40\nWorldBegin \
                 LightSource \"infinite\" Material \"diffuse\" Shape \"bilinearmesh\" \"point3 P\" [-{d} -{d} 0 {d} -{d} 0 -{d} {d} 0 {d} {d} 0]"
            ),
        );
        let shot = shot(&format!("[scene]\nfile = \"{file}\"\n[render]\nspp = 1"));
        let Lens::Thin(lens) = &shot.camera.lens else { panic!("a thin lens") };
        assert!((lens.radius() / (1e3 * radius) - 1.0).abs() < 1e-6, "{} mm", lens.radius());
        let plane = exposed(shot);
        let seen = (0..40).flat_map(|y| (0..40).map(move |x| (x, y)));
        assert_eq!(seen.filter(|(x, y)| plane.truth.id().pixel(*x, *y)[0] > 0).count(), 400, "{distance} m");
    }
}

#[test]
fn cropped_and_shifted_films_show_the_same_pixels() {
    // A square for each pixel of six by four, in the plane of focus.
    let folder = Folder::new("crops");
    let square = |k: usize| {
        let (x, y) = ((k % 6) as f64 - 3.0, 2.0 - (k / 6) as f64);
        format!(
            "Shape \"bilinearmesh\" \"point3 P\" [{} {} 9 {} {} 9 {} {} 9 {} {} 9]\n",
            x + 0.05,
            y - 0.95,
            x + 0.95,
            y - 0.95,
            x + 0.05,
            y - 0.05,
            x + 0.95,
            y - 0.05
        )
    };
    let squares: String = (0..24).map(square).collect();
    let ids = |camera: &str, film: &str| {
        let text = format!(
            "{camera}\nFilm \"rgb\" \"integer xresolution\" 6 \"integer yresolution\" 4 {film}\nWorldBegin LightSource \"infinite\"\n{squares}"
        );
        let file = folder.write("squares.pbrt", &text);
        let plane = exposed(shot(&format!("[scene]\nfile = \"{file}\"\n[render]\nspp = 4\ndenoise = \"off\"")));
        let size = [plane.width(), plane.height()];
        (
            size,
            (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y))).map(|(x, y)| plane.truth.id().pixel(x, y)[0]).collect(),
        )
    };
    // The film of six metres by four at nine metres: a tangent of 2/9 along the shorter side.
    let fov = 2.0 * (2.0f64 / 9.0).atan().to_degrees();
    let cameras = [
        format!("Camera \"perspective\" \"float fov\" {fov}"),
        format!("Camera \"perspective\" \"float fov\" {fov} \"float lensradius\" 0.2 \"float focaldistance\" 9"),
        "Camera \"orthographic\" \"float screenwindow\" [-3 3 -2 2]".to_owned(),
    ];
    for camera in &cameras {
        let (size, all): ([usize; 2], Vec<u32>) = ids(camera, "");
        let mut distinct = all.clone();
        distinct.sort_unstable();
        distinct.dedup();
        assert!(size == [6, 4] && distinct.len() == 24 && !distinct.contains(&0), "{camera}: {all:?}");
        let part = |x: std::ops::Range<usize>, y: std::ops::Range<usize>| -> Vec<u32> {
            y.flat_map(|y| x.clone().map(move |x| (x, y))).map(|(x, y)| all[6 * y + x]).collect()
        };
        assert_eq!(ids(camera, "\"integer pixelbounds\" [1 4 2 4]"), ([3, 2], part(1..4, 2..4)), "{camera}");
        assert_eq!(ids(camera, "\"float cropwindow\" [0.5 1 0 0.3]"), ([3, 2], part(3..6, 0..2)), "{camera}");
    }
    // The same by the window of the screen: its rightmost and lowest quarter, as large as the film.
    let of_window = |camera: &str, [l, r, b, t]: [f64; 4]| {
        let (_, seen) = ids(&format!("{camera} \"float screenwindow\" [{l} {r} {b} {t}]"), "");
        let seen: Vec<u32> = seen;
        seen
    };
    let all = ids(&cameras[0], "").1;
    let quarter: Vec<u32> = (0..24).map(|k| all[6 * (2 + k / 12) + 3 + k % 6 / 2]).collect();
    assert_eq!(of_window(&cameras[0], [0.0, 1.5, -1.0, 0.0]), quarter);
    assert_eq!(of_window("Camera \"orthographic\"", [0.0, 3.0, -2.0, 0.0]), quarter);
    // What the shot says of the shift counts, and a camera that stands elsewhere has none.
    let file = folder.write(
        "squares.pbrt",
        &format!("{} \"float screenwindow\" [0 1.5 -1 0]\nWorldBegin LightSource \"infinite\"\n{squares}", cameras[0]),
    );
    let center = |more: &str| shot(&format!("[scene]\nfile = \"{file}\"\n{more}")).camera.film.center_mm;
    let [x, y] = center("[camera]\nformat = \"36x24\"");
    // Of pbrt's 16:9, 36 mm wide.
    assert!((x - 0.75 * 20.25).abs() < 1e-9 && (y + 0.5 * 20.25).abs() < 1e-9, "{x} {y}");
    assert_eq!(center("[camera]\nshift_mm = [1.0, 2.0]"), [1.0, 2.0]);
    assert_eq!(center("[camera]\nlens = \"double-gauss-50mm\""), [0.0; 2]);
    assert_eq!(center("[camera]\nlook_from = [0.0, 0.0, 0.0]\nlook_at = [0.0, 0.0, -9.0]"), [0.0; 2]);
}

#[test]
fn parallel_and_panoramic_cameras_see_what_they_should() {
    let folder = Folder::new("projections");
    let box_ = "Material \"diffuse\" Shape \"trianglemesh\" \"point3 P\" [-1 -1 9  1 -1 9  0 1 9]";
    let head = "Film \"rgb\" \"integer xresolution\" 60 \"integer yresolution\" 40\n";
    let file = folder.write(
        "parallel.pbrt",
        &format!("{head}Camera \"orthographic\" \"float screenwindow\" [-3 3 -2 2]\nWorldBegin LightSource \"infinite\" {box_}"),
    );
    let plane = exposed(shot(&format!("[scene]\nfile = \"{file}\"\n[render]\nspp = 1")));
    // 10 pixels a metre whatever the distance: two metres of foot line, one of half height.
    let id = |x: usize, y: usize| plane.truth.id().pixel(x, y)[0] > 0;
    assert_eq!((0..60).filter(|x| id(*x, 29)).count(), 20);
    assert!((9..=11).contains(&(0..60).filter(|x| id(*x, 20)).count()));
    assert!((18..=20).contains(&(0..40).filter(|y| id(29, *y)).count()));
    // All around: a ball to the right is a quarter of the width right of the middle.
    let ball = "Material \"diffuse\" Translate 5 0 0 Shape \"sphere\" \"float radius\" 0.5";
    let file = folder.write("around.pbrt", &format!("{head}WorldBegin LightSource \"infinite\" {ball}"));
    let plane = exposed(shot(&format!(
        "[scene]\nfile = \"{file}\"\n[camera]\nlens = \"panorama\"\nformat = \"36x18\"\n[render]\nspp = 1\nsize = \"80x40\""
    )));
    let seen: Vec<usize> = (0..80).filter(|x| plane.truth.id().pixel(*x, 20)[0] > 0).collect();
    assert!(!seen.is_empty() && seen.iter().all(|x| (56..64).contains(x)), "{seen:?}");
    assert!((plane.truth.depth().pixel(60, 20)[0] - 4.58).abs() < 0.03, "{:?}", plane.truth.depth().pixel(60, 20));
}

#[test]
fn noon_on_a_clear_day_meters_near_fifteen() {
    // A grey box on grey ground; June at 48° north, by the clock and by the sun's place.
    let folder = Folder::new("noon");
    let file = folder.write(
        "box.obj",
        "v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nv -1 1 -1\nv 1 1 -1\nv 1 1 1\nv -1 1 1\n\
         f 1 2 3 4\nf 5 8 7 6\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\nf 4 8 5 1\n",
    );
    for daylight in ["time = \"2026-06-21T13:00+02:00\"\nplace = [48.2, 16.4]", "sun = [60.0, 150.0]"] {
        let mut shot = shot(&format!(
            "[scene]\nfile = \"{file}\"\nground = 0.18\n[scene.daylight]\n{daylight}\n[exposure]\naperture = \"f/16\"\n\
             [camera]\nlook_from = [3.0, 3.5, 5.0]\nlook_at = [0.0, 0.3, 0.0]\nfocal_length = \"35 mm\"\n[render]\nspp = 16\nsize = \"60x40\""
        ));
        let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| {} };
        shot.meter(&watch, &mut |_| {}).unwrap();
        // Sunny 16.
        let ev = (256.0 / shot.shutter.unwrap()).log2();
        assert!((14.5..15.7).contains(&ev), "{daylight}: EV {ev}");
    }
}

#[test]
fn fog_hides_what_is_far() {
    let folder = Folder::new("fog");
    // Two black walls before an even sky, one ten times as far.
    let file = folder.write(
        "walls.pbrt",
        "LookAt 0 1 0  0 1 1  0 1 0\nCamera \"perspective\" \"float fov\" 60\nWorldBegin LightSource \"infinite\" \"rgb L\" [100 100 100]\n\
         Material \"diffuse\" \"rgb reflectance\" [0 0 0]\n\
         Shape \"bilinearmesh\" \"point3 P\" [0 -5 5  9 -5 5  0 9 5  9 9 5]\n\
         Shape \"bilinearmesh\" \"point3 P\" [-90 -50 50  0 -50 50  -90 90 50  0 90 50]\n",
    );
    let means = |fog: &str| {
        let plane = exposed(shot(&format!(
            "[scene]\nfile = \"{file}\"\n{fog}\n[exposure]\nshutter = \"1/100\"\n[render]\nspp = 64\nsize = \"24x16\""
        )));
        // Of both halves.
        [0, 1].map(|half| {
            let of = (0..24 * 16)
                .filter(|i| (i % 24 >= 12) == (half == 1))
                .map(|i| f64::from(plane.mean.data[i * plane.mean.channels + 1]));
            of.sum::<f64>()
        })
    };
    let clear = means("");
    let [far, near] = means("[scene.fog]\nvisibility = \"60 m\"");
    assert!(far > 4.0 * near && near > 100.0 * clear[0].max(clear[1]), "{far} {near} {clear:?}");
}

#[test]
fn surroundings_that_make_no_sense_are_refused() {
    let refused = |toml: &str| match Shot::prepare(&toml::from_str(toml).unwrap(), &mut |_| {}) {
        Ok(_) => panic!("{toml} was taken"),
        Err(e) => e.to_string(),
    };
    for (section, word) in [
        ("daylight]", "sun, or time and place"),
        ("daylight]\ntime = \"2026-06-21T13:00Z\"", "latitude"),
        ("daylight]\nplace = [10.0, 10.0]", "time too"),
        ("daylight]\nsun = [95.0, 0.0]", "-90 to 90"),
        ("daylight]\nsun = [45.0, 0.0]\nturbidity = 0.0", "1 to 10"),
        ("fog]\nvisibility = \"0 m\"", "0.001"),
        ("fog]\nalbedo = 1.5", "albedo"),
        ("fog]\nwithin = [[0.0, 0.0, 0.0], [1.0, 0.0, 1.0]]", "corners"),
    ] {
        let e = refused(&format!("[scene]\nfile = \"rolling-ball\"\n[scene.{section}"));
        assert!(e.contains(word), "{section}: {e}");
    }
}

#[test]
fn a_small_lamp_in_the_dark_does_not_lead_the_meter_astray() {
    let folder = Folder::new("lamp");
    for nits in [10.0, 10_000.0] {
        let file = folder.write(
            "lamp.pbrt",
            &format!(
                "LookAt 0 0 0  0 0 1  0 1 0\nCamera \"perspective\" \"float fov\" 40\nWorldBegin\n\
                 AttributeBegin AreaLightSource \"diffuse\" \"rgb L\" [1 1 1] \"float scale\" {nits} \"bool twosided\" true\n\
                 Shape \"bilinearmesh\" \"point3 P\" [-0.2 -0.15 2  0.2 -0.15 2  -0.2 0.15 2  0.2 0.15 2] AttributeEnd\n"
            ),
        );
        for metering in ["average", "matrix", "centre-weighted"] {
            let mut shot = shot(&format!(
                "[scene]\nfile = \"{file}\"\n[exposure]\naperture = \"f/5.6\"\nmetering = \"{metering}\"\n[render]\nspp = 16\nsize = \"60x40\""
            ));
            let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| {} };
            shot.meter(&watch, &mut |_| {}).unwrap();
            // Four percent of the picture, darkness around it, of which a matrix makes more than a mean does. It was a day, not minutes.
            let time = shot.shutter.unwrap();
            assert!((1e-4..300.0).contains(&time), "{nits} cd/m², {metering}: {time} s");
        }
    }
}

#[test]
fn meters_leave_out_a_void() {
    // A lamp of 100 cd/m² on a twenty-fifth of the picture, and nothing else: EV log2(100 · 100 / 12.5).
    let folder = Folder::new("void");
    let head = "LookAt 0 0 0  0 0 1  0 1 0\nCamera \"perspective\" \"float fov\" 40\nWorldBegin\n";
    let lamp = "AttributeBegin AreaLightSource \"diffuse\" \"rgb L\" [100 100 100] \"bool twosided\" true\n\
         Shape \"bilinearmesh\" \"point3 P\" [-0.2 -0.15 2  0.2 -0.15 2  -0.2 0.15 2  0.2 0.15 2] AttributeEnd\n";
    // The same before a black wall, which is something.
    let wall = "Material \"diffuse\" \"rgb reflectance\" [0 0 0]\nShape \"bilinearmesh\" \"point3 P\" [-9 -9 3  9 -9 3  -9 9 3  9 9 3]\n";
    let ev = |name: &str, world: &str, metering: &str| {
        let file = folder.write(name, world);
        let mut shot = shot(&format!(
            "[scene]\nfile = \"{file}\"\n[exposure]\naperture = \"f/5.6\"\nmetering = \"{metering}\"\n[render]\nspp = 16\nsize = \"60x40\""
        ));
        let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| {} };
        shot.meter(&watch, &mut |_| {}).unwrap();
        (5.6f64.powi(2) / shot.shutter.unwrap()).log2()
    };
    let expected = (100.0f64 * 100.0 / 12.5).log2();
    for metering in ["average", "matrix", "centre-weighted", "spot"] {
        let found = ev("void.pbrt", &format!("{head}{lamp}"), metering);
        assert!((found - expected).abs() < 0.25, "{metering}: EV {found}, expected {expected}");
    }
    let before_a_wall = ev("wall.pbrt", &format!("{head}{lamp}{wall}"), "average");
    assert!(before_a_wall < expected - 3.0, "{before_a_wall}");
}

#[test]
fn a_lens_of_another_angle_than_the_files_camera_names_one_that_fits() {
    let folder = Folder::new("angle");
    let said = |fov: f64, more: &str| {
        let file = folder.write("wide.pbrt", &format!("Camera \"perspective\" \"float fov\" {fov}\n{WORLD}"));
        let toml = format!("[scene]\nfile = \"{file}\"\n[render]\nsize = \"24x16\"\n[camera]\n{more}\n");
        let mut said = Vec::new();
        Shot::prepare(&toml::from_str(&toml).unwrap(), &mut |w| said.push(w.to_owned())).unwrap_or_else(|e| panic!("{e}"));
        said.into_iter().find(|s| s.contains("the scene's camera sees"))
    };
    let warning = said(70.0, "lens = \"double-gauss-50mm\"").expect("27° are not 70°");
    // 2 atan(12 mm / 50.4 mm) = 26.8°, a little less where it is focused near.
    assert!(warning.contains("26°") || warning.contains("27°"), "{warning}");
    assert!(warning.contains("70°") && warning.contains("--lens rf-16mm-f2.8"), "{warning}");
    assert!(said(70.0, "focal_length = \"50mm\"").is_some());
    // The same angle, or no lens asked for: nothing to say.
    assert_eq!(said(27.0, "lens = \"double-gauss-50mm\""), None);
    assert_eq!(said(70.0, ""), None);
}

#[test]
fn a_camera_within_its_scene_focuses_on_what_it_sees_in_the_middle() {
    let folder = Folder::new("within");
    // The middle of the box around both walls lies behind the camera.
    let sheet = "[camera]\nlook_from = [0, 1, 0]\nlook_at = [0, 1, -1]\n\
        [[quad]]\ncorner = [-2, 0, -3]\nedges = [[4, 0, 0], [0, 2, 0]]\nmaterial = \"grey\"\n\
        [[quad]]\ncorner = [-2, 0, 9]\nedges = [[4, 0, 0], [0, 2, 0]]\nmaterial = \"grey\"\n\
        [material.grey]\ncolor = [0.5, 0.5, 0.5]\n[sky]\nluminance = 1000\n";
    let scene = folder.write("room.scene", sheet);
    let shot = shot(&format!("[scene]\nfile = {scene:?}\n[exposure]\naperture = \"f/2\"\n"));
    let Lens::Thin(_) = &shot.camera.lens else { panic!("a thin lens") };
    let focused = shot.camera.lens.focus_distance().unwrap().0;
    assert!((focused - 3000.0).abs() < 1.0, "{focused} mm");
}
