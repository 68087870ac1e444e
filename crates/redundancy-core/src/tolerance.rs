//! Every numeric threshold of the crate, named, with the reason for its size.

mod levels;
mod motion;

pub use levels::*;
pub use motion::*;

/// Largest deviation of `R^T R` from the identity (max norm) of a rotation that is used as the caller gives it.
/// Single-precision matrices (6e-8 per entry) are.
pub const ROTATION_ORTHONORMAL: f64 = 1e-6;

/// Largest distance (spectral norm) of a matrix from the nearest rotation, by which it is replaced: matrices printed with
/// three decimals pass, matrices with a typing error do not. The same as for the norm of quaternions.
pub const ROTATION_NEAR: f64 = 1e-3;

/// Distance of every point of a path from the arm, in multiples of its reach, above which a message asks whether the path
/// is in millimetres: a path in metres that is meant for the arm starts below one, one in millimetres a thousand times
/// higher.
pub const MILLIMETRE_REACHES: f64 = 20.0;

/// Turns of a joint above which a message asks about degrees: 180 degrees taken for radians are 28.6 turns, which no
/// arm's cables survive.
pub const DEGREE_TURNS: f64 = 20.0;

/// Asymmetry and negative eigenvalues of an inertia tensor, relative to its largest entry, that rounding explains.
pub const INERTIA_ROUNDING: f64 = 1e-9;

/// Least norm of a vector that is meant as a direction: below it the rounding of the entries decides.
pub const DIRECTION_NORM: f64 = 1e-9;

/// Largest deviation from 1 of the norm of an axis that is taken as unit already: four units in the last place,
/// what normalising and computing the norm can leave.
pub const UNIT_AXIS: f64 = 4.0 * f64::EPSILON;

/// Largest deviation from 1 of the norm of a quaternion that is silently normalised (file input).
pub const QUATERNION_NORM: f64 = 1e-3;

/// Largest distance by which axes of an S-R-S arm may miss their common point, m. Calibrated robots and rounded
/// URDFs stay below; the smallest real wrist offsets (some mm) do not.
pub const SRS_DISTANCE: f64 = 1e-4;

/// Least angle (rad) between axes that a closed form needs to cross: nearer to parallel, their crossing point and the turn
/// that brings one to a wanted place lose more than two digits.
pub const AXES_PARALLEL: f64 = 0.01;

/// Defect (m, rad) of an arm above which single solutions of its closed form are polished: below it they are exact to rounding.
pub const POLISH_DEFECT: f64 = 1e-12;

/// Longest Newton step (rad) of a polish: the square root of the largest defect that is accepted.
pub const POLISH_REACH: f64 = 0.03;

/// Share of the squared length of a chord by which its component along the normal may come out negative: rounding.
pub const ROOM_ROUNDING: f64 = 1e-13;

/// What rounding of the elbow may take besides, over the sine of its angle: the nearer to its end, the farther rounding turns it.
pub const ROOM_ELBOW: f64 = 4e-15;

/// The most that [`ROOM_ELBOW`] may make: a row meets its pose within about half of this, times the arm's length.
pub const ROOM_ELBOW_MOST: f64 = 1e-9;

/// `|sin u|` of a lens below which its ends' expansion is used: what it leaves out is of the order of its square.
pub const LENS_END: f64 = 1e-4;

/// Width of a part of a ring, rad, below which a zero that cannot be separated from another one is not looked for.
pub const ROOT_WIDTH: f64 = 1e-9;

/// Share of what a cubic leaves of the trapezoid rule that bounds what the cubic misses: for a frequency k the ratio is
/// `h k / 32` on parts of length h.
pub const ARC_BAND: f64 = 0.1;

/// Width (rad) below which a proof by intervals does not divide further: what is not decided there is not claimed.
pub const PROOF_SHORTEST: f64 = 1e-7;

/// What covers the rounding of a proof by intervals, rad and m^2: a thousand roundings of numbers of order 1.
pub const PROOF_MARGIN: f64 = 1e-12;

/// What covers the rounding of the room of a ring (m^2, of numbers of order 1) before its root is taken: the root next to 0
/// magnifies it, so that a larger one would keep proofs from ending there.
pub const PROOF_ROOM: f64 = 1e-14;

/// Share of the bend of a part (the change of the rate, times its length) that counts beside what the cubic leaves of the
/// trapezoid rule, which is nothing where the part is symmetric.
pub const ARC_BEND: f64 = 0.05;

/// What a cubic leaves of the trapezoid rule (rad) above which it says nothing.
pub const ARC_COARSE: f64 = 0.3;

/// Length of a part of a curve (of 2 pi) at which it is not divided further.
pub const ARC_SHORTEST: f64 = 1e-9;

/// `1 - cos` of the angle (1.4e-12 rad) by which a cone may be missed at its tip: rounding of a few rotations.
pub const CONE_ROUNDING: f64 = 1e-24;

