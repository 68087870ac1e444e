//! Public behaviour of the core: properties, agreement, paper tables.

mod allocations;
mod chain;
mod chain_catalog;
mod chain_urdf;
mod kinematics;
