//! Hints at wrong units: paths that seem to be in millimetres, joints that seem to be in degrees.

use nalgebra::Vector3;

use super::chain::Chain;
use super::joint::JointKind;
use crate::joint_space::TURN;
use crate::pose::Pose;
use crate::tolerance::{DEGREE_TURNS, MILLIMETRE_REACHES};

impl Chain {
    /// Distance (m) from the first joint's frame beyond which the tool cannot get: from frame to frame, added up, with the
    /// travel of sliding joints. Infinite where a sliding joint has no limits. An upper bound, not the exact reach.
    ///
    /// ```
    /// let arm = redundancy_core::chain::catalog::load("planar3r")?;
    /// assert_eq!(arm.reach(), 7.5);
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn reach(&self) -> f64 {
        let mut reach = 0.0;
        for (i, joint) in self.joints().iter().enumerate() {
            if i > 0 {
                reach += joint.placement.translation.vector.norm();
            }
            if joint.kind == JointKind::Prismatic {
                reach += joint.limits.lower.abs().max(joint.limits.upper.abs());
            }
        }
        let tip = self.links().last().map_or_else(Pose::identity, |link| link.offset) * self.tool();
        reach + tip.translation.vector.norm()
    }

    /// Asks whether these positions (world, m) are in millimetres, where all of them are farther from the first joint than
    /// [`MILLIMETRE_REACHES`] times the reach.
    ///
    /// ```
    /// use redundancy_core::nalgebra::Vector3;
    /// let arm = redundancy_core::chain::catalog::load("iiwa14")?;
    /// let [near, far] = [Vector3::new(0.5, 0.0, 0.4), Vector3::new(500.0, 0.0, 400.0)];
    /// assert!(arm.ask_about_millimetres([near, far]).is_none());
    /// assert!(arm.ask_about_millimetres([far]).is_some_and(|text| text.ends_with("in millimetres?")));
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn ask_about_millimetres(&self, positions: impl IntoIterator<Item = Vector3<f64>>) -> Option<String> {
        let first = self.joints().first()?;
        let from = (self.base() * first.placement).translation.vector;
        let nearest = positions.into_iter().map(|p| (p - from).norm()).reduce(f64::min)?;
        let reach = self.reach();
        (nearest > MILLIMETRE_REACHES * reach).then(|| {
            format!(
                "the nearest position is {nearest:.1} m away from the arm, {:.0} times its reach of {reach:.3} m: are the \
                 positions in millimetres?",
                nearest / reach
            )
        })
    }

    /// Asks whether joint positions (one or more rows, rad) are in degrees, where one of a turning joint is beyond
    /// [`DEGREE_TURNS`] turns.
    ///
    /// ```
    /// let arm = redundancy_core::chain::catalog::load("planar3r")?;
    /// assert!(arm.ask_about_degrees(&[0.0, 90.0, 100.0]).is_none());
    /// assert!(arm.ask_about_degrees(&[0.0, 90.0, -180.0]).is_some_and(|text| text.ends_with("in degrees?")));
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn ask_about_degrees(&self, q: &[f64]) -> Option<String> {
        let turning =
            q.iter().zip(self.joints().iter().cycle()).filter(|(_, joint)| joint.kind.is_rotational());
        let (q, joint) = turning.max_by(|(a, _), (b, _)| a.abs().total_cmp(&b.abs()))?;
        (q.abs() > DEGREE_TURNS * TURN).then(|| {
            let (name, turns) = (&joint.name, q.abs() / TURN);
            format!("joint '{name}' is at {q} rad, {turns:.1} turns: are the joint positions in degrees?")
        })
    }
}
