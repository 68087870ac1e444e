//! Instruction counts of the kernels that matter: the work of `make counts`, see `benches/counts.py`.
//!
//! `counts list` prints the kernels with the number of calls in one round; `counts KERNEL` runs one round to fill caches
//! and lazy tables, and one more inside [`counted`], the function at which callgrind collects. Without a kernel every
//! one runs once, uncounted: that is the test. Inputs are seeded; everything runs on one thread.
#![allow(clippy::expect_used, clippy::print_stdout, clippy::print_stderr)] // a bench may stop and print

use std::f64::consts::PI;
use std::hint::black_box;
use std::sync::Arc;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use redundancy_core::chain::{Chain, catalog};
use redundancy_core::criterion::{Clearance, Criterion, JointRange, Manipulability};
use redundancy_core::ik::{IkResult, IkSettings, IkSolver};
use redundancy_core::kinematics::{DynamicsScratch, Scratch, Task, TorqueDerivatives};
use redundancy_core::nalgebra::{Rotation3, UnitQuaternion, Vector3};
use redundancy_core::optimum::{Classifier, FollowSettings, follow_optimum};
use redundancy_core::parallel::Pool;
use redundancy_core::path::{Circle, Path, Raster};
use redundancy_core::planning::{
    BarrierRule, FlowState, OrientationRule, RuleKind, SwivelFlow, SwivelFlowSettings, SwivelPlanSettings,
    plan_swivel,
};
use redundancy_core::rotation::{
    Barrier, Cone, OrientationMethod, OrientationOptimizer, OrientationSettings,
};
use redundancy_core::scene::{Capsule, Cuboid, Scene, Sphere};
use redundancy_core::solutions::{SphericalWristArm, SrsArm, TraceSettings, trace_self_motion};
use redundancy_core::timing::{SpeedSettings, max_speed, max_speed_of_poses};
use redundancy_core::velocity::{
    Damping, Gain, ProjectedGradient, ReducedGradient, Resolver, SaturatedNullspace, StepInput, sigma_min,
};
use redundancy_core::{Pose, Watch};

/// Calls in one round of a kernel, and the round.
type Kernel = (usize, Box<dyn FnMut() + Send>);

/// Every kernel with the function that prepares it; ids are `room/function/robot`.
const KERNELS: [(&str, fn() -> Kernel); 27] = [
    ("kinematics/forward/iiwa14", || forward(false)),
    ("kinematics/kinematics/iiwa14", || forward(true)),
    ("kinematics/inverse_dynamics/iiwa14", || dynamics(false)),
    ("kinematics/inverse_dynamics_derivatives/iiwa14", || dynamics(true)),
    ("rotation/optimizer_closed_form/two_cones", || optimizer(OrientationMethod::ClosedForm)),
    ("rotation/optimizer_newton/two_cones", || optimizer(OrientationMethod::Newton)),
    ("path/new/spline_1000", path_spline),
    ("path/at/spline", path_at),
    ("criterion/clearance/iiwa14", clearance),
    ("solutions/solve/iiwa14", || srs_solve(false)),
    ("solutions/solve_with_limits/iiwa14", || srs_solve(true)),
    ("solutions/intervals/iiwa14", intervals),
    ("solutions/best/iiwa14", best),
    ("solutions/nearest/iiwa14", nearest),
    ("solutions/spherical_wrist/puma560", spherical_wrist),
    ("solutions/trace_self_motion/panda", trace),
    ("ik/solve/iiwa14", || ik("iiwa14", true)),
    ("ik/solve_numeric/iiwa14", || ik("iiwa14", false)),
    ("ik/solve_numeric/panda", || ik("panda", false)),
    ("velocity/projected_gradient/iiwa14", || velocity(0)),
    ("velocity/reduced_gradient/iiwa14", || velocity(1)),
    ("velocity/saturated_nullspace/iiwa14", || velocity(2)),
    ("optimum/classify/iiwa14", classify),
    ("optimum/follow_optimum/planar3r", follow),
    ("timing/max_speed/puma560", speed),
    ("planning/flow_step/iiwa14", flow),
    ("planning/plan_swivel_200/iiwa14", plan),
];

/// Where callgrind collects (`--toggle-collect`).
#[inline(never)]
fn counted(round: &mut dyn FnMut()) {
    round();
}

/// Callgrind toggles per thread: the thread that enters [`counted`] does all of the work.
fn on_one_thread(work: &mut (dyn FnMut() + Send)) {
    Pool::new(Some(1)).expect("a pool of one thread").install(work);
}

/// Configurations uniform within the limits.
fn configurations(chain: &Chain, count: usize, seed: u64) -> Vec<Vec<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut one = || {
        let limits = chain.lower().iter().zip(chain.upper());
        limits.map(|(lo, hi)| rng.random_range(lo.max(-3.1)..hi.min(3.1))).collect()
    };
    (0..count).map(|_| one()).collect()
}

