//! pbrt-v4 scenes: what is read, and what is refused.

use diopter_light::random::{Sampler, SamplerKind};
use diopter_light::spectrum::Table;
use diopter_light::wavelength::WavelengthSampler;
use diopter_light::{Ray, SampledSpectrum};
use diopter_scene::load::pbrt;
use diopter_scene::material::Scattering;
use diopter_scene::scene::Viewpoint;
use diopter_scene::texture::Color;
use diopter_scene::{Description, PathSettings, Scene, Shape};
use glam::{Vec2, Vec3};
use std::collections::HashMap;

fn load_with(text: &str, files: &[(&str, &[u8])]) -> Result<Description, String> {
    let files: HashMap<&str, &[u8]> = files.iter().copied().collect();
    let fetch = |name: &str| files.get(name).map(|b| b.to_vec()).ok_or_else(|| "there is no such file".to_owned());
    pbrt::load(text.as_bytes(), "test.pbrt", &fetch).map_err(|e| e.to_string())
}

fn load(text: &str) -> Description {
    load_with(text, &[]).unwrap_or_else(|e| panic!("{e}"))
}

/// Luminance (cd/m²) along a ray, averaged over samples.
fn luminance(scene: &Scene, ray: Ray, samples: u32) -> f64 {
    let y = diopter_light::cie::observer().y.scaled(diopter_light::units::LUMINOUS_EFFICACY as f32);
    let curves: [Table; 1] = [y];
    let wavelengths = WavelengthSampler::for_bands(&curves);
    let mut sum = 0.0;
    for i in 0..samples {
        let sampler = Sampler::new(SamplerKind::Sobol, 1, (0, 0), i, samples);
        let [w, ..] = sampler.get(diopter_light::random::Dimensions::Time);
        let drawn = wavelengths.sample(w);
        let light: SampledSpectrum = scene.radiance(ray, &drawn, &sampler, &PathSettings::default()) * drawn.weight;
        let nm = drawn.nm.to_array();
        sum += light.to_array().iter().zip(nm).map(|(l, nm)| f64::from(l * curves[0].at(nm))).sum::<f64>();
    }
    sum / f64::from(samples)
}

/// The ray through a place of the picture, −1 to 1 across and up, of a square picture.
fn through(view: &Viewpoint, x: f32, y: f32) -> Ray {
    let tan = (0.5 * view.vertical_fov().unwrap()).tan();
    let m = view.world_from_camera;
    let direction = m.transform_vector3(Vec3::new(x * tan, y * tan, -1.0)).normalize();
    Ray { origin: m.translation.into(), direction, time_s: 0.0 }
}

const HEAD: &str = "Film \"rgb\" \"integer xresolution\" 100 \"integer yresolution\" 100\nLookAt 0 0 0  0 0 1  0 1 0\nCamera \"perspective\" \"float fov\" 90\n";

#[test]
fn what_pbrt_does_not_know_is_an_error_or_told() {
    let error = |text: &str| load_with(text, &[]).unwrap_err();
    let ball = "WorldBegin Shape \"sphere\"";
    for (text, told) in [
        (format!("Sampler \"sobbol\" {HEAD}{ball}"), "did you mean \"sobol\"?"),
        (format!("Integrator \"pth\" {HEAD}{ball}"), "did you mean \"path\"?"),
        (format!("PixelFilter \"zzz\" {HEAD}{ball}"), "one of box, gaussian"),
        (format!("{HEAD}{ball} LightSource \"infinite\" \"float L\" 1"), "\"float L\""),
        (format!("{HEAD}WorldBegin AreaLightSource \"diffuse\" \"float L\" 1 Shape \"sphere\""), "\"float L\""),
        (
            format!(
                "{HEAD}WorldBegin AreaLightSource \"diffuse\" \"rgb L\" [1 1 1] \"string filename\" \"a.pfm\" Shape \"sphere\""
            ),
            "L and filename",
        ),
        (
            format!("{HEAD}WorldBegin Material \"diffuse\" \"spectrum reflectance\" \"stdillum-F12x\" Shape \"sphere\""),
            "known by name",
        ),
    ] {
        let found = error(&text);
        assert!(found.contains(told), "{text}: {found}");
    }
    // A file may be called like one of pbrt's own.
    let own = format!("{HEAD}WorldBegin Material \"diffuse\" \"spectrum reflectance\" \"metal-own.spd\" Shape \"sphere\"");
    assert!(load_with(&own, &[("metal-own.spd", b"400 0.5 700 0.5")]).is_ok());
    let warned = |text: &str| load(text).warnings.join("; ");
    let film = HEAD.replace("\"integer yresolution\" 100", "\"integer yresolution\" 50 \"float bogus\" 3");
    let told = warned(&format!("Integrator \"path\" \"integer maxdpth\" 3 {film}{ball}"));
    assert!(told.contains("\"float bogus\"") && told.contains("\"integer maxdpth\""), "{told}");
    assert!(!told.contains("square"), "{told}");
    let told = warned(&format!("{} \"float frameaspectratio\" 1 {ball}", film.trim_end()));
    assert!(told.contains("1.000 : 1 on a film of 100 x 50"), "{told}");
    let told = warned(&format!(
        "{HEAD}WorldBegin ActiveTransform EndTime Translate 1 0 0 LightSource \"point\" ActiveTransform All Shape \"sphere\""
    ));
    assert!(told.contains("a light that moves"), "{told}");
    for (crop, told) in [
        ("\"float cropwindow\" [0.5 0.5 0 1]", "with pixels between them"),
        ("\"float cropwindow\" [0 1]", "left, right, top, bottom"),
        ("\"integer pixelbounds\" [100 200 0 9]", "with pixels between them"),
    ] {
        let found = error(&format!("{}{ball}", HEAD.replace("\"rgb\"", &format!("\"rgb\" {crop}"))));
        assert!(found.contains(told), "{crop}: {found}");
    }
}

