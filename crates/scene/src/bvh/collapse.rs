//! Collapsing: a binary tree becomes eight-wide nodes and leaf blocks.

use super::binary::BinaryBuilder;
use super::{Block, Bounds, Bvh, Child, Node, Primitive, Primitives, Triangle};
use glam::Vec3;
use obvhs::bvh2::Bvh2;
use std::collections::BinaryHeap;

/// Coordinate of boxes that nothing meets, m.
const NOWHERE: f32 = 1e30;

/// Turns a binary tree into eight-wide nodes and leaf blocks.
pub(super) struct Collapse<'a, P> {
    primitives: &'a P,
    indices: &'a [u32],
    tree: &'a Bvh2,
    /// Primitives below each node, capped at 9; more than 8 also where an other is among them.
    weight: Vec<u8>,
    /// Boxes of each node at the two ends of the motion, where there is one.
    ends: Vec<[Bounds; 2]>,
    bvh: Bvh,
    parts: Vec<Part>,
}

/// Parts of a hierarchy that something is to hold together.
#[derive(Default)]
pub(super) struct Parts {
    pub bvh: Bvh,
    pub parts: Vec<Part>,
}

/// A part of a hierarchy.
#[derive(Clone, Copy)]
pub(super) enum Part {
    /// What to follow, and its box at the two ends of the motion; the same twice where nothing moves.
    Below(Child, [Bounds; 2]),
    /// A primitive that stands alone, by its index.
    Primitive(u32),
}

/// The hierarchy of primitives that are not split into chunks.
pub(super) fn collapse_whole(primitives: &impl Primitives, indices: &[u32]) -> Bvh {
    let mut builder = BinaryBuilder::default();
    Collapse::new(primitives, indices, builder.build(primitives, indices), Parts::default()).into_whole()
}

impl<'a, P: Primitives> Collapse<'a, P> {
    /// The last argument is empty: its memory is used again.
    pub fn new(primitives: &'a P, indices: &'a [u32], tree: &'a Bvh2, Parts { mut bvh, parts }: Parts) -> Self {
        let weight = vec![0; tree.nodes.len()];
        // Blocks hold five triangles or more on average: growing would copy.
        bvh.nodes.reserve(indices.len() / 16 + 1);
        bvh.blocks.reserve(indices.len() / 4 + 1);
        let mut ends = Vec::new();
        if primitives.moves() {
            bvh.end.get_or_insert_default();
            ends = vec![[Bounds::EMPTY; 2]; tree.nodes.len()];
        }
        let mut collapse = Collapse { primitives, indices, tree, weight, ends, bvh, parts };
        collapse.weigh();
        collapse
    }

    fn index(&self, leaf: usize) -> usize {
        let index = self.tree.primitive_indices[self.tree.nodes[leaf].first_index as usize];
        self.indices[index as usize] as usize
    }

    fn primitive(&self, leaf: usize) -> Primitive {
        self.primitives.get(self.index(leaf))
    }

    fn is_other(&self, node: usize) -> bool {
        self.tree.nodes[node].is_leaf() && matches!(self.primitive(node), Primitive::Other { .. })
    }

    /// Fills `weight` and `ends`, children before parents, without recursion (trees can be deep).
    fn weigh(&mut self) {
        let mut stack = vec![(0usize, false)];
        while let Some((node, children_done)) = stack.pop() {
            if self.tree.nodes[node].is_leaf() {
                self.weight[node] = 1;
                if !self.ends.is_empty() {
                    let index = self.index(node);
                    self.ends[node] = [self.primitives.get(index), self.primitives.get_at_end(index)].map(|p| padded(p.bounds()));
                }
                continue;
            }
            let child = self.tree.nodes[node].first_index as usize;
            if children_done {
                let alone = |n: usize| if self.is_other(n) { 9 } else { self.weight[n] };
                self.weight[node] = (alone(child) + alone(child + 1)).min(9);
                if !self.ends.is_empty() {
                    let (a, b) = (self.ends[child], self.ends[child + 1]);
                    self.ends[node] = [a[0].union(b[0]), a[1].union(b[1])];
                }
            } else {
                stack.extend([(node, true), (child, false), (child + 1, false)]);
            }
        }
    }

    fn bounds(&self, node: usize) -> Bounds {
        let b = self.tree.nodes[node].aabb();
        Bounds { min: b.min.into(), max: b.max.into() }
    }

    /// Boxes at the two ends; the same twice where nothing moves.
    fn both(&self, node: usize) -> [Bounds; 2] {
        self.ends.get(node).copied().unwrap_or_else(|| [self.bounds(node); 2])
    }

    /// The hierarchy of the whole tree. One that fits a block still gets a root node above it.
    pub fn into_whole(mut self) -> Bvh {
        let root = self.bvh.push_node();
        self.widen(vec![(0, root)]);
        self.bvh
    }

    /// The hierarchy of a tree in up to `most` parts, opened where they are largest.
    pub fn into_parts(mut self, most: usize) -> Parts {
        // Areas are not negative: their bits are ordered as they are.
        let mut open = BinaryHeap::from([(self.area(0).to_bits(), 0)]);
        while open.len() + self.parts.len() < most
            && let Some((_, largest)) = open.pop()
        {
            let node = &self.tree.nodes[largest];
            match node.is_leaf() {
                true => self.parts.push(Part::Primitive(self.index(largest) as u32)),
                false => open.extend([0, 1].map(|k| node.first_index as usize + k).map(|n| (self.area(n).to_bits(), n))),
            }
        }
        let mut work = Vec::new();
        for (_, node) in open.into_vec() {
            let below = Part::Below(self.child(node, &mut work), self.both(node));
            self.parts.push(below);
        }
        self.widen(work);
        Parts { bvh: self.bvh, parts: self.parts }
    }

