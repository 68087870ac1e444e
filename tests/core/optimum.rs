//! Kinds of optima, critical points over a pose, and where they break [Park1996].

use rand::Rng;
use redundancy_core::chain::{Chain, catalog};
use redundancy_core::criterion::{Criterion, JointRange, Manipulability, Measure, Posture, Stationarity};
use redundancy_core::kinematics::{NullSpace, Scratch, Task};
use redundancy_core::nalgebra::{DMatrix, DVector, Rotation3, Translation3, Vector3};
use redundancy_core::optimum::{
    Classifier, CriticalPoint, FollowSettings, FollowedOptimum, Kind, OptimaSettings, SingularitySearch,
    SingularitySettings, algorithmic_singularities, classify, cofactor_condition, constrained_optima,
    follow_optimum, rank_starts, singularity_curves,
};
use redundancy_core::path::{Circle, EventKind, Path};
use redundancy_core::solutions::{SrsArm, TraceSettings, self_motion_curves, trace_self_motion};
use redundancy_core::{Pose, Status};

use crate::allocations;
use crate::support::{amount, difference, random_q, rng};

fn planar() -> (Chain, Manipulability) {
    let arm = catalog::load("planar3r").unwrap();
    let h = Manipulability::new(&arm, Task::PLANAR);
    (arm, h)
}

fn at(x: f64, y: f64) -> Pose {
    Pose::from_parts(Translation3::new(x, y, 0.0), Rotation3::identity())
}

/// Table 2 of the paper: degrees, H, A.
const TABLE_2: [([f64; 3], f64, f64, Kind); 6] = [
    ([-87.1742, 111.7847, 77.5352], 75.0395, -4860.58, Kind::Maximum),
    ([-83.4304, 179.8777, -82.0847], 61.0392, -3428.24, Kind::Maximum),
    ([-8.8531, 112.6675, 155.6028], 20.5785, -897.94, Kind::Maximum),
    ([-21.6863, 94.1577, 147.1470], 18.7790, 1373.58, Kind::Minimum),
    ([12.3080, 150.8068, 153.8209], 13.9617, 1024.89, Kind::Minimum),
    ([-126.9744, 161.2385, -4.6209], 27.0532, 2251.39, Kind::Minimum),
];

/// Half a unit of the last printed digit, and what P3 needs: its q3 = 155.602747 is printed as 155.6028.
const DEGREES: f64 = 0.54e-4;

fn optima() -> Vec<CriticalPoint> {
    let (arm, h) = planar();
    constrained_optima(&arm, &at(2.0, 0.0), &h, Task::PLANAR, &OptimaSettings::default()).unwrap()
}

#[test]
fn table_2_to_every_printed_digit() {
    let (arm, h) = planar();
    let points = optima();
    assert_eq!(points.len(), 12, "{points:#?}");
    for (degrees, value, a, kind) in TABLE_2 {
        for mirror in [1.0, -1.0] {
            let printed = degrees.map(|x| mirror * x);
            let point = points
                .iter()
                .find(|p| p.q.iter().zip(printed).all(|(q, x)| (q.to_degrees() - x).abs() <= DEGREES))
                .unwrap_or_else(|| panic!("{printed:?} not among {points:#?}"));
            assert_eq!(point.classification.kind, kind);
            assert!((point.value - value).abs() <= 0.50001e-4, "{} {value}", point.value);
            let paper = cofactor_condition(&arm, &point.q, &h, Task::PLANAR).unwrap();
            assert!((paper.a - a).abs() <= 0.50001e-2, "{} {a}", paper.a);
            // h = |n|^2, and W in the unit basis is A / |n|^2.
            let w = point.classification.eigenvalues[0];
            assert!((w * point.value - paper.a).abs() < 1e-8 * paper.a.abs());
            assert_eq!(classify(&arm, &printed.map(f64::to_radians), &h, Task::PLANAR).unwrap().kind, kind);
        }
    }
}

/// The circle of the paper, eq. (16): t in [0, 1] from (2, 0).
fn circle(samples: usize) -> Path {
    let circle =
        Circle::new(Vector3::new(3.5, 0.0, 0.0), 1.5, std::f64::consts::PI, 1.0, Vector3::z()).unwrap();
    let t: Vec<f64> = (0..samples).map(|i| i as f64 / (samples - 1) as f64).collect();
    circle.path(samples).unwrap().with_times(Some(&t)).unwrap()
}

