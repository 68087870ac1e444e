//! Which joints of a reduced scheme follow the task: exchanges of one joint against another, as in a simplex tableau.
//!
//! With the rows `r_k` of `J_a^-1` and `w = J_a^-1 c_j` for a joint j outside the basis, the basis with j in the place of
//! its i-th joint has the inverse with the rows `r_i / w_i` and `r_k - (w_k / w_i) r_i`, hence
//!
//! ```text
//! |J_a'^-1|_F^2 = |J_a^-1|_F^2 + |r_i|^2 (1 + |w|^2) / w_i^2 - 2 (r_i . s) / w_i          s = sum_k w_k r_k
//! ```
//!
//! so that the measures of all neighbours cost a few products each. A basis whose volume no exchange enlarges has
//! `|w_i| <= 1` throughout and a least singular value of at least `sigma_min(J) / sqrt(1 + m (n - m))`
//! [Goreinov1997]: looking at neighbours is enough.

use super::linear::{along, dot, gram};
use super::pseudo_inverse::NormalEquations;
use crate::tolerance::BASIS_PROGRESS;

/// Most exchanges of one choice; each lowers the measure by a factor, a handful is usual.
const MOST_EXCHANGES: usize = 64;

/// The dependent joints and the others; both lists ascend.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Split {
    dependent: Vec<usize>,
    independent: Vec<usize>,
}

impl Clone for Split {
    fn clone(&self) -> Self {
        let mut out = Self::with_room_for(self.dependent.len() + self.independent.len());
        out.clone_from(self);
        out
    }

    fn clone_from(&mut self, source: &Self) {
        self.dependent.clone_from(&source.dependent);
        self.independent.clone_from(&source.independent);
    }
}

impl Split {
    /// Of these dependent joints out of n.
    pub fn new(dependent: Vec<usize>, n: usize) -> Self {
        let mut out = Self::with_room_for(n);
        out.independent.extend((0..n).filter(|i| !dependent.contains(i)));
        out.dependent.extend(dependent);
        out
    }

    /// Room for any split of n joints: nothing is allocated later.
    fn with_room_for(n: usize) -> Self {
        Self { dependent: Vec::with_capacity(n), independent: Vec::with_capacity(n) }
    }

    pub fn dependent(&self) -> &[usize] {
        &self.dependent
    }

    pub fn independent(&self) -> &[usize] {
        &self.independent
    }

    /// Columns of `J_a`.
    #[inline(always)]
    pub fn dependent_of<const M: usize>(&self, columns: &[[f64; M]]) -> [[f64; M]; M] {
        std::array::from_fn(|i| columns[self.dependent[i]])
    }

    /// Puts the independent joint at place `pair.1` where the dependent one at place `pair.0` was.
    pub fn exchange(&mut self, pair: (usize, usize)) {
        std::mem::swap(&mut self.dependent[pair.0], &mut self.independent[pair.1]);
        self.dependent.sort_unstable();
        self.independent.sort_unstable();
    }
}

/// The exchange that leaves the best basis, if it is better than the present one: places in the two lists.
pub(super) fn best<const M: usize>(
    columns: &[[f64; M]],
    split: &Split,
    equations: &NormalEquations<M>,
) -> Option<(usize, usize)> {
    let dependent = split.dependent_of(columns);
    let rows: [[f64; M]; M] = std::array::from_fn(|k| equations.solve(&dependent[k]));
    let squares: [f64; M] = std::array::from_fn(|k| along(&rows[k], &rows[k]));
    let (mut least, mut out) = (0.0, None);
    for (place, j) in split.independent.iter().enumerate() {
        let w: [f64; M] = std::array::from_fn(|k| along(&rows[k], &columns[*j]));
        let mut s = [0.0; M];
        for k in 0..M {
            for i in 0..M {
                s[i] += w[k] * rows[k][i];
            }
        }
        let grown = 1.0 + dot(&w, &w);
        for i in 0..M {
            let inverse = 1.0 / w[i];
            let change = squares[i] * grown * inverse * inverse - 2.0 * along(&rows[i], &s) * inverse;
            if change < least {
                (least, out) = (change, Some((i, place)));
            }
        }
    }
    out
}