fn poses(chain: &Chain, count: usize) -> Vec<Pose> {
    configurations(chain, count, 7).iter().map(|q| chain.forward(q).expect("valid q")).collect()
}

fn load(name: &str) -> Chain {
    catalog::load(name).expect("in the catalogue")
}

fn srs() -> SrsArm {
    SrsArm::new(&load("iiwa14")).expect("S-R-S")
}

fn forward(jacobian: bool) -> Kernel {
    let chain = load("iiwa14");
    let q = configurations(&chain, 1_000, 0);
    let mut scratch = Scratch::new(&chain);
    let round = move || {
        for q in &q {
            if jacobian {
                black_box(chain.kinematics(black_box(q), &mut scratch).is_ok());
            } else {
                black_box(chain.forward(black_box(q)).is_ok());
            }
        }
    };
    (1_000, Box::new(round))
}

fn dynamics(derivatives: bool) -> Kernel {
    let chain = load("iiwa14");
    let q = configurations(&chain, 300, 1);
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    let (mut scratch, mut tau) = (DynamicsScratch::new(&chain), vec![0.0; 7]);
    let mut out = TorqueDerivatives::new(7);
    let round = move || {
        for rows in q.chunks_exact(3) {
            let (q, qd, qdd) = (black_box(&rows[0]), &rows[1], &rows[2]);
            let done = if derivatives {
                chain.inverse_dynamics_derivatives(q, qd, qdd, &gravity, &mut scratch, &mut out)
            } else {
                chain.inverse_dynamics(q, qd, qdd, &gravity, &mut scratch, &mut tau)
            };
            done.expect("valid input");
        }
    };
    (100, Box::new(round))
}

fn optimizer(method: OrientationMethod) -> Kernel {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let settings = OrientationSettings { method, ..OrientationSettings::default() };
    let mut one = || {
        let (beta, alpha) = (rng.random_range(0.1f64..0.7), rng.random_range(0.4f64..1.3));
        let tilt: f64 = rng.random_range(0.0..0.9) * (alpha + beta);
        let azimuth: f64 = rng.random_range(-3.0..3.0);
        let center = [tilt.sin() * azimuth.cos(), tilt.sin() * azimuth.sin(), -tilt.cos()];
        let mut weight = || 10_f64.powf(rng.random_range(-1.0..1.0));
        let down = Barrier::new(weight(), Cone::downward(beta).expect("cone")).expect("barrier");
        let other = Barrier::new(weight(), Cone::z(center, alpha).expect("cone")).expect("barrier");
        OrientationOptimizer::new(vec![down, other], settings).expect("settings")
    };
    let list: Vec<_> = (0..64).map(|_| one()).collect();
    let start = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), PI);
    let round = move || {
        for optimizer in &list {
            black_box(optimizer.solve(Some(black_box(&start))));
        }
    };
    (64, Box::new(round))
}

/// A thousand poses on a circle with the tool down, without the analytic shape.
fn circle_poses() -> Vec<Pose> {
    let down = Rotation3::new(Vector3::y() * PI);
    let circle = Circle::new(Vector3::new(0.45, 0.0, 0.5), 0.12, 0.0, 1.0, Vector3::z()).expect("circle");
    let path = circle.path(1_000).and_then(|path| path.with_orientation(&down)).expect("path");
    path.poses().to_vec()
}

fn path_spline() -> Kernel {
    let poses = circle_poses();
    let round = move || {
        black_box(Path::new(black_box(&poses), None, None).expect("path").len());
    };
    (1, Box::new(round))
}

fn path_at() -> Kernel {
    let path = Path::new(&circle_poses(), None, None).expect("path");
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let at: Vec<f64> = (0..1_000).map(|_| rng.random_range(0.0..path.length())).collect();
    let round = move || {
        for s in &at {
            black_box(path.at(black_box(*s)).expect("on the path"));
        }
    };
    (1_000, Box::new(round))
}

/// Two balls, two posts and a table around the forearm of the raster.
fn primitives() -> Scene {
    let ball = |x, y, z, radius| Sphere { center: Vector3::new(x, y, z), radius };
    let post = |x, y| Capsule { start: Vector3::new(x, y, 0.0), end: Vector3::new(x, y, 0.9), radius: 0.04 };
    let table =
        Cuboid { pose: Pose::translation(0.6, 0.0, -0.05), half_extents: Vector3::new(0.3, 0.5, 0.05) };
    let (low, high) = (ball(0.25, 0.45, 0.6, 0.08), ball(0.3, -0.1, 0.95, 0.08));
    let obstacles = [low.into(), high.into(), post(0.35, -0.5).into(), post(0.2, 0.6).into(), table.into()];
    Scene::new(&obstacles).expect("scene")
}

