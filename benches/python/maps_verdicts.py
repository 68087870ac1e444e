"""Stored verdicts of random cells of a map against brute force: no false positive, no false negative.

    python benches/python/maps_verdicts.py [cells]        # 20 000 by default, 1e6 for the full size

A map is filled, random cells of it are drawn, and each stored `reachable` is checked without the code that decided it:

- *Yes*: a witness. The closed form is solved at fixed values of its parameter (swivel, joint 7), more and more of them,
  until one has a configuration within the limits; that is put through the forward kinematics. Cells whose feasible part
  lies between all those values are searched around the values that miss the limits least. What is narrower still
  (`narrow`) takes the configuration that the map's own code names: limits and forward kinematics judge it as well.
- *No*: the closed form without limits at all of those values, each branch; around the three values that miss the limits
  least the search is repeated on finer and finer grids. No configuration within the limits may turn up. A range of
  joint 7 between two values at which the wrist is out of reach would not be seen; the swivel has no such ranges.
"""

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import redundancy as rd

VALUES = 256
"""Values of the parameter in the coarse scan."""
ZOOMS = 8
"""Times that the grid around the best values is made eight times as fine."""
SAME = 8
"""Values of the swivel after which a pose without any branch is out of reach."""
BLOCK = 20_000
AT_LIMIT = 1e-9
"""Misses (rad) below which yes and no are the same up to rounding; cells that are so near to a limit are counted."""


