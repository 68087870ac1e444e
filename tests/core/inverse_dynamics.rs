//! Torques: derivatives against differences, batches, without allocating. Agreement with pinocchio is in tests/python.

use rand::Rng;
use redundancy_core::chain::{Chain, MissingLimits, catalog};
use redundancy_core::kinematics::{DynamicsScratch, TorqueDerivatives};
use redundancy_core::nalgebra::{DMatrix, Vector3};

use crate::allocations;
use crate::support::{amount, rng};

const GRAVITY: Vector3<f64> = Vector3::new(0.4, -0.3, -9.7);

fn arms() -> Vec<Chain> {
    let mut arms: Vec<Chain> =
        ["puma560", "iiwa14", "panda"].iter().map(|name| catalog::load(name).unwrap()).collect();
    let urdf = include_str!("../data/arm.urdf");
    let mixed = Chain::from_urdf_string(urdf, Some("world"), Some("flange"), MissingLimits::Refuse).unwrap();
    arms.extend(mixed.inertias().is_some().then_some(mixed));
    arms
}

fn random(rng: &mut impl Rng, n: usize) -> Vec<f64> {
    (0..n).map(|_| rng.random_range(-3.0..3.0)).collect()
}

fn torques(arm: &Chain, x: &[Vec<f64>; 3]) -> Vec<f64> {
    let mut tau = vec![0.0; arm.dof()];
    let mut scratch = DynamicsScratch::new(arm);
    arm.inverse_dynamics(&x[0], &x[1], &x[2], &GRAVITY, &mut scratch, &mut tau).unwrap();
    tau
}

#[test]
fn derivatives_against_central_differences() {
    let mut rng = rng(11);
    for arm in arms() {
        let n = arm.dof();
        let (mut scratch, mut out) = (DynamicsScratch::new(&arm), TorqueDerivatives::new(n));
        for _ in 0..amount(100, 2_000) {
            let x = [random(&mut rng, n), random(&mut rng, n), random(&mut rng, n)];
            arm.inverse_dynamics_derivatives(&x[0], &x[1], &x[2], &GRAVITY, &mut scratch, &mut out).unwrap();
            for (which, exact) in [&out.q, &out.qd, &out.qdd].into_iter().enumerate() {
                let h = 1e-5;
                let mut difference = DMatrix::zeros(n, n);
                for j in 0..n {
                    let at = |step: f64| {
                        let mut x = x.clone();
                        x[which][j] += step;
                        torques(&arm, &x)
                    };
                    for (i, (plus, minus)) in at(h).iter().zip(at(-h)).enumerate() {
                        difference[(i, j)] = (plus - minus) / (2.0 * h);
                    }
                }
                let scale = 1.0 + exact.amax();
                assert!((exact - &difference).amax() < 1e-7 * scale, "{} {which}", arm.name());
            }
        }
    }
}

#[test]
fn power_of_the_torques_is_the_change_of_energy() {
    // qd . (tau - gravity part) = d/dt of qd^T M qd / 2, along a parabola in joint space.
    let mut rng = rng(12);
    for arm in arms() {
        let n = arm.dof();
        let [q, qd, qdd] = [random(&mut rng, n), random(&mut rng, n), random(&mut rng, n)];
        let energy = |t: f64| {
            let at: Vec<f64> = (0..n).map(|j| q[j] + t * qd[j] + 0.5 * t * t * qdd[j]).collect();
            let speed: Vec<f64> = (0..n).map(|j| qd[j] + t * qdd[j]).collect();
            let (mut scratch, mut out) = (DynamicsScratch::new(&arm), TorqueDerivatives::new(n));
            let zero = vec![0.0; n];
            arm.inverse_dynamics_derivatives(&at, &zero, &zero, &GRAVITY, &mut scratch, &mut out).unwrap();
            let v = redundancy_core::nalgebra::DVector::from_vec(speed);
            0.5 * v.dot(&(&out.qdd * &v))
        };
        let h = 1e-5;
        let change = (energy(h) - energy(-h)) / (2.0 * h);
        let moving = torques(&arm, &[q.clone(), qd.clone(), qdd.clone()]);
        let holding = torques(&arm, &[q, vec![0.0; n], vec![0.0; n]]);
        let power: f64 = (0..n).map(|j| qd[j] * (moving[j] - holding[j])).sum();
        assert!((power - change).abs() < 1e-6 * (1.0 + change.abs()), "{}: {power} {change}", arm.name());
    }
}

