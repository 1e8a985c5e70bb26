//! Apertures of surfaces in the TOML form.
//!
//! `apertures = [{ rectangle = [18, 12] }]` are openings, `obscurations = [{ ellipse = [3, 2], center = [1, 0] }, { ring = [2, 3] },
//! { spider = 3, width = 0.8, rotation_deg = 90 }]` block; half widths, half axes and radii in mm. One alone needs no list.

use super::Surface;
use super::numbers::number;
use crate::aperture::{Aperture, Outline};
use serde::Deserialize;

/// Most apertures of one surface.
const MOST: usize = 32;

#[derive(Deserialize, Default)]
#[serde(
    untagged,
    expecting = "expected a shape or a list of shapes: { rectangle = [18, 12] }, { ellipse = [18, 12] }, { ring = [2, 3] } or { spider = 3, width = 0.8 }, with center = [0, 0] and rotation_deg where wanted"
)]
pub(super) enum SheetApertures {
    #[default]
    None,
    One(SheetAperture),
    Many(Vec<SheetAperture>),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SheetAperture {
    rectangle: Option<[f64; 2]>,
    ellipse: Option<[f64; 2]>,
    ring: Option<[f64; 2]>,
    spider: Option<u32>,
    width: Option<f64>,
    #[serde(default)]
    center: [f64; 2],
    #[serde(default)]
    rotation_deg: f64,
}

/// Openings, then obscurations.
pub(super) fn read(openings: SheetApertures, obscurations: SheetApertures) -> Result<Vec<Aperture>, String> {
    let mut all = vec![];
    for (list, blocks) in [(openings, false), (obscurations, true)] {
        let list = match list {
            SheetApertures::None => vec![],
            SheetApertures::One(one) => vec![one],
            SheetApertures::Many(many) => many,
        };
        for a in list {
            all.push(aperture(&a, blocks)?);
        }
    }
    if all.len() > MOST {
        return Err(format!("{} apertures and obscurations: expected at most {MOST}", all.len()));
    }
    Ok(all)
}

fn aperture(a: &SheetAperture, blocks: bool) -> Result<Aperture, String> {
    let outline = match (a.rectangle, a.ellipse, a.ring, a.spider, a.width) {
        (Some(half), None, None, None, None) => Outline::Rectangle(half),
        (None, Some(half), None, None, None) => Outline::Ellipse(half),
        (None, None, Some(radii), None, None) => Outline::Ring(radii),
        (None, None, None, Some(arms), Some(width)) => Outline::Spider { arms, width },
        (None, None, None, Some(_), None) => return Err("a spider without width: expected { spider = 3, width = 0.8 }".into()),
        _ => return Err("an aperture: expected one of rectangle, ellipse, ring, and spider with width".into()),
    };
    Aperture::new(outline, blocks, a.center, a.rotation_deg)
}

/// The fields that give a surface's apertures back.
pub(super) fn written(s: &Surface) -> Vec<String> {
    let pair = |[a, b]: [f64; 2]| format!("[{}, {}]", number(a), number(b));
    let one = |a: &Aperture| {
        let mut fields = match a.outline() {
            Outline::Rectangle(half) => format!("rectangle = {}", pair(half)),
            Outline::Ellipse(half) => format!("ellipse = {}", pair(half)),
            Outline::Ring(radii) => format!("ring = {}", pair(radii)),
            Outline::Spider { arms, width } => format!("spider = {arms}, width = {}", number(width)),
        };
        if a.center() != [0.0; 2] {
            fields += &format!(", center = {}", pair(a.center()));
        }
        if a.rotation_deg() != 0.0 {
            fields += &format!(", rotation_deg = {}", number(a.rotation_deg()));
        }
        format!("{{ {fields} }}")
    };
    let of_kind = |(key, blocks): (&str, bool)| {
        let all: Vec<String> = s.apertures.iter().filter(|a| a.blocks() == blocks).map(one).collect();
        (!all.is_empty()).then(|| format!("{key} = [{}]", all.join(", ")))
    };
    [("apertures", false), ("obscurations", true)].into_iter().filter_map(of_kind).collect()
}

#[cfg(test)]
mod tests {
    use super::super::read_toml;
    use crate::ray::{Apertures, TraceDirection, TracedRay};
    use crate::{State, System};
    use glam::DVec3;

