//! Damped least squares within bounds, and a global search before it. Nothing here knows of lenses.

use crate::linear::Cholesky;
use crate::tolerance::{key, uniform};

/// Residuals at a point; `None` where there are none (a lens that lets no light through).
pub(crate) trait Residuals {
    /// All of them, in one order.
    fn at(&self, x: &[f64]) -> Option<Vec<f64>>;
    /// Smallest and largest value of each variable.
    fn bounds(&self) -> &[[f64; 2]];
    /// Steps of the central differences.
    fn steps(&self) -> &[f64];
    /// Derivatives of all residuals, a column a variable; `None` where they have no formula and differences must do.
    fn derivatives(&self, _: &[f64]) -> Option<Vec<Vec<f64>>> {
        None
    }
    /// How many steps one after another that change the merit by next to nothing end a search.
    fn patience(&self) -> usize {
        PATIENCE
    }
}

/// Why a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// The merit no longer becomes smaller: relative changes below 1e-8, several times.
    Converged,
    /// No step from here has a smaller merit: a minimum to rounding, or an edge beyond which rays are lost.
    NoBetterStep,
    /// As many steps as were allowed.
    Iterations,
}

impl std::fmt::Display for Stop {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(match self {
            Stop::Converged => "converged: the merit no longer becomes smaller",
            Stop::NoBetterStep => "no step from here has a smaller merit",
            Stop::Iterations => "stopped after the number of iterations allowed",
        })
    }
}

/// Where a search ended.
#[derive(Clone, Debug)]
pub(crate) struct Found {
    pub x: Vec<f64>,
    pub merit: f64,
    pub iterations: usize,
    pub stop: Stop,
}

/// Relative changes of the merit below this count as none.
const SMALL: f64 = 1e-8;
/// So many of them one after another, and it has converged.
const PATIENCE: usize = 5;
/// Damping beyond which steps are nothing.
const MOST_DAMPING: f64 = 1e16;

fn merit_of(r: &[f64]) -> f64 {
    r.iter().map(|r| r * r).sum()
}

/// Merit at a point; infinite where there is none.
pub(super) fn merit(problem: &impl Residuals, x: &[f64]) -> f64 {
    problem.at(x).map(|r| merit_of(&r)).filter(|m| m.is_finite()).unwrap_or(f64::INFINITY)
}

/// Derivatives of all residuals, a column a variable: exact where the problem knows them.
pub(super) fn jacobian(problem: &impl Residuals, x: &[f64], here: &[f64]) -> Vec<Vec<f64>> {
    problem.derivatives(x).unwrap_or_else(|| differences(problem, x, here))
}

/// The same by central differences, one-sided at a bound or where rays are lost.
pub(super) fn differences(problem: &impl Residuals, x: &[f64], here: &[f64]) -> Vec<Vec<f64>> {
    (0..x.len())
        .map(|i| {
            let ([low, high], step) = (problem.bounds()[i], problem.steps()[i]);
            // What is held by its bounds costs nothing.
            if low == high {
                return vec![0.0; here.len()];
            }
            let at = |v: f64| {
                let mut y = x.to_vec();
                y[i] = v.clamp(low, high);
                let moved = y[i] - x[i];
                problem.at(&y).map_or_else(|| (here.to_vec(), 0.0), |r| (r, moved))
            };
            let ((plus, right), (minus, left)) = (at(x[i] + step), at(x[i] - step));
            let width = right - left;
            plus.iter().zip(&minus).map(|(p, m)| if width > 0.0 { (p - m) / width } else { 0.0 }).collect()
        })
        .collect()
}

