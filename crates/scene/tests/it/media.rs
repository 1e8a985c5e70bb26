//! Light in fog and in bodies against closed forms.

use diopter_light::Spectrum;
use diopter_light::spectrum::Table;
use diopter_scene::bvh::Bounds;
use diopter_scene::light::{Environment, Modulation, Punctual, PunctualKind, SpotEdge};
use diopter_scene::load::mitsuba;
use diopter_scene::material::{Emission, EmissionColor, Interior, Material, Scattering};
use diopter_scene::medium::{Air, Coefficient, Medium};
use diopter_scene::shape::{Mesh, Quad, Sphere};
use diopter_scene::{Description, Object, PathSettings, Scene, Shape};
use glam::{Affine3A, Vec3};
use std::sync::Arc;

use crate::common::{DEEP, NM, assert_within, mean};

fn assert_near(found: ([f64; 4], [f64; 4]), expected: [f64; 4], what: &str) {
    assert_within(found, expected, 2e-3, what);
}

fn colored() -> Spectrum {
    Spectrum::Table(Table::from_points(&[(400.0, 3.0), (700.0, 0.5)]))
}

fn face(interior: Interior) -> Material {
    Material { interior, ..Material::new("face", Scattering::Interface) }
}

fn ball(material: u32, radius: f32) -> Object {
    Object::new("ball", Shape::Sphere(Sphere { center: Vec3::ZERO, radius }), material)
}

fn box_mesh(min: Vec3, max: Vec3) -> Mesh {
    let at = |i: u32| {
        Vec3::new([min.x, max.x][(i & 1) as usize], [min.y, max.y][(i >> 1 & 1) as usize], [min.z, max.z][(i >> 2) as usize])
    };
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    Mesh { positions: (0..8).map(at).collect(), triangles, ..Default::default() }
}

#[test]
fn what_only_scatters_is_invisible_in_even_light() {
    for g in [-0.4, 0.0, 0.8] {
        let smoke = Medium {
            name: "smoke".into(),
            absorption: Coefficient::NONE,
            scattering: Coefficient::Scaled(1.0, colored()),
            asymmetry: g,
            ..Default::default()
        };
        for interior in [
            Interior::Body { medium: Some(Arc::new(smoke.clone())), priority: None },
            Interior::Sides([Some(Arc::new(smoke.clone())), None]),
        ] {
            let scene = Scene::build(Description {
                materials: vec![face(interior)],
                objects: vec![ball(0, 1.0)],
                environment: Some(Environment::uniform(Vec3::ONE)),
                ..Default::default()
            })
            .unwrap();
            assert_near(mean(&scene, Vec3::new(0.3, 0.1, 3.0), Vec3::NEG_Z, 20_000, &DEEP), [1.0; 4], &format!("g {g}"));
        }
    }
}

#[test]
fn smoke_in_glass_stays_within_it() {
    // A smooth glass ball of milk, white all through.
    let milk = Medium { absorption: Coefficient::NONE, ..Medium::fog(2.0, 1.0, 0.5) };
    let scene = Scene::build(Description {
        materials: vec![Material::glass("milk", 1.4, Some(milk))],
        objects: vec![ball(0, 1.0)],
        environment: Some(Environment::uniform(Vec3::ONE)),
        ..Default::default()
    })
    .unwrap();
    assert_near(mean(&scene, Vec3::new(0.5, 0.1, 3.0), Vec3::NEG_Z, 20_000, &DEEP), [1.0; 4], "milk");
}

/// Light of a lamp of 1 cd that is scattered once into a ray along +x, from its start to `length`.
fn once(lamp: Vec3, length: f64, sigma_s: f64, sigma_t: f64, g: f64) -> f64 {
    let n = 200_000;
    (0..n)
        .map(|i| {
            let s = (i as f64 + 0.5) / n as f64 * length;
            let to = lamp.as_dvec3() - glam::DVec3::X * s;
            let r = to.length();
            let cos = to.x / r;
            let phase = (1.0 - g * g) / (4.0 * std::f64::consts::PI * (1.0 + g * g - 2.0 * g * cos).powf(1.5));
            sigma_s * phase * (-sigma_t * (s + r)).exp() / (r * r) * length / n as f64
        })
        .sum()
}

