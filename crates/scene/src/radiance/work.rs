//! How much work the light of paths was: what `auto` foretells the cost of path reuse by.

/// What was done for the light of paths.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Rays along which paths went on.
    pub segments: u32,
    /// Shadow rays between what one path found and others that could have found it.
    pub reuse_rays: u32,
}
