//! Materials as prims use them.

use super::stage::Fingerprint;
use crate::load::udim;
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
    pub by_path: HashMap<(String, DisplayColor), Option<Bound>>,
    pub by_opinions: HashMap<(Fingerprint, DisplayColor), Bound>,
    /// Whether materials read display colours, by path.
    pub display_readers: HashMap<String, bool>,
    /// By colour and opacity.
    pub plain: HashMap<(Option<[u32; 3]>, u32), u32>,
    /// Materials that shine as mesh lights, by their numbers and the light's colour.
    pub shining: HashMap<(u32, [u32; 3]), u32>,
    pub pictures: HashMap<String, Option<udim::Picture>>,
    /// Pictures, the channels that are inverted, and the results.
    pub flipped: Vec<(Arc<Image>, [bool; 3], Arc<Image>)>,
}

/// What shaders get that read `primvars:displayColor`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DisplayColor {
    /// The colours that the prim has itself.
    OfPrim,
    /// One for all of it, from a prim around it: bits of linear sRGB.
    Inherited([u32; 3]),
    Absent,
}
