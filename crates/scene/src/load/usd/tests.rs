//! Whole files: what becomes of them. `tests/box.usdc` was written by OpenUSD 26.11 (`Sdf.Layer.Export`) from `tests/box.usda`, which is ours.

use super::*;
use crate::light::PunctualKind;
use crate::light::punctual::Spread;
use crate::material::{Coverage, EmissionColor, Material, Scattering};
use crate::motion::Motion;
use crate::scene::{CameraProjection, Shape};
use crate::texture::{Color, Scalar};
use glam::{Vec2, Vec3};

const TEXT: &str = include_str!("tests/box.usda");
const BINARY: &[u8] = include_bytes!("tests/box.usdc");

pub fn none(_: &str) -> Result<Vec<u8>, String> {
    Err("no files here".into())
}

pub fn read(body: &str) -> Description {
    load(format!("#usda 1.0\n( metersPerUnit = 1 )\n{body}").into(), "t.usda", &none).unwrap_or_else(|e| panic!("{e}"))
}

pub const QUAD: &str = "int[] faceVertexCounts = [4]\nint[] faceVertexIndices = [0, 1, 2, 3]\n\
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]\nuniform token subdivisionScheme = \"none\"\n";

#[test]
fn classes_are_those_of_the_nearest_prim_that_says_one() {
    let d = read(&format!(
        "def Xform \"kitchen\" ( prepend apiSchemas = [\"SemanticsLabelsAPI:category\", \"SemanticsLabelsAPI:class\"] ) {{\n\
            token[] semantics:labels:category = [\"room\"]\ntoken[] semantics:labels:class = [\"furniture\", \"wood\"]\n\
            def Mesh \"table\" {{ {QUAD} }}\n\
            def Mesh \"cup\" {{ {QUAD} token[] semantics:labels:class = [\"crockery\"] }}\n\
            def Sphere \"ball\" {{ string semantic:Semantics:params:semanticType = \"class\"\nstring semantic:Semantics:params:semanticData = \"toy\" }}\n}}\n\
        def Mesh \"wall\" {{ {QUAD} string semantic:Semantics:params:semanticType = \"material\"\nstring semantic:Semantics:params:semanticData = \"brick\" }}"
    ));
    let mut said: Vec<_> = d.objects.iter().map(|o| (o.name.as_str(), o.class.as_deref())).collect();
    said.sort_unstable();
    assert_eq!(said, [("ball", Some("toy")), ("cup", Some("crockery")), ("table", Some("furniture")), ("wall", None)]);
}

#[test]
fn text_and_binary_are_the_same_scene() {
    let [text, binary] = [TEXT.as_bytes(), BINARY].map(|b| load(b.to_vec(), "box", &none).unwrap());
    for d in [&text, &binary] {
        assert!(d.warnings.is_empty(), "{:?}", d.warnings);
        let names: Vec<&str> = d.objects.iter().map(|o| o.name.as_str()).collect();
        assert_eq!(names, ["Strip", "Cube", "Cube"]);
        assert_eq!((d.meshes.len(), d.meshes[0].triangles.len(), d.materials.len()), (2, 18, 2));
        // Two cubes are one mesh, a cube of 200 units of a centimetre.
        let [Shape::Mesh { mesh: a, world_from_mesh: first }, Shape::Mesh { mesh: b, world_from_mesh: second }] =
            [1, 2].map(|i: usize| d.objects[i].shape)
        else {
            panic!("meshes")
        };
        assert_eq!(a, b);
        let corner = d.meshes[a as usize].positions.iter().fold(Vec3::ZERO, |m, p| m.max(*p));
        assert!((first.transform_vector3(corner) - Vec3::new(1.0, 1.0, -1.0)).length() < 1e-5);
        // A prim without a type is no Xformable: its xformOps count for nothing (OpenUSD).
        assert!(first.transform_point3(Vec3::ZERO).length() < 1e-5);
        assert!(second.transform_point3(Vec3::ZERO).length() < 1e-5);
        // The strip goes half a metre along x in a second, a metre up.
        let Motion::Carried { node } = d.objects[0].motion else { panic!("it moves") };
        let timeline = d.timeline();
        for (t, x) in [(0.0, 0.0), (0.5, 0.25), (1.0, 0.5)] {
            let at = timeline.world(node, t).transform_point3(Vec3::ZERO);
            assert!((at - Vec3::new(x, 1.0, 0.0)).length() < 1e-5, "{t}: {at}");
        }
        let Scattering::Principled(p) = &d.materials[d.objects[0].material as usize].scattering else { panic!("a surface") };
        assert!(matches!(&p.base_color, Color::Constant { rgb, .. } if (*rgb - Vec3::new(0.8, 0.1, 0.05)).length() < 1e-6));
    }
    for (a, b) in text.meshes.iter().zip(&binary.meshes) {
        assert_eq!((&a.positions, &a.triangles, &a.uvs), (&b.positions, &b.triangles, &b.uvs));
    }
    crate::Scene::build(binary).unwrap();
}

#[test]
fn damaged_binary_files_are_errors() {
    for cut in (0..BINARY.len()).step_by(7) {
        assert!(load(BINARY[..cut].to_vec(), "b.usdc", &none).is_err(), "{cut}");
    }
    for i in 0..BINARY.len() {
        for change in [0, 1, 0x7f, 0xff] {
            let mut bytes = BINARY.to_vec();
            bytes[i] = change;
            let _ = load(bytes, "b.usdc", &none).map(crate::Scene::build);
        }
    }
    for (version, hint) in [([0, 3, 0], "usdcat"), ([9, 0, 0], "crate 0.4")] {
        let mut bytes = BINARY.to_vec();
        bytes[8..11].copy_from_slice(&version);
        assert!(load(bytes, "b.usdc", &none).unwrap_err().to_string().contains(hint));
    }
}

#[test]
fn damaged_text_files_never_panic() {
    for i in (0..TEXT.len()).step_by(3) {
        for change in *b"9\"{(,<" {
            let mut bytes = TEXT.as_bytes().to_vec();
            bytes[i] = change;
            let _ = load(bytes, "b.usda", &none);
        }
        let _ = load(TEXT.as_bytes()[..i].to_vec(), "b.usda", &none);
    }
}

