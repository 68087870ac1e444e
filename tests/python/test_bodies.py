"""Bodies of arms: meshes, self-collision, clearance per link, allowed contact; distances against coal."""

import os
import pickle
from pathlib import Path
from typing import Any, NamedTuple

import coal
import numpy as np
import pinocchio as pin
import pytest
from arms import example_robots
from numpy.typing import NDArray

import redundancy as rd

Array = NDArray[np.float64]
FULL = os.environ.get("REDUNDANCY_TEST_FULL") == "1"


class Body(NamedTuple):
    """A robot of example-robot-data with its shapes."""

    urdf: str
    srdf: str | None
    base: str
    tip: str


BODIES = {
    "panda": Body(
        "panda_description/urdf/panda.urdf", "panda_description/srdf/panda.srdf", "panda_link0", "panda_link8"
    ),
    "ur5": Body("ur_description/urdf/ur5_robot.urdf", "ur_description/srdf/ur5.srdf", "base_link", "ee_link"),
    "xarm7": Body(
        "xarm_description/urdf/xarm7.urdf", "xarm_description/srdf/xarm7.srdf", "link_base", "link7"
    ),
    "tiago": Body("tiago_description/robots/tiago_no_hand.urdf", None, "torso_lift_link", "arm_tool_link"),
}


def share() -> Path:
    """The folder that holds the package example-robot-data."""
    return example_robots().parents[1]


def load(name: str) -> tuple[rd.Chain, rd.LinkGeometry]:
    body = BODIES[name]
    path = example_robots() / body.urdf
    chain = rd.Chain.from_urdf(path, body.base, body.tip)
    # Where the base stands in the world of the whole robot.
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    chain = chain.with_base(data.oMf[model.getFrameId(body.base)])
    srdf = None if body.srdf is None else example_robots() / body.srdf
    return chain, rd.LinkGeometry.from_urdf(chain, path, package_dirs=[share()], srdf=srdf)


class Coal:
    """The same robot by pinocchio and coal: all of its joints, those outside of the chain where ours have them."""

    def __init__(self, name: str, chain: rd.Chain, pairs: list[tuple[str, str]]) -> None:
        path = str(example_robots() / BODIES[name].urdf)
        self.model = pin.buildModelFromUrdf(path)
        self.geometry = pin.buildGeomFromUrdf(
            self.model, path, pin.GeometryType.COLLISION, None, [str(share())]
        )
        self.link: list[str] = []
        for shape in self.geometry.geometryObjects:
            self.link.append(self.model.frames[shape.parentFrame].name)
            if isinstance(shape.geometry, coal.BVHModelBase):
                shape.geometry.buildConvexHull(True, "Qt")
                shape.geometry = shape.geometry.convex
        for i, a in enumerate(self.link):
            for j, b in enumerate(self.link[:i]):
                if (a, b) in pairs or (b, a) in pairs:
                    self.geometry.addCollisionPair(pin.CollisionPair(j, i))
        self.data, self.places = self.model.createData(), self.geometry.createData()
        for request in self.places.distanceRequests:
            request.gjk_tolerance = 1e-10
        self.home = pin.neutral(self.model)
        self.index = [self.model.joints[self.model.getJointId(j)].idx_q for j in chain.joint_names]
        self.width = [self.model.joints[self.model.getJointId(j)].nq for j in chain.joint_names]

    def place(self, q: Array) -> None:
        state = self.home.copy()
        for at, width, x in zip(self.index, self.width, q, strict=True):
            state[at : at + width] = x if width == 1 else (np.cos(x), np.sin(x))
        pin.updateGeometryPlacements(self.model, self.data, self.geometry, self.places, state)

    def distances(self, q: Array) -> dict[tuple[str, str], float]:
        """The least distance of each pair of links."""
        self.place(q)
        pin.computeDistances(self.geometry, self.places)
        out: dict[tuple[str, str], float] = {}
        for pair, result in zip(self.geometry.collisionPairs, self.places.distanceResults, strict=True):
            key = (self.link[pair.first], self.link[pair.second])
            key = key if key[0] < key[1] else (key[1], key[0])
            d = result.min_distance
            if d < 0:
                d = self.sphere_in_cylinder(pair.first, pair.second, d)
            out[key] = min(out.get(key, np.inf), d)
        return out

    def sphere_in_cylinder(self, first: int, second: int, otherwise: float) -> float:
        """Their signed distance in closed form: coal's depth (3.0.3) is up to 9 mm more than the least translation."""
        for i, j in ((first, second), (second, first)):
            cylinder, ball = (self.geometry.geometryObjects[k].geometry for k in (i, j))
            if isinstance(cylinder, coal.Cylinder) and isinstance(ball, coal.Sphere):
                center = self.places.oMg[i].actInv(self.places.oMg[j].translation)
                out = np.hypot(*center[:2]) - cylinder.radius, abs(center[2]) - cylinder.halfLength
                return float(min(max(out), 0) + np.hypot(*np.maximum(out, 0)) - ball.radius)
        return otherwise

    def to_obstacle(self, q: Array, shape: Any, at: Array) -> dict[str, float]:
        """The least distance of each link from a shape."""
        self.place(q)
        where = coal.Transform3s(at[:3, :3], at[:3, 3])
        request = coal.DistanceRequest()
        request.gjk_tolerance = 1e-10
        out: dict[str, float] = {}
        for name, body, place in zip(self.link, self.geometry.geometryObjects, self.places.oMg, strict=True):
            result = coal.DistanceResult()
            own = coal.Transform3s(place.rotation, place.translation)
            out[name] = min(
                out.get(name, np.inf), coal.distance(body.geometry, own, shape, where, request, result)
            )
        return out


