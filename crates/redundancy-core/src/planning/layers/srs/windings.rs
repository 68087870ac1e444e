//! The windings of seven joints as one number.

use std::f64::consts::PI;

use crate::joint_space::{TURN, turned, turns_over, turns_within};

/// Most windings of all joints together. Beyond, the later joints count as free, and the line is checked at its end.
const MAX_WINDINGS: usize = 243;

/// Windings as one number: digit i is the turns added to joint i, less the least that its limits admit.
pub(super) struct Windings {
    least: [i32; 7],
    count: [usize; 7],
    stride: [usize; 7],
    pub total: usize,
    /// Turns of each joint by code.
    pub turns: Vec<[f64; 7]>,
    /// Whether principal values that wrap are the same position, or another winding of it; else the joint cannot turn so
    /// far.
    pub wraps: [bool; 7],
}

impl Windings {
    pub fn new(lower: &[f64; 7], upper: &[f64; 7]) -> Self {
        let (mut least, mut count, mut stride, mut total) = ([0; 7], [1; 7], [0; 7], 1usize);
        let mut wraps = [false; 7];
        for i in 0..7 {
            if lower[i] == f64::NEG_INFINITY || upper[i] == f64::INFINITY {
                wraps[i] = true;
                continue;
            }
            // Principal values are in (-pi, pi]: turns k for which (-pi, pi] + k turns meets the range.
            let (a, b) = (lower[i].max(-2.0 * TURN), upper[i].min(2.0 * TURN));
            let [first, last] = turns_within([-PI, PI], a, b);
            least[i] = first as i32;
            count[i] = (last as i32 - least[i] + 1).clamp(1, 5) as usize;
            if total * count[i] > MAX_WINDINGS {
                (count[i], least[i]) = (1, 0);
                wraps[i] = true;
                continue;
            }
            wraps[i] = count[i] > 1;
            stride[i] = total;
            total *= count[i];
        }
        let mut windings = Self { least, count, stride, total, turns: Vec::new(), wraps };
        windings.turns = (0..total).map(|code| windings.turns_of(code)).collect();
        windings
    }

    fn turns_of(&self, code: usize) -> [f64; 7] {
        std::array::from_fn(|i| {
            let digit = if self.count[i] > 1 { code / self.stride[i] % self.count[i] } else { 0 };
            f64::from(self.least[i] + digit as i32)
        })
    }

    /// Whether the windings of a joint are states of their own.
    #[inline(always)]
    pub fn counts(&self, joint: usize) -> bool {
        self.count[joint] > 1
    }

    /// Whether a joint has no limits, so that all of its windings are alike.
    #[inline(always)]
    pub fn free(&self, joint: usize) -> bool {
        self.wraps[joint] && self.count[joint] == 1
    }

    /// The joints whose windings count.
    pub fn several(&self) -> impl Iterator<Item = usize> {
        (0..7).filter(|i| self.counts(*i))
    }

    /// Positions of a node with the windings of a code.
    pub fn wound(&self, q: &[f64; 7], code: usize) -> [f64; 7] {
        std::array::from_fn(|i| if self.counts(i) { turned(q[i], self.turns[code][i]) } else { q[i] })
    }

    /// The code from which one comes to `code` by `turns` full turns less; `None` where a joint has no such winding.
    pub fn shifted(&self, code: usize, turns: &[i32; 7]) -> Option<usize> {
        let mut out = code;
        for i in self.several() {
            let digit = (code / self.stride[i] % self.count[i]) as i32 + turns[i];
            if digit < 0 || digit >= self.count[i] as i32 {
                return None;
            }
            out = out.wrapping_add_signed(self.stride[i] as isize * turns[i] as isize);
        }
        Some(out)
    }
}

/// Full turns by which `b` is further than the short way from `a`, of the joints that may wrap.
#[inline(always)]
pub(super) fn turns_between(windings: &Windings, a: &[f64; 7], b: &[f64; 7]) -> [i32; 7] {
    std::array::from_fn(|i| if windings.wraps[i] { turns_over(b[i] - a[i]) } else { 0 })
}
