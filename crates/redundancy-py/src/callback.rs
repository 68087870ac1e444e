//! A criterion that is a function of the user's: its exceptions reach the caller of whatever evaluated it.
//!
//! The core's criteria cannot fail, and may be evaluated by many threads. So an exception is kept here, what is left of the
//! call sees zeros without calling Python again, and the binding raises the exception when the core returns.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use redundancy_core::Error;
use redundancy_core::criterion::{Criterion, Sense, gradient_by_differences, hessian_by_differences};
use redundancy_core::nalgebra::DMatrix;
use redundancy_core::tolerance::{GRADIENT_DIFFERENCE, SECOND_DIFFERENCE};

use crate::chain::PyChain;
use crate::convert::read_vector;
use crate::criterion::{PyCriterion, partial};
use crate::error::to_py;
use crate::plan::read_chain;

/// How often a call that runs functions of the user's on other threads looks for Ctrl-C.
const LOOK: Duration = Duration::from_millis(20);

/// Exceptions of one function.
#[derive(Debug, Default)]
pub struct Failures {
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    /// Calls into the core that will look at the exceptions.
    calls: usize,
    /// Exceptions so far.
    count: u64,
    last: Option<PyErr>,
    /// One of the present calls has failed.
    failed: bool,
}

impl Failures {
    /// Never held while Python code runs.
    fn with<T>(&self, work: impl FnOnce(&mut State) -> T) -> T {
        work(&mut self.state.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn note(&self, py: Python<'_>, error: PyErr) {
        let unseen = self.with(|state| {
            if state.calls == 0 {
                return Some(error);
            }
            state.count += 1;
            state.failed = true;
            state.last.replace(error)
        });
        // Of a call that nobody looks after; an earlier exception of the same call is left out.
        if let Some(error) = unseen.filter(|_| self.with(|state| state.calls == 0)) {
            error.write_unraisable(py, None);
        }
    }
}

/// One call into the core during which functions of the user's may fail.
pub struct Watching {
    failures: Vec<(Arc<Failures>, u64)>,
}

impl Watching {
    /// From now on, for these functions.
    pub fn new(failures: &[Arc<Failures>]) -> Self {
        let begin = |failures: &Arc<Failures>| {
            let count = failures.with(|state| {
                state.calls += 1;
                state.count
            });
            (Arc::clone(failures), count)
        };
        Self { failures: failures.iter().map(begin).collect() }
    }

    /// Of a criterion, if there is one.
    pub fn criterion(criterion: Option<&PyCriterion>) -> Self {
        Self::new(criterion.map_or(&[], |criterion| &criterion.failures))
    }

    /// Calls `work` without the GIL. Functions of the user's may then run on threads to which Python delivers no signals, so
    /// this thread looks for Ctrl-C beside them; it counts as an exception of the functions.
    pub fn detach<T: Send>(&self, py: Python<'_>, work: impl FnOnce() -> T + Send) -> T {
        if self.failures.is_empty() {
            return py.detach(work);
        }
        let done = py.detach(|| {
            std::thread::scope(|scope| {
                let caller = std::thread::current();
                let running = scope.spawn(move || {
                    let done = work();
                    caller.unpark();
                    done
                });
                while !running.is_finished() {
                    std::thread::park_timeout(LOOK);
                    Python::attach(|py| {
                        if let Err(error) = py.check_signals() {
                            self.failures
                                .iter()
                                .for_each(|(failures, _)| failures.note(py, error.clone_ref(py)));
                        }
                    });
                }
                running.join()
            })
        });
        done.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }

    /// Raises what a function has raised since the beginning.
    pub fn check(&self, py: Python<'_>) -> PyResult<()> {
        for (failures, before) in &self.failures {
            let raised = failures.with(|state| {
                (state.count > *before).then(|| state.last.as_ref().map(|error| error.clone_ref(py)))
            });
            if let Some(error) = raised.flatten() {
                return Err(error);
            }
        }
        Ok(())
    }
}

impl Drop for Watching {
    fn drop(&mut self) {
        for (failures, _) in &self.failures {
            // The exception itself is dropped outside of the lock.
            let last = failures.with(|state| {
                state.calls -= 1;
                if state.calls > 0 {
                    return None;
                }
                state.failed = false;
                state.last.take()
            });
            drop(last);
        }
    }
}

#[derive(Debug)]
struct Custom {
    value: Py<PyAny>,
    gradient: Option<Py<PyAny>>,
    sense: Sense,
    dof: Option<usize>,
    failures: Arc<Failures>,
}

impl Custom {
    /// The result of Python code; `None` once the call has failed.
    fn evaluate<T>(&self, work: impl FnOnce(Python<'_>) -> PyResult<T>) -> Option<T> {
        if self.failures.with(|state| state.failed) {
            return None;
        }
        Python::attach(|py| match py.check_signals().and_then(|()| work(py)) {
            Ok(value) => Some(value),
            Err(error) => {
                self.failures.note(py, error);
                None
            }
        })
    }
}

impl Criterion for Custom {
    fn dof(&self) -> usize {
        self.dof.unwrap_or(0)
    }

    fn any_dof(&self) -> bool {
        self.dof.is_none()
    }

    fn sense(&self) -> Sense {
        self.sense
    }

    fn value(&self, q: &[f64]) -> f64 {
        let value = self.evaluate(|py| {
            let value: f64 = self.value.bind(py).call1((PyArray1::from_slice(py, q),))?.extract()?;
            if value.is_finite() {
                return Ok(value);
            }
            let message = format!("the function of the CustomCriterion returned {value} for q = {q:?}");
            Err(to_py(Error::Invalid(message)))
        });
        value.unwrap_or(0.0)
    }

    fn gradient(&self, q: &[f64], out: &mut [f64]) {
        let Some(gradient) = &self.gradient else {
            return gradient_by_differences(|q| self.value(q), q, out);
        };
        let values = self.evaluate(|py| {
            let values = gradient.bind(py).call1((PyArray1::from_slice(py, q),))?;
            let values = read_vector(&values, "gradient of the CustomCriterion", Some(q.len()))?;
            match values.iter().find(|x| !x.is_finite()) {
                None => Ok(values),
                Some(x) => {
                    let message = format!("the gradient of the CustomCriterion has {x} for q = {q:?}");
                    Err(to_py(Error::Invalid(message)))
                }
            }
        });
        match values {
            Some(values) => out.copy_from_slice(&values),
            None => out.fill(0.0),
        }
    }

    fn hessian(&self, q: &[f64], out: &mut DMatrix<f64>) {
        let step = if self.gradient.is_some() { GRADIENT_DIFFERENCE } else { SECOND_DIFFERENCE };
        hessian_by_differences(|q, out| self.gradient(q, out), q, step, out);
    }
}

/// A function of yours as a criterion, usable wherever one is: in resolvers, `plan`, `best`, sums and multiples.
///
/// An exception of the function ends the call that evaluated it and is raised by that call. The function may be called
/// from several threads, one at a time (the GIL is taken for each evaluation), thousands of times by a search; a
/// control step calls `gradient` once, or `value` twice per joint without it.
///
/// Args:
///     value: Called with q `(n,)`, a fresh array; returns a finite number.
///     gradient: Called with q `(n,)`; returns dh/dq `(n,)`, per rad or m. Without it central differences of `value`
///         (1e-9 of its size off). The Hessian is always one of differences.
///     sense: `"minimize"` or `"maximize"`.
///     chain: The arm; without it any number of joints is accepted.
///
/// Raises:
///     RedundancyError: `value` or `gradient` that cannot be called, an unknown sense. When evaluated: numbers that are
///         not finite, a gradient of another length.
///
/// Example:
///     >>> import redundancy as rd
///     >>> h = rd.CustomCriterion(lambda q: float(q[0] ** 2), lambda q: [2 * q[0]] + [0.0] * 6)
///     >>> h.value([3.0] + [0.0] * 6)
///     9.0
#[pyclass(name = "CustomCriterion", module = "redundancy", frozen, extends = PyCriterion)]
pub struct PyCustomCriterion;

#[pymethods]
impl PyCustomCriterion {
    #[new]
    #[pyo3(signature = (value, gradient=None, *, sense="minimize", chain=None))]
    fn new(
        value: &Bound<'_, PyAny>,
        gradient: Option<&Bound<'_, PyAny>>,
        sense: &str,
        chain: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let py = value.py();
        for (name, given) in [("value", Some(value)), ("gradient", gradient)] {
            if let Some(given) = given.filter(|given| !given.is_callable()) {
                let message = format!("{name} is {}, expected a function of q", given.repr()?);
                return Err(to_py(Error::Invalid(message)));
            }
        }
        let known = [Sense::Minimize, Sense::Maximize];
        let chosen = known.into_iter().find(|one| one.as_str() == sense).ok_or_else(|| {
            let valid = known.map(|one| one.as_str().to_owned()).to_vec();
            to_py(Error::UnknownName { kind: "sense", name: sense.into(), valid })
        })?;
        let chain: Option<Bound<'_, PyChain>> = chain.map(read_chain).transpose()?;
        let failures = Arc::new(Failures::default());
        let criterion = Custom {
            value: value.clone().unbind(),
            gradient: gradient.map(|gradient| gradient.clone().unbind()),
            sense: chosen,
            dof: chain.as_ref().map(|chain| chain.get().chain.dof()),
            failures: Arc::clone(&failures),
        };
        let text = format!("CustomCriterion({}, sense='{sense}')", value.repr()?);
        let options = PyDict::new(py);
        options.set_item("sense", sense)?;
        options.set_item("chain", chain)?;
        let arguments: Bound<'_, PyTuple> = (value, gradient).into_pyobject(py)?;
        let recipe = partial(py, py.get_type::<Self>().into_any(), arguments, options)?;
        let base = PyCriterion::new(Arc::new(criterion), recipe, text).failing(vec![failures]);
        Ok(PyClassInitializer::from(base).add_subclass(Self))
    }
}
