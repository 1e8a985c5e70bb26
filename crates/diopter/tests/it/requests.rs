//! What a shot file asks for, and what the camera says to it.

use diopter::expose::ProgressReporter;
use diopter::lens::{Iris, Lens};
use diopter::shot::{Shot, ShotFile};
use std::sync::atomic::AtomicBool;

/// A shot with what was said on the way.
fn told(toml: &str) -> (Shot, Vec<String>) {
    let file: ShotFile = toml::from_str(toml).unwrap_or_else(|e| panic!("{toml}: {e}"));
    let mut said = Vec::new();
    let shot = Shot::prepare(&file, &mut |w| said.push(w.to_owned())).unwrap_or_else(|e| panic!("{toml}: {e}"));
    (shot, said)
}

fn metered(toml: &str) -> (Shot, Vec<String>) {
    let (mut shot, mut said) = told(toml);
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| {} };
    shot.meter(&watch, &mut |w| said.push(w.to_owned())).unwrap();
    (shot, said)
}

#[test]
fn a_time_of_hours_is_said_to_be_long() {
    let long = |said: &[String]| said.iter().find(|s| s.contains("little light")).cloned();
    let small = "[render]\nsize = \"24x16\"\nspp = 1\n[exposure]\naperture = \"f/4\"\n";
    let (shot, said) = metered(&format!("{small}[scene]\nambient_ev = -8.0\n"));
    // 16 · 2^8 s.
    assert!((3000.0..6000.0).contains(&shot.shutter.unwrap()), "{:?}", shot.shutter);
    let warning = long(&said).expect("it is said");
    assert!(warning.contains("mode A") && warning.contains(" min)") && warning.contains("--iso auto"), "{warning}");
    // In daylight, or when the photographer sets the time, there is nothing to say.
    assert_eq!(long(&metered(&format!("{small}[scene]\nambient_ev = 12.0\n")).1), None);
    assert_eq!(long(&metered(&format!("{small}shutter = \"4096s\"\n[scene]\nambient_ev = -8.0\n")).1), None);
}

/// A square of a side, in an OBJ file of its own.
struct Model(std::path::PathBuf);

impl Model {
    fn new(name: &str, side: f32) -> Model {
        let path = std::env::temp_dir().join(format!("diopter-requests-{name}-{}.obj", std::process::id()));
        let text = format!("v 0 0 0\nv {side} 0 0\nv {side} {side} 0\nv 0 {side} 0\nf 1 2 3 4\n");
        std::fs::write(&path, text).unwrap();
        Model(path)
    }

    fn shot(&self, more: &str) -> String {
        format!("[render]\nsize = \"24x16\"\n[scene]\nfile = \"{}\"\n{more}", self.0.display())
    }
}

/// A box of a size (m) that stands on a height of 3 m, in an OBJ file of its own.
fn block(name: &str, [x, y, z]: [f32; 3]) -> Model {
    let model = Model::new(name, 1.0);
    let corner = |i: usize| [[-0.5, 0.5][i & 1] * x, 3.0 + [0.0, y][i >> 1 & 1], [-0.5, 0.5][i >> 2] * z];
    let mut text: String = (0..8).map(corner).map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
    for [a, b, c, d] in [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]] {
        text.push_str(&format!("f {a} {b} {c} {d}\n"));
    }
    std::fs::write(&model.0, text).unwrap();
    model
}

impl Drop for Model {
    fn drop(&mut self) {
        std::fs::remove_file(&self.0).ok();
    }
}

