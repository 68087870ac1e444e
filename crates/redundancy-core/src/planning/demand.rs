//! What a plan must respect and what it costs.
//!
//! The cost of a line of configurations `q_0 ... q_{N-1}` is
//!
//! `sum_k D_k (w_l L(q_k) + w_c C(q_k) + criterion) + w_m sum_k |W (q_{k+1} - q_k)|^2 / D_{k,k+1}`
//!
//! with `D_{k,k+1}` the share of the path (of its time, where it has one) between neighbours, `D_k` half of the
//! neighbouring shares, and `L = sum_i (x_i^2 / (1 - x_i^2))^2` of the positions `x` in the joint ranges, -1 to 1.

use std::sync::Arc;

use super::around::{Around, Near};
use super::tool::{MOST_JOINTS, Target, ToolTask};
use crate::chain::{Chain, JointKind};
use crate::criterion::Criterion;
use crate::error::{Error, Result, check_finite, check_length};
use crate::kinematics::{Task, ToolFreedom, rotation_vector};
use crate::path::Path;
use crate::scene::{LinkGeometry, Scene};
use crate::tolerance::{CYCLE_ANGLE, CYCLE_POSITION, JOINT_JUMP, PLAN_LEAST_SHARE, PLAN_ROOM};

/// What a plan minimises.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Objective {
    /// The cost with the squared joint motion.
    Motion,
    /// The cost with the length of the joint motion.
    Length,
    /// The largest joint speed, and then the motion.
    PeakSpeed,
}

impl Objective {
    /// Every objective, in declaration order.
    pub const ALL: [Self; 3] = [Self::Motion, Self::Length, Self::PeakSpeed];

    /// The objective as a word in lower snake case.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Motion => "motion",
            Self::Length => "length",
            Self::PeakSpeed => "peak_speed",
        }
    }

    /// The objective with this name.
    ///
    /// # Errors
    /// An unknown name; the message lists the known ones.
    pub fn from_name(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|objective| objective.as_str() == name).ok_or_else(|| Error::UnknownName {
            kind: "objective",
            name: name.into(),
            valid: Self::ALL.map(|objective| objective.as_str().to_owned()).to_vec(),
        })
    }
}

/// Settings of [`plan`](super::plan).
#[derive(Debug, Clone)]
pub struct PlanSettings {
    /// How far the tool may lean and spin.
    pub freedom: ToolFreedom,
    /// Which coordinates count; `None` is the pose, or the position on a path of positions.
    pub task: Option<Task>,
    /// What is minimised.
    pub objective: Objective,
    /// Weight of the joint motion.
    pub motion_weight: f64,
    /// Weight of the distance from the joint limits.
    pub limit_weight: f64,
    /// A criterion along the path, minimised or maximised as its sense says.
    pub criterion: Option<Arc<dyn Criterion>>,
    /// Its weight.
    pub criterion_weight: f64,
    /// Obstacles; contact is forbidden. Those that move are where the times of the path have them.
    pub scene: Option<Scene>,
    /// Shapes of the links; `None`: capsules of `link_radius` from joint to joint.
    pub links: Option<LinkGeometry>,
    /// Radius of these capsules, m.
    pub link_radius: f64,
    /// Whether links must not touch each other: the pairs of `links`, or those found for the capsules.
    pub self_collision: bool,
    /// Distance from obstacles that is wanted, m.
    pub wanted_clearance: f64,
    /// Weight of what is missing from it.
    pub clearance_weight: f64,
    /// Weight of each joint in the motion; `None` is 1.
    pub joint_weights: Option<Vec<f64>>,
    /// Constant speed of the tool along the path, m/s; `None` takes the path's times.
    pub tool_speed: Option<f64>,
    /// Largest joint speeds, rad/s or m/s; `None` is off. They bound a step where there are times.
    pub velocity_limits: Option<Vec<f64>>,
    /// Weight of each joint's speed in the peak; `None` is one over its limit.
    pub speed_weights: Option<Vec<f64>>,
    /// Distance that is kept from every joint limit, rad or m.
    pub margin: f64,
    /// The arm ends as it began, windings included; the path must be closed.
    pub cyclic: bool,
    /// The configuration at the first point.
    pub q_start: Option<Vec<f64>>,
    /// The configuration at the last point.
    pub q_end: Option<Vec<f64>>,
    /// Seconds after which the best so far is returned.
    pub time_limit: f64,
    /// Seed of the random postures.
    pub seed: u64,
}

