//! Cases in closed form: one cause at a time, through ideal lenses.

use super::blur::{Filters, blur};
use super::spot::{Colors, Moving, Subject};
use super::*;
use crate::camera::Film;
use crate::shot::ShotFile;
use diopter_lens::compound::{REFERENCE_NM, Setting};
use diopter_lens::ray::{Apertures, TraceDirection, TracedRay};
use diopter_lens::{CompoundLens, Pinhole};
use diopter_scene::material::{Material, Scattering};
use diopter_scene::motion::{AnimatedProperty, Animation, AnimationPlayback, Channel, KeyInterpolation, Motion, Node};
use diopter_scene::shape::Mesh;
use diopter_scene::texture::Color;
use diopter_scene::{Description, Object, Shape};
use glam::{Affine3A, DVec3, Vec3};
use std::f64::consts::{LN_2, PI, SQRT_2};
use std::sync::Arc;

/// Frequency × width at which a box has half of its response.
const BOX_HALF: f64 = 0.603_354_6;
/// Samples of pupil and time are Sobol points: moments of discs and streaks are better than this.
const CLOSE: f64 = 0.01;

/// A large square at a depth before the camera that moves (m/s).
fn wall(depth: f32, speed: Vec3) -> Scene {
    let corner = |x: f32, y: f32| Vec3::new(x * depth, y * depth, -depth);
    let mesh = Mesh {
        positions: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Default::default()
    };
    let shape = Shape::Mesh { mesh: 0, world_from_mesh: Affine3A::IDENTITY };
    let object = Object { motion: Motion::Carried { node: 0 }, ..Object::new("wall", shape, 0) };
    let keys = Channel {
        node: 0,
        property: AnimatedProperty::Translation,
        interpolation: KeyInterpolation::Linear,
        times_s: vec![0.0, 10.0],
        values: [Vec3::ZERO, speed * 10.0].iter().flat_map(|v| v.to_array()).collect(),
    };
    let moves = speed != Vec3::ZERO;
    let mut scene = Scene::build(Description {
        meshes: vec![mesh.into()],
        materials: vec![Material::new("paper", Scattering::Diffuse(Color::rgb(0.5, 0.5, 0.5)))],
        objects: vec![if moves { object } else { Object { motion: Motion::Still, ..object } }],
        nodes: vec![Node::new("node")],
        animations: if moves { vec![Animation { name: "go".into(), channels: vec![keys] }] } else { vec![] },
        playing: if moves {
            AnimationPlayback { animations: vec![0], ..Default::default() }
        } else {
            AnimationPlayback::default()
        },
        ..Default::default()
    })
    .unwrap();
    scene.pose(0.0, 1.0);
    scene
}

fn thin(f_number: f64, focus_m: f64) -> Lens {
    let focus = Focus::Distance(Millimeters(1e3 * focus_m));
    Lens::Thin(ThinLens::new(Millimeters(50.0), f_number, Iris::Round, focus).unwrap())
}

/// 36 × 24 mm of pixels so wide, mm, through a lens.
fn camera(lens: Lens, pixel_mm: f64) -> Camera {
    let [columns, rows] = [36.0, 24.0].map(|side: f64| (side / pixel_mm).round() as usize);
    Camera { lens, film: Film::new(36.0, 24.0, columns, rows), motion: CameraMotion::still(Affine3A::IDENTITY) }
}

/// Blur and causes in a place that is not quite the middle.
fn found(scene: &Scene, camera: &Camera, shutter: Shutter, diffracts: bool) -> (Blur, Vec<Cause>) {
    let says = |lens: &Lens| diffracts && !matches!(lens, Lens::Pinhole(_));
    let model = Model { scene, camera, shutter, colors: Colors::one(550.0), crosstalk: 0.0, diffracts: &says };
    let at = DVec2::new(0.51 * camera.film.columns as f64, 0.49 * camera.film.rows as f64);
    let subject = Subject::seen(scene, camera, &shutter, 0.0, at).unwrap();
    let filters = Filters::new(&camera.film, 0.0, [0.0; 2]);
    let on = On { moving: Moving { subject: true, camera: true }, diffraction: true, filters };
    let all = blur(&model.spot(&subject, camera, &shutter, &on).unwrap(), &filters);
    let causes = model.causes(&subject, &all, &on);
    (all, causes)
}

