//! Shapes of surfaces: sag, intersection, normal. Millimetres, f64, in the surface's own frame: vertex at the origin, +z along
//! the axis.
//!
//! Conventions: curvature c = 1/R, positive when the centre lies at +z; conic constant k (−1 parabola); aspheres
//! z = c r² / (1 + √(1 − (1+k) c² r²)) + Σ Aᵢ rⁱ for any powers i ≥ 1, even or odd; a toroid is a curve of that kind in the y–z
//! plane turned about an axis parallel to y at x-radius R_x (ISO 10110-12, Zemax "toroidal"); a biconic has a curvature and a
//! conic constant of its own in x and in y, z = (c_x x² + c_y y²) / (1 + √(1 − (1+k_x) c_x² x² − (1+k_y) c_y² y²)) (ISO 10110-12,
//! Zemax "biconic", CODE V "anamorphic asphere"); Q-type aspheres: [`crate::forbes`]; polynomials in x and y and Zernike sums:
//! [`crate::freeform`]; a Fresnel surface lies in the plane z = 0 and has the slopes of an asphere.

pub use crate::asphere::Asphere;
use crate::forbes::Forbes;
use crate::freeform::Freeform;
use glam::DVec3;

/// Shape of a surface.
#[derive(Clone, Debug, PartialEq)]
pub enum Profile {
    /// z = 0.
    Plane,
    /// Curvature, 1/mm.
    Sphere(f64),
    /// Curvature and conic constant.
    Conic {
        /// 1/R, 1/mm.
        c: f64,
        /// Conic constant: 0 sphere, −1 parabola.
        k: f64,
    },
    /// Conic and polynomial.
    Asphere(Asphere),
    /// Conic or sphere and orthogonal polynomials (Q-type).
    Forbes(Forbes),
    /// Asphere with a polynomial in x and y, or a Zernike sum.
    Freeform(Box<Freeform>),
    /// A plane of facets with the slopes of an asphere, infinitely narrow (Zemax "Fresnel"). Rays are bent as there; paths are those to the plane, so
    /// that wavefronts behind it mean nothing.
    Fresnel(Asphere),
    /// Another curvature in x than in y.
    Toroid {
        /// Profile in the y–z plane.
        y: Asphere,
        /// Curvature in x at the vertex; 0 for a cylinder that is straight along x.
        c_x: f64,
    },
    /// A curvature and a conic constant in x, others in y.
    Biconic {
        /// Curvature in x, 1/mm.
        c_x: f64,
        /// Conic constant in x.
        k_x: f64,
        /// Curvature in y, 1/mm.
        c_y: f64,
        /// Conic constant in y.
        k_y: f64,
    },
}

/// Where a ray meets a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceHit {
    /// Distance along the unit direction, mm; may be negative.
    pub t: f64,
    /// The point.
    pub point: DVec3,
    /// Unit normal, z > 0.
    pub normal: DVec3,
}

/// Conics that are nearly planes and steep aspheres alike come to rest within this, mm.
const TOLERANCE: f64 = 1e-13;

impl Profile {
    /// Curvature in the y–z plane at the vertex, 1/mm.
    pub fn curvature(&self) -> f64 {
        match self {
            Profile::Plane => 0.0,
            Profile::Sphere(c) | Profile::Conic { c, .. } => *c,
            Profile::Asphere(a) | Profile::Toroid { y: a, .. } | Profile::Fresnel(a) => a.vertex_curvature(),
            Profile::Freeform(f) => f.vertex_curvatures()[1],
            Profile::Forbes(f) => f.vertex_curvature(),
            Profile::Biconic { c_y, .. } => *c_y,
        }
    }

    /// Curvature, conic constant and coefficients of a shape of revolution of conic and powers; `None` of any other.
    pub(crate) fn conic_and_powers(&self) -> Option<(f64, f64, &[f64])> {
        match self {
            Profile::Plane => Some((0.0, 0.0, &[])),
            Profile::Sphere(c) => Some((*c, 0.0, &[])),
            Profile::Conic { c, k } => Some((*c, *k, &[])),
            Profile::Asphere(Asphere { c, k, a }) => Some((*c, *k, a)),
            _ => None,
        }
    }

