"""Whole paths, through the Python face."""

import pickle

import numpy as np
import pytest

import redundancy as rd

DOWN = np.diag([1.0, -1.0, -1.0])


@pytest.fixture(scope="module")
def arm() -> rd.SrsArm:
    return rd.SrsArm(rd.catalog.load("pa10"))


@pytest.fixture(scope="module")
def circle() -> rd.Path:
    return rd.paths.circle([0.45, 0, 0.5], 0.12, orientation=DOWN, n=200)


def test_plan_is_a_trajectory(arm: rd.SrsArm, circle: rd.Path) -> None:
    shares: list[float] = []
    plan = rd.plan_swivel(arm, circle, progress=shares.append)
    assert isinstance(plan, rd.Trajectory)
    assert plan.status == "converged" and plan.reason == "" and plan.reconfigurations == []
    assert plan.q.shape == (200, 7) and plan.swivel.shape == (200,) and plan.branch.shape == (200, 3)
    np.testing.assert_allclose(arm.chain.forward(plan.q), circle.poses, atol=1e-12)
    assert (plan.q >= arm.chain.lower).all() and (plan.q <= arm.chain.upper).all()
    assert np.abs(np.diff(plan.q, axis=0)).max() < 0.05
    assert (np.abs(np.diff(plan.q, axis=0)) <= np.diff(plan.t)[:, None] * arm.chain.velocity_limit).all()
    assert shares == sorted(shares) and shares[-1] == 1.0
    assert plan.joint_names == arm.chain.joint_names


def test_fixed_desired_and_branch(arm: rd.SrsArm, circle: rd.Path) -> None:
    fixed = rd.plan_swivel(arm, circle, fixed=-1.5)
    np.testing.assert_allclose(fixed.swivel, -1.5, atol=1e-12)
    near = rd.plan_swivel(arm, circle, desired=-1.5, swivel_weight=1e6)
    assert np.abs(near.swivel - fixed.swivel).max() < 0.05
    kept = rd.plan_swivel(arm, circle, branch=(1, -1, 1))
    assert (kept.branch == (1, -1, 1)).all()


def test_a_path_that_cannot_be_followed_says_where_and_why(arm: rd.SrsArm, circle: rd.Path) -> None:
    poses = circle.poses
    poses[30:33, 0, 3] += 3.0
    plan = rd.plan_swivel(arm, rd.Path(poses))
    assert plan.status == "unreachable" and plan.blocked == [30, 31, 32] and len(plan) == 0
    assert plan.reason.startswith("3 of 200 points have no configuration; the first is point 30: the wrist")
    tight = rd.SrsArm(arm.chain.with_limits(lower=-0.3, upper=0.3))
    plan = rd.plan_swivel(tight, circle)
    assert plan.status == "limits" and "rad outside [-0.300000, 0.300000]" in plan.reason


def test_stopping_raises_what_stopped_it(arm: rd.SrsArm, circle: rd.Path) -> None:
    def stop(share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        rd.plan_swivel(arm, circle, progress=stop)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"swivels": 2}, "swivels is 2, it must be between 8 and 7200"),
        ({"margin": -1.0}, "margin is -1"),
        ({"desired": 0.1, "fixed": 0.2}, "not both"),
        ({"desired": [0.1, 0.2]}, "expected 200 entries, got 2"),
        ({"branch": (1, 0, 1)}, "its signs must be 1 or -1"),
        ({"velocity_limits": "robot"}, "expected one of: chain"),
        ({"velocity_limits": -np.ones(7)}, "velocity limit 0 is -1"),
        ({"motion_weight": np.nan}, "motion_weight is NaN"),
    ],
)
def test_bad_settings_are_named(arm: rd.SrsArm, circle: rd.Path, options: dict, text: str) -> None:
    with pytest.raises(rd.RedundancyError) as error:
        rd.plan_swivel(arm, circle, **options)
    assert text in str(error.value)


