//! What the operator means: the target without its noise.
//!
//! Position and orientation are each estimated by a Kalman filter whose motion is a jerk of white noise. The noise of the
//! input is either given or measured: the third difference of white noise of variance `r` has the variance `20 r`, while that of a
//! hand's motion is far smaller; its median over the last ticks ignores jumps. The estimate then passes a third-order
//! smoother whose poles follow the bandwidth of the filter, because an estimate alone steps with every measurement.
//! Without noise both are transparent, and the target is passed on as it is.
//!
//! A target that moves by more than any hand does is a jump: the filter starts again there and keeps its velocity. If the next
//! target does not go on with that velocity, the velocity is that of the last step alone: a target that rests would otherwise
//! jump away from what is expected of it for ever.

use nalgebra::{Matrix3, Rotation3, Translation3, Vector3};

use super::thresholds::{
    SERVO_EXACT_ANGLE, SERVO_EXACT_POSITION, SERVO_FIRST_ACCELERATION, SERVO_FIRST_SPEED,
    SERVO_HAND_ANGULAR_JERK, SERVO_HAND_JERK, SERVO_JUMP_ACCELERATION, SERVO_JUMP_ANGLE, SERVO_JUMP_DISTANCE,
    SERVO_JUMP_SIGMAS, SERVO_NOISE_AT_FIRST, SERVO_SMOOTHER_RATIO,
};
use crate::kinematics::rotation_vector;
use crate::pose::Pose;

/// Third differences whose median is the noise.
const WINDOW: usize = 31;
/// Median of the mean square of three standard normal variables.
const MEDIAN_OF_CHI: f64 = 0.789;
/// Variance of the third difference of white noise of variance 1.
const THIRD_DIFFERENCE: f64 = 20.0;

/// How exact the target is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum TargetNoise {
    /// Measured while it runs.
    #[default]
    Auto,
    /// The target is exact.
    None,
    /// Root mean square of the length of the position's noise (m) and of its angle (rad).
    Given(f64, f64),
}

/// One three-vector, or a rotation through its increments: covariance of the Kalman filter, noise, jumps.
#[derive(Debug, Clone)]
struct Channel {
    covariance: Matrix3<f64>,
    /// Variance per axis of a measurement.
    variance: f64,
    differences: [f64; WINDOW],
    count: usize,
    /// Spectral density of the jerk.
    density: f64,
    exact: f64,
    /// Standard deviation per axis that is assumed until enough has been measured.
    first: f64,
}

impl Channel {
    fn new(jerk: f64, exact: f64, first: f64) -> Self {
        Self {
            covariance: Matrix3::zeros(),
            variance: 0.0,
            differences: [0.0; WINDOW],
            count: 0,
            density: jerk * jerk,
            exact,
            first,
        }
    }

    fn is_exact(&self) -> bool {
        self.variance <= self.exact * self.exact
    }

    /// Takes a third difference of the input and updates the noise.
    fn measure_noise(&mut self, third: &Vector3<f64>) {
        self.differences[self.count % WINDOW] = third.norm_squared() / 3.0;
        self.count += 1;
        let mut sorted = self.differences;
        let used = self.count.min(WINDOW);
        sorted[..used].sort_unstable_by(f64::total_cmp);
        let measured = sorted[used / 2] / (THIRD_DIFFERENCE * MEDIAN_OF_CHI);
        self.variance =
            if 2 * self.count < WINDOW { measured.max(self.first * self.first) } else { measured };
    }

    /// Angular frequency up to which the filter follows, rad/s.
    fn bandwidth(&self, dt: f64) -> f64 {
        (self.density / (self.variance * dt)).powf(1.0 / 6.0)
    }

    fn predict(&mut self, dt: f64) {
        let f = Matrix3::new(1.0, dt, 0.5 * dt * dt, 0.0, 1.0, dt, 0.0, 0.0, 1.0);
        let (d2, d3, d4, d5) = (dt * dt, dt.powi(3), dt.powi(4), dt.powi(5));
        let q =
            Matrix3::new(d5 / 20.0, d4 / 8.0, d3 / 6.0, d4 / 8.0, d3 / 3.0, d2 / 2.0, d3 / 6.0, d2 / 2.0, dt);
        self.covariance = f * self.covariance * f.transpose() + q * self.density;
    }

