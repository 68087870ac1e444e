//! From poses to configurations.
#![allow(clippy::expect_used)] // a bench may stop

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use rand::{Rng, SeedableRng};
use redundancy_core::chain::{Chain, catalog};
use redundancy_core::solutions::SphericalWristArm;
use redundancy_core::{Pose, pose_to_row_major};

const POSES: usize = 1_024;

fn poses(chain: &Chain, n: usize) -> Vec<Pose> {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
    let range = |lo: &f64, hi: &f64| lo.max(-3.1)..hi.min(3.1);
    let limits: Vec<_> = chain.lower().iter().zip(chain.upper()).map(|(lo, hi)| range(lo, hi)).collect();
    (0..n)
        .map(|_| {
            let q: Vec<f64> = limits.iter().map(|range| rng.random_range(range.clone())).collect();
            chain.forward(&q).expect("valid q")
        })
        .collect()
}

fn spherical_wrist(c: &mut Criterion) {
    let chain = catalog::load("puma560").expect("in the catalogue");
    let arm = SphericalWristArm::new(&chain).expect("spherical wrist");
    let poses = poses(&chain, POSES);
    let mut k = 0;
    let mut next = || {
        k = (k + 1) % POSES;
        &poses[k]
    };
    let mut out = [[0.0; 6]; 8];
    for (id, limits) in [("spherical_wrist", false), ("spherical_wrist_with_limits", true)] {
        c.bench_function(&format!("ik/{id}/puma560"), |b| {
            b.iter(|| arm.solve_into(black_box(next()), limits, &mut out));
        });
    }
    c.bench_function("ik/spherical_wrist_nearest/puma560", |b| {
        b.iter(|| arm.nearest(black_box(next()), &[0.1, 0.4, 0.2, 1.0, -0.3, 0.8]).expect("valid input"));
    });
    let rows: Vec<f64> = poses.iter().flat_map(pose_to_row_major).collect();
    let (mut q, mut valid) = (vec![0.0; POSES * 48], vec![false; POSES * 8]);
    let mut group = c.benchmark_group("ik");
    group.throughput(Throughput::Elements(POSES as u64));
    group.bench_function("spherical_wrist_batch/puma560", |b| {
        b.iter(|| arm.solve_batch(&rows, true, &mut q, &mut valid).expect("valid input"));
    });
    group.finish();
}

criterion_group!(benches, spherical_wrist);
criterion_main!(benches);
