"""Kinds of optima, critical points over a pose, and where they break [Park1996]."""

import _thread
import pickle
import threading
import time
from collections.abc import Callable

import numpy as np
import pytest

import redundancy as rd

# Table 2 of the paper: degrees, H, A, kind. The last digit of P3's q3 is misprinted by a tenth more than rounding.
TABLE_2 = [
    ((-87.1742, 111.7847, 77.5352), 75.0395, -4860.58, "maximum"),
    ((-83.4304, 179.8777, -82.0847), 61.0392, -3428.24, "maximum"),
    ((-8.8531, 112.6675, 155.6028), 20.5785, -897.94, "maximum"),
    ((-21.6863, 94.1577, 147.1470), 18.7790, 1373.58, "minimum"),
    ((12.3080, 150.8068, 153.8209), 13.9617, 1024.89, "minimum"),
    ((-126.9744, 161.2385, -4.6209), 27.0532, 2251.39, "minimum"),
]


@pytest.fixture(scope="module")
def planar() -> tuple[rd.Chain, rd.Manipulability]:
    arm = rd.catalog.load("planar3r")
    return arm, rd.Manipulability(arm, task="planar")


def test_table_2(planar: tuple[rd.Chain, rd.Manipulability]) -> None:
    arm, h = planar
    points = rd.constrained_optima(arm, (2.0, 0.0), h, task="planar")
    assert len(points) == 12
    for degrees, value, a, kind in TABLE_2:
        near = [p for p in points if np.abs(np.degrees(p.q) - degrees).max() <= 0.54e-4]
        assert len(near) == 1
        assert str(near[0].kind) == kind
        assert near[0].value == pytest.approx(value, abs=0.501e-4)
        paper = rd.cofactor_condition(arm, near[0].q, h, task="planar")
        assert paper.condition == pytest.approx(a, abs=0.501e-2)
        assert near[0].eigenvalues[0] * near[0].value == pytest.approx(paper.condition, rel=1e-8)
        at = rd.classify(arm, np.radians(degrees), h, task="planar")
        assert str(at.kind) == kind
        assert at.sigma_min == pytest.approx(np.linalg.svd(arm.jacobian(np.radians(degrees))[:2])[1].min())


def test_kinematic_singularities_are_no_critical_points(planar: tuple[rd.Chain, rd.Manipulability]) -> None:
    arm, h = planar
    for q2 in (0.0, np.pi):
        for q3 in (0.0, np.pi):
            at = rd.classify(arm, [0.3, q2, q3], h, task="planar")
            assert at.kind == rd.Kind.KINEMATIC_SINGULARITY
            assert at.sigma_min < 1e-12
    # (2.5, 0) has the arm with q = (0, 0, pi) + ... on its self-motion.
    q = np.array([0.3, 0.0, np.pi])
    tip = arm.forward(q)[:2, 3]
    for p in rd.constrained_optima(arm, tip, h, task="planar"):
        assert p.kind in ("maximum", "minimum", "degenerate")


def test_the_saddle_of_the_4r_arm() -> None:
    arm = rd.catalog.load("planar4r")
    h = rd.Manipulability(arm, task="planar")
    q = [1.4523200054, -2.2285317342, -0.2952995971, 1.4314560205]
    at = rd.classify(arm, q, h, task="planar")
    assert at.kind == "saddle"
    assert h.value(q) == pytest.approx(269.0886314, abs=1e-6)
    np.testing.assert_allclose(at.eigenvalues, [-112.95383219, 54.23547925], atol=1e-6)
    np.testing.assert_allclose(at.multipliers, [80.40134486, 0], atol=1e-6)
    found = rd.constrained_optima(arm, (4.5, 0.0), h, task="planar", starts=400)
    assert any(np.abs(p.q - q).max() < 1e-8 and p.kind == "saddle" for p in found)


