//! Core statuses as members of `redundancy.Status`.

use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use redundancy_core::Status;

/// The member of `redundancy.status.Status` for a core status.
pub fn status_to_py(py: Python<'_>, status: Status) -> PyResult<Bound<'_, PyAny>> {
    static CLASS: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let class = CLASS
        .get_or_try_init(py, || py.import("redundancy.status")?.getattr("Status").map(Bound::unbind))?
        .bind(py);
    class.call1((status.as_str(),))
}
