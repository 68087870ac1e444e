//! Rigid transforms as they travel through the crate: a rotation matrix and a translation.

use nalgebra::{IsometryMatrix3, Matrix3, Rotation3, Translation3, Vector3};

use crate::error::{Error, Result, check_finite, check_vector};
use crate::tolerance::{LARGEST_POSITION, ROTATION_NEAR, ROTATION_ORTHONORMAL};

/// Position in metres and rotation matrix. Kinematics work on matrices, so no conversion is hidden in it.
pub type Pose = IsometryMatrix3<f64>;

/// Pose from a rotation matrix and a position, both already valid.
pub(crate) fn pose(rotation: Matrix3<f64>, position: Vector3<f64>) -> Pose {
    Pose::from_parts(Translation3::from(position), Rotation3::from_matrix_unchecked(rotation))
}

/// Pose from the 16 entries of a homogeneous matrix, row by row.
///
/// A rotation part within [`ROTATION_ORTHONORMAL`] is used as it is. One that is farther from a rotation, up to
/// [`ROTATION_NEAR`], is replaced by the nearest rotation (rounded files, hand-made matrices).
///
/// # Errors
/// Wrong length, an entry that is not finite, a bottom row other than `0 0 0 1`, a rotation part that is farther from the
/// nearest rotation than [`ROTATION_NEAR`] (the message gives the distance), or a reflection.
///
/// ```
/// use redundancy_core::pose_from_row_major;
/// let t = pose_from_row_major(&[1., 0., 0., 0.5, 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.])?;
/// assert_eq!(t.translation.x, 0.5);
/// let rounded = pose_from_row_major(&[0.6, -0.8004, 0., 0., 0.8, 0.6, 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.])?;
/// assert!((rounded.rotation.matrix().column(1).norm() - 1.0).abs() < 1e-15);
/// assert!(pose_from_row_major(&[2.; 16]).is_err());
/// # Ok::<(), redundancy_core::Error>(())
/// ```
pub fn pose_from_row_major(m: &[f64]) -> Result<Pose> {
    check_vector("pose", m, 16)?;
    let bottom = (m[12].abs()).max(m[13].abs()).max(m[14].abs()).max((m[15] - 1.0).abs());
    if bottom > ROTATION_ORTHONORMAL {
        let transposed = m[3] == 0.0 && m[7] == 0.0 && m[11] == 0.0 && m[15] == 1.0;
        return Err(Error::NotRigid {
            what: "pose".into(),
            reason: if transposed {
                "the bottom row is not 0 0 0 1 (is the matrix transposed?): its error"
            } else {
                "the bottom row is not 0 0 0 1: its error"
            },
            measured: bottom,
            bound: format!("at most {ROTATION_ORTHONORMAL:e}"),
        });
    }
    let rotation = Matrix3::new(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]);
    let rotation = checked_rotation("pose", &rotation)?;
    Ok(pose(rotation, Vector3::new(m[3], m[7], m[11])))
}

/// Rotation from a matrix that the caller gives, by the rule of [`pose_from_row_major`]; `what` names it in messages.
///
/// # Errors
/// An entry that is not finite, a matrix that is farther than [`ROTATION_NEAR`] from the nearest rotation, or a reflection.
///
/// ```
/// use redundancy_core::{nalgebra::Matrix3, rotation_from_matrix};
/// assert_eq!(rotation_from_matrix("R", &Matrix3::identity())?.matrix(), &Matrix3::identity());
/// assert!(rotation_from_matrix("R", &(2.0 * Matrix3::identity())).is_err());
/// # Ok::<(), redundancy_core::Error>(())
/// ```
pub fn rotation_from_matrix(what: &str, matrix: &Matrix3<f64>) -> Result<Rotation3<f64>> {
    check_finite(what, matrix.transpose().as_slice())?;
    Ok(Rotation3::from_matrix_unchecked(checked_rotation(what, matrix)?))
}