fn fraction(causes: &[Cause], name: &str) -> f64 {
    causes.iter().find(|c| c.name == name).unwrap().fraction
}

/// Blur radius of what has half of its response at a frequency, µm.
fn radius_um(per_mm: f64) -> f64 {
    1e3 * SQRT_2 * (0.5 * LN_2).sqrt() / (PI * per_mm)
}

#[test]
fn defocus_alone_is_the_circle_of_confusion() {
    let (focus, depth) = (5.0, 2.5);
    let camera = camera(thin(2.0, focus), 2e-3);
    let (all, causes) = found(&wall(depth as f32, Vec3::ZERO), &camera, Shutter::global(0.01), false);
    // c = (f / N) v |1 / focus − 1 / depth| with the film at v = f s / (s − f).
    let v = 50.0 * 5000.0 / 4950.0;
    let c = 25.0 * v * (1.0 / (1e3 * depth) - 1.0 / (1e3 * focus));
    // A disc of diameter c: 2 J1(x) / x = ½ at x = π c f = 2.2151; its root mean square radius is c / √8. A pixel of 2 µm adds (w² / 6).
    let disc = radius_um(2.215_1 / (PI * c));
    let rms = 1e3 * (c * c / 8.0 + 4e-6 / 6.0).sqrt();
    assert!((all.rms_um / rms - 1.0).abs() < CLOSE, "{all:?} {rms}");
    assert!((all.radius_um / disc - 1.0).abs() < CLOSE, "{all:?} {disc}");
    assert!(fraction(&causes, "defocus") > 0.999, "{causes:?}");
    for name in ["aberrations", "diffraction", "motion of the subject", "motion of the camera", "demosaicing"] {
        assert_eq!(fraction(&causes, name), 0.0, "{name}");
    }
}

#[test]
fn a_subject_that_crosses_leaves_a_streak() {
    // 0.2 m/s at 2 m for 1/4 s: 50 mm × 0.05 m / 2 m = 1.25 mm on the film.
    let camera = camera(Lens::Pinhole(Pinhole::new(Millimeters(50.0), 8.0).unwrap()), 0.01);
    let shutter = Shutter::global(0.25);
    let (all, causes) = found(&wall(2.0, Vec3::new(0.2, 0.0, 0.0)), &camera, shutter, false);
    let streak = 1.25;
    assert!((all.rms_um / (1e3 * streak / 12f64.sqrt()) - 1.0).abs() < CLOSE, "{all:?}");
    assert_eq!(all.widest_deg, 0.0);
    assert!((all.widest_um / radius_um(BOX_HALF / streak) - 1.0).abs() < CLOSE, "{all:?}");
    assert!(fraction(&causes, "motion of the subject") > 0.99 && fraction(&causes, "motion of the camera") == 0.0, "{causes:?}");
}

#[test]
fn a_pan_that_follows_cancels_the_motion_of_its_subject() {
    // A pan of 0.1 rad/s to the left over something that stands: 50 mm × 0.1 × 0.25 = 1.25 mm.
    let pan = |rate: f32| CameraMotion::sampled(0.25, move |t| Affine3A::from_rotation_y(rate * t as f32));
    let lens = Lens::Pinhole(Pinhole::new(Millimeters(50.0), 8.0).unwrap());
    let still = Camera { motion: pan(0.1), ..camera(lens, 0.01) };
    let shutter = Shutter::global(0.25);
    let (all, causes) = found(&wall(2.0, Vec3::ZERO), &still, shutter, false);
    assert!((all.widest_um / radius_um(BOX_HALF / 1.25) - 1.0).abs() < CLOSE, "{all:?}");
    assert!(fraction(&causes, "motion of the camera") > 0.99 && fraction(&causes, "motion of the subject") == 0.0, "{causes:?}");
    // The wall moves to the right by as much as the camera turns to the right: without either the picture would be softer.
    let following = Camera { motion: pan(-0.1), ..still };
    let (all, causes) = found(&wall(2.0, Vec3::new(0.2, 0.0, 0.0)), &following, shutter, false);
    assert!(all.radius_px < 2.0, "{all:?}");
    assert!(
        fraction(&causes, "motion of the camera") < -10.0 && fraction(&causes, "motion of the subject") < -10.0,
        "{causes:?}"
    );
}

