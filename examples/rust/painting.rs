//! The spray gun of the papers: constant orientation, the best rule, and a plan.
//!
//!     cargo run --release --example painting -- [a|b] [seconds] [off|on: joint limits] [margin]

#![allow(clippy::print_stdout)] // an example may talk

use redundancy_core::chain::catalog;
use redundancy_core::path::Path;
use redundancy_core::planning::{OrientationPlanSettings, plan_orientation};
use redundancy_core::{Pose, Watch};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let word = |i: usize, default: &str| arguments.get(i).cloned().unwrap_or_else(|| default.into());
    let name = word(0, "b");
    let offset = if name == "a" { 0.0 } else { -0.15 };
    let arm = catalog::load("puma560")?.with_tool(Pose::translation(offset, 0.0, 0.4))?;
    let file = format!("{}/../../tests/golden/spray_ref_{name}_path.csv", env!("CARGO_MANIFEST_DIR"));
    let path = Path::from_csv(file)?;
    let mut settings = OrientationPlanSettings::new(&arm, 20f64.to_radians());
    settings.time_limit = word(1, "1").parse()?;
    settings.speed.joint_limits = word(2, "off") == "on";
    settings.torque_margin = word(3, "0").parse()?;
    if settings.torque_margin > 0.0 {
        let rates = [288.0, 240.0, 300.0, 400.0, 405.0, 600.0].map(f64::to_radians);
        settings.speed.velocity_limits = Some(rates.to_vec());
    }
    let begin = std::time::Instant::now();
    let plan = plan_orientation(&arm, &path, &settings, &Watch::default())?;
    let constant = plan.constant_speed.unwrap_or(f64::NAN);
    println!(
        "{name}: {} {:.4} m/s, x{:.3} of {constant:.4}; {} starts, {} steps, {:.1} s {}",
        plan.plan.status(),
        plan.speed,
        plan.speed / constant,
        plan.starts,
        plan.steps,
        begin.elapsed().as_secs_f64(),
        plan.plan.reason(),
    );
    Ok(())
}
