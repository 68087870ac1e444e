//! Wishes, blocked tasks, the acceleration level, and the criteria of torque and energy.

use std::sync::Arc;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use redundancy_core::chain::{Chain, Limits, catalog};
use redundancy_core::criterion::{
    Criterion, GravityTorque, JointRange, KineticEnergy, Posture, TorqueMeasure,
};
use redundancy_core::kinematics::{DynamicsScratch, Scratch, Task, TaskKind, TorqueDerivatives};
use redundancy_core::nalgebra::{DMatrix, DVector, Vector3, Vector6};
use redundancy_core::solutions::{Chart, SrsArm, SwivelCriterion};
use redundancy_core::velocity::{
    AccelerationInput, Damping, ExtendedJacobian, Gain, Metric, ProjectedGradient, ReducedGradient, Resolver,
    SaturatedNullspace, StepInput, WhenBlocked, sigma_min,
};
use redundancy_core::{Error, Status};

use crate::allocations;
use crate::criterion::against_differences;
use crate::priorities::missed_conditions;
use crate::support::{amount, random_q};
use crate::velocity::{clarabel, stated_bounds, task_jacobian};

#[test]
fn torques_energy_and_swivel_have_the_derivatives_they_claim() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for name in ["puma560", "iiwa14", "panda"] {
        let arm = catalog::load(name).unwrap();
        if arm.inertias().is_none() {
            continue;
        }
        let n = arm.dof();
        let (mut scratch, mut derivatives) = (DynamicsScratch::new(&arm), TorqueDerivatives::new(n));
        let gravity = [0.5, -1.0, -9.0];
        let weights: Vec<f64> = (0..n).map(|_| rng.random_range(0.0..2.0)).collect();
        let speed: Vec<f64> = (0..n).map(|_| rng.random_range(-1.0..1.0)).collect();
        let norm = GravityTorque::new(&arm, TorqueMeasure::Norm).unwrap().under(gravity).unwrap();
        let norm = norm.weighted(&weights).unwrap();
        let peak = GravityTorque::new(&arm, TorqueMeasure::Peak).unwrap();
        let energy = KineticEnergy::of_velocity(&arm, &speed).unwrap();
        let whole = KineticEnergy::new(&arm).unwrap();
        for _ in 0..34 {
            let q = random_q(&mut rng, &arm);
            let zero = vec![0.0; n];
            let mut tau = vec![0.0; n];
            arm.inverse_dynamics(&q, &zero, &zero, &gravity.into(), &mut scratch, &mut tau).unwrap();
            let expected = tau.iter().zip(&weights).map(|(t, w)| (t * w).powi(2)).sum::<f64>().sqrt();
            assert!((norm.value(&q) - expected).abs() < 1e-11, "{name}");
            let down = Vector3::new(0.0, 0.0, -9.81);
            arm.inverse_dynamics(&q, &zero, &zero, &down, &mut scratch, &mut tau).unwrap();
            let largest = tau.iter().fold(0.0_f64, |most, t| most.max(t.abs()));
            assert!((peak.value(&q) - largest).abs() < 1e-11, "{name}");
            arm.inverse_dynamics_derivatives(&q, &zero, &zero, &down, &mut scratch, &mut derivatives)
                .unwrap();
            let mass = &derivatives.qdd;
            let moving = DVector::from_column_slice(&speed);
            assert!((energy.value(&q) - 0.5 * moving.dot(&(mass * &moving))).abs() < 1e-11);
            assert!((whole.value(&q) - 0.5 * mass.trace()).abs() < 1e-11);
            let mut sorted: Vec<f64> = tau.iter().map(|t| t.abs()).collect();
            sorted.sort_by(|a, b| b.total_cmp(a));
            for (h, smooth) in [
                (&norm as &dyn Criterion, true),
                (&peak, sorted[0] - sorted[1] > 1e-2),
                (&energy, true),
                (&whole, true),
            ] {
                if smooth {
                    let (first, second) = against_differences(h, &q, 1e-5);
                    assert!(first < 1e-8 && second < 1e-6, "{name} {h:?} {first} {second}");
                }
            }
        }
    }
    let chain = catalog::load("pa10").unwrap();
    for chart in [Chart::default(), Chart::Stereographic(Some(Vector3::new(1.0, 0.3, -0.4)))] {
        let arm = SrsArm::with_chart(&chain, chart).unwrap();
        let h = SwivelCriterion::new(&arm, 0.7).unwrap();
        for _ in 0..60 {
            let q = random_q(&mut rng, &chain);
            assert!((h.value(&q) - (1.0 - (arm.swivel(&q).unwrap() - 0.7).cos())).abs() < 1e-12);
            let (first, second) = against_differences(&h, &q, 1e-6);
            assert!(first < 1e-6 && second < 1e-3, "{chart:?} {q:?} {first} {second}");
        }
    }
    let (arm, other) = (catalog::load("planar3r").unwrap(), catalog::load("iiwa14").unwrap());
    assert!(matches!(GravityTorque::new(&arm, TorqueMeasure::Norm), Err(Error::Invalid(_))));
    let h = GravityTorque::new(&other, TorqueMeasure::Norm).unwrap();
    assert!(h.check_arm(&arm).is_err());
}