fn follow(start: usize, samples: usize) -> FollowedOptimum {
    let (arm, h) = planar();
    let q0 = TABLE_2[start].0.map(f64::to_radians);
    follow_optimum(&arm, &circle(samples), &q0, &h, Task::PLANAR, &FollowSettings::default()).unwrap()
}

/// Table 1 of the paper (d), (e), polished to double precision: q2, q3 in degrees.
const D: [f64; 2] = [142.86374652115, -37.690595721962];

#[test]
fn p1_completes_and_is_cyclic() {
    let (arm, h) = planar();
    let followed = follow(0, 101);
    assert!(followed.stop.is_none());
    assert_eq!(followed.kind, Kind::Maximum);
    let rows: Vec<&[f64]> = followed.q.chunks_exact(3).collect();
    assert_eq!(rows.len(), 101);
    let gap = rows[100].iter().zip(rows[0]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(gap < 1e-10, "{gap:e}");
    assert!(gap < 1e-13, "{gap:e}");
    let path = circle(101);
    for (row, pose) in rows.iter().zip(path.poses()) {
        let tip = arm.forward(row).unwrap();
        assert!((tip.translation.vector - pose.translation.vector).norm() < 1e-12);
        assert_eq!(classify(&arm, row, &h, Task::PLANAR).unwrap().kind, Kind::Maximum);
    }
    let quarter = cofactor_condition(&arm, rows[25], &h, Task::PLANAR).unwrap();
    assert!((followed.values[25] - 188.283).abs() < 0.5e-3, "{}", followed.values[25]);
    assert!((quarter.a + 15354.8).abs() < 0.05, "{}", quarter.a);
}

#[test]
fn p2_and_p6_stop_at_d_and_p3_at_e() {
    for samples in [11, 101, 1001] {
        for (start, t, at) in
            [(1, Some(0.2127422082), D), (5, Some(0.2127422082), D), (2, None, [46.9843, -142.4039])]
        {
            let followed = follow(start, samples);
            let stop = followed.stop.as_ref().unwrap();
            assert_eq!(stop.kind, EventKind::AlgorithmicSingularity, "{}", stop.message);
            let found = [stop.q[1].to_degrees(), stop.q[2].to_degrees()];
            let wrapped = found.map(|x| x - 360.0 * (x / 360.0).round());
            let mirrored = wrapped.map(|x| -x);
            let near = |a: [f64; 2]| (a[0] - at[0]).abs() < 0.51e-4 && (a[1] - at[1]).abs() < 0.51e-4;
            assert!(near(wrapped) || near(mirrored), "P{}: {found:?}", start + 1);
            let path = circle(samples);
            let plan = followed.plan(&planar().0, &path).unwrap();
            let trajectory = plan.trajectory();
            let event = trajectory.events().last().unwrap();
            assert_eq!(event.index, trajectory.rows());
            assert_eq!((plan.status(), plan.reason()), (Status::Singular, stop.message.as_str()));
            if let Some(t) = t {
                assert!((event.t - t).abs() < 1e-10, "{} {}", event.t, stop.s / path.length());
            }
        }
    }
}

#[test]
fn p4_and_p5_stop_at_kinematic_singularities() {
    for start in [3, 4] {
        let followed = follow(start, 101);
        let stop = followed.stop.as_ref().unwrap();
        assert_eq!(stop.kind, EventKind::KinematicSingularity, "{}", stop.message);
        // There the arm is aligned: the circle meets |x| = 3.5 or 2.5.
        let reach: f64 = if start == 3 { 3.5 } else { 2.5 };
        let turn = ((3.5f64.powi(2) + 1.5f64.powi(2) - reach.powi(2)) / (2.0 * 3.5 * 1.5)).acos();
        assert!((stop.s - 1.5 * turn).abs() < 1e-9, "{:e}", stop.s - 1.5 * turn);
        assert!(followed.values.last().unwrap() < &followed.values[0]);
    }
}

#[test]
fn the_start_that_completes_comes_first() {
    let (arm, h) = planar();
    let ranked = rank_starts(
        &arm,
        &circle(51),
        &h,
        Task::PLANAR,
        &OptimaSettings::default(),
        &FollowSettings::default(),
    )
    .unwrap();
    assert_eq!(ranked.len(), 12);
    assert!(ranked[1].followed.stop.is_none() && ranked[2].followed.stop.is_some());
    assert!(ranked[0].followed.stop.is_none());
}

#[test]
fn the_saddle_of_the_4r_arm() {
    let arm = catalog::load("planar4r").unwrap();
    let h = Manipulability::new(&arm, Task::PLANAR);
    let q = [1.4523200054, -2.2285317342, -0.2952995971, 1.4314560205];
    let at = classify(&arm, &q, &h, Task::PLANAR).unwrap();
    assert_eq!(at.kind, Kind::Saddle);
    assert!((h.value(&q) - 269.0886314).abs() < 1e-7);
    for (found, printed) in at.eigenvalues.iter().zip([-112.95383219, 54.23547925]) {
        assert!((found - printed).abs() < 1e-6, "{found} {printed}");
    }
    assert!((at.multipliers[0] - 80.40134486).abs() < 1e-6 && at.multipliers[1].abs() < 1e-6);
    let settings = OptimaSettings { starts: 400, ..OptimaSettings::default() };
    let points = constrained_optima(&arm, &at_position(4.5), &h, Task::PLANAR, &settings).unwrap();
    let same = |p: &&CriticalPoint| p.q.iter().zip(q).all(|(a, b)| (a - b).abs() < 1e-9);
    assert_eq!(points.iter().find(same).unwrap().classification.kind, Kind::Saddle);
}

fn at_position(x: f64) -> Pose {
    at(x, 0.0)
}

/// The paper's null-space basis (eq. 11) for the choice of the m columns `kept`, by cofactors.
fn basis_11(jacobian: &DMatrix<f64>, kept: &[usize]) -> DMatrix<f64> {
    let (m, n) = jacobian.shape();
    let others: Vec<usize> = (0..n).filter(|j| !kept.contains(j)).collect();
    let square = jacobian.select_columns(kept);
    let det = square.determinant();
    // adj(J_m) b by Cramer's rule.
    let mut out = DMatrix::zeros(n, n - m);
    for (c, other) in others.iter().enumerate() {
        for (i, row) in kept.iter().enumerate() {
            let mut replaced = square.clone();
            replaced.set_column(i, &jacobian.column(*other));
            out[(*row, c)] = replaced.determinant();
        }
        out[(*other, c)] = -det;
    }
    out
}

fn task_jacobian(arm: &Chain, q: &[f64], task: &Task) -> DMatrix<f64> {
    let mut scratch = Scratch::new(arm);
    let kinematics = arm.kinematics(q, &mut scratch).unwrap();
    let mut out = DMatrix::zeros(task.dim(), arm.dof());
    task.write_jacobian(&kinematics, out.as_mut_slice());
    out
}

fn gradient(h: &dyn Criterion, q: &[f64]) -> DVector<f64> {
    let mut out = DVector::zeros(q.len());
    h.gradient(q, out.as_mut_slice());
    out
}

/// The central difference of `f` along `d`, extrapolated once: error of the fourth order.
fn derivative(q: &[f64], d: &[f64], step: f64, f: impl Fn(&[f64]) -> DMatrix<f64>) -> DMatrix<f64> {
    let at = |x: f64| f(&q.iter().zip(d).map(|(q, d)| q + x * d).collect::<Vec<_>>());
    let central = |x: f64| (at(x) - at(-x)) / (2.0 * x);
    (central(0.5 * step) * 4.0 - central(step)) / 3.0
}

/// `N^T (Hess h - sum lambda Hess f) N` by differences of gradients and Jacobians alone, for any basis.
fn reduced_by_differences(
    arm: &Chain,
    h: &dyn Criterion,
    task: &Task,
    q: &[f64],
    basis: &DMatrix<f64>,
) -> DMatrix<f64> {
    let jacobian = task_jacobian(arm, q, task);
    let lambda = (&jacobian * jacobian.transpose()).lu().solve(&(&jacobian * gradient(h, q))).unwrap();
    let mut out = DMatrix::zeros(basis.ncols(), basis.ncols());
    for (b, direction) in basis.column_iter().enumerate() {
        let d: Vec<f64> = direction.iter().copied().collect();
        let size = direction.norm();
        let column = derivative(q, &d, 1e-2 / size, |q| {
            let force = task_jacobian(arm, q, task).transpose() * &lambda;
            DMatrix::from_column_slice(q.len(), 1, (gradient(h, q) - force).as_slice())
        });
        out.set_column(b, &(basis.transpose() * column).column(0));
    }
    out
}

fn signature(w: &DMatrix<f64>) -> (usize, usize) {
    let symmetric = 0.5 * (w + w.transpose());
    let eigenvalues = symmetric.symmetric_eigenvalues();
    (eigenvalues.iter().filter(|e| **e > 0.0).count(), eigenvalues.iter().filter(|e| **e < 0.0).count())
}

#[test]
fn the_signature_does_not_depend_on_the_basis() {
    let mut rng = rng(11);
    let arms = ["planar4r", "pa10", "iiwa14", "panda", "dexter"].map(|name| catalog::load(name).unwrap());
    for case in 0..amount(150, 1000) {
        let arm = &arms[case % arms.len()];
        let tasks: &[Task] = if arm.name() == "planar4r" {
            &[Task::PLANAR]
        } else {
            &[Task::POSITION, Task::POINTING, Task::POSE, Task::POSE_RPY]
        };
        let task = tasks[rng.random_range(0..tasks.len())];
        let q = random_q(&mut rng, arm);
        let reference = random_q(&mut rng, arm);
        let posture = Posture::new(&reference).unwrap();
        let manipulability = Manipulability::new(arm, task);
        let h: &dyn Criterion = if rng.random_bool(0.5) { &posture } else { &manipulability };
        let at = classify(arm, &q, h, task).unwrap();
        let jacobian = task_jacobian(arm, &q, &task);
        let (m, n) = jacobian.shape();
        // The paper's basis for m random columns.
        let mut order: Vec<usize> = (0..n).collect();
        for i in (1..n).rev() {
            order.swap(i, rng.random_range(0..=i));
        }
        let mut kept = order[..m].to_vec();
        kept.sort_unstable();
        let basis = basis_11(&jacobian, &kept);
        let singular = basis.clone().svd(false, false).singular_values;
        let largest = at.eigenvalues.iter().fold(0.0, |x: f64, e| x.max(e.abs()));
        let least = at.eigenvalues.iter().fold(f64::INFINITY, |x: f64, e| x.min(e.abs()));
        // Signs that differences of the fourth order can tell.
        if singular.min() < 1e-3 * singular.max() || least < 1e-4 * largest || at.sigma_min < 1e-2 {
            continue;
        }
        let found = signature(&reduced_by_differences(arm, h, &task, &q, &basis));
        let positive = at.eigenvalues.iter().filter(|e| **e > 0.0).count();
        assert_eq!(found, (positive, n - m - positive), "{} {task} {:?}", arm.name(), at.eigenvalues);
    }
}

#[test]
fn eigenvalues_agree_with_differences() {
    let mut rng = rng(5);
    for case in 0..amount(60, 300) {
        let arm = catalog::load(["planar4r", "iiwa14", "panda", "dexter"][case % 4]).unwrap();
        let task = match case % 4 {
            0 => Task::PLANAR,
            _ => [Task::POSITION, Task::POINTING, Task::POSE, Task::POSE_RPY][case / 4 % 4],
        };
        let q = random_q(&mut rng, &arm);
        let posture = Posture::new(&random_q(&mut rng, &arm)).unwrap();
        let at = classify(&arm, &q, &posture, task).unwrap();
        if at.sigma_min < 0.02 {
            continue;
        }
        let jacobian = task_jacobian(&arm, &q, &task);
        let mut null = NullSpace::new(jacobian.nrows(), jacobian.ncols());
        null.factor(jacobian.as_slice());
        assert!((&jacobian * null.basis()).norm() < 1e-13 * jacobian.norm());
        let gram = null.basis().transpose() * null.basis();
        assert!((gram - DMatrix::identity(null.redundancy(), null.redundancy())).norm() < 1e-14);
        let [least, most] = null.singular_values();
        let svd = jacobian.clone().svd(false, false).singular_values;
        assert!(
            (least - svd.min()).abs() < 1e-12 * svd.max() && (most - svd.max()).abs() < 1e-12 * svd.max()
        );
        let w = reduced_by_differences(&arm, &posture, &task, &q, null.basis());
        let mut eigenvalues: Vec<f64> =
            (0.5 * (&w + w.transpose())).symmetric_eigenvalues().iter().copied().collect();
        eigenvalues.sort_by(f64::total_cmp);
        let scale = w.norm().max(1.0);
        for (a, b) in at.eigenvalues.iter().zip(&eigenvalues) {
            assert!((a - b).abs() < 1e-6 * scale, "{} {task}: {a} {b}", arm.name());
        }
        // Without a gradient along the self-motion W is symmetric, for every task.
        assert!((&w - w.transpose()).norm() < 1e-6 * scale, "{} {task}", arm.name());
    }
}

#[test]
fn w_is_equation_10_at_critical_points_of_two_freedoms() {
    let arm = catalog::load("planar4r").unwrap();
    let h = Manipulability::new(&arm, Task::PLANAR);
    let settings = OptimaSettings { starts: 200, ..OptimaSettings::default() };
    let points = constrained_optima(&arm, &at(4.5, 0.0), &h, Task::PLANAR, &settings).unwrap();
    let mut checked = 0;
    let mut kinds = std::collections::HashSet::new();
    for point in &points {
        let q = &point.q;
        let mut stationarity = Stationarity::new(&arm, &h, Task::PLANAR).unwrap();
        stationarity.second_order(q);
        let basis = basis_11(&task_jacobian(&arm, q, &Task::PLANAR), &[0, 1]);
        let (g, mut hessian) = (gradient(&h, q), DMatrix::zeros(4, 4));
        h.hessian(q, &mut hessian);
        // A_ij = n_i^T Hess h n_j + grad h^T (d n_i / d q) n_j.
        let mut a = basis.transpose() * hessian * &basis;
        for j in 0..2 {
            let d: Vec<f64> = basis.column(j).iter().map(|x| x / basis.column(j).norm()).collect();
            let change =
                derivative(q, &d, 4e-3, |q| basis_11(&task_jacobian(&arm, q, &Task::PLANAR), &[0, 1]));
            for i in 0..2 {
                a[(i, j)] += g.dot(&change.column(i)) * basis.column(j).norm();
            }
        }
        // The paper's basis in terms of the orthonormal one.
        let c = stationarity.null_space().basis().transpose() * &basis;
        let w = c.transpose() * stationarity.reduced_hessian() * &c;
        assert!((&a - &w).norm() < 1e-8 * w.norm(), "{:e}", (&a - &w).norm() / w.norm());
        kinds.insert(point.classification.kind);
        checked += 1;
    }
    assert!(
        checked >= 10 && kinds.contains(&Kind::Saddle) && kinds.contains(&Kind::Maximum),
        "{checked} {kinds:?}"
    );
}

#[test]
fn w_is_equation_9_at_critical_points_of_seven_joints() {
    let mut rng = rng(2);
    for name in ["iiwa14", "pa10", "panda"] {
        let arm = catalog::load(name).unwrap();
        let (range, manipulability) = (JointRange::new(&arm), Manipulability::new(&arm, Task::POSE));
        let criteria: [&dyn Criterion; 2] = [&range, &manipulability];
        for h in criteria {
            let pose = arm.forward(&random_q(&mut rng, &arm)).unwrap();
            let points = constrained_optima(
                &arm,
                &pose,
                h,
                Task::POSE,
                &OptimaSettings { starts: 10, ..OptimaSettings::default() },
            )
            .unwrap();
            assert!(!points.is_empty());
            for point in &points {
                let paper = cofactor_condition(&arm, &point.q, h, Task::POSE).unwrap();
                let length = paper.n.iter().map(|x| x * x).sum::<f64>();
                let w = point.classification.eigenvalues[0];
                // Where W is nearly zero, against the terms that it is the difference of.
                let mut stationarity = Stationarity::new(&arm, h, Task::POSE).unwrap();
                stationarity.second_order(&point.q);
                assert!(
                    (paper.a / length - w).abs() < 1e-8 * stationarity.scale(),
                    "{name}: {} {w}",
                    paper.a / length
                );
                assert!(point.classification.residual < 1e-9 * stationarity.scale());
            }
        }
    }
}

#[test]
fn critical_points_agree_with_a_dense_scan_of_the_closed_form() {
    const SAMPLES: usize = 10_000;
    let mut rng = rng(21);
    let (mut cells, mut kinds) = (0, 0);
    for name in ["iiwa14", "pa10"] {
        let chain = catalog::load(name).unwrap();
        let arm = SrsArm::new(&chain).unwrap();
        let (range, manipulability) = (JointRange::new(&chain), Manipulability::new(&chain, Task::POSE));
        let criteria: [&dyn Criterion; 2] = [&range, &manipulability];
        for _ in 0..amount(3, 200) {
            let pose = chain.forward(&random_q(&mut rng, &chain)).unwrap();
            let motion = arm.self_motion(&pose).unwrap();
            for h in criteria {
                let points =
                    constrained_optima(&chain, &pose, h, Task::POSE, &OptimaSettings::default()).unwrap();
                // Where each point is: branch and swivel.
                let place: Vec<([i8; 3], f64)> = points
                    .iter()
                    .map(|p| {
                        (
                            arm.branch(&p.q).unwrap(),
                            arm.swivel(&p.q).unwrap().rem_euclid(std::f64::consts::TAU),
                        )
                    })
                    .collect();
                for p in &points {
                    let there = chain.forward(&p.q).unwrap();
                    assert!((there.translation.vector - pose.translation.vector).norm() < 1e-12);
                    assert!((there.rotation.matrix() - pose.rotation.matrix()).norm() < 1e-12);
                }
                let mut used = 0;
                for branch in motion.branches() {
                    let step = std::f64::consts::TAU / SAMPLES as f64;
                    let sample = |k: usize| {
                        let s = step * k as f64;
                        let q = branch.q(s).unwrap();
                        let slope: f64 =
                            gradient(h, &q).iter().zip(branch.tangent(s).unwrap()).map(|(g, t)| g * t).sum();
                        (q, slope)
                    };
                    let mut inside: Vec<Vec<usize>> = vec![Vec::new(); SAMPLES];
                    for (i, (signs, s)) in place.iter().enumerate() {
                        if *signs == branch.signs() {
                            inside[((s / step) as usize).min(SAMPLES - 1)].push(i);
                            used += 1;
                        }
                    }
                    let mut left = sample(0);
                    for (k, inside) in inside.iter().enumerate() {
                        let right = sample((k + 1) % SAMPLES);
                        // Where a joint changes its winding h jumps; that is no critical point.
                        let jumps = left.0.iter().zip(right.0).any(|(a, b)| (a - b).abs() > 1.0);
                        if !jumps {
                            let crosses = (left.1 > 0.0) != (right.1 > 0.0);
                            let odd = inside.len() % 2 == 1;
                            assert_eq!(
                                crosses,
                                odd,
                                "{name} branch {:?} s = {} of {points:?}",
                                branch.signs(),
                                step * k as f64
                            );
                            cells += usize::from(crosses);
                            if let [one] = inside[..] {
                                let wanted = if left.1 > 0.0 { Kind::Maximum } else { Kind::Minimum };
                                let kind = points[one].classification.kind;
                                assert_eq!(kind, wanted, "{:?}", points[one]);
                                kinds += 1;
                            }
                        }
                        left = right;
                    }
                }
                assert_eq!(used, points.len());
            }
        }
    }
    assert!(cells > 50 && kinds * 1000 >= cells * 997, "{cells} {kinds}"); // the others share a cell
}

#[test]
fn table_1_and_its_mirror_images() {
    let (arm, h) = planar();
    let printed = [
        [138.5904, 97.1808, 0.0000],
        [141.6125, 92.7837, 0.1442],
        [124.5862, 142.9171, 1.4950],
        [142.8637, -37.6906, 3.4734],
        [46.9843, -142.4039, 4.5195],
    ];
    for seed in 0..amount(2, 20) as u64 {
        let settings = SingularitySettings { seed, ..SingularitySettings::default() };
        let points = algorithmic_singularities(&arm, &h, Task::PLANAR, &settings).unwrap();
        assert_eq!(points.len(), 10, "{points:#?}");
        for [q2, q3, radius] in printed {
            for sign in [1.0, -1.0] {
                let near = |p: &&redundancy_core::optimum::SingularPoint| {
                    (p.q[1].to_degrees() - sign * q2).abs() < 0.501e-4
                        && (p.q[2].to_degrees() - sign * q3).abs() < 0.501e-4
                };
                let point = points.iter().find(near).unwrap();
                assert!((point.position[0].hypot(point.position[1]) - radius).abs() < 0.501e-4);
                assert_eq!(classify(&arm, &point.q, &h, Task::PLANAR).unwrap().kind, Kind::Degenerate);
                assert!(point.first_joint_free && point.dimension == 0);
            }
        }
        // (a) in closed form.
        let a = [std::f64::consts::PI - 0.75f64.acos(), std::f64::consts::PI - 0.125f64.acos()];
        let best = points.iter().map(|p| (p.q[1] - a[0]).hypot(p.q[2] - a[1])).fold(f64::INFINITY, f64::min);
        assert!(best < 1e-9, "{best:e}");
    }
}

#[test]
fn curves_of_other_arms_hold_the_pose_and_close() {
    let mut rng = rng(8);
    for name in ["panda", "iiwa14"] {
        let arm = catalog::load(name).unwrap();
        for _ in 0..amount(6, 60) {
            let q = random_q(&mut rng, &arm);
            let pose = arm.forward(&q).unwrap();
            let curve = trace_self_motion(&arm, &q, Task::POSE, &TraceSettings::default()).unwrap();
            assert!(curve.closed(), "{q:?} {:?}", curve.events());
            let (first, last) = (curve.q_row(0), curve.q_row(curve.rows() - 1));
            for (a, b) in first.iter().zip(last) {
                let turns = (b - a) / std::f64::consts::TAU;
                assert!((turns - turns.round()).abs() < 1e-14);
            }
            for k in 0..curve.rows() {
                let there = arm.forward(curve.q_row(k)).unwrap();
                assert!((there.translation.vector - pose.translation.vector).norm() < 1e-10);
                assert!((there.rotation.matrix() - pose.rotation.matrix()).norm() < 1e-10);
                let v = arm.tool_velocity(curve.q_row(k), curve.tangent_row(k)).unwrap();
                assert!(v.norm() < 2e-6, "{v}");
            }
        }
    }
}

#[test]
fn traced_curves_are_the_circles_of_the_closed_form() {
    let mut rng = rng(9);
    for name in ["iiwa14", "pa10"] {
        let chain = catalog::load(name).unwrap();
        let arm = SrsArm::new(&chain).unwrap();
        for _ in 0..amount(4, 40) {
            let q = random_q(&mut rng, &chain);
            let pose = chain.forward(&q).unwrap();
            let motion = arm.self_motion(&pose).unwrap();
            let curve = trace_self_motion(&chain, &q, Task::POSE, &TraceSettings::default()).unwrap();
            assert!(curve.closed());
            let signs = arm.branch(&q).unwrap();
            let branch = motion.branches().into_iter().find(|b| b.signs() == signs).unwrap();
            for k in (0..curve.rows()).step_by(11) {
                let row = curve.q_row(k);
                assert_eq!(arm.branch(row).unwrap(), signs);
                let exact = branch.q(arm.swivel(row).unwrap()).unwrap();
                for (a, b) in row.iter().zip(exact) {
                    let d = a - b;
                    assert!((d - std::f64::consts::TAU * (d / std::f64::consts::TAU).round()).abs() < 1e-8);
                }
            }
            // All branches as curves, each found again by a trace from one of its rows.
            let settings = TraceSettings { step: 0.05, ..TraceSettings::default() };
            let all = self_motion_curves(&chain, &pose, Task::POSE, &settings, 0, 0).unwrap();
            assert_eq!(all.len(), motion.branches().len());
            assert_eq!(all.iter().filter(|c| c.contains(&q)).count(), 1);
        }
    }
}

/// What is exact to rounding is told apart where printed digits are not.
#[test]
fn printed_digits_are_degenerate_next_to_a_fold_and_polished_points_are_not() {
    let (arm, h) = planar();
    let settings = SingularitySettings::default();
    for at in algorithmic_singularities(&arm, &h, Task::PLANAR, &settings).unwrap() {
        let kind = |q: &[f64]| classify(&arm, q, &h, Task::PLANAR).unwrap().kind;
        let printed: Vec<f64> =
            at.q.iter().map(|q| ((q.to_degrees() * 1e4).round() * 1e-4).to_radians()).collect();
        assert_eq!((kind(&at.q), kind(&printed)), (Kind::Degenerate, Kind::Degenerate));
        // Two critical points meet here: next to it, both are found and are what they are.
        let pose = arm.forward(&at.q).unwrap();
        let there = pose.translation.vector;
        if there.norm() < 0.1 {
            continue; // the base: the circle about it is a point
        }
        let mut found = 0;
        for along in [1e-9, -1e-9] {
            let near = Pose::from_parts(Translation3::from(there * (1.0 + along)), pose.rotation);
            let points =
                constrained_optima(&arm, &near, &h, Task::PLANAR, &OptimaSettings::default()).unwrap();
            let pair: Vec<Kind> = points
                .iter()
                .filter(|p| p.q.iter().zip(&at.q).skip(1).all(|(a, b)| (a - b).abs() < 1e-3))
                .map(|p| p.classification.kind)
                .collect();
            if !pair.is_empty() {
                assert_eq!(pair.len(), 2, "{pair:?}");
                assert!(pair.contains(&Kind::Maximum) && pair.contains(&Kind::Minimum), "{pair:?}");
                found += 1;
            }
        }
        assert_eq!(found, 1);
    }
}

/// Depends on the first joint (posture) and not (manipulability of four joints, in whose last joint nothing changes).
#[test]
fn singularity_curves_hold_the_equations_and_none_is_missed() {
    let (three, four) = (catalog::load("planar3r").unwrap(), catalog::load("planar4r").unwrap());
    let posture = Posture::new(&[0.3, 0.5, 0.7]).unwrap();
    let manipulability = Manipulability::new(&four, Task::PLANAR_POSE);
    let cases: [(&Chain, &dyn Criterion, Task, bool, usize); 2] =
        [(&three, &posture, Task::PLANAR, false, 8), (&four, &manipulability, Task::PLANAR_POSE, true, 10)];
    for (arm, h, task, free, count) in cases {
        let n = arm.dof();
        let settings = SingularitySettings { starts: amount(300, 2_000), ..SingularitySettings::default() };
        let curves = singularity_curves(arm, h, task, &settings, 0.05).unwrap();
        assert_eq!(curves.len(), count);
        let mut classifier = Classifier::new(arm, h, task).unwrap();
        for curve in &curves {
            assert_eq!((curve.first_joint_free, curve.closed), (free, free));
            let rows: Vec<&[f64]> = curve.q.chunks_exact(n).collect();
            assert!(rows.len() > 20);
            for pair in rows.windows(2) {
                assert!(pair[0].iter().zip(pair[1]).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt() < 0.06);
                assert_eq!(classifier.classify(pair[0]).unwrap(), Kind::Degenerate);
                // Dense: mu and the least eigenvalue vanish to rounding.
                let scale = classifier.stationarity().scale();
                assert!(classifier.residual() < 1e-10 * scale);
                assert!(classifier.eigenvalues()[0].abs() < 1e-9 * scale);
            }
            let (first, last) = (rows[0], rows[rows.len() - 1]);
            if curve.closed {
                assert!(difference(first, last) < 1e-6);
            } else {
                // Only the windings end them here.
                for end in [first, last] {
                    assert!(end.iter().any(|q| q.abs() > std::f64::consts::PI - 0.06), "{end:?}");
                }
            }
        }
        // Points that another search finds lie on them.
        let other = SingularitySettings { seed: 7, starts: 100 };
        for point in algorithmic_singularities(arm, h, task, &other).unwrap() {
            let rows = curves.iter().flat_map(|curve| curve.q.chunks_exact(n));
            let nearest = rows.map(|row| difference(row, &point.q)).fold(f64::INFINITY, f64::min);
            assert!(nearest < 0.05, "{point:?} {nearest}");
        }
    }
    // Points are no curves.
    let (arm, h) = planar();
    let text = singularity_curves(&arm, &h, Task::PLANAR, &SingularitySettings::default(), 0.05)
        .unwrap_err()
        .to_string();
    assert!(text.contains("0 dimensions"), "{text}");
    let text = singularity_curves(&three, &posture, Task::PLANAR, &SingularitySettings::default(), 0.0)
        .unwrap_err()
        .to_string();
    assert!(text.contains("step is 0, it must be from 1e-4 to 0.5"), "{text}");
}

#[test]
fn a_search_in_pieces_finds_the_same() {
    let (arm, h) = planar();
    let settings = SingularitySettings::default();
    let whole = algorithmic_singularities(&arm, &h, Task::PLANAR, &settings).unwrap();
    let mut search = SingularitySearch::new(&arm, &h, Task::PLANAR, &settings).unwrap();
    let mut rounds = 0;
    while search.starts() > 0 {
        search.run(1 + rounds % 3 * 64);
        rounds += 1;
    }
    assert_eq!(search.finish(), whole);
    // Isolated points: it stops when most starts find nothing new.
    assert!(rounds < 25, "{rounds}");
}

#[test]
fn classifying_allocates_nothing() {
    let arm = catalog::load("iiwa14").unwrap();
    let h = JointRange::new(&arm);
    let mut classifier = Classifier::new(&arm, &h, Task::POSE).unwrap();
    let q = [0.3, 0.7, -0.4, -1.4, 0.2, 0.9, 0.5];
    assert_eq!(allocations::count(|| classifier.classify(&q).unwrap()), 0);
    let mut classifier = Classifier::new(&arm, &h, Task::POSITION).unwrap();
    assert_eq!(allocations::count(|| classifier.classify(&q).unwrap()), 0);
    for task in [Task::POSE, Task::POSITION, Task::POSE_RPY] {
        for measure in Measure::ALL {
            let h = Manipulability::with_measure(&arm, task, measure);
            let mut classifier = Classifier::new(&arm, &h, task).unwrap();
            assert_eq!(allocations::count(|| classifier.classify(&q).unwrap()), 0, "{task}");
        }
    }
}
