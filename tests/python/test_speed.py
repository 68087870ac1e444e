"""Orientation rules and the fastest motion over a path: the paper's experiment, pinocchio, toppra, what is refused."""

import copy
import pickle
from pathlib import Path as File

import numpy as np
import pinocchio as pin
import pytest
from arms import as_pinocchio
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import redundancy as rd
from redundancy import plot_painting

GOLDEN = File(__file__).parents[1] / "golden"
RULES = rd.orientation_rules
TEN, TWENTY, SIXTY = np.deg2rad([10.0, 20.0, 60.0])
# Independently computed speeds, relative to a constant orientation at 0.910 m/s: REF-A, REF-B.
RATIOS = {
    "pointing": (RULES.pointing(), (1.000, 1.170)),
    "tilt_square": (RULES.tilt_square(angle=TEN, spin="pointing"), (1.201, 1.464)),
    "tilt_disc": (RULES.tilt_disc(angle=TEN, spin="pointing"), (1.134, 1.395)),
    "barrier_cone": (RULES.barrier_cone(), (1.239, 1.275)),
    "barrier_two_cones": (RULES.barrier_two_cones(beta=TWENTY, alpha=TWENTY, gamma=SIXTY), (1.236, 1.485)),
    "barrier_spin": (RULES.barrier_spin(), (1.239, 1.476)),
}


def tool(name: str) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = (0.0 if name == "a" else -0.15, 0.0, 0.4)
    return pose


def reference(name: str) -> rd.Path:
    return rd.Path.from_csv(GOLDEN / f"spray_ref_{name}_path.csv")


@pytest.fixture(scope="module")
def chain() -> rd.Chain:
    return rd.catalog.load("puma560")


@pytest.mark.parametrize("name", ["a", "b"])
def test_every_rule_gains_the_expected_speed(chain: rd.Chain, name: str) -> None:
    path = reference(name)
    constant = rd.max_speed(chain, path, RULES.constant(), tool=tool(name))
    assert constant.speed == pytest.approx(0.910, rel=5e-3)
    for rule, expected in RATIOS.values():
        faster = rd.max_speed(chain, path, rule, tool=tool(name))
        assert faster.speed / constant.speed == pytest.approx(expected["ab".index(name)], rel=5e-3), rule


def test_the_branch_is_the_one_asked_for(chain: rd.Chain) -> None:
    path, rule = reference("b"), RULES.barrier_spin()
    free = rd.max_speed(chain, path, rule, tool=tool("b"))
    same = rd.max_speed(chain, path, rule, q0=free.q[0], tool=tool("b"))
    assert same.speed == pytest.approx(free.speed, rel=1e-8)
    assert np.all(free.q >= chain.lower) and np.all(free.q <= chain.upper)
    poses = chain.with_tool(tool("b")).forward(free.q)
    positions = path.poses[:, :3, 3]
    assert np.abs(poses[:, :3, 3] - positions).max() < 1e-12
    assert np.abs(poses[:, :3, :3] - rule(positions)).max() < 1e-12


def test_torques_are_pinocchios(chain: rd.Chain) -> None:
    path = reference("b")
    fastest = rd.max_speed(chain, path, RULES.pointing(), tool=tool("b"))
    spline = CubicSpline(path.s, fastest.q)
    model = as_pinocchio(chain)
    data = model.createData()
    v = fastest.speed
    for k in range(0, len(path), 7):
        q, d, dd = fastest.q[k], spline(path.s[k], 1), spline(path.s[k], 2)
        tau = pin.rnea(model, data, q, v * d, v * v * dd)
        assert np.abs(fastest.torques[k] - tau).max() < 1e-8
    use = np.abs(fastest.torques) / chain.effort_limit
    assert np.unravel_index(use.argmax(), use.shape) == (fastest.at, fastest.limiting_joint)
    assert use.max() == pytest.approx(1.0, abs=1e-12)
    assert fastest.limiting_joint_name == chain.joint_names[fastest.limiting_joint]


