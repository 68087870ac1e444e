//! Closed-form inverse kinematics of six-joint arms with three parallel axes, all branches.
//!
//! UR3 to UR30, Unitree Z1 and their relatives: axes 2, 3, 4 along m, axes 5 and 6 meeting in C. With `[e, j, k]` (k along
//! axis 1, `e` along `m x k`), `n = e x m`, and b the coordinate of C along m:
//!
//! 1. The pose fixes C. Joints 2, 3, 4 keep its coordinate along m, so joint 1 has to bring it to b. With
//!    `m = cos(l) k + sin(l) j` that is `y = (b - cos(l) C_k) / sin(l)` along j; with rho the distance of C from axis 1 and
//!    `c = +-sqrt(rho^2 - y^2)`, `exp(i q1) = (C_e + i C_j) conj(c + i y) / rho^2`.
//! 2. Joints 2, 3, 4 do not turn m. Seen from the tool, m makes with axis 6 the angle that joint 5 decides:
//!    `cos(m, axis 6) = cos a cos b + sin a sin b cos x` with a, b the angles of m and axis 5 and of axes 5 and 6: a spherical
//!    triangle, x of either sign. Joint 6 brings the two images of m together about axis 6.
//! 3. What is left of the rotation is a turn about m by `q2 + q3 + q4`. It places axis 4 in the plane of n and e, and joints 2
//!    and 3 are those of two links: with `t = axis 4 - axis 2`, `d = |t|`, `P^2 = (d^2 - (L2 - L3)^2)((L2 + L3)^2 - d^2)`:
//!    `tau = +-atan2(P, d^2 - L2^2 - L3^2)`, upper arm along `t conj(L2 + L3 exp(i tau))`.
//!
//! Cosines and sines are carried through, no trigonometric function of a result is evaluated. The four sign pairs of
//! shoulder and wrist run in the four lanes of a vector; eight branches need eight arc tangents of four lanes.
//!
//! # Degenerate poses
//! - Axis 6 along m (the wrist is stretched or folded): only `q2 + q3 + q4 +- q6` is defined. Joint 6 is 0 where the arm then
//!   reaches and holds its limits, else the value nearest to 0 where it does ([`ParallelAxesArm::nearest`]: nearest to the
//!   given one), looked for at [`SINGULAR_WRIST`](crate::tolerance::SINGULAR_WRIST) values and where the elbow is stretched.
//! - C on axis 1 with `b = 0`: joint 1 is free, and 0 or the limit nearest to it is taken (the given value in `nearest`).
//! - The stretched or folded elbow, C at the distance `|y|` from axis 1, and a wrist at its end are one branch each, not two.
//!
//! # References
//! The decomposition is that of `[Hawkins2013]` for the UR arms, for axes at any angles.

use std::sync::Arc;

use nalgebra::{Complex, Matrix3, Vector3};
use wide::f64x4;

use super::geometry::ParallelGeometry;
use crate::chain::Chain;
use crate::error::{Error, Result, check_length};
use crate::joint_space::{TURN, nearest_within, outside, within, wrap, wrap_four, wrap_sum};
use crate::parallel::prelude::*;
use crate::pose::{Pose, checked_pose, pose_from_row_major};
use crate::solutions::closed_form::lanes::{Turns, all};
use crate::solutions::closed_form::polish::polish;
use crate::solutions::{Defect, at, signs};
use crate::tolerance::{
    FOLD_SINE, GIMBAL_SINE, REACH_ROUNDING, SINGULAR_WRIST, SINGULAR_WRIST_ROUNDING, SINGULAR_WRIST_SINE,
};

/// Poses that one task of the pool takes at least.
const TASK: usize = 64;

