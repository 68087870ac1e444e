//! The set of configurations over one pose: one interface for circles, points and traced curves.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use rand::Rng;
use redundancy_core::chain::{Chain, ChainBuilder, DhConvention, DhRow, Limits, catalog};
use redundancy_core::criterion::{Criterion, JointRange, Manipulability, Posture, Weighted};
use redundancy_core::kinematics::Task;
use redundancy_core::nalgebra::{Rotation3, Translation3, Vector3};
use redundancy_core::solutions::{Solutions, SolutionsSettings, closed_form, solutions};
use redundancy_core::{Pose, Status};

use crate::support::{amount, difference, pose_error, random_pose, random_q, rng, scrambled_srs};

/// Six joints without a spherical wrist (the UR5's parameters): points found by Newton's method.
fn offset_wrist() -> Chain {
    let quarter = 0.5 * PI;
    let rows = [
        (0.0, 0.089, quarter),
        (-0.425, 0.0, 0.0),
        (-0.392, 0.0, 0.1),
        (0.0, 0.109, quarter),
        (0.0, 0.095, -quarter),
        (0.0, 0.082, 0.0),
    ];
    let rows = rows.map(|(a, d, alpha)| DhRow { a, d, alpha, theta: 0.0 });
    let limits = Limits { lower: -PI, upper: PI, ..Limits::NONE };
    ChainBuilder::from_dh("offset_wrist", &rows, DhConvention::Standard).limits(&[limits; 6]).build().unwrap()
}

/// One arm of every kind of set, with the number of dimensions and whether the set is proven.
fn arms() -> Vec<(Chain, usize, bool)> {
    let limits = [Limits { lower: -2.2, upper: 2.4, ..Limits::NONE }; 7];
    vec![
        (catalog::load("iiwa14").unwrap(), 1, true),
        (catalog::load("puma560").unwrap(), 0, true),
        (scrambled_srs(3, [0.3, 0.4, 0.35, 0.1], [0.05, -0.03], &limits), 1, true),
        (traced("iiwa14"), 1, false),
        (traced("panda"), 1, false),
        (offset_wrist(), 0, false),
    ]
}

/// An arm that no closed form recognises.
fn traced(name: &str) -> Chain {
    let chain = catalog::load(name).unwrap();
    if closed_form(&chain).is_none() {
        return chain;
    }
    bent(&chain)
}

/// The arm with its last axes bent by a few degrees: no closed form has it.
fn bent(chain: &Chain) -> Chain {
    let mut builder = ChainBuilder::new("bent", "base").base(*chain.base()).tool(*chain.tool());
    for joint in chain.joints() {
        let twist = Rotation3::from_euler_angles(0.03, 0.05, 0.0);
        let placement = joint.placement * Pose::from_parts(Translation3::new(0.003, 0.002, 0.0), twist);
        builder = builder.joint(joint.name.clone(), joint.kind, placement, *joint.axis, joint.limits);
    }
    builder.build().unwrap()
}

fn limited(chain: &Chain, lower: &[f64], upper: &[f64]) -> Chain {
    let limits =
        lower.iter().zip(upper).map(|(lower, upper)| Limits { lower: *lower, upper: *upper, ..Limits::NONE });
    chain.with_limits(&limits.collect::<Vec<_>>()).unwrap()
}

fn over(chain: &Chain, pose: &Pose) -> Box<dyn Solutions> {
    solutions(chain, pose, &SolutionsSettings { starts: 40, ..Default::default() }).unwrap()
}

fn at(set: &dyn Solutions, piece: usize, u: f64) -> Vec<f64> {
    let mut q = vec![0.0; set.chain().dof()];
    set.q(piece, u, &mut q).unwrap();
    q
}

/// How far the worst joint is within its limits in its best winding.
fn room(chain: &Chain, q: &[f64]) -> f64 {
    let joint = |i: usize| {
        let (lower, upper) = (chain.lower()[i], chain.upper()[i]);
        let windings = (-3..=3).map(|k| q[i] + TAU * f64::from(k));
        windings.map(|q| (q - lower).min(upper - q)).fold(f64::NEG_INFINITY, f64::max)
    };
    (0..q.len()).map(joint).fold(f64::INFINITY, f64::min)
}

/// Every winding of `q` within the limits.
fn windings(chain: &Chain, q: &[f64]) -> Vec<Vec<f64>> {
    let mut all = vec![Vec::new()];
    for i in 0..q.len() {
        let values: Vec<f64> = (-2..=2)
            .map(|k| q[i] + TAU * f64::from(k))
            .filter(|q| *q >= chain.lower()[i] - 1e-9 && *q <= chain.upper()[i] + 1e-9)
            .collect();
        all =
            all.iter().flat_map(|row: &Vec<f64>| values.iter().map(|v| [&row[..], &[*v]].concat())).collect();
    }
    all
}