#[test]
fn tiles_of_pictures_lie_side_by_side() {
    let tile = |grey: u8| {
        let mut png = Vec::new();
        let image = image::RgbaImage::from_pixel(2, 2, image::Rgba([grey, grey, grey, 255]));
        image.write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png).unwrap();
        png
    };
    let text = format!(
        "#usda 1.0\n( defaultPrim = \"A\" )\ndef Mesh \"A\" {{ {QUAD}\ntexCoord2f[] primvars:st = [(0, 0), (2, 0), (2, 2), (0, 2)] ( interpolation = \"vertex\" )\n\
        rel material:binding = </A/M>\n\
        def Material \"M\" {{ token outputs:surface.connect = </A/M/S.outputs:surface>\n\
        def Shader \"S\" {{ token info:id = \"UsdPreviewSurface\"\ncolor3f inputs:diffuseColor.connect = </A/M/T.outputs:rgb> }}\n\
        def Shader \"T\" {{ token info:id = \"UsdUVTexture\"\nasset inputs:file = @t/a.<UDIM>.png@\ntoken inputs:sourceColorSpace = \"raw\" }} }} }}"
    );
    let (first, beside, above) = (tile(51), tile(102), tile(153));
    let files: [(&str, &[u8]); 4] =
        [("a.usda", text.as_bytes()), ("t/a.1001.png", &first), ("t/a.1002.png", &beside), ("t/a.1011.png", &above)];
    let d = load(package::tests::archive(&files), "a.usdz", &none).unwrap();
    assert!(d.missing_textures.is_empty());
    let Scattering::Diffuse(color) = &d.materials[0].scattering else {
        let Scattering::Principled(p) = &d.materials[0].scattering else { panic!("a surface") };
        return check(&p.base_color, &d);
    };
    check(color, &d);

    /// By the coordinates of the quad's corners: v of files runs up.
    fn check(color: &Color, d: &Description) {
        let Color::Textured { texture, .. } = color else { panic!("a picture") };
        let corners = &d.meshes[0].uvs[0];
        let at = |u: f32, v: f32| {
            let p = corners[0] + (corners[1] - corners[0]) * (0.5 * u) + (corners[3] - corners[0]) * (0.5 * v);
            (texture.at(&[p; 2]).x * 5.0).round()
        };
        assert_eq!([at(0.5, 0.5), at(1.5, 0.5), at(0.5, 1.5), at(1.5, 1.5)], [1.0, 2.0, 3.0, 0.0]);
    }
}

#[test]
fn packages_bring_their_pictures() {
    let mut png = Vec::new();
    let image = image::RgbaImage::from_fn(2, 2, |x, y| image::Rgba([x as u8 * 255, y as u8 * 255, 9, 255]));
    image.write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png).unwrap();
    let text = format!(
        "#usda 1.0\n( defaultPrim = \"A\" )\ndef Mesh \"A\" {{ {QUAD}\ntexCoord2f[] primvars:map = [(0, 0), (1, 0), (1, 1), (0, 1)] ( interpolation = \"vertex\" )\n\
        rel material:binding = </A/M>\n\
        def Material \"M\" {{ token outputs:surface.connect = </A/M/S.outputs:surface>\nstring inputs:name = \"map\"\n\
        def Shader \"S\" {{ token info:id = \"UsdPreviewSurface\"\ncolor3f inputs:diffuseColor.connect = </A/M/T.outputs:rgb>\n\
        float inputs:roughness.connect = </A/M/T.outputs:g>\nfloat inputs:metallic.connect = </A/M/Gone.outputs:r> }}\n\
        def Shader \"T\" {{ token info:id = \"UsdUVTexture\"\nasset inputs:file = @t/a.png@\nfloat4 inputs:scale = (0.5, 0.5, 0.5, 1)\ntoken inputs:wrapS = \"clamp\"\n\
        token inputs:sourceColorSpace = \"sRGB\"\nfloat2 inputs:st.connect = </A/M/R.outputs:result> }}\n\
        def Shader \"Gone\" {{ token info:id = \"UsdUVTexture\"\nasset inputs:file = @t/gone.png@ }}\n\
        def Shader \"R\" {{ token info:id = \"UsdPrimvarReader_float2\"\nstring inputs:varname.connect = </A/M.inputs:name> }} }} }}"
    );
    let bytes = package::tests::archive(&[("a.usda", text.as_bytes()), ("t/a.png", &png)]);
    let d = load(bytes, "a.usdz", &none).unwrap();
    let Scattering::Principled(p) = &d.materials[0].scattering else { panic!("a surface") };
    let Color::Textured { factor, texture } = &p.base_color else { panic!("a picture") };
    assert_eq!(*factor, Vec3::splat(0.5));
    // v runs up: the point (0, 1) of the file is the upper left pixel; here v runs down.
    let mesh = &d.meshes[0];
    assert_eq!(mesh.uvs[0][3], Vec2::ZERO);
    // At the middles of the left pixels.
    let at = |v: f32| texture.at(&[Vec2::new(0.25, v); 2]).truncate();
    assert!(at(0.25).distance(Vec3::new(0.0, 0.0, 0.0027)) < 1e-3 && at(0.75).y > 0.99, "{} {}", at(0.25), at(0.75));
    assert!(matches!(&p.roughness, Scalar::Textured { channel: 1, factor: 0.5, .. }));
    assert!(matches!(p.metallic, Scalar::Constant(0.0)) && d.missing_textures[0].name == "t/gone.png");
}

#[test]
fn parts_of_meshes_have_their_materials() {
    let material = |name: &str, red: f32| {
        format!(
            "def Material \"{name}\" {{ token outputs:surface.connect = </{name}/S.outputs:surface>\n\
            def Shader \"S\" {{ token info:id = \"UsdPreviewSurface\"\ncolor3f inputs:diffuseColor = ({red}, 0, 0)\nfloat inputs:opacity = {red} }} }}\n"
        )
    };
    let d = read(&format!(
        "{}{}def Mesh \"A\" {{ int[] faceVertexCounts = [3, 3, 3, 4, 2]\nint[] faceVertexIndices = [0, 1, 2, 0, 2, 3, 0, 1, 3, 0, 1, 2, 3, 0, 1]\n\
        point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]\nint[] holeIndices = [2]\nuniform token orientation = \"leftHanded\"\n\
        uniform token subdivisionScheme = \"none\"\n\
        color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 1, 1)] ( interpolation = \"uniform\" )\n\
        def GeomSubset \"s\" {{ uniform token familyName = \"materialBind\"\nuniform token elementType = \"face\"\nint[] indices = [1, 77, -3]\nrel material:binding = </M> }}\n\
        def GeomSubset \"t\" {{ uniform token familyName = \"materialBind\"\nint[] indices = [3]\nrel material:binding = </N> }} }}",
        material("M", 1.0),
        material("N", 0.5),
    ));
    let parts: Vec<(usize, bool)> = d
        .objects
        .iter()
        .map(|o| {
            let Shape::Mesh { mesh, .. } = o.shape else { panic!("a mesh") };
            let mesh = &d.meshes[mesh as usize];
            (mesh.triangles.len(), mesh.colors.is_empty())
        })
        .collect();
    assert_eq!(parts, [(1, false), (1, true), (2, true)]);
    // Left-handed faces are turned.
    let [a, b, c] = d.meshes[0].corners(0);
    assert!((b - a).cross(c - a).z < 0.0);
    assert!(matches!(&d.materials[d.objects[2].material as usize].scattering, Scattering::Mix(_)));
    assert!(d.warnings.is_empty(), "{:?}", d.warnings);
}

