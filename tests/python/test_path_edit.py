"""Paths from positions and quaternions, moved, reversed, joined; trajectories between their rows; poses;
quaternions."""

import pickle
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import BPoly, CubicHermiteSpline
from scipy.spatial.transform import Rotation

import redundancy as rd

FLIP = np.diag([-1.0, 1.0, -1.0])


def random_poses(n: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :3, 3] = np.cumsum(rng.uniform(0.01, 0.05, (n, 3)), axis=0)
    poses[:, :3, :3] = Rotation.from_rotvec(np.cumsum(rng.uniform(-0.1, 0.1, (n, 3)), axis=0)).as_matrix()
    return poses


def test_positions_and_quaternions_make_a_path() -> None:
    poses = random_poses(20, 1)
    wxyz = Rotation.from_matrix(poses[:, :3, :3]).as_quat(scalar_first=True)
    path = rd.Path(positions=poses[:, :3, 3], quaternions_wxyz=wxyz)
    assert np.abs(path.poses - poses).max() < 1e-15
    rounded = rd.Path(positions=poses[:, :3, 3], quaternions_wxyz=wxyz * (1 + 9e-4))
    assert np.abs(rounded.poses - poses).max() < 1e-15
    one = rd.Path(positions=poses[:, :3, 3], quaternions_wxyz=wxyz[3], t=np.arange(20.0))
    assert np.abs(one.poses[:, :3, :3] - poses[3, :3, :3]).max() < 1e-15 and one.t[-1] == 19
    assert not rd.Path(positions=poses[:, :3, 3]).has_orientation


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({}, "give poses, or positions"),
        ({"poses": np.tile(np.eye(4), (3, 1, 1)), "positions": np.eye(3)}, "not both"),
        ({"quaternions_wxyz": np.eye(4)}, "need positions"),
        ({"positions": [0.0, 1.0, 2.0]}, r"positions has shape \(3,\), expected \(N, 3\)"),
        ({"positions": np.eye(3), "quaternions_wxyz": np.eye(4)}, r"\(rows\): expected 3 entries, got 4"),
        (
            {"positions": np.eye(3), "quaternions_wxyz": [1, 0.1, 0, 0]},
            "quaternions_wxyz: quaternion .* has norm 1.00",
        ),
        (
            {"positions": np.eye(3), "quaternions_wxyz": [[1, 0, 0, 0], [1, 0, 0, 0.1], [1, 0, 0, 0]]},
            r"quaternions_wxyz\[1\]: quaternion .* has norm",
        ),
        ({"positions": [["a", "b", "c"]] * 2}, "array of strings"),
        ({"poses": np.eye(4)}, "at least two samples, got 1"),
        (
            {"poses": np.zeros((3, 5))},
            r"poses has shape \(3, 5\), expected \(N, 4, 4\) or positions \(N, 3\)",
        ),
        ({"poses": np.ma.masked_array(np.eye(3), mask=np.eye(3))}, "poses has masked entries"),
    ],
)
def test_samples_that_make_no_path(options, text: str) -> None:
    with pytest.raises(rd.RedundancyError, match=text):
        rd.Path(**options)


def test_paths_are_moved_reversed_and_joined() -> None:
    by = random_poses(3, 4)[2]
    spline = rd.Path(random_poses(30, 2), t=np.arange(30.0) ** 1.5)
    circle = rd.paths.circle((0.4, 0.1, 0.3), 0.2, 0.3, 0.8, (0.2, -0.4, 0.7), FLIP, n=80)
    raster = rd.paths.raster((0.3, -0.2, 0.1), 0.4, 0.1, 3, corner=0.05, orientation=FLIP)
    for path in (spline, circle, raster):
        s = np.linspace(0, path.length, 57)
        moved = path.transformed(by)
        assert np.abs(moved.pose(s) - by @ path.pose(s)).max() < 1e-13
        assert np.array_equal(moved.s, path.s)
        back = path.reversed()
        assert np.abs(back.pose(path.length - s) - path.pose(s)).max() < 1e-12
        assert repr(moved)[:10] == repr(path)[:10] == repr(back)[:10]
        for other in (moved, back):
            assert pickle.loads(pickle.dumps(other)) == other
    joined = circle.joined(raster)
    assert len(joined) == len(circle) + len(raster) and "joined" in repr(joined)
    s = np.linspace(0, raster.length, 41)
    assert np.abs(joined.pose(joined.length - raster.length + s) - raster.pose(s)).max() < 1e-12
    assert pickle.loads(pickle.dumps(joined)) == joined
    assert np.allclose(np.diff(spline.reversed().t), np.diff(spline.t)[::-1])
    with pytest.raises(rd.RedundancyError, match="only one of the two paths has times"):
        spline.joined(raster)
    # An arm follows a joined path.
    arm = rd.catalog.load("iiwa14")
    first = rd.paths.circle((0.5, 0.0, 0.4), 0.1, orientation=FLIP, n=40)
    second = first.transformed(rd.pose((0.0, 0.0, 0.1)))
    plan = rd.plan_swivel(rd.SrsArm(arm), first.joined(second))
    assert plan.status == "converged" and len(plan) == 80


