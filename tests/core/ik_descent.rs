//! The best value of one joint, and the five descent algorithms.

#![allow(clippy::print_stderr)] // rates beside the expected ones, with --nocapture

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use rand::Rng;
use redundancy_core::chain::{Chain, ChainBuilder, DhConvention, DhRow, JointKind, Limits, catalog};
use redundancy_core::ik::{
    Attraction, CostMeasure, CostWeights, DescentMethod, DescentSettings, GradientKind, HalfAngle, IkMethod,
    IkSettings, IkSolver, Sinusoid, SweepOrder, default_joint_weights, pose_cost, quaternion_cost,
    slide_within,
};
use redundancy_core::nalgebra::{Matrix6, Rotation3, Translation3, UnitQuaternion, Vector3, Vector6};
use redundancy_core::rotation::from_wxyz;
use redundancy_core::{Pose, Status};

use crate::support::{amount, random_pose, random_q, rng, unit};

fn pose(p: [f64; 3], wxyz: [f64; 4]) -> Pose {
    Pose::from_parts(Translation3::from(Vector3::from(p)), from_wxyz(wxyz).unwrap().to_rotation_matrix())
}

/// Cost of axes by its definition: distances of the point and of the three unit vectors.
fn axes_cost(pose: &Pose, target: &Pose, w: &CostWeights) -> f64 {
    let d = (pose.translation.vector - target.translation.vector).norm_squared();
    w.position * d + w.orientation * (pose.rotation.matrix() - target.rotation.matrix()).norm_squared()
}

/// The pose after the joint has turned by `psi`.
fn turned(pose: &Pose, axis: &Vector3<f64>, origin: &Vector3<f64>, psi: f64) -> Pose {
    let turn = Rotation3::from_scaled_axis(axis * psi);
    let p = origin + turn * (pose.translation.vector - origin);
    Pose::from_parts(Translation3::from(p), turn * pose.rotation)
}

#[test]
fn vector_computed_independently() {
    let axis = Vector3::new(1.0, 2.0, 2.0) / 3.0;
    let origin = Vector3::new(0.1, -0.2, 0.3);
    let from = pose([0.5, 0.4, -0.1], [0.5, 0.5, 0.5, 0.5]);
    let to = pose([-0.2, 0.3, 0.6], [0.8, 0.0, 0.6, 0.0]);
    let weights = CostWeights { position: 2.0, orientation: 0.5 };
    let g = pose_cost(&axis, &origin, &from, &to, &weights);
    for (value, expected) in [
        (g.constant, 4.508888888888889),
        (g.cos, -0.488888888888889),
        (g.sin, -0.493333333333333),
        (g.minimum().0, 0.7899230193939042),
        (g.minimum().1, 3.8143457847860613),
    ] {
        assert!((value - expected).abs() < 1e-14, "{value} {expected}");
    }
    let g = quaternion_cost(&axis, &origin, &from, &to, &weights);
    let (psi, value) = g.minimum();
    assert!((psi - 1.472141448515392).abs() < 1e-13 && (value - 0.9944508960034008).abs() < 1e-14);
}

#[test]
fn costs_of_one_joint_are_what_moving_it_costs() {
    let mut rng = rng(20);
    for _ in 0..amount(300, 10_000) {
        let (axis, origin) =
            (unit(&mut rng).into_inner(), Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0)));
        let (from, to) = (random_pose(&mut rng, 1.0), random_pose(&mut rng, 1.0));
        let w =
            CostWeights { position: rng.random_range(0.0..10.0), orientation: rng.random_range(0.0..10.0) };
        let axes = pose_cost(&axis, &origin, &from, &to, &w);
        let quaternions = quaternion_cost(&axis, &origin, &from, &to, &w);
        let d = UnitQuaternion::from_rotation_matrix(&to.rotation);
        let c = UnitQuaternion::from_rotation_matrix(&from.rotation);
        for _ in 0..10 {
            let psi = rng.random_range(-TAU..TAU);
            let after = turned(&from, &axis, &origin, psi);
            assert!((axes.at(psi) - axes_cost(&after, &to, &w)).abs() < 1e-12);
            let carried = UnitQuaternion::from_scaled_axis(axis * psi).into_inner() * c.into_inner();
            let distance = (carried.coords - d.coords).norm_squared();
            let position = w.position * (after.translation.vector - to.translation.vector).norm_squared();
            assert!((quaternions.at(psi) - position - w.orientation * distance).abs() < 1e-12);
        }
        // A sliding joint against brute force.
        let (p, pd) = (from.translation.vector, to.translation.vector);
        let (low, high) = (-rng.random_range(0.0..2.0), rng.random_range(0.0..2.0));
        let (x, fall) = slide_within(&axis, &p, &pd, w.position, low, high);
        let cost = |x: f64| w.position * (p + axis * x - pd).norm_squared();
        assert!((cost(0.0) - cost(x) - fall).abs() < 1e-12 && (low..=high).contains(&x));
        for k in 0..=100 {
            assert!(cost(low + (high - low) * f64::from(k) / 100.0) >= cost(x) - 1e-12);
        }
    }
}

