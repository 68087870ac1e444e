//! The one result of a motion along a path.
//!
//! Every planner and every step-by-step scheme returns a [`Plan`] or converts to one: a [`Trajectory`] with the
//! verdict (status, reason, whether it is legal and proven), with what happened to the freedom in each row, and with
//! the points where the arm must change its configuration or has none. A column that a scheme does not know is `None`.
//!
//! A [`PlanBuilder`] checks what the columns promise: one entry per row, no NaN, and no `Converged` beside a limit that
//! is broken, a reconfiguration or a blocked point.

use super::path::Path;
use super::trajectory::Trajectory;
use crate::chain::{Chain, Limits};
use crate::error::{Error, Result, check_finite, check_length};
use crate::kinematics::Scratch;
use crate::pose::Pose;
use crate::status::Status;
use crate::tolerance::{LIMIT_SLACK, SPEED_ROUNDING};

/// A place where the arm must change its configuration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reconfiguration {
    /// The first row in the new configuration.
    pub row: usize,
    /// Why it takes one.
    pub reason: String,
}

/// A point of the path without a configuration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BlockedPoint {
    /// The point of the path, from 0; it is the row where the plan has one row per point.
    pub row: usize,
    /// `Unreachable`, `Limits` or `Collision`.
    pub status: Status,
    /// What is in the way.
    pub reason: String,
}

/// Values of a named spare coordinate: `swivel`, `q7`, a rail.
#[derive(Debug, Clone, PartialEq)]
pub struct SpareCoordinate {
    /// Its name.
    pub name: String,
    /// Its value in each row, continuous, rad or m.
    pub values: Vec<f64>,
}

/// On which piece of the solutions over its pose each row is: a branch of a closed form, a curve that was traced.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Pieces {
    /// The piece of each row, an index of `labels`.
    pub index: Vec<usize>,
    /// The names of the pieces.
    pub labels: Vec<String>,
}

/// Optional values per row.
#[derive(Debug, Clone, PartialEq, Default)]
struct Columns {
    s: Option<Vec<f64>>,
    poses: Option<Vec<Pose>>,
    tilt: Option<Vec<[f64; 2]>>,
    spin: Option<Vec<f64>>,
    spare: Vec<SpareCoordinate>,
    pieces: Option<Pieces>,
    margin: Option<Vec<f64>>,
    clearance: Option<Vec<f64>>,
    self_clearance: Option<Vec<f64>>,
    cost: Option<Vec<f64>>,
}

/// A motion along a path, with its verdict.
///
/// ```
/// use redundancy_core::{Status, chain::catalog, path::{PlanBuilder, Trajectory}};
/// let arm = catalog::load("planar3r")?;
/// let names = arm.joints().iter().map(|j| j.name.clone()).collect();
/// let trajectory = Trajectory::new(names, vec![0.0, 1.0], vec![0.0, 0.5, 0.5, 0.1, 0.5, 0.5], None, Vec::new())?;
/// let plan = PlanBuilder::new(trajectory, Status::Converged).legal(true).poses_of(&arm)?.margin_of(&arm)?.build()?;
/// assert_eq!(plan.poses().map(<[_]>::len), Some(2));
/// assert!(plan.spin().is_none());
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    trajectory: Trajectory,
    status: Status,
    reason: String,
    legal: Option<bool>,
    proven: bool,
    cost: Option<f64>,
    reconfigurations: Vec<Reconfiguration>,
    blocked: Vec<BlockedPoint>,
    columns: Columns,
}

impl Plan {
    /// The motion: times, joint positions and velocities, events.
    pub fn trajectory(&self) -> &Trajectory {
        &self.trajectory
    }

    /// The motion without the verdict.
    pub fn into_trajectory(self) -> Trajectory {
        self.trajectory
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.trajectory.rows()
    }

    /// Joint positions row by row, rad or m.
    pub fn q(&self) -> &[f64] {
        self.trajectory.q()
    }

    /// Joint positions by row for an arm of `N` joints; empty for another number.
    pub fn q_rows<const N: usize>(&self) -> &[[f64; N]] {
        if self.trajectory.dof() == N { self.q().as_chunks().0 } else { &[] }
    }

    /// What the planner did.
    pub fn status(&self) -> Status {
        self.status
    }

    /// Why it is not `Converged`: the first point, the joint or link, the value and the bound. Where the verdict is
    /// not proven it says of how many starts it is the best.
    pub fn reason(&self) -> &str {
        &self.reason
    }

    /// Whether limits, task, contact and continuity hold on the grid of the verification (the rows, for schemes that go
    /// step by step), whatever the status; `None` where that was not checked.
    pub fn legal(&self) -> Option<bool> {
        self.legal
    }

