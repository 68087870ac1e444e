//! Paths that are moved, run backwards and joined.

use redundancy_core::nalgebra::{Rotation3, Translation3, Vector3, Vector6};
use redundancy_core::path::{Circle, Path, PathPiece, PathPoint, Raster, Shape};
use redundancy_core::{Pose, rotation_from_matrix};

use crate::support::{random_pose, rng};

fn spline() -> Path {
    let poses: Vec<Pose> = (0..25)
        .map(|i| {
            let s = 0.1 * f64::from(i);
            let position = Vector3::new(s.sin(), (0.7 * s).cos(), 0.3 * s);
            let turn = Rotation3::new(Vector3::new(0.4 * s, 0.3 * s.sin(), 0.2 * s * s));
            Pose::from_parts(Translation3::from(position), turn)
        })
        .collect();
    let t: Vec<f64> = (0..25).map(|i| 2.0 + 0.1 * f64::from(i * i + i)).collect();
    Path::new(&poses, None, Some(&t)).unwrap()
}

fn turned(path: &Path) -> Path {
    let turns: Vec<_> = (0..path.len())
        .map(|i| Rotation3::new(Vector3::new(0.01 * i as f64, 0.4, 0.002 * i as f64)))
        .collect();
    path.with_orientations(&turns).unwrap()
}

fn raster(strokes: usize, corner: Option<f64>) -> Path {
    let (along, across) = (Vector3::new(1.0, 2.0, 0.5), Vector3::new(2.0, -1.0, 0.0));
    let raster = Raster::new(Vector3::new(0.1, 0.2, 0.3), 0.5, 0.2, strokes, corner, along, across).unwrap();
    raster.path(0.01).unwrap()
}

fn circle(normal: Vector3<f64>, turns: f64) -> Path {
    Circle::new(Vector3::new(0.4, -0.1, 0.3), 0.15, 0.7, turns, normal).unwrap().path(60).unwrap()
}

fn paths() -> Vec<Path> {
    let cornered = raster(4, Some(0.1));
    vec![
        spline(),
        Path::from_positions(
            &spline().poses().iter().map(|p| p.translation.vector).collect::<Vec<_>>(),
            None,
            None,
        )
        .unwrap(),
        circle(Vector3::new(0.3, -0.5, 0.8), 1.3),
        turned(&circle(-Vector3::z(), -0.6)),
        turned(&cornered),
        raster(3, Some(0.1)),
        raster(3, None),
        turned(&raster(2, None)),
        raster(1, None),
        circle(Vector3::y(), 0.5).resampled(0.03).unwrap(),
        turned(&circle(Vector3::y(), 0.5)).joined(&spline().with_times(None).unwrap()).unwrap(),
    ]
}

/// Where the path is smooth: corners have a derivative on either side.
fn smooth(path: &Path) -> Vec<f64> {
    let (first, length) = (path.s()[0], path.length());
    (1..200).map(|i| first + length * (f64::from(i) + 0.123) / 200.2).collect()
}

fn same(a: &PathPoint, b: &PathPoint, tolerance: f64) {
    let size = 1.0 + a.second_derivative.norm();
    assert!((a.pose.to_homogeneous() - b.pose.to_homogeneous()).amax() < tolerance, "{} {}", a.pose, b.pose);
    assert!((a.derivative - b.derivative).amax() < tolerance * size, "{} {}", a.derivative, b.derivative);
    assert!((a.second_derivative - b.second_derivative).amax() < 1e4 * tolerance * size * size);
}

#[test]
fn a_moved_path_is_the_path_seen_from_elsewhere() {
    let mut rng = rng(31);
    for path in paths() {
        let by = random_pose(&mut rng, 2.0);
        let moved = path.transformed(&by).unwrap();
        let kind = |path: &Path| path.pieces().map(|p| std::mem::discriminant(&p.shape)).collect::<Vec<_>>();
        assert_eq!(kind(&moved), kind(&path));
        assert_eq!(
            (moved.s(), moved.t(), moved.has_orientation()),
            (path.s(), path.t(), path.has_orientation())
        );
        let expected = |mut point: PathPoint| {
            point.pose = match path.has_orientation() {
                true => by * point.pose,
                false => Pose::from_parts((by * point.pose).translation, Rotation3::identity()),
            };
            let turned = |v: Vector6<f64>| {
                let (a, b) = (by.rotation * v.fixed_rows::<3>(0), by.rotation * v.fixed_rows::<3>(3));
                Vector6::new(a.x, a.y, a.z, b.x, b.y, b.z)
            };
            point.derivative = turned(point.derivative);
            point.second_derivative = turned(point.second_derivative);
            point
        };
        for s in smooth(&path) {
            same(&moved.at(s).unwrap(), &expected(path.at(s).unwrap()), 1e-13);
        }
        for (sample, pose) in moved.poses().iter().zip(path.poses()) {
            let expected = (by * pose).translation.vector;
            assert!((sample.translation.vector - expected).norm() < 1e-15);
        }
    }
}