#[test]
fn a_wish_takes_the_place_of_the_criterion_in_every_scheme() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for name in ["iiwa14", "dexter"] {
        let arm = catalog::load(name).unwrap();
        let n = arm.dof();
        let h: Arc<dyn Criterion> = Arc::new(JointRange::new(&arm));
        let (gain, task) = (Gain::Constant(20.0), Task::POSE);
        let mut projected = ProjectedGradient::new(&arm, Some(h.clone()), gain, task, None).unwrap();
        let mut optimal = ProjectedGradient::new(&arm, Some(h.clone()), Gain::Optimal, task, None).unwrap();
        let mut extended = ExtendedJacobian::new(&arm, h.clone(), 10.0, task, None).unwrap();
        let mut saturated = SaturatedNullspace::new(&arm, Some(h.clone()), gain, task, None).unwrap();
        let reduced = ReducedGradient::new(&arm, Some(h.clone()), gain, task, None, None).unwrap();
        for _ in 0..50 {
            let q = random_q(&mut rng, &arm);
            if sigma_min(&arm, &task, &q).unwrap() < 0.05 {
                continue;
            }
            let wish: Vec<f64> = (0..n).map(|_| rng.random_range(-0.1..0.1)).collect();
            let v: [f64; 6] = std::array::from_fn(|_| rng.random_range(-0.01..0.01));
            let j = task_jacobian(&arm, &task, &q);
            let pseudo = j.clone().pseudo_inverse(1e-12).unwrap();
            let eta = DVector::from_column_slice(&wish);
            let expected = &pseudo * (DVector::from_column_slice(&v) - &j * &eta) + &eta;
            let input = StepInput { q: &q, velocity: &v, dt: Some(0.01), qd: None, wish: Some(&wish) };
            let mut qd = vec![0.0; n];
            for scheme in [&mut projected as &mut dyn Resolver, &mut optimal, &mut extended, &mut saturated] {
                // Wishes of this size stay within the speed limits, and random postures within braking distance.
                let report = scheme.step(&input, &mut qd).unwrap();
                if scheme.name() == "saturated_nullspace" && !scheme.active_limits().is_empty() {
                    continue;
                }
                let error = (DVector::from_column_slice(&qd) - &expected).amax();
                assert!(error < 1e-11, "{name} {} {error}", scheme.name());
                assert_eq!(report.scale, 1.0);
                assert_eq!(allocations::count(|| scheme.step(&input, &mut qd).unwrap()), 0);
            }
            // The independent joints take the reduced wish; a new scheme has no change of basis to blend.
            let mut reduced = reduced.clone();
            reduced.step(&input, &mut qd).unwrap();
            let basis = reduced.basis().to_vec();
            let a = DMatrix::from_fn(6, 6, |i, k| j[(i, basis[k])]);
            let right = a.transpose().lu().solve(&DVector::from_fn(6, |k, _| wish[basis[k]])).unwrap();
            for k in (0..n).filter(|k| !basis.contains(k)) {
                let expected = wish[k] - j.column(k).dot(&right);
                assert!((qd[k] - expected).abs() < 1e-9 * (1.0 + expected.abs()));
            }
            assert!((&j * DVector::from_column_slice(&qd) - DVector::from_column_slice(&v)).amax() < 1e-11);
        }
        let wrong =
            StepInput { q: &[0.1; 8][..n], velocity: &[0.0; 6], dt: None, qd: None, wish: Some(&[0.0]) };
        assert!(projected.step(&wrong, &mut vec![0.0; n]).is_err());
    }
}

