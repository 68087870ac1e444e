//! The circle of solutions over one pose: [`SelfMotion`], and its members [`Branch`].

use std::sync::OnceLock;

use nalgebra::Vector3;

use super::arm::SrsArm;
use super::elbow_circle::{ElbowCircle, Reach, signs};
use super::intervals::Arcs;
use crate::error::{Error, Result};
use crate::joint_space::{TURN, opposite, outside};
use crate::pose::{Pose, checked_pose};
use crate::status::Status;
use crate::tolerance::GIMBAL_PASSAGE;

/// Every configuration over one pose: up to eight circles, one per branch.
///
/// ```
/// use redundancy_core::{Status, chain::catalog, solutions::SrsArm};
/// let chain = catalog::load("pa10")?;
/// let pose = chain.forward(&[0.3, 0.5, -0.2, 1.1, 0.4, 0.7, -0.9])?;
/// let motion = SrsArm::new(&chain)?.self_motion(&pose)?;
/// assert_eq!(motion.status(), Status::Converged);
/// let branch = &motion.branches()[0];
/// let [lo, hi] = branch.intervals(0.0)?[0];
/// assert!(chain.within_limits(&branch.q((lo + hi) / 2.0)?, 0.0));
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct SelfMotion {
    pub(super) arm: SrsArm,
    pub(super) circle: ElbowCircle,
    reach: Reach,
    /// Feasible arcs without margin, computed on first use.
    arcs: OnceLock<Arcs>,
}

impl SrsArm {
    /// Everything over `pose` that does not depend on the swivel, as an object.
    ///
    /// # Errors
    /// A pose that is not rigid or finite.
    pub fn self_motion(&self, pose: &Pose) -> Result<SelfMotion> {
        let pose = &checked_pose("pose", pose)?;
        let (circle, reach) = self.circle(pose);
        Ok(SelfMotion::new(self.clone(), circle, reach))
    }
}

impl SelfMotion {
    pub(super) fn new(arm: SrsArm, circle: ElbowCircle, reach: Reach) -> Self {
        Self { arm, circle, reach, arcs: OnceLock::new() }
    }

    /// The arm.
    pub fn arm(&self) -> &SrsArm {
        &self.arm
    }

    /// `Converged`, `Unreachable` (no configuration at all) or `Limits` (none within the joint limits).
    pub fn status(&self) -> Status {
        if self.reach != Reach::Inside {
            Status::Unreachable
        } else if self.arcs().is_empty() {
            Status::Limits
        } else {
            Status::Converged
        }
    }

    /// Why there is no configuration within the limits, with the number, and why the verdict is not exact where it is not;
    /// empty when there is one and the verdict is exact.
    pub fn reason(&self) -> String {
        let reason = match self.status() {
            Status::Unreachable => {
                SrsArm::reach_reason(self.reach).map_or_else(String::new, |(_, text)| text)
            }
            Status::Limits => self.limits_reason(),
            _ => String::new(),
        };
        match self.not_proven() {
            None => reason,
            Some(why) if reason.is_empty() => why,
            Some(why) => format!("{reason}; {why}"),
        }
    }

