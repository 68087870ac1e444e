use redundancy_core::chain::catalog;
use redundancy_core::timing::{RetimeSettings, retime};
fn main() {
    let arm = catalog::load("panda").unwrap();
    for seed in 0..3 {
        let seed = f64::from(seed);
        let q: Vec<f64> = (0..400).flat_map(|k| { let u = k as f64 / 399.0; (0..7).map(move |j| { let j = j as f64; 0.8 * (2.0 * u + seed + 1.3 * j).sin() + 0.3 * (5.0 * u - seed * j).cos() - if j == 3.0 { 1.5 } else { 0.0 } }) }).collect();
        let settings = RetimeSettings::of(&arm);
        let factor = 5.0;
        let jerk = settings.acceleration_limits.iter().map(|a| factor * a).collect();
        let settings = RetimeSettings { jerk_limits: Some(jerk), ..settings.clone() };
        let before = std::time::Instant::now();
        let motion = retime(&arm, &q, &settings).unwrap();
        println!("third {factor}: {:?} {} s stretched {}", before.elapsed(), motion.trajectory.t().last().unwrap(), motion.stretched);
    }
}
