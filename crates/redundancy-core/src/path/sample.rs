//! A trajectory between its rows.
//!
//! # Which curve
//! What a controller runs is not the rows but a curve through them, and limits are judged on that curve. Here it is the one
//! that ROS's `joint_trajectory_controller` takes for the same numbers:
//!
//! - with accelerations (`qdd`) the quintic Hermite polynomial through `q, qd, qdd` of both rows: C2;
//! - without them the cubic Hermite polynomial through `q, qd` of both rows: C1. Its acceleration is linear between two
//!   rows and may jump at a row; its third derivative is constant between rows.
//!
//! Both take the rows' velocities as they are, so that a row is met in every number that it gives, and a change of one row
//! changes the curve only in the two neighbouring intervals (a C2 spline through `q` alone would do neither). A motion
//! whose acceleration jumps, such as a time-optimal one, is represented exactly where its jumps are rows: cubic pieces
//! have any acceleration at either side.
//!
//! With `h` the time from row to row, `D` the change of `q` and `x` the time since the row:
//!
//! `q0 + v0 x + (3 D / h - 2 v0 - v1) / h x^2 + (v0 + v1 - 2 D / h) / h^2 x^3`, and
//! `q0 + v0 x + a0/2 x^2 + [20 D - (8 v1 + 12 v0) h - (3 a0 - a1) h^2] / (2 h^3) x^3`
//! `+ [-30 D + (14 v1 + 16 v0) h + (3 a0 - 2 a1) h^2] / (2 h^4) x^4 + [12 D - 6 (v1 + v0) h + (a1 - a0) h^2] / (2 h^5) x^5`.
//!
//! In the second half of an interval the same polynomial is evaluated backwards from its end, so that both rows are met to
//! the last bit. At a row the values are those of the interval that begins there; those of the one that ends there are
//! given by [`Trajectory::sample_interval`].

use super::trajectory::Trajectory;
use crate::error::{Error, Result, check_finite, check_length};
use crate::tolerance::PATH_END_ROUNDING;

/// The state of a trajectory at one instant, one entry per joint.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TrajectorySample {
    /// Positions, rad or m.
    pub q: Vec<f64>,
    /// Velocities, per s.
    pub qd: Vec<f64>,
    /// Accelerations, per s^2.
    pub qdd: Vec<f64>,
    /// Third derivatives (jerk), per s^3.
    pub qddd: Vec<f64>,
}

impl TrajectorySample {
    /// Memory for `dof` joints.
    pub fn new(dof: usize) -> Self {
        let zero = vec![0.0; dof];
        Self { q: zero.clone(), qd: zero.clone(), qdd: zero.clone(), qddd: zero }
    }

    fn parts(&mut self) -> [&mut [f64]; 4] {
        [&mut self.q, &mut self.qd, &mut self.qdd, &mut self.qddd]
    }
}

impl Trajectory {
    /// The state at time `t`, see the module's head for the interpolation. Allocates its result.
    ///
    /// # Errors
    /// A time that is not finite or not in the trajectory; a trajectory without rows.
    ///
    /// ```
    /// use redundancy_core::path::Trajectory;
    /// let rest = Some(vec![0.0, 0.0]);
    /// let one = Trajectory::new(vec!["a".into()], vec![0.0, 2.0], vec![0.0, 1.0], rest, Vec::new())?;
    /// let middle = one.sample(1.0)?;
    /// assert_eq!((middle.q[0], middle.qd[0], middle.qdd[0]), (0.5, 0.75, 0.0));
    /// assert!(one.sample(2.1).is_err());
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn sample(&self, t: f64) -> Result<TrajectorySample> {
        let mut out = TrajectorySample::new(self.dof());
        self.sample_into(t, out.parts())?;
        Ok(out)
    }

    /// The states at many times: every slice of `out` (q, qd, qdd, qddd) gets `times * dof` numbers.
    ///
    /// # Errors
    /// As [`sample`](Self::sample); lengths that do not fit.
    pub fn sample_many(&self, times: &[f64], out: [&mut [f64]; 4]) -> Result<()> {
        let n = self.dof();
        for part in &out {
            check_length("sample", part, times.len() * n)?;
        }
        let [q, qd, qdd, qddd] = out.map(|part| part.chunks_exact_mut(n));
        for ((((t, q), qd), qdd), qddd) in times.iter().zip(q).zip(qd).zip(qdd).zip(qddd) {
            self.sample_into(*t, [q, qd, qdd, qddd])?;
        }
        Ok(())
    }

