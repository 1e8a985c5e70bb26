//! Random numbers of a pixel: reproducible from a key, by the inverse of their distribution.
//!
//! Drawn by inversion, a pixel's deviate depends on one uniform number and rises with the mean: the same seed at another ISO
//! or another light gives the same grain.

/// A well-mixed number for a key and a counter. Source: Steele et al. 2014, SplitMix64, applied twice.
#[inline]
pub fn mix(key: u64, counter: u64) -> u64 {
    let scramble = |z: u64| {
        let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    };
    scramble(scramble(counter.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ key).wrapping_add(key))
}

/// A number above 0 and below 1 from 52 bits.
#[inline]
pub fn unit(bits: u64) -> f64 {
    ((bits >> 12) as f64 + 0.5) * (1.0 / (1u64 << 52) as f64)
}

/// A key from a text: FNV-1a.
pub fn key_of(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3))
}

/// The standard normal deviate below which a fraction `u` (0 to 1, both excluded) lies; 1e-15 exact.
/// Source: Wichura 1988, "Algorithm AS 241: the percentage points of the normal distribution", PPND16.
#[inline]
pub fn normal_quantile(u: f64) -> f64 {
    let q = u - 0.5;
    if q.abs() <= 0.425 {
        let r = 0.180_625 - q * q;
        let p = [
            3.387_132_872_796_366_5,
            133.141_667_891_784_37,
            1_971.590_950_306_551_3,
            13_731.693_765_509_46,
            45_921.953_931_549_87,
            67_265.770_927_008_7,
            33_430.575_583_588_13,
            2_509.080_928_730_122_7,
        ];
        let d = [
            1.0,
            42.313_330_701_600_91,
            687.187_007_492_057_9,
            5_394.196_021_424_751,
            21_213.794_301_586_597,
            39_307.895_800_092_71,
            28_729.085_735_721_943,
            5_226.495_278_852_545,
        ];
        return q * polynomial(&p, r) / polynomial(&d, r);
    }
    tail(q, u)
}

#[cold]
fn tail(q: f64, u: f64) -> f64 {
    let r = (-(if q < 0.0 { u } else { 1.0 - u }).ln()).sqrt();
    let x = if r <= 5.0 {
        let r = r - 1.6;
        let p = [
            1.423_437_110_749_683_5,
            4.630_337_846_156_545,
            5.769_497_221_460_691,
            3.647_848_324_763_204_5,
            1.270_458_252_452_368_4,
            0.241_780_725_177_450_6,
            0.022_723_844_989_269_184,
            7.745_450_142_783_414e-4,
        ];
        let d = [
            1.0,
            2.053_191_626_637_758_8,
            1.676_384_830_183_803_8,
            0.689_767_334_985_1,
            0.148_103_976_427_480_08,
            0.015_198_666_563_616_457,
            5.475_938_084_995_345e-4,
            1.050_750_071_644_416_9e-9,
        ];
        polynomial(&p, r) / polynomial(&d, r)
    } else {
        let r = r - 5.0;
        let p = [
            6.657_904_643_501_103,
            5.463_784_911_164_114,
            1.784_826_539_917_291_3,
            0.296_560_571_828_504_87,
            0.026_532_189_526_576_124,
            0.001_242_660_947_388_078_4,
            2.711_555_568_743_487_6e-5,
            2.010_334_399_292_288e-7,
        ];
        let d = [
            1.0,
            0.599_832_206_555_888,
            0.136_929_880_922_735_8,
            0.014_875_361_290_850_615,
            7.868_691_311_456_133e-4,
            1.846_318_317_510_054_7e-5,
            1.421_511_758_316_446e-7,
            2.044_263_103_389_939_8e-15,
        ];
        polynomial(&p, r) / polynomial(&d, r)
    };
    if q < 0.0 { -x } else { x }
}

