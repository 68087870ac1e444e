"""Tilt and spin along a whole path: pinocchio, limits, what is refused.

Short time limits: how good a plan gets is measured by `benches/python/bench_painting.py` and by the full tests.
"""

import os
import pickle
import signal
import threading
from pathlib import Path as File

import numpy as np
import pinocchio as pin
import pytest
from arms import as_pinocchio, robots
from scipy.interpolate import make_interp_spline

import redundancy as rd

GOLDEN = File(__file__).parents[1] / "golden"
TWENTY = np.deg2rad(20.0)
FULL = os.environ.get("REDUNDANCY_TEST_FULL") == "1"
SECONDS = 60.0 if FULL else 2.0


def tool(name: str) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = (0.0 if name == "a" else -0.15, 0.0, 0.4)
    return pose


def reference(name: str) -> rd.Path:
    return rd.Path.from_csv(GOLDEN / f"spray_ref_{name}_path.csv")


@pytest.fixture(scope="module")
def chain() -> rd.Chain:
    return rd.catalog.load("puma560")


def short() -> rd.Path:
    """A corner of 0.4 m."""
    s = np.linspace(0.0, 1.0, 81)
    return rd.Path(np.stack([0.45 + 0.2 * s**2, -0.15 + 0.3 * s, 0 * s - 0.3], axis=1))


def check(chain: rd.Chain, plan: rd.OrientationPlan, path: rd.Path, margin: float = 0.0) -> float:
    """Everything that a plan promises, from its poses and joint positions alone; the largest use of a torque limit."""
    assert len(plan) == len(plan.s) == len(plan.poses) and np.diff(plan.s).max() <= 4.0e-4 * (1 + 1e-9)
    made = chain.forward(plan.q)
    assert np.abs(made - plan.poses).max() < 1e-11
    axis = -made[:, 2, 2]
    assert axis.min() >= np.cos(TWENTY) - 1e-12
    own = make_interp_spline(path.s, path.poses[:, :3, 3], k=5)
    assert np.abs(made[:, :3, 3] - own(plan.s)).max() < 1e-8
    curve = make_interp_spline(plan.s, plan.q, k=5)
    model = as_pinocchio(chain)
    data = model.createData()
    v, use = plan.speed, 0.0
    for k in range(0, len(plan), 1 if FULL else 11):
        d, dd = curve(plan.s[k], 1), curve(plan.s[k], 2)
        tau = pin.rnea(model, data, plan.q[k], v * d, v * v * dd)
        assert np.abs(tau - plan.torques[k]).max() < 1e-4 * np.abs(tau).max() + 1e-5
        assert np.abs(plan.qd[k] - v * d).max() < 1e-4
        use = max(use, float((np.abs(tau) / chain.effort_limit).max()))
    assert use <= (1.0 - margin) * (1 + 1e-4)
    assert np.abs(np.diff(plan.q, axis=0)).max() < 0.05  # no flip of the wrist
    exact = (np.abs(plan.torques) / chain.effort_limit).max()
    assert exact <= (1.0 - margin) * (1 + 1e-12)
    return float(exact)


@pytest.mark.parametrize(("name", "least"), [("a", 2.20), ("b", 2.60)])
def test_plans_of_the_reference_paths(chain: rd.Chain, name: str, least: float) -> None:
    arm, path = chain.with_tool(tool(name)), reference(name)
    constant = rd.max_speed(arm, path, rd.orientation_rules.constant()).speed
    plan = rd.plan_orientation(arm, path, TWENTY, joint_limits=False, time_limit=SECONDS)
    assert plan.status in ("time_limit", "converged")
    use = check(arm, plan, path)
    assert plan.limit == "torque" and use == pytest.approx(1.0, abs=1e-9)
    assert plan.constant_speed == pytest.approx(constant, rel=2e-3)
    assert plan.speed > constant
    if FULL:
        assert plan.speed >= least * constant


