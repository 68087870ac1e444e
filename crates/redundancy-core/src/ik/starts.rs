//! Starts for the numeric solver: stored configurations, ranked by the error that remains with the best end joints.
//!
//! The best value of one joint has an analytic answer (the sub-problem of [FromGravdahl2007, section 5]). Applied to the
//! first and to the last joint of a stored configuration it makes two of the six coordinates of a pose vanish from the
//! comparison: turning joint 1 brings the stored point to the azimuth of the target, turning the last joint matches
//! the spin about its axis. What remains of a pose is where a point P of the last axis is, in cylindrical coordinates
//! about axis 1 without the azimuth, and the direction of the last axis in radial, tangential and axial components: five
//! numbers on a set of four dimensions, which a few thousand configurations of the inner joints cover densely.
//!
//! A chain whose first or last joint slides is compared without that reduction, a task with fewer coordinates by those
//! that count.

use nalgebra::{Matrix3, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use wide::f32x8;

use crate::chain::Chain;
use crate::joint_space::{TURN, difference, within, wrap, wrap_lanes};
use crate::kinematics::{Scratch, Task, TaskKind};
use crate::pose::Pose;
use std::f64::consts::PI;

/// Entries that are compared at a time.
const LANES: usize = 8;
/// Most numbers that describe a pose.
const FEATURES: usize = 9;

/// What the first joint does to the features.
#[derive(Debug, Clone, Copy)]
struct Turntable {
    /// A point on axis 1.
    origin: Vector3<f64>,
    /// `[x, y, k]`, k along axis 1.
    frame: Matrix3<f64>,
}

/// The stored configurations of one solver.
#[derive(Debug, Clone)]
pub(super) struct Starts {
    /// Joint 1 turns and its angle is chosen by azimuth.
    first: Option<Turntable>,
    /// The last joint turns about an axis of the tool that is free in the comparison: the axis in the tool frame.
    last: Option<Vector3<f64>>,
    /// The point of the tool that is compared.
    point: Vector3<f64>,
    /// The directions of the tool that are compared (none, one or two).
    directions: Vec<Vector3<f64>>,
    /// How many features count.
    count: usize,
    /// Radians that a metre counts.
    scale: f64,
    /// Configurations, `(N, n)`.
    q: Vec<f64>,
    /// Azimuth of each point about axis 1 at joint 1 = 0.
    azimuth: Vec<f64>,
    /// The same in single precision, for the score.
    azimuth_lanes: Vec<[f32; LANES]>,
    /// Middle and half-width of the range of joint 1 where it is less than a turn.
    sector: Option<[f64; 2]>,
    /// Features of eight entries at a time: block, feature, lane.
    features: Vec<f32>,
    n: usize,
    /// Only x, y and the heading count.
    planar: bool,
}

/// The range from which starts of one joint are drawn: its limits, or a turn within them that is nearest to zero.
pub(super) fn range(lower: f64, upper: f64, rotational: bool) -> [f64; 2] {
    let width = if rotational { TURN } else { 2.0 };
    if upper - lower <= width {
        return [lower, upper];
    }
    let low = (-0.5 * width).clamp(lower, (upper - width).max(lower));
    [low, (low + width).min(upper)]
}

impl Starts {
    /// Draws `count` configurations (rounded up to a multiple of eight).
    pub fn new(chain: &Chain, task: &Task, whole_orientation: bool, count: usize, scale: f64) -> Self {
        let n = chain.dof();
        let mut scratch = Scratch::new(chain);
        let middle: Vec<f64> = ranges(chain).map(|[lo, hi]| 0.5 * (lo + hi)).collect();
        let home = chain.kinematics_unchecked(&middle, &mut scratch);
        let planar = matches!(task.kind(), TaskKind::Planar | TaskKind::PlanarPose);
        let turns = |i: usize| chain.steps()[i].rotational;
        let spans = |i: usize, least: f64| chain.upper()[i] - chain.lower()[i] >= least;
        let first = (n > 1 && turns(0) && spans(0, PI) && !planar).then(|| {
            let k = home.axes()[0].normalize();
            Turntable { origin: home.origins()[0], frame: crate::chain::axis_onto_z(&k) }
        });
        let to_tool = |v: &Vector3<f64>| home.pose().rotation.inverse() * v;
        let last_axis = to_tool(&home.axes()[n - 1]);
        // With a narrow range the limit would forbid most matches.
        let spins = n > 2 && turns(n - 1) && spans(n - 1, 1.5 * PI) && whole_orientation;
        let last = spins.then_some(last_axis);
        // A point that the last joint does not move, where its angle is left out of the comparison.
        let point = match last {
            Some(_) => home.pose().inverse_transform_point(&home.origins()[n - 1].into()).coords,
            None => Vector3::zeros(),
        };
        let directions = match task.kind() {
            _ if spins => vec![last_axis],
            _ if whole_orientation => vec![Vector3::z(), Vector3::x()],
            TaskKind::Pointing => vec![task.axis().into_inner()],
            TaskKind::PlanarPose => vec![Vector3::x()],
            _ => Vec::new(),
        };
        let count = count.div_ceil(LANES) * LANES;
        let mut starts = Self {
            first,
            last,
            point,
            count: 3 + 3 * directions.len(),
            directions,
            scale,
            q: Vec::with_capacity(count * n),
            azimuth: Vec::with_capacity(count),
            azimuth_lanes: Vec::new(),
            sector: (chain.upper()[0] - chain.lower()[0] < TURN).then(|| {
                let (lo, hi) = (chain.lower()[0], chain.upper()[0]);
                [0.5 * (lo + hi), 0.5 * (hi - lo)]
            }),
            features: Vec::new(),
            n,
            planar,
        };
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut all = Vec::with_capacity(count);
        for _ in 0..count {
            for (i, [lo, hi]) in ranges(chain).enumerate() {
                let free = (i == 0 && starts.first.is_some()) || (i == n - 1 && starts.last.is_some());
                let value = if free { 0.0_f64.clamp(lo, hi) } else { lo + (hi - lo) * rng.random::<f64>() };
                starts.q.push(value);
            }
            let q = &starts.q[starts.q.len() - n..];
            let (features, azimuth) = starts.describe(&chain.forward_unchecked(q));
            starts.azimuth.push(if starts.first.is_some() { azimuth - q[0] } else { 0.0 });
            all.push(features);
        }
        starts.sector = starts.sector.filter(|_| starts.first.is_some());
        starts.azimuth_lanes =
            starts.azimuth.as_chunks::<LANES>().0.iter().map(|block| block.map(|a| a as f32)).collect();
        for block in all.chunks(LANES) {
            for k in 0..starts.count {
                starts.features.extend(block.iter().map(|f| f[k]));
            }
        }
        starts
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.azimuth.len()
    }

    /// Features of a pose, and its azimuth about axis 1.
    fn describe(&self, pose: &Pose) -> ([f32; FEATURES], f64) {
        let rotation = pose.rotation.matrix();
        let point = rotation * self.point + pose.translation.vector;
        let mut out = [0.0; FEATURES];
        let mut azimuth = 0.0;
        let turned = match &self.first {
            None => {
                out[..3].copy_from_slice(
                    &[point.x, point.y, if self.planar { 0.0 } else { point.z }]
                        .map(|x| (x * self.scale) as f32),
                );
                Matrix3::identity()
            }
            Some(table) => {
                let local = table.frame.tr_mul(&(point - table.origin));
                let radius = (local.x * local.x + local.y * local.y).sqrt();
                let (c, s) = if radius > f64::MIN_POSITIVE {
                    (local.x / radius, local.y / radius)
                } else {
                    (1.0, 0.0)
                };
                azimuth = s.atan2(c);
                (out[0], out[1]) = ((radius * self.scale) as f32, (local.z * self.scale) as f32);
                // Rz(-azimuth) F^T
                let f = &table.frame;
                let x = f.column(0) * c + f.column(1) * s;
                let y = f.column(1) * c - f.column(0) * s;
                Matrix3::from_columns(&[x, y, f.column(2).into()]).transpose()
            }
        };
        for (k, direction) in self.directions.iter().enumerate() {
            let mut d = turned * (rotation * direction);
            if self.planar {
                d.z = 0.0;
            }
            for j in 0..3 {
                out[3 + 3 * k + j] = d[j] as f32;
            }
        }
        (out, azimuth)
    }

    /// Scores all entries against a target into `scores` and returns the azimuth of the target.
    pub fn score(&self, target: &Pose, scores: &mut [f32]) -> f64 {
        let (wanted, azimuth) = self.describe(target);
        let size = LANES * self.count;
        for (block, out) in self.features.chunks_exact(size).zip(scores.as_chunks_mut::<LANES>().0) {
            let mut sum = f32x8::splat(0.0);
            for (lane, want) in block.as_chunks::<LANES>().0.iter().zip(wanted) {
                let d = f32x8::from(*lane) - f32x8::splat(want);
                sum = d.mul_add(d, sum);
            }
            *out = sum.to_array();
        }
        if let Some([middle, half]) = self.sector {
            // What joint 1 would be outside of its limits.
            let (wanted, half) = (f32x8::splat((azimuth - middle) as f32), f32x8::splat(half as f32));
            for (a, out) in self.azimuth_lanes.iter().zip(scores.as_chunks_mut::<LANES>().0) {
                let away = wrap_lanes(wanted - f32x8::from(*a)).abs();
                let excess = (away - half).max(f32x8::splat(0.0));
                *out = excess.mul_add(excess, f32x8::from(*out)).to_array();
            }
        }
        azimuth
    }

    /// Index of the least score; the entry is struck off.
    pub fn take_best(&self, scores: &mut [f32]) -> usize {
        let mut best = f32x8::splat(f32::INFINITY);
        let mut index = f32x8::splat(0.0);
        for (i, block) in scores.as_chunks::<LANES>().0.iter().enumerate() {
            let x = f32x8::from(*block);
            let less = x.simd_lt(best);
            best = less.select(x, best);
            index = less.select(f32x8::splat(i as f32), index);
        }
        let (best, index) = (best.to_array(), index.to_array());
        let lane = (0..LANES).min_by(|a, b| best[*a].total_cmp(&best[*b])).unwrap_or(0);
        let entry = index[lane] as usize * LANES + lane;
        scores[entry] = f32::INFINITY;
        entry
    }

    /// Writes entry `i` with its end joints at their best for `target`. False where a limit forbids that value: it is
    /// then at the limit.
    pub fn write(&self, chain: &Chain, i: usize, target: &Pose, azimuth: f64, q: &mut [f64]) -> bool {
        q.copy_from_slice(&self.q[i * self.n..(i + 1) * self.n]);
        let mut free = true;
        if self.first.is_some() {
            free &= place(&mut q[0], azimuth - self.azimuth[i], chain.lower()[0], chain.upper()[0]);
        }
        if let Some(axis) = &self.last {
            // The sub-problem for the orientation alone: psi = atan2(n . sum r_i x rd_i, tr M - n M n), M = R Rd^T.
            let pose = chain.forward_unchecked(q);
            let n = pose.rotation * axis;
            let (mut cross, mut trace) = (Vector3::zeros(), 0.0);
            let (from, to) = (pose.rotation.matrix(), target.rotation.matrix());
            for j in 0..3 {
                let (a, b): (Vector3<f64>, Vector3<f64>) = (from.column(j).into(), to.column(j).into());
                cross += a.cross(&b);
                trace += a.dot(&b);
            }
            let along = (from.tr_mul(&n)).dot(&to.tr_mul(&n));
            let psi = n.dot(&cross).atan2(trace - along);
            let last = self.n - 1;
            let value = q[last] + psi;
            free &= place(&mut q[last], value, chain.lower()[last], chain.upper()[last]);
        }
        free
    }
}

/// The winding of `value` nearest to zero within the limits; the limit that is nearest where there is none.
fn place(q: &mut f64, value: f64, lower: f64, upper: f64) -> bool {
    let value = wrap(value);
    if let Some(wound) = within(value, lower, upper) {
        *q = wound;
        return true;
    }
    let away = |limit: f64| difference(limit, value).abs();
    *q = if away(lower) < away(upper) { lower } else { upper };
    false
}

/// Ranges of all joints from which starts are drawn.
pub(super) fn ranges(chain: &Chain) -> impl Iterator<Item = [f64; 2]> {
    let limits = chain.lower().iter().zip(chain.upper());
    limits.zip(chain.steps()).map(|((lo, hi), step)| range(*lo, *hi, step.rotational))
}