#[inline]
fn polynomial<const N: usize>(coefficients: &[f64; N], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// Mean from which counts are drawn by [`expanded`].
const EXPANDED_FROM: f64 = 24.0;

/// The count of a Poisson distribution below which a fraction `u` lies. Exact (to the 52 bits of `u`) for means below 24, by
/// summing probabilities; by an expansion above. `u`: 0 to 1, both excluded.
#[inline]
pub fn poisson_quantile(mean: f64, u: f64) -> f64 {
    if mean >= EXPANDED_FROM {
        // Beyond this the noise is below 1e-7 of the signal, and any well is full.
        return if mean > 1e15 { mean } else { expanded(mean, u) };
    }
    // Not positive: nothing arrives. (Not a number: neither.)
    if !(mean > 0.0) {
        return 0.0;
    }
    let (mut count, mut probability) = (0.0, (-mean).exp());
    let mut sum = probability;
    // Where the sum stops growing, rounding is all that is left.
    while u > sum && count < 200.0 {
        count += 1.0;
        probability *= mean / count;
        sum += probability;
    }
    count
}

/// Source: Giles 2016, "Algorithm 955: approximation of the inverse Poisson cumulative distribution function" (ACM TOMS 42),
/// eq. 6: the normal deviate w, expanded in 1/√mean. Against exact sums the count is one off for 1.2e-4 of all u at a mean
/// of 24, 1.2e-5 at 100, 1e-7 at 1000; its variance 5e-5 too large at 24, 3e-6 at 100.
#[inline]
fn expanded(mean: f64, u: f64) -> f64 {
    let w = normal_quantile(u);
    let (root, w2) = (mean.sqrt(), w * w);
    let a = 1.0 / 3.0 + w2 / 6.0;
    let b = -w * (1.0 / 36.0 + w2 / 72.0);
    let c = -8.0 / 405.0 + w2 * (7.0 / 810.0 + w2 / 270.0);
    (mean + root * w + a + b / root + c / mean).floor().max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_the_normal_distribution_are_the_tabulated_ones() {
        // Source: the test values of AS 241, and scipy.special.ndtri.
        for (u, expected) in [
            (0.25, -0.674_489_750_196_081_7),
            (0.001, -3.090_232_306_167_813_3),
            (1e-20, -9.262_340_089_798_409),
            (0.5, 0.0),
            (0.975, 1.959_963_984_540_054),
            (1.0 - 1e-10, 6.361_340_889_697_422),
        ] {
            let got = normal_quantile(u);
            assert!((got - expected).abs() < 1e-12 * (1.0 + expected.abs()), "{u}: {got} {expected}");
        }
    }

    /// Probabilities of counts by the recursion from the largest, normalised.
    fn probabilities(mean: f64, counts: std::ops::Range<usize>) -> Vec<f64> {
        let mut logs = vec![0.0];
        for n in counts.start + 1..counts.end {
            logs.push(logs[logs.len() - 1] + (mean / n as f64).ln());
        }
        let top = logs.iter().fold(f64::MIN, |a: f64, b| a.max(*b));
        let sum: f64 = logs.iter().map(|l| (l - top).exp()).sum();
        logs.iter().map(|l| (l - top).exp() / sum).collect()
    }

    #[test]
    fn counts_are_poisson_from_single_photons_to_full_wells() {
        // χ² over about 40 bins of 400 000 draws a mean; its mean is the degrees of freedom, its deviation √(2·dof): 4.5 of
        // them are allowed. Means below 24 are drawn exactly, above by the expansion; both are held to the same.
        const DRAWS: usize = 400_000;
        for (k, mean) in [0.01f64, 0.1, 0.7, 3.0, 11.0, 23.9, 24.1, 40.0, 100.0, 1e3, 1e4, 1e5].into_iter().enumerate() {
            let spread = 9.0 * mean.sqrt() + 9.0;
            let range = (mean - spread).max(0.0) as usize..(mean + spread) as usize + 1;
            let p = probabilities(mean, range.clone());
            // Bins of at least 50 expected draws, at least a fortieth of the width.
            let (mut edges, mut expected) = (vec![range.start], vec![]);
            let (mut sum, mut since) = (0.0, 0);
            for (i, q) in p.iter().enumerate() {
                sum += q * DRAWS as f64;
                since += 1;
                if sum > 50.0 && since as f64 > spread / 60.0 {
                    edges.push(range.start + i + 1);
                    expected.push(sum);
                    (sum, since) = (0.0, 0);
                }
            }
            *expected.last_mut().unwrap() += sum;
            let mut seen = vec![0.0; expected.len()];
            for i in 0..DRAWS {
                let n = poisson_quantile(mean, unit(mix(77 + k as u64, i as u64))) as usize;
                let bin = edges.partition_point(|e| *e <= n).clamp(1, seen.len()) - 1;
                seen[bin] += 1.0;
            }
            let chi2: f64 = seen.iter().zip(&expected).map(|(s, e): (&f64, &f64)| (s - e).powi(2) / e).sum();
            let dof = (seen.len() - 1) as f64;
            assert!((chi2 - dof).abs() < 4.5 * (2.0 * dof).sqrt().max(1.0), "mean {mean}: chi2 {chi2:.1} of {dof}");
        }
    }

    #[test]
    fn the_fast_path_agrees_with_the_exact_sums() {
        // The fraction of u for which the two differ, by stepping through u: as stated at `expanded`.
        for (mean, most) in [(24.0, 1.5e-4), (100.0, 2e-5)] {
            let p = probabilities(mean, 0..400);
            let (mut n, mut sum, mut wrong) = (0, p[0], 0);
            const STEPS: usize = 1_000_000;
            for i in 0..STEPS {
                let u = (i as f64 + 0.5) / STEPS as f64;
                while u > sum {
                    n += 1;
                    sum += p[n];
                }
                let got = expanded(mean, u) as usize;
                assert!(got.abs_diff(n) <= 1, "mean {mean}, u {u}: {got} {n}");
                wrong += usize::from(got != n);
            }
            assert!((wrong as f64) < most * STEPS as f64, "mean {mean}: {wrong} of {STEPS}");
        }
    }

    #[test]
    fn nothing_strange_happens_at_the_ends() {
        for u in [unit(0), unit(u64::MAX), 0.5] {
            assert!((0.0..1.0).contains(&u) && u > 0.0);
            for mean in [0.0, -1.0, f64::NAN, 1e-300, 23.999, 1e15, 1e30] {
                let n = poisson_quantile(mean, u);
                assert!(n >= 0.0 && n.is_finite(), "{mean} {u}: {n}");
                assert_eq!(poisson_quantile(f64::INFINITY, u), f64::INFINITY);
            }
        }
    }
}
