//! Closed-form inverse kinematics of spherical-revolute-spherical arms [Moore2010], with
//! corrections.
//!
//! For a pose the wrist centre W is fixed. With `v = W - S`, `d = |v|`, `n = v/d` and arms of length L2, L3:
//!
//! 1. reachable iff `|L2 - L3| <= d <= L2 + L3`;
//! 2. `P = sqrt((d^2 - (L2-L3)^2) ((L2+L3)^2 - d^2))`, `a = (d^2 + L2^2 - L3^2)/(2d)`, `rho = P/(2d)`,
//!    `theta4 = atan2(P, d^2 - L2^2 - L3^2)`. (The paper's eq. (21) holds only when the circle's centre lies between S
//!    and W, and has the other elbow's sign in its example.)
//! 3. `w = cos s w0 + sin s w1` ([`Chart`]); elbow at `S + a n + rho w`;
//! 4. `y3 = w x n`, `z3 = (a n + rho w)/L2`, `x3 = (rho n - a w)/L2`: valid for rho = 0, where the paper's eq. (23) is
//!    0/0. The other elbow negates x3 and y3;
//! 5. joints 1..3 are the ZYZ angles of `R3 = [x3 y3 z3]`, joints 5..7 those of `(R3 Ry(theta4))^T R`.
//!
//! The third ZYZ angle is taken from the second row of `Rz(-first) R`, not from the last row as in the paper's
//! eqs (11), (12): that is well conditioned through the gimbal, where only first + third is defined (first = 0 then).
//!
//! The eight branches are the signs of theta2, theta4, theta6. Without an elbow offset they share seven arc
//! tangents: theta1 and theta7 turn by pi with the sign of theta2 and theta6, theta3 with s2 s4, theta5 with s4 s6.

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use super::chart::{Chart, zero_direction};
use super::elbow_circle::{ElbowCircle, Reach};
use super::geometry::Geometry;
use super::intervals::{Bound, bounds};
use crate::chain::Chain;
use crate::error::{Error, Result};
use crate::joint_space::{wind_into, within, wrap};
use crate::pose::{Pose, checked_pose};
use crate::solutions::Defect;
use crate::status::Status;
use crate::tolerance::{EDGE_ROUNDING, GIMBAL_FORCE, LIMIT_FORCE, REACH_ROUNDING};

/// A swivel: where the elbow is on its circle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Swivel {
    /// The angle s, rad.
    Angle(f64),
    /// The swivel quaternion `u = (cos s, sin s)` of [Moore2010, eq. (13)]; of any length but zero. No trigonometric
    /// function of s is evaluated then.
    Direction(f64, f64),
}

impl Swivel {
    /// The unit vector `(cos s, sin s)`.
    pub(super) fn direction(self) -> Result<[f64; 2]> {
        match self {
            Self::Angle(s) if s.is_finite() => {
                let (sin, cos) = s.sin_cos();
                Ok([cos, sin])
            }
            Self::Angle(s) => Err(Error::NotFinite { what: "swivel".into(), index: 0, value: s }),
            Self::Direction(x, y) => {
                crate::error::check_finite("swivel", &[x, y])?;
                let norm = x.hypot(y);
                if norm < crate::tolerance::DIRECTION_NORM {
                    let (what, minimum) =
                        ("swivel (cos s, sin s)".to_string(), crate::tolerance::DIRECTION_NORM);
                    return Err(Error::ZeroDirection { what, norm, minimum });
                }
                Ok([x / norm, y / norm])
            }
        }
    }
}

/// A recognised spherical-revolute-spherical arm with its closed-form inverse kinematics.
///
/// ```
/// use redundancy_core::chain::catalog;
/// use redundancy_core::solutions::{SrsArm, Swivel};
/// let chain = catalog::load("pa10")?;
/// let arm = SrsArm::new(&chain)?;
/// let q = [0.3, 0.5, -0.2, 1.1, 0.4, 0.7, -0.9];
/// let pose = chain.forward(&q)?;
/// let same = arm.solve(&pose, Swivel::Angle(arm.swivel(&q)?), true)?;
/// assert!(same.iter().any(|p| p.iter().zip(&q).all(|(a, b)| (a - b).abs() < 1e-12)));
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct SrsArm {
    pub(super) inner: Arc<Inner>,
}

/// The same chain seen in the same chart: everything else follows.
impl PartialEq for SrsArm {
    fn eq(&self, other: &Self) -> bool {
        self.inner.chain == other.inner.chain && self.inner.chart == other.inner.chart
    }
}

