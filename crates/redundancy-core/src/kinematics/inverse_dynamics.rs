//! Joint torques for a given motion, and their derivatives.
//!
//! # Problem
//! `tau = M(q) qdd + c(q, qd) + g(q)`: what the joints must exert. No friction; rotors count as inertia at their joint.
//!
//! # Method
//! - Torques: recursive Newton-Euler [Featherstone2008, ch. 5], velocities and forces in the frame of each joint, whose z
//!   is the joint axis, so that a joint turns only x and y.
//! - At constant speed along a path, `tau = G + v^2 D` with `G = g(q)` and `D = M q'' + c(q, q')`, primes by arc length.
//!   One pass gives both: gravity is an acceleration of the base and needs no velocities.
//! - Derivatives: the closed forms of [Singh2022] in world axes about the world's origin. With the axis `S_j`, its rates
//!   `S'_j = v x S_j` and `S''_j = a x S_j + v x S'_j` (v, a of the body before the joint), the inertia `I_i` and the force `f_i`
//!   of everything from body i on, and for `j <= i`:
//!
//!   `d tau_i / d q_j = S_i . (2 B_i S'_j + I_i S''_j)`, `d tau_j / d q_i = S_j . (2 B_i S'_i + I_i S''_i + S_i x* f_i)`,
//!   `d tau_i / d qd_j = 2 S_i . (B_i S_j + I_i S'_j)`, `d tau_i / d qdd_j = S_i . I_i S_j`.
//!
//!   For a rigid body `B` needs no 6 x 6 matrix: with its momentum `P`, first moment `h` and second moment `Sigma`, moving with
//!   `(v, omega)`, it takes a motion with angular part `w` to `(w x P, K w)`, `K = -[h][v] - [omega] Sigma`; the linear part
//!   drops out by Jacobi's identity. Both add up over bodies.
//!
//! Cost for seven joints: torques about 0.4 us, all three derivatives about 1.5 us. Nothing allocates.
//!
//! References: [Featherstone2008], [Singh2022].

use nalgebra::{DMatrix, Matrix3, Vector3};

use super::forward::Frame;
use super::trigonometry::sin_cos;
use crate::chain::{Body, Chain, Step};
use crate::error::{Error, Result, check_finite, check_length, check_vector};
use crate::parallel::prelude::*;

/// Rows that one task of the pool takes at least: below it, handing work over costs more than the work.
const ROWS_PER_TASK: usize = 64;

/// Memory for the dynamics of one chain, allocated once and reused.
#[derive(Debug, Clone)]
pub struct DynamicsScratch {
    links: Vec<LinkState>,
    worlds: Vec<WorldState>,
}

impl DynamicsScratch {
    /// Memory for chains with as many joints as `chain`.
    pub fn new(chain: &Chain) -> Self {
        let n = chain.dof();
        Self { links: vec![LinkState::default(); n], worlds: vec![WorldState::default(); n] }
    }

    /// How many joints it has room for.
    pub fn dof(&self) -> usize {
        self.links.len()
    }

    fn check(&self, chain: &Chain) -> Result<()> {
        if self.dof() == chain.dof() {
            return Ok(());
        }
        Err(Error::Length { what: "dynamics scratch".into(), expected: chain.dof(), actual: self.dof() })
    }
}

/// Derivatives of the torques, N m per rad, per rad/s, per rad/s^2; entry `(i, j)` is of joint i by joint j.
#[derive(Debug, Clone, PartialEq)]
pub struct TorqueDerivatives {
    /// With respect to the positions.
    pub q: DMatrix<f64>,
    /// With respect to the velocities.
    pub qd: DMatrix<f64>,
    /// With respect to the accelerations: the mass matrix, rotors included.
    pub qdd: DMatrix<f64>,
}

impl TorqueDerivatives {
    /// Zeros for a chain of `dof` joints.
    pub fn new(dof: usize) -> Self {
        let zero = DMatrix::zeros(dof, dof);
        Self { q: zero.clone(), qd: zero.clone(), qdd: zero }
    }
}

