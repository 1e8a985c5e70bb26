//! Maps of normals of every format against pictures of colours: red of a map leans to where columns of a picture grow on the same surface, green to
//! where its rows begin. Where that is, is measured on the surface itself, from the colours that rays meet.

use super::{gltf, obj, pbrt, usd};
use crate::material::{Material, Scattering};
use crate::scene::{Description, Object, Scene, Shape};
use crate::shape::{Quad, Sphere};
use crate::texture::{Codes, Color, Image, Texture};
use base64::Engine;
use diopter_light::Ray;
use glam::{Affine2, Vec2, Vec3};
use std::io::Cursor;
use std::sync::Arc;

/// The normal of the map, to the right and up in it.
const LEANING: Vec3 = Vec3::new(0.36, 0.48, 0.8);

fn png(texel: impl Fn(u32, u32) -> [u8; 3]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let picture = image::RgbImage::from_fn(64, 64, |x, y| image::Rgb(texel(x, y)));
    picture.write_to(&mut Cursor::new(&mut bytes), image::ImageFormat::Png).unwrap();
    bytes
}

/// Red grows to the right, green up.
fn colors(x: u32, y: u32) -> [u8; 3] {
    [4 * x as u8, 252 - 4 * y as u8, 0]
}

fn normals(_: u32, _: u32) -> [u8; 3] {
    (LEANING * 0.5 + 0.5).to_array().map(|v| (v * 255.0).round() as u8)
}

fn fetch(name: &str) -> Result<Vec<u8>, String> {
    match name {
        "c.png" => Ok(png(colors)),
        "n.png" => Ok(png(normals)),
        "a.mtl" => Ok(b"newmtl a\nmap_Kd c.png\nnorm n.png\n".to_vec()),
        _ => Err("there is no such file".into()),
    }
}

/// Looks at a place of the first object from outside and holds the normal of the map against the colours around.
fn assert_leans(d: Description, at: Vec3, outside: Vec3, what: &str) {
    assert!(d.warnings.is_empty(), "{what}: {:?}", d.warnings);
    let scene = Scene::build(d).unwrap();
    let look = |p: Vec3| {
        let ray = Ray { origin: p + outside * 0.5, direction: -outside, time_s: 0.0 };
        scene.intersect(&ray, 1.0).unwrap_or_else(|| panic!("{what}: nothing at {p}"))
    };
    let (x, y) = outside.any_orthonormal_pair();
    let color = |p: Vec3| {
        let surface = look(p);
        scene.material(surface.object).albedo(&surface)
    };
    // Central differences over a twentieth: a few texels.
    let along = |e: Vec3| (color(at + e * 0.025) - color(at - e * 0.025)) / 0.05;
    let (dx, dy) = (along(x), along(y));
    let gradient = |channel: usize| (x * dx[channel] + y * dy[channel]).normalize();
    let (right, up) = (gradient(0), gradient(1));
    assert!(right.dot(up).abs() < 0.05, "{what}: {right} {up}");
    let surface = look(at);
    let expected = (right * LEANING.x + up * LEANING.y + outside * LEANING.z).normalize();
    let found = scene.material(surface.object).shading_normal(&surface);
    // Codes of 8 bits and a surface that may be round: 0.03; the wrong sign of a part is off by 0.7.
    assert!(found.distance(expected) < 0.03, "{what}: {found}, not {expected}");
}

#[test]
fn maps_of_pbrt_lean_as_their_pictures_lie() {
    let head = "LookAt 0 0 -5  0 0 0  0 1 0\nFilm \"rgb\"\nCamera \"perspective\"\n";
    let material = "Texture \"c\" \"spectrum\" \"imagemap\" \"string filename\" \"c.png\"\n\
        Material \"diffuse\" \"texture reflectance\" \"c\" \"string normalmap\" \"n.png\"\n";
    let wall = |uv: &str| {
        format!(
            "Shape \"trianglemesh\" \"integer indices\" [0 2 1 0 3 2] \"point3 P\" [0 0 0 1 0 0 1 1 0 0 1 0] \"point2 uv\" [{uv}]"
        )
    };
    for (uv, name) in [("0 0 1 0 1 1 0 1", "upright"), ("1 0 0 0 0 1 1 1", "mirrored"), ("0 0 0 1 1 1 1 0", "turned over")] {
        for camera in ["", "Scale -1 1 1\n"] {
            for place in ["", "Scale -1 1 1 Translate -1 0 0 "] {
                let text = format!("{camera}{head}WorldBegin {material}{place}{}", wall(uv));
                let d = pbrt::load(text.as_bytes(), "a.pbrt", &fetch).unwrap();
                // Left-handed worlds are mirrored, z → −z: the side with the camera is the outer one of this winding.
                let scene = Scene::build(d.clone()).unwrap();
                let probe = Ray { origin: Vec3::new(0.4, 0.45, 1.0), direction: Vec3::NEG_Z, time_s: 0.0 };
                let outside = scene.intersect(&probe, 9.0).unwrap().ng;
                assert_leans(d, Vec3::new(0.4, 0.45, 0.0), outside, &format!("pbrt {name} {camera}{place}"));
            }
        }
    }
    for camera in ["", "Scale -1 1 1\n"] {
        let text = format!("{camera}{head}WorldBegin {material} Rotate 20 1 2 3 Shape \"sphere\"");
        let d = pbrt::load(text.as_bytes(), "a.pbrt", &fetch).unwrap();
        let outside = Vec3::new(0.5, 0.3, 0.6).normalize();
        assert_leans(d, outside, outside, &format!("sphere of pbrt {camera}"));
    }
}

