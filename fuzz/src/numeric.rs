//! Numeric entry points: a pose in, finite and legal configurations out, whatever the pose.

use std::sync::OnceLock;

use redundancy_core::chain::{Chain, catalog};
use redundancy_core::criterion::JointRange;
use redundancy_core::ik::{IkSettings, IkSolver};
use redundancy_core::kinematics::Task;
use redundancy_core::nalgebra::{Rotation3, Translation3, Vector3};
use redundancy_core::solutions::{ClosedForm, Solutions, closed_form};
use redundancy_core::tolerance::{LARGEST_POSITION, LARGEST_RATE};
use redundancy_core::velocity::{Gain, Resolver, SaturatedNullspace, StepInput};
use redundancy_core::{Pose, Status};

use crate::Numbers;

/// An answer may miss its pose by this, m and rad, beside twice the defect of the arm.
const MISS: f64 = 1e-9;
/// Positions within this of a limit count as within it, rad.
const AT_LIMIT: f64 = 1e-9;
/// Poses whose coordinates are larger say nothing about misses.
const SENSIBLE: f64 = 1e3;

/// A pose: that of a configuration on a coarse grid (where singularities are), that of any configuration, or any pose.
pub fn pose(chain: &Chain, numbers: &mut Numbers) -> (Pose, Option<Vec<f64>>) {
    let kind = numbers.byte() % 4;
    let turn = std::f64::consts::PI;
    let configuration = |numbers: &mut Numbers, grid: bool| -> Vec<f64> {
        let limits = chain.lower().iter().zip(chain.upper());
        limits
            .map(|(lo, hi)| {
                let u = numbers.unit() * turn;
                let q = if grid { (u * 8.0 / turn).round() * turn / 8.0 } else { u };
                q.clamp(*lo, *hi)
            })
            .collect()
    };
    if kind < 2 {
        let q = configuration(numbers, kind == 0);
        return (chain.forward(&q).expect("angles are finite"), Some(q));
    }
    let coordinate = |n: &mut Numbers| if kind == 2 { 2.0 * n.unit() } else { n.raw() };
    let p = Vector3::from_fn(|_, _| coordinate(numbers));
    let axis = Vector3::from_fn(|_, _| numbers.unit());
    let rotation = Rotation3::from_scaled_axis(axis * turn);
    (Pose::from_parts(Translation3::from(p), rotation), None)
}

/// Whether a pose must be taken; its rotation is one.
fn usable(pose: &Pose) -> bool {
    pose.translation.vector.iter().all(|x| x.abs() <= LARGEST_POSITION)
}

/// How far the tool is from the pose, m and rad.
fn miss(chain: &Chain, q: &[f64], pose: &Pose) -> f64 {
    let reached = chain.forward(q).expect("an answer is finite");
    let p = (reached.translation.vector - pose.translation.vector).amax();
    p.max((reached.rotation.matrix() - pose.rotation.matrix()).amax())
}

fn within(chain: &Chain, q: &[f64]) -> bool {
    let limits = chain.lower().iter().zip(chain.upper());
    q.iter().zip(limits).all(|(x, (lo, hi))| (*lo - AT_LIMIT..=*hi + AT_LIMIT).contains(x))
}

