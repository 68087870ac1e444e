"""What `track`, `plan` and `paint` write can be run: it passes `check`; times of the path are kept and reported."""

import json

import numpy as np
import pytest
from arms import robots

import redundancy as rd
from redundancy._commands import run

LIMITED = [name for name in rd.catalog.names() if np.isfinite(rd.catalog.load(name).velocity_limit).any()]
"""Every arm of the catalogue that has limits."""
SRS = [
    name
    for name in LIMITED
    if (form := rd.closed_form(rd.catalog.load(name))) is not None and form.name == "SrsArm"
]


def start_of(chain: rd.Chain) -> np.ndarray:
    """A posture away from limits and singularities."""
    rng = np.random.default_rng(3)
    lower, upper = np.maximum(chain.lower, -2.2), np.minimum(chain.upper, 2.2)
    q = rng.uniform(lower + 0.2 * (upper - lower), upper - 0.2 * (upper - lower), (400, chain.dof))
    least = np.linalg.svd(chain.jacobian(q), compute_uv=False)[:, -1]
    return q[np.argmax(least)]


def around(chain: rd.Chain, rows: int = 60, size: float = 0.04) -> rd.Path:
    """A bow from the pose of that posture, with the orientation held."""
    pose = chain.forward(start_of(chain))
    angle = np.linspace(0, np.pi, rows)
    poses = np.tile(pose, (rows, 1, 1))
    poses[:, :3, 3] += size * (
        np.sin(angle)[:, None] * pose[:3, 0] + (1 - np.cos(angle))[:, None] * pose[:3, 1]
    )
    return rd.Path(poses)


def command(
    name: str, robot: str, chain: rd.Chain, folder, *options: str, path: rd.Path | None = None
) -> dict:
    """Runs one command on a path around the arm's posture; the summary."""
    (path or around(chain)).to_csv(folder / "path.csv")
    arguments = [
        "--robot",
        robot,
        "--path",
        folder / "path.csv",
        "--out",
        folder / "out",
        "--no-plots",
        *options,
    ]
    status = run([name, *map(str, arguments)])
    assert status == 0
    return json.loads((folder / "out" / "summary.json").read_text())


def checked(robot: str, folder) -> int:
    return run(["check", str(folder / "out" / "trajectory.json"), "--robot", robot])


@pytest.mark.parametrize("robot", LIMITED)
def test_plans_can_be_run(robot, tmp_path, capsys):
    chain = rd.catalog.load(robot)
    summary = command("plan", robot, chain, tmp_path)
    assert summary["timing"]["times"] == "retimed"
    assert summary["timing"]["violations"] == 0
    assert summary["timing"]["jerk_limits_assumed"] is True
    jerk = summary["timing"]["jerk_limits"]
    assert np.allclose(jerk, 10.0 * np.array(summary["timing"]["acceleration_limits"]))
    assert checked(robot, tmp_path) == 0, capsys.readouterr().out
    made = rd.Trajectory.from_json(tmp_path / "out" / "trajectory.json")
    assert rd.check(chain, made, acceleration_limits=None, jerk_limits=jerk).ok
    # One row per point of the path, with accelerations.
    assert len(made) == 60
    assert made.qdd is not None
    assert np.abs(made.qd[[0, -1]]).max() == 0.0


@pytest.mark.parametrize("robot", SRS)
def test_tracks_can_be_run(robot, tmp_path, capsys):
    chain = rd.catalog.load(robot)
    summary = command("track", robot, chain, tmp_path)
    assert summary["timing"]["times"] == "retimed"
    assert checked(robot, tmp_path) == 0, capsys.readouterr().out
    assert len(rd.Trajectory.from_json(tmp_path / "out" / "trajectory.json")) == 60


@pytest.mark.parametrize("robot", LIMITED)
def test_painting_can_be_run(robot, tmp_path, capsys):
    chain = rd.catalog.load(robot)
    options = (
        () if np.isfinite(chain.effort_limit).all() and has_masses(chain) else ("--torque-limits", "off")
    )
    summary = command("paint", robot, chain, tmp_path, "--rule", "constant", *options)
    assert checked(robot, tmp_path) == 0, capsys.readouterr().out
    made = rd.Trajectory.from_json(tmp_path / "out" / "trajectory.json")
    section = np.array(made.section)
    assert [len(section[section == word]) for word in ("lead_in", "path", "lead_out")] == [10, 60, 10]
    # The tool is as fast as the summary says all along the path.
    rows = np.flatnonzero(section == "path")
    speed = np.array([np.linalg.norm(chain.jacobian(made.q[k])[:3] @ made.qd[k]) for k in rows])
    assert np.allclose(speed[2:-2], summary["speed_m_s"], rtol=2e-2)


