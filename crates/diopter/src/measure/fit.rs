//! Least squares of a few unknowns.

/// Solves a linear least-squares problem by its normal equations: `rows` of coefficients and right-hand sides. `None` where they do not determine
/// the unknowns. Columns should be of similar size (normal equations square the condition number).
pub(super) fn least_squares(rows: impl IntoIterator<Item = (Vec<f64>, f64)>, unknowns: usize) -> Option<Vec<f64>> {
    let mut a = vec![vec![0.0; unknowns + 1]; unknowns];
    for (row, value) in rows {
        for i in 0..unknowns {
            for j in 0..unknowns {
                a[i][j] += row[i] * row[j];
            }
            a[i][unknowns] += row[i] * value;
        }
    }
    // Gaussian elimination with partial pivoting.
    let largest = (0..unknowns).map(|i| a[i][i].abs()).fold(0.0, f64::max);
    for column in 0..unknowns {
        let pivot = (column..unknowns).max_by(|i, j| a[*i][column].abs().total_cmp(&a[*j][column].abs()))?;
        if !(a[pivot][column].abs() > 1e-13 * largest) {
            return None;
        }
        a.swap(column, pivot);
        for row in column + 1..unknowns {
            let factor = a[row][column] / a[column][column];
            for k in column..=unknowns {
                a[row][k] -= factor * a[column][k];
            }
        }
    }
    let mut x = vec![0.0; unknowns];
    for i in (0..unknowns).rev() {
        let known: f64 = (i + 1..unknowns).map(|j| a[i][j] * x[j]).sum();
        x[i] = (a[i][unknowns] - known) / a[i][i];
    }
    Some(x)
}

/// Coefficients of the polynomial Σ cᵢ xⁱ of an order nearest to points (x, y); x should lie within −1 to 1.
pub(super) fn polynomial(points: &[(f64, f64)], order: usize) -> Option<Vec<f64>> {
    let powers = |x: f64| (0..=order as i32).map(|k| x.powi(k)).collect::<Vec<_>>();
    least_squares(points.iter().map(|(x, y)| (powers(*x), *y)), order + 1)
}

/// Value of a polynomial Σ cᵢ xⁱ.
pub(super) fn value(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_polynomial_is_found_in_its_own_points() {
        let wanted = [0.3, -2.0, 0.5, 4.0];
        let points: Vec<(f64, f64)> = (0..9).map(|i| f64::from(i) / 4.0 - 1.0).map(|x| (x, value(&wanted, x))).collect();
        let found = polynomial(&points, 3).unwrap();
        assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-10), "{found:?}");
        // Two points do not determine a parabola.
        assert_eq!(polynomial(&points[..2], 2), None);
    }
}
