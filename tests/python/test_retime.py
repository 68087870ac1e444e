"""`retime`: beside toppra on the same geometry, limits between the rows, bad input."""

import itertools
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


# --- corners that are blended -----------------------------------------------------------------------------------------


def zigzag(per_leg: int) -> tuple[np.ndarray, list[int]]:
    """Straight legs in joint space with four corners; rows of the corners."""
    rng = np.random.default_rng(12)
    corners = np.array([0.1, -0.4, 0.2, -1.9, 0.1, 1.7, 0.3]) + rng.uniform(-0.35, 0.35, (6, 7))
    u = np.linspace(0, 1, per_leg, endpoint=False)[:, None]
    legs = [a + u * (b - a) for a, b in itertools.pairwise(corners)]
    return np.concatenate([*legs, corners[-1:]]), [per_leg * k for k in range(1, 5)]


def positions(rows: np.ndarray) -> np.ndarray:
    return PANDA.forward(rows)[:, :3, 3]


@pytest.mark.parametrize("jerk", [None, 5 * PANDA.acceleration_limit])
@pytest.mark.parametrize("per_leg", [2, 40, 400])
@pytest.mark.parametrize("blend", [0.004, 0.03, 0.3])
def test_blended_corners(blend, per_leg, jerk):
    q, corners = zigzag(per_leg)
    stopped = rd.retime(PANDA, q, jerk_limits=jerk)
    move = rd.retime(PANDA, q, jerk_limits=jerk, blend=blend)
    assert stopped.stops == corners and stopped.blends == []
    # With limited jerk some short curves take longer than a stop.
    assert sorted(move.stops + move.blends) == corners
    assert jerk is not None or move.blends == corners
    assert blend < 0.3 or len(move.blends) >= 2
    assert move.t[-1] <= stopped.t[-1] * (0.97 if jerk is None and blend > 0.01 else 1.0)
    assert max(shares(move, jerk)) <= 1 + 1e-6
    # Every row of the path has its row, in order; those outside of the curves are where they were.
    section = np.array(move.section)
    assert set(section) == ({"path", "blend"} if move.blends else {"path"})
    own = np.array(move.path_rows)
    assert len(own) == len(q) and (np.diff(own) > 0).all()
    kept = section[own] == "path"
    assert kept[[0, -1]].all() and not kept[move.blends].any()
    assert np.array_equal(move.q[own[kept]], q[kept])
    # The motion stays on the legs except near a corner, and there it is never farther from the corner than asked for.
    t = np.linspace(0, move.t[-1], 20_000)
    rows, qd, _, _ = move.sample(t)
    legs = np.stack([q[[0, *corners, -1]][:-1], q[[0, *corners, -1]][1:]], axis=1)
    along = legs[:, 1] - legs[:, 0]
    share = np.clip(np.einsum("tkj,kj->tk", rows[:, None] - legs[:, 0], along) / (along**2).sum(1), 0, 1)
    off = np.linalg.norm(rows[:, None] - legs[:, 0] - share[:, :, None] * along, axis=2).min(axis=1)
    to_corner = np.linalg.norm(positions(rows)[:, None] - positions(q[corners]), axis=2).min(axis=1)
    assert to_corner[off > 1e-5].max(initial=0.0) <= blend * (1 + 1e-3)
    # It does not stop on the way, and does leave the corners out.
    assert move.stops or np.linalg.norm(qd[2000:-2000], axis=1).min() > 0.02
    missed = [np.linalg.norm(positions(rows) - positions(q[[k]]), axis=1).min() for k in move.blends]
    assert min(missed, default=1.0) > 0.02 * blend
    reports = [event for event in move.events if "without a stop" in event.message]
    assert [move.path_rows[k] for k in move.blends] == [event.index for event in reports]
    for event, distance in zip(reports, missed, strict=True):
        said = float(event.message.split(" m and")[0].split()[-1])
        assert distance <= said * (1 + 1e-3) + 1e-6


