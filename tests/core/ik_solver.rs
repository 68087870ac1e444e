//! The solver for any chain: it never misses, and says so when a pose has no answer.

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

use rand::Rng;
use redundancy_core::chain::{Chain, ChainBuilder, DhConvention, DhRow, JointKind, Limits, catalog};
use redundancy_core::criterion::{Criterion, JointRange, Posture};
use redundancy_core::ik::{IkBatch, IkMethod, IkResult, IkSettings, IkSolver, task_target};
use redundancy_core::kinematics::{Scratch, Task};
use redundancy_core::nalgebra::{DMatrix, DVector, Rotation3, Translation3, Vector3};
use redundancy_core::rotation::{Cone, QuaternionVolume};
use redundancy_core::{Pose, Status, pose_to_row_major};

use crate::allocations;
use crate::support::{amount, pose_error, random_pose, random_q, rng};

fn numeric() -> IkSettings {
    IkSettings { closed_form: false, ..IkSettings::default() }
}

/// UR5: three parallel axes, no spherical wrist.
fn ur5() -> Chain {
    let row = |a, d, alpha| DhRow { a, d, alpha, theta: 0.0 };
    let rows = [
        row(0.0, 0.089159, FRAC_PI_2),
        row(-0.425, 0.0, 0.0),
        row(-0.39225, 0.0, 0.0),
        row(0.0, 0.10915, FRAC_PI_2),
        row(0.0, 0.09465, -FRAC_PI_2),
        row(0.0, 0.0823, 0.0),
    ];
    let limits = [Limits { lower: -PI, upper: PI, ..Limits::NONE }; 6];
    ChainBuilder::from_dh("ur5", &rows, DhConvention::Standard).limits(&limits).build().unwrap()
}

/// A six-joint arm on a rail.
fn on_a_rail() -> Chain {
    let arm = ur5();
    let rail = Limits { lower: -0.5, upper: 1.5, ..Limits::NONE };
    let mut builder = ChainBuilder::new("rail", "base").joint(
        "rail",
        JointKind::Prismatic,
        Pose::identity(),
        Vector3::x(),
        rail,
    );
    for joint in arm.joints() {
        builder =
            builder.joint(&joint.name, joint.kind, joint.placement, joint.axis.into_inner(), joint.limits);
    }
    builder.link("tip", arm.links().last().unwrap().offset).build().unwrap()
}

/// A telescope in the middle: three turning joints, one sliding, three turning.
fn telescope() -> Chain {
    let turn = |range: f64| Limits { lower: -range, upper: range, ..Limits::NONE };
    let up = |z: f64| Pose::from_parts(Translation3::new(0.0, 0.0, z), Rotation3::identity());
    let (y, z) = (Vector3::y(), Vector3::z());
    ChainBuilder::new("telescope", "base")
        .joint("1", JointKind::Revolute, up(0.4), z, turn(2.9))
        .joint("2", JointKind::Revolute, up(0.0), y, turn(1.9))
        .joint("3", JointKind::Prismatic, up(0.3), z, Limits { lower: 0.0, upper: 0.6, ..Limits::NONE })
        .joint("4", JointKind::Revolute, up(0.2), z, turn(2.9))
        .joint("5", JointKind::Revolute, up(0.0), y, turn(2.0))
        .joint("6", JointKind::Continuous, up(0.1), z, Limits::NONE)
        .link("tip", up(0.1))
        .build()
        .unwrap()
}

