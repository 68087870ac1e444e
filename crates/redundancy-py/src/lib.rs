//! Python bindings: exports only. Every function converts, detaches, calls, converts.

// One argument per keyword.
#![allow(clippy::too_many_arguments)]
// The `///` comments of Python's names are its docstrings (`make stubs` copies them into `_core.pyi`): Google style, where
// brackets are shapes and ranges and indented lines are arguments and examples in Python.
#![allow(
    clippy::doc_markdown,
    clippy::doc_lazy_continuation,
    clippy::doc_overindented_list_items,
    clippy::too_long_first_doc_paragraph
)]
#![allow(rustdoc::broken_intra_doc_links, rustdoc::invalid_html_tags, rustdoc::invalid_rust_codeblocks)]

use pyo3::prelude::*;

mod arms;
mod batch;
mod capability;
mod chain;
mod check;
mod closed_form;
mod continuation;
mod convert;
mod criterion;
mod error;
mod html;
mod ik;
mod links;
mod obstacle;
mod optimum;
mod orientation_plan;
mod orientation_set;
mod path;
mod plan;
mod planning;
mod quaternion;
mod retime;
mod rotation;
mod scene;
mod self_motion;
mod solutions;
mod speed;
mod status;
mod streaming;
mod task;
mod velocity;
mod watch;

#[pymodule]
mod _core {
    use super::*;

    #[pymodule_export]
    use arms::{PyConfigurations, PyPandaClassArm, PyParallelAxesArm, PySphericalWristArm};
    #[pymodule_export]
    use capability::pose_metrics;
    #[pymodule_export]
    use chain::{PyChain, catalog_load, catalog_names};
    #[pymodule_export]
    use check::{PyCheckReport, PyFinding, py_check, py_joint_move};
    #[pymodule_export]
    use closed_form::py_closed_form;
    #[pymodule_export]
    use continuation::{
        PySelfMotionCurve, py_self_motion_curves, py_self_motion_patch, py_trace_self_motion,
    };
    #[pymodule_export]
    use criterion::{
        PyClearanceCriterion, PyCriterion, PyElbow, PyJointRange, PyManipulability, PyPosture,
        PySelfClearanceCriterion,
    };
    #[pymodule_export]
    use ik::{
        PyIkBatch, PyIkResult, PyIkSolver, PyIkTrace, half_angle_minimum, joint_cost, sinusoid_minimum,
    };
    #[pymodule_export]
    use links::{PyLinkGeometry, PyPairClearances, PySelfClearance};
    #[pymodule_export]
    use obstacle::{PyBox, PyCapsule, PyCylinder, PyHalfSpace, PyMesh, PySphere};
    #[pymodule_export]
    use optimum::{
        PyClassification, PyCofactorCondition, PyCriticalPoint, PyFollowedOptimum, PyRankedStart,
        PySingularPoint, PySingularityCurve, py_algorithmic_singularities, py_classify,
        py_cofactor_condition, py_constrained_optima, py_follow_optimum, py_rank_starts,
        py_singularity_curves, py_singularity_distance,
    };
    #[pymodule_export]
    use orientation_plan::{PyOrientationPlan, py_plan_orientation};
    #[pymodule_export]
    use orientation_set::PyOrientationSet;
    #[pymodule_export]
    use plan::{PyPlan, PyToolFreedom, py_plan};
    #[pymodule_export]
    use planning::{PySwivelFlow, PySwivelPlan, py_plan_swivel};
    #[pymodule_export]
    use quaternion::{
        py_pose, quaternion_conjugate, quaternion_from_axis_angle, quaternion_from_matrix,
        quaternion_product, quaternion_rotate, quaternion_to_axis_angle, quaternion_to_matrix,
    };
    #[pymodule_export]
    use retime::{PyRetimed, py_retime};
    #[pymodule_export]
    use rotation::{
        PyCone, PyCrossSection, PyOrientationOptimizer, PyOrientationSolution, PyQuaternionVolume, PySpin,
        optimal_directions, quaternion_angle, quaternion_error, quaternion_from_rpy, quaternion_from_xyz,
        quaternion_from_zyz, quaternion_shortest_arc, quaternion_swing_twist, quaternion_to_rpy,
        quaternion_to_xyz, quaternion_to_zyz,
    };
    #[pymodule_export]
    use scene::{PyClearance, PyScene};
    #[pymodule_export]
    use self_motion::{PyBranch, PyChoice, PyChoiceBatch, PySelfMotion, PySolveBatch, PySrsArm};
    #[pymodule_export]
    use solutions::{PyPiece, PySolution, PySolutions, py_solutions};
    #[pymodule_export]
    use speed::{PyMaxSpeed, PyOrientationRule, PySpeedProfile, py_fastest_profile, py_max_speed};
    #[pymodule_export]
    use streaming::{PyServo, PyServoTick};
    #[pymodule_export]
    use task::PyTask;
    #[pymodule_export]
    use velocity::{
        PyDamping, PyExtendedJacobian, PyProjectedGradient, PyReducedGradient, PyResolver,
        PySaturatedNullspace, PyStep, PyTrack, py_track,
    };

    #[pymodule_export]
    use path::{PyEvent, PyPath, PyTrajectory, paths_circle, paths_raster, py_times_within_limits};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        error::register(module)
    }
}
