//! What is written is read back as it was.

use super::*;
use crate::material::{Coverage, Interior, Material, Scattering};
use crate::medium::Coefficient;
use crate::texture::{Color, Scalar, Texture, Wrap};
use crate::{PathSettings, Scene, builtin, load};
use glam::Vec4;

#[test]
fn what_is_written_is_read_back_as_the_same_scene() {
    for name in ["still-life", "cornell", "color-chart"] {
        let Some(before) = builtin::named(name) else { continue };
        let written = gltf(&before);
        let none = |_: &str| Err("no files".to_owned());
        let after = load::gltf::load(&written.container(), "x.glb", &none).unwrap();
        assert_eq!(after.objects.len(), before.objects.len());
        assert!(after.warnings.is_empty(), "{:?}", after.warnings);
        let of = |d: &Description| d.bounds_at(0.0, |_| true);
        assert!(
            (of(&before).min - of(&after).min).length() < 1e-3 && (of(&before).max - of(&after).max).length() < 1e-3,
            "{name}"
        );
        let lamps = |d: Description| {
            let scene = Scene::build(d).unwrap();
            scene.lights().area.iter().map(|l| f64::from(l.luminance * l.area())).sum::<f64>()
        };
        let (a, b) = (lamps(before), lamps(after));
        // Balls have flat sides.
        assert!((a - b).abs() <= 0.02 * a, "{name}: {a} {b}");
    }
}

#[test]
fn light_along_rays_stays_what_it_was() {
    use diopter_light::random::{Sampler, SamplerKind};
    let before = builtin::named("cornell").unwrap();
    let written = gltf(&before);
    let files = written.binary.clone();
    let fetch = |name: &str| if name == "x.bin" { Ok(files.clone()) } else { Err("not there".to_owned()) };
    let after = load::gltf::load(written.text("x.bin").as_bytes(), "x.gltf", &fetch).unwrap();
    let view = before.cameras[0].world_from_camera;
    let (before, after) = (Scene::build(before).unwrap(), Scene::build(after).unwrap());
    let mean = |scene: &Scene, x: f32, y: f32| {
        let direction = view.transform_vector3(Vec3::new(x, y, -1.0)).normalize();
        let ray = diopter_light::Ray { origin: view.translation.into(), direction, time_s: 0.0 };
        let rgb = diopter_light::SampledWavelengths::rgb();
        (0..512)
            .map(|i| scene.radiance(ray, &rgb, &Sampler::new(SamplerKind::Sobol, 1, (0, 0), i, 512), &PathSettings::default()).y)
            .sum::<f32>()
            / 512.0
    };
    for (x, y) in [(0.0, 0.0), (0.2, -0.25), (-0.3, 0.1)] {
        let (a, b) = (mean(&before, x, y), mean(&after, x, y));
        // Spectra become colours: a few percent.
        assert!((a / b - 1.0).abs() < 0.08 && a > 0.0, "{x} {y}: {a} {b}");
    }
}

/// What debugging shows of a value, without what says how much of a picture is in memory and what somebody has asked for already.
fn shown(value: &impl std::fmt::Debug) -> String {
    let mut text = format!("{value:?}");
    for (from, to) in [("held: ", ", levels"), ("srgb_of_light: ", " }")] {
        let mut at = 0;
        while let Some(start) = text[at..].find(from).map(|i| at + i + from.len()) {
            let end = text[start..].find(to).map_or(text.len(), |i| start + i);
            text.replace_range(start..end, "");
            at = start;
        }
    }
    text
}

