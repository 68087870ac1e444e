//! A motion as it is returned, and how near it comes to its limits between its rows.

use super::settings::RetimeSettings;
use super::stretch::{NodeLimits, Stretch};
use crate::chain::Chain;
use crate::error::{Error, Result};
use crate::kinematics::{DynamicsScratch, Scratch};
use crate::tolerance::{RETIME_DWELL, TORQUE_LEFT};

/// Places of an interval at which the limits are checked, ends included.
const PLACES: usize = 20;

/// Places of a whole stretch at which they are checked, at least.
const PLACES_IN_ALL: usize = 2_000;

/// What kind of limit binds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum LimitKind {
    /// Speed of a joint.
    Velocity,
    /// Acceleration of a joint.
    Acceleration,
    /// Jerk of a joint.
    Jerk,
    /// Torque of a joint.
    Torque,
    /// Speed of the tool.
    ToolSpeed,
}

impl LimitKind {
    /// The kind as a word in lower snake case.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Velocity => "velocity",
            Self::Acceleration => "acceleration",
            Self::Jerk => "jerk",
            Self::Torque => "torque",
            Self::ToolSpeed => "tool_speed",
        }
    }
}

/// The limit that a row comes nearest to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limiting {
    /// Of which kind.
    pub kind: LimitKind,
    /// The joint, from 0; `None` for the tool.
    pub joint: Option<usize>,
    /// The value as a share of its limit.
    pub share: f64,
}

/// Rows with times.
#[derive(Debug, Clone)]
pub(super) struct Motion {
    n: usize,
    /// Accelerations are continuous: the interpolation is of fifth degree, else of third.
    smooth: bool,
    pub t: Vec<f64>,
    pub q: Vec<f64>,
    pub qd: Vec<f64>,
    pub qdd: Vec<f64>,
    row: Vec<Option<usize>>,
}

impl NodeLimits {
    /// Gravity alone must leave torque at every joint.
    pub(super) fn check_gravity(
        &self,
        chain: &Chain,
        stretch: &Stretch,
        settings: &RetimeSettings,
    ) -> Result<()> {
        let Some(limits) = &settings.torque_limits else { return Ok(()) };
        for (i, gravity) in self.gravity.iter().enumerate() {
            let (k, j) = (i / stretch.n, i % stretch.n);
            if gravity.abs() >= limits[j] * (1.0 - TORQUE_LEFT) {
                return Err(Error::CannotFollow(format!(
                    "joint '{}' needs {:.4} N m at node {k} to hold the arm at rest, its torque limit is {}",
                    chain.joints()[j].name,
                    gravity.abs(),
                    limits[j]
                )));
            }
        }
        Ok(())
    }
}

/// Value and derivatives of one joint at a place of an interval.
type Local = [f64; 4];

impl Motion {
    pub fn new(n: usize, smooth: bool) -> Self {
        Self { n, smooth, t: Vec::new(), q: Vec::new(), qd: Vec::new(), qdd: Vec::new(), row: Vec::new() }
    }

    pub fn push(&mut self, t: f64, q: &[f64], qd: &[f64], qdd: &[f64], row: Option<usize>) {
        self.t.push(t);
        self.q.extend_from_slice(q);
        self.qd.extend_from_slice(qd);
        self.qdd.extend_from_slice(qdd);
        self.row.push(row);
    }

    pub fn duration(&self) -> f64 {
        self.t.last().copied().unwrap_or(0.0)
    }

    /// Exactly at rest at both ends.
    pub fn rest_at_ends(&mut self) {
        let (n, rows) = (self.n, self.t.len());
        for values in [&mut self.qd, &mut self.qdd] {
            values[..n].fill(0.0);
            values[(rows - 1) * n..].fill(0.0);
        }
    }

    /// The same motion, slower by `factor`.
    pub fn slow_down(&mut self, factor: f64) {
        self.t.iter_mut().for_each(|t| *t *= factor);
        self.qd.iter_mut().for_each(|v| *v /= factor);
        self.qdd.iter_mut().for_each(|a| *a /= factor * factor);
    }