#[test]
fn a_model_in_centimetres_is_asked_about_and_scaled() {
    let unit = |said: &[String]| said.iter().find(|s| s.contains("--scale")).cloned();
    let fox = Model::new("fox", 155.0);
    let (large, said) = told(&fox.shot(""));
    let warning = unit(&said).expect("155 m is odd");
    assert!(warning.contains("155 m") && warning.contains("--scale 0.01 for centimetres (1.55 m)"), "{warning}");
    // Everything follows: size, the place of the camera, what it is focused at.
    let (small, said) = told(&fox.shot("scale = 0.01\n"));
    assert_eq!(unit(&said), None);
    let size = |shot: &Shot| shot.subject_bounds().size().x;
    assert!((size(&small) - 1.55).abs() < 1e-3, "{}", size(&small));
    let focus = |shot: &Shot| shot.camera.lens.focus_distance().unwrap().0;
    // Focused nearer, a lens sees a little less: it stands relatively farther away.
    assert!((98.0..100.5).contains(&(focus(&large) / focus(&small))), "{} {}", focus(&large), focus(&small));
    let tiny = Model::new("tiny", 4e-4);
    assert!(unit(&told(&tiny.shot("")).1).expect("0.4 mm is odd").contains("400 µm"));
    let chair = Model::new("chair", 0.8);
    assert_eq!(unit(&told(&chair.shot("")).1), None);
}

#[test]
fn a_scale_that_makes_no_sense_is_refused() {
    let refused = |toml: &str| match Shot::prepare(&toml::from_str(toml).unwrap(), &mut |_| {}) {
        Ok(_) => panic!("{toml} was taken"),
        Err(e) => e.to_string(),
    };
    for scale in ["0.0", "-1.0", "nan", "1e30"] {
        assert!(refused(&format!("[scene]\nfile = \"a.obj\"\nscale = {scale}\n")).contains("millimetres"), "{scale}");
    }
    assert!(refused("[scene]\nfile = \"cornell\"\nscale = 0.1\n").contains("embedded"));
    assert!(refused("[scene]\nscale = 0.1\n").contains("embedded"));
}

#[test]
fn small_sensors_are_not_given_the_lens_of_a_full_frame() {
    let focal = |toml: &str| {
        let (shot, said) = told(&format!("[render]\nsize = \"24x18\"\n{toml}"));
        let lens = &shot.camera.lens;
        (lens.focal_length().0, lens.f_number(), said.into_iter().find(|s| s.contains("equivalent")))
    };
    // A phone has its own, and says so when it gets another.
    let (own, f_number, said) = focal("[camera]\nbody = \"pixel-4a\"");
    assert_eq!((own, f_number, said), (4.435, 1.7, None));
    let (given, _, said) = focal("[camera]\nbody = \"pixel-4a\"\nfocal_length = \"50mm\"");
    let said = said.expect("307 mm equivalent is worth a word");
    assert!(given == 50.0 && said.contains("307 mm") && said.contains("4.435"), "{said}");
    // Of a bare sensor the angle of view stays, where lenses for 35 mm do not fit.
    let (scaled, ..) = focal("[camera]\nbody = \"imx249\"");
    assert!((scaled - 50.0 * 13.4 / 43.27).abs() < 0.7, "{scaled}");
    for body in ["canon-40d", "canon-5d", "gsense6510bsi"] {
        assert_eq!(focal(&format!("[camera]\nbody = \"{body}\"")).0, 50.0, "{body}");
    }
}

/// Part of the frame that the box around the subject fills, across and up, and how far its middle is off the frame's.
fn filled(shot: &Shot) -> ([f64; 2], [f64; 2]) {
    let Lens::Thin(lens) = &shot.camera.lens else { panic!("a thin lens") };
    let film = &shot.camera.film;
    let camera_from_world = shot.camera.motion.at(0.0).inverse();
    let (mut least, mut most) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for corner in shot.subject_bounds().corners() {
        let p = camera_from_world.transform_point3(corner).as_dvec3();
        assert!(p.z < 0.0, "behind the camera");
        for (k, v) in [p.x / film.width_mm, p.y / film.height_mm].into_iter().enumerate() {
            let seen = v * lens.film_distance().0 / -p.z;
            (least[k], most[k]) = (least[k].min(seen), most[k].max(seen));
        }
    }
    ([most[0] - least[0], most[1] - least[1]], [most[0] + least[0], most[1] + least[1]])
}

