//! What materials, colours and bindings become.

use super::tests::{QUAD, read};
use super::*;
use crate::material::{Coverage, Material, Scattering};
use crate::texture::{Color, Scalar};
use glam::{Vec2, Vec3};

const UVS: &str = "texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] ( interpolation = \"vertex\" )\n";

/// A material of one surface, and of what stands beside that.
fn material(name: &str, inputs: &str, others: &str) -> String {
    format!(
        "def Material \"{name}\" {{ token outputs:surface.connect = </{name}/S.outputs:surface>\n\
        def Shader \"S\" {{ token info:id = \"UsdPreviewSurface\"\n{inputs} }}\n{others} }}\n"
    )
}

/// A picture of two pixels, black and half red, and a surface of which an input is that picture.
fn pictured(input: &str, output: &str, texture: &str) -> Description {
    let shader = format!(
        "def Shader \"T\" {{ token info:id = \"UsdUVTexture\"\nasset inputs:file = @a.png@\ntoken inputs:sourceColorSpace = \"raw\"\n{texture} }}"
    );
    let body = material("M", &format!("{input}.connect = </M/T.outputs:{output}>"), &shader);
    let text = format!("#usda 1.0\n( metersPerUnit = 1 )\ndef Mesh \"m\" {{ {QUAD}{UVS}rel material:binding = </M> }}\n{body}");
    let mut png = Vec::new();
    let image = image::RgbImage::from_fn(2, 1, |x, _| image::Rgb([51 * x as u8, 102 * x as u8, 255]));
    image.write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png).unwrap();
    let fetch = move |name: &str| if name == "a.png" { Ok(png.clone()) } else { Err("not there".to_owned()) };
    load(text.into(), "t.usda", &fetch).unwrap()
}

fn material_of<'a>(d: &'a Description, name: &str) -> &'a Material {
    let object = d.objects.iter().find(|o| o.name == name).unwrap_or_else(|| panic!("{name}"));
    &d.materials[object.material as usize]
}

fn color(material: &Material) -> Vec3 {
    let color = match &material.scattering {
        Scattering::Principled(p) => &p.base_color,
        Scattering::Diffuse(color) => color,
        other => panic!("{other:?}"),
    };
    let Color::Constant { rgb, .. } = color else { panic!("one colour, not {color:?}") };
    *rgb
}

#[test]
fn scales_below_0_invert_channels_of_normal_maps() {
    let at = |texture: &str| {
        let d = pictured("normal3f inputs:normal", "rgb", texture);
        let (map, strength) = d.materials[0].normal_map.clone().unwrap();
        (map.at(&[Vec2::new(0.75, 0.5); 2]).truncate(), strength)
    };
    let usual = at("float4 inputs:scale = (2, 2, 2, 1)\nfloat4 inputs:bias = (-1, -1, -1, 0)");
    assert!((usual.0 - Vec3::new(0.2, 0.4, 1.0)).length() < 1e-5 && usual.1 == 1.0, "{usual:?}");
    let flipped = at("float4 inputs:scale = (2, -2, 2, 1)\nfloat4 inputs:bias = (-1, 1, -1, 0)");
    assert!((flipped.0 - Vec3::new(0.2, 0.6, 1.0)).length() < 1e-5 && flipped.1 == 1.0, "{flipped:?}");
}

#[test]
fn pictures_shine_with_their_bias_and_by_channel() {
    let nits = |output: &str, texture: &str| {
        let d = pictured("color3f inputs:emissiveColor", output, texture);
        let emission = d.materials[0].emission.clone().expect("it shines");
        [0.25, 0.75].map(|u| emission.luminance(&[Vec2::new(u, 0.5); 2]))
    };
    // Luminances of linear sRGB (IEC 61966-2-1).
    let y = |rgb: Vec3| rgb.dot(Vec3::new(0.2126, 0.7152, 0.0722));
    for (output, texture, expected) in [
        ("rgb", "float4 inputs:bias = (0.5, 0.5, 0.5, 0)", [y(Vec3::new(0.5, 0.5, 1.5)), y(Vec3::new(0.7, 0.9, 1.5))]),
        ("g", "float4 inputs:scale = (2, 2, 2, 1)", [0.0, 0.8]),
        ("b", "", [1.0, 1.0]),
    ] {
        let found = nits(output, texture);
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 0.01, "{output} {texture}: {found} {expected}");
        }
    }
}

