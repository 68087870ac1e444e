//! The closed form and the circle of solutions of spherical-revolute-spherical arms.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;

use rand::Rng;
use rayon::prelude::*;
use redundancy_core::chain::{Chain, Limits, catalog};
use redundancy_core::criterion::{Criterion, JointRange, Posture, Weighted};
use redundancy_core::kinematics::Scratch;
use redundancy_core::nalgebra::{Matrix3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use redundancy_core::rotation::{from_wxyz, to_wxyz};
use redundancy_core::solutions::{Branch, Chart, SelfMotion, SrsArm, Swivel};
use redundancy_core::{Pose, Status};

use crate::support::{
    amount, difference, openarm_like, pa10, pose_error, random_pose, random_q, rng, scrambled_srs,
};

fn pose(p: [f64; 3], wxyz: [f64; 4]) -> Pose {
    let q = UnitQuaternion::from_quaternion(Quaternion::new(wxyz[0], wxyz[1], wxyz[2], wxyz[3]));
    Pose::from_parts(Translation3::new(p[0], p[1], p[2]), q.to_rotation_matrix())
}

fn unlimited() -> [Limits; 7] {
    [Limits::NONE; 7]
}

/// Limits around zero in the scrambled arm's own (arbitrary) zeros.
fn narrow(seed: u64) -> [Limits; 7] {
    let mut rng = rng(seed);
    std::array::from_fn(|_| {
        let centre: f64 = rng.random_range(-2.0..2.0);
        let half: f64 = rng.random_range(0.8..2.2);
        Limits { lower: centre - half, upper: centre + half, ..Limits::NONE }
    })
}

#[test]
fn vectors_computed_independently() {
    let arm = SrsArm::new(&pa10()).unwrap();
    let rows = arm.solve(&pose([0.5, 0.1, 1.0], [1.0, 0.0, 1.0, 0.0]), Swivel::Angle(0.0), false).unwrap();
    let expected =
        [0.0926320764, 1.1371838489, 3.0050722472, 1.1024751202, 3.1068703321, 1.5440001559, 0.1248233278];
    for (q, e) in rows[0].iter().zip(expected) {
        assert!((q - e).abs() < 6e-11, "{q} {e}");
    }
    // theta1', theta3', theta5', theta7' in the branches that the signs call for.
    for (branch, joint, value) in
        [(4, 0, -3.0489605772), (4, 2, -0.1365204064), (1, 4, -0.0347223215), (1, 6, -3.0167693258)]
    {
        assert!((rows[branch][joint] - value).abs() < 6e-11);
    }
    let u = Swivel::Direction(0.0, 1.0);
    let rows = arm.solve(&pose([0.4, -0.3, 0.6], [1.0, 2.0, 3.0, 4.0]), u, false).unwrap();
    let expected =
        [0.4917651927, 0.6583102853, -1.7008077837, 1.8775590480, 2.2902954721, 2.1194142464, 0.2319629992];
    for (q, e) in rows[0].iter().zip(expected) {
        assert!((q - e).abs() < 6e-11, "{q} {e}");
    }
    for (branch, joint, value) in
        [(4, 0, -2.6498274609), (4, 2, 1.4407848699), (1, 4, -0.8512971815), (1, 6, -2.9096296543)]
    {
        assert!((rows[branch][joint] - value).abs() < 6e-11);
    }
}

/// The paper's worked example: eqs (18) to (28) are the elbow branch -1 of its own assumption.
#[test]
fn worked_example_of_the_paper() {
    let chain = pa10();
    let arm = SrsArm::new(&chain).unwrap();
    let target = pose([0.5, 0.1, 1.0], [1.0, 0.0, 1.0, 0.0]);
    let rows = arm.solve(&target, Swivel::Angle(0.0), false).unwrap();
    let printed = [0.0926, 1.1372, -0.1365, -1.1025, -0.0347, 1.5440, 0.1248];
    assert!(difference(&rows[2], &printed) < 6e-5, "{:?}", rows[2]);
    assert_eq!(arm.branch(&rows[2]).unwrap(), [1, -1, 1]);
    assert!(pose_error(&chain.forward(&rows[2]).unwrap(), &target) < 1e-14);
}

#[test]
fn every_branch_closes_and_the_maker_is_among_them() {
    let arms: Vec<Chain> = (0..12)
        .map(|seed| {
            let offset = [[0.0, 0.0], [0.05, 0.05], [0.08, -0.03]][seed as usize % 3];
            scrambled_srs(seed, [0.3, 0.42, 0.38, 0.1], offset, &unlimited())
        })
        .chain([pa10()])
        .collect();
    let mut rng = rng(1);
    for chain in &arms {
        let arm = SrsArm::new(chain).unwrap();
        assert!(arm.defect().position < 1e-12 && arm.defect().orientation < 1e-12, "{:?}", arm.defect());
        for _ in 0..amount(1_000, 100_000) {
            let q = random_q(&mut rng, chain);
            let target = chain.forward(&q).unwrap();
            let s = arm.swivel(&q).unwrap();
            let signs = arm.branch(&q).unwrap();
            let rows = arm.solve(&target, Swivel::Angle(s), false).unwrap();
            assert_eq!(rows.len(), 8);
            for (b, row) in rows.iter().enumerate() {
                assert!(pose_error(&chain.forward(row).unwrap(), &target) < 1e-12);
                assert!(row.iter().all(|q| *q > -PI - 1e-15 && *q <= PI));
                assert_eq!(arm.branch(row).unwrap(), [4, 2, 1].map(|bit| if b & bit == 0 { 1 } else { -1 }));
                let back = arm.swivel(row).unwrap();
                assert!(((back - s + PI).rem_euclid(TAU) - PI).abs() < 1e-9, "{back} {s}");
            }
            let index = [4, 2, 1].iter().zip(signs).map(|(bit, s)| if s < 0 { bit } else { &0 }).sum::<i32>();
            assert!(difference(&rows[index as usize], &q) < 1e-7, "{:?} {q:?}", rows[index as usize]);
        }
    }
}

/// The arms of the checks by brute force: two robots of the catalogue, one with narrow limits, and arms in any frames.
fn arms_with_limits() -> Vec<Chain> {
    let mut arms = vec![pa10(), redundancy_core::chain::catalog::load("iiwa14").unwrap(), openarm_like()];
    for seed in 0..4 {
        let offset = if seed % 2 == 0 { [0.0, 0.0] } else { [0.06, 0.02] };
        arms.push(scrambled_srs(seed, [0.3, 0.4, 0.36, 0.12], offset, &narrow(seed)));
    }
    arms
}

/// Poses of random configurations within the limits.
fn targets(chain: &Chain, n: usize, seed: u64) -> Vec<(Pose, Vec<f64>)> {
    let mut rng = rng(seed);
    (0..n)
        .map(|_| {
            let target = chain.forward(&random_q(&mut rng, chain)).unwrap();
            (target, (0..7).map(|_| rng.random_range(-7.0..7.0)).collect())
        })
        .collect()
}

#[test]
fn intervals_agree_with_brute_force() {
    for (i, chain) in arms_with_limits().iter().enumerate() {
        let arm = SrsArm::new(chain).unwrap();
        let targets = targets(chain, amount(30, 1_000), 200 + i as u64);
        let inside: usize = targets
            .par_iter()
            .enumerate()
            .map(|(k, (target, _))| {
                let motion = arm.self_motion(target).unwrap();
                let margin = if k % 3 == 0 { 0.05 } else { 0.0 };
                motion.branches().iter().map(|branch| check_intervals(chain, branch, margin)).sum::<usize>()
            })
            .sum();
        assert!(inside > 100 * targets.len(), "{}: {inside}", chain.name());
    }
}

/// The intervals of a branch against 1 440 samples and their own edges; returns how many samples hold the limits.
fn check_intervals(chain: &Chain, branch: &Branch<'_>, margin: f64) -> usize {
    const SAMPLES: usize = 1_440;
    let intervals = branch.intervals(margin).unwrap();
    let apart = |s: f64, e: f64| ((s - e + PI).rem_euclid(TAU) - PI).abs();
    let mut checked = 0;
    for i in 0..SAMPLES {
        let s = TAU * (i as f64 + 0.371) / SAMPLES as f64 - PI;
        let inside = intervals.iter().any(|[lo, hi]| (s - lo).rem_euclid(TAU) <= hi - lo);
        let q = branch.q(s).unwrap();
        let holds = q.iter().zip(chain.lower()).zip(chain.upper()).all(|((q, lo), hi)| {
            let k = ((lo + margin - q) / TAU).ceil();
            q + k * TAU <= hi - margin
        });
        let edge = intervals.iter().flatten().any(|e| apart(s, *e) < 1e-9);
        assert!(inside == holds || edge, "{} s = {s}: {intervals:?} {q:?}", chain.name());
        checked += usize::from(inside);
    }
    // Just inside every edge the limits hold, just outside one of them breaks.
    for [lo, hi] in intervals.iter().filter(|[lo, hi]| hi - lo < TAU && hi - lo > 4e-9) {
        for (s, expected) in [(lo + 1e-9, true), (hi - 1e-9, true), (lo - 1e-9, false), (hi + 1e-9, false)] {
            let q = branch.q(s).unwrap();
            let violation = q.iter().zip(chain.lower()).zip(chain.upper()).map(|((q, lo), hi)| {
                let k = ((lo + margin - q) / TAU).ceil();
                (q + k * TAU - hi + margin).max(0.0).min(lo + margin - (q + (k - 1.0) * TAU))
            });
            let worst = violation.fold(0.0, f64::max);
            let near_other = intervals.iter().flatten().filter(|e| apart(s, **e) < 3e-9).count() > 1;
            // A limit may be crossed at a small angle: outside counts any violation above rounding.
            let agrees = if expected { worst < 1e-11 } else { worst > 1e-15 };
            assert!(agrees || near_other, "{} {s} in {lo} {hi}: {worst:e} {expected}", chain.name());
        }
    }
    checked
}

#[test]
fn arcs_computed_independently() {
    let arm = SrsArm::new(&pa10()).unwrap();
    let motion = arm.self_motion(&pose([0.4, -0.3, 0.6], [1.0, 2.0, 3.0, 4.0])).unwrap();
    let branches = motion.branches();
    let close = |a: &[[f64; 2]], b: &[[f64; 2]]| {
        a.len() == b.len() && a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| (a - b).abs() < 6e-11)
    };
    for b in [0, 1] {
        let arcs = branches[b].intervals(0.0).unwrap();
        assert!(close(&arcs, &[[0.3849227538, 4.2929207182]]), "{arcs:?}");
        let arcs = branches[b + 2].intervals(0.0).unwrap();
        assert!(close(&arcs, &[[0.3849227538, 2.3327879868], [2.3450554852, 4.2929207182]]), "{arcs:?}");
    }
}

