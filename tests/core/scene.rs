//! Distances against brute force.

use rand::Rng;
use redundancy_core::chain::{Chain, catalog};
use redundancy_core::criterion::{Clearance, Criterion, Elbow, Sense, Weighted};
use redundancy_core::kinematics::Scratch;
use redundancy_core::nalgebra::Vector3;
use redundancy_core::scene::{
    Capsule, Cuboid, LinkGeometry, Obstacle, Proximity, ProximityMemory, Scene, Shape, Sphere, Surroundings,
    segment_distance,
};
use std::sync::Arc;

use super::allocations;
use super::criterion::against_differences;
use super::support::{random_pose, rng};

fn vector(rng: &mut impl Rng, size: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| rng.random_range(-size..size))
}

pub fn random_shape(rng: &mut impl Rng, size: f64) -> Shape {
    match rng.random_range(0..3) {
        0 => Sphere { center: vector(rng, size), radius: rng.random_range(0.0..0.3) }.into(),
        1 => {
            let half_extents = Vector3::from_fn(|_, _| rng.random_range(0.0..0.4));
            Cuboid { pose: random_pose(rng, size), half_extents }.into()
        }
        _ => {
            let (start, end) = (vector(rng, size), vector(rng, size));
            Capsule { start, end, radius: rng.random_range(0.0..0.2) }.into()
        }
    }
}

/// Signed distance of a point, written out a second time.
pub fn point_distance(p: &Vector3<f64>, shape: &Shape) -> f64 {
    match shape {
        Shape::Sphere(s) => (p - s.center).norm() - s.radius,
        Shape::Capsule(c) => {
            let d = c.end - c.start;
            let t = if d.norm_squared() > 0.0 { (p - c.start).dot(&d) / d.norm_squared() } else { 0.0 };
            (p - c.start - d * t.clamp(0.0, 1.0)).norm() - c.radius
        }
        Shape::Cylinder(_) | Shape::HalfSpace(_) | Shape::Mesh(_) => unreachable!("tested in bodies.rs"),
        Shape::Box(b) => {
            let x = b.pose.inverse_transform_point(&(*p).into());
            let e = Vector3::from_fn(|i, _| x[i].abs() - b.half_extents[i]);
            e.map(|e| e.max(0.0)).norm() + e.max().min(0.0)
        }
    }
}

/// The signed distance of convex shapes is convex along a segment: nested intervals find its minimum.
fn brute_force(a: &Vector3<f64>, b: &Vector3<f64>, shape: &Shape) -> f64 {
    let at = |t: f64| point_distance(&(a + (b - a) * t), shape);
    let (mut lo, mut hi) = (0.0, 1.0);
    for _ in 0..200 {
        let (one, two) = (lo + (hi - lo) / 3.0, hi - (hi - lo) / 3.0);
        if at(one) <= at(two) { hi = two } else { lo = one }
    }
    at(0.5 * (lo + hi)).min(at(0.0)).min(at(1.0))
}

#[test]
fn segments_against_brute_force() {
    let mut rng = rng(30);
    let (mut inside, mut outside) = (0, 0);
    for round in 0..super::support::amount(20_000, 400_000) {
        let shape = random_shape(&mut rng, 0.5);
        let a = vector(&mut rng, 0.6);
        let b = match round % 4 {
            0 => a,                                              // a point
            1 => a + Vector3::x() * rng.random_range(-1.0..1.0), // along an axis
            _ => vector(&mut rng, 0.6),
        };
        let near = segment_distance(&a, &b, &shape);
        let expected = brute_force(&a, &b, &shape);
        assert!((near.distance - expected).abs() < 1e-9, "{shape:?} {a} {b}: {} {expected}", near.distance);
        assert!((near.point - a - (b - a) * near.share).norm() < 1e-14);
        assert!((0.0..=1.0).contains(&near.share));
        assert!((near.normal.norm() - 1.0).abs() < 1e-12);
        // The normal leads to the surface and is the gradient of the distance of the point.
        let surface = near.point - near.normal * near.distance;
        assert!(point_distance(&surface, &shape).abs() < 1e-9, "{shape:?} {a} {b}");
        let count = if expected < 0.0 { &mut inside } else { &mut outside };
        *count += 1;
    }
    assert!(inside > 1_000 && outside > 1_000, "{inside} {outside}");
}

