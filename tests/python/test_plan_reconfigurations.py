"""Paths that no line follows: a plan has no more reconfigurations than an exhaustive search over all arcs, and no more
than the sampled graph of IKLink (Wang, Sientko, Rakita, Gleicher 2024, sec. IV)."""

import itertools
import os
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import redundancy as rd

Array = NDArray[np.float64]
FULL = os.environ.get("REDUNDANCY_TEST_FULL") == "1"
SPACING = 0.05  # between samples on an arc, rad
# Paths that need reconfigurations, for the short run.
KNOWN = {"panda": [57, 59], "fr3": [17, 20]}
STEP = np.pi / 4  # no joint turns farther between rows


class Row(NamedTuple):
    q: Array  # (k, n)
    arc: NDArray[np.int64]  # (k,): which arc each belongs to


def straight(chain: rd.Chain, rng: np.random.Generator, count: int = 60) -> rd.Path:
    """From one pose that the arm reaches straight to another one, turning evenly: most of them are no line for it."""
    middle, half = 0.5 * (chain.lower + chain.upper), 0.5 * (chain.upper - chain.lower)
    first, last = chain.forward(middle + 0.5 * half * rng.uniform(-1, 1, (2, chain.dof)))
    turn = pin.log3(first[:3, :3].T @ last[:3, :3])
    poses = np.repeat(first[None], count, axis=0)
    for u, pose in zip(np.linspace(0, 1, count), poses, strict=True):
        pose[:3, 3] += u * (last[:3, 3] - first[:3, 3])
        pose[:3, :3] = first[:3, :3] @ pin.exp3(u * turn)
    return rd.Path(poses)


def arcs(chain: rd.Chain, pose: Array) -> Row:
    """Samples on all arcs over a pose that the limits leave."""
    q, arc, count = [], [], 0
    for piece in rd.solutions(chain, pose).pieces:
        for low, high in piece.intervals():
            speed = np.linalg.norm(piece.tangent(np.linspace(low, high, 50)), axis=1).max()
            u = np.linspace(low, high, max(2, int(np.ceil((high - low) * speed / SPACING)) + 1))
            states = piece.q(u)
            q.append(states)
            arc.append(np.full(len(states), count))
            count += 1
    if not q:
        return Row(np.zeros((0, chain.dof)), np.zeros(0, dtype=np.int64))
    return Row(np.vstack(q), np.concatenate(arc))


def exhaustive(chain: rd.Chain, path: rd.Path, rows: list[Row]) -> int:
    """The fewest reconfigurations: as far as the arcs lead, again and again."""
    solver = rd.IkSolver(chain, method="newton", restarts=0, max_iterations=50, closed_form=False)
    reached = set(rows[0].arc.tolist())
    jumps = 0
    for k in range(1, len(path)):
        before, after = rows[k - 1], rows[k]
        start = before.q[np.isin(before.arc, list(reached))]
        poses = np.repeat(path.poses[k][None], len(start), axis=0)
        carried = solver.solve_batch(poses, q0=start)
        good = np.array([str(s) == "converged" for s in carried.status])
        good &= np.abs(carried.q - start).max(axis=1) <= STEP
        inside = (carried.q >= chain.lower - 1e-9).all(axis=1) & (carried.q <= chain.upper + 1e-9).all(axis=1)
        apart, nearest = cKDTree(after.q).query(carried.q[good & inside])
        reached = set(after.arc[nearest[apart <= SPACING]].tolist())
        if not reached:
            jumps += 1
            reached = set(after.arc.tolist())
    return jumps


