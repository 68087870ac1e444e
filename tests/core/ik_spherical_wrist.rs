//! The closed form of six-joint arms with a spherical wrist.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use rand::Rng;
use redundancy_core::chain::{Chain, ChainBuilder, JointKind, Limits, catalog};
use redundancy_core::nalgebra::{Rotation3, Translation3, Vector3};
use redundancy_core::solutions::SphericalWristArm;
use redundancy_core::{Error, Pose, Status, pose_to_row_major};
use rs_opw_kinematics::glam::{DMat3, DQuat, DVec3};
use rs_opw_kinematics::kinematic_traits::{Kinematics, Pose as OpwPose};
use rs_opw_kinematics::kinematics_impl::OPWKinematics;
use rs_opw_kinematics::parameters::opw_kinematics::Parameters;

use crate::allocations;
use crate::support::{amount, difference, pose_error, random_pose, random_q, rng, scrambled};

/// Shoulder offset, elbow offset, lateral offset, and the heights of shoulder, elbow, wrist, tip.
type Shape = [f64; 7];

const SHAPES: [Shape; 6] = [
    [0.0, 0.0, 0.0, 0.4, 0.4, 0.4, 0.1],      // no offset at all, equal links
    [0.15, -0.11, 0.0, 0.45, 0.6, 0.64, 0.1], // KUKA, ABB, Fanuc
    [0.0, 0.0203, 0.15, 0.0, 0.4318, 0.4318, 0.0], // PUMA
    [-0.1, 0.05, -0.07, 0.3, 0.5, 0.3, 0.2],  // shoulder behind axis 1
    [0.3, 0.2, 0.1, 0.2, 0.25, 0.9, 0.05],    // short upper arm
    [0.025, 0.0, 0.0, 0.4, 0.315, 0.365, 0.08], // KUKA KR 6
];

fn axes([a1, a2, b, c1, c2, c3, _]: Shape) -> [(Vector3<f64>, Vector3<f64>); 6] {
    let (y, z) = (Vector3::y(), Vector3::z());
    let wrist = Vector3::new(a1 + a2, b, c1 + c2 + c3);
    let elbow = Vector3::new(a1, b, c1 + c2);
    [(Vector3::zeros(), z), (Vector3::new(a1, b, c1), y), (elbow, y), (wrist, z), (wrist, y), (wrist, z)]
}

fn arms(limits: &dyn Fn(u64) -> [Limits; 6]) -> Vec<Chain> {
    let tip = |s: Shape| Vector3::new(s[0] + s[1], s[2], s[3] + s[4] + s[5] + s[6]);
    (0..12)
        .map(|seed| {
            let shape = SHAPES[seed as usize % SHAPES.len()];
            scrambled(seed, &axes(shape), tip(shape), &limits(seed))
        })
        .collect()
}

fn narrow(seed: u64) -> [Limits; 6] {
    let mut rng = rng(seed);
    std::array::from_fn(|_| {
        let centre: f64 = rng.random_range(-2.0..2.0);
        let half: f64 = rng.random_range(1.2..4.5);
        Limits { lower: centre - half, upper: centre + half, ..Limits::NONE }
    })
}

fn signs(branch: usize) -> [i8; 3] {
    SphericalWristArm::signs(branch)
}

#[test]
fn every_branch_closes_and_the_maker_is_among_them() {
    let mut rng = rng(1);
    for chain in arms(&|_| [Limits::NONE; 6]).into_iter().chain([catalog::load("puma560").unwrap()]) {
        let arm = SphericalWristArm::new(&chain).unwrap();
        assert!(arm.defect().position < 1e-12 && arm.defect().orientation < 1e-12, "{:?}", arm.defect());
        for _ in 0..amount(500, 50_000) {
            let q = random_q(&mut rng, &chain);
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
                assert_eq!(arm.branch(row).unwrap(), signs(b), "{row:?}");
                makers += usize::from(difference(row, &q) < 1e-6);
                for other in (0..b).filter(|b| mask & (1 << b) != 0) {
                    assert!(difference(row, &rows[other]) > 1e-9, "repeat");
                }
            }
            assert_eq!(makers, 1, "{q:?} {rows:?}");
            let branch = arm.branch(&q).unwrap();
            let index =
                4 * usize::from(branch[0] < 0) + 2 * usize::from(branch[1] < 0) + usize::from(branch[2] < 0);
            assert!(difference(&rows[index], &q) < 1e-6);
        }
    }
}