#[test]
fn every_reachable_pose_is_met_within_limits() {
    let catalogue = ["iiwa14", "panda", "pa10", "dexter", "puma560"].map(|name| catalog::load(name).unwrap());
    for chain in catalogue.into_iter().chain([ur5(), on_a_rail(), telescope()]) {
        let mut rng = rng(10);
        let solver = IkSolver::new(&chain, numeric()).unwrap();
        assert_eq!(solver.closed_form(), None);
        let (mut memory, mut result) = (solver.memory(), IkResult::new(chain.dof()));
        let many = if ["iiwa14", "panda"].contains(&chain.name()) { 10_000 } else { 1_000 };
        for i in 0..amount(200, many) {
            let target = chain.forward(&random_q(&mut rng, &chain)).unwrap();
            solver.solve_into(&target, None, 0, &mut memory, &mut result).unwrap();
            assert_eq!(result.status, Status::Converged, "{} pose {i}: {result:?}", chain.name());
            assert!(result.position_error <= 1e-6 && result.orientation_error <= 1e-6);
            assert!(chain.within_limits(&result.q, 0.0));
            // What is reported is what forward kinematics measures.
            let reached = chain.forward(&result.q).unwrap();
            let miss = (reached.translation.vector - target.translation.vector).norm();
            assert!((miss - result.position_error).abs() < 1e-15);
            assert!(pose_error(&reached, &target) < 3e-6);
        }
    }
}

#[test]
fn the_closed_forms_are_used_and_exact() {
    let catalogue =
        [("iiwa14", "srs"), ("pa10", "srs"), ("panda", "panda_class"), ("puma560", "spherical_wrist")];
    let arms = catalogue.map(|(name, form)| (catalog::load(name).unwrap(), form));
    for (chain, form) in arms.into_iter().chain([(ur5(), "parallel_axes")]) {
        let solver = IkSolver::new(&chain, IkSettings::default()).unwrap();
        assert_eq!(solver.closed_form(), Some(form));
        let mut rng = rng(11);
        for _ in 0..amount(200, 10_000) {
            let q = random_q(&mut rng, &chain);
            let target = chain.forward(&q).unwrap();
            let result = solver.solve(&target, None, 0).unwrap();
            assert_eq!((result.status, result.iterations), (Status::Converged, 0), "{result:?}");
            assert!(result.position_error < 1e-12 && result.orientation_error < 1e-12);
            assert!(chain.within_limits(&result.q, 0.0));
            // From a start nearby it stays nearby.
            let near: Vec<f64> = q.iter().map(|q| q + rng.random_range(-1e-3..1e-3)).collect();
            let result = solver.solve(&target, Some(&near), 0).unwrap();
            let away = result.q.iter().zip(&near).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
            let own = q.iter().zip(&near).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
            assert!(result.status == Status::Converged && away <= own + 1e-9);
        }
    }
    // Eight joints: there is no closed form.
    let dexter = catalog::load("dexter").unwrap();
    assert_eq!(IkSolver::new(&dexter, IkSettings::default()).unwrap().closed_form(), None);
}

/// Radians that a metre counts where a pose is out of reach.
const SCALE: f64 = 1.0 / 0.3;

