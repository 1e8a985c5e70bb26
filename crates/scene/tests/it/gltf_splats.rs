//! Gaussian splats in glTF (KHR_gaussian_splatting) and their compression by SPZ.

use base64::Engine;
use diopter_scene::load::gltf;
use diopter_scene::shape::Splats;
use diopter_scene::{Description, Scene, Shape};
use glam::{Affine3A, Quat, Vec3};
use serde_json::{Value, json};
use std::io::Write;

/// Constants of the harmonics of degree 0 and 1.
const Y0: f32 = 0.282_094_8;
const Y1: f32 = 0.488_602_5;

const CENTERS: [f32; 6] = [0.0, 0.0, 0.0, 3.0, 1.0, 0.0];
const SCALES: [f32; 6] = [0.5, 0.1, 0.2, 0.2, 0.2, 0.2];
const COLOR: [f32; 6] = [0.2, 0.4, -0.3, 1.0, 0.0, 0.0];

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn load(json: &Value) -> Result<Description, String> {
    gltf::load(json.to_string().as_bytes(), "t.gltf", &|_| Err("no files here".into())).map_err(|e| e.to_string())
}

/// Two Gaussians, the first turned by 90° about z; rotations in 16 bits, opacities (1 and 0.6) in 8, all other attributes numbers.
fn file(scales: &[f32], properties: Value) -> Value {
    let half = (std::f32::consts::FRAC_1_SQRT_2 * 32767.0).round() as i16;
    let rotations: Vec<u8> = [0, 0, half, half, 0, 0, 0, 32767].iter().flat_map(|v: &i16| v.to_le_bytes()).collect();
    let degree1 = [0.0, 0.0, 0.0, 0.1, 0.2, 0.3];
    let parts: [(&str, u32, Vec<u8>); 8] = [
        ("VEC3", 5126, floats(&CENTERS)),
        ("VEC4", 5122, rotations),
        ("VEC3", 5126, floats(scales)),
        ("SCALAR", 5121, vec![255, 153]),
        ("VEC3", 5126, floats(&COLOR)),
        ("VEC3", 5126, floats(&[0.0; 6])),
        ("VEC3", 5126, floats(&degree1)),
        ("VEC3", 5126, floats(&[0.0; 6])),
    ];
    let (mut bytes, mut views, mut accessors) = (Vec::new(), Vec::new(), Vec::new());
    for (i, (kind, component, data)) in parts.iter().enumerate() {
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        views.push(json!({"buffer": 0, "byteOffset": bytes.len(), "byteLength": data.len()}));
        let normalized = *component != 5126;
        let mut accessor =
            json!({"bufferView": i, "componentType": component, "count": 2, "type": kind, "normalized": normalized});
        if i == 0 {
            (accessor["min"], accessor["max"]) = (json!([0, 0, 0]), json!([3, 1, 0]));
        }
        accessors.push(accessor);
        bytes.extend(data);
    }
    let uri = format!("data:application/octet-stream;base64,{}", base64::engine::general_purpose::STANDARD.encode(&bytes));
    json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "extensionsUsed": ["KHR_gaussian_splatting"], "extensionsRequired": ["KHR_gaussian_splatting"],
        "nodes": [{"mesh": 0, "translation": [0, 2, 0], "rotation": [0, 1, 0, 0], "scale": [2, 2, 2]}],
        "meshes": [{"primitives": [{
            "mode": 0,
            "attributes": {
                "POSITION": 0,
                "KHR_gaussian_splatting:ROTATION": 1, "KHR_gaussian_splatting:SCALE": 2, "KHR_gaussian_splatting:OPACITY": 3,
                "KHR_gaussian_splatting:SH_DEGREE_0_COEF_0": 4, "KHR_gaussian_splatting:SH_DEGREE_1_COEF_0": 5,
                "KHR_gaussian_splatting:SH_DEGREE_1_COEF_1": 6, "KHR_gaussian_splatting:SH_DEGREE_1_COEF_2": 7,
            },
            "extensions": {"KHR_gaussian_splatting": properties},
        }]}],
        "buffers": [{"byteLength": bytes.len(), "uri": uri}], "bufferViews": views, "accessors": accessors,
    })
}

fn plain(color_space: &str) -> Value {
    json!({"kernel": "ellipse", "colorSpace": color_space, "projection": "perspective", "sortingMethod": "cameraDistance"})
}

fn splats(description: &Description) -> (&Splats, Affine3A) {
    let Shape::Splats { splats, world_from_splats } = description.objects[0].shape else { panic!("no splats") };
    (&description.splats[splats as usize], world_from_splats)
}

