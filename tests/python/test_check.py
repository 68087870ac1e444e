"""`check` and `redundancy check`: planted faults are found with row and joint, clean motions are clean, bad input."""

import functools
import json
import os
import pickle
import re
import subprocess
import sys

import numpy as np
import pytest
from arms import example_robots

import redundancy as rd

PANDA = rd.catalog.load("panda")
NAMES = PANDA.joint_names
JERK = 20 * PANDA.acceleration_limit
DT = 0.01
FULL = os.environ.get("REDUNDANCY_TEST_FULL") == "1"
FORMATS = ("json", "csv", "npz")
KINDS = (
    *(
        "position",
        "velocity",
        "acceleration",
        "jerk",
        "torque",
        "step",
        "not_at_rest",
        "winding",
        "singularity",
    ),
    *("self_collision", "collision", "path_deviation", "time"),
)


def slow(rows: int = 400) -> dict:
    """A motion far below every limit, from rest to rest, with a clean path under it."""
    t = DT * np.arange(rows)
    u = t / t[-1]
    s, ds, dds = 10 * u**3 - 15 * u**4 + 6 * u**5, 30 * u**2 * (1 - u) ** 2, 60 * u - 180 * u**2 + 120 * u**3
    a = np.array([0.1, 0.3, -0.2, -1.6, 0.3, 1.5, 0.4])
    rise = np.array([0.5, 0.2, 0.3, -0.3, 0.4, 0.5, 0.6])
    q = a + s[:, None] * rise
    return {"t": t, "q": q, "qd": ds[:, None] * rise / t[-1], "qdd": dds[:, None] * rise / t[-1] ** 2}


def write(motion: dict, form: str, folder, names=NAMES):
    """As other programs write it: neither `to_json` nor `to_csv` of this package."""
    file = folder / f"move.{form}"
    if form == "npz":
        np.savez(file, joint_names=np.array(names), **motion)
    elif form == "csv":
        columns = {"time": motion["t"][:, None], "": motion["q"], "_velocity": motion.get("qd")}
        columns["_acceleration"] = motion.get("qdd")
        header = ["time"]
        for suffix in ("", "_velocity", "_acceleration"):
            header += [name + suffix for name in names] if columns[suffix] is not None else []
        table = np.hstack([values for values in columns.values() if values is not None])
        np.savetxt(file, table, delimiter=",", header=",".join(header), comments="", fmt="%.17g")
    else:
        points = []
        for k, t in enumerate(motion["t"]):
            seconds = int(np.floor(t))
            point = {"time_from_start": {"secs": seconds, "nsecs": round((t - seconds) * 1e9)}}
            for key, word in (("q", "positions"), ("qd", "velocities"), ("qdd", "accelerations")):
                if key in motion:
                    point[word] = motion[key][k].tolist()
            points.append(point)
        file.write_text(json.dumps({"joint_trajectory": {"joint_names": list(names), "points": points}}))
    return file


def position(m, k, j):
    m["q"][k, j] = PANDA.upper[j] + 0.02
    return {}


def velocity(m, k, j):
    m["qd"][k, j] = 1.3 * PANDA.velocity_limit[j]
    return {}


def acceleration(m, k, j):
    m["qdd"][k, j] = -1.1 * PANDA.acceleration_limit[j]
    return {}


def jerk(m, k, j):
    m["qdd"][k, j] += 2.5 * JERK[j] * DT
    return {"jerk_limits": JERK}


def torque(m, k, j):
    return {"torque_limits": torque_bound(m, k, j)}


def torque_bound(m, k, j):
    """A limit that only row `k` exceeds."""
    tau = np.array([PANDA.inverse_dynamics(*state) for state in zip(m["q"], m["qd"], m["qdd"], strict=True)])
    # One row's acceleration is raised until its torque is above those of the others.
    m["qdd"][k, j] += 0.9 * PANDA.acceleration_limit[j]
    peak = np.abs(PANDA.inverse_dynamics(m["q"][k], m["qd"][k], m["qdd"][k]))[j]
    limits = np.full(7, np.inf)
    limits[j] = 0.5 * (np.abs(tau[:, j]).max() + peak)
    assert peak > 1.02 * limits[j] > 1.02 * np.abs(tau[:, j]).max()
    return limits


