//! Four configurations at once: angles as unit vectors of a plane, and the spherical triangle, in vector registers.

use wide::f64x4;

use crate::tolerance::{CONE_ROUNDING, REACH_ROUNDING};

/// The same number in every lane.
#[inline(always)]
pub(super) fn all(x: f64) -> f64x4 {
    f64x4::splat(x)
}

/// Four angles, each as its cosine and sine.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turns {
    pub cos: f64x4,
    pub sin: f64x4,
}

impl Turns {
    /// Directions of the vectors `(x, y)`; that of `other` where their length is not above `least`.
    #[inline(always)]
    pub fn along(x: f64x4, y: f64x4, least: f64, other: [f64; 2]) -> Self {
        let length = (x * x + y * y).sqrt();
        let known = length.simd_gt(all(least));
        Self { cos: known.select(x / length, all(other[0])), sin: known.select(y / length, all(other[1])) }
    }

    /// Angles of the other sign.
    #[inline(always)]
    pub fn negated(self) -> Self {
        Self { cos: self.cos, sin: -self.sin }
    }

    /// `(x, y)` turned by these angles.
    #[inline(always)]
    pub fn apply(self, x: f64x4, y: f64x4) -> [f64x4; 2] {
        [self.cos * x - self.sin * y, self.sin * x + self.cos * y]
    }

    /// `(x, y)` turned back by these angles.
    #[inline(always)]
    pub fn undo(self, x: f64x4, y: f64x4) -> [f64x4; 2] {
        [self.cos * x + self.sin * y, self.cos * y - self.sin * x]
    }

    /// The angles in `[-pi, pi]`.
    #[inline(always)]
    pub fn angles(self) -> f64x4 {
        self.sin.atan2(self.cos)
    }
}

/// Two sides `a, b` in `(0, pi)` of a spherical triangle. The third side c and the angle x between a and b are related by
/// `cos c = cos a cos b + sin a sin b cos x`.
///
/// The factors `u = cos(a - b) - cos c` and `v = cos c - cos(a + b)` give `cos x = (v - u)/(v + u)` and
/// `sin x = 2 sqrt(u v)/(v + u)`; both keep their digits at the ends of the range, where the arc cosine has half of them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Triangle {
    pub cos: [f64; 2],
    pub sin: [f64; 2],
    /// `1 - cos(a - b)`.
    less: f64,
    /// `1 + cos(a + b)`.
    more: f64,
    /// `1 / (2 sin a sin b)`.
    scale: f64,
    /// What rounding of the third side may take from `u` and from `v`: its sine times the rounding, and a little at `c = 0`.
    slack: [f64; 2],
}

impl Triangle {
    /// For two sides in `(0, pi)`.
    pub fn new(a: f64, b: f64) -> Self {
        let ((sin_a, cos_a), (sin_b, cos_b)) = (a.sin_cos(), b.sin_cos());
        let less = 2.0 * (0.5 * (a - b)).sin().powi(2);
        let more = 2.0 * (0.5 * (a + b)).cos().powi(2);
        Self {
            cos: [cos_a, cos_b],
            sin: [sin_a, sin_b],
            less,
            more,
            scale: 0.5 / (sin_a * sin_b),
            slack: [less, more].map(|x| CONE_ROUNDING + REACH_ROUNDING * x.sqrt()),
        }
    }

    /// The angle x in `[0, pi]` from cosine and sine (at least 0) of the third side, and by how much `u` or `v` is
    /// negative beyond rounding, which is 0 where there is such a triangle.
    #[inline(always)]
    pub fn angle(&self, cos: f64x4, sin: f64x4) -> (Turns, f64x4) {
        let one = all(1.0);
        let squared = sin * sin;
        let front = cos.simd_gt(all(0.0));
        // 1 - cos c and 1 + cos c without cancellation.
        let minus = front.select(squared / (one + cos), one - cos);
        let plus = front.select(one + cos, squared / (one - cos));
        let (u, v) = (minus - all(self.less), plus - all(self.more));
        let [slack_u, slack_v] = self.slack.map(all);
        let zero = all(0.0);
        let miss = (-(u + slack_u)).fast_max(-(v + slack_v)).fast_max(zero);
        let (u, v) = (u.fast_max(zero), v.fast_max(zero));
        let scale = all(self.scale);
        let inside = miss.simd_lt(all(f64::MIN_POSITIVE));
        let exact = (v - u) * scale;
        let cos = inside.select(exact, exact.fast_min(one).fast_max(-one));
        (Turns { cos, sin: (u * v).sqrt() * (scale + scale) }, miss)
    }
}
