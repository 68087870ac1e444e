"""Measure one neighbour beside this library, in the neighbour's own environment; prints rows as JSON.

Usage: worker.py NEIGHBOUR --seed N [--poses N]. In each round both have their turn on the same inputs.
"""

import argparse
import importlib
import importlib.metadata
import json
import sys
import tempfile
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import redundancy as rd

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "python"))
import bench_ik  # noqa: E402
import bench_velocity  # noqa: E402
from neighbours import Array, random_q, urdf  # noqa: E402

BLOCK = 25
"""Inputs until it is the other's turn."""
MET = 2e-6
"""A pose is met within this, m and rad."""
AT_LIMIT = 1e-9
STEP_ERROR = 1e-2
"""Largest error of a velocity step, m/s and rad/s; soft tasks trade the task for the posture."""
Row = dict[str, Any]
Job = Callable[[int], Any]


def row(job: str, arm: str, solver: str, seconds: list[float], **more: Any) -> Row:
    """One line of the table: quantiles of the time, and what was checked."""
    p50, p90, p99 = np.percentile(seconds, [50, 90, 99])
    times = {"median_us": p50 * 1e6, "p90_us": p90 * 1e6, "p99_us": p99 * 1e6, "calls": len(seconds)}
    return {"job": job, "arm": arm, "solver": solver, **times, **more}


def interleaved(jobs: dict[str, Job], count: int) -> tuple[dict[str, list[float]], dict[str, list[Any]]]:
    """Seconds of each call and its answer; the jobs take turns after every block of inputs."""
    seconds: dict[str, list[float]] = {name: [] for name in jobs}
    answers: dict[str, list[Any]] = {name: [] for name in jobs}
    for job in jobs.values():
        job(0)
    for first in range(0, count, BLOCK):
        for name, job in jobs.items():
            for i in range(first, min(first + BLOCK, count)):
                begin = time.perf_counter()
                answer = job(i)
                seconds[name].append(time.perf_counter() - begin)
                answers[name].append(answer)
    return seconds, answers


def judged(chain: rd.Chain, answers: list[Any], poses: Array) -> dict[str, Any]:
    """Of how many poses the answer is right, none, wrong, or beyond a limit."""
    counts = {"success": 0, "none": 0, "misses_pose": 0, "beyond_limits": 0}
    for q, pose in zip(answers, poses, strict=True):
        if q is None or len(q) != chain.dof or not np.isfinite(q).all():
            counts["none"] += 1
        elif np.abs(chain.forward(np.asarray(q, float)) - pose).max() > MET:
            counts["misses_pose"] += 1
        elif ((q < chain.lower - AT_LIMIT) | (q > chain.upper + AT_LIMIT)).any():
            counts["beyond_limits"] += 1
        else:
            counts["success"] += 1
    success = counts.pop("success") / len(poses)
    return {"success": success, "violations": counts}


def pose_ik(
    arms: tuple[str, ...], make: Callable[[rd.Chain, str], Callable[[Array], Any]], seed: int, n: int
) -> list[Row]:
    """Poses of random configurations within limits to joints, no hint at the answer."""
    rows = []
    for arm in arms:
        chain = rd.catalog.load(arm)
        poses = chain.forward(random_q(chain, n, seed))
        numeric, exact = rd.IkSolver(chain, closed_form=False), rd.IkSolver(chain)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, "arm.urdf")
            file.write_text(bench_ik.urdf(chain))
            theirs = make(chain, str(file))

            def solved(solver: rd.IkSolver, i: int, poses: Array = poses) -> Any:
                result = solver.solve(poses[i])
                return result.q if str(result.status) == "converged" else None

            jobs: dict[str, Job] = {
                "theirs": lambda i, poses=poses, theirs=theirs: theirs(poses[i]),
                "ours, numeric": lambda i, s=numeric, solved=solved: solved(s, i),
            }
            if exact.closed_form:
                jobs["ours, closed form"] = lambda i, s=exact, solved=solved: solved(s, i)
            seconds, answers = interleaved(jobs, n)
        rows += [row("pose to joints", arm, s, seconds[s], **judged(chain, answers[s], poses)) for s in jobs]
    return rows


