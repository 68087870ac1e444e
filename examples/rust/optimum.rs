//! The arm of [Park1996]: its critical points, which of them completes the paper's circle, and what stops the others.
#![allow(clippy::print_stdout)]

use redundancy_core::chain::catalog;
use redundancy_core::criterion::Manipulability;
use redundancy_core::kinematics::Task;
use redundancy_core::nalgebra::Vector3;
use redundancy_core::optimum::{
    FollowSettings, OptimaSettings, SingularitySettings, algorithmic_singularities, rank_starts,
};
use redundancy_core::path::Circle;

fn main() -> Result<(), redundancy_core::Error> {
    let arm = catalog::load("planar3r")?;
    let h = Manipulability::new(&arm, Task::PLANAR);
    let circle = Circle::new(Vector3::new(3.5, 0.0, 0.0), 1.5, std::f64::consts::PI, 1.0, Vector3::z())?;
    let path = circle.path(201)?;

    let starts =
        rank_starts(&arm, &path, &h, Task::PLANAR, &OptimaSettings::default(), &FollowSettings::default())?;
    assert!(starts[0].followed.stop.is_none());
    for start in &starts {
        let degrees = start.point.q.iter().map(|q| format!("{:9.4}", q.to_degrees())).collect::<String>();
        let end = match &start.followed.stop {
            None => "finishes the circle".into(),
            Some(stop) => format!("t = {:.10}: {}", stop.s / path.length(), stop.message),
        };
        let kind = start.point.classification.kind;
        println!("{degrees} deg, h = {:8.4}, {kind}: {end}", start.point.value);
    }

    // Table 1 of the paper and its mirror images.
    let singular = algorithmic_singularities(&arm, &h, Task::PLANAR, &SingularitySettings::default())?;
    assert_eq!(singular.len(), 10);
    for at in &singular {
        let [x, y, _] = at.position;
        let (q2, q3) = (at.q[1].to_degrees(), at.q[2].to_degrees());
        println!(
            "critical points vanish at q2 = {q2:.4}, q3 = {q3:.4} deg, {:.4} m from the base",
            x.hypot(y)
        );
    }
    Ok(())
}
