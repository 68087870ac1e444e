//! Nearest point of a polytope and the largest scale for which it is not empty.
//!
//! `min |z - z0|^2` subject to `low - s p <= N z <= high - s p`, with few unknowns z (the degrees of redundancy) and one
//! two-sided row per joint, for the largest s in [0, 1] that leaves a solution.
//!
//! For a given s the dual active-set method of Goldfarb and Idnani [Goldfarb1983] adds the most violated row, drops
//! those whose multiplier would turn negative, and ends at the solution or at a proof that there is none: multipliers
//! `y >= 0` with `y^T A = 0` and `y^T b(s) < 0`. As `b` is linear in s, the proof bounds s from above for every solution,
//! so s is set to that bound and the method starts again. Each proof is another face of the dual, so this ends, and the
//! first s that has a solution is the largest one.
//!
//! At that s active rows are met up to rounding, which a row that depends on them shows magnified by its multipliers; one that
//! is violated by no more than that is met.

use super::linear::dot;
use crate::tolerance::{BOX_INDEPENDENT, BOX_VIOLATION};

/// Most rounds of either loop; each adds or drops a row, and a few per joint are usual.
const ROUNDS: usize = 200;

/// Memory for the projection.
#[derive(Debug, Clone)]
pub(super) struct BoxProjection {
    /// Active rows: joint, and whether at its upper bound.
    active: Vec<(usize, bool)>,
    multipliers: Vec<f64>,
    /// Step of the multipliers.
    change: Vec<f64>,
    /// Orthonormal rows that span the active ones, and the triangle that makes these of those.
    orthonormal: Vec<f64>,
    factor: Vec<f64>,
    direction: Vec<f64>,
    /// Squared length up to which what the active rows leave of another one is rounding.
    dependent: f64,
    /// Rows that depend on active ones and are violated by what those are off, magnified; and up to what.
    tolerated: Vec<((usize, bool), f64)>,
    /// Rows of the last proof that a larger scale has no solution, and their multipliers.
    blocking: Vec<(usize, bool)>,
    proof: Vec<f64>,
    /// The solution.
    pub z: Vec<f64>,
}

/// The rows: `N` by joint (the first r of `stride` numbers each), bounds, and what one unit of s takes from them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rows<'a> {
    pub n: &'a [f64],
    pub r: usize,
    pub stride: usize,
    pub low: &'a [f64],
    pub high: &'a [f64],
    pub p: &'a [f64],
}

impl Rows<'_> {
    /// `a` of the row `a z <= b` for one bound of a joint: the sign and the numbers.
    fn row(&self, (joint, upper): (usize, bool)) -> (f64, &[f64]) {
        (if upper { 1.0 } else { -1.0 }, &self.n[joint * self.stride..][..self.r])
    }

    /// `(c, d)` of `b = c - s d`.
    fn bound(&self, (joint, upper): (usize, bool)) -> (f64, f64) {
        if upper { (self.high[joint], self.p[joint]) } else { (-self.low[joint], -self.p[joint]) }
    }
}

/// How a projection ended.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Outcome {
    Solved,
    /// No solution for this s; every solution has at most the given one.
    AtMost(f64),
    /// No solution for this s nor a smaller one.
    Never,
}

impl BoxProjection {
    /// Memory for n joints and any number of unknowns up to that.
    pub fn new(n: usize) -> Self {
        Self {
            active: Vec::with_capacity(n + 1),
            multipliers: Vec::with_capacity(n + 1),
            change: Vec::with_capacity(n + 1),
            orthonormal: vec![0.0; (n + 1) * n],
            factor: vec![0.0; (n + 1) * (n + 1)],
            direction: vec![0.0; n],
            dependent: 0.0,
            tolerated: Vec::with_capacity(4 * n),
            blocking: Vec::with_capacity(n + 1),
            proof: Vec::with_capacity(n + 1),
            z: Vec::with_capacity(n),
        }
    }

