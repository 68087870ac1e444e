"""The swivel along a whole path: `plan_swivel` beside a plain numpy grid search and ssik's `solve_path`, in one run.

The raster of `bench_planning.py` on the iiwa14, 1 000 poses. The grid search is what a user writes: 360 swivels x 8
branches, dynamic programming over neighbouring points, the planner's own cost. Its configurations come from this
library's closed form, within the limits, so that only the search is numpy's; steps of up to 15 degrees of swivel.
"""

import resource
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

import redundancy as rd

sys.path.insert(0, str(Path(__file__).parent))
from bench_planning import raster, row, ssik_arm, tracks
from neighbours import Array, machine, medians, optional, table

SWIVELS = 360
REACH = 15
MOTION = 0.5
HEAD = ("planner", "cost", "time", "legal", "margin", "joint path", "peak speed", "largest step", "FK error")


def limit_cost(chain: rd.Chain, q: Array) -> Array:
    """The planner's price of being near to the limits, per configuration."""
    x = (2 * q - chain.lower - chain.upper) / (chain.upper - chain.lower)
    near = np.minimum(x**2 / np.maximum(1 - x**2, 1e-9), 1e3)
    return np.asarray((near**2).sum(axis=-1))


def cost(chain: rd.Chain, path: rd.Path, q: Array) -> float:
    """What the planner minimises, without a scene or a wish."""
    parts = np.diff(path.t) / (path.t[-1] - path.t[0])
    shares = np.convolve(parts, [0.5, 0.5])
    steps = (np.diff(q, axis=0) ** 2).sum(axis=1)
    return float((shares * limit_cost(chain, q)).sum() + MOTION * (steps / parts).sum())


def grid_search(arm: rd.SrsArm, path: rd.Path) -> Array:
    """Dynamic programming in numpy over points x branches x swivels; the joint rows of the cheapest line."""
    chain, poses, n = arm.chain, path.poses, len(path)
    s = np.linspace(-np.pi, np.pi, SWIVELS, endpoint=False)
    parts = np.diff(path.t) / (path.t[-1] - path.t[0])
    shares = np.convolve(parts, [0.5, 0.5])
    offsets = np.arange(-REACH, REACH + 1)
    around = (np.arange(SWIVELS)[:, None] + offsets) % SWIVELS
    rows, came = np.empty((n, 8, SWIVELS, 7)), np.empty((n, 8, SWIVELS), int)
    for k in range(n):
        found = arm.solve_batch(np.broadcast_to(poses[k], (SWIVELS, 4, 4)), s)
        q, valid = found.q.transpose(1, 0, 2), found.valid.T
        place = np.where(valid, shares[k] * limit_cost(chain, q), np.inf)
        if k == 0:
            total = place
        else:
            steps = ((q[:, :, None] - rows[k - 1][:, around]) ** 2).sum(axis=-1)
            options = total[:, around] + MOTION / parts[k - 1] * steps
            best = options.argmin(axis=2)
            came[k] = around[np.arange(SWIVELS)[None], best]
            total = np.take_along_axis(options, best[:, :, None], axis=2)[:, :, 0] + place
        rows[k] = q
    branch, cell = np.unravel_index(total.argmin(), total.shape)
    line = np.empty((n, 7))
    for k in range(n - 1, -1, -1):
        line[k] = rows[k, branch, cell]
        cell = came[k, branch, cell]
    return line


def main() -> None:
    """Measure and print."""
    chain = rd.catalog.load("iiwa14")
    arm, path = rd.SrsArm(chain), raster()
    jobs: dict[str, Callable[[int], object]] = {"ours": lambda _: rd.plan_swivel(arm, path)}
    jobs["ours 360"] = lambda _: rd.plan_swivel(arm, path, swivels=SWIVELS)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    seconds = medians(jobs, 1)
    ours_memory = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    others: dict[str, Callable[[int], object]] = {"numpy": lambda _: grid_search(arm, path)}
    ssik = optional("ssik")
    if ssik is not None:
        other = ssik_arm(ssik, chain)
        others["ssik"] = lambda _: other.solve_path(path.poses)
    seconds |= medians(others, 1, rounds=3)
    numpy_memory = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    lines = {
        "ours": ("`plan_swivel`, as it is", rd.plan_swivel(arm, path).q),
        "ours 360": (f"`plan_swivel`, {SWIVELS} swivels", rd.plan_swivel(arm, path, swivels=SWIVELS).q),
        "numpy": ("numpy grid search", grid_search(arm, path)),
    }
    if ssik is not None:
        every = tracks(other, path.poses)
        lines["ssik"] = (
            f"ssik `solve_path`, cheapest of {len(every)}",
            min(every, key=lambda q: cost(chain, path, q)),
        )
    report = []
    for key, (name, q) in lines.items():
        figures = row(name, chain, path, q, seconds[key])
        report.append([figures[0], f"{cost(chain, path, q):.2f}", *figures[1:]])
    print(f"iiwa14, raster of {len(path)} poses, {path.length:.2f} m\n")
    print(table(HEAD, report))
    same = cost(chain, path, lines["ours 360"][1]) <= cost(chain, path, lines["numpy"][1])
    print(f"\nCost at most that of the grid search: {'yes' if same else 'NO'}.")
    for key in seconds:
        print(f"Time of {key}: {seconds[key] / seconds['ours 360']:.1f} times ours at {SWIVELS} swivels.")
    print(f"Memory added by ours {ours_memory:.0f} MB, by all {numpy_memory:.0f} MB.")
    print(f"Medians of one run of `python benches/python/bench_swivel.py`; {machine()}.")


if __name__ == "__main__":
    main()
