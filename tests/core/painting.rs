//! The spray experiment: orientation rules and the fastest constant speed on the two reference paths.

use redundancy_core::chain::{Chain, catalog};
use redundancy_core::nalgebra::Vector3;
use redundancy_core::path::Path;
use redundancy_core::planning::{
    BarrierRule, OrientationPlanSettings, OrientationRule, RuleKind, RuleSpin, plan_orientation,
};
use redundancy_core::timing::{
    MaxSpeed, SpeedLimit, SpeedSettings, fastest_profile, max_speed, max_speed_of_poses,
};
use redundancy_core::{Pose, Status, Watch};

use crate::support::amount;

const PATHS: [(&str, f64); 2] = [("a", 0.0), ("b", -0.15)];

/// The arm of the experiment: the gun is 0.4 m long and stands off to the side by `offset`.
pub fn gun(offset: f64) -> Chain {
    catalog::load("puma560").unwrap().with_tool(Pose::translation(offset, 0.0, 0.4)).unwrap()
}

pub fn reference(name: &str) -> Path {
    Path::from_csv(format!("{}/../../tests/golden/spray_ref_{name}_path.csv", env!("CARGO_MANIFEST_DIR")))
        .unwrap()
}

fn run(chain: &Chain, path: &Path, rule: RuleKind) -> MaxSpeed {
    let positions: Vec<Vector3<f64>> = path.poses().iter().map(|p| p.translation.vector).collect();
    let rotations = OrientationRule::new(rule).unwrap().orientations(&positions).unwrap();
    let path = path.with_orientations(&rotations).unwrap();
    max_speed_of_poses(chain, path.s(), path.poses(), None, &SpeedSettings::of(chain)).unwrap()
}

#[test]
fn every_rule_gains_the_expected_speed() {
    let angle = 10f64.to_radians();
    let spin = RuleSpin::Pointing;
    let barrier = BarrierRule::default();
    let rules = [
        (RuleKind::Pointing, [1.0, 1.170]),
        (RuleKind::TiltSquare { angle, spin }, [1.201, 1.464]),
        (RuleKind::TiltDisc { angle, spin }, [1.134, 1.395]),
        (RuleKind::BarrierCone(barrier), [1.239, 1.275]),
        (RuleKind::BarrierTwoCones { axis: barrier, gamma: 60f64.to_radians(), k_x: 1.0 }, [1.236, 1.485]),
        (RuleKind::BarrierSpin(barrier), [1.239, 1.476]),
    ];
    for (i, (name, offset)) in PATHS.into_iter().enumerate() {
        let (chain, path) = (gun(offset), reference(name));
        let constant = run(&chain, &path, RuleKind::Constant);

        assert!((constant.speed / 0.910 - 1.0).abs() < 5e-3, "{name}: {}", constant.speed);
        for (rule, expected) in &rules {
            let ratio = run(&chain, &path, *rule).speed / constant.speed;

            assert!((ratio / expected[i] - 1.0).abs() < 5e-3, "{name} {rule:?}: {ratio}, {}", expected[i]);
        }
    }
}

#[test]
fn the_speed_is_the_one_at_which_a_torque_meets_its_limit() {
    let (chain, path) = (gun(-0.15), reference("b"));
    let fastest = run(&chain, &path, RuleKind::Pointing);
    let limits: Vec<f64> = chain.joints().iter().map(|j| j.limits.effort).collect();
    let use_ = |k: usize, j: usize| fastest.torques[k * 6 + j].abs() / limits[j];
    assert_eq!(fastest.limit, SpeedLimit::Torque);
    assert!((use_(fastest.at, fastest.limiting_joint) - 1.0).abs() < 1e-12);
    for k in 0..path.len() {
        assert!((0..6).all(|j| use_(k, j) <= 1.0 + 1e-12));
        assert!(fastest.point_speeds[k] >= fastest.speed * (1.0 - 1e-12));
    }
    // The same from the joint positions alone; a velocity limit takes over where it is tighter.
    let mut settings = SpeedSettings::of(&chain);
    assert_eq!(max_speed(&chain, path.s(), &fastest.q, &settings).unwrap(), fastest);
    settings.velocity_limits = Some(vec![0.5; 6]);
    let slow = max_speed(&chain, path.s(), &fastest.q, &settings).unwrap();
    assert!(slow.limit == SpeedLimit::Velocity && slow.speed < fastest.speed);
    settings.torque_limits = None;
    assert_eq!(max_speed(&chain, path.s(), &fastest.q, &settings).unwrap().speed, slow.speed);
}

#[test]
fn a_profile_keeps_the_limits_and_is_faster_than_any_constant_speed() {
    let (chain, path) = (gun(0.0), reference("a"));
    let constant = run(&chain, &path, RuleKind::Constant);
    let settings = SpeedSettings::of(&chain);
    let v = constant.speed;
    let profile = fastest_profile(&chain, path.s(), &constant.q, &settings, v, v).unwrap();
    let duration = *profile.t.last().unwrap();

    assert!(duration < path.length() / v);
    assert!(profile.speed.iter().all(|speed| speed.is_finite() && *speed > 0.0));
    let rest = fastest_profile(&chain, path.s(), &constant.q, &settings, 0.0, 0.0).unwrap();
    assert!(rest.speed[0] == 0.0 && *rest.t.last().unwrap() > duration);
    assert!(rest.t.windows(2).all(|t| t[1] > t[0]));
    let refused = fastest_profile(&chain, path.s(), &constant.q, &settings, 50.0, 0.0).unwrap_err();
    assert!(refused.to_string().contains("start_speed is 50"), "{refused}");
}

