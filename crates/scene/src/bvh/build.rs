//! Building: large sets are split into chunks by binned SAH, each chunk becomes a binary tree (`obvhs`: PLOC with
//! reinsertion), and binary trees are collapsed into eight-wide nodes as soon as they are done. Chunks are built in
//! parallel; only a few are alive at a time, so the peak of memory stays near the size of the result.

use super::{Block, Bounds, Bvh, Child, Node, Primitive, Primitives};
use glam::Vec3;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use rayon::prelude::*;

/// Primitives a chunk. 2 M triangles make some eighty: few are alive at a time, so the peak of memory stays low (at four times
/// the size it was 13 % higher); the rate of rays on the bumpy spheres was the same within noise.
pub(super) const CHUNK: usize = 1 << 15;
/// Bins of the split above the chunks.
const BINS: usize = 32;
/// Share of the nodes the reinsertion optimiser tries: doubles as the quality dial of the build.
const REINSERTION: f32 = 0.02;

impl Bvh {
    /// Builds the hierarchy over primitives. Triangles with corners that are not finite must have been sorted out.
    pub fn build(primitives: &impl Primitives) -> Bvh {
        if primitives.is_empty() {
            return Bvh::default();
        }
        let mut indices: Vec<u32> = (0..primitives.len() as u32).collect();
        let mut tree = Split::Chunk(0, indices.len());
        if indices.len() > CHUNK {
            // Kept only while splitting asks for each box again and again.
            let bounds: Vec<Bounds> = (0..primitives.len()).into_par_iter().map(|i| bounds_of(primitives, i)).collect();
            tree = split(&mut indices, 0, &|i| bounds[i as usize]);
        }
        // A few chunks at a time, each put away before the next are begun: the peak of memory stays near the result.
        let mut joined = Joints::new(&tree, primitives.len());
        let chunks = tree.chunks();
        for batch in chunks.chunks(rayon::current_num_threads().max(1)) {
            let parts: Vec<_> =
                batch.into_par_iter().map(|(start, end)| build_chunk(primitives, &indices[*start..*end])).collect();
            parts.into_iter().for_each(|(part, part_bounds)| joined.hang(part, part_bounds));
        }
        joined.finish()
    }
}

fn bounds_of(primitives: &impl Primitives, index: usize) -> Bounds {
    match primitives.get(index) {
        Primitive::Triangle { corners, .. } => Bounds::around(corners),
        Primitive::Other { bounds, .. } => bounds,
    }
}

/// How the chunks hang together.
enum Split {
    Chunk(usize, usize),
    Pair(Box<Split>, Box<Split>),
}

impl Split {
    fn chunks(&self) -> Vec<(usize, usize)> {
        match self {
            Split::Chunk(start, end) => vec![(*start, *end)],
            Split::Pair(a, b) => [a.chunks(), b.chunks()].concat(),
        }
    }
}

