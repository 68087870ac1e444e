"""The closed forms of arms with three parallel axes and of the Panda class, on robots that nobody here wrote."""

import pickle

import numpy as np
import pinocchio as pin
import pytest
from arms import as_pinocchio, example_robots

import redundancy as rd

FILES = {
    "ur3": ("ur_description/urdf/ur3_robot.urdf", "base_link", "tool0"),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "base_link", "tool0"),
    "ur10": ("ur_description/urdf/ur10_robot.urdf", "base_link", "tool0"),
    "z1": ("z1_description/urdf/z1.urdf", "link00", "link06"),
    "panda": ("panda_description/urdf/panda.urdf", "panda_link0", "panda_hand_tcp"),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", None, "link_eef"),
}


def load(name: str) -> rd.Chain:
    path, base, tip = FILES[name]
    return rd.Chain.from_urdf(example_robots() / path, base=base, tip=tip)


def forward(chain: rd.Chain, rows: np.ndarray) -> np.ndarray:
    """Poses by pinocchio."""
    model = as_pinocchio(chain)
    data, frame = model.createData(), model.getFrameId("tool")
    poses = []
    for q in rows:
        pin.framesForwardKinematics(model, data, q)
        poses.append(data.oMf[frame].homogeneous.copy())
    return np.array(poses)


def draw(chain: rd.Chain, n: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(chain.lower, chain.upper, (n, chain.dof))


def apart(rows: np.ndarray, q: np.ndarray) -> np.ndarray:
    return np.abs((rows - q + np.pi) % (2 * np.pi) - np.pi).max(axis=-1)


@pytest.mark.parametrize("name", ["ur3", "ur5", "ur10", "z1"])
def test_parallel_axes_against_pinocchio(name: str) -> None:
    chain = load(name)
    arm = rd.closed_form(chain)
    assert isinstance(arm, rd.ParallelAxesArm) and arm.name == "parallel_axes" and arm.parameter is None
    assert max(arm.defect) < 1e-12
    wanted = draw(chain, 100)
    for q, pose in zip(wanted, forward(chain, wanted), strict=True):
        rows = arm.solve(pose)
        assert 1 <= len(rows) <= 8 and apart(rows, q).min() < 1e-6
        assert np.abs(forward(chain, rows) - pose).max() < 4e-12
        assert np.all(rows >= chain.lower) and np.all(rows <= chain.upper)
        near = arm.nearest(pose, q)
        assert near is not None and np.abs(near - q).max() < 1e-6


@pytest.mark.parametrize("name", ["panda", "xarm7"])
def test_panda_class_against_pinocchio(name: str) -> None:
    chain = load(name)
    arm = rd.closed_form(chain)
    assert isinstance(arm, rd.PandaClassArm) and arm.name == "panda_class" and arm.parameter == "q7"
    bound = 4e-12 + 2 * max(arm.defect)
    wanted = draw(chain, 60)
    for q, pose in zip(wanted, forward(chain, wanted), strict=True):
        rows = arm.solve(pose, q[6])
        assert 1 <= len(rows) <= 8 and apart(rows, q).min() < 1e-5
        assert np.abs(forward(chain, rows) - pose).max() < 4e-12
        s = rd.solutions(arm, pose)
        assert s.status == "converged" and s.dimension == 1
        for piece in s.pieces:
            assert piece.closed and piece.range == pytest.approx((-np.pi, np.pi))
            for lo, hi in piece.intervals():
                for u in np.linspace(lo, hi, 7)[1:-1]:
                    row = piece.q(u)
                    assert np.all(row >= chain.lower) and np.all(row <= chain.upper)
                    assert np.abs(forward(chain, row[None]) - pose).max() < bound
                    assert piece.parameter(u) == pytest.approx(row[6])
        assert s.nearest(q).value < 0.01
        assert s.best(rd.JointRange(chain)).value <= rd.JointRange(chain).value(q) + 1e-9


def test_batches_agree_with_single_poses() -> None:
    for name in ("ur5", "panda"):
        chain = load(name)
        arm = rd.closed_form(chain)
        q = draw(chain, 40, seed=3)
        poses = chain.forward(q)
        extra = (q[:, 6],) if name == "panda" else ()
        batch = arm.solve_batch(poses, *extra)
        assert batch.q.shape == (40, 8, chain.dof) and batch.valid.shape == (40, 8)
        for k, pose in enumerate(poses):
            single = arm.solve(pose, *(x[k] for x in extra))
            np.testing.assert_array_equal(batch.q[k][batch.valid[k]], single)
        near = arm.nearest(poses, q)
        assert near.valid.all() and np.abs(near.q - q).max() < 1e-5
        np.testing.assert_array_equal(near.q[5], arm.nearest(poses[5], q[5]))
    same = arm.solve_batch(poses, 0.3)
    np.testing.assert_array_equal(same.q, arm.solve_batch(poses, np.full(40, 0.3)).q)


def test_signs_and_errors() -> None:
    ur5, panda = load("ur5"), load("panda")
    arm = rd.ParallelAxesArm(ur5)
    pose = ur5.forward([0.3, -1.5, 1.2, 1.1, 0.4, 0.7])
    signs = arm.branch(arm.solve(pose, limits=False))
    assert signs.shape[1] == 3 and len({tuple(s) for s in signs}) == len(signs)
    assert arm.lengths == pytest.approx((0.425, 0.39225))
    with pytest.raises(rd.NotParallelAxesError, match="'panda' has 7 joints, 6 are needed"):
        rd.ParallelAxesArm(panda)
    with pytest.raises(rd.NotParallelAxesError, match="mrad away from parallel"):
        rd.ParallelAxesArm(rd.catalog.load("puma560"))
    with pytest.raises(rd.NotPandaClassError, match="axis 7 passes the point where axes 5 and 6 meet"):
        rd.PandaClassArm(rd.catalog.load("iiwa14"))
    with pytest.raises(ValueError, match="q7"):
        rd.PandaClassArm(panda).solve(panda.forward(np.zeros(7)), np.nan)
    far = pose + np.array([[0, 0, 0, 3.0]] + [[0] * 4] * 3)
    assert arm.solve(far).shape == (0, 6) and arm.nearest(far, np.zeros(6)) is None
    s = rd.solutions(arm, far)
    assert s.status == "unreachable" and s.proven and "mm" in s.reason
    s = rd.solutions(panda, far)
    assert s.status == "unreachable" and s.proven and "too far" in s.reason


def test_arms_pickle_and_print() -> None:
    for arm in (rd.ParallelAxesArm(load("ur5")), rd.PandaClassArm(load("panda"))):
        again = pickle.loads(pickle.dumps(arm))
        assert again.chain == arm.chain and repr(again) == repr(arm)
        assert type(arm).__name__ in repr(arm)


def test_the_solver_uses_the_forms() -> None:
    for name in FILES:
        chain = load(name)
        ik = rd.IkSolver(chain)
        q = draw(chain, 200, seed=7)
        found = ik.solve_batch(chain.forward(q))
        assert all(status == "converged" for status in found.status), name
        assert np.all(found.q >= chain.lower) and np.all(found.q <= chain.upper)
