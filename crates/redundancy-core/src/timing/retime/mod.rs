//! Times for a joint path: as fast as every limit allows, from rest to rest.
//!
//! # Problem
//! The rows of a joint path are given, when to be at each of them is not. Wanted are the shortest times for which the
//! motion between them holds the limits of velocity, acceleration and torque of every joint, of the tool's speed, and of
//! jerk where one is given.
//!
//! # Method
//! 1. The path is cut into stretches at corners and at rows that repeat; the arm rests there. Corners may be replaced by
//!    curves near them ([`blend`]), which the arm passes without a stop.
//! 2. Straight lines have the closed form of [`straight`]; other stretches are solved by two passes ([`two_pass`]) or, with
//!    jerk limits, by a barrier method ([`jerk`]).
//! 3. The limits hold for the trajectory that is returned, as its own interpolation has it. It is measured between the
//!    rows too: velocities, accelerations and jerks at their extremes, torques and the tool's speed at samples. Where a
//!    limit is exceeded the limits near it are tightened and the stretch is solved again; what is left
//!    after that is removed by slowing the whole stretch down evenly, which `stretched` reports.
//!
//! Rows of the path stay rows, in order. Straight lines get rows where their phases change, and sparse paths rows in
//! between: `path_rows` says which rows are the path's own.
//!
//! References: [PhamPham2018], [BoydVandenberghe2004].

mod blend;
mod extremes;
mod jerk;
mod node_limits;
mod settings;
mod straight;
mod stretch;
mod two_pass;
mod verify;

pub use settings::RetimeSettings;
pub use verify::{LimitKind, Limiting};

use self::blend::Blend;
use self::node_limits::NodeLimits;
use self::straight::StraightLaw;
use self::stretch::{Origin, Stretch};
use self::verify::{Motion, NodeTorques};
use crate::chain::Chain;
use crate::error::{Error, Result, check_vector};
use crate::path::{Event, EventKind, Trajectory};
use crate::tolerance::{
    RETIME_CORNER_RATIO, RETIME_LEAST_NODES, RETIME_SAME_ROW, RETIME_SHARP_CORNER, RETIME_STRAIGHT,
};

/// A joint path with its times.
#[derive(Debug, Clone)]
pub struct Retimed {
    /// Times, positions and velocities; with jerk limits accelerations too, without them an acceleration may jump at a
    /// row. Stops on the way are events.
    pub trajectory: Trajectory,
    /// Which limit binds most at each row; `None` where nothing moves.
    pub limiting: Vec<Option<Limiting>>,
    /// Rows of the trajectory that are rows of the path, one for each.
    pub path_rows: Vec<usize>,
    /// Largest factor by which a stretch had to be slowed down evenly after it was solved, 1 for none. Where no profile was
    /// found the stretch is one smooth ease; the factor is then that over the fastest motion without jerk limits.
    pub stretched: f64,
    /// Rows of the path at which the arm stops on the way.
    pub stops: Vec<usize>,
    /// Rows of the path whose corners the arm passes without a stop, on a curve within `blend` of them.
    pub blends: Vec<usize>,
}