/// A recognised six-joint arm with three parallel axes, and its closed-form inverse kinematics.
///
/// ```
/// use redundancy_core::chain::{ChainBuilder, DhConvention, DhRow};
/// use redundancy_core::solutions::ParallelAxesArm;
/// let row = |a, d, alpha| DhRow { a, d, alpha, theta: 0.0 };
/// let right = std::f64::consts::FRAC_PI_2;
/// let rows = [
///     row(0.0, 0.16, right),
///     row(-0.61, 0.0, 0.0),
///     row(-0.57, 0.0, 0.0),
///     row(0.0, 0.17, right),
///     row(0.0, 0.12, -right),
///     row(0.0, 0.11, 0.0),
/// ];
/// let chain = ChainBuilder::from_dh("six joints", &rows, DhConvention::Standard).build()?;
/// let arm = ParallelAxesArm::new(&chain)?;
/// let q = [0.3, -1.5, 1.2, 1.1, 0.4, 0.7];
/// let all = arm.solve(&chain.forward(&q)?, true)?;
/// assert!(all.iter().any(|p| p.iter().zip(&q).all(|(a, b)| (a - b).abs() < 1e-12)));
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct ParallelAxesArm {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    chain: Chain,
    geometry: ParallelGeometry,
    lower: [f64; 6],
    upper: [f64; 6],
    /// Where the pose leaves them free: direction of joint 1, and of joint 6.
    free: Free,
}

/// Directions of joints 1 and 6 where the pose leaves them free.
#[derive(Debug, Clone, Copy)]
pub(super) struct Free {
    base: [f64; 2],
    hand: [f64; 2],
    /// Sine of the angle of axis 6 against m up to which joint 6 counts as free.
    least: f64,
}

impl Free {
    fn new(q1: f64, q6: f64) -> Self {
        let [base, hand] = [q1, q6].map(|q| [q.cos(), q.sin()]);
        Self { base, hand, least: GIMBAL_SINE }
    }
}

/// What the pose fixes.
pub(super) struct Target {
    /// C along `e, j, k`, from the origin of the arm.
    center: Vector3<f64>,
    /// From the wrist frame at `q = 0`, carried by the tool, to `e, j, k`.
    tool: Matrix3<f64>,
}

/// Joint 1 and what it leaves: C in the plane of the links is at `height + i ahead`.
struct Base {
    turn: Turns,
    ahead: f64x4,
    height: f64,
    /// Rows that are not excluded.
    mask: u8,
    /// By how much C is too near to axis 1, m.
    miss: f64,
    /// C is on axis 1, which leaves joint 1 free.
    on_axis: bool,
}

/// Joint 5 (the angle x of the triangle), joint 6, and the sum of joints 2, 3, 4.
struct Wrist {
    middle: Turns,
    hand: Turns,
    total: Turns,
    /// Sine of the angle of axis 6 against m.
    height: f64x4,
    /// Above 0 where there is no triangle.
    miss: f64x4,
}

/// What was found besides the rows.
#[derive(Clone, Copy)]
struct Found {
    /// Bit `b`: row `b` is a configuration, limits aside.
    mask: u8,
    /// Some wrist is singular or next to it: joint 6 was chosen, or is no better than its rounding.
    singular: bool,
    /// Sine of the angle of axis 6 against m in each lane.
    height: [f64; 4],
    /// Sine of joint 5 from where it turns back, in each lane; NaN where it does not reach.
    middle: [f64; 4],
    /// C is on axis 1: joint 1 was chosen.
    on_axis: bool,
    /// By how much the best arm misses: m between the wrist and what shoulder and elbow reach.
    miss: f64,
}

impl ParallelAxesArm {
    /// Recognises the arm.
    ///
    /// # Errors
    /// [`Error::NotParallelAxes`]: which axes are wrong and by how many millimetres or milliradians.
    pub fn new(chain: &Chain) -> Result<Self> {
        let geometry = ParallelGeometry::recognise(chain)?;
        let (mut lower, mut upper) = ([0.0; 6], [0.0; 6]);
        lower.copy_from_slice(chain.lower());
        upper.copy_from_slice(chain.upper());
        let [q1, q6] = [0, 5].map(|i: usize| 0.0_f64.clamp(lower[i], upper[i]));
        let inner = Inner { chain: chain.clone(), geometry, lower, upper, free: Free::new(q1, q6) };
        Ok(Self { inner: Arc::new(inner) })
    }

    /// The chain that was recognised.
    pub fn chain(&self) -> &Chain {
        &self.inner.chain
    }

    /// How far the arm is from an ideal one: what the closed form returns meets the pose within `1e-12 + 2 x` this.
    pub fn defect(&self) -> Defect {
        self.inner.geometry.defect
    }

    /// Lengths of upper arm and forearm, m: distances of axis 3 from axis 2 and of axis 4 from axis 3.
    pub fn lengths(&self) -> [f64; 2] {
        self.inner.geometry.lengths
    }

