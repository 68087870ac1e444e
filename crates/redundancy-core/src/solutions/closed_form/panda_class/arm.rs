//! An arm of the Panda class and its configurations at a given joint 7.

use std::sync::Arc;

use wide::f64x4;

use super::geometry::PandaGeometry;
use super::target::{Rows, Target, transpose};
use crate::chain::Chain;
use crate::error::{Error, Result, check_finite, check_length};
use crate::joint_space::{within, wrap_sum};
use crate::parallel::prelude::*;
use crate::pose::{Pose, checked_pose, pose_from_row_major};
use crate::solutions::closed_form::gimbal::shared;
use crate::solutions::closed_form::lanes::{Turns, all};
use crate::solutions::closed_form::polish::polish;
use crate::solutions::{Defect, at};
use crate::tolerance::{
    EDGE_ROUNDING, GIMBAL_PASSAGE, REACH_ROUNDING, ROOM_ELBOW, ROOM_ELBOW_MOST, ROOM_ROUNDING,
};

/// Poses that one task of the pool takes at least.
const TASK: usize = 64;

/// A recognised arm of the Panda class: a spherical shoulder, axes 5 and 6 that meet, an offset of axis 7.
///
/// ```
/// use redundancy_core::chain::catalog;
/// use redundancy_core::solutions::PandaClassArm;
/// let chain = catalog::load("panda")?;
/// let arm = PandaClassArm::new(&chain)?;
/// let q = [0.3, 0.5, -0.2, -1.1, 0.4, 1.7, -0.9];
/// let all = arm.solve(&chain.forward(&q)?, q[6], true)?;
/// assert!(all.iter().any(|p| p.iter().zip(&q).all(|(a, b)| (a - b).abs() < 1e-12)));
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct PandaClassArm {
    pub(super) inner: Arc<Inner>,
}

/// The same chain: everything else follows.
impl PartialEq for PandaClassArm {
    fn eq(&self, other: &Self) -> bool {
        self.inner.chain == other.inner.chain
    }
}

#[derive(Debug)]
pub(super) struct Inner {
    pub chain: Chain,
    pub geometry: PandaGeometry,
    pub lower: [f64; 7],
    pub upper: [f64; 7],
}

impl PandaClassArm {
    /// Recognises the arm.
    ///
    /// # Errors
    /// [`Error::NotPandaClass`]: which axes are wrong and by how many millimetres or milliradians.
    pub fn new(chain: &Chain) -> Result<Self> {
        let geometry = PandaGeometry::recognise(chain)?;
        let (mut lower, mut upper) = ([0.0; 7], [0.0; 7]);
        lower.copy_from_slice(chain.lower());
        upper.copy_from_slice(chain.upper());
        Ok(Self { inner: Arc::new(Inner { chain: chain.clone(), geometry, lower, upper }) })
    }

    /// The chain that was recognised.
    pub fn chain(&self) -> &Chain {
        &self.inner.chain
    }

    /// How far the arm is from an ideal one: what the closed form returns meets the pose within `1e-12 + 2 x` this.
    pub fn defect(&self) -> Defect {
        self.inner.geometry.defect
    }

    /// Distances from axis 4 of the shoulder's and of the wrist's centre, and of the latter from axis 7, m.
    pub fn lengths(&self) -> [f64; 3] {
        let g = &self.inner.geometry;
        [g.radii[0], g.radii[1], g.offset7]
    }

