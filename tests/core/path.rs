//! Room `path`: paths, shapes, timing, trajectories.

use std::path::PathBuf;

use proptest::prelude::*;
use rand::Rng;
use redundancy_core::nalgebra::{Rotation3, Translation3, Vector3};
use redundancy_core::path::{
    Circle, Event, EventKind, Path, Raster, TimingSettings, Trajectory, times_within_limits,
};
use redundancy_core::{Error, Pose};

use crate::support::{random_pose, rng, unit};

/// A file in the test's own folder under the target directory.
fn scratch_file(name: &str, text: &str) -> PathBuf {
    let file = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::write(&file, text).unwrap();
    file
}

fn golden(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden").join(name)
}

fn smooth_pose(s: f64) -> Pose {
    let position = Vector3::new(s.sin(), (0.7 * s).cos(), 0.3 * s);
    let rotation = Rotation3::new(Vector3::new(0.4 * s, 0.3 * s.sin(), 0.2 * s * s));
    Pose::from_parts(Translation3::from(position), rotation)
}

#[test]
fn rasters_are_the_reference_spray_paths() {
    for (file, x, spacing, corner) in [
        ("spray_ref_a_path.csv", 0.55 - 0.20, 0.20, 0.16752193),
        ("spray_ref_b_path.csv", 0.65 - 0.21, 0.21, 0.17912615734826384),
    ] {
        let reference = Path::from_csv(golden(file)).unwrap();
        let origin = Vector3::new(x, -0.25, -0.3);
        let raster = Raster::new(origin, 0.5, spacing, 3, Some(corner), Vector3::y(), Vector3::x()).unwrap();
        let path = raster.path(0.002).unwrap();
        assert_eq!(path.len(), reference.len());
        let printed = 0.500_1e-9; // half a unit of the ninth decimal
        for i in 0..path.len() {
            assert!((path.s()[i] - reference.s()[i]).abs() <= printed);
            let [p, tangent, bend] = raster.at(path.s()[i]);
            let miss = p - reference.poses()[i].translation.vector;
            // In the turns the reference lies inside the curve by 5.2e-9 m^2 x curvature (at most 9.8e-8 m), as points
            // on chords do; see tests/golden/PROVENANCE.md. Along the curve and on the straights all digits agree.
            assert!(miss.dot(&tangent).abs() <= 1.5 * printed, "{file} sample {i}: {miss}");
            assert!((miss + 5.2e-9 * bend).amax() <= 1.5e-9, "{file} sample {i}: {miss}");
            assert!(bend.norm() > 0.0 || miss.amax() <= printed, "{file} sample {i}: {miss}");
        }
    }
}

#[test]
fn raster_has_unit_speed_and_its_curvature_is_continuous() {
    let (along, across) = (Vector3::new(1.0, 1.0, 0.0), Vector3::new(0.0, 0.0, 2.0));
    let raster = Raster::new(Vector3::new(0.4, 0.0, 0.2), 0.4, 0.1, 4, Some(0.08), along, across).unwrap();
    let h = 1e-5;
    let length = raster.arc_length();
    for i in 1..2000 {
        let s = length * f64::from(i) / 2000.0;
        let [before, [_, d, dd], after] = [raster.at(s - h), raster.at(s), raster.at(s + h)];
        assert!((d.norm() - 1.0).abs() < 1e-14);
        assert!(((after[0] - before[0]) / (2.0 * h) - d).norm() < 1e-7);
        assert!(((after[1] - before[1]) / (2.0 * h) - dd).norm() < 1e-4);
    }
    let end = raster.at(length)[0];
    assert!((end - Vector3::new(0.4, 0.0, 0.5)).norm() < 1e-12, "four strokes end where they began: {end}");
}