#[derive(Debug)]
pub(super) struct Inner {
    pub chain: Chain,
    pub chart: Chart,
    pub geometry: Geometry,
    pub chart_frame: Matrix3<f64>,
    /// From chart frame to swivel frame; `None` where they are the same.
    pub chart_to_frame: Option<Matrix3<f64>>,
    pub lower: [f64; 7],
    pub upper: [f64; 7],
    /// The limits as arcs of the paper's angles.
    pub bounds: [Bound; 7],
}

impl SrsArm {
    /// Recognises the arm, with the paper's chart.
    ///
    /// # Errors
    /// [`Error::NotSrs`]: which axes miss each other and by how many millimetres.
    pub fn new(chain: &Chain) -> Result<Self> {
        Self::with_chart(chain, Chart::default())
    }

    /// Recognises the arm, with a chart of choice.
    ///
    /// # Errors
    /// [`Error::NotSrs`], or a reference direction without length.
    pub fn with_chart(chain: &Chain, chart: Chart) -> Result<Self> {
        let geometry = Geometry::recognise(chain)?;
        let axis1 = geometry.frame.column(2).into();
        let chart_frame = chart.frame(&axis1, chain.base().rotation.matrix())?;
        let same = (chart_frame - geometry.frame).amax() == 0.0;
        let chart_to_frame = (!same).then(|| geometry.frame.tr_mul(&chart_frame));
        let (mut lower, mut upper) = ([0.0; 7], [0.0; 7]);
        lower.copy_from_slice(chain.lower());
        upper.copy_from_slice(chain.upper());
        let bounds = bounds(&geometry, &lower, &upper, 0.0);
        let chain = chain.clone();
        let inner = Inner { chain, chart, geometry, chart_frame, chart_to_frame, lower, upper, bounds };
        Ok(Self { inner: Arc::new(inner) })
    }

    /// The chain that was recognised.
    pub fn chain(&self) -> &Chain {
        &self.inner.chain
    }

    /// The chart of the swivel.
    pub fn chart(&self) -> Chart {
        self.inner.chart
    }

    /// How far the arm is from an ideal S-R-S arm: what the closed form returns meets the pose within
    /// `1e-12 + 2 x` this.
    pub fn defect(&self) -> Defect {
        self.inner.geometry.defect
    }

    /// Lengths of upper arm and forearm, m: shoulder and wrist centre to the elbow axis.
    pub fn lengths(&self) -> [f64; 2] {
        [self.inner.geometry.upper_arm, self.inner.geometry.forearm]
    }

    /// Centre of the shoulder in the world, m.
    pub fn shoulder(&self) -> Vector3<f64> {
        self.inner.geometry.shoulder
    }

    /// Centre of the wrist in the tool frame, m.
    pub fn wrist_in_tool(&self) -> Vector3<f64> {
        self.inner.geometry.wrist_in_tool
    }

    /// Configurations over `pose` at a swivel: with `limits` those within the joint limits, in branch order; without,
    /// always all eight (repeats at a gimbal included). Empty when the pose is out of reach; [`SrsArm::self_motion`]
    /// says by how much.
    ///
    /// # Errors
    /// A pose that is not rigid or finite, a swivel that is not finite.
    pub fn solve(&self, pose: &Pose, swivel: Swivel, limits: bool) -> Result<Vec<[f64; 7]>> {
        let pose = &checked_pose("pose", pose)?;
        let u = swivel.direction()?;
        let (circle, reach) = self.circle(pose);
        if reach != Reach::Inside {
            return Ok(Vec::new());
        }
        let mut all = [[0.0; 7]; 8];
        circle.all_branches(&self.inner.geometry, u, &mut all);
        if !limits {
            return Ok(all.to_vec());
        }
        Ok(all.into_iter().filter_map(|q| self.hold_limits(&q)).collect())
    }

    /// [`SrsArm::solve`] for checked input, without allocation: writes all eight branches and returns which of them
    /// are valid, bit `b` for branch `b` (all or none without `limits`). Rows that are not valid are finite.
    #[inline]
    pub fn solve_into(&self, pose: &Pose, u: [f64; 2], limits: bool, out: &mut [[f64; 7]; 8]) -> u8 {
        let (circle, reach) = self.circle(pose);
        circle.all_branches(&self.inner.geometry, u, out);
        if reach != Reach::Inside {
            return 0;
        }
        if !limits {
            return 0xff;
        }
        self.mask_limits(out)
    }

