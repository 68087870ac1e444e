//! Recognising a spherical-revolute-spherical arm from its axes alone.
//!
//! At `q = 0` the seven joint axes are lines in space. The arm is S-R-S when axes 1, 2, 3 meet in a point S with
//! right angles between neighbours, axes 5, 6, 7 likewise in W, and S and W lie in one plane perpendicular to
//! axis 4 but not on it. Which way the axes point, where the joints have their zeros, and whether the elbow axis
//! is offset from the links does not matter.
//!
//! The product of exponentials of these lines is the arm, whatever its frames [Moore2010, eqs (6), (8), (9) for the
//! PA10]. With `K = [x, y, k]` (k along axis 1, x along the base x) it becomes
//!
//! ```text
//! q1 = a - psi,          q2 = s2 (b - b0),   q3 = s3 (c + c0)       K^T R3 K'  = Rz(a) Ry(b) Rz(c)
//! q4 = s4 (t - t0),      q5 = s5 (d + d0),   q6 = s6 (e - e0),  q7 = s7 f
//! ```
//!
//! with the angles a..f, t of the paper (all zero when the arm is stretched along k) and signs and offsets that are
//! computed here once.
//!
//! Small deviations (rounded URDFs, calibrated arms) are accepted: the nearest ideal arm is used and the bound on
//! what that costs is reported as [`Defect`].

use nalgebra::{Matrix3, Vector3};

use crate::chain::Chain;
use crate::error::{Error, Result};
use crate::joint_space::wrap;
use crate::kinematics::Scratch;
use crate::pose::Pose;
use crate::solutions::Defect;
use crate::tolerance::{REFERENCE_PARALLEL, SRS_ALIGNED, SRS_ANGLE, SRS_DISTANCE, SRS_ELBOW_RADIUS};

/// The ideal arm in the notation of the module.
#[derive(Debug, Clone)]
pub(super) struct Geometry {
    /// Shoulder centre in the world.
    pub shoulder: Vector3<f64>,
    /// Wrist centre in the tool frame.
    pub wrist_in_tool: Vector3<f64>,
    /// Swivel frame `[x, y, k]` in the world: z is axis 1, x the base x projected.
    pub frame: Matrix3<f64>,
    /// Distance of the shoulder from the elbow axis: length of the (virtual) upper arm.
    pub upper_arm: f64,
    /// Distance of the wrist from the elbow axis: length of the (virtual) forearm.
    pub forearm: f64,
    /// From the virtual upper arm frame `[x3, y3, z3]` to the frame whose ZYZ angles are joints 1..3.
    pub shoulder_offset: Matrix3<f64>,
    /// From the virtual forearm frame to the frame in which the ZYZ angles of joints 5..7 begin.
    pub wrist_offset: Matrix3<f64>,
    /// From the tool rotation to the frame in which the ZYZ angles of joints 5..7 end.
    pub tool_offset: Matrix3<f64>,
    /// True when both offsets are the identity: the upper arm runs along axis 3 and the forearm along axis 5.
    pub aligned: bool,
    /// `q_i = sign_i * angle_i + zero_i`.
    pub sign: [f64; 7],
    /// See `sign`; each in `(-pi, pi]`.
    pub zero: [f64; 7],
    /// Bound on the error of the idealisation.
    pub defect: Defect,
}

/// A joint axis as a line in space.
pub(crate) struct AxisLine {
    /// A point on it.
    pub point: Vector3<f64>,
    /// Its unit direction.
    pub direction: Vector3<f64>,
}

impl AxisLine {
    /// The joint axes of `chain` at `q = 0`, and the pose of its tool there.
    pub fn axes(chain: &Chain) -> Result<(Vec<Self>, Pose)> {
        let mut scratch = Scratch::new(chain);
        let home = chain.kinematics(&vec![0.0; chain.dof()], &mut scratch)?;
        let axes = home.origins().iter().zip(home.axes());
        let lines = axes.map(|(o, z)| Self { point: *o, direction: z.normalize() }).collect();
        Ok((lines, *home.pose()))
    }
}

