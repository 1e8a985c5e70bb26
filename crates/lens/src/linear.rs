//! Small dense linear algebra: symmetric positive definite systems, and the nodes of Gauss–Legendre quadrature.

/// Cholesky factor of a symmetric positive definite matrix.
#[derive(Clone, Debug)]
pub(crate) struct Cholesky {
    /// Lower triangle, `[row][column]`, rows of `size`.
    lower: Vec<f64>,
    size: usize,
}

impl Cholesky {
    /// The decomposition of a matrix in rows of `size`; `None` where it is not positive definite. Source: Golub & Van Loan, "Matrix Computations",
    /// §4.2. Panics unless `a` has `size`² numbers.
    pub fn new(mut a: Vec<f64>, size: usize) -> Option<Cholesky> {
        assert!(a.len() == size * size, "{} numbers for a matrix of {size} rows", a.len());
        for i in 0..size {
            for j in 0..=i {
                let sum = a[i * size + j] - (0..j).map(|k| a[i * size + k] * a[j * size + k]).sum::<f64>();
                if i == j {
                    if !(sum > 0.0 && sum.is_finite()) {
                        return None;
                    }
                    a[i * size + i] = sum.sqrt();
                } else {
                    a[i * size + j] = sum / a[j * size + j];
                }
            }
        }
        Some(Cholesky { lower: a, size })
    }

    /// Solves for a right side, in place. `b`: a number for each row.
    pub fn solve(&self, b: &mut [f64]) {
        let (l, n) = (&self.lower, self.size);
        for i in 0..n {
            let sum = (0..i).map(|k| l[i * n + k] * b[k]).sum::<f64>();
            b[i] = (b[i] - sum) / l[i * n + i];
        }
        for i in (0..n).rev() {
            let sum = (i + 1..n).map(|k| l[k * n + i] * b[k]).sum::<f64>();
            b[i] = (b[i] - sum) / l[i * n + i];
        }
    }
}

/// Nodes and weights of Gauss–Legendre quadrature on 0..1 (the weights sum to 1), ascending. Source: Abramowitz & Stegun 25.4.30;
/// the roots by Newton's method from cos(π (i + 3/4) / (n + 1/2)).
pub(crate) fn gauss_legendre(count: usize) -> Vec<[f64; 2]> {
    let n = count as f64;
    let mut nodes: Vec<[f64; 2]> = (0..count)
        .map(|i| {
            let mut x = (std::f64::consts::PI * (i as f64 + 0.75) / (n + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..50 {
                // P_k by its recurrence, P'_n from P_n and P_{n-1}.
                let (mut p, mut before) = (x, 1.0);
                for k in 2..=count {
                    let k = k as f64;
                    (p, before) = (((2.0 * k - 1.0) * x * p - (k - 1.0) * before) / k, p);
                }
                slope = n * (x * p - before) / (x * x - 1.0);
                let step = p / slope;
                x -= step;
                if step.abs() < 1e-15 {
                    break;
                }
            }
            [0.5 * (1.0 + x), 1.0 / ((1.0 - x * x) * slope * slope)]
        })
        .collect();
    nodes.reverse();
    nodes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quadrature_integrates_polynomials_of_twice_the_degree() {
        for count in 2..9 {
            let nodes = gauss_legendre(count);
            for power in 0..2 * count {
                let sum: f64 = nodes.iter().map(|[x, w]| w * x.powi(power as i32)).sum();
                // Rounding only: Gauss's rule is exact up to degree 2n − 1.
                assert!((sum - 1.0 / (power as f64 + 1.0)).abs() < 1e-14, "{count} {power} {sum}");
            }
            let sum: f64 = nodes.iter().map(|[x, w]| w * x.powi(2 * count as i32)).sum();
            assert!((sum - 1.0 / (2.0 * count as f64 + 1.0)).abs() > 1e-12);
        }
    }

    #[test]
    fn a_factor_solves_its_system() {
        let a = vec![4.0, 2.0, 0.6, 2.0, 5.0, 1.0, 0.6, 1.0, 3.0];
        let x = [1.0, -2.0, 0.5];
        let mut b: Vec<f64> = (0..3).map(|i| (0..3).map(|j| a[3 * i + j] * x[j]).sum()).collect();
        Cholesky::new(a, 3).unwrap().solve(&mut b);
        assert!(b.iter().zip(x).all(|(b, x)| (b - x).abs() < 1e-14), "{b:?}");
        assert!(Cholesky::new(vec![1.0, 2.0, 2.0, 1.0], 2).is_none());
    }
}
