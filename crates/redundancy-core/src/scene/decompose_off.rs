//! In place of `decompose` where the feature `mesh` is off.

use std::sync::Arc;

use super::hull::Hull;
use super::mesh::TriangleMesh;
use crate::error::{Error, Result};

/// # Errors
/// Always.
pub(crate) fn decompose(_: &TriangleMesh) -> Result<Arc<Vec<Arc<Hull>>>> {
    Err(Error::Invalid("convex decomposition needs the feature 'mesh' of the crate; take the hull".into()))
}
