//! Sets of numbers between two bounds, for statements about all points of a curve.
//!
//! An [`Enclosure`] may know more than the range: see `slope.rs` for one that knows the derivative.
//!
//! Rounding is not directed: the bounds are those of exact arithmetic up to some units in the last place, which the callers'
//! margins cover.

use std::f64::consts::{FRAC_PI_2, PI};
use std::ops::{Add, Mul, Neg, Sub};

use crate::joint_space::{TURN, turned, turns};

/// All numbers from `lo` to `hi`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Interval {
    pub lo: f64,
    pub hi: f64,
}

/// Between two numbers in any order.
pub(super) fn between(a: f64, b: f64) -> Interval {
    if a < b { Interval { lo: a, hi: b } } else { Interval { lo: b, hi: a } }
}

/// One number.
pub(super) fn point(x: f64) -> Interval {
    Interval { lo: x, hi: x }
}

impl Interval {
    /// Every number.
    pub const ALL: Self = Self { lo: f64::NEG_INFINITY, hi: f64::INFINITY };

    /// What two statements about the same quantity leave; the first where rounding leaves nothing.
    pub fn common(self, other: Self) -> Self {
        let both = Self { lo: self.lo.max(other.lo), hi: self.hi.min(other.hi) };
        if both.lo <= both.hi { both } else { self }
    }

    pub fn width(self) -> f64 {
        self.hi - self.lo
    }

    pub fn middle(self) -> f64 {
        0.5 * (self.lo + self.hi)
    }

    pub fn contains(self, x: f64) -> bool {
        self.lo <= x && x <= self.hi
    }

    /// Reciprocals of positive numbers; unbounded where 0 is among them.
    pub fn inverse(self) -> Self {
        Self { lo: 1.0 / self.hi, hi: if self.lo > 0.0 { 1.0 / self.lo } else { f64::INFINITY } }
    }

    /// Whether no winding of these angles is within limits.
    pub fn misses(self, lower: f64, upper: f64) -> bool {
        let half = 0.5 * (upper - lower);
        if !half.is_finite() || half >= PI || self.width() >= TURN {
            return false;
        }
        let center = lower + half;
        let shift = turned(center, turns(self.middle() - center));
        let (a, b) = (self.lo - shift, self.hi - shift);
        (a > half && b < TURN - half) || (b < -half && a > half - TURN)
    }
}

impl Enclosure for Interval {
    fn constant(x: f64) -> Self {
        point(x)
    }

    fn range(self) -> Interval {
        self
    }

    fn both(self, other: Self) -> Self {
        self.common(other)
    }

    fn widened(self, slack: f64) -> Self {
        Self { lo: self.lo - slack, hi: self.hi + slack }
    }

    fn squared(self) -> Self {
        let (a, b) = (self.lo * self.lo, self.hi * self.hi);
        if self.contains(0.0) { Self { lo: 0.0, hi: a.max(b) } } else { between(a, b) }
    }

    fn root(self) -> Self {
        Self { lo: self.lo.max(0.0).sqrt(), hi: self.hi.max(0.0).sqrt() }
    }

    fn scaled(self, factor: f64) -> Self {
        between(self.lo * factor, self.hi * factor)
    }

    fn cos(self) -> Self {
        let Self { lo, hi } = self;
        let passes = |angle: f64| turned(angle, ((lo - angle) / TURN).ceil()) <= hi;
        let ends = between(lo.cos(), hi.cos());
        Self { lo: if passes(PI) { -1.0 } else { ends.lo }, hi: if passes(0.0) { 1.0 } else { ends.hi } }
    }

    fn sin(self) -> Self {
        Self { lo: self.lo - FRAC_PI_2, hi: self.hi - FRAC_PI_2 }.cos()
    }

    fn acos(self) -> Self {
        Self { lo: self.hi.clamp(-1.0, 1.0).acos(), hi: self.lo.clamp(-1.0, 1.0).acos() }
    }

    fn angle_of(x: Self, y: Self) -> Self {
        if x.contains(0.0) && y.contains(0.0) {
            return Self { lo: -PI, hi: PI };
        }
        // Seen from the middle no corner is more than half a turn away.
        let (mx, my) = (x.middle(), y.middle());
        let middle = my.atan2(mx);
        let mut out = point(middle);
        for (cx, cy) in [(x.lo, y.lo), (x.lo, y.hi), (x.hi, y.lo), (x.hi, y.hi)] {
            let apart = (mx * cy - my * cx).atan2(mx * cx + my * cy);
            out = Self { lo: out.lo.min(middle + apart), hi: out.hi.max(middle + apart) };
        }
        out
    }
}

impl Add for Interval {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { lo: self.lo + other.lo, hi: self.hi + other.hi }
    }
}

impl Sub for Interval {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self { lo: self.lo - other.hi, hi: self.hi - other.lo }
    }
}

impl Neg for Interval {
    type Output = Self;
    fn neg(self) -> Self {
        Self { lo: -self.hi, hi: -self.lo }
    }
}

impl Mul for Interval {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        // 0 times an unbounded end is 0.
        let times = |a: f64, b: f64| if a == 0.0 || b == 0.0 { 0.0 } else { a * b };
        let p = [
            times(self.lo, other.lo),
            times(self.lo, other.hi),
            times(self.hi, other.lo),
            times(self.hi, other.hi),
        ];
        Self {
            lo: p.iter().copied().fold(f64::INFINITY, f64::min),
            hi: p.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        }
    }
}

/// What is known of a quantity over an interval of a parameter: its range, or more.
pub(super) trait Enclosure:
    Copy + Add<Output = Self> + Sub<Output = Self> + Neg<Output = Self> + Mul<Output = Self>
{
    /// The same number everywhere.
    fn constant(x: f64) -> Self;
    /// All values.
    fn range(self) -> Interval;
    /// What two expressions of the same quantity say together.
    fn both(self, other: Self) -> Self;
    fn scaled(self, factor: f64) -> Self;
    /// More by up to `slack` to either side.
    fn widened(self, slack: f64) -> Self;
    fn squared(self) -> Self;
    /// Roots of what is not negative.
    fn root(self) -> Self;
    /// Cosines of angles.
    fn cos(self) -> Self;
    /// Sines of angles.
    fn sin(self) -> Self;
    /// Angles in `[0, pi]` with these cosines.
    fn acos(self) -> Self;
    /// Angles of vectors, continuous over the interval; all where the origin may be among them.
    fn angle_of(x: Self, y: Self) -> Self;

    /// `c[0] + c[1] cos + c[2] sin` of an angle.
    fn sinusoid(c: [f64; 3], angle: Self) -> Self {
        let (amplitude, phase) = (c[1].hypot(c[2]), c[2].atan2(c[1]));
        Self::constant(c[0]) + (angle - Self::constant(phase)).cos().scaled(amplitude)
    }
}