#[test]
fn a_bare_model_is_framed_lit_and_sharp() {
    for (name, size) in [("tall", [0.3, 2.0, 0.3]), ("flat", [3.0, 0.1, 2.0]), ("cube", [0.5, 0.5, 0.5])] {
        let model = block(name, size);
        for camera in ["", "[camera]\nfocal_length = \"24mm\"\n", "[camera]\nformat = \"24x36\"\n"] {
            let toml = if camera.contains("24x36") { model.shot(camera).replace("24x16", "16x24") } else { model.shot(camera) };
            let (shot, said) = told(&toml);
            let (filled, off) = filled(&shot);
            let larger = filled[0].max(filled[1]);
            assert!((0.65..0.75).contains(&larger) && off.iter().all(|o| o.abs() < 0.05), "{name} {camera}: {filled:?} {off:?}");
            // Lamps, sweep, a dim rest; and it is said.
            let objects = &shot.scene.description().objects;
            for part in ["studio key light", "studio fill light", "studio rim light", "studio backdrop"] {
                assert!(objects.iter().any(|o| o.name == part), "{part} is missing");
            }
            assert!(shot.scene.lights().environment.is_some() && said.iter().any(|s| s.contains("--light")), "{said:?}");
            // Focused on its front, not behind its middle, and stopped down.
            let place = shot.camera.motion.at(0.0);
            let middle = -place.inverse().transform_point3(shot.subject_bounds().center()).z;
            let focus = shot.camera.lens.focus_distance().unwrap().0 / 1000.0;
            assert!(focus < f64::from(middle) + 1e-3 && focus > 0.3 * f64::from(middle), "{name}: {focus} {middle}");
            assert!((5.6..=22.0).contains(&shot.camera.lens.f_number()), "{}", shot.camera.lens.f_number());
        }
        // An aperture that is asked for is taken.
        let (shot, _) = told(&model.shot("[exposure]\naperture = \"f/2\"\n"));
        assert_eq!(shot.camera.lens.f_number(), 2.0);
    }
}

#[test]
fn a_studio_lights_small_and_large_models_alike() {
    // f/16, ISO 100: grey in some 1500 lx is EV 9 to 11.
    let ev = |side: f32| {
        let model = block(&format!("alike-{side}"), [side; 3]);
        let (shot, _) = metered(&model.shot("light = \"studio\"\n[exposure]\naperture = \"f/16\"\n"));
        (256.0 / shot.shutter.unwrap()).log2()
    };
    let (small, large) = (ev(0.05), ev(20.0));
    assert!((7.0..11.0).contains(&large), "EV {large}");
    // A near subject takes light by its extension.
    assert!((-0.1..1.5).contains(&(large - small)), "{small} {large}");
}

#[test]
fn light_is_chosen_by_name() {
    let model = block("light", [0.4; 3]);
    let floor = |shot: &Shot| shot.scene.description().objects.iter().any(|o| o.name == "ground");
    let (overcast, _) = told(&model.shot("light = \"overcast\"\n"));
    assert!(floor(&overcast) && overcast.scene.lights().environment.is_some() && overcast.scene.lights().punctual.is_empty());
    let (sun, _) = told(&model.shot("light = \"sun\"\n"));
    assert!(floor(&sun) && sun.scene.lights().punctual.len() == 1);
    let (dark, said) = told(&model.shot("light = \"none\"\n"));
    assert!(!floor(&dark) && dark.scene.lights().environment.is_none() && said.iter().any(|s| s.contains("black")), "{said:?}");
    let refused = |more: &str| match Shot::prepare(&toml::from_str(&model.shot(more)).unwrap(), &mut |_| {}) {
        Ok(_) => panic!("{more} was taken"),
        Err(e) => e.to_string(),
    };
    assert!(refused("light = \"studo\"\n").contains("did you mean \"studio\"?"));
    assert!(refused("light = \"candle.jpg\"\n").contains("overcast"));
    assert!(refused("light = \"studio\"\nenvironment = \"a.hdr\"\n").contains("one of the two"));
    assert!(refused("light = \"overcast\"\n[scene.daylight]\nsun = [40.0, 100.0]\n").contains("one of the two"));
    assert!(refused("light = \"missing.hdr\"\n").contains("no such file"));
    let from_stream = diopter::shot::read_scene("-", false).err().unwrap().to_string();
    assert!(from_stream.contains("ending") && from_stream.contains("shot file"), "{from_stream}");
}