/// Why a matrix is no rotation: in words, what was measured, and the largest value of that; without one it has to be 1.
struct NoRotation(&'static str, f64, Option<f64>);

/// `rotation` as it is where it is orthonormal to [`ROTATION_ORTHONORMAL`]; the nearest rotation where that is within
/// [`ROTATION_NEAR`]. Its entries are finite.
pub(crate) fn checked_rotation(what: &str, rotation: &Matrix3<f64>) -> Result<Matrix3<f64>> {
    near_rotation(rotation).map_err(|NoRotation(reason, measured, most)| Error::NotRigid {
        what: what.into(),
        reason,
        measured,
        bound: most.map_or_else(|| "1".into(), |most| format!("at most {most:e}")),
    })
}

/// [`checked_rotation`] without a text, so that nothing is allocated.
fn near_rotation(rotation: &Matrix3<f64>) -> std::result::Result<Matrix3<f64>, NoRotation> {
    let square = rotation.tr_mul(rotation);
    let exact = (square - Matrix3::identity()).amax() <= ROTATION_ORTHONORMAL;
    if !exact {
        // The singular values are the roots of the eigenvalues of R^T R. The largest deviation of one from 1 is the
        // spectral distance to the nearest orthonormal matrix.
        let distance = square
            .symmetric_eigenvalues()
            .iter()
            .fold(0.0_f64, |most, value| most.max((value.max(0.0).sqrt() - 1.0).abs()));
        if distance.is_nan() || distance > ROTATION_NEAR {
            let reason = "the rotation part is not orthonormal, its distance from the nearest rotation";
            return Err(NoRotation(reason, distance, Some(ROTATION_NEAR)));
        }
    }
    let determinant = rotation.determinant();
    if determinant < 0.0 {
        let reason = "the rotation part is a reflection (axes of a left-handed frame), its determinant";
        return Err(NoRotation(reason, determinant, None));
    }
    Ok(if exact { *rotation } else { nearest_rotation(rotation) })
}

/// [`checked_pose`] for a control step: `None` instead of an error, and nothing is allocated.
pub(crate) fn rigid_pose(pose: &Pose) -> Option<Pose> {
    let near = pose.translation.vector.iter().all(|x| x.abs() <= LARGEST_POSITION);
    if !(near && pose.rotation.matrix().iter().all(|x| x.is_finite())) {
        return None;
    }
    let rotation = near_rotation(pose.rotation.matrix()).ok()?;
    Some(Pose::from_parts(pose.translation, Rotation3::from_matrix_unchecked(rotation)))
}

/// The polar factor of a matrix within [`ROTATION_NEAR`] of a rotation: the rotation nearest to it in every unitarily
/// invariant norm. Newton and Schulz's iteration `X <- X (3 - X^T X) / 2` takes a singular value `1 + e` to
/// `1 - 3/2 e^2`: 1e-3, 1.5e-6, 3.4e-12, rounding.
fn nearest_rotation(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    const STEPS: usize = 4;
    (0..STEPS).fold(*matrix, |x, _| x * (Matrix3::identity() * 3.0 - x.tr_mul(&x)) * 0.5)
}

/// Inverse of [`pose_from_row_major`].
pub fn pose_to_row_major(pose: &Pose) -> [f64; 16] {
    let (r, p) = (pose.rotation.matrix(), &pose.translation.vector);
    let mut m = [0.0; 16];
    for i in 0..3 {
        for j in 0..3 {
            m[4 * i + j] = r[(i, j)];
        }
        m[4 * i + 3] = p[i];
    }
    m[15] = 1.0;
    m
}

/// The pose that a caller has built, by the rule of [`pose_from_row_major`].
pub(crate) fn checked_pose(what: &str, pose: &Pose) -> Result<Pose> {
    check_finite(what, pose.translation.vector.as_slice())?;
    if let Some(value) = pose.translation.vector.iter().find(|x| x.abs() > LARGEST_POSITION) {
        let bound = format!("at most {LARGEST_POSITION:e} m in size");
        return Err(Error::OutOfRange { what: format!("position of {what}"), value: *value, bound });
    }
    check_finite(what, pose.rotation.matrix().as_slice())?;
    let rotation = checked_rotation(what, pose.rotation.matrix())?;
    Ok(Pose::from_parts(pose.translation, Rotation3::from_matrix_unchecked(rotation)))
}

/// Checks a pose that is kept as it is: its rotation must be orthonormal to [`ROTATION_ORTHONORMAL`].
pub(crate) fn check_pose(what: &str, pose: &Pose) -> Result<()> {
    let checked = checked_pose(what, pose)?;
    let measured = (checked.rotation.matrix() - pose.rotation.matrix()).amax();
    if measured == 0.0 {
        return Ok(());
    }
    Err(Error::NotRigid {
        what: what.into(),
        reason: "the rotation part is not orthonormal, its distance from the nearest rotation",
        measured,
        bound: format!("at most {ROTATION_ORTHONORMAL:e}"),
    })
}
