//! The outer joints of a spherical joint whose middle one is at its gimbal: only their sum or difference is defined.

use crate::joint_space::{turned, turns};

/// Windings of the sum that are tried to either side of the nearest one.
const WINDINGS: i32 = 8;

/// First and third joint with the sum (sense +1) or difference `third - first` (sense -1) of `pair` modulo turns, within
/// their limits and nearest to `wish`; `None` when there are none.
#[cold]
pub(super) fn shared(
    pair: [f64; 2],
    sense: f64,
    wish: [f64; 2],
    lower: [f64; 2],
    upper: [f64; 2],
) -> Option<[f64; 2]> {
    // first = x, third = constant + 2 pi k - sense x.
    let constant = pair[1] + sense * pair[0];
    let center = turns(wish[1] + sense * wish[0] - constant);
    let mut best: Option<(f64, [f64; 2])> = None;
    for k in -WINDINGS..=WINDINGS {
        let total = turned(constant, center + f64::from(k));
        let ends = [sense * (total - upper[1]), sense * (total - lower[1])];
        let low = lower[0].max(ends[0].min(ends[1]));
        let high = upper[0].min(ends[0].max(ends[1]));
        if low > high {
            continue;
        }
        let x = (0.5 * (wish[0] + sense * (total - wish[1]))).clamp(low, high);
        let pair = [x, (total - sense * x).clamp(lower[1], upper[1])];
        let distance = (pair[0] - wish[0]).powi(2) + (pair[1] - wish[1]).powi(2);
        if best.is_none_or(|(least, _)| distance < least) {
            best = Some((distance, pair));
        }
    }
    best.map(|(_, pair)| pair)
}
