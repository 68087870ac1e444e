//! The servo: no limit is exceeded and nothing is allocated, whatever the input.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use redundancy_core::chain::{Chain, catalog};
use redundancy_core::nalgebra::{Rotation3, Translation3, Vector3};
use redundancy_core::streaming::{Servo, ServoSettings, ServoTarget, TargetNoise};
use redundancy_core::{Pose, Status};

use crate::allocations::count;

const ARMS: [&str; 6] = ["iiwa14", "panda", "pa10", "dexter", "puma560", "planar4r"];

fn random_q(chain: &Chain, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let within = |(lower, upper): (&f64, &f64)| rng.random_range(lower.max(-3.0)..upper.min(3.0));
    chain.lower().iter().zip(chain.upper()).map(within).collect()
}

/// A target as no operator sends it on purpose: noise, out of reach, nothing, not a number, anywhere.
fn hostile(kind: u32, base: &Pose, rng: &mut ChaCha8Rng) -> ServoTarget {
    let mut random = |size: f64| Vector3::from_fn(|_, _| rng.random_range(-size..size));
    let mut pose = *base;
    match kind {
        0 => {}
        1 => {
            pose.translation.vector += random(0.02);
            pose.rotation = Rotation3::new(random(0.02)) * pose.rotation;
        }
        2 => pose.translation.vector *= 3.0,
        3 => pose.translation.x = f64::NAN,
        4 => return ServoTarget::default(),
        _ => pose = Pose::from_parts(Translation3::from(random(1.5)), Rotation3::new(random(3.0))),
    }
    ServoTarget { pose: Some(pose), ..ServoTarget::default() }
}

/// Ticks of one random arm with random limits; the worst excess over a limit.
fn run(seed: u64, ticks: usize) -> f64 {
    let rng = &mut ChaCha8Rng::seed_from_u64(seed);
    let chain = catalog::load(ARMS[rng.random_range(0..ARMS.len())]).unwrap();
    let n = chain.dof();
    let dt = [0.001, 0.002, 0.004, 0.01][rng.random_range(0..4)];
    let mut log =
        |low: f64, high: f64| -> Vec<f64> { (0..n).map(|_| rng.random_range(low..high).exp()).collect() };
    let (velocity, acceleration, ratio) = (log(-2.0, 1.5), log(-1.0, 4.0), log(1.0, 6.0));
    let jerk: Vec<f64> = acceleration.iter().zip(&ratio).map(|(a, r)| a * r).collect();
    let limited = rng.random_bool(0.7);
    let settings = ServoSettings {
        velocity_limits: Some(velocity.clone()),
        acceleration_limits: Some(acceleration.clone()),
        jerk_limits: limited.then(|| jerk.clone()),
        target_noise: if rng.random_bool(0.3) { TargetNoise::None } else { TargetNoise::Auto },
        ..ServoSettings::default()
    };
    let mut servo = Servo::new(&chain, dt, &settings).unwrap();
    let start = random_q(&chain, rng);
    servo.reset(&start, None).unwrap();
    let (mut before, mut last, mut worst) = (vec![0.0; n], start, 0.0_f64);
    let (mut kind, mut base) = (0, Pose::identity());
    for k in 0..ticks {
        if k % 50 == 0 {
            kind = rng.random_range(0..6);
            base = chain.forward(&random_q(&chain, rng)).unwrap();
        }
        servo.update(&hostile(kind, &base, rng)).unwrap();
        let (q, qd, qdd) = (servo.q(), servo.qd(), servo.qdd());
        assert!(q.iter().chain(qd).chain(qdd).all(|x| x.is_finite()), "seed {seed}, tick {k}");
        for i in 0..n {
            worst = worst.max(chain.lower()[i] - q[i]).max(q[i] - chain.upper()[i]);
            worst = worst.max(qd[i].abs() - velocity[i]).max(qdd[i].abs() - acceleration[i]);
            if limited {
                worst = worst.max(((qdd[i] - before[i]).abs() / dt - jerk[i]) / jerk[i]);
            }
            assert!((q[i] - last[i] - dt * qd[i]).abs() < 1e-12);
        }
        before.copy_from_slice(qdd);
        last.copy_from_slice(q);
    }
    worst
}

