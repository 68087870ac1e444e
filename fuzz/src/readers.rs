//! Readers: no panic, the same answer twice, a message that names something, and accepted input is legal and comes back.

use std::fmt::Debug;
use std::path::PathBuf;

use redundancy_core::chain::{Chain, ChainBuilder, DhConvention, DhRow, MissingLimits};
use redundancy_core::path::{Path, Trajectory};
use redundancy_core::scene::{Scene, Srdf, TriangleMesh};
use redundancy_core::solutions::closed_form;
use redundancy_core::{Pose, Result};

use crate::Numbers;

/// No refusal says more than this: a message must not repeat a whole file.
const LONGEST_MESSAGE: usize = 10_000;
/// Lengths above this, m, leave so few digits that nothing is asked of the pose.
const SENSIBLE: f64 = 1e3;

/// The value, after checks of the refusal.
fn accepted<T>(result: Result<T>) -> Option<T> {
    match result {
        Ok(value) => Some(value),
        Err(error) => {
            let message = error.to_string();
            assert!(
                !message.is_empty() && message.len() <= LONGEST_MESSAGE,
                "message of {} bytes",
                message.len()
            );
            None
        }
    }
}

/// Both refused with the same message, or both accepted.
fn same<T>(first: &Result<T>, second: &Result<T>) {
    let text = |r: &Result<T>| r.as_ref().err().map(ToString::to_string);
    assert_eq!(text(first), text(second));
}

/// A file of this process in memory, with these bytes.
fn file(name: &str, bytes: &[u8]) -> PathBuf {
    let folder =
        if std::path::Path::new("/dev/shm").is_dir() { "/dev/shm".into() } else { std::env::temp_dir() };
    let path = folder.join(format!("redundancy-fuzz-{}-{name}", std::process::id()));
    std::fs::write(&path, bytes).expect("a file can be written");
    path
}

/// The chain has legal limits, its frames are rigid and finite where its lengths are sensible.
fn legal_chain(chain: &Chain) {
    assert!(chain.dof() > 0 && chain.joints().len() == chain.dof());
    for joint in chain.joints() {
        let limits = &joint.limits;
        assert!(limits.lower <= limits.upper, "{:?}", limits);
        assert!(limits.velocity > 0.0 && limits.effort > 0.0 && limits.acceleration > 0.0, "{:?}", limits);
    }
    let q: Vec<f64> = chain.joints().iter().map(|j| 0.3_f64.clamp(j.limits.lower, j.limits.upper)).collect();
    let pose = chain.forward(&q).expect("a configuration within limits");
    if pose.translation.vector.amax() < SENSIBLE {
        rigid(&pose);
    }
}

fn rigid(pose: &Pose) {
    let r = pose.rotation.matrix();
    let defect = (r.transpose() * r - nalgebra_identity()).amax();
    assert!(defect < 1e-9, "R^T R - 1 is {defect:e}");
    assert!(pose.translation.vector.iter().all(|x| x.is_finite()));
}

fn nalgebra_identity() -> redundancy_core::nalgebra::Matrix3<f64> {
    redundancy_core::nalgebra::Matrix3::identity()
}

/// Chains from URDF.
pub fn urdf(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let read = |missing| Chain::from_urdf_string(text, None, None, missing);
    let strict = read(MissingLimits::Refuse);
    same(&strict, &read(MissingLimits::Refuse));
    let lenient = accepted(read(MissingLimits::Unbounded));
    if let Some(chain) = accepted(strict) {
        legal_chain(&chain);
        let again = lenient.expect("what the strict reader accepts, the lenient one does");
        assert_eq!(chain.dof(), again.dof());
        let q: Vec<f64> =
            chain.joints().iter().map(|j| 0.1_f64.clamp(j.limits.lower, j.limits.upper)).collect();
        let _ = accepted(chain.collision_from_urdf_string(text, &[]));
        assert_eq!(chain.forward(&q).is_ok(), again.forward(&q).is_ok());
    }
}

/// Allowed pairs from SRDF.
pub fn srdf(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let (first, second) = (Srdf::from_xml(text), Srdf::from_xml(text));
    same(&first, &second);
    if let (Some(a), Some(b)) = (accepted(first), accepted(second)) {
        assert_eq!(a, b);
    }
}

/// Triangle meshes; the first byte chooses the format.
pub fn mesh(data: &[u8]) {
    let Some((kind, bytes)) = data.split_first() else { return };
    let format = ["stl", "obj", "dae"][usize::from(*kind) % 3];
    let first = TriangleMesh::from_bytes(format, bytes);
    same(&first, &TriangleMesh::from_bytes(format, bytes));
    let Some(mesh) = accepted(first) else { return };
    assert!(!mesh.faces().is_empty() && !mesh.vertices().is_empty());
    assert!(mesh.vertices().iter().flatten().all(|x| x.is_finite()), "a vertex that is not finite");
    let count = mesh.vertices().len();
    assert!(
        mesh.faces().iter().flatten().all(|i| (*i as usize) < count),
        "a face of a vertex that does not exist"
    );
    if mesh.vertices().iter().flatten().all(|x| x.abs() < SENSIBLE) {
        assert!(mesh.volume().is_finite());
    }
    let _ = mesh.is_closed();
}

