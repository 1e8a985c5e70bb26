use super::*;
use crate::bvh::{Bvh, Filter, Hit};
use crate::material::Material;
use crate::radiance::PathSettings;
use crate::scene::{Description, Object, Scene, Shape};
use crate::shape::Quad;
use diopter_light::color::SRGB_LUMINANCE;
use diopter_light::random::{Sampler, SamplerKind, mix, to_unit};
use diopter_light::{Ray, SampledSpectrum, SampledWavelengths, Spectrum};
use glam::{Affine3A, DMat3, DVec3};

fn random(seed: u32) -> Vec3 {
    Vec3::from_array(std::array::from_fn(|k| to_unit(mix(seed.wrapping_mul(3).wrapping_add(k as u32)))))
}

fn random_splat(seed: u32) -> Splat {
    let turn = random(seed + 1000) - 0.5;
    Splat {
        center: random(seed),
        rotation: Quat::from_xyzw(turn.x, turn.y, turn.z, 0.3),
        scale: (random(seed + 2000) * 3.0 - 4.0).map(f32::exp),
        opacity: 0.05 + 0.95 * to_unit(mix(seed + 3000)),
    }
}

/// A coefficient of degree 0 that shows a linear colour.
fn plain(linear: Vec3) -> Vec3 {
    let encoded = linear.map(|v| if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 });
    (encoded - 0.5) / 0.282_094_79
}

fn set(splats: &[(Splat, Vec3)]) -> Splats {
    let mut all = Splats::new(0);
    assert!(splats.iter().all(|(s, color)| all.push(s, &[plain(*color)])));
    all
}

/// Its white is 1 cd/m².
fn scene(splats: Splats, others: impl IntoIterator<Item = (Shape, Material)>) -> Scene {
    let mut d = Description { splats: vec![splats.into()], ..Default::default() };
    let cloud = Shape::Splats { splats: 0, world_from_splats: Affine3A::IDENTITY };
    for (shape, material) in [(cloud, Material::captured("captured", 1.0))].into_iter().chain(others) {
        d.objects.push(Object::new("", shape, d.materials.len() as u32));
        d.materials.push(material);
    }
    Scene::build(d).unwrap()
}

fn round(z: f32, sigma: f32, opacity: f32) -> Splat {
    Splat { center: Vec3::Z * z, rotation: Quat::IDENTITY, scale: Vec3::splat(sigma), opacity }
}

/// Rays that differ in nothing but where on their line they begin, and so in their random numbers.
fn along(start: Vec3, direction: Vec3, count: u32) -> impl Iterator<Item = Ray> {
    (0..count).map(move |i| Ray { origin: start - direction * (1.0 + to_unit(mix(i))), direction, time_s: 0.0 })
}

/// Mean linear sRGB (cd/m²) that rays see, and its standard error.
fn seen(scene: &Scene, rays: impl Iterator<Item = Ray>) -> (Vec3, Vec3) {
    let (wavelengths, settings) = (SampledWavelengths::rgb(), PathSettings::default());
    let white = Spectrum::light_from_rgb(Vec3::ONE).sample(&wavelengths).truncate();
    let (mut sum, mut squares, mut n) = (DVec3::ZERO, DVec3::ZERO, 0.0);
    for (i, ray) in rays.enumerate() {
        let sampler = Sampler::new(SamplerKind::Independent, i as u64, (0, 0), 0, 1);
        let light: SampledSpectrum = scene.radiance(ray, &wavelengths, &sampler, &settings);
        let rgb = (light.truncate() / white).as_dvec3();
        (sum, squares, n) = (sum + rgb, squares + rgb * rgb, n + 1.0);
    }
    let mean: DVec3 = sum / n;
    let error = ((squares / n - mean * mean).max(DVec3::ZERO) / n).map(f64::sqrt);
    (mean.as_vec3(), error.as_vec3())
}

/// Within three standard errors, and what 16 bits and the table of spectra round.
fn assert_seen((mean, error): (Vec3, Vec3), expected: Vec3, what: &str) {
    let allowed = 3.0 * error + 2e-3;
    assert!((mean - expected).abs().cmple(allowed).all(), "{what}: {mean} ± {error}, expected {expected}");
}

const COUNT: u32 = 20_000;

