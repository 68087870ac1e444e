//! Kinds of optima, critical points over a pose, and where they break [Park1996].

use redundancy_core::Pose;
use redundancy_core::chain::{Chain, catalog};
use redundancy_core::criterion::Manipulability;
use redundancy_core::kinematics::Task;
use redundancy_core::nalgebra::{Rotation3, Translation3, Vector3};
use redundancy_core::optimum::{
    CriticalPoint, FollowSettings, FollowedOptimum, Kind, OptimaSettings, classify, cofactor_condition,
    constrained_optima, follow_optimum, rank_starts,
};
use redundancy_core::path::{Circle, EventKind, Path};

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
            let trajectory = followed.trajectory(&planar().0, &path).unwrap();
            let event = trajectory.events().last().unwrap();
            assert_eq!(event.index, trajectory.rows());
            if let Some(t) = t {
                assert!((event.t - t).abs() < 1e-10, "{} {}", event.t, stop.s / path.length());
            }
            println!("P{} {samples}: t = {:.12} {found:?}", start + 1, event.t);
        }
    }
}

#[test]
fn p4_and_p5_stop_at_kinematic_singularities() {
    for start in [3, 4] {
        let followed = follow(start, 101);
        let stop = followed.stop.as_ref().unwrap();
        println!("P{}: {} {:?}", start + 1, stop.message, stop.q);
        assert_eq!(stop.kind, EventKind::KinematicSingularity, "{}", stop.message);
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
    for start in &ranked {
        println!(
            "{:?} {} {:?}",
            start.point.q,
            start.point.classification.kind,
            start.followed.stop.as_ref().map(|s| (&s.kind, s.s / circle(51).length()))
        );
    }
    assert!(ranked[0].followed.stop.is_none());
}
