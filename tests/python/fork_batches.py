"""Batches in child processes: run by `test_fork.py` in a process of its own.

Usage: fork_batches.py METHOD WHEN, with a method of `multiprocessing` or `os.fork`, and `idle`, `before` or `during`:
whether the parent has run batches before, or runs one in another thread while the children are made. Prints `ok`.
"""

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np

import redundancy as rd

WATCHDOG = 120
"""Seconds after which the kernel ends a process that waits for threads that it does not have."""
CHILDREN = 4


def watch() -> None:
    """Begins the watchdog of this process; no child inherits it."""
    if hasattr(signal, "alarm"):
        signal.alarm(WATCHDOG)


def batches(seed: int) -> list[Any]:
    """One batch of each room that has parallel work, with the pool of the process and with threads of its own."""
    chain = rd.catalog.load("iiwa14")
    rng = np.random.default_rng(seed)
    q = rng.uniform(chain.lower, chain.upper, (600, 7))
    poses = chain.forward(q)
    arm, solver = rd.SrsArm(chain), rd.IkSolver(chain)
    cone, turns = rd.Cone([0, 0, 1], [0, 0, -1], 0.5), rng.uniform(-1.0, 1.0, (5_000, 3))
    down = [[-1, 0, 0], [0, 1, 0], [0, 0, -1]]
    path = rd.paths.circle((0.45, 0.0, 0.5), 0.1, n=40, orientation=down)
    return [
        poses,
        chain.jacobian(q, threads=2),
        arm.solve_batch(poses, 0.3).q,
        arm.best_batch(poses, rd.JointRange(chain), threads=3).q,
        solver.solve_batch(poses[:100], seed=seed).q,
        rd.plan_swivel(arm, path).q,
        cone.margin(rd.quaternion.from_zyz(turns)),
    ]


def child(seed: int) -> list[Any]:
    """What a child does."""
    watch()
    return batches(seed)


def check(found: list[Any], seed: int) -> None:
    """The same bits as in this process."""
    for a, b in zip(found, batches(seed), strict=True):
        np.testing.assert_array_equal(a, b)


@contextlib.contextmanager
def work_in_another_thread() -> Iterator[None]:
    """Batches one after the other in a thread, the first of which has begun."""
    chain = rd.catalog.load("iiwa14")
    q = np.random.default_rng(0).uniform(chain.lower, chain.upper, (200_000, 7))
    begun, enough = threading.Event(), threading.Event()

    def work() -> None:
        while not enough.is_set():
            begun.set()
            chain.jacobian(q)

    thread = threading.Thread(target=work)
    thread.start()
    begun.wait()
    try:
        yield
    finally:
        enough.set()
        thread.join()


def forked(work: Any) -> None:
    """Runs `work` in a child made by `os.fork` and waits for it."""
    process = os.fork()
    if process == 0:
        code = 1
        try:
            watch()
            work()
            code = 0
        finally:
            os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 0


def in_children(method: str, expected: list[Any] | None) -> None:
    """Batches in children, and for `os.fork` in children of children."""
    if method == "os.fork":

        def compare() -> None:
            check(expected or batches(0), 0)

        for _ in range(CHILDREN):
            forked(compare)
            forked(lambda: (compare(), forked(compare), compare()))
        return
    with multiprocessing.get_context(method).Pool(2) as pool:
        found = pool.map_async(child, range(CHILDREN), chunksize=1).get(timeout=WATCHDOG)
    for seed, values in enumerate(found):
        check(values, seed)


def main() -> None:
    method, when = sys.argv[1:]
    watch()
    expected = None if when == "idle" else batches(0)
    with work_in_another_thread() if when == "during" else contextlib.nullcontext():
        in_children(method, expected)
    # The parent has kept its threads.
    check(batches(5), 5)
    print("ok")


if __name__ == "__main__":
    main()