#[test]
fn prototypes_have_the_materials_of_what_is_around_them_and_colors_of_their_instances() {
    let red = material("M", "color3f inputs:diffuseColor = (1, 0, 0)", "");
    let instancer = |inside: &str, around: &str| {
        read(&format!(
            "def PointInstancer \"I\" {{ point3f[] positions = [(0, 0, 0), (3, 0, 0)]\nint[] protoIndices = [0, 0]\n\
            rel prototypes = </I/P/q>\n{inside}\ndef Scope \"P\" {{ {around}\ndef Mesh \"q\" {{ {QUAD} }} }} }}\n{red}"
        ))
    };
    let d = instancer("", "rel material:binding = </M>");
    assert_eq!(d.objects.len(), 2);
    assert!(d.objects.iter().all(|o| color(&d.materials[o.material as usize]) == Vec3::X));
    let colors = |d: &Description| d.objects.iter().map(|o| color(&d.materials[o.material as usize])).collect::<Vec<_>>();
    for interpolation in ["vertex", "varying"] {
        let d = instancer(
            &format!("color3f[] primvars:displayColor = [(1, 0, 0), (0, 0, 1)] ( interpolation = \"{interpolation}\" )"),
            "",
        );
        assert_eq!(colors(&d), [Vec3::X, Vec3::Z]);
        // They share their mesh.
        assert_eq!(d.meshes.len(), 1);
    }
    let d = instancer("color3f[] primvars:displayColor = [(0, 1, 0)]\nint[] primvars:displayColor:indices = [0, 0]", "");
    assert_eq!(colors(&d), [Vec3::Y; 2]);
    // Indexed ones; a colour nearer to the prototype comes first.
    let many = "color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (0, 0, 1)] ( interpolation = \"vertex\" )\nint[] primvars:displayColor:indices = [2, 1]";
    assert_eq!(colors(&instancer(many, "")), [Vec3::Z, Vec3::Y]);
    assert_eq!(colors(&instancer(many, "color3f[] primvars:displayColor = [(1, 1, 0)]")), [Vec3::new(1.0, 1.0, 0.0); 2]);
    let d = instancer("color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (0, 0, 1)] ( interpolation = \"vertex\" )", "");
    assert!(d.warnings.iter().any(|w| w.contains("colours that do not fit their instances (1)")), "{:?}", d.warnings);
}

#[test]
fn readers_of_display_colors_get_those_from_around_or_their_fallback() {
    let reader = |fallback: &str| {
        let reader = format!(
            "def Shader \"C\" {{ token info:id = \"UsdPrimvarReader_float3\"\nstring inputs:varname = \"displayColor\"\n{fallback} }}"
        );
        material("M", "color3f inputs:diffuseColor.connect = </M/C.outputs:result>", &reader)
    };
    let one = |around: &str, fallback: &str| {
        let d = read(&format!(
            "def Xform \"g\" {{ {around}\ndef Mesh \"m\" {{ {QUAD}rel material:binding = </M> }}\ndef Sphere \"s\" {{ rel material:binding = </M> }} }}\n{}",
            reader(fallback)
        ));
        let found = color(material_of(&d, "m"));
        assert_eq!(found, color(material_of(&d, "s")));
        found
    };
    assert_eq!(one("color3f[] primvars:displayColor = [(1, 0, 0)]", ""), Vec3::X);
    assert_eq!(one("", "float3 inputs:fallback = (0, 1, 0)"), Vec3::Y);
    assert_eq!(one("", ""), Vec3::ZERO);
    // Those of the mesh itself are colours of its vertices.
    let d = read(&format!(
        "def Mesh \"m\" {{ {QUAD}rel material:binding = </M>\ncolor3f[] primvars:displayColor = [(0, 0, 1)] }}\n{}",
        reader("")
    ));
    assert_eq!((color(material_of(&d, "m")), d.meshes[0].colors[0].truncate()), (Vec3::ONE, Vec3::Z));
    assert_eq!(d.materials.len(), 1);
}

