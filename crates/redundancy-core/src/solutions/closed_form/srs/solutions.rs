//! The circles of an S-R-S arm as [`Solutions`], and the arm as a [`ClosedForm`].

use std::any::Any;
use std::f64::consts::PI;

use super::arm::{SrsArm, Swivel};
use super::choice::Choice;
use super::circle::{Branch, SelfMotion};
use super::spherical::sphericals;
use crate::chain::Chain;
use crate::criterion::Criterion;
use crate::error::{Result, check_length};
use crate::joint_space::{TURN, turned};
use crate::pose::Pose;
use crate::solutions::closed_form::{ClosedForm, Defect, sign_label};
use crate::solutions::{Solution, Solutions, check_piece, room, search};
use crate::status::Status;

/// Swivels at which a configuration within the limits is looked for before the exact arcs are asked.
const SWIVELS: usize = 8;
/// Swivels at which a path may begin.
const START_SWIVELS: usize = 12;

/// Cosines and sines of the swivels of [`SWIVELS`], far from each other first.
const SWIVEL_DIRECTIONS: [[f64; 2]; SWIVELS] = {
    const H: f64 = std::f64::consts::FRAC_1_SQRT_2;
    [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [H, H], [-H, -H], [-H, H], [H, -H]]
};

impl SelfMotion {
    /// Whether status and branches say everything: the arm is exact, and no swivel brings shoulder or wrist into a gimbal,
    /// where the outer joints may share their sum in any way, beside the branches.
    pub fn proven(&self) -> bool {
        self.not_proven().is_none()
    }

    /// Why the verdict is not exact.
    pub(super) fn not_proven(&self) -> Option<String> {
        if !self.arm.exact() {
            let Defect { position, orientation } = self.arm.defect();
            return Some(format!(
                "the verdict is that of an ideal arm, from which this one deviates by {position:.1e} m and {orientation:.1e} rad"
            ));
        }
        if self.status() == Status::Unreachable {
            return None;
        }
        let geometry = &self.arm.inner.geometry;
        let elbows: &[f64] = if geometry.aligned { &[1.0] } else { &[1.0, -1.0] };
        let gimbal = |sign: &f64| {
            let joints = sphericals(geometry, &self.circle, *sign);
            joints.iter().position(|joint| joint.locked || joint.gimbals().next().is_some())
        };
        let first = elbows.iter().find_map(gimbal)?;
        let joints = self.arm.chain().joints();
        let name = |i: usize| &joints[4 * first + i].name;
        let [a, b, c] = [0, 1, 2].map(name);
        Some(format!(
            "joint '{b}' reaches its gimbal over this pose, where '{a}' and '{c}' may share their sum in any way: beside the \
             branches there are configurations that are not listed"
        ))
    }

    fn piece(&self, piece: usize) -> Result<Branch<'_>> {
        check_piece(piece, self.pieces())?;
        self.branch(self.branch_indices().nth(piece).unwrap_or(0))
    }

    fn solution(&self, choice: Choice) -> Solution {
        let Choice { q, swivel, branch, value, proven } = choice;
        // On the stretched arm both elbows are one piece.
        let piece = self.branch_indices().position(|index| index == branch).unwrap_or(0);
        Solution { q: q.to_vec(), piece, u: search::in_period(swivel), value, proven }
    }
}

impl Solutions for SelfMotion {
    fn chain(&self) -> &Chain {
        self.arm.chain()
    }

    fn dimension(&self) -> usize {
        1
    }

    fn status(&self) -> Status {
        SelfMotion::status(self)
    }

    fn reason(&self) -> String {
        SelfMotion::reason(self)
    }

    fn proven(&self) -> bool {
        SelfMotion::proven(self)
    }

    fn pieces(&self) -> usize {
        self.branch_indices().count()
    }

    fn label(&self, piece: usize) -> Result<String> {
        Ok(sign_label(self.piece(piece)?.signs()))
    }

    fn closed(&self, piece: usize) -> Result<bool> {
        check_piece(piece, self.pieces()).map(|()| true)
    }

    fn range(&self, piece: usize) -> Result<[f64; 2]> {
        check_piece(piece, self.pieces()).map(|()| [-PI, PI])
    }

    fn q(&self, piece: usize, u: f64, out: &mut [f64]) -> Result<()> {
        check_length("out", out, 7)?;
        out.copy_from_slice(&self.piece(piece)?.q(u)?);
        Ok(())
    }

    fn tangent(&self, piece: usize, u: f64, out: &mut [f64]) -> Result<()> {
        check_length("out", out, 7)?;
        out.copy_from_slice(&self.piece(piece)?.tangent(u)?);
        Ok(())
    }