#[test]
fn a_reversed_path_is_the_path_run_backwards() {
    for path in paths() {
        let (back, n) = (path.reversed().unwrap(), path.len());
        assert_eq!((back.s()[0], back.s()[n - 1]), (path.s()[0], path.s()[n - 1]));
        assert!(back.poses().iter().eq(path.poses().iter().rev()));
        let sum = path.s()[0] + path.s()[n - 1];
        for s in smooth(&path) {
            let (here, there) = (back.at(sum - s).unwrap(), path.at(s).unwrap());
            let turned = PathPoint { derivative: -there.derivative, ..there };
            same(&here, &turned, 1e-12);
        }
        if let (Some(t), Some(before)) = (back.t(), path.t()) {
            assert_eq!((t[0], t[n - 1]), (before[0], before[n - 1]));
            for i in 1..n {
                assert!((t[i] - t[i - 1] - (before[n - i] - before[n - 1 - i])).abs() < 1e-14);
            }
        }
        let again = back.reversed().unwrap();
        for s in smooth(&path) {
            same(&again.at(s).unwrap(), &path.at(s).unwrap(), 1e-12);
        }
    }
    assert!(matches!(raster(4, Some(0.1)).reversed().unwrap().shape(), Shape::Raster(_)));
    assert!(matches!(circle(Vector3::x(), 0.3).reversed().unwrap().shape(), Shape::Circle(_)));
}

#[test]
fn joined_paths_keep_their_curves() {
    let first = raster(3, Some(0.1));
    let end = first.poses()[first.len() - 1].translation.vector;
    // A circle that begins where the raster ends.
    let start = circle(Vector3::z(), 1.0).poses()[0].translation.vector;
    let by = Pose::from_parts(Translation3::from(end - start), Rotation3::identity());
    let second = circle(Vector3::z(), 1.0).transformed(&by).unwrap();
    let joined = first.joined(&second).unwrap();
    assert_eq!(joined.len(), first.len() + second.len() - 1);
    assert_eq!(joined.pieces().count(), 2);
    assert_eq!(joined.shape(), &Shape::Joined);
    assert!((joined.length() - first.length() - second.length()).abs() < 1e-15);
    for s in smooth(&first) {
        same(&joined.at(s).unwrap(), &first.at(s).unwrap(), 1e-15);
    }
    for s in smooth(&second) {
        same(&joined.at(first.length() + s).unwrap(), &second.at(s).unwrap(), 1e-12);
    }
    // At the corner the derivatives are those of what follows; resampling keeps the corner.
    let corner = joined.at(first.length()).unwrap();
    assert!((corner.derivative - second.at(0.0).unwrap().derivative).norm() < 1e-12);
    let fine = joined.resampled(0.0031).unwrap();
    assert_eq!(fine.pieces().count(), 2);
    assert!(fine.s().contains(&first.length()));
    for s in smooth(&joined) {
        same(&fine.at(s).unwrap(), &joined.at(s).unwrap(), 1e-13);
    }
    // All of it once more.
    let twice = joined.joined(&joined.reversed().unwrap()).unwrap();
    assert_eq!(twice.pieces().count(), 4);
    for s in smooth(&joined) {
        let back = twice.at(twice.length() - s).unwrap();
        assert!(
            (back.pose.translation.vector - joined.at(s).unwrap().pose.translation.vector).norm() < 1e-12
        );
    }
}

#[test]
fn a_gap_is_bridged_by_a_straight_line_with_a_steady_turn() {
    let here = turned(&circle(Vector3::z(), 0.5));
    let there =
        here.transformed(&Pose::new(Vector3::new(0.0, 0.6, 0.8), Vector3::new(0.0, 0.0, 0.3))).unwrap();
    let joined = here.joined(&there).unwrap();
    let n = here.len();
    assert_eq!((joined.len(), joined.pieces().count()), (2 * n, 3));
    let (a, b) = (joined.poses()[n - 1], joined.poses()[n]);
    let gap = (b.translation.vector - a.translation.vector).norm();
    assert!((joined.s()[n] - joined.s()[n - 1] - gap).abs() < 1e-15);
    for i in 1..20 {
        let share = f64::from(i) / 20.0;
        let point = joined.at(here.length() + share * gap).unwrap();
        let expected = a.translation.vector.lerp(&b.translation.vector, share);
        assert!((point.pose.translation.vector - expected).norm() < 1e-14);
        assert!((point.derivative.fixed_rows::<3>(0).norm() - 1.0).abs() < 1e-13);
        // The chord of two quaternions 0.67 rad apart, projected on the sphere: within 2e-3 of the steady turn.
        let turn = a.rotation.slerp(&b.rotation, share);
        assert!(turn.angle_to(&point.pose.rotation) < 2e-3);
    }
}

