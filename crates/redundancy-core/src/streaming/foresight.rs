//! How long the tool can go on as it does before the arm has to stop, or to flip.
//!
//! The tool's present velocity is extended in steps of [`SERVO_LOOK_STEP`], and the arm follows it from the present configuration with
//! the least joint motion; joints at their limits stay there. A step that misses its pose, leaves the reach or asks
//! for more than the velocity limits ends the look. One step per tick keeps the cost of a tick the same, so that
//! an answer is as old as the look took; that time is taken off.

use nalgebra::{Rotation3, Translation3, Vector3};

use super::joint::JointLimits;
use super::reference::Reference;
use super::thresholds::{SERVO_LOOK_AHEAD, SERVO_LOOK_STEP, SERVO_SLOW};
use crate::pose::Pose;

/// A look ahead, a step per tick.
#[derive(Debug, Clone)]
pub(super) struct Foresight {
    dt: f64,
    arm: Reference,
    pose: Pose,
    velocity: [Vector3<f64>; 2],
    /// How far the look has come, and how old it is, s.
    ahead: f64,
    age: f64,
    running: bool,
    /// The last answer at its time, s.
    answer: f64,
}

impl Foresight {
    pub fn new(arm: &Reference, dt: f64) -> Self {
        Self {
            dt,
            arm: arm.clone(),
            pose: Pose::identity(),
            velocity: [Vector3::zeros(); 2],
            ahead: 0.0,
            age: 0.0,
            running: false,
            answer: f64::INFINITY,
        }
    }

    /// Forgets what was seen.
    pub fn restart(&mut self) {
        self.running = false;
        self.answer = f64::INFINITY;
    }

    /// One step; the time until the arm has to stop, s.
    pub fn look(
        &mut self,
        q: &[f64],
        pose: &Pose,
        velocity: [Vector3<f64>; 2],
        limits: &[JointLimits],
    ) -> f64 {
        self.answer = (self.answer - self.dt).max(0.0);
        if velocity[0].norm() + velocity[1].norm() < SERVO_SLOW {
            self.restart();
            return self.answer;
        }
        if !self.running {
            self.running = true;
            self.arm.q.copy_from_slice(q);
            (self.pose, self.velocity, self.ahead, self.age) = (*pose, velocity, 0.0, 0.0);
        }
        self.age += self.dt;
        let [v, w] = self.velocity;
        self.pose = Pose::from_parts(
            Translation3::from(self.pose.translation.vector + v * SERVO_LOOK_STEP),
            Rotation3::new(w * SERVO_LOOK_STEP) * self.pose.rotation,
        );
        if !self.arm.look(&self.pose, SERVO_LOOK_STEP / self.dt, limits) {
            self.running = false;
            self.answer = (self.ahead - self.age).max(0.0);
            return self.answer;
        }
        self.ahead += SERVO_LOOK_STEP;
        if self.ahead >= SERVO_LOOK_AHEAD {
            self.restart();
        }
        self.answer
    }
}