#[test]
fn minima_are_global_and_limits_hold() {
    let mut rng = rng(21);
    for k in 0..amount(400, 20_000) {
        // Amplitudes of very different sizes, and zeros.
        let mut draw = || {
            let zero = rng.random_bool(0.15);
            let size = 10.0_f64.powf(rng.random_range(-9.0..1.0));
            if zero { 0.0 } else { size * rng.random_range(-1.0..1.0_f64) }
        };
        let whole = Sinusoid { constant: draw(), cos: draw(), sin: draw() };
        let g = HalfAngle { whole, half_cos: draw(), half_sin: draw() };
        let size = whole.cos.abs() + whole.sin.abs() + g.half_cos.abs() + g.half_sin.abs();
        let slack = 1e-14 * (size + whole.constant.abs());
        let low = -rng.random_range(0.0..9.0);
        let high = rng.random_range(0.0..9.0);
        let samples: Vec<f64> = (0..=4_000).map(|i| f64::from(i) / 4_000.0).collect();

        let (psi, value) = whole.minimum();
        assert!((whole.at(psi) - value).abs() <= slack && psi > -PI && psi <= PI);
        assert!((whole.at(0.0) - value - whole.decrease()).abs() <= slack);
        assert!(samples.iter().all(|t| whole.at(TAU * t) >= value - slack));
        let (psi, fall) = whole.minimum_within(low, high);
        assert!(psi >= low && psi <= high && (whole.at(0.0) - whole.at(psi) - fall).abs() <= slack);
        assert!(samples.iter().all(|t| whole.at(low + (high - low) * t) >= whole.at(psi) - slack), "{k}");

        let (psi, value) = g.minimum();
        assert!((g.at(psi) - value).abs() <= slack && psi > -TAU && psi <= TAU);
        assert!(samples.iter().all(|t| g.at(2.0 * TAU * t) >= value - slack), "{k} {g:?} {psi} {value}");
        let (psi, fall) = g.minimum_within(low, high);
        assert!(psi >= low && psi <= high && (g.at(0.0) - g.at(psi) - fall).abs() <= slack);
        assert!(samples.iter().all(|t| g.at(low + (high - low) * t) >= g.at(psi) - slack), "{k} {g:?}");
        for psi in g.stationary_points() {
            let h = 1e-5;
            assert!(((g.at(psi + h) - g.at(psi - h)) / (2.0 * h)).abs() < 1e-9 * (1.0 + size), "{psi} {g:?}");
        }
    }
    // Where the decrease a + h cancels: b^2 / (h - a) keeps its digits.
    let tiny = Sinusoid { constant: 1.0, cos: -1.0, sin: 1e-9 };
    assert!((tiny.decrease() / 5e-19 - 1.0).abs() < 1e-9);
    assert_eq!(Sinusoid::default().minimum(), (0.0, 0.0));
    assert_eq!(HalfAngle::default().minimum(), (0.0, 0.0));
    // The real form in tan(psi / 4) would lose psi = 2 pi.
    let far =
        HalfAngle { whole: Sinusoid { constant: 0.0, cos: 0.1, sin: 0.0 }, half_cos: 1.0, half_sin: 0.0 };
    assert!((far.minimum().0.abs() - TAU).abs() < 1e-7);
}

