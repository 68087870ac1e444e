//! Problems one after the other within the same bounds, each solved among the solutions of those before it.
//!
//! The joint velocity is kept as `qd = x + Z w`: x meets what is decided so far, Z is an orthonormal basis of what that leaves
//! free. Bounds are rows `low <= g . qd <= high`, the joints themselves and further ones; each row keeps its value at x and
//! its numbers in the coordinates w, so that a decision is a few reflections of all rows.
//!
//! - [`meet`](Hierarchy::meet): the largest s in [0, 1] for which some qd within the bounds has `J qd = s v`; where the
//!   decisions before leave less freedom than J has rows, `J qd` is as near to `s v` as they allow (least squares); where it
//!   was limits that took the freedom, an s that meets the task exactly goes before that.
//! - [`approach`](Hierarchy::approach): the least `|J qd - v|` within the bounds, where no s is possible.
//! - [`hold`](Hierarchy::hold): a row's value up to a bound, as far as possible.
//!
//! Where bounds decided the result (`s < 1`), the rows with a multiplier are at their bounds in every solution
//! (complementary slackness). They are fixed there, so that what is left has an inside again and the next problem is as well
//! posed as the first. In between, w is always the one nearest to the wished joint velocity.
//!
//! The least squares with bounds are solved by the proximal point method: `|J qd - v|^2 + e^2 |w - w_k|^2` is a projection
//! (see the module `box_projection`), and its solutions end at one of the problem itself after a few rounds.

use super::box_projection::{BoxProjection, Rows};
use super::linear::dot;
use crate::tolerance::{
    FROZEN_MULTIPLIER, FROZEN_ROW, LEVEL_RANK, PRIORITY_RESIDUAL, PROXIMAL_CHANGE, PROXIMAL_WEIGHT,
};

/// Most coordinates of one task.
const MOST: usize = 6;

/// Most rounds of the proximal point method; two or three are usual.
const PROXIMAL_ROUNDS: usize = 20;

/// Memory for one arm.
#[derive(Debug, Clone)]
pub(super) struct Hierarchy {
    n: usize,
    /// How many coordinates are decided.
    decided: usize,
    /// n numbers for each row: those of decided coordinates, then those of w.
    z: Vec<f64>,
    /// Value of each row at x.
    fixed: Vec<f64>,
    low: Vec<f64>,
    high: Vec<f64>,
    wish: Vec<f64>,
    /// The joint velocity of the last solution.
    last: Vec<f64>,
    /// Whether rows have been fixed: limits have taken directions from the levels below.
    confined: bool,
    /// Whether `projection.z` belongs to the present coordinates.
    settled: bool,
    projection: BoxProjection,
    level: Level,
    /// Bounds of w and what one unit of scale takes, for each row.
    from: Vec<f64>,
    upto: Vec<f64>,
    taken: Vec<f64>,
    /// The wish, or where the proximal point method is, in the coordinates w.
    start: Vec<f64>,
    zero: Vec<f64>,
    white: Vec<f64>,
    frozen: Vec<(usize, bool)>,
}

/// One task in the coordinates w, turned so that it only sees the first `rank` of them.
#[derive(Debug, Clone)]
struct Level {
    m: usize,
    rank: usize,
    /// m rows of n numbers.
    rows: Vec<f64>,
    reflectors: Vec<f64>,
    order: [usize; MOST],
    /// `J x`.
    value: [f64; MOST],
    /// Least-squares solution for v, and for `-J x`.
    with_velocity: [f64; MOST],
    without: [f64; MOST],
    /// What these leave of v, and of `-J x`.
    missing_velocity: [f64; MOST],
    missing: [f64; MOST],
}

