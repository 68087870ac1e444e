"""Scenes: distances against numpy, files, pickles, messages."""

import itertools
import json
import pickle
import re
from collections.abc import Sequence
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import redundancy as rd

Array = NDArray[np.float64]


def joints_of(chain: rd.Chain, q: Array) -> Array:
    """Joint frames' origins and the tool, by FK of the links (iiwa14: each link frame is its joint's frame)."""
    links = [name for name in chain.link_names if "link" in name][1:8]
    points = [chain.forward(q, link=name)[:3, 3] for name in links]
    return np.array([*points, chain.forward(q)[:3, 3]])


def point_distance(points: Array, obstacle: rd.Sphere | rd.Box | rd.Capsule) -> Array:
    if isinstance(obstacle, rd.Sphere):
        return np.linalg.norm(points - obstacle.center, axis=1) - obstacle.radius
    if isinstance(obstacle, rd.Box):
        local = (points - obstacle.pose[:3, 3]) @ obstacle.pose[:3, :3]
        excess = np.abs(local) - obstacle.half_extents
        return np.linalg.norm(np.maximum(excess, 0), axis=1) + np.minimum(excess.max(axis=1), 0)
    along = obstacle.end - obstacle.start
    share = np.clip((points - obstacle.start) @ along / (along @ along), 0, 1)
    return np.linalg.norm(points - obstacle.start - share[:, None] * along, axis=1) - obstacle.radius


def scene_of_five() -> rd.Scene:
    turned = np.eye(4)
    turned[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    turned[:3, 3] = (0.3, 0.4, 0.6)
    return rd.Scene(
        [
            rd.Sphere((0.4, -0.3, 0.5), 0.1),
            rd.Box(turned, (0.1, 0.2, 0.05)),
            rd.Capsule((-0.5, -0.5, 0.0), (-0.5, -0.5, 1.0), 0.08),
            rd.Sphere((0.0, 0.0, 1.4), 0.2),
            rd.Capsule((0.2, 0.6, 0.3), (0.6, 0.6, 0.3), 0.05),
        ]
    )


def test_clearance_against_samples_in_numpy() -> None:
    chain, scene = rd.catalog.load("iiwa14"), scene_of_five()
    rng = np.random.default_rng(3)
    rows = rng.uniform(chain.lower, chain.upper, (40, 7))
    batch = scene.clearance(chain, rows, link_radius=0.06)
    for k, q in enumerate(rows):
        points = joints_of(chain, q)
        t = np.linspace(0, 1, 2001)[:, None]
        samples = np.concatenate([a + t * (b - a) for a, b in itertools.pairwise(points)])
        expected = min(point_distance(samples, obstacle).min() for obstacle in scene.obstacles) - 0.06
        one = scene.clearance(chain, q, link_radius=0.06)
        assert one.distance == pytest.approx(expected, abs=2e-4)
        assert one.distance <= expected + 1e-12
        assert one.distance == batch.distance[k]
        assert (one.link, one.obstacle) == (batch.link[k], batch.obstacle[k])
        np.testing.assert_allclose(one.on_link - one.on_obstacle, one.distance * one.normal, atol=1e-12)
        np.testing.assert_array_equal(one.on_link, batch.on_link[k])
        assert one.link in chain.link_names


def test_criteria_against_differences() -> None:
    chain, scene = rd.catalog.load("iiwa14"), scene_of_five()
    q = np.array([0.3, 0.7, -0.4, -1.2, 0.5, 0.8, 0.1])
    steps = 1e-6 * np.eye(7)
    link = chain.link_names[5]
    for h in (
        rd.Clearance(chain, scene),
        rd.Clearance(chain, scene, link_radius=0.1, smoothing=0.05),
        rd.Elbow(chain, (0.3, 0.2, 0.1)),
        rd.Elbow(chain, (0.3, 0.2, 0.1), link=link),
        rd.Clearance(chain, scene) + -0.2 * rd.Elbow(chain, (0.3, 0.2, 0.1)),
    ):
        expected = (h.value(q + steps) - h.value(q - steps)) / 2e-6
        np.testing.assert_allclose(h.gradient(q), expected, atol=1e-7)
        expected = (h.gradient(q + steps) - h.gradient(q - steps)) / 2e-6
        np.testing.assert_allclose(h.hessian(q), expected, atol=1e-4 * (1 + np.abs(expected).max()))
        again = pickle.loads(pickle.dumps(h))
        assert repr(again) == repr(h)
        assert again.value(q) == h.value(q)
    assert rd.Clearance(chain, scene).sense == "maximize"
    assert rd.Clearance(chain, scene).value(q) == pytest.approx(scene.clearance(chain, q).distance, abs=0.004)
    assert rd.Clearance(chain, scene, smoothing=0).value(q) == scene.clearance(chain, q).distance
    elbow = chain.forward(q, link=link)[:3, 3]
    value = rd.Elbow(chain, (0.3, 0.2, 0.1), link=link).value(q)
    assert value == pytest.approx(((elbow - (0.3, 0.2, 0.1)) ** 2).sum())


def test_scene_files(tmp_path: Path) -> None:
    scene = scene_of_five()
    file = tmp_path / "scene.json"
    file.write_text(scene.to_json())
    again = rd.Scene.from_json(file)
    assert len(again) == 5
    chain = rd.catalog.load("iiwa14")
    q = np.full(7, 0.4)
    assert again.clearance(chain, q).distance == pytest.approx(scene.clearance(chain, q).distance, abs=1e-12)
    entry = json.loads(scene.to_json())["obstacles"][0]
    assert entry == {"type": "sphere", "center": [0.4, -0.3, 0.5], "radius": 0.1}
    file.write_text('{"obstacles": [{"type": "cone"}]}')
    with pytest.raises(
        rd.RedundancyError, match=r"scene\.json.*obstacle 0 \(cone\).*sphere, box, capsule, cylinder"
    ):
        rd.Scene.from_json(file)
    file.write_text('{"obstacles": [{"type": "sphere", "center": [0, 0, 0], "radius": -0.5}]}')
    with pytest.raises(rd.RedundancyError, match=r"obstacle 0 \(sphere\): radius is -0\.5"):
        rd.Scene.from_json(file)
    with pytest.raises(rd.RedundancyError, match="nowhere"):
        rd.Scene.from_json(tmp_path / "nowhere.json")


def test_scenes_pickle_and_move() -> None:
    scene = rd.Scene([rd.Sphere((0, 0, 1), 0.1, velocity=(0.5, 0, 0)), *scene_of_five().obstacles])
    again = pickle.loads(pickle.dumps(scene))
    assert again == scene
    assert repr(again) == "Scene(sphere, sphere, box, capsule, sphere, capsule)"
    for obstacle in scene.obstacles:
        assert pickle.loads(pickle.dumps(obstacle)) == obstacle
    np.testing.assert_allclose(scene.at(2.0).obstacles[0].center, (1, 0, 1))
    near = scene.clearance(rd.catalog.load("pa10"), np.zeros((3, 7)))
    assert repr(pickle.loads(pickle.dumps(near))) == repr(near)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(near)).normal, near.normal)