    /// Configurations over `pose`, in branch order: with `limits` those within the joint limits, in the winding that
    /// holds them; without, all distinct ones (up to eight) in principal values. Those of an arm with a defect are polished by
    /// Newton's method, here and not in the other methods. Empty when there is none:
    /// [`ParallelAxesArm::configurations`](ParallelAxesArm::configurations) says why.
    ///
    /// # Errors
    /// A pose that is not rigid or finite.
    pub fn solve(&self, pose: &Pose, limits: bool) -> Result<Vec<[f64; 6]>> {
        let pose = &checked_pose("pose", pose)?;
        let mut rows = [[0.0; 6]; 8];
        let mask = self.solve_into(pose, limits, &mut rows);
        let mut rows: Vec<_> = (0..8).filter(|b| mask & (1 << b) != 0).map(|b| rows[b]).collect();
        polish(self.chain(), self.defect(), pose, None, limits, &mut rows);
        Ok(rows)
    }

    /// [`ParallelAxesArm::solve`] for checked input, without allocation: bit `b` of the result says that row `b` of
    /// `out` is a configuration. The other rows are finite but meaningless.
    #[inline]
    pub fn solve_into(&self, pose: &Pose, limits: bool, out: &mut [[f64; 6]; 8]) -> u8 {
        let target = self.target(pose);
        let found = self.branches(&target, &self.inner.free, out);
        if found.singular {
            let wish = 0.0_f64.clamp(self.inner.lower[5], self.inner.upper[5]);
            return self.singular_wrist(&target, &self.inner.free, wish, limits, &found, out);
        }
        if limits { self.mask_limits(found.mask, out) } else { found.mask }
    }

    /// [`ParallelAxesArm::solve_into`] for many poses (`N * 16` numbers, row-major matrices): `N * 8 * 6` joint
    /// values in branch order to `q` and `N * 8` flags to `valid`. The same bits whatever the number of threads.
    ///
    /// # Errors
    /// Wrong lengths, a pose that is not rigid or finite (the message gives its index).
    pub fn solve_batch(&self, poses: &[f64], limits: bool, q: &mut [f64], valid: &mut [bool]) -> Result<()> {
        let n = poses.len() / 16;
        check_length("poses", poses, n * 16)?;
        check_length("q", q, n * 48)?;
        if valid.len() != n * 8 {
            return Err(Error::Length { what: "valid".into(), expected: n * 8, actual: valid.len() });
        }
        let rows = q.as_chunks_mut::<48>().0.par_iter_mut().zip(valid.as_chunks_mut::<8>().0);
        rows.zip(poses.as_chunks::<16>().0).enumerate().with_min_len(TASK).try_for_each(
            |(i, ((q, valid), pose))| {
                let pose = pose_from_row_major(pose).map_err(at(i))?;
                let mut rows = [[0.0; 6]; 8];
                let mask = self.solve_into(&pose, limits, &mut rows);
                q.copy_from_slice(rows.as_flattened());
                *valid = std::array::from_fn(|branch| mask & (1 << branch) != 0);
                Ok(())
            },
        )
    }

    /// The configuration over `pose` within the limits with the least Euclidean distance to `q`, windings included;
    /// `None` when there is none. Where the pose leaves joint 1 or joint 6 free, it stays at its value in `q`, or as near
    /// to it as reach and limits allow.
    ///
    /// # Errors
    /// A pose that is not rigid or finite, a wrong length of `q`, or an entry that is not finite.
    pub fn nearest(&self, pose: &Pose, q: &[f64]) -> Result<Option<[f64; 6]>> {
        let pose = &checked_pose("pose", pose)?;
        self.chain().check_q(q)?;
        Ok(self.nearest_unchecked(pose, q))
    }

    /// [`ParallelAxesArm::nearest`] for checked input; allocates nothing.
    pub(super) fn nearest_unchecked(&self, pose: &Pose, q: &[f64]) -> Option<[f64; 6]> {
        self.nearest_branch(pose, q).map(|(_, near)| near)
    }

