//! The curves of an arm of the Panda class as [`Solutions`], and the arm as a [`ClosedForm`].

use std::any::Any;
use std::f64::consts::PI;

use super::arcs::{Limits, visit};
use super::arm::PandaClassArm;
use super::motion::PandaMotion;
use super::ring::Ring;
use super::target::Target;
use super::walk::Walk;
use crate::chain::Chain;
use crate::criterion::{Criterion, Sense, check_dof};
use crate::error::{Result, check_length};
use crate::joint_space::{within, wrap_sum};
use crate::pose::Pose;
use crate::solutions::closed_form::{ClosedForm, Defect};
use crate::solutions::{Solution, Solutions, check_piece, room, search};
use crate::status::Status;

/// Values of joint 7 at which a configuration within the limits is looked for before the arcs are asked, as shares of its
/// range, far from each other first.
const SHARES: [f64; 8] = [0.5, 0.75, 0.25, 0.9, 0.1, 0.62, 0.38, 0.98];

impl Solutions for PandaMotion {
    fn chain(&self) -> &Chain {
        self.arm.chain()
    }

    fn dimension(&self) -> usize {
        1
    }

    fn status(&self) -> Status {
        PandaMotion::status(self)
    }

    fn reason(&self) -> String {
        let reason = PandaMotion::reason(self);
        match self.not_proven() {
            None => reason,
            Some(why) if reason.is_empty() => why.into(),
            Some(why) => format!("{reason}; {why}"),
        }
    }

    fn proven(&self) -> bool {
        PandaMotion::proven(self)
    }

    fn pieces(&self) -> usize {
        PandaMotion::pieces(self)
    }

    fn label(&self, piece: usize) -> Result<String> {
        check_piece(piece, self.pieces())?;
        Ok(format!("{}{}", if piece.is_multiple_of(2) { '+' } else { '-' }, piece / 2 + 1))
    }

    fn closed(&self, piece: usize) -> Result<bool> {
        check_piece(piece, self.pieces()).map(|()| true)
    }

    fn range(&self, piece: usize) -> Result<[f64; 2]> {
        check_piece(piece, self.pieces()).map(|()| [-PI, PI])
    }

    fn q(&self, piece: usize, u: f64, out: &mut [f64]) -> Result<()> {
        check_length("out", out, 7)?;
        out.copy_from_slice(&self.q_at(piece, u)?);
        Ok(())
    }

    fn tangent(&self, piece: usize, u: f64, out: &mut [f64]) -> Result<()> {
        check_length("out", out, 7)?;
        out.copy_from_slice(&self.tangent_at(piece, u)?);
        Ok(())
    }

    fn intervals(&self, piece: usize, margin: f64) -> Result<Vec<[f64; 2]>> {
        PandaMotion::intervals(self, piece, margin)
    }

    fn parameter(&self, piece: usize, u: f64) -> Result<Option<f64>> {
        Ok(Some(self.q_at(piece, u)?[6]))
    }

    fn nearest(&self, q: &[f64]) -> Result<Option<Solution>> {
        self.arm.chain().check_q(q)?;
        Ok(self.nearest_choice(q))
    }

    fn best(&self, criterion: &dyn Criterion) -> Result<Option<Solution>> {
        check_dof(criterion, 7)?;
        let springs = criterion.springs().filter(|springs| {
            criterion.sense() == Sense::Minimize
                && springs.iter().all(|s| s.weight >= 0.0 && s.weight.is_finite())
        });
        let Some(springs) = springs else { return search::best(self, criterion) };
        let found = self.softest(std::array::from_fn(|i| springs[i]));
        Ok(found.map(|found| Solution { value: criterion.value(&found.q), ..found }))
    }

    fn best_margin(&self) -> Result<Option<Solution>> {
        Ok(self.widest())
    }

    fn proves_margin(&self, margin: f64) -> bool {
        self.arm.exact() && self.has_no_margin_above(margin)
    }