#[test]
fn tangents_of_triangles_are_those_of_the_file() {
    let quad = |s: &str| {
        format!("{HEAD}WorldBegin Shape \"trianglemesh\" \"point3 P\" [0 0 2  1 0 2  0 1 2] \"point2 uv\" [0 0 1 0 0 1] {s}")
    };
    let d = load(&quad("\"vector3 S\" [0 2 0  0 1 0  0 1 0]"));
    assert!(d.warnings.is_empty(), "{:?}", d.warnings);
    assert_eq!(d.meshes[0].tangents, [Vec3::Y.extend(1.0); 3]);
    assert!(load(&quad("")).meshes[0].tangents.is_empty());
    assert!(load_with(&quad("\"vector3 S\" [0 2 0]"), &[]).unwrap_err().contains("1 tangents (S) for 3 points"));
}

#[test]
fn light_of_scale_one_has_one_candela_a_square_metre() {
    // A wall of light ahead; every way of saying 1.
    for l in ["", "\"rgb L\" [1 1 1]", "\"blackbody L\" 4000", "\"spectrum L\" \"stdillum-A\"", "\"spectrum L\" [400 7 700 30]"] {
        let text = format!(
            "{HEAD}WorldBegin AreaLightSource \"diffuse\" {l} \"float scale\" 3 \"bool twosided\" true\n\
             Shape \"bilinearmesh\" \"point3 P\" [-9 -9 2  9 -9 2  -9 9 2  9 9 2]"
        );
        let scene = Scene::build(load(&text)).unwrap();
        let seen = luminance(&scene, through(&scene.description().cameras[0], 0.1, 0.2), 512);
        assert!((seen / 3.0 - 1.0).abs() < 0.01, "{l}: {seen}");
    }
}

#[test]
fn pictures_are_upright_whichever_hand_the_world_is_of() {
    // A lamp to the right and above, in a left-handed world and, mirrored, in a right-handed one.
    let lamp = "AreaLightSource \"diffuse\" \"bool twosided\" true Translate 1 1 3 Shape \"sphere\" \"float radius\" 0.5";
    for head in [HEAD.to_owned(), HEAD.replace("LookAt", "Scale -1 1 1\nLookAt")] {
        let mirrored = head.contains("Scale");
        let text = format!("{head}WorldBegin {}", if mirrored { lamp.replace("1 1 3", "-1 1 3") } else { lamp.into() });
        let scene = Scene::build(load(&text)).unwrap();
        let view = &scene.description().cameras[0];
        assert!(view.world_from_camera.matrix3.determinant() > 0.99);
        let sees = |x: f32, y: f32| luminance(&scene, through(view, x, y), 8) > 0.1;
        assert!(sees(0.33, 0.33) && !sees(-0.33, 0.33) && !sees(0.33, -0.33), "{mirrored}");
    }
}

#[test]
fn transforms_blocks_and_instances_put_things_where_they_belong() {
    let text = format!(
        "{HEAD}WorldBegin\n\
         ObjectBegin \"tile\" Translate 0 0 1 Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] ObjectEnd\n\
         AttributeBegin Translate 5 0 0 Scale 2 2 2 ObjectInstance \"tile\" AttributeEnd\n\
         Rotate 90 0 0 1 ObjectInstance \"tile\"\n\
         CoordinateSystem \"here\" Identity Translate 7 0 0 CoordSysTransform \"here\"\n\
         Shape \"trianglemesh\" \"point3 P\" [1 0 0 2 0 0 1 1 0]"
    );
    let d = load(&text);
    // The world was mirrored: its camera is left-handed.
    let corner = |i: usize| match d.objects[i].shape {
        Shape::Mesh { mesh, world_from_mesh } => world_from_mesh.transform_point3(d.meshes[mesh as usize].positions[1]),
        _ => panic!("a mesh"),
    };
    let near = |a: Vec3, b: Vec3| assert!((a - b).length() < 1e-5, "{a} {b}");
    near(corner(0), Vec3::new(7.0, 0.0, -2.0));
    near(corner(1), Vec3::new(0.0, 1.0, -1.0));
    near(corner(2), Vec3::new(0.0, 2.0, 0.0));
    assert_eq!(d.meshes.len(), 2);
}

#[test]
fn emission_goes_where_the_outside_is() {
    // Corners run counter-clockwise seen from +z in pbrt's world; the camera sits at the origin, the triangle ahead at z = 2.
    let shape = "Shape \"trianglemesh\" \"point3 P\" [-9 -9 2 9 -9 2 0 9 2]";
    let normals = " \"normal N\" [0 0 -1 0 0 -1 0 0 -1]";
    for (what, shines) in [
        (shape.to_owned(), false),
        (format!("ReverseOrientation {shape}"), true),
        (format!("{shape}{normals}"), true),
        (format!("ReverseOrientation {shape}{normals}"), false),
        (format!("Scale 1 1 -1 {}", shape.replace(" 2 ", " -2 ").replace(" 2]", " -2]")), true),
    ] {
        let scene = Scene::build(load(&format!("{HEAD}WorldBegin AreaLightSource \"diffuse\" {what}"))).unwrap();
        let seen = luminance(&scene, through(&scene.description().cameras[0], 0.0, -0.1), 8) > 0.1;
        assert_eq!(seen, shines, "{what}");
    }
}

#[test]
fn textures_and_materials_are_found_by_name() {
    let text = format!(
        "{HEAD}WorldBegin\n\
         Texture \"a\" \"spectrum\" \"checkerboard\" \"rgb tex1\" [1 0 0] \"rgb tex2\" [0 0 1] \"float uscale\" 4\n\
         Texture \"b\" \"spectrum\" \"scale\" \"texture tex\" \"a\" \"float scale\" 0.5\n\
         MakeNamedMaterial \"wall\" \"string type\" \"diffuse\" \"texture reflectance\" \"b\"\n\
         NamedMaterial \"glass\" Shape \"sphere\"\n\
         MakeNamedMaterial \"glass\" \"string type\" \"dielectric\" \"spectrum eta\" \"glass-BK7\"\n\
         MakeNamedMaterial \"both\" \"string type\" \"mix\" \"string materials\" [\"wall\" \"glass\"] \"float amount\" 0.25\n\
         NamedMaterial \"both\" Shape \"disk\"\n\
         Material \"conductor\" \"float roughness\" 0.25 Shape \"cylinder\"\n\
         Material \"interface\" Shape \"sphere\""
    );
    let d = load(&text);
    assert_eq!(d.objects.len(), 3);
    let scattering = |i: usize| &d.materials[d.objects[i].material as usize].scattering;
    assert!(matches!(scattering(0), Scattering::Principled(p) if (p.ior - 1.5185).abs() < 1e-3 && p.dispersion.is_some()));
    assert!(matches!(scattering(1), Scattering::Mix(_)));
    // α is the root of the roughness.
    let Scattering::Conductor(c) = scattering(2) else { panic!("a metal") };
    assert!(matches!(c.alpha, diopter_scene::texture::Scalar::Constant(a) if (a - 0.5).abs() < 1e-6));
    assert!(d.warnings.is_empty(), "{:?}", d.warnings);
}

