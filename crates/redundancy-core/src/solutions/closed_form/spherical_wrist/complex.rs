//! Points and turns of a plane.

use std::ops::{Add, Mul, Sub};

/// A complex number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Complex {
    pub re: f64,
    pub im: f64,
}

/// `re + i im`.
#[inline(always)]
pub(super) fn complex(re: f64, im: f64) -> Complex {
    Complex { re, im }
}

impl Complex {
    #[inline(always)]
    pub fn conjugate(self) -> Self {
        complex(self.re, -self.im)
    }

    #[inline(always)]
    pub fn norm(self) -> f64 {
        (self.re * self.re + self.im * self.im).sqrt()
    }

    pub fn angle(self) -> f64 {
        self.im.atan2(self.re)
    }

    #[inline(always)]
    pub fn scaled(self, factor: f64) -> Self {
        complex(self.re * factor, self.im * factor)
    }

    /// Of length 1; 1 where it has no length.
    #[inline(always)]
    pub fn unit(self) -> Self {
        let norm = self.norm();
        if norm > f64::MIN_POSITIVE { self.scaled(1.0 / norm) } else { complex(1.0, 0.0) }
    }
}

impl Add for Complex {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        complex(self.re + other.re, self.im + other.im)
    }
}

impl Sub for Complex {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        complex(self.re - other.re, self.im - other.im)
    }
}

impl Mul for Complex {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        complex(self.re * other.re - self.im * other.im, self.re * other.im + self.im * other.re)
    }
}
