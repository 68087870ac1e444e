//! The largest constant speed over given joint positions, exactly.

use super::settings::{SpeedLimit, SpeedSettings};
use super::terms::SpeedTerms;
use crate::chain::Chain;
use crate::error::{Error, Result};

/// The largest constant tool speed over a path.
#[derive(Debug, Clone, PartialEq)]
pub struct MaxSpeed {
    /// m/s.
    pub speed: f64,
    /// The joint that allows no more.
    pub limiting_joint: usize,
    /// Its torque or its speed.
    pub limit: SpeedLimit,
    /// The path point where that happens.
    pub at: usize,
    /// Joint positions, one row per path point, rad.
    pub q: Vec<f64>,
    /// Joint torques at that speed, one row per path point, N m; zeros for a chain without inertias.
    pub torques: Vec<f64>,
    /// Largest constant speed that each point would allow on its own, m/s; infinite where nothing moves.
    pub point_speeds: Vec<f64>,
    /// Whether no other joint motion over the path is faster. False where lines from a few starts were followed.
    pub proven: bool,
}

/// The largest constant tool speed for given joint positions, one row per path point.
///
/// ```
/// use redundancy_core::chain::catalog;
/// use redundancy_core::timing::{SpeedSettings, max_speed};
/// let arm = catalog::load("puma560")?;
/// // Joint 1 alone swings: its torque is all inertia.
/// let q: Vec<f64> = (0..100).flat_map(|k| [(0.06 * f64::from(k)).sin(), 0.5, -3.0, 0.0, -1.0, 0.0]).collect();
/// let s: Vec<f64> = (0..100).map(|k| 0.01 * f64::from(k)).collect();
/// let fastest = max_speed(&arm, &s, &q, &SpeedSettings::of(&arm))?;
/// assert!(fastest.limiting_joint == 0 && fastest.speed > 0.1);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
///
/// # Errors
/// Invalid settings, lengths that do not fit, `s` that decreases, torque limits without inertias, a torque limit below what
/// gravity asks for (joint and point are named), nothing that moves.
pub fn max_speed(chain: &Chain, s: &[f64], q: &[f64], settings: &SpeedSettings) -> Result<MaxSpeed> {
    settings.validate(chain.dof())?;
    let terms = SpeedTerms::new(chain, s, q, settings, false)?;
    constant_speed(terms, chain, settings)
}

/// The largest constant speed that the terms allow.
pub(super) fn constant_speed(terms: SpeedTerms, chain: &Chain, settings: &SpeedSettings) -> Result<MaxSpeed> {
    terms.check_gravity(chain, settings)?;
    let n = terms.n;
    let mut best = (0.0, 0, SpeedLimit::Torque, 0);
    let mut point_speeds = Vec::with_capacity(terms.s.len());
    for k in 0..terms.s.len() {
        let mut most: f64 = 0.0;
        for j in 0..n {
            let i = k * n + j;
            if let Some(limits) = &settings.torque_limits {
                let (d, g, limit) = (terms.dynamic[i], terms.weights[i], limits[j]);
                let bound = if d > 0.0 { d / (limit - g) } else { -d / (limit + g) };
                most = most.max(bound);
                if bound > best.0 {
                    best = (bound, j, SpeedLimit::Torque, k);
                }
            }
            if let Some(limits) = &settings.velocity_limits {
                let bound = (terms.d[i] / limits[j]).powi(2);
                most = most.max(bound);
                if bound > best.0 {
                    best = (bound, j, SpeedLimit::Velocity, k);
                }
            }
        }
        point_speeds.push(1.0 / most.sqrt());
    }
    let (t, limiting_joint, limit, at) = best;
    let squared = 1.0 / t;
    if !squared.is_finite() {
        return Err(Error::Invalid(
            "no limit acts on this path: no joint with a limit is loaded or moves".into(),
        ));
    }
    let torques = terms.weights.iter().zip(&terms.dynamic).map(|(g, d)| g + squared * d).collect();
    Ok(MaxSpeed {
        speed: squared.sqrt(),
        limiting_joint,
        limit,
        at,
        q: terms.q,
        torques,
        point_speeds,
        proven: true,
    })
}
