//! The one result along a path keeps its promises.

use redundancy_core::chain::catalog;
use redundancy_core::path::{BlockedPoint, PlanBuilder, Reconfiguration, Trajectory};
use redundancy_core::{Error, Status};

const Q: [f64; 9] = [0.0, 0.5, 0.5, 0.1, 0.4, 0.6, 0.2, 0.3, 0.7];

fn builder(status: Status) -> PlanBuilder {
    let names = catalog::load("planar3r").unwrap().joints().iter().map(|j| j.name.clone()).collect();
    PlanBuilder::new(
        Trajectory::new(names, vec![0.0, 1.0, 2.0], Q.to_vec(), None, Vec::new()).unwrap(),
        status,
    )
}

#[test]
fn columns_have_one_entry_per_row_and_no_nan() {
    let good = || builder(Status::Converged);
    assert!(good().spin(vec![0.0; 3]).margin(vec![f64::INFINITY; 3]).build().is_ok());
    for bad in [
        good().spin(vec![0.0; 2]),
        good().tilt(vec![[0.0; 2]; 4]),
        good().spare("swivel", Vec::new()),
        good().clearance(vec![0.0]),
    ] {
        assert!(matches!(bad.build(), Err(Error::Length { .. })));
    }
    for bad in [
        good().spin(vec![0.0, f64::INFINITY, 0.0]),
        good().margin(vec![0.0, f64::NAN, 0.0]),
        good().tilt(vec![[0.0, f64::NAN]; 3]),
        good().spare("swivel", vec![f64::NAN; 3]),
        good().cost(f64::NAN),
    ] {
        assert!(matches!(bad.build(), Err(Error::NotFinite { .. })));
    }
    assert!(good().spare("rail", vec![0.0; 3]).spare("rail", vec![0.0; 3]).build().is_err());
    assert!(good().pieces(vec![0, 1, 2], vec!["a".into(), "b".into()]).build().is_err());
}

#[test]
fn converged_is_legal_continuous_and_whole() {
    let change = || vec![Reconfiguration { row: 1, reason: "a joint limit".into() }];
    let blocked = || vec![BlockedPoint { row: 2, status: Status::Limits, reason: "a joint limit".into() }];
    for (converged, infeasible) in [
        (builder(Status::Converged).legal(false), builder(Status::Infeasible).legal(false)),
        (
            builder(Status::Converged).reconfigurations(change()),
            builder(Status::Infeasible).reconfigurations(change()),
        ),
        (builder(Status::Converged).blocked(blocked()), builder(Status::Limits).blocked(blocked())),
    ] {
        assert!(converged.build().is_err());
        assert!(infeasible.clone().build().is_err(), "no reason");
        assert!(infeasible.reason("point 1: joint 'a' would leave [0, 1] rad").build().is_ok());
    }
    let late = vec![Reconfiguration { row: 3, reason: String::new() }];
    assert!(builder(Status::Infeasible).reason("x").reconfigurations(late).build().is_err());
}

#[test]
fn margins_and_poses_come_from_the_chain() {
    let arm = catalog::load("planar3r").unwrap();
    let plan = builder(Status::Converged).poses_of(&arm).unwrap().margin_of(&arm).unwrap().build().unwrap();
    let (poses, margins) = (plan.poses().unwrap(), plan.margin().unwrap());
    for (k, q) in Q.chunks_exact(3).enumerate() {
        assert!((poses[k].to_homogeneous() - arm.forward(q).unwrap().to_homogeneous()).norm() < 1e-15);
        let expected =
            (0..3).map(|i| (q[i] - arm.lower()[i]).min(arm.upper()[i] - q[i])).fold(f64::INFINITY, f64::min);
        assert_eq!(margins[k], expected);
    }
    assert!(builder(Status::Converged).margin_of(&catalog::load("pa10").unwrap()).is_err());
}

#[test]
fn a_word_is_a_status_and_back() {
    for status in Status::ALL {
        assert_eq!(status.as_str().parse::<Status>(), Ok(status));
    }
    assert!("completed".parse::<Status>().is_err());
}