#[test]
fn a_small_aperture_is_limited_by_diffraction() {
    let camera = camera(thin(16.0, 2.0), 1e-3);
    let (all, causes) = found(&wall(2.0, Vec3::ZERO), &camera, Shutter::global(0.01), true);
    // A round pupil: (2 / π)(acos x − x √(1 − x²)) = ½ at x = 0.40397 of the cutoff 1 / (λ N'), N' = v / D. The table of the pattern ends where 0.4 % of the
    // light is left, and samples leave 1 %.
    let cutoff = 2.0 * camera.lens.pupil_slope() / 550e-6;
    let airy = radius_um(0.403_97 * cutoff);
    let whole = all.radius_um;
    assert!((whole / airy - 1.0).abs() < 0.03, "{all:?} {airy}");
    assert!(fraction(&causes, "diffraction") > 0.98 && fraction(&causes, "defocus").abs() < 0.01, "{causes:?}");
}

#[test]
fn what_is_sharp_is_limited_by_its_pixels() {
    let camera = camera(Lens::Pinhole(Pinhole::new(Millimeters(50.0), 8.0).unwrap()), 0.02);
    let (all, causes) = found(&wall(2.0, Vec3::ZERO), &camera, Shutter::global(0.01), false);
    assert!((all.widest_um / radius_um(BOX_HALF / 0.02) - 1.0).abs() < 2e-3, "{all:?}");
    assert!((all.mtf50_per_px.unwrap() / BOX_HALF - 1.0).abs() < 0.05, "{all:?}");
    assert!(fraction(&causes, "pixel aperture") > 0.999, "{causes:?}");
    let others: f64 = causes.iter().filter(|c| c.name != "pixel aperture").map(|c| c.fraction.abs()).sum();
    assert!(others < 1e-9, "{causes:?}");
}

#[test]
fn fractions_of_independent_causes_add_up() {
    // Defocus, motion, diffraction and pixels of about the same size. Squares of Gaussians would add to 1; a disc, a box and an Airy pattern miss by some percent.
    let camera =
        Camera { film: Film { low_pass_mm: 8e-3, ..camera(thin(11.0, 2.0), 0.015).film }, ..camera(thin(11.0, 2.0), 0.015) };
    let (all, causes) = found(&wall(2.1, Vec3::new(3e-3, 0.0, 0.0)), &camera, Shutter::global(0.25), true);
    let sum: f64 = causes.iter().map(|c| c.fraction).sum();
    assert!((0.75..1.15).contains(&sum), "{sum} {causes:?}");
    for name in ["defocus", "diffraction", "motion of the subject", "pixel aperture", "low-pass filter"] {
        assert!(fraction(&causes, name) > 0.02, "{name}: {causes:?}");
    }
    assert!(causes.iter().all(|c| c.without.radius_um <= all.radius_um), "{causes:?}");
}