/// Splits at the best of `BINS` planes across the longest axis of the centres, until chunks are small enough.
fn split(indices: &mut [u32], start: usize, bounds_of: &(impl Fn(u32) -> Bounds + Sync)) -> Split {
    if indices.len() <= CHUNK {
        return Split::Chunk(start, start + indices.len());
    }
    let centers = indices
        .par_chunks(1 << 14)
        .map(|c| Bounds::around(c.iter().map(|i| bounds_of(*i).center())))
        .reduce(|| Bounds::EMPTY, Bounds::union);
    let axis = centers.size().max_position();
    let scale = BINS as f32 / centers.size()[axis].max(f32::MIN_POSITIVE);
    let bin_of = |b: &Bounds| (((b.center()[axis] - centers.min[axis]) * scale).max(0.0) as usize).min(BINS - 1);
    let empty = || [(Bounds::EMPTY, 0usize); BINS];
    let bins = indices
        .par_chunks(1 << 14)
        .map(|chunk| {
            chunk.iter().fold(empty(), |mut bins, i| {
                let b = bounds_of(*i);
                let bin = &mut bins[bin_of(&b)];
                *bin = (bin.0.union(b), bin.1 + 1);
                bins
            })
        })
        .reduce(empty, |a, b| std::array::from_fn(|i| (a[i].0.union(b[i].0), a[i].1 + b[i].1)));

    // Cost of splitting before each bin; halves that are too uneven do not help to share out the work.
    let side = |range: std::ops::Range<usize>| {
        let (b, n) = bins[range].iter().fold((Bounds::EMPTY, 0), |a, b| (a.0.union(b.0), a.1 + b.1));
        (b.half_area() as f64 * n as f64, n)
    };
    let best = (1..BINS)
        .map(|k| (k, side(0..k), side(k..BINS)))
        .filter(|(_, a, b)| a.1.min(b.1) * 16 > indices.len())
        .min_by(|x, y| (x.1.0 + x.2.0).total_cmp(&(y.1.0 + y.2.0)));
    let middle = match best {
        Some((k, ..)) => partition(indices, |i| bin_of(&bounds_of(i)) < k),
        None => indices.len() / 2,
    };
    let (a, b) = indices.split_at_mut(middle);
    let (a, b) = rayon::join(|| split(a, start, bounds_of), || split(b, start + middle, bounds_of));
    Split::Pair(Box::new(a), Box::new(b))
}

/// Moves the entries for which `first` holds to the front, keeping their order; returns how many they are.
fn partition(indices: &mut [u32], first: impl Fn(u32) -> bool) -> usize {
    let (a, b): (Vec<u32>, Vec<u32>) = indices.iter().partition(|i| first(**i));
    indices[..a.len()].copy_from_slice(&a);
    indices[a.len()..].copy_from_slice(&b);
    a.len()
}

/// One chunk: its hierarchy and its box.
fn build_chunk(primitives: &impl Primitives, indices: &[u32]) -> (Bvh, Bounds) {
    let aabb = |i: &u32| {
        let b = bounds_of(primitives, *i as usize);
        Aabb::new(b.min.into(), b.max.into())
    };
    let boxes: Vec<Aabb> = indices.iter().map(aabb).collect();
    let order: Vec<u32> = (0..indices.len() as u32).collect();
    let mut tree =
        PlocBuilder::with_capacity(boxes.len()).build(PlocSearchDistance::Medium, &boxes, order, SortPrecision::U64, 2);
    drop(boxes);
    ReinsertionOptimizer::default().run(&mut tree, REINSERTION, None);
    Collapse::new(primitives, indices, &tree).run()
}

/// Turns a binary tree into eight-wide nodes and leaf blocks.
struct Collapse<'a, P> {
    primitives: &'a P,
    indices: &'a [u32],
    tree: &'a Bvh2,
    /// Primitives below each node, capped at 9; more than 8 also where an other is among them.
    weight: Vec<u8>,
    bvh: Bvh,
}

impl<'a, P: Primitives> Collapse<'a, P> {
    fn new(primitives: &'a P, indices: &'a [u32], tree: &'a Bvh2) -> Self {
        let mut collapse = Collapse { primitives, indices, tree, weight: vec![0; tree.nodes.len()], bvh: Bvh::default() };
        collapse.weigh();
        collapse
    }

    fn primitive(&self, node: usize) -> Primitive {
        let leaf = &self.tree.nodes[node];
        let index = self.tree.primitive_indices[leaf.first_index as usize];
        self.primitives.get(self.indices[index as usize] as usize)
    }

    fn is_other(&self, node: usize) -> bool {
        self.tree.nodes[node].is_leaf() && matches!(self.primitive(node), Primitive::Other { .. })
    }