#[test]
fn sharp_rasters_sample_their_corners() {
    let origin = Vector3::new(0.1, 0.2, 0.3);
    let raster = Raster::new(origin, 0.25, 0.1, 3, None, Vector3::y(), Vector3::x()).unwrap();
    let path = raster.path(0.01).unwrap();
    assert!((path.length() - 0.95).abs() < 1e-14);
    for corner in [(0.0, 0.25), (0.1, 0.25), (0.1, 0.0), (0.2, 0.0), (0.2, 0.25)] {
        let corner = origin + Vector3::new(corner.0, corner.1, 0.0);
        assert!(path.poses().iter().any(|p| (p.translation.vector - corner).norm() < 1e-14), "{corner}");
    }
    assert_eq!(path.at(0.25).unwrap().derivative.x, 1.0);
}

#[test]
fn shapes_refuse_what_cannot_be() {
    let (o, x, y, z) = (Vector3::zeros(), Vector3::x(), Vector3::y(), Vector3::z());
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(Circle::new(o, bad, 0.0, 1.0, z).is_err());
        assert!(Raster::new(o, bad, 0.1, 2, None, y, x).is_err());
        assert!(Raster::new(o, 0.5, bad, 2, None, y, x).is_err());
        assert!(Raster::new(o, 0.5, 0.1, 2, Some(bad), y, x).is_err());
        assert!(Raster::new(o, 0.5, 0.1, 2, None, y, x).unwrap().path(bad).is_err());
    }
    assert!(Circle::new(o, 0.1, 0.0, 0.0, z).is_err());
    assert!(Circle::new(o, 0.1, 0.0, 1.0, o).is_err());
    assert!(Circle::new(o, 0.1, 0.0, 1.0, z).unwrap().path(1).is_err());
    assert!(Raster::new(o, 0.5, 0.1, 0, None, y, x).is_err());
    assert!(Raster::new(o, 0.5, 0.1, 2, None, y, x + y).is_err());
    assert!(Raster::new(o, 0.5, 0.1, 2, None, y, x).unwrap().path(1e-12).is_err());
    let error = Raster::new(o, 0.5, 0.1, 2, Some(0.2), y, x).unwrap_err().to_string();
    assert!(error.contains("corner is 0.2") && error.contains("half the spacing"), "{error}");
}

#[test]
fn circles_about_any_normal() {
    let mut rng = rng(1);
    let mut normals: Vec<Vector3<f64>> = (0..50).map(|_| unit(&mut rng).into_inner()).collect();
    normals.extend([
        Vector3::z(),
        -Vector3::z(),
        Vector3::new(1e-9, 0.0, -1.0),
        Vector3::new(0.0, 1e-5, -1.0),
    ]);
    for normal in normals {
        let center = Vector3::new(0.4, -0.1, 0.6);
        let turns = rng.random_range(-2.0..2.0);
        let circle = Circle::new(center, 0.12, 0.3, turns, normal).unwrap();
        for i in 0..10 {
            let s = circle.length() * f64::from(i) / 9.0;
            let [p, d, dd] = circle.at(s);
            let arm = p - center;
            assert!((arm.norm() - 0.12).abs() < 1e-14);
            assert!(arm.dot(&normal).abs() < 1e-14);
            assert!((d.norm() - 1.0).abs() < 1e-14);
            let turning = arm.cross(&d).dot(&normal.normalize());
            assert!((turning - 0.12 * turns.signum()).abs() < 1e-14);
            assert!((dd + arm / (0.12 * 0.12)).norm() < 1e-11);
        }
    }
}

#[test]
fn derivatives_agree_with_differences_on_the_manifold() {
    let s: Vec<f64> = (0..30).map(|i| 0.1 * f64::from(i) + 0.02 * f64::from(i % 3)).collect();
    let poses: Vec<Pose> = s.iter().map(|s| smooth_pose(*s)).collect();
    let path = Path::new(&poses, Some(&s), None).unwrap();
    let mut rng = rng(2);
    let h = 1e-5;
    for _ in 0..200 {
        let at = rng.random_range(s[0] + h..s[29] - h);
        let [before, here, after] = [at - h, at, at + h].map(|s| path.at(s).unwrap());
        // The skew part: sin(angle) axis, where the angle from the trace would lose half the digits.
        let turn = |from: &Pose, to: &Pose| {
            let r = (to.rotation * from.rotation.inverse()).into_inner();
            0.5 * Vector3::new(r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)])
        };
        let omega = (turn(&here.pose, &after.pose) - turn(&here.pose, &before.pose)) / (2.0 * h);
        assert!((omega - here.derivative.fixed_rows::<3>(3)).norm() < 1e-8);
        let d = (after.pose.translation.vector - before.pose.translation.vector) / (2.0 * h);
        assert!((d - here.derivative.fixed_rows::<3>(0)).norm() < 1e-8);
        let dd = (after.derivative - before.derivative) / (2.0 * h);
        assert!((dd - here.second_derivative).norm() < 1e-4 * (1.0 + dd.norm()));
    }
}