    fn intervals(&self, piece: usize, margin: f64) -> Result<Vec<[f64; 2]>> {
        let mut arcs = self.piece(piece)?.intervals(margin)?;
        if let Some(last) = arcs.pop_if(|arc| arc[0] >= PI) {
            arcs.insert(0, last.map(|s| turned(s, -1.0)));
        }
        Ok(arcs)
    }

    fn parameter(&self, piece: usize, u: f64) -> Result<Option<f64>> {
        check_piece(piece, self.pieces())?;
        Swivel::Angle(u).direction()?;
        Ok(Some(search::in_period(u)))
    }

    fn nearest(&self, q: &[f64]) -> Result<Option<Solution>> {
        Ok(SelfMotion::nearest(self, q)?.map(|choice| self.solution(choice)))
    }

    fn best(&self, criterion: &dyn Criterion) -> Result<Option<Solution>> {
        Ok(SelfMotion::best(self, criterion)?.map(|choice| self.solution(choice)))
    }

    fn best_margin(&self) -> Result<Option<Solution>> {
        Ok(SelfMotion::best_margin(self).map(|choice| self.solution(choice)))
    }

    fn proves_margin(&self, margin: f64) -> bool {
        SelfMotion::proven(self) && self.has_no_margin_above(margin)
    }

    fn feasible_measure(&self) -> Result<f64> {
        Ok(self.feasible_swivel())
    }
}

impl ClosedForm for SrsArm {
    fn name(&self) -> &'static str {
        "srs"
    }

    fn chain(&self) -> &Chain {
        SrsArm::chain(self)
    }

    fn defect(&self) -> Defect {
        SrsArm::defect(self)
    }

    fn parameter(&self) -> Option<&'static str> {
        Some("swivel")
    }

    fn solutions(&self, pose: &Pose) -> Result<Box<dyn Solutions>> {
        Ok(Box::new(self.self_motion(pose)?))
    }

    fn in_reach(&self, pose: &Pose) -> bool {
        self.solve_into(pose, [1.0, 0.0], false, &mut [[0.0; 7]; 8]) != 0
    }

    fn starts(&self, pose: &Pose) -> Vec<Vec<f64>> {
        let swivels = (0..START_SWIVELS).map(|k| TURN * k as f64 / START_SWIVELS as f64);
        let rows = swivels.filter_map(|s| self.solve(pose, Swivel::Angle(s), false).ok());
        rows.flatten().map(|q| q.to_vec()).collect()
    }

    fn select(
        &self,
        pose: &Pose,
        q0: Option<&[f64]>,
        criterion: Option<&dyn Criterion>,
        q: &mut [f64],
    ) -> Status {
        if q0.is_none() && criterion.is_none() {
            // A branch within limits at one of a few swivels is found nine times out of ten at the first.
            let mut rows = [[0.0; 7]; 8];
            for direction in SWIVEL_DIRECTIONS {
                let mask = self.solve_into(pose, direction, true, &mut rows);
                let valid =
                    (0..8).filter(|b| mask & (1 << b) != 0).map(|b| (room(self.chain(), &rows[b]), b));
                if let Some((_, best)) = valid.max_by(|a, b| a.0.total_cmp(&b.0)) {
                    q.copy_from_slice(&rows[best]);
                    return Status::Converged;
                }
            }
        }
        let Ok(motion) = self.self_motion(pose) else { return Status::IterationLimit };
        let found = match (criterion, q0) {
            (Some(criterion), _) => motion.best(criterion).ok().flatten().map(|choice| choice.q),
            (None, Some(q0)) => motion.nearest(q0).ok().flatten().map(|choice| choice.q),
            (None, None) => middle_of_longest(&motion),
        };
        match found {
            Some(found) => {
                q.copy_from_slice(&found);
                Status::Converged
            }
            None => match motion.status() {
                Status::Converged => Status::IterationLimit,
                status => status,
            },
        }
    }

    fn as_any(&self) -> &dyn Any {
        self
    }
}

/// The middle of the longest feasible arc.
fn middle_of_longest(motion: &SelfMotion) -> Option<[f64; 7]> {
    let branches = motion.branches().into_iter();
    let arcs =
        branches.flat_map(|b| b.intervals(0.0).unwrap_or_default().into_iter().map(move |arc| (b, arc)));
    let (branch, [lo, hi]) = arcs.max_by(|(_, a), (_, b)| (a[1] - a[0]).total_cmp(&(b[1] - b[0])))?;
    branch.q(0.5 * (lo + hi)).ok()
}
