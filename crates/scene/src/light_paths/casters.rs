//! The bodies that throw caustics, and directions from a lamp towards them.
//!
//! Photons that miss every smooth body are of no use. The surfaces of such bodies ("caustic casters") are divided into a few dozen bounding
//! spheres, and photons are emitted only into the cones under which a lamp sees these: a wine glass in a hall gets all photons of the hall's
//! lamps. Cones overlap; the density of a direction is the sum over all cones that hold it, so the estimate has no bias, whatever is met
//! first. Source: projection maps, Jensen 2001, "Realistic Image Synthesis Using Photon Mapping", §5.3; cones as PBR 4ed §6.2.4.

use crate::bvh::Bounds;
use crate::material::microfacet::SMOOTH;
use crate::material::{Scattering, Transmission};
use crate::scene::{Scene, Shape};
use crate::texture::Scalar;
use diopter_light::sampling;
use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};
use std::ops::Range;

/// Most spheres: each photon asks all of them for their cones (about a microsecond).
pub(super) const MOST_PIECES: usize = 64;

/// Parts along each side that a parallelogram is divided into.
const QUAD_PARTS: u32 = 4;

/// A fraction of the surface of caustic casters, by a sphere that holds it.
#[derive(Clone, Copy, Debug)]
struct Piece {
    center: Vec3,
    radius: f32,
    /// Fraction of light that it passes on by specular scattering, roughly.
    strength: f32,
}

/// Smooth bodies of glass, smooth metals: where photons are sent.
#[derive(Clone, Debug)]
pub(super) struct Casters {
    pieces: Vec<Piece>,
    /// Of each object, whether it is one.
    objects: Vec<bool>,
}

/// Which way a lamp sends its light, as far as aiming needs to know.
#[derive(Clone, Copy, Debug)]
pub(super) enum Facing {
    /// Everywhere alike.
    All,
    /// By the cosine to a normal.
    Side(Vec3),
    /// By the cosine to a normal, on both sides.
    Both(Vec3),
    /// Within a half angle (rad) of an axis.
    Cone(Vec3, f32),
}

impl Facing {
    /// Largest factor on the lamp's light towards directions within a half angle (rad) of `axis`.
    fn bound(self, axis: Vec3, half_angle: f32) -> f32 {
        let angle = |n: Vec3| n.dot(axis).clamp(-1.0, 1.0).acos();
        let nearest = |a: f32| (a - half_angle).max(0.0).cos().max(0.0);
        match self {
            Facing::All => 1.0,
            Facing::Side(n) => nearest(angle(n)),
            Facing::Both(n) => nearest(angle(n).min(PI - angle(n))),
            Facing::Cone(n, reach) => f32::from(angle(n) <= half_angle + reach),
        }
    }
}

/// The cone under which a piece is seen.
#[derive(Clone, Copy, Default)]
struct Cone {
    axis: Vec3,
    /// sin² of the half angle; 1 and more from within the sphere: all directions.
    sin2: f32,
    solid_angle: f32,
    weight: f32,
}

impl Cone {
    fn of(piece: &Piece, p: Vec3, facing: Facing) -> Cone {
        let to = piece.center - p;
        let d2 = to.length_squared();
        let sin2 = piece.radius * piece.radius / d2;
        if !(sin2 < 1.0) {
            return Cone { axis: Vec3::Z, sin2: 1.0, solid_angle: 2.0 * TAU, weight: 2.0 * TAU * piece.strength };
        }
        let axis = to / d2.sqrt();
        // 1 − cos without cancellation: spheres can be small and far.
        let solid_angle = TAU * sin2 / (1.0 + (1.0 - sin2).sqrt());
        let bound = facing.bound(axis, sin2.sqrt().asin());
        Cone { axis, sin2, solid_angle, weight: solid_angle * piece.strength * bound }
    }

    fn holds(&self, direction: Vec3) -> bool {
        self.sin2 >= 1.0 || (self.axis.dot(direction) > 0.0 && self.axis.cross(direction).length_squared() <= self.sin2)
    }

    fn sample(&self, u: [f32; 2]) -> Vec3 {
        if self.sin2 >= 1.0 {
            return sampling::sphere(u);
        }
        let drop = u[0] * self.sin2 / (1.0 + (1.0 - self.sin2).sqrt());
        let (sin, phi) = ((drop * (2.0 - drop)).max(0.0).sqrt(), TAU * u[1]);
        let (x, y) = sampling::frame(self.axis);
        (x * (sin * phi.cos()) + y * (sin * phi.sin()) + self.axis * (1.0 - drop)).normalize()
    }
}

