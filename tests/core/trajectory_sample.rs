//! A trajectory between its rows, and what its files keep.

use std::path::PathBuf;

use rand::Rng;
use redundancy_core::path::{Section, Trajectory};

use crate::allocations;
use crate::support::rng;

/// Value and three derivatives of a polynomial.
fn polynomial(c: &[f64], t: f64) -> [f64; 4] {
    let derivative =
        |c: &[f64]| c.iter().enumerate().skip(1).map(|(k, c)| k as f64 * c).collect::<Vec<f64>>();
    let value = |c: &[f64]| c.iter().rev().fold(0.0, |sum, c| sum * t + c);
    let (d, dd) = (derivative(c), derivative(&derivative(c)));
    [value(c), value(&d), value(&dd), value(&derivative(&dd))]
}

/// Two joints over uneven times; with or without accelerations.
fn trajectory(coefficients: &[Vec<f64>; 2], accelerations: bool) -> Trajectory {
    let t: Vec<f64> = (0..12).map(|i| 0.3 + 0.1 * f64::from(i) + 0.02 * f64::from(i * i % 5)).collect();
    let rows =
        |k: usize| t.iter().flat_map(|t| [0, 1].map(|j| polynomial(&coefficients[j], *t)[k])).collect();
    let names = vec!["a".into(), "b".into()];
    let out = Trajectory::new(names, t.clone(), rows(0), Some(rows(1)), Vec::new()).unwrap();
    if accelerations { out.with_accelerations(rows(2)).unwrap() } else { out }
}

fn coefficients(degree: usize) -> [Vec<f64>; 2] {
    let mut rng = rng(degree as u64);
    [0, 1].map(|_| (0..=degree).map(|_| rng.random_range(-1.0..1.0)).collect())
}

#[test]
fn polynomials_of_the_degree_are_reproduced() {
    for (degree, accelerations) in [(3, false), (5, true)] {
        let c = coefficients(degree);
        let trajectory = trajectory(&c, accelerations);
        let (first, last) = (trajectory.t()[0], trajectory.t()[11]);
        for i in 0..=500 {
            let t = first + (last - first) * f64::from(i) / 500.0;
            let state = trajectory.sample(t).unwrap();
            for (j, c) in c.iter().enumerate() {
                let expected = polynomial(c, t);
                let actual = [state.q[j], state.qd[j], state.qdd[j], state.qddd[j]];
                for (k, tolerance) in [1e-14, 1e-12, 1e-10, 2e-8].into_iter().enumerate() {
                    assert!(
                        (actual[k] - expected[k]).abs() < tolerance,
                        "{t} {k}: {} {}",
                        actual[k],
                        expected[k]
                    );
                }
            }
        }
    }
}

/// Rows that no polynomial explains: the rows are met to the bit, and the derivatives are those of the curve.
#[test]
fn rows_are_met_and_derivatives_are_derivatives() {
    let mut rng = rng(77);
    let mut random = |n: usize| (0..n).map(|_| rng.random_range(-2.0..2.0)).collect::<Vec<f64>>();
    let t = vec![0.0, 0.1, 0.25, 0.3, 0.7, 1.0];
    let plain =
        Trajectory::new(vec!["a".into(), "b".into()], t.clone(), random(12), Some(random(12)), Vec::new())
            .unwrap();
    let with = plain.clone().with_accelerations(random(12)).unwrap();
    for trajectory in [&plain, &with] {
        for (i, t) in t.iter().enumerate() {
            let state = trajectory.sample(*t).unwrap();
            assert_eq!((&state.q[..], &state.qd[..]), (trajectory.q_row(i), trajectory.qd_row(i)));
            if let Some(qdd) = trajectory.qdd() {
                assert_eq!(state.qdd, qdd[2 * i..2 * i + 2]);
            }
            // Both sides of the row.
            let (mut q, mut qd, mut qdd, mut qddd) = ([0.0; 2], [0.0; 2], [0.0; 2], [0.0; 2]);
            for interval in [i.checked_sub(1), (i < 5).then_some(i)].into_iter().flatten() {
                let out = [&mut q[..], &mut qd[..], &mut qdd[..], &mut qddd[..]];
                trajectory.sample_interval(interval, *t, out).unwrap();
                assert_eq!((&q[..], &qd[..]), (trajectory.q_row(i), trajectory.qd_row(i)));
                if interval == i {
                    assert_eq!((&qdd[..], &qddd[..]), (&state.qdd[..], &state.qddd[..]));
                } else if trajectory.qdd().is_none() && i < 5 {
                    assert!((qdd[0] - state.qdd[0]).abs() > 1e-3, "no jump at row {i}");
                }
            }
        }
        let h = 1e-5;
        for i in 0..400 {
            let t = 0.0012 + 0.997 * f64::from(i) / 400.0;
            if trajectory.t().iter().any(|row| (t - row).abs() < 2.0 * h) {
                continue;
            }
            let [a, b, c] = [t - h, t, t + h].map(|t| trajectory.sample(t).unwrap());
            for j in 0..2 {
                let slope = |plus: f64, minus: f64| (plus - minus) / (2.0 * h);
                assert!((slope(c.q[j], a.q[j]) - b.qd[j]).abs() < 1e-4, "{t}");
                assert!((slope(c.qd[j], a.qd[j]) - b.qdd[j]).abs() < 1e-2, "{t}");
                assert!((slope(c.qdd[j], a.qdd[j]) - b.qddd[j]).abs() < 2.0, "{t}");
            }
        }
    }
    let (mut q, mut qd, mut qdd, mut qddd) = ([0.0; 2], [0.0; 2], [0.0; 2], [0.0; 2]);
    let count = allocations::count(|| {
        with.sample_into(0.37, [&mut q, &mut qd, &mut qdd, &mut qddd]).unwrap();
    });
    assert_eq!(count, 0);
}