    /// The largest s in [0, 1] with a solution, and in `z` the solution nearest to `z0`; `None` where there is none.
    pub fn solve(&mut self, rows: &Rows<'_>, z0: &[f64]) -> Option<f64> {
        let mut s = 1.0;
        self.blocking.clear();
        // Measured by the longest row: one that no unknown moves is all rounding.
        let squares = (0..rows.p.len()).map(|joint| {
            let (_, a) = rows.row((joint, true));
            dot(a, a)
        });
        self.dependent = BOX_INDEPENDENT * squares.fold(0.0, f64::max);
        for _ in 0..ROUNDS {
            match self.project(rows, z0, s) {
                Outcome::Solved => return Some(s),
                // A bound that rounding put below 0 is 0, once.
                Outcome::AtMost(bound) if bound >= -BOX_VIOLATION && s > 0.0 => s = bound.clamp(0.0, s),
                _ => return None,
            }
        }
        None
    }

    /// Bounds that hold the last solution back: joint, and whether the upper one. One may come twice.
    pub fn active(&self) -> impl Iterator<Item = (usize, bool)> {
        self.active.iter().chain(&self.blocking).copied()
    }

    /// Active rows with their multipliers, all positive or zero.
    pub fn multipliers(&self) -> impl Iterator<Item = ((usize, bool), f64)> {
        self.active.iter().copied().zip(self.multipliers.iter().copied())
    }

    /// Rows of the proof that the last scale is the largest, with their multipliers for rows of their own length.
    pub fn proof_rows(&self) -> impl Iterator<Item = ((usize, bool), f64)> {
        self.blocking.iter().copied().zip(self.proof.iter().copied())
    }

    fn project(&mut self, rows: &Rows<'_>, z0: &[f64], s: f64) -> Outcome {
        self.z.clear();
        self.z.extend_from_slice(z0);
        self.active.clear();
        self.multipliers.clear();
        self.tolerated.clear();
        for _ in 0..ROUNDS {
            let Some((worst, mut violation)) = self.most_violated(rows, s) else { return Outcome::Solved };
            let mut multiplier = 0.0;
            loop {
                // Step of the multipliers of the active rows, and of z, for one unit of the new multiplier.
                self.steps(rows, worst);
                let square = dot(&self.direction[..rows.r], &self.direction[..rows.r]);
                let free = self.active.len() < rows.r && square > self.dependent;
                if multiplier == 0.0 && !free && violation <= self.magnified() {
                    self.tolerate(worst, violation);
                    break;
                }
                let full = if free { violation / square } else { f64::INFINITY };
                let (mut partial, mut leaving) = (f64::INFINITY, 0);
                for (i, (u, change)) in self.multipliers.iter().zip(&self.change).enumerate() {
                    if *change > 0.0 && u / change < partial {
                        (partial, leaving) = (u / change, i);
                    }
                }
                let t = full.min(partial);
                if t == f64::INFINITY {
                    return self.proof(rows, worst, s);
                }
                if free {
                    for (z, direction) in self.z.iter_mut().zip(&self.direction) {
                        *z -= t * direction;
                    }
                    violation -= t * square;
                }
                self.multipliers.iter_mut().zip(&self.change).for_each(|(u, change)| *u -= t * change);
                multiplier += t;
                if full <= partial {
                    self.active.push(worst);
                    self.multipliers.push(multiplier);
                    break;
                }
                self.active.remove(leaving);
                self.multipliers.remove(leaving);
            }
        }
        Outcome::Solved
    }

    /// By how much a row that depends on the active ones may be violated where each of those may be off by rounding.
    fn magnified(&self) -> f64 {
        BOX_VIOLATION * (1.0 + self.change.iter().map(|change| change.abs()).sum::<f64>())
    }

    /// Lets a row be, as long as it is violated by no more than about this.
    fn tolerate(&mut self, row: (usize, bool), violation: f64) {
        self.tolerated.retain(|known| known.0 != row);
        // Not by its capacity: that of a clone is none.
        if self.tolerated.len() >= 4 * self.direction.len() {
            self.tolerated.swap_remove(0);
        }
        self.tolerated.push((row, 2.0 * violation));
    }