/// Derivatives of both parts of `tau = G + v^2 D`, column by column, `n * n` numbers each.
pub(crate) struct SplitDerivatives<'a> {
    pub gravity_q: &'a mut [f64],
    pub q: &'a mut [f64],
    pub qd: &'a mut [f64],
    pub qdd: &'a mut [f64],
}

/// One body in the frame of its joint.
#[derive(Debug, Clone, Copy, Default)]
struct LinkState {
    /// Columns: axes of this frame in the frame of the body before.
    rotation: Matrix3<f64>,
    /// Origin of this frame in the frame of the body before.
    origin: Vector3<f64>,
    force: Vector3<f64>,
    torque: Vector3<f64>,
    weight: Vector3<f64>,
    weight_torque: Vector3<f64>,
    /// Force and torque of accelerating along `qd`, where they are asked for.
    push: Vector3<f64>,
    push_torque: Vector3<f64>,
}

/// A motion or a force as two vectors, linear first, about the world's origin.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Six {
    pub lin: Vector3<f64>,
    pub ang: Vector3<f64>,
}

impl Six {
    pub fn new(lin: Vector3<f64>, ang: Vector3<f64>) -> Self {
        Self { lin, ang }
    }

    #[inline(always)]
    pub fn dot(&self, other: &Self) -> f64 {
        self.lin.dot(&other.lin) + self.ang.dot(&other.ang)
    }

    /// Motion cross motion.
    #[inline(always)]
    pub fn cross(&self, m: &Self) -> Self {
        Self::new(self.ang.cross(&m.lin) + self.lin.cross(&m.ang), self.ang.cross(&m.ang))
    }

    /// Motion cross force.
    #[inline(always)]
    fn cross_force(&self, f: &Self) -> Self {
        Self::new(self.ang.cross(&f.lin), self.ang.cross(&f.ang) + self.lin.cross(&f.lin))
    }
}

impl std::ops::Add for Six {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self::new(self.lin + other.lin, self.ang + other.ang)
    }
}

impl std::ops::Mul<f64> for Six {
    type Output = Self;
    fn mul(self, k: f64) -> Self {
        Self::new(self.lin * k, self.ang * k)
    }
}

/// Inertia of a rigid body about the world's origin.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Mass {
    mass: f64,
    moment: Vector3<f64>,
    second: Matrix3<f64>,
}

impl Mass {
    /// A body in a frame with these axes and this origin.
    #[inline(always)]
    pub fn placed(body: &Body, turn: &Matrix3<f64>, p: &Vector3<f64>) -> Self {
        let moment = turn * body.moment;
        let mixed = moment * p.transpose();
        let second =
            turn * body.second * turn.transpose() + mixed + mixed.transpose() + p * p.transpose() * body.mass;
        Self { mass: body.mass, moment: moment + p * body.mass, second }
    }

    /// Joins another body to it.
    #[inline(always)]
    pub fn add(&mut self, other: &Self) {
        self.mass += other.mass;
        self.moment += other.moment;
        self.second += other.second;
    }

    /// Momentum of a motion.
    #[inline(always)]
    pub fn times(&self, m: &Six) -> Six {
        let spin = m.ang * self.second.trace() - self.second * m.ang;
        Six::new(m.lin * self.mass - self.moment.cross(&m.ang), spin + self.moment.cross(&m.lin))
    }
}

/// One joint and what it carries, in world axes about the world's origin. After the backward pass the second half counts
/// everything from this body on.
#[derive(Debug, Clone, Copy, Default)]
struct WorldState {
    axis: Six,
    rate: Six,
    second_rate: Six,
    weight_rate: Six,
    rotor: f64,
    mass: Mass,
    momentum: Vector3<f64>,
    coriolis: Matrix3<f64>,
    force: Six,
    weight: Six,
}