#[test]
fn a_ray_meets_a_gaussian_where_it_responds_most_with_the_closed_form_alpha() {
    let mut met = 0;
    for seed in 0..200 {
        let splat = random_splat(seed);
        let set = set(&[(splat, Vec3::ONE)]);
        let origin = random(seed + 50) * 8.0 - 4.0;
        let direction = splat.center + (random(seed + 70) - 0.5) * splat.scale.max_element() * 2.0 - origin;
        // In double precision by the inverse of the covariance, as the paper has it.
        let axes = DMat3::from_quat(splat.rotation.normalize().as_dquat());
        let variance = DMat3::from_diagonal((splat.scale * splat.scale).as_dvec3());
        let inverse = (axes * variance * axes.transpose()).inverse();
        let (o, d) = ((origin - splat.center).as_dvec3(), direction.as_dvec3());
        let t = -o.dot(inverse * d) / d.dot(inverse * d);
        let x = o + d * t;
        let alpha = (f64::from(splat.opacity) * (-0.5 * x.dot(inverse * x)).exp()).min(0.99);
        match set.intersect(0, origin, direction, f32::INFINITY) {
            Some(hit) => {
                met += 1;
                assert!((f64::from(hit.t) - t).abs() < 1e-4 * t.abs(), "{seed}: {} {t}", hit.t);
                assert!((f64::from(hit.alpha) - alpha).abs() < 1e-3, "{seed}: {} {alpha}", hit.alpha);
                assert!(set.intersect(0, origin, direction, hit.t * 0.999).is_none());
                // Where it is met lies in its box.
                let (p, b) = (origin + direction * hit.t, set.bounds());
                let slack = Vec3::splat(1e-5);
                assert!(p.cmpge(b.min - slack).all() && p.cmple(b.max + slack).all(), "{seed}: {p} {b:?}");
            }
            None => assert!(alpha < 1.01 / 255.0 || t <= 0.0, "{seed}: missed at {alpha}"),
        }
        assert!(set.intersect(0, origin, -direction, f32::INFINITY).is_none());
    }
    assert!(met > 120, "{met}");
}

#[test]
fn the_box_of_a_turned_gaussian_is_as_small_as_it_can_be() {
    let splat = Splat { rotation: Quat::from_rotation_z(0.5), scale: Vec3::new(2.0, 0.5, 0.1), ..round(0.0, 1.0, 0.8) };
    let half = set(&[(splat, Vec3::ONE)]).bounds().size() * 0.5;
    let r = (2.0 * (0.8f32 * 255.0).ln()).sqrt();
    let (s, c) = 0.5f32.sin_cos();
    let expected = Vec3::new((2.0 * c).hypot(0.5 * s), (2.0 * s).hypot(0.5 * c), 0.1) * r;
    assert!((half / expected - 1.0).abs().max_element() < 1e-4, "{half} {expected}");
}

#[test]
fn the_profile_of_one_gaussian_is_the_closed_form() {
    let scene = scene(set(&[(round(0.0, 0.5, 0.9), Vec3::ONE)]), []);
    for x in [0.0f32, 0.3, 0.6, 1.0, 1.5] {
        let expected = 0.9 * (-0.5 * (x / 0.5).powi(2)).exp();
        assert_seen(seen(&scene, along(Vec3::new(x, 0.0, -4.0), Vec3::Z, COUNT)), Vec3::splat(expected), &format!("at {x}"));
    }
    // Beyond 1/255 there is nothing.
    assert_eq!(seen(&scene, along(Vec3::new(1.7, 0.0, -4.0), Vec3::Z, 1000)).0, Vec3::ZERO);
    // α is at most 0.99.
    let dense = self::scene(set(&[(round(0.0, 0.5, 1.0), Vec3::ONE)]), []);
    let mean = seen(&dense, along(Vec3::NEG_Z * 4.0, Vec3::Z, COUNT)).0.x;
    assert!((mean - 0.99).abs() < 0.0025, "{mean}");
}

