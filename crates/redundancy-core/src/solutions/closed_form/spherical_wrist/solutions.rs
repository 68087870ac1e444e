//! The isolated configurations of an arm with a spherical wrist as [`Solutions`], and the arm as a [`ClosedForm`].

use std::any::Any;
use std::f64::consts::PI;

use super::arm::{Configurations, SphericalWristArm};
use crate::chain::Chain;
use crate::criterion::Criterion;
use crate::error::{Error, Result, check_finite, check_length};
use crate::joint_space::TURN;
use crate::pose::Pose;
use crate::solutions::closed_form::{ClosedForm, Defect, sign_label};
use crate::solutions::{Solution, Solutions, best_margin, check_margin, check_piece, room, search};
use crate::status::Status;

/// Values of a joint that the pose leaves free at which a criterion is compared before the best is refined.
const FREE_SAMPLES: usize = 72;
/// Step (rad) at which the refinement ends.
const FREE_STEP: f64 = 1e-9;

impl Configurations {
    /// The branch of a piece.
    fn branch(&self, piece: usize) -> Result<usize> {
        check_piece(piece, self.pieces())?;
        Ok((0..8).filter(|b| self.reachable & (1 << b) != 0).nth(piece).unwrap_or(0))
    }

    /// The piece of a branch.
    fn piece(&self, branch: usize) -> usize {
        (self.reachable & ((1u8 << branch) - 1)).count_ones() as usize
    }

    /// Why the verdict is not exact.
    fn not_proven(&self) -> Option<String> {
        if !self.arm.exact() {
            let Defect { position, orientation } = self.arm.defect();
            return Some(format!(
                "the verdict is that of an ideal arm, from which this one deviates by {position:.1e} m and {orientation:.1e} rad"
            ));
        }
        let joints = self.arm.chain().joints();
        if self.free {
            return Some(format!(
                "the wrist centre is on the first axis: '{}' may take any value",
                joints[0].name
            ));
        }
        let (a, c) = (&joints[3].name, &joints[5].name);
        self.at_gimbal()
            .then(|| format!("the wrist is at its gimbal: only the sum of '{a}' and '{c}' is determined"))
    }

    /// A branch, with joint 1 at `first` where it is free.
    fn row(&self, branch: usize, first: f64) -> [f64; 6] {
        if self.free { self.arm.row_at(&self.pose, first, branch) } else { self.rows[branch] }
    }

    /// Whether a branch may share the sum of joints 4 and 6.
    fn at_gimbal(&self) -> bool {
        (0..8).any(|b| self.reachable & (1 << b) != 0 && self.arm.wrist_share(&self.rows[b]).is_some())
    }

    /// Whether status and branches say everything: the arm is exact, and the pose leaves no joint free.
    pub fn proven(&self) -> bool {
        self.status == Status::Unreachable && self.arm.exact() || self.not_proven().is_none()
    }

    /// [`Solutions::best`] where the pose leaves joints free: they are sampled, and the best is refined.
    fn best_of_families(&self, criterion: &dyn Criterion) -> Option<Solution> {
        let sign = criterion.sense().sign();
        let springs = criterion.springs().filter(|_| sign > 0.0);
        let chain = self.arm.chain();
        let mut best: Option<Solution> = None;
        // Joint 1 at `first`, joint 4 moved by `share` and joint 6 with it.
        let mut offer = |branch: usize, first: f64, share: f64| -> f64 {
            let mut q = self.row(branch, first);
            if let Some(sense) = self.arm.wrist_share(&q) {
                q[3] += share;
                q[5] -= sense * share;
            }
            if !search::hold_limits(chain, springs.as_deref(), &mut q) {
                return f64::INFINITY;
            }
            let value = sign * criterion.value(&q);
            if best.as_ref().is_none_or(|best| value < sign * best.value) {
                let piece = self.piece(branch);
                best = Some(Solution { q: q.to_vec(), piece, u: 0.0, value: sign * value, proven: false });
            }
            value
        };
        let samples = |sampled: bool| if sampled { FREE_SAMPLES } else { 1 };
        let angle = |k: usize| TURN * k as f64 / FREE_SAMPLES as f64 - PI;
        for branch in (0..8).filter(|b| self.reachable & (1 << b) != 0) {
            let mut least = (f64::INFINITY, 0.0, 0.0);
            for i in 0..samples(self.free) {
                let first = angle(i);
                let shares = self.arm.wrist_share(&self.row(branch, first)).is_some();
                for j in 0..samples(shares) {
                    let share = if shares { angle(j) } else { 0.0 };
                    let value = offer(branch, first, share);
                    least = if value < least.0 { (value, first, share) } else { least };
                }
            }
            let mut step = TURN / FREE_SAMPLES as f64;
            while least.0.is_finite() && step > FREE_STEP {
                let before = least.0;
                for [d, e] in [[step, 0.0], [-step, 0.0], [0.0, step], [0.0, -step]] {
                    let value = offer(branch, least.1 + d, least.2 + e);
                    least = if value < least.0 { (value, least.1 + d, least.2 + e) } else { least };
                }
                step *= if least.0 < before { 1.0 } else { 0.5 };
            }
        }
        best
    }
}

impl Solutions for Configurations {
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
        match self.not_proven().filter(|_| self.status != Status::Unreachable || !self.arm.exact()) {
            None => self.reason.clone(),
            Some(why) if self.reason.is_empty() => why,
            Some(why) => format!("{}; {why}", self.reason),
        }
    }

    fn proven(&self) -> bool {
        Configurations::proven(self)
    }

    fn pieces(&self) -> usize {
        self.reachable.count_ones() as usize
    }

    fn label(&self, piece: usize) -> Result<String> {
        Ok(sign_label(SphericalWristArm::signs(self.branch(piece)?)))
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
        let holds = self.arm.holds_margin(&self.rows[self.branch(piece)?], margin);
        Ok(if holds { vec![[0.0, 0.0]] } else { Vec::new() })
    }

    fn parameter(&self, piece: usize, _u: f64) -> Result<Option<f64>> {
        check_piece(piece, self.pieces()).map(|()| None)
    }

    fn nearest(&self, q: &[f64]) -> Result<Option<Solution>> {
        self.arm.chain().check_q(q)?;
        let Some((branch, near)) = self.arm.nearest_branch(&self.pose, q) else { return Ok(None) };
        let value = near.iter().zip(q).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        let proven = self.arm.exact() && !self.free;
        Ok(Some(Solution { q: near.to_vec(), piece: self.piece(branch), u: 0.0, value, proven }))
    }

    fn best(&self, criterion: &dyn Criterion) -> Result<Option<Solution>> {
        criterion.check_arm(self.chain())?;
        if self.free || self.at_gimbal() {
            return Ok(self.best_of_families(criterion));
        }
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

impl ClosedForm for SphericalWristArm {
    fn name(&self) -> &'static str {
        "spherical_wrist"
    }

    fn chain(&self) -> &Chain {
        SphericalWristArm::chain(self)
    }

    fn defect(&self) -> Defect {
        SphericalWristArm::defect(self)
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