impl Default for PlanSettings {
    fn default() -> Self {
        Self {
            freedom: ToolFreedom::NONE,
            task: None,
            objective: Objective::Motion,
            motion_weight: 0.5,
            limit_weight: 1.0,
            criterion: None,
            criterion_weight: 1.0,
            scene: None,
            links: None,
            link_radius: 0.05,
            self_collision: false,
            wanted_clearance: 0.03,
            clearance_weight: 1e4,
            joint_weights: None,
            tool_speed: None,
            velocity_limits: None,
            speed_weights: None,
            margin: 0.0,
            cyclic: false,
            q_start: None,
            q_end: None,
            time_limit: 10.0,
            seed: 0,
        }
    }
}

impl PlanSettings {
    fn validate(&self, n: usize) -> Result<()> {
        let out = |what: &str, value: f64, bound: &str| {
            Err(Error::OutOfRange { what: what.into(), value, bound: bound.into() })
        };
        for (what, value) in [
            ("motion_weight", self.motion_weight),
            ("limit_weight", self.limit_weight),
            ("criterion_weight", self.criterion_weight),
            ("clearance_weight", self.clearance_weight),
        ] {
            if !(0.0..=MAX_WEIGHT).contains(&value) {
                return out(what, value, "between 0 and 1e6");
            }
        }
        if !(self.margin.is_finite() && self.margin >= 0.0) {
            return out("margin", self.margin, "finite and >= 0");
        }
        if !(self.wanted_clearance.is_finite() && self.wanted_clearance >= 0.0) {
            return out("wanted_clearance", self.wanted_clearance, "finite and >= 0 m");
        }
        if !(self.link_radius.is_finite() && self.link_radius > 0.0) {
            return out("link_radius", self.link_radius, "finite and > 0 m");
        }
        if self.time_limit.is_nan() || self.time_limit < 0.0 {
            return out("time_limit", self.time_limit, ">= 0 s");
        }
        if let Some(speed) = self.tool_speed
            && !(speed.is_finite() && speed > 0.0)
        {
            return out("tool_speed", speed, "finite and > 0 m/s");
        }
        for (what, values) in [
            ("joint_weights", &self.joint_weights),
            ("velocity_limits", &self.velocity_limits),
            ("speed_weights", &self.speed_weights),
        ] {
            if let Some(values) = values {
                check_length(what, values, n)?;
                let finite = what != "velocity_limits";
                let bad = |v: &f64| v.is_nan() || *v <= 0.0 || (finite && v.is_infinite());
                if let Some(i) = values.iter().position(bad) {
                    return out(&format!("{what}[{i}]"), values[i], "> 0");
                }
            }
        }
        if let Some(criterion) = &self.criterion {
            crate::criterion::check_dof(criterion.as_ref(), n)?;
        }
        Ok(())
    }
}

