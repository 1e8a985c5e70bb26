use super::pictures::uv_transform;
use super::*;

fn none(_: &str) -> Result<Vec<u8>, String> {
    Err("no files here".into())
}

/// A triangle in a data URI, with parts of the JSON replaced.
fn triangle(replace: &[(&str, &str)]) -> String {
    use base64::Engine;
    let mut bytes: Vec<u8> = [0f32, 0., 0., 1., 0., 0., 0., 1., 0.].iter().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend([0u16, 1, 2].iter().flat_map(|v| v.to_le_bytes()));
    let data = base64::engine::general_purpose::STANDARD.encode(&bytes);
    let json = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],
        "buffers":[{"byteLength":42,"uri":"data:application/octet-stream;base64,DATA"}],
        "bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":6}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]},
                     {"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}]}"#;
    let mut json = json.replace("DATA", &data);
    for (from, to) in replace {
        assert!(json.contains(from), "{from}");
        json = json.replacen(from, to, 1);
    }
    json
}

fn message(replace: &[(&str, &str)]) -> String {
    load(triangle(replace).as_bytes(), "t.gltf", &none).map(|d| d.warnings.join("; ")).unwrap_err().to_string()
}

#[test]
fn a_triangle_is_read() {
    let d = load(triangle(&[]).as_bytes(), "t.gltf", &none).unwrap();
    assert_eq!(d.meshes[0].triangles, vec![[0, 1, 2]]);
    assert_eq!(d.meshes[0].positions[1], Vec3::X);
}

#[test]
fn containers_shorter_than_their_header_are_errors() {
    for length in [0u32, 11] {
        let bytes = [b"glTF", &2u32.to_le_bytes()[..], &length.to_le_bytes(), &[0; 20]].concat();
        let e = load(&bytes, "t.glb", &none).unwrap_err().to_string();
        assert!(e.contains(&format!("a length of {length} bytes")), "{e}");
    }
}

#[test]
fn positions_need_no_bounds() {
    let d = load(triangle(&[(",\"min\":[0,0,0],\"max\":[1,1,0]", "")]).as_bytes(), "t.gltf", &none).unwrap();
    assert_eq!((d.meshes[0].triangles.len(), d.meshes[0].positions[2]), (1, Vec3::Y));
    // Positions that are no accessor of the file are told as before.
    assert!(message(&[("\"POSITION\":0", "\"POSITION\":9")]).contains("out of range"));
}

#[test]
fn bad_files_are_told_where_and_what() {
    let cases: &[(&[(&str, &str)], &str)] = &[
        (&[("\"asset\"", "\"extensionsRequired\":[\"KHR_xmp\"],\"asset\"")], "KHR_xmp is not supported"),
        (&[("\"nodes\":[{\"mesh\":0}]", "\"nodes\":[{\"mesh\":0,\"children\":[1]},{\"children\":[0]}]")], "reached twice"),
        (&[("\"byteLength\":42", "\"byteLength\":4200")], "cut short"),
        (&[("\"count\":3,\"type\":\"SCALAR\"", "\"count\":30,\"type\":\"SCALAR\"")], "accessor 1"),
        (&[("\"mesh\":0", "\"mesh\":7")], "out of range"),
        (&[("\"componentType\":5123", "\"componentType\":5126")], "of another type"),
        (&[("\"type\":\"VEC3\"", "\"type\":\"VEC2\"")], "of another type"),
        (&[("\"asset\"", "\"images\":[{\"name\":\"x\"}],\"asset\"")], "image 0"),
        (&[("\"asset\"", "\"cameras\":[{\"type\":\"perspective\"}],\"asset\"")], "camera"),
        (&[("data:application/octet-stream;base64,", "../secret.bin?")], "leads out of the scene's folder"),
        (&[("data:application/octet-stream;base64,", "there.bin?")], "no files here"),
    ];
    for (replace, expected) in cases {
        let text = message(replace);
        assert!(text.contains(expected) && text.starts_with("t.gltf: "), "{text}");
    }
    let index = triangle(&[]);
    assert!(load(&index.as_bytes()[..index.len() / 2], "t.gltf", &none).is_err());
    assert!(load(b"glTF\x02\0\0\0\xff\0\0\0", "t.glb", &none).unwrap_err().to_string().contains("cut short"));
    assert!(load(b"", "t.glb", &none).is_err());
}

