//! Windings of whole configurations: turning joints modulo turns, sliding joints as they are.

use super::Chain;
use crate::joint_space::{difference, nearest, wind_into, wrap};

impl Chain {
    /// Writes `to - from`, turning joints the short way round.
    #[inline]
    pub(crate) fn difference_into(&self, from: &[f64], to: &[f64], out: &mut [f64]) {
        for (i, (out, step)) in out.iter_mut().zip(self.steps()).enumerate() {
            *out = if step.rotational { difference(from[i], to[i]) } else { to[i] - from[i] };
        }
    }

    /// The winding in which joint values are understood: the principal one, unless that breaks a limit and another does not.
    pub(crate) fn wind(&self, q: &mut [f64]) {
        let limits = self.lower().iter().zip(self.upper());
        for ((q, step), (lower, upper)) in q.iter_mut().zip(self.steps()).zip(limits) {
            if step.rotational {
                *q = wind_into(wrap(*q), *lower, *upper);
            }
        }
    }

    /// Turns the joints of `q` so that it comes as near to `reference` as it can.
    pub(crate) fn wind_to(&self, q: &mut [f64], reference: &[f64]) {
        for ((q, step), reference) in q.iter_mut().zip(self.steps()).zip(reference) {
            if step.rotational {
                *q = nearest(*q, *reference);
            }
        }
    }
}
