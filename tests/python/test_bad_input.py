"""Input that no room can use: the message names the thing, the value and the bound."""

import copy
import pickle
import re
import threading

import numpy as np
import pytest

import redundancy as rd

CHAIN = rd.catalog.load("pa10")
ARM = rd.SrsArm(CHAIN)
POSE = CHAIN.forward([0.3, 0.5, -0.2, 1.1, 0.4, 0.7, -0.9])
IDENTITY = [1.0, 0.0, 0.0, 0.0]
VOLUME = rd.QuaternionVolume.cone((0, 0, 1), 0.4)
CONE = rd.Cone((0, 0, 1), (0, 0, 1), 0.4)


@pytest.mark.parametrize("bad", [-1, -(2**70), 2**200, -(2**200)])
@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("threads", lambda n: VOLUME.margin([IDENTITY, IDENTITY], threads=n)),
        ("threads", lambda n: CHAIN.forward(np.zeros((2, 7)), threads=n)),
        ("threads", lambda n: ARM.solve_batch([POSE], 0.1, threads=n)),
        ("max_iterations", lambda n: rd.OrientationOptimizer([(1.0, CONE)], max_iterations=n)),
        ("seed", lambda n: VOLUME.sample(3, seed=n)),
        ("n", VOLUME.sample),
        ("n", lambda n: rd.paths.circle((0, 0, 0), 1.0, n=n)),
        ("strokes", lambda n: rd.paths.raster((0, 0, 0), 1.0, 0.1, n)),
        ("index", lambda n: rd.Event("limit", n, 0.0, 0.0, "")),
        ("swivels", lambda n: rd.plan_swivel(ARM, rd.Path([POSE, POSE], s=[0.0, 1.0]), swivels=n)),
        ("smoothing", lambda n: rd.times_within_limits(np.zeros((2, 1)), [1.0], smoothing=n)),
    ],
)
def test_integers_out_of_range_are_named(name, call, bad):
    with pytest.raises(rd.RedundancyError) as caught:
        call(bad)
    text = str(caught.value) + "".join(getattr(caught.value, "__notes__", []))
    assert name in text
    assert str(bad) in text


def test_complex_and_masked_arrays_are_refused():
    with pytest.raises(rd.RedundancyError, match="complex"):
        CHAIN.forward(np.zeros(7) + 1j)
    with pytest.raises(rd.RedundancyError, match="masked"):
        CHAIN.forward(np.ma.masked_array(np.zeros((2, 7)), mask=np.eye(2, 7)))
    with pytest.raises(rd.RedundancyError, match="masked"):
        rd.JointRange(CHAIN).value(np.ma.masked_array(np.zeros(7), mask=[1, 0, 0, 0, 0, 0, 0]))
    whole = np.ma.masked_array(np.zeros(7), mask=np.zeros(7))
    assert np.array_equal(CHAIN.forward(whole), CHAIN.forward(np.zeros(7)))


def test_events_belong_to_their_trajectory():
    for t, s in [(np.nan, 0.0), (0.0, np.inf)]:
        with pytest.raises(rd.RedundancyError):
            rd.Event("limit", 0, t, s, "")
    event = rd.Event("limit", 3, 0.0, 0.0, "")
    with pytest.raises(rd.RedundancyError, match="index 3, the trajectory has only 2 rows"):
        rd.Trajectory(["a"], [0.0, 1.0], [[0.0], [1.0]], events=[event])


def test_speeds_of_a_trajectory_are_finite():
    with pytest.raises(rd.RedundancyError, match="'a'"):
        rd.Trajectory(["a"], [0.0, 1e-300], [[0.0], [1e10]])


def test_weights_have_a_bounded_ratio():
    barriers = [(1e-300, CONE), (1e300, rd.Cone((0, 0, 1), (0, 0.1, 1), 0.4))]
    with pytest.raises(rd.RedundancyError, match="weights from 1e-300 to 1e300"):
        rd.OrientationOptimizer(barriers, method="gradient")