#[test]
fn collections_are_bound_to_materials() {
    let materials = [("R", "(1, 0, 0)"), ("G", "(0, 1, 0)"), ("B", "(0, 0, 1)")]
        .map(|(name, rgb)| material(name, &format!("color3f inputs:diffuseColor = {rgb}"), ""))
        .concat();
    let of = |collection: &str| {
        let d = read(&format!(
            "def Xform \"g\" {{ rel material:binding = </B>\n{collection}\nrel material:binding:collection:red = [</g.collection:red>, </R>]\n\
            def Mesh \"a\" {{ {QUAD}def Mesh \"inner\" {{ {QUAD} }} }}\ndef Mesh \"b\" {{ {QUAD} }}\ndef Mesh \"own\" {{ {QUAD}rel material:binding = </G> }} }}\n{materials}"
        ));
        assert!(d.warnings.iter().all(|w| w.contains("path expressions")), "{:?}", d.warnings);
        let names = ["a", "inner", "b", "own"].map(|name| color(material_of(&d, name)));
        names.map(|c| ["R", "G", "B"][[c.x, c.y, c.z].iter().position(|v| *v == 1.0).unwrap()]).concat()
    };
    let explicit = "uniform token collection:red:expansionRule = \"explicitOnly\"\n";
    assert_eq!(of("rel collection:red:includes = </g/a>"), "RRBG");
    assert_eq!(of("rel collection:red:includes = </g>\nrel collection:red:excludes = </g/a/inner>"), "RBRG");
    assert_eq!(of(&format!("{explicit}rel collection:red:includes = [</g/a>, </g/b>]")), "RBRG");
    assert_eq!(of("rel collection:red:includes = </g.collection:more>\nrel collection:more:includes = </g/b>"), "BBRG");
    assert_eq!(of("rel collection:red:includes = </g.collection:red>"), "BBBG");
    // Twelve that include each other come to an end.
    let all: Vec<String> = (0..12).map(|i| format!("</g.collection:c{i}>")).collect();
    let each = |i: i32| format!("rel collection:c{i}:includes = [{}]\n", all.join(", "));
    assert_eq!(of(&format!("rel collection:red:includes = {}\n{}", all[0], (0..12).map(each).collect::<String>())), "BBBG");
    assert_eq!(of("pathExpression collection:red:membershipExpression = \"/g//\""), "BBBG");
    // Stronger than descendants, and the first of two by name.
    let d = read(&format!(
        "def Xform \"g\" {{ rel collection:c:includes = </g>\nrel material:binding:collection:z = [</g.collection:c>, </R>]\n\
        rel material:binding:collection:y = [</g.collection:c>, </G>] ( bindMaterialAs = \"strongerThanDescendants\" )\n\
        def Mesh \"m\" {{ {QUAD}rel material:binding = </B>\n\
        def GeomSubset \"half\" {{ uniform token familyName = \"materialBind\"\nint[] indices = [0]\nrel material:binding = </B> }} }} }}\n{materials}"
    ));
    assert_eq!(color(material_of(&d, "m")), Vec3::Y);
}

