//! Russian roulette: where it is decided whether a path goes on (Arvo & Kirk 1990, "Particle transport and image synthesis", SIGGRAPH).
//!
//! Paths of the camera ask [`goes_on`]; paths of lamps, photons and transmittance estimates [`survives`], each with its own probability. Light paths that connect keep the
//! probability beside the vertex instead (`light_paths/vertices.rs`).

use diopter_light::SampledSpectrum;

/// Largest probability with which a path goes on where it is decided by chance, so that every path ends.
pub const MOST_SURVIVAL: f32 = 0.95;

/// Whether a path goes on from its vertex, by what it can still bring; its throughput is divided by the probability of that. Until vertex `depth` it always does. `most`: the largest
/// probability.
#[inline]
pub fn goes_on(throughput: &mut SampledSpectrum, eta_scale: f32, vertex: u32, u: f32, depth: u32, most: f32) -> bool {
    vertex < depth || survives(throughput, (throughput.max_element() * eta_scale).clamp(0.0, most), u)
}

/// Whether what is carried goes on, which happens with probability `survival`; it is divided by that. `u`: uniform in [0, 1).
#[inline]
pub fn survives(carried: &mut SampledSpectrum, survival: f32, u: f32) -> bool {
    *carried /= survival;
    u < survival
}
