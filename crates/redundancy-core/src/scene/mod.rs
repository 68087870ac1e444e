//! What is in the way: obstacles, and how far an arm is from them.
//!
//! Links are capsules. The signed distance of a capsule from an obstacle is that of the nearest (or deepest) point of its
//! axis less its radius, see [`distance`]; it is negative in a collision, also where the axis itself is inside.

pub mod distance;
mod geometry;
#[cfg(feature = "io")]
mod json;
mod obstacle;

use std::sync::Arc;

use nalgebra::Vector3;

pub use distance::{Nearest, segment_distance};
pub use geometry::{LinkCapsule, LinkGeometry};
pub use obstacle::{Capsule, Cuboid, Obstacle, Shape, Sphere};

use crate::chain::Chain;
use crate::error::{Error, Result, check_finite};
use crate::kinematics::{Kinematics, Scratch};
use crate::parallel::prelude::*;

/// Most obstacles of a scene: distances are computed one by one.
const MAX_OBSTACLES: usize = 100_000;
/// Configurations that one task of the pool takes at least.
const ROWS_PER_TASK: usize = 32;

/// Obstacles in the world. Immutable and cheap to clone.
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

#[derive(Debug, PartialEq)]
struct Inner {
    obstacles: Vec<Obstacle>,
    /// Centre and radius of a ball around each.
    balls: Vec<(Vector3<f64>, f64)>,
}

/// The nearest pair of a link and an obstacle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearestPair {
    /// Signed distance, m: negative in a collision.
    pub distance: f64,
    /// Index of the link in [`Chain::links`].
    pub link: usize,
    /// Index of the obstacle in the scene.
    pub obstacle: usize,
    /// The nearest point of the link's surface.
    pub on_link: Vector3<f64>,
    /// The nearest point of the obstacle's surface.
    pub on_obstacle: Vector3<f64>,
    /// Unit vector from the obstacle to the link.
    pub normal: Vector3<f64>,
}

impl Scene {
    /// Standing obstacles.
    ///
    /// # Errors
    /// An obstacle whose numbers are wrong; the message says which one.
    pub fn new(shapes: &[Shape]) -> Result<Self> {
        let obstacles = shapes
            .iter()
            .enumerate()
            .map(|(i, shape)| Obstacle::fixed(*shape).map_err(|error| named(i, shape.as_str(), &error)));
        Self::of_obstacles(obstacles.collect::<Result<_>>()?)
    }