    /// Configurations over `pose` with joint 7 at `q7` (modulo turns): with `limits` those within the joint limits, in the
    /// winding that holds them; without, all distinct ones (at most eight) in principal values. Those of an arm with a defect
    /// are polished by Newton's method at the same joint 7, here and not in the other methods. Empty when there is none with
    /// this joint 7; [`PandaClassArm::self_motion`] tells of all.
    ///
    /// Their order is `4 [shoulder < 0] + 2 [elbow < 0] + [normal < 0]`: the signs of joint 2, of joint 4 from where the arm is
    /// folded, and of the side of the plane of axes 5 and 6 on which the chord from shoulder to wrist lies.
    ///
    /// # Errors
    /// A pose that is not rigid or finite, a `q7` that is not finite.
    pub fn solve(&self, pose: &Pose, q7: f64, limits: bool) -> Result<Vec<[f64; 7]>> {
        let pose = &checked_pose("pose", pose)?;
        check_finite("q7", &[q7])?;
        let mut rows = [[0.0; 7]; 8];
        let mask = self.solve_into(pose, q7, limits, &mut rows);
        let mut rows: Vec<_> = (0..8).filter(|b| mask & (1 << b) != 0).map(|b| rows[b]).collect();
        // Where joint 7 turns back a defect can take two configurations of the ideal arm away.
        let met = polish(self.chain(), self.defect(), pose, Some(6), limits, &mut rows);
        let mut k = 0;
        rows.retain(|_| {
            k += 1;
            met & (1 << (k - 1)) != 0
        });
        Ok(rows)
    }

    /// [`PandaClassArm::solve`] for checked input, without allocation: bit `b` of the result says that row `b` of `out` is a
    /// configuration. The other rows are finite but meaningless.
    #[inline]
    pub fn solve_into(&self, pose: &Pose, q7: f64, limits: bool, out: &mut [[f64; 7]; 8]) -> u8 {
        let target = Target::new(&self.inner.geometry, pose);
        self.solve_target(&target, q7, limits, out)
    }

    /// [`PandaClassArm::solve_into`] for a pose that was taken apart before.
    #[inline]
    pub(super) fn solve_target(&self, target: &Target, q7: f64, limits: bool, out: &mut [[f64; 7]; 8]) -> u8 {
        let g = &self.inner.geometry;
        let (sin, cos) = (q7 + target.zero7).sin_cos();
        let squared = target.mean_x - target.swing_x * cos;
        let (least, most) = (target.mean_y - target.swing_y, target.mean_y + target.swing_y);
        let slack = REACH_ROUNDING * most;
        if squared < least - slack || squared > most + slack {
            *out = [[0.0; 7]; 8];
            return 0;
        }
        let sine = ((squared - least).max(0.0) * (most - squared).max(0.0)).sqrt();
        let y = Turns::along(
            all(target.mean_y - squared),
            f64x4::new([sine, sine, -sine, -sine]),
            0.0,
            [1.0, 0.0],
        );
        let x = Turns { cos: all(cos), sin: all(sin) };
        let chord = target.chord(g, x, y);
        let normal = chord.room.fast_max(all(0.0)).sqrt() * f64x4::new([1.0, -1.0, 1.0, -1.0]);
        let (rows, _) = target.rows(g, x, y, &chord, normal);
        // The nearer the elbow to its end, the farther rounding turns it.
        let slack = ROOM_ROUNDING + (ROOM_ELBOW * target.swing_y / sine).min(ROOM_ELBOW_MOST);
        let exists = !rows.room.simd_lt(rows.squared * all(-slack)).to_bitmask();
        let twice = rows.room.simd_gt(all(0.0)).to_bitmask();
        // Repeats: the stretched or folded elbow, and the chord in the plane of axes 5 and 6.
        let mut lanes = exists & (0b0101 | twice) & 0b1111;
        if sine == 0.0 {
            lanes &= 0b0011;
        }
        let apart = rows.gimbal.simd_gt(all(0.0)).to_bitmask();
        let reachable = (lanes | (lanes & apart) << 4) as u8;
        let transposed = transpose(&rows);
        for (row, out) in transposed.into_iter().zip(out.iter_mut()) {
            *out = row.map(wrap_sum);
        }
        if limits { self.mask_limits(reachable, &rows, out) } else { reachable }
    }