#[test]
fn curve_meets_its_samples_and_converges_with_fourth_order() {
    let error = |n: usize| {
        let s: Vec<f64> = (0..=n).map(|i| 3.0 * i as f64 / n as f64).collect();
        let poses: Vec<Pose> = s.iter().map(|s| smooth_pose(*s)).collect();
        let path = Path::new(&poses, Some(&s), None).unwrap();
        for (s, pose) in s.iter().zip(&poses) {
            let at = path.at(*s).unwrap().pose;
            assert_eq!(at.translation, pose.translation);
            assert!((at.rotation.matrix() - pose.rotation.matrix()).amax() < 1e-14);
        }
        (0..997)
            .map(|i| {
                let s = 3.0 * f64::from(i) / 996.0;
                let (a, b) = (path.at(s).unwrap().pose, smooth_pose(s));
                let turn = (a.rotation.matrix() - b.rotation.matrix()).norm();
                (a.translation.vector - b.translation.vector).norm().max(turn)
            })
            .fold(0.0, f64::max)
    };
    let (coarse, fine) = (error(40), error(80));
    assert!(coarse < 1e-4 && fine < coarse / 12.0, "{coarse:e} {fine:e}");
}

#[test]
fn curve_does_not_depend_on_the_frames_it_is_written_in() {
    let poses: Vec<Pose> = (0..12).map(|i| smooth_pose(0.3 * f64::from(i))).collect();
    let s: Vec<f64> = (0..12).map(|i| 0.3 * f64::from(i)).collect();
    let path = Path::new(&poses, Some(&s), None).unwrap();
    let mut rng = rng(3);
    let (base, tool) = (random_pose(&mut rng, 1.0), random_pose(&mut rng, 1.0).rotation);
    let moved: Vec<Pose> = poses.iter().map(|p| base * p * tool).collect();
    let moved = Path::new(&moved, Some(&s), None).unwrap();
    for i in 0..100 {
        let s = 3.3 * f64::from(i) / 99.0;
        let (a, b) = (path.at(s).unwrap(), moved.at(s).unwrap());
        assert!(((base * a.pose * tool).to_homogeneous() - b.pose.to_homogeneous()).amax() < 1e-13);
        let omega = base.rotation * a.derivative.fixed_rows::<3>(3);
        assert!((omega - b.derivative.fixed_rows::<3>(3)).norm() < 1e-12);
    }
}

#[test]
fn stops_and_turns_on_the_spot_keep_their_samples() {
    let at = |x: f64, turn: f64| {
        Pose::from_parts(Translation3::new(x, 0.0, 0.0), Rotation3::new(Vector3::z() * turn))
    };
    let poses = [at(0.0, 0.0), at(0.1, 0.0), at(0.1, 0.0), at(0.1, 0.5), at(0.2, 0.5)];
    let t = [0.0, 1.0, 2.0, 3.0, 4.0];
    let path = Path::new(&poses, None, Some(&t)).unwrap();
    let expected = [0.0, 0.1, 0.1, 0.15, 0.25];
    for (s, e) in path.s().iter().zip(expected) {
        assert!((s - e).abs() < 1e-15);
    }
    for (s, pose) in path.s().iter().zip(&poses) {
        assert!((path.at(*s).unwrap().pose.to_homogeneous() - pose.to_homogeneous()).amax() < 1e-14);
    }
    assert!(path.resampled(0.01).unwrap_err().to_string().contains("stops at sample 2"));
    assert_eq!(path.with_times(None).unwrap().resampled(0.01).unwrap().len(), 26);
    // One place only: nothing to divide by.
    let still = Path::new(&[at(0.3, 0.1), at(0.3, 0.1)], None, None).unwrap();
    assert_eq!(still.length(), 0.0);
    assert!(still.at(0.0).unwrap().derivative.norm() == 0.0);
}

