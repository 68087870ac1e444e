"""`Path` and `paths`: the Python contract."""

import pickle
from pathlib import Path as File

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import RigidTransform, Rotation

import redundancy as rd

GOLDEN = File(__file__).resolve().parents[1] / "golden"


def poses(n: int) -> np.ndarray:
    s = np.linspace(0, 2, n)
    result = np.tile(np.eye(4), (n, 1, 1))
    result[:, :3, 3] = np.column_stack([np.sin(s), np.cos(2 * s), 0.3 * s])
    result[:, :3, :3] = Rotation.from_rotvec(np.column_stack([s, np.sin(s), 0.2 * s**2])).as_matrix()
    return result


def test_samples_come_back():
    given_poses, t = poses(20), np.arange(20.0)
    path = rd.Path(given_poses, t=t)
    assert len(path) == 20 and path.has_orientation
    np.testing.assert_array_equal(path.poses, given_poses)
    np.testing.assert_array_equal(path.positions, given_poses[:, :3, 3])
    np.testing.assert_array_equal(path.t, t)
    steps = np.linalg.norm(np.diff(path.positions, axis=0), axis=1)
    np.testing.assert_allclose(path.s, np.concatenate([[0], np.cumsum(steps)]), rtol=1e-14)
    assert path.length == path.s[-1]


def test_positions_make_a_path_without_orientation():
    path = rd.Path(np.random.default_rng(0).normal(size=(5, 3)))
    assert not path.has_orientation and path.t is None
    np.testing.assert_array_equal(path.poses[:, :3, :3], np.tile(np.eye(3), (5, 1, 1)))


def test_positions_follow_scipys_not_a_knot_spline():
    rng = np.random.default_rng(1)
    for n in (2, 3, 4, 5, 50):
        points = rng.normal(size=(n, 3))
        s = np.cumsum(rng.uniform(0.1, 2, n))
        path = rd.Path(points, s=s)
        at = np.linspace(s[0], s[-1], 400)
        spline = CubicSpline(s, points)
        first, second = path.derivatives(at)
        np.testing.assert_allclose(path.pose(at)[:, :3, 3], spline(at), atol=1e-12 * n)
        np.testing.assert_allclose(first[:, :3], spline(at, 1), atol=1e-11 * n)
        np.testing.assert_allclose(second[:, :3], spline(at, 2), atol=1e-10 * n)


def test_single_and_batch_agree():
    path = rd.Path(poses(20))
    at = np.linspace(0, path.length, 7)
    np.testing.assert_array_equal(path.pose(at)[3], path.pose(at[3]))
    assert path.pose(at[3]).shape == (4, 4)
    assert path.derivatives(at[3])[1].shape == (6,)
    np.testing.assert_array_equal(path.derivatives(at)[0][3], path.derivatives(at[3])[0])


class Homogeneous:
    """As pinocchio.SE3."""

    def __init__(self, matrix):
        self.homogeneous = matrix


def test_se3_like_objects():
    given_poses = poses(6)
    expected = rd.Path(given_poses).poses
    np.testing.assert_array_equal(rd.Path([Homogeneous(m) for m in given_poses]).poses, expected)
    np.testing.assert_array_equal(rd.Path(list(given_poses)).poses, expected)
    np.testing.assert_allclose(rd.Path(RigidTransform.from_matrix(given_poses)).poses, expected, atol=1e-15)


@pytest.mark.parametrize(
    "letter, x, spacing, corner", [("a", 0.35, 0.2, 0.16752193), ("b", 0.44, 0.21, 0.17912615734826384)]
)
def test_raster_is_the_reference(letter, x, spacing, corner):
    reference = np.loadtxt(GOLDEN / f"spray_ref_{letter}_path.csv", delimiter=",", skiprows=1)
    path = rd.paths.raster((x, -0.25, -0.3), 0.5, spacing, 3, corner=corner)
    np.testing.assert_allclose(path.s, reference[:, 0], atol=0.5001e-9)
    # The reference was read off a polyline in the turns (tests/golden/PROVENANCE.md).
    np.testing.assert_allclose(path.positions, reference[:, 1:], atol=1e-7)
    read = rd.Path.from_csv(GOLDEN / f"spray_ref_{letter}_path.csv")
    np.testing.assert_array_equal(read.positions, reference[:, 1:])


def test_circle_and_raster_keep_the_analytic_curve():
    circle = rd.paths.circle((0.4, 0, 0.5), 0.1, n=5)
    at = np.linspace(0, circle.length, 101)
    radius = np.linalg.norm(circle.pose(at)[:, :3, 3] - [0.4, 0, 0.5], axis=1)
    np.testing.assert_allclose(radius, 0.1, atol=1e-15)
    assert len(rd.paths.circle((0, 0, 0), 1)) == 1000
    np.testing.assert_allclose(circle.positions[0], [0.5, 0, 0.5], atol=1e-15)
    sharp = rd.paths.raster((0, 0, 0), 0.4, 0.1, 2, step=0.03)
    assert sharp.length == pytest.approx(0.9, abs=1e-14)
    np.testing.assert_allclose(sharp.pose(0.45)[:3, 3], [0.05, 0.4, 0], atol=1e-15)