#[test]
fn spheres_of_pbrt_have_its_texture_coordinates() {
    // Around z, u = φ / 2π; v from the south pole (PBR 4ed §6.2.3): the picture's first row is at the north pole.
    let text = "Scale -1 1 1 LookAt 0 0 -5  0 0 0  0 1 0\nFilm \"rgb\"\nCamera \"perspective\"\nWorldBegin\n\
        Texture \"c\" \"spectrum\" \"imagemap\" \"string filename\" \"c.png\" \"string encoding\" \"linear\"\n\
        Material \"diffuse\" \"texture reflectance\" \"c\" Translate 1 2 3 Shape \"sphere\" \"float radius\" 2";
    let scene = Scene::build(pbrt::load(text.as_bytes(), "a.pbrt", &fetch).unwrap()).unwrap();
    for (phi, z) in [(0.7f32, 0.4f32), (2.0, -0.6), (4.0, 0.1)] {
        let r = (1.0 - z * z).sqrt();
        let n = Vec3::new(r * phi.cos(), r * phi.sin(), z);
        let ray = Ray { origin: Vec3::new(1.0, 2.0, 3.0) + n * 3.0, direction: -n, time_s: 0.0 };
        let surface = scene.intersect(&ray, 2.0).unwrap();
        let found = scene.material(surface.object).albedo(&surface);
        let texel = |fraction: f32| (fraction * 64.0 - 0.5) * 4.0 / 255.0;
        let (u, v) = (phi / std::f32::consts::TAU, 1.0 - z.acos() / std::f32::consts::PI);
        // A texel is 4 / 255.
        assert!((found.x - texel(u)).abs() < 0.01 && (found.y - texel(v)).abs() < 0.01, "{found} {u} {v}");
    }
}

#[test]
fn maps_of_obj_files_lean_as_their_pictures_lie() {
    for (vt, name) in [
        ("vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n", "upright"),
        ("vt 1 0\nvt 0 0\nvt 0 1\nvt 1 1\n", "mirrored"),
        ("vt 0 1\nvt 0 0\nvt 1 0\nvt 1 1\n", "turned"),
    ] {
        let text = format!("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n{vt}usemtl a\nf 1/1 2/2 3/3 4/4\n");
        let d = obj::obj(text.as_bytes(), "a.obj", &fetch).unwrap();
        assert_leans(d, Vec3::new(0.4, 0.45, 0.0), Vec3::Z, &format!("OBJ {name}"));
    }
}

#[test]
fn maps_of_gltf_lean_as_their_pictures_lie() {
    let base64 = |bytes: &[u8]| base64::engine::general_purpose::STANDARD.encode(bytes);
    let floats = |v: &[f32]| v.iter().flat_map(|f| f.to_le_bytes()).collect::<Vec<u8>>();
    let positions = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0];
    // Upright and mirrored, v down; with tangents as MikkTSpace makes them and without. A texture transform that mirrors, too.
    for (uv, tangent) in [
        ([0.0f32, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0], [1.0f32, 0.0, 0.0, 1.0]),
        ([1.0, 1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, -1.0]),
    ] {
        for has_tangents in [true, false] {
            for transform in ["", r#", "extensions": {"KHR_texture_transform": {"scale": [1, -1], "offset": [0, 1]}}"#] {
                // Tangents of a file hold for its own coordinates.
                if has_tangents && !transform.is_empty() {
                    continue;
                }
                let mut buffer = floats(&positions);
                buffer.extend(floats(&uv));
                buffer.extend(floats(&tangent.repeat(4)));
                buffer.extend([0u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
                let tangents = if has_tangents { r#", "TANGENT": 2"# } else { "" };
                let (bytes, c, n) = (base64(&buffer), base64(&png(colors)), base64(&png(normals)));
                let text = format!(
                    r#"{{"asset": {{"version": "2.0"}}, "extensionsUsed": ["KHR_texture_transform"], "scene": 0, "scenes": [{{"nodes": [0]}}],
                    "nodes": [{{"mesh": 0}}],
                    "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0, "TEXCOORD_0": 1{tangents}}}, "indices": 3, "material": 0}}]}}],
                    "materials": [{{"pbrMetallicRoughness": {{"baseColorTexture": {{"index": 0{transform}}}}}, "normalTexture": {{"index": 1{transform}}}}}],
                    "textures": [{{"source": 0}}, {{"source": 1}}],
                    "images": [{{"uri": "data:image/png;base64,{c}"}}, {{"uri": "data:image/png;base64,{n}"}}],
                    "buffers": [{{"byteLength": {length}, "uri": "data:application/octet-stream;base64,{bytes}"}}],
                    "bufferViews": [{{"buffer": 0, "byteLength": 48}}, {{"buffer": 0, "byteOffset": 48, "byteLength": 32}},
                        {{"buffer": 0, "byteOffset": 80, "byteLength": 64}}, {{"buffer": 0, "byteOffset": 144, "byteLength": 12}}],
                    "accessors": [{{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}},
                        {{"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"}},
                        {{"bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC4"}},
                        {{"bufferView": 3, "componentType": 5123, "count": 6, "type": "SCALAR"}}]}}"#,
                    length = buffer.len()
                );
                let d = gltf::load(text.as_bytes(), "a.gltf", &fetch).unwrap();
                assert_leans(d, Vec3::new(0.4, 0.45, 0.0), Vec3::Z, &format!("glTF {uv:?} {has_tangents} {transform}"));
            }
        }
    }
}

