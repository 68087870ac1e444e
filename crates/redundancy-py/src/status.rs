//! Core words as members of `redundancy.Status` and `redundancy.EventKind`.

use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use redundancy_core::Status;
use redundancy_core::optimum::Kind;
use redundancy_core::path::EventKind;

/// The member of `redundancy.status.Status` for a core status.
pub fn status_to_py(py: Python<'_>, status: Status) -> PyResult<Bound<'_, PyAny>> {
    static CLASS: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    member(py, &CLASS, "Status", status.as_str())
}

/// The member of `redundancy.status.EventKind` for a core kind.
pub fn event_kind_to_py(py: Python<'_>, kind: EventKind) -> PyResult<Bound<'_, PyAny>> {
    static CLASS: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    member(py, &CLASS, "EventKind", kind.as_str())
}

/// The member of `redundancy.status.Kind` for a core kind.
pub fn kind_to_py(py: Python<'_>, kind: Kind) -> PyResult<Bound<'_, PyAny>> {
    static CLASS: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    member(py, &CLASS, "Kind", kind.as_str())
}

fn member<'py>(
    py: Python<'py>,
    class: &PyOnceLock<Py<PyAny>>,
    name: &str,
    word: &str,
) -> PyResult<Bound<'py, PyAny>> {
    let load = || py.import("redundancy.status")?.getattr(name).map(Bound::unbind);
    class.get_or_try_init(py, load)?.bind(py).call1((word,))
}
