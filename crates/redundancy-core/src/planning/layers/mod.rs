//! The configurations over each sample of a path, as layers that a search connects.

pub(super) mod srs;