def frankik_job(module: Any, chain: rd.Chain) -> Callable[[Array], Any]:
    """Its inverse takes the pose of the flange, which is the tip of our chain."""
    solver = module.FrankaKinematics(robot_type="panda")
    middle = 0.5 * (chain.lower + chain.upper)
    return lambda pose: solver.inverse(pose, middle)


def ssik_job(module: Any, chain: rd.Chain) -> Callable[[Array], Any]:
    """The solver that it ships for the arm; a constant offset between the frames of the tool."""
    arm = module.Manipulator.from_prebuilt({"panda": "franka_panda"}.get(chain.name, chain.name))
    middle = 0.5 * (chain.lower + chain.upper)
    offset = np.linalg.inv(chain.forward(middle)) @ arm.fk(middle)
    assert np.abs(chain.forward(middle + 0.1) @ offset - arm.fk(middle + 0.1)).max() < 1e-9, "another arm"

    def job(pose: Array) -> Any:
        found = arm.solve(pose @ offset, max_solutions=1)
        return found[0].q if found else None

    return job


def velocity_step(name: str, seed: int, n: int) -> list[Row]:
    """A step of velocity control with hard limits, away from singularities."""
    chain = rd.catalog.load("iiwa14")
    q = bench_velocity.regular(chain)
    n = min(n, len(q))
    pin, text = importlib.import_module("pinocchio"), urdf(chain)
    if name == "pink":
        theirs = bench_velocity.with_pink(
            pin, importlib.import_module("pink"), pin.buildModelFromXML(text), q
        )
    else:
        theirs = bench_velocity.with_placo(importlib.import_module("placo"), pin, text, chain, q)
    jobs: dict[str, Job] = {"theirs": theirs, "ours": bench_velocity.ours(chain, q)["saturated_nullspace"]}
    seconds, answers = interleaved(jobs, n)
    wanted, rows = bench_velocity.VELOCITY, []
    for solver in jobs:
        errors = [np.linalg.norm(chain.jacobian(q[i]) @ answers[solver][i] - wanted) for i in range(n)]
        fast = sum(bool((np.abs(v) > chain.velocity_limit * (1 + 1e-9)).any()) for v in answers[solver])
        checked = {"success": float(np.mean(np.array(errors) < STEP_ERROR)), "violations": {"too_fast": fast}}
        quality = {"median_error": float(np.median(errors))}
        rows.append(row("velocity step with limits", "iiwa14", solver, seconds[solver], **checked, **quality))
    return rows


def kinematics(seed: int, n: int) -> list[Row]:
    """Forward kinematics and Jacobian, and how far both agree."""
    pin = importlib.import_module("pinocchio")
    rows = []
    for arm in ("iiwa14", "panda", "ur5e"):
        chain = rd.catalog.load(arm)
        model = pin.buildModelFromXML(urdf(chain))
        data, frame, q = model.createData(), model.getFrameId("tool"), random_q(chain, n, seed)

        def theirs(i: int, model: Any = model, data: Any = data, frame: int = frame, q: Array = q) -> Any:
            jacobian = pin.computeFrameJacobian(model, data, q[i], frame, pin.LOCAL_WORLD_ALIGNED)
            return pin.updateFramePlacement(model, data, frame).homogeneous, jacobian

        jobs: dict[str, Job] = {"theirs": theirs, "ours": lambda i, c=chain, q=q: c.kinematics(q[i])}
        seconds, answers = interleaved(jobs, n)
        pairs = zip(answers["theirs"], answers["ours"], strict=True)
        differ = [max(np.abs(a[0] - b[0]).max(), np.abs(a[1] - b[1]).max()) for a, b in pairs]
        checked = {"success": float(np.mean(np.array(differ) < 1e-9)), "violations": {}}
        rows += [row("FK and Jacobian", arm, s, seconds[s], **checked) for s in jobs]
    return rows


def paths(seed: int, n: int) -> list[tuple[rd.Chain, Array]]:
    """Smooth joint paths of a Panda."""
    chain, rng = rd.catalog.load("panda"), np.random.default_rng(seed)
    middle, half = 0.5 * (chain.lower + chain.upper), 0.4 * (chain.upper - chain.lower)
    u = np.linspace(0.0, 1.0, 200)[:, None]
    found = []
    for _ in range(n):
        phase, turns = rng.uniform(0, 2 * np.pi, 7), rng.uniform(0.3, 1.2, 7)
        found.append((chain, middle + half * np.sin(2 * np.pi * turns * u + phase)))
    return found