/// The conditions of Karush, Kuhn and Tucker prove a least error; beyond it the wish decides.
#[test]
fn a_blocked_task_is_approached_as_nearly_as_limits_allow() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let (mut blocked, mut moved) = (0, 0);
    for run in 0..amount(300, 3000) {
        let arm = catalog::load(if run % 2 == 0 { "iiwa14" } else { "dexter" }).unwrap();
        let n = arm.dof();
        let q = random_q(&mut rng, &arm);
        // Some joints are at a limit and may only go one way.
        let limits: Vec<Limits> = (q.iter())
            .map(|q| {
                let at = rng.random_range(0..3);
                let (below, above) = (f64::from(u8::from(at != 0)), f64::from(u8::from(at != 1)));
                let velocity = rng.random_range(0.2..2.0);
                Limits { lower: q - below, upper: q + above, velocity, ..Limits::NONE }
            })
            .collect();
        let arm = arm.with_limits(&limits).unwrap();
        let h: Arc<dyn Criterion> = Arc::new(JointRange::new(&arm));
        let make = |choice| {
            let scheme =
                SaturatedNullspace::new(&arm, Some(h.clone()), Gain::Constant(3.0), Task::POSE, None);
            scheme.unwrap().when_blocked(choice)
        };
        let (mut stop, mut closest) = (make(WhenBlocked::Stop), make(WhenBlocked::Closest));
        let v: [f64; 6] = std::array::from_fn(|_| rng.random_range(-0.5..0.5));
        let input = StepInput { q: &q, velocity: &v, dt: Some(0.01), qd: None, wish: None };
        let (mut qd, mut still) = (vec![0.0; n], vec![0.0; n]);
        let stopped = stop.step(&input, &mut still).unwrap();
        let report = closest.step(&input, &mut qd).unwrap();
        if stopped.scale > 1e-6 {
            assert_eq!((report.scale, &qd), (stopped.scale, &still));
            continue;
        }
        blocked += 1;
        assert_eq!(report.status, Status::Limits);
        let j = task_jacobian(&arm, &Task::POSE, &q);
        let error = &j * DVector::from_column_slice(&qd) - DVector::from_column_slice(&v);
        let slope = j.transpose() * &error;
        assert!((report.residual - error.norm()).abs() < 1e-12);
        let mut bounds = Vec::new();
        for i in 0..n {
            let (low, high) = stated_bounds(&limits[i], q[i], None, 0.01);
            assert!(qd[i] >= low - 1e-12 && qd[i] <= high + 1e-12);
            assert!(qd[i] < high - 1e-8 || slope[i] < 1e-8, "{run} joint {i} {}", slope[i]);
            assert!(qd[i] > low + 1e-8 || slope[i] > -1e-8, "{run} joint {i} {}", slope[i]);
            bounds.push((low, high));
        }
        moved += usize::from(error.norm() < 0.9 * DVector::from_column_slice(&v).norm());
        // Of the joint velocities with this error the one nearest to the desired one.
        let mut gradient = vec![0.0; n];
        h.gradient(&q, &mut gradient);
        let wish: Vec<f64> = gradient.iter().map(|g| 3.0 * g).collect();
        let done = &j * DVector::from_column_slice(&qd);
        if let Some(best) = clarabel(&DMatrix::identity(n, n), &wish, &j, done.as_slice(), &bounds) {
            let far = |x: &[f64]| x.iter().zip(&wish).map(|(x, w)| (x + w).powi(2)).sum::<f64>();
            // Beyond what clarabel's own tolerance explains the multipliers decide.
            if far(&qd) > far(&best) + 1e-6 {
                let rows = j.row_iter().map(|row| row.transpose()).flat_map(|row| [-&row, row]);
                let mut normals: Vec<DVector<f64>> = rows.collect();
                for (i, (low, high)) in bounds.iter().enumerate() {
                    for (bound, sign) in [(low, 1.0), (high, -1.0)] {
                        if (qd[i] - bound).abs() < 1e-9 {
                            normals.push(DVector::from_fn(n, |k, _| if k == i { sign } else { 0.0 }));
                        }
                    }
                }
                let slope = DVector::from_fn(n, |i, _| qd[i] + wish[i]);
                let missed = missed_conditions(&normals, &slope);
                assert!(missed < 1e-8, "{run} {} {} {missed}", far(&qd), far(&best));
            }
        }
        assert_eq!(allocations::count(|| closest.step(&input, &mut qd).unwrap()), 0);
    }
    assert!(blocked > 30 && moved > 10, "{blocked} {moved}");
}

