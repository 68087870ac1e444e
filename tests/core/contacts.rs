//! Distances that velocity steps keep, and contact along a run.

use std::sync::Arc;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use redundancy_core::chain::{Chain, Limits, catalog};
use redundancy_core::criterion::{Clearance, Criterion, Posture, Stationarity};
use redundancy_core::kinematics::{Kinematics, Scratch, Task};
use redundancy_core::nalgebra::{DMatrix, DVector, Vector3};
use redundancy_core::path::{EventKind, Path};
use redundancy_core::planning::{TrackSettings, track, track_beside};
use redundancy_core::scene::{
    Capsule, Contact, HalfSpace, LinkGeometry, Obstacle, Proximity, ProximityMemory, Scene, Shape, Sphere,
    Surroundings, Thing, Visitor,
};
use redundancy_core::velocity::{ContactSettings, Gain, Resolver, SaturatedNullspace, StepInput};
use redundancy_core::{Pose, Status, Watch};

use super::allocations;
use super::support::amount;
use super::velocity::{clarabel, stated_bounds, task_jacobian};

/// Pairs, distances, gradients and changes by time.
type Rows = Vec<((Thing, Thing), f64, Vec<f64>, f64)>;

struct All<'a, 'k>(&'a Kinematics<'k>, Rows);

impl Visitor for All<'_, '_> {
    fn limit(&self, _: Thing, _: Thing) -> f64 {
        10.0
    }

    fn found(&mut self, contact: &Contact<'_>) -> bool {
        let mut gradient = vec![0.0; self.0.origins().len()];
        contact.add_gradient(self.0, 1.0, &mut gradient);
        self.1.push(((contact.first, contact.second), contact.gap.distance, gradient, contact.by_time()));
        true
    }
}

fn all_pairs(around: &Surroundings, q: &[f64], t: f64) -> Rows {
    let mut scratch = Scratch::new(around.chain());
    let kinematics = around.chain().kinematics(q, &mut scratch).unwrap();
    let mut all = All(&kinematics, Vec::new());
    around.scan(&kinematics, t, &mut ProximityMemory::new(), &mut all);
    all.1
}

