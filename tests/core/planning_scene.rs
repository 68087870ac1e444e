//! Whole paths beside obstacles: the paper's experiments, random scenes, closed paths.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use redundancy_core::nalgebra::{Rotation3, Translation3, Vector3};
use redundancy_core::path::Path;
use redundancy_core::planning::{
    FlowForm, SwivelChoice, SwivelFlow, SwivelFlowSettings, SwivelPlan, SwivelPlanSettings, plan_swivel,
};
use redundancy_core::scene::{Scene, Sphere};
use redundancy_core::self_motion::SrsArm;
use redundancy_core::{Pose, Status};

use super::support::{pa10, pose_error};

/// Three laps of six seconds around a horizontal circle, tool down, a row every hundredth of a second.
fn laps() -> Path {
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
fn ball() -> Scene {
    let arm = SrsArm::new(&pa10()).unwrap();
    let path = laps();
    let q = arm.self_motion(&path.poses()[75]).unwrap().branch(0).unwrap().q(-FRAC_PI_2).unwrap();
    let elbow = arm.chain().forward_link(&q, arm.chain().link_index("link4").unwrap()).unwrap();
    let center = elbow.translation.vector + Vector3::new(0.02, -0.03, 0.0);
    assert!((center - Vector3::new(0.2842, -0.3539, 0.4817)).amax() < 1e-4);
    Scene::new(&[Sphere { center, radius: 0.06 }.into()]).unwrap()
}

fn ramp(to: f64) -> Vec<f64> {
    (0..=1_800).map(|k| -PI + (to + PI) * f64::from(k) / 1_800.0).collect()
}

fn flow(form: FlowForm, lambda: f64, s0: f64, desired: &[f64]) -> SwivelPlan {
    let arm = SrsArm::new(&pa10()).unwrap();
    let settings = SwivelFlowSettings { form, lambda, ..Default::default() };
    let flow = SwivelFlow::new(&arm, &ball(), settings).unwrap();
    flow.follow(&laps(), s0, 0.01, desired, &mut |_| true).unwrap().0
}

fn least(plan: &SwivelPlan) -> f64 {
    plan.clearance.iter().copied().fold(f64::INFINITY, f64::min)
}

#[test]
fn the_papers_flow_does_what_was_seen() {
    for form in [FlowForm::Paper, FlowForm::PaperU] {
        // No force: through the ball.
        let free = flow(form, 1.0, -FRAC_PI_2, &[-FRAC_PI_2]);
        eprintln!("{form:?} no force {}", least(&free));
        let clear = flow(form, 0.5, -0.9, &[-FRAC_PI_2]);
        eprintln!("{form:?} clear {}", least(&clear));
        let fast = flow(form, 0.5, -PI, &ramp(5.0 * PI));
        eprintln!("{form:?} fast {} at {}", least(&fast), fast.swivel.last().unwrap());
        eprintln!("{form:?} fast no {} ", least(&flow(form, 1.0, -PI, &ramp(5.0 * PI))));
        eprintln!("{form:?} slow no {} ", least(&flow(form, 1.0, -PI, &ramp(PI))));
        let slow = flow(form, 0.5, -PI, &ramp(PI));
        eprintln!("{form:?} slow {} {}", least(&slow), slow.swivel.last().unwrap());
    }
    for (name, s0, desired) in [
        ("clear", -0.9, vec![-FRAC_PI_2]),
        ("inside", -FRAC_PI_2, vec![-FRAC_PI_2]),
        ("fast", -PI, ramp(5.0 * PI)),
        ("slow", -PI, ramp(PI)),
    ] {
        let r = flow(FlowForm::Robust, 0.5, s0, &desired);
        let flips = r.swivel.windows(3).filter(|w| (w[2] - w[1]) * (w[1] - w[0]) < 0.0).count();
        eprintln!("robust {name} {} end {} flips {flips} {}", least(&r), r.swivel.last().unwrap(), r.reason);
        let arm = SrsArm::new(&pa10()).unwrap();
        let settings = SwivelPlanSettings {
            scene: Some(ball()),
            choice: SwivelChoice::Near(desired.clone()),
            ..Default::default()
        };
        let now = std::time::Instant::now();
        let plan = plan_swivel(&arm, &laps(), &settings, &mut |_| true).unwrap();
        eprintln!(
            "plan {name} {} end {} {} {:?}",
            least(&plan),
            plan.swivel.last().unwrap(),
            plan.reason,
            now.elapsed()
        );
    }
    let _ = (pose_error, Status::Converged);
}