    /// Curvature in the y–z plane of the conic that polynomials are added to.
    pub(crate) fn base_curvature(&self) -> f64 {
        match self {
            Profile::Asphere(a) | Profile::Toroid { y: a, .. } | Profile::Fresnel(a) => a.c,
            Profile::Freeform(f) => f.base.c,
            Profile::Forbes(f) => f.c(),
            other => other.curvature(),
        }
    }

    /// Curvature in the x–z plane at the vertex, 1/mm.
    pub fn curvature_x(&self) -> f64 {
        match self {
            Profile::Toroid { c_x, .. } | Profile::Biconic { c_x, .. } => *c_x,
            Profile::Freeform(f) => f.vertex_curvatures()[0],
            other => other.curvature(),
        }
    }

    /// Whether the surface looks the same from all sides.
    pub fn is_rotational(&self) -> bool {
        match self {
            Profile::Toroid { .. } | Profile::Biconic { .. } => false,
            Profile::Freeform(f) => f.departure.is_rotational(),
            _ => true,
        }
    }

    /// z at a place; `None` where the surface does not reach.
    pub fn sag(&self, x: f64, y: f64) -> Option<f64> {
        let conic = |c: f64, k: f64| {
            let r2 = x * x + y * y;
            let root2 = 1.0 - (1.0 + k) * c * c * r2;
            (root2 >= 0.0).then(|| c * r2 / (1.0 + root2.sqrt()))
        };
        match self {
            Profile::Plane | Profile::Fresnel(_) => Some(0.0),
            Profile::Sphere(c) => conic(*c, 0.0),
            Profile::Conic { c, k } => conic(*c, *k),
            Profile::Asphere(a) => a.sag(x.hypot(y)).map(|s| s.0),
            Profile::Forbes(f) => f.sag(x.hypot(y)).map(|s| s.0),
            Profile::Freeform(f) => f.sag(x, y).map(|s| s.0),
            Profile::Toroid { y: a, c_x } => toroid(a, *c_x, x, y).map(|s| s.0),
            Profile::Biconic { c_x, k_x, c_y, k_y } => biconic([*c_x, *k_x], [*c_y, *k_y], x, y).map(|s| s.0),
        }
    }

    /// dz/dx and dz/dy at a place; `None` where the surface does not reach. Of a Fresnel surface those of its facets.
    pub(crate) fn slopes(&self, x: f64, y: f64) -> Option<[f64; 2]> {
        let round = |sag: Option<(f64, f64)>| {
            let r = x.hypot(y);
            let over_r = if r > 0.0 { sag?.1 / r } else { 0.0 };
            Some([x * over_r, y * over_r])
        };
        match self {
            Profile::Plane => Some([0.0; 2]),
            Profile::Sphere(c) => round(Asphere { c: *c, k: 0.0, a: vec![] }.sag(x.hypot(y))),
            Profile::Conic { c, k } => round(Asphere { c: *c, k: *k, a: vec![] }.sag(x.hypot(y))),
            Profile::Asphere(a) | Profile::Fresnel(a) => round(a.sag(x.hypot(y))),
            Profile::Forbes(f) => round(f.sag(x.hypot(y))),
            Profile::Freeform(f) => f.sag(x, y).map(|(_, zx, zy)| [zx, zy]),
            Profile::Toroid { y: a, c_x } => toroid(a, *c_x, x, y).map(|(_, zx, zy)| [zx, zy]),
            Profile::Biconic { c_x, k_x, c_y, k_y } => biconic([*c_x, *k_x], [*c_y, *k_y], x, y).map(|(_, zx, zy)| [zx, zy]),
        }
    }

