"""`retime`: beside toppra on the same geometry, limits between the rows, bad input."""

import pickle

import numpy as np
import pytest

import redundancy as rd

PANDA = rd.catalog.load("panda")


def smooth(rows: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    u = np.linspace(0, 1, rows)[:, None]
    j = np.arange(7)
    q = rng.uniform(0.1, 0.7, 7) * np.sin(rng.uniform(1, 3, 7) * u + j) + rng.uniform(0, 0.3, 7) * np.cos(
        rng.uniform(2, 6, 7) * u
    )
    q[:, 3] -= 1.5
    return q


def chords(q: np.ndarray) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(q, axis=0), axis=1))])


def shares(move: rd.RetimedTrajectory, jerk: np.ndarray | None = None) -> list[float]:
    t = np.concatenate([np.linspace(a, b, 12)[1:-1] for a, b in zip(move.t[:-1], move.t[1:], strict=True)])
    _, qd, qdd, qddd = move.sample(t)
    out = [np.abs(qd / PANDA.velocity_limit).max(), np.abs(qdd / PANDA.acceleration_limit).max()]
    return out + ([] if jerk is None else [np.abs(qddd / jerk).max()])


@pytest.mark.parametrize("seed", range(4))
def test_as_fast_as_toppra_without_violation(seed):
    toppra = pytest.importorskip("toppra")
    toppra.setup_logging("ERROR")
    q = smooth(300, seed)
    path = toppra.SplineInterpolator(chords(q), q)
    limits = [
        toppra.constraint.JointVelocityConstraint(np.stack([-PANDA.velocity_limit, PANDA.velocity_limit], 1)),
        toppra.constraint.JointAccelerationConstraint(
            np.stack([-PANDA.acceleration_limit, PANDA.acceleration_limit], 1),
            discretization_scheme=toppra.constraint.DiscretizationType.Interpolation,
        ),
    ]
    solver = toppra.algorithm.TOPPRA(limits, path, gridpoints=chords(q), parametrizer="ParametrizeConstAccel")
    theirs = solver.compute_trajectory(0, 0).duration
    move = rd.retime(PANDA, q)
    assert move.t[-1] <= 1.005 * theirs
    assert max(shares(move)) <= 1 + 1e-6
    assert np.array_equal(move.q, q)


def test_jerk_limits_hold_and_accelerations_come_along(tmp_path):
    jerk = 5 * PANDA.acceleration_limit
    move = rd.retime(PANDA, smooth(300, 5), jerk_limits=jerk)
    assert max(shares(move, jerk)) <= 1 + 1e-6
    assert np.abs(move.qdd[[0, -1]]).max() < 1e-9
    assert set(move.section) == {"path"}
    assert any(word.startswith("jerk:") for word in move.limiting if word)
    again = pickle.loads(pickle.dumps(move))
    assert np.array_equal(again.qdd, move.qdd)
    assert again.limiting == move.limiting
    move.to_json(tmp_path / "move.json")
    assert np.array_equal(rd.Trajectory.from_json(tmp_path / "move.json").qdd, move.qdd)


def test_a_plan_and_equal_intervals():
    arm = rd.SrsArm(rd.catalog.load("iiwa14"))
    path = rd.paths.circle((0.5, 0, 0.4), 0.1, orientation=np.diag([-1.0, 1, -1]), n=200)
    plan = rd.plan_swivel(arm, path)
    limits = np.full(7, 10.0)
    move = rd.retime(arm.chain, plan, acceleration_limits=limits, jerk_limits=500.0, dt=0.004)
    assert np.allclose(np.diff(move.t)[:-1], 0.004)
    _, qd, qdd, _ = move.sample(np.linspace(0, move.t[-1], 5000))
    assert np.all(np.abs(qd) <= arm.chain.velocity_limit * (1 + 1e-6))
    assert np.all(np.abs(qdd) <= 10.1)
    assert np.all(np.abs(move.q[0] - plan.q[0]) < 1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"tool_speed": -1.0}, "tool_speed"),
        ({"jerk_limits": [1.0] * 6}, "jerk_limits"),
        ({"velocity_limits": "fast"}, "velocity_limits"),
        ({"acceleration_limits": None}, "acceleration limit"),
        ({"dt": 0.0}, "dt"),
    ],
)
def test_bad_input(change, words):
    with pytest.raises(ValueError, match=words):
        rd.retime(PANDA, smooth(20, 0), **change)
    with pytest.raises(ValueError, match="rows of the path"):
        rd.retime(PANDA, np.zeros((1, 7)))


@pytest.mark.parametrize("dt", [0.002, 0.01, 0.05])
@pytest.mark.parametrize("jerk", [None, 500.0])
def test_evenly_spaced_rows_hold_the_limits(dt: float, jerk: float | None):
    q = smooth(60, 5)
    limits = None if jerk is None else np.full(7, jerk)
    move = rd.retime(PANDA, q, jerk_limits=limits, dt=dt)
    assert np.allclose(np.diff(move.t)[:-1], dt, atol=1e-12)
    assert max(shares(move, limits)) <= 1.0 + 1e-6
    # Slower than without, if at all, and said so.
    free = rd.retime(PANDA, q, jerk_limits=limits)
    assert move.t[-1] >= free.t[-1] - 1e-9 and move.stretched >= 1.0