#[test]
fn limits_and_windings_hold_or_the_reason_is_given() {
    let mut rng = rng(2);
    let (mut converged, mut limited) = (0, 0);
    for chain in arms(&narrow) {
        let arm = SphericalWristArm::new(&chain).unwrap();
        let free = SphericalWristArm::new(&chain.with_limits(&[Limits::NONE; 6]).unwrap()).unwrap();
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
            let holds = |row: &[f64; 6]| {
                row.iter()
                    .zip(chain.lower())
                    .zip(chain.upper())
                    .all(|((q, lo), hi)| (-2..=2).any(|k| (*lo..=*hi).contains(&(q + TAU * f64::from(k)))))
            };
            let expected = free.solve(&target, false).unwrap().into_iter().filter(holds).count();
            let all = arm.configurations(&target).unwrap();
            assert_eq!(all.q.len(), expected);
            if expected == 0 {
                assert_eq!(all.status, Status::Limits);
                assert!(all.reason.contains("even the best leaves joint 'j"), "{}", all.reason);
                assert!(arm.nearest(&target, &q).unwrap().is_none());
                limited += 1;
            } else {
                assert_eq!((all.status, all.reason.as_str(), all.distance), (Status::Converged, "", 0.0));
                // Nearest among all windings of all branches.
                let distance = |a: &[f64]| a.iter().zip(&q).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
                let near = arm.nearest(&target, &q).unwrap().unwrap();
                assert!(chain.within_limits(&near, 0.0));
                let best = all.q.iter().map(|row| {
                    let wound = std::array::from_fn::<f64, 6, _>(|i| {
                        let windings = (-2..=2).map(|k| row[i] + TAU * f64::from(k));
                        let inside = windings.filter(|x| *x >= chain.lower()[i] && *x <= chain.upper()[i]);
                        inside.min_by(|a, b| (a - q[i]).abs().total_cmp(&(b - q[i]).abs())).unwrap_or(row[i])
                    });
                    distance(&wound)
                });
                assert!((distance(&near) - best.fold(f64::INFINITY, f64::min)).abs() < 1e-12);
                converged += 1;
            }
        }
    }
    assert!(converged > 100 && limited > 100, "{converged} {limited}");
}

/// The same arm in the parameters of rs-opw-kinematics.
fn from_opw(p: &Parameters) -> Chain {
    let frames = axes([p.a1, p.a2, p.b, p.c1, p.c2, p.c3, p.c4]);
    let mut builder = ChainBuilder::new("opw", "base");
    let mut previous = Pose::identity();
    for (i, (point, direction)) in frames.iter().enumerate() {
        // Their model angle is `sign * q - offset`.
        let turn = Rotation3::new(direction * -p.offsets[i]);
        let frame = Pose::from_parts(Translation3::from(*point), Rotation3::identity());
        let placement = previous.inverse() * frame;
        let placement = Pose::from_parts(placement.translation, turn);
        builder = builder.joint(
            format!("j{i}"),
            JointKind::Revolute,
            placement,
            direction * f64::from(p.sign_corrections[i]),
            Limits::NONE,
        );
        previous = frame;
    }
    builder
        .link("tip", Pose::from_parts(Translation3::new(0.0, 0.0, p.c4), Rotation3::identity()))
        .build()
        .unwrap()
}

fn to_opw(pose: &Pose) -> OpwPose {
    let m = pose.rotation.matrix();
    let rotation = DQuat::from_mat3(&DMat3::from_cols_slice(m.as_slice()));
    let t = pose.translation.vector;
    OpwPose::from_parts(DVec3::new(t.x, t.y, t.z), rotation)
}

#[test]
fn agrees_with_rs_opw_kinematics() {
    let robots = [
        Parameters::irb2400_10(),
        Parameters::staubli_tx2_140(),
        Parameters::fanuc_r2000ib_200r(),
        Parameters::kuka_kr6_r700_sixx(),
        Parameters::staubli_tx40(),
        Parameters::staubli_rx160(),
        Parameters { b: 0.1, ..Parameters::irb2400_10() },
    ];
    let mut rng = rng(3);
    for parameters in robots {
        let chain = from_opw(&parameters);
        let arm = SphericalWristArm::new(&chain).unwrap();
        let theirs = OPWKinematics::new(parameters);
        for _ in 0..amount(300, 10_000) {
            let q: [f64; 6] = std::array::from_fn(|_| rng.random_range(-PI..PI));
            let target = chain.forward(&q).unwrap();
            let expected = to_opw(&target);
            let forward = theirs.forward(&q);
            assert!((forward.translation - expected.translation).length() < 1e-12);
            let rows = arm.solve(&target, false).unwrap();
            let other = theirs.inverse(&expected);
            // They drop what their own check of 1e-6 misses; what they return must be here, and here is what they return.
            for row in &other {
                assert!(rows.iter().any(|r| difference(r, row) < 1e-5), "{row:?} {rows:?}");
            }
            let ours_too = rows.iter().filter(|r| other.iter().any(|row| difference(*r, row) < 1e-5)).count();
            assert_eq!(ours_too, rows.len(), "{rows:?}\n{other:?}");
        }
    }
}

