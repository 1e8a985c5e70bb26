//! Dual numbers: a value and its derivatives by N variables, exact by the chain rule.
//!
//! Formulas written over [`Number`] serve for values and for the Jacobians of fits and inversions alike. Source: Clifford 1873; as forward-mode automatic
//! differentiation: Griewank & Walther, *Evaluating Derivatives*, 2nd ed., §3.1.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// What the formulas of camera models are computed in.
pub trait Number:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// A number that depends on nothing.
    fn constant(value: f64) -> Self;
    /// Its value.
    fn value(self) -> f64;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Sine.
    fn sin(self) -> Self;
    /// Cosine.
    fn cos(self) -> Self;
    /// Angle of the point (x, `self`), −π to π.
    fn atan2(self, x: Self) -> Self;
    /// Without its sign.
    fn abs(self) -> Self {
        if self.value() < 0.0 { -self } else { self }
    }
    /// Times a number that depends on nothing.
    fn scaled(self, by: f64) -> Self {
        self * Self::constant(by)
    }
    /// Sum of many.
    fn sum(all: impl Iterator<Item = Self>) -> Self {
        all.fold(Self::constant(0.0), |sum, v| sum + v)
    }
}

impl Number for f64 {
    fn constant(value: f64) -> Self {
        value
    }
    fn value(self) -> f64 {
        self
    }
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    fn sin(self) -> Self {
        f64::sin(self)
    }
    fn cos(self) -> Self {
        f64::cos(self)
    }
    fn atan2(self, x: Self) -> Self {
        f64::atan2(self, x)
    }
}

/// A value and its derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dual<const N: usize> {
    /// The value.
    pub value: f64,
    /// By each variable.
    pub derivatives: [f64; N],
}

impl<const N: usize> Dual<N> {
    /// The variable of a number, at a value. Numbers count from 0; panics from N on.
    pub fn variable(value: f64, number: usize) -> Self {
        let mut derivatives = [0.0; N];
        derivatives[number] = 1.0;
        Dual { value, derivatives }
    }

    /// A function of one number with its derivative.
    fn chain(self, value: f64, slope: f64) -> Self {
        Dual { value, derivatives: self.derivatives.map(|d| d * slope) }
    }

    /// A function of two numbers with its derivatives.
    fn join(self, other: Self, value: f64, by_self: f64, by_other: f64) -> Self {
        let derivatives = std::array::from_fn(|i| by_self * self.derivatives[i] + by_other * other.derivatives[i]);
        Dual { value, derivatives }
    }
}

impl<const N: usize> Add for Dual<N> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        self.join(other, self.value + other.value, 1.0, 1.0)
    }
}

impl<const N: usize> Sub for Dual<N> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self.join(other, self.value - other.value, 1.0, -1.0)
    }
}

impl<const N: usize> Mul for Dual<N> {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        self.join(other, self.value * other.value, other.value, self.value)
    }
}

impl<const N: usize> Div for Dual<N> {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let ratio = self.value / other.value;
        self.join(other, ratio, 1.0 / other.value, -ratio / other.value)
    }
}

impl<const N: usize> Neg for Dual<N> {
    type Output = Self;
    fn neg(self) -> Self {
        self.chain(-self.value, -1.0)
    }
}

impl<const N: usize> Number for Dual<N> {
    fn constant(value: f64) -> Self {
        Dual { value, derivatives: [0.0; N] }
    }
    fn value(self) -> f64 {
        self.value
    }
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        // At 0 the slope is infinite; formulas here use the root of a squared radius only times something that is 0 there.
        self.chain(root, if root > 0.0 { 0.5 / root } else { 0.0 })
    }
    fn sin(self) -> Self {
        self.chain(self.value.sin(), self.value.cos())
    }
    fn cos(self) -> Self {
        self.chain(self.value.cos(), -self.value.sin())
    }
    fn atan2(self, x: Self) -> Self {
        let squared = self.value * self.value + x.value * x.value;
        self.join(x, self.value.atan2(x.value), x.value / squared, -self.value / squared)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn formula<T: Number>(a: T, b: T) -> T {
        let c = (a * a + b * b).sqrt() / (T::constant(2.0) + a.sin());
        c.atan2(b.cos()) - a * b / -c
    }

    #[test]
    fn derivatives_are_those_of_small_differences() {
        let (a, b, h) = (0.7, -0.4, 1e-6);
        let dual = formula(Dual::<2>::variable(a, 0), Dual::variable(b, 1));
        assert!((dual.value - formula(a, b)).abs() < 1e-15);
        let numeric = [(formula(a + h, b) - formula(a - h, b)) / (2.0 * h), (formula(a, b + h) - formula(a, b - h)) / (2.0 * h)];
        // Central differences are good to h² and rounding over h.
        for (exact, near) in dual.derivatives.iter().zip(numeric) {
            assert!((exact - near).abs() < 1e-8, "{exact} {near}");
        }
    }
}
