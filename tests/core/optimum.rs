//! Kinds of optima, critical points over a pose, and where they break [Park1996].

use redundancy_core::Pose;
use redundancy_core::chain::{Chain, catalog};
use redundancy_core::criterion::Manipulability;
use redundancy_core::kinematics::Task;
use redundancy_core::nalgebra::{Rotation3, Translation3};
use redundancy_core::optimum::{
    CriticalPoint, Kind, OptimaSettings, classify, cofactor_condition, constrained_optima,
};

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