def random_rows(chain: rd.Chain, n: int, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return rng.uniform(np.maximum(chain.lower, -np.pi), np.minimum(chain.upper, np.pi), (n, chain.dof))


@pytest.mark.parametrize("name", list(BODIES))
def test_self_collision_against_coal(name: str) -> None:
    chain, links = load(name)
    assert links.pairs
    other = Coal(name, chain, links.pairs)
    # TIAGo has five times as many pairs.
    rows = random_rows(chain, 2000 if FULL else 20 if name == "tiago" else 100, 5)
    found = links.pair_clearances(rows)
    pairs, distance, row = found.pairs, found.distance, found.row  # each access copies
    least = links.self_clearance(rows)
    touching = 0
    for k, q in enumerate(rows):
        expected = other.distances(q)
        here = np.flatnonzero(row == k)
        ours = {(min(pairs[i]), max(pairs[i])): distance[i] for i in here}
        assert ours.keys() == expected.keys()
        for pair, d in expected.items():
            if abs(d) > 1e-6:
                assert (ours[pair] > 0) == (d > 0), (pair, ours[pair], d)
            assert ours[pair] == pytest.approx(d, abs=1e-6 if d > 0 else 1e-4), pair
        touching += min(expected.values()) < 0
        assert least.distance[k] == pytest.approx(min(ours.values()), abs=1e-9)
        pair = (least.first[k], least.second[k])
        assert ours[min(pair), max(pair)] == pytest.approx(least.distance[k], abs=1e-9)
    assert 0 < touching < len(rows)
    near = links.self_clearance(rows, cutoff=0.05)
    far = least.distance >= 0.05
    np.testing.assert_array_equal(near.distance[far], 0.05)
    np.testing.assert_allclose(near.distance[~far], least.distance[~far], atol=1e-9)
    assert not near.gradient[far].any()
    if name == "panda":
        assert len(other.geometry.collisionPairs) == 44


@pytest.mark.parametrize("name", list(BODIES))
def test_self_clearance_gradients(name: str) -> None:
    chain, links = load(name)
    rows = random_rows(chain, 2000 if FULL else 60, 6)
    least = links.self_clearance(rows)
    step = 1e-5
    h = step * np.eye(chain.dof)
    moved = (rows[:, None, None] + np.stack([h, -h])).reshape(-1, chain.dof)
    near = links.self_clearance(moved)
    ahead, behind = np.moveaxis(near.distance.reshape(len(rows), 2, chain.dof), 1, 0)
    forwards, backwards = (ahead - least.distance[:, None]) / step, (least.distance[:, None] - behind) / step
    # Where a nearest feature changes, the differences to both sides disagree.
    size = np.maximum(np.linalg.norm(least.gradient, axis=1), 0.01)
    smooth = np.linalg.norm(forwards - backwards, axis=1) < 1e-3 * size
    error = np.linalg.norm(0.5 * (forwards + backwards) - least.gradient, axis=1) / size
    # The cylinders of TIAGo are curved: there the differences of a search to 1e-7 disagree more often.
    assert smooth.mean() > (0.7 if name == "tiago" else 0.8)
    assert error[smooth].max() < 1e-3, (np.count_nonzero(error[smooth] > 1e-3), error[smooth].max())


@pytest.mark.parametrize("name", ["panda", "tiago"])
def test_obstacles_against_coal(name: str) -> None:
    chain, links = load(name)
    other = Coal(name, chain, [])
    rng = np.random.default_rng(7)
    tetrahedron = np.array([[0.2, 0, 0], [-0.1, 0.2, 0], [-0.1, -0.2, 0], [0, 0, 0.3]])
    faces = [[0, 1, 3], [1, 2, 3], [2, 0, 3], [0, 2, 1]]
    assert rd.Mesh(tetrahedron, faces).pieces == 1
    bvh = coal.BVHModelOBBRSS()
    bvh.beginModel(1, 4)
    bvh.addVertices(tetrahedron)
    bvh.endModel()
    bvh.buildConvexHull(True, "Qt")
    for _ in range(200 if FULL else 25):
        q = random_rows(chain, 1, int(rng.integers(1 << 30)))[0]
        at = pin.SE3.Random()
        at.translation = rng.uniform(-0.8, 0.8, 3) + np.array([0, 0, 0.5])
        pose = at.homogeneous
        shapes: list[tuple[Any, Any]] = [
            (rd.Box(pose, (0.1, 0.2, 0.15)), coal.Box(0.2, 0.4, 0.3)),
            (rd.Cylinder(pose, 0.1, 0.2), coal.Cylinder(0.1, 0.4)),
            (rd.Sphere(pose[:3, 3], 0.12), coal.Sphere(0.12)),
            (rd.Mesh(tetrahedron, faces, pose=pose), bvh.convex),
        ]
        for ours, theirs in shapes:
            near = rd.Scene([ours]).clearance(chain, q, links)
            expected = other.to_obstacle(q, theirs, pose)
            assert set(near.by_link) == set(links.names)
            assert near.distance == min(float(one) for one in near.by_link.values())
            for link, one in near.by_link.items():
                d = expected[link]
                if abs(d) > 1e-6:
                    assert (one.distance > 0) == (d > 0)
                # Cylinders of the URDF against curved obstacles: coal stops at its own tolerance.
                if d > 0:
                    assert one.distance == pytest.approx(d, abs=2e-6)
                assert one.link == link


def test_found_pairs_as_srdf(tmp_path: Path) -> None:
    chain, links = load("tiago")
    reasons = {reason for *_, reason in links.left_out}
    assert "Adjacent" in reasons and reasons <= {"Adjacent", "Always", "Never"}
    file = tmp_path / "found.srdf"
    file.write_text(links.to_srdf())
    path = example_robots() / BODIES["tiago"].urdf
    again = rd.LinkGeometry.from_urdf(chain, path, package_dirs=[share()], srdf=file)
    assert sorted(again.pairs) == sorted(links.pairs)
    first, second = links.pairs[0]
    assert (first, second) not in links.allow(first, second).pairs
    with pytest.raises(rd.RedundancyError, match="unknown link 'leg'"):
        links.allow(first, "leg")


def test_a_missing_mesh_names_the_places() -> None:
    chain, _ = load("panda")
    text = (example_robots() / BODIES["panda"].urdf).read_text().replace("link3.stl", "link33.stl")
    with pytest.raises(
        rd.RedundancyError, match=r"link33\.stl.*'panda_link3'.*searched: .*example-robot-data"
    ):
        rd.LinkGeometry.from_urdf_string(chain, text, package_dirs=[share()])
    with pytest.raises(rd.RedundancyError, match="package_dirs"):
        rd.LinkGeometry.from_urdf_string(chain, text)
    with pytest.raises(rd.RedundancyError, match="meshes are refused"):
        rd.LinkGeometry.from_urdf_string(chain, text, meshes="refuse")
    with pytest.raises(rd.RedundancyError, match="hull, decompose, refuse"):
        rd.LinkGeometry.from_urdf_string(chain, text, meshes="boxes")  # type: ignore[arg-type]


def test_posture_of_other_joints() -> None:
    chain, closed = load("panda")
    path = example_robots() / BODIES["panda"].urdf
    srdf = example_robots() / "panda_description/srdf/panda.srdf"
    opened = rd.LinkGeometry.from_urdf(
        chain, path, package_dirs=[share()], srdf=srdf, posture={"panda_finger_joint1": 0.04}
    )
    q = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8])
    finger = chain.forward(q, link="panda_link8")[:3, 3]
    far = rd.Scene([rd.Sphere(finger - np.array([0, 0, 0.5]), 0.01)])
    before, after = (far.clearance(chain, q, links).by_link["panda_leftfinger"] for links in (closed, opened))
    assert abs(before.distance - after.distance) > 1e-4
    with pytest.raises(rd.RedundancyError, match="moves with the chain"):
        rd.LinkGeometry.from_urdf(chain, path, package_dirs=[share()], posture={"panda_joint1": 0.0})
    padded = rd.LinkGeometry.from_urdf(chain, path, package_dirs=[share()], srdf=srdf, padding=0.01)
    assert padded.self_clearance(q).distance == pytest.approx(
        closed.self_clearance(q).distance - 0.02, abs=1e-6
    )


