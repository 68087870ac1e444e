#![allow(clippy::all, clippy::expect_used, clippy::unwrap_used, clippy::print_stdout, missing_docs)]
use std::time::Instant;
#[path = "../../../benches/planning.rs"]
#[allow(dead_code)]
mod bench;
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let points: usize = args[1].parse().unwrap();
    let swivels: usize = args[2].parse().unwrap();
    let with: bool = args[3] == "1";
    let reps: usize = args[4].parse().unwrap();
    let mut times = vec![];
    for _ in 0..reps {
        let t = Instant::now();
        let plan = bench::one(points, swivels, with);
        times.push(t.elapsed().as_secs_f64());
        if times.len() == reps {
            println!(
                "{} {} least {:?}",
                plan.status,
                plan.reason,
                plan.clearance.iter().copied().fold(f64::INFINITY, f64::min)
            );
        }
    }
    times.sort_by(f64::total_cmp);
    println!("median {:.1} ms min {:.1}", 1e3 * times[reps / 2], 1e3 * times[0]);
}
