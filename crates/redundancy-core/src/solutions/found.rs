//! Solutions of arms without a closed form: what Newton's method and continuation find from seeded random starts.
//!
//! Curves ([`TracedCurves`]) where the task leaves one freedom, points ([`FoundPoints`]) where it leaves none. What is found
//! is exact; that nothing else exists is not proven, except where the pose is farther away than the arm is long.

use std::f64::consts::PI;
use std::sync::OnceLock;

use super::continuation::{TraceSettings, random_configurations, traced_curves};
use super::curve::SelfMotionCurve;
use super::lines::reach;
use super::search;
use super::solutions::{Solution, Solutions, check_margin, check_piece};
use super::widest;
use crate::chain::Chain;
use crate::criterion::Criterion;
use crate::error::{Error, Result, check_finite, check_length};
use crate::joint_space::{TURN, outside, wrap};
use crate::kinematics::{Corrector, Task, TaskKind};
use crate::pose::Pose;
use crate::status::Status;
use crate::tolerance::SAME_LINE;

/// Halvings of the step in which a curve is searched for the least violation of a limit, for the message.
const REASON_ROUNDS: usize = 40;

/// What a search was told and whether the pose can be too far away.
#[derive(Debug, Clone)]
struct Origin {
    chain: Chain,
    starts: usize,
    /// Distance (m) beyond what the arm reaches stretched out; only then positive.
    beyond: f64,
}

impl Origin {
    fn new(chain: &Chain, task: &Task, target: &Pose, starts: usize) -> Self {
        let places = !matches!(task.kind(), TaskKind::Planar | TaskKind::PlanarPose);
        let base = chain.base() * chain.joints().first().map_or_else(Pose::identity, |joint| joint.placement);
        let distance = (target.translation.vector - base.translation.vector).norm();
        let beyond = if places { (distance - reach(chain)).max(0.0) } else { 0.0 };
        Self { chain: chain.clone(), starts, beyond }
    }

    /// The verdict on pieces that were found, of which `feasible` says whether one holds the limits.
    fn status(&self, pieces: usize, feasible: impl FnOnce() -> bool) -> Status {
        if pieces == 0 {
            Status::Unreachable
        } else if feasible() {
            Status::Converged
        } else {
            Status::Limits
        }
    }

    fn reason(&self, status: Status, what: &str, least: impl FnOnce() -> Option<(f64, usize)>) -> String {
        let starts = self.starts;
        match status {
            Status::Unreachable if self.beyond > 0.0 => {
                format!("the pose is {:.6} mm farther away than the arm is long", 1e3 * self.beyond)
            }
            Status::Unreachable => format!("none of {starts} starts of Newton's method reached the pose"),
            Status::Limits => {
                let least = least().map_or_else(String::new, |(miss, joint)| {
                    let joint = &self.chain.joints()[joint];
                    let (lower, upper) = (joint.limits.lower, joint.limits.upper);
                    let unit = if joint.kind.is_rotational() { "rad" } else { "m" };
                    let name = &joint.name;
                    format!("; even the best leaves joint '{name}' {miss:.6} {unit} outside [{lower:.6}, {upper:.6}]")
                });
                format!("no {what} found from {starts} starts is within all joint limits{least}")
            }
            _ => format!("each {what} was found from one of {starts} starts: there may be others"),
        }
    }
}

/// Curves of configurations over one task value, traced from seeded random starts.
#[derive(Debug, Clone)]
pub struct TracedCurves {
    origin: Origin,
    curves: Vec<SelfMotionCurve>,
    /// Feasible arcs without margin, in lengths of the curves, computed on first use.
    arcs: OnceLock<Vec<Vec<[f64; 2]>>>,
}

impl TracedCurves {
    pub(super) fn new(
        chain: &Chain,
        task: Task,
        target: &Pose,
        trace: &TraceSettings,
        seed: u64,
        starts: usize,
    ) -> Result<Self> {
        let origin = Origin::new(chain, &task, target, starts);
        let mut curves = Vec::new();
        if origin.beyond == 0.0 {
            curves = traced_curves(Corrector::new(chain, task, target)?, trace, seed, starts);
            curves.retain(|curve| curve.length() > 0.0);
        }
        Ok(Self { origin, curves, arcs: OnceLock::new() })
    }

    /// The curves.
    pub fn curves(&self) -> &[SelfMotionCurve] {
        &self.curves
    }

    fn curve(&self, piece: usize) -> Result<&SelfMotionCurve> {
        check_piece(piece, self.curves.len())?;
        Ok(&self.curves[piece])
    }