/// A cube from −1 to 1, corner `i` at the signs of its bits, and what else is said of it.
fn cube(more: &str) -> String {
    let points = (0..8).map(|i: i32| format!("({}, {}, {})", (i & 1) * 2 - 1, (i >> 1 & 1) * 2 - 1, (i >> 2) * 2 - 1));
    format!(
        "def Mesh \"cube\" {{ int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]\npoint3f[] points = [{}]\n\
        int[] faceVertexIndices = [0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5]\n{more} }}",
        points.collect::<Vec<_>>().join(", ")
    )
}

#[test]
fn meshes_are_subdivision_surfaces_unless_they_say_otherwise() {
    let mesh = |more: &str| {
        let d = read(&cube(more));
        assert!(d.warnings.is_empty(), "{more}: {:?}", d.warnings);
        d.meshes[0].clone()
    };
    let farthest = |m: &crate::shape::Mesh| m.positions.iter().map(|p| p.length()).fold(0.0, f32::max);
    let outwards = |m: &crate::shape::Mesh| {
        (0..m.triangles.len()).all(|t| {
            let [a, b, c] = m.corners(t);
            let n = (b - a).cross(c - a);
            n.dot(a) > 0.0 && m.normals[m.triangles[t][0] as usize].dot(n) > 0.0
        })
    };
    // No scheme and no normals: Catmull and Clark's, the corner at ½ of the cube's.
    let smooth = mesh("");
    assert!(smooth.triangles.len() == 192 && outwards(&smooth));
    assert!(smooth.positions.iter().any(|p| p.distance(Vec3::splat(0.5)) < 1e-6) && farthest(&smooth) < 1.0);
    let normals = "normal3f[] normals = [(0, 0, -1), (0, 0, 1), (0, -1, 0), (0, 1, 0), (-1, 0, 0), (1, 0, 0)] ( interpolation = \"uniform\" )\n";
    for (more, triangles, corner) in [
        // Normals and no scheme are polygons; with a scheme normals do not count.
        (normals.to_owned(), 12, true),
        (format!("{normals}uniform token subdivisionScheme = \"none\""), 12, true),
        (format!("{normals}uniform token subdivisionScheme = \"catmullClark\""), 192, false),
        ("uniform token subdivisionScheme = \"bilinear\"".into(), 192, true),
        ("uniform token subdivisionScheme = \"loop\"".into(), 192, false),
        ("int[] holeIndices = [3]".into(), 160, false),
        // A sharp corner; a crease in two ways of saying its sharpness, and one around a face, which stays flat.
        ("int[] cornerIndices = [7]\nfloat[] cornerSharpnesses = [10]".into(), 192, true),
        ("int[] creaseIndices = [7, 6, 4, 5, 7]\nint[] creaseLengths = [5]\nfloat[] creaseSharpnesses = [10]".into(), 192, false),
        (
            "int[] creaseIndices = [7, 6, 4, 5, 7]\nint[] creaseLengths = [5]\nfloat[] creaseSharpnesses = [10, 10, 10, 10]"
                .into(),
            192,
            false,
        ),
    ] {
        let m = mesh(&more);
        assert_eq!(m.triangles.len(), triangles, "{more}");
        assert_eq!(farthest(&m) > 1.73, corner, "{more}");
        if more.contains("crease") {
            // The limit of a corner of the crease's square: (2, 2)/3 of it.
            assert!(m.positions.iter().any(|p| p.distance(Vec3::new(2.0 / 3.0, 2.0 / 3.0, 1.0)) < 1e-6), "{more}");
        }
    }
    // Clockwise faces turned inside out.
    let turned = mesh("uniform token orientation = \"leftHanded\"");
    assert!(turned.triangles.iter().zip(&smooth.triangles).all(|(a, b)| (a[1], a[2]) == (b[2], b[1])));
    assert!(turned.normals.iter().zip(&smooth.normals).all(|(a, b)| *a == -*b));
    // Texture coordinates at corners, each face its square, v down; a part for itself; faces beside a boundary left out.
    let square = "(0, 0), (1, 0), (1, 1), (0, 1), ".repeat(6);
    let text = format!(
        "#usda 1.0\n( metersPerUnit = 1 )\n{}\ndef Material \"M\" {{ token outputs:surface.connect = </M/S.outputs:surface>\n\
        def Shader \"S\" {{ token info:id = \"UsdPreviewSurface\"\ncolor3f inputs:diffuseColor.connect = </M/T.outputs:rgb> }}\n\
        def Shader \"T\" {{ token info:id = \"UsdUVTexture\"\nasset inputs:file = @a.png@\nfloat2 inputs:st.connect = </M/R.outputs:result> }}\n\
        def Shader \"R\" {{ token info:id = \"UsdPrimvarReader_float2\"\nstring inputs:varname = \"st\" }} }}",
        cube(&format!(
            "texCoord2f[] primvars:st = [{}] ( interpolation = \"faceVarying\" )\n\
            def GeomSubset \"s\" {{ uniform token familyName = \"materialBind\"\nint[] indices = [1, 5]\nrel material:binding = </M> }}",
            square.trim_end_matches(", ")
        ))
    );
    let mut png = Vec::new();
    image::RgbaImage::new(2, 2).write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png).unwrap();
    let d = load(text.into(), "t.usda", &|_: &str| Ok(png.clone())).unwrap();
    let sizes: Vec<(usize, usize)> = d.meshes.iter().map(|m| (m.triangles.len(), m.uvs[0].len())).collect();
    // Two faces of 5 × 5 points; of the two ends of their edge one is (1, 1) in both maps.
    assert_eq!(sizes, [(128, 0), (64, 49)]);
    let m = &d.meshes[1];
    let corner = (0..49).find(|i| m.uvs[0][*i] == Vec2::new(0.0, 1.0) && m.positions[*i].z > 0.4).unwrap();
    assert!(m.positions[corner].abs().distance(Vec3::splat(0.5)) < 1e-6);
    let open = cube("uniform token interpolateBoundary = \"none\"").replace("[4, 4, 4, 4, 4, 4]", "[4, 4, 4, 4, 4]");
    assert_eq!(read(&open).meshes[0].triangles.len(), 32);
}