#[test]
fn a_missing_texture_is_a_warning_and_magenta_stands_in_for_it() {
    let text = triangle(&[
        ("\"indices\":1", "\"indices\":1,\"material\":0"),
        (
            "\"asset\"",
            r#""images":[{"uri":"a%20b.png"},{"uri":"../c.png"},{"uri":"data:;base64,AAAA","name":"d"}],
            "textures":[{"source":0},{"source":1},{"source":2}],
            "materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0},"metallicRoughnessTexture":{"index":1}},
                          "normalTexture":{"index":2}}],"asset""#,
        ),
    ]);
    let d = load(text.as_bytes(), "t.gltf", &none).unwrap();
    let [without, warning] = &d.warnings[..] else { panic!("{:?}", d.warnings) };
    assert!(without.contains("1 mesh without the texture coordinates"), "{without}");
    for part in ["3 textures", "a b.png (no files here)", "../c.png (it leads out", "image 2 \"d\" (it is none of", "magenta"] {
        assert!(warning.contains(part), "{part}: {warning}");
    }
    let names: Vec<&str> = d.missing_textures.iter().map(|m| m.name.as_str()).collect();
    assert_eq!(names, ["a b.png", "../c.png", "image 2 \"d\""]);
    let Scattering::Principled(p) = &d.materials[0].scattering else { panic!("a material of glTF") };
    let Color::Textured { texture, .. } = &p.base_color else { panic!("a picture") };
    assert!((texture.at(&[Vec2::splat(0.4); 2]) - crate::load::STAND_IN.extend(1.0)).length() < 1e-5);
    // Maps of numbers are left out.
    assert!(matches!((&p.roughness, &p.metallic), (Scalar::Constant(_), Scalar::Constant(_))));
    assert!(d.materials[0].normal_map.is_none());
}

#[test]
fn a_scene_without_a_surface_is_an_error() {
    for replace in [
        ("\"nodes\":[{\"mesh\":0}]", "\"nodes\":[{\"name\":\"empty\"}]"),
        ("\"scenes\":[{\"nodes\":[0]}]", "\"scenes\":[{\"nodes\":[]}]"),
        ("\"indices\":1", "\"indices\":1,\"mode\":1"),
    ] {
        let text = message(&[replace]);
        assert!(text.starts_with("t.gltf: no surface") && text.contains("triangles"), "{text}");
    }
}

#[test]
fn lists_of_zeros_are_no_longer_than_the_file_bears() {
    // The positions are zeros but for one; a target of a thousand million corners.
    let sparse = "{\"componentType\":5126,\"count\":N,\"type\":\"VEC3\",\"min\":[0,0,0],\"max\":[1,1,0],\"sparse\":{\"count\":1,\
        \"indices\":{\"bufferView\":1,\"componentType\":5123},\"values\":{\"bufferView\":0}}}";
    let whole = "{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\",\"min\":[0,0,0],\"max\":[1,1,0]}";
    assert!(load(triangle(&[(whole, &sparse.replace('N', "3"))]).as_bytes(), "t.gltf", &none).is_ok());
    let (asset, used) = ("\"asset\"", "\"extensionsUsed\":[\"KHR_mesh_quantization\"],\"asset\"");
    // As numbers of single precision, and as whole numbers that are unpacked first.
    for (count, kind, uses) in [("1000000000", "5126", asset), ("70000", "5126", used), ("70000", "5122", used)] {
        let sparse = sparse.replace('N', count).replace("5126", kind);
        let text = message(&[(whole, &sparse), (asset, uses)]);
        assert!(text.contains("without data"), "{count}: {text}");
    }
}

#[test]
fn an_unknown_optional_extension_is_a_warning() {
    let text = triangle(&[("\"asset\"", "\"extensionsUsed\":[\"KHR_materials_sparkle\"],\"asset\"")]);
    let d = load(text.as_bytes(), "t.gltf", &none).unwrap();
    assert!(d.warnings[0].contains("KHR_materials_sparkle"));
}

#[test]
fn texture_transform_is_offset_rotation_scale() {
    let m = uv_transform(Vec2::new(0.5, 0.0), std::f32::consts::FRAC_PI_2, Vec2::splat(2.0));
    // Counter-clockwise seen with v up, that is (u, v) → (v, −u) with v down.
    assert!((m.transform_point2(Vec2::new(0.0, 1.0)) - Vec2::new(2.5, 0.0)).length() < 1e-6);
}

#[test]
fn damaged_files_never_panic() {
    // Every byte of a small binary file changed in a few ways, and every length.
    let json = triangle(&[]);
    for i in 0..json.len() {
        for change in [b'9', b'"', b'-', 0xff] {
            let mut bytes = json.clone().into_bytes();
            bytes[i] = change;
            let _ = load(&bytes, "t.gltf", &none).map(crate::Scene::build);
        }
    }
}