/// A problem of planning, ready for search and refinement: rows of the path with their targets, shares and bounds.
#[derive(Debug, Clone)]
pub(super) struct Demand {
    pub chain: Chain,
    pub tool: ToolTask,
    /// Path points: those of the whole path, or some of them.
    pub targets: Vec<Target>,
    /// Index of each row in the whole path.
    pub index: Vec<usize>,
    /// Share of each row.
    pub row_share: Vec<f64>,
    /// Share of each step to the next row; a closed path has as many steps as rows, its last row is left out.
    pub step_share: Vec<f64>,
    /// Largest joint steps, `n` per step.
    pub step_bound: Vec<f64>,
    /// Whether the times come from a tool speed, not from the path.
    pub retimed: bool,
    /// Time of each step, s, where the path has times.
    pub step_time: Option<Vec<f64>>,
    /// Position limits with the margin taken off.
    pub lower: Vec<f64>,
    pub upper: Vec<f64>,
    /// The margin that was taken off.
    pub margin: f64,
    /// Middle and half-width of each joint range; the width is 0 where a joint has no range.
    pub range: Vec<[f64; 2]>,
    /// Squared weights of the joints in the motion.
    pub joint_weight: Vec<f64>,
    /// Weights of the joint speeds in the peak.
    pub speed_weight: Vec<f64>,
    pub motion_weight: f64,
    pub limit_weight: f64,
    pub criterion: Option<(f64, Arc<dyn Criterion>)>,
    /// What the plan keeps away from, and the least distance that it keeps, m.
    pub around: Option<Arc<Around>>,
    pub safe: f64,
    /// Time of each row, s, for obstacles that move; 0 without times.
    pub time: Vec<f64>,
    pub objective: Objective,
    pub cyclic: bool,
    /// Configurations that are given at the ends.
    pub first: Option<Vec<f64>>,
    pub last: Option<Vec<f64>>,
    pub seed: u64,
}

impl Demand {
    /// Checks the caller's input and prepares it.
    pub fn new(chain: &Chain, path: &Path, settings: &PlanSettings) -> Result<Self> {
        let n = chain.dof();
        settings.validate(n)?;
        if n > MOST_JOINTS {
            let bound = format!("at most {MOST_JOINTS}");
            return Err(Error::OutOfRange { what: "number of joints".into(), value: n as f64, bound });
        }
        let tool = ToolTask::new(settings.task, &settings.freedom, path.has_orientation())?;
        if tool.rows() > n {
            return Err(Error::Invalid(format!(
                "'{}' has {n} joints, the task asks for {} coordinates",
                chain.name(),
                tool.rows()
            )));
        }
        if settings.cyclic {
            check_closed(path, &tool)?;
        }
        let (lower, upper) = limits(chain, settings.margin)?;
        let times = times(path, settings)?;
        let (share, step_time) = steps(path, times.as_deref());
        let rows = if settings.cyclic { path.len() - 1 } else { path.len() };
        let step_bound = step_bounds(chain, settings, step_time.as_deref(), share.len());
        let limit = |i: usize| chain.joints()[i].limits.velocity;
        let speed_weight = match &settings.speed_weights {
            Some(weights) => weights.clone(),
            None => (0..n).map(|i| if limit(i).is_finite() { 1.0 / limit(i) } else { 0.0 }).collect(),
        };
        if settings.objective == Objective::PeakSpeed {
            if step_time.is_none() {
                return Err(Error::Invalid(
                    "objective 'peak_speed' needs times: give the path t, or tool_speed".into(),
                ));
            }
            if speed_weight.iter().all(|w| *w == 0.0) {
                return Err(Error::Invalid(
                    "objective 'peak_speed': no joint has a velocity limit, so give speed_weights".into(),
                ));
            }
        }
        let around = around(chain, &tool, settings)?;
        if around.as_ref().is_some_and(Around::moves) && step_time.is_none() {
            return Err(Error::Invalid(
                "an obstacle of the scene moves, so the path needs times: give it t, or tool_speed".into(),
            ));
        }
        let start = path.t().filter(|_| settings.tool_speed.is_none()).map_or(0.0, |t| t[0]);
        let mut time = vec![start; rows];
        if let Some(steps) = &step_time {
            for row in 1..rows {
                time[row] = time[row - 1] + steps[row - 1];
            }
        }
        let weights = settings.joint_weights.clone().unwrap_or_else(|| vec![1.0; n]);
        let mut demand = Self {
            chain: chain.clone(),
            tool,
            targets: path.poses()[..rows].iter().map(|pose| tool.target(pose)).collect(),
            index: (0..rows).collect(),
            row_share: Vec::new(),
            step_share: share,
            step_bound,
            step_time,
            retimed: settings.tool_speed.is_some(),
            range: ranges(chain),
            lower,
            upper,
            margin: settings.margin,
            joint_weight: weights.iter().map(|w| w * w).collect(),
            speed_weight,
            motion_weight: settings.motion_weight,
            limit_weight: settings.limit_weight,
            criterion: (settings.criterion.clone())
                .map(|criterion| (settings.criterion_weight * criterion.sense().sign(), criterion)),
            around: around.map(Arc::new),
            safe: PLAN_ROOM,
            time,
            objective: settings.objective,
            cyclic: settings.cyclic,
            first: settings.q_start.clone(),
            last: settings.q_end.clone(),
            seed: settings.seed,
        };
        demand.row_share = demand.shares_of_rows();
        for (what, q, row) in
            [("q_start", &demand.first, 0), ("q_end", &demand.last, demand.targets.len() - 1)]
        {
            if let Some(q) = q {
                demand.check_end(what, q, row)?;
            }
        }
        Ok(demand)
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.targets.len()
    }

