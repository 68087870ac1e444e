"""ROS messages without ROS: trajectories and paths in bags and MCAP, through `rosbags` (extra `ros`).

`trajectory_msgs/JointTrajectory` carries a `Trajectory`, `geometry_msgs/PoseArray` the poses of a `Path`. A file that
ends in `.bag` is a ROS 1 bag; any other name is the folder of a ROS 2 bag, with MCAP or SQLite in it.

Example:
    >>> import redundancy as rd
    >>> from redundancy import ros
    >>> move = rd.joint_move(rd.catalog.load("panda"), [0] * 3 + [-1.5, 0, 1.5, 0], [0.5] * 3 + [-1.5, 0, 1.5, 0])
    >>> ros.write_trajectory("move", move)  # doctest: +SKIP
    >>> ros.read_trajectory("move").joint_names == move.joint_names  # doctest: +SKIP
    True
"""

from collections.abc import Iterator
from pathlib import Path as File
from typing import Any, Literal

import numpy as np

import redundancy as rd
from redundancy.quaternion import from_matrix

JOINT_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
POSE_ARRAY = "geometry_msgs/msg/PoseArray"
NANOSECONDS = 1_000_000_000

Storage = Literal["mcap", "sqlite3"]


def write_trajectory(
    file: str | File,
    trajectory: rd.Trajectory,
    *,
    topic: str = "/joint_trajectory",
    frame_id: str = "",
    storage: Storage = "mcap",
) -> None:
    """Writes a trajectory as one `trajectory_msgs/JointTrajectory` message.

    Args:
        file: a `.bag` file, or the folder of a ROS 2 bag; it must not exist.
        trajectory: positions, velocities, and accelerations where it has them; times are rounded to 1 ns.
        topic: the topic of the message.
        frame_id: of its header.
        storage: what a ROS 2 bag holds.

    Raises:
        FileFormatError: the file exists, or cannot be written.
        ImportError: `rosbags` is missing.
    """
    store = _typestore(file)
    types = store.types
    none = np.array([], dtype=np.float64)
    points = []
    for k, t in enumerate(trajectory.t - trajectory.t[0]):
        nanoseconds = round(float(t) * NANOSECONDS)
        points.append(
            types["trajectory_msgs/msg/JointTrajectoryPoint"](
                positions=np.array(trajectory.q[k]),
                velocities=np.array(trajectory.qd[k]),
                accelerations=none if trajectory.qdd is None else np.array(trajectory.qdd[k]),
                effort=none,
                time_from_start=types["builtin_interfaces/msg/Duration"](*divmod(nanoseconds, NANOSECONDS)),
            )
        )
    message = types[JOINT_TRAJECTORY](
        header=_header(types, frame_id), joint_names=list(trajectory.joint_names), points=points
    )
    _write(file, store, topic, JOINT_TRAJECTORY, message, storage)


def read_trajectory(file: str | File, *, topic: str | None = None) -> rd.Trajectory:
    """The first `trajectory_msgs/JointTrajectory` of a bag.

    Args:
        file: a `.bag` file or the folder of a ROS 2 bag.
        topic: its topic; without it the first message of that type is taken.

    Raises:
        FileFormatError: no bag, no such message, or points without positions.
        ImportError: `rosbags` is missing.
    """
    message = _read(file, JOINT_TRAJECTORY, topic)
    n, points = len(message.joint_names), message.points

    def rows(name: str) -> np.ndarray | None:
        lengths = {len(getattr(point, name)) for point in points}
        if lengths == {n}:
            return np.array([getattr(point, name) for point in points], dtype=np.float64)
        if lengths <= {0} and name != "positions":
            return None
        raise rd.FileFormatError(f"{file}: {name} have {sorted(lengths)} entries, there are {n} joints")

    q = rows("positions")
    times = [point.time_from_start for point in points]
    t = [time.sec + time.nanosec / NANOSECONDS for time in times]
    assert q is not None
    return rd.Trajectory(list(message.joint_names), t, q, rows("velocities"), qdd=rows("accelerations"))


