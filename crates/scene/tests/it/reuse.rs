//! Paths of a group that lend one another light: the same means, less noise.

use diopter_image::Raster;
use diopter_light::random::{Dimensions, Sampler, SamplerKind};
use diopter_light::wavelength::WavelengthSampler;
use diopter_light::{Ray, SampledSpectrum, Spectrum};
use diopter_scene::bvh::Bounds;
use diopter_scene::light::{Environment, Punctual, PunctualKind};
use diopter_scene::light_paths::{CausticSettings, Caustics, Lamps, LightPaths};
use diopter_scene::material::conductor::FacetBounces;
use diopter_scene::material::{Conductor, Coverage, Interior, Material, Principled, Scattering, Transmission};
use diopter_scene::medium::{Air, Coefficient, Medium};
use diopter_scene::radiance::CameraPath;
use diopter_scene::radiance::record::{Radiance, RadianceAndDirect};
use diopter_scene::shape::{Mesh, Quad, Sphere};
use diopter_scene::texture::{Color, Scalar};
use diopter_scene::{Description, Object, PathSettings, Scene, Shape};
use glam::{Affine3A, Mat3, Vec3};
use std::sync::Arc;

const GROUP: u32 = 16;

fn quad(name: &str, corner: [f32; 3], edges: [[f32; 3]; 2], material: u32) -> Object {
    Object::new(name, Shape::Quad(Quad { corner: corner.into(), edges: edges.map(Vec3::from) }), material)
}

fn ball(name: &str, center: [f32; 3], radius: f32, material: u32) -> Object {
    Object::new(name, Shape::Sphere(Sphere { center: center.into(), radius }), material)
}

fn metal(alpha: f32) -> Scattering {
    let (n, k) = (Spectrum::Constant(0.2), Spectrum::Constant(3.0));
    Scattering::Conductor(Conductor {
        n,
        k,
        alpha: Scalar::Constant(alpha),
        across: None,
        bounces: FacetBounces::Lost,
        tint: None,
    })
}

fn principled(change: impl FnOnce(&mut Principled)) -> Scattering {
    let mut p = Principled::new(Color::rgb(0.7, 0.6, 0.3), 1.5);
    change(&mut p);
    Scattering::Principled(Box::new(p))
}

/// A sky with a bright cloud, at which light samples aim, over the open ceiling.
fn sky() -> Environment {
    let mut map = Raster::new(16, 8, 3);
    for (k, pixel) in map.data.chunks_exact_mut(3).enumerate() {
        let (column, row) = (k % 16, k / 16);
        let cloud = (5..8).contains(&column) && (1..3).contains(&row);
        pixel.copy_from_slice(&if cloud { [3.0, 2.5, 2.0] } else { [0.1, 0.2, 0.3] });
    }
    Environment::new(map, Mat3::from_rotation_y(0.7), 1.0)
}

