//! Tasks with strict priorities within limits, beside a sequence of problems that clarabel solves and the conditions of an
//! optimum.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use redundancy_core::Status;
use redundancy_core::chain::{Chain, ChainBuilder, DhConvention, DhRow, Limits, catalog};
use redundancy_core::kinematics::{JacobianOf, Task};
use redundancy_core::nalgebra::{DMatrix, DVector, Vector3};
use redundancy_core::velocity::{PrioritizedNullspace, PriorityTask, StepInput};

use crate::allocations;
use crate::support::{amount, random_q};
use crate::velocity::{clarabel, stated_bounds};

/// Fourteen joints, as two arms hand to hand have.
fn long_arm() -> Chain {
    let rows: Vec<DhRow> = (0..14)
        .map(|i| DhRow {
            a: if i % 4 == 1 { 0.05 } else { 0.0 },
            d: if i % 2 == 0 { 0.25 } else { 0.0 },
            alpha: if i % 2 == 0 { 1.6 } else { -1.5 },
            theta: 0.1 * f64::from(i),
        })
        .collect();
    let arm = ChainBuilder::from_dh("long", &rows, DhConvention::Standard).build().unwrap();
    let limits = Limits { lower: -2.5, upper: 2.5, velocity: 2.0, acceleration: 20.0, effort: f64::INFINITY };
    arm.with_limits(&[limits; 14]).unwrap()
}

/// The same arm with random narrow limits around `q`.
fn narrowed(rng: &mut ChaCha8Rng, arm: &Chain, q: &[f64]) -> Chain {
    let limits: Vec<Limits> = q
        .iter()
        .map(|q| {
            let range = rng.random_range(0.05..2.0);
            let below = rng.random_range(0.0..range);
            let (velocity, acceleration) = (rng.random_range(0.2..2.0), rng.random_range(1.0..40.0));
            Limits {
                lower: q - below,
                upper: q - below + range,
                velocity,
                acceleration,
                effort: f64::INFINITY,
            }
        })
        .collect();
    arm.with_limits(&limits).unwrap()
}

/// A random problem: an arm with limits, three to five levels, velocities and a wish.
struct Problem {
    arm: Chain,
    tasks: Vec<PriorityTask>,
    velocities: Vec<Vec<f64>>,
    q: Vec<f64>,
    before: Vec<f64>,
    wish: Vec<f64>,
    dt: f64,
}

fn problem(rng: &mut ChaCha8Rng, run: usize) -> Problem {
    let arm = match run % 4 {
        0 => catalog::load("iiwa14").unwrap(),
        1 | 2 => catalog::load("dexter").unwrap(),
        _ => long_arm(),
    };
    let n = arm.dof();
    let q = random_q(rng, &arm);
    let arm = narrowed(rng, &arm, &q);
    let dt = [0.002, 0.01][run % 2];
    let before: Vec<f64> =
        arm.joints().iter().map(|j| rng.random_range(-0.3..0.3) * j.limits.velocity).collect();
    let (mut tasks, mut velocities) = (Vec::new(), Vec::new());
    let mut stacked = DMatrix::zeros(0, n);
    let speed = [0.1, 0.5, 2.0][run % 3];
    for level in 0..4 {
        let link = if level == 0 { None } else { Some(rng.random_range(0..arm.links().len())) };
        if rng.random_range(0..4) == 0 {
            let mut any = || std::array::from_fn(|_| rng.random_range(-0.7..0.7));
            let (a, b): ([f64; 3], [f64; 3]) = (any(), any());
            let task = match level % 2 {
                0 => PriorityTask::half_space(link, a, b),
                _ => PriorityTask::cone(link, a, b, rng.random_range(0.1..2.0)),
            };
            tasks.push(task.unwrap());
            velocities.push(Vec::new());
            continue;
        }
        let task = if rng.random_range(0..2) == 0 { Task::PLANAR } else { Task::POSITION };
        let task = if level == 0 && n > 7 && rng.random_range(0..2) == 0 { Task::POSE } else { task };
        // Of full rank beside those above, so that clarabel's equations can be met.
        let of = JacobianOf { link, ..JacobianOf::default() };
        let rows = arm.jacobian_of(&q, &of).unwrap().rows(0, task.dim()).into_owned();
        let mut both = stacked.clone().resize_vertically(stacked.nrows() + task.dim(), 0.0);
        both.rows_mut(stacked.nrows(), task.dim()).copy_from(&rows);
        if both.nrows() > n || both.clone().singular_values().min() < 0.02 {
            continue;
        }
        stacked = both;
        tasks.push(PriorityTask::Motion { task, link });
        if run.is_multiple_of(5) {
            velocities.push((0..task.dim()).map(|_| speed * rng.random_range(-1.0..1.0)).collect());
            continue;
        }
        // Near a multiple of what the arm does already, so that acceleration limits leave a scale.
        let near = DVector::from_fn(n, |i, _| {
            before[i] + rng.random_range(-0.5..0.5) * dt * arm.joints()[i].limits.acceleration
        });
        velocities.push(([1.0, 1.5, 4.0][run % 3] * rows * near).as_slice().to_vec());
    }
    if tasks.is_empty() {
        tasks.push(PriorityTask::Motion { task: Task::POSITION, link: None });
        velocities.push(vec![0.1, -0.2, 0.3]);
    }
    let wish = (0..n).map(|_| rng.random_range(-1.0..1.0)).collect();
    Problem { arm, tasks, velocities, q, before, wish, dt }
}

