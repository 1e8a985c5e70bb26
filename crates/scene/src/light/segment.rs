//! Lights seen from a segment of a ray in a scattering medium: at which distance a light is scattered into the ray.
//!
//! Equi-angular sampling: distances are drawn so that the directions from a point of the light to the ray are even in angle, which cancels the
//! 1/r² of a light near the ray. Source: C. Kulla, M. Fajardo 2012, "Importance sampling techniques for path tracing in participating media",
//! §3 (equations 5 and 6).
//!
//! Where it differs from the paper: the angle is warped by the wrapped Cauchy distribution (K. Mardia, P. Jupp 2000, "Directional Statistics",
//! §3.5.7) with the asymmetry of the medium as mean resultant length. Its density (1 + g² − 2g cos α)⁻¹ stands for the phase function of Henyey and
//! Greenstein, (1 + g² − 2g cos α)^(−3/2), and has a cumulative distribution in closed form. Lights with extent widen the distribution by their own
//! size. Spots and one-sided surfaces restrict it to the distances from which they are seen.

use glam::Vec3;
use std::f32::consts::{FRAC_PI_2, TAU};

/// A segment of a ray within a scattering medium.
#[derive(Clone, Copy, Debug)]
pub struct Segment {
    /// Where the ray starts, m.
    pub origin: Vec3,
    /// Unit direction.
    pub direction: Vec3,
    /// Distance from the origin at which the segment begins, m.
    pub near: f32,
    /// Distance at which it ends, m; may be infinite.
    pub far: f32,
    /// Extinction, 1/m; steers the choice among lights.
    pub extinction: f32,
}

impl Segment {
    /// Distance along the ray at which a point is nearest to the line, and the square of the distance of both.
    #[inline]
    pub(super) fn nearest(&self, p: Vec3) -> (f32, f32) {
        let to = p - self.origin;
        let t = to.dot(self.direction);
        (t, (to - self.direction * t).length_squared())
    }

    /// Angle (rad) under which the part of the segment up to `far` is seen from beside it: `t` as [`Segment::nearest`] gives it, at a distance
    /// `offset` > 0 from the line.
    #[inline]
    pub(super) fn angle(&self, far: f32, t: f32, offset: f32) -> f32 {
        let (a, b) = (self.near - t, far - t);
        // One arc tangent of the difference of both angles: their difference would cancel.
        if b.is_infinite() { FRAC_PI_2 - (a / offset).atan() } else { ((b - a) * offset).atan2(offset * offset + a * b) }
    }
}

/// What equi-angular sampling needs to know of a light.
#[derive(Clone, Copy, Debug)]
pub struct Pivot {
    /// Middle of the light, m.
    pub position: Vec3,
    /// Projected area over 2π, m²: Ω ≈ A / (d² + A/2π) is the solid angle of a light both far away and near. 0 for a light without extent.
    pub radius2: f32,
    /// Axis, and cosine of the half angle, of the cone about the position in which the light is seen; `None` where it is seen from all around.
    pub cone: Option<(Vec3, f32)>,
}

impl Pivot {
    /// A light without extent that is seen from all around.
    pub fn point(position: Vec3) -> Self {
        Pivot { position, radius2: 0.0, cone: None }
    }

    /// A light of a projected area (m²).
    pub(super) fn of_area(position: Vec3, projected_area: f32, cone: Option<(Vec3, f32)>) -> Self {
        Pivot { position, radius2: projected_area / TAU, cone }
    }

    /// Angle (rad) under which the light sees the part of a segment up to a distance along the ray, m.
    pub fn angle(&self, segment: &Segment, far: f32) -> f32 {
        let (t, d2) = segment.nearest(self.position);
        segment.angle(far.min(segment.far), t, offset(d2, self.radius2))
    }

    /// The distances of a segment from which the light is seen.
    fn clipped(&self, s: &Segment) -> Option<[f32; 2]> {
        let whole = Some([s.near, s.far]).filter(|[a, b]| a < b);
        let Some((axis, cos)) = self.cone.filter(|c| c.1 >= 0.0) else { return whole };
        let [to, d, axis] = [s.origin - self.position, s.direction, axis].map(Vec3::as_dvec3);
        let (to_axis, d_axis) = (to.dot(axis), d.dot(axis));
        let within = |from: f64, until: f64| {
            let (a, b) = (s.near.max(from as f32), s.far.min(until as f32));
            (a < b).then_some([a, b])
        };
        let (all, none) = (f64::INFINITY, None);
        if cos == 0.0 {
            // A half space.
            let t = -to_axis / d_axis;
            return match d_axis {
                x if x > 0.0 => within(t, all),
                x if x < 0.0 => within(-all, t),
                _ if to_axis > 0.0 => whole,
                _ => none,
            };
        }
        // Both naps of the cone: a t² + 2 b t + c ≥ 0.
        let cos2 = f64::from(cos).powi(2);
        let (a, b) = (d_axis * d_axis - cos2, to_axis * d_axis - cos2 * to.dot(d));
        let c = to_axis * to_axis - cos2 * to.length_squared();
        let root = (b * b - a * c).max(0.0).sqrt();
        if a == 0.0 {
            return whole;
        }
        let (low, high) = ((-b - root) / a, (-b + root) / a);
        let (low, high) = (low.min(high), low.max(high));
        match a < 0.0 {
            // Across the cone: between both roots, if that is on the side of the light.
            true if root > 0.0 && to_axis + 0.5 * (low + high) * d_axis > 0.0 => within(low, high),
            true => none,
            // Along it: one end of the line is on the side of the light.
            false if d_axis > 0.0 => within(high, all),
            false => within(-all, low),
        }
    }
}

