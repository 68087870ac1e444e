//! Times along a joint path: limits hold between the rows, nothing is slower than it must be.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use redundancy_core::chain::{Chain, catalog};
use redundancy_core::kinematics::DynamicsScratch;
use redundancy_core::nalgebra::Vector3;
use redundancy_core::path::Trajectory;
use redundancy_core::timing::{LimitKind, RetimeSettings, Retimed, retime};

/// A random smooth joint path of the Panda.
fn smooth(rows: usize, seed: u64) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let waves: Vec<[f64; 4]> = (0..7)
        .map(|_| {
            [
                rng.random_range(0.1..0.7),
                rng.random_range(1.0..3.0),
                rng.random_range(0.0..0.3),
                rng.random_range(2.0..6.0),
            ]
        })
        .collect();
    let at = |u: f64, j: usize| {
        let [a, f, b, g] = waves[j];
        a * (f * u + j as f64).sin() + b * (g * u).cos() - if j == 3 { 1.5 } else { 0.0 }
    };
    (0..rows)
        .flat_map(|k| (0..7).map(move |j| (k, j)))
        .map(|(k, j)| at(k as f64 / (rows - 1) as f64, j))
        .collect()
}

fn duration(motion: &Retimed) -> f64 {
    *motion.trajectory.t().last().unwrap()
}

/// Largest share of each limit at `per_interval` places of each interval of the trajectory's own interpolation.
fn shares(trajectory: &Trajectory, settings: &RetimeSettings, per_interval: usize) -> [f64; 3] {
    let mut worst = [0.0_f64; 3];
    let none = vec![f64::INFINITY; trajectory.dof()];
    let limits = [
        &settings.velocity_limits,
        &settings.acceleration_limits,
        settings.jerk_limits.as_ref().unwrap_or(&none),
    ];
    for pair in trajectory.t().windows(2) {
        for k in 0..per_interval {
            let u = (k as f64 + 0.5) / per_interval as f64;
            let sample = trajectory.sample(pair[0] + u * (pair[1] - pair[0])).unwrap();
            for (worst, (values, limits)) in
                worst.iter_mut().zip([&sample.qd, &sample.qdd, &sample.qddd].into_iter().zip(limits))
            {
                let share = values.iter().zip(limits).map(|(v, l)| v.abs() / l).fold(0.0, f64::max);
                *worst = worst.max(share);
            }
        }
    }
    worst
}

fn with_jerk(arm: &Chain, factor: f64) -> RetimeSettings {
    let settings = RetimeSettings::of(arm);
    let jerk = settings.acceleration_limits.iter().map(|a| factor * a).collect();
    RetimeSettings { jerk_limits: Some(jerk), ..settings }
}

#[test]
fn limits_hold_between_the_rows_and_one_always_binds() {
    let arm = catalog::load("panda").unwrap();
    for seed in 0..6 {
        let q = smooth(300, seed);
        for settings in [RetimeSettings::of(&arm), with_jerk(&arm, 5.0), with_jerk(&arm, 100.0)] {
            let motion = retime(&arm, &q, &settings).unwrap();
            assert_eq!(motion.path_rows, (0..300).collect::<Vec<_>>());
            assert_eq!(motion.trajectory.q(), &q[..]);
            let worst = shares(&motion.trajectory, &settings, 23);
            assert!(worst.iter().all(|share| *share <= 1.0 + 1e-6), "{seed} {worst:?}");
            assert!(worst.iter().any(|share| *share > 0.99), "{seed} {worst:?}");
            assert!(motion.stretched < 1.01, "{seed} {}", motion.stretched);
            for row in [0, 299] {
                assert!(motion.trajectory.qd_row(row).iter().all(|v| v.abs() < 1e-12));
            }
            if let Some(qdd) = motion.trajectory.qdd() {
                assert!(qdd[..7].iter().chain(&qdd[299 * 7..]).all(|a| a.abs() < 1e-9));
            }
            // Away from the ends every row is near one of its limits: else the motion could be faster there.
            if settings.jerk_limits.is_none() {
                let near = motion.limiting.iter().flatten().filter(|limit| limit.share > 0.97).count();
                assert!(near >= 280, "{seed} {near}");
            }
        }
    }
}