#[test]
fn fog_shows_lamps_as_single_scattering_says() {
    let lamp = Vec3::new(4.0, 1.5, 0.3);
    let (sigma_s, sigma_a, g) = (0.12f32, 0.05f32, 0.6f32);
    let fog = Medium {
        name: "fog".into(),
        absorption: Coefficient::grey(sigma_a),
        scattering: Coefficient::Scaled(sigma_s, colored()),
        asymmetry: g,
        ..Default::default()
    };
    let kind = PunctualKind::Point { position: lamp };
    let wall = Quad { corner: Vec3::new(8.0, -9.0, -9.0), edges: [Vec3::Y * 18.0, Vec3::Z * 18.0] };
    let scene = |bounds| {
        Scene::build(Description {
            materials: vec![Material::new("wall", Scattering::Black)],
            objects: vec![Object::new("wall", Shape::Quad(wall), 0)],
            punctual: vec![Punctual::new("lamp", Spectrum::light_from_rgb(Vec3::ONE), kind)],
            air: Some(Air { medium: fog.clone(), bounds }),
            ..Default::default()
        })
        .unwrap()
    };
    let settings = PathSettings { max_depth: 1, roulette_depth: 10 };
    let expected = NM.map(|nm| {
        let s = (sigma_s * colored().at(nm)) as f64;
        once(lamp, 8.0, s, s + sigma_a as f64, g as f64)
    });
    assert_near(mean(&scene(None), Vec3::ZERO, Vec3::X, 200_000, &settings), expected, "endless fog");
    // The same in a box that holds all of it: the way to the camera before the box is clear.
    let around = Bounds { min: Vec3::new(0.0, -50.0, -50.0), max: Vec3::splat(50.0) };
    assert_near(mean(&scene(Some(around)), Vec3::X * -5.0, Vec3::X, 200_000, &settings), expected, "fog in a box");
}

const ONCE: PathSettings = PathSettings { max_depth: 1, roulette_depth: 10 };

/// Variance of one sample of the same light where distances are drawn by extinction alone, for each of the wavelengths: ∫ f²/p dt − (∫ f dt)².
fn variance_by_extinction(lamp: Vec3, length: f64, sigma_s: [f64; 4], sigma_a: f64, g: f64) -> [f64; 4] {
    let n = 200_000;
    let step = length / n as f64;
    let (mut sum, mut squares) = ([0.0f64; 4], [0.0f64; 4]);
    for i in 0..n {
        let t = (i as f64 + 0.5) * step;
        let to = lamp.as_dvec3() - glam::DVec3::X * t;
        let r = to.length();
        let phase = (1.0 - g * g) / (4.0 * std::f64::consts::PI * (1.0 + g * g - 2.0 * g * to.x / r).powf(1.5));
        let density: f64 = sigma_s.iter().map(|s| (s + sigma_a) * (-(s + sigma_a) * t).exp() / 4.0).sum();
        for k in 0..4 {
            let f = sigma_s[k] * phase * (-(sigma_s[k] + sigma_a) * (t + r)).exp() / (r * r);
            (sum[k], squares[k]) = (sum[k] + f * step, squares[k] + f * f / density * step);
        }
    }
    std::array::from_fn(|k| squares[k] - sum[k] * sum[k])
}