def step(m, k, j):
    m["q"][k:, j] += 0.15
    return {}


def not_at_rest(m, k, j):
    m["qd"][k, j] = 0.05
    return {}


def winding(m, k, j):
    m["q"][k:, j] -= 2 * np.pi
    return {}


def singularity(m, k, j):
    m["q"][k] = SINGULAR
    return {}


# A Panda that lost a direction, found by minimising the least singular value.
SINGULAR = [
    0.8551907951024126,
    1.5149592311218192,
    -0.19934065196540712,
    -0.46700242365301836,
    -2.5612013055584e-13,
    1.519080030710907,
    1.792091218862001,
]


@functools.cache
def bodies() -> rd.LinkGeometry:
    """The meshes of a Panda whose description nobody here wrote."""
    folder = example_robots()
    return rd.LinkGeometry.from_urdf(
        PANDA,
        folder / "panda_description/urdf/panda.urdf",
        package_dirs=[folder.parents[1]],
        srdf=folder / "panda_description/srdf/panda.srdf",
    )


def self_collision(m, k, j):
    m["q"][k, 3] = PANDA.lower[3]  # folded: the hand is in the base
    return {"links": bodies()}


def collision(m, k, j):
    return {"scene": rd.Scene([rd.Sphere(PANDA.forward(m["q"][k])[:3, 3], 0.004)]), "links": 0.002}


def path_deviation(m, k, j):
    poses = np.array([PANDA.forward(q) for q in m["q"]])
    poses[k, :3, 3] += [0.0, 0.003, 0.0]
    return {"path": rd.Path(poses)}


def time(m, k, j):
    m["t"][k] = m["t"][k - 1] - 0.5 * DT
    return {}


# Kind, how it is planted, rows and joints.
FAULTS = [
    *[("position", position, k, j) for k, j in ((0, 1), (57, 0), (399, 6), (200, 5))],
    *[("velocity", velocity, k, j) for k, j in ((120, 0), (201, 6), (398, 3), (33, 4))],
    *[("acceleration", acceleration, k, j) for k, j in ((120, 1), (5, 5), (350, 6), (222, 2))],
    *[("jerk", jerk, k, j) for k, j in ((120, 1), (60, 5), (350, 6))],
    *[("torque", torque, k, j) for k, j in ((120, 0), (250, 2), (300, 0))],
    *[("step", step, k, j) for k, j in ((1, 0), (150, 3), (399, 5), (250, 6))],
    *[("not_at_rest", not_at_rest, k, j) for k, j in ((0, 0), (399, 6), (0, 3))],
    *[("winding", winding, k, j) for k, j in ((100, 0), (301, 6), (399, 4))],
    *[("singularity", singularity, k, None) for k in (150, 0, 399)],
    *[("self_collision", self_collision, k, None) for k in (0, 250, 399)],
    *[("collision", collision, k, None) for k in (0, 250, 399)],
    *[("path_deviation", path_deviation, k, None) for k in (0, 250, 399)],
    *[("time", time, k, None) for k in (1, 200, 399)],
]


@pytest.mark.parametrize("case", range(len(FAULTS)))
def test_planted_faults_are_found_with_row_and_joint(case, tmp_path):
    kind, plant, k, j = FAULTS[case]
    motion = slow()
    options = plant(motion, k, j)
    for form in FORMATS:
        report = rd.check(PANDA, write(motion, form, tmp_path), **options)
        found = [
            f for f in report.findings if f.kind == kind and f.joint == (None if j is None else NAMES[j])
        ]
        # Several pairs of links touch at one row.
        rows = {f.row for f in found} if kind == "self_collision" else [f.row for f in found]
        assert list(rows) == [k], (form, report.findings)
        severity = "warning" if kind in {"winding", "singularity"} else "error"
        assert found[0].severity == severity
        assert report.ok == (not any(f.severity == "error" for f in report.findings))
        # The faults of the others are not blamed on joints that have none.
        assert {f.joint for f in report.findings} <= {
            None,
            *(NAMES if kind in {"singularity", "self_collision"} else [found[0].joint]),
        }
    assert len(FAULTS) >= 40
    assert {fault[0] for fault in FAULTS} == set(KINDS)