    /// Whether a node does not fit a block.
    fn may_open(&self, node: usize) -> bool {
        !self.tree.nodes[node].is_leaf() && self.weight[node] > 8
    }

    fn area(&self, node: usize) -> f32 {
        self.bounds(node).half_area()
    }

    /// What a node of the binary tree becomes; a wide node that is yet to be filled is put among the work.
    fn child(&mut self, node: usize, work: &mut Vec<(usize, usize)>) -> Child {
        if self.is_other(node) {
            let Primitive::Other { id, .. } = self.primitive(node) else { unreachable!("checked above") };
            Child::other(id)
        } else if self.weight[node] <= 8 {
            Child::block(self.block(node))
        } else {
            let index = self.bvh.push_node();
            work.push((node, index));
            Child::node(index)
        }
    }

    /// Fills wide nodes, and those below, with what lies below nodes of the binary tree.
    fn widen(&mut self, mut work: Vec<(usize, usize)>) {
        while let Some((node, at)) = work.pop() {
            let (children, count) = if self.may_open(node) { self.open(node) } else { ([node; 8], 1) };
            let (mut wide, mut wide_end) = (Node::absent(), Node::absent());
            for (i, &child) in children[..count].iter().enumerate() {
                let to = self.child(child, &mut work);
                let [open, close] = self.both(child);
                wide.set(i, open, to);
                wide_end.set(i, close, to);
            }
            self.bvh.nodes[at] = wide;
            if let Some(end) = &mut self.bvh.end {
                end.bounds[at] = wide_end.bounds;
            }
        }
    }

    /// Up to eight descendants that cover a node, and how many: the largest is opened again and again.
    fn open(&self, node: usize) -> ([usize; 8], usize) {
        let mut children = [0; 8];
        // Of those that can be opened.
        let mut areas = [-1.0f32; 8];
        let area = |child: usize| if self.may_open(child) { self.area(child) } else { -1.0 };
        let first = self.tree.nodes[node].first_index as usize;
        (children[0], children[1]) = (first, first + 1);
        (areas[0], areas[1]) = (area(first), area(first + 1));
        let mut count = 2;
        while count < 8 {
            let mut largest = 0;
            for i in 1..count {
                if areas[i] >= areas[largest] {
                    largest = i;
                }
            }
            if areas[largest] < 0.0 {
                break;
            }
            let first = self.tree.nodes[children[largest]].first_index as usize;
            (children[largest], children[count]) = (first, first + 1);
            (areas[largest], areas[count]) = (area(first), area(first + 1));
            count += 1;
        }
        (children, count)
    }

    /// Gathers the triangles below a node into one block.
    fn block(&mut self, node: usize) -> usize {
        let mut block = Block { corners: [[[0.0; 8]; 3]; 3], triangle: [Triangle::ABSENT; 8] };
        let mut end = [[[0.0; 8]; 3]; 3];
        let mut lane = 0;
        // At most eight leaves: never more than eight wait.
        let mut stack = [node; 9];
        let mut waiting = 1;
        while waiting > 0 {
            waiting -= 1;
            let n = stack[waiting];
            if !self.tree.nodes[n].is_leaf() {
                let child = self.tree.nodes[n].first_index as usize;
                (stack[waiting], stack[waiting + 1]) = (child + 1, child);
                waiting += 2;
                continue;
            }
            let Primitive::Triangle { corners, id, filtered } = self.primitive(n) else { unreachable!("others stand alone") };
            let put = |to: &mut [[[f32; 8]; 3]; 3], corners: [Vec3; 3]| {
                for c in 0..3 {
                    for a in 0..3 {
                        to[c][a][lane] = corners[c][a];
                    }
                }
            };
            put(&mut block.corners, corners);
            if self.bvh.end.is_some()
                && let Primitive::Triangle { corners, .. } = self.primitives.get_at_end(self.index(n))
            {
                put(&mut end, corners);
            }
            block.triangle[lane] = Triangle::new(id, filtered);
            lane += 1;
        }
        self.bvh.blocks.push(block);
        if let Some(all) = &mut self.bvh.end {
            all.corners.push(end);
        }
        self.bvh.blocks.len() - 1
    }
}

impl Node {
    fn absent() -> Self {
        // Far out and inside out, but finite: what moves is interpolated.
        let mut bounds = [[NOWHERE; 8]; 6];
        bounds[3..].fill([-NOWHERE; 8]);
        Node { bounds, child: [Child::ABSENT; 8] }
    }

    fn set(&mut self, i: usize, b: Bounds, child: Child) {
        for a in 0..3 {
            self.bounds[a][i] = b.min[a];
            self.bounds[a + 3][i] = b.max[a];
        }
        self.child[i] = child;
    }
}

impl Bvh {
    /// Makes room for a node; its number.
    pub(super) fn push_node(&mut self) -> usize {
        self.nodes.push(Node::absent());
        if let Some(end) = &mut self.end {
            end.bounds.push(Node::absent().bounds);
        }
        self.nodes.len() - 1
    }

    pub(super) fn shrink_to_fit(&mut self) {
        self.nodes.shrink_to_fit();
        self.blocks.shrink_to_fit();
    }
}

impl Primitive {
    pub(super) fn bounds(&self) -> Bounds {
        match self {
            Primitive::Triangle { corners, .. } => Bounds::around(*corners),
            Primitive::Other { bounds, .. } => *bounds,
        }
    }
}

/// A box that stays around what it holds when it is interpolated in single precision.
fn padded(b: Bounds) -> Bounds {
    let pad = b.min.abs().max(b.max.abs()) * 4.0 * f32::EPSILON;
    Bounds { min: b.min - pad, max: b.max + pad }
}