def test_sampling_is_what_scipy_makes_of_the_rows() -> None:
    rng = np.random.default_rng(7)
    t = np.cumsum(rng.uniform(0.05, 0.3, 20))
    q, qd, qdd = rng.uniform(-1, 1, (3, 20, 3))
    names = ["a", "b", "c"]
    fine = np.linspace(t[0], t[-1], 1001)
    cubic = rd.Trajectory(names, t, q, qd)
    quintic = rd.Trajectory(names, t, q, qd, qdd=qdd)
    references = [CubicHermiteSpline(t, q, qd), BPoly.from_derivatives(t, np.stack([q, qd, qdd], axis=1))]
    for trajectory, reference in zip((cubic, quintic), references, strict=True):
        ours = trajectory.sample(fine)
        assert [part.shape for part in ours] == [(1001, 3)] * 4
        for k, part in enumerate(ours):
            expected = reference(fine, nu=k) if k else reference(fine)
            assert np.abs(part - expected).max() < 1e-11 * np.abs(expected).max(), k
        single = trajectory.sample(float(fine[333]))
        assert all(np.array_equal(a, b[333]) and a.shape == (3,) for a, b in zip(single, ours, strict=True))
        at_rows = trajectory.sample(t)
        assert np.array_equal(at_rows[0], q) and np.array_equal(at_rows[1], qd)
    assert np.array_equal(quintic.sample(t)[2], qdd)
    assert cubic.qdd is None and cubic.section is None
    for bad in (t[0] - 0.01, t[-1] + 0.01):
        with pytest.raises(rd.RedundancyError, match=r"t is .*, it must be in the trajectory, from"):
            cubic.sample(bad)
    with pytest.raises(rd.RedundancyError, match="array of strings"):
        cubic.sample(["0.1"])


def test_a_time_optimal_profile_keeps_its_jumps() -> None:
    """Bang-bang: with rows at the switches the cubic pieces are the profile, whose acceleration jumps."""
    t = np.array([0.0, 0.5, 1.0])
    move = rd.Trajectory(["a"], t, [[0.0], [0.25], [0.5]], [[0.0], [1.0], [0.0]])
    fine = np.linspace(0, 1, 101)
    _, _, qdd, qddd = move.sample(fine)
    assert np.abs(qdd[:50] - 2).max() < 1e-12 and np.abs(qdd[50:] + 2).max() < 1e-12
    assert np.abs(qddd).max() < 1e-11


