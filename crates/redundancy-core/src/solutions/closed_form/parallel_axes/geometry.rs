//! Recognising a six-joint arm with three parallel axes from its axes alone.
//!
//! At `q = 0` the six joint axes are lines in space. The arm is of this kind when axes 2, 3, 4 are parallel, no two
//! neighbours of them the same line, and axes 5 and 6 meet in a point C. Everything else is free: the angles of axis 1
//! against axis 2, of axis 5 against axis 4 and of axis 6 against axis 5 (but none of these pairs is parallel), offsets
//! between axes 1 and 2 and between axes 4 and 5, which way the axes point and where the joints have their zeros.
//! Angles that a description rounds (1.5708 for a right angle) are therefore used as they are.

use nalgebra::{Complex, Matrix3, Vector3};

use crate::chain::Chain;
use crate::error::{Error, Result};
use crate::solutions::closed_form::lanes::Triangle;
use crate::solutions::closed_form::lines::{angle_between, angle_of, foot_at, meeting, not_turning};
use crate::solutions::{AxisLine, Defect, orthonormal};
use crate::tolerance::{AXES_PARALLEL, SRS_ANGLE, SRS_DISTANCE, SRS_ELBOW_RADIUS};

/// The ideal arm. With m along the parallel axes and k along axis 1, `e` along `m x k`: joint 1 turns `[e, j, k]`, joints
/// 2, 3, 4 turn the plane of `n = e x m` and e, in complex coordinates `n + i e`, in which a turn about m by x multiplies
/// by `exp(i x)`. Where k is perpendicular to m, n is k and j is m.
#[derive(Debug, Clone)]
pub(super) struct ParallelGeometry {
    /// The point of axis 1 nearest to C at `q = 0`, world.
    pub origin: Vector3<f64>,
    /// `[e, j, k]` in the world.
    pub frame: Matrix3<f64>,
    /// `m . k`.
    pub cos_lean: f64,
    /// `m . j`, positive.
    pub sin_lean: f64,
    /// Coordinate of C along m.
    pub lateral: f64,
    /// Where axis 2 crosses the plane.
    pub shoulder: Complex<f64>,
    /// Distances of axes 2 and 3, and of axes 3 and 4, m.
    pub lengths: [f64; 2],
    /// Direction from axis 2 to axis 3 at `q = 0`.
    pub upper_home: Complex<f64>,
    /// Direction from axis 3 to axis 4 at `q = 0`.
    pub fore_home: Complex<f64>,
    /// Angle from the upper arm to the forearm at `q = 0`.
    pub bend_home: f64,
    /// From axis 4 to C at `q = 0`.
    pub hand: Complex<f64>,
    /// Direction of axis 5 in the plane at `q = 0`.
    pub axis5: Complex<f64>,
    /// C in the tool frame, m.
    pub center_in_tool: Vector3<f64>,
    /// `[x, y, z]` at `q = 0` in the tool frame: z along axis 6, axis 5 in the half-plane of z and +x.
    pub wrist_in_tool: Matrix3<f64>,
    /// Axis 5 between m and axis 6: sides are the angles of m and axis 5, and of axes 5 and 6.
    pub wrist: Triangle,
    /// Angle of m about axis 5 at `q = 0`, counted from axis 6: `q5 = zero5 - x`.
    pub zero5: f64,
    /// Senses of axes 2, 3, 4 along m.
    pub sign: [f64; 3],
    /// Bound on the error of the idealisation.
    pub defect: Defect,
}