/// A room of everything that can lend or receive: diffuse, glossy, lacquered, broad and narrow metal, a mirror, glass that bends and disperses, frosted glass around a lamp, a pane, cloth that shines through, fog in a
/// ball, a faceted ball with smooth normals, a curtain that lets rays through by chance; a lamp, one above a shade that few places see, one that light does not meet, a bulb without extent, a narrow sun and
/// a sky.
fn description() -> Description {
    let interior = Interior::Body { medium: Some(Arc::new(Medium::fog(1.5, 0.8, 0.2))), priority: None };
    let cloth = Scattering::DiffuseTransmission(Box::new([Color::rgb(0.4, 0.4, 0.5), Color::rgb(0.3, 0.3, 0.2)]));
    let glass = principled(|p| {
        (p.base_color, p.roughness, p.transmission) = (Color::rgb(1.0, 1.0, 1.0), Scalar::Constant(0.0), Scalar::Constant(1.0));
        (p.kind, p.dispersion) = (Transmission::Solid, Some(Spectrum::Constant(1.5)));
    });
    let frosted = principled(|p| {
        (p.base_color, p.roughness, p.transmission) = (Color::rgb(1.0, 1.0, 1.0), Scalar::Constant(0.5), Scalar::Constant(1.0));
        p.kind = Transmission::Solid;
    });
    let pane = principled(|p| {
        (p.roughness, p.transmission, p.kind) = (Scalar::Constant(0.0), Scalar::Constant(1.0), Transmission::Thin);
    });
    let materials = vec![
        Material::new("wall", Scattering::Diffuse(Color::rgb(0.7, 0.6, 0.5))),
        Material::lamp("lamp", Spectrum::Constant(8.0)),
        Material::new("glossy", principled(|p| p.roughness = Scalar::Constant(0.5))),
        Material::new("lacquered", principled(|p| (p.roughness, p.clearcoat) = (Scalar::Constant(0.0), Scalar::Constant(1.0)))),
        Material::new("broad", metal(0.5)),
        Material::new("narrow", metal(0.1)),
        Material::new("mirror", metal(0.0)),
        Material { interior: Interior::Body { medium: None, priority: None }, ..Material::new("glass", glass) },
        Material::new("pane", pane),
        Material::new("cloth", cloth),
        Material { interior, ..Material::new("fog", Scattering::Interface) },
        Material::new("black", Scattering::Diffuse(Color::rgb(0.0, 0.0, 0.0))),
        Material {
            coverage: Coverage::Blend(Scalar::Constant(0.4)),
            ..Material::new("curtain", Scattering::Diffuse(Color::rgb(0.7, 0.4, 0.6)))
        },
        Material { interior: Interior::Body { medium: None, priority: None }, ..Material::new("frosted", frosted) },
        Material { scattering: Scattering::Interface, ..Material::lamp("glow", Spectrum::Constant(6.0)) },
    ];
    let mut faceted = Mesh::default();
    for k in 0..8u32 {
        let at = |i: u32| {
            Vec3::from([0, 1, 2].map(|axis: u32| if axis == i { if k >> i & 1 == 1 { 1.0 } else { -1.0 } } else { 0.0 }))
        };
        let first = faceted.positions.len() as u32;
        let corners = [0, 1, 2].map(at);
        faceted.positions.extend(corners);
        faceted.normals.extend(corners);
        let outwards = (corners[1] - corners[0]).cross(corners[2] - corners[0]).dot(corners[0] + corners[1] + corners[2]) > 0.0;
        faceted.triangles.push(if outwards { [first, first + 1, first + 2] } else { [first, first + 2, first + 1] });
    }
    let placed =
        Affine3A::from_scale_rotation_translation(Vec3::splat(0.3), glam::Quat::from_rotation_y(0.4), Vec3::new(-1.3, -0.7, 0.2));
    let objects = vec![
        quad("floor", [-2.0, -1.0, -2.0], [[0.0, 0.0, 4.0], [4.0, 0.0, 0.0]], 0),
        quad("back", [-2.0, -1.0, -2.0], [[4.0, 0.0, 0.0], [0.0, 3.0, 0.0]], 2),
        quad("left", [-2.0, -1.0, -2.0], [[0.0, 3.0, 0.0], [0.0, 0.0, 4.0]], 3),
        quad("right", [2.0, -1.0, -2.0], [[0.0, 0.0, 4.0], [0.0, 3.0, 0.0]], 4),
        quad("lamp", [-0.3, 1.2, -0.8], [[0.0, 0.0, -0.4], [0.6, 0.0, 0.0]], 1),
        ball("narrow", [1.2, -0.6, -0.9], 0.35, 5),
        quad("mirror", [-0.4, -0.2, -1.95], [[0.8, 0.0, 0.0], [0.0, 0.8, 0.0]], 6),
        ball("glass", [0.3, -0.6, -0.4], 0.35, 7),
        quad("pane", [-1.6, -0.9, -0.5], [[0.9, 0.0, 0.0], [0.0, 1.6, 0.0]], 8),
        quad("cloth", [0.9, 0.2, -1.2], [[0.7, 0.0, 0.2], [0.0, 0.7, 0.0]], 9),
        ball("fog", [-0.3, 0.6, -1.0], 0.4, 10),
        ball("black", [1.5, 0.0, 0.2], 0.2, 11),
        Object::new("faceted", Shape::Mesh { mesh: 0, world_from_mesh: placed }, 2),
        Object::new("curtain", Shape::Mesh { mesh: 1, world_from_mesh: Affine3A::IDENTITY }, 12),
        ball("shaded lamp", [-0.9, 1.4, -1.2], 0.15, 1),
        quad("shade", [-1.2, 1.2, -1.5], [[0.6, 0.0, 0.0], [0.0, 0.0, 0.6]], 0),
        ball("frosted", [-0.6, -0.7, 0.4], 0.3, 13),
        ball("lamp within", [-0.6, -0.7, 0.4], 0.1, 1),
        ball("glow", [1.3, 0.9, -0.6], 0.12, 14),
    ];
    let curtain = Mesh {
        positions: [[-0.9, -0.9, 0.3], [0.9, -0.9, -0.6], [0.9, 0.3, -0.6], [-0.9, 0.3, 0.3]].map(Vec3::from).to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    };
    let bulb = Punctual::new("bulb", Spectrum::Constant(3.0), PunctualKind::Point { position: Vec3::new(-1.2, 0.5, -1.2) });
    let sun = PunctualKind::Disc { direction: Vec3::new(-0.4, -0.6, -0.5).normalize(), half_angle: 0.03 };
    let punctual = vec![bulb, Punctual::new("sun", Spectrum::Constant(2.0), sun)];
    let environment = Some(sky());
    Description { meshes: vec![faceted.into(), curtain.into()], materials, objects, punctual, environment, ..Default::default() }
}

