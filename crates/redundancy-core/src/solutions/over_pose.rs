//! The solutions of any arm over a pose.

use super::closed_form::closed_form;
use super::continuation::TraceSettings;
use super::curve::geometric;
use super::found::{FoundPoints, TracedCurves};
use super::solutions::Solutions;
use crate::chain::Chain;
use crate::error::{Error, Result};
use crate::kinematics::{Task, TaskKind};
use crate::pose::{Pose, checked_pose};

/// Settings of [`solutions`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolutionsSettings {
    /// Which coordinates of the pose count.
    pub task: Task,
    /// Whether the closed form of the arm is used where it has one.
    pub closed_form: bool,
    /// Seed of the random starts of arms without a closed form.
    pub seed: u64,
    /// Number of those.
    pub starts: usize,
    /// How curves are traced.
    pub trace: TraceSettings,
}

impl Default for SolutionsSettings {
    fn default() -> Self {
        Self { task: Task::POSE, closed_form: true, seed: 0, starts: 100, trace: TraceSettings::default() }
    }
}

/// Every configuration of `chain` over `pose`: from the closed form where the arm has one, otherwise what is found from
/// random starts (and then [`Solutions::proven`] is false).
///
/// ```
/// use redundancy_core::{Status, chain::catalog, solutions::{SolutionsSettings, solutions}};
/// for (name, dimension) in [("puma560", 0), ("iiwa14", 1)] {
///     let chain = catalog::load(name)?;
///     let q = vec![0.4; chain.dof()];
///     let all = solutions(&chain, &chain.forward(&q)?, &SolutionsSettings::default())?;
///     assert_eq!((all.dimension(), all.status(), all.proven()), (dimension, Status::Converged, true));
///     assert!(all.nearest(&q)?.is_some_and(|near| near.value < 1e-6));
/// }
/// # Ok::<(), redundancy_core::Error>(())
/// ```
///
/// # Errors
/// A pose that is not rigid or finite, invalid trace settings, no start; an arm with fewer joints than the task has
/// coordinates, or with two and more joints beyond them (a set of more than one dimension).
pub fn solutions(chain: &Chain, pose: &Pose, settings: &SolutionsSettings) -> Result<Box<dyn Solutions>> {
    let pose = &checked_pose("pose", pose)?;
    settings.trace.validate()?;
    let SolutionsSettings { seed, starts, .. } = *settings;
    if starts == 0 {
        return Err(Error::OutOfRange { what: "starts".into(), value: 0.0, bound: ">= 1".into() });
    }
    let task = geometric(settings.task);
    if task.kind() == TaskKind::Pose
        && settings.closed_form
        && let Some(form) = closed_form(chain)
    {
        return form.solutions(pose);
    }
    let (n, m) = (chain.dof(), task.dim());
    let name = chain.name();
    match n.checked_sub(m) {
        Some(0) => Ok(Box::new(FoundPoints::new(chain, task, pose, seed, starts)?)),
        Some(1) => Ok(Box::new(TracedCurves::new(chain, task, pose, &settings.trace, seed, starts)?)),
        Some(d) => Err(Error::Invalid(format!(
            "the solutions of '{name}' ({n} joints) under the task '{task}' ({m} coordinates) have {d} dimensions, at most \
             one is supported: fix {} of its joints",
            d - 1
        ))),
        None => Err(Error::Invalid(format!(
            "'{name}' has {n} joints, the task '{task}' has {m} coordinates: choose a task with fewer"
        ))),
    }
}
