//! The obstacles along a path, and whether the arm is clear of them between its points.

use super::clearance::{ArmClearance, OverPose};
use super::settings::SwivelPlanSettings;
use crate::error::Result;
use crate::kinematics::Scratch;
use crate::parallel::prelude::*;
use crate::path::Path;
use crate::scene::Scene;
use crate::solutions::SrsArm;

/// Distance (m) from obstacles beyond which distances need not be told apart, at least.
const CLEARANCE_BEYOND: f64 = 0.05;
/// Halvings of a step between points until it is known whether it touches an obstacle; what is still open then touches.
const EDGE_HALVINGS: usize = 12;

/// The obstacles along the path.
pub(super) struct SceneAlongPath {
    pub arm: ArmClearance,
    /// The scene at time 0, and the times of the points where something moves.
    base: Scene,
    times: Option<Vec<f64>>,
    /// The scene at each point; one for all where nothing moves.
    scenes: Vec<Scene>,
    over: Vec<Option<OverPose>>,
    /// Speed of the fastest obstacle times the time between points, m.
    moved: Vec<f64>,
    /// How far the arm reaches beyond each joint: what a point of it moves per rad, m.
    reach: [f64; 7],
}

impl SceneAlongPath {
    pub fn new(arm: &SrsArm, path: &Path, scene: &Scene, settings: &SwivelPlanSettings) -> Result<Self> {
        let near = ArmClearance::new(arm, settings.link_radius)?;
        let times = path.t().filter(|_| scene.moves()).map(<[f64]>::to_vec);
        let scenes: Vec<Scene> = match &times {
            Some(t) => t.iter().map(|t| scene.at(*t)).collect(),
            None => vec![scene.clone()],
        };
        let fastest = scene.obstacles().iter().map(|o| o.velocity.norm()).fold(0.0, f64::max);
        let moved = match &times {
            Some(t) => t.windows(2).map(|w| fastest * (w[1] - w[0])).collect(),
            None => vec![0.0; path.len().saturating_sub(1)],
        };
        let beyond = settings.wanted_clearance.max(CLEARANCE_BEYOND);
        let over = path
            .poses()
            .par_iter()
            .enumerate()
            .map(|(k, pose)| near.over(pose, &scenes[k.min(scenes.len() - 1)], beyond))
            .collect();
        let reach = reach(arm);
        Ok(Self { arm: near, base: scene.clone(), times, scenes, over, moved, reach })
    }

    pub fn scene(&self, k: usize) -> &Scene {
        &self.scenes[k.min(self.scenes.len() - 1)]
    }

    /// How far any point of the arm moves at most against any obstacle between point `k` and the next.
    fn travel(&self, k: usize, [a, b]: [&[f64; 7]; 2]) -> f64 {
        let turned: f64 = (0..7).map(|i| self.reach[i] * (b[i] - a[i]).abs()).sum();
        turned + self.moved[k]
    }

    /// The same at some of the points.
    pub fn at_points(&self, kept: &[usize]) -> Self {
        let moved = |w: &[usize]| (w[0]..w[1]).map(|k| self.moved[k]).sum();
        Self {
            arm: self.arm.clone(),
            base: self.base.clone(),
            times: self.times.as_ref().map(|t| kept.iter().map(|k| t[*k]).collect()),
            scenes: if self.scenes.len() > 1 {
                kept.iter().map(|k| self.scenes[*k].clone()).collect()
            } else {
                self.scenes.clone()
            },
            over: kept.iter().map(|k| self.over[*k].clone()).collect(),
            moved: kept.windows(2).map(moved).collect(),
            reach: self.reach,
        }
    }

    /// What is prepared for point `k`.
    pub fn over(&self, k: usize) -> Option<&OverPose> {
        self.over[k].as_ref()
    }

    /// Whether the arm is clear of the obstacles all the way between point `k` and the next, when its joints go straight
    /// from `a` to `b`: as far as it moves at most, the distance cannot fall. `near`: the distances at both.
    pub fn edge_is_clear(
        &self,
        k: usize,
        [a, b]: [&[f64; 7]; 2],
        near: [f64; 2],
        scratch: &mut Scratch,
    ) -> bool {
        let travel = self.travel(k, [a, b]);
        let mut open = vec![([0.0, 1.0], near, 0)];
        while let Some(([from, to], [d0, d1], depth)) = open.pop() {
            if d0 <= 0.0 || d1 <= 0.0 {
                return false;
            }
            if d0 + d1 > travel * (to - from) {
                continue;
            }
            if depth == EDGE_HALVINGS {
                return false;
            }
            let middle = 0.5 * (from + to);
            let q: [f64; 7] = std::array::from_fn(|i| a[i] + middle * (b[i] - a[i]));
            let distance = match &self.times {
                Some(t) => self.arm.at_q(&q, &self.base.at(t[k] + middle * (t[k + 1] - t[k])), scratch),
                None => self.arm.at_q(&q, &self.base, scratch),
            };
            open.push(([from, middle], [d0, distance], depth + 1));
            open.push(([middle, to], [distance, d1], depth + 1));
        }
        true
    }
}

/// How far the arm reaches beyond each joint at most, m.
fn reach(arm: &SrsArm) -> [f64; 7] {
    let mut scratch = Scratch::new(arm.chain());
    let kinematics = arm.chain().kinematics_unchecked(&[0.0; 7], &mut scratch);
    let origins = kinematics.origins();
    let mut reach = [0.0; 7];
    let mut beyond = 0.0;
    for i in (0..7).rev() {
        // The origins of neighbouring joints keep their distance.
        let next = origins.get(i + 1).unwrap_or(&kinematics.pose().translation.vector);
        beyond += (next - origins[i]).norm();
        reach[i] = beyond;
    }
    reach
}
