//! The fastest motion along a stretch when jerks are limited too.
//!
//! # Problem
//! With `x = sigma'^2` over the parameter sigma (primes of x by sigma, of q too), `qd = q' sqrt(x)`,
//! `qdd = q'' x + q' x' / 2` and `qddd = sqrt(x) (q''' x + 3/2 q'' x' + q' x'' / 2)`. Wanted is the x with the least
//! `int d sigma / sqrt(x)`. `x` is a quadratic spline with a knot at each node, so that the jerk of the parameter is
//! smooth between nodes and may jump at them; limits on speed and acceleration are asked for at nodes, those on the jerk
//! at both ends of each interval.
//!
//! # Rest
//! At rest `x` as a function of the length s starts like `s^(4/3)`. Near a rest sigma is chosen with
//! `s = L (t^3 - t^4 / 2)`, `t = sigma / L`: then `q'` and `q''` vanish there and x is an ordinary positive number. In the
//! interval next to a rest x is constant: s is then a polynomial of the time, and so is the motion between its two rows.
//!
//! # Method
//! Dividing by `sqrt(x)` leaves `|q''' x + 3/2 q'' x' + q' x'' / 2| <= J / sqrt(x)`: linear on the left, convex on the
//! right. A logarithmic barrier with Newton steps that leave out the curvature of the right-hand sides: each step is that
//! of a convex problem whose feasible set lies within the true one [BoydVandenberghe2004, section 11.3], so every iterate
//! is feasible. Three coefficients meet in an interval, so a step costs `O(nodes)`; joints are taken four at a time.

use wide::f64x4;

use super::node_limits::NodeLimits;
use super::settings::RetimeSettings;
use super::stretch::Stretch;
use crate::tolerance::{RETIME_GAP, RETIME_ZONE};

/// Derivatives by sigma at one end of an interval.
struct Nodes {
    n: usize,
    /// Lengths of the intervals of sigma.
    h: Vec<f64>,
    /// At the nodes.
    first: Vec<f64>,
    second: Vec<f64>,
    /// At the beginning and the end of each interval.
    third: Vec<[Vec<f64>; 2]>,
    /// Largest x.
    most: Vec<f64>,
    inertial: Vec<f64>,
    dynamic: Vec<f64>,
}

/// `d^i s / d sigma^i`, i = 1, 2, 3, on an interval's end.
type Chain3 = [f64; 3];

/// A rest at one end: `s = L (t^3 - t^4 / 2)` over the first nodes.
struct Zone {
    length: f64,
}

impl Zone {
    /// sigma for a distance `s <= L / 2` from the rest.
    fn sigma(&self, s: f64) -> f64 {
        let wanted = s / self.length;
        let mut t = (wanted.max(0.0)).cbrt().min(1.0);
        for _ in 0..NEWTON_STEPS {
            let slope = t * t * (3.0 - 2.0 * t);
            if slope <= 0.0 {
                break;
            }
            t = (t - (t * t * t * (1.0 - 0.5 * t) - wanted) / slope).clamp(0.0, 1.0);
        }
        self.length * t
    }

    fn derivatives(&self, sigma: f64) -> Chain3 {
        let (t, l) = (sigma / self.length, self.length);
        [t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t) / l, (6.0 - 12.0 * t) / (l * l)]
    }
}

/// Newton steps that invert a quartic from a good start.
const NEWTON_STEPS: usize = 12;