impl Casters {
    /// The casters of a scene as it is posed; `None` where there are none.
    pub fn new(scene: &Scene) -> Option<Casters> {
        let d = scene.description();
        let of_material: Vec<f32> = d.materials.iter().map(|m| strength(&m.scattering)).collect();
        let objects: Vec<bool> = d.objects.iter().map(|o| of_material[o.material as usize] > 0.0).collect();
        let (mut spheres, mut items) = (Vec::new(), Vec::new());
        for (number, object) in d.objects.iter().enumerate().filter(|(i, _)| objects[*i]) {
            let strength = of_material[object.material as usize];
            let mut push = |bounds: Bounds| {
                if !bounds.is_empty() && bounds.min.is_finite() && bounds.max.is_finite() {
                    items.push(Item { bounds, strength });
                }
            };
            if let Some(swept) = scene.swept_bounds(number as u32) {
                push(swept);
                continue;
            }
            match object.shape {
                Shape::Curves { curves, world_from_curves } => {
                    let set = &d.curves[curves as usize];
                    for segment in 0..set.segments.len() {
                        push(set.segment_bounds(segment).placed(&world_from_curves));
                    }
                }
                Shape::Splats { splats, world_from_splats } => {
                    push(d.splats[splats as usize].bounds().placed(&world_from_splats))
                }
                Shape::Sphere(s) => spheres.push(Piece { center: s.center, radius: s.radius, strength }),
                Shape::Quad(q) => {
                    let at = |i: u32, j: u32| q.point(Vec2::new(i as f32, j as f32) / QUAD_PARTS as f32);
                    for i in 0..QUAD_PARTS {
                        for j in 0..QUAD_PARTS {
                            push(Bounds::around([at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)]));
                        }
                    }
                }
                Shape::Mesh { mesh, world_from_mesh } => {
                    let mesh = &d.meshes[mesh as usize];
                    for t in 0..mesh.triangles.len() {
                        push(Bounds::around(mesh.corners(t).map(|c| world_from_mesh.transform_point3(c))));
                    }
                }
            }
        }
        // So many spheres that they are divided as everything else is.
        if spheres.len() > MOST_PIECES / 2 {
            let boxed = |s: &Piece| Bounds { min: s.center - s.radius, max: s.center + s.radius };
            items.extend(spheres.drain(..).map(|s| Item { bounds: boxed(&s), strength: s.strength }));
        }
        let mut pieces = spheres;
        let most = MOST_PIECES - pieces.len();
        pieces.extend(divided(items, most));
        // Room for the rounding of what is met.
        pieces.iter_mut().for_each(|p| p.radius = p.radius * 1.001 + 1e-6 * p.center.abs().max_element());
        (!pieces.is_empty()).then_some(Casters { pieces, objects })
    }

    /// Whether an object is one of them.
    #[inline]
    pub fn casts(&self, object: u32) -> bool {
        self.objects[object as usize]
    }

    /// The box around all of them.
    pub fn bounds(&self) -> Bounds {
        let one = |p: &Piece| Bounds { min: p.center - p.radius, max: p.center + p.radius };
        self.pieces.iter().fold(Bounds::EMPTY, |b, p| b.union(one(p)))
    }

    /// Distance (m) from a point to the nearest of them.
    pub fn distance(&self, p: Vec3) -> f32 {
        self.pieces.iter().map(|s| (s.center - p).length() - s.radius).fold(f32::INFINITY, f32::min).max(0.0)
    }

    fn cones(&self, p: Vec3, facing: Facing) -> ([Cone; MOST_PIECES], f32) {
        let mut cones = [Cone::default(); MOST_PIECES];
        let mut total = 0.0;
        for (cone, piece) in cones.iter_mut().zip(&self.pieces) {
            *cone = Cone::of(piece, p, facing);
            total += cone.weight;
        }
        (cones, total)
    }

    /// Sum over the pieces of solid angle × strength × the lamp's factor: what a lamp at a point sends to them, over its radiance or intensity.
    pub fn seen_from(&self, p: Vec3, facing: Facing) -> f32 {
        self.cones(p, facing).1
    }

    /// Σ cross-section × strength, m²: what parallel light of irradiance 1 sends to them.
    pub fn cross_section(&self) -> f32 {
        self.pieces.iter().map(|p| PI * p.radius * p.radius * p.strength).sum()
    }

    /// A direction from a point towards them, by a number for the choice and two for the place, and its density, 1/sr.
    pub fn sample_direction(&self, p: Vec3, facing: Facing, choice: f32, u: [f32; 2]) -> Option<(Vec3, f32)> {
        let (cones, total) = self.cones(p, facing);
        let cones = &cones[..self.pieces.len()];
        let chosen = pick(cones.iter().map(|c| c.weight), choice * total)?;
        let direction = cones[chosen].sample(u);
        // Rounding may put a direction outside the very cone it was drawn from.
        let density = |(i, c): (usize, &Cone)| if i == chosen || c.holds(direction) { c.weight / c.solid_angle } else { 0.0 };
        let pdf = cones.iter().enumerate().filter(|(_, c)| c.weight > 0.0).map(density).sum::<f32>() / total;
        (pdf > 0.0 && pdf.is_finite()).then_some((direction, pdf))
    }

    /// A point on a line along `direction` that meets them, drawn evenly over their cross-sections, and its density over the area that faces the
    /// direction, 1/m².
    pub fn sample_line(&self, direction: Vec3, choice: f32, u: [f32; 2]) -> Option<(Vec3, f32)> {
        let weight = |p: &Piece| p.radius * p.radius * p.strength;
        let total: f32 = self.pieces.iter().map(weight).sum();
        let chosen = pick(self.pieces.iter().map(weight), choice * total)?;
        let piece = &self.pieces[chosen];
        let (x, y) = sampling::frame(direction);
        let at = sampling::disk(u) * piece.radius;
        let point = piece.center + x * at.x + y * at.y;
        let density = |(i, p): (usize, &Piece)| {
            let to = point - p.center;
            let aside = to - direction * to.dot(direction);
            // weight / (π r²)
            if i == chosen || aside.length_squared() <= p.radius * p.radius { p.strength / PI } else { 0.0 }
        };
        let pdf = self.pieces.iter().enumerate().map(density).sum::<f32>() / total;
        (pdf > 0.0 && pdf.is_finite()).then_some((point, pdf))
    }
}