    const LENS: &str = "name = \"x\"\nsurfaces = [\n\
        { radius = 50, gap = 4, glass = \"1.5\", apertures = { rectangle = [6, 3], rotation_deg = 20 } },\n\
        { radius = -50, gap = 5, semi_diameter = 8, obscurations = [{ ring = [1, 2], center = [0, 1] }, { ellipse = [0.5, 1.5], center = [3, 0] }] },\n\
        { stop = true, gap = 42, semi_diameter = 6, obscurations = { spider = 3, width = 0.7, rotation_deg = 90 } },\n]\n";

    #[test]
    fn apertures_come_back_from_toml_and_name_what_is_wrong() {
        let p = read_toml(LENS, "x.toml").unwrap();
        assert_eq!(p.surfaces.iter().map(|s| s.apertures.len()).collect::<Vec<_>>(), [1, 2, 1]);
        // The rectangle reaches its corners.
        assert!((p.surfaces[0].semi_diameter.unwrap() - 45f64.sqrt()).abs() < 1e-12);
        let back = read_toml(&p.to_toml(), "x.toml").unwrap();
        for (a, b) in p.surfaces.iter().zip(&back.surfaces) {
            assert_eq!(a.apertures, b.apertures);
        }
        let wrong = |from: &str, to: &str| read_toml(&LENS.replace(from, to), "x.toml").unwrap_err().to_string();
        assert!(wrong("[6, 3]", "[6, -3]").contains("x.toml:3: surface 1: aperture of half widths"));
        assert!(wrong(", width = 0.7", "").contains("a spider without width"));
        assert!(wrong("{ ring = [1, 2], center", "{ ring = [1, 2], ellipse = [1, 1], center").contains("expected one of"));
    }

    #[test]
    fn packets_stop_the_rays_that_the_plain_trace_stops() {
        use crate::batch::double::{Batch, Indices, LANES, Packet};
        let p = read_toml(LENS, "x.toml").unwrap();
        let system = System::at(&p, State::default());
        assert!(!system.is_rotational());
        let n = system.indices(550.0);
        let (batch, lanes) = (Batch::new(&system), Indices::uniform(&n));
        let (mut passed, mut stopped) = (0, 0);
        // A grid over the rectangle; it counts rays that pass all but one of its neighbours too.
        for row in 0..40 {
            let mut packet = Packet::default();
            let place = |lane: usize| DVec3::new(-6.5 + 13.0 * lane as f64 / LANES as f64, -5.0 + 0.25 * row as f64, -3.0);
            let direction = DVec3::new(0.01, -0.03, 1.0).normalize();
            for lane in 0..LANES {
                packet.set(lane, place(lane).to_array(), direction.to_array());
            }
            let mask = batch.trace(&mut packet, &lanes, TraceDirection::ToFilm);
            for lane in 0..LANES {
                let ray = TracedRay { position: place(lane), direction };
                let plain = system.trace(ray, &n, TraceDirection::ToFilm, Apertures::Clip).is_ok();
                assert_eq!(mask >> lane & 1 == 1, plain, "{}", place(lane));
                if plain { passed += 1 } else { stopped += 1 }
            }
        }
        assert!(passed > 100 && stopped > 100, "{passed} {stopped}");
    }

    #[test]
    fn the_widest_beam_of_a_square_stop_is_the_disk_of_equal_area() {
        let lens = |shape: &str| {
            let text = format!(
                "name = \"x\"\nsurfaces = [\n{{ stop = true, gap = 1, {shape} }},\n\
                 {{ radius = 50, gap = 12, glass = \"1.5\", semi_diameter = 20 }},\n{{ radius = -50, gap = 48, semi_diameter = 20 }},\n]\n"
            );
            let p = read_toml(&text, "x.toml").unwrap();
            let system = System::at(&p, State::default());
            let n = system.indices(550.0);
            crate::f_number::widest_radius(&system, &n, 50.0).unwrap()
        };
        // 8 × 8 mm: 64 mm². The radius is from 64 directions: of a square 0.16 % from exact (its corners).
        let expected = (64.0 / std::f64::consts::PI).sqrt();
        let found = lens("apertures = { rectangle = [4, 4] }");
        assert!((found / expected - 1.0).abs() < 3e-3, "{found} {expected}");
        // A spider in the direction that is looked in takes no width from a round beam.
        let spider = lens("semi_diameter = 4, obscurations = { spider = 4, width = 0.5 }");
        assert!((spider - 4.0).abs() < 1e-6, "{spider}");
    }
}
