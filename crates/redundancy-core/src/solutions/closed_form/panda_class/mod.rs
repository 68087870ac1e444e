//! Seven-joint arms with a spherical shoulder whose last three axes do not meet: Franka Panda and FR3, xArm7, GEN72.
//!
//! # Geometry
//! Axes 1, 2, 3 meet in S, axes 5 and 6 in W; axis 7 passes W at a distance. Written as a product of turns about the lines of
//! `q = 0`, with the pose T (its home value taken off), turning back joint 7 shows the chord `c = W - S` from the hand,
//!
//! ```text
//! c_6(x) = W - (S seen from the tool, turned by q7),      x = q7 + const,
//! ```
//!
//! and joint 4 shows it from the forearm, `c_4(y) = W - (S turned back by q4)`, `y = q4 + const`. Both have sinusoids of
//! x or y as coordinates. Joints 5 and 6 have to turn one into the other, `c_4 = R(axis 5, q5) R(axis 6, q6) c_6`, for which there
//! must be a vector c with the length of both, the component `g(y)` of `c_4` along axis 5 and `f(x)` of `c_6` along axis 6:
//!
//! ```text
//! |c_6(x)|^2 = |c_4(y)|^2                                                            (1)
//! c = g a5 + (f - g cos b)/sin b e + n m,   n^2 = |c|^2 - g^2 - ((f - g cos b)/sin b)^2 =: room >= 0      (2)
//! ```
//!
//! with b the angle between axes 5 and 6, m their common normal and `e = m x a5`. Given q7, (1) has two solutions y (elbow), (2)
//! two signs of n; joints 5 and 6 follow from c, and the rotation that is left for joints 1, 2, 3 has two solutions
//! (shoulder): at most eight configurations.
//!
//! # Self-motion
//! (1) is a set of rings on the torus of x and y, (2) cuts them into lenses (`ring.rs`). A lens carries both signs of n, glued at
//! its ends, where q7 (or q4) turns back: with `w = c - h cos u` the parameter u is regular there. So the set over a pose is, for
//! either shoulder, at most four closed curves with an analytic parameter, and all of them: nothing is traced. Where joint
//! limits hold on them is in `arcs.rs`, nearest and best in `optimum.rs`.
//!
//! # Degenerate poses
//! - Axes 1 and 3 along each other (the shoulder's gimbal): joint 1 is 0, or shares the sum with joint 3 so that limits hold.
//! - S on axis 5 or axis 6: joint 5 or 6 is free and 0 is taken.
//! - S on axis 7: x does not matter to (1); the rings are those over all x.
//! - Zeros of the room that meet: the curves on both sides touch; each is listed by its own.
//!
//! # References
//! `[HeLiu2021]` solve the Panda for a given q7, `[LopezCustodio2025]` (GeoFIK) geometrically for several joints, `[EliasWen2023]`
//! give 7R families by subproblems. The rings, the lenses and their parameter are this module's.

mod arcs;
mod arm;
mod geometry;
mod motion;
mod optimum;
mod proof;
mod ring;
mod solutions;
mod target;
mod walk;
mod widest;

pub use arm::PandaClassArm;
pub use motion::PandaMotion;