#[test]
fn a_missing_texture_is_a_warning_and_magenta_stands_in_for_it() {
    use diopter_scene::load::STAND_IN;
    use diopter_scene::texture::Color;
    let text = format!(
        "{HEAD}WorldBegin\n\
         Texture \"c\" \"spectrum\" \"imagemap\" \"string filename\" \"c.png\" \"bool invert\" true \"float uscale\" 3\n\
         Texture \"r\" \"float\" \"imagemap\" \"string filename\" \"r.png\"\n\
         Material \"diffuse\" \"texture reflectance\" \"c\" \"string normalmap\" \"n.png\" Shape \"sphere\" \"texture alpha\" \"r\"\n\
         AreaLightSource \"diffuse\" \"string filename\" \"c.png\" Shape \"disk\""
    );
    let d = load_with(&text, &[("r.png", b"no picture")]).unwrap();
    let missing: Vec<&str> = d.missing_textures.iter().map(|m| m.name.as_str()).collect();
    assert_eq!(missing, ["c.png", "r.png", "n.png"]);
    assert_eq!(d.warnings.len(), 1, "{:?}", d.warnings);
    for part in ["test.pbrt: 3 textures", "c.png (there is no such file)", "r.png (it is none of", "magenta"] {
        assert!(d.warnings[0].contains(part), "{part}: {}", d.warnings[0]);
    }
    let material = |i: usize| &d.materials[d.objects[i].material as usize];
    assert!(matches!(&material(0).scattering, Scattering::Diffuse(Color::Constant { rgb, .. }) if *rgb == STAND_IN));
    assert!(material(0).normal_map.is_none());
    assert!(matches!(&material(0).coverage, diopter_scene::material::Coverage::Full));
    assert!(material(1).emission.is_some());
}

#[test]
fn bodies_thinner_than_what_is_around_them_are_read() {
    let text = format!(
        "{HEAD}WorldBegin\n\
         Material \"dielectric\" \"float eta\" 0.763 Shape \"sphere\"\n\
         Material \"thindielectric\" \"float eta\" 0.5 Shape \"disk\""
    );
    let d = load(&text);
    assert!(d.warnings.is_empty(), "{:?}", d.warnings);
    for (object, expected) in [(0, 0.763f32), (1, 0.5)] {
        let Scattering::Principled(p) = &d.materials[d.objects[object].material as usize].scattering else { panic!("glass") };
        assert_eq!(p.ior, expected);
    }
}

#[test]
fn files_of_pbrt_3_are_read_where_they_mean_the_same_and_else_named() {
    let head = HEAD.replace("\"rgb\"", "\"image\"");
    let text = format!(
        "{head}Integrator \"directlighting\" \"integer maxdepth\" 7\nWorldBegin\n\
         Material \"matte\" \"rgb Kd\" [0.5 0.25 0.125] \"float sigma\" 0 Shape \"sphere\"\n\
         Material \"glass\" \"float index\" 1.33 \"rgb Kr\" [1 1 1] Shape \"sphere\" WorldEnd"
    );
    let d = load(&text);
    assert_eq!((d.max_depth, d.cameras[0].film.size), (Some(7), Some([100, 100])));
    assert!(d.warnings.iter().any(|w| w.contains("directlighting") && w.contains("pbrt-v3")), "{:?}", d.warnings);
    let scattering = |i: usize| &d.materials[d.objects[i].material as usize].scattering;
    assert!(matches!(scattering(0), Scattering::Diffuse(diopter_scene::texture::Color::Constant { rgb, .. }) if rgb.y == 0.25));
    assert!(matches!(scattering(1), Scattering::Principled(p) if p.ior == 1.33 && p.dispersion.is_none()));
    for world in [
        "Material \"uber\" \"rgb Kd\" [1 1 1]",
        "Material \"matte\" \"float sigma\" 20",
        "Material \"glass\" \"rgb Kt\" [1 0.5 0.5]",
        "Material \"glass\" \"float uroughness\" 0.1",
        "Material \"mix\" \"string namedmaterial1\" \"a\" \"string namedmaterial2\" \"b\"",
        "LightSource \"infinite\" \"color L\" [1 1 1]",
        "LightSource \"infinite\" \"string mapname\" \"sky.exr\"",
    ] {
        let e = load_with(&format!("{HEAD}WorldBegin\n{world} Shape \"sphere\""), &[]).unwrap_err();
        assert!(e.contains("line 5") && e.contains("this is pbrt-v3") && e.contains("pbrt --upgrade"), "{world}: {e}");
    }
}

