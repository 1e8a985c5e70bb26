//! Polarised light transport against answers that are known in closed form (Fresnel, Malus, Rayleigh), along whole paths.

use diopter_light::polarization::{Stokes, degree_of_linear_polarization};
use diopter_light::random::{Sampler, SamplerKind};
use diopter_light::{Ray, SampledWavelengths, Spectrum};
use diopter_scene::daylight::{Daylight, sun};
use diopter_scene::light::{Environment, Punctual, PunctualKind};
use diopter_scene::material::conductor::FacetBounces;
use diopter_scene::material::{Conductor, Material, Principled, Scattering, Transmission};
use diopter_scene::radiance::CameraPath;
use diopter_scene::radiance::record::StokesVectors;
use diopter_scene::shape::{Quad, Sphere};
use diopter_scene::texture::{Color, Scalar};
use diopter_scene::{Description, Object, PathSettings, Scene, Shape};
use glam::{Vec3, Vec4};

const NM: [f32; 4] = [450.0, 520.0, 590.0, 660.0];

/// Mean Stokes vector over `n` samples along a ray at 520 nm, relative to what an RGB light of 1 has; x along `axis`.
fn mean(scene: &Scene, origin: Vec3, direction: Vec3, axis: Vec3, n: u32) -> Stokes {
    let wavelengths = SampledWavelengths::fixed(NM);
    let white = wavelengths.d65_one_nit();
    let ray = Ray { origin, direction: direction.normalize(), time_s: 0.0 };
    let sum: Vec4 = (0..n)
        .map(|i| {
            let sampler = Sampler::new(SamplerKind::Sobol, 5, (3, 4), i, n);
            scene.trace(&[CameraPath::new(ray, wavelengths, sampler)], StokesVectors { axes: &[axis] }, &PathSettings::default())
                [0][1]
                / white[1]
        })
        .sum();
    sum / n as f32
}

fn black(ior: f32, roughness: f32) -> Material {
    let mut principled = Principled::new(Color::rgb(0.0, 0.0, 0.0), ior);
    principled.roughness = Scalar::Constant(roughness);
    Material::new("black plastic", Scattering::Principled(Box::new(principled)))
}

/// A square of half a side 4 m, seen from the side of its normal.
fn plate(middle: Vec3, normal: Vec3, material: u32) -> Object {
    let x = normal.any_orthonormal_vector();
    let y = normal.cross(x);
    let quad = Quad { corner: middle - (x + y) * 4.0, edges: [x * 8.0, y * 8.0] };
    Object::new("plate", Shape::Quad(quad), material)
}

/// Reflectances (s, p) of a dielectric at a cosine, by the equations of Fresnel in sines and tangents (Born & Wolf 1.5.2 eq. 21a).
fn fresnel(cos: f32, n: f32) -> [f32; 2] {
    let (i, t) = (cos.acos(), (cos.acos().sin() / n).asin());
    [((i - t).sin() / (i + t).sin()).powi(2), ((i - t).tan() / (i + t).tan()).powi(2)]
}

fn uniform(materials: Vec<Material>, objects: Vec<Object>) -> Scene {
    let environment = Some(Environment::uniform(Vec3::ONE));
    Scene::build(Description { materials, objects, environment, ..Default::default() }).unwrap()
}