#[test]
fn half_turns_between_samples_stay_finite() {
    let at =
        |turn: f64| Pose::from_parts(Translation3::new(turn, 0.0, 0.0), Rotation3::new(Vector3::x() * turn));
    let poses: Vec<Pose> = (0..6).map(|i| at(std::f64::consts::PI * f64::from(i * i % 4))).collect();
    let path = Path::new(&poses, None, None).unwrap();
    for i in 0..=1000 {
        let point = path.at(path.length() * f64::from(i) / 1000.0).unwrap();
        assert!(point.pose.to_homogeneous().iter().all(|v| v.is_finite()));
        assert!(point.second_derivative.iter().all(|v| v.is_finite()));
    }
}

#[test]
fn resampling_keeps_the_analytic_curve() {
    let circle = Circle::new(Vector3::zeros(), 0.2, 0.0, 1.0, Vector3::z()).unwrap();
    let path = circle.path(9).unwrap().with_orientation(&Rotation3::new(Vector3::x())).unwrap();
    let fine = path.resampled(0.001).unwrap();
    assert_eq!(fine.len(), 1258);
    assert!(fine.has_orientation());
    for pose in fine.poses() {
        assert!((pose.translation.vector.norm() - 0.2).abs() < 1e-15);
    }
    let timed = path.with_times(Some(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0])).unwrap();
    let t = timed.resampled(0.01).unwrap();
    let t = t.t().unwrap();
    assert!(t[0] == 0.0 && t[t.len() - 1] == 8.0 && t.windows(2).all(|w| w[1] > w[0]));
}

#[test]
fn samples_that_make_no_path_are_refused() {
    let poses: Vec<Pose> = (0..3).map(|i| smooth_pose(f64::from(i))).collect();
    let message = |s: Option<&[f64]>, t: Option<&[f64]>| Path::new(&poses, s, t).unwrap_err().to_string();
    let one = Path::new(&poses[..1], None, None).unwrap_err().to_string();
    assert_eq!(one, "a path needs at least two samples, got 1");
    assert!(message(Some(&[0.0, 1.0]), None).contains("expected 3 entries, got 2"));
    assert!(message(Some(&[0.0, 2.0, 1.0]), None).contains("s[2] is 1 after 2"));
    assert!(message(Some(&[0.0, 0.0, 1.0]), None).contains("s[1] is 0 after 0"));
    assert!(message(Some(&[0.0, f64::NAN, 1.0]), None).contains("entry 1 is NaN"));
    assert!(message(None, Some(&[0.0, 1.0, 1.0])).contains("t[2] is 1 after 1"));
    assert!(
        Path::from_positions(&[Vector3::zeros(), Vector3::new(1e308, -1e308, 1e308)], None, None).is_err()
    );
    let path = Path::new(&poses, None, None).unwrap();
    for s in [-0.1, f64::NAN, f64::INFINITY, 2.0 * path.length()] {
        assert!(path.at(s).unwrap_err().to_string().contains("must be on the path"));
    }
}

#[test]
fn csv_columns_in_any_order() {
    let text = "\u{feff}qz, t,x,qw,y ,qx,z,qy\r\n0,0,1,1,2,0,3,0\r\n\r\n0.7072,0.5,1.5,0.7072,2,0,3,0\r\n";
    let path = Path::from_csv(scratch_file("any_order.csv", text)).unwrap();
    assert_eq!(path.t(), Some([0.0, 0.5].as_slice()));
    assert_eq!(path.poses()[1].translation.vector, Vector3::new(1.5, 2.0, 3.0));
    let quarter = Rotation3::new(Vector3::z() * std::f64::consts::FRAC_PI_2);
    assert!((path.poses()[1].rotation.matrix() - quarter.matrix()).amax() < 1e-15);
    let positions = Path::from_csv(scratch_file("positions.csv", "z,y,x\n3,2,1\n3,2,2\n")).unwrap();
    assert!(!positions.has_orientation() && positions.t().is_none());
}