def test_sampling_stops_on_ctrl_c():
    import _thread

    timer = threading.Timer(0.05, _thread.interrupt_main)
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        VOLUME.sample(10_000_000)
    timer.join()


def test_the_circle_pickles():
    motion = ARM.self_motion(POSE)
    again = pickle.loads(pickle.dumps(motion))
    assert len(again.branches) == len(motion.branches)
    for branch in motion.branches:
        other = copy.deepcopy(branch)
        assert other.signs == branch.signs
        assert np.array_equal(other.q(0.3), branch.q(0.3))
    best = motion.best(rd.JointRange(CHAIN))
    other = pickle.loads(pickle.dumps(best))
    assert np.array_equal(other.q, best.q)
    assert (other.value, other.swivel, other.branch) == (best.value, best.swivel, best.branch)
    far = np.array(POSE)
    far[0, 3] = 9.0
    none = pickle.loads(pickle.dumps(ARM.self_motion(far).best(rd.JointRange(CHAIN))))
    assert none.q is None
    assert "too far" in none.reason
    for batch in [ARM.solve_batch([POSE], 0.1), ARM.nearest_batch([POSE], np.zeros(7))]:
        assert np.array_equal(pickle.loads(pickle.dumps(batch)).q, batch.q)


MISALIGNED = np.frombuffer(b"\0" + np.linspace(0.1, 0.7, 7).tobytes(), dtype=np.uint8)[1:].view(np.float64)
RECORDS = np.zeros(7, dtype=[("a", float)])


@pytest.mark.parametrize(
    ("array", "text"),
    [
        (np.array(["0.1"] * 7), "q is an array of strings"),
        (["0.1"] * 7, "q is an array of strings"),
        (np.array([b"0.1"] * 7), "q is an array of strings"),
        (np.array([0.1] * 6 + ["0.1"], dtype=object), r"q: entry 6 is '0\.1', a real number is needed"),
        (np.array([0.1] * 6 + [None], dtype=object), "q: entry 6 is None"),
        (np.array(["2026-01-01"] * 7, dtype="datetime64[D]"), "q is an array of dates"),
        (np.arange(7).astype("timedelta64[s]"), "q is an array of time differences"),
        (RECORDS, "q is an array of records"),
        (np.zeros(7) + 1j, "q is complex"),
        (np.array([0.1] * 6 + [1j], dtype=object), r"q: entry 6 is 1j"),
        ([[0.1] * 7, [0.1] * 6], "q cannot be read as an array of numbers"),
        (np.ma.masked_array(np.zeros(7), mask=[0, 0, 1, 0, 0, 0, 0]), "q has masked entries"),
        (np.ma.masked_array(np.zeros((2, 7)), mask=np.eye(2, 7)), "q has masked entries"),
        (np.ma.masked_array(np.arange(7), mask=[0, 0, 1, 0, 0, 0, 0]), "q has masked entries"),
        (np.ma.masked_array(np.zeros(7, np.float32), mask=[0, 0, 1, 0, 0, 0, 0]), "q has masked entries"),
    ],
)
def test_arrays_that_hold_no_numbers(array, text: str):
    fast = [CHAIN.forward, CHAIN.jacobian, CHAIN.kinematics, CHAIN.hessian, rd.JointRange(CHAIN).value]
    rows = [lambda q: CHAIN.inverse_dynamics(q, np.zeros(7), np.zeros(7))]
    for call in fast + rows:
        with pytest.raises(rd.RedundancyError, match=text):
            call(array)


