//! Light in scenes, and their files: one program, so that it is linked once.

mod bidirectional;
mod caustics;
mod clear_glass;
mod common;
mod damaged_files;
mod direct;
mod features;
mod filtering;
mod gltf_extensions;
mod gltf_splats;
mod measured;
mod media;
mod mirrors;
mod pbrt;
mod polarized_transport;
mod reuse;
mod subsurface;
mod transport;
mod volumes;