/// The entry of a list of weights in which a number below their sum lies; `None` where all are 0.
fn pick(weights: impl Iterator<Item = f32>, mut at: f32) -> Option<usize> {
    let mut last = None;
    for (i, weight) in weights.enumerate() {
        if weight > 0.0 {
            last = Some(i);
            if at < weight {
                break;
            }
            at -= weight;
        }
    }
    last
}

/// Fraction of light that a material passes on by specular scattering, roughly; 0 of what throws no caustics worth photons. The polish of
/// plastics and the reflections of thin panes stay with the path tracer.
fn strength(scattering: &Scattering) -> f32 {
    let smooth = |alpha: &Scalar| matches!(alpha, Scalar::Constant(a) if *a < SMOOTH);
    let smooth_root = |roughness: &Scalar| matches!(roughness, Scalar::Constant(r) if r * r < SMOOTH);
    match scattering {
        Scattering::Conductor(c) if smooth(&c.alpha) && c.across.as_ref().is_none_or(smooth) => 1.0,
        Scattering::Coated(c)
            if smooth_root(&c.roughness)
                && c.across.as_ref().is_none_or(smooth_root)
                && smooth(&c.metal.alpha)
                && c.metal.across.as_ref().is_none_or(smooth) =>
        {
            1.0
        }
        Scattering::Principled(p) if smooth_root(&p.roughness) && p.anisotropy.is_none() => {
            let metal = match p.metallic {
                Scalar::Constant(m) => m,
                _ => 0.5,
            };
            let glass = match (&p.kind, &p.transmission) {
                (Transmission::Thin, _) => 0.0,
                (Transmission::Solid, Scalar::Constant(t)) => *t,
                (Transmission::Solid, _) => 0.5,
            };
            let all = metal.max(glass);
            if all >= 0.2 { all.min(1.0) } else { 0.0 }
        }
        Scattering::Mix(mix) => mix.0.iter().map(strength).fold(0.0, f32::max) * 0.5,
        _ => 0.0,
    }
}

/// A part of a caster's surface.
struct Item {
    bounds: Bounds,
    strength: f32,
}

/// The sphere around some items.
fn around(items: &[Item]) -> Piece {
    let bounds = items.iter().fold(Bounds::EMPTY, |b, i| b.union(i.bounds));
    let strength = items.iter().map(|i| i.strength).fold(0.0, f32::max);
    Piece { center: bounds.center(), radius: 0.5 * bounds.size().length(), strength }
}