    /// [`ParallelAxesArm::nearest_unchecked`] with its branch.
    pub(super) fn nearest_branch(&self, pose: &Pose, q: &[f64]) -> Option<(usize, [f64; 6])> {
        let Inner { lower, upper, .. } = &*self.inner;
        let target = self.target(pose);
        let [q1, q6] = [0, 5].map(|i| q[i].clamp(lower[i], upper[i]));
        let mut rows = [[0.0; 6]; 8];
        let free = Free::new(q1, q6);
        let found = self.branches(&target, &free, &mut rows);
        let mask = if found.singular {
            self.singular_wrist(&target, &free, q6, true, &found, &mut rows)
        } else {
            found.mask
        };
        let mut best: Option<(f64, usize, [f64; 6])> = None;
        for (branch, row) in rows.iter().enumerate().filter(|(b, _)| mask & (1 << b) != 0) {
            let mut near = [0.0; 6];
            let inside = (0..6).all(|i| {
                let wound = nearest_within(row[i], q[i], lower[i], upper[i]);
                near[i] = wound.unwrap_or(row[i]);
                wound.is_some()
            });
            let distance = near.iter().zip(q).map(|(a, b)| (a - b) * (a - b)).sum();
            if inside && best.is_none_or(|(least, ..)| distance < least) {
                best = Some((distance, branch, near));
            }
        }
        best.map(|(_, branch, q)| (branch, q))
    }

    /// [`ParallelAxesArm::nearest`] for many poses, to one `q` for all (6 numbers) or one for each (`N * 6`).
    ///
    /// # Errors
    /// Wrong lengths, a pose that is not rigid or finite, an entry of `q` that is not finite.
    pub fn nearest_batch(&self, poses: &[f64], q: &[f64]) -> Result<Vec<Option<[f64; 6]>>> {
        let n = poses.len() / 16;
        check_length("poses", poses, n * 16)?;
        check_length("q", q, if q.len() == 6 { 6 } else { n * 6 })?;
        let wish = |i: usize| if q.len() == 6 { q } else { &q[6 * i..6 * i + 6] };
        let one = |(i, pose): (usize, &[f64; 16])| {
            let pose = pose_from_row_major(pose).map_err(at(i))?;
            self.nearest(&pose, wish(i)).map_err(at(i))
        };
        poses.as_chunks::<16>().0.par_iter().enumerate().with_min_len(TASK).map(one).collect()
    }

    /// Signs `[shoulder, elbow, wrist]` of a configuration; a zero counts as +. With m along the parallel axes, in the sense
    /// in which C lies beside axis 1: the shoulder is + when C is in front of axis 1 (on the side of `m x k`, k along axis 1);
    /// the elbow is + when the forearm is turned about +m against the upper arm, the wrist when axis 5 is turned so that
    /// joint 5 has to turn back about +axis 5 to bring axis 6 towards m.
    ///
    /// # Errors
    /// Wrong length of `q`, or an entry that is not finite.
    pub fn branch(&self, q: &[f64]) -> Result<[i8; 3]> {
        self.chain().check_q(q)?;
        let g = &self.inner.geometry;
        let [second, third, fourth] = [0, 1, 2].map(|i| g.sign[i] * q[i + 1]);
        let turned = |angle: f64| Complex::from_polar(1.0, angle);
        let upper = g.upper_home * turned(second) * g.lengths[0];
        let fore = g.fore_home * turned(second + third) * g.lengths[1];
        let center = g.shoulder + upper + fore + g.hand * turned(second + third + fourth);
        let elbow = wrap(third + (g.fore_home * g.upper_home.conj()).arg());
        let values = [center.im, elbow, wrap(g.zero5 - q[4])];
        Ok(values.map(|x| if x < 0.0 { -1 } else { 1 }))
    }

    /// Signs `[shoulder, elbow, wrist]` of a branch index.
    pub fn signs(branch: usize) -> [i8; 3] {
        signs(branch)
    }

    #[inline(always)]
    fn target(&self, pose: &Pose) -> Target {
        let g = &self.inner.geometry;
        let rotation = pose.rotation.matrix();
        let center = rotation * g.center_in_tool + pose.translation.vector - g.origin;
        Target { center: g.frame.tr_mul(&center), tool: g.frame.tr_mul(rotation) * g.wrist_in_tool }
    }

