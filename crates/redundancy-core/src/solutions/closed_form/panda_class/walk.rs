//! Configurations along a curve of the wrist, four at a time.

use wide::f64x4;

use super::geometry::PandaGeometry;
use super::ring::Sheet;
use super::target::{Rows, Target, transpose};

/// One configuration on a curve, for both shoulders.
#[derive(Debug, Clone, Copy)]
pub(super) struct Node {
    pub u: f64,
    pub q: [[f64; 7]; 2],
    /// `dq/du`.
    pub rate: [[f64; 7]; 2],
    /// Sine of the angle between axes 1 and 3.
    pub gimbal: f64,
}

/// Evaluates the curves over one pose.
#[derive(Debug, Clone, Copy)]
pub(super) struct Walk<'a> {
    pub geometry: &'a PandaGeometry,
    pub target: &'a Target,
}

impl Walk<'_> {
    /// Configurations and rates at four parameters of a curve of the wrist.
    #[inline]
    pub fn nodes(&self, sheet: &Sheet, u: [f64; 4]) -> [Node; 4] {
        let (rows, rates) = self.target.rows_with_rates(self.geometry, &sheet.at(f64x4::new(u)));
        let gimbal = rows.gimbal.to_array();
        let q = transpose(&rows);
        let rate = transpose(&Rows { fore: rates.fore, shoulder: rates.shoulder, ..rows });
        std::array::from_fn(|k| Node {
            u: u[k],
            q: [q[k], q[4 + k]],
            rate: [rate[k], rate[4 + k]],
            gimbal: gimbal[k],
        })
    }

    /// One configuration and its rates.
    #[inline]
    pub fn node(&self, sheet: &Sheet, u: f64) -> Node {
        self.nodes(sheet, [u; 4])[0]
    }
}
