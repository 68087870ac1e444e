//! The five descent algorithms [FromGravdahl2007, section 5], all built on the best value of one joint ([`Sinusoid`]).
//!
//! | name | one iteration |
//! |---|---|
//! | `coordinate_descent` | a sweep: every joint in turn to its best value, from tip to base, base to tip, or there and back |
//! | `gauss_southwell` | the one joint whose best value lowers the cost most |
//! | `gauss_southwell_rate` | the one joint with the largest fall of the cost per radian (eq. 44) |
//! | `weighted_descent` | all joints, each a share `w_i` of the way to its best value (eqs 45, 46) |
//! | `gradient_estimate` | a step along the gradient |
//!
//! The first three never raise the cost. The last one is offered as printed (`GradientKind::Estimate`: eq. 47 with the step
//! `w_s = min |x^ - x|`, which goes to zero with the square of the error and stalls) and with the true gradient, which is
//! the coefficient b of each joint, and a line search (`GradientKind::True`).
//!
//! They are good starters and poor finishers: `docs/ik.md` has what the paper claims beside what is measured.

use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use super::newton::{NewtonRun, RunEnd};
use super::sinusoid::{CostWeights, HalfAngle, Sinusoid};
use crate::chain::Chain;
use crate::error::{Error, Result, check_finite, check_length};
use crate::joint_space::{TURN, other_way};
use crate::kinematics::{PoseError, Scratch};
use crate::pose::Pose;
use crate::tolerance::{DESCENT_STALL, LINE_SEARCH_FALL};
use std::f64::consts::PI;

/// Joint moves between two forward passes that take out the rounding of incremental rotations.
const REFRESH: usize = 16;
/// Halvings of the line search.
const HALVINGS: usize = 60;

/// Which joint moves, and by how much.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum DescentMethod {
    /// Algorithm 1.
    CoordinateDescent,
    /// Algorithm 2.
    GaussSouthwell,
    /// Algorithm 3.
    GaussSouthwellRate,
    /// Algorithm 4.
    WeightedDescent,
    /// Algorithm 5.
    GradientEstimate,
}

impl DescentMethod {
    /// Every method, in the paper's order.
    pub const ALL: [Self; 5] = [
        Self::CoordinateDescent,
        Self::GaussSouthwell,
        Self::GaussSouthwellRate,
        Self::WeightedDescent,
        Self::GradientEstimate,
    ];

    /// The method as a word.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::CoordinateDescent => "coordinate_descent",
            Self::GaussSouthwell => "gauss_southwell",
            Self::GaussSouthwellRate => "gauss_southwell_rate",
            Self::WeightedDescent => "weighted_descent",
            Self::GradientEstimate => "gradient_estimate",
        }
    }
}

/// The order of a sweep of coordinate descent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum SweepOrder {
    /// From the last joint to the first.
    #[default]
    TipToBase,
    /// From the first joint to the last.
    BaseToTip,
    /// From the last joint to the first and back (Aitken's double sweep).
    Double,
}

impl SweepOrder {
    /// Every order.
    pub const ALL: [Self; 3] = [Self::TipToBase, Self::BaseToTip, Self::Double];

    /// The order as a word.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::TipToBase => "tip_to_base",
            Self::BaseToTip => "base_to_tip",
            Self::Double => "double",
        }
    }
}

/// What the cost measures of an orientation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum CostMeasure {
    /// Squared distances of the three unit axes, `8 sin^2(angle / 2)`.
    #[default]
    Axes,
    /// Squared distance of quaternions, `2 - 2 |C.D|`.
    Quaternions,
}

impl CostMeasure {
    /// Every measure.
    pub const ALL: [Self; 2] = [Self::Axes, Self::Quaternions];

    /// The measure as a word.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Axes => "axes",
            Self::Quaternions => "quaternions",
        }
    }
}

/// What algorithm 5 descends along.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum GradientKind {
    /// The true gradient with a line search.
    #[default]
    True,
    /// The paper's estimate and step, as printed.
    Estimate,
}