#[test]
fn glare_of_water_at_53_degrees_is_polarised_across() {
    let water = 1.333f32;
    let scene = uniform(vec![black(water, 0.0)], vec![plate(Vec3::ZERO, Vec3::Y, 0)]);
    for (degrees, least) in [(53.12f32, 0.9999), (30.0, 0.0), (75.0, 0.0)] {
        let angle = degrees.to_radians();
        let direction = Vec3::new(0.0, -angle.cos(), -angle.sin());
        let stokes = mean(&scene, -direction, direction, Vec3::X, 64);
        let [s, p] = fresnel(angle.cos(), water);
        let expected = Vec4::new(0.5 * (s + p), 0.5 * (s - p), 0.0, 0.0);
        assert!((stokes - expected).abs().max_element() < 2e-5, "{degrees}: {stokes} {expected}");
        // The field is horizontal: what a polariser with an upright axis passes, (I − Q) / 2, is nothing at Brewster's angle.
        assert!(degree_of_linear_polarization(stokes) > least && stokes.y > 0.0);
        if least > 0.0 {
            assert!(0.5 * (stokes.x - stokes.y) < 1e-5 * stokes.x);
        }
        // Seen along a turned axis the same light is told otherwise.
        let turned = mean(&scene, -direction, direction, Vec3::X + direction.cross(Vec3::X), 64);
        assert!((turned.y).abs() < 1e-5 && (turned.z.abs() - expected.y).abs() < 2e-5, "{turned}");
    }
}

#[test]
fn two_plates_at_brewsters_angle_are_polariser_and_analyser() {
    let n = 1.5f32;
    let angle = n.atan();
    let [s, p] = fresnel(angle.cos(), n);
    assert!(p < 1e-9);
    for degrees in [0.0f32, 30.0, 45.0, 60.0, 90.0] {
        // Down onto the first, on along `out`, onto the second in a plane of incidence that is turned about `out`.
        let incoming = Vec3::new(0.0, -angle.cos(), -angle.sin());
        let out = incoming - 2.0 * incoming.dot(Vec3::Y) * Vec3::Y;
        let (s1, turn) = (Vec3::X, degrees.to_radians());
        let s2 = s1 * turn.cos() + out.cross(s1) * turn.sin();
        let normal = (-out * angle.cos() + s2.cross(out) * angle.sin()).normalize();
        let objects = vec![plate(Vec3::ZERO, Vec3::Y, 0), plate(out * 20.0, normal, 0)];
        let scene = uniform(vec![black(n, 0.0)], objects);
        let stokes = mean(&scene, -incoming, incoming, s1, 64);
        // ½ Rs² cos² where unpolarised light would give ¼ Rs².
        let expected = 0.5 * s * s * turn.cos().powi(2);
        assert!((stokes.x - expected).abs() < 1e-5 && (stokes.y - expected).abs() < 1e-5, "{degrees}: {stokes} {expected}");
        let plain = {
            let wavelengths = SampledWavelengths::fixed(NM);
            let sampler = Sampler::new(SamplerKind::Sobol, 5, (3, 4), 0, 1);
            let ray = Ray { origin: -incoming, direction: incoming, time_s: 0.0 };
            (scene.radiance(ray, &wavelengths, &sampler, &PathSettings::default()) / wavelengths.d65_one_nit()).y
        };
        assert!((plain - 0.25 * s * s).abs() < 1e-5, "{plain}");
    }
}