impl Nodes {
    fn new(stretch: &Stretch, limits: &NodeLimits, rest: [bool; 2]) -> Self {
        let (n, last) = (stretch.n, stretch.nodes() - 1);
        let width = RETIME_ZONE.min(last / 3).max(1);
        let end = stretch.s[last];
        let zones = [
            rest[0].then(|| Zone { length: 2.0 * stretch.s[width] }),
            rest[1].then(|| Zone { length: 2.0 * (end - stretch.s[last - width]) }),
        ];
        // sigma advances twice as far as s in a zone.
        let shift = zones[0].as_ref().map_or(0.0, |zone| zone.length / 2.0);
        let total = end + shift + zones[1].as_ref().map_or(0.0, |zone| zone.length / 2.0);
        let place = |k: usize| {
            let s = stretch.s[k];
            match &zones {
                [Some(zone), _] if k < width => zone.sigma(s),
                [_, Some(zone)] if k > last - width => total - zone.sigma(end - s),
                _ => s + shift,
            }
        };
        let sigma: Vec<f64> = (0..=last).map(place).collect();
        // On which side of a node the third derivative is asked for decides at the end of a zone.
        let chain_at = |k: usize, interval: usize| -> Chain3 {
            match &zones {
                [Some(zone), _] if interval < width => zone.derivatives(sigma[k]),
                [_, Some(zone)] if interval >= last - width => {
                    let [a, b, c] = zone.derivatives(total - sigma[k]);
                    [a, -b, c]
                }
                _ => [1.0, 0.0, 0.0],
            }
        };
        let mut out = Self {
            n,
            h: sigma.windows(2).map(|w| w[1] - w[0]).collect(),
            first: Vec::with_capacity(stretch.q.len()),
            second: Vec::with_capacity(stretch.q.len()),
            third: Vec::with_capacity(last),
            most: Vec::with_capacity(last + 1),
            inertial: Vec::new(),
            dynamic: Vec::new(),
        };
        for k in 0..=last {
            let [a, b, _] = chain_at(k, k.min(last - 1));
            out.most.push(if a > 0.0 { limits.most[k] / (a * a) } else { f64::INFINITY });
            for i in k * n..(k + 1) * n {
                out.first.push(stretch.d[i] * a);
                out.second.push(stretch.dd[i] * a * a + stretch.d[i] * b);
                if let (Some(m), Some(d)) = (limits.inertial.get(i), limits.dynamic.get(i)) {
                    out.inertial.push(m * a);
                    out.dynamic.push(d * a * a + m * b);
                }
            }
        }
        for k in 0..last {
            out.third.push([k, k + 1].map(|node| {
                let [a, b, c] = chain_at(node, k);
                let third = |j: usize| {
                    let i = node * n + j;
                    stretch.ddd[k * n + j] * a.powi(3) + 3.0 * stretch.dd[i] * a * b + stretch.d[i] * c
                };
                (0..n).map(third).collect()
            }));
        }
        out
    }
}

/// The time law at a node.
#[derive(Debug, Clone, Copy)]
pub(super) struct LawNode {
    /// Time since the start of the stretch, s.
    pub t: f64,
}

/// A solved stretch: times, velocities and accelerations at its nodes.
#[derive(Debug, Clone)]
pub(super) struct JerkLaw {
    pub nodes: Vec<LawNode>,
    pub qd: Vec<f64>,
    pub qdd: Vec<f64>,
}

/// What accelerations and jerks take of their limits, four joints at a time; zeros beyond the last joint and without a
/// limit.
struct Lanes {
    /// Groups of four joints.
    groups: usize,
    /// `q'' / A` and `q' / (2 A)` by node.
    acceleration: Vec<[f64x4; 2]>,
    /// The third derivative, `3/2 q''` and `q' / 2` over the jerk limit at both ends of each interval.
    jerk: Vec<[f64x4; 3]>,
    /// 1 for joints with a jerk limit.
    limited: Vec<f64x4>,
}