    /// Bit `b` is kept when a winding of row `b` holds all limits; that winding is written back.
    #[inline(always)]
    fn mask_limits(&self, reachable: u8, rows: &Rows, out: &mut [[f64; 7]; 8]) -> u8 {
        let Inner { lower, upper, .. } = &*self.inner;
        let mut mask = 0;
        for (branch, row) in out.iter_mut().enumerate() {
            if reachable & (1 << branch) == 0 {
                continue;
            }
            let mut inside = true;
            for i in 0..7 {
                inside &= row[i] >= lower[i] && row[i] <= upper[i];
            }
            if !inside {
                let gimbal = rows.gimbal.to_array()[branch % 4];
                let Some(held) = self.hold_limits(row, gimbal) else { continue };
                *row = held;
            }
            mask |= 1 << branch;
        }
        mask
    }

    /// The winding of `q` within the limits. At the shoulder's gimbal (its sine is `gimbal`) joints 1 and 3 may share their sum.
    pub(super) fn hold_limits(&self, q: &[f64; 7], gimbal: f64) -> Option<[f64; 7]> {
        let Inner { lower, upper, geometry, .. } = &*self.inner;
        let held = |i: usize| within(q[i], lower[i], upper[i]);
        let mut out = *q;
        let shares = gimbal <= GIMBAL_PASSAGE && [0, 2].into_iter().any(|i| held(i).is_none());
        if shares {
            // Axis 3 is along axis 1 or against it.
            let sense = -(q[1] + geometry.zero2).cos().signum();
            let outer = |limits: &[f64; 7]| [limits[0], limits[2]];
            [out[0], out[2]] = shared([q[0], q[2]], sense, [0.0; 2], outer(lower), outer(upper))?;
        }
        for i in 0..7 {
            if !shares || (i != 0 && i != 2) {
                out[i] = held(i)?;
            }
        }
        Some(out)
    }

    /// Each joint's winding within its limits, or its principal value where there is none. For the ends of an arc, where a
    /// limit is met up to rounding.
    pub(super) fn wind(&self, q: &[f64; 7]) -> [f64; 7] {
        let Inner { lower, upper, .. } = &*self.inner;
        std::array::from_fn(|i| {
            within(q[i], lower[i] - EDGE_ROUNDING, upper[i] + EDGE_ROUNDING).unwrap_or(q[i])
        })
    }

    /// [`PandaClassArm::solve_into`] for many poses (`N * 16` numbers, row-major matrices) with one joint 7 each, or one for
    /// all: `N * 8 * 7` joint values to `q` and `N * 8` flags to `valid`. The same bits whatever the number of threads.
    ///
    /// # Errors
    /// Wrong lengths, a pose that is not rigid or finite (the message gives its index), a joint 7 that is not finite.
    pub fn solve_batch(
        &self,
        poses: &[f64],
        q7: &[f64],
        limits: bool,
        q: &mut [f64],
        valid: &mut [bool],
    ) -> Result<()> {
        let n = poses.len() / 16;
        check_length("poses", poses, n * 16)?;
        check_length("q7", q7, if q7.len() == 1 { 1 } else { n })?;
        check_finite("q7", q7)?;
        check_length("q", q, n * 56)?;
        if valid.len() != n * 8 {
            return Err(Error::Length { what: "valid".into(), expected: n * 8, actual: valid.len() });
        }
        let rows = q.as_chunks_mut::<56>().0.par_iter_mut().zip(valid.as_chunks_mut::<8>().0);
        rows.zip(poses.as_chunks::<16>().0).enumerate().with_min_len(TASK).try_for_each(
            |(i, ((q, valid), pose))| {
                let pose = pose_from_row_major(pose).map_err(at(i))?;
                let mut rows = [[0.0; 7]; 8];
                let q7 = if q7.len() == 1 { q7[0] } else { q7[i] };
                let mask = self.solve_into(&pose, q7, limits, &mut rows);
                q.copy_from_slice(rows.as_flattened());
                *valid = std::array::from_fn(|branch| mask & (1 << branch) != 0);
                Ok(())
            },
        )
    }
}
