"""Bodies: self-collision and distances of arms with hulls, beside coal in one run; plans among obstacles.

The same shapes (convex hulls of the collision meshes; coal's by `buildConvexHull`) and the same pairs (the SRDF's) at
the same random configurations. coal is called once for each configuration, by pinocchio, with the placements of all
shapes; ours in one batch on one thread. The call of an empty loop is subtracted from neither.

Then the raster of `bench_planning.py` beside five primitives: the iiwa14 with capsules from joint to joint, and an arm
of its proportions whose links are hulls of 100 vertices, with self-collision.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import redundancy as rd

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "python"))
from bench_planning import raster
from neighbours import Array, machine, medians, table, time_text
from test_bodies import Coal, load, random_rows
from test_body_plans import build

ROWS = 2_000
ROUNDS = 7


def microseconds(jobs: dict[str, Callable[[Array], object]], rows: Array) -> dict[str, float]:
    """Median time per configuration of each job; in each round every job has its turn."""
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(ROUNDS):
        for name, job in jobs.items():
            begin = time.perf_counter()
            job(rows)
            times[name].append((time.perf_counter() - begin) / len(rows) * 1e6)
    return {name: float(np.median(every)) for name, every in times.items()}


def compared(name: str) -> list[str]:
    """One robot."""
    chain, links = load(name)
    other = Coal(name, chain, links.pairs)
    rows = random_rows(chain, ROWS, 1)

    def collide(rows: Array) -> None:
        for q in rows:
            other.place(q)
            pin.computeCollisions(other.geometry, other.places, True)

    def distances(rows: Array) -> None:
        for q in rows:
            other.place(q)
            pin.computeDistances(other.geometry, other.places)

    def place(rows: Array) -> None:
        for q in rows:
            other.place(q)

    times = microseconds(
        {
            "place": place,
            "coal collide": collide,
            "coal distances": distances,
            "collide": lambda rows: links.self_clearance(rows, cutoff=0.0, threads=1),
            "near": lambda rows: links.pair_clearances(rows, cutoff=0.1, threads=1),
            "all": lambda rows: links.pair_clearances(rows, threads=1),
            "least": lambda rows: links.self_clearance(rows, threads=1),
        },
        rows,
    )
    return [
        name,
        str(len(other.geometry.collisionPairs)),
        f"{times['coal collide']:.1f}",
        f"{times['collide']:.1f}",
        f"{times['coal distances']:.1f}",
        f"{times['near']:.1f}",
        f"{times['all']:.1f}",
        f"{times['least']:.1f}",
        f"{times['place']:.1f}",
    ]


def capsules() -> None:
    """Joint-to-joint capsules with the pairs that are found."""
    chain = rd.catalog.load("iiwa14")
    links = rd.LinkGeometry(chain, 0.05)
    rows = random_rows(chain, 20_000, 2)
    times = microseconds({"least": lambda rows: links.self_clearance(rows, threads=1)}, rows)
    print(f"\n{chain.name}: {len(links.pairs)} pairs of joint-to-joint capsules: {times['least']:.2f} us")


def primitives() -> rd.Scene:
    """Two balls, two posts and a table around the forearm of the raster."""
    at = np.eye(4)
    at[:3, 3] = (0.6, 0.0, -0.05)
    posts = [rd.Capsule((x, y, 0.0), (x, y, 0.9), 0.04) for x, y in ((0.35, -0.5), (0.2, 0.6))]
    balls = [rd.Sphere(center, 0.08) for center in ((0.25, 0.45, 0.6), (0.3, -0.1, 0.95))]
    return rd.Scene([*balls, *posts, rd.Box(at, (0.3, 0.5, 0.05))])


def plans() -> None:
    """Times of whole plans."""
    path, scene = raster(), primitives()
    iiwa = rd.SrsArm(rd.catalog.load("iiwa14"))
    with tempfile.TemporaryDirectory() as folder:
        lumps = build(Path(folder), vertices=100, radius=0.05, over=0.0)
    status: dict[str, str] = {}

    def job(name: str, arm: rd.SrsArm, **options: Any) -> Callable[[int], object]:
        def run(_: int) -> None:
            status[name] = str(rd.plan_swivel(arm, path, scene, **options).status)

        return run

    jobs = {
        "capsules": job("capsules", iiwa),
        "capsules, 360 swivels": job("capsules, 360 swivels", iiwa, swivels=360),
        "hulls": job("hulls", lumps.arm, links=lumps.links, self_collision=False),
        "hulls, self-collision": job("hulls, self-collision", lumps.arm, links=lumps.links),
    }
    # Hulls take seconds.
    seconds = medians(jobs, 1, rounds=3)
    print(f"\nRaster of {len(path)} poses beside five primitives, all threads:\n")
    rows = [[name, time_text(seconds[name]), status[name]] for name in jobs]
    print(table(("links", "time", "status"), rows))


def main() -> None:
    """Prints the tables."""
    print("# Bodies: distances of links from each other, us per configuration\n")
    print(machine(), "\n")
    head = (
        "robot",
        "pairs",
        "coal: collide",
        "collide",
        "coal: all distances",
        "nearer than 0.1 m, with gradients",
        "all, with gradients",
        "the least",
        "pinocchio: placements",
    )
    print(table(head, [compared(name) for name in ("panda", "ur5", "xarm7", "tiago")]))
    capsules()
    plans()


if __name__ == "__main__":
    np.seterr(all="raise")
    main()