#[test]
fn a_saved_shot_keeps_the_studio() {
    let model = block("saved", [0.4; 3]);
    let text = model.shot("");
    let mut file: ShotFile = toml::from_str(&text).unwrap();
    let (shot, _) = metered(&text);
    shot.write_resolved(&mut file);
    assert_eq!(file.scene.light.as_deref(), Some("studio"));
    let (again, said) = told(&file.to_toml());
    // Directions are written as a point that is looked at.
    assert!(again.camera.motion.at(0.0).abs_diff_eq(shot.camera.motion.at(0.0), 1e-6));
    assert_eq!(again.camera.lens.f_number(), shot.camera.lens.f_number());
    assert_eq!(again.camera.lens.focus_distance(), shot.camera.lens.focus_distance());
    assert!(!said.iter().any(|s| s.contains("studio")), "{said:?}");
}

#[test]
fn a_lamp_in_a_void_is_told_of_the_studio() {
    let model = block("glowing", [0.4; 3]);
    let materials = model.0.with_extension("mtl");
    std::fs::write(&materials, "newmtl lamp\nKd 0 0 0\nKe 100 100 100\n").unwrap();
    let text = std::fs::read_to_string(&model.0).unwrap();
    let library = materials.file_name().unwrap().to_string_lossy().into_owned();
    std::fs::write(&model.0, format!("mtllib {library}\nusemtl lamp\n{text}")).unwrap();
    let hint = |said: &[String]| said.iter().any(|s| s.contains("black background") && s.contains("--light studio"));
    let (own, said) = told(&model.shot(""));
    assert!(hint(&said) && own.scene.lights().environment.is_none(), "{said:?}");
    assert!(!hint(&told(&model.shot("light = \"none\"\n")).1));
    let (lit, said) = told(&model.shot("light = \"studio\"\n"));
    assert!(!hint(&said) && lit.scene.lights().environment.is_some(), "{said:?}");
    std::fs::remove_file(materials).ok();
}

#[test]
fn pictures_of_light_without_a_scale_are_as_bright_as_a_day() {
    let model = block("picture", [0.5; 3]);
    let path = std::env::temp_dir().join(format!("diopter-requests-light-{}.pfm", std::process::id()));
    let write = |numbers: [f32; 6]| {
        let pixels = numbers.iter().flat_map(|v| [v.to_le_bytes(); 3].concat());
        std::fs::write(&path, b"PF\n3 2\n-1\n".iter().copied().chain(pixels).collect::<Vec<u8>>()).unwrap();
    };
    let as_flag = |key: &str, more: &str| model.shot(&format!("{key} = \"{}\"\n{more}", path.display()));
    let mean = |shot: &Shot| shot.scene.lights().environment.as_ref().unwrap().mean_luminance();
    write([1.0, 2.0, f32::NAN, -1.0, 3.0, 0.5]);
    let (shot, said) = told(&as_flag("light", ""));
    // π times the mean luminance: 10 000 lx on average.
    assert!((mean(&shot) * std::f32::consts::PI / 10_000.0 - 1.0).abs() < 1e-4, "{}", mean(&shot));
    assert!(said.iter().any(|s| s.contains("2 of 6 pixels")) && said.iter().any(|s| s.contains("--ambient-ev")), "{said:?}");
    // As cd/m², or with a scale, the numbers are taken as they are: both rows are seen under the same angles.
    for (key, more, scale) in [("environment", "", 1.0), ("light", "environment_scale = 100.0\n", 100.0)] {
        let (shot, said) = told(&as_flag(key, more));
        assert!((mean(&shot) / scale - 6.5 / 6.0).abs() < 1e-4, "{key}: {}", mean(&shot));
        assert!(!said.iter().any(|s| s.contains("values are relative")), "{said:?}");
    }
    write([0.0, -1.0, f32::NAN, f32::INFINITY, 0.0, 0.0]);
    for key in ["light", "environment"] {
        let error = Shot::prepare(&toml::from_str(&as_flag(key, "")).unwrap(), &mut |_| {}).err().unwrap().to_string();
        assert!(error.contains("black everywhere") && error.contains("no other"), "{error}");
    }
    std::fs::remove_file(&path).unwrap();
}