#[test]
fn segments_at_special_places() {
    let unit = Cuboid { pose: redundancy_core::Pose::identity(), half_extents: Vector3::new(1.0, 2.0, 3.0) };
    let at = |a: [f64; 3], b: [f64; 3], shape: Shape| segment_distance(&a.into(), &b.into(), &shape);
    // Through the whole box, along a face, along an edge, in the middle, touching a corner.
    for (a, b, expected) in [
        ([-5.0, 0.0, 0.0], [5.0, 0.0, 0.0], -1.0),
        ([0.0, -5.0, 0.5], [0.0, 5.0, 0.5], -1.0),
        ([1.0, -5.0, 0.0], [1.0, 5.0, 0.0], 0.0),
        ([1.0, 2.0, -9.0], [1.0, 2.0, 9.0], 0.0),
        ([0.0; 3], [0.0; 3], -1.0),
        ([1.0, 2.0, 3.0], [2.0, 3.0, 4.0], 0.0),
        ([0.9, 1.9, 2.95], [0.9, 1.9, 2.95], -0.05),
        ([2.0, 3.0, 4.0], [2.0, 3.0, 4.0], 3.0f64.sqrt()),
    ] {
        let near = at(a, b, unit.into());
        assert!((near.distance - expected).abs() < 1e-12, "{a:?} {b:?} {near:?}");
        assert!((near.normal.norm() - 1.0).abs() < 1e-12);
    }
    // Crossing, equal and pointlike capsules; a segment through the centre of a ball.
    let (o, x, y) = (Vector3::zeros(), Vector3::x(), Vector3::y());
    let bar = Capsule { start: -x, end: x, radius: 0.25 };
    for (a, b) in [(-y, y), (-x, x), (o, o), (x * 0.5, x * 3.0)] {
        let near = segment_distance(&a, &b, &bar.into());
        assert!((near.distance + 0.25).abs() < 1e-12 && (near.normal.norm() - 1.0).abs() < 1e-12);
        let near = segment_distance(&a, &b, &Sphere { center: a, radius: 0.25 }.into());
        assert!((near.distance + 0.25).abs() < 1e-12 && (near.normal.norm() - 1.0).abs() < 1e-12);
    }
}

fn arms() -> Vec<Chain> {
    let mut arms: Vec<Chain> =
        ["iiwa14", "pa10", "panda", "dexter"].map(|name| catalog::load(name).unwrap()).into();
    let urdf = include_str!("../data/arm.urdf");
    let limits = redundancy_core::chain::MissingLimits::Refuse;
    arms.push(Chain::from_urdf_string(urdf, Some("world"), Some("flange"), limits).unwrap());
    arms
}

fn random_scene(rng: &mut impl Rng, n: usize) -> Scene {
    let shapes: Vec<Shape> = (0..n).map(|_| random_shape(rng, 0.8)).collect();
    Scene::new(&shapes).unwrap()
}