/// The number of the Gaussian around a place: sets are put in order.
fn at(splats: &Splats, place: Vec3) -> u32 {
    (0..splats.len() as u32)
        .find(|i| splats.intersect(*i, place + Vec3::Z * 9.0, Vec3::NEG_Z, 99.0).is_some_and(|h| h.alpha > 0.5))
        .unwrap()
}

#[test]
fn attributes_become_splats_where_their_node_stands() {
    let description = load(&file(&SCALES, plain("srgb_rec709_display"))).unwrap();
    assert!(description.warnings.is_empty(), "{:?}", description.warnings);
    let (splats, place) = splats(&description);
    let expected =
        Affine3A::from_scale_rotation_translation(Vec3::splat(2.0), Quat::from_xyzw(0.0, 1.0, 0.0, 0.0), Vec3::Y * 2.0);
    assert!(place.abs_diff_eq(expected, 1e-6));
    let first = at(splats, Vec3::ZERO);
    // Turned by 90° about z: half a metre along y, a tenth along x.
    let alpha = |p: Vec3| splats.intersect(first, p + Vec3::Z * 5.0, Vec3::NEG_Z, 99.0).map_or(0.0, |h| h.alpha);
    assert!((alpha(Vec3::ZERO) - 0.99).abs() < 1e-4, "α is 0.99 at most");
    assert!((alpha(Vec3::Y * 0.5) - (-0.5f32).exp()).abs() < 1e-3, "{}", alpha(Vec3::Y * 0.5));
    assert!((alpha(Vec3::X * 0.1) - (-0.5f32).exp()).abs() < 1e-3, "{}", alpha(Vec3::X * 0.1));
    let second = at(splats, Vec3::new(3.0, 1.0, 0.0));
    let hit = splats.intersect(second, Vec3::new(3.0, 1.0, 5.0), Vec3::NEG_Z, 99.0).unwrap();
    assert!((hit.alpha - 153.0 / 255.0).abs() < 1e-4 && (hit.t - 5.0).abs() < 1e-4);
    // Degree 1, order 0 goes with z; display values of the curve of sRGB.
    let display = Vec3::new(0.5 + Y0 - 0.1 * Y1, 0.5 - 0.2 * Y1, 0.5 - 0.3 * Y1);
    let color = splats.color(second, Vec3::NEG_Z);
    assert!((color - display.map(diopter_light::color::srgb_decode)).abs().max_element() < 1e-3, "{color}");
    // The whole can be built, and seen.
    Scene::build(description).unwrap();
}

#[test]
fn linear_colors_and_logarithms_of_scales_are_told_apart() {
    let description = load(&file(&SCALES, plain("lin_rec709_display"))).unwrap();
    let (linear, _) = splats(&description);
    let color = linear.color(at(linear, Vec3::ZERO), Vec3::X);
    assert!((color - (Vec3::new(0.2, 0.4, -0.3) * Y0 + 0.5)).abs().max_element() < 1e-3, "{color}");
    let draft = load(&file(&SCALES.map(f32::ln), plain("srgb_rec709_display"))).unwrap();
    assert!(draft.warnings.iter().any(|w| w.contains("logarithms")), "{:?}", draft.warnings);
    let same = |d: &Description| splats(d).0.bounds();
    let (a, b) = (same(&draft), same(&description));
    assert!((a.min - b.min).abs().max_element() < 1e-5 && (a.max - b.max).abs().max_element() < 1e-5);
}

