//! The closed form of six-joint arms with three parallel axes.

use std::f64::consts::{PI, TAU};

use rand::Rng;
use redundancy_core::chain::{Chain, Limits, catalog};
use redundancy_core::kinematics::Scratch;
use redundancy_core::nalgebra::Vector3;
use redundancy_core::solutions::{ClosedForm, ParallelAxesArm, Solutions};
use redundancy_core::{Error, Pose, Status, pose_to_row_major};

use crate::allocations;
use crate::support::{amount, difference, pose_error, random_q, rng, scrambled, urdf_arm};

/// Lengths of the links, heights and offsets of an arm in the manner of UR (axis 5 crosses axis 4) or Z1 (it does not).
struct Shape {
    shoulder: [f64; 3],
    links: [f64; 2],
    hand: [f64; 3],
    tip: f64,
    /// Angles by which axis 1 leans towards m, axis 5 towards m, axis 6 towards axis 5.
    lean: [f64; 3],
}

const SHAPES: [Shape; 6] = [
    // UR5.
    Shape {
        shoulder: [0.0, 0.11, 0.09],
        links: [0.425, 0.39],
        hand: [0.0, 0.02, 0.095],
        tip: 0.08,
        lean: [0.0; 3],
    },
    // Z1: no lateral offset, axis 5 ahead of axis 4.
    Shape {
        shoulder: [0.0, 0.0, 0.1],
        links: [0.35, 0.22],
        hand: [0.07, 0.0, 0.05],
        tip: 0.05,
        lean: [0.0; 3],
    },
    // Shoulder offset, lateral offset to the other side.
    Shape {
        shoulder: [0.15, -0.2, 0.3],
        links: [0.3, 0.5],
        hand: [-0.05, 0.03, 0.1],
        tip: 0.1,
        lean: [0.0; 3],
    },
    // Nothing at a right angle.
    Shape {
        shoulder: [0.1, 0.1, 0.2],
        links: [0.4, 0.3],
        hand: [0.05, 0.04, 0.1],
        tip: 0.1,
        lean: [0.3, -0.2, 0.4],
    },
    // Angles rounded to 1.5708 and 1.57.
    Shape {
        shoulder: [0.0, 0.1, 0.2],
        links: [0.4, 0.4],
        hand: [0.0, 0.05, 0.1],
        tip: 0.1,
        lean: [3.7e-6, 8e-4, -3.7e-6],
    },
    // No offset at all, equal links.
    Shape { shoulder: [0.0, 0.0, 0.2], links: [0.4, 0.4], hand: [0.0, 0.0, 0.0], tip: 0.1, lean: [0.0; 3] },
];

fn axes(shape: &Shape) -> ([(Vector3<f64>, Vector3<f64>); 6], Vector3<f64>) {
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    let [a, b, c] = shape.lean;
    let shoulder = Vector3::from(shape.shoulder);
    let elbow = shoulder + z * shape.links[0];
    let wrist = elbow + z * shape.links[1];
    let center = wrist + Vector3::from(shape.hand);
    let five = z * b.cos() + y * b.sin();
    let six = x * c.cos() + five * c.sin();
    let first = z * a.cos() + y * a.sin();
    let axes = [
        (Vector3::zeros(), first),
        (shoulder, y),
        (elbow, y),
        (wrist, y),
        (center - five * 0.05, five),
        (center + six * 0.03, six),
    ];
    (axes, center + x * shape.tip)
}

fn arms(limits: &dyn Fn(u64) -> [Limits; 6]) -> Vec<Chain> {
    (0..12)
        .map(|seed| {
            let (axes, tip) = axes(&SHAPES[seed as usize % SHAPES.len()]);
            scrambled(seed, &axes, tip, &limits(seed))
        })
        .collect()
}

fn real_arms() -> Vec<Chain> {
    vec![
        urdf_arm("ur3", "base_link", "tool0"),
        urdf_arm("ur5", "base_link", "tool0"),
        urdf_arm("ur10", "base_link", "tool0"),
    ]
}

fn narrow(seed: u64) -> [Limits; 6] {
    let mut rng = rng(seed);
    std::array::from_fn(|_| {
        let centre: f64 = rng.random_range(-2.0..2.0);
        let half: f64 = rng.random_range(1.2..4.5);
        Limits { lower: centre - half, upper: centre + half, ..Limits::NONE }
    })
}