#[test]
fn directions_mix_textures_by_how_a_surface_faces() {
    use diopter_scene::texture::Lookup;
    let text = format!(
        "{HEAD}WorldBegin\n\
         AttributeBegin Rotate 90 1 0 0\n\
         Texture \"t\" \"spectrum\" \"directionmix\" \"vector3 dir\" [0 2 0] \"rgb tex1\" [0.8 0.2 0.1] \"rgb tex2\" [0 0.4 0.5]\n\
         AttributeEnd\n\
         Material \"diffuse\" \"texture reflectance\" \"t\" Shape \"sphere\""
    );
    let d = load(&text);
    let Scattering::Diffuse(Color::Graph(graph)) = &d.materials[d.objects[0].material as usize].scattering else {
        panic!("a graph")
    };
    // The rotation takes the direction from y to z: its texture shows where the surface faces along z, either way, the other across.
    for (normal, weight) in [(Vec3::Z, 1.0), (Vec3::NEG_Z, 1.0), (Vec3::Y, 0.0), (Vec3::new(0.8, 0.0, -0.6), 0.6)] {
        let seen = graph.at(&Lookup { uv: [Vec2::ZERO; 2], point: Vec3::ZERO, normal, footprint: None });
        let expected = Vec3::new(0.8, 0.2, 0.1) * weight + Vec3::new(0.0, 0.4, 0.5) * (1.0 - weight);
        assert!((seen - expected).abs().max_element() < 1e-5, "{normal}: {seen} {expected}");
    }
    let none = "Texture \"t\" \"spectrum\" \"directionmix\" \"vector3 dir\" [0 0 0]";
    assert!(load_with(&format!("{HEAD}WorldBegin\n{none}"), &[]).unwrap_err().contains("length"));
}

#[test]
fn metals_given_as_rgb_reflect_what_fresnel_has_for_each_number() {
    use diopter_light::SampledWavelengths;
    let text = format!(
        "{HEAD}WorldBegin\n\
         Material \"conductor\" \"rgb eta\" [0.2 0.924 1.102] \"rgb k\" [3.912 2.447 2.137] Shape \"sphere\"\n\
         Material \"conductor\" \"rgb reflectance\" [0.9 0.5 0.1] Shape \"disk\""
    );
    let d = load(&text);
    let metal = |i: usize| match &d.materials[d.objects[i].material as usize].scattering {
        Scattering::Conductor(c) => c.clone(),
        _ => panic!("a metal"),
    };
    let copper = metal(0);
    let lanes = |s: &diopter_light::Spectrum| s.sample(&SampledWavelengths::rgb()).truncate();
    assert_eq!([lanes(&copper.n), lanes(&copper.k)], [Vec3::new(0.2, 0.924, 1.102), Vec3::new(3.912, 2.447, 2.137)]);
    // At normal incidence ((n − 1)² + k²) / ((n + 1)² + k²): 0.952, 0.619, 0.509.
    for (metal, expected) in [(copper, Vec3::new(0.9522, 0.6186, 0.5094)), (metal(1), Vec3::new(0.9, 0.5, 0.1))] {
        let seen = metal.normal_reflectance();
        assert!((seen - expected).abs().max_element() < 1e-3, "{seen} {expected}");
    }
}

#[test]
fn roughness_may_differ_in_u_and_v() {
    use diopter_scene::material::Anisotropy;
    use diopter_scene::texture::Scalar;
    let text = format!(
        "{HEAD}WorldBegin\n\
         Material \"conductor\" \"float uroughness\" 0.04 \"float vroughness\" 0.25 Shape \"sphere\"\n\
         Material \"dielectric\" \"float vroughness\" 0.09 \"bool remaproughness\" false Shape \"disk\"\n\
         Material \"coatedconductor\" \"float interface.roughness\" 0.0001 \"float conductor.uroughness\" 0.16 Shape \"cylinder\"\n\
         Material \"coateddiffuse\" \"float roughness\" 0.25 \"float uroughness\" 0.25 Shape \"sphere\""
    );
    let d = load(&text);
    assert!(d.warnings.is_empty(), "{:?}", d.warnings);
    let scattering = |i: usize| &d.materials[d.objects[i].material as usize].scattering;
    let is = |s: &Scalar, expected: f32| matches!(s, Scalar::Constant(a) if (a - expected).abs() < 1e-5);
    let Scattering::Conductor(c) = scattering(0) else { panic!("a metal") };
    assert!(is(&c.alpha, 0.2) && is(c.across.as_ref().unwrap(), 0.5), "{c:?}");
    // What is not said is smooth; the model of glass takes √α.
    let Scattering::Principled(p) = scattering(1) else { panic!("glass") };
    let Some(Anisotropy::Across(across)) = p.anisotropy.as_deref() else { panic!("{:?}", p.anisotropy) };
    assert!(is(&p.roughness, 0.0) && is(across, 0.3));
    let Scattering::Coated(c) = scattering(2) else { panic!("a coat") };
    assert!(is(&c.metal.alpha, 0.4) && is(c.metal.across.as_ref().unwrap(), 0.0) && c.across.is_none());
    let Scattering::Principled(p) = scattering(3) else { panic!("plastic") };
    assert!(p.anisotropy.is_none() && is(&p.roughness, 0.25f32.sqrt().sqrt()));
}

#[test]
fn subdivided_and_round_shapes_have_their_size() {
    // An octahedron subdivided is nearly a sphere; its limit lies within.
    let octahedron = "\"integer indices\" [0 2 4 2 1 4 1 3 4 3 0 4 2 0 5 1 2 5 3 1 5 0 3 5] \"point3 P\" [1 0 0 -1 0 0 0 1 0 0 -1 0 0 0 1 0 0 -1]";
    let text = format!(
        "{HEAD}WorldBegin Shape \"loopsubdiv\" \"integer levels\" 3 {octahedron} Shape \"disk\" \"float innerradius\" 0.5 Scale 1 2 1 Shape \"sphere\""
    );
    let d = load(&text);
    let area = |i: usize| match d.objects[i].shape {
        Shape::Mesh { mesh, world_from_mesh } => {
            let m = &d.meshes[mesh as usize];
            let corner = |t: &[u32; 3]| t.map(|k| world_from_mesh.transform_point3(m.positions[k as usize]));
            m.triangles
                .iter()
                .map(|t| {
                    let [a, b, c] = corner(t);
                    0.5 * (b - a).cross(c - a).length()
                })
                .sum::<f32>()
        }
        _ => panic!("a mesh"),
    };
    let m = &d.meshes[0];
    assert_eq!(m.triangles.len(), 8 * 64);
    // Loop's limit of a vertex of valence 4: weight 1 / (4 + 3 / (8 β)), β = 3/32.
    let radius = m.positions.iter().map(|p| p.length()).fold(0.0, f32::max);
    assert!((radius - 0.5).abs() < 0.12 && m.positions.iter().all(|p| p.length() > 0.4), "{radius}");
    assert!((area(1) / (std::f32::consts::PI * 0.75) - 1.0).abs() < 1e-3, "{}", area(1));
    // A spheroid of half axes 1, 2, 1: 2π (1 + 2/e · asin e), e² = 3/4.
    let e = 0.75f32.sqrt();
    assert!((area(2) / (std::f32::consts::TAU * (1.0 + 2.0 / e * e.asin())) - 1.0).abs() < 1e-3, "{}", area(2));
}

