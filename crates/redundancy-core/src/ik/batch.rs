//! Many poses at once: spread over the current pool, the same bits whatever the number of threads.

use super::solver::{IkResult, IkSolver};
use crate::error::{Error, Result, check_finite, check_length};
use crate::parallel::prelude::*;
use crate::pose::pose_from_row_major;
use crate::solutions::at;
use crate::status::Status;

/// Poses that one task of the pool takes at least: its memory is made once for all of them.
const TASK: usize = 32;

/// Where the answers over many poses go; lengths N, `q` of length `N * n`.
#[derive(Debug)]
pub struct IkBatch<'a> {
    /// Configurations, row by row.
    pub q: &'a mut [f64],
    /// What came out.
    pub status: &'a mut [Status],
    /// Iterations over all starts.
    pub iterations: &'a mut [u32],
    /// Distances from the targets, m.
    pub position_error: &'a mut [f64],
    /// Angles from the targets, rad.
    pub orientation_error: &'a mut [f64],
    /// Whether each status is exact.
    pub proven: &'a mut [bool],
}

impl IkSolver {
    /// [`IkSolver::solve`] for many poses (`N * 16` numbers, row-major matrices), from one `q0` for all (n numbers), one
    /// each (`N * n`), or none. Row i is to the bit what `solve` gives for pose i with the same seed.
    ///
    /// # Errors
    /// Wrong lengths, a pose that is not rigid or finite (the message gives its index), an entry of `q0` that is not
    /// finite.
    pub fn solve_batch(
        &self,
        poses: &[f64],
        q0: Option<&[f64]>,
        seed: u64,
        out: &mut IkBatch<'_>,
    ) -> Result<()> {
        let (rows, n) = (poses.len() / 16, self.chain().dof());
        check_length("poses", poses, rows * 16)?;
        check_length("q", out.q, rows * n)?;
        let lengths = [
            out.status.len(),
            out.iterations.len(),
            out.position_error.len(),
            out.orientation_error.len(),
            out.proven.len(),
        ];
        if let Some(actual) = lengths.into_iter().find(|length| *length != rows) {
            return Err(Error::Length { what: "results".into(), expected: rows, actual });
        }
        if let Some(q0) = q0 {
            check_length("q0", q0, if q0.len() == n { n } else { rows * n })?;
            check_finite("q0", q0)?;
        }
        let start = |i: usize| q0.map(|q0| if q0.len() == n { q0 } else { &q0[i * n..(i + 1) * n] });
        let numbers =
            out.iterations.par_iter_mut().zip(&mut *out.position_error).zip(&mut *out.orientation_error);
        out.q
            .par_chunks_exact_mut(n)
            .zip(&mut *out.status)
            .zip(&mut *out.proven)
            .zip(numbers)
            .zip(poses.as_chunks::<16>().0)
            .enumerate()
            .with_min_len(TASK)
            .try_for_each_init(
                || (self.memory(), IkResult::new(n)),
                |(memory, result), (i, ((((q, status), proven), ((iterations, position), orientation)), pose))| {
                    let pose = pose_from_row_major(pose).map_err(at(i))?;
                    self.solve_unchecked(&pose, start(i), seed, memory, result);
                    q.copy_from_slice(&result.q);
                    (*status, *proven) = (result.status, result.proven);
                    *iterations = u32::try_from(result.iterations).unwrap_or(u32::MAX);
                    (*position, *orientation) = (result.position_error, result.orientation_error);
                    Ok(())
                },
            )
    }
}