def test_arrays_that_hold_numbers_otherwise():
    from decimal import Decimal
    from fractions import Fraction

    assert not MISALIGNED.flags.aligned
    expected = CHAIN.forward(MISALIGNED.copy())
    halves = np.array([0.5] * 7)
    many = np.stack([MISALIGNED, MISALIGNED])
    raw = np.frombuffer(b"\0" + many.tobytes(), dtype=np.uint8)[1:].view(np.float64).reshape(2, 7)
    assert not raw.flags.aligned
    assert np.array_equal(CHAIN.forward(MISALIGNED), expected)
    assert np.array_equal(CHAIN.forward(raw)[1], expected)
    assert np.array_equal(CHAIN.forward(MISALIGNED.astype(">f8")), expected)
    assert rd.JointRange(CHAIN).value(MISALIGNED) == rd.JointRange(CHAIN).value(MISALIGNED.copy())
    pose = np.frombuffer(b"\0" + POSE.tobytes(), dtype=np.uint8)[1:].view(np.float64).reshape(4, 4)
    assert np.array_equal(CHAIN.with_tool(pose).tool, POSE)
    for same in (
        [Fraction(1, 2)] * 7,
        [Decimal("0.5")] * 7,
        np.array([0.5] * 7, dtype=object),
        np.float16(halves),
    ):
        assert np.array_equal(CHAIN.forward(same), CHAIN.forward(halves))
    whole = np.ma.masked_array(halves, mask=False)
    assert np.array_equal(CHAIN.forward(whole), CHAIN.forward(halves))
    assert np.array_equal(CHAIN.forward([True, False, 0, 0, 0, 0, 0]), CHAIN.forward([1.0, 0, 0, 0, 0, 0, 0]))


def test_one_row_of_denavit_hartenberg_is_a_list_of_one():
    with pytest.raises(rd.RedundancyError, match=r"rows has shape \(4,\), expected \(n, 4\)"):
        rd.Chain.from_dh([0.3, 0.0, 0.0, 0.0])
    assert rd.Chain.from_dh([[0.3, 0.0, 0.0, 0.0]]).dof == 1


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: CHAIN.forward(None), "q"),
        (lambda: CHAIN.forward(np.zeros(7), link=3), "link"),
        (lambda: CHAIN.forward(np.zeros((2, 7)), threads="two"), "threads"),
        (lambda: CHAIN.with_rail((0, 0, 1), "low", 1.0), "lower"),
        (lambda: CHAIN.with_rail((0, 0, 1), 0.0, 1.0, velocity="fast"), "velocity"),
        (lambda: CHAIN.with_payload("heavy", (0, 0, 0)), "mass"),
        (lambda: CHAIN.inverse_dynamics(np.zeros(7), np.zeros(7), np.zeros(7), gravity=9.81), "gravity"),
        (lambda: CHAIN.inverse_dynamics(np.zeros(7), np.zeros(7), np.zeros(7), gravity=(0, 0)), "gravity"),
        (lambda: CHAIN.jacobian(np.zeros(7), point=3.0), "point"),
        (lambda: rd.Chain.from_dh([[0, 0, 0, 0]], names=3), "names"),
        (lambda: rd.Chain.from_dh([[0, 0, 0, 0]], lower="low"), "lower"),
        (lambda: rd.Chain.from_dh([[0, 0, 0, 0]], inertia=3), "inertia"),
        (
            lambda: rd.Chain.from_dh([[0, 0, 0, 0]], inertia=[("a", (0, 0, 0), (0, 0, 0))]),
            r"inertia\[0\]: mass",
        ),
        (lambda: rd.Chain.from_dh([[0, 0, 0, 0]], inertia=[3]), r"inertia\[0\]"),
        (lambda: CHAIN.with_limits(lower="low"), "lower"),
        (lambda: rd.Path(None), "poses"),
        (lambda: rd.Path("path.csv"), "poses"),
        (lambda: rd.Path([POSE, POSE], s="far"), "s"),
        (lambda: rd.Path([POSE, POSE], s=[0, 1]).joined("other"), "other"),
        (lambda: rd.Path([POSE, POSE], s=[0, 1]).resampled("fine"), "step"),
        (lambda: rd.Trajectory(["a"], [0.0], [[0.0]], events=[3]), "events"),
        (lambda: rd.Trajectory(["a"], [0.0], [[0.0]], section=3), "section"),
        (lambda: rd.Trajectory(3, [0.0], [[0.0]]), "joint_names"),
        (lambda: rd.pose("here"), "position"),
        (lambda: rd.quaternion.rotate(IDENTITY, "up"), "v"),
        (lambda: rd.paths.circle("here", 1.0), "center"),
        (lambda: rd.paths.circle((0, 0, 0), "wide"), "radius"),
    ],
)
def test_what_is_wrong_is_named(call, text: str):
    with pytest.raises((rd.RedundancyError, TypeError), match=rf"\b{text}"):
        call()


