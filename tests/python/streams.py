"""Runs of the servo on stored streams, judged by joint positions alone, with pinocchio."""

import importlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import redundancy as rd

FOLDER = Path(__file__).parents[1] / "golden/streams"
DT = 0.004
ENDS = {"iiwa14": ("lbr_iiwa_link_0", "lbr_iiwa_link_7"), "panda": ("panda_link0", "panda_link8")}
ACCELERATION = {"iiwa14": np.full(7, 10.0), "panda": np.array([15, 7.5, 10, 12.5, 15, 20, 20.0])}
Array = NDArray[np.float64]


def chain_of(arm: str) -> rd.Chain:
    base, tip = ENDS[arm]
    return rd.Chain.from_urdf(FOLDER / f"{arm}.urdf", base=base, tip=tip)


def stream_of(arm: str, name: str) -> dict[str, Array]:
    stream = dict(np.load(FOLDER / f"{arm}_{name}.npz"))
    stream.setdefault("meant", stream["target"])
    return stream


def matrix(row: Array) -> Array:
    return rd.pose(row[:3], quaternion_wxyz=row[3:])


def servo_of(arm: str, stream: dict[str, Array], **options: Any) -> rd.Servo:
    """One setting for all streams."""
    limits = ACCELERATION[arm]
    reference = stream.get("swivel_reference")
    servo = rd.Servo(
        chain_of(arm),
        DT,
        acceleration_limits=limits,
        jerk_limits=100 * limits,
        swivel_reference=reference,
        **options,
    )
    servo.reset(stream["start"])
    return servo


def follow(servo: rd.Servo, stream: dict[str, Array]) -> Array:
    swivel = stream.get("desired_swivel")
    rows = []
    for k, row in enumerate(stream["target"]):
        tick = servo.update(matrix(row), desired_swivel=None if swivel is None else float(swivel[k]))
        rows.append(tick.q)
    return np.array(rows)


class Run:
    """Errors and differences of the joint positions of a run."""

    def __init__(self, arm: str, stream: dict[str, Array], q: Array) -> None:
        pinocchio = importlib.import_module("pinocchio")
        model = pinocchio.buildModelFromUrdf(str(FOLDER / f"{arm}.urdf"))
        data = model.createData()
        frame = model.getFrameId(ENDS[arm][1])
        position, rotation, off = [], [], []
        for k, row in enumerate(q):
            pinocchio.framesForwardKinematics(model, data, np.r_[row, np.zeros(model.nq - 7)])
            position.append(data.oMf[frame].translation.copy())
            rotation.append(data.oMf[frame].rotation.copy())
            if "desired_elbow" in stream:
                shoulder, elbow, wrist = (data.oMi[i].translation for i in (2, 4, 6))
                line = (wrist - shoulder) / np.linalg.norm(wrist - shoulder)
                a, b = elbow - shoulder, stream["desired_elbow"][k] - shoulder
                a, b = a - line * (line @ a), b - line * (line @ b)
                off.append(np.degrees(abs(np.arctan2(line @ np.cross(a, b), a @ b))))
        meant = stream["meant"]
        self.position = np.array(position)
        self.error = np.linalg.norm(self.position - meant[:, :3], axis=1)
        turn = [
            r @ rd.quaternion.to_matrix(row[3:]).T for r, row in zip(np.array(rotation), meant, strict=True)
        ]
        cosine = (np.trace(np.array(turn), axis1=1, axis2=2) - 1) / 2
        self.angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
        self.elbow = np.array(off)
        rows = np.vstack([np.repeat(stream["start"][None], 3, axis=0), q])
        chain = chain_of(arm)
        self.velocity = np.diff(rows, axis=0) / DT / chain.velocity_limit
        limits = ACCELERATION[arm]
        self.acceleration = np.diff(rows, 2, axis=0) / DT**2 / limits
        self.jerk = np.diff(rows, 3, axis=0) / DT**3 / limits
        self.outside = max((chain.lower - q).max(), (q - chain.upper).max())
        moved = np.abs(np.diff(rows[2:], axis=0)).max(axis=1) > 1e-9
        wanted = np.r_[True, np.abs(np.diff(stream["target"], axis=0)).max(axis=1) > 0]
        reachable = stream["reachable"].astype(bool)
        behind = (self.error > 2e-3) | (self.angle > 0.5)
        self.frozen = int((~moved & behind & (wanted | reachable)).sum())

    def assert_legal(self) -> None:
        assert self.outside <= 1e-9
        assert np.abs(self.velocity).max() <= 1 + 1e-9
        assert np.abs(self.acceleration).max() <= 1 + 1e-9
        assert np.abs(self.jerk).max() <= 100 * (1 + 1e-6)

    def recovered(self, row: int) -> float:
        """Time from a row until 0.2 s below 5 mm and 1 degree begin."""
        good = (self.error < 5e-3) & (self.angle < 1.0)
        for k in range(row, len(good) - 50):
            if good[k : k + 50].all():
                return (k - row) * DT
        return np.inf
