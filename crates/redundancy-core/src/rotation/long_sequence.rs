//! Sequences of more than three bounded rotations: margin and nearest member.
//!
//! An orientation is such a sequence in a family of ways. Its **margin** is the largest d for which it is a member when every
//! range is narrowed by d at both ends (widened where d is negative): for three rotations that is the smallest signed
//! angle to a bound, largest over the branches. It is the zero of `g(d)`, the angle from the orientation to the set of the
//! ranges narrowed by d. With `u` the direction of that angle and `a_i` the axis of rotation i as the others turn it,
//!
//! ```text
//! g'(d) = sum of |u . a_i| over the rotations at a bound,       d <- d - g / g'
//! ```
//!
//! comes down from outside in a few steps, kept between the last d with and without a member. The nearest member to narrowed
//! ranges alternates one sweep (each angle in turn to its best value, in closed form: the squared dot product is an
//! offset cosine of it), where it is needed, and Gauss-Newton steps of least norm within the ranges. Several starts; a start
//! counts when it leads to a member of ranges that are narrower than the best so far.

use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use crate::rotation::quaternion::{about, compose, rotation_angle, wrap};
use crate::rotation::sequence::BoundedRotation;
use crate::tolerance::{
    LONG_BETTER, LONG_FIRST, LONG_FLAT, LONG_MEMBER, LONG_NARROWING, LONG_NEAR, LONG_REGULAR, LONG_SLOW,
    LONG_SLOWEST, LONG_STEP, LONG_STILL,
};

/// Starts of the search, the middle of the ranges included.
const STARTS: usize = 24;
/// Most sweeps towards the nearest member of one set of ranges.
const SWEEPS: usize = 60;
/// Sweeps from a start before it is given up for a better one.
const FIRST_SWEEPS: usize = 12;
/// Most narrowings from one start.
const NARROWINGS: usize = 60;

/// The orientation at these angles.
pub(super) fn place(rotations: &[BoundedRotation], angles: &[f64]) -> UnitQuaternion<f64> {
    rotations
        .iter()
        .zip(angles)
        .fold(UnitQuaternion::identity(), |q, (r, angle)| compose(&q, &about(&r.axis, *angle)))
}

/// Angles of one way to write an orientation, and their margin.
pub(super) struct Written {
    pub angles: Vec<f64>,
    pub margin: f64,
}

/// The way to write `q` that stays farthest from the bounds; pi without any bound. Where `q` is no such sequence at any angles,
/// minus the angle from them.
pub(super) fn best(rotations: &[BoundedRotation], q: &UnitQuaternion<f64>) -> Written {
    let mut search = AngleSearch::new(rotations, q);
    let widest = widest(rotations);
    let mut found: Option<Written> = None;
    for start in 0..STARTS {
        search.start(start);
        let bar = found.as_ref().map_or(-PI, |f| f.margin + LONG_BETTER);
        if bar > widest {
            break;
        }
        if search.descend(bar, if start == 0 { SWEEPS } else { FIRST_SWEEPS }, LONG_SLOW) > LONG_MEMBER {
            continue;
        }
        let margin = search.narrow(bar, widest);
        found = Some(Written { angles: search.angles.clone(), margin });
    }
    found.unwrap_or_else(|| {
        search.start(0);
        let off = search.descend(-PI, SWEEPS, LONG_SLOWEST);
        Written { angles: search.angles, margin: -off }
    })
}

/// Whether the ranges widened by `tol` have `q` as a member: the sign of the margin, sooner.
pub(super) fn is_member(rotations: &[BoundedRotation], q: &UnitQuaternion<f64>, tol: f64) -> bool {
    // No member is farther from the middle than the ranges are wide together.
    let middle: Vec<f64> = rotations.iter().map(BoundedRotation::centre).collect();
    let reach: f64 = rotations.iter().map(|r| if r.free() { PI } else { r.half() + tol }).sum();
    if rotation_angle(&place(rotations, &middle), q) > reach + LONG_MEMBER {
        return false;
    }
    let mut search = AngleSearch::new(rotations, q);
    (0..STARTS).any(|start| {
        search.start(start);
        search.descend(-tol, FIRST_SWEEPS, LONG_SLOW) <= LONG_MEMBER
    })
}

/// Angles of the member nearest to `q`.
pub(super) fn nearest(rotations: &[BoundedRotation], q: &UnitQuaternion<f64>) -> Vec<f64> {
    let mut search = AngleSearch::new(rotations, q);
    let mut winner: (f64, Vec<f64>) = (f64::INFINITY, vec![0.0; rotations.len()]);
    for start in 0..STARTS {
        search.start(start);
        let mut off = search.descend(0.0, FIRST_SWEEPS, LONG_SLOW);
        if off < winner.0 * LONG_NEAR {
            off = search.descend(0.0, SWEEPS, LONG_SLOWEST);
        }
        if off < winner.0 {
            winner = (off, search.angles.clone());
        }
        if off <= LONG_MEMBER {
            break;
        }
    }
    winner.1
}