    /// Whether the status is exact; else it is that of the best of a finite search. `Converged` says that the motion was
    /// verified, not that there is no cheaper one.
    pub fn proven(&self) -> bool {
        self.proven
    }

    /// What was minimised, summed over the path; `None` for schemes without a cost.
    pub fn cost(&self) -> Option<f64> {
        self.cost
    }

    /// Where the arm must change its configuration, ascending.
    pub fn reconfigurations(&self) -> &[Reconfiguration] {
        &self.reconfigurations
    }

    /// Points without a configuration, ascending.
    pub fn blocked(&self) -> &[BlockedPoint] {
        &self.blocked
    }

    /// Arc length on the path of each row, m.
    pub fn s(&self) -> Option<&[f64]> {
        self.columns.s.as_deref()
    }

    /// Tool pose of each row.
    pub fn poses(&self) -> Option<&[Pose]> {
        self.columns.poses.as_deref()
    }

    /// Rotation vector of the swing across the path's tool axis of each row, rad.
    pub fn tilt(&self) -> Option<&[[f64; 2]]> {
        self.columns.tilt.as_deref()
    }

    /// Twist about the tool axis against the path's orientation of each row, rad, continuous.
    pub fn spin(&self) -> Option<&[f64]> {
        self.columns.spin.as_deref()
    }

    /// The spare coordinates that have names.
    pub fn spare(&self) -> &[SpareCoordinate] {
        &self.columns.spare
    }

    /// Values of the spare coordinate of this name.
    pub fn spare_named(&self, name: &str) -> Option<&[f64]> {
        self.columns.spare.iter().find(|spare| spare.name == name).map(|spare| spare.values.as_slice())
    }

    /// On which piece of the solutions each row is.
    pub fn pieces(&self) -> Option<&Pieces> {
        self.columns.pieces.as_ref()
    }

    /// Smallest distance to a joint position limit of each row, rad or m: negative outside, infinite where no joint
    /// has one.
    pub fn margin(&self) -> Option<&[f64]> {
        self.columns.margin.as_deref()
    }

    /// Distance from the obstacles of each row, m, infinite beyond what was looked at.
    pub fn clearance(&self) -> Option<&[f64]> {
        self.columns.clearance.as_deref()
    }

    /// Distance between links of the arm of each row, m, infinite beyond what was looked at.
    pub fn self_clearance(&self) -> Option<&[f64]> {
        self.columns.self_clearance.as_deref()
    }

    /// Part of the cost of each row.
    pub fn row_cost(&self) -> Option<&[f64]> {
        self.columns.cost.as_deref()
    }
}

impl AsRef<Trajectory> for Plan {
    fn as_ref(&self) -> &Trajectory {
        &self.trajectory
    }
}

impl From<Plan> for Trajectory {
    fn from(plan: Plan) -> Self {
        plan.trajectory
    }
}

/// Which position limit of `chain` a motion breaks first, and which speed limit it exceeds most: the joint, the row, the
/// value and the bound. `None` when it keeps them all.
pub(crate) fn broken_limits(chain: &Chain, trajectory: &Trajectory) -> Option<String> {
    let n = chain.dof().max(1);
    let rows = || trajectory.q().chunks_exact(n).enumerate();
    let outside = |q: f64, limits: &Limits| q < limits.lower - LIMIT_SLACK || q > limits.upper + LIMIT_SLACK;
    let position = rows().find_map(|(row, q)| {
        let (joint, q) = chain.joints().iter().zip(q).find(|(joint, q)| outside(**q, &joint.limits))?;
        let (name, Limits { lower, upper, .. }) = (&joint.name, &joint.limits);
        Some(format!("row {row}: joint '{name}' is at {q}, outside its limits [{lower}, {upper}]"))
    });
    let mut fastest: Option<(f64, usize, usize)> = None;
    for (row, qd) in trajectory.qd().chunks_exact(n).enumerate() {
        for (i, (joint, qd)) in chain.joints().iter().zip(qd).enumerate() {
            let used = qd.abs() / joint.limits.velocity;
            if used > fastest.map_or(1.0 + SPEED_ROUNDING, |fastest| fastest.0) {
                fastest = Some((used, row, i));
            }
        }
    }
    let speed = fastest.map(|(used, row, i)| {
        let (name, limit) = (&chain.joints()[i].name, chain.joints()[i].limits.velocity);
        let speed = used * limit;
        format!("row {row}: joint '{name}' has the speed {speed}, {used:.3} times its limit of {limit}")
    });
    let both: Vec<String> = position.into_iter().chain(speed).collect();
    (!both.is_empty()).then(|| both.join("; "))
}

/// A [`Plan`] in the making. What is not given is unknown.
#[derive(Debug, Clone)]
pub struct PlanBuilder {
    plan: Plan,
}

