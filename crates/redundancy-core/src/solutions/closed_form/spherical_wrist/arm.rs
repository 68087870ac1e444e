//! Closed-form inverse kinematics of six-joint arms with a spherical wrist, all branches.
//!
//! PUMA 560, and the industrial arms of ABB, KUKA, Fanuc, Staubli: axis 1 perpendicular to axis 2, axis 3 parallel to
//! axis 2, axes 4, 5, 6 meeting in the wrist centre W at right angles. With `[e, m, k]` the frame of the arm's plane
//! (k along axis 1, m along axis 2), complex numbers `k + i e` in that plane, A where axis 2 crosses it, lengths
//! `L2, L3`, and b the coordinate of W along m:
//!
//! 1. The pose fixes W. With rho its distance from axis 1, `c = +-sqrt(rho^2 - b^2)` (shoulder in front or behind) and
//!    `exp(i q1) = (x + i y) conj(c + i b) / rho^2`.
//! 2. `t = (W_k + i c) - A`, `d = |t|`: in reach iff `|L2 - L3| <= d <= L2 + L3`. Elbow
//!    `tau = +-atan2(P, d^2 - L2^2 - L3^2)` with `P = sqrt((d^2 - (L2 - L3)^2) ((L2 + L3)^2 - d^2))`, factors written
//!    without cancellation; upper arm along `w = t conj(L2 + L3 exp(i tau)) / |..|`, forearm along `w exp(i tau)`.
//! 3. Joints 4, 5, 6 are the ZYZ angles of the forearm's rotation against the tool's, `+-` for the sign of the middle
//!    angle.
//!
//! No sine of a result is computed again: the plane rotations of step 3 come from the complex numbers of 1 and 2, so
//! that eight branches need twenty arc tangents, four at a time, and no other transcendental function.
//!
//! Degenerate poses are defined: W on axis 1 with `b = 0` leaves joint 1 free (0 or the limit nearest to it is taken, the given value in
//! [`SphericalWristArm::nearest`]); the stretched or folded arm has one elbow; with joint 5 at its gimbal joints 4 and 6
//! share their sum (joint 4 is 0 where the limits allow it, the nearest share in `nearest`).
//!
//! The decomposition is Pieper's `[Pieper1968]`; the parameters of `[Brandstotter2014]` are those of this module with
//! right angles between the forearm and axis 3.

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};
use wide::f64x4;

use super::complex::{Complex, complex};
use super::geometry::WristGeometry;
use crate::chain::Chain;
use crate::error::{Error, Result, check_length};
use crate::joint_space::{TURN, nearest_within, opposite, outside, within, wrap, wrap_sum};
use crate::parallel::prelude::*;
use crate::pose::{Pose, checked_pose, pose_from_row_major};
use crate::solutions::closed_form::gimbal::shared;
use crate::solutions::{Defect, at, signs};
use crate::status::Status;
use crate::tolerance::{GIMBAL_PASSAGE, GIMBAL_SINE, REACH_ROUNDING};

/// Poses that one task of the pool takes at least.
const TASK: usize = 64;

/// A recognised six-joint arm with a spherical wrist, and its closed-form inverse kinematics.
///
/// ```
/// use redundancy_core::chain::catalog;
/// use redundancy_core::solutions::SphericalWristArm;
/// let chain = catalog::load("puma560")?;
/// let arm = SphericalWristArm::new(&chain)?;
/// let q = [0.3, 0.5, -0.2, 1.1, 0.4, 0.7];
/// let all = arm.solve(&chain.forward(&q)?, true)?;
/// assert!(all.iter().any(|p| p.iter().zip(&q).all(|(a, b)| (a - b).abs() < 1e-12)));
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct SphericalWristArm {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    chain: Chain,
    geometry: WristGeometry,
    lower: [f64; 6],
    upper: [f64; 6],
    /// Direction of joint 1 where the pose leaves it free: 0, or the limit nearest to it.
    free: Complex,
}

