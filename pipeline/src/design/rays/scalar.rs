//! Number types for ray tracing: f64, or f64 with two partial derivatives (forward differentiation).
//!
//! A [`Dual`] has v, ∂v/∂p and ∂v/∂q for the pupil coordinates p, q; every operation applies the chain rule. So one trace gives a ray
//! and its exact derivatives, such as the Jacobian d(L, M)/d(p, q) of RI and PSF amplitudes, without a step size.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Number type of a ray's coordinates.
pub trait Scalar:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// A constant: its derivatives are 0.
    fn of(v: f64) -> Self;
    /// The value.
    fn value(self) -> f64;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Times a constant.
    fn times(self, factor: f64) -> Self;
}

impl Scalar for f64 {
    fn of(v: f64) -> Self {
        v
    }
    fn value(self) -> f64 {
        self
    }
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    fn times(self, factor: f64) -> Self {
        self * factor
    }
}

/// A value and its derivatives by two pupil coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dual {
    /// The value.
    pub v: f64,
    /// ∂v/∂p, ∂v/∂q.
    pub d: [f64; 2],
}

impl From<f64> for Dual {
    fn from(v: f64) -> Self {
        Self::of(v)
    }
}

impl Dual {
    /// A value with given derivatives.
    pub fn new(v: f64, dp: f64, dq: f64) -> Self {
        Self { v, d: [dp, dq] }
    }
}

impl Add for Dual {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self::new(self.v + o.v, self.d[0] + o.d[0], self.d[1] + o.d[1])
    }
}

impl Sub for Dual {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        Self::new(self.v - o.v, self.d[0] - o.d[0], self.d[1] - o.d[1])
    }
}

impl Mul for Dual {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        Self::new(self.v * o.v, self.d[0] * o.v + self.v * o.d[0], self.d[1] * o.v + self.v * o.d[1])
    }
}

impl Div for Dual {
    type Output = Self;
    fn div(self, o: Self) -> Self {
        let (v, inverse) = (self.v / o.v, 1.0 / o.v);
        Self::new(v, (self.d[0] - v * o.d[0]) * inverse, (self.d[1] - v * o.d[1]) * inverse)
    }
}

impl Neg for Dual {
    type Output = Self;
    fn neg(self) -> Self {
        Self::new(-self.v, -self.d[0], -self.d[1])
    }
}

impl Scalar for Dual {
    fn of(v: f64) -> Self {
        Self::new(v, 0.0, 0.0)
    }
    fn value(self) -> f64 {
        self.v
    }
    fn sqrt(self) -> Self {
        let v = self.v.sqrt();
        let slope = 0.5 / v;
        Self::new(v, slope * self.d[0], slope * self.d[1])
    }
    fn times(self, factor: f64) -> Self {
        Self::new(self.v * factor, self.d[0] * factor, self.d[1] * factor)
    }
}