/// Values of joint 6 at which an arm with three parallel axes is tried where the pose leaves it free: a step of 1.4 degrees.
pub const SINGULAR_WRIST: usize = 256;

/// Sine of the angle between axis 6 and the parallel axes below which rounding of joint 6 (1e-16 over this) may move the
/// arm out of a reach that it is at the end of.
pub const SINGULAR_WRIST_SINE: f64 = 1e-7;

/// Sine of the joint that turns back in a closed form below which rounding (1e-16 under the root, times what short triangles make
/// of it) decides which branches exist.
pub const FOLD_SINE: f64 = 1e-6;

/// Rotation (rad) of the tool that another joint 6 next to a singular wrist may cost: a few roundings of a rotation matrix.
pub const SINGULAR_WRIST_ROUNDING: f64 = 1e-14;

/// Largest deviation from a right angle between neighbouring axes of a spherical joint, rad: a URDF that
/// writes 1.5708 or 1.57 for pi/2 is off by 3.7e-6 or 8e-4.
pub const SRS_ANGLE: f64 = 1e-3;

/// Below this an elbow has no offset: the upper arm runs along axis 3 and the forearm along axis 5, rad.
/// Above it the general (slower) form is used, which is exact for any offset.
pub const SRS_ALIGNED: f64 = 1e-9;

/// Least distance of the shoulder and the wrist from the elbow axis, m: an elbow that moves nothing is none.
pub const SRS_ELBOW_RADIUS: f64 = 1e-6;

/// Excess over the reach, relative to the arm's length, that rounding explains: a stretched arm is reachable.
pub const REACH_ROUNDING: f64 = 1e-13;

/// Sine of the middle angle of a spherical joint below which only the sum of the outer angles is defined.
/// The first one is then 0; what is lost in the pose is below this number.
pub const GIMBAL_SINE: f64 = 1e-13;

/// A joint this little outside a limit (rad) is at the limit; the value returned is clamped to it.
pub const LIMIT_SLACK: f64 = 1e-12;

/// A joint this little outside its limit (rad) at the end of a feasible interval is there by rounding of the swivel:
/// it keeps its winding. Where joints turn a thousand times as fast as the swivel, rounding is a thousand times 1e-16.
pub const EDGE_ROUNDING: f64 = 1e-9;

/// Angle (rad) between two directions below which a projected reference axis is undefined.
pub const REFERENCE_PARALLEL: f64 = 1e-6;

/// Damping of the numeric inverse kinematics per unit of cost `|e|^2 / 2` (e in rad; metres are weighted to rad).
/// Anything from 0.01 to 0.3 needs the same number of iterations within 5 %.
pub const IK_DAMPING: f64 = 0.03;

/// Damping that is left at the target: keeps the system solvable at a singular configuration, too small to slow down
/// convergence anywhere else.
pub const IK_DAMPING_FLOOR: f64 = 1e-12;

/// A run whose cost has not fallen below this share in four steps is given up: another start is cheaper.
pub const IK_STALL: f64 = 0.5;

/// Longest step of a joint in one iteration, rad or m: about what linearisation covers.
pub const IK_STEP: f64 = 0.8;

/// Radians that a metre counts in the cost of the numeric inverse kinematics: the inverse of the size (m) of what a
/// tool turns. Between 2 and 7 the number of iterations does not change by more than 5 % on arms of human size.
pub const IK_RADIANS_PER_METRE: f64 = 1.0 / 0.3;

/// Relative fall of the cost in four steps below which even a patient run has ended at a stationary point.
pub const IK_STATIONARY: f64 = 1e-9;

/// Sine of an angle below which the angle is its series up to the third power: the fifth is below 1e-17.
pub const SMALL_SINE: f64 = 5e-4;

/// Projected gradient of a criterion, relative to the gradient, at which it counts as stationary over the task.
pub const IK_CRITERION: f64 = 1e-7;

/// Share of the tolerances to which a step along a criterion is brought back: one more step of quadratic convergence.
pub const IK_CRITERION_SHARE: f64 = 1e-4;

/// Relative fall of the cost in one iteration of a descent below which it stands still: rounding of the cost.
pub const DESCENT_STALL: f64 = 1e-15;

/// Share of the fall that the slope promises which a line search asks for (Armijo).
pub const LINE_SEARCH_FALL: f64 = 1e-4;

/// Ratio of the amplitudes of whole and half angles below which the smaller one only moves the stationary points of the
/// other by rounding; Newton's method takes it into account.
pub const HALF_ANGLE_FLAT: f64 = 1e-9;

/// Largest derivative, relative to the amplitudes, at a root of the half-angle quartic that counts as on the unit circle. A
/// double root is resolved to the root of the machine precision, and the derivative there to the machine precision.
pub const HALF_ANGLE_ROOT: f64 = 1e-11;