#[test]
fn csv_round_trip_is_exact_in_positions() {
    let poses: Vec<Pose> = (0..20).map(|i| smooth_pose(0.1 * f64::from(i))).collect();
    let t: Vec<f64> = (0..20).map(|i| 0.1 * f64::from(i)).collect();
    let path = Path::new(&poses, None, Some(&t)).unwrap();
    let file = scratch_file("round_trip.csv", "");
    path.to_csv(&file).unwrap();
    let read = Path::from_csv(&file).unwrap();
    assert_eq!((read.s(), read.t()), (path.s(), path.t()));
    for (a, b) in read.poses().iter().zip(&poses) {
        assert_eq!(a.translation, b.translation);
        assert!((a.rotation.matrix() - b.rotation.matrix()).amax() < 1e-14);
    }
}

#[test]
fn broken_csv_names_file_line_and_cause() {
    let good = "x,y,z,qw,qx,qy,qz\n0,0,0,1,0,0,0\n";
    for (name, text, line, cause) in [
        ("word", format!("{good}0,0,a,1,0,0,0\n"), ":3:", "column 'z': 'a' is not a number"),
        ("empty_field", format!("{good}0,0,,1,0,0,0\n"), ":3:", "column 'z': '' is not a number"),
        ("nan", format!("{good}0,nan,0,1,0,0,0\n"), ":3:", "column 'y' is NaN"),
        ("infinite", format!("{good}\n0,1e999,0,1,0,0,0\n"), ":4:", "column 'y' is inf"),
        ("short_row", format!("{good}0,0,0,1,0,0\n"), ":3:", "has 6 columns, the header has 7"),
        ("norm", format!("{good}1,0,0,1.002,0,0,0\n"), ":3:", "norm 1.002"),
        ("zero", format!("{good}1,0,0,0,0,0,0\n"), ":3:", "norm 0"),
        ("no_header", "0,0,0\n1,1,1\n".into(), ":1:", "holds numbers, expected a header"),
        ("unknown", "\nx,y,z,Q\n0,0,0,0\n".into(), ":2:", "unknown column 'Q', expected x,y,z,qw"),
        ("partial", "x,y,z,qw,qx,qy\n0,0,0,1,0,0\n".into(), ":1:", "column 'qz' is missing"),
        ("missing", "x,z\n0,0\n".into(), ":1:", "column 'y' is missing"),
        ("double", "x,y,z,x\n0,0,0,0\n".into(), ":1:", "column 'x' occurs twice"),
        ("time", "x,y,z,t\n0,0,0,0\n1,0,0,1\n2,0,0,1\n".into(), ":4:", "t is 1 after 1"),
        ("arc", "x,y,z,s\n0,0,0,0\n1,0,0,1\n2,0,0,0.5\n".into(), ":4:", "s is 0.5 after 1"),
        ("nothing", String::new(), ":1:", "is empty"),
        ("header_only", "x,y,z\n".into(), "header_only.csv:", "at least two samples"),
    ] {
        let error = Path::from_csv(scratch_file(&format!("{name}.csv"), &text)).unwrap_err();
        assert!(matches!(error, Error::File { .. }), "{name}: {error:?}");
        let message = error.to_string();
        assert!(message.contains(line) && message.contains(cause), "{name}: {message}");
    }
    let missing = Path::from_csv("no/such/file.csv").unwrap_err().to_string();
    assert!(missing.contains("no/such/file.csv") && missing.contains("cannot be read"), "{missing}");
    assert!(Path::from_csv(env!("CARGO_TARGET_TMPDIR")).is_err(), "a folder is no file");
}

