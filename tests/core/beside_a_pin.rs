//! Contact that a path forces must not cost the elbow its protection.

use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::Arc;

use redundancy_core::criterion::{Clearance, Criterion};
use redundancy_core::kinematics::Task;
use redundancy_core::nalgebra::{Rotation3, Translation3, Vector3};
use redundancy_core::path::{Path, Plan};
use redundancy_core::planning::{
    SwivelChoice, SwivelFlow, SwivelFlowSettings, SwivelPlanSettings, plan_swivel,
};
use redundancy_core::scene::{Capsule, Obstacle, Scene, Sphere};
use redundancy_core::solutions::SrsArm;
use redundancy_core::velocity::{Gain, Resolver, SaturatedNullspace, StepInput};
use redundancy_core::{Pose, Status, Watch};

use super::support::{pa10, rows, swivel};

/// One turn of a horizontal circle with the tool down, in six seconds.
fn circle() -> Path {
    let down = Rotation3::from_axis_angle(&Vector3::y_axis(), std::f64::consts::PI);
    let turn = |k: u32| {
        let a = TAU * f64::from(k) / 240.0;
        Pose::from_parts(Translation3::new(0.45 + 0.12 * a.cos(), 0.12 * a.sin(), 0.5), down)
    };
    let poses: Vec<Pose> = (0..=240).map(turn).collect();
    let t: Vec<f64> = (0..=240).map(|k| 0.025 * f64::from(k)).collect();
    Path::new(&poses, None, Some(&t)).unwrap()
}

fn ball() -> Obstacle {
    let shape = Sphere { center: Vector3::new(0.2842, -0.3539, 0.4817), radius: 0.06 };
    Obstacle::fixed(shape.into()).unwrap().named("ball").unwrap()
}

/// A ball, and a pin under the circle that the hand passes at `gap` whatever the swivel.
fn scene(gap: Option<f64>) -> Scene {
    let pin = gap.map(|gap| {
        let radius = 0.12f64.hypot(0.10) - 0.05 - gap;
        let (start, end) = (Vector3::new(0.45, 0.0, 0.2), Vector3::new(0.45, 0.0, 0.4));
        Obstacle::fixed(Capsule { start, end, radius }.into()).unwrap().named("pin").unwrap()
    });
    Scene::of_obstacles([ball()].into_iter().chain(pin).collect()).unwrap()
}

fn plan(arm: &SrsArm, scene: Scene) -> Plan {
    let choice = SwivelChoice::Near(vec![-FRAC_PI_2]);
    let settings =
        SwivelPlanSettings { scene: Some(scene), choice, wanted_clearance: 0.03, ..Default::default() };
    plan_swivel(arm, &circle(), &settings, &Watch::default()).unwrap()
}

fn flow(arm: &SrsArm, scene: &Scene, s0: f64) -> Plan {
    let flow = SwivelFlow::new(arm, scene, SwivelFlowSettings::default()).unwrap();
    flow.follow(&circle(), s0, 0.01, &[-FRAC_PI_2], &Watch::default()).unwrap()
}

/// Least distance of any row from the ball.
fn from_ball<'a>(arm: &SrsArm, rows: impl IntoIterator<Item = &'a [f64; 7]>) -> f64 {
    let ball = Scene::of_obstacles(vec![ball()]).unwrap();
    let near = |q: &[f64; 7]| ball.clearance(arm.chain(), q, 0.05).unwrap().unwrap().distance;
    rows.into_iter().map(near).fold(f64::INFINITY, f64::min)
}

/// Where three seconds of saturated steps at the first pose lead to from a swivel of -1.35.
fn held(arm: &SrsArm, scene: &Scene) -> [f64; 7] {
    let chain = arm.chain();
    let h: Arc<dyn Criterion> = Arc::new(Clearance::new(chain, scene, 0.05).unwrap());
    let scheme = SaturatedNullspace::new(chain, Some(h), Gain::Constant(2.0), Task::POSE, None);
    let mut scheme = scheme.unwrap();
    let pose = circle().poses()[0];
    let mut q = arm.self_motion(&pose).unwrap().branch(0).unwrap().q(-1.35).unwrap();
    let mut qd = [0.0; 7];
    for _ in 0..300 {
        let at = chain.forward(&q).unwrap();
        let linear = pose.translation.vector - at.translation.vector;
        let turn = (pose.rotation * at.rotation.inverse()).into_inner();
        let angular = 0.5
            * Vector3::new(
                turn[(2, 1)] - turn[(1, 2)],
                turn[(0, 2)] - turn[(2, 0)],
                turn[(1, 0)] - turn[(0, 1)],
            );
        let v: Vec<f64> = linear.iter().chain(angular.iter()).map(|e| 10.0 * e).collect();
        let before = qd;
        scheme
            .step(&StepInput { q: &q, velocity: &v, dt: Some(0.01), qd: Some(&before), wish: None }, &mut qd)
            .unwrap();
        q.iter_mut().zip(&qd).for_each(|(q, qd)| *q += 0.01 * qd);
    }
    q
}