/// The arm of the measurements: PUMA 560 with d6 = .05625, without limits.
fn puma() -> Chain {
    let row = |a, d, alpha| DhRow { a, d, alpha, theta: 0.0 };
    let rows = [
        row(0.0, 0.0, FRAC_PI_2),
        row(0.4318, 0.0, 0.0),
        row(0.0203, 0.15005, -FRAC_PI_2),
        row(0.0, 0.4318, FRAC_PI_2),
        row(0.0, 0.0, -FRAC_PI_2),
        row(0.0, 0.05625, 0.0),
    ];
    ChainBuilder::from_dh("puma", &rows, DhConvention::Standard).build().unwrap()
}

fn solver(chain: &Chain, method: DescentMethod, iterations: usize, descent: DescentSettings) -> IkSolver {
    let settings = IkSettings {
        method: IkMethod::Descent(method),
        max_iterations: iterations,
        restarts: 0,
        descent,
        ..IkSettings::default()
    };
    IkSolver::new(chain, settings).unwrap()
}

const DESCENTS: [DescentMethod; 3] =
    [DescentMethod::CoordinateDescent, DescentMethod::GaussSouthwell, DescentMethod::GaussSouthwellRate];

#[test]
fn algorithms_1_to_3_never_raise_the_cost() {
    // With and without limits, both measures, all orders, a secondary term, a sliding joint.
    let slider = ChainBuilder::new("slider", "base")
        .joint(
            "x",
            JointKind::Prismatic,
            Pose::identity(),
            Vector3::x(),
            Limits { lower: -0.5, upper: 0.7, ..Limits::NONE },
        )
        .joint(
            "a",
            JointKind::Revolute,
            Pose::identity(),
            Vector3::z(),
            Limits { lower: -2.0, upper: 2.5, ..Limits::NONE },
        )
        .joint(
            "b",
            JointKind::Revolute,
            Pose::translation(0.4, 0.0, 0.0),
            Vector3::y(),
            Limits { lower: -1.0, upper: 7.0, ..Limits::NONE },
        )
        .joint("c", JointKind::Continuous, Pose::translation(0.3, 0.0, 0.1), Vector3::x(), Limits::NONE)
        .link("tip", Pose::translation(0.2, 0.0, 0.0))
        .build()
        .unwrap();
    let mut rng = rng(22);
    let mut sweeps = 0;
    let wanted = amount(1_000, 10_000);
    for chain in [puma(), catalog::load("panda").unwrap(), slider] {
        for method in DESCENTS {
            let mut count = 0;
            while count < wanted {
                let order = SweepOrder::ALL[rng.random_range(0..3)];
                let measure = CostMeasure::ALL[rng.random_range(0..2)];
                let attractions = if rng.random_bool(0.5) {
                    let link = rng.random_range(1..chain.links().len());
                    let target = std::array::from_fn(|_| rng.random_range(-0.5..0.5));
                    vec![Attraction { link, target, weight: rng.random_range(-1.0..3.0) }]
                } else {
                    vec![]
                };
                let weights = CostWeights {
                    position: rng.random_range(0.1..10.0),
                    orientation: rng.random_range(0.1..10.0),
                };
                let settings =
                    DescentSettings { order, measure, attractions, weights, ..DescentSettings::default() };
                let solver = solver(&chain, method, 20, settings);
                let target = chain.forward(&random_q(&mut rng, &chain)).unwrap();
                let trace = solver.trace(&target, &random_q(&mut rng, &chain)).unwrap();
                for pair in trace.cost.windows(2) {
                    assert!(
                        pair[1] <= pair[0] + 1e-12 * (1.0 + pair[0].abs()),
                        "{method:?} {order:?} {measure:?} {pair:?}"
                    );
                }
                assert!(chain.within_limits(&trace.q, 0.0));
                count += trace.cost.len() - 1;
            }
            sweeps += count;
        }
    }
    assert!(sweeps >= 9 * wanted);
}