#[test]
fn every_point_closes_and_the_maker_is_among_them() {
    let mut rng = rng(1);
    for (chain, dimension, proven) in arms() {
        for _ in 0..amount(2, 30) {
            let q0 = random_q(&mut rng, &chain);
            let target = chain.forward(&q0).unwrap();
            let set = over(&chain, &target);
            assert_eq!((set.dimension(), set.proven()), (dimension, proven), "{}", chain.name());
            assert_eq!(set.status(), Status::Converged);
            assert_eq!(set.reason().is_empty(), proven, "{}", set.reason());
            let mut labels = Vec::new();
            for piece in 0..set.pieces() {
                labels.push(set.label(piece).unwrap());
                let [lo, hi] = set.range(piece).unwrap();
                assert_eq!(
                    set.closed(piece).unwrap(),
                    [lo, hi] == [-PI, PI],
                    "pieces of these arms are closed"
                );
                for _ in 0..10 {
                    let u = if hi > lo { rng.random_range(lo..hi) } else { lo };
                    let q = at(&*set, piece, u);
                    assert!(pose_error(&chain.forward(&q).unwrap(), &target) < 1e-10);
                    let parameter = set.parameter(piece, u).unwrap();
                    let named = closed_form(&chain).and_then(|form| form.parameter());
                    assert_eq!(parameter.is_some(), named.is_some());
                    if hi > lo {
                        let again = at(&*set, piece, u + TAU);
                        assert!(difference(&q, &again) < 1e-9);
                    }
                }
            }
            labels.dedup();
            assert_eq!(labels.len(), set.pieces(), "labels differ");
            if proven || dimension == 1 {
                let near = set.nearest(&q0).unwrap().unwrap();
                assert!(near.value < 1e-6, "{} {}", chain.name(), near.value);
                assert!(difference(&at(&*set, near.piece, near.u), &near.q) < 1e-9);
            }
        }
    }
}

#[test]
fn tangents_agree_with_differences_and_never_vanish() {
    let mut rng = rng(2);
    let (mut checked, h) = (0, 1e-6);
    for (chain, dimension, _) in arms().into_iter().filter(|arm| arm.1 == 1) {
        assert_eq!(dimension, 1);
        for _ in 0..amount(2, 20) {
            let target = chain.forward(&random_q(&mut rng, &chain)).unwrap();
            let set = over(&chain, &target);
            let mut tangent = vec![0.0; chain.dof()];
            for piece in 0..set.pieces() {
                for _ in 0..20 {
                    let u = rng.random_range(-PI..PI);
                    set.tangent(piece, u, &mut tangent).unwrap();
                    let size = tangent.iter().map(|t| t * t).sum::<f64>().sqrt();
                    assert!(size.is_finite() && size > 0.1, "{size}");
                    if size > 30.0 {
                        continue; // next to a gimbal differences are of no use
                    }
                    let (before, after) = (at(&*set, piece, u - h), at(&*set, piece, u + h));
                    for i in 0..chain.dof() {
                        let d = after[i] - before[i];
                        let slope = (d - TAU * (d / TAU).round()) / (2.0 * h);
                        assert!(
                            (slope - tangent[i]).abs() < 1e-4 * size.max(1.0),
                            "{} {slope} {}",
                            chain.name(),
                            tangent[i]
                        );
                    }
                    checked += 1;
                }
            }
        }
    }
    assert!(checked > 500, "{checked}");
}