impl PlanBuilder {
    /// A plan of this motion with this status.
    pub fn new(trajectory: Trajectory, status: Status) -> Self {
        Self {
            plan: Plan {
                trajectory,
                status,
                reason: String::new(),
                legal: None,
                proven: false,
                cost: None,
                reconfigurations: Vec::new(),
                blocked: Vec::new(),
                columns: Columns::default(),
            },
        }
    }

    /// A plan without rows.
    ///
    /// # Errors
    /// No joint, names that are empty or used twice.
    pub fn without_rows(joint_names: Vec<String>, status: Status) -> Result<Self> {
        Ok(Self::new(Trajectory::new(joint_names, Vec::new(), Vec::new(), None, Vec::new())?, status))
    }

    /// Why it is not `Converged`, or of how many starts it is the best.
    #[must_use]
    pub fn reason(mut self, reason: impl Into<String>) -> Self {
        self.plan.reason = reason.into();
        self
    }

    /// Adds to the reason, where there is one, the question about units that the path or the rows raise: millimetres where
    /// every point is far beyond the reach of the arm, degrees where a joint is beyond twenty turns.
    #[must_use]
    pub fn asking_about_units(mut self, chain: &Chain, path: &Path) -> Self {
        let positions = path.poses().iter().map(|pose| pose.translation.vector);
        let questions =
            [chain.ask_about_millimetres(positions), chain.ask_about_degrees(self.plan.trajectory.q())];
        for question in questions.into_iter().flatten() {
            if !self.plan.reason.is_empty() {
                self.plan.reason += "; ";
                self.plan.reason += &question;
            }
        }
        self
    }

    /// Whether limits, task, contact and continuity hold on the grid of the verification.
    #[must_use]
    pub fn legal(mut self, legal: bool) -> Self {
        self.plan.legal = Some(legal);
        self
    }

    /// Whether the verdict is exact.
    #[must_use]
    pub fn proven(mut self, proven: bool) -> Self {
        self.plan.proven = proven;
        self
    }

    /// The whole cost.
    #[must_use]
    pub fn cost(mut self, cost: f64) -> Self {
        self.plan.cost = Some(cost);
        self
    }

    /// Where the arm must change its configuration, ascending.
    #[must_use]
    pub fn reconfigurations(mut self, reconfigurations: Vec<Reconfiguration>) -> Self {
        self.plan.reconfigurations = reconfigurations;
        self
    }

    /// Points without a configuration, ascending.
    #[must_use]
    pub fn blocked(mut self, blocked: Vec<BlockedPoint>) -> Self {
        self.plan.blocked = blocked;
        self
    }

    /// Arc lengths, m.
    #[must_use]
    pub fn s(mut self, s: Vec<f64>) -> Self {
        self.plan.columns.s = Some(s);
        self
    }

    /// Tool poses.
    #[must_use]
    pub fn poses(mut self, poses: Vec<Pose>) -> Self {
        self.plan.columns.poses = Some(poses);
        self
    }

    /// Tool poses by forward kinematics.
    ///
    /// # Errors
    /// A chain of another number of joints.
    pub fn poses_of(self, chain: &Chain) -> Result<Self> {
        self.check_chain(chain)?;
        let mut scratch = Scratch::new(chain);
        let rows = self.plan.trajectory.q().chunks_exact(chain.dof());
        let poses = rows.map(|q| *chain.kinematics_unchecked(q, &mut scratch).pose()).collect();
        Ok(self.poses(poses))
    }

    /// Tilts, rad.
    #[must_use]
    pub fn tilt(mut self, tilt: Vec<[f64; 2]>) -> Self {
        self.plan.columns.tilt = Some(tilt);
        self
    }

    /// Spins, rad.
    #[must_use]
    pub fn spin(mut self, spin: Vec<f64>) -> Self {
        self.plan.columns.spin = Some(spin);
        self
    }

    /// One more spare coordinate.
    #[must_use]
    pub fn spare(mut self, name: impl Into<String>, values: Vec<f64>) -> Self {
        self.plan.columns.spare.push(SpareCoordinate { name: name.into(), values });
        self
    }

    /// The piece of each row, an index of `labels`.
    #[must_use]
    pub fn pieces(mut self, index: Vec<usize>, labels: Vec<String>) -> Self {
        self.plan.columns.pieces = Some(Pieces { index, labels });
        self
    }

    /// Distances to the joint position limits, rad or m.
    #[must_use]
    pub fn margin(mut self, margin: Vec<f64>) -> Self {
        self.plan.columns.margin = Some(margin);
        self
    }