/// A scene of what glTF has no words for.
fn unsayable() -> Description {
    use crate::bvh::Bounds;
    use crate::light::punctual::Pattern;
    use crate::light::{Environment, Modulation, SpotEdge};
    use crate::material::conductor::FacetBounces;
    use crate::material::{Bump, BumpUnit, CoatedConductor, Conductor, Emission, Hair, Pigment};
    use crate::medium::{Air, Cloud, Field, Glow, Grid, Medium, Scalars, SparseGrid, Volume, VolumePlace};
    use crate::scene::{FilmHints, LensTable, Object, Viewpoint};
    use crate::shape::{CurveBasis, CurveKind, Curves, Quad, Sphere};
    use crate::texture::{Graph, Mapping, NoisePattern};
    use diopter_image::Raster;
    use diopter_light::spectrum::{Table, blackbody_with_luminance};
    use glam::IVec3;

    let table = |a: f32, b: f32| Spectrum::Table(Table::from_points(&[(380.0, a), (550.0, 0.3), (780.0, b)]));
    let unit = Bounds { min: Vec3::ZERO, max: Vec3::ONE };
    let place =
        |shift: f32| VolumePlace::still(Affine3A::from_rotation_x(0.3) * Affine3A::from_translation(Vec3::X * shift)).unwrap();
    let smoke = Grid::new([2, 3, 2], (0..12).map(|i| 0.1 * i as f32).collect(), &unit).unwrap();
    let mut sparse = SparseGrid::new(Affine3A::from_scale(Vec3::splat(16.0)), IVec3::ZERO, IVec3::splat(20), 0.0).unwrap();
    sparse.set_block(IVec3::new(8, 0, 8), &std::array::from_fn(|i| 900.0 + i as f32));
    let fire = Glow::BlackBody { temperature: Scalars::Sparse(sparse), offset: 10.0, factor: 1.5, peak_radiance: 0.02 };
    let medium = |name: &str, volume| Medium {
        name: name.into(),
        absorption: Coefficient::Scaled(0.7, table(0.2, 0.9)),
        scattering: Coefficient::Scaled(3.1, table(1.0, 0.4)),
        asymmetry: 0.6,
        volume: Some(Box::new(volume)),
        ..Medium::default()
    };
    let smoke = medium("smoke", Volume::new(place(0.0), unit, Field::Density(Scalars::Grid(smoke)), Some(fire)));
    let cloud = Cloud { density: 0.7, wispiness: 1.0, frequency: 5.0 };
    let cloud = Arc::new(medium("cloud", Volume::new(place(1.0), unit, Field::Cloud(cloud), None)));
    let milk = Arc::new(Medium { emission: Some(Spectrum::light_from_rgb(Vec3::X)), ..Medium::fog(0.3, 0.99, 0.7) });
    let numbers = Image::linear(3, 2, (0..6).map(|i| [0.1 + i as f32, 0.3, 1e-7 * i as f32, 1.0]).collect());
    let numbers = Texture { wrap: [Wrap::Black, Wrap::Mirror], ..Texture::color(Arc::new(numbers)) };
    let codes = Texture::color(Arc::new(Image::new(2, 1, vec![[1, 2, 3, 255], [250, 100, 7, 13]])));
    let noise =
        Arc::new(Graph::Noise { texture_from_world: Affine3A::from_rotation_y(0.2), pattern: NoisePattern::Marble(5, 0.5, 0.2) });
    let image = Arc::new(Graph::Image {
        texture: numbers.clone(),
        scale: 0.3,
        invert: true,
        as_number: Some([Vec3::X, Vec3::ZERO]),
        mapping: Some(Mapping::Uv([[2.0, 0.1], [3.0, 0.2]])),
    });
    let graph = Arc::new(Graph::Mix(noise.clone(), Arc::new(Graph::Scale(noise.clone(), image.clone())), image));
    let metal = |alpha| Conductor {
        n: table(0.2, 1.1),
        k: table(3.0, 4.0),
        alpha,
        across: Some(Scalar::Constant(0.3)),
        bounces: FacetBounces::Lost,
        tint: Some(Box::new(Color::rgb(0.9, 0.5, 0.1))),
    };
    let named = |name: &str, scattering| Material::new(name, scattering);
    let mut coated = CoatedConductor::new(metal(Scalar::Constant(0.1)), 1.37, Scalar::Graph(graph.clone()));
    coated.across = Some(Scalar::Constant(0.6));
    let hair = Hair {
        pigment: Pigment::melanin(Scalar::Constant(1.3), Scalar::Constant(0.2)),
        eta: 1.55,
        beta_m: Scalar::Constant(0.3),
        beta_n: Scalar::Textured { factor: 0.5, texture: codes.clone(), channel: 2 },
        alpha: Scalar::Constant(2.0),
    };
    let mut glass = Material::glass("milk glass", 1.5, None);
    glass.interior = Interior::Body { medium: Some(milk.clone()), priority: Some(-3) };
    if let Scattering::Principled(p) = &mut glass.scattering {
        p.dispersion = Some(table(1.53, 1.51));
    }
    let face = Material { interior: Interior::Sides([Some(cloud.clone()), Some(milk)]), ..named("face", Scattering::Interface) };
    let twin = Material { interior: Interior::Sides([Some(cloud), None]), ..named("twin", Scattering::Interface) };
    let mut lamp = named("lamp", Scattering::Diffuse(Color::spectrum(table(0.1, 0.8))));
    lamp.emission = Some(Emission {
        modulation: Modulation::Pwm { frequency_hz: 400.0, duty: 0.25, phase: 0.1 },
        ..Emission::one_sided(blackbody_with_luminance(2856.0, 3000.0))
    });
    let mut paper = named("paper", Scattering::DiffuseTransmission(Box::new([Color::rgb(0.4, 0.3, 0.2), Color::Graph(graph)])));
    paper.bump = Some(Box::new(Bump {
        height: Scalar::Textured { factor: 0.01, texture: numbers, channel: 0 },
        unit: BumpUnit::Length(0.5),
    }));
    paper.coverage = Coverage::Mask { alpha: Scalar::Textured { factor: 1.0, texture: codes.clone(), channel: 3 }, cutoff: 0.25 };
    let mix = (
        [Scattering::Conductor(metal(Scalar::Constant(0.01))), Scattering::Coated(Box::new(coated))],
        Scalar::Textured { factor: 1.0, texture: codes, channel: 1 },
    );
    let mut environment = Environment::new(
        Raster { width: 4, height: 2, channels: 3, data: (0..24).map(|i| 10.0 / (1.0 + i as f32)).collect() },
        glam::Mat3::from_rotation_y(1.0),
        2.0,
    );
    environment.scale_light(1.7);
    let spot = PunctualKind::Spot {
        position: Vec3::Y * 3.0,
        direction: Vec3::NEG_Y,
        cos_inner: 0.9,
        cos_outer: 0.7,
        edge: SpotEdge::Smooth,
    };
    let picture = Raster { width: 2, height: 2, channels: 3, data: (0..12).map(|i| 0.1 * i as f32).collect() };
    let pattern = Pattern { picture, light_from_world: glam::Mat3::from_rotation_z(0.4), spread: Spread::Frame([0.5, 0.25]) };
    let strands = Curves {
        kind: CurveKind::Ribbon,
        basis: CurveBasis::BSpline,
        points: (0..5).map(|i| Vec4::new(0.1 * i as f32, 0.3, 0.2 * i as f32, 0.01)).collect(),
        segments: vec![0, 1],
        normals: vec![[Vec3::Y, Vec3::Z]; 2],
    };
    let table = LensTable { file: "a.dat".into(), bytes: (0..40).collect(), stop_mm: 4.0, focus_m: 1.5 };
    let camera = |sight| Viewpoint {
        name: "c".into(),
        world_from_camera: Affine3A::from_rotation_translation(glam::Quat::from_rotation_y(0.2), Vec3::new(0.1, 0.5, 4.0)),
        sight,
        lens: Some([0.01, 2.0]),
        film: FilmHints {
            size: Some([30, 20]),
            diagonal_mm: Some(43.3),
            sensor: Some("canon".into()),
            iso: None,
            shift: [0.25, -0.5],
        },
        node: None,
    };
    let ball = |x: f32| Shape::Sphere(Sphere { center: Vec3::new(x, 0.3, 0.0), radius: 0.31 });
    let quad = Quad { corner: Vec3::new(-3.0, 0.0, -3.0), edges: [Vec3::Z * 6.0, Vec3::X * 6.0] };
    let shapes = [
        (Shape::Quad(quad), 2),
        (ball(-1.0), 0),
        (ball(0.0), 1),
        (ball(1.0), 5),
        (Shape::Curves { curves: 0, world_from_curves: Affine3A::from_translation(Vec3::Z) }, 4),
        (ball(2.0), 3),
        (ball(3.0), 6),
    ];
    Description {
        name: "unsayable".into(),
        materials: vec![
            glass,
            face,
            lamp,
            paper,
            named("hair", Scattering::Hair(Box::new(hair))),
            named("mix", Scattering::Mix(Box::new(mix))),
            twin,
        ],
        objects: shapes
            .into_iter()
            .enumerate()
            .map(|(i, (shape, material))| Object::new(format!("o{i}"), shape, material))
            .collect(),
        curves: vec![Arc::new(strands)],
        punctual: vec![
            Punctual {
                pattern: Some(Arc::new(pattern)),
                ..Punctual::new("spot", Spectrum::light_from_rgb(Vec3::new(900.0, 800.0, 100.0)), spot)
            },
            Punctual::new(
                "sun",
                blackbody_with_luminance(5800.0, 1e4),
                PunctualKind::Disc { direction: Vec3::NEG_Y, half_angle: 0.005 },
            ),
        ],
        environment: Some(environment),
        air: Some(Air { medium: smoke, bounds: Some(Bounds { min: Vec3::splat(-2.0), max: Vec3::splat(2.5) }) }),
        cameras: vec![
            camera(CameraProjection::Panorama),
            camera(CameraProjection::Table(table)),
            camera(CameraProjection::Perspective { vertical_fov: 0.7 }),
        ],
        max_depth: Some(12),
        declares_lamps: true,
        ..Description::default()
    }
}

