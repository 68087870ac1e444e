//! The room `rotation`: best orientations and volumes. Ids are `rotation/function/problem`.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};
use redundancy_core::Status;
use redundancy_core::nalgebra::{Quaternion, UnitQuaternion, Vector3};
use redundancy_core::rotation::{
    Barrier, Cone, DirectionCones, OrientationMethod, OrientationOptimizer, OrientationSettings,
    QuaternionVolume, Spin, from_wxyz, from_zyz, optimal_directions,
};

type Failure = Box<dyn std::error::Error>;

struct Random(ChaCha8Rng);

impl Random {
    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn rotation(&mut self) -> UnitQuaternion<f64> {
        let mut v = || self.uniform(-1.0, 1.0);
        UnitQuaternion::new_normalize(Quaternion::new(v(), v(), v(), v()))
    }
}

/// Random problems: variant 1 (two cones), 2 (x cone), 3 (spin).
fn problems(variant: usize, count: usize) -> Result<Vec<Vec<Barrier>>, Failure> {
    let mut random = Random(ChaCha8Rng::seed_from_u64(7));
    let mut list = vec![];
    while list.len() < count {
        let beta = random.uniform(5.0, 45.0).to_radians();
        let alpha = random.uniform(20.0, 80.0).to_radians();
        let omega = random.uniform(0.0, 0.9) * (alpha + beta);
        let azimuth = random.uniform(-3.0, 3.0);
        let c = [omega.sin() * azimuth.cos(), omega.sin() * azimuth.sin(), -omega.cos()];
        let psi = random.uniform(-3.0, 3.0);
        let frame = from_wxyz([0.0, 0.0, 1.0, 0.0])? * from_zyz([psi, 0.0, 0.0]);
        let gamma = random.uniform(30.0, 80.0).to_radians();
        let mut weight = || 10_f64.powf(random.uniform(-1.0, 1.0));
        let mut barriers =
            vec![Barrier::new(weight(), Cone::downward(beta)?)?, Barrier::new(weight(), Cone::z(c, alpha)?)?];
        if variant == 2 {
            let b = frame * Vector3::x();
            barriers.push(Barrier::new(weight(), Cone::x([b.x, b.y, b.z], gamma)?)?);
        } else if variant == 3 {
            barriers.push(Barrier::new(weight(), Spin::new(frame, gamma, [0.0, 0.0, 1.0])?)?);
        }
        let probe = OrientationOptimizer::new(barriers.clone(), OrientationSettings::default())?;
        if probe.solve(None).status == Status::Converged {
            list.push(barriers);
        }
    }
    Ok(list)
}

fn optimizers(variant: usize, settings: OrientationSettings) -> Result<Vec<OrientationOptimizer>, Failure> {
    problems(variant, 64)?.into_iter().map(|b| Ok(OrientationOptimizer::new(b, settings)?)).collect()
}

fn solve(c: &mut Criterion) -> Result<(), Failure> {
    let mut group = c.benchmark_group("rotation");
    let cold = from_wxyz([0.0, 0.0, 1.0, 0.0])?;
    let name = |variant: usize| ["", "two_cones", "two_cones_x_cone", "two_cones_spin"][variant];
    for (method, variants) in
        [(OrientationMethod::ClosedForm, &[1, 3][..]), (OrientationMethod::Newton, &[1, 2, 3][..])]
    {
        for &variant in variants {
            let list = optimizers(variant, OrientationSettings { method, ..OrientationSettings::default() })?;
            let mut next = list.iter().cycle();
            group.bench_function(BenchmarkId::new(method.as_str(), name(variant)), |b| {
                b.iter(|| next.next().map(|o| black_box(o).solve(Some(&cold))));
            });
        }
    }
    // From the problem's data to the answer, the optimizer made on the way.
    let list = problems(1, 64)?;
    let mut next = list.iter().cycle();
    group.bench_function(BenchmarkId::new("new_and_closed_form", name(1)), |b| {
        b.iter(|| {
            next.next().map(|barriers| {
                OrientationOptimizer::new(black_box(barriers).clone(), OrientationSettings::default())
                    .map(|o| o.solve(None))
            })
        });
    });
    // 1 000 fixed steps: the time per element is that of one iteration, as in table I of the paper.
    let steps = 1000;
    let settings = OrientationSettings {
        method: OrientationMethod::Gradient,
        backtracking: false,
        step: Some(1e-6),
        tolerance: Some(1e-300),
        max_iterations: Some(steps),
    };
    group.throughput(Throughput::Elements(u64::from(steps)));
    for variant in 1..=3 {
        let list: Vec<_> = optimizers(variant, settings)?.into_iter().map(|o| (o.solve(None).q, o)).collect();
        let mut next = list.iter().map(|(start, o)| (o, start)).cycle();
        group.bench_function(BenchmarkId::new("gradient_iteration", name(variant)), |b| {
            // From an orientation inside, so that no search is timed.
            b.iter(|| next.next().map(|(o, start)| black_box(o).solve(Some(start))));
        });
    }
    group.finish();
    Ok(())
}

fn batch(c: &mut Criterion) -> Result<(), Failure> {
    let mut group = c.benchmark_group("rotation");
    let mut random = Random(ChaCha8Rng::seed_from_u64(8));
    let n = 100_000;
    let mut near = |z: f64| [random.uniform(-0.4, 0.4), random.uniform(-0.4, 0.4), z];
    let normals: Vec<_> = (0..n).map(|_| near(-1.0)).collect();
    let directions: Vec<_> = (0..n).map(|_| near(-1.0)).collect();
    let cones = DirectionCones { beta: 0.35, alpha: 1.0, k_err: 1.0, k_tcp: 1.0 };
    let (mut axes, mut status) = (vec![[0.0; 3]; n], vec![Status::Cancelled; n]);
    group.throughput(Throughput::Elements(n as u64));
    group.bench_function(BenchmarkId::new("optimal_directions", "100000_rows"), |b| {
        b.iter(|| optimal_directions(&normals, &directions, &cones, &mut axes, &mut status));
    });
    group.finish();
    Ok(())
}

fn volumes(c: &mut Criterion) -> Result<(), Failure> {
    let mut group = c.benchmark_group("rotation");
    let mut random = Random(ChaCha8Rng::seed_from_u64(9));
    let list: Vec<_> = (0..512).map(|_| random.rotation()).collect();
    let pi = std::f64::consts::PI;
    for (name, volume) in [
        ("zyz", QuaternionVolume::zyz([-1.0, 1.0], [0.0, 0.5], [-pi, pi])?),
        ("cone", QuaternionVolume::cone([0.0, 0.0, 1.0], 0.5)?),
    ] {
        let mut next = list.iter().cycle();
        group.bench_function(BenchmarkId::new("volume_margin", name), |b| {
            b.iter(|| next.next().map(|q| volume.margin(black_box(q))));
        });
        let mut next = list.iter().cycle();
        group.bench_function(BenchmarkId::new("volume_nearest", name), |b| {
            b.iter(|| next.next().map(|q| volume.nearest(black_box(q))));
        });
    }
    group.finish();
    Ok(())
}

fn all(c: &mut Criterion) {
    for outcome in [solve(c), batch(c), volumes(c)] {
        if let Err(error) = outcome {
            c.bench_function(&format!("rotation/failed/{error}"), |b| b.iter(|| ()));
        }
    }
}

criterion_group!(benches, all);
criterion_main!(benches);