#[test]
fn two_gaussians_composite_from_front_to_back_in_any_order_of_the_set() {
    let (red, green) = (Vec3::new(0.8, 0.1, 0.2), Vec3::new(0.2, 0.6, 0.1));
    let both = [(round(1.0, 0.5, 0.6), red), (round(2.0, 0.5, 0.7), green)];
    for splats in [both, [both[1], both[0]]] {
        let scene = scene(set(&splats), []);
        let front = red * 0.6 + green * (0.4 * 0.7);
        assert_seen(seen(&scene, along(Vec3::NEG_Z, Vec3::Z, COUNT)), front, "from the front");
        let back = green * 0.7 + red * (0.3 * 0.6);
        assert_seen(seen(&scene, along(Vec3::Z * 5.0, Vec3::NEG_Z, COUNT)), back, "from behind");
        // A shadow ray is stopped by either.
        let stopped = |to: f32| {
            let rays = along(Vec3::NEG_Z, Vec3::Z, COUNT);
            rays.filter(|r| scene.occluded(r, to - r.origin.z)).count() as f32 / COUNT as f32
        };
        // Three standard errors of a fraction.
        let error = 3.0 * (0.25 / COUNT as f32).sqrt();
        assert!((stopped(9.0) - (1.0 - 0.4 * 0.3)).abs() < error && (stopped(1.5) - 0.6).abs() < error && stopped(0.9) == 0.0);
    }
}

#[test]
fn gaussians_hide_meshes_and_are_hidden_by_them() {
    let color = Vec3::new(0.3, 0.5, 0.2);
    let lamp = |z: f32| {
        let corner = Vec3::new(-1.0, 1.0, z);
        let quad = Quad { corner, edges: [Vec3::X * 2.0, Vec3::NEG_Y * 2.0] };
        (Shape::Quad(quad), Material::lamp("lamp", Spectrum::light_from_rgb(Vec3::ONE)))
    };
    for (z, expected) in [(2.0, color * 0.6 + 0.4), (0.5, Vec3::ONE)] {
        let scene = scene(set(&[(round(1.0, 0.1, 0.6), color)]), [lamp(z)]);
        assert_seen(seen(&scene, along(Vec3::NEG_Z, Vec3::Z, COUNT)), expected, &format!("lamp at {z}"));
    }
}

#[test]
fn a_placed_cloud_turns_with_its_colours() {
    // Bright to who looks along its +x, dark along −x: the third coefficient of degree 1 counts −x.
    let mut splats = Splats::new(1);
    let harmonics = [Vec3::ZERO, Vec3::ZERO, Vec3::ZERO, Vec3::splat(-0.6)];
    splats.push(&round(0.0, 0.2, 0.9), &harmonics);
    let along_x = splats.color(0, Vec3::X);
    let expected = srgb_decode(0.5 + 0.6 * 0.488_602_5);
    assert!((along_x - expected).abs().max_element() < 1e-3, "{along_x} {expected}");
    assert!(splats.color(0, Vec3::NEG_X).x < 0.1 * expected);
    let mut d = Description { splats: vec![splats.into()], materials: vec![Material::captured("", 1.0)], ..Default::default() };
    // Twice as large and turned so that its x is the world's z.
    let place = Affine3A::from_rotation_y(-std::f32::consts::FRAC_PI_2) * Affine3A::from_scale(Vec3::splat(2.0));
    d.objects.push(Object::new("", Shape::Splats { splats: 0, world_from_splats: place }, 0));
    let scene = Scene::build(d).unwrap();
    let alpha = 0.9 * (-0.5f32).exp();
    let rays = || along(Vec3::new(0.4, 0.0, -3.0), Vec3::Z, COUNT);
    assert_seen(seen(&scene, rays()), Vec3::splat(alpha * expected), "turned");
    let surface = rays().find_map(|r| Some((r, scene.intersect(&r, f32::INFINITY)?))).unwrap();
    assert!((surface.1.point.z).abs() < 1e-4 && surface.1.ng.dot(surface.0.direction) < 0.0);
}

struct All<'a>(&'a Splats, Vec3, Vec3);

impl All<'_> {
    fn there(&self, id: u32, t_max: f32) -> Option<Hit> {
        let hit = self.0.intersect(id, self.1, self.2, t_max)?;
        let is_there = to_unit(mix(id ^ 0x55_1234)) < hit.alpha;
        is_there.then_some(Hit { t: hit.t, u: 0.0, v: 0.0, id, slot: 0, instance: 0 })
    }
}

