//! The outcome of a swivel plan and its reason: points without a configuration, limits, reconfigurations.

use super::near::Near;
use super::problem::{SwivelLine, SwivelProblem};
use super::settings::SwivelChoice;
use crate::chain::Chain;
use crate::error::Result;
use crate::joint_space::{nearest, nearest_all, outside};
use crate::parallel::prelude::*;
use crate::path::{
    BlockedPoint, Event, EventKind, Path, Plan, PlanBuilder, Reconfiguration, TimingSettings, Trajectory,
    times_within_limits,
};
use crate::scene::{Nearby, Proximity, SweepMemory, Thing, sweep};
use crate::solutions::signs;
use crate::status::Status;
use crate::tolerance::FREE_SPEED;
use crate::watch::Interrupted;

/// A line as far as it goes, and the verdict on it.
#[derive(Debug, Clone)]
pub(in crate::planning) struct SwivelOutcome {
    status: Status,
    reason: String,
    /// Whether the verdict is exact.
    proven: bool,
    line: SwivelLine,
    /// Why, for each reconfiguration of the line.
    obstructions: Vec<String>,
    blocked: Vec<BlockedPoint>,
    /// Distance from the obstacles at each row; none without a scene.
    clearance: Option<Vec<f64>>,
    /// Distance of links from each other at each row; none where they are not checked.
    self_clearance: Option<Vec<f64>>,
    cost: Option<f64>,
}

impl SwivelOutcome {
    fn without_line(status: Status, reason: String) -> Self {
        Self {
            status,
            reason,
            proven: false,
            line: SwivelLine::default(),
            obstructions: Vec::new(),
            blocked: Vec::new(),
            clearance: None,
            self_clearance: None,
            cost: None,
        }
    }

    pub fn interrupted(interrupted: Interrupted) -> Self {
        Self::without_line(interrupted.status(), interrupted.to_string())
    }

    /// What to say when no line closes.
    pub fn never_closed() -> Self {
        let reason = "no line along the path ends in the configuration in which it began";
        Self::without_line(Status::Infeasible, reason.into())
    }

    /// The plan: with the times of the path, or timed by the velocity limits of `chain` ([`FREE_SPEED`] for joints
    /// without) where it has none. Reconfigurations are events.
    pub fn into_plan(self, chain: &Chain, path: &Path) -> Result<Plan> {
        let Self { status, reason, proven, line, obstructions, blocked, clearance, self_clearance, cost } =
            self;
        let rows = line.q.len();
        let q = line.q.as_flattened().to_vec();
        let t = match path.t() {
            Some(t) => t[..rows].to_vec(),
            None => {
                let speed = |v: f64| if v.is_finite() { v } else { FREE_SPEED };
                let limits: Vec<f64> = chain.joints().iter().map(|j| speed(j.limits.velocity)).collect();
                times_within_limits(&q, &limits, TimingSettings::default())?
            }
        };
        let changes = line.reconfigurations.iter().zip(obstructions);
        let changes: Vec<_> = changes.map(|(row, reason)| Reconfiguration { row: *row, reason }).collect();
        let event = |change: &Reconfiguration| Event {
            kind: EventKind::Reconfiguration,
            index: change.row,
            t: t[change.row],
            s: path.s()[change.row],
            message: format!(
                "the arm changes its configuration before point {} ({})",
                change.row, change.reason
            ),
        };
        let events = changes.iter().map(event).collect();
        let names = chain.joints().iter().map(|j| j.name.clone()).collect();
        let mut builder =
            swivel_plan(Trajectory::new(names, t, q, None, events)?, status, line.swivel, line.branch)
                .reason(reason)
                .asking_about_units(chain, path)
                .proven(proven)
                .legal(status == Status::Converged)
                .reconfigurations(changes)
                .blocked(blocked)
                .s(path.s()[..rows].to_vec())
                .poses(path.poses()[..rows].to_vec());
        if let Some(clearance) = clearance {
            builder = builder.clearance(clearance);
        }
        if let Some(clearance) = self_clearance {
            builder = builder.self_clearance(clearance);
        }
        if let Some(cost) = cost {
            builder = builder.cost(cost);
        }
        builder.margin_of(chain)?.build()
    }
}