#[test]
fn display_opacity_counts_without_a_material() {
    let d = read(&format!(
        "def Xform \"g\" {{ float[] primvars:displayOpacity = [0.25]\ndef Mesh \"m\" {{ {QUAD}color3f[] primvars:displayColor = [(1, 0, 0)] }}\n\
        def Mesh \"solid\" {{ {QUAD}float[] primvars:displayOpacity = [1] }}\ndef Mesh \"bound\" {{ {QUAD}rel material:binding = </M> }} }}\n{}",
        material("M", "", "")
    ));
    let m = material_of(&d, "m");
    assert!(matches!(m.coverage, Coverage::Blend(Scalar::Constant(0.25))) && color(m) == Vec3::X);
    assert!(["solid", "bound"].iter().all(|n| matches!(material_of(&d, n).coverage, Coverage::Full)));
    assert!(d.warnings.iter().any(|w| w.contains("display opacities of what has a material (1)")), "{:?}", d.warnings);
    let d = read(&format!(
        "def Mesh \"m\" {{ {QUAD}float[] primvars:displayOpacity = [0, 1, 1, 1] ( interpolation = \"vertex\" ) }}"
    ));
    assert!(d.warnings.iter().any(|w| w.contains("opacities that differ within a mesh (1)")), "{:?}", d.warnings);
}

#[test]
fn packages_are_looked_into_by_relative_paths() {
    let mut png = Vec::new();
    image::RgbImage::new(1, 1).write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png).unwrap();
    let model =
        format!("#usda 1.0\n( defaultPrim = \"A\"\n metersPerUnit = 1 )\ndef Xform \"A\" {{ def Mesh \"q\" {{ {QUAD} }} }}");
    let package = package::tests::archive(&[("model.usda", model.as_bytes()), ("t/a.png", &png)]);
    let outer = package::tests::archive(&[("first.usda", b"#usda 1.0\n"), ("in/model.usdz", &package)]);
    let fetch = move |name: &str| match name {
        "x/model.usdz" => Ok(package.clone()),
        "outer.usdz" => Ok(outer.clone()),
        _ => Err("not there".to_owned()),
    };
    let picture = |file: &str| {
        let shader = format!("def Shader \"T\" {{ token info:id = \"UsdUVTexture\"\nasset inputs:file = @{file}@ }}");
        material("M", "color3f inputs:diffuseColor.connect = </M/T.outputs:rgb>", &shader)
    };
    let text = format!(
        "#usda 1.0\n( metersPerUnit = 1 )\ndef \"R\" ( references = @x/model.usdz[model.usda]@ ) {{}}\n\
        def \"P\" ( payload = @./outer.usdz[in/model.usdz[model.usda]]@ ) {{}}\ndef \"W\" ( references = @x/model.usdz@ ) {{}}\n\
        def Mesh \"m\" {{ {QUAD}rel material:binding = </M> }}\n{}",
        picture("outer.usdz[in/model.usdz[t/a.png]]")
    );
    let d = load(text.into(), "t.usda", &fetch).unwrap();
    assert!(d.warnings.is_empty() && d.missing_textures.is_empty(), "{:?} {:?}", d.warnings, d.missing_textures);
    assert_eq!(d.objects.iter().filter(|o| o.name == "q").count(), 3);
    for (file, reason) in [("x/model.usdz[b.png]", "it is not in x/model.usdz"), ("gone.usdz[b.png]", "not there")] {
        let text = format!("#usda 1.0\ndef Mesh \"m\" {{ {QUAD}rel material:binding = </M> }}\n{}", picture(file));
        let d = load(text.into(), "t.usda", &fetch).unwrap();
        assert_eq!((d.missing_textures[0].name.as_str(), d.missing_textures[0].reason.as_str()), (file, reason));
    }
}

