"""`redundancy analyse`: results, pictures, messages, exit status."""

import json
from pathlib import Path

import numpy as np
import pytest

import redundancy as rd
from redundancy import _commands, plot_optimum


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    status = _commands.run(["analyse", *(str(a) for a in arguments)])
    out, err = capsys.readouterr()
    assert "Traceback" not in out + err
    return status, out, err


def test_the_paper(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    status, out, err = run(capsys, "--robot", "planar3r", "--out", tmp_path / "a")
    assert (status, err) == (0, "")
    assert "completes" in out and "0.2127422082: algorithmic_singularity" in out
    names = {f.name for f in (tmp_path / "a").iterdir()}
    assert names == {
        "trajectory.csv",
        "trajectory.json",
        "summary.json",
        "loci.png",
        "paths.png",
        "values.png",
        "self_motion.png",
    }
    for name in names:
        if name.endswith(".png"):
            assert (tmp_path / "a" / name).read_bytes().startswith(b"\x89PNG")
    summary = json.loads((tmp_path / "a" / "summary.json").read_text())
    assert summary["completed"] is True
    assert len(summary["critical_points"]) == 12 and len(summary["algorithmic_singularities"]) == 10
    assert sorted(round(p["condition_A"], 2) for p in summary["critical_points"])[0] == -4860.58
    first = summary["starts"][0]
    assert first["completed"] and first["joint_gap_rad"] < 1e-10
    stops = [start["events"][-1]["kind"] for start in summary["starts"] if not start["completed"]]
    assert sorted(stops) == ["algorithmic_singularity"] * 6 + ["kinematic_singularity"] * 4
    trajectory = rd.Trajectory.from_csv(tmp_path / "a" / "trajectory.csv")
    assert len(trajectory) == 201


def test_an_arm_over_a_pose(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    angles = "20,40,0,-80,0,60,0"
    status, out, err = run(
        capsys,
        "--robot",
        "iiwa14",
        "--q",
        angles,
        "--criterion",
        "joint_range",
        "--out",
        tmp_path,
        "--no-plots",
    )
    assert (status, err) == (0, "")
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert {f.name for f in tmp_path.iterdir()} == {"summary.json"}
    assert len(summary["self_motion_curves"]) == 8 and summary["starts"] == []
    arm = rd.catalog.load("iiwa14")
    pose = arm.forward(np.radians([float(x) for x in angles.split(",")]))
    for point in summary["critical_points"]:
        np.testing.assert_allclose(arm.forward(point["q_rad"]), pose, atol=1e-12)
    assert "minimum" in out


def test_a_path_that_breaks(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    # A straight line from inside to the end of the reach: whatever is followed, the arm is stretched at the end.
    line = np.column_stack([np.linspace(6.0, 7.6, 30), np.zeros(30), np.zeros(30)])
    rd.Path(line).to_csv(tmp_path / "line.csv")
    status, _, err = run(
        capsys, "--robot", "planar3r", "--path", tmp_path / "line.csv", "--out", tmp_path / "a", "--no-plots"
    )
    assert status == 1 and "cannot be followed" in err
    summary = json.loads((tmp_path / "a" / "summary.json").read_text())
    assert summary["completed"] is False
    for start in summary["starts"]:
        assert start["events"][-1]["kind"] == "kinematic_singularity"
        assert start["events"][-1]["s"] == pytest.approx(1.5, abs=1e-8)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--robot", "r2d2"], "unknown robot"),
        (["--robot", "pa10"], "--path"),
        (["--robot", "pa10", "--q", "1,2"], "7 angles"),
        (["--robot", "pa10", "--q", "1,2,3,4,5,6,nan"], "7 angles"),
        (["--robot", "planar3r", "--criterion", "beauty"], "joint_range"),
        (["--robot", "planar3r", "--task", "pos"], "position"),
        (["--robot", "planar3r", "--task", "planar_pose", "--q", "1,2,3"], "no spare freedom"),
    ],
)
def test_bad_input(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, arguments: list[str], message: str
) -> None:
    status, _, err = run(capsys, *arguments, "--out", tmp_path / "a")
    assert status == 2 and message in err
    assert not (tmp_path / "a").exists()


def test_figures_show_what_they_are_given() -> None:
    arm = rd.catalog.load("iiwa14")
    h = rd.JointRange(arm)
    pose = arm.forward([0.3, 0.7, -0.4, -1.4, 0.2, 0.9, 0.5])
    curves = rd.self_motion_curves(arm, pose, step=0.05)
    points = rd.constrained_optima(arm, pose, h)
    figure = plot_optimum.self_motion_values(h, curves, points)
    assert len(figure.axes) == 8
    marks = [line for axes in figure.axes for line in axes.lines if line.get_marker() not in {"", "None"}]
    assert len(marks) == len(points)


def test_values_along_a_path_end_at_the_event() -> None:
    arm = rd.catalog.load("planar3r")
    h = rd.Manipulability(arm, task="planar")
    circle = rd.paths.circle((3.5, 0, 0), 1.5, start=np.pi, n=101)
    circle = circle.with_times(circle.s / circle.length)
    ranked = rd.rank_starts(arm, circle, h, task="planar")
    ends = []
    for start in ranked:
        t, value, condition = plot_optimum.along_path(arm, h, "planar", start.trajectory)
        assert len(t) == len(value) == len(condition) and (np.diff(t) > 0).all()
        ends.append((round(t[-1], 7), abs(condition[-1]) < 1e-3, value[-1] < 1e-5))
    expected = [(1.0, False, False)] * 2 + [(0.3454479, True, False)] * 2 + [(0.2156288, True, True)] * 2
    assert ends == expected + [(0.2127422, True, False)] * 4 + [(0.1061478, True, True)] * 2
    quarter = plot_optimum.along_path(arm, h, "planar", ranked[0].trajectory)
    assert abs(quarter[1][25] - 188.283) < 1e-3 and abs(quarter[2][25] + 15354.8) < 0.1
    figure = plot_optimum.values_along_path(ranked, chain=arm, criterion=h)
    above, below = figure.axes
    assert below.get_ylabel() == "A"
    longest = [line.get_xdata()[-1] for line in above.lines if len(line.get_xdata()) > 1]
    assert sorted({round(float(x), 6) for x in longest}) == [0.106148, 0.212742, 0.215629, 0.345448, 1.0]
