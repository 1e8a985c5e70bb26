use super::*;
use crate::camera::{Film, look_at};
use crate::shutter::{Direction, Mechanism};
use diopter_image::channels::{CHANNELS, Merge, PixelType};
use diopter_image::focal_plane::{Band, BandUnit};
use diopter_image::{ExposureFacts, FocalPlane, Raster};
use diopter_lens::compound::Setting;
use diopter_lens::{CompoundLens, Focus, Iris, Lens, ThinLens};
use diopter_light::units::Millimeters;
use diopter_scene::material::{Material, Scattering};
use diopter_scene::motion::{AnimatedProperty, Animation, AnimationPlayback, Channel as Keys, KeyInterpolation, Motion, Node};
use diopter_scene::shape::{Mesh, Quad};
use diopter_scene::texture::Color;
use diopter_scene::{Object, Shape};
use glam::{Affine3A, Vec2, Vec3};

const COLUMNS: usize = 72;
const ROWS: usize = 48;
/// Film distance of a thin lens of 50 mm focused at 5 m, in pixels of 0.5 mm.
const SCALE: f64 = 50.0 * 5000.0 / 4950.0 / 0.5;
/// Half a side of the square, m, and its depth.
const HALF: f32 = 4.0;
const DEPTH: f64 = 5.0;

#[test]
fn every_channel_has_a_function_of_its_numbers() {
    for channel in &CHANNELS {
        let (numbers, merge) = match fill(channel.id) {
            Fill::Float(_) => (PixelType::Float, Merge::Nearest),
            Fill::Whole(_) => (PixelType::Whole, Merge::Nearest),
            Fill::Mean(_) => (PixelType::Float, Merge::Mean),
            Fill::Later => (PixelType::Float, Merge::Light),
            Fill::Ranks(_) => (PixelType::Float, Merge::Ranks),
        };
        assert_eq!((numbers, merge), (channel.numbers, channel.merge), "{}", channel.name);
    }
}

fn white(name: &str) -> Material {
    Material::new(name, Scattering::Diffuse(Color::rgb(0.5, 0.5, 0.5)))
}

/// A square before the camera that a node carries at a speed (m/s), with texture coordinates from its lower left corner.
fn carried(speed: Vec3) -> Scene {
    let corner = |x: f32, y: f32| Vec3::new(x * HALF, y * HALF, -DEPTH as f32);
    let mesh = Mesh {
        positions: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        uvs: [vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y], Vec::new()],
        ..Default::default()
    };
    let shape = Shape::Mesh { mesh: 0, world_from_mesh: Affine3A::IDENTITY };
    let object = Object { motion: Motion::Carried { node: 0 }, ..Object::new("square", shape, 0) };
    let keys = Keys {
        node: 0,
        property: AnimatedProperty::Translation,
        interpolation: KeyInterpolation::Linear,
        times_s: vec![0.0, 10.0],
        values: [Vec3::ZERO, speed * 10.0].iter().flat_map(|v| v.to_array()).collect(),
    };
    Scene::build(Description {
        meshes: vec![mesh.into()],
        materials: vec![white("paper")],
        objects: vec![object],
        nodes: vec![Node::new("node")],
        animations: vec![Animation { name: "go".into(), channels: vec![keys] }],
        playing: AnimationPlayback { animations: vec![0], ..Default::default() },
        ..Default::default()
    })
    .unwrap()
}

fn thin(f_number: f64) -> Lens {
    let focus = Focus::Distance(Millimeters(1e3 * DEPTH));
    Lens::Thin(ThinLens::new(Millimeters(50.0), f_number, Iris::Round, focus).unwrap())
}

fn camera(lens: Lens) -> Camera {
    Camera { lens, film: Film::new(36.0, 24.0, COLUMNS, ROWS), motion: CameraMotion::still(Affine3A::IDENTITY) }
}

fn asking(names: &str) -> Settings {
    let channels = Channel::list(names).unwrap();
    Settings { truth_channels: Recorded::new(&channels).more().to_vec(), ..Settings::new(16) }
}

fn rolling(readout_s: f64) -> Shutter {
    Shutter { mechanism: Mechanism::Rolling { reset_s: readout_s, readout_s, direction: Direction::Down }, exposure_s: 2e-3 }
}

fn recorded_by(scene: &Scene, camera: &Camera, shutter: &Shutter, settings: &Settings) -> Truth {
    Recorder::new(scene, camera, shutter, settings).rows(0..ROWS, &AtomicBool::new(false)).unwrap()
}

fn pixel<const N: usize>(truth: &Truth, name: &str, [x, y]: [usize; 2]) -> [f64; N] {
    let values = truth.float(name).unwrap().pixel(x, y);
    std::array::from_fn(|k| f64::from(values[k]))
}