impl Hierarchy {
    /// Memory for n joints and so many further rows.
    pub fn new(n: usize, further: usize) -> Self {
        let rows = n + further;
        Self {
            n,
            decided: 0,
            z: Vec::with_capacity(rows * n),
            fixed: Vec::with_capacity(rows),
            low: Vec::with_capacity(rows),
            high: Vec::with_capacity(rows),
            wish: vec![0.0; n],
            last: vec![0.0; n],
            confined: false,
            settled: false,
            projection: BoxProjection::new(n),
            level: Level {
                m: 0,
                rank: 0,
                rows: vec![0.0; MOST * n],
                reflectors: vec![0.0; MOST * n],
                order: [0; MOST],
                value: [0.0; MOST],
                with_velocity: [0.0; MOST],
                without: [0.0; MOST],
                missing_velocity: [0.0; MOST],
                missing: [0.0; MOST],
            },
            from: vec![0.0; rows],
            upto: vec![0.0; rows],
            taken: vec![0.0; rows],
            start: Vec::with_capacity(n),
            zero: vec![0.0; n],
            white: vec![0.0; rows * n],
            frozen: Vec::with_capacity(n + 1),
        }
    }

    /// Nothing is decided; the bounds are those of the joints.
    pub fn begin(&mut self, low: &[f64], high: &[f64], wish: &[f64]) {
        let n = self.n;
        self.decided = 0;
        self.confined = false;
        self.settled = false;
        self.z.clear();
        self.z.resize(n * n, 0.0);
        (0..n).for_each(|i| self.z[i * n + i] = 1.0);
        self.fixed.clear();
        self.fixed.resize(n, 0.0);
        self.low.clear();
        self.low.extend_from_slice(low);
        self.high.clear();
        self.high.extend_from_slice(high);
        self.wish.copy_from_slice(wish);
        for (last, ((wish, low), high)) in self.last.iter_mut().zip(wish.iter().zip(low).zip(high)) {
            *last = wish.clamp(*low, *high);
        }
    }

    /// Another row `g . qd >= low`; its index.
    pub fn add_row(&mut self, gradient: &[f64], low: f64) -> usize {
        let (n, row) = (self.n, self.low.len());
        self.z.resize((row + 1) * n, 0.0);
        let (joints, new) = self.z.split_at_mut(row * n);
        for (joint, g) in joints.chunks_exact(n).zip(gradient) {
            new.iter_mut().zip(joint).for_each(|(new, z)| *new += g * z);
        }
        self.fixed.push(dot(gradient, &self.fixed[..n]));
        self.low.push(low);
        self.high.push(f64::INFINITY);
        self.settled = false;
        row
    }

    /// Finds the w nearest to the wish within the bounds; false where the bounds exclude each other.
    pub fn settle(&mut self) -> bool {
        if !self.settled {
            for row in 0..self.low.len() {
                self.from[row] = self.low[row] - self.fixed[row];
                self.upto[row] = self.high[row] - self.fixed[row];
                self.taken[row] = 0.0;
            }
            self.settled = self.project(0).is_some();
            if self.settled {
                self.keep();
            }
        }
        self.settled
    }

    /// The largest scale for the bounds in `from`, `upto` and `taken`, w without its first `skipped` coordinates.
    fn project(&mut self, skipped: usize) -> Option<f64> {
        let (n, first) = (self.n, self.decided + skipped);
        let count = self.low.len();
        self.start.clear();
        for k in first..n {
            self.start.push((0..n).map(|j| self.z[j * n + k] * (self.wish[j] - self.fixed[j])).sum());
        }
        let rows = Rows {
            n: &self.z[first..],
            r: n - first,
            stride: n,
            low: &self.from[..count],
            high: &self.upto[..count],
            p: &self.taken[..count],
        };
        self.projection.solve(&rows, &self.start)
    }

    /// Keeps the joint velocity that belongs to x and w.
    fn keep(&mut self) {
        let n = self.n;
        for (i, last) in self.last.iter_mut().enumerate() {
            *last = self.fixed[i] + dot(&self.z[i * n + self.decided..(i + 1) * n], &self.projection.z);
        }
    }

