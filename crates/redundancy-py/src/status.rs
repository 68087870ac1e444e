//! Core words as members of `redundancy.Status` and `redundancy.EventKind`.

use numpy::PyArray1;
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

/// An object array of members for many statuses; a handful of distinct objects, so one look-up each.
pub fn statuses_to_py<'py>(
    py: Python<'py>,
    statuses: &[Status],
) -> PyResult<Bound<'py, PyArray1<Py<PyAny>>>> {
    let mut known: Vec<(Status, Py<PyAny>)> = vec![];
    let mut words: Vec<Py<PyAny>> = Vec::with_capacity(statuses.len());
    for s in statuses {
        let word = match known.iter().find(|(k, _)| k == s) {
            Some((_, word)) => word.clone_ref(py),
            None => {
                let word = status_to_py(py, *s)?.unbind();
                known.push((*s, word.clone_ref(py)));
                word
            }
        };
        words.push(word);
    }
    Ok(PyArray1::from_vec(py, words))
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
