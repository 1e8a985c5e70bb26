//! Numbers of an item: pure functions of the seed of the data set, the number of the item and the name of what is drawn.
//!
//! Nothing is drawn in turn, so that an item has the same numbers whoever makes it, and when; and another setting that varies changes none of the others.

/// Source of the numbers of one item.
#[derive(Clone, Copy, Debug)]
pub struct Draw {
    /// Of the data set.
    pub seed: u64,
    /// Number of the item.
    pub item: u64,
}

/// Fractional part of the golden ratio, 2⁶⁴ (φ − 1): the increment of SplitMix64.
const GAMMA: u64 = 0x9e37_79b9_7f4a_7c15;

/// Finaliser of SplitMix64. Source: Steele, Lea & Flood 2014, "Fast Splittable Pseudorandom Number Generators" (variant 13 of Stafford's mixers).
fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// FNV-1a of 64 bits (Fowler, Noll & Vo 1991).
fn name_hash(name: &str) -> u64 {
    name.bytes().fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01b3))
}

impl Draw {
    /// 64 random bits of the draw `index` of what is called `name`.
    pub fn bits(&self, name: &str, index: u64) -> u64 {
        [self.seed, self.item, name_hash(name), index]
            .into_iter()
            .fold(0, |h, word| mix(h.wrapping_add(GAMMA) ^ mix(word.wrapping_add(GAMMA))))
    }

    /// A number evenly distributed over [0, 1).
    pub fn uniform(&self, name: &str, index: u64) -> f64 {
        (self.bits(name, index) >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// A number of the standard normal distribution, by the method of Box & Muller (1958).
    pub fn normal(&self, name: &str, index: u64) -> f64 {
        // 1 − u is never 0.
        let radius = (-2.0 * (1.0 - self.uniform(name, 2 * index)).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform(name, 2 * index + 1)).cos()
    }
}

/// A number with nine significant digits. Logarithms and exponentials may differ in their last bit from one platform to another; what is drawn should not.
pub fn rounded(v: f64) -> f64 {
    format!("{v:.8e}").parse().unwrap_or(v)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_evenly_distributed_over_items_names_and_draws() {
        // χ² of 64 bins, 6400 numbers: mean 63, standard deviation √126 = 11.2; five of them are allowed.
        let chi2 = |numbers: &mut dyn Iterator<Item = f64>| {
            let mut bins = [0.0f64; 64];
            numbers.take(6400).for_each(|u| bins[(u * 64.0) as usize] += 1.0);
            bins.iter().map(|n| (n - 100.0).powi(2) / 100.0).sum::<f64>()
        };
        let draw = |item| Draw { seed: 1, item };
        let sets: [(&str, Box<dyn Iterator<Item = f64>>); 4] = [
            ("items", Box::new((0..).map(|i| draw(i).uniform("iso", 0)))),
            ("draws", Box::new((0..).map(|k| draw(3).uniform("iso", k)))),
            ("names", Box::new((0..).map(|k| draw(3).uniform(&format!("n{k}"), 0)))),
            ("seeds", Box::new((0..).map(|seed| Draw { seed, item: 3 }.uniform("iso", 0)))),
        ];
        for (name, mut numbers) in sets {
            let found = chi2(&mut numbers);
            assert!((63.0 - 56.0..63.0 + 56.0).contains(&found), "{name}: {found}");
        }
    }

    #[test]
    fn numbers_of_two_names_are_independent() {
        // Correlation of 10 000 pairs: standard deviation 0.01; five of them are allowed.
        let n = 10_000;
        let sum: f64 =
            (0..n).map(|item| Draw { seed: 7, item }).map(|d| (d.uniform("a", 0) - 0.5) * (d.uniform("b", 0) - 0.5) * 12.0).sum();
        assert!((sum / n as f64).abs() < 0.05, "{sum}");
    }

    #[test]
    fn normal_numbers_have_mean_and_variance() {
        let all: Vec<f64> = (0..20_000).map(|item| Draw { seed: 5, item }.normal("x", 0)).collect();
        let n = all.len() as f64;
        let mean = all.iter().sum::<f64>() / n;
        let variance = all.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
        // Standard deviations: 1/√n = 0.007 and √(2/n) = 0.01; five of them are allowed.
        assert!(mean.abs() < 0.035 && (variance - 1.0).abs() < 0.05, "{mean} {variance}");
    }

    #[test]
    fn numbers_stay_what_they_are() {
        // Data sets are made again years later: these values must not change.
        let draw = Draw { seed: 1, item: 2 };
        assert_eq!(draw.bits("iso", 0), draw.bits("iso", 0));
        assert_ne!(draw.bits("iso", 0), Draw { seed: 2, item: 1 }.bits("iso", 0));
        assert_eq!(mix(GAMMA), 0xe220_a839_7b1d_cdaf, "the first number of SplitMix64 with seed 0");
        assert_eq!(name_hash("a"), 0xaf63_dc4c_8601_ec8c, "FNV-1a of \"a\"");
        assert_eq!(rounded(1.0 / 3.0), 0.333_333_333);
    }
}
