//! Bounding volume hierarchy: eight boxes a node, eight triangles a leaf block.
//!
//! `build` makes it of binary trees (`binary`), `collapse` widens them, `join` puts large ones together; `traverse` follows rays through it with our own SIMD code, `packet` many shadow rays at once. A hierarchy
//! holds triangles (copied into blocks, so that a hit touches no mesh memory) and *others*: things only their owner can
//! intersect (instances, spheres, quads), reached through [`Filter`]. Nothing outside this folder knows the layout.
//!
//! A hierarchy may move: it then holds every box and every corner at two moments, and a ray meets them where they are at its own
//! fraction of the way between (corners in a straight line, boxes that hold them all the while). Source: Glassner 1988, "Spacetime Ray
//! Tracing for Animation"; bounds lerped as in Wald et al. 2017, "OSPRay", and Embree.
//!
//! Triangles are tested watertight: no ray passes between two that share an edge (Woop, Benthin & Wald 2013, "Watertight
//! Ray/Triangle Intersection", JCGT 2(1)). Boxes are widened by the rounding error of their test (Ize 2013, JCGT 2(2)).

mod binary;
mod build;
mod collapse;
mod join;
pub mod packet;
mod traverse;

use glam::{Affine3A, Vec3};

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Least corner, m.
    pub min: Vec3,
    /// Greatest corner, m.
    pub max: Vec3,
}

