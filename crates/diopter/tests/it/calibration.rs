//! Calibrations of whole shots, and cameras from their files.

use diopter::calibration::{Format, PrincipalRay, observe};
use diopter::lens::Lens;
use diopter::shot::{Shot, ShotFile};
use glam::{DVec2, DVec3};
use std::path::PathBuf;

fn file(set: impl FnOnce(&mut ShotFile)) -> ShotFile {
    let mut file = ShotFile::default();
    file.scene.file = Some("cornell".into());
    file.render.size = Some("480x320".parse().unwrap());
    file.exposure.shutter = Some("1/60".parse().unwrap());
    file.focus.distance = Some("inf".parse().unwrap());
    set(&mut file);
    file
}

fn shot(set: impl FnOnce(&mut ShotFile)) -> Shot {
    Shot::prepare(&file(set), &mut |_| {}).unwrap()
}

fn refused(set: impl FnOnce(&mut ShotFile)) -> String {
    Shot::prepare(&file(set), &mut |_| {}).err().expect("a request that is refused").to_string()
}

/// Where a pixel looks, in the axes of OpenCV.
fn direction(shot: &Shot, pixel: DVec2) -> Option<DVec3> {
    observe::ray(&shot.camera.lens, &shot.camera.film, pixel, PrincipalRay::CHIEF).map(|r| r[1])
}

/// A file that goes away.
struct Temporary(PathBuf);