    /// Gain of a measurement; the covariance becomes that after it.
    fn gain(&mut self) -> Vector3<f64> {
        let first: Vector3<f64> = self.covariance.column(0).into();
        let k = first / (first.x + self.variance);
        self.covariance -= k * first.transpose();
        self.covariance = (self.covariance + self.covariance.transpose()) * 0.5;
        k
    }
}

/// Position and orientation with two derivatives.
#[derive(Debug, Clone, Copy)]
struct Motion {
    pose: Pose,
    velocity: [Vector3<f64>; 2],
    acceleration: [Vector3<f64>; 2],
}

impl Motion {
    /// The motion `t` seconds later, with constant acceleration.
    fn at(&self, t: f64) -> Pose {
        let step = |i: usize| self.velocity[i] * t + self.acceleration[i] * (0.5 * t * t);
        moved(&self.pose, &step(0), &step(1))
    }

    fn advance(&mut self, dt: f64) {
        self.pose = self.at(dt);
        (0..2).for_each(|i| self.velocity[i] += self.acceleration[i] * dt);
    }
}

fn moved(pose: &Pose, by: &Vector3<f64>, turn: &Vector3<f64>) -> Pose {
    Pose::from_parts(Translation3::from(pose.translation.vector + by), Rotation3::new(*turn) * pose.rotation)
}

fn between(from: &Pose, to: &Pose) -> [Vector3<f64>; 2] {
    [
        to.translation.vector - from.translation.vector,
        rotation_vector(&(to.rotation * from.rotation.inverse())),
    ]
}

/// The filter of a stream of poses.
#[derive(Debug, Clone)]
pub(super) struct TargetFilter {
    dt: f64,
    noise: TargetNoise,
    channels: [Channel; 2],
    motion: Motion,
    smoothed: [Pose; 3],
    /// The last four increments of the input, newest first.
    steps: [[Vector3<f64>; 2]; 3],
    last: Pose,
    started: bool,
    /// The target of the tick before was a jump.
    jumped: bool,
    seen: usize,
}

/// The target of one tick.
#[derive(Debug, Clone, Copy)]
pub(super) struct Filtered {
    pub pose: Pose,
    /// Linear and angular velocity, base axes.
    pub velocity: [Vector3<f64>; 2],
    pub jumped: bool,
}

impl TargetFilter {
    pub fn new(dt: f64, noise: TargetNoise) -> Self {
        let at_rest = Motion {
            pose: Pose::identity(),
            velocity: [Vector3::zeros(); 2],
            acceleration: [Vector3::zeros(); 2],
        };
        let mut channels = [
            Channel::new(SERVO_HAND_JERK, SERVO_EXACT_POSITION, SERVO_NOISE_AT_FIRST[0]),
            Channel::new(SERVO_HAND_ANGULAR_JERK, SERVO_EXACT_ANGLE, SERVO_NOISE_AT_FIRST[1]),
        ];
        if noise == TargetNoise::Auto {
            channels.iter_mut().for_each(|channel| channel.variance = channel.first * channel.first);
        }
        if let TargetNoise::Given(position, angle) = noise {
            channels[0].variance = position * position / 3.0;
            channels[1].variance = angle * angle / 3.0;
        }
        Self {
            dt,
            noise,
            channels,
            motion: at_rest,
            smoothed: [Pose::identity(); 3],
            steps: [[Vector3::zeros(); 2]; 3],
            last: Pose::identity(),
            started: false,
            jumped: false,
            seen: 0,
        }
    }

    /// Forgets the stream; the next target starts a new one.
    pub fn restart(&mut self) {
        *self = Self::new(self.dt, self.noise);
    }

    /// A tick without a target: the motion goes on as it was.
    pub fn coast(&mut self) -> Filtered {
        self.motion.acceleration = [Vector3::zeros(); 2];
        self.motion.advance(self.dt);
        self.channels.iter_mut().for_each(|channel| channel.predict(self.dt));
        self.last = self.motion.pose;
        self.seen = 0;
        self.smooth(false)
    }