    /// Joint 1 for both shoulders, lanes 0, 1 and 2, 3.
    #[inline(always)]
    fn base(&self, center: &Vector3<f64>, free: &Free, slack: f64) -> Base {
        let g = &self.inner.geometry;
        let y = (g.lateral - g.cos_lean * center.z) / g.sin_lean;
        let rho = (center.x * center.x + center.y * center.y).sqrt();
        let on_axis = rho <= slack;
        let side = if on_axis { 0.0 } else { ((rho - y.abs()).max(0.0) * (rho + y.abs())).sqrt() };
        let mut mask = if y.abs() - rho > slack { 0 } else { 0xff };
        if side == 0.0 {
            mask &= 0x0f; // in front is behind
        }
        let ahead = f64x4::new([side, side, -side, -side]);
        let (x, z) = (all(center.x), all(center.y));
        let least = if on_axis { f64::INFINITY } else { 0.0 };
        let turn = Turns::along(x * ahead + z * all(y), z * ahead - x * all(y), least, free.base);
        let height = g.sin_lean * center.z - g.cos_lean * y;
        Base { turn, ahead, height, mask, miss: (y.abs() - rho).max(0.0), on_axis }
    }

    /// The image of m in the wrist frame of the tool.
    #[inline(always)]
    fn image(&self, tool: &Matrix3<f64>, base: Turns) -> [f64x4; 3] {
        let g = &self.inner.geometry;
        let (along, across) = (-base.sin * all(g.sin_lean), base.cos * all(g.sin_lean));
        [0, 1, 2]
            .map(|i| along * all(tool[(0, i)]) + across * all(tool[(1, i)]) + all(g.cos_lean * tool[(2, i)]))
    }

    /// Joints 5 and 6 for both wrists (lanes 0, 2 and 1, 3), and the sum of joints 2, 3, 4.
    #[inline(always)]
    fn wrist(&self, tool: &Matrix3<f64>, base: Turns, free: &Free) -> Wrist {
        let g = &self.inner.geometry;
        let [vx, vy, vz] = self.image(tool, base);
        let height = (vx * vx + vy * vy).sqrt();
        let (middle, miss) = g.wrist.angle(vz, height);
        let straight = !height.simd_gt(all(free.least));
        let sine = height.simd_gt(all(GIMBAL_SINE)).select(middle.sin, all(0.0))
            * f64x4::new([1.0, -1.0, 1.0, -1.0]);
        let middle = Turns { cos: middle.cos, sin: sine };
        let ([cos_a, cos_b], [sin_a, sin_b]) = (g.wrist.cos, g.wrist.sin);
        let wx = all(cos_a * sin_b) - all(sin_a * cos_b) * middle.cos;
        let wy = all(-sin_a) * middle.sin;
        let hand = Turns::along(wx * vx + wy * vy, wy * vx - wx * vy, 0.0, free.hand);
        let hand = Turns {
            cos: straight.select(all(free.hand[0]), hand.cos),
            sin: straight.select(all(free.hand[1]), hand.sin),
        };
        // Axis 5, from the tool to the base.
        let (u, v) = (all(sin_b) * hand.cos, all(-sin_b) * hand.sin);
        let [ye, yj, yk] =
            [0, 1, 2].map(|i| u * all(tool[(i, 0)]) + v * all(tool[(i, 1)]) + all(cos_b * tool[(i, 2)]));
        let [ye, yj] = base.undo(ye, yj);
        let (p, q) = (all(g.sin_lean) * yk - all(g.cos_lean) * yj, ye);
        let (a, b) = (all(g.axis5.re), all(g.axis5.im));
        let total = Turns::along(p * a + q * b, q * a - p * b, 0.0, [1.0, 0.0]);
        Wrist { middle, hand, total, height, miss }
    }