#[test]
fn what_gltf_has_no_words_for_is_read_back_to_the_last_bit() {
    let before = unsayable();
    let written = gltf(&before);
    assert!(written.warnings.len() == 1 && written.warnings[0].contains("other programs"), "{:?}", written.warnings);
    let files = written.binary.clone();
    let fetch = |name: &str| if name == "x.bin" { Ok(files.clone()) } else { Err("not there".to_owned()) };
    for after in [
        load::gltf::load(&written.container(), "x.glb", &fetch).unwrap(),
        load::gltf::load(written.text("x.bin").as_bytes(), "x.gltf", &fetch).unwrap(),
    ] {
        assert!(after.warnings.is_empty(), "{:?}", after.warnings);
        for (a, b) in before.materials.iter().zip(&after.materials) {
            assert_eq!(shown(a), shown(b), "{}", a.name);
        }
        assert_eq!(before.materials.len(), after.materials.len());
        assert_eq!(shown(&before.punctual), shown(&after.punctual));
        assert_eq!(shown(&before.environment), shown(&after.environment));
        assert_eq!(shown(&before.air), shown(&after.air));
        assert_eq!(shown(&before.cameras), shown(&after.cameras));
        assert_eq!(shown(&before.curves), shown(&after.curves));
        assert_eq!((before.max_depth, before.declares_lamps), (after.max_depth, after.declares_lamps));
        let shapes =
            |d: &Description| d.objects.iter().map(|o| (shown(&o.shape), o.material, o.name.clone())).collect::<Vec<_>>();
        assert_eq!(shapes(&before), shapes(&after));
        // Faces of one medium are known by that.
        let side = |d: &Description, m: usize| match &d.materials[m].interior {
            Interior::Sides([inside, outside]) => [inside.clone(), outside.clone()],
            _ => panic!("a face"),
        };
        let ([Some(a), _], [Some(b), _]) = (side(&after, 1), side(&after, 6)) else { panic!("media") };
        assert!(Arc::ptr_eq(&a, &b));
    }
}

