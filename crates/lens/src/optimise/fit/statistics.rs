//! What a least-squares fit says of its numbers: standard errors, correlations, and whether the residuals are those of the uncertainties.
//!
//! With residuals in units of their uncertainties the covariance of the fitted numbers is (JᵀJ)⁻¹, J the derivatives of the residuals (Press et al.,
//! "Numerical Recipes", §15.6; Bevington & Robinson, "Data Reduction and Error Analysis", ch. 8). It is right where the lens is and where the uncertainties are;
//! χ² says whether they may be.

use crate::linear::Cholesky;

/// What is known of the numbers of a fit.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Spread {
    /// Standard error of each number; `None` of what is held, of what no row depends on, and where numbers cannot be told apart.
    pub errors: Vec<Option<f64>>,
    /// Correlation of each pair, `[number][number]`; 0 where it is not known.
    pub correlations: Vec<Vec<f64>>,
    /// Condition number of the derivatives, each column brought to length 1 first; infinite where numbers cannot be told apart.
    pub condition: f64,
    /// Numbers that no row depends on.
    pub unseen: Vec<usize>,
}

/// From the derivatives of the residuals, a column a number; `held`: which numbers do not count (on a bound).
pub(super) fn spread(columns: &[Vec<f64>], held: &[bool]) -> Spread {
    let count = columns.len();
    let length = |c: &Vec<f64>| c.iter().map(|v| v * v).sum::<f64>().sqrt();
    let lengths: Vec<f64> = columns.iter().map(length).collect();
    let unseen: Vec<usize> = (0..count).filter(|i| !held[*i] && !(lengths[*i] > 0.0)).collect();
    let free: Vec<usize> = (0..count).filter(|i| !held[*i] && lengths[*i] > 0.0).collect();
    let size = free.len();
    let mut found = Spread { errors: vec![None; count], correlations: vec![vec![0.0; count]; count], condition: 1.0, unseen };
    (0..count).for_each(|i| found.correlations[i][i] = 1.0);
    let mut normal = vec![0.0; size * size];
    for (a, i) in free.iter().enumerate() {
        for (b, j) in free.iter().enumerate() {
            let sum: f64 = columns[*i].iter().zip(&columns[*j]).map(|(p, q)| p * q).sum();
            normal[a * size + b] = if a == b { 1.0 } else { sum / (lengths[*i] * lengths[*j]) };
        }
    }
    let Some(factor) = Cholesky::new(normal.clone(), size) else {
        // Columns that are multiples of each other: the numbers do the same.
        for (a, i) in free.iter().enumerate() {
            for (b, j) in free.iter().enumerate() {
                found.correlations[*i][*j] = if a == b { 1.0 } else { -normal[a * size + b] };
            }
        }
        found.condition = f64::INFINITY;
        return found;
    };
    let inverse: Vec<Vec<f64>> = (0..size)
        .map(|a| {
            let mut unit = vec![0.0; size];
            unit[a] = 1.0;
            factor.solve(&mut unit);
            unit
        })
        .collect();
    for (a, i) in free.iter().enumerate() {
        found.errors[*i] = Some(inverse[a][a].sqrt() / lengths[*i]);
        for (b, j) in free.iter().enumerate() {
            found.correlations[*i][*j] = inverse[a][b] / (inverse[a][a] * inverse[b][b]).sqrt();
        }
    }
    // In the norm of the largest column sum, which is within a factor of the size of that of the singular values.
    let norm = |row: &dyn Fn(usize, usize) -> f64| {
        (0..size).map(|a| (0..size).map(|b| row(a, b).abs()).sum::<f64>()).fold(0.0, f64::max)
    };
    found.condition = (norm(&|a, b| normal[a * size + b]) * norm(&|a, b| inverse[a][b])).sqrt();
    found
}

/// How many standard deviations a χ² lies above what its degrees of freedom let expect: the cube root of χ²/k is normal with mean 1 − 2/(9k) and
/// variance 2/(9k) nearly (Wilson & Hilferty 1931, Proc. Natl. Acad. Sci. 17, 684).
pub(super) fn deviations(chi_squared: f64, degrees: usize) -> f64 {
    let spread = 2.0 / (9.0 * degrees as f64);
    ((chi_squared / degrees as f64).cbrt() - (1.0 - spread)) / spread.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_line_has_the_errors_of_the_textbook() {
        // y = a + b x at x = 0..4 with σ = 0.5: Var a = σ² Σx²/Δ, Var b = σ² n/Δ, Δ = n Σx² − (Σx)² = 50 (Bevington & Robinson eq. 6.22).
        let columns = vec![vec![1.0 / 0.5; 5], (0..5).map(|x| f64::from(x) / 0.5).collect()];
        let found = spread(&columns, &[false, false]);
        let [a, b] = [found.errors[0].unwrap(), found.errors[1].unwrap()];
        assert!((a - 0.5 * (30.0f64 / 50.0).sqrt()).abs() < 1e-12 && (b - 0.5 * (5.0f64 / 50.0).sqrt()).abs() < 1e-12);
        // Covariance −σ² Σx/Δ.
        assert!((found.correlations[0][1] + 10.0 / 150.0f64.sqrt()).abs() < 1e-12, "{found:?}");
        let held = spread(&columns, &[false, true]);
        assert!((held.errors[0].unwrap() - 0.5 / 5f64.sqrt()).abs() < 1e-12 && held.errors[1].is_none());
    }

    #[test]
    fn numbers_that_do_the_same_are_found() {
        let columns = vec![vec![1.0, 2.0, 3.0], vec![2.0, 4.0, 6.0], vec![0.0; 3]];
        let found = spread(&columns, &[false; 3]);
        assert!(found.condition > 1e6 && found.correlations[0][1].abs() > 0.99 && found.unseen == [2], "{found:?}");
    }

    #[test]
    fn quantiles_of_chi_squared_are_as_many_deviations() {
        // 97.5 % points (1.96 standard deviations) of the tables: 11.143 for 4, 20.483 for 10, 129.561 for 100 degrees.
        for (chi, k) in [(11.143, 4), (20.483, 10), (129.561, 100)] {
            assert!((deviations(chi, k) - 1.96).abs() < 0.03, "{chi} {k} {}", deviations(chi, k));
        }
    }
}
