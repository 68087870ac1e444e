//! What every closed form can do.

use std::any::Any;
use std::fmt::Debug;

use crate::chain::Chain;
use crate::criterion::Criterion;
use crate::error::Result;
use crate::pose::Pose;
use crate::solutions::search;
use crate::solutions::solutions::Solutions;
use crate::status::Status;
use crate::tolerance::CLOSED_FORM_EXACT;

/// How far an arm is from the ideal one that stands in for it. What the closed form returns meets the pose within
/// twice these numbers (and rounding).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Defect {
    /// Metres at the tool.
    pub position: f64,
    /// Radians at the tool.
    pub orientation: f64,
}

impl Defect {
    /// The larger of both numbers.
    pub fn largest(&self) -> f64 {
        self.position.max(self.orientation)
    }
}

/// An arm whose configurations over a pose are known in closed form.
///
/// Poses are checked by the caller, except in [`ClosedForm::solutions`].
pub trait ClosedForm: Debug + Send + Sync {
    /// The form in lower snake case: `srs`, `spherical_wrist`, ...
    fn name(&self) -> &'static str;

    /// The arm.
    fn chain(&self) -> &Chain;

    /// How far the arm is from the ideal one.
    fn defect(&self) -> Defect;

    /// Name of the parameter that the spare freedom is described by (`swivel`, `q7`); `None` for isolated configurations.
    fn parameter(&self) -> Option<&'static str>;

    /// Every configuration over `pose`.
    ///
    /// # Errors
    /// A pose that is not rigid or finite.
    fn solutions(&self, pose: &Pose) -> Result<Box<dyn Solutions>>;

    /// Whether there is a configuration over `pose`, joint limits aside.
    fn in_reach(&self, pose: &Pose) -> bool {
        self.solutions(pose).is_ok_and(|solutions| solutions.pieces() > 0)
    }

    /// Configurations over `pose` to begin a path at, joint limits aside and joints modulo turns: all that are isolated, a
    /// few of every curve.
    fn starts(&self, pose: &Pose) -> Vec<Vec<f64>> {
        self.solutions(pose).map_or_else(|_| Vec::new(), |solutions| search::starts(&*solutions))
    }

    /// Number of rows of [`ClosedForm::branches_into`]: 0 for arms with spare freedom, at most 32.
    fn branches(&self) -> usize {
        0
    }

    /// Writes the isolated configurations over `pose`, joint limits aside, row by row in branch order; bit `b` of the
    /// result says that row `b` is one. A branch is continuous in the pose. Allocates nothing.
    fn branches_into(&self, pose: &Pose, out: &mut [f64]) -> u32 {
        let _ = (pose, out);
        0
    }

    /// Writes one configuration over `pose` within the joint limits to `q`: the best by `criterion`, the nearest to `q0`,
    /// or without both one that keeps away from the limits. Isolated configurations are chosen by `q0` first, curves by
    /// `criterion` first. Returns `Converged`, why there is none (`Limits` or
    /// `Unreachable`), or `IterationLimit` where there may be one but none was found; `q` is then as it was.
    ///
    /// Arguments have the right lengths. For the inverse kinematics, which then polishes `q` if need be.
    fn select(
        &self,
        pose: &Pose,
        q0: Option<&[f64]>,
        criterion: Option<&dyn Criterion>,
        q: &mut [f64],
    ) -> Status {
        match self.solutions(pose) {
            Ok(solutions) => search::select(&*solutions, q0, criterion, q),
            Err(_) => Status::IterationLimit,
        }
    }

    /// Whether what the form says about reach and limits is exact: its defect is below [`CLOSED_FORM_EXACT`].
    fn exact(&self) -> bool {
        self.defect().largest() <= CLOSED_FORM_EXACT
    }

    /// Whether it is exact that there is no configuration over `pose`, or none within the limits. Asked only where that is so.
    fn proves(&self, pose: &Pose) -> bool {
        let _ = pose;
        self.exact()
    }

    /// The arm as its own type.
    fn as_any(&self) -> &dyn Any;
}

/// Signs of a branch as a label, such as `+-+`.
pub(crate) fn sign_label(signs: [i8; 3]) -> String {
    signs.map(|sign| if sign < 0 { '-' } else { '+' }).iter().collect()
}
