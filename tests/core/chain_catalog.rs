//! The numbers of the catalogue, written down a second time from their sources.

use std::f64::consts::FRAC_PI_2;

use redundancy_core::chain::{Chain, catalog};
use redundancy_core::nalgebra::{Matrix3, Matrix4, Rotation3, Vector3};

fn degrees(values: &[f64]) -> Vec<f64> {
    values.iter().map(|v| v / 180.0 * std::f64::consts::PI).collect()
}

fn assert_near(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    for (f, e) in found.iter().zip(expected) {
        assert!(f == e || (f - e).abs() < 1e-15 * e.abs().max(1.0), "{found:?} is not {expected:?}");
    }
}

fn velocity(chain: &Chain) -> Vec<f64> {
    chain.joints().iter().map(|j| j.limits.velocity).collect()
}

fn effort(chain: &Chain) -> Vec<f64> {
    chain.joints().iter().map(|j| j.limits.effort).collect()
}

const NONE: [f64; 8] = [f64::INFINITY; 8];

#[test]
fn names_load() {
    let names: Vec<_> = catalog::names().collect();
    assert!(names.is_sorted() && names.len() == 23);
    for name in names {
        let arm = catalog::load(name).unwrap();
        assert_eq!(arm.name(), name);
        let q: Vec<f64> = (0..arm.dof()).map(|i| 0.1 * i as f64).collect();
        assert!(arm.forward(&q).is_ok());
    }
}

#[test]
fn right_angles_are_exact() {
    for name in catalog::names() {
        let arm = catalog::load(name).unwrap();
        // Arms that lean.
        let leans = |joint: &str| {
            ["right_arm_0", "right_j6", "left_shoulder_pitch_joint", "left_shoulder_roll_joint"]
                .contains(&joint)
        };
        for joint in arm.joints().iter().filter(|joint| !leans(&joint.name)) {
            let exact = |v: &f64| [0.0, 1.0, -1.0].contains(v);
            assert!(joint.placement.rotation.matrix().iter().all(exact), "{name} {}", joint.name);
            assert!(joint.axis.iter().all(exact), "{name} {}", joint.name);
        }
    }
}

#[test]
fn pa10() {
    let arm = catalog::load("pa10").unwrap();
    let tip = arm.forward(&[0.0; 7]).unwrap();
    assert_eq!(tip.translation.vector, Vector3::new(0.0, 0.0, 0.315 + 0.45 + 0.5 + 0.08));
    assert_eq!(tip.rotation.matrix(), &Matrix3::identity());
    let upper = degrees(&[177.0, 91.0, 174.0, 137.0, 255.0, 165.0, 360.0]);
    assert_near(arm.upper(), &upper);
    assert_near(arm.lower(), &upper.iter().map(|v| -v).collect::<Vec<_>>());
    assert_near(&velocity(&arm), &degrees(&[57.0, 57.0, 114.0, 114.0, 360.0, 360.0, 360.0]));
    assert_near(&effort(&arm), &NONE[..7]);
    // computed independently of this library: this q reaches p = (.5, .1, 1), q = unit(1, 0, 1, 0)
    let q =
        [0.0926320764, 1.1371838489, 3.0050722472, 1.1024751202, 3.1068703321, 1.5440001559, 0.1248233278];
    let tip = arm.forward(&q).unwrap();
    assert!((tip.translation.vector - Vector3::new(0.5, 0.1, 1.0)).norm() < 1e-9);
    let expected = Rotation3::from_axis_angle(&Vector3::y_axis(), FRAC_PI_2);
    assert!((tip.rotation.matrix() - expected.matrix()).amax() < 1e-9);
}

#[test]
fn iiwa14() {
    let arm = catalog::load("iiwa14").unwrap();
    let tip = arm.forward(&[0.0; 7]).unwrap();
    assert!((tip.translation.vector - Vector3::new(0.0, 0.0, 0.36 + 0.42 + 0.40 + 0.126)).norm() < 1e-15);
    assert_eq!(tip.rotation.matrix(), &Matrix3::identity());
    let upper = degrees(&[170.0, 120.0, 170.0, 120.0, 170.0, 120.0, 175.0]);
    assert_near(arm.upper(), &upper);
    assert_near(arm.lower(), &upper.iter().map(|v| -v).collect::<Vec<_>>());
    assert_near(&velocity(&arm), &degrees(&[85.0, 85.0, 100.0, 75.0, 130.0, 135.0, 135.0]));
    assert_near(&effort(&arm), &[320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0]);
    // the elbow bends forwards (+x) for a negative A4, as on the real arm
    let mut q = [0.0; 7];
    q[3] = -FRAC_PI_2;
    assert!((arm.forward(&q).unwrap().translation.vector - Vector3::new(0.526, 0.0, 0.78)).norm() < 1e-15);
    let mass: f64 = arm.inertias().unwrap().iter().map(|b| b.mass).sum();
    assert!((mass - 25.61).abs() < 1e-12);
}

#[test]
fn panda() {
    let arm = catalog::load("panda").unwrap();
    // at zero: flange 0.088 in front, 0.333 + 0.316 + 0.384 - 0.107 high, z down
    let tip = arm.forward(&[0.0; 7]).unwrap();
    assert!((tip.translation.vector - Vector3::new(0.088, 0.0, 0.926)).norm() < 1e-15);
    assert_eq!(tip.rotation.matrix(), &Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0)));
    assert_near(arm.lower(), &[-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]);
    assert_near(arm.upper(), &[2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]);
    assert_near(&velocity(&arm), &[2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61]);
    assert_near(&effort(&arm), &[87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0]);
    let acceleration: Vec<f64> = arm.joints().iter().map(|j| j.limits.acceleration).collect();
    assert_near(&acceleration, &[15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]);
}

