//! The largest margin from the joint limits against scans and bisection, the measures against counting, and the batch.

use redundancy_core::chain::{Chain, catalog};
use redundancy_core::joint_space::margin;
use redundancy_core::kinematics::{SpinFreedom, ToolFreedom};
use redundancy_core::parallel::Pool;
use redundancy_core::pose_to_row_major;
use redundancy_core::solutions::{
    Capability, CapabilitySettings, Measures, Metric, SolutionsSettings, solutions,
};

use rand::Rng;

use crate::support::{amount, rng};

fn poses(chain: &Chain, count: usize, seed: u64) -> Vec<f64> {
    let mut rng = rng(seed);
    (0..count)
        .flat_map(|_| {
            let q: Vec<f64> = (0..chain.dof())
                .map(|i| rng.random_range(1.2 * chain.lower()[i]..1.2 * chain.upper()[i]))
                .collect();
            pose_to_row_major(&chain.forward(&q).unwrap())
        })
        .collect()
}

fn measured(chain: &Chain, poses: &[f64], freedom: ToolFreedom, metrics: &[Metric]) -> Vec<Measures> {
    let settings = CapabilitySettings { freedom, metrics: metrics.to_vec(), ..Default::default() };
    Capability::new(chain, None, settings).unwrap().measure_batch(poses).unwrap()
}

#[test]
fn margins_are_not_below_a_scan_and_proven() {
    let (count, samples) = (amount(6, 500), amount(2_000, 10_000));
    for name in ["iiwa14", "pa10", "panda"] {
        let chain = catalog::load(name).unwrap();
        let poses = poses(&chain, count, 7);
        let found = measured(&chain, &poses, ToolFreedom::NONE, &[Metric::Margin, Metric::Proven]);
        let mut proven = 0;
        for (pose, found) in poses.chunks_exact(16).zip(&found) {
            let pose = redundancy_core::pose_from_row_major(pose).unwrap();
            let set = solutions(&chain, &pose, &SolutionsSettings::default()).unwrap();
            let mut most = f64::NEG_INFINITY;
            let mut q = vec![0.0; chain.dof()];
            for piece in 0..set.pieces() {
                for k in 0..samples {
                    let u = std::f64::consts::TAU * k as f64 / samples as f64 - std::f64::consts::PI;
                    set.q(piece, u, &mut q).unwrap();
                    let own = (0..q.len()).map(|i| margin(q[i], chain.lower()[i], chain.upper()[i]));
                    most = most.max(own.fold(f64::INFINITY, f64::min));
                }
            }
            assert!(found.margin >= most - 1e-12, "{name}: {} below {most}", found.margin);
            proven += usize::from(found.proven);
        }
        assert_eq!(proven, count, "{name}: {proven} of {count} proven");
    }
}

/// Limits that are moved outwards, so that intervals with margins exist where the arm misses its limits too.
fn wider(chain: &Chain, by: f64) -> Chain {
    let limits: Vec<_> = chain
        .joints()
        .iter()
        .map(|joint| {
            let mut limits = joint.limits;
            (limits.lower, limits.upper) = (limits.lower - by, limits.upper + by);
            limits
        })
        .collect();
    chain.with_limits(&limits).unwrap()
}

#[test]
fn a_margin_is_where_the_intervals_end() {
    for name in ["iiwa14", "pa10", "panda"] {
        let chain = catalog::load(name).unwrap();
        let poses = poses(&chain, amount(40, 500), 11);
        let found = measured(&chain, &poses, ToolFreedom::NONE, &[Metric::Margin, Metric::Proven]);
        let (mut inside, mut outside) = (0, 0);
        for (pose, found) in poses.chunks_exact(16).zip(&found) {
            // Joints whose wider limits hold a whole turn would have none.
            let by = if found.margin > 0.0 { 0.0 } else { 0.2 };
            if found.margin < -by {
                continue;
            }
            let chain = wider(&chain, by);
            let pose = redundancy_core::pose_from_row_major(pose).unwrap();
            let set = solutions(&chain, &pose, &SolutionsSettings::default()).unwrap();
            let holds =
                |margin: f64| (0..set.pieces()).any(|p| !set.intervals(p, margin).unwrap().is_empty());
            let (mut lo, mut hi) = (0.0, 4.0);
            while hi - lo > 1e-11 {
                let middle = 0.5 * (lo + hi);
                if holds(middle) { lo = middle } else { hi = middle }
            }
            let bisected = lo - by;
            assert!((found.margin - bisected).abs() < 1e-9, "{name}: {} against {bisected}", found.margin);
            assert!(found.proven, "{name}: {}", found.margin);
            (inside, outside) = if by == 0.0 { (inside + 1, outside) } else { (inside, outside + 1) };
        }
        assert!(inside >= 10 && outside >= 1, "{name}: {inside} within limits, {outside} not");
    }
}