/// Largest distance (m) between consecutive path samples that counts as standing still: below it arc length is noise.
pub const PATH_STANDSTILL: f64 = 1e-9;

/// Largest angle (rad) between orientations that count as the same at one place of a path; the angle of two rotation
/// matrices that are equal up to rounding is of the order of the root of the machine precision.
pub const PATH_SAME_ORIENTATION: f64 = 1e-7;

/// Arc length (m per rad) that a step counts which only turns the tool: about the size of a tool, so that the path
/// parameter grows by the order of the distance that the tool's rim travels.
pub const TURN_LENGTH: f64 = 0.1;

/// Relative excess of a path parameter over the path's ends that rounding explains; it is clamped.
pub const PATH_END_ROUNDING: f64 = 1e-9;

/// Least norm of the interpolated quaternion that is divided by; samples less than a right angle apart stay above 0.7.
pub const QUATERNION_CHORD: f64 = 1e-3;

/// Relative misfit of raster corners that printed constants (8 digits) may have, and the cosine by which the directions
/// of a raster may miss the right angle.
pub const CORNER_FIT: f64 = 1e-8;

/// Shortest time (s) from one trajectory row to the next where the joint speeds ask for less: rows in which nothing
/// moves still follow each other in time. A thousandth of the cycle of the fastest controllers.
pub const SHORTEST_STEP: f64 = 1e-6;

/// Amplitude below which a sinusoid of entries of rotation matrices (order 1) is a constant.
pub const SINUSOID_FLAT: f64 = 1e-14;

/// Relative negative discriminant of a tangent point that rounding explains.
pub const SINUSOID_TANGENT: f64 = 1e-14;

/// `1 - |cos|` of the middle angle of a spherical joint below which a passage through its gimbal is looked for.
pub const GIMBAL_NEAR: f64 = 1e-9;

/// Sine of the middle angle at its extremum that counts as a passage through the gimbal: the outer joints would
/// turn by pi within a swivel of this size. In a wrist of a six-joint arm: below it the outer joints may share their sum
/// freely, which moves the pose by no more than this.
pub const GIMBAL_PASSAGE: f64 = 1e-12;

/// What may be left between the best value found over a circle of solutions and its proven lower bound, relative to
/// `1 + |value|`.
pub const OPTIMUM_GAP: f64 = 1e-10;

/// A step of a monotone joint against its direction up to this size (rad) is rounding.
pub const UNWIND_ROUNDING: f64 = 1e-6;

/// Largest URDF that is read, in bytes. The largest public ones (humanoids) have about 1 MB; the limit bounds the
/// memory and time that a hostile file can take.
pub const URDF_BYTES: usize = 16 << 20;

/// Most XML nodes of a URDF: thirty times those of a humanoid, some 100 MB once parsed.
pub const URDF_NODES: u32 = 1_000_000;

/// Most attributes of one element of an XML file. A URDF has elements with six; looking for duplicates costs the
/// square of their number.
pub const XML_ATTRIBUTES: usize = 256;

/// Most namespace declarations in an XML file. Expanded xacro files have a handful; each nested one copies its parents'.
pub const XML_NAMESPACES: usize = 256;

/// Largest mesh file that is read, in bytes. Collision meshes have some 100 kB, scans some 10 MB.
pub const MESH_BYTES: u64 = 256 << 20;

/// Most vertices of a mesh, as read and as kept.
pub const MESH_VERTICES: usize = 4_000_000;

/// Most triangles of a mesh: those of a binary STL of the largest size.
pub const MESH_FACES: usize = 6_000_000;

/// Most XML nodes of a DAE file, some 400 MB once parsed. Numbers are not nodes.
pub const MESH_NODES: u32 = 4_000_000;

/// Largest angle, rad, that the crate's own sine and cosine reduce: its count of quarter turns stays below 2^20, so
/// that the products of the reduction are exact. No joint turns that far; the C library takes the rest.
pub const REDUCTION_LIMIT: f64 = 1e6;

/// A joint step (rad) between neighbouring points of a path above which the arm is said to jump: an eighth of a turn. A
/// path that needs larger steps is sampled too coarsely to tell motion from reconfiguration.
pub const JOINT_JUMP: f64 = std::f64::consts::FRAC_PI_4;

/// Relative excess over a speed limit that rounding explains.
pub const SPEED_ROUNDING: f64 = 1e-9;

/// Distance (m) from the path beyond which a closed loop has left it: the repeatability of a large arm, ten times.
pub const TRACK_POSITION: f64 = 1e-3;

/// The same for the angle, rad: at a tool of 100 mm the same distance.
pub const TRACK_ORIENTATION: f64 = 1e-2;

/// Speed (rad/s) at which a joint without a velocity limit is timed: that of a careful industrial arm.
pub const FREE_SPEED: f64 = 1.0;