impl Geometry {
    /// Reads the geometry off `chain`.
    ///
    /// # Errors
    /// [`Error::NotSrs`] with the condition that fails and by how much.
    pub fn recognise(chain: &Chain) -> Result<Self> {
        if chain.dof() != 7 {
            return not_srs(format!("'{}' has {} joints, 7 are needed", chain.name(), chain.dof()));
        }
        if let Some(joint) = chain.joints().iter().find(|j| !j.kind.is_rotational()) {
            return not_srs(format!(
                "joint '{}' is {}, all joints must be revolute",
                joint.name,
                joint.kind.as_str()
            ));
        }
        let (lines, home) = AxisLine::axes(chain)?;
        let (shoulder, shoulder_axes) = spherical(&lines[..3], 1).or_else(not_srs)?;
        let (mut wrist, wrist_axes) = spherical(&lines[4..], 5).or_else(not_srs)?;

        // The elbow: feet of S and W on axis 4, brought into one plane.
        let elbow = &lines[3];
        let z4 = elbow.direction;
        let along = |p: &Vector3<f64>| (p - elbow.point).dot(&z4);
        let step = along(&wrist) - along(&shoulder);
        if step.abs() > SRS_DISTANCE {
            let mm = 1e3 * step.abs();
            return not_srs(format!("shoulder and wrist are {mm:.3} mm apart along the elbow axis (axis 4)"));
        }
        wrist -= step * z4;
        let foot = elbow.point + along(&shoulder) * z4;
        let (to_foot, from_foot) = (foot - shoulder, wrist - foot);
        let (upper_arm, forearm) = (to_foot.norm(), from_foot.norm());
        for (what, radius) in [("shoulder", upper_arm), ("wrist", forearm)] {
            if radius < SRS_ELBOW_RADIUS {
                let mm = 1e3 * radius;
                return not_srs(format!(
                    "the {what} lies on the elbow axis (axis 4), {mm:.6} mm away from it"
                ));
            }
        }

        let [z1, z2, z3] = shoulder_axes;
        let [z5, z6, z7] = wrist_axes;
        let frame = swivel_frame(&z1, chain.base().rotation.matrix());
        let (upper, fore) = (to_foot / upper_arm, from_foot / forearm);

        // Senses of the axes as in the paper: y axes along each other when the arm is stretched along k.
        let sign2 = sense(&z2, &frame.column(1).into(), &frame.column(0).into());
        let y1 = sign2 * z2;
        let sign3 = if z3.dot(&upper) < 0.0 { -1.0 } else { 1.0 };
        let e3 = sign3 * z3;
        let sign4 = sense(&z4, &y1, &y1.cross(&e3));
        let y3 = sign4 * z4;
        let sign5 = if z5.dot(&fore) < 0.0 { -1.0 } else { 1.0 };
        let e5 = sign5 * z5;
        let sign6 = sense(&z6, &y3, &y3.cross(&e5));
        let y5 = sign6 * z6;
        let tip = chain.forward_link(&[0.0; 7], chain.links().len() - 1)?.translation.vector;
        let reach7 = (tip - wrist).dot(&z7);
        let straight7 = if reach7.abs() > SRS_ELBOW_RADIUS { reach7 } else { z7.dot(&e5) };
        let sign7 = if straight7 < 0.0 { -1.0 } else { 1.0 };
        let e7 = sign7 * z7;

        // Zeros: angles of the paper at q = 0.
        let x1 = y1.cross(&z1);
        let psi = angle_about(&z1, &frame.column(0).into(), &x1);
        let b0 = angle_about(&y1, &z1, &e3);
        let e0 = angle_about(&y5, &e5, &e7);
        let t0 = angle_about(&y3, &upper, &fore);

        // Frames at q = 0, all in world axes.
        let shoulder_frame = Matrix3::from_columns(&[x1, y1, z1]) * rotation_y(b0);
        let virtual_upper = Matrix3::from_columns(&[y3.cross(&upper), y3, upper]);
        let virtual_fore = Matrix3::from_columns(&[y3.cross(&fore), y3, fore]);
        let wrist_frame = Matrix3::from_columns(&[y5.cross(&e5), y5, e5]);
        let home_rotation = home.rotation.matrix();

        let mut shoulder_offset = virtual_upper.tr_mul(&shoulder_frame);
        let mut wrist_offset = wrist_frame.tr_mul(&virtual_fore);
        let mut tool_offset = home_rotation.tr_mul(&(wrist_frame * rotation_y(e0)));
        let (mut c0, mut d0) = (0.0, 0.0);
        // The angle by which the links leave axes 3 and 5; rounding alone is taken out, real offsets are kept.
        let tilt = shoulder_offset.column(2).xy().norm().max(wrist_offset.row(2).columns(0, 2).norm());
        let aligned = tilt < SRS_ALIGNED;
        if aligned {
            // Turns about z on the right and on the left of the ZYZ product: they move into joints 3 and 5.
            c0 = shoulder_offset[(1, 0)].atan2(shoulder_offset[(0, 0)]);
            d0 = wrist_offset[(1, 0)].atan2(wrist_offset[(0, 0)]);
            (shoulder_offset, wrist_offset) = (Matrix3::identity(), Matrix3::identity());
        }
        // Repair the rounding of products, so that the closed form closes to 1e-15.
        tool_offset = orthonormal(&tool_offset);

        let sign = [1.0, sign2, sign3, sign4, sign5, sign6, sign7];
        let zero = [-psi, -sign2 * b0, sign3 * c0, -sign4 * t0, sign5 * d0, -sign6 * e0, 0.0].map(wrap);

        let tool = home.translation.vector;
        let reach = upper_arm + forearm + (tool - wrist).norm();
        let mut defect = Defect { position: 0.0, orientation: 0.0 };
        let ideal = [(z1, shoulder), (z2, shoulder), (z3, shoulder), (z5, wrist), (z6, wrist), (z7, wrist)];
        let real = lines[..3].iter().chain(&lines[4..]);
        for ((direction, point), line) in ideal.iter().zip(real) {
            let turn = (direction - line.direction).norm();
            let lever = if *point == shoulder { reach } else { (tool - wrist).norm() };
            defect.orientation += turn;
            defect.position += distance_to_line(point, line) + turn * lever;
        }
        if aligned {
            defect.orientation += 2.0 * tilt;
            defect.position += 2.0 * tilt * reach;
        }
        let wrist_in_tool = home.inverse_transform_point(&wrist.into()).coords;
        Ok(Self {
            shoulder,
            wrist_in_tool,
            frame,
            upper_arm,
            forearm,
            shoulder_offset,
            wrist_offset,
            tool_offset,
            aligned,
            sign,
            zero,
            defect,
        })
    }
}