#[test]
fn measures_are_what_counting_finds() {
    const SAMPLES: usize = 4_000;
    for name in ["iiwa14", "panda"] {
        let chain = catalog::load(name).unwrap();
        let poses = poses(&chain, 12, 3);
        let found = measured(&chain, &poses, ToolFreedom::NONE, &[Metric::SwivelMeasure, Metric::Reachable]);
        for (pose, found) in poses.chunks_exact(16).zip(&found) {
            let pose = redundancy_core::pose_from_row_major(pose).unwrap();
            let counted = match name {
                "iiwa14" => {
                    let arm = redundancy_core::solutions::SrsArm::new(&chain).unwrap();
                    count(SAMPLES, |s| {
                        let swivel = redundancy_core::solutions::Swivel::Angle(s);
                        !arm.solve(&pose, swivel, true).unwrap().is_empty()
                    })
                }
                _ => {
                    let arm = redundancy_core::solutions::PandaClassArm::new(&chain).unwrap();
                    count(SAMPLES, |q7| !arm.solve(&pose, q7, true).unwrap().is_empty())
                }
            };
            let step = std::f64::consts::TAU / SAMPLES as f64;
            assert!((found.swivel_measure - counted).abs() < 10.0 * step, "{name}: {found:?} {counted}");
            assert!(found.reachable || counted == 0.0);
        }
    }
}

/// The measure of the angles at which `holds`.
fn count(samples: usize, holds: impl Fn(f64) -> bool) -> f64 {
    let step = std::f64::consts::TAU / samples as f64;
    step * (0..samples).filter(|k| holds(step * (*k as f64 + 0.5) - std::f64::consts::PI)).count() as f64
}

#[test]
fn threads_do_not_change_a_bit() {
    let chain = catalog::load("panda").unwrap();
    let poses = poses(&chain, 100, 5);
    let asked = [Metric::Margin, Metric::SwivelMeasure, Metric::Manipulability];
    let run = |threads| {
        let pool = Pool::new(Some(threads)).unwrap();
        pool.install(|| measured(&chain, &poses, ToolFreedom::NONE, &asked))
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn freedom_never_takes_margin_and_is_not_proven() {
    let chain = catalog::load("puma560").unwrap();
    let poses = poses(&chain, 4, 9);
    let asked = [Metric::Margin, Metric::Proven, Metric::SpinShare, Metric::Reachable];
    let fixed = measured(&chain, &poses, ToolFreedom::NONE, &asked);
    let free = ToolFreedom::new(0.3, SpinFreedom::Free, [0.0, 0.0, 1.0]).unwrap();
    let spun = measured(&chain, &poses, free, &asked);
    for (fixed, spun) in fixed.iter().zip(&spun) {
        assert!(spun.margin >= fixed.margin && !spun.proven);
        assert!((0.0..=1.0).contains(&spun.spin_share));
        assert!(!fixed.reachable || spun.spin_share > 0.0);
    }
    assert!(fixed.iter().any(|fixed| fixed.proven));
}

#[test]
fn out_of_reach_and_outside_of_limits_are_told_apart() {
    let chain = catalog::load("iiwa14").unwrap();
    let mut far = chain.forward(&[0.0; 7]).unwrap();
    far.translation.x += 3.0;
    let beyond = chain.forward(&[0.0, 0.3, 0.0, 2.6, 0.0, 0.4, 0.0]).unwrap();
    let poses = [pose_to_row_major(&far), pose_to_row_major(&beyond)].concat();
    let asked = [Metric::Margin, Metric::Reachable, Metric::SwivelMeasure];
    let found = measured(&chain, &poses, ToolFreedom::NONE, &asked);
    assert_eq!((found[0].margin, found[0].reachable), (f64::NEG_INFINITY, false));
    // Joint 4 is 2.6 over this pose, whatever the swivel.
    let miss = chain.upper()[3] - 2.6;
    assert!((found[1].margin - miss).abs() < 1e-9 && !found[1].reachable);
    assert!(Metric::from_name("maniplability").is_err());
}