def test_margins_rates_and_joint_limits_hold(chain: rd.Chain) -> None:
    arm, path = chain.with_tool(tool("b")), short()
    rates = np.deg2rad([288.0, 240.0, 300.0, 400.0, 405.0, 600.0])
    plan = rd.plan_orientation(
        arm, path, TWENTY, torque_margin=0.1, velocity_limits=rates, max_rate=4.0, time_limit=SECONDS
    )
    assert plan.status in ("time_limit", "converged"), plan.reason
    check(arm, plan, path, margin=0.1)
    assert np.all(np.abs(plan.qd) <= rates * (1 + 1e-9))
    assert np.all(plan.q >= arm.lower) and np.all(plan.q <= arm.upper)
    turn = arm.jacobian(plan.q)[:, 3:] @ plan.qd[:, :, None]
    assert np.linalg.norm(turn[:, :, 0], axis=1).max() <= 4.0 * (1 + 1e-9)


def test_a_limited_spin_and_a_narrow_cone(chain: rd.Chain) -> None:
    arm, path = chain.with_tool(tool("b")), short()
    plan = rd.plan_orientation(arm, path, 0.1, spin=0.2, time_limit=SECONDS)
    assert np.abs(plan.spin).max() <= 0.2 and np.linalg.norm(plan.tilt, axis=1).max() <= 0.1
    assert plan.speed >= plan.constant_speed
    still = rd.plan_orientation(arm, path, 0.0, spin=0.0, time_limit=SECONDS)
    assert np.abs(still.spin).max() < 1e-9 and np.abs(still.tilt).max() < 1e-9
    assert still.speed == pytest.approx(plan.constant_speed, rel=1e-3)
    assert still.status == "converged" and still.reason == ""


def test_oriented_paths_carry_the_cone(chain: rd.Chain) -> None:
    arm, path = chain.with_tool(tool("a")), short()
    lean = rd.orientation_rules.tilt_disc(0.1)(path.poses[:, :3, 3])
    oriented = path.with_orientation(lean)
    plan = rd.plan_orientation(arm, oriented, 0.05, time_limit=SECONDS)
    assert len(plan) > 0, plan.reason
    wanted = oriented.pose(plan.s)[:, :3, 2]
    cosine = np.sum(wanted * plan.poses[:, :3, 2], axis=1)
    assert np.arccos(np.clip(cosine, -1, 1)).max() < 0.05 + 1e-4
    turned = rd.plan_orientation(arm, path, 0.05, orientation=lean[0], time_limit=SECONDS)
    assert np.arccos(np.clip(turned.poses[:, :3, 2] @ lean[0][:, 2], -1, 1)).max() <= 0.05 + 1e-9


def iiwa_path() -> rd.Path:
    return rd.paths.raster((0.45, -0.15, 0.25), 0.3, 0.1, 2, corner=0.08)


def test_a_seven_joint_arm() -> None:
    arm = rd.catalog.load("iiwa14")
    path = iiwa_path()
    plan = rd.plan_orientation(arm, path, TWENTY, time_limit=SECONDS)
    assert len(plan) > 0, plan.reason
    assert plan.constant_speed is not None and plan.speed > plan.constant_speed
    made = arm.forward(plan.q)
    assert np.abs(made - plan.poses).max() < 1e-11
    assert np.all(plan.q >= arm.lower) and np.all(plan.q <= arm.upper)
    model = as_pinocchio(arm)
    data = model.createData()
    curve = make_interp_spline(plan.s, plan.q, k=5)
    v = plan.speed
    for k in range(0, len(plan), 17):
        tau = pin.rnea(model, data, plan.q[k], v * curve(plan.s[k], 1), v * v * curve(plan.s[k], 2))
        assert np.all(np.abs(tau) <= arm.effort_limit * (1 + 1e-4))


def test_a_six_joint_arm_from_a_urdf_without_spherical_wrist() -> None:
    robot = robots()["ur5"]
    arm = rd.Chain.from_urdf(robot.path, robot.base, robot.tip)
    with pytest.raises(rd.RedundancyError):
        rd.SphericalWristArm(arm)
    path = rd.paths.raster((0.35, -0.1, 0.1), 0.2, 0.08, 2, corner=0.06)
    plan = rd.plan_orientation(arm, path, TWENTY, time_limit=2 * SECONDS)
    assert len(plan) > 0, plan.reason
    assert plan.constant_speed is not None and plan.speed >= plan.constant_speed
    assert np.abs(arm.forward(plan.q) - plan.poses).max() < 1e-11