/// Camera paths of a group in a part of a cell of a grid of 6 × 5 over the view, from left to right.
fn group(cell: u32, sample: u32, rgb: bool) -> Vec<CameraPath<'static>> {
    let drawn = if rgb { WavelengthSampler::rgb() } else { WavelengthSampler::uniform() };
    let of_group = Sampler::new(SamplerKind::Independent, 9, (cell, 0), sample, 1 << 20);
    let wavelengths = drawn.sample(of_group.get(Dimensions::Time)[0]);
    let path = |member: u32| {
        let sampler = Sampler::new(SamplerKind::Independent, 3, (cell, member), sample, 1 << 20);
        let [a, b, ..] = sampler.get(Dimensions::Camera);
        let [x, y] = [(cell % 6) as f32 + 0.5 * (member as f32 + a) / GROUP as f32, (cell / 6) as f32 + 0.5 * b];
        let direction = Vec3::new(-0.8 + 0.27 * x, -0.5 + 0.2 * y, -1.0).normalize();
        CameraPath::new(Ray { origin: Vec3::new(0.1, 0.2, 1.9), direction, time_s: 0.0 }, wavelengths, sampler)
    };
    (0..GROUP).map(path).collect()
}

#[test]
fn lent_light_has_the_mean_of_paths_alone() {
    let with_fog = Scene::build(description()).unwrap();
    // Without media that scatter lights are sampled through glass and over mirrors, too.
    let mut clear = description();
    clear.objects.retain(|object| object.name != "fog");
    clear.materials[10] = Material::new("no fog", Scattering::Black);
    let clear = Scene::build(clear).unwrap();
    // Haze of a colour all around, but not below the ceiling; more pointed, everywhere.
    let in_air = |asymmetry: f32, bounds: Option<Bounds>| {
        let scattering = Coefficient::from_rgb(Vec3::new(0.3, 0.5, 0.9), 1.0);
        let medium = Medium { scattering, absorption: Coefficient::grey(0.1), asymmetry, ..Medium::fog(4.0, 0.8, 0.0) };
        Scene::build(Description { air: Some(Air { medium, bounds }), ..description() }).unwrap()
    };
    let low = Bounds { min: Vec3::new(-1.8, -1.5, -3.0), max: Vec3::new(2.2, 0.7, 2.5) };
    let (even_haze, haze, pointed) = (in_air(0.0, None), in_air(0.3, Some(low)), in_air(0.7, None));
    assert!([&with_fog, &clear, &haze].iter().all(|scene| scene.lets_paths_be_reused()));
    let photons_of = |scene| Caustics::new(scene, CausticSettings { lamps: Lamps::All, photons: 1 << 12, ..Default::default() });
    let caustics = [&with_fog, &even_haze].map(|scene| photons_of(scene).unwrap());
    let photons = caustics.each_ref().map(|caustics| caustics.map(0, 0));
    // Long paths, and short ones, in which each event that is counted wrongly shows.
    for (scene, photons, rgb, settings, samples) in [
        (&with_fog, None, false, PathSettings::default(), 800),
        (&with_fog, None, true, PathSettings { max_depth: 2, roulette_depth: 5 }, 800),
        (&with_fog, None, true, PathSettings { max_depth: 6, roulette_depth: 2 }, 400),
        (&clear, None, true, PathSettings { max_depth: 3, roulette_depth: 5 }, 800),
        (&clear, None, false, PathSettings::default(), 400),
        (&with_fog, Some(&photons[0]), true, PathSettings { max_depth: 4, roulette_depth: 5 }, 200),
        (&even_haze, None, false, PathSettings { max_depth: 3, roulette_depth: 5 }, 300),
        (&even_haze, Some(&photons[1]), true, PathSettings::default(), 100),
        (&haze, None, false, PathSettings { max_depth: 3, roulette_depth: 5 }, 300),
        (&pointed, None, false, PathSettings { max_depth: 4, roulette_depth: 3 }, 100),
    ] {
        let light_paths = LightPaths::of_photons(photons);
        let (mut all, mut differs) = ([0.0f64; 3], 0);
        let mut z2 = 0.0;
        for cell in 0..30 {
            // Sum and sum of squares of the difference of a group's means, and the light of either.
            let (mut sum, mut squares, mut light) = (0.0f64, 0.0f64, [0.0f64; 2]);
            for sample in 0..samples {
                // What is dim beside the light of the other group is lent within halves, which see different things.
                let groups = [0, samples].map(|first| {
                    let with = |path| CameraPath { light_paths, ..path };
                    group(cell, first + sample, rgb).into_iter().map(with).collect::<Vec<_>>()
                });
                let lent = scene.trace_groups([&groups[0], &groups[1]], Radiance, &settings);
                let alone = groups.iter().flat_map(|group| scene.trace(group, Radiance, &settings)).collect();
                let [lent, alone] = [lent, alone].map(|all: Vec<SampledSpectrum>| {
                    f64::from(all.iter().sum::<SampledSpectrum>().element_sum()) / f64::from(8 * GROUP)
                });
                differs += u32::from(lent != alone);
                (sum, squares) = (sum + lent - alone, squares + (lent - alone).powi(2));
                light = [light[0] + lent, light[1] + alone];
            }
            let n = f64::from(samples);
            // Where all light is lent in full, the difference is rounding.
            let error = ((squares / n - (sum / n).powi(2)).max(0.0) / (n - 1.0)).sqrt().hypot(1e-6 * light[1] / n);
            let z = if error > 0.0 { sum / n / error } else { 0.0 };
            // 30 cells: |z| above 4.5 in one of 5000 runs.
            assert!(z.abs() < 4.5, "depth {}, cell {cell}: {light:?}, z {z}", settings.max_depth);
            z2 += z * z;
            all = [all[0] + sum / n, all[1] + error * error, all[2] + light[1] / n];
        }
        let z = all[0] / all[1].sqrt();
        println!("depth {}: relative difference {:.5}, z {z:.2}, mean z² {:.2}", settings.max_depth, all[0] / all[2], z2 / 30.0);
        assert!(z.abs() < 4.0, "depth {}: {z}", settings.max_depth);
        assert!(differs > 1000, "{differs}");
    }
}