#[test]
fn lamps_seen_over_facets_and_through_panes_keep_their_order() {
    // Parallel light through a tilted pane onto rough black plastic, so that only facets that lie level send it on: at Brewster's angle, in a plane turned
    // against that of the pane.
    let n = 1.5f32;
    let angle = n.atan();
    let view = Vec3::new(0.0, -angle.cos(), -angle.sin());
    let wi = Vec3::new(0.0, angle.cos(), -angle.sin());
    let sun = || Punctual::new("sun", Spectrum::light_from_rgb(Vec3::ONE), PunctualKind::Directional { direction: -wi });
    let glass = |pane: bool| {
        let mut principled = Principled::new(Color::rgb(1.0, 1.0, 1.0), n);
        (principled.roughness, principled.transmission) = (Scalar::Constant(0.0), Scalar::Constant(1.0));
        (principled.kind, principled.thin_dielectric) = (Transmission::Thin, pane);
        Material::new("pane", Scattering::Principled(Box::new(principled)))
    };
    let lit = |pane: Option<(bool, Vec3)>| {
        let mut objects = vec![plate(Vec3::ZERO, Vec3::Y, 0)];
        let mut materials = vec![black(n, 0.4)];
        if let Some((both, normal)) = pane {
            materials.push(glass(both));
            objects.push(plate(wi * 20.0, normal, 1));
        }
        let d = Description { materials, objects, punctual: vec![sun()], ..Default::default() };
        mean(&Scene::build(d).unwrap(), -view, view, Vec3::X, 256)
    };
    let bare = lit(None);
    assert!(bare.x > 0.0 && degree_of_linear_polarization(bare) > 0.999, "{bare}");
    for both in [false, true] {
        for degrees in [0.0f32, 35.0, 90.0] {
            let (turn, tilt) = (degrees.to_radians(), 1.1f32);
            // s of the pane, turned about the light from that of the plate.
            let s = Vec3::X * turn.cos() + wi.cross(Vec3::X) * turn.sin();
            let normal = (wi * tilt.cos() + s.cross(wi) * tilt.sin()).normalize();
            let stokes = lit(Some((both, normal)));
            let [rs, rp] = fresnel(tilt.cos(), n);
            let through = |r: f32| if both { (1.0 - r) / (1.0 + r) } else { 1.0 - r };
            // The plate passes on its s alone: twice the half that unpolarised light has there.
            let expected = bare.x * (through(rs) * turn.cos().powi(2) + through(rp) * turn.sin().powi(2));
            assert!((stokes.x / expected - 1.0).abs() < 1e-3, "{both} {degrees}: {stokes} {expected}");
        }
    }
}

#[test]
fn the_sky_is_polarised_by_four_fifths_at_right_angles_to_the_sun() {
    let place = sun::Place { elevation: 20f64.to_radians(), azimuth: 2.0, distance_au: 1.0 };
    let day = Daylight::new(place);
    let towards = day.direction();
    let mut d = Description::default();
    day.add_to_scene(&mut d);
    let scene = Scene::build(d).unwrap();
    for (degrees, expected) in [(90.0f32, 0.8f32), (60.0, 0.8 * 0.75 / 1.25), (30.0, 0.8 * 0.25 / 1.75)] {
        let angle = degrees.to_radians();
        let up = (Vec3::Y - towards * towards.y).normalize();
        let direction = towards * angle.cos() + up * angle.sin();
        let across = towards.cross(direction).normalize();
        let stokes = mean(&scene, Vec3::ZERO, direction, across, 4);
        assert!((stokes.y / stokes.x - expected).abs() < 1e-4 && stokes.z.abs() < 1e-4 * stokes.x, "{degrees}: {stokes}");
        // A polariser turned against it leaves (1 − P) / (1 + P) of what one turned with it does.
        assert!(((stokes.x - stokes.y) / (stokes.x + stokes.y) - (1.0 - expected) / (1.0 + expected)).abs() < 1e-4);
    }
    // Seen in an axis turned by 25° about the light, and so through a mirror at a slant: the angle has its sign.
    let turned = |stokes: Vec4, axis: Vec3, truth: Vec3, k: Vec3| {
        let angle = k.cross(axis).dot(truth).atan2(axis.dot(truth));
        let length = stokes.y.hypot(stokes.z);
        assert!((stokes.y - length * (2.0 * angle).cos()).abs() < 1e-3 * length, "{stokes} {angle}");
        assert!((stokes.z - length * (2.0 * angle).sin()).abs() < 1e-3 * length, "{stokes} {angle}");
    };
    let direction = Vec3::new(0.5, 0.7, 0.2).normalize();
    let across = towards.cross(direction).normalize();
    let (sin, cos) = 25f32.to_radians().sin_cos();
    let axis = across * cos + (-direction).cross(across) * sin;
    turned(mean(&scene, Vec3::ZERO, direction, axis, 4), axis, across, -direction);
    // The ground is not.
    let stokes = mean(&scene, Vec3::ZERO, Vec3::new(0.3, -0.5, 0.1), Vec3::Y, 4);
    assert!(stokes.x > 0.0 && stokes.y == 0.0 && stokes.z == 0.0);
    // Reflected by water near Brewster's angle, light that is polarised upright vanishes: overhead sky at 90° from a low sun, seen in level water.
    let low = Daylight::new(sun::Place { elevation: 0.02, azimuth: 0.0, distance_au: 1.0 });
    let water = 1.333f32;
    let mut d =
        Description { materials: vec![black(water, 0.0)], objects: vec![plate(Vec3::ZERO, Vec3::Y, 0)], ..Default::default() };
    low.add_to_scene(&mut d);
    let scene = Scene::build(d).unwrap();
    // The sun is in the north (−z); one looks east or west, where the sky is polarised upright at every height … and north, where it is polarised level.
    let angle = water.atan();
    let seen = |heading: Vec3| {
        let direction = heading * angle.sin() - Vec3::Y * angle.cos();
        mean(&scene, -direction, direction, heading.cross(Vec3::Y), 4)
    };
    let bare = |heading: Vec3| {
        let direction = heading * angle.sin() + Vec3::Y * angle.cos();
        mean(&scene, Vec3::Y, direction, heading.cross(Vec3::Y), 4)
    };
    let [s, _] = fresnel(angle.cos(), water);
    for heading in [Vec3::X, Vec3::NEG_X, Vec3::NEG_Z, Vec3::new(1.0, 0.0, -1.0).normalize()] {
        let (stokes, sky) = (seen(heading), bare(heading));
        // Only s comes back: Rs (I + Q) / 2 of the sky's.
        let expected = 0.5 * s * (sky.x + sky.y);
        assert!((stokes.x / expected - 1.0).abs() < 2e-3, "{heading}: {stokes} {sky}");
        if heading.z == 0.0 {
            assert!(sky.y < -0.7 * sky.x, "upright: {sky}");
        }
    }
}