def test_positions_alone_are_not_enough(arm: rd.SrsArm) -> None:
    with pytest.raises(rd.RedundancyError, match="positions only"):
        rd.plan_swivel(arm, rd.paths.circle([0.45, 0, 0.5], 0.12, n=20))


def test_plans_paths_and_arms_compare_and_pickle_by_value(arm: rd.SrsArm, circle: rd.Path) -> None:
    scene = rd.Scene([rd.Sphere((0.2842, -0.3539, 0.4817), 0.06)])
    plan = rd.plan_swivel(arm, circle, scene)
    again = pickle.loads(pickle.dumps(plan))
    assert type(again) is rd.SwivelPlan and again == plan
    assert again.status is plan.status and again.reason == plan.reason
    np.testing.assert_array_equal(again.swivel, plan.swivel)
    np.testing.assert_array_equal(again.branch, plan.branch)
    np.testing.assert_array_equal(again.clearance, plan.clearance)
    np.testing.assert_array_equal(again.q, plan.q)
    rows = rd.Trajectory(plan.joint_names, plan.t, plan.q, plan.qd, plan.events)
    assert rows == pickle.loads(pickle.dumps(rows)) and rows != plan and plan != rows
    assert rows != rd.Trajectory(plan.joint_names, plan.t, plan.q + 1e-9)
    other = rd.plan_swivel(arm, circle, scene, swivel_weight=1.0, desired=-1.0)
    assert other != plan
    assert plan != 1
    # Without rows, and with reconfigurations.
    poses = circle.poses
    poses[30:33, 0, 3] += 3.0
    blocked = rd.plan_swivel(arm, rd.Path(poses))
    assert pickle.loads(pickle.dumps(blocked)) == blocked and len(blocked) == 0
    iiwa = rd.SrsArm(rd.catalog.load("iiwa14"))
    turns = rd.paths.circle([0.0, 0.0, 0.4], 0.6, turns=1.3, orientation=DOWN, n=300)
    broken = rd.plan_swivel(iiwa, turns)
    assert broken.status == "infeasible"
    assert pickle.loads(pickle.dumps(broken)).reconfigurations == broken.reconfigurations
    assert circle == pickle.loads(pickle.dumps(circle)) and circle != rd.Path(poses)
    assert rd.Path(circle.poses) != circle  # a spline through the samples is another curve
    assert arm == rd.SrsArm(rd.catalog.load("pa10")) and arm != iiwa
    assert arm == pickle.loads(pickle.dumps(arm)) and arm != "pa10"


def test_a_step_takes_what_was_before(arm: rd.SrsArm, circle: rd.Path) -> None:
    scene = rd.Scene([rd.Sphere((0.2842, -0.3539, 0.4817), 0.06)])
    flow = rd.SwivelFlow(arm, -np.pi / 2, scene)
    pose = circle.poses[10]
    q = arm.self_motion(pose).branches[0].q(-1.2)
    plain = flow.step(pose, -1.2, 0.01)
    # A rate before is followed on, not left at once.
    assert flow.step(pose, -1.2, 0.01, rate=2.0) > plain > flow.step(pose, -1.2, 0.01, rate=-2.0)
    # Joints that may hardly move hold the swivel back.
    slow = rd.SrsArm(arm.chain.with_limits(velocity=np.full(7, 1e-3)))
    held = rd.SwivelFlow(slow, 1.5)
    assert abs(held.step(pose, -1.2, 0.01, q=q) + 1.2) < 1e-3 < abs(held.step(pose, -1.2, 0.01) + 1.2)
    with pytest.raises(rd.RedundancyError, match="q: expected 7 entries"):
        flow.step(pose, -1.2, 0.01, q=[0.0])
    with pytest.raises(rd.RedundancyError, match="joints before"):
        flow.step(pose, -1.2, 0.01, q=np.full(7, np.nan))
    with pytest.raises(rd.RedundancyError, match="rate before"):
        flow.step(pose, -1.2, 0.01, rate=np.inf)