#[test]
fn a_shot_explains_itself() {
    let mut file = ShotFile::default();
    file.scene.file = Some("flat-field".into());
    file.camera.body = Some("canon-t2i".into());
    file.render.size = Some(crate::quantity::Size { width: 60, height: 40 });
    file.render.spp = Some(16);
    file.exposure.nd = Some(crate::quantity::Filter(1.0));
    let mut shot = Shot::prepare(&file, &mut |_| ()).unwrap();
    let cancel = std::sync::atomic::AtomicBool::new(false);
    let watch = crate::expose::ProgressReporter { cancel: &cancel, progress: &|_| () };
    shot.meter(&watch, &mut |_| ()).unwrap();
    let why = why(&shot, Some([0.4, 0.6]), None).unwrap();
    let b = &why.brightness;
    let product = b.factors.iter().fold(b.luminance, |p, f| p * f.factor);
    assert!((product / b.value - 1.0).abs() < 1e-9 && b.value > 0.0, "{b:?}");
    let electrons = b.factors.iter().find(|f| f.name == "response").unwrap().product;
    assert!((electrons / b.electrons - 1.0).abs() < 1e-9, "{b:?}");
    // Half of the light by the filter; a white board that was metered as grey is shown as grey, but for what the body's headroom changes.
    assert!((b.factors.iter().find(|f| f.name == "neutral density filter").unwrap().factor - 0.5).abs() < 1e-12);
    assert!((0.1..0.35).contains(&b.value), "{b:?}");
    // What the exposure itself holds there: by another number of samples and with the pattern of the pixels, 16 samples of an even field.
    let plane = shot.expose(&watch).unwrap();
    let channel = shot.sensor.cfa.channel_at(why.pixel[0], why.pixel[1]);
    let there = f64::from(plane.mean.pixel(why.pixel[0], why.pixel[1])[channel]);
    assert!((there / b.electrons - 1.0).abs() < 0.1, "{there} {b:?}");
    assert!((why.noise.terms.iter().map(|t| t.fraction).sum::<f64>() - 1.0).abs() < 1e-9, "{:?}", why.noise);
    // Two stops down: a quarter of the light at four times the speed has more noise, and the numbers say by how much.
    let down = why.advice.iter().find(|a| a.change.starts_with("two stops down")).unwrap();
    assert!(down.noise > 1.02 && down.noise < 2.5 && down.iso > shot.reading.iso, "{down:?}");
    assert!(super::why(&shot, Some([1.4, 0.6]), None).is_err());
}

#[test]
fn dark_pictures_want_more_and_full_pixels_less_light() {
    let mut file = ShotFile::default();
    file.scene.file = Some("flat-field".into());
    file.render.size = Some(crate::quantity::Size { width: 24, height: 16 });
    file.render.spp = Some(4);
    file.exposure.aperture = Some(crate::quantity::FNumber(4.0));
    file.exposure.iso = Some(crate::quantity::IsoChoice::Fixed(crate::quantity::Iso(400.0)));
    let cancel = std::sync::atomic::AtomicBool::new(false);
    let watch = crate::expose::ProgressReporter { cancel: &cancel, progress: &|_| () };
    let advice = |seconds: f64| {
        let mut file = file.clone();
        file.exposure.shutter = Some(crate::quantity::Seconds(seconds));
        let mut shot = Shot::prepare(&file, &mut |_| ()).unwrap();
        shot.meter(&watch, &mut |_| ()).unwrap();
        let metered = shot.facts().metered_ev100.unwrap();
        let off = crate::metering::ev100_of_setting(4.0, seconds, 400.0) - metered;
        (why(&shot, None, None).unwrap(), off)
    };
    let (_, off) = advice(0.01);
    // By three stops too dark, by six too light, and right.
    let right = 0.01 * off.exp2();
    let of = |why: &Why, change: &str| why.advice.iter().find(|a| a.change.starts_with(change)).cloned();
    let (dark, _) = advice(right / 8.0);
    let longer = of(&dark, "8 times the time").unwrap();
    // The renderer's own noise grows with the light.
    assert!((longer.brightness_ev - 3.0).abs() < 0.02 && longer.noise < 0.9 && longer.iso == 400.0, "{longer:?}");
    let faster = of(&dark, "a higher speed").unwrap();
    assert!((faster.brightness_ev - 3.0).abs() < 0.1 && faster.iso > 3000.0, "{faster:?}");
    let (full, _) = advice(right * 64.0);
    assert!(full.noise.clipped);
    let shorter = full.advice.iter().find(|a| a.change.contains("of the time")).unwrap();
    assert!(shorter.brightness_ev < -1.0 && full.advice.iter().all(|a| a.noise.is_nan()), "{:?}", full.advice);
    let (fine, _) = advice(right);
    assert!(fine.advice.iter().all(|a| !a.change.contains("same speed")), "{:?}", fine.advice);
}

