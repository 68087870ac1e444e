"""A whole path: the iiwa14 over a raster of full poses, beside ssik's `solve_path`.

1 000 poses at 0.2 m/s: ten strokes along y in +-0.3, x from 0.5 to 0.68, z 0.3, tool down. Margin runs from 0 at a
joint limit (negative outside) to 1 at mid-range; the joint path is the sum of |dq|.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import redundancy as rd

sys.path.insert(0, str(Path(__file__).parent))
from neighbours import Array, axes_and_points, closure, machine, medians, optional, table, time_text

SPEED = 0.2
POINTS = 1_000
STARTS = 24
HEAD = ("planner", "time", "legal", "margin", "joint path", "peak speed", "largest step", "FK error")


def raster() -> rd.Path:
    """The path, with its times."""
    path = rd.paths.raster(
        (0.5, -0.3, 0.3), 0.6, 0.02, 10, along=(0, 1, 0), across=(1, 0, 0), orientation=np.diag([1, -1, -1])
    )
    path = path.resampled(path.length / (POINTS - 1))
    return path.with_times(path.s / SPEED)


def margin(chain: rd.Chain, q: Array) -> float:
    """Least distance from a limit over joints and points, as a share of half the range."""
    half = (chain.upper - chain.lower) / 2
    return float((1 - np.abs(q - (chain.lower + chain.upper) / 2) / half).min())


def row(name: str, chain: rd.Chain, path: rd.Path, q: Array, seconds: float) -> list[str]:
    """What joint rows are worth."""
    steps = np.diff(q, axis=0)
    speed = np.abs(steps) / np.diff(path.t)[:, None]
    room = margin(chain, q)
    return [
        name,
        time_text(seconds),
        "yes" if room >= 0 else "no",
        f"{room:.3f}",
        f"{np.linalg.norm(steps, axis=1).sum():.2f} rad",
        f"{speed.max():.2f} rad/s",
        f"{np.abs(steps).max():.3f} rad",
        f"{closure(chain, q, path.poses):.0e}",
    ]


def ssik_arm(ssik: Any, chain: rd.Chain) -> Any:
    """The same arm as ssik has it."""
    axes, points, tool = axes_and_points(chain)
    transforms = np.tile(np.eye(4), (8, 1, 1))
    transforms[:7, :3, 3] = np.diff(points, axis=0, prepend=0.0)
    transforms[7] = tool
    transforms[7, :3, 3] -= points[6]
    return ssik.Manipulator.from_transforms(
        transforms, axes, limits=np.column_stack([chain.lower, chain.upper])
    )


def tracks(arm: Any, poses: Array, q0: Array | None = None) -> list[Array]:
    """Every track as joint rows, principal values unwound along the path."""
    found = arm.solve_path(poses, q0=q0)
    rows = [found.q(label) for label in found.tracks]
    return [np.unwrap((q + np.pi) % (2 * np.pi) - np.pi, axis=0) for q in rows]


def best_start(arm: Any, chain: rd.Chain, poses: Array) -> Array:
    """The start whose track keeps the best margin, by trying swivels on a part of the path."""
    manifold = arm.self_motion(poses[0])
    few = np.concatenate([poses[:1], poses[10::20]])
    starts = [c.q(t) for t in np.linspace(-np.pi, np.pi, STARTS, endpoint=False) for c in manifold.charts]
    return max(starts, key=lambda q0: margin(chain, tracks(arm, few, q0)[0]))


def main() -> None:
    """Measure and print."""
    chain = rd.catalog.load("iiwa14")
    arm, path = rd.SrsArm(chain), raster()
    poses = path.poses
    jobs: dict[str, Callable[[int], object]] = {"ours": lambda _: rd.plan_swivel(arm, path)}
    ssik = optional("ssik")
    if ssik is not None:
        other = ssik_arm(ssik, chain)
        jobs["ssik"] = lambda _: other.solve_path(poses)
    seconds = medians(jobs, 1)
    plan = rd.plan_swivel(arm, path)
    rows = [row("`plan_swivel`", chain, path, plan.q, seconds["ours"])]
    if ssik is not None:
        every = tracks(other, poses)
        legal = sum(margin(chain, q) >= 0 for q in every)
        best = max(every, key=lambda q: margin(chain, q))
        name = f"ssik `solve_path`, best of its {len(every)} tracks ({legal} legal)"
        rows.append(row(name, chain, path, best, seconds["ssik"]))
        start = best_start(other, chain, poses)
        one = medians({"ssik": lambda _: other.solve_path(poses, q0=start)}, 1)["ssik"]
        q = tracks(other, poses, start)[0]
        name = f"the same from the best of {STARTS * 8} starts (search not timed)"
        rows.append(row(name, chain, path, q, one))
    print(f"iiwa14, raster of {len(path)} poses, {path.length:.2f} m at {SPEED} m/s; plan: {plan.status}\n")
    print(table(HEAD, rows))
    print(f"\nMedians of one run of `python benches/python/bench_planning.py`; {machine()}.")


if __name__ == "__main__":
    main()
