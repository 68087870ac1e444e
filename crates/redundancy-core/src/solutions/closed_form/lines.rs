//! What recognising an arm by its axes needs, whatever the closed form.

use nalgebra::{Matrix3, Vector3};

use crate::chain::Chain;
use crate::solutions::AxisLine;

/// Angle in `[0, pi/2]` between two lines with these unit directions.
pub(super) fn angle_between(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    a.cross(b).norm().atan2(a.dot(b).abs())
}

/// Angle in `[0, pi]` between two unit vectors, exact also at both ends.
pub(super) fn angle_of(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    a.cross(b).norm().atan2(a.dot(b))
}

/// The point half-way between two lines that are not parallel, where they are nearest to each other, and the gap there.
pub(super) fn meeting(a: &AxisLine, b: &AxisLine) -> (Vector3<f64>, f64) {
    let (u, v) = (a.direction, b.direction);
    let d = b.point - a.point;
    let uv = u.dot(&v);
    // 1 - (u . v)^2, without cancellation.
    let squared = u.cross(&v).norm_squared();
    let on_a = a.point + u * ((d.dot(&u) - uv * d.dot(&v)) / squared);
    let on_b = b.point + v * ((uv * d.dot(&u) - d.dot(&v)) / squared);
    (0.5 * (on_a + on_b), (on_b - on_a).norm())
}

/// The point of a line at this coordinate along `m`, counted from `origin`.
pub(super) fn foot_at(
    line: &AxisLine,
    m: &Vector3<f64>,
    origin: &Vector3<f64>,
    coordinate: f64,
) -> Vector3<f64> {
    line.point + line.direction * ((coordinate - (line.point - origin).dot(m)) / line.direction.dot(m))
}

/// Says which joint does not turn; `None` when all do.
pub(super) fn not_turning(chain: &Chain) -> Option<String> {
    let joint = chain.joints().iter().find(|j| !j.kind.is_rotational())?;
    Some(format!("joint '{}' is {}, all joints must be revolute", joint.name, joint.kind.as_str()))
}

/// The point nearest to three lines (least squares); `None` where they are parallel.
pub(super) fn common_point(lines: &[AxisLine]) -> Option<Vector3<f64>> {
    let first = lines.first()?.point;
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for line in lines {
        let across = Matrix3::identity() - line.direction * line.direction.transpose();
        normal += across;
        right += across * (line.point - first);
    }
    normal.cholesky().map(|factor| first + factor.solve(&right))
}
