//! The tool's motion along the path as a function of tilt, spin and arc length, with exact derivatives.
//!
//! Orientation `R = N(s) exp([e_x, e_y, 0]) Rz(psi)`: `N` the orientation of the path, whose z is the cone's axis; `e` a
//! rotation vector across it, so that the tilt is `|e|` and the cone is a disc; `psi` the spin. The tool turns with
//! `omega = omega_N + A u'` for `u = (e_x, e_y, psi)`, where
//!
//! `A = N [J e_1, J e_2, exp(e) z]`, `J = 1 + a(x) [e] + b(x) [e]^2`, `x = |e|^2`,
//!
//! `a = (1 - cos r) / x`, `b = (r - sin r) / r^3`, `r = sqrt x`: entire functions of x, used as power series, so that nothing is
//! singular at `e = 0`. `A'` and `A''` follow by Taylor arithmetic.

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3, Vector4};

use crate::path::{Path, QuinticSpline, Shape};
use crate::planning::tool_down;
use crate::tolerance::PATH_SAME_ORIENTATION;

/// Value, first and second derivative along the path.
#[derive(Debug, Clone, Copy)]
pub(super) struct Jet(pub f64, pub f64, pub f64);

impl std::ops::Add for Jet {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self(self.0 + o.0, self.1 + o.1, self.2 + o.2)
    }
}

impl std::ops::Neg for Jet {
    type Output = Self;
    fn neg(self) -> Self {
        Self(-self.0, -self.1, -self.2)
    }
}

impl std::ops::Mul for Jet {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        Self(self.0 * o.0, self.1 * o.0 + self.0 * o.1, self.2 * o.0 + 2.0 * self.1 * o.1 + self.0 * o.2)
    }
}

/// Terms of the power series: for tilts below a right angle (x < 2.5) the last one is below 1e-17.
const TERMS: usize = 14;

/// `sum_k (-x)^k m! / (2k + m)!` for m = `first`, so that the series is 1 at x = 0.
fn series(x: Jet, first: usize) -> Jet {
    let mut coefficients = [1.0; TERMS];
    for k in 1..TERMS {
        let n = (2 * k + first) as f64;
        coefficients[k] = -coefficients[k - 1] / (n * (n - 1.0));
    }
    let (mut f, mut d, mut dd) = (0.0, 0.0, 0.0);
    for c in coefficients.iter().rev() {
        dd = dd * x.0 + 2.0 * d;
        d = d * x.0 + f;
        f = f * x.0 + c;
    }
    Jet(f, d * x.1, dd * x.1 * x.1 + d * x.2)
}

/// Path coordinates: position, orientation and their rates.
#[derive(Debug, Clone, Copy)]
pub(super) struct CurvePoint {
    pub position: [Vector3<f64>; 3],
    pub rotation: Matrix3<f64>,
    pub turn: [Vector3<f64>; 2],
}

/// The tool's orientation and how it turns.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turned {
    pub rotation: Rotation3<f64>,
    pub omega: Vector3<f64>,
    pub omega_rate: Vector3<f64>,
    /// `A`, `A'`, `A''`.
    pub by_u: [Matrix3<f64>; 3],
}

/// A path as a C4 curve.
#[derive(Debug, Clone)]
pub(super) struct Curve {
    path: Path,
    positions: Option<QuinticSpline<3>>,
    orientations: Option<QuinticSpline<4>>,
    constant: Matrix3<f64>,
}