    /// Number of steps between rows.
    pub fn steps(&self) -> usize {
        self.step_share.len()
    }

    /// The row after a step.
    #[inline(always)]
    pub fn after(&self, step: usize) -> usize {
        if step + 1 == self.rows() { 0 } else { step + 1 }
    }

    /// Number of joints.
    pub fn dof(&self) -> usize {
        self.chain.dof()
    }

    /// Number of spare coordinates.
    pub fn spare(&self) -> usize {
        self.dof() - self.tool.rows()
    }

    /// Number of inequalities of each row: those of the tool, and the distance from all that must not be touched.
    pub fn bounds(&self) -> usize {
        self.tool.bounds() + usize::from(self.around.is_some())
    }

    /// How near everything is at a configuration of a row.
    pub fn near(&self, row: usize, q: &[f64]) -> Option<Near> {
        self.around.as_ref().map(|around| around.near(q, self.time[row]))
    }

    /// Whether a configuration of a row touches nothing that the freedom moves.
    pub fn is_clear(&self, row: usize, q: &[f64]) -> bool {
        self.around.as_ref().is_none_or(|around| around.is_clear(q, self.time[row], 0.0))
    }

    /// A given configuration of a row.
    pub fn given(&self, row: usize) -> Option<&[f64]> {
        if row == 0 && self.first.is_some() {
            return self.first.as_deref();
        }
        if row + 1 == self.rows() && !self.cyclic { self.last.as_deref() } else { None }
    }

    /// The same problem on some of its rows, first and last included.
    pub fn thinned(&self, rows: &[usize]) -> Self {
        let n = self.dof();
        let steps = if self.cyclic { rows.len() } else { rows.len() - 1 };
        let span = |k: usize| {
            let end = if k + 1 < rows.len() { rows[k + 1] } else { self.rows() };
            rows[k]..end
        };
        let mut step_bound = vec![0.0; steps * n];
        for k in 0..steps {
            for step in span(k) {
                for i in 0..n {
                    step_bound[k * n + i] += self.step_bound[step * n + i];
                }
            }
        }
        let sum = |values: &[f64], k: usize| span(k).map(|step| values[step]).sum::<f64>();
        let mut out = Self {
            targets: rows.iter().map(|row| self.targets[*row].clone()).collect(),
            index: rows.iter().map(|row| self.index[*row]).collect(),
            time: rows.iter().map(|row| self.time[*row]).collect(),
            step_share: (0..steps).map(|k| sum(&self.step_share, k)).collect(),
            step_time: self.step_time.as_ref().map(|t| (0..steps).map(|k| sum(t, k)).collect()),
            step_bound,
            ..self.clone()
        };
        out.row_share = out.shares_of_rows();
        out
    }

