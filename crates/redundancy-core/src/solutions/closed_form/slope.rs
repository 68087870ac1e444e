//! Ranges of a quantity together with its value in the middle and the range of its derivative.
//!
//! The plain range of an expression overestimates what it takes in proportion to the width of the interval. By the mean value
//! theorem `f(w) = f(m) + f'(v) (w - m)` for some v between w and m, so that the value in the middle and the range of the
//! derivative bound f up to the square of the width. That decides smooth maxima, where plain ranges would need intervals
//! as short as the gap that is to be shown.

use std::ops::{Add, Mul, Neg, Sub};

use super::interval::{Enclosure, Interval, point};
use crate::joint_space::nearest;

/// A quantity over an interval whose parameter is scaled to `[-1, 1]`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sloped {
    value: Interval,
    /// At the parameter 0; a range where rounding is covered.
    middle: Interval,
    /// Of the derivative; unbounded where nothing is known.
    rate: Interval,
}

impl Sloped {
    /// From all values, the value in the middle and all derivatives.
    pub fn new(value: Interval, middle: Interval, rate: Interval) -> Self {
        let rate = if rate.lo.is_nan() || rate.hi.is_nan() { Interval::ALL } else { rate };
        let by_slope = middle + rate * Interval { lo: -1.0, hi: 1.0 };
        Self { value: value.common(by_slope), middle, rate }
    }
}

impl Enclosure for Sloped {
    fn constant(x: f64) -> Self {
        Self { value: point(x), middle: point(x), rate: point(0.0) }
    }

    fn range(self) -> Interval {
        self.value
    }

    fn both(self, other: Self) -> Self {
        Self::new(self.value.common(other.value), self.middle, self.rate.common(other.rate))
    }

    fn scaled(self, factor: f64) -> Self {
        Self {
            value: self.value.scaled(factor),
            middle: self.middle.scaled(factor),
            rate: self.rate * point(factor),
        }
    }

    fn widened(self, slack: f64) -> Self {
        Self { value: self.value.widened(slack), middle: self.middle.widened(slack), ..self }
    }

    fn squared(self) -> Self {
        let rate = (self.value * self.rate).scaled(2.0);
        Self::new(self.value.squared(), self.middle.squared(), rate)
    }

    fn root(self) -> Self {
        let value = self.value.root();
        Self::new(value, self.middle.root(), self.rate * value.inverse().scaled(0.5))
    }

    fn cos(self) -> Self {
        Self::new(self.value.cos(), self.middle.cos(), -(self.value.sin() * self.rate))
    }

    fn sin(self) -> Self {
        Self::new(self.value.sin(), self.middle.sin(), self.value.cos() * self.rate)
    }

    fn acos(self) -> Self {
        let value = self.value.acos();
        let middle = self.middle.acos();
        // Between 0 and pi; sines at the ends bound those between.
        let sine = Interval { lo: value.lo.sin().min(value.hi.sin()), hi: value.sin().hi };
        Self::new(value, middle, -(self.rate * sine.inverse()))
    }

    fn angle_of(x: Self, y: Self) -> Self {
        let value = Interval::angle_of(x.value, y.value);
        let squared = x.value.squared() + y.value.squared();
        let turned = x.value * y.rate - y.value * x.rate;
        let middle = Interval::angle_of(x.middle, y.middle);
        let turn = nearest(middle.middle(), value.middle()) - middle.middle();
        let middle = middle + point(turn);
        Self::new(value, middle, turned * squared.inverse())
    }
}

impl Add for Sloped {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self::new(self.value + other.value, self.middle + other.middle, self.rate + other.rate)
    }
}

impl Sub for Sloped {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self::new(self.value - other.value, self.middle - other.middle, self.rate - other.rate)
    }
}

impl Neg for Sloped {
    type Output = Self;
    fn neg(self) -> Self {
        Self { value: -self.value, middle: -self.middle, rate: -self.rate }
    }
}

impl Mul for Sloped {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let rate = self.value * other.rate + self.rate * other.value;
        Self::new(self.value * other.value, self.middle * other.middle, rate)
    }
}