/// Every configuration over one pose.
#[derive(Debug, Clone)]
pub struct Configurations {
    /// `Converged`, `Unreachable`, or `Limits` (in reach, but no branch within the joint limits).
    pub status: Status,
    /// Why there is none within the limits, and by how much; empty when there is one.
    pub reason: String,
    /// Distance of the wrist centre from the nearest point that it can reach, m; 0 in reach.
    pub distance: f64,
    /// The configurations within the limits, in branch order.
    pub q: Vec<[f64; 6]>,
    /// Their branches, `4 [shoulder < 0] + 2 [elbow < 0] + [wrist < 0]`.
    pub branches: Vec<usize>,
    pub(super) arm: SphericalWristArm,
    pub(super) pose: Pose,
    /// All branches, within the limits where a winding allows it.
    pub(super) rows: [[f64; 6]; 8],
    /// Bit `b`: row `b` is a configuration, limits aside.
    pub(super) reachable: u8,
    /// The wrist centre is on axis 1, which leaves joint 1 free.
    pub(super) free: bool,
}

/// What the pose fixes, in the frame of the base of the arm.
struct Target {
    /// Wrist centre.
    wrist: Vector3<f64>,
    /// Tool as the wrist's ZYZ product ends.
    tool: Matrix3<f64>,
}

/// Arc tangents of four pairs `[y, x]`.
#[inline(always)]
fn arc_tangents(p: [[f64; 2]; 4]) -> [f64; 4] {
    let y = f64x4::new([p[0][0], p[1][0], p[2][0], p[3][0]]);
    y.atan2(f64x4::new([p[0][1], p[1][1], p[2][1], p[3][1]])).to_array()
}