def test_links_pickle_and_grow() -> None:
    chain, links = load("xarm7")
    q = random_rows(chain, 20, 9)
    again = pickle.loads(pickle.dumps(links))
    assert (again.names, again.pairs, again.left_out) == (links.names, links.pairs, links.left_out)
    np.testing.assert_allclose(again.self_clearance(q).distance, links.self_clearance(q).distance, atol=1e-12)
    for result in (links.self_clearance(q), links.self_clearance(q[0]), links.pair_clearances(q)):
        copy = pickle.loads(pickle.dumps(result))
        np.testing.assert_array_equal(copy.distance, result.distance)
    tool = rd.Cylinder(np.eye(4), 0.03, 0.2)
    longer = links.with_shape("link7", tool, pose=pin.SE3(np.eye(3), np.array([0, 0, 0.3])))
    assert len(longer) == len(links) + 1 and longer.pairs == links.pairs
    assert (longer.self_clearance(q).distance <= links.self_clearance(q).distance + 1e-12).all()
    with pytest.raises(rd.RedundancyError, match="half_space"):
        links.with_shape("link7", rd.HalfSpace((0, 0, 0), (0, 0, 1)))
    with pytest.raises(rd.RedundancyError, match="unknown link 'gripper'"):
        links.with_shape("gripper", tool)