impl Temporary {
    fn new(name: &str, text: &str) -> Temporary {
        let path = std::env::temp_dir().join(format!("diopter-calibration-{}-{name}", std::process::id()));
        std::fs::write(&path, text).unwrap();
        Temporary(path)
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

#[test]
fn a_traced_lens_comes_back_as_an_ideal_camera() {
    let traced = shot(|f| f.camera.lens = Some("double-gauss-50mm".into()));
    let calibration = traced.calibration("a.jpg").unwrap();
    let residual = calibration.fit.as_ref().unwrap().max_px;
    let focal = calibration.model.focal().x;
    for format in [Format::Json, Format::OpenCv, Format::ColmapCameras] {
        let kept = Temporary::new(&format!("{format:?}"), &calibration.text(format).unwrap());
        let ideal = shot(|f| f.camera.calibration = Some(kept.0.clone()));
        assert!(matches!(&ideal.camera.lens, Lens::Calibrated(l) if l.pupil().is_none()));
        // The effective focal length, within what distortion leaves of it in the middle.
        assert!((ideal.camera.lens.focal_length().0 / traced.camera.lens.focal_length().0 - 1.0).abs() < 0.02);
        for pixel in [DVec2::new(10.0, 20.0), DVec2::new(239.5, 159.5), DVec2::new(400.0, 33.0), DVec2::new(479.0, 319.0)] {
            let (a, b) = (direction(&traced, pixel).unwrap(), direction(&ideal, pixel).unwrap());
            // Pixels over the focal length are radians in the middle and more than those elsewhere.
            assert!((a - b).length() < 1.5 * residual / focal + 1e-6, "{format:?} {pixel}: {}", (a - b).length() * focal);
        }
        // The file of everything brings its light with it.
        let light = |s: &Shot, p: DVec2| {
            let film = s.camera.film;
            let at = DVec2::new((0.5 - (p.x + 0.5) / 480.0) * film.width_mm, ((p.y + 0.5) / 320.0 - 0.5) * film.height_mm);
            s.camera.lens.ray(at, [0.5, 0.5]).unwrap().weight_sr
        };
        let corner = light(&ideal, DVec2::new(2.0, 2.0)) / light(&ideal, DVec2::new(240.0, 160.0));
        assert_eq!(corner < 0.9, format == Format::Json, "{corner}");
    }
}

#[test]
fn an_aperture_gives_a_calibration_depth_of_field() {
    let traced = shot(|f| f.camera.lens = Some("double-gauss-50mm".into()));
    let kept = Temporary::new("blur.json", &traced.calibration("").unwrap().text(Format::Json).unwrap());
    let blurred = shot(|f| {
        f.camera.calibration = Some(kept.0.clone());
        f.exposure.aperture = Some("f/2".parse().unwrap());
        f.focus.distance = Some("2m".parse().unwrap());
    });
    assert!((blurred.camera.lens.focus_distance().unwrap().0 - 2000.0).abs() < 1e-9);
    assert!(matches!(&blurred.camera.lens, Lens::Calibrated(l) if l.pupil().is_some()));
    // The size of the calibration is taken where none is asked for; another shape is refused.
    let whole = shot(|f| {
        f.camera.calibration = Some(kept.0.clone());
        f.render.size = None;
    });
    assert_eq!((whole.camera.film.columns, whole.camera.film.rows), (480, 320));
    let e = refused(|f| {
        f.camera.calibration = Some(kept.0.clone());
        f.render.size = Some("400x400".parse().unwrap());
    });
    assert!(e.contains("--size 480x320"), "{e}");
    let e = refused(|f| {
        f.camera.calibration = Some(kept.0.clone());
        f.camera.lens = Some("thin".into());
    });
    assert!(e.contains("either a lens or a calibration"), "{e}");
    assert!(refused(|f| f.camera.calibration = Some("no-such-file.yaml".into())).contains("there is no such file"));
}

#[test]
fn fisheyes_and_angles_of_view_are_those_asked_for() {
    let edge = DVec2::new(-0.5, 159.5);
    let off_axis = |s: &Shot| direction(s, edge).map(|d| d.truncate().length().atan2(d.z).to_degrees());
    for lens in ["fisheye-equidistant", "fisheye-equisolid", "fisheye-stereographic"] {
        let wide = shot(|f| {
            f.camera.lens = Some(lens.into());
            f.camera.fov_deg = Some(200.0);
        });
        assert!((off_axis(&wide).unwrap() - 100.0).abs() < 1e-6, "{lens}");
        // Without an angle, half of the sky from corner to corner.
        let half = shot(|f| f.camera.lens = Some(lens.into()));
        let corner = direction(&half, DVec2::new(-0.5, -0.5)).unwrap();
        assert!(corner.z.abs() < 1e-6, "{lens}: {corner}");
    }
    // r = 2 f sin(θ/2) at 8 mm.
    let eight = shot(|f| {
        f.camera.lens = Some("fisheye-equisolid".into());
        f.camera.focal_length = Some("8mm".parse().unwrap());
    });
    let film = eight.camera.film;
    let pixel = DVec2::new(239.5 + 5.0 * 480.0 / film.width_mm, 159.5);
    let d = direction(&eight, pixel).unwrap();
    assert!((d.x.atan2(d.z) - 2.0 * (5.0f64 / 16.0).asin()).abs() < 1e-9, "{d}");
    let thin = shot(|f| {
        f.camera.lens = Some("thin".into());
        f.camera.fov_deg = Some(90.0);
    });
    assert!((off_axis(&thin).unwrap() - 45.0).abs() < 1e-6);
    assert!(refused(|f| (f.camera.lens, f.camera.fov_deg) = (Some("thin".into()), Some(180.0))).contains("below 180"));
    assert!(
        refused(|f| (f.camera.lens, f.camera.fov_deg) = (Some("double-gauss-50mm".into()), Some(40.0))).contains("ideal lens")
    );
}

#[test]
fn a_shift_shows_more_of_one_side() {
    for lens in ["thin", "double-gauss-50mm"] {
        let (plain, shifted) = (
            shot(|f| f.camera.lens = Some(lens.into())),
            shot(|f| (f.camera.lens, f.camera.shift_mm) = (Some(lens.into()), Some([0.0, 4.0]))),
        );
        // 4 mm up: what was so far above a pixel is in it now.
        let rows = 4.0 / plain.camera.film.height_mm * 320.0;
        let (a, b) = (direction(&plain, DVec2::new(300.0, 200.0 - rows)), direction(&shifted, DVec2::new(300.0, 200.0)));
        // Regions of the pupil are found anew: the middle of what passes moves by their bins.
        assert!((a.unwrap() - b.unwrap()).length() < 2e-4, "{lens}");
        // Light comes from the far edge, too.
        assert!(direction(&shifted, DVec2::new(240.0, 0.0)).unwrap().y < direction(&plain, DVec2::new(240.0, 0.0)).unwrap().y);
    }
    // The principal point lies where the axis is: 4 mm down in the picture.
    let shifted = shot(|f| (f.camera.lens, f.camera.shift_mm) = (Some("pinhole".into()), Some([1.0, 4.0])));
    let model = shifted.calibration("").unwrap().model;
    let film = shifted.camera.film;
    let centre = DVec2::new(239.5 - 480.0 / film.width_mm, 159.5 + 4.0 / film.height_mm * 320.0);
    assert!((model.centre() - centre).length() < 1e-6, "{} {centre}", model.centre());
    assert!(refused(|f| f.camera.shift_mm = Some([0.0, 1e4])).contains("shift"));
    assert!(refused(|f| (f.camera.lens, f.camera.tilt_deg) = (Some("pinhole".into()), Some([8.0, 0.0]))).contains("tilt"));
}

#[test]
fn a_tilt_keeps_the_view_and_is_calibrated() {
    let tilted = |lens: &str, tilt: [f64; 2]| shot(|f| (f.camera.lens, f.camera.tilt_deg) = (Some(lens.into()), Some(tilt)));
    let (plain, other) = (tilted("double-gauss-50mm", [0.0; 2]), tilted("double-gauss-50mm", [8.0, 3.0]));
    assert!(other.camera.lens.is_tilted() && !plain.camera.lens.is_tilted());
    // The film stays where it was before the scene: pixels look where they looked, but for the distortion that goes along with the lens's own axis. That of the double
    // Gauss is 0.1 tan³ θ (its k1 is −0.094), at the angle θ to the axis with and without the turn, 8.5° more at most; a third for higher orders.
    for pixel in [DVec2::new(239.5, 159.5), DVec2::new(60.0, 40.0), DVec2::new(420.0, 280.0)] {
        let (a, b) = (direction(&plain, pixel).unwrap(), direction(&other, pixel).unwrap());
        let angle = a.z.acos();
        let bound = 1.33 * 0.1 * (angle.tan().powi(3) + (angle + 8.5f64.to_radians()).tan().powi(3));
        assert!((a - b).length() < bound, "{pixel}: {a} {b}, {} of {bound}", (a - b).length());
    }
    // The corrections of the development are about the lens's axis: none are written.
    assert!(other.facts().lens_profile.is_none() && plain.facts().lens_profile.is_some());
    // A model with a tilted sensor says what pixels see.
    let model = other.calibration("").unwrap().model;
    let at = model.project(direction(&other, DVec2::new(300.0, 100.0)).unwrap()).unwrap();
    assert!((at - DVec2::new(300.0, 100.0)).length() < 0.3, "{at}");
    assert!(
        refused(|f| {
            (f.camera.lens, f.camera.tilt_deg) = (Some("double-gauss-50mm".into()), Some([8.0, 0.0]));
            f.render.quick = true;
        })
        .contains("quick look")
    );
}

#[test]
fn a_picture_knows_its_pose() {
    let set = |f: &mut ShotFile| {
        f.camera.lens = Some("pinhole".into());
        f.camera.look_from = Some([1.0, 1.5, 4.0]);
        f.camera.look_at = Some([0.0, 1.0, 0.0]);
        f.shutter.readout = Some("30ms".parse().unwrap());
    };
    let shot = shot(set);
    let calibration = shot.calibration("a.jpg").unwrap();
    // Rows follow each other: of the first, middle and last one.
    assert_eq!(calibration.frames[0].poses.len(), 9);
    let middle = calibration.frames[0].middle().unwrap();
    let (q, t) = middle.opencv();
    let seen = q * DVec3::new(0.0, 1.0, 0.0) + t;
    let at = calibration.model.project(seen).unwrap();
    assert!((at - DVec2::new(239.5, 159.5)).length() < 1e-3 && seen.z > 4.0, "{at}");
    for format in [Format::Json, Format::ColmapImages, Format::Nerfstudio, Format::OpenCv] {
        assert!(!calibration.text(format).unwrap().is_empty());
    }
}
