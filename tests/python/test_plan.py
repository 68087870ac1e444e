"""`Plan`: what every planner and every step-by-step scheme returns."""

import pickle
from pathlib import Path as File

import numpy as np
import pytest

import redundancy as rd

DOWN = np.diag([1.0, -1.0, -1.0])


@pytest.fixture(scope="module")
def arm() -> rd.SrsArm:
    return rd.SrsArm(rd.catalog.load("pa10"))


@pytest.fixture(scope="module")
def circle() -> rd.Path:
    path = rd.paths.circle([0.45, 0, 0.5], 0.12, orientation=DOWN, n=120)
    return path.with_times(np.linspace(0.0, 6.0, len(path)))


@pytest.fixture(scope="module")
def swivels(arm: rd.SrsArm, circle: rd.Path) -> rd.SwivelPlan:
    scene = rd.Scene([rd.Sphere([0.2842, -0.3539, 0.4817], 0.06)])
    return rd.plan_swivel(arm, circle, scene, desired=-1.57)


def margin(chain: rd.Chain, q: np.ndarray) -> np.ndarray:
    return np.minimum(q - chain.lower, chain.upper - q).min(axis=1)


def test_the_swivel_is_a_spare_coordinate(arm: rd.SrsArm, circle: rd.Path, swivels: rd.SwivelPlan) -> None:
    assert isinstance(swivels, rd.Plan) and isinstance(swivels, rd.Trajectory)
    assert swivels.status == "converged" and swivels.legal is True and swivels.proven
    assert swivels.cost is not None and swivels.cost > 0.0
    np.testing.assert_array_equal(swivels.spare["swivel"], swivels.swivel)
    np.testing.assert_array_equal(swivels.s, circle.s)
    np.testing.assert_allclose(swivels.poses, arm.chain.forward(swivels.q), atol=1e-12)
    np.testing.assert_allclose(swivels.margin, margin(arm.chain, swivels.q), atol=1e-15)
    assert swivels.piece is not None
    words = [swivels.piece_labels[piece] for piece in swivels.piece]
    signs = ["".join("+" if sign > 0 else "-" for sign in row) for row in swivels.branch]
    assert words == signs
    assert swivels.tilt is None and swivels.spin is None and swivels.self_clearance is None


def test_npz_and_pickles_keep_everything(tmp_path: File, arm: rd.SrsArm, swivels: rd.SwivelPlan) -> None:
    turns = rd.paths.circle([0.0, 0.0, 0.4], 0.6, turns=1.3, orientation=DOWN, n=200)
    broken = rd.plan_swivel(rd.SrsArm(rd.catalog.load("iiwa14")), turns)
    assert broken.status == "infeasible" and broken.legal is False and not broken.proven
    assert len(broken.reconfigurations) == len(broken.reconfiguration_reasons) > 0
    poses = turns.poses
    poses[30:33, 0, 3] += 3.0
    blocked = rd.plan_swivel(arm, rd.Path(poses[:60]))
    assert blocked.blocked == [30, 31, 32] and all("wrist" in why for why in blocked.blocked_reasons)
    for plan in (swivels, broken, blocked):
        plan.to_npz(tmp_path / "plan.npz")
        again = rd.Plan.from_npz(tmp_path / "plan.npz")
        assert type(again) is rd.Plan and again.piece_labels == plan.piece_labels
        assert again == plan and again.reason == plan.reason and again.events == plan.events
        assert pickle.loads(pickle.dumps(again)) == again == pickle.loads(pickle.dumps(plan))
        assert len(rd.Trajectory.from_npz(tmp_path / "plan.npz")) == len(plan)
    rd.Trajectory(["a"], [0.0], [[0.0]]).to_npz(tmp_path / "rows.npz")
    with pytest.raises(rd.FileFormatError, match=r"rows\.npz"):
        rd.Plan.from_npz(tmp_path / "rows.npz")