/// Of a task's velocity along a motion, by central differences of `J qd`.
fn differenced(arm: &Chain, task: &Task, q: &[f64], qd: &[f64], qdd: &[f64]) -> DVector<f64> {
    let h = 1e-5;
    let at = |t: f64| {
        let place: Vec<f64> = (0..q.len()).map(|i| q[i] + t * qd[i] + 0.5 * t * t * qdd[i]).collect();
        let speed: Vec<f64> = (0..q.len()).map(|i| qd[i] + t * qdd[i]).collect();
        let mut scratch = Scratch::new(arm);
        let kinematics = arm.kinematics(&place, &mut scratch).unwrap();
        let twist = kinematics.jacobian() * DVector::from_column_slice(&speed);
        let pose = *kinematics.pose();
        // The coordinates of `pointing` belong to the pose at t = 0.
        let pose = if task.kind() == TaskKind::Pointing { arm.forward(q).unwrap() } else { pose };
        let out = task.from_twist(&pose, &Vector6::from_column_slice(twist.as_slice()));
        DVector::from_column_slice(&out.as_slice()[..task.dim()])
    };
    (at(h) - at(-h)) / (2.0 * h)
}

#[test]
fn accelerations_meet_the_task_for_every_inverse() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let mut worst = 0.0_f64;
    for name in ["dexter", "iiwa14"] {
        let arm = catalog::load(name).unwrap();
        let n = arm.dof();
        let h: Arc<dyn Criterion> = Arc::new(JointRange::new(&arm));
        for task in [Task::POSE, Task::POSE_RPY, Task::POSITION, Task::POINTING, Task::PLANAR_POSE] {
            let make = || {
                let scheme = ProjectedGradient::new(
                    &arm,
                    Some(h.clone()),
                    Gain::Constant(5.0),
                    task,
                    Some(Damping::default()),
                );
                scheme.unwrap().at_acceleration_level(10.0).unwrap()
            };
            let reduced = ReducedGradient::new(
                &arm,
                Some(h.clone()),
                Gain::Constant(5.0),
                task,
                Some(Damping::default()),
                None,
            );
            let weights: Vec<f64> = (0..n).map(|_| rng.random_range(0.2..5.0)).collect();
            let mut schemes: Vec<Box<dyn Resolver>> = vec![
                make().boxed(),
                make().with_metric(Metric::Weights(weights)).unwrap().boxed(),
                reduced.unwrap().at_acceleration_level(10.0).unwrap().boxed(),
            ];
            if arm.inertias().is_some() {
                schemes.push(make().with_metric(Metric::Inertia).unwrap().boxed());
            }
            for _ in 0..20 {
                let q = random_q(&mut rng, &arm);
                if sigma_min(&arm, &task, &q).unwrap() < 0.15 {
                    continue;
                }
                let qd: Vec<f64> = (0..n).map(|_| rng.random_range(-1.0..1.0)).collect();
                let a: Vec<f64> = (0..task.velocity_len()).map(|_| rng.random_range(-1.0..1.0)).collect();
                let asked = task.velocity(&arm.forward(&q).unwrap(), &a).unwrap();
                let mut scratch = Scratch::new(&arm);
                let kinematics = arm.kinematics(&q, &mut scratch).unwrap();
                let product = task.velocity_product(&kinematics, &qd);
                let j = task_jacobian(&arm, &task, &q);
                for scheme in &mut schemes {
                    let mut qdd = vec![0.0; n];
                    let input = AccelerationInput { q: &q, qd: &qd, acceleration: &a, dt: None, wish: None };
                    let report = scheme.step_acceleration(&input, &mut qdd).unwrap();
                    if report.status != Status::Converged {
                        continue;
                    }
                    let met = &j * DVector::from_column_slice(&qdd);
                    for i in 0..task.dim() {
                        let size = 1.0 + met[i].abs() + product[i].abs();
                        worst = worst.max((met[i] + product[i] - asked[i]).abs() / size);
                    }
                    let seen = differenced(&arm, &task, &q, &qd, &qdd);
                    for i in 0..task.dim() {
                        let error = (seen[i] - asked[i]).abs();
                        assert!(error < 1e-5 * (1.0 + seen.amax() + product.amax()), "{name} {task} {error}");
                    }
                    assert_eq!(allocations::count(|| scheme.step_acceleration(&input, &mut qdd).unwrap()), 0);
                }
            }
        }
    }
    assert!(worst < 1e-12, "{worst}");
}

