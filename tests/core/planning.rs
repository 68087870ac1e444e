//! Whole paths.

use std::f64::consts::{PI, TAU};

use redundancy_core::chain::{Chain, Limits, catalog};
use redundancy_core::nalgebra::{Matrix3, Rotation3, Translation3};
use redundancy_core::path::{Path, Plan};
use redundancy_core::planning::{SwivelChoice, SwivelPlanSettings, plan_swivel};
use redundancy_core::solutions::{SrsArm, Swivel};
use redundancy_core::{Pose, Status, Watch};

use crate::support::{pa10, pose_error, rows, swivel};

fn run(arm: &SrsArm, poses: &[Pose], settings: &SwivelPlanSettings) -> Plan {
    let path = Path::new(poses, None, None).unwrap();
    plan_swivel(arm, &path, settings, &Watch::default()).unwrap()
}

fn tool_down(x: f64, y: f64, z: f64) -> Pose {
    let r = Rotation3::from_matrix_unchecked(Matrix3::new(1., 0., 0., 0., -1., 0., 0., 0., -1.));
    Pose::from_parts(Translation3::new(x, y, z), r)
}

/// GO_BEYOND's raster: 10 strokes along y in +-.3, x from .5 to .68, z = .3, tool down, equal arc length.
pub fn iiwa_raster(n: usize) -> Vec<Pose> {
    let corners: Vec<[f64; 2]> = (0..10)
        .flat_map(|i| {
            let x = 0.5 + 0.02 * f64::from(i);
            let y = if i % 2 == 0 { -0.3 } else { 0.3 };
            [[x, y], [x, -y]]
        })
        .collect();
    let lengths: Vec<f64> =
        corners.windows(2).map(|w| (w[1][0] - w[0][0]).hypot(w[1][1] - w[0][1])).collect();
    let total: f64 = lengths.iter().sum();
    (0..n)
        .map(|k| {
            let mut left = total * k as f64 / (n - 1) as f64;
            let mut i = 0;
            while i + 1 < lengths.len() && left > lengths[i] {
                left -= lengths[i];
                i += 1;
            }
            let f = (left / lengths[i]).min(1.0);
            let [a, b] = [corners[i], corners[i + 1]];
            tool_down(a[0] + f * (b[0] - a[0]), a[1] + f * (b[1] - a[1]), 0.3)
        })
        .collect()
}

fn circle(n: usize, centre: [f64; 3], radius: f64) -> Vec<Pose> {
    (0..n)
        .map(|k| {
            let a = TAU * k as f64 / (n - 1) as f64;
            tool_down(centre[0] + radius * a.cos(), centre[1] + radius * a.sin(), centre[2])
        })
        .collect()
}

/// Least distance from a limit as a share of half the range, total joint path, largest joint step.
fn figures(chain: &Chain, q: &[[f64; 7]]) -> (f64, f64, f64) {
    let margin = q.iter().flat_map(|q| {
        (0..7).map(move |i| {
            let (lo, hi) = (chain.lower()[i], chain.upper()[i]);
            1.0 - ((q[i] - 0.5 * (lo + hi)) / (0.5 * (hi - lo))).abs()
        })
    });
    let steps: Vec<[f64; 7]> =
        q.windows(2).map(|w| std::array::from_fn(|i| (w[1][i] - w[0][i]).abs())).collect();
    let norm = steps.iter().map(|s| s.iter().map(|x| x * x).sum::<f64>().sqrt()).sum();
    (margin.fold(f64::INFINITY, f64::min), norm, steps.iter().flatten().copied().fold(0.0, f64::max))
}