impl ParallelGeometry {
    /// Reads the geometry off `chain`.
    ///
    /// # Errors
    /// [`Error::NotParallelAxes`] with the condition that fails and by how much.
    pub fn recognise(chain: &Chain) -> Result<Self> {
        if chain.dof() != 6 {
            return not_parallel(format!("'{}' has {} joints, 6 are needed", chain.name(), chain.dof()));
        }
        if let Some(reason) = not_turning(chain) {
            return not_parallel(reason);
        }
        let (lines, home) = AxisLine::axes(chain)?;
        let direction = |i: usize| lines[i].direction;
        for (i, j) in [(1, 2), (2, 3)] {
            let skew = angle_between(&direction(i), &direction(j));
            if skew > SRS_ANGLE {
                let (i, j, skew) = (i + 1, j + 1, 1e3 * skew);
                return not_parallel(format!("axes {i} and {j} are {skew:.3} mrad away from parallel"));
            }
        }
        for (i, j) in [(0, 1), (3, 4), (4, 5)] {
            let apart = angle_between(&direction(i), &direction(j));
            if apart < AXES_PARALLEL {
                let (i, j, apart) = (i + 1, j + 1, 1e3 * apart);
                return not_parallel(format!("axes {i} and {j} are only {apart:.3} mrad away from parallel"));
            }
        }
        let (center, gap) = meeting(&lines[4], &lines[5]);
        if gap > SRS_DISTANCE {
            return not_parallel(format!("axes 5 and 6 miss each other by {:.3} mm", 1e3 * gap));
        }

        let (m, sign) = common_direction(&lines, &center);
        let k = direction(0);
        let origin = lines[0].point + k * k.dot(&(center - lines[0].point));
        let e = m.cross(&k).normalize();
        let frame = Matrix3::from_columns(&[e, k.cross(&e), k]);
        let n = e.cross(&m);
        let plane = |v: &Vector3<f64>| Complex::new(v.dot(&n), v.dot(&e));
        let lateral = (center - origin).dot(&m);
        // Nearly parallel axes are taken where the arm is, half-way between axis 1 and C.
        let at = |i: usize| foot_at(&lines[i], &m, &origin, 0.5 * lateral) - origin;
        let [p2, p3, p4] = [1, 2, 3].map(|i| plane(&at(i)));
        let (upper, fore) = (p3 - p2, p4 - p3);
        for (i, length) in [(2, upper.norm()), (3, fore.norm())] {
            if length < SRS_ELBOW_RADIUS {
                let (j, mm) = (i + 1, 1e3 * length);
                return not_parallel(format!("axes {i} and {j} are the same line, {mm:.6} mm apart"));
            }
        }

        let (z5, z6) = (direction(4), direction(5));
        let x = (z5 - z6 * z6.dot(&z5)).normalize();
        let wrist_frame = Matrix3::from_columns(&[x, z6.cross(&x), z6]);
        let about5 = (z6 - z5 * z5.dot(&z6)).normalize();
        let zero5 = m.dot(&z5.cross(&about5)).atan2(m.dot(&about5));
        let axis5 = plane(&z5);

        let tool = home.translation.vector;
        let reach = upper.norm() + fore.norm() + (center - at(3) - origin).norm() + (tool - center).norm();
        let turns: f64 = (0..3).map(|i| (m * sign[i] - direction(i + 1)).norm()).sum();
        let defect = Defect { position: turns * reach + gap, orientation: turns };
        Ok(Self {
            origin,
            frame,
            cos_lean: m.dot(&k),
            sin_lean: m.cross(&k).norm(),
            lateral,
            shoulder: p2,
            lengths: [upper.norm(), fore.norm()],
            upper_home: upper / upper.norm(),
            fore_home: fore / fore.norm(),
            bend_home: (fore * upper.conj()).arg(),
            hand: plane(&(center - origin)) - p4,
            axis5: axis5 / axis5.norm(),
            center_in_tool: home.inverse_transform_point(&center.into()).coords,
            wrist_in_tool: orthonormal(&home.rotation.matrix().tr_mul(&wrist_frame)),
            wrist: Triangle::new(angle_of(&m, &z5), angle_of(&z5, &z6)),
            zero5,
            sign,
            defect,
        })
    }
}

/// Mean direction of axes 2, 3, 4 and their senses along it. Its sense does not depend on which way the axes point: C is on
/// its side of axis 1; where it is on neither, axis 2 passes in front of axis 1.
fn common_direction(lines: &[AxisLine], center: &Vector3<f64>) -> (Vector3<f64>, [f64; 3]) {
    let first = lines[1].direction;
    let mut sign = [1, 2, 3].map(|i| if lines[i].direction.dot(&first) < 0.0 { -1.0 } else { 1.0 });
    let sum: Vector3<f64> = (0..3).map(|i| lines[i + 1].direction * sign[i]).sum();
    let m = sum.normalize();
    let (k, origin) = (lines[0].direction, lines[0].point);
    let from_axis = |p: &Vector3<f64>| p - origin - k * k.dot(&(p - origin));
    let aside = from_axis(center).dot(&m);
    let ahead = (lines[1].point - origin).dot(&m.cross(&k));
    let decisive = if aside.abs() > SRS_DISTANCE { aside } else { ahead };
    if decisive < -SRS_DISTANCE {
        sign = sign.map(|s| -s);
        return (-m, sign);
    }
    (m, sign)
}

fn not_parallel<T>(reason: String) -> Result<T> {
    Err(Error::NotParallelAxes { reason })
}