impl GradientKind {
    /// Every kind.
    pub const ALL: [Self; 2] = [Self::True, Self::Estimate];

    /// The kind as a word.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::True => "true",
            Self::Estimate => "estimate",
        }
    }
}

/// A secondary term of the cost (eq. 43): the weighted squared distance of the origin of a link from a point. A negative
/// weight drives it away.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Attraction {
    /// Index of the link, see [`Chain::link_index`].
    pub link: usize,
    /// The point, m, world.
    pub target: [f64; 3],
    /// Weight, 1/m^2.
    pub weight: f64,
}

/// Settings of the descent algorithms.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DescentSettings {
    /// Weights of position and orientation.
    pub weights: CostWeights,
    /// Order of a sweep.
    pub order: SweepOrder,
    /// Measure of orientations.
    pub measure: CostMeasure,
    /// Share of the way that each joint goes in weighted and gradient descent; `None`: see [`default_joint_weights`].
    pub joint_weights: Option<Vec<f64>>,
    /// What algorithm 5 descends along.
    pub gradient: GradientKind,
    /// Secondary terms.
    pub attractions: Vec<Attraction>,
}

impl DescentSettings {
    /// Checks every setting against its range and against `chain`.
    ///
    /// # Errors
    /// The setting, its value and its bound.
    pub fn validate(&self, chain: &Chain) -> Result<()> {
        for (what, value) in
            [("position_weight", self.weights.position), ("orientation_weight", self.weights.orientation)]
        {
            if !value.is_finite() || value < 0.0 {
                return Err(Error::OutOfRange { what: what.into(), value, bound: ">= 0 and finite".into() });
            }
        }
        if let Some(shares) = &self.joint_weights {
            check_length("joint_weights", shares, chain.dof())?;
            if let Some(value) = shares.iter().find(|w| !(**w > 0.0 && **w <= 1.0)) {
                let what = "joint weight".into();
                return Err(Error::OutOfRange { what, value: *value, bound: "> 0 and <= 1".into() });
            }
        }
        for attraction in &self.attractions {
            chain.link(attraction.link)?;
            check_finite("attraction", &attraction.target)?;
            check_finite("weight of an attraction", &[attraction.weight])?;
        }
        Ok(())
    }
}

/// Weights of eq. (46) for six joints, `1, .5, .5, .3, .3, .3`; for other chains 1 for the first joint, .3 for the last
/// three, .5 between.
pub fn default_joint_weights(dof: usize) -> Vec<f64> {
    (0..dof)
        .map(|i| {
            if i == 0 {
                1.0
            } else if i + 3 >= dof {
                0.3
            } else {
                0.5
            }
        })
        .collect()
}

/// Where the arm is while joints move one by one.
struct DescentState<'a> {
    chain: &'a Chain,
    settings: &'a DescentSettings,
    target: Pose,
    lower: &'a [f64],
    upper: &'a [f64],
    scratch: Scratch,
    q: Vec<f64>,
    axes: Vec<Vector3<f64>>,
    origins: Vec<Vector3<f64>>,
    pose: Pose,
    /// Origins of the links of the attractions.
    points: Vec<Vector3<f64>>,
}

/// The best value of one joint.
#[derive(Debug, Clone, Copy)]
struct Best {
    /// By how much to move.
    psi: f64,
    /// How much the cost falls.
    fall: f64,
    /// Derivative of the cost.
    slope: f64,
}

