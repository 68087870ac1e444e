//! The corrector: every task, held coordinates, tangents, damping, and the pose error against quaternions.

use proptest::prelude::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use redundancy_core::Pose;
use redundancy_core::chain::{Chain, catalog};
use redundancy_core::kinematics::{Corrector, CorrectorSettings, PoseError, StepBound, Task, TaskKind};
use redundancy_core::nalgebra::{Rotation3, Translation3, UnitQuaternion, Vector3};

fn random_q(chain: &Chain, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let range = |i: usize| (chain.lower()[i].max(-3.0), chain.upper()[i].min(3.0));
    (0..chain.dof()).map(|i| rng.random_range(range(i).0..=range(i).1)).collect()
}

fn tasks() -> [Task; 7] {
    let sideways = Task::pointing([1.0, 0.2, -0.4]).unwrap();
    [Task::POSE, Task::POSE_RPY, Task::POSITION, Task::POINTING, sideways, Task::PLANAR, Task::PLANAR_POSE]
}

/// From a point nearby every task is met on every arm, and the joint motion is about as short as it can be.
#[test]
fn every_task_on_every_arm() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    for name in ["planar3r", "planar4r", "puma560", "panda", "iiwa14", "dexter"] {
        let chain = catalog::load(name).unwrap();
        for task in tasks() {
            // Planar arms have planar tasks; `planar_pose` has a heading only while the tool turns about z alone.
            let planar = matches!(task.kind(), TaskKind::Planar | TaskKind::PlanarPose);
            if if name.starts_with("planar") { !planar } else { task.kind() == TaskKind::PlanarPose } {
                continue;
            }
            let (mut met, mut tried) = (0, 0);
            for _ in 0..40 {
                let there = random_q(&chain, &mut rng);
                let target = chain.forward(&there).unwrap();
                let mut corrector = Corrector::new(&chain, task, &target).unwrap();
                corrector.evaluate(&there);
                if corrector.pivot_ratio() < 0.03 {
                    continue;
                }
                tried += 1;
                let mut q: Vec<f64> = there.iter().map(|q| q + rng.random_range(-0.02..0.02)).collect();
                let start = q.clone();
                if corrector.correct(&mut q, 0.5) {
                    met += 1;
                    let error = corrector.error(&q);
                    assert!(error.position < 1e-11 && error.orientation < 1e-11, "{name} {task}: {error:?}");
                    let moved =
                        |to: &[f64]| start.iter().zip(to).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
                    assert!(moved(&q) < 1.2 * moved(&there) + 1e-9, "{name} {task}");
                }
            }
            assert!(met >= tried - 1 && tried > 0, "{name} {task}: {met} of {tried}");
        }
    }
}

/// The basis leaves the task unchanged: against differences of the error.
#[test]
fn the_basis_is_the_kernel() {
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let chain = catalog::load("panda").unwrap();
    for task in tasks().into_iter().filter(|task| task.kind() != TaskKind::PlanarPose) {
        for _ in 0..10 {
            let q = random_q(&chain, &mut rng);
            let mut corrector = Corrector::new(&chain, task, &chain.forward(&q).unwrap()).unwrap();
            corrector.evaluate(&q);
            let basis = corrector.basis().clone();
            assert_eq!(basis.ncols(), chain.dof() - task.dim());
            for t in basis.column_iter() {
                let h = 1e-5;
                let at = |s: f64| -> Vec<f64> { q.iter().zip(t.iter()).map(|(q, t)| q + s * t).collect() };
                let (plus, minus) = (corrector.error(&at(h)), corrector.error(&at(-h)));
                let slope = (plus.coordinates - minus.coordinates) / (2.0 * h);
                assert!(slope.norm() < 1e-8, "{task}: {slope}");
            }
        }
    }
}

