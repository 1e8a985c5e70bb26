//! Russian roulette: where it is decided whether a path goes on (Arvo & Kirk 1990, "Particle transport and image synthesis", SIGGRAPH).
//!
//! Paths of the camera ask [`goes_on`]; paths of lamps, photons and transmittance estimates [`survives`], each with its own probability. Light paths that connect keep the
//! probability beside the vertex instead (`light_paths/vertices.rs`).

use diopter_light::SampledSpectrum;

/// Largest probability with which a path goes on where it is decided by chance, so that every path ends.
pub const MOST_SURVIVAL: f32 = 0.95;

/// How many of a picture's paths are worth following on after so many scattering events, of each that begins: where light that is scattered often is faint for what it
/// costs, fewer than throughputs alone would leave.
///
/// Error times cost, of which each number of events has its part, is least where the fraction of paths that go on is the root of the squared error that their light
/// brings over what it costs, relative to the same of whole paths. Source: A. Rath, P. Grittmann, S. Herholz, P. Weier & P. Slusallek 2022, "EARS:
/// Efficiency-Aware Russian Roulette and Splitting", ACM TOG 41(4), §3, here by the number of events alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RouletteRates([f32; RouletteRates::EVENTS.len()]);

impl RouletteRates {
    /// Scattering events from which on each of the rates counts.
    pub const EVENTS: [u32; 7] = [1, 2, 3, 4, 6, 9, 13];
    /// Least rate: where a trial saw nothing there may be some light.
    const LEAST: f64 = 0.1;

    /// The rates that make error times cost least. Of light with at most `EVENTS[0]` events its squared error and its cost, then, for each of
    /// [`RouletteRates::EVENTS`], the mean square and the cost of light of so many events that the next begin after them; costs and squares each in one unit. `None` where it is best to
    /// follow nearly all paths.
    pub fn best(first: [f64; 2], then: [[f64; 2]; RouletteRates::EVENTS.len()]) -> Option<RouletteRates> {
        /// Of the rate of the last: what is nearly 1 is not worth a decision.
        const ENOUGH: f64 = 0.7;
        // Paths that go on far have gone on before: a stage worth more than the one before it is asked about together with it (isotonic regression by pooling
        // adjacent violators). Error, cost and number of stages of each pool.
        let mut pools: Vec<([f64; 2], usize)> = Vec::new();
        for stage in then {
            pools.push((stage, 1));
            while let [.., (a, m), (b, n)] = pools[..]
                && b[0] * a[1] > a[0] * b[1]
            {
                pools.truncate(pools.len() - 2);
                pools.push(([a[0] + b[0], a[1] + b[1]], m + n));
            }
        }
        let pooled: Vec<[f64; 2]> = pools.iter().flat_map(|(pool, stages)| std::iter::repeat_n(*pool, *stages)).collect();
        let mut rates = [1.0f64; RouletteRates::EVENTS.len()];
        // Each depends on the sums of all.
        for _ in 0..32 {
            let [error, cost] =
                then.iter().zip(&rates).fold(first, |[error, cost], ([e, c], rate)| [error + e / rate, cost + c * rate]);
            let mut before = 1.0;
            for (rate, [e, c]) in rates.iter_mut().zip(&pooled) {
                // What nobody reached is as what comes before it.
                let best = if *c > 0.0 && error > 0.0 { (e / c * cost / error).sqrt() } else { before };
                *rate = best.clamp(Self::LEAST, 1.0);
                before = *rate;
            }
        }
        (rates[rates.len() - 1] < ENOUGH).then_some(RouletteRates(rates.map(|rate| rate as f32)))
    }

    /// The rate of going on after a number of events, above 0 and at most 1.
    #[inline]
    pub fn after(&self, events: u32) -> f32 {
        let stage = Self::EVENTS.iter().rposition(|first| *first <= events);
        stage.map_or(1.0, |stage| self.0[stage])
    }
}

/// Whether a path goes on from its vertex, by what it can still bring; its throughput is divided by the probability of that. Until vertex `depth` it always does where `rate` is 1
/// ([`RouletteRates`]). `most`: the largest probability.
#[inline]
pub fn goes_on(throughput: &mut SampledSpectrum, eta_scale: f32, vertex: u32, u: f32, depth: u32, most: f32, rate: f32) -> bool {
    vertex < depth && rate >= 1.0 || survives(throughput, (throughput.max_element() * eta_scale * rate).clamp(0.0, most), u)
}

/// Whether what is carried goes on, which happens with probability `survival`; it is divided by that. `u`: uniform in [0, 1).
#[inline]
pub fn survives(carried: &mut SampledSpectrum, survival: f32, u: f32) -> bool {
    *carried /= survival;
    u < survival
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_followed_as_far_as_their_light_is_worth() {
        let stages = RouletteRates::EVENTS.len();
        // Light that falls by ten with each stage, its square by a hundred; each stage costs as much as the first.
        let faint: Vec<[f64; 2]> = (1..=stages).map(|i| [0.01f64.powi(i as i32), 1.0]).collect();
        let rates = RouletteRates::best([1.0, 1.0], faint.clone().try_into().unwrap()).unwrap();
        assert_eq!([rates.after(0), rates.after(1), rates.after(13)], [1.0, rates.0[0], rates.after(1000)]);
        assert!((1..20).all(|n| rates.after(n + 1) <= rates.after(n)) && rates.after(20) == 0.1, "{rates:?}");
        // Error times cost is larger with all of them, and with a half or twice of what goes on first.
        let product = |rates: &[f64]| {
            let error = 1.0 + faint.iter().zip(rates).map(|(s, rate)| s[0] / rate).sum::<f64>();
            error * (1.0 + rates.iter().sum::<f64>())
        };
        let found = rates.0.map(f64::from);
        for factor in [0.5, 2.0] {
            let mut other = found;
            other[0] = (other[0] * factor).min(1.0);
            assert!(product(&found) < product(&other), "{factor}: {found:?}");
        }
        assert!(product(&found) < product(&[1.0; 7]));
        // Light that is noisy only where it is scattered often: to come there paths must go on before.
        let mut late = [[1e-4, 1.0]; 7];
        late[4] = [5.0, 1.0];
        let rates = RouletteRates::best([1.0, 1.0], late).unwrap();
        assert!(rates.after(1) == rates.after(6) && rates.after(1) > 0.8 && rates.after(9) == 0.1, "{rates:?}");
        // Where what comes later is as noisy for what it costs, all is followed; and where nothing was seen, or nothing costs.
        for then in [[1.0, 1.0], [0.0, 0.0]] {
            assert_eq!(RouletteRates::best([1.0, 1.0], [then; 7]), None);
        }
        assert_eq!(RouletteRates::best([0.0, 1.0], [[0.0, 1.0]; 7]), None);
    }
}