#[test]
fn one_event_changes_no_intensity() {
    // Opaque materials whose light comes from an even sky: sample by sample the same numbers as without polarisation.
    let rough = |r: f32| {
        let mut principled = Principled::new(Color::rgb(0.7, 0.3, 0.2), 1.5);
        principled.roughness = Scalar::Constant(r);
        Material::new("plastic", Scattering::Principled(Box::new(principled)))
    };
    let metal = |alpha: f32| Material::new("gold", Scattering::Conductor(Conductor::metal("gold", alpha).unwrap()));
    for material in
        [rough(0.0), rough(0.5), metal(0.0), metal(0.2), Material::new("d", Scattering::Diffuse(Color::rgb(0.5, 0.5, 0.5)))]
    {
        let sphere = Object::new("ball", Shape::Sphere(Sphere { center: Vec3::ZERO, radius: 1.0 }), 0);
        let scene = uniform(vec![material], vec![sphere]);
        let wavelengths = SampledWavelengths::fixed(NM);
        for i in 0..64 {
            let sampler = Sampler::new(SamplerKind::Sobol, 5, (3, 4), i, 64);
            let ray = Ray { origin: Vec3::new(0.6, 0.4, 5.0), direction: Vec3::NEG_Z, time_s: 0.0 };
            let plain = scene.radiance(ray, &wavelengths, &sampler, &PathSettings::default());
            let stokes = scene.trace(
                &[CameraPath::new(ray, wavelengths, sampler)],
                StokesVectors { axes: &[Vec3::X] },
                &PathSettings::default(),
            )[0];
            let intensity = Vec4::from_array(stokes.map(|s| s.x));
            assert!((intensity - plain).abs().max_element() < 2e-5 * plain.max_element().max(1e-9), "{i}: {intensity} {plain}");
            // Never more than wholly polarised.
            assert!(stokes.iter().all(|s| s.y * s.y + s.z * s.z + s.w * s.w <= s.x * s.x * 1.001 + 1e-12));
        }
    }
}

