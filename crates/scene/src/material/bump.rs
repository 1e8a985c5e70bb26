//! Bumps: heights on a surface that turn its shading normal, its shape left as it is.
//!
//! Sources: J. Blinn 1978, "Simulation of Wrinkled Surfaces"; PBR 4ed §10.5.3; the gradient on the surface instead of its two derivatives as
//! M. Mikkelsen 2010, "Bump Mapping Unparametrized Surfaces on the GPU". Slopes are differences over a step as small as a pixel sees it, but no
//! smaller than a texel. Limits: outlines and shadows stay those of the smooth surface; the change of the normal with the place is left out beside
//! the height, as Blinn does.

use super::inputs::inputs_struct;
use crate::shape::{Detail, Surface};
use crate::texture::{Lookup, Scalar};
use diopter_light::sampling;
use glam::{Vec2, Vec3};

/// A step across a surface, per distance along the ray.
const STEP: f32 = 5e-4;

/// Heights on a surface.
#[derive(Clone, Debug)]
pub struct Bump {
    /// Height along the outer normal.
    pub height: Scalar,
    /// What a height of 1 is.
    pub unit: BumpUnit,
}

inputs_struct!(Bump { height } without { unit });

/// Units of heights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BumpUnit {
    /// A length, m: pbrt's displacement.
    Length(f32),
    /// A fraction of the length over which the texture coordinates grow by 1: files that have pictures of bumps and no unit.
    Extent(f32),
}