#[test]
fn batches_are_single_calls_and_nothing_allocates() {
    let mut rng = rng(13);
    for arm in arms() {
        let (n, rows) = (arm.dof(), 500);
        let x = [random(&mut rng, n * rows), random(&mut rng, n * rows), random(&mut rng, n * rows)];
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut out = vec![0.0; n * rows];
            pool.install(|| arm.inverse_dynamics_batch(&x[0], &x[1], &x[2], &GRAVITY, &mut out)).unwrap();
            out
        };
        let one = run(1);
        assert_eq!(one, run(3));
        let (mut scratch, mut tau) = (DynamicsScratch::new(&arm), vec![0.0; n]);
        let mut derivatives = TorqueDerivatives::new(n);
        let times = allocations::count(|| {
            for k in 0..rows {
                let [q, qd, qdd] = [&x[0], &x[1], &x[2]].map(|x| &x[k * n..(k + 1) * n]);
                arm.inverse_dynamics(q, qd, qdd, &GRAVITY, &mut scratch, &mut tau).unwrap();
                assert_eq!(tau, one[k * n..(k + 1) * n]);
                arm.inverse_dynamics_derivatives(q, qd, qdd, &GRAVITY, &mut scratch, &mut derivatives)
                    .unwrap();
            }
        });
        assert_eq!(times, 0);
    }
}

#[test]
fn what_is_wrong_is_named() {
    let arm = catalog::load("puma560").unwrap();
    let (mut scratch, mut tau) = (DynamicsScratch::new(&arm), [0.0; 6]);
    let zero = [0.0; 6];
    let text = |result: redundancy_core::Result<()>| result.unwrap_err().to_string();
    let short = text(arm.inverse_dynamics(&zero, &[0.0; 5], &zero, &GRAVITY, &mut scratch, &mut tau));
    assert!(short.contains("qd: expected 6 entries, got 5"), "{short}");
    let nan = Vector3::new(f64::NAN, 0.0, 0.0);
    assert!(
        text(arm.inverse_dynamics(&zero, &zero, &zero, &nan, &mut scratch, &mut tau)).contains("gravity")
    );
    let mut small = [0.0; 3];
    assert!(
        text(arm.inverse_dynamics(&zero, &zero, &zero, &GRAVITY, &mut scratch, &mut small)).contains("got 3")
    );
    let mut other = DynamicsScratch::new(&catalog::load("iiwa14").unwrap());
    assert!(
        text(arm.inverse_dynamics(&zero, &zero, &zero, &GRAVITY, &mut other, &mut tau)).contains("scratch")
    );
    let mut wrong = TorqueDerivatives::new(7);
    let refused = arm.inverse_dynamics_derivatives(&zero, &zero, &zero, &GRAVITY, &mut scratch, &mut wrong);
    assert!(text(refused).contains("expected 36 entries, got 49"));
    let bare = catalog::load("pa10").unwrap();
    let mut bare_scratch = DynamicsScratch::new(&bare);
    let (zero, mut tau) = ([0.0; 7], [0.0; 7]);
    let none = text(bare.inverse_dynamics(&zero, &zero, &zero, &GRAVITY, &mut bare_scratch, &mut tau));
    assert!(none.contains("'pa10' has no inertias") && none.contains("<inertial>"), "{none}");
}