def test_orientations():
    flip = np.diag([-1.0, 1.0, -1.0])
    pose = np.eye(4)
    pose[:3, :3] = flip
    path = rd.paths.circle((0.4, 0, 0.5), 0.1, n=50)
    rule_calls = []

    def rule(positions):
        rule_calls.append(positions.shape)
        return Rotation.from_rotvec(positions).as_matrix()

    for orientation in (flip, pose, np.tile(flip, (50, 1, 1)), Homogeneous(pose), Rotation.from_matrix(flip)):
        turned = path.with_orientation(orientation)
        assert turned.has_orientation
        np.testing.assert_allclose(turned.poses[:, :3, :3], np.tile(flip, (50, 1, 1)), atol=1e-15)
    np.testing.assert_allclose(turned.derivatives(0.2)[0][3:], 0, atol=1e-14)
    ruled = rd.paths.circle((0.4, 0, 0.5), 0.1, n=50, orientation=rule)
    assert rule_calls == [(50, 3)]
    np.testing.assert_allclose(ruled.poses[:, :3, :3], rule(ruled.positions), atol=1e-15)
    with pytest.raises(rd.RedundancyError, match=r"expected 50 entries, got 3"):
        path.with_orientation(np.tile(flip, (3, 1, 1)))
    with pytest.raises(rd.RedundancyError, match="orthonormal"):
        path.with_orientation(2 * flip)
    with pytest.raises(rd.RedundancyError, match="orientation"):
        path.with_orientation([1.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    "path",
    [
        rd.Path(poses(9), t=np.arange(9.0)),
        rd.Path(np.arange(12.0).reshape(4, 3) ** 2),
        rd.paths.circle((0, 0, 1), 0.2, 0.1, -1.5, (1, 2, 3), n=7),
        rd.paths.raster((0, 0, 0), 0.4, 0.1, 3, corner=0.05, orientation=np.eye(3), step=0.02),
        rd.paths.raster((0, 0, 0), 0.4, 0.1, 2, step=0.02),
    ],
    ids=repr,
)
def test_pickle_keeps_the_curve(path):
    copy = pickle.loads(pickle.dumps(path))
    assert repr(copy) == repr(path)
    at = np.linspace(0, path.length, 50)
    np.testing.assert_allclose(copy.pose(at), path.pose(at), atol=1e-15)
    np.testing.assert_allclose(copy.derivatives(at), path.derivatives(at), atol=1e-12)
    np.testing.assert_array_equal(copy.s, path.s)


def test_csv_round_trip(tmp_path):
    path = rd.Path(poses(20), t=np.linspace(0, 1, 20))
    path.to_csv(tmp_path / "path.csv")
    read = rd.Path.from_csv(str(tmp_path / "path.csv"))
    np.testing.assert_allclose(read.poses, path.poses, atol=1e-15)
    np.testing.assert_array_equal(read.t, path.t)


def test_broken_csv_is_a_file_error_with_its_line(tmp_path):
    file = tmp_path / "broken.csv"
    file.write_text("x,y,z\n0,0,0\n0,oops,0\n")
    with pytest.raises(rd.FileFormatError, match=r"broken\.csv:3: column 'y': 'oops' is not a number"):
        rd.Path.from_csv(file)
    with pytest.raises(rd.FileFormatError, match=r"missing\.csv: cannot be read"):
        rd.Path.from_csv(tmp_path / "missing.csv")


@pytest.mark.parametrize(
    "arguments, message",
    [
        ((np.eye(4),), "at least two samples"),
        ((np.zeros((3, 4)),), r"expected \(N, 4, 4\) or positions \(N, 3\)"),
        ((np.zeros((3, 4, 4)),), r"poses\[0\]"),
        ((np.full((3, 3), np.nan),), "must be finite"),
        (("text",), "poses"),
        (([],), "expected"),
        ((np.zeros((1, 3)),), "at least two samples"),
        ((poses(3), [0.0, 1.0]), "expected 3 entries, got 2"),
        ((poses(3), None, [0.0, 2.0, 1.0]), r"t\[2\] is 1 after 2"),
    ],
)
def test_bad_input(arguments, message):
    with pytest.raises(rd.RedundancyError, match=message):
        rd.Path(*arguments)


def test_off_the_path():
    path = rd.Path(poses(5))
    with pytest.raises(rd.RedundancyError, match="must be on the path"):
        path.pose(path.length + 1)
    with pytest.raises(rd.RedundancyError, match="must be on the path"):
        path.derivatives([0.0, np.nan])


@given(st.lists(st.tuples(*[st.floats(-10, 10)] * 3), min_size=2, max_size=20))
def test_any_positions_give_finite_curves(points):
    path = rd.Path(points)
    at = np.linspace(0, path.length, 30)
    assert np.isfinite(path.pose(at)).all()