impl Filter for All<'_> {
    fn accept(&self, _: u32, _: f32, _: f32) -> bool {
        true
    }
    fn intersect_other(&self, id: u32, t_max: f32, _: bool) -> Option<Hit> {
        self.there(id, t_max)
    }
}

#[test]
fn the_hierarchy_finds_what_all_gaussians_one_by_one_have_nearest() {
    let splats: Vec<(Splat, Vec3)> = (0..800).map(|i| (random_splat(i * 7), Vec3::ONE)).collect();
    let set = set(&splats);
    let bvh = Bvh::build(&SplatBoxes(&set));
    let mut found = 0;
    for i in 0..300 {
        let origin = random(i ^ 0x5555) * 6.0 - 2.0;
        let all = All(&set, origin, random(i ^ 0x333) - origin);
        let one = (0..set.len() as u32).filter_map(|id| all.there(id, f32::INFINITY)).min_by(|a, b| a.t.total_cmp(&b.t));
        let fast = bvh.closest(all.1, all.2, f32::INFINITY, &all);
        assert_eq!(fast.map(|h| (h.id, h.t)), one.map(|h| (h.id, h.t)), "{i}");
        assert_eq!(bvh.any(all.1, all.2, f32::INFINITY, &all), one.is_some());
        found += u32::from(one.is_some());
    }
    assert!(found > 200, "{found}");
}

#[test]
fn harmonics_are_orthonormal_and_signed_as_captures_have_them() {
    // Sums over a Fibonacci lattice of the sphere integrate polynomials of degree 6 to some parts in ten thousand.
    let n = 20_000;
    let mut products = [[0.0f64; 16]; 16];
    for k in 0..n {
        let z = 1.0 - (2.0 * k as f64 + 1.0) / n as f64;
        let angle = k as f64 * std::f64::consts::PI * (3.0 - 5f64.sqrt());
        let r = (1.0 - z * z).sqrt();
        let y = basis(DVec3::new(r * angle.cos(), r * angle.sin(), z).as_vec3());
        for (row, a) in products.iter_mut().zip(y) {
            row.iter_mut().zip(y).for_each(|(p, b)| *p += f64::from(a * b) * 4.0 * std::f64::consts::PI / f64::from(n));
        }
    }
    for (i, row) in products.iter().enumerate() {
        for (j, value) in row.iter().enumerate() {
            assert!((value - f64::from(u8::from(i == j))).abs() < 2e-3, "{i} {j}: {value}");
        }
    }
    let d = Vec3::new(0.6, 0.48, 0.64);
    let y = basis(d);
    // Signs of m = −l to l: those of the polynomials y, z, x; xy, yz, 2z²−x²−y², xz, x²−y²; ... times (−1)^m.
    let signs = [1, -1, 1, -1, 1, -1, 1, -1, 1, -1, 1, -1, -1, -1, 1, 1];
    assert!(y.iter().zip(signs).all(|(v, s)| v.signum() == s as f32), "{y:?}");
}

#[test]
fn numbers_of_16_bits_are_the_nearest() {
    for (v, bits) in
        [(1.0, 0x3c00), (-2.0, 0xc000), (0.0, 0), (65504.0, 0x7bff), (1e9, 0x7bff), (6e-8, 1), (0.333_251_95, 0x3555)]
    {
        assert_eq!(half(v), bits, "{v}");
    }
    for i in 0..1000 {
        let v = (to_unit(mix(i)) - 0.5) * 8.0;
        assert!((from_half(half(v)) - v).abs() <= v.abs() / 2048.0 + 3e-8, "{v}");
    }
}

#[test]
fn strays_do_not_frame_a_picture() {
    let mut all = Splats::new(0);
    for i in 0..1000 {
        let center = if i % 50 == 0 { (random(i) - 0.5) * 1e4 } else { random(i) };
        all.push(&Splat { center, ..round(0.0, 0.01, 0.5) }, &[Vec3::ZERO]);
    }
    let (core, whole) = (all.core_bounds(), all.bounds());
    assert!(core.min.cmpge(Vec3::ZERO).all() && core.max.cmple(Vec3::ONE).all() && core.size().min_element() > 0.8, "{core:?}");
    assert!(whole.size().min_element() > 1000.0);
    let d = scene(all, []).description().clone();
    assert!(d.bounds_at(0.0, |_| true).size().max_element() < 1.1);
    let support = d.support_points(0.0, &[Vec3::X, Vec3::NEG_Y], |_| true);
    assert!((support[0].x - core.max.x).abs() < 1e-3 && (support[1].y - core.min.y).abs() < 1e-3);
}