def test_new_obstacles_in_files_and_pickles(tmp_path: Path) -> None:
    pose = np.eye(4)
    pose[:3, 3] = (0.5, 0, 0.2)
    tetrahedron = [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]
    faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    scene = rd.Scene(
        [
            rd.Cylinder(pose, 0.1, 0.2, name="post", velocity=(0, 0.1, 0)),
            rd.HalfSpace((0, 0, -0.1), (0, 0, 2), name="floor"),
            rd.Mesh(tetrahedron, faces, pose=pose, name="wedge", solid="hull"),
            rd.Capsule((0, 0, 0), (0, 0, 0.1), 0.02, name="tool", attached_to="link7"),
        ],
        allowed=[("tool", "post"), ("link7", "wedge")],
    )
    for again in (pickle.loads(pickle.dumps(scene)), rd.Scene.from_json_string(scene.to_json())):
        assert again.allowed == scene.allowed
        assert [o.name for o in again.obstacles] == ["post", "floor", "wedge", "tool"]
        assert again.obstacles[3].attached_to == "link7"
        assert again.to_json() == scene.to_json()
    chain = rd.catalog.load("pa10")
    q = np.full(7, 0.3)
    assert scene.clearance(chain, q).distance == pytest.approx(again.clearance(chain, q).distance, abs=1e-12)
    (tmp_path / "wedge.obj").write_text(
        "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    )
    file = tmp_path / "scene.json"
    file.write_text('{"obstacles": [{"type": "mesh", "file": "wedge.obj", "center": [0.5, 0, 0.2]}]}')
    mesh = rd.Scene.from_json(file).obstacles[0]
    assert isinstance(mesh, rd.Mesh) and mesh.pieces == 1 and len(mesh.faces) == 4
    np.testing.assert_allclose(
        rd.Mesh.from_file(tmp_path / "wedge.obj", scale=2.0).vertices, 2 * mesh.vertices
    )
    for text, message in (
        ('{"obstacles": [], "allowed": [["a"]]}', "pairs of names"),
        ('{"obstacles": [], "allowed": [["a", "b"]]}', "neither 'a' nor 'b'"),
        ('{"obstacles": [{"type": "mesh", "file": "x.obj", "vertices": []}]}', "both file and vertices"),
        ('{"obstacles": [{"type": "mesh", "vertices": [[0, 0, 0]], "faces": [[0, 0, 1]]}]}', "vertex index"),
        (
            '{"obstacles": [{"type": "half_space", "point": [0, 0, 0], "normal": [0, 0, 0]}]}',
            "normal has length",
        ),
        (
            '{"obstacles": [{"type": "half_space", "point": [0, 0, 0], "normal": [0, 0, 1], "attached_to": "a"}]}',
            "half-space",
        ),
        (
            '{"obstacles": [{"type": "sphere", "center": [0, 0, 0], "radius": 1, "name": ""}]}',
            "name is empty",
        ),
    ):
        with pytest.raises(rd.RedundancyError, match=message):
            rd.Scene.from_json_string(text)
    with pytest.raises(rd.RedundancyError, match="unknown link 'hand'"):
        rd.Scene([rd.Sphere((0, 0, 0), 0.1, attached_to="hand")]).clearance(chain, q)


def pinned(gap: float | None) -> tuple[rd.SrsArm, rd.Path, rd.Scene, rd.Scene]:
    """The PA10 on a circle beside a ball, and a pin that the swivel cannot avoid."""
    arm = rd.SrsArm(rd.catalog.load("pa10"))
    path = rd.paths.circle((0.45, 0, 0.5), 0.12, orientation=np.diag([-1.0, 1, -1]), n=241)
    path = path.with_times(np.linspace(0, 6, 241))
    ball = rd.Sphere((0.2842, -0.3539, 0.4817), 0.06, name="ball")
    obstacles: list[Any] = [ball]
    if gap is not None:
        radius = float(np.hypot(0.12, 0.10)) - 0.05 - gap
        obstacles.append(rd.Capsule((0.45, 0, 0.2), (0.45, 0, 0.4), radius, name="pin"))
    return arm, path, rd.Scene(obstacles), rd.Scene([ball])


def from_ball(arm: rd.SrsArm, ball: rd.Scene, rows: Array) -> float:
    return float(ball.clearance(arm.chain, rows, link_radius=0.05).distance.min())


def test_the_elbow_keeps_its_clearance_beside_a_pin() -> None:
    kept = {}
    for gap in (None, 0.015, 0.005, 0.001):
        arm, path, scene, ball = pinned(gap)
        plan = rd.plan_swivel(arm, path, scene, desired=-np.pi / 2, wanted_clearance=0.03, link_radius=0.05)
        assert (plan.status, plan.legal) == ("converged", True), plan.reason
        flow = rd.SwivelFlow(arm, -np.pi / 2, scene, link_radius=0.05)
        followed = flow.follow(path, float(plan.swivel[0]), 0.01)
        assert followed.status == "converged", followed.reason
        chain = arm.chain
        h = rd.Clearance(chain, scene, link_radius=0.05)
        resolver = rd.SaturatedNullspace(chain, h, gain=2.0)
        pose = path.poses[0]
        q = arm.solve(pose, -1.35, limits=False)[0]
        qd = np.zeros(7)
        for _ in range(300):
            error = pose[:3, 3] - chain.forward(q)[:3, 3]
            turn = pin.log3(pose[:3, :3] @ chain.forward(q)[:3, :3].T)
            qd = resolver.step(q, 10 * np.concatenate([error, turn]), dt=0.01, qd=qd).qd
            q = q + 0.01 * qd
        kept[gap] = (
            from_ball(arm, ball, plan.q),
            from_ball(arm, ball, followed.q),
            from_ball(arm, ball, q[None]),
        )
        if gap is not None:
            assert plan.clearance is not None and plan.clearance.min() == pytest.approx(gap, abs=1e-4)
    assert kept[None] == pytest.approx((0.030, 0.030, 0.0559), abs=1e-3)
    for gap in (0.015, 0.005, 0.001):
        assert kept[gap][:2] == pytest.approx(kept[None][:2], abs=1e-3), kept
        # Going on, the step would take the forearm into the pin: it stops between ball and pin.
        assert 0.002 < kept[gap][2] < kept[None][2], kept


def test_contact_that_the_path_forces() -> None:
    arm, path, scene, ball = pinned(-0.002)
    plan = rd.plan_swivel(arm, path, scene, desired=-np.pi / 2, wanted_clearance=0.03, link_radius=0.05)
    assert (plan.status, plan.legal, len(plan.q)) == ("collision", False, 241)
    for part in ("link7", "'pin'", "2.000 mm"):
        assert part in plan.reason, plan.reason
    assert from_ball(arm, ball, plan.q) == pytest.approx(0.030, abs=1e-3)
    links = {pair.link for pair in scene.clearance(arm.chain, plan.q[0], 0.05).by_link.values()}
    allowed = rd.Scene(scene.obstacles, allowed=[(link, "pin") for link in links])
    plan = rd.plan_swivel(arm, path, allowed, desired=-np.pi / 2, wanted_clearance=0.03, link_radius=0.05)
    assert (plan.status, plan.legal) == ("converged", True), plan.reason
    flow = rd.SwivelFlow(arm, -np.pi / 2, scene, link_radius=0.05).follow(path, float(plan.swivel[0]), 0.01)
    assert flow.status == "collision" and "'pin'" in flow.reason
    assert from_ball(arm, ball, flow.q) > 0.02


def test_a_step_keeps_its_distance() -> None:
    chain = rd.catalog.load("iiwa14")
    q0 = np.array([0.0, 0.6, 0.0, -1.4, 0.0, 0.8, 0.0])
    tool = chain.forward(q0)[:3, 3]
    ball = rd.Sphere(tool + np.array([0.35, 0, 0]), 0.1, velocity=(-0.1, 0, 0), name="ball")
    scene, links = rd.Scene([ball]), rd.LinkGeometry(chain, 0.05)
    scheme = rd.SaturatedNullspace(
        chain, task=rd.Task("position"), scene=scene, links=links, safe_distance=0.02
    )
    q, qd, least, pairs = q0, np.zeros(7), np.inf, set()
    for k in range(300):
        step = scheme.step(q, [0.3, 0, 0], dt=0.01, qd=qd, t=0.01 * k)
        pairs.update(pair[:2] for pair in step.limiting_pairs)
        qd = step.qd
        q = q + 0.01 * qd
        there = rd.Sphere(tool + np.array([0.35 - 0.1 * 0.01 * (k + 1), 0, 0]), 0.1)
        least = min(least, rd.Scene([there]).clearance(chain, q, links).distance)
    assert 0.0197 < least < 0.03
    assert any("ball" in pair for pair in pairs), pairs
    with pytest.raises(rd.RedundancyError, match="safe_distance is -1"):
        rd.SaturatedNullspace(chain, scene=scene, safe_distance=-1.0)
    with pytest.raises(rd.RedundancyError, match="barrier_rate is 0"):
        rd.SaturatedNullspace(chain, scene=scene, barrier_rate=0.0)
    # The same way in closed loop: contact is an event and the status, a hard distance prevents it.
    poses = np.repeat(chain.forward(q0)[None], 51, axis=0)
    poses[:, 0, 3] += np.linspace(0, 0.15, 51)
    path = rd.Path(poses).with_times(np.linspace(0, 2, 51))
    still = rd.Scene([rd.Sphere(tool + np.array([0.25, 0, 0]), 0.1, name="ball")])
    blind = rd.track(
        chain, rd.SaturatedNullspace(chain), path, q0, dt=0.01, feedback=20.0, scene=still, links=links
    )
    assert blind.status == "collision" and "'ball'" in blind.reason
    assert [event.kind for event in blind.events if event.kind == "contact"] == ["contact"]
    assert blind.clearance is not None and blind.clearance.min() < 0
    seeing = rd.SaturatedNullspace(chain, scene=still, links=links)
    run = rd.track(chain, seeing, path, q0, dt=0.01, feedback=20.0)
    assert run.status == "off_path" and run.clearance is not None
    assert run.clearance.min() > 0.0195


def test_criteria_take_links() -> None:
    chain, links = load("panda")
    rows = random_rows(chain, 10, 21)
    scene = rd.Scene([rd.Sphere((0.4, 0.1, 0.5), 0.1)])
    beside, own = (
        rd.Clearance(chain, scene, links=links, smoothing=0.0),
        rd.SelfClearance(chain, links, smoothing=0.0),
    )
    both = rd.Clearance(chain, scene, links=links, self_collision=True, smoothing=0.0)
    for q in rows:
        expected = scene.clearance(chain, q, links).distance, links.self_clearance(q).distance
        assert beside.value(q) == pytest.approx(expected[0], abs=1e-9)
        assert own.value(q) == pytest.approx(expected[1], abs=1e-9)
        assert both.value(q) == pytest.approx(min(expected), abs=1e-9)
        np.testing.assert_allclose(own.gradient(q), links.self_clearance(q).gradient, atol=1e-9)
    bare = links
    for first, second in links.pairs:
        bare = bare.allow(first, second)
    with pytest.raises(rd.RedundancyError, match="no pairs"):
        rd.SelfClearance(chain, bare)