    /// Length of the curve per unit of u, and the length at u.
    fn length_at(&self, piece: usize, u: f64) -> Result<(f64, f64)> {
        let curve = self.curve(piece)?;
        check_finite("u", &[u])?;
        if curve.closed() {
            let rate = curve.length() / TURN;
            let s = (wrap(u) + PI) * rate;
            return Ok((rate, s.min(curve.length())));
        }
        let length = curve.length();
        if !(0.0..=length).contains(&u) {
            let bound = format!("on the open piece, from 0 to {length}");
            return Err(Error::OutOfRange { what: "u".into(), value: u, bound });
        }
        Ok((1.0, u))
    }

    fn arcs(&self) -> &[Vec<[f64; 2]>] {
        self.arcs.get_or_init(|| {
            self.curves.iter().map(|curve| curve.intervals(0.0).unwrap_or_default()).collect()
        })
    }

    /// The least violation of the worst joint along all curves: how much, and which joint.
    fn least_violation(&self) -> Option<(f64, usize)> {
        let n = self.origin.chain.dof();
        let worst = |curve: &SelfMotionCurve, q: &[f64]| -> (f64, usize) {
            let misses = (0..n).map(|i| (-curve.margin(i, q[i]), i));
            misses.fold((f64::NEG_INFINITY, 0), |a, b| if b.0 > a.0 { b } else { a })
        };
        let rows = self.curves.iter().flat_map(|curve| {
            (0..curve.rows()).map(move |k| (worst(curve, curve.q_row(k)), curve, curve.s()[k]))
        });
        let (mut best, curve, mut at) = rows.min_by(|a, b| a.0.0.total_cmp(&b.0.0))?;
        let mut step = curve.length() / curve.rows() as f64;
        for _ in 0..REASON_ROUNDS {
            for s in [at - step, at + step] {
                let Ok(q) = curve.at(s) else { continue };
                let found = worst(curve, &q);
                if found.0 < best.0 {
                    (best, at) = (found, s);
                }
            }
            step *= 0.5;
        }
        Some(best)
    }
}

impl Solutions for TracedCurves {
    fn chain(&self) -> &Chain {
        &self.origin.chain
    }

    fn dimension(&self) -> usize {
        1
    }

    fn status(&self) -> Status {
        self.origin.status(self.curves.len(), || self.arcs().iter().any(|arcs| !arcs.is_empty()))
    }

    fn reason(&self) -> String {
        self.origin.reason(self.status(), "curve", || self.least_violation())
    }

    fn proven(&self) -> bool {
        self.origin.beyond > 0.0
    }

    fn pieces(&self) -> usize {
        self.curves.len()
    }

    fn label(&self, piece: usize) -> Result<String> {
        self.curve(piece).map(|_| format!("curve {piece}"))
    }

    fn closed(&self, piece: usize) -> Result<bool> {
        self.curve(piece).map(SelfMotionCurve::closed)
    }

    fn range(&self, piece: usize) -> Result<[f64; 2]> {
        self.curve(piece).map(|curve| if curve.closed() { [-PI, PI] } else { [0.0, curve.length()] })
    }

    fn q(&self, piece: usize, u: f64, out: &mut [f64]) -> Result<()> {
        check_length("out", out, self.origin.chain.dof())?;
        let (_, s) = self.length_at(piece, u)?;
        out.copy_from_slice(&self.curves[piece].at(s)?);
        self.origin.chain.wind(out);
        Ok(())
    }

    fn tangent(&self, piece: usize, u: f64, out: &mut [f64]) -> Result<()> {
        check_length("out", out, self.origin.chain.dof())?;
        let (rate, s) = self.length_at(piece, u)?;
        for (out, t) in out.iter_mut().zip(self.curves[piece].tangent(s)?) {
            *out = rate * t;
        }
        Ok(())
    }

    fn intervals(&self, piece: usize, margin: f64) -> Result<Vec<[f64; 2]>> {
        check_margin(margin)?;
        let curve = self.curve(piece)?;
        let arcs = if margin == 0.0 { self.arcs()[piece].clone() } else { curve.intervals(margin)? };
        if !curve.closed() {
            return Ok(arcs);
        }
        let u = |s: f64| TURN * s / curve.length() - PI;
        Ok(arcs
            .into_iter()
            .map(|[lo, hi]| if [lo, hi] == [0.0, curve.length()] { [-PI, PI] } else { [u(lo), u(hi)] })
            .collect())
    }

    fn parameter(&self, piece: usize, u: f64) -> Result<Option<f64>> {
        self.length_at(piece, u).map(|_| None)
    }

    fn nearest(&self, q: &[f64]) -> Result<Option<Solution>> {
        search::nearest(self, q)
    }

    fn best(&self, criterion: &dyn Criterion) -> Result<Option<Solution>> {
        search::best(self, criterion)
    }

    fn best_margin(&self) -> Result<Option<Solution>> {
        widest::best_margin(self)
    }

    fn proves_margin(&self, _margin: f64) -> bool {
        self.proven()
    }

