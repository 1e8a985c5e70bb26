//! Building: large sets are split into chunks by binned SAH, each chunk becomes a binary tree (`obvhs`: PLOC with
//! reinsertion), and binary trees are collapsed into eight-wide nodes as soon as they are done. Chunks are built in
//! parallel; only a few are alive at a time, so the peak of memory stays near the size of the result.

use super::{Block, Bounds, Bvh, Child, End, Node, Primitive, Primitives, all};
use glam::Vec3;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use rayon::prelude::*;

/// Primitives a chunk. 2 M triangles make some eighty: few are alive at a time, so the peak of memory stays low (at four times
/// the size it was 13 % higher); the rate of rays on the bumpy spheres was the same within noise.
pub(super) const CHUNK: usize = 1 << 15;
/// Chunks that are built at a time, for each thread.
const BATCH: usize = 4;
/// Primitives of a cluster.
const CLUSTER: usize = 256;
/// Bins of the split above the chunks.
const BINS: usize = 32;
/// Coordinate of boxes that nothing meets, m.
const NOWHERE: f32 = 1e30;
/// Fraction of the nodes the reinsertion optimiser tries: doubles as the quality dial of the build.
const REINSERTION: f32 = 0.02;
/// The same where there are few enough primitives that nobody waits for it.
const REINSERTION_OF_FEW: f32 = 0.15;
/// So many are few.
const FEW: usize = 1 << 17;

impl Bvh {
    /// Builds the hierarchy over primitives. Triangles with corners that are not finite must have been sorted out. Panics where nodes, blocks of triangles or numbers of
    /// others reach 2³⁰.
    pub fn build(primitives: &impl Primitives) -> Bvh {
        if primitives.is_empty() {
            return Bvh::default();
        }
        let mut indices: Vec<u32> = (0..primitives.len() as u32).collect();
        let tree = if indices.len() > CHUNK { split(&mut indices, primitives) } else { Split::Chunk(0, indices.len()) };
        // Some chunks at a time, each batch put away before the next is begun: the peak of memory stays near the result.
        let mut joined = Joints::new(&tree, primitives.len(), primitives.moves());
        let chunks = tree.chunks();
        for batch in chunks.chunks(BATCH * rayon::current_num_threads().max(1)) {
            let parts: Vec<_> =
                batch.into_par_iter().map(|(start, end)| build_chunk(primitives, &indices[*start..*end])).collect();
            parts.into_iter().for_each(|(part, part_bounds)| joined.hang(part, part_bounds));
        }
        joined.finish()
    }
}

/// The box of a primitive; of a moving one, around both of its ends.
fn bounds_of(primitives: &impl Primitives, index: usize) -> Bounds {
    let open = primitives.get(index).bounds();
    if primitives.moves() { open.union(primitives.get_at_end(index).bounds()) } else { open }
}

