//! Arms that are compiled in, each with the source of its numbers.
//!
//! | name | arm | joints | limits | inertias |
//! |---|---|---|---|---|
//! | `dexter` | Scienza Machinale DEXTER | 8R | position | - |
//! | `fr3` | Franka Research 3 | 7R | position, velocity, torque | yes |
//! | `gen3` | Kinova Gen3, seven joints | 7R | position, velocity, torque | - |
//! | `iiwa14` | KUKA LBR iiwa 14 R820 | 7R | position, velocity, torque | yes |
//! | `irb2400` | ABB IRB 2400 | 6R | position, velocity | - |
//! | `kr6_r900` | KUKA KR 6 R900 sixx | 6R | position, velocity | - |
//! | `openarm` | Enactic OpenArm v1.0, one arm | 7R | position, velocity, torque | - |
//! | `pa10` | Mitsubishi PA10-7C | 7R | position, velocity | - |
//! | `panda` | Franka Emika Panda (FER) | 7R | position, velocity, acceleration, torque | yes |
//! | `planar3r` | Park's planar arm, 3, 2.5, 2 m | 3R | - | - |
//! | `planar4r` | the same with a fourth link of 1.5 m | 4R | - | - |
//! | `puma560` | Unimation PUMA 560 | 6R | position, torque | yes, with rotors |
//! | `rby1` | Rainbow Robotics RB-Y1, right arm | 7R | position, velocity, acceleration, torque | - |
//! | `rizon4` | Flexiv Rizon 4 | 7R | position, velocity, torque | - |
//! | `sawyer` | Rethink Robotics Sawyer | 7R | position, velocity, torque | - |
//! | `unitree_g1` | Unitree G1, left arm | 7R | position, velocity, torque | - |
//! | `ur3e`, `ur5e`, `ur10e`, `ur16e`, `ur20`, `ur30` | Universal Robots | 6R | position, velocity, torque | - |
//! | `xarm7` | UFACTORY xArm 7 | 7R | position, velocity, torque | - |
//!
//! What a source does not publish is infinite (limits) or absent (inertias); nothing is guessed. Right angles are
//! exact: the rotation part of every placement has entries 0 and +-1, except where an arm leans (`rby1`, `sawyer`, `unitree_g1`).

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Matrix3, Vector3};

use super::builder::ChainBuilder;
use super::chain::Chain;
use super::dh::{DhConvention, DhRow};
use super::entries::{along_z, body, diagonal, limits, row};
use super::joint::{JointKind, Limits};
use super::published;
use crate::error::{Error, Result};
use crate::pose::{Pose, pose};

const ARMS: [(&str, fn() -> Result<Chain>); 23] = [
    ("dexter", dexter),
    ("fr3", published::fr3),
    ("gen3", published::gen3),
    ("iiwa14", iiwa14),
    ("irb2400", published::irb2400),
    ("kr6_r900", published::kr6_r900),
    ("openarm", published::openarm),
    ("pa10", pa10),
    ("panda", panda),
    ("planar3r", planar3r),
    ("planar4r", planar4r),
    ("puma560", puma560),
    ("rby1", published::rby1),
    ("rizon4", published::rizon4),
    ("sawyer", published::sawyer),
    ("unitree_g1", published::unitree_g1),
    ("ur10e", published::ur10e),
    ("ur16e", published::ur16e),
    ("ur20", published::ur20),
    ("ur30", published::ur30),
    ("ur3e", published::ur3e),
    ("ur5e", published::ur5e),
    ("xarm7", published::xarm7),
];

/// The names that [`load`] knows, in alphabetical order.
pub fn names() -> impl ExactSizeIterator<Item = &'static str> {
    ARMS.iter().map(|(name, _)| *name)
}

/// The arm called `name`.
///
/// # Errors
/// An unknown name; the message lists the known ones.
///
/// ```
/// use redundancy_core::chain::catalog;
/// let arm = catalog::load("pa10")?;
/// let tip = arm.forward(&[0.0; 7])?;
/// assert_eq!(tip.translation.z, 0.315 + 0.45 + 0.5 + 0.08);
/// assert!(catalog::load("r2d2").is_err_and(|e| e.to_string().contains("pa10")));
/// # Ok::<(), redundancy_core::Error>(())
/// ```
pub fn load(name: &str) -> Result<Chain> {
    match ARMS.iter().find(|(known, _)| *known == name) {
        Some((_, make)) => make(),
        None => {
            let valid = names().map(String::from).collect();
            Err(Error::UnknownName { kind: "robot", name: name.into(), valid })
        }
    }
}

