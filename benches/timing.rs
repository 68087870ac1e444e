//! Times for joint paths, and the linter. `cargo bench --bench timing`; ids `timing/function/robot/rows`.
#![allow(clippy::expect_used)] // a bench may stop

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use redundancy_core::chain::{Chain, catalog};
use redundancy_core::timing::{CheckAgainst, CheckSettings, RetimeSettings, check, retime};

/// A random smooth joint path within the limits.
fn rows(chain: &Chain, count: usize) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let waves: Vec<[f64; 4]> = (0..chain.dof())
        .map(|_| [0.1..0.6, 1.0..4.0, -3.0..3.0, 2.0..7.0].map(|range| rng.random_range(range)))
        .collect();
    let at = |u: f64, j: usize| {
        let (lower, upper) = (chain.lower()[j].max(-3.0), chain.upper()[j].min(3.0));
        let [size, frequency, phase, other] = waves[j];
        let wave = size * (frequency * u + phase).sin() + 0.2 * (other * u).cos();
        0.5 * (lower + upper) + 0.45 * (upper - lower) * wave
    };
    (0..count)
        .flat_map(|k| (0..chain.dof()).map(move |j| (k, j)))
        .map(|(k, j)| at(k as f64 / count as f64, j))
        .collect()
}

fn timing(criterion: &mut Criterion) {
    let panda = catalog::load("panda").expect("in the catalogue");
    let second = RetimeSettings::of(&panda);
    let jerk = second.acceleration_limits.iter().map(|a| 5.0 * a).collect();
    let third = RetimeSettings { jerk_limits: Some(jerk), ..second.clone() };
    let heavy = catalog::load("iiwa14").expect("in the catalogue");
    let torque = RetimeSettings {
        acceleration_limits: vec![10.0; 7],
        torque_limits: Some(heavy.joints().iter().map(|joint| joint.limits.effort).collect()),
        ..RetimeSettings::of(&heavy)
    };
    let mut group = criterion.benchmark_group("timing");
    group.sample_size(20);
    for count in [1_000, 4_000] {
        group.throughput(Throughput::Elements(count as u64));
        let kinds = [
            ("retime_second/panda", &panda, &second),
            ("retime_third/panda", &panda, &third),
            ("retime_torque/iiwa14", &heavy, &torque),
        ];
        for (name, chain, settings) in kinds {
            let q = rows(chain, count);
            group.bench_with_input(BenchmarkId::new(name, count), &q, |b, q| {
                b.iter(|| retime(chain, black_box(q), settings).expect("a motion"));
            });
        }
        let motion = retime(&panda, &rows(&panda, count), &third).expect("a motion").trajectory;
        let settings = CheckSettings::of(&panda);
        group.bench_with_input(BenchmarkId::new("check/panda", count), &motion, |b, motion| {
            b.iter(|| {
                check(&panda, black_box(motion), &settings, CheckAgainst::default()).expect("a report")
            });
        });
    }
    group.finish();
}

criterion_group!(benches, timing);
criterion_main!(benches);