impl Problem {
    /// Rows of a level, and of an inequality its bound, from the public Jacobian.
    fn rows(&self, level: usize) -> (DMatrix<f64>, f64) {
        let task = self.tasks[level];
        let of = JacobianOf { link: task.link(), ..JacobianOf::default() };
        let j = self.arm.jacobian_of(&self.q, &of).unwrap();
        let pose = match task.link() {
            None => self.arm.forward(&self.q).unwrap(),
            Some(link) => self.arm.forward_link(&self.q, link).unwrap(),
        };
        let (row, room) = match task {
            PriorityTask::Motion { task, .. } => return (j.rows(0, task.dim()).into_owned(), 0.0),
            PriorityTask::HalfSpace { point, normal, .. } => {
                (normal.transpose() * j.rows(0, 3), normal.dot(&(pose.translation.vector - point)))
            }
            PriorityTask::Cone { axis, direction, half_angle, .. } => {
                let carried = pose.rotation * axis.into_inner();
                let direction = direction.into_inner();
                let cross = carried.cross(&direction).normalize();
                (cross.transpose() * j.rows(3, 3), half_angle - carried.angle(&direction))
            }
        };
        let braking: f64 =
            row.iter().zip(self.arm.joints()).map(|(g, joint)| g.abs() * joint.limits.acceleration).sum();
        let speed = 5.0 * room;
        let speed = if room > 0.0 { speed.min((2.0 * braking * room).sqrt()) } else { speed };
        (DMatrix::from_row_slice(1, self.q.len(), row.as_slice()), -speed)
    }

    /// By clarabel: the joint velocity and the added unknown `x` with the least `x P x / 2 + c x`, where the levels before
    /// `level` have what `done` says; `row` is one more equation, `free` the bounds of the added unknown.
    fn solve(
        &self,
        done: &[(DMatrix<f64>, Vec<f64>, bool)],
        quadratic: bool,
        last: Option<(&DMatrix<f64>, &[f64], f64, f64, f64)>,
    ) -> Option<Vec<f64>> {
        let n = self.q.len();
        let limits: Vec<Limits> = self.arm.joints().iter().map(|j| j.limits).collect();
        let mut bounds: Vec<(f64, f64)> =
            (0..n).map(|i| stated_bounds(&limits[i], self.q[i], Some(self.before[i]), self.dt)).collect();
        let extra = done.iter().filter(|d| d.2).count() + usize::from(last.is_some());
        let (mut rows, mut right): (Vec<DVector<f64>>, Vec<f64>) = (Vec::new(), Vec::new());
        let mut column = n;
        for (j, value, inequality) in done {
            for i in 0..j.nrows() {
                let mut row = DVector::zeros(n + extra);
                row.rows_mut(0, n).copy_from(&j.row(i).transpose());
                if *inequality {
                    row[column] = -1.0;
                    column += 1;
                    bounds.push((value[i], f64::INFINITY));
                    right.push(0.0);
                } else {
                    right.push(value[i]);
                }
                rows.push(row);
            }
        }
        // Where limits exclude each other one velocity is left: an equation, for a method that needs an inside.
        for (i, bound) in bounds.iter_mut().enumerate().take(n).filter(|(_, (low, high))| high - low < 1e-9) {
            let mut row = DVector::zeros(n + extra);
            row[i] = 1.0;
            rows.push(row);
            right.push(bound.0);
            *bound = (f64::NEG_INFINITY, f64::INFINITY);
        }
        let (mut p, mut c) = (DMatrix::zeros(n + extra, n + extra), vec![0.0; n + extra]);
        if let Some((j, v, low, high, sign)) = last {
            for i in 0..j.nrows() {
                let mut row = DVector::zeros(n + extra);
                row.rows_mut(0, n).copy_from(&j.row(i).transpose());
                row[column] = -v[i];
                rows.push(row);
                right.push(0.0);
            }
            bounds.push((low, high));
            c[column] = sign;
        }
        if quadratic {
            for i in 0..n {
                p[(i, i)] = 1.0;
                c[i] = -self.wish[i];
            }
        }
        let a = DMatrix::from_fn(rows.len(), n + extra, |i, k| rows[i][k]);
        clarabel(&p, &c, &a, &right, &bounds)
    }
}