proptest! {
    #[test]
    fn any_bytes_are_read_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..200), mutate in any::<bool>()) {
        let mut text = b"x,y,z,qw,qx,qy,qz,t\n0,0,0,1,0,0,0,0\n0.1,0,0,0.6,0.8,0,0,1\n".to_vec();
        if mutate {
            for pair in bytes.chunks_exact(2).take(4) {
                let i = usize::from(pair[0]) % text.len();
                text[i] = pair[1];
            }
        } else {
            text = bytes;
        }
        let file = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("fuzz.csv");
        std::fs::write(&file, text).unwrap();
        if let Ok(path) = Path::from_csv(&file) {
            let middle = path.at(path.s()[0] + 0.5 * path.length());
            prop_assert!(middle.is_ok());
        }
    }

    #[test]
    fn timing_keeps_every_limit(seed in any::<u64>(), n in 1usize..8, rows in 2usize..60, w in 0usize..20) {
        let mut rng = rng(seed);
        let q: Vec<f64> = (0..n * rows).map(|_| rng.random_range(-3.0..3.0)).collect();
        let limits: Vec<f64> = (0..n).map(|_| rng.random_range(0.1..5.0)).collect();
        let settings = TimingSettings { smoothing: w, ..Default::default() };
        let t = times_within_limits(&q, &limits, settings).unwrap();
        let names = (0..n).map(|j| format!("j{j}")).collect();
        let trajectory = Trajectory::new(names, t.clone(), q.clone(), None, Vec::new()).unwrap();
        let mut least = 0.0;
        for i in 1..rows {
            let dt = t[i] - t[i - 1];
            let step = (0..n).map(|j| (q[i * n + j] - q[(i - 1) * n + j]).abs() / limits[j]).fold(0.0, f64::max);
            prop_assert!(step / dt <= 0.9 * (1.0 + 1e-9));
            least += step / 0.9;
        }
        prop_assert!(t[rows - 1] >= least * (1.0 - 1e-12));
        if w == 0 {
            prop_assert!(t[rows - 1] <= least * (1.0 + 1e-12));
        }
        for i in 0..rows {
            for j in 0..n {
                prop_assert!(trajectory.qd_row(i)[j].abs() <= 0.9 * limits[j] * (1.0 + 1e-9));
            }
        }
    }
}

#[test]
fn timing_refuses_what_has_no_answer() {
    let settings = TimingSettings::default();
    let error = times_within_limits(&[0.0, 0.0, 1.0, 0.0], &[f64::INFINITY, 1.0], settings).unwrap_err();
    assert!(error.to_string().contains("only joints without a velocity limit move (joint 0)"), "{error}");
    assert!(times_within_limits(&[0.0, 1.0, 2.0], &[1.0, 1.0], settings).is_err());
    assert!(times_within_limits(&[0.0, f64::NAN], &[1.0], settings).is_err());
    assert!(times_within_limits(&[0.0, 1.0], &[0.0], settings).is_err());
    assert!(times_within_limits(&[0.0, 1.0], &[], settings).is_err());
    for fraction in [0.0, -1.0, 1.1, f64::NAN] {
        let settings = TimingSettings { velocity_fraction: fraction, ..settings };
        assert!(times_within_limits(&[0.0, 1.0], &[1.0], settings).is_err());
    }
    // Rows in which nothing moves still follow each other.
    let t = times_within_limits(&[1.0, 1.0, 1.0], &[1.0], settings).unwrap();
    assert!(t[0] < t[1] && t[1] < t[2]);
}

fn sample_trajectory() -> Trajectory {
    let t = vec![0.0, 0.1, 0.3, 1.999_999_999_7];
    let q: Vec<f64> = (0..8).map(|i| (f64::from(i) * 0.7).sin() / 3.0).collect();
    let event = Event {
        kind: EventKind::Reconfiguration,
        index: 2,
        t: 0.3,
        s: 0.12,
        message: "to branch (+, -, +)".into(),
    };
    Trajectory::new(vec!["a, b".into(), "c\"d".into()], t, q, None, vec![event]).unwrap()
}