/// Slope of a criterion of order 1 along a circle, and width of its bracket (rad), at which its zero is found: a value
/// is then within 1e-18 of the minimum.
pub const SLOPE_ROUNDING: f64 = 1e-9;

/// Deviation of a criterion, relative to 1 + its size, from the cubic through values and slopes of a part of a curve at
/// which the part counts as resolved.
pub const SCAN_RESOLVED: f64 = 1e-6;

/// First step (rad) of the secant that polishes an optimum: the root of the gap that is left, divided by ten.
pub const POLISH_STEP: f64 = 1e-6;

/// Largest deviation from 1 of the norm of a quaternion given by the caller; accepted ones are normalised.
/// Single-precision quaternions (1e-7) and four printed decimals do not mix: the first pass, the second do not.
pub const QUATERNION_UNIT: f64 = 1e-6;

/// Least norm of the part of a quaternion that an Euler angle, a twist or an antipodal arc is read from. Below it
/// fewer than four of its digits are left, so the degenerate rule decides.
pub const ANGLE_PART: f64 = 1e-12;

/// Largest distance, rad, of an orientation from a volume of fewer than three rotations at which it still counts
/// as lying in it: the margin then speaks of the bounds. Equal to the default tolerance of membership.
pub const VOLUME_OFF_SET: f64 = 1e-9;

/// Angle, rad, from the gimbal position of a sequence below which its first and last rotation count as one:
/// to ignore it moves the orientation by no more than this, which is the default tolerance of membership.
pub const VOLUME_GIMBAL: f64 = 1e-9;

/// Near-gimbal range, rad: here rounding of 1e-16 moves the outer angles by more than 1e-12 rad, so that a miss
/// of a bound is confirmed by the distance to the nearest member before membership is denied.
pub const VOLUME_NEAR_GIMBAL: f64 = 1e-4;

/// Least sine of the angle between consecutive axes of a volume: below it the two rotations are one.
pub const VOLUME_AXES_PARALLEL: f64 = 1e-6;

/// Angle, rad, up to which an orientation counts as a member of a sequence of more than three rotations: what Newton's
/// method leaves by rounding.
pub const LONG_MEMBER: f64 = 1e-12;

/// Angle, rad, below which the descent to a member of such a sequence ends, and an angle counts as at its bound.
pub const LONG_STILL: f64 = 1e-13;

/// Least relative progress of that descent in a step, below which it ends: outside of the set, and where it only has to tell
/// inside from outside.
pub const LONG_SLOWEST: f64 = 1e-9;
/// See [`LONG_SLOWEST`].
pub const LONG_SLOW: f64 = 1e-2;

/// Angle left after the first sweeps, as a multiple of the least, from which a start is not followed further.
pub const LONG_NEAR: f64 = 1.1;

/// Gain of the margin, rad, for which another start is worth following.
pub const LONG_BETTER: f64 = 1e-9;

/// First narrowing, rad, from a member of such a sequence; each that succeeds is followed by twice as much.
pub const LONG_FIRST: f64 = 0.02;

/// Longest change of an angle in one step, rad.
pub const LONG_STEP: f64 = 1.0;

/// Width, rad, to which the margin of such a sequence is bracketed.
pub const LONG_NARROWING: f64 = 1e-11;

/// Slope of the angle in the narrowing below which no bound is what keeps an orientation out.
pub const LONG_FLAT: f64 = 1e-6;

/// What is added to the normal equations of such a sequence, as a share of their trace.
pub const LONG_REGULAR: f64 = 1e-12;

/// Tolerance of membership inside the algebra of orientation sets: rad, or the margin's unit of a cone.
pub const SET_MEMBER: f64 = 1e-9;

/// Motion, rad, of a round of alternating projections below which they have arrived.
pub const SET_STILL: f64 = 1e-11;

/// Step, rad, of the search along the common boundary of two sets: the rotation vectors of so short a way are plane to 1e-5.
pub const SET_STEP: f64 = 0.01;

/// Steps, rad, at which that search ends, and the longest step along the boundary.
pub const SET_SHORTEST: f64 = 1e-6;
/// See [`SET_SHORTEST`].
pub const SET_STRETCH: f64 = 0.3;

/// Distance, rad, between two places on the boundaries from which that search is begun.
pub const SET_APART: f64 = 0.05;

/// Step, rad, away from an orientation whose nearest member of a set is not unique: far above rounding, and too short to
/// change the distance in six digits.
pub const SET_BESIDE: f64 = 1e-6;

/// Gain, rad, below which a step of that search is made shorter.
pub const SET_EDGE: f64 = 1e-10;

/// Stationarity of the search for the nearest member of a volume, rad.
pub const VOLUME_NEAREST: f64 = 1e-14;

