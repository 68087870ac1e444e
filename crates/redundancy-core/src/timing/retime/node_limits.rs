//! What the limits say at the nodes of a stretch.
//!
//! Each limit is linear in the squared speed `x = sigma'^2` and the acceleration `u = sigma''` of the parameter:
//! `qdd = q' u + q'' x` and `tau = m u + d x + g` [BobrowDubowskyGibson1985].
//!
//! Limits of velocity and acceleration bound `x` and `u` by themselves. A torque limit that no such `x` and `u` reaches is
//! left out of the search, and between nodes where all torques stay far below their limits they are not looked at again.

use nalgebra::Vector3;

use super::settings::RetimeSettings;
use super::stretch::Stretch;
use crate::chain::Chain;
use crate::error::{Error, Result};
use crate::kinematics::{DynamicsScratch, Scratch};
use crate::parallel::prelude::*;
use crate::timing::speed::SPEED_CAP;
use crate::tolerance::TORQUE_LEFT;

/// Nodes that one task of the pool takes at least; for one task alone the pool is not woken.
const NODES_PER_TASK: usize = 128;

/// Share of a torque limit up to which the torques at the nodes, or those and one check between them, decide.
pub(super) const FAR_BELOW: f64 = 0.95;

/// What the limits say at the nodes.
#[derive(Debug, Clone)]
pub(super) struct NodeLimits {
    /// Largest squared speed at each node from the velocities of joints and tool.
    pub most: Vec<f64>,
    /// Torques per acceleration, per squared speed, and of gravity, node by node; empty without torque limits.
    pub inertial: Vec<f64>,
    pub dynamic: Vec<f64>,
    pub gravity: Vec<f64>,
    /// Whether a motion within the other limits may exceed this torque limit, node by node; empty without torque limits.
    pub matters: Vec<bool>,
    /// Lengths of the intervals, and how the three parts of the torques bend at the nodes.
    lengths: Vec<f64>,
    bends: [Vec<f64>; 3],
    /// Whether in this interval the torques of every motion within the other limits are far below their limits.
    pub calm: Vec<bool>,
}

impl NodeLimits {
    pub fn new(chain: &Chain, stretch: &Stretch, settings: &RetimeSettings) -> Result<Self> {
        let (n, nodes) = (stretch.n, stretch.nodes());
        let mut most = vec![f64::INFINITY; nodes];
        let mut scratch = Scratch::new(chain);
        for k in 0..nodes {
            let (q, d) = (&stretch.q[k * n..][..n], &stretch.d[k * n..][..n]);
            for j in 0..n {
                most[k] = most[k].min((settings.velocity_limits[j] / d[j]).powi(2));
            }
            if let Some(speed) = settings.tool_speed {
                let kinematics = chain.kinematics_unchecked(q, &mut scratch);
                let columns = kinematics.jacobian();
                let moved: Vector3<f64> = (0..n).map(|j| columns.fixed_view::<3, 1>(0, j) * d[j]).sum();
                most[k] = most[k].min(speed * speed / moved.norm_squared());
            }
        }
        let [inertial, dynamic, gravity] = std::array::from_fn(|_| Vec::new());
        let (lengths, bends) = (Vec::new(), std::array::from_fn(|_| Vec::new()));
        let mut out =
            Self { most, inertial, dynamic, gravity, matters: Vec::new(), lengths, bends, calm: Vec::new() };
        if let Some(torque) = &settings.torque_limits {
            out.add_torques(chain, stretch, &settings.gravity)?;
            out.add_bends(&stretch.s, stretch.n);
            out.sort_out(stretch, &settings.acceleration_limits, torque);
        }
        Ok(out)
    }

    fn add_torques(&mut self, chain: &Chain, stretch: &Stretch, gravity: &Vector3<f64>) -> Result<()> {
        let (n, bodies) = (stretch.n, chain.masses()?);
        for values in [&mut self.inertial, &mut self.dynamic, &mut self.gravity] {
            *values = vec![0.0; stretch.q.len()];
        }
        let one = |scratch: &mut DynamicsScratch, motion: [&[f64]; 3], out: [&mut [f64]; 3]| {
            chain.path_torques(bodies, motion, gravity, scratch, out);
        };
        let [q, d, dd] = [&stretch.q, &stretch.d, &stretch.dd];
        if stretch.nodes() < 2 * NODES_PER_TASK {
            let mut scratch = DynamicsScratch::new(chain);
            let motion = q.chunks_exact(n).zip(d.chunks_exact(n)).zip(dd.chunks_exact(n));
            let out = self.gravity.chunks_exact_mut(n).zip(self.dynamic.chunks_exact_mut(n));
            for (((q, d), dd), ((weight, dynamic), inertial)) in
                motion.zip(out.zip(self.inertial.chunks_exact_mut(n)))
            {
                one(&mut scratch, [q, d, dd], [weight, dynamic, inertial]);
            }
            return Ok(());
        }
        let motion = q.par_chunks_exact(n).zip(d.par_chunks_exact(n)).zip(dd.par_chunks_exact(n));
        let out = self.gravity.par_chunks_exact_mut(n).zip(self.dynamic.par_chunks_exact_mut(n));
        let all = motion.zip(out.zip(self.inertial.par_chunks_exact_mut(n))).with_min_len(NODES_PER_TASK);
        all.for_each_init(
            || DynamicsScratch::new(chain),
            |scratch, (((q, d), dd), ((weight, dynamic), inertial))| {
                one(scratch, [q, d, dd], [weight, dynamic, inertial]);
            },
        );
        Ok(())
    }