#[test]
fn what_is_wrong_is_named() {
    let (chain, path) = (gun(0.0), reference("a"));
    let settings = SpeedSettings::of(&chain);
    let down = path.with_orientation(&redundancy_core::planning::tool_down()).unwrap();
    let constant = max_speed_of_poses(&chain, path.s(), down.poses(), None, &settings).unwrap();
    let refuse = |settings: &SpeedSettings| {
        max_speed(&chain, path.s(), &constant.q, settings).unwrap_err().to_string()
    };
    let weak =
        SpeedSettings { torque_limits: Some(vec![97.6, 20.0, 89.4, 24.2, 20.1, 21.3]), ..settings.clone() };
    let text = refuse(&weak);
    assert!(
        text.contains("'joint2' needs") && text.contains("at point") && text.contains("limit is 20"),
        "{text}"
    );
    let none = SpeedSettings { torque_limits: None, ..settings.clone() };
    assert!(refuse(&none).contains("no torque or velocity limit"));
    let negative = SpeedSettings { torque_limits: Some(vec![-1.0; 6]), ..settings.clone() };
    assert!(refuse(&negative).contains("torque limit of joint 0 is -1"));
    let still = max_speed(&chain, &[0.0, 0.0], &[0.1; 12], &settings).unwrap_err().to_string();
    assert!(still.contains("no length"), "{still}");
    let mut far = down.poses().to_vec();
    for pose in &mut far[100..110] {
        pose.translation.x += 3.0;
    }
    let text = max_speed_of_poses(&chain, path.s(), &far, None, &settings).unwrap_err().to_string();
    assert!(text.contains("10 of 894 points are out of the workspace, indices 100 to 109"), "{text}");
    let bare = catalog::load("pa10").unwrap();
    let torque = SpeedSettings { torque_limits: Some(vec![10.0; 7]), ..SpeedSettings::of(&bare) };
    let text = max_speed(&bare, &[0.0, 1.0], &[0.0; 14], &torque).unwrap_err().to_string();
    assert!(text.contains("'pa10' has no inertias"), "{text}");
    let narrow = BarrierRule { alpha: 0.02, beta: 0.02, ..Default::default() };
    let rule = OrientationRule::new(RuleKind::BarrierCone(narrow)).unwrap();
    let positions: Vec<_> = path.poses().iter().map(|p| p.translation.vector).collect();
    assert!(rule.orientations(&positions).unwrap_err().to_string().contains("position 0: the cones"));
    assert!(OrientationRule::new(RuleKind::TiltDisc { angle: -1.0, spin: RuleSpin::Constant }).is_err());
}

#[test]
fn a_plan_is_faster_than_its_start_and_keeps_what_it_promises() {
    let (chain, path) = (gun(-0.15), reference("b"));
    let half_angle = 20f64.to_radians();
    let settings = OrientationPlanSettings {
        time_limit: amount(2, 60) as f64,
        speed: SpeedSettings { joint_limits: false, ..SpeedSettings::of(&chain) },
        ..OrientationPlanSettings::new(&chain, half_angle)
    };
    let watch = Watch::default();
    let plan = plan_orientation(&chain, &path, &settings, &watch).unwrap();
    assert!(plan.speed > plan.constant_speed.unwrap() && watch.share() == 1.0);
    let limits: Vec<f64> = chain.joints().iter().map(|j| j.limits.effort).collect();
    for (k, pose) in plan.plan.poses().unwrap().iter().enumerate() {
        let q = plan.plan.trajectory().q_row(k);
        assert!(crate::support::pose_error(&chain.forward(q).unwrap(), pose) < 1e-11);
        assert!(-pose.rotation.matrix()[(2, 2)] >= half_angle.cos() - 1e-12);
        assert!((0..6).all(|j| plan.torques[k * 6 + j].abs() <= limits[j] * (1.0 + 1e-12)));
    }
    // The same speed from the joint positions alone, by another way to the derivatives.
    let again = max_speed(&chain, plan.plan.s().unwrap(), plan.plan.q(), &settings.speed).unwrap();
    assert!((again.speed / plan.speed - 1.0).abs() < 2e-3, "{} {}", again.speed, plan.speed);
    // However short the time, the path's own orientation is tried.
    let hasty = OrientationPlanSettings { time_limit: 1e-3, ..settings.clone() };
    let plan = plan_orientation(&chain, &path, &hasty, &Watch::default()).unwrap();
    assert_eq!(plan.plan.status(), Status::TimeLimit);
    assert!(plan.speed >= 0.99 * plan.constant_speed.unwrap(), "{}", plan.plan.reason());
    watch.cancel();
    let stopped = plan_orientation(&chain, &path, &settings, &watch).unwrap();
    assert_eq!(stopped.plan.status(), Status::Cancelled);
}
