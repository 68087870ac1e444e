//! Caller-owned memory, and the proof that what is in it belongs to one `q`.

use nalgebra::{Dyn, Matrix3, Matrix6xX, Vector3};

use super::forward::Frame;
use crate::chain::Chain;
use crate::pose::Pose;

/// Memory for the kinematics of one chain, allocated once and reused: a control step allocates nothing.
#[derive(Debug, Clone)]
pub struct Scratch {
    pub(super) origins: Vec<Vector3<f64>>,
    pub(super) axes: Vec<Vector3<f64>>,
    pub(super) frames: Vec<Frame>,
    pub(super) jacobian: Matrix6xX<f64>,
    pub(super) pose: Pose,
}

impl Scratch {
    /// Memory for chains with as many joints as `chain`.
    pub fn new(chain: &Chain) -> Self {
        let n = chain.dof();
        Self {
            origins: vec![Vector3::zeros(); n],
            axes: vec![Vector3::zeros(); n],
            frames: vec![Frame::world(); n],
            jacobian: Matrix6xX::zeros_generic(nalgebra::Const::<6>, Dyn(n)),
            pose: Pose::identity(),
        }
    }

    /// How many joints it has room for.
    pub fn dof(&self) -> usize {
        self.axes.len()
    }

    /// The kinematics at the last `q`.
    pub(crate) fn last(&self) -> Kinematics<'_> {
        Kinematics::new(self)
    }

    /// Pose of the tool at the last `q`.
    pub(crate) fn pose(&self) -> &Pose {
        &self.pose
    }

    /// Columns of the Jacobian at the last `q`.
    pub(crate) fn columns(&self) -> &[[f64; 6]] {
        self.jacobian.as_slice().as_chunks::<6>().0
    }
}

/// Pose and Jacobian at one `q`; only [`Chain::kinematics`] makes it, so they belong together.
#[derive(Debug, Clone, Copy)]
pub struct Kinematics<'a> {
    scratch: &'a Scratch,
}

impl<'a> Kinematics<'a> {
    pub(super) fn new(scratch: &'a Scratch) -> Self {
        Self { scratch }
    }

    /// Pose of the tool in the world.
    pub fn pose(&self) -> &'a Pose {
        &self.scratch.pose
    }

    /// Geometric Jacobian `(6, n)`, linear rows first, world axes, reference point at the tool.
    pub fn jacobian(&self) -> &'a Matrix6xX<f64> {
        &self.scratch.jacobian
    }

    /// Writes the Jacobian row by row, as numpy lays it out.
    ///
    /// # Panics
    /// Never; what does not fit into `out` is left out.
    pub fn write_jacobian(&self, out: &mut [f64]) {
        let columns = self.scratch.jacobian.as_slice().as_chunks::<6>().0;
        for (row, out) in out.chunks_exact_mut(columns.len().max(1)).take(6).enumerate() {
            for (entry, column) in out.iter_mut().zip(columns) {
                *entry = column[row];
            }
        }
    }

    /// A point on each joint axis in the world, m.
    pub fn origins(&self) -> &'a [Vector3<f64>] {
        &self.scratch.origins
    }

    /// Axes and origin, in the world, of the frame that joint `k` moves; its third axis is the joint's.
    #[inline(always)]
    pub(crate) fn frame(&self, k: usize) -> (Matrix3<f64>, Vector3<f64>) {
        let frame = &self.scratch.frames[k];
        (Matrix3::from_columns(&[frame.x, frame.y, frame.z]), frame.origin)
    }

    /// Unit vector of each joint axis in the world.
    pub fn axes(&self) -> &'a [Vector3<f64>] {
        &self.scratch.axes
    }
}