/// Least magnitude of the scalar part of the twist of a spin margin: below it (a swing by almost half a turn) the
/// twist is undefined and the orientation counts as outside. Its square stays far from overflow.
pub const SPIN_SCALAR: f64 = 1e-9;

/// Largest distance between two unit axes, as vectors, that count as the same axis: a few roundings.
pub const SAME_AXIS: f64 = 1e-14;

/// Step of the one-dimensional closed form, relative to the distance to the ends of its interval, after which it
/// stops. What remains is of the order of its cube, (1e-5)^3, below rounding.
pub const ARC_STEP: f64 = 1e-5;

/// Newton's default estimate of the remaining error, rad. One order above the rounding of the barrier's gradient.
pub const ORIENTATION_STEP: f64 = 1e-13;

/// Share of the largest eigenvalue below which an eigenvalue of the barrier's Hessian is raised: steps along
/// directions in which the barrier is flat or concave stay bounded, those along well-determined ones unchanged.
pub const HESSIAN_FLOOR: f64 = 1e-6;

/// Share of the largest diagonal entry below which a pivot of the barrier's Hessian counts as zero: four digits above
/// rounding. Lens-shaped sets of 1e-9 rad have curvatures in the ratio 1e-9 and are still factored.
pub const HESSIAN_PIVOT: f64 = 1e-12;

/// Squared Newton decrement, per unit of the least weight, below which full steps are taken without measuring the
/// decrease: a self-concordant function decreases by them for decrements up to 0.68, here 0.5.
pub const NEWTON_DECREMENT: f64 = 0.25;

/// Squared Newton decrement, per unit of the least weight, from which a full step is tried at twice its length. Next
/// to the boundary of one set it is 1 or more and the step ends half-way to where it should.
pub const STEP_DOUBLING: f64 = 0.7;

/// Share of the value and the weights of a barrier problem below which a decrease is rounding.
pub const VALLEY_ROUNDING: f64 = 1e-14;

/// Margin on a cone's axis (0.1 degrees of half-angle), and share of a perpendicular part, above which differences of
/// numbers near 1 keep ten digits and are taken as they are.
pub const PLAIN_MARGIN: f64 = 1e-6;

/// Armijo's constant: the share of the predicted decrease that a step must realise.
pub const SUFFICIENT_DECREASE: f64 = 1e-4;

/// Largest ratio of the weights of one problem: beyond it the lightest barrier is below the rounding of the others' sum
/// long before its rim, and no iteration would see it.
pub const WEIGHT_RATIO: f64 = 1e12;

/// Gradient norm, relative to that of a constraint at half its margin, at which the gradient methods stop. Linear
/// convergence: the remaining angle is of the same relative size.
pub const GRADIENT_STATIONARY: f64 = 1e-10;

/// Normalised margin (1 at a cone's axis) at which the search for a feasible start is content.
pub const START_MARGIN: f64 = 0.2;

/// Share of an interval that a start keeps from its ends: next to a rim the barrier's steps only double the distance.
pub const START_RIM: f64 = 0.02;

/// Last smoothing of the search for a feasible start; twice it bounds, in rad, what smoothing adds to a miss angle.
pub const START_SMOOTHING: f64 = 1e-9;

/// Difference, rad, within which a measured miss angle is replaced by the exact one of the worst pair of cones.
pub const MISS_AGREES: f64 = 1e-6;

/// Width, rad, of a volume's middle range below which its angle is drawn uniformly: the weight sin or cos changes by
/// less than this across it, and the inverse of its integral would lose more than that.
pub const VOLUME_NARROW: f64 = 1e-6;

/// Relative difference below which two local minima of the barrier count as equally good: rounding of the sums of
/// logarithms. The first one found is kept, so that the choice does not depend on noise.
pub const SAME_VALUE: f64 = 1e-12;

/// Rounding of a sum of weighted logarithms, relative to the larger of the sum and its weights: a few additions.
pub const VALUE_ROUNDING: f64 = 4e-16;

/// Swivels (rad) this near to each other at which limits are met may be one touching point: the double root of a tangent
/// is resolved to the root of the rounding error, some 1e-8.
pub const LIMITS_MEET: f64 = 1e-6;

/// Least cosine of theta that the rates of roll-pitch-yaw are divided by: nearer to the singularity of these angles
/// the rates are wrong, but finite.
pub const RPY_COSINE: f64 = 1e-6;

/// Lower bound of the least singular value of a task Jacobian (m and rad) above which its Gram matrix, whose condition is
/// the square, still leaves ten digits.
pub const WELL_CONDITIONED: f64 = 1e-2;

/// Squared lower bound of the least singular value, as a share of the sum of all squares, below which a joint velocity is
/// corrected once more: then `J qd = v` holds to a few roundings.
pub const REFINED_SHARE: f64 = 0.02;

/// Share of the largest singular value below which another one is zero: what rounding makes of a lost rank.
pub const SINGULAR_RANK: f64 = 1e-13;