impl Chain {
    /// Joint torques (N m; N for sliding joints) at `q` for velocities `qd` and accelerations `qdd`, under `gravity` (m/s^2,
    /// world axes). Allocates nothing.
    ///
    /// # Errors
    /// A chain without inertias, wrong lengths, entries that are not finite.
    ///
    /// ```
    /// use redundancy_core::{chain::catalog, kinematics::DynamicsScratch, nalgebra::Vector3};
    /// let arm = catalog::load("puma560")?;
    /// let mut scratch = DynamicsScratch::new(&arm); // once, outside of the control loop
    /// let (zero, mut tau) = ([0.0; 6], [0.0; 6]);
    /// arm.inverse_dynamics(&zero, &zero, &zero, &Vector3::new(0., 0., -9.81), &mut scratch, &mut tau)?;
    /// assert!((tau[1] - 37.4837).abs() < 1e-4); // what the shoulder holds with the arm stretched out
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn inverse_dynamics(
        &self,
        q: &[f64],
        qd: &[f64],
        qdd: &[f64],
        gravity: &Vector3<f64>,
        scratch: &mut DynamicsScratch,
        torques: &mut [f64],
    ) -> Result<()> {
        self.check_motion(q, qd, qdd, gravity)?;
        scratch.check(self)?;
        check_length("torques", torques, self.dof())?;
        self.newton_euler::<false>(
            self.masses()?,
            [q, qd, qdd],
            gravity,
            scratch,
            |i, dynamic, weight, _| {
                torques[i] = dynamic + weight;
            },
        );
        Ok(())
    }

    /// [`inverse_dynamics`](Self::inverse_dynamics) for `N` rows; every slice holds `N * dof` numbers. Runs on the current
    /// pool.
    ///
    /// # Errors
    /// As for one row; lengths that differ.
    pub fn inverse_dynamics_batch(
        &self,
        q: &[f64],
        qd: &[f64],
        qdd: &[f64],
        gravity: &Vector3<f64>,
        torques: &mut [f64],
    ) -> Result<()> {
        let n = self.dof();
        self.check_batch(q)?;
        for (what, values) in [("qd", qd), ("qdd", qdd)] {
            check_vector(what, values, q.len())?;
        }
        check_length("torques", torques, q.len())?;
        check_finite("gravity", gravity.as_slice())?;
        let bodies = self.masses()?;
        let rows = q.par_chunks_exact(n).zip(qd.par_chunks_exact(n)).zip(qdd.par_chunks_exact(n));
        rows.zip(torques.par_chunks_exact_mut(n)).with_min_len(ROWS_PER_TASK).for_each_init(
            || DynamicsScratch::new(self),
            |scratch, (((q, qd), qdd), out)| {
                self.newton_euler::<false>(
                    bodies,
                    [q, qd, qdd],
                    gravity,
                    scratch,
                    |i, dynamic, weight, _| {
                        out[i] = dynamic + weight;
                    },
                );
            },
        );
        Ok(())
    }

    /// Derivatives of [`inverse_dynamics`](Self::inverse_dynamics) by q, qd and qdd, in closed form. Allocates nothing.
    ///
    /// # Errors
    /// As [`inverse_dynamics`](Self::inverse_dynamics); derivatives made for another number of joints.
    ///
    /// ```
    /// use redundancy_core::chain::catalog;
    /// use redundancy_core::kinematics::{DynamicsScratch, TorqueDerivatives};
    /// use redundancy_core::nalgebra::Vector3;
    /// let arm = catalog::load("puma560")?;
    /// let (mut scratch, mut out) = (DynamicsScratch::new(&arm), TorqueDerivatives::new(6));
    /// let (q, zero) = ([0.3; 6], [0.0; 6]);
    /// arm.inverse_dynamics_derivatives(&q, &zero, &zero, &Vector3::zeros(), &mut scratch, &mut out)?;
    /// assert!((&out.qdd - out.qdd.transpose()).amax() < 1e-15); // the mass matrix
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn inverse_dynamics_derivatives(
        &self,
        q: &[f64],
        qd: &[f64],
        qdd: &[f64],
        gravity: &Vector3<f64>,
        scratch: &mut DynamicsScratch,
        derivatives: &mut TorqueDerivatives,
    ) -> Result<()> {
        self.check_motion(q, qd, qdd, gravity)?;
        scratch.check(self)?;
        let n = self.dof();
        for (what, matrix) in [("q", &derivatives.q), ("qd", &derivatives.qd), ("qdd", &derivatives.qdd)] {
            if matrix.shape() != (n, n) {
                let what = format!("torque derivatives by {what}");
                return Err(Error::Length { what, expected: n * n, actual: matrix.len() });
            }
        }
        let bodies = self.masses()?;
        // Gravity as part of the base's acceleration; the weight is not asked for on its own.
        self.world_pass(bodies, q, qd, qdd, gravity, &Vector3::zeros(), scratch);
        let TorqueDerivatives { q, qd, qdd } = derivatives;
        let out = SplitDerivatives {
            gravity_q: &mut [],
            q: q.as_mut_slice(),
            qd: qd.as_mut_slice(),
            qdd: qdd.as_mut_slice(),
        };
        write_derivatives(&scratch.worlds, out);
        Ok(())
    }