/// Rays of a scene of a mirror with the reflectance of water, a ball of glass, a metal one and a rough metal one in even light, from (0, 2.6, 6): through which point, and I, Q, U, V
/// over the light, x to the right. Source: Mitsuba 3.9.1, variant scalar_spectral_polarized, integrator stokes over path (at most 12 events, no roulette), 60 000 samples: `validation/polarization_mitsuba.py`.
const MITSUBA: [([f32; 3], [f32; 4]); 8] = [
    ([0.0, 0.0, 2.6], [0.03807, 0.03806, 0.0, 0.0]),
    ([-1.4, 0.95, 0.5], [0.22689, 0.08016, 0.00636, 0.0]),
    ([0.0, 0.42, 0.0], [0.01502, 0.00338, 0.0, 0.0]),
    ([-0.35, 0.6, 0.0], [0.02252, 0.01674, 0.01218, -0.00858]),
    ([1.7, 0.4, 0.6], [0.02469, 0.00507, -0.00029, 0.00058]),
    ([-1.75, 0.3, 0.5], [0.88554, -0.08729, 0.06692, 0.0]),
    ([-1.3, 0.0, 1.2], [0.06614, 0.05784, -0.00008, 0.0]),
    ([1.3, 0.6, 0.5], [0.06736, 0.01624, 0.00029, -0.00226]),
];

#[test]
fn stokes_vectors_are_those_of_another_program() {
    let metal = |n: f32, k: f32, alpha: f32| {
        let (n, k) = (Spectrum::Constant(n), Spectrum::Constant(k));
        let conductor = Conductor { n, k, alpha: Scalar::Constant(alpha), across: None, bounces: FacetBounces::Lost, tint: None };
        Material::new("metal", Scattering::Conductor(conductor))
    };
    let ball = |x: f32, z: f32, material: u32| {
        Object::new("ball", Shape::Sphere(Sphere { center: Vec3::new(x, 0.75, z), radius: 0.7 }), material)
    };
    let floor = Quad { corner: Vec3::new(-40.0, 0.0, 40.0), edges: [Vec3::X * 80.0, Vec3::NEG_Z * 80.0] };
    let scene = uniform(
        vec![metal(1.333, 0.0, 0.0), Material::glass("glass", 1.5, None), metal(0.6, 2.5, 0.0), metal(2.9, 3.0, 0.2)],
        vec![Object::new("floor", Shape::Quad(floor), 0), ball(-1.7, 0.0, 1), ball(0.0, -0.6, 2), ball(1.7, 0.0, 3)],
    );
    let (origin, wavelengths, n) = (Vec3::new(0.0, 2.6, 6.0), SampledWavelengths::fixed(NM), 8192);
    let white = wavelengths.d65_one_nit();
    let settings = PathSettings { max_depth: 12, roulette_depth: 100 };
    let mut wrong = Vec::new();
    for (through, expected) in MITSUBA {
        let direction = (Vec3::from_array(through) - origin).normalize();
        let ray = Ray { origin, direction, time_s: 0.0 };
        let right = direction.cross(Vec3::Y);
        let sum: Vec4 = (0..n)
            .map(|i| {
                let sampler = Sampler::new(SamplerKind::Sobol, 5, (3, 4), i, n);
                scene.trace(&[CameraPath::new(ray, wavelengths, sampler)], StokesVectors { axes: &[right] }, &settings)[0][1]
                    / white[1]
            })
            .sum();
        let stokes = sum / n as f32;
        let off = (stokes - Vec4::from_array(expected)).abs().max_element();
        println!("{through:?}: {stokes} {expected:?}");
        if off > 2e-4 + 0.01 * expected[0] {
            wrong.push(format!("{through:?}: {stokes}, Mitsuba {expected:?}"));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