/// Levenberg–Marquardt from a start, within bounds: variables that a step would push out of their bounds stay on them; damping by
/// the gain ratio (Nielsen 1999, IMM-REP-1999-05; Madsen, Nielsen & Tingleff 2004, "Methods for Non-Linear Least Squares Problems",
/// §3.2), scaled by the diagonal (Marquardt 1963). `None` where the start has no merit.
pub(crate) fn levenberg_marquardt(problem: &impl Residuals, start: &[f64], most: usize) -> Option<Found> {
    let bounds = problem.bounds();
    let mut x: Vec<f64> = start.iter().zip(bounds).map(|(v, b)| v.clamp(b[0], b[1])).collect();
    let mut residuals = problem.at(&x)?;
    let mut merit = Some(merit_of(&residuals)).filter(|m| m.is_finite())?;
    let (mut damping, mut growth, mut small) = (1e-3f64, 2.0, 0);
    for iteration in 0..most {
        let columns = jacobian(problem, &x, &residuals);
        let gradient: Vec<f64> = columns.iter().map(|c| c.iter().zip(&residuals).map(|(a, b)| a * b).sum()).collect();
        // What stands on a bound and is pushed outwards is held; so is what changes nothing.
        let free: Vec<usize> = (0..x.len())
            .filter(|&i| {
                let [low, high] = bounds[i];
                let out = x[i] <= low && gradient[i] > 0.0 || x[i] >= high && gradient[i] < 0.0;
                !out && columns[i].iter().any(|v| *v != 0.0)
            })
            .collect();
        let size = free.len();
        let mut normal = vec![0.0; size * size];
        for (a, &i) in free.iter().enumerate() {
            for (b, &j) in free.iter().enumerate().take(a + 1) {
                let sum: f64 = columns[i].iter().zip(&columns[j]).map(|(p, q)| p * q).sum();
                normal[a * size + b] = sum;
                normal[b * size + a] = sum;
            }
        }
        loop {
            if free.is_empty() || damping > MOST_DAMPING {
                // A variable that neither side lets move, because rays are lost there, is no sign of a minimum.
                let stuck = free.is_empty() && columns.iter().any(|c| c.iter().all(|v| *v == 0.0));
                let stop = if (small > 0 || free.is_empty()) && !stuck { Stop::Converged } else { Stop::NoBetterStep };
                return Some(Found { x, merit, iterations: iteration, stop });
            }
            let mut damped = normal.clone();
            (0..size).for_each(|a| damped[a * size + a] *= 1.0 + damping);
            let mut trial = x.clone();
            let mut predicted = 0.0;
            let Some(factor) = Cholesky::new(damped, size) else {
                damping = (damping * growth).max(1e-12);
                growth *= 2.0;
                continue;
            };
            let mut step: Vec<f64> = free.iter().map(|i| -gradient[*i]).collect();
            factor.solve(&mut step);
            for (a, &i) in free.iter().enumerate() {
                trial[i] = (x[i] + step[a]).clamp(bounds[i][0], bounds[i][1]);
                // What the linear model promises of the merit: s (λ D s − g).
                predicted += step[a] * (damping * normal[a * size + a] * step[a] - gradient[i]);
            }
            let tried = problem.at(&trial);
            let lower = tried.map(|r| (merit_of(&r), r)).filter(|(m, _)| *m < merit);
            match lower {
                Some((m, r)) => {
                    let gain = if predicted > 0.0 { (merit - m) / predicted } else { 0.5 };
                    damping = (damping * (1.0 - (2.0 * gain - 1.0).powi(3)).clamp(1.0 / 3.0, 2.0)).max(1e-14);
                    growth = 2.0;
                    small = if merit - m < SMALL * merit { small + 1 } else { 0 };
                    (x, merit, residuals) = (trial, m, r);
                    break;
                }
                None => {
                    damping *= growth;
                    growth *= 2.0;
                }
            }
        }
        if small >= problem.patience() || merit == 0.0 {
            return Some(Found { x, merit, iterations: iteration + 1, stop: Stop::Converged });
        }
    }
    Some(Found { x, merit, iterations: most, stop: Stop::Iterations })
}

/// Mutation factor and crossover rate of the differential evolution.
const MUTATION: f64 = 0.6;
const CROSSOVER: f64 = 0.9;
/// Members for each variable, and most of them.
const MEMBERS: usize = 10;
const MOST_MEMBERS: usize = 200;