#[test]
fn the_elbow_keeps_what_it_keeps_without_the_pin() {
    let arm = SrsArm::new(&pa10()).unwrap();
    for gap in [None, Some(0.015), Some(0.005), Some(0.001)] {
        let scene = scene(gap);
        let plan = plan(&arm, scene.clone());
        assert_eq!(plan.status(), Status::Converged, "{gap:?}: {}", plan.reason());
        let flow = flow(&arm, &scene, swivel(&plan)[0]);
        assert_eq!(flow.status(), Status::Converged, "{gap:?}: {}", flow.reason());
        for kept in [from_ball(&arm, rows(&plan)), from_ball(&arm, rows(&flow))] {
            assert!((kept - 0.03).abs() < 1e-3, "{gap:?}: {kept}");
        }
        if let Some(gap) = gap {
            let least = plan.clearance().unwrap().iter().copied().fold(f64::INFINITY, f64::min);
            assert!((least - gap).abs() < 1e-4, "{least} {gap}");
        }
    }
}

#[test]
fn contact_that_the_path_forces() {
    let arm = SrsArm::new(&pa10()).unwrap();
    let scene = scene(Some(-0.002));
    let blocked = plan(&arm, scene.clone());
    assert_eq!((blocked.status(), blocked.legal()), (Status::Collision, Some(false)), "{}", blocked.reason());
    assert_eq!(rows(&blocked).len(), 241);
    for part in ["link7", "'pin'", "2.000 mm"] {
        assert!(blocked.reason().contains(part), "{}", blocked.reason());
    }
    assert!((from_ball(&arm, rows(&blocked)) - 0.03).abs() < 1e-3);
    let flow = flow(&arm, &scene, swivel(&blocked)[0]);
    assert_eq!(flow.status(), Status::Collision, "{}", flow.reason());
    assert!(from_ball(&arm, rows(&flow)) > 0.02);
    // Only the contact of the hand is allowed.
    let allowed = scene.with_allowed(vec![["link7".to_owned(), "pin".to_owned()]]).unwrap();
    let free = plan(&arm, allowed);
    assert_eq!((free.status(), free.legal()), (Status::Converged, Some(true)), "{}", free.reason());
    assert!((from_ball(&arm, rows(&free)) - 0.03).abs() < 1e-3);
}

/// The hand stands beside the pin whatever the arm does: it costs a saturated step nothing. The forearm comes near the pin only
/// where the step takes it, and stays clear of it: as far from the ball as without a pin it would be 7 mm inside of that of 5 mm.
#[test]
fn a_saturated_step_beside_the_pin() {
    let arm = SrsArm::new(&pa10()).unwrap();
    let with_all = |links: &[&str], scene: &Scene| {
        let pairs = links.iter().map(|link| [(*link).to_owned(), "pin".to_owned()]).collect();
        scene.with_allowed(pairs).unwrap()
    };
    let free = from_ball(&arm, [&held(&arm, &scene(None))]);
    assert!((free - 0.0559).abs() < 1e-3, "{free}");
    for gap in [0.015, 0.005, 0.001] {
        let scene = scene(Some(gap));
        let blind = from_ball(&arm, [&held(&arm, &with_all(&["link5", "link7"], &scene))]);
        assert!((blind - free).abs() < 1e-3, "{gap}: {blind} {free}");
        let q = held(&arm, &scene);
        let kept = from_ball(&arm, [&q]);
        let without_hand = from_ball(&arm, [&held(&arm, &with_all(&["link7"], &scene))]);
        assert!((kept - without_hand).abs() < 1e-3, "{gap}: {kept} {without_hand}");
        let seen = with_all(&["link7"], &scene).clearance(arm.chain(), &q, 0.05).unwrap().unwrap();
        assert!(seen.distance > 0.0, "{gap}: {seen:?}");
    }
}
