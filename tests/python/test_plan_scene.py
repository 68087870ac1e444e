"""Whole-path plans beside obstacles and with self-collision: clear under coal, and blocked where nothing is clear."""

import os
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest
from arms import example_robots
from numpy.typing import NDArray
from test_bodies import BODIES, Coal, load, share

import redundancy as rd

Array = NDArray[np.float64]
FULL = os.environ.get("REDUNDANCY_TEST_FULL") == "1"
DOWN = np.diag([1.0, -1.0, -1.0])


def at(x: float, y: float, z: float) -> Array:
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def dense(plan: rd.Plan, finer: int = 10) -> Array:
    """Configurations of the trajectory on a grid that is finer than the rows."""
    t = np.interp(np.linspace(0, len(plan) - 1, finer * (len(plan) - 1) + 1), np.arange(len(plan)), plan.t)
    return np.asarray(plan.sample(t)[0])


def bent(chain: rd.Chain) -> rd.Chain:
    tool = at(0, 0, 0.15)
    tool[:3, :3] = pin.rpy.rpyToMatrix(0, np.deg2rad(30), 0)
    return chain.with_tool(tool)


def raster(x: float, y: float, z: float, base: Array) -> rd.Path:
    orientation = base[:3, :3] @ DOWN
    path = rd.paths.raster((x, y, z), length=0.3, spacing=0.06, strokes=3, orientation=DOWN, step=0.015)
    poses = np.einsum("ij,njk->nik", base, path.poses)
    assert np.allclose(poses[0, :3, :3], orientation)
    return rd.Path(poses)


