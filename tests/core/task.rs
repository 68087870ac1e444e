//! Tasks and the kinematic Hessian against differences.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use redundancy_core::chain::{Chain, catalog};
use redundancy_core::kinematics::{Scratch, Task, TaskKind, rotation_vector};
use redundancy_core::nalgebra::{DMatrix, DVector, Rotation3, Vector3, Vector6};
use redundancy_core::rotation::from_rpy;

fn arms() -> Vec<Chain> {
    let mut arms: Vec<Chain> = catalog::names().map(|name| catalog::load(name).unwrap()).collect();
    let urdf = include_str!("../data/arm.urdf");
    let limits = redundancy_core::chain::MissingLimits::Refuse;
    arms.push(Chain::from_urdf_string(urdf, Some("world"), Some("flange"), limits).unwrap());
    arms
}

fn tasks() -> Vec<Task> {
    let mut tasks: Vec<Task> =
        TaskKind::ALL.iter().map(|kind| Task::from_name(kind.as_str()).unwrap()).collect();
    tasks.push(Task::pointing([0.3, -1.0, 0.5]).unwrap());
    tasks
}

fn random_q(rng: &mut ChaCha8Rng, dof: usize) -> Vec<f64> {
    (0..dof).map(|_| rng.random_range(-3.0..3.0)).collect()
}

fn moved(q: &[f64], joint: usize, step: f64) -> Vec<f64> {
    let mut q = q.to_vec();
    q[joint] += step;
    q
}

#[test]
fn hessian_against_central_differences() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let h = 1e-5;
    for arm in arms() {
        let n = arm.dof();
        for _ in 0..100 {
            let q = random_q(&mut rng, n);
            let hessian = arm.hessian(&q).unwrap();
            for k in 0..n {
                let plus = arm.jacobian(&moved(&q, k, h)).unwrap();
                let minus = arm.jacobian(&moved(&q, k, -h)).unwrap();
                let difference = (plus - minus) / (2.0 * h);
                for row in 0..6 {
                    for j in 0..n {
                        let error = (hessian[(row * n + j) * n + k] - difference[(row, j)]).abs();
                        assert!(error < 1e-8, "{} d J[{row}, {j}] / d q{k}: {error:e}", arm.name());
                    }
                }
            }
        }
    }
    assert!(arms()[0].hessian(&[f64::NAN; 8]).is_err());
}

#[test]
fn task_jacobians_against_the_change_of_the_error() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let h = 1e-6;
    for arm in arms() {
        let mut scratch = Scratch::new(&arm);
        for task in tasks() {
            let (m, n) = (task.dim(), arm.dof());
            for _ in 0..30 {
                let q = random_q(&mut rng, n);
                let mut jacobian = DMatrix::zeros(m, n);
                let kinematics = arm.kinematics(&q, &mut scratch).unwrap();
                task.write_jacobian(&kinematics, jacobian.as_mut_slice());
                let here = *kinematics.pose();
                // Rates of roll-pitch-yaw are large near their singularity; the difference quotient is then poor.
                let r = here.rotation.matrix();
                if task.kind() == TaskKind::PoseRpy && r[(0, 0)].hypot(r[(1, 0)]) < 0.1 {
                    continue;
                }
                // A planar arm's heading is defined, that of an arm whose x axis points up is not.
                if task.kind() == TaskKind::PlanarPose && !arm.name().starts_with("planar") {
                    continue;
                }
                for k in 0..n {
                    let [plus, minus] = [h, -h].map(|step| arm.forward(&moved(&q, k, step)).unwrap());
                    let change = (task.error(&plus, &here).coordinates
                        - task.error(&minus, &here).coordinates)
                        / (2.0 * h);
                    let column = DVector::from_iterator(m, jacobian.column(k).iter().copied());
                    let error = (DVector::from_column_slice(&change.as_slice()[..m]) - &column).amax();
                    assert!(error < 1e-6, "{} {task} joint {k}: {error:e}", arm.name());
                    assert!(change.as_slice()[m..].iter().all(|c| *c == 0.0));
                    // The same motion as a twist.
                    let twist: Vector6<f64> = kinematics.jacobian().column(k).into();
                    let coordinates = task.from_twist(&here, &twist);
                    let error = (coordinates.rows(0, m) - &column).amax();
                    assert!(error < 1e-12, "{} {task} twist of joint {k}: {error:e}", arm.name());
                }
            }
        }
    }
}