#[test]
fn lamps_in_fog_leave_no_single_bright_samples() {
    // A lamp 11 cm beside the ray, 4 m ahead: by extinction alone the variance is above eight times the square of the mean.
    let lamp = Vec3::new(4.0, 0.05, 0.1);
    let (sigma_s, sigma_a, g) = (0.12f32, 0.05f32, 0.6f32);
    let fog = Medium {
        name: "fog".into(),
        absorption: Coefficient::grey(sigma_a),
        scattering: Coefficient::Scaled(sigma_s, colored()),
        asymmetry: g,
        ..Default::default()
    };
    let wall = Quad { corner: Vec3::new(8.0, -9.0, -9.0), edges: [Vec3::Y * 18.0, Vec3::Z * 18.0] };
    let kind = PunctualKind::Point { position: lamp };
    let scene = Scene::build(Description {
        materials: vec![Material::new("wall", Scattering::Black)],
        objects: vec![Object::new("wall", Shape::Quad(wall), 0)],
        punctual: vec![Punctual::new("lamp", Spectrum::light_from_rgb(Vec3::ONE), kind)],
        air: Some(Air { medium: fog, bounds: None }),
        ..Default::default()
    })
    .unwrap();
    let scattering = NM.map(|nm| f64::from(sigma_s * colored().at(nm)));
    let expected = scattering.map(|s| once(lamp, 8.0, s, s + f64::from(sigma_a), f64::from(g)));
    let plain = variance_by_extinction(lamp, 8.0, scattering, f64::from(sigma_a), f64::from(g));
    let n = 20_000;
    let (found, error) = mean(&scene, Vec3::ZERO, Vec3::X, n, &ONCE);
    for k in 0..4 {
        assert!(
            (found[k] - expected[k]).abs() < 3.0 * error[k],
            "{} nm: {} ± {}, expected {}",
            NM[k],
            found[k],
            error[k],
            expected[k]
        );
        // Integrating the weighted strategies gives 0.024 of the variance and 0.20 of the square of the mean.
        let variance = error[k].powi(2) * f64::from(n);
        assert!(variance < 0.05 * plain[k], "{} nm: variance {variance}, by extinction alone {}", NM[k], plain[k]);
        assert!(variance < 0.3 * expected[k].powi(2), "{} nm: variance {variance}, mean {}", NM[k], expected[k]);
    }
}

#[test]
fn a_lamp_in_a_body_of_fog_lights_only_the_body() {
    // A ball of fog of 2 m without a surface, in clear air, and a lamp within: the camera and what is behind are in the clear.
    let lamp = Vec3::new(0.2, 0.3, 0.1);
    let fog = Medium { absorption: Coefficient::grey(0.1), scattering: Coefficient::grey(0.4), ..Medium::fog(1.0, 1.0, 0.3) };
    let scene = Scene::build(Description {
        materials: vec![face(Interior::Body { medium: Some(Arc::new(fog)), priority: None })],
        objects: vec![ball(0, 2.0)],
        punctual: vec![Punctual::new("lamp", Spectrum::light_from_rgb(Vec3::ONE), PunctualKind::Point { position: lamp })],
        ..Default::default()
    })
    .unwrap();
    // Seen from where the ray enters the ball.
    let expected = once(lamp + Vec3::X * 2.0, 4.0, 0.4, 0.5, 0.3);
    assert_near(mean(&scene, Vec3::X * -7.0, Vec3::X, 40_000, &ONCE), [expected; 4], "a body of fog");
}