def test_beside_a_box_with_self_collision() -> None:
    """A UR5 with a bent tool and its meshes: without the box the arm would be in it."""
    chain = bent(load("ur5")[0])
    files = example_robots()
    links = rd.LinkGeometry.from_urdf(
        chain, files / BODIES["ur5"].urdf, package_dirs=[share()], srdf=files / "ur_description/srdf/ur5.srdf"
    )
    path = raster(0.45, -0.15, 0.2, chain.base)
    freedom = rd.ToolFreedom(np.deg2rad(15), "free")
    options: dict[str, Any] = {"tool_speed": 0.1, "links": links, "time_limit": 60.0}
    free = rd.plan(chain, path, freedom, **options)
    assert str(free.status) == "converged"
    assert free.self_clearance is not None
    other = Coal("ur5", chain, links.pairs)
    # The box is where the free plan has a link half-way.
    origin = chain.forward(free.q[len(free) // 2], link="forearm_link")[:3, 3]
    wrist = chain.forward(free.q[len(free) // 2], link="wrist_1_link")[:3, 3]
    half = np.array([0.06, 0.06, 0.04])
    pose = at(*(0.5 * (origin + wrist) + [0, 0, 0.05]))
    box = coal.Box(*(2 * half))
    scene = rd.Scene([rd.Box(pose, half)])
    assert min(min(other.to_obstacle(q, box, pose).values()) for q in free.q) < 0
    plan = rd.plan(chain, path, freedom, scene=scene, **options)
    assert (str(plan.status), plan.legal) == ("converged", True), plan.reason
    rows = dense(plan)
    assert min(min(other.to_obstacle(q, box, pose).values()) for q in rows) > 0
    assert min(min(other.distances(q).values()) for q in rows) > 0
    assert plan.clearance is not None
    least = [min(other.to_obstacle(q, box, pose).values()) for q in plan.q]
    np.testing.assert_allclose(plan.clearance, least, atol=1e-5)
    assert plan.cost is not None
    assert free.cost is not None
    assert plan.cost >= free.cost - 1e-9


def ball_scene(rng: np.random.Generator, path: rd.Path, base: Array) -> rd.Scene:
    balls: list[Any] = []
    while len(balls) < 3:
        centre = base[:3, 3] + rng.uniform([-0.3, -0.6, 0.1], [0.7, 0.6, 1.0])
        radius = rng.uniform(0.04, 0.12)
        away = np.linalg.norm(path.poses[:, :3, 3] - centre, axis=1).min()
        if away > radius + 0.12 and np.linalg.norm(centre[:2] - base[:2, 3]) > radius + 0.15:
            balls.append(rd.Sphere(centre, radius))
    return rd.Scene(balls)


@pytest.mark.parametrize("name", ["ur5", "panda", "rail"])
def test_random_scenes(name: str) -> None:
    """Plans are clear on a finer grid, cost at least what a plan without obstacles does, and a point that is called
    blocked has no clear configuration on any of its arcs (full poses)."""
    chain, freedom, task = rd.catalog.load("panda"), rd.ToolFreedom(), "pose"
    if name == "ur5":
        chain, freedom = bent(rd.catalog.load("ur5e")), rd.ToolFreedom(np.deg2rad(15), "free")
    if name == "rail":
        chain = rd.catalog.load("iiwa14").with_rail((0, 1, 0), -1.0, 1.0)
    path = raster(0.45, -0.15, 0.3, chain.base)
    options: dict[str, Any] = {"tool_speed": 0.1, "link_radius": 0.05, "time_limit": 30.0}
    free = rd.plan(chain, path, freedom, **options)
    assert free.cost is not None
    rng = np.random.default_rng(11)
    solved = blocked = 0
    for _ in range(40 if FULL else 5):
        scene = ball_scene(rng, path, chain.base)
        plan = rd.plan(chain, path, freedom, scene=scene, **options)
        if plan.legal:
            solved += 1
            assert plan.cost is not None
            assert plan.cost >= free.cost - 1e-6
            assert scene.clearance(chain, dense(plan), 0.05).distance.min() > 0
            np.testing.assert_allclose(chain.forward(plan.q)[:, :3, 3], path.poses[:, :3, 3], atol=1e-9)
        else:
            assert plan.reason
            assert str(plan.status) in {"collision", "infeasible"}, (plan.status, plan.reason)
        if plan.blocked:
            blocked += 1
            row = plan.blocked[0]
            assert "deep" in plan.blocked_reasons[0]
            if freedom.half_angle == 0:
                found = rd.solutions(chain, path.poses[row], task=task, seed=3)
                for piece in range(found.pieces):
                    for low, high in found.intervals(piece):
                        q = np.array([found.q(piece, u) for u in np.linspace(low, high, 300)])
                        assert scene.clearance(chain, q, 0.05).distance.max() < 1e-3
    assert solved >= 2, (solved, blocked)


def test_contact_that_the_path_forces() -> None:
    """The hand over a table, 2 mm in it: all rows and the depth; allowed, it is planned."""
    chain = rd.catalog.load("iiwa14")
    path = rd.paths.circle((0.5, 0, 0.4), 0.1, orientation=DOWN, n=40)
    radius, top = 0.05, 0.4 - 0.05 + 0.002
    table = rd.Box(at(0.5, 0, top - 0.05), [0.3, 0.3, 0.05], name="table")
    plan = rd.plan(chain, path, scene=rd.Scene([table]), link_radius=radius)
    assert (str(plan.status), plan.legal, len(plan)) == ("collision", False, 40)
    assert "table" in plan.reason
    assert "2.0" in plan.reason
    assert "allow" in plan.reason
    assert plan.clearance is not None
    assert plan.clearance.min() == pytest.approx(-0.002, abs=1e-9)
    last = rd.LinkGeometry(chain, radius).names[-1]
    allowed = rd.plan(chain, path, scene=rd.Scene([table], allowed=[(last, "table")]), link_radius=radius)
    assert (str(allowed.status), allowed.legal) == ("converged", True), allowed.reason


def test_what_is_wanted_and_what_it_costs() -> None:
    """An obstacle far away changes nothing; one near by is given the wanted distance where that is possible."""
    chain = rd.catalog.load("pa10")
    path = rd.paths.circle((0.45, 0, 0.5), 0.12, orientation=DOWN, n=60)
    free = rd.plan(chain, path)
    far = rd.plan(chain, path, scene=rd.Scene([rd.Sphere((5, 5, 5), 0.1)]))
    np.testing.assert_allclose(far.q, free.q, atol=1e-7)
    elbow = chain.forward(free.q[30], link=chain.link_names[4])[:3, 3]
    near = rd.Scene([rd.Sphere(elbow + np.array([0.0, 0.0, 0.12]), 0.05)])
    assert near.clearance(chain, free.q, 0.05).distance.min() < 0.03
    kept = [rd.plan(chain, path, scene=near, wanted_clearance=w) for w in (0.0, 0.03, 0.06)]
    for plan, wanted in zip(kept, (0.0, 0.03, 0.06), strict=True):
        assert plan.legal, plan.reason
        assert plan.clearance is not None
        assert plan.clearance.min() > 0.97 * wanted


def test_obstacles_that_move_need_times() -> None:
    chain = rd.catalog.load("pa10")
    path = rd.paths.circle((0.45, 0, 0.5), 0.12, orientation=DOWN, n=30)
    scene = rd.Scene([rd.Sphere((0.2, 1.0, 0.6), 0.1, velocity=(0.0, -0.2, 0.0))])
    with pytest.raises(rd.RedundancyError, match="moves"):
        rd.plan(chain, path, scene=scene)
    plan = rd.plan(chain, path, scene=scene, tool_speed=0.1)
    assert plan.legal, plan.reason
    for q, t in zip(plan.q, plan.t, strict=True):
        moved = rd.Scene([rd.Sphere((0.2, 1.0 - 0.2 * t, 0.6), 0.1)])
        assert moved.clearance(chain, q, 0.05).distance > 0


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"wanted_clearance": -1.0}, "wanted_clearance"),
        ({"link_radius": 0.0}, "link_radius"),
        ({"clearance_weight": float("nan")}, "clearance_weight"),
        ({"self_collision": "maybe"}, "self_collision"),
    ],
)
def test_bad_values_are_named(options: dict[str, Any], text: str) -> None:
    chain = rd.catalog.load("pa10")
    path = rd.paths.circle((0.45, 0, 0.5), 0.12, orientation=DOWN, n=30)
    with pytest.raises(rd.RedundancyError, match=text):
        rd.plan(chain, path, scene=rd.Scene([rd.Sphere((0.2, 1.0, 0.6), 0.1)]), **options)
