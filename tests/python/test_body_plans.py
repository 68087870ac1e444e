"""Plans of an S-R-S arm with meshes as links, beside meshes: clear, and truly blocked, under coal."""

import json
import os
from pathlib import Path
from typing import Any, NamedTuple

import coal
import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import redundancy as rd
from redundancy import _commands

Array = NDArray[np.float64]
FULL = os.environ.get("REDUNDANCY_TEST_FULL") == "1"
# Joint axes, offsets of the joints along z of the link before (m), and the segment of each link's body.
JOINTS = [("z", 0.15), ("y", 0.19), ("z", 0.21), ("-y", 0.19), ("z", 0.21), ("y", 0.19), ("z", 0.06)]
LENGTHS = [0.13, 0.17, 0.19, 0.17, 0.19, 0.04, 0.05]


def blob(rng: np.random.Generator, half: Array, n: int = 40) -> Array:
    """Points whose hull is a lump of the given half extents."""
    points = rng.normal(size=(n, 3))
    return np.asarray(points / np.linalg.norm(points, axis=1)[:, None] * half)


def hull(points: Array) -> Any:
    model = coal.BVHModelOBBRSS()
    model.beginModel(1, len(points))
    model.addVertices(points)
    model.endModel()
    model.buildConvexHull(True, "Qt")
    return model.convex