#[test]
fn the_beam_of_a_spot_in_fog_is_where_its_cone_is() {
    // Across the ray, and against it like a headlamp.
    let fog = Medium { absorption: Coefficient::grey(0.02), scattering: Coefficient::grey(0.1), ..Medium::fog(1.0, 1.0, 0.5) };
    let (cos_inner, cos_outer) = (0.97f32, 0.9f32);
    for (position, toward) in
        [(Vec3::new(5.0, 2.0, 0.4), Vec3::new(0.1, -1.0, -0.2)), (Vec3::new(9.0, 0.3, 0.0), Vec3::new(-1.0, -0.05, 0.0))]
    {
        let direction = toward.normalize();
        let kind = PunctualKind::Spot { position, direction, cos_inner, cos_outer, edge: SpotEdge::Squared };
        let scene = Scene::build(Description {
            materials: vec![Material::new("far", Scattering::Black)],
            objects: vec![Object::new("far", Shape::Sphere(Sphere { center: Vec3::Z * 1000.0, radius: 1.0 }), 0)],
            punctual: vec![Punctual::new("lamp", Spectrum::light_from_rgb(Vec3::ONE), kind)],
            air: Some(Air { medium: fog.clone(), bounds: None }),
            ..Default::default()
        })
        .unwrap();
        let (length, n) = (120.0, 400_000);
        let expected: f64 = (0..n)
            .map(|i| {
                let s = (f64::from(i) + 0.5) / f64::from(n) * length;
                let to = position.as_dvec3() - glam::DVec3::X * s;
                let r = to.length();
                let cos = -direction.as_dvec3().dot(to) / r;
                let ramp = ((cos - f64::from(cos_outer)) / f64::from(cos_inner - cos_outer)).clamp(0.0, 1.0);
                let phase = 0.75 / (4.0 * std::f64::consts::PI * (1.25 - to.x / r).powf(1.5));
                0.1 * phase * ramp * ramp * (-0.12 * (s + r)).exp() / (r * r) * length / f64::from(n)
            })
            .sum();
        let found = mean(&scene, Vec3::ZERO, Vec3::X, 40_000, &ONCE);
        assert!(found.1[0] < 0.01 * found.0[0], "{found:?}");
        assert_near(found, [expected; 4], "a spot");
    }
}

#[test]
fn all_ways_to_a_lamp_with_extent_add_up_to_its_light() {
    // Smoke that only scatters is invisible within walls of one radiance, however deep: a box of six lamps, which the three strategies find with very
    // different densities.
    let [e, f] = [2.0f32, 1.0];
    let walls = [
        (Vec3::new(-e, -f, -f), [Vec3::Y, Vec3::Z]),
        (Vec3::new(e, -f, -f), [Vec3::Z, Vec3::Y]),
        (Vec3::new(-e, -f, -f), [Vec3::Z, Vec3::X]),
        (Vec3::new(-e, f, -f), [Vec3::X, Vec3::Z]),
        (Vec3::new(-e, -f, -f), [Vec3::X, Vec3::Y]),
        (Vec3::new(-e, -f, f), [Vec3::Y, Vec3::X]),
    ];
    let size = Vec3::new(2.0 * e, 2.0 * f, 2.0 * f);
    for g in [-0.3, 0.0, 0.8] {
        let smoke = Medium {
            name: "smoke".into(),
            absorption: Coefficient::NONE,
            scattering: Coefficient::Scaled(0.7, colored()),
            asymmetry: g,
            ..Default::default()
        };
        let scene = Scene::build(Description {
            materials: vec![Material::lamp("wall", Spectrum::light_from_rgb(Vec3::ONE))],
            objects: walls
                .iter()
                .map(|(corner, edges)| {
                    Object::new("wall", Shape::Quad(Quad { corner: *corner, edges: edges.map(|v| v * size) }), 0)
                })
                .collect(),
            air: Some(Air { medium: smoke, bounds: None }),
            ..Default::default()
        })
        .unwrap();
        let found = mean(&scene, Vec3::new(-1.5, 0.3, 0.2), Vec3::new(1.0, 0.1, -0.2), 10_000, &DEEP);
        assert!(found.1[0] < 0.02, "{found:?}");
        assert_near(found, [1.0; 4], &format!("g {g}"));
    }
}