def test_progress_pickle_and_repr(chain: rd.Chain) -> None:
    seen: list[tuple[float, float]] = []
    arm = chain.with_tool(tool("b"))
    plan = rd.plan_orientation(
        arm, short(), TWENTY, time_limit=1.0, threads=1, progress=lambda share, v: seen.append((share, v))
    )
    assert seen and all(0.0 <= share <= 1.0 for share, _ in seen)
    again = pickle.loads(pickle.dumps(plan))
    assert again.speed == plan.speed and np.array_equal(again.q, plan.q) and again.status == plan.status
    assert repr(plan).startswith("OrientationPlan(") and repr(again) == repr(plan)

    def fails(share: float, speed: float) -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        rd.plan_orientation(arm, short(), TWENTY, time_limit=5.0, progress=fails)


@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="needs POSIX signals")
def test_ctrl_c_returns_the_best_so_far(chain: rd.Chain) -> None:
    main = threading.main_thread().ident
    assert main is not None
    found = threading.Event()

    def stop(share: float, speed: float) -> None:
        if speed > 0.0 and not found.is_set():
            found.set()
            signal.pthread_kill(main, signal.SIGINT)

    arm = chain.with_tool(tool("b"))
    plan = rd.plan_orientation(
        arm, reference("b"), TWENTY, joint_limits=False, time_limit=300.0, progress=stop
    )
    assert plan.status == "cancelled" and "best plan so far" in plan.reason
    assert plan.speed > 0.0 and len(plan) > 0


def test_what_cannot_be(chain: rd.Chain) -> None:
    arm = chain.with_tool(tool("a"))
    path = short()
    positions = path.poses[:, :3, 3]
    positions[20:23, 0] += 3.0
    far = rd.plan_orientation(arm, rd.Path(positions), TWENTY, time_limit=SECONDS)
    assert (
        far.status == "unreachable" and {20, 21, 22} <= set(far.blocked) and len(far) == 0 and far.speed == 0
    )
    assert "points are out of the workspace" in far.reason
    weak = rd.plan_orientation(
        arm, path, TWENTY, torque_limits=[97.6, 5.0, 89.4, 24.2, 20.1, 21.3], time_limit=1.0
    )
    assert weak.status == "infeasible" and "'joint2' needs" in weak.reason and "at point" in weak.reason
    locked = arm.with_limits(lower=arm.lower * 0 - 0.01, upper=arm.lower * 0 + 0.01)
    held = rd.plan_orientation(locked, path, TWENTY, time_limit=1.0)
    assert held.status == "infeasible" and "joint limits" in held.reason


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"half_angle": -0.1}, "half_angle is -0.1"),
        ({"half_angle": 1.6}, "half_angle is 1.6"),
        ({"half_angle": np.nan}, "half_angle is NaN"),
        ({"spin": -1.0}, "spin is -1"),
        ({"spin": "round"}, "unknown spin 'round'"),
        ({"torque_margin": 1.0}, "torque_margin is 1"),
        ({"max_rate": 0.0}, "max_rate is 0"),
        ({"time_limit": 0.0}, "time_limit is 0"),
        ({"torque_limits": None}, "no torque or velocity limit"),
        ({"torque_limits": [1.0]}, "expected 6 entries, got 1"),
        ({"threads": 0}, "threads is 0"),
    ],
)
def test_what_is_wrong_is_named(chain: rd.Chain, change: dict[str, object], message: str) -> None:
    arguments = {"half_angle": 0.3, "time_limit": 1.0} | change
    with pytest.raises(rd.RedundancyError, match=message):
        rd.plan_orientation(chain.with_tool(tool("a")), short(), **arguments)  # type: ignore[arg-type]


def test_arms_that_cannot_be_planned() -> None:
    with pytest.raises(rd.RedundancyError, match="'pa10' has no inertias"):
        rd.plan_orientation(rd.catalog.load("pa10"), short(), 0.3, torque_limits=[9.0] * 7)
    planar = rd.catalog.load("planar3r")
    with pytest.raises(rd.RedundancyError, match="has 3 joints"):
        rd.plan_orientation(planar, short(), 0.3, torque_limits=None, velocity_limits=[1.0] * 3)
    with pytest.raises(rd.RedundancyError, match="no length"):
        still = rd.Path(np.full((3, 3), 0.4), s=[0.0, 0.0, 0.0])
        rd.plan_orientation(rd.catalog.load("puma560"), still, 0.3)