#[test]
fn every_branch_closes_and_the_maker_is_among_them() {
    let mut rng = rng(1);
    for chain in arms(&|_| [Limits::NONE; 6]).into_iter().chain(real_arms()) {
        let arm = ParallelAxesArm::new(&chain).unwrap();
        assert!(arm.defect().position < 1e-12 && arm.defect().orientation < 1e-12, "{:?}", arm.defect());
        for _ in 0..amount(500, 100_000) {
            let q: Vec<f64> = (0..6).map(|_| rng.random_range(-PI..PI)).collect();
            let target = chain.forward(&q).unwrap();
            let mut rows = [[0.0; 6]; 8];
            let mask = arm.solve_into(&target, false, &mut rows);
            let mut makers = 0;
            for (b, row) in rows.iter().enumerate() {
                assert!(row.iter().all(|q| q.is_finite()));
                if mask & (1 << b) == 0 {
                    continue;
                }
                assert!(pose_error(&chain.forward(row).unwrap(), &target) < 4e-12, "{row:?}");
                assert!(row.iter().all(|q| *q > -PI - 1e-15 && *q <= PI + 1e-15));
                assert_eq!(arm.branch(row).unwrap(), ParallelAxesArm::signs(b), "{row:?}");
                makers += usize::from(difference(row, &q) < 1e-6);
                for other in (0..b).filter(|b| mask & (1 << b) != 0) {
                    assert!(difference(row, &rows[other]) > 1e-9, "repeat");
                }
            }
            assert_eq!(makers, 1, "{q:?} {rows:?}");
        }
    }
}

#[test]
fn limits_and_windings_hold_or_the_reason_is_given() {
    let mut rng = rng(2);
    let (mut converged, mut limited) = (0, 0);
    for chain in arms(&narrow) {
        let arm = ParallelAxesArm::new(&chain).unwrap();
        for _ in 0..amount(500, 20_000) {
            let q: Vec<f64> =
                chain.lower().iter().zip(chain.upper()).map(|(lo, hi)| rng.random_range(*lo..*hi)).collect();
            let target = chain.forward(&q).unwrap();
            let rows = arm.solve(&target, true).unwrap();
            assert!(rows.iter().all(|row| chain.within_limits(row, 0.0)));
            assert!(rows.iter().any(|row| difference(row, &q) < 1e-6));
            let near = arm.nearest(&target, &q).unwrap().unwrap();
            assert!(near.iter().zip(&q).all(|(a, b)| (a - b).abs() < 1e-6), "{near:?} {q:?}");

            // A pose from anywhere: brute force over the branches without limits and all windings.
            let target = chain.forward(&[0.0; 6].map(|_: f64| rng.random_range(-PI..PI))).unwrap();
            let windings = |row: &[f64; 6], i: usize| -> Vec<f64> {
                let all = (-2..=2).map(|k| row[i] + TAU * f64::from(k));
                all.filter(|x| *x >= chain.lower()[i] && *x <= chain.upper()[i]).collect()
            };
            let free = arm.solve(&target, false).unwrap();
            let expected: Vec<_> =
                free.iter().filter(|r| (0..6).all(|i| !windings(r, i).is_empty())).collect();
            let all = arm.configurations(&target).unwrap();
            assert_eq!(all.q.len(), expected.len());
            if expected.is_empty() {
                assert_eq!(all.status, Status::Limits);
                assert!(all.reason.contains("even the best leaves joint 'j"), "{}", all.reason);
                assert!(arm.nearest(&target, &q).unwrap().is_none());
                limited += 1;
                continue;
            }
            assert_eq!((all.status, all.reason.as_str(), all.distance), (Status::Converged, "", 0.0));
            let least = |row: &[f64; 6]| -> f64 {
                let least =
                    |i: usize| windings(row, i).into_iter().map(|x| (x - q[i]).powi(2)).fold(1e9, f64::min);
                (0..6).map(least).sum::<f64>().sqrt()
            };
            let near = arm.nearest(&target, &q).unwrap().unwrap();
            assert!(chain.within_limits(&near, 0.0));
            let distance = near.iter().zip(&q).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
            let best = expected.into_iter().map(least).fold(f64::INFINITY, f64::min);
            assert!((distance - best).abs() < 1e-12);
            converged += 1;
        }
    }
    assert!(converged > 100 && limited > 100, "{converged} {limited}");
}