impl Lanes {
    /// With one over the limits by node and joint.
    fn new(nodes: &Nodes, acceleration: &[f64], jerk: &[f64]) -> Self {
        let (n, last) = (nodes.n, nodes.h.len());
        let groups = n.div_ceil(4);
        let four = |group: usize, of: &dyn Fn(usize) -> f64| {
            f64x4::from(std::array::from_fn::<f64, 4, _>(|lane| {
                let j = 4 * group + lane;
                if j < n { of(j) } else { 0.0 }
            }))
        };
        let mut out = Self {
            groups,
            acceleration: Vec::with_capacity((last + 1) * groups),
            jerk: Vec::with_capacity(2 * last * groups),
            limited: (0..groups).map(|g| four(g, &|j| f64::from(u8::from(jerk[j] > 0.0)))).collect(),
        };
        for node in (0..=last).map(|k| k * n) {
            for group in 0..groups {
                let at = |of: &[f64], factor: f64| {
                    four(group, &|j| of[node + j] * factor * acceleration[node + j])
                };
                out.acceleration.push([at(&nodes.second, 1.0), at(&nodes.first, 0.5)]);
            }
        }
        for (k, ends) in nodes.third.iter().enumerate() {
            for (end, third) in ends.iter().enumerate() {
                let node = (k + end) * n;
                let [second, first] = [&nodes.second, &nodes.first].map(|v| &v[node..node + n]);
                for group in 0..groups {
                    let at = |of: &[f64], factor: f64| four(group, &|j| of[j] * factor * jerk[node + j]);
                    out.jerk.push([at(third, 1.0), at(second, 1.5), at(first, 0.5)]);
                }
            }
        }
        out
    }

    /// Product of the slacks of the accelerations at node `k`, `None` outside; adds the derivatives of its negative
    /// logarithm.
    #[inline]
    fn accelerations(
        &self,
        k: usize,
        [x, dx]: [f64; 2],
        derivatives: Option<(&mut [f64; 2], &mut [f64; 3])>,
    ) -> Option<f64> {
        let (one, [x, dx]) = (f64x4::ONE, [x, dx].map(f64x4::splat));
        let (mut product, mut least) = (one, one);
        let (mut first, mut second) = ([f64x4::ZERO; 2], [f64x4::ZERO; 3]);
        for [b, a] in self.acceleration[k * self.groups..][..self.groups].iter().copied() {
            let value = b * x + a * dx;
            let (up, down) = (one - value, one + value);
            least = least.min(up.min(down));
            product *= up * down;
            if derivatives.is_some() {
                let (up, down) = (one / up, one / down);
                let (slope, bend) = (up - down, up * up + down * down);
                first[0] += slope * b;
                first[1] += slope * a;
                second[0] += bend * b * b;
                second[1] += bend * b * a;
                second[2] += bend * a * a;
            }
        }
        if let Some((g, s)) = derivatives {
            g.iter_mut().zip(first).for_each(|(g, v)| *g += v.reduce_add());
            s.iter_mut().zip(second).for_each(|(s, v)| *s += v.reduce_add());
        }
        inside(least, product)
    }

    /// The same for the jerks at one end of interval `k`. The bound falls with x, and so does its logarithm.
    #[inline]
    fn jerks(
        &self,
        (k, end): (usize, usize),
        [x, dx, bend]: [f64; 3],
        derivatives: Option<(&mut [f64; 3], &mut [f64; 6])>,
    ) -> Option<f64> {
        let (one, scale, falls) = (f64x4::ONE, f64x4::splat(x.sqrt()), f64x4::splat(0.5 / x));
        let [x, dx, bend] = [x, dx, bend].map(f64x4::splat);
        let (mut product, mut least) = (one, one);
        let (mut first, mut second) = ([f64x4::ZERO; 3], [f64x4::ZERO; 6]);
        let rows = &self.jerk[(2 * k + end) * self.groups..][..self.groups];
        for (row, limited) in rows.iter().zip(&self.limited) {
            // Everything in units of the bound J / sqrt(x).
            let [a, b, e] = row.map(|v| v * scale);
            let value = a * x + b * dx + e * bend;
            let (up, down) = (one - value, one + value);
            least = least.min(up.min(down));
            product *= up * down;
            if derivatives.is_some() {
                let falls = falls * *limited;
                let (up, down) = (one / up, one / down);
                for w in [[(falls + a) * up, b * up, e * up], [(falls - a) * down, -b * down, -e * down]] {
                    first.iter_mut().zip(w).for_each(|(g, w)| *g += w);
                    second[0] += w[0] * w[0];
                    second[1] += w[0] * w[1];
                    second[2] += w[0] * w[2];
                    second[3] += w[1] * w[1];
                    second[4] += w[1] * w[2];
                    second[5] += w[2] * w[2];
                }
            }
        }
        if let Some((g, s)) = derivatives {
            g.iter_mut().zip(first).for_each(|(g, v)| *g += v.reduce_add());
            s.iter_mut().zip(second).for_each(|(s, v)| *s += v.reduce_add());
        }
        inside(least, product)
    }
}