/// The fastest motion along the rows of `q`.
///
/// ```
/// use redundancy_core::{chain::catalog, timing::{RetimeSettings, retime}};
/// let arm = catalog::load("panda")?;
/// let rows: Vec<f64> = (0..100).flat_map(|k| (0..7).map(move |j| (0.02 * f64::from(k) + f64::from(j)).sin())).collect();
/// let motion = retime(&arm, &rows, &RetimeSettings::of(&arm))?;
/// assert_eq!(motion.path_rows.len(), 100);
/// assert!(motion.trajectory.qd_row(0).iter().all(|v| *v == 0.0));
/// # Ok::<(), redundancy_core::Error>(())
/// ```
///
/// # Errors
/// Fewer than two rows, entries that are not finite, invalid settings, a joint whose torque limit does not hold the arm.
pub fn retime(chain: &Chain, q: &[f64], settings: &RetimeSettings) -> Result<Retimed> {
    settings.validate(chain)?;
    let n = chain.dof();
    let rows = q.len() / n;
    check_vector("q", q, rows * n)?;
    if rows < 2 {
        return Err(Error::Length { what: "rows of the path".into(), expected: 2, actual: rows });
    }
    let Timed { motion, mut path_rows, mut stretched, stops, blends } = timed(chain, q, settings)?;
    let motion = match settings.dt {
        None => motion,
        Some(dt) => {
            let (motion, factor) = at_equal_intervals(chain, motion, settings, dt, &mut path_rows)?;
            stretched = stretched.max(factor);
            motion
        }
    };
    let limiting = motion.limiting(chain, settings)?;
    let mut events: Vec<Event> = stops
        .iter()
        .map(|row| (*row, stop_message(*row)))
        .chain(blends.iter().map(Blend::report))
        .map(|(row, message)| {
            let index = path_rows[row];
            Event { kind: EventKind::Limit, index, t: motion.t[index], s: motion.t[index], message }
        })
        .collect();
    events.sort_by_key(|event| event.index);
    let sections = motion.sections();
    let names = chain.joints().iter().map(|joint| joint.name.clone()).collect();
    let smooth = settings.jerk_limits.is_some();
    let mut trajectory = Trajectory::new(names, motion.t, motion.q, Some(motion.qd), events)?;
    if smooth {
        trajectory = trajectory.with_accelerations(motion.qdd)?;
    }
    let blends = blends.iter().map(|blend: &Blend| blend.row).collect();
    Ok(Retimed {
        trajectory: trajectory.with_sections(sections)?,
        limiting,
        path_rows,
        stretched,
        stops,
        blends,
    })
}

/// The motion over all stretches, and what became of the corners.
struct Timed {
    motion: Motion,
    path_rows: Vec<usize>,
    stretched: f64,
    stops: Vec<usize>,
    blends: Vec<Blend>,
}

/// Solves one stretch after the other.
fn timed(chain: &Chain, q: &[f64], settings: &RetimeSettings) -> Result<Timed> {
    let n = chain.dof();
    let cuts = cuts(q, n, settings.corner_angle);
    let mut motion = Motion::new(n, settings.jerk_limits.is_some());
    let mut path_rows = Vec::with_capacity(q.len() / n);
    let mut stretched = 1.0_f64;
    // `None` where the arm waits between two equal rows.
    let legs: Vec<Option<Stretch>> = cuts
        .windows(2)
        .map(|cut| {
            let waits = cut[1] == cut[0] + 1 && distance(q, n, cut[0], cut[1]) <= RETIME_SAME_ROW;
            let rows = &q[cut[0] * n..(cut[1] + 1) * n];
            (!waits).then(|| Stretch::new(rows, n, cut[0], settings.rows_between))
        })
        .collect();
    let count = legs.len();
    let rest =
        |first: usize, behind: usize| [first > 0 || settings.at_rest, behind < count || settings.at_rest];
    let mut alone = Vec::with_capacity(count);
    for (k, leg) in legs.iter().enumerate() {
        alone.push(leg.as_ref().map(|leg| solve(chain, leg, settings, rest(k, k + 1))).transpose()?);
    }
    let (mut stops, mut blends) = (Vec::new(), Vec::new());
    let mut index = 0;
    let timed =
        |stretch: &Stretch, [first, behind]: [usize; 2]| solve(chain, stretch, settings, rest(first, behind));
    for (behind, passed) in blend::passed(chain, &legs, &alone, settings, &timed) {
        if index > 0 {
            stops.push(cuts[index]);
        }
        let parts = alone[index].take();
        let Some((part, factor)) = passed
            .map(|(part, factor, corners)| {
                blends.extend(corners);
                (part, factor)
            })
            .or(parts)
        else {
            let row = cuts[index];
            motion.dwell(&q[row * n..(row + 1) * n], &q[(row + 1) * n..(row + 2) * n], &mut path_rows);
            index = behind;
            continue;
        };
        stretched = stretched.max(factor);
        motion.append(part, &mut path_rows);
        index = behind;
    }
    Ok(Timed { motion, path_rows, stretched, stops, blends })
}