    /// All branches in principal values; bit `b` of the mask is set for those that exist, repeats left out.
    #[inline(always)]
    fn branches(&self, target: &Target, free: &Free, out: &mut [[f64; 6]; 8]) -> Found {
        let g = &self.inner.geometry;
        let [l2, l3] = g.lengths;
        let (sum, difference) = (l2 + l3, (l2 - l3).abs());
        let slack = REACH_ROUNDING * (sum + g.hand.norm() + g.lateral.abs() + g.shoulder.norm());
        let base = self.base(&target.center, free, slack);
        let wrist = self.wrist(&target.tool, base.turn, free);

        // Axis 4 in the plane of the links.
        let [hx, hy] = wrist.total.apply(all(g.hand.re), all(g.hand.im));
        let tx = all(base.height - g.shoulder.re) - hx;
        let ty = base.ahead - all(g.shoulder.im) - hy;
        let squared = tx * tx + ty * ty;
        let d = squared.sqrt();
        let (far, near, zero) = (d - all(sum), all(difference) - d, all(0.0));
        let product = (-near).fast_max(zero) * (d + all(difference)) * (-far).fast_max(zero) * (d + all(sum));
        let elbow = Turns::along(squared - all(l2 * l2 + l3 * l3), product.sqrt(), 0.0, [1.0, 0.0]);
        let upper = [elbow, elbow.negated()].map(|turn| {
            let (a, b) = (all(l2) + all(l3) * turn.cos, all(l3) * turn.sin);
            let (x, y) = (tx * a + ty * b, ty * a - tx * b);
            let (c, s) = (all(g.upper_home.re), all(g.upper_home.im));
            Turns::along(x * c + y * s, y * c - x * s, 0.0, [1.0, 0.0])
        });

        let excess = far.fast_max(near);
        let out_of_reach = excess.simd_gt(all(slack)) | wrist.miss.simd_gt(zero);
        let mask = base.mask
            & spread(!out_of_reach.to_bitmask())
            & spread_wrist(wrist.middle.sin.to_array())
            & spread_elbow(elbow.sin.to_array());
        let miss = excess.fast_max(zero).to_array().into_iter().fold(f64::INFINITY, f64::min) + base.miss;

        let (one, six) = (base.turn.angles().to_array(), wrist.hand.angles().to_array());
        let five = wrap_four(all(g.zero5) - wrist.middle.angles()).to_array();
        let (total, bend, folded) = (wrist.total.angles(), elbow.angles(), all(g.bend_home));
        for (e, (upper, bend)) in upper.into_iter().zip([bend, -bend]).enumerate() {
            let second = upper.angles();
            let third = wrap_four(bend - folded);
            let fourth = wrap_four(total - second - third);
            let [second, third, fourth] = [second, third, fourth].map(f64x4::to_array);
            for lane in 0..4 {
                let [s2, s3, s4] = g.sign;
                let [q2, q3, q4] = [s2 * second[lane], s3 * third[lane], s4 * fourth[lane]];
                let row = [one[lane], q2, q3, q4, five[lane], six[lane]];
                out[4 * (lane / 2) + 2 * e + lane % 2] = row.map(wrap_sum);
            }
        }
        let singular = wrist.height.simd_lt(all(SINGULAR_WRIST_SINE)).to_bitmask() != 0;
        let on_axis = base.on_axis;
        let middle =
            wrist.miss.simd_gt(all(FOLD_SINE * FOLD_SINE)).select(all(f64::NAN), wrist.middle.sin).to_array();
        let height = wrist.height.to_array();
        Found { mask, singular, height, middle, on_axis, miss }
    }

    /// Bit `b` is kept when a winding of row `b` holds all limits; that winding is written back.
    #[inline(always)]
    fn mask_limits(&self, reachable: u8, rows: &mut [[f64; 6]; 8]) -> u8 {
        let Inner { lower, upper, .. } = &*self.inner;
        let mut mask = 0;
        for (branch, row) in rows.iter_mut().enumerate() {
            if reachable & (1 << branch) == 0 {
                continue;
            }
            let mut inside = true;
            for i in 0..6 {
                inside &= row[i] >= lower[i] && row[i] <= upper[i];
            }
            if inside || self.wind(row) {
                mask |= 1 << branch;
            }
        }
        mask
    }

    /// Brings `q` within the limits where windings do.
    #[cold]
    fn wind(&self, q: &mut [f64; 6]) -> bool {
        let Inner { lower, upper, .. } = &*self.inner;
        for i in 0..6 {
            match within(q[i], lower[i], upper[i]) {
                Some(wound) => q[i] = wound,
                None => return false,
            }
        }
        true
    }

