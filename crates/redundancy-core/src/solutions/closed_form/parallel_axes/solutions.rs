//! The isolated configurations of an arm with three parallel axes as [`Solutions`], and the arm as a [`ClosedForm`].

use std::any::Any;

use super::arm::ParallelAxesArm;
use crate::chain::Chain;
use crate::criterion::{Criterion, check_dof};
use crate::error::{Error, Result, check_finite, check_length};
use crate::joint_space::outside;
use crate::pose::{Pose, checked_pose};
use crate::solutions::closed_form::{ClosedForm, Defect, sign_label};
use crate::solutions::{Solution, Solutions, best_margin, check_margin, check_piece, room, search};
use crate::status::Status;

/// Every configuration over one pose.
#[derive(Debug, Clone)]
pub struct ParallelAxesConfigurations {
    /// `Converged`, `Unreachable`, or `Limits` (in reach, but no branch within the joint limits).
    pub status: Status,
    /// Why there is none within the limits, and by how much; empty when there is one.
    pub reason: String,
    /// How far the wrist is from what shoulder and elbow reach, m; 0 in reach, and where it is joint 5 that does not reach.
    pub distance: f64,
    /// The configurations within the limits, in branch order.
    pub q: Vec<[f64; 6]>,
    /// Their branches, `4 [shoulder < 0] + 2 [elbow < 0] + [wrist < 0]`.
    pub branches: Vec<usize>,
    arm: ParallelAxesArm,
    pose: Pose,
    /// All branches, within the limits where a winding allows it.
    rows: [[f64; 6]; 8],
    /// Bit `b`: row `b` is a configuration, limits aside.
    reachable: u8,
    /// Why the list may not be complete: the arm is not ideal, the pose leaves a joint free, or rounding decides.
    not_proven: Option<String>,
}

impl ParallelAxesArm {
    /// Every configuration over `pose` within the limits; if there is none, the reason with the numbers.
    ///
    /// # Errors
    /// A pose that is not rigid or finite.
    pub fn configurations(&self, pose: &Pose) -> Result<ParallelAxesConfigurations> {
        let pose = &checked_pose("pose", pose)?;
        let (mut rows, mut wound) = ([[0.0; 6]; 8], [[0.0; 6]; 8]);
        let reachable = self.solve_into(pose, false, &mut rows);
        let mask = self.solve_into(pose, true, &mut wound);
        let branches: Vec<usize> = (0..8).filter(|b| mask & (1 << b) != 0).collect();
        for b in &branches {
            rows[*b] = wound[*b];
        }
        let q = branches.iter().map(|b| rows[*b]).collect();
        let (mut status, mut reason, mut distance) = (Status::Converged, String::new(), 0.0);
        if reachable == 0 {
            status = Status::Unreachable;
            (reason, distance) = self.unreachable_reason(pose);
        } else if branches.is_empty() {
            (status, reason) = (Status::Limits, self.limits_reason(&rows, reachable));
        }
        let not_proven = if self.exact() {
            self.doubt(pose)
        } else {
            let Defect { position, orientation } = self.defect();
            Some(format!(
                "the verdict is that of an ideal arm, from which this one deviates by {position:.1e} m and {orientation:.1e} rad"
            ))
        };
        let (arm, pose) = (self.clone(), *pose);
        Ok(ParallelAxesConfigurations {
            status,
            reason,
            distance,
            q,
            branches,
            arm,
            pose,
            rows,
            reachable: reachable | mask,
            not_proven,
        })
    }
}

impl ParallelAxesConfigurations {
    /// Whether status and branches say everything: the arm is exact, the pose leaves no joint free, and joint 5 does not turn back
    /// there.
    pub fn proven(&self) -> bool {
        self.not_proven.is_none()
    }

    /// The branch of a piece.
    fn branch(&self, piece: usize) -> Result<usize> {
        check_piece(piece, self.pieces())?;
        Ok((0..8).filter(|b| self.reachable & (1 << b) != 0).nth(piece).unwrap_or(0))
    }

    /// The piece of a branch.
    fn piece(&self, branch: usize) -> usize {
        (self.reachable & ((1u8 << branch) - 1)).count_ones() as usize
    }
}

impl Solutions for ParallelAxesConfigurations {
    fn chain(&self) -> &Chain {
        self.arm.chain()
    }

    fn dimension(&self) -> usize {
        0
    }

    fn status(&self) -> Status {
        self.status
    }

    fn reason(&self) -> String {
        match &self.not_proven {
            None => self.reason.clone(),
            Some(why) if self.reason.is_empty() => why.clone(),
            Some(why) => format!("{}; {why}", self.reason),
        }
    }

    fn proven(&self) -> bool {
        ParallelAxesConfigurations::proven(self)
    }

    fn pieces(&self) -> usize {
        self.reachable.count_ones() as usize
    }

    fn label(&self, piece: usize) -> Result<String> {
        Ok(sign_label(ParallelAxesArm::signs(self.branch(piece)?)))
    }

