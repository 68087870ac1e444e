//! Thresholds of timing joint paths and of checking trajectories.

/// Distance between two rows of a joint path (rad or m) below which they are one and the arm waits there: shorter chords
/// have no direction.
pub const RETIME_SAME_ROW: f64 = 1e-9;

/// Time (s) between two equal rows: the shortest that any controller of arms tells apart.
pub const RETIME_DWELL: f64 = 1e-3;

/// Turn of a joint path at one row (rad) that no smooth curve is sampled with.
pub const RETIME_SHARP_CORNER: f64 = 0.5;

/// How much more than its neighbours a row must turn to be a corner: samples of a smooth curve turn alike.
pub const RETIME_CORNER_RATIO: f64 = 3.0;

/// Distance (rad or m) from a straight line in joint space within which rows are on it.
pub const RETIME_STRAIGHT: f64 = 1e-9;

/// Turn of a joint path at a corner (rad) above which it is not blended: on the way back along the same line a stop costs
/// nothing, and a curve would leave out the end of the line.
pub const RETIME_BLEND_TURN: f64 = 2.9;

/// Intervals of the curve that replaces a corner: at a right angle each turns by 0.05 rad on average.
pub const RETIME_BLEND_PARTS: usize = 32;

/// How often the curve is halved until it is within the wanted distance and the position limits.
pub const RETIME_BLEND_TRIALS: usize = 8;

/// Nodes that a stretch between two stops has at least.
pub const RETIME_NODES: usize = 100;

/// Turn of a joint path from node to node (rad) above which nodes are put between rows, and into how many parts an interval
/// is cut at most: beside finer gridpoints, rows that turn by 0.4 rad cost up to 4 % of the duration.
pub const RETIME_TURN: f64 = 0.12;
/// See [`RETIME_TURN`].
pub const RETIME_TURN_PARTS: usize = 5;

/// Nodes below which a jerk-limited stretch is one ease: a profile needs some for each end and some between.
pub const RETIME_LEAST_NODES: usize = 12;

/// Intervals next to a rest over which the parameter goes over from the cube root of the length to the length: over many,
/// so that the jerk changes little in the first.
pub const RETIME_ZONE: usize = 48;

/// Relative excess of a jerk-limited motion's duration over the optimum at which the barrier method stops.
pub const RETIME_GAP: f64 = 1e-3;

/// Share of a limit by which a checked trajectory may exceed it: files of other programs carry four to six digits.
pub const CHECK_RELATIVE: f64 = 1e-3;

/// Times of a checked trajectory are rounded to this, s: the nanoseconds of ROS messages.
pub const CHECK_TIME_ROUNDING: f64 = 1e-9;

/// Distance (rad or m) beyond a position limit that rounded numbers explain.
pub const CHECK_WITHIN: f64 = 1e-6;

/// Largest distance (m) of a checked motion from its path: a tenth of what hand-guided calibration leaves.
pub const CHECK_POSITION: f64 = 1e-3;

/// Largest angle (rad) of a checked motion from its path's orientation: at a tool of 0.1 m the same as
/// [`CHECK_POSITION`].
pub const CHECK_ORIENTATION: f64 = 1e-2;

/// Ratio of the least to the largest singular value below which a checked row is near a singularity: a tool speed then
/// takes a thousand times the joint speed.
pub const CHECK_SINGULARITY: f64 = 1e-3;

/// Speed (rad/s or m/s) and acceleration at which a row counts as at rest: no brake tells it from rest.
pub const CHECK_REST: f64 = 1e-3;

/// How much faster than an interval beside it an interval must be to be a jump: smooth motion changes less from row to row
/// unless it is near rest.
pub const CHECK_JUMP_RATIO: f64 = 3.0;

/// Distance (rad) from a whole number of turns within which a step is one of whole turns.
pub const CHECK_TURN: f64 = 0.1;

/// Shortest interval (s) between two rows of a checked trajectory: no controller has a shorter cycle.
pub const CHECK_LEAST_INTERVAL: f64 = 1e-6;

/// Largest joint step (rad or m) between two places at which contact is looked for: 2 cm at a metre.
pub const CHECK_CONTACT_STEP: f64 = 0.02;

/// Radius (m) of the capsules from joint to joint of an arm whose shape is not given.
pub const CHECK_LINK_RADIUS: f64 = 0.05;

/// Difference of positions (rad or m) and of velocities (rad/s or m/s) up to which two motions meet: rows of files are
/// rounded.
pub const JOIN_POSITION: f64 = 1e-6;
/// See [`JOIN_POSITION`].
pub const JOIN_VELOCITY: f64 = 1e-6;

/// Largest size of a task velocity, a task acceleration, a joint velocity or a wish that a control step takes (SI units): products
/// of four such numbers with the inverses of small singular values are still finite.
pub const LARGEST_RATE: f64 = 1e60;

/// Largest coordinate of the position of a pose that is taken (m): its fourth power is still finite.
pub const LARGEST_POSITION: f64 = 1e60;
