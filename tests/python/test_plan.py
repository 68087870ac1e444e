"""Whole paths with any freedom, through the Python face and beside pinocchio."""

import pickle
from pathlib import Path as File

import numpy as np
import pinocchio as pin
import pytest
from arms import as_pinocchio

import redundancy as rd

CASES = File(__file__).parents[1] / "golden" / "plan_cases"
DOWN = np.diag([1.0, -1.0, -1.0])


@pytest.fixture(scope="module")
def panda() -> rd.Chain:
    return rd.Chain.from_urdf(CASES / "panda.urdf", "panda_link0", "panda_link8")


@pytest.fixture(scope="module")
def circle() -> rd.Path:
    return rd.paths.circle([0.5, 0, 0.4], 0.1, orientation=DOWN, n=80)


@pytest.fixture(scope="module")
def plan(panda: rd.Chain, circle: rd.Path) -> rd.Plan:
    return rd.plan(panda, circle)


def tool_poses(chain: rd.Chain, q: np.ndarray) -> np.ndarray:
    """Forward kinematics of pinocchio."""
    model = as_pinocchio(chain)
    data, frame = model.createData(), model.getFrameId("tool")
    out = []
    for row in q:
        pin.framesForwardKinematics(model, data, row)
        out.append(data.oMf[frame].homogeneous.copy())
    return np.array(out)


def test_a_plan_is_a_trajectory_with_its_verdict(panda: rd.Chain, circle: rd.Path, plan: rd.Plan) -> None:
    assert isinstance(plan, rd.Trajectory) and len(plan) == len(circle)
    assert plan.status == "converged" and plan.legal and plan.reason == "" and not plan.proven
    assert plan.blocked == [] and plan.reconfigurations == [] and plan.clearance is None
    np.testing.assert_allclose(tool_poses(panda, plan.q), circle.poses, atol=1e-9)
    assert plan.tilt is not None and plan.tilt.shape == (80, 2) and np.abs(plan.tilt).max() < 1e-8
    assert plan.spin is not None and np.abs(plan.spin).max() < 1e-8
    room = np.minimum(plan.q - panda.lower, panda.upper - plan.q).min(axis=1)
    np.testing.assert_allclose(plan.margin, room, atol=1e-15)
    assert plan.cost is not None and plan.cost > 0


def test_the_cost_is_the_documented_one(panda: rd.Chain, circle: rd.Path, plan: rd.Plan) -> None:
    share = np.diff(circle.s) / circle.length
    at_rows = 0.5 * (np.r_[0.0, share] + np.r_[share, 0.0])
    x = (2 * plan.q - panda.lower - panda.upper) / (panda.upper - panda.lower)
    limits = ((x**2 / (1 - x**2)) ** 2).sum(axis=1)
    motion = (np.diff(plan.q, axis=0) ** 2).sum(axis=1) / share
    assert plan.cost == pytest.approx((at_rows * limits).sum() + 0.5 * motion.sum(), rel=1e-12)


def test_it_pickles_and_travels_through_files(plan: rd.Plan, tmp_path: File) -> None:
    assert pickle.loads(pickle.dumps(plan)) == plan
    plan.to_npz(tmp_path / "plan.npz")
    again = rd.Plan.from_npz(tmp_path / "plan.npz")
    assert again == plan and again.status == plan.status
    assert rd.Trajectory.from_npz(tmp_path / "plan.npz") is not None
    with pytest.raises(rd.RedundancyError):
        rd.Plan.from_npz(tmp_path / "none.npz")


def test_a_free_spin_and_a_cone_are_used_and_kept() -> None:
    gun = rd.Chain.from_urdf(CASES / "irb2400.urdf", "base_link", "gun")
    path = rd.Path.from_csv(CASES / "irb2400_raster_cone.csv")
    path = rd.Path(path.poses[::10])
    costs = []
    for half_angle, spin in ((0.0, 0.0), (0.0, "free"), (0.2, 0.5), (0.2, "free")):
        plan = rd.plan(gun, path, rd.ToolFreedom(half_angle, spin), limit_weight=0.0)
        assert plan.status == "converged", plan.reason
        poses = tool_poses(gun, plan.q)
        np.testing.assert_allclose(poses[:, :3, 3], path.poses[:, :3, 3], atol=1e-9)
        tool, wanted = poses[:, :3, 2], path.poses[:, :3, 2]
        across = np.linalg.norm(np.cross(tool, wanted), axis=1)
        tilt = np.arctan2(across, np.einsum("ni,ni->n", tool, wanted))
        assert tilt.max() <= half_angle + 1e-8
        np.testing.assert_allclose(np.linalg.norm(plan.tilt, axis=1), tilt, atol=1e-7)
        if spin != "free":
            assert np.abs(plan.spin).max() <= float(spin) + 1e-8
        costs.append(plan.cost)
    assert costs[3] <= costs[1] <= costs[0] and costs[3] <= costs[2] <= costs[0]