fn clearance() -> Kernel {
    let chain = load("iiwa14");
    let q = configurations(&chain, 200, 3);
    let h = Clearance::new(&chain, &primitives(), 0.05).expect("radius");
    let mut gradient = [0.0; 7];
    let round = move || {
        for q in &q {
            black_box(h.value(black_box(q)));
            h.gradient(black_box(q), &mut gradient);
            black_box(gradient);
        }
    };
    (200, Box::new(round))
}

fn srs_solve(limits: bool) -> Kernel {
    let arm = srs();
    let poses = poses(arm.chain(), 512);
    let mut out = [[0.0; 7]; 8];
    let round = move || {
        for pose in &poses {
            black_box(arm.solve_into(black_box(pose), black_box([0.6, 0.8]), limits, &mut out));
            black_box(&out);
        }
    };
    (512, Box::new(round))
}

fn intervals() -> Kernel {
    let arm = srs();
    let poses = poses(arm.chain(), 64);
    let round = move || {
        for pose in &poses {
            let motion = arm.self_motion(black_box(pose)).expect("valid pose");
            for branch in motion.branches() {
                black_box(branch.intervals(0.0).expect("margin"));
            }
        }
    };
    (64, Box::new(round))
}

fn best() -> Kernel {
    let arm = srs();
    let poses = poses(arm.chain(), 64);
    let range = JointRange::new(arm.chain());
    let round = move || {
        for pose in &poses {
            let motion = arm.self_motion(black_box(pose)).expect("valid pose");
            black_box(motion.best(&range).expect("same arm"));
        }
    };
    (64, Box::new(round))
}

fn nearest() -> Kernel {
    let arm = srs();
    let poses = poses(arm.chain(), 64);
    let wish = [0.1, 0.4, 0.2, 1.0, -0.3, 0.8, 0.5];
    let round = move || {
        for pose in &poses {
            let motion = arm.self_motion(black_box(pose)).expect("valid pose");
            black_box(motion.nearest(black_box(&wish)).expect("valid q"));
        }
    };
    (64, Box::new(round))
}

fn spherical_wrist() -> Kernel {
    let chain = load("puma560");
    let arm = SphericalWristArm::new(&chain).expect("spherical wrist");
    let poses = poses(&chain, 512);
    let mut out = [[0.0; 6]; 8];
    let round = move || {
        for pose in &poses {
            black_box(arm.solve_into(black_box(pose), true, &mut out));
            black_box(&out);
        }
    };
    (512, Box::new(round))
}

fn trace() -> Kernel {
    let chain = load("panda");
    let settings = TraceSettings { step: 0.01, ..TraceSettings::default() };
    let q = [0.3, 0.7, -0.4, -1.4, 0.2, 0.9, 0.5];
    let round = move || {
        black_box(trace_self_motion(&chain, black_box(&q), Task::POSE, &settings).expect("valid q"));
    };
    (1, Box::new(round))
}

fn ik(name: &str, closed_form: bool) -> Kernel {
    let chain = load(name);
    let settings = IkSettings { closed_form, ..IkSettings::default() };
    let solver = IkSolver::new(&chain, settings).expect("settings");
    let poses = poses(&chain, 64);
    let (mut memory, mut result) = (solver.memory(), IkResult::new(chain.dof()));
    let round = move || {
        for pose in &poses {
            solver.solve_into(black_box(pose), None, 0, &mut memory, &mut result).expect("valid pose");
            black_box(&result);
        }
    };
    (64, Box::new(round))
}

fn velocity(scheme: usize) -> Kernel {
    let chain = load("iiwa14");
    let h = Arc::new(JointRange::new(&chain));
    let (gain, damping, task) = (Gain::Constant(1.0), Some(Damping::default()), Task::POSE);
    let mut scheme: Box<dyn Resolver> = match scheme {
        0 => Box::new(ProjectedGradient::new(&chain, Some(h), gain, task, damping).expect("scheme")),
        1 => Box::new(ReducedGradient::new(&chain, Some(h), gain, task, damping, None).expect("scheme")),
        _ => Box::new(SaturatedNullspace::new(&chain, Some(h), gain, task, None).expect("scheme")),
    };
    let mut q = configurations(&chain, 1_000, 5);
    q.retain(|q| sigma_min(&chain, &task, q).is_ok_and(|least| least > 0.1));
    q.truncate(200);
    let calls = q.len();
    let twist = [0.6, -0.3, 0.18, 0.6, 0.12, -0.6];
    let mut qd = [0.0; 7];
    let round = move || {
        for q in &q {
            let input = StepInput { q: black_box(q), velocity: &twist, dt: Some(0.01), qd: None, wish: None };
            black_box(scheme.step(&input, &mut qd).is_ok());
            black_box(qd);
        }
    };
    (calls, Box::new(round))
}