#[test]
fn inverses_are_least_in_their_metric() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let arm = catalog::load("iiwa14").unwrap();
    let h: Arc<dyn Criterion> = Arc::new(Posture::new(&[0.1; 7]).unwrap());
    let weights: Vec<f64> = (0..7).map(|_| rng.random_range(0.2..5.0)).collect();
    let (mut scratch, mut derivatives) = (DynamicsScratch::new(&arm), TorqueDerivatives::new(7));
    for metric in [Metric::Weights(weights.clone()), Metric::Inertia] {
        let make = || {
            ProjectedGradient::new(&arm, Some(h.clone()), Gain::Constant(2.0), Task::POSE, None)
                .unwrap()
                .with_metric(metric.clone())
                .unwrap()
        };
        let (mut velocity, mut acceleration) = (make(), make().at_acceleration_level(4.0).unwrap());
        for _ in 0..30 {
            let q = random_q(&mut rng, &arm);
            if sigma_min(&arm, &Task::POSE, &q).unwrap() < 0.1 {
                continue;
            }
            let zero = [0.0; 7];
            arm.inverse_dynamics_derivatives(
                &q,
                &zero,
                &zero,
                &Vector3::zeros(),
                &mut scratch,
                &mut derivatives,
            )
            .unwrap();
            let w = match &metric {
                Metric::Inertia => derivatives.qdd.clone(),
                _ => DMatrix::from_diagonal(&DVector::from_column_slice(&weights)),
            };
            let j = task_jacobian(&arm, &Task::POSE, &q);
            let inverse = w.clone().try_inverse().unwrap();
            let consistent =
                &inverse * j.transpose() * (&j * &inverse * j.transpose()).try_inverse().unwrap();
            let eta = DVector::from_fn(7, |i, _| 2.0 * (0.1 - q[i]));
            let v = DVector::from_fn(6, |_, _| rng.random_range(-1.0..1.0));
            let mut qd = vec![0.0; 7];
            let input = StepInput { q: &q, velocity: v.as_slice(), dt: None, qd: None, wish: None };
            velocity.step(&input, &mut qd).unwrap();
            let expected = &eta + &consistent * (&v - &j * &eta);
            let size = 1.0 + expected.amax();
            assert!((DVector::from_column_slice(&qd) - expected).amax() < 1e-10 * size, "{metric:?}");
            // At acceleration level, from the joint velocity that the velocity level has.
            let mut kinematic = Scratch::new(&arm);
            let product = Task::POSE.velocity_product(&arm.kinematics(&q, &mut kinematic).unwrap(), &qd);
            let eta = (&eta - DVector::from_column_slice(&qd)) * 4.0;
            let b = &v - DVector::from_column_slice(product.as_slice());
            let expected = &eta + &consistent * (&b - &j * &eta);
            let input =
                AccelerationInput { q: &q, qd: &qd, acceleration: v.as_slice(), dt: None, wish: None };
            let mut qdd = vec![0.0; 7];
            acceleration.step_acceleration(&input, &mut qdd).unwrap();
            let size = 1.0 + expected.amax();
            assert!((DVector::from_column_slice(&qdd) - expected).amax() < 1e-10 * size);
        }
        let still = [0.0; 7];
        let input = StepInput { q: &still, velocity: &[0.0; 6], dt: None, qd: None, wish: None };
        let refused = acceleration.step(&input, &mut [0.0; 7]).unwrap_err().to_string();
        assert!(refused.contains("step_acceleration"), "{refused}");
        let input =
            AccelerationInput { q: &still, qd: &still, acceleration: &[0.0; 6], dt: None, wish: None };
        assert!(velocity.step_acceleration(&input, &mut [0.0; 7]).is_err());
    }
    let wrong = ProjectedGradient::new(&arm, None, Gain::Constant(0.0), Task::POSE, None).unwrap();
    assert!(wrong.clone().with_metric(Metric::Weights(vec![0.0; 7])).is_err());
    assert!(wrong.at_acceleration_level(0.0).is_err());
}
