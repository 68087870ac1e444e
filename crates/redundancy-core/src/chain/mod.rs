//! The arm: an immutable description, cheap to clone.
//!
//! A [`Chain`] is a row of moving joints from base to tip; fixed joints are folded into the placements. It comes
//! from Denavit-Hartenberg rows ([`ChainBuilder::from_dh`]), from joints one by one ([`ChainBuilder`]), from a
//! URDF ([`urdf`]) or from the compiled-in [`catalog`].

pub mod catalog;
#[cfg(feature = "urdf")]
pub mod urdf;

mod builder;
#[allow(clippy::module_inception)]
mod chain;
mod collision;
mod dh;
mod entries;
mod extend;
mod joint;
mod published;
mod units;
mod windings;

pub use builder::ChainBuilder;
pub use chain::{Chain, Link};
pub use collision::{CollisionBody, CollisionShape};
pub use dh::{DhConvention, DhRow};
pub use joint::{Inertia, Joint, JointKind, Limits};
#[cfg(feature = "urdf")]
pub use urdf::MissingLimits;

pub(crate) use chain::{Body, Step, axis_onto_z};
