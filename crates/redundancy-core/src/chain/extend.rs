//! Chains with something added at either end: a rail below the base, a payload at the tip.

use nalgebra::{Matrix3, Vector3};

use super::builder::ChainBuilder;
use super::chain::Chain;
use super::joint::{Inertia, JointKind, Limits};
use crate::error::{Error, Result, check_finite};
use crate::tolerance::INERTIA_ROUNDING;

impl Chain {
    /// The same arm on a rail: one prismatic joint before the base.
    ///
    /// `axis` is the direction of the rail in world axes, of any length; at 0 on the rail the arm stands where it stood. The
    /// joint is called `name` and becomes the first one; the first link is `<name>_base`, which stands, and the former first
    /// link moves with the rail. Another call puts a rail below the rail. Where the chain has inertias, the rail carries the
    /// bodies of the arm that its joints move; the mass of the former first link is not known.
    ///
    /// # Errors
    /// An axis without length, invalid limits, a name that a joint or link already has.
    ///
    /// ```
    /// use redundancy_core::chain::{Limits, catalog};
    /// use redundancy_core::nalgebra::Vector3;
    /// let arm = catalog::load("iiwa14")?;
    /// let railed = arm.with_rail("rail", Vector3::y(), Limits { lower: 0.0, upper: 2.0, ..Limits::NONE })?;
    /// assert_eq!((railed.dof(), railed.joints()[0].name.as_str()), (8, "rail"));
    /// let tip = |chain: &redundancy_core::chain::Chain, q: &[f64]| chain.forward(q).map(|pose| pose.translation.y);
    /// assert_eq!(tip(&railed, &[1.5, 0., 0., 0., 0., 0., 0., 0.])?, 1.5 + tip(&arm, &[0.0; 7])?);
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn with_rail(&self, name: &str, axis: Vector3<f64>, limits: Limits) -> Result<Self> {
        check_finite("axis", axis.as_slice())?;
        // The joint sits in the first link, which `base` turns.
        let axis = self.base().rotation.inverse() * axis;
        let mut builder = ChainBuilder::new(self.name(), format!("{name}_base")).joint(
            name,
            JointKind::Prismatic,
            crate::pose::Pose::identity(),
            axis,
            limits,
        );
        let mut links = self.links().iter().peekable();
        for after in 0..=self.dof() {
            while let Some(link) = links.next_if(|link| link.joints_before == after) {
                builder = builder.link(link.name.as_str(), link.offset);
            }
            if let Some(joint) = self.joints().get(after) {
                let axis = joint.axis.into_inner();
                builder = builder.joint(joint.name.as_str(), joint.kind, joint.placement, axis, joint.limits);
            }
        }
        if let Some(inertias) = self.inertias() {
            builder = builder.inertias([&[Inertia::ZERO], inertias].concat());
        }
        builder.base(*self.base()).tool(*self.tool()).build()
    }

    /// The same arm with a body that is fixed to its tip; adds to what is there.
    ///
    /// Centre of mass and inertia (at the centre of mass) are in the frame of the last link, the tip, whatever the tool is.
    /// It counts in torques and whatever depends on them, not in the kinematics.
    ///
    /// # Errors
    /// A chain without inertias; a mass that is not positive, numbers that are not finite, an inertia that is not symmetric or
    /// not positive semidefinite, a rotor.
    ///
    /// ```
    /// use redundancy_core::chain::{Inertia, catalog};
    /// use redundancy_core::nalgebra::Vector3;
    /// let arm = catalog::load("puma560")?;
    /// let gun = Inertia { mass: 1.5, center_of_mass: Vector3::new(0.0, 0.0, 0.1), ..Inertia::ZERO };
    /// let mass = |arm: &redundancy_core::chain::Chain| arm.inertias().map(|bodies| bodies[5].mass);
    /// assert_eq!(mass(&arm.with_payload(&gun)?), mass(&arm).map(|m| m + 1.5));
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn with_payload(&self, payload: &Inertia) -> Result<Self> {
        check_payload(payload)?;
        let (Some(inertias), Some(tip)) = (self.inertias(), self.links().last()) else {
            return Err(Error::Invalid(format!(
                "'{}' has no inertias: with a payload alone its torques would be wrong; give the masses of its links first \
                 (<inertial> in a URDF, inertia= for Denavit-Hartenberg rows)",
                self.name()
            )));
        };
        let mut bodies = inertias.to_vec();
        if let Some(last) = bodies.last_mut() {
            *last = last.combined(&payload.moved(&tip.offset));
        }
        Ok(self.with_inertias(bodies))
    }
}

/// Checks a body that the caller describes.
fn check_payload(payload: &Inertia) -> Result<()> {
    let Inertia { mass, center_of_mass, tensor, rotor } = payload;
    if !(mass.is_finite() && *mass > 0.0) {
        let bound = "finite and > 0 kg".into();
        return Err(Error::OutOfRange { what: "payload: mass".into(), value: *mass, bound });
    }
    check_finite("payload: centre of mass", center_of_mass.as_slice())?;
    check_finite("payload: inertia", tensor.as_slice())?;
    if *rotor != 0.0 {
        let bound = "0: a payload has no rotor".into();
        return Err(Error::OutOfRange { what: "payload: rotor inertia".into(), value: *rotor, bound });
    }
    let rounding = INERTIA_ROUNDING * tensor.amax();
    let asymmetry = (tensor - tensor.transpose()).amax();
    if asymmetry > rounding {
        let (what, bound) =
            ("payload: asymmetry of the inertia".into(), format!("at most {rounding:e} kg m^2"));
        return Err(Error::OutOfRange { what, value: asymmetry, bound });
    }
    let symmetric: Matrix3<f64> = (tensor + tensor.transpose()) * 0.5;
    let least = symmetric.symmetric_eigenvalues().min();
    if least < -rounding {
        let what = "payload: least eigenvalue of the inertia".into();
        return Err(Error::OutOfRange { what, value: least, bound: ">= 0 kg m^2".into() });
    }
    Ok(())
}
