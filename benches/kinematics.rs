//! Forward kinematics and Jacobian. `cargo bench --bench kinematics`; ids `room/function/robot`.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use redundancy_core::chain::{Chain, catalog};
use redundancy_core::kinematics::Scratch;

/// A thousand configurations, so that no branch or cache learns one of them.
fn configurations(chain: &Chain) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    (0..1000 * chain.dof()).map(|_| rng.random_range(-3.0..3.0)).collect()
}

fn single(c: &mut Criterion) {
    for name in ["planar3r", "puma560", "pa10", "iiwa14", "panda", "dexter"] {
        let Ok(chain) = catalog::load(name) else { continue };
        let q = configurations(&chain);
        let mut scratch = Scratch::new(&chain);
        let mut rows = q.chunks_exact(chain.dof()).cycle();
        let mut next = || rows.next().unwrap_or_default();
        c.bench_function(&format!("kinematics/forward/{name}"), |b| {
            b.iter(|| chain.forward(black_box(next())));
        });
        c.bench_function(&format!("kinematics/kinematics/{name}"), |b| {
            b.iter(|| {
                let kinematics = chain.kinematics(black_box(next()), &mut scratch);
                black_box(kinematics.is_ok())
            });
        });
    }
}

fn batch(c: &mut Criterion) {
    let Ok(chain) = catalog::load("iiwa14") else { return };
    let q = configurations(&chain).repeat(100);
    let n = q.len() / chain.dof();
    let (mut poses, mut jacobians) = (vec![0.0; n * 16], vec![0.0; n * 6 * chain.dof()]);
    let mut group = c.benchmark_group("kinematics/kinematics_batch");
    group.throughput(Throughput::Elements(n as u64)).sample_size(20);
    group.bench_function(BenchmarkId::from_parameter("iiwa14"), |b| {
        b.iter(|| chain.kinematics_batch(black_box(&q), &mut poses, &mut jacobians));
    });
    group.finish();
}

criterion_group!(benches, single, batch);
criterion_main!(benches);