fn distance(around: &Surroundings, q: &[f64], t: f64) -> f64 {
    all_pairs(around, q, t).iter().map(|row| row.1).fold(f64::INFINITY, f64::min)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn random_obstacles(rng: &mut ChaCha8Rng) -> Scene {
    let obstacles = (0..4)
        .map(|k| {
            let center = Vector3::from_fn(|_, _| rng.random_range(-0.8..0.8));
            let velocity = Vector3::from_fn(|_, _| rng.random_range(-0.2..0.2));
            let end = center + Vector3::from_fn(|_, _| rng.random_range(-0.3..0.3));
            let shape: Shape = match k {
                0 => Capsule { start: center, end, radius: 0.05 }.into(),
                _ => Sphere { center, radius: 0.08 }.into(),
            };
            Obstacle::moving(shape, velocity).unwrap()
        })
        .collect();
    Scene::of_obstacles(obstacles).unwrap()
}

/// The bound of a pair as the documentation states it, written a second time.
fn stated_row(
    arm: &Chain,
    settings: ContactSettings,
    dt: f64,
    d: f64,
    gradient: &[f64],
    by_time: f64,
) -> f64 {
    let room = d - settings.safe_distance;
    let barrier = settings.barrier_rate.min(1.0 / dt) * room;
    let brake = (0..arm.dof()).filter(|i| gradient[*i] != 0.0);
    let brake: f64 = brake.map(|i| gradient[i].abs() * arm.joints()[i].limits.acceleration).sum();
    let low = if room > 0.0 { barrier.min((2.0 * brake * room).sqrt()) } else { barrier };
    -low - by_time
}

/// Random arms beside random obstacles: no bound is broken, and scale and velocity are those of the stated problem.
#[test]
fn steps_beside_obstacles_are_optimal() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let (mut steps, mut held, mut yielded) = (0, 0, 0);
    for run in 0..amount(12, 200) {
        let name = if run % 2 == 0 { "iiwa14" } else { "dexter" };
        let arm = catalog::load(name).unwrap();
        let n = arm.dof();
        let limits: Vec<Limits> = (0..n)
            .map(|_| Limits {
                lower: -3.0,
                upper: 3.0,
                velocity: rng.random_range(0.5..2.0),
                acceleration: if run % 3 == 0 { f64::INFINITY } else { rng.random_range(3.0..20.0) },
                effort: f64::INFINITY,
            })
            .collect();
        let arm = arm.with_limits(&limits).unwrap();
        let links = LinkGeometry::joint_to_joint(&arm, 0.04).unwrap();
        let scene = random_obstacles(&mut rng);
        let around = Surroundings::new(&arm, &links, Some(&scene), false).unwrap();
        let settings = ContactSettings { safe_distance: 0.03, barrier_rate: 5.0 };
        // Near enough that pairs hold the arm back.
        let near = 1.5 * settings.safe_distance;
        let fits = |q: &[f64]| (settings.safe_distance..near).contains(&distance(&around, q, 0.0));
        let start = |_| (0..n).map(|_| rng.random_range(-2.0..2.0)).collect::<Vec<f64>>();
        let Some(mut q) = (0..500).map(start).find(|q| fits(q)) else { continue };
        let h: Arc<dyn Criterion> = Arc::new(Posture::new(&vec![0.0; n]).unwrap());
        let scheme = SaturatedNullspace::new(&arm, Some(h.clone()), Gain::Constant(1.0), Task::POSE, None);
        let mut scheme = scheme.unwrap().with_contacts(around.clone(), settings).unwrap();
        let (dt, mut qd, mut v) = (0.01, vec![0.0; n], [0.0; 6]);
        for step in 0..40 {
            if step % 10 == 0 {
                v = std::array::from_fn(|_| rng.random_range(-0.5..0.5));
            }
            let t = 0.01 * f64::from(step);
            scheme.set_time(t);
            let before = qd.clone();
            let input = StepInput { q: &q, velocity: &v, dt: Some(dt), qd: Some(&before), wish: None };
            let report = scheme.step(&input, &mut qd).unwrap();
            let joints: Vec<(f64, f64)> =
                (0..n).map(|i| stated_bounds(&limits[i], q[i], Some(before[i]), dt)).collect();
            let rows = all_pairs(&around, &q, t);
            let rows: Vec<_> = rows
                .iter()
                .filter(|row| row.2.iter().any(|g| g.abs() > 1e-9))
                .map(|row| (row, stated_row(&arm, settings, dt, row.1, &row.2, row.3)))
                .collect();
            steps += 1;
            held += usize::from(!scheme.limiting_pairs().is_empty());
            for (pair, _, gradient, _) in rows.iter().map(|row| row.0) {
                let limited = scheme.limiting_pairs().iter().any(|p| (p.first, p.second) == *pair);
                assert!(!limited || gradient.iter().any(|g| *g != 0.0));
            }
            // Variables qd, s and the change of each pair.
            let j = task_jacobian(&arm, &Task::POSE, &q);
            let m = rows.len();
            let mut a = DMatrix::zeros(6 + m, n + 1 + m);
            a.view_mut((0, 0), (6, n)).copy_from(&j);
            (0..6).for_each(|i| a[(i, n)] = -v[i]);
            for (k, (row, _)) in rows.iter().enumerate() {
                (0..n).for_each(|i| a[(6 + k, i)] = row.2[i]);
                a[(6 + k, n + 1 + k)] = -1.0;
            }
            let mut bounds = joints.clone();
            bounds.push((0.0, 1.0));
            bounds.extend(rows.iter().map(|row| (row.1, f64::INFINITY)));
            let mut cost = vec![0.0; n + 1 + m];
            cost[n] = -1.0;
            let zero = DMatrix::zeros(n + 1 + m, n + 1 + m);
            let best = clarabel(&zero, &cost, &a, &vec![0.0; 6 + m], &bounds);
            for (row, low) in &rows {
                let rate = dot(&row.2, &qd);
                // Where joints and pairs exclude each other the position limits may win.
                assert!(best.is_none() || rate >= low - 1e-9, "{name}: {rate} < {low}");
            }
            if let Some(x) = best {
                let scale = x[n].clamp(0.0, 1.0);
                assert!((scale - report.scale).abs() < 1e-5, "{name} {step}: {scale} {report:?}");
                let moved =
                    &j * DVector::from_column_slice(&qd) - DVector::from_column_slice(&v) * report.scale;
                assert!(moved.amax() < 1e-10, "{name}: {}", moved.amax());
                // The nearest to the wish at this scale.
                let wish = h.value(&q);
                assert!(wish.is_finite());
                let mut cost = vec![0.0; n + 1 + m];
                h.gradient(&q, &mut cost[..n]);
                let mut p = DMatrix::zeros(n + 1 + m, n + 1 + m);
                (0..n).for_each(|i| p[(i, i)] = 1.0);
                bounds[n] = (report.scale, report.scale + 1e-9);
                let far = |x: &[f64]| -> f64 { (0..n).map(|i| (x[i] + cost[i]).powi(2)).sum() };
                if let Some(x) = clarabel(&p, &cost, &a, &vec![0.0; 6 + m], &bounds) {
                    assert!(far(&qd) < far(&x) + 1e-5, "{name} {step}: {} {}", far(&qd), far(&x));
                }
            } else {
                yielded += 1;
                assert_eq!((report.scale, report.status), (0.0, Status::Limits));
            }
            q.iter_mut().zip(&qd).for_each(|(q, qd)| *q += dt * qd);
        }
    }
    println!("{steps} steps, {held} held back by pairs, {yielded} without any scale");
    assert!(held > steps / 20);
}

