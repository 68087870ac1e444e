//! A raster with rounded corners: its curve, its samples as a file, and times for joint rows.
#![allow(clippy::print_stdout)]

use redundancy_core::Result;
use redundancy_core::nalgebra::{Rotation3, Vector3};
use redundancy_core::path::{Raster, TimingSettings, Trajectory, times_within_limits};

fn main() -> Result<()> {
    let (along, across) = (Vector3::y(), Vector3::x());
    let raster = Raster::new(Vector3::new(0.35, -0.3, 0.2), 0.6, 0.08, 5, Some(0.06), along, across)?;
    let tool_down = Rotation3::from_axis_angle(&Vector3::y_axis(), std::f64::consts::PI);
    let path = raster.path(0.002)?.with_orientation(&tool_down)?;
    println!("{} samples over {:.3} m", path.len(), path.length());

    let corner = path.at(0.6)?;
    println!("curvature at 0.6 m: {:.2} 1/m", corner.second_derivative.fixed_rows::<3>(0).norm());

    // Any rows of joint positions get the smallest times that the limits allow, smoothed.
    let q: Vec<f64> = path.s().iter().flat_map(|s| [(3.0 * s).sin(), (2.0 * s).cos()]).collect();
    let t = times_within_limits(&q, &[1.0, 2.0], TimingSettings::default())?;
    let names = vec!["shoulder".to_owned(), "elbow".to_owned()];
    let trajectory = Trajectory::new(names, t, q, None, Vec::new())?;
    let fastest = trajectory.qd().chunks(2).map(|row| row[0].abs()).fold(0.0, f64::max);
    println!("{:.2} s, the shoulder turns at {fastest:.2} rad/s at most", trajectory.t()[path.len() - 1]);
    assert!(fastest <= 0.9);
    Ok(())
}