/// Held coordinates: a joint that stays where it is, a combination that is moved.
#[test]
fn held_coordinates() {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let chain = catalog::load("iiwa14").unwrap();
    let mut rows = vec![0.0; 14];
    rows[2] = 1.0;
    rows[7..].copy_from_slice(&[0.3, -0.2, 0.5, 0.1, 0.0, 0.7, -0.4]);
    let value = |q: &[f64]| -> f64 { rows[7..].iter().zip(q).map(|(c, q)| c * q).sum() };
    let (mut met, mut tried) = (0, 0);
    for _ in 0..50 {
        let there = random_q(&chain, &mut rng);
        let target = chain.forward(&there).unwrap();
        let mut corrector = Corrector::with_coordinates(&chain, Task::POINTING, &target, &rows).unwrap();
        corrector.set_coordinates(&[there[2], value(&there)]);
        assert!(corrector.evaluate(&there).iter().all(|e| e.abs() < 1e-14));
        if corrector.pivot_ratio() < 0.03 {
            continue;
        }
        tried += 1;
        let mut q: Vec<f64> = there.iter().map(|q| q + rng.random_range(-0.02..0.02)).collect();
        if corrector.correct(&mut q, 1.0) {
            met += 1;
            // Square: the solution is the one it came from.
            assert!(q.iter().zip(&there).all(|(a, b)| (a - b).abs() < 1e-9));
        }
        // A null space of both together.
        corrector.set_coordinates(&[0.0; 2]);
        assert_eq!(corrector.basis().ncols(), 0);
    }
    assert!(met >= tried - 1 && tried > 20, "{met} of {tried}");

    let rail = Corrector::with_coordinates(&chain, Task::POSE, &Pose::identity(), &rows);
    assert!(rail.is_err_and(|e| e.to_string().contains("needs 8")));
    assert!(Corrector::with_coordinates(&chain, Task::POSE, &Pose::identity(), &rows[..6]).is_err());
    assert!(Corrector::new(&catalog::load("planar3r").unwrap(), Task::POSE, &Pose::identity()).is_err());
}

/// With little damping the damped step is the least-norm step, with much it is along the gradient and short.
#[test]
fn damping() {
    let mut rng = ChaCha8Rng::seed_from_u64(10);
    let chain = catalog::load("panda").unwrap();
    for task in [Task::POSE, Task::POSITION, Task::POINTING] {
        for held in [0, 1] {
            if task.dim() + held > 6 {
                continue;
            }
            let mut rows = vec![0.0; 7 * held];
            rows.iter_mut().take(1).for_each(|c| *c = 1.0);
            let target = chain.forward(&random_q(&chain, &mut rng)).unwrap();
            let mut corrector = Corrector::with_coordinates(&chain, task, &target, &rows).unwrap();
            let start = [0.3, 0.5, -0.2, -1.7, 0.4, 1.6, 0.2];
            let (mut plain, mut little, mut much) = (start, start, start);
            let bound = StepBound::Length(f64::INFINITY);
            let length = corrector.step(&mut plain, bound);
            let error = corrector.evaluate(&start).to_vec();
            corrector.damped_step(&mut little, 1e-7, bound);
            let far = plain.iter().zip(&little).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(far < 1e-8 * (1.0 + length), "{task}: {far}");
            corrector.evaluate(&start);
            corrector.damped_step(&mut much, 1e4, bound);
            let step: Vec<f64> = much.iter().zip(&start).map(|(a, b)| (a - b) * 1e8).collect();
            let mut back = vec![0.0; 7];
            corrector.evaluate(&start);
            // J^T e from the multipliers of the least-squares problem: J J^T e / ... is avoided, so compare J (J^T e).
            corrector.null_space().multipliers(&step, &mut back);
            assert!(error.iter().zip(&back).all(|(e, b)| (e - b).abs() < 1e-5), "{task}: {error:?} {back:?}");
        }
    }
}

#[test]
fn bounds_are_kept() {
    let chain = catalog::load("panda").unwrap();
    let target = chain.forward(&[1.5, 0.4, -0.2, -1.9, 0.3, 1.7, 0.5]).unwrap();
    let mut corrector = Corrector::new(&chain, Task::POSE, &target).unwrap();
    let start = [0.1, 0.5, -0.2, -1.8, 0.3, 1.6, 0.7];
    let mut q = start;
    assert!(corrector.step(&mut q, StepBound::Length(0.1)) > 0.1);
    let moved: f64 = q.iter().zip(&start).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    assert!((moved - 0.1).abs() < 1e-12);
    let mut q = start;
    assert!(corrector.step(&mut q, StepBound::Joint(0.1)) > 0.1);
    let most = q.iter().zip(&start).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!((most - 0.1).abs() < 1e-12);
    // Farther than a strict correction may go, and than the joints may travel; not farther than Newton can go.
    assert!(!corrector.correct(&mut start.to_vec(), 0.1));
    let settings = CorrectorSettings { travel: 0.2, ..CorrectorSettings::FAR };
    assert!(!corrector.solve(&mut start.to_vec(), &settings));
    assert!(corrector.reach(&mut start.to_vec()));
    // A singular configuration is refused when asked for.
    let settings = CorrectorSettings { singular: 1e-6, ..CorrectorSettings::FAR };
    assert!(!corrector.solve(&mut [0.0; 7], &settings));
    // NaN is no success.
    assert!(!corrector.reach(&mut [f64::NAN; 7]));
}

