//! Paths: building the curve, evaluating it, timing rows. `cargo bench --bench path`; ids `path/function/what`.
#![allow(clippy::expect_used)] // a bench may stop

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use redundancy_core::nalgebra::{Rotation3, Vector3};
use redundancy_core::path::{Circle, Path, Raster, TimingSettings, times_within_limits};

const POINTS: usize = 1_000;

fn paths() -> [(&'static str, Path); 3] {
    let down = Rotation3::new(Vector3::y() * std::f64::consts::PI);
    let circle = Circle::new(Vector3::new(0.45, 0.0, 0.5), 0.12, 0.0, 1.0, Vector3::z()).expect("circle");
    let circle = circle.path(POINTS).and_then(|path| path.with_orientation(&down)).expect("path");
    let (along, across) = (Vector3::y(), Vector3::x());
    let raster = Raster::new(Vector3::zeros(), 0.6, 0.08, 5, Some(0.06), along, across).expect("raster");
    let raster = raster.path(0.003).and_then(|path| path.with_orientation(&down)).expect("path");
    let spline = Path::new(circle.poses(), None, None).expect("path");
    [("circle", circle), ("raster", raster), ("spline", spline)]
}

fn path(criterion: &mut Criterion) {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut group = criterion.benchmark_group("path");
    for (name, path) in paths() {
        let at: Vec<f64> = (0..POINTS).map(|_| rng.random_range(0.0..path.length())).collect();
        let mut next = at.iter().cycle();
        group.throughput(Throughput::Elements(1));
        group.bench_function(format!("at/{name}"), |b| {
            b.iter(|| next.next().map(|s| path.at(black_box(*s))));
        });
        group.throughput(Throughput::Elements(path.len() as u64));
        group.bench_function(format!("new/{name}"), |b| {
            b.iter(|| Path::new(black_box(path.poses()), Some(path.s()), None).expect("path"));
        });
    }
    let q: Vec<f64> = (0..7 * POINTS).map(|i| (0.001 * i as f64).sin() + 0.1 * (i % 7) as f64).collect();
    group.throughput(Throughput::Elements(POINTS as u64));
    group.bench_function("times_within_limits/7_joints", |b| {
        b.iter(|| times_within_limits(black_box(&q), &[1.0; 7], TimingSettings::default()).expect("times"));
    });
    group.finish();
}

criterion_group!(benches, path);
criterion_main!(benches);