/// What is above is fixed a little below what it has: an interior is left for clarabel.
const SLACK: f64 = 1e-8;

/// Normals of all that holds at `qd`, into what is allowed: equations both ways, inequalities and limits where they are met
/// with equality. With `extra` zeros for further unknowns.
fn normals_at(
    problem: &Problem,
    done: &[(DMatrix<f64>, Vec<f64>, bool)],
    qd: &[f64],
    extra: usize,
) -> Vec<DVector<f64>> {
    let n = qd.len();
    let mut normals: Vec<DVector<f64>> = Vec::new();
    for (j, value, inequality) in done {
        for i in 0..j.nrows() {
            let row = j.row(i).transpose();
            if !inequality {
                normals.push(-&row);
            } else if row.dot(&DVector::from_column_slice(qd)) > value[i] + SLACK + 1e-10 {
                continue;
            }
            normals.push(row);
        }
    }
    for (i, joint) in problem.arm.joints().iter().enumerate() {
        let (low, high) = stated_bounds(&joint.limits, problem.q[i], Some(problem.before[i]), problem.dt);
        for (bound, sign) in [(low, 1.0), (high, -1.0)] {
            if (qd[i] - bound).abs() < 1e-11 {
                normals.push(DVector::from_fn(n, |k, _| if k == i { sign } else { 0.0 }));
            }
        }
    }
    normals.into_iter().map(|a| a.resize_vertically(n + extra, 0.0)).collect()
}

/// How far the slope of what is minimised is from every sum of the normals with weights >= 0: zero at an optimum, after
/// Karush, Kuhn and Tucker. By the non-negative least squares of Lawson and Hanson.
pub fn missed_conditions(normals: &[DVector<f64>], goal: &DVector<f64>) -> f64 {
    let n = goal.len();
    let units: Vec<DVector<f64>> = normals.iter().map(|a| a.normalize()).collect();
    let (mut chosen, mut weights): (Vec<usize>, Vec<f64>) = (Vec::new(), Vec::new());
    let mut rest = goal.clone();
    for _ in 0..200 {
        let free = (0..units.len()).filter(|k| !chosen.contains(k));
        let Some(next) = free.max_by(|a, b| units[*a].dot(&rest).total_cmp(&units[*b].dot(&rest))) else {
            break;
        };
        // n independent directions leave only rounding.
        if chosen.len() == n || units[next].dot(&rest) < 1e-12 * weights.iter().copied().fold(1.0, f64::max) {
            break;
        }
        chosen.push(next);
        weights.push(0.0);
        loop {
            let a = DMatrix::from_fn(n, chosen.len(), |i, k| units[chosen[k]][i]);
            let qr = a.qr();
            let Some(best) = qr.r().solve_upper_triangular(&(qr.q().transpose() * goal)) else {
                return rest.norm();
            };
            let negative = (0..chosen.len()).filter(|k| best[*k] <= 0.0);
            let share = |k: usize| weights[k] / (weights[k] - best[k]).max(f64::MIN_POSITIVE);
            let Some(leaving) = negative.min_by(|a, b| share(*a).total_cmp(&share(*b))) else {
                weights = best.as_slice().to_vec();
                break;
            };
            let part = share(leaving);
            weights.iter_mut().zip(best.iter()).for_each(|(w, best)| *w += part * (best - *w));
            chosen.remove(leaving);
            weights.remove(leaving);
        }
        rest = goal.clone();
        chosen.iter().zip(&weights).for_each(|(k, weight)| rest -= &units[*k] * *weight);
    }
    rest.norm()
}

