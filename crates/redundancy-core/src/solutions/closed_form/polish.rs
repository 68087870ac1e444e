//! Newton's method removes the pose error that remains from the idealisation of an arm.

use crate::chain::Chain;
use crate::kinematics::{Corrector, Task};
use crate::pose::Pose;
use crate::tolerance::{POLISH_DEFECT, POLISH_REACH};

use super::Defect;

/// Moves the rows onto the pose, with the joint `held` (if any) where it is. A row that would have to move far, or out of the
/// limits where `limits` are to hold, keeps its defect; bit k of the result says that row k is on the pose, or has no defect to lose.
pub(super) fn polish<const N: usize>(
    chain: &Chain,
    defect: Defect,
    pose: &Pose,
    held: Option<usize>,
    limits: bool,
    rows: &mut [[f64; N]],
) -> u32 {
    if defect.largest() <= POLISH_DEFECT || rows.is_empty() {
        return u32::MAX;
    }
    let mut coordinate = [0.0; N];
    let coordinates: &[f64] = match held {
        Some(joint) => {
            coordinate[joint] = 1.0;
            &coordinate
        }
        None => &[],
    };
    let Ok(mut corrector) = Corrector::with_coordinates(chain, Task::POSE, pose, coordinates) else {
        return 0;
    };
    let mut met = 0;
    for (k, row) in rows.iter_mut().enumerate() {
        let mut q = *row;
        if let Some(joint) = held {
            corrector.set_coordinates(&[q[joint]]);
        }
        if corrector.correct(&mut q, POLISH_REACH) && (!limits || chain.within_limits(&q, 0.0)) {
            if let Some(joint) = held {
                q[joint] = row[joint];
            }
            *row = q;
            met |= 1 << k;
        }
    }
    met
}