#[test]
fn degenerate_poses_are_defined() {
    for (k, chain) in arms(&|_| [Limits::NONE; 6]).into_iter().enumerate() {
        let arm = SphericalWristArm::new(&chain).unwrap();
        let mut rng = rng(4);
        let straight = straight_elbow(&arm, &chain);
        for _ in 0..amount(50, 2_000) {
            let base = random_q(&mut rng, &chain);
            // Every combination of a locked wrist, a straight or folded elbow, a small distance from both.
            for (wrist, elbow) in [(true, false), (false, true), (true, true)] {
                for near in [0.0, 1e-15, 1e-12, 1e-9, 1e-6] {
                    let mut q = base.clone();
                    if wrist {
                        q[4] = locked_wrist(&arm, &chain) + near;
                    }
                    if elbow {
                        q[2] = straight + near;
                    }
                    let target = chain.forward(&q).unwrap();
                    let mut rows = [[0.0; 6]; 8];
                    let mask = arm.solve_into(&target, true, &mut rows);
                    assert!(mask != 0, "{k} {q:?}");
                    for (b, row) in rows.iter().enumerate() {
                        assert!(row.iter().all(|q| q.is_finite()));
                        if mask & (1 << b) != 0 {
                            assert!(pose_error(&chain.forward(row).unwrap(), &target) < 1e-11);
                        }
                    }
                    let found = arm.nearest(&target, &q).unwrap().unwrap();
                    assert!(pose_error(&chain.forward(&found).unwrap(), &target) < 1e-11);
                    // Near the shoulder's singularity the rounding of joint 1 moves joint 5 off its gimbal.
                    let steady = (0..3).all(|i| (found[i] - q[i]).abs() < 1e-13);
                    if near == 0.0 && !elbow && steady {
                        assert!(difference(&found, &q) < 1e-6, "{found:?} {q:?}");
                    }
                }
            }
        }
    }
}

/// The value of joint 5 at which axes 4 and 6 are one line.
fn locked_wrist(arm: &SphericalWristArm, chain: &Chain) -> f64 {
    // The wrist branches mirror it: their mean, or that half a turn away.
    let q = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6];
    let rows = arm.solve(&chain.forward(&q).unwrap(), false).unwrap();
    (rows[0][4] + rows[1][4]) / 2.0
}

/// The value of joint 3 at which the arm is stretched or folded.
fn straight_elbow(arm: &SphericalWristArm, chain: &Chain) -> f64 {
    let q = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6];
    let rows = arm.solve(&chain.forward(&q).unwrap(), false).unwrap();
    let branch = |row: &[f64; 6]| arm.branch(row).unwrap();
    let own = rows.iter().find(|r| branch(r)[0] == branch(&q)[0] && branch(r)[1] > 0).unwrap();
    let other = rows.iter().find(|r| branch(r)[0] == branch(&q)[0] && branch(r)[1] < 0).unwrap();
    (own[2] + other[2]) / 2.0
}

/// Wrist centre on axis 1: joint 1 is free.
#[test]
fn shoulder_singularity_keeps_joint_1() {
    let shape = SHAPES[1];
    let tip = Vector3::new(0.0, 0.0, 0.1);
    let chain = scrambled(5, &axes(shape), tip, &[Limits::NONE; 6]);
    let arm = SphericalWristArm::new(&chain).unwrap();
    // The wrist centre in the tool frame, from two configurations that differ in the wrist only.
    let mut rng = rng(6);
    for _ in 0..50 {
        let q1 = rng.random_range(-PI..PI);
        let pose = on_axis_1(&arm, &chain, &mut rng);
        let q = [q1, 0.3, 0.4, 0.5, 0.6, 0.7];
        let found = arm.nearest(&pose, &q).unwrap().unwrap();
        assert!((found[0] - q1).abs() < 1e-12);
        assert!(pose_error(&chain.forward(&found).unwrap(), &pose) < 1e-11);
        let rows = arm.solve(&pose, false).unwrap();
        assert_eq!(rows.len(), 4);
        for row in rows {
            assert!(row[0].abs() < 1e-15);
            assert!(pose_error(&chain.forward(&row).unwrap(), &pose) < 1e-11);
        }
    }
}

