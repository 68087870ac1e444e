//! All rows of a line at once to a local optimum, by an interior-point Newton method on the task's manifold.
//!
//! # Problem
//! Minimise the cost of [`Demand`] (or the peak speed) over configurations that meet the equations of the tool at every
//! row, subject to joint limits, cone, spin range and largest steps, `h_j >= 0`.
//!
//! # Method
//! Slacks `s_j = h_j` with multipliers `z_j`, `s_j z_j = mu`, and `mu` driven to zero [NocedalWright2006, ch. 19]. At each
//! row the equations leave an orthonormal basis `Z_k` of joint motions; a step is `d_k = Z_k x_k`, after which Newton's
//! method brings the row back onto the task. On this manifold the Newton system is
//!
//! `sum over neighbours of Z^T (d2f - sum z d2h + sum lambda d2c + sum (z/s) dh dh^T) Z x = -Z^T (df - sum y dh)`
//!
//! with the multipliers `lambda` of the equations by least squares, and `y = mu/s - (z/s)(h - s)`. Rows couple to
//! their neighbours only, so it is block tridiagonal with blocks of the number of spare coordinates. The curvature
//! of the constraints is exact; without it the convergence is linear and stalls. Where the reduced Hessian is not positive
//! definite, the rows concerned are damped ([`banded`]), and a line search on the merit `f - mu sum log s + nu sum |h - s|`
//! makes every step go down.
//!
//! A start may break limits: slacks are put inside, and what is missing shrinks with every step.
//!
//! Cost: about 4 us per row and iteration for seven joints.

mod assemble;
mod banded;
mod bounds;
mod correct;
mod goal;
mod inequalities;
mod interior;
mod linear;
mod row;
mod rows;

pub(super) use goal::Goal;
pub(super) use interior::{LEGAL, Refined, Refinement, refine};