impl DescentState<'_> {
    /// Brings axes, pose and points up to date with `q`.
    fn refresh(&mut self) {
        let kinematics = self.chain.kinematics_unchecked(&self.q, &mut self.scratch);
        self.axes.copy_from_slice(kinematics.axes());
        self.origins.copy_from_slice(kinematics.origins());
        self.pose = *kinematics.pose();
        for (point, attraction) in self.points.iter_mut().zip(&self.settings.attractions) {
            let link = &self.chain.links()[attraction.link];
            *point = self.chain.forward_link_unchecked(&self.q, link).translation.vector;
        }
    }

    /// Distance and angle from the target.
    fn miss(&self) -> (f64, f64) {
        let error = PoseError::between(&self.target, &self.pose);
        (error.linear.norm(), error.angle)
    }

    fn cost(&self) -> f64 {
        let weights = &self.settings.weights;
        let (distance, angle) = self.miss();
        let half = (0.5 * angle).sin();
        let turned = match self.settings.measure {
            CostMeasure::Axes => 8.0 * half * half,
            // 2 - 2 cos(angle / 2)
            CostMeasure::Quaternions => 4.0 * (0.25 * angle).sin().powi(2),
        };
        let drawn: f64 =
            self.drawn().map(|(point, a)| a.weight * (Vector3::from(a.target) - point).norm_squared()).sum();
        weights.position * distance * distance + weights.orientation * turned + drawn
    }

    fn drawn(&self) -> impl Iterator<Item = (&Vector3<f64>, &Attraction)> {
        self.points.iter().zip(&self.settings.attractions)
    }

    /// Attractions whose link joint `i` moves.
    fn moved_by(&self, i: usize) -> impl Iterator<Item = (&Vector3<f64>, &Attraction)> {
        self.drawn().filter(move |(_, a)| self.chain.links()[a.link].joints_before > i)
    }

    /// The best value of joint `i` within its limits.
    fn best(&self, i: usize) -> Best {
        let (axis, origin) = (&self.axes[i], &self.origins[i]);
        let weights = &self.settings.weights;
        let (p, pd) = (&self.pose.translation.vector, &self.target.translation.vector);
        let (low, high) = (self.lower[i] - self.q[i], self.upper[i] - self.q[i]);
        if !self.chain.steps()[i].rotational {
            let mut total = weights.position;
            let mut pull = weights.position * axis.dot(&(pd - p));
            for (point, a) in self.moved_by(i) {
                total += a.weight;
                pull += a.weight * axis.dot(&(Vector3::from(a.target) - point));
            }
            let fall = |x: f64| (2.0 * pull - total * x) * x;
            let mut psi = if total > 0.0 { (pull / total).clamp(low, high) } else { 0.0 };
            for end in [low, high] {
                if end.is_finite() && fall(end) > fall(psi) {
                    psi = end;
                }
            }
            return Best { psi, fall: fall(psi), slope: -2.0 * pull };
        }
        let mut whole = Sinusoid::of_point(axis, origin, p, pd, weights.position);
        for (point, a) in self.moved_by(i) {
            whole = whole.plus(&Sinusoid::of_point(axis, origin, point, &a.target.into(), a.weight));
        }
        match self.settings.measure {
            CostMeasure::Axes => {
                let turning =
                    Sinusoid::of_axes(axis, &self.pose.rotation, &self.target.rotation, weights.orientation);
                let all = whole.plus(&turning);
                let (psi, fall) = all.minimum_within(low, high);
                Best { psi, fall, slope: all.sin }
            }
            CostMeasure::Quaternions => {
                let from = UnitQuaternion::from_rotation_matrix(&self.pose.rotation);
                let mut to = UnitQuaternion::from_rotation_matrix(&self.target.rotation);
                if from.coords.dot(&to.coords) < 0.0 {
                    to = UnitQuaternion::new_unchecked(-to.into_inner());
                }
                let all = HalfAngle::of_quaternions(axis, &from, &to, weights.orientation, &whole);
                let (psi, fall) = all.minimum_within(low.max(-TURN), high.min(TURN));
                // Beyond half a turn the other way round is shorter, where the limits allow it.
                let other = other_way(psi, TURN);
                let psi = if psi.abs() > PI && other >= low && other <= high { other } else { psi };
                Best { psi, fall, slope: all.whole.sin + 0.5 * all.half_sin }
            }
        }
    }

    /// Moves joint `i` by `psi` and carries along what it moves; the axes after it only with `axes`.
    fn turn(&mut self, i: usize, psi: f64, axes: bool) {
        self.q[i] = (self.q[i] + psi).clamp(self.lower[i], self.upper[i]);
        let (axis, origin) = (self.axes[i], self.origins[i]);
        let links = self.chain.links();
        let after = self.settings.attractions.iter().map(|a| links[a.link].joints_before > i);
        if self.chain.steps()[i].rotational {
            let turn = Rotation3::from_scaled_axis(axis * psi);
            let carry = |p: &Vector3<f64>| origin + turn * (p - origin);
            self.pose.translation.vector = carry(&self.pose.translation.vector);
            self.pose.rotation = turn * self.pose.rotation;
            for (point, _) in self.points.iter_mut().zip(after).filter(|(_, after)| *after) {
                *point = carry(point);
            }
            if axes {
                for j in i + 1..self.q.len() {
                    self.axes[j] = turn * self.axes[j];
                    self.origins[j] = carry(&self.origins[j]);
                }
            }
        } else {
            self.pose.translation.vector += axis * psi;
            for (point, _) in self.points.iter_mut().zip(after).filter(|(_, after)| *after) {
                *point += axis * psi;
            }
            if axes {
                self.origins[i + 1..].iter_mut().for_each(|origin| *origin += axis * psi);
            }
        }
    }
}

