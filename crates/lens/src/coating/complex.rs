//! Complex numbers, as far as thin films need them.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A complex number.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Complex {
    /// Real part.
    pub re: f64,
    /// Imaginary part.
    pub im: f64,
}

impl Complex {
    /// 1
    pub const ONE: Complex = Complex { re: 1.0, im: 0.0 };

    /// From its parts.
    pub const fn new(re: f64, im: f64) -> Complex {
        Complex { re, im }
    }

    /// |z|²
    pub fn norm_squared(self) -> f64 {
        self.re * self.re + self.im * self.im
    }

    /// Argument, −π to π.
    pub fn phase(self) -> f64 {
        self.im.atan2(self.re)
    }

    /// The square root with an imaginary part of 0 or more of a number whose imaginary part is 0 or more.
    pub fn upper_root(self) -> Complex {
        let size = self.re.hypot(self.im);
        // Each part from the sum that does not cancel.
        if self.re >= 0.0 {
            let re = (0.5 * (size + self.re)).sqrt();
            Complex::new(re, if re > 0.0 { 0.5 * self.im / re } else { 0.0 })
        } else {
            let im = (0.5 * (size - self.re)).sqrt();
            Complex::new(0.5 * self.im / im, im)
        }
    }

    /// exp(i z)
    pub fn exp_i(self) -> Complex {
        let size = (-self.im).exp();
        let (sin, cos) = self.re.sin_cos();
        Complex::new(size * cos, size * sin)
    }
}

impl From<f64> for Complex {
    fn from(re: f64) -> Complex {
        Complex::new(re, 0.0)
    }
}

impl Add for Complex {
    type Output = Complex;
    fn add(self, o: Complex) -> Complex {
        Complex::new(self.re + o.re, self.im + o.im)
    }
}

impl Sub for Complex {
    type Output = Complex;
    fn sub(self, o: Complex) -> Complex {
        Complex::new(self.re - o.re, self.im - o.im)
    }
}

impl Mul for Complex {
    type Output = Complex;
    fn mul(self, o: Complex) -> Complex {
        Complex::new(self.re * o.re - self.im * o.im, self.re * o.im + self.im * o.re)
    }
}

impl Mul<f64> for Complex {
    type Output = Complex;
    fn mul(self, o: f64) -> Complex {
        Complex::new(self.re * o, self.im * o)
    }
}

impl Div for Complex {
    type Output = Complex;
    fn div(self, o: Complex) -> Complex {
        let scale = 1.0 / o.norm_squared();
        Complex::new((self.re * o.re + self.im * o.im) * scale, (self.im * o.re - self.re * o.im) * scale)
    }
}

impl Neg for Complex {
    type Output = Complex;
    fn neg(self) -> Complex {
        Complex::new(-self.re, -self.im)
    }
}