fn classify() -> Kernel {
    let chain = load("iiwa14");
    let q = configurations(&chain, 64, 7);
    let round = move || {
        let h = Manipulability::new(&chain, Task::POSE);
        let mut classifier = Classifier::new(&chain, &h, Task::POSE).expect("same arm");
        for q in &q {
            black_box(classifier.classify(black_box(q)).expect("valid q"));
        }
    };
    (64, Box::new(round))
}

fn follow() -> Kernel {
    let chain = load("planar3r");
    let circle = Circle::new(Vector3::new(3.5, 0.0, 0.0), 1.5, PI, 1.0, Vector3::z()).expect("circle");
    let path = circle.path(101).expect("path");
    let start = [-87.1742f64, 111.7847, 77.5352].map(f64::to_radians);
    let round = move || {
        let h = Manipulability::new(&chain, Task::PLANAR);
        let settings = FollowSettings::default();
        black_box(follow_optimum(&chain, &path, black_box(&start), &h, Task::PLANAR, &settings))
            .expect("valid start");
    };
    (1, Box::new(round))
}

fn speed() -> Kernel {
    let chain = load("puma560").with_tool(Pose::translation(-0.15, 0.0, 0.4)).expect("tool");
    let file = format!("{}/../../tests/golden/spray_ref_b_path.csv", env!("CARGO_MANIFEST_DIR"));
    let path = Path::from_csv(file).expect("path");
    let positions: Vec<_> = path.poses().iter().map(|p| p.translation.vector).collect();
    let rule = OrientationRule::new(RuleKind::BarrierSpin(BarrierRule::default())).expect("rule");
    let path = path.with_orientations(&rule.orientations(&positions).expect("rotations")).expect("path");
    let settings = SpeedSettings::of(&chain);
    let q = max_speed_of_poses(&chain, path.s(), path.poses(), None, &settings).expect("speed").q;
    let round = move || {
        black_box(max_speed(&chain, black_box(path.s()), &q, &settings).expect("valid rows"));
    };
    (1, Box::new(round))
}

/// Ten strokes along y in +-.3, x from .5 to .68, z = .3, tool down, at 0.2 m/s.
fn raster(points: usize) -> Path {
    let down = Rotation3::new(Vector3::x() * PI);
    let start = Vector3::new(0.5, -0.3, 0.3);
    let raster = Raster::new(start, 0.6, 0.02, 10, None, Vector3::y(), Vector3::x()).expect("raster");
    let fine = raster.path(0.001).and_then(|path| path.with_orientation(&down)).expect("path");
    let step = fine.length() / (points - 1) as f64;
    let at = |k: usize| fine.at((k as f64 * step).min(fine.length())).expect("pose").pose;
    let t: Vec<f64> = (0..points).map(|k| k as f64 * step / 0.2).collect();
    Path::new(&(0..points).map(at).collect::<Vec<_>>(), None, Some(&t)).expect("path")
}

fn flow() -> Kernel {
    let path = raster(1_000);
    let flow = SwivelFlow::new(&srs(), &primitives(), SwivelFlowSettings::default()).expect("flow");
    let round = move || {
        let mut s = 0.0;
        for pose in path.poses() {
            let step = flow.step(black_box(pose), s, 0.5, 0.01, 0.0, &FlowState::default()).expect("step");
            s = step.swivel;
        }
        black_box(s);
    };
    (1_000, Box::new(round))
}

fn plan() -> Kernel {
    let (arm, path) = (srs(), raster(200));
    let settings = SwivelPlanSettings { scene: Some(primitives()), ..SwivelPlanSettings::default() };
    let round = move || {
        black_box(plan_swivel(&arm, black_box(&path), &settings, &Watch::default()).expect("plan"));
    };
    (1, Box::new(round))
}

fn main() {
    // Cargo adds `--bench` or `--test`.
    let wanted = std::env::args().skip(1).find(|argument| !argument.starts_with('-'));
    match wanted.as_deref() {
        Some("list") => KERNELS.iter().for_each(|(name, prepare)| println!("{name} {}", prepare().0)),
        Some(name) => {
            let Some((_, prepare)) = KERNELS.iter().find(|(id, _)| *id == name) else {
                eprintln!("no kernel '{name}', see `counts list`");
                std::process::exit(2);
            };
            let (_, mut round) = prepare();
            on_one_thread(&mut || {
                round();
                counted(&mut round);
            });
        }
        None => KERNELS.iter().for_each(|(_, prepare)| on_one_thread(&mut prepare().1)),
    }
}