#[test]
fn maps_of_usd_lean_as_their_pictures_lie() {
    for st in ["(0, 0), (1, 0), (1, 1), (0, 1)", "(1, 0), (0, 0), (0, 1), (1, 1)"] {
        let text = format!(
            "#usda 1.0\n( metersPerUnit = 1\nupAxis = \"Y\" )\ndef Mesh \"A\" {{ int[] faceVertexCounts = [4]\nint[] faceVertexIndices = [0, 1, 2, 3]\n\
            point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]\nuniform token subdivisionScheme = \"none\"\n\
            texCoord2f[] primvars:st = [{st}] ( interpolation = \"vertex\" )\nrel material:binding = </A/M>\n\
            def Material \"M\" {{ token outputs:surface.connect = </A/M/S.outputs:surface>\n\
            def Shader \"S\" {{ token info:id = \"UsdPreviewSurface\"\ncolor3f inputs:diffuseColor.connect = </A/M/C.outputs:rgb>\n\
            normal3f inputs:normal.connect = </A/M/N.outputs:rgb> }}\n\
            def Shader \"C\" {{ token info:id = \"UsdUVTexture\"\nasset inputs:file = @c.png@\nfloat2 inputs:st.connect = </A/M/R.outputs:result> }}\n\
            def Shader \"N\" {{ token info:id = \"UsdUVTexture\"\nasset inputs:file = @n.png@\nfloat4 inputs:scale = (2, 2, 2, 1)\n\
            float4 inputs:bias = (-1, -1, -1, 0)\ntoken inputs:sourceColorSpace = \"raw\"\nfloat2 inputs:st.connect = </A/M/R.outputs:result> }}\n\
            def Shader \"R\" {{ token info:id = \"UsdPrimvarReader_float2\"\nstring inputs:varname = \"st\" }} }} }}"
        );
        let d = usd::load(text.into(), "a.usda", &fetch).unwrap();
        assert_leans(d, Vec3::new(0.4, 0.45, 0.0), Vec3::Z, &format!("USD {st}"));
    }
}

#[test]
fn maps_on_spheres_and_quads_lean_as_their_pictures_lie() {
    let picture = |texel: fn(u32, u32) -> [u8; 3]| {
        let texels = (0..64 * 64).map(|i| texel(i % 64, i / 64)).map(|[r, g, b]| [r, g, b, 255]).collect();
        Arc::new(Image::new(64, 64, texels))
    };
    for flip in [Affine2::IDENTITY, Affine2::from_scale_angle_translation(Vec2::new(1.0, -1.0), 0.0, Vec2::Y)] {
        let color = Texture { image_from_uv: flip, ..Texture::color(picture(colors)) };
        let map = Texture { image_from_uv: flip, codes: Codes::Linear, ..Texture::color(picture(normals)) };
        let made = |shape: Shape| {
            let scattering = Scattering::Diffuse(Color::Textured { factor: Vec3::ONE, texture: color.clone() });
            let material = Material { normal_map: Some((map.clone(), 1.0)), ..Material::new("both", scattering) };
            Description { materials: vec![material], objects: vec![Object::new("it", shape, 0)], ..Default::default() }
        };
        for outside in [Vec3::new(0.5, 0.3, 0.6), Vec3::new(-0.7, -0.3, -0.6), Vec3::new(0.2, 0.6, -0.9)] {
            let outside = outside.normalize();
            let ball = made(Shape::Sphere(Sphere { center: Vec3::ZERO, radius: 1.0 }));
            assert_leans(ball, outside, outside, &format!("sphere {outside}"));
        }
        let quad = Quad { corner: Vec3::ZERO, edges: [Vec3::X, Vec3::Y] };
        assert_leans(made(Shape::Quad(quad)), Vec3::new(0.4, 0.45, 0.0), Vec3::Z, "quad");
    }
}
