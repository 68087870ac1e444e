//! Curves on which critical points vanish, where `mu = 0, det W = 0` leave one freedom.
//!
//! The points of a [`SingularitySearch`] are starts. From each that lies on no curve yet the set is followed in both
//! directions: a step along the kernel of the derivative of `[mu; det W]`, then Newton's method the shortest way back. A
//! step is halved where the tangent turns by more than [`TURN`] or the way back is long. A curve is closed where it passes
//! its start. It ends where the task Jacobian loses rank, where the derivative does (there it crosses another one), and
//! for criteria of joint values, to which whole turns make a difference, where a joint changes its winding.

use super::singularity::{SingularPoint, SingularPointSearch, SingularitySearch, SingularitySettings};
use crate::chain::Chain;
use crate::criterion::Criterion;
use crate::error::{Error, Result};
use crate::kinematics::Task;
use crate::tolerance::{FOLLOW_DONE, FOLLOW_SHORTEST, SINGULARITY_RANK};

/// Most rows in one direction.
const ROWS: usize = 20_000;
/// Most that the tangent turns in one step, rad.
const TURN: f64 = 0.2;
/// Distance from a segment, in units of its length, below which a point lies on the curve: the arc of [`TURN`] is at most
/// `TURN / 8` away from its chord.
const ON_CURVE: f64 = 0.05;

/// Configurations at which critical points vanish, in order.
#[derive(Debug, Clone, PartialEq)]
pub struct SingularityCurve {
    /// Rows of n joint values. Joints run on beyond half a turn where whole turns make no difference to the criterion; the
    /// first joint is zero where it is free. The last row of a closed curve is the first one, up to whole turns.
    pub q: Vec<f64>,
    /// Whether it ends where it began.
    pub closed: bool,
    /// Whether every value of the first joint gives such a curve.
    pub first_joint_free: bool,
}

/// The curves of configurations where critical points of `criterion` vanish for some value of the task, longest first, in
/// steps of at most `step` (rad or m). Curves without one of the search's points are missed.
///
/// ```
/// use redundancy_core::{chain::catalog, criterion::Posture, kinematics::Task};
/// use redundancy_core::optimum::{SingularitySettings, singularity_curves};
/// let arm = catalog::load("planar3r")?;
/// let h = Posture::new(&[0.3, 0.5, 0.7])?; // depends on the first joint: no isolated points
/// let settings = SingularitySettings { starts: 300, ..SingularitySettings::default() };
/// let curves = singularity_curves(&arm, &h, Task::PLANAR, &settings, 0.05)?;
/// assert_eq!(curves.len(), 8);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
///
/// # Errors
/// As [`algorithmic_singularities`](super::algorithmic_singularities) and [`SingularitySearch::check_curves`].
pub fn singularity_curves(
    chain: &Chain,
    criterion: &dyn Criterion,
    task: Task,
    settings: &SingularitySettings,
    step: f64,
) -> Result<Vec<SingularityCurve>> {
    let mut search = SingularitySearch::new(chain, criterion, task, settings)?;
    search.check_curves(step)?;
    search.run(search.starts());
    let mut tracer = search.tracer(step)?;
    tracer.run(tracer.starts());
    Ok(tracer.finish())
}

/// Follows the curves through the points of a search, piece by piece.
#[derive(Debug)]
pub struct SingularityTracer<'a> {
    chain: &'a Chain,
    search: SingularPointSearch<'a>,
    free: bool,
    periodic: bool,
    step: f64,
    starts: std::vec::IntoIter<SingularPoint>,
    curves: Vec<SingularityCurve>,
}

impl<'a> SingularitySearch<'a> {
    /// Checks what [`tracer`](Self::tracer) needs, before the search.
    ///
    /// # Errors
    /// A set of another dimension than one, a step that is not in [1e-4, 0.5].
    pub fn check_curves(&self, step: f64) -> Result<()> {
        if !(1e-4..=0.5).contains(&step) {
            let (what, bound) = ("step".into(), "from 1e-4 to 0.5".into());
            return Err(Error::OutOfRange { what, value: step, bound });
        }
        let dimension = self.dimension();
        if dimension != Some(1) {
            let has = dimension.map_or("is empty".into(), |d| format!("has {d} dimensions"));
            return Err(Error::Invalid(format!(
                "the set of algorithmic singularities {has} here; curves have one dimension"
            )));
        }
        Ok(())
    }

    /// Ends the search; its points are the starts of curves with steps of at most `step` (rad or m).
    ///
    /// # Errors
    /// As [`check_curves`](Self::check_curves).
    pub fn tracer(self, step: f64) -> Result<SingularityTracer<'a>> {
        self.check_curves(step)?;
        let (chain, free, periodic) = (self.chain(), self.first_joint_free(), self.periodic());
        let search = self.newton();
        Ok(SingularityTracer {
            chain,
            search,
            free,
            periodic,
            step,
            starts: self.finish().into_iter(),
            curves: Vec::new(),
        })
    }
}

