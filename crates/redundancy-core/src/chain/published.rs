//! Arms of the catalogue whose descriptions are published by their makers or by the maintainers of their drivers.
//!
//! Every function names the repository, the commit that was opened, the file and the licence. Numbers are those of the file;
//! angles within 1e-5 of a multiple of a right angle are that multiple, so that axes meet and are parallel as they are meant to.
//! Masses are left out except where a maker gives its own.

#![expect(clippy::approx_constant, reason = "the numbers are those of the published files, digit by digit")]

use std::f64::consts::PI;

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::builder::ChainBuilder;
use super::chain::Chain;
use super::dh::DhConvention;
use super::entries::{body, limits, row};
use super::joint::{JointKind, Limits};
use crate::error::Result;
use crate::joint_space::TURN;
use crate::pose::{Pose, pose};

/// No limit, for arms with a joint that turns on.
const FREE: f64 = f64::INFINITY;

/// A joint: name, place in the frame before, axis.
type Row = (&'static str, Pose, [f64; 3]);

const X: [f64; 3] = [1.0, 0.0, 0.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];

/// Franka Research 3 with the tip on the flange, 0.107 m after joint 7.
///
/// - Geometry, limits, masses and inertias: `frankarobotics/franka_description`, commit 566ba44 (2025-07-09),
///   `robots/fr3/{kinematics,joint_limits,inertials}.yaml`, Apache-2.0. Accelerations are not given there.
pub(super) fn fr3() -> Result<Chain> {
    let bodies = [
        body(
            2.9274653454,
            [0.0000004128, -0.0181251324, -0.0386035970],
            [
                0.023927316485107913,
                0.0224821613275756,
                0.006350098258530016,
                1.3317903455714081e-05,
                -0.00011404774918616684,
                -0.0019950320628240115,
            ],
        ),
        body(
            2.9355370338,
            [0.0031828864, -0.0743221644, 0.0088146084],
            [
                0.041938946257609425,
                0.02514514885014724,
                0.06170214472888839,
                0.00020257331521090626,
                0.004077784227179924,
                -0.0042252158006570156,
            ],
        ),
        body(
            2.2449013699,
            [0.0407015686, -0.0048200565, -0.0289730823],
            [
                0.02410142547240885,
                0.01974053266708178,
                0.019044494482244823,
                0.002404694559042109,
                -0.002856269270114313,
                -0.002104212683891874,
            ],
        ),
        body(
            2.6155955791,
            [-0.0459100965, 0.0630492960, -0.0085187868],
            [
                0.03452998321913202,
                0.028881621933049058,
                0.04125471171146641,
                0.01322552265982813,
                0.01015142998484113,
                -0.0009762833870704552,
            ],
        ),
        body(
            2.3271207594,
            [-0.0016039605, 0.0292536262, -0.0972965990],
            [
                0.051610278463662895,
                0.04787729713371481,
                0.016423625579357254,
                -0.005715173387783472,
                -0.0035673167625872135,
                0.010673985108535986,
            ],
        ),
        body(
            1.8170376524,
            [0.0597131221, -0.0410294666, -0.0101692726],
            [
                0.005412333594383447,
                0.014058329545509979,
                0.016080817924212554,
                0.006193456360285834,
                0.0014219289306117652,
                -0.0013140753741120031,
            ],
        ),
        body(
            0.6271432862,
            [0.0045225817, 0.0086261921, -0.0161633251],
            [
                0.00021092389150104718,
                0.00017718568002411474,
                5.993190599659971e-05,
                -2.433299114461931e-05,
                4.564480393778983e-05,
                8.744070223226438e-05,
            ],
        ),
    ];
    let joints: [Row; 7] = [
        ("fr3_joint1", at([0.0, 0.0, 0.333], [0, 0, 0]), Z),
        ("fr3_joint2", at([0.0, 0.0, 0.0], [-1, 0, 0]), Z),
        ("fr3_joint3", at([0.0, -0.316, 0.0], [1, 0, 0]), Z),
        ("fr3_joint4", at([0.0825, 0.0, 0.0], [1, 0, 0]), Z),
        ("fr3_joint5", at([-0.0825, 0.384, 0.0], [-1, 0, 0]), Z),
        ("fr3_joint6", at([0.0, 0.0, 0.0], [1, 0, 0]), Z),
        ("fr3_joint7", at([0.088, 0.0, 0.0], [1, 0, 0]), Z),
    ];
    let upper = [2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159];
    let lower = [-2.7437, -1.7837, -2.9007, -3.0421, -2.8065, 0.5445, -3.0159];
    let speed = [2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26];
    let torque = [87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0];
    described("fr3", "fr3_link0", &joints, &limits(&lower, &upper, &speed, &[], &torque))
        .link_names((0..=7).map(|i| format!("fr3_link{i}")))
        .link_inertias(&bodies)
        .link("fr3_link8", at([0.0, 0.0, 0.107], [0, 0, 0]))
        .build()
}

/// UFACTORY xArm 7 with the tip on the flange.
///
/// - Geometry and limits: `xArm-Developer/xarm_ros2`, commit 3654ba7 (2024-11-05),
///   `xarm_description/urdf/xarm7/xarm7.urdf.xacro`, BSD-3-Clause. Right angles are 1.5708 there.
pub(super) fn xarm7() -> Result<Chain> {
    let joints: [Row; 7] = [
        ("joint1", at([0.0, 0.0, 0.267], [0, 0, 0]), Z),
        ("joint2", at([0.0, 0.0, 0.0], [-1, 0, 0]), Z),
        ("joint3", at([0.0, -0.293, 0.0], [1, 0, 0]), Z),
        ("joint4", at([0.0525, 0.0, 0.0], [1, 0, 0]), Z),
        ("joint5", at([0.0775, -0.3425, 0.0], [1, 0, 0]), Z),
        ("joint6", at([0.0, 0.0, 0.0], [1, 0, 0]), Z),
        ("joint7", at([0.076, 0.097, 0.0], [-1, 0, 0]), Z),
    ];
    let lower = [-TURN, -2.059, -TURN, -0.19198, -TURN, -1.69297, -TURN];
    let upper = [TURN, 2.0944, TURN, 3.927, TURN, PI, TURN];
    let torque = [50.0, 50.0, 30.0, 30.0, 30.0, 20.0, 20.0];
    described("xarm7", "link_base", &joints, &limits(&lower, &upper, &[3.14; 7], &[], &torque))
        .link("link_eef", Pose::identity())
        .build()
}

/// Kinova Gen3 with seven joints, 0.35 mm and 11.75 mm away from spherical at wrist and shoulder; the tip is the interface.
///
/// - Geometry and limits: `Kinovarobotics/ros2_kortex`, commit 1fdbef3 (2026-04-03),
///   `kortex_description/arms/gen3/7dof/urdf/gen3_macro.xacro`, BSD-3-Clause. Joints 1, 3, 5, 7 turn on.
pub(super) fn gen3() -> Result<Chain> {
    let joints: [Row; 7] = [
        ("joint_1", at([0.0, 0.0, 0.15643], [2, 0, 0]), Z),
        ("joint_2", at([0.0, 0.005375, -0.12838], [1, 0, 0]), Z),
        ("joint_3", at([0.0, -0.21038, -0.006375], [-1, 0, 0]), Z),
        ("joint_4", at([0.0, 0.006375, -0.21038], [1, 0, 0]), Z),
        ("joint_5", at([0.0, -0.20843, -0.006375], [-1, 0, 0]), Z),
        ("joint_6", at([0.0, 0.00017505, -0.10593], [1, 0, 0]), Z),
        ("joint_7", at([0.0, -0.10593, -0.00017505], [-1, 0, 0]), Z),
    ];
    let upper = [FREE, 2.24, FREE, 2.57, FREE, 2.09, FREE];
    let speed = [1.3963, 1.3963, 1.3963, 1.3963, 1.2218, 1.2218, 1.2218];
    let torque = [39.0, 39.0, 39.0, 39.0, 9.0, 9.0, 9.0];
    let links = [
        "base_link",
        "shoulder_link",
        "half_arm_1_link",
        "half_arm_2_link",
        "forearm_link",
        "spherical_wrist_1_link",
        "spherical_wrist_2_link",
        "bracelet_link",
    ];
    described("gen3", "base_link", &joints, &limits(&upper.map(|limit| -limit), &upper, &speed, &[], &torque))
        .link_names(links)
        .link("end_effector_link", at([0.0, 0.0, -0.061525], [2, 0, 0]))
        .build()
}

/// One arm of the OpenArm v1.0 (the single arm of the description), the tip on its last link.
///
/// - Geometry and limits: `enactic/openarm_description`, commit af6f035 (2025-07-23),
///   `config/arm/v10/{kinematics,joint_limits}.yaml` through `urdf/arm/openarm_arm.xacro` without a prefix, Apache-2.0.
///   The 1e-6 m along x of the frame after joint 7 is kept.
pub(super) fn openarm() -> Result<Chain> {
    let joints: [Row; 7] = [
        ("openarm_joint1", at([0.0, 0.0, 0.0625], [0, 0, 0]), Z),
        ("openarm_joint2", at([-0.0301, 0.0, 0.06], [0, 0, 0]), [-1.0, 0.0, 0.0]),
        ("openarm_joint3", at([0.0301, 0.0, 0.06625], [0, 0, 0]), Z),
        ("openarm_joint4", at([0.0, 0.0315, 0.15375], [0, 0, 0]), Y),
        ("openarm_joint5", at([0.0, -0.0315, 0.0955], [0, 0, 0]), Z),
        ("openarm_joint6", at([0.0375, 0.0, 0.1205], [0, 0, 0]), X),
        ("openarm_joint7", at([-0.0375, 0.0, 0.0], [0, 0, 0]), [0.0, -1.0, 0.0]),
    ];
    // The description mirrors the (symmetric) limits of joint 2.
    let lower = [-1.396263, -1.745329, -1.570796, 0.0, -1.570796, -0.785398, -1.570796];
    let upper = [3.490659, 1.745329, 1.570796, 2.443461, 1.570796, 0.785398, 1.570796];
    let speed = [16.754666, 16.754666, 5.445426, 5.445426, 20.943946, 20.943946, 20.943946];
    let torque = [40.0, 40.0, 27.0, 27.0, 7.0, 7.0, 7.0];
    described("openarm", "openarm_link0", &joints, &limits(&lower, &upper, &speed, &[], &torque))
        .link_names((0..=7).map(|i| format!("openarm_link{i}")))
        .link("openarm_link8", at([1e-6, 0.0205, 0.0], [0, 0, 0]))
        .build()
}

/// The right arm of a Rainbow Robotics RB-Y1 (model A), from the last link of the torso to the end of its force sensor.
///
/// - Geometry and limits, accelerations included: `RainbowRobotics/rby1-sdk`, commit 38df326 (2026-05-07),
///   `models/rby1a/urdf/model.urdf`, Apache-2.0. Joint 0 leans by 20 degrees, with the axis as it is printed.
pub(super) fn rby1() -> Result<Chain> {
    let joints: [Row; 7] = [
        ("right_arm_0", at([0.0, -0.220, 0.080073451539], [0, 0, 0]), [0.0, 0.93969262, -0.34202014]),
        ("right_arm_1", at([0.0; 3], [0, 0, 0]), X),
        ("right_arm_2", at([0.0; 3], [0, 0, 0]), Z),
        ("right_arm_3", at([0.031, 0.0, -0.276], [0, 0, 0]), Y),
        ("right_arm_4", at([-0.031, 0.0, -0.256], [0, 0, 0]), Z),
        ("right_arm_5", at([0.0; 3], [0, 0, 0]), Y),
        ("right_arm_6", at([0.0; 3], [0, 0, 0]), Z),
    ];
    let lower =
        [-3.141592654, -3.141592654, -3.141592654, -2.617993878, -3.141592654, -1.570796327, -2.705260340];
    let upper = [3.141592654, 0.017453293, 3.141592654, 0.017453293, 3.141592654, 1.919862177, 2.705260340];
    let speed = [3.141592654, 3.141592654, 3.141592654, 3.141592654, 6.283185308, 6.283185308, 2.094395102];
    let torque = [70.0, 70.0, 70.0, 40.0, 10.0, 10.0, 8.0];
    let links = std::iter::once("link_torso_5".to_owned());
    described("rby1", "link_torso_5", &joints, &limits(&lower, &upper, &speed, &[10.0; 7], &torque))
        .link_names(links.chain((0..7).map(|i| format!("link_right_arm_{i}"))))
        .link("ee_right", at([0.0, 0.0, -0.1087 - 0.0461], [0, 0, 0]))
        .build()
}

/// Rethink Robotics Sawyer with the tip on its hand frame. Its flange is turned by 10 degrees about an axis in its plane.
///
/// - Geometry and limits: `RethinkRobotics/sawyer_robot`, commit d1ef3d0 (2020-01-06),
///   `sawyer_description/urdf/sawyer_base.urdf.xacro`, Apache-2.0; joint 6 with the limits of the real arm.
pub(super) fn sawyer() -> Result<Chain> {
    let joints: [Row; 7] = [
        ("right_j0", at([0.0, 0.0, 0.08], [0, 0, 0]), Z),
        ("right_j1", at([0.081, 0.05, 0.237], [-1, 1, 0]), Z),
        ("right_j2", at([0.0, -0.14, 0.1425], [1, 0, 0]), Z),
        ("right_j3", at([0.0, -0.042, 0.26], [-1, 0, 0]), Z),
        ("right_j4", at([0.0, -0.125, -0.1265], [1, 0, 0]), Z),
        ("right_j5", at([0.0, 0.031, 0.275], [-1, 0, 0]), Z),
        ("right_j6", turned([0.0, -0.11, 0.1053], [-0.5 * PI, -0.17453, PI]), Z),
    ];
    let lower = [-3.0503, -3.8095, -3.0426, -3.0439, -2.9761, -2.9761, -4.7124];
    let upper = [3.0503, 2.2736, 3.0426, 3.0439, 2.9761, 2.9761, 4.7124];
    let speed = [1.74, 1.328, 1.957, 1.957, 3.485, 3.485, 4.545];
    let torque = [80.0, 80.0, 40.0, 40.0, 9.0, 9.0, 9.0];
    let links = std::iter::once("right_arm_base_link".to_owned());
    described("sawyer", "right_arm_base_link", &joints, &limits(&lower, &upper, &speed, &[], &torque))
        .link_names(links.chain((0..7).map(|i| format!("right_l{i}"))))
        .link("right_hand", at([0.0, 0.0, 0.0245], [0, 0, 1]))
        .build()
}

/// Flexiv Rizon 4 with the tip on the flange.
///
/// - Geometry and limits: `flexivrobotics/flexiv_ros2`, commit 9d96a86 (2024-01-25),
///   `flexiv_description/urdf/rizon4_joints_links.xacro`, Apache-2.0 (package.xml of `flexiv_description`).
pub(super) fn rizon4() -> Result<Chain> {
    let joints: [Row; 7] = [
        ("joint1", at([0.0, 0.0, 0.155], [0, 0, -2]), Z),
        ("joint2", at([0.0, 0.03, 0.210], [0, 0, 0]), Y),
        ("joint3", at([0.0, 0.035, 0.205], [0, 0, 0]), Z),
        ("joint4", at([-0.02, -0.03, 0.19], [0, 0, -2]), Y),
        ("joint5", at([-0.02, 0.025, 0.195], [0, 0, -2]), Z),
        ("joint6", at([0.0, 0.03, 0.19], [0, 0, 0]), Y),
        ("joint7", at([-0.055, 0.070, 0.11], [0, -1, 0]), Z),
    ];
    let lower = [-2.7925, -2.2689, -2.9671, -1.8675, -2.9671, -1.3963, -2.9671];
    let upper = [2.7925, 2.2689, 2.9671, 2.6878, 2.9671, 4.5379, 2.9671];
    let speed = [2.0944, 2.0944, 2.4435, 2.4435, 4.8869, 4.8869, 4.8869];
    let torque = [123.0, 123.0, 64.0, 64.0, 39.0, 39.0, 39.0];
    described("rizon4", "base_link", &joints, &limits(&lower, &upper, &speed, &[], &torque))
        .link("flange", at([0.0, 0.0, 0.081], [0, 0, -2]))
        .build()
}

/// The left arm of a Unitree G1, from the torso to the palm of the rubber hand.
///
/// - Geometry and limits: `unitreerobotics/unitree_ros`, commit 5ae4fa5, `robots/g1_description/g1_dual_arm.urdf`,
///   BSD-3-Clause. Joint 1 leans by 16 degrees.
pub(super) fn unitree_g1() -> Result<Chain> {
    let joints: [Row; 7] = [
        (
            "left_shoulder_pitch_joint",
            turned([0.0039563, 0.10022, 0.23778], [0.27931, 5.4949e-05, -0.00019159]),
            Y,
        ),
        ("left_shoulder_roll_joint", turned([0.0, 0.038, -0.013831], [-0.27925, 0.0, 0.0]), X),
        ("left_shoulder_yaw_joint", at([0.0, 0.00624, -0.1032], [0, 0, 0]), Z),
        ("left_elbow_joint", at([0.015783, 0.0, -0.080518], [0, 0, 0]), Y),
        ("left_wrist_roll_joint", at([0.100, 0.00188791, -0.010], [0, 0, 0]), X),
        ("left_wrist_pitch_joint", at([0.038, 0.0, 0.0], [0, 0, 0]), Y),
        ("left_wrist_yaw_joint", at([0.046, 0.0, 0.0], [0, 0, 0]), Z),
    ];
    let lower = [-3.0892, -1.5882, -2.618, -1.0472, -1.972222054, -1.614429558, -1.614429558];
    let upper = [2.6704, 2.2515, 2.618, 2.0944, 1.972222054, 1.614429558, 1.614429558];
    let speed = [37.0, 37.0, 37.0, 37.0, 37.0, 22.0, 22.0];
    let torque = [25.0, 25.0, 25.0, 25.0, 25.0, 5.0, 5.0];
    let links = joints.map(|(name, ..)| name.replace("_joint", "_link"));
    described("unitree_g1", "torso_link", &joints, &limits(&lower, &upper, &speed, &[], &torque))
        .link_names(std::iter::once("torso_link".to_owned()).chain(links))
        .link("left_rubber_hand", at([0.0415, 0.003, 0.0], [0, 0, 0]))
        .build()
}

/// ABB IRB 2400 with the tip on `tool0`.
///
/// - Geometry and limits: `ros-industrial/abb`, commit 77db19b (2023-01-26),
///   `abb_irb2400_support/urdf/irb2400_macro.xacro`, Apache-2.0 (package.xml). Torques are not given.
pub(super) fn irb2400() -> Result<Chain> {
    let joints: [Row; 6] = [
        ("joint_1", at([0.0, 0.0, 0.0], [0, 0, 0]), Z),
        ("joint_2", at([0.1, 0.0, 0.615], [0, 0, 0]), Y),
        ("joint_3", at([0.0, 0.0, 0.705], [0, 0, 0]), Y),
        ("joint_4", at([0.258, 0.0, 0.135], [0, 0, 0]), X),
        ("joint_5", at([0.497, 0.0, 0.0], [0, 0, 0]), Y),
        ("joint_6", at([0.085, 0.0, 0.0], [0, 0, 0]), X),
    ];
    let lower = [-3.1416, -1.7453, -1.0472, -3.49, -2.0944, -6.9813];
    let upper = [3.1416, 1.9199, 1.1345, 3.49, 2.0944, 6.9813];
    let speed = [2.618, 2.618, 2.618, 6.2832, 6.2832, 7.854];
    let links = std::iter::once("base_link".to_owned());
    described("irb2400", "base_link", &joints, &limits(&lower, &upper, &speed, &[], &[]))
        .link_names(links.chain((1..=6).map(|i| format!("link_{i}"))))
        .link("tool0", at([0.0, 0.0, 0.0], [0, 1, 0]))
        .build()
}

/// KUKA KR 6 R900 sixx with the tip on `tool0`.
///
/// - Geometry and limits: `kroshu/kuka_robot_descriptions`, commit 7766e92 (2026-07-24),
///   `kuka_agilus_support/urdf/kr6_r900_sixx_macro.xacro`, Apache-2.0. Torques are not given.
pub(super) fn kr6_r900() -> Result<Chain> {
    let back = |axis: [f64; 3]| axis.map(|x| if x == 0.0 { 0.0 } else { -x });
    let joints: [Row; 6] = [
        ("joint_1", at([0.0, 0.0, 0.4], [0, 0, 0]), back(Z)),
        ("joint_2", at([0.025, 0.0, 0.0], [0, 0, 0]), Y),
        ("joint_3", at([0.455, 0.0, 0.0], [0, 0, 0]), Y),
        ("joint_4", at([0.0, 0.0, 0.035], [0, 0, 0]), back(X)),
        ("joint_5", at([0.42, 0.0, 0.0], [0, 0, 0]), Y),
        ("joint_6", at([0.08, 0.0, 0.0], [0, 0, 0]), back(X)),
    ];
    let lower = [-170.0, -190.0, -120.0, -185.0, -120.0, -350.0].map(f64::to_radians);
    let upper = [170.0, 45.0, 156.0, 185.0, 120.0, 350.0].map(f64::to_radians);
    let speed = [360.0, 300.0, 360.0, 381.0, 388.0, 615.0].map(f64::to_radians);
    let links = std::iter::once("base_link".to_owned());
    described("kr6_r900", "base_link", &joints, &limits(&lower, &upper, &speed, &[], &[]))
        .link_names(links.chain((1..=6).map(|i| format!("link_{i}"))))
        .link("tool0", at([0.0, 0.0, 0.0], [0, 1, 0]))
        .build()
}

/// A Universal Robots arm, base frame `base` (that of the controller), tip `tool0`.
///
/// - Geometry and limits: `UniversalRobots/Universal_Robots_ROS2_Description`, commit 2221ec0 (2024-10-14),
///   `config/<arm>/{default_kinematics,joint_limits}.yaml`, BSD-3-Clause. Accelerations are not limited there.
fn universal(
    name: &str,
    d: [f64; 4],
    a: [f64; 2],
    last: f64,
    speed: [f64; 6],
    torque: [f64; 6],
) -> Result<Chain> {
    let right = 0.5 * PI;
    let rows = [
        row(0.0, d[0], right),
        row(a[0], 0.0, 0.0),
        row(a[1], 0.0, 0.0),
        row(0.0, d[1], right),
        row(0.0, d[2], -right),
        row(0.0, d[3], 0.0),
    ];
    let upper = [360.0, 360.0, 180.0, 360.0, 360.0, last].map(f64::to_radians);
    let joints = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"];
    let links =
        ["base", "shoulder_link", "upper_arm_link", "forearm_link", "wrist_1_link", "wrist_2_link", "tool0"];
    ChainBuilder::from_dh(name, &rows, DhConvention::Standard)
        .joint_names(joints.map(|joint| format!("{joint}_joint")))
        .link_names(links)
        .limits(&limits(&upper.map(|limit| -limit), &upper, &speed.map(f64::to_radians), &[], &torque))
        .build()
}

/// UR3e, see `universal`; joint 6 turns on.
pub(super) fn ur3e() -> Result<Chain> {
    let speed = [180.0, 180.0, 180.0, 360.0, 360.0, 360.0];
    let torque = [54.0, 54.0, 28.0, 9.0, 9.0, 9.0];
    universal("ur3e", [0.15185, 0.13105, 0.08535, 0.0921], [-0.24355, -0.2132], FREE, speed, torque)
}

/// UR5e, see `universal`.
pub(super) fn ur5e() -> Result<Chain> {
    let torque = [150.0, 150.0, 150.0, 28.0, 28.0, 28.0];
    universal("ur5e", [0.1625, 0.1333, 0.0997, 0.0996], [-0.425, -0.3922], 360.0, [180.0; 6], torque)
}

/// UR10e, see `universal`.
pub(super) fn ur10e() -> Result<Chain> {
    let speed = [120.0, 120.0, 180.0, 180.0, 180.0, 180.0];
    let torque = [330.0, 330.0, 150.0, 54.0, 54.0, 54.0];
    universal("ur10e", [0.1807, 0.17415, 0.11985, 0.11655], [-0.6127, -0.57155], 360.0, speed, torque)
}

/// UR16e, see `universal`.
pub(super) fn ur16e() -> Result<Chain> {
    let speed = [120.0, 120.0, 180.0, 180.0, 180.0, 180.0];
    let torque = [330.0, 330.0, 150.0, 54.0, 54.0, 54.0];
    universal("ur16e", [0.1807, 0.17415, 0.11985, 0.11655], [-0.4784, -0.36], 360.0, speed, torque)
}

/// UR20, see `universal`.
pub(super) fn ur20() -> Result<Chain> {
    let speed = [120.0, 120.0, 150.0, 210.0, 210.0, 210.0];
    let torque = [738.0, 738.0, 433.0, 107.0, 107.0, 107.0];
    universal("ur20", [0.2363, 0.201, 0.1593, 0.1543], [-0.862, -0.7287], 360.0, speed, torque)
}

/// UR30, see `universal`.
pub(super) fn ur30() -> Result<Chain> {
    let speed = [120.0, 120.0, 150.0, 210.0, 210.0, 210.0];
    let torque = [738.0, 738.0, 433.0, 107.0, 107.0, 107.0];
    universal("ur30", [0.2363, 0.201, 0.1593, 0.1543], [-0.637, -0.5037], 360.0, speed, torque)
}

/// A chain from rows; the links after the joints are called `link1` and so on. A joint without limits turns on.
fn described(name: &str, base: &str, joints: &[Row], limits: &[Limits]) -> ChainBuilder {
    let mut builder = ChainBuilder::new(name, base);
    for (i, ((joint, place, axis), limits)) in joints.iter().zip(limits).enumerate() {
        let bounded = limits.lower.is_finite() || limits.upper.is_finite();
        let kind = if bounded { JointKind::Revolute } else { JointKind::Continuous };
        builder = builder
            .joint(*joint, kind, *place, Vector3::from(*axis), *limits)
            .link(format!("link{}", i + 1), Pose::identity());
    }
    builder
}

/// A place: position, and roll, pitch, yaw in quarter turns, which are exact.
fn at(xyz: [f64; 3], quarters: [i32; 3]) -> Pose {
    let turn = |quarters: i32| -> (f64, f64) {
        match quarters.rem_euclid(4) {
            0 => (0.0, 1.0),
            1 => (1.0, 0.0),
            2 => (0.0, -1.0),
            _ => (-1.0, 0.0),
        }
    };
    let [(sr, cr), (sp, cp), (sy, cy)] = quarters.map(turn);
    let roll = Matrix3::new(1.0, 0.0, 0.0, 0.0, cr, -sr, 0.0, sr, cr);
    let pitch = Matrix3::new(cp, 0.0, sp, 0.0, 1.0, 0.0, -sp, 0.0, cp);
    let yaw = Matrix3::new(cy, -sy, 0.0, sy, cy, 0.0, 0.0, 0.0, 1.0);
    pose(yaw * pitch * roll, xyz.into())
}

/// A place: position, and roll, pitch, yaw in rad.
fn turned(xyz: [f64; 3], [roll, pitch, yaw]: [f64; 3]) -> Pose {
    pose(*Rotation3::from_euler_angles(roll, pitch, yaw).matrix(), xyz.into())
}