/// The product of all slacks where the least one is positive.
#[inline]
fn inside(least: f64x4, product: f64x4) -> Option<f64> {
    let positive = least.to_array().iter().all(|slack| *slack > 0.0);
    positive.then(|| product.to_array().iter().product())
}

/// The barrier problem over one stretch.
struct Barrier<'a> {
    nodes: &'a Nodes,
    /// One over the acceleration limits by node and joint (times the share), 0 without one; jerk limits likewise.
    acceleration: Vec<f64>,
    jerk: Vec<f64>,
    lanes: Lanes,
    /// Number of joints with a jerk limit.
    jerks: f64,
    /// `[low, high]` torque left for the motion.
    torque: Vec<[f64; 2]>,
    most: Vec<f64>,
    /// Rows of node value and slope on the coefficients k and k + 1.
    value: Vec<[f64; 2]>,
    slope: Vec<[f64; 2]>,
    constraints: f64,
    /// Coefficients below the first and above the second are equal to it: x is constant next to a rest.
    free: [usize; 2],
}

/// Gradient and the upper three diagonals of the Hessian.
struct Quadratic {
    gradient: Vec<f64>,
    hessian: Vec<[f64; 3]>,
    free: [usize; 2],
}

impl Quadratic {
    /// Adds to the gradient by coefficient `i`.
    fn slope(&mut self, i: usize, value: f64) {
        self.gradient[i.clamp(self.free[0], self.free[1])] += value;
    }

    /// Adds to the second derivative by coefficients `i <= j`.
    fn bend(&mut self, i: usize, j: usize, value: f64) {
        let [a, b] = [i, j].map(|i| i.clamp(self.free[0], self.free[1]));
        // Two coefficients that are one: both mixed derivatives land on the diagonal.
        self.hessian[a][b - a] += if a == b && i != j { 2.0 * value } else { value };
    }
}

impl<'a> Barrier<'a> {
    fn new(
        nodes: &'a Nodes,
        limits: &NodeLimits,
        settings: &RetimeSettings,
        jerk: &[f64],
        rest: [bool; 2],
        share: &[f64],
    ) -> Self {
        let (n, last) = (nodes.n, nodes.h.len());
        let h = |k: usize| nodes.h[k.min(last - 1)];
        let before = |k: usize| nodes.h[k.saturating_sub(1)];
        let value = (0..=last).map(|k| [h(k), before(k)].map(|w| w / (h(k) + before(k)))).collect();
        let slope = (0..=last).map(|k| [-2.0, 2.0].map(|w| w / (h(k) + before(k)))).collect();
        let each = |limit: &[f64], power: f64| -> Vec<f64> {
            (0..=last)
                .flat_map(|k| (0..n).map(move |j| (k, j)))
                .map(|(k, j)| 1.0 / (limit[j] * share[k].powf(power)))
                .collect()
        };
        let torque = match &settings.torque_limits {
            None => Vec::new(),
            Some(most) => (0..(last + 1) * n)
                .map(|i| [-1.0, 1.0].map(|sign| (sign * most[i % n] - limits.gravity[i]) * share[i / n]))
                .collect(),
        };
        let (acceleration, sudden) = (each(&settings.acceleration_limits, 1.0), each(jerk, 1.5));
        let mut out = Self {
            nodes,
            lanes: Lanes::new(nodes, &acceleration, &sudden),
            acceleration,
            jerk: sudden,
            jerks: jerk.iter().filter(|limit| limit.is_finite()).count() as f64,
            torque,
            most: nodes.most.iter().zip(share).map(|(most, share)| most * share).collect(),
            value,
            slope,
            constraints: 0.0,
            free: [if rest[0] { 2 } else { 0 }, if rest[1] { last - 1 } else { last + 1 }],
        };
        let limits = |v: &[f64]| v.iter().filter(|v| **v > 0.0).count();
        out.constraints = (out.most.iter().filter(|v| v.is_finite()).count()
            + 2 * limits(&out.acceleration)
            + 4 * limits(&out.jerk)
            + 2 * out.torque.iter().filter(|t| t[1].is_finite()).count()) as f64;
        out
    }

