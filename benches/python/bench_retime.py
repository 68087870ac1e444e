"""Times for joint paths beside toppra, on the same stretches, gridpoints and limits; rows retimed and checked.

toppra gets the stretches between our stops, each from rest to rest, with the rows as gridpoints and every limit asked
for at both ends of each interval; its path, constraints and trajectory are made in the timed part, as our spline is.
`bench_retime.py all` gives the ratio on all 200 paths, each the quickest of three runs of both, taken in turn.
"""

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

import redundancy as rd

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "python"))
from joint_paths import COUNT, joint_path, random_smooth
from neighbours import machine, medians, optional, table, time_text
from test_retime_neighbours import Toppra, second_order

ROUNDS = 5
PATHS = (0, 5, 10, 15, 20, 112, 120, 196)
"""Random smooth paths of 100 to 1 000 rows, two rasters, a golden path."""


def beside_toppra() -> None:
    """Durations of the computation, path by path, with and without torque limits."""
    if optional("toppra") is None:
        return
    rows = []
    for index in PATHS:
        case = joint_path(index)
        for what in (case, replace(case, torque=None)):
            stops = second_order(what).stops
            jobs: dict[str, Callable[[int], object]] = {
                "ours": lambda _, what=what: second_order(what),
                "toppra": lambda _, what=what, stops=stops: [job() for job in Toppra().prepare(what, stops)],
            }
            seconds = medians(jobs, 50, ROUNDS)
            ratio = seconds["toppra"] / seconds["ours"]
            torque = "torque too" if what.torque is not None else "velocity, acceleration"
            cells = [time_text(seconds[name]) for name in ("ours", "toppra")]
            rows.append((case.name, str(len(case.q)), torque, *cells, f"{ratio:.1f}"))
            if case.torque is None:
                break
    print(table(("path", "rows", "limits", "ours", "toppra", "ratio"), rows))


def all_paths() -> None:
    """Median and quantiles of toppra's time over ours."""
    if optional("toppra") is None:
        return
    ratios: dict[str, list[float]] = {
        "velocity, acceleration": [],
        "torque too": [],
        "all that the arm has": [],
    }
    for index in range(COUNT):
        case = joint_path(index)
        stops = second_order(case).stops
        for what in (case, replace(case, torque=None)):
            ours, theirs = [], []
            for _ in range(3):
                begin = time.perf_counter()
                second_order(what)
                middle = time.perf_counter()
                for job in Toppra().prepare(what, stops):
                    job()
                ours.append(middle - begin)
                theirs.append(time.perf_counter() - middle)
            torque = "torque too" if what.torque is not None else "velocity, acceleration"
            ratios[torque].append(min(theirs) / min(ours))
            if what is case:
                ratios["all that the arm has"].append(min(theirs) / min(ours))
            if case.torque is None:
                break
    rows = []
    for name, values in ratios.items():
        quantiles = np.quantile(values, [0.0, 0.1, 0.5, 0.9, 1.0])
        rows.append((name, str(len(values)), *(f"{value:.1f}" for value in quantiles)))
    print(table(("limits", "paths", "least", "10 %", "median", "90 %", "most"), rows))


def scale() -> None:
    """Retiming by number of rows, and checking 100 000 rows."""
    panda = rd.catalog.load("panda")
    jerk = 5 * panda.acceleration_limit
    rows = []
    for count in (1_000, 2_000, 4_000, 8_000):
        q, _ = random_smooth(panda, count, 1)
        jobs: dict[str, Callable[[int], object]] = {
            "second order": lambda _, q=q: rd.retime(panda, q),
            "jerk": lambda _, q=q: rd.retime(panda, q, jerk_limits=jerk),
        }
        seconds = medians(jobs, 50, ROUNDS)
        rows.append((str(count), *(time_text(seconds[name]) for name in jobs)))
    print(table(("rows", "second order", "jerk"), rows))
    move = rd.retime(panda, random_smooth(panda, 1_000, 1)[0], jerk_limits=jerk)
    move = rd.retime(panda, move, jerk_limits=jerk, dt=float(move.t[-1]) / 100_000)
    seconds = medians({"check": lambda _: rd.check(panda, move)}, 10, ROUNDS)
    print(f"check of {len(move)} rows: {time_text(seconds['check'])}")


if __name__ == "__main__":
    np.set_printoptions(precision=4)
    if sys.argv[1:] == ["all"]:
        all_paths()
    else:
        beside_toppra()
        scale()
    print(machine())
