"""The curve through 1 000 poses, built and evaluated at 10 000 places: this library beside scipy, in one run.

scipy's pair is `CubicSpline` for positions and `RotationSpline` for orientations, both C2 as ours.
"""

import statistics
import time
from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

import redundancy as rd

REPEATS = 7


def median(work: Callable[[], object]) -> float:
    """Seconds, median over repeats; the first call is not counted."""
    work()
    seconds = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - begin)
    return statistics.median(seconds)


def main() -> None:
    s = np.linspace(0, 2, 1_000)
    exact = Rotation.from_rotvec(np.column_stack([s, np.sin(3 * s), 0.2 * s**2]))
    poses = np.tile(np.eye(4), (len(s), 1, 1))
    poses[:, :3, :3] = exact.as_matrix()
    poses[:, :3, 3] = np.column_stack([np.sin(s), np.cos(2 * s), 0.3 * s])
    at = np.random.default_rng(0).uniform(0, 2, 10_000)

    path, positions, rotations = (
        rd.Path(poses, s=s),
        CubicSpline(s, poses[:, :3, 3]),
        RotationSpline(s, exact),
    )
    truth = Rotation.from_rotvec(np.column_stack([at, np.sin(3 * at), 0.2 * at**2]))

    def error(found: Rotation) -> float:
        return float((found.inv() * truth).magnitude().max())

    rows = {
        "build": (
            median(lambda: rd.Path(poses, s=s)),
            median(
                lambda: (
                    CubicSpline(s, poses[:, :3, 3]),
                    RotationSpline(s, Rotation.from_matrix(poses[:, :3, :3])),
                )
            ),
        ),
        "pose": (median(lambda: path.pose(at)), median(lambda: (positions(at), rotations(at).as_matrix()))),
        "derivatives": (
            median(lambda: path.derivatives(at)),
            median(lambda: [(positions(at, k), rotations(at, k)) for k in (1, 2)]),
        ),
    }
    print(f"{'':12} {'redundancy':>12} {'scipy':>12} {'ratio':>7}")
    for name, (ours, theirs) in rows.items():
        print(f"{name:12} {1e3 * ours:9.3f} ms {1e3 * theirs:9.3f} ms {theirs / ours:7.1f}")
    ours, theirs = error(Rotation.from_matrix(path.pose(at)[:, :3, :3])), error(rotations(at))
    print(f"largest orientation error between samples: {ours:.1e} rad, scipy {theirs:.1e} rad")


if __name__ == "__main__":
    main()