    fn at(&self, c: &[f64], k: usize) -> [f64; 2] {
        let dot = |w: [f64; 2]| w[0] * c[k] + w[1] * c[k + 1];
        [dot(self.value[k]), dot(self.slope[k])]
    }

    /// The largest constant x that is well within all limits.
    fn start(&self) -> f64 {
        let n = self.nodes.n;
        let mut most = f64::INFINITY;
        for (k, bound) in self.most.iter().enumerate() {
            most = most.min(*bound);
            for i in k * n..(k + 1) * n {
                most = most.min(1.0 / (self.acceleration[i] * self.nodes.second[i].abs()));
                if let Some([low, high]) = self.torque.get(i) {
                    let d = self.nodes.dynamic[i];
                    most = most.min(if d > 0.0 { high / d } else { low / d });
                }
            }
        }
        for (k, ends) in self.nodes.third.iter().enumerate() {
            for (end, third) in ends.iter().enumerate() {
                for j in 0..n {
                    let share = self.jerk[(k + end) * n + j] * third[j].abs();
                    most = most.min(share.powf(-2.0 / 3.0));
                }
            }
        }
        0.5 * most
    }

    /// Duration by Simpson's rule and the sum of the barriers; `None` outside.
    fn evaluate(&self, c: &[f64], mut quadratic: Option<(&mut Quadratic, f64)>) -> Option<[f64; 2]> {
        let (n, last) = (self.nodes.n, self.nodes.h.len());
        let (mut duration, mut barrier) = (0.0, 0.0);
        let derivatives = quadratic.is_some();
        if let Some((q, _)) = &mut quadratic {
            q.gradient.iter_mut().for_each(|g| *g = 0.0);
            q.hessian.iter_mut().for_each(|h| *h = [0.0; 3]);
        }
        for k in 0..=last {
            let [x, dx] = self.at(c, k);
            if x <= 0.0 {
                return None;
            }
            let weight = (if k > 0 { self.nodes.h[k - 1] } else { 0.0 }
                + if k < last { self.nodes.h[k] } else { 0.0 })
                / 6.0;
            let root = 1.0 / x.sqrt();
            duration += weight * root;
            // Gradient and Hessian by (x, x').
            let (mut g, mut s) = ([0.0; 2], [0.0; 3]);
            if self.most[k].is_finite() {
                let slack = self.most[k] - x;
                if slack <= 0.0 {
                    return None;
                }
                barrier -= (slack / self.most[k]).ln();
                g[0] += 1.0 / slack;
                s[0] += 1.0 / (slack * slack);
            }
            let wanted = derivatives.then_some((&mut g, &mut s));
            let mut product = self.lanes.accelerations(k, [x, dx], wanted)?;
            let torques = if self.torque.is_empty() { 0..0 } else { k * n..(k + 1) * n };
            for i in torques {
                if let Some([low, high]) = self.torque.get(i)
                    && high.is_finite()
                {
                    let (b, a) = (self.nodes.dynamic[i], 0.5 * self.nodes.inertial[i]);
                    let value = b * x + a * dx;
                    let (up, down) = (high - value, value - low);
                    if up <= 0.0 || down <= 0.0 {
                        return None;
                    }
                    product *= up * down / (high * -low);
                    if derivatives {
                        two_sided(&mut g, &mut s, [b, a], 1.0 / up, 1.0 / down);
                    }
                }
            }
            barrier -= product.ln();
            if let Some((q, mu)) = &mut quadratic {
                let mut g = g.map(|v| v * *mu);
                let mut s = s.map(|v| v * *mu);
                g[0] -= 0.5 * weight * root / x;
                s[0] += 0.75 * weight * root / (x * x);
                let (v, d) = (self.value[k], self.slope[k]);
                for i in 0..2 {
                    q.slope(k + i, v[i] * g[0] + d[i] * g[1]);
                    for j in i..2 {
                        let value =
                            v[i] * v[j] * s[0] + (v[i] * d[j] + d[i] * v[j]) * s[1] + d[i] * d[j] * s[2];
                        q.bend(k + i, k + j, value);
                    }
                }
            }
        }
        for k in 0..last {
            let [time, walls] = self.interval(c, k, &mut quadratic)?;
            duration += time;
            barrier += walls;
        }
        barrier.is_finite().then_some([duration, barrier])
    }