def write_poses(
    file: str | File,
    path: rd.Path,
    *,
    topic: str = "/path",
    frame_id: str = "base_link",
    storage: Storage = "mcap",
) -> None:
    """Writes the poses of a path as one `geometry_msgs/PoseArray` message; its times and lengths are not in it.

    Args:
        file: a `.bag` file, or the folder of a ROS 2 bag; it must not exist.
        path: the path; a path of positions has the identity for orientations.
        topic: the topic of the message.
        frame_id: the frame of the poses.
        storage: what a ROS 2 bag holds.

    Raises:
        FileFormatError: the file exists, or cannot be written.
        ImportError: `rosbags` is missing.
    """
    store = _typestore(file)
    types = store.types
    poses = []
    for pose in path.poses:
        w, x, y, z = (float(part) for part in from_matrix(pose[:3, :3]))
        poses.append(
            types["geometry_msgs/msg/Pose"](
                position=types["geometry_msgs/msg/Point"](*(float(part) for part in pose[:3, 3])),
                orientation=types["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w),
            )
        )
    message = types[POSE_ARRAY](header=_header(types, frame_id), poses=poses)
    _write(file, store, topic, POSE_ARRAY, message, storage)


def read_poses(file: str | File, *, topic: str | None = None) -> rd.Path:
    """The path of the first `geometry_msgs/PoseArray` of a bag, in the frame of the message.

    Args:
        file: a `.bag` file or the folder of a ROS 2 bag.
        topic: its topic; without it the first message of that type is taken.

    Raises:
        FileFormatError: no bag, or no such message.
        RedundancyError: fewer than two poses, quaternions that are not of unit norm.
        ImportError: `rosbags` is missing.
    """
    poses = _read(file, POSE_ARRAY, topic).poses
    positions = [[pose.position.x, pose.position.y, pose.position.z] for pose in poses]
    turns = [pose.orientation for pose in poses]
    return rd.Path(positions=positions, quaternions_wxyz=[[turn.w, turn.x, turn.y, turn.z] for turn in turns])


def _typestore(file: str | File) -> Any:
    """The message types of ROS 1 or ROS 2, whichever the file is of."""
    try:
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise ImportError("redundancy.ros needs rosbags: pip install 'redundancy[ros]'") from error
    return get_typestore(Stores.ROS1_NOETIC if File(file).suffix == ".bag" else Stores.ROS2_HUMBLE)


def _header(types: Any, frame_id: str) -> Any:
    stamp = types["builtin_interfaces/msg/Time"](0, 0)
    header = types["std_msgs/msg/Header"]
    # ROS 1 counts its messages.
    counted = {"seq": 0} if "seq" in header.__dataclass_fields__ else {}
    return header(stamp=stamp, frame_id=frame_id, **counted)


def _write(file: str | File, store: Any, topic: str, kind: str, message: Any, storage: Storage) -> None:
    if File(file).exists():
        raise rd.FileFormatError(f"{file}: exists already, a bag is not overwritten")
    if storage not in {"mcap", "sqlite3"}:
        raise rd.RedundancyError(f"storage is '{storage}', it must be mcap or sqlite3")
    from rosbags.rosbag1 import Writer as Writer1  # noqa: PLC0415 - an extra
    from rosbags.rosbag2 import StoragePlugin, Writer  # noqa: PLC0415

    try:
        if File(file).suffix == ".bag":
            with Writer1(file) as bag:
                connection = bag.add_connection(topic, kind, typestore=store)
                bag.write(connection, 0, store.serialize_ros1(message, kind))
            return
        plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
        with Writer(file, version=9, storage_plugin=plugin) as bag:
            connection = bag.add_connection(topic, kind, typestore=store)
            bag.write(connection, 0, store.serialize_cdr(message, kind))
    except OSError as error:
        raise rd.FileFormatError(f"{file}: {error}") from error


def _messages(file: str | File) -> Iterator[tuple[str, str, Any]]:
    """Topic, type and message of everything in a bag."""
    store = _typestore(file)
    from rosbags.highlevel import AnyReader, AnyReaderError  # noqa: PLC0415 - an extra

    try:
        with AnyReader([File(file)], default_typestore=store) as reader:
            for connection, _, raw in reader.messages():
                yield connection.topic, connection.msgtype, reader.deserialize(raw, connection.msgtype)
    except (AnyReaderError, OSError) as error:
        raise rd.FileFormatError(f"{file}: {error}") from error


def _read(file: str | File, kind: str, topic: str | None) -> Any:
    seen = set()
    for name, what, message in _messages(file):
        if what == kind and topic in {None, name}:
            return message
        seen.add(f"{name} ({what})")
    wanted = kind if topic is None else f"{kind} on {topic}"
    raise rd.FileFormatError(f"{file}: no {wanted}; it holds {', '.join(sorted(seen)) or 'nothing'}")
