//! The best orientation under two cones: closed form, Newton's method, and two cones that exclude each other.
#![allow(clippy::print_stdout)]

use redundancy_core::nalgebra::Vector3;
use redundancy_core::rotation::{
    Barrier, Cone, OrientationMethod, OrientationOptimizer, OrientationSettings, Spin, from_wxyz,
};
use redundancy_core::{Result, Status};

fn main() -> Result<()> {
    let down = Cone::downward(20_f64.to_radians())?;
    let wanted = Cone::z([0.3, 0.2, -0.9], 60_f64.to_radians())?;
    let facing = Spin::new(from_wxyz([0.0, 0.0, 1.0, 0.0])?, 1.0, [0.0, 0.0, 1.0])?;
    let barriers = vec![Barrier::new(1.0, down)?, Barrier::new(1.0, wanted)?, Barrier::new(1.0, facing)?];

    let closed = OrientationOptimizer::new(barriers.clone(), OrientationSettings::default())?.solve(None);
    let newton = OrientationSettings { method: OrientationMethod::Newton, ..OrientationSettings::default() };
    let newton = OrientationOptimizer::new(barriers, newton)?.solve(None);
    assert!(closed.q.angle_to(&newton.q) < 1e-7 && newton.status == Status::Converged);
    let z = closed.q * Vector3::z();
    println!("tool axis {:.4} {:.4} {:.4}, {} Newton iterations", z.x, z.y, z.z, newton.iterations);

    let apart = vec![Barrier::new(1.0, down)?, Barrier::new(1.0, Cone::z([1.0, 0.0, 0.0], 0.5)?)?];
    let apart = OrientationOptimizer::new(apart, OrientationSettings::default())?.solve(None);
    println!("{}: the cones miss each other by {:.1} deg", apart.status, apart.miss_angle.to_degrees());
    assert_eq!(apart.status, Status::Infeasible);
    Ok(())
}
