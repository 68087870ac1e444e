//! The servo's constants, each with its reason.

/// Step (rad or m per tick) of a joint of the servo that counts as rest: some units in the last place of a position.
pub(super) const SERVO_AT_REST: f64 = 1e-14;

/// Halvings of the interval in which the servo looks for the largest legal step: 1e-5 of it is left.
pub(super) const SERVO_STEP_BISECTIONS: usize = 18;

/// Legs of a stopping motion: each of its phases takes one or two, and there are five.
pub(super) const SERVO_STOP_LEGS: usize = 32;

/// Distance (m) from the line between shoulder and wrist below which an elbow has no angle about it.
pub(super) const SERVO_ELBOW_ON_LINE: f64 = 1e-6;

/// Change (m) of the distance from shoulder to wrist by other joints than the elbow from which on it depends on them.
pub(super) const SERVO_REACH_DEPENDS: f64 = 1e-4;

/// Where the reach of the wrist ends softly: distance (m) from its hard end; the way that is left to a target that moves on
/// without end; how far the wrist may be ahead of a target that comes back. The elbow stays bent, because from a stretched arm
/// the way back takes a second.
pub(super) const SERVO_BEND: [f64; 3] = [0.029, 0.011, 0.004];

/// How far (s) a target is seen ahead that comes back into reach.
pub(super) const SERVO_LEAD: f64 = 0.06;

/// Squared damping of the servo's Newton step per squared error of the pose [Sugihara2011].
pub(super) const SERVO_DAMPING: f64 = 0.5;

/// Squared damping that always remains: small enough to be overcome by the steps of a tick at a least singular value of 1e-3.
pub(super) const SERVO_LEAST_DAMPING: f64 = 1e-8;

/// Share of the limits of a joint that the motion of the freedom may use; the rest is the task's.
pub(super) const SERVO_FREEDOM_SHARE: f64 = 0.3;

/// Rate of the elbow's angle along its projected gradient (1/rad^2) below which the elbow cannot be turned.
pub(super) const SERVO_FREEDOM_SLOPE: f64 = 1e-3;

/// Ticks of acceleration after which the motion of the freedom is fast enough.
pub(super) const SERVO_FREEDOM_TICKS: f64 = 50.0;

/// Speed of the freedom per gradient of a criterion, 1/s.
pub(super) const SERVO_CRITERION_GAIN: f64 = 10.0;

/// Speed of a desired swivel, relative to what the arm can do, from which on it has jumped.
pub(super) const SERVO_SWIVEL_JUMP: f64 = 4.0;

/// Distance (rad or m) that the servo's reference keeps from position limits.
pub(super) const SERVO_LIMIT_MARGIN: f64 = 1e-6;

/// Largest joint step (rad or m) of one Newton step of the servo.
pub(super) const SERVO_NEWTON_STEP: f64 = 0.3;

/// Pose error (m, and rad by its weight) from which one more Newton step is exact up to rounding.
pub(super) const SERVO_REFERENCE_REACHED: f64 = 1e-6;

/// Pose error (m) and angle (rad) at which a servo has reached its target.
pub(super) const SERVO_REACHED: [f64; 2] = [1e-4, 1e-3];

/// White jerk of a hand (m/s^3 per root of Hz): an input noise of 2 mm is then followed up to 18 rad/s, which is best for
/// reaches that peak at 1 m/s^2.
pub(super) const SERVO_HAND_JERK: f64 = 0.38;

/// The same for its rotation, rad/s^3 per root of Hz.
pub(super) const SERVO_HAND_ANGULAR_JERK: f64 = 1.3;

/// Noise (m) below which a target is exact.
pub(super) const SERVO_EXACT_POSITION: f64 = 2e-6;

/// Noise (rad) below which a target's orientation is exact.
pub(super) const SERVO_EXACT_ANGLE: f64 = 2e-5;

/// Step (m) of a target against its motion so far from which on it has jumped.
pub(super) const SERVO_JUMP_DISTANCE: f64 = 5e-3;

/// The same for its orientation, rad.
pub(super) const SERVO_JUMP_ANGLE: f64 = 0.05;

/// Acceleration (m/s^2 and rad/s^2) that is no jump whatever the tick: more than that of a hand.
pub(super) const SERVO_JUMP_ACCELERATION: f64 = 50.0;

/// Standard deviations of the noise per axis that do not make a jump.
pub(super) const SERVO_JUMP_SIGMAS: f64 = 8.0;

/// Poles of the servo's smoother relative to the bandwidth of its filter.
pub(super) const SERVO_SMOOTHER_RATIO: f64 = 2.1;

/// Acceleration of a joint without a limit, as a share of its velocity limit per second: full speed after 0.1 s.
pub(super) const SERVO_ACCELERATION_PER_VELOCITY: f64 = 10.0;

/// Acceleration (rad/s^2 or m/s^2) of a joint that has neither a limit of acceleration nor one of velocity.
pub(super) const SERVO_ACCELERATION: f64 = 10.0;

/// Share of a joint's acceleration that is left for catching up however fast the reference accelerates.
pub(super) const SERVO_CATCH_UP: f64 = 0.3;

/// Share of a joint's jerk used for catching up; the rest is the reference's.
pub(super) const SERVO_CATCH_UP_JERK: f64 = 0.95;

/// Noise (m, rad per axis) of a target that has not been measured long enough: a hand-held device.
pub(super) const SERVO_NOISE_AT_FIRST: [f64; 2] = [6e-4, 3e-3];

/// Speed (m/s, rad/s) that a target may have where its stream begins, one standard deviation.
pub(super) const SERVO_FIRST_SPEED: f64 = 0.05;

/// The same for its acceleration, m/s^2 and rad/s^2.
pub(super) const SERVO_FIRST_ACCELERATION: f64 = 0.3;

/// Time (s) by which one step of the look ahead goes on.
pub(super) const SERVO_LOOK_STEP: f64 = 0.05;

/// How far (s) the look ahead goes.
pub(super) const SERVO_LOOK_AHEAD: f64 = 2.0;

/// Speed of the tool (m/s plus rad/s) below which no look ahead is needed.
pub(super) const SERVO_SLOW: f64 = 0.01;

/// Distance (m) that a target is moved back into reach from which on the arm does not follow it any more.
pub(super) const SERVO_OUT_OF_REACH: f64 = 5e-3;