#[test]
fn surfaces_that_cannot_be_subdivided_are_shown_as_they_are() {
    for (text, said, triangles) in [
        (cube("").replace("(-1, -1, -1)", "(nan, -1, -1)"), "not finite: control meshes are shown (1)", 12),
        (
            cube("int[] creaseIndices = [0, 1]\nint[] creaseLengths = [3]\nfloat[] creaseSharpnesses = [2]"),
            "creases that do not fit",
            192,
        ),
        (
            cube("int[] creaseIndices = [0, 1]\nint[] creaseLengths = [2]\nfloat[] creaseSharpnesses = [2, 2, 2]"),
            "creases that do not fit",
            192,
        ),
    ] {
        let d = read(&text);
        assert!(d.warnings.iter().any(|w| w.contains(said)), "{said}: {:?}", d.warnings);
        assert_eq!(d.meshes[0].triangles.len(), triangles, "{said}");
    }
    // Indices that point nowhere, and negative lengths, are no creases.
    let d = read(&cube(
        "int[] creaseIndices = [0, 99, -3, 1]\nint[] creaseLengths = [4, -7]\nfloat[] creaseSharpnesses = [2, 2]\nint[] cornerIndices = [-1, 88]\nfloat[] cornerSharpnesses = [3, 3]",
    ));
    assert_eq!(d.meshes[0].triangles.len(), 192);
}

#[test]
fn what_is_hidden_is_not_drawn_and_what_is_left_out_is_counted() {
    let d = read(&format!(
        "def Xform \"Hidden\" {{ token visibility = \"invisible\"\ndef Mesh \"a\" {{ {QUAD} }} }}\n\
        def Xform \"Proxy\" {{ uniform token purpose = \"proxy\"\ndef Mesh \"b\" {{ {QUAD} }}\ndef Mesh \"own\" {{ uniform token purpose = \"render\"\n{QUAD} }} }}\n\
        over \"Over\" {{ def Mesh \"c\" {{ {QUAD} }} }}\nclass \"_k\" {{ def Mesh \"d\" {{ {QUAD} }} }}\n\
        def Xform \"Off\" ( active = false ) {{ def Mesh \"e\" {{ {QUAD} }} }}\n\
        def Mesh \"shown\" {{ {QUAD} }}\ndef NurbsCurves \"x\" {{}}\ndef HermiteCurves \"y\" {{}}\ndef Points \"z\" {{}}\n\
        def Mesh \"broken\" {{ int[] faceVertexCounts = [3]\nint[] faceVertexIndices = [0, 1, 9]\npoint3f[] points = [(0, 0, 0)] }}\n\
        def Xform \"R\" ( references = @gone.usd@ ) {{}}"
    ));
    assert_eq!(d.objects.iter().map(|o| o.name.as_str()).collect::<Vec<_>>(), ["own", "shown"]);
    let all = d.warnings.join("\n");
    for part in ["NURBS and Hermite curves (2)", "points (1)", "faces do not fit", "gone.usd (no files here)"] {
        assert!(all.contains(part), "{part}: {all}");
    }
    let empty = load(b"#usda 1.0\ndef Xform \"A\" {}".to_vec(), "e.usda", &none).unwrap_err().to_string();
    assert!(empty.starts_with("e.usda: no surface") && empty.contains("a Mesh"), "{empty}");
}

#[test]
fn instancers_place_their_prototypes() {
    let d = read(&format!(
        "def Xform \"W\" {{ double3 xformOp:translate = (0, 0, 10)\nuniform token[] xformOpOrder = [\"xformOp:translate\"]\n\
        def PointInstancer \"I\" {{ rel prototypes = [</W/I/P/a>, </W/I/P/b>]\nint[] protoIndices = [0, 1, 0, 7]\n\
        point3f[] positions = [(1, 0, 0), (2, 0, 0), (3, 0, 0), (4, 0, 0)]\nquath[] orientations = [(1, 0, 0, 0), (0.7071, 0, 0, 0.7071), (1, 0, 0, 0), (1, 0, 0, 0)]\n\
        float3[] scales = [(1, 1, 1), (2, 2, 2), (1, 1, 1), (1, 1, 1)]\nint64[] invisibleIds = [2]\n\
        def Scope \"P\" {{ def Mesh \"a\" {{ {QUAD} }}\ndef Sphere \"b\" {{ double radius = 0.5\n\
        double3 xformOp:translate = (1, 0, 0)\nuniform token[] xformOpOrder = [\"xformOp:translate\"] }} }} }} }}"
    ));
    assert_eq!(d.objects.len(), 2);
    let Shape::Mesh { world_from_mesh, .. } = d.objects[0].shape else { panic!("a mesh") };
    assert!((world_from_mesh.transform_point3(Vec3::ZERO) - Vec3::new(1.0, 0.0, 10.0)).length() < 1e-5);
    // A turn of 90° about z sends the sphere's shift along x to y, twice as far.
    let Shape::Sphere(s) = d.objects[1].shape else { panic!("a sphere") };
    assert!((s.center - Vec3::new(2.0, 2.0, 10.0)).length() < 1e-3 && (s.radius - 1.0).abs() < 1e-3, "{s:?}");
    assert!(d.warnings.iter().any(|w| w.contains("prototypes that are not there (1)")), "{:?}", d.warnings);
    // By their own identifiers, which have 64 bits: one invisible, one not active.
    let d = read(
        "def PointInstancer \"I\" ( append inactiveIds = [5000000003] ) { rel prototypes = [</I/b>]\nint[] protoIndices = [0, 0, 0]\n\
        int64[] ids = [5000000001, 5000000002, 5000000003]\nint64[] invisibleIds = [5000000001]\n\
        point3f[] positions = [(1, 0, 0), (2, 0, 0), (3, 0, 0)]\ndef Sphere \"b\" { double radius = 0.5 } }",
    );
    let Shape::Sphere(s) = d.objects[0].shape else { panic!("a sphere") };
    assert!(d.objects.len() == 1 && (s.center - Vec3::X * 2.0).length() < 1e-6, "{s:?}");
    // An instancer among its own prototypes goes no deeper than is allowed.
    let text = "#usda 1.0\ndef PointInstancer \"I\" { rel prototypes = [</I>]\nint[] protoIndices = [0]\npoint3f[] positions = [(0, 0, 0)] }";
    assert!(load(text.into(), "i.usda", &none).unwrap_err().to_string().contains("instancers within instancers"));
}

