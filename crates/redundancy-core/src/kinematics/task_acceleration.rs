//! What the coordinates of a task accelerate by at constant joint velocity: `Jdot qd`.
//!
//! With the axes `w_k` of turning joints (zero for sliding ones) and the linear columns `v_k` of the Jacobian,
//!
//! ```text
//! linear:   sum_k (2 sum_{j<k} w_j qd_j + w_k qd_k) x v_k qd_k          angular:  sum_k (sum_{j<k} w_j qd_j) x w_k qd_k
//! ```
//!
//! which needs the columns alone and costs n cross products. For `pose_rpy`, with `omega = B rates` and the columns
//! `ez, Rz ey, Rz Ry ex` of B, the rates accelerate by `B^-1 (angular - Bdot rates)`. The coordinates of `pointing` are those
//! of the angular acceleration across the tool axis, as its velocities are those of the angular velocity.

use nalgebra::{Vector3, Vector6};

use super::scratch::Kinematics;
use super::task::{Task, TaskKind};

impl Kinematics<'_> {
    /// Linear and angular acceleration of the tool for the joint velocity `qd` and no joint acceleration, world axes.
    pub fn velocity_product(&self, qd: &[f64]) -> Vector6<f64> {
        let (mut before, mut linear, mut angular) = (Vector3::zeros(), Vector3::zeros(), Vector3::zeros());
        for (k, qd) in qd.iter().enumerate() {
            let (turn, column) = (self.angular(k) * *qd, self.linear(k) * *qd);
            linear += (before * 2.0 + turn).cross(&column);
            angular += before.cross(&turn);
            before += turn;
        }
        Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
    }
}

impl Task {
    /// `Jdot qd` in the coordinates of the task, zero from `dim` on: they accelerate by `J qdd` and this.
    ///
    /// ```
    /// use redundancy_core::{chain::catalog, kinematics::{Scratch, Task}};
    /// let arm = catalog::load("planar3r")?;
    /// let mut scratch = Scratch::new(&arm);
    /// let kinematics = arm.kinematics(&[0.0; 3], &mut scratch)?; // stretched along x, 7.5 m long
    /// let turning = Task::PLANAR.velocity_product(&kinematics, &[2.0, 0.0, 0.0]);
    /// assert!((turning[0] + 7.5 * 4.0).abs() < 1e-12); // towards the axis
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn velocity_product(&self, kinematics: &Kinematics<'_>, qd: &[f64]) -> Vector6<f64> {
        let mut twist = kinematics.velocity_product(qd);
        let pose = kinematics.pose();
        if self.kind() == TaskKind::PoseRpy {
            let spin: Vector3<f64> = (0..qd.len()).map(|k| kinematics.angular(k) * qd[k]).sum();
            let rates = self.from_twist(pose, &Vector6::new(0.0, 0.0, 0.0, spin.x, spin.y, spin.z));
            let column = |axis: usize| {
                let mut unit = Vector6::zeros();
                unit[3 + axis] = 1.0;
                let twist = self.twist(pose, &unit);
                Vector3::new(twist[3], twist[4], twist[5])
            };
            let (first, second, third) = (column(0), column(1), column(2));
            let heading = first * rates[3];
            let turned =
                heading.cross(&second) * rates[4] + (heading + second * rates[4]).cross(&third) * rates[5];
            for i in 0..3 {
                twist[3 + i] -= turned[i];
            }
        }
        self.from_twist(pose, &twist)
    }
}