/// A descent on one chain.
#[derive(Debug, Clone, Copy)]
pub(super) struct JointDescent<'a> {
    pub chain: &'a Chain,
    pub method: DescentMethod,
    pub settings: &'a DescentSettings,
    pub lower: &'a [f64],
    pub upper: &'a [f64],
    pub tol_position: f64,
    pub tol_orientation: f64,
}

impl JointDescent<'_> {
    /// Improves `q` until it meets `target`, stops improving, or `cap` iterations are done. `seen` gets the cost and the
    /// errors before every iteration and at the end.
    pub fn run(
        &self,
        target: &Pose,
        q: &mut [f64],
        cap: usize,
        mut seen: impl FnMut(f64, f64, f64),
    ) -> NewtonRun {
        let n = q.len();
        let mut state = DescentState {
            chain: self.chain,
            settings: self.settings,
            target: *target,
            lower: self.lower,
            upper: self.upper,
            scratch: Scratch::new(self.chain),
            q: q.to_vec(),
            axes: vec![Vector3::zeros(); n],
            origins: vec![Vector3::zeros(); n],
            pose: Pose::identity(),
            points: vec![Vector3::zeros(); self.settings.attractions.len()],
        };
        let default = default_joint_weights(n);
        let shares = self.settings.joint_weights.as_deref().unwrap_or(&default);
        let mut length = 1.0;
        let mut iterations = 0;
        let mut before = f64::INFINITY;
        state.refresh();
        loop {
            let (mut position, mut orientation) = state.miss();
            let mut arrived = position <= self.tol_position && orientation <= self.tol_orientation;
            if arrived {
                // Incremental rotations round: what counts is forward kinematics.
                state.refresh();
                (position, orientation) = state.miss();
                arrived = position <= self.tol_position && orientation <= self.tol_orientation;
            }
            let cost = state.cost();
            seen(cost, position, orientation);
            let end = if arrived {
                Some(RunEnd::Converged)
            } else if iterations >= cap {
                Some(RunEnd::Capped)
            } else if before - cost <= DESCENT_STALL * cost.abs() && self.descends() {
                Some(RunEnd::Stalled)
            } else {
                None
            };
            if let Some(end) = end {
                state.refresh();
                let (position, orientation) = state.miss();
                q.copy_from_slice(&state.q);
                return NewtonRun { end, iterations, position, orientation, cost };
            }
            before = cost;
            self.iterate(&mut state, shares, iterations, cost, &mut length);
            iterations += 1;
        }
    }

    /// One iteration of the method; `length` is that of the last step along the gradient.
    fn iterate(
        &self,
        state: &mut DescentState<'_>,
        shares: &[f64],
        iterations: usize,
        cost: f64,
        length: &mut f64,
    ) {
        match self.method {
            DescentMethod::CoordinateDescent => self.sweep(state),
            DescentMethod::GaussSouthwell | DescentMethod::GaussSouthwellRate => {
                let rate = self.method == DescentMethod::GaussSouthwellRate;
                let score = |b: &Best| match rate {
                    true if b.psi != 0.0 => b.fall / b.psi.abs(),
                    true => 0.0,
                    false => b.fall,
                };
                let all = (0..state.q.len()).map(|i| (i, state.best(i)));
                if let Some((i, best)) = all.max_by(|a, b| score(&a.1).total_cmp(&score(&b.1))) {
                    state.turn(i, best.psi, true);
                }
                if iterations % REFRESH == REFRESH - 1 {
                    state.refresh();
                }
            }
            DescentMethod::WeightedDescent => {
                let steps: Vec<f64> = (0..state.q.len()).map(|i| shares[i] * state.best(i).psi).collect();
                go(state, &steps, 1.0);
            }
            DescentMethod::GradientEstimate => {
                let bests: Vec<Best> = (0..state.q.len()).map(|i| state.best(i)).collect();
                match self.settings.gradient {
                    GradientKind::Estimate => {
                        let scale = bests.iter().fold(f64::INFINITY, |a, b| a.min(b.psi.abs()));
                        let estimate = |b: &Best| if b.psi == 0.0 { 0.0 } else { b.fall / b.psi };
                        let steps: Vec<f64> =
                            bests.iter().zip(shares).map(|(b, w)| w * scale * estimate(b)).collect();
                        go(state, &steps, 1.0);
                    }
                    GradientKind::True => {
                        // Joints at a limit that the gradient would take beyond it stay.
                        let steps: Vec<f64> = bests
                            .iter()
                            .enumerate()
                            .map(|(i, b)| {
                                let stuck = (b.slope < 0.0 && state.q[i] >= self.upper[i])
                                    || (b.slope > 0.0 && state.q[i] <= self.lower[i]);
                                if stuck { 0.0 } else { -b.slope }
                            })
                            .collect();
                        *length = search(state, &steps, cost, 2.0 * *length);
                    }
                }
            }
        }
    }

    /// Whether an iteration without a fall of the cost is the end.
    fn descends(&self) -> bool {
        match self.method {
            DescentMethod::WeightedDescent => false,
            DescentMethod::GradientEstimate => self.settings.gradient == GradientKind::True,
            _ => true,
        }
    }

    fn sweep(&self, state: &mut DescentState<'_>) {
        let n = state.q.len();
        let order = self.settings.order;
        if order != SweepOrder::BaseToTip {
            for i in (0..n).rev() {
                let psi = state.best(i).psi;
                state.turn(i, psi, false);
            }
            state.refresh();
        }
        if order != SweepOrder::TipToBase {
            for i in 0..n {
                let psi = state.best(i).psi;
                state.turn(i, psi, true);
            }
            state.refresh();
        }
    }
}

/// All joints at once.
fn go(state: &mut DescentState<'_>, steps: &[f64], length: f64) {
    for (i, step) in steps.iter().enumerate() {
        state.q[i] = (state.q[i] + length * step).clamp(state.lower[i], state.upper[i]);
    }
    state.refresh();
}

/// Halves the step until the cost falls by its share of what the slope promises; returns the length.
fn search(state: &mut DescentState<'_>, steps: &[f64], cost: f64, first: f64) -> f64 {
    let promise: f64 = steps.iter().map(|s| s * s).sum();
    let from = state.q.clone();
    let mut length = first;
    for _ in 0..HALVINGS {
        go(state, steps, length);
        if state.cost() <= cost - LINE_SEARCH_FALL * length * promise {
            return length;
        }
        state.q.copy_from_slice(&from);
        length *= 0.5;
    }
    state.refresh();
    length
}