def smooth(chain: rd.Chain, rows: int, seed: int) -> np.ndarray:
    """A random smooth path within the joint limits."""
    rng = np.random.default_rng(seed)
    n = chain.dof
    u = np.linspace(0, 1, rows)[:, None]
    wave = rng.uniform(0.1, 0.6, n) * np.sin(rng.uniform(1, 4, n) * u + rng.uniform(-3, 3, n))
    wave += rng.uniform(0, 0.25, n) * np.cos(rng.uniform(2, 7, n) * u)
    lower, upper = np.maximum(chain.lower, -3), np.minimum(chain.upper, 3)
    return 0.5 * (lower + upper) + 0.45 * (upper - lower) * wave


@pytest.mark.parametrize("block", range(20 if FULL else 4))
def test_clean_trajectories_have_no_findings(block, tmp_path):
    for case in range(10):
        seed = 10 * block + case
        chain = rd.catalog.load(("panda", "iiwa14", "fr3", "gen3")[seed % 4])
        acceleration = PANDA.acceleration_limit if seed % 4 == 0 else np.full(7, 8.0)
        jerk = 8 * acceleration if seed % 3 == 0 else None
        limits = {"acceleration_limits": acceleration, "jerk_limits": jerk}
        move = rd.retime(chain, smooth(chain, 100 + 20 * case, seed), **limits)
        form = FORMATS[seed % 3]
        file = tmp_path / f"clean.{form}"
        getattr(move, f"to_{form}")(file)
        for given in (move, file):
            # A random path may well come near a singularity; that is no false alarm.
            report = rd.check(chain, given, singularity=0.0, **limits)
            assert report.ok
            assert report.findings == [], (seed, form, report.findings)