/// The same sequence of problems by clarabel, and the conditions of Karush, Kuhn and Tucker for every one of them: where the
/// levels above leave a narrow wedge, the slack that clarabel needs lets it go along that, up to ten million times farther
/// than the slack. The multipliers prove which answer is the right one.
#[test]
fn priorities_are_those_of_a_sequence_of_problems() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let (mut worst_scale, mut worst_qd, mut worst_excess) = (0.0_f64, 0.0_f64, 0.0_f64);
    let (mut levels, mut reduced, mut none, mut failed, mut compared) = (0, 0, 0, 0, 0);
    let (mut sensitive, mut worst_missed) = (0, 0.0_f64);
    for run in 0..amount(200, 5000) {
        let problem = problem(&mut rng, run);
        let n = problem.q.len();
        let mut scheme = PrioritizedNullspace::new(&problem.arm, &problem.tasks, None, 1.0).unwrap();
        let input = StepInput {
            q: &problem.q,
            velocity: &[],
            dt: Some(problem.dt),
            qd: Some(&problem.before),
            wish: Some(&problem.wish),
        };
        let velocities: Vec<&[f64]> = problem.velocities.iter().map(Vec::as_slice).collect();
        let mut qd = vec![0.0; n];
        scheme.step(&input, &velocities, &mut qd).unwrap();
        let (scales, residuals) = (scheme.scales().to_vec(), scheme.residuals().to_vec());
        assert_eq!(allocations::count(|| scheme.step(&input, &velocities, &mut qd).unwrap()), 0);
        for (i, joint) in problem.arm.joints().iter().enumerate() {
            let (low, high) = stated_bounds(&joint.limits, problem.q[i], Some(problem.before[i]), problem.dt);
            assert!(qd[i] >= low - 1e-12 && qd[i] <= high + 1e-12, "{run} joint {i}");
        }
        let moving = DVector::from_column_slice(&qd);
        let mut done: Vec<(DMatrix<f64>, Vec<f64>, bool)> = Vec::new();
        let mut whole = true;
        for (level, v) in problem.velocities.iter().enumerate() {
            let (j, bound) = problem.rows(level);
            levels += 1;
            reduced += usize::from(scales[level] < 1.0);
            if v.is_empty() {
                let value = (&j * &moving)[0];
                let best = problem.solve(&done, false, Some((&j, &[1.0], -50.0, bound, -1.0)));
                // At most the bound is asked for; what there is beyond it does not count.
                if let Some(best) = best {
                    let most = best.last().copied().unwrap();
                    let error = (most - value.min(bound)).abs();
                    sensitive += usize::from(error > 1e-6);
                    worst_scale = if error < 1e-6 { worst_scale.max(error) } else { worst_scale };
                    if value < bound - 1e-9 {
                        let missed =
                            missed_conditions(&normals_at(&problem, &done, &qd, 0), &-j.row(0).transpose());
                        worst_missed = worst_missed.max(missed);
                    }
                } else if (problem.solve(&done, false, None)).is_some() {
                    // The bound is lower than all that is possible, or clarabel did not arrive.
                    failed += usize::from(value < bound);
                }
                done.push((j, vec![value.min(bound) - SLACK], true));
                continue;
            }
            match problem.solve(&done, false, Some((&j, v, 0.0, 1.0, -1.0))) {
                Some(best) => {
                    let error = (best.last().copied().unwrap() - scales[level]).abs();
                    sensitive += usize::from(error > 1e-6);
                    worst_scale = if error < 1e-6 { worst_scale.max(error) } else { worst_scale };
                    if scales[level] < 1.0 {
                        let mut normals = normals_at(&problem, &done, &qd, 1);
                        for (i, v) in v.iter().enumerate() {
                            let row = j.row(i).transpose().resize_vertically(n + 1, -v);
                            normals.extend([-&row, row]);
                        }
                        let slope = DVector::from_fn(n + 1, |k, _| if k == n { -1.0 } else { 0.0 });
                        let missed = missed_conditions(&normals, &slope);
                        assert!(missed < 1e-8, "{run} level {level}: {error} {missed}");
                        worst_missed = worst_missed.max(missed);
                    }
                    assert!(residuals[level] < 1e-9, "{run} {}", residuals[level]);
                    done.push((j, v.iter().map(|v| (1.0 - SLACK) * scales[level] * v).collect(), false));
                }
                None => {
                    // No scale at all: limits and the levels above allow only an error, with a scale of 0; or limits that
                    // hold the levels above left too few directions, and the task is met by least squares, which its
                    // residual tells. Otherwise clarabel did not arrive: the step meets all that is above and this task.
                    if scales[level] == 0.0 || residuals[level] > 1e-9 {
                        none += 1;
                    } else {
                        failed += 1;
                    }
                    whole = false;
                    break;
                }
            }
        }
        if !whole {
            continue;
        }
        if let Some(best) = problem.solve(&done, true, None) {
            compared += 1;
            let far =
                |x: &[f64]| x.iter().zip(&problem.wish).map(|(x, w)| (x - w).powi(2)).sum::<f64>().sqrt();
            let excess = far(&qd) - far(&best[..n]);
            let apart = qd.iter().zip(&best).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            let slope = DVector::from_fn(n, |i, _| qd[i] - problem.wish[i]);
            worst_missed = worst_missed.max(missed_conditions(&normals_at(&problem, &done, &qd, 0), &slope));
            if excess < 1e-6 && apart < 1e-5 {
                (worst_excess, worst_qd) = (worst_excess.max(excess), worst_qd.max(apart));
            } else {
                sensitive += 1;
            }
        }
    }
    println!(
        "{levels} levels, {reduced} reduced, {none} without a scale, {failed} not solved by clarabel, {compared} compared: \
         scale {worst_scale:.1e}, distance {worst_excess:.1e}, qd {worst_qd:.1e}; {sensitive} by multipliers alone; \
         conditions {worst_missed:.1e}"
    );
    assert!(failed < levels / 50, "{failed} of {levels}");
    assert!(reduced > levels / 10 && compared > levels / 8, "{levels} {reduced} {none} {compared}");
    assert!(worst_scale < 1e-6 && worst_excess < 1e-6, "{worst_scale} {worst_excess}");
    assert!(sensitive < levels / 50 && worst_missed < 1e-8, "{sensitive} of {levels}: {worst_missed}");
}