/// A tool that is driven into a ball stops before it, also where the ball comes nearer.
#[test]
fn a_ball_in_the_way() {
    let arm = catalog::load("iiwa14").unwrap();
    let limits: Vec<Limits> =
        arm.joints().iter().map(|j| Limits { acceleration: 10.0, ..j.limits }).collect();
    let arm = arm.with_limits(&limits).unwrap();
    let links = LinkGeometry::joint_to_joint(&arm, 0.05).unwrap();
    let start = [0.0, 0.6, 0.0, -1.4, 0.0, 0.8, 0.0];
    let tool = arm.forward(&start).unwrap().translation.vector;
    for (speed, velocity) in [(0.0, 0.3), (0.1, 0.3), (0.1, 0.0), (0.0, 1.5)] {
        let ball = Sphere { center: tool + Vector3::new(0.35, 0.0, 0.0), radius: 0.1 };
        let ball = Obstacle::moving(ball.into(), Vector3::new(-speed, 0.0, 0.0)).unwrap();
        let ball = ball.named("ball").unwrap();
        let around =
            Surroundings::new(&arm, &links, Some(&Scene::of_obstacles(vec![ball]).unwrap()), false).unwrap();
        let settings = ContactSettings { safe_distance: 0.02, barrier_rate: 5.0 };
        let scheme = SaturatedNullspace::new(&arm, None, Gain::Constant(0.0), Task::POSITION, None);
        let mut scheme = scheme.unwrap().with_contacts(around.clone(), settings).unwrap();
        let (mut q, mut qd, dt) = (start.to_vec(), vec![0.0; 7], 0.01);
        let (mut least, mut named, mut bend) = (f64::INFINITY, false, 0.0f64);
        let mut way = 0.0f64;
        for step in 0..300 {
            let t = dt * f64::from(step);
            scheme.set_time(t);
            let rows = all_pairs(&around, &q, t);
            let before = qd.clone();
            let wanted = [velocity, 0.0, 0.0];
            let input = StepInput { q: &q, velocity: &wanted, dt: Some(dt), qd: Some(&before), wish: None };
            scheme.step(&input, &mut qd).unwrap();
            named |= scheme.limiting_pairs().iter().any(|pair| around.name(pair.second) == "ball");
            let tool = |q: &[f64]| arm.forward(q).unwrap().translation.vector;
            let from = tool(&q);
            q.iter_mut().zip(&qd).for_each(|(q, qd)| *q += dt * qd);
            way = way.max((tool(&q) - from).norm() + dt * speed);
            let after = all_pairs(&around, &q, t + dt);
            for (row, after) in rows.iter().zip(&after).filter(|(row, _)| row.1 < 0.03) {
                bend = bend.max(row.1 + dt * (dot(&row.2, &qd) + row.3) - after.1);
            }
            least = after.iter().map(|row| row.1).fold(least, f64::min);
        }
        // The distance bends by a second-order term in each step, of which the barrier takes `alpha dt` back in the next.
        let short = bend / (settings.barrier_rate * dt);
        assert!(least > 0.02 - short - 1e-9, "{speed} {velocity}: {least} {bend}");
        // Half the square of the way over the radius of ball and link together, and as much again for links that turn.
        assert!(bend < way * way / 0.15, "{speed} {velocity}: {bend} {way}");
        assert!(named && least < 0.03, "{speed} {velocity}: {least} {named}");
    }
}

