//! The data of the search for a plan of tilt and spin.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize};

use nalgebra::{Const, SVector};

use super::convex::{PaintingBounds, SplinePlan};
use super::curve::Curve;
use super::motion::{Arm, Size, Workspace};
use super::result::Bottleneck;
use super::settings::{OrientationPlanSettings, SpinRange};
use crate::chain::Chain;
use crate::error::Result;
use crate::path::Path;
use crate::pose::Pose;
use crate::solutions::{ClosedForm, closed_form};
use crate::watch::{Deadline, Watch};

/// A start or what became of it.
pub(super) struct PlanCandidate<const N: usize, const M: usize> {
    pub spare: Vec<SVector<f64, N>>,
    pub state: SplinePlan<N, M>,
}

/// A plan evaluated on the finest grid.
pub(super) struct Verified {
    /// One over the square of the speed.
    pub t: f64,
    pub s: Vec<f64>,
    pub q: Vec<f64>,
    pub qd: Vec<f64>,
    pub poses: Vec<Pose>,
    pub tilt: Vec<[f64; 2]>,
    pub spin: Vec<f64>,
    pub torques: Vec<f64>,
    pub bottleneck: Bottleneck,
}

/// The search for a plan of an arm of `N` joints with `M` functions of arc length.
pub(super) struct OrientationPlanner<'a, const N: usize, const M: usize> {
    pub chain: &'a Chain,
    pub form: Option<Arc<dyn ClosedForm>>,
    pub path: &'a Path,
    pub curve: Curve,
    pub settings: &'a OrientationPlanSettings,
    pub bounds: PaintingBounds,
    pub workspace: Workspace<N>,
    pub watch: &'a Watch,
    pub deadline: Deadline,
    pub steps: AtomicUsize,
    /// Starts were left out for want of time.
    pub skipped: AtomicBool,
}

impl<'a, const N: usize, const M: usize> OrientationPlanner<'a, N, M>
where
    Const<N>: Size,
{
    pub fn new(
        chain: &'a Chain,
        path: &'a Path,
        settings: &'a OrientationPlanSettings,
        watch: &'a Watch,
    ) -> Result<Self> {
        let none = vec![f64::INFINITY; N];
        let limits = settings.speed.torque_limits.clone().unwrap_or_else(|| none.clone());
        settings.speed.check_masses(chain)?;
        let (lower, upper) = if settings.speed.joint_limits {
            (chain.lower().to_vec(), chain.upper().to_vec())
        } else {
            (vec![f64::NEG_INFINITY; N], none.clone())
        };
        let bounds = PaintingBounds {
            torque: limits.iter().map(|l| l * (1.0 - settings.torque_margin)).collect(),
            velocity: settings.speed.velocity_limits.clone().unwrap_or(none),
            lower,
            upper,
            tilt: settings.half_angle,
            spin: match settings.spin {
                SpinRange::Free => f64::INFINITY,
                SpinRange::Within(angle) => angle,
            },
            rate: settings.max_rate.unwrap_or(f64::INFINITY),
        };
        let curve = Curve::new(path);
        Ok(Self {
            chain,
            form: closed_form(chain),
            path,
            curve,
            settings,
            bounds,
            workspace: Workspace::new(chain)?,
            watch,
            deadline: Deadline::after(settings.time_limit),
            steps: AtomicUsize::new(0),
            skipped: AtomicBool::new(false),
        })
    }

    pub fn arm(&self, spare: &[SVector<f64, N>]) -> Arm<'a, N> {
        let bodies = self.chain.masses().ok();
        Arm { chain: self.chain, bodies, gravity: self.settings.speed.gravity, spare: spare.to_vec() }
    }

    /// True when the work up to `share` of the time must end.
    pub fn over(&self, share: f64) -> bool {
        self.watch.interrupted().is_some() || self.deadline.passed(share)
    }

    pub fn frozen(&self) -> [bool; 2] {
        [self.bounds.tilt == 0.0, self.bounds.spin == 0.0]
    }

    pub fn pose_at(&self, s: f64, u: [f64; 3]) -> Pose {
        let point = self.curve.at(s);
        let turned = point.turned([u, [0.0; 3], [0.0; 3]]);
        crate::pose::pose(*turned.rotation.matrix(), point.position[0])
    }

    pub fn plain_poses(&self, s: &[f64]) -> Vec<Pose> {
        s.iter().map(|s| self.pose_at(*s, [0.0; 3])).collect()
    }
}