    /// The branches of a pose that leaves joint 6 free, with joint 6 as near as possible to `wish` where the elbow reaches
    /// and, with `limits`, all limits hold. Next to such a pose joint 6 is what the pose says, up to its rounding. `free` is
    /// that of `found` and `rows`.
    #[cold]
    fn singular_wrist(
        &self,
        target: &Target,
        free: &Free,
        wish: f64,
        limits: bool,
        found: &Found,
        rows: &mut [[f64; 6]; 8],
    ) -> u8 {
        let Inner { lower, upper, .. } = &*self.inner;
        let plain = *rows;
        let before = if limits { self.mask_limits(found.mask, rows) } else { found.mask };
        let grid = (0..SINGULAR_WRIST).map(|k| wish + TURN * (k as f64 / SINGULAR_WRIST as f64 - 0.5));
        let ends = [wish, lower[5], upper[5]].into_iter().chain(self.stretched(target, free));
        let mut tries: Vec<f64> = grid
            .chain(ends)
            .chain(plain.iter().map(|row| row[5]))
            .filter(|q| q.is_finite())
            .map(|q| if limits { within(wrap(q), lower[5], upper[5]).unwrap_or(q) } else { wrap(q) })
            .collect();
        tries.sort_by(|a, b| (a - wish).abs().total_cmp(&(b - wish).abs()));
        // Where joint 6 is free, or says what rounding has made of it, the rows at hand are not the nearest to the wish.
        let mut chosen = 0u8;
        let mut tried = [[0.0; 6]; 8];
        for q6 in tries {
            let free = Free { hand: [q6.cos(), q6.sin()], least: SINGULAR_WRIST_SINE, ..*free };
            let found_here = self.branches(target, &free, &mut tried);
            let valid = if limits { self.mask_limits(found_here.mask, &mut tried) } else { found_here.mask };
            for branch in 0..8 {
                // What another joint 6 costs in the pose.
                let turned = 2.0 * (0.5 * (q6 - plain[branch][5])).sin().abs();
                let height = found.height[lane_of(branch)];
                let same = height <= GIMBAL_SINE
                    || (height <= SINGULAR_WRIST_SINE && height * turned <= SINGULAR_WRIST_ROUNDING);
                if same && valid & !chosen & (1 << branch) != 0 {
                    rows[branch] = tried[branch];
                    chosen |= 1 << branch;
                }
            }
        }
        before | chosen
    }

    /// Values of joint 6, where the pose leaves it free, at which axis 4 is at the ends of the elbow's reach, or nearest to
    /// them.
    #[cold]
    fn stretched(&self, target: &Target, free: &Free) -> Vec<f64> {
        let g = &self.inner.geometry;
        let mut rows = [[0.0; 6]; 8];
        let free = Free { hand: [1.0, 0.0], least: SINGULAR_WRIST_SINE, ..*free };
        self.branches(target, &free, &mut rows);
        let [l2, l3] = g.lengths;
        let mut out = Vec::new();
        for shoulder in [0, 4] {
            // With joint 6 at 0: the sum of joints 2..4, and C seen from axis 2.
            let row = &rows[shoulder];
            let angles: Vec<f64> = (0..3).map(|i| g.sign[i] * row[i + 1]).collect();
            let total: f64 = angles.iter().sum();
            let (sin, cos) = row[0].sin_cos();
            let ahead = cos * target.center.x + sin * target.center.y;
            let y = (g.lateral - g.cos_lean * target.center.z) / g.sin_lean;
            let height = g.sin_lean * target.center.z - g.cos_lean * y;
            let from_shoulder = Complex::new(height, ahead) - g.shoulder;
            let (far, hand) = (from_shoulder.norm(), g.hand.norm());
            if far * hand == 0.0 {
                continue;
            }
            let toward = (from_shoulder * g.hand.conj()).arg();
            for d in [l2 + l3, (l2 - l3).abs()] {
                let cosine = (far * far + hand * hand - d * d) / (2.0 * far * hand);
                let angle = cosine.clamp(-1.0, 1.0).acos();
                for at in [toward + angle, toward - angle] {
                    // Joint 6 turns with or against the sum, whichever way axis 6 points along m.
                    let rest = wrap(total - at);
                    out.extend([rest, -rest]);
                }
            }
        }
        out
    }

