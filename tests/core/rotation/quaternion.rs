use std::f64::consts::{FRAC_PI_2, PI};

use proptest::prelude::*;
use redundancy_core::nalgebra::{Rotation3, UnitQuaternion, Vector3};
use redundancy_core::rotation::*;

use super::Random;

fn matrix(axis: Vector3<f64>, angle: f64) -> Rotation3<f64> {
    Rotation3::from_scaled_axis(axis * angle)
}

fn unit() -> impl Strategy<Value = UnitQuaternion<f64>> {
    any::<u64>().prop_map(|seed| Random::new(seed).rotation())
}

proptest! {
    /// The sequences against products of nalgebra's rotation matrices.
    #[test]
    fn sequences_are_products_of_matrices(a in -7.0..7.0_f64, b in -7.0..7.0_f64, c in -7.0..7.0_f64) {
        let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
        let same = |q: UnitQuaternion<f64>, m: Rotation3<f64>| {
            (q.to_rotation_matrix().matrix() - m.matrix()).amax() < 1e-14
        };
        prop_assert!(same(from_zyz([a, b, c]), matrix(z, a) * matrix(y, b) * matrix(z, c)));
        prop_assert!(same(from_xyz([a, b, c]), matrix(x, a) * matrix(y, b) * matrix(z, c)));
        prop_assert!(same(from_rpy([a, b, c]), matrix(z, a) * matrix(y, b) * matrix(x, c)));
    }

    #[test]
    fn angles_go_both_ways(q in unit()) {
        for (angles, back) in [
            (to_zyz(&q), from_zyz(to_zyz(&q))),
            (to_xyz(&q), from_xyz(to_xyz(&q))),
            (to_rpy(&q), from_rpy(to_rpy(&q))),
        ] {
            prop_assert!(rotation_angle(&q, &back) < 1e-14);
            prop_assert!(angles.iter().all(|a| *a > -PI && *a <= PI));
        }
        prop_assert!(to_zyz(&q)[1] >= 0.0 && to_xyz(&q)[1].abs() <= FRAC_PI_2);
    }

    #[test]
    fn swing_and_twist_compose(q in unit(), seed in any::<u64>()) {
        let axis = unit_direction("axis", Random::new(seed).direction()).unwrap();
        let (swing, twist) = swing_twist(&q, &axis);
        prop_assert!(rotation_angle(&(swing * twist), &q) < 1e-14);
        prop_assert!(swing.imag().dot(&axis).abs() < 1e-14);
        prop_assert!(twist.imag().cross(&axis).norm() < 1e-15 && twist.w >= 0.0);
        // The nearest rotation about the axis: no other is closer.
        for step in [-0.01, 0.01] {
            let other = twist * UnitQuaternion::from_axis_angle(&axis, step);
            prop_assert!(rotation_angle(&other, &q) >= rotation_angle(&twist, &q) - 1e-12);
        }
    }

    #[test]
    fn shortest_arcs_are_shortest(s in any::<u64>(), t in any::<u64>()) {
        let d = |seed| unit_direction("d", Random::new(seed).direction()).unwrap();
        let (from, to) = (d(s), d(t));
        let arc = shortest_arc(&from, &to);
        prop_assert!((arc * from.into_inner() - to.into_inner()).norm() < 1e-14 && arc.w >= 0.0);
        prop_assert!((arc.angle() - from.angle(&to)).abs() < 1e-7);
    }

    #[test]
    fn errors_take_one_frame_to_the_other(a in unit(), b in unit()) {
        let e = quaternion_error(&a, &b);
        prop_assert!(rotation_angle(&(a * e), &b) < 1e-14);
        prop_assert!(e.w >= 0.0 && (2.0 * e.w.acos() - rotation_angle(&a, &b)).abs() < 1e-7);
        let minus = UnitQuaternion::new_unchecked(-b.into_inner());
        prop_assert!(quaternion_error(&a, &minus).coords == e.coords);
    }
}

/// Degenerate at exactly the middle angle, and on both sides of it.
#[test]
fn degenerate_angles() {
    for beta in [0.0, 1e-15, 1e-13, 1e-11, 1e-9, 1e-7] {
        for tilt in [beta, PI - beta] {
            let q = from_zyz([0.7, tilt, -0.3]);
            let angles = to_zyz(&q);
            assert!(rotation_angle(&from_zyz(angles), &q) < 1e-12, "{tilt}");
            assert!((angles[1] - tilt).abs() < 1e-14, "beta keeps its digits: {} for {tilt}", angles[1]);
        }
        for tilt in [FRAC_PI_2 - beta, beta - FRAC_PI_2] {
            for (angles, back) in [
                (to_xyz(&from_xyz([0.7, tilt, -0.3])), from_xyz(to_xyz(&from_xyz([0.7, tilt, -0.3])))),
                (to_rpy(&from_xyz([0.7, tilt, -0.3])), from_rpy(to_rpy(&from_xyz([0.7, tilt, -0.3])))),
            ] {
                assert!(rotation_angle(&back, &from_xyz([0.7, tilt, -0.3])) < 1e-12, "{tilt} {angles:?}");
            }
            assert!((to_xyz(&from_xyz([0.7, tilt, -0.3]))[1] - tilt).abs() < 1e-14);
        }
    }
    assert_eq!(to_zyz(&from_zyz([0.5, 0.0, 0.25])), [0.0, 0.0, 0.75]);
    assert_eq!(to_zyz(&from_zyz([0.5, PI, 0.25]))[0], 0.0);
}

#[test]
fn antipodal_arcs_are_half_turns() {
    let mut random = Random::new(3);
    for _ in 0..1000 {
        let d = unit_direction("d", random.direction()).unwrap();
        let arc = shortest_arc(&d, &-d);
        assert!((arc * d.into_inner() + d.into_inner()).norm() < 1e-15 && arc.w == 0.0);
        for gap in [1e-15, 1e-11, 1e-8, 1e-4] {
            let e = unit_direction("e", random.direction()).unwrap();
            let near = unit_direction("n", (e.into_inner() * gap - d.into_inner()).into()).unwrap();
            let arc = shortest_arc(&d, &near);
            assert!((arc * d.into_inner() - near.into_inner()).norm() < 1e-14, "gap {gap:e}");
            assert!((arc.norm() - 1.0).abs() < 1e-15);
        }
    }
    for axis in [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()] {
        assert!((shortest_arc(&axis, &-axis) * axis.into_inner() + axis.into_inner()).norm() < 1e-15);
    }
}

#[test]
fn bad_quaternions_and_directions_are_refused() {
    assert!(from_wxyz([2., 0., 0., 0.]).unwrap_err().to_string().contains("norm 2"));
    assert!(from_wxyz([f64::NAN, 0., 0., 0.]).unwrap_err().to_string().contains("NaN"));
    assert!((from_wxyz([1.0 + 1e-7, 0., 0., 0.]).unwrap().norm() - 1.0).abs() < 1e-15);
    assert!(unit_direction("normal", [0., 0., 1e-12]).unwrap_err().to_string().contains("normal"));
    assert!((unit_direction("long", [3e200, 0., 4e200]).unwrap().z - 0.8).abs() < 1e-15);
}