def test_tilt_and_spin_come_back(tmp_path: File) -> None:
    arm = rd.catalog.load("puma560")
    tool = np.eye(4)
    tool[2, 3] = 0.4
    angles = np.linspace(0.0, 1.0, 30)
    arc = np.stack([0.5 + 0.1 * np.cos(angles), 0.1 * np.sin(angles), -0.3 + 0.0 * angles], axis=1)
    plan = rd.plan_orientation(arm.with_tool(tool), rd.Path(arc), 0.2, time_limit=0.5)
    assert plan.legal is True and plan.tilt.shape == (len(plan), 2) and plan.spin.shape == (len(plan),)
    assert (np.linalg.norm(plan.tilt, axis=1) <= 0.2 + 1e-12).all()
    np.testing.assert_allclose(plan.margin, margin(arm, plan.q), atol=1e-15)
    plan.to_npz(tmp_path / "plan.npz")
    again = rd.Plan.from_npz(tmp_path / "plan.npz")
    assert again == plan
    np.testing.assert_array_equal(again.tilt, plan.tilt)
    np.testing.assert_array_equal(again.spin, plan.spin)
    assert repr(pickle.loads(pickle.dumps(plan))) == repr(plan)


def test_a_closed_loop_that_leaves_its_path_says_so(
    arm: rd.SrsArm, circle: rd.Path, swivels: rd.SwivelPlan
) -> None:
    chain = arm.chain
    scheme = rd.SaturatedNullspace(chain, rd.JointRange(chain), 1.0)
    run = rd.track(chain, scheme, circle, swivels.q[0], 0.01, 20.0)
    assert run.status == "converged" and run.legal and run.reason == ""
    error = np.linalg.norm(run.poses[:, :3, 3] - circle.pose(run.s)[:, :3, 3], axis=1)
    assert run.position_error == pytest.approx(error.max(), rel=1e-9)
    strict = rd.track(
        chain, scheme, circle, swivels.q[0], 0.01, 20.0, tolerance=(run.position_error / 2, 1.0)
    )
    assert strict.status == "off_path" and strict.legal is False
    assert f"m at row {error.argmax()} (t = " in strict.reason
    assert pickle.loads(pickle.dumps(strict)) == strict
    # Half of the speed that the path needs.
    slow = chain.with_limits(velocity=0.5 * np.abs(run.qd).max(axis=0))
    free = rd.ProjectedGradient(slow, rd.JointRange(slow), 1.0)
    fast = rd.track(slow, free, circle, swivels.q[0], 0.01, 20.0)
    assert fast.status == "limits" and "times its limit of" in fast.reason
    with pytest.raises(rd.RedundancyError, match="position_tolerance is 0"):
        rd.track(chain, scheme, circle, swivels.q[0], 0.01, 20.0, tolerance=(0.0, 1.0))


def test_a_followed_optimum_that_leaves_the_limits_is_not_converged(circle: rd.Path) -> None:
    chain = rd.catalog.load("pa10")
    ranked = rd.rank_starts(chain, circle, rd.JointRange(chain), seed=1, starts=16)
    words = set()
    for start in ranked:
        plan = start.trajectory
        words.add(str(plan.status))
        outside = (margin(chain, plan.q) < -1e-12).any()
        assert (plan.status == "converged") <= (plan.completed and not outside)
        assert plan.completed or plan.status == "singular"
        assert plan.legal is not True or not outside
        assert plan.status == "converged" or plan.reason
    assert len(words) > 1, words


def test_time_limits_return_what_there_is(arm: rd.SrsArm, circle: rd.Path, swivels: rd.SwivelPlan) -> None:
    plan = rd.plan_swivel(arm, circle, time_limit=0.0)
    assert plan.status == "time_limit" and len(plan) == 0 and plan.reason == "the time limit of 0 s was met"
    flow = rd.SwivelFlow(arm, -1.57)
    assert flow.follow(circle, -1.57, 0.01, time_limit=0.0).status == "time_limit"
    scheme = rd.SaturatedNullspace(arm.chain, rd.JointRange(arm.chain), 1.0)
    run = rd.track(arm.chain, scheme, circle, swivels.q[0], 0.01, 20.0, time_limit=0.0)
    assert run.status == "time_limit" and len(run) == 0
    with pytest.raises(rd.RedundancyError, match="time_limit is -1"):
        rd.plan_swivel(arm, circle, time_limit=-1.0)