#[test]
fn displaced_meshes_are_split_and_moved() {
    let ply = b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty float u\nproperty float v\n\
        element face 2\nproperty list uchar int vertex_indices\nend_header\n0 0 0 0 0\n1 0 0 1 0\n1 1 0 1 1\n0 1 0 0 1\n3 0 1 2\n3 0 2 3\n";
    let files: [(&str, &[u8]); 1] = [("m.ply", ply)];
    let of = |textures: &str, shapes: &str| load_with(&format!("{HEAD}WorldBegin {textures}\n{shapes}"), &files);
    let ramp = "Texture \"h\" \"float\" \"bilerp\" \"float v00\" 0 \"float v01\" 0 \"float v10\" 0.5 \"float v11\" 0.5";
    let shape = "Shape \"plymesh\" \"string filename\" \"m.ply\"";
    // A ramp of heights; edges are as long as they are in the world.
    let d = of(ramp, &format!("{shape} \"texture displacement\" \"h\" \"float edgelength\" 0.2 Scale 2 2 2 {shape} \"texture displacement\" \"h\" \"float edgelength\" 0.2 {shape}"))
        .unwrap();
    assert!(d.warnings.is_empty(), "{:?}", d.warnings);
    assert_eq!((d.objects.len(), d.meshes.len(), d.meshes[2].triangles.len()), (3, 3, 2));
    for (mesh, longest) in d.meshes[..2].iter().zip([0.2, 0.1]) {
        for t in 0..mesh.triangles.len() {
            let corners = mesh.corners(t);
            let flat = corners.map(|p| p.truncate());
            assert!((0..3).all(|k| flat[k].distance(flat[(k + 1) % 3]) <= longest + 1e-6));
            assert!(corners.iter().all(|p| (p.z - 0.5 * p.x).abs() < 1e-6), "{corners:?}");
        }
        let slope = Vec3::new(-0.5, 0.0, 1.0).normalize();
        assert!(mesh.normals.iter().all(|n| n.distance(slope) < 1e-4));
    }
    assert!(d.meshes[1].triangles.len() >= 3 * d.meshes[0].triangles.len());
    let bounds = |d: &Description| d.bounds_at(0.0, |_| true);
    // The world is mirrored: heights along z are −z.
    assert!(
        (bounds(&d).max - Vec3::new(2.0, 2.0, 0.0)).length() < 1e-5
            && (bounds(&d).min - Vec3::new(0.0, 0.0, -1.0)).length() < 1e-5
    );
    // Turned over, the shape is the same and its outside the other side.
    let one =
        |reverse: &str| of(ramp, &format!("{reverse} {shape} \"texture displacement\" \"h\" \"float edgelength\" 0.2")).unwrap();
    let [plain, turned] = ["", "ReverseOrientation"].map(|r| one(r).meshes[0].clone());
    assert!(plain.positions == turned.positions && plain.normals.iter().zip(&turned.normals).all(|(a, b)| *a == -*b));
    // Heights by the place in space are asked where the shape stands, also in a mirrored world.
    let cubes = "Texture \"h\" \"float\" \"checkerboard\" \"integer dimension\" 3 \"float tex1\" 0.25 \"float tex2\" 0";
    let d = of(cubes, &format!("Translate 0.5 0.5 0.5 {shape} \"texture displacement\" \"h\" \"float edgelength\" 0.1")).unwrap();
    let near = |x: f32, y: f32| {
        d.meshes[0].positions.iter().filter(|p| p.truncate().distance(glam::Vec2::new(x, y)) < 0.2).map(|p| p.z).sum::<f32>()
    };
    assert!(near(0.25, 0.25) > 0.2 && near(0.75, 0.75) > 0.2 && near(0.25, 0.75) == 0.0 && near(0.75, 0.25) == 0.0);
    for (shape, said) in [
        (format!("{shape} \"texture displacement\" \"none\""), "none"),
        (format!("{shape} \"texture displacement\" \"h\" \"float edgelength\" 0"), "edgelength 0"),
        (
            "Shape \"loopsubdiv\" \"integer levels\" 11 \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 1 2]".into(),
            "11 levels",
        ),
    ] {
        let e = of(ramp, &shape).unwrap_err();
        assert!(e.contains(said), "{e}");
    }
}

#[test]
fn files_include_each_other_and_may_be_packed() {
    use std::io::Write;
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(b"Translate 0 0 1 Material \"diffuse\"").unwrap();
    let packed = packed.finish().unwrap();
    let ply = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let files: [(&str, &[u8]); 3] = [("a.pbrt.gz", &packed), ("m.ply", ply), ("loop.pbrt", b"Include \"loop.pbrt\"")];
    let text = format!(
        "{HEAD}WorldBegin Include \"a.pbrt.gz\" Shape \"plymesh\" \"string filename\" \"m.ply\" Import \"a.pbrt.gz\" Shape \"plymesh\" \"string filename\" \"m.ply\""
    );
    let d = load_with(&text, &files).unwrap();
    assert_eq!((d.objects.len(), d.meshes.len()), (2, 1));
    // What is imported leaves the transform alone.
    let z = |i: usize| match d.objects[i].shape {
        Shape::Mesh { world_from_mesh, .. } => world_from_mesh.translation.z,
        _ => 0.0,
    };
    assert_eq!([z(0), z(1)], [-1.0, -1.0]);
    let e = load_with(&format!("{HEAD}WorldBegin Include \"loop.pbrt\""), &files).unwrap_err();
    assert!(e.contains("include"), "{e}");
}

