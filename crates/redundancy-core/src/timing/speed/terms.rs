//! The torques along a path as functions of the tool's speed and acceleration: `tau = M q' a + D x + G` with `x = v^2`.

use super::settings::SpeedSettings;
use crate::chain::{Body, Chain};
use crate::error::{Error, Result, check_finite, check_vector};
use crate::kinematics::DynamicsScratch;
use crate::parallel::prelude::*;
use crate::path::knot_derivatives;
use crate::tolerance::TORQUE_LEFT;

/// Points that one task of the pool takes at least.
const POINTS_PER_TASK: usize = 64;

/// `q`, `q'`, `G`, `D` of all points, row by row, and `M q'` where it is asked for.
pub(super) struct SpeedTerms {
    pub n: usize,
    pub s: Vec<f64>,
    pub q: Vec<f64>,
    pub d: Vec<f64>,
    pub weights: Vec<f64>,
    pub dynamic: Vec<f64>,
    pub inertial: Vec<f64>,
}

impl SpeedTerms {
    pub fn new(
        chain: &Chain,
        s: &[f64],
        q: &[f64],
        settings: &SpeedSettings,
        accelerated: bool,
    ) -> Result<Self> {
        let (n, rows) = (chain.dof(), s.len());
        check_finite("s", s)?;
        check_vector("q", q, n * rows)?;
        if rows < 2 {
            return Err(Error::Length {
                what: "path (at least two points)".into(),
                expected: 2,
                actual: rows,
            });
        }
        if let Some(k) = (1..rows).find(|k| s[*k] < s[k - 1]) {
            return Err(Error::Invalid(format!("s[{k}] is {} after {}, it must increase", s[k], s[k - 1])));
        }
        if s[rows - 1] <= s[0] {
            return Err(Error::Invalid("the path has no length".into()));
        }
        let (d, dd) = knot_derivatives(s, q, n);
        let (mut weights, mut dynamic) = (vec![0.0; n * rows], vec![0.0; n * rows]);
        let mut inertial = vec![0.0; if accelerated { n * rows } else { 0 }];
        settings.check_masses(chain)?;
        let bodies: Option<&[Body]> = chain.masses().ok();
        if let Some(bodies) = bodies {
            let rows = q.par_chunks_exact(n).zip(d.par_chunks_exact(n)).zip(dd.par_chunks_exact(n));
            let out = weights.par_chunks_exact_mut(n).zip(dynamic.par_chunks_exact_mut(n));
            let scratch = || DynamicsScratch::new(chain);
            if accelerated {
                let all = rows.zip(out.zip(inertial.par_chunks_exact_mut(n))).with_min_len(POINTS_PER_TASK);
                all.for_each_init(scratch, |scratch, (((q, d), dd), ((weights, dynamic), inertial))| {
                    let out = [weights, dynamic, inertial];
                    chain.path_torques(bodies, [q, d, dd], &settings.gravity, scratch, out);
                });
            } else {
                rows.zip(out).with_min_len(POINTS_PER_TASK).for_each_init(
                    scratch,
                    |scratch, (((q, d), dd), (weights, dynamic))| {
                        chain.split_torques(bodies, [q, d, dd], &settings.gravity, scratch, weights, dynamic);
                    },
                );
            }
        }
        Ok(Self { n, s: s.to_vec(), q: q.to_vec(), d, weights, dynamic, inertial })
    }

    /// Gravity alone must leave torque at every joint.
    pub fn check_gravity(&self, chain: &Chain, settings: &SpeedSettings) -> Result<()> {
        let Some(limits) = &settings.torque_limits else { return Ok(()) };
        let mut worst: Option<(f64, usize)> = None;
        for (i, weight) in self.weights.iter().enumerate() {
            let use_ = weight.abs() / limits[i % self.n];
            if use_ >= 1.0 - TORQUE_LEFT && worst.is_none_or(|(most, _)| use_ > most) {
                worst = Some((use_, i));
            }
        }
        let Some((_, i)) = worst else { return Ok(()) };
        let (k, j) = (i / self.n, i % self.n);
        Err(Error::CannotFollow(format!(
            "joint '{}' needs {:.4} N m at point {k} to hold the arm at rest, its torque limit is {}",
            chain.joints()[j].name,
            self.weights[i].abs(),
            limits[j]
        )))
    }
}
