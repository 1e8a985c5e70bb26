//! Patterns and pictures put together: a graph of textures.

use super::Texture;
use super::levels::Footprint;
use super::lookup::Lookup;
use crate::noise;
use glam::{Affine3A, Vec2, Vec3};
use std::f32::consts::{PI, TAU};
use std::sync::Arc;

/// A picture made of others: linear sRGB, or the same number three times.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Graph {
    /// The same everywhere.
    Constant(Vec3),
    /// An image times a factor.
    Image {
        /// The image.
        texture: Texture,
        /// Multiplies it.
        scale: f32,
        /// Whether what is bright becomes dark.
        invert: bool,
        /// Weights of colours and of alpha where it stands for a number.
        as_number: Option<[Vec3; 2]>,
        /// Coordinates (v up) made of the place in space instead of the mesh's.
        mapping: Option<Mapping>,
    },
    /// One times the other.
    Scale(Arc<Graph>, Arc<Graph>),
    /// From the first to the second by an amount.
    Mix(Arc<Graph>, Arc<Graph>, Arc<Graph>),
    /// By how a surface faces: the one where its normal lies along a direction, the other where it is perpendicular to it, by the cosine between.
    DirectionMix {
        /// Where the normal lies along the direction, either way.
        along: Arc<Graph>,
        /// Where it is perpendicular to it.
        across: Arc<Graph>,
        /// In the world, of length 1.
        direction: Vec3,
    },
    /// To a power.
    Power(Arc<Graph>, f32),
    /// Squares of the texture coordinates.
    Checkerboard {
        /// Coordinates.
        place: Mapping,
        /// Where the sum of whole coordinates is even.
        even: Arc<Graph>,
        /// Elsewhere.
        odd: Arc<Graph>,
    },
    /// Between four corners: (0, 0), (0, 1), (1, 0), (1, 1).
    Bilinear {
        /// Coordinates.
        place: Mapping,
        /// Values there.
        corners: [Vec3; 4],
    },
    /// Dots strewn over the texture coordinates.
    Dots {
        /// Coordinates.
        place: Mapping,
        /// In the dots.
        inside: Arc<Graph>,
        /// Around them.
        outside: Arc<Graph>,
    },
    /// Cubes in space.
    Cubes {
        /// The texture's space from the world's.
        texture_from_world: Affine3A,
        /// Where the sum of whole coordinates is even.
        even: Arc<Graph>,
        /// Elsewhere.
        odd: Arc<Graph>,
    },
    /// A pattern of noise in space.
    Noise {
        /// The texture's space from the world's.
        texture_from_world: Affine3A,
        /// Which.
        pattern: NoisePattern,
    },
}

/// Patterns of [`crate::noise`].
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum NoisePattern {
    /// Octaves, and how much weaker each is than the one before.
    Fbm(u32, f32),
    /// The same of its magnitude.
    Wrinkled(u32, f32),
    /// Waves raised by gusts.
    Windy,
    /// Octaves, roughness, and how much they bend the veins.
    Marble(u32, f32, f32),
}

/// Two coordinates of a picture.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Mapping {
    /// Factor and offset of the mesh's own.
    Uv([[f32; 2]; 2]),
    /// Angle from z and around it, as fractions of a half and a whole turn.
    Spherical(Affine3A),
    /// Around z as a fraction of a turn, and along it.
    Cylindrical(Affine3A),
    /// Lengths along two vectors of the texture's space, and offsets.
    Planar(Affine3A, [Vec3; 2], Vec2),
}

