"""Where the parts of an arm are: segments between its frames, joints as short cylinders, the elbow."""

import numpy as np
from numpy.typing import NDArray

import redundancy as rd

Array = NDArray[np.float64]

ON_AXIS = 1e-9
"""Distance of a frame's origin from a joint's axis below which it lies on it, m."""
NO_LENGTH = 1e-9
"""Length below which two frames have the same origin, m."""
LINK_RADIUS = 0.05
"""Radius of the links as capsules, m: the library's default."""


class Body:
    """What is drawn of an arm.

    Args:
        chain: The arm.
    """

    def __init__(self, chain: rd.Chain) -> None:
        self.chain = chain
        self.names = chain.link_names
        self.joints_before = self._joints_before()
        origins = self.origins(np.zeros(chain.dof))
        self.reach = max(float(np.linalg.norm(np.diff(origins, axis=0), axis=1).sum()), NO_LENGTH)
        self.radius = min(LINK_RADIUS, 0.05 * self.reach)

    def frames(self, q: Array) -> Array:
        """Poses `(len(names) + 1, 4, 4)` of the frames, the tool last."""
        return np.array([*(self.chain.forward(q, link=name) for name in self.names), self.chain.forward(q)])

    def origins(self, q: Array) -> Array:
        """Origins of the frames, `(len(names) + 1, 3)`."""
        return self.frames(q)[:, :3, 3]

    def elbow(self, rows: Array) -> tuple[str, Array]:
        """The frame that moves most over rows of configurations at one pose: its name and positions `(N, 3)`."""
        points = [self.chain.forward(rows, link=name)[:, :3, 3] for name in self.names]
        spread = [float(np.linalg.norm(np.ptp(p, axis=0))) for p in points]
        # Frames that move together have equal spreads up to rounding: the first of them is the elbow.
        most = int(np.flatnonzero(np.array(spread) >= max(spread) * (1.0 - 1e-6))[0])
        return self.names[most], points[most]

    def joints(self, q: Array) -> tuple[Array, Array]:
        """A point of each joint's axis, and its direction: `(n, 3)` twice."""
        frames = self.frames(q)
        pose, jacobian = self.chain.kinematics(q)
        points, axes = np.empty((self.chain.dof, 3)), np.empty((self.chain.dof, 3))
        for j in range(self.chain.dof):
            turning = jacobian[3:, j]
            if np.linalg.norm(turning) < 0.5:  # a sliding joint
                axes[j] = jacobian[:3, j]
                points[j] = frames[self.frame_after(j)][:3, 3]
                continue
            axes[j] = turning
            through = pose[:3, 3] + np.cross(turning, jacobian[:3, j])
            after, before = (frames[k][:3, 3] for k in (self.frame_after(j), self.frame_after(j - 1)))
            points[j] = self._on_axis(after, before, through, turning)
        return points, axes

    def _on_axis(self, after: Array, before: Array, through: Array, axis: Array) -> Array:
        """The origin of the frame after the joint if it lies on the axis, else of the one before, else a projection."""
        for origin in (after, before):
            if np.linalg.norm(np.cross(origin - through, axis)) < ON_AXIS * max(1.0, self.reach):
                return origin
        return through + axis * float(axis @ (after - through))

    def frame_after(self, joint: int) -> int:
        """Index of the first frame that joint `joint` moves; the base for -1."""
        return int(np.flatnonzero(self.joints_before == joint + 1)[0]) if joint >= 0 else 0

    def _joints_before(self) -> NDArray[np.int64]:
        """Number of joints before each frame."""
        q = np.zeros(self.chain.dof)
        columns = (np.abs(self.chain.jacobian(q, link=name)).max(axis=0) > 0.0 for name in self.names)
        return np.array([int(np.flatnonzero(c)[-1]) + 1 if c.any() else 0 for c in columns])


def segments(origins: Array) -> Array:
    """Straight parts between origins `(K, 3)` that are apart: `(M, 2, 3)`."""
    ends = np.stack([origins[:-1], origins[1:]], axis=1)
    keep: Array = ends[np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > NO_LENGTH]
    return keep


def rods(ends: Array, radius: float) -> tuple[Array, Array, Array]:
    """Unit cylinders (radius 1, z from -1/2 to 1/2) as segments `(M, 2, 3)`: quaternions wxyz, centres, scales."""
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    scales = np.column_stack([np.full((len(ends), 2), radius), length])
    return turned_z(along / np.maximum(length, NO_LENGTH)[:, None]), ends.mean(axis=1), scales


def turned_z(axes: Array) -> Array:
    """Quaternions wxyz `(M, 4)` that turn z to unit vectors `(M, 3)`."""
    w = 1.0 + axes[:, 2]
    back = w < 1e-6
    out = np.column_stack([w, -axes[:, 1], axes[:, 0], np.zeros(len(axes))])
    out[back] = (0.0, 1.0, 0.0, 0.0)
    unit: Array = out / np.linalg.norm(out, axis=1)[:, None]
    return unit