    /// What is out of reach, and by how much: m, 0 where it is an angle.
    #[cold]
    pub(super) fn unreachable_reason(&self, pose: &Pose) -> (String, f64) {
        let g = &self.inner.geometry;
        let target = &self.target(pose);
        let base = self.base(&target.center, &self.inner.free, 0.0);
        let [x, y, z] = self.image(&target.tool, base.turn);
        let angles = Turns::along((x * x + y * y).sqrt(), z, 0.0, [1.0, 0.0]);
        let angles = angles.cos.atan2(angles.sin).to_array();
        let [a, b] = [0, 1].map(|i| g.wrist.sin[i].atan2(g.wrist.cos[i]));
        let (least, most) = ((a - b).abs(), (a + b).min(TURN - a - b));
        let turn = angles.iter().map(|c| (least - c).max(c - most)).fold(f64::INFINITY, f64::min);
        if base.miss == 0.0 && turn > 0.0 {
            let what = "joint 5 cannot turn axis 6 far enough relative to axes 2 to 4, by";
            return (format!("{what} {:.6} mrad", 1e3 * turn), 0.0);
        }
        let distance = self.branches(target, &self.inner.free, &mut [[0.0; 6]; 8]).miss;
        let text = "outside of what shoulder and elbow reach";
        (format!("the wrist would be {:.6} mm {text}", 1e3 * distance), distance)
    }

    /// Why the branches do not say everything: what the pose leaves free, or that rounding decides; `None` away from there.
    pub(super) fn doubt(&self, pose: &Pose) -> Option<String> {
        let target = self.target(pose);
        let found = self.branches(&target, &self.inner.free, &mut [[0.0; 6]; 8]);
        let joints = self.chain().joints();
        if found.on_axis {
            let name = &joints[0].name;
            return Some(format!("the wrist centre is on the first axis: '{name}' may take any value"));
        }
        let [b, c, d, f] = [1, 2, 3, 5].map(|i| &joints[i].name);
        if found.height.iter().any(|height| *height <= SINGULAR_WRIST_SINE) {
            return Some(format!(
                "the last axis is parallel to those of '{b}', '{c}' and '{d}', or nearly so: '{f}' may take more than one value"
            ));
        }
        // Where joint 5 turns back it is known to the root of the rounding, which may bring the elbow out of its reach.
        let turns_back = found.middle.iter().any(|sine| sine.abs() <= FOLD_SINE);
        turns_back
            .then(|| format!("'{}' turns back here: rounding decides which branches exist", joints[4].name))
    }

    /// Which limit is missed by how little at best.
    #[cold]
    pub(super) fn limits_reason(&self, rows: &[[f64; 6]; 8], reachable: u8) -> String {
        let Inner { lower, upper, chain, .. } = &*self.inner;
        let mut best = (f64::INFINITY, 0);
        for (_, row) in rows.iter().enumerate().filter(|(b, _)| reachable & (1 << b) != 0) {
            let misses = (0..6).map(|i| (outside(row[i], lower[i], upper[i]), i));
            let worst = misses.fold((0.0, 0), |a, b| if b.0 > a.0 { b } else { a });
            if worst.0 < best.0 {
                best = worst;
            }
        }
        let joint = &chain.joints()[best.1];
        format!(
            "no branch is within all joint limits; even the best leaves joint '{}' {:.6} rad outside [{:.6}, {:.6}]",
            joint.name, best.0, joint.limits.lower, joint.limits.upper
        )
    }
}

/// Lane in which a branch is found.
fn lane_of(branch: usize) -> usize {
    2 * (branch / 4) + branch % 2
}

/// Rows of the lanes in `bits` (lane `2 shoulder + wrist`), both elbows.
#[inline(always)]
fn spread(bits: u32) -> u8 {
    let [a, b, c, d] = [0, 1, 2, 3].map(|lane| bits >> lane & 1);
    ((a * 0b0101) | (b * 0b1010) | (c * 0b0101_0000) | (d * 0b1010_0000)) as u8
}

/// Rows that are no repeats: a wrist at its end is one, not two.
#[inline(always)]
fn spread_wrist(sine: [f64; 4]) -> u8 {
    let bit = |lane: usize| if sine[lane] == 0.0 && lane % 2 == 1 { 0u32 } else { 1 };
    spread(bit(0) | bit(1) << 1 | bit(2) << 2 | bit(3) << 3)
}

/// Rows that are no repeats: a stretched or folded elbow is one, not two.
#[inline(always)]
fn spread_elbow(sine: [f64; 4]) -> u8 {
    let twice = [0, 1, 2, 3].map(|lane: usize| if sine[lane] == 0.0 { 0u32 } else { 1 });
    let both = spread(twice[0] | twice[1] << 1 | twice[2] << 2 | twice[3] << 3);
    both | 0b0011_0011
}
