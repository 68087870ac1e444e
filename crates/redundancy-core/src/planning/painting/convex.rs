//! Sequential convex programming from one start: splines of tilt and spin, the rows that bound the speed, one step.

use nalgebra::{Const, SMatrix, SVector};

use super::curve::{Curve, CurvePoint};
use super::motion::{Arm, Motion, Parameters, Sensitivity, Size, Workspace};
use super::program::Program;
use crate::path::{LocalBasis, QuinticBasis};
use crate::tolerance::JOINT_JUMP;

/// Largest and least radius of the trust region, rad.
const RADIUS: f64 = 0.3;
const RADIUS_LEAST: f64 = 2e-4;
/// Relative decrease of `t` per step below which a search has ended.
const DECREASE: f64 = 2e-6;
/// Distance that samples keep from cone and joint limits, rad: what the curve may do between them.
const MARGIN: f64 = 2e-4;

/// What bounds a plan.
#[derive(Debug, Clone)]
pub(super) struct PaintingBounds {
    /// Torques, with the margin taken off; infinite for none.
    pub torque: Vec<f64>,
    /// Joint speeds; infinite for none.
    pub velocity: Vec<f64>,
    pub lower: Vec<f64>,
    pub upper: Vec<f64>,
    /// Largest tilt, rad.
    pub tilt: f64,
    /// Largest spin, rad; infinite for none.
    pub spin: f64,
    /// Largest rate of the orientation, rad/s; infinite for none.
    pub rate: f64,
}

/// A basis over the path and the places where the rows are taken.
pub(super) struct SplineSamples {
    pub basis: QuinticBasis,
    pub s: Vec<f64>,
    pub points: Vec<CurvePoint>,
    pub locals: Vec<LocalBasis>,
}

impl SplineSamples {
    pub fn new(curve: &Curve, intervals: usize, samples: usize) -> Self {
        let (low, high) = curve.ends();
        let basis = QuinticBasis::uniform(low, high, intervals);
        let count = intervals * samples;
        let s: Vec<f64> = (0..=count).map(|k| low + (high - low) * k as f64 / count as f64).collect();
        let points = s.iter().map(|s| curve.at(*s)).collect();
        let locals = s.iter().map(|s| basis.at(*s)).collect();
        Self { basis, s, points, locals }
    }

    pub fn parameters<const M: usize>(&self, k: usize, coefficients: &[SVector<f64, M>]) -> Parameters<M> {
        spline_at(&self.locals[k], coefficients)
    }
}

/// A spline of parameters at a place.
pub(super) fn spline_at<const M: usize>(
    local: &LocalBasis,
    coefficients: &[SVector<f64, M>],
) -> Parameters<M> {
    let mut out = [[0.0; M]; 3];
    for (row, values) in out.iter_mut().zip(&local.values) {
        for (j, b) in values.iter().enumerate() {
            for c in 0..M {
                row[c] += b * coefficients[local.first + j][c];
            }
        }
    }
    out
}

/// One row `g <= t` and how it depends on the parameters at its place.
#[derive(Debug, Clone, Copy)]
struct BoundRow<const M: usize> {
    sample: usize,
    value: f64,
    gradient: [[f64; M]; 3],
}

/// Coefficients with what they give on a grid.
#[derive(Clone)]
pub(super) struct SplinePlan<const N: usize, const M: usize> {
    pub coefficients: Vec<SVector<f64, M>>,
    pub q: Vec<SVector<f64, N>>,
    /// Largest `1 / v^2` over all rows.
    pub t: f64,
    pub radius: f64,
    pub done: bool,
    rows: Vec<BoundRow<M>>,
    by_u: Vec<SMatrix<f64, N, M>>,
    /// Rows that mattered in the last step.
    tight: Vec<bool>,
}

/// Why coefficients are not a plan.
pub(super) struct Refused;