    /// The same problem with more distance from the joint limits, where the ranges leave room for it.
    pub fn with_margin(&self, margin: f64) -> Self {
        let mut out = self.clone();
        for (lower, upper) in out.lower.iter_mut().zip(&mut out.upper) {
            if *upper - *lower > 4.0 * margin {
                *lower += margin;
                *upper -= margin;
            }
        }
        out
    }

    /// The same problem with more distance from everything that must not be touched.
    pub fn with_room(&self, room: f64) -> Self {
        Self { safe: self.safe + room, ..self.clone() }
    }

    /// The problem on the rows `first..end` alone, open at both ends.
    pub fn section(&self, first: usize, end: usize) -> Self {
        let n = self.dof();
        let steps = first..end.saturating_sub(1).max(first);
        let mut out = Self {
            targets: self.targets[first..end].to_vec(),
            index: self.index[first..end].to_vec(),
            time: self.time[first..end].to_vec(),
            step_share: self.step_share[steps.clone()].to_vec(),
            step_bound: self.step_bound[steps.start * n..steps.end * n].to_vec(),
            step_time: self.step_time.as_ref().map(|times| times[steps].to_vec()),
            cyclic: false,
            first: if first == 0 { self.first.clone() } else { None },
            last: if end == self.rows() { self.last.clone() } else { None },
            ..self.clone()
        };
        out.row_share = out.shares_of_rows();
        out
    }

    /// Evenly spaced rows, about `count` of them, first and last included.
    pub fn even_rows(&self, count: usize) -> Vec<usize> {
        let last = if self.cyclic { self.rows() } else { self.rows() - 1 };
        let intervals = count.saturating_sub(1).clamp(1, last);
        let mut rows: Vec<usize> = (0..=intervals).map(|k| (k * last + intervals / 2) / intervals).collect();
        if self.cyclic {
            rows.pop();
        }
        rows.dedup();
        rows
    }

    /// The limit term `L` at `q`; its gradient and the diagonal of its Hessian are added times `weight`.
    #[inline]
    pub fn limit_term(&self, q: &[f64], weight: f64, gradient: &mut [f64], hessian: &mut [f64]) -> f64 {
        let n = q.len();
        let mut value = 0.0;
        for i in 0..n {
            let [middle, half] = self.range[i];
            if half <= 0.0 {
                continue;
            }
            let x = (q[i] - middle) / half;
            let rest = 1.0 - x * x;
            let y = x * x / rest;
            if rest <= 0.0 || y > LIMIT_CAP {
                value += LIMIT_CAP * LIMIT_CAP;
                continue;
            }
            value += y * y;
            // y = 1 / (1 - x^2) - 1, so y' = 2 x / (1 - x^2)^2 and y'' = (2 + 6 x^2) / (1 - x^2)^3.
            let (dy, ddy) = (2.0 * x / (rest * rest), (2.0 + 6.0 * x * x) / (rest * rest * rest));
            gradient[i] += weight * 2.0 * y * dy / half;
            hessian[i * n + i] += weight * 2.0 * (dy * dy + y * ddy) / (half * half);
        }
        value
    }

    /// Cost of a row without its motion.
    pub fn row_cost(&self, row: usize, q: &[f64]) -> f64 {
        let mut cost = 0.0;
        if self.limit_weight > 0.0 {
            for (q, [middle, half]) in q.iter().zip(&self.range) {
                if *half > 0.0 {
                    let x = (q - middle) / half;
                    let rest = 1.0 - x * x;
                    let y = if rest > 0.0 { (x * x / rest).min(LIMIT_CAP) } else { LIMIT_CAP };
                    cost += self.limit_weight * y * y;
                }
            }
        }
        if let Some((weight, criterion)) = &self.criterion
            && *weight != 0.0
        {
            cost += weight * criterion.value(q);
        }
        if let Some(around) = self.around.as_ref().filter(|around| around.weight > 0.0) {
            cost += around.weight * around.near(q, self.time[row]).missing;
        }
        cost * self.row_share[row]
    }