    /// Fills `weight`, children before parents, without recursion (trees can be deep).
    fn weigh(&mut self) {
        let mut stack = vec![(0usize, false)];
        while let Some((node, children_done)) = stack.pop() {
            if self.tree.nodes[node].is_leaf() {
                self.weight[node] = 1;
                continue;
            }
            let child = self.tree.nodes[node].first_index as usize;
            if children_done {
                let alone = |n: usize| if self.is_other(n) { 9 } else { self.weight[n] };
                self.weight[node] = (alone(child) + alone(child + 1)).min(9);
            } else {
                stack.extend([(node, true), (child, false), (child + 1, false)]);
            }
        }
    }

    fn bounds(&self, node: usize) -> Bounds {
        let b = self.tree.nodes[node].aabb();
        Bounds { min: b.min.into(), max: b.max.into() }
    }

    fn run(mut self) -> (Bvh, Bounds) {
        let root = self.bounds(0);
        self.bvh.nodes.push(Node::absent());
        // A tree that fits one block still gets a root node above it.
        let mut work = vec![(0usize, 0usize)];
        while let Some((node, at)) = work.pop() {
            let children = if self.tree.nodes[node].is_leaf() || self.weight[node] <= 8 { vec![node] } else { self.open(node) };
            let mut wide = Node::absent();
            for (i, &child) in children.iter().enumerate() {
                let to = if self.is_other(child) {
                    let Primitive::Other { id, .. } = self.primitive(child) else { unreachable!("checked above") };
                    Child::other(id)
                } else if self.weight[child] <= 8 {
                    Child::block(self.block(child))
                } else {
                    let index = self.bvh.nodes.len();
                    self.bvh.nodes.push(Node::absent());
                    work.push((child, index));
                    Child::node(index)
                };
                wide.set(i, self.bounds(child), to);
            }
            self.bvh.nodes[at] = wide;
        }
        self.bvh.nodes.shrink_to_fit();
        self.bvh.blocks.shrink_to_fit();
        (self.bvh, root)
    }

    /// Up to eight descendants that cover a node: the largest is opened again and again.
    fn open(&self, node: usize) -> Vec<usize> {
        let first = self.tree.nodes[node].first_index as usize;
        let mut children = vec![first, first + 1];
        while children.len() < 8 {
            let largest = (0..children.len())
                .filter(|i| self.weight[children[*i]] > 8)
                .max_by(|a, b| self.bounds(children[*a]).half_area().total_cmp(&self.bounds(children[*b]).half_area()));
            let Some(largest) = largest else { break };
            let first = self.tree.nodes[children[largest]].first_index as usize;
            children[largest] = first;
            children.push(first + 1);
        }
        children
    }

    /// Gathers the triangles below a node into one block.
    fn block(&mut self, node: usize) -> usize {
        let mut block = Block { corners: [[[0.0; 8]; 3]; 3], id: [u32::MAX; 8], filtered: 0 };
        let mut lane = 0;
        let mut stack = vec![node];
        while let Some(n) = stack.pop() {
            if !self.tree.nodes[n].is_leaf() {
                let child = self.tree.nodes[n].first_index as usize;
                stack.extend([child + 1, child]);
                continue;
            }
            let Primitive::Triangle { corners, id, filtered } = self.primitive(n) else { unreachable!("others stand alone") };
            for c in 0..3 {
                for a in 0..3 {
                    block.corners[c][a][lane] = corners[c][a];
                }
            }
            block.id[lane] = id;
            block.filtered |= (filtered as u32) << lane;
            lane += 1;
        }
        self.bvh.blocks.push(block);
        self.bvh.blocks.len() - 1
    }
}

impl Node {
    fn absent() -> Self {
        let mut bounds = [[f32::INFINITY; 8]; 6];
        bounds[3..].fill([f32::NEG_INFINITY; 8]);
        Node { bounds, child: [Child::ABSENT; 8] }
    }

