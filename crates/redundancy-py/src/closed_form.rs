//! Arms with a closed form as Python objects, and arguments that may be a chain or such an arm.

use std::sync::Arc;

use pyo3::prelude::*;
use redundancy_core::Error;
use redundancy_core::solutions::{
    ClosedForm, PandaClassArm, ParallelAxesArm, SphericalWristArm, SrsArm, closed_form,
};

use crate::arms::{PyPandaClassArm, PyParallelAxesArm, PySphericalWristArm};
use crate::chain::PyChain;
use crate::error::to_py;
use crate::self_motion::PySrsArm;

/// The Python object of a recognised arm, when it is of one kind.
type Wrap = for<'py> fn(&dyn ClosedForm, &Bound<'py, PyChain>) -> Option<PyResult<Bound<'py, PyAny>>>;

/// What a Python object of one kind holds.
type Unwrap = fn(&Bound<'_, PyAny>) -> Option<(Py<PyChain>, Arc<dyn ClosedForm>)>;

/// One row for each kind of arm in the registry.
const KINDS: [(Wrap, Unwrap); 4] = [
    (
        |form, chain| {
            let arm = form.as_any().downcast_ref::<SphericalWristArm>()?.clone();
            let arm = PySphericalWristArm { arm, chain: chain.clone().unbind() };
            Some(Bound::new(chain.py(), arm).map(Bound::into_any))
        },
        |object| {
            let arm = object.cast::<PySphericalWristArm>().ok()?.get();
            Some((arm.chain.clone_ref(object.py()), Arc::new(arm.arm.clone())))
        },
    ),
    (
        |form, chain| {
            let arm = form.as_any().downcast_ref::<SrsArm>()?.clone();
            Some(Bound::new(chain.py(), PySrsArm::from_arm(arm, chain)).map(Bound::into_any))
        },
        |object| {
            let arm = object.cast::<PySrsArm>().ok()?.get();
            Some((arm.chain.clone_ref(object.py()), Arc::new(arm.arm.clone())))
        },
    ),
    (
        |form, chain| {
            let arm = form.as_any().downcast_ref::<ParallelAxesArm>()?.clone();
            let arm = PyParallelAxesArm { arm, chain: chain.clone().unbind() };
            Some(Bound::new(chain.py(), arm).map(Bound::into_any))
        },
        |object| {
            let arm = object.cast::<PyParallelAxesArm>().ok()?.get();
            Some((arm.chain.clone_ref(object.py()), Arc::new(arm.arm.clone())))
        },
    ),
    (
        |form, chain| {
            let arm = form.as_any().downcast_ref::<PandaClassArm>()?.clone();
            let arm = PyPandaClassArm { arm, chain: chain.clone().unbind() };
            Some(Bound::new(chain.py(), arm).map(Bound::into_any))
        },
        |object| {
            let arm = object.cast::<PyPandaClassArm>().ok()?.get();
            Some((arm.chain.clone_ref(object.py()), Arc::new(arm.arm.clone())))
        },
    ),
];

/// A chain, with its closed form where the caller gave an arm.
pub struct Arm {
    pub chain: Py<PyChain>,
    pub form: Option<Arc<dyn ClosedForm>>,
}

/// Reads a `chain=` that may be a `Chain` or an arm with a closed form.
pub fn read_arm(object: &Bound<'_, PyAny>) -> PyResult<Arm> {
    if let Ok(chain) = object.cast::<PyChain>() {
        return Ok(Arm { chain: chain.clone().unbind(), form: None });
    }
    if let Some((chain, form)) = KINDS.iter().find_map(|(_, unwrap)| unwrap(object)) {
        return Ok(Arm { chain, form: Some(form) });
    }
    let message = format!("chain is {}, expected a Chain or an arm with a closed form", object.repr()?);
    Err(to_py(Error::Invalid(message)))
}

/// The closed form of an arm, recognised from its geometry.
///
/// Every arm object has `.name`, `.chain`, `.defect` (metres, radians) and `.parameter`, the name of the parameter
/// that describes its spare freedom (`"swivel"`), `None` if the configurations for a pose are isolated.
///
/// Args:
///     chain: The arm; an arm object is returned as it is.
///
/// Returns:
///     The arm object, or `None` if no closed form is known.
///
/// Example:
///     >>> import redundancy as rd
///     >>> rd.closed_form(rd.catalog.load("iiwa14")).parameter
///     'swivel'
///     >>> rd.closed_form(rd.catalog.load("puma560")).name
///     'spherical_wrist'
#[pyfunction]
#[pyo3(name = "closed_form")]
pub fn py_closed_form<'py>(chain: &Bound<'py, PyAny>) -> PyResult<Option<Bound<'py, PyAny>>> {
    let arm = read_arm(chain)?;
    if arm.form.is_some() {
        return Ok(Some(chain.clone()));
    }
    let handle = arm.chain.bind(chain.py());
    let Some(form) = closed_form(&handle.get().chain) else { return Ok(None) };
    let object = KINDS.iter().find_map(|(wrap, _)| wrap(&*form, handle));
    match object {
        Some(object) => object.map(Some),
        None => Err(to_py(Error::Invalid(format!("the closed form '{}' has no Python class", form.name())))),
    }
}