fn stop_message(row: usize) -> String {
    format!("the arm stops at row {row} of the path: its direction changes there")
}

/// The motion with rows every `dt`, slowed down evenly as far as the curve through those rows needs it, and by how much: an
/// acceleration that jumps between two rows is not the one that their cubic has.
fn at_equal_intervals(
    chain: &Chain,
    mut motion: Motion,
    settings: &RetimeSettings,
    dt: f64,
    path_rows: &mut [usize],
) -> Result<(Motion, f64)> {
    let own_rows = path_rows.to_vec();
    let mut factor = 1.0;
    for _ in 0..EQUAL_ROUNDS {
        path_rows.copy_from_slice(&own_rows);
        let mut even = motion.resampled(dt, path_rows);
        let worst = even.excess(chain, settings, 1.0, None, None)?.into_iter().fold(0.0, f64::max);
        if worst <= 1.0 + UNSEEN {
            return Ok((even, factor));
        }
        motion.slow_down(worst * (1.0 + UNSEEN));
        factor *= worst * (1.0 + UNSEEN);
    }
    let least = motion.duration();
    Err(Error::CannotFollow(format!(
        "a motion of {least:.6} s with rows every {dt} s cannot keep the limits: choose a smaller dt"
    )))
}

/// Rounds of slowing down a motion with equal intervals.
const EQUAL_ROUNDS: usize = 20;

/// Distance between two rows in joint space.
fn distance(q: &[f64], n: usize, a: usize, b: usize) -> f64 {
    (0..n).map(|j| (q[b * n + j] - q[a * n + j]).powi(2)).sum::<f64>().sqrt()
}

/// Rows at which the path is cut, with its ends: corners, and both sides of rows that repeat.
///
/// The samples of a smooth curve turn a little at every row; a corner turns much more than its neighbours do, or by so much
/// that no curve was sampled there.
fn cuts(q: &[f64], n: usize, corner_angle: f64) -> Vec<usize> {
    let rows = q.len() / n;
    let turn = |k: usize| -> f64 {
        if k == 0 || k + 1 >= rows {
            return 0.0;
        }
        let step = |a: usize, j: usize| q[(a + 1) * n + j] - q[a * n + j];
        let (before, after) = (distance(q, n, k - 1, k), distance(q, n, k, k + 1));
        if before <= RETIME_SAME_ROW || after <= RETIME_SAME_ROW {
            return 0.0;
        }
        let sum = (0..n).map(|j| (step(k - 1, j) / before + step(k, j) / after).powi(2)).sum::<f64>().sqrt();
        let gap = (0..n).map(|j| (step(k - 1, j) / before - step(k, j) / after).powi(2)).sum::<f64>().sqrt();
        2.0 * gap.atan2(sum)
    };
    let repeats = |k: usize| k + 1 < rows && distance(q, n, k, k + 1) <= RETIME_SAME_ROW;
    let turns: Vec<f64> = (0..rows).map(turn).collect();
    let is_corner = |k: usize| {
        let neighbours = turns[k - 1].max(turns[k + 1]);
        turns[k] > corner_angle
            && (turns[k] > RETIME_SHARP_CORNER || turns[k] > RETIME_CORNER_RATIO * neighbours)
    };
    let inside = (1..rows - 1).filter(|k| repeats(*k) || repeats(*k - 1) || is_corner(*k));
    let mut cuts: Vec<usize> = std::iter::once(0).chain(inside).chain([rows - 1]).collect();
    cuts.dedup();
    cuts
}

