//! The one place where core errors become Python exceptions.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use redundancy_core::Error;

pyo3::create_exception!(
    redundancy,
    RedundancyError,
    PyValueError,
    "Invalid input; the message names the quantity, its value and the bound."
);
pyo3::create_exception!(
    redundancy,
    DescriptionError,
    RedundancyError,
    "A robot description (URDF, D-H rows, builder) cannot become a chain."
);
pyo3::create_exception!(
    redundancy,
    NotSrsError,
    RedundancyError,
    "Not a spherical-revolute-spherical arm; the message says which axes miss each other and by how much."
);
pyo3::create_exception!(
    redundancy,
    NotSphericalWristError,
    RedundancyError,
    "Not a six-joint arm with a spherical wrist; the message says which axes are wrong and by how much."
);
pyo3::create_exception!(
    redundancy,
    NotParallelAxesError,
    RedundancyError,
    "Not a six-joint arm with three parallel axes; the message says which axes are wrong and by how much."
);
pyo3::create_exception!(
    redundancy,
    NotPandaClassError,
    RedundancyError,
    "The chain is not an arm of the Panda class; the message says which axes are wrong and by how much."
);
pyo3::create_exception!(
    redundancy,
    FileFormatError,
    RedundancyError,
    "A file is malformed; the message gives its name and line."
);

pyo3::create_exception!(
    redundancy,
    CannotFollowError,
    RedundancyError,
    "The input is valid, but the arm cannot do it; the message says where and why."
);

/// Core error to Python exception.
pub fn to_py(error: Error) -> PyErr {
    let message = error.to_string();
    match error {
        Error::NotSrs { .. } => NotSrsError::new_err(message),
        Error::NotSphericalWrist { .. } => NotSphericalWristError::new_err(message),
        Error::NotParallelAxes { .. } => NotParallelAxesError::new_err(message),
        Error::NotPandaClass { .. } => NotPandaClassError::new_err(message),
        Error::CannotFollow(_) => CannotFollowError::new_err(message),
        Error::File { .. } => FileFormatError::new_err(message),
        Error::Description(_) | Error::InvertedLimits { .. } => DescriptionError::new_err(message),
        _ => RedundancyError::new_err(message),
    }
}

/// Adds the exception types to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("RedundancyError", py.get_type::<RedundancyError>())?;
    module.add("DescriptionError", py.get_type::<DescriptionError>())?;
    module.add("CannotFollowError", py.get_type::<CannotFollowError>())?;
    module.add("NotSrsError", py.get_type::<NotSrsError>())?;
    module.add("NotSphericalWristError", py.get_type::<NotSphericalWristError>())?;
    module.add("NotParallelAxesError", py.get_type::<NotParallelAxesError>())?;
    module.add("NotPandaClassError", py.get_type::<NotPandaClassError>())?;
    module.add("FileFormatError", py.get_type::<FileFormatError>())
}