impl Primitive {
    fn bounds(&self) -> Bounds {
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

/// Neighbours in space, by a curve through it, that are not taken apart by the splits above the chunks.
#[derive(Clone, Copy)]
struct Cluster {
    bounds: Bounds,
    /// Where they stand in the sorted list.
    from: u32,
    count: u32,
}

/// Orders primitives chunk by chunk.
fn split(indices: &mut [u32], primitives: &impl Primitives) -> Split {
    let bounds: Vec<Bounds> = (0..primitives.len()).into_par_iter().map(|i| bounds_of(primitives, i)).collect();
    let centers =
        bounds.par_chunks(1 << 14).map(|c| Bounds::around(c.iter().map(Bounds::center))).reduce(|| Bounds::EMPTY, Bounds::union);
    let scale = 1023.0 / centers.size().max(Vec3::splat(f32::MIN_POSITIVE));
    let code = |i: usize| morton((bounds[i].center() - centers.min) * scale);
    // Code and number side by side: sorted as one.
    let mut sorted: Vec<u64> = (0..bounds.len()).into_par_iter().map(|i| u64::from(code(i)) << 32 | i as u64).collect();
    sorted.par_sort_unstable();
    let number = |key: u64| key as u32;
    let mut clusters: Vec<Cluster> = sorted
        .par_chunks(CLUSTER)
        .enumerate()
        .map(|(k, keys)| Cluster {
            bounds: keys.iter().fold(Bounds::EMPTY, |b, key| b.union(bounds[number(*key) as usize])),
            from: (k * CLUSTER) as u32,
            count: keys.len() as u32,
        })
        .collect();
    drop(bounds);
    let tree = split_clusters(&mut clusters, 0);
    let mut out: Vec<&mut [u32]> = Vec::with_capacity(clusters.len());
    let mut rest = indices;
    for cluster in &clusters {
        let (part, after) = rest.split_at_mut(cluster.count as usize);
        out.push(part);
        rest = after;
    }
    out.into_par_iter().zip(&clusters).for_each(|(part, cluster)| {
        let from = cluster.from as usize;
        part.iter_mut().zip(&sorted[from..]).for_each(|(to, key)| *to = number(*key));
    });
    tree
}

/// Bits of three numbers from 0 to 1023 in turn.
fn morton(p: Vec3) -> u32 {
    let spread = |v: f32| {
        let mut x = v.clamp(0.0, 1023.0) as u32;
        x = (x | x << 16) & 0x0300_00ff;
        x = (x | x << 8) & 0x0300_f00f;
        x = (x | x << 4) & 0x030c_30c3;
        (x | x << 2) & 0x0924_9249
    };
    spread(p.x) << 2 | spread(p.y) << 1 | spread(p.z)
}

/// Splits at the best of `BINS` planes across the longest axis of the centres, until chunks are small enough. `start`: how many primitives stand
/// before them.
fn split_clusters(clusters: &mut [Cluster], start: usize) -> Split {
    let total: usize = clusters.iter().map(|c| c.count as usize).sum();
    if total <= CHUNK || clusters.len() < 2 {
        return Split::Chunk(start, start + total);
    }
    let centers = Bounds::around(clusters.iter().map(|c| c.bounds.center()));
    let axis = centers.size().max_position();
    let scale = BINS as f32 / centers.size()[axis].max(f32::MIN_POSITIVE);
    let bin_of = |b: &Bounds| (((b.center()[axis] - centers.min[axis]) * scale).max(0.0) as usize).min(BINS - 1);
    let mut bins = [(Bounds::EMPTY, 0usize); BINS];
    for c in clusters.iter() {
        let bin = &mut bins[bin_of(&c.bounds)];
        *bin = (bin.0.union(c.bounds), bin.1 + c.count as usize);
    }
    // Cost of splitting before each bin; halves that are too uneven do not help to share out the work.
    let side = |range: std::ops::Range<usize>| {
        let (b, n) = bins[range].iter().fold((Bounds::EMPTY, 0), |a, b| (a.0.union(b.0), a.1 + b.1));
        (b.half_area() as f64 * n as f64, n)
    };
    let best = (1..BINS)
        .map(|k| (k, side(0..k), side(k..BINS)))
        .filter(|(_, a, b)| a.1.min(b.1) * 16 > total)
        .min_by(|x, y| (x.1.0 + x.2.0).total_cmp(&(y.1.0 + y.2.0)));
    let middle = match best {
        Some((k, ..)) => {
            clusters.sort_by_key(|c| bin_of(&c.bounds) >= k);
            clusters.partition_point(|c| bin_of(&c.bounds) < k)
        }
        None => clusters.len() / 2,
    };
    let (a, b) = clusters.split_at_mut(middle);
    let first: usize = a.iter().map(|c| c.count as usize).sum();
    Split::Pair(Box::new(split_clusters(a, start)), Box::new(split_clusters(b, start + first)))
}

/// One chunk: its hierarchy and its box.
fn build_chunk(primitives: &impl Primitives, indices: &[u32]) -> (Bvh, [Bounds; 2]) {
    let aabb = |i: &u32| {
        let b = bounds_of(primitives, *i as usize);
        Aabb::new(b.min.into(), b.max.into())
    };
    let boxes: Vec<Aabb> = indices.iter().map(aabb).collect();
    let order: Vec<u32> = (0..indices.len() as u32).collect();
    let mut tree =
        PlocBuilder::with_capacity(boxes.len()).build(PlocSearchDistance::Medium, &boxes, order, SortPrecision::U64, 2);
    drop(boxes);
    let fraction = if primitives.len() <= FEW { REINSERTION_OF_FEW } else { REINSERTION };
    ReinsertionOptimizer::default().run(&mut tree, fraction, None);
    Collapse::new(primitives, indices, &tree).run()
}

/// Turns a binary tree into eight-wide nodes and leaf blocks.
struct Collapse<'a, P> {
    primitives: &'a P,
    indices: &'a [u32],
    tree: &'a Bvh2,
    /// Primitives below each node, capped at 9; more than 8 also where an other is among them.
    weight: Vec<u8>,
    /// Boxes of each node at the two ends of the motion, where there is one.
    ends: Vec<[Bounds; 2]>,
    bvh: Bvh,
}

impl<'a, P: Primitives> Collapse<'a, P> {
    fn new(primitives: &'a P, indices: &'a [u32], tree: &'a Bvh2) -> Self {
        let weight = vec![0; tree.nodes.len()];
        let (mut bvh, mut ends) = (Bvh::default(), Vec::new());
        if primitives.moves() {
            bvh.end = Some(End::default());
            ends = vec![[Bounds::EMPTY; 2]; tree.nodes.len()];
        }
        let mut collapse = Collapse { primitives, indices, tree, weight, ends, bvh };
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

    fn push_node(&mut self) -> usize {
        self.bvh.nodes.push(Node::absent());
        if let Some(end) = &mut self.bvh.end {
            end.bounds.push(Node::absent().bounds);
        }
        self.bvh.nodes.len() - 1
    }

    fn run(mut self) -> (Bvh, [Bounds; 2]) {
        let root = self.both(0);
        self.push_node();
        // A tree that fits one block still gets a root node above it.
        let mut work = vec![(0usize, 0usize)];
        while let Some((node, at)) = work.pop() {
            let (mut children, mut count) = ([node; 8], 1);
            if !self.tree.nodes[node].is_leaf() && self.weight[node] > 8 {
                (children, count) = self.open(node);
            }
            let (mut wide, mut wide_end) = (Node::absent(), Node::absent());
            for (i, &child) in children[..count].iter().enumerate() {
                let to = if self.is_other(child) {
                    let Primitive::Other { id, .. } = self.primitive(child) else { unreachable!("checked above") };
                    Child::other(id)
                } else if self.weight[child] <= 8 {
                    Child::block(self.block(child))
                } else {
                    let index = self.push_node();
                    work.push((child, index));
                    Child::node(index)
                };
                let [open, close] = self.both(child);
                wide.set(i, open, to);
                wide_end.set(i, close, to);
            }
            self.bvh.nodes[at] = wide;
            if let Some(end) = &mut self.bvh.end {
                end.bounds[at] = wide_end.bounds;
            }
        }
        self.bvh.nodes.shrink_to_fit();
        self.bvh.blocks.shrink_to_fit();
        (self.bvh, root)
    }

    /// Up to eight descendants that cover a node, and how many: the largest is opened again and again.
    fn open(&self, node: usize) -> ([usize; 8], usize) {
        let mut children = [0; 8];
        // Of those that can be opened.
        let mut areas = [-1.0f32; 8];
        let area = |child: usize| if self.weight[child] > 8 { self.bounds(child).half_area() } else { -1.0 };
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
        let mut block = Block { corners: [[[0.0; 8]; 3]; 3], id: [u32::MAX; 8], filtered: 0 };
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
            block.id[lane] = id;
            block.filtered |= (filtered as u32) << lane;
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
        set(&mut self.bounds, i, b);
        self.child[i] = child;
    }
}

fn set(bounds: &mut [[f32; 8]; 6], i: usize, b: Bounds) {
    for a in 0..3 {
        bounds[a][i] = b.min[a];
        bounds[a + 3][i] = b.max[a];
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
    fn new(tree: &Split, primitives: usize, moves: bool) -> Self {
        // Address space, not memory: blocks hold five triangles or more on average, and growing would copy.
        let (nodes, blocks) = (Vec::with_capacity(primitives / 16), Vec::with_capacity(primitives / 4));
        let whole = Bvh { nodes, blocks, end: moves.then(End::default) };
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
        if let Some(end) = &mut self.whole.end {
            end.bounds.push(Node::absent().bounds);
        }
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
    fn hang(&mut self, part: Bvh, bounds: [Bounds; 2]) {
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
        self.whole.nodes[node].set(slot, bounds[0], Child::node(nodes));
        if let (Some(end), Some(part)) = (&mut self.whole.end, part.end) {
            set(&mut end.bounds[node], slot, bounds[1]);
            end.bounds.extend(part.bounds);
            end.corners.extend(part.corners);
        }
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
            let bounds = all(&self.whole.nodes[child].bounds);
            self.whole.nodes[*node].set(*slot, bounds, Child::node(child));
            if let Some(end) = &mut self.whole.end {
                let bounds = all(&end.bounds[child]);
                set(&mut end.bounds[*node], *slot, bounds);
            }
        }
        self.whole.nodes.shrink_to_fit();
        self.whole.blocks.shrink_to_fit();
        self.whole
    }
}
