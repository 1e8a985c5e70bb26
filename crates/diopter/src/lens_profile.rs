//! What a lens as it is set does to pictures of a sensor: the tables with which development undoes it.
//!
//! Rays leave points of the film through the whole pupil at wavelengths across the visible; for each colour of pixel their directions are averaged by
//! what reaches the sensor and what it responds to. The picture is put where these colours are seen to be, not where one ideal ray is.

use diopter_image::LensProfile;
use diopter_image::raw::Filter;
use diopter_lens::CompoundLens;
use diopter_sensor::Sensor;
use glam::DVec2;

/// Points of the tables.
const POINTS: usize = 65;
/// Wavelengths, nm, and rays a side of the pupil.
const WAVELENGTHS: [f64; 12] = [410.0, 435.0, 460.0, 485.0, 510.0, 535.0, 560.0, 585.0, 610.0, 635.0, 660.0, 685.0];
const ACROSS: usize = 8;
/// Largest tangent a flat picture can hold.
const LARGEST_TANGENT: f64 = 6.0;
/// How much two directions on the film may differ before a lens counts as not round.
const ROUND: f64 = 1e-3;

/// What arrives at a film point: tangent of the angle for red, green and blue pixels, and light for green ones.
struct Arriving {
    tangents: [f64; 3],
    light: f64,
}

/// The profile of a lens for a film of half the diagonal `half_diagonal_mm`; `None` of lenses that are not round about their axis or
/// show nothing.
pub fn profile(lens: &CompoundLens, sensor: &Sensor, half_diagonal_mm: f64) -> Option<LensProfile> {
    let responses = sensor.band_responses();
    // Channels by colour; a colour without a channel takes one that there is.
    let channel = |filter: Filter| sensor.cfa.filters().iter().position(|f| *f == filter);
    let green = channel(Filter::Green).or(channel(Filter::Clear)).unwrap_or(0);
    let of_colour = [channel(Filter::Red).unwrap_or(green), green, channel(Filter::Blue).unwrap_or(green)];
    let distance_mm = lens.focus_distance().map(|d| d.0);
    let arriving = |film: DVec2| -> Option<Arriving> {
        let towards = film.normalize_or(DVec2::Y);
        let (mut sums, mut weights) = ([0.0; 3], [0.0; 3]);
        for nm in WAVELENGTHS {
            let response = of_colour.map(|c| f64::from(responses[c].at(nm as f32)));
            for i in 0..ACROSS * ACROSS {
                let u = [(i % ACROSS) as f32 + 0.5, (i / ACROSS) as f32 + 0.5].map(|v| v / ACROSS as f32);
                let Ok(ray) = lens.ray(film, u, nm) else { continue };
                // Where the ray meets the plane in focus, as a tangent seen from the entrance pupil.
                let slope = ray.direction.truncate() / -ray.direction.z;
                let at = match distance_mm {
                    None => slope,
                    Some(d) => (ray.origin_mm.truncate() + slope * (d + ray.origin_mm.z)) / d,
                };
                for k in 0..3 {
                    sums[k] += ray.weight_sr * response[k] * at.dot(towards);
                    weights[k] += ray.weight_sr * response[k];
                }
            }
        }
        let tangents: [f64; 3] = std::array::from_fn(|k| (sums[k] / weights[k]).abs());
        let seen = tangents.iter().all(|t| t.is_finite() && *t < LARGEST_TANGENT) && weights[1] > 0.0;
        seen.then_some(Arriving { tangents, light: weights[1] })
    };
    let corner = half_diagonal_mm;
    let round = |fraction: f64| -> Option<bool> {
        let [x, y] = [DVec2::X, DVec2::Y].map(|d| arriving(d * corner * fraction));
        Some((x?.tangents[1] / y?.tangents[1] - 1.0).abs() < ROUND)
    };
    if !round(0.1)? {
        return None;
    }
    // As far out as light comes.
    let mut reach = 1.0;
    while arriving(DVec2::Y * corner * reach).is_none() {
        reach -= 0.01;
        if reach < 0.1 {
            return None;
        }
    }
    let rows: Vec<Arriving> =
        (0..POINTS).map(|i| arriving(DVec2::Y * corner * reach * i as f64 / (POINTS - 1) as f64)).collect::<Option<_>>()?;
    let small = &rows[1];
    let scale = reach / (POINTS - 1) as f64 / small.tangents[1];
    let profile = LensProfile {
        reach: reach as f32,
        scale: scale as f32,
        // On the axis the angle is none, whatever rounding says.
        tangents: std::array::from_fn(|k| {
            rows.iter().enumerate().map(|(i, r)| if i == 0 { 0.0 } else { r.tangents[k] as f32 }).collect()
        }),
        brightness: rows.iter().map(|r| (r.light / rows[0].light) as f32).collect(),
    };
    profile.is_whole().then_some(profile)
}