#[test]
fn raster_of_the_iiwa_is_legal_and_smooth() {
    let chain = catalog::load("iiwa14").unwrap();
    let arm = SrsArm::new(&chain).unwrap();
    let poses = iiwa_raster(1_000);
    let plan = run(&arm, &poses, &SwivelPlanSettings::default());
    assert_eq!(plan.status(), Status::Converged, "{}", plan.reason());
    for (q, pose) in rows(&plan).iter().zip(&poses) {
        assert!(chain.within_limits(q, 0.0));
        assert!(pose_error(&chain.forward(q).unwrap(), pose) < 1e-12);
    }
    let (margin, length, step) = figures(&chain, rows(&plan));
    // GO_BEYOND.md: a dynamic program in numpy over the same grid has .127 and 16.4 rad.
    // At 0.2 m/s. The elbow's joint follows from the pose alone: where it is fastest, at a corner of the path, no swivel
    // changes that (1.052 rad/s); the others stay below.
    let dt = (10.0 * 0.6 + 9.0 * 0.02) / 999.0 / 0.2;
    let elbow = rows(&plan).windows(2).map(|w| (w[1][3] - w[0][3]).abs()).fold(0.0, f64::max);
    assert!(margin > 0.127 && length < 16.45 && step <= elbow.max(1.04 * dt));
    assert!(elbow / dt < 1.053, "{}", elbow / dt);
    // No staircase: away from the corners of the path the swivel runs without kinks, far below a grid cell.
    let p: Vec<_> = poses.iter().map(|p| p.translation.vector).collect();
    let turns = |k: usize| (p[k + 1] - p[k]).normalize().dot(&(p[k] - p[k - 1]).normalize()) < 0.999;
    let far = |k: &usize| (*k).max(4) == *k && *k + 4 < p.len() && !(k - 3..k + 4).any(turns);
    let kink = |k: usize| (swivel(&plan)[k + 1] - 2.0 * swivel(&plan)[k] + swivel(&plan)[k - 1]).abs();
    let kinks = (4..p.len() - 4).filter(far).map(kink).fold(0.0, f64::max);
    assert!(kinks < 0.1 * TAU / 180.0, "{kinks}");
}

#[test]
fn pa10_follows_a_circle_with_windings() {
    let chain = pa10();
    let arm = SrsArm::new(&chain).unwrap();
    let poses = circle(300, [0.45, 0.0, 0.5], 0.12);
    let plan = run(&arm, &poses, &SwivelPlanSettings::default());
    assert_eq!(plan.status(), Status::Converged, "{}", plan.reason());
    let (margin, length, step) = figures(&chain, rows(&plan));
    // No plan can keep further away than the best configuration over its worst pose.
    let best = |pose: &Pose| {
        let rows =
            (0..720).flat_map(|i| arm.solve(pose, Swivel::Angle(TAU * f64::from(i) / 720.0), true).unwrap());
        rows.map(|q| figures(&chain, &[q]).0).fold(0.0, f64::max)
    };
    let bound = poses.iter().step_by(20).map(best).fold(1.0, f64::min);
    assert!(
        margin > 0.8 * bound && margin > 0.05 && length < 4.0 && step < 0.02,
        "{margin} {bound} {length} {step}"
    );
    for ((q, pose), s) in rows(&plan).iter().zip(&poses).zip(swivel(&plan)) {
        assert!(pose_error(&chain.forward(q).unwrap(), pose) < 1e-12);
        assert!(((arm.swivel(q).unwrap() - s + PI).rem_euclid(TAU) - PI).abs() < 1e-9);
    }
}

#[test]
fn a_fixed_swivel_is_kept_and_says_where_it_ends() {
    let chain = pa10();
    let arm = SrsArm::new(&chain).unwrap();
    let poses = circle(200, [0.45, 0.0, 0.5], 0.12);
    let fixed = |s: f64| SwivelPlanSettings { choice: SwivelChoice::Fixed(vec![s]), ..Default::default() };
    let plan = run(&arm, &poses, &fixed(-PI / 2.0));
    assert_eq!(plan.status(), Status::Converged, "{}", plan.reason());
    assert!(swivel(&plan).iter().all(|s| (s + PI / 2.0).abs() < 1e-12));
    // Find a swivel that some pose forbids for every branch.
    let narrow: Vec<Limits> = chain
        .joints()
        .iter()
        .map(|j| Limits { lower: j.limits.lower * 0.5, upper: j.limits.upper * 0.5, ..j.limits })
        .collect();
    let tight = SrsArm::new(&chain.with_limits(&narrow).unwrap()).unwrap();
    let plan = run(&tight, &poses, &fixed(PI));
    assert_ne!(plan.status(), Status::Converged);
    assert!(plan.reason().contains("point") && plan.reason().contains("joint"), "{}", plan.reason());
}

#[test]
fn unreachable_points_are_counted_and_named() {
    let arm = SrsArm::new(&pa10()).unwrap();
    let mut poses = circle(50, [0.45, 0.0, 0.5], 0.12);
    for k in [17, 31] {
        poses[k] = tool_down(2.0, 0.0, 0.5);
    }
    let plan = run(&arm, &poses, &SwivelPlanSettings::default());
    assert_eq!(plan.status(), Status::Unreachable);
    assert_eq!(plan.blocked().iter().map(|point| point.row).collect::<Vec<_>>(), [17, 31]);
    assert!(plan.proven() && plan.legal() == Some(false));
    assert!(
        plan.reason().starts_with("2 of 50 points have no configuration; the first is point 17: the wrist")
    );
    assert!(rows(&plan).is_empty());
}

