"""Random paths: plans hold on an independent check and are no worse than a chain of inverse kinematics; a 'no' is
confirmed by points without a configuration, or by other seeds."""

import os
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import redundancy as rd

Array = NDArray[np.float64]
FULL = os.environ.get("REDUNDANCY_TEST_FULL") == "1"
STEP = np.pi / 4  # no joint turns farther between rows


class Case(NamedTuple):
    chain: rd.Chain
    freedom: rd.ToolFreedom
    task: rd.Task | str


def case(name: str) -> Case:
    free, none = rd.ToolFreedom(0.0, "free"), rd.ToolFreedom()
    if name == "panda":
        return Case(rd.catalog.load("panda"), none, "pose")
    if name == "ur5e":
        return Case(rd.catalog.load("ur5e"), free, "pointing")
    if name == "rail":
        return Case(rd.catalog.load("iiwa14").with_rail((0, 1, 0), -1.0, 1.0), none, "pose")
    if name == "xarm7":
        return Case(rd.catalog.load("xarm7"), none, "pose")
    return Case(rd.catalog.load("pa10"), rd.ToolFreedom(np.deg2rad(15), 0.0), "pose")


def random_path(chain: rd.Chain, rng: np.random.Generator, rows: int = 60) -> rd.Path:
    """A smooth way through three points near one that the arm reaches, turning a little."""
    lower, upper = np.maximum(chain.lower, -2.5), np.minimum(chain.upper, 2.5)
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    start = chain.forward(middle + 0.7 * half * rng.uniform(-1, 1, chain.dof))
    knots = np.vstack([np.zeros(3), np.cumsum(rng.normal(0, 0.12, (2, 3)), axis=0)])
    turn = rng.normal(0, 0.25, 3)
    u = np.linspace(0, 1, rows)
    # Quadratic through the knots.
    weights = np.stack([(1 - u) * (1 - 2 * u), 4 * u * (1 - u), u * (2 * u - 1)], axis=1)
    poses = np.repeat(start[None], rows, axis=0)
    poses[:, :3, 3] += weights @ knots
    for k in range(rows):
        poses[k, :3, :3] = pin.exp3(u[k] * turn) @ start[:3, :3]
    return rd.Path(poses)


def cost(chain: rd.Chain, path: rd.Path, q: Array) -> float:
    """The cost of docs/planning.md with its default weights."""
    share = np.diff(path.s) / path.length
    own = 0.5 * (np.r_[0.0, share] + np.r_[share, 0.0])
    half = 0.5 * (chain.upper - chain.lower)
    with np.errstate(invalid="ignore"):
        x = (q - chain.lower - half) / half
    x = np.where(np.isfinite(half), x, 0.0)
    with np.errstate(divide="ignore"):
        y = np.minimum(x**2 / np.maximum(1 - x**2, 1e-300), 1e3)
    limits = (own[:, None] * y**2).sum()
    return float(limits + 0.5 * ((np.diff(q, axis=0) ** 2).sum(axis=1) / share).sum())


def chained(chain: rd.Chain, path: rd.Path, task: rd.Task | str, rng: np.random.Generator) -> Array | None:
    """Inverse kinematics from row to row; None where it fails, jumps or leaves its limits."""
    # Plans meet the path to rounding; a chain that may miss it by a micrometre can be cheaper by as much.
    solver = rd.IkSolver(chain, task=task, tol_position=1e-11, tol_orientation=1e-11)
    first = solver.solve(
        path.poses[0], q0=rng.uniform(np.maximum(chain.lower, -2), np.minimum(chain.upper, 2))
    )
    if str(first.status) != "converged":
        return None
    rows = [first.q]
    for pose in path.poses[1:]:
        found = solver.solve(pose, q0=rows[-1])
        if str(found.status) != "converged" or np.abs(found.q - rows[-1]).max() > STEP:
            return None
        rows.append(found.q)
    return np.array(rows)


def holds(given: Case, path: rd.Path, plan: rd.Plan) -> None:
    chain = given.chain
    q = plan.q
    assert (q >= chain.lower - 1e-9).all()
    assert (q <= chain.upper + 1e-9).all()
    poses = chain.forward(q)
    np.testing.assert_allclose(poses[:, :3, 3], path.poses[:, :3, 3], atol=1e-9)
    lean = np.arccos(np.clip((poses[:, :3, 2] * path.poses[:, :3, 2]).sum(axis=1), -1, 1))
    assert lean.max() <= given.freedom.half_angle + 1e-6
    if given.freedom.spin == 0.0 and given.freedom.half_angle == 0.0:
        np.testing.assert_allclose(poses, path.poses, atol=1e-9)
    assert np.abs(np.diff(q, axis=0)).max() <= STEP
    # Between the rows the tool stays near the path: no jump.
    t = 0.5 * (plan.t[1:] + plan.t[:-1])
    middle = chain.forward(np.asarray(plan.sample(t)[0]))[:, :3, 3]
    assert (
        np.linalg.norm(middle - 0.5 * (path.poses[1:, :3, 3] + path.poses[:-1, :3, 3]), axis=1).max() < 0.02
    )


@pytest.mark.parametrize("name", ["panda", "ur5e", "rail", "xarm7", "pa10"])
def test_random_paths(name: str) -> None:
    given = case(name)
    rng = np.random.default_rng(21)
    solved = impossible = 0
    for _ in range(300 if FULL else 6):
        path = random_path(given.chain, rng)
        plan = rd.plan(given.chain, path, given.freedom, time_limit=600.0)
        baselines = [chained(given.chain, path, given.task, rng) for _ in range(3)]
        costs = [cost(given.chain, path, q) for q in baselines if q is not None]
        if plan.legal:
            solved += 1
            holds(given, path, plan)
            assert plan.cost == pytest.approx(cost(given.chain, path, plan.q), rel=1e-6)
            assert all(plan.cost <= other * (1 + 1e-9) for other in costs), (plan.cost, costs)
            continue
        impossible += 1
        assert plan.reason
        assert not costs, (plan.reason, costs)
        if not plan.proven and not plan.blocked:
            for seed in (1, 2, 3):
                options: dict[str, Any] = {"seed": seed, "time_limit": 600.0}
                assert not rd.plan(given.chain, path, given.freedom, **options).legal
    print(f"{name}: {solved} solved, {impossible} impossible")
    assert solved