    /// The branches that are distinct circles: eight, or four for the stretched and the folded arm, whose two elbows
    /// are one circle; none when the pose is out of reach.
    pub fn branches(&self) -> Vec<Branch<'_>> {
        self.branch_indices().map(|index| Branch { motion: self, index }).collect()
    }

    /// The branch with signs `4 [s2 < 0] + 2 [s4 < 0] + [s6 < 0] = index`.
    ///
    /// # Errors
    /// An index above 7, or a pose out of reach.
    pub fn branch(&self, index: usize) -> Result<Branch<'_>> {
        if index > 7 {
            return Err(Error::OutOfRange {
                what: "branch index".into(),
                value: index as f64,
                bound: "<= 7".into(),
            });
        }
        match SrsArm::reach_reason(self.reach) {
            Some((_, reason)) => Err(Error::Invalid(format!("no branch for this pose: {reason}"))),
            None => Ok(Branch { motion: self, index }),
        }
    }

    /// All eight branches at swivel `s` (finite), in principal values, whatever the limits.
    pub(crate) fn all_branches(&self, s: f64) -> [[f64; 7]; 8] {
        let (sin, cos) = s.sin_cos();
        let mut out = [[0.0; 7]; 8];
        self.circle.all_branches(&self.arm.inner.geometry, [cos, sin], &mut out);
        out
    }

    /// The elbow in the world for the swivel direction `u`, of arms without elbow offset.
    pub(crate) fn elbow(&self, u: [f64; 2]) -> Vector3<f64> {
        let (circle, geometry) = (&self.circle, &self.arm.inner.geometry);
        let w = circle.w0 * u[0] + circle.w1 * u[1];
        let direction = circle.n * circle.cos_upper + w * circle.sin_upper;
        geometry.shoulder + geometry.frame * direction * geometry.upper_arm
    }

    /// `d elbow / d s` in the world, see [`SelfMotion::elbow`].
    pub(crate) fn elbow_rate(&self, u: [f64; 2]) -> Vector3<f64> {
        let (circle, geometry) = (&self.circle, &self.arm.inner.geometry);
        let turned = circle.w1 * u[0] - circle.w0 * u[1];
        geometry.frame * turned * (circle.sin_upper * geometry.upper_arm)
    }

    /// One branch at the swivel direction `u`, principal values, and its rates `dq/ds`.
    pub(crate) fn branch_with_rates(&self, u: [f64; 2], branch: usize) -> ([f64; 7], [f64; 7]) {
        let geometry = &self.arm.inner.geometry;
        (self.circle.branch(geometry, u, branch), self.circle.tangent(geometry, u, branch))
    }

    /// One branch at the swivel direction `u`, principal values.
    pub(crate) fn branch_at(&self, u: [f64; 2], branch: usize) -> [f64; 7] {
        self.circle.branch(&self.arm.inner.geometry, u, branch)
    }

    /// One branch at swivel `s`, principal values.
    pub(crate) fn branch_of(&self, s: f64, branch: usize) -> [f64; 7] {
        let (sin, cos) = s.sin_cos();
        self.branch_at([cos, sin], branch)
    }

    /// Rates `dq/ds` of one branch at swivel `s`.
    pub(crate) fn tangent_of(&self, s: f64, branch: usize) -> [f64; 7] {
        let (sin, cos) = s.sin_cos();
        self.circle.tangent(&self.arm.inner.geometry, [cos, sin], branch)
    }

    /// True where the wrist is in reach of the shoulder.
    pub(crate) fn in_reach(&self) -> bool {
        self.reach == Reach::Inside
    }

    /// Bit `b`: branch `b` holds its limits at swivel `s` (at a boundary: on one side of it at least).
    pub(crate) fn allowed(&self, s: f64) -> u8 {
        if self.in_reach() { self.arcs().at(s) } else { 0 }
    }

    /// Where a branch holds its limits, as [`Branch::intervals`] without a margin.
    pub(crate) fn arcs_of(&self, branch: usize) -> Vec<[f64; 2]> {
        if self.in_reach() { self.arcs().of(branch) } else { Vec::new() }
    }

    /// Indices of [`SelfMotion::branches`].
    pub(super) fn branch_indices(&self) -> impl Iterator<Item = usize> + use<> {
        let reachable = self.reach == Reach::Inside;
        let one_elbow = self.circle.sin_elbow == 0.0;
        (0..8).filter(move |index| reachable && !(one_elbow && index & 2 != 0))
    }

    /// Feasible arcs without margin.
    pub(super) fn arcs(&self) -> &Arcs {
        self.arcs.get_or_init(|| Arcs::new(&self.arm.inner.geometry, &self.circle, &self.arm.inner.bounds))
    }

    /// Which limit is missed by how little at best: the least violation over all branches and swivels, estimated on
    /// a grid and refined.
    fn limits_reason(&self) -> String {
        const SAMPLES: usize = 360;
        let (lower, upper) = (&self.arm.inner.lower, &self.arm.inner.upper);
        let violation = |branch: usize, s: f64| {
            let (sin, cos) = s.sin_cos();
            let q = self.circle.branch(&self.arm.inner.geometry, [cos, sin], branch);
            let mut worst = (0.0, 0);
            for i in 0..7 {
                let miss = outside(q[i], lower[i], upper[i]);
                if miss > worst.0 {
                    worst = (miss, i);
                }
            }
            worst
        };
        let mut best = (f64::INFINITY, 0, 0, 0.0);
        for branch in self.branch_indices() {
            for k in 0..SAMPLES {
                let s = TURN * k as f64 / SAMPLES as f64;
                let (miss, joint) = violation(branch, s);
                if miss < best.0 {
                    best = (miss, joint, branch, s);
                }
            }
        }
        // Golden section is not needed: halve the step around the best sample.
        let mut step = TURN / SAMPLES as f64;
        while step > 1e-9 {
            for s in [best.3 - step, best.3 + step] {
                let (miss, joint) = violation(best.2, s);
                if miss < best.0 {
                    best = (miss, joint, best.2, s);
                }
            }
            step /= 2.0;
        }
        let joint = &self.arm.chain().joints()[best.1];
        format!(
            "no swivel of any branch is within all joint limits; even the best leaves joint '{}' {:.6} rad outside [{:.6}, {:.6}]",
            joint.name, best.0, joint.limits.lower, joint.limits.upper
        )
    }
}

