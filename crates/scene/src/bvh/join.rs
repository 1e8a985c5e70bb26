//! Joining: the chunks of a large set below one tree over their largest subtrees.

use super::collapse::{Part, Parts, collapse_whole};
use super::{Bounds, Bvh, Child, ChildKind, End, Primitive, Primitives};

/// The whole hierarchy while its chunks come.
pub(super) struct Joined<'a, P> {
    primitives: &'a P,
    /// Its first node is the root, filled at last.
    whole: Bvh,
    /// What the tree above is made of.
    parts: Vec<Part>,
}

impl<'a, P: Primitives> Joined<'a, P> {
    pub fn new(primitives: &'a P) -> Self {
        // Address space, not memory: blocks hold five triangles or more on average, and growing would copy.
        let (nodes, blocks) = (Vec::with_capacity(primitives.len() / 16), Vec::with_capacity(primitives.len() / 4));
        let whole = Bvh { nodes, blocks, end: primitives.moves().then(End::default) };
        let mut joined = Joined { primitives, whole, parts: Vec::new() };
        joined.whole.push_node();
        joined
    }

    /// Adds a chunk, and leaves it empty.
    pub fn add(&mut self, chunk: &mut Parts) {
        let (nodes, blocks) = (self.whole.nodes.len(), self.whole.blocks.len());
        let moved = |child: Child| match child {
            Child::ABSENT => child,
            child => match child.kind() {
                ChildKind::Node(i) => Child::node(i + nodes),
                ChildKind::Block(i) => Child::block(i + blocks),
                ChildKind::Other(_) => child,
            },
        };
        self.parts.extend(chunk.parts.drain(..).map(|part| match part {
            Part::Below(child, bounds) => Part::Below(moved(child), bounds),
            alone => alone,
        }));
        if let (Some(end), Some(part)) = (&mut self.whole.end, &mut chunk.bvh.end) {
            end.bounds.append(&mut part.bounds);
            end.corners.append(&mut part.corners);
        }
        self.whole.blocks.append(&mut chunk.bvh.blocks);
        self.whole.nodes.extend(chunk.bvh.nodes.drain(..).map(|mut n| {
            n.child = n.child.map(moved);
            n
        }));
    }

    /// Builds the tree above.
    pub fn finish(mut self) -> Bvh {
        let above = Above { primitives: self.primitives, parts: &self.parts };
        let order: Vec<u32> = (0..self.parts.len() as u32).collect();
        let above = collapse_whole(&above, &order);
        // Its root stands first, the rest behind the chunks.
        let (nodes, blocks) = (self.whole.nodes.len(), self.whole.blocks.len());
        let moved = |child: Child| match child {
            Child::ABSENT => child,
            child => match child.kind() {
                ChildKind::Node(i) => Child::node(nodes + i - 1),
                ChildKind::Block(i) => Child::block(blocks + i),
                ChildKind::Other(part) => match self.parts[part as usize] {
                    Part::Below(child, _) => child,
                    Part::Primitive(index) => match self.primitives.get(index as usize) {
                        Primitive::Other { id, .. } => Child::other(id),
                        Primitive::Triangle { .. } => unreachable!("triangles are in blocks"),
                    },
                },
            },
        };
        for (i, mut node) in above.nodes.into_iter().enumerate() {
            node.child = node.child.map(moved);
            match i {
                0 => self.whole.nodes[0] = node,
                _ => self.whole.nodes.push(node),
            }
        }
        self.whole.blocks.extend(above.blocks);
        if let (Some(end), Some(above)) = (&mut self.whole.end, above.end) {
            let mut bounds = above.bounds.into_iter();
            end.bounds[0] = bounds.next().expect("there is a root");
            end.bounds.extend(bounds);
            end.corners.extend(above.corners);
        }
        self.whole.shrink_to_fit();
        self.whole
    }
}

/// Parts as the builder sees them: what is an other to it has the number of its part.
struct Above<'a, P> {
    primitives: &'a P,
    parts: &'a [Part],
}

impl<P: Primitives> Above<'_, P> {
    fn at(&self, index: usize, end: usize) -> Primitive {
        let other = |bounds: Bounds| Primitive::Other { bounds, id: index as u32 };
        match self.parts[index] {
            Part::Below(_, bounds) => other(bounds[end]),
            Part::Primitive(i) => {
                let i = i as usize;
                match if end == 0 { self.primitives.get(i) } else { self.primitives.get_at_end(i) } {
                    Primitive::Other { bounds, .. } => other(bounds),
                    triangle => triangle,
                }
            }
        }
    }
}

impl<P: Primitives> Primitives for Above<'_, P> {
    fn len(&self) -> usize {
        self.parts.len()
    }
    fn get(&self, index: usize) -> Primitive {
        self.at(index, 0)
    }
    fn moves(&self) -> bool {
        self.primitives.moves()
    }
    fn get_at_end(&self, index: usize) -> Primitive {
        self.at(index, 1)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Node;
    use super::super::build::CHUNK;
    use super::*;
    use diopter_light::random::{mix, to_unit};
    use glam::Vec3;

    /// A room with forty finely cut things, and some triangles as large as the room.
    struct Room(usize);

    impl Primitives for Room {
        fn len(&self) -> usize {
            self.0
        }
        fn get(&self, index: usize) -> Primitive {
            let point = |n: usize, k: u32| Vec3::from_array([0, 1, 2].map(|axis| to_unit(mix(n as u32 * 12 + k + axis))));
            let corners = if index.is_multiple_of(500) {
                [0, 3, 6].map(|k| point(index, k))
            } else {
                let from = 0.9 * point(index % 40 + self.0, 0) + 0.1 * point(index, 0);
                [3, 6, 9].map(|k| from + 0.002 * point(index, k))
            };
            Primitive::Triangle { corners, id: index as u32, filtered: false }
        }
    }

    /// Nodes and blocks that a ray through the room meets on average (J. Goldsmith & J. Salmon 1987).
    fn met(bvh: &Bvh) -> f64 {
        let area = |n: &Node, i: usize| {
            let corner = |row: usize| Vec3::from_array([0, 1, 2].map(|axis| n.bounds[row + axis][i]));
            f64::from(Bounds { min: corner(0), max: corner(3) }.half_area())
        };
        let of_node = |n: &Node| (0..8).filter(|i| n.child[*i] != Child::ABSENT).map(|i| area(n, i)).sum::<f64>();
        bvh.nodes.iter().map(of_node).sum::<f64>() / f64::from(bvh.bounds().half_area())
    }

    #[test]
    fn chunks_below_one_tree_are_about_as_good_as_one_tree() {
        let room = Room(4 * CHUNK);
        let order: Vec<u32> = (0..room.len() as u32).collect();
        let (whole, chunks) = (met(&collapse_whole(&room, &order)), met(&Bvh::build(&room)));
        // 52.8 and 58.5; 60.6 with chunks side by side, 96 with too few parts.
        assert!(chunks < 1.13 * whole, "{chunks:.1} nodes and blocks in chunks, {whole:.1} in one tree");
    }
}