def test_accelerations_and_sections_travel(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    q, qd, qdd = rng.uniform(-1, 1, (3, 4, 2))
    words = ["lead_in", "path", "path", "lead_out"]
    t = [0.0, 0.5, 1.0, 1.75]
    full = rd.Trajectory(["a", "b"], t, q, qd, qdd=qdd, section=words)
    assert full.section.tolist() == words and full.q[full.section == "path"].shape == (2, 2)
    full.to_csv(tmp_path / "t.csv")
    full.to_json(tmp_path / "t.json")
    full.to_npz(tmp_path / "t.npz")
    again = [
        rd.Trajectory.from_csv(tmp_path / "t.csv"),
        rd.Trajectory.from_json(tmp_path / "t.json"),
        rd.Trajectory.from_npz(tmp_path / "t.npz"),
        pickle.loads(pickle.dumps(full)),
    ]
    assert all(other == full for other in again)
    plain = rd.Trajectory(["a", "b"], t, q, qd)
    plain.to_npz(tmp_path / "p.npz")
    assert rd.Trajectory.from_npz(tmp_path / "p.npz") == plain != full
    with pytest.raises(
        rd.RedundancyError, match="unknown section 'middle', expected one of: lead_in, path, blend, lead_out"
    ):
        rd.Trajectory(["a", "b"], t, q, section=["middle"] * 4)
    with pytest.raises(rd.RedundancyError, match="section: expected 4 entries, got 3"):
        rd.Trajectory(["a", "b"], t, q, section=words[:3])
    with pytest.raises(rd.RedundancyError, match="qdd"):
        rd.Trajectory(["a", "b"], t, q, qdd=qdd[:, :1])


def test_poses() -> None:
    rng = np.random.default_rng(11)
    p, turn = rng.uniform(-1, 1, 3), Rotation.random(rng=rng)
    expected = np.eye(4)
    expected[:3, 3], expected[:3, :3] = p, turn.as_matrix()
    wxyz, rpy = turn.as_quat(scalar_first=True), turn.as_euler("xyz")
    for same in (
        rd.pose(p, wxyz),
        rd.pose(p, quaternion_wxyz=wxyz * 1.0009),
        rd.pose(p, rpy=rpy),
        rd.pose(p, matrix=turn),
        rd.pose(p, matrix=turn.as_matrix() * 1.0009),
    ):
        assert same.shape == (4, 4) and np.abs(same - expected).max() < 1e-15
    assert np.array_equal(rd.pose(p)[:3, :3], np.eye(3))
    many = rd.pose(rng.uniform(-1, 1, (5, 3)), wxyz)
    assert many.shape == (5, 4, 4) and np.abs(many[:, :3, :3] - turn.as_matrix()).max() < 1e-15
    turns = Rotation.random(5, rng=rng)
    assert np.abs(rd.pose(p, matrix=turns)[:, :3, :3] - turns.as_matrix()).max() < 1e-15
    # The same as a URDF makes of it.
    urdf = (
        '<robot name="r"><link name="a"/><link name="b"/><link name="c"/>'
        '<joint name="f" type="fixed"><parent link="a"/>'
        f'<child link="b"/><origin xyz="{p[0]} {p[1]} {p[2]}" rpy="{rpy[0]} {rpy[1]} {rpy[2]}"/></joint>'
        '<joint name="j" type="continuous"><parent link="b"/><child link="c"/></joint></robot>'
    )
    assert np.array_equal(rd.Chain.from_urdf_string(urdf).forward([0.0]), rd.pose(p, rpy=rpy))


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"rpy": [0, 0, 0], "matrix": np.eye(3)}, "give one of quaternion_wxyz, rpy and matrix"),
        (
            {"matrix": np.eye(3) * 1.002},
            "distance from the nearest rotation is 0.002.*, it must be at most 1e-3",
        ),
        ({"matrix": np.diag([1.0, 1.0, -1.0])}, "reflection .* determinant is -1, it must be 1"),
        ({"matrix": np.full((3, 3), np.nan)}, "matrix: entry 0 is NaN"),
        ({"quaternion_wxyz": [1, 0.1, 0, 0]}, "quaternion_wxyz: quaternion .* has norm 1.00"),
        ({"quaternion_wxyz": np.eye(3)}, r"quaternion_wxyz has shape \(3, 3\)"),
        ({"rpy": [0, np.inf, 0]}, "rpy: entry 1 is inf"),
        ({"matrix": [np.eye(3), 2 * np.eye(3)]}, "row 1: matrix is not a rigid transform"),
    ],
)
def test_poses_that_are_none(options, text: str) -> None:
    with pytest.raises(rd.RedundancyError, match=text):
        rd.pose((0.0, 0.0, 0.0), **options)
    with pytest.raises(rd.RedundancyError, match="position"):
        rd.pose((0.0, np.nan, 0.0))


def test_rotations_that_are_nearly_orthonormal() -> None:
    """Anywhere a pose is taken: the nearest rotation up to 1e-3, refused with the measured value beyond."""
    chain = rd.catalog.load("panda")
    good = chain.forward(np.full(7, 0.3))
    rng = np.random.default_rng(2)
    for size in (2e-6, 1e-4, 4e-4):
        off = good.copy()
        off[:3, :3] += size * rng.uniform(-1, 1, (3, 3))
        u, _, v = np.linalg.svd(off[:3, :3])
        nearest = off.copy()
        nearest[:3, :3] = u @ v
        assert np.abs(chain.with_tool(off).tool - nearest).max() < 1e-15
        assert np.abs(chain.with_base(off).base - nearest).max() < 1e-15
        assert np.abs(rd.Path([off, good], s=[0, 1]).poses[0] - nearest).max() < 1e-15
        two = np.stack([off, off])
        assert np.abs(rd.Path(two, s=[0, 1]).poses[1] - nearest).max() < 1e-15
        path = rd.paths.circle((0.4, 0, 0.5), 0.1, n=5, orientation=off[:3, :3])
        assert np.abs(path.poses[:, :3, :3] - nearest[:3, :3]).max() < 1e-15
        result = rd.IkSolver(chain).solve(off)
        assert result.status == "converged"
        assert np.abs(chain.forward(result.q) - nearest).max() < 2e-6
        assert np.abs(rd.quaternion.to_matrix(rd.quaternion.from_matrix(off[:3, :3])) - u @ v).max() < 1e-15
    off[:3, :3] = good[:3, :3] * 1.002
    for call in (chain.with_tool, rd.IkSolver(chain).solve, lambda p: rd.Path([p, p], s=[0, 1])):
        with pytest.raises(rd.RedundancyError, match=r"nearest rotation is 0\.00(2|19)"):
            call(off)
    # Scaled, mirrored, transposed, a bottom row that is none.
    with pytest.raises(rd.RedundancyError, match="transposed"):
        chain.with_tool(np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0.1, 0.2, 0.3, 1]]))


