"""Random poses for every arm of the catalogue: misses, wrong answers and broken limits are counted. Resumable.

The poses are those of uniform configurations within the joint limits, so each has an answer. Of a closed form every
configuration is checked, and that the one which made the pose is among them; of the numeric solver its one answer.
Usage: sweep.py [--state FILE] [--closed N] [--numeric N] [--seconds S] [--threads T] [ARM ...]
"""

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import redundancy as rd

Array = NDArray[np.float64]
BLOCK = 20_000
"""Poses between two writes of the state; each block has its own seed, so that a sweep can go on where it stopped."""
WRONG = 1e-8
"""An answer of a closed form is wrong beyond this distance from its pose, m and rad."""
NUMERIC_WRONG = 2e-6
"""The same of the numeric solver, whose tolerance is 1e-6 for each part."""
AT_LIMIT = 1e-9
"""Beyond a limit by more than this is broken, rad."""
FOUND = 1e-4
"""The configuration that made the pose counts as found within this, rad; near a singularity digits are lost."""


def random_q(chain: rd.Chain, n: int, seed: int) -> Array:
    """Uniform within the limits and one turn."""
    rng = np.random.default_rng(seed)
    return rng.uniform(np.maximum(chain.lower, -np.pi), np.minimum(chain.upper, np.pi), (n, chain.dof))


def distance(chain: rd.Chain, q: Array, poses: Array) -> Array:
    """How far the tool is from its pose, m or rad, for each row."""
    return np.abs(chain.forward(q) - poses).max(axis=(1, 2))


def outside(chain: rd.Chain, q: Array) -> Any:
    """Rows with a joint beyond its limit."""
    return ((q < chain.lower - AT_LIMIT) | (q > chain.upper + AT_LIMIT)).any(axis=1)


def closed(chain: rd.Chain, form: Any, seed: int, threads: int | None) -> dict[str, int]:
    """The counts of a block of poses, all configurations of the closed form."""
    q = random_q(chain, BLOCK, seed)
    poses = chain.forward(q)
    if form.parameter == "swivel":
        found = form.solve_batch(poses, np.array([form.swivel(row) for row in q]), threads=threads)
    elif form.parameter == "q7":
        found = form.solve_batch(poses, q[:, 6], threads=threads)
    else:
        found = form.solve_batch(poses, threads=threads)
    row, _ = np.nonzero(found.valid)
    answers = found.q[found.valid]
    gap = np.abs(np.remainder(answers - q[row] + np.pi, 2 * np.pi) - np.pi).max(axis=1)
    nearest = np.full(BLOCK, np.inf)
    np.minimum.at(nearest, row, gap)
    return {
        "poses": BLOCK,
        "answers": len(answers),
        "misses": int((~found.valid.any(axis=1)).sum()),
        "not_found_again": int((nearest > FOUND).sum()),
        "wrong": int((distance(chain, answers, poses[row]) > WRONG).sum()),
        "broken_limits": int(outside(chain, answers).sum()),
    }


def numeric(chain: rd.Chain, solver: rd.IkSolver, seed: int, threads: int | None) -> dict[str, int]:
    """The counts of a block of poses, one answer of the numeric solver for each."""
    poses = chain.forward(random_q(chain, BLOCK, seed))
    result = solver.solve_batch(poses, threads=threads)
    solved = np.array([str(s) == "converged" for s in result.status])
    return {
        "poses": BLOCK,
        "answers": int(solved.sum()),
        "misses": int((~solved).sum()),
        "wrong": int((distance(chain, result.q[solved], poses[solved]) > NUMERIC_WRONG).sum()),
        "broken_limits": int(outside(chain, result.q).sum()),
    }


def jobs(names: list[str], wanted: dict[str, int]) -> list[tuple[str, int, Any]]:
    """What to sweep: a name, how many poses, and a function of a seed and of threads that returns counts."""
    found: list[tuple[str, int, Any]] = []
    for name in names:
        chain = rd.catalog.load(name)
        form = rd.closed_form(chain)
        if form is not None:
            found.append(
                (f"{name}/{form.name}", wanted["closed"], lambda s, t, c=chain, f=form: closed(c, f, s, t))
            )
        if chain.dof >= 6:
            solver = rd.IkSolver(chain, closed_form=False)
            found.append(
                (f"{name}/numeric", wanted["numeric"], lambda s, t, c=chain, i=solver: numeric(c, i, s, t))
            )
    return found


def main() -> int:
    """Sweep until everything is done or the time is over; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("arms", nargs="*", help="names of the catalogue; all by default")
    parser.add_argument("--state", type=Path, default=Path("sweep.json"), help="counts so far")
    parser.add_argument("--closed", type=int, default=10_000_000, help="poses for each closed form")
    parser.add_argument(
        "--numeric", type=int, default=1_000_000, help="poses for each arm of the numeric solver"
    )
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after this time")
    parser.add_argument("--threads", type=int, default=None)
    options = parser.parse_args()
    state: dict[str, dict[str, Any]] = (
        json.loads(options.state.read_text()) if options.state.is_file() else {}
    )
    end = time.monotonic() + options.seconds
    # Round after round, so that a sweep that is stopped has seen every arm.
    todo = jobs(options.arms or rd.catalog.names(), {"closed": options.closed, "numeric": options.numeric})
    while todo and time.monotonic() < end:
        for name, wanted, run in list(todo):
            counts = state.setdefault(name, {"poses": 0, "seconds": 0.0})
            if counts["poses"] >= wanted:
                todo.remove((name, wanted, run))
                continue
            begin = time.monotonic()
            for key, value in run(counts["poses"] // BLOCK, options.threads).items():
                counts[key] = counts.get(key, 0) + value
            counts["seconds"] += time.monotonic() - begin
            options.state.parent.mkdir(parents=True, exist_ok=True)
            options.state.write_text(json.dumps(state, indent=1))
            if time.monotonic() > end:
                break
    head = ("poses", "answers", "misses", "not_found_again", "wrong", "broken_limits", "seconds")
    print("| arm | " + " | ".join(head) + " |\n|" + "---|" * (len(head) + 1))
    for name, counts in sorted(state.items()):
        cells = [f"{counts[k]:,.0f}" if k in counts else "" for k in head]
        print(f"| {name} | " + " | ".join(cells) + " |")
    faults = sum(c.get("wrong", 0) + c.get("broken_limits", 0) for c in state.values())
    faults += sum(c.get("misses", 0) for name, c in state.items() if not name.endswith("numeric"))
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