#[test]
fn ordered_in_space_they_are_the_same_and_neighbours_lie_together() {
    let mut all = Splats::new(1);
    for i in 0..2000 {
        all.push(&random_splat(i * 11), &[0, 1, 2, 3].map(|k| random(i * 5 + k)));
    }
    let of = |s: &Splats| -> Vec<(Vec3, Vec3, f32)> {
        (0..s.len()).map(|i| (s.ellipsoids[i].center, s.color(i as u32, Vec3::X), s.ellipsoids[i].opacity)).collect()
    };
    let steps = |s: &Splats| s.ellipsoids.windows(2).map(|w| (w[0].center - w[1].center).length()).sum::<f32>();
    let (mut before, far) = (of(&all), steps(&all));
    all.order_in_space();
    let mut after = of(&all);
    let key = |a: &(Vec3, Vec3, f32), b: &(Vec3, Vec3, f32)| a.0.x.total_cmp(&b.0.x).then(a.0.y.total_cmp(&b.0.y));
    before.sort_by(key);
    after.sort_by(key);
    assert_eq!(before, after);
    assert!(steps(&all) < 0.3 * far, "{} {far}", steps(&all));
    Splats::new(0).order_in_space();
}

#[test]
fn gaussians_that_cannot_be_met_are_refused() {
    let good = round(1.0, 0.1, 0.5);
    let mut all = Splats::new(0);
    for bad in [
        Splat { center: Vec3::NAN, ..good },
        Splat { center: Vec3::new(0.0, f32::NAN, 0.0), ..good },
        Splat { rotation: Quat::from_array([0.0; 4]), ..good },
        Splat { scale: Vec3::ZERO, ..good },
        Splat { scale: Vec3::new(1.0, f32::INFINITY, 1.0), ..good },
        Splat { opacity: 1.0 / 256.0, ..good },
        Splat { opacity: f32::NAN, ..good },
    ] {
        assert!(!all.push(&bad, &[Vec3::ZERO]), "{bad:?}");
    }
    assert!(!all.push(&good, &[Vec3::NAN]) && all.is_empty());
    // A disc without thickness is one.
    assert!(all.push(&Splat { scale: Vec3::new(0.1, 0.1, 0.0), ..good }, &[Vec3::ZERO]));
    let hit = all.intersect(0, Vec3::new(0.05, 0.0, 0.0), Vec3::Z, 9.0).unwrap();
    assert!((hit.t - 1.0).abs() < 1e-5 && (hit.alpha - 0.5 * (-0.125f32).exp()).abs() < 1e-4, "{hit:?}");
}

#[test]
fn captured_places_light_what_is_around_them() {
    // A black floor in between shows nothing; a grey one shows light that paths find by chance.
    let floor = Quad { corner: Vec3::new(-1.0, 0.0, 1.0), edges: [Vec3::X * 2.0, Vec3::NEG_Z * 2.0] };
    let grey = crate::material::Scattering::Diffuse(crate::texture::Color::rgb(0.5, 0.5, 0.5));
    // So wide that it stands for a half space of luminance 0.99 above the floor.
    let cloud = Splat { center: Vec3::Y, rotation: Quat::IDENTITY, scale: Vec3::new(1e4, 1e-3, 1e4), opacity: 1.0 };
    let scene = scene(set(&[(cloud, Vec3::ONE)]), [(Shape::Quad(floor), Material::new("floor", grey))]);
    let rays =
        (0..4000).map(|i| Ray { origin: Vec3::new(0.2, 0.4 + 0.2 * to_unit(mix(i)), 0.0), direction: Vec3::NEG_Y, time_s: 0.0 });
    let (mean, error) = seen(&scene, rays);
    let light = mean.dot(SRGB_LUMINANCE);
    assert!((light - 0.5 * 0.99).abs() < 3.0 * error.x + 2e-3, "{light} ± {}", error.x);
}
