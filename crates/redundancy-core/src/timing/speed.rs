//! How fast a tool can follow a path.
//!
//! # Problem
//! At constant tool speed `v` the joints move with `qd = v q'` and `qdd = v^2 q''` (primes by arc length), so without
//! friction `tau = G + v^2 D`, `G` the torque of gravity and `D = RNE(q, q', q'', g = 0)`. Each limit then is a bound on
//! `t = 1/v^2` alone: `t >= D / (L - G)`, `t >= -D / (L + G)` and `t >= (q' / qd_max)^2`. The largest constant speed is
//! `1 / sqrt(max t)`: exact, no search. [FromGravdahl2007, section 9] looked for it by simulation.
//!
//! When the speed may change along the path, `tau = M q' a + D x + G` with `x = ds/dt^2` and `a = x'/2`. The fastest motion
//! follows from two passes over the path [PhamPham2018]: backwards the largest `x` from which the end can still be reached,
//! forwards the largest acceleration that stays below it.
//!
//! `q'` and `q''` are those of the cubic spline through the joint positions (not-a-knot ends).
//!
//! Degenerate cases: a joint whose torque limit does not hold the arm alone is an error that names joint and point; a path
//! on which nothing moves has no speed.
//!
//! Cost: about 0.5 us per point and core for six joints when the joint positions are given.
//!
//! References: [FromGravdahl2007], [PhamPham2018].

use nalgebra::Vector3;

use crate::chain::{Body, Chain};
use crate::error::{Error, Result, check_finite, check_length, check_vector};
use crate::kinematics::DynamicsScratch;
use crate::parallel::prelude::*;
use crate::path::knot_derivatives;
use crate::pose::Pose;
use crate::solutions::closed_form;
use crate::solutions::lines::{self, LineEnd};
use crate::tolerance::TORQUE_LEFT;

/// Points that one task of the pool takes at least.
const POINTS_PER_TASK: usize = 64;

/// What bounds the speed.
#[derive(Debug, Clone, PartialEq)]
pub struct SpeedSettings {
    /// Largest torques, N m, one per joint; `None` is off, infinite entries are none.
    pub torque_limits: Option<Vec<f64>>,
    /// Largest joint speeds, rad/s, one per joint; `None` is off.
    pub velocity_limits: Option<Vec<f64>>,
    /// m/s^2, world axes.
    pub gravity: Vector3<f64>,
    /// Whether the arm must keep its position limits where [`fastest_line`] chooses the branch.
    pub joint_limits: bool,
}

impl SpeedSettings {
    /// The torque limits of the chain, no velocity limits, gravity of 9.81 m/s^2 along -z.
    pub fn of(chain: &Chain) -> Self {
        Self {
            torque_limits: Some(chain.joints().iter().map(|j| j.limits.effort).collect()),
            velocity_limits: None,
            gravity: Vector3::new(0.0, 0.0, -9.81),
            joint_limits: true,
        }
    }

    /// Checks the settings against a chain of `n` joints.
    ///
    /// # Errors
    /// Wrong lengths, limits that are not positive, no limit at all.
    pub fn validate(&self, n: usize) -> Result<()> {
        check_finite("gravity", self.gravity.as_slice())?;
        let mut any = false;
        for (what, limits) in
            [("torque limit", &self.torque_limits), ("velocity limit", &self.velocity_limits)]
        {
            let Some(limits) = limits else { continue };
            check_length(&format!("{what}s"), limits, n)?;
            if let Some(j) = limits.iter().position(|v| v.is_nan() || *v <= 0.0) {
                let what = format!("{what} of joint {j}");
                return Err(Error::OutOfRange { what, value: limits[j], bound: "> 0 (inf for none)".into() });
            }
            any |= limits.iter().any(|v| v.is_finite());
        }
        if any {
            return Ok(());
        }
        Err(Error::Invalid("no torque or velocity limit is given: nothing bounds the speed".into()))
    }

    /// Torque limits need inertias.
    pub(crate) fn check_masses(&self, chain: &Chain) -> Result<()> {
        match &self.torque_limits {
            Some(limits) if limits.iter().any(|l| l.is_finite()) => chain.masses().map(|_| ()),
            _ => Ok(()),
        }
    }
}

