//! A solver that never misses: closed form where the arm has one, else ranked starts and Levenberg-Marquardt.

use std::sync::Arc;
use std::time::{Duration, Instant};

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::goal::{Goal, OrientationSet};
use super::newton::{End, Problem, Run, Workspace};
use super::spherical_wrist::SphericalWristArm;
use super::starts::{Starts, ranges};
use crate::chain::Chain;
use crate::criterion::{Criterion, check_dof};
use crate::error::{Error, Result};
use crate::kinematics::{Task, TaskKind};
use crate::pose::{Pose, check_pose};
use crate::self_motion::SrsArm;
use crate::status::Status;

/// How a pose is turned into a configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum IkMethod {
    /// The closed form where the arm has one, else ranked starts, then Levenberg-Marquardt.
    Hybrid,
    /// Levenberg-Marquardt from the given or from random starts.
    Newton,
}

/// Settings of [`IkSolver`].
#[derive(Debug, Clone)]
pub struct IkSettings {
    /// How.
    pub method: IkMethod,
    /// Which coordinates count.
    pub task: Task,
    /// Largest distance from the target that counts as reached, m.
    pub tol_position: f64,
    /// Largest angle from the target that counts as reached, rad.
    pub tol_orientation: f64,
    /// Most iterations of one run from one start.
    pub max_iterations: usize,
    /// Most starts beyond the first.
    pub restarts: usize,
    /// Seconds after which the best configuration so far is returned.
    pub time_limit: Option<f64>,
    /// Whether the closed form of the arm is used where it has one.
    pub closed_form: bool,
    /// Stored configurations.
    pub starts: usize,
}

impl Default for IkSettings {
    fn default() -> Self {
        Self {
            method: IkMethod::Hybrid,
            task: Task::POSE,
            tol_position: 1e-6,
            tol_orientation: 1e-6,
            max_iterations: 100,
            restarts: 100,
            time_limit: None,
            closed_form: true,
            starts: 2048,
        }
    }
}

/// The answer over one pose.
#[derive(Debug, Clone, PartialEq)]
pub struct IkResult {
    /// The configuration, within the joint limits; the best one found where the status is not `Converged`.
    pub q: Vec<f64>,
    /// What came out.
    pub status: Status,
    /// Iterations over all starts; 0 for the closed form.
    pub iterations: usize,
    /// Distance from the target, m, of what counts of it; measured by forward kinematics on `q`.
    pub position_error: f64,
    /// Angle from the target, rad, of what counts of it; measured by forward kinematics on `q`.
    pub orientation_error: f64,
}

/// From poses to configurations of one chain.
#[derive(Debug, Clone)]
pub struct IkSolver {
    chain: Chain,
    settings: IkSettings,
    starts: Arc<Starts>,
    scale: f64,
}

/// What one call needs, allocated once and reused: nothing is allocated while solving.
#[derive(Debug, Clone)]
pub struct IkMemory {
    workspace: Workspace,
    scores: Vec<f32>,
    q: Vec<f64>,
    best: Vec<f64>,
}

impl IkSolver {
    /// A solver for `chain`.
    pub fn new(chain: &Chain, settings: IkSettings) -> Result<Self> {
        let scale = 1.0 / std::env::var("IK_L").ok().and_then(|x| x.parse::<f64>().ok()).unwrap_or(0.3);
        let whole = matches!(settings.task.kind(), TaskKind::Pose | TaskKind::PoseRpy);
        let starts = Starts::new(chain, &settings.task, whole, settings.starts, scale);
        Ok(Self { chain: chain.clone(), settings, starts: Arc::new(starts), scale })
    }

    /// Memory for this solver.
    pub fn memory(&self) -> IkMemory {
        IkMemory {
            workspace: Workspace::new(&self.chain),
            scores: vec![0.0; self.starts.len()],
            q: vec![0.0; self.chain.dof()],
            best: vec![0.0; self.chain.dof()],
        }
    }

    /// numeric
    pub fn solve_numeric(&self, pose: &Pose, q0: Option<&[f64]>, memory: &mut IkMemory, out: &mut [f64]) -> (bool, usize, usize) {
        let goal = Goal { target: *pose, task: self.settings.task, set: None, scale: self.scale };
        let problem = Problem {
            chain: &self.chain,
            lower: self.chain.lower(),
            upper: self.chain.upper(),
            tol_position: self.settings.tol_position,
            tol_orientation: self.settings.tol_orientation,
        };
        let mut iterations = 0;
        if let Some(q0) = q0 {
            out.copy_from_slice(q0);
            let run = problem.run(&goal, out, &mut memory.workspace, self.settings.max_iterations, false);
            iterations += run.iterations;
            if run.end == End::Converged { return (true, iterations, 0); }
        }
        let azimuth = self.starts.score(pose, false, &mut memory.scores);
        let mut tried = 0;
        for _ in 0..self.settings.restarts {
            let i = self.starts.take_best(&mut memory.scores);
            if !self.starts.write(&self.chain, i, pose, azimuth, out) { continue; }
            tried += 1;
            let run = problem.run(&goal, out, &mut memory.workspace, self.settings.max_iterations, false);
            iterations += run.iterations + 1;
            if run.end == End::Converged {
                return (true, iterations, tried);
            }
        }
        (false, iterations, tried)
    }
}
