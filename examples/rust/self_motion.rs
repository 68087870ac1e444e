//! Inverse kinematics of a seven-joint arm as a set: eight circles, their feasible arcs, their best configurations.
#![allow(clippy::print_stdout)]

use redundancy_core::chain::catalog;
use redundancy_core::criterion::JointRange;
use redundancy_core::solutions::{SrsArm, Swivel};

fn main() -> Result<(), redundancy_core::Error> {
    let chain = catalog::load("pa10")?;
    let arm = SrsArm::new(&chain)?;
    let q = [0.3, 0.5, -0.2, 1.1, 0.4, 0.7, -0.9];
    let pose = chain.forward(&q)?;
    let swivel = arm.swivel(&q)?;
    println!("swivel {:.2} deg, branch {:?}", swivel.to_degrees(), arm.branch(&q)?);

    // The configurations at this swivel; q is one of them.
    let rows = arm.solve(&pose, Swivel::Angle(swivel), true)?;
    assert!(rows.iter().any(|row| row.iter().zip(&q).all(|(a, b)| (a - b).abs() < 1e-9)));
    println!("{} of 8 branches hold the joint limits here", rows.len());

    // Where they hold on each circle.
    let motion = arm.self_motion(&pose)?;
    for branch in motion.branches() {
        let degrees: Vec<String> = branch
            .intervals(0.0)?
            .iter()
            .map(|[lo, hi]| format!("[{:.2}, {:.2}]", lo.to_degrees(), hi.to_degrees()))
            .collect();
        println!("{:?}: {} deg", branch.signs(), degrees.join(" "));
    }

    // The member nearest to mid-range, and the one nearest to a given configuration.
    if let Some(best) = motion.best(&JointRange::new(&chain))? {
        println!(
            "best: branch {}, swivel {:.2} deg, value {:.5}",
            best.branch,
            best.swivel.to_degrees(),
            best.value
        );
    }
    if let Some(near) = motion.nearest(&[0.2; 7])? {
        println!("nearest to (0.2, ..., 0.2): {:.4} rad away, {:.4?}", near.value, near.q);
    }
    Ok(())
}