/// What stops a faster motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SpeedLimit {
    /// The torque of a joint.
    Torque,
    /// The speed of a joint.
    Velocity,
}

impl SpeedLimit {
    /// The limit as a word in lower case.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Torque => "torque",
            Self::Velocity => "velocity",
        }
    }
}

/// The largest constant tool speed over a path.
#[derive(Debug, Clone, PartialEq)]
pub struct MaxSpeed {
    /// m/s.
    pub speed: f64,
    /// The joint that allows no more.
    pub limiting_joint: usize,
    /// Its torque or its speed.
    pub limit: SpeedLimit,
    /// The path point where that happens.
    pub at: usize,
    /// Joint positions, one row per path point, rad.
    pub q: Vec<f64>,
    /// Joint torques at that speed, one row per path point, N m; zeros for a chain without inertias.
    pub torques: Vec<f64>,
    /// Largest constant speed that each point would allow on its own, m/s; infinite where nothing moves.
    pub point_speeds: Vec<f64>,
}

/// A motion over a path whose speed may change.
#[derive(Debug, Clone, PartialEq)]
pub struct SpeedProfile {
    /// Arc length of each point, m.
    pub s: Vec<f64>,
    /// Tool speed at each point, m/s.
    pub speed: Vec<f64>,
    /// Acceleration along the path from each point to the next, m/s^2 (the last one repeated).
    pub acceleration: Vec<f64>,
    /// Time at each point, s.
    pub t: Vec<f64>,
}

/// `q`, `q'`, `G`, `D` of all points, row by row, and `M q'` where it is asked for.
struct Terms {
    n: usize,
    s: Vec<f64>,
    q: Vec<f64>,
    d: Vec<f64>,
    weights: Vec<f64>,
    dynamic: Vec<f64>,
    inertial: Vec<f64>,
}

/// The largest constant tool speed for given joint positions, one row per path point.
///
/// ```
/// use redundancy_core::chain::catalog;
/// use redundancy_core::timing::{SpeedSettings, max_speed};
/// let arm = catalog::load("puma560")?;
/// // Joint 1 alone swings: its torque is all inertia.
/// let q: Vec<f64> = (0..100).flat_map(|k| [(0.06 * f64::from(k)).sin(), 0.5, -3.0, 0.0, -1.0, 0.0]).collect();
/// let s: Vec<f64> = (0..100).map(|k| 0.01 * f64::from(k)).collect();
/// let fastest = max_speed(&arm, &s, &q, &SpeedSettings::of(&arm))?;
/// assert!(fastest.limiting_joint == 0 && fastest.speed > 0.1);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
///
/// # Errors
/// Invalid settings, lengths that do not fit, `s` that decreases, torque limits without inertias, a torque limit below what
/// gravity asks for (joint and point are named), nothing that moves.
pub fn max_speed(chain: &Chain, s: &[f64], q: &[f64], settings: &SpeedSettings) -> Result<MaxSpeed> {
    settings.validate(chain.dof())?;
    let terms = Terms::new(chain, s, q, settings, false)?;
    terms.constant(chain, settings)
}