const PLACES: [[usize; 2]; 4] = [[36, 24], [5, 4], [66, 9], [20, 43]];

#[test]
fn a_plane_has_the_geometry_of_the_pinhole_formula() {
    let (scene, camera) = (carried(Vec3::ZERO), camera(thin(8.0)));
    let truth = recorded_by(&scene, &camera, &Shutter::global(0.01), &asking("position,distance,uv,incidence,coverage"));
    for at in PLACES {
        let slope = DVec2::new(at[0] as f64 + 0.5 - 36.0, 24.0 - at[1] as f64 - 0.5) / SCALE;
        let oblique = slope.extend(1.0).length();
        let near = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-5, "{at:?}: {found} {expected}");
        let [x, y, z] = pixel(&truth, "position", at);
        near(x, DEPTH * slope.x);
        near(y, DEPTH * slope.y);
        near(z, -DEPTH);
        near(pixel::<1>(&truth, "depth", at)[0], DEPTH);
        near(pixel::<1>(&truth, "distance", at)[0], DEPTH * oblique);
        near(pixel::<1>(&truth, "incidence", at)[0], (1.0 / oblique).acos());
        let [u, v] = pixel(&truth, "uv", at);
        near(u, 0.5 + 0.5 * x / f64::from(HALF));
        near(v, 0.5 + 0.5 * y / f64::from(HALF));
        near(pixel::<1>(&truth, "coverage", at)[0], 1.0);
    }
}

#[test]
fn flow_of_a_translating_plane_is_that_of_the_formula() {
    let step_s = 0.05;
    let speed = Vec3::new(2.0, -1.5, 0.8);
    // The camera, too, goes up.
    let lifted = |y: f32| CameraMotion::still(Affine3A::from_translation(Vec3::new(0.0, y, 0.0)));
    let mut settings = asking("position,flow,backward-flow,motion");
    settings.frames = Some(Arc::new(Frames { at_s: 1.0, step_s, next: lifted(0.1), previous: lifted(-0.1) }));
    let (mut scene, camera) = (carried(speed), camera(thin(8.0)));
    for readout_s in [0.0, 0.02] {
        let shutter = rolling(readout_s);
        scene.pose(1.0, shutter.total_s());
        let truth = recorded_by(&scene, &camera, &shutter, &settings);
        for at in PLACES {
            let p = DVec3::from_array(pixel(&truth, "position", at));
            let motion = DVec3::from_array(pixel(&truth, "motion", at));
            assert!((motion - speed.as_dvec3() * step_s).length() < 1e-5, "{motion}");
            for (name, sign) in [("flow", 1.0), ("backward-flow", -1.0)] {
                let from = DVec2::new(at[0] as f64 + 0.5, at[1] as f64 + 0.5);
                // The moment by the row, the row by the moment; past the edge, that of the edge.
                let mut to = from;
                for _ in 0..60 {
                    let rows = to.y.clamp(0.5, ROWS as f64 - 0.5) - from.y;
                    let time = sign * step_s + rows * readout_s / ROWS as f64;
                    let seen = p + speed.as_dvec3() * time - DVec3::Y * 0.1 * sign;
                    to = DVec2::new(36.0, 24.0) + DVec2::new(seen.x, -seen.y) / -seen.z * SCALE;
                }
                let found = DVec2::from_array(pixel(&truth, name, at));
                // Single precision of metres is 1e-5 px; turns end at 1e-3 px.
                assert!((found - (to - from)).length() < 2e-3, "{name} {readout_s} {at:?}: {found} {}", to - from);
                assert!(found.length() > 0.5, "{found}");
            }
        }
    }
}

#[test]
fn depth_through_a_real_lens_counts_from_the_entrance_pupil() {
    // Of the double Gauss the pupil lies tens of millimetres behind the front glass, where rays begin.
    let focus = Focus::Distance(Millimeters(1e3 * DEPTH));
    let setting = Setting { focal_length: None, f_number: Some(4.0), focus, iris: None, film_mm: [36.0, 24.0] };
    let prescription = Arc::new(diopter_lens::embedded("double-gauss-50mm").unwrap());
    let lens = CompoundLens::new(prescription, &setting).unwrap();
    let camera = camera(Lens::Compound(Box::new(lens)));
    let truth = recorded_by(&carried(Vec3::ZERO), &camera, &Shutter::global(0.01), &asking("position,distance"));
    for at in PLACES {
        let [x, y, z] = pixel(&truth, "position", at);
        let [depth] = pixel(&truth, "depth", at);
        assert!((depth - DEPTH).abs() < 1e-4 && (z + DEPTH).abs() < 1e-4, "{at:?}: {depth} {z}");
        // The pupil moves a little with the angle: less than a millimetre here.
        let [distance] = pixel(&truth, "distance", at);
        let straight = glam::DVec3::new(x, y, z).length();
        assert!((distance - straight).abs() < 1e-3, "{at:?}: {distance} {straight}");
    }
}

