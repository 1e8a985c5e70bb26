//! Zoom positions by focal length: the printed ones, and between them.

use crate::LensError;
use crate::paraxial::FirstOrder;
use crate::prescription::Prescription;
use crate::system::{State, System};

/// How much brighter than it really is a lens may be called: f/2 for f/2.07. Names are rounded to thirds of a stop.
pub(super) const NAME_TOLERANCE: f64 = 1.06;

/// Focal length (mm) of each zoom position that the prescription prints; of a prime its one.
pub fn printed_focal_lengths(p: &Prescription) -> Vec<f64> {
    (0..p.zoom.len().max(1)).map(|i| focal_length_at(p, i as f64)).collect()
}

/// Focal length (mm) of a printed zoom position, 1 the first: asked for as a focal length, it sets exactly that position. Fails on a
/// position that is not printed, naming those that are.
pub fn printed_focal_length(p: &Prescription, position: usize) -> Result<f64, LensError> {
    let wrong = |expected: String| LensError::Setting { what: "zoom position", found: position.to_string(), expected };
    if p.zoom.len() < 2 {
        return Err(wrong(format!("none: \"{}\" is not a zoom", p.name)));
    }
    let printed = printed_focal_lengths(p);
    position.checked_sub(1).and_then(|i| printed.get(i).copied()).ok_or_else(|| {
        let all: Vec<String> = printed.iter().enumerate().map(|(i, f)| format!("{} ({f:.2} mm)", i + 1)).collect();
        wrong(format!("one of the printed positions {}", all.join(", ")))
    })
}

/// Focal length at a zoom position, focused at infinity, mm.
fn focal_length_at(p: &Prescription, zoom: f64) -> f64 {
    focal_length_of(p, &System::at(p, State { zoom, focus: 0.0 }))
}

/// Focal length focused at infinity, mm. Openings alone have no power: of them it is the distance from the stop to the film, as a pinhole's is.
pub(super) fn focal_length_of(p: &Prescription, far: &System) -> f64 {
    match p.is_openings_alone() {
        true => far.film_z - far.surfaces[far.stop].z,
        false => FirstOrder::of(far, &far.reference_indices()).efl,
    }
}

/// Position of a zoom at which it has a focal length: a printed one where that is its focal length; else between two neighbouring printed
/// positions whose focal lengths are on either side. Between them gaps are interpolated and the focal length need not be monotone, so
/// that a search over all of the travel could end in a state that nobody printed. `focal_length` in mm, without it the shortest printed. Fails
/// more than 6 % outside of the printed ones, and on a prime 10 % or more off its own.
pub fn zoom_position(p: &Prescription, focal_length: Option<f64>) -> Result<f64, LensError> {
    /// A focal length this near (relative) to a printed one means the printed position: figures are rounded.
    const SAME: f64 = 1e-3;
    /// Parts in which the way between two positions is looked through.
    const PARTS: usize = 32;
    let printed = printed_focal_lengths(p);
    let by = |wanted: std::cmp::Ordering| {
        (1..printed.len()).fold(0, |best, i| if printed[i].total_cmp(&printed[best]) == wanted { i } else { best })
    };
    let (shortest, longest) = (by(std::cmp::Ordering::Less), by(std::cmp::Ordering::Greater));
    let Some(asked) = focal_length else { return Ok(shortest as f64) };
    let (short, long) = (printed[shortest], printed[longest]);
    let range = |expected: String| LensError::Setting { what: "focal length", found: format!("{asked} mm"), expected };
    if p.zoom.len() < 2 {
        // People give the nominal length of a prime too.
        return match (asked / short - 1.0).abs() < 0.1 {
            true => Ok(0.0),
            false => Err(range(format!("{short:.2} mm or nothing: \"{}\" is not a zoom", p.name))),
        };
    }
    if !(asked > short * 0.94 && asked < long * 1.06) {
        return Err(range(format!("{short:.1} to {long:.1} mm")));
    }
    if asked <= short || asked >= long {
        return Ok(if asked <= short { shortest } else { longest } as f64);
    }
    let off = |i: &usize| (asked / printed[*i] - 1.0).abs();
    if let Some(nearest) = (0..printed.len()).min_by(|a, b| off(a).total_cmp(&off(b))).filter(|i| off(i) < SAME) {
        return Ok(nearest as f64);
    }
    let less = |zoom: f64| focal_length_at(p, zoom) < asked;
    let between = (1..printed.len()).find(|i| (printed[i - 1] < asked) != (printed[*i] < asked));
    let Some(first) = between.map(|i| i - 1) else { return Err(range(format!("{short:.1} to {long:.1} mm"))) };
    // Of several places with this focal length, the one nearest to where it would be if it grew evenly.
    let even = (asked - printed[first]) / (printed[first + 1] - printed[first]);
    let at = |k: usize| first as f64 + k as f64 / PARTS as f64;
    let far = |k: &usize| ((*k as f64 + 0.5) / PARTS as f64 - even).abs();
    let crossings = (0..PARTS).filter(|k| less(at(*k)) != less(at(*k + 1)));
    let part = crossings.min_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or(0);
    let (mut low, mut high) = (at(part), at(part + 1));
    let below = less(low);
    for _ in 0..50 {
        let mid = 0.5 * (low + high);
        if less(mid) == below { low = mid } else { high = mid }
    }
    Ok(0.5 * (low + high))
}