def test_batches_and_words(planar: tuple[rd.Chain, rd.Manipulability]) -> None:
    arm, h = planar
    many = rd.classify(arm, np.radians([row[0] for row in TABLE_2]), h, task=rd.Task("planar"))
    assert [str(x.kind) for x in many] == [row[3] for row in TABLE_2]
    assert rd.classify(arm, np.zeros((0, 3)), h, task="planar") == []
    for thing in (many[0], rd.cofactor_condition(arm, [1.0, 1, 1], h, task="planar")):
        assert repr(pickle.loads(pickle.dumps(thing))) == repr(thing)
    point = rd.constrained_optima(arm, (2.0, 0.0), h, task="planar")[0]
    assert repr(pickle.loads(pickle.dumps(point))) == repr(point)


def test_wrong_input_is_refused(planar: tuple[rd.Chain, rd.Manipulability]) -> None:
    arm, h = planar
    with pytest.raises(rd.RedundancyError, match="expected"):
        rd.classify(arm, [1.0, 2.0], h, task="planar")
    with pytest.raises(rd.RedundancyError, match="finite"):
        rd.classify(arm, [1.0, 2.0, np.nan], h, task="planar")
    with pytest.raises(rd.RedundancyError, match="no spare freedom"):
        rd.classify(arm, [1.0, 2.0, 3.0], h, task="planar_pose")
    with pytest.raises(rd.RedundancyError, match="joints of the criterion"):
        rd.classify(arm, [1.0, 2.0, 3.0], rd.JointRange(rd.catalog.load("pa10")), task="planar")
    with pytest.raises(rd.RedundancyError, match="step"):
        rd.constrained_optima(arm, (2.0, 0.0), h, task="planar", step=-1.0)
    with pytest.raises(rd.RedundancyError, match="finite"):
        rd.constrained_optima(arm, (np.nan, 0.0), h, task="planar")


# Table 1 of the paper, degrees, and the radius of the tool's circle.
TABLE_1 = [
    (138.5904, 97.1808, 0.0000),
    (141.6125, 92.7837, 0.1442),
    (124.5862, 142.9171, 1.4950),
    (142.8637, -37.6906, 3.4734),
    (46.9843, -142.4039, 4.5195),
]


def test_table_1(planar: tuple[rd.Chain, rd.Manipulability]) -> None:
    arm, h = planar
    points = rd.algorithmic_singularities(arm, h, task="planar")
    assert len(points) == 10
    for q2, q3, radius in TABLE_1:
        for sign in (1, -1):
            wanted = np.array([sign * q2, sign * q3])
            near = [p for p in points if np.abs(np.degrees(p.q[1:]) - wanted).max() <= 0.501e-4]
            assert len(near) == 1
            assert np.linalg.norm(near[0].position) == pytest.approx(radius, abs=0.501e-4)
            assert near[0].residual < 1e-10 and near[0].first_joint_free and near[0].dimension == 0
            assert rd.classify(arm, near[0].q, h, task="planar").kind == "degenerate"
    assert repr(pickle.loads(pickle.dumps(points[0]))) == repr(points[0])
    moved = points[3].q + np.array([2.0, 0.03, -0.04])
    assert rd.singularity_distance(arm, moved, points) == pytest.approx(0.05, abs=1e-12)
    np.testing.assert_allclose(
        rd.singularity_distance(arm, [moved, points[1].q], points), [0.05, 0], atol=1e-12
    )


def circle(n: int) -> rd.Path:
    return rd.paths.circle((3.5, 0, 0), 1.5, start=np.pi, n=n).with_times(np.linspace(0, 1, n))