#[test]
fn clearance_is_the_least_of_all_pairs() {
    let mut rng = rng(31);
    for arm in arms() {
        let mut scratch = Scratch::new(&arm);
        for _ in 0..60 {
            let scene = random_scene(&mut rng, 6);
            let q: Vec<f64> = (0..arm.dof()).map(|_| rng.random_range(-2.0..2.0)).collect();
            let clearance = scene.clearance(&arm, &q, 0.05).unwrap().unwrap();
            // Joint origins and the tool, from the kinematics; every pair, no bounds.
            let kinematics = arm.kinematics(&q, &mut scratch).unwrap();
            let mut points = kinematics.origins().to_vec();
            points.push(kinematics.pose().translation.vector);
            let least = points.windows(2).flat_map(|ends| {
                scene
                    .obstacles()
                    .iter()
                    .map(|o| brute_force(&ends[0], &ends[1], &o.shape) - 0.05)
                    .collect::<Vec<_>>()
            });
            let least = least.fold(f64::INFINITY, f64::min);
            assert!((clearance.distance - least).abs() < 1e-9, "{}", arm.name());
            let gap = clearance.on_link - clearance.on_obstacle;
            assert!((gap - clearance.normal * clearance.distance).norm() < 1e-12);
            let obstacle = &scene.obstacles()[clearance.obstacle].shape;
            assert!(point_distance(&clearance.on_obstacle, obstacle).abs() < 1e-9);
            let geometry = LinkGeometry::joint_to_joint(&arm, 0.05).unwrap();
            let name = &geometry.names()[clearance.link];
            assert!(arm.links().iter().any(|link| link.name == *name && link.joints_before > 0));
        }
        let scene = random_scene(&mut rng, 5);
        let geometry = LinkGeometry::joint_to_joint(&arm, 0.05).unwrap();
        let q: Vec<f64> = (0..100 * arm.dof()).map(|_| rng.random_range(-2.0..2.0)).collect();
        let around = Surroundings::new(&arm, &geometry, Some(&scene), false).unwrap();
        let rows = Scene::clearance_batch(&arm, &q, &around).unwrap();
        for (q, row) in q.chunks_exact(arm.dof()).zip(rows) {
            let least = scene.clearance(&arm, q, 0.05).unwrap().unwrap();
            assert!(row.contains(&Some(least)));
            assert!(row.iter().flatten().all(|pair| pair.distance >= least.distance));
        }
        let kinematics = arm.kinematics(&q[..arm.dof()], &mut scratch).unwrap();
        let mut memory = ProximityMemory::new();
        let mut nearest = || around.nearest(&kinematics, 0.0, f64::INFINITY, &mut memory);
        nearest();
        assert_eq!(allocations::count(nearest), 0);
    }
    let empty = Scene::new(&[]).unwrap();
    assert_eq!(empty.clearance(&arms()[0], &[0.0; 7], 0.05).unwrap(), None);
}

#[test]
fn capsules_of_a_link_move_with_it() {
    let mut rng = rng(35);
    for arm in arms() {
        let (mut scratch, last) = (Scratch::new(&arm), arm.links().len() - 1);
        for link in 0..=last {
            let geometry = LinkGeometry::default();
            let (start, end) = ([0.1, -0.2, 0.05], [0.3, 0.1, -0.4]);
            let made = geometry.with_capsule(&arm, link, start, end, 0.02);
            if arm.links()[link].joints_before == 0 {
                assert!(made.unwrap_err().to_string().contains(&arm.links()[link].name));
                continue;
            }
            let made = made.unwrap();
            let q: Vec<f64> = (0..arm.dof()).map(|_| rng.random_range(-2.0..2.0)).collect();
            let pose = arm.forward_link(&q, link).unwrap();
            let [a, b] = [start, end].map(|p| pose.transform_point(&Vector3::from(p).into()).coords);
            let scene =
                Scene::new(&[Sphere { center: b + Vector3::x() * 0.1, radius: 0.05 }.into()]).unwrap();
            let around = Surroundings::new(&arm, &made, Some(&scene), false).unwrap();
            let kinematics = arm.kinematics(&q, &mut scratch).unwrap();
            let near = around.nearest(&kinematics, 0.0, f64::INFINITY, &mut ProximityMemory::new()).unwrap();
            let expected = segment_distance(&a, &b, &scene.obstacles()[0].shape).distance - 0.02;
            assert!((near.gap.distance - expected).abs() < 1e-14);
            let h = Clearance::of(around, 0.0).unwrap();
            assert!(against_differences(&h, &q, 1e-6).0 < 1e-7);
        }
    }
}