/// Paths from CSV, and back.
pub fn path_csv(data: &[u8]) {
    let name = file("path.csv", data);
    let first = Path::from_csv(&name);
    same(&first, &Path::from_csv(&name));
    let Some(path) = accepted(first) else { return };
    assert!(path.len() >= 2 && path.poses().len() == path.len());
    assert!(path.s().windows(2).all(|w| w[0] <= w[1]), "arc lengths that decrease"); // equal: turns on the spot
    assert!(path.t().is_none_or(|t| t.windows(2).all(|w| w[0] < w[1])), "times that do not increase");
    path.poses().iter().for_each(rigid);
    path.to_csv(&name).expect("an accepted path can be written");
    let again = Path::from_csv(&name).expect("a written path can be read");
    for (a, b) in path.poses().iter().zip(again.poses()) {
        let scale = 1.0 + a.translation.vector.amax();
        assert!((a.translation.vector - b.translation.vector).amax() <= 1e-12 * scale);
        assert!((a.rotation.matrix() - b.rotation.matrix()).amax() < 1e-9);
    }
}

/// Scenes from JSON, and back.
pub fn scene_json(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let first = Scene::from_json(text);
    same(&first, &Scene::from_json(text));
    let Some(scene) = accepted(first) else { return };
    let again = Scene::from_json(&scene.to_json()).expect("a written scene can be read");
    assert_eq!(scene.obstacles().len(), again.obstacles().len());
    assert_eq!(scene.allowed(), again.allowed());
    let text = scene.to_json();
    let twice = Scene::from_json(&again.to_json()).expect("a scene that was written twice can be read");
    // Normalised quaternions may still move by a last digit the first time.
    assert_eq!(again.to_json().len().abs_diff(twice.to_json().len()) <= text.len(), true);
}

/// Trajectories from JSON, and back.
pub fn trajectory_json(data: &[u8]) {
    let name = file("trajectory.json", data);
    let first = Trajectory::from_json(&name);
    same(&first, &Trajectory::from_json(&name));
    let Some(trajectory) = accepted(first) else { return };
    let n = trajectory.dof();
    assert_eq!(trajectory.q().len(), n * trajectory.rows());
    assert_eq!(trajectory.qd().len(), n * trajectory.rows());
    assert_eq!(trajectory.joint_names().len(), n);
    assert!(trajectory.q().iter().chain(trajectory.qd()).chain(trajectory.t()).all(|x| x.is_finite()));
    assert!(
        trajectory.t().windows(2).all(|w| w[0] < w[1]),
        "times that do not increase: {:?}",
        trajectory.t()
    );
    trajectory.to_json(&name).expect("an accepted trajectory can be written");
    let again = Trajectory::from_json(&name).expect("a written trajectory can be read");
    assert_eq!(again.q(), trajectory.q());
    equal_lists(again.joint_names(), trajectory.joint_names());
}

fn equal_lists<T: PartialEq + Debug>(a: &[T], b: &[T]) {
    assert_eq!(a, b);
}

/// Arms from Denavit-Hartenberg rows of any numbers. Where a closed form recognises one, it gives back its poses.
pub fn dh(data: &[u8]) {
    let mut numbers = Numbers::new(data);
    let kind = numbers.byte();
    let convention = if kind & 1 == 0 { DhConvention::Standard } else { DhConvention::Modified };
    let count = 1 + usize::from(kind >> 1) % 8;
    let raw = kind & 0x40 != 0;
    let length = |n: &mut Numbers| if raw { n.raw() } else { (n.unit() * 16.0).round() / 16.0 };
    let angle = |n: &mut Numbers| {
        if raw { n.raw() } else { f64::from(n.byte() as i8 / 32) * std::f64::consts::FRAC_PI_2 }
    };
    let rows: Vec<DhRow> = (0..count)
        .map(|_| DhRow {
            a: length(&mut numbers),
            d: length(&mut numbers),
            alpha: angle(&mut numbers),
            theta: angle(&mut numbers),
        })
        .collect();
    let Some(chain) = accepted(ChainBuilder::from_dh("arm", &rows, convention).build()) else { return };
    let q: Vec<f64> = (0..count).map(|_| numbers.unit() * 3.0).collect();
    let pose = chain.forward(&q).expect("finite angles");
    if rows.iter().any(|r| [r.a, r.d, r.alpha, r.theta].iter().any(|x| x.abs() > SENSIBLE)) {
        return;
    }
    rigid(&pose);
    if let Some(form) = closed_form(&chain) {
        crate::numeric::over_pose(form.as_ref(), &pose, &format!("{rows:?}, {convention:?}, q = {q:?}"));
    }
}