    /// What interval `k` adds: the middle of Simpson's rule and the jerks at both ends.
    fn interval(
        &self,
        c: &[f64],
        k: usize,
        quadratic: &mut Option<(&mut Quadratic, f64)>,
    ) -> Option<[f64; 2]> {
        let h = self.nodes.h[k];
        let ([x0, d0], [x1, d1]) = (self.at(c, k), self.at(c, k + 1));
        let bend = (d1 - d0) / h;
        let middle = 0.5 * (x0 + x1) - bend * h * h / 8.0;
        if middle <= 0.0 {
            return None;
        }
        let (v, d) = ([self.value[k], self.value[k + 1]], [self.slope[k], self.slope[k + 1]]);
        let rows = [[v[0][0], v[0][1], 0.0], [0.0, v[1][0], v[1][1]]];
        let slopes = [[d[0][0], d[0][1], 0.0], [0.0, d[1][0], d[1][1]]];
        let bends: [f64; 3] = std::array::from_fn(|i| (slopes[1][i] - slopes[0][i]) / h);
        let mut barrier = 0.0;
        let derivatives = quadratic.is_some();
        let (mut gradient, mut hessian) = ([0.0; 3], [[0.0; 3]; 3]);
        for (end, (x, dx)) in [(x0, d0), (x1, d1)].into_iter().enumerate() {
            if x <= 0.0 {
                return None;
            }
            let (mut g, mut s) = ([0.0; 3], [0.0; 6]);
            let wanted = derivatives.then_some((&mut g, &mut s));
            let product = self.lanes.jerks((k, end), [x, dx, bend], wanted)?;
            // `ln` of the slack over its bound, and of the bound itself, which changes with x.
            barrier += -product.ln() + self.jerks * x.ln();
            if derivatives {
                let basis = [rows[end], slopes[end], bends];
                spread(&g, &s, &basis, &mut gradient, &mut hessian);
            }
        }
        let root = 1.0 / middle.sqrt();
        let weight = 4.0 * h / 6.0;
        if let Some((q, mu)) = quadratic {
            let row: [f64; 3] =
                std::array::from_fn(|i| 0.5 * (rows[0][i] + rows[1][i]) - bends[i] * h * h / 8.0);
            let (g, s) = (-0.5 * weight * root / middle, 0.75 * weight * root / (middle * middle));
            for i in 0..3 {
                q.slope(k + i, *mu * gradient[i] + g * row[i]);
                for j in i..3 {
                    q.bend(k + i, k + j, *mu * hessian[i][j] + s * row[i] * row[j]);
                }
            }
        }
        Some([weight * root, barrier])
    }

