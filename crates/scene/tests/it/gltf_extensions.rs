//! glTF extensions: packed data, copies, variants, dispersion, cloth, grain and films. The packed files were made by Google's Draco (a pyramid), Binomial's Basis
//! Universal encoder and libwebp (gradients).

use base64::Engine;
use diopter_scene::load::gltf;
use diopter_scene::material::Scattering;
use diopter_scene::texture::{Color, Texels};
use diopter_scene::{Description, Scene, Shape};
use glam::Vec3;
use serde_json::{Value, json};

const DRC: &[u8] = include_bytes!("../packed/pyramid.drc");
const KTX: &[u8] = include_bytes!("../packed/etc1s_rgb.ktx2");
const WEBP: &[u8] = include_bytes!("../packed/lossless_rgba.webp");

fn uri(bytes: &[u8]) -> String {
    format!("data:application/octet-stream;base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes))
}

fn load(json: &Value) -> Result<Description, String> {
    gltf::load(json.to_string().as_bytes(), "t.gltf", &|_| Err("no files here".into())).map_err(|e| e.to_string())
}

/// A file with one mesh over one buffer.
fn file(bytes: &[u8], views: Value, accessors: Value, primitive: Value, more: &[(&str, Value)]) -> Value {
    let mut all = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}], "buffers": [{"byteLength": bytes.len(), "uri": uri(bytes)}],
        "bufferViews": views, "accessors": accessors,
    });
    more.iter().for_each(|(key, value)| all[*key] = value.clone());
    all
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn triangle(primitive: Value, more: &[(&str, Value)]) -> Value {
    file(
        &floats(&[0., 0., 0., 1., 0., 0., 0., 1., 0.]),
        json!([{"buffer": 0, "byteLength": 36}]),
        json!([{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}]),
        primitive,
        more,
    )
}

#[test]
fn draco_meshes_are_unpacked() {
    let json = file(
        DRC,
        json!([{"buffer": 0, "byteLength": DRC.len()}]),
        json!([
            {"componentType": 5126, "count": 5, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]},
            {"componentType": 5125, "count": 18, "type": "SCALAR"},
        ]),
        json!({"attributes": {"POSITION": 0}, "indices": 1, "extensions": {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}}),
        &[
            ("extensionsUsed", json!(["KHR_draco_mesh_compression"])),
            ("extensionsRequired", json!(["KHR_draco_mesh_compression"])),
        ],
    );
    let d = load(&json).unwrap();
    let mesh = &d.meshes[0];
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (5, 6));
    // A closed pyramid of a third of a cubic metre, faces outwards.
    let volume: f32 = (0..6).map(|t| mesh.corners(t)).map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum();
    assert!((volume - 1.0 / 3.0).abs() < 1e-3, "{volume}");
    for cut in [10, 50, 90] {
        let mut short = json.clone();
        short["bufferViews"][0]["byteLength"] = json!(cut);
        assert!(load(&short).unwrap_err().contains("Draco"));
    }
    let mut other = json.clone();
    other["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"]["attributes"]["POSITION"] = json!(7);
    assert!(load(&other).unwrap_err().contains("not in the data"));
}

/// At most 16 elements as EXT_meshopt_compression's attributes, nothing saved.
fn meshopt(elements: &[[u8; 12]]) -> Vec<u8> {
    let mut out = vec![0xa0];
    for k in 0..12 {
        // One group of literal differences, wrapped and zigzagged, from the element before (the first from the last bytes of the stream).
        out.push(3);
        let mut before = elements[0][k];
        for i in 0..16 {
            let now = elements.get(i).map_or(before, |e| e[k]);
            let d = now.wrapping_sub(before) as i8;
            out.push(((d << 1) ^ (d >> 7)) as u8);
            before = now;
        }
    }
    out.extend([0; 20]);
    out.extend(elements[0]);
    out
}

