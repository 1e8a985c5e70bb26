//! The construction of an image by a thin lens: the ray parallel to the axis, the chief ray and the ray through the front focal point.
//!
//! Source: Hecht, Optics, 5th ed., §5.2.3. Lengths along the axis are to scale; heights have a scale of their own.

use super::figure::{Anchor, Color, Figure, INK};
use crate::conjugates::Conjugates;
use glam::DVec2;

/// Heights that fit above and below the axis, points.
const HALF_HEIGHT: f64 = 130.0;
/// Room around the drawing, points.
const MARGIN: f64 = 36.0;
const AXIS: Color = [150, 150, 150];
/// Parallel, chief and focal ray.
const RAYS: [(&str, Color); 3] = [("parallel ray", [200, 60, 40]), ("chief ray", [31, 90, 170]), ("focal ray", [40, 140, 70])];

/// Draws object, image and the three rays on a sheet `width` points wide. `None` for what cannot be drawn so: an object that is not real, or an object
/// or image at infinity.
pub fn conjugates_figure(c: &Conjugates, title: &str, width: f64) -> Option<Figure> {
    if !(c.object_mm > 0.0 && c.object_mm.is_finite() && c.image_mm.is_finite() && c.image_mm != 0.0) {
        return None;
    }
    let f = c.focal_mm;
    let left = -c.object_mm.max(f.abs()).max(-c.image_mm) * 1.08;
    let right = c.image_mm.max(f.abs()) * 1.15;
    let tallest = 1f64.max(c.magnification.abs());
    let scale = DVec2::new((width - 2.0 * MARGIN) / (right - left), HALF_HEIGHT / (1.15 * tallest));
    let mut figure = Figure::new(width, 2.0 * HALF_HEIGHT + 3.0 * MARGIN);
    let middle = HALF_HEIGHT + 1.5 * MARGIN;
    let map = |z: f64, y: f64| DVec2::new(MARGIN + (z - left) * scale.x, middle - y * scale.y);

    figure.line([map(left, 0.0), map(right, 0.0)], AXIS, 0.6, 6.0);
    let lens = 1.12 * tallest;
    figure.line([map(0.0, -lens), map(0.0, lens)], INK, 1.4, 0.0);
    for sign in [1.0, -1.0] {
        let tip = map(0.0, sign * lens);
        // Arrow heads point outwards on a converging lens and inwards on a diverging one.
        let back = DVec2::new(0.0, sign * f.signum() * 8.0);
        figure.line([tip + back - DVec2::new(6.0, 0.0), tip, tip + back + DVec2::new(6.0, 0.0)], INK, 1.4, 0.0);
    }
    for (z, name) in [(-f, "F"), (f, "F'")] {
        let at = map(z, 0.0);
        figure.line([at - DVec2::new(0.0, 4.0), at + DVec2::new(0.0, 4.0)], INK, 1.2, 0.0);
        figure.text(at + DVec2::new(0.0, 17.0), name, 10.0, Anchor::Middle);
    }

    let (object, image) = (DVec2::new(-c.object_mm, 1.0), DVec2::new(c.image_mm, c.magnification));
    // Heights in the lens: that of the object, its middle, and that of the image, since the focal ray leaves parallel to the axis.
    for ((name, color), (k, height)) in RAYS.into_iter().zip([1.0, 0.0, c.magnification].into_iter().enumerate()) {
        let slope = (image.y - height) / image.x;
        let end = height + slope * right;
        // What would leave the sheet ends at its edge.
        let stop = if end.abs() > lens { (lens.copysign(end) - height) / slope } else { right };
        figure.line([map(object.x, object.y), map(0.0, height), map(stop, height + slope * stop)], color, 1.1, 0.0);
        if image.x < 0.0 {
            figure.line([map(0.0, height), map(image.x, image.y)], color, 0.8, 3.0);
        }
        figure.text(DVec2::new(MARGIN + 96.0 * k as f64 + 22.0, figure.height - 10.0), name, 9.0, Anchor::Start);
        let key = DVec2::new(MARGIN + 96.0 * k as f64, figure.height - 13.0);
        figure.line([key, key + DVec2::new(17.0, 0.0)], color, 1.4, 0.0);
    }
    for (tip, name, dash) in [(object, "object", 0.0), (image, "image", if image.x < 0.0 { 3.0 } else { 0.0 })] {
        let (foot, head) = (map(tip.x, 0.0), map(tip.x, tip.y));
        figure.line([foot, head], INK, 2.0, dash);
        let back = DVec2::new(0.0, tip.y.signum() * 6.0);
        figure.line([head + back - DVec2::new(4.0, 0.0), head, head + back + DVec2::new(4.0, 0.0)], INK, 1.6, 0.0);
        let beyond = DVec2::new(0.0, if tip.y < 0.0 { 14.0 } else { -6.0 });
        figure.text(head + beyond, name, 10.0, Anchor::Middle);
    }
    figure.text(DVec2::new(0.5 * width, 17.0), title, 11.0, Anchor::Middle);
    Some(figure)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conjugates::Known;
    use crate::draw::Item;

    fn rays(figure: &Figure) -> Vec<Vec<DVec2>> {
        let ray = |i: &Item| match i {
            Item::Path { points, width, .. } if *width == 1.1 => Some(points.clone()),
            _ => None,
        };
        figure.items.iter().filter_map(ray).collect()
    }

    #[test]
    fn the_three_rays_meet_in_the_image() {
        for object in [80.0, 100.0, 400.0] {
            let c = Conjugates::of(Known::FocalObject(50.0, object)).unwrap();
            let figure = conjugates_figure(&c, "thin lens", 640.0).unwrap();
            let rays = rays(&figure);
            assert_eq!(rays.len(), 3);
            // Where two of the straight lines behind the lens cross, the third passes, too.
            let line = |p: &[DVec2]| {
                let slope = (p[2].y - p[1].y) / (p[2].x - p[1].x);
                (slope, p[1].y - slope * p[1].x)
            };
            let [(a, b), (c, d), (e, g)] = [line(&rays[0]), line(&rays[1]), line(&rays[2])];
            let x = (d - b) / (a - c);
            assert!((a * x + b - (e * x + g)).abs() < 1e-6, "{object}");
        }
    }

    #[test]
    fn all_of_it_lies_on_the_sheet() {
        for (f, object) in [(50.0, 2000.0), (50.0, 55.0), (50.0, 30.0), (-50.0, 120.0)] {
            let c = Conjugates::of(Known::FocalObject(f, object)).unwrap();
            let figure = conjugates_figure(&c, "thin lens", 640.0).unwrap();
            for item in &figure.items {
                if let Item::Path { points, .. } = item {
                    let inside = |p: &DVec2| (-1e-6..=640.0 + 1e-6).contains(&p.x) && (0.0..=figure.height).contains(&p.y);
                    assert!(points.iter().all(inside), "{f} {object}: {points:?}");
                }
            }
        }
        let far = Conjugates::of(Known::FocalObject(50.0, f64::INFINITY)).unwrap();
        assert!(conjugates_figure(&far, "", 640.0).is_none());
    }
}