def test_a_criterion_and_weights_pull(panda: rd.Chain, circle: rd.Path) -> None:
    posture = rd.Posture(panda, [0.3, 0.5, -0.2, -2.0, 0.2, 2.5, 0.8])
    plain = rd.plan(panda, circle, limit_weight=0.0)
    pulled = rd.plan(panda, circle, limit_weight=0.0, criterion=posture, criterion_weight=100.0)
    assert posture.value(pulled.q).mean() < posture.value(plain.q).mean()
    heavy = rd.plan(panda, circle, limit_weight=0.0, joint_weights=[10, 1, 1, 1, 1, 1, 1])
    assert np.ptp(heavy.q[:, 0]) < np.ptp(plain.q[:, 0]) + 1e-9


def test_speed_limits_bind_with_a_tool_speed(panda: rd.Chain, circle: rd.Path) -> None:
    limits = np.full(7, 0.35)
    plan = rd.plan(panda, circle, tool_speed=0.1, velocity_limits=limits)
    assert plan.status == "converged", plan.reason
    assert plan.t[-1] == pytest.approx(circle.length / 0.1)
    assert (np.abs(np.diff(plan.q, axis=0)) <= limits * np.diff(plan.t)[:, None] + 1e-9).all()
    peak = rd.plan(panda, circle, tool_speed=0.1, objective="peak_speed", limit_weight=0.0)
    free = rd.plan(panda, circle, tool_speed=0.1, limit_weight=0.0)

    def largest(plan: rd.Plan) -> float:
        steps = np.abs(np.diff(plan.q, axis=0)) / np.diff(plan.t)[:, None]
        return float((steps / panda.velocity_limit).max())

    assert largest(peak) <= largest(free) + 1e-9


def test_what_is_refused(panda: rd.Chain, circle: rd.Path) -> None:
    with pytest.raises(rd.RedundancyError, match="half_angle"):
        rd.ToolFreedom(half_angle=np.pi / 2)
    with pytest.raises(rd.RedundancyError, match="spin"):
        rd.ToolFreedom(spin=-0.1)
    with pytest.raises(rd.RedundancyError, match="free"):
        rd.ToolFreedom(spin="loose")  # type: ignore[arg-type]
    with pytest.raises(rd.RedundancyError, match="expected a Chain"):
        rd.plan(3, circle)  # type: ignore[arg-type]
    with pytest.raises(rd.RedundancyError, match="objective"):
        rd.plan(panda, circle, objective="energy")
    with pytest.raises(rd.RedundancyError, match="q_start"):
        rd.plan(panda, circle, q_start=np.zeros(7))
    freedom = rd.ToolFreedom(0.1, "free", axis=(0, 0, 2))
    assert freedom == pickle.loads(pickle.dumps(freedom)) and freedom.axis == [0.0, 0.0, 1.0]


def test_progress_and_stopping(panda: rd.Chain, circle: rd.Path) -> None:
    shares: list[float] = []
    rd.plan(panda, circle, progress=shares.append)
    assert shares == sorted(shares)

    def stop(share: float) -> None:
        raise ValueError("enough")

    with pytest.raises(ValueError, match="enough"):
        rd.plan(panda, circle, progress=stop)
    late = rd.plan(panda, circle, time_limit=0.0)
    assert late.status == "time_limit" and "time limit" in late.reason


def test_arm_objects_and_positions(circle: rd.Path) -> None:
    arm = rd.SrsArm(rd.catalog.load("iiwa14"))
    circle = rd.paths.circle([0.6, 0, 0.4], 0.1, orientation=DOWN, n=40)
    assert rd.plan(arm, circle).status == "converged"
    planar = rd.catalog.load("planar4r")
    ring = rd.paths.circle((5.0, 1.0, 0.0), 1.0, n=50)
    plan = rd.plan(planar, ring, task="planar")
    assert plan.status == "converged" and plan.spin is None
    np.testing.assert_allclose(planar.forward(plan.q)[:, :2, 3], ring.poses[:, :2, 3], atol=1e-9)
