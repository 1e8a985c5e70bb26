//! Random numbers as pure functions of (seed, pixel, sample, set): no state, so any thread can draw any sample.
//!
//! Numbers come in sets of four. A set is a name for one decision of a path ([`Dimensions`]); its four numbers are well spread
//! together, and different sets are independent. All samplers stand behind [`Sampler`]:
//!
//! * `Sobol`: Owen-scrambled, index-shuffled 4-D Sobol points, padded. Source: Burley 2020, "Practical Hash-based Owen
//!   Scrambling", JCGT 9(4); direction numbers of Joe & Kuo 2008; the hash is Vegdahl's improvement of Laine & Karras.
//! * `Jittered`: each pair of numbers stratified over a grid of about √n × √n cells, in random order. Source: Kensler
//!   2013, "Correlated Multi-Jittered Sampling" (its permutation; without the correlation).
//! * `Grid`: sub-pixel positions on a regular grid, everything else independent.
//! * `Independent`: hashes.
//!
//! Even and odd samples are two independent replicates with scrambles of their own. Half the difference of their means is
//! an honest error estimate even where the points within a replicate are not independent (see `FocalPlane`).

mod sobol;

/// How the samples of a pixel are spread.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum SamplerKind {
    /// Unrelated samples.
    Independent,
    /// Regular sub-pixel grid.
    Grid,
    /// Stratified pairs.
    Jittered,
    /// Owen-scrambled Sobol points.
    #[default]
    Sobol,
}

/// A decision of a path that needs up to four numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Dimensions {
    /// Position in the pixel (2), position in the pupil (2).
    Camera,
    /// Wavelength, time.
    Time,
    /// Choice of a light and the point on it, at the given vertex.
    Light(u32),
    /// Choice of a lobe, direction and Russian roulette, at the given vertex.
    Scatter(u32),
    /// How far light goes through a medium, on the given segment of the path.
    Medium(u32),
    /// Light that is scattered into the given segment of the path: choice of a light, distance along the segment, point on the light.
    Inscatter(u32),
    /// The numbers of [`Dimensions::Camera`] once more, where those before met nothing, at the given attempt (from 1).
    Redraw(u32),
    /// How far diffraction moves light on the film (2) of a sample (0), and of the light that a lamp sends far out (1, 2).
    Diffraction(u32),
    /// Tracking through a medium that differs from place to place, on the given segment of the path ([`Sampler::stream`]).
    Tracking(u32),
    /// Transmittance towards a light from the given vertex ([`Sampler::stream`]).
    Transmittance(u32),
    /// Choice of light vertices to connect with from the given vertex ([`Sampler::stream`]).
    Connection(u32),
    /// A direction near a light from the given vertex, and where on its way that light is scattered ([`Sampler::stream`]).
    Joint(u32),
    /// What shines along specular lobes that were not chosen at the given vertex ([`Sampler::stream`]).
    Splitting(u32),
    /// How light that was sampled from the given vertex comes through glass ([`Sampler::stream`]).
    Refracted(u32),
    /// A light (2) whose image in a mirror (3) is sampled from the given vertex, where on the light (0, 1), and how it comes from there ([`Sampler::stream`]).
    Mirrored(u32),
}

impl Dimensions {
    fn number(self) -> u32 {
        match self {
            Dimensions::Camera => 0,
            Dimensions::Time => 1,
            Dimensions::Light(vertex) => 2 + 2 * vertex,
            Dimensions::Scatter(vertex) => 3 + 2 * vertex,
            Dimensions::Medium(segment) => (1 << 24) + segment,
            Dimensions::Redraw(attempt) => (1 << 25) + attempt,
            Dimensions::Inscatter(segment) => (5 << 24) + segment,
            Dimensions::Diffraction(part) => (6 << 24) + part,
            Dimensions::Tracking(segment) => (8 << 24) + segment,
            Dimensions::Transmittance(vertex) => (7 << 24) + vertex,
            Dimensions::Connection(vertex) => (9 << 24) + vertex,
            Dimensions::Joint(vertex) => (10 << 24) + vertex,
            Dimensions::Splitting(vertex) => (11 << 24) + vertex,
            Dimensions::Refracted(vertex) => (12 << 24) + vertex,
            Dimensions::Mirrored(vertex) => (13 << 24) + vertex,
        }
    }
}