#[test]
fn too_near_leads_away() {
    let arm = catalog::load("iiwa14").unwrap();
    let links = LinkGeometry::joint_to_joint(&arm, 0.05).unwrap();
    let q = [0.0, 0.6, 0.0, -1.4, 0.0, 0.8, 0.0];
    let tool = arm.forward(&q).unwrap().translation.vector;
    let ball = Sphere { center: tool + Vector3::new(0.145, 0.0, 0.0), radius: 0.1 };
    let around = Surroundings::new(&arm, &links, Some(&Scene::new(&[ball.into()]).unwrap()), false).unwrap();
    let d = distance(&around, &q, 0.0);
    assert!(d < 0.0, "{d}");
    let settings = ContactSettings { safe_distance: 0.02, barrier_rate: 2.0 };
    let scheme = SaturatedNullspace::new(&arm, None, Gain::Constant(0.0), Task::POSITION, None);
    let mut scheme = scheme.unwrap().with_contacts(around.clone(), settings).unwrap();
    let mut qd = [0.0; 7];
    let input = StepInput { q: &q, velocity: &[0.0; 3], dt: Some(0.01), qd: None, wish: None };
    let report = scheme.step(&input, &mut qd).unwrap();
    assert_eq!(report.status, Status::Limits);
    assert_eq!(scheme.limiting_pairs()[0].distance, d);
    for (pair, d, gradient, _) in all_pairs(&around, &q, 0.0) {
        let rate = dot(&gradient, &qd);
        assert!(d >= 0.02 || rate >= 2.0 * (0.02 - d) - 1e-9, "{pair:?} {d} {rate}");
    }
    // Surroundings of another arm.
    let other = catalog::load("pa10").unwrap();
    let scheme = SaturatedNullspace::new(&other, None, Gain::Constant(0.0), Task::POSITION, None).unwrap();
    assert!(scheme.clone().with_contacts(around.clone(), settings).is_err());
    for (safe_distance, barrier_rate) in [(-0.1, 1.0), (0.1, 0.0), (f64::NAN, 1.0), (0.1, f64::INFINITY)] {
        assert!(ContactSettings { safe_distance, barrier_rate }.validate().is_err());
    }
}

#[test]
fn a_step_beside_obstacles_allocates_nothing() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let arm = catalog::load("iiwa14").unwrap();
    let links = LinkGeometry::joint_to_joint(&arm, 0.05).unwrap();
    let scene = random_obstacles(&mut rng);
    let around = Surroundings::new(&arm, &links, Some(&scene), false).unwrap();
    let h: Arc<dyn Criterion> = Arc::new(Clearance::of(around.clone(), 0.002).unwrap());
    let scheme = SaturatedNullspace::new(&arm, Some(h), Gain::Constant(1.0), Task::POSE, None).unwrap();
    let mut scheme = scheme.with_contacts(around, ContactSettings::default()).unwrap();
    let mut qd = [0.0; 7];
    let rows: Vec<Vec<f64>> =
        (0..10).map(|_| (0..7).map(|_| rng.random_range(-2.0..2.0)).collect()).collect();
    let mut step = |q: &[f64], k: f64| {
        let v = [0.3, k, 0.2, 0.0, k, 0.1];
        scheme
            .step(&StepInput { q, velocity: &v, dt: Some(0.01), qd: Some(&[0.0; 7]), wish: None }, &mut qd)
            .unwrap();
    };
    rows.iter().for_each(|q| step(q, 0.1));
    let allocations = allocations::count(|| rows.iter().for_each(|q| step(q, -0.4)));
    assert_eq!(allocations, 0);
}

/// The tool stands 1 mm beside a pin whatever the elbow does; a ball is farther from the elbow.
fn beside_a_pin() -> (Chain, Vec<f64>, Surroundings, Surroundings) {
    let arm = catalog::load("pa10").unwrap();
    let q = vec![0.3, 0.7, -0.2, 1.3, 0.1, 0.9, 0.4];
    let mut scratch = Scratch::new(&arm);
    let kinematics = arm.kinematics(&q, &mut scratch).unwrap();
    let (tool, elbow) = (kinematics.pose().translation.vector, kinematics.origins()[3]);
    let below = tool - Vector3::new(0.0, 0.0, 0.151);
    let pin: Shape = Sphere { center: below, radius: 0.1 }.into();
    let ball: Shape = Sphere { center: elbow + Vector3::new(0.0, 0.2, 0.05), radius: 0.1 }.into();
    let links = LinkGeometry::joint_to_joint(&arm, 0.05).unwrap();
    let near = |obstacles: &[Shape]| {
        Surroundings::new(&arm, &links, Some(&Scene::new(obstacles).unwrap()), false).unwrap()
    };
    let (both, alone) = (near(&[pin, ball.clone()]), near(&[ball]));
    (arm, q, both, alone)
}