impl Curve {
    pub fn new(path: &Path) -> Self {
        let n = path.len();
        let s = path.s();
        let knots: Vec<usize> = (0..n).filter(|i| *i == 0 || s[*i] > s[*i - 1]).collect();
        let sites: Vec<f64> = knots.iter().map(|i| s[*i]).collect();
        let poses = path.poses();
        let positions = match path.shape() {
            Shape::Spline => {
                let values: Vec<_> = knots.iter().map(|i| poses[*i].translation.vector).collect();
                QuinticSpline::new(&sites, &values)
            }
            _ => None,
        };
        let first = if path.has_orientation() { poses[0].rotation } else { tool_down() };
        let moves = path.has_orientation()
            && poses.iter().any(|p| (p.rotation.matrix() - first.matrix()).amax() > PATH_SAME_ORIENTATION);
        let orientations = if moves {
            let mut last = Vector4::zeros();
            let values: Vec<_> = knots
                .iter()
                .map(|i| {
                    let q = UnitQuaternion::from_rotation_matrix(&poses[*i].rotation);
                    let q = Vector4::new(q.i, q.j, q.k, q.w);
                    last = if q.dot(&last) < 0.0 { -q } else { q };
                    last
                })
                .collect();
            QuinticSpline::new(&sites, &values)
        } else {
            None
        };
        Self { path: path.clone(), positions, orientations, constant: *first.matrix() }
    }

    pub fn ends(&self) -> (f64, f64) {
        let s = self.path.s();
        (s[0], s[s.len() - 1])
    }

    /// The curve at `s`, which lies on it.
    pub fn at(&self, s: f64) -> CurvePoint {
        let position = match &self.positions {
            Some(spline) => spline.at(s),
            None => self.path.at(s).map_or([Vector3::zeros(); 3], |point| {
                let part = |v: &nalgebra::Vector6<f64>| v.fixed_rows::<3>(0).into_owned();
                [point.pose.translation.vector, part(&point.derivative), part(&point.second_derivative)]
            }),
        };
        let (rotation, turn) = match &self.orientations {
            None if self.path.has_orientation() && self.moves_without_spline() => {
                self.path.at(s).map_or((self.constant, [Vector3::zeros(); 2]), |point| {
                    let part = |v: &nalgebra::Vector6<f64>| v.fixed_rows::<3>(3).into_owned();
                    let turn = [part(&point.derivative), part(&point.second_derivative)];
                    (*point.pose.rotation.matrix(), turn)
                })
            }
            None => (self.constant, [Vector3::zeros(); 2]),
            Some(spline) => {
                let [v, d, dd] = spline.at(s);
                let norm = v.norm();
                let q = Quaternion::from(v) / norm;
                let along = v.dot(&d) / (norm * norm);
                // As for cubic paths: what lies along Q only adds to the scalar part.
                let turn = |d: &Vector4<f64>| 2.0 * (Quaternion::from(*d) * q.conjugate()).imag() / norm;
                let rotation = UnitQuaternion::new_unchecked(q).to_rotation_matrix();
                (*rotation.matrix(), [turn(&d), turn(&(dd - d * (2.0 * along)))])
            }
        };
        CurvePoint { position, rotation, turn }
    }

    /// Fewer than six samples with different orientations: the cubic curve of the path.
    fn moves_without_spline(&self) -> bool {
        self.path.len() < crate::path::QUINTIC_SAMPLES
    }
}

