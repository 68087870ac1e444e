use redundancy_core::nalgebra::{UnitQuaternion, Vector3};
use redundancy_core::rotation::*;

use super::Random;

fn constraints(random: &mut Random) -> [Constraint; 6] {
    let angle = random.uniform(0.05, 3.0);
    let (a, b) = (random.direction(), random.direction());
    [
        Cone::new(a, b, angle).unwrap().into(),
        Cone::z(b, angle).unwrap().into(),
        Cone::x(b, angle).unwrap().into(),
        Cone::downward(angle).unwrap().into(),
        // The derivatives do not depend on the largest angle; a small kappa keeps rounding out of the differences.
        Spin::new(random.rotation(), 0.5 * angle, a).unwrap().into(),
        Spin::about_world_axis(random.rotation(), 0.5 * angle, a).unwrap().into(),
    ]
}

/// Gradient and Hessian against central differences on the manifold at 1 000 points, to 1e-7 (relative where the
/// derivative itself is large, near the pole of a spin).
#[test]
fn derivatives_agree_with_central_differences() {
    let mut random = Random::new(1);
    for _ in 0..1000 {
        let q = random.rotation();
        for constraint in constraints(&mut random) {
            let moved = |d: Vector3<f64>| q * UnitQuaternion::from_scaled_axis(d);
            let (g, h) = (constraint.gradient(&q), constraint.hessian(&q));
            // The third derivative of a spin's margin grows like the fifth power of 1 / cos(swing / 2).
            let pole = match &constraint {
                Constraint::Cone(_) => 1.0,
                Constraint::Spin(s) => (s.reference().inverse() * q).w.abs(),
            };
            if pole < 0.1 {
                continue;
            }
            let scale = pole.powi(-5);
            let e = 1e-5;
            for i in 0..3 {
                let step = Vector3::ith(i, e);
                let slope = (constraint.margin(&moved(step)) - constraint.margin(&moved(-step))) / (2.0 * e);
                assert!((slope - g[i]).abs() < 1e-7 * scale.max(1.0), "{constraint:?}: {slope} {}", g[i]);
            }
            // The Hessian along geodesics: second differences of the value, in all directions of a basis of forms.
            let e = 2e-4;
            for (i, j) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)] {
                let d =
                    if i == j { Vector3::ith(i, 1.0) } else { Vector3::ith(i, 1.0) + Vector3::ith(j, 1.0) };
                let f = |t: f64| constraint.margin(&moved(d * t));
                let bend = (-f(2. * e) + 16. * f(e) - 30. * f(0.) + 16. * f(-e) - f(-2. * e)) / (12. * e * e);
                let expected = d.dot(&(h * d));
                assert!((bend - expected).abs() < 1e-7 * scale.max(1.0), "{constraint:?}: {bend} {expected}");
            }
        }
    }
}

/// The paper's quadratic forms [FromGravdahl2009, eqs. (15), (23), (33), (31), (43), (20), (46)].
#[test]
fn margins_are_the_printed_forms() {
    let mut random = Random::new(2);
    for _ in 0..500 {
        let (q, frame, angle) = (random.rotation(), random.rotation(), random.uniform(0.05, 3.0));
        let [q0, q1, q2, q3] = to_wxyz(&q);
        let [r0, r1, r2, r3] = to_wxyz(&(frame.inverse() * q));
        let (eta, nu) = (f64::sin(angle / 2.0).powi(2), f64::cos(angle / 2.0).powi(2));
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-14 * b.abs().max(1.0), "{a} {b}");
        close(Cone::z([0., 0., 1.], angle).unwrap().margin(&q), eta - q1 * q1 - q2 * q2);
        close(Cone::x([1., 0., 0.], angle).unwrap().margin(&q), eta - q2 * q2 - q3 * q3);
        close(Cone::downward(angle).unwrap().margin(&q), q1 * q1 + q2 * q2 - nu);
        close(Cone::of_frame(&frame, [0., 0., 1.], angle).unwrap().margin(&q), eta - r1 * r1 - r2 * r2);
        let b = frame * -Vector3::x();
        close(Cone::x(b.into(), angle).unwrap().margin(&q), r2 * r2 + r3 * r3 - nu);
        let kappa = f64::tan(angle / 2.0).powi(2);
        let identity = UnitQuaternion::identity();
        let spin = |r, value: f64| {
            let got = Spin::new(r, angle, [0., 0., 1.]).unwrap().margin(&q);
            assert!((got - value).abs() < 1e-11 * value.abs().max(1.0), "{got} {value}");
        };
        spin(identity, kappa - (q3 / q0).powi(2));
        spin(frame, kappa - (r3 / r0).powi(2));
    }
}

