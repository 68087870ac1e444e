//! A stretch of a joint path between two stops: the cubic spline through its rows over the length of their chords in joint
//! space, with not-a-knot ends.

use crate::path::knot_derivatives;
use crate::tolerance::{RETIME_NODES, RETIME_TURN, RETIME_TURN_PARTS};

/// What a node is to the path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Origin {
    /// The row of the path that it is, or that it stands for within a blend.
    pub row: Option<usize>,
    /// It lies on the curve that replaces a corner.
    pub blended: bool,
}

impl Origin {
    /// A node between two rows of the path.
    pub const BETWEEN: Self = Self { row: None, blended: false };

    /// A row of the path.
    pub const fn path(row: usize) -> Self {
        Self { row: Some(row), blended: false }
    }
}

/// Nodes of a stretch and the derivatives of the joints by the chord length at them.
#[derive(Debug, Clone)]
pub(super) struct Stretch {
    pub n: usize,
    /// Chord length at each node, rad.
    pub s: Vec<f64>,
    /// What each node is to the path.
    pub origin: Vec<Origin>,
    pub q: Vec<f64>,
    pub d: Vec<f64>,
    pub dd: Vec<f64>,
    /// Third derivative between each node and the next.
    pub ddd: Vec<f64>,
}

impl Stretch {
    /// The curve through `rows` (at least two, no two neighbours equal), which are rows `first..` of the path; with more
    /// nodes where they are sparse, if wanted.
    pub fn new(rows: &[f64], n: usize, first: usize, nodes_between: bool) -> Self {
        let count = rows.len() / n;
        let mut s = vec![0.0; count];
        for k in 1..count {
            let chord: f64 = (0..n).map(|j| (rows[k * n + j] - rows[(k - 1) * n + j]).powi(2)).sum();
            s[k] = s[k - 1] + chord.sqrt();
        }
        let (d, dd) = knot_derivatives(&s, rows, n);
        let third = |k: usize, j: usize| (dd[(k + 1) * n + j] - dd[k * n + j]) / (s[k + 1] - s[k]);
        let parts = if nodes_between { parts(rows, n) } else { vec![1; count - 1] };
        let mut out = Self::empty(n);
        let nodes = parts.iter().sum::<usize>() + 1;
        for values in [&mut out.q, &mut out.d, &mut out.dd, &mut out.ddd] {
            values.reserve_exact(nodes * n);
        }
        out.s.reserve_exact(nodes);
        out.origin.reserve_exact(nodes);
        for k in 0..count {
            let here = k * n..(k + 1) * n;
            out.push(s[k], Origin::path(first + k), &rows[here.clone()], &d[here.clone()], &dd[here]);
            if k + 1 == count {
                break;
            }
            for part in 1..parts[k] {
                let h = (s[k + 1] - s[k]) * part as f64 / parts[k] as f64;
                for j in 0..n {
                    let (q, d, dd, ddd) = (rows[k * n + j], d[k * n + j], dd[k * n + j], third(k, j));
                    out.q.push(q + h * (d + h * (dd / 2.0 + h * ddd / 6.0)));
                    out.d.push(d + h * (dd + h * ddd / 2.0));
                    out.dd.push(dd + h * ddd);
                }
                out.s.push(s[k] + h);
                out.origin.push(Origin::BETWEEN);
            }
            for _ in 0..parts[k] {
                out.ddd.extend((0..n).map(|j| third(k, j)));
            }
        }
        out
    }

    /// Without nodes.
    pub fn empty(n: usize) -> Self {
        let [s, q, d, dd, ddd] = std::array::from_fn(|_| Vec::new());
        Self { n, s, origin: Vec::new(), q, d, dd, ddd }
    }

    /// Adds a node; the third derivative of the interval before it is the caller's.
    pub fn push(&mut self, s: f64, origin: Origin, q: &[f64], d: &[f64], dd: &[f64]) {
        self.s.push(s);
        self.origin.push(origin);
        self.q.extend_from_slice(q);
        self.d.extend_from_slice(d);
        self.dd.extend_from_slice(dd);
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.s.len()
    }

    /// Length of the curve, rad.
    pub fn length(&self) -> f64 {
        self.s.last().copied().unwrap_or(0.0)
    }

    /// The joints and their first two derivatives at a length.
    pub fn at(&self, s: f64) -> [Vec<f64>; 3] {
        let (n, last) = (self.n, self.nodes() - 1);
        let k = self.s.partition_point(|node| *node <= s).clamp(1, last) - 1;
        let h = s - self.s[k];
        let third = |j: usize| self.ddd[k * n + j];
        let each = |of: &dyn Fn(usize, usize) -> f64| (0..n).map(|j| of(k * n + j, j)).collect();
        [
            each(&|i, j| self.q[i] + h * (self.d[i] + h * (self.dd[i] / 2.0 + h * third(j) / 6.0))),
            each(&|i, j| self.d[i] + h * (self.dd[i] + h * third(j) / 2.0)),
            each(&|i, j| self.dd[i] + h * third(j)),
        ]
    }

    /// The joint direction when all rows lie on one line; then the time law has a closed form.
    pub fn straight(&self, tolerance: f64) -> Option<Vec<f64>> {
        let (n, last) = (self.n, self.nodes() - 1);
        let length: f64 = (0..n).map(|j| (self.q[last * n + j] - self.q[j]).powi(2)).sum::<f64>().sqrt();
        let direction: Vec<f64> = (0..n).map(|j| (self.q[last * n + j] - self.q[j]) / length).collect();
        let on_line = |k: usize| {
            (0..n).all(|j| (self.q[k * n + j] - self.q[j] - self.s[k] * direction[j]).abs() <= tolerance)
        };
        (0..=last).all(on_line).then_some(direction)
    }
}

/// Into how many parts each interval between rows is cut. A motion needs some nodes to speed up and slow down on; and where
/// the path turns much from row to row a cubic in time between them is slower than the path allows.
fn parts(rows: &[f64], n: usize) -> Vec<usize> {
    let intervals = rows.len() / n - 1;
    let least = RETIME_NODES.div_ceil(intervals).max(1);
    let step = |k: usize, j: usize| rows[(k + 1) * n + j] - rows[k * n + j];
    let length = |k: usize| (0..n).map(|j| step(k, j).powi(2)).sum::<f64>().sqrt();
    let turn = |k: usize| {
        let [a, b] = [length(k - 1), length(k)];
        (0..n).map(|j| (step(k, j) / b - step(k - 1, j) / a).powi(2)).sum::<f64>().sqrt()
    };
    let mut out = vec![least; intervals];
    for k in 1..intervals {
        let wanted = ((turn(k) / RETIME_TURN).ceil() as usize).min(RETIME_TURN_PARTS);
        // The neighbours too: the length of the intervals should not change at once.
        for near in &mut out[k.saturating_sub(TURN_WIDTH)..(k + TURN_WIDTH).min(intervals)] {
            *near = wanted.max(*near);
        }
    }
    out
}

/// Intervals to either side of a turn that are cut with it.
const TURN_WIDTH: usize = 4;
