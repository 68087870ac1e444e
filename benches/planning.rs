//! Whole paths and the swivel flow. `cargo bench --bench planning`; ids `planning/...`.
//!
//! `scene`: 1 000 points x 360 swivels x 8 branches beside five primitives; `raster`: the same raster without them, at the
//! default grid. `points` and `swivels`: the scene again at several sizes, with the throughput in points and in swivels:
//! the cost is linear where that stays the same. `flow_step`: one step of the robust flow beside the five primitives.
#![allow(clippy::expect_used)] // a bench may stop

use std::f64::consts::PI;
use std::hint::black_box;
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use redundancy_core::chain::catalog;
use redundancy_core::nalgebra::{Rotation3, Vector3};
use redundancy_core::path::{Path, Raster};
use redundancy_core::planning::{FlowState, SwivelFlow, SwivelFlowSettings, SwivelPlanSettings, plan_swivel};
use redundancy_core::scene::{Capsule, Cuboid, Scene, Sphere};
use redundancy_core::solutions::SrsArm;
use redundancy_core::{Pose, Watch};

/// Ten strokes along y in +-.3, x from .5 to .68, z = .3, tool down, at 0.2 m/s.
fn raster(points: usize) -> Path {
    let down = Rotation3::new(Vector3::x() * PI);
    let start = Vector3::new(0.5, -0.3, 0.3);
    let raster = Raster::new(start, 0.6, 0.02, 10, None, Vector3::y(), Vector3::x()).expect("raster");
    let fine = raster.path(0.001).and_then(|path| path.with_orientation(&down)).expect("path");
    let step = fine.length() / (points - 1) as f64;
    let poses: Vec<Pose> =
        (0..points).map(|k| fine.at((k as f64 * step).min(fine.length())).expect("pose").pose).collect();
    let t: Vec<f64> = (0..points).map(|k| k as f64 * step / 0.2).collect();
    Path::new(&poses, None, Some(&t)).expect("path")
}

/// Two balls, two posts and a table around the forearm of the raster.
fn primitives() -> Scene {
    let ball = |x, y, z, radius| Sphere { center: Vector3::new(x, y, z), radius };
    let post = |x, y| Capsule { start: Vector3::new(x, y, 0.0), end: Vector3::new(x, y, 0.9), radius: 0.04 };
    let table =
        Cuboid { pose: Pose::translation(0.6, 0.0, -0.05), half_extents: Vector3::new(0.3, 0.5, 0.05) };
    Scene::new(&[
        ball(0.25, 0.45, 0.6, 0.08).into(),
        ball(0.3, -0.1, 0.95, 0.08).into(),
        post(0.35, -0.5).into(),
        post(0.2, 0.6).into(),
        table.into(),
    ])
    .expect("scene")
}

fn plans(criterion: &mut Criterion) {
    let arm = SrsArm::new(&catalog::load("iiwa14").expect("arm")).expect("arm");
    let scene = primitives();
    let settings = |swivels| SwivelPlanSettings { swivels, scene: Some(scene.clone()), ..Default::default() };
    let run = |path: &Path, settings: &SwivelPlanSettings| {
        plan_swivel(black_box(&arm), path, settings, &Watch::default()).expect("plan")
    };
    let mut group = criterion.benchmark_group("planning");
    group.sample_size(10).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(4));
    let path = raster(1_000);
    group.bench_function("scene/1000x360x8", |b| b.iter(|| run(&path, &settings(360))));
    group.bench_function("raster/1000x180x8", |b| b.iter(|| run(&path, &SwivelPlanSettings::default())));
    for points in [500, 1_000, 2_000, 4_000, 8_000] {
        let path = raster(points);
        group.throughput(Throughput::Elements(points as u64));
        let id = BenchmarkId::new("points", points);
        group.bench_function(id, |b| b.iter(|| run(&path, &settings(360))));
    }
    for swivels in [90, 180, 360, 720, 1_440] {
        group.throughput(Throughput::Elements(swivels as u64));
        let id = BenchmarkId::new("swivels", swivels);
        group.bench_function(id, |b| b.iter(|| run(&path, &settings(swivels))));
    }
    group.finish();
}

fn flow(criterion: &mut Criterion) {
    let arm = SrsArm::new(&catalog::load("iiwa14").expect("arm")).expect("arm");
    let path = raster(1_000);
    let flow = SwivelFlow::new(&arm, &primitives(), SwivelFlowSettings::default()).expect("flow");
    let mut s = 0.0;
    let mut poses = path.poses().iter().cycle();
    criterion.bench_function("planning/flow_step", |b| {
        b.iter(|| {
            let pose = poses.next().expect("pose");
            let step = flow.step(black_box(pose), s, 0.5, 0.01, 0.0, &FlowState::default()).expect("step");
            s = step.swivel;
            step
        });
    });
}

criterion_group!(benches, plans, flow);
criterion_main!(benches);