#[test]
fn small_round_lamps_in_fog_are_as_points() {
    // A ball of 1 cd: radiance 1 / (π r²).
    let (center, radius) = (Vec3::new(4.0, 0.5, 0.2), 0.02f32);
    let fog = Medium { absorption: Coefficient::grey(0.05), scattering: Coefficient::grey(0.2), ..Medium::fog(1.0, 1.0, 0.6) };
    let radiance = 1.0 / (std::f32::consts::PI * radius * radius);
    let scene = Scene::build(Description {
        materials: vec![Material::lamp("ball", Spectrum::light_from_rgb(Vec3::splat(radiance)))],
        objects: vec![Object::new("ball", Shape::Sphere(Sphere { center, radius }), 0)],
        air: Some(Air { medium: fog, bounds: None }),
        ..Default::default()
    })
    .unwrap();
    let found = mean(&scene, Vec3::ZERO, Vec3::X, 40_000, &ONCE);
    // Noise of equi-angular samples: about half of the mean a sample.
    assert!(found.1[0] < 0.005 * found.0[0], "{found:?}");
    assert_near(found, [once(center, 60.0, 0.2, 0.25, 0.6); 4], "a small ball");
}

#[test]
fn surfaces_and_lamps_are_seen_through_fog_and_faces() {
    // A white wall lit by an area lamp, all within a face that changes nothing, in air that absorbs.
    let lamp = Quad { corner: Vec3::new(-0.5, 2.0, -0.5), edges: [Vec3::X, Vec3::Z] };
    let floor = Quad { corner: Vec3::new(-5.0, 0.0, 5.0), edges: [Vec3::X * 10.0, Vec3::NEG_Z * 10.0] };
    let scene = |sigma: f32, faces: bool| {
        let air = Medium { absorption: Coefficient::grey(sigma), scattering: Coefficient::NONE, ..Medium::fog(1.0, 0.0, 0.0) };
        let medium = Some(Arc::new(air.clone()));
        let mut objects = vec![Object::new("lamp", Shape::Quad(lamp), 0), Object::new("floor", Shape::Quad(floor), 1)];
        if faces {
            objects.push(Object::new(
                "sheet",
                Shape::Quad(Quad { corner: Vec3::new(-5.0, 1.0, 5.0), edges: [Vec3::X * 10.0, Vec3::NEG_Z * 10.0] }),
                2,
            ));
            objects.push(ball(2, 8.0));
        }
        Scene::build(Description {
            materials: vec![
                Material::lamp("lamp", Spectrum::light_from_rgb(Vec3::splat(10.0))),
                Material::new("floor", Scattering::Diffuse(diopter_scene::texture::Color::rgb(1.0, 1.0, 1.0))),
                face(Interior::Sides([medium.clone(), medium.clone()])),
            ],
            objects,
            air: Some(Air { medium: air, bounds: None }),
            ..Default::default()
        })
        .unwrap()
    };
    let settings = PathSettings { max_depth: 1, roulette_depth: 10 };
    let look = |s: &Scene| mean(s, Vec3::new(0.2, 0.5, 1.0), Vec3::new(-0.2, -0.5, -1.0), 40_000, &settings);
    let (clear, noise) = look(&scene(0.0, false));
    assert!(clear[0] > 0.3 && noise[0] < 0.01 * clear[0], "{clear:?} {noise:?}");
    assert_near(look(&scene(0.0, true)), clear, "faces alone");
    // e^(−σ (way to the camera)) × about e^(−σ 2): between the lamp's nearest and farthest points.
    let dim = look(&scene(0.3, false)).0[0] / clear[0];
    let way = Vec3::new(0.2, 0.5, 1.0).length() as f64;
    assert!((-0.3 * (way + 2.2)).exp() < dim && dim < (-0.3 * (way + 1.95)).exp(), "{dim}");
    assert_near(look(&scene(0.3, true)), [dim * clear[0]; 4], "faces and air");
}

#[test]
fn hot_gas_shines_as_deep_as_it_is() {
    let gas = Medium {
        name: "gas".into(),
        absorption: Coefficient::grey(0.7),
        scattering: Coefficient::NONE,
        asymmetry: 0.0,
        emission: Some(Spectrum::light_from_rgb(Vec3::splat(5.0))),
        ..Default::default()
    };
    let scene = Scene::build(Description {
        materials: vec![face(Interior::Body { medium: Some(Arc::new(gas)), priority: None })],
        objects: vec![ball(0, 1.0)],
        ..Default::default()
    })
    .unwrap();
    let expected = 5.0 * (1.0 - (-0.7f64 * 2.0).exp());
    assert_near(mean(&scene, Vec3::Z * 3.0, Vec3::NEG_Z, 16, &DEEP), [expected; 4], "gas");
}