/// The largest d by which all ranges can be narrowed.
fn widest(rotations: &[BoundedRotation]) -> f64 {
    rotations.iter().filter(|r| !r.free()).fold(PI, |least, r| least.min(r.half()))
}

/// A point of the search: angles within the ranges, and what they leave of the orientation.
struct AngleSearch<'a> {
    rotations: &'a [BoundedRotation],
    q: UnitQuaternion<f64>,
    angles: Vec<f64>,
    /// Products of the rotations behind each one.
    behind: Vec<UnitQuaternion<f64>>,
    axes: Vec<Vector3<f64>>,
    /// Rotation vector from the present orientation to `q`.
    rest: Vector3<f64>,
    saved: Vec<f64>,
    /// Of a step: what each angle may change, changes, and whether no bound holds it.
    room: Vec<[f64; 2]>,
    change: Vec<f64>,
    free: Vec<bool>,
}

impl<'a> AngleSearch<'a> {
    fn new(rotations: &'a [BoundedRotation], q: &UnitQuaternion<f64>) -> Self {
        let k = rotations.len();
        Self {
            rotations,
            q: *q,
            angles: vec![0.0; k],
            behind: vec![UnitQuaternion::identity(); k],
            axes: vec![Vector3::zeros(); k],
            rest: Vector3::zeros(),
            saved: vec![0.0; k],
            room: vec![[0.0; 2]; k],
            change: vec![0.0; k],
            free: vec![true; k],
        }
    }

    /// Half of a range that is narrowed by `d`; pi where nothing is left of the bounds.
    fn half(r: &BoundedRotation, d: f64) -> f64 {
        if r.free() { PI } else { (r.half() - d).clamp(0.0, PI) }
    }

    fn clamp(r: &BoundedRotation, d: f64, angle: f64) -> f64 {
        let half = Self::half(r, d);
        r.centre() + wrap(angle - r.centre()).clamp(-half, half)
    }

    /// The middle of the ranges, then points spread evenly over them (multiples of irrational shares of a turn).
    fn start(&mut self, number: usize) {
        // The positive root of x^(k+1) = x + 1 spreads points over k ranges.
        let k = self.rotations.len();
        let mut root = 1.5_f64;
        for _ in 0..30 {
            root = (1.0 + root).powf(1.0 / (k as f64 + 1.0));
        }
        let mut share = 1.0;
        for (angle, r) in self.angles.iter_mut().zip(self.rotations) {
            share /= root;
            let place = wrap(TAU * share * number as f64) / PI;
            *angle = r.centre() + place * r.half();
        }
    }

    /// Axes as the rotations before turn them, and the rest.
    fn update(&mut self) -> f64 {
        let mut q = UnitQuaternion::identity();
        for ((r, angle), axis) in self.rotations.iter().zip(&self.angles).zip(&mut self.axes) {
            *axis = q * r.axis.into_inner();
            q = compose(&q, &about(&r.axis, *angle));
        }
        let off = compose(&self.q, &q.inverse());
        let (v, w) = (off.imag(), off.w);
        let sine = v.norm();
        let angle = 2.0 * sine.atan2(w.abs());
        self.rest = if sine > 0.0 { v * (angle / sine * w.signum()) } else { Vector3::zeros() };
        angle
    }

    /// Every angle in turn to its best value in its range narrowed by `d`.
    fn sweep(&mut self, d: f64) {
        let mut behind = UnitQuaternion::identity();
        for i in (0..self.rotations.len()).rev() {
            self.behind[i] = behind;
            behind = compose(&about(&self.rotations[i].axis, self.angles[i]), &behind);
        }
        let mut before = UnitQuaternion::identity();
        for (i, r) in self.rotations.iter().enumerate() {
            // q . (A Q_i B) as an offset cosine of the half angle.
            let middle = compose(&compose(&before.inverse(), &self.q), &self.behind[i].inverse());
            let (cosine, sine) = (middle.w, middle.imag().dot(&r.axis));
            if sine != 0.0 || cosine != 0.0 {
                self.angles[i] = Self::clamp(r, d, 2.0 * sine.atan2(cosine));
            }
            before = compose(&before, &about(&r.axis, self.angles[i]));
        }
    }

    /// Which rotations a bound holds, and the slope of the rest in the narrowing.
    fn held(&self, i: usize, d: f64) -> bool {
        let r = &self.rotations[i];
        let half = Self::half(r, d);
        let offset = wrap(self.angles[i] - r.centre());
        half < PI
            && offset.abs() >= half - LONG_STILL
            && (half == 0.0 || self.axes[i].dot(&self.rest) * offset > 0.0)
    }