/// A margin is positive exactly where the angle is within its bound, on 100 000 rotations.
#[test]
fn margins_against_angles() {
    let mut random = Random::new(4);
    let list = constraints(&mut random);
    for _ in 0..100_000 {
        let q = random.rotation();
        for c in &list {
            let excess = match c {
                Constraint::Cone(k) => {
                    (q * k.body_axis().into_inner()).dot(&k.direction()).clamp(-1., 1.).acos()
                        - k.half_angle()
                }
                Constraint::Spin(s) => {
                    let r = s.reference().inverse() * q;
                    2.0 * (r.imag().dot(&s.axis()) / r.w).atan().abs() - s.max_angle()
                }
            };
            assert!((c.excess(&q) - excess).abs() < 1e-7);
            if excess.abs() > 1e-9 {
                assert_eq!(c.margin(&q) > 0.0, excess < 0.0, "{c:?}");
            }
        }
    }
}

/// Cones of a hundredth of a degree keep their digits.
#[test]
fn tiny_cones_keep_their_digits() {
    let half = 1e-4_f64;
    let cone = Cone::z([0., 0., 1.], half).unwrap();
    for tilt in [0.0_f64, 3e-5, 9.9999e-5] {
        let expected = (0.5 * half).sin().powi(2) - (0.5 * tilt).sin().powi(2);
        let got = cone.margin(&from_zyz([0.3, tilt, 1.0]));
        assert!((got - expected).abs() < 1e-11 * (0.5 * half).sin().powi(2), "{got:e} {expected:e}");
    }
    let wide = Cone::z([0., 0., 1.], std::f64::consts::PI - half).unwrap();
    let tilt = std::f64::consts::PI - 2.0 * half;
    let expected = half.sin().powi(2) - (0.5 * half).sin().powi(2);
    let got = wide.margin(&from_zyz([0.3, tilt, 1.0]));
    // Half a unit in the last place of the half-angle, near pi, is 2e-12 of what is left of it.
    assert!((got - expected).abs() < 1e-11 * expected, "{got:e} {expected:e}");
}

/// Where the swing is half a turn the spin is undefined: outside, finite, flat.
#[test]
fn the_pole_of_a_spin_is_outside() {
    let spin = Spin::new(UnitQuaternion::identity(), 3.0, [0., 0., 1.]).unwrap();
    for w in [0.0, 1e-16, 1e-10, 1e-8, 1e-3] {
        for along in [0.0, 1e-12, 0.5] {
            let q =
                UnitQuaternion::new_normalize(redundancy_core::nalgebra::Quaternion::new(w, 1.0, 0.0, along));
            let (m, g, h) = (spin.margin(&q), spin.gradient(&q), spin.hessian(&q));
            assert!(
                m.is_finite() && g.iter().chain(h.iter()).all(|x| x.is_finite()),
                "w {w:e} along {along:e}"
            );
            if w < 1e-9 {
                assert!(m < 0.0 && g.norm() == 0.0);
            }
        }
    }
}

#[test]
fn bad_input_is_refused() {
    let z = [0., 0., 1.];
    for angle in [0.0, -0.1, std::f64::consts::PI, 4.0, f64::NAN, f64::INFINITY] {
        let text = Cone::z(z, angle).unwrap_err().to_string();
        assert!(text.contains("half-angle") && text.contains("(0, pi)"), "{text}");
        assert!(Spin::new(UnitQuaternion::identity(), angle, z).is_err());
    }
    assert!(Cone::z([0.; 3], 1.0).unwrap_err().to_string().contains("direction"));
    assert!(Cone::new([f64::NAN, 0., 0.], z, 1.0).unwrap_err().to_string().contains("NaN"));
    for weight in [-1.0, 0.0, f64::NAN, f64::INFINITY] {
        let text = Barrier::new(weight, Cone::downward(1.0).unwrap()).unwrap_err().to_string();
        assert!(text.contains("weight") && text.contains("positive"), "{text}");
    }
}
