//! Velocity schemes. `cargo bench --bench velocity`; ids `velocity/scheme/robot`.

use std::hint::black_box;
use std::sync::Arc;

use criterion::{Criterion, criterion_group, criterion_main};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use redundancy_core::chain::{Chain, catalog};
use redundancy_core::criterion::JointRange;
use redundancy_core::kinematics::Task;
use redundancy_core::velocity::{
    Damping, ExtendedJacobian, Gain, ProjectedGradient, ReducedGradient, Resolver, SaturatedNullspace,
    StepInput, sigma_min,
};

/// A way of small steps through configurations whose least singular value is in the given range.
fn ways(chain: &Chain, low: f64, high: f64) -> Vec<Vec<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let mut out = Vec::new();
    while out.len() < 512 {
        let q: Vec<f64> = chain
            .joints()
            .iter()
            .map(|j| {
                rng.random_range(j.limits.lower.max(-3.0)..j.limits.upper.min(3.0).max(j.limits.lower + 0.1))
            })
            .collect();
        if sigma_min(chain, &Task::POSE, &q).is_ok_and(|s| s >= low && s < high) {
            // The same place some steps long, as a control loop sees it.
            for k in 0..16 {
                out.push(q.iter().map(|q| q + 1e-4 * f64::from(k)).collect());
            }
        }
    }
    out
}

fn steps(c: &mut Criterion) {
    for name in ["iiwa14", "dexter"] {
        let Ok(chain) = catalog::load(name) else { continue };
        let h = Arc::new(JointRange::new(&chain));
        let (gain, damping) = (Gain::Constant(1.0), Some(Damping::default()));
        let mut schemes: Vec<(&str, Box<dyn Resolver>, f64, f64)> = Vec::new();
        let mut add = |id, scheme: Option<Box<dyn Resolver>>, low, high| {
            schemes.extend(scheme.map(|scheme| (id, scheme, low, high)));
        };
        let projected = ProjectedGradient::new(&chain, Some(h.clone()), gain, Task::POSE, damping).ok();
        let reduced = ReducedGradient::new(&chain, Some(h.clone()), gain, Task::POSE, damping, None).ok();
        let extended = ExtendedJacobian::new(&chain, h.clone(), 10.0, Task::POSE, damping).ok();
        let saturated = SaturatedNullspace::new(&chain, Some(h.clone()), gain, Task::POSE, None).ok();
        fn boxed<T: Resolver + 'static>(x: &Option<T>) -> Option<Box<dyn Resolver>> {
            x.as_ref().map(Resolver::boxed)
        }
        add("projected_gradient", boxed(&projected), 0.1, 9.0);
        add("reduced_gradient", boxed(&reduced), 0.1, 9.0);
        add("projected_gradient_damped", boxed(&projected), 0.0, 0.04);
        add("reduced_gradient_damped", boxed(&reduced), 0.0, 0.04);
        add("extended_jacobian", boxed(&extended), 0.1, 9.0);
        add("saturated_nullspace", boxed(&saturated), 0.1, 9.0);
        for (id, mut scheme, low, high) in schemes {
            let q = ways(&chain, low, high);
            let mut rows = q.iter().cycle();
            let mut qd = vec![0.0; chain.dof()];
            // Slow enough for no limit, and so fast that limits cut in.
            for (speed, suffix) in [(0.05, ""), (0.6, "_at_limits")] {
                if !suffix.is_empty() && id != "saturated_nullspace" {
                    continue;
                }
                let velocity = [speed, -0.5 * speed, 0.3 * speed, speed, 0.2 * speed, -speed];
                c.bench_function(&format!("velocity/{id}{suffix}/{name}"), |b| {
                    b.iter(|| {
                        let q = rows.next().map_or(&[][..], Vec::as_slice);
                        let input = StepInput {
                            q: black_box(q),
                            velocity: &velocity,
                            dt: Some(0.01),
                            qd: None,
                            wish: None,
                        };
                        black_box(scheme.step(&input, &mut qd).is_ok())
                    });
                });
            }
        }
    }
}

criterion_group!(benches, steps);
criterion_main!(benches);