/// Mitsubishi PA10-7C, an arm with spherical shoulder and wrist.
///
/// - Geometry: `[Moore2010]`, fig. 6: shoulder at 0.315 m, upper arm 0.45 m, forearm 0.5 m, tool 0.08 m; axes
///   z, y, z, y, z, y, z when stretched upwards.
/// - Limits: Mitsubishi Heavy Industries, PA10 general-purpose robot, specification of the PA10-7C: positions
///   +-177, 91, 174, 137, 255, 165, 360 deg; speeds 57, 57, 114, 114, 360, 360, 360 deg/s (1, 1, 2, 2, 2 pi,
///   2 pi, 2 pi rad/s, rounded). Torque limits are not published.
fn pa10() -> Result<Chain> {
    let range = [177.0, 91.0, 174.0, 137.0, 255.0, 165.0, 360.0].map(f64::to_radians);
    let speed = [57.0, 57.0, 114.0, 114.0, 360.0, 360.0, 360.0].map(f64::to_radians);
    let (y, z) = (Vector3::y(), Vector3::z());
    let joints = [
        ("S1", z, 0.0),
        ("S2", y, 0.315),
        ("S3", z, 0.0),
        ("E1", y, 0.45),
        ("E2", z, 0.0),
        ("W1", y, 0.5),
        ("W2", z, 0.0),
    ];
    upright("pa10", &joints, "flange", 0.08)
        .limits(&limits(&range.map(|r| -r), &range, &speed, &[], &[]))
        .build()
}

/// KUKA LBR iiwa 14 R820 with the tip on the flange.
///
/// - Geometry: KUKA, LBR iiwa 7 R800 / 14 R820 specification: 0.36, 0.42, 0.40, 0.126 m. Axis signs and link frames
///   along the column as in the URDF that Drake ships (`RobotLocomotion/drake`,
///   `manipulation/models/iiwa_description/urdf/iiwa14_no_collision.urdf`, BSD-3), with all frames turned parallel
///   to the base: axes z, y, z, -y, z, y, z.
/// - Limits: the same specification: +-170, 120, 170, 120, 170, 120, 175 deg; 85, 85, 100, 75, 130, 135, 135 deg/s;
///   320, 320, 176, 176, 110, 40, 40 N m.
/// - Inertias: that Drake URDF, its frames turned as above. KUKA publishes none; these are Drake's values, fitted to
///   the weight of the real arm. Good for simulation, not for identification.
fn iiwa14() -> Result<Chain> {
    let range = [170.0, 120.0, 170.0, 120.0, 170.0, 120.0, 175.0].map(f64::to_radians);
    let speed = [85.0, 85.0, 100.0, 75.0, 130.0, 135.0, 135.0].map(f64::to_radians);
    let torque = [320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0];
    let (y, z) = (Vector3::y(), Vector3::z());
    let joints = [
        ("A1", z, 0.1575),
        ("A2", y, 0.2025),
        ("A3", z, 0.2045),
        ("A4", -y, 0.2155),
        ("A5", z, 0.1845),
        ("A6", y, 0.2155),
        ("A7", z, 0.081),
    ];
    upright("iiwa14", &joints, "link_ee", 0.045)
        .link_names([
            "link_0", "link_1", "link_2", "link_3", "link_4", "link_5", "link_6", "link_7", "link_ee",
        ])
        .limits(&limits(&range.map(|r| -r), &range, &speed, &[], &torque))
        .link_inertias(&[
            diagonal(5.76, [0.0, -0.03, 0.12], [0.033, 0.0333, 0.0123]),
            diagonal(6.35, [-0.0003, 0.042, 0.059], [0.0305, 0.011, 0.0304]),
            diagonal(3.5, [0.0, 0.03, 0.13], [0.025, 0.0238, 0.0076]),
            diagonal(3.5, [0.0, -0.034, 0.067], [0.017, 0.006, 0.0164]),
            diagonal(3.5, [-0.0001, -0.021, 0.076], [0.01, 0.0087, 0.00449]),
            diagonal(1.8, [0.0, 0.0004, 0.0006], [0.0049, 0.0036, 0.0047]),
            diagonal(1.2, [0.0, 0.0, 0.02], [0.001, 0.001, 0.001]),
        ])
        .build()
}

