//! The set of configurations over one pose, as an object, for every arm.
//!
//! The set falls into *pieces*: isolated points (dimension 0) or curves (dimension 1). A curve is walked by its parameter
//! `u`; that of a closed piece is in `[-pi, pi)` and has the period `2 pi`, that of an open one runs from end to end of its
//! range. Joint limits do not belong to the set: a piece is there whether its limits hold or not, and
//! [`Solutions::intervals`] says where they do.
//!
//! Implemented by [`SelfMotion`](crate::solutions::SelfMotion) (up to eight circles, u is the swivel),
//! [`Configurations`](crate::solutions::Configurations) (up to eight points), and for arms without a closed form
//! [`TracedCurves`](crate::solutions::TracedCurves) and [`FoundPoints`](crate::solutions::FoundPoints). To ask for them:
//! [`solutions`](crate::solutions::solutions()).

use std::fmt::Debug;

use crate::chain::Chain;
use crate::criterion::Criterion;
use crate::error::{Error, Result};
use crate::status::Status;

/// A configuration chosen from [`Solutions`].
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// Joint positions within the limits.
    pub q: Vec<f64>,
    /// Index of its piece.
    pub piece: usize,
    /// Its parameter on the piece; 0 for an isolated point.
    pub u: f64,
    /// The criterion there, or the distance from the configuration that was asked about.
    pub value: f64,
    /// Whether no configuration over the pose is better: false for the best of a finite search.
    pub proven: bool,
}

/// Every configuration over one pose.
pub trait Solutions: Debug + Send + Sync {
    /// The arm.
    fn chain(&self) -> &Chain;

    /// 0 for isolated points, 1 for curves.
    fn dimension(&self) -> usize;

    /// `Converged` (there is a configuration within the joint limits), `Limits` (there are only others) or `Unreachable`.
    fn status(&self) -> Status;

    /// Why there is no configuration within the limits, with the number; empty when there is one and the verdict is exact.
    fn reason(&self) -> String;

    /// Whether the status and the list of pieces are exact: false where they come from a finite search, of which
    /// [`Solutions::reason`] then says how many starts it had.
    fn proven(&self) -> bool;

    /// Number of pieces.
    fn pieces(&self) -> usize;

    /// What tells the piece from the others: signs of a branch, or a number.
    ///
    /// # Errors
    /// A piece that does not exist.
    fn label(&self, piece: usize) -> Result<String>;

    /// Whether the piece is a closed curve; an isolated point is not.
    ///
    /// # Errors
    /// A piece that does not exist.
    fn closed(&self, piece: usize) -> Result<bool>;

    /// Ends of the parameter: `[-pi, pi]` for a closed piece, `[0, 0]` for a point.
    ///
    /// # Errors
    /// A piece that does not exist.
    fn range(&self, piece: usize) -> Result<[f64; 2]>;

    /// Writes the configuration at `u` to `out`: principal values, unless that breaks a limit and a winding does not.
    ///
    /// # Errors
    /// A piece that does not exist, a parameter that is not finite or beyond the ends of an open piece, a wrong length.
    fn q(&self, piece: usize, u: f64, out: &mut [f64]) -> Result<()>;

    /// Writes `dq/du` to `out`: finite and not zero, also where a joint or the named parameter turns back.
    ///
    /// # Errors
    /// As [`Solutions::q`]; a point has no tangent.
    fn tangent(&self, piece: usize, u: f64, out: &mut [f64]) -> Result<()>;

    /// Where every joint limit holds in some winding, with `margin` (rad or m) from each: `[lo, hi]`, ascending. On a closed
    /// piece `lo` is in `[-pi, pi)` and u is inside when `(u - lo) mod 2 pi <= hi - lo`; the whole piece is `[-pi, pi]`.
    /// For a point `[0, 0]` or nothing.
    ///
    /// # Errors
    /// A piece that does not exist, a margin that is negative or not finite.
    fn intervals(&self, piece: usize, margin: f64) -> Result<Vec<[f64; 2]>>;

    /// Value of the parameter that the arm's closed form is named after (swivel, q7) at `u`; `None` where there is none.
    ///
    /// # Errors
    /// As [`Solutions::q`].
    fn parameter(&self, piece: usize, u: f64) -> Result<Option<f64>>;

    /// The configuration within the limits with the least Euclidean distance to `q`, windings included; `None` when there is
    /// none.
    ///
    /// # Errors
    /// Wrong length of `q`, or an entry that is not finite.
    fn nearest(&self, q: &[f64]) -> Result<Option<Solution>>;

    /// The best configuration within the limits; `None` when there is none.
    ///
    /// # Errors
    /// A criterion for another number of joints.
    fn best(&self, criterion: &dyn Criterion) -> Result<Option<Solution>>;

    /// The configuration with the largest margin: the least distance (rad or m) of a joint from a limit in its best winding, which is
    /// the `value`; negative by how much the worst joint is outside where no configuration holds the limits. `None` where there is
    /// no configuration at all. [`Solutions::proves_margin`] says more than `proven`.
    ///
    /// # Errors
    /// A piece that cannot be evaluated.
    fn best_margin(&self) -> Result<Option<Solution>>;

    /// Whether it is proven that no configuration has a margin above `margin` and a few 1e-10.
    fn proves_margin(&self, margin: f64) -> bool;

    /// How much of the self-motion holds the joint limits, in the union of all pieces: radians of the parameter that the closed form
    /// is named after, the length in joint space where there is none, 0 for isolated configurations.
    ///
    /// # Errors
    /// A piece that cannot be evaluated.
    fn feasible_measure(&self) -> Result<f64>;
}

/// Checks the number of a piece.
pub(crate) fn check_piece(piece: usize, pieces: usize) -> Result<()> {
    if piece < pieces {
        return Ok(());
    }
    let bound = if pieces == 0 { "absent: there are no pieces".into() } else { format!("< {pieces}") };
    Err(Error::OutOfRange { what: "piece".into(), value: piece as f64, bound })
}

/// Checks a margin from the joint limits.
pub(crate) fn check_margin(margin: f64) -> Result<()> {
    if margin.is_finite() && margin >= 0.0 {
        return Ok(());
    }
    Err(Error::OutOfRange { what: "margin".into(), value: margin, bound: ">= 0 and finite".into() })
}