    /// Both parts of `tau = G + v^2 D` for checked arguments: gravity's, and the one of the motion `(q', q'')`.
    pub(crate) fn split_torques(
        &self,
        bodies: &[Body],
        motion: [&[f64]; 3],
        gravity: &Vector3<f64>,
        scratch: &mut DynamicsScratch,
        weights: &mut [f64],
        dynamic: &mut [f64],
    ) {
        self.newton_euler::<false>(bodies, motion, gravity, scratch, |i, dynamic_, weight, _| {
            weights[i] = weight;
            dynamic[i] = dynamic_;
        });
    }

    /// The three parts of `tau = G + v^2 D + a M q'` for checked arguments, in one pass: gravity's, the one of the motion
    /// `(q', q'')`, and the one of an acceleration along `q'`.
    pub(crate) fn path_torques(
        &self,
        bodies: &[Body],
        motion: [&[f64]; 3],
        gravity: &Vector3<f64>,
        scratch: &mut DynamicsScratch,
        [weights, dynamic, inertial]: [&mut [f64]; 3],
    ) {
        self.newton_euler::<true>(bodies, motion, gravity, scratch, |i, dynamic_, weight, push| {
            weights[i] = weight;
            dynamic[i] = dynamic_;
            inertial[i] = push;
        });
    }

    /// Derivatives of both parts, for checked arguments.
    pub(crate) fn split_derivatives(
        &self,
        bodies: &[Body],
        [q, d, dd]: [&[f64]; 3],
        gravity: &Vector3<f64>,
        scratch: &mut DynamicsScratch,
        out: SplitDerivatives<'_>,
    ) {
        self.world_pass(bodies, q, d, dd, &Vector3::zeros(), gravity, scratch);
        write_derivatives(&scratch.worlds, out);
    }

    /// The compiled mass properties.
    ///
    /// # Errors
    /// A chain whose description has none.
    pub(crate) fn masses(&self) -> Result<&[Body]> {
        self.bodies().ok_or_else(|| {
            let message = format!(
                "'{}' has no inertias: torques need mass, centre of mass and inertia of the links (<inertial> in a URDF, \
                 inertia= for Denavit-Hartenberg rows)",
                self.name()
            );
            Error::Invalid(message)
        })
    }

    fn check_motion(&self, q: &[f64], qd: &[f64], qdd: &[f64], gravity: &Vector3<f64>) -> Result<()> {
        self.check_q(q)?;
        check_vector("qd", qd, self.dof())?;
        check_vector("qdd", qdd, self.dof())?;
        check_finite("gravity", gravity.as_slice())
    }

