//! Sums and multiples of criteria.

use std::sync::Arc;

use nalgebra::DMatrix;

use super::{Criterion, JointSpring, STACK_JOINTS, Sense};
use crate::chain::Chain;
use crate::error::{Error, Result, check_finite};
use crate::kinematics::{Kinematics, Task};
use crate::tolerance::CRITERION_FACTOR;

/// `sum_k factor_k h_k`; all terms have the sense of the whole.
#[derive(Debug, Clone)]
pub struct Weighted {
    terms: Vec<(f64, Arc<dyn Criterion>)>,
    dof: usize,
    sense: Sense,
}

impl Weighted {
    /// A multiple; a negative factor turns the sense round.
    ///
    /// # Errors
    /// A factor that is not finite, zero, or of a magnitude whose square or reciprocal would overflow.
    pub fn multiple(factor: f64, criterion: Arc<dyn Criterion>) -> Result<Self> {
        check_finite("factor", &[factor])?;
        if !(1.0 / CRITERION_FACTOR..=CRITERION_FACTOR).contains(&factor.abs()) {
            let bound = format!("not 0 and of a magnitude up to {CRITERION_FACTOR:e}, as its reciprocal");
            return Err(Error::OutOfRange { what: "factor".into(), value: factor, bound });
        }
        let sense = if factor < 0.0 { criterion.sense().flipped() } else { criterion.sense() };
        Ok(Self { dof: criterion.dof(), sense, terms: vec![(factor, criterion)] })
    }

    /// A sum.
    ///
    /// # Errors
    /// Criteria for different numbers of joints, or one to minimise and one to maximise (negate one of them).
    pub fn sum(a: Arc<dyn Criterion>, b: Arc<dyn Criterion>) -> Result<Self> {
        if !a.any_dof() {
            super::check_dof(&*b, a.dof())?;
        }
        if let Some(arm) = a.arm() {
            b.check_arm(arm)?;
        }
        if a.sense() != b.sense() {
            return Err(Error::Invalid(
                "a criterion to minimize and one to maximize cannot be added; multiply one of them by -1"
                    .into(),
            ));
        }
        let dof = if a.any_dof() { b.dof() } else { a.dof() };
        Ok(Self { dof, sense: a.sense(), terms: vec![(1.0, a), (1.0, b)] })
    }
}

impl Weighted {
    /// The weighted sum of what `write` writes for each term.
    fn add_up(&self, out: &mut [f64], write: impl Fn(&dyn Criterion, &mut [f64])) {
        let (mut stack, mut heap) = ([0.0; STACK_JOINTS], Vec::new());
        let one = match stack.get_mut(..out.len()) {
            Some(one) => one,
            None => {
                heap.resize(out.len(), 0.0);
                &mut heap[..]
            }
        };
        out.fill(0.0);
        for (factor, h) in &self.terms {
            write(&**h, one);
            for (out, g) in out.iter_mut().zip(&*one) {
                *out += factor * g;
            }
        }
    }
}

impl Criterion for Weighted {
    fn dof(&self) -> usize {
        self.dof
    }

    fn any_dof(&self) -> bool {
        self.terms.iter().all(|(_, h)| h.any_dof())
    }

    fn sense(&self) -> Sense {
        self.sense
    }

    fn value(&self, q: &[f64]) -> f64 {
        self.terms.iter().map(|(factor, h)| factor * h.value(q)).sum()
    }

    fn gradient(&self, q: &[f64], out: &mut [f64]) {
        self.add_up(out, |h, one| h.gradient(q, one));
    }

    /// The chain of its terms, where those that have one have the same.
    fn chain(&self) -> Option<&Chain> {
        let mut chains = self.terms.iter().filter_map(|(_, h)| h.chain());
        let first = chains.next()?;
        chains.all(|other| other == first).then_some(first)
    }

    /// That of the first term that has one.
    fn arm(&self) -> Option<&Chain> {
        self.terms.iter().find_map(|(_, h)| h.arm())
    }

    fn check_arm(&self, chain: &Chain) -> Result<()> {
        self.terms.iter().try_for_each(|(_, h)| h.check_arm(chain))
    }

    fn gradient_at(&self, q: &[f64], kinematics: &Kinematics<'_>, out: &mut [f64]) {
        self.add_up(out, |h, one| h.gradient_at(q, kinematics, one));
    }

    fn for_task(&self, task: &Task) -> Option<Arc<dyn Criterion>> {
        let new: Vec<_> = self.terms.iter().map(|(_, h)| h.for_task(task)).collect();
        if new.iter().all(Option::is_none) {
            return None;
        }
        let terms =
            self.terms.iter().zip(new).map(|((factor, h), new)| (*factor, new.unwrap_or_else(|| h.clone())));
        Some(Arc::new(Self { terms: terms.collect(), dof: self.dof, sense: self.sense }))
    }

    fn hessian(&self, q: &[f64], out: &mut DMatrix<f64>) {
        let mut one = DMatrix::zeros(q.len(), q.len());
        out.fill(0.0);
        for (factor, h) in &self.terms {
            h.hessian(q, &mut one);
            *out += *factor * &one;
        }
    }

    fn second_order_at(
        &self,
        q: &[f64],
        kinematics: &Kinematics<'_>,
        gradient: &mut [f64],
        hessian: &mut DMatrix<f64>,
    ) {
        let mut one = (vec![0.0; q.len()], DMatrix::zeros(q.len(), q.len()));
        gradient.fill(0.0);
        hessian.fill(0.0);
        for (factor, h) in &self.terms {
            h.second_order_at(q, kinematics, &mut one.0, &mut one.1);
            gradient.iter_mut().zip(&one.0).for_each(|(out, g)| *out += factor * g);
            for (out, x) in hessian.iter_mut().zip(one.1.iter()) {
                *out += factor * x;
            }
        }
    }

    fn springs(&self) -> Option<Vec<JointSpring>> {
        // The sum of w/2 (q - c)^2 is one spring with the summed weight at the weighted mean, plus a constant.
        let mut total = vec![(0.0, 0.0); self.dof];
        for (factor, h) in &self.terms {
            for ((weight, moment), s) in total.iter_mut().zip(h.springs()?) {
                *weight += factor * s.weight;
                *moment += factor * s.weight * s.center;
            }
        }
        let spring = |(weight, moment): (f64, f64)| {
            let center = if weight == 0.0 { 0.0 } else { moment / weight };
            JointSpring { weight, center }
        };
        Some(total.into_iter().map(spring).collect())
    }
}
