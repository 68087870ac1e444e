//! Joint motion and torques at one place of the path, and how they depend on the parameters there.
//!
//! With the tool's twist `V = (p', omega)` (and the rates of the spare coordinates, below) and the square Jacobian `J`:
//! `J q' = V`, `J q'' = V' - J' q'`. A variation of the parameters moves the joints by `dq = W du`, `J W = E` with
//! `E = (0; A; 1)`; along the path
//!
//! `dq' = W' du + W du'`, `dq'' = W'' du + 2 W' du' + W du''`, `J W' = E' - J' W`, `J W'' = E'' - 2 J' W' - J'' W`.
//!
//! One factorisation of `J` serves all of it. Torques follow by the derivatives of inverse dynamics.
//!
//! An arm with more joints than six gets a spare coordinate `w = c . q` for each, with a constant row `c` under the Jacobian: the
//! null-space direction at the start of the search. It describes the self-motion as the swivel does, for any arm, wherever `c` is not
//! perpendicular to the null space.

use nalgebra::{Const, Dim, DimMin, Matrix3, SMatrix, SVector, Vector3};

use super::curve::{CurvePoint, Turned};
use crate::chain::{Body, Chain};
use crate::error::Result;
use crate::kinematics::{Corrector, CorrectorSettings, DynamicsScratch, SplitDerivatives, StepBound, Task};
use crate::pose::Pose;
use crate::tolerance::{JOINT_JUMP, LINE_RESIDUAL, LINE_SINGULAR};

/// A number of joints for which square systems can be factored.
pub(super) trait Size: Dim + DimMin<Self, Output = Self> {}

impl<const N: usize> Size for Const<N> where Const<N>: DimMin<Self, Output = Self> {}

/// Newton's method onto a place of the path.
const MEET: CorrectorSettings = CorrectorSettings {
    steps: 10,
    bound: StepBound::Length(f64::INFINITY),
    strict: false,
    last_step: 0.0,
    last_error: LINE_RESIDUAL,
    singular: LINE_SINGULAR,
    travel: JOINT_JUMP,
    tangents: false,
};

/// Parameters, and derivatives, at one place.
pub(super) type Parameters<const M: usize> = [[f64; M]; 3];

/// What one place needs; reused.
#[derive(Clone)]
pub(super) struct Workspace<const N: usize> {
    axes: [[Vector3<f64>; 3]; N],
    origins: [[Vector3<f64>; 3]; N],
    dynamics: DynamicsScratch,
    corrector: Corrector,
}

/// The arm's motion at one place, per unit of arc length.
#[derive(Debug, Clone, Copy)]
pub(super) struct Motion<const N: usize, const M: usize> {
    pub q: SVector<f64, N>,
    pub d: SVector<f64, N>,
    pub dd: SVector<f64, N>,
    pub gravity: SVector<f64, N>,
    pub dynamic: SVector<f64, N>,
    pub pose: Pose,
    pub omega: Vector3<f64>,
}

/// How it depends on the parameters at that place: on `(u, u', u'')`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sensitivity<const N: usize, const M: usize> {
    pub q: SMatrix<f64, N, M>,
    pub q_rate: SMatrix<f64, N, M>,
    pub gravity: SMatrix<f64, N, M>,
    pub dynamic: [SMatrix<f64, N, M>; 3],
    pub turn: [Matrix3<f64>; 2],
}

/// The arm as the plan sees it.
pub(super) struct Arm<'a, const N: usize> {
    pub chain: &'a Chain,
    pub bodies: Option<&'a [Body]>,
    pub gravity: Vector3<f64>,
    /// Rows under the Jacobian.
    pub spare: Vec<SVector<f64, N>>,
}

impl<const N: usize> Workspace<N> {
    /// # Errors
    /// As [`Corrector::with_coordinates`].
    pub fn new(chain: &Chain) -> Result<Self> {
        let zero = [[Vector3::zeros(); 3]; N];
        let spare = vec![0.0; N.saturating_sub(6) * N];
        let corrector = Corrector::with_coordinates(chain, Task::POSE, &Pose::identity(), &spare)?;
        Ok(Self { axes: zero, origins: zero, dynamics: DynamicsScratch::new(chain), corrector })
    }
}