#[test]
fn the_next_frame_shows_the_same_place_of_the_texture_where_flow_says() {
    // A zoom that bends straight lines, a turning camera and a rolling shutter; the next frame is posed and looked at as itself.
    let film_mm = [22.3, 14.9];
    let setting = Setting {
        focal_length: Some(18.0),
        f_number: Some(8.0),
        focus: Focus::Distance(Millimeters(1e3 * DEPTH)),
        iris: None,
        film_mm,
    };
    let prescription = Arc::new(diopter_lens::embedded("kit-zoom-18-55mm").unwrap());
    let lens = Lens::Compound(Box::new(CompoundLens::new(prescription, &setting).unwrap()));
    let shutter = rolling(0.03);
    let step_s = 1.0 / 24.0;
    let motion = |at_s: f64| {
        CameraMotion::sampled(shutter.total_s(), |t| {
            let turn = 0.6 * (at_s + t) as f32;
            look_at(Vec3::new(0.3 * turn, 0.0, 0.0), Vec3::new(turn, 0.1 * turn, -DEPTH as f32), Vec3::Y).unwrap()
        })
    };
    let film = Film::new(film_mm[0], film_mm[1], COLUMNS, ROWS);
    let camera = Camera { lens, film, motion: motion(0.1) };
    let mut settings = asking("uv,flow");
    settings.frames = Some(Arc::new(Frames { at_s: 0.1, step_s, next: motion(0.1 + step_s), previous: motion(0.1 - step_s) }));
    let mut scene = carried(Vec3::new(-1.0, 0.7, 0.5));
    scene.pose(0.1, shutter.total_s());
    let truth = recorded_by(&scene, &camera, &shutter, &settings);
    scene.pose(0.1 + step_s, shutter.total_s());
    let next = Camera { motion: motion(0.1 + step_s), ..camera.clone() };
    let looking = Recorder::new(&scene, &next, &shutter, &settings);
    let (mut compared, mut worst) = (0, 0.0f64);
    for at in (0..COLUMNS * ROWS).step_by(37).map(|i| [i % COLUMNS, i / COLUMNS]) {
        let flow = DVec2::from_array(pixel(&truth, "flow", at));
        let there = DVec2::new(at[0] as f64 + 0.5, at[1] as f64 + 0.5) + flow;
        let inside = there.cmpgt(DVec2::ONE).all() && there.cmplt(DVec2::new(COLUMNS as f64, ROWS as f64) - 1.0).all();
        if !inside || truth.id().pixel(at[0], at[1])[0] == 0 {
            continue;
        }
        let ray = looking.ray_of(there, looking.time_at(there)).unwrap();
        let seen = scene.first_visible(&ray).unwrap().uv[0].as_dvec2();
        // 8 m of texture; a pixel is 5 m · 0.31 mm / 18 mm = 86 mm.
        let off = (seen - DVec2::from_array(pixel(&truth, "uv", at))) * 8.0 / 0.086;
        worst = worst.max(off.length());
        compared += 1;
    }
    // Steps of the camera's way (20 µm and 1e-5 rad) and of what is carried (1e-4 of its size) are far below a hundredth of a pixel.
    assert!(compared > 40 && worst < 0.02, "{compared} pixels, {worst} px");
}

#[test]
fn the_sky_moves_by_the_turns_of_the_camera() {
    let scene = Scene::build(Description {
        objects: vec![Object::new("behind", Shape::Quad(Quad { corner: Vec3::Z, edges: [Vec3::X, Vec3::Y] }), 0)],
        materials: vec![white("paper")],
        ..Default::default()
    })
    .unwrap();
    // To the left, and on: what is far away moves to the right.
    let turned = CameraMotion::still(look_at(Vec3::X, Vec3::X + Vec3::new(-0.02, 0.0, -1.0), Vec3::Y).unwrap());
    let mut settings = asking("flow,motion,position");
    let frames = Frames { at_s: 0.0, step_s: 0.04, next: turned, previous: CameraMotion::still(Affine3A::IDENTITY) };
    settings.frames = Some(Arc::new(frames));
    let truth = recorded_by(&scene, &camera(thin(8.0)), &Shutter::global(0.01), &settings);
    let at = [36, 24];
    let slope = 0.5 / SCALE;
    let expected = ((slope.atan() + 0.02f64.atan()).tan() - slope) * SCALE;
    let [u, v] = pixel(&truth, "flow", at);
    // A row below the middle: the slope of its own direction changes v to second order.
    assert!((u - expected).abs() < 1e-3 && v.abs() < 1e-3, "{u} {v} {expected}");
    assert!(pixel::<3>(&truth, "motion", at)[0].is_nan() && pixel::<3>(&truth, "position", at)[0].is_nan());
}