#[test]
fn below_a_full_pose_the_elbow_moves_as_nearly_as_it_can() {
    let arm = catalog::load("iiwa14").unwrap();
    let elbow = arm.link_index("link_4").unwrap();
    let tasks = [
        PriorityTask::Motion { task: Task::POSE, link: None },
        PriorityTask::Motion { task: Task::POSITION, link: Some(elbow) },
    ];
    let mut scheme = PrioritizedNullspace::new(&arm, &tasks, None, 1.0).unwrap();
    let q = [0.3, 0.6, -0.2, -1.2, 0.1, 0.9, 0.4];
    let input = StepInput { q: &q, velocity: &[], dt: Some(0.01), qd: None, wish: None };
    let (hand, wanted) = ([0.05, 0.0, -0.02, 0.0, 0.1, 0.0], [0.02, 0.1, 0.0]);
    let mut qd = [0.0; 7];
    let report = scheme.step(&input, &[&hand, &wanted], &mut qd).unwrap();
    assert_eq!((report.status, scheme.scales()), (Status::Singular, &[1.0, 1.0][..]));
    let j = arm.jacobian_of(&q, &JacobianOf::default()).unwrap();
    let of = JacobianOf { link: Some(elbow), ..JacobianOf::default() };
    let e = arm.jacobian_of(&q, &of).unwrap().rows(0, 3).into_owned();
    assert!((&j * DVector::from_column_slice(&qd) - DVector::from_column_slice(&hand)).amax() < 1e-12);
    // Least squares over the one freedom that is left.
    let pseudo = DMatrix::from_column_slice(6, 7, j.as_slice()).pseudo_inverse(1e-12).unwrap();
    let least = &pseudo * DVector::from_column_slice(&hand);
    let projector = DMatrix::identity(7, 7) - &pseudo * DMatrix::from_column_slice(6, 7, j.as_slice());
    let free = projector.column(projector.diagonal().imax()).normalize();
    let moved = &e * &free;
    let missing = DVector::from_column_slice(&wanted) - &e * &least;
    let expected = &least + &free * (moved.dot(&missing) / moved.norm_squared());
    assert!((DVector::from_column_slice(&qd) - expected).amax() < 1e-10);
    let missing = (&e * DVector::from_column_slice(&qd) - DVector::from_column_slice(&wanted)).norm();
    assert!((scheme.residuals()[1] - missing).abs() < 1e-12 && missing > 1e-3);
}

