//! Curves: text with a control point and a radius a line, an empty line between curves. Source: Mitsuba 3, `linearcurve` and `bsplinecurve`; transforms move the
//! points and leave radii as they are.

use crate::shape::{CurveBasis, CurveKind, Curves};
use glam::{DMat4, DVec3, Vec4};

/// Points of a curve of cubic splines, at least.
const LEAST_POINTS: usize = 4;

/// Curves of a file, in the world.
pub(super) fn read(bytes: &[u8], are_splines: bool, world_from_own: DMat4) -> Result<Curves, String> {
    let text = std::str::from_utf8(bytes).map_err(|_| "it is no text".to_owned())?;
    let mut set = Curves::new(CurveKind::Cylinder, if are_splines { CurveBasis::BSpline } else { CurveBasis::Bezier });
    let mut curve: Vec<Vec4> = vec![];
    for (number, line) in text.lines().chain([""]).enumerate() {
        if line.trim().is_empty() {
            add(&mut set, &curve, are_splines);
            curve.clear();
            continue;
        }
        let numbers: Option<Vec<f64>> = line.split_whitespace().map(|v| v.parse().ok().filter(|v: &f64| v.is_finite())).collect();
        let Some([x, y, z, radius]) = numbers.as_deref().filter(|n| n.get(3).is_some_and(|r| *r >= 0.0)) else {
            return Err(format!("line {}: \"{}\"", number + 1, line.trim().chars().take(40).collect::<String>()));
        };
        curve.push(world_from_own.transform_point3(DVec3::new(*x, *y, *z)).as_vec3().extend(*radius as f32));
    }
    set.drop_unusable_segments();
    if set.segments.is_empty() { Err("it has no curve".to_owned()) } else { Ok(set) }
}

/// Adds a curve; one of too few points is none.
fn add(set: &mut Curves, curve: &[Vec4], is_spline: bool) {
    let first = set.points.len() as u32;
    if is_spline {
        if curve.len() >= LEAST_POINTS {
            set.points.extend(curve);
            set.segments.extend((0..=(curve.len() - LEAST_POINTS) as u32).map(|i| first + i));
        }
        return;
    }
    for (i, pair) in curve.windows(2).enumerate() {
        let [a, b] = [pair[0], pair[1]];
        if i == 0 {
            set.points.push(a);
        }
        set.points.extend([a.lerp(b, 1.0 / 3.0), a.lerp(b, 2.0 / 3.0), b]);
        set.segments.push(first + 3 * i as u32);
    }
}