def test_the_paths_of_figure_2(planar: tuple[rd.Chain, rd.Manipulability]) -> None:
    arm, h = planar
    path = circle(101)
    runs = [rd.follow_optimum(arm, path, np.radians(row[0]), h, task="planar") for row in TABLE_2]
    assert [run.completed for run in runs] == [True] + [False] * 5
    first = runs[0]
    assert len(first) == 101 and not first.events
    assert np.abs(first.q[-1] - first.q[0]).max() < 1e-10
    tips = np.array([arm.forward(q)[:3, 3] for q in first.q])
    np.testing.assert_allclose(tips, path.positions, atol=1e-12)
    for i, kind in (
        (1, "algorithmic"),
        (2, "algorithmic"),
        (3, "kinematic"),
        (4, "kinematic"),
        (5, "algorithmic"),
    ):
        event = runs[i].events[-1]
        assert str(event.kind) == f"{kind}_singularity"
        assert event.index == len(runs[i])
        assert event.s == pytest.approx(event.t * path.length, abs=1e-9)
    for i in (1, 5):
        assert runs[i].events[-1].t == pytest.approx(0.2127422082, abs=1e-10)
        q = (np.degrees(runs[i].stop_q)[1:] + 180) % 360 - 180
        np.testing.assert_allclose(q, [142.86374652115, -37.690595721962], atol=1e-7)
    # The arm is straight or folded where the circle of that reach is met: |x| = 3.5 and 2.5.
    for i, reach in ((3, 3.5), (4, 2.5)):
        t = np.arccos((3.5**2 + 1.5**2 - reach**2) / (2 * 3.5 * 1.5)) / (2 * np.pi)
        assert runs[i].events[-1].t == pytest.approx(t, abs=1e-9)
    copy = pickle.loads(pickle.dumps(runs[1]))
    assert repr(copy) == repr(runs[1]) and np.array_equal(copy.q, runs[1].q) and copy.events == runs[1].events


def test_starts_are_ranked(planar: tuple[rd.Chain, rd.Manipulability]) -> None:
    arm, h = planar
    ranked = rd.rank_starts(arm, circle(51), h, task="planar")
    assert [start.completed for start in ranked] == [True] * 2 + [False] * 10
    ends = [start.trajectory.stop_s for start in ranked[2:]]
    assert ends == sorted(ends, reverse=True)
    np.testing.assert_allclose(np.abs(np.degrees(ranked[0].q)), (87.1742, 111.7847, 77.5352), atol=1e-4)
    assert repr(pickle.loads(pickle.dumps(ranked[2]))) == repr(ranked[2])


def test_a_start_that_is_not_critical_is_refused(planar: tuple[rd.Chain, rd.Manipulability]) -> None:
    arm, h = planar
    with pytest.raises(rd.RedundancyError, match="no critical point"):
        rd.follow_optimum(arm, circle(11), [0.1, 0.2, 0.3], h, task="planar")
    with pytest.raises(rd.RedundancyError, match="orientations"):
        iiwa = rd.catalog.load("iiwa14")
        rd.follow_optimum(iiwa, circle(11), np.zeros(7), rd.JointRange(iiwa))


def rotation_error(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(a[:3, :3] - b[:3, :3]))


@pytest.mark.parametrize("name", ["panda", "iiwa14", "pa10"])
def test_self_motion_curves_keep_the_pose(name: str) -> None:
    arm = rd.catalog.load(name)
    rng = np.random.default_rng(3)
    for _ in range(3):
        lower, upper = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
        q0 = rng.uniform(lower, upper)
        pose = arm.forward(q0)
        curve = rd.trace_self_motion(arm, q0)
        assert curve.closed and curve.status == "converged"
        turns = (curve.q[-1] - curve.q[0]) / (2 * np.pi)
        np.testing.assert_allclose(turns, np.round(turns), atol=1e-10)
        assert np.linalg.norm(np.diff(curve.q, axis=0), axis=1).max() <= 0.0121
        for q, t in zip(curve.q[::7], curve.tangents[::7], strict=True):
            here = arm.forward(q)
            assert np.linalg.norm(here[:3, 3] - pose[:3, 3]) < 1e-10
            assert rotation_error(here, pose) < 1e-10
            assert np.abs(arm.jacobian(q) @ t).max() < 1e-5
        for s in rng.uniform(0, 2 * curve.length, 5):
            q = curve.at(s)
            assert np.abs(arm.forward(q) - pose).max() < 1e-12
        # Feasible arcs against samples.
        s = np.linspace(0, curve.length, 2000)
        q = curve.at(s)
        middle, half = (arm.lower + arm.upper) / 2, (arm.upper - arm.lower) / 2
        away = np.abs((q - middle + np.pi) % (2 * np.pi) - np.pi) - half
        legal = (away <= 0).all(axis=1)
        inside = np.zeros(len(s), bool)
        for lo, hi in curve.intervals():
            inside |= (s - lo) % curve.length <= hi - lo
        unclear = np.abs(away.max(axis=1)) < 1e-9
        assert np.array_equal(inside[~unclear], legal[~unclear])
        copy = pickle.loads(pickle.dumps(curve))
        assert repr(copy) == repr(curve) and np.array_equal(copy.intervals(), curve.intervals())


