use std::f64::consts::PI;

use redundancy_core::nalgebra::UnitQuaternion;
use redundancy_core::rotation::*;

use super::{Random, full};

fn deg(x: f64) -> f64 {
    x.to_radians()
}

fn range(low: f64, high: f64) -> [f64; 2] {
    [deg(low), deg(high)]
}

const FREE: [f64; 2] = [-PI, PI];

fn t1() -> UnitQuaternion<f64> {
    from_zyz([deg(30.), deg(15.), deg(-20.)])
}

fn close(a: &[f64], b: &[f64], tol: f64) {
    for (x, y) in a.iter().zip(b) {
        assert!((x - y).abs() <= tol, "{a:?} is not {b:?} within {tol:e}");
    }
}

/// Vectors computed independently of this library.
#[test]
fn vectors_computed_independently() {
    close(&to_wxyz(&t1()), &[0.9876721144, -0.0551627525, 0.1182969044, 0.0864101133], 1e-10);
    let cone = |half: f64| QuaternionVolume::cone([0., 0., 1.], deg(half)).unwrap();
    assert!((cone(20.).margin(&t1()) - 0.0131166028).abs() < 1e-10);
    assert!(cone(15.).margin(&t1()).abs() < 1e-15 && cone(15.).contains(&t1(), 1e-9));
    let zyz = QuaternionVolume::zyz(FREE, [0., PI], FREE).unwrap();
    close(
        &to_wxyz(&zyz.visualising(&t1())),
        &[0.984807753, -0.0389221742, -0.0224717278, -0.1677312595],
        1e-10,
    );
    let flip = from_wxyz([0., 0., 1., 0.]).unwrap();
    let t4 = flip * t1();
    assert!(!cone(20.).contains(&t4, 1e-9));
    assert!(cone(20.).reoriented(&flip).contains(&t4, 1e-9));
    assert!(
        QuaternionVolume::cone_around([0., 0., 1.], [0., 0., -1.], deg(20.)).unwrap().contains(&t4, 1e-9)
    );
    let t5 = from_zyz([0., 0., deg(40.)]);
    let zyz = |gamma| QuaternionVolume::zyz(range(0., 10.), range(0., 20.), gamma).unwrap();
    assert!((zyz(range(0., 20.)).margin(&t5) + deg(5.)).abs() < 1e-12);
    assert!(!zyz(range(0., 20.)).contains(&t5, 1e-9));
    assert!(zyz(range(0., 30.)).margin(&t5).abs() < 1e-12 && zyz(range(0., 30.)).contains(&t5, 1e-9));
}

fn kinds() -> Vec<(&'static str, QuaternionVolume)> {
    let r = Random::new(5).rotation();
    let oblique = [[1., 0.2, 0.1], [0.3, 1., -0.2], [0.1, 0.4, 1.]];
    vec![
        ("zyz", QuaternionVolume::zyz(range(-40., 100.), range(10., 70.), range(-170., 20.)).unwrap()),
        (
            "zyz both branches",
            QuaternionVolume::zyz(range(-150., 170.), range(-60., 80.), range(-120., 140.)).unwrap(),
        ),
        ("zyz wrapped", QuaternionVolume::zyz(range(100., 300.), range(20., 90.), FREE).unwrap()),
        ("xyz", QuaternionVolume::xyz(range(-30., 50.), range(-60., 100.), range(-100., 20.)).unwrap()),
        ("pyramid", QuaternionVolume::pyramid(deg(30.), deg(20.)).unwrap()),
        ("oblique", QuaternionVolume::from_axes(&oblique, &[-1., -0.5, -2.], &[1.5, 2.0, 1.]).unwrap()),
        ("cone", QuaternionVolume::cone([0.2, 0.4, 1.], deg(50.)).unwrap()),
        (
            "reoriented",
            QuaternionVolume::xyz(range(-50., 50.), range(-60., 40.), FREE)
                .unwrap()
                .reoriented(&r)
                .reoriented_in_body(&t1()),
        ),
        ("two", QuaternionVolume::from_axes(&oblique[..2], &[-1., -2.], &[1.5, 2.0]).unwrap()),
        ("one", QuaternionVolume::single_axis([1., 2., 2.], range(-50., 70.)).unwrap()),
    ]
}