#[test]
fn lights_have_their_luminance() {
    let d = read(
        "def RectLight \"r\" { float inputs:intensity = 3\nfloat inputs:exposure = 1\nfloat inputs:width = 2\nfloat inputs:height = 4 }\n\
        def RectLight \"n\" { float inputs:intensity = 80\nbool inputs:normalize = true\nfloat inputs:width = 2\nfloat inputs:height = 4 }\n\
        def SphereLight \"s\" { float inputs:radius = 0.25\nbool inputs:enableColorTemperature = true\nfloat inputs:colorTemperature = 3000 }\n\
        def SphereLight \"p\" { float inputs:radius = 0.25\nfloat intensity = 16\nbool treatAsPoint = true }\n\
        def SphereLight \"c\" { float inputs:radius = 0.25\nfloat inputs:shaping:cone:angle = 30 }\n\
        def DistantLight \"d\" { float inputs:intensity = 7\nfloat inputs:angle = 1\nbool inputs:normalize = true }\n\
        def DistantLight \"w\" { float inputs:intensity = 10\nfloat inputs:angle = 120 }\n\
        def DistantLight \"v\" { float inputs:intensity = 10\nfloat inputs:angle = 120\nbool inputs:normalize = true }\n\
        def DomeLight \"e\" { float inputs:intensity = 5\ncolor3f inputs:color = (1, 0.5, 0.25) }\n\
        def DiskLight \"k\" { }\ndef CylinderLight \"l\" { }",
    );
    let luminance = |name: &str| {
        let object = d.objects.iter().find(|o| o.name == name).unwrap_or_else(|| panic!("{name}"));
        let emission = d.materials[object.material as usize].emission.as_ref().unwrap();
        assert!(matches!(emission.radiance, EmissionColor::Constant(_)) && !emission.two_sided);
        emission.luminance(&[Vec2::ZERO; 2])
    };
    // Spectra of colours are fitted: within 1 %.
    for (name, nits) in [("r", 6.0), ("n", 10.0), ("s", 1.0), ("k", 1.0), ("l", 1.0)] {
        assert!((luminance(name) / nits - 1.0).abs() < 0.01, "{name}: {}", luminance(name));
    }
    // Rectangles shine along −z.
    let Shape::Mesh { mesh, .. } = d.objects[0].shape else { panic!("a mesh") };
    let [a, b, c] = d.meshes[mesh as usize].corners(0);
    assert!((b - a).cross(c - a).z < 0.0);
    let power = |name: &str| {
        let light = d.punctual.iter().find(|l| l.name == name).unwrap();
        (diopter_light::color::luminance(|nm| light.power.at(nm)) as f32, light.kind)
    };
    let (candela, kind) = power("p");
    assert!((candela / (16.0 * std::f32::consts::PI / 16.0) - 1.0).abs() < 0.01 && matches!(kind, PunctualKind::Point { .. }));
    assert!(matches!(power("c").1, PunctualKind::Spot { cos_outer, .. } if (cos_outer - 0.8660).abs() < 1e-3));
    let (lux, kind) = power("d");
    assert!(
        (lux / 7.0 - 1.0).abs() < 0.01
            && matches!(kind, PunctualKind::Disc { half_angle, .. } if (half_angle - 0.00873).abs() < 1e-4)
    );
    // Of its luminance, and of its illuminance, however wide it is.
    for (name, expected) in [("w", 10.0 * std::f32::consts::PI * 0.75), ("v", 10.0)] {
        assert!((power(name).0 / expected - 1.0).abs() < 0.01, "{name}: {}", power(name).0);
    }
    assert!((d.environment.as_ref().unwrap().mean_luminance() / (5.0 * (0.2126 + 0.3576 + 0.01805)) - 1.0).abs() < 0.01);
}

#[test]
fn cameras_that_say_their_aperture_have_pictures_of_its_shape() {
    let size = |text: &str| read(&format!("def Camera \"c\" {{ {text} }}\ndef Sphere \"s\" {{}}")).cameras[0].film.size;
    assert_eq!(size("float horizontalAperture = 36\nfloat verticalAperture = 20.25"), Some([960, 540]));
    assert_eq!(size("float horizontalAperture = 24\nfloat verticalAperture = 36"), Some([640, 960]));
    assert_eq!(size("float focalLength = 35"), None);
}

#[test]
fn domes_have_their_middle_at_plus_z() {
    // A map of four columns: left edge −z, then +x, the middle +z, then −x: a light at a quarter of the width.
    let mut pfm = b"PF\n8 4\n-1\n".to_vec();
    for row in 0..4 {
        for column in 0..8 {
            let v = if column == 2 && row == 1 { 100.0f32 } else { 0.0 };
            (0..3).for_each(|_| pfm.extend(v.to_le_bytes()));
        }
    }
    let fetch = move |name: &str| if name == "sky.pfm" { Ok(pfm.clone()) } else { Err("not there".to_owned()) };
    let text =
        format!("#usda 1.0\ndef DomeLight \"e\" {{ asset inputs:texture:file = @./sky.pfm@ }}\ndef Mesh \"m\" {{ {QUAD} }}");
    let d = load(text.into(), "s.usda", &fetch).unwrap();
    let environment = d.environment.unwrap();
    let at = |d: Vec3| environment.rgb(d.normalize()).x;
    assert!(at(Vec3::new(1.0, -0.4, 0.2)) < at(Vec3::new(1.0, 0.0, 0.4)) + 100.0);
    let brightest = [Vec3::X, Vec3::NEG_X, Vec3::Z, Vec3::NEG_Z]
        .map(|v| at(v + Vec3::Y * -0.2 + v.cross(Vec3::Y) * 0.2) + at(v - Vec3::Y * 0.2) + at(v + Vec3::Y * 0.4));
    assert!(brightest[0] > brightest[1] && brightest[0] > brightest[2] && brightest[0] > brightest[3], "{brightest:?}");
}