#[test]
fn tangent_is_in_the_kernel_of_the_jacobian() {
    let mut rng = rng(3);
    for seed in 0..6 {
        let offset = if seed % 2 == 0 { [0.0, 0.0] } else { [0.06, 0.02] };
        let chain = scrambled_srs(seed, [0.3, 0.4, 0.36, 0.12], offset, &unlimited());
        let arm = SrsArm::new(&chain).unwrap();
        for _ in 0..amount(100, 1_000) {
            let motion = arm.self_motion(&chain.forward(&random_q(&mut rng, &chain)).unwrap()).unwrap();
            let s = rng.random_range(-PI..PI);
            for branch in motion.branches() {
                let tangent = branch.tangent(s).unwrap();
                let q = branch.q(s).unwrap();
                let norm = tangent.iter().map(|t| t * t).sum::<f64>().sqrt();
                assert!(norm > 0.1);
                assert!(chain.tool_velocity(&q, &tangent).unwrap().norm() < 1e-12 * norm.max(1.0));
                let h = 1e-6;
                let (before, after) = (branch.q(s - h).unwrap(), branch.q(s + h).unwrap());
                for i in 0..7 {
                    let step = (after[i] - before[i] + PI).rem_euclid(TAU) - PI;
                    assert!((step / (2.0 * h) - tangent[i]).abs() < 1e-4 * norm.powi(3).max(1.0));
                }
            }
        }
    }
}

