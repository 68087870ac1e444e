//! Times along a joint path: limits hold between the rows, durations.

use redundancy_core::chain::catalog;
use redundancy_core::timing::{RetimeSettings, retime};

fn smooth(rows: usize, seed: f64) -> Vec<f64> {
    (0..rows)
        .flat_map(|k| {
            let u = k as f64 / (rows - 1) as f64;
            (0..7).map(move |j| {
                let j = j as f64;
                0.8 * (2.0 * u + seed + 1.3 * j).sin() + 0.3 * (5.0 * u - seed * j).cos()
                    - if j == 3.0 { 1.5 } else { 0.0 }
            })
        })
        .collect()
}

#[test]
fn limits_hold_and_rows_stay() {
    let arm = catalog::load("panda").unwrap();
    for seed in 0..3 {
        let q = smooth(400, f64::from(seed));
        let settings = RetimeSettings::of(&arm);
        let before = std::time::Instant::now();
        let motion = retime(&arm, &q, &settings).unwrap();
        let took = before.elapsed();
        println!(
            "second: {:?} {} s stretched {}",
            took,
            motion.trajectory.t().last().unwrap(),
            motion.stretched
        );
        assert_eq!(motion.path_rows, (0..400).collect::<Vec<_>>());
        for factor in [5.0, 100.0] {
            let jerk = settings.acceleration_limits.iter().map(|a| factor * a).collect();
            let settings = RetimeSettings { jerk_limits: Some(jerk), ..settings.clone() };
            let before = std::time::Instant::now();
            let motion = retime(&arm, &q, &settings).unwrap();
            let took = before.elapsed();
            println!(
                "third {factor}: {:?} {} s stretched {}",
                took,
                motion.trajectory.t().last().unwrap(),
                motion.stretched
            );
        }
    }
}