/// One stretch, and the factor by which it was slowed down evenly at last.
fn solve(
    chain: &Chain,
    stretch: &Stretch,
    settings: &RetimeSettings,
    rest: [bool; 2],
) -> Result<(Motion, f64)> {
    if rest == [true; 2]
        && settings.rows_between
        && settings.torque_limits.is_none()
        && settings.tool_speed.is_none()
        && let Some(direction) = stretch.straight(RETIME_STRAIGHT)
    {
        let mut motion = straight(stretch, &direction, settings);
        let rounds = if settings.jerk_limits.is_some() { ROUNDING_ROUNDS } else { 0 };
        for _ in 0..rounds {
            let factor = motion.excess(chain, settings, 1.0, None, None)?.into_iter().fold(0.0, f64::max);
            if factor <= 1.0 {
                break;
            }
            motion.slow_down(factor);
        }
        return Ok((motion, 1.0));
    }
    let limits = NodeLimits::new(chain, stretch, settings)?;
    limits.check_gravity(chain, stretch, settings)?;
    let least_nodes = if settings.jerk_limits.is_some() { RETIME_LEAST_NODES } else { 3 };
    if stretch.nodes() < least_nodes {
        return eased(chain, stretch, &limits, settings, rest);
    }
    // Where no profile is found with the torques they are left to the repairs: these tighten the limits where one is exceeded.
    let bare = (settings.torque_limits.is_some() && settings.jerk_limits.is_some())
        .then(|| (limits.without_torques(), RetimeSettings { torque_limits: None, ..settings.clone() }));
    let mut share = vec![1.0; stretch.nodes()];
    let mut rounds: Vec<Round> = Vec::new();
    let mut known = None;
    for _ in 0..REPAIRS {
        let mut law = Vec::new();
        let mut motion = match &settings.jerk_limits {
            None => second_order(stretch, &limits, settings, rest, &share, &mut law)?,
            Some(jerk) => match third_order(stretch, &limits, (settings, jerk), rest, &share, &mut known)
                .or_else(|| {
                    let (limits, settings) = bare.as_ref()?;
                    third_order(stretch, limits, (settings, jerk), rest, &share, &mut known)
                }) {
                Some(motion) => motion,
                None if rounds.is_empty() => return eased(chain, stretch, &limits, settings, rest),
                None => break,
            },
        };
        let before = rounds.last().map(|round| (&round.motion, &round.excess[..]));
        // With jerk limits and along the tool the torques at the nodes alone do not say enough.
        let by_nodes = settings.jerk_limits.is_none() && settings.tool_speed.is_none();
        let nodes = by_nodes.then_some(NodeTorques { limits: &limits, law: &law });
        let excess = motion.excess(chain, settings, 1.0, before, nodes)?;
        let worst = excess.iter().copied().fold(1.0, f64::max);
        // The times of an interval that is too fast by a factor: both its ends, and their neighbours a little.
        for (k, factor) in excess.iter().enumerate() {
            let tighter = factor.powi(-2);
            share[k] = share[k].min(share[k] * tighter);
            share[k + 1] = share[k + 1].min(share[k + 1] * tighter);
        }
        rounds.push(Round { motion, excess, worst });
        if worst <= 1.0 + GOOD_ENOUGH {
            break;
        }
    }
    let slowest = |round: &Round| round.motion.duration() * round.worst;
    let best = rounds.into_iter().min_by(|a, b| slowest(a).total_cmp(&slowest(b)));
    let Some(Round { mut motion, worst, .. }) = best else {
        return Err(Error::Invalid("no times within the limits were found for the path".into()));
    };
    // Between the places that were checked the motion may be a little faster still. The jerk of a short interval is uncertain
    // by the rounding of its rows, differently after every change of its length.
    let mut factor = worst;
    for _ in 0..ROUNDING_ROUNDS {
        motion.slow_down(factor * (1.0 + UNSEEN));
        if settings.jerk_limits.is_none() {
            break;
        }
        factor = motion.excess(chain, settings, 1.0, None, None)?.into_iter().fold(0.0, f64::max);
        if factor <= 1.0 {
            break;
        }
    }
    Ok((motion, worst))
}