def iklink(chain: rd.Chain, path: rd.Path, rng: np.random.Generator, count: int = 150) -> int | None:
    """Reconfigurations of the best line over random solutions at each row; None where a row has none."""
    solver = rd.IkSolver(chain, method="newton", restarts=0, max_iterations=50, closed_form=False)
    table: Array | None = None
    before = np.zeros((0, chain.dof))
    for pose in path.poses:
        start = rng.uniform(chain.lower, chain.upper, (count, chain.dof))
        found = solver.solve_batch(np.repeat(pose[None], count, axis=0), q0=start)
        q = found.q[[str(s) == "converged" for s in found.status]]
        if len(before):  # greedy propagation of the states before
            carried = solver.solve_batch(np.repeat(pose[None], len(before), axis=0), q0=before)
            q = np.vstack([q, carried.q[[str(s) == "converged" for s in carried.status]]])
        q = q[((q >= chain.lower) & (q <= chain.upper)).all(axis=1)]
        if not len(q):
            return None
        if len(q) > count:
            q = q[rng.permutation(len(q))[:count]]
        if table is None:
            table = np.zeros((len(q), 2))
        else:
            near = np.abs(q[None] - before[:, None]).max(axis=2) <= STEP / 4
            jumps = table[:, None, 0] + ~near
            cost = table[:, None, 1] + np.where(near, np.linalg.norm(q[None] - before[:, None], axis=2), 0.0)
            best = np.lexsort((cost, jumps), axis=0)[0]
            table = np.stack([np.take_along_axis(x, best[None], axis=0)[0] for x in (jumps, cost)], axis=1)
        before = q
    assert table is not None
    return int(table[:, 0].min())


def needing(chain: rd.Chain, number: int) -> tuple[rd.Path, list[Row], int] | None:
    """The path of that number with its arcs and the fewest reconfigurations, if it is one that needs them."""
    path = straight(chain, np.random.default_rng(number))
    # Sparse rows first: where one has no configuration there is nothing to look for.
    if any(not len(arcs(chain, pose).q) for pose in path.poses[::6]):
        return None
    rows = [arcs(chain, pose) for pose in path.poses]
    if any(not len(row.q) for row in rows):
        return None
    least = exhaustive(chain, path, rows)
    return (path, rows, least) if least else None


@pytest.mark.parametrize("name", ["panda", "fr3"])
def test_no_more_reconfigurations_than_an_exhaustive_search(name: str) -> None:
    chain = rd.catalog.load(name)
    seen = 0
    for number in itertools.count() if FULL else KNOWN[name]:
        found = needing(chain, number)
        if found is None:
            continue
        path, _, least = found
        seen += 1
        plan = rd.plan(chain, path, time_limit=600.0)
        assert str(plan.status) == "infeasible", plan.reason
        assert len(plan.reconfigurations) <= least, (number, plan.reason)
        np.testing.assert_allclose(chain.forward(plan.q), path.poses, atol=1e-9)
        assert ((plan.q >= chain.lower - 1e-9) & (plan.q <= chain.upper + 1e-9)).all()
        jumps = np.flatnonzero(np.abs(np.diff(plan.q, axis=0)).max(axis=1) > STEP) + 1
        assert set(jumps) <= set(plan.reconfigurations)
        other = iklink(chain, path, np.random.default_rng(number))
        assert other is None or len(plan.reconfigurations) <= other
        if seen == 25:
            break
    assert seen >= len(KNOWN[name])


def test_a_closed_path_with_reconfigurations_has_all_its_rows() -> None:
    chain = rd.catalog.load("panda")
    poses = straight(chain, np.random.default_rng(KNOWN["panda"][0])).poses
    closed = rd.Path(np.concatenate([poses, poses[-2::-1]]))
    plan = rd.plan(chain, closed, cyclic=True, velocity_limits=None, time_limit=60.0)
    assert plan.status == "infeasible" and not plan.legal
    assert plan.q.shape == (len(closed), chain.dof) and np.array_equal(plan.q[0], plan.q[-1])
    assert np.abs(chain.forward(plan.q) - closed.poses).max() < 1e-9
    jumps = np.flatnonzero(np.abs(np.diff(plan.q, axis=0)).max(axis=1) > STEP) + 1
    assert set(jumps) <= set(plan.reconfigurations) and plan.reconfigurations