    /// Intersection of a ray with the branch through the vertex. `sense` is +1 for light that runs along +z in the local
    /// frame, −1 for light that runs along −z: it, not the direction, chooses between the two roots, so that rays beyond 90°
    /// from the axis meet the front of a fisheye and not its back.
    #[inline]
    pub fn intersect(&self, o: DVec3, d: DVec3, sense: f64) -> Option<SurfaceHit> {
        match self {
            Profile::Plane => {
                let t = -o.z / d.z;
                t.is_finite().then(|| SurfaceHit { t, point: o + d * t, normal: DVec3::Z })
            }
            Profile::Sphere(c) => {
                let (t, point) = meet_conic(o, d, *c, 0.0, sense)?;
                Some(SurfaceHit { t, point, normal: DVec3::new(-c * point.x, -c * point.y, 1.0 - c * point.z) })
            }
            Profile::Conic { c, k } => {
                let (t, point) = meet_conic(o, d, *c, *k, sense)?;
                let n = DVec3::new(-c * point.x, -c * point.y, 1.0 - c * (1.0 + k) * point.z);
                Some(SurfaceHit { t, point, normal: n.normalize() })
            }
            Profile::Asphere(a) => {
                let start = meet_conic(o, d, a.c, a.k, sense).or_else(|| meet_conic(o, d, a.vertex_curvature(), 0.0, sense));
                meet_graph(o, d, start.map(|s| s.0), |p| round_graph(p, |r| a.sag(r)))
            }
            Profile::Forbes(f) => {
                let start = meet_conic(o, d, f.c(), f.k(), sense).or_else(|| meet_conic(o, d, f.vertex_curvature(), 0.0, sense));
                meet_graph(o, d, start.map(|s| s.0), |p| round_graph(p, |r| f.sag(r)))
            }
            Profile::Freeform(f) => {
                let base = &f.base;
                let start = meet_conic(o, d, base.c, base.k, sense).or_else(|| meet_conic(o, d, self.curvature(), 0.0, sense));
                meet_graph(o, d, start.map(|s| s.0), |p| f.sag(p.x, p.y).map(|(z, zx, zy)| (z, slope_vector(zx, zy))))
            }
            Profile::Fresnel(a) => {
                let t = -o.z / d.z;
                if !t.is_finite() {
                    return None;
                }
                let point = o + d * t;
                let slope = round_graph(point, |r| a.sag(r))?.1;
                Some(SurfaceHit { t, point, normal: DVec3::new(-slope.x, -slope.y, 1.0).normalize() })
            }
            Profile::Toroid { y: a, c_x } => {
                meet_graph(o, d, None, |p| toroid(a, *c_x, p.x, p.y).map(|(z, zx, zy)| (z, slope_vector(zx, zy))))
            }
            Profile::Biconic { c_x, k_x, c_y, k_y } => meet_graph(o, d, None, |p| {
                biconic([*c_x, *k_x], [*c_y, *k_y], p.x, p.y).map(|(z, zx, zy)| (z, slope_vector(zx, zy)))
            }),
        }
    }
}

/// Sag and slope vector at a point of a surface of revolution, from z and dz/dr at a height.
#[inline]
fn round_graph(p: DVec3, sag: impl Fn(f64) -> Option<(f64, f64)>) -> Option<(f64, DVec3)> {
    let r = p.x.hypot(p.y);
    let (z, slope) = sag(r)?;
    let over_r = if r > 0.0 { slope / r } else { 0.0 };
    Some((z, slope_vector(p.x * over_r, p.y * over_r)))
}

/// (dz/dx, dz/dy, 0)
fn slope_vector(x: f64, y: f64) -> DVec3 {
    DVec3::new(x, y, 0.0)
}

/// Sag and slopes of a toroid.
fn toroid(a: &Asphere, c_x: f64, x: f64, y: f64) -> Option<(f64, f64, f64)> {
    let (f, slope) = a.sag(y.abs())?;
    let slope = slope * y.signum();
    if c_x == 0.0 {
        return Some((f, 0.0, slope));
    }
    // Turned about the axis at z = R_x: (R_x − z)² = (R_x − f)² − x²; written so that a small curvature is no trouble.
    let b = 1.0 - c_x * f;
    let root2 = b * b - c_x * c_x * x * x;
    if root2 <= 0.0 || b <= 0.0 {
        return None;
    }
    let root = root2.sqrt();
    // z = (1 − root)/c_x = f + (b − root)/c_x = f + c_x x² / (b + root)
    let z = f + c_x * x * x / (b + root);
    Some((z, c_x * x / root, slope * b / root))
}