impl Mapping {
    fn at(&self, &Lookup { uv, point, .. }: &Lookup) -> Vec2 {
        match self {
            Mapping::Uv([u, v]) => Vec2::new(u[0] * uv[0].x + u[1], v[0] * uv[0].y + v[1]),
            Mapping::Spherical(place) => {
                let p = place.transform_point3(point);
                Vec2::new(p.x.hypot(p.y).atan2(p.z) / PI, p.y.atan2(p.x).rem_euclid(TAU) / TAU)
            }
            Mapping::Cylindrical(place) => {
                let p = place.transform_point3(point);
                Vec2::new((PI + p.y.atan2(p.x)) / TAU, p.z)
            }
            Mapping::Planar(place, [s, t], offset) => {
                let p = place.transform_point3(point);
                Vec2::new(p.dot(*s), p.dot(*t)) + *offset
            }
        }
    }

    /// The footprint in its coordinates; none where they are made of the place in space.
    fn footprint(&self, there: &Lookup) -> Option<Footprint> {
        match (self, &there.footprint) {
            (Mapping::Uv([u, v]), Some(footprint)) => Some(footprint.scaled(Vec2::new(u[0], v[0]))),
            _ => None,
        }
    }

    fn is_in_space(&self) -> bool {
        !matches!(self, Mapping::Uv(_))
    }
}

impl Graph {
    /// The value, where it is the same everywhere.
    pub fn constant(&self) -> Option<Vec3> {
        match self {
            Graph::Constant(c) => Some(*c),
            _ => None,
        }
    }

    /// How many nodes it has, one that is used twice counted twice: what one value costs at most. At least 1.
    pub fn lookups(&self) -> usize {
        1 + match self {
            Graph::Constant(_) | Graph::Image { .. } | Graph::Bilinear { .. } | Graph::Noise { .. } => 0,
            Graph::Power(a, _) => a.lookups(),
            Graph::Scale(a, b) | Graph::DirectionMix { along: a, across: b, .. } => a.lookups() + b.lookups(),
            Graph::Checkerboard { even: a, odd: b, .. }
            | Graph::Cubes { even: a, odd: b, .. }
            | Graph::Dots { inside: a, outside: b, .. } => a.lookups() + b.lookups(),
            Graph::Mix(a, b, amount) => a.lookups() + b.lookups() + amount.lookups(),
        }
    }

    /// Whether it asks where in space a point is or how the surface lies.
    pub fn is_in_space(&self) -> bool {
        match self {
            Graph::Constant(_) => false,
            Graph::Noise { .. } | Graph::Cubes { .. } | Graph::DirectionMix { .. } => true,
            Graph::Image { mapping, .. } => mapping.is_some_and(|m| m.is_in_space()),
            Graph::Bilinear { place, .. } => place.is_in_space(),
            Graph::Power(a, _) => a.is_in_space(),
            Graph::Scale(a, b) => a.is_in_space() || b.is_in_space(),
            Graph::Checkerboard { place, even: a, odd: b } | Graph::Dots { place, inside: a, outside: b } => {
                place.is_in_space() || a.is_in_space() || b.is_in_space()
            }
            Graph::Mix(a, b, amount) => a.is_in_space() || b.is_in_space() || amount.is_in_space(),
        }
    }

    /// Tells the pictures in it that are looked up by the mesh's coordinates, and the larger factor on these.
    pub(crate) fn each_texture(&self, tell: &mut dyn FnMut(&Texture, f32)) {
        match self {
            Graph::Constant(_) | Graph::Bilinear { .. } | Graph::Noise { .. } => {}
            Graph::Image { texture, mapping: None, .. } => tell(texture, 1.0),
            Graph::Image { texture, mapping: Some(Mapping::Uv([u, v])), .. } => tell(texture, u[0].abs().max(v[0].abs())),
            Graph::Image { .. } | Graph::Power(..) => {}
            Graph::Scale(a, b)
            | Graph::DirectionMix { along: a, across: b, .. }
            | Graph::Checkerboard { even: a, odd: b, .. }
            | Graph::Cubes { even: a, odd: b, .. }
            | Graph::Dots { inside: a, outside: b, .. } => [a, b].into_iter().for_each(|g| g.each_texture(tell)),
            Graph::Mix(a, b, amount) => [a, b, amount].into_iter().for_each(|g| g.each_texture(tell)),
        }
    }