#[test]
fn a_path_that_cannot_be_continuous_takes_the_fewest_reconfigurations() {
    // Joint 1 of the iiwa covers 340 degrees: a full circle around the base cannot be closed without one jump.
    let chain = catalog::load("iiwa14").unwrap();
    let arm = SrsArm::new(&chain).unwrap();
    let poses: Vec<Pose> = (0..400)
        .map(|k| {
            let a = -PI + 1.3 * TAU * k as f64 / 399.0;
            Pose::from_parts(Translation3::identity(), Rotation3::from_euler_angles(0.0, 0.0, a))
                * tool_down(0.6, 0.0, 0.4)
        })
        .collect();
    let plan = run(&arm, &poses, &SwivelPlanSettings::default());
    assert_eq!(plan.status(), Status::Infeasible);
    assert_eq!(plan.reconfigurations().len(), 1, "{}", plan.reason());
    assert!(
        plan.reason().contains("it needs one reconfiguration, the first before point"),
        "{}",
        plan.reason()
    );
    assert_eq!(rows(&plan).len(), poses.len());
}

#[test]
fn settings_and_paths_are_checked() {
    let arm = SrsArm::new(&pa10()).unwrap();
    let poses = circle(10, [0.45, 0.0, 0.5], 0.12);
    let path = Path::new(&poses, None, None).unwrap();
    let refused = |settings: SwivelPlanSettings| {
        plan_swivel(&arm, &path, &settings, &Watch::default()).unwrap_err().to_string()
    };
    let default = SwivelPlanSettings::default;
    assert!(refused(SwivelPlanSettings { swivels: 3, ..default() }).contains("between 8 and 7200"));
    assert!(refused(SwivelPlanSettings { margin: -1.0, ..default() }).contains("margin is -1"));
    let near = SwivelChoice::Near(vec![0.0; 3]);
    assert!(refused(SwivelPlanSettings { choice: near, ..default() }).contains("expected 10 entries, got 3"));
    let positions: Vec<_> = poses.iter().map(|p| p.translation.vector).collect();
    let bare = Path::from_positions(&positions, None, None).unwrap();
    let error = plan_swivel(&arm, &bare, &default(), &Watch::default()).unwrap_err();
    assert!(error.to_string().contains("positions only"));
    let stopped = plan_swivel(&arm, &path, &default(), &Watch::default().with_observer(|_| false)).unwrap();
    assert_eq!((stopped.status(), stopped.rows()), (Status::Cancelled, 0));
    let late = Watch::default().with_time_limit(0.0).unwrap();
    assert_eq!(plan_swivel(&arm, &path, &default(), &late).unwrap().status(), Status::TimeLimit);
}

#[test]
fn velocity_limits_hold_when_the_path_has_times() {
    let chain = catalog::load("iiwa14").unwrap();
    let arm = SrsArm::new(&chain).unwrap();
    let poses = iiwa_raster(1_000);
    let limits: Vec<f64> = chain.joints().iter().map(|j| j.limits.velocity).collect();
    let settings = SwivelPlanSettings { velocity_limits: Some(limits.clone()), ..Default::default() };
    for (duration, expected) in [(30.0, Status::Converged), (0.5, Status::Infeasible)] {
        let t: Vec<f64> = (0..1_000).map(|k| duration * f64::from(k) / 999.0).collect();
        let path = Path::new(&poses, None, Some(&t)).unwrap();
        let plan = plan_swivel(&arm, &path, &settings, &Watch::default()).unwrap();
        assert_eq!(plan.status(), expected, "{}", plan.reason());
        if expected == Status::Converged {
            assert_eq!(plan.trajectory().t(), &t[..]);
            for pair in rows(&plan).windows(2) {
                let speeds = (0..7).map(|i| (pair[1][i] - pair[0][i]).abs() / (duration / 999.0) / limits[i]);
                assert!(speeds.fold(0.0, f64::max) <= 1.0 + 1e-9);
            }
        } else {
            assert!(plan.reason().contains("would have to step"), "{}", plan.reason());
        }
    }
}
