//! Joint-space lines over a path of poses: where they can start, and how they go on.
//!
//! A line starts from a configuration over the first pose and follows by Newton's method from point to point, with the
//! configuration of the point before, moved on by the last step, as its start. It stays on its branch as long as it keeps
//! clear of singular configurations; a step of more than [`JOINT_JUMP`] ends it. With more joints than six the step is the
//! shortest one.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::chain::{Chain, JointKind};
use crate::joint_space::{most_apart, nearest, shift, shift_within};
use crate::kinematics::{Corrector, CorrectorSettings, StepBound, Task};
use crate::pose::Pose;
use crate::solutions::ClosedForm;
use crate::tolerance::{JOINT_JUMP, LINE_DEFECT, LINE_RESIDUAL, LINE_SINGULAR, SAME_LINE, START_NEAR};

/// Most Newton steps from one point of a path to the next.
const NEWTON_STEPS: usize = 12;
/// Most damped steps from a random configuration, and how many of those are tried where there is no closed form.
const START_STEPS: usize = 60;
const START_DRAWS: usize = 120;

/// Why a line ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LineEnd {
    /// Newton does not meet the pose.
    Lost,
    /// It does, beyond a jump.
    Jump,
}

/// Newton's method from one point of a path to the next: quadratic convergence leaves rounding after the last step.
const ALONG: CorrectorSettings = CorrectorSettings {
    steps: NEWTON_STEPS,
    bound: StepBound::Joint(JOINT_JUMP),
    strict: false,
    last_step: 0.0,
    last_error: LINE_RESIDUAL,
    singular: LINE_SINGULAR,
    travel: f64::INFINITY,
    tangents: false,
};

/// The line from `start` over all poses, row by row; where it ends early, the point that it does not reach and why.
pub(crate) fn follow(chain: &Chain, poses: &[Pose], start: &[f64]) -> Result<Vec<f64>, (usize, LineEnd)> {
    let n = chain.dof();
    let first = poses.first().copied().unwrap_or_else(Pose::identity);
    let Ok(mut corrector) = Corrector::new(chain, Task::POSE, &first) else { return Err((0, LineEnd::Lost)) };
    let mut line = vec![0.0; n * poses.len()];
    let mut q = start.to_vec();
    for (k, pose) in poses.iter().enumerate() {
        if k > 1 {
            for j in 0..n {
                q[j] += line[(k - 1) * n + j] - line[(k - 2) * n + j];
            }
        }
        corrector.set_target(pose);
        if !corrector.solve(&mut q, &ALONG) {
            return Err((k, LineEnd::Lost));
        }
        if k > 0 && (0..n).any(|j| (q[j] - line[(k - 1) * n + j]).abs() > JOINT_JUMP) {
            return Err((k, LineEnd::Jump));
        }
        line[k * n..(k + 1) * n].copy_from_slice(&q);
    }
    Ok(line)
}

/// Shifts every turning joint by whole turns so that the line holds the limits, nearest to the middle of the range. The
/// first joint that cannot, and the first point outside with the fewest turns of it.
pub(crate) fn wind(chain: &Chain, line: &mut [f64]) -> Result<(), (usize, usize)> {
    let n = chain.dof();
    for (j, joint) in chain.joints().iter().enumerate() {
        let (lo, hi) = (joint.limits.lower, joint.limits.upper);
        let column = || line.iter().skip(j).step_by(n).copied();
        let (least, most) =
            column().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), q| (a.min(q), b.max(q)));
        if joint.kind == JointKind::Continuous || (lo == f64::NEG_INFINITY && hi == f64::INFINITY) {
            continue;
        }
        let (shift, fits) = if joint.kind == JointKind::Prismatic {
            (0.0, least >= lo && most <= hi)
        } else {
            shift_within([least, most], lo, hi)
        };
        if !fits {
            let outside = column().position(|q| q + shift < lo || q + shift > hi).unwrap_or(0);
            return Err((j, outside));
        }
        for q in line.iter_mut().skip(j).step_by(n) {
            *q += shift;
        }
    }
    Ok(())
}