/// Differential evolution, DE/rand/1/bin (Storn & Price 1997, J. Global Optim. 11, 341), over the box of the bounds; the start is one
/// of the first members. Every number is a pure function of seed, generation and member.
pub(super) fn differential_evolution(problem: &impl Residuals, start: &[f64], generations: usize, seed: u64) -> Vec<f64> {
    let (bounds, size) = (problem.bounds(), start.len());
    let members = (MEMBERS * size).clamp(20, MOST_MEMBERS);
    let mut all: Vec<(Vec<f64>, f64)> = (0..members)
        .map(|m| {
            let k = key(&[seed, u64::MAX, m as u64]);
            let place = |i: usize| bounds[i][0] + (bounds[i][1] - bounds[i][0]) * uniform(k, i as u64);
            let x: Vec<f64> = if m == 0 { start.to_vec() } else { (0..size).map(place).collect() };
            let merit = merit(problem, &x);
            (x, merit)
        })
        .collect();
    for generation in 0..generations {
        let next: Vec<(Vec<f64>, f64)> = (0..members)
            .map(|m| {
                let k = key(&[seed, generation as u64, m as u64]);
                // Three others, all different: each draw skips the ones before it.
                let mut taken = vec![m];
                for d in 0..3 {
                    let mut pick = (uniform(k, d) * (members - taken.len()) as f64) as usize;
                    let mut sorted = taken.clone();
                    sorted.sort_unstable();
                    sorted.iter().for_each(|t| pick += (*t <= pick) as usize);
                    taken.push(pick);
                }
                let [a, b, c] = [1, 2, 3].map(|i| &all[taken[i]].0);
                let always = (uniform(k, 3) * size as f64) as usize;
                let x: Vec<f64> = (0..size)
                    .map(|i| {
                        if i != always && uniform(k, 4 + 2 * i as u64) >= CROSSOVER {
                            return all[m].0[i];
                        }
                        let [low, high] = bounds[i];
                        let v = a[i] + MUTATION * (b[i] - c[i]);
                        // Beyond a bound: somewhere between it and where the member stood.
                        let back = |edge: f64| edge + (all[m].0[i] - edge) * uniform(k, 5 + 2 * i as u64);
                        if v < low {
                            back(low)
                        } else if v > high {
                            back(high)
                        } else {
                            v
                        }
                    })
                    .collect();
                let merit = merit(problem, &x);
                if merit <= all[m].1 { (x, merit) } else { all[m].clone() }
            })
            .collect();
        all = next;
    }
    all.into_iter().min_by(|a, b| a.1.total_cmp(&b.1)).map_or(start.to_vec(), |best| best.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rosenbrock's valley as residuals, minimum 0 at (1, 1).
    struct Valley {
        bounds: Vec<[f64; 2]>,
    }

    impl Residuals for Valley {
        fn at(&self, x: &[f64]) -> Option<Vec<f64>> {
            Some(vec![10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]])
        }
        fn bounds(&self) -> &[[f64; 2]] {
            &self.bounds
        }
        fn steps(&self) -> &[f64] {
            &[1e-6, 1e-6]
        }
    }

    /// Rastrigin's function: a hundred local minima, the lowest at (0.3, 0.3).
    struct Hills;

    impl Residuals for Hills {
        fn at(&self, x: &[f64]) -> Option<Vec<f64>> {
            let term = |v: f64| ((v - 0.3).powi(2) + 10.0 * (1.0 - (std::f64::consts::TAU * (v - 0.3)).cos())).max(0.0).sqrt();
            Some(x.iter().map(|v| term(*v)).collect())
        }
        fn bounds(&self) -> &[[f64; 2]] {
            &[[-5.12, 5.12]; 2]
        }
        fn steps(&self) -> &[f64] {
            &[1e-6; 2]
        }
    }

    #[test]
    fn the_valley_is_followed_to_its_end_and_bounds_hold() {
        let free = Valley { bounds: vec![[-5.0, 5.0]; 2] };
        let found = levenberg_marquardt(&free, &[-1.2, 1.0], 200).unwrap();
        assert!(found.merit < 1e-16 && found.x.iter().all(|v| (v - 1.0).abs() < 1e-7), "{found:?}");
        // With x ≤ 0.5 the minimum lies on the bound: (1 − 0.5)² at y = x².
        let bound = Valley { bounds: vec![[-5.0, 0.5], [-5.0, 5.0]] };
        let found = levenberg_marquardt(&bound, &[-1.2, 1.0], 200).unwrap();
        assert!(found.x[0] == 0.5 && (found.x[1] - 0.25).abs() < 1e-6 && (found.merit - 0.25).abs() < 1e-9, "{found:?}");
    }

    #[test]
    fn the_global_search_finds_the_lowest_of_many_minima() {
        let start = [-3.7, 4.3];
        let best = differential_evolution(&Hills, &start, 150, 1);
        // The next lowest minima have a merit of 1.
        assert!(merit(&Hills, &start) > 30.0 && merit(&Hills, &best) < 0.5, "{best:?}");
        let found = levenberg_marquardt(&Hills, &best, 100).unwrap();
        assert!(found.merit < 1e-6, "{found:?}");
        assert_eq!(best, differential_evolution(&Hills, &start, 150, 1), "the same seed is the same search");
    }
}
