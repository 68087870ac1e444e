//! A list of obstacles, and what may touch them.

use std::sync::Arc;

use nalgebra::Vector3;

use super::obstacle::{Obstacle, Shape};
use super::solid::Solid;
use crate::error::{Error, Result};

/// Most obstacles of a scene: distances are computed one by one.
const MAX_OBSTACLES: usize = 100_000;

/// Obstacles in the world, and pairs that may touch. Immutable and cheap to clone.
///
/// ```
/// use redundancy_core::{chain::catalog, nalgebra::Vector3, scene::{Scene, Sphere}};
/// let ball = Sphere { center: Vector3::new(0.0, 0.3, 0.765), radius: 0.1 };
/// let scene = Scene::new(&[ball.into()])?;
/// let arm = catalog::load("pa10")?; // stretched upwards through (0, 0, .765)
/// let near = scene.clearance(&arm, &[0.0; 7], 0.05)?.ok_or(redundancy_core::Error::Invalid("empty".into()))?;
/// assert!((near.distance - 0.15).abs() < 1e-12);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    inner: Arc<Inner>,
}

#[derive(Debug, Clone, PartialEq)]
struct Inner {
    obstacles: Vec<Obstacle>,
    /// What distances are computed with, of each.
    solids: Vec<Vec<Solid>>,
    allowed: Vec<[String; 2]>,
}

impl Scene {
    /// Standing obstacles.
    ///
    /// # Errors
    /// An obstacle whose numbers are wrong; the message says which one.
    pub fn new(shapes: &[Shape]) -> Result<Self> {
        let obstacles = shapes.iter().enumerate().map(|(i, shape)| {
            Obstacle::fixed(shape.clone()).map_err(|error| named(i, shape.as_str(), &error))
        });
        Self::of_obstacles(obstacles.collect::<Result<_>>()?)
    }

    /// Obstacles that stand, move, or are carried by a link.
    ///
    /// # Errors
    /// As [`Scene::new`].
    pub fn of_obstacles(obstacles: Vec<Obstacle>) -> Result<Self> {
        if obstacles.len() > MAX_OBSTACLES {
            return Err(Error::OutOfRange {
                what: "number of obstacles".into(),
                value: obstacles.len() as f64,
                bound: format!("<= {MAX_OBSTACLES}"),
            });
        }
        for (i, obstacle) in obstacles.iter().enumerate() {
            obstacle.validate().map_err(|error| named(i, obstacle.shape.as_str(), &error))?;
        }
        let solids = obstacles.iter().map(|o| o.shape.solids()).collect();
        Ok(Self { inner: Arc::new(Inner { obstacles, solids, allowed: Vec::new() }) })
    }

    /// With pairs of names that may touch: links, or obstacles that links carry, with obstacles.
    ///
    /// # Errors
    /// A name that is empty, or a pair in which no name is that of an obstacle.
    pub fn with_allowed(&self, allowed: Vec<[String; 2]>) -> Result<Self> {
        for pair in &allowed {
            let known = |name: &String| self.obstacles().iter().any(|o| o.name.as_ref() == Some(name));
            if pair.iter().any(String::is_empty) {
                return Err(Error::Invalid("allowed: a name is empty".into()));
            }
            if !pair.iter().any(known) {
                let names: Vec<String> = self.obstacles().iter().filter_map(|o| o.name.clone()).collect();
                let names = if names.is_empty() { "none has a name".into() } else { names.join(", ") };
                let [a, b] = pair;
                let message = format!("allowed: neither '{a}' nor '{b}' is an obstacle ({names})");
                return Err(Error::Invalid(message));
            }
        }
        let mut inner = (*self.inner).clone();
        inner.allowed = allowed;
        Ok(Self { inner: Arc::new(inner) })
    }

    /// The obstacles.
    pub fn obstacles(&self) -> &[Obstacle] {
        &self.inner.obstacles
    }

    /// Pairs of names that may touch.
    pub fn allowed(&self) -> &[[String; 2]] {
        &self.inner.allowed
    }

    /// The solids of each obstacle.
    pub(crate) fn solids(&self) -> &[Vec<Solid>] {
        &self.inner.solids
    }

    /// True where some obstacle moves by itself.
    pub fn moves(&self) -> bool {
        self.obstacles().iter().any(|o| o.velocity != Vector3::zeros())
    }

    /// The scene at time `t`, s; its obstacles keep their velocities.
    #[must_use]
    pub fn at(&self, t: f64) -> Self {
        let obstacles: Vec<Obstacle> = self.obstacles().iter().map(|o| o.at(t)).collect();
        let solids = obstacles.iter().map(|o| o.shape.solids()).collect();
        Self { inner: Arc::new(Inner { obstacles, solids, allowed: self.inner.allowed.clone() }) }
    }
}

/// The error with the number of the obstacle in front.
pub(super) fn named(index: usize, word: &str, error: &Error) -> Error {
    Error::Invalid(format!("obstacle {index} ({word}): {error}"))
}
