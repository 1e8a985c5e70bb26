//! What a sample costs, and where it goes: `cargo bench -p diopter-scene --bench transport`; half a minute, one thread.
//!
//! For each scene: rays through a pinhole (primary), rays that scatter by cosine where those end (diffuse), rays from there to the lamps (shadow),
//! in millions a second; whole paths of eight events; then the fraction of a path's time that each step takes when it is done alone, again and
//! again, as often as a path does it on average (what is left is bookkeeping, waiting for memory and textures). Without arguments a box of 36
//! triangles and a sphere of two million; arguments name embedded scenes instead. Medians of five.

use diopter_light::random::{Dimensions, Sampler, SamplerKind};
use diopter_light::wavelength::WavelengthSampler;
use diopter_light::{Ray, SampledWavelengths, sampling};
use diopter_scene::material::{Material, Scattering};
use diopter_scene::shape::{Mesh, Surface};
use diopter_scene::texture::Color;
use diopter_scene::{Description, Object, PathSettings, Scene, Shape, builtin};
use glam::{Affine3A, Vec3};
use std::hint::black_box;
use std::time::Instant;

/// Pixels a side of the picture whose rays are traced.
const SIDE: u32 = 384;
const DEPTH: u32 = 8;

/// Median of five runs, s.
fn seconds(mut run: impl FnMut()) -> f64 {
    let mut times: Vec<f64> = (0..5)
        .map(|_| {
            let start = Instant::now();
            run();
            start.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// The Cornell box's walls and lamp around a bumpy ball of two million triangles.
fn large() -> Description {
    let mut description = builtin::named("cornell").expect("embedded");
    let n = 1000u32;
    let at = |i: u32, j: u32| {
        let (theta, phi) = (std::f32::consts::PI * j as f32 / n as f32, std::f32::consts::TAU * i as f32 / n as f32);
        let r = 0.14 * (1.0 + 0.04 * (20.0 * phi).sin() * (16.0 * theta).sin());
        Vec3::new(0.27, 0.25, 0.25) + r * Vec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin())
    };
    let positions = (0..=n).flat_map(|j| (0..n).map(move |i| at(i, j))).collect();
    let number = |i: u32, j: u32| j * n + i % n;
    let triangles = (0..n)
        .flat_map(|j| {
            (0..n).flat_map(move |i| {
                [[number(i, j), number(i, j + 1), number(i + 1, j)], [number(i + 1, j), number(i, j + 1), number(i + 1, j + 1)]]
            })
        })
        .collect();
    description.meshes.push(Mesh { positions, triangles, ..Default::default() }.into());
    description.materials.push(Material::new("ball", Scattering::Diffuse(Color::rgb(0.6, 0.5, 0.4))));
    let shape = Shape::Mesh { mesh: description.meshes.len() as u32 - 1, world_from_mesh: Affine3A::IDENTITY };
    description.objects.push(Object::new("ball", shape, description.materials.len() as u32 - 1));
    description
}

fn main() {
    let names: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    if names.is_empty() {
        let view = [Vec3::new(0.278, 0.273, -0.8), Vec3::new(0.278, 0.273, 0.28)];
        measure("cornell", builtin::named("cornell").expect("embedded"), view);
        measure("ball of 2 M triangles", large(), view);
    }
    for name in &names {
        match builtin::named(name).zip(builtin::framing(name)) {
            Some((description, framing)) => measure(name, description, [framing.look_from, framing.look_at]),
            None => eprintln!(
                "\"{name}\": expected an embedded scene with a view of its own (still-life, night, resolution-chart ...)"
            ),
        }
    }
}

/// Scattering events of a path, on average: some paths are walked without lamps.
fn mean_events(
    scene: &Scene,
    primary: &[Ray],
    wavelengths: &SampledWavelengths,
    sampler_of: impl Fn(u32, u32) -> Sampler,
) -> f64 {
    let (mut events, mut walked) = (0u32, 0u32);
    for (i, ray) in primary.iter().enumerate().step_by(37) {
        let (mut ray, sampler, mut left) = (*ray, sampler_of(i as u32, 1), 1.0);
        walked += 1;
        for vertex in 0..DEPTH {
            let Some(s) = scene.intersect(&ray, f32::INFINITY) else { break };
            let Some(bsdf) = scene.material(s.object).bsdf(&s, -ray.direction, wavelengths, false, None) else { break };
            events += 1;
            let u = sampler.get(Dimensions::Scatter(vertex));
            let Some(scatter) = bsdf.sample(u) else { break };
            left *= scatter.weight.max_element();
            if vertex >= PathSettings::default().roulette_depth {
                if u[3] >= left {
                    break;
                }
                left = 1.0;
            }
            let n = if scatter.transmitted { -bsdf.side_normal() } else { bsdf.side_normal() };
            ray = Ray { origin: s.beside(n), direction: scatter.wi, ..ray };
        }
    }
    f64::from(events) / f64::from(walked.max(1))
}

fn measure(title: &str, description: Description, [look_from, look_at]: [Vec3; 2]) {
    let scene = Scene::build(description).expect("embedded scenes build");
    let sampler_of = |i: u32, sample: u32| Sampler::new(SamplerKind::Sobol, 1, (i % SIDE, i / SIDE), sample, 16);
    let forward = (look_at - look_from).normalize();
    let (right, up) = (forward.cross(Vec3::Y).normalize(), forward.cross(Vec3::Y).normalize().cross(forward));
    let primary: Vec<Ray> = (0..SIDE * SIDE)
        .map(|i| {
            let (x, y) = ((i % SIDE) as f32 / SIDE as f32 - 0.5, 0.5 - (i / SIDE) as f32 / SIDE as f32);
            Ray { origin: look_from, direction: (forward + 0.7 * (right * x + up * y)).normalize(), time_s: 0.0 }
        })
        .collect();
    let surfaces: Vec<(usize, Surface)> =
        primary.iter().enumerate().filter_map(|(i, ray)| Some((i, scene.intersect(ray, f32::INFINITY)?))).collect();
    let side = |s: &Surface, ray: &Ray| if s.ng.dot(ray.direction) > 0.0 { -s.ng } else { s.ng };
    let diffuse: Vec<Ray> = surfaces
        .iter()
        .map(|(i, s)| {
            let n = side(s, &primary[*i]);
            let [u, v, ..] = sampler_of(*i as u32, 0).get(Dimensions::Scatter(0));
            let (d, (x, y)) = (sampling::cosine_hemisphere([u, v]), sampling::frame(n));
            Ray { origin: s.beside(n), direction: x * d.x + y * d.y + n * d.z, time_s: 0.0 }
        })
        .collect();
    let shadow: Vec<(Ray, f32)> = surfaces
        .iter()
        .filter_map(|(i, s)| {
            let n = side(s, &primary[*i]);
            let [u, v, w, _] = sampler_of(*i as u32, 0).get(Dimensions::Light(0));
            let (light, _) = scene.lights().choose(s.point, n, w, false)?;
            let light_sample = scene.lights().sample_li(light, s.point, [u, v])?;
            Some((Ray { origin: s.beside(n), direction: light_sample.wi, time_s: 0.0 }, light_sample.distance * 0.999))
        })
        .collect();
    let closest = |rays: &[Ray]| {
        let time = seconds(|| {
            for ray in rays {
                black_box(scene.intersect(ray, f32::INFINITY));
            }
        });
        (time / rays.len() as f64, rays.len() as f64 / time * 1e-6)
    };
    let (primary_s, primary_rate) = closest(&primary);
    let (diffuse_s, diffuse_rate) = closest(&diffuse);
    let shadow_time = seconds(|| {
        for (ray, reach) in &shadow {
            black_box(scene.occluded(ray, *reach));
        }
    });
    let shadow_s = shadow_time / shadow.len().max(1) as f64;
    println!("{title}: {} triangles", scene.triangle_count());
    println!(
        "  Mrays/s: primary {primary_rate:.2}, diffuse {diffuse_rate:.2}, shadow {:.2}",
        shadow.len() as f64 / shadow_time * 1e-6
    );

    let wavelengths = WavelengthSampler::uniform();
    let settings = PathSettings { max_depth: DEPTH, ..Default::default() };
    let paths = |carried: &dyn Fn(f32) -> SampledWavelengths, settings: &PathSettings| {
        seconds(|| {
            for (i, ray) in primary.iter().enumerate() {
                let sampler = sampler_of(i as u32, 0);
                let [w, ..] = sampler.get(Dimensions::Time);
                black_box(scene.radiance(*ray, &carried(w), &sampler, settings));
            }
        }) / primary.len() as f64
    };
    let path_s = paths(&|w| wavelengths.sample(w), &settings);
    let rgb_s = paths(&|_| SampledWavelengths::rgb(), &settings);
    println!(
        "  paths of at most {DEPTH} events: {:.3} M/s of four wavelengths, {:.3} M/s of red, green and blue",
        1e-6 / path_s,
        1e-6 / rgb_s
    );

    // Scattering events of a path: by how much each more costs.
    let fractions = [0, 1, 2, 4].map(|max_depth| paths(&|w| wavelengths.sample(w), &PathSettings { max_depth, ..settings }));
    println!(
        "  us a path by most events: 0: {:.2}, 1: {:.2}, 2: {:.2}, 4: {:.2}, {DEPTH}: {:.2}",
        fractions[0] * 1e6,
        fractions[1] * 1e6,
        fractions[2] * 1e6,
        fractions[3] * 1e6,
        path_s * 1e6
    );
    let events = mean_events(&scene, &primary, &wavelengths.sample(0.3), sampler_of);
    let numbers_s = seconds(|| {
        for i in 0..SIDE * SIDE {
            black_box(sampler_of(i, 3).get(Dimensions::Light(i & 7)));
        }
    }) / f64::from(SIDE * SIDE);
    let shading_s = seconds(|| {
        let w = wavelengths.sample(0.3);
        for (i, s) in &surfaces {
            let wo = -primary[*i].direction;
            if let Some(bsdf) = scene.material(s.object).bsdf(s, wo, &w, false, None) {
                let u = sampler_of(*i as u32, 0).get(Dimensions::Scatter(0));
                black_box(bsdf.eval(bsdf.side_normal()));
                black_box(bsdf.sample(u));
            }
        }
    }) / surfaces.len().max(1) as f64;
    let lamps_s = seconds(|| {
        for (i, s) in &surfaces {
            let u = sampler_of(*i as u32, 0).get(Dimensions::Light(0));
            let aimed = scene.lights().choose(s.point, side(s, &primary[*i]), u[2], false);
            black_box(aimed.and_then(|(light, _)| scene.lights().sample_li(light, s.point, [u[0], u[1]])));
        }
    }) / surfaces.len().max(1) as f64;
    let percent = |each: f64, times: f64| 100.0 * each * times / path_s;
    println!(
        "  about {events:.1} events a path; of its time: rays {:.0} %, shadow rays {:.0} %, shading {:.0} %, lamps {:.0} %, numbers {:.0} %",
        percent(primary_s, 1.0) + percent(diffuse_s, events),
        percent(shadow_s, events),
        percent(shading_s - numbers_s, events),
        percent(lamps_s - numbers_s, events),
        percent(numbers_s, 2.0 * events + 2.0)
    );
}