    /// Gauss-Newton step: the change of the angles of least norm within the ranges that takes off most of the rest
    /// (bounded least squares by an active set).
    fn step(&mut self, d: f64) {
        let k = self.angles.len();
        for i in 0..k {
            let r = &self.rotations[i];
            let half = Self::half(r, d);
            let offset = wrap(self.angles[i] - r.centre());
            self.room[i] = if half < PI {
                [(-half - offset).clamp(-LONG_STEP, 0.0), (half - offset).clamp(0.0, LONG_STEP)]
            } else {
                [-LONG_STEP, LONG_STEP]
            };
        }
        self.change.fill(0.0);
        self.free.fill(true);
        for _ in 0..4 * k {
            let (mut normal, mut rest) = (Matrix3::zeros(), self.rest);
            for i in 0..k {
                if self.free[i] {
                    normal += self.axes[i] * self.axes[i].transpose();
                } else {
                    rest -= self.axes[i] * self.change[i];
                }
            }
            normal += Matrix3::identity() * (LONG_REGULAR * normal.trace().max(1.0));
            let Some(inverse) = normal.cholesky() else { return };
            let y = inverse.solve(&rest);
            // As far as the first bound.
            let (mut share, mut blocking) = (1.0, None);
            for i in (0..k).filter(|i| self.free[*i]) {
                let way = self.axes[i].dot(&y) - self.change[i];
                let room = if way < 0.0 { self.room[i][0] } else { self.room[i][1] } - self.change[i];
                if way != 0.0 && room / way < share {
                    (share, blocking) = ((room / way).max(0.0), Some(i));
                }
            }
            for i in (0..k).filter(|i| self.free[*i]) {
                self.change[i] += share * (self.axes[i].dot(&y) - self.change[i]);
            }
            if let Some(i) = blocking {
                self.free[i] = false;
                continue;
            }
            // Who would rather leave its bound?
            let left = (0..k).fold(self.rest, |rest, i| rest - self.axes[i] * self.change[i]);
            let wish = |i: usize| {
                let w = self.axes[i].dot(&left);
                if self.change[i] <= self.room[i][0] { w } else { -w }
            };
            let held = (0..k).filter(|i| !self.free[*i] && self.room[*i][0] < self.room[*i][1]);
            let most = held.map(|i| (wish(i), i)).max_by(|a, b| a.0.total_cmp(&b.0));
            match most {
                Some((w, i)) if w > LONG_STILL => self.free[i] = true,
                _ => break,
            }
        }
        for i in 0..k {
            self.angles[i] = Self::clamp(&self.rotations[i], d, self.angles[i] + self.change[i]);
        }
    }

    /// Towards the nearest member of the ranges narrowed by `d`; the angle that is left.
    fn descend(&mut self, d: f64, most: usize, slow: f64) -> f64 {
        for (angle, r) in self.angles.iter_mut().zip(self.rotations) {
            *angle = Self::clamp(r, d, *angle);
        }
        let mut off = self.update();
        for _ in 0..most {
            if off <= LONG_STILL {
                break;
            }
            let before = off;
            self.saved.copy_from_slice(&self.angles);
            self.step(d);
            off = self.update();
            if off > 0.7 * before {
                if off > before {
                    self.angles.copy_from_slice(&self.saved);
                }
                self.sweep(d);
                off = self.update();
                if off > before * (1.0 - slow) {
                    break;
                }
            }
        }
        off
    }

    /// The least margin of the present angles.
    fn margin(&self) -> f64 {
        self.rotations.iter().zip(&self.angles).map(|(r, angle)| r.margin(*angle)).fold(PI, f64::min)
    }

    /// From a member of the ranges narrowed by `member`: the largest narrowing that still has one near it; the angles are
    /// there.
    fn narrow(&mut self, member: f64, widest: f64) -> f64 {
        let (mut low, mut high) = (member.max(self.margin()), widest);
        let mut at = self.angles.clone();
        let mut step = LONG_FIRST;
        let mut d = (low + step).min(widest);
        for _ in 0..NARROWINGS {
            if high - low <= LONG_NARROWING {
                break;
            }
            // Always from a member: a path through narrower ranges may end in another part of the set.
            self.angles.copy_from_slice(&at);
            let off = self.descend(d, SWEEPS, LONG_SLOW);
            if off <= LONG_MEMBER {
                low = low.max(d).max(self.margin());
                at.copy_from_slice(&self.angles);
                step *= 2.0;
                d = if high < widest { 0.5 * (low + high) } else { (low + step).min(widest) };
            } else {
                high = d;
                let u = self.rest / off;
                let bounded =
                    (0..self.angles.len()).filter(|i| !self.rotations[*i].free() && self.held(*i, d));
                let slope: f64 = bounded.map(|i| self.axes[i].dot(&u).abs()).sum();
                let next = if slope > LONG_FLAT { d - off / slope } else { low };
                d = if next > low && next < high { next } else { 0.5 * (low + high) };
            }
        }
        self.angles.copy_from_slice(&at);
        low
    }
}