#[test]
fn more_jerk_is_never_slower_and_tends_to_no_limit() {
    let arm = catalog::load("panda").unwrap();
    let q = smooth(300, 9);
    let durations: Vec<f64> = [2.0, 5.0, 20.0, 100.0, 1000.0]
        .map(|factor| duration(&retime(&arm, &q, &with_jerk(&arm, factor)).unwrap()))
        .to_vec();
    let free = duration(&retime(&arm, &q, &RetimeSettings::of(&arm)).unwrap());
    assert!(durations.windows(2).all(|pair| pair[1] < pair[0] * 1.002), "{durations:?}");
    assert!(
        durations[4] < 1.06 * free && durations.iter().all(|t| *t > free * 0.999),
        "{durations:?} {free}"
    );
}

#[test]
fn straight_lines_have_the_closed_form() {
    let arm = catalog::load("panda").unwrap();
    let [from, to] = [[0.0, 0.2, 0.1, -1.0, 0.3, 1.2, 0.0], [0.9, 0.1, -0.5, -1.8, 0.4, 1.9, -0.2]];
    let q: Vec<f64> = from.into_iter().chain(to).collect();
    let settings = with_jerk(&arm, 8.0);
    let motion = retime(&arm, &q, &settings).unwrap();
    // The slowest joint of an own double-S profile each; all take at most as long on the common line.
    let limit = |l: &[f64]| (0..7).map(|j| l[j] / (to[j] - from[j]).abs()).fold(f64::INFINITY, f64::min);
    let (v, a) = (limit(&settings.velocity_limits), limit(&settings.acceleration_limits));
    let j = limit(settings.jerk_limits.as_ref().unwrap());
    let expected = if v * j >= a * a && 1.0 / v >= a / j + v / a {
        1.0 / v + v / a + a / j
    } else {
        let ramp = a / (2.0 * j) + (a * a / (4.0 * j * j) + 1.0 / a).sqrt();
        2.0 * ramp
    };
    assert!((duration(&motion) - expected).abs() < 1e-9, "{} {expected}", duration(&motion));
    let worst = shares(&motion.trajectory, &settings, 50);
    assert!(worst.iter().all(|share| *share <= 1.0 + 1e-9), "{worst:?}");
    assert_eq!(motion.trajectory.q_row(motion.path_rows[1]), &to);
}

#[test]
fn corners_are_stops_and_smooth_turns_are_not() {
    let arm = catalog::load("panda").unwrap();
    let mut q = Vec::new();
    for k in 0..=80 {
        let mut row = [0.0, 0.2, 0.1, -1.5, 0.3, 1.2, 0.0];
        row[0] = 0.01 * f64::from(k.min(40));
        row[1] += 0.01 * f64::from((k - 40).max(0));
        q.extend(row);
    }
    let motion = retime(&arm, &q, &RetimeSettings::of(&arm)).unwrap();
    assert_eq!(motion.stops, [40]);
    let at = motion.path_rows[40];
    assert!(motion.trajectory.qd_row(at).iter().all(|v| *v == 0.0));
    assert_eq!(motion.trajectory.events()[0].index, at);
    assert!(retime(&arm, &smooth(60, 3), &RetimeSettings::of(&arm)).unwrap().stops.is_empty());
}