/// The largest constant tool speed with inverse kinematics: over all poses, from `start` or, without it, on the fastest
/// branch that holds the path.
///
/// # Errors
/// As [`max_speed`]; a pose that cannot be reached or followed: the message names the points.
pub fn fastest_line(
    chain: &Chain,
    s: &[f64],
    poses: &[Pose],
    start: Option<&[f64]>,
    settings: &SpeedSettings,
) -> Result<MaxSpeed> {
    settings.validate(chain.dof())?;
    settings.check_masses(chain)?;
    check_length("s", s, poses.len())?;
    let first = poses.first().ok_or_else(|| Error::Invalid("the path has no point".into()))?;
    let form = closed_form(chain);
    let form = form.as_deref();
    if let Some(start) = start {
        check_vector("q0", start, chain.dof())?;
        let line = match form.and_then(|form| lines::branch_from(form, poses, start)) {
            Some(line) => line,
            None => {
                lines::follow(chain, poses, start).map_err(|(k, why)| cannot_follow(chain, poses, k, why))?
            }
        };
        return Terms::new(chain, s, &line, settings, false)?.constant(chain, settings);
    }
    let finish = |mut line: Vec<f64>| -> std::result::Result<MaxSpeed, Failure> {
        if settings.joint_limits {
            lines::wind(chain, &mut line).map_err(|(j, k)| Failure::Limits(j, k))?;
        }
        Terms::new(chain, s, &line, settings, false)
            .and_then(|terms| terms.constant(chain, settings))
            .map_err(Failure::Speed)
    };
    let branches = form.and_then(|form| lines::all_branches(form, poses));
    let tried: Vec<std::result::Result<MaxSpeed, Failure>> = match branches {
        Some(lines) => lines.into_par_iter().map(finish).collect(),
        None => {
            let candidates = lines::starts(chain, form, first);
            if candidates.is_empty() {
                return Err(cannot_follow(chain, poses, 0, LineEnd::Lost));
            }
            let follow = |start: &Vec<f64>| {
                lines::follow(chain, poses, start).map_err(|(k, why)| Failure::Line(k, why)).and_then(finish)
            };
            candidates.par_iter().map(follow).collect()
        }
    };
    let mut best: Option<MaxSpeed> = None;
    let mut reason: Option<Failure> = None;
    for outcome in tried {
        match outcome {
            Ok(found) => {
                if best.as_ref().is_none_or(|b| found.speed > b.speed) {
                    best = Some(found);
                }
            }
            // What comes nearest to success is what the caller can act on.
            Err(failure) => {
                if reason.as_ref().is_none_or(|r| failure.rank() > r.rank()) {
                    reason = Some(failure);
                }
            }
        }
    }
    best.ok_or_else(|| match reason {
        Some(Failure::Speed(error)) => error,
        Some(Failure::Limits(j, k)) => Error::CannotFollow(format!(
            "no branch holds the joint limits along the path; the best one leaves those of joint '{}' at point {k}",
            chain.joints()[j].name
        )),
        Some(Failure::Line(k, why)) => cannot_follow(chain, poses, k, why),
        None => cannot_follow(chain, poses, 0, LineEnd::Lost),
    })
}

enum Failure {
    Line(usize, LineEnd),
    Limits(usize, usize),
    Speed(Error),
}

impl Failure {
    fn rank(&self) -> (usize, usize) {
        match self {
            Self::Line(k, _) => (0, *k),
            Self::Limits(_, k) => (1, *k),
            Self::Speed(_) => (2, 0),
        }
    }
}

/// The message that names the points without a configuration.
pub(crate) fn cannot_follow(chain: &Chain, poses: &[Pose], k: usize, why: LineEnd) -> Error {
    let total = poses.len();
    if why == LineEnd::Jump {
        return Error::CannotFollow(format!("the arm would have to jump before point {k} of {total}"));
    }
    let far = lines::unreachable(chain, closed_form(chain).as_deref(), poses);
    if let (Some(first), Some(last)) = (far.first(), far.last()) {
        let count = far.len();
        let which = if last - first + 1 == count { format!("{first} to {last}") } else { list(&far) };
        return Error::CannotFollow(format!(
            "{count} of {total} points are out of the workspace, indices {which}"
        ));
    }
    let p = poses[k].translation.vector;
    Error::CannotFollow(format!(
        "the arm cannot follow the path: point {k} of {total} at ({:.4}, {:.4}, {:.4}) is not reached on this branch",
        p.x, p.y, p.z
    ))
}

/// The first few of a list.
fn list(indices: &[usize]) -> String {
    let shown: Vec<String> = indices.iter().take(LISTED).map(ToString::to_string).collect();
    let more = if indices.len() > LISTED { ", ..." } else { "" };
    format!("{}{more}", shown.join(", "))
}

/// Indices that a message lists.
const LISTED: usize = 10;