    fn feasible_measure(&self) -> Result<f64> {
        Ok(self.feasible_q7())
    }
}

impl PandaClassArm {
    /// The middle of a feasible part of some curve that keeps farthest away from the limits; allocates nothing.
    #[cold]
    fn roomiest(&self, target: &Target, q: &mut [f64]) -> Status {
        let inner = &self.inner;
        let limits = Limits::new(&inner.lower, &inner.upper, 0.0);
        let walk = Walk { geometry: &inner.geometry, target };
        let Ok(rings) = Ring::all(target) else { return Status::Unreachable };
        let (mut status, mut most) = (Status::Unreachable, f64::NEG_INFINITY);
        for sheet in rings.iter().flat_map(|ring| ring.sheets(&inner.geometry, target).0) {
            if status == Status::Unreachable {
                status = Status::Limits;
            }
            visit(&walk, &sheet, &limits, &mut |shoulder, part| {
                let node = walk.node(&sheet, 0.5 * (part.a.u + part.b.u));
                let principal = node.q[shoulder].map(wrap_sum);
                let held = self.hold_limits(&principal, node.gimbal).unwrap_or_else(|| {
                    // A single point, where a limit is met up to rounding.
                    let wound = self.wind(&principal);
                    std::array::from_fn(|i| wound[i].clamp(inner.lower[i], inner.upper[i]))
                });
                let value = room(self.chain(), &held);
                if value > most {
                    most = value;
                    q.copy_from_slice(&held);
                }
            });
        }
        if most > f64::NEG_INFINITY { Status::Converged } else { status }
    }
}

impl ClosedForm for PandaClassArm {
    fn name(&self) -> &'static str {
        "panda_class"
    }

    fn chain(&self) -> &Chain {
        PandaClassArm::chain(self)
    }

    fn defect(&self) -> Defect {
        PandaClassArm::defect(self)
    }

    fn parameter(&self) -> Option<&'static str> {
        Some("q7")
    }

    fn solutions(&self, pose: &Pose) -> Result<Box<dyn Solutions>> {
        Ok(Box::new(self.self_motion(pose)?))
    }

    fn in_reach(&self, pose: &Pose) -> bool {
        let g = &self.inner.geometry;
        let target = Target::new(g, pose);
        Ring::all(&target).is_ok_and(|rings| rings.iter().any(|ring| !ring.sheets(g, &target).0.is_empty()))
    }

    fn starts(&self, pose: &Pose) -> Vec<Vec<f64>> {
        self.self_motion(pose).map_or_else(|_| Vec::new(), |motion| search::starts(&motion))
    }

    fn select(
        &self,
        pose: &Pose,
        q0: Option<&[f64]>,
        criterion: Option<&dyn Criterion>,
        q: &mut [f64],
    ) -> Status {
        if q0.is_none() && criterion.is_none() {
            let target = Target::new(&self.inner.geometry, pose);
            let [lower, upper] = [self.inner.lower[6].max(-PI), self.inner.upper[6].min(PI)];
            let mut rows = [[0.0; 7]; 8];
            for share in SHARES {
                let Some(q7) = within(lower + share * (upper - lower), lower, upper) else { continue };
                let mask = self.solve_target(&target, q7, true, &mut rows);
                let valid =
                    (0..8).filter(|b| mask & (1 << b) != 0).map(|b| (room(self.chain(), &rows[b]), b));
                if let Some((_, best)) = valid.max_by(|a, b| a.0.total_cmp(&b.0)) {
                    q.copy_from_slice(&rows[best]);
                    return Status::Converged;
                }
            }
            return self.roomiest(&target, q);
        }
        let Ok(motion) = self.self_motion(pose) else { return Status::IterationLimit };
        search::select(&motion, q0, criterion, q)
    }

    fn proves(&self, pose: &Pose) -> bool {
        self.self_motion(pose).is_ok_and(|motion| motion.proven())
    }

    fn as_any(&self) -> &dyn Any {
        self
    }
}
