//! Long calls on one thread: progress, time limit, Ctrl-C.

use std::sync::{Arc, Mutex, PoisonError};

use pyo3::prelude::*;
use redundancy_core::Watch;

use crate::error::to_py;

/// Calls `work` without the GIL; it reports to `progress`, and stops on Ctrl-C or when `progress` raises.
///
/// # Errors
/// What stopped it, an error of `work`, a time limit that is negative.
pub fn watched<T: Send>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    time_limit: Option<f64>,
    work: impl FnOnce(&Watch) -> redundancy_core::Result<T> + Send,
) -> PyResult<T> {
    let stopped: Arc<Mutex<Option<PyErr>>> = Arc::default();
    let seen = Arc::clone(&stopped);
    let mut watch = Watch::default().with_observer(move |watch| {
        let report = |py: Python<'_>| -> PyResult<()> {
            py.check_signals()?;
            progress.as_ref().map_or(Ok(()), |call| call.call1(py, (watch.share(),)).map(drop))
        };
        match Python::attach(report) {
            Ok(()) => true,
            Err(error) => {
                *seen.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
                false
            }
        }
    });
    if let Some(seconds) = time_limit {
        watch = watch.with_time_limit(seconds).map_err(to_py)?;
    }
    let done = py.detach(|| work(&watch));
    let stopped = stopped.lock().unwrap_or_else(PoisonError::into_inner).take();
    match stopped {
        Some(error) => Err(error),
        None => done.map_err(to_py),
    }
}
