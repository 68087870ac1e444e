"""`Trajectory`, `Event` and timing: the Python contract."""

import csv
import json
import pickle

import numpy as np
import pytest

import redundancy as rd

NAMES = ["shoulder", "elbow"]


def trajectory() -> rd.Trajectory:
    t = np.array([0.0, 0.1, 0.35, 1.0])
    q = np.column_stack([np.sin(t), np.cos(3 * t)])
    events = [
        rd.Event("reconfiguration", 2, 0.35, 0.1, "to branch (+, -, +)"),
        rd.Event("limit", 3, 1.0, 0.2, "é"),
    ]
    return rd.Trajectory(NAMES, t, q, events=events)


def same(a, b, atol=0.0):
    assert a.joint_names == b.joint_names
    for name in ("t", "q", "qd"):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=0, atol=atol)


def test_velocities_are_second_order_differences():
    def error(n):
        t = np.linspace(0, 1, n) ** 1.3
        qd = rd.Trajectory(["a"], t, np.sin(3 * t)[:, None]).qd[:, 0]
        return np.abs(qd - 3 * np.cos(3 * t))[1:-1].max()

    assert error(400) < error(200) / 3
    t = np.array([0.0, 0.1, 0.4, 0.5])
    np.testing.assert_allclose(rd.Trajectory(["a"], t, (t**2)[:, None]).qd[1:3, 0], 2 * t[1:3], rtol=1e-13)


def test_files_read_back(tmp_path):
    given = trajectory()
    given.to_csv(tmp_path / "t.csv")
    given.to_json(tmp_path / "t.json")
    given.to_npz(tmp_path / "t.npz")
    same(rd.Trajectory.from_csv(tmp_path / "t.csv"), given)
    from_json = rd.Trajectory.from_json(tmp_path / "t.json")
    same(from_json, given, atol=1e-9)
    from_npz = rd.Trajectory.from_npz(tmp_path / "t.npz")
    same(from_npz, given)
    assert from_json.events == from_npz.events == given.events


def test_csv_header_and_rows(tmp_path):
    given = trajectory()
    given.to_csv(tmp_path / "t.csv")
    with (tmp_path / "t.csv").open() as file:
        header, *rows = csv.reader(file)
    assert header == ["t", "shoulder", "elbow", "shoulder_velocity", "elbow_velocity"]
    np.testing.assert_array_equal(np.array(rows, float), np.column_stack([given.t, given.q, given.qd]))


def test_json_has_the_field_names_of_ros(tmp_path):
    given = trajectory()
    given.to_json(tmp_path / "t.json")
    document = json.loads((tmp_path / "t.json").read_text())
    assert document["joint_names"] == NAMES
    assert set(document["points"][0]) == {"positions", "velocities", "time_from_start"}
    for point, t, q in zip(document["points"], given.t, given.q, strict=True):
        stamp = point["time_from_start"]
        assert set(stamp) == {"sec", "nanosec"} and 0 <= stamp["nanosec"] < 10**9
        assert abs(stamp["sec"] + 1e-9 * stamp["nanosec"] - t) < 1e-9
        assert point["positions"] == q.tolist()


def test_pickle_repr_and_length():
    given = trajectory()
    copy = pickle.loads(pickle.dumps(given))
    same(copy, given)
    assert copy.events == given.events
    assert len(given) == 4
    assert repr(given) == "Trajectory(4 rows of 2 joints, 1 s, 2 events)"
    assert repr(given.events[0]).startswith("Event(kind='reconfiguration', index=2, t=0.35, s=0.1")
    assert given.events[0].kind is rd.EventKind.RECONFIGURATION
    assert str(given.events[0].kind) == "reconfiguration"


def test_bad_input(tmp_path):
    with pytest.raises(rd.RedundancyError, match="unknown event kind 'party', expected one of: basis_change"):
        rd.Event("party", 0, 0.0, 0.0, "")
    with pytest.raises(rd.RedundancyError, match=r"q has shape \(3, 2\)"):
        rd.Trajectory(["a"], [0, 1, 2], np.zeros((3, 2)))
    with pytest.raises(rd.RedundancyError, match=r"t\[1\] is 0 after 0"):
        rd.Trajectory(["a"], [0, 0], np.zeros((2, 1)))
    with pytest.raises(rd.RedundancyError, match="joint name 'a' is used twice"):
        rd.Trajectory(["a", "a"], [0], np.zeros((1, 2)))
    for read in (rd.Trajectory.from_csv, rd.Trajectory.from_json, rd.Trajectory.from_npz):
        with pytest.raises(rd.FileFormatError, match="missing"):
            read(tmp_path / "missing")
        (tmp_path / "noise").write_bytes(bytes(range(256)))
        with pytest.raises(rd.FileFormatError, match="noise"):
            read(tmp_path / "noise")


def test_times_use_the_limits_and_keep_them():
    rng = np.random.default_rng(0)
    s = np.linspace(0, 1, 1000)[:, None]
    q = np.sin(2 * np.pi * s * rng.uniform(0.5, 3, 7) + rng.uniform(0, 6, 7))
    limits = rng.uniform(0.5, 3, 7)
    t = rd.times_within_limits(q, limits)
    speed = np.abs(np.diff(q, axis=0)) / np.diff(t)[:, None] / limits
    assert speed.max() <= 0.9 * (1 + 1e-9)
    least = (np.abs(np.diff(q, axis=0)) / limits).max(axis=1).sum() / 0.9
    assert least <= t[-1] < 1.1 * least
    # Smoothing: the step from one time to the next changes little.
    dt = np.diff(t)
    assert np.abs(np.diff(np.log(dt))).max() < 0.05
    assert (np.abs(rd.Trajectory([f"j{i}" for i in range(7)], t, q).qd) <= 0.9 * limits * (1 + 1e-9)).all()
    with pytest.raises(rd.RedundancyError, match="without a velocity limit"):
        rd.times_within_limits(q, np.full(7, np.inf))


def test_motions_are_joined_where_they_meet():
    panda = rd.catalog.load("panda")
    a, b, c = np.array([0, 0.3, 0, -1, 0.2, 1, 0]) + np.array([0.0, 0.2, -0.1])[:, None]
    for jerk in (None, 2000.0):
        first, second = (rd.joint_move(panda, *ends, jerk_limits=jerk) for ends in ((a, b), (b, c)))
        whole = first.joined(second)
        assert len(whole) == len(first) + len(second) - 1
        assert np.array_equal(whole.t, [*first.t, *(second.t[1:] + first.t[-1])])
        assert (whole.qdd is None) == (jerk is None)
        assert rd.check(panda, whole, jerk_limits=jerk).findings == []
        late = np.linspace(0.0, second.t[-1], 50)
        for own, its in zip(whole.sample(first.t[-1] + late[1:-1]), second.sample(late[1:-1]), strict=True):
            assert np.allclose(own, its, atol=1e-6 * (1 + np.abs(its).max()))
    with pytest.raises(ValueError, match=r"position of joint 'panda_joint1' is 0\.2 .* and 0 "):
        first.joined(first)
    moving = rd.Trajectory(second.joint_names, second.t, second.q, second.qd + 0.1)
    with pytest.raises(ValueError, match="velocity of joint 'panda_joint1'"):
        first.joined(moving)
    with pytest.raises(ValueError, match="joints of the two motions"):
        first.joined(rd.Trajectory(["other"], [0.0], [[0.0]]))