    /// The largest multiple of known coefficients that is well within the limits, if there is one.
    fn start_near(&self, known: &[f64]) -> Option<Vec<f64>> {
        let mut factor = 1.0;
        (0..WARM_STEPS).find_map(|_| {
            factor *= WARM_STEP;
            let c: Vec<f64> = known.iter().map(|c| c * factor).collect();
            self.evaluate(&c, None).map(|_| c)
        })
    }

    /// The optimum up to the gap, from a feasible start; the optimum of nearly the same limits is a near one.
    fn solve(&self, known: Option<&[f64]>) -> Option<Vec<f64>> {
        let size = self.nodes.h.len() + 2;
        let near = known.and_then(|known| self.start_near(known));
        let excess = if near.is_some() { WARM_GAP } else { 1.0 };
        let mut c = near.unwrap_or_else(|| vec![self.start(); size]);
        let mut quadratic =
            Quadratic { gradient: vec![0.0; size], hessian: vec![[0.0; 3]; size], free: self.free };
        let [duration, _] = self.evaluate(&c, None)?;
        let mut mu = excess * duration / self.constraints.max(1.0);
        let mut trial = c.clone();
        for _ in 0..STAGES {
            let mut now = self.evaluate(&c, None)?;
            for _ in 0..STAGE_STEPS {
                self.evaluate(&c, Some((&mut quadratic, mu)))?;
                let decrement = quadratic.solve();
                let [low, high] = self.free;
                let mut step = 1.0;
                let mut moved = false;
                while step > SHORTEST_STEP {
                    for (i, t) in trial.iter_mut().enumerate() {
                        *t = c[i] - step * quadratic.gradient[i.clamp(low, high)];
                    }
                    if let Some(next) = self.evaluate(&trial, None)
                        && next[0] + mu * next[1] <= now[0] + mu * now[1] - 0.1 * step * decrement
                    {
                        std::mem::swap(&mut c, &mut trial);
                        now = next;
                        moved = true;
                        break;
                    }
                    step *= 0.5;
                }
                if !moved || decrement < SETTLED * mu * self.constraints.sqrt() {
                    break;
                }
            }
            if mu * self.constraints < RETIME_GAP * now[0] {
                break;
            }
            mu *= COOLING;
        }
        Some(c)
    }
}

/// Stages of the barrier, Newton steps of each, the factor between them, and when a stage is settled.
const STAGES: usize = 14;
const STAGE_STEPS: usize = 12;
const COOLING: f64 = 0.15;
const SETTLED: f64 = 0.02;
/// By how much the squared speeds of another solution are lowered until they are within the limits, how often at most, and
/// the share of the duration that the barrier may cost at first.
const WARM_STEP: f64 = 0.98;
const WARM_STEPS: usize = 10;
const WARM_GAP: f64 = 0.03;
/// Shortest step of a line search.
const SHORTEST_STEP: f64 = 1e-7;

/// Adds `-ln(up) - ln(down)` of a value with row `w` in two unknowns.
fn two_sided(g: &mut [f64; 2], s: &mut [f64; 3], w: [f64; 2], up: f64, down: f64) {
    let (slope, bend) = (up - down, up * up + down * down);
    g[0] += slope * w[0];
    g[1] += slope * w[1];
    s[0] += bend * w[0] * w[0];
    s[1] += bend * w[0] * w[1];
    s[2] += bend * w[1] * w[1];
}

/// Gradient and Hessian by (x, x', x'') in terms of three coefficients.
fn spread(
    g: &[f64; 3],
    s: &[f64; 6],
    basis: &[[f64; 3]; 3],
    gradient: &mut [f64; 3],
    hessian: &mut [[f64; 3]; 3],
) {
    let full = [[s[0], s[1], s[2]], [s[1], s[3], s[4]], [s[2], s[4], s[5]]];
    for i in 0..3 {
        gradient[i] += (0..3).map(|r| g[r] * basis[r][i]).sum::<f64>();
        let turned: [f64; 3] = std::array::from_fn(|r| (0..3).map(|t| basis[t][i] * full[t][r]).sum());
        for j in i..3 {
            hessian[i][j] += (0..3).map(|r| turned[r] * basis[r][j]).sum::<f64>();
        }
    }
}

