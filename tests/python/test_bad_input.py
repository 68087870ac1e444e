"""Input that no room can use: the message names the thing, the value and the bound."""

import copy
import pickle
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