#[test]
fn times_outside_are_refused() {
    let trajectory = trajectory(&coefficients(3), false);
    let (first, last) = (trajectory.t()[0], trajectory.t()[11]);
    for t in [first - 1e-6, last + 1e-6] {
        let error = trajectory.sample(t).unwrap_err().to_string();
        assert!(error.contains("t is") && error.contains("in the trajectory, from 0.3 to"), "{error}");
    }
    assert!(trajectory.sample(f64::NAN).is_err());
    // What rounding of a sum of steps explains.
    assert_eq!(trajectory.sample(last + 1e-12).unwrap(), trajectory.sample(last).unwrap());
    assert!(
        trajectory
            .sample_interval(11, last, [&mut [0.0; 2], &mut [0.0; 2], &mut [0.0; 2], &mut [0.0; 2]])
            .is_err()
    );
    let one = Trajectory::new(vec!["a".into()], vec![2.0], vec![0.5], Some(vec![0.1]), Vec::new()).unwrap();
    let state = one.sample(2.0).unwrap();
    assert_eq!((state.q[0], state.qd[0], state.qdd[0], state.qddd[0]), (0.5, 0.1, 0.0, 0.0));
    assert!(one.sample(2.1).is_err());
    let none = Trajectory::new(vec!["a".into()], Vec::new(), Vec::new(), None, Vec::new()).unwrap();
    assert!(none.sample(0.0).unwrap_err().to_string().contains("no rows"));
}

fn file(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name)
}

#[test]
fn files_keep_accelerations_and_sections() {
    use Section::{LeadIn, LeadOut, Path};
    let plain = trajectory(&coefficients(4), false);
    let with = trajectory(&coefficients(4), true);
    let sections = [vec![LeadIn; 3], vec![Path; 7], vec![LeadOut; 2]].concat();
    for (i, trajectory) in [
        plain.clone(),
        with.clone(),
        plain.with_sections(sections.clone()).unwrap(),
        with.clone().with_sections(sections.clone()).unwrap(),
    ]
    .iter()
    .enumerate()
    {
        let (csv, json) = (file(&format!("sampled_{i}.csv")), file(&format!("sampled_{i}.json")));
        trajectory.to_csv(&csv).unwrap();
        assert_eq!(&Trajectory::from_csv(&csv).unwrap(), trajectory);
        trajectory.to_json(&json).unwrap();
        let read = Trajectory::from_json(&json).unwrap();
        assert_eq!((read.q(), read.qd(), read.qdd()), (trajectory.q(), trajectory.qd(), trajectory.qdd()));
        assert_eq!(read.sections(), trajectory.sections());
    }
    let csv = file("sampled_3.csv");
    let text = std::fs::read_to_string(&csv).unwrap();
    assert!(
        text.starts_with("t,a,b,a_velocity,b_velocity,a_acceleration,b_acceleration,section\n"),
        "{text}"
    );
    std::fs::write(&csv, text.replacen("lead_out", "lead", 1)).unwrap();
    let error = Trajectory::from_csv(&csv).unwrap_err().to_string();
    assert!(error.contains("sampled_3.csv:12") && error.contains("'lead'"), "{error}");
    std::fs::write(&csv, "section\nlead_in\n").unwrap();
    assert!(Trajectory::from_csv(&csv).unwrap_err().to_string().contains("expected t, the joint names"));
    let json = file("sampled_3.json");
    let text = std::fs::read_to_string(&json).unwrap();
    assert!(text.contains("\"accelerations\":[") && text.contains("\"section\":[\"lead_in\","), "{text}");

    assert!(with.clone().with_accelerations(vec![0.0; 3]).is_err());
    assert!(with.clone().with_accelerations(vec![f64::NAN; 24]).is_err());
    assert!(with.with_sections(sections[1..].to_vec()).is_err());
}

#[test]
fn empty_lists_of_ros_are_missing() {
    let json = file("ros.json");
    let point = |q: f64, sec: i32| {
        format!(
            r#"{{"positions": [{q}], "velocities": [], "accelerations": [], "effort": [],
            "time_from_start": {{"sec": {sec}, "nanosec": 0}}}}"#
        )
    };
    let text = format!(
        r#"{{"header": {{}}, "joint_names": ["a"], "points": [{}, {}]}}"#,
        point(1.0, 0),
        point(3.0, 2)
    );
    std::fs::write(&json, text).unwrap();
    let trajectory = Trajectory::from_json(&json).unwrap();
    assert_eq!((trajectory.qd(), trajectory.qdd()), (&[1.0, 1.0][..], None));
}
