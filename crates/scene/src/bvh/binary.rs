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

/// A binary tree over some of the primitives, whose leaves are single ones.
pub(super) fn binary_tree(primitives: &impl Primitives, indices: &[u32]) -> Bvh2 {
    let aabb = |i: &u32| {
        let b = primitives.bounds(*i as usize);
        Aabb::new(b.min.into(), b.max.into())
    };
    let boxes: Vec<Aabb> = indices.iter().map(aabb).collect();
    let order: Vec<u32> = (0..indices.len() as u32).collect();
    let mut tree =
        PlocBuilder::with_capacity(boxes.len()).build(PlocSearchDistance::Medium, &boxes, order, SortPrecision::U64, 2);
    drop(boxes);
    let fraction = if primitives.len() <= FEW { REINSERTION_OF_FEW } else { REINSERTION };
    ReinsertionOptimizer::default().run(&mut tree, fraction, None);
    tree
}