def test_an_empty_scene_is_far_away() -> None:
    chain = rd.catalog.load("pa10")
    near = rd.Scene().clearance(chain, np.zeros(7))
    assert (near.distance, near.link, near.obstacle, near.normal) == (np.inf, None, None, None)
    assert rd.Scene([]).clearance(chain, np.zeros((2, 7))).distance.tolist() == [np.inf, np.inf]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: rd.Sphere((0, 0, 0), -1), "radius is -1"),
        (lambda: rd.Sphere((0, 0), 1), "center: expected 3"),
        (lambda: rd.Sphere((0, 0, np.nan), 1), "center"),
        (lambda: rd.Box(np.eye(4), (1, -1, 1)), "half extent y is -1"),
        (lambda: rd.Box(2 * np.eye(4), (1, 1, 1)), "pose"),
        (lambda: rd.Capsule((0, 0, 0), (0, 0, np.inf), 1), "end"),
        (lambda: rd.Scene([3]), "obstacle 0 is 3, expected a Sphere"),
        (lambda: rd.Scene([]).clearance(rd.catalog.load("pa10"), np.zeros(6)), "shape"),
        (
            lambda: rd.Scene([]).clearance(rd.catalog.load("pa10"), np.zeros(7), link_radius=-1),
            "link_radius is -1",
        ),
        (lambda: rd.Clearance(rd.catalog.load("pa10"), rd.Scene([]), smoothing=-1), "smoothing is -1"),
        (lambda: rd.Elbow(rd.catalog.load("pa10"), (0, 0, 0), link="elbow"), "unknown link 'elbow'"),
    ],
)
def test_bad_input_is_named(make, message) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(rd.RedundancyError, match=message):
        make()


BODIES = {
    "sphere": '<sphere radius="0.06"/>',
    "cylinder": '<cylinder radius="0.04" length="0.3"/>',
    "box": '<box size="0.1 0.24 0.06"/>',
}


def arm_with_bodies(shapes: Sequence[str]) -> str:
    """Three joints and a tool that is fixed to the last link, one collision body on each."""

    def link(name: str, shape: str) -> str:
        origin = '<origin xyz="0.02 -0.01 0.15" rpy="0.3 -0.2 0.5"/>'
        return (
            f'<link name="{name}"><collision>{origin}<geometry>{BODIES[shape]}</geometry></collision></link>'
        )

    def joint(k: int, kind: str, parent: str, child: str, axis: str) -> str:
        return (
            f'<joint name="j{k}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="0 0.05 0.3" rpy="0.1 0.2 0"/><axis xyz="{axis}"/></joint>'
        )

    links = "".join(link(f"l{k}", shape) for k, shape in enumerate(shapes, start=1))
    joints = (
        joint(1, "continuous", "base", "l1", "0 0 1")
        + joint(2, "continuous", "l1", "l2", "0 1 0")
        + joint(3, "continuous", "l2", "l3", "1 0 0")
        + joint(4, "fixed", "l3", "l4", "1 0 0")
    )
    return f'<robot name="bodies"><link name="base"/>{links}{joints}</robot>'