def as_obj(points: Array) -> str:
    """All points, and enough triangles to name each: only their hull counts."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
    lines += [f"f {i} {i + 1} {i + 2}" for i in range(1, len(points) - 1)]
    return "\n".join(lines) + "\n"


class Bodied(NamedTuple):
    file: Path
    arm: rd.SrsArm
    links: rd.LinkGeometry
    model: pin.Model
    hulls: list[tuple[int, pin.SE3, Any]]
    pairs: list[tuple[int, int]]


@pytest.fixture(scope="module")
def bodied(tmp_path_factory: pytest.TempPathFactory) -> Bodied:
    folder: Path = tmp_path_factory.mktemp("arm")
    rng = np.random.default_rng(3)
    text, names, hulls = ['<robot name="lumps"><link name="base"/>'], ["base"], []
    for k, ((axis, offset), length) in enumerate(zip(JOINTS, LENGTHS, strict=True), start=1):
        points = blob(rng, np.array([0.055, 0.055, 0.5 * length + 0.03]))
        (folder / f"link{k}.obj").write_text(as_obj(points))
        xyz = {"z": "0 0 1", "y": "0 1 0", "-y": "0 -1 0"}[axis]
        text.append(
            f'<link name="link{k}"><collision><origin xyz="0 0 {length / 2}"/><geometry>'
            f'<mesh filename="link{k}.obj"/></geometry></collision></link>'
            f'<joint name="joint{k}" type="revolute"><parent link="{names[-1]}"/><child link="link{k}"/>'
            f'<origin xyz="0 0 {offset}"/><axis xyz="{xyz}"/>'
            '<limit lower="-2.9" upper="2.9" velocity="2" effort="100"/></joint>'
        )
        names.append(f"link{k}")
        hulls.append((k, pin.SE3(np.eye(3), np.array([0, 0, length / 2])), hull(points)))
    file = folder / "lumps.urdf"
    file.write_text("".join(text) + "</robot>")
    chain = rd.Chain.from_urdf(file)
    links = rd.LinkGeometry.from_urdf(chain, file)
    pairs = [(names.index(a), names.index(b)) for a, b in links.pairs]
    assert len(pairs) >= 6
    return Bodied(file, rd.SrsArm(chain), links, pin.buildModelFromUrdf(str(file)), hulls, pairs)


class Judge:
    """Contact by coal: of links with obstacles, and with each other."""

    def __init__(self, body: Bodied, obstacles: list[tuple[Any, pin.SE3]]) -> None:
        self.body, self.data = body, body.model.createData()
        self.obstacles = [(shape, coal.Transform3s(at.rotation, at.translation)) for shape, at in obstacles]

    def touches(self, q: Array) -> bool:
        pin.forwardKinematics(self.body.model, self.data, q)
        places = []
        for joint, own, _ in self.body.hulls:
            at = self.data.oMi[joint] * own
            places.append(coal.Transform3s(at.rotation, at.translation))
        hulls = [shape for *_, shape in self.body.hulls]
        request = coal.CollisionRequest()

        def hit(a: Any, at: Any, b: Any, there: Any) -> bool:
            return bool(coal.collide(a, at, b, there, request, coal.CollisionResult()))

        if any(
            hit(shape, at, other, there)
            for shape, at in zip(hulls, places, strict=True)
            for other, there in self.obstacles
        ):
            return True
        return any(hit(hulls[a - 1], places[a - 1], hulls[b - 1], places[b - 1]) for a, b in self.body.pairs)


def random_path(body: Bodied, rng: np.random.Generator) -> rd.Path:
    """A straight way of the tool within reach."""
    chain = body.arm.chain
    while True:
        q = rng.uniform(0.6 * chain.lower, 0.6 * chain.upper)
        pose = chain.forward(q)
        if pose[2, 3] > 0.1 and np.hypot(*pose[:2, 3]) > 0.25:
            break
    inwards = np.array([0, 0, 0.34]) - pose[:3, 3]
    way = 0.15 * inwards / np.linalg.norm(inwards) + rng.uniform(-0.08, 0.08, 3)
    poses = np.repeat(pose[None], 16, axis=0)
    poses[:, :3, 3] += np.linspace(0, 1, 16)[:, None] * way
    return rd.Path(poses)


def random_scene(rng: np.random.Generator, path: rd.Path) -> tuple[rd.Scene, list[tuple[Any, pin.SE3]]]:
    obstacles: list[Any] = []
    theirs: list[tuple[Any, pin.SE3]] = []
    tool = path.poses[:, :3, 3]
    while len(obstacles) < 5:
        points = blob(rng, rng.uniform(0.05, 0.18, 3), 30)
        at = pin.SE3.Random()
        at.translation = rng.uniform(-0.6, 0.6, 3) + np.array([0, 0, 0.5])
        # Neither the foot of the arm nor its hand stands in it.
        if np.linalg.norm(tool - at.translation, axis=1).min() < 0.22 or np.hypot(*at.translation[:2]) < 0.25:
            continue
        faces = np.arange(len(points) - 2)[:, None] + np.arange(3)
        obstacles.append(rd.Mesh(points, faces, pose=at.homogeneous, solid="hull"))
        theirs.append((hull(points), at))
    return rd.Scene(obstacles), theirs


def test_plans_beside_meshes(bodied: Bodied) -> None:
    rng = np.random.default_rng(12)
    met = {"converged": 0, "collision": 0, "other": 0}
    for _ in range(50 if FULL else 10):
        path = random_path(bodied, rng)
        scene, obstacles = random_scene(rng, path)
        judge = Judge(bodied, obstacles)
        plan = rd.plan_swivel(
            bodied.arm, path, scene, links=bodied.links, self_collision=True, velocity_limits=None
        )
        if plan.status == "converged":
            met["converged"] += 1
            assert plan.clearance is not None and plan.self_clearance is not None
            assert plan.clearance.min() > 0 and plan.self_clearance.min() > 0
            for a, b in zip(plan.q[:-1], plan.q[1:], strict=True):
                for share in np.linspace(0, 1, 12):
                    assert not judge.touches(a + share * (b - a)), plan.reason
        elif plan.status == "collision":
            met["collision"] += 1
            # On a grid four times as fine every configuration within the limits touches something.
            row = plan.blocked[0]
            for swivel in np.linspace(-np.pi, np.pi, 720, endpoint=False):
                for q in bodied.arm.solve(path.poses[row], swivel):
                    assert judge.touches(q), plan.reason
        else:
            met["other"] += 1
            if plan.status == "infeasible":
                # Each piece is clear all the same.
                for q in plan.q:
                    assert not judge.touches(q)
    assert met["converged"] >= 3, met
    print(met)


def test_a_spray_gun_touches_its_workpiece() -> None:
    chain = rd.catalog.load("pa10")
    arm = rd.SrsArm(chain)
    path = rd.paths.raster((0.4, -0.1, 0.3), 0.2, 0.05, 3, orientation=np.diag([-1.0, 1, -1]), step=0.02)
    pose = np.eye(4)
    pose[:3, 3] = (0.45, 0, 0.26)
    table = rd.Box(pose, (0.2, 0.2, 0.05), name="workpiece")  # its top is 10 mm above the strokes
    last = chain.link_names[-1]
    gun = rd.Capsule((0, 0, -0.02), (0, 0, 0), 0.02, name="gun", attached_to=last)
    links = rd.LinkGeometry(chain, 0.03)
    blocked = rd.plan_swivel(arm, path, rd.Scene([table, gun]), links=links)
    assert (blocked.status, blocked.legal) == ("collision", False)
    assert "workpiece" in blocked.reason and len(blocked.q) == len(path)
    free = rd.Scene([table, gun], allowed=[("gun", "workpiece"), (last, "workpiece")])
    touching = {
        link for link, one in free.clearance(chain, blocked.q[0], links).by_link.items() if float(one) < 0
    }
    free = rd.Scene([table, gun], allowed=[*free.allowed, *((link, "workpiece") for link in touching)])
    plan = rd.plan_swivel(arm, path, free, links=links)
    assert (plan.status, plan.legal) == ("converged", True), plan.reason
    assert free.clearance(chain, plan.q, links).distance.min() > 0


def test_bodies_on_the_command_line(
    bodied: Bodied, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    rng = np.random.default_rng(4)
    path = random_path(bodied, rng)
    path.to_csv(tmp_path / "path.csv")
    ball = rd.Sphere(path.poses[:, :3, 3].mean(axis=0) + np.array([0.0, 0.0, 0.45]), 0.05)
    (tmp_path / "scene.json").write_text(rd.Scene([ball]).to_json())

    def run(*more: Any) -> tuple[int, dict[str, Any], str]:
        words = ["track", "--robot", bodied.file, "--path", tmp_path / "path.csv", "--out", tmp_path / "run"]
        words += ["--obstacles", tmp_path / "scene.json", "--no-plots", *more]
        (tmp_path / "run" / "summary.json").unlink(missing_ok=True)
        status = _commands.run([str(word) for word in words])
        err = capsys.readouterr().err
        summary = tmp_path / "run" / "summary.json"
        return status, json.loads(summary.read_text()) if summary.exists() else {}, err

    status, summary, err = run("--collision", "urdf")
    assert status == 0, err
    assert summary["clearance_m"] > 0 and summary["self_clearance_m"] > 0
    q = rd.Trajectory.from_csv(tmp_path / "run" / "trajectory.csv").q
    least = bodied.links.self_clearance(q).distance.min()
    assert summary["self_clearance_m"] == pytest.approx(least, abs=1e-9)
    every = [(a, b) for i, a in enumerate(bodied.links.names) for b in bodied.links.names[:i]]
    pairs = "".join(f'<disable_collisions link1="{a}" link2="{b}" reason="User"/>' for a, b in every)
    (tmp_path / "all.srdf").write_text(f'<robot name="lumps">{pairs}</robot>')
    status, summary, err = run("--collision", "urdf", "--srdf", tmp_path / "all.srdf")
    assert status == 0 and "self_clearance_m" not in summary, err
    status, summary, err = run("--collision", "none")
    assert status == 0 and "clearance_m" not in summary, err
    for words, message in (
        (("--collision", "boxes"), "--collision is 'boxes', it must be urdf, capsules or none"),
        (("--srdf", "x.srdf"), "--srdf and --package-dir need --collision urdf"),
        (("--collision", "urdf", "--srdf", tmp_path / "no.srdf"), "no.srdf: No such file"),
        (("--collision", "urdf", "--robot", "pa10"), "--collision urdf needs a URDF file, 'pa10' is none"),
    ):
        status, _, err = run(*words)
        assert status == 2 and message in err, err