/// Common point and orthonormalised directions of three axes in a row, the first of which is joint `first`; or in words
/// which condition fails and by how much.
pub(crate) fn spherical(
    lines: &[AxisLine],
    first: usize,
) -> std::result::Result<(Vector3<f64>, [Vector3<f64>; 3]), String> {
    let (a, b, c) = (&lines[0], &lines[1], &lines[2]);
    for (i, (l, m)) in [(a, b), (b, c)].into_iter().enumerate() {
        let (i, j) = (first + i, first + i + 1);
        let off = l.direction.dot(&m.direction).clamp(-1.0, 1.0).asin().abs();
        if off > SRS_ANGLE {
            return Err(format!("axes {i} and {j} are {:.3} mrad away from a right angle", 1e3 * off));
        }
        let gap = (m.point - l.point).dot(&l.direction.cross(&m.direction).normalize()).abs();
        if gap > SRS_DISTANCE {
            return Err(format!("axes {i} and {j} miss each other by {:.3} mm", 1e3 * gap));
        }
    }
    // Where on axis b the axes a and c cross it (the point of b nearest to them).
    let crossing = |l: &AxisLine| {
        let d = l.point - b.point;
        let (u, v) = (b.direction, l.direction);
        let uv = u.dot(&v);
        (d.dot(&u) - uv * d.dot(&v)) / (1.0 - uv * uv)
    };
    let apart = (crossing(a) - crossing(c)).abs();
    if apart > SRS_DISTANCE {
        let (i, j, k) = (first, first + 1, first + 2);
        let mm = 1e3 * apart;
        return Err(format!("axes {i} and {k} cross axis {j} at points {mm:.3} mm apart"));
    }
    // Least squares: the point nearest to the three lines.
    let mut normal = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for line in lines {
        let p = Matrix3::identity() - line.direction * line.direction.transpose();
        normal += p;
        right += p * (line.point - a.point);
    }
    let Some(offset) = normal.cholesky().map(|c| c.solve(&right)) else {
        return Err(format!("axes {first} to {} are parallel", first + 2));
    };
    let za = a.direction;
    let zb = (b.direction - za * za.dot(&b.direction)).normalize();
    let zc = (c.direction - zb * zb.dot(&c.direction)).normalize();
    Ok((a.point + offset, [za, zb, zc]))
}

/// `[x, y, k]` with x the projection of the base x, or of the base y where x is parallel to k.
pub(super) fn swivel_frame(k: &Vector3<f64>, base: &Matrix3<f64>) -> Matrix3<f64> {
    let project = |v: Vector3<f64>| v - k * k.dot(&v);
    let mut x = project(base.column(0).into());
    if x.norm() < REFERENCE_PARALLEL {
        x = project(base.column(1).into());
    }
    let x = x.normalize();
    Matrix3::from_columns(&[x, k.cross(&x), *k])
}

/// +1 or -1 so that the axis points along `main`, or along `other` where it is perpendicular to `main`.
fn sense(axis: &Vector3<f64>, main: &Vector3<f64>, other: &Vector3<f64>) -> f64 {
    let along = axis.dot(main);
    let decisive = if along.abs() > REFERENCE_PARALLEL { along } else { axis.dot(other) };
    if decisive < 0.0 { -1.0 } else { 1.0 }
}

/// Angle by which `from` is turned about `axis` to point along `to`; both perpendicular to `axis`.
fn angle_about(axis: &Vector3<f64>, from: &Vector3<f64>, to: &Vector3<f64>) -> f64 {
    axis.dot(&from.cross(to)).atan2(from.dot(to))
}

/// Rotation about y.
pub(crate) fn rotation_y(angle: f64) -> Matrix3<f64> {
    let (s, c) = angle.sin_cos();
    Matrix3::new(c, 0.0, s, 0.0, 1.0, 0.0, -s, 0.0, c)
}

/// The rotation nearest to `m` in its first columns.
pub(crate) fn orthonormal(m: &Matrix3<f64>) -> Matrix3<f64> {
    let x = m.column(0).normalize();
    let y: Vector3<f64> = m.column(1) - x * x.dot(&m.column(1));
    let y = y.normalize();
    Matrix3::from_columns(&[x, y, x.cross(&y)])
}

/// Distance of a point from a line, m.
pub(crate) fn distance_to_line(point: &Vector3<f64>, line: &AxisLine) -> f64 {
    let d = point - line.point;
    (d - line.direction * line.direction.dot(&d)).norm()
}

fn not_srs<T>(reason: String) -> Result<T> {
    Err(Error::NotSrs { reason })
}