#[test]
fn poses_out_of_reach_say_so_with_the_nearest_distance() {
    let mut rng = rng(12);
    for name in ["iiwa14", "puma560"] {
        let chain = catalog::load(name).unwrap();
        // The wrist centre stays within this distance of the shoulder: 0.42 + 0.40 m, and for the PUMA with the offsets.
        let (shoulder, reach, tool) = match name {
            "iiwa14" => (Vector3::new(0.0, 0.0, 0.36), 0.82, 0.126),
            _ => {
                let fore = 0.4318_f64.hypot(0.0203);
                (Vector3::zeros(), (0.4318 + fore).hypot(0.15005), 0.0)
            }
        };
        // Without limits the pose with the wrist on the boundary and the same orientation is reached.
        let free = chain.with_limits(&vec![Limits::NONE; chain.dof()]).unwrap();
        let free = IkSolver::new(&free, numeric()).unwrap();
        for closed_form in [false, true] {
            let solver = IkSolver::new(&chain, IkSettings { closed_form, ..IkSettings::default() }).unwrap();
            for _ in 0..amount(5, 200) {
                // A wrist centre just outside, and the tool along the arm or away from it.
                let excess = 10.0_f64.powf(rng.random_range(-5.0..-1.0));
                let direction = loop {
                    let v = Vector3::<f64>::from_fn(|_, _| rng.random_range(-1.0..1.0)).normalize();
                    if v.z.abs() < 0.6 {
                        break v;
                    }
                };
                let rotation = random_pose(&mut rng, 1.0).rotation;
                let wrist = shoulder + direction * (reach + excess);
                let tip = wrist + rotation * Vector3::new(0.0, 0.0, tool);
                let target = Pose::from_parts(Translation3::from(tip), rotation);
                let result = solver.solve(&target, None, 0).unwrap();
                assert!([Status::Unreachable, Status::Limits].contains(&result.status), "{name} {result:?}");
                assert_eq!(result.status, Status::Unreachable, "{name} {closed_form} {excess:e} {result:?}");
                assert!(result.reason().contains("out of reach"));
                // It cannot be nearer than the wrist is out of reach, unless it turns the tool.
                let nearest = result.position_error + tool * result.orientation_error;
                assert!(nearest >= excess * (1.0 - 1e-9), "{nearest} {excess}");
                if closed_form {
                    continue;
                }
                // And the best of all starts is not much further.
                assert!(result.position_error <= 20.0 * excess + 0.3, "{result:?} {excess}");
                let result = free.solve(&target, None, 0).unwrap();
                assert_eq!(result.status, Status::Unreachable, "{name} {result:?}");
                let weighted = (SCALE * result.position_error).hypot(result.orientation_error);
                assert!(weighted <= SCALE * excess * (1.0 + 1e-3), "{weighted} {excess} {result:?}");
            }
        }
    }
}

#[test]
fn a_pose_just_out_of_reach_is_approached_to_its_distance() {
    // Straight up: the nearest pose is the stretched arm.
    let chain = catalog::load("iiwa14").unwrap();
    let solver = IkSolver::new(&chain, numeric()).unwrap();
    let top = chain.forward(&[0.0; 7]).unwrap();
    for excess in [1e-5, 1e-3, 0.05] {
        let target = Pose::from_parts(Translation3::new(0.0, 0.0, top.translation.z + excess), top.rotation);
        let result = solver.solve(&target, None, 0).unwrap();
        assert_eq!(result.status, Status::Unreachable);
        assert!((result.position_error - excess).abs() < 1e-3 * excess, "{result:?}");
        assert!(result.orientation_error < 1e-3);
    }
}

#[test]
fn limits_are_told_from_reach() {
    let chain = catalog::load("panda").unwrap();
    let tight: Vec<Limits> =
        chain.joints().iter().map(|j| Limits { lower: -1.0, upper: -0.2, ..j.limits }).collect();
    let tight = chain.with_limits(&tight).unwrap();
    let target = chain.forward(&[0.5, 0.5, 0.5, -2.0, 0.5, 2.0, 0.5]).unwrap();
    let result = IkSolver::new(&tight, numeric()).unwrap().solve(&target, None, 0).unwrap();
    assert_eq!(result.status, Status::Limits);
    assert!(tight.within_limits(&result.q, 0.0) && result.position_error > 1e-3);
    assert!(result.reason().contains("outside of the joint limits"), "{}", result.reason());
}

#[test]
fn caps_and_time_limits_are_reported() {
    let chain = catalog::load("panda").unwrap();
    let far = Pose::from_parts(Translation3::new(0.6, 0.0, 1.4), Rotation3::identity());
    let solve = |settings| IkSolver::new(&chain, settings).unwrap().solve(&far, None, 0).unwrap();
    let capped = solve(IkSettings { max_iterations: 7, ..numeric() });
    assert_eq!((capped.status, capped.iterations), (Status::IterationLimit, 7));
    let timed = solve(IkSettings { time_limit: Some(1e-9), ..numeric() });
    assert_eq!(timed.status, Status::TimeLimit);
    assert!(timed.reason().contains("time_limit"));
}