    /// The cost of a line, without the peak speed.
    pub fn cost(&self, q: &[f64]) -> f64 {
        let n = self.dof();
        let rows: f64 = (0..self.rows()).map(|row| self.row_cost(row, &q[row * n..(row + 1) * n])).sum();
        let motion: f64 = (0..self.steps())
            .map(|step| {
                let (a, b) = (step * n, self.after(step) * n);
                let square: f64 = (0..n).map(|i| self.joint_weight[i] * (q[b + i] - q[a + i]).powi(2)).sum();
                if self.objective == Objective::Length {
                    square.sqrt()
                } else {
                    square / self.step_share[step]
                }
            })
            .sum();
        rows + self.motion_weight * motion
    }

    /// Largest weighted joint speed; 0 without times.
    pub fn peak_speed(&self, q: &[f64]) -> f64 {
        let n = self.dof();
        let Some(times) = &self.step_time else { return 0.0 };
        let mut peak: f64 = 0.0;
        for step in 0..self.steps() {
            let (a, b) = (step * n, self.after(step) * n);
            for i in 0..n {
                peak = peak.max(self.speed_weight[i] * (q[b + i] - q[a + i]).abs() / times[step]);
            }
        }
        peak
    }

    fn shares_of_rows(&self) -> Vec<f64> {
        let (rows, steps) = (self.rows(), self.step_share.len());
        (0..rows)
            .map(|k| {
                let before = if k > 0 {
                    self.step_share[k - 1]
                } else if self.cyclic {
                    self.step_share[steps - 1]
                } else {
                    0.0
                };
                0.5 * (before + self.step_share.get(k).copied().unwrap_or(0.0))
            })
            .collect()
    }

    fn check_end(&self, what: &str, q: &[f64], row: usize) -> Result<()> {
        check_length(what, q, self.dof())?;
        check_finite(what, q)?;
        for (i, joint) in self.chain.joints().iter().enumerate() {
            if q[i] < self.lower[i] - LIMIT_ROUNDING || q[i] > self.upper[i] + LIMIT_ROUNDING {
                return Err(Error::Invalid(format!(
                    "{what}: joint '{}' is at {}, outside [{}, {}]",
                    joint.name, q[i], self.lower[i], self.upper[i]
                )));
            }
        }
        let [position, orientation] =
            self.tool.error_of(&self.chain.forward_unchecked(q), &self.targets[row]);
        if position > ON_PATH || orientation > ON_PATH {
            return Err(Error::Invalid(format!(
                "{what} is not on the path: the tool is {position:.3e} m and {orientation:.3e} rad off its point"
            )));
        }
        Ok(())
    }
}

/// What the plan keeps away from.
fn around(chain: &Chain, tool: &ToolTask, settings: &PlanSettings) -> Result<Option<Around>> {
    if settings.scene.is_none() && !settings.self_collision {
        return Ok(None);
    }
    let links = match &settings.links {
        Some(links) => links.clone(),
        None => {
            let capsules = LinkGeometry::joint_to_joint(chain, settings.link_radius)?;
            if settings.self_collision { capsules.with_capsule_pairs(chain)? } else { capsules }
        }
    };
    let task = tool.named().unwrap_or(Task::POSITION);
    let what = (&links, settings.scene.as_ref(), settings.self_collision);
    Around::new(chain, &task, what, (settings.wanted_clearance, settings.clearance_weight))
}

