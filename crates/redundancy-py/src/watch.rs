//! Long calls: progress, time limit, Ctrl-C.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use redundancy_core::parallel::Pool;
use redundancy_core::{Error, Watch};

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

/// How often a call on other threads is looked at.
const LOOK: Duration = Duration::from_millis(20);

/// Runs `work` in a pool without the GIL, beside which `report` is called from time to time. Ctrl-C cancels the call, and
/// its best result so far is the answer.
///
/// # Errors
/// What `report` raises, which cancels the call too; an error of `work`.
pub fn watched_aside<T: Send>(
    py: Python<'_>,
    watch: &Watch,
    pool: &Pool,
    mut report: impl FnMut(Python<'_>) -> PyResult<()> + Send,
    work: impl FnOnce() -> redundancy_core::Result<T> + Send,
) -> PyResult<T> {
    let mut stopped: Option<PyErr> = None;
    let done = py.detach(|| {
        std::thread::scope(|scope| {
            let caller = std::thread::current();
            let running = scope.spawn(move || {
                let done = pool.install(work);
                caller.unpark();
                done
            });
            while !running.is_finished() {
                std::thread::park_timeout(LOOK);
                let quiet = stopped.is_some();
                let look = |py: Python<'_>| {
                    let asked =
                        if quiet { py.check_signals() } else { py.check_signals().and_then(|()| report(py)) };
                    match asked {
                        // It may also arrive while `report` runs Python code.
                        Err(error) if error.is_instance_of::<PyKeyboardInterrupt>(py) => {
                            watch.cancel();
                            Ok(())
                        }
                        other => other,
                    }
                };
                if let Err(error) = Python::attach(look) {
                    watch.cancel();
                    stopped = Some(error);
                }
            }
            running.join()
        })
    });
    match stopped {
        Some(error) => Err(error),
        None => {
            done.map_err(|_| to_py(Error::Invalid("the planner stopped unexpectedly".into())))?.map_err(to_py)
        }
    }
}