/// Norm of a step (rad) along the gradient below which the freedom has nowhere to go: the optimal factor would be a
/// quotient of roundings.
pub const STEP_DIRECTION: f64 = 1e-12;

/// Multiple of the damping threshold below which the reduced gradient looks for another basis: well above, so that the
/// change is over before damping would begin.
pub const BASIS_LEVEL: f64 = 4.0;

/// Multiple of the damping threshold below which damping is near and a change of basis is urgent.
pub const BASIS_URGENT: f64 = 2.0;

/// How much better another basis has to be, hysteresis against changing to and fro.
pub const BASIS_GAIN: f64 = 2.0;

/// The same where the change is urgent.
pub const BASIS_GAIN_URGENT: f64 = 1.25;

/// Share of its measure at the last look at other bases below which the present one has become worse: look again at once.
pub const BASIS_FALL: f64 = 0.9;

/// Share of `|J_a^-1|_F^2` that an exchange may leave while a basis is chosen, so that rounding cannot go round in circles.
pub const BASIS_PROGRESS: f64 = 0.99;

/// Violation of a velocity bound (rad/s, relative to 1 + the velocity) that is rounding. The result is clamped.
pub const BOX_VIOLATION: f64 = 1e-12;

/// Square, relative to the longest row, of what the active rows leave of one below which it depends on them: rounding is 1e-32.
pub const BOX_INDEPENDENT: f64 = 1e-22;

/// Ratio of the smallest to the largest singular value of a task Jacobian below which a configuration is a kinematic
/// singularity: null-space directions have then lost six of their sixteen digits, joint speeds are a million times the
/// tool's.
pub const KINEMATIC_SINGULARITY: f64 = 1e-6;

/// Least joint step (rad or m) of a continuation; a curve that asks for less turns within this distance, which a
/// singular configuration does.
pub const TRACE_SHORTEST: f64 = 1e-8;

/// Angle (rad) by which the tangent of a self-motion may turn in one step. The predicted point is then within a per
/// cent of the step of the curve.
pub const TRACE_TURN: f64 = 0.2;

/// Rooted ratio of the pivots of `J J^T` down to which a Newton step is taken from the normal equations: they cost it half of its
/// digits, which the next step restores.
pub const NORMAL_EQUATIONS: f64 = 1e-4;

/// Newton correction (rad) after which a point counts as on the curve: what is left is of the order of its square.
pub const TRACE_ONE_STEP: f64 = 1e-6;

/// Distance of the start from the step that passes it, relative to the step, at which a curve closes. The cubic
/// between two rows is nearer than this, a neighbouring piece that the step control can tell apart is not.
pub const TRACE_CLOSURE: f64 = 1e-2;

/// Distance (rad) at which a point lies on a curve: converged Newton steps leave less than the square of 1e-6.
pub const CURVE_CONTAINS: f64 = 1e-8;

/// Distance of a joint from its limit (rad or m), and width of the bracket (length of the curve), at which the end of a
/// feasible arc of a traced curve is found.
pub const EDGE_FOUND: f64 = 1e-13;

/// See [`EDGE_FOUND`]; the end that holds the limit is returned.
pub const EDGE_WIDTH: f64 = 1e-11;

/// Largest defect (m, rad) of an arm whose closed form counts as exact: what is left is rounding of the description, and
/// is corrected in one Newton step.
pub const CLOSED_FORM_EXACT: f64 = 1e-9;

/// Slope of a criterion along the self-motion, relative to its gradient and curvature, up to which a configuration
/// counts as critical: angles printed with four decimals of a degree (1.5e-6 rad from the critical point) pass.
pub const CRITICAL_SLOPE: f64 = 2e-6;

/// Curvature of a criterion along the self-motion, relative to the terms it is the sum of, up to which a critical point
/// can count as degenerate: next to a fold that is a distance of this order (rad), the precision of printed angles. It does
/// where its slope leaves that open.
pub const DEGENERATE_CURVATURE: f64 = 1e-5;

/// The same for a critical point without any slope: thousands of roundings, and what the search for algorithmic
/// singularities leaves.
pub const DEGENERATE_ROUNDING: f64 = 1e-9;

/// Newton step (rad or m) at which a critical point is as exact as doubles allow.
pub const NEWTON_DONE: f64 = 1e-13;

/// Distance (rad or m) below which two critical points are one: far above what Newton's method leaves, far below the
/// distance at which the two of a fold are still told apart by the signs of their curvatures.
pub const SAME_CRITICAL_POINT: f64 = 1e-7;

/// Pose error (m, rad) before a Newton step along a path after which the next one would only move rounding: its square.
pub const LINE_RESIDUAL: f64 = 1e-8;