#[test]
fn trajectory_files_read_back() {
    let trajectory = sample_trajectory();
    let file = scratch_file("trajectory.csv", "");
    trajectory.to_csv(&file).unwrap();
    let read = Trajectory::from_csv(&file).unwrap();
    assert_eq!((read.t(), read.q(), read.qd()), (trajectory.t(), trajectory.q(), trajectory.qd()));
    assert_eq!(read.joint_names(), trajectory.joint_names());
    let file = scratch_file("trajectory.json", "");
    trajectory.to_json(&file).unwrap();
    let read = Trajectory::from_json(&file).unwrap();
    assert_eq!((read.q(), read.qd()), (trajectory.q(), trajectory.qd()));
    assert_eq!(read.events(), trajectory.events());
    for (a, b) in read.t().iter().zip(trajectory.t()) {
        assert!((a - b).abs() <= 0.5001e-9);
    }
    assert_eq!(read.t()[3], 2.0, "nanoseconds carry into seconds");
}

#[test]
fn json_carries_the_fields_of_ros() {
    let file = scratch_file("ros.json", "");
    sample_trajectory().to_json(&file).unwrap();
    let value: serde_json::Value = serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap();
    assert_eq!(value["joint_names"][0], "a, b");
    assert_eq!(value["points"][1]["time_from_start"]["sec"], 0);
    assert_eq!(value["points"][1]["time_from_start"]["nanosec"], 100_000_000);
    assert_eq!(value["points"][3]["velocities"].as_array().unwrap().len(), 2);
    assert_eq!(value["events"][0]["kind"], "reconfiguration");
}

#[test]
fn broken_trajectory_files_are_refused() {
    let csv =
        |text: &str| Trajectory::from_csv(scratch_file("bad_trajectory.csv", text)).unwrap_err().to_string();
    assert!(csv("t\n0\n").contains("bad_trajectory.csv:1: the header is 't'"));
    assert!(csv("t,a,b_velocity\n0,0,0\n").contains("expected t, the joint names"));
    assert!(csv("t,a,a_velocity\n0,0,0\n0,1,0\n").contains(":3: t is 0 after 0"));
    assert!(csv("t,a,a_velocity\n0,0,x\n").contains(":2: column 'a_velocity': 'x'"));
    let json = |text: &str| Trajectory::from_json(scratch_file("bad.json", text)).unwrap_err().to_string();
    assert!(json("{\n\"joint_names\": 3}").contains("bad.json:2"));
    assert!(json("{\"joint_names\": [\"a\"], \"points\": [{\"positions\": [0, 1], \"time_from_start\": {\"sec\": 0, \"nanosec\": 0}}]}").contains("point 0 has 2 numbers for 1 joints"));
    let event = "{\"joint_names\": [\"a\"], \"points\": [], \"events\": [{\"kind\": \"party\", \"index\": 0, \"t\": 0, \"s\": 0, \"message\": \"\"}]}";
    assert!(json(event).contains("unknown event kind 'party', expected one of: basis_change"));
}

#[test]
fn trajectories_refuse_what_makes_none() {
    let names = |n: usize| (0..n).map(|i| format!("j{i}")).collect::<Vec<_>>();
    let new = |names: Vec<String>, t: &[f64], q: &[f64], qd: Option<&[f64]>| {
        Trajectory::new(names, t.to_vec(), q.to_vec(), qd.map(<[f64]>::to_vec), Vec::new())
    };
    assert!(new(names(0), &[0.0], &[], None).is_err());
    assert!(new(vec!["a".into(), "a".into()], &[0.0], &[0.0, 0.0], None).is_err());
    assert!(new(names(2), &[0.0], &[0.0], None).is_err());
    assert!(new(names(1), &[0.0, 0.0], &[0.0, 1.0], None).is_err());
    assert!(new(names(1), &[0.0], &[f64::NAN], None).is_err());
    assert!(new(names(1), &[0.0], &[0.0], Some(&[])).is_err());
    let single = new(names(1), &[0.0], &[0.5], None).unwrap();
    assert_eq!(single.qd(), [0.0]);
    assert_eq!(new(names(1), &[], &[], None).unwrap().rows(), 0);
}