/// Everything a set of configurations says about a pose holds.
pub fn over_pose(form: &dyn ClosedForm, pose: &Pose, what: &str) {
    let Ok(set) = form.solutions(pose) else { return };
    let chain = form.chain();
    let allowed = MISS + 2.0 * form.defect().largest();
    let mut q = vec![0.0; chain.dof()];
    let mut any = false;
    for piece in 0..set.pieces() {
        let [lo, hi] = set.range(piece).expect("a piece has a range");
        assert!(lo.is_finite() && hi.is_finite() && lo <= hi, "{what}: range {lo} {hi}");
        let arcs = set.intervals(piece, 0.0).expect("a piece has intervals");
        any |= !arcs.is_empty();
        for u in [lo, 0.5 * (lo + hi), hi, 0.3 * lo + 0.7 * hi] {
            set.q(piece, u, &mut q).expect("a parameter within the range");
            let error = miss(chain, &q, pose);
            assert!(error <= allowed, "{what}: piece {piece} at {u} misses the pose by {error:e}");
        }
        for [from, to] in arcs {
            assert!(from <= to, "{what}: arc {from} {to}");
            let middle = 0.5 * (from + to);
            let u = if middle > hi { middle - 2.0 * std::f64::consts::PI } else { middle };
            set.q(piece, u, &mut q).expect("a parameter within the range");
            assert!(
                within(chain, &q),
                "{what}: piece {piece} is outside of its limits within its arc, {q:?}"
            );
        }
    }
    let status = set.status();
    assert!(matches!(status, Status::Converged | Status::Limits | Status::Unreachable), "{what}: {status:?}");
    if set.proven() {
        assert_eq!(any, status == Status::Converged, "{what}: {status:?} with arcs: {any}");
    }
    choices(set.as_ref(), pose, allowed, what);
}

fn choices(set: &dyn Solutions, pose: &Pose, allowed: f64, what: &str) {
    let chain = set.chain();
    let near = set.nearest(&vec![0.2; chain.dof()]).expect("a finite configuration");
    assert!(near.is_none() || set.status() == Status::Converged, "{what}: nearest with {:?}", set.status());
    let best = set.best(&JointRange::new(chain)).expect("joint range suits any chain");
    for found in [near, best].into_iter().flatten() {
        assert!(found.value.is_finite() && within(chain, &found.q), "{what}: {found:?}");
        let error = miss(chain, &found.q, pose);
        assert!(error <= allowed, "{what}: a choice misses the pose by {error:e}");
    }
}