/// A body of an index, grey absorption (1/m) and priority.
fn tinted_body(name: &str, ior: f32, tint: f32, priority: Option<i32>) -> Material {
    let medium = Medium { absorption: Coefficient::grey(tint), ..Medium::fog(1.0, 0.0, 0.0) };
    let medium = Medium { scattering: Coefficient::NONE, ..medium };
    Material { interior: Interior::Body { medium: Some(Arc::new(medium)), priority }, ..Material::glass(name, ior, None) }
}

/// A lamp of radiance 1 that covers the floor z = −3.
fn shining_floor(material: u32) -> (Material, Object) {
    let shine = Emission {
        radiance: EmissionColor::Constant(Spectrum::light_from_rgb(Vec3::ONE)),
        two_sided: true,
        is_light: false,
        modulation: Modulation::Steady,
    };
    let lamp = Material { emission: Some(shine), ..Material::new("lamp", Scattering::Black) };
    let floor = Quad { corner: Vec3::new(-5.0, -5.0, -3.0), edges: [Vec3::X * 10.0, Vec3::Y * 10.0] };
    (lamp, Object::new("lamp", Shape::Quad(floor), material))
}

#[test]
fn bodies_of_one_material_and_priority_are_one_body_where_they_overlap() {
    // From z = 0 to 1 and from −1 to 0.3, both of one material: two faces and 2 m of it, not four and 2.3 m.
    let half = Vec3::new(5.0, 5.0, 0.0);
    let (lamp, floor) = shining_floor(1);
    let mesh = |mesh| Shape::Mesh { mesh, world_from_mesh: Affine3A::IDENTITY };
    let scene = Scene::build(Description {
        meshes: [box_mesh(-half, half + Vec3::Z), box_mesh(-half + Vec3::NEG_Z, half + Vec3::Z * 0.3)].map(Into::into).to_vec(),
        materials: vec![tinted_body("glass", 1.5, 0.4, Some(1)), lamp],
        objects: vec![Object::new("upper", mesh(0), 0), Object::new("lower", mesh(1), 0), floor],
        ..Default::default()
    })
    .unwrap();
    let settings = PathSettings { max_depth: 2, roulette_depth: 100 };
    let found = mean(&scene, Vec3::new(0.3, 0.2, 4.0), Vec3::NEG_Z, 40_000, &settings);
    assert_near(found, [(1.0 - 0.04f64).powi(2) * (-0.4f64 * 2.0).exp(); 4], "one body");
}