#[test]
fn degenerate_poses_close_without_nan() {
    let chain = pa10();
    let arm = SrsArm::new(&chain).unwrap();
    let mut rng = rng(4);
    let offsets = [0.0, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-3];
    for _ in 0..amount(2_000, 10_000) {
        let mut q = random_q(&mut rng, &chain);
        let e = |rng: &mut rand_chacha::ChaCha8Rng| {
            offsets[rng.random_range(0..7)] * if rng.random_bool(0.5) { 1.0 } else { -1.0 }
        };
        // Gimbals of shoulder and wrist, stretched elbow; any mix of them.
        for joint in [1, 3, 5] {
            if rng.random_bool(0.6) {
                q[joint] = e(&mut rng);
            }
        }
        if rng.random_bool(0.2) {
            q[3] = PI - e(&mut rng); // Folded: outside of the PA10's limits, but defined.
        }
        if rng.random_bool(0.2) {
            q[0] = FRAC_PI_2;
            q[1] = FRAC_PI_2;
        }
        let target = chain.forward(&q).unwrap();
        for swivel in [arm.swivel(&q).unwrap(), rng.random_range(-PI..PI)] {
            let rows = arm.solve(&target, Swivel::Angle(swivel), false).unwrap();
            assert_eq!(rows.len(), 8, "{q:?}");
            for row in &rows {
                let error = pose_error(&chain.forward(row).unwrap(), &target);
                assert!(error < 1e-11, "{q:?}: {row:?} {error:e}");
            }
        }
        let motion = arm.self_motion(&target).unwrap();
        for branch in motion.branches() {
            let s = rng.random_range(-PI..PI);
            assert!(branch.tangent(s).unwrap().iter().all(|t| t.is_finite()));
            for [lo, hi] in branch.intervals(0.0).unwrap() {
                assert!(lo.is_finite() && hi >= lo && hi - lo <= TAU + 1e-12);
                for s in [lo, 0.5 * (lo + hi), hi] {
                    let at = branch.q(s).unwrap();
                    assert!(pose_error(&chain.forward(&at).unwrap(), &target) < 1e-11);
                    // Beside a gimbal rounding of the matrix moves the outer joints by 1e-16 / sin(middle angle).
                    let sine = at[1].sin().abs().min(at[5].sin().abs());
                    assert!(chain.within_limits(&at, 1e-9 + 1e-15 / sine), "{at:?}");
                }
            }
        }
        // Nothing is listed twice.
        let rows = arm.solve(&target, Swivel::Angle(0.4), true).unwrap();
        for (i, a) in rows.iter().enumerate() {
            assert!(rows[..i].iter().all(|b| difference(a, b) > 1e-9), "{rows:?}");
        }
    }
}