    /// The row that z violates most, beyond rounding.
    fn most_violated(&self, rows: &Rows<'_>, s: f64) -> Option<((usize, bool), f64)> {
        let mut worst = None;
        let mut most = 0.0;
        for joint in 0..rows.p.len() {
            // What an active row leaves of its violation, and of that of the other side, is rounding.
            if self.active.iter().any(|row| row.0 == joint) {
                continue;
            }
            let x = dot(rows.row((joint, true)).1, &self.z);
            let y = s * rows.p[joint];
            let slack = BOX_VIOLATION * (1.0 + y.abs());
            for (upper, violation) in [(true, x + y - rows.high[joint]), (false, rows.low[joint] - x - y)] {
                if violation > slack && violation > most && !self.tolerates((joint, upper), violation) {
                    most = violation;
                    worst = Some((joint, upper));
                }
            }
        }
        worst.map(|row| (row, most))
    }

    fn tolerates(&self, row: (usize, bool), violation: f64) -> bool {
        self.tolerated.iter().any(|known| known.0 == row && violation <= known.1)
    }

    /// For the new row `a` and the active rows A: `direction` is what of a is orthogonal to them, and `change` solves
    /// `A^T change = a - direction`. By orthogonalising twice, which near dependence does not spoil.
    fn steps(&mut self, rows: &Rows<'_>, new: (usize, bool)) {
        let (k, r) = (self.active.len(), rows.r);
        let size = k + 1;
        self.change.clear();
        for i in 0..size {
            let (sign, a) = rows.row(if i < k { self.active[i] } else { new });
            let (done, rest) = self.orthonormal.split_at_mut(i * r);
            let q = &mut rest[..r];
            q.iter_mut().zip(a).for_each(|(q, a)| *q = sign * a);
            for j in 0..i {
                self.factor[j * size + i] = 0.0;
            }
            for _ in 0..2 {
                for (j, before) in done.chunks_exact(r.max(1)).enumerate().take(i) {
                    let part = dot(before, q);
                    self.factor[j * size + i] += part;
                    q.iter_mut().zip(before).for_each(|(q, before)| *q -= part * before);
                }
            }
            if i == k {
                self.direction[..r].copy_from_slice(q);
                break;
            }
            // Active rows are independent: one joins only if its direction is.
            let norm = dot(q, q).sqrt().max(f64::MIN_POSITIVE);
            self.factor[i * size + i] = norm;
            q.iter_mut().for_each(|q| *q /= norm);
        }
        self.change.resize(k, 0.0);
        for i in (0..k).rev() {
            let mut x = self.factor[i * size + k];
            for l in i + 1..k {
                x -= self.factor[i * size + l] * self.change[l];
            }
            self.change[i] = x / self.factor[i * size + i];
        }
    }

    /// The multipliers `1` for the new row and `-change` for the active ones prove that there is no solution.
    fn proof(&mut self, rows: &Rows<'_>, new: (usize, bool), s: f64) -> Outcome {
        let (mut c, mut d) = rows.bound(new);
        for (row, change) in self.active.iter().zip(&self.change) {
            let (ci, di) = rows.bound(*row);
            c -= change * ci;
            d -= change * di;
        }
        self.blocking.clear();
        self.blocking.push(new);
        self.blocking.extend_from_slice(&self.active);
        self.proof.clear();
        self.proof.push(1.0);
        self.proof.extend(self.change.iter().map(|change| -change));
        // 0 = y^T A z <= c - s d.
        if d > 0.0 && c / d < s { Outcome::AtMost(c / d) } else { Outcome::Never }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clone_tolerates_rows_as_well() {
        let mut projection = BoxProjection::new(2).clone();
        for joint in 0..20 {
            projection.tolerate((joint, true), 1e-12);
        }
        assert!(projection.tolerates((19, true), 1e-12) && !projection.tolerates((0, true), 1e-12));
    }
}
