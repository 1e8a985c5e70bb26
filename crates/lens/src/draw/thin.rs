//! A thin lens with bundles of rays from several fields: the double arrow of textbooks, its pupil and the film.
//!
//! A ray of slope u at the height h leaves with u − h / f (Gauss). Hecht, Optics, 5th ed., §5.2.

use super::figure::{Anchor, FIELD_COLORS, Figure, INK};
use crate::ThinLens;
use glam::DVec2;

/// Rays a field.
const RAYS: usize = 7;
/// How much of the way before the lens is drawn, in film distances.
const BEFORE: f64 = 0.8;

/// Heights on the film (mm) at which the rays of a field angle (degrees) arrive, with the heights in the pupil (mm) where they come
/// through: `[pupil, film, slope before the lens]`.
fn bundle(lens: &ThinLens, field_deg: f64) -> Vec<[f64; 3]> {
    let (f, film) = (lens.focal_length.0, lens.film_distance().0);
    let radius = lens.radius();
    (0..RAYS)
        .map(|i| {
            let h = radius * (2.0 * i as f64 / (RAYS - 1) as f64 - 1.0);
            // From a point of the sharp plane, or along parallels.
            let before = field_deg.to_radians().tan() + lens.focus_distance().map_or(0.0, |s| h / s.0);
            [h, h + film * (before - h / f), before]
        })
        .collect()
}

/// Draws a thin lens in the y–z plane, light from the left, on a sheet at most so many points wide. Field angles of 89° and more are
/// left out.
pub fn thin_layout(lens: &ThinLens, title: &str, fields_deg: &[f64], width: f64) -> Figure {
    let film = lens.film_distance().0;
    let radius = lens.radius();
    let start = -BEFORE * film;
    let fields = fields_deg.iter().copied().enumerate().filter(|(_, a)| a.abs() < 89.0);
    let bundles: Vec<(usize, f64, Vec<[f64; 3]>)> = fields.map(|(k, a)| (k, a, bundle(lens, a))).collect();
    let rays = || bundles.iter().flat_map(|b| &b.2);
    let on_film = rays().map(|r| r[1].abs()).fold(0.05 * film, f64::max);
    let reach = rays().map(|r| (r[0] + start * r[2]).abs()).fold(on_film.max(1.3 * radius), f64::max);

    let (low, high) = (DVec2::new(1.05 * start, -1.05 * reach), DVec2::new(1.15 * film, 1.05 * reach));
    let scale = (width / (high.x - low.x)).min(1200.0 / (high.y - low.y));
    let mut figure = Figure::new((high.x - low.x) * scale, (high.y - low.y) * scale + 40.0);
    let map = |z: f64, y: f64| DVec2::new((z - low.x) * scale, 28.0 + (high.y - y) * scale);

    figure.line([map(low.x, 0.0), map(high.x, 0.0)], [150, 150, 150], 0.5, 6.0);
    // The lens, and the stop around its pupil.
    figure.line([map(0.0, -1.2 * radius), map(0.0, 1.2 * radius)], INK, 1.0, 0.0);
    for sign in [1.0, -1.0] {
        let tip = map(0.0, sign * 1.2 * radius);
        let wing = |x: f64| tip + DVec2::new(x, sign * 7.0);
        figure.line([wing(-5.0), tip, wing(5.0)], INK, 1.0, 0.0);
        figure.line([map(0.0, sign * radius), map(0.0, sign * 1.2 * radius)], INK, 2.6, 0.0);
    }
    figure.line([map(film, -1.05 * on_film), map(film, 1.05 * on_film)], INK, 1.6, 0.0);
    for (k, angle, rays) in &bundles {
        let color = FIELD_COLORS[k % FIELD_COLORS.len()];
        for [h, end, before] in rays {
            figure.line([map(start, h + start * before), map(0.0, *h), map(film, *end)], color, 0.6, 0.0);
        }
        if let Some([_, end, _]) = rays.get(RAYS / 2) {
            figure.text(map(film, *end) + DVec2::new(6.0, 3.0), format!("{angle:.1}°"), 9.0, Anchor::Start);
        }
    }
    figure.text(DVec2::new(0.5 * figure.width, 17.0), title, 11.0, Anchor::Middle);
    figure
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::draw::Item;
    use crate::{Focus, Iris};
    use diopter_light::units::Millimeters;

    #[test]
    fn all_rays_of_a_sharp_point_meet_on_the_film() {
        for focus in [Focus::Infinity, Focus::at_mm(400.0)] {
            let lens = ThinLens::new(Millimeters(50.0), 2.0, Iris::default(), focus).unwrap();
            let image = lens.film_distance().0 * 12f64.to_radians().tan();
            for [_, end, _] in bundle(&lens, 12.0) {
                assert!((end - image).abs() < 1e-9, "{focus:?}: {end} {image}");
            }
        }
        // Off its focus it makes a blur as wide as similar triangles say.
        let lens = ThinLens::new(Millimeters(50.0), 2.0, Iris::default(), Focus::Extension(Millimeters(-2.0))).unwrap();
        let ends: Vec<f64> = bundle(&lens, 0.0).iter().map(|r| r[1]).collect();
        assert!((ends[RAYS - 1] - ends[0] - 25.0 * 2.0 / 50.0).abs() < 1e-9, "{ends:?}");
    }

    #[test]
    fn the_drawing_shows_every_ray_within_the_sheet() {
        let lens = ThinLens::new(Millimeters(35.0), 1.4, Iris::default(), Focus::Infinity).unwrap();
        let figure = thin_layout(&lens, "thin", &[0.0, 20.0, 89.5], 800.0);
        let mut rays = 0;
        for item in &figure.items {
            if let Item::Path { points, width, .. } = item {
                rays += usize::from(*width == 0.6);
                let inside = |p: &DVec2| (-1e-6..=800.0 + 1e-6).contains(&p.x) && (0.0..=figure.height).contains(&p.y);
                assert!(points.iter().all(inside), "{points:?}");
            }
        }
        // That of 89.5° would not end.
        assert_eq!(rays, 2 * RAYS);
    }
}
