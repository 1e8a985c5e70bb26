//! The discrete Fourier transform of squares of numbers: radix 2 (Cooley & Tukey 1965).

use std::f64::consts::TAU;

/// Real and imaginary part.
pub(super) type Complex = [f64; 2];

/// Transforms a square of `side` × `side` numbers (rows one after the other) in place: Xₖ = Σ xⱼ exp(−2πi jk/n) along both. `side` is a
/// power of two.
pub(super) fn transform(data: &mut [Complex], side: usize) {
    assert!(side.is_power_of_two() && data.len() == side * side, "{} numbers, side {side}", data.len());
    let roots: Vec<Complex> = (0..side / 2)
        .map(|i| {
            let (sin, cos) = (-TAU * i as f64 / side as f64).sin_cos();
            [cos, sin]
        })
        .collect();
    for _ in 0..2 {
        for row in data.chunks_exact_mut(side) {
            // Rows of zero, the margin around a pupil, stay as they are.
            if row.iter().any(|v| *v != [0.0; 2]) {
                line(row, &roots);
            }
        }
        transpose(data, side);
    }
}

fn transpose(data: &mut [Complex], side: usize) {
    // In blocks that fit into the nearest cache.
    const BLOCK: usize = 16;
    for top in (0..side).step_by(BLOCK) {
        for left in (top..side).step_by(BLOCK) {
            for i in top..(top + BLOCK).min(side) {
                for j in left.max(i + 1)..(left + BLOCK).min(side) {
                    data.swap(i * side + j, j * side + i);
                }
            }
        }
    }
}

/// One line; `roots` are the first half of the unit roots, clockwise.
fn line(x: &mut [Complex], roots: &[Complex]) {
    let n = x.len();
    let bits = n.trailing_zeros();
    for i in 0..n {
        let j = if bits == 0 { 0 } else { i.reverse_bits() >> (usize::BITS - bits) };
        if i < j {
            x.swap(i, j);
        }
    }
    let mut half = 1;
    while half < n {
        let step = n / (2 * half);
        for block in x.chunks_exact_mut(2 * half) {
            let (low, high) = block.split_at_mut(half);
            for (k, (a, b)) in low.iter_mut().zip(high).enumerate() {
                let [c, s] = roots[k * step];
                let turned = [b[0] * c - b[1] * s, b[0] * s + b[1] * c];
                (*a, *b) = ([a[0] + turned[0], a[1] + turned[1]], [a[0] - turned[0], a[1] - turned[1]]);
            }
        }
        half *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_sum_that_defines_it() {
        for side in [1usize, 2, 8, 32] {
            let value = |i: usize| [((i * 37 + 11) % 29) as f64 - 14.0, ((i * 53 + 5) % 31) as f64 - 15.0];
            let given: Vec<Complex> = (0..side * side).map(value).collect();
            let mut found = given.clone();
            transform(&mut found, side);
            for place in [0, side * side / 3, side * side - 1] {
                let (row, column) = (place / side, place % side);
                let mut sum = [0.0; 2];
                for (i, [re, im]) in given.iter().enumerate() {
                    let turns = (row * (i / side) + column * (i % side)) as f64 / side as f64;
                    let (s, c) = (-TAU * turns).sin_cos();
                    sum = [sum[0] + re * c - im * s, sum[1] + re * s + im * c];
                }
                let off = f64::hypot(sum[0] - found[place][0], sum[1] - found[place][1]);
                assert!(off < 1e-9 * (side * side) as f64, "{side} {place}: {off}");
            }
            // Parseval.
            let energy = |v: &[Complex]| v.iter().map(|[a, b]| a * a + b * b).sum::<f64>();
            let ratio = energy(&found) / (energy(&given) * (side * side) as f64);
            assert!((ratio - 1.0).abs() < 1e-12, "{side}: {ratio}");
        }
    }
}
