//! The elbow of an arm with seven joints and more: its angle about the line from shoulder to wrist, and how far that line reaches.

use nalgebra::Vector3;

use super::thresholds::{SERVO_ELBOW_ON_LINE, SERVO_REACH_DEPENDS};
use crate::chain::Chain;
use crate::kinematics::{Kinematics, Scratch};
use crate::solutions::SrsArm;

/// Joints whose origins are shoulder, elbow and wrist, counted from 0.
const SHOULDER: usize = 1;
const ELBOW: usize = 3;
const WRIST: usize = 5;
/// Least number of joints of an arm with an elbow that is free to turn.
pub(super) const ELBOW_JOINTS: usize = 7;

/// How a swivel angle is counted.
#[derive(Debug, Clone)]
pub(super) enum SwivelChart {
    /// The chart of an S-R-S arm.
    Srs(Box<SrsArm>),
    /// From this direction, projected across the line from shoulder to wrist.
    Reference(Vector3<f64>),
    /// Only relative to an elbow that is given.
    None,
}

/// Shoulder, elbow and wrist at one configuration.
#[derive(Debug, Clone, Copy)]
pub(super) struct ElbowPlace {
    pub shoulder: Vector3<f64>,
    /// Unit vector from shoulder to wrist.
    pub line: Vector3<f64>,
    /// Unit vector from that line to the elbow.
    pub across: Vector3<f64>,
    elbow: Vector3<f64>,
    radius: f64,
}

impl ElbowPlace {
    /// `None` where the elbow is on the line, or shoulder and wrist coincide.
    pub fn of(kinematics: &Kinematics<'_>) -> Option<Self> {
        let origins = kinematics.origins();
        let (shoulder, elbow, wrist) = (*origins.get(SHOULDER)?, *origins.get(ELBOW)?, *origins.get(WRIST)?);
        let reach = wrist - shoulder;
        let length = reach.norm();
        if length < SERVO_ELBOW_ON_LINE {
            return None;
        }
        let line = reach / length;
        let off = elbow - shoulder;
        let off = off - line * line.dot(&off);
        let radius = off.norm();
        if radius < SERVO_ELBOW_ON_LINE {
            return None;
        }
        Some(Self { shoulder, line, across: off / radius, elbow, radius })
    }

    /// Angle about the line from the present elbow to the direction of `point` from the shoulder; `None` for a point on the line.
    pub fn angle_to(&self, point: &Vector3<f64>) -> Option<f64> {
        self.angle_to_direction(&(point - self.shoulder))
    }

    /// The same for a direction.
    pub fn angle_to_direction(&self, direction: &Vector3<f64>) -> Option<f64> {
        let (x, y) = (direction.dot(&self.across), direction.dot(&self.line.cross(&self.across)));
        (x.hypot(y) > SERVO_ELBOW_ON_LINE * direction.norm()).then(|| y.atan2(x))
    }

    /// Rate of the elbow's angle per joint, while shoulder and wrist rest.
    pub fn gradient(&self, kinematics: &Kinematics<'_>, chain: &Chain, out: &mut [f64]) {
        let along = self.line.cross(&self.across) / self.radius;
        out.fill(0.0);
        let parts = kinematics.axes().iter().zip(kinematics.origins()).zip(chain.joints());
        for (out, ((axis, origin), joint)) in out.iter_mut().zip(parts).take(ELBOW) {
            let velocity =
                if joint.kind.is_rotational() { axis.cross(&(self.elbow - origin)) } else { *axis };
            *out = velocity.dot(&along);
        }
    }
}

/// Shortest and longest distance from shoulder to wrist, where it depends on the elbow joint alone.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reach {
    pub least: f64,
    pub most: f64,
    /// The target is, or was just now, out of reach.
    outside: bool,
}

impl Reach {
    /// `None` for arms whose distance from shoulder to wrist depends on other joints too.
    pub fn of(chain: &Chain) -> Option<Self> {
        const SAMPLES: usize = 2000;
        if chain.dof() != ELBOW_JOINTS || !chain.joints().iter().all(|joint| joint.kind.is_rotational()) {
            return None;
        }
        let mut scratch = Scratch::new(chain);
        let mut distance = |q: &[f64]| {
            let origins = chain.kinematics_unchecked(q, &mut scratch);
            let origins = origins.origins();
            (origins[WRIST] - origins[SHOULDER]).norm()
        };
        let (lower, upper) = (chain.lower()[ELBOW], chain.upper()[ELBOW]);
        let (lower, upper) = if lower.is_finite() && upper.is_finite() {
            (lower, upper)
        } else {
            (-std::f64::consts::PI, std::f64::consts::PI)
        };
        let mut reach = Self { least: f64::INFINITY, most: 0.0, outside: false };
        for k in 0..=SAMPLES {
            let mut q = [0.0; ELBOW_JOINTS];
            q[ELBOW] = lower + (upper - lower) * k as f64 / SAMPLES as f64;
            let alone = distance(&q);
            // Incommensurable steps of the others: if one of them mattered, some sample would show it.
            for (i, q) in q.iter_mut().enumerate().filter(|(i, _)| *i != ELBOW) {
                *q = (k as f64 * (0.61 + 0.37 * i as f64)).sin() * 3.0;
            }
            if (distance(&q) - alone).abs() > SERVO_REACH_DEPENDS {
                return None;
            }
            reach.least = reach.least.min(alone);
            reach.most = reach.most.max(alone);
        }
        (reach.most > reach.least).then_some(reach)
    }

    /// How far the target has to move for the wrist to stay within reach, with the wrist's present place in the tool.
    pub fn shift(
        &mut self,
        kinematics: &Kinematics<'_>,
        target: &crate::pose::Pose,
        ahead: &Vector3<f64>,
        bend: [f64; 3],
    ) -> Vector3<f64> {
        let origins = kinematics.origins();
        let (Some(shoulder), Some(wrist)) = (origins.get(SHOULDER), origins.get(WRIST)) else {
            return Vector3::zeros();
        };
        let in_tool = kinematics.pose().inverse_transform_point(&nalgebra::Point3::from(*wrist));
        let wanted = (target * in_tool).coords - shoulder;
        let distance = wanted.norm();
        if distance < SERVO_ELBOW_ON_LINE {
            return Vector3::zeros();
        }
        let [start, width, lead] = bend;
        let soft = (self.most - start).max(self.least);
        // The wrist follows a target beyond the soft end of the reach ever less, and never stretches the arm.
        let within = |distance: f64| {
            let beyond = (distance - soft).max(0.0);
            distance.max(self.least) - beyond + width * beyond / (beyond + width)
        };
        let mut kept = within(distance);
        self.outside = distance > self.most || (self.outside && distance > soft - lead);
        if self.outside {
            // A target that comes back is met: the elbow begins to bend while it is still outside.
            let soon = distance + (ahead.dot(&wanted) / distance).min(0.0);
            kept = kept.min(within(soon).max(soft - lead)).max(self.least);
        }
        wanted * (kept / distance - 1.0)
    }
}