    /// Finds the torque limits that matter, and the intervals in which none does.
    fn sort_out(&mut self, stretch: &Stretch, acceleration: &[f64], torque: &[f64]) {
        let (n, nodes) = (stretch.n, stretch.nodes());
        let speed = |k: usize| self.most[k].min(SPEED_CAP);
        // The largest |u| at each node: every joint bounds it.
        let push: Vec<f64> = (0..nodes)
            .map(|k| {
                let at = k * n..(k + 1) * n;
                let rows = stretch.d[at.clone()].iter().zip(&stretch.dd[at]).zip(acceleration);
                rows.map(|((d, dd), most)| (most + dd.abs() * speed(k)) / d.abs())
                    .fold(f64::INFINITY, f64::min)
            })
            .collect();
        // What a motion within the other limits may use of each limit, and what gravity leaves of it.
        let (mut reached, mut room) = (vec![0.0; nodes * n], vec![0.0; nodes * n]);
        for k in 0..nodes {
            let at = k * n..(k + 1) * n;
            let parts = self.inertial[at.clone()]
                .iter()
                .zip(&self.dynamic[at.clone()])
                .zip(&self.gravity[at.clone()]);
            let out = reached[at.clone()].iter_mut().zip(&mut room[at]);
            for (((m, d), g), ((reached, room), torque)) in parts.zip(out.zip(torque)) {
                *reached = m.abs() * push[k] + d.abs() * speed(k);
                *room = torque - g.abs();
            }
        }
        // Not a number where nothing else bounds the motion: such a limit matters.
        let matters =
            |(reached, room): (&f64, &f64)| room.is_finite() && (reached > room || reached.is_nan());
        self.matters = reached.iter().zip(&room).map(matters).collect();
        self.calm = vec![false; nodes - 1];
        if nodes < 3 {
            return;
        }
        for k in 0..nodes - 1 {
            let most = [push[k].min(push[k + 1]), speed(k).max(speed(k + 1))];
            let calm = (0..n).all(|j| {
                let (a, b) = (k * n + j, (k + 1) * n + j);
                let top = reached[a].max(reached[b]) + self.bend(n, k, j, most);
                top <= FAR_BELOW * room[a].min(room[b])
            });
            self.calm[k] = calm;
        }
    }

    /// How the torques bend along the path: second derivatives by its length, from divided differences; 0 at both ends.
    fn add_bends(&mut self, s: &[f64], n: usize) {
        self.lengths = s.windows(2).map(|pair| pair[1] - pair[0]).collect();
        for (values, out) in [&self.inertial, &self.dynamic, &self.gravity].into_iter().zip(&mut self.bends) {
            *out = vec![0.0; values.len()];
            for k in 1..s.len().saturating_sub(1) {
                let [before, behind] = [self.lengths[k - 1], self.lengths[k]];
                let both = 2.0 / (before + behind);
                let [a, c] = [both / before, both / behind];
                let values = &values[(k - 1) * n..(k + 2) * n];
                for (j, out) in out[k * n..(k + 1) * n].iter_mut().enumerate() {
                    let [from, here, to] = [values[j], values[n + j], values[2 * n + j]];
                    *out = (a * (from - here) + c * (to - here)).abs();
                }
            }
        }
    }

    /// By how much the torque of joint `j` may leave the straight line between the nodes of interval `k`, for `|u|` and `x`
    /// up to these. There are at least three nodes.
    #[inline(always)]
    fn bend(&self, n: usize, k: usize, j: usize, [push, fastest]: [f64; 2]) -> f64 {
        let length = self.lengths[k];
        let (a, b) = (k.max(1) * n + j, (k + 1).min(self.lengths.len() - 1) * n + j);
        let [inertial, dynamic, gravity] = [0, 1, 2].map(|part| self.bends[part][a].max(self.bends[part][b]));
        // x is linear in s: twice the product of its slope 2 u and that of its factor.
        let slopes = 0.5 * length * push * (self.dynamic[(k + 1) * n + j] - self.dynamic[k * n + j]).abs();
        0.125 * length * length * (inertial * push + dynamic * fastest + gravity) + slopes
    }

    /// Whether the torques of a motion with `u` and with these `x` at the nodes of interval `k` are far below their limits.
    pub fn far_below(&self, n: usize, k: usize, u: f64, x: [f64; 2], torque: &[f64]) -> bool {
        self.lengths.len() > 1
            && torque.iter().enumerate().all(|(j, limit)| {
                let bend = self.bend(n, k, j, [u.abs(), x[0].max(x[1])]);
                [0, 1].into_iter().all(|end| {
                    let i = (k + end) * n + j;
                    let moving = self.inertial[i] * u + self.dynamic[i] * x[end];
                    let gravity = self.gravity[i];
                    moving + bend <= FAR_BELOW * (limit - gravity)
                        && bend - moving <= FAR_BELOW * (limit + gravity)
                })
            })
    }

    /// The same without torques.
    pub fn without_torques(&self) -> Self {
        let none = || Vec::new();
        Self {
            most: self.most.clone(),
            inertial: none(),
            dynamic: none(),
            gravity: none(),
            matters: Vec::new(),
            lengths: none(),
            bends: [none(), none(), none()],
            calm: Vec::new(),
        }
    }

    /// Gravity alone must leave torque at every joint.
    pub fn check_gravity(&self, chain: &Chain, stretch: &Stretch, settings: &RetimeSettings) -> Result<()> {
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