#[test]
fn other_tasks() {
    let chain = catalog::load("panda").unwrap();
    let mut rng = rng(13);
    let axis = [0.6, 0.0, 0.8];
    for task in [Task::POSE_RPY, Task::POSITION, Task::POINTING, Task::pointing(axis).unwrap()] {
        let solver = IkSolver::new(&chain, IkSettings { task, ..IkSettings::default() }).unwrap();
        for _ in 0..amount(100, 1_000) {
            let target = chain.forward(&random_q(&mut rng, &chain)).unwrap();
            let result = solver.solve(&target, None, 0).unwrap();
            assert_eq!(result.status, Status::Converged, "{task} {result:?}");
            assert!(chain.within_limits(&result.q, 0.0));
            let reached = chain.forward(&result.q).unwrap();
            assert!((reached.translation.vector - target.translation.vector).norm() <= 1e-6);
            let error = task.error(&target, &reached);
            assert!(error.position <= 1e-6 && error.orientation <= 1.001e-6);
        }
    }
    let planar = catalog::load("planar4r").unwrap();
    for (task, target) in [(Task::PLANAR, vec![4.0, 3.0]), (Task::PLANAR_POSE, vec![4.0, 3.0, 2.5])] {
        let solver = IkSolver::new(&planar, IkSettings { task, ..IkSettings::default() }).unwrap();
        let target = task_target(&task, &target).unwrap();
        let result = solver.solve(&target, None, 0).unwrap();
        assert_eq!(result.status, Status::Converged, "{task} {result:?}");
        let reached = planar.forward(&result.q).unwrap();
        assert!((reached.translation.x - 4.0).hypot(reached.translation.y - 3.0) <= 1e-6);
        assert!(task.error(&target, &reached).orientation <= 1e-6);
    }
    let far = task_target(&Task::PLANAR, &[9.5, 0.0]).unwrap();
    let solver = IkSolver::new(&planar, IkSettings { task: Task::PLANAR, ..IkSettings::default() }).unwrap();
    let result = solver.solve(&far, None, 0).unwrap();
    assert_eq!(result.status, Status::Unreachable);
    assert!((result.position_error - 0.5).abs() < 1e-6, "{result:?}");
}

#[test]
fn orientation_sets_are_reached_and_measured() {
    let chain = catalog::load("panda").unwrap();
    let mut rng = rng(14);
    let down = [0.0, 0.0, -1.0];
    let cone = Cone::z(down, 0.3).unwrap();
    let volume = QuaternionVolume::cone_around([0.0, 0.0, 1.0], down, 0.2).unwrap();
    let (inner, outer) = (volume.clone(), cone);
    for set in [cone.into(), volume.into()] {
        let is_cone = matches!(set, redundancy_core::ik::OrientationSet::Cone(_));
        let settings = IkSettings { orientation_set: Some(set), ..IkSettings::default() };
        let solver = IkSolver::new(&chain, settings).unwrap();
        for _ in 0..amount(50, 500) {
            // A place at which some orientation of the set is reached: the tool points down.
            let p = Vector3::new(
                rng.random_range(0.3..0.55),
                rng.random_range(-0.3..0.3),
                rng.random_range(0.1..0.5),
            );
            let target = Pose::from_parts(Translation3::from(p), random_pose(&mut rng, 1.0).rotation);
            let result = solver.solve(&target, None, 0).unwrap();
            assert_eq!(result.status, Status::Converged, "{result:?}");
            let reached = chain.forward(&result.q).unwrap();
            assert!((reached.translation.vector - p).norm() <= 1e-6 && result.orientation_error <= 1e-6);
            let q = redundancy_core::nalgebra::UnitQuaternion::from_rotation_matrix(&reached.rotation);
            if is_cone {
                assert!(outer.angle(&q) <= 0.3 + 1.001e-6);
            } else {
                assert!(inner.margin(&q) >= -1e-6);
            }
        }
    }
}

