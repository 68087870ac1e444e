//! `pose_metrics`: what an arm can do at many poses, into arrays.

use numpy::{PyArray1, PyArrayMethods, PyReadwriteArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use redundancy_core::Error;
use redundancy_core::kinematics::ToolFreedom;
use redundancy_core::solutions::{Capability, CapabilitySettings, Measures, Metric};

use crate::batch::in_blocks;
use crate::closed_form::read_arm;
use crate::convert::{Given, Threads, read_poses};
use crate::error::to_py;
use crate::links::{PyLinkGeometry, SelfCollision};
use crate::plan::PyToolFreedom;
use crate::scene::PyScene;
use crate::velocity::surroundings_of;

/// Poses between two looks at Ctrl-C.
const BLOCK: usize = 4_096;
/// The same where a pose takes milliseconds.
const SLOW_BLOCK: usize = 64;

/// One array that is filled.
enum Column<'py> {
    Flags(PyReadwriteArray1<'py, bool>),
    Numbers(PyReadwriteArray1<'py, f64>),
}

impl<'py> Column<'py> {
    /// The caller's array, or a new one; also as an object for the result.
    fn new(
        py: Python<'py>,
        metric: Metric,
        n: usize,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(Self, Bound<'py, PyAny>)> {
        let is_flag = matches!(metric, Metric::Reachable | Metric::Proven);
        let array = match out {
            Some(array) => array.clone(),
            None if is_flag => PyArray1::<bool>::zeros(py, n, false).into_any(),
            None => PyArray1::<f64>::zeros(py, n, false).into_any(),
        };
        let refuse = || {
            let (name, kind) = (metric.as_str(), if is_flag { "bool" } else { "float64" });
            to_py(Error::Invalid(format!(
                "out for '{name}' must be a writable C-contiguous array of {kind} with shape ({n},)"
            )))
        };
        let mut column = if is_flag {
            let array = array.cast::<PyArray1<bool>>().map_err(|_| refuse())?;
            Self::Flags(array.try_readwrite().map_err(|_| refuse())?)
        } else {
            let array = array.cast::<PyArray1<f64>>().map_err(|_| refuse())?;
            Self::Numbers(array.try_readwrite().map_err(|_| refuse())?)
        };
        let length = match &mut column {
            Self::Flags(array) => array.as_slice_mut().map(|flags| flags.len()),
            Self::Numbers(array) => array.as_slice_mut().map(|numbers| numbers.len()),
        };
        if length.map_err(|_| refuse())? != n {
            return Err(refuse());
        }
        Ok((column, array))
    }
}

/// The memory of a column.
enum Filled<'a> {
    Flags(&'a mut [bool]),
    Numbers(&'a mut [f64]),
}

/// What an arm can do at many poses; `redundancy.maps.metrics` and `maps.best_margin` call it.
///
/// Args:
///     chain: The arm, a `Chain` or an arm with a closed form.
///     poses: Poses `(N, 4, 4)` or `(4, 4)` in the world.
///     metrics: Names: `"reachable"` (a configuration within the joint limits exists), `"margin"` (the largest
///         possible least distance from a joint limit, rad or m; negative by how much the worst joint misses its limits
///         at best, `-inf` where no configuration exists), `"proven"` (that margin is proven to be the largest),
///         `"swivel_measure"` (how much of the self-motion holds the limits in the union of all branches: radians of
///         the swivel or of q7, else the length in joint space), `"manipulability"` (`det(J J^T)` at the margin's
///         configuration, 0 where there is none), `"spin_share"` (the feasible share of the allowed spins),
///         `"clearance"` (least distance from the scene and between links at the margin's configuration, m; `-inf`
///         where there is none).
///     freedom: How far the tool may tilt and spin away from each pose. The margin is then the best that a search
///         finds and not proven.
///     scene: Obstacles, for the clearance.
///     links: Shapes of the links, for the clearance; without it capsules of radius 0.05 m from joint to joint.
///     self_collision: Whether links count among each other; `"auto"`: if `links` has pairs.
///     out: Arrays `(N,)` by the name of the metric (bool for `reachable` and `proven`, else float64) that are filled
///         instead of new ones.
///     threads: Threads to use; all cores by default. The bits do not depend on it.
///
/// Returns:
///     The arrays `(N,)` by the name of the metric.
///
/// Raises:
///     RedundancyError: An unknown metric, a pose that is not rigid or finite, an array of another kind or length, a
///         clearance without scene or links with pairs.
///
/// Example:
///     >>> import redundancy as rd
///     >>> chain = rd.catalog.load("iiwa14")
///     >>> pose = chain.forward([0.3, 0.5, -0.2, 1.1, 0.4, 0.7, -0.9])
///     >>> float(rd.maps.metrics(chain, pose, ["margin"])["margin"][0]) > 0.5
///     True
#[pyfunction]
#[pyo3(signature = (chain, poses, metrics, freedom=None, *, scene=None, links=None, self_collision=None, out=None, threads=None),
    text_signature = "(chain, poses, metrics, freedom=None, *, scene=None, links=None, self_collision='auto', out=None, threads=None)")]
pub fn pose_metrics<'py>(
    py: Python<'py>,
    chain: &Bound<'py, PyAny>,
    poses: &Bound<'py, PyAny>,
    metrics: Vec<String>,
    freedom: Option<&Bound<'py, PyToolFreedom>>,
    scene: Option<Given<'py, PyScene>>,
    links: Option<&Bound<'py, PyLinkGeometry>>,
    self_collision: Option<SelfCollision>,
    out: Option<&Bound<'py, PyDict>>,
    threads: Option<Threads>,
) -> PyResult<Bound<'py, PyDict>> {
    let arm = read_arm(chain)?;
    let chain = &arm.chain.bind(py).get().chain;
    let metrics: Vec<Metric> =
        metrics.iter().map(|name| Metric::from_name(name)).collect::<Result<_, _>>().map_err(to_py)?;
    let poses = read_poses(poses)?;
    let n = poses.batch.unwrap_or(1);
    let result = PyDict::new(py);
    let mut columns = Vec::with_capacity(metrics.len());
    for metric in &metrics {
        let given = out.map(|out| out.get_item(metric.as_str())).transpose()?.flatten();
        let (column, array) = Column::new(py, *metric, n, given.as_ref())?;
        result.set_item(metric.as_str(), array)?;
        columns.push(column);
    }
    let freedom = freedom.map_or(ToolFreedom::NONE, |freedom| freedom.get().freedom);
    let around = surroundings_of(chain, scene.as_deref(), links, self_collision)?.map(|(around, _)| around);
    let settings = CapabilitySettings { freedom, around, metrics: metrics.clone() };
    let capability = Capability::new(chain, arm.form, settings).map_err(to_py)?;
    let block = if freedom.is_none() && capability.has_closed_form() { BLOCK } else { SLOW_BLOCK };
    let data = poses.as_slice()?;
    let mut filled: Vec<Filled<'_>> = Vec::with_capacity(columns.len());
    for column in &mut columns {
        filled.push(match column {
            Column::Flags(array) => Filled::Flags(array.as_slice_mut()?),
            Column::Numbers(array) => Filled::Numbers(array.as_slice_mut()?),
        });
    }
    in_blocks(py, n, block, threads, |rows| {
        let found = capability.measure_batch(&data[16 * rows.start..16 * rows.end]).map_err(|error| {
            match rows.start {
                0 => error,
                first => Error::Invalid(format!("after {first} poses: {error}")),
            }
        })?;
        for (filled, metric) in filled.iter_mut().zip(&metrics) {
            scatter(filled, *metric, rows.start, &found);
        }
        Ok(())
    })?;
    Ok(result)
}

fn scatter(filled: &mut Filled<'_>, metric: Metric, start: usize, found: &[Measures]) {
    match filled {
        Filled::Flags(flags) => {
            for (flag, found) in flags[start..].iter_mut().zip(found) {
                *flag = found.value(metric) != 0.0;
            }
        }
        Filled::Numbers(numbers) => {
            for (number, found) in numbers[start..].iter_mut().zip(found) {
                *number = found.value(metric);
            }
        }
    }
}