/// Ratio of the pivots of `J J^T` (rooted) below which a configuration on a path is singular: six digits of the joint
/// step would be left, none of its second derivative.
pub const LINE_SINGULAR: f64 = 1e-6;

/// Misfit (m, rad) of an arm's closed form up to which its results are differentiated as they are: rounding of exact
/// descriptions. What a larger one leaves of the pose is for Newton to remove.
pub const LINE_DEFECT: f64 = 1e-12;

/// Joint difference (rad) modulo turns below which two configurations over a pose are the same one.
pub const SAME_LINE: f64 = 1e-6;

/// Pose error (m, rad) below which plain Newton takes over from damped steps.
pub const START_NEAR: f64 = 1e-2;

/// Share of a torque limit that gravity may take before the limit counts as used up: above it no speed is left.
pub const TORQUE_LEFT: f64 = 1e-9;

/// Share of its diagonal entry below which a pivot of `J J^T` counts as zero: three digits above rounding. Above it
/// determinant and inverse carry the same backward error, so that their product, the adjugate, is accurate.
pub const MANIPULABILITY_PIVOT: f64 = 1e-13;

/// Share of the size of its terms below which the second derivative along the freedom counts as nearly singular: from
/// there on the extended Jacobian leaves the stationary point.
pub const ALGORITHMIC_THRESHOLD: f64 = 2e-3;

/// Multiple of the fastest joint of the least motion that the task asks for up to which the extended Jacobian uses the
/// freedom on joints without speed limits: a maximum of the manipulability that follows a closed path needs 1.45.
pub const FREEDOM_SPEED_RATIO: f64 = 1.6;

/// The same for joints with a speed limit: more is fast near singularities, less keeps the arm from leaving them.
pub const LIMITED_SPEED_RATIO: f64 = 1.2;

/// Multiple of the damping's threshold from which on the extended Jacobian no longer uses the freedom to come nearer to a
/// singularity of J: nearer ones make the task fast, farther ones keep the arm from its optimum.
pub const KEEP_OFF_RATIO: f64 = 1.65;

/// Length (rad or m) of the step along the freedom over which the change of the least singular value is seen.
pub const SINGULARITY_STEP: f64 = 1e-4;

/// Newton step (rad, or metres of path in its units) at which a point of the extended system is exact: what is left is
/// its square.
pub const FOLLOW_DONE: f64 = 1e-12;

/// Joint distance (rad or m) within which a start is taken to the nearest critical point: angles printed with two
/// decimals of a degree pass.
pub const FOLLOW_START: f64 = 0.02;

/// Ratio of the singular values of J at which a path has met a kinematic singularity. What is left of the way is of the
/// order of its square.
pub const FOLLOW_SINGULAR: f64 = 1e-5;

/// Rate of the path parameter, relative to the speed in (q, s), at which a fold is located: s is exact to its square.
pub const FOLLOW_FOLD: f64 = 1e-9;

/// Shortest step (rad) along a critical locus: below it neither fold nor singularity explain why it cannot go on.
pub const FOLLOW_SHORTEST: f64 = 1e-10;

/// Step (rad or m) of the central difference of `det W`: the third root of the machine precision, where the errors of
/// rounding and of the formula are alike.
pub const SINGULARITY_DIFFERENCE: f64 = 6e-6;

/// Ratio of the singular values of J above which an algorithmic singularity is not a kinematic one. Near a kinematic
/// singularity mu and A shrink with the square of this ratio and would pass for zero.
pub const SINGULARITY_RANK: f64 = 1e-4;

/// What may be left of `mu` and of an eigenvalue of W, relative to gradient and curvature, at an algorithmic
/// singularity.
pub const SINGULARITY_RESIDUAL: f64 = 1e-10;

/// Distance (rad or m) below which two algorithmic singularities are one.
pub const SAME_SINGULARITY: f64 = 1e-6;

/// Squared sine of the angle between two segments below which they count as parallel: the place of the nearest points
/// of their lines is then decided by rounding, their distance is not.
pub const SEGMENT_PARALLEL: f64 = 1e-14;

/// Terms of a soft minimum that are this many smoothing widths further than the least are left out: `exp(-40)` is 4e-18.
pub const SOFT_MINIMUM_REST: f64 = 40.0;

/// Step (rad or m) of the differences of the clearance's gradient: a thousandth of the smoothing width at arm's length,
/// where truncation (its square over the cube of the width) and rounding (1e-15 over it) balance.
pub const CLEARANCE_DIFFERENCE: f64 = 2e-6;

/// Distance (m) between neighbouring joints below which no link is between them.
pub const LINK_LENGTH: f64 = 1e-9;

/// Rounding of the slope of a criterion along the self-motion, relative to its gradient and curvature.
pub const SLOPE_NOISE: f64 = 1e-13;

/// Steps between two points of a path after which a critical point is given up: only next to singularities are steps so
/// short that this many are needed.
pub const FOLLOW_STEPS: usize = 100_000;

