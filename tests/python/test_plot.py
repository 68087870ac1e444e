"""Figures: what is drawn is what the data say."""

import numpy as np
import pytest

import redundancy as rd

matplotlib = pytest.importorskip("matplotlib")
from matplotlib.colors import to_hex  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402

from redundancy import plot  # noqa: E402

Q = np.array([0.3, 0.5, -0.2, 1.1, 0.4, 0.7, -0.9])
DOWN = np.diag([1.0, -1.0, -1.0])


@pytest.fixture(scope="module")
def arm() -> rd.SrsArm:
    return rd.SrsArm(rd.catalog.load("pa10"))


def spans(axis, colour: str) -> list[tuple[float, float, float, float]]:
    """Rectangles of a colour as (x0, x1, y0, y1)."""
    return [
        (p.get_x(), p.get_x() + p.get_width(), p.get_y(), p.get_y() + p.get_height())
        for p in axis.patches
        if to_hex(p.get_facecolor()) == colour
    ]


def test_self_motion_draws_each_joint_of_the_branch(arm: rd.SrsArm) -> None:
    chain, motion = arm.chain, arm.self_motion(arm.chain.forward(Q))
    figure = plot.self_motion(motion, chain, branch=(1, -1, 1), samples=181)
    assert isinstance(figure, Figure)
    branch = next(b for b in motion.branches if b.signs == (1, -1, 1))
    assert [a.get_title(loc="left") for a in figure.axes[:7]] == [f"{n} (deg)" for n in chain.joint_names]
    for j, axis in enumerate(figure.axes[:7]):
        *edges, line = axis.get_lines()
        s, q = line.get_xdata(), line.get_ydata()
        drawn = np.isfinite(q)
        assert drawn.sum() == 181 and axis.get_xlim() == (-180, 180)
        np.testing.assert_allclose(q[drawn], np.rad2deg(branch.q(np.deg2rad(s[drawn]))[:, j]), atol=1e-9)
        # A break wherever the winding changes, and no step of half a turn between drawn neighbours.
        assert not (np.abs(np.diff(q)) > 180).any()
        low, high = np.rad2deg(chain.lower[j]), np.rad2deg(chain.upper[j])
        # The range follows the data; a limit that is in view is drawn, with what is beyond it shaded to the edge.
        bottom, top = axis.get_ylim()
        assert bottom < np.nanmin(q) and top > np.nanmax(q)
        assert top - bottom < 2.0 * max(np.nanmax(q) - np.nanmin(q), plot._LEAST_RANGE)
        seen = [edge for edge in (low, high) if bottom <= edge <= top]
        assert sorted(edge.get_ydata()[0] for edge in edges) == pytest.approx(seen)
        shaded = [(a, b) for _, _, a, b in spans(axis, plot._OUTSIDE)]
        beyond = [(bottom, low)] * (low in seen) + [(high, top)] * (high in seen)
        assert len(shaded) == len(beyond)
        for got, expected in zip(sorted(shaded), beyond, strict=True):
            assert got == pytest.approx(expected)


def test_self_motion_marks_the_feasible_swivels(arm: rd.SrsArm) -> None:
    motion = arm.self_motion(arm.chain.forward(Q))
    for branch in motion.branches:
        figure = plot.self_motion(motion, arm.chain, branch.signs)
        marked = [(np.deg2rad(a), np.deg2rad(b)) for a, b, *_ in spans(figure.axes[0], plot._INSIDE)]
        for s in np.linspace(-np.pi, np.pi, 400, endpoint=False):
            feasible = any((s - lo) % (2 * np.pi) <= hi - lo for lo, hi in branch.intervals())
            assert any(a <= s <= b for a, b in marked) == feasible
        assert all(-180.001 <= a <= b <= 180.001 for a, b, *_ in spans(figure.axes[0], plot._INSIDE))
    # Left out, it is the branch with the most freedom.
    free = max(motion.branches, key=lambda b: np.diff(b.intervals()).sum())
    text = plot.self_motion(motion, arm.chain).axes[7].texts[0].get_text()
    assert text.startswith("branch " + "".join("+" if sign > 0 else "-" for sign in free.signs))


