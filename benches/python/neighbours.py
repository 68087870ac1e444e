"""What the side-by-side benches share: fair timing, the same arm in other libraries, Markdown."""

import importlib
import os
import statistics
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import redundancy as rd

Array = NDArray[np.float64]
ROUNDS = 15
"""Rounds of a comparison; in each every job has its turn, so a slow moment of the machine meets all of them."""
ROUND_SECONDS = 0.04
"""About the time that one job may take in a round."""


def optional(module: str) -> Any:
    """A neighbour's module, or None with a line that says so."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        print(f"skipped: {module} cannot be imported ({error}); see the extra `bench` in pyproject.toml")
        return None


def medians(jobs: dict[str, Callable[[int], object]], count: int, rounds: int = ROUNDS) -> dict[str, float]:
    """Seconds per call of each job, median over the rounds; a job is called with the index of its input.

    Args:
        jobs: By name; each takes an index below `count`.
        count: Number of inputs.
        rounds: How often each has its turn; fewer for jobs of seconds.
    """
    calls = {}
    for name, job in jobs.items():
        begin, done = time.perf_counter(), 0
        while done < count and (done < 3 or time.perf_counter() - begin < ROUND_SECONDS):
            job(done)
            done += 1
        calls[name] = done
    seconds: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, job in jobs.items():
            indices = range(calls[name])
            begin = time.perf_counter()
            for i in indices:
                job(i)
            seconds[name].append((time.perf_counter() - begin) / calls[name])
    return {name: statistics.median(times) for name, times in seconds.items()}


def random_q(chain: rd.Chain, n: int, seed: int) -> Array:
    """Uniform joint angles within the limits and one turn, `(n, dof)`."""
    rng = np.random.default_rng(seed)
    return rng.uniform(np.maximum(chain.lower, -np.pi), np.minimum(chain.upper, np.pi), (n, chain.dof))


def axes_and_points(chain: rd.Chain) -> tuple[Array, Array, Array]:
    """The joint axes of an arm at its zero: directions, a point on each, and the tool's pose."""
    tool, jacobian = chain.kinematics(np.zeros(chain.dof))
    directions = jacobian[3:].T
    # v = z x (tool - point), so the point of the axis nearest to the tool is tool + z x v.
    points = tool[:3, 3] + np.cross(directions, jacobian[:3].T)
    return directions.round(14), points.round(14), tool.round(14)


def urdf(chain: rd.Chain) -> str:
    """The same arm as a URDF: frames parallel to the world at the zero position, the tool as a fixed frame `tool`."""
    directions, points, tool = axes_and_points(chain)
    links = "".join(f'<link name="link{k}"/>' for k in range(chain.dof + 1))
    joints = []
    before, speed = np.zeros(3), np.minimum(chain.velocity_limit, 1e3)
    for k in range(chain.dof):
        xyz, axis = points[k] - before, directions[k]
        before = points[k]
        joints.append(
            f'<joint name="joint{k + 1}" type="revolute"><parent link="link{k}"/><child link="link{k + 1}"/>'
            f'<origin xyz="{xyz[0]} {xyz[1]} {xyz[2]}"/><axis xyz="{axis[0]} {axis[1]} {axis[2]}"/>'
            f'<limit lower="{chain.lower[k]}" upper="{chain.upper[k]}" velocity="{speed[k]}" effort="1e3"/></joint>'
        )
    pitch = np.arctan2(-tool[2, 0], np.hypot(tool[0, 0], tool[1, 0]))
    roll, yaw = np.arctan2(tool[2, 1], tool[2, 2]), np.arctan2(tool[1, 0], tool[0, 0])
    xyz = tool[:3, 3] - before
    end = (
        f'<link name="tool"/><joint name="end" type="fixed"><parent link="link{chain.dof}"/><child link="tool"/>'
        f'<origin xyz="{xyz[0]} {xyz[1]} {xyz[2]}" rpy="{roll} {pitch} {yaw}"/></joint>'
    )
    return f'<robot name="arm">{links}{"".join(joints)}{end}</robot>'


def closure(chain: rd.Chain, q: Array, poses: Array) -> float:
    """Largest entry of FK(q) - pose, by this library's FK (which agrees with pinocchio to 1e-12)."""
    return float(np.abs(chain.forward(q) - poses).max()) if len(q) else 0.0


def time_text(seconds: float) -> str:
    """A time with three digits in the unit that suits it."""
    unit, factor = next((pair for pair in (("s", 1.0), ("ms", 1e3)) if seconds * pair[1] >= 1.0), ("us", 1e6))
    return f"{seconds * factor:.3g} {unit}"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def machine() -> str:
    """Cores, and how busy they are besides: a loaded machine is slower, ratios suffer less."""
    load = ", ".join(f"{x:.1f}" for x in os.getloadavg())
    return f"{os.cpu_count()} cores, load average {load} over 1, 5, 15 minutes at the end of the run"