def test_blends_with_equal_intervals_and_limits():
    q, corners = zigzag(40)
    move = rd.retime(PANDA, q, blend=0.3, dt=0.01, jerk_limits=5 * PANDA.acceleration_limit)
    assert max(shares(move, 5 * PANDA.acceleration_limit)) <= 1 + 1e-6
    assert np.allclose(np.diff(move.t)[:-1], 0.01) and {"path", "blend"} == set(move.section)
    # Torques too.
    arm = rd.catalog.load("iiwa14")
    torque = 0.8 * arm.effort_limit
    heavy = rd.retime(arm, q, blend=0.1, acceleration_limits=np.full(7, 20.0), torque_limits=torque)
    t = np.linspace(0, heavy.t[-1], 3000)
    tau = [arm.inverse_dynamics(*row) for row in zip(*heavy.sample(t)[:3], strict=True)]
    assert (np.abs(tau) / torque).max() <= 1 + 1e-5 and len(heavy.blends) >= 2
    # One row per row of the path, beside those of the curves.
    sparse = rd.retime(PANDA, q, blend=0.02, rows_between=False)
    between = np.delete(np.array(sparse.section), sparse.path_rows)
    assert np.count_nonzero(between == "path") <= 2 * len(corners)


def test_corners_that_stay_stops():
    # On the way back along the same line, at a row that repeats, and where a curve would leave the position limits.
    a, b = np.array([0, -0.4, 0, -1.8, 0, 1.6, 0]), np.array([0.5, -0.2, 0.1, -1.5, 0.2, 1.4, 0.3])
    back = rd.retime(PANDA, np.stack([a, b, a]), blend=0.05)
    assert back.stops == [1] and back.blends == []
    q, corners = zigzag(20)
    waits = rd.retime(PANDA, np.insert(q, corners[0], q[corners[0]], axis=0), blend=0.02)
    assert corners[0] in waits.stops and len(waits.blends) == 3
    with pytest.raises(rd.RedundancyError, match="blend"):
        rd.retime(PANDA, q, blend=-0.01)


def test_blended_motion_pickles_and_passes_check(tmp_path):
    q, corners = zigzag(40)
    jerk = 5 * PANDA.acceleration_limit
    move = rd.retime(PANDA, q, blend=0.3, jerk_limits=jerk)
    again = pickle.loads(pickle.dumps(move))
    assert again == move and again.blends == move.blends and set(move.blends) < set(corners)
    for save, load in (("to_csv", "from_csv"), ("to_npz", "from_npz"), ("to_json", "from_json")):
        file = tmp_path / f"move.{save[3:]}"
        getattr(move, save)(file)
        assert list(getattr(rd.Trajectory, load)(file).section) == list(move.section)
    # The curves are not on the path, and the check knows it.
    path = rd.Path(PANDA.forward(q))
    report = rd.check(PANDA, move, path, jerk_limits=jerk)
    assert report.ok, report.findings
    # And still finds a row behind the last curve that is not on the path.
    row = len(move.t) - 1 - list(move.section)[::-1].index("blend") + 5
    off = move.q.copy()
    off[row, 0] += 0.02
    moved = rd.Trajectory(move.joint_names, move.t, off, move.qd, section=list(move.section))
    found = rd.check(PANDA, moved, path, jerk_limits=jerk).findings
    assert row in {finding.row for finding in found if finding.kind == "path_deviation"}


def test_torque_limits_that_do_not_bind_cost_no_time_beside_jerk_limits():
    # The search for a profile with all limits at once ends without one on this path.
    chain = rd.catalog.load("panda")
    raster = rd.paths.raster(
        (0.4, -0.15, 0.3), 0.3, 0.05, 4, corner=0.04, orientation=np.diag([1.0, -1.0, -1.0]), step=0.002
    )
    plan = rd.plan(chain, raster)
    free = plan.retime(jerk_limits=500.0)
    for limits in (100.0 * chain.effort_limit, chain.effort_limit):
        held = plan.retime(jerk_limits=500.0, torque_limits=limits)
        assert held.t[-1] < 1.01 * free.t[-1] and held.stretched < 1.01
        assert rd.check(chain, held, jerk_limits=500.0, torque_limits=limits).ok
