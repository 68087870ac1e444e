//! Distance from obstacles and of links from each other, to be maximised.
//!
//! The least of the signed distances d_i of all pairs has kinks where the nearest pair changes. A
//! soft minimum has none: `h = -tau log sum_i exp(-d_i / tau)`, at most the least distance, and less by at most tau
//! times the logarithm of the number of pairs that are about as near. `grad h = sum_i w_i grad d_i` with the weights
//! `w_i = exp((h - d_i) / tau)`, which add up to one.
//!
//! `d d_i / d q_k = n . (v_first - v_second)`, the velocities of both at the nearest point per unit of joint k, with n the
//! unit vector between them: where the nearest points are on their surfaces does not count. Within one pair the distance
//! keeps the kinks that belong to the shapes: parallel segments, edges of hulls, the middle planes inside of a box, a centre.
//!
//! A scheme that keeps a task takes the criterion [for that task](Criterion::for_task): pairs that the freedom cannot
//! move are left out, so that they neither hide the others nor shift them.
//!
//! The Hessian is the central difference of this gradient, symmetrised: good to about 1e-7 away from kinks.

use std::sync::Arc;

use nalgebra::DMatrix;

use super::differences::hessian_by_differences;
use super::{Criterion, Sense};
use crate::chain::Chain;
use crate::error::{Error, Result, check_finite};
use crate::kinematics::{Kinematics, Scratch, Task};
use crate::scene::{
    Contact, LinkGeometry, Proximity, Scene, Surroundings, Thing, Visitor, split_by_freedom, with_memory,
};
use crate::tolerance::{CLEARANCE_DIFFERENCE, SOFT_MINIMUM_REST};

/// Default of the width over which the nearest pair changes, m.
pub const CLEARANCE_SMOOTHING: f64 = 0.002;

/// Distance of an arm from a scene, of its links from each other, or both. Infinite where nothing is near it, with no
/// gradient.
///
/// ```
/// use redundancy_core::{chain::catalog, criterion::{Clearance, Criterion}, nalgebra::Vector3, scene::{Scene, Sphere}};
/// let arm = catalog::load("pa10")?;
/// let scene = Scene::new(&[Sphere { center: Vector3::new(0.0, 0.3, 0.6), radius: 0.1 }.into()])?;
/// let h = Clearance::new(&arm, &scene, 0.05)?;
/// assert!((h.value(&[0.0; 7]) - 0.15).abs() < 1e-9); // the soft minimum counts farther links a little
/// let mut gradient = [0.0; 7];
/// h.gradient(&[0.0; 7], &mut gradient); // joint 2 tilts the upper arm about y: across to the ball
/// assert!(gradient[1].abs() < 1e-12);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Clearance {
    around: Surroundings,
    smoothing: f64,
}

impl Clearance {
    /// Links as capsules from joint to joint; [`CLEARANCE_SMOOTHING`].
    ///
    /// # Errors
    /// A radius that is negative or not finite; a name in the scene that is not known.
    pub fn new(chain: &Chain, scene: &Scene, link_radius: f64) -> Result<Self> {
        let geometry = LinkGeometry::joint_to_joint(chain, link_radius)?;
        Self::of(Surroundings::new(chain, &geometry, Some(scene), false)?, CLEARANCE_SMOOTHING)
    }

    /// Of links from each other: the pairs of the geometry.
    ///
    /// # Errors
    /// A geometry without pairs.
    pub fn of_self(chain: &Chain, links: &LinkGeometry, smoothing: f64) -> Result<Self> {
        if links.pairs().is_empty() {
            return Err(Error::Invalid("the links have no pairs that must not touch".into()));
        }
        Self::of(Surroundings::new(chain, links, None, true)?, smoothing)
    }

    /// Of everything in the surroundings: `smoothing` in m, 0 is the least distance itself.
    ///
    /// # Errors
    /// A smoothing that is negative or not finite.
    pub fn of(around: Surroundings, smoothing: f64) -> Result<Self> {
        check_finite("smoothing", &[smoothing])?;
        if smoothing < 0.0 {
            return Err(Error::OutOfRange {
                what: "smoothing".into(),
                value: smoothing,
                bound: ">= 0 m".into(),
            });
        }
        Ok(Self { around, smoothing })
    }

    /// What it keeps a distance from.
    pub fn surroundings(&self) -> &Surroundings {
        &self.around
    }