#[cfg(test)]
mod tests {
    use super::super::configure::{Configured, FilmPlace, configure};
    use super::*;
    use crate::prescription::read_toml;
    use crate::{embedded, embedded_names};

    #[test]
    fn a_glass_that_is_opaque_in_the_visible_makes_a_lens_all_the_same() {
        // Germanium, 4 from 2 µm on: f of a plano-convex lens is r / (n − 1).
        let text = "name = \"ge\"\nsurfaces = [\n{ radius = 100, gap = 5, glass = \"GERMANIUM\", stop = true, semi_diameter = 10 },\n\
                    { gap = 28, semi_diameter = 10 },\n]\n[usage]\nwavelengths_nm = [10000]\n";
        let p = read_toml(text, "ge.toml").unwrap();
        let set = configure(&p, None, None, None, FilmPlace::AsPublished).unwrap();
        let n = set.system.reference_indices()[1];
        assert!((n - 4.1).abs() < 0.1 && (set.efl - 100.0 / (n - 1.0)).abs() < 1e-9, "{n} {}", set.efl);
    }

    #[test]
    fn between_printed_positions_the_film_follows_the_focus() {
        let p = embedded("kit-zoom-18-55mm").unwrap();
        let set = |focal: f64| configure(&p, Some(focal), None, None, FilmPlace::AsPublished).unwrap();
        let rms = |set: &Configured| crate::focusing::AxialSpot::of(&set.system, None).unwrap().rms_at(set.system.film_z);
        // Where nothing is printed the published film is out of focus by more than 0.1 mm of blur, the moved one as sharp as can be.
        let mut between = set(24.0);
        let before = rms(&between);
        let place = between.system.film_z;
        let moved = between.refocus_between_positions(None).unwrap();
        assert!(before > 0.05 && rms(&between) < 0.01, "{before} {}", rms(&between));
        assert!((between.system.film_z - place - moved).abs() < 1e-12 && moved.abs() > 0.05, "{moved}");
        // A printed position keeps its film.
        let mut printed = set(printed_focal_lengths(&p)[0]);
        let place = printed.system.film_z;
        assert_eq!(printed.refocus_between_positions(None), None);
        assert_eq!(printed.system.film_z, place);
        // A near object lies sharp farther back, by Newton's f² / x.
        let mut near = set(24.0);
        near.refocus_between_positions(Some(3000.0)).unwrap();
        let back = near.system.film_z - between.system.film_z;
        assert!((back / (24.0 * 24.0 / 3000.0) - 1.0).abs() < 0.05, "{back}");
    }

    #[test]
    fn a_zoom_is_set_between_neighbouring_printed_positions() {
        // Two lenses of 100 mm at changing distances d: f = f1 f2 / (f1 + f2 − d) rises to the middle position and falls again.
        let text = "name = \"hump\"\nzoom = [53, 59, 56]\nsurfaces = [\n\
            { radius = 100, gap = 1, glass = \"1.5\", semi_diameter = 5 },\n\
            { radius = -100, gap = [10, 30, 20], semi_diameter = 5, stop = true },\n\
            { radius = 100, gap = 1, glass = \"1.5\", semi_diameter = 5 },\n\
            { radius = -100, gap = [45, 40, 42], semi_diameter = 5 },\n]\n";
        let hump = read_toml(text, "hump.toml").unwrap();
        let printed = printed_focal_lengths(&hump);
        assert!(printed[0] < printed[2] && printed[2] < printed[1], "{printed:?}");
        let mut zooms = vec![hump.clone()];
        zooms.extend(embedded_names().filter_map(embedded).filter(|p| p.zoom.len() > 1));
        assert!(zooms.len() > 3);
        for p in &zooms {
            let printed = printed_focal_lengths(p);
            for i in 0..printed.len() {
                // The position itself, not another with its focal length.
                let f = printed_focal_length(p, i + 1).unwrap();
                assert_eq!(zoom_position(p, Some(f)).unwrap(), i as f64, "{}: {printed:?}", p.name);
            }
            let (short, long) = printed.iter().fold((f64::MAX, 0.0), |(a, b), f| (f.min(a), f.max(b)));
            assert!(printed[zoom_position(p, None).unwrap() as usize] == short, "{}", p.name);
            for k in 1..20 {
                let asked = short + (long - short) * k as f64 / 20.0;
                let zoom = zoom_position(p, Some(asked)).unwrap();
                let found = focal_length_at(p, zoom);
                assert!((found / asked - 1.0).abs() < 1.1e-3, "{} at {zoom}: {found} {asked}", p.name);
                let (before, after) = (printed[zoom.floor() as usize], printed[zoom.ceil() as usize]);
                let between = before.min(after) * 0.999 <= asked && asked <= before.max(after) * 1.001;
                assert!(between, "{}: {asked} mm at position {zoom}", p.name);
            }
        }
        // The long end is the middle position; what lies a little beyond is meant for it.
        assert_eq!(zoom_position(&hump, Some(printed[1] * 1.02)).unwrap(), 1.0);
        let wrong = printed_focal_length(&hump, 4).unwrap_err().to_string();
        assert!(
            wrong.contains("zoom position 4: expected one of the printed positions 1 (") && wrong.contains(", 3 ("),
            "{wrong}"
        );
        assert!(printed_focal_length(&hump, 0).is_err());
        let prime = embedded("double-gauss-50mm").unwrap();
        assert!(printed_focal_length(&prime, 1).unwrap_err().to_string().contains("not a zoom"));
    }
}