/// Distance from the line by which the distribution is as wide as a light is large; never 0.
#[inline]
fn offset(d2: f32, radius2: f32) -> f32 {
    (d2 + radius2).sqrt().max(1e-6)
}

/// Asymmetry up to which the angle is warped: beyond it the peak is narrower than what extinction and extent leave of it.
const MOST_WARP: f64 = 0.95;

/// The distribution of distances along a segment for one light.
#[derive(Clone, Copy, Debug)]
pub struct EquiAngular {
    /// Distance along the ray nearest to the light, m.
    nearest: f64,
    /// Distance of the light from there, m.
    offset: f64,
    from: f32,
    to: f32,
    /// (1 + g) / (1 − g).
    k: f64,
    /// Warped angle at the start, and its range.
    first: f64,
    range: f64,
}

impl EquiAngular {
    /// The distances of a segment from which a light is seen, in a medium of an asymmetry (mean cosine of scattering, −1 to 1; taken as within ±0.95); `None` if there
    /// are none.
    pub fn new(segment: &Segment, light: &Pivot, asymmetry: f32) -> Option<Self> {
        let [from, to] = light.clipped(segment)?;
        let (nearest, d2) = segment.nearest(light.position);
        let g = f64::from(asymmetry).clamp(-MOST_WARP, MOST_WARP);
        let mut this = EquiAngular {
            nearest: f64::from(nearest),
            offset: f64::from(offset(d2, light.radius2)),
            from,
            to,
            k: (1.0 + g) / (1.0 - g),
            first: 0.0,
            range: 0.0,
        };
        this.first = this.warped(f64::from(from));
        this.range = this.warped(f64::from(to)) - this.first;
        (this.range > 0.0 && this.range.is_finite()).then_some(this)
    }

    /// 2 arctan(k tan(α/2)): the cumulative distribution of the angle α between the ray and the direction to the light, up to a factor.
    fn warped(&self, t: f64) -> f64 {
        let x = self.nearest - t;
        let r = (x * x + self.offset * self.offset).sqrt();
        // tan(α/2) in the form that does not cancel.
        let half = if x > 0.0 { self.offset / (r + x) } else { (r - x) / self.offset };
        2.0 * (self.k * half).atan()
    }

    /// A distance along the ray, m, by a number in [0, 1).
    pub fn sample(&self, u: f32) -> f32 {
        let half = (0.5 * (self.first + f64::from(u) * self.range)).tan() / self.k;
        let x = 0.5 * self.offset * (1.0 - half * half) / half;
        ((self.nearest - x) as f32).clamp(self.from, self.to)
    }

