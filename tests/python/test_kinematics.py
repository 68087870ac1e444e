"""Pose and Jacobian: agreement with pinocchio, batches, what is accepted and what is refused."""

import pickle
import subprocess
import sys

import numpy as np
import pinocchio as pin
import pytest
from arms import as_pinocchio, random_q
from scipy.spatial.transform import RigidTransform, Rotation

import redundancy as rd

NAMES = rd.catalog.names()
TOLERANCE = 1e-12


@pytest.mark.parametrize("moved", [False, True], ids=["as is", "base and tool"])
@pytest.mark.parametrize("name", NAMES)
def test_catalogue_agrees_with_pinocchio(name: str, moved: bool) -> None:
    chain = rd.catalog.load(name)
    if moved:
        chain = chain.with_base(pin.SE3.Random()).with_tool(pin.SE3.Random())
    model = as_pinocchio(chain)
    data = model.createData()
    tool = model.getFrameId("tool")
    scale = 1.0 + np.abs(chain.forward(np.zeros(chain.dof))[:3, 3]).max()
    for q in random_q(chain, seed=1):
        pin.framesForwardKinematics(model, data, q)
        for link in chain.link_names:
            expected = data.oMf[model.getFrameId(f"link {link}")].homogeneous
            assert np.abs(chain.forward(q, link) - expected).max() < TOLERANCE * scale
        jacobian = pin.computeFrameJacobian(model, data, q, tool, pin.LOCAL_WORLD_ALIGNED)
        assert np.abs(chain.forward(q) - data.oMf[tool].homogeneous).max() < TOLERANCE * scale
        assert np.abs(chain.jacobian(q) - jacobian).max() < TOLERANCE * scale


@pytest.mark.parametrize("name", NAMES)
def test_jacobian_against_central_differences(name: str) -> None:
    chain, h = rd.catalog.load(name), 1e-6
    for q in random_q(chain, seed=2, n=100):
        jacobian = chain.jacobian(q)
        steps = h * np.eye(chain.dof)
        plus, minus = chain.forward(q + steps), chain.forward(q - steps)
        linear = (plus[:, :3, 3] - minus[:, :3, 3]) / (2 * h)
        angular = Rotation.from_matrix(plus[:, :3, :3] @ np.swapaxes(minus[:, :3, :3], 1, 2)).as_rotvec() / (
            2 * h
        )
        assert np.abs(jacobian - np.hstack([linear, angular]).T).max() < 5e-9


@pytest.mark.parametrize("name", NAMES)
def test_hessian_agrees_with_pinocchio(name: str) -> None:
    # Pinocchio: d (J qd) / dq = the derivative of the frame's velocity, for each unit qd.
    chain = rd.catalog.load(name)
    model = as_pinocchio(chain)
    data = model.createData()
    tool = model.getFrameId("tool")
    for q in random_q(chain, seed=4, n=20):
        hessian = chain.hessian(q)
        for k in range(chain.dof):
            pin.computeForwardKinematicsDerivatives(model, data, q, np.eye(chain.dof)[k], np.zeros(chain.dof))
            pin.computeJointJacobiansTimeVariation(model, data, q, np.eye(chain.dof)[k])
            pin.updateFramePlacements(model, data)
            rate = pin.getFrameJacobianTimeVariation(model, data, tool, pin.LOCAL_WORLD_ALIGNED)
            assert np.abs(hessian[:, :, k] - rate).max() < 1e-11
    many = random_q(chain, seed=5, n=300)
    assert np.array_equal(chain.hessian(many)[7], chain.hessian(many[7]))


def test_tasks() -> None:
    assert [rd.Task(name).dim for name in ("pose", "pose_rpy", "position", "pointing", "planar", "planar_pose")] == [
        6, 6, 3, 5, 2, 3,
    ]  # fmt: skip
    tilted = rd.Task.pointing([0.0, 3.0, 4.0])
    assert np.allclose(tilted.axis, [0.0, 0.6, 0.8]) and tilted.name == "pointing"
    assert tilted != rd.Task("pointing") == rd.Task.pointing()
    for task in (tilted, rd.Task("pose_rpy")):
        again = pickle.loads(pickle.dumps(task))
        assert again == task and hash(again) == hash(task) and repr(again) == repr(task)
    with pytest.raises(rd.RedundancyError, match="unknown task 'tcp', expected one of: pose, "):
        rd.Task("tcp")