def test_rules_are_what_the_papers_say() -> None:
    positions = reference("b").poses[:, :3, 3]
    x0 = (positions[:, 0].min() + positions[:, 0].max()) / 2
    down = Rotation.from_euler("y", np.pi)
    phi = np.arctan2(positions[:, 1], positions[:, 0])
    pointing = Rotation.from_euler("z", phi[:, None]) * down
    assert np.abs(RULES.pointing()(positions) - pointing.as_matrix()).max() < 1e-14
    half = np.abs(positions[:, 0] - x0).max(), np.abs(positions[:, 1]).max()
    ex, ey = TEN * (positions[:, 0] - x0) / half[0], TEN * positions[:, 1] / half[1]
    lean = Rotation.from_euler("x", ey[:, None]) * Rotation.from_euler("y", -ex[:, None])
    square = RULES.tilt_square(TEN)(positions)
    assert np.abs(square - (lean * pointing).as_matrix()).max() < 1e-14
    # Barriers stay inside of their cones; the tool's x keeps within gamma of the base's direction.
    axis = RULES.barrier_cone()(positions)[:, :, 2]
    assert np.all(-axis[:, 2] > np.cos(TWENTY))
    turned = RULES.barrier_two_cones()(positions)
    side = -np.stack([np.cos(phi), np.sin(phi), 0 * phi], axis=1)
    assert np.all((turned[:, :, 0] * side).sum(axis=1) > np.cos(SIXTY))
    assert np.abs(RULES.barrier_spin()(positions)[:, :, 2] - axis).max() < 1e-14


@pytest.mark.parametrize("rule", [RULES.constant(), *(rule for rule, _ in RATIOS.values())], ids=repr)
def test_rules_are_causal_with_a_surface_and_pickle(rule: rd.OrientationRule) -> None:
    positions = reference("a").poses[:, :3, 3]
    assert pickle.loads(pickle.dumps(rule)) == rule == copy.deepcopy(rule)
    again = pickle.loads(pickle.dumps(rule))(positions)
    assert np.array_equal(again, rule(positions))
    assert np.abs(again @ np.swapaxes(again, 1, 2) - np.eye(3)).max() < 1e-14


def test_one_position_at_a_time() -> None:
    positions = reference("a").poses[:, :3, 3]
    rule = RULES.tilt_disc(TEN, center=(0.55, 0.0), radius=0.32)
    assert np.array_equal(rule(positions)[17], rule(positions[17]))


def test_a_rule_of_ones_own(chain: rd.Chain) -> None:
    path = reference("a")
    own = rd.max_speed(chain, path, lambda p: np.tile(np.diag([-1.0, 1, -1]), (len(p), 1, 1)), tool=tool("a"))
    assert own.speed == rd.max_speed(chain, path, RULES.constant(), tool=tool("a")).speed
    with pytest.raises(rd.RedundancyError, match="result of orientation_rule"):
        rd.max_speed(chain, path, lambda p: np.zeros((5, 3, 3)), tool=tool("a"))


def test_profile_agrees_with_toppra(chain: rd.Chain) -> None:
    toppra = pytest.importorskip("toppra")
    path = reference("a")
    q = rd.max_speed(chain, path, RULES.barrier_spin(), tool=tool("a")).q
    profile = rd.fastest_profile(chain, path, q)
    limits = np.stack([-chain.effort_limit, chain.effort_limit], axis=1)
    torque = toppra.constraint.JointTorqueConstraint(
        chain.inverse_dynamics, limits, np.zeros(6), toppra.constraint.DiscretizationType.Collocation
    )
    curve = toppra.SplineInterpolator(path.s, q)
    instance = toppra.algorithm.TOPPRA([torque], curve, gridpoints=np.array(path.s), solver_wrapper="seidel")
    _, speed, _ = instance.compute_parameterization(0.0, 0.0)
    assert speed is not None
    theirs = 2 * np.sum(np.diff(path.s) / (speed[1:] + speed[:-1]))
    assert profile.duration == pytest.approx(theirs, rel=2e-3)
    assert np.abs(profile.speed - speed).max() < 0.02 * speed.max()
    # The torques of the profile, from its own speeds and accelerations.
    curve = CubicSpline(path.s, q)
    d, dd = curve(path.s, 1), curve(path.s, 2)
    v, a = profile.speed[:, None], profile.acceleration[:, None]
    tau = chain.inverse_dynamics(q, v * d, v * v * dd + a * d)[:-1]
    assert np.all(np.abs(tau) <= chain.effort_limit * (1 + 1e-6))
    assert pickle.loads(pickle.dumps(profile)).duration == profile.duration