def beyond(chain: rd.Chain, qd: Array, qdd: Array) -> float:
    """The largest share of a limit of velocity or acceleration that is used, minus one."""
    used = max((np.abs(qd) / chain.velocity_limit).max(), (np.abs(qdd) / chain.acceleration_limit).max())
    return float(used - 1.0)


def retiming(seed: int, n: int) -> list[Row]:
    """Times for a joint path: duration, and the largest excess over a limit on a grid ten times as fine as the rows."""
    ta = importlib.import_module("toppra")
    constraint, algorithm = (
        importlib.import_module("toppra.constraint"),
        importlib.import_module("toppra.algorithm"),
    )
    cases = paths(seed, min(n, 40))

    def theirs(i: int) -> Any:
        chain, q = cases[i]
        grid = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(q, axis=0), axis=1))])
        curve = ta.SplineInterpolator(grid, q)
        limits = [
            constraint.JointVelocityConstraint(chain.velocity_limit),
            constraint.JointAccelerationConstraint(
                chain.acceleration_limit, discretization_scheme=constraint.DiscretizationType.Interpolation
            ),
        ]
        solver = algorithm.TOPPRA(limits, curve, gridpoints=grid, parametrizer="ParametrizeSpline")
        return solver.compute_trajectory(0, 0)

    jobs: dict[str, Job] = {"theirs": theirs, "ours": lambda i: rd.retime(*cases[i])}
    seconds, answers = interleaved(jobs, len(cases))
    rows = []
    for solver in jobs:
        durations, excess = [], []
        for (chain, _), motion in zip(cases, answers[solver], strict=True):
            if motion is None:
                continue
            end = motion.duration if solver == "theirs" else float(motion.t[-1])
            t = np.linspace(0.0, end, 2_000)
            samples = (motion(t, 1), motion(t, 2)) if solver == "theirs" else motion.sample(t)[1:3]
            durations.append(end)
            excess.append(beyond(chain, *samples))
        checked = {
            "success": len(durations) / len(cases),
            "violations": {"limits": int((np.array(excess) > 1e-6).sum())},
        }
        quality = {"median_duration_s": float(np.median(durations)), "largest_excess": float(np.max(excess))}
        rows.append(
            row("times for a path of 200 rows", "panda", solver, seconds[solver], **checked, **quality)
        )
    return rows


def point_to_point(seed: int, n: int) -> list[Row]:
    """Rest to rest on a straight line in joint space, with jerk limits."""
    ruckig = importlib.import_module("ruckig")
    chain, rng = rd.catalog.load("panda"), np.random.default_rng(seed)
    n, jerk = min(n, 100), 20 * chain.acceleration_limit
    ends = rng.uniform(chain.lower, chain.upper, (n, 2, 7))

    def theirs(i: int) -> float:
        otg, question, answer = ruckig.Ruckig(7), ruckig.InputParameter(7), ruckig.Trajectory(7)
        question.current_position, question.target_position = ends[i, 0].tolist(), ends[i, 1].tolist()
        question.max_velocity = chain.velocity_limit.tolist()
        question.max_acceleration, question.max_jerk = chain.acceleration_limit.tolist(), jerk.tolist()
        question.synchronization = ruckig.Synchronization.Phase
        result = otg.calculate(question, answer)
        return answer.duration if result in {ruckig.Result.Working, ruckig.Result.Finished} else np.nan

    def ours(i: int) -> float:
        return float(rd.retime(chain, np.linspace(*ends[i], 2), jerk_limits=jerk).t[-1])

    seconds, answers = interleaved({"theirs": theirs, "ours": ours}, n)
    rows = []
    for solver in seconds:
        durations = np.array(answers[solver])
        checked = {"success": float(np.isfinite(durations).mean()), "violations": {}}
        quality = {"median_duration_s": float(np.nanmedian(durations))}
        rows.append(
            row("rest to rest with jerk limits", "panda", solver, seconds[solver], **checked, **quality)
        )
    return rows