/// A pose with a random orientation whose wrist centre is a point of axis 1 within reach.
fn on_axis_1(arm: &SphericalWristArm, chain: &Chain, rng: &mut impl Rng) -> Pose {
    let mut scratch = redundancy_core::kinematics::Scratch::new(chain);
    let q = [0.0; 6];
    let kinematics = chain.kinematics(&q, &mut scratch).unwrap();
    let (origin, k) = (kinematics.origins()[0], kinematics.axes()[0]);
    let (a, u) = (kinematics.origins()[3], kinematics.axes()[3]);
    let (b, v) = (kinematics.origins()[5], kinematics.axes()[5]);
    // Where axes 4 and 6 meet.
    let n = u.cross(&v);
    let wrist = a + u * (b - a).cross(&v).dot(&n) / n.norm_squared();
    let in_tool = kinematics.pose().inverse_transform_point(&wrist.into()).coords;
    loop {
        let rotation = random_pose(rng, 1.0).rotation;
        let point = origin + k * rng.random_range(-1.0..2.0);
        let pose = Pose::from_parts(Translation3::from(point - rotation * in_tool), rotation);
        if !arm.solve(&pose, false).unwrap().is_empty() {
            return pose;
        }
    }
}

#[test]
fn out_of_reach_by_the_distance_of_brute_force() {
    let mut rng = rng(7);
    for (k, shape) in SHAPES.into_iter().enumerate() {
        let [a1, a2, b, c1, c2, c3, _] = shape;
        // Plain frames: tip at the wrist, base at the origin.
        let frames = axes(shape);
        let mut builder = ChainBuilder::new("plain", "base");
        let mut previous = Vector3::zeros();
        for (i, (point, direction)) in frames.iter().enumerate() {
            let placement = Pose::from_parts(Translation3::from(point - previous), Rotation3::identity());
            builder =
                builder.joint(format!("j{i}"), JointKind::Revolute, placement, *direction, Limits::NONE);
            previous = *point;
        }
        let chain = builder.build().unwrap();
        let arm = SphericalWristArm::new(&chain).unwrap();
        let mut checked = 0;
        for _ in 0..amount(20, 500) {
            let wrist = Vector3::new(
                rng.random_range(-1.5..1.5),
                rng.random_range(-0.3..0.3),
                rng.random_range(-1.0..2.0),
            );
            let rotation = random_pose(&mut rng, 1.0).rotation;
            let all = arm.configurations(&Pose::from_parts(Translation3::from(wrist), rotation)).unwrap();
            if all.status == Status::Converged {
                assert!(!all.q.is_empty() && all.distance == 0.0);
                continue;
            }
            assert_eq!((all.status, all.q.len()), (Status::Unreachable, 0));
            // All joint 2 and 3 angles; joint 1 turns to the nearest point of its circle.
            let (rho, steps) = (wrist.xy().norm(), 400);
            let mut least = f64::INFINITY;
            for i in 0..steps {
                for j in 0..steps {
                    let (s2, c2s) = (TAU * f64::from(i) / f64::from(steps)).sin_cos();
                    let (s3, c3s) = (TAU * f64::from(j) / f64::from(steps)).sin_cos();
                    // upper arm (0, c2) and forearm (a2, c3) in (x, z), each turned from z to x
                    let x = a1 + c2 * s2 + a2 * c3s + c3 * s3;
                    let z = c1 + c2 * c2s - a2 * s3 + c3 * c3s;
                    least = least.min((x.hypot(b) - rho).hypot(z - wrist.z));
                }
            }
            assert!(
                all.distance <= least + 1e-9 && all.distance > least - 0.012,
                "{k}: {} {least}",
                all.distance
            );
            assert!(all.reason.contains(&format!("{:.6} mm", 1e3 * all.distance)), "{}", all.reason);
            checked += 1;
        }
        assert!(checked > 3);
    }
}

