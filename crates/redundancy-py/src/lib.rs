//! Python bindings: exports only. Every function converts, detaches, calls, converts.

use pyo3::prelude::*;

mod batch;
mod convert;
mod error;
mod rotation;
mod status;

#[pymodule]
mod _core {
    use super::*;

    #[pymodule_export]
    use rotation::{
        PyCone, PyCrossSection, PyOrientationOptimizer, PyOrientationSolution, PyQuaternionVolume, PySpin,
        optimal_directions, quaternion_angle, quaternion_error, quaternion_from_rpy, quaternion_from_xyz,
        quaternion_from_zyz, quaternion_shortest_arc, quaternion_swing_twist, quaternion_to_rpy,
        quaternion_to_xyz, quaternion_to_zyz,
    };

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        error::register(module)
    }
}
