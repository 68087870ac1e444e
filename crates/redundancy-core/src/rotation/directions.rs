//! The best tool directions between two cones, many rows in one call.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Unit, Vector3};

use crate::error::{Error, Result, check_finite};
use crate::parallel::prelude::*;
use crate::rotation::arc::TwoCones;
use crate::rotation::barrier::Barrier;
use crate::rotation::cone::Cone;
use crate::rotation::optimize::{OrientationOptimizer, OrientationSettings};
use crate::rotation::quaternion::unit_direction;
use crate::status::Status;

/// The best tool directions between cones around many pairs of directions, in one call.
///
/// Row i of `axes` is the direction within `beta` (rad) of `normals[i]` and within `alpha` of `directions[i]` that
/// minimises `-k_err log((z . n - cos beta)/2) - k_tcp log((z . d - cos alpha)/2)` [FromGravdahl2009, eq. (34)];
/// where the cones miss each other it is the middle of the gap and the status `Infeasible`. `normals` are the
/// directions that the tool axis should follow: for a tool that looks at a surface, into the surface. Rows need not
/// be of unit length. Runs on the current pool; the results do not depend on its size.
///
/// # Errors
/// Inputs and outputs of different lengths, a row without a direction, a half-angle outside (0, pi), a weight that is
/// not positive and finite. From half-angles of 90 degrees on every row is solved by Newton.
///
/// ```
/// use redundancy_core::Status;
/// use redundancy_core::rotation::{DirectionCones, optimal_directions};
/// let (mut axes, mut status) = ([[0.0; 3]; 1], [Status::Infeasible; 1]);
/// let cones = DirectionCones { beta: 0.4, alpha: 1.0, k_err: 1.0, k_tcp: 1.0 };
/// optimal_directions(&[[0., 0., -1.]], &[[0.5, 0., -1.]], &cones, &mut axes, &mut status)?;
/// assert!(status[0] == Status::Converged && axes[0][0] > 0.0);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
pub fn optimal_directions(
    normals: &[[f64; 3]],
    directions: &[[f64; 3]],
    cones: &DirectionCones,
    axes: &mut [[f64; 3]],
    status: &mut [Status],
) -> Result<()> {
    cones.solve_rows(0, normals, directions, axes, status)
}

/// Rows that one task of the pool takes: about 50 us.
const ROWS_PER_TASK: usize = 512;

/// Normalises a vector of ordinary length without the checks' cost.
#[inline]
fn quick_direction(v: &[f64; 3]) -> Option<Unit<Vector3<f64>>> {
    let v = Vector3::from(*v);
    let squared = v.norm_squared();
    (squared > 1e-6 && squared < 1e6).then(|| Unit::new_unchecked(v / squared.sqrt()))
}

/// Half-angles (rad) and weights that all rows of [`optimal_directions`] share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DirectionCones {
    /// Half-angle around the normal, rad.
    pub beta: f64,
    /// Half-angle around the wanted direction, rad.
    pub alpha: f64,
    /// Weight of the barrier of the normal's cone.
    pub k_err: f64,
    /// Weight of the barrier of the wanted direction's cone.
    pub k_tcp: f64,
}

enum DirectionSolver {
    Closed(TwoCones),
    Newton(DirectionCones),
}

impl DirectionCones {
    /// Checks angles and weights.
    ///
    /// # Errors
    /// A half-angle outside (0, pi), a weight that is not positive and finite.
    pub fn validate(&self) -> Result<()> {
        self.solver().map(|_| ())
    }

    /// [`optimal_directions`] on a part of a longer batch, whose first row has the number `first_row` in messages.
    ///
    /// # Errors
    /// As [`optimal_directions`].
    pub fn solve_rows(
        &self,
        first_row: usize,
        normals: &[[f64; 3]],
        directions: &[[f64; 3]],
        axes: &mut [[f64; 3]],
        status: &mut [Status],
    ) -> Result<()> {
        let n = normals.len();
        for (what, length) in
            [("directions", directions.len()), ("axes", axes.len()), ("status", status.len())]
        {
            if length != n {
                return Err(Error::Length { what: what.into(), expected: n, actual: length });
            }
        }
        let solver = self.solver()?;
        let block = |(start, (out, status)): (usize, (&mut [[f64; 3]], &mut [Status]))| -> Result<()> {
            for (i, (out, status)) in out.iter_mut().zip(status).enumerate() {
                let local = start * ROWS_PER_TASK + i;
                let row = first_row + local;
                let named = |what: &str, v: &[f64; 3]| {
                    quick_direction(v).map_or_else(|| unit_direction(&format!("{what}, row {row}"), *v), Ok)
                };
                let (u, c) = (named("normals", &normals[local])?, named("directions", &directions[local])?);
                let (z, s) = solver.solve(&u, &c)?;
                *out = [z.x, z.y, z.z];
                *status = s;
            }
            Ok(())
        };
        axes.par_chunks_mut(ROWS_PER_TASK)
            .zip(status.par_chunks_mut(ROWS_PER_TASK))
            .enumerate()
            .map(block)
            .collect::<Vec<_>>()
            .into_iter()
            .collect()
    }

    fn solver(&self) -> Result<DirectionSolver> {
        check_finite("beta, alpha", &[self.beta, self.alpha])?;
        if self.beta >= FRAC_PI_2 || self.alpha >= FRAC_PI_2 {
            let z = Vector3::z_axis();
            self.optimizer(&z, &z)?;
            return Ok(DirectionSolver::Newton(*self));
        }
        TwoCones::new(self.beta, self.alpha, self.k_err, self.k_tcp).map(DirectionSolver::Closed)
    }

    fn optimizer(&self, u: &Unit<Vector3<f64>>, c: &Unit<Vector3<f64>>) -> Result<OrientationOptimizer> {
        let z = [0.0, 0.0, 1.0];
        let named = |what: &str, angle: f64, d: &Unit<Vector3<f64>>| {
            Cone::new(z, [d.x, d.y, d.z], angle).map_err(|_| Error::OutOfRange {
                what: what.into(),
                value: angle,
                bound: "in (0, pi) rad".into(),
            })
        };
        let barriers = vec![
            Barrier::new(self.k_err, named("beta", self.beta, u)?)?,
            Barrier::new(self.k_tcp, named("alpha", self.alpha, c)?)?,
        ];
        OrientationOptimizer::new(barriers, OrientationSettings::default())
    }
}

impl DirectionSolver {
    #[inline]
    fn solve(&self, u: &Unit<Vector3<f64>>, c: &Unit<Vector3<f64>>) -> Result<(Unit<Vector3<f64>>, Status)> {
        match self {
            Self::Closed(cones) => {
                let best = cones.minimum(u, c);
                Ok((best.direction, best.status))
            }
            Self::Newton(cones) => {
                let best = cones.optimizer(u, c)?.solve(None);
                Ok((best.q * Vector3::z_axis(), best.status))
            }
        }
    }
}