def has_masses(chain: rd.Chain) -> bool:
    try:
        chain.inverse_dynamics(*np.zeros((3, chain.dof)))
    except ValueError:
        return False
    return True


def test_times_of_the_path_are_kept_reported_and_replaced(tmp_path, capsys):
    chain = rd.catalog.load("iiwa14")
    path = around(chain)
    # Within the speed limits, but at full speed from the first row to the last.
    fast = rd.Path(path.poses, t=np.linspace(0.0, 2.0, len(path)))
    for name in ("plan", "track"):
        summary = command(name, "iiwa14", chain, tmp_path, path=fast)
        assert summary["timing"]["times"] == "path"
        assert summary["timing"]["violations"] > 0
        assert summary["duration_s"] == pytest.approx(2.0)
        assert "--retime replaces them" in " ".join(capsys.readouterr().out.split())
        assert checked("iiwa14", tmp_path) == 1
        summary = command(name, "iiwa14", chain, tmp_path, "--retime", path=fast)
        assert summary["timing"]["violations"] == 0
        assert checked("iiwa14", tmp_path) == 0


def test_a_plan_knows_its_arm(tmp_path):
    chain = rd.catalog.load("panda")
    plan = rd.plan(chain, around(chain))
    assert plan.retime(jerk_limits=800.0) == rd.retime(chain, plan, jerk_limits=800.0)
    plan.to_npz(tmp_path / "plan.npz")
    again = rd.Plan.from_npz(tmp_path / "plan.npz")
    with pytest.raises(ValueError, match="give retime the chain"):
        again.retime()
    assert again.retime(chain, jerk_limits=800.0).t[-1] == plan.retime(jerk_limits=800.0).t[-1]


@pytest.mark.parametrize("rows", [2, 3, 5, 13, 40])
@pytest.mark.parametrize("jerk", [None, 300.0])
def test_one_row_per_row_of_the_path(rows, jerk):
    chain = rd.catalog.load("panda")
    u = np.linspace(0, 1, rows)[:, None]
    q = start_of(chain) + 0.2 * np.sin(u * np.arange(1, 8))
    move = rd.retime(chain, q, jerk_limits=jerk, rows_between=False)
    assert np.array_equal(move.q, q)
    t = np.linspace(0, move.t[-1], 2000)
    _, qd, qdd, qddd = move.sample(t)
    assert (np.abs(qd) <= chain.velocity_limit * (1 + 1e-6)).all()
    assert (np.abs(qdd) <= chain.acceleration_limit * (1 + 1e-6)).all()
    assert jerk is None or (np.abs(qddd) <= jerk * (1 + 1e-6)).all()
    between = rd.retime(chain, q, jerk_limits=jerk)
    assert move.t[-1] >= between.t[-1] * (1 - 1e-2)


def test_max_speed_holds_the_speeds_of_the_chain_by_default():
    chain = rd.catalog.load("ur5e")
    path = around(chain)
    q = rd.plan(chain, path).q
    held = rd.max_speed(chain, path, q=q, torque_limits=None)
    given = rd.max_speed(chain, path, q=q, torque_limits=None, velocity_limits=chain.velocity_limit)
    assert held.speed == given.speed
    assert held.limit == "velocity"


def test_a_ur5_paints_within_the_speeds_of_its_urdf(tmp_path, capsys):
    urdf = robots()["ur5"].path
    ends = ("--base", "base_link", "--tip", "tool0")
    chain = rd.Chain.from_urdf(urdf, "base_link", "tool0")
    options = (*ends, "--plan", "--half-angle", "20", "--time-limit", "2", "--rule", "constant")
    command("paint", str(urdf), chain, tmp_path, *options)
    made = rd.Trajectory.from_json(tmp_path / "out" / "trajectory.json")
    _, qd, _, _ = made.sample(np.linspace(0.0, made.t[-1], 5000))
    assert (np.abs(qd) <= chain.velocity_limit * (1 + 1e-3)).all()
    assert run(["check", str(tmp_path / "out" / "trajectory.json"), "--robot", str(urdf), *ends]) == 0
    # Without them the same plan is faster than the joints can be.
    command("paint", str(urdf), chain, tmp_path, *options, "--velocity-limits", "off")
    made = rd.Trajectory.from_json(tmp_path / "out" / "trajectory.json")
    assert (np.abs(made.qd) / chain.velocity_limit).max() > 1.5
    capsys.readouterr()
