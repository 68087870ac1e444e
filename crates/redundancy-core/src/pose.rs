//! Rigid transforms as they travel through the crate: a rotation matrix and a translation.

use nalgebra::{IsometryMatrix3, Matrix3, Rotation3, Translation3, Vector3};

use crate::error::{Error, Result, check_vector};
use crate::tolerance::ROTATION_ORTHONORMAL;

/// Position in metres and rotation matrix. Kinematics work on matrices, so no conversion is hidden in it.
pub type Pose = IsometryMatrix3<f64>;

/// Pose from a rotation matrix and a position, both already valid.
pub(crate) fn pose(rotation: Matrix3<f64>, position: Vector3<f64>) -> Pose {
    Pose::from_parts(Translation3::from(position), Rotation3::from_matrix_unchecked(rotation))
}

/// Pose from the 16 entries of a homogeneous matrix, row by row.
///
/// The numbers are used as they are; nothing is orthonormalised.
///
/// # Errors
/// Wrong length, an entry that is not finite, a bottom row other than `0 0 0 1`, a rotation part whose
/// `R^T R` is further than [`ROTATION_ORTHONORMAL`] from the identity, or a reflection.
///
/// ```
/// use redundancy_core::pose_from_row_major;
/// let t = pose_from_row_major(&[1., 0., 0., 0.5, 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.])?;
/// assert_eq!(t.translation.x, 0.5);
/// assert!(pose_from_row_major(&[2.; 16]).is_err());
/// # Ok::<(), redundancy_core::Error>(())
/// ```
pub fn pose_from_row_major(m: &[f64]) -> Result<Pose> {
    check_vector("pose", m, 16)?;
    let bottom = (m[12].abs()).max(m[13].abs()).max(m[14].abs()).max((m[15] - 1.0).abs());
    if bottom > ROTATION_ORTHONORMAL {
        return Err(Error::NotRigid {
            what: "pose".into(),
            reason: "the bottom row is not 0 0 0 1",
            measured: bottom,
            bound: ROTATION_ORTHONORMAL,
        });
    }
    let rotation = Matrix3::new(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]);
    check_rotation("pose", &rotation)?;
    Ok(pose(rotation, Vector3::new(m[3], m[7], m[11])))
}

/// Checks that `rotation` is orthonormal and right-handed.
pub(crate) fn check_rotation(what: &str, rotation: &Matrix3<f64>) -> Result<()> {
    let measured = (rotation.tr_mul(rotation) - Matrix3::identity()).amax();
    let error = |reason, measured, bound| Err(Error::NotRigid { what: what.into(), reason, measured, bound });
    if measured.is_nan() || measured > ROTATION_ORTHONORMAL {
        return error(
            "the rotation part is not orthonormal, max |R^T R - I|",
            measured,
            ROTATION_ORTHONORMAL,
        );
    }
    if rotation.determinant() < 0.0 {
        return error("the rotation part is a reflection, det R", rotation.determinant(), 1.0);
    }
    Ok(())
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

/// Checks a pose that was built by the caller.
pub(crate) fn check_pose(what: &str, pose: &Pose) -> Result<()> {
    crate::error::check_finite(what, pose.translation.vector.as_slice())?;
    crate::error::check_finite(what, pose.rotation.matrix().as_slice())?;
    check_rotation(what, pose.rotation.matrix())
}