    /// The largest s in [0, 1] for which `J qd = s v`, J (m, n) column by column; it is decided. `None`: there is no s, nothing
    /// is decided.
    pub fn meet(&mut self, jacobian: &[f64], v: &[f64]) -> Option<f64> {
        self.turn(jacobian, v);
        // Where limits have left the task too few directions, often a single scale is possible.
        if let Some(only) = self.level.only_scale().filter(|_| self.confined)
            && self.meet_between(only, only).is_some()
        {
            return Some(only);
        }
        let s = self.meet_between(0.0, 1.0)?;
        if s < 1.0 {
            self.freeze_blocking();
        }
        Some(s)
    }

    /// The largest scale between two for the present level; it is decided.
    fn meet_between(&mut self, least: f64, most: f64) -> Option<f64> {
        let rank = self.level.rank;
        let (n, first) = (self.n, self.decided);
        let base: [f64; MOST] =
            std::array::from_fn(|k| self.level.without[k] + least * self.level.with_velocity[k]);
        let per_unit: [f64; MOST] = std::array::from_fn(|k| (most - least) * self.level.with_velocity[k]);
        for row in 0..self.low.len() {
            let own = &self.z[row * n + first..][..rank];
            let base = self.fixed[row] + dot(own, &base[..rank]);
            self.from[row] = self.low[row] - base;
            self.upto[row] = self.high[row] - base;
            self.taken[row] = dot(own, &per_unit[..rank]);
        }
        let s = self.project(rank)?;
        let y: [f64; MOST] = std::array::from_fn(|k| base[k] + s * per_unit[k]);
        self.decide(&y[..rank]);
        self.settled = true;
        self.keep();
        Some(least + s * (most - least))
    }

    /// Takes a task for [`approach`](Self::approach) that was not tried with [`meet`](Self::meet).
    pub fn prepare(&mut self, jacobian: &[f64], v: &[f64]) {
        self.turn(jacobian, v);
    }

    /// After [`prepare`](Self::prepare), or [`meet`](Self::meet) without a solution, for the same task: the least `|J qd - v|` within the bounds; it is decided.
    pub fn approach(&mut self) {
        let (n, first, rank, count) = (self.n, self.decided, self.level.rank, self.low.len());
        let r = n - first;
        let triangle = self.level.triangle(n, first);
        let goal: [f64; MOST] = std::array::from_fn(|k| self.level.with_velocity[k] + self.level.without[k]);
        self.whiten(&triangle);
        // From the last joint velocity on.
        let mut w = std::mem::take(&mut self.start);
        w.clear();
        for k in first + rank..n {
            w.push((0..n).map(|j| self.z[j * n + k] * (self.last[j] - self.fixed[j])).sum());
        }
        let mut y = goal;
        for _ in 0..PROXIMAL_ROUNDS {
            for row in 0..count {
                let own = &self.z[row * n + first..][..r];
                let base = self.fixed[row] + dot(&own[..rank], &goal[..rank]) + dot(&own[rank..], &w);
                self.from[row] = self.low[row] - base;
                self.upto[row] = self.high[row] - base;
            }
            let rows = Rows {
                n: &self.white[..count * r],
                r,
                stride: r,
                low: &self.from[..count],
                high: &self.upto[..count],
                p: &self.taken[..count],
            };
            if self.projection.solve(&rows, &self.zero[..r]).is_none() {
                break;
            }
            let u = &self.projection.z;
            for k in (0..rank).rev() {
                let after: f64 = (k + 1..rank).map(|l| triangle[k][l] * (y[l] - goal[l])).sum();
                y[k] = goal[k] + (u[k] - after) / triangle[k][k];
            }
            let mut change: f64 = 0.0;
            for (w, u) in w.iter_mut().zip(&u[rank..]) {
                *w += u / PROXIMAL_WEIGHT;
                change = change.max((u / PROXIMAL_WEIGHT).abs());
            }
            if change <= PROXIMAL_CHANGE {
                break;
            }
        }
        self.decide(&y[..rank]);
        for (i, last) in self.last.iter_mut().enumerate() {
            *last = self.fixed[i] + dot(&self.z[i * n + self.decided..(i + 1) * n], &w);
        }
        self.start = w;
        self.frozen.clear();
        let strong = self.projection.multipliers().filter(|(_, u)| *u > FROZEN_MULTIPLIER);
        self.frozen.extend(strong.map(|(row, _)| row));
        self.freeze();
    }