/// Franka Emika Panda (FER) with the tip on the flange, 0.107 m after joint 7.
///
/// - Geometry (modified D-H) and limits: Franka Control Interface documentation, 'Robot and interface
///   specifications', limits for Panda and Denavit-Hartenberg parameters
///   (`https://frankaemika.github.io/docs/control_parameters.html`).
/// - Inertias: `[Gaz2019]`, as in `franka_ros/franka_description/robots/common/inertial.yaml`. Identified, not
///   official; rotors are not included.
fn panda() -> Result<Chain> {
    let rows = [
        row(0.0, 0.333, 0.0),
        row(0.0, 0.0, -FRAC_PI_2),
        row(0.0, 0.316, FRAC_PI_2),
        row(0.0825, 0.0, FRAC_PI_2),
        row(-0.0825, 0.384, -FRAC_PI_2),
        row(0.0, 0.0, FRAC_PI_2),
        row(0.088, 0.0, FRAC_PI_2),
    ];
    let lower = [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973];
    let upper = [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973];
    let speed = [2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61];
    let acceleration = [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0];
    let torque = [87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0];
    // xx, yy, zz, xy, xz, yz at the centre of mass
    let bodies = [
        body(
            4.970684,
            [0.003875, 0.002081, -0.04762],
            [0.70337, 0.70661, 0.009117, -0.000139, 0.006772, 0.019169],
        ),
        body(
            0.646926,
            [-0.003141, -0.02872, 0.003495],
            [0.007962, 0.02811, 0.025995, -0.003925, 0.010254, 0.000704],
        ),
        body(
            3.228604,
            [0.027518, 0.039252, -0.066502],
            [0.037242, 0.036155, 0.01083, -0.004761, -0.011396, -0.012805],
        ),
        body(
            3.587895,
            [-0.05317, 0.104419, 0.027454],
            [0.025853, 0.019552, 0.028323, 0.007796, -0.001332, 0.008641],
        ),
        body(
            1.225946,
            [-0.011953, 0.041065, -0.038437],
            [0.035549, 0.029474, 0.008627, -0.002117, -0.004037, 0.000229],
        ),
        body(
            1.666555,
            [0.060149, -0.014117, -0.010517],
            [0.001964, 0.004354, 0.005433, 0.000109, -0.001158, 0.000341],
        ),
        body(
            0.735522,
            [0.010517, -0.004252, 0.061597],
            [0.012516, 0.010027, 0.004815, -0.000428, -0.001196, -0.000741],
        ),
    ];
    ChainBuilder::from_dh("panda", &rows, DhConvention::Modified)
        .joint_names((1..=7).map(|i| format!("panda_joint{i}")))
        .link_names((0..=7).map(|i| format!("panda_link{i}")))
        .limits(&limits(&lower, &upper, &speed, &acceleration, &torque))
        .link_inertias(&bodies)
        .link("panda_link8", along_z(0.107))
        .build()
}

/// Scienza Machinale DEXTER, eight joints, labelled 0 to 7 as in the paper.
///
/// - Geometry and position limits: `[Bettini2000]`, table 1 (standard D-H); the constant rotation between the base
///   and frame 0 is `[[0, 1, 0], [0, 0, -1], [-1, 0, 0]]`, recovered from the paper's start pose.
/// - The paper gives no velocity or torque limits.
fn dexter() -> Result<Chain> {
    let rows = [
        row(0.0, 0.0, -FRAC_PI_2),
        row(0.144, 0.45, -FRAC_PI_2),
        row(0.0, 0.0, FRAC_PI_2),
        row(0.1, 0.35, FRAC_PI_2),
        row(0.0, 0.0, -FRAC_PI_2),
        row(0.024, 0.25, -FRAC_PI_2),
        row(0.0, 0.0, -FRAC_PI_2),
        row(0.1, 0.0, PI),
    ];
    let lower = [-12.56, -83.0, 7.0, 65.0, -174.0, 57.0, -129.99, -55.05].map(f64::to_radians);
    let upper = [179.89, 84.0, 173.0, 295.0, -3.0, 265.0, -45.0, 30.0].map(f64::to_radians);
    let base = Matrix3::new(0.0, 1.0, 0.0, 0.0, 0.0, -1.0, -1.0, 0.0, 0.0);
    ChainBuilder::from_dh("dexter", &rows, DhConvention::Standard)
        .joint_names((0..8).map(|i| format!("joint{i}")))
        .limits(&limits(&lower, &upper, &[], &[], &[]))
        .base(pose(base, Vector3::zeros()))
        .build()
}