/// At and near every singular configuration: finite, closed, and the configuration is met again where it is isolated.
#[test]
fn singular_poses_are_defined() {
    let mut rng = rng(3);
    let mut wrists = 0;
    for chain in arms(&|_| [Limits::NONE; 6]).into_iter().chain(real_arms()) {
        let arm = ParallelAxesArm::new(&chain).unwrap();
        for k in 0..amount(400, 10_000) {
            let mut q: Vec<f64> = (0..6).map(|_| rng.random_range(-PI..PI)).collect();
            let near = [0.0, 1e-15, 1e-12, 1e-9, 1e-6, 1e-3][k % 6];
            match k % 3 {
                0 => q[4] = ends_of_the_wrist(&arm, &q)[k % 2] + near,
                1 => q[2] = elbow_stretched(&arm, &q) + near,
                _ => {
                    q[4] = ends_of_the_wrist(&arm, &q)[k % 2] + near;
                    q[2] = elbow_stretched(&arm, &q) - near;
                }
            }
            let target = chain.forward(&q).unwrap();
            // So near to where joint 5 turns back, but not there, rounding decides which branches there are, and where: the rows
            // meet the pose, they need not be all, and the verdict does not claim it.
            let doubtful = k % 3 != 1 && (1e-12..=1e-9).contains(&near);
            if k % 3 != 1 && near <= 1e-9 {
                let all = arm.configurations(&target).unwrap();
                assert!(!all.proven() && !Solutions::reason(&all).is_empty(), "{k} {near:e}");
                assert!(!ClosedForm::proves(&arm, &target));
            }
            for limits in [false, true] {
                let rows = arm.solve(&target, limits).unwrap();
                assert!(!rows.is_empty() || doubtful, "{k} {near:e} {} {q:?}", chain.name());
                for row in &rows {
                    assert!(row.iter().all(|x| x.is_finite()));
                    let error = pose_error(&chain.forward(row).unwrap(), &target);
                    assert!(error < 1e-10, "{k} {near:e} {error:e} {row:?} {q:?}");
                }
            }
            let near_q = arm.nearest(&target, &q).unwrap();
            assert!(near_q.is_some() || doubtful, "{k} {near:e}");
            let Some(near_q) = near_q else { continue };
            assert!(pose_error(&chain.forward(&near_q).unwrap(), &target) < 1e-10);
            let distance = near_q.iter().zip(&q).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
            // Where joint 5 turns back, or two joints are at an end, they are known to the root of the rounding, and short levers make
            // the others move farther. Another branch is farther than that.
            let bound = if k % 3 != 1 && (near <= 1e-9 || k % 3 == 2) { 1e-2 } else { 1e-6 };
            assert!(
                distance < bound || doubtful,
                "{k} {near:e} {distance:e} {near_q:?} {q:?} {}",
                chain.name()
            );
            wrists += usize::from(k % 3 == 0 && near == 0.0);
        }
    }
    assert!(wrists > 100);
}

/// Axes and points on them at `q`.
fn lines(chain: &Chain, q: &[f64]) -> Vec<(Vector3<f64>, Vector3<f64>)> {
    let mut scratch = Scratch::new(chain);
    let kinematics = chain.kinematics(q, &mut scratch).unwrap();
    kinematics.origins().iter().copied().zip(kinematics.axes().iter().copied()).collect()
}

/// Where `c0 + c1 cos(x - phase)` is greatest.
fn crest(value: impl Fn(f64) -> f64) -> f64 {
    let at = [0.0, TAU / 3.0, -TAU / 3.0].map(|x| (x, value(x)));
    at.iter().map(|(x, v)| v * x.sin()).sum::<f64>().atan2(at.iter().map(|(x, v)| v * x.cos()).sum())
}

/// The two values of joint 5 at which the wrist's branches meet.
fn ends_of_the_wrist(arm: &ParallelAxesArm, q: &[f64]) -> [f64; 2] {
    let along = |q5: f64| {
        let lines = lines(arm.chain(), &[q[0], q[1], q[2], q[3], q5, q[5]]);
        lines[1].1.dot(&lines[5].1)
    };
    let q5 = crest(along);
    [q5, q5 + PI]
}