/// Projected gradient of the criterion, with numbers that the solver does not use: nalgebra's SVD.
fn projected_gradient(chain: &Chain, q: &[f64], criterion: &dyn Criterion) -> f64 {
    let mut scratch = Scratch::new(chain);
    let jacobian = chain.kinematics(q, &mut scratch).unwrap().jacobian().clone();
    let inverse = DMatrix::from_column_slice(6, q.len(), jacobian.as_slice()).pseudo_inverse(1e-12).unwrap();
    let mut gradient = DVector::zeros(q.len());
    criterion.gradient(q, gradient.as_mut_slice());
    let part = &inverse * (DMatrix::from_column_slice(6, q.len(), jacobian.as_slice()) * &gradient);
    (&gradient - part).norm() / gradient.norm()
}

#[test]
fn the_criterion_is_stationary_in_the_null_space() {
    let mut rng = rng(15);
    for name in ["panda", "iiwa14", "dexter"] {
        let chain = catalog::load(name).unwrap();
        let middle: Vec<f64> =
            chain.lower().iter().zip(chain.upper()).map(|(lo, hi)| 0.5 * (lo + hi)).collect();
        let posture: Arc<dyn Criterion> = Arc::new(Posture::new(&middle).unwrap());
        let range: Arc<dyn Criterion> = Arc::new(JointRange::new(&chain));
        for criterion in [posture, range] {
            let plain = IkSolver::new(&chain, numeric()).unwrap();
            let settings = IkSettings { criterion: Some(Arc::clone(&criterion)), ..numeric() };
            let solver = IkSolver::new(&chain, settings).unwrap();
            let exact = IkSettings { criterion: Some(Arc::clone(&criterion)), ..IkSettings::default() };
            let exact = IkSolver::new(&chain, exact).unwrap();
            let mut stationary = 0;
            let many = amount(20, 200);
            for _ in 0..many {
                let target = chain.forward(&random_q(&mut rng, &chain)).unwrap();
                let before = plain.solve(&target, None, 0).unwrap();
                let after = solver.solve(&target, None, 0).unwrap();
                assert_eq!(after.status, Status::Converged);
                assert!(chain.within_limits(&after.q, 0.0) && after.position_error <= 1e-6);
                assert!(criterion.value(&after.q) <= criterion.value(&before.q));
                let limit = after.q.iter().zip(chain.lower()).zip(chain.upper());
                let free = limit.into_iter().all(|((q, lo), hi)| q > lo && q < hi);
                stationary += usize::from(!free || projected_gradient(&chain, &after.q, &*criterion) < 1e-4);
                if name == "iiwa14" {
                    let best = exact.solve(&target, None, 0).unwrap();
                    assert!(criterion.value(&best.q) <= criterion.value(&after.q) + 1e-5);
                }
            }
            assert!(stationary >= many - many / 20, "{name}: {stationary} of {many}");
        }
    }
}

#[test]
fn a_given_start_is_used_and_seeds_decide() {
    let chain = catalog::load("panda").unwrap();
    let mut rng = rng(16);
    let solver = IkSolver::new(&chain, numeric()).unwrap();
    let closed = IkSolver::new(&chain, IkSettings::default()).unwrap();
    let newton = IkSettings { method: IkMethod::Newton, ..IkSettings::default() };
    let newton = IkSolver::new(&chain, newton).unwrap();
    let mut same = 0;
    for _ in 0..100 {
        let q = random_q(&mut rng, &chain);
        let target = chain.forward(&q).unwrap();
        let from = solver.solve(&target, Some(&q), 0).unwrap();
        assert_eq!((from.iterations, &from.q), (0, &q));
        // The closed form computes what it returns: the start up to the rounding of the nearest point of a curve.
        let from = closed.solve(&target, Some(&q), 0).unwrap();
        let away = from.q.iter().zip(&q).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(from.iterations == 0 && away < 1e-9, "{away:e}");
        let (a, b) = (newton.solve(&target, None, 3).unwrap(), newton.solve(&target, None, 3).unwrap());
        assert_eq!((a.status, &a), (Status::Converged, &b));
        same += usize::from(newton.solve(&target, None, 4).unwrap() == a);
    }
    assert!(same < 50);
}

