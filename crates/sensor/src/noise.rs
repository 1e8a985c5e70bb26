//! Random deviates of a pixel, reproducible from its key.

use rand::TryRng;
use rand_distr::{Distribution, Normal, Poisson};
use std::convert::Infallible;

/// A stream of numbers for one pixel of one read-out. Source: Steele et al. 2014, SplitMix64.
pub struct PixelNoise(u64);

impl PixelNoise {
    /// The stream of a pixel under a seed.
    pub fn new(seed: u64, pixel: u64) -> Self {
        let mut noise = PixelNoise(seed ^ 0x6a09_e667_f3bc_c909);
        let key = noise.next();
        PixelNoise(key ^ pixel.wrapping_mul(0xd1b5_4a32_d192_ed03))
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Electrons counted where `mean` are expected.
    pub fn shot(&mut self, mean: f64) -> f64 {
        // Beyond this the noise is below 1e-7 of the signal, and any well is full.
        if mean > 1e15 {
            return mean;
        }
        match Poisson::new(mean) {
            Ok(poisson) => poisson.sample(self),
            // Not positive: nothing arrives.
            Err(_) => 0.0,
        }
    }

    /// A normal deviate of mean 0.
    pub fn normal(&mut self, standard_deviation: f64) -> f64 {
        Normal::new(0.0, standard_deviation).map_or(0.0, |n| n.sample(self))
    }
}

impl TryRng for PixelNoise {
    type Error = Infallible;
    fn try_next_u32(&mut self) -> Result<u32, Infallible> {
        Ok((self.next() >> 32) as u32)
    }
    fn try_next_u64(&mut self) -> Result<u64, Infallible> {
        Ok(self.next())
    }
    fn try_fill_bytes(&mut self, bytes: &mut [u8]) -> Result<(), Infallible> {
        for chunk in bytes.chunks_mut(8) {
            chunk.copy_from_slice(&self.next().to_le_bytes()[..chunk.len()]);
        }
        Ok(())
    }
}