impl SingularityTracer<'_> {
    /// How many starts have not been tried.
    pub fn starts(&self) -> usize {
        self.starts.len()
    }

    /// Looks at up to `count` starts.
    pub fn run(&mut self, count: usize) {
        for _ in 0..count {
            let Some(start) = self.starts.next() else { return };
            if !self.is_known(&start.q) {
                let curve = self.trace(&start.q);
                self.curves.extend(curve);
            }
        }
    }

    /// The curves, longest first.
    pub fn finish(mut self) -> Vec<SingularityCurve> {
        self.curves.sort_by_key(|curve| std::cmp::Reverse(curve.q.len()));
        self.curves
    }

    /// The way from `a` to `b`, the short one where whole turns make no difference.
    fn way(&self, a: &[f64], b: &[f64], out: &mut [f64]) {
        if self.periodic {
            self.chain.difference_into(a, b, out);
        } else {
            out.iter_mut().zip(a.iter().zip(b)).for_each(|(out, (a, b))| *out = b - a);
        }
    }

    /// Whether `q` has left its winding and whole turns make a difference.
    fn leaves(&self, q: &[f64]) -> bool {
        let mut wound = q.to_vec();
        self.chain.wind(&mut wound);
        !self.periodic && wound.iter().zip(q).any(|(a, b)| (a - b).abs() > 1.0)
    }

    /// Whether `q` lies on a curve that was followed.
    fn is_known(&self, q: &[f64]) -> bool {
        let n = q.len();
        let mut d = vec![0.0; n];
        self.curves.iter().any(|curve| {
            let rows = curve.q.chunks_exact(n);
            rows.clone().zip(rows.skip(1)).any(|(a, b)| {
                self.way(a, q, &mut d);
                let (mut along, mut length, mut away) = (0.0, 0.0, 0.0);
                for ((a, b), d) in a.iter().zip(b).zip(&d) {
                    along += (b - a) * d;
                    length += (b - a) * (b - a);
                    away += d * d;
                }
                let share = if length > 0.0 { (along / length).clamp(0.0, 1.0) } else { 0.0 };
                let squared = away - share * (2.0 * along - share * length);
                squared <= ON_CURVE * ON_CURVE * length
            })
        })
    }

    /// The curve through `start`; none where it is an isolated point of the set.
    fn trace(&mut self, start: &[f64]) -> Option<SingularityCurve> {
        let mut q = start.to_vec();
        let tangent = self.correct(&mut q, 1.0)?;
        let (mut forward, closed) = self.follow(&q, &tangent);
        if !closed {
            let back: Vec<f64> = tangent.iter().map(|t| -t).collect();
            let (rows, _) = self.follow(&q, &back);
            let mut all: Vec<f64> = rows.chunks_exact(q.len()).skip(1).rev().flatten().copied().collect();
            all.append(&mut forward);
            forward = all;
        }
        (forward.len() > q.len()).then_some(SingularityCurve {
            q: forward,
            closed,
            first_joint_free: self.free,
        })
    }

    /// Newton's method, the shortest way and at most `reach`; the tangent there.
    fn correct(&mut self, q: &mut [f64], reach: f64) -> Option<Vec<f64>> {
        const STEPS: usize = 8;
        let (mut before, mut way) = (f64::INFINITY, 0.0);
        for _ in 0..STEPS {
            let length = self.search.step(q, reach)?;
            way += length;
            if way > reach {
                return None;
            }
            if length <= FOLLOW_DONE || length <= 1e3 * FOLLOW_DONE && length >= 0.5 * before {
                return (self.search.rank(q) > SINGULARITY_RANK).then(|| self.search.tangent());
            }
            before = length;
        }
        None
    }

    /// Rows from `start` on along `tangent`, and whether they come back to it.
    fn follow(&mut self, start: &[f64], tangent: &[f64]) -> (Vec<f64>, bool) {
        let first = usize::from(self.free);
        let mut rows = start.to_vec();
        let (mut q, mut t, mut h) = (start.to_vec(), tangent.to_vec(), self.step);
        let mut d = vec![0.0; q.len()];
        for _ in 0..ROWS {
            let (next, turned, cosine) = loop {
                let mut next = q.clone();
                next[first..].iter_mut().zip(&t).for_each(|(q, t)| *q += h * t);
                if let Some(mut turned) = self.correct(&mut next, 0.3 * h) {
                    let cosine: f64 = turned.iter().zip(&t).map(|(a, b)| a * b).sum();
                    if cosine.abs() >= TURN.cos() {
                        turned.iter_mut().for_each(|x| *x *= cosine.signum());
                        break (next, turned, cosine.abs());
                    }
                }
                h *= 0.5;
                if h < FOLLOW_SHORTEST {
                    return (rows, false);
                }
            };
            // Has the start been passed? Its distance ahead of the last row lies within this step.
            if rows.len() > q.len() {
                self.way(&q, start, &mut d);
                let ahead: f64 = d[first..].iter().zip(&t).map(|(d, t)| d * t).sum();
                let beside = d.iter().map(|d| d * d).sum::<f64>() - ahead * ahead;
                let same: f64 = tangent.iter().zip(&t).map(|(a, b)| a * b).sum();
                if ahead > 0.0 && ahead <= h && beside <= (0.3 * h).powi(2) && same >= TURN.cos() {
                    rows.extend(q.iter().zip(&d).map(|(q, d)| q + d));
                    return (rows, true);
                }
            }
            if self.leaves(&next) {
                return (rows, false);
            }
            rows.extend(&next);
            (q, t) = (next, turned);
            if cosine > (0.5 * TURN).cos() {
                h = (1.5 * h).min(self.step);
            }
        }
        (rows, false)
    }
}