/// The fastest motion over given joint positions when the tool speed may change, from `start_speed` to `end_speed` (m/s).
///
/// # Errors
/// As [`max_speed`]; speeds that are negative or cannot be held: the message names the point.
pub fn fastest_profile(
    chain: &Chain,
    s: &[f64],
    q: &[f64],
    settings: &SpeedSettings,
    start_speed: f64,
    end_speed: f64,
) -> Result<SpeedProfile> {
    settings.validate(chain.dof())?;
    for (what, value) in [("start_speed", start_speed), ("end_speed", end_speed)] {
        if !(value >= 0.0 && value.is_finite()) {
            return Err(Error::OutOfRange { what: what.into(), value, bound: "finite and >= 0".into() });
        }
    }
    if let Some(k) = (1..s.len()).find(|k| s[*k] <= s[k - 1]) {
        return Err(Error::Invalid(format!("the path stops at point {k}: a profile needs s that increases")));
    }
    let terms = Terms::new(chain, s, q, settings, true)?;
    terms.check_gravity(chain, settings)?;
    terms.profile(settings, start_speed, end_speed)
}

impl Terms {
    fn new(chain: &Chain, s: &[f64], q: &[f64], settings: &SpeedSettings, accelerated: bool) -> Result<Self> {
        let (n, rows) = (chain.dof(), s.len());
        check_finite("s", s)?;
        check_vector("q", q, n * rows)?;
        if rows < 2 {
            return Err(Error::Length {
                what: "path (at least two points)".into(),
                expected: 2,
                actual: rows,
            });
        }
        if let Some(k) = (1..rows).find(|k| s[*k] < s[k - 1]) {
            return Err(Error::Invalid(format!("s[{k}] is {} after {}, it must increase", s[k], s[k - 1])));
        }
        if s[rows - 1] <= s[0] {
            return Err(Error::Invalid("the path has no length".into()));
        }
        let (d, dd) = knot_derivatives(s, q, n);
        let (mut weights, mut dynamic) = (vec![0.0; n * rows], vec![0.0; n * rows]);
        let mut inertial = vec![0.0; if accelerated { n * rows } else { 0 }];
        settings.check_masses(chain)?;
        let bodies: Option<&[Body]> = chain.masses().ok();
        if let Some(bodies) = bodies {
            let rows = q.par_chunks_exact(n).zip(d.par_chunks_exact(n)).zip(dd.par_chunks_exact(n));
            let out = weights.par_chunks_exact_mut(n).zip(dynamic.par_chunks_exact_mut(n));
            rows.zip(out).with_min_len(POINTS_PER_TASK).for_each_init(
                || DynamicsScratch::new(chain),
                |scratch, (((q, d), dd), (weights, dynamic))| {
                    chain.split_torques(bodies, [q, d, dd], &settings.gravity, scratch, weights, dynamic);
                },
            );
            if accelerated {
                let (mut scratch, zero, mut none) = (DynamicsScratch::new(chain), vec![0.0; n], vec![0.0; n]);
                for ((q, d), out) in
                    q.chunks_exact(n).zip(d.chunks_exact(n)).zip(inertial.chunks_exact_mut(n))
                {
                    chain.split_torques(
                        bodies,
                        [q, &zero, d],
                        &Vector3::zeros(),
                        &mut scratch,
                        &mut none,
                        out,
                    );
                }
            }
        }
        Ok(Self { n, s: s.to_vec(), q: q.to_vec(), d, weights, dynamic, inertial })
    }

    /// Gravity alone must leave torque at every joint.
    fn check_gravity(&self, chain: &Chain, settings: &SpeedSettings) -> Result<()> {
        let Some(limits) = &settings.torque_limits else { return Ok(()) };
        let mut worst: Option<(f64, usize)> = None;
        for (i, weight) in self.weights.iter().enumerate() {
            let use_ = weight.abs() / limits[i % self.n];
            if use_ >= 1.0 - TORQUE_LEFT && worst.is_none_or(|(most, _)| use_ > most) {
                worst = Some((use_, i));
            }
        }
        let Some((_, i)) = worst else { return Ok(()) };
        let (k, j) = (i / self.n, i % self.n);
        Err(Error::CannotFollow(format!(
            "joint '{}' needs {:.4} N m at point {k} to hold the arm alone, its torque limit is {}",
            chain.joints()[j].name,
            self.weights[i].abs(),
            limits[j]
        )))
    }