/// A motion, by what factor each of its intervals is too fast, and the largest of these factors.
struct Round {
    motion: Motion,
    excess: Vec<f64>,
    worst: f64,
}

/// Rounds of solving again with tighter limits where the motion exceeds them.
const REPAIRS: usize = 4;
/// Excess that is left to the even slowing down: it costs as much time.
const GOOD_ENOUGH: f64 = 2e-4;
/// How often a motion is slowed down again for what rounding adds to its jerk.
const ROUNDING_ROUNDS: usize = 4;
/// Relative excess between the places that were checked.
const UNSEEN: f64 = 1e-5;

fn second_order(
    stretch: &Stretch,
    limits: &NodeLimits,
    settings: &RetimeSettings,
    rest: [bool; 2],
    share: &[f64],
    law: &mut Vec<[f64; 2]>,
) -> Result<Motion> {
    let x = two_pass::fastest(stretch, limits, settings, rest, share)
        .map_err(|k| Error::CannotFollow(format!("no speed at node {k} of the path is within the limits")))?;
    let n = stretch.n;
    let mut motion = Motion::with_room(n, false, stretch.nodes());
    law.reserve(stretch.nodes());
    let speed: Vec<f64> = x.iter().map(|x| x.max(0.0).sqrt()).collect();
    let mut t = 0.0;
    let (mut qd, mut qdd) = (vec![0.0; n], vec![0.0; n]);
    for k in 0..stretch.nodes() {
        let at = k * n..(k + 1) * n;
        let next = (k + 1).min(stretch.nodes() - 1);
        let here = next - 1;
        let u = (x[next] - x[here]) / (2.0 * (stretch.s[next] - stretch.s[here]));
        law.push([u, x[k]]);
        for (j, i) in at.clone().enumerate() {
            qd[j] = stretch.d[i] * speed[k];
            qdd[j] = stretch.d[i] * u + stretch.dd[i] * x[k];
        }
        motion.push(t, &stretch.q[at], &qd, &qdd, stretch.origin[k]);
        if k + 1 < stretch.nodes() {
            t += 2.0 * (stretch.s[k + 1] - stretch.s[k]) / (speed[k] + speed[k + 1]);
        }
    }
    Ok(motion)
}

fn third_order(
    stretch: &Stretch,
    limits: &NodeLimits,
    (settings, jerk): (&RetimeSettings, &[f64]),
    rest: [bool; 2],
    share: &[f64],
    known: &mut Option<Vec<f64>>,
) -> Option<Motion> {
    let law = jerk::fastest(stretch, limits, (settings, jerk), rest, share, known)?;
    let n = stretch.n;
    let mut motion = Motion::with_room(n, true, stretch.nodes());
    for (k, node) in law.nodes.iter().enumerate() {
        let at = k * n..(k + 1) * n;
        motion.push(node.t, &stretch.q[at.clone()], &law.qd[at.clone()], &law.qdd[at], stretch.origin[k]);
    }
    Some(motion)
}