impl Bump {
    /// The shading unit normal where there are these bumps, on the side of `surface.ns`.
    pub fn normal(&self, surface: &Surface) -> Vec3 {
        let n = surface.ng;
        let texel = self.height.texel();
        // Two directions on the surface (m) and how the coordinates grow along them.
        let ([a, b], uv) = match surface.detail {
            Detail::Derivatives(derivatives) => (derivatives, [Vec2::X, Vec2::Y]),
            // Without coordinates only patterns in space differ from place to place.
            _ => (<[Vec3; 2]>::from(sampling::frame(n)), [Vec2::ZERO; 2]),
        };
        let area = n.dot(a.cross(b));
        let lengths = [a.length(), b.length()];
        if !(area.abs() > 1e-6 * lengths[0] * lengths[1]) {
            return surface.ns;
        }
        let unit = match self.unit {
            BumpUnit::Length(metres) => metres,
            BumpUnit::Extent(fraction) => fraction * area.abs().sqrt(),
        };
        // Rounding of the place must not be seen as a slope.
        let least = 1e-4 * surface.point.abs().max_element().max(1e-6);
        let slope = |along: Vec3, length: f32, uv: Vec2| {
            let mut step = (STEP * surface.t).max(least) / length;
            if uv != Vec2::ZERO {
                step = step.max(texel);
            }
            let at = |s: f32| {
                let uv = surface.uv.map(|p| p + uv * s);
                self.height.lookup(&Lookup { uv, point: surface.point + along * s, normal: surface.ng, footprint: None })
            };
            unit * (at(step) - at(-step)) / (2.0 * step)
        };
        let (du, dv) = (slope(a, lengths[0], uv[0]), slope(b, lengths[1], uv[1]));
        // ∇h = (h_u (b × n) + h_v (n × a)) / (n · (a × b)), seen from the shading normal.
        let gradient = (b.cross(n) * du + n.cross(a) * dv) / area;
        let gradient = gradient - surface.ns * surface.ns.dot(gradient);
        (surface.ns - gradient).try_normalize().filter(|n| n.is_finite()).unwrap_or(surface.ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::texture::{Codes, Graph, Image, Interpolation, Texture, Wrap};
    use glam::{Affine2, Affine3A, Vec4};
    use std::sync::Arc;

    /// A level place at z = 0 whose coordinates grow by 1 over 2 m along x and over 3 m along y.
    fn level(derivatives: Option<[Vec3; 2]>) -> Surface {
        Surface {
            point: Vec3::new(0.3, 0.6, 0.0),
            t: 2.0,
            ng: Vec3::Z,
            ns: Vec3::Z,
            tangent: Vec3::X,
            handedness: 1.0,
            uv: [Vec2::new(0.5, 0.25); 2],
            color: Vec4::ONE,
            object: 0,
            triangle: 0,
            reach: 1.0,
            detail: derivatives.map_or(Detail::None, Detail::Derivatives),
        }
    }

    const DERIVATIVES: [Vec3; 2] = [Vec3::new(2.0, 0.0, 0.0), Vec3::new(0.0, 3.0, 0.0)];

    /// A height that grows with the coordinates: 0.4 u + 0.3 v.
    fn ramp() -> Scalar {
        let place = crate::texture::Mapping::Uv([[1.0, 0.0], [1.0, 0.0]]);
        let corners = [0.0, 0.3, 0.4, 0.7].map(Vec3::splat);
        Scalar::Graph(Arc::new(Graph::Bilinear { place, corners }))
    }

    #[test]
    fn a_ramp_turns_the_normal_by_its_slope() {
        let bump = Bump { height: ramp(), unit: BumpUnit::Length(1.0) };
        // Slopes: 0.4 over 2 m, 0.3 over 3 m.
        let expected = Vec3::new(-0.2, -0.1, 1.0).normalize();
        let found = bump.normal(&level(Some(DERIVATIVES)));
        assert!(found.abs_diff_eq(expected, 1e-4), "{found}");
        // Coordinates of the other hand, and ones that are not at right angles.
        let swapped = bump.normal(&level(Some([Vec3::new(0.0, 2.0, 0.0), Vec3::new(3.0, 0.0, 0.0)])));
        assert!(swapped.abs_diff_eq(Vec3::new(-0.1, -0.2, 1.0).normalize(), 1e-4), "{swapped}");
        let skewed = bump.normal(&level(Some([Vec3::new(2.0, 0.0, 0.0), Vec3::new(2.0, 3.0, 0.0)])));
        // h = 0.2 x + c y with 0.3 = 0.2 · 2 + 3 c.
        assert!(skewed.abs_diff_eq(Vec3::new(-0.2, 0.1 / 3.0, 1.0).normalize(), 1e-4), "{skewed}");
        // Seen from inside, the outer normal of a closed body points the other way: heights go with it.
        let below = Surface { ng: Vec3::NEG_Z, ns: Vec3::NEG_Z, ..level(Some(DERIVATIVES)) };
        assert!(bump.normal(&below).abs_diff_eq(Vec3::new(-0.2, -0.1, -1.0).normalize(), 1e-4));
    }

    #[test]
    fn patterns_in_space_need_no_coordinates() {
        // Planar coordinates: x along v1.
        let place = crate::texture::Mapping::Planar(Affine3A::IDENTITY, [Vec3::X, Vec3::Y], Vec2::ZERO);
        let corners = [0.0, 0.3, 0.4, 0.7].map(Vec3::splat);
        let height = Scalar::Graph(Arc::new(Graph::Bilinear { place, corners }));
        let bump = Bump { height, unit: BumpUnit::Length(0.5) };
        let expected = Vec3::new(-0.2, -0.15, 1.0).normalize();
        for derivatives in [None, Some(DERIVATIVES)] {
            let found = bump.normal(&level(derivatives));
            assert!(found.abs_diff_eq(expected, 1e-3), "{found}");
        }
        // One that does depend on coordinates says nothing without them; nor does an even one.
        let flat = Bump { height: ramp(), unit: BumpUnit::Length(1.0) };
        assert_eq!(flat.normal(&level(None)), Vec3::Z);
        let even = Bump { height: Scalar::Constant(5.0), unit: BumpUnit::Length(1.0) };
        assert_eq!(even.normal(&level(Some(DERIVATIVES))), Vec3::Z);
    }

    #[test]
    fn steps_of_pictures_are_not_smaller_than_texels() {
        // Four texels from black to white; between them the slope is even, whatever the step.
        let pixels = [0u8, 85, 170, 255].map(|v| [v, v, v, 255]).to_vec();
        let texture = Texture {
            image: Arc::new(Image::new(4, 1, pixels)),
            codes: Codes::Linear,
            wrap: [Wrap::Clamp; 2],
            interpolation: Interpolation::Nearest,
            uv_set: 0,
            image_from_uv: Affine2::IDENTITY,
        };
        let height = Scalar::Textured { factor: 1.0, texture, channel: 0 };
        assert_eq!(height.texel(), 0.25);
        let bump = Bump { height, unit: BumpUnit::Extent(0.5) };
        // Half of √6 m high, by 1/3 over a quarter of 2 m; nearest texels make steps that only the texel's size sees as a slope.
        let slope = 0.5 * 6f32.sqrt() * (1.0 / 3.0) / 0.5;
        let found = bump.normal(&level(Some(DERIVATIVES)));
        assert!(found.abs_diff_eq(Vec3::new(-slope, 0.0, 1.0).normalize(), 1e-3), "{found} {slope}");
    }
}