#[test]
fn out_of_reach_says_by_how_much() {
    let arm = SrsArm::new(&pa10()).unwrap();
    let far = arm.self_motion(&pose([1.5, 0.0, 0.315], [1.0, 0.0, 0.0, 0.0])).unwrap();
    assert_eq!(far.status(), Status::Unreachable);
    let d = (1.5f64.powi(2) + 0.08f64.powi(2)).sqrt() - 0.95;
    assert!(far.reason().contains(&format!("{:.6} mm too far", 1e3 * d)), "{}", far.reason());
    assert!(far.branches().is_empty());
    // L3 - L2 = 0.05: wrist 10 mm from the shoulder is 40 mm too near.
    let near = arm.self_motion(&pose([0.01, 0.0, 0.315 + 0.08], [1.0, 0.0, 0.0, 0.0])).unwrap();
    assert!(near.reason().contains("40.000000 mm too near"), "{}", near.reason());
    assert!(
        arm.solve(&pose([1.5, 0.0, 0.3], [1.0, 0.0, 0.0, 0.0]), Swivel::Angle(0.0), false)
            .unwrap()
            .is_empty()
    );
}

#[test]
fn charts_agree_up_to_a_turn_and_are_singular_where_they_say() {
    let chain = pa10();
    let paper = SrsArm::new(&chain).unwrap();
    let mut rng = rng(5);
    for _ in 0..200 {
        let reference = *crate::support::unit(&mut rng);
        let shortest = SrsArm::with_chart(&chain, Chart::ShortestArc(Some(reference * 3.0))).unwrap();
        let stereographic = SrsArm::with_chart(&chain, Chart::Stereographic(Some(-reference))).unwrap();
        let q = random_q(&mut rng, &chain);
        let (a, b) = (shortest.swivel(&q).unwrap(), stereographic.swivel(&q).unwrap());
        assert!(difference(&[a], &[b]) < 1e-12, "the same family");
        // Elias & Wen: k_x = ((n - t) x r) x n with t the singular half-line; n from the definition.
        let target = chain.forward(&q).unwrap();
        let wrist = target * redundancy_core::nalgebra::Point3::from(paper.wrist_in_tool());
        let n = (wrist.coords - paper.shoulder()).normalize();
        let t = -reference;
        let base_x = (Vector3::x() - t * t.x).normalize();
        let kx = (n - t).cross(&base_x).cross(&n);
        let mut scratch = redundancy_core::kinematics::Scratch::new(&chain);
        let elbow = chain.kinematics(&q, &mut scratch).unwrap().origins()[3] - paper.shoulder();
        let w = elbow - n * n.dot(&elbow);
        let s = w.dot(&n.cross(&kx)).atan2(w.dot(&kx));
        assert!(difference(&[s], &[b]) < 1e-9, "{s} {b}");
        // The change between charts depends on the pose only.
        let motion = paper.self_motion(&target).unwrap();
        let change = paper.chart_change(&shortest, &target).unwrap();
        for branch in motion.branches() {
            let s = rng.random_range(-PI..PI);
            let other = shortest.swivel(&branch.q(s).unwrap()).unwrap();
            assert!(difference(&[s + change], &[other]) < 1e-9);
        }
    }
}