    /// Bit `b` is set when a winding of row `b` holds all limits; that winding is written back.
    #[inline]
    fn mask_limits(&self, rows: &mut [[f64; 7]; 8]) -> u8 {
        let (lower, upper) = (&self.inner.lower, &self.inner.upper);
        let mut mask = 0;
        for (branch, row) in rows.iter_mut().enumerate() {
            let mut inside = true;
            for i in 0..7 {
                inside &= row[i] >= lower[i] && row[i] <= upper[i];
            }
            if inside {
                mask |= 1 << branch;
            } else if let Some(q) = self.hold_limits(row) {
                *row = q;
                mask |= 1 << branch;
            }
        }
        mask
    }

    /// The winding of `q` within the limits, see [`within`].
    pub(super) fn hold_limits(&self, q: &[f64; 7]) -> Option<[f64; 7]> {
        let mut out = *q;
        for i in 0..7 {
            out[i] = within(q[i], self.inner.lower[i], self.inner.upper[i])?;
        }
        Some(out)
    }

    /// The windings of `q` within the limits, or some windings where there are none; and which of both.
    pub(crate) fn within_limits_or_wound(&self, q: &[f64; 7]) -> ([f64; 7], bool) {
        match self.hold_limits(q) {
            Some(q) => (q, true),
            None => (self.wind(q), false),
        }
    }

    /// Slopes along the swivel, for the rates `dq/ds` of a configuration: of the logarithm of the gimbals' sines, and of
    /// `sum_i (x_i^2 / (1 - x_i^2))^2` with x the place in the joint ranges.
    pub(crate) fn gimbal_and_limit_slopes(&self, q: &[f64; 7], rates: &[f64; 7]) -> (f64, f64) {
        let Inner { geometry, lower, upper, .. } = &*self.inner;
        let mut gimbal = 0.0;
        for i in [1, 5] {
            let (sin, cos) = (geometry.sign[i] * (q[i] - geometry.zero[i])).sin_cos();
            // cot, cut off where the gimbal is near anyway.
            let cot = sin * cos / (sin * sin + GIMBAL_FORCE * GIMBAL_FORCE);
            gimbal += GIMBAL_FORCE * cot * geometry.sign[i] * rates[i];
        }
        let mut limits = 0.0;
        for i in 0..7 {
            let half = 0.5 * (upper[i] - lower[i]);
            if half.is_finite() && half > 0.0 {
                let wound = within(q[i], lower[i], upper[i]).unwrap_or(q[i]);
                let x = ((wound - lower[i]) / half - 1.0).clamp(-LIMIT_FORCE, LIMIT_FORCE);
                let room = 1.0 - x * x;
                // d/dx (x^2 / (1 - x^2))^2 = 4 x^3 / (1 - x^2)^3
                limits += 4.0 * x.powi(3) / room.powi(3) * rates[i] / half;
            }
        }
        (gimbal, limits)
    }

    /// Each joint's winding within its limits, or its principal value where there is none. For rows that do not hold
    /// all limits, such as those at the end of an interval where the limit is met up to rounding.
    pub(super) fn wind(&self, q: &[f64; 7]) -> [f64; 7] {
        std::array::from_fn(|i| {
            let (lower, upper) = (self.inner.lower[i] - EDGE_ROUNDING, self.inner.upper[i] + EDGE_ROUNDING);
            wind_into(q[i], lower, upper)
        })
    }

    /// The swivel angle of a configuration, rad in `(-pi, pi]`: `w = sgn(sin theta4) n x y3`, `s = atan2(w.w1, w.w0)`,
    /// well conditioned also for the stretched arm, where [Moore2010, eq. (16)] is 0/0.
    ///
    /// # Errors
    /// Wrong length of `q`, or an entry that is not finite.
    pub fn swivel(&self, q: &[f64]) -> Result<f64> {
        self.chain().check_q(q)?;
        let (circle, _) = self.circle(&self.chain().forward_unchecked(q));
        let w = circle.n.cross(&self.elbow_axis(q)) * f64::from(self.sign_of(q, 3));
        Ok(w.dot(&circle.w1).atan2(w.dot(&circle.w0)))
    }

    /// The angle to add to a swivel of this arm's chart to have that of `other`'s chart; it depends on the pose alone.
    ///
    /// # Errors
    /// A pose that is not rigid or finite.
    pub fn chart_change(&self, other: &Self, pose: &Pose) -> Result<f64> {
        let pose = &checked_pose("pose", pose)?;
        let (mine, theirs) = (self.circle(pose).0, other.circle(pose).0);
        let w = other.inner.geometry.frame.tr_mul(&(self.inner.geometry.frame * mine.w0));
        Ok(w.dot(&theirs.w1).atan2(w.dot(&theirs.w0)))
    }

