//! Charts of the swivel: which direction on the elbow's circle is called `s = 0`.
//!
//! With `n` from shoulder to wrist, a chart is a pair `w0(n), w1(n) = n x w0(n)` of unit vectors perpendicular to `n`;
//! the elbow lies towards `cos s w0 + sin s w1`. No chart is continuous for every `n` (a field of tangents of the
//! sphere has a zero), each is singular somewhere:
//!
//! - **Shortest arc** [Moore2010, eqs (13)-(15)]: `w0, w1` are the x and y axes of the frame `[x, y, k]` carried by
//!   the shortest rotation from `k` to `n`,
//!   `w0 = (1 - x^2/c, -xy/c, -x)`, `w1 = (-xy/c, 1 - y^2/c, -y)`, `c = 1 + z` for `n = (x, y, z)` in that frame.
//!   Singular at `n = -k`: on approach with heading `psi` the chart turns by `2 psi`.
//! - **Stereographic** [EliasWen2023]: `w0` along `((n - t) x x) x n`, singular only on the half-line `t`, which the
//!   user puts where the wrist never goes. Written out it is the shortest-arc chart of `k = -t` (both carry the
//!   parallels of the stereographic projection from the singular point), so one formula serves both; they differ in
//!   which direction the user names.
//!
//! At the singular direction itself `w0` is defined as the limit on approach along +x, and nothing is NaN.

use nalgebra::{Matrix3, Vector3};

use super::geometry::swivel_frame;
use crate::error::{Error, Result};
use crate::tolerance::DIRECTION_NORM;

/// Which direction on the elbow's circle is `s = 0`. See the module for the formulas.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Chart {
    /// The paper's shortest rotation from a reference direction (world axes, any length); `None` is joint axis 1.
    ShortestArc(Option<Vector3<f64>>),
    /// Singular only on the half-line from the shoulder along this direction (world axes, any length); `None` is
    /// against joint axis 1.
    Stereographic(Option<Vector3<f64>>),
}

impl Default for Chart {
    /// The paper's: shortest arc from joint axis 1.
    fn default() -> Self {
        Self::ShortestArc(None)
    }
}

impl Chart {
    /// The frame `[x, y, z]` in the world whose z is carried onto `n`.
    pub(super) fn frame(&self, axis1: &Vector3<f64>, base: &Matrix3<f64>) -> Result<Matrix3<f64>> {
        let (direction, sign) = match self {
            Self::ShortestArc(None) | Self::Stereographic(None) => (*axis1, 1.0),
            Self::ShortestArc(Some(reference)) => (*reference, 1.0),
            Self::Stereographic(Some(half_line)) => (*half_line, -1.0),
        };
        crate::error::check_finite("reference", direction.as_slice())?;
        let norm = direction.norm();
        if norm < DIRECTION_NORM {
            let what = "reference".to_string();
            return Err(Error::ZeroDirection { what, norm, minimum: DIRECTION_NORM });
        }
        Ok(swivel_frame(&(sign * direction / norm), base))
    }
}

/// `w0` of the chart whose frame is the coordinate frame, for the unit vector `n` in it; `w1 = n x w0`.
pub(super) fn zero_direction(n: &Vector3<f64>) -> Vector3<f64> {
    let (x, y, z) = (n.x, n.y, n.z);
    if z > 0.0 {
        let c = 1.0 + z;
        return Vector3::new(1.0 - x * x / c, -x * y / c, -x);
    }
    // 1 + z without cancellation.
    let r = x * x + y * y;
    if r == 0.0 {
        return Vector3::new(-1.0, 0.0, 0.0);
    }
    let c = r / (1.0 - z);
    Vector3::new(1.0 - x * x / c, -x * y / c, -x)
}