def test_what_is_wrong_is_named(chain: rd.Chain) -> None:
    path, arm = reference("a"), chain.with_tool(tool("a"))
    found = rd.max_speed(arm, path, RULES.constant())
    assert pickle.loads(pickle.dumps(found)).speed == found.speed
    with pytest.raises(rd.RedundancyError, match=r"'joint2' needs .* at point .* limit is 20"):
        rd.max_speed(chain, path, q=found.q, torque_limits=[97.6, 20.0, 89.4, 24.2, 20.1, 21.3])
    with pytest.raises(rd.RedundancyError, match="out of the workspace, indices 0 to 893"):
        rd.max_speed(arm, rd.Path(path.poses[:, :3, 3] + [9.0, 0, 0]), RULES.constant())
    with pytest.raises(rd.RedundancyError, match="positions only"):
        rd.max_speed(arm, path)
    with pytest.raises(rd.RedundancyError, match="no torque or velocity limit"):
        rd.max_speed(arm, path, RULES.constant(), torque_limits=None)
    with pytest.raises(rd.RedundancyError, match="expected 894 entries, got 3"):
        rd.max_speed(arm, path, q=np.zeros((3, 6)))
    with pytest.raises(rd.RedundancyError, match="angle is 2, it must be in"):
        RULES.tilt_disc(2.0)
    with pytest.raises(rd.RedundancyError, match="tilt_square, tilt_disc"):
        rd.OrientationRule("spiral")
    with pytest.raises(rd.RedundancyError, match="cones of the rule miss each other"):
        RULES.barrier_cone(0.01, 0.01)(path.poses[:, :3, 3])


def test_torques_at_a_given_speed() -> None:
    gun = np.eye(4)
    gun[:3, 3] = (-0.15, 0.0, 0.4)
    arm = rd.catalog.load("puma560").with_tool(gun)
    path = rd.paths.raster((0.44, -0.25, -0.3), 0.5, 0.21, 3, corner=0.17912615734826384)
    found = rd.max_speed(arm, path, rd.orientation_rules.constant(), velocity_limits=None)
    at = plot_painting.torques_at_speed
    assert np.allclose(at(arm, found, found.speed), found.torques, atol=1e-10)
    still = arm.inverse_dynamics(found.q, 0 * found.q, 0 * found.q)
    assert np.allclose(at(arm, found, 0.0), still, atol=1e-12)
    # Between the ends it is the torque of the motion itself, by differences of the joint positions.
    ds = path.s[1] - path.s[0]
    k = 400
    q, qd = found.q[k], (found.q[k + 1] - found.q[k - 1]) / (2 * ds)
    qdd = (found.q[k + 1] - 2 * found.q[k] + found.q[k - 1]) / ds**2
    assert np.abs(at(arm, found, 0.7)[k] - arm.inverse_dynamics(q, 0.7 * qd, 0.49 * qdd)).max() < 0.02
    results = {"constant": found, "other": rd.max_speed(arm, path, rd.orientation_rules.pointing())}
    figure = plot_painting.torques_of_rules(arm, path.s, results, speed=1.0)
    assert len(figure.axes) == 2 and len(figure.axes[0].lines) == 4
    with pytest.raises(ValueError, match="at least 0"):
        at(arm, found, -1.0)