/// At the ends of an interval a joint meets its (narrowed) limit; within it all hold, outside of all intervals none.
#[test]
fn intervals_agree_with_a_scan() {
    let mut rng = rng(3);
    let samples = amount(400, 4_000);
    let (mut edges, mut inside, mut outside) = (0, 0, 0);
    for (chain, dimension, _) in arms() {
        for k in 0..amount(2, 10) {
            let target = chain.forward(&random_q(&mut rng, &chain)).unwrap();
            let set = over(&chain, &target);
            let margin = [0.0, 0.05, 0.4][k % 3];
            for piece in 0..set.pieces() {
                let arcs = set.intervals(piece, margin).unwrap();
                if dimension == 0 {
                    let holds = room(&chain, &at(&*set, piece, 0.0)) >= margin;
                    assert_eq!(arcs, if holds { vec![[0.0, 0.0]] } else { vec![] });
                    continue;
                }
                assert!(arcs.windows(2).all(|pair| pair[0][1] <= pair[1][0] && pair[0][0] < pair[1][0]));
                for [lo, hi] in &arcs {
                    assert!((-PI..PI).contains(lo) && hi - lo <= TAU, "{lo} {hi}");
                    if hi - lo < TAU {
                        for u in [lo, hi] {
                            let q = at(&*set, piece, *u);
                            let mut tangent = vec![0.0; chain.dof()];
                            set.tangent(piece, *u, &mut tangent).unwrap();
                            let rate = tangent.iter().fold(1.0_f64, |a, t| a.max(t.abs()));
                            assert!(
                                (room(&chain, &q) - margin).abs() < 1e-9 * rate,
                                "{}",
                                room(&chain, &q) - margin
                            );
                            edges += 1;
                        }
                    }
                }
                let near =
                    |u: f64| arcs.iter().flatten().any(|e| ((u - e + PI).rem_euclid(TAU) - PI).abs() < 1e-6);
                for _ in 0..samples {
                    let u = rng.random_range(-PI..PI);
                    if near(u) {
                        continue;
                    }
                    let holds = arcs.iter().any(|[lo, hi]| (u - lo).rem_euclid(TAU) <= hi - lo);
                    let room = room(&chain, &at(&*set, piece, u));
                    assert_eq!(holds, room >= margin, "{} piece {piece} u {u} room {room}", chain.name());
                    if holds { inside += 1 } else { outside += 1 }
                }
            }
        }
    }
    assert!(edges > 50 && inside > 1_000 && outside > 1_000, "{edges} {inside} {outside}");
}

/// A joint whose range is a little under and a little over one turn: the winding changes where it has least room.
#[test]
fn a_range_of_about_one_turn_limits_where_the_winding_changes() {
    let chain = traced("panda");
    let target = chain.forward(&[0.1, 0.4, -0.2, -1.9, 0.3, 1.7, 0.5]).unwrap();
    for (half, margin) in [(PI - 1e-3, 0.0), (PI + 1e-3, 2e-3), (PI + 0.1, 0.3), (PI + 0.1, 0.05), (PI, 0.0)]
    {
        let n = chain.dof();
        let (mut lower, mut upper) = (vec![-100.0; n], vec![100.0; n]);
        (lower[0], upper[0]) = (1.0 - half, 1.0 + half);
        let narrowed = limited(&chain, &lower, &upper);
        let set = over(&narrowed, &target);
        for piece in 0..set.pieces() {
            let arcs = set.intervals(piece, margin).unwrap();
            let samples = 20_000;
            let mut gaps = 0;
            let mut before = true;
            for k in 0..samples {
                let u = -PI + TAU * f64::from(k) / f64::from(samples);
                let holds = room(&narrowed, &at(&*set, piece, u)) >= margin;
                gaps += usize::from(before && !holds);
                before = holds;
            }
            let whole = arcs == [[-PI, PI]];
            assert!(
                if gaps == 0 { whole } else { arcs.len() >= gaps - 1 && !whole },
                "{half} {margin} {arcs:?} {gaps}"
            );
        }
    }
}

/// Neither beaten by a dense scan of the pieces in all windings.
#[test]
fn nearest_and_best_are_never_worse_than_a_scan() {
    let mut rng = rng(4);
    let samples = amount(300, 3_000);
    for (chain, dimension, set_proven) in arms() {
        for _ in 0..amount(1, 10) {
            let target = chain.forward(&random_q(&mut rng, &chain)).unwrap();
            let set = over(&chain, &target);
            let wish = random_q(&mut rng, &chain);
            let range = JointRange::new(&chain);
            let posture = Posture::new(&wish).unwrap();
            let dexterity = Manipulability::new(&chain, Task::POSE);
            let falling = Weighted::multiple(-1.0, Arc::new(dexterity.clone())).unwrap();
            let mixed = Weighted::sum(Arc::new(posture.clone()), Arc::new(falling)).unwrap();
            let criteria: [(&dyn Criterion, bool); 4] =
                [(&range, true), (&posture, true), (&dexterity, false), (&mixed, false)];
            let found = criteria.map(|(criterion, _)| set.best(criterion).unwrap().unwrap());
            let near = set.nearest(&wish).unwrap().unwrap();
            let mut beaten = [f64::INFINITY; 5];
            for piece in 0..set.pieces() {
                for [lo, hi] in set.intervals(piece, 0.0).unwrap() {
                    for k in 0..=if hi > lo { samples } else { 0 } {
                        let u = lo + (hi - lo) * k as f64 / samples as f64;
                        for q in windings(&chain, &at(&*set, piece, u)) {
                            for (i, (criterion, _)) in criteria.iter().enumerate() {
                                let value = criterion.sense().sign() * criterion.value(&q);
                                beaten[i] = beaten[i].min(value);
                            }
                            let distance =
                                q.iter().zip(&wish).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
                            beaten[4] = beaten[4].min(distance);
                        }
                    }
                }
            }
            for (i, (criterion, springs)) in criteria.iter().enumerate() {
                let (found, sign) = (&found[i], criterion.sense().sign());
                assert!(
                    sign * found.value <= beaten[i] + 1e-9 * (1.0 + beaten[i].abs()),
                    "{} {i}",
                    chain.name()
                );
                assert_eq!(found.value, criterion.value(&found.q));
                assert!(chain.within_limits(&found.q, 0.0));
                assert!(pose_error(&chain.forward(&found.q).unwrap(), &target) < 1e-8);
                assert!(difference(&at(&*set, found.piece, found.u), &found.q) < 1e-8);
                assert!(found.u == 0.0 || (-PI..PI).contains(&found.u), "{}", found.u);
                let exact = set_proven && (dimension == 0 || *springs);
                assert!(found.proven == exact || dimension == 0, "{} {i}", chain.name());
                assert!(set_proven || !found.proven);
            }
            assert!(near.value <= beaten[4] + 1e-9, "{} {} {}", chain.name(), near.value, beaten[4]);
            assert!(chain.within_limits(&near.q, 0.0));
            assert_eq!(near.proven, set_proven);
        }
    }
}

