//! The self-motion over one pose: its curves, the points on them and their tangents.

use std::f64::consts::PI;
use std::sync::OnceLock;

use super::arcs::{Arcs, Limits};
use super::arm::PandaClassArm;
use super::proof::Proof;
use super::ring::{Miss, Ring, Sheet};
use super::target::Target;
use super::walk::Walk;
use crate::error::{Result, check_finite};
use crate::joint_space::{TURN, outside, wrap, wrap_sum};
use crate::pose::{Pose, checked_pose};
use crate::solutions::closed_form::Defect;
use crate::solutions::{check_margin, check_piece};
use crate::status::Status;
use crate::tolerance::{CLOSED_FORM_EXACT, SLOPE_ROUNDING};

/// Every configuration over one pose: closed curves, each with a fixed sign of the shoulder.
///
/// Piece `2 k + j` is curve k of the wrist (see the module of the class) with joint 2 positive (j = 0) or negative.
///
/// ```
/// use redundancy_core::{Status, chain::catalog, solutions::{PandaClassArm, Solutions}};
/// let chain = catalog::load("panda")?;
/// let pose = chain.forward(&[0.3, 0.5, -0.2, -1.1, 0.4, 1.7, -0.9])?;
/// let motion = PandaClassArm::new(&chain)?.self_motion(&pose)?;
/// assert_eq!(Solutions::status(&motion), Status::Converged);
/// let piece = (0..motion.pieces()).find(|p| motion.intervals(*p, 0.0).is_ok_and(|arcs| !arcs.is_empty())).unwrap_or(0);
/// let [lo, hi] = motion.intervals(piece, 0.0)?[0];
/// let mut q = [0.0; 7];
/// motion.q(piece, 0.5 * (lo + hi), &mut q)?;
/// assert!(chain.within_limits(&q, 0.0));
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct PandaMotion {
    pub(super) arm: PandaClassArm,
    pub(super) target: Target,
    /// The curves of the wrist.
    pub(super) sheets: Vec<Sheet>,
    miss: Option<Miss>,
    /// Feasible arcs without margin, computed on first use.
    arcs: OnceLock<Vec<Arcs>>,
    /// Why the verdict is not exact.
    not_proven: OnceLock<Option<String>>,
}

impl PandaClassArm {
    /// Every configuration over `pose`: closed curves of joint 7.
    ///
    /// # Errors
    /// A pose that is not rigid or finite.
    pub fn self_motion(&self, pose: &Pose) -> Result<PandaMotion> {
        let pose = &checked_pose("pose", pose)?;
        Ok(PandaMotion::new(self.clone(), pose))
    }
}

impl PandaMotion {
    /// Over a checked pose.
    pub(super) fn new(arm: PandaClassArm, pose: &Pose) -> Self {
        let g = &arm.inner.geometry;
        let target = Target::new(g, pose);
        let (sheets, miss) = match Ring::all(&target) {
            Err(miss) => (Vec::new(), Some(miss)),
            Ok(rings) => {
                let (mut sheets, mut most) = (Vec::new(), f64::NEG_INFINITY);
                for ring in rings {
                    let (found, room) = ring.sheets(g, &target);
                    sheets.extend(found);
                    most = most.max(room);
                }
                let miss = sheets.is_empty().then_some(Miss::Bend(most));
                (sheets, miss)
            }
        };
        Self { arm, target, sheets, miss, arcs: OnceLock::new(), not_proven: OnceLock::new() }
    }

    /// The arm.
    pub fn arm(&self) -> &PandaClassArm {
        &self.arm
    }

    /// True where there is a configuration, joint limits aside.
    pub(super) fn in_reach(&self) -> bool {
        !self.sheets.is_empty()
    }

    /// `Converged`, `Unreachable` (no configuration at all) or `Limits` (none within the joint limits).
    pub fn status(&self) -> Status {
        if !self.in_reach() {
            Status::Unreachable
        } else if self.arcs().iter().all(Arcs::is_empty) {
            Status::Limits
        } else {
            Status::Converged
        }
    }

    /// Why there is no configuration within the limits, with the number; empty when there is one.
    pub fn reason(&self) -> String {
        match (self.status(), self.miss) {
            (Status::Unreachable, Some(miss)) => unreachable_reason(miss),
            (Status::Limits, _) => self.limits_reason(),
            _ => String::new(),
        }
    }

    /// Whether status and curves say everything, see `proof.rs`: the arm is exact, the curves are proven to be all, and where none
    /// holds its limits that is proven too.
    pub fn proven(&self) -> bool {
        self.not_proven().is_none()
    }

    /// Why the verdict is not exact.
    pub(super) fn not_proven(&self) -> Option<&str> {
        let reason = self.not_proven.get_or_init(|| {
            let Defect { position, orientation } = self.arm.defect();
            if position.max(orientation) > CLOSED_FORM_EXACT {
                let what = "the verdict is that of an ideal arm";
                return Some(format!("{what}, {position:.1e} m and {orientation:.1e} rad away"));
            }
            let proof = Proof::new(&self.arm.inner, &self.target);
            if !proof.curves() {
                return Some("two curves touch, or nearly so: there may be one more, or one less".into());
            }
            let missed = self.status() == Status::Limits && !proof.nothing_within_limits();
            missed.then(|| "limits are nearly met: an arc may have been missed".into())
        });
        reason.as_deref()
    }

    /// Number of curves.
    pub fn pieces(&self) -> usize {
        2 * self.sheets.len()
    }