/// What is traced is what forward kinematics gives, and the secondary term pulls.
#[test]
fn traces_are_measured_and_attractions_attract() {
    let chain = catalog::load("iiwa14").unwrap();
    let mut rng = rng(23);
    let elbow = chain.link_index("link_4").unwrap();
    let place = [0.3, 0.3, 0.6];
    let far =
        |q: &[f64]| (chain.forward_link(q, elbow).unwrap().translation.vector - Vector3::from(place)).norm();
    let (mut with, mut without) = (0.0, 0.0);
    for method in DescentMethod::ALL {
        for _ in 0..20 {
            let target = chain.forward(&random_q(&mut rng, &chain)).unwrap();
            let q0 = random_q(&mut rng, &chain);
            let plain = solver(&chain, method, 60, DescentSettings::default()).trace(&target, &q0).unwrap();
            let last = chain.forward(&plain.q).unwrap();
            let cost = axes_cost(&last, &target, &CostWeights::default());
            assert!((cost - plain.cost.last().unwrap()).abs() < 1e-10 * (1.0 + cost), "{method:?}");
            let first = axes_cost(&chain.forward(&q0).unwrap(), &target, &CostWeights::default());
            assert!((first - plain.cost[0]).abs() < 1e-10 * (1.0 + first));
            let pulled = DescentSettings {
                attractions: vec![Attraction { link: elbow, target: place, weight: 5.0 }],
                ..DescentSettings::default()
            };
            let pulled = solver(&chain, method, 60, pulled).trace(&target, &q0).unwrap();
            (with, without) = (with + far(&pulled.q), without + far(&plain.q));
        }
    }
    assert!(with < 0.8 * without, "{with} {without}");
}

/// Damped least squares: lambda .05, 500 iterations.
fn damped_least_squares(chain: &Chain, target: &Pose, q0: &[f64], tolerance: [f64; 2]) -> [bool; 2] {
    let mut q = q0.to_vec();
    let mut scratch = redundancy_core::kinematics::Scratch::new(chain);
    let mut reached = [false; 2];
    for _ in 0..500 {
        let kinematics = chain.kinematics(&q, &mut scratch).unwrap();
        let d = target.translation.vector - kinematics.pose().translation.vector;
        let r = (target.rotation * kinematics.pose().rotation.inverse()).scaled_axis();
        let miss = d.norm().max(r.norm());
        for (hit, tolerance) in reached.iter_mut().zip(tolerance) {
            *hit |= miss < tolerance;
        }
        if reached[1] {
            break;
        }
        let j = kinematics.jacobian();
        let a = j * j.transpose() + Matrix6::identity() * 0.05_f64.powi(2);
        let e = Vector6::new(d.x, d.y, d.z, r.x, r.y, r.z);
        let step = j.transpose() * a.cholesky().unwrap().solve(&e);
        q.iter_mut().zip(step.iter()).for_each(|(q, s)| *q += s);
    }
    reached
}

/// Expected success rates, under their conditions; within 4 points on 5 000 targets (12 on the small sample).
#[test]
fn success_rates_are_the_expected_ones() {
    let chain = puma();
    let n = amount(120, 5_000);
    let points = if n < 5_000 { 12.0 } else { 4.0 };
    let mut rng = rng(24);
    let cases: Vec<(Pose, Vec<f64>)> = (0..n)
        .map(|_| {
            let q: Vec<f64> = (0..6).map(|_| rng.random_range(-PI..PI)).collect();
            (chain.forward(&q).unwrap(), (0..6).map(|_| rng.random_range(-PI..PI)).collect())
        })
        .collect();
    let shares = Some(vec![1.0, 0.5, 0.5, 0.3, 0.3, 0.3]);
    assert_eq!(Some(default_joint_weights(6)), shares);
    let estimate = DescentSettings { gradient: GradientKind::Estimate, ..DescentSettings::default() };
    let rows = [
        (DescentMethod::CoordinateDescent, 2_000, DescentSettings::default(), [95.0, 79.0]),
        (DescentMethod::GaussSouthwell, 6_000, DescentSettings::default(), [93.0, 75.0]),
        (DescentMethod::GaussSouthwellRate, 6_000, DescentSettings::default(), [93.0, 75.0]),
        (DescentMethod::WeightedDescent, 2_000, DescentSettings::default(), [75.0, 57.5]),
        (DescentMethod::GradientEstimate, 2_000, estimate, [0.0, 0.0]),
    ];
    for (method, cap, settings, expected) in rows {
        let solver = solver(&chain, method, cap, settings);
        // As printed algorithm 5 stalls: 200 targets, as in the table.
        let cases = if method == DescentMethod::GradientEstimate { &cases[..n.min(200)] } else { &cases[..] };
        let mut hits = [0, 0];
        for (target, q0) in cases {
            let trace = solver.trace(target, q0).unwrap();
            let best = |tolerance: f64| {
                trace.position_error.iter().zip(&trace.orientation_error).any(|(p, o)| p.max(*o) < tolerance)
            };
            // The solver's own tolerance is 1e-6 each.
            hits[0] += usize::from(best(1e-3));
            hits[1] += usize::from(best(1.000_001e-6));
        }
        for (hit, expected) in hits.iter().zip(expected) {
            let rate = 100.0 * *hit as f64 / cases.len() as f64;
            eprintln!("{} {rate:.1} (expected {expected})", method.as_str());
            assert!((rate - expected).abs() <= points, "{} {rate} {expected}", method.as_str());
        }
    }
    let mut hits = [0, 0];
    for (target, q0) in &cases {
        let reached = damped_least_squares(&chain, target, q0, [1e-3, 1e-6]);
        hits = [hits[0] + usize::from(reached[0]), hits[1] + usize::from(reached[1])];
    }
    for (hit, expected) in hits.iter().zip([98.0, 94.0]) {
        let rate = 100.0 * *hit as f64 / n as f64;
        eprintln!("damped least squares {rate:.1} (expected {expected})");
        assert!((rate - expected).abs() <= points, "damped least squares {rate} {expected}");
    }
    // Levenberg-Marquardt alone, and after ten sweeps of coordinate descent.
    let newton =
        IkSettings { method: IkMethod::Newton, max_iterations: 500, restarts: 0, ..IkSettings::default() };
    let newton = IkSolver::new(&chain, newton).unwrap();
    let warm = solver(&chain, DescentMethod::CoordinateDescent, 10, DescentSettings::default());
    let mut hits = [0, 0];
    for (target, q0) in &cases {
        let single = newton.solve(target, Some(q0), 0).unwrap();
        let after = newton.solve(target, Some(&warm.trace(target, q0).unwrap().q), 0).unwrap();
        hits[0] += usize::from(single.status == Status::Converged);
        hits[1] += usize::from(after.status == Status::Converged);
    }
    for (name, hit, expected) in
        [("newton", hits[0], 99.6), ("coordinate descent, then newton", hits[1], 99.7)]
    {
        let rate = 100.0 * hit as f64 / n as f64;
        eprintln!("{name} {rate:.1} (expected {expected})");
        assert!(rate >= expected - points, "{name} {rate}");
    }
}