    /// The rows in the coordinates `t = R (y - goal)` and `e (w - w_k)`, in which the least squares are the nearest point to zero.
    fn whiten(&mut self, triangle: &[[f64; MOST]; MOST]) {
        let (n, first, rank) = (self.n, self.decided, self.level.rank);
        let r = n - first;
        for row in 0..self.low.len() {
            let own = &self.z[row * n + first..][..r];
            let white = &mut self.white[row * r..(row + 1) * r];
            for k in 0..rank {
                let before: f64 = (0..k).map(|l| white[l] * triangle[l][k]).sum();
                white[k] = (own[k] - before) / triangle[k][k];
            }
            for k in rank..r {
                white[k] = own[k] / PROXIMAL_WEIGHT;
            }
            self.taken[row] = 0.0;
        }
    }

    /// Raises the least value of a row to `bound`, or as far as the bounds allow; the value that it has at least from now on.
    /// `None` where the bounds exclude each other.
    pub fn hold(&mut self, row: usize, bound: f64) -> Option<f64> {
        if !self.settle() {
            return None;
        }
        let (n, first) = (self.n, self.decided);
        let now = self.fixed[row] + dot(&self.z[row * n + first..(row + 1) * n], &self.projection.z);
        if now >= bound {
            self.low[row] = bound;
            return Some(bound);
        }
        for other in 0..self.low.len() {
            self.from[other] = self.low[other] - self.fixed[other];
            self.upto[other] = self.high[other] - self.fixed[other];
            self.taken[other] = 0.0;
        }
        // From what it has, s = 0, to what it should have, s = 1.
        self.from[row] = now - self.fixed[row];
        self.taken[row] = now - bound;
        let s = self.project(0)?;
        self.low[row] = if s < 1.0 { now + s * (bound - now) } else { bound };
        self.keep();
        if s < 1.0 {
            self.freeze_blocking();
        }
        Some(self.low[row])
    }

    /// The joint velocity nearest to the wish among those that keep what is decided.
    pub fn finish(&mut self, qd: &mut [f64]) {
        // What rounding excludes after a freeze was possible before it.
        let _ = self.settle();
        qd.copy_from_slice(&self.last);
    }

    /// Turns the coordinates w so that the task sees as few of them as it can.
    fn turn(&mut self, jacobian: &[f64], v: &[f64]) {
        let (n, first, m) = (self.n, self.decided, v.len());
        self.settled = false;
        let level = &mut self.level;
        level.m = m;
        let mut size: f64 = 0.0;
        for i in 0..m {
            let row = &mut level.rows[i * n..(i + 1) * n];
            row.fill(0.0);
            level.value[i] = 0.0;
            let mut square = 0.0;
            for j in 0..n {
                let x = jacobian[j * m + i];
                square += x * x;
                level.value[i] += x * self.fixed[j];
                for (row, z) in row[first..].iter_mut().zip(&self.z[j * n + first..(j + 1) * n]) {
                    *row += x * z;
                }
            }
            size = size.max(square);
        }
        level.factor(n, first, LEVEL_RANK * size.sqrt());
        for step in 0..level.rank {
            let reflector = &level.reflectors[step * n + first + step..(step + 1) * n];
            for row in self.z.chunks_exact_mut(n) {
                reflect(reflector, &mut row[first + step..]);
            }
        }
        level.solve(n, first, v);
    }