#[test]
fn a_real_lens_draws_points_where_rays_from_the_scene_land() {
    // The spot is found from the film; traced forward from the scene point, through a grid over the entrance pupil, it must be the same.
    let prescription = Arc::new(diopter_lens::embedded("double-gauss-50mm").unwrap());
    let focus = Focus::Distance(Millimeters(2000.0));
    let setting = Setting { focal_length: None, f_number: Some(2.8), focus, iris: None, film_mm: [36.0, 24.0] };
    let lens = CompoundLens::new(prescription, &setting).unwrap();
    let (system, first) = (lens.system().clone(), *lens.first_order());
    let camera = camera(Lens::Compound(Box::new(lens)), 2e-3);
    let (scene, shutter) = (wall(2.0, Vec3::ZERO), Shutter::global(0.01));
    let says = |_: &Lens| false;
    let colors = Colors::one(REFERENCE_NM);
    let model = Model { scene: &scene, camera: &camera, shutter, colors, crosstalk: 0.0, diffracts: &says };
    let on = On { moving: Moving { subject: true, camera: true }, diffraction: false, filters: Filters::default() };
    for at in [[0.5, 0.5], [0.8, 0.65]] {
        let at = DVec2::new(at[0] * camera.film.columns as f64, at[1] * camera.film.rows as f64);
        let subject = Subject::seen(&scene, &camera, &shutter, 0.0, at).unwrap();
        let found = blur(&model.spot(&subject, &camera, &shutter, &on).unwrap(), &Filters { pitch_mm: [2e-3; 2], ..on.filters });
        let object = subject.surface.as_ref().unwrap().point.as_dvec3() * 1e3 + DVec3::Z * first.entrance_pupil_z;
        let n = system.indices(REFERENCE_NM);
        let side = 101;
        let place = |i: i32| (f64::from(i) / f64::from(side - 1) * 2.0 - 1.0) * 1.5 * first.entrance_pupil_radius();
        let mut landed = Vec::new();
        for i in 0..side * side {
            let target = DVec3::new(place(i % side), place(i / side), first.entrance_pupil_z);
            let direction = (target - object).normalize();
            // Begun near the lens, so that rays keep their digits.
            let position = object + direction * ((-100.0 - object.z) / direction.z);
            if let Ok(out) = system.trace(TracedRay { position, direction }, &n, TraceDirection::ToFilm, Apertures::Clip) {
                landed.push((out.position + out.direction * ((system.film_z - out.position.z) / out.direction.z)).truncate());
            }
        }
        let count = landed.len() as f64;
        let mean = landed.iter().sum::<DVec2>() / count;
        let rms_um = 1e3 * (landed.iter().map(|p| (*p - mean).length_squared()).sum::<f64>() / count).sqrt();
        // Off the axis the solid angle of a part of the pupil differs by some percent from its area.
        assert!(count > 1000.0 && (found.rms_um / rms_um - 1.0).abs() < 0.05, "{at}: {found:?} {rms_um}");
    }
    // Wide open and focused, what is left is the lens's, but for pixels of 2 µm (0.82 µm rms).
    let (_, causes) = found(&scene, &camera, shutter, false);
    let [lens, pixel] = ["aberrations", "pixel aperture"].map(|name| fraction(&causes, name));
    assert!(lens > 0.7 && pixel < 0.3 && (0.9..1.1).contains(&(lens + pixel)), "{causes:?}");
}
