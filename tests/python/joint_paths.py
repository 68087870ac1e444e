"""Two hundred joint paths that `retime` is measured on: random smooth ones, rasters with corners, the golden paths."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import redundancy as rd

Array = NDArray[np.float64]
GOLDEN = Path(__file__).parent.parent / "golden" / "joint_paths.npz"
SMOOTH, RASTERS = 110, 84
ARMS = ("panda", "iiwa14", "fr3", "ur5e", "gen3")
DOWN = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True)
class JointPath:
    """A joint path with the limits of its arm; `torque` is None where the arm has no masses or no limits."""

    name: str
    chain: rd.Chain
    q: Array
    acceleration: Array
    torque: Array | None


def random_smooth(chain: rd.Chain, rows: int, seed: int) -> tuple[Array, Array]:
    """Sums of sines within the joint limits at `rows` places, and their coefficients (4, n) after the middle."""
    rng = np.random.default_rng(seed)
    n = chain.dof
    lower, upper = np.maximum(chain.lower, -3.0), np.minimum(chain.upper, 3.0)
    size = 0.45 * (upper - lower)
    waves = np.stack(
        [
            0.5 * (lower + upper),
            size * rng.uniform(0.1, 0.6, n),
            rng.uniform(1, 4, n),
            rng.uniform(-3, 3, n),
            size * rng.uniform(0, 0.25, n),
            rng.uniform(2, 7, n),
        ]
    )
    return curve(np.linspace(0, 1, rows), waves), waves


def curve(u: Array, waves: Array) -> Array:
    """The rows of a random smooth path at `u`."""
    middle, a, f, phase, b, g = waves
    u = np.asarray(u)[:, None]
    return middle + a * np.sin(f * u + phase) + b * np.cos(g * u)


def acceleration_limits(chain: rd.Chain) -> Array:
    """Of the chain; 10 rad/s^2 where it has none."""
    return np.where(np.isfinite(chain.acceleration_limit), chain.acceleration_limit, 10.0)


def torque_limits(chain: rd.Chain, q: Array) -> Array | None:
    """Efforts of the chain, at least a fifth more than holding the arm along the path needs."""
    if not np.all(np.isfinite(chain.effort_limit)):
        return None
    zero = np.zeros(chain.dof)
    try:
        weight = np.abs([chain.inverse_dynamics(row, zero, zero) for row in q]).max(axis=0)
    except ValueError:
        return None
    return np.maximum(chain.effort_limit, 1.2 * weight)


def _raster(index: int) -> tuple[rd.Chain, Array]:
    """A raster from the pose of a random posture, sharp or rounded, that the branch of that posture follows."""
    rng = np.random.default_rng(5000 + index)
    name = ("iiwa14", "panda", "ur5e")[index % 3]
    chain = rd.catalog.load(name)
    corner = (None, 0.04, 0.08)[(index // 3) % 3]
    middle = 0.5 * (np.maximum(chain.lower, -2.5) + np.minimum(chain.upper, 2.5))
    middle[[1, 3]] += {"iiwa14": (0.5, -1.4), "panda": (0.0, -0.3), "ur5e": (-1.2, -1.2)}[name]
    while True:
        start = middle + rng.uniform(-0.4, 0.4, chain.dof)
        pose = chain.forward(start)
        path = rd.paths.raster(
            pose[:3, 3],
            rng.uniform(0.2, 0.3),
            rng.uniform(0.1, 0.13),
            int(rng.integers(2, 4)),
            corner=corner,
            orientation=pose[:3, :3],
            step=(0.002, 0.005)[index % 2],
            along=pose[:3, 0],
            across=pose[:3, 1],
        )
        q = _followed(name, chain, path, start)
        if len(q) == len(path):
            return chain, q


def _followed(name: str, chain: rd.Chain, path: rd.Path, start: Array) -> Array:
    """Rows of the branch of `start` as far as it goes without a jump."""
    arms: dict[str, Any] = {"iiwa14": rd.SrsArm, "panda": rd.PandaClassArm, "ur5e": rd.ParallelAxesArm}
    arm = arms[name](chain)
    kept = {"iiwa14": lambda: (arm.swivel(start),), "panda": lambda: (start[6],), "ur5e": tuple}[name]()
    rows = [start]
    for pose in path.poses[1:]:
        found = arm.solve(pose, *kept)
        steps = np.abs(found - rows[-1]).max(axis=1, initial=0.0)
        if len(found) == 0 or steps.min() > 0.1:
            break
        rows.append(found[np.argmin(steps)])
    return np.array(rows)


def joint_path(index: int) -> JointPath:
    """Path `index` of 200."""
    if index < SMOOTH:
        chain = rd.catalog.load(ARMS[index % len(ARMS)])
        q, _ = random_smooth(chain, (100, 200, 300, 500, 1000)[index // 5 % 5], index)
        name = f"smooth_{index}"
    elif index < SMOOTH + RASTERS:
        chain, q = _raster(index - SMOOTH)
        name = f"raster_{index - SMOOTH}"
    else:
        with np.load(GOLDEN) as golden:
            name = sorted(golden.files)[index - SMOOTH - RASTERS]
            q = golden[name]
        chain = rd.catalog.load(name.split("_")[0])
    torque = torque_limits(chain, q)
    return JointPath(name, chain, q, acceleration_limits(chain), torque)


COUNT = 200