impl Quadratic {
    /// The Newton step in place of the gradient, by the banded Cholesky factors; returns the squared decrement.
    fn solve(&mut self) -> f64 {
        let size = self.gradient.len();
        for k in (0..self.free[0]).chain(self.free[1] + 1..size) {
            self.hessian[k] = [1.0, 0.0, 0.0];
        }
        let wanted = self.gradient.clone();
        let h = &mut self.hessian;
        for k in 0..size {
            // `h[k]` becomes `[pivot, l1, l2]` of LDL^T.
            let [pivot, first, second] = h[k];
            let pivot = pivot.max(f64::MIN_POSITIVE);
            let (l1, l2) = (first / pivot, second / pivot);
            if k + 1 < size {
                h[k + 1][0] -= l1 * first;
                h[k + 1][1] -= l1 * second;
            }
            if k + 2 < size {
                h[k + 2][0] -= l2 * second;
            }
            h[k] = [pivot, l1, l2];
        }
        let x = &mut self.gradient;
        for k in 0..size {
            let value = x[k];
            if k + 1 < size {
                x[k + 1] -= h[k][1] * value;
            }
            if k + 2 < size {
                x[k + 2] -= h[k][2] * value;
            }
        }
        for k in (0..size).rev() {
            let mut value = x[k] / h[k][0];
            if k + 1 < size {
                value -= h[k][1] * x[k + 1];
            }
            if k + 2 < size {
                value -= h[k][2] * x[k + 2];
            }
            x[k] = value;
        }
        wanted.iter().zip(x.iter()).map(|(g, d)| g * d).sum()
    }
}

/// Points and weights of Gauss's rule of five points on (0, 1).
const GAUSS: [[f64; 2]; 5] = [
    [0.046_910_077_030_668_0, 0.118_463_442_528_094_5],
    [0.230_765_344_947_158_4, 0.239_314_335_249_683_2],
    [0.5, 0.284_444_444_444_444_4],
    [0.769_234_655_052_841_6, 0.239_314_335_249_683_2],
    [0.953_089_922_969_332, 0.118_463_442_528_094_5],
];

/// The fastest law over a stretch, `None` where the barrier finds no inside. `known` holds the coefficients that were found
/// with nearly the same limits, then those found now.
pub(super) fn fastest(
    stretch: &Stretch,
    limits: &NodeLimits,
    (settings, jerk): (&RetimeSettings, &[f64]),
    rest: [bool; 2],
    share: &[f64],
    known: &mut Option<Vec<f64>>,
) -> Option<JerkLaw> {
    let nodes = Nodes::new(stretch, limits, rest);
    let barrier = Barrier::new(&nodes, limits, settings, jerk, rest, share);
    let c = barrier.solve(known.as_deref())?;
    let (n, last) = (nodes.n, nodes.h.len());
    let mut law = JerkLaw { nodes: Vec::new(), qd: Vec::new(), qdd: Vec::new() };
    let mut t = 0.0;
    for k in 0..=last {
        let [x, dx] = barrier.at(&c, k);
        law.nodes.push(LawNode { t });
        for i in k * n..(k + 1) * n {
            law.qd.push(nodes.first[i] * x.sqrt());
            law.qdd.push(nodes.second[i] * x + 0.5 * nodes.first[i] * dx);
        }
        if k < last {
            let h = nodes.h[k];
            let bend = (barrier.at(&c, k + 1)[1] - dx) / h;
            let speed = |u: f64| (x + u * h * (dx + 0.5 * u * h * bend)).sqrt();
            t += GAUSS.iter().map(|[at, weight]| weight * h / speed(*at)).sum::<f64>();
        }
    }
    *known = Some(c);
    Some(law)
}