/// A cone and a half-space at the top are kept over a run that pushes against them.
#[test]
fn inequalities_at_the_top_are_never_crossed() {
    let arm = catalog::load("iiwa14").unwrap();
    let mut q = vec![0.3, 0.6, -0.2, -1.2, 0.1, 0.9, 0.4];
    let tool = arm.forward(&q).unwrap();
    let wall = tool.translation.vector + Vector3::new(0.1, 0.0, 0.0);
    let up = tool.rotation * Vector3::z();
    let tasks = [
        PriorityTask::half_space(None, wall.into(), [-1.0, 0.0, 0.0]).unwrap(),
        PriorityTask::cone(None, [0.0, 0.0, 1.0], up.into(), 0.2).unwrap(),
        PriorityTask::Motion { task: Task::POSE, link: None },
    ];
    let mut scheme = PrioritizedNullspace::new(&arm, &tasks, None, 1.0).unwrap();
    let (mut qd, mut before) = (vec![0.0; 7], vec![0.0; 7]);
    let (mut nearest, mut widest) = (f64::INFINITY, 0.0_f64);
    for _ in 0..300 {
        let input = StepInput { q: &q, velocity: &[], dt: Some(0.01), qd: Some(&before), wish: None };
        scheme.step(&input, &[&[], &[], &[0.1, 0.0, 0.05, 0.2, 0.1, 0.0]], &mut qd).unwrap();
        assert_eq!(&scheme.scales()[..2], &[1.0, 1.0]);
        q.iter_mut().zip(&qd).for_each(|(q, qd)| *q += 0.01 * qd);
        before.copy_from_slice(&qd);
        let pose = arm.forward(&q).unwrap();
        nearest = nearest.min(wall.x - pose.translation.vector.x);
        widest = widest.max((pose.rotation * Vector3::z()).angle(&up));
    }
    assert!(nearest > -1e-4 && nearest < 0.01, "{nearest}");
    assert!(widest < 0.2 + 1e-3 && widest > 0.15, "{widest}");
}

#[test]
fn what_is_wrong_with_priorities_is_named() {
    let arm = catalog::load("iiwa14").unwrap();
    let message =
        |tasks: &[PriorityTask]| PrioritizedNullspace::new(&arm, tasks, None, 1.0).unwrap_err().to_string();
    assert!(message(&[]).contains("at least one"));
    let far = PriorityTask::Motion { task: Task::POSE, link: Some(99) };
    assert!(message(&[far]).contains("link index"));
    assert!(PriorityTask::half_space(None, [0.0; 3], [0.0; 3]).is_err());
    assert!(PriorityTask::cone(None, [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], 0.0).is_err());
    let one = PriorityTask::Motion { task: Task::POSITION, link: None };
    let mut scheme = PrioritizedNullspace::new(&arm, &[one], None, 1.0).unwrap();
    let q = [0.1; 7];
    let input = StepInput { q: &q, velocity: &[], dt: Some(0.01), qd: None, wish: None };
    let mut qd = [0.0; 7];
    assert!(scheme.step(&input, &[], &mut qd).unwrap_err().to_string().contains("task velocities"));
    assert!(scheme.step(&input, &[&[0.0; 2]], &mut qd).is_err());
    let late = StepInput { dt: None, ..input };
    assert!(scheme.step(&late, &[&[0.0; 3]], &mut qd).unwrap_err().to_string().contains("dt"));
}