def nearest_body(xml: str, q: np.ndarray, centre: np.ndarray, radius: float) -> float:
    """The least distance of the collision bodies from a ball, by coal."""
    model = pin.buildModelFromXML(xml)
    bodies = pin.buildGeomFromUrdfString(model, xml, pin.GeometryType.COLLISION)
    data, places = model.createData(), bodies.createData()
    state = np.concatenate([[np.cos(x), np.sin(x)] for x in q])
    pin.updateGeometryPlacements(model, data, bodies, places, state)
    ball, at = coal.Sphere(radius), coal.Transform3s(np.eye(3), centre)
    distances = []
    for body, place in zip(bodies.geometryObjects, places.oMg, strict=True):
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        where = coal.Transform3s(place.rotation, place.translation)
        distances.append(coal.distance(body.geometry, where, ball, at, request, result))
    return float(min(distances))


@pytest.mark.parametrize("tip", ["l3", "l4"])
def test_the_primitive_collision_geometry_of_a_urdf(tip: str) -> None:
    rng = np.random.default_rng(8)
    for shapes in (["sphere"] * 4, ["cylinder", "box", "sphere", "cylinder"]):
        xml = arm_with_bodies(shapes)
        chain = rd.Chain.from_urdf_string(xml, base="base", tip=tip)
        geometry = rd.LinkGeometry.from_urdf_string(chain, xml)
        assert len(geometry) == 4 and geometry.names == ["l1", "l2", "l3", "l4"]
        again = pickle.loads(pickle.dumps(geometry))
        for _ in range(60):
            q, centre = rng.uniform(-3, 3, 3), rng.uniform([-1, -1, -0.4], [1, 1, 1.6])
            scene = rd.Scene([rd.Sphere(centre, 0.05)])
            ours = scene.clearance(chain, q, geometry).distance
            theirs = nearest_body(xml, q, centre, 0.05)
            assert scene.clearance(chain, q, again).distance == ours
            assert rd.Clearance(chain, scene, geometry, smoothing=0).value(q) == ours
            if theirs < 1e-3:
                continue
            assert ours == pytest.approx(theirs, abs=1e-6)


def test_collision_geometry_that_cannot_be_read() -> None:
    xml = arm_with_bodies(["sphere"] * 4)
    chain = rd.Chain.from_urdf_string(xml, base="base")
    for old, new, message in (
        (
            BODIES["sphere"],
            '<mesh filename="x.stl"/>',
            "x.stl: mesh of link 'l1': no such file; searched: x.stl",
        ),
        (BODIES["sphere"], '<mesh filename="x.stl" scale="1 0 1"/>', "mesh scale is 0"),
        (BODIES["sphere"], "<mesh/>", "link 'l1': collision: mesh has no filename"),
        (BODIES["sphere"], '<sphere radius="-1"/>', "radius is -1, it must be > 0 m"),
        (BODIES["sphere"], '<sphere radius="x"/>', "'x' is not a number"),
        (BODIES["sphere"], "<torus/>", "unknown geometry 'torus'"),
        (BODIES["sphere"], "", "<geometry> is empty"),
        ("<collision>", "<visual>", "no collision geometry"),
    ):
        text = xml.replace(old, new).replace(
            "</collision>", "</visual>" if new == "<visual>" else "</collision>"
        )
        with pytest.raises(rd.RedundancyError, match=re.escape(message)):
            rd.LinkGeometry.from_urdf_string(chain, text)
    with pytest.raises(rd.RedundancyError, match="no moving link of 'pa10' is in the URDF"):
        rd.LinkGeometry.from_urdf_string(rd.catalog.load("pa10"), xml)
    with pytest.raises(rd.RedundancyError, match="chain 'pa10', not of this chain 'bodies'"):
        rd.Scene([]).clearance(chain, np.zeros(3), rd.LinkGeometry(rd.catalog.load("pa10")))
    with pytest.raises(rd.RedundancyError, match="radius"):
        rd.LinkGeometry(chain).with_capsule("l2", [0, 0, 0], [0, 0, 1], -0.1)
    with pytest.raises(rd.RedundancyError, match="l9"):
        rd.LinkGeometry(chain).with_capsule("l9", [0, 0, 0], [0, 0, 1], 0.1)


def test_what_is_no_scene() -> None:
    ball = rd.Sphere((0.5, 0, 0.5), 0.1)
    with pytest.raises(TypeError, match="obstacles is one Sphere, expected a list"):
        rd.Scene(ball)  # type: ignore[arg-type]
    with pytest.raises(rd.RedundancyError, match="unknown key 'x'"):
        rd.Scene.from_json_string('{"obstacles": [], "x": 1}')
    for radius, centre in ((1e300, 0.0), (1.0, 1e155)):
        with pytest.raises(rd.RedundancyError, match=r"must be within \+-1e9 m"):
            rd.Scene([rd.Sphere((centre, 0, 0), radius)])
