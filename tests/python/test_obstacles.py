"""Whole paths beside obstacles: planner, flow, messages."""

import pickle

import numpy as np
import pytest

import redundancy as rd

DOWN = np.diag([-1.0, 1.0, -1.0])
BALL = rd.Sphere((0.2842, -0.3539, 0.4817), 0.06)


@pytest.fixture(scope="module")
def arm() -> rd.SrsArm:
    return rd.SrsArm(rd.catalog.load("pa10"))


def lap(n: int = 121) -> rd.Path:
    path = rd.paths.circle((0.45, 0.0, 0.5), 0.12, orientation=DOWN, n=n)
    return path.with_times(np.linspace(0.0, 6.0, n))


def test_plan_keeps_off_the_ball(arm: rd.SrsArm) -> None:
    path, scene = lap(), rd.Scene([BALL])
    free = rd.plan_swivel(arm, path, desired=-np.pi / 2)
    assert free.clearance is None
    assert scene.clearance(arm.chain, free.q).distance.min() < 0
    plan = rd.plan_swivel(arm, path, scene, desired=-np.pi / 2, wanted_clearance=0.03)
    assert plan.status == "converged"
    assert len(plan) == len(path)
    assert plan.clearance is not None
    assert plan.clearance.min() >= 0.029
    np.testing.assert_allclose(plan.clearance, scene.clearance(arm.chain, plan.q).distance, atol=1e-12)
    np.testing.assert_allclose(arm.chain.forward(plan.q), path.poses, atol=1e-11)
    assert (plan.q >= arm.chain.lower).all() and (plan.q <= arm.chain.upper).all()


def test_a_closed_path_ends_as_it_began(arm: rd.SrsArm) -> None:
    plan = rd.plan_swivel(arm, lap(), rd.Scene([BALL]), cyclic=True)
    assert plan.status == "converged"
    np.testing.assert_array_equal(plan.q[0], plan.q[-1])
    poses = lap().poses.copy()
    poses[-1, 0, 3] += 0.01
    with pytest.raises(rd.RedundancyError, match=r"ends are 1\.000e-2 m"):
        rd.plan_swivel(arm, rd.Path(poses), cyclic=True)


def test_an_obstacle_over_the_tool_path_is_named(arm: rd.SrsArm) -> None:
    scene = rd.Scene([rd.Capsule((1, 1, 1), (1, 1, 2), 0.1), rd.Sphere((0.45, 0.12, 0.5), 0.05)])
    plan = rd.plan_swivel(arm, lap(), scene)
    assert plan.status == "collision" and not plan.legal
    assert len(plan) == 0
    assert plan.blocked
    assert f"the first is point {plan.blocked[0]}" in plan.reason
    assert "mm deep in obstacle 1 (sphere)" in plan.reason


def test_flow_follows_and_steps(arm: rd.SrsArm) -> None:
    path, scene = lap(601), rd.Scene([BALL])
    paper = rd.SwivelFlow(arm, -np.pi / 2, scene, form="paper").follow(path, -0.9, 0.01)
    assert paper.clearance is not None
    assert 0.035 < paper.clearance.min() < 0.05
    robust = rd.SwivelFlow(arm, lambda t: -np.pi / 2, scene)
    plan = robust.follow(path, -0.9, 0.01)
    assert plan.clearance is not None
    assert plan.clearance.min() >= 0.02 - 1e-9
    assert len(plan) == 601
    assert np.abs(np.diff(plan.swivel)).max() <= 0.03 + 1e-12
    again = rd.SwivelFlow(arm, np.full(601, -np.pi / 2), scene).follow(path, -0.9, 0.01)
    np.testing.assert_allclose(again.swivel, plan.swivel, atol=1e-12)
    # A step knows the swivel before; only `follow` knows the joints before too, and bounds their speed.
    assert abs(robust.step(path.poses[1], -0.9, 0.01, 0.01) + 0.9) <= 0.03 + 1e-12
    stateless = rd.SwivelFlow(arm, -np.pi / 2, scene, form="paper")
    assert stateless.step(path.poses[1], -0.9, 0.01, 0.01) == pytest.approx(paper.swivel[1])
    assert "robust" in repr(robust)
    fixed = pickle.loads(pickle.dumps(rd.SwivelFlow(arm, 0.3, scene, max_rate=2.0)))
    assert (fixed.scene, fixed.form) == (scene, "robust")
    inside = rd.SwivelFlow(arm, -np.pi / 2, scene, form="paper").follow(path, -np.pi / 2, 0.01)
    assert inside.status == "infeasible"
    assert "starts 62.4" in inside.reason


def test_bad_input_is_named(arm: rd.SrsArm) -> None:
    scene = rd.Scene([BALL])
    with pytest.raises(rd.RedundancyError, match="paper, paper_u, robust"):
        rd.SwivelFlow(arm, 0.0, scene, form="fast")
    with pytest.raises(rd.RedundancyError, match="tau is -1"):
        rd.SwivelFlow(arm, 0.0, scene, tau=-1.0)
    flow = rd.SwivelFlow(arm, 0.0, scene)
    with pytest.raises(rd.RedundancyError, match="dt is 0"):
        flow.step(lap().poses[0], 0.0, 0.0)
    with pytest.raises(rd.RedundancyError, match="no times"):
        flow.follow(rd.Path(lap().poses), 0.0, 0.01)
    with pytest.raises(rd.RedundancyError, match="too far"):
        far = np.eye(4)
        far[0, 3] = 9.0
        flow.step(far, 0.0, 0.01)
    with pytest.raises(rd.RedundancyError, match="wanted_clearance"):
        rd.plan_swivel(arm, lap(), scene, wanted_clearance=-1.0)
    with pytest.raises(rd.RedundancyError, match="at least two samples"):
        rd.plan_swivel(arm, rd.Path(lap().poses[:1]), scene)