impl CurvePoint {
    /// Orientation and turning for `u = (e_x, e_y, psi)` and its derivatives.
    pub fn turned(&self, u: [[f64; 3]; 3]) -> Turned {
        let jet = |i: usize| Jet(u[0][i], u[1][i], u[2][i]);
        let (x, y) = (jet(0), jet(1));
        let r2 = x * x + y * y;
        let half = |j: Jet| Jet(0.5 * j.0, 0.5 * j.1, 0.5 * j.2);
        let sixth = |j: Jet| Jet(j.0 / 6.0, j.1 / 6.0, j.2 / 6.0);
        let a = half(series(r2, 2));
        let b = sixth(series(r2, 3));
        let sinc = series(r2, 1);
        let cos = series(r2, 0);
        let one = Jet(1.0, 0.0, 0.0);
        let bxy = b * x * y;
        let columns = [
            [one + -(b * y * y), bxy, -(a * y)],
            [bxy, one + -(b * x * x), a * x],
            [y * sinc, -(x * sinc), cos],
        ];
        let pick = |f: &dyn Fn(&Jet) -> f64| Matrix3::from_fn(|row, column| f(&columns[column][row]));
        let n = &self.rotation;
        let [l, d, dd] = [n * pick(&|j| j.0), n * pick(&|j| j.1), n * pick(&|j| j.2)];
        let [w, w_rate] = self.turn;
        let cross = w.cross_matrix();
        let first = cross * l + d;
        let second = w_rate.cross_matrix() * l + cross * (cross * l) + (cross * d) * 2.0 + dd;
        let vector = |i: usize| Vector3::from(u[i]);
        let tilt = Matrix3::new(
            1.0 - a.0 * y.0 * y.0,
            a.0 * x.0 * y.0,
            sinc.0 * y.0,
            a.0 * x.0 * y.0,
            1.0 - a.0 * x.0 * x.0,
            -sinc.0 * x.0,
            -sinc.0 * y.0,
            sinc.0 * x.0,
            cos.0,
        );
        let (sin_psi, cos_psi) = u[0][2].sin_cos();
        let spin = Matrix3::new(cos_psi, -sin_psi, 0.0, sin_psi, cos_psi, 0.0, 0.0, 0.0, 1.0);
        Turned {
            rotation: Rotation3::from_matrix_unchecked(n * tilt * spin),
            omega: w + l * vector(1),
            omega_rate: w_rate + first * vector(1) + l * vector(2),
            by_u: [l, first, second],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::rotation_vector;

    /// A smooth motion of path frame, tilt and spin.
    fn motion(s: f64) -> (CurvePoint, [[f64; 3]; 3]) {
        let axis = Vector3::new(0.3, -0.5, 0.8).normalize();
        let angle = |s: f64| (0.4 * (1.3 * s).sin(), 0.52 * (1.3 * s).cos(), -0.676 * (1.3 * s).sin());
        let (turn, rate, second) = angle(s);
        let point = CurvePoint {
            position: [Vector3::zeros(); 3],
            rotation: *Rotation3::new(axis * turn).matrix(),
            turn: [axis * rate, axis * second],
        };
        let u = [
            [0.5 * s.sin(), 0.3 * s.cos() - 0.3, 2.0 * s + s * s],
            [0.5 * s.cos(), -0.3 * s.sin(), 2.0 + 2.0 * s],
            [-0.5 * s.sin(), -0.3 * s.cos(), 2.0],
        ];
        (point, u)
    }

    fn at(s: f64) -> Turned {
        let (point, u) = motion(s);
        point.turned(u)
    }

    #[test]
    fn turning_agrees_with_differences() {
        let h = 1e-5;
        for k in 0..40 {
            let s = 0.1 * f64::from(k);
            let (plus, now, minus) = (at(s + h), at(s), at(s - h));
            let r = now.rotation.matrix();
            assert!((r.transpose() * r - Matrix3::identity()).amax() < 1e-14);
            let omega = rotation_vector(&(plus.rotation * minus.rotation.inverse())) / (2.0 * h);
            assert!((omega - now.omega).amax() < 1e-8, "{s}");
            assert!(((plus.omega - minus.omega) / (2.0 * h) - now.omega_rate).amax() < 1e-8);
            for i in 0..2 {
                let difference = (plus.by_u[i] - minus.by_u[i]) / (2.0 * h);
                assert!((difference - now.by_u[i + 1]).amax() < 1e-8, "{s} {i}");
            }
            // Columns of A: what a change of u turns.
            let (point, u) = motion(s);
            for i in 0..3 {
                let moved = |step: f64| {
                    let mut u = u;
                    u[0][i] += step;
                    point.turned(u).rotation
                };
                let column = rotation_vector(&(moved(h) * moved(-h).inverse())) / (2.0 * h);
                assert!((column - now.by_u[0].column(i)).amax() < 1e-9);
            }
        }
    }
}