    /// [`sample`](Self::sample) into memory of the caller (q, qd, qdd, qddd); allocates nothing.
    ///
    /// # Errors
    /// As [`sample`](Self::sample); lengths that do not fit.
    pub fn sample_into(&self, t: f64, out: [&mut [f64]; 4]) -> Result<()> {
        check_finite("t", &[t])?;
        let times = self.t();
        let (Some(first), Some(last)) = (times.first(), times.last()) else {
            return Err(Error::Invalid("the trajectory has no rows".into()));
        };
        let slack = PATH_END_ROUNDING * (last - first);
        if t < first - slack || t > last + slack {
            let bound = format!("in the trajectory, from {first} to {last} s");
            return Err(Error::OutOfRange { what: "t".into(), value: t, bound });
        }
        let interval = times.partition_point(|time| *time <= t).clamp(1, times.len().max(2) - 1) - 1;
        self.sample_interval(interval, t, out)
    }

    /// The state at `t` by the polynomial between the rows `interval` and `interval + 1`, at which `t` is clamped. A
    /// trajectory of one row has the interval 0, in which it stands still but for the row's own numbers.
    ///
    /// # Errors
    /// An interval that does not exist, lengths that do not fit.
    pub fn sample_interval(&self, interval: usize, t: f64, out: [&mut [f64]; 4]) -> Result<()> {
        let n = self.dof();
        for part in &out {
            check_length("sample", part, n)?;
        }
        let rows = self.rows();
        if rows == 0 || interval + 1 >= rows.max(2) {
            let (what, value) = ("interval of the trajectory".into(), interval as f64);
            return Err(Error::OutOfRange { what, value, bound: format!("< {}", rows.max(2) - 1) });
        }
        let next = (interval + 1).min(rows - 1);
        let (start, h) = (self.t()[interval], self.t()[next] - self.t()[interval]);
        let since = (t - start).clamp(0.0, h);
        // Backwards in time from the nearer end: rates of odd order change their sign.
        let backwards = since > 0.5 * h;
        let (near, far, since) = if backwards {
            (next, interval, (self.t()[next] - t).clamp(0.0, h))
        } else {
            (interval, next, since)
        };
        let sign = if backwards { -1.0 } else { 1.0 };
        let [q, qd, qdd, qddd] = out;
        for j in 0..n {
            let end = |row: usize| {
                let at = row * n + j;
                [self.q()[at], sign * self.qd()[at], self.qdd().map_or(0.0, |qdd| qdd[at])]
            };
            let (a, b) = (end(near), end(far));
            let state = if next == interval {
                [a[0], a[1], a[2], 0.0]
            } else if self.qdd().is_some() {
                quintic(a, b, h, since)
            } else {
                cubic(a, b, h, since)
            };
            (q[j], qd[j], qdd[j], qddd[j]) = (state[0], sign * state[1], state[2], sign * state[3]);
        }
        Ok(())
    }
}

/// Value and three derivatives `x` after the first end of the cubic through position and velocity of both.
fn cubic([q0, v0, _]: [f64; 3], [q1, v1, _]: [f64; 3], h: f64, x: f64) -> [f64; 4] {
    let slope = (q1 - q0) / h;
    let c = (3.0 * slope - 2.0 * v0 - v1) / h;
    let d = (v0 + v1 - 2.0 * slope) / (h * h);
    [q0 + (v0 + (c + d * x) * x) * x, v0 + (2.0 * c + 3.0 * d * x) * x, 2.0 * c + 6.0 * d * x, 6.0 * d]
}

/// The same of the quintic through position, velocity and acceleration of both ends.
fn quintic([q0, v0, a0]: [f64; 3], [q1, v1, a1]: [f64; 3], h: f64, x: f64) -> [f64; 4] {
    let slope = (q1 - q0) / h;
    let c = 0.5 * a0;
    let d = (20.0 * slope - 8.0 * v1 - 12.0 * v0 - (3.0 * a0 - a1) * h) / (2.0 * h * h);
    let e = (-30.0 * slope + 14.0 * v1 + 16.0 * v0 + (3.0 * a0 - 2.0 * a1) * h) / (2.0 * h * h * h);
    let f = (12.0 * slope - 6.0 * (v1 + v0) + (a1 - a0) * h) / (2.0 * h * h * h * h);
    [
        q0 + (v0 + (c + (d + (e + f * x) * x) * x) * x) * x,
        v0 + (2.0 * c + (3.0 * d + (4.0 * e + 5.0 * f * x) * x) * x) * x,
        2.0 * c + (6.0 * d + (12.0 * e + 20.0 * f * x) * x) * x,
        6.0 * d + (24.0 * e + 60.0 * f * x) * x,
    ]
}