/// All keys of a value, in order and once each.
fn keys(value: &serde_json::Value, to: &mut std::collections::BTreeSet<String>) {
    match value {
        serde_json::Value::Object(object) => object.iter().for_each(|(key, value)| {
            to.insert(key.clone());
            keys(value, to);
        }),
        serde_json::Value::Array(list) => list.iter().for_each(|value| keys(value, to)),
        _ => (),
    }
}

#[test]
fn what_files_call_things_does_not_change_with_the_names_of_fields() {
    let json = serde_json::from_str(&gltf(&unsayable()).text("x.bin")).unwrap();
    let mut found = Default::default();
    keys(&json, &mut found);
    let found = found.into_iter().collect::<Vec<_>>().join(" ");
    // Files that were written before must be read: a key that goes, or gets another name, is still to be understood.
    assert_eq!(found, KEYS);
}

/// Keys of files of all that glTF has no words for, and of glTF's own.
const KEYS: &str = "\
    0 KHR_lights_punctual KHR_materials_anisotropy KHR_materials_dispersion KHR_materials_emissive_strength \
    KHR_materials_ior KHR_materials_specular KHR_materials_transmission KHR_materials_volume NORMAL POSITION TEXCOORD_0 a \
    absorption accessors across aimed_luminance air alpha alphaCutoff alphaMode amount anisotropy anisotropyRotation \
    anisotropyStrength as_number asset asymmetry attenuationColor attenuationDistance attributes b baseColorFactor \
    base_color basis beta_m beta_n blocks bounces bounds box_max box_min buffer bufferView bufferViews buffers bump \
    byteLength byteOffset bytes c camera cameras carrier cells_per_m center channel clearcoat clearcoat_roughness cloud \
    coat_normal codes color componentType corner cos_inner cos_outer count coverage curves cutoff data declares_lamps density diagonal_mm diopter \
    direction dispersion doubleSided duty edge edges emission emissiveFactor emissiveStrength environment eta eumelanin \
    even extensions extensionsUsed extras factor factors field file film fingerprint first_nm focus_m frequency \
    frequency_hz generator glow graph graphs grid half_angle height image image_from_uv images index_from_own indices \
    innerConeAngle intensity interior interpolation invalid invert ior is is_light is_subsurface iso k kind layered lens \
    light light_from_world lights map mapping material materials matrix max max_depth mean_luminance measured media \
    medium mesh meshes metal metallic metallicFactor metres mimeType min modulation n name nodes normal_map normals \
    octaves of offset outerConeAngle pane pattern pbrMetallicRoughness peak_radiance per_m per_nm perspective phase \
    pheomelanin picture pictures pigment place points position power primitives priority quad radiance radius rgb \
    roughness roughnessFactor scalars scale scattering scene scenes segments sensor sheen shift sides sight sigmoid size \
    spectra spectrum specular specularFactor specular_color sphere splats spot spread stop_mm table tangents target \
    temperature texels texture texture_from_world thicknessFactor tint tinted transmission transmissionFactor two_sided type \
    unit uri uv_set value values variation version vertical_fov view volume way wide wispiness world_from_map \
    world_from_own wrap yfov znear";

