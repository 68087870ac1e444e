//! Distance from obstacles, to be maximised.
//!
//! The least of the signed distances d_i of all pairs of link and obstacle has kinks where the nearest pair changes. A
//! soft minimum has none: `h = -tau log sum_i exp(-d_i / tau)`, at most the least distance, and less by at most tau
//! times the logarithm of the number of pairs that are about as near. `grad h = sum_i w_i grad d_i` with the weights
//! `w_i = exp((h - d_i) / tau)`, which add up to one.
//!
//! `d d_i / d q_k = n . d x / d q_k` with x the nearest point of the link's axis and n the unit vector to it from the
//! obstacle: where x sits on its axis is stationary or an end, so its shift does not count. Within one pair the distance
//! keeps the kinks that belong to the shapes: parallel segments, the middle planes inside of a box, a centre.
//!
//! The Hessian is the central difference of this gradient, symmetrised: good to about 1e-7 away from kinks.

use nalgebra::DMatrix;

use super::{Criterion, Sense};
use crate::chain::Chain;
use crate::error::{Error, Result, check_finite};
use crate::kinematics::{Kinematics, Scratch};
use crate::scene::{LinkGeometry, Scene};
use crate::tolerance::{CLEARANCE_DIFFERENCE, SOFT_MINIMUM_REST};

/// Default of the width over which the nearest pair changes, m.
pub const CLEARANCE_SMOOTHING: f64 = 0.002;

/// Distance of an arm from a scene. Infinite where the scene is empty, with no gradient.
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
    chain: Chain,
    scene: Scene,
    geometry: LinkGeometry,
    smoothing: f64,
}

impl Clearance {
    /// Links as capsules from joint to joint; [`CLEARANCE_SMOOTHING`].
    ///
    /// # Errors
    /// A radius that is negative or not finite.
    pub fn new(chain: &Chain, scene: &Scene, link_radius: f64) -> Result<Self> {
        let geometry = LinkGeometry::joint_to_joint(chain, link_radius)?;
        Self::with_geometry(chain, scene, geometry, CLEARANCE_SMOOTHING)
    }

    /// With the links' geometry and the smoothing of choice: `smoothing` in m, 0 is the least distance itself.
    ///
    /// # Errors
    /// A smoothing that is negative or not finite.
    pub fn with_geometry(
        chain: &Chain,
        scene: &Scene,
        geometry: LinkGeometry,
        smoothing: f64,
    ) -> Result<Self> {
        check_finite("smoothing", &[smoothing])?;
        if smoothing < 0.0 {
            return Err(Error::OutOfRange {
                what: "smoothing".into(),
                value: smoothing,
                bound: ">= 0 m".into(),
            });
        }
        Ok(Self { chain: chain.clone(), scene: scene.clone(), geometry, smoothing })
    }

    /// Its value where the kinematics are known; allocates nothing.
    pub fn value_at(&self, kinematics: &Kinematics<'_>) -> f64 {
        let mut minimum = SoftMinimum::new(self.smoothing);
        self.scene.each_pair(&self.geometry, kinematics, minimum.beyond(), |capsule, _, near| {
            minimum.add(near.distance - self.geometry.capsules()[capsule].radius);
        });
        minimum.value()
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
        self.chain.dof()
    }

    fn sense(&self) -> Sense {
        Sense::Maximize
    }

    fn chain(&self) -> Option<&Chain> {
        Some(&self.chain)
    }

    fn value(&self, q: &[f64]) -> f64 {
        let mut scratch = Scratch::new(&self.chain);
        self.value_at(&self.chain.kinematics_unchecked(q, &mut scratch))
    }

    fn gradient(&self, q: &[f64], out: &mut [f64]) {
        let mut scratch = Scratch::new(&self.chain);
        self.gradient_at(q, &self.chain.kinematics_unchecked(q, &mut scratch), out);
    }

    fn gradient_at(&self, _q: &[f64], kinematics: &Kinematics<'_>, out: &mut [f64]) {
        out.fill(0.0);
        let mut minimum = SoftMinimum::new(self.smoothing);
        self.scene.each_pair(&self.geometry, kinematics, minimum.beyond(), |capsule, _, near| {
            let capsule = &self.geometry.capsules()[capsule];
            let (shrink, weight) = minimum.add(near.distance - capsule.radius);
            if shrink != 1.0 {
                out.iter_mut().for_each(|g| *g *= shrink);
            }
            if weight > 0.0 {
                capsule.add_gradient(kinematics, near, weight, out);
            }
        });
        if minimum.sum > 0.0 {
            out.iter_mut().for_each(|g| *g /= minimum.sum);
        }
    }

    fn hessian(&self, q: &[f64], out: &mut DMatrix<f64>) {
        let n = q.len();
        let (mut at, mut plus, mut minus) = (q.to_vec(), vec![0.0; n], vec![0.0; n]);
        let mut scratch = Scratch::new(&self.chain);
        for k in 0..n {
            at[k] = q[k] + CLEARANCE_DIFFERENCE;
            self.gradient_at(&at, &self.chain.kinematics_unchecked(&at, &mut scratch), &mut plus);
            at[k] = q[k] - CLEARANCE_DIFFERENCE;
            self.gradient_at(&at, &self.chain.kinematics_unchecked(&at, &mut scratch), &mut minus);
            at[k] = q[k];
            for i in 0..n {
                out[(i, k)] = (plus[i] - minus[i]) / (2.0 * CLEARANCE_DIFFERENCE);
            }
        }
        for k in 0..n {
            for i in 0..k {
                let mean = 0.5 * (out[(i, k)] + out[(k, i)]);
                (out[(i, k)], out[(k, i)]) = (mean, mean);
            }
        }
    }
}
