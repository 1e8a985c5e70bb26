use super::*;
use diopter_light::random::{mix, to_unit};

fn unit_box() -> Bounds {
    Bounds { min: Vec3::new(-1.0, 0.0, 2.0), max: Vec3::new(1.0, 3.0, 4.0) }
}

fn random_place(i: u32, b: &Bounds) -> Vec3 {
    let u = [0, 1, 2].map(|k| to_unit(mix(i * 3 + k + 1)));
    b.min + b.size() * Vec3::from_array(u)
}

/// What lookups find in a volume lies within the limits of its cells.
fn assert_bounded(volume: &Volume) {
    let b = *volume.bounds();
    let size = volume.cells();
    let waves = [SampledWavelengths::fixed([390.0, 480.0, 570.0, 690.0]), SampledWavelengths::rgb()];
    for i in 0..20_000 {
        let p = random_place(i, &b);
        let unit = (p - b.min) / b.size();
        let cell = [0, 1, 2].map(|k: usize| ((unit[k] * size[k] as f32) as usize).min(size[k] - 1));
        let limits = volume.limits(cell);
        let [a, s] = volume.factors(p, &waves[i as usize % 2]);
        for (found, [low, high]) in [(a, limits.absorption), (s, limits.scattering)] {
            let within = found.min_element() >= low - 1e-5 && found.max_element() <= high + 1e-5;
            assert!(within, "{p}: {found} not in {low}..{high}");
        }
    }
}

#[test]
fn limits_hold_all_that_is_in_their_cells() {
    let still = VolumePlace::still(Affine3A::IDENTITY).unwrap();
    let b = unit_box();
    let size = [9, 5, 13];
    let n = size.iter().product::<usize>() as u32;
    let number = |i: u32| to_unit(mix(i)).powi(3);
    let grid = Grid::new(size, (0..n).map(number).collect(), &b).unwrap();
    assert_bounded(&Volume::new(still.clone(), b, Field::Density(Scalars::Grid(grid)), None));
    let tint = |i: u32| Tint::from_rgb(Vec3::new(number(i), 3.0 * number(i + n), number(i + 2 * n)));
    let colors = Grid::new(size, (0..n).map(tint).collect(), &b).unwrap();
    let field = Field::Colors { absorption: Some(colors), scattering: None };
    assert_bounded(&Volume::new(still.clone(), b, field, None));
    let cloud = Cloud { density: 2.0, wispiness: 1.0, frequency: 5.0 };
    let tall = Bounds { min: Vec3::new(0.0, -0.5, 0.0), max: Vec3::new(1.0, 1.5, 1.0) };
    assert_bounded(&Volume::new(still, tall, Field::Cloud(cloud), None));
}

#[test]
fn grids_are_linear_between_values_and_nothing_outside() {
    let b = unit_box();
    // x + 10 y + 100 z in numbers of values.
    let values = (0..24).map(|i| (i % 2) as f32 + 10.0 * (i / 2 % 3) as f32 + 100.0 * (i / 6) as f32).collect();
    let grid = Grid::new([2, 3, 4], values, &b).unwrap();
    let at = |x: f32, y: f32, z: f32| grid.blend(b.min + Vec3::new(x, y, z) * Vec3::new(1.0, 1.0, 0.5), 0.0, |v| *v);
    assert!((at(0.5, 0.5, 0.5) - 0.0).abs() < 1e-4 && (at(1.5, 2.5, 3.5) - 321.0).abs() < 1e-3);
    assert!((at(1.0, 1.25, 2.75) - (0.5 + 7.5 + 225.0)).abs() < 1e-2);
    // Half a value outside the outermost it is half of it.
    assert!((at(1.5, 2.5, 4.0) - 160.5).abs() < 1e-2 && at(1.5, 2.5, 4.6) == 0.0);
}

#[test]
fn places_move_straight_and_keep_still_before_and_after() {
    let key = |x: f32| Parts { translation: Vec3::X * x, ..Parts::IDENTITY };
    let place = VolumePlace::moving([1.0, 3.0], [key(0.0), key(4.0)]).unwrap();
    let at = |time_s: f64| place.own_from_world(time_s).transform_point3(Vec3::ZERO).x;
    assert_eq!([0.0, 1.0, 1.5, 3.0, 9.0].map(at), [0.0, 0.0, -1.0, -4.0, -4.0]);
    let mirrored = place.placed(Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0)));
    assert_eq!(mirrored.own_from_world(3.0).transform_point3(Vec3::ZERO).x, -4.0);
    assert_eq!(mirrored.own_from_world(3.0).transform_point3(Vec3::X).x, -5.0);
    assert!(VolumePlace::still(Affine3A::from_scale(Vec3::new(1.0, 0.0, 1.0))).is_none());
    let flat = Parts { scale: Vec3::new(1.0, 0.0, 1.0), ..Parts::IDENTITY };
    assert!(VolumePlace::moving([0.0, 1.0], [key(0.0), flat]).is_none());
}

#[test]
fn black_bodies_have_one_peak_whatever_their_temperature() {
    // 5269 K: brightest at 550 nm.
    let kelvin = WIEN_NM_K / 550.0;
    let found = black_body(kelvin, &SampledWavelengths::fixed([400.0, 550.0, 560.0, 780.0]));
    assert!((found.y - 1.0).abs() < 1e-5 && found.x < 0.9 && found.w < 0.9, "{found}");
    // Tables of colours follow the integral.
    for kelvin in [1000.0, 1850.0, 3300.0, 6500.0] {
        let peak = 1.0 / blackbody(WIEN_NM_K / kelvin, kelvin);
        let exact = srgb_of_light(|nm| blackbody(nm, kelvin) * peak);
        let found = black_body(kelvin, &SampledWavelengths::rgb()).truncate();
        assert!((found - exact).abs().max_element() < 2e-3 * exact.abs().max_element(), "{kelvin}: {found} {exact}");
    }
}
