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


def build(folder: Path, vertices: int = 40, radius: float = 0.055, over: float = 0.03) -> Bodied:
    """An S-R-S arm whose links are lumps, longer by `over` at both ends; its files are written to a folder."""
    rng = np.random.default_rng(3)
    text, names, hulls = ['<robot name="lumps"><link name="base"/>'], ["base"], []
    for k, ((axis, offset), length) in enumerate(zip(JOINTS, LENGTHS, strict=True), start=1):
        points = blob(rng, np.array([radius, radius, 0.5 * length + over]), vertices)
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


@pytest.fixture(scope="module")
def bodied(tmp_path_factory: pytest.TempPathFactory) -> Bodied:
    return build(tmp_path_factory.mktemp("arm"))


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

    printed: list[Any] = []

    def run(*more: Any) -> tuple[int, dict[str, Any], str]:
        words = ["track", "--robot", bodied.file, "--path", tmp_path / "path.csv", "--out", tmp_path / "run"]
        words += ["--scene", tmp_path / "scene.json", "--no-plots", *more]
        (tmp_path / "run" / "summary.json").unlink(missing_ok=True)
        status = _commands.run([str(word) for word in words])
        printed.append(capsys.readouterr())
        summary = tmp_path / "run" / "summary.json"
        return status, json.loads(summary.read_text()) if summary.exists() else {}, printed[-1].err

    status, summary, err = run("--collision", "urdf")
    assert status == 0, err
    assert summary["clearance_m"] > 0 and summary["self_clearance_m"] > 0
    q = rd.Trajectory.from_csv(tmp_path / "run" / "trajectory.csv").q
    least = bodied.links.self_clearance(q).distance.min()
    assert summary["self_clearance_m"] == pytest.approx(least, abs=1e-9)
    assert f"nearest to itself: {1e3 * least:.1f} mm at point" in printed[-1].out
    # The other name of --scene.
    again = run("--collision", "urdf", "--obstacles", tmp_path / "scene.json")[1]
    assert again["clearance_m"] == summary["clearance_m"]
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