/// What the freedom of a task cannot move counts neither in the criterion's slope along it nor in its value there.
#[test]
fn the_criterion_for_a_task() {
    let (arm, q, both, alone) = beside_a_pin();
    let (both, alone) = (Clearance::of(both, 0.002).unwrap(), Clearance::of(alone, 0.002).unwrap());
    assert!(both.value(&q) < 0.01 && alone.value(&q) > 0.02, "{} {}", both.value(&q), alone.value(&q));
    // The hand that the freedom cannot move is left out; the links that it moves stay, with their own distances from the pin.
    let own = both.for_task(&Task::POSE).expect("the hand cannot be moved");
    assert!(own.value(&q) > both.value(&q) + 0.01, "{}", own.value(&q));
    let mut slopes = [0.0; 2];
    for (slope, h) in slopes.iter_mut().zip([&both as &dyn Criterion, &alone]) {
        let mut stationarity = Stationarity::new(&arm, h, Task::POSE).unwrap();
        stationarity.first_order(&q);
        *slope = stationarity.mu()[0].abs();
    }
    assert!(slopes[0] > 0.01 && (slopes[0] - slopes[1]).abs() < 0.1 * slopes[1], "{slopes:?}");
}

/// Contact on the way is an event, and the status of the run.
#[test]
fn contact_along_a_run() {
    let arm = catalog::load("iiwa14").unwrap();
    let q = [0.0, 0.6, 0.0, -1.4, 0.0, 0.8, 0.0];
    let start = arm.forward(&q).unwrap();
    let tool = start.translation.vector;
    let poses: Vec<Pose> = (0..=50)
        .map(|k| {
            let mut pose = start;
            pose.translation.vector += Vector3::new(0.003 * f64::from(k), 0.0, 0.0);
            pose
        })
        .collect();
    let times: Vec<f64> = (0..=50).map(|k| 0.04 * f64::from(k)).collect();
    let path = Path::new(&poses, None, Some(&times)).unwrap();
    let ball = Sphere { center: tool + Vector3::new(0.25, 0.0, 0.0), radius: 0.1 };
    let ball = Obstacle::fixed(ball.into()).unwrap().named("ball").unwrap();
    let scene = Scene::of_obstacles(vec![ball]).unwrap();
    let links = LinkGeometry::joint_to_joint(&arm, 0.05).unwrap();
    let around = Surroundings::new(&arm, &links, Some(&scene), false).unwrap();
    let settings = TrackSettings::new(0.01, 20.0);
    let blind = SaturatedNullspace::new(&arm, None, Gain::Constant(0.0), Task::POSE, None).unwrap();
    let run = track_beside(&blind, &path, &q, &settings, Some(&around), &Watch::default()).unwrap();
    assert_eq!(run.plan.status(), Status::Collision, "{}", run.plan.reason());
    assert!(run.plan.reason().contains("ball"), "{}", run.plan.reason());
    let contacts = |run: &redundancy_core::planning::Track| {
        run.plan.trajectory().events().iter().filter(|event| event.kind == EventKind::Contact).count()
    };
    assert_eq!(contacts(&run), 1);
    // With hard distances the tool stays before it: the path is left, and nothing is touched.
    let seeing = blind.clone().with_contacts(around, ContactSettings::default()).unwrap();
    let run = track(&seeing, &path, &q, &settings, &Watch::default()).unwrap();
    assert_eq!((run.plan.status(), contacts(&run)), (Status::OffPath, 0), "{}", run.plan.reason());
    let low = HalfSpace { point: -Vector3::z(), normal: Vector3::z() };
    let floor = Surroundings::new(&arm, &links, Some(&Scene::new(&[low.into()]).unwrap()), false).unwrap();
    let run = track_beside(&blind, &path, &q, &settings, Some(&floor), &Watch::default()).unwrap();
    assert_eq!(run.plan.status(), Status::Converged, "{}", run.plan.reason());
}