/// The rows of one place: calls `row` with each value, and the joint when it is one's.
pub(super) fn rows_of<const N: usize, const M: usize>(
    bounds: &PaintingBounds,
    motion: &Motion<N, M>,
    mut row: impl FnMut(BoundKind, f64),
) -> Result<(), Refused> {
    for j in 0..N {
        let limit = bounds.torque[j];
        if limit.is_finite() {
            let (up, down) = (limit - motion.gravity[j], limit + motion.gravity[j]);
            if up <= 0.0 || down <= 0.0 {
                return Err(Refused);
            }
            row(BoundKind::Up(j), motion.dynamic[j] / up);
            row(BoundKind::Down(j), -motion.dynamic[j] / down);
        }
        if bounds.velocity[j].is_finite() {
            row(BoundKind::Velocity(j), (motion.d[j] / bounds.velocity[j]).powi(2));
        }
    }
    if bounds.rate.is_finite() {
        row(BoundKind::Rate, motion.omega.norm_squared() / (bounds.rate * bounds.rate));
    }
    Ok(())
}

/// Which bound a row is.
#[derive(Debug, Clone, Copy)]
pub(super) enum BoundKind {
    Up(usize),
    Down(usize),
    Velocity(usize),
    Rate,
}

/// BoundRow `i` of a matrix over the channels.
fn row_of<const N: usize, const M: usize>(m: &SMatrix<f64, N, M>, i: usize, scale: f64) -> [f64; M] {
    std::array::from_fn(|c| m[(i, c)] * scale)
}

fn gradient<const N: usize, const M: usize>(
    kind: BoundKind,
    value: f64,
    bounds: &PaintingBounds,
    motion: &Motion<N, M>,
    by: &Sensitivity<N, M>,
) -> [[f64; M]; 3] {
    let torque = |j: usize, sign: f64, room: f64| {
        let mut out: [[f64; M]; 3] = std::array::from_fn(|o| row_of(&by.dynamic[o], j, sign / room));
        for c in 0..M {
            out[0][c] += sign * value * by.gravity[(j, c)] / room;
        }
        out
    };
    match kind {
        BoundKind::Up(j) => torque(j, 1.0, bounds.torque[j] - motion.gravity[j]),
        BoundKind::Down(j) => torque(j, -1.0, bounds.torque[j] + motion.gravity[j]),
        BoundKind::Velocity(j) => {
            let scale = 2.0 * motion.d[j] / (bounds.velocity[j] * bounds.velocity[j]);
            [row_of(&by.q_rate, j, scale), row_of(&by.q, j, scale), [0.0; M]]
        }
        BoundKind::Rate => {
            // d |omega|^2 = 2 omega . (A' du + A du'): what turns with omega does not change its length.
            let scale = 2.0 / (bounds.rate * bounds.rate);
            let part = |o: usize| -> [f64; M] {
                std::array::from_fn(
                    |c| if c < 3 { motion.omega.dot(&by.turn[o].column(c)) * scale } else { 0.0 },
                )
            };
            [part(1), part(0), [0.0; M]]
        }
    }
}