def test_quaternion_algebra() -> None:
    rng = np.random.default_rng(9)
    a, b = Rotation.random(200, rng=rng), Rotation.random(200, rng=rng)
    qa, qb = a.as_quat(scalar_first=True), b.as_quat(scalar_first=True)
    v = rng.uniform(-1, 1, (200, 3))
    quaternion = rd.quaternion

    def same(q: np.ndarray, r: Rotation) -> None:
        assert np.abs(np.abs(np.sum(q * r.as_quat(scalar_first=True), axis=-1)) - 1).max() < 1e-14

    same(quaternion.product(qa, qb), a * b)
    same(quaternion.product(qa[0], qb), a[0] * b)
    same(quaternion.product(qa, qb[0]), a * b[0])
    assert np.array_equal(quaternion.conjugate(qa), qa * [1, -1, -1, -1])
    assert np.abs(quaternion.rotate(qa, v) - a.apply(v)).max() < 1e-14
    assert np.abs(quaternion.rotate(qa[0], v) - a[0].apply(v)).max() < 1e-14
    assert np.abs(quaternion.rotate(qa, v[0]) - a.apply(v[0])).max() < 1e-14
    assert np.abs(quaternion.to_matrix(qa) - a.as_matrix()).max() < 1e-14
    same(quaternion.from_matrix(a.as_matrix()), a)
    same(quaternion.from_matrix(a), a)
    assert (quaternion.from_matrix(a)[:, 0] >= 0).all()
    axis, angle = quaternion.to_axis_angle(qa)
    assert np.abs(axis * angle[:, None] - a.as_rotvec()).max() < 1e-13
    assert np.abs(np.linalg.norm(axis, axis=1) - 1).max() < 1e-15
    same(quaternion.from_axis_angle(axis * 3.0, angle), a)
    same(quaternion.from_axis_angle([0, 0, 2], angle), Rotation.from_rotvec(angle[:, None] * [0, 0, 1]))
    # One for one; the ends of the angle.
    one, value = quaternion.to_axis_angle(quaternion.from_axis_angle([0, 0, -1], 1e-9))
    assert isinstance(value, float) and abs(value - 1e-9) < 1e-24 and np.array_equal(one, [0, 0, -1])
    axis, angle = quaternion.to_axis_angle([1, 0, 0, 0])
    assert (axis.tolist(), angle) == ([0, 0, 1], 0.0)
    axis, angle = quaternion.to_axis_angle([0, 0, 1, 0])
    assert (axis.tolist(), angle) == ([0, 1, 0], np.pi)
    assert quaternion.product(qa[0], qb[0]).shape == (4,) and quaternion.rotate(qa[0], v[0]).shape == (3,)
    assert quaternion.to_matrix(qa[0]).shape == (3, 3)
    for call, text in [
        (lambda: quaternion.product([1, 0.1, 0, 0], qb[0]), "a: quaternion .* has norm"),
        (lambda: quaternion.product(qa, qb[:3]), r"b \(rows\): expected 200 entries, got 3"),
        (lambda: quaternion.rotate(qa[0], [0, np.nan, 0]), "v: entry 1 is NaN"),
        (lambda: quaternion.from_axis_angle([0, 0, 0], 1.0), "axis has length 0"),
        (lambda: quaternion.from_matrix([np.eye(3), -np.eye(3)]), "row 1: matrix .* reflection"),
        (lambda: quaternion.conjugate([1, 0, 0]), r"q has shape \(3,\)"),
    ]:
        with pytest.raises(rd.RedundancyError, match=text):
            call()