#[test]
fn paths_that_are_followed_less_far_find_as_much_light() {
    use diopter_light::random::{Sampler, SamplerKind};
    use diopter_light::{Ray, SampledWavelengths};
    use diopter_scene::RouletteRates;
    use diopter_scene::radiance::CameraPath;
    use diopter_scene::radiance::record::RadianceAndWork;
    // Thick fog before a grey wall, so that most light is scattered often.
    let fog = Medium { name: "fog".into(), scattering: Coefficient::grey(0.4), asymmetry: 0.5, ..Default::default() };
    let wall = Quad { corner: Vec3::new(8.0, -9.0, -9.0), edges: [Vec3::Y * 18.0, Vec3::Z * 18.0] };
    let kind = PunctualKind::Point { position: Vec3::new(4.0, 2.0, 0.5) };
    let scene = Scene::build(Description {
        materials: vec![Material::new("wall", Scattering::Diffuse(diopter_scene::texture::Color::rgb(0.6, 0.6, 0.6)))],
        objects: vec![Object::new("wall", Shape::Quad(wall), 0)],
        punctual: vec![Punctual::new("lamp", Spectrum::light_from_rgb(Vec3::ONE), kind)],
        air: Some(Air { medium: fog, bounds: None }),
        ..Default::default()
    })
    .unwrap();
    let rates = RouletteRates::best([1.0, 1.0], [[0.04, 1.0]; RouletteRates::EVENTS.len()]).expect("few go on");
    assert!(rates.after(1) < 0.4 && rates.after(1) > 0.1);
    let n = 150_000;
    let seen = |roulette: Option<&RouletteRates>| {
        let path = |i: u32| {
            let sampler = Sampler::new(SamplerKind::Independent, 5, (i, 0), 0, 1);
            let ray = Ray { origin: Vec3::ZERO, direction: Vec3::new(1.0, 0.3, 0.1).normalize(), time_s: 0.0 };
            CameraPath { roulette, ..CameraPath::new(ray, SampledWavelengths::fixed(NM), sampler) }
        };
        let paths: Vec<CameraPath> = (0..n).map(path).collect();
        let found = scene.trace(&paths, RadianceAndWork, &PathSettings::default());
        let work: u32 = found.iter().map(|(_, work)| work.segments).sum();
        let light: Vec<f64> = found.iter().map(|(light, _)| f64::from(light.element_sum())).collect();
        let mean = light.iter().sum::<f64>() / f64::from(n);
        let variance = light.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / f64::from(n);
        (mean, variance / f64::from(n), work)
    };
    let (all, few) = (seen(None), seen(Some(&rates)));
    assert!(few.2 * 3 < all.2 * 2, "{few:?} {all:?}");
    // Four standard deviations, below one part in a hundred.
    let sigma = (all.1 + few.1).sqrt();
    assert!((all.0 - few.0).abs() < 4.0 * sigma && sigma < 0.01 * all.0, "{few:?} {all:?}");
}

#[test]
fn where_bodies_overlap_the_stronger_one_is() {
    // Glass from z = 0 to 1, water from −1 to 0.3, a lamp far below; the way straight down.
    let half = Vec3::new(5.0, 5.0, 0.0);
    let transmitted = |a: f64, b: f64| 1.0 - ((a - b) / (a + b)).powi(2);
    for glass_first in [Some(true), Some(false), None] {
        let (glass, water) = match glass_first {
            Some(true) => (Some(2), Some(1)),
            Some(false) => (Some(1), Some(2)),
            None => (None, None),
        };
        let (lamp, floor) = shining_floor(2);
        let mesh = |mesh| Shape::Mesh { mesh, world_from_mesh: Affine3A::IDENTITY };
        let scene = Scene::build(Description {
            meshes: [box_mesh(-half, half + Vec3::Z), box_mesh(-half + Vec3::NEG_Z, half + Vec3::Z * 0.3)]
                .map(Into::into)
                .to_vec(),
            materials: vec![tinted_body("glass", 1.5, 0.1, glass), tinted_body("water", 1.33, 0.9, water), lamp],
            objects: vec![Object::new("glass", mesh(0), 0), Object::new("water", mesh(1), 1), floor],
            ..Default::default()
        })
        .unwrap();
        let (air_glass, glass_water, air_water) = (transmitted(1.0, 1.5), transmitted(1.5, 1.33), transmitted(1.0, 1.33));
        let (events, expected) = match glass_first {
            Some(true) => (3, air_glass * glass_water * air_water * (-0.1f64 - 0.9).exp()),
            Some(false) => (3, air_glass * glass_water * air_water * (-0.07f64 - 0.9 * 1.3).exp()),
            // Each by itself, against vacuum.
            None => (4, air_glass.powi(2) * air_water.powi(2) * (-0.07f64 - 0.9 * 1.3).exp()),
        };
        let settings = PathSettings { max_depth: events, roulette_depth: 100 };
        let found = mean(&scene, Vec3::new(0.3, 0.2, 4.0), Vec3::NEG_Z, 40_000, &settings);
        assert_near(found, [expected; 4], &format!("{glass_first:?}"));
    }
}