    /// Density of a distance, 1/m; 0 where the light is not seen from.
    pub fn density(&self, t: f32) -> f32 {
        if !(self.from..=self.to).contains(&t) {
            return 0.0;
        }
        let x = self.nearest - f64::from(t);
        let r2 = x * x + self.offset * self.offset;
        let k2 = self.k * self.k;
        let warp = 2.0 * self.k / (1.0 + k2 + (1.0 - k2) * x / r2.sqrt());
        (warp * self.offset / (r2 * self.range)) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_light::random::{mix, to_unit};

    fn segment(near: f32, far: f32) -> Segment {
        Segment { origin: Vec3::new(1.0, -2.0, 0.5), direction: Vec3::new(0.6, 0.0, -0.8), near, far, extinction: 0.1 }
    }

    /// Lights beside, ahead of and behind a segment, without and with extent, and those that are seen from a part of it only.
    fn pivots() -> Vec<Pivot> {
        let s = segment(0.0, 1.0);
        let at = |t: f32, side: f32| s.origin + s.direction * t + Vec3::Y * side;
        let cone = |axis: Vec3, cos: f32| Some((axis.normalize(), cos));
        vec![
            Pivot::point(at(3.0, 0.4)),
            Pivot::point(at(3.0, 0.001)),
            Pivot::point(at(20.0, 1.0)),
            Pivot::point(at(-4.0, 0.3)),
            Pivot { radius2: 0.3, ..Pivot::point(at(2.0, 0.2)) },
            Pivot { cone: cone(Vec3::NEG_Y, 0.8), ..Pivot::point(at(3.0, 2.0)) },
            Pivot { cone: cone(Vec3::new(0.6, -0.2, -0.8), 0.7), ..Pivot::point(at(2.0, 0.5)) },
            Pivot { cone: cone(Vec3::new(0.6, 0.3, 0.1), 0.0), ..Pivot::point(at(3.0, -0.6)) },
            Pivot { cone: cone(Vec3::NEG_Y, -0.5), ..Pivot::point(at(3.0, 0.6)) },
        ]
    }

    #[test]
    fn densities_are_those_of_the_samples_by_chi_square() {
        for (i, pivot) in pivots().iter().enumerate() {
            for g in [-0.5, 0.0, 0.85] {
                let s = segment(0.5, 6.5);
                let d = EquiAngular::new(&s, pivot, g).unwrap();
                let [from, to] = pivot.clipped(&s).unwrap();
                // Bins of equal probability by summing the density finely; no sample lies elsewhere.
                let steps = 60_000;
                let width = (to - from) as f64 / steps as f64;
                let at = |k: usize| (from as f64 + (k as f64 + 0.5) * width) as f32;
                let mut cumulative = vec![0.0f64];
                for k in 0..steps {
                    cumulative.push(cumulative[k] + d.density(at(k)) as f64 * width);
                }
                let whole = cumulative[steps];
                assert!((whole - 1.0).abs() < 2e-3, "light {i}, g {g}: the density adds up to {whole}");
                let n = 20_000;
                let mut bins = [0.0f64; 20];
                for j in 0..n {
                    let t = d.sample(to_unit(mix(j * 31 + i as u32)));
                    assert!((from..=to).contains(&t) && d.density(t) > 0.0);
                    let place = (t as f64 - from as f64) / width;
                    let k = (place as usize).min(steps - 1);
                    let below = cumulative[k] + (cumulative[k + 1] - cumulative[k]) * (place - k as f64);
                    bins[((below / whole * 20.0) as usize).min(19)] += 1.0;
                }
                let expected = n as f64 / 20.0;
                let chi2: f64 = bins.iter().map(|b| (b - expected).powi(2) / expected).sum();
                // The 99.9999 % quantile at 19 degrees of freedom is 66.
                assert!(chi2 < 66.0, "light {i}, g {g}: χ² {chi2}, {bins:?}");
            }
        }
    }

    #[test]
    fn endless_segments_are_sampled_to_their_end() {
        let s = segment(0.0, f32::INFINITY);
        for pivot in pivots() {
            let Some(d) = EquiAngular::new(&s, &pivot, 0.5) else { continue };
            for i in 0..1000 {
                let t = d.sample((i as f32 + 0.5) / 1000.0);
                assert!(t.is_finite() && d.density(t) > 0.0, "{pivot:?}: {t}");
            }
        }
    }

    #[test]
    fn cones_hold_what_the_light_sees() {
        // Points of the segment, one by one, against the cone's own definition.
        for pivot in pivots() {
            let Some((axis, cos)) = pivot.cone.filter(|c| c.1 >= 0.0) else { continue };
            for s in [segment(0.5, 6.5), Segment { direction: Vec3::new(0.0, 1.0, 0.0), ..segment(0.0, 9.0) }] {
                let range = pivot.clipped(&s);
                for k in 0..1000 {
                    let t = s.near + (k as f32 + 0.5) / 1000.0 * (s.far - s.near);
                    let to = (s.origin + s.direction * t - pivot.position).normalize();
                    let off = to.dot(axis) - cos;
                    let held = range.is_some_and(|[a, b]| (a..=b).contains(&t));
                    assert!(off.abs() < 1e-4 || held == (off > 0.0), "{pivot:?} at {t}: {off}, {range:?}");
                }
            }
        }
    }

    #[test]
    fn the_angle_of_a_segment_is_that_between_its_ends() {
        for pivot in pivots().into_iter().filter(|p| p.radius2 == 0.0) {
            for (near, far) in [(0.5, 6.5), (0.0, 0.01), (2.0, f32::INFINITY)] {
                let s = segment(near, far);
                let to = |t: f32| {
                    (s.origin.as_dvec3() + s.direction.as_dvec3() * f64::from(t) - pivot.position.as_dvec3()).normalize()
                };
                let end = if far.is_finite() { to(far) } else { s.direction.as_dvec3() };
                let expected = to(near).cross(end).length().atan2(to(near).dot(end));
                let found = f64::from(pivot.angle(&s, f32::INFINITY));
                assert!((found - expected).abs() < 1e-3 * expected + 1e-5, "{pivot:?}: {found} {expected}");
            }
        }
    }
}