#[test]
fn meshopt_views_are_unpacked() {
    let corners = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.5], [0.25, 2.0, -3.0]];
    let elements: Vec<[u8; 12]> = corners.iter().map(|c| floats(c).try_into().unwrap()).collect();
    let packed = meshopt(&elements);
    for name in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        let view = json!([{"buffer": 1, "byteLength": 36, "byteStride": 12, "extensions": {name: {
            "buffer": 0, "byteLength": packed.len(), "byteStride": 12, "count": 3, "mode": "ATTRIBUTES"}}}]);
        let accessor =
            json!([{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, -3], "max": [1, 2, 0.5]}]);
        let mut json =
            file(&packed, view, accessor, json!({"attributes": {"POSITION": 0}}), &[("extensionsUsed", json!([name]))]);
        json["buffers"].as_array_mut().unwrap().push(json!({"byteLength": 36, "extensions": {name: {"fallback": true}}}));
        let d = load(&json).unwrap();
        assert_eq!(d.meshes[0].positions, corners.map(Vec3::from_array));
        json["bufferViews"][0]["extensions"][name]["count"] = json!(1u64 << 40);
        assert!(load(&json).unwrap_err().contains("meshopt"));
        json["bufferViews"][0]["extensions"][name]["count"] = json!(3);
        json["bufferViews"][0]["extensions"][name]["mode"] = json!("SQUEEZED");
        assert!(load(&json).unwrap_err().contains("ATTRIBUTES"));
    }
}

#[test]
fn attributes_of_integers_are_numbers_with_sparse_parts_too() {
    // Signed fractions of 127, four bytes a corner; one corner is replaced.
    let bytes: Vec<u8> =
        [0i8, 0, 0, 0, 127, 0, -127, 0, 0, 64, 0, 0, /* place */ 2, 0, 0, 0, /* value */ 127, 127, 127, 0]
            .map(|v| v as u8)
            .to_vec();
    let views = json!([{"buffer": 0, "byteLength": 12, "byteStride": 4}, {"buffer": 0, "byteOffset": 12, "byteLength": 1}, {"buffer": 0, "byteOffset": 16, "byteLength": 3}]);
    let mut accessor = json!({"bufferView": 0, "componentType": 5120, "normalized": true, "count": 3, "type": "VEC3", "min": [0, 0, -127], "max": [127, 64, 0]});
    let build = |accessor: &Value| {
        file(
            &bytes,
            views.clone(),
            json!([accessor]),
            json!({"attributes": {"POSITION": 0}}),
            &[("extensionsUsed", json!(["KHR_mesh_quantization"])), ("extensionsRequired", json!(["KHR_mesh_quantization"]))],
        )
    };
    let positions = |accessor: &Value| load(&build(accessor)).unwrap().meshes[0].positions.clone();
    assert_eq!(positions(&accessor), [Vec3::ZERO, Vec3::new(1.0, 0.0, -1.0), Vec3::new(0.0, 64.0 / 127.0, 0.0)]);
    accessor["sparse"] = json!({"count": 1, "indices": {"bufferView": 1, "componentType": 5121}, "values": {"bufferView": 2}});
    assert_eq!(positions(&accessor)[2], Vec3::ONE);
    accessor["normalized"] = json!(false);
    assert_eq!(positions(&accessor)[1..], [Vec3::new(127.0, 0.0, -127.0), Vec3::splat(127.0)]);
    accessor["count"] = json!(99);
    assert!(load(&build(&accessor)).is_err());
}