#[test]
fn cameras_have_their_angle_and_lens() {
    let camera = "def Camera \"c\" { float focalLength = 50\nfloat horizontalAperture = 36\nfloat verticalAperture = 24\nfloat fStop = 2\nfloat focusDistance = 300\n\
        double3 xformOp:translate = (100, 0, 0)\nfloat xformOp:rotateY = 90\nuniform token[] xformOpOrder = [\"xformOp:translate\", \"xformOp:rotateY\"] }\n\
        def Scope \"Render\" { def RenderSettings \"s\" { int2 resolution = (640, 360) } }";
    let text = format!("#usda 1.0\n( metersPerUnit = 0.01 )\n{camera}\ndef Mesh \"m\" {{ {QUAD} }}");
    let d = load(text.into(), "s.usda", &none).unwrap();
    let view = &d.cameras[0];
    assert!(
        matches!(view.sight, CameraProjection::Perspective { vertical_fov } if (vertical_fov - 2.0 * 0.24f32.atan()).abs() < 1e-5)
    );
    // 50 mm at f/2: 12.5 mm of radius; sharp at 3 m.
    let [radius, focus] = view.lens.unwrap();
    assert!((radius - 0.0125).abs() < 1e-6 && (focus - 3.0).abs() < 1e-5);
    // Made wider, as the picture is.
    let wide = (24.0 * 640.0 / 360.0f64).hypot(24.0);
    assert!((view.film.diagonal_mm.unwrap() - wide).abs() < 1e-9 && view.film.size == Some([640, 360]));
    let place = view.world_from_camera;
    assert!((place.transform_point3(Vec3::ZERO) - Vec3::X).length() < 1e-5);
    assert!((place.transform_vector3(Vec3::NEG_Z) - Vec3::NEG_X).length() < 1e-5);
    // Where the unit is a metre and the numbers are millimetres all the same.
    let d =
        load(format!("#usda 1.0\n( metersPerUnit = 1 )\n{camera}\ndef Mesh \"m\" {{ {QUAD} }}").into(), "s.usda", &none).unwrap();
    assert!((d.cameras[0].lens.unwrap()[0] - 0.0125).abs() < 1e-6);
    // 0, as where nothing is said: everything is sharp.
    for stop in ["float fStop = 0\n", ""] {
        let text = format!("#usda 1.0\n{}\ndef Mesh \"m\" {{ {QUAD} }}", camera.replace("float fStop = 2\n", stop));
        assert_eq!(load(text.into(), "s.usda", &none).unwrap().cameras[0].lens.unwrap()[0], 0.0);
    }
}

#[test]
fn a_picture_without_a_file_is_its_fallback() {
    let material = |fallback: &str| {
        let text = format!(
            "#usda 1.0\ndef Mesh \"m\" {{ {QUAD}\nrel material:binding = </M> }}\ndef Material \"M\" {{ token outputs:surface.connect = </M/S.outputs:surface>\n\
             def Shader \"S\" {{ token info:id = \"UsdPreviewSurface\"\ncolor3f inputs:emissiveColor.connect = </M/T.outputs:rgb>\ncolor3f inputs:diffuseColor.connect = </M/T.outputs:rgb> }}\n\
             def Shader \"T\" {{ token info:id = \"UsdUVTexture\"\n{fallback} }} }}"
        );
        load(text.into(), "t.usda", &none).unwrap().materials[0].clone()
    };
    let color = |material: &Material| {
        let Scattering::Principled(p) = &material.scattering else { panic!("a principled surface") };
        let Color::Constant { rgb, .. } = &p.base_color else { panic!("one colour") };
        *rgb
    };
    let dark = material("");
    assert!(dark.emission.is_none() && color(&dark).length() < 1e-6);
    let red = material("float4 inputs:fallback = (0.5, 0, 0, 1)");
    assert!((color(&red) - Vec3::new(0.5, 0.0, 0.0)).length() < 1e-3, "{}", color(&red));
}

#[test]
fn opacity_makes_holes_or_sheets() {
    let of = |inputs: &str| {
        let d = read(&format!(
            "def Mesh \"m\" {{ {QUAD}\nrel material:binding = </M> }}\n\
            def Material \"M\" {{ token outputs:surface.connect = </M/S.outputs:surface>\n\
            def Shader \"S\" {{ token info:id = \"UsdPreviewSurface\"\n{inputs} }} }}"
        ));
        d.materials[d.objects[0].material as usize].clone()
    };
    assert!(matches!(
        of("float inputs:opacity = 0.3\nfloat inputs:opacityThreshold = 0.5").coverage,
        Coverage::Mask { cutoff: 0.5, .. }
    ));
    assert!(matches!(
        of("float inputs:opacity = 0.3\ntoken inputs:opacityMode = \"presence\"").coverage,
        Coverage::Blend(Scalar::Constant(_))
    ));
    assert!(matches!(of("float inputs:opacity = 0.3").scattering, Scattering::Mix(_)));
    let glow = of("color3f inputs:emissiveColor = (2, 2, 2)").emission.unwrap().luminance(&[Vec2::ZERO; 2]);
    assert!((glow - 2.0).abs() < 0.02, "{glow}");
    let Scattering::Principled(p) =
        of("int inputs:useSpecularWorkflow = 1\ncolor3f inputs:specularColor = (0.04, 0.04, 0.04)").scattering
    else {
        panic!("a surface")
    };
    assert!(p.tinted && matches!(&p.specular_color, Color::Constant { rgb, .. } if (rgb.x - 1.0).abs() < 1e-3));
}

#[test]
fn displacement_moves_points_along_their_normals() {
    let material = |inputs: &str| {
        format!(
            "rel material:binding = </A/M>\ndef Material \"M\" {{ token outputs:surface.connect = </A/M/S.outputs:surface>\n\
            def Shader \"S\" {{ token info:id = \"UsdPreviewSurface\"\n{inputs} }}\n\
            def Shader \"T\" {{ token info:id = \"UsdUVTexture\"\nasset inputs:file = @a.png@\nfloat4 inputs:scale = (0.5, 0.5, 0.5, 1)\nfloat4 inputs:bias = (-0.25, 0, 0, 0)\n\
            token inputs:sourceColorSpace = \"raw\"\nfloat2 inputs:st.connect = </A/M/R.outputs:result> }}\n\
            def Shader \"R\" {{ token info:id = \"UsdPrimvarReader_float2\"\nstring inputs:varname = \"st\" }} }}"
        )
    };
    let uvs = "texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] ( interpolation = \"vertex\" )";
    let mesh = |scheme: &str, inputs: &str| {
        let quad = QUAD.replace("\"none\"", &format!("\"{scheme}\""));
        format!(
            "#usda 1.0\n( defaultPrim = \"A\"\n metersPerUnit = 1 )\ndef Mesh \"A\" {{ {quad}\n{uvs}\n{} }}",
            material(inputs)
        )
    };
    // The same everywhere: no edge is split.
    for (scheme, triangles) in [("none", 2), ("bilinear", 32)] {
        let d = load(mesh(scheme, "float inputs:displacement = 0.25").into(), "t.usda", &none).unwrap();
        assert_eq!(d.meshes[0].triangles.len(), triangles);
        assert!(d.warnings.is_empty() && d.meshes[0].positions.iter().all(|p| p.z == 0.25), "{:?}", d.warnings);
    }
    // By a picture, black on the left and white on the right: −¼ to ¼.
    let mut png = Vec::new();
    let ramp = image::GrayImage::from_fn(64, 1, |x, _| image::Luma([(x * 255 / 63) as u8]));
    ramp.write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png).unwrap();
    let text = mesh("bilinear", "float inputs:displacement.connect = </A/M/T.outputs:r>");
    let bytes = package::tests::archive(&[("a.usda", text.as_bytes()), ("a.png", &png)]);
    let d = load(bytes, "a.usdz", &none).unwrap();
    assert!(d.meshes[0].triangles.len() > 100_000, "{:?}", d.warnings);
    for p in d.meshes[0].positions.iter().filter(|p| (0.1..0.9).contains(&p.x)) {
        let expected = 0.5 * (p.x * 64.0 - 0.5) / 63.0 - 0.25;
        assert!((p.z - expected).abs() < 3e-3, "{p}: {expected}");
    }
}