    /// Obstacles that stand or move.
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
            let fits = obstacle
                .shape
                .validate()
                .and_then(|()| check_finite("velocity", obstacle.velocity.as_slice()));
            fits.map_err(|error| named(i, obstacle.shape.as_str(), &error))?;
        }
        let balls = obstacles.iter().map(|o| o.shape.bounding_ball()).collect();
        Ok(Self { inner: Arc::new(Inner { obstacles, balls }) })
    }

    /// The obstacles.
    pub fn obstacles(&self) -> &[Obstacle] {
        &self.inner.obstacles
    }

    /// The obstacles with balls around them.
    pub(crate) fn shapes_and_balls(&self) -> impl Iterator<Item = (&Shape, &(Vector3<f64>, f64))> {
        self.inner.obstacles.iter().map(|o| &o.shape).zip(&self.inner.balls)
    }

    /// Balls around the obstacles at time 0.
    pub(crate) fn balls(&self) -> &[(Vector3<f64>, f64)] {
        &self.inner.balls
    }

    /// True where some obstacle moves.
    pub fn moves(&self) -> bool {
        self.obstacles().iter().any(|o| o.velocity != Vector3::zeros())
    }

    /// The scene at time `t`, s; its obstacles keep their velocities.
    #[must_use]
    pub fn at(&self, t: f64) -> Self {
        let obstacles: Vec<Obstacle> = self.obstacles().iter().map(|o| o.at(t)).collect();
        let balls = obstacles.iter().map(|o| o.shape.bounding_ball()).collect();
        Self { inner: Arc::new(Inner { obstacles, balls }) }
    }

    /// The nearest pair at `q` with links as capsules from joint to joint; `None` for a scene without obstacles.
    ///
    /// # Errors
    /// Wrong length of `q`, an entry that is not finite, a radius that is negative.
    pub fn clearance(&self, chain: &Chain, q: &[f64], link_radius: f64) -> Result<Option<NearestPair>> {
        let geometry = LinkGeometry::joint_to_joint(chain, link_radius)?;
        let mut scratch = Scratch::new(chain);
        Ok(self.clearance_at(&geometry, &chain.kinematics(q, &mut scratch)?))
    }

    /// The nearest pair of each of `N` configurations (`N * dof` numbers).
    ///
    /// # Errors
    /// A length of `q` that does not fit, an entry that is not finite, a radius that is negative.
    pub fn clearance_batch(
        &self,
        chain: &Chain,
        q: &[f64],
        geometry: &LinkGeometry,
    ) -> Result<Vec<Option<NearestPair>>> {
        let n = chain.dof();
        if n == 0 || !q.len().is_multiple_of(n) {
            let expected = q.len().next_multiple_of(n.max(1));
            return Err(Error::Length { what: "q".into(), expected, actual: q.len() });
        }
        check_finite("q", q)?;
        let rows = q.par_chunks_exact(n).with_min_len(ROWS_PER_TASK);
        let one = |scratch: &mut Scratch, q: &[f64]| {
            self.clearance_at(geometry, &chain.kinematics_unchecked(q, scratch))
        };
        Ok(rows.map_init(|| Scratch::new(chain), one).collect())
    }

    /// The nearest pair where the kinematics are known; allocates nothing.
    pub fn clearance_at(&self, geometry: &LinkGeometry, kinematics: &Kinematics<'_>) -> Option<NearestPair> {
        let mut best: Option<(f64, usize, usize, Nearest)> = None;
        self.each_pair(geometry, kinematics, 0.0, |capsule, obstacle, near| {
            let distance = near.distance - geometry.capsules()[capsule].radius;
            if best.as_ref().is_none_or(|b| distance < b.0) {
                best = Some((distance, capsule, obstacle, *near));
            }
        });
        let (distance, capsule, obstacle, near) = best?;
        let capsule = &geometry.capsules()[capsule];
        Some(NearestPair {
            distance,
            link: capsule.link,
            obstacle,
            on_link: near.point - near.normal * capsule.radius,
            on_obstacle: near.point - near.normal * near.distance,
            normal: near.normal,
        })
    }

    /// Calls `visit` with capsule, obstacle and distance of every pair but those that are certainly further than the
    /// nearest one so far by more than `beyond`.
    #[inline(always)]
    pub(crate) fn each_pair(
        &self,
        geometry: &LinkGeometry,
        kinematics: &Kinematics<'_>,
        beyond: f64,
        mut visit: impl FnMut(usize, usize, &Nearest),
    ) {
        let mut least = f64::INFINITY;
        for (c, capsule) in geometry.capsules().iter().enumerate() {
            let (start, end) = capsule.segment(kinematics);
            let (middle, half) = (0.5 * (start + end), 0.5 * (end - start).norm());
            for (o, (obstacle, (center, radius))) in
                self.inner.obstacles.iter().zip(&self.inner.balls).enumerate()
            {
                // |middle - center| - half - radius - capsule.radius > least + beyond
                let far = least + beyond + half + radius + capsule.radius;
                if far > 0.0 && (middle - center).norm_squared() > far * far {
                    continue;
                }
                let near = segment_distance(&start, &end, &obstacle.shape);
                least = least.min(near.distance - capsule.radius);
                visit(c, o, &near);
            }
        }
    }
}

/// The error with the number of the obstacle in front.
fn named(index: usize, word: &str, error: &Error) -> Error {
    Error::Invalid(format!("obstacle {index} ({word}): {error}"))
}
