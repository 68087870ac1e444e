//! Many poses at once: spread over the current pool, the same bits whatever the number of threads.

use super::arm::{SrsArm, Swivel};
use super::choice::Choice;
use super::circle::SelfMotion;
use crate::criterion::Criterion;
use crate::error::{Error, Result, check_length};
use crate::parallel::prelude::*;
use crate::pose::pose_from_row_major;

/// Poses that one task of the pool takes at least.
const TASK: usize = 64;

/// One feasible interval of one branch over one pose of a batch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BranchInterval {
    /// Index of the pose.
    pub pose: usize,
    /// Index of the branch, `4 [s2 < 0] + 2 [s4 < 0] + [s6 < 0]`.
    pub branch: usize,
    /// The interval, see [`Branch::intervals`](super::Branch::intervals).
    pub interval: [f64; 2],
}

/// What was chosen over each pose of a batch; `None` where no configuration holds the limits.
pub type BatchChoice = Vec<Option<Choice>>;

/// Names the pose in an error.
pub(crate) fn at(index: usize) -> impl Fn(Error) -> Error {
    move |error| Error::Invalid(format!("pose {index}: {error}"))
}

impl SrsArm {
    /// All branches over many poses (`N * 16` numbers, row-major matrices) with one swivel each, or one for all.
    ///
    /// Writes `N * 8 * 7` joint values in branch order to `q` and `N * 8` flags to `valid`; rows that are not valid are
    /// finite but meaningless.
    ///
    /// # Errors
    /// Wrong lengths, a pose that is not rigid or finite (the message gives its index), a swivel that is not finite.
    pub fn solve_batch(
        &self,
        poses: &[f64],
        swivels: &[f64],
        limits: bool,
        q: &mut [f64],
        valid: &mut [bool],
    ) -> Result<()> {
        let n = poses.len() / 16;
        check_length("poses", poses, n * 16)?;
        check_length("swivels", swivels, if swivels.len() == 1 { 1 } else { n })?;
        check_length("q", q, n * 56)?;
        if valid.len() != n * 8 {
            return Err(Error::Length { what: "valid".into(), expected: n * 8, actual: valid.len() });
        }
        let common = if swivels.len() == 1 { Some(Swivel::Angle(swivels[0]).direction()?) } else { None };
        let rows = q.as_chunks_mut::<56>().0.par_iter_mut();
        let rows =
            rows.zip(valid.as_chunks_mut::<8>().0.par_iter_mut()).zip(poses.as_chunks::<16>().0.par_iter());
        rows.enumerate().with_min_len(TASK).try_for_each(|(i, ((rows, valid), pose))| {
            let pose = pose_from_row_major(pose).map_err(at(i))?;
            let u = match common {
                Some(u) => u,
                None => Swivel::Angle(swivels[i]).direction().map_err(at(i))?,
            };
            let mut out = [[0.0; 7]; 8];
            let mask = self.solve_into(&pose, u, limits, &mut out);
            rows.copy_from_slice(out.as_flattened());
            *valid = std::array::from_fn(|branch| mask & (1 << branch) != 0);
            Ok(())
        })
    }

    /// The feasible intervals of all branches over many poses, ordered by pose, branch and swivel.
    ///
    /// # Errors
    /// A length that is not a multiple of 16, a pose that is not rigid or finite, a negative margin.
    pub fn intervals_batch(&self, poses: &[f64], margin: f64) -> Result<Vec<BranchInterval>> {
        let rows = self.over_poses(poses, |pose, motion| {
            let mut rows = Vec::new();
            for branch in motion.branches() {
                let branch_rows = branch.intervals(margin)?.into_iter();
                rows.extend(branch_rows.map(|interval| BranchInterval {
                    pose,
                    branch: branch.index(),
                    interval,
                }));
            }
            Ok(rows)
        })?;
        Ok(rows.into_iter().flatten().collect())
    }

    /// [`SelfMotion::best`] over many poses.
    ///
    /// # Errors
    /// A length that is not a multiple of 16, a pose that is not rigid or finite, a criterion for another number of
    /// joints.
    pub fn best_batch(&self, poses: &[f64], criterion: &dyn Criterion) -> Result<BatchChoice> {
        criterion.check_arm(self.chain())?;
        self.over_poses(poses, |_, motion| motion.best(criterion))
    }

    /// [`SelfMotion::nearest`] over many poses, to one `q` for all (7 numbers) or one for each (`N * 7`).
    ///
    /// # Errors
    /// Wrong lengths, a pose that is not rigid or finite, an entry of `q` that is not finite.
    pub fn nearest_batch(&self, poses: &[f64], q: &[f64]) -> Result<BatchChoice> {
        let n = poses.len() / 16;
        check_length("q", q, if q.len() == 7 { 7 } else { n * 7 })?;
        let wish = |i: usize| if q.len() == 7 { q } else { &q[7 * i..7 * i + 7] };
        self.over_poses(poses, |i, motion| motion.nearest(wish(i)))
    }

    fn over_poses<T: Send>(
        &self,
        poses: &[f64],
        work: impl Fn(usize, &SelfMotion) -> Result<T> + Sync,
    ) -> Result<Vec<T>> {
        check_length("poses", poses, poses.len() / 16 * 16)?;
        let one = |(i, pose): (usize, &[f64; 16])| {
            let pose = pose_from_row_major(pose).map_err(at(i))?;
            self.self_motion(&pose).and_then(|motion| work(i, &motion)).map_err(at(i))
        };
        poses.as_chunks::<16>().0.par_iter().enumerate().with_min_len(TASK).map(one).collect()
    }
}