/// One circle of configurations: fixed signs of theta2, theta4, theta6, the swivel s runs.
#[derive(Debug, Clone, Copy)]
pub struct Branch<'a> {
    motion: &'a SelfMotion,
    index: usize,
}

impl<'a> Branch<'a> {
    /// The circles it belongs to.
    pub(super) fn motion(&self) -> &'a SelfMotion {
        self.motion
    }
}

impl Branch<'_> {
    /// Index in branch order, `4 [s2 < 0] + 2 [s4 < 0] + [s6 < 0]`.
    pub fn index(&self) -> usize {
        self.index
    }

    /// Signs of theta2, theta4, theta6.
    pub fn signs(&self) -> [i8; 3] {
        signs(self.index)
    }

    /// The configuration at swivel `s` (rad): principal values unless that breaks a limit and a winding does not.
    ///
    /// # Errors
    /// A swivel that is not finite.
    pub fn q(&self, s: f64) -> Result<[f64; 7]> {
        let u = super::Swivel::Angle(s).direction()?;
        Ok(self.q_at(u))
    }

    fn q_at(&self, u: [f64; 2]) -> [f64; 7] {
        let SelfMotion { arm, circle, .. } = self.motion;
        let q = circle.branch(&arm.inner.geometry, u, self.index);
        arm.hold_limits(&q).or_else(|| self.through_gimbal(&q)).unwrap_or_else(|| arm.wind(&q))
    }

    /// At a gimbal only the sum of the outer joints is defined and both jump by pi there: the values on the other side
    /// of the jump, where those hold the limits.
    #[cold]
    fn through_gimbal(&self, q: &[f64; 7]) -> Option<[f64; 7]> {
        let arm = &self.motion.arm;
        let geometry = &arm.inner.geometry;
        let sine = |i: usize| (geometry.sign[i] * (q[i] - geometry.zero[i])).sin().abs();
        let locked = [1, 5].map(|i| sine(i) < GIMBAL_PASSAGE);
        let mut choices = [(true, false), (false, true), (true, true)].into_iter();
        choices.find_map(|(shoulder, wrist)| {
            if shoulder && !locked[0] || wrist && !locked[1] {
                return None;
            }
            let mut other = *q;
            for (turned, [first, third]) in [(shoulder, [0, 2]), (wrist, [4, 6])] {
                if turned {
                    (other[first], other[third]) = (opposite(q[first]), opposite(q[third]));
                }
            }
            arm.hold_limits(&other)
        })
    }

    /// `dq/ds` at swivel `s`: in the kernel of the Jacobian. Grows without bound towards a gimbal (theta2 or theta6 a
    /// multiple of pi); at one the limit along the swivel is returned.
    ///
    /// # Errors
    /// A swivel that is not finite.
    pub fn tangent(&self, s: f64) -> Result<[f64; 7]> {
        let u = super::Swivel::Angle(s).direction()?;
        let SelfMotion { arm, circle, .. } = self.motion;
        Ok(circle.tangent(&arm.inner.geometry, u, self.index))
    }

    /// Where all joint limits hold with `margin` (rad, per joint, from each limit): intervals `[lo, hi]`, ascending,
    /// `lo` in `(-pi, pi]`; `s` is inside when `(s - lo) mod 2 pi <= hi - lo`. Exact: no sampling. A single touching
    /// point has `lo = hi`.
    ///
    /// # Errors
    /// A margin that is negative or not finite.
    pub fn intervals(&self, margin: f64) -> Result<Vec<[f64; 2]>> {
        if !margin.is_finite() || margin < 0.0 {
            return Err(Error::OutOfRange {
                what: "margin".into(),
                value: margin,
                bound: ">= 0 and finite".into(),
            });
        }
        if margin == 0.0 {
            return Ok(self.motion.arcs().of(self.index));
        }
        let inner = &self.motion.arm.inner;
        let bounds = super::intervals::bounds(&inner.geometry, &inner.lower, &inner.upper, margin);
        Ok(Arcs::new(&inner.geometry, &self.motion.circle, &bounds).of(self.index))
    }
}