def test_a_smooth_path_beside_its_path_is_clean_whatever_its_rows():
    circle = rd.paths.circle((0.5, 0.1, 0.4), 0.1, orientation=np.diag([1.0, -1.0, -1.0]), n=200)
    plan = rd.plan(PANDA, circle, time_limit=5.0)
    move = rd.retime(PANDA, plan)
    assert rd.check(PANDA, move, circle).findings == []
    even = rd.retime(PANDA, plan, dt=0.004)
    assert rd.check(PANDA, even, circle).findings == []
    half = rd.Trajectory(NAMES, even.t[: len(even) // 2], even.q[: len(even) // 2], even.qd[: len(even) // 2])
    kinds = {f.kind for f in rd.check(PANDA, half, circle).findings}
    assert kinds == {"not_at_rest", "path_deviation"}


def test_reports_pickle_and_say_what_they_are():
    motion = slow()
    velocity(motion, 100, 2)
    move = rd.Trajectory(NAMES, motion["t"], motion["q"], motion["qd"], qdd=motion["qdd"])
    report = rd.check(PANDA, move)
    assert pickle.loads(pickle.dumps(report)) == report
    assert not report
    assert len(report) == 400
    assert report.errors == len([f for f in report.findings if f.severity == "error"])
    found = next(f for f in report.findings if f.kind == "velocity")
    assert found.rows[0] <= 100 <= found.rows[1]
    assert abs(found.value) > found.bound == PANDA.velocity_limit[2]
    assert found.t == pytest.approx(1.0)
    assert "Finding(velocity, row 100" in repr(found)
    assert rd.check(PANDA, move, velocity_limits=None, acceleration_limits=None).ok


def test_links_that_touch_are_named_and_may_be_allowed():
    motion = slow()
    assert rd.check(PANDA, trajectory(motion), links=bodies()).findings == []
    self_collision(motion, 250, None)
    found = [f for f in rd.check(PANDA, trajectory(motion), links=bodies()).findings if "self" in f.kind]
    least = bodies().self_clearance(motion["q"])
    # Between the rows the links may overlap more.
    assert min(f.value for f in found) <= least.distance.min() < 0.0
    first = min(found, key=lambda f: f.value)
    pair = re.match(r"links '(\w+)' and '(\w+)' overlap", first.message).groups()
    links = bodies()
    for a, b in links.pairs:
        if {a, b} == set(pair):
            links = links.allow(a, b)
    left = [f for f in rd.check(PANDA, trajectory(motion), links=links).findings if "self" in f.kind]
    assert all(not set(pair) <= set(re.findall(r"'(\w+)'", f.message)) for f in left)


def trajectory(motion: dict) -> rd.Trajectory:
    return rd.Trajectory(NAMES, motion["t"], motion["q"], motion["qd"], qdd=motion["qdd"])


@pytest.mark.parametrize("ends", ["rest", "moving", "accelerating"])
def test_every_format_says_the_same_about_rest(ends, tmp_path):
    """With velocities that a program took as differences, and with accelerations or without."""
    u = np.linspace(0, 1, 301) + (0.0 if ends == "rest" else 0.1)
    t = 1.0 + np.pi * 1e-3 + np.arange(301) / 70
    duration, joints = t[-1] - t[0], np.arange(7)
    q = np.array([0.1, 0.3, -0.2, -1.6, 0.3, 1.5, 0.4]) + 0.3 * (u**3)[:, None] * joints
    motions = [{"t": t, "q": q, "qd": np.gradient(q, t, axis=0)}]
    if ends == "accelerating":
        exact = {"t": t, "q": q, "qd": 0.9 * (u**2)[:, None] * joints / duration}
        motions = [exact, {**exact, "qdd": 1.8 * u[:, None] * joints / duration**2}]
    for jerk in (None, 1.0):
        said = set()
        for motion in motions:
            for form in FORMATS:
                report = rd.check(PANDA, write(motion, form, tmp_path), jerk_limits=jerk, singularity=0.0)
                found = [f for f in report.findings if f.kind == "not_at_rest"]
                said.add(tuple((f.row, f.joint, f.message.split(" at ")[0]) for f in found))
        assert len(said) == 1, said
        (found,) = said
        # The first row moves by less than its differences tell, but accelerates.
        still = ("rest", "moving") if jerk is None else ("rest",)
        assert {row for row, *_ in found} == ({300} if ends in still else {0, 300})
        assert any("accelerates" in words for *_, words in found) == (jerk is not None)


def test_jumps_of_acceleration_are_jerk():
    move = rd.retime(PANDA, smooth(PANDA, 200, 3))
    report = rd.check(PANDA, move, jerk_limits=JERK, singularity=0.0)
    assert {f.kind for f in report.findings} == {"jerk", "not_at_rest"}
    assert {f.row for f in report.findings if f.kind == "not_at_rest"} == {0, len(move) - 1}


def test_joints_in_any_order(tmp_path):
    motion = slow()
    order = [3, 0, 6, 1, 5, 2, 4]
    mixed = {key: values if key == "t" else values[:, order] for key, values in motion.items()}
    for form in FORMATS:
        file = write(mixed, form, tmp_path, [NAMES[i] for i in order])
        assert rd.check(PANDA, file).findings == []


@pytest.mark.parametrize("form", FORMATS)
def test_bad_input_is_named(form, tmp_path):
    motion = slow(20)
    missing = {key: values if key == "t" else values[:, :6] for key, values in motion.items()}
    with pytest.raises(ValueError, match="missing: panda_joint7"):
        rd.check(PANDA, write(missing, form, tmp_path, NAMES[:6]))
    extra = {key: values if key == "t" else np.c_[values, values[:, :1]] for key, values in motion.items()}
    with pytest.raises(ValueError, match="not in the chain: finger"):
        rd.check(PANDA, write(extra, form, tmp_path, [*NAMES, "finger"]))
    degrees = {"t": motion["t"], "q": np.degrees(motion["q"])}
    degrees["q"][5, 0] = 160.0
    with pytest.raises(ValueError, match="in degrees"):
        rd.check(PANDA, write(degrees, form, tmp_path))
    none = {key: values[:0] for key, values in motion.items()}
    with pytest.raises(ValueError, match="no rows"):
        rd.check(PANDA, write(none, form, tmp_path))
    (tmp_path / f"empty.{form}").write_text("")
    with pytest.raises(ValueError, match=r"empty\."):
        rd.check(PANDA, tmp_path / f"empty.{form}")


def test_bad_settings_are_named():
    move = rd.retime(PANDA, smooth(PANDA, 20, 1))
    for options, words in (
        ({"velocity_limits": -1.0}, "velocity_limits"),
        ({"tolerance": -0.1}, "tolerance"),
        ({"jerk_limits": [1.0]}, "jerk_limits"),
        ({"clearance": -1.0}, "clearance"),
        ({"torque_limits": "motor"}, "torque_limits"),
    ):
        with pytest.raises(ValueError, match=words):
            rd.check(PANDA, move, **options)
    with pytest.raises(ValueError, match="ends in"):
        rd.check(PANDA, "move.txt")
    with pytest.raises(ValueError, match=r"missing: panda_joint1.*not in the chain: other"):
        rd.check(PANDA, rd.Trajectory(["other"], [0.0], [[0.0]]))


def run(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "redundancy", "check", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
    )


def test_command_line_formats_and_exit_status(tmp_path):
    motion = slow()
    clean = write(motion, "csv", tmp_path)
    done = run(clean, "--robot", "panda")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"{clean}: 400 rows, nothing found\n"
    winding(motion, 100, 0)
    warned = run(
        write(motion, "csv", tmp_path), "--robot", "panda", "--velocity-limits", "off", "--format", "json"
    )
    report = json.loads(warned.stdout)
    assert report["warnings"] == 1
    assert [f["row"] for f in report["findings"] if f["kind"] == "winding"] == [100]
    bad = slow()
    velocity(bad, 33, 4)
    failed = run(write(bad, "csv", tmp_path), "--robot", "panda", "--format", "github")
    assert failed.returncode == 1
    assert re.search(
        r"^::error file=.*move\.csv,line=35,title=velocity::row 33: joint 'panda_joint5'", failed.stdout
    )
    failed = run(write(bad, "json", tmp_path), "--robot", "panda")
    assert failed.returncode == 1
    assert "error: velocity: row 33: joint 'panda_joint5'" in failed.stdout


def test_command_line_bad_input(tmp_path):
    motion = slow(30)
    time(motion, 7, 0)
    unsorted = run(write(motion, "json", tmp_path), "--robot", "panda", "--format", "json")
    assert unsorted.returncode == 2
    assert "row 7" in unsorted.stderr
    report = json.loads(unsorted.stdout)
    assert report["judged"] is False
    assert [(f["kind"], f["row"]) for f in report["findings"]] == [("time", 7)]
    assert run(tmp_path / "none.csv", "--robot", "panda").returncode == 2
    assert run(write(slow(30), "csv", tmp_path), "--robot", "panda", "--format", "xml").returncode == 2
    assert run(write(slow(30), "csv", tmp_path), "--robot", "iiwa14").returncode == 2


A, B = [0, 0.3, 0, -1, 0.2, 1, 0], [1.5, 0.5, 0, -1.4, 0.2, 1.2, 0.3]


def test_a_joint_move_is_straight_timed_and_clear():
    for jerk in (None, JERK):
        move = rd.joint_move(PANDA, A, B, jerk_limits=jerk)
        assert np.array_equal(move.q[[0, -1]], [A, B])
        q, _, _, _ = move.sample(np.linspace(0, move.t[-1], 300))
        rise = np.subtract(B, A)
        share = (q - A) @ rise / (rise @ rise)
        assert np.abs(q - A - share[:, None] * rise).max() < 1e-9
        assert rd.check(PANDA, move, jerk_limits=jerk).ok
    free = rd.Scene([rd.Sphere((0.0, 0.0, 3.0), 0.1)])
    assert rd.joint_move(PANDA, A, B, scene=free) == rd.joint_move(PANDA, A, B)


def test_a_joint_move_says_what_it_touches():
    middle = PANDA.forward(np.mean([A, B], axis=0))[:3, 3]
    ball = rd.Scene([rd.Sphere((0, 0, 3), 0.1), rd.Sphere(middle, 0.05)])
    with pytest.raises(rd.CannotFollowError, match=r"link 'panda_.*obstacle 1 \(sphere\)"):
        rd.joint_move(PANDA, A, B, scene=ball)
    with pytest.raises(rd.CannotFollowError, match="joint 'panda_joint4' is at"):
        rd.joint_move(PANDA, A, [0, 0.3, 0, 1, 0.2, 1, 0])
    with pytest.raises(ValueError, match="q_to"):
        rd.joint_move(PANDA, A, B[:6])
    with pytest.raises(ValueError, match="acceleration limit"):
        rd.joint_move(rd.catalog.load("iiwa14"), A, B)