#[test]
fn coverage_adds_up_and_parts_merge_to_the_whole() {
    // Two sheets before a wide pupil: a blurred edge between them, and sky above.
    let sheet = |name: &str, x: f32, material: u32| {
        let quad = Quad { corner: Vec3::new(x, -3.0, -2.0), edges: [Vec3::X * 3.0, Vec3::Y * 3.3] };
        Object::new(name, Shape::Quad(quad), material)
    };
    let scene = Scene::build(Description {
        objects: vec![Object { class: Some("wall".into()), ..sheet("left", -3.0, 0) }, sheet("", 0.0, 1)],
        materials: vec![white("paper"), white("card")],
        ..Default::default()
    })
    .unwrap();
    let camera = camera(thin(1.4));
    let plane = |samples: Range<u32>| {
        let settings =
            Settings { samples: samples.clone(), ..asking("coverage,crypto-object,crypto-material,crypto-class,class") };
        let truth = recorded_by(&scene, &camera, &Shutter::global(0.01), &settings);
        assert_eq!(truth.recorded().samples, samples.len() as u32);
        FocalPlane {
            bands: vec![Band { name: "Y".into(), unit: BandUnit::Electrons }],
            mean: Raster::new(COLUMNS, ROWS, 1),
            half_difference: Raster::new(COLUMNS, ROWS, 1),
            truth,
            facts: ExposureFacts { first_sample: samples.start, samples: samples.len() as u32, ..Default::default() },
        }
    };
    let whole = plane(0..16);
    let merged = FocalPlane::merge(&[plane(5..16), plane(0..5)]).unwrap();
    assert_eq!(whole.truth.recorded(), merged.truth.recorded());
    let (left, unnamed) = (cryptomatte::identifier("left"), cryptomatte::identifier("object-1"));
    let mut mixed = 0;
    for at in (0..COLUMNS * ROWS).map(|i| [i % COLUMNS, i / COLUMNS]) {
        let [coverage] = pixel(&whole.truth, "coverage", at);
        for name in ["crypto-object", "crypto-material", "crypto-class"] {
            let [a, b] = [&whole, &merged].map(|p| p.truth.float(name).unwrap().pixel(at[0], at[1]));
            let total: f32 = a.iter().skip(1).step_by(2).sum();
            assert!((f64::from(total) - coverage).abs() < 1e-6, "{at:?}: {total} {coverage}");
            assert!(a[1] >= a[3] && a[5] == 0.0, "{at:?}: {a:?}");
            let of = |ranks: &[f32], id: f32| ranks.as_chunks::<2>().0.iter().find(|r| r[0] == id).map_or(0.0, |r| r[1]);
            for id in [a[0], a[2]] {
                assert!((of(a, id) - of(b, id)).abs() < 1e-6, "{at:?}: {a:?} {b:?}");
            }
        }
        let objects = whole.truth.float("crypto-object").unwrap().pixel(at[0], at[1]);
        assert!([objects[0], objects[2]].iter().all(|id| [0.0, left, unnamed].contains(id)));
        mixed += usize::from(objects[3] > 0.0);
    }
    let [sure] = pixel::<1>(&whole.truth, "coverage", [3, 40]);
    let [sky] = pixel::<1>(&whole.truth, "coverage", [3, 0]);
    assert!(mixed > 10 && sure == 1.0 && sky == 0.0, "{mixed} {sure} {sky}");
    let layers: Vec<&str> = whole.truth.recorded().manifests.iter().map(|m| m.layer.as_str()).collect();
    assert_eq!(layers, ["CryptoClass", "CryptoMaterial", "CryptoObject"]);
    assert_eq!(whole.truth.recorded().manifests[2].names, ["left", "object-1"]);
    assert_eq!(*whole.truth.recorded().classes, ["unclassified", "wall"]);
    // Left of the middle the wall, right of it what has no class, above them nothing.
    let Some(Values::Whole(class)) = whole.truth.values("class") else { panic!("whole numbers") };
    assert_eq!([[3, 40], [70, 40], [3, 0]].map(|[x, y]| class.pixel(x, y)[0]), [2, 1, 0]);
    let matte = whole.truth.float("crypto-class").unwrap();
    assert_eq!(matte.pixel(3, 40)[..2], [cryptomatte::identifier("wall"), 1.0]);
}
