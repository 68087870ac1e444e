//! Squared distance of the elbow, or of another point that the arm carries, from a point, to be minimised.
//!
//! `h = |x(q) - p|^2`, `h_k = 2 (x - p) . x_k`, `h_kl = 2 x_k . x_l + 2 (x - p) . x_kl` with
//! `x_k = w_k x (x - o_k)` and `x_kl = w_k x x_l` for `k <= l`, as for the tool.

use nalgebra::{DMatrix, Vector3};

use super::Criterion;
use crate::chain::{Chain, axis_onto_z};
use crate::error::{Result, check_finite};
use crate::kinematics::{Kinematics, Scratch};

/// Nearness of a point of the arm to a point in the world: `|x(q) - point|^2`, m^2.
///
/// ```
/// use redundancy_core::{chain::catalog, criterion::{Criterion, Elbow}};
/// let h = Elbow::new(&catalog::load("pa10")?, [0.0, 0.1, 0.765])?; // the stretched arm's elbow is at (0, 0, .765)
/// assert!((h.value(&[0.0; 7]) - 0.01).abs() < 1e-15);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Elbow {
    chain: Chain,
    point: Vector3<f64>,
    at: At,
}

#[derive(Debug, Clone, Copy)]
enum At {
    /// The origin of this joint, which itself and later ones do not move.
    Joint(usize),
    /// A point of the frame that the joints before this one move, in the frame whose z is the last axis.
    Carried(usize, Vector3<f64>),
    /// A point of the base.
    Base(Vector3<f64>),
}

impl Elbow {
    /// The elbow is the origin of the middle joint: of joint 4 for seven joints, else of joint `(n + 1) / 2`, rounded
    /// down and counted from 1.
    ///
    /// # Errors
    /// A point that is not finite.
    pub fn new(chain: &Chain, point: [f64; 3]) -> Result<Self> {
        check_finite("point", &point)?;
        let joint = chain.dof().saturating_sub(1) / 2;
        Ok(Self { chain: chain.clone(), point: point.into(), at: At::Joint(joint) })
    }

    /// The origin of a link's frame (see [`Chain::link_index`]) instead.
    ///
    /// # Errors
    /// A point that is not finite, an index that is no link.
    pub fn of_link(chain: &Chain, point: [f64; 3], link: usize) -> Result<Self> {
        check_finite("point", &point)?;
        let link = chain.link(link)?;
        let at = match link.joints_before.checked_sub(1) {
            None => At::Base((chain.base() * link.offset).translation.vector),
            Some(last) => {
                let to_z = axis_onto_z(&chain.joints()[last].axis);
                At::Carried(last + 1, to_z.tr_mul(&link.offset.translation.vector))
            }
        };
        Ok(Self { chain: chain.clone(), point: point.into(), at })
    }

    /// The point, and how many joints move it.
    #[inline(always)]
    fn place(&self, kinematics: &Kinematics<'_>) -> (Vector3<f64>, usize) {
        match &self.at {
            At::Joint(joint) => (kinematics.origins()[*joint], *joint),
            At::Carried(count, local) => {
                let (rotation, origin) = kinematics.frame(count - 1);
                (rotation * local + origin, *count)
            }
            At::Base(point) => (*point, 0),
        }
    }
}

/// `d x / d q_k` for a joint that moves x.
#[inline(always)]
fn rate(kinematics: &Kinematics<'_>, x: &Vector3<f64>, k: usize) -> Vector3<f64> {
    let axis = kinematics.angular(k);
    if axis == Vector3::zeros() { kinematics.linear(k) } else { axis.cross(&(x - kinematics.origins()[k])) }
}

impl Criterion for Elbow {
    fn dof(&self) -> usize {
        self.chain.dof()
    }

    fn chain(&self) -> Option<&Chain> {
        Some(&self.chain)
    }

    fn value(&self, q: &[f64]) -> f64 {
        let mut scratch = Scratch::new(&self.chain);
        let kinematics = self.chain.kinematics_unchecked(q, &mut scratch);
        (self.place(&kinematics).0 - self.point).norm_squared()
    }

    fn gradient(&self, q: &[f64], out: &mut [f64]) {
        let mut scratch = Scratch::new(&self.chain);
        self.gradient_at(q, &self.chain.kinematics_unchecked(q, &mut scratch), out);
    }

    fn gradient_at(&self, _q: &[f64], kinematics: &Kinematics<'_>, out: &mut [f64]) {
        let (x, count) = self.place(kinematics);
        for (k, out) in out.iter_mut().enumerate() {
            *out = if k < count { 2.0 * rate(kinematics, &x, k).dot(&(x - self.point)) } else { 0.0 };
        }
    }

    fn hessian(&self, q: &[f64], out: &mut DMatrix<f64>) {
        let mut scratch = Scratch::new(&self.chain);
        self.hessian_at(&self.chain.kinematics_unchecked(q, &mut scratch), out);
    }

    fn second_order_at(
        &self,
        q: &[f64],
        kinematics: &Kinematics<'_>,
        gradient: &mut [f64],
        hessian: &mut DMatrix<f64>,
    ) {
        self.gradient_at(q, kinematics, gradient);
        self.hessian_at(kinematics, hessian);
    }
}

impl Elbow {
    fn hessian_at(&self, kinematics: &Kinematics<'_>, out: &mut DMatrix<f64>) {
        let (x, count) = self.place(kinematics);
        out.fill(0.0);
        for l in 0..count {
            let last = rate(kinematics, &x, l);
            for k in 0..=l {
                let bent = kinematics.angular(k).cross(&last);
                out[(k, l)] = 2.0 * (rate(kinematics, &x, k).dot(&last) + (x - self.point).dot(&bent));
                out[(l, k)] = out[(k, l)];
            }
        }
    }
}
