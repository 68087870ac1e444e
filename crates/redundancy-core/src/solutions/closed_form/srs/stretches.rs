//! The circles cut into stretches on which every joint is monotone, and their samples.
//!
//! The cuts are the zeros of the joints' rates (see `optimum.rs`); those of one elbow sign serve all of its branches.

use std::f64::consts::{FRAC_PI_2, PI};

use super::circle::SelfMotion;
use super::elbow_circle::{ElbowCircle, Node, signs};
use super::spherical::{Spherical, sphericals};
use crate::joint_space::{TURN, monotone, turned};

/// Seven joints and a lane of padding: loops over it become whole vectors.
pub(super) type Row = [f64; 8];

/// A [`Row`] that ends with `padding`.
pub(super) fn row(joints: &[f64; 7], padding: f64) -> Row {
    let mut out = [padding; 8];
    out[..7].copy_from_slice(joints);
    out
}

/// One branch at a swivel; joint values are unwound by the caller.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    pub(super) s: f64,
    pub(super) q: Row,
    pub(super) rate: Row,
    /// As in [`Node`].
    pub(super) cosine: [f64; 2],
    /// As in [`Node`].
    pub(super) cosine_rate: [f64; 2],
}

/// A stretch of a feasible arc between neighbouring cuts, or a touching point (equal ends), before it is evaluated.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stretch {
    pub(super) branch: usize,
    pub(super) lo: f64,
    pub(super) hi: f64,
    /// The cut before `lo`, counted over one turn.
    pub(super) cut: usize,
}

/// The cuts of one elbow sign.
pub(super) struct Elbow {
    pub(super) joints: [Spherical; 2],
    /// The swivels at which a joint stops being monotone, in `(-pi, pi]`.
    pub(super) nodes: Vec<Node>,
    /// The cuts at extrema of the rates, twice around, computed when the first piece asks for them.
    pub(super) rate_cuts: Option<Vec<f64>>,
}

impl SelfMotion {
    /// Which of [`SelfMotion::elbows`] a branch belongs to.
    pub(super) fn elbow_of(&self, branch: usize) -> usize {
        usize::from(signs(branch)[1] < 0 && !self.arm.inner.geometry.aligned)
    }

    /// The elbow signs that have their own cuts: without an elbow offset the other elbow turns joints 3 and 5 by pi.
    pub(super) fn elbows(&self) -> Vec<Elbow> {
        let geometry = &self.arm.inner.geometry;
        let signs: &[f64] = if geometry.aligned { &[1.0] } else { &[1.0, -1.0] };
        let elbow = |sign: &f64| {
            let joints = sphericals(geometry, &self.circle, *sign);
            let mut cuts = Vec::with_capacity(16);
            joints.iter().for_each(|joint| joint.push_monotone_cuts(&mut cuts));
            if cuts.len() < 2 {
                // Nothing but steady turns: keep the pieces below half a turn.
                cuts.extend([-PI, -FRAC_PI_2, 0.0, FRAC_PI_2]);
            }
            sorted(&mut cuts);
            let nodes = cuts.into_iter().map(|s| self.elbow_node(*sign, s)).collect();
            Elbow { joints, nodes, rate_cuts: None }
        };
        signs.iter().map(elbow).collect()
    }

    /// Calls `visit` for the stretches of every feasible arc on which all joints are monotone, and for touching points.
    pub(super) fn for_each_stretch(&self, elbows: &[Elbow], mut visit: impl FnMut(Stretch)) {
        for branch in self.branch_indices() {
            let nodes = &elbows[self.elbow_of(branch)].nodes;
            let n = nodes.len();
            let at = |i: usize| turned(nodes[i % n].s, (i / n) as f64);
            for [mut lo, mut hi] in self.arcs().of(branch) {
                if hi - lo >= TURN {
                    // A full circle begins anywhere.
                    (lo, hi) = (at(0), at(n));
                }
                let mut i = nodes.partition_point(|n| n.s <= lo);
                loop {
                    let end = at(i);
                    let stretch = Stretch { branch, lo, hi: end.min(hi), cut: (i + n - 1) % n };
                    visit(stretch);
                    if end >= hi {
                        break;
                    }
                    (lo, i) = (end, i + 1);
                }
            }
        }
    }

    pub(super) fn node(&self, branch: usize, s: f64) -> Node {
        let aligned = self.arm.inner.geometry.aligned;
        self.elbow_node(if aligned || signs(branch)[1] > 0 { 1.0 } else { -1.0 }, s)
    }

    pub(super) fn elbow_node(&self, elbow: f64, s: f64) -> Node {
        let (sin, cos) = s.sin_cos();
        self.circle.node(&self.arm.inner.geometry, s, [cos, sin], elbow)
    }

    /// One branch at a node, principal values.
    pub(super) fn sample(&self, branch: usize, node: &Node) -> Sample {
        let geometry = &self.arm.inner.geometry;
        let q = ElbowCircle::branch_of(geometry, &node.angles, branch);
        let [s2, _, s6] = signs(branch).map(f64::from);
        let mut rate = node.rates;
        rate[1] *= s2;
        rate[5] *= s6;
        for i in 0..7 {
            rate[i] *= geometry.sign[i];
        }
        let Node { s, cosine, cosine_rate, .. } = *node;
        Sample { s, q: row(&q, 0.0), rate: row(&rate, 0.0), cosine, cosine_rate }
    }
}

/// The joints of a row.
pub(super) fn joints(row: &Row) -> [f64; 7] {
    std::array::from_fn(|i| row[i])
}

/// Sorted and without repeats.
pub(super) fn sorted(cuts: &mut Vec<f64>) {
    cuts.sort_unstable_by(f64::total_cmp);
    cuts.dedup();
}

/// `b` with the windings that monotone joints reach from `a`.
pub(super) fn follow(a: &Sample, mut b: Sample) -> Sample {
    for i in 0..8 {
        b.q[i] = monotone(a.q[i], b.q[i], a.rate[i] + b.rate[i]);
    }
    b
}