#[test]
fn light_that_came_through_a_curtain_is_not_lent() {
    // A curtain of gauze divides a room; half of the group looks at the floor on either side. What a path found through it is seen clearly by those beyond.
    let gauze = Scattering::Diffuse(Color::rgb(0.5, 0.5, 0.5));
    let materials = vec![
        Material::new("wall", Scattering::Diffuse(Color::rgb(0.8, 0.8, 0.8))),
        Material { coverage: Coverage::Blend(Scalar::Constant(0.5)), ..Material::new("gauze", gauze) },
    ];
    let curtain = Mesh {
        positions: [[0.0, 0.0, -2.0], [0.0, 0.0, 2.0], [0.0, 2.0, 2.0], [0.0, 2.0, -2.0]].map(Vec3::from).to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    };
    let objects = vec![
        quad("floor", [-2.0, 0.0, -2.0], [[0.0, 0.0, 4.0], [4.0, 0.0, 0.0]], 0),
        quad("ceiling", [-2.0, 2.0, -2.0], [[4.0, 0.0, 0.0], [0.0, 0.0, 4.0]], 0),
        Object::new("curtain", Shape::Mesh { mesh: 0, world_from_mesh: Affine3A::IDENTITY }, 1),
    ];
    // On one side alone, so that what lies there is worth lending.
    let bulb = Punctual::new("bulb", Spectrum::Constant(3.0), PunctualKind::Point { position: Vec3::new(0.6, 1.2, 0.0) });
    let scene = Scene::build(Description {
        meshes: vec![curtain.into()],
        materials,
        objects,
        punctual: vec![bulb],
        ..Default::default()
    });
    let scene = scene.unwrap();
    let settings = PathSettings { max_depth: 2, roulette_depth: 5 };
    let (mut sum, mut squares, mut light, samples) = (0.0f64, 0.0f64, 0.0f64, 4000);
    for sample in 0..samples {
        let mut paths = group(0, sample, true);
        for (member, path) in paths.iter_mut().enumerate() {
            let side = if member % 2 == 0 { -1.0 } else { 1.0 };
            let place = path.sampler.get(Dimensions::Camera);
            let origin = Vec3::new(side * (0.1 + 0.8 * place[0]), 1.0, place[1] - 0.5);
            path.cone.ray = Ray { origin, direction: Vec3::NEG_Y, time_s: 0.0 };
        }
        let [lent, alone] = [scene.trace_groups([&paths, &[]], Radiance, &settings), scene.trace(&paths, Radiance, &settings)]
            // One side alone: all of a group gets the same light, shared out.
            .map(|group| group.iter().step_by(2).map(|light| f64::from(light.x)).sum::<f64>() / f64::from(GROUP / 2));
        (sum, squares, light) = (sum + lent - alone, squares + (lent - alone).powi(2), light + alone);
    }
    let n = f64::from(samples);
    let error = ((squares / n - (sum / n).powi(2)) / (n - 1.0)).sqrt();
    println!("relative difference {:.5} ± {:.5}", sum / light, error * n / light);
    // Without the check what the side in the dark gives away is a seventh of its light.
    assert!(sum.abs() < 4.0 * error * n + 1e-4 * light && error * n < 0.003 * light, "{} ± {}", sum / light, error * n / light);
}