#[test]
fn panda_and_planar_arms_are_refused_with_the_reason() {
    let panda = redundancy_core::chain::catalog::load("panda").unwrap();
    let text = SrsArm::new(&panda).unwrap_err().to_string();
    assert!(text.contains("axes 6 and 7 miss each other by 88.000 mm"), "{text}");
    let six = redundancy_core::chain::catalog::load("puma560").unwrap();
    assert!(SrsArm::new(&six).unwrap_err().to_string().contains("has 6 joints"));
}

#[test]
fn batch_is_the_same_as_one_by_one_for_any_number_of_threads() {
    let chain = pa10();
    let arm = SrsArm::new(&chain).unwrap();
    let mut rng = rng(6);
    let n = 1_000;
    let mut poses = Vec::new();
    let mut swivels = Vec::new();
    for i in 0..n {
        let p = if i % 50 == 0 {
            random_pose(&mut rng, 3.0)
        } else {
            chain.forward(&random_q(&mut rng, &chain)).unwrap()
        };
        poses.extend(redundancy_core::pose_to_row_major(&p));
        swivels.push(rng.random_range(-PI..PI));
    }
    let run = |threads: usize| {
        let (mut q, mut valid) = (vec![0.0; n * 56], vec![false; n * 8]);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| arm.solve_batch(&poses, &swivels, true, &mut q, &mut valid)).unwrap();
        (q, valid)
    };
    let (q, valid) = run(1);
    assert_eq!((q.clone(), valid.clone()), run(3));
    for i in 0..n {
        let target = redundancy_core::pose_from_row_major(&poses[16 * i..16 * i + 16]).unwrap();
        let rows = arm.solve(&target, Swivel::Angle(swivels[i]), true).unwrap();
        let batch: Vec<&[f64]> =
            (0..8).filter(|b| valid[8 * i + b]).map(|b| &q[56 * i + 7 * b..56 * i + 7 * b + 7]).collect();
        assert_eq!(rows.iter().map(|r| &r[..]).collect::<Vec<_>>(), batch);
    }
}

#[test]
fn best_and_nearest_are_never_worse_than_a_scan() {
    for (i, chain) in arms_with_limits().iter().enumerate() {
        let arm = SrsArm::new(chain).unwrap();
        // The wishes lie beyond the limits too, where a winding within them is not the nearest one.
        targets(chain, amount(20, 1_000), 700 + i as u64)
            .par_iter()
            .for_each(|(target, wish)| check_best(chain, &arm.self_motion(target).unwrap(), target, wish));
    }
}