/// Configurations over a pose, from the closed form where there is one, else from seeded random starts. Joints modulo turns.
pub(crate) fn starts(chain: &Chain, form: Option<&dyn ClosedForm>, pose: &Pose) -> Vec<Vec<f64>> {
    if let Some(form) = form {
        return distinct(form.starts(pose).into_iter());
    }
    let Ok(mut corrector) = Corrector::new(chain, Task::POSE, pose) else { return Vec::new() };
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let draws = (0..START_DRAWS).filter_map(|_| {
        let mut q: Vec<f64> = (0..chain.dof())
            .map(|j| {
                let (lo, hi) =
                    (chain.lower()[j].max(-std::f64::consts::PI), chain.upper()[j].min(std::f64::consts::PI));
                if lo < hi { rng.random_range(lo..=hi) } else { 0.5 * (lo + hi) }
            })
            .collect();
        for _ in 0..START_STEPS {
            let size = corrector.evaluate(&q).iter().map(|e| e * e).sum::<f64>().sqrt();
            if size < START_NEAR {
                return corrector.solve(&mut q, &ALONG).then_some(q);
            }
            corrector.damped_step(&mut q, 0.05 * size.min(1.0), StepBound::Joint(0.5));
        }
        None
    });
    distinct(draws)
}

/// All lines over the poses at once, from the closed form of an arm with isolated configurations: one solution per pose
/// gives all branches. Lines that end or jump are left out. `None` for other arms, and where rounding in the description
/// would show in second derivatives.
pub(crate) fn all_branches(form: &dyn ClosedForm, poses: &[Pose]) -> Option<Vec<Vec<f64>>> {
    if form.branches() == 0 || form.defect().largest() > LINE_DEFECT {
        return None;
    }
    let n = form.chain().dof();
    let mut lines: Vec<Option<Vec<f64>>> = vec![Some(Vec::with_capacity(n * poses.len())); form.branches()];
    let mut rows = vec![0.0; n * form.branches()];
    for pose in poses {
        let mask = form.branches_into(pose, &mut rows);
        for ((b, line), row) in lines.iter_mut().enumerate().zip(rows.chunks_exact(n)) {
            let Some(values) = line else { continue };
            let mut holds = mask & (1 << b) != 0;
            let before = values.len().checked_sub(n);
            for (j, q) in row.iter().enumerate() {
                let value = before.map_or(*q, |at| nearest(*q, values[at + j]));
                holds &= before.is_none_or(|at| (value - values[at + j]).abs() <= JOINT_JUMP);
                values.push(value);
            }
            if !holds {
                *line = None;
            }
        }
    }
    let lines: Vec<Vec<f64>> = lines.into_iter().flatten().collect();
    if lines.is_empty() { None } else { Some(lines) }
}

/// The line whose beginning is nearest to `start`, in the winding of `start`; `None` as [`all_branches`], or where none is near.
pub(crate) fn branch_from(form: &dyn ClosedForm, poses: &[Pose], start: &[f64]) -> Option<Vec<f64>> {
    let away = |line: &[f64]| most_apart(&line[..start.len().min(line.len())], start);
    let mut line = all_branches(form, poses)?.into_iter().min_by(|a, b| away(a).total_cmp(&away(b)))?;
    if away(&line) > JOINT_JUMP {
        return None;
    }
    let shifts: Vec<f64> = line.iter().zip(start).map(|(q, s)| shift(s - q)).collect();
    for row in line.chunks_exact_mut(shifts.len()) {
        for (q, shift) in row.iter_mut().zip(&shifts) {
            *q += shift;
        }
    }
    Some(line)
}

/// Points that no configuration reaches, joint limits aside: exact for arms with a closed form, otherwise those that are
/// further from the first joint than the arm is long.
pub(crate) fn unreachable(chain: &Chain, form: Option<&dyn ClosedForm>, poses: &[Pose]) -> Vec<usize> {
    let out = |reached: &dyn Fn(&Pose) -> bool| (0..poses.len()).filter(|k| !reached(&poses[*k])).collect();
    if let Some(form) = form {
        return out(&|pose: &Pose| form.in_reach(pose));
    }
    let base = chain.base() * chain.joints().first().map_or_else(Pose::identity, |j| j.placement);
    let reach = reach(chain);
    out(&|pose: &Pose| (pose.translation.vector - base.translation.vector).norm() <= reach)
}

/// Distance from the first joint beyond which nothing can be reached: frame to frame, added up.
pub(super) fn reach(chain: &Chain) -> f64 {
    chain.reach()
}

/// Without those that differ from an earlier one by whole turns only.
fn distinct(rows: impl Iterator<Item = Vec<f64>>) -> Vec<Vec<f64>> {
    let mut kept: Vec<Vec<f64>> = Vec::new();
    for q in rows {
        if !kept.iter().any(|other| most_apart(&q, other) < SAME_LINE) {
            kept.push(q);
        }
    }
    kept
}