/// The value of joint 3 at which the elbow is stretched.
fn elbow_stretched(arm: &ParallelAxesArm, q: &[f64]) -> f64 {
    crest(|q3| {
        let lines = lines(arm.chain(), &[q[0], q[1], q3, q[3], q[4], q[5]]);
        let d = lines[3].0 - lines[1].0;
        (d - lines[1].1 * lines[1].1.dot(&d)).norm_squared()
    })
}

#[test]
fn the_singular_wrist_is_searched_within_limits() {
    let mut rng = rng(4);
    for seed in 0..amount(60, 600) as u64 {
        let (axes, tip) = axes(&SHAPES[[0, 1, 2][seed as usize % 3]]);
        let free = scrambled(seed, &axes, tip, &[Limits::NONE; 6]);
        let arm = ParallelAxesArm::new(&free).unwrap();
        let mut q: Vec<f64> = (0..6).map(|_| rng.random_range(-2.0..2.0)).collect();
        q[4] = ends_of_the_wrist(&arm, &q)[0];
        let limits: [Limits; 6] = std::array::from_fn(|i| {
            let half = rng.random_range(0.1..0.5);
            Limits { lower: q[i] - half, upper: q[i] + half, ..Limits::NONE }
        });
        let narrow = free.with_limits(&limits).unwrap();
        let arm = ParallelAxesArm::new(&narrow).unwrap();
        let target = narrow.forward(&q).unwrap();
        let rows = arm.solve(&target, true).unwrap();
        assert!(!rows.is_empty(), "{seed} {q:?}");
        for row in rows {
            assert!(narrow.within_limits(&row, 0.0));
            assert!(pose_error(&narrow.forward(&row).unwrap(), &target) < 1e-11);
        }
    }
}

#[test]
fn out_of_reach_says_by_how_much() {
    let mut rng = rng(5);
    for chain in arms(&|_| [Limits::NONE; 6]).into_iter().chain(real_arms()) {
        let arm = ParallelAxesArm::new(&chain).unwrap();
        let mut far = chain.forward(&random_q(&mut rng, &chain)).unwrap();
        far.translation.vector += Vector3::new(5.0, 0.0, 0.0);
        let none = arm.configurations(&far).unwrap();
        assert_eq!(none.status, Status::Unreachable);
        assert!(none.distance > 2.0 && none.distance < 6.0, "{}", none.distance);
        assert!(none.reason.contains("outside of what shoulder and elbow reach"), "{}", none.reason);
        assert!(none.q.is_empty());
    }
}

#[test]
fn batches_give_the_same_bits_and_nothing_allocates() {
    let chain = urdf_arm("ur5", "base_link", "tool0");
    let arm = ParallelAxesArm::new(&chain).unwrap();
    let mut rng = rng(6);
    let poses: Vec<Pose> = (0..300).map(|_| chain.forward(&random_q(&mut rng, &chain)).unwrap()).collect();
    let rows: Vec<f64> = poses.iter().flat_map(pose_to_row_major).collect();
    let (mut q, mut valid) = (vec![0.0; 300 * 48], vec![false; 300 * 8]);
    arm.solve_batch(&rows, true, &mut q, &mut valid).unwrap();
    let mut out = [[0.0; 6]; 8];
    let mut total = 0;
    for (i, pose) in poses.iter().enumerate() {
        let mask = arm.solve_into(pose, true, &mut out);
        assert_eq!(&q[i * 48..(i + 1) * 48], out.as_flattened());
        for b in 0..8 {
            assert_eq!(valid[i * 8 + b], mask & (1 << b) != 0);
        }
        total += mask.count_ones();
    }
    assert!(total > 1000);
    assert_eq!(allocations::count(|| arm.solve_into(&poses[0], true, &mut out)), 0);
    assert!(arm.solve_batch(&rows[1..], true, &mut q, &mut valid).is_err());
    let wish = random_q(&mut rng, &chain);
    let near = arm.nearest_batch(&rows, &wish).unwrap();
    assert_eq!(near[7], arm.nearest(&poses[7], &wish).unwrap());
}

#[test]
fn other_arms_are_refused_with_the_number() {
    for (name, what) in [("panda", "7 joints"), ("puma560", "parallel"), ("planar3r", "joints")] {
        let error = ParallelAxesArm::new(&catalog::load(name).unwrap()).unwrap_err();
        assert!(matches!(&error, Error::NotParallelAxes { reason } if reason.contains(what)), "{error}");
    }
}
