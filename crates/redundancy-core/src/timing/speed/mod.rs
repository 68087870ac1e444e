//! How fast a tool can follow a path.
//!
//! # Problem
//! At constant tool speed `v` the joints move with `qd = v q'` and `qdd = v^2 q''` (primes by arc length), so without
//! friction `tau = G + v^2 D`, `G` the torque of gravity and `D = RNE(q, q', q'', g = 0)`. Each limit then is a bound on
//! `t = 1/v^2` alone: `t >= D / (L - G)`, `t >= -D / (L + G)` and `t >= (q' / qd_max)^2`. The largest constant speed is
//! `1 / sqrt(max t)`: exact, no search. [FromGravdahl2007, section 9] looked for it by simulation.
//!
//! When the speed may change along the path, `tau = M q' a + D x + G` with `x = ds/dt^2` and `a = x'/2`. The fastest motion
//! follows from two passes over the path [PhamPham2018]: backwards the largest `x` from which the end can still be reached,
//! forwards the largest acceleration that stays below it.
//!
//! `q'` and `q''` are those of the cubic spline through the joint positions (not-a-knot ends).
//!
//! Degenerate cases: a joint whose torque limit does not hold the arm alone is an error that names joint and point; a path
//! on which nothing moves has no speed.
//!
//! Cost: about 0.5 us per point and core for six joints when the joint positions are given.
//!
//! References: [FromGravdahl2007], [PhamPham2018].

mod branch;
mod constant;
mod profile;
mod settings;
mod terms;

pub use branch::max_speed_of_poses;
pub use constant::{MaxSpeed, max_speed};
pub(super) use profile::{PROFILE_SLACK, SPEED_CAP, VERTEX_STEPS};
pub use profile::{SpeedProfile, fastest_profile};
pub use settings::{SpeedLimit, SpeedSettings};
