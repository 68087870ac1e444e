//! Whole paths beside obstacles: the paper's experiments, random scenes, closed paths.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use redundancy_core::chain::Limits;
use redundancy_core::nalgebra::{Rotation3, Translation3, Vector3};
use redundancy_core::path::{Path, Plan};
use redundancy_core::planning::{
    FlowForm, FlowState, SwivelChoice, SwivelFlow, SwivelFlowSettings, SwivelPlanSettings, plan_swivel,
};
use redundancy_core::scene::{Scene, Sphere};
use redundancy_core::solutions::SrsArm;
use redundancy_core::{Pose, Status, Watch};

use super::support::{pa10, pose_error, rows, swivel};

/// Three laps of six seconds around a horizontal circle, tool down, a row every hundredth of a second.
pub fn laps() -> Path {
    let down = Rotation3::from_euler_angles(0.0, PI, 0.0);
    let t: Vec<f64> = (0..=1_800).map(|k| 0.01 * f64::from(k)).collect();
    let pose = |t: &f64| {
        let a = TAU * t / 6.0;
        Pose::from_parts(Translation3::new(0.45 + 0.12 * a.cos(), 0.12 * a.sin(), 0.5), down)
    };
    let poses: Vec<Pose> = t.iter().map(pose).collect();
    Path::new(&poses, None, Some(&t)).unwrap()
}

/// golden/experiments.json: a ball near where the elbow is at t = .75 s with s = -pi/2.
pub fn ball() -> Scene {
    let arm = SrsArm::new(&pa10()).unwrap();
    let path = laps();
    let q = arm.self_motion(&path.poses()[75]).unwrap().branch(0).unwrap().q(-FRAC_PI_2).unwrap();
    let elbow = arm.chain().forward_link(&q, arm.chain().link_index("link4").unwrap()).unwrap();
    let center = elbow.translation.vector + Vector3::new(0.02, -0.03, 0.0);
    assert!((center - Vector3::new(0.2842, -0.3539, 0.4817)).amax() < 1e-4);
    Scene::new(&[Sphere { center, radius: 0.06 }.into()]).unwrap()
}

pub fn ramp(to: f64) -> Vec<f64> {
    (0..=1_800).map(|k| -PI + (to + PI) * f64::from(k) / 1_800.0).collect()
}

fn flow(form: FlowForm, lambda: f64, s0: f64, desired: &[f64]) -> Plan {
    let arm = SrsArm::new(&pa10()).unwrap();
    let settings = SwivelFlowSettings { form, lambda, ..Default::default() };
    let flow = SwivelFlow::new(&arm, &ball(), settings).unwrap();
    flow.follow(&laps(), s0, 0.01, desired, &Watch::default()).unwrap()
}

fn least(plan: &Plan) -> f64 {
    plan.clearance().unwrap().iter().copied().fold(f64::INFINITY, f64::min)
}

/// Rows at which the rate changes its sign, also where the swivel stood still in between.
fn turns(swivel: &[f64]) -> Vec<usize> {
    let mut out = Vec::new();
    let mut before = 0.0;
    for (k, w) in swivel.windows(2).enumerate() {
        let rate = w[1] - w[0];
        if rate * before < 0.0 {
            out.push(k);
        }
        before = if rate != 0.0 { rate } else { before };
    }
    out
}

/// golden/experiments.json, `seen`: to the millimetre, as the start of the lap and the integrator are not printed.
#[test]
fn the_papers_flow_does_what_was_seen() {
    let hanging = [-FRAC_PI_2];
    for form in [FlowForm::Paper, FlowForm::PaperU] {
        let near = |plan: &Plan, expected: f64, within: f64| {
            let least = least(plan);
            assert!((least - expected).abs() < within, "{form:?}: {least}, expected {expected}");
        };
        // No force: straight through. With it, from a clear start, around.
        near(&flow(form, 1.0, -FRAC_PI_2, &hanging), -0.0765, 1e-4);
        near(&flow(form, 0.5, -0.9, &hanging), 0.0408, 2e-4);
        // The ramps: without force through the ball, with it trapped before it for good.
        near(&flow(form, 1.0, -PI, &ramp(5.0 * PI)), -0.0681, 5e-3);
        near(&flow(form, 1.0, -PI, &ramp(PI)), -0.0455, 5e-3);
        let fast = flow(form, 0.5, -PI, &ramp(5.0 * PI));
        near(&fast, 0.0181, 1.5e-3);
        if form == FlowForm::Paper {
            assert!((swivel(&fast).last().unwrap() + 2.03).abs() < 0.01);
            let slow = flow(form, 0.5, -PI, &ramp(PI));
            assert!((swivel(&slow).last().unwrap() + 2.03).abs() < 0.01);
        }
    }
}

#[test]
fn the_robust_flow_keeps_its_distance() {
    for (name, s0, desired) in
        [("clear", -0.9, vec![-FRAC_PI_2]), ("fast", -PI, ramp(5.0 * PI)), ("slow", -PI, ramp(PI))]
    {
        let plan = flow(FlowForm::Robust, 0.5, s0, &desired);
        assert!(least(&plan) >= 0.02 - 1e-9, "{name}: {}", least(&plan));
        // It turns round with the path, about twice a lap; nothing chatters.
        let turns = turns(swivel(&plan));
        assert!(turns.len() < 10 && turns.windows(2).all(|w| w[1] - w[0] > 20), "{name}: {turns:?}");
        let fastest = swivel(&plan).windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
        assert!(fastest <= 0.03 + 1e-12, "{name}: {fastest}");
    }
    // From inside: it says how deep, and leaves.
    let plan = flow(FlowForm::Robust, 0.5, -FRAC_PI_2, &[-FRAC_PI_2]);
    assert!(plan.reason().contains("starts 62.46"), "{}", plan.reason());
    assert!(plan.clearance().unwrap()[60..].iter().all(|d| *d >= 0.02 - 1e-9));
}