fn pose(v: [f64; 6]) -> Pose {
    Pose::from_parts(Translation3::new(v[0], v[1], v[2]), Rotation3::new(Vector3::new(v[3], v[4], v[5])))
}

proptest! {
    #[test]
    fn pose_error_is_that_of_quaternions(a in prop::array::uniform6(-3.0_f64..3.0), b in prop::array::uniform6(-3.0_f64..3.0)) {
        let (from, to) = (pose(a), pose(b));
        let error = PoseError::between(&to, &from);
        let q = |p: &Pose| UnitQuaternion::from_rotation_matrix(&p.rotation);
        let reference = (q(&to) * q(&from).inverse()).scaled_axis();
        prop_assert!((error.angle - reference.norm()).abs() < 1e-12);
        if reference.norm() < 3.1 {
            prop_assert!((error.angular - reference).norm() < 1e-11);
        }
        let moved = Rotation3::new(error.angular) * from.rotation;
        prop_assert!((moved.matrix() - to.rotation.matrix()).norm() < 1e-11);
        prop_assert!((error.linear - (to.translation.vector - from.translation.vector)).norm() == 0.0);
    }

    #[test]
    fn pose_error_near_its_switches(axis in prop::array::uniform3(-1.0_f64..1.0), exponent in -12.0_f64..-1.0, half_turn: bool) {
        let axis = Vector3::from(axis);
        prop_assume!(axis.norm() > 0.1);
        let small = 10.0_f64.powf(exponent);
        let angle = if half_turn { std::f64::consts::PI - small } else { small };
        let to = Pose::from_parts(Translation3::identity(), Rotation3::new(axis.normalize() * angle));
        let error = PoseError::between(&to, &Pose::identity());
        prop_assert!((error.angle - angle).abs() < 1e-11 && (error.angular.norm() - error.angle).abs() < 1e-15 * 4.0);
        let moved = Rotation3::new(error.angular);
        prop_assert!((moved.matrix() - to.rotation.matrix()).norm() < 1e-9);
    }
}

#[test]
fn nothing_is_allocated_after_the_start() {
    let chain = catalog::load("panda").unwrap();
    let there = [0.1, 0.4, -0.2, -1.9, 0.3, 1.7, 0.5];
    let target = chain.forward(&there).unwrap();
    let mut row = [0.0; 7];
    row[3] = 1.0;
    for (task, rows) in [(Task::POSE, 0), (Task::POINTING, 0), (Task::POINTING, 1), (Task::POSITION, 2)] {
        let mut corrector =
            Corrector::with_coordinates(&chain, task, &target, &[row; 2].concat()[..7 * rows]).unwrap();
        let count = crate::allocations::count(|| {
            corrector.set_target(&target);
            corrector.hold(0, &row, there[3]);
            let mut q = there;
            q[0] += 0.05;
            // Two equal rows are singular: the step is then that of the factors.
            let met = corrector.reach(&mut q) || rows == 2;
            let size = corrector.basis().norm() + corrector.pivot_ratio() + corrector.error(&q).position;
            corrector.evaluate(&q);
            corrector.damped_step(&mut q, 0.1, StepBound::Joint(0.1));
            assert!(met && size.is_finite());
        });
        assert_eq!(count, 0, "{task} {rows}");
    }
}

/// At exactly singular configurations steps are finite and still reduce what can be reduced.
#[test]
fn steps_at_singular_configurations() {
    for (name, q) in [("puma560", vec![0.0; 6]), ("planar3r", vec![0.0; 3]), ("iiwa14", vec![0.0; 7])] {
        let chain = catalog::load(name).unwrap();
        let task = if name == "planar3r" { Task::PLANAR } else { Task::POSE };
        let mut target = chain.forward(&q).unwrap();
        target.translation.vector.x += 1e-3;
        target.translation.vector.y += 1e-3;
        let mut corrector = Corrector::new(&chain, task, &target).unwrap();
        let before = corrector.error(&q).position;
        assert!(corrector.evaluate(&q).iter().all(|e| e.is_finite()));
        assert!(corrector.pivot_ratio() < 1e-12, "{name}");
        let mut next = q.clone();
        let size = corrector.step(&mut next, StepBound::Length(0.01));
        assert!(size.is_finite() && next.iter().all(|q| q.is_finite()), "{name}");
        assert!(corrector.error(&next).position < before, "{name}");
    }
}