#[test]
fn wrong_files_say_where_and_what() {
    for (world, line, word) in [
        ("Shap \"sphere\"", 5, "Shape"),
        ("AttributeBegin", 5, "never ended"),
        ("AttributeEnd", 5, "without Begin"),
        ("ObjectBegin \"x\"\nAttributeEnd", 6, "another block"),
        ("Transform [1 0 0 0 0 1 0 0 0 0 1 0 0 0 0]", 5, "16"),
        ("Transform [nan 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1]", 5, "16"),
        ("Translate 1 2 1e999", 5, "finite"),
        ("Scale 0 1 1", 5, "other than 0"),
        ("Shape \"sphere\" \"float radius\" -1", 5, "above 0"),
        ("Shape \"sphere\" \"flot radius\" 1", 5, "float"),
        ("Shape \"sphere\" \"float radius\" [1", 5, "closing ]"),
        ("Shape \"plymesh\" \"string filename\" \"no.ply\"", 5, "no such file"),
        ("Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 1 7]", 5, "less than 3"),
        ("Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 1 2147483648]", 5, "2147483647"),
        ("Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0] \"integer indices\" [0 1 2]", 5, "multiple of 3"),
        ("\nNamedMaterial \"gold\" Shape \"sphere\"", 6, "gold"),
        ("Material \"velvet\"", 5, "velvet"),
        ("Material \"diffuse\" \"rgb reflectance\" [2 0 0]", 5, "0 to 1"),
        ("Material \"diffuse\" \"spectrum reflectance\" [300 5 900 5]", 5, "0 to 1"),
        ("Material \"dielectric\" \"float eta\" 0.05", 5, "0.1 to 10"),
        ("Material \"coateddiffuse\" \"float eta\" 0.5", 5, "expected 1 to 10"),
        ("Material \"conductor\" \"float roughness\" -1", 5, "roughness"),
        ("LightSource \"point\" \"float scale\" -3", 5, "at least 0"),
        ("LightSource \"spot\" \"float coneangle\" 400", 5, "180"),
        ("Material \"diffuse\" \"texture reflectance\" \"t\"", 5, "\"t\""),
        ("LightSource \"goniometric\"", 5, "filename"),
        ("LightSource \"laser\"", 5, "point, spot"),
        ("MakeNamedMedium \"fog\" \"string type\" \"grid\"", 5, "uniformgrid"),
        ("MakeNamedMedium \"fog\" \"string type\" \"uniformgrid\"", 5, "without density"),
        ("MakeNamedMedium \"f\" \"string type\" \"uniformgrid\" \"float density\" [1 2 3] \"integer nx\" 2", 5, "2 × 1 × 1"),
        ("MakeNamedMedium \"f\" \"string type\" \"uniformgrid\" \"float density\" -1", 5, "at least 0"),
        ("MakeNamedMedium \"f\" \"string type\" \"uniformgrid\" \"float density\" 1 \"integer ny\" -4", 5, "at least 1"),
        (
            "MakeNamedMedium \"f\" \"string type\" \"uniformgrid\" \"float density\" 1 \"integer nx\" 1e9 \"integer ny\" 1e9",
            5,
            "2^31",
        ),
        ("MakeNamedMedium \"f\" \"string type\" \"uniformgrid\" \"float density\" 1 \"point3 p1\" [1 0 1]", 5, "p0 and p1"),
        (
            "MakeNamedMedium \"f\" \"string type\" \"uniformgrid\" \"float density\" 1 \"float temperature\" 1 \"rgb Le\" [1 1 1]",
            5,
            "one of the two",
        ),
        ("MakeNamedMedium \"f\" \"string type\" \"rgbgrid\"", 5, "sigma_a"),
        ("MakeNamedMedium \"f\" \"string type\" \"rgbgrid\" \"float sigma_a\" 1", 5, "rgb sigma_a"),
        ("MakeNamedMedium \"f\" \"string type\" \"rgbgrid\" \"rgb sigma_s\" [1 1 1] \"rgb Le\" [1 1 1]", 5, "does not shine"),
        ("MakeNamedMedium \"f\" \"string type\" \"cloud\" \"float density\" -1", 5, "density"),
        ("MakeNamedMedium \"f\" \"string type\" \"nanovdb\"", 5, "filename"),
        ("MakeNamedMedium \"fog\" \"string type\" \"homogeneous\" \"rgb sigma_a\" [1 -1 0]", 5, "at least 0"),
        ("MediumInterface \"fog\" \"\" Shape \"sphere\"", 5, "\"fog\""),
        ("Texture \"m\" \"float\" \"marble\"", 5, "colours"),
        ("Shape \"sphere\" \"texture alpha\" \"x\"", 5, "\"x\""),
        ("Shape \"sphere", 5, "never closed"),
        ("ObjectInstance \"tree\"", 5, "tree"),
    ] {
        let e = load_with(&format!("{HEAD}WorldBegin\n{world}"), &[]).unwrap_err();
        assert!(e.contains(&format!("line {line}")) && e.contains(word), "{world}: {e}");
    }
    assert!(load_with("Film \"rgb\"", &[]).unwrap_err().contains("WorldBegin"));
    for world in [
        "",
        "LightSource \"infinite\"",
        "Material \"interface\" Shape \"sphere\"",
        "ObjectBegin \"x\" Shape \"sphere\" ObjectEnd",
    ] {
        let e = load_with(&format!("{HEAD}WorldBegin {world}"), &[]).unwrap_err();
        assert!(e.starts_with("test.pbrt: no surface") && e.contains("Shape"), "{world}: {e}");
    }
}