def test_a_batch_is_many_single_calls() -> None:
    chain = rd.catalog.load("iiwa14")
    q = random_q(chain, seed=3, n=40_000)
    poses, jacobians = chain.kinematics(q)
    assert poses.shape == (40_000, 4, 4) and jacobians.shape == (40_000, 6, 7)
    for i in (0, 1, 16_383, 16_384, 39_999):
        pose, jacobian = chain.kinematics(q[i])
        assert np.array_equal(pose, poses[i]) and np.array_equal(jacobian, jacobians[i])
        assert np.array_equal(chain.forward(q[i]), pose) and np.array_equal(chain.jacobian(q[i]), jacobian)
    assert np.array_equal(chain.forward(q), poses) and np.array_equal(chain.jacobian(q), jacobians)
    for threads in (1, 2, 5):
        again = chain.kinematics(q, threads=threads)
        assert np.array_equal(again[0], poses) and np.array_equal(again[1], jacobians)
        assert np.array_equal(chain.forward(q, "link_3", threads=threads)[5], chain.forward(q[5], "link_3"))
        assert np.array_equal(chain.jacobian(q, threads=threads), jacobians)
    empty = chain.kinematics(np.empty((0, 7)))
    assert empty[0].shape == (0, 4, 4) and empty[1].shape == (0, 6, 7)


def test_any_array_of_numbers_is_a_configuration() -> None:
    chain = rd.catalog.load("planar3r")
    expected = chain.forward(np.array([1.0, 2.0, 3.0]))
    frozen = np.array([1.0, 2.0, 3.0])
    frozen.flags.writeable = False
    strided = np.array([1.0, 0.0, 2.0, 0.0, 3.0, 0.0])[::2]
    for q in ([1, 2, 3], (1.0, 2.0, 3.0), np.array([1, 2, 3]), np.float32([1, 2, 3]), frozen, strided):
        assert np.array_equal(chain.forward(q), expected)
        assert np.array_equal(chain.kinematics(q)[0], expected)
    many = np.asfortranarray([[1.0, 2.0, 3.0], [1.0, 2.0, 3.0]])
    assert np.array_equal(chain.forward(many)[1], expected)


class AsMatrix:
    """Looks like mink's or viser's SE3."""

    def __init__(self, matrix: np.ndarray) -> None:
        self.matrix = matrix

    def as_matrix(self) -> np.ndarray:
        return self.matrix


class A:
    """Looks like spatialmath's SE3."""

    def __init__(self, matrix: np.ndarray) -> None:
        self.A = matrix


def test_poses_of_other_packages() -> None:
    chain = rd.catalog.load("pa10")
    pose = pin.SE3.Random()
    matrix = pose.homogeneous
    expected = chain.with_tool(matrix)
    rigid = RigidTransform.from_matrix(matrix)
    for same in (pose, AsMatrix(matrix), A(matrix), matrix.tolist(), np.asfortranarray(matrix)):
        assert chain.with_tool(same) == expected
        assert np.array_equal(chain.with_base(same).base, matrix)
    assert np.abs(chain.with_tool(rigid).tool - matrix).max() < 1e-15  # scipy goes through a quaternion


def test_no_robotics_package_is_imported() -> None:
    code = "import sys, redundancy; print(sorted({'pinocchio', 'scipy', 'mink', 'spatialmath'} & set(sys.modules)))"
    found = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert found.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda c: c.forward(np.zeros(6)), ["q", "(6,)", "(7,)", "(N, 7)"]),
        (lambda c: c.forward(np.zeros((2, 6))), ["q", "(2, 6)", "(N, 7)"]),
        (lambda c: c.forward(np.zeros((1, 2, 7))), ["q", "(1, 2, 7)"]),
        (lambda c: c.forward(0.5), ["q", "()"]),
        (lambda c: c.forward([0, 0, np.nan, 0, 0, 0, 0]), ["q", "entry 2", "NaN"]),
        (lambda c: c.jacobian([0, 0, 0, 0, 0, 0, np.inf]), ["q", "entry 6", "inf"]),
        (lambda c: c.kinematics(np.full((3, 7), np.nan)), ["q", "NaN"]),
        (lambda c: c.forward(["a"] * 7), ["q", "numbers"]),
        (lambda c: c.forward(None), ["q"]),
        (lambda c: c.forward(np.zeros(7), "elbow"), ["link", "'elbow'", "base, link1", "flange"]),
        (lambda c: c.forward(np.zeros((2, 7)), threads=0), ["threads", "0", "at least 1"]),
        (lambda c: c.with_tool(np.eye(3)), ["pose", "(3, 3)", "(4, 4)"]),
        (lambda c: c.with_tool(np.ones((4, 4))), ["pose", "bottom row"]),
        (lambda c: c.with_tool(np.diag([1.0, 1.0, 1.1, 1.0])), ["orthonormal", "1e-3"]),
        (lambda c: c.with_tool(np.diag([1.0, 1.0, -1.0, 1.0])), ["reflection"]),
        (lambda c: c.with_tool(np.full((4, 4), np.nan)), ["pose", "NaN"]),
        (lambda c: c.with_base(np.stack([np.eye(4)] * 2)), ["one pose", "batch"]),
        (lambda c: c.with_base("flange"), ["pose"]),
    ],
)
def test_bad_input_is_named(call, words) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(rd.RedundancyError) as caught:
        call(rd.catalog.load("pa10"))
    assert isinstance(caught.value, ValueError)
    for word in words:
        assert word in str(caught.value), f"{caught.value} lacks {word}"