#[test]
fn methods_solve_with_restarts_and_name_bad_settings() {
    let chain = catalog::load("panda").unwrap();
    let mut rng = rng(25);
    for method in DescentMethod::ALL {
        let settings = IkSettings {
            method: IkMethod::Descent(method),
            tol_position: 1e-3,
            tol_orientation: 1e-3,
            max_iterations: 100_000,
            ..IkSettings::default()
        };
        let solver = IkSolver::new(&chain, settings).unwrap();
        for _ in 0..5 {
            let target = chain.forward(&random_q(&mut rng, &chain)).unwrap();
            let result = solver.solve(&target, None, 0).unwrap();
            assert_eq!(result.status, Status::Converged, "{method:?} {result:?}");
            assert!(chain.within_limits(&result.q, 0.0));
        }
    }
    let refused = |descent: DescentSettings| {
        let method = IkMethod::Descent(DescentMethod::WeightedDescent);
        IkSolver::new(&chain, IkSettings { method, descent, ..IkSettings::default() })
            .unwrap_err()
            .to_string()
    };
    let ok = DescentSettings::default;
    let text = refused(DescentSettings { joint_weights: Some(vec![1.0; 6]), ..ok() });
    assert_eq!(text, "joint_weights: expected 7 entries, got 6");
    let text = refused(DescentSettings { joint_weights: Some(vec![1.5; 7]), ..ok() });
    assert_eq!(text, "joint weight is 1.5, it must be > 0 and <= 1");
    let weights = CostWeights { position: -1.0, orientation: 1.0 };
    assert_eq!(
        refused(DescentSettings { weights, ..ok() }),
        "position_weight is -1, it must be >= 0 and finite"
    );
    let attractions = vec![Attraction { link: 99, target: [0.0; 3], weight: 1.0 }];
    assert!(refused(DescentSettings { attractions, ..ok() }).contains("link index is 99"));
    let task = redundancy_core::kinematics::Task::POINTING;
    let method = IkMethod::Descent(DescentMethod::CoordinateDescent);
    let text =
        IkSolver::new(&chain, IkSettings { method, task, ..IkSettings::default() }).unwrap_err().to_string();
    assert!(text.contains("needs the task pose"), "{text}");
}
