//! What compensators do to a build: damped least squares of the rays of all fields within how far each may move.

use super::assess::Assessment;
use super::parameter::perturbed;
use crate::bundle::Tracer;
use crate::optimise::{Residuals, levenberg_marquardt};
use crate::prescription::Prescription;
use crate::system::System;

/// Steps of central differences, as a fraction of how far a compensator may move.
const STEP: f64 = 1e-3;
/// Most iterations: spots are almost linear in small moves, three or four are usual.
const ITERATIONS: usize = 30;

/// The rays of all fields around their centroids, as functions of the compensators' amounts.
struct Blur<'a> {
    assessment: &'a Assessment,
    lens: &'a Prescription,
    bounds: Vec<[f64; 2]>,
    steps: Vec<f64>,
}

impl Residuals for Blur<'_> {
    fn at(&self, x: &[f64]) -> Option<Vec<f64>> {
        let a = self.assessment;
        let lens = perturbed(self.lens, &a.compensators, x).ok()?;
        a.blur(&Tracer::new(&System::at(&lens, a.state), &a.wavelengths))
    }

    fn bounds(&self) -> &[[f64; 2]] {
        &self.bounds
    }

    fn steps(&self) -> &[f64] {
        &self.steps
    }

    /// A build is no design: once the spots change by less than 1e-8 its adjustment is done.
    fn patience(&self) -> usize {
        1
    }
}

impl Assessment {
    /// Amounts of all compensators at which the mean square spot of all fields is smallest, within how far they may move, the film refocused with each
    /// trial; and the lens so adjusted (its film not moved). All 0 where a field has no light: nothing can be seen to adjust by.
    pub(super) fn adjusted(&self, lens: &Prescription) -> (Prescription, Vec<f64>) {
        let compensators = &self.compensators;
        let nothing = vec![0.0; compensators.len()];
        let ranges: Vec<f64> = compensators.iter().map(|c| c.half_range).collect();
        let blur = Blur {
            assessment: self,
            lens,
            bounds: ranges.iter().map(|r| [-r, *r]).collect(),
            steps: ranges.iter().map(|r| STEP * r).collect(),
        };
        let amounts = levenberg_marquardt(&blur, &nothing, ITERATIONS).map_or(nothing, |found| found.x);
        // No compensator touches an index, which alone can fail.
        let adjusted = perturbed(lens, compensators, &amounts).unwrap_or_else(|_| lens.clone());
        (adjusted, amounts)
    }
}