    fn constant(self, chain: &Chain, settings: &SpeedSettings) -> Result<MaxSpeed> {
        self.check_gravity(chain, settings)?;
        let n = self.n;
        let mut best = (0.0, 0, SpeedLimit::Torque, 0);
        let mut point_speeds = Vec::with_capacity(self.s.len());
        for k in 0..self.s.len() {
            let mut most: f64 = 0.0;
            for j in 0..n {
                let i = k * n + j;
                if let Some(limits) = &settings.torque_limits {
                    let (d, g, limit) = (self.dynamic[i], self.weights[i], limits[j]);
                    let bound = if d > 0.0 { d / (limit - g) } else { -d / (limit + g) };
                    most = most.max(bound);
                    if bound > best.0 {
                        best = (bound, j, SpeedLimit::Torque, k);
                    }
                }
                if let Some(limits) = &settings.velocity_limits {
                    let bound = (self.d[i] / limits[j]).powi(2);
                    most = most.max(bound);
                    if bound > best.0 {
                        best = (bound, j, SpeedLimit::Velocity, k);
                    }
                }
            }
            point_speeds.push(1.0 / most.sqrt());
        }
        let (t, limiting_joint, limit, at) = best;
        let squared = 1.0 / t;
        if !squared.is_finite() {
            return Err(Error::Invalid(
                "no limit acts on this path: no joint with a limit is loaded or moves".into(),
            ));
        }
        let torques = self.weights.iter().zip(&self.dynamic).map(|(g, d)| g + squared * d).collect();
        Ok(MaxSpeed { speed: squared.sqrt(), limiting_joint, limit, at, q: self.q, torques, point_speeds })
    }

    /// Rows `a u + b x <= c` of point `k`, with u the acceleration and x the squared speed.
    fn rows(&self, k: usize, settings: &SpeedSettings, rows: &mut Vec<[f64; 3]>) {
        rows.clear();
        for j in 0..self.n {
            let i = k * self.n + j;
            if let Some(limits) = &settings.torque_limits
                && limits[j].is_finite()
            {
                let (m, d, g) = (self.inertial[i], self.dynamic[i], self.weights[i]);
                rows.push([m, d, limits[j] - g]);
                rows.push([-m, -d, limits[j] + g]);
            }
            if let Some(limits) = &settings.velocity_limits
                && limits[j].is_finite()
            {
                rows.push([0.0, self.d[i] * self.d[i], limits[j] * limits[j]]);
            }
        }
    }

    fn profile(&self, settings: &SpeedSettings, start_speed: f64, end_speed: f64) -> Result<SpeedProfile> {
        let last = self.s.len() - 1;
        let (start, end) = (start_speed * start_speed, end_speed * end_speed);
        let mut rows = Vec::new();
        // [low, high] of the squared speed at each point from which the end can be reached.
        let mut reach = vec![[0.0, 0.0]; last + 1];
        reach[last] = [end, end];
        let held = |k: usize, what: &str| {
            Error::Invalid(format!("{what} at point {k}: no speed there is within the limits"))
        };
        for k in (0..last).rev() {
            let gap = 2.0 * (self.s[k + 1] - self.s[k]);
            self.rows(k, settings, &mut rows);
            let [low, high] = reach[k + 1];
            rows.push([gap, 1.0, high]);
            rows.push([-gap, -1.0, -low]);
            let most = extreme_speed(&rows, true).ok_or_else(|| held(k, "the path cannot be passed"))?;
            let least = extreme_speed(&rows, false).ok_or_else(|| held(k, "the path cannot be passed"))?;
            reach[k] = [least, most];
        }
        // The end's own rows, at rest or at its speed.
        let [low, high] = reach[0];
        if start < low - PROFILE_SLACK * (1.0 + low) || start > high + PROFILE_SLACK * (1.0 + high) {
            return Err(Error::OutOfRange {
                what: "start_speed".into(),
                value: start_speed,
                bound: format!(
                    "between {} and {} m/s on this path",
                    low.max(0.0).sqrt(),
                    high.max(0.0).sqrt()
                ),
            });
        }
        let mut x = vec![start.clamp(low, high); last + 1];
        let mut acceleration = vec![0.0; last + 1];
        for k in 0..last {
            let gap = 2.0 * (self.s[k + 1] - self.s[k]);
            self.rows(k, settings, &mut rows);
            let [low, high] = reach[k + 1];
            rows.push([gap, 1.0, high]);
            rows.push([-gap, -1.0, -low]);
            let u = rows
                .iter()
                .filter(|r| r[0] > 0.0)
                .map(|[a, b, c]| (c - b * x[k]) / a)
                .fold(f64::INFINITY, f64::min);
            acceleration[k] = u;
            x[k + 1] = (x[k] + gap * u).clamp(low.max(0.0), high.max(0.0));
        }
        acceleration[last] = acceleration[last - 1];
        let speed: Vec<f64> = x.iter().map(|x| x.max(0.0).sqrt()).collect();
        let mut t = vec![0.0; last + 1];
        for k in 0..last {
            let mean = 0.5 * (speed[k] + speed[k + 1]);
            if mean <= 0.0 {
                return Err(held(k, "the arm would stand still"));
            }
            t[k + 1] = t[k] + (self.s[k + 1] - self.s[k]) / mean;
        }
        Ok(SpeedProfile { s: self.s.clone(), speed, acceleration, t })
    }
}