    /// Recursive Newton-Euler; `out` gets the joint, the torque of the motion and the torque of gravity, and with `PUSH` the
    /// torque of an acceleration `qd` from rest, without gravity; else 0.
    #[inline(always)]
    fn newton_euler<const PUSH: bool>(
        &self,
        bodies: &[Body],
        [q, qd, qdd]: [&[f64]; 3],
        gravity: &Vector3<f64>,
        scratch: &mut DynamicsScratch,
        mut out: impl FnMut(usize, f64, f64, f64),
    ) {
        let zero = Vector3::zeros();
        let (mut omega, mut alpha, mut accel, mut lift) = (zero, zero, zero, -gravity);
        // Along `qd` from rest: turning of the frame, which is `omega`, and of its origin.
        let mut push = zero;
        let rows = self.steps().iter().zip(bodies).zip(q.iter().zip(qd).zip(qdd));
        for (((step, body), ((q, qd), qdd)), link) in rows.zip(&mut scratch.links) {
            let (rotation, origin) = placed(step, *q);
            // Into this frame; acceleration of its origin.
            let inner = accel + alpha.cross(&origin) + omega.cross(&omega.cross(&origin));
            accel = rotation.tr_mul(&inner);
            lift = rotation.tr_mul(&lift);
            if PUSH {
                push = rotation.tr_mul(&(push + omega.cross(&origin)));
            }
            omega = rotation.tr_mul(&omega);
            alpha = rotation.tr_mul(&alpha);
            if step.rotational {
                // omega x z qd + z qdd
                alpha += Vector3::new(omega.y * qd, -omega.x * qd, *qdd);
                omega.z += qd;
            } else {
                accel += Vector3::new(2.0 * omega.y * qd, -2.0 * omega.x * qd, *qdd);
                push.z += qd;
            }
            let trace = body.second.trace();
            let spin = |w: &Vector3<f64>| w * trace - body.second * w;
            link.rotation = rotation;
            link.origin = origin;
            link.force =
                accel * body.mass + alpha.cross(&body.moment) + omega.cross(&omega.cross(&body.moment));
            link.torque = spin(&alpha) + omega.cross(&spin(&omega)) + body.moment.cross(&accel);
            link.weight = lift * body.mass;
            link.weight_torque = body.moment.cross(&lift);
            if PUSH {
                link.push = push * body.mass + omega.cross(&body.moment);
                link.push_torque = spin(&omega) + body.moment.cross(&push);
            }
        }
        let (mut force, mut torque, mut weight, mut weight_torque) = (zero, zero, zero, zero);
        let mut push_torque = zero;
        push = zero;
        for i in (0..scratch.links.len()).rev() {
            let link = &scratch.links[i];
            force += link.force;
            torque += link.torque;
            weight += link.weight;
            weight_torque += link.weight_torque;
            let rotor = bodies[i].rotor * qdd[i];
            let mut pushed = 0.0;
            if PUSH {
                push += link.push;
                push_torque += link.push_torque;
                let own = if self.steps()[i].rotational { push_torque.z } else { push.z };
                pushed = own + bodies[i].rotor * qd[i];
            }
            if self.steps()[i].rotational {
                out(i, torque.z + rotor, weight_torque.z, pushed);
            } else {
                out(i, force.z + rotor, weight.z, pushed);
            }
            force = link.rotation * force;
            torque = link.rotation * torque + link.origin.cross(&force);
            weight = link.rotation * weight;
            weight_torque = link.rotation * weight_torque + link.origin.cross(&weight);
            if PUSH {
                push = link.rotation * push;
                push_torque = link.rotation * push_torque + link.origin.cross(&push);
            }
        }
    }