def test_self_motion_says_why_there_is_nothing_to_draw(arm: rd.SrsArm) -> None:
    far = np.eye(4)
    far[0, 3] = 5.0
    with pytest.raises(ValueError, match="too far from the shoulder"):
        plot.self_motion(arm.self_motion(far), arm.chain)
    stretched = arm.self_motion(arm.chain.forward([0.2, 0.4, 0, 0, 0, 0.5, 0]))
    with pytest.raises(ValueError, match=r"branch is \(1, -1, 1\), expected one of"):
        plot.self_motion(stretched, arm.chain, (1, -1, 1))


def test_swivel_band_agrees_with_the_intervals(arm: rd.SrsArm) -> None:
    poses = arm.chain.forward(np.array([Q, Q + 0.1, Q - 0.2]))
    band = plot.swivel_band(arm, poses, (1, 1, -1), resolution=90)
    assert band.shape == (3, 90)
    grid = np.linspace(-np.pi, np.pi, 90, endpoint=False)
    for pose, row in zip(poses, band, strict=True):
        branch = arm.self_motion(pose).branches[1]
        inside = [any((s - lo) % (2 * np.pi) <= hi - lo for lo, hi in branch.intervals()) for s in grid]
        np.testing.assert_array_equal(row, inside)


def test_swivel_map_shows_the_band_of_each_branch_and_the_plan(arm: rd.SrsArm) -> None:
    path = rd.paths.circle([0.45, 0, 0.5], 0.12, orientation=DOWN, n=50)
    plan = rd.plan_swivel(arm, path)
    figure = plot.swivel_map(arm, path, plan, resolution=90)
    assert [a.get_title(loc="left") for a in figure.axes] == [
        f"branch {a}{b}{c}" for a in "+-" for b in "+-" for c in "+-"
    ]
    chosen = next(
        k for k, b in enumerate(arm.self_motion(path.poses[0]).branches) if b.signs == tuple(plan.branch[0])
    )
    for index, axis in enumerate(figure.axes):
        # The band is repeated every turn, so that the line need not be cut.
        images = axis.get_images()
        extents = np.array([one.get_extent() for one in images])
        np.testing.assert_allclose(extents[:, :2], [[0, path.length]] * len(images))
        np.testing.assert_allclose((extents[:, 2:] + 180) % 360, 0, atol=1e-9)
        assert extents[:, 2].min() <= axis.get_ylim()[0] and axis.get_ylim()[1] <= extents[:, 3].max()
        image = images[0]
        signs = tuple(-1 if index & bit else 1 for bit in (4, 2, 1))
        inside = np.all(np.isclose(image.get_array(), plot._colour(plot._INSIDE)), axis=2)
        band = plot.swivel_band(arm, path.poses, signs, resolution=90)
        np.testing.assert_array_equal(inside[:, 0], band[0])
        np.testing.assert_array_equal(inside[:, -1], band[-1])
        assert len(axis.get_lines()) == (index == chosen)
    (line,) = figure.axes[chosen].get_lines()
    drawn = np.isfinite(line.get_ydata())
    np.testing.assert_allclose(line.get_xdata()[drawn], path.s)
    assert np.abs(np.diff(line.get_ydata()[drawn])).max() < 180
    off = line.get_ydata()[drawn] - np.rad2deg(plan.swivel)
    np.testing.assert_allclose((off + 180) % 360 - 180, 0, atol=1e-9)
    # Every point of the line is on the band.
    cells = np.floor((np.deg2rad(line.get_ydata()[drawn]) + np.pi) / (2 * np.pi) * 90).astype(int)
    band = plot.swivel_band(arm, path.poses, plan.branch[0], resolution=90)
    assert band[np.arange(50), cells % 90].mean() > 0.95


def test_swivel_map_without_a_plan_and_of_a_long_path(arm: rd.SrsArm) -> None:
    path = rd.paths.circle([0.45, 0, 0.5], 0.12, orientation=DOWN, n=1_500)
    figure = plot.swivel_map(arm, path, resolution=36)
    assert all(len(axis.get_lines()) == 0 for axis in figure.axes)
    assert figure.axes[0].get_images()[0].get_extent()[1] == pytest.approx(path.length)