def test_check_of_bodies(bodied: Bodied, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    chain = bodied.arm.chain
    end = np.array([0.4, 0.8, -0.3, -1.0, 0.2, 0.5, 0.1])
    move = rd.retime(chain, np.stack([np.zeros(7), end]), acceleration_limits=np.full(7, 5.0))
    move.to_csv(tmp_path / "move.csv")
    # Beside the forearm's lump: inside of a thick capsule, outside of the hull.
    elbow, wrist = chain.forward(end, link="link4")[:3, 3], chain.forward(end, link="link6")[:3, 3]
    side = np.cross(wrist - elbow, (0, 0, 1))
    near = rd.Sphere(0.5 * (elbow + wrist) + 0.1 * side / np.linalg.norm(side), 0.02, name="near")
    (tmp_path / "near.json").write_text(rd.Scene([near]).to_json())
    sphere = (coal.Sphere(0.02), pin.SE3(np.eye(3), np.asarray(near.center)))
    assert not Judge(bodied, [sphere]).touches(end)

    def kinds(*more: Any) -> tuple[int, list[str], str]:
        words = ["check", tmp_path / "move.csv", "--robot", bodied.file, "--format", "json", *more]
        status = _commands.run([str(word) for word in words])
        out = capsys.readouterr()
        findings = json.loads(out.out)["findings"] if out.out else []
        return status, [f["kind"] for f in findings if f["severity"] == "error"], out.err

    assert kinds()[:2] == (0, [])
    for name in ("--scene", "--obstacles"):
        scene = (name, tmp_path / "near.json", "--link-radius", 0.1)
        status, found, _ = kinds(*scene)
        assert status == 1 and set(found) == {"collision"}
        assert kinds(*scene, "--collision", "urdf")[:2] == (0, [])
        assert kinds(*scene, "--collision", "none")[:2] == (0, [])
    for words, message in (
        (("--package-dir", tmp_path), "--srdf and --package-dir need --collision urdf"),
        (("--collision", "urdf", "--robot", "pa10"), "--collision urdf needs a URDF file, 'pa10' is none"),
        (("--collision", "boxes"), "--collision is 'boxes', it must be urdf, capsules or none"),
    ):
        status, _, err = kinds(*words)
        assert status == 2 and message in err, err


def test_check_finds_self_collision(
    bodied: Bodied, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    chain, links = bodied.arm.chain, bodied.links
    rows = np.random.default_rng(6).uniform(chain.lower, chain.upper, (400, 7))
    touching = rows[int(np.argmin(links.self_clearance(rows).distance))]
    move = rd.retime(chain, np.stack([np.zeros(7), touching]), acceleration_limits=np.full(7, 5.0))
    move.to_csv(tmp_path / "move.csv")

    def kinds(*more: Any) -> tuple[int, set[str]]:
        words = ["check", tmp_path / "move.csv", "--robot", bodied.file, "--format", "json", *more]
        status = _commands.run([str(word) for word in words])
        findings = json.loads(capsys.readouterr().out)["findings"]
        return status, {f["kind"] for f in findings if "collision" in f["kind"]}

    # coal, with the same hulls and pairs, says the same of the motion's ends.
    judge = Judge(bodied, [])
    assert judge.touches(touching) and not judge.touches(np.zeros(7))
    report = rd.check(chain, move, links=links)
    found = next(f for f in report.findings if f.kind == "self_collision")
    assert found.value < 0 and "overlap" in found.message and not report.ok
    then = links.self_clearance(move.sample(found.t)[0])
    assert found.value == pytest.approx(float(then.distance), abs=1e-9)
    assert f"'{then.first}'" in found.message and f"'{then.second}'" in found.message
    assert "self_collision" not in {f.kind for f in rd.check(chain, move).findings}
    assert kinds() == (0, set())
    assert kinds("--collision", "urdf") == (1, {"self_collision"})
    every = [(a, b) for i, a in enumerate(links.names) for b in links.names[:i]]
    pairs = "".join(f'<disable_collisions link1="{a}" link2="{b}" reason="User"/>' for a, b in every)
    (tmp_path / "all.srdf").write_text(f'<robot name="lumps">{pairs}</robot>')
    assert kinds("--collision", "urdf", "--srdf", tmp_path / "all.srdf") == (0, set())
    # Contact between links is allowed in their geometry.
    ball = rd.Sphere((0.0, 0.0, 3.0), 0.05)
    allowed = links
    for first, second in links.pairs:
        allowed = allowed.allow(first, second)
    assert rd.check(chain, move, scene=rd.Scene([ball]), links=allowed).ok


def test_the_forearm_is_between_the_ball_and_the_pin() -> None:
    """Why a pin costs a saturated step its distance from a ball: at that distance the forearm would be in the pin."""
    chain = rd.catalog.load("pa10")
    arm = rd.SrsArm(chain)
    path = rd.paths.circle((0.45, 0, 0.5), 0.12, orientation=np.diag([-1.0, 1.0, -1.0]), n=241)
    branch = arm.self_motion(path.poses[0]).branches[0]
    swivels = np.arange(-1.352, -1.1, 2e-4)
    rows = np.array([branch.q(s) for s in swivels])
    elbows, wrist = chain.forward(rows, link="link4")[:, :3, 3], chain.forward(rows[0], link="link6")[:3, 3]

    def from_axis(points: Array) -> Array:
        """Least distance of the forearm's axis from any of some points, for each swivel."""
        along = wrist - elbows
        share = np.einsum("skd,sd->sk", points - elbows[:, None], along) / (along**2).sum(axis=1)[:, None]
        foot = elbows[:, None] + np.clip(share, 0, 1)[:, :, None] * along[:, None]
        return np.asarray(np.linalg.norm(points - foot, axis=2).min(axis=1))

    ball = rd.Sphere((0.2842, -0.3539, 0.4817), 0.06, name="ball")
    from_ball = from_axis(np.array([ball.center])) - 0.05 - 0.06
    axis = from_axis(np.stack([np.full(401, 0.45), np.zeros(401), np.linspace(0.2, 0.4, 401)], axis=1))
    as_without = int(np.argmax(from_ball >= 0.0559))
    assert swivels[as_without] == pytest.approx(-1.1739, abs=1e-3)
    for gap, there, at_ball, at_pin in (
        (0.015, 0.0033, 0.0163, 0.0133),
        (0.005, -0.0067, 0.0081, 0.0053),
        (0.001, -0.0107, 0.0050, 0.0020),
    ):
        radius = float(np.hypot(0.12, 0.10)) - 0.05 - gap
        from_pin = axis - 0.05 - radius
        assert from_pin[as_without] == pytest.approx(there, abs=2e-4)
        # The maximum of the criterion, where the saturated step ends; the hand is held and does not count.
        pin_obstacle = rd.Capsule((0.45, 0, 0.2), (0.45, 0, 0.4), radius, name="pin")
        scene = rd.Scene([ball, pin_obstacle], allowed=[("link7", "pin")])
        h = rd.Clearance(chain, scene)
        values = np.array([h.value(q) for q in rows])
        best = int(np.argmax(values))
        assert from_ball[best] == pytest.approx(at_ball, abs=3e-4)
        assert from_pin[best] == pytest.approx(at_pin, abs=3e-4)
        # No swivel between the two is further from both than the smoothing explains.
        assert np.minimum(from_ball, from_pin).max() < at_pin + 1e-3
        # The step itself, held at the pose for 3 s.
        seen = rd.Clearance(chain, rd.Scene([ball, pin_obstacle]))
        step = rd.SaturatedNullspace(chain, seen, 2.0)
        q, qd = np.asarray(branch.q(-1.35)), np.zeros(7)
        for _ in range(300):
            at = chain.forward(q)
            turn = path.poses[0][:3, :3] @ at[:3, :3].T
            angular = 0.5 * np.array(
                [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
            )
            v = 10 * np.r_[path.poses[0][:3, 3] - at[:3, 3], angular]
            qd = np.asarray(step.step(q, v, 0.01, qd).qd)
            q = q + 0.01 * qd
        assert values[best] - h.value(q) < 2e-4
