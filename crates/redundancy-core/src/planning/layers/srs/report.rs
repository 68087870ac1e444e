//! The line of a search as a plan: its status, and why it is not whole.

use std::f64::consts::TAU;

use rayon::prelude::*;

use super::problem::{Line, Problem};
use crate::planning::swivel_plan::{SwivelChoice, SwivelPlan, empty};
use crate::scene::{Nearby, Proximity, SweepHit, SweepMemory, sweep};
use crate::status::Status;

/// Contact that the path forces.
struct Forced {
    /// Rows in contact.
    rows: usize,
    /// The first row, and what touches there.
    first: Option<(usize, Nearby)>,
    /// Contact between this row and the next, where no row is in contact.
    between: Option<(usize, SweepHit)>,
}

impl Problem<'_> {
    /// The plan that says so, when points have no configuration within the limits.
    pub fn blocked(&self) -> Option<SwivelPlan> {
        let blocked: Vec<usize> = self.where_all(|k| self.circles[k].status() != Status::Converged);
        let k = *blocked.first()?;
        let (count, n, motion) = (blocked.len(), self.circles.len(), &self.circles[k]);
        let verb = if count == 1 { "has" } else { "have" };
        let reason = motion.reason();
        let reason =
            format!("{count} of {n} points {verb} no configuration; the first is point {k}: {reason}");
        Some(SwivelPlan { status: motion.status(), reason, blocked, ..empty() })
    }

    /// The line as a plan, with the reason where it is not whole.
    pub fn finish(&self, line: Line) -> SwivelPlan {
        let n = self.circles.len();
        if let Some(plan) = (line.q.len() < n).then(|| self.behind_obstacles()).flatten() {
            return plan;
        }
        let (mut status, mut reason) = if line.q.len() < n {
            let k = line.q.len();
            let what = match &self.settings.choice {
                SwivelChoice::Fixed(_) => "the given swivel",
                _ => "the given branch",
            };
            (
                Status::Limits,
                format!(
                    "{what} holds the joint limits only up to point {k} of {n}: {}",
                    self.nearest_miss(k)
                ),
            )
        } else if let Some(k) = line.reconfigurations.first() {
            let count = line.reconfigurations.len();
            let times =
                if count == 1 { "one reconfiguration".into() } else { format!("{count} reconfigurations") };
            let miss = self.step_reason(*k, &line);
            (
                Status::Infeasible,
                format!("no continuous solution: it takes {times}, the first before point {k}{miss}"),
            )
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
        let blocked = if line.q.len() < n { vec![line.q.len()] } else { Vec::new() };
        let [clearance, self_clearance] = self.clearances(&line);
        let obstructions = line.reconfigurations.iter().map(|k| self.step_reason(*k, &line)).collect();
        let Line { branch, swivel, q, reconfigurations, .. } = line;
        SwivelPlan {
            status,
            reason,
            legal: status == Status::Converged,
            q,
            swivel,
            branch,
            reconfigurations,
            obstructions,
            blocked,
            clearance,
            self_clearance,
        }
    }

    /// Distances from the obstacles and of links from each other along a line; empty where they are not looked at.
    fn clearances(&self, line: &Line) -> [Vec<f64>; 2] {
        let Some(o) = &self.obstacles else { return [Vec::new(), Vec::new()] };
        let near: Vec<[f64; 2]> =
            line.q.par_iter().enumerate().map(|(k, q)| o.arm.row(q, o.times[k])).collect();
        let [scene, own] = o.arm.looks_at();
        let column = |i: usize, looked: bool| near.iter().filter(|_| looked).map(|near| near[i]).collect();
        [column(0, scene), column(1, own)]
    }

    /// What the pose holds in contact along a line: at its points, and between them.
    fn forced_contact(&self, line: &Line) -> Option<String> {
        let o = self.obstacles.as_ref().filter(|o| !o.arm.held.is_empty())?;
        let rows: Vec<Option<Nearby>> =
            line.q.par_iter().enumerate().map(|(k, q)| o.arm.nearest(q, o.times[k])[1]).collect();
        let touching = |near: &Option<Nearby>| near.filter(|near| near.gap.distance < 0.0);
        let first = rows.iter().enumerate().find_map(|(k, near)| Some((k, touching(near)?)));
        let count = rows.iter().filter(|near| touching(near).is_some()).count();
        let edge = |memory: &mut SweepMemory, k: usize| {
            if line.reconfigurations.binary_search(&k).is_ok() {
                return None;
            }
            let ends: [&[f64]; 2] = [&line.q[k - 1], &line.q[k]];
            Some((k - 1, sweep(&o.arm.held, ends, [o.times[k - 1], o.times[k]], 0.0, memory)?))
        };
        let between = if first.is_some() {
            None
        } else {
            let edges = (1..line.q.len()).into_par_iter();
            let hits = edges.map_init(|| SweepMemory::new(self.arm.chain()), edge).flatten();
            hits.min_by_key(|(k, _)| *k)
        };
        self.contact_reason(&Forced { rows: count, first, between })
    }

    fn contact_reason(&self, forced: &Forced) -> Option<String> {
        let o = self.obstacles.as_ref()?;
        let name = |thing| o.arm.held.name(thing);
        let what = |first, second| {
            let kind = if matches!(second, crate::scene::Thing::Link(_)) { "link" } else { "obstacle" };
            (name(first), kind, name(second))
        };
        let advice = "no swivel changes that; allow this contact, or change the path";
        if let Some((k, near)) = &forced.first {
            let (link, kind, other) = what(near.first, near.second);
            let (depth, n) = (-1e3 * near.gap.distance, self.circles.len());
            let rows = forced.rows;
            return Some(format!(
                "the path itself brings link '{link}' into contact with {kind} '{other}' at {rows} of {n} points, \
                 first {depth:.3} mm deep at point {k}: {advice}"
            ));
        }
        let (k, hit) = forced.between.as_ref()?;
        let (link, kind, other) = what(hit.first, hit.second);
        Some(format!(
            "the path itself brings link '{link}' into contact with {kind} '{other}' between points {k} and {}: {advice}",
            k + 1
        ))
    }

    /// The plan that says so, when obstacles cover every configuration within the limits of some points.
    fn behind_obstacles(&self) -> Option<SwivelPlan> {
        let o = self.obstacles.as_ref()?;
        let n = self.circles.len();
        // The best configuration of each point within the limits.
        let best = |k: usize| -> Option<(f64, [f64; 7])> {
            let mut best: Option<(f64, [f64; 7])> = None;
            for s in self.grid(k) {
                let all = self.circles[k].all_branches(s);
                let within = self.branches.iter().filter(|b| self.holds(&all[**b]));
                let mask = within.clone().fold(0u8, |mask, b| mask | 1 << b);
                let distances = self.distances(k, s, &all, mask);
                for b in within {
                    if best.as_ref().is_none_or(|best| distances[*b].least > best.0) {
                        best = Some((distances[*b].least, all[*b]));
                    }
                }
            }
            best
        };
        let blocked: Vec<(usize, [f64; 7])> = (0..n)
            .into_par_iter()
            .filter_map(|k| best(k).filter(|best| best.0 <= 0.0).map(|best| (k, best.1)))
            .collect();
        let (k, q) = blocked.first()?;
        let near = o.arm.nearest(q, o.times[*k])[0]?;
        let (count, depth) = (blocked.len(), -1e3 * near.gap.distance);
        let verb = if count == 1 { "is" } else { "are" };
        let (link, other) = (o.arm.moved.name(near.first), o.arm.moved.name(near.second));
        let other = match near.second {
            crate::scene::Thing::Link(_) => format!("link '{other}'"),
            crate::scene::Thing::Obstacle(_) => format!("obstacle {other}"),
        };
        let reason = format!(
            "{count} of {n} points {verb} blocked by obstacles at every swivel; the first is point {k}: even at the best \
             swivel link '{link}' is {depth:.3} mm deep in {other}"
        );
        let blocked = blocked.iter().map(|(k, _)| *k).collect();
        Some(SwivelPlan { status: Status::Collision, reason, blocked, ..empty() })
    }

    /// Which limits the branches break at the fixed swivel of point `k`, the least bad first.
    fn nearest_miss(&self, k: usize) -> String {
        let mut best = (f64::INFINITY, String::new());
        for s in self.grid(k) {
            let all = self.circles[k].all_branches(s);
            for b in &self.branches {
                let misses = (0..7).map(|i| {
                    let above = all[*b][i] + TAU * ((self.lower[i] - all[*b][i]) / TAU).ceil();
                    (above - self.upper[i]).max(0.0).min(self.lower[i] - above + TAU)
                });
                if let Some((i, miss)) = misses.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))
                    && miss < best.0
                {
                    let name = &self.arm.chain().joints()[i].name;
                    best = (miss, format!("at best joint '{name}' is {miss:.6} rad outside its limits"));
                }
            }
        }
        best.1
    }

    /// What stands in the way of going on as before at a reconfiguration.
    fn step_reason(&self, k: usize, line: &Line) -> String {
        let all = self.circles[k].all_branches(line.swivel[k - 1]);
        let branch = line.branch[k - 1];
        let q = &all[branch];
        for i in 0..7 {
            let at = q[i] + TAU * ((line.q[k - 1][i] - q[i]) / TAU).round();
            let name = &self.arm.chain().joints()[i].name;
            if at < self.lower[i] || at > self.upper[i] {
                let (lower, upper) = (self.lower[i], self.upper[i]);
                return format!(" (joint '{name}' would leave [{lower:.6}, {upper:.6}] rad)");
            }
            let step = (at - line.q[k - 1][i]).abs();
            if step > self.steps[k - 1][i] {
                return format!(
                    " (joint '{name}' would have to step by {step:.6} rad, {:.6} may be)",
                    self.steps[k - 1][i]
                );
            }
        }
        let distance = self.distances(k, line.swivel[k - 1], &all, 1 << branch)[branch].least;
        if distance <= 0.0 {
            return format!(" (the arm would be {:.3} mm deep in an obstacle)", -1e3 * distance);
        }
        let before = self.distance(k - 1, line.swivel[k - 1], &line.q[k - 1]).least;
        let after: [f64; 7] = std::array::from_fn(|i| q[i] + TAU * ((line.q[k - 1][i] - q[i]) / TAU).round());
        if !self.edge_is_clear(k - 1, [&line.q[k - 1], &after], [before, distance], &mut None) {
            return format!(" (the arm would touch an obstacle between points {} and {k})", k - 1);
        }
        if self.obstacles.is_some() {
            return " (every way on ends at a joint limit or at an obstacle)".into();
        }
        " (every way on ends at a joint limit)".into()
    }

    /// What to say when no line closes.
    pub fn never_closed(&self) -> SwivelPlan {
        SwivelPlan {
            status: Status::Infeasible,
            reason: "no line along the path ends in the configuration in which it began".into(),
            ..empty()
        }
    }
}