/// A good basis from nothing: the columns that add most volume one after the other, then exchanges as long as they help.
/// `memory` holds `M n` numbers.
pub(super) fn choose<const M: usize>(columns: &[[f64; M]], memory: &mut [f64], split: &mut Split) {
    let rest = memory.as_chunks_mut::<M>().0;
    rest.copy_from_slice(columns);
    split.independent.clear();
    split.independent.extend(0..columns.len());
    split.dependent.clear();
    for _ in 0..M {
        let size = |place: usize| dot(&rest[split.independent[place]], &rest[split.independent[place]]);
        // The first of the largest.
        let place = (1..split.independent.len()).fold(0, |a, b| if size(b) > size(a) { b } else { a });
        let square = size(place);
        let j = split.independent.remove(place);
        split.dependent.push(j);
        let unit = rest[j];
        if square > 0.0 {
            for other in rest.iter_mut() {
                let part = along(other, &unit) / square;
                for i in 0..M {
                    other[i] -= part * unit[i];
                }
            }
        }
    }
    split.dependent.sort_unstable();
    improve(columns, split);
}

/// Exchanges as long as they help.
pub(super) fn improve<const M: usize>(columns: &[[f64; M]], split: &mut Split) {
    let equations_of = |split: &Split| NormalEquations::new(gram(&split.dependent_of(columns)));
    let Some(mut equations) = equations_of(split) else { return };
    for _ in 0..MOST_EXCHANGES {
        let Some(pair) = best(columns, split, &equations) else { return };
        let (before, after) = (split.dependent[pair.0], split.independent[pair.1]);
        split.exchange(pair);
        match equations_of(split) {
            Some(new) if new.trace() <= BASIS_PROGRESS * equations.trace() => equations = new,
            _ => {
                // Rounding only: back again.
                let place = |list: &[usize], joint: usize| list.iter().position(|x| *x == joint).unwrap_or(0);
                split.exchange((place(&split.dependent, after), place(&split.independent, before)));
                return;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn trace(columns: &[[f64; 6]], dependent: &[usize]) -> f64 {
        let a = nalgebra::Matrix6::from_fn(|i, j| columns[dependent[j]][i]);
        a.try_inverse().map_or(f64::INFINITY, |inverse| inverse.norm_squared())
    }

    /// Against all bases, each inverted by nalgebra.
    #[test]
    fn exchanges_are_ranked_right_and_lead_near_the_best_basis() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut worst: f64 = 1.0;
        for case in 0..400 {
            let n = 7 + case % 4;
            let columns: Vec<[f64; 6]> =
                (0..n).map(|_| std::array::from_fn(|_| rng.random_range(-1.0..1.0))).collect();
            let split = Split::new((0..6).collect(), n);
            let equations = NormalEquations::new(gram(&split.dependent_of(&columns))).expect("regular");
            let mut expected = trace(&columns, split.dependent());
            for i in 0..6 {
                for place in 0..n - 6 {
                    let mut other = split.clone();
                    other.exchange((i, place));
                    expected = expected.min(trace(&columns, other.dependent()));
                }
            }
            let mut found = split.clone();
            if let Some(pair) = best(&columns, &split, &equations) {
                found.exchange(pair);
            }
            assert!((trace(&columns, found.dependent()) / expected - 1.0).abs() < 1e-6);

            let mut chosen = split.clone();
            choose(&columns, &mut vec![0.0; 6 * n], &mut chosen);
            let mut all: Vec<usize> =
                chosen.dependent().iter().chain(chosen.independent()).copied().collect();
            all.sort_unstable();
            assert_eq!(all, (0..n).collect::<Vec<_>>());
            let mut least = f64::INFINITY;
            for mask in 0_u32..1 << n {
                if mask.count_ones() == 6 {
                    let dependent: Vec<usize> = (0..n).filter(|j| mask >> j & 1 == 1).collect();
                    least = least.min(trace(&columns, &dependent));
                }
            }
            worst = worst.max(trace(&columns, chosen.dependent()) / least);
        }
        assert!(worst < 4.0, "{worst}");
    }

    #[test]
    fn a_singular_jacobian_has_a_basis_all_the_same() {
        let columns = [[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]];
        let mut split = Split::new(vec![0, 1, 3], 4);
        choose(&columns, &mut [0.0; 12], &mut split);
        assert_eq!((split.dependent().len(), split.independent().len()), (3, 1));
        assert!(split.dependent().contains(&2));
    }
}