#[test]
fn no_limit_is_exceeded_whatever_comes() {
    let full = std::env::var_os("REDUNDANCY_TEST_FULL").is_some();
    let (runs, ticks) = if full { (10_000, 1_000) } else { (250, 400) };
    let worst = (0..runs).map(|seed| run(seed, ticks)).fold(0.0, f64::max);
    assert!(worst <= 1e-9, "{worst:e}");
}

#[test]
fn a_tick_allocates_nothing() {
    let chain = catalog::load("iiwa14").unwrap();
    let q = [0.3, 0.6, -0.2, -1.2, 0.1, 0.9, 0.4];
    let jerk_limits = Some(vec![1000.0; 7]);
    let mut servo = Servo::new(&chain, 0.004, &ServoSettings { jerk_limits, ..Default::default() }).unwrap();
    servo.reset(&q, None).unwrap();
    let base = chain.forward(&q).unwrap();
    let rng = &mut ChaCha8Rng::seed_from_u64(1);
    for k in 0..600 {
        let mut target = hostile(k / 100, &base, rng);
        target.swivel = (k > 300).then_some(0.2);
        assert_eq!(count(|| servo.update(&target).unwrap()), 0, "tick {k}");
    }
}

#[test]
fn the_end_of_the_reach_is_announced() {
    let chain = catalog::load("iiwa14").unwrap();
    let settings = ServoSettings { target_noise: TargetNoise::None, ..ServoSettings::default() };
    let mut servo = Servo::new(&chain, 0.004, &settings).unwrap();
    let q = [0.0, 0.6, 0.0, -1.2, 0.0, 0.9, 0.0];
    servo.reset(&q, None).unwrap();
    let mut pose = chain.forward(&q).unwrap();
    // 0.1 m/s forward: seconds from the first announcement below 0.8 s until the tool falls behind.
    let (mut announced, mut behind) = (None, None);
    for k in 0..1000 {
        pose.translation.x += 4e-4 * (f64::from(k) / 100.0).min(1.0);
        let report = servo.update(&ServoTarget { pose: Some(pose), ..ServoTarget::default() }).unwrap();
        if report.time_to_stop < 0.8 {
            announced.get_or_insert((f64::from(k) * 0.004, report.time_to_stop));
        }
        if report.position_error > 5e-3 {
            assert_eq!(report.status, Status::Unreachable);
            behind = Some(f64::from(k) * 0.004);
            break;
        }
    }
    let ((at, time), behind) = (announced.unwrap(), behind.unwrap());
    assert!((behind - at - time).abs() < 0.3, "announced {time} s at {at} s, behind at {behind} s");
}

#[test]
fn a_target_that_stops_at_once_is_reached() {
    let chain = catalog::load("iiwa14").unwrap();
    for target_noise in [TargetNoise::Auto, TargetNoise::None] {
        let settings = ServoSettings { target_noise, ..ServoSettings::default() };
        let mut servo = Servo::new(&chain, 0.01, &settings).unwrap();
        let start = [0.3, 0.6, -0.2, -1.2, 0.1, 0.9, 0.4];
        servo.reset(&start, None).unwrap();
        let mut pose = chain.forward(&start).unwrap();
        // Up to 1 m/s within ten ticks, then no motion at all.
        let mut tick = |step: f64| {
            pose.translation.x -= step;
            let target = ServoTarget { pose: Some(pose), ..ServoTarget::default() };
            servo.update(&target).unwrap()
        };
        for k in 0..110 {
            tick(0.001 * f64::from((k - 99).max(0)));
        }
        let report = (0..400).map(|_| tick(0.0)).last().unwrap();
        assert_eq!(report.status, Status::Converged, "{report:?}");
    }
}
