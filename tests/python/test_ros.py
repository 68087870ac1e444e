"""ROS messages in bags: what is written is read again, and by `rosbags` itself; bad input."""

import numpy as np
import pytest

import redundancy as rd

pytest.importorskip("rosbags")
from redundancy import ros

PANDA = rd.catalog.load("panda")
A, B = [0, 0.3, 0, -1, 0.2, 1, 0], [1.5, 0.5, 0, -1.4, 0.2, 1.2, 0.3]


@pytest.mark.parametrize(("name", "storage"), [("move.bag", "mcap"), ("move", "mcap"), ("move", "sqlite3")])
def test_trajectories_are_read_as_written(name, storage, tmp_path):
    for jerk in (None, 500.0):
        move = rd.joint_move(PANDA, A, B, jerk_limits=jerk)
        file = tmp_path / f"{jerk}_{name}"
        ros.write_trajectory(file, move, storage=storage)
        again = ros.read_trajectory(file)
        assert again.joint_names == move.joint_names
        assert np.abs(again.t - move.t).max() <= 1e-9
        assert np.array_equal(again.q, move.q)
        assert np.array_equal(again.qd, move.qd)
        assert (again.qdd is None) == (jerk is None)
        assert rd.check(PANDA, again, jerk_limits=None if jerk is None else [jerk] * 7).ok


@pytest.mark.parametrize("name", ["path.bag", "path"])
def test_poses_are_read_as_written(name, tmp_path):
    path = rd.paths.circle((0.5, 0, 0.4), 0.1, orientation=np.diag([1.0, -1, -1]), n=40)
    ros.write_poses(tmp_path / name, path, topic="/weld")
    again = ros.read_poses(tmp_path / name, topic="/weld")
    assert np.abs(again.poses - path.poses).max() < 1e-12


def test_rosbags_reads_the_fields(tmp_path):
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    move = rd.joint_move(PANDA, A, B, jerk_limits=500.0)
    ros.write_trajectory(tmp_path / "bag", move, topic="/arm", frame_id="world")
    with AnyReader([tmp_path / "bag"], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        ((connection, _, raw),) = reader.messages()
        message = reader.deserialize(raw, connection.msgtype)
    assert (connection.topic, message.header.frame_id) == ("/arm", "world")
    last = message.points[-1]
    assert np.allclose(last.positions, B)
    assert last.time_from_start.sec + 1e-9 * last.time_from_start.nanosec == pytest.approx(move.t[-1])


def test_bad_input_is_named(tmp_path):
    move = rd.joint_move(PANDA, A, B)
    ros.write_trajectory(tmp_path / "bag", move, topic="/arm")
    with pytest.raises(rd.FileFormatError, match="exists"):
        ros.write_trajectory(tmp_path / "bag", move)
    with pytest.raises(rd.FileFormatError, match=r"PoseArray.*holds /arm"):
        ros.read_poses(tmp_path / "bag")
    with pytest.raises(rd.FileFormatError, match="no trajectory_msgs"):
        ros.read_trajectory(tmp_path / "bag", topic="/other")
    with pytest.raises(rd.FileFormatError, match="none"):
        ros.read_trajectory(tmp_path / "none")
    with pytest.raises(ValueError, match="storage"):
        ros.write_trajectory(tmp_path / "other", move, storage="text")
