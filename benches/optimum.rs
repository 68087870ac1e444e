//! Kinds of optima, self-motion curves, critical points over a pose, paths. `cargo bench --bench optimum`.

#![allow(clippy::unwrap_used)]

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use redundancy_core::chain::{Chain, catalog};
use redundancy_core::criterion::{self as goal, JointRange, Manipulability, Posture};
use redundancy_core::kinematics::Task;
use redundancy_core::nalgebra::Vector3;
use redundancy_core::optimum::{
    Classifier, FollowSettings, OptimaSettings, SingularitySettings, algorithmic_singularities,
    constrained_optima, follow_optimum, singularity_curves,
};
use redundancy_core::path::Circle;
use redundancy_core::solutions::{TraceSettings, trace_self_motion};

fn configurations(chain: &Chain, count: usize) -> Vec<Vec<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let one = |rng: &mut ChaCha8Rng| {
        let ranges = chain.lower().iter().zip(chain.upper());
        ranges.map(|(lo, hi)| rng.random_range(lo.max(-3.0)..=hi.min(3.0))).collect()
    };
    (0..count).map(|_| one(&mut rng)).collect()
}

fn classify(c: &mut Criterion) {
    let arm = catalog::load("iiwa14").unwrap();
    let q = configurations(&arm, 64);
    let (range, manipulability) = (JointRange::new(&arm), Manipulability::new(&arm, Task::POSE));
    let criteria: [(&str, &dyn goal::Criterion); 2] =
        [("joint_range", &range), ("manipulability", &manipulability)];
    for (name, h) in criteria {
        let mut classifier = Classifier::new(&arm, h, Task::POSE).unwrap();
        let mut i = 0;
        c.bench_function(&format!("optimum/classify/iiwa14/{name}"), |b| {
            b.iter(|| {
                i = (i + 1) % q.len();
                classifier.classify(black_box(&q[i])).unwrap()
            })
        });
    }
}

fn trace(c: &mut Criterion) {
    for name in ["iiwa14", "panda"] {
        let arm = catalog::load(name).unwrap();
        let q = [0.3, 0.7, -0.4, -1.4, 0.2, 0.9, 0.5];
        let settings = TraceSettings { step: 0.01, ..TraceSettings::default() };
        let curve = trace_self_motion(&arm, &q, Task::POSE, &settings).unwrap();
        let id =
            format!("optimum/trace_self_motion/{name}/{}_rows_length_{:.2}", curve.rows(), curve.length());
        c.bench_function(&id, |b| {
            b.iter(|| trace_self_motion(&arm, black_box(&q), Task::POSE, &settings).unwrap())
        });
    }
}

fn optima(c: &mut Criterion) {
    let arm = catalog::load("iiwa14").unwrap();
    let h = JointRange::new(&arm);
    let poses: Vec<_> = configurations(&arm, 16).iter().map(|q| arm.forward(q).unwrap()).collect();
    let mut i = 0;
    c.bench_function("optimum/constrained_optima/iiwa14/joint_range", |b| {
        b.iter(|| {
            i = (i + 1) % poses.len();
            constrained_optima(&arm, black_box(&poses[i]), &h, Task::POSE, &OptimaSettings::default())
                .unwrap()
        })
    });
}

fn planar(c: &mut Criterion) {
    let arm = catalog::load("planar3r").unwrap();
    let h = Manipulability::new(&arm, Task::PLANAR);
    let circle =
        Circle::new(Vector3::new(3.5, 0.0, 0.0), 1.5, std::f64::consts::PI, 1.0, Vector3::z()).unwrap();
    let path = circle.path(101).unwrap();
    let p1 = [-87.1742f64, 111.7847, 77.5352].map(f64::to_radians);
    c.bench_function("optimum/follow_optimum/planar3r/101_points", |b| {
        b.iter(|| {
            follow_optimum(&arm, &path, black_box(&p1), &h, Task::PLANAR, &FollowSettings::default()).unwrap()
        })
    });
    c.bench_function("optimum/algorithmic_singularities/planar3r", |b| {
        b.iter(|| {
            algorithmic_singularities(&arm, black_box(&h), Task::PLANAR, &SingularitySettings::default())
                .unwrap()
        })
    });
    let posture = Posture::new(&[0.3, 0.5, 0.7]).unwrap();
    let settings = SingularitySettings { starts: 300, ..SingularitySettings::default() };
    c.bench_function("optimum/singularity_curves/planar3r/8_curves", |b| {
        b.iter(|| singularity_curves(&arm, black_box(&posture), Task::PLANAR, &settings, 0.05).unwrap())
    });
}

criterion_group!(benches, classify, trace, optima, planar);
criterion_main!(benches);