/// The plan of an S-R-S arm with the swivel and the branch of each row.
pub(in crate::planning) fn swivel_plan(
    trajectory: Trajectory,
    status: Status,
    swivel: Vec<f64>,
    branch: Vec<usize>,
) -> PlanBuilder {
    let word = |sign: i8| if sign > 0 { '+' } else { '-' };
    let labels = (0..8).map(|b| signs(b).map(word).iter().collect()).collect();
    PlanBuilder::new(trajectory, status).spare("swivel", swivel).pieces(branch, labels)
}

impl SwivelProblem<'_> {
    /// The outcome when points have no configuration within the limits.
    pub fn blocked(&self) -> Option<SwivelOutcome> {
        let blocked: Vec<usize> = self.where_all(|k| self.circles[k].status() != Status::Converged);
        let k = *blocked.first()?;
        let (count, n, motion) = (blocked.len(), self.circles.len(), &self.circles[k]);
        let verb = if count == 1 { "has" } else { "have" };
        let reason = format!(
            "{count} of {n} points {verb} no configuration; the first is point {k}: {}",
            motion.reason()
        );
        let point = |row: usize| {
            let motion = &self.circles[row];
            BlockedPoint { row, status: motion.status(), reason: motion.reason() }
        };
        let blocked = blocked.into_iter().map(point).collect();
        Some(SwivelOutcome { proven: true, blocked, ..SwivelOutcome::without_line(motion.status(), reason) })
    }

    /// The verdict on a line, with the reason where it is not whole.
    pub fn finish(&self, line: SwivelLine) -> SwivelOutcome {
        let n = self.circles.len();
        if let Some(outcome) = (line.q.len() < n).then(|| self.behind_obstacles()).flatten() {
            return outcome;
        }
        let obstructions: Vec<String> =
            line.reconfigurations.iter().map(|k| self.step_reason(*k, &line)).collect();
        let mut blocked = Vec::new();
        let (mut status, mut reason) = if line.q.len() < n {
            let k = line.q.len();
            let margin = match self.settings.margin {
                0.0 => String::new(),
                margin => format!(" with a margin of {margin} rad"),
            };
            let what = match &self.settings.choice {
                SwivelChoice::Fixed(_) => "the given swivel does not hold",
                _ if self.settings.branch.is_some() => "the given branch does not hold",
                _ => "no branch holds",
            };
            let miss = self.nearest_miss(k);
            let reason = format!("{what} the joint limits{margin} at point {k} of {n}: {miss}");
            blocked.push(BlockedPoint { row: k, status: Status::Limits, reason: miss });
            (Status::Limits, reason)
        } else if let Some((k, miss)) = line.reconfigurations.first().zip(obstructions.first()) {
            let count = line.reconfigurations.len();
            let times =
                if count == 1 { "one reconfiguration".into() } else { format!("{count} reconfigurations") };
            let reason =
                format!("no continuous solution: it needs {times}, the first before point {k} ({miss})");
            (Status::Infeasible, reason)
        } else {
            (Status::Converged, String::new())
        };
        if let Some(contact) = self.forced_contact(&line) {
            if status == Status::Converged {
                (status, reason) = (Status::Collision, contact);
            } else {
                reason = format!("{reason}; {contact}");
            }
        }
        let [clearance, self_clearance] = self.clearances(&line);
        let proven = status == Status::Converged;
        let cost = proven.then(|| {
            let rows = (0..n).into_par_iter();
            let near: Vec<Near> = rows.map(|k| self.distance_of(&line, k)).collect();
            self.cost_of(&line.swivel, &line.q, &near)
        });
        let cost = cost.filter(|cost| cost.is_finite());
        SwivelOutcome { status, reason, proven, line, obstructions, blocked, clearance, self_clearance, cost }
    }

    /// Distances from the obstacles and of links from each other along a line, of all links.
    fn clearances(&self, line: &SwivelLine) -> [Option<Vec<f64>>; 2] {
        let Some(o) = &self.obstacles else { return [None, None] };
        let rows = (0..line.q.len()).into_par_iter();
        let near: Vec<[f64; 2]> = rows.map(|k| o.arm.row(&line.q[k], o.times[k])).collect();
        let looked = o.arm.looks_at();
        [0, 1].map(|i| looked[i].then(|| near.iter().map(|near| near[i]).collect()))
    }

    /// What the pose holds in contact along a line: at its points, or else between them.
    fn forced_contact(&self, line: &SwivelLine) -> Option<String> {
        let o = self.obstacles.as_ref().filter(|o| !o.arm.held.is_empty())?;
        let advice = "no swivel changes that; allow this contact, or change the path";
        let other = |thing: Thing| match thing {
            Thing::Link(_) => format!("link '{}'", o.arm.held.name(thing)),
            Thing::Obstacle(_) => format!("obstacle '{}'", o.arm.held.name(thing)),
        };
        let rows = (0..line.q.len()).into_par_iter();
        let near: Vec<Option<Nearby>> = rows.map(|k| o.arm.nearest(&line.q[k], o.times[k])[1]).collect();
        let touching = |near: &Option<Nearby>| near.filter(|near| near.gap.distance < 0.0);
        let count = near.iter().filter(|near| touching(near).is_some()).count();
        if let Some((k, near)) = near.iter().enumerate().find_map(|(k, near)| Some((k, touching(near)?))) {
            let (depth, n) = (-1e3 * near.gap.distance, line.q.len());
            return Some(format!(
                "the path itself brings {} into contact with {} at {count} of {n} points, first {depth:.3} mm deep at \
                 point {k}: {advice}",
                other(near.first),
                other(near.second)
            ));
        }
        let edge = |memory: &mut SweepMemory, k: usize| {
            if line.reconfigurations.binary_search(&k).is_ok() {
                return None;
            }
            let ends: [&[f64]; 2] = [&line.q[k - 1], &line.q[k]];
            Some((k, sweep(&o.arm.held, ends, [o.times[k - 1], o.times[k]], 0.0, memory)?))
        };
        let edges = (1..line.q.len()).into_par_iter();
        let hits = edges.map_init(|| SweepMemory::new(self.arm.chain()), edge).flatten();
        let (k, hit) = hits.min_by_key(|(k, _)| *k)?;
        Some(format!(
            "the path itself brings {} into contact with {} between points {} and {k}: {advice}",
            other(hit.first),
            other(hit.second),
            k - 1
        ))
    }

    /// The configuration over point `k` within the limits that is farthest from contact, and its distance.
    fn clearest(&self, k: usize) -> Option<(f64, [f64; 7])> {
        let mut best: Option<(f64, [f64; 7])> = None;
        let mut anchors = [const { None }; 8];
        for s in self.grid(k) {
            let all = self.circles[k].all_branches(s);
            let within = self.branches.iter().filter(|b| self.holds(&all[**b]));
            let mask = within.clone().fold(0u8, |mask, b| mask | 1 << b);
            let distances = self.distances(k, s, &all, mask, &mut anchors);
            for b in within {
                let mut distance = distances[*b].least;
                // Which contact is the least deep counts only where all are in contact.
                if distance <= 0.0 && best.as_ref().is_none_or(|best| best.0 <= 0.0) {
                    let near = self.obstacles.as_ref().and_then(|o| o.arm.nearest(&all[*b], o.times[k])[0]);
                    distance = near.map_or(distance, |near| near.gap.distance);
                }
                if best.as_ref().is_none_or(|best| distance > best.0) {
                    best = Some((distance, all[*b]));
                }
            }
        }
        best
    }

    /// Which link is how deep in what at a configuration over point `k`.
    fn contact(&self, k: usize, q: &[f64; 7]) -> Option<String> {
        let o = self.obstacles.as_ref()?;
        let near = o.arm.nearest(q, o.times[k])[0]?;
        let word = |thing: Thing| if matches!(thing, Thing::Link(_)) { "link" } else { "obstacle" };
        let (first, second) = (o.arm.moved.name(near.first), o.arm.moved.name(near.second));
        let depth = -1e3 * near.gap.distance;
        let (this, that) = (word(near.first), word(near.second));
        Some(format!("even at best {this} '{first}' is {depth:.3} mm deep in {that} {second}"))
    }

    /// The outcome when obstacles cover every configuration within the limits of some points.
    fn behind_obstacles(&self) -> Option<SwivelOutcome> {
        self.obstacles.as_ref()?;
        let n = self.circles.len();
        let blocked: Vec<BlockedPoint> = (0..n)
            .into_par_iter()
            .filter_map(|row| {
                let (_, q) = self.clearest(row).filter(|clearest| clearest.0 <= 0.0)?;
                Some(BlockedPoint { row, status: Status::Collision, reason: self.contact(row, &q)? })
            })
            .collect();
        let (count, first) = (blocked.len(), blocked.first()?);
        let verb = if count == 1 { "is" } else { "are" };
        let reason = format!(
            "{count} of {n} points {verb} blocked by obstacles at every swivel; the first is point {}: {}",
            first.row, first.reason
        );
        Some(SwivelOutcome { blocked, ..SwivelOutcome::without_line(Status::Collision, reason) })
    }

    /// Which limits the branches break at the fixed swivel of point `k`, the least bad first.
    fn nearest_miss(&self, k: usize) -> String {
        let mut best = (f64::INFINITY, String::new());
        for s in self.grid(k) {
            let all = self.circles[k].all_branches(s);
            for b in &self.branches {
                let misses = (0..7).map(|i| outside(all[*b][i], self.lower[i], self.upper[i]));
                if let Some((i, miss)) = misses.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))
                    && miss < best.0
                {
                    let name = &self.arm.chain().joints()[i].name;
                    best = (
                        miss,
                        format!(
                            "even the best configuration leaves joint '{name}' {miss:.6} rad outside its limits"
                        ),
                    );
                }
            }
        }
        best.1
    }

    /// What stands in the way of going on as before at a reconfiguration.
    fn step_reason(&self, k: usize, line: &SwivelLine) -> String {
        let all = self.circles[k].all_branches(line.swivel[k - 1]);
        let q = &all[line.branch[k - 1]];
        for i in 0..7 {
            let at = nearest(q[i], line.q[k - 1][i]);
            let name = &self.arm.chain().joints()[i].name;
            if at < self.lower[i] || at > self.upper[i] {
                let (lower, upper) = (self.lower[i], self.upper[i]);
                return format!("joint '{name}' would leave [{lower:.6}, {upper:.6}] rad");
            }
            let step = (at - line.q[k - 1][i]).abs();
            if step > self.steps[k - 1][i] {
                return format!(
                    "joint '{name}' would have to step {step:.6} rad; at most {:.6} rad is allowed",
                    self.steps[k - 1][i]
                );
            }
        }
        let branch = line.branch[k - 1];
        let distance = self.distance(k, branch, line.swivel[k - 1], q).least;
        if distance <= 0.0 {
            let near = self.obstacles.as_ref().and_then(|o| o.arm.nearest(q, o.times[k])[0]);
            let depth = -1e3 * near.map_or(distance, |near| near.gap.distance);
            return format!("the arm would be {depth:.3} mm deep in an obstacle");
        }
        let before = self.distance_of(line, k - 1).least;
        let after = nearest_all(q, &line.q[k - 1]);
        if !self.edge_is_clear(k - 1, [&line.q[k - 1], &after], [before, distance], &mut None) {
            return format!("the arm would touch an obstacle between points {} and {k}", k - 1);
        }
        if self.obstacles.is_some() {
            return "every continuation ends at a joint limit or at an obstacle".into();
        }
        "every continuation ends at a joint limit".into()
    }
}