#[test]
fn a_material_for_the_final_picture_counts_before_a_nearer_one_for_all() {
    let materials = [("R", "(1, 0, 0)"), ("G", "(0, 1, 0)")]
        .map(|(name, rgb)| material(name, &format!("color3f inputs:diffuseColor = {rgb}"), ""))
        .concat();
    let of = |outer: &str, own: &str| {
        let d = read(&format!("def Xform \"g\" {{ {outer}\ndef Mesh \"m\" {{ {QUAD}{own} }} }}\n{materials}"));
        color(material_of(&d, "m"))
    };
    let bind = |purpose: &str, to: &str| format!("rel material:binding{purpose} = </{to}>");
    assert_eq!(of(&bind(":full", "G"), &bind("", "R")), Vec3::Y);
    assert_eq!(of(&bind("", "G"), &bind(":full", "R")), Vec3::X);
    assert_eq!(of(&bind("", "G"), &bind("", "R")), Vec3::X);
    assert_eq!(of(&bind(":preview", "G"), ""), Vec3::Y);
}

#[test]
fn subsets_of_other_families_are_no_parts_of_materials() {
    let materials = [("R", "(1, 0, 0)"), ("G", "(0, 1, 0)")]
        .map(|(name, rgb)| material(name, &format!("color3f inputs:diffuseColor = {rgb}"), ""))
        .concat();
    for (family, parts) in
        [("uniform token familyName = \"materialBind\"\n", 0), ("uniform token familyName = \"other\"\n", 1), ("", 1)]
    {
        let d = read(&format!(
            "def Mesh \"m\" {{ {QUAD}rel material:binding = </R>\ndef GeomSubset \"s\" {{ {family}int[] indices = [0]\nrel material:binding = </G> }} }}\n{materials}"
        ));
        let red = d.objects.iter().filter(|o| color(&d.materials[o.material as usize]) == Vec3::X).count();
        assert_eq!((red, d.objects.len()), (parts, 1), "{family}");
    }
}

#[test]
fn coordinates_of_three_numbers_lose_the_third() {
    let shader = "def Shader \"T\" { token info:id = \"UsdUVTexture\"\nasset inputs:file = @a.png@ }";
    let body = material("M", "color3f inputs:diffuseColor.connect = </M/T.outputs:rgb>", shader);
    let uvs = "texCoord3f[] primvars:st = [(0, 0, 7), (1, 0, 7), (1, 1, 7), (0, 1, 7)] ( interpolation = \"vertex\" )\n";
    let text = format!("#usda 1.0\n( metersPerUnit = 1 )\ndef Mesh \"m\" {{ {QUAD}{uvs}rel material:binding = </M> }}\n{body}");
    let mut png = Vec::new();
    image::RgbImage::new(1, 1).write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png).unwrap();
    let d = load(text.into(), "t.usda", &move |_| Ok(png.clone())).unwrap();
    assert_eq!(d.meshes[0].uvs[0], [Vec2::new(0.0, 1.0), Vec2::ONE, Vec2::new(1.0, 0.0), Vec2::ZERO]);
}

#[test]
fn specular_colours_of_metals_are_their_reflectance() {
    let f0 = |inputs: &str| {
        let d = read(&format!(
            "def Mesh \"m\" {{ {QUAD}rel material:binding = </M> }}\n{}",
            material("M", &format!("int inputs:useSpecularWorkflow = 1\n{inputs}"), "")
        ));
        let Scattering::Principled(p) = &material_of(&d, "m").scattering else { panic!("a principled surface") };
        assert!(p.tinted);
        p.specular_color.constant_rgb().unwrap() * ((p.ior - 1.0) / (p.ior + 1.0)).powi(2)
    };
    for (inputs, expected) in [
        ("color3f inputs:specularColor = (0.5, 0.4, 0.3)", Vec3::new(0.5, 0.4, 0.3)),
        ("color3f inputs:specularColor = (0.02, 0.04, 0.01)", Vec3::new(0.02, 0.04, 0.01)),
        ("color3f inputs:specularColor = (0.1, 0.1, 0.1)\nfloat inputs:ior = 3", Vec3::splat(0.1)),
        ("color3f inputs:specularColor = (1, 0.71, 0.29)", Vec3::new(1.0, 0.71, 0.29)),
    ] {
        assert!((f0(inputs) - expected).length() < 1e-3, "{inputs}: {}", f0(inputs));
    }
}