    /// Elbow axis in its positive sense at `q`, swivel frame.
    fn elbow_axis(&self, q: &[f64]) -> Vector3<f64> {
        let geometry = &self.inner.geometry;
        let [a, b, c] = [0, 1, 2].map(|i| geometry.sign[i] * (q[i] - geometry.zero[i]));
        let ((sa, ca), (sb, cb), (sc, cc)) = (a.sin_cos(), b.sin_cos(), c.sin_cos());
        let zyz = Matrix3::new(
            ca * cb * cc - sa * sc,
            -ca * cb * sc - sa * cc,
            ca * sb,
            sa * cb * cc + ca * sc,
            -sa * cb * sc + ca * cc,
            sa * sb,
            -sb * cc,
            sb * sc,
            cb,
        );
        // V = (V C) C^T, and y3 is its second column.
        zyz * geometry.shoulder_offset.row(1).transpose()
    }

    /// Signs `[s2, s4, s6]` of a configuration, from the sines of the paper's angles; a zero counts as +.
    ///
    /// # Errors
    /// Wrong length of `q`, or an entry that is not finite.
    pub fn branch(&self, q: &[f64]) -> Result<[i8; 3]> {
        self.chain().check_q(q)?;
        Ok([1, 3, 5].map(|i| self.sign_of(q, i)))
    }

    /// Sign of the paper's angle `i` (0-based) of a configuration.
    fn sign_of(&self, q: &[f64], i: usize) -> i8 {
        let geometry = &self.inner.geometry;
        if wrap(geometry.sign[i] * (q[i] - geometry.zero[i])) < 0.0 { -1 } else { 1 }
    }

    /// What depends only on the pose, and whether it is in reach. The pose must be checked.
    #[inline]
    pub(super) fn circle(&self, pose: &Pose) -> (ElbowCircle, Reach) {
        let Inner { geometry, chart_frame, chart_to_frame, .. } = &*self.inner;
        let rotation = pose.rotation.matrix();
        let wrist = rotation * geometry.wrist_in_tool + pose.translation.vector;
        let v = wrist - geometry.shoulder;
        let squared = v.norm_squared();
        let d = squared.sqrt();
        let (l2, l3) = (geometry.upper_arm, geometry.forearm);
        // In chart axes; an arm folded onto its shoulder has no n, any direction serves.
        let n = if d > f64::MIN_POSITIVE { chart_frame.tr_mul(&v) / d } else { Vector3::z() };
        let w0 = zero_direction(&n);
        let (n, w0) = match chart_to_frame {
            None => (n, w0),
            Some(m) => (m * n, m * w0),
        };
        let (sum, difference) = (l2 + l3, l2 - l3);
        let slack = REACH_ROUNDING * sum;
        let reach = if d > sum + slack {
            Reach::TooFar(d - sum)
        } else if d < difference.abs() - slack {
            Reach::TooNear(difference.abs() - d)
        } else {
            Reach::Inside
        };
        // (d - |L2 - L3|) (d + |L2 - L3|) and so on: no cancellation of squares.
        let product =
            (d - difference.abs()).max(0.0) * (d + difference.abs()) * (sum - d).max(0.0) * (sum + d);
        let p = product.sqrt();
        // 2 L2 L3 cos(theta4), the same P for theta4 and for the circle.
        let c = squared - l2 * l2 - l3 * l3;
        let scale = 1.0 / (p * p + c * c).sqrt();
        let (cos_elbow, sin_elbow) = (c * scale, p * scale);
        // Upper arm against n: adjacent side L2 + L3 cos(theta4), opposite side L3 sin(theta4).
        let (adjacent, opposite) = (l2 + l3 * cos_elbow, l3 * sin_elbow);
        let length = (adjacent * adjacent + opposite * opposite).sqrt();
        let (cos_upper, sin_upper) =
            if length > f64::MIN_POSITIVE { (adjacent / length, opposite / length) } else { (0.0, 1.0) };
        let tool = geometry.frame.tr_mul(rotation) * geometry.tool_offset;
        let circle =
            ElbowCircle { n, w0, w1: n.cross(&w0), cos_upper, sin_upper, cos_elbow, sin_elbow, tool };
        (circle, reach)
    }

    /// What to tell about a pose out of reach.
    pub(super) fn reach_reason(reach: Reach) -> Option<(Status, String)> {
        let (distance, how) = match reach {
            Reach::Inside => return None,
            Reach::TooFar(distance) => (distance, "far from"),
            Reach::TooNear(distance) => (distance, "near to"),
        };
        Some((
            Status::Unreachable,
            format!("the wrist would be {:.6} mm too {how} the shoulder", 1e3 * distance),
        ))
    }
}