#[test]
fn a_set_without_a_configuration_within_limits_says_so() {
    let mut rng = rng(5);
    for (chain, _, proven) in arms() {
        // Beyond what the arm reaches: exact for every arm.
        let far = Pose::from_parts(Translation3::new(9.0, 0.0, 0.0), random_pose(&mut rng, 1.0).rotation);
        let set = over(&chain, &far);
        assert_eq!((set.status(), set.pieces(), set.proven()), (Status::Unreachable, 0, true));
        assert!(!set.reason().is_empty());
        assert_eq!(set.nearest(&vec![0.1; chain.dof()]).unwrap(), None);
        assert_eq!(set.best(&JointRange::new(&chain)).unwrap(), None);
        assert!(set.q(0, 0.0, &mut vec![0.0; chain.dof()]).is_err());
        // Limits that only allow another posture.
        let q = random_q(&mut rng, &chain);
        let target = chain.forward(&q).unwrap();
        let lower: Vec<f64> = q.iter().map(|_| 0.01).collect();
        let upper: Vec<f64> = q.iter().map(|_| 0.02).collect();
        let tight = limited(&chain, &lower, &upper);
        // Found from anywhere: the starts are drawn within the limits.
        let set = over(&tight, &target);
        assert!(matches!(set.status(), Status::Limits | Status::Unreachable), "{}", chain.name());
        if proven {
            assert_eq!(set.status(), Status::Limits);
        }
        assert_eq!(set.proven(), proven);
        assert_eq!(set.best(&JointRange::new(&tight)).unwrap(), None);
        assert_eq!(set.nearest(&vec![0.015; chain.dof()]).unwrap(), None);
        let reason = set.reason();
        assert!(reason.contains(if proven { "outside" } else { "40 starts" }), "{reason}");
    }
}

/// Folded arms, wrist on the first axis, wrist at its gimbal: the sets say what they leave out, and are not beaten.
#[test]
fn poses_that_leave_joints_free_are_not_called_proven() {
    let chain = catalog::load("puma560").unwrap();
    let form = closed_form(&chain).unwrap();
    for (q, word) in [([0.3, 0.5, -0.2, 0.7, 0.0, 0.4], "gimbal"), ([0.3, 0.5, -0.2, 0.7, 0.5, 0.4], "")] {
        let target = chain.forward(&q).unwrap();
        let set = form.solutions(&target).unwrap();
        assert_eq!(set.proven(), word.is_empty());
        assert!(set.reason().contains(word));
        let posture = Posture::new(&[0.3, 0.5, -0.2, 1.0, 0.0, 0.1]).unwrap();
        let best = set.best(&posture).unwrap().unwrap();
        assert!(best.value <= posture.value(&q) + 1e-12, "{}", best.value);
        assert_eq!(best.proven, word.is_empty());
        assert!(pose_error(&chain.forward(&best.q).unwrap(), &target) < 1e-10);
        if !word.is_empty() {
            assert!(best.value < 1e-12, "the share (1.0, 0.1) of the sum 1.1 is the wish: {}", best.value);
        }
    }
    let chain = catalog::load("iiwa14").unwrap();
    // Wrist stretched: joints 5 and 7 share their sum for one swivel.
    let target = chain.forward(&[0.3, 0.5, -0.2, -1.1, 0.4, 0.0, 0.3]).unwrap();
    let set = closed_form(&chain).unwrap().solutions(&target).unwrap();
    assert!(!set.proven() && set.reason().contains("gimbal"), "{}", set.reason());
}