#[test]
fn errors_are_measured_along_the_shortest_arc() {
    let arm = catalog::load("iiwa14").unwrap();
    let pose = arm.forward(&[0.3, 0.5, -0.2, 1.1, 0.4, -0.7, 0.2]).unwrap();
    let turn = |axis: Vector3<f64>, angle: f64| {
        Rotation3::from_axis_angle(&redundancy_core::nalgebra::Unit::new_normalize(axis), angle)
    };
    for angle in [0.0, 1e-300, 1e-12, 1e-6, 0.5, 3.0, std::f64::consts::PI - 1e-9, std::f64::consts::PI] {
        let mut target = pose;
        target.rotation = turn(Vector3::new(1.0, -2.0, 0.5), angle) * pose.rotation;
        let error = Task::POSE.error(&target, &pose);
        assert!((error.orientation - angle).abs() < 1e-12, "{angle}: {}", error.orientation);
        assert_eq!(error.position, 0.0);
        // A spin about the tool axis is no error of a pointing task.
        let axis = Task::pointing([0.0, 1.0, 1.0]).unwrap();
        target.rotation = turn(pose.rotation * *axis.axis(), angle) * pose.rotation;
        assert!(axis.error(&target, &pose).orientation < 1e-12);
        // A tilt is.
        let [u, _] = axis.across(&pose);
        target.rotation = turn(u, angle) * pose.rotation;
        let error = axis.error(&target, &pose);
        assert!((error.orientation - angle).abs() < 1e-12);
        assert!((error.coordinates.rows(3, 2).norm() - angle).abs() < 1e-12);
    }
    let far = rotation_vector(&turn(Vector3::z(), 3.5));
    assert!((far.z - (3.5 - std::f64::consts::TAU)).abs() < 1e-12);
}

/// What paper 5 calls `phi, theta, psi`; at `theta = +-90` degrees the numbers stay finite.
#[test]
fn roll_pitch_yaw_at_its_singularity() {
    let arm = catalog::load("iiwa14").unwrap();
    let mut pose = arm.forward(&[0.3; 7]).unwrap();
    for theta in [1.0f64, -1.0] {
        pose.rotation = from_rpy([0.4, theta * std::f64::consts::FRAC_PI_2, 0.2]).to_rotation_matrix();
        let twist = Vector6::new(0.0, 0.0, 0.0, 1.0, -2.0, 0.5);
        assert!(Task::POSE_RPY.from_twist(&pose, &twist).iter().all(|x| x.is_finite()));
        let error = Task::POSE_RPY.error(&pose, &pose);
        assert_eq!(error.coordinates, Vector6::zeros());
    }
}

#[test]
fn bad_input_is_named() {
    let arm = catalog::load("iiwa14").unwrap();
    let pose = arm.forward(&[0.3; 7]).unwrap();
    assert!(Task::from_name("Pose").unwrap_err().to_string().contains("planar_pose"));
    assert!(Task::pointing([0.0; 3]).unwrap_err().to_string().contains("tool axis"));
    assert!(Task::POSITION.velocity(&pose, &[0.0; 6]).unwrap_err().to_string().contains("expected 3"));
    assert!(Task::POINTING.velocity(&pose, &[0.0; 5]).unwrap_err().to_string().contains("expected 6"));
    assert!(Task::POSE.velocity(&pose, &[f64::NAN; 6]).is_err());
}

#[test]
fn second_derivatives_against_central_differences() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let h = 1e-5;
    for arm in arms() {
        let n = arm.dof();
        let mut memory = [Scratch::new(&arm), Scratch::new(&arm), Scratch::new(&arm)];
        for _ in 0..20 {
            let q = random_q(&mut rng, n);
            let [here, before, behind] = &mut memory;
            let here = arm.kinematics(&q, here).unwrap();
            for l in 0..n {
                let plus = arm.kinematics(&moved(&q, l, h), before).unwrap();
                let minus = arm.kinematics(&moved(&q, l, -h), behind).unwrap();
                for (j, k) in (0..n).flat_map(|j| (0..n).map(move |k| (j, k))) {
                    let ((a, b), (c, d)) = (plus.jacobian_derivative(j, k), minus.jacobian_derivative(j, k));
                    let (linear, angular) = here.jacobian_second_derivative(j, k, l);
                    let error =
                        ((a - c) / (2.0 * h) - linear).amax().max(((b - d) / (2.0 * h) - angular).amax());
                    assert!(error < 1e-7, "{} {j} {k} {l}: {error:e}", arm.name());
                }
            }
        }
    }
}