#[test]
fn what_grows_without_end_is_refused() {
    let chain = |n: usize, line: &dyn Fn(usize) -> String| {
        let lines: Vec<String> = (1..n).map(line).collect();
        load_with(
            &format!(
                "{HEAD}WorldBegin\nTexture \"t0\" \"spectrum\" \"constant\"\nMakeNamedMaterial \"m0\" \"string type\" \"diffuse\"\nShape \"sphere\"\n{}",
                lines.join("\n")
            ),
            &[],
        )
    };
    let texture = |i: usize| format!("Texture \"t{i}\" \"spectrum\" \"scale\" \"texture tex\" \"t{}\"", i - 1);
    assert!(chain(100, &texture).is_ok() && chain(60_000, &texture).unwrap_err().contains("fewer"));
    let doubled =
        |i: usize| format!("Texture \"t{i}\" \"spectrum\" \"mix\" \"texture tex1\" \"t{0}\" \"texture tex2\" \"t{0}\"", i - 1);
    assert!(chain(40, &doubled).unwrap_err().contains("fewer"));
    let mixed =
        |i: usize| format!("MakeNamedMaterial \"m{i}\" \"string type\" \"mix\" \"string materials\" [\"m{0}\" \"m{0}\"]", i - 1);
    assert!(chain(4, &mixed).is_ok() && chain(40, &mixed).unwrap_err().contains("mixtures"));
    let text = format!("{HEAD}WorldBegin Include \"a\"");
    let twice: &[u8] = b"Include \"a\" Include \"a\"";
    assert!(load_with(&text, &[("a", twice)]).unwrap_err().contains("include"));
}

#[test]
fn the_last_of_several_values_counts() {
    let d = load(&format!(
        "{HEAD}WorldBegin Material \"diffuse\" \"rgb reflectance\" [0 0 0] \"rgb reflectance\" [0.5 0.25 0.125] Shape \"sphere\""
    ));
    assert!(
        matches!(&d.materials[0].scattering, Scattering::Diffuse(diopter_scene::texture::Color::Constant { rgb, .. }) if rgb.y == 0.25)
    );
}

#[test]
fn media_take_their_share_inside_and_around() {
    // A wall of light of 1 cd/m² at z = 10 behind a ball of smoke of radius 1, and the same in air that absorbs.
    let wall = "AttributeBegin AreaLightSource \"diffuse\" \"bool twosided\" true Shape \"bilinearmesh\" \"point3 P\" [-99 -99 10 99 -99 10 -99 99 10 99 99 10] AttributeEnd";
    let smoke = "MakeNamedMedium \"smoke\" \"string type\" \"homogeneous\" \"float scale\" 0.5 \"spectrum sigma_a\" [400 1 700 1] \"rgb sigma_s\" [0 0 0]";
    let ball =
        "AttributeBegin Translate 0 0 5 MediumInterface \"smoke\" \"\" Material \"interface\" Shape \"sphere\" AttributeEnd";
    let seen = |text: String| {
        let scene = Scene::build(load(&text)).unwrap();
        luminance(&scene, through(&scene.description().cameras[0], 0.0, 0.0), 64)
    };
    let clear = seen(format!("{HEAD}WorldBegin {wall}"));
    let within = seen(format!("{HEAD}WorldBegin {smoke} {wall} {ball}")) / clear;
    assert!((within - (-1.0f64).exp()).abs() < 0.01, "{within}");
    let glass = ball.replace("\"interface\"", "\"dielectric\" \"float eta\" 1.0");
    let filled = seen(format!("{HEAD}WorldBegin {smoke} {wall} {glass}")) / clear;
    assert!((filled - (-1.0f64).exp()).abs() < 0.01, "{filled}");
    let thin = smoke.replace("0.5", "0.1");
    let around = HEAD.replace("Camera", &format!("{thin} MediumInterface \"\" \"smoke\" Camera"));
    let through_air = seen(format!("{around}WorldBegin {wall}")) / clear;
    assert!((through_air - (-1.0f64).exp()).abs() < 0.01, "{through_air}");
    // The same medium on both sides is no face at all; an unused one does no harm.
    let same = ball.replace("\"smoke\" \"\"", "\"smoke\" \"smoke\"");
    assert!((seen(format!("{HEAD}WorldBegin {smoke} {wall} {same}")) / clear - 1.0).abs() < 1e-6);
    assert!(
        load(&format!(
            "{HEAD}WorldBegin MakeNamedMedium \"m\" \"string type\" \"homogeneous\" \"string preset\" \"Ketchup\" {wall}"
        ))
        .warnings
        .is_empty()
    );
}

#[test]
fn patterns_in_space_follow_their_own_transform_in_mirrored_worlds_too() {
    use diopter_scene::noise::marble;
    let world = "Texture \"m\" \"spectrum\" \"marble\" \"float scale\" 2 Material \"diffuse\" \"texture reflectance\" \"m\"";
    let quad = "Shape \"bilinearmesh\" \"point3 P\" [-9 -9 2  9 -9 2  -9 9 2  9 9 2]";
    for (head, mirrored) in [(HEAD.to_owned(), true), (HEAD.replace("LookAt", "Scale -1 1 1\nLookAt"), false)] {
        let text = format!("{head}WorldBegin AttributeBegin Translate 0.3 0.1 0.7 {world} Identity {quad} AttributeEnd");
        let scene = Scene::build(load(&text)).unwrap();
        for (x, y) in [(0.2, 0.4), (-0.5, 0.1), (0.3, -0.6)] {
            let seen = scene.first_surface(&through(&scene.description().cameras[0], x, y)).unwrap().albedo;
            // A picture's x is the world's, or its opposite in a world of the other hand.
            let at = Vec3::new(if mirrored { 2.0 * x } else { -2.0 * x }, 2.0 * y, 2.0);
            let expected = marble((at - Vec3::new(0.3, 0.1, 0.7)) * 2.0, 0.5, 8, 0.2);
            assert!((seen - expected).abs().max_element() < 1e-3, "{x} {y}: {seen} {expected}");
        }
    }
}

fn png(width: u32, height: u32, pixel: impl Fn(u32, u32) -> [u8; 3]) -> Vec<u8> {
    let picture = image::RgbImage::from_fn(width, height, |x, y| image::Rgb(pixel(x, y)));
    let mut bytes = Vec::new();
    picture.write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Png).unwrap();
    bytes
}