/// Integer hash with good avalanche; 0 stays 0. Source: Wellons, "lowbias32" (hash-prospector).
#[inline]
pub fn mix(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// The 24 upper bits as a number in [0, 1).
#[inline]
pub fn to_unit(x: u32) -> f32 {
    (x >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// A pseudo-random permutation of 0..n, evaluated at i. Source: Kensler 2013, listing 3.
fn permute(mut i: u32, n: u32, seed: u32) -> u32 {
    let mut w = n - 1;
    w |= w >> 1;
    w |= w >> 2;
    w |= w >> 4;
    w |= w >> 8;
    w |= w >> 16;
    loop {
        i ^= seed;
        i = i.wrapping_mul(0xe170_893d);
        i ^= seed >> 16;
        i ^= (i & w) >> 4;
        i ^= seed >> 8;
        i = i.wrapping_mul(0x0929_eb3f);
        i ^= seed >> 23;
        i ^= (i & w) >> 1;
        i = i.wrapping_mul(1 | seed >> 27);
        i = i.wrapping_mul(0x6935_fa69);
        i ^= (i & w) >> 11;
        i = i.wrapping_mul(0x74dc_b303);
        i ^= (i & w) >> 2;
        i = i.wrapping_mul(0x9e50_1cc3);
        i ^= (i & w) >> 2;
        i = i.wrapping_mul(0xc860_a3df);
        i &= w;
        i ^= i >> 5;
        if i < n {
            return (i.wrapping_add(seed)) % n;
        }
    }
}

/// An endless sequence of independent numbers, for loops of which nobody knows how many they need: SplitMix64. Source: Steele, Lea & Flood 2014,
/// "Fast Splittable Pseudorandom Number Generators".
#[derive(Clone, Debug)]
pub struct Stream {
    state: u64,
}

impl Stream {
    /// The next number in [0, 1).
    #[inline]
    pub fn draw(&mut self) -> f32 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        to_unit(((z ^ (z >> 31)) >> 32) as u32)
    }
}

/// The numbers of one sample of one pixel.
#[derive(Clone, Copy, Debug)]
pub struct Sampler {
    kind: SamplerKind,
    /// Hash of seed, pixel and replicate.
    seed: u32,
    /// Index within the replicate.
    index: u32,
    /// Its 16 low bits, reversed.
    reversed_index: u16,
    /// Samples in the replicate when all are rendered: the strata of `Jittered`.
    count: u32,
    /// Index and number of samples of both replicates: the grid of `Grid`.
    whole: (u32, u32),
}

impl Sampler {
    /// Numbers of sample `index` (from 0, of `count` in all) of `pixel` (column, row) under `seed`.
    pub fn new(kind: SamplerKind, seed: u64, pixel: (u32, u32), index: u32, count: u32) -> Self {
        let replicate = index & 1;
        let seed = mix(seed as u32 ^ mix((seed >> 32) as u32 ^ 0x68bc_21eb));
        let seed = mix(seed ^ mix(pixel.0 ^ mix(pixel.1.wrapping_add(0x2545_f491).wrapping_add(replicate << 31))));
        let (whole, index) = ((index, count.max(1)), index >> 1);
        Sampler { kind, seed, index, reversed_index: (index as u16).reverse_bits(), count: count.div_ceil(2).max(1), whole }
    }

    /// 0 or 1: which of the two independent halves of the samples this one belongs to.
    pub fn replicate(&self) -> usize {
        (self.whole.0 & 1) as usize
    }

    /// Number of the sample among those of its pixel, from 0.
    pub fn number(&self) -> u32 {
        self.whole.0
    }

    /// What the numbers of a set are made from.
    #[inline(always)]
    fn seed_of(&self, set: Dimensions) -> u32 {
        mix(self.seed.wrapping_add(set.number().wrapping_mul(0x9e37_79b9)))
    }

    /// Sobol points repeat after 2¹⁶ of a replicate; later ones get other scrambles.
    #[inline(always)]
    fn scrambled(&self, seed: u32) -> u32 {
        if self.index >> 16 == 0 { seed } else { mix(seed ^ (self.index >> 16)) }
    }

    /// The numbers of two sets; Sobol points in the lanes of one vector, bit by bit those of [`Sampler::get`].
    #[inline]
    pub fn get_two(&self, sets: [Dimensions; 2]) -> [[f32; 4]; 2] {
        match self.kind {
            SamplerKind::Sobol => sobol::two_points(sets.map(|set| self.scrambled(self.seed_of(set))), self.reversed_index),
            _ => sets.map(|set| self.get(set)),
        }
    }

    /// Four numbers in [0, 1).
    #[inline(always)]
    pub fn get(&self, set: Dimensions) -> [f32; 4] {
        let seed = self.seed_of(set);
        match self.kind {
            SamplerKind::Sobol => sobol::point(self.scrambled(seed), self.reversed_index),
            SamplerKind::Independent => self.independent(seed),
            SamplerKind::Jittered => {
                let (a, b) = (self.jittered(seed), self.jittered(mix(seed ^ 0x5bd1_e995)));
                [a.0, a.1, b.0, b.1]
            }
            SamplerKind::Grid => {
                let mut numbers = self.independent(seed);
                if set == Dimensions::Camera {
                    // Cells of a grid as square as the count allows; the film position is the middle of a cell.
                    let columns = (self.whole.1 as f32).sqrt().ceil() as u32;
                    let rows = self.whole.1.div_ceil(columns);
                    // In mixed order, the same for both replicates, so that any part of the samples covers the pixel.
                    let cell = permute(self.whole.0 % self.whole.1, self.whole.1, 0x51ab_3c17);
                    numbers[0] = ((cell % columns) as f32 + 0.5) / columns as f32;
                    numbers[1] = ((cell / columns) as f32 + 0.5) / rows as f32;
                }
                numbers
            }
        }
    }

    /// As many numbers as a decision needs, independent of those of other decisions, samples and pixels; not stratified.
    pub fn stream(&self, set: Dimensions) -> Stream {
        let seed = self.seed_of(set);
        Stream { state: (u64::from(seed) << 32) | u64::from(self.index) }
    }

    #[inline]
    fn independent(&self, seed: u32) -> [f32; 4] {
        let base = mix(seed ^ mix(self.index.wrapping_add(0xb529_7a4d)));
        std::array::from_fn(|d| to_unit(mix(base.wrapping_add((d as u32 + 1).wrapping_mul(0x68e3_1da4)))))
    }

    fn jittered(&self, seed: u32) -> (f32, f32) {
        let columns = (self.count as f32).sqrt() as u32;
        let rows = self.count.div_ceil(columns);
        let cell = permute(self.index % self.count, self.count, seed);
        let jitter = |k: u32| to_unit(mix(seed ^ mix(self.index.wrapping_mul(2).wrapping_add(k) ^ 0x1b56_c4e9)));
        // Cells are taken in order of a count that may not fill the last row: spread it over the whole height.
        let (x, y) = (cell / rows, cell % rows);
        if columns * rows == self.count {
            ((x as f32 + jitter(0)) / columns as f32, (y as f32 + jitter(1)) / rows as f32)
        } else {
            // Not a product: stratify both numbers alone (Latin hypercube) instead of leaving cells empty.
            let other = permute(self.index % self.count, self.count, mix(seed ^ 0xa511_e9b3));
            ((cell as f32 + jitter(0)) / self.count as f32, (other as f32 + jitter(1)) / self.count as f32)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KINDS: [SamplerKind; 4] = [SamplerKind::Independent, SamplerKind::Grid, SamplerKind::Jittered, SamplerKind::Sobol];

    #[test]
    fn every_pair_of_numbers_is_uniform_by_chi_square() {
        // Pool many pixels: each sampler's points of a set, in 8 × 8 cells. Stratified points spread better than random
        // ones, so χ² is bounded from above only; 150 is beyond the 99.9999 % quantile at 63 degrees of freedom.
        for kind in KINDS {
            for set in [Dimensions::Camera, Dimensions::Time, Dimensions::Light(0), Dimensions::Scatter(5)] {
                for (a, b) in [(0, 1), (0, 2), (2, 3), (1, 3)] {
                    if kind == SamplerKind::Grid && set == Dimensions::Camera && a < 2 {
                        continue;
                    }
                    let mut cells = [0.0f64; 64];
                    for pixel in 0..400 {
                        for index in 0..32 {
                            let u = Sampler::new(kind, 7, (pixel % 20, pixel / 20), index, 32).get(set);
                            assert!(u.iter().all(|x| (0.0..1.0).contains(x)));
                            cells[(u[a] * 8.0) as usize * 8 + (u[b] * 8.0) as usize] += 1.0;
                        }
                    }
                    let expected = 400.0 * 32.0 / 64.0;
                    let chi2: f64 = cells.iter().map(|c| (c - expected).powi(2) / expected).sum();
                    assert!(chi2 < 150.0, "{kind:?} {set:?} {a}{b}: χ² {chi2}");
                }
            }
        }
    }

    #[test]
    fn sets_are_uncorrelated_with_one_another() {
        for kind in KINDS {
            let n = 20_000;
            let mut sum = 0.0;
            for i in 0..n {
                let s = Sampler::new(kind, 3, (i % 97, i / 97), i % 16, 16);
                sum += (s.get(Dimensions::Light(0))[0] as f64 - 0.5) * (s.get(Dimensions::Scatter(0))[0] as f64 - 0.5);
            }
            // Standard deviation of the mean of a product of two uniforms: 1/12/√n.
            let limit = 4.5 / 12.0 / (n as f64).sqrt();
            assert!((sum / n as f64).abs() < limit, "{kind:?} {}", sum / n as f64);
        }
    }

    #[test]
    fn streams_are_uniform_and_differ_by_sample_set_and_replicate() {
        // 64 cells of successive pairs; 150 is beyond the 99.9999 % quantile of χ² at 63 degrees of freedom.
        let mut cells = [0.0f64; 64];
        let mut firsts = std::collections::HashSet::new();
        for pixel in 0..100 {
            for index in 0..32 {
                let sampler = Sampler::new(SamplerKind::Sobol, 7, (pixel, 3), index, 32);
                let mut stream = sampler.stream(Dimensions::Tracking(1));
                firsts.insert(stream.clone().draw().to_bits());
                firsts.insert(sampler.stream(Dimensions::Tracking(2)).draw().to_bits());
                firsts.insert(sampler.stream(Dimensions::Transmittance(1)).draw().to_bits());
                for _ in 0..4 {
                    let (a, b) = (stream.draw(), stream.draw());
                    assert!((0.0..1.0).contains(&a) && (0.0..1.0).contains(&b));
                    cells[(a * 8.0) as usize * 8 + (b * 8.0) as usize] += 1.0;
                }
            }
        }
        let expected = 100.0 * 32.0 * 4.0 / 64.0;
        let chi2: f64 = cells.iter().map(|c| (c - expected).powi(2) / expected).sum();
        assert!(chi2 < 150.0, "χ² {chi2}");
        // Of 9600 draws from 2²⁴ values about 3 pairs coincide.
        assert!(firsts.len() > 9580, "{}", firsts.len());
    }

    #[test]
    fn two_sets_at_a_time_are_those_taken_one_by_one() {
        for kind in KINDS {
            for (index, vertex) in (0..200).map(|k| (k * 7919, k % 9)) {
                let sampler = Sampler::new(kind, 11, (index, 3), index, 400);
                let sets = [Dimensions::Light(vertex), Dimensions::Scatter(vertex)];
                assert_eq!(sampler.get_two(sets), sets.map(|set| sampler.get(set)), "{kind:?} {index}");
            }
        }
    }

    #[test]
    fn sobol_points_are_a_net_in_the_first_two_dimensions() {
        // 64 points: one in each elementary interval 1/2ᵃ × 1/2ᵇ, a + b = 6.
        for pixel in 0..10 {
            for a in 0..=6u32 {
                let (w, h) = (1u32 << a, 1u32 << (6 - a));
                let mut seen = [false; 64];
                for index in 0..64 {
                    let u = Sampler::new(SamplerKind::Sobol, 1, (pixel, 0), 2 * index, 128).get(Dimensions::Light(2));
                    let cell = (u[0] * w as f32) as u32 + w * (u[1] * h as f32) as u32;
                    assert!(!std::mem::replace(&mut seen[cell as usize], true), "two points in cell {cell} of {w}×{h}");
                }
            }
        }
    }

    #[test]
    fn grid_covers_the_pixel_regularly() {
        let mut xs: Vec<f32> =
            (0..16).map(|i| Sampler::new(SamplerKind::Grid, 1, (0, 0), i, 16).get(Dimensions::Camera)[0]).collect();
        xs.sort_by(f32::total_cmp);
        assert_eq!(xs[0], 0.125);
        assert_eq!(xs[15], 0.875);
    }

    #[test]
    fn any_number_of_jittered_samples_is_stratified() {
        for count in [2u32, 6, 14, 18, 100, 101] {
            let n = count.div_ceil(2);
            let mut seen = vec![0; n as usize];
            for i in 0..n {
                let u = Sampler::new(SamplerKind::Jittered, 5, (1, 1), 2 * i, count).get(Dimensions::Light(0));
                seen[(u[1] * n as f32) as usize % n as usize] += 1;
            }
            assert!(seen.iter().all(|c| *c <= 4), "{count}: {seen:?}");
        }
    }
}
