//! Binary trees of boxes, by the builder of `obvhs`: PLOC with reinsertion.

use super::Primitives;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};

/// Fraction of the nodes the reinsertion optimiser tries: doubles as the quality dial of the build.
const REINSERTION: f32 = 0.02;
/// The same where there are few enough primitives that nobody waits for it.
const REINSERTION_OF_FEW: f32 = 0.15;
/// So many are few.
const FEW: usize = 1 << 17;

/// Builds binary trees, one after another in the same memory: what an allocator keeps of memory that is given back counts, too.
#[derive(Default)]
pub(super) struct BinaryBuilder {
    ploc: PlocBuilder,
    reinsertion: ReinsertionOptimizer,
    boxes: Vec<Aabb>,
    tree: Bvh2,
}

impl BinaryBuilder {
    /// A binary tree over some of the primitives, whose leaves are single ones.
    pub fn build(&mut self, primitives: &impl Primitives, indices: &[u32]) -> &Bvh2 {
        let aabb = |i: &u32| {
            let b = primitives.bounds(*i as usize);
            Aabb::new(b.min.into(), b.max.into())
        };
        self.boxes.clear();
        self.boxes.extend(indices.iter().map(aabb));
        // The list of the tree before.
        let mut order = std::mem::take(&mut self.tree.primitive_indices);
        order.clear();
        order.extend(0..indices.len() as u32);
        let (distance, precision) = (PlocSearchDistance::Medium, SortPrecision::U64);
        self.ploc.build_with_bvh(&mut self.tree, distance, &self.boxes, order, precision, 2);
        let fraction = if primitives.len() <= FEW { REINSERTION_OF_FEW } else { REINSERTION };
        self.reinsertion.run(&mut self.tree, fraction, None);
        &self.tree
    }
}
