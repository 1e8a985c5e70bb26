//! Numbers for random walks: a function of a seed alone.

/// SplitMix64 (Steele, Lea & Flood 2014, doi 10.1145/2660193.2660195).
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// The walk of a number in a set of walks.
    pub fn new(set: u64, number: u64) -> Random {
        let mut random = Random(set.wrapping_mul(0xd129_0d3b_3b9e_f3c7) ^ number.wrapping_mul(0x2545_f491_4f6c_dd1d));
        random.next();
        random
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// From 0 to below 1.
    pub fn draw(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Points that fill the unit square evenly (Roberts 2018: multiples of the powers of the plastic number's inverse).
pub fn even(i: usize) -> [f64; 2] {
    [0.754_877_666_246_693, 0.569_840_290_998_053].map(|a: f64| (0.5 + a * i as f64).fract())
}

/// A point of the unit disk by two numbers from 0 to 1, areas kept.
pub fn disk([u, v]: [f64; 2]) -> glam::DVec2 {
    glam::DVec2::from_angle(std::f64::consts::TAU * v) * u.sqrt()
}