#[test]
fn other_arms_are_refused_with_the_defect() {
    let refused = |chain: &Chain| match SphericalWristArm::new(chain) {
        Err(Error::NotSphericalWrist { reason }) => reason,
        other => panic!("{other:?}"),
    };
    assert_eq!(refused(&catalog::load("panda").unwrap()), "'panda' has 7 joints, 6 are needed");
    let shape = SHAPES[1];
    let with = |change: &dyn Fn(&mut [(Vector3<f64>, Vector3<f64>); 6])| {
        let mut lines = axes(shape);
        change(&mut lines);
        refused(&scrambled(0, &lines, Vector3::zeros(), &[Limits::NONE; 6]))
    };
    assert_eq!(
        with(&|l| l[5].0.y += 0.03),
        "axes 5 and 6 miss each other by 0.000 mm"
            .replace("5 and 6 miss each other by 0.000 mm", "4 and 6 cross axis 5 at points 30.000 mm apart")
    );
    assert_eq!(with(&|l| l[4].0.x += 0.002), "axes 4 and 5 miss each other by 2.000 mm");
    let tilted = Rotation3::from_axis_angle(&Vector3::x_axis(), 0.005) * Vector3::y();
    assert_eq!(with(&|l| l[2].1 = tilted), "axes 2 and 3 are 5.000 mrad away from parallel");
    assert_eq!(
        with(&|l| (l[1].1, l[2].1) = (tilted, tilted)),
        "axes 1 and 2 are 5.000 mrad away from a right angle"
    );
    assert_eq!(with(&|l| l[2].0 = l[1].0), "axes 2 and 3 are the same line, 0.000000 mm apart");
    // A URDF that writes 1.5708 and rounds lengths to 0.01 mm is accepted and its defect bounds the error.
    let mut lines = axes(shape);
    lines[4].0.x += 1e-5;
    lines[2].1 = Rotation3::from_axis_angle(&Vector3::x_axis(), 4e-6) * Vector3::y();
    let chain = scrambled(1, &lines, Vector3::new(0.1, 0.0, 1.9), &[Limits::NONE; 6]);
    let arm = SphericalWristArm::new(&chain).unwrap();
    let defect = arm.defect();
    assert!(defect.position > 1e-5 && defect.position < 4e-5 && defect.orientation > 4e-6);
    let mut rng = rng(8);
    for _ in 0..200 {
        let target = chain.forward(&random_q(&mut rng, &chain)).unwrap();
        for row in arm.solve(&target, false).unwrap() {
            let reached = chain.forward(&row).unwrap();
            let miss = (reached.translation.vector - target.translation.vector).norm();
            assert!(miss <= 1e-12 + 2.0 * defect.position);
            assert!(reached.rotation.angle_to(&target.rotation) <= 1e-7 + 2.0 * defect.orientation);
        }
    }
}

#[test]
fn batches_have_the_same_bits_and_nothing_allocates() {
    let chain = catalog::load("puma560").unwrap();
    let arm = SphericalWristArm::new(&chain).unwrap();
    let mut rng = rng(9);
    let poses: Vec<Pose> = (0..500).map(|_| chain.forward(&random_q(&mut rng, &chain)).unwrap()).collect();
    let rows: Vec<f64> = poses.iter().flat_map(pose_to_row_major).collect();
    let (mut q, mut valid) = (vec![0.0; 500 * 48], vec![false; 500 * 8]);
    let pool = |n| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
    pool(1).install(|| arm.solve_batch(&rows, true, &mut q, &mut valid)).unwrap();
    let (mut q3, mut valid3) = (vec![0.0; 500 * 48], vec![false; 500 * 8]);
    pool(3).install(|| arm.solve_batch(&rows, true, &mut q3, &mut valid3)).unwrap();
    assert!(q == q3 && valid == valid3);
    for (i, pose) in poses.iter().enumerate() {
        let single = arm.solve(pose, true).unwrap();
        let batch: Vec<[f64; 6]> = (0..8)
            .filter(|b| valid[8 * i + b])
            .map(|b| q[48 * i + 6 * b..48 * i + 6 * b + 6].try_into().unwrap())
            .collect();
        assert_eq!(single, batch);
    }
    let mut out = [[0.0; 6]; 8];
    assert_eq!(allocations::count(|| arm.solve_into(&poses[0], true, &mut out)), 0);
    assert_eq!(allocations::count(|| arm.nearest(&poses[0], &[0.1; 6]).unwrap()), 0);
    let mut bad = rows.clone();
    bad[16 * 7] = 2.0;
    let error = arm.solve_batch(&bad, true, &mut q, &mut valid).unwrap_err().to_string();
    assert!(error.contains("pose 7") && error.contains("not orthonormal"), "{error}");
    let tilted = Rotation3::new(Vector3::x() * FRAC_PI_2);
    assert!(arm.solve(&Pose::from_parts(Translation3::new(f64::NAN, 0.0, 0.0), tilted), true).is_err());
}