/// One smooth ease from end to end, slowed down evenly until it holds every limit: what is left where nodes are too few for
/// a profile, or where none is found. Its factor is the duration over that of the fastest motion without jerk limits.
fn eased(
    chain: &Chain,
    stretch: &Stretch,
    limits: &NodeLimits,
    settings: &RetimeSettings,
    rest: [bool; 2],
) -> Result<(Motion, f64)> {
    let (n, length) = (stretch.n, stretch.s[stretch.nodes() - 1]);
    let ease = |t: f64| {
        let left = 1.0 - t;
        let s = t * t * t * (10.0 - t * (15.0 - 6.0 * t));
        [s, 30.0 * t * t * left * left, 60.0 * t * left * (left - t)]
    };
    let mut motion = Motion::new(n, settings.jerk_limits.is_some());
    for k in 0..stretch.nodes() {
        let share = stretch.s[k] / length;
        let (mut low, mut high) = (share, share);
        if rest != [false; 2] {
            (low, high) = (0.0, 1.0);
            for _ in 0..EASE_BISECTIONS {
                let middle = 0.5 * (low + high);
                if ease(middle)[0] < share { low = middle } else { high = middle }
            }
        }
        let t = if k == 0 { low } else { high };
        let [speed, acceleration] = match rest {
            [false, false] => [length, 0.0],
            _ => [1, 2].map(|order| length * ease(t)[order]),
        };
        let at = k * n..(k + 1) * n;
        let qd: Vec<f64> = stretch.d[at.clone()].iter().map(|d| d * speed).collect();
        let qdd: Vec<f64> =
            at.clone().map(|i| stretch.d[i] * acceleration + stretch.dd[i] * speed * speed).collect();
        motion.push(t, &stretch.q[at], &qd, &qdd, stretch.origin[k]);
    }
    if rest == [true; 2] {
        motion.rest_at_ends();
    }
    let worst = motion.excess(chain, settings, 0.0, None, None)?.into_iter().fold(0.0, f64::max);
    motion.slow_down(worst * (1.0 + UNSEEN));
    let dense;
    let (reference, its_limits) = if stretch.nodes() > 2 {
        (stretch, limits)
    } else {
        dense = Stretch::new(&stretch.q, n, 0, true);
        (&dense, &NodeLimits::new(chain, &dense, settings)?)
    };
    let share = vec![1.0; reference.nodes()];
    let fastest = second_order(reference, its_limits, settings, rest, &share, &mut Vec::new())?.duration();
    let factor = (motion.duration() / fastest).max(1.0);
    Ok((motion, factor))
}

/// Halvings after which the time of a node on the ease is exact to rounding.
const EASE_BISECTIONS: usize = 60;

/// A straight line from rest to rest: rows of the path, and rows where the phases change.
fn straight(stretch: &Stretch, direction: &[f64], settings: &RetimeSettings) -> Motion {
    let (n, length) = (stretch.n, stretch.s[stretch.nodes() - 1]);
    let least = |limits: &[f64]| {
        limits.iter().zip(direction).map(|(limit, d)| limit / d.abs()).fold(f64::INFINITY, f64::min)
    };
    let jerk = settings.jerk_limits.as_deref().map_or(f64::INFINITY, least);
    let law = StraightLaw::new(
        length,
        least(&settings.velocity_limits),
        least(&settings.acceleration_limits),
        jerk,
    );
    let end = law.switches()[law.switches().len() - 1];
    let mut times: Vec<(f64, Option<usize>)> = Vec::new();
    for k in 0..stretch.nodes() {
        // Nodes between sparse rows are not needed here: the phases are exact.
        if stretch.origin[k].row.is_some() {
            let t = match k {
                0 => 0.0,
                _ if k + 1 == stretch.nodes() => end,
                _ => law.when(stretch.s[k]),
            };
            times.push((t, Some(k)));
        }
    }
    for switch in law.switches() {
        if times.iter().all(|(t, _)| (t - switch).abs() > SAME_TIME * end) {
            times.push((*switch, None));
        }
    }
    times.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut motion = Motion::new(n, settings.jerk_limits.is_some());
    for (t, node) in times {
        let [s, speed, acceleration] = law.at(t);
        let (qd, qdd) = (direction.iter().map(|d| d * speed), direction.iter().map(|d| d * acceleration));
        let q: Vec<f64> = match node {
            Some(k) => stretch.q[k * n..(k + 1) * n].to_vec(),
            None => (0..n).map(|j| stretch.q[j] + s * direction[j]).collect(),
        };
        motion.push(
            t,
            &q,
            &qd.collect::<Vec<_>>(),
            &qdd.collect::<Vec<_>>(),
            node.map_or(Origin::BETWEEN, |k| stretch.origin[k]),
        );
    }
    motion.rest_at_ends();
    motion
}

/// Times closer than this share of the duration are one.
const SAME_TIME: f64 = 1e-9;