#[test]
fn samples_are_members_and_repeat() {
    for (name, volume) in kinds() {
        let sample = volume.sample(2000, 11);
        assert_eq!(sample, volume.sample(2000, 11));
        assert_ne!(sample[..5], volume.sample(5, 12)[..]);
        for q in &sample {
            assert!(volume.contains(q, 1e-9), "{name}: {:?} margin {}", to_wxyz(q), volume.margin(q));
            let minus = UnitQuaternion::new_unchecked(-q.into_inner());
            assert!((volume.margin(q) - volume.margin(&minus)).abs() < 1e-12, "{name}: -q");
            let angles = volume.angles(q);
            let back = volume.at(&angles[..volume.dimension()]).unwrap();
            assert!(rotation_angle(&back, q) < 1e-9, "{name}: angles do not give the orientation back");
        }
    }
}

/// Members are exactly the rotations of a dense random set that lie in the box: the share of uniform rotations inside
/// equals the integral of the invariant measure, and the sampled middle angles follow it.
#[test]
fn share_of_uniform_rotations_is_the_measure() {
    let n = if full() { 1_000_000 } else { 100_000 };
    let mut random = Random::new(3);
    let all: Vec<_> = (0..n).map(|_| random.rotation()).collect();
    let share = |v: &QuaternionVolume| all.iter().filter(|q| v.contains(q, 0.0)).count() as f64 / n as f64;
    let sigma = |p: f64| 5.0 * (p * (1.0 - p) / n as f64).sqrt();
    let zyz = QuaternionVolume::zyz(range(-40., 100.), range(10., 70.), range(-170., 20.)).unwrap();
    // (width alpha)(cos 10 - cos 70)(width gamma) / 8 pi^2
    let expected = deg(140.) * (deg(10.).cos() - deg(70.).cos()) * deg(190.) / (8.0 * PI * PI);
    assert!((share(&zyz) - expected).abs() < sigma(expected), "{} {expected}", share(&zyz));
    let xyz = QuaternionVolume::xyz(range(-30., 50.), range(-60., 80.), range(-100., 20.)).unwrap();
    let expected = deg(80.) * (deg(80.).sin() + deg(60.).sin()) * deg(120.) / (8.0 * PI * PI);
    assert!((share(&xyz) - expected).abs() < sigma(expected), "{} {expected}", share(&xyz));
    let cone = QuaternionVolume::cone([1., 2., -0.5], deg(50.)).unwrap();
    let expected = 0.5 * (1.0 - deg(50.).cos());
    assert!((share(&cone) - expected).abs() < sigma(expected), "{} {expected}", share(&cone));
}

/// Uniform: equal shares of a smaller volume among samples and among rejection-sampled rotations.
#[test]
fn samples_are_uniform() {
    let mut random = Random::new(17);
    for (name, volume) in kinds() {
        if volume.dimension() < 3 {
            continue;
        }
        let n = 40_000;
        let drawn = volume.sample(n, 99);
        let mut rejected = vec![];
        while rejected.len() < n {
            let q = random.rotation();
            if volume.contains(&q, 0.0) {
                rejected.push(q);
            }
        }
        for probe in 0..6 {
            let centre = rejected[probe * 7];
            let count = |list: &[UnitQuaternion<f64>]| {
                list.iter().filter(|q| rotation_angle(q, &centre) < 0.5).count() as f64
            };
            let (a, b) = (count(&drawn), count(&rejected));
            assert!(
                (a - b).abs() < 5.0 * (a + b).sqrt() + 1.0,
                "{name}: {a} samples against {b} by rejection"
            );
        }
    }
}