#[test]
fn an_even_room_stays_even() {
    // In a closed room of albedo ρ whose walls shine with L, radiance is L / (1 − ρ) everywhere.
    let wall = Material::new("wall", Scattering::Diffuse(Color::rgb(0.7, 0.7, 0.7)));
    let shining = Material { scattering: wall.scattering.clone(), ..Material::lamp("shining", Spectrum::Constant(1.0)) };
    let side = |k: usize| {
        let (a, b) = ((k + 1) % 3, (k + 2) % 3);
        let axis = |i: usize, sign: f32| Vec3::from([0, 1, 2].map(|j| if j == i { sign } else { 0.0 }));
        let low = quad("low", [0.0; 3], [axis(a, 1.0).into(), axis(b, 1.0).into()], 1);
        let high = quad("high", axis(k, 1.0).into(), [axis(b, 1.0).into(), axis(a, 1.0).into()], 1);
        [low, high]
    };
    let objects = (0..3).flat_map(side).collect();
    let scene = Scene::build(Description { materials: vec![wall, shining], objects, ..Default::default() }).unwrap();
    let settings = PathSettings { max_depth: 64, roulette_depth: 64 };
    let mut means = Vec::new();
    for cell in 0..400u32 {
        let mut paths = group(cell % 30, cell, false);
        paths.iter_mut().for_each(|path| path.cone.ray.origin = Vec3::new(0.5, 0.5, 0.8));
        let lent = scene.trace_groups([&paths, &[]], Radiance, &settings);
        means.push(lent.iter().map(|light| f64::from(light.x)).sum::<f64>() / f64::from(GROUP));
    }
    let n = means.len() as f64;
    let mean = means.iter().sum::<f64>() / n;
    let error = (means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt();
    println!("mean {mean} ± {error}");
    assert!((mean - 1.0 / 0.3).abs() < 4.0 * error && error < 0.02, "{mean} ± {error}");
}

#[test]
fn lent_light_is_far_less_noisy() {
    let scene = Scene::build(diopter_scene::builtin::named("cornell").unwrap()).unwrap();
    let settings = PathSettings::default();
    // The ceiling and a wall, lit from wall to wall.
    let (mut lent, mut alone) = (0.0, 0.0);
    for sample in 0..300 {
        let mut paths = group(8, sample, false);
        for path in &mut paths {
            let direction = Vec3::new(0.2, 0.25, 1.0) + 0.1 * path.cone.ray.direction;
            path.cone.ray = Ray { origin: Vec3::new(0.278, 0.273, -0.8), direction: direction.normalize(), time_s: 0.0 };
        }
        // At equal means, mean squares differ as variances do.
        let squares = |group: &[SampledSpectrum]| group.iter().map(|light| f64::from(light.element_sum()).powi(2)).sum::<f64>();
        lent += squares(&scene.trace_groups([&paths, &[]], Radiance, &settings));
        alone += squares(&scene.trace(&paths, Radiance, &settings));
    }
    println!("mean squares {lent} {alone}");
    assert!(lent < 0.7 * alone, "{lent} {alone}");
}

#[test]
fn what_is_seen_through_a_gap_is_lent() {
    // A closed room with a gap in its ceiling, below a sky with a cloud at which light samples aim; below an even one, which only scattered rays find; below lamps, a flat one and a ball.
    let wall = Material::new("wall", Scattering::Diffuse(Color::rgb(0.5, 0.5, 0.5)));
    let metal = Material::new("metal", metal(0.3));
    let upright =
        |name: &str, corner: [f32; 3], along: [f32; 3], material: u32| quad(name, corner, [along, [0.0, 3.0, 0.0]], material);
    let objects = [
        quad("floor", [-2.0, -1.0, -2.0], [[0.0, 0.0, 4.0], [4.0, 0.0, 0.0]], 0),
        upright("back", [-2.0, -1.0, -2.0], [4.0, 0.0, 0.0], 1),
        upright("front", [-2.0, -1.0, 2.0], [4.0, 0.0, 0.0], 0),
        upright("left", [-2.0, -1.0, -2.0], [0.0, 0.0, 4.0], 0),
        upright("right", [2.0, -1.0, -2.0], [0.0, 0.0, 4.0], 0),
        quad("ceiling", [-2.0, 2.0, -2.0], [[2.4, 0.0, 0.0], [0.0, 0.0, 4.0]], 0),
        quad("ceiling", [1.0, 2.0, -2.0], [[1.0, 0.0, 0.0], [0.0, 0.0, 4.0]], 0),
    ];
    let settings = PathSettings { max_depth: 1, roulette_depth: 5 };
    let flat = quad("lamp", [-1.0, 3.0, -1.0], [[2.0, 0.0, 0.0], [0.0, 0.0, 2.0]], 2);
    let skies = [sky(), Environment::uniform(Vec3::splat(0.3))].map(|sky| (Some(sky), None));
    for (environment, lamp) in
        skies.into_iter().chain([flat, ball("lamp", [0.0, 3.5, 0.0], 1.0, 2)].map(|lamp| (None, Some(lamp))))
    {
        let description = Description {
            materials: vec![wall.clone(), metal.clone(), Material::lamp("lamp", Spectrum::Constant(1.0))],
            objects: objects.iter().cloned().chain(lamp).collect(),
            environment,
            ..Default::default()
        };
        let scene = Scene::build(description).unwrap();
        let (mut sum, mut squares, mut expected, mut mean_squares, n) = (0.0f64, 0.0f64, 0.0f64, [0.0f64; 2], 2000);
        for sample in 0..n {
            let paths = group(sample % 30, sample, true);
            let both = [
                scene.trace_groups([&paths, &[]], RadianceAndDirect, &settings),
                scene.trace(&paths, RadianceAndDirect, &settings),
            ];
            // All of it is direct light.
            assert!(both.iter().flatten().all(|[all, direct]| all == direct));
            let both = both.map(|light| light.iter().map(|[all, _]| f64::from(all.x)).collect::<Vec<_>>());
            let [lent, alone] = both.each_ref().map(|light| light.iter().sum::<f64>());
            (sum, squares, expected) = (sum + lent - alone, squares + (lent - alone).powi(2), expected + alone);
            both.iter().zip(&mut mean_squares).for_each(|(light, sum)| *sum += light.iter().map(|l| l * l).sum::<f64>());
        }
        let n = f64::from(n);
        let error = ((squares / n - (sum / n).powi(2)) / (n - 1.0)).sqrt() * n;
        let (relative, of_it) = (sum / expected, error / expected);
        println!("relative difference {relative:.5} ± {of_it:.5}, mean squares {mean_squares:.3?}");
        // Where all light is lent in full, the difference is rounding.
        assert!(relative.abs() < 4.0 * of_it.hypot(1e-6) && of_it < 0.02, "{relative} ± {of_it}");
        // At equal means, mean squares differ as variances do; the rest is what pixels have of different light.
        assert!(mean_squares[0] < 0.5 * mean_squares[1], "{mean_squares:?}");
    }
}

#[test]
fn direct_light_is_that_of_paths_of_one_event_and_groups_that_may_not_lend_are_paths_alone() {
    let scene = Scene::build(Description { environment: None, ..description() }).unwrap();
    let settings = PathSettings::default();
    let drawn = WavelengthSampler::uniform();
    let mut differ = 0;
    for cell in 0..30 {
        let paths = group(cell, 7, false);
        let both = scene.trace_groups([&paths, &[]], RadianceAndDirect, &settings);
        let of_one_event = scene.trace_groups([&paths, &[]], Radiance, &PathSettings { max_depth: 1, ..settings });
        for ([all, direct], expected) in both.iter().zip(&of_one_event) {
            assert_eq!(direct, expected, "cell {cell}");
            assert!(direct.cmple(*all * (1.0 + 1e-6)).all(), "cell {cell}: {direct} {all}");
        }
        let all: Vec<SampledSpectrum> = both.iter().map(|[all, _]| *all).collect();
        assert_eq!(scene.trace_groups([&paths, &[]], Radiance, &settings), all, "cell {cell}");
        differ += u32::from(all != scene.trace(&paths, Radiance, &settings));
        let of_other_colors =
            paths.iter().enumerate().map(|(k, p)| CameraPath { wavelengths: drawn.sample(k as f32 / 16.0), ..*p });
        for paths in [of_other_colors.collect::<Vec<_>>(), paths[..1].to_vec(), Vec::new()] {
            assert_eq!(
                scene.trace_groups([&paths, &[]], Radiance, &settings),
                scene.trace(&paths, Radiance, &settings),
                "cell {cell}"
            );
        }
    }
    assert!(differ > 20, "{differ}");
}

#[test]
fn scenes_in_which_sight_or_light_is_uncertain_do_not_lend() {
    let changed = |change: &dyn Fn(&mut Description)| {
        let mut description = description();
        change(&mut description);
        Scene::build(description).unwrap().lets_paths_be_reused()
    };
    assert!(changed(&|_| ()));
    assert!(changed(&|d| d.materials[2].coverage = Coverage::Mask { alpha: Scalar::Constant(1.0), cutoff: 0.5 }));
    assert!(changed(&|d| d.materials[2].coverage = Coverage::Blend(Scalar::Constant(0.5))));
    let mut moving = Scene::build(diopter_scene::builtin::named("moving-bars").unwrap()).unwrap();
    moving.pose(0.0, 0.01);
    assert!(!moving.lets_paths_be_reused());
    assert!(!changed(
        &|d| d.punctual[0].modulation = diopter_scene::light::Modulation::Sine { frequency_hz: 100.0, depth: 0.5, phase: 0.0 }
    ));
}