#[test]
fn light_in_fog_and_glass_is_the_same_before_and_after() {
    use diopter_light::random::{Sampler, SamplerKind};
    let before = unsayable();
    let none = |_: &str| Err("no files".to_owned());
    let after = load::gltf::load(&gltf(&before).container(), "x.glb", &none).unwrap();
    let view = before.cameras[2].world_from_camera;
    let [before, after] = [before, after].map(|d| Scene::build(d).unwrap());
    let settings = PathSettings { max_depth: 6, roulette_depth: 9 };
    let mut some = 0;
    for i in 0..60u32 {
        let (x, y) = ((i % 10) as f32 / 5.0 - 0.9, (i / 10) as f32 / 8.0 - 0.4);
        let direction = view.transform_vector3(Vec3::new(x, y, -1.0)).normalize();
        let ray = diopter_light::Ray { origin: view.translation.into(), direction, time_s: 0.0 };
        let sampler = Sampler::new(SamplerKind::Independent, 3, (i, 7), 0, 1);
        let wavelengths = diopter_light::SampledWavelengths::fixed([450.0, 520.0, 590.0, 660.0]);
        let [a, b] = [&before, &after].map(|s| s.radiance(ray, &wavelengths, &sampler, &settings));
        assert_eq!(a.to_array().map(f32::to_bits), b.to_array().map(f32::to_bits), "{i}: {a} {b}");
        some += u32::from(a.max_element() > 0.0);
    }
    assert!(some > 20, "{some}");
}

#[test]
fn what_another_program_has_changed_counts() {
    let mut written = gltf(&unsayable());
    let none = |_: &str| Err("no files".to_owned());
    written.json["materials"][2]["name"] = json!("other");
    let after = load::gltf::load(&written.container(), "x.glb", &none).unwrap();
    assert!(after.warnings.iter().any(|w| w.contains("another program has changed it")), "{:?}", after.warnings);
    assert!(after.air.is_none() && after.materials[2].name == "other");
    assert!(matches!(after.materials[5].scattering, Scattering::Principled(_)));
    // Bytes of the buffer, too; and nonsense is no panic.
    let mut written = gltf(&unsayable());
    *written.binary.last_mut().unwrap() ^= 1;
    let after = load::gltf::load(&written.container(), "x.glb", &none).unwrap();
    assert!(after.warnings.iter().any(|w| w.contains("another program has changed it")), "{:?}", after.warnings);
    for (place, value) in
        [("media", json!([{ "name": 3 }])), ("curves", json!([7])), ("graphs", json!([{ "is": "Power", "base": 0 }]))]
    {
        let mut written = gltf(&unsayable());
        written.json["extras"][KEY][place] = value;
        written.json["extras"][KEY]["fingerprint"] = json!(fingerprint(&written.json, &written.binary));
        let after = load::gltf::load(&written.container(), "x.glb", &none).unwrap();
        assert!(after.air.is_none() && after.warnings.len() == 1, "{place}: {:?}", after.warnings);
    }
}