    /// Decides the next coordinates.
    fn decide(&mut self, y: &[f64]) {
        let (n, first) = (self.n, self.decided);
        for (fixed, row) in self.fixed.iter_mut().zip(self.z.chunks_exact(n)) {
            *fixed += dot(&row[first..first + y.len()], y);
        }
        self.decided += y.len();
    }

    /// Fixes the rows that prove the last scale to be the largest.
    fn freeze_blocking(&mut self) {
        self.frozen.clear();
        let strong = self.projection.proof_rows().filter(|(_, u)| *u > FROZEN_MULTIPLIER);
        self.frozen.extend(strong.map(|(row, _)| row));
        self.freeze();
    }

    /// Fixes the rows in `frozen` at their bounds, if they are there.
    fn freeze(&mut self) {
        let n = self.n;
        for k in 0..self.frozen.len() {
            let (row, upper) = self.frozen[k];
            let bound = if upper { self.high[row] } else { self.low[row] };
            let value = match row < n {
                true => self.last[row],
                false => {
                    let free = |j: usize| self.last[j] - self.fixed[j];
                    let rest = (self.decided..n).map(|c| {
                        self.z[row * n + c] * (0..n).map(|j| self.z[j * n + c] * free(j)).sum::<f64>()
                    });
                    self.fixed[row] + rest.sum::<f64>()
                }
            };
            if (value - bound).abs() > FROZEN_ROW * (1.0 + bound.abs()) {
                continue;
            }
            self.fix(row, bound);
            self.confined = true;
            (self.low[row], self.high[row]) = (f64::NEG_INFINITY, f64::INFINITY);
            self.settled = false;
        }
    }

    /// Decides one coordinate so that a row has this value; a row that is decided already stays as it is.
    fn fix(&mut self, row: usize, value: f64) {
        let (n, first) = (self.n, self.decided);
        let reflector = &mut self.level.reflectors[first..n];
        reflector.copy_from_slice(&self.z[row * n + first..(row + 1) * n]);
        if dot(reflector, reflector).sqrt() <= FROZEN_ROW {
            return;
        }
        let along = make_reflector(reflector);
        for row in self.z.chunks_exact_mut(n) {
            reflect(reflector, &mut row[first..]);
        }
        self.decide(&[(value - self.fixed[row]) / along]);
    }
}

impl Level {
    /// Triangular in the order of the rows that add most: reflections from the right, row by row.
    fn factor(&mut self, n: usize, first: usize, zero: f64) {
        let m = self.m;
        self.order = std::array::from_fn(|i| i);
        self.rank = 0;
        while self.rank < m.min(n - first) {
            let step = self.rank;
            let norm = |i: usize| {
                let row = &self.rows[i * n + first + step..(i + 1) * n];
                dot(row, row)
            };
            let best = (step..m)
                .fold(step, |best, k| if norm(self.order[k]) > norm(self.order[best]) { k } else { best });
            if norm(self.order[best]).sqrt() <= zero {
                return;
            }
            self.order.swap(step, best);
            let pivot = self.order[step];
            let reflector = &mut self.reflectors[step * n + first + step..(step + 1) * n];
            reflector.copy_from_slice(&self.rows[pivot * n + first + step..(pivot + 1) * n]);
            let along = make_reflector(reflector);
            for i in &self.order[step + 1..m] {
                reflect(reflector, &mut self.rows[i * n + first + step..(i + 1) * n]);
            }
            self.rows[pivot * n + first + step..(pivot + 1) * n].fill(0.0);
            self.rows[pivot * n + first + step] = along;
            self.rank += 1;
        }
    }

