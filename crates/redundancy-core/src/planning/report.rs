//! From what the planner found to a [`Plan`].

use super::demand::Demand;
use super::pull::Puller;
use super::refine::{LEGAL, Refined};
use super::verify;
use crate::chain::JointKind;
use crate::error::Result;
use crate::parallel::prelude::*;
use crate::path::{
    BlockedPoint, Event, EventKind, Path, Plan, PlanBuilder, Reconfiguration, TimingSettings, Trajectory,
    times_within_limits,
};
use crate::status::Status;
use crate::tolerance::{FREE_SPEED, JOINT_JUMP};
use crate::watch::Interrupted;

/// What the planner found.
pub(super) enum Outcome {
    /// A line that is legal, and what interrupted its refinement.
    Line(Box<Refined>, Option<Interrupted>),
    /// Time was up, or the caller stopped: the best so far.
    Interrupted(Option<Box<Refined>>, Interrupted),
    /// Points without any configuration.
    Blocked(Vec<BlockedPoint>),
    /// No continuous line: rows with jumps, and why.
    Jumps { q: Vec<f64>, jumps: Vec<Reconfiguration>, reason: String },
    /// Nothing at all, and why.
    Nothing(String),
}

impl Outcome {
    /// The same with something said before its reason.
    pub fn after(self, before: &str) -> Self {
        match self {
            Self::Jumps { q, jumps, reason } => {
                Self::Jumps { q, jumps, reason: format!("{before}; {reason}") }
            }
            Self::Nothing(reason) => Self::Nothing(format!("{before}; {reason}")),
            other => other,
        }
    }
}

/// The plan of an outcome.
pub(super) fn plan(demand: &Demand, path: &Path, outcome: Outcome) -> Result<Plan> {
    let names = || demand.chain.joints().iter().map(|j| j.name.clone()).collect::<Vec<String>>();
    match outcome {
        Outcome::Line(line, interrupted) => of_line(demand, path, &line, interrupted),
        Outcome::Interrupted(Some(line), why) => of_line(demand, path, &line, Some(why)),
        Outcome::Interrupted(None, why) => {
            let reason = format!("{why} before a continuous line was found");
            PlanBuilder::without_rows(names(), why.status())?
                .reason(reason)
                .asking_about_units(&demand.chain, path)
                .build()
        }
        Outcome::Blocked(points) => {
            let total = path.len();
            let (first, count) = (points.first(), points.len());
            let (status, why) = first.map_or((Status::Infeasible, String::new()), |point| {
                (point.status, format!("point {}: {}", point.row, point.reason))
            });
            let verb = if count == 1 { "has" } else { "have" };
            let what = if status == Status::Collision {
                "no configuration without contact"
            } else {
                "no configuration"
            };
            let reason = format!("{count} of {total} points {verb} {what}; the first is {why}");
            PlanBuilder::without_rows(names(), status)?
                .reason(reason)
                .asking_about_units(&demand.chain, path)
                .blocked(points)
                .build()
        }
        Outcome::Jumps { q, jumps, reason } => of_jumps(demand, path, &q, jumps, reason),
        Outcome::Nothing(reason) => PlanBuilder::without_rows(names(), Status::Infeasible)?
            .reason(reason)
            .asking_about_units(&demand.chain, path)
            .build(),
    }
}

fn of_line(demand: &Demand, path: &Path, line: &Refined, interrupted: Option<Interrupted>) -> Result<Plan> {
    let n = demand.dof();
    let mut q = line.q.clone();
    if demand.cyclic {
        q.extend_from_within(..n);
    }
    let jump = verify::first_jump(demand, &line.q);
    let excess = verify::limit_excess(demand, &line.q).max(line.violation);
    let contact = contact(demand, &line.q);
    let legal = jump.is_none() && contact.is_none() && excess <= LEGAL.max(verify::LIMIT_ROUNDING);
    let (status, reason) = if let Some(why) = interrupted {
        (why.status(), format!("{why}: this is the best line so far"))
    } else if let Some(step) = jump {
        (Status::Infeasible, format!("the line is not continuous between points {step} and {}", step + 1))
    } else if let Some(contact) = contact {
        (Status::Collision, contact)
    } else if !legal {
        (Status::Infeasible, format!("the best line violates a limit by {excess:.3e} rad or m"))
    } else if line.converged {
        (Status::Converged, String::new())
    } else {
        let reason = format!(
            "the refinement ended after {} iterations with a relative gradient of {:.1e}",
            line.iterations, line.slope
        );
        (Status::IterationLimit, reason)
    };
    let builder = rows(demand, path, &q, Vec::new(), status)?;
    let builder = builder.legal(legal).cost(demand.cost(&line.q)).reason(reason);
    builder.asking_about_units(&demand.chain, path).build()
}

/// What touches along a line, and where.
fn contact(demand: &Demand, q: &[f64]) -> Option<String> {
    let around = demand.around.as_ref()?;
    for moved in [true, false] {
        let Some((step, hit)) = verify::first_contact(demand, q, moved) else { continue };
        let n = demand.dof();
        let pairs = usize::from(!moved);
        let deep = |row: usize| {
            let near = around.nearest(&q[row * n..(row + 1) * n], demand.time[row])[pairs]?;
            (near.gap.distance < 0.0).then_some((row, near))
        };
        let deep: Vec<_> = (0..demand.rows()).into_par_iter().filter_map(deep).collect();
        let deepest = deep.into_iter().min_by(|a, b| a.1.gap.distance.total_cmp(&b.1.gap.distance));
        let why =
            if moved { "" } else { "; the path itself forces it: allow this contact, or change the path" };
        let names = around.names(hit.first, hit.second);
        let at = demand.index[step];
        return Some(match deepest {
            Some((row, near)) => format!(
                "{} touch, {:.3} mm deep at point {}; the first contact is {names} after point {at}{why}",
                around.names(near.first, near.second),
                -1e3 * near.gap.distance,
                demand.index[row],
            ),
            None => format!("{names} touch between points {at} and {}{why}", at + 1),
        });
    }
    None
}