    /// What the derivatives need. `lift` is a gravity inside of the motion, `gravity` one that is kept apart.
    fn world_pass(
        &self,
        bodies: &[Body],
        q: &[f64],
        qd: &[f64],
        qdd: &[f64],
        lift: &Vector3<f64>,
        gravity: &Vector3<f64>,
        scratch: &mut DynamicsScratch,
    ) {
        let mut frame = Frame::world();
        let mut velocity = Six::default();
        let mut acceleration = Six::new(-lift, Vector3::zeros());
        let apart = Six::new(-gravity, Vector3::zeros());
        let rows = self.steps().iter().zip(bodies).zip(q.iter().zip(qd).zip(qdd));
        for (((step, body), ((q, qd), qdd)), world) in rows.zip(&mut scratch.worlds) {
            let at = frame.at_joint(step);
            frame = at.moved(step, *q);
            let axis = if step.rotational {
                Six::new(at.origin.cross(&at.z), at.z)
            } else {
                Six::new(at.z, Vector3::zeros())
            };
            let rate = velocity.cross(&axis);
            world.axis = axis;
            world.rate = rate;
            world.second_rate = acceleration.cross(&axis) + velocity.cross(&rate);
            world.weight_rate = apart.cross(&axis);
            world.rotor = body.rotor;
            velocity = velocity + axis * *qd;
            // velocity x axis qd, since axis x axis = 0
            acceleration = acceleration + axis * *qdd + rate * *qd;
            let turn = Matrix3::from_columns(&[frame.x, frame.y, frame.z]);
            let mass = Mass::placed(body, &turn, &frame.origin);
            let momentum = mass.times(&velocity);
            world.force = mass.times(&acceleration) + velocity.cross_force(&momentum);
            world.weight = mass.times(&apart);
            world.momentum = momentum.lin;
            // -[h][v] - [omega] Sigma, with [h][v] = v h^T - (h.v) 1
            let (v, h) = (velocity.lin, mass.moment);
            world.coriolis = Matrix3::from_diagonal_element(h.dot(&v))
                - v * h.transpose()
                - velocity.ang.cross_matrix() * mass.second;
            world.mass = mass;
        }
        for i in (1..scratch.worlds.len()).rev() {
            let (before, after) = scratch.worlds.split_at_mut(i);
            let (outer, inner) = (&mut before[i - 1], &after[0]);
            outer.mass.add(&inner.mass);
            outer.momentum += inner.momentum;
            outer.coriolis += inner.coriolis;
            outer.force = outer.force + inner.force;
            outer.weight = outer.weight + inner.weight;
        }
    }
}

/// Frame of a moved joint in the frame of the body before.
#[inline(always)]
fn placed(step: &Step, q: f64) -> (Matrix3<f64>, Vector3<f64>) {
    let r = &step.rotation;
    if !step.rotational {
        return (*r, step.translation + r.column(2) * q);
    }
    let (sin, cos) = sin_cos(q);
    let (x, y) = (r.column(0), r.column(1));
    let rotation = Matrix3::from_columns(&[x * cos + y * sin, y * cos - x * sin, r.column(2).into_owned()]);
    (rotation, step.translation)
}

/// The formulas of the module's head; `gravity_q` may be empty when it is not asked for.
#[inline(always)]
fn write_derivatives(worlds: &[WorldState], out: SplitDerivatives<'_>) {
    let n = worlds.len();
    let apart = !out.gravity_q.is_empty();
    for i in 0..n {
        let w = &worlds[i];
        // Rows: S_i^T I_i and S_i^T 2 B_i, of which only the angular part is not zero.
        let row = w.mass.times(&w.axis);
        let bend = (w.momentum.cross(&w.axis.lin) + w.coriolis.tr_mul(&w.axis.ang)) * 2.0;
        // Columns: what a change of joint i does to the forces beyond it.
        let twice = |m: &Six| Six::new(m.ang.cross(&w.momentum), w.coriolis * m.ang) * 2.0;
        let by_qd = twice(&w.axis) + w.mass.times(&w.rate) * 2.0;
        let by_q = twice(&w.rate) + w.mass.times(&w.second_rate) + w.axis.cross_force(&w.force);
        let by_weight = w.mass.times(&w.weight_rate) + w.axis.cross_force(&w.weight);
        for j in 0..=i {
            let o = &worlds[j];
            let (low, high) = (i + j * n, j + i * n);
            let mass = row.dot(&o.axis);
            out.qdd[low] = mass;
            out.qdd[high] = mass;
            out.qd[high] = o.axis.dot(&by_qd);
            out.qd[low] = bend.dot(&o.axis.ang) + 2.0 * row.dot(&o.rate);
            out.q[high] = o.axis.dot(&by_q);
            out.q[low] = bend.dot(&o.rate.ang) + row.dot(&o.second_rate);
            if apart {
                out.gravity_q[high] = o.axis.dot(&by_weight);
                out.gravity_q[low] = row.dot(&o.weight_rate);
            }
        }
        out.qdd[i + i * n] += w.rotor;
    }
}