#[cfg(test)]
mod tests {
    use crate::shot::{Shot, ShotFile};
    use diopter_lens::Lens;

    fn shot(lens: &str, focal_length: Option<&str>) -> Shot {
        let mut file = ShotFile::default();
        file.camera.lens = Some(lens.into());
        file.camera.focal_length = focal_length.map(|f| f.parse().unwrap());
        file.focus.distance = Some("inf".parse().unwrap());
        file.scene.file = Some("cornell".into());
        Shot::prepare(&file, &mut |_| {}).unwrap()
    }

    #[test]
    fn the_facts_of_a_zoom_hold_its_range() {
        let zoom = shot("kit-zoom-18-55mm", Some("30 mm")).facts();
        let [[short, wide], [long, tele]] = zoom.lens_range.unwrap();
        // The focal lengths of the ends as the sheet states them; f/3.5 at the short one, as far as the rims allow.
        assert!((short - 18.693).abs() < 0.05 && (long - 53.3).abs() < 0.05, "{short} {long}");
        assert!((3.4..4.2).contains(&wide) && tele > wide, "{wide} {tele}");
        let prime = shot("double-gauss-50mm", None).facts();
        let [a, b] = prime.lens_range.unwrap();
        assert!(a == b && (a[0] - prime.focal_length_mm).abs() < 0.01, "{a:?} {b:?}");
    }

    #[test]
    fn profiles_are_smooth_and_corners_darker() {
        for name in ["kit-zoom-18-55mm", "double-gauss-50mm", "fisheye-15mm-f2.8", "reflex-500mm-f8", "telephoto-250mm"] {
            let p = shot(name, None).facts().lens_profile.unwrap_or_else(|| panic!("{name} has a profile"));
            let last = p.brightness.len() - 1;
            assert!(p.brightness[0] == 1.0 && p.brightness[last] < 1.02, "{name} {}", p.brightness[last]);
        }
        // Cylinders are not round about their axis, and ideal lenses have nothing to undo.
        assert_eq!(shot("anamorphic-31mm", None).facts().lens_profile, None);
        assert_eq!(shot("thin", None).facts().lens_profile, None);
    }

    #[test]
    fn heights_are_those_of_the_bench() {
        // The other way round: chief rays from the scene. Their place and the middle of all light differ by coma alone.
        let shot = shot("kit-zoom-18-55mm", Some("18 mm"));
        let p = shot.facts().lens_profile.unwrap();
        let Lens::Compound(lens) = &shot.camera.lens else { panic!("a prescription") };
        let bench = diopter_lens::analysis::Bench::at_infinity(lens.system());
        let half = 0.5 * shot.camera.film.width_mm.hypot(shot.camera.film.height_mm);
        let n = p.tangents[1].len() - 1;
        let mut largest = 0.0f64;
        for field in [5.0f64, 12.0, 20.0, 27.0] {
            let point = bench.field_point(field, 546.0).unwrap();
            let place = point.height.abs() / half / f64::from(p.reach) * n as f64;
            if place > n as f64 {
                continue;
            }
            let i = (place as usize).min(n - 1);
            let t = f64::from(p.tangents[1][i]) + (place - i as f64) * f64::from(p.tangents[1][i + 1] - p.tangents[1][i]);
            assert!((t / field.to_radians().tan() - 1.0).abs() < 4e-3, "{field}: {t} {}", field.to_radians().tan());
            largest = largest.max((point.height.abs() / half / (f64::from(p.scale) * field.to_radians().tan()) - 1.0).abs());
        }
        // There is something to undo: barrel distortion of some percent.
        assert!(largest > 0.02, "{largest}");
    }
}