    /// The coordinates for v, and those for `-J x`: exact where the rank is full, else least squares.
    fn solve(&mut self, n: usize, first: usize, v: &[f64]) {
        let mut rest = [0.0; MOST];
        rest[..self.m].iter_mut().zip(&self.value).for_each(|(rest, value)| *rest = -value);
        let mut given = [0.0; MOST];
        given[..self.m].copy_from_slice(v);
        (self.missing_velocity, self.missing) = ([0.0; MOST], [0.0; MOST]);
        if self.rank == self.m {
            for (right, out) in [(&given, &mut self.with_velocity), (&rest, &mut self.without)] {
                for k in 0..self.rank {
                    let row = &self.rows[self.order[k] * n + first..][..=k];
                    out[k] = (right[self.order[k]] - dot(&row[..k], &out[..k])) / row[k];
                }
            }
            return;
        }
        let (q, r) = self.orthogonalise(n, first);
        for (right, out) in [(&given, &mut self.with_velocity), (&rest, &mut self.without)] {
            for k in (0..self.rank).rev() {
                let after: f64 = (k + 1..self.rank).map(|l| r[k][l] * out[l]).sum();
                out[k] = (dot(&q[k], right) - after) / r[k][k];
            }
        }
        for (right, missing) in [(given, &mut self.missing_velocity), (rest, &mut self.missing)] {
            *missing = right;
            for q in &q[..self.rank] {
                let part = dot(q, missing);
                missing.iter_mut().zip(q).for_each(|(missing, q)| *missing -= part * q);
            }
        }
    }

    /// The scale in [0, 1] that alone meets the task, which sees fewer coordinates than it has rows.
    fn only_scale(&self) -> Option<f64> {
        let square = dot(&self.missing_velocity, &self.missing_velocity);
        if square.sqrt() <= PRIORITY_RESIDUAL {
            return None;
        }
        let s = (-dot(&self.missing_velocity, &self.missing) / square).clamp(0.0, 1.0);
        let left: [f64; MOST] = std::array::from_fn(|i| s * self.missing_velocity[i] + self.missing[i]);
        (dot(&left, &left).sqrt() <= PRIORITY_RESIDUAL).then_some(s)
    }

    /// Orthonormal columns and the triangle of the `(m, rank)` matrix of the task, by orthogonalising twice.
    fn orthogonalise(&self, n: usize, first: usize) -> ([[f64; MOST]; MOST], [[f64; MOST]; MOST]) {
        let (mut q, mut r) = ([[0.0; MOST]; MOST], [[0.0; MOST]; MOST]);
        for k in 0..self.rank {
            let mut column: [f64; MOST] =
                std::array::from_fn(|i| if i < self.m { self.rows[i * n + first + k] } else { 0.0 });
            for _ in 0..2 {
                for l in 0..k {
                    let part = dot(&q[l], &column);
                    r[l][k] += part;
                    column.iter_mut().zip(&q[l]).for_each(|(x, q)| *x -= part * q);
                }
            }
            r[k][k] = dot(&column, &column).sqrt();
            q[k] = column.map(|x| x / r[k][k]);
        }
        (q, r)
    }

    /// R with `|J qd - v| = |R (y - goal)|` up to what no y changes.
    fn triangle(&self, n: usize, first: usize) -> [[f64; MOST]; MOST] {
        self.orthogonalise(n, first).1
    }
}

/// Turns a row, not zero, into the reflector that turns it onto the first axis, `I - v v^T`; what it becomes there.
fn make_reflector(row: &mut [f64]) -> f64 {
    let norm = dot(row, row).sqrt();
    let along = if row[0] < 0.0 { norm } else { -norm };
    row[0] -= along;
    let scale = (2.0 / dot(row, row)).sqrt();
    row.iter_mut().for_each(|x| *x *= scale);
    along
}

#[inline(always)]
fn reflect(v: &[f64], x: &mut [f64]) {
    let along = dot(v, x);
    x.iter_mut().zip(v).for_each(|(x, v)| *x -= along * v);
}