fn of_jumps(
    demand: &Demand,
    path: &Path,
    q: &[f64],
    jumps: Vec<Reconfiguration>,
    reason: String,
) -> Result<Plan> {
    let (q, jumps) = if demand.cyclic { closed(demand, q, jumps) } else { (q.to_vec(), jumps) };
    let t = times(demand, path, &q)?;
    let event = |jump: &Reconfiguration| Event {
        kind: EventKind::Reconfiguration,
        index: jump.row,
        t: t[jump.row],
        s: path.s()[jump.row],
        message: format!("the arm changes its configuration before point {}: {}", jump.row, jump.reason),
    };
    let events = jumps.iter().map(event).collect();
    rows(demand, path, &q, events, Status::Infeasible)?
        .legal(false)
        .reason(reason)
        .reconfigurations(jumps)
        .asking_about_units(&demand.chain, path)
        .build()
}

/// A closed path that was cut open, with its first row at the end again: the way back to it may be a jump as well.
fn closed(demand: &Demand, q: &[f64], jumps: Vec<Reconfiguration>) -> (Vec<f64>, Vec<Reconfiguration>) {
    let (n, last) = (demand.dof(), demand.rows() - 1);
    let (mut q, mut jumps) = (q.to_vec(), jumps);
    q.extend_from_within(..n);
    let (from, to) = (&q[last * n..(last + 1) * n], &q[(last + 1) * n..]);
    let bound = &demand.step_bound[last * n..(last + 1) * n];
    let slow = (0..n).all(|i| (to[i] - from[i]).abs() <= bound[i]);
    if !(slow && verify::is_continuous(&mut Puller::new(demand), demand, [last, 0], from, to)) {
        let row = last + 1;
        jumps.push(Reconfiguration { row, reason: step_too_far(demand, &q, row) });
    }
    (q, jumps)
}

/// By how much the joints would have to step to a row.
pub(super) fn step_too_far(demand: &Demand, q: &[f64], row: usize) -> String {
    let n = demand.dof();
    let step = |i: usize| q[row * n + i] - q[(row - 1) * n + i];
    let worst = (0..n).map(|i| (step(i), i)).max_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
    let Some((d, i)) = worst else { return String::new() };
    let (bound, joint) = (demand.step_bound[(row - 1) * n + i], &demand.chain.joints()[i]);
    let (unit, turns) = if joint.kind == JointKind::Prismatic { ("m", false) } else { ("rad", true) };
    let why =
        if turns && bound >= JOINT_JUMP { "a continuous step is at most" } else { "its speed limit allows" };
    format!("joint '{}' would have to step {:.4} {unit}, {why} {bound:.4} {unit}", joint.name, d.abs())
}

/// A builder with the columns of all rows.
fn rows(demand: &Demand, path: &Path, q: &[f64], events: Vec<Event>, status: Status) -> Result<PlanBuilder> {
    let n = demand.dof();
    let names = demand.chain.joints().iter().map(|j| j.name.clone()).collect();
    let t = times(demand, path, q)?;
    let trajectory = Trajectory::new(names, t, q.to_vec(), None, events)?;
    let mut builder = PlanBuilder::new(trajectory, status);
    let count = q.len() / n;
    let poses: Vec<_> = q.chunks_exact(n).map(|q| demand.chain.forward_unchecked(q)).collect();
    let target = |row: usize| &demand.targets[row % demand.rows()];
    if path.has_orientation() {
        let tilt = (0..count).map(|row| demand.tool.tilt_of(&poses[row], target(row))).collect();
        let mut spin: Vec<f64> =
            (0..count).map(|row| demand.tool.spin_of(&poses[row], target(row))).collect();
        for k in 1..count {
            spin[k] = crate::joint_space::nearest(spin[k], spin[k - 1]);
        }
        builder = builder.tilt(tilt).spin(spin);
    }
    let cost = (0..count)
        .map(|row| if row < demand.rows() { demand.row_cost(row, &q[row * n..(row + 1) * n]) } else { 0.0 });
    builder = builder.row_cost(cost.collect());
    if let Some(around) = &demand.around {
        let time = |row: usize| demand.time[row % demand.rows()];
        let near: Vec<[f64; 2]> =
            (0..count).into_par_iter().map(|row| around.row(&q[row * n..(row + 1) * n], time(row))).collect();
        let [obstacles, own] = around.looks_at();
        if obstacles {
            builder = builder.clearance(near.iter().map(|near| near[0]).collect());
        }
        if own {
            builder = builder.self_clearance(near.iter().map(|near| near[1]).collect());
        }
    }
    builder.s(path.s().to_vec()).margin_of(&demand.chain).map(|builder| builder.poses(poses))
}

/// Times of the rows: those of the path, or what the joints' speed limits ask for.
fn times(demand: &Demand, path: &Path, q: &[f64]) -> Result<Vec<f64>> {
    if let Some(steps) = &demand.step_time {
        if let Some(t) = path.t().filter(|t| (t.len() == steps.len() + 1) && !demand.retimed) {
            return Ok(t.to_vec());
        }
        let mut t = vec![0.0];
        for step in steps {
            t.push(t[t.len() - 1] + step);
        }
        return Ok(t);
    }
    let speed = |v: f64| if v.is_finite() { v } else { FREE_SPEED };
    let limits: Vec<f64> = demand.chain.joints().iter().map(|j| speed(j.limits.velocity)).collect();
    times_within_limits(q, &limits, TimingSettings::default())
}
