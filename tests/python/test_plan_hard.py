"""Rasters for a Panda on which following an optimum fails: planned, or impossible under a second search too."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from arms import example_robots
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import redundancy as rd

Array = NDArray[np.float64]
FULL = os.environ.get("REDUNDANCY_TEST_FULL") == "1"
CASES = json.loads((Path(__file__).parents[1] / "golden/plan_cases/panda_hard.json").read_text())["rasters"]
# Solved and impossible ones; all of them in the full run.
SOME = CASES if FULL else [case for case in CASES if case["number"] in {9, 20, 45, 117}]


@pytest.fixture(scope="module")
def panda() -> rd.Chain:
    return rd.Chain.from_urdf(
        example_robots() / "panda_description/urdf/panda.urdf", "panda_link0", "panda_hand_tcp"
    )


def path_of(case: dict[str, Any]) -> rd.Path:
    shape = [case["origin"], case["length"], case["spacing"], case["strokes"], case["corner"]]
    rotation = np.array(case["rotation"])
    length = rd.paths.raster(*shape, orientation=rotation).length
    return rd.paths.raster(*shape, orientation=rotation, step=length / (case["samples"] - 1))


def reaches(chain: rd.Chain, path: rd.Path, radius: float) -> int | None:
    """The first row that no line comes to: sampled solutions of each row, by distances alone."""
    reached: Array | None = None
    for row, pose in enumerate(path.poses):
        found = rd.solutions(chain, pose)
        assert found.proven
        states = []
        for piece in found.pieces:
            for low, high in piece.intervals():
                states.append([piece.q(u) for u in np.linspace(low, high, 2 + int((high - low) / 0.02))])
        q = np.concatenate([np.array(rows) for rows in states])
        if reached is not None:
            near, _ = cKDTree(reached).query(q, distance_upper_bound=radius)
            q = q[np.isfinite(near)]
        if not len(q):
            return row
        reached = q
    return None


@pytest.mark.parametrize("case", SOME, ids=lambda case: str(case["number"]))
def test_hard_rasters(panda: rd.Chain, case: dict[str, Any]) -> None:
    path = path_of(case)
    plan = rd.plan(panda, path, velocity_limits=None, time_limit=600.0)
    # With reconfigurations or without: all rows are there, within limits, and on the path.
    assert (plan.q >= panda.lower).all()
    assert (plan.q <= panda.upper).all()
    assert np.abs(panda.forward(plan.q) - path.poses).max() < 1e-9
    steps = np.abs(np.diff(plan.q, axis=0)).max(axis=1)
    if plan.legal:
        assert str(plan.status) == "converged"
        assert steps.max() < 0.3
    else:
        assert case["number"] in {3, 45, 191}
        assert str(plan.status) == "infeasible"
        assert "no line exists" in plan.reason
        assert len(plan.reconfigurations) == (1 if case["number"] == 3 else 2)
        assert np.delete(steps, np.array(plan.reconfigurations) - 1).max() < 0.5
        # No line, whatever its steps: the nearest configurations are radians apart.
        assert reaches(panda, path, radius=1.0) is not None


def test_the_fastest_line_may_lie_on_the_edge_of_the_cone() -> None:
    """Steps along the edge were once taken for jumps."""
    path = rd.paths.circle((0.5, 0.0, 0.4), radius=0.1, orientation=np.diag([1.0, -1.0, -1.0]), n=200)
    freedom = rd.ToolFreedom(np.deg2rad(15), "free")
    options: dict[str, Any] = {"objective": "peak_speed", "tool_speed": 0.1, "time_limit": 60.0}
    plan = rd.plan(rd.catalog.load("panda"), path, freedom, **options)
    assert plan.legal, plan.reason
    assert plan.tilt is not None
    assert np.linalg.norm(plan.tilt, axis=1).max() > np.deg2rad(14.9)