#[test]
fn other_tasks_have_curves_and_points_too() {
    let mut rng = rng(6);
    for (name, task, dimension) in [
        ("planar3r", Task::PLANAR, 1),
        ("planar3r", Task::PLANAR_POSE, 0),
        ("planar4r", Task::PLANAR_POSE, 1),
        ("puma560", Task::POINTING, 1),
    ] {
        let chain = catalog::load(name).unwrap();
        let q = random_q(&mut rng, &chain);
        let target = chain.forward(&q).unwrap();
        let settings = SolutionsSettings { task, starts: 40, ..Default::default() };
        let set = solutions(&chain, &target, &settings).unwrap();
        assert_eq!((set.dimension(), set.status()), (dimension, Status::Converged), "{name}");
        let near = set.nearest(&q).unwrap().unwrap();
        assert!(near.value < 1e-6, "{name} {}", near.value);
    }
}

#[test]
fn what_is_wrong_is_named() {
    let chain = catalog::load("puma560").unwrap();
    let target = chain.forward(&[0.3, 0.5, -0.2, 0.7, 0.4, 0.4]).unwrap();
    let refuse = |chain: &Chain, settings: SolutionsSettings, word: &str| {
        let error = solutions(chain, &target, &settings).unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    };
    refuse(&chain, SolutionsSettings { task: Task::POSITION, ..Default::default() }, "3 dimensions");
    refuse(&catalog::load("planar3r").unwrap(), SolutionsSettings::default(), "has 3 joints");
    refuse(&chain, SolutionsSettings { starts: 0, ..Default::default() }, "starts");
    let set = over(&chain, &target);
    let (mut q, mut short) = (vec![0.0; 6], vec![0.0; 5]);
    assert!(set.q(set.pieces(), 0.0, &mut q).unwrap_err().to_string().contains("piece"));
    assert!(set.q(0, f64::NAN, &mut q).is_err());
    assert!(set.q(0, 0.0, &mut short).is_err());
    assert!(set.tangent(0, 0.0, &mut q).unwrap_err().to_string().contains("no tangent"));
    assert!(set.intervals(0, -1.0).unwrap_err().to_string().contains("margin"));
    assert!(set.nearest(&short).is_err());
    assert!(set.best(&JointRange::new(&catalog::load("iiwa14").unwrap())).is_err());
}

#[test]
fn the_registry_names_its_arms() {
    for (name, form, parameter) in [
        ("iiwa14", Some("srs"), Some("swivel")),
        ("pa10", Some("srs"), Some("swivel")),
        ("puma560", Some("spherical_wrist"), None),
        ("planar3r", None, None),
    ] {
        let chain = catalog::load(name).unwrap();
        let found = closed_form(&chain);
        assert_eq!(found.as_ref().map(|f| f.name()), form, "{name}");
        assert_eq!(found.as_ref().and_then(|f| f.parameter()), parameter);
        let Some(found) = found else { continue };
        assert_eq!(found.chain().name(), chain.name());
        assert!(found.exact() && found.defect().largest() < 1e-9);
        let q = vec![0.4; chain.dof()];
        let target = chain.forward(&q).unwrap();
        assert!(found.in_reach(&target));
        let beyond = Pose::from_parts(Translation3::from(Vector3::new(5.0, 0.0, 0.0)), target.rotation);
        assert!(!found.in_reach(&beyond));
        let starts = found.starts(&target);
        assert!(
            starts.iter().all(|q| pose_error(&chain.forward(q).unwrap(), &target) < 1e-10)
                && starts.len() >= 4
        );
        // What the inverse kinematics takes holds the limits.
        let mut chosen = vec![0.0; chain.dof()];
        assert_eq!(found.select(&target, None, None, &mut chosen), Status::Converged);
        assert!(chain.within_limits(&chosen, 0.0));
        assert_eq!(found.select(&target, Some(&q), None, &mut chosen), Status::Converged);
        assert!(difference(&chosen, &q) < 1e-9);
        assert_eq!(found.select(&beyond, Some(&q), None, &mut chosen), Status::Unreachable);
        let mut rows = vec![0.0; found.branches() * chain.dof()];
        let mask = found.branches_into(&target, &mut rows);
        assert_eq!(mask.count_ones() as usize, if parameter.is_none() { 8 } else { 0 });
    }
}
