//! Shared by the test rooms: seeded numbers and arms.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use redundancy_core::Pose;
use redundancy_core::chain::{Chain, ChainBuilder, JointKind, Limits, MissingLimits};
use redundancy_core::nalgebra::{Rotation3, Translation3, Unit, Vector3};
use redundancy_core::path::Plan;

pub fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

/// `REDUNDANCY_TEST_FULL=1` runs the full sizes, otherwise a seeded subset.
pub fn amount(quick: usize, full: usize) -> usize {
    if std::env::var("REDUNDANCY_TEST_FULL").is_ok_and(|v| v == "1") { full } else { quick }
}

pub fn unit(rng: &mut impl Rng) -> Unit<Vector3<f64>> {
    loop {
        let v = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0));
        if (0.1..1.0).contains(&Vector3::norm(&v)) {
            return Unit::new_normalize(v);
        }
    }
}

pub fn random_pose(rng: &mut impl Rng, size: f64) -> Pose {
    let rotation = Rotation3::from_axis_angle(&unit(rng), rng.random_range(-3.1..3.1));
    let translation = Vector3::from_fn(|_, _| rng.random_range(-size..size));
    Pose::from_parts(Translation3::from(translation), rotation)
}

/// Uniform joint angles within the limits (a full turn where there are none).
pub fn random_q(rng: &mut impl Rng, chain: &Chain) -> Vec<f64> {
    chain
        .lower()
        .iter()
        .zip(chain.upper())
        .map(|(lo, hi)| rng.random_range(lo.max(-std::f64::consts::PI)..=hi.min(std::f64::consts::PI)))
        .collect()
}

/// An S-R-S arm with lengths `[L1..L4]`, elbow offsets of the upper arm and the forearm, mounted, tooled and framed at
/// random, see [`scrambled`].
pub fn scrambled_srs(seed: u64, lengths: [f64; 4], elbow_offset: [f64; 2], limits: &[Limits; 7]) -> Chain {
    let [l1, l2, l3, l4] = lengths;
    let [near, far] = elbow_offset;
    let elbow = Vector3::new(near, 0.0, l1 + l2);
    let wrist = Vector3::new(near - far, 0.0, l1 + l2 + l3);
    let shoulder = Vector3::new(0.0, 0.0, l1);
    let (y, z) = (Vector3::y(), Vector3::z());
    let axes = [(shoulder, z), (shoulder, y), (shoulder, z), (elbow, y), (wrist, z), (wrist, y), (wrist, z)];
    scrambled(seed, &axes, wrist + z * l4, limits)
}

/// An arm with these joint axes (point, direction) and tip, mounted, tooled and framed at random: axis signs, joint
/// zeros, frame orientations and the point of each axis at which a frame sits are arbitrary.
pub fn scrambled(
    seed: u64,
    axes: &[(Vector3<f64>, Vector3<f64>)],
    tip: Vector3<f64>,
    limits: &[Limits],
) -> Chain {
    let mut rng = rng(seed);
    let q0: Vec<f64> = axes.iter().map(|_| rng.random_range(-2.0..2.0)).collect();
    let mut moved = Pose::identity();
    let mut frames = Vec::new();
    for ((point, direction), q) in axes.iter().zip(&q0) {
        let sign = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
        let at = point + direction * rng.random_range(-0.3..0.3);
        let orientation = random_pose(&mut rng, 1.0).rotation;
        let frame = moved * Pose::from_parts(Translation3::from(at), orientation);
        frames.push((frame, orientation.inverse() * (direction * sign)));
        let turn = Rotation3::new(direction * *q);
        moved *= Pose::from_parts(Translation3::from(point - turn * point), turn);
    }
    let end = moved * Pose::from_parts(Translation3::from(tip), Rotation3::identity());
    let mut builder = ChainBuilder::new("scrambled", "base").base(random_pose(&mut rng, 1.0));
    let mut previous = Pose::identity();
    for (i, (frame, axis)) in frames.into_iter().enumerate() {
        builder =
            builder.joint(format!("j{i}"), JointKind::Revolute, previous.inverse() * frame, axis, limits[i]);
        previous = frame;
    }
    builder.link("tip", previous.inverse() * end).tool(random_pose(&mut rng, 0.2)).build().unwrap()
}

/// An arm like the OpenArm: 0.22 m links and limits of a quarter turn and less, all in its own plain frames.
pub fn openarm_like() -> Chain {
    let degrees = [
        (-80.0, 80.0),
        (-90.0, 10.0),
        (-90.0, 90.0),
        (0.0, 90.0),
        (-90.0, 90.0),
        (-45.0, 45.0),
        (-90.0, 90.0),
    ];
    let mut builder = ChainBuilder::new("openarm_like", "base");
    for (i, ((lower, upper), z)) in
        degrees.into_iter().zip([0.12, 0.0, 0.0, 0.22, 0.22, 0.0, 0.0]).enumerate()
    {
        let axis = if i % 2 == 0 { Vector3::z() } else { Vector3::y() };
        let (lower, upper) = (f64::to_radians(lower), f64::to_radians(upper));
        let at = Pose::from_parts(Translation3::new(0.0, 0.0, z), Rotation3::identity());
        let limits = Limits { lower, upper, ..Limits::NONE };
        builder = builder.joint(format!("j{i}"), JointKind::Revolute, at, axis, limits);
    }
    let tip = Pose::from_parts(Translation3::new(0.0, 0.0, 0.1), Rotation3::identity());
    builder.link("tip", tip).build().unwrap()
}

/// The PA10 of [Moore2010] with the joint limits of its data sheet.
pub fn pa10() -> Chain {
    redundancy_core::chain::catalog::load("pa10").unwrap()
}

/// Largest difference of two configurations, joints modulo a turn.
pub fn difference(a: &[f64], b: &[f64]) -> f64 {
    let turn = std::f64::consts::TAU;
    a.iter().zip(b).map(|(a, b)| ((a - b) - turn * ((a - b) / turn).round()).abs()).fold(0.0, f64::max)
}

/// Distance of two poses: metres and the Frobenius norm of the rotation difference.
pub fn pose_error(a: &Pose, b: &Pose) -> f64 {
    let translation = (a.translation.vector - b.translation.vector).norm();
    translation.max((a.rotation.matrix() - b.rotation.matrix()).norm())
}

/// The rows of a plan for seven joints.
pub fn rows(plan: &Plan) -> &[[f64; 7]] {
    plan.q_rows()
}

/// The swivel of each row of a plan.
pub fn swivel(plan: &Plan) -> &[f64] {
    plan.spare_named("swivel").unwrap()
}

/// An arm of `tests/data/arms`, from PyPI's example-robot-data (see the PROVENANCE there).
pub fn urdf_arm(name: &str, base: &str, tip: &str) -> Chain {
    let path = format!("{}/../../tests/data/arms/{name}.urdf", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(&path).unwrap();
    Chain::from_urdf_string(&text, Some(base), Some(tip), MissingLimits::Refuse).unwrap()
}
