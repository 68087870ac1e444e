//! The closed form of S-R-S arms: branches at a swivel, the self-motion object, exact feasible arcs, batches.
#![allow(clippy::expect_used)] // a bench may stop

use std::hint::black_box;

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use rand::{Rng, SeedableRng};
use redundancy_core::chain::{Chain, catalog};
use redundancy_core::criterion::JointRange;
use redundancy_core::solutions::SrsArm;
use redundancy_core::{Pose, pose_to_row_major};

const POSES: usize = 1_024;

fn poses(chain: &Chain, n: usize) -> Vec<Pose> {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
    (0..n)
        .map(|_| {
            let q: Vec<f64> = chain
                .lower()
                .iter()
                .zip(chain.upper())
                .map(|(lo, hi)| rng.random_range(lo.max(-3.1)..hi.min(3.1)))
                .collect();
            chain.forward(&q).expect("valid q")
        })
        .collect()
}

fn closed_form(c: &mut Criterion) {
    for name in ["pa10", "iiwa14"] {
        let chain = catalog::load(name).expect("in the catalogue");
        let arm = SrsArm::new(&chain).expect("S-R-S");
        let poses = poses(&chain, POSES);
        let mut k = 0;
        let mut next = || {
            k = (k + 1) % POSES;
            &poses[k]
        };
        let mut out = [[0.0; 7]; 8];
        for (id, limits) in [("solve", false), ("solve_with_limits", true)] {
            c.bench_function(&format!("self_motion/{id}/{name}"), |b| {
                b.iter(|| arm.solve_into(black_box(next()), black_box([0.6, 0.8]), limits, &mut out));
            });
        }
        c.bench_function(&format!("self_motion/object/{name}"), |b| {
            b.iter(|| arm.self_motion(black_box(next())).expect("valid pose"));
        });
        c.bench_function(&format!("self_motion/intervals_of_8_branches/{name}"), |b| {
            b.iter_batched(
                || arm.self_motion(next()).expect("valid pose"),
                |motion| {
                    motion.branches().iter().map(|b| b.intervals(0.0).expect("margin").len()).sum::<usize>()
                },
                BatchSize::SmallInput,
            );
        });
        let range = JointRange::new(&chain);
        c.bench_function(&format!("self_motion/best_joint_range/{name}"), |b| {
            b.iter_batched(
                || arm.self_motion(next()).expect("valid pose"),
                |motion| motion.best(&range).expect("same arm"),
                BatchSize::SmallInput,
            );
        });
        c.bench_function(&format!("self_motion/nearest/{name}"), |b| {
            b.iter_batched(
                || arm.self_motion(next()).expect("valid pose"),
                |motion| motion.nearest(&[0.1, 0.4, 0.2, 1.0, -0.3, 0.8, 0.5]).expect("valid q"),
                BatchSize::SmallInput,
            );
        });
    }
}

fn batch(c: &mut Criterion) {
    const N: usize = 20_000;
    let chain = catalog::load("iiwa14").expect("in the catalogue");
    let arm = SrsArm::new(&chain).expect("S-R-S");
    let rows: Vec<f64> = poses(&chain, N).iter().flat_map(pose_to_row_major).collect();
    let swivels: Vec<f64> = (0..N).map(|i| i as f64 * 0.01 % 3.0).collect();
    let (mut q, mut valid) = (vec![0.0; N * 56], vec![false; N * 8]);
    let mut group = c.benchmark_group("self_motion");
    group.throughput(Throughput::Elements(N as u64));
    for (id, limits) in [("solve_batch", false), ("solve_batch_with_limits", true)] {
        group.bench_function(format!("{id}/iiwa14"), |b| {
            b.iter(|| arm.solve_batch(&rows, &swivels, limits, &mut q, &mut valid).expect("valid input"));
        });
    }
    group.finish();
}

criterion_group!(benches, closed_form, batch);
criterion_main!(benches);