impl SphericalWristArm {
    /// Recognises the arm.
    ///
    /// # Errors
    /// [`Error::NotSphericalWrist`]: which axes are wrong and by how many millimetres or milliradians.
    pub fn new(chain: &Chain) -> Result<Self> {
        let geometry = WristGeometry::recognise(chain)?;
        let (mut lower, mut upper) = ([0.0; 6], [0.0; 6]);
        lower.copy_from_slice(chain.lower());
        upper.copy_from_slice(chain.upper());
        let free = geometry.first_direction(0.0_f64.clamp(lower[0], upper[0]));
        let inner = Inner { chain: chain.clone(), geometry, lower, upper, free };
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

    /// Lengths of upper arm and forearm, m: distances of axis 3 from axis 2 and of the wrist centre from axis 3.
    pub fn lengths(&self) -> [f64; 2] {
        [self.inner.geometry.upper_arm, self.inner.geometry.forearm]
    }

    /// Shoulder offset, m: distance of axis 2 from axis 1.
    pub fn shoulder_offset(&self) -> f64 {
        self.inner.geometry.shoulder.im.abs()
    }

    /// Lateral offset, m: distance of the wrist centre from the plane through axis 1 that is perpendicular to axis 2.
    pub fn lateral_offset(&self) -> f64 {
        self.inner.geometry.lateral.abs()
    }

    /// Configurations over `pose`, in branch order: with `limits` those within the joint limits, in the winding that
    /// holds them; without, all distinct ones (eight, or four where one shoulder is out of reach or the arm is
    /// stretched) in principal values. Empty when there is none: [`SphericalWristArm::configurations`] says why.
    ///
    /// # Errors
    /// A pose that is not rigid or finite.
    pub fn solve(&self, pose: &Pose, limits: bool) -> Result<Vec<[f64; 6]>> {
        let pose = &checked_pose("pose", pose)?;
        let mut rows = [[0.0; 6]; 8];
        let mask = self.solve_into(pose, limits, &mut rows);
        Ok((0..8).filter(|b| mask & (1 << b) != 0).map(|b| rows[b]).collect())
    }

    /// [`SphericalWristArm::solve`] for checked input, without allocation: bit `b` of the result says that row `b` of
    /// `out` is a configuration. The other rows are finite but meaningless.
    #[inline]
    pub fn solve_into(&self, pose: &Pose, limits: bool, out: &mut [[f64; 6]; 8]) -> u8 {
        let target = self.target(pose);
        let reachable = self.branches(&target, self.inner.free, out);
        if !limits {
            return reachable;
        }
        self.mask_limits(reachable, out)
    }

    /// Bit `b` is set when a winding of the reachable row `b` holds all limits; that winding is written back.
    #[inline]
    fn mask_limits(&self, reachable: u8, rows: &mut [[f64; 6]; 8]) -> u8 {
        let mut mask = 0;
        for (branch, row) in rows.iter_mut().enumerate() {
            if reachable & (1 << branch) != 0 && self.hold_limits(row) {
                mask |= 1 << branch;
            }
        }
        mask
    }

    /// [`SphericalWristArm::solve_into`] for many poses (`N * 16` numbers, row-major matrices): `N * 8 * 6` joint
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
    /// `None` when there is none. Where joint 1 is free (wrist centre on axis 1) it stays at its value in `q`.
    ///
    /// # Errors
    /// A pose that is not rigid or finite, a wrong length of `q`, or an entry that is not finite.
    pub fn nearest(&self, pose: &Pose, q: &[f64]) -> Result<Option<[f64; 6]>> {
        let pose = &checked_pose("pose", pose)?;
        self.chain().check_q(q)?;
        Ok(self.nearest_unchecked(pose, q))
    }

    /// [`SphericalWristArm::nearest`] for checked input; allocates nothing.
    pub(super) fn nearest_unchecked(&self, pose: &Pose, q: &[f64]) -> Option<[f64; 6]> {
        self.nearest_branch(pose, q).map(|(_, near)| near)
    }

    /// [`SphericalWristArm::nearest_unchecked`] with its branch.
    pub(super) fn nearest_branch(&self, pose: &Pose, q: &[f64]) -> Option<(usize, [f64; 6])> {
        let Inner { lower, upper, .. } = &*self.inner;
        let target = self.target(pose);
        let free = self.inner.geometry.first_direction(q[0].clamp(lower[0], upper[0]));
        let mut rows = [[0.0; 6]; 8];
        let reachable = self.branches(&target, free, &mut rows);
        let mut best: Option<(f64, usize, [f64; 6])> = None;
        for (branch, row) in rows.iter().enumerate() {
            if reachable & (1 << branch) == 0 {
                continue;
            }
            let mut near = [0.0; 6];
            let shared = self.wrist_share(row);
            let inside = (0..6).all(|i| {
                let wound = nearest_within(row[i], q[i], lower[i], upper[i]);
                near[i] = wound.unwrap_or(row[i]);
                wound.is_some() || (shared.is_some() && (i == 3 || i == 5))
            });
            if !inside {
                continue;
            }
            if let Some(sense) = shared {
                match self.share(row, sense, [q[3], q[5]], 0.0) {
                    Some([q4, q6]) => (near[3], near[5]) = (q4, q6),
                    None => continue,
                }
            }
            let distance = near.iter().zip(q).map(|(a, b)| (a - b) * (a - b)).sum();
            if best.is_none_or(|(least, ..)| distance < least) {
                best = Some((distance, branch, near));
            }
        }
        best.map(|(_, branch, q)| (branch, q))
    }

    /// [`SphericalWristArm::nearest`] for many poses, to one `q` for all (6 numbers) or one for each (`N * 6`).
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

    /// Signs `[shoulder, elbow, wrist]` of a configuration; a zero counts as +. The shoulder is + when the wrist centre
    /// is on the side of axis 1 on which axis 2 passes (where axis 2 meets axis 1: on the left of axis 2's lateral
    /// offset), the elbow when the forearm is turned from the upper arm in the sense of m, the wrist by the sine of its
    /// middle angle.
    ///
    /// # Errors
    /// Wrong length of `q`, or an entry that is not finite.
    pub fn branch(&self, q: &[f64]) -> Result<[i8; 3]> {
        self.chain().check_q(q)?;
        let g = &self.inner.geometry;
        let angle = |i: usize| wrap(g.sign[i] * (q[i] - g.zero[i]));
        let (sin, cos) = angle(1).sin_cos();
        let (sin3, cos3) = angle(2).sin_cos();
        let upper = complex(cos, sin);
        let wrist = g.shoulder + upper.scaled(g.upper_arm) + (upper * complex(cos3, sin3)).scaled(g.forearm);
        Ok([wrist.im, angle(2), angle(4)].map(|x| if x < 0.0 { -1 } else { 1 }))
    }

    /// Every configuration over `pose` within the limits; if there is none, the reason with the numbers.
    ///
    /// # Errors
    /// A pose that is not rigid or finite.
    pub fn configurations(&self, pose: &Pose) -> Result<Configurations> {
        let pose = &checked_pose("pose", pose)?;
        let target = self.target(pose);
        let mut rows = [[0.0; 6]; 8];
        let reachable = self.branches(&target, self.inner.free, &mut rows);
        let mask = self.mask_limits(reachable, &mut rows);
        let branches: Vec<usize> = (0..8).filter(|b| mask & (1 << b) != 0).collect();
        let q = branches.iter().map(|b| rows[*b]).collect();
        let (mut status, mut reason, mut distance) = (Status::Converged, String::new(), 0.0);
        if reachable == 0 {
            (status, distance) = (Status::Unreachable, self.miss(&target));
            let mm = 1e3 * distance;
            reason = format!("the wrist would be {mm:.6} mm outside of what shoulder and elbow reach");
        } else if mask == 0 {
            status = Status::Limits;
            reason = self.limits_reason(&rows, reachable);
        }
        let free = reachable != 0 && target.wrist.xy().norm() <= self.slack();
        let (arm, pose) = (self.clone(), *pose);
        Ok(Configurations { status, reason, distance, q, branches, arm, pose, rows, reachable, free })
    }

    /// Distance of the wrist from axis 1 (m) that is rounding.
    #[inline(always)]
    fn slack(&self) -> f64 {
        let g = &self.inner.geometry;
        REACH_ROUNDING * (g.upper_arm + g.forearm + g.shoulder.norm() + g.lateral.abs())
    }

    /// Row `branch` over `pose`, limits aside, with joint 1 at `first` where the pose leaves it free.
    pub(super) fn row_at(&self, pose: &Pose, first: f64, branch: usize) -> [f64; 6] {
        let mut rows = [[0.0; 6]; 8];
        self.branches(&self.target(pose), self.inner.geometry.first_direction(first), &mut rows);
        rows[branch]
    }

    /// Whether the configuration `q` over a pose holds all limits with `margin` in some winding, joints 4 and 6 sharing
    /// their sum where the wrist is at its gimbal.
    pub(super) fn holds_margin(&self, q: &[f64; 6], margin: f64) -> bool {
        let Inner { lower, upper, .. } = &*self.inner;
        let shared = self.wrist_share(q);
        let holds = |i: usize| {
            let (lower, upper) = (lower[i] + margin, upper[i] - margin);
            lower <= upper && within(q[i], lower, upper).is_some()
        };
        match shared {
            None => (0..6).all(holds),
            Some(sense) => {
                [0, 1, 2, 4].into_iter().all(holds) && self.share(q, sense, [0.0; 2], margin).is_some()
            }
        }
    }

    /// Signs `[shoulder, elbow, wrist]` of a branch index.
    pub fn signs(branch: usize) -> [i8; 3] {
        signs(branch)
    }

    #[inline(always)]
    fn target(&self, pose: &Pose) -> Target {
        let g = &self.inner.geometry;
        let rotation = pose.rotation.matrix();
        let wrist = rotation * g.wrist_in_tool + pose.translation.vector - g.origin;
        Target { wrist: g.frame.tr_mul(&wrist), tool: g.frame.tr_mul(&(rotation * g.tool_offset)) }
    }

    /// All branches in principal values; bit `b` is set for those that exist, repeats left out. `free` is the direction
    /// of joint 1 where the pose leaves it free.
    #[inline(always)]
    fn branches(&self, target: &Target, free: Complex, out: &mut [[f64; 6]; 8]) -> u8 {
        let g = &self.inner.geometry;
        let (l2, l3, b) = (g.upper_arm, g.forearm, g.lateral);
        let slack = self.slack();
        // Coordinates along e, m, k; joint 1 turns e towards m.
        let [x, y, z] = [target.wrist.x, target.wrist.y, target.wrist.z];
        let rho = (x * x + y * y).sqrt();
        let squared = (rho - b.abs()) * (rho + b.abs());
        // On axis 1 up to rounding counts as on it.
        let side = if rho > slack { squared.max(0.0).sqrt() } else { 0.0 };
        let mut mask = if rho < b.abs() - slack { 0u8 } else { 0xff };
        let (sum, difference) = (l2 + l3, (l2 - l3).abs());
        let mut halves = [(complex(1.0, 0.0), [[0.0; 4]; 2], [complex(1.0, 0.0); 2]); 2];
        for (shoulder, half) in halves.iter_mut().enumerate() {
            let ahead = if shoulder == 0 { side } else { -side };
            let base =
                if rho > slack { (complex(x, y) * complex(ahead, b).conjugate()).unit() } else { free };
            let t = complex(z, ahead) - g.shoulder;
            let d = t.norm();
            if d > sum + slack || d < difference - slack {
                mask &= if shoulder == 0 { 0xf0 } else { 0x0f };
            }
            let product = (d - difference).max(0.0) * (d + difference) * (sum - d).max(0.0) * (sum + d);
            let elbow = complex(d * d - l2 * l2 - l3 * l3, product.sqrt()).unit();
            if elbow.im == 0.0 {
                mask &= if shoulder == 0 { !0x0c } else { !0xc0 };
            }
            let upper = [elbow, elbow.conjugate()]
                .map(|turn| (t * (complex(l2, 0.0) + turn.scaled(l3)).conjugate()).unit());
            let [first, second, other, third] = arc_tangents([
                [base.im, base.re],
                [upper[0].im, upper[0].re],
                [upper[1].im, upper[1].re],
                [elbow.im, elbow.re],
            ]);
            let turn = g.fore_home.conjugate();
            let fore = [upper[0] * elbow * turn, upper[1] * elbow.conjugate() * turn];
            *half = (base, [[first, second, third, 0.0], [first, other, -third, 0.0]], fore);
        }
        if side == 0.0 {
            mask &= 0x0f; // in front is behind
        }
        // The wrist of all four arms at once, lane 2 shoulder + elbow.
        let lanes = |of: fn(&(Complex, [[f64; 4]; 2], [Complex; 2]), usize) -> f64| {
            let [front, behind] = &halves;
            f64x4::new([of(front, 0), of(front, 1), of(behind, 0), of(behind, 1)])
        };
        let base = [lanes(|half, _| half.0.re), lanes(|half, _| half.0.im)];
        let fore = [lanes(|half, elbow| half.2[elbow].re), lanes(|half, elbow| half.2[elbow].im)];
        let n = WristLanes::new(&g.wrist_frame, &target.tool, base, fore);
        let h = (n.axis[0] * n.axis[0] + n.axis[1] * n.axis[1]).sqrt();
        let passes = h.simd_gt(f64x4::splat(GIMBAL_SINE));
        let c = passes.select(n.axis[0] / h, f64x4::splat(1.0));
        let s = passes.select(n.axis[1] / h, f64x4::splat(0.0));
        let [sin, cos] = n.across(&g.wrist_frame, c, s);
        let wrist = [s.atan2(c).to_array(), h.atan2(n.axis[2]).to_array(), sin.atan2(cos).to_array()];
        for (shoulder, (_, angles, _)) in halves.iter().enumerate() {
            for (elbow, angles) in angles.iter().enumerate() {
                let row = 2 * shoulder + elbow;
                let [d, e, f] = [wrist[0][row], wrist[1][row], wrist[2][row]];
                let arm = [0, 1, 2].map(|i| wrap_sum(g.sign[i] * angles[i] + g.zero[i]));
                let five = [e, -e].map(|e| wrap_sum(e + g.zero[4]));
                out[2 * row] = [arm[0], arm[1], arm[2], d, five[0], f];
                out[2 * row + 1] = [arm[0], arm[1], arm[2], opposite(d), five[1], opposite(f)];
            }
        }
        mask
    }

    /// Brings `q` within the limits where a winding, or what the pose leaves free, allows it.
    #[inline(always)]
    fn hold_limits(&self, q: &mut [f64; 6]) -> bool {
        let Inner { lower, upper, .. } = &*self.inner;
        let mut inside = true;
        for i in 0..6 {
            inside &= q[i] >= lower[i] && q[i] <= upper[i];
        }
        inside || self.wind(q)
    }

    #[cold]
    fn wind(&self, q: &mut [f64; 6]) -> bool {
        let Inner { lower, upper, .. } = &*self.inner;
        if let Some(sense) = self.wrist_share(q)
            && let Some([q4, q6]) = self.share(q, sense, [0.0; 2], 0.0)
        {
            (q[3], q[5]) = (q4, q6);
        }
        for i in 0..6 {
            match within(q[i], lower[i], upper[i]) {
                Some(wound) => q[i] = wound,
                None => return false,
            }
        }
        true
    }

    /// At the wrist's gimbal: +1 where `q4 + q6` is fixed, -1 where `q6 - q4` is.
    #[inline(always)]
    pub(super) fn wrist_share(&self, q: &[f64; 6]) -> Option<f64> {
        let middle = wrap(q[4] - self.inner.geometry.zero[4]);
        if middle.abs() <= GIMBAL_PASSAGE {
            Some(1.0)
        } else if middle.abs() >= std::f64::consts::PI - GIMBAL_PASSAGE {
            Some(-1.0)
        } else {
            None
        }
    }

    /// Joints 4 and 6 with the sum (sense +1) or difference (-1) of `row`, within their limits by `margin` and nearest to
    /// `wish`.
    #[cold]
    fn share(&self, row: &[f64; 6], sense: f64, wish: [f64; 2], margin: f64) -> Option<[f64; 2]> {
        let outer = |limits: [f64; 6], margin: f64| [limits[3] + margin, limits[5] + margin];
        let (lower, upper) = (outer(self.inner.lower, margin), outer(self.inner.upper, -margin));
        shared([row[3], row[5]], sense, wish, lower, upper)
    }

    /// Distance of the wrist centre from the nearest point that shoulder and elbow reach.
    ///
    /// In the half-plane of rho and height the reachable set is the annulus about axis 2, seen through
    /// `rho = sqrt(c^2 + b^2)`; out of reach the nearest point is on the image of one of its two circles or on `rho = |b|`.
    #[cold]
    fn miss(&self, target: &Target) -> f64 {
        const SAMPLES: usize = 720;
        let g = &self.inner.geometry;
        let b = g.lateral;
        let (rho, height) = (target.wrist.xy().norm(), target.wrist.z);
        let radii = [g.upper_arm + g.forearm, (g.upper_arm - g.forearm).abs()];
        let distance = |radius: f64, angle: f64| {
            let (sin, cos) = angle.sin_cos();
            let (c, z) = (g.shoulder.im + radius * sin, g.shoulder.re + radius * cos);
            (c.hypot(b) - rho).hypot(z - height)
        };
        let mut least = f64::INFINITY;
        for radius in radii {
            let mut best = (f64::INFINITY, 0.0);
            for k in 0..SAMPLES {
                let angle = TURN * k as f64 / SAMPLES as f64;
                let value = distance(radius, angle);
                if value < best.0 {
                    best = (value, angle);
                }
            }
            let mut step = TURN / SAMPLES as f64;
            while step > 1e-12 {
                let tried = [best.1 - step, best.1 + step].map(|angle| (distance(radius, angle), angle));
                let better = if tried[0].0 < tried[1].0 { tried[0] } else { tried[1] };
                if better.0 < best.0 {
                    best = better;
                } else {
                    step *= 0.5;
                }
            }
            least = least.min(best.0);
        }
        // The cylinder about axis 1, at heights where the plane of the arm is reached on it.
        let from_shoulder = (complex(height, 0.0) - g.shoulder).norm();
        if rho < b.abs() && from_shoulder <= radii[0] && from_shoulder >= radii[1] {
            least = least.min(b.abs() - rho);
        }
        least
    }

    /// Which limit is missed by how little at best.
    #[cold]
    fn limits_reason(&self, rows: &[[f64; 6]; 8], reachable: u8) -> String {
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

/// The turn of the tool against the forearm of four arms, `F Ry(-fore) Rz(-base) tool`, as far as a wrist needs it.
struct WristLanes {
    /// Its third column.
    axis: [f64x4; 3],
    /// Columns 1 and 2 of `Ry(-fore) Rz(-base) tool`.
    columns: [[f64x4; 3]; 2],
}

impl WristLanes {
    #[inline(always)]
    fn new(frame: &Matrix3<f64>, tool: &Matrix3<f64>, base: [f64x4; 2], fore: [f64x4; 2]) -> Self {
        let [[c1, s1], [c, s]] = [base, fore];
        let turned = |j: usize| {
            let [x, y, z] = [0, 1, 2].map(|i| f64x4::splat(tool[(i, j)]));
            let (x, y) = (c1 * x + s1 * y, c1 * y - s1 * x);
            [c * x - s * z, y, s * x + c * z]
        };
        let last = turned(2);
        let row = |i: usize| {
            let [a, b, c] = [0, 1, 2].map(|k| f64x4::splat(frame[(i, k)]));
            a * last[0] + b * last[1] + c * last[2]
        };
        Self { axis: [row(0), row(1), row(2)], columns: [turned(0), turned(1)] }
    }

    /// Entries 1 and 2 of the row `c F_2 - s F_1` of the turn.
    #[inline(always)]
    fn across(&self, frame: &Matrix3<f64>, c: f64x4, s: f64x4) -> [f64x4; 2] {
        let row = [0, 1, 2].map(|k| c * f64x4::splat(frame[(1, k)]) - s * f64x4::splat(frame[(0, k)]));
        let [first, second] = &self.columns;
        let dot = |v: &[f64x4; 3]| row[0] * v[0] + row[1] * v[1] + row[2] * v[2];
        [dot(first), dot(second)]
    }
}