#[test]
fn batches_have_the_bits_of_single_calls_and_nothing_allocates() {
    let chain = catalog::load("panda").unwrap();
    let solver = IkSolver::new(&chain, IkSettings::default()).unwrap();
    let mut rng = rng(17);
    let poses: Vec<Pose> = (0..100).map(|_| chain.forward(&random_q(&mut rng, &chain)).unwrap()).collect();
    let rows: Vec<f64> = poses.iter().flat_map(pose_to_row_major).collect();
    let q0 = [0.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0];
    for start in [None, Some(&q0[..])] {
        let mut answers = Vec::new();
        for threads in [1, 3] {
            let (mut q, mut status) = (vec![0.0; 700], vec![Status::Cancelled; 100]);
            let (mut iterations, mut position, mut orientation) =
                (vec![0; 100], vec![0.0; 100], vec![0.0; 100]);
            let mut proven = vec![false; 100];
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut out = IkBatch {
                q: &mut q,
                status: &mut status,
                iterations: &mut iterations,
                position_error: &mut position,
                orientation_error: &mut orientation,
                proven: &mut proven,
            };
            pool.install(|| solver.solve_batch(&rows, start, 5, &mut out)).unwrap();
            answers.push((q, status, iterations, position, orientation, proven));
        }
        assert!(answers[0] == answers[1]);
        for (i, pose) in poses.iter().enumerate() {
            let single = solver.solve(pose, start, 5).unwrap();
            assert_eq!(single.q, answers[0].0[7 * i..7 * i + 7]);
            assert_eq!((single.status, single.iterations as u32), (answers[0].1[i], answers[0].2[i]));
            assert_eq!(single.proven, answers[0].5[i]);
        }
    }
    for name in ["panda", "iiwa14", "puma560", "dexter"] {
        let chain = catalog::load(name).unwrap();
        let solver = IkSolver::new(&chain, numeric()).unwrap();
        let closed = IkSolver::new(&chain, IkSettings::default()).unwrap();
        let (mut memory, mut result) = (solver.memory(), IkResult::new(chain.dof()));
        for _ in 0..50 {
            let target = chain.forward(&random_q(&mut rng, &chain)).unwrap();
            for solver in [&solver, &closed] {
                let count =
                    allocations::count(|| solver.solve_into(&target, None, 0, &mut memory, &mut result));
                assert_eq!(count, 0, "{name}");
            }
        }
    }
}