    /// Curve of the wrist and shoulder (0 or 1) of a piece.
    pub(super) fn piece(&self, piece: usize) -> Result<(&Sheet, usize)> {
        check_piece(piece, self.pieces())?;
        Ok((&self.sheets[piece / 2], piece % 2))
    }

    /// Walks along the curves of the wrist.
    pub(super) fn walk(&self) -> Walk<'_> {
        Walk { geometry: &self.arm.inner.geometry, target: &self.target }
    }

    /// The configuration at `u` of a piece (of period `2 pi`): principal values unless that breaks a limit and a winding does
    /// not.
    ///
    /// # Errors
    /// A piece that does not exist, a parameter that is not finite.
    pub fn q_at(&self, piece: usize, u: f64) -> Result<[f64; 7]> {
        let (sheet, shoulder) = self.piece(piece)?;
        check_finite("u", &[u])?;
        let node = self.walk().node(sheet, wrap(u));
        let q = node.q[shoulder].map(wrap_sum);
        Ok(self.arm.hold_limits(&q, node.gimbal).unwrap_or_else(|| self.arm.wind(&q)))
    }

    /// `dq/du` at `u` of a piece: in the kernel of the Jacobian, finite and not zero also where joint 4 or 7 turns back. Grows
    /// without bound towards the shoulder's gimbal; zero where it is not defined, as on a curve that has shrunk to a point.
    ///
    /// # Errors
    /// As [`PandaMotion::q_at`].
    pub fn tangent_at(&self, piece: usize, u: f64) -> Result<[f64; 7]> {
        let (sheet, shoulder) = self.piece(piece)?;
        check_finite("u", &[u])?;
        let rate = self.walk().node(sheet, wrap(u)).rate[shoulder];
        Ok(if rate.iter().all(|x| x.is_finite()) { rate } else { [0.0; 7] })
    }

    /// Where all joint limits hold with `margin` (rad, per joint, from each limit): intervals `[lo, hi]` of u, ascending, `lo`
    /// in `[-pi, pi)`; u is inside when `(u - lo) mod 2 pi <= hi - lo`. A single touching point has `lo = hi`.
    ///
    /// # Errors
    /// A piece that does not exist, a margin that is negative or not finite.
    pub fn intervals(&self, piece: usize, margin: f64) -> Result<Vec<[f64; 2]>> {
        let (sheet, shoulder) = self.piece(piece)?;
        check_margin(margin)?;
        if margin == 0.0 {
            return Ok(self.arcs()[piece / 2].of(shoulder));
        }
        let limits = Limits::new(&self.arm.inner.lower, &self.arm.inner.upper, margin);
        Ok(Arcs::new(&self.walk(), sheet, &limits).of(shoulder))
    }

    /// Feasible arcs without margin, one entry per curve of the wrist.
    pub(super) fn arcs(&self) -> &[Arcs] {
        self.arcs.get_or_init(|| {
            let limits = Limits::new(&self.arm.inner.lower, &self.arm.inner.upper, 0.0);
            self.sheets.iter().map(|sheet| Arcs::new(&self.walk(), sheet, &limits)).collect()
        })
    }

    /// Which limit is missed by how little at best: the least violation over all curves, on a grid and refined around its best.
    #[cold]
    fn limits_reason(&self) -> String {
        const SAMPLES: usize = 360;
        let inner = &self.arm.inner;
        let violation = |sheet: &Sheet, shoulder: usize, u: f64| {
            let q = self.walk().node(sheet, u).q[shoulder];
            let misses = (0..7).map(|i| (outside(q[i], inner.lower[i], inner.upper[i]), i));
            misses.fold((0.0, 0), |a, b| if b.0 > a.0 { b } else { a })
        };
        let mut best: Option<((f64, usize), &Sheet, usize, f64)> = None;
        for sheet in &self.sheets {
            for shoulder in [0, 1] {
                for k in 0..SAMPLES {
                    let u = TURN * k as f64 / SAMPLES as f64 - PI;
                    let miss = violation(sheet, shoulder, u);
                    if best.is_none_or(|b| miss.0 < b.0.0) {
                        best = Some((miss, sheet, shoulder, u));
                    }
                }
            }
        }
        let Some((mut miss, sheet, shoulder, mut at)) = best else { return String::new() };
        let mut step = TURN / SAMPLES as f64;
        while step > SLOPE_ROUNDING {
            for u in [at - step, at + step] {
                let tried = violation(sheet, shoulder, u);
                if tried.0 < miss.0 {
                    (miss, at) = (tried, u);
                }
            }
            step *= 0.5;
        }
        let joint = &inner.chain.joints()[miss.1];
        format!(
            "no curve of the self-motion is within all joint limits; even the best point leaves joint '{}' {:.6} rad outside [{:.6}, {:.6}]",
            joint.name, miss.0, joint.limits.lower, joint.limits.upper
        )
    }
}

fn unreachable_reason(miss: Miss) -> String {
    match miss {
        Miss::TooFar(distance) => format!(
            "the wrist would be {:.6} mm too far from the shoulder at every value of joint 7",
            1e3 * distance
        ),
        Miss::TooNear(distance) => format!(
            "the wrist would be {:.6} mm too near to the shoulder at every value of joint 7",
            1e3 * distance
        ),
        Miss::Bend(room) => format!(
            "axes 5 and 6 cannot be at their angle to each other at any value of joint 7: the chord from shoulder to wrist \
             would have to be {:.6} mm longer",
            1e3 * (-room).max(0.0).sqrt()
        ),
    }
}
