//! Materials as prims use them.

use super::stage::Fingerprint;
use crate::texture::{Image, Scalar};
use std::collections::HashMap;
use std::sync::Arc;

/// A material as prims use it.
#[derive(Clone, Debug)]
pub struct Bound {
    pub number: u32,
    /// Names of the primvars that its pictures lie on; two at most.
    pub uvs: Vec<String>,
    /// Whether the colours of vertices count.
    pub colors: bool,
    /// Heights along the normal, in the space of the mesh.
    pub displacement: Option<Arc<Scalar>>,
}

/// Materials and pictures that were read.
#[derive(Default)]
pub struct Shaders {
    pub by_path: HashMap<String, Option<Bound>>,
    pub by_opinions: HashMap<Fingerprint, Bound>,
    pub plain: HashMap<Option<[u32; 3]>, u32>,
    pub pictures: HashMap<String, Option<Arc<Image>>>,
}