/// Sag and slopes of a biconic, from curvature and conic constant in x and in y.
fn biconic([c_x, k_x]: [f64; 2], [c_y, k_y]: [f64; 2], x: f64, y: f64) -> Option<(f64, f64, f64)> {
    let (ax, ay) = (c_x * x, c_y * y);
    let root2 = 1.0 - (1.0 + k_x) * ax * ax - (1.0 + k_y) * ay * ay;
    if root2 <= 0.0 {
        return None;
    }
    let root = root2.sqrt();
    let z = (ax * x + ay * y) / (1.0 + root);
    // dz = (d(c_x x² + c_y y²) − z d root) / (1 + root)
    let bend = z / root;
    let slope = |a: f64, c: f64, k: f64| (2.0 * a + bend * (1.0 + k) * c * a) / (1.0 + root);
    Some((z, slope(ax, c_x, k_x), slope(ay, c_y, k_y)))
}

/// Root of c (x² + y² + (1+k) z²) − 2z = 0 along the ray.
#[inline]
fn meet_conic(o: DVec3, d: DVec3, c: f64, k: f64, sense: f64) -> Option<(f64, DVec3)> {
    let a = c * (1.0 + k * d.z * d.z);
    let b = c * (o.dot(d) + k * o.z * d.z) - d.z;
    let q = c * (o.length_squared() + k * o.z * o.z) - 2.0 * o.z;
    let root2 = b * b - a * q;
    if root2 < 0.0 {
        return None;
    }
    // At the root wanted, direction · normal = −(b + a t) = sense · √…
    let root = sense * root2.sqrt();
    let t = if b * sense <= 0.0 { q / (root - b) } else { (-b - root) / a };
    if !t.is_finite() {
        return None;
    }
    let point = o + d * t;
    // The half with the vertex.
    (1.0 - c * (1.0 + k) * point.z > 0.0).then_some((t, point))
}