#[test]
fn what_is_unknown_or_missing_is_refused() {
    let good = || file(&SCALES, plain("srgb_rec709_display"));
    let primitive = "/meshes/0/primitives/0";
    let extension = "/meshes/0/primitives/0/extensions/KHR_gaussian_splatting";
    type Change = Box<dyn Fn(&mut Value)>;
    let set = |place: String, key: &'static str, value: Value| -> Change {
        Box::new(move |j| j.pointer_mut(&place).unwrap()[key] = value.clone())
    };
    let cases: Vec<(Change, &str)> = vec![
        (set(extension.into(), "kernel", json!("square")), "kernel \"square\""),
        (set(extension.into(), "kernel", json!(7)), "kernel \"7\""),
        (set(extension.into(), "projection", json!("fisheye")), "projection \"fisheye\""),
        (set(extension.into(), "colorSpace", json!("ACEScg")), "colorSpace \"ACEScg\""),
        (set(extension.into(), "extensions", json!({"EXT_other": {}})), "extension EXT_other"),
        (set(primitive.into(), "mode", json!(4)), "expected points"),
        (set(format!("{primitive}/attributes"), "KHR_gaussian_splatting:SCALE", json!(99)), "accessor 99"),
        (set(format!("{primitive}/attributes"), "KHR_gaussian_splatting:SCALE", json!(3)), "expected Vec3"),
        (set(format!("{primitive}/attributes"), "KHR_gaussian_splatting:SCALE", json!("x")), "no KHR_gaussian_splatting:SCALE"),
        (set("/accessors/4".into(), "count", json!(1)), "1 of 2 positions"),
        (set("/accessors/4".into(), "componentType", json!(5125)), "U32"),
        (
            Box::new(|j| {
                let attributes = j.pointer_mut("/meshes/0/primitives/0/attributes").unwrap().as_object_mut().unwrap();
                attributes.remove("KHR_gaussian_splatting:SH_DEGREE_1_COEF_1");
            }),
            "SH_DEGREE_1_COEF_1",
        ),
    ];
    for (change, expected) in cases {
        let mut json = good();
        change(&mut json);
        let error = load(&json).expect_err(expected);
        assert!(error.contains(expected), "{expected}: {error}");
    }
    load(&good()).unwrap();
}

#[test]
fn spz_within_gltf_is_what_spz_is() {
    // Three Gaussians, version 2, no harmonics beyond the colour: header, positions (24 bits, 12 of them a fraction), alphas, colours, scales, rotations.
    let mut packed = [0x5053_474e_u32, 2, 3].iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    packed.extend([0, 12, 0, 0]);
    for v in [0, 0, 0, 4096, 0, 0, 0, 8192, -4096i32] {
        packed.extend(&v.to_le_bytes()[..3]);
    }
    packed.extend([255, 200, 100]);
    packed.extend([10, 20, 30, 120, 130, 140, 220, 230, 240]);
    packed.extend([120; 9]);
    packed.extend([128; 9]);
    let mut zip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    zip.write_all(&packed).unwrap();
    let zipped = zip.finish().unwrap();
    let uri = format!("data:application/octet-stream;base64,{}", base64::engine::general_purpose::STANDARD.encode(&zipped));
    let json = |view: usize, length: usize| {
        json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "extensionsRequired": ["KHR_gaussian_splatting", "KHR_gaussian_splatting_compression_spz_2"],
            "extensionsUsed": ["KHR_gaussian_splatting", "KHR_gaussian_splatting_compression_spz_2"],
            "meshes": [{"primitives": [{
                "mode": 0, "attributes": {"POSITION": 0, "KHR_gaussian_splatting:OPACITY": 1},
                "extensions": {"KHR_gaussian_splatting": {"kernel": "ellipse", "colorSpace": "srgb_rec709_display",
                    "extensions": {"KHR_gaussian_splatting_compression_spz_2": {"bufferView": view}}}},
            }]}],
            "accessors": [
                {"componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, -1], "max": [1, 2, 0]},
                {"componentType": 5126, "count": 3, "type": "SCALAR"},
            ],
            "buffers": [{"byteLength": zipped.len(), "uri": uri}], "bufferViews": [{"buffer": 0, "byteLength": length}],
        })
    };
    let inside = load(&json(0, zipped.len())).unwrap();
    let alone = diopter_scene::load::splats::spz(zipped.clone(), "t.spz").unwrap();
    let ((a, _), (b, _)) = (splats(&inside), splats(&alone));
    assert_eq!((a.len(), b.len()), (3, 3));
    for i in 0..3 {
        assert_eq!(a.color(i, Vec3::X), b.color(i, Vec3::X));
        let (p, d) = (Vec3::new(0.1, 0.2, 5.0), Vec3::NEG_Z);
        assert_eq!(a.intersect(i, p, d, 99.0), b.intersect(i, p, d, 99.0));
    }
    assert!(load(&json(4, zipped.len())).unwrap_err().contains("bufferView 4"));
    assert!(load(&json(0, zipped.len() / 2)).unwrap_err().contains("Gaussian splats"));
}

#[test]
fn damaged_files_never_panic() {
    let whole = file(&SCALES, plain("srgb_rec709_display")).to_string().into_bytes();
    for i in (0..whole.len()).step_by(2) {
        for change in *b"9\"-," {
            let mut bytes = whole.clone();
            bytes[i] = change;
            let _ = gltf::load(&bytes, "t.gltf", &|_| Err("no files here".into())).map(Scene::build);
        }
    }
}