fn refused(toml: &str) -> String {
    let file: ShotFile = toml::from_str(toml).unwrap_or_else(|e| panic!("{toml}: {e}"));
    Shot::prepare(&file, &mut |_| ()).err().unwrap_or_else(|| panic!("{toml} is accepted")).to_string()
}

#[test]
fn what_needs_something_beside_it_is_refused_alone() {
    for (toml, told) in [
        ("[camera]\nlens = \"thin\"\nblade_rotation_deg = 20.0", "blade_rotation 20°: expected blades beside it"),
        ("[camera]\nlens = \"double-gauss-50mm\"\nblade_curvature = 0.5", "blade_curvature 0.5: expected blades beside it"),
        ("[camera]\naperture_image = \"star.png\"\nblades = 5", "blades 5: expected no aperture_image beside it"),
        ("[scene]\nenvironment_rotation_deg = 5.0", "environment_rotation 5°: expected a picture beside it"),
        ("[scene]\nlight = \"sun\"\nenvironment_scale = 2.0", "environment_scale 2: expected a picture beside it"),
    ] {
        let error = refused(&format!("[render]\nsize = \"24x16\"\n{toml}\n"));
        assert!(error.contains(told), "{toml}: {error}");
    }
}

#[test]
fn an_iris_that_shows_nowhere_is_told() {
    let small = |camera: &str| format!("[render]\nsize = \"24x16\"\n[camera]\nblades = 5\nlens = \"{camera}\"\n");
    let said = |toml: &str| told(toml).1.iter().any(|w| w.contains("shape of the iris"));
    assert!(said(&small("pinhole")) && said(&small("fisheye-equidistant")) && !said(&small("thin")));
    assert!(!said(&format!("{}[exposure]\naperture = \"f/4\"\n", small("fisheye-equidistant"))));
}

#[test]
fn blades_of_a_lens_sheet_are_turned_and_rounded() {
    let path = std::env::temp_dir().join(format!("diopter-requests-blades-{}.toml", std::process::id()));
    let mut sheet = diopter::lens::embedded("double-gauss-50mm").unwrap();
    sheet.iris = Iris::blades(7, 0.1, 0.2).unwrap();
    std::fs::write(&path, sheet.to_toml()).unwrap();
    let blades = |more: &str| {
        let lens = path.display();
        let (shot, _) =
            told(&format!("[render]\nsize = \"24x16\"\n[exposure]\naperture = \"f/4\"\n[camera]\nlens = \"{lens}\"\n{more}"));
        match &shot.camera.lens {
            Lens::Compound(lens) => match &lens.system().iris.shape {
                Iris::Blades(b) => (b.count, b.rotation, b.curvature),
                other => panic!("{other:?}"),
            },
            _ => panic!("a real lens"),
        }
    };
    let near = |a: (u32, f32, f32), b: (u32, f32, f32)| a.0 == b.0 && (a.1 - b.1).abs() < 1e-5 && (a.2 - b.2).abs() < 1e-5;
    for (more, expected) in [
        ("", (7, 0.1, 0.2)),
        ("blade_rotation_deg = 90.0", (7, std::f32::consts::FRAC_PI_2, 0.2)),
        ("blade_curvature = 0.5", (7, 0.1, 0.5)),
        ("blades = 5", (5, 0.0, 0.0)),
    ] {
        let found = blades(more);
        assert!(near(found, expected), "{more}: {found:?}");
    }
    std::fs::remove_file(&path).ok();
}
