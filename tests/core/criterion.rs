//! Criteria against differences, and what they promise.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use redundancy_core::chain::{Chain, catalog};
use redundancy_core::criterion::{Criterion, Manipulability, Measure, Sense, Weighted};
use redundancy_core::kinematics::{Scratch, Task, TaskKind};
use redundancy_core::nalgebra::{DMatrix, DVector};
use std::sync::Arc;

use super::allocations;

fn arms() -> Vec<Chain> {
    let mut arms: Vec<Chain> = catalog::names().map(|name| catalog::load(name).unwrap()).collect();
    // Has a sliding joint.
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

fn gradient(h: &dyn Criterion, q: &[f64]) -> DVector<f64> {
    let mut out = DVector::zeros(q.len());
    h.gradient(q, out.as_mut_slice());
    out
}

fn hessian(h: &dyn Criterion, q: &[f64]) -> DMatrix<f64> {
    let mut out = DMatrix::zeros(q.len(), q.len());
    h.hessian(q, &mut out);
    out
}

fn moved(q: &[f64], joint: usize, step: f64) -> Vec<f64> {
    let mut q = q.to_vec();
    q[joint] += step;
    q
}

/// Largest errors of gradient and Hessian against central differences, relative to `1 +` their size.
pub fn against_differences(h: &dyn Criterion, q: &[f64], step: f64) -> (f64, f64) {
    let (g, hh) = (gradient(h, q), hessian(h, q));
    let (mut first, mut second) = (0.0f64, 0.0f64);
    for k in 0..q.len() {
        let (plus, minus) = (moved(q, k, step), moved(q, k, -step));
        first = first.max((g[k] - (h.value(&plus) - h.value(&minus)) / (2.0 * step)).abs());
        let column = (gradient(h, &plus) - gradient(h, &minus)) / (2.0 * step);
        second = second.max((hh.column(k) - column).amax());
    }
    (first / (1.0 + g.amax()), second / (1.0 + hh.amax()))
}

#[test]
fn manipulability_is_the_determinant() {
    let mut rng = ChaCha8Rng::seed_from_u64(20);
    for arm in arms() {
        let mut scratch = Scratch::new(&arm);
        for task in tasks() {
            let h = Manipulability::new(&arm, task);
            let root = Manipulability::with_measure(&arm, task, Measure::Sqrt);
            assert_eq!((h.sense(), h.dof()), (Sense::Maximize, arm.dof()));
            for _ in 0..20 {
                let q: Vec<f64> = (0..arm.dof()).map(|_| rng.random_range(-3.0..3.0)).collect();
                let kinematics = arm.kinematics(&q, &mut scratch).unwrap();
                let mut j = DMatrix::zeros(task.dim(), arm.dof());
                task.write_jacobian(&kinematics, j.as_mut_slice());
                let expected = (&j * j.transpose()).determinant();
                let size = j.norm_squared().powi(task.dim() as i32);
                let error = (h.value(&q) - expected).abs();
                assert!(error < 1e-13 * size, "{} {task}: {} {expected}", arm.name(), h.value(&q));
                assert_eq!(root.value(&q), h.value(&q).sqrt());
            }
        }
    }
}

#[test]
fn manipulability_against_differences() {
    let mut rng = ChaCha8Rng::seed_from_u64(21);
    for arm in arms() {
        for task in tasks() {
            for measure in Measure::ALL {
                let h = Manipulability::with_measure(&arm, task, measure);
                let mut done = 0;
                while done < 20 {
                    let q: Vec<f64> = (0..arm.dof()).map(|_| rng.random_range(-3.0..3.0)).collect();
                    // The root bends without bound towards singularities, the rates of roll-pitch-yaw do so too.
                    let z = arm.forward(&q).unwrap().rotation[(2, 0)];
                    if task.kind() == TaskKind::PoseRpy && z.abs() > 0.9 {
                        continue;
                    }
                    done += 1;
                    let value = h.value(&q);
                    if measure == Measure::Sqrt && value < 1e-3 {
                        continue;
                    }
                    let (first, second) = against_differences(&h, &q, 1e-5);
                    assert!(first < 1e-7, "{} {task} {measure:?} gradient: {first:e}", arm.name());
                    assert!(second < 1e-6, "{} {task} {measure:?} Hessian: {second:e}", arm.name());
                }
            }
        }
    }
}

/// At singular configurations of every kind: gradient and Hessian are finite and those of the determinant.
#[test]
fn manipulability_at_singular_configurations() {
    for arm in arms() {
        let n = arm.dof();
        let mut shapes = vec![vec![0.0; n], vec![std::f64::consts::FRAC_PI_2; n]];
        shapes.extend((0..n).map(|k| moved(&vec![0.4; n], k, -0.4)));
        for q in &shapes {
            for task in tasks() {
                let h = Manipulability::new(&arm, task);
                let z = arm.forward(q).unwrap().rotation[(2, 0)];
                if task.kind() == TaskKind::PoseRpy && z.abs() > 0.9 {
                    continue;
                }
                let (first, second) = against_differences(&h, q, 1e-4);
                assert!(first < 1e-6, "{} {task} {q:?} gradient: {first:e}", arm.name());
                assert!(second < 1e-5, "{} {task} {q:?} Hessian: {second:e}", arm.name());
                let root = Manipulability::with_measure(&arm, task, Measure::Sqrt);
                assert!(gradient(&root, q).iter().chain(hessian(&root, q).iter()).all(|x| x.is_finite()));
            }
        }
    }
    // Determinants of few joints for many coordinates vanish identically.
    let arm = catalog::load("planar3r").unwrap();
    let h = Manipulability::new(&arm, Task::POSE);
    assert_eq!(gradient(&h, &[0.1, 0.2, 0.3]).amax(), 0.0);
}

#[test]
fn manipulability_in_a_control_step() {
    let mut rng = ChaCha8Rng::seed_from_u64(22);
    for arm in arms() {
        let n = arm.dof();
        let mut scratch = Scratch::new(&arm);
        for task in tasks() {
            let h: Arc<dyn Criterion> = Arc::new(Manipulability::new(&arm, task));
            let sum =
                Weighted::sum(h.clone(), Arc::new(Weighted::multiple(2.0, h.clone()).unwrap())).unwrap();
            assert_eq!(sum.chain(), Some(&arm));
            assert_eq!(Weighted::multiple(-1.0, h.clone()).unwrap().sense(), Sense::Minimize);
            let mut out = vec![0.0; n];
            for q in [vec![0.0; n], (0..n).map(|_| rng.random_range(-3.0..3.0)).collect()] {
                let kinematics = arm.kinematics(&q, &mut scratch).unwrap();
                assert_eq!(allocations::count(|| sum.gradient_at(&q, &kinematics, &mut out)), 0);
                let expected = gradient(&*h, &q) * 3.0;
                assert!((DVector::from_column_slice(&out) - &expected).amax() <= 1e-15 * expected.amax());
                let (mut first, mut second) = (vec![0.0; n], DMatrix::zeros(n, n));
                let count =
                    allocations::count(|| h.second_order_at(&q, &kinematics, &mut first, &mut second));
                assert_eq!(count, 0);
                assert_eq!((DVector::from_vec(first), second), (gradient(&*h, &q), hessian(&*h, &q)));
                let (mut first, mut second) = (vec![0.0; n], DMatrix::zeros(n, n));
                sum.second_order_at(&q, &kinematics, &mut first, &mut second);
                assert_eq!((DVector::from_vec(first), second), (gradient(&sum, &q), hessian(&sum, &q)));
            }
        }
    }
}