#[test]
fn times_of_joined_paths_follow_each_other() {
    let path = spline();
    let n = path.len();
    let back = path.joined(&path.reversed().unwrap()).unwrap();
    let (t, one) = (back.t().unwrap(), path.t().unwrap());
    assert_eq!(&t[..n], one);
    assert!((t[2 * n - 2] - t[0] - 2.0 * (one[n - 1] - one[0])).abs() < 1e-12);
    // A gap needs time.
    let apart = path.transformed(&Pose::translation(0.0, 0.0, 1.0)).unwrap();
    let error = path.joined(&apart).unwrap_err().to_string();
    assert!(error.contains("apart") && error.contains("with_times"), "{error}");
    let later: Vec<f64> = one.iter().map(|t| t + 100.0).collect();
    let late = path.joined(&apart.with_times(Some(&later)).unwrap()).unwrap();
    assert_eq!(&late.t().unwrap()[n..], &later[..]);
    let error = path.joined(&apart.with_times(None).unwrap()).unwrap_err().to_string();
    assert!(error.contains("only one of the two paths has times"), "{error}");
    let error = path.joined(&circle(Vector3::z(), 1.0)).unwrap_err().to_string();
    assert!(error.contains("only one of the two paths has orientations"), "{error}");
}

#[test]
fn a_path_is_made_of_its_pieces_again() {
    for path in paths() {
        let path = path.transformed(&random_pose(&mut rng(5), 1.0)).unwrap().reversed().unwrap();
        let pieces: Vec<PathPiece> = path.pieces().cloned().collect();
        let again =
            Path::from_pieces(path.poses(), path.has_orientation(), path.s(), path.t(), pieces.clone())
                .unwrap();
        assert_eq!(again, path);
        let mut other = pieces.clone();
        other[0].last -= 1;
        assert!(Path::from_pieces(path.poses(), true, path.s(), None, other).is_err());
        assert!(Path::from_pieces(path.poses(), true, path.s(), None, Vec::new()).is_err());
    }
    let path = circle(Vector3::z(), 1.0);
    let mut pieces: Vec<PathPiece> = path.pieces().cloned().collect();
    pieces[0].shift = 0.01;
    let error = Path::from_pieces(path.poses(), false, path.s(), None, pieces).unwrap_err().to_string();
    assert!(error.contains("away from the shape"), "{error}");
}

#[test]
fn rotations_that_are_nearly_orthonormal_are_replaced_by_the_nearest() {
    let exact = Rotation3::new(Vector3::new(0.3, -1.2, 0.8));
    for size in [3e-6, 1e-4, 4e-4] {
        let noise = redundancy_core::nalgebra::Matrix3::new(0.3, -0.8, 0.5, 0.9, 0.2, -0.4, 0.1, 0.7, -1.0);
        let off = exact.matrix() + noise * size;
        let near = rotation_from_matrix("R", &off).unwrap();
        let r = near.matrix();
        assert!((r.transpose() * r - Rotation3::identity().matrix()).amax() < 1e-15);
        // The nearest rotation: the rest is symmetric in its axes.
        let rest = r.transpose() * off;
        assert!((rest - rest.transpose()).amax() < 1e-15);
        let pose = Pose::from_parts(Translation3::identity(), Rotation3::from_matrix_unchecked(off));
        let path = Path::new(&[pose, Pose::translation(1.0, 0.0, 0.0)], None, None).unwrap();
        assert_eq!(path.poses()[0].rotation, near);
    }
    let far = rotation_from_matrix("R", &(exact.matrix() * 1.002)).unwrap_err().to_string();
    assert!(
        far.contains("R is not a rigid transform") && far.contains("0.002") && far.contains("1e-3"),
        "{far}"
    );
    let mirrored = rotation_from_matrix("R", &-exact.matrix()).unwrap_err().to_string();
    assert!(
        mirrored.contains("reflection") && mirrored.contains("is -") && mirrored.contains("must be 1"),
        "{mirrored}"
    );
}