/// The property of a closed form at one pose of one of its arms: what made the pose is found again.
fn arm(names: &[&'static str], data: &[u8]) {
    static ARMS: OnceLock<Vec<(&'static str, Chain)>> = OnceLock::new();
    let all = ARMS.get_or_init(|| {
        catalog::names().map(|name| (name, catalog::load(name).expect("an arm of the catalogue"))).collect()
    });
    let mut numbers = Numbers::new(data);
    let name = names[usize::from(numbers.byte()) % names.len()];
    let chain = &all.iter().find(|(n, _)| *n == name).expect("an arm of the catalogue").1;
    let form = closed_form(chain).expect("an arm with a closed form");
    let (pose, q) = pose(chain, &mut numbers);
    if !usable(&pose) {
        assert!(form.solutions(&pose).is_err(), "{name}: {pose:?} is accepted");
        return;
    }
    if pose.translation.vector.amax() > SENSIBLE {
        let set = form.solutions(&pose).expect("a finite pose");
        assert!(set.pieces() == 0 && set.status() == Status::Unreachable, "{name}: reaches {pose:?}");
        return;
    }
    over_pose(form.as_ref(), &pose, name);
    let Some(q) = q else { return };
    let set = form.solutions(&pose).expect("a finite pose");
    assert!(set.pieces() > 0, "{name}: the pose of {q:?} is said to be out of reach");
    if set.proven() {
        assert_eq!(set.status(), Status::Converged, "{name}: the pose of {q:?}");
    }
}

/// Arms with spherical shoulder and wrist.
pub fn srs(data: &[u8]) {
    arm(&["iiwa14", "pa10"], data);
}

/// Panda, FR3, xArm7.
pub fn panda_class(data: &[u8]) {
    arm(&["panda", "fr3", "xarm7"], data);
}

/// UR arms.
pub fn parallel_axes(data: &[u8]) {
    arm(&["ur3e", "ur5e", "ur10e", "ur20", "ur30"], data);
}

/// Six joints with a spherical wrist.
pub fn spherical_wrist(data: &[u8]) {
    arm(&["puma560", "irb2400", "kr6_r900"], data);
}

/// The numeric solver: what it calls converged is at the pose and within limits, what made a pose is not refused with proof.
pub fn ik(data: &[u8]) {
    static SOLVERS: OnceLock<Vec<IkSolver>> = OnceLock::new();
    let solvers = SOLVERS.get_or_init(|| {
        let names = ["panda", "iiwa14", "ur5e", "puma560", "dexter", "sawyer"];
        let settings =
            || IkSettings { closed_form: false, restarts: 5, max_iterations: 500, ..IkSettings::default() };
        names
            .map(|name| {
                IkSolver::new(&catalog::load(name).expect("an arm"), settings()).expect("valid settings")
            })
            .into()
    });
    let mut numbers = Numbers::new(data);
    let solver = &solvers[usize::from(numbers.byte()) % solvers.len()];
    let chain = solver.chain();
    let (pose, q) = pose(chain, &mut numbers);
    let Ok(result) = solver.solve(&pose, None, 0) else {
        assert!(!usable(&pose), "{pose:?} is refused");
        return;
    };
    assert!(result.q.iter().all(|x| x.is_finite()) && within(chain, &result.q), "{:?}", result);
    if result.status == Status::Converged {
        // The tolerance is 1e-6 in the norm of each part.
        assert!(miss(chain, &result.q, &pose) <= 2e-6, "{:?}", result);
    } else if q.is_some() {
        assert!(!result.proven, "a pose that {q:?} reaches is refused with proof: {:?}", result);
    }
}

/// Joint velocities within hard limits: finite, within limits of position and velocity, whatever the task velocity.
pub fn velocity(data: &[u8]) {
    static SCHEMES: OnceLock<Vec<(Chain, SaturatedNullspace)>> = OnceLock::new();
    let schemes = SCHEMES.get_or_init(|| {
        let scheme =
            |chain: &Chain| SaturatedNullspace::new(chain, None, Gain::Constant(1.0), Task::POSE, None);
        ["panda", "iiwa14", "ur5e"]
            .map(|name| {
                let chain = catalog::load(name).expect("an arm");
                let scheme = scheme(&chain).expect("a scheme");
                (chain, scheme)
            })
            .into()
    });
    let mut numbers = Numbers::new(data);
    let (chain, scheme) = &schemes[usize::from(numbers.byte()) % schemes.len()];
    let wild = numbers.byte() % 8 == 0;
    let q: Vec<f64> = (chain.lower().iter().zip(chain.upper()))
        .map(|(lo, hi)| {
            let u = 0.5 + 0.5 * numbers.unit();
            lo + (hi - lo) * u
        })
        .collect();
    let task: Vec<f64> = (0..6).map(|_| if wild { numbers.raw() } else { 3.0 * numbers.unit() }).collect();
    let (mut scheme, mut qd, dt, rest) = (scheme.boxed(), vec![0.0; q.len()], 0.01, vec![0.0; q.len()]);
    for before in [None, Some(rest.as_slice())] {
        let input = StepInput { q: &q, velocity: &task, dt: Some(dt), qd: before, wish: None };
        let Ok(step) = scheme.step(&input, &mut qd) else {
            // A NaN is refused too.
            assert!(!task.iter().all(|x| x.abs() <= LARGEST_RATE), "a step is refused: {input:?}");
            return;
        };
        assert!((0.0..=1.0).contains(&step.scale), "{step:?} of {input:?}");
        for (i, joint) in chain.joints().iter().enumerate() {
            let (limits, next) = (&joint.limits, q[i] + dt * qd[i]);
            assert!(
                qd[i].is_finite() && qd[i].abs() <= limits.velocity * (1.0 + 1e-9),
                "{qd:?} of {input:?}"
            );
            assert!(
                (limits.lower - AT_LIMIT..=limits.upper + AT_LIMIT).contains(&next),
                "{qd:?} of {input:?}"
            );
        }
    }
}