    /// Distances to the position limits of `chain`.
    ///
    /// # Errors
    /// A chain of another number of joints.
    pub fn margin_of(self, chain: &Chain) -> Result<Self> {
        self.check_chain(chain)?;
        let distance = |q: &[f64]| {
            let limits = chain.lower().iter().zip(chain.upper());
            q.iter().zip(limits).map(|(q, (l, u))| (q - l).min(u - q)).fold(f64::INFINITY, f64::min)
        };
        let margin = self.plan.trajectory.q().chunks_exact(chain.dof()).map(distance).collect();
        Ok(self.margin(margin))
    }

    /// Distances from the obstacles, m.
    #[must_use]
    pub fn clearance(mut self, clearance: Vec<f64>) -> Self {
        self.plan.columns.clearance = Some(clearance);
        self
    }

    /// Distances between links of the arm, m.
    #[must_use]
    pub fn self_clearance(mut self, clearance: Vec<f64>) -> Self {
        self.plan.columns.self_clearance = Some(clearance);
        self
    }

    /// Parts of the cost.
    #[must_use]
    pub fn row_cost(mut self, cost: Vec<f64>) -> Self {
        self.plan.columns.cost = Some(cost);
        self
    }

    /// The plan.
    ///
    /// # Errors
    /// A column without exactly one entry per row, NaN, rows or pieces that do not exist, a name of a spare coordinate
    /// that is used twice; a status other than `Converged` without a reason; `Converged` where it is not legal, takes
    /// reconfigurations or has blocked points.
    pub fn build(self) -> Result<Plan> {
        self.check_columns()?;
        self.check_verdict()?;
        Ok(self.plan)
    }

    fn check_chain(&self, chain: &Chain) -> Result<()> {
        let (expected, actual) = (chain.dof(), self.plan.trajectory.dof());
        if expected == actual {
            return Ok(());
        }
        Err(Error::Length { what: "joints of the plan".into(), expected, actual })
    }

    fn check_columns(&self) -> Result<()> {
        let (rows, columns) = (self.plan.rows(), &self.plan.columns);
        let per_row = |what: &str, count: usize| match count == rows {
            true => Ok(()),
            false => Err(Error::Length { what: what.into(), expected: rows, actual: count }),
        };
        let per_row_finite = |what: &str, values: &[f64]| {
            check_length(what, values, rows)?;
            check_finite(what, values)
        };
        for (what, values) in [("s", &columns.s), ("spin", &columns.spin), ("row cost", &columns.cost)] {
            values.iter().try_for_each(|values| per_row_finite(what, values))?;
        }
        for (what, values) in [
            ("margin", &columns.margin),
            ("clearance", &columns.clearance),
            ("self clearance", &columns.self_clearance),
        ] {
            let Some(values) = values else { continue };
            check_length(what, values, rows)?;
            // Infinite is a distance to what does not exist or is far away.
            if let Some(index) = values.iter().position(|d| d.is_nan()) {
                return Err(Error::NotFinite { what: what.into(), index, value: values[index] });
            }
        }
        if let Some(tilt) = &columns.tilt {
            per_row("tilt", tilt.len())?;
            check_finite("tilt", tilt.as_flattened())?;
        }
        if let Some(poses) = &columns.poses {
            per_row("poses", poses.len())?;
        }
        for (k, spare) in columns.spare.iter().enumerate() {
            per_row_finite(&spare.name, &spare.values)?;
            if columns.spare[..k].iter().any(|before| before.name == spare.name) {
                return Err(Error::Invalid(format!("spare coordinate '{}' is given twice", spare.name)));
            }
        }
        if let Some(Pieces { index, labels }) = &columns.pieces {
            per_row("pieces", index.len())?;
            if let Some(piece) = index.iter().find(|piece| **piece >= labels.len()) {
                return Err(Error::OutOfRange {
                    what: "piece".into(),
                    value: *piece as f64,
                    bound: format!("< {}, the number of labels", labels.len()),
                });
            }
        }
        Ok(())
    }

    fn check_verdict(&self) -> Result<()> {
        let plan = &self.plan;
        let converged = plan.status == Status::Converged;
        if let Some(change) = plan.reconfigurations.iter().find(|change| change.row >= plan.rows()) {
            return Err(Error::OutOfRange {
                what: "row of a reconfiguration".into(),
                value: change.row as f64,
                bound: format!("< {}, the number of rows", plan.rows()),
            });
        }
        if let Some(cost) = plan.cost {
            check_finite("cost", &[cost])?;
        }
        if !converged && plan.reason.is_empty() {
            return Err(Error::Invalid(format!("a plan with status {} needs a reason", plan.status)));
        }
        let broken = if plan.legal == Some(false) {
            "is not legal"
        } else if !plan.reconfigurations.is_empty() {
            "takes reconfigurations"
        } else if !plan.blocked.is_empty() {
            "has blocked points"
        } else {
            return Ok(());
        };
        match converged {
            true => Err(Error::Invalid(format!("a plan that {broken} is not converged"))),
            false => Ok(()),
        }
    }
}