/// Intersection with z = f(x, y) by Newton from `start`, guarded: where Newton leaves the surface or does not come to rest, a
/// change of sign is looked for along the ray and halved.
fn meet_graph(o: DVec3, d: DVec3, start: Option<f64>, f: impl Fn(DVec3) -> Option<(f64, DVec3)>) -> Option<SurfaceHit> {
    let at = |t: f64| {
        let p = o + d * t;
        let (z, slope) = f(p)?;
        Some((p.z - z, d.z - slope.dot(d), p, slope))
    };
    let found = |t: f64, p: DVec3, slope: DVec3| {
        let normal = DVec3::new(-slope.x, -slope.y, 1.0).normalize();
        Some(SurfaceHit { t, point: p, normal })
    };
    let plane = -o.z / d.z;
    for first in [start, Some(plane)].into_iter().flatten().filter(|t| t.is_finite()) {
        let mut t = first;
        for _ in 0..40 {
            let Some((g, slope_t, p, slope)) = at(t) else { break };
            let step = g / slope_t;
            if !step.is_finite() {
                break;
            }
            if step.abs() < TOLERANCE * (1.0 + t.abs()) {
                return found(t, p, slope);
            }
            t -= step;
        }
    }
    // The surface may end before the plane is met: look around the plane, in steps that grow.
    let middle = if plane.is_finite() { plane } else { 0.0 };
    let mut before: Option<(f64, f64)> = None;
    const STEPS: i32 = 200;
    for i in -STEPS..=STEPS {
        let s = i as f64 / STEPS as f64;
        let t = middle + 100.0 * s * s.abs();
        let Some((g, ..)) = at(t) else {
            before = None;
            continue;
        };
        if let Some((t0, g0)) = before.filter(|b| (b.1 < 0.0) != (g < 0.0)) {
            let (mut low, mut high) = (t0, t);
            for _ in 0..200 {
                let mid = 0.5 * (low + high);
                let (gm, ..) = at(mid)?;
                if (gm < 0.0) == (g0 < 0.0) {
                    low = mid
                } else {
                    high = mid
                }
                if (high - low).abs() < TOLERANCE * (1.0 + high.abs()) {
                    break;
                }
            }
            let (_, _, p, slope) = at(0.5 * (low + high))?;
            return found(0.5 * (low + high), p, slope);
        }
        before = Some((t, g));
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::forbes::ForbesKind;
    use crate::polynomial::{Polynomial, Terms};

    fn ray(x: f64, y: f64, dx: f64, dy: f64) -> (DVec3, DVec3) {
        (DVec3::new(x, y, -20.0), DVec3::new(dx, dy, 1.0).normalize())
    }

    fn freeform(c: f64, k: f64) -> Profile {
        let xy = [((0, 1), 0.02), ((2, 0), -0.1), ((1, 1), 0.05), ((2, 1), 0.03), ((0, 4), -0.02)];
        let terms = Terms {
            radial: vec![0.03],
            xy: xy.into(),
            noll: vec![0.0, 0.0, 0.01, 0.0, 0.02, -0.03, 0.01, 0.02],
            fringe: vec![0.0; 5],
        };
        let departure = Polynomial::new(5.0, terms).unwrap();
        Profile::Freeform(Box::new(Freeform { base: Asphere { c, k, a: vec![0.0, 0.0, 0.0, 0.0, 1e-5] }, departure }))
    }

    #[test]
    fn a_fresnel_surface_bends_in_its_plane_as_its_asphere_slopes() {
        let asphere = Asphere { c: 0.04, k: -1.2, a: vec![0.0, 0.0, 0.0, 0.0, 1e-5] };
        let m = Profile::Fresnel(asphere.clone())
            .intersect(DVec3::new(2.0, -3.0, -8.0), DVec3::new(0.1, 0.2, 1.0).normalize(), 1.0)
            .unwrap();
        assert!(m.point.z.abs() < 1e-14 && (m.point.truncate() - glam::DVec2::new(2.8, -1.4)).length() < 1e-13, "{m:?}");
        let slope = asphere.sag(2.8f64.hypot(1.4)).unwrap().1 / 2.8f64.hypot(1.4);
        assert!((m.normal - DVec3::new(-2.8 * slope, 1.4 * slope, 1.0).normalize()).length() < 1e-14);
    }

    #[test]
    fn every_shape_is_met_where_its_sag_says() {
        let a = |c: f64, k: f64, a: &[f64]| Asphere { c, k, a: a.to_vec() };
        let shapes = [
            Profile::Plane,
            Profile::Sphere(0.02),
            Profile::Sphere(-0.05),
            Profile::Conic { c: 0.04, k: -1.0 },
            Profile::Conic { c: -0.03, k: 2.0 },
            Profile::Asphere(a(0.03, -0.5, &[0.0, 0.0, 0.0, 0.0, 1e-5, 0.0, -2e-7])),
            Profile::Asphere(a(0.0, 0.0, &[0.0, 0.01, -0.003, 4e-4])),
            // A conic that ends at 4 mm with a polynomial on it, as phones have them.
            Profile::Asphere(a(0.2, 0.5, &[0.0, 0.0, 0.0, 0.0, -2e-3])),
            Profile::Forbes(Forbes::new(ForbesKind::Conic, 0.03, -0.7, 5.0, vec![0.05, -0.02, 0.01, 0.004]).unwrap()),
            Profile::Forbes(Forbes::new(ForbesKind::BestFitSphere, -0.04, 0.0, 6.0, vec![0.1, -0.05, 0.02]).unwrap()),
            Profile::Forbes(Forbes::new(ForbesKind::BestFitSphere, 0.05, -0.8, 7.0, vec![-0.2, 0.07, 0.01]).unwrap()),
            Profile::Toroid { y: a(0.03, 0.0, &[]), c_x: 0.0 },
            Profile::Toroid { y: a(0.03, -1.0, &[0.0, 0.0, 0.0, 0.0, 1e-6]), c_x: -0.02 },
            Profile::Biconic { c_x: 0.01, k_x: -3.0, c_y: 0.04, k_y: 0.5 },
            Profile::Biconic { c_x: -0.05, k_x: 0.0, c_y: 0.0, k_y: 0.0 },
            freeform(0.03, -0.6),
            freeform(0.0, 0.0),
        ];
        for shape in &shapes {
            let mut met = 0;
            for i in 0..200 {
                let f = |k: usize| ((i * k % 199) as f64 / 99.0 - 1.0) * 3.0;
                let (o, d) = ray(f(7), f(31), f(13) * 0.04, f(53) * 0.04);
                for (o, d, sense) in [(o, d, 1.0), (o + d * 60.0, -d, -1.0)] {
                    let Some(m) = shape.intersect(o, d, sense) else { continue };
                    met += 1;
                    let z = shape.sag(m.point.x, m.point.y).unwrap();
                    assert!((m.point.z - z).abs() < 1e-10, "{shape:?} {m:?} {z}");
                    assert!((m.normal.length() - 1.0).abs() < 1e-12 && m.normal.z > 0.0, "{shape:?}");
                    // The normal by differences.
                    let h = 1e-5;
                    let s = |x: f64, y: f64| shape.sag(m.point.x + x, m.point.y + y);
                    if let (Some(a), Some(b), Some(c), Some(e)) = (s(h, 0.0), s(-h, 0.0), s(0.0, h), s(0.0, -h)) {
                        let n = DVec3::new((b - a) / (2.0 * h), (e - c) / (2.0 * h), 1.0).normalize();
                        assert!(
                            (n - m.normal).length() < 1e-6 || m.point.x.hypot(m.point.y) < 1e-3,
                            "{shape:?} {n} {}",
                            m.normal
                        );
                    }
                }
            }
            assert!(met > 250, "{shape:?}: {met}");
        }
    }

    #[test]
    fn a_biconic_of_equal_sections_is_the_conic_and_is_no_toroid_else() {
        let same = Profile::Biconic { c_x: 0.05, k_x: -0.7, c_y: 0.05, k_y: -0.7 };
        let conic = Profile::Conic { c: 0.05, k: -0.7 };
        for (x, y) in [(0.0, 0.0), (3.0, 0.0), (0.0, -4.0), (5.0, 2.0)] {
            assert!((same.sag(x, y).unwrap() - conic.sag(x, y).unwrap()).abs() < 1e-14);
        }
        // By hand at x = 6, y = 8, c_x = 1/100, c_y = 1/50, no conic constants: (0.36 + 1.28) / (1 + √(1 − 0.0036 − 0.0256)).
        let biconic = Profile::Biconic { c_x: 0.01, k_x: 0.0, c_y: 0.02, k_y: 0.0 };
        let z = biconic.sag(6.0, 8.0).unwrap();
        assert!((z - 1.64 / (1.0 + 0.9708f64.sqrt())).abs() < 1e-14, "{z}");
        // The toroid of the same radii lies micrometres beside it.
        let toroid = Profile::Toroid { y: Asphere { c: 0.02, k: 0.0, a: vec![] }, c_x: 0.01 };
        let apart = (toroid.sag(6.0, 8.0).unwrap() - z).abs();
        assert!(apart > 1e-4 && apart < 1e-1, "{apart}");
        // It ends where the root does.
        assert!(biconic.sag(0.0, 50.1).is_none() && biconic.sag(0.0, 49.9).is_some());
    }

    #[test]
    fn rays_from_behind_ninety_degrees_meet_the_front() {
        // A dome of radius 10 with its vertex towards −z, seen from beside and a little behind.
        let dome = Profile::Sphere(0.1);
        let d = DVec3::new(-1.0, 0.0, -0.1).normalize();
        let m = dome.intersect(DVec3::new(40.0, 0.0, 8.0), d, 1.0).unwrap();
        assert!(m.point.x > 0.0 && m.point.z < 10.0 && d.dot(m.normal) > 0.0, "{m:?}");
        // The ray enters the ball: from outside to inside, which is what light along +z does at the vertex.
        assert!(dome.intersect(DVec3::new(0.0, 30.0, -20.0), DVec3::Z, 1.0).is_none());
    }
}