    /// Adds a stretch that begins where this one ends.
    pub fn append(&mut self, part: Self, path_rows: &mut Vec<usize>) {
        let n = self.n;
        let start = self.duration();
        for k in 0..part.t.len() {
            let at = k * n..(k + 1) * n;
            if k == 0 && !self.t.is_empty() {
                // The row is there already; without jerk limits its acceleration is the one after it.
                let from = self.qdd.len() - n;
                self.qdd[from..].copy_from_slice(&part.qdd[at]);
                continue;
            }
            if let Some(row) = part.row[k] {
                debug_assert_eq!(row, path_rows.len());
                path_rows.push(self.t.len());
            }
            self.push(
                start + part.t[k],
                &part.q[at.clone()],
                &part.qd[at.clone()],
                &part.qdd[at],
                part.row[k],
            );
        }
    }

    /// Two equal rows: the arm waits for the shortest time.
    pub fn dwell(&mut self, from: &[f64], to: &[f64], path_rows: &mut Vec<usize>) {
        let zero = vec![0.0; self.n];
        if self.t.is_empty() {
            path_rows.push(0);
            self.push(0.0, from, &zero, &zero, Some(0));
        }
        let t = self.duration() + RETIME_DWELL;
        let row = path_rows.len();
        path_rows.push(self.t.len());
        self.push(t, to, &zero, &zero, Some(row));
    }

    /// Position and derivatives of all joints at `u` in [0, 1] of interval `k`.
    fn local(&self, k: usize, u: f64, out: &mut [Local]) {
        let (n, h) = (self.n, self.t[k + 1] - self.t[k]);
        for (j, out) in out.iter_mut().enumerate() {
            let (a, b) = (k * n + j, (k + 1) * n + j);
            let (rise, va, vb) = (self.q[b] - self.q[a], self.qd[a] * h, self.qd[b] * h);
            *out = if self.smooth {
                let (aa, ab) = (self.qdd[a] * h * h, self.qdd[b] * h * h);
                let (c2, e) = (0.5 * aa, rise - va - 0.5 * aa);
                let (f, g) = (vb - va - aa, ab - aa);
                let (c3, c4, c5) =
                    (10.0 * e - 4.0 * f + 0.5 * g, -15.0 * e + 7.0 * f - g, 6.0 * e - 3.0 * f + 0.5 * g);
                [
                    self.q[a] + u * (va + u * (c2 + u * (c3 + u * (c4 + u * c5)))),
                    (va + u * (2.0 * c2 + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5)))) / h,
                    (2.0 * c2 + u * (6.0 * c3 + u * (12.0 * c4 + u * 20.0 * c5))) / (h * h),
                    (6.0 * c3 + u * (24.0 * c4 + u * 60.0 * c5)) / (h * h * h),
                ]
            } else {
                let (c2, c3) = (3.0 * rise - 2.0 * va - vb, va + vb - 2.0 * rise);
                [
                    self.q[a] + u * (va + u * (c2 + u * c3)),
                    (va + u * (2.0 * c2 + u * 3.0 * c3)) / h,
                    (2.0 * c2 + u * 6.0 * c3) / (h * h),
                    6.0 * c3 / (h * h * h),
                ]
            };
        }
    }

    /// Per interval: the factor by which it is too fast, below 1 where it is not.
    pub fn excess(&self, chain: &Chain, settings: &RetimeSettings) -> Result<Vec<f64>> {
        let mut gauge = Gauge::new(chain, settings)?;
        let mut local = vec![[0.0; 4]; self.n];
        let intervals = self.t.len().saturating_sub(1);
        // A quintic over a long interval bends between places that are far apart.
        let places = PLACES.max(PLACES_IN_ALL / intervals.max(1));
        let mut out = Vec::with_capacity(intervals);
        for k in 0..intervals {
            let mut worst = 0.0_f64;
            for place in 0..=places {
                self.local(k, place as f64 / places as f64, &mut local);
                worst = worst.max(gauge.time_factor(&local));
            }
            out.push(worst);
        }
        Ok(out)
    }

    /// The limit that each row comes nearest to.
    pub fn limiting(&self, chain: &Chain, settings: &RetimeSettings) -> Result<Vec<Option<Limiting>>> {
        let mut gauge = Gauge::new(chain, settings)?;
        let mut local = vec![[0.0; 4]; self.n];
        let last = self.t.len() - 1;
        Ok((0..=last)
            .map(|k| {
                if last == 0 {
                    return None;
                }
                let (interval, u) = if k < last { (k, 0.0) } else { (last - 1, 1.0) };
                self.local(interval, u, &mut local);
                gauge.nearest(&local)
            })
            .collect())
    }

    /// Rows every `dt` and the last one; the path's own rows are the nearest ones.
    pub fn resampled(&self, dt: f64, path_rows: &mut [usize]) -> Self {
        let mut out = Self::new(self.n, self.smooth);
        let end = self.duration();
        let steps = (end / dt - 1e-9).ceil().max(1.0) as usize;
        let (mut local, mut k) = (vec![[0.0; 4]; self.n], 0);
        for step in 0..=steps {
            let t = if step == steps { end } else { step as f64 * dt };
            while k + 2 < self.t.len() && self.t[k + 1] <= t {
                k += 1;
            }
            let u = ((t - self.t[k]) / (self.t[k + 1] - self.t[k])).clamp(0.0, 1.0);
            self.local(k, u, &mut local);
            let column = |c: usize| local.iter().map(|l| l[c]).collect::<Vec<f64>>();
            out.push(t, &column(0), &column(1), &column(2), None);
        }
        for row in path_rows.iter_mut() {
            *row = ((self.t[*row] / dt).round() as usize).min(steps);
        }
        out
    }
}