/// The nearest member is a member, not farther than any of many sampled members, and the distance is stationary.
#[test]
fn nearest_is_a_member_and_nearest() {
    let mut random = Random::new(23);
    let trials = if full() { 400 } else { 60 };
    for (name, volume) in kinds() {
        let sample = volume.sample(5000, 1);
        for _ in 0..trials {
            let q = random.rotation();
            let near = volume.nearest(&q);
            assert!(volume.contains(&near, 1e-7), "{name}: margin {:e}", volume.margin(&near));
            assert!(near.coords.dot(&q.coords) >= 0.0);
            let distance = rotation_angle(&near, &q);
            let best = sample.iter().map(|s| rotation_angle(s, &q)).fold(f64::INFINITY, f64::min);
            assert!(distance <= best + 1e-12, "{name}: {distance} but a sample is at {best}");
            if volume.margin(&q) >= 0.0 {
                assert_eq!(near, q);
            }
            // No small move along the angles inside the box comes nearer.
            let k = volume.dimension();
            let angles = volume.angles(&near);
            for i in 0..k {
                for step in [1e-4, -1e-4] {
                    let mut moved = angles.clone();
                    moved[i] += step;
                    let other = volume.at(&moved[..k]).unwrap();
                    if volume.margin(&other) >= 0.0 {
                        assert!(rotation_angle(&other, &q) >= distance - 1e-10, "{name}: angle {i}");
                    }
                }
            }
        }
    }
}

#[test]
fn degenerate_boxes_and_gimbals() {
    // beta fixed at 0: all samples are at the gimbal.
    let flat = QuaternionVolume::zyz(range(0., 10.), [0., 0.], range(0., 30.)).unwrap();
    for q in flat.sample(500, 2) {
        assert!(flat.contains(&q, 1e-9), "{}", flat.margin(&q));
    }
    // beta = pi: the difference of the outer angles counts.
    let down = QuaternionVolume::zyz(range(0., 10.), [PI, PI], range(0., 30.)).unwrap();
    for q in down.sample(500, 2) {
        assert!(down.contains(&q, 1e-9), "{}", down.margin(&q));
    }
    assert!(!down.contains(&from_zyz([0., PI, deg(45.)]), 1e-9));
    // XYZ at beta = 90 deg.
    let side = QuaternionVolume::xyz(range(0., 10.), range(90., 90.), range(0., 30.)).unwrap();
    assert!(side.contains(&from_xyz([deg(20.), deg(90.), deg(20.)]), 1e-9));
    assert!(!side.contains(&from_xyz([deg(30.), deg(90.), deg(20.)]), 1e-9));
    // Close to the gimbal the outer angles are noise, membership is not.
    let thin = QuaternionVolume::zyz(range(0., 10.), [0., 1.], range(0., 30.)).unwrap();
    for beta in [0.0, 1e-16, 1e-12, 1e-10, 1e-9, 2e-9, 1e-8, 1e-6, 1e-4, 1e-2] {
        let inside = from_zyz([deg(10.0), beta, deg(30.)]);
        assert!(thin.contains(&inside, 1e-9), "beta {beta:e}: {:e}", thin.margin(&inside));
        let outside = from_zyz([deg(10.0), beta, deg(30.1)]);
        assert!(!thin.contains(&outside, 1e-9), "beta {beta:e}: {:e}", thin.margin(&outside));
    }
}

#[test]
fn off_the_set_the_margin_is_the_angle() {
    let line = QuaternionVolume::single_axis([0., 0., 1.], range(-50., 70.)).unwrap();
    let q = from_zyz([0.2, 0.1, 0.3]);
    assert!((line.margin(&q) + 0.1).abs() < 1e-12);
    assert!((line.margin(&from_zyz([0.2, 0.0, 0.3])) - (deg(70.) - 0.5)).abs() < 1e-12);
    assert_eq!(
        QuaternionVolume::single_axis([1., 0., 0.], FREE).unwrap().margin(&from_xyz([1., 0., 0.])),
        PI
    );
}

#[test]
fn reorientation_moves_the_set() {
    let mut random = Random::new(31);
    for (name, volume) in kinds() {
        for _ in 0..50 {
            let (p, s, q) = (random.rotation(), random.rotation(), random.rotation());
            let moved = volume.reoriented(&p).reoriented_in_body(&s);
            assert!((moved.margin(&(p * q * s)) - volume.margin(&q)).abs() < 1e-9, "{name}");
            // P then P2 is P2 * P.
            let twice = volume.reoriented(&p).reoriented(&s);
            assert!((twice.margin(&(s * p * q)) - volume.margin(&q)).abs() < 1e-9, "{name}");
        }
    }
    let cone = kinds()[6].1.reoriented(&random.rotation()).reoriented_in_body(&random.rotation());
    let q = random.rotation();
    assert!((cone.as_cone().unwrap().margin(&q) - cone.margin(&q)).abs() < 1e-15);
}