/// Unimation PUMA 560, base frame at the shoulder, standard D-H.
///
/// - Geometry, masses, inertias, gear ratios, motor inertias and torque limits: the parameters that Corke and
///   Armstrong-Helouvry compiled `[Corke1994]`, as used in the experiment of `[FromGravdahl2007]`.
///   The inertia of a rotor at its joint is gear ratio squared times motor inertia; friction is left out.
/// - Position limits in these D-H angles: +-160, -45..225, -232..52, +-140, +-100, +-266 deg.
/// - Velocity limits are not published with that set.
fn puma560() -> Result<Chain> {
    let rows = [
        row(0.0, 0.0, FRAC_PI_2),
        row(0.4318, 0.0, 0.0),
        row(0.0203, 0.15005, -FRAC_PI_2),
        row(0.0, 0.4318, FRAC_PI_2),
        row(0.0, 0.0, -FRAC_PI_2),
        row(0.0, 0.0, 0.0),
    ];
    let lower = [-160.0, -45.0, -232.0, -140.0, -100.0, -266.0].map(f64::to_radians);
    let upper = [160.0, 225.0, 52.0, 140.0, 100.0, 266.0].map(f64::to_radians);
    let torque = [97.6, 186.4, 89.4, 24.2, 20.1, 21.3];
    let mut bodies = [
        diagonal(0.0, [0.0, 0.0, 0.0], [0.0, 0.35, 0.0]),
        diagonal(17.4, [-0.3638, 0.006, 0.2275], [0.13, 0.524, 0.539]),
        diagonal(4.8, [-0.0203, -0.0141, 0.070], [0.066, 0.086, 0.0125]),
        diagonal(0.82, [0.0, 0.019, 0.0], [1.8e-3, 1.3e-3, 1.8e-3]),
        diagonal(0.34, [0.0, 0.0, 0.0], [0.3e-3, 0.4e-3, 0.3e-3]),
        diagonal(0.09, [0.0, 0.0, 0.032], [0.15e-3, 0.15e-3, 0.04e-3]),
    ];
    let gear_ratio: [f64; 6] = [62.6111, 107.815, 53.7063, 76.0364, 71.923, 76.686];
    let motor_inertia = [2e-4, 2e-4, 2e-4, 3.3e-5, 3.3e-5, 3.3e-5];
    for ((body, ratio), motor) in bodies.iter_mut().zip(gear_ratio).zip(motor_inertia) {
        body.rotor = ratio * ratio * motor;
    }
    ChainBuilder::from_dh("puma560", &rows, DhConvention::Standard)
        .limits(&limits(&lower, &upper, &[], &[], &torque))
        .link_inertias(&bodies)
        .build()
}

/// The planar arm of `[Park1996]`: links of 3, 2.5 and 2 m, turning about z, no limits.
fn planar3r() -> Result<Chain> {
    planar("planar3r", &[3.0, 2.5, 2.0])
}

/// The planar arm of `[Park1996]` with a fourth link of 1.5 m: two spare freedoms for a position in the plane.
fn planar4r() -> Result<Chain> {
    planar("planar4r", &[3.0, 2.5, 2.0, 1.5])
}

fn planar(name: &str, lengths: &[f64]) -> Result<Chain> {
    let rows: Vec<DhRow> = lengths.iter().map(|a| row(*a, 0.0, 0.0)).collect();
    ChainBuilder::from_dh(name, &rows, DhConvention::Standard).build()
}

/// A column of joints above each other: name, axis, height above the joint before. All frames are parallel at 0.
fn upright(name: &str, joints: &[(&str, Vector3<f64>, f64)], tip: &str, height: f64) -> ChainBuilder {
    let mut builder = ChainBuilder::new(name, "base");
    for (i, (joint, axis, height)) in joints.iter().enumerate() {
        builder = builder
            .joint(*joint, JointKind::Revolute, along_z(*height), *axis, Limits::NONE)
            .link(format!("link{}", i + 1), Pose::identity());
    }
    builder.link(tip, along_z(height))
}