#[test]
fn projectors_throw_their_picture_upright() {
    // Left half white, right half black but for its upper quarter.
    let picture = png(8, 8, |x, y| if x < 4 || y < 2 { [255; 3] } else { [0; 3] });
    let text = format!(
        "{HEAD}WorldBegin LightSource \"projection\" \"string filename\" \"p.png\" \"float fov\" 90 \"float scale\" 40\n\
         Material \"diffuse\" \"rgb reflectance\" [1 1 1] Shape \"bilinearmesh\" \"point3 P\" [-9 -9 2  9 -9 2  -9 9 2  9 9 2]"
    );
    let d = load_with(&text, &[("p.png", &picture)]).unwrap();
    let scene = Scene::build(d).unwrap();
    let seen = |x: f32, y: f32| luminance(&scene, through(&scene.description().cameras[0], x, y), 16);
    assert!(seen(0.5, -0.3) < 1e-6 && seen(0.5, 0.8) > 0.1 && seen(-0.5, -0.8) > 0.1);
    // 40 cd at 2 m on a white wall, cos³ off the axis.
    let (x, y) = (-0.4f64, 0.3f64);
    let expected = 40.0 / 4.0 / std::f64::consts::PI / (1.0 + x * x + y * y).powf(1.5);
    assert!((seen(x as f32, y as f32) / expected - 1.0).abs() < 0.02, "{} {expected}", seen(x as f32, y as f32));
    // So many lumens, all of them on the wall: the mean illuminance of a full picture on 4 × 4 m is the 16th part.
    let white = png(4, 4, |_, _| [255; 3]);
    let scene =
        Scene::build(load_with(&text.replace("float scale\" 40", "float power\" 800"), &[("p.png", &white)]).unwrap()).unwrap();
    let n = 24;
    let mean: f64 = (0..n * n)
        .map(|i| {
            let at = |k: i32| (k as f32 + 0.5) / n as f32 * 1.998 - 0.999;
            luminance(&scene, through(&scene.description().cameras[0], at(i % n), at(i / n)), 4) * std::f64::consts::PI
        })
        .sum::<f64>()
        / f64::from(n * n);
    assert!((mean / 50.0 - 1.0).abs() < 0.02, "{mean}");
}

#[test]
fn measured_lights_shine_by_their_picture() {
    // The middle of the square is the light's axis, y in pbrt: bright up, dark down.
    let picture = png(64, 64, |x, y| {
        let (dx, dy) = (f64::from(x) - 31.5, f64::from(y) - 31.5);
        if dx.abs() + dy.abs() < 32.0 { [255; 3] } else { [0; 3] }
    });
    let text = |y: f32| {
        format!(
            "{HEAD}WorldBegin AttributeBegin Translate 0 0 5 LightSource \"goniometric\" \"string filename\" \"g.png\" AttributeEnd\n\
             Material \"diffuse\" \"rgb reflectance\" [1 1 1] Shape \"bilinearmesh\" \"point3 P\" [-9 {y} 0  9 {y} 0  -9 {y} 9  9 {y} 9]"
        )
    };
    let seen = |y: f32| {
        let scene = Scene::build(load_with(&text(y), &[("g.png", &picture)]).unwrap()).unwrap();
        // Straight below or above the lamp.
        luminance(&scene, through(&scene.description().cameras[0], 0.0, y / 5.0), 16)
    };
    // 1 cd at 2 m.
    assert!((seen(2.0) * std::f64::consts::PI / 0.25 - 1.0).abs() < 0.02, "{}", seen(2.0));
    assert!(seen(-2.0) < 1e-6);
}

#[test]
fn two_skies_add_up_and_lamps_may_be_pictures() {
    let sky = "LightSource \"infinite\" \"rgb L\" [1 1 1]";
    let scene =
        Scene::build(load(&format!("{HEAD}WorldBegin {sky} {sky} \"float scale\" 2 Shape \"sphere\" \"float radius\" 0.1")))
            .unwrap();
    let up = Ray { origin: Vec3::Y, direction: Vec3::Y, time_s: 0.0 };
    assert!((luminance(&scene, up, 64) - 3.0).abs() < 0.03);
    // The upper half of a screen is white.
    let picture = png(2, 2, |_, y| if y == 0 { [255; 3] } else { [0; 3] });
    let text = format!(
        "{HEAD}WorldBegin AreaLightSource \"diffuse\" \"string filename\" \"p.png\" \"float scale\" 7 \"bool twosided\" true\n\
         Shape \"bilinearmesh\" \"point3 P\" [-2 -2 2  2 -2 2  -2 2 2  2 2 2] \"point2 uv\" [0 0 1 0 0 1 1 1]"
    );
    let scene = Scene::build(load_with(&text, &[("p.png", &picture)]).unwrap()).unwrap();
    let seen = |y: f32| luminance(&scene, through(&scene.description().cameras[0], 0.3, y), 64);
    assert!((seen(0.5) / 7.0 - 1.0).abs() < 0.02 && seen(-0.5) < 1e-6, "{} {}", seen(0.5), seen(-0.5));
}

#[test]
fn things_move_between_two_transforms() {
    let text = format!(
        "{}WorldBegin\n\
         ObjectBegin \"ball\" Translate 0 0 5 Shape \"sphere\" ObjectEnd\n\
         AttributeBegin ActiveTransform EndTime Translate 4 0 0 ActiveTransform All Translate 0 0 8 Shape \"sphere\" AttributeEnd\n\
         AttributeBegin ActiveTransform EndTime Rotate 90 0 1 0 ActiveTransform All ObjectInstance \"ball\" AttributeEnd",
        HEAD.replace("LookAt", "TransformTimes 0 2\nLookAt")
    );
    let d = load(&text);
    let middle = |i: usize, t: f64| {
        let only = |o: &diopter_scene::Object| std::ptr::eq(o, &d.objects[i]);
        d.bounds_at(t, only).center()
    };
    // The world was mirrored.
    let near = |a: Vec3, b: Vec3| assert!((a - b).length() < 1e-3, "{a} {b}");
    near(middle(0, 0.0), Vec3::new(0.0, 0.0, -8.0));
    near(middle(0, 1.0), Vec3::new(2.0, 0.0, -8.0));
    near(middle(0, 2.0), Vec3::new(4.0, 0.0, -8.0));
    near(middle(1, 0.0), Vec3::new(0.0, 0.0, -5.0));
    // A turn about y takes z to x.
    near(middle(1, 2.0), Vec3::new(5.0, 0.0, 0.0));
    near(middle(1, 1.0), Vec3::new(5.0 / 2f32.sqrt(), 0.0, -5.0 / 2f32.sqrt()));
    Scene::build(d).unwrap();
}