    fn feasible_measure(&self) -> Result<f64> {
        let lengths = self
            .curves
            .iter()
            .zip(self.arcs())
            .map(|(curve, arcs)| arcs.iter().map(|[lo, hi]| hi - lo).sum::<f64>().min(curve.length()));
        Ok(lengths.sum())
    }
}

/// Configurations over one task value that Newton's method finds from seeded random starts.
#[derive(Debug, Clone)]
pub struct FoundPoints {
    origin: Origin,
    /// Different configurations, in windings within the limits where there are any.
    points: Vec<Vec<f64>>,
}

impl FoundPoints {
    pub(super) fn new(chain: &Chain, task: Task, target: &Pose, seed: u64, starts: usize) -> Result<Self> {
        let origin = Origin::new(chain, &task, target, starts);
        let mut points: Vec<Vec<f64>> = Vec::new();
        if origin.beyond == 0.0 {
            let mut fibre = Corrector::new(chain, task, target)?;
            let mut d = vec![0.0; chain.dof()];
            for mut q in random_configurations(chain, seed, starts) {
                if !fibre.reach(&mut q) {
                    continue;
                }
                let known = points.iter().any(|point| {
                    chain.difference_into(point, &q, &mut d);
                    d.iter().all(|d| d.abs() < SAME_LINE)
                });
                if !known {
                    chain.wind(&mut q);
                    points.push(q);
                }
            }
        }
        Ok(Self { origin, points })
    }

    fn point(&self, piece: usize) -> Result<&[f64]> {
        check_piece(piece, self.points.len())?;
        Ok(&self.points[piece])
    }

    /// How far the worst joint is outside of its limits narrowed by `margin`, and which one it is.
    fn violation(&self, q: &[f64], margin: f64) -> (f64, usize) {
        let chain = &self.origin.chain;
        let misses = q.iter().enumerate().map(|(i, q)| {
            let (lower, upper) = (chain.lower()[i] + margin, chain.upper()[i] - margin);
            let miss = if chain.steps()[i].rotational {
                outside(*q, lower, upper)
            } else {
                (lower - q).max(q - upper)
            };
            (miss, i)
        });
        misses.fold((0.0, 0), |a, b| if b.0 > a.0 { b } else { a })
    }
}

impl Solutions for FoundPoints {
    fn chain(&self) -> &Chain {
        &self.origin.chain
    }

    fn dimension(&self) -> usize {
        0
    }

    fn status(&self) -> Status {
        let feasible = || self.points.iter().any(|q| self.violation(q, 0.0).0 <= 0.0);
        self.origin.status(self.points.len(), feasible)
    }

    fn reason(&self) -> String {
        self.origin.reason(self.status(), "configuration", || {
            let misses = self.points.iter().map(|q| self.violation(q, 0.0));
            misses.min_by(|a, b| a.0.total_cmp(&b.0))
        })
    }

    fn proven(&self) -> bool {
        self.origin.beyond > 0.0
    }

    fn pieces(&self) -> usize {
        self.points.len()
    }

    fn label(&self, piece: usize) -> Result<String> {
        self.point(piece).map(|_| format!("point {piece}"))
    }

    fn closed(&self, piece: usize) -> Result<bool> {
        self.point(piece).map(|_| false)
    }

    fn range(&self, piece: usize) -> Result<[f64; 2]> {
        self.point(piece).map(|_| [0.0, 0.0])
    }

    fn q(&self, piece: usize, u: f64, out: &mut [f64]) -> Result<()> {
        check_finite("u", &[u])?;
        check_length("out", out, self.origin.chain.dof())?;
        out.copy_from_slice(self.point(piece)?);
        Ok(())
    }

    fn tangent(&self, piece: usize, _u: f64, _out: &mut [f64]) -> Result<()> {
        self.point(piece)?;
        Err(Error::Invalid("an isolated configuration has no tangent".into()))
    }

    fn intervals(&self, piece: usize, margin: f64) -> Result<Vec<[f64; 2]>> {
        check_margin(margin)?;
        let holds = self.violation(self.point(piece)?, margin).0 <= 0.0;
        Ok(if holds { vec![[0.0, 0.0]] } else { Vec::new() })
    }

    fn parameter(&self, piece: usize, _u: f64) -> Result<Option<f64>> {
        self.point(piece).map(|_| None)
    }

    fn nearest(&self, q: &[f64]) -> Result<Option<Solution>> {
        search::nearest(self, q)
    }

    fn best(&self, criterion: &dyn Criterion) -> Result<Option<Solution>> {
        search::best(self, criterion)
    }

    fn best_margin(&self) -> Result<Option<Solution>> {
        widest::best_margin(self)
    }

    fn proves_margin(&self, _margin: f64) -> bool {
        self.proven()
    }

    fn feasible_measure(&self) -> Result<f64> {
        Ok(0.0)
    }
}
