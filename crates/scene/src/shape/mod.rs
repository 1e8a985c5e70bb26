//! Shapes and what a ray learns where it meets one.

pub mod curves;
pub mod mesh;
pub mod quad;
pub mod sphere;
pub mod splats;

pub use curves::{CurveBasis, CurveKind, Curves, Strand};
pub use mesh::Mesh;
pub use quad::Quad;
pub use sphere::Sphere;
pub use splats::{ColorCurve, Splat, Splats};

use crate::texture::levels::Footprint;
use crate::texture::lookup::Lookup;
use glam::{Vec2, Vec3, Vec4};

/// A point of a surface, in world space.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// Where, m.
    pub point: Vec3,
    /// Distance along the ray, m.
    pub t: f32,
    /// Geometric unit normal on the outside (the side from which corners run counter-clockwise).
    pub ng: Vec3,
    /// Shading unit normal on the same side.
    pub ns: Vec3,
    /// Direction in which the first texture coordinate grows; any length, may be 0.
    pub tangent: Vec3,
    /// +1 or −1: handedness of the tangent frame (glTF).
    pub handedness: f32,
    /// Two sets of texture coordinates.
    pub uv: [Vec2; 2],
    /// Colour of the vertices, 1 without; of Gaussian splats the light they show along the ray, linear sRGB.
    pub color: Vec4,
    /// Number of the object.
    pub object: u32,
    /// Number of the triangle within its mesh, of the segment within its curves, or of the splat within its set; 0 for other shapes.
    pub triangle: u32,
    /// Greatest coordinate of the triangle, or of the other shape, in any direction, m: by it the rounding of `point` goes.
    pub reach: f32,
    /// What only some surfaces have.
    pub detail: Detail,
}

/// What only some surfaces have. In one place: a surface point fits into 128 bytes, which are copied in place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Detail {
    /// Nothing.
    None,
    /// How the place changes with the two texture coordinates, m: of surfaces that have coordinates, and bumps ([`crate::material::Bump`]) or pictures that
    /// are filtered.
    Derivatives([Vec3; 2]),
    /// What a ray with a width sees at once.
    Footprint(Footprint),
    /// The strand it belongs to, of curves.
    Strand(Strand),
}

/// Greatest coordinate of some places in any direction.
#[inline]
pub fn reach_of<const N: usize>(places: [Vec3; N]) -> f32 {
    places.map(Vec3::abs).into_iter().fold(Vec3::ZERO, Vec3::max).max_element()
}

/// Larger values are copied by calls: 2 % of a path's time on the Cornell box.
const _: () = assert!(size_of::<Option<Surface>>() <= 128);

impl Surface {
    /// Where its textures are looked up.
    #[inline]
    pub fn lookup(&self) -> Lookup {
        Lookup { uv: self.uv, point: self.point, normal: self.ng, footprint: self.footprint().copied() }
    }

    /// What a ray with a width sees of it at once, where that was asked for.
    #[inline]
    pub fn footprint(&self) -> Option<&Footprint> {
        match &self.detail {
            Detail::Footprint(footprint) => Some(footprint),
            _ => None,
        }
    }

    /// Whether it belongs to a curve.
    #[inline]
    pub fn is_strand(&self) -> bool {
        matches!(self.detail, Detail::Strand(_))
    }

    /// A start (m) for rays that leave the point along a unit direction, on the side that `normal` points to.
    #[inline]
    pub fn leave(&self, normal: Vec3, direction: Vec3) -> Vec3 {
        match &self.detail {
            Detail::Strand(strand) if strand.radius > 0.0 => strand.exit(self.point, self.tangent, direction),
            _ => self.beside(normal),
        }
    }

    /// A place beside it on the side of a unit normal, past what rounding can have moved it ([`offset_origin`]).
    #[inline]
    pub fn beside(&self, normal: Vec3) -> Vec3 {
        offset_origin(self.point, normal, self.reach)
    }
}

/// A start (m) for rays that leave a surface point (m) on the side of the unit vector `normal`, past what rounding can have moved the point; `reach`: of its triangle ([`Surface::reach`]).
///
/// Source: Wächter & Binder, "A Fast and Robust Method for Avoiding Self-Intersection", Ray Tracing Gems ch. 6 (2019); we take twice its step because points of instances
/// are rounded twice.
#[inline]
pub fn offset_origin(point: Vec3, normal: Vec3, reach: f32) -> Vec3 {
    const ORIGIN: f32 = 1.0 / 32.0;
    // Near the origin, m; less where the triangle is small.
    const FLOAT_SCALE: f32 = 2.0 / 65536.0;
    let float_scale = FLOAT_SCALE.min(2.0 * FLOAT_SCALE * reach);
    const INT_SCALE: f32 = 512.0;
    let component = |p: f32, n: f32| {
        if p.abs() < ORIGIN {
            p + float_scale * n
        } else {
            let steps = (INT_SCALE * n) as i32;
            f32::from_bits((p.to_bits() as i32 + if p < 0.0 { -steps } else { steps }) as u32)
        }
    };
    Vec3::new(component(point.x, normal.x), component(point.y, normal.y), component(point.z, normal.z))
}