impl<const N: usize, const M: usize> SplinePlan<N, M>
where
    Const<N>: Size,
{
    /// Rows and gradients on `grid`, from configurations nearby.
    pub fn new(
        arm: &Arm<'_, N>,
        grid: &SplineSamples,
        bounds: &PaintingBounds,
        coefficients: Vec<SVector<f64, M>>,
        near: &[SVector<f64, N>],
        work: &mut Workspace<N>,
    ) -> Result<Self, Refused> {
        let samples = grid.s.len();
        let mut state = Self {
            coefficients,
            q: Vec::with_capacity(samples),
            t: 0.0,
            radius: RADIUS,
            done: false,
            rows: Vec::with_capacity(samples * (2 * N + 1)),
            by_u: Vec::with_capacity(samples),
            tight: Vec::new(),
        };
        let zero = SMatrix::zeros();
        let mut by = Sensitivity {
            q: zero,
            q_rate: zero,
            gravity: zero,
            dynamic: [zero; 3],
            turn: [nalgebra::Matrix3::zeros(); 2],
        };
        for k in 0..samples {
            let u = grid.parameters(k, &state.coefficients);
            let motion = arm.motion(&grid.points[k], &u, &near[k], work, Some(&mut by)).ok_or(Refused)?;
            if let Some(last) = state.q.last()
                && (motion.q - last).amax() > JOINT_JUMP
            {
                return Err(Refused);
            }
            for j in 0..N {
                if motion.q[j] < bounds.lower[j] || motion.q[j] > bounds.upper[j] {
                    return Err(Refused);
                }
            }
            let (rows, t) = (&mut state.rows, &mut state.t);
            rows_of(bounds, &motion, |kind, value| {
                *t = t.max(value);
                rows.push(BoundRow {
                    sample: k,
                    value,
                    gradient: gradient(kind, value, bounds, &motion, &by),
                });
            })?;
            state.q.push(motion.q);
            state.by_u.push(by.q);
        }
        if state.t > 0.0 && state.t.is_finite() { Ok(state) } else { Err(Refused) }
    }

    /// One convex step; true while there may be more.
    pub fn step(
        &mut self,
        arm: &Arm<'_, N>,
        grid: &SplineSamples,
        bounds: &PaintingBounds,
        frozen: [bool; 2],
        work: &mut Workspace<N>,
    ) -> bool {
        if self.done {
            return false;
        }
        let Some((change, predicted, tight)) = self.convex_step(grid, bounds, frozen) else {
            self.shrink(0.3);
            return !self.done;
        };
        let gain = self.t - predicted;
        self.tight = tight;
        if gain < DECREASE * self.t {
            if self.radius < 0.05 * RADIUS || gain <= 0.0 {
                self.done = true;
            }
            self.shrink(0.3);
            return !self.done;
        }
        let moved: Vec<SVector<f64, M>> = self.coefficients.iter().zip(&change).map(|(c, d)| c + d).collect();
        let near: Vec<SVector<f64, N>> = (0..grid.s.len())
            .map(|k| {
                let local = &grid.locals[k];
                let mut du = SVector::<f64, M>::zeros();
                for (j, b) in local.values[0].iter().enumerate() {
                    du += change[local.first + j] * *b;
                }
                self.q[k] + self.by_u[k] * du
            })
            .collect();
        match Self::new(arm, grid, bounds, moved, &near, work) {
            Ok(mut next) if next.t < self.t - 0.1 * gain => {
                let ratio = (self.t - next.t) / gain;
                next.tight = std::mem::take(&mut self.tight);
                next.radius = if ratio > 0.7 {
                    (1.6 * self.radius).min(RADIUS)
                } else if ratio < 0.35 {
                    0.6 * self.radius
                } else {
                    self.radius
                };
                *self = next;
            }
            _ => self.shrink(0.4),
        }
        !self.done
    }

    fn shrink(&mut self, factor: f64) {
        self.radius *= factor;
        self.done |= self.radius < RADIUS_LEAST;
    }

    /// Change of the coefficients, the `t` that the linear model promises, and the rows near it.
    fn convex_step(
        &self,
        grid: &SplineSamples,
        bounds: &PaintingBounds,
        frozen: [bool; 2],
    ) -> Option<(Vec<SVector<f64, M>>, f64, Vec<bool>)> {
        let functions = grid.basis.len();
        let columns = functions * M + 1;
        let mut program = Program::new(columns);
        self.add_trust_region(&mut program, functions, frozen);
        self.add_ranges(&mut program, grid, bounds, frozen);
        // In units of the current t, around it: rows of order one.
        let unit = 1.0 / self.t;
        // Rows that lie low join only where the step would break them.
        let was_tight = |i: usize| self.tight.get(i).copied().unwrap_or(false);
        let mut taken: Vec<bool> =
            self.rows.iter().enumerate().map(|(i, row)| row.value * unit > ACTIVE || was_tight(i)).collect();
        let add = |program: &mut Program, row: &BoundRow<M>| {
            let scaled = row.gradient.map(|order| order.map(|g| g * unit));
            program.local(&grid.locals[row.sample], &scaled, 1.0, -row.value * unit);
        };
        for (row, _) in self.rows.iter().zip(&taken).filter(|(_, taken)| **taken) {
            add(&mut program, row);
        }
        for _ in 0..CUTS {
            let x = program.solve()?;
            let change: Vec<SVector<f64, M>> =
                (0..functions).map(|k| SVector::from_fn(|c, _| x[k * M + c])).collect();
            let (promised, mut broken) = (x[columns - 1], 0);
            let mut tight = vec![false; self.rows.len()];
            self.predict(grid, &change, |i, value| {
                tight[i] = value * unit > promised - NEAR;
                if !taken[i] && value * unit > promised + BROKEN {
                    taken[i] = true;
                    broken += 1;
                    add(&mut program, &self.rows[i]);
                }
            });
            if broken == 0 {
                return Some((change, promised * self.t, tight));
            }
        }
        None
    }

    /// How far each coefficient may move.
    fn add_trust_region(&self, program: &mut Program, functions: usize, frozen: [bool; 2]) {
        for k in 0..functions {
            for c in 0..M {
                let fixed = (c < 2 && frozen[0]) || (c == 2 && frozen[1]);
                let r = if fixed {
                    0.0
                } else if c == 2 {
                    SPIN_RADIUS * self.radius
                } else {
                    self.radius
                };
                program.bounds(k * M + c, -r, r);
            }
        }
    }

    /// The ranges of joints, spin and tilt, where the step can come near them.
    fn add_ranges(
        &self,
        program: &mut Program,
        grid: &SplineSamples,
        bounds: &PaintingBounds,
        frozen: [bool; 2],
    ) {
        let none = [0.0; M];
        for (k, q) in self.q.iter().enumerate() {
            let local = &grid.locals[k];
            for j in 0..N {
                let reach: f64 =
                    (0..M).map(|c| self.by_u[k][(j, c)].abs()).sum::<f64>() * SPIN_RADIUS * self.radius;
                if q[j] + reach > bounds.upper[j] - MARGIN {
                    let room = (bounds.upper[j] - MARGIN - q[j]).max(0.0);
                    program.local(local, &[row_of(&self.by_u[k], j, 1.0), none, none], 0.0, room);
                }
                if q[j] - reach < bounds.lower[j] + MARGIN {
                    let room = (q[j] - bounds.lower[j] - MARGIN).max(0.0);
                    program.local(local, &[row_of(&self.by_u[k], j, -1.0), none, none], 0.0, room);
                }
            }
            if bounds.spin.is_finite() && !frozen[1] {
                let psi = grid.parameters(k, &self.coefficients)[0][2];
                let mut unit = [0.0; M];
                for sign in [1.0, -1.0] {
                    unit[2] = sign;
                    let room = (bounds.spin - MARGIN - sign * psi).max(0.0);
                    program.local(local, &[unit, none, none], 0.0, room);
                }
            }
        }
        if frozen[0] {
            return;
        }
        for k in (0..grid.s.len()).step_by(CONE_STRIDE) {
            let u = grid.parameters(k, &self.coefficients);
            let tilt = [u[0][0], u[0][1]];
            let length = tilt[0].hypot(tilt[1]);
            if length + 1.5 * self.radius > bounds.tilt - MARGIN {
                program.cone::<M>(&grid.locals[k], tilt, (bounds.tilt - MARGIN).max(length));
            }
        }
    }

    /// Calls `see` with the value of each row in the linear model.
    fn predict(&self, grid: &SplineSamples, change: &[SVector<f64, M>], mut see: impl FnMut(usize, f64)) {
        let mut du = [[0.0; M]; 3];
        let mut sample = usize::MAX;
        for (i, row) in self.rows.iter().enumerate() {
            if row.sample != sample {
                sample = row.sample;
                du = spline_at(&grid.locals[sample], change);
            }
            let mut value = row.value;
            for (gradient, du) in row.gradient.iter().zip(&du) {
                for (g, d) in gradient.iter().zip(du) {
                    value += g * d;
                }
            }
            see(i, value);
        }
    }
}

/// Share of the current `t` above which a row is part of a step from the beginning.
const ACTIVE: f64 = 0.8;
/// Distance from the promised `t`, in the same units, within which a row is taken along to the next step.
const NEAR: f64 = 0.08;
/// Excess over the promised `t`, in units of the current one, at which a row that was left out joins.
const BROKEN: f64 = 2e-3;
/// Most times that rows join.
const CUTS: usize = 12;
/// The spin moves the tool's axis only through the offset of the tool: its region is wider.
const SPIN_RADIUS: f64 = 2.0;
/// Every how many samples the cone is imposed; between them the margin covers it.
const CONE_STRIDE: usize = 2;
