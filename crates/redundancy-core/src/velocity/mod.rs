//! From task velocity to joint velocity, step by step, without allocation.
//!
//! | scheme | joint velocity | limits |
//! |---|---|---|
//! | [`ProjectedGradient`] | `J^+ v + (I - J^+ J) eta` [Bettini2000, eq. (2)] | none |
//! | [`ReducedGradient`] | dependent joints follow, the others take the reduced gradient [Bettini2000, eq. (4)] | none |
//! | [`ExtendedJacobian`] | stays on a stationary point of the criterion [Park1996, eq. (5)] | velocity, of the freedom's motion |
//! | [`SaturatedNullspace`] | the largest scale of v that the limits allow, then the nearest to eta [Flacco2015, section V] | position, velocity, acceleration |
//!
//! [`PrioritizedNullspace`] has several tasks, of any link, one above the other, within the same limits.
//!
//! `eta` is minus the gain times the gradient of a criterion to minimise, plus for one to maximise, or the joint velocity
//! that the caller wishes for ([`StepInput::wish`]). Near a singularity
//! small singular values are damped ([`Damping`]); the motion that uses the freedom is projected exactly all the same,
//! so that it never moves the tool (but for [`ReducedGradient::as_printed`]). Every step reports what it did: damping, change of basis, scale, active limits.

mod bounds;
mod box_projection;
mod contact;
mod damping;
mod exchange;
mod extended_jacobian;
mod hierarchy;
mod linear;
mod local;
mod metric;
mod priorities;
mod projected_gradient;
mod pseudo_inverse;
mod reduced_gradient;
mod saturation;
mod singular_values;
mod step_size;

pub use contact::{ContactSettings, LimitingPair};
pub use damping::Damping;
pub use extended_jacobian::ExtendedJacobian;
pub use metric::Metric;
pub use priorities::{PrioritizedNullspace, PriorityStep, PriorityTask};
pub use projected_gradient::ProjectedGradient;
pub use reduced_gradient::ReducedGradient;
pub use saturation::{SaturatedNullspace, WhenBlocked};
pub use step_size::Gain;

use crate::chain::Chain;
use crate::error::Result;
use crate::kinematics::Task;
use crate::scene::Surroundings;
use crate::status::Status;

/// What one step starts from.
#[derive(Debug, Clone, Copy)]
pub struct StepInput<'a> {
    /// Joint positions (n), rad or m.
    pub q: &'a [f64],
    /// Velocity of the task, see [`Task::velocity`].
    pub velocity: &'a [f64],
    /// Length of the step, s; needed for limits and for the optimal gain.
    pub dt: Option<f64>,
    /// Joint velocity before the step (n); without it acceleration is not limited.
    pub qd: Option<&'a [f64]>,
    /// Joint velocity (n) that the freedom is used for in place of the criterion's gradient, rad/s or m/s; with it neither
    /// criterion nor gain counts.
    pub wish: Option<&'a [f64]>,
}

/// What one step at acceleration level starts from.
#[derive(Debug, Clone, Copy)]
pub struct AccelerationInput<'a> {
    /// Joint positions (n), rad or m.
    pub q: &'a [f64],
    /// Joint velocity (n).
    pub qd: &'a [f64],
    /// Acceleration of the task, as many numbers as its velocity has.
    pub acceleration: &'a [f64],
    /// Length of the step, s; only a schedule of bases needs it.
    pub dt: Option<f64>,
    /// Joint velocity (n) that the freedom approaches in place of the one along the criterion's gradient.
    pub wish: Option<&'a [f64]>,
}

/// What one step did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// `converged`; `singular` where damping or a lost rank kept the task from being met; `limits` where limits did.
    pub status: Status,
    /// Share of the task velocity that is realised, 1 or less.
    pub scale: f64,
    /// The largest damping factor lambda that acted, 0 for none.
    pub damping: f64,
    /// True where a change of basis began.
    pub basis_changed: bool,
    /// True where the scheme's own condition, not the Jacobian, lost rank.
    pub algorithmic: bool,
    /// `|J qd - scale v|`: 0 up to rounding unless the status says otherwise; task units per s. Where no scale is possible, or
    /// the task is blocked and approached, `|J qd - v|`.
    pub residual: f64,
}