#[test]
fn copies_at_other_times_are_other_meshes() {
    let points = "point3f[] points.timeSamples = { 0: [(0, 0, 0), (1, 0, 0), (1, 1, 0)], 10: [(0, 0, 0), (2, 0, 0), (2, 2, 0)] }";
    let still = "point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0)]";
    let meshes = |points: &str| {
        let file = format!(
            "#usda 1.0\n( defaultPrim = \"A\" )\ndef Xform \"A\" {{ def Mesh \"m\" {{ int[] faceVertexCounts = [3]\nint[] faceVertexIndices = [0, 1, 2]\nuniform token subdivisionScheme = \"none\"\n{points} }} }}"
        );
        let fetch = move |_: &str| Ok(file.clone().into_bytes());
        let text = "#usda 1.0\ndef \"X\" ( references = @a.usda@ ) {}\ndef \"Y\" ( references = @a.usda@ (offset = -10) ) {}\ndef \"Z\" ( references = @a.usda@ ) {}";
        load(text.into(), "t.usda", &fetch).unwrap().meshes.iter().map(|m| m.positions[1].x).collect::<Vec<_>>()
    };
    assert_eq!(meshes(points), [1.0, 2.0]);
    assert_eq!(meshes(still), [1.0]);
}

#[test]
fn pictures_fit_apertures_by_the_policy_of_their_settings() {
    let camera = "def Camera \"c\" { float focalLength = 50\nfloat horizontalAperture = 20\nfloat verticalAperture = 10 }";
    let view = |settings: &str, camera: &str| {
        let d = read(&format!("{camera}\ndef RenderSettings \"s\" {{ {settings} }}\ndef Mesh \"m\" {{ {QUAD} }}"));
        let CameraProjection::Perspective { vertical_fov } = d.cameras[0].sight else { panic!("a perspective") };
        (f64::from(vertical_fov), d.cameras[0].film.diagonal_mm.unwrap(), d.warnings.join("\n"))
    };
    // Heights of the aperture over its focal length, and its diagonal.
    for (policy, tangent, sides) in [
        ("", 0.4, [20.0, 20.0]),
        ("expandAperture", 0.4, [20.0, 20.0]),
        ("cropAperture", 0.2, [10.0, 10.0]),
        ("adjustApertureWidth", 0.2, [10.0, 10.0]),
        ("adjustApertureHeight", 0.4, [20.0, 20.0]),
        ("adjustPixelAspectRatio", 0.2, [20.0, 10.0]),
    ] {
        let said = if policy.is_empty() { String::new() } else { format!("token aspectRatioConformPolicy = \"{policy}\"\n") };
        let (fov, diagonal, warnings) = view(&format!("{said}int2 resolution = (64, 64)"), camera);
        assert!((fov - 2.0 * (0.5f64 * tangent).atan()).abs() < 1e-6, "{policy}: {fov}");
        assert!((diagonal - f64::hypot(sides[0], sides[1])).abs() < 1e-9, "{policy}: {diagonal}");
        assert_eq!(warnings.contains("pixels that are no squares"), policy == "adjustPixelAspectRatio");
    }
    // Wider than the aperture.
    let (fov, ..) = view("int2 resolution = (400, 100)", camera);
    assert!((fov - 2.0 * 0.1f64.atan()).abs() < 1e-6, "{fov}");
    // The frame a quarter of its width to the right and a tenth of its height below, whatever it is then made to be.
    let offsets = "float horizontalApertureOffset = 5\nfloat verticalApertureOffset = -1\nfloat focal";
    for (settings, shift) in [("", [0.5, -0.1]), ("int2 resolution = (64, 64)", [0.25, -0.05])] {
        let d = read(&format!(
            "{}\ndef RenderSettings \"s\" {{ {settings} }}\ndef Mesh \"m\" {{ {QUAD} }}",
            camera.replace("float focal", offsets)
        ));
        assert!((0..2).all(|k| (d.cameras[0].film.shift[k] - shift[k]).abs() < 1e-9), "{:?}", d.cameras[0].film.shift);
        assert!(d.warnings.is_empty(), "{:?}", d.warnings);
    }
}

#[test]
fn invisible_cameras_are_found_and_changes_of_visibility_told() {
    let d = read(&format!(
        "def Camera \"a\" {{ token visibility = \"invisible\" }}\n\
        def Xform \"g\" {{ token visibility = \"invisible\"\ndef Camera \"b\" {{}}\ndef Mesh \"hidden\" {{ {QUAD} }}\ndef SphereLight \"dark\" {{}} }}\n\
        def Mesh \"m\" {{ {QUAD} token visibility.timeSamples = {{ 0: \"inherited\", 10: \"invisible\" }} }}\n\
        def Mesh \"same\" {{ {QUAD} token visibility.timeSamples = {{ 0: \"inherited\", 10: \"inherited\" }} }}"
    ));
    assert_eq!(d.cameras.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(), ["a", "b"]);
    assert_eq!(d.objects.iter().map(|o| o.name.as_str()).collect::<Vec<_>>(), ["m", "same"]);
    assert!(d.warnings.iter().any(|w| w.contains("visibility that changes (1)")), "{:?}", d.warnings);
}

#[test]
fn solids_may_have_no_radius() {
    let d = read(
        "def Sphere \"none\" { double radius = 0 }\ndef Cylinder_1 \"c\" { double radiusTop = 0\ndouble radiusBottom = 1\ndouble height = 2 }",
    );
    assert_eq!(d.objects.len(), 1);
    let mesh = &d.meshes[0];
    let widest = |top: bool| {
        let at = mesh.positions.iter().filter(|p| (p.z > 0.0) == top);
        at.fold(0.0f32, |m, p| m.max(p.truncate().length()))
    };
    assert!(widest(true) < 1e-6 && (widest(false) - 1.0).abs() < 1e-6, "{} {}", widest(true), widest(false));
}