/// `best` and `nearest` over one pose against samples of all branches, windings included.
fn check_best(chain: &Chain, motion: &SelfMotion, target: &Pose, wish: &[f64]) {
    let samples = amount(1_000, 10_000);
    let range = JointRange::new(chain);
    let posture = Posture::new(wish).unwrap();
    let sum = Weighted::sum(Arc::new(range.clone()), Arc::new(posture.clone())).unwrap();
    // No sum of springs to minimise: the search without bounds.
    let opposite = Weighted::multiple(-1.0, Arc::new(range.clone())).unwrap();
    let near = motion.nearest(wish).unwrap().unwrap();
    let distance = |q: &[f64]| q.iter().zip(wish).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    assert!((near.value - distance(&near.q)).abs() < 1e-12);
    let criteria: [&dyn Criterion; 4] = [&range, &posture, &sum, &opposite];
    let best = criteria.map(|criterion| {
        let best = motion.best(criterion).unwrap().unwrap();
        assert!(chain.within_limits(&best.q, 0.0));
        assert!(pose_error(&chain.forward(&best.q).unwrap(), target) < 1e-11);
        assert_eq!(best.value, criterion.value(&best.q));
        best
    });
    // Rows of weights and centres of what is a sum over the joints: there each joint takes its best winding.
    let rows = [&range as &dyn Criterion, &posture, &sum].map(|c| c.springs().unwrap());
    let constant: Vec<f64> = criteria[..3]
        .iter()
        .zip(&rows)
        .map(|(c, row)| {
            c.value(wish)
                - row.iter().zip(wish).map(|(s, q)| 0.5 * s.weight * (q - s.center).powi(2)).sum::<f64>()
        })
        .collect();
    let windings: Vec<Vec<f64>> = (0..7)
        .map(|j| {
            // Turns that may be within the limits of a principal value; joints without limits reach every wish here.
            let (lo, hi) = (chain.lower()[j].max(-5.0 * PI), chain.upper()[j].min(5.0 * PI));
            (-3..=3).map(|k| TAU * f64::from(k)).filter(|t| lo <= t + PI && hi >= t - PI).collect()
        })
        .collect();
    for branch in motion.branches() {
        let ends = branch.intervals(0.0).unwrap();
        let uniform = (0..samples).map(|i| TAU * i as f64 / samples as f64);
        for s in uniform.chain(ends.into_iter().flatten()) {
            let q = branch.q(s).unwrap();
            if !chain.within_limits(&q, 0.0) {
                continue;
            }
            let mut least = [0.0; 4];
            for j in 0..7 {
                let mut cost = [f64::INFINITY; 4];
                for turn in &windings[j] {
                    let q = (q[j] + TAU * ((PI - q[j]) / TAU).floor()) + turn;
                    if q >= chain.lower()[j] && q <= chain.upper()[j] {
                        for (cost, row) in cost.iter_mut().zip(&rows) {
                            *cost = cost.min(0.5 * row[j].weight * (q - row[j].center).powi(2));
                        }
                        cost[3] = cost[3].min((q - wish[j]).powi(2));
                    }
                }
                least.iter_mut().zip(cost).for_each(|(sum, cost)| *sum += cost);
            }
            for (k, (best, constant)) in best.iter().zip(&constant).enumerate() {
                let better = best.value - (least[k] + constant);
                assert!(better < 1e-9, "{} {k}: {better:e} at {s} of {:?}", chain.name(), branch.signs());
            }
            assert!(near.value <= least[3].sqrt() + 1e-9, "{}: {near:?}, at {s} {least:?}", chain.name());
            let better = opposite.sense().sign() * (best[3].value - opposite.value(&q));
            assert!(better < 1e-9, "{} opposite: {better:e} at {s} of {:?}", chain.name(), branch.signs());
        }
    }
}

#[test]
fn the_maker_is_its_own_nearest() {
    let chain = pa10();
    let arm = SrsArm::new(&chain).unwrap();
    let mut rng = rng(8);
    for _ in 0..amount(300, 3_000) {
        let q: Vec<f64> =
            chain.lower().iter().zip(chain.upper()).map(|(lo, hi)| rng.random_range(*lo..*hi)).collect();
        let near = arm.self_motion(&chain.forward(&q).unwrap()).unwrap().nearest(&q).unwrap().unwrap();
        assert!(near.value < 1e-7, "{q:?} {near:?}");
    }
}