/// Spheres, no more than `most`, that hold all items: the largest is divided in the middle of its items, again and again.
fn divided(mut items: Vec<Item>, most: usize) -> Vec<Piece> {
    if items.is_empty() || most == 0 {
        return Vec::new();
    }
    let mut leaves: Vec<(Range<usize>, Piece)> = vec![(0..items.len(), around(&items))];
    while leaves.len() < most {
        let divisible = leaves.iter().enumerate().filter(|(_, (range, _))| range.len() > 1);
        let Some(i) = divisible.max_by(|a, b| a.1.1.radius.total_cmp(&b.1.1.radius)).map(|(i, _)| i) else { break };
        let range = leaves[i].0.clone();
        let part = &mut items[range.clone()];
        let middles = Bounds::around(part.iter().map(|i| i.bounds.center()));
        let size = middles.size();
        let axis = (0..3).max_by(|a, b| size[*a].total_cmp(&size[*b])).unwrap_or(0);
        let half = part.len() / 2;
        part.select_nth_unstable_by(half, |a, b| a.bounds.center()[axis].total_cmp(&b.bounds.center()[axis]));
        let (first, second) = (range.start..range.start + half, range.start + half..range.end);
        leaves[i] = (first.clone(), around(&items[first]));
        leaves.push((second.clone(), around(&items[second])));
    }
    leaves.into_iter().map(|(_, piece)| piece).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_light::random::{mix, to_unit};

    fn casters(pieces: Vec<Piece>) -> Casters {
        Casters { pieces, objects: Vec::new() }
    }

    fn uniform(i: u32, k: u32) -> f32 {
        to_unit(mix(i.wrapping_mul(11).wrapping_add(k)))
    }

    #[test]
    fn directions_have_the_density_they_claim() {
        // Overlapping cones, one seen from within: 1/pdf integrates to the solid angle of the union, here of all directions or of two cones.
        let far = |x: f32| Piece { center: Vec3::new(x, 0.0, 4.0), radius: 1.0, strength: 1.0 };
        let n = 100_000;
        let mean = |c: &Casters, facing: Facing| {
            let one = |i: u32| {
                let drawn = c.sample_direction(Vec3::ZERO, facing, uniform(i, 1), [uniform(i, 2), uniform(i, 3)]);
                drawn.map_or(0.0, |(_, pdf)| f64::from(1.0 / pdf))
            };
            (0..n).map(one).sum::<f64>() / f64::from(n)
        };
        let cap = f64::from(TAU) * (1.0 - (1.0 - 1.0 / 16.0f64).sqrt());
        let (same, apart) = (casters(vec![far(0.0), far(0.0)]), casters(vec![far(0.0), Piece { strength: 0.3, ..far(9.0) }]));
        assert!((mean(&same, Facing::All) / cap - 1.0).abs() < 1e-3, "{}", mean(&same, Facing::All));
        let other = f64::from(TAU) * (1.0 - (1.0 - 1.0 / 97.0f64).sqrt());
        // Standard error of the mean of two values: below 0.5 % at these chances.
        assert!((mean(&apart, Facing::All) / (cap + other) - 1.0).abs() < 0.02, "{}", mean(&apart, Facing::All));
        let within = casters(vec![Piece { center: Vec3::X, radius: 2.0, strength: 1.0 }, far(0.0)]);
        assert!((mean(&within, Facing::Side(Vec3::Z)) / (2.0 * f64::from(TAU)) - 1.0).abs() < 0.02);
        // What faces away gets nothing.
        assert_eq!(mean(&same, Facing::Side(Vec3::NEG_Z)), 0.0);
        assert_eq!(mean(&same, Facing::Cone(Vec3::NEG_Z, 1.0)), 0.0);
        assert!(mean(&same, Facing::Both(Vec3::NEG_Z)) > 0.0);
    }

    #[test]
    fn lines_have_the_density_they_claim() {
        let ball = |x: f32| Piece { center: Vec3::new(x, 0.3, 1.0), radius: 0.5, strength: 0.7 };
        let c = casters(vec![ball(0.0), ball(0.0), ball(5.0)]);
        let direction = Vec3::new(0.2, -1.0, 0.4).normalize();
        let n = 100_000;
        let one = |i: u32| {
            let (_, pdf) = c.sample_line(direction, uniform(i, 1), [uniform(i, 2), uniform(i, 3)]).unwrap();
            f64::from(1.0 / pdf)
        };
        let area = (0..n).map(one).sum::<f64>() / f64::from(n);
        let expected = 2.0 * std::f64::consts::PI * 0.25;
        assert!((area / expected - 1.0).abs() < 0.01, "{area} {expected}");
    }

    #[test]
    fn spheres_hold_all_that_they_stand_for() {
        let item = |i: u32| {
            let p = Vec3::new(uniform(i, 1), uniform(i, 2), 0.1 * uniform(i, 3));
            Item { bounds: Bounds { min: p, max: p + 0.01 }, strength: 1.0 }
        };
        let corners: Vec<Vec3> = (0..3000).flat_map(|i| item(i).bounds.corners()).collect();
        let pieces = divided((0..3000).map(item).collect(), 40);
        assert_eq!(pieces.len(), 40);
        assert!(corners.iter().all(|p| pieces.iter().any(|s| (*p - s.center).length() <= s.radius * 1.0001)));
        // A flat body is covered by small spheres, not by one around all of it.
        assert!(pieces.iter().all(|p| p.radius < 0.25), "{pieces:?}");
        assert_eq!(divided((0..3).map(item).collect(), 40).len(), 3);
    }
}