    /// Its value where the kinematics are known; allocates nothing.
    pub fn value_at(&self, kinematics: &Kinematics<'_>) -> f64 {
        let mut sum = Sum { minimum: SoftMinimum::new(self.smoothing), gradient: None };
        with_memory(|memory| self.around.scan(kinematics, 0.0, memory, &mut sum));
        sum.minimum.value()
    }
}

/// Adds up the pairs of a scan.
struct Sum<'a, 'k> {
    minimum: SoftMinimum,
    gradient: Option<(&'a Kinematics<'k>, &'a mut [f64])>,
}

impl Visitor for Sum<'_, '_> {
    fn limit(&self, _: Thing, _: Thing) -> f64 {
        self.minimum.least + self.minimum.beyond()
    }

    fn found(&mut self, contact: &Contact<'_>) -> bool {
        let (shrink, weight) = self.minimum.add(contact.gap.distance);
        if let Some((kinematics, out)) = &mut self.gradient {
            if shrink != 1.0 {
                out.iter_mut().for_each(|g| *g *= shrink);
            }
            if weight > 0.0 {
                contact.add_gradient(kinematics, weight, out);
            }
        }
        true
    }
}

/// `-tau log sum exp(-d / tau)` term by term.
struct SoftMinimum {
    tau: f64,
    least: f64,
    sum: f64,
}

impl SoftMinimum {
    fn new(tau: f64) -> Self {
        Self { tau, least: f64::INFINITY, sum: 0.0 }
    }

    /// Distances that are further than the least one by this add nothing.
    fn beyond(&self) -> f64 {
        self.tau * SOFT_MINIMUM_REST
    }

    /// Adds a distance; returns by what earlier terms shrink and the weight of this one, both to be divided by the
    /// sum in the end.
    #[inline(always)]
    fn add(&mut self, d: f64) -> (f64, f64) {
        if d < self.least {
            let shrink = if self.tau > 0.0 { ((d - self.least) / self.tau).exp() } else { 0.0 };
            self.least = d;
            self.sum = self.sum * shrink + 1.0;
            return (shrink, 1.0);
        }
        let weight = if self.tau > 0.0 { ((self.least - d) / self.tau).exp() } else { 0.0 };
        self.sum += weight;
        (1.0, weight)
    }

    fn value(&self) -> f64 {
        if self.sum > 1.0 { self.least - self.tau * self.sum.ln() } else { self.least }
    }
}

impl Criterion for Clearance {
    fn dof(&self) -> usize {
        self.around.chain().dof()
    }

    fn sense(&self) -> Sense {
        Sense::Maximize
    }

    fn chain(&self) -> Option<&Chain> {
        Some(self.around.chain())
    }

    fn value(&self, q: &[f64]) -> f64 {
        let chain = self.around.chain();
        let mut scratch = Scratch::new(chain);
        self.value_at(&chain.kinematics_unchecked(q, &mut scratch))
    }

    fn gradient(&self, q: &[f64], out: &mut [f64]) {
        let chain = self.around.chain();
        let mut scratch = Scratch::new(chain);
        self.gradient_at(q, &chain.kinematics_unchecked(q, &mut scratch), out);
    }

    fn gradient_at(&self, _q: &[f64], kinematics: &Kinematics<'_>, out: &mut [f64]) {
        out.fill(0.0);
        let minimum = SoftMinimum::new(self.smoothing);
        let mut sum = Sum { minimum, gradient: Some((kinematics, &mut *out)) };
        with_memory(|memory| self.around.scan(kinematics, 0.0, memory, &mut sum));
        let total = sum.minimum.sum;
        if total > 0.0 {
            out.iter_mut().for_each(|g| *g /= total);
        }
    }

    fn for_task(&self, task: &Task) -> Option<Arc<dyn Criterion>> {
        let (moved, held) = split_by_freedom(&self.around, task);
        // Where nothing can be done about any pair, all of them are as good.
        let some = !moved.is_empty() && !held.is_empty();
        some.then(|| Arc::new(Self { around: moved, smoothing: self.smoothing }) as Arc<dyn Criterion>)
    }

    fn hessian(&self, q: &[f64], out: &mut DMatrix<f64>) {
        let chain = self.around.chain();
        let mut scratch = Scratch::new(chain);
        hessian_by_differences(
            |at, out| self.gradient_at(at, &chain.kinematics_unchecked(at, &mut scratch), out),
            q,
            CLEARANCE_DIFFERENCE,
            out,
        );
    }
}