#[test]
fn clearance_criterion_against_differences() {
    let mut rng = rng(32);
    for arm in arms() {
        for smoothing in [0.0, 0.002, 0.02] {
            let (mut checked, mut kinks) = (0, 0);
            while checked < 100 {
                let scene = random_scene(&mut rng, 6);
                let geometry = LinkGeometry::joint_to_joint(&arm, 0.05).unwrap();
                let around = Surroundings::new(&arm, &geometry, Some(&scene), false).unwrap();
                let h = Clearance::of(around, smoothing).unwrap();
                assert_eq!(h.sense(), Sense::Maximize);
                let q: Vec<f64> = (0..arm.dof()).map(|_| rng.random_range(-2.0..2.0)).collect();
                let distance = scene.clearance(&arm, &q, 0.05).unwrap().unwrap().distance;
                let value = h.value(&q);
                assert!(value <= distance + 1e-15 && value >= distance - smoothing * 42.0f64.ln());
                checked += 1;
                // Differences across a kink of one pair's distance say nothing; they must stay rare.
                let (first, second) = against_differences(&h, &q, 1e-6);
                if first > 1e-6 {
                    kinks += 1;
                } else if smoothing == 0.02 {
                    kinks += usize::from(second > 1e-4);
                }
            }
            assert!(kinks <= 4, "{} {smoothing}: {kinks} of {checked}", arm.name());
        }
    }
    let empty = Clearance::new(&arms()[0], &Scene::new(&[]).unwrap(), 0.05).unwrap();
    let mut out = [1.0; 7];
    empty.gradient(&[0.0; 7], &mut out);
    assert_eq!((out, empty.value(&[0.0; 7])), ([0.0; 7], f64::INFINITY));
}

#[test]
fn elbow_against_differences() {
    let mut rng = rng(33);
    for arm in arms() {
        for link in 0..=arm.links().len() {
            let point = [0.3, -0.2, 0.5];
            let h = match link.checked_sub(1) {
                None => Elbow::new(&arm, point).unwrap(),
                Some(link) => Elbow::of_link(&arm, point, link).unwrap(),
            };
            for _ in 0..10 {
                let q: Vec<f64> = (0..arm.dof()).map(|_| rng.random_range(-3.0..3.0)).collect();
                let (first, second) = against_differences(&h, &q, 1e-5);
                assert!(first < 1e-9 && second < 1e-9, "{} {link}: {first:e} {second:e}", arm.name());
                if let Some(link) = link.checked_sub(1) {
                    let x = arm.forward_link(&q, link).unwrap().translation.vector;
                    assert!((h.value(&q) - (x - Vector3::from(point)).norm_squared()).abs() < 1e-13);
                }
            }
        }
    }
    // The elbow of an S-R-S arm is the frame of joint 4.
    let arm = catalog::load("iiwa14").unwrap();
    let q = [0.3, 0.5, -0.2, 1.1, 0.4, -0.7, 0.2];
    let link = arm.links().iter().position(|l| l.joints_before == 4).unwrap();
    let (a, b) = (Elbow::new(&arm, [0.0; 3]).unwrap(), Elbow::of_link(&arm, [0.0; 3], link).unwrap());
    assert!((a.value(&q) - b.value(&q)).abs() < 1e-15);
    assert!(Elbow::of_link(&arm, [0.0; 3], 99).is_err() && Elbow::new(&arm, [f64::NAN; 3]).is_err());
}

#[test]
fn clearance_and_elbow_in_a_control_step() {
    let mut rng = rng(34);
    for arm in arms() {
        let n = arm.dof();
        let mut scratch = Scratch::new(&arm);
        let scene = random_scene(&mut rng, 5);
        let clearance: Arc<dyn Criterion> = Arc::new(Clearance::new(&arm, &scene, 0.05).unwrap());
        let elbow: Arc<dyn Criterion> = Arc::new(Elbow::new(&arm, [0.1, 0.2, 0.3]).unwrap());
        let both =
            Weighted::sum(clearance.clone(), Arc::new(Weighted::multiple(-0.5, elbow.clone()).unwrap()));
        let both = both.unwrap();
        assert!(both.sense() == Sense::Maximize && both.chain() == Some(&arm));
        let q: Vec<f64> = (0..n).map(|_| rng.random_range(-2.0..2.0)).collect();
        let mut out = vec![0.0; n];
        let kinematics = arm.kinematics(&q, &mut scratch).unwrap();
        both.gradient_at(&q, &kinematics, &mut out); // memory of this thread
        assert_eq!(allocations::count(|| both.gradient_at(&q, &kinematics, &mut out)), 0);
        let (mut a, mut b) = (vec![0.0; n], vec![0.0; n]);
        clearance.gradient(&q, &mut a);
        elbow.gradient(&q, &mut b);
        for k in 0..n {
            assert!((out[k] - a[k] + 0.5 * b[k]).abs() < 1e-14);
        }
    }
}