def test_units_are_asked_about():
    arm = rd.catalog.load("iiwa14")
    tool = np.diag([-1.0, 1.0, -1.0])
    millimetres = rd.paths.circle((500.0, 0.0, 400.0), 100.0, n=20, orientation=tool)
    ask = r"are the positions in millimetres\?"
    plan = rd.plan_swivel(rd.SrsArm(arm), millimetres)
    assert plan.status == "unreachable" and re.search(ask, plan.reason)
    near = rd.plan_swivel(rd.SrsArm(arm), rd.paths.circle((5.0, 0.0, 4.0), 0.1, n=20, orientation=tool))
    assert near.status == "unreachable" and "millimetres" not in near.reason
    with pytest.raises(rd.CannotFollowError, match=ask):
        rd.max_speed(arm, millimetres)
    resolver = rd.ProjectedGradient(arm, rd.JointRange(arm), 0.1)
    short = rd.paths.circle((500.0, 0.0, 400.0), 2.0, n=20, orientation=tool)
    run = rd.track(arm, resolver, short, np.full(7, 0.3), 10.0, 0.01)
    assert run.status == "off_path" and re.search(ask, run.reason)
    flow = rd.SwivelFlow(rd.SrsArm(arm), 0.0, rd.Scene([]))
    with pytest.raises(rd.RedundancyError, match=ask):
        flow.follow(millimetres.with_times(np.arange(20.0)), 0.0, 0.1)
    path = rd.Path([arm.forward(np.full(7, 0.3)), arm.forward(np.full(7, 0.31))])
    with pytest.raises(
        rd.RedundancyError, match=r"180 rad, 28\.6 turns: are the joint positions in degrees\?"
    ):
        rd.follow_optimum(arm, path, [0.0, 30.0, 0.0, -90.0, 0.0, 60.0, 180.0], rd.JointRange(arm))


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda path: rd.plan(CHAIN, path.poses), r"expected a Path, got ndarray: rd\.Path\(poses\)"),
        (lambda path: rd.plan_swivel(ARM, path.poses), r"expected a Path, got ndarray: rd\.Path\(poses\)"),
        (lambda path: rd.max_speed(CHAIN, path.poses), "expected a Path, got ndarray"),
        (
            lambda path: rd.follow_optimum(CHAIN, path.poses, np.zeros(7), rd.JointRange(CHAIN)),
            "expected a Path, got ndarray",
        ),
        (
            lambda path: rd.track(
                CHAIN, rd.ProjectedGradient(CHAIN, None, 0.0), path.poses, np.zeros(7), 0.1, 1.0
            ),
            "expected a Path, got ndarray",
        ),
        (lambda path: rd.track(CHAIN, 3, path, np.zeros(7), 0.1, 1.0), "expected a resolver, got int"),
        (lambda path: rd.plan_swivel(CHAIN, path), r"expected an SrsArm, got Chain: rd\.SrsArm\(chain\)"),
        (lambda path: rd.SwivelFlow(CHAIN, 0.0), "expected an SrsArm, got Chain"),
        (
            lambda path: rd.plan_swivel(ARM, path, [rd.Sphere((0, 0, 0), 0.1)]),
            r"expected a Scene, got list: rd\.Scene",
        ),
        (lambda path: rd.IkSolver(CHAIN, criterion=3), "expected a criterion, got int"),
        (
            lambda path: rd.check(CHAIN, np.zeros((5, 7))),
            "expected a Trajectory or the name of a file, got ndarray",
        ),
        (lambda path: rd.ProjectedGradient(CHAIN, "joint_range", 0.1), "expected a criterion, got str"),
    ],
)
def test_objects_of_another_kind_are_named(call, text: str):
    with pytest.raises(TypeError, match=text):
        call(rd.Path([POSE, POSE], s=[0.0, 1.0]))