#[test]
fn lamps_of_ies_files_shine_along_their_nodes() {
    let file = b"IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 2 1 1 2 0 0 0 1 1 1\n0 90\n0\n300 100\n";
    let fetch = |name: &str| if name == "a.ies" { Ok(file.to_vec()) } else { Err("no files here".to_owned()) };
    let text = |number: u32| {
        triangle(&[
            (
                "{\"version\":\"2.0\"}",
                "{\"version\":\"2.0\"},\"extensionsUsed\":[\"EXT_lights_ies\"],\"extensionsRequired\":[\"EXT_lights_ies\"],\"extensions\":{\"EXT_lights_ies\":{\"lights\":[{\"uri\":\"a.ies\"}]}}",
            ),
            // Turned by 90° about x: −z becomes +y.
            (
                "{\"mesh\":0}",
                &format!(
                    "{{\"mesh\":0,\"rotation\":[0.70710678,0,0,0.70710678],\"translation\":[0,0,2],\"extensions\":{{\"EXT_lights_ies\":{{\"light\":{number},\"multiplier\":2,\"color\":[1,0.5,0]}}}}}}"
                ),
            ),
        ])
    };
    let d = load(text(0).as_bytes(), "a.gltf", &fetch).unwrap();
    assert!(d.warnings.is_empty() && d.punctual.len() == 1, "{:?}", d.warnings);
    let scene = crate::Scene::build(d).unwrap();
    let lamp = &scene.lights().punctual[0];
    let wavelengths = diopter_light::SampledWavelengths::rgb();
    let at = |d: Vec3| lamp.power.sample(&wavelengths) * lamp.relative_intensity(None, d, &wavelengths);
    for (direction, cd) in [(Vec3::Y, 600.0), (Vec3::X, 200.0), (Vec3::NEG_Y, 0.0)] {
        let found = at(direction);
        assert!((found.x - cd).abs() < 1.0 && (found.y - 0.5 * cd).abs() < 1.0 && found.z == 0.0, "{direction}: {found}");
    }
    assert!(matches!(lamp.kind, PunctualKind::Point { position } if position.abs_diff_eq(Vec3::Z * 2.0, 1e-6)));
    let error = load(text(1).as_bytes(), "a.gltf", &fetch).unwrap_err().to_string();
    assert!(error.contains("light profile 1") && error.contains("below 1"), "{error}");
    let error = load(text(0).as_bytes(), "a.gltf", &none).unwrap_err().to_string();
    assert!(error.contains("light profile 0") && error.contains("a.ies"), "{error}");
}

#[test]
fn accessors_without_a_view_are_zeros() {
    let text = triangle(&[("{\"bufferView\":0,\"componentType\":5126,\"count\":3", "{\"componentType\":5126,\"count\":3")]);
    let d = load(text.as_bytes(), "t.gltf", &none).unwrap();
    assert_eq!(d.meshes[0].positions, vec![Vec3::ZERO; 3]);
}

#[test]
fn animations_of_what_is_no_node_are_left_out() {
    let animations = "\"extensionsUsed\":[\"KHR_animation_pointer\"],\"animations\":[{\"channels\":[{\"sampler\":0,\"target\":{\"path\":\"pointer\",\
        \"extensions\":{\"KHR_animation_pointer\":{\"pointer\":\"/materials/0/emissiveFactor\"}}}}],\"samplers\":[{\"input\":1,\"output\":0}]}],\"asset\"";
    let d = load(triangle(&[("\"asset\"", animations)]).as_bytes(), "t.gltf", &none).unwrap();
    assert!(d.warnings.join("; ").contains("KHR_animation_pointer"), "{:?}", d.warnings);
}

/// A triangle of a material.
fn with_material(material: &str) -> Description {
    let replace = [
        ("\"indices\":1", "\"indices\":1,\"material\":0"),
        ("\"meshes\"", &format!("\"materials\":[{material}],\"meshes\"") as &str),
    ];
    load(triangle(&replace).as_bytes(), "t.gltf", &none).unwrap()
}

#[test]
fn specular_colors_may_be_above_one_and_an_index_of_zero_reflects_all() {
    let of = |extensions: &str| {
        let d = with_material(&format!("{{\"extensions\":{{{extensions}}}}}"));
        let Scattering::Principled(p) = d.materials[0].scattering.clone() else { panic!("principled") };
        ((p.ior - 1.0) / (p.ior + 1.0)).powi(2) * p.specular_color.constant_rgb().unwrap()
    };
    let specular = |factor: &str| format!("\"KHR_materials_specular\":{{\"specularColorFactor\":{factor}}}");
    for (extensions, expected) in [
        (specular("[1, 0.5, 1]"), Vec3::new(0.04, 0.02, 0.04)),
        (specular("[5, 1, 0]"), Vec3::new(0.2, 0.04, 0.0)),
        (format!("\"KHR_materials_ior\":{{\"ior\":0}},{}", specular("[0.1, 0.5, 0.3]")), Vec3::new(0.1, 0.5, 0.3)),
    ] {
        assert!(of(&extensions).abs_diff_eq(expected, 1e-5), "{extensions}: {}", of(&extensions));
    }
}

#[test]
fn more_than_two_sets_of_texture_coordinates_are_said() {
    let d = with_material(
        "{\"emissiveTexture\":{\"index\":0,\"texCoord\":2}}],\"textures\":[{\"source\":0}],\"images\":[{\"uri\":\"a.png\"}",
    );
    assert!(d.warnings.join("; ").contains("of 3 sets"), "{:?}", d.warnings);
}