#[test]
fn the_maker_is_its_own_nearest_at_gimbals_too() {
    let chain = pa10();
    let arm = SrsArm::new(&chain).unwrap();
    let mut rng = rng(9);
    let mut cases: Vec<Vec<f64>> = vec![
        vec![0.3, 0.0, 0.4, 0.9, 0.1, 0.7, 0.2],
        vec![0.3, 0.6, 0.4, 0.9, 0.1, 0.0, 0.2],
        vec![0.3, 0.0, 0.4, 0.9, 0.1, 0.0, 0.2],
        vec![0.3, 0.0, 0.4, 0.0, 0.1, 0.6, 0.2],
        vec![0.0; 7],
    ];
    for i in 0..200 {
        let mut q = random_q(&mut rng, &chain);
        q[[1, 5][i % 2]] = 0.0;
        cases.push(q);
    }
    for q in cases {
        let near = arm.self_motion(&chain.forward(&q).unwrap()).unwrap().nearest(&q).unwrap().unwrap();
        assert!(near.value < 1e-5, "{q:?} {near:?}");
        assert!(pose_error(&chain.forward(&near.q).unwrap(), &chain.forward(&q).unwrap()) < 1e-11);
    }
}

/// The worked example of [Moore2010, eqs (17) to (28)], with its printed digits; (24) has +.01849 k in print.
#[test]
fn the_quantities_of_the_worked_example() {
    let chain = catalog::load("pa10").unwrap();
    let arm = SrsArm::new(&chain).unwrap();
    let q = from_wxyz([0.5_f64.sqrt(), 0.0, 0.5_f64.sqrt(), 0.0]).unwrap();
    let pose = Pose::from_parts(Vector3::new(0.5, 0.1, 1.0).into(), q.to_rotation_matrix());
    let motion = arm.self_motion(&pose).unwrap();
    let close = |found: &[f64], printed: &[f64]| {
        for (a, b) in found.iter().zip(printed) {
            assert!((a - b).abs() < 6e-5, "{found:?} is not {printed:?}");
        }
    };
    close(motion.center().as_slice(), &[0.1948, 0.04638, 0.6327]);
    close(motion.axis().as_slice(), &[0.5187, 0.1235, 0.846]);
    close(&[motion.radius()], &[0.2480]);
    assert!((motion.frame() - Matrix3::identity()).amax() < 1e-15);
    let q_a = motion.q_a();
    close(&to_wxyz(&q_a), &[0.9607, -0.06428, 0.27, 0.0]);
    // Its angle is that between k and n.
    assert!((q_a.angle() - motion.axis().z.acos()).abs() < 1e-12);
    let elbow = motion.elbow_position(0.0);
    close(elbow.as_slice(), &[0.4066, 0.03777, 0.5041]);
    // The paper's solution is the branch with theta4 < 0.
    let branch = motion.branch(2).unwrap();
    let found = branch.quaternions(0.0);
    close(&to_wxyz(&found.q3), &[0.8425, -0.06156, 0.5349, -0.01849]);
    close(&to_wxyz(&found.q4), &[0.9978, -0.06212, 0.01445, 0.01649]);
    close(&to_wxyz(&found.wrist), &[0.7158, 0.05559, 0.6954, 0.03227]);
    close(&branch.q(0.0).unwrap()[..3], &[0.0926, 1.1372, -0.1365]);
}