/// How near a state comes to the limits.
struct Gauge<'a> {
    chain: &'a Chain,
    settings: &'a RetimeSettings,
    scratch: Scratch,
    dynamics: DynamicsScratch,
    rows: [Vec<f64>; 3],
    gravity: Vec<f64>,
    moving: Vec<f64>,
}

impl<'a> Gauge<'a> {
    fn new(chain: &'a Chain, settings: &'a RetimeSettings) -> Result<Self> {
        let n = chain.dof();
        if settings.torque_limits.is_some() {
            chain.masses()?;
        }
        Ok(Self {
            chain,
            settings,
            scratch: Scratch::new(chain),
            dynamics: DynamicsScratch::new(chain),
            rows: std::array::from_fn(|_| vec![0.0; n]),
            gravity: vec![0.0; n],
            moving: vec![0.0; n],
        })
    }

    /// Calls `visit` with kind, joint, value over limit, and the power of time with which it shrinks.
    fn each(&mut self, local: &[Local], mut visit: impl FnMut(LimitKind, Option<usize>, f64, f64)) {
        let settings = self.settings;
        for (j, [_, qd, qdd, qddd]) in local.iter().enumerate() {
            visit(LimitKind::Velocity, Some(j), qd.abs() / settings.velocity_limits[j], 1.0);
            visit(LimitKind::Acceleration, Some(j), qdd.abs() / settings.acceleration_limits[j], 2.0);
            if let Some(jerk) = &settings.jerk_limits {
                visit(LimitKind::Jerk, Some(j), qddd.abs() / jerk[j], 3.0);
            }
        }
        if settings.tool_speed.is_none() && settings.torque_limits.is_none() {
            return;
        }
        for (order, row) in self.rows.iter_mut().enumerate() {
            row.iter_mut().zip(local).for_each(|(v, l)| *v = l[order]);
        }
        let [q, qd, qdd] = &self.rows;
        if let Some(speed) = settings.tool_speed {
            let kinematics = self.chain.kinematics_unchecked(q, &mut self.scratch);
            let columns = kinematics.jacobian();
            let moved: nalgebra::Vector3<f64> =
                qd.iter().enumerate().map(|(j, v)| columns.fixed_view::<3, 1>(0, j) * *v).sum();
            visit(LimitKind::ToolSpeed, None, moved.norm() / speed, 1.0);
        }
        if let (Some(limits), Ok(bodies)) = (&settings.torque_limits, self.chain.masses()) {
            let (gravity, moving) = (&mut self.gravity, &mut self.moving);
            self.chain.split_torques(
                bodies,
                [q, qd, qdd],
                &settings.gravity,
                &mut self.dynamics,
                gravity,
                moving,
            );
            for (j, limit) in limits.iter().enumerate() {
                let room = if moving[j] > 0.0 { limit - gravity[j] } else { limit + gravity[j] };
                visit(LimitKind::Torque, Some(j), moving[j].abs() / room, 2.0);
            }
        }
    }

    /// The factor on time that brings the state within all limits.
    fn time_factor(&mut self, local: &[Local]) -> f64 {
        let mut worst = 0.0_f64;
        self.each(local, |_, _, share, power| worst = worst.max(share.powf(1.0 / power)));
        worst
    }

    fn nearest(&mut self, local: &[Local]) -> Option<Limiting> {
        let mut best: Option<Limiting> = None;
        self.each(local, |kind, joint, share, _| {
            if share > best.map_or(0.0, |b| b.share) {
                best = Some(Limiting { kind, joint, share });
            }
        });
        best
    }
}