/// Relative excess of a squared speed over its bound that rounding explains.
const PROFILE_SLACK: f64 = 1e-9;
/// Halvings of the search for the largest squared speed; each bound is linear, so the gap of the accelerations is concave
/// and the steps of the search below end exactly on a vertex.
const VERTEX_STEPS: usize = 64;

/// Largest (or least) `x >= 0` for which some `u` holds all rows `a u + b x <= c`.
///
/// For fixed x the rows leave `u` an interval `[lo(x), hi(x)]`; `hi - lo` is concave and piecewise linear. Newton's method
/// on it goes from vertex to vertex: from outside it never steps over the end of the feasible part.
pub(super) fn extreme_speed(rows: &[[f64; 3]], most: bool) -> Option<f64> {
    // Bounds without u.
    let (mut low, mut high) = (0.0_f64, f64::INFINITY);
    for [a, b, c] in rows {
        if *a == 0.0 {
            if *b > 0.0 {
                high = high.min(c / b);
            } else if *b < 0.0 {
                low = low.max(c / b);
            } else if *c < 0.0 {
                return None;
            }
        }
    }
    // Slope and offset of the tightest upper and lower bound of u at x: gap(x) = offset + slope x.
    let line_at = |x: f64| {
        let (mut hi, mut lo) = ((f64::INFINITY, 0.0, 0.0), (f64::NEG_INFINITY, 0.0, 0.0));
        for [a, b, c] in rows {
            if *a != 0.0 {
                let (offset, slope) = (c / a, -b / a);
                let value = offset + slope * x;
                if *a > 0.0 && value < hi.0 {
                    hi = (value, offset, slope);
                } else if *a < 0.0 && value > lo.0 {
                    lo = (value, offset, slope);
                }
            }
        }
        (hi.0 - lo.0, hi.1 - lo.1, hi.2 - lo.2)
    };
    let cap = if high.is_finite() { high } else { SPEED_CAP };
    if low > cap {
        return None;
    }
    let mut x = if most { cap } else { low };
    for _ in 0..VERTEX_STEPS {
        let (gap, offset, slope) = line_at(x);
        if gap >= -PROFILE_SLACK * (1.0 + offset.abs()) {
            return Some(x);
        }
        // The tangent lies above the concave gap: its zero is on the way to the feasible part.
        let next = -offset / slope;
        let inwards = if most { next < x && next >= low } else { next > x && next <= cap };
        if !(next.is_finite() && inwards) {
            return None;
        }
        x = next;
    }
    None
}

/// Squared speed (m/s)^2 that counts as no limit: no arm comes near 1 km/s.
const SPEED_CAP: f64 = 1e6;
