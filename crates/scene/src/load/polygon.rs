//! Faces of many corners into triangles.

use glam::{DVec2, DVec3, Vec3};

/// Corners of a face that is cut without looking whether it is convex.
const MOST_CORNERS: usize = 512;

/// Cuts a face into triangles: into a fan where it is convex, else by its ears (G. Meisters 1975, "Polygons have ears").
pub(super) fn triangulate(polygon: &[u32], positions: &[Vec3], out: &mut Vec<[u32; 3]>) {
    let n = polygon.len();
    let fan = |out: &mut Vec<[u32; 3]>| out.extend((1..n.saturating_sub(1)).map(|i| [polygon[0], polygon[i], polygon[i + 1]]));
    if !(4..=MOST_CORNERS).contains(&n) {
        return fan(out);
    }
    // Newell's normal, and the plane in which the face is seen best.
    let corner = |i: usize| positions[polygon[i % n] as usize].as_dvec3();
    let normal: DVec3 = (0..n).map(|i| (corner(i) - corner(0)).cross(corner(i + 1) - corner(0))).sum();
    let Some(normal) = normal.try_normalize() else { return fan(out) };
    let (x, y) = normal.any_orthonormal_pair();
    let flat: Vec<DVec2> = (0..n).map(|i| DVec2::new(corner(i).dot(x), corner(i).dot(y))).collect();
    // (x, y, normal) may be of either hand.
    let sign = x.cross(y).dot(normal).signum();
    let turn = |a: usize, b: usize, c: usize| sign * (flat[b] - flat[a]).perp_dot(flat[c] - flat[b]);
    if (0..n).all(|i| turn(i, (i + 1) % n, (i + 2) % n) >= 0.0) {
        return fan(out);
    }
    let mut left: Vec<usize> = (0..n).collect();
    while left.len() > 3 {
        let m = left.len();
        let is_ear = |k: usize| {
            let (a, b, c) = (left[(k + m - 1) % m], left[k], left[(k + 1) % m]);
            let within = |p: usize| turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0;
            turn(a, b, c) > 0.0 && left.iter().all(|p| [a, b, c].contains(p) || !within(*p))
        };
        // A face that crosses itself may have none: the rest of it is a fan.
        let Some(k) = (0..m).find(|k| is_ear(*k)) else { break };
        out.push([left[(k + m - 1) % m], left[k], left[(k + 1) % m]].map(|i| polygon[i]));
        left.remove(k);
    }
    out.extend(left.windows(2).skip(1).map(|pair| [left[0], pair[0], pair[1]].map(|i| polygon[i])));
}
