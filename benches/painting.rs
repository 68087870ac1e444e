//! The spray experiment: torques, rules, the largest speed. `cargo bench --bench painting`; ids `room/function/robot`.
#![allow(clippy::expect_used)] // a bench may stop

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use redundancy_core::Pose;
use redundancy_core::chain::{Chain, catalog};
use redundancy_core::kinematics::{DynamicsScratch, TorqueDerivatives};
use redundancy_core::nalgebra::Vector3;
use redundancy_core::path::Path;
use redundancy_core::planning::{BarrierRule, OrientationRule, RuleKind, RuleSpin};
use redundancy_core::timing::{SpeedSettings, fastest_profile, max_speed, max_speed_of_poses};

fn dynamics(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("kinematics");
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    for name in ["puma560", "iiwa14"] {
        let arm = catalog::load(name).expect("arm");
        let n = arm.dof();
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut row = || (0..n).map(|_| rng.random_range(-2.0..2.0)).collect::<Vec<f64>>();
        let (q, qd, qdd) = (row(), row(), row());
        let (mut scratch, mut tau) = (DynamicsScratch::new(&arm), vec![0.0; n]);
        let mut derivatives = TorqueDerivatives::new(n);
        group.bench_function(format!("inverse_dynamics/{name}"), |b| {
            b.iter(|| arm.inverse_dynamics(black_box(&q), &qd, &qdd, &gravity, &mut scratch, &mut tau));
        });
        group.bench_function(format!("inverse_dynamics_derivatives/{name}"), |b| {
            let out = &mut derivatives;
            b.iter(|| {
                arm.inverse_dynamics_derivatives(black_box(&q), &qd, &qdd, &gravity, &mut scratch, out)
            });
        });
    }
    group.finish();
}

fn experiment() -> (Chain, Path, Vec<Vector3<f64>>) {
    let arm = catalog::load("puma560").and_then(|arm| arm.with_tool(Pose::translation(-0.15, 0.0, 0.4)));
    let file = format!("{}/../../tests/golden/spray_ref_b_path.csv", env!("CARGO_MANIFEST_DIR"));
    let path = Path::from_csv(file).expect("path");
    let positions = path.poses().iter().map(|p| p.translation.vector).collect();
    (arm.expect("arm"), path, positions)
}

fn planning(criterion: &mut Criterion) {
    let (arm, path, positions) = experiment();
    let mut group = criterion.benchmark_group("planning");
    group.throughput(Throughput::Elements(positions.len() as u64));
    let barrier = BarrierRule::default();
    let two_cones = RuleKind::BarrierTwoCones { axis: barrier, gamma: 1.0, k_x: 1.0 };
    for (name, kind) in [
        ("pointing", RuleKind::Pointing),
        ("tilt_disc", RuleKind::TiltDisc { angle: 0.17, spin: RuleSpin::Pointing }),
        ("barrier_cone", RuleKind::BarrierCone(barrier)),
        ("barrier_two_cones", two_cones),
        ("barrier_spin", RuleKind::BarrierSpin(barrier)),
    ] {
        let rule = OrientationRule::new(kind).expect("rule");
        group.bench_function(format!("orientations/{name}"), |b| {
            b.iter(|| rule.orientations(black_box(&positions)));
        });
    }
    let rule = OrientationRule::new(RuleKind::BarrierSpin(barrier)).expect("rule");
    let rotations = rule.orientations(&positions).expect("rotations");
    let oriented = path.with_orientations(&rotations).expect("path");
    let (s, poses, settings) = (oriented.s(), oriented.poses(), SpeedSettings::of(&arm));
    let found = max_speed_of_poses(&arm, s, poses, None, &settings).expect("speed");
    let q = found.q;
    group.finish();
    let mut group = criterion.benchmark_group("timing");
    group.throughput(Throughput::Elements(positions.len() as u64));
    group.bench_function("max_speed/puma560", |b| {
        b.iter(|| max_speed(&arm, black_box(s), &q, &settings));
    });
    group.bench_function("max_speed_of_poses/puma560", |b| {
        b.iter(|| max_speed_of_poses(&arm, black_box(s), poses, Some(&q[..6]), &settings));
    });
    group.bench_function("max_speed_all_branches/puma560", |b| {
        b.iter(|| max_speed_of_poses(&arm, black_box(s), poses, None, &settings));
    });
    group.sample_size(20);
    group.bench_function("fastest_profile/puma560", |b| {
        b.iter(|| fastest_profile(&arm, black_box(s), &q, &settings, 0.0, 0.0));
    });
    group.finish();
}

criterion_group!(benches, dynamics, planning);
criterion_main!(benches);