    /// The box around all children.
    pub(super) fn all(&self) -> Bounds {
        let corner = |c: usize, i: usize| Vec3::new(self.bounds[c][i], self.bounds[c + 1][i], self.bounds[c + 2][i]);
        (0..8).fold(Bounds::EMPTY, |b, i| b.union(Bounds { min: corner(0, i), max: corner(3, i) }))
    }

    fn set(&mut self, i: usize, b: Bounds, child: Child) {
        for a in 0..3 {
            self.bounds[a][i] = b.min[a];
            self.bounds[a + 3][i] = b.max[a];
        }
        self.child[i] = child;
    }
}

/// The whole tree while its chunks are being hung below nodes that follow the splits.
struct Joints {
    whole: Bvh,
    /// Node and child where each chunk is to hang, the next one last.
    pending: Vec<(usize, usize)>,
    /// Parent node and child of each joint but the root.
    parents: Vec<(usize, usize)>,
    /// Whether there is a single chunk, which needs no joint.
    alone: bool,
}

impl Joints {
    fn new(tree: &Split, primitives: usize) -> Self {
        // Address space, not memory: blocks hold five triangles or more on average, and growing would copy.
        let whole = Bvh { nodes: Vec::with_capacity(primitives / 16), blocks: Vec::with_capacity(primitives / 4) };
        let mut joints = Joints { whole, pending: Vec::new(), parents: Vec::new(), alone: matches!(tree, Split::Chunk(..)) };
        if !joints.alone {
            joints.lay_out(tree);
            joints.pending.reverse();
        }
        joints
    }

    /// Makes the nodes of a split of many parts, in the order of [`Split::chunks`], their boxes still empty.
    fn lay_out(&mut self, tree: &Split) {
        let at = self.whole.nodes.len();
        self.whole.nodes.push(Node::absent());
        // Open pairs while all children fit one node.
        let mut children: Vec<&Split> = vec![tree];
        while children.len() < 8 {
            let Some(i) = children.iter().position(|c| matches!(c, Split::Pair(..))) else { break };
            let Split::Pair(a, b) = children[i] else { break };
            children.splice(i..=i, [a.as_ref(), b.as_ref()]);
        }
        for (slot, child) in children.into_iter().enumerate() {
            match child {
                Split::Chunk(..) => self.pending.push((at, slot)),
                pair => {
                    self.whole.nodes[at].child[slot] = Child::node(self.whole.nodes.len());
                    self.parents.push((at, slot));
                    self.lay_out(pair);
                }
            }
        }
    }

    /// Hangs the next chunk.
    fn hang(&mut self, part: Bvh, bounds: Bounds) {
        if self.alone {
            self.whole = part;
            return;
        }
        let (node, slot) = self.pending.pop().expect("a place a chunk");
        let (nodes, blocks) = (self.whole.nodes.len(), self.whole.blocks.len());
        let moved = |child: Child| match child {
            Child::ABSENT => child,
            child => match child.kind() {
                super::ChildKind::Node(i) => Child::node(i + nodes),
                super::ChildKind::Block(i) => Child::block(i + blocks),
                super::ChildKind::Other(_) => child,
            },
        };
        self.whole.nodes[node].set(slot, bounds, Child::node(nodes));
        self.whole.blocks.extend(part.blocks);
        self.whole.nodes.extend(part.nodes.into_iter().map(|mut n| {
            n.child = n.child.map(moved);
            n
        }));
    }

    /// Gives the joints the boxes of what hangs below them, the deepest first.
    fn finish(mut self) -> Bvh {
        for (node, slot) in self.parents.iter().rev() {
            let super::ChildKind::Node(child) = self.whole.nodes[*node].child[*slot].kind() else {
                unreachable!("joints are nodes")
            };
            let bounds = self.whole.nodes[child].all();
            self.whole.nodes[*node].set(*slot, bounds, Child::node(child));
        }
        self.whole.nodes.shrink_to_fit();
        self.whole.blocks.shrink_to_fit();
        self.whole
    }
}