    /// Size of a texel of its finest picture, in texture coordinates; 0 without one.
    pub fn texel(&self) -> f32 {
        let finest = |a: f32, b: f32| if a == 0.0 || (b > 0.0 && b < a) { b } else { a };
        match self {
            Graph::Constant(_) | Graph::Bilinear { .. } | Graph::Noise { .. } => 0.0,
            Graph::Image { texture, mapping: None, .. } => texture.texel_size(),
            // Coordinates of its own, of another size.
            Graph::Image { .. } => 0.0,
            Graph::Power(a, _) => a.texel(),
            Graph::Scale(a, b) | Graph::DirectionMix { along: a, across: b, .. } => finest(a.texel(), b.texel()),
            Graph::Checkerboard { even: a, odd: b, .. }
            | Graph::Cubes { even: a, odd: b, .. }
            | Graph::Dots { inside: a, outside: b, .. } => finest(a.texel(), b.texel()),
            Graph::Mix(a, b, amount) => finest(finest(a.texel(), b.texel()), amount.texel()),
        }
    }

    /// The value there: linear RGB, or a number three times.
    pub fn at(&self, there: &Lookup) -> Vec3 {
        match self {
            Graph::Constant(c) => *c,
            Graph::Image { texture, scale, invert, as_number, mapping } => {
                let texel = match mapping {
                    None => texture.filtered(&there.uv, there.footprint.as_ref()),
                    Some(m) => texture.filtered(&[m.at(there); 2], m.footprint(there).as_ref()),
                };
                let value = match as_number {
                    None => texel.truncate(),
                    Some([colors, alpha]) => Vec3::splat(texel.truncate().dot(*colors)) + *alpha * texel.w,
                } * *scale;
                if *invert { (1.0 - value).max(Vec3::ZERO) } else { value }
            }
            Graph::Scale(a, b) => a.at(there) * b.at(there),
            Graph::Mix(a, b, amount) => {
                let t = amount.at(there);
                a.at(there) * (1.0 - t) + b.at(there) * t
            }
            Graph::DirectionMix { along, across, direction } => {
                let t = there.normal.dot(*direction).abs().min(1.0);
                along.at(there) * t + across.at(there) * (1.0 - t)
            }
            // The mean of a power is not the power of a mean.
            Graph::Power(a, exponent) => a.at(&there.point_alone()).max(Vec3::ZERO).powf(*exponent),
            Graph::Checkerboard { place, even, odd } => {
                let p = place.at(there).floor();
                if (p.x + p.y).rem_euclid(2.0) < 0.5 { even.at(there) } else { odd.at(there) }
            }
            Graph::Cubes { texture_from_world, even, odd } => {
                let p = texture_from_world.transform_point3(there.point).floor();
                if (p.x + p.y + p.z).rem_euclid(2.0) < 0.5 { even.at(there) } else { odd.at(there) }
            }
            Graph::Dots { place, inside, outside } => {
                let p = place.at(there);
                if noise::dotted(p.x, p.y) { inside.at(there) } else { outside.at(there) }
            }
            Graph::Bilinear { place, corners: [a, b, c, d] } => {
                let p = place.at(there);
                a.lerp(*b, p.y).lerp(c.lerp(*d, p.y), p.x)
            }
            Graph::Noise { texture_from_world, pattern } => {
                let p = texture_from_world.transform_point3(there.point);
                match *pattern {
                    NoisePattern::Fbm(octaves, roughness) => Vec3::splat(noise::fbm(p, roughness, octaves)),
                    NoisePattern::Wrinkled(octaves, roughness) => Vec3::splat(noise::wrinkled(p, roughness, octaves)),
                    NoisePattern::Windy => Vec3::splat(noise::windy(p)),
                    NoisePattern::Marble(octaves, roughness, variation) => noise::marble(p, roughness, octaves, variation),
                }
            }
        }
    }
}
