"""`redundancy paint`: results, table, messages, exit status."""

import json
import re

import numpy as np
import pytest

import redundancy as rd
from redundancy import _commands, _painting

TOOL = ("--tool", "-0.15,0,0.4")


def run(capsys, *arguments):
    status = _commands.run([str(a) for a in arguments])
    out, err = capsys.readouterr()
    assert "Traceback" not in out + err
    return status, out, err


@pytest.fixture
def strokes(tmp_path):
    """A short part of the demo's path."""
    positions = _commands.demo_strokes().poses[200:420:2, :3, 3]
    rd.Path(positions).to_csv(tmp_path / "path.csv")
    return tmp_path / "path.csv"


def test_rules_and_plan_are_compared_and_the_plan_is_written(capsys, strokes, tmp_path):
    out = tmp_path / "run"
    options = ("--robot", "puma560", *TOOL, "--path", strokes, "--plan", "--time-limit", 2, "--out", out)
    status, text, err = run(capsys, "paint", *options)
    assert (status, err) == (0, "")
    for name in (*_painting.RULES, _painting.PLAN):
        assert re.search(rf"^{name} +\d\.\d{{4}} +x\d\.\d{{3}}", text, re.MULTILINE), name
    assert {f.name for f in out.iterdir()} == set(_painting.RESULTS)
    summary = json.loads((out / "summary.json").read_text())
    assert summary["written"] == "plan" and summary["plan"]["status"] in ("time_limit", "converged")
    plan = next(choice for choice in summary["choices"] if choice["name"] == "plan")
    # Accelerations, and room for the leads, may slow the whole path.
    slower = summary["timing"]["slowed_down_by"]
    assert summary["speed_m_s"] == pytest.approx(plan["speed"] / slower, rel=1e-12) and slower >= 1.0
    assert plan["gain"] > 1.0
    gun = np.eye(4)
    gun[:3, 3] = (-0.15, 0.0, 0.4)
    arm = rd.catalog.load("puma560").with_tool(gun)
    trajectory = rd.Trajectory.from_csv(out / "trajectory.csv")
    on_path = np.flatnonzero(np.array(trajectory.section) == "path")
    assert len(on_path) == summary["plan"]["rows"]
    axes = arm.forward(trajectory.q[on_path])[:, :3, 2]
    assert (-axes[:, 2]).min() > np.cos(np.deg2rad(20.0)) - 1e-9
    duration = summary["length_m"] / summary["speed_m_s"]
    assert np.ptp(trajectory.t[on_path]) == pytest.approx(duration, rel=1e-3)
    page = (out / "report.html").read_text()
    assert page.count("data:image/png;base64,") == len(_painting.PICTURES)
    assert not re.search(r"(src|href)=\"?https?:", page) and "<script" not in page
    for picture in _painting.PICTURES:
        assert (out / picture).read_bytes().startswith(b"\x89PNG")


def test_the_fastest_rule_is_written_without_a_plan(capsys, strokes, tmp_path):
    out = tmp_path / "run"
    options = ("--robot", "puma560", *TOOL, "--path", strokes, "--rule", "pointing,tilt_disc", "--no-plots")
    status, text, _ = run(capsys, "paint", *options, "--out", out)
    assert status == 0 and "barrier" not in text
    assert {f.name for f in out.iterdir()} == {"trajectory.csv", "trajectory.json", "summary.json"}
    summary = json.loads((out / "summary.json").read_text())
    speeds = {choice["name"]: choice["speed"] for choice in summary["choices"]}
    assert list(speeds) == ["constant", "pointing", "tilt_disc"]
    assert summary["speed_m_s"] == max(speeds.values()) == speeds[summary["written"]]
    section = rd.Trajectory.from_json(out / "trajectory.json").section
    assert list(section).count("path") == summary["points"]


def test_margins_and_limits_reach_the_core(capsys, strokes, tmp_path):
    out = tmp_path / "run"
    options = (
        "--robot",
        "puma560",
        *TOOL,
        "--path",
        strokes,
        "--rule",
        "constant",
        "--no-plots",
        "--out",
        out,
    )
    speeds = []
    for more in ((), ("--torque-margin", 10), ("--velocity-limits", "10,10,10,10,10,10")):
        assert run(capsys, "paint", *options, *more)[0] == 0
        speeds.append(json.loads((out / "summary.json").read_text())["speed_m_s"])
    assert speeds[0] > speeds[1] > speeds[2]


def test_what_cannot_be_followed_ends_with_1(capsys, strokes, tmp_path):
    far = rd.Path(rd.Path.from_csv(strokes).poses[:, :3, 3] + [3.0, 0.0, 0.0])
    far.to_csv(tmp_path / "far.csv")
    out = tmp_path / "run"
    options = ("--robot", "puma560", *TOOL, "--path", tmp_path / "far.csv", "--out", out)
    status, _, err = run(capsys, "paint", *options)
    assert status == 1 and "cannot be followed: 110 of 110 points are out of the workspace" in err
    assert json.loads((out / "summary.json").read_text())["status"] == "infeasible"
    weak = (
        "--robot",
        "puma560",
        *TOOL,
        "--path",
        strokes,
        "--torque-limits",
        "97,5,89,24,20,21",
        "--out",
        out,
    )
    status, _, err = run(capsys, "paint", *weak)
    assert status == 1 and "'joint2' needs" in err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--robot", "pa10", "--torque-limits", "9,9,9,9,9,9,9"), "'pa10' has no inertias"),
        (("--robot", "pa10", "--velocity-limits", "off"), "no torque or velocity limit"),
        (("--robot", "r2d2"), "unknown robot 'r2d2'"),
        (("--robot", "puma560", "--tool", "1,2"), "--tool is '1,2', it must be 3 comma-separated numbers"),
        (("--robot", "puma560", "--rule", "spiral"), "--rule has 'spiral'"),
        (("--robot", "puma560", "--torque-margin", "100"), "--torque-margin is 100"),
        (("--robot", "puma560", "--spin", "wild"), "--spin is 'wild'"),
        (("--robot", "puma560", "--angle", "95"), "angle is"),
    ],
)
def test_bad_input_ends_with_2(capsys, strokes, tmp_path, options, message):
    status, _, err = run(capsys, "paint", *options, "--path", strokes, "--out", tmp_path / "run")
    rule = "--angle" in options  # the other rules still work
    assert (status, rule) in ((2, False), (0, True))
    assert rule or message in err