#[test]
fn without_a_surface_the_error_says_what_was_left_out() {
    let text = "#usda 1.0\ndef \"X\" ( references = @nofile.usda@ ) {}\ndef Points \"p\" {}";
    let e = load(text.into(), "t.usda", &none).unwrap_err().to_string();
    let expected =
        "t.usda: no surface; files that could not be read: nofile.usda (no files here); left out: points (1); expected a Mesh";
    assert!(e.starts_with(expected), "{e}");
}

#[test]
fn shaped_lights_fall_off_with_their_focus_and_cosine() {
    let d = read(&format!(
        "def SphereLight \"f\" {{ float inputs:shaping:focus = 2 }}\n\
        def SphereLight \"s\" {{ float inputs:shaping:cone:angle = 40\nfloat inputs:shaping:cone:softness = 0.5 }}\n\
        def SphereLight \"b\" {{ float inputs:shaping:cone:angle = 120 }}\n\
        def DiskLight \"k\" {{ float inputs:shaping:cone:angle = 30\nfloat inputs:diffuse = 0 }}\ndef Mesh \"m\" {{ {QUAD} }}"
    ));
    let at = |name: &str, degrees: f32| {
        let light = d.punctual.iter().find(|l| l.name == name).unwrap();
        let Spread::Web(web) = &light.pattern.as_ref().unwrap().spread else { panic!("a table") };
        let (sin, cos) = degrees.to_radians().sin_cos();
        web.candela(Vec3::new(0.0, sin, -cos)) / web.peak()
    };
    for (name, degrees, expected) in
        // A ball shines behind, too; softness is a smooth step over the angle (OpenUSD, `UsdLuxShapingAPI`).
        [
            ("f", 0.0, 1.0),
            ("f", 60.0, 0.25),
            ("f", 120.0, 0.25),
            ("s", 19.0, 1.0),
            ("s", 30.0, 0.5),
            ("s", 35.0, 0.15625),
            ("b", 110.0, 1.0),
            ("b", 130.0, 0.0),
            ("k", 20.0, 0.9397),
            ("k", 29.9, 0.8669),
            ("k", 31.0, 0.0),
        ]
    {
        assert!((at(name, degrees) - expected).abs() < 1e-3, "{name} {degrees}: {}", at(name, degrees));
    }
    let all = d.warnings.join("\n");
    assert!(all.contains("diffuse and specular factors of lights (1)") && all.contains("a focus (4)"), "{all}");
}

#[test]
fn meshes_can_be_lights() {
    let mesh = |more: &str| {
        let d = read(&format!(
            "def Mesh \"m\" ( prepend apiSchemas = [\"MeshLightAPI\"] ) {{ {QUAD}float inputs:intensity = 3\nfloat inputs:exposure = 1\n{more} }}\n\
            def Material \"M\" {{ token outputs:surface.connect = </M/S.outputs:surface>\ndef Shader \"S\" {{ token info:id = \"UsdPreviewSurface\"\n\
            color3f inputs:emissiveColor = (0.5, 0.5, 0.5) }} }}"
        ));
        let material = d.materials[d.objects[0].material as usize].clone();
        let emission = material.emission.as_ref().expect("it shines");
        assert!(!emission.two_sided && emission.is_light);
        (emission.luminance(&[Vec2::ZERO; 2]), matches!(material.scattering, Scattering::Black))
    };
    let close = |found: (f32, bool), nits: f32, black: bool| {
        assert!((found.0 / nits - 1.0).abs() < 0.01 && found.1 == black, "{found:?} {nits}");
    };
    close(mesh(""), 6.0, false);
    close(mesh("rel material:binding = </M>"), 3.0, false);
    close(mesh("rel material:binding = </M>\nuniform token light:materialSyncMode = \"independent\""), 6.0, false);
    close(mesh("rel material:binding = </M>\nuniform token light:materialSyncMode = \"noMaterialResponse\""), 6.0, true);
}

#[test]
fn what_stays_as_it_is_at_the_first_time_is_told() {
    let light = "def SphereLight \"l\" { float inputs:intensity.timeSamples = { 0: 1, 24: 5 } }\n";
    for (what, told) in [
        ("def Sphere \"s\" { double radius.timeSamples = { 0: 1, 24: 2 } }", "sizes of solids that change (1)"),
        (light, "lights that change by themselves (1)"),
        (
            "def Xform \"x\" { double xformOp:translateX.spline = { 0: 0; post linear, 24: 10 }\nuniform token[] xformOpOrder = [\"xformOp:translateX\"] }",
            "motion by splines (1)",
        ),
        ("def Mesh \"v\" { vector3f[] velocities = [(1, 0, 0)] }", "velocities of points (1)"),
        (
            "def DomeLight \"d\" { asset inputs:texture:file = @a.exr@\ntoken inputs:texture:format = \"angular\" }",
            "formats of dome pictures",
        ),
        ("def SphereLight \"k\" { rel light:filters = </a> }", "filters of lights (1)"),
    ] {
        let d = read(&format!("def Mesh \"q\" {{ {QUAD} }}\n{what}"));
        assert!(d.warnings.iter().any(|w| w.contains(told)), "{told}: {:?}", d.warnings);
    }
    let text = format!("#usda 1.0\n( metersPerUnit = 1\n relocates = {{ </A/b> : </A/c> }} )\ndef Mesh \"q\" {{ {QUAD} }}");
    let d = load(text.into(), "t.usda", &|_| Err("no files here".to_owned())).unwrap();
    assert!(d.warnings.iter().any(|w| w.contains("relocates (1)")), "{:?}", d.warnings);
}

#[test]
fn a_block_among_samples_holds_what_was_before() {
    let d = read(&format!(
        "def Xform \"x\" {{ double3 xformOp:translate.timeSamples = {{ 0: (0, 0, 0), 12: None, 24: (0, 8, 0) }}\n\
        uniform token[] xformOpOrder = [\"xformOp:translate\"]\ndef Mesh \"q\" {{ {QUAD} }} }}"
    ));
    let channel = d.animations[0].channels.iter().find(|c| c.property == crate::motion::AnimatedProperty::Translation).unwrap();
    assert_eq!(channel.values.iter().skip(1).step_by(3).copied().collect::<Vec<f32>>(), [0.0, 0.0, 0.0, 8.0]);
    assert!((channel.times_s[2] - 1.0).abs() < 1e-3, "{:?}", channel.times_s);
}