/// Which limit of a joint holds it back.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum LimitKind {
    /// Its position, with the distance that braking takes.
    Position,
    /// Its speed.
    Velocity,
    /// Its acceleration.
    Acceleration,
}

impl LimitKind {
    /// The kind as a word.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::Velocity => "velocity",
            Self::Acceleration => "acceleration",
        }
    }
}

/// A limit that acts on a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ActiveLimit {
    /// Index of the joint, from 0.
    pub joint: usize,
    /// Which limit.
    pub kind: LimitKind,
    /// True for the upper, false for the lower one.
    pub upper: bool,
}

/// What kept the motion of the freedom slow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpeedBound {
    /// The joint at its bound, from 0.
    pub joint: usize,
    /// The bound, rad/s or m/s.
    pub speed: f64,
    /// Share of the freedom's velocity that is left, in [0, 1).
    pub scale: f64,
}

/// A scheme that turns a task velocity into a joint velocity.
pub trait Resolver: Send + Sync + std::fmt::Debug {
    /// The scheme as a word.
    fn name(&self) -> &'static str;

    /// The arm.
    fn chain(&self) -> &Chain;

    /// Which coordinates count.
    fn task(&self) -> &Task;

    /// The link in whose frame its coordinates are written, see [`MiddleFrame`](crate::kinematics::MiddleFrame).
    fn frame(&self) -> Option<usize> {
        None
    }

    /// One step: writes the joint velocity (n).
    ///
    /// # Errors
    /// Wrong lengths, numbers that are not finite, a step that is not positive or is missing where it is needed.
    fn step(&mut self, input: &StepInput<'_>, qd: &mut [f64]) -> Result<Step>;

    /// One step at acceleration level: writes the joint acceleration (n). `residual` is `|J qdd + Jdot qd - a|`.
    ///
    /// # Errors
    /// A scheme that was not made for it; wrong lengths, numbers that are not finite.
    fn step_acceleration(&mut self, input: &AccelerationInput<'_>, qdd: &mut [f64]) -> Result<Step> {
        let _ = (input, qdd);
        Err(crate::Error::Invalid(format!("{} has no acceleration level", self.name())))
    }

    /// Rate, 1/s, at which the acceleration level approaches the joint velocity of the velocity level; `None` at velocity level.
    fn velocity_gain(&self) -> Option<f64> {
        None
    }

    /// The limits that acted on the last step.
    fn active_limits(&self) -> &[ActiveLimit] {
        &[]
    }

    /// The pairs that held the last step back, where the scheme keeps distances.
    fn limiting_pairs(&self) -> &[LimitingPair] {
        &[]
    }

    /// What the scheme keeps a distance from.
    fn surroundings(&self) -> Option<&Surroundings> {
        None
    }

    /// The time of the next step, s, for obstacles that move.
    fn set_time(&mut self, t: f64) {
        let _ = t;
    }

    /// What bounded the motion of the freedom in the last step; `None` where nothing did.
    fn speed_bound(&self) -> Option<SpeedBound> {
        None
    }

    /// The dependent joints of the last step, ascending; empty for schemes that have none.
    fn basis(&self) -> &[usize] {
        &[]
    }

    /// A copy with its state, so that a run does not disturb another.
    fn boxed(&self) -> Box<dyn Resolver>;
}

/// Least singular value of the task Jacobian at `q`, exact.
///
/// # Errors
/// Wrong length of `q`, or an entry that is not finite.
///
/// ```
/// use redundancy_core::{chain::catalog, kinematics::Task, velocity::sigma_min};
/// let arm = catalog::load("planar3r")?;
/// assert!(sigma_min(&arm, &Task::PLANAR, &[0.0; 3])? < 1e-15); // stretched
/// # Ok::<(), redundancy_core::Error>(())
/// ```
pub fn sigma_min(chain: &Chain, task: &Task, q: &[f64]) -> Result<f64> {
    let mut scratch = crate::kinematics::Scratch::new(chain);
    let kinematics = chain.kinematics(q, &mut scratch)?;
    let mut jacobian = vec![0.0; task.dim() * chain.dof()];
    task.write_jacobian(&kinematics, &mut jacobian);
    let mut svd = singular_values::Svd::new(task.dim(), chain.dof());
    svd.decompose(&jacobian, task.dim());
    // More coordinates than joints: the task cannot be met in every direction.
    Ok(if task.dim() > chain.dof() { 0.0 } else { svd.smallest() })
}