#[test]
fn scenes_from_json() {
    let text = r#"{"obstacles": [
        {"type": "sphere", "center": [0.1, 0.2, 0.3], "radius": 0.1},
        {"type": "box", "center": [1, 0, 0], "half_extents": [0.1, 0.2, 0.3], "quaternion_wxyz": [0.5, 0.5, 0.5, 0.5]},
        {"type": "capsule", "start": [0, 0, 0], "end": [0, 0, 1], "radius": 0.05, "velocity": [0.1, 0, 0]}]}"#;
    let scene = Scene::from_json(text).unwrap();
    assert_eq!(scene.obstacles().len(), 3);
    assert!(scene.moves());
    let again = Scene::from_json(&scene.to_json()).unwrap();
    assert_eq!(again.to_json(), scene.to_json());
    let later = scene.at(2.0);
    let Shape::Capsule(capsule) = later.obstacles()[2].shape.clone() else { unreachable!() };
    assert_eq!(capsule.start.x, 0.2);
    let refused = |text: &str| Scene::from_json(text).map(|_| ()).unwrap_err().to_string();
    for (text, expected) in [
        ("", "no JSON"),
        ("[]", "a list 'obstacles'"),
        (r#"{"obstacles": [1]}"#, "obstacle 0 (no type): is no object"),
        (
            r#"{"obstacles": [{"type": "cone"}]}"#,
            "unknown type 'cone', expected one of: sphere, box, capsule, cylinder, half_space, mesh",
        ),
        (r#"{"obstacles": [{"center": [0,0,0]}]}"#, "unknown type 'nothing'"),
        (r#"{"obstacles": [{"type": "sphere", "radius": 1}]}"#, "center is missing"),
        (r#"{"obstacles": [{"type": "sphere", "center": [0, 0], "radius": 1}]}"#, "a list of 3 numbers"),
        (r#"{"obstacles": [{"type": "sphere", "center": [0, 0, "1"], "radius": 1}]}"#, "a list of 3 numbers"),
        (r#"{"obstacles": [{"type": "sphere", "center": [0, 0, 0], "radius": -0.5}]}"#, "radius is -0.5"),
        (
            r#"{"obstacles": [{"type": "sphere", "center": [0, 0, 0], "raduis": 0.5}]}"#,
            "unknown key 'raduis'",
        ),
        (
            r#"{"obstacles": [{"type": "sphere", "center": [0, 0, 0], "radius": 1, "colour": 3}]}"#,
            "unknown key 'colour'",
        ),
        (
            r#"{"obstacles": [{"type": "box", "center": [0, 0, 0], "half_extents": [1, -1, 1]}]}"#,
            "half extent y is -1",
        ),
        (
            r#"{"obstacles": [{"type": "box", "center": [0, 0, 0], "half_extents": [1, 1, 1], "quaternion_wxyz": [1, 1, 0, 0]}]}"#,
            "norm 1.41",
        ),
    ] {
        assert!(refused(text).contains(expected), "{}", refused(text));
    }
    assert!(
        Scene::from_json_file("/nonexistent.json").unwrap_err().to_string().contains("/nonexistent.json")
    );
    let bad = Obstacle {
        shape: Sphere { center: Vector3::repeat(f64::NAN), radius: 1.0 }.into(),
        velocity: Vector3::zeros(),
        name: None,
        attached_to: None,
    };
    assert!(Scene::of_obstacles(vec![bad]).unwrap_err().to_string().contains("obstacle 0 (sphere): center"));
}