    fn closed(&self, piece: usize) -> Result<bool> {
        check_piece(piece, self.pieces()).map(|()| false)
    }

    fn range(&self, piece: usize) -> Result<[f64; 2]> {
        check_piece(piece, self.pieces()).map(|()| [0.0, 0.0])
    }

    fn q(&self, piece: usize, u: f64, out: &mut [f64]) -> Result<()> {
        check_finite("u", &[u])?;
        check_length("out", out, 6)?;
        out.copy_from_slice(&self.rows[self.branch(piece)?]);
        Ok(())
    }

    fn tangent(&self, piece: usize, _u: f64, _out: &mut [f64]) -> Result<()> {
        check_piece(piece, self.pieces())?;
        Err(Error::Invalid("an isolated configuration has no tangent".into()))
    }

    fn intervals(&self, piece: usize, margin: f64) -> Result<Vec<[f64; 2]>> {
        check_margin(margin)?;
        let row = &self.rows[self.branch(piece)?];
        let (lower, upper) = (self.chain().lower(), self.chain().upper());
        let holds = (0..6).all(|i| {
            let (lower, upper) = (lower[i] + margin, upper[i] - margin);
            lower <= upper && outside(row[i], lower, upper) <= 0.0
        });
        Ok(if holds { vec![[0.0, 0.0]] } else { Vec::new() })
    }

    fn parameter(&self, piece: usize, _u: f64) -> Result<Option<f64>> {
        check_piece(piece, self.pieces()).map(|()| None)
    }

    fn nearest(&self, q: &[f64]) -> Result<Option<Solution>> {
        self.arm.chain().check_q(q)?;
        let Some((branch, near)) = self.arm.nearest_branch(&self.pose, q) else { return Ok(None) };
        let value = near.iter().zip(q).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        Ok(Some(Solution {
            q: near.to_vec(),
            piece: self.piece(branch),
            u: 0.0,
            value,
            proven: self.proven(),
        }))
    }

    fn best(&self, criterion: &dyn Criterion) -> Result<Option<Solution>> {
        check_dof(criterion, 6)?;
        search::best(self, criterion)
    }

    fn best_margin(&self) -> Result<Option<Solution>> {
        best_margin(self)
    }

    fn proves_margin(&self, _margin: f64) -> bool {
        self.proven()
    }

    fn feasible_measure(&self) -> Result<f64> {
        Ok(0.0)
    }
}

impl ClosedForm for ParallelAxesArm {
    fn name(&self) -> &'static str {
        "parallel_axes"
    }

    fn chain(&self) -> &Chain {
        ParallelAxesArm::chain(self)
    }

    fn defect(&self) -> Defect {
        ParallelAxesArm::defect(self)
    }

    fn parameter(&self) -> Option<&'static str> {
        None
    }

    fn solutions(&self, pose: &Pose) -> Result<Box<dyn Solutions>> {
        Ok(Box::new(self.configurations(pose)?))
    }

    fn in_reach(&self, pose: &Pose) -> bool {
        self.solve_into(pose, false, &mut [[0.0; 6]; 8]) != 0
    }

    fn starts(&self, pose: &Pose) -> Vec<Vec<f64>> {
        self.solve(pose, false).into_iter().flatten().map(|q| q.to_vec()).collect()
    }

    fn branches(&self) -> usize {
        8
    }

    fn branches_into(&self, pose: &Pose, out: &mut [f64]) -> u32 {
        let (rows, _) = out.as_chunks_mut::<6>();
        match rows.first_chunk_mut::<8>() {
            Some(rows) => u32::from(self.solve_into(pose, false, rows)),
            None => 0,
        }
    }

    fn proves(&self, pose: &Pose) -> bool {
        self.exact() && self.doubt(pose).is_none()
    }

    fn select(
        &self,
        pose: &Pose,
        q0: Option<&[f64]>,
        criterion: Option<&dyn Criterion>,
        q: &mut [f64],
    ) -> Status {
        let mut rows = [[0.0; 6]; 8];
        let mask = self.solve_into(pose, true, &mut rows);
        if mask == 0 {
            return if self.in_reach(pose) { Status::Limits } else { Status::Unreachable };
        }
        if let Some(near) = q0.and_then(|q0| self.nearest_unchecked(pose, q0)) {
            q.copy_from_slice(&near);
            return Status::Converged;
        }
        let value = |row: &[f64; 6]| match criterion {
            Some(criterion) => criterion.sense().sign() * criterion.value(row),
            None => -room(self.chain(), row),
        };
        let valid = (0..8).filter(|b| mask & (1 << b) != 0).map(|b| (value(&rows[b]), b));
        let Some((_, best)) = valid.min_by(|a, b| a.0.total_cmp(&b.0)) else {
            return Status::IterationLimit;
        };
        q.copy_from_slice(&rows[best]);
        Status::Converged
    }

    fn as_any(&self) -> &dyn Any {
        self
    }
}