/// Position limits with the margin taken off.
fn limits(chain: &Chain, margin: f64) -> Result<(Vec<f64>, Vec<f64>)> {
    let lower: Vec<f64> = chain.lower().iter().map(|l| l + margin).collect();
    let upper: Vec<f64> = chain.upper().iter().map(|u| u - margin).collect();
    for (i, joint) in chain.joints().iter().enumerate() {
        if lower[i] > upper[i] {
            return Err(Error::Invalid(format!(
                "margin is {margin}, joint '{}' has a range of only {}",
                joint.name,
                chain.upper()[i] - chain.lower()[i]
            )));
        }
    }
    Ok((lower, upper))
}

/// Middle and half-width of the joint ranges.
fn ranges(chain: &Chain) -> Vec<[f64; 2]> {
    (chain.lower().iter().zip(chain.upper()))
        .map(|(lower, upper)| {
            let half = 0.5 * (upper - lower);
            if half.is_finite() { [lower + half, half] } else { [0.0, 0.0] }
        })
        .collect()
}

/// Times of the rows: from a constant tool speed, or the path's own.
fn times(path: &Path, settings: &PlanSettings) -> Result<Option<Vec<f64>>> {
    let Some(speed) = settings.tool_speed else { return Ok(path.t().map(<[f64]>::to_vec)) };
    if path.length() <= 0.0 {
        return Err(Error::Invalid("tool_speed: the path has no length".into()));
    }
    Ok(Some(path.s().iter().map(|s| (s - path.s()[0]) / speed).collect()))
}

/// Share and time of each step.
fn steps(path: &Path, times: Option<&[f64]>) -> (Vec<f64>, Option<Vec<f64>>) {
    let along = times.unwrap_or(path.s());
    let differences: Vec<f64> = along.windows(2).map(|w| w[1] - w[0]).collect();
    let total: f64 = differences.iter().sum();
    let least = PLAN_LEAST_SHARE / differences.len() as f64;
    let share: Vec<f64> = if total > 0.0 {
        differences.iter().map(|d| (d / total).max(least)).collect()
    } else {
        vec![1.0 / differences.len() as f64; differences.len()]
    };
    let sum: f64 = share.iter().sum();
    (share.iter().map(|d| d / sum).collect(), times.map(|_| differences))
}

/// Largest joint steps: what the speed limits allow where there are times, and never more than an eighth of a turn.
fn step_bounds(chain: &Chain, settings: &PlanSettings, times: Option<&[f64]>, steps: usize) -> Vec<f64> {
    let n = chain.dof();
    let mut out = vec![f64::INFINITY; steps * n];
    for (step, row) in out.chunks_exact_mut(n).enumerate() {
        for (i, (bound, joint)) in row.iter_mut().zip(chain.joints()).enumerate() {
            if joint.kind != JointKind::Prismatic {
                *bound = JOINT_JUMP;
            }
            if let (Some(limits), Some(times)) = (&settings.velocity_limits, times) {
                *bound = bound.min(limits[i] * times[step]);
            }
        }
    }
    out
}

/// A closed path ends where it begins.
fn check_closed(path: &Path, tool: &ToolTask) -> Result<()> {
    let (first, last) = (&path.poses()[0], &path.poses()[path.len() - 1]);
    let distance = (last.translation.vector - first.translation.vector).norm();
    let angle = if tool.oriented() {
        rotation_vector(&(last.rotation * first.rotation.inverse())).norm()
    } else {
        0.0
    };
    if path.len() < 4 || distance > CYCLE_POSITION || angle > CYCLE_ANGLE {
        return Err(Error::Invalid(format!(
            "cyclic asks for a path that ends where it begins; its ends are {distance:.3e} m and {angle:.3e} rad apart"
        )));
    }
    Ok(())
}

/// Largest weight.
const MAX_WEIGHT: f64 = 1e6;
/// Largest value of the limit term of one joint: at the limit itself it would be infinite.
const LIMIT_CAP: f64 = 1e3;
/// A given configuration this far outside its limits is there by rounding, rad or m.
const LIMIT_ROUNDING: f64 = 1e-9;
/// Largest distance of a given end from the path, m and rad.
const ON_PATH: f64 = 1e-6;