#[test]
fn splats_are_read_back_to_the_last_bit_and_by_other_programs() {
    use crate::material::Material;
    use crate::scene::Object;
    use crate::shape::{ColorCurve, Splat, Splats};
    let (mut set, mut made) = (Splats::new(2).with_curve(ColorCurve::Linear), vec![]);
    for i in 0..60u32 {
        let f = |k: u32| ((i * 31 + k * 17) % 97) as f32 / 97.0;
        let rotation = glam::Quat::from_xyzw(f(1) - 0.5, f(2) - 0.4, f(3) - 0.3, f(4) + 0.1).normalize();
        let scale = Vec3::new(0.01 + f(5), 0.02 + f(6), 0.005 + f(7));
        let splat = Splat { center: Vec3::new(f(8), f(9), f(10)), rotation, scale, opacity: 0.1 + 0.85 * f(11) };
        let harmonics: Vec<Vec3> = (0..9).map(|k| Vec3::new(f(12 + k), f(22 + k) - 0.5, f(32 + k))).collect();
        assert!(set.push(&splat, &harmonics));
        made.push((splat, harmonics));
    }
    let place =
        Affine3A::from_scale_rotation_translation(Vec3::splat(2.0), glam::Quat::from_rotation_y(0.5), Vec3::new(1.0, 2.0, 3.0));
    let before = Description {
        materials: vec![Material::captured("captured", 300.0)],
        objects: vec![Object::new("place", Shape::Splats { splats: 0, world_from_splats: place }, 0)],
        splats: vec![Arc::new(set)],
        ..Description::default()
    };
    let mut written = gltf(&before);
    assert!(written.warnings.is_empty(), "{:?}", written.warnings);
    let none = |_: &str| Err("no files".to_owned());
    let after = load::gltf::load(&written.container(), "x.glb", &none).unwrap();
    assert!(after.warnings.is_empty(), "{:?}", after.warnings);
    assert_eq!(format!("{:?}", before.splats), format!("{:?}", after.splats));
    assert_eq!(format!("{:?}", before.materials), format!("{:?}", after.materials));
    assert_eq!(format!("{:?}", before.objects[0].shape), format!("{:?}", after.objects[0].shape));
    // As other programs see it: by the extension alone.
    written.json.as_object_mut().unwrap().remove("extras");
    let plain = load::gltf::load(&written.container(), "x.glb", &none).unwrap();
    let [own, theirs] = [&before.splats[0], &plain.splats[0]];
    assert_eq!((theirs.len(), theirs.degree(), theirs.curve()), (60, 2, ColorCurve::Linear));
    for (splat, _) in &made {
        let near = |i: &usize| theirs.splat(*i).center.distance(splat.center) < 1e-6;
        let (i, k) = ((0..60).find(near).unwrap(), (0..60).find(|k| own.splat(*k).center == splat.center).unwrap());
        let other = theirs.splat(i);
        assert!(
            (other.scale / splat.scale - Vec3::ONE).abs().max_element() < 1e-4 && (other.opacity - splat.opacity).abs() < 1e-6
        );
        // Axes may have changed their order of sign, not the ellipsoid.
        let spread = |s: &Splat| {
            let axes = glam::Mat3::from_quat(s.rotation.normalize()) * glam::Mat3::from_diagonal(s.scale);
            axes * axes.transpose()
        };
        let apart = spread(&other) - spread(splat);
        assert!(apart.to_cols_array().iter().all(|v| v.abs() < 1e-4), "{apart}");
        assert!((0..9).all(|c| own.harmonic(k, c) == theirs.harmonic(i, c)));
    }
    // Lists that do not fit are an error of what is kept, no panic.
    let mut written = gltf(&before);
    written.json["extras"][KEY]["splats"][0]["degree"] = json!(3);
    written.json["extras"][KEY]["fingerprint"] = json!(fingerprint(&written.json, &written.binary));
    let after = load::gltf::load(&written.container(), "x.glb", &none).unwrap();
    assert!(after.warnings.iter().any(|w| w.contains("do not fit")), "{:?}", after.warnings);
}