@pytest.mark.parametrize(
    ("kind", "options", "text"),
    [
        ("constant", {"angle": 0.3}, "constant has no option angle: its options are orientation"),
        ("constant", {"spin": "constant"}, "constant has no option spin"),
        ("pointing", {"center": (0, 0), "radius": 0.1}, "pointing has no option center"),
        ("tilt_square", {"angle": 0.1, "center": (0, 0), "radius": 0.2}, "tilt_square has no option radius"),
        ("barrier_cone", {"gamma": 0.1}, "barrier_cone has no option gamma: its options are beta, alpha"),
        ("barrier_spin", {"k_x": 0.1}, "barrier_spin has no option k_x"),
        ("barrier_two_cones", {"angle": 0.1}, "barrier_two_cones has no option angle"),
    ],
)
def test_options_that_a_rule_does_not_have(kind: str, options: dict, text: str):
    with pytest.raises(rd.RedundancyError, match=text):
        rd.OrientationRule(kind, **options)


def test_rules_with_a_surface_pickle():
    rules = rd.orientation_rules
    for rule in (
        rules.tilt_square(0.2, center=(0, 0), half_extents=(0.1, 0.2)),
        rules.tilt_disc(0.2, "constant", center=(0, 0), radius=0.2),
        rules.barrier_two_cones(center=(0, 0), half_extents=(0.1, 0.2)),
    ):
        assert pickle.loads(pickle.dumps(rule)) == rule


@pytest.mark.parametrize("size", [1e-7, 1e-6, 1e-5, 1e-4, 9e-4])
def test_a_rotation_that_is_nearly_one_becomes_the_nearest(size: float):
    from scipy.linalg import polar

    rough = np.array(POSE)
    rough[:3, :3] += size / 3 * np.random.default_rng(2).uniform(-1, 1, (3, 3))
    exact = polar(rough[:3, :3])[0]
    kept = CHAIN.with_tool(rough).tool[:3, :3]
    assert np.abs(kept - exact).max() < max(1e-12, 1.1e-6 * (size <= 1e-6))
    assert np.abs(ARM.chain.forward(ARM.solve(rough, 0.3, limits=False)[0])[:3, :3] - exact).max() < 2e-6
    assert np.abs(rd.Path([rough, rough], s=[0, 1]).poses[0][:3, :3] - exact).max() < 2e-6


def test_a_rotation_that_is_none_is_refused_with_its_distance():
    for rotation, distance in ((1.002 * POSE[:3, :3], "0.002"), (0.5 * POSE[:3, :3], "0.5")):
        rough = np.array(POSE)
        rough[:3, :3] = rotation
        text = rf"its distance from the nearest rotation is {re.escape(distance[:-1])}\d*, it must be at most 1e-3"
        for call in (lambda r=rough: ARM.solve(r, 0.3), lambda r=rough: rd.IkSolver(CHAIN).solve(r)):
            with pytest.raises(rd.RedundancyError, match=text):
                call()
    mirrored = np.array(POSE)
    mirrored[:3, 0] *= -1.0
    with pytest.raises(
        rd.RedundancyError, match=r"reflection .* its determinant is -(1|0\.9+\d*|1\.0+\d*), it must be 1"
    ):
        ARM.solve(mirrored, 0.3)


def test_a_path_of_one_pose_is_none():
    with pytest.raises(rd.RedundancyError, match="a path needs at least two samples, got 1"):
        rd.Path(POSE[None])


def test_arguments_of_several_kinds_say_which():
    panda = rd.catalog.load("panda")
    path = rd.paths.circle((0.4, 0.0, 0.4), 0.05, orientation=np.diag([1.0, -1.0, -1.0]), n=5)
    for call, words in (
        (lambda: rd.ToolFreedom(spin=None), 'an angle in rad or "free", got NoneType'),
        (lambda: rd.plan(panda, path, self_collision=[]), "True, False or .auto., got list"),
    ):
        with pytest.raises(TypeError, match="expected " + words):
            call()