def test_a_patch_of_two_freedoms() -> None:
    arm = rd.catalog.load("planar4r")
    q0 = np.array([0.2, 0.5, 0.7, 0.9])
    q, valid = rd.self_motion_patch(arm, q0, task="planar", spacing=0.05, steps=6)
    assert valid.all() and np.array_equal(q[6, 6], q0)
    tips = np.array([arm.forward(x)[:2, 3] for x in q.reshape(-1, 4)])
    np.testing.assert_allclose(tips - arm.forward(q0)[:2, 3], 0, atol=1e-11)
    with pytest.raises(rd.RedundancyError, match="dimensions"):
        rd.trace_self_motion(arm, q0, task="planar")


def test_singularity_curves() -> None:
    arm = rd.catalog.load("planar3r")
    posture = rd.Posture(arm, [0.3, 0.5, 0.7])
    curves = rd.singularity_curves(arm, posture, task="planar", starts=300)
    assert len(curves) == 8 and [len(c) for c in curves] == sorted((len(c) for c in curves), reverse=True)
    for curve in curves:
        assert curve.q.shape == (len(curve), 3) and not curve.closed and not curve.first_joint_free
        assert {str(at.kind) for at in rd.classify(arm, curve.q, posture, task="planar")} == {"degenerate"}
        again = pickle.loads(pickle.dumps(curve))
        np.testing.assert_array_equal(again.q, curve.q)
        assert repr(again) == repr(curve) == f"SingularityCurve(open, {len(curve)} rows)"
    one = rd.singularity_curves(arm, posture, task="planar", starts=300, threads=1)
    for a, b in zip(curves, one, strict=True):
        np.testing.assert_array_equal(a.q, b.q)
    with pytest.raises(rd.RedundancyError, match="has 5 dimensions here; curves have one"):
        iiwa = rd.catalog.load("iiwa14")
        rd.singularity_curves(iiwa, rd.JointRange(iiwa), starts=10)
    with pytest.raises(rd.RedundancyError, match=r"step is 1, it must be from 1e-4 to 0\.5"):
        rd.singularity_curves(arm, posture, task="planar", step=1.0)


def interrupted(call: Callable[[], object]) -> float:
    """Seconds from Ctrl-C to the exception."""
    sent = []

    def send() -> None:
        sent.append(time.monotonic())
        _thread.interrupt_main()

    timer = threading.Timer(0.2, send)
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            call()
    finally:
        timer.cancel()
        timer.join()
    return time.monotonic() - sent[0]


def test_long_searches_stop_on_ctrl_c() -> None:
    arm = rd.catalog.load("iiwa14")
    h = rd.Manipulability(arm)
    assert interrupted(lambda: rd.algorithmic_singularities(arm, h, starts=100_000)) < 10.0
    pose = arm.forward([0.3, 0.7, -0.4, -1.4, 0.2, 0.9, 0.5])
    path = rd.paths.circle(pose[:3, 3] - [0.05, 0.0, 0.0], 0.05, orientation=pose[:3, :3], n=3)
    assert interrupted(lambda: rd.rank_starts(arm, path, h, step=1e-3)) < 10.0