/// Eqs (6), (13) to (16), (22), (23) and (27) on random poses and arms: what the angles make of the quaternions, and every
/// winding.
#[test]
fn the_quantities_fit_the_configurations() {
    let mut rng = rng(16);
    for name in ["pa10", "iiwa14"] {
        let chain = catalog::load(name).unwrap();
        let arm = SrsArm::new(&chain).unwrap();
        let [upper, fore] = arm.lengths();
        for _ in 0..amount(60, 2000) {
            let q = random_q(&mut rng, &chain);
            let pose = chain.forward(&q).unwrap();
            let motion = arm.self_motion(&pose).unwrap();
            let s = arm.swivel(&q).unwrap();
            let elbow = motion.elbow_position(s);
            let frame = motion.frame();
            // (15), (16): u = conj(q_A) (p_E - C)/rho q_A in the paper's frame.
            let local = frame.tr_mul(&(elbow - motion.center())) / motion.radius();
            let u = motion.q_a().inverse() * local;
            assert!((u - Vector3::new(s.cos(), s.sin(), 0.0)).norm() < 1e-9 / motion.radius(), "{u:?}");
            let wrist = pose * Point3::from(arm.wrist_in_tool());
            assert!(((elbow - arm.shoulder()).norm() - upper).abs() < 1e-12);
            assert!(((wrist.coords - elbow).norm() - fore).abs() < 1e-12);
            assert!((motion.axis() - (wrist.coords - arm.shoulder()).normalize()).norm() < 1e-12);
            // The elbow is on the axis of joint 4, which the link behind it carries.
            let mut scratch = Scratch::new(&chain);
            let kinematics = chain.kinematics(&q, &mut scratch).unwrap();
            let (o, z) = (kinematics.origins()[3], kinematics.axes()[3]);
            assert!((elbow - o).cross(&z).norm() < 1e-9, "{name}");
            let index = {
                let [a, b, c] = arm.branch(&q).unwrap().map(|sign| usize::from(sign < 0));
                4 * a + 2 * b + c
            };
            let branch = motion.branch(index).unwrap();
            let found = branch.quaternions(s);
            // (22), (23): z along the upper arm, y along +- axis 4; the forearm likewise.
            let along = |q: &UnitQuaternion<f64>, v: Vector3<f64>| frame * (q * v);
            assert!((along(&found.q3, Vector3::z()) - (elbow - arm.shoulder()) / upper).norm() < 1e-9);
            assert!((along(&found.q4, Vector3::z()) - (wrist.coords - elbow) / fore).norm() < 1e-9);
            assert!(along(&found.q3, Vector3::y()).cross(&z).norm() < 1e-9);
            assert!((along(&found.q4, Vector3::y()) - along(&found.q3, Vector3::y())).norm() < 1e-12);
            // All windings: the configuration is one of them, each is within limits and at the pose, none is missing.
            let windings = branch.windings(s).unwrap();
            assert!(windings.iter().any(|w| w.iter().zip(&q).all(|(a, b)| (a - b).abs() < 1e-7)), "{q:?}");
            let mut count = 1;
            for (i, joint) in chain.joints().iter().enumerate() {
                let turns = (-3..=3).filter(|k| {
                    let x = q[i] + f64::from(*k) * std::f64::consts::TAU;
                    x >= joint.limits.lower && x <= joint.limits.upper
                });
                count *= turns.count().max(1);
            }
            assert_eq!(windings.len(), count);
            for row in &windings {
                assert!(chain.within_limits(row, 0.0));
            }
        }
    }
}

/// With a straight elbow the swivel moves joints 3 and 5 alone: a joint that stands at its limit stays there, and rounding must
/// not decide on which side.
#[test]
fn a_straight_arm_at_a_limit_is_legal() {
    let chain = catalog::load("iiwa14").unwrap();
    let arm = SrsArm::new(&chain).unwrap();
    let mut rng = rng(24);
    for case in 0..amount(400, 20_000) {
        let mut q: [f64; 7] =
            std::array::from_fn(|i| 0.9 * rng.random_range(chain.lower()[i]..chain.upper()[i]));
        q[3] = 0.0;
        let joint = [0, 1, 5, 6][case % 4];
        q[joint] = if case % 8 < 4 { chain.lower()[joint] } else { chain.upper()[joint] };
        let motion = arm.self_motion(&chain.forward(&q).unwrap()).unwrap();
        assert_eq!(motion.status(), Status::Converged, "{q:?}: {}", motion.reason());
        let near = motion.nearest(&q).unwrap().unwrap();
        assert!(chain.within_limits(&near.q, 0.0) || chain.within_limits(&near.q, -1e-12), "{near:?}");
        for branch in motion.branches() {
            for [lo, hi] in branch.intervals(0.0).unwrap() {
                let found = branch.q(0.5 * (lo + hi)).unwrap();
                for i in 0..7 {
                    let slack = 1e-9;
                    assert!(
                        (chain.lower()[i] - slack..=chain.upper()[i] + slack).contains(&found[i]),
                        "{found:?} of {q:?}"
                    );
                }
            }
        }
    }
}