/// Cosine of the angle between two rows at which Jacobi rotations take them for orthogonal: a few roundings of a
/// product of six numbers; singular values are exact to the same relative size.
pub const ORTHOGONAL: f64 = 1e-14;

/// Distance (m) from the lines shoulder - elbow - wrist within which a joint's frame is on them: far below any clearance
/// that matters, above what a URDF's rounded numbers leave.
pub const ON_LINE: f64 = 1e-6;

/// Largest distance (m) and angle (rad) between the ends of a path that counts as closed: a configuration that fits one
/// end fits the other as well as anything is measured.
pub const CYCLE_POSITION: f64 = 1e-9;

/// See [`CYCLE_POSITION`]; rotation matrices from quaternions of files carry this much.
pub const CYCLE_ANGLE: f64 = 1e-7;

/// Sine of a gimbal's middle angle (some 6 degrees) at which the force of a swivel flow away from it is largest.
pub const GIMBAL_FORCE: f64 = 0.1;

/// Place in the joint range (-1 to 1) beyond which the force of a swivel flow away from the limit grows no more.
pub const LIMIT_FORCE: f64 = 0.99;

/// Slope of the distance along the swivel (m/rad) below which the force away from an obstacle fades: about a tenth of
/// what the elbow's circle gives.
pub const FLOW_SLOPE: f64 = 0.02;

/// Slope of the distance along the swivel (m/rad) below which the barrier of a swivel flow fades: no swivel helps there.
pub const BARRIER_SLOPE: f64 = 0.005;

/// Share of the obstacle's force that it takes to turn a swivel flow round: the balance of wish and obstacle goes to and
/// fro a little with the path, and following all of it gains nothing.
pub const FLOW_FRICTION: f64 = 0.2;

/// Time within which a swivel flow follows its wanted rate, as a share of its time constant: shorter than that, so that it
/// does not swing.
pub const FLOW_SMOOTHING: f64 = 0.5;

/// Rate (rad/s) below which a swivel flow does not turn round when standing still will do.
pub const FLOW_TURN: f64 = 0.2;

/// Difference (m, and as a share) of the upper and lower bound of the distance of two convex shapes up to which the upper
/// one is returned.
pub const CONVEX_GAP: f64 = 1e-7;

/// Distance (m) of two convex shapes below which the direction between their nearest points is rounding.
pub const CONVEX_TOUCH: f64 = 1e-10;

/// Share of the extent of a closed mesh by which a vertex may be above a face of a convex one: what rounding to 32 bits makes
/// of a plane.
pub const MESH_CONVEX: f64 = 1e-6;

/// Share of seeded configurations in which two links touch beyond which they count as touching always.
pub const PAIRS_ALWAYS: f64 = 0.95;

/// Distance (m) that two links keep in all seeded configurations beyond which they never come near each other: room for what
/// the samples have missed.
pub const PAIRS_NEVER: f64 = 0.02;

/// Slope of a distance along the freedom of a task (m per unit of motion) up to which the freedom does not change it: far above
/// what rounding leaves, far below what any link does.
pub const HELD_SLOPE: f64 = 1e-7;

/// Change of a distance per rad or m of a joint below which the joint does not move the pair.
pub const CONTACT_SLOPE: f64 = 1e-9;

/// Distance (m) beyond the safe one from which a velocity step looks at pairs: at the default barrier rate a pair may come
/// nearer by 2.5 m/s there.
pub const CONTACT_HORIZON: f64 = 0.5;

/// Halvings of a motion until it is known whether it stays clear: of 0.1 rad at arm's length 0.02 mm are left.
pub const SWEEP_DEPTH: usize = 12;

/// Largest coordinate and size of an obstacle, m: squares and products of these stay far from overflow, and a millionth of
/// a metre is still told apart.
pub const SCENE_SIZE: f64 = 1e9;

/// Largest factor of a criterion, and reciprocal of the least: values, gradients and their squares stay finite.
pub const CRITERION_FACTOR: f64 = 1e60;

/// Least share of a path that a step counts, relative to the mean share: a step without length or time (a stop, a turn on
/// the spot) still costs what its joints move.
pub const PLAN_LEAST_SHARE: f64 = 1e-3;

/// Smoothing, m, of the least distance along a plan, and how many times as far beyond the nearest pair others still count.
pub const PLAN_ROOM_SMOOTHING: f64 = 1e-3;
/// See [`PLAN_ROOM_SMOOTHING`].
pub const PLAN_ROOM_SEEN: f64 = 20.0;

/// Distance, m, that the rows of a plan keep from contact, so that nothing touches between them.
pub const PLAN_ROOM: f64 = 1e-3;

/// Depth, m, of a contact on a line of the search that its refinement is not expected to push out.
pub const PLAN_DEEP: f64 = 0.03;
