//! Distances from obstacles along a path, and whether the arm is clear between the points.

use std::sync::Mutex;

use super::anchor::Anchor;
use super::clearance::{ArmClearance, Around, OverPose};
use super::near::Near;
use super::settings::SwivelPlanSettings;
use crate::error::Result;
use crate::parallel::prelude::*;
use crate::path::Path;
use crate::scene::SweepMemory;
use crate::solutions::{SelfMotion, SrsArm};

/// Distance (m) from obstacles beyond which distances need not be exact, at least.
const CLEARANCE_BEYOND: f64 = 0.05;

/// What the arm keeps a distance from along the path.
pub(super) struct SceneAlongPath {
    pub arm: ArmClearance,
    /// The times of the points; 0 where the path has none.
    pub times: Vec<f64>,
    over: Vec<Option<OverPose>>,
    /// The wanted clearance, and the distance beyond which others are not exact, m.
    reach: (f64, f64),
    /// For each point what is known there of the last branch that was evaluated on its own.
    anchors: Vec<Mutex<Option<Anchor>>>,
}

/// Nothing is known yet.
fn no_anchors(points: usize) -> Vec<Mutex<Option<Anchor>>> {
    (0..points).map(|_| Mutex::new(None)).collect()
}

impl SceneAlongPath {
    /// `None` where there is nothing to keep a distance from.
    ///
    /// # Errors
    /// Links of another arm, an obstacle attached to an unknown link.
    pub fn new(arm: &SrsArm, path: &Path, settings: &SwivelPlanSettings) -> Result<Option<Self>> {
        let around = Around {
            links: settings.links.as_ref(),
            link_radius: settings.link_radius,
            scene: settings.scene.as_ref().filter(|scene| !scene.obstacles().is_empty()),
            self_collision: settings.self_collision,
        };
        if around.scene.is_none() && !around.self_collision {
            return Ok(None);
        }
        let near = ArmClearance::new(arm, &around)?;
        if near.is_empty() {
            return Ok(None);
        }
        let times = path.t().map_or_else(|| vec![0.0; path.len()], <[f64]>::to_vec);
        let beyond = settings.wanted_clearance.max(CLEARANCE_BEYOND);
        let poses = path.poses();
        let over = (0..poses.len()).into_par_iter().map(|k| near.over(&poses[k], times[k], beyond)).collect();
        let (reach, anchors) = ((settings.wanted_clearance, beyond), no_anchors(poses.len()));
        Ok(Some(Self { arm: near, times, over, reach, anchors }))
    }

    /// The same at some of the points.
    pub fn at_points(&self, kept: &[usize]) -> Self {
        Self {
            arm: self.arm.clone(),
            times: kept.iter().map(|k| self.times[*k]).collect(),
            over: kept.iter().map(|k| self.over[*k].clone()).collect(),
            reach: self.reach,
            anchors: no_anchors(kept.len()),
        }
    }

    /// How near the arm is at point `k` at swivel `s`, of the branches in `mask`; the anchors are of the same point.
    pub fn of_branches(
        &self,
        motion: &SelfMotion,
        k: usize,
        s: f64,
        q: &[[f64; 7]; 8],
        mask: u8,
        anchors: &mut [Option<Anchor>; 8],
    ) -> [Near; 8] {
        let at = (s, q, mask);
        self.arm.of_branches(motion, self.over[k].as_ref(), at, self.times[k], self.reach, anchors)
    }

    /// How near one branch is.
    pub fn of_one(&self, motion: &SelfMotion, k: usize, at: (usize, f64, &[f64; 7])) -> Near {
        let look = |anchor: &mut Option<Anchor>| {
            self.arm.of_one(motion, self.over[k].as_ref(), at, self.times[k], self.reach, anchor)
        };
        match self.anchors[k].try_lock() {
            Ok(mut anchor) => look(&mut anchor),
            Err(_) => look(&mut None),
        }
    }

    /// Whether what the swivel moves is clear all the way between point `k` and the next, when the joints go straight from `a`
    /// to `b`. `near`: the distances at both.
    pub fn edge_is_clear(
        &self,
        k: usize,
        ends: [&[f64; 7]; 2],
        near: [f64; 2],
        memory: &mut Option<SweepMemory>,
    ) -> bool {
        self.arm.edge_is_clear(ends, [self.times[k], self.times[k + 1]], near, memory)
    }
}
