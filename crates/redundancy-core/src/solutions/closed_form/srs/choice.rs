//! What a search over the circles returns.

/// A configuration chosen from a circle of solutions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Choice {
    /// Joint positions within the limits.
    pub q: [f64; 7],
    /// Its swivel, rad in `(-pi, pi]`.
    pub swivel: f64,
    /// Its branch, `4 [s2 < 0] + 2 [s4 < 0] + [s6 < 0]`.
    pub branch: usize,
    /// The criterion there.
    pub value: f64,
    /// Whether no configuration over the pose is better: false for the best of a finite search.
    pub proven: bool,
}
