//! A sampled patch of a self-motion of two dimensions.

use nalgebra::DVector;

use super::curve::geometric;
use crate::chain::Chain;
use crate::criterion::check_redundant;
use crate::error::{Error, Result};
use crate::kinematics::{Corrector, Task};

/// A sampled patch of a self-motion of two dimensions: points `q(a, b)` over the grid `a, b in {-k..k} spacing`
/// along the two null directions of the start, each brought back to the task value. Where that fails the entry is
/// `None`.
///
/// # Errors
/// As [`trace_self_motion`](crate::solutions::trace_self_motion); a task that leaves not exactly two freedoms, a spacing that is not in (0, 0.5], more than
/// 500 steps.
pub fn self_motion_patch(
    chain: &Chain,
    q: &[f64],
    task: Task,
    spacing: f64,
    steps: usize,
) -> Result<Vec<Option<Vec<f64>>>> {
    chain.check_q(q)?;
    check_redundant(chain, &task)?;
    let (n, m) = (chain.dof(), task.dim());
    if n != m + 2 {
        let message =
            format!("a patch needs two spare freedoms, '{}' has {} under '{task}'", chain.name(), n - m);
        return Err(Error::Invalid(message));
    }
    if !(spacing > 0.0 && spacing <= 0.5) {
        return Err(Error::OutOfRange {
            what: "spacing".into(),
            value: spacing,
            bound: "> 0 and <= 0.5".into(),
        });
    }
    if steps > 500 {
        return Err(Error::OutOfRange { what: "steps".into(), value: steps as f64, bound: "<= 500".into() });
    }
    let mut fibre = Corrector::new(chain, geometric(task), &chain.forward_unchecked(q))?;
    fibre.evaluate(q);
    let basis = fibre.basis().clone();
    let start = DVector::from_column_slice(q);
    let side = 2 * steps + 1;
    let mut out: Vec<Option<Vec<f64>>> = vec![None; side * side];
    let place = |a: isize, b: isize| ((a + steps as isize) as usize) * side + (b + steps as isize) as usize;
    // From the centre outwards: the nearest point that is known carries the correction.
    let mut order: Vec<(isize, isize)> = (-(steps as isize)..=steps as isize)
        .flat_map(|a| (-(steps as isize)..=steps as isize).map(move |b| (a, b)))
        .collect();
    order.sort_by_key(|(a, b)| (a.abs().max(b.abs()), a.abs() + b.abs(), *a, *b));
    for (a, b) in order {
        let flat =
            |a: isize, b: isize| &start + (basis.column(0) * a as f64 + basis.column(1) * b as f64) * spacing;
        let inner = (a - a.signum(), b - b.signum());
        let known = out[place(inner.0, inner.1)].clone();
        let mut point: Vec<f64> = match known {
            _ if (a, b) == (0, 0) => q.to_vec(),
            Some(known) => {
                (DVector::from_vec(known) + flat(a, b) - flat(inner.0, inner.1)).as_slice().to_vec()
            }
            None => continue,
        };
        if fibre.correct(&mut point, 2.0 * spacing) {
            out[place(a, b)] = Some(point);
        }
    }
    Ok(out)
}