#[test]
fn bad_input_is_named() {
    let chain = catalog::load("panda").unwrap();
    let refused = |settings| IkSolver::new(&chain, settings).unwrap_err().to_string();
    let ok = IkSettings::default;
    assert_eq!(
        refused(IkSettings { tol_position: 0.0, ..ok() }),
        "tol_position is 0, it must be > 0 and finite"
    );
    assert_eq!(
        refused(IkSettings { tol_orientation: f64::NAN, ..ok() }),
        "tol_orientation is NaN, it must be > 0 and finite"
    );
    assert_eq!(
        refused(IkSettings { time_limit: Some(-1.0), ..ok() }),
        "time_limit is -1, it must be > 0 and finite"
    );
    assert_eq!(refused(IkSettings { max_iterations: 0, ..ok() }), "max_iterations is 0, it must be >= 1");
    let other: Arc<dyn Criterion> = Arc::new(JointRange::new(&ur5()));
    assert!(refused(IkSettings { criterion: Some(other), ..ok() }).contains("expected 7 entries, got 6"));
    let set = Some(Cone::z([0.0, 0.0, 1.0], 0.1).unwrap().into());
    let text = refused(IkSettings { orientation_set: set, task: Task::POSITION, ..ok() });
    assert!(text.contains("orientation_set needs the task pose"), "{text}");
    assert!(IkMethod::from_name("magic").unwrap_err().to_string().contains("hybrid, newton"));

    let solver = IkSolver::new(&chain, ok()).unwrap();
    let mut skewed = chain.forward(&[0.1; 7]).unwrap();
    let mut matrix = *skewed.rotation.matrix();
    matrix[(0, 0)] += 1e-2;
    skewed.rotation = Rotation3::from_matrix_unchecked(matrix);
    let text = solver.solve(&skewed, None, 0).unwrap_err().to_string();
    assert!(text.contains("not orthonormal") && text.contains("is 0.0"), "{text}");
    let good = chain.forward(&[0.1; 7]).unwrap();
    assert!(
        solver
            .solve(&good, Some(&[0.0; 6]), 0)
            .unwrap_err()
            .to_string()
            .contains("expected 7 entries, got 6")
    );
    assert!(solver.solve(&good, Some(&[f64::INFINITY; 7]), 0).is_err());
    assert!(task_target(&Task::PLANAR, &[1.0]).is_err() && task_target(&Task::POSE, &[1.0; 6]).is_err());
}

/// Starts outside of the limits, targets at singular configurations and at limits, huge and tiny tolerances.
#[test]
fn hard_input_ends_with_an_answer() {
    let chain = catalog::load("panda").unwrap();
    let solver = IkSolver::new(&chain, numeric()).unwrap();
    let target = chain.forward(&[0.5, 0.5, 0.5, -2.0, 0.5, 2.0, 0.5]).unwrap();
    let result = solver.solve(&target, Some(&[100.0, -1e6, 50.0, 3.0, 0.0, 0.0, 1e9]), 0).unwrap();
    assert_eq!(result.status, Status::Converged);
    let corners: Vec<Vec<f64>> = vec![
        chain.lower().to_vec(),
        chain.upper().to_vec(),
        vec![0.0, 0.0, 0.0, -0.0698, 0.0, 0.0, 0.0],
        vec![0.0, 0.0, 0.0, -PI / 2.0, 0.0, PI / 2.0, 0.0],
    ];
    for q in corners {
        let target = chain.forward(&q).unwrap();
        let result = solver.solve(&target, None, 0).unwrap();
        assert_eq!(result.status, Status::Converged, "{q:?} {result:?}");
        assert!(chain.within_limits(&result.q, 0.0));
    }
    let stretched = catalog::load("iiwa14").unwrap();
    let solver = IkSolver::new(&stretched, numeric()).unwrap();
    let result = solver.solve(&stretched.forward(&[0.0; 7]).unwrap(), None, 0).unwrap();
    assert_eq!(result.status, Status::Converged, "{result:?}");
    let tight = IkSettings { tol_position: 1e-300, tol_orientation: 1e-300, ..numeric() };
    let result = IkSolver::new(&chain, tight).unwrap().solve(&target, None, 0).unwrap();
    assert!(result.status != Status::Converged && result.position_error < 1e-12, "{result:?}");
    let single = ChainBuilder::from_dh(
        "one",
        &[DhRow { a: 1.0, d: 0.0, alpha: 0.0, theta: 0.0 }],
        DhConvention::Standard,
    )
    .build()
    .unwrap();
    let solver = IkSolver::new(&single, IkSettings::default()).unwrap();
    let result = solver.solve(&single.forward(&[2.0]).unwrap(), None, 0).unwrap();
    assert!(result.status == Status::Converged && (result.q[0] - 2.0).abs() < 1e-5, "{result:?}");
}