impl<const N: usize> Arm<'_, N>
where
    Const<N>: Size,
{
    /// Square Jacobian of pose and spare coordinates; the axes go into `work`.
    fn jacobian(&self, q: &SVector<f64, N>, work: &mut Workspace<N>) -> SMatrix<f64, N, N> {
        work.corrector.evaluate(q.as_slice());
        let kinematics = work.corrector.kinematics();
        for (j, (z, o)) in kinematics.axes().iter().zip(kinematics.origins()).enumerate().take(N) {
            work.axes[j][0] = *z;
            work.origins[j][0] = *o;
        }
        SMatrix::from_column_slice(work.corrector.jacobian())
    }

    /// Moves `q` onto the pose and the spare coordinates. `None` where that fails or jumps.
    fn meet(
        &self,
        wanted: &Pose,
        spare: &[f64],
        q: &mut SVector<f64, N>,
        work: &mut Workspace<N>,
    ) -> Option<()> {
        work.corrector.set_target(wanted);
        for (k, (row, value)) in self.spare.iter().zip(spare).enumerate() {
            work.corrector.hold(k, row.as_slice(), *value);
        }
        work.corrector.solve(q.as_mut_slice(), &MEET).then_some(())
    }

    /// The motion at a place, from a configuration nearby; with its sensitivity where that is asked for.
    pub fn motion<const M: usize>(
        &self,
        point: &CurvePoint,
        u: &Parameters<M>,
        near: &SVector<f64, N>,
        work: &mut Workspace<N>,
        sensitivity: Option<&mut Sensitivity<N, M>>,
    ) -> Option<Motion<N, M>> {
        let three = |row: &[f64; M]| [row[0], row[1], row[2]];
        let turned = point.turned([three(&u[0]), three(&u[1]), three(&u[2])]);
        let wanted = crate::pose::pose(*turned.rotation.matrix(), point.position[0]);
        let mut q = *near;
        self.meet(&wanted, &u[0][3..], &mut q, work)?;
        let factor = self.jacobian(&q, work).lu();
        if !regular(&factor.u().diagonal()) {
            return None;
        }
        let right = |linear: &Vector3<f64>, angular: &Vector3<f64>, spare: &[f64]| {
            SVector::<f64, N>::from_fn(|i, _| match i {
                0..3 => linear[i],
                3..6 => angular[i - 3],
                _ => spare[i - 6],
            })
        };
        let d = factor.solve(&right(&point.position[1], &turned.omega, &u[1][3..]))?;
        self.frames(&q, &d, None, work);
        let first = self.jacobian_rate(&wanted, &d, work);
        let dd = factor.solve(&(right(&point.position[2], &turned.omega_rate, &u[2][3..]) - first * d))?;
        let (mut gravity, mut dynamic) = (SVector::<f64, N>::zeros(), SVector::<f64, N>::zeros());
        if let Some(bodies) = self.bodies {
            let motion = [q.as_slice(), d.as_slice(), dd.as_slice()];
            let (g, dyn_) = (gravity.as_mut_slice(), dynamic.as_mut_slice());
            self.chain.split_torques(bodies, motion, &self.gravity, &mut work.dynamics, g, dyn_);
        }
        let motion = Motion { q, d, dd, gravity, dynamic, pose: wanted, omega: turned.omega };
        if let Some(out) = sensitivity {
            self.frames(&q, &d, Some(&dd), work);
            let second = self.jacobian_second(&wanted, &point.position, work);
            let e = |order: usize| columns::<N, M>(&turned, order);
            let w = factor.solve(&e(0))?;
            let w1 = factor.solve(&(e(1) - first * w))?;
            let w2 = factor.solve(&(e(2) - first * w1 * 2.0 - second * w))?;
            out.q = w;
            out.q_rate = w1;
            out.turn = [turned.by_u[0], turned.by_u[1]];
            self.torque_sensitivity(&motion, [&w, &w1, &w2], work, out);
        }
        Some(motion)
    }

    fn torque_sensitivity<const M: usize>(
        &self,
        motion: &Motion<N, M>,
        [w, w1, w2]: [&SMatrix<f64, N, M>; 3],
        work: &mut Workspace<N>,
        out: &mut Sensitivity<N, M>,
    ) {
        let Some(bodies) = self.bodies else {
            out.gravity = SMatrix::zeros();
            out.dynamic = [SMatrix::zeros(); 3];
            return;
        };
        let zero = SMatrix::<f64, N, N>::zeros();
        let (mut by_g, mut by_q, mut by_d, mut by_dd) = (zero, zero, zero, zero);
        let derivatives = SplitDerivatives {
            gravity_q: by_g.as_mut_slice(),
            q: by_q.as_mut_slice(),
            qd: by_d.as_mut_slice(),
            qdd: by_dd.as_mut_slice(),
        };
        let at = [motion.q.as_slice(), motion.d.as_slice(), motion.dd.as_slice()];
        self.chain.split_derivatives(bodies, at, &self.gravity, &mut work.dynamics, derivatives);
        out.gravity = by_g * w;
        out.dynamic = [by_q * w + by_d * w1 + by_dd * w2, by_d * w + by_dd * w1 * 2.0, by_dd * w];
    }

    /// Axes and points on them with their derivatives along the path, up to the first without `dd`, else the second.
    fn frames(
        &self,
        q: &SVector<f64, N>,
        d: &SVector<f64, N>,
        dd: Option<&SVector<f64, N>>,
        work: &mut Workspace<N>,
    ) {
        let zero = Vector3::zeros();
        let (mut omega, mut alpha) = (zero, zero);
        let mut previous = [zero; 3];
        let steps = self.chain.steps();
        for j in 0..N {
            let (z, o) = (work.axes[j][0], work.origins[j][0]);
            // The origin of joint j moves with the body before it.
            let r = o - previous[0];
            let speed = omega.cross(&r);
            let mut origin = [o, previous[1] + speed, zero];
            let mut axis = [z, omega.cross(&z), zero];
            if dd.is_some() {
                origin[2] = previous[2] + alpha.cross(&r) + omega.cross(&speed);
                axis[2] = alpha.cross(&z) + omega.cross(&axis[1]);
            }
            work.axes[j] = axis;
            work.origins[j] = origin;
            previous = origin;
            let acceleration = dd.map_or(0.0, |dd| dd[j]);
            if steps[j].rotational {
                alpha += z * acceleration + axis[1] * d[j];
                omega += z * d[j];
            } else {
                // A point that slides along with the joint.
                let at = [z * q[j], axis[1] * q[j] + z * d[j], zero];
                previous[0] += at[0];
                previous[1] += at[1];
                previous[2] += axis[2] * q[j] + axis[1] * (2.0 * d[j]) + z * acceleration;
            }
        }
    }

    fn jacobian_rate(&self, pose: &Pose, d: &SVector<f64, N>, work: &Workspace<N>) -> SMatrix<f64, N, N> {
        let mut out = SMatrix::<f64, N, N>::zeros();
        let p = pose.translation.vector;
        let speed = self.tip_speed(&p, d, work);
        for (j, step) in self.chain.steps().iter().enumerate().take(N) {
            let ([z, z1, _], [o, o1, _]) = (work.axes[j], work.origins[j]);
            if step.rotational {
                put(&mut out, j, &(z1.cross(&(p - o)) + z.cross(&(speed - o1))), &z1);
            } else {
                put(&mut out, j, &z1, &Vector3::zeros());
            }
        }
        out
    }

    fn tip_speed(&self, p: &Vector3<f64>, d: &SVector<f64, N>, work: &Workspace<N>) -> Vector3<f64> {
        let mut speed = Vector3::zeros();
        for (j, step) in self.chain.steps().iter().enumerate().take(N) {
            let (z, o) = (work.axes[j][0], work.origins[j][0]);
            speed += if step.rotational { z.cross(&(p - o)) * d[j] } else { z * d[j] };
        }
        speed
    }

    fn jacobian_second(
        &self,
        pose: &Pose,
        position: &[Vector3<f64>; 3],
        work: &Workspace<N>,
    ) -> SMatrix<f64, N, N> {
        let mut out = SMatrix::<f64, N, N>::zeros();
        let p = pose.translation.vector;
        for (j, step) in self.chain.steps().iter().enumerate().take(N) {
            let ([z, z1, z2], [o, o1, o2]) = (work.axes[j], work.origins[j]);
            if step.rotational {
                let lever = [p - o, position[1] - o1, position[2] - o2];
                let linear = z2.cross(&lever[0]) + z1.cross(&lever[1]) * 2.0 + z.cross(&lever[2]);
                put(&mut out, j, &linear, &z2);
            } else {
                put(&mut out, j, &z2, &Vector3::zeros());
            }
        }
        out
    }
}

fn put<const N: usize>(m: &mut SMatrix<f64, N, N>, j: usize, linear: &Vector3<f64>, angular: &Vector3<f64>) {
    for i in 0..3 {
        m[(i, j)] = linear[i];
        m[(3 + i, j)] = angular[i];
    }
}

/// `E` or one of its derivatives.
fn columns<const N: usize, const M: usize>(turned: &Turned, order: usize) -> SMatrix<f64, N, M> {
    SMatrix::from_fn(|i, j| match (i, j) {
        (3..6, 0..3) => turned.by_u[order][(i - 3, j)],
        (6.., 3..) if order == 0 && i - 6 == j - 3 => 1.0,
        _ => 0.0,
    })
}

/// Whether pivots leave digits for second derivatives; false for NaN.
fn regular<const N: usize>(pivots: &SVector<f64, N>) -> bool {
    let size = pivots.abs();
    size.min() > LINE_SINGULAR * size.max()
}