/// Steps with the joints and the rate before are the rows of `follow`.
#[test]
fn steps_with_what_was_before_do_what_follow_does() {
    let arm = SrsArm::new(&pa10()).unwrap();
    let flow = SwivelFlow::new(&arm, &ball(), SwivelFlowSettings::default()).unwrap();
    let (path, wish) = (laps(), ramp(PI));
    let plan = flow.follow(&path, -PI, 0.01, &wish, &Watch::default()).unwrap();
    let (mut s, mut state) = (-PI, FlowState { q: Some(rows(&plan)[0]), rate: None });
    let mut fastest = [0.0_f64; 2];
    for k in 1..=300 {
        let (t, pose) = (0.01 * k as f64, &path.poses()[k]);
        let step = flow.step(pose, s, wish[k], 0.01, t, &state).unwrap();
        assert!((step.swivel - swivel(&plan)[k]).abs() < 1e-6, "{k}: {} {}", step.swivel, swivel(&plan)[k]);
        // Blind to the joints before it may turn them faster.
        let blind = flow.step(pose, s, wish[k], 0.01, t, &FlowState { q: None, ..state }).unwrap();
        for (most, q) in fastest.iter_mut().zip([&step.q, &blind.q]) {
            let turned = |i: usize| {
                let step = q[i] - state.q.unwrap()[i];
                (step - TAU * (step / TAU).round()).abs() / 0.01 / arm.chain().joints()[i].limits.velocity
            };
            *most = most.max((0..7).map(turned).fold(0.0, f64::max));
        }
        state = FlowState { q: Some(step.q), rate: Some(step.rate) };
        s = step.swivel;
    }
    assert!(fastest[0] < fastest[1], "{fastest:?}");
}

#[test]
fn the_plan_solves_all_three() {
    let arm = SrsArm::new(&pa10()).unwrap();
    for desired in [vec![-FRAC_PI_2], ramp(5.0 * PI), ramp(PI)] {
        let settings = SwivelPlanSettings {
            scene: Some(ball()),
            choice: SwivelChoice::Near(desired),
            branch: Some(0),
            ..Default::default()
        };
        let plan = plan_swivel(&arm, &laps(), &settings, &Watch::default()).unwrap();
        assert_eq!(plan.status(), Status::Converged, "{}", plan.reason());
        assert!(least(&plan) >= 0.029, "{}", least(&plan));
        for (q, pose) in rows(&plan).iter().zip(laps().poses()).step_by(20) {
            assert!(arm.chain().within_limits(q, 0.0));
            assert!(pose_error(&arm.chain().forward(q).unwrap(), pose) < 1e-12);
        }
    }
}

#[test]
fn the_slow_ramp_is_followed_through_where_the_joints_allow_it() {
    // Within its limits no branch of the arm reaches swivels around 0 anywhere on the lap: the ramp leads through there.
    let limited = SrsArm::new(&pa10()).unwrap();
    let path = laps();
    for pose in path.poses().iter().take(601).step_by(5) {
        let motion = limited.self_motion(pose).unwrap();
        for branch in motion.branches() {
            for [lower, upper] in branch.intervals(0.0).unwrap() {
                let zero = lower + (-lower).rem_euclid(TAU);
                assert!(zero - 0.9 > upper && zero - TAU + 0.9 < lower, "{lower} {upper}");
            }
        }
    }
    // Without limits the ball is in the way: the elbow passes it with at most 5.1 mm, at any time of the lap.
    let chain = pa10();
    let open: Vec<Limits> = chain
        .joints()
        .iter()
        .map(|j| Limits { lower: f64::NEG_INFINITY, upper: f64::INFINITY, ..j.limits })
        .collect();
    let arm = SrsArm::new(&chain.with_limits(&open).unwrap()).unwrap();
    let passing = |pose: &Pose| {
        let motion = arm.self_motion(pose).unwrap();
        let branch = motion.branch(0).unwrap();
        let at = |i: i32| {
            let q = branch.q(-FRAC_PI_2 + 0.01 * f64::from(i)).unwrap();
            ball().clearance(arm.chain(), &q, 0.05).unwrap().unwrap().distance
        };
        (-120..120).map(at).fold(f64::INFINITY, f64::min)
    };
    let widest = path.poses().iter().take(600).step_by(20).map(passing).fold(0.0, f64::max);
    assert!(widest < 0.006, "{widest}");
    // So the ramp is followed from the far side of the ball on, to its end.
    for (name, arm) in [("limited", &limited), ("open", &arm)] {
        let wish = ramp(PI);
        let choice = SwivelChoice::Near(wish.clone());
        let settings = SwivelPlanSettings { scene: Some(ball()), choice, ..Default::default() };
        let plan = plan_swivel(arm, &path, &settings, &Watch::default()).unwrap();
        assert_eq!(plan.status(), Status::Converged, "{}", plan.reason());
        assert!(least(&plan) >= 0.029, "{}", least(&plan));
        let error: Vec<f64> =
            swivel(&plan).iter().zip(&wish).map(|(s, w)| ((s - w + PI).rem_euclid(TAU) - PI).abs()).collect();
        let mean = error.iter().sum::<f64>() / error.len() as f64;
        assert!(error[1_800] < 0.2 && mean < 0.55, "{name}: {mean} {:?}", error.last());
    }
}