def distances(seed: int, n: int) -> list[Row]:
    """Least signed distance of the moving links, as capsules from joint to joint, to ten spheres."""
    coal = importlib.import_module("coal")
    chain, rng = rd.catalog.load("iiwa14"), np.random.default_rng(seed)
    q, radius = random_q(chain, n, seed), 0.05
    obstacles = [rd.Sphere(rng.uniform(-1, 1, 3), 0.1) for _ in range(10)]
    scene = rd.Scene(obstacles)
    origins = [np.array([chain.forward(x, link=name)[:3, 3] for name in chain.link_names]) for x in q]
    balls = [(coal.Sphere(o.radius), coal.Transform3s(np.eye(3), np.asarray(o.center))) for o in obstacles]
    request = coal.DistanceRequest()

    def theirs(i: int) -> float:
        least, points = np.inf, origins[i][1:]  # the first link does not move
        for a, b in pairwise(points):
            length = np.linalg.norm(b - a)
            if length < 1e-9:
                continue
            capsule = coal.Capsule(radius, length)
            turn = coal.Quaternion.FromTwoVectors(
                np.array([0.0, 0.0, 1.0]), (b - a) / length
            ).toRotationMatrix()
            place = coal.Transform3s(turn, 0.5 * (a + b))
            for ball, at in balls:
                least = min(least, coal.distance(capsule, place, ball, at, request, coal.DistanceResult()))
        return least

    jobs: dict[str, Job] = {
        "theirs": theirs,
        "ours": lambda i: scene.clearance(chain, q[i], link_radius=radius).distance,
    }
    seconds, answers = interleaved(jobs, n)
    differ = np.abs(np.array(answers["theirs"]) - np.array(answers["ours"]))
    checked = {"success": float((differ < 1e-4).mean()), "violations": {}}
    return [row("least distance to ten spheres", "iiwa14", s, seconds[s], **checked) for s in jobs]


def rows_of(name: str, seed: int, n: int) -> tuple[str, list[Row]]:
    """The distribution whose version counts, and the rows."""
    seven, lock = ("iiwa14", "panda"), {"panda": 6, "iiwa14": 2}
    load = importlib.import_module
    jobs: dict[str, tuple[str, Callable[[], list[Row]]]] = {
        "eaik": (
            "EAIK",
            lambda: pose_ik(
                seven, lambda c, _: bench_ik.with_eaik(load("eaik.IK_Homogeneous"), c, lock[c.name]), seed, n
            ),
        ),
        "ssik": (
            "ssik",
            lambda: pose_ik(seven, lambda c, _: ssik_job(load("ssik"), c), seed, n),
        ),
        "roboticstoolbox": (
            "roboticstoolbox-python",
            lambda: pose_ik(
                (*seven, "puma560"),
                lambda c, _: bench_ik.with_roboticstoolbox(load("roboticstoolbox"), c),
                seed,
                n,
            ),
        ),
        "optik": (
            "optik-py",
            lambda: pose_ik(seven, lambda c, f: bench_ik.with_optik(load("optik"), c, f), seed, n),
        ),
        "pytracik": (
            "pytracik",
            lambda: pose_ik(seven, lambda c, f: bench_ik.with_trac_ik(load("pytracik"), c, f), seed, n),
        ),
        "frankik": (
            "frankik",
            lambda: pose_ik(("panda",), lambda c, _: frankik_job(load("frankik"), c), seed, n),
        ),
        "pink": ("pin-pink", lambda: velocity_step("pink", seed, n)),
        "placo": ("placo", lambda: velocity_step("placo", seed, n)),
        "pinocchio": ("pin", lambda: kinematics(seed, n)),
        "toppra": ("toppra", lambda: retiming(seed, n)),
        "ruckig": ("ruckig", lambda: point_to_point(seed, n)),
        "coal": ("coal", lambda: distances(seed, n)),
    }
    if name not in jobs:
        return name, []
    distribution, run = jobs[name]
    return distribution, run()


def main() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("neighbour")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--poses", type=int, default=500)
    options = parser.parse_args()
    distribution, rows = rows_of(options.neighbour, options.seed, options.poses)
    version = importlib.metadata.version(distribution) if rows else ""
    print(json.dumps({"version": version, "ours": rd.__version__, "rows": rows}))


if __name__ == "__main__":
    main()