#[test]
fn visualising_points_along_the_tool() {
    let mut random = Random::new(41);
    for (_, volume) in kinds() {
        let p = random.rotation();
        let volume = volume.reoriented(&p);
        for q in volume.sample(100, 3) {
            let v = volume.visualising(&q);
            let angles = volume.angles(&q);
            let psi = angles[volume.dimension() - 1];
            assert!((v.w - (0.5 * psi).cos()).abs() < 1e-12);
            assert!((v.imag().norm() - (0.5 * psi).sin().abs()).abs() < 1e-12);
        }
    }
    let zyz = QuaternionVolume::zyz(FREE, [0., PI], FREE).unwrap();
    for _ in 0..100 {
        let q = random.rotation();
        let v = zyz.visualising(&q);
        let z = q * redundancy_core::nalgebra::Vector3::z();
        assert!(v.imag().cross(&z).norm() < 1e-12);
    }
}

#[test]
fn sections_have_their_extent() {
    let (d, eta) = (0.4, 0.2);
    let sine = d * f64::sin(eta);
    let x = QuaternionVolume::single_axis([1., 0., 0.], [-eta, eta]).unwrap();
    let section = x.cross_section(d, SectionDistance::AlongTool).unwrap();
    assert_eq!((section.shape, section.x), (SectionShape::Line, [0., 0.]));
    close(&section.y, &[-sine, sine], 1e-15);
    let disc = QuaternionVolume::cone([0., 0., 1.], eta)
        .unwrap()
        .cross_section(d, SectionDistance::AlongTool)
        .unwrap();
    assert_eq!(disc.shape, SectionShape::Disc);
    let square =
        QuaternionVolume::pyramid(eta, 0.1).unwrap().cross_section(d, SectionDistance::ToPlane).unwrap();
    assert_eq!(square.shape, SectionShape::Square);
    // The tool axis itself: tilted about y by 0.1 it meets the plane at d tan(0.1) along x.
    let z = from_xyz([0., 0.1, 0.]) * redundancy_core::nalgebra::Vector3::z();
    assert!((square.x[1] - d * z.x / z.z).abs() < 1e-15);
    let z = from_xyz([eta, 0., 0.]) * redundancy_core::nalgebra::Vector3::z();
    assert!((square.y[0] - d * z.y / z.z).abs() < 1e-15);
    assert!(kinds()[5].1.cross_section(d, SectionDistance::AlongTool).is_err());
}

#[test]
fn bad_input_is_refused_by_name() {
    let message = |r: redundancy_core::Result<QuaternionVolume>| r.unwrap_err().to_string();
    let axis = [[1., 0., 0.], [0., 1., 0.], [0., 0., 1.], [1., 0., 0.]];
    assert!(QuaternionVolume::from_axes(&axis, &[0.; 4], &[1.; 4]).is_ok());
    assert!(message(QuaternionVolume::from_axes(&[], &[], &[])).contains("0 rotations"));
    assert!(
        message(QuaternionVolume::from_axes(&[axis[0], axis[0]], &[0.; 2], &[1.; 2])).contains("parallel")
    );
    assert!(message(QuaternionVolume::single_axis([0.; 3], [0., 1.])).contains("length"));
    assert!(message(QuaternionVolume::single_axis([0., 0., 1.], [1., 0.])).contains("above"));
    assert!(message(QuaternionVolume::single_axis([0., 0., 1.], [f64::NAN, 0.])).contains("NaN"));
    assert!(message(QuaternionVolume::cone([0., 0., 1.], 0.)).contains("in (0, pi)"));
    assert!(message(QuaternionVolume::cone([0., 0., 1.], PI)).contains("in (0, pi)"));
    assert!(message(QuaternionVolume::pyramid(0.3, 1.6)).contains("half_y is 1.6"));
}