#[test]
fn dexter() {
    let arm = catalog::load("dexter").unwrap();
    assert_near(arm.lower(), &degrees(&[-12.56, -83.0, 7.0, 65.0, -174.0, 57.0, -129.99, -55.05]));
    assert_near(arm.upper(), &degrees(&[179.89, 84.0, 173.0, 295.0, -3.0, 265.0, -45.0, 30.0]));
    assert_near(&velocity(&arm), &NONE);
    assert_near(&effort(&arm), &NONE);
    // computed independently of this library: f(q_in) with R = Rz(0) Ry(-40 deg) Rx(0)
    let start = degrees(&[40.0, 0.0, 90.0, 180.0, -90.0, 180.0, -90.0, 0.0]);
    let tip = arm.forward(&start).unwrap();
    assert!((tip.translation.vector - Vector3::new(1.022403981, 0.0, 0.181697827)).amax() < 5e-10);
    let expected = Rotation3::from_axis_angle(&Vector3::y_axis(), (-40.0_f64).to_radians());
    assert!((tip.rotation.matrix() - expected.matrix()).amax() < 1e-15);
    // standard D-H rows of table 1 behind the constant base rotation
    let q = [0.3, -0.4, 1.2, 2.0, -1.0, 2.2, -1.5, 0.2];
    let rows = [
        (0.0, 0.0, -90.0),
        (0.144, 0.45, -90.0),
        (0.0, 0.0, 90.0),
        (0.1, 0.35, 90.0),
        (0.0, 0.0, -90.0),
        (0.024, 0.25, -90.0),
        (0.0, 0.0, -90.0),
        (0.1, 0.0, 180.0),
    ];
    let mut expected = Matrix4::new(0., 1., 0., 0., 0., 0., -1., 0., -1., 0., 0., 0., 0., 0., 0., 1.);
    for ((a, d, alpha), q) in rows.into_iter().zip(q) {
        expected *= standard_row(a, d, alpha, q);
    }
    assert!((arm.forward(&q).unwrap().to_homogeneous() - expected).amax() < 1e-14);
}

#[test]
fn puma560() {
    let arm = catalog::load("puma560").unwrap();
    assert_near(arm.lower(), &degrees(&[-160.0, -45.0, -232.0, -140.0, -100.0, -266.0]));
    assert_near(arm.upper(), &degrees(&[160.0, 225.0, 52.0, 140.0, 100.0, 266.0]));
    assert_near(&velocity(&arm), &NONE[..6]);
    assert_near(&effort(&arm), &[97.6, 186.4, 89.4, 24.2, 20.1, 21.3]);
    let rows = [
        (0.0, 0.0, 90.0),
        (0.4318, 0.0, 0.0),
        (0.0203, 0.15005, -90.0),
        (0.0, 0.4318, 90.0),
        (0.0, 0.0, -90.0),
        (0.0, 0.0, 0.0),
    ];
    let q = [0.3, 0.7, -2.0, 0.4, -0.8, 1.1];
    let mut expected = Matrix4::identity();
    for ((a, d, alpha), q) in rows.into_iter().zip(q) {
        expected *= standard_row(a, d, alpha, q);
    }
    assert!((arm.forward(&q).unwrap().to_homogeneous() - expected).amax() < 1e-15);
    // rotors: gear ratio squared times motor inertia
    let ratio = [62.6111, 107.815, 53.7063, 76.0364, 71.923, 76.686_f64];
    let motor = [200e-6, 200e-6, 200e-6, 33e-6, 33e-6, 33e-6];
    let bodies = arm.inertias().unwrap();
    for i in 0..6 {
        assert!((bodies[i].rotor - ratio[i].powi(2) * motor[i]).abs() < 1e-15);
    }
    let mass: Vec<f64> = bodies.iter().map(|b| b.mass).collect();
    assert_eq!(mass, [0.0, 17.4, 4.8, 0.82, 0.34, 0.09]);
    // link 2: com (-.3638, .006, .2275) in frame 2, which lies a2 = .4318 along x of the frame the joint moves
    assert!((bodies[1].center_of_mass - Vector3::new(0.068, 0.006, 0.2275)).norm() < 1e-15);
}

#[test]
fn planar_arms() {
    for (name, lengths) in [("planar3r", vec![3.0, 2.5, 2.0]), ("planar4r", vec![3.0, 2.5, 2.0, 1.5])] {
        let arm = catalog::load(name).unwrap();
        let tip = arm.forward(&vec![0.0; lengths.len()]).unwrap();
        assert_eq!(tip.translation.vector, Vector3::new(lengths.iter().sum(), 0.0, 0.0));
        assert!(arm.lower().iter().all(|v| *v == f64::NEG_INFINITY));
        assert!(arm.upper().iter().all(|v| *v == f64::INFINITY));
        assert!(arm.inertias().is_none());
    }
}

fn standard_row(a: f64, d: f64, alpha: f64, q: f64) -> Matrix4<f64> {
    let ((s, c), (sa, ca)) = (q.sin_cos(), alpha.to_radians().sin_cos());
    Matrix4::new(
        c,
        -s * ca,
        s * sa,
        a * c, //
        s,
        c * ca,
        -c * sa,
        a * s, //
        0.0,
        sa,
        ca,
        d, //
        0.0,
        0.0,
        0.0,
        1.0,
    )
}