    /// A tick with a target.
    pub fn update(&mut self, target: &Pose, velocity: Option<[Vector3<f64>; 2]>) -> Filtered {
        if !self.started {
            self.start(target);
            return Filtered { pose: *target, velocity: self.motion.velocity, jumped: true };
        }
        let innovation = between(&self.motion.at(self.dt), target);
        let jumped = self.is_jump(&innovation);
        let again = std::mem::replace(&mut self.jumped, jumped) && jumped;
        let step = between(&self.last, target);
        self.measure(target, jumped);
        if jumped {
            let kept = if again { step.map(|step| step / self.dt) } else { self.motion.velocity };
            self.start(target);
            self.motion.velocity = kept;
            for (k, pose) in self.smoothed.iter_mut().enumerate() {
                *pose = self.motion.at(-(k as f64) * self.dt);
            }
            return Filtered { pose: *target, velocity: kept, jumped };
        }
        let before = self.motion;
        self.motion.advance(self.dt);
        let predicted = self.motion.pose;
        let mut correction = [Vector3::zeros(); 2];
        for i in 0..2 {
            let channel = &mut self.channels[i];
            if channel.is_exact() {
                correction[i] = innovation[i];
                let moved = between(&before.pose, target)[i] / self.dt;
                self.motion.acceleration[i] = (moved - before.velocity[i]) / self.dt;
                self.motion.velocity[i] = moved;
                channel.covariance = Matrix3::zeros();
                continue;
            }
            channel.predict(self.dt);
            let gain = channel.gain();
            correction[i] = innovation[i] * gain.x;
            self.motion.velocity[i] += innovation[i] * gain.y;
            self.motion.acceleration[i] += innovation[i] * gain.z;
        }
        self.motion.pose = moved(&predicted, &correction[0], &correction[1]);
        if let Some(velocity) = velocity {
            self.motion.velocity = velocity;
        }
        self.smooth(false)
    }

    fn start(&mut self, target: &Pose) {
        self.started = true;
        self.motion.pose = *target;
        self.motion.velocity = [Vector3::zeros(); 2];
        self.motion.acceleration = [Vector3::zeros(); 2];
        self.smoothed = [*target; 3];
        self.last = *target;
        for channel in &mut self.channels {
            channel.covariance = Matrix3::zeros();
            channel.covariance[(0, 0)] = channel.variance;
            channel.covariance[(1, 1)] = SERVO_FIRST_SPEED * SERVO_FIRST_SPEED;
            channel.covariance[(2, 2)] = SERVO_FIRST_ACCELERATION * SERVO_FIRST_ACCELERATION;
        }
    }

    fn is_jump(&self, innovation: &[Vector3<f64>; 2]) -> bool {
        let free = SERVO_JUMP_ACCELERATION * self.dt * self.dt;
        let bounds = [SERVO_JUMP_DISTANCE, SERVO_JUMP_ANGLE];
        (0..2).any(|i| {
            let sigma = self.channels[i].variance.sqrt();
            innovation[i].norm() > bounds[i].max(free) + SERVO_JUMP_SIGMAS * sigma
        })
    }

    /// Follows the noise of the input.
    fn measure(&mut self, target: &Pose, jumped: bool) {
        let step = between(&self.last, target);
        self.last = *target;
        if jumped {
            self.seen = 0;
            return;
        }
        self.steps.rotate_right(1);
        self.steps[0] = step;
        self.seen += 1;
        if self.noise == TargetNoise::Auto && self.seen >= 3 {
            for i in 0..2 {
                let third = self.steps[0][i] - self.steps[1][i] * 2.0 + self.steps[2][i];
                self.channels[i].measure_noise(&third);
            }
        }
    }

    /// The smoothed target: errors relative to the estimate die out with three equal poles.
    fn smooth(&mut self, jumped: bool) -> Filtered {
        let pole = |channel: &Channel| {
            if channel.is_exact() {
                0.0
            } else {
                (-SERVO_SMOOTHER_RATIO * channel.bandwidth(self.dt) * self.dt).exp()
            }
        };
        let poles = [pole(&self.channels[0]), pole(&self.channels[1])];
        let mut left = [Vector3::zeros(); 2];
        for (k, pose) in self.smoothed.iter().enumerate() {
            let error = between(&self.motion.at(-(k as f64 + 1.0) * self.dt), pose);
            for i in 0..2 {
                let p = poles[i];
                left[i] += error[i] * [3.0 * p, -3.0 * p * p, p * p * p][k];
            }
        }
        let pose = moved(&self.motion.pose, &left[0], &left[1]);
        self.smoothed.rotate_right(1);
        self.smoothed[0] = pose;
        Filtered { pose, velocity: self.motion.velocity, jumped }
    }
}