#[test]
fn pictures_of_other_formats_are_read() {
    for (extension, bytes, size, pixel, near) in [
        // Red × 4, green × 3 along the axes: what the files were made of.
        ("EXT_texture_webp", WEBP, (96, 64), 3 * 96 + 5, [10, 9, 0, 249]),
        ("KHR_texture_basisu", KTX, (64, 48), 20 * 64 + 30, [120, 100, 30, 255]),
    ] {
        let material = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
        let json = file(
            &[floats(&[0., 0., 0., 1., 0., 0., 0., 1., 0.]), bytes.to_vec()].concat(),
            json!([{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": bytes.len()}]),
            json!([{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}]),
            json!({"attributes": {"POSITION": 0}, "material": 0}),
            &[
                ("materials", material),
                ("textures", json!([{"extensions": {extension: {"source": 0}}}])),
                ("images", json!([{"bufferView": 1, "mimeType": "image/other"}])),
                ("extensionsUsed", json!([extension])),
                ("extensionsRequired", json!([extension])),
            ],
        );
        let d = load(&json).unwrap();
        let Scattering::Principled(p) = &d.materials[0].scattering else { panic!("a material of glTF") };
        let Color::Textured { texture, .. } = &p.base_color else { panic!("a picture") };
        assert_eq!((texture.image.width, texture.image.height), size);
        let Texels::Codes(codes) = &texture.image.texels else { panic!("codes") };
        let off = codes[pixel].iter().zip(near).map(|(a, b): (&u8, u8)| a.abs_diff(b)).max().unwrap();
        assert!(off <= 14, "{extension}: {:?} {near:?}", codes[pixel]);
        // The same in a file that does not list the extension.
        let mut unlisted = json.clone();
        (unlisted["extensionsUsed"], unlisted["extensionsRequired"]) = (json!([]), json!([]));
        let d = load(&unlisted).unwrap();
        assert!(d.missing_textures.is_empty(), "{:?}", d.missing_textures);
        let mut other = json.clone();
        other["textures"] = json!([{"extensions": {"MSFT_texture_dds": {"source": 0}}}]);
        let e = load(&other).unwrap_err();
        assert!(e.contains("texture 0") && e.contains("unknown extension") && e.contains("KHR_texture_basisu"), "{e}");
        // Whatever is changed in the file, there is an answer.
        for i in 0..bytes.len() {
            let mut broken = bytes.to_vec();
            broken[i] ^= 0x55;
            let mut json = json.clone();
            json["buffers"][0]["uri"] = json!(uri(&[floats(&[0.0; 9]), broken].concat()));
            let _ = load(&json);
        }
    }
}

#[test]
fn copies_stand_where_they_should() {
    let numbers = floats(&[
        0., 0., 0., 1., 0., 0., 0., 1., 0., /* places */ 5., 0., 0., 0., 7., 0., /* scales */ 1., 1., 1., 2., 2., 2.,
    ]);
    let json = file(
        &numbers,
        json!([{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 24}, {"buffer": 0, "byteOffset": 60, "byteLength": 24}]),
        json!([
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5126, "count": 2, "type": "VEC3"},
            {"bufferView": 2, "componentType": 5126, "count": 2, "type": "VEC3"},
        ]),
        json!({"attributes": {"POSITION": 0}}),
        &[
            (
                "nodes",
                json!([{"mesh": 0, "translation": [0, 0, 3], "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 1, "SCALE": 2}}}}]),
            ),
            ("extensionsUsed", json!(["EXT_mesh_gpu_instancing"])),
        ],
    );
    let scene = Scene::build(load(&json).unwrap()).unwrap();
    let d = scene.description();
    assert_eq!((d.objects.len(), d.meshes.len()), (2, 1));
    let corner = |i: usize| match d.objects[i].shape {
        Shape::Mesh { world_from_mesh, .. } => world_from_mesh.transform_point3(Vec3::X),
        _ => panic!("a mesh"),
    };
    assert_eq!([corner(0), corner(1)], [Vec3::new(6.0, 0.0, 3.0), Vec3::new(2.0, 7.0, 3.0)]);
    let mut wrong = json.clone();
    wrong["accessors"][2]["count"] = json!(1);
    assert!(load(&wrong).unwrap_err().contains("as many"));
    wrong["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["SCALE"] = json!(99);
    assert!(load(&wrong).unwrap_err().contains("SCALE 99"));
}

#[test]
fn variants_give_other_materials() {
    let json = triangle(
        json!({"attributes": {"POSITION": 0}, "material": 0,
            "extensions": {"KHR_materials_variants": {"mappings": [{"material": 1, "variants": [1]}]}}}),
        &[
            ("materials", json!([{"name": "oak"}, {"name": "steel"}])),
            ("extensions", json!({"KHR_materials_variants": {"variants": [{"name": "Wood"}, {"name": "Metal"}]}})),
            ("extensionsUsed", json!(["KHR_materials_variants"])),
        ],
    );
    let d = load(&json).unwrap();
    let named = |name: &str| {
        let mut d = d.clone();
        d.choose_variant(name).map(|()| d.materials[d.objects[0].material as usize].name.clone())
    };
    assert_eq!(named("Wood").unwrap(), "oak");
    assert_eq!(named("Metal").unwrap(), "steel");
    assert!(named("Glass").unwrap_err().contains("Wood, Metal"));
    // Written and read again: the same choice.
    let written = diopter_scene::save::gltf(&d);
    assert!(written.json["extensionsUsed"].to_string().contains("KHR_materials_variants"), "{}", written.json["extensionsUsed"]);
    let none = |_: &str| Err("no files".to_owned());
    let again = diopter_scene::load::gltf::load(&written.container(), "x.glb", &none).unwrap();
    let said =
        |d: &diopter_scene::Description| d.variants.iter().map(|v| (v.name.clone(), v.materials.clone())).collect::<Vec<_>>();
    assert_eq!(said(&again), said(&d));
    assert_eq!(said(&d)[1], ("Metal".to_owned(), vec![(0, 1)]));
}

#[test]
fn glass_disperses_by_its_abbe_number() {
    let json = triangle(
        json!({"attributes": {"POSITION": 0}, "material": 0}),
        &[
            (
                "materials",
                json!([{"extensions": {
                "KHR_materials_ior": {"ior": 1.5}, "KHR_materials_transmission": {"transmissionFactor": 1},
                "KHR_materials_volume": {"thicknessFactor": 1}, "KHR_materials_dispersion": {"dispersion": 0.5}}}]),
            ),
            (
                "extensionsUsed",
                json!(["KHR_materials_ior", "KHR_materials_transmission", "KHR_materials_volume", "KHR_materials_dispersion"]),
            ),
        ],
    );
    let d = load(&json).unwrap();
    assert!(d.warnings.is_empty(), "{:?}", d.warnings);
    let Scattering::Principled(p) = &d.materials[0].scattering else { panic!("a material of glTF") };
    let n = p.dispersion.as_ref().unwrap();
    let abbe = (n.at(587.56) - 1.0) / (n.at(486.13) - n.at(656.27));
    assert!((n.at(587.56) - 1.5).abs() < 1e-3 && (abbe - 40.0).abs() < 0.5, "{abbe}");
}

#[test]
fn cloth_grain_and_films_are_read_and_written_again() {
    use diopter_scene::material::Anisotropy;
    use diopter_scene::texture::Scalar;
    let extensions = json!({
        "KHR_materials_sheen": {"sheenColorFactor": [0.5, 0.25, 1.0], "sheenRoughnessFactor": 0.3, "sheenRoughnessTexture": {"index": 0}},
        "KHR_materials_anisotropy": {"anisotropyStrength": 0.6, "anisotropyRotation": 0.5, "anisotropyTexture": {"index": 0}},
        "KHR_materials_iridescence": {
            "iridescenceFactor": 0.9, "iridescenceIor": 1.8, "iridescenceThicknessMinimum": 50, "iridescenceThicknessMaximum": 700,
            "iridescenceThicknessTexture": {"index": 0}
        },
    });
    let names: Vec<&str> = extensions.as_object().unwrap().keys().map(String::as_str).chain(["EXT_texture_webp"]).collect();
    let json = file(
        &[floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]), WEBP.to_vec()].concat(),
        json!([{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": WEBP.len()}]),
        json!([{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}]),
        json!({"attributes": {"POSITION": 0}, "material": 0}),
        &[
            ("materials", json!([{"extensions": extensions}])),
            ("textures", json!([{"extensions": {"EXT_texture_webp": {"source": 0}}}])),
            ("images", json!([{"bufferView": 1, "mimeType": "image/webp"}])),
            ("extensionsUsed", json!(names)),
        ],
    );
    let first = load(&json).unwrap();
    // Of textures on a triangle without coordinates.
    assert!(first.warnings.iter().all(|w| w.contains("1 mesh without the texture coordinates")), "{:?}", first.warnings);
    let saved = diopter_scene::save::gltf(&first);
    let mut again = saved.json.clone();
    again["buffers"][0]["uri"] = json!(uri(&saved.binary));
    for d in [first, load(&again).unwrap()] {
        let Scattering::Principled(p) = &d.materials[0].scattering else { panic!("a material of glTF") };
        let (sheen, film) = (p.sheen.as_ref().unwrap(), p.film.as_ref().unwrap());
        assert!(matches!(&sheen.color, Color::Constant { rgb, .. } if (*rgb - Vec3::new(0.5, 0.25, 1.0)).length() < 1e-6));
        assert!(matches!(&sheen.roughness, Scalar::Textured { factor, channel: 3, .. } if (factor - 0.3).abs() < 1e-6));
        let Some(Anisotropy::Brushed { strength, rotation, texture: Some(_) }) = p.anisotropy.as_deref() else {
            panic!("{:?}", p.anisotropy)
        };
        assert!((strength - 0.6).abs() < 1e-6 && (rotation - 0.5).abs() < 1e-6);
        assert!((film.ior - 1.8).abs() < 1e-6 && film.between_nm == [50.0, 700.0]);
        assert!(matches!(film.fraction, Scalar::Constant(s) if (s - 0.9).abs() < 1e-6));
        assert!(matches!(&film.thickness, Scalar::Textured { channel: 1, .. }));
    }
}

#[test]
fn classes_come_from_extras_of_nodes_their_ancestors_and_meshes() {
    let json = triangle(
        json!({"attributes": {"POSITION": 0}}),
        &[
            ("scenes", json!([{"nodes": [0, 4, 5]}])),
            (
                "nodes",
                json!([
                    {"name": "car", "extras": {"class": "car"}, "children": [1, 2, 3]},
                    {"name": "door", "mesh": 0},
                    {"name": "wheel", "mesh": 0, "extras": {"paint": "black", "category_id": 7}},
                    {"name": "seat", "mesh": 0, "extras": {"class": " "}},
                    {"name": "part", "mesh": 0},
                    {"name": "tree", "mesh": 0, "extras": {"category": "tree", "category_id": 9}},
                ]),
            ),
            ("meshes", json!([{"primitives": [{"attributes": {"POSITION": 0}}], "extras": {"class": "of the mesh"}}])),
        ],
    );
    let d = load(&json).unwrap();
    let found: Vec<(&str, Option<&str>)> = d.objects.iter().map(|o| (o.name.as_str(), o.class.as_deref())).collect();
    let expected = [("door", "car"), ("wheel", "7"), ("seat", "car"), ("part", "of the mesh"), ("tree", "tree")];
    assert_eq!(found, expected.map(|(name, class)| (name, Some(class))));
    // Written and read again they are the same.
    let saved = diopter_scene::save::gltf(&d).container();
    let again = gltf::load(&saved, "t.glb", &|_| Err("no files here".into())).unwrap();
    let mut classes: Vec<_> = again.objects.iter().map(|o| o.class.as_deref()).collect();
    classes.sort();
    assert_eq!(classes, ["7", "car", "car", "of the mesh", "tree"].map(Some));
}