/// Light along −z through the middle of a scene of Mitsuba, in a white world.
fn through_mitsuba(shapes: &str) -> [f64; 4] {
    let text = format!("<scene version='3.0.0'><emitter type='constant'/>{shapes}</scene>");
    let plate = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\n";
    let fetch = |name: &str| match name {
        "with.obj" => Ok(format!("{plate}vn 0 0 1\nf 1//1 2//1 3//1 4//1\n").into_bytes()),
        "without.obj" => Ok(format!("{plate}f 1 2 3 4\n").into_bytes()),
        _ => Err("there is no such file".to_owned()),
    };
    let scene = Scene::build(mitsuba::load(text.as_bytes(), "s.xml", &fetch).unwrap()).unwrap();
    mean(&scene, Vec3::new(0.0, 0.0, 3.0), Vec3::NEG_Z, 20_000, &DEEP).0
}

#[test]
fn media_of_mitsuba_are_those_of_the_last_face_that_named_one() {
    let medium = "<medium type='homogeneous' id='m'><float name='sigma_t' value='0.5'/><float name='albedo' value='0'/></medium>";
    let glass = "<bsdf type='dielectric'><float name='int_ior' value='1.5'/><float name='ext_ior' value='1'/></bsdf>";
    let null = "<bsdf type='null'/>";
    let ball = |radius: f64, what: &str| format!("<shape type='sphere'><float name='radius' value='{radius}'/>{what}</shape>");
    // Straight through glass that lets `t` pass between its faces, each of which reflects 4 %; all that leaves it is white.
    let glassy = |t: f64| 0.04 + 0.96 * 0.96 * t / (1.0 - 0.04 * t);
    for (what, shapes, expected) in [
        (
            "a bubble that names what is around it",
            format!(
                "{medium}{}{}",
                ball(1.0, &format!("{glass}<ref name='interior' id='m'/>")),
                ball(0.5, &format!("{null}<ref name='exterior' id='m'/>"))
            ),
            glassy((-0.5f64).exp()),
        ),
        (
            "fog goes on in glass that names no medium",
            format!("{medium}{}{}", ball(2.0, &format!("{null}<ref name='interior' id='m'/>")), ball(1.0, glass)),
            // A metre on each side of the ball, and two in it.
            (-0.5f64).exp() * (0.04 * (-0.5f64).exp() + 0.96 * 0.96 * (-1.5f64).exp() / (1.0 - 0.04 * (-1.0f64).exp())),
        ),
    ] {
        let found = through_mitsuba(&shapes);
        assert!(found.iter().all(|v| (v / expected - 1.0).abs() < 0.01), "{what}: {found:?}, expected {expected}");
    }
}

#[test]
fn mirrored_lamps_of_mitsuba_shine_inwards_where_its_normals_turn() {
    let lamp = |scale: &str| {
        format!(
            "<shape type='sphere'><transform name='to_world'><scale x='{scale}' y='1' z='1'/></transform><emitter type='area'><rgb name='radiance' value='7'/></emitter></shape>"
        )
    };
    for (scale, expected) in [("1", 7.0), ("-1", 0.0)] {
        let found = through_mitsuba(&lamp(scale))[1];
        assert!((found - expected).abs() < 0.05, "{scale}: {found}");
    }
    // A plate of a file towards +z: with normals of its own it stays as it is, as in Mitsuba 3.9.1, without it turns.
    for (file, expected) in [("with.obj", 7.0), ("without.obj", 0.0)] {
        let plate = format!(
            "<shape type='obj'><string name='filename' value='{file}'/><transform name='to_world'><scale x='-1' y='1' z='1'/></transform><emitter type='area'><rgb name='radiance' value='7'/></emitter></shape>"
        );
        let found = through_mitsuba(&plate)[1];
        assert!((found - expected).abs() < 0.05, "{file}: {found}");
    }
}
