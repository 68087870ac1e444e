"""The command line: results, messages, exit status."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import redundancy as rd
from redundancy import _commands, plot

URDF = Path(rd.__file__).parent / "data" / "kuka_iiwa.urdf"


def run(capsys, *arguments):
    status = _commands.run([str(a) for a in arguments])
    out, err = capsys.readouterr()
    assert "Traceback" not in out + err
    return status, out, err


@pytest.fixture
def raster(tmp_path):
    path = _commands.demo_raster().resampled(0.03)
    path.to_csv(tmp_path / "path.csv")
    return tmp_path / "path.csv", path


def test_robots_lists_the_catalogue(capsys):
    status, out, _ = run(capsys, "robots")
    assert status == 0
    lines = out.splitlines()
    assert [line.split()[0] for line in lines[1:]] == rd.catalog.names()
    assert set(_commands.SOURCES) == set(rd.catalog.names())
    assert " srs " in next(line for line in lines if line.startswith("pa10"))
    assert " panda_class " in next(line for line in lines if line.startswith("panda "))


def test_track_writes_what_it_promises(capsys, raster, tmp_path):
    file, path = raster
    out = tmp_path / "deep" / "run"
    status, text, err = run(capsys, "track", "--robot", "pa10", "--path", file, "--out", out)
    assert (status, err) == (0, "")
    assert "pa10 follows" in text
    assert {f.name for f in out.iterdir()} == {
        "trajectory.csv",
        "trajectory.json",
        "summary.json",
        "track.png",
    }
    assert (out / "track.png").read_bytes().startswith(b"\x89PNG")
    chain = rd.catalog.load("pa10")
    trajectory = rd.Trajectory.from_csv(out / "trajectory.csv")
    assert len(trajectory) == len(path)
    np.testing.assert_allclose(chain.forward(trajectory.q), path.poses, atol=1e-12)
    assert (trajectory.q >= chain.lower).all() and (trajectory.q <= chain.upper).all()
    assert (np.abs(trajectory.qd) <= chain.velocity_limit).all()
    with (out / "trajectory.csv").open() as table:
        header = next(csv.reader(table))
    names = [f"{name}{kind}" for kind in ("", "_velocity", "_acceleration") for name in chain.joint_names]
    assert header == ["t", *names]
    assert rd.Trajectory.from_json(out / "trajectory.json").joint_names == chain.joint_names
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] == "converged" and summary["points"] == len(path)
    assert summary["position_error_m"] < 1e-12


def test_track_with_a_urdf_a_swivel_and_a_branch(capsys, tmp_path):
    _commands.demo_circle().resampled(0.02).to_csv(tmp_path / "path.csv")
    arguments = ["track", "--robot", URDF, "--base", "lbr_iiwa_link_0", "--tip", "lbr_iiwa_link_7"]
    arguments += ["--path", tmp_path / "path.csv", "--out", tmp_path / "run", "--no-plots"]
    status, _, err = run(capsys, *arguments, "--swivel", "145", "--branch", "+++")
    assert (status, err) == (0, "")
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["branch"] == "+++"
    assert summary["swivel_held_rad"] == pytest.approx(np.deg2rad(145))
    np.testing.assert_allclose(summary["swivel_range_rad"], np.deg2rad(145))
    trajectory = rd.Trajectory.from_csv(tmp_path / "run" / "trajectory.csv")
    times = rd.Path.from_csv(tmp_path / "path.csv").t
    np.testing.assert_allclose(trajectory.t, times, atol=1e-12)


def test_demo_follows_paths_of_1000_points(capsys, tmp_path):
    status, out, err = run(capsys, "demo", "--out", tmp_path, "--no-plots")
    assert (status, err) == (0, "")
    for name in ("pa10", "iiwa", "panda", "ur", "rail"):
        assert len(rd.Trajectory.from_csv(tmp_path / name / "trajectory.csv")) == 1000
    for name in ("panda", "ur", "rail"):
        plan = rd.Plan.from_npz(tmp_path / name / "plan.npz")
        assert (plan.status, plan.legal) == ("converged", True)
        summary = json.loads((tmp_path / name / "summary.json").read_text())
        # Metres of the rail are not counted as radians.
        assert ("joint_travel_m" in summary, "least_margin_m" in summary) == (name == "rail", name == "rail")
        slides = 1 if name == "rail" else 0
        travel = np.linalg.norm(np.diff(plan.q[:, slides:], axis=0), axis=1).sum()
        assert summary["joint_travel_rad"] == pytest.approx(travel)
    assert "travel of sliding joints" in out
    assert out.count("$ redundancy plan") == 3
    # Two rasters, and an elbow that goes round a ball.
    assert out.count("$ redundancy track") == 3
    assert out.count("$ redundancy paint") == 1


def test_points_out_of_reach(capsys, raster, tmp_path):
    file, path = raster
    poses = path.poses
    poses[40:45, 0, 3] += 1.5
    rd.Path(poses).to_csv(file)
    status, _, err = run(capsys, "track", "--robot", "pa10", "--path", file, "--out", tmp_path / "run")
    assert status == 1
    assert f"5 of {len(path)} points are out of reach, the first is point 40" in err
    assert "mm too far from the shoulder" in err
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert (summary["status"], summary["first_point"], summary["unreachable_points"]) == (
        "unreachable",
        40,
        5,
    )
    assert (tmp_path / "run" / "swivel.png").exists()
    assert not (tmp_path / "run" / "trajectory.csv").exists()


def test_a_swivel_that_cannot_be_held(capsys, tmp_path):
    _commands.demo_circle().resampled(0.02).to_csv(tmp_path / "path.csv")
    arguments = (
        "--robot",
        URDF,
        "--path",
        tmp_path / "path.csv",
        "--out",
        tmp_path / "run",
        "--swivel",
        "-100",
    )
    status, _, err = run(capsys, "track", *arguments)
    assert status == 1
    assert "point" in err and "joint 'lbr_iiwa_joint_" in err
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["status"] == "limits" and summary["reason"] in err.replace("\n", "")
    assert not (tmp_path / "run" / "trajectory.csv").exists()


def test_points_outside_the_limits(capsys, tmp_path):
    circle = rd.paths.circle((0.5, 0, 0.45), 0.2, n=100, orientation=np.diag([-1.0, 1.0, -1.0]))
    circle.to_csv(tmp_path / "path.csv")
    arguments = (
        "--robot",
        "iiwa14",
        "--path",
        tmp_path / "path.csv",
        "--out",
        tmp_path / "run",
        "--no-plots",
    )
    status, _, err = run(capsys, "track", *arguments)
    assert status == 1
    assert "outside the joint limits, the first is point" in err and "joint 'A4'" in err


def test_a_desired_swivel_beside_an_obstacle(capsys, tmp_path):
    tool = np.diag([-1.0, 1.0, -1.0])
    circle = rd.paths.circle((0.45, 0.0, 0.5), 0.12, orientation=tool, n=301)
    circle.with_times(np.linspace(0.0, 6.0, 301)).to_csv(tmp_path / "path.csv")
    ball = rd.Scene([rd.Sphere((0.2842, -0.3539, 0.4817), 0.06)])
    (tmp_path / "scene.json").write_text(ball.to_json())
    arm = rd.SrsArm(rd.catalog.load("pa10"))

    def way(plan, *wish):
        out = tmp_path / "-".join(["out", plan, *(str(x) for x in wish)])
        files = ("--path", tmp_path / "path.csv", "--obstacles", tmp_path / "scene.json", "--out", out)
        status, _, err = run(capsys, "track", "--robot", "pa10", *files, "--plan", plan, "--no-plots", *wish)
        assert status == 0, err
        trajectory = rd.Trajectory.from_csv(out / "trajectory.csv")
        assert min(ball.clearance(arm.chain, q, link_radius=0.05).distance for q in trajectory.q[::10]) > 0.0
        wanted = json.loads((out / "summary.json").read_text())["swivel_desired_rad"]
        return np.rad2deg(arm.swivel(trajectory.q)), wanted

    def away(swivels, degrees):
        return np.abs((swivels - degrees + 180.0) % 360.0 - 180.0).mean()

    assert way("whole")[1] is None
    up, wanted = way("whole", "--desired-swivel", -60)
    down, _ = way("whole", "--desired-swivel", -120)
    assert abs(wanted + np.pi / 3) < 1e-12
    # Each wish is followed where the ball allows it: nearer to its own than the other plan is.
    assert away(up, -60.0) < away(down, -60.0) - 10.0
    assert away(down, -120.0) < away(up, -120.0) - 10.0
    # Step by step, from the start of such a plan.
    assert away(way("flow", "--desired-swivel", -120)[0], -120.0) < 20.0


def test_a_flow_that_cannot_keep_up_names_the_row(capsys, tmp_path):
    # 0.02 rad/s up to point 150, then 25 rad/s.
    angle = np.r_[0.0, np.cumsum(np.where(np.arange(200) < 150, 2e-4, 0.25))]
    poses = np.repeat(np.eye(4)[None], 201, 0)
    poses[:, :3, :3] = np.diag([-1.0, 1.0, -1.0])
    poses[:, :3, 3] = np.c_[0.5 + 0.1 * np.cos(angle), 0.1 * np.sin(angle), np.full(201, 0.4)]
    rd.Path(poses, t=0.01 * np.arange(201)).to_csv(tmp_path / "path.csv")
    out = tmp_path / "out"
    arguments = (
        "--robot",
        "iiwa14",
        "--path",
        tmp_path / "path.csv",
        "--out",
        out,
        "--plan",
        "flow",
        "--no-plots",
    )
    status, _, err = run(capsys, "track", *arguments)
    summary = json.loads((out / "summary.json").read_text())
    assert status == 1 and summary["status"] == "infeasible", err
    assert 149 <= summary["first_point"] <= 152 and "speed limit at t = " in summary["reason"], summary


def test_one_limit_for_all_joints(capsys, tmp_path):
    arm = rd.catalog.load("panda")
    rest = np.array([0.0, 0.3, 0.0, -1.0, 0.2, 1.0, 0.0])
    move = rd.joint_move(arm, rest, rest + 0.3, jerk_limits=500.0)
    move.to_json(tmp_path / "move.json")
    words = ("check", tmp_path / "move.json", "--robot", "panda", "--jerk-limits")
    degrees = np.rad2deg(510.0)
    one, each = run(capsys, *words, f"{degrees}"), run(capsys, *words, ",".join([f"{degrees}"] * 7))
    assert one == each and one[0] == 0, one
    assert run(capsys, *words, "10")[0] == 1
    for text in ("many", "nan"):
        status, _, err = run(capsys, *words, text)
        assert status == 2 and f"--jerk-limits is '{text}', it must be one number for all joints or 7" in err
    assert run(capsys, *words, "1,2")[0] == 2


@pytest.mark.parametrize(
    "options, message",
    [
        ({"--robot": "pa11"}, "unknown robot 'pa11', expected one of: dexter, fr3, gen3"),
        ({"--robot": "no/arm.urdf"}, "robot file 'no/arm.urdf' does not exist"),
        ({"--robot": "panda"}, "not a spherical-revolute-spherical arm: axes 6 and 7 miss each other by 88"),
        ({"--robot": "pa10", "--base": "link1"}, "--base and --tip belong to URDF files"),
        ({"--robot": URDF, "--base": "world"}, "world"),
        ({"--path": "missing.csv"}, "missing.csv: cannot be read"),
        ({"--swivel": "ten"}, "--swivel is 'ten', it must be auto or an angle in degrees"),
        ({"--swivel": "inf"}, "--swivel is 'inf'"),
        ({"--desired-swivel": "inf"}, "--desired-swivel is inf"),
        ({"--desired-swivel": "10", "--swivel": "20"}, "give one of them"),
        ({"--branch": "++"}, "--branch is '++'"),
        ({"--branch": "++0"}, "--branch is '++0'"),
    ],
)
def test_bad_options(capsys, raster, tmp_path, options, message):
    given = {"--robot": "pa10", "--path": raster[0], "--out": tmp_path / "run"} | options
    status, out, err = run(capsys, "track", *(word for pair in given.items() for word in pair))
    assert (status, out) == (2, "")
    assert message in err and len(err.splitlines()) == 1


@pytest.mark.parametrize(
    "text, message",
    [
        ("x,y,z\n0.4,0,0.5\n0.5,0,0.5\n", "positions only"),
        ("x,y,z,qw,qx,qy,qz\n0.4,0,0.5,1,0,0,0\n0.5,0,0.5,1,1,0,0\n", "path.csv:3: quaternion"),
        ("x,y,z,qw,qx,qy,qz\n0.4,0,0.5,1,0,0,0\n0.5,0,half,1,0,0,0\n", "path.csv:3: column 'z'"),
        ("", "is empty"),
    ],
)
def test_bad_paths(capsys, tmp_path, text, message):
    (tmp_path / "path.csv").write_text(text)
    arguments = ("--robot", "pa10", "--path", tmp_path / "path.csv", "--out", tmp_path / "run")
    status, _, err = run(capsys, "track", *arguments)
    assert status == 2
    assert message in err and len(err.splitlines()) == 1


def test_folder_that_cannot_be_made(capsys, raster, tmp_path):
    (tmp_path / "file").write_text("")
    out = tmp_path / "file" / "run"
    status, _, err = run(capsys, "track", "--robot", "pa10", "--path", raster[0], "--out", out)
    assert status == 2 and "file" in err


def test_version(capsys):
    assert run(capsys, "--version")[:2] == (0, f"redundancy {rd.__version__}\n")


def test_usage_errors_and_help(capsys):
    assert run(capsys, "track", "--robot", "pa10")[0] == 2
    assert run(capsys, "no-such-command")[0] == 2
    for command in ("robots", "track", "demo"):
        status, out, _ = run(capsys, command, "--help")
        assert status == 0 and "Example:" in out


def test_without_the_extra(tmp_path):
    # A module of the same name that cannot be imported stands for one that is not installed.
    script = "import sys; sys.modules['typer'] = None\nfrom redundancy.cli import main; main()"
    command = [sys.executable, "-c", script]
    result = subprocess.run(command, check=False, capture_output=True, text=True, cwd=tmp_path)
    assert result.returncode == 2
    assert result.stderr == "redundancy: the command line needs 'typer': pip install 'redundancy[cli]'\n"


def test_plots_return_figures_and_leave_pyplot_alone():
    chain = rd.catalog.load("pa10")
    arm = rd.SrsArm(chain)
    q = np.linspace([0.1, 0.5, 0.2, 1.2, 0.3, 0.8, 0.0], [0.3, 0.7, 0.4, 1.0, 0.1, 0.9, 0.2], 20)
    trajectory = rd.Trajectory(chain.joint_names, np.arange(20.0), q)
    band = plot.swivel_band(arm, chain.forward(q), arm.branch(q[0]), resolution=90)
    assert band.shape == (20, 90)
    # The configuration's own swivel lies in the band.
    swivels = arm.swivel(q)
    columns = ((swivels + np.pi) / (2 * np.pi) * 90).round().astype(int) % 90
    assert band[np.arange(20), columns].all()
    figure = plot.track(trajectory, chain, np.arange(20.0), swivels, band, "title")
    assert len(figure.axes[0].lines) == 1
    assert len(plot.joints(trajectory, chain).axes) == 8
    plot.swivel(np.arange(20.0), None, band, [(3.0, "here")])
    assert "matplotlib.pyplot" not in sys.modules
