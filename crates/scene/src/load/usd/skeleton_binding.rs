//! Skeletons that were read, and how meshes are bound to them.

use super::stage::Prim;
use glam::DMat4;
use std::collections::HashMap;
use std::sync::Arc;

/// What a mesh says of its skeleton.
pub struct Binding {
    /// Path of the skeleton.
    pub skeleton: Arc<str>,
    /// The joints that its indices count, if they are not the skeleton's.
    pub joints: Option<Arc<[Arc<str>]>>,
    /// From the mesh to the space in which it was bound.
    pub geom_bind: DMat4,
    /// Names of its blend shapes.
    pub shapes: Vec<Arc<str>>,
}

/// The nodes of a skeleton.
pub struct Bones {
    pub number_of: HashMap<Arc<str>, usize>,
    pub nodes: Vec<u32>,
    pub joint_from_bound: Vec<DMat4>,
    pub animation: Option<Arc<Prim>>,
}