#[test]
fn torque_and_tool_speed_bind() {
    let arm = catalog::load("puma560").unwrap();
    let q: Vec<f64> = (0..200)
        .flat_map(|k| (0..6).map(move |j| 0.6 * (0.015 * f64::from(k) + f64::from(j)).sin()))
        .collect();
    let effort: Vec<f64> = arm.joints().iter().map(|joint| joint.limits.effort).collect();
    let settings = RetimeSettings {
        acceleration_limits: vec![f64::INFINITY; 6],
        torque_limits: Some(effort.clone()),
        ..RetimeSettings::of(&arm)
    };
    let motion = retime(&arm, &q, &settings).unwrap();
    let kinds: Vec<LimitKind> = motion.limiting.iter().flatten().map(|limit| limit.kind).collect();
    assert!(kinds.contains(&LimitKind::Torque));
    let slow = RetimeSettings { tool_speed: Some(0.05), ..settings };
    let motion = retime(&arm, &q, &slow).unwrap();
    let kinds = motion.limiting.iter().flatten().filter(|limit| limit.kind == LimitKind::ToolSpeed);
    assert!(kinds.filter(|limit| limit.share > 0.99).count() > 150);
}

#[test]
fn torques_hold_between_the_rows() {
    let arm = catalog::load("iiwa14").unwrap();
    let effort: Vec<f64> = arm.joints().iter().map(|joint| joint.limits.effort).collect();
    let (mut scratch, mut tau) = (DynamicsScratch::new(&arm), vec![0.0; 7]);
    // Dense rows, rows so coarse that the motion bends between them, and limits that bind everywhere or here and there.
    // At last with accelerations so low that most torques cannot come near their limits, and are not looked at.
    let free = [50.0, 1e3];
    let slow = [2.0, 40.0];
    let cases = [
        (400, 0.7, free),
        (400, 0.45, free),
        (30, 0.7, free),
        (4, 0.7, free),
        (400, 0.29, slow),
        (40, 0.29, slow),
    ];
    for (rows, share, [velocity, acceleration]) in cases {
        let limits: Vec<f64> = effort.iter().map(|limit| share * limit).collect();
        let settings = RetimeSettings {
            velocity_limits: vec![velocity; 7],
            acceleration_limits: vec![acceleration; 7],
            torque_limits: Some(limits.clone()),
            ..RetimeSettings::of(&arm)
        };
        let motion = retime(&arm, &smooth(rows, 4), &settings).unwrap();
        let mut worst = 0.0_f64;
        for pair in motion.trajectory.t().windows(2) {
            for place in 0..=20 {
                let t = pair[0] + (pair[1] - pair[0]) * (1e-9 + f64::from(place) / 20.0 * (1.0 - 2e-9));
                let state = motion.trajectory.sample(t).unwrap();
                let gravity = Vector3::new(0.0, 0.0, -9.81);
                arm.inverse_dynamics(&state.q, &state.qd, &state.qdd, &gravity, &mut scratch, &mut tau)
                    .unwrap();
                worst =
                    tau.iter().zip(&limits).fold(worst, |worst, (tau, limit)| worst.max(tau.abs() / limit));
            }
        }
        assert!(worst <= 1.0 + 1e-6, "{rows} {share}: {worst}");
        let binds = motion
            .limiting
            .iter()
            .flatten()
            .any(|limit| limit.kind == LimitKind::Torque && limit.share > 0.99);
        assert!(binds, "{rows} {share}");
    }
}

#[test]
fn bad_input_is_named() {
    let arm = catalog::load("panda").unwrap();
    let q = smooth(10, 0);
    let settings = RetimeSettings::of(&arm);
    let fails = |q: &[f64], settings: &RetimeSettings, words: &str| {
        let error = retime(&arm, q, settings).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    fails(&q[..7], &settings, "rows of the path");
    fails(&[f64::NAN; 14], &settings, "finite");
    fails(
        &q,
        &RetimeSettings { acceleration_limits: vec![f64::INFINITY; 7], ..settings.clone() },
        "acceleration limit",
    );
    fails(&q, &RetimeSettings { tool_speed: Some(0.0), ..settings.clone() }, "tool_speed");
    fails(&q, &RetimeSettings { jerk_limits: Some(vec![-1.0; 7]), ..settings.clone() }, "jerk_limits");
    fails(&q, &RetimeSettings { corner_angle: 4.0, ..settings }, "corner_angle");
}
