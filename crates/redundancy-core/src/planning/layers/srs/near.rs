//! The least distance of an arm, and what its links miss of the wanted one.

/// How near the links are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::planning) struct Near {
    /// The least of their distances, m.
    pub least: f64,
    /// Squares of the shares that they miss of the wanted clearance, added up.
    pub missing: f64,
}

impl Near {
    /// Nothing is near.
    pub const FAR: Self = Self { least: f64::INFINITY, missing: 0.0 };

    pub(in crate::planning) fn of(distances: impl IntoIterator<Item = f64>, wanted: f64) -> Self {
        distances.into_iter().fold(Self::FAR, |near, distance| {
            let missing = if distance < wanted { 1.0 - distance / wanted } else { 0.0 };
            Self { least: near.least.min(distance), missing: near.missing + missing * missing }
        })
    }
}