impl Bounds {
    /// The box that holds nothing.
    pub const EMPTY: Bounds = Bounds { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// The box around points; the empty one without any.
    pub fn around(points: impl IntoIterator<Item = Vec3>) -> Self {
        points.into_iter().fold(Bounds::EMPTY, |b, p| Bounds { min: b.min.min(p), max: b.max.max(p) })
    }

    /// The box around both.
    pub fn union(self, other: Bounds) -> Self {
        Bounds { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Middle of the box, m; not a number for the empty one.
    pub fn center(&self) -> Vec3 {
        (self.min + self.max) * 0.5
    }

    /// Edge lengths, m; negative for the empty box.
    pub fn size(&self) -> Vec3 {
        self.max - self.min
    }

    /// Half the surface area, m²; 0 for the empty box.
    pub fn half_area(&self) -> f32 {
        let d = self.size().max(Vec3::ZERO);
        d.x * d.y + d.y * d.z + d.z * d.x
    }

    /// The eight corners: bits 0, 1 and 2 of the number say whether x, y and z are the greatest.
    pub fn corners(&self) -> [Vec3; 8] {
        let side = |low: f32, high: f32, high_one: bool| if high_one { high } else { low };
        std::array::from_fn(|i| {
            let (min, max) = (self.min, self.max);
            Vec3::new(side(min.x, max.x, i & 1 != 0), side(min.y, max.y, i & 2 != 0), side(min.z, max.z, i & 4 != 0))
        })
    }

    /// The box around this one when its space is placed, with room for the rounding of the transform.
    pub fn placed(&self, place: &Affine3A) -> Bounds {
        if self.is_empty() {
            return *self;
        }
        let around = Bounds::around(self.corners().map(|c| place.transform_point3(c)).into_iter().filter(|p| p.is_finite()));
        let pad = 1e-6 * around.max.abs().max(around.min.abs()).max_element();
        Bounds { min: around.min - pad, max: around.max + pad }
    }

    /// Whether nothing is inside.
    pub fn is_empty(&self) -> bool {
        self.min.cmpgt(self.max).any()
    }
}

/// What goes into a hierarchy.
#[non_exhaustive]
pub enum Primitive {
    /// A triangle by its corners and the number it is reported by; `filtered` asks [`Filter::accept`] about each hit.
    Triangle {
        /// Corners, m.
        corners: [Vec3; 3],
        /// Number in hits, below 2³¹.
        id: u32,
        /// Whether hits are passed to [`Filter::accept`].
        filtered: bool,
    },
    /// Something with a box, intersected by [`Filter::intersect_other`].
    Other {
        /// Box, m.
        bounds: Bounds,
        /// Number in hits.
        id: u32,
    },
}

/// A source of primitives that the builder may ask for in any order, from any thread.
pub trait Primitives: Sync {
    /// How many there are.
    fn len(&self) -> usize;
    /// The primitive at an index; of a moving one, at the beginning.
    fn get(&self, index: usize) -> Primitive;
    /// Its box, m; of a moving one, around both of its ends.
    fn bounds(&self, index: usize) -> Bounds {
        let open = self.get(index).bounds();
        if self.moves() { open.union(self.get_at_end(index).bounds()) } else { open }
    }
    /// Whether primitives move.
    fn moves(&self) -> bool {
        false
    }
    /// The same primitive at the end.
    fn get_at_end(&self, index: usize) -> Primitive {
        self.get(index)
    }
    /// Whether there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A triangle hit, or what [`Filter::intersect_other`] reports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance in units of the ray's direction.
    pub t: f32,
    /// Barycentric weight of the second corner (or a coordinate of the owner's).
    pub u: f32,
    /// Barycentric weight of the third corner (or a coordinate of the owner's).
    pub v: f32,
    /// Number of the triangle, or of the other.
    pub id: u32,
    /// Where its corners are kept ([`Bvh::corners`]); meaningless for others.
    pub slot: u32,
    /// Set by the owner when the hit is inside an instance: its number + 1.
    pub instance: u32,
}

/// The owner's say in a traversal.
pub trait Filter {
    /// Whether a hit on a filtered triangle counts (alpha cut-outs).
    fn accept(&self, id: u32, u: f32, v: f32) -> bool;
    /// The nearest hit on an other within `t_max`; `any` when the first found will do.
    fn intersect_other(&self, id: u32, t_max: f32, any: bool) -> Option<Hit>;
}

/// For hierarchies of plain triangles.
pub struct Opaque;

impl Filter for Opaque {
    fn accept(&self, _: u32, _: f32, _: f32) -> bool {
        true
    }
    fn intersect_other(&self, _: u32, _: f32, _: bool) -> Option<Hit> {
        None
    }
}

/// Eight child boxes, structure of arrays.
#[derive(Clone, Debug)]
#[repr(C, align(32))]
struct Node {
    /// min x, y, z, max x, y, z of each child; an absent child has an empty box.
    bounds: [[f32; 8]; 6],
    child: [Child; 8],
}

/// What a child is and where: two bits of kind, 30 of index.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Child(u32);

enum ChildKind {
    Node(usize),
    Block(usize),
    Other(u32),
}

impl Child {
    const ABSENT: Child = Child(u32::MAX);
    const LIMIT: usize = 1 << 30;

    fn node(index: usize) -> Self {
        assert!(index < Self::LIMIT, "{index} nodes");
        Child(index as u32)
    }
    fn block(index: usize) -> Self {
        assert!(index < Self::LIMIT, "{index} blocks");
        Child(1 << 30 | index as u32)
    }
    fn other(id: u32) -> Self {
        assert!((id as usize) < Self::LIMIT, "other number {id}");
        Child(2 << 30 | id)
    }
    #[inline(always)]
    fn kind(self) -> ChildKind {
        let index = self.0 & (Self::LIMIT as u32 - 1);
        match self.0 >> 30 {
            0 => ChildKind::Node(index as usize),
            1 => ChildKind::Block(index as usize),
            _ => ChildKind::Other(index),
        }
    }
}

/// Up to eight triangles, structure of arrays: five cache lines.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
struct Block {
    /// `[corner][axis][triangle]`; an absent triangle has all corners at 0.
    corners: [[[f32; 8]; 3]; 3],
    triangle: [Triangle; 8],
}

/// The number of a triangle, and in the highest bit whether it is passed to the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Triangle(u32);

impl Triangle {
    const ABSENT: Triangle = Triangle(u32::MAX);
    const FILTERED: u32 = 1 << 31;

    fn new(id: u32, filtered: bool) -> Self {
        assert!(id < Self::FILTERED, "triangle number {id}");
        Triangle(id | if filtered { Self::FILTERED } else { 0 })
    }
    #[inline(always)]
    fn id(self) -> u32 {
        self.0 & !Self::FILTERED
    }
    #[inline(always)]
    fn is_filtered(self) -> bool {
        self.0 & Self::FILTERED != 0
    }
}

/// The hierarchy.
#[derive(Clone, Debug, Default)]
pub struct Bvh {
    nodes: Vec<Node>,
    blocks: Vec<Block>,
    /// Where everything is at the end, of a hierarchy that moves.
    end: Option<End>,
}

/// Boxes and corners at the end of a motion, in the order of [`Bvh::nodes`] and [`Bvh::blocks`].
#[derive(Clone, Debug, Default)]
struct End {
    bounds: Vec<[[f32; 8]; 6]>,
    corners: Vec<[[[f32; 8]; 3]; 3]>,
}

impl Bvh {
    /// Corners of a hit triangle by its [`Hit::slot`], in the space of the hierarchy, m. Panics on a slot that is none.
    #[inline]
    pub fn corners(&self, slot: u32) -> [Vec3; 3] {
        let block = &self.blocks[slot as usize / 8];
        let lane = slot as usize % 8;
        std::array::from_fn(|c| Vec3::from_array(std::array::from_fn(|a| block.corners[c][a][lane])))
    }

    /// Corners of a hit triangle at a fraction (0 to 1) of the motion.
    #[inline]
    pub fn corners_at(&self, slot: u32, fraction: f32) -> [Vec3; 3] {
        let open = self.corners(slot);
        let Some(end) = &self.end else { return open };
        let (corners, lane) = (&end.corners[slot as usize / 8], slot as usize % 8);
        std::array::from_fn(|c| {
            let close = Vec3::from_array(std::array::from_fn(|a| corners[c][a][lane]));
            open[c] + (close - open[c]) * fraction
        })
    }

    /// The box around everything, wherever it moves; empty without primitives.
    pub fn bounds(&self) -> Bounds {
        let open = self.nodes.first().map_or(Bounds::EMPTY, |n| all(&n.bounds));
        let close = self.end.as_ref().and_then(|e| e.bounds.first()).map_or(Bounds::EMPTY, all);
        open.union(close)
    }

    /// Bytes of memory held.
    pub fn memory(&self) -> usize {
        let end = self.end.as_ref().map_or(0, |e| e.bounds.capacity() * 192 + e.corners.capacity() * 288);
        self.nodes.capacity() * size_of::<Node>() + self.blocks.capacity() * size_of::<Block>() + end
    }
}

/// The box around all children of a node.
fn all(bounds: &[[f32; 8]; 6]) -> Bounds {
    let corner = |c: usize, i: usize| Vec3::new(bounds[c][i], bounds[c + 1][i], bounds[c + 2][i]);
    (0..8).fold(Bounds::EMPTY, |b, i| b.union(Bounds { min: corner(0, i), max: corner(3, i) }))
}
