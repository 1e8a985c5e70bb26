//! Building: large sets are split into chunks by binned SAH, each chunk becomes a binary tree (`binary`), and binary trees are collapsed into eight-wide nodes (`collapse`) as soon as they are done. Chunks are built in
//! parallel; only a few are alive at a time, so the peak of memory stays near the size of the result. Of each chunk the largest subtrees
//! are parts of one tree above them all (`join`): what is large in one chunk does not make the others' boxes overlap.

use super::binary::BinaryBuilder;
use super::collapse::{Collapse, Parts, collapse_whole};
use super::join::Joined;
use super::{Bounds, Bvh, Primitives};
use glam::Vec3;
use rayon::prelude::*;

/// Primitives a chunk. 2 M triangles make some eighty: few are alive at a time, so the peak of memory stays low (at four times
/// the size it was 13 % higher); the rate of rays on the bumpy spheres was the same within noise.
pub(super) const CHUNK: usize = 1 << 15;
/// Chunks that a thread builds before what it made is put away.
const BATCH: usize = 2;
/// Primitives of a cluster.
const CLUSTER: usize = 256;
/// Subtrees of a chunk that the tree above the chunks is made of, and of all chunks: the most. In rooms of half a million triangles rays met 4.7 nodes in place of 6.5;
/// more of them than all have here took memory and met as many.
const PARTS: usize = 2048;
const ALL_PARTS: usize = 1 << 15;
/// Bins of the split above the chunks.
const BINS: usize = 32;

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
        let chunks = tree.chunks();
        if chunks.len() == 1 {
            let mut whole = collapse_whole(primitives, &indices);
            whole.shrink_to_fit();
            return whole;
        }
        let mut joined = Joined::new(primitives);
        let most_parts = (ALL_PARTS / chunks.len()).clamp(1, PARTS);
        let mut builders: Vec<ChunkBuilder> = (0..rayon::current_num_threads().max(1)).map(|_| ChunkBuilder::default()).collect();
        for batch in chunks.chunks(BATCH * builders.len()) {
            builders.par_iter_mut().zip(batch.par_chunks(BATCH)).for_each(|(builder, chunks)| {
                for (made, (start, end)) in builder.made.iter_mut().zip(chunks) {
                    let indices = &indices[*start..*end];
                    let tree = builder.binary.build(primitives, indices);
                    *made = Collapse::new(primitives, indices, tree, std::mem::take(made)).into_parts(most_parts);
                }
            });
            for (builder, chunks) in builders.iter_mut().zip(batch.chunks(BATCH)) {
                builder.made[..chunks.len()].iter_mut().for_each(|made| joined.add(made));
            }
        }
        drop(builders);
        joined.finish()
    }
}

/// What one thread builds chunks with, batch after batch in the same memory: an allocator keeps a good part of what is given back.
#[derive(Default)]
struct ChunkBuilder {
    binary: BinaryBuilder,
    made: [Parts; BATCH],
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
    // Bounds are computed anew where they are asked for: kept, they would be a third of what the hierarchy takes.
    let center = |i: usize| primitives.bounds(i).center();
    let parts = primitives.len().div_ceil(1 << 14);
    let centers = (0..parts)
        .into_par_iter()
        .map(|part| Bounds::around((part << 14..primitives.len().min((part + 1) << 14)).map(center)))
        .reduce(|| Bounds::EMPTY, Bounds::union);
    let scale = 1023.0 / centers.size().max(Vec3::splat(f32::MIN_POSITIVE));
    let code = |i: usize| morton((center(i) - centers.min) * scale);
    // Code and number side by side: sorted as one.
    let mut sorted: Vec<u64> = (0..primitives.len()).into_par_iter().map(|i| u64::from(code(i)) << 32 | i as u64).collect();
    sorted.par_sort_unstable();
    let number = |key: u64| key as u32;
    let mut clusters: Vec<Cluster> = sorted
        .par_chunks(CLUSTER)
        .enumerate()
        .map(|(k, keys)| Cluster {
            bounds: keys.iter().fold(Bounds::EMPTY, |b, key| b.union(primitives.bounds(number(*key) as usize))),
            from: (k * CLUSTER) as u32,
            count: keys.len() as u32,
        })
        .collect();
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
