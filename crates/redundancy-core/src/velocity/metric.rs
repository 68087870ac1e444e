//! Lengths of joint velocities: which of the joint velocities (or accelerations) that meet a task is the least one.
//!
//! With a positive definite matrix W the least `(qd - eta)^T W (qd - eta)` among those with `J qd = v` is
//!
//! ```text
//! qd = J_W v + (1 - J_W J) eta          J_W = W^-1 J^T (J W^-1 J^T)^-1
//! ```
//!
//! With the mass matrix, at acceleration level, `J_W` is the dynamically consistent inverse [Khatib1987]: the motion of the
//! freedom exerts no force on the tool, and the task is met with the least kinetic energy. With `W = L L^T` it is the ordinary
//! pseudoinverse of `J L^-T` in the coordinates `L^T qd`. W is divided by the mean of its diagonal first, which changes
//! nothing but makes singular values, and so damping, comparable.

use nalgebra::{DMatrix, Vector3};

use crate::chain::Chain;
use crate::error::{Error, Result, check_vector};
use crate::kinematics::{DynamicsScratch, TorqueDerivatives};

/// Which matrix measures joint velocities.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Metric {
    /// The identity: metres and radians alike.
    #[default]
    Identity,
    /// A positive weight for each joint.
    Weights(Vec<f64>),
    /// The mass matrix of the arm, rotors included.
    Inertia,
}

/// A metric at one configuration, factored.
#[derive(Debug, Clone)]
pub(super) struct Factored {
    pub metric: Metric,
    scratch: DynamicsScratch,
    derivatives: TorqueDerivatives,
    zero: Vec<f64>,
    /// Lower triangle L.
    factor: DMatrix<f64>,
    /// `J L^-T` column by column.
    pub jacobian: Vec<f64>,
}

impl Factored {
    pub fn new(metric: Metric, chain: &Chain, m: usize) -> Result<Self> {
        let n = chain.dof();
        let mut factor = DMatrix::identity(n, n);
        match &metric {
            Metric::Identity => {}
            Metric::Inertia => {
                chain.masses()?;
            }
            Metric::Weights(weights) => {
                check_vector("weights", weights, n)?;
                if let Some(weight) = weights.iter().find(|weight| **weight <= 0.0) {
                    let bound = "> 0".into();
                    return Err(Error::OutOfRange { what: "weight".into(), value: *weight, bound });
                }
                let mean = weights.iter().sum::<f64>() / n as f64;
                weights.iter().enumerate().for_each(|(i, w)| factor[(i, i)] = (w / mean).sqrt());
            }
        }
        Ok(Self {
            metric,
            scratch: DynamicsScratch::new(chain),
            derivatives: TorqueDerivatives::new(n),
            zero: vec![0.0; n],
            factor,
            jacobian: vec![0.0; m * n],
        })
    }

    /// Factors W at `q` and writes `J L^-T`, J (m, n) column by column.
    ///
    /// # Errors
    /// A mass matrix that is not positive definite.
    pub fn update(&mut self, chain: &Chain, q: &[f64], jacobian: &[f64]) -> Result<()> {
        let n = q.len();
        if self.metric == Metric::Inertia {
            let (scratch, derivatives) = (&mut self.scratch, &mut self.derivatives);
            chain.inverse_dynamics_derivatives(
                q,
                &self.zero,
                &self.zero,
                &Vector3::zeros(),
                scratch,
                derivatives,
            )?;
            self.decompose()?;
        }
        // Columns of J L^-T, one after the other: X L^T = J.
        let m = jacobian.len() / n.max(1);
        self.jacobian.copy_from_slice(jacobian);
        for j in 0..n {
            let (done, rest) = self.jacobian.split_at_mut(j * m);
            let column = &mut rest[..m];
            for (k, before) in done.chunks_exact(m).enumerate() {
                let l = self.factor[(j, k)];
                column.iter_mut().zip(before).for_each(|(x, before)| *x -= l * before);
            }
            let l = self.factor[(j, j)];
            column.iter_mut().for_each(|x| *x /= l);
        }
        Ok(())
    }

    fn decompose(&mut self) -> Result<()> {
        let mass = &self.derivatives.qdd;
        let n = mass.nrows();
        let mean = mass.trace() / n as f64;
        for j in 0..n {
            for i in j..n {
                let mut x = mass[(i, j)] / mean;
                for k in 0..j {
                    x -= self.factor[(i, k)] * self.factor[(j, k)];
                }
                if i > j {
                    self.factor[(i, j)] = x / self.factor[(j, j)];
                } else if x > 0.0 {
                    self.factor[(j, j)] = x.sqrt();
                } else {
                    return Err(Error::Invalid(format!(
                        "the mass matrix is not positive definite: joint {j} moves no inertia"
                    )));
                }
            }
        }
        Ok(())
    }

    /// `x = L^T x`.
    pub fn enter(&self, x: &mut [f64]) {
        for j in 0..x.len() {
            x[j] = (j..x.len()).map(|i| self.factor[(i, j)] * x[i]).sum();
        }
    }

    /// `x = L^-T x`.
    pub fn leave(&self, x: &mut [f64]) {
        for j in (0..x.len()).rev() {
            let after: f64 = (j + 1..x.len()).map(|i| self.factor[(i, j)] * x[i]).sum();
            x[j] = (x[j] - after) / self.factor[(j, j)];
        }
    }
}