class BruteForce:
    """Configurations of an arm over poses, from the closed form at single values of its parameter."""

    def __init__(self, name: str) -> None:
        self.chain = rd.catalog.load(name)
        self.arm: Any = rd.closed_form(self.chain)
        half = 0.5 * (self.chain.upper - self.chain.lower)
        self.center, self.half = self.chain.lower + half, np.where(half < np.pi, half, np.inf)

    def miss(self, poses: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[Any, Any]:
        """Least miss `(N,)` of the limits over all branches (negative inside, `inf`: no branch), and its joints."""
        found = self.arm.solve_batch(poses, values, limits=False)
        apart = np.abs((found.q - self.center + np.pi) % (2.0 * np.pi) - np.pi)
        own = np.where(found.valid, (apart - self.half).max(axis=2), np.inf)
        branch = own.argmin(axis=1)
        rows = np.arange(len(poses))
        return own[rows, branch], found.q[rows, branch]

    def narrow(self, pose: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """The least miss in the middles of the feasible parts that the closed form names, and its joints."""
        best = (np.inf, np.zeros(7))
        for piece in rd.solutions(self.chain, pose).pieces:
            for lo, hi in piece.intervals(0.0):
                q = piece.q(0.5 * (lo + hi))
                miss = float(np.maximum(self.chain.lower - q, q - self.chain.upper).max())
                best = min(best, (miss, q), key=lambda found: found[0])
        return best

    def judge(self, poses: NDArray[np.float64], wanted: NDArray[np.bool_]) -> tuple[Any, Any]:
        """The least miss `(N,)` that is found, and its joints; stops at a witness for cells where one is wanted."""
        count = len(poses)
        least = np.full((count, 3), np.inf)
        at = np.zeros((count, 3))
        joints = np.zeros((count, 7))
        # Bits in reverse order: every share of the scan is spread over the whole turn.
        bits = int(np.log2(VALUES))
        order = [int(format(k, f"0{bits}b")[::-1], 2) for k in range(VALUES)]
        out = np.zeros(count, dtype=bool)
        for round_, k in enumerate(order):
            value = -np.pi + 2.0 * np.pi * (k + 0.5) / VALUES
            open_ = np.flatnonzero(~out & ~(wanted & (least[:, 0] < 0.0)))
            if not len(open_):
                break
            if round_ == SAME and self.arm.parameter == "swivel":
                out |= np.isinf(least[:, 0])  # the swivel does not change whether the wrist is in reach
            self._offer(poses, open_, np.full(len(open_), value), least, at, joints)
        step = 2.0 * np.pi / VALUES
        for _ in range(ZOOMS):
            open_ = np.flatnonzero(np.isfinite(least[:, 0]) & ~(wanted & (least[:, 0] < 0.0)))
            before = at[open_].copy()
            step /= 8.0
            for start in before.T:
                for k in range(-8, 9):
                    self._offer(poses, open_, start + k * step, least, at, joints, apart=4.0 * step)
        return least[:, 0], joints

    def _offer(
        self, poses: Any, rows: Any, values: Any, least: Any, at: Any, joints: Any, apart: float = 0.0
    ) -> None:
        """Keeps the three best values of each cell; those closer than `apart` to a kept one replace it."""
        miss, q = self.miss(poses[rows], values)
        best = miss < least[rows, 0]
        joints[rows[best]] = q[best]
        same = np.abs((at[rows] - values[:, None] + np.pi) % (2 * np.pi) - np.pi) < apart
        near = same & np.isfinite(least[rows])
        slot = np.where(near.any(axis=1), near.argmax(axis=1), least[rows].argmax(axis=1))
        better = miss < least[rows, slot]
        least[rows[better], slot[better]] = miss[better]
        at[rows[better], slot[better]] = values[better]
        order = np.argsort(least[rows], axis=1, kind="stable")
        least[rows] = np.take_along_axis(least[rows], order, axis=1)
        at[rows] = np.take_along_axis(at[rows], order, axis=1)


def check(name: str, cells: int, seed: int = 0) -> bool:
    """Draws cells and compares; True when every verdict is confirmed."""
    brute = BruteForce(name)
    chain = brute.chain
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory(prefix="maps-") as folder:
        # About twice as many poses as cells are drawn, on a grid without the symmetry of the arm.
        per_axis = max(2, round((2.0 * cells / 60) ** (1 / 3)))
        corner = rng.uniform((-0.66, -0.66, -0.36), (-0.64, -0.64, -0.34))
        region = tuple((lo, lo + 1.3) for lo in corner)
        job = rd.maps.capability(
            chain,
            Path(folder) / "map.zarr",
            1.3 / (per_axis - 1) * (1 - 1e-12),
            60,
            metrics=("reachable",),
            region=region,
        )
        found = job.open()
        poses_of = [found.poses(k).shape[0] for k in range(job.chunks)]
        drawn = np.sort(rng.choice(sum(poses_of), min(cells, sum(poses_of)), replace=False))
        first, begin = 0, time.process_time()
        total = {
            "yes": 0,
            "no": 0,
            "out of reach": 0,
            "false yes": 0,
            "false no": 0,
            "at a limit": 0,
            "narrow": 0,
        }
        worst = 0.0
        for k, count in enumerate(poses_of):
            mine = drawn[(drawn >= first) & (drawn < first + count)] - first
            first += count
            poses, stored = found.poses(k)[mine], found.chunk(k)["reachable"].ravel()[mine]
            for lo in range(0, len(mine), BLOCK):
                given, said = poses[lo : lo + BLOCK], stored[lo : lo + BLOCK]
                miss, q = brute.judge(given, said)
                missing = np.flatnonzero(said & ~(miss < 0.0))
                for (
                    row
                ) in missing:  # narrower than the scan: a witness of whatever origin, judged all the same
                    miss[row], q[row] = brute.narrow(given[row])
                total["narrow"] += len(missing)
                near = np.abs(miss) < AT_LIMIT
                total["yes"] += int(said.sum())
                total["no"] += int((~said).sum())
                total["out of reach"] += int((~said & np.isinf(miss)).sum())
                total["at a limit"] += int(near.sum())
                total["false yes"] += int((said & (miss > 0.0) & ~near).sum())
                total["false no"] += int((~said & (miss < 0.0) & ~near).sum())
                if said.any():
                    error = np.abs(chain.forward(q[said]) - given[said]).max(axis=(1, 2))
                    worst = max(worst, float(error.max()))
        spent = time.process_time() - begin
        print(
            f"{name}: {len(drawn)} cells of {sum(poses_of)}: {total}; forward kinematics of the witnesses within "
            f"{worst:.1e}; {spent:.0f} s of CPU time"
        )
    return total["false yes"] == 0 and total["false no"] == 0 and worst < 1e-9


if __name__ == "__main__":
    number = round(float(sys.argv[1] if len(sys.argv) > 1 else 20_000))
    verdicts = [check(arm, number) for arm in ("iiwa14", "panda")]
    sys.exit(0 if all(verdicts) else 1)
