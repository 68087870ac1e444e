"""Pose to joints beside other solvers: one run, the same arms, the same poses, the same check of every answer.

Prints Markdown tables. Poses come from uniform joint angles within the limits; the solvers take turns after every 50
poses. 'In between' they take turns after every pose, so that each finds the caches full of the others' data. An answer
counts when forward kinematics meets the pose within 2e-6 (m and rad) and the joints are within their limits.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import redundancy as rd

sys.path.insert(0, str(Path(__file__).parent))
from neighbours import Array, axes_and_points, machine, optional, random_q, table, time_text

POSES = 1_000
BLOCK = 50
"""Poses until it is the next solver's turn."""
COLD = 200
"""Poses at which every solver has one turn."""
BATCH = 20_000
TIGHT = 2e-6
LOCKS = 24
"""Values at which EAIK's locked joint is tried; the last joint of the Panda, the third of the iiwa."""
HEAD = ("arm", "solver", "success", "median", "p99", "median in between", "remark")
SPIN = {"Rx": (1.0, 0.0, 0.0), "Ry": (0.0, 1.0, 0.0), "Rz": (0.0, 0.0, 1.0)}

Job = Callable[[Array], Any]


def urdf(chain: rd.Chain) -> str:
    """The arm as a URDF, joints where they are at zero."""
    axes, points, tool = axes_and_points(chain)
    lines = ['<robot name="arm"><link name="l0"/>']
    before = np.zeros(3)
    for i, (axis, point) in enumerate(zip(axes, points, strict=True)):
        xyz, z = ("{} {} {}".format(*map(repr, map(float, v))) for v in (point - before, axis))
        lower, upper = float(chain.lower[i]), float(chain.upper[i])
        lines.append(
            f'<link name="l{i + 1}"/><joint name="j{i + 1}" type="revolute">'
            f'<parent link="l{i}"/><child link="l{i + 1}"/>'
            f'<origin xyz="{xyz}" rpy="0 0 0"/><axis xyz="{z}"/>'
            f'<limit lower="{lower}" upper="{upper}" velocity="1" effort="1"/></joint>'
        )
        before = point
    r = tool[:3, :3]
    roll, pitch = np.arctan2(r[2, 1], r[2, 2]), np.arctan2(-r[2, 0], np.hypot(r[0, 0], r[1, 0]))
    rpy = f"{float(roll)!r} {float(pitch)!r} {float(np.arctan2(r[1, 0], r[0, 0]))!r}"
    xyz = "{} {} {}".format(*map(repr, map(float, tool[:3, 3] - before)))
    lines.append(
        f'<link name="tip"/><joint name="end" type="fixed"><parent link="l{chain.dof}"/><child link="tip"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/></joint></robot>'
    )
    return "".join(lines)


def with_roboticstoolbox(rtb: Any, chain: rd.Chain) -> Job:
    """ik_LM with its residual tight enough for 1e-6."""
    axes, points, tool = axes_and_points(chain)
    ets, before = rtb.ETS(), np.zeros(3)
    for i, (axis, point) in enumerate(zip(axes, points, strict=True)):
        for name, shift in zip(("tx", "ty", "tz"), point - before, strict=True):
            ets *= getattr(rtb.ET, name)(float(shift))
        spin = next(name for name, v in SPIN.items() if abs(abs(np.dot(v, axis)) - 1) < 1e-9)
        limits = [float(chain.lower[i]), float(chain.upper[i])]
        ets *= getattr(rtb.ET, spin)(flip=bool(axis.sum() < 0), qlim=limits)
        before = point
    end = tool.copy()
    end[:3, 3] -= before
    ets *= rtb.ET.SE3(end)
    return lambda pose: ets.ik_LM(pose, tol=1e-13, ilimit=100, slimit=200)[0]


def with_optik(optik: Any, chain: rd.Chain, path: str) -> Job:
    """Its default tolerance misses by 1e-3; here the squared error is tight."""
    robot = optik.Robot.from_urdf_file(path, "l0", "tip")
    robot.set_parallelism(1)
    config = optik.SolverConfig(tol_f=1e-14, max_time=0.5)
    start = ((chain.lower + chain.upper) / 2).tolist()

    def job(pose: Array) -> Any:
        found = robot.ik(config, pose.tolist(), start)
        return None if found is None else found[0]

    return job


def with_trac_ik(pytracik: Any, chain: rd.Chain, path: str) -> Job:
    """Speed mode, tolerance 1e-6."""
    solver = pytracik.TRAC_IK("l0", "tip", Path(path).read_text(), 0.05, 1e-6, pytracik.SolveType.Speed)
    start = (chain.lower + chain.upper) / 2

    def job(pose: Array) -> Any:
        r = pose[:3, :3]
        w, x, y, z = rd.quaternion.from_zyz(angles_zyz(r))
        found = np.asarray(pytracik.ik(solver, start, *pose[:3, 3], x, y, z, w)).ravel()
        # The first entry is the number of solutions.
        return found[1:] if found[0] >= 0 else None

    return job


def angles_zyz(r: Array) -> Array:
    """Euler angles of a rotation matrix."""
    beta = np.arctan2(np.hypot(r[0, 2], r[1, 2]), r[2, 2])
    return np.array([np.arctan2(r[1, 2], r[0, 2]), beta, np.arctan2(r[2, 1], -r[2, 0])])


def with_eaik(eaik: Any, chain: rd.Chain, joint: int) -> Job:
    """One joint locked on a grid, the first answer within limits."""
    axes, points, tool = axes_and_points(chain)
    frames = np.tile(np.eye(4), (chain.dof + 1, 1, 1))
    for frame, z, point in zip(frames[:-1], axes, points, strict=True):
        x = np.roll(z, 1)
        frame[:3, :3] = np.column_stack([x, np.cross(z, x), z])
        frame[:3, 3] = point
    frames[-1] = tool
    values = np.linspace(chain.lower[joint], chain.upper[joint], LOCKS + 2)[1:-1]
    values = values[np.argsort(np.abs(values - values.mean()))]
    robots = [eaik.HomogeneousRobot(frames, fixed_axes=[(joint, float(v))]) for v in values]

    def job(pose: Array) -> Any:
        for robot in robots:
            for found in robot.IK(pose).Q:
                # Its answers are principal values and may be least-squares ones.
                q = found - 2 * np.pi * ((found > chain.upper).astype(float) - (found < chain.lower))
                if is_answer(chain, q, pose):
                    return q
        return None

    return job


def with_ssik(ssik: Any, chain: rd.Chain) -> Job:
    """Its closed forms with limits."""
    axes, points, tool = axes_and_points(chain)
    transforms = np.tile(np.eye(4), (chain.dof + 1, 1, 1))
    transforms[:-1, :3, 3] = np.diff(points, axis=0, prepend=0.0)
    transforms[-1] = tool
    transforms[-1, :3, 3] -= points[-1]
    arm = ssik.Manipulator.from_transforms(
        transforms, axes, limits=np.column_stack([chain.lower, chain.upper])
    )

    def job(pose: Array) -> Any:
        found = arm.solve(pose, max_solutions=1)
        return found[0].q if found else None

    return job


def jobs_of(chain: rd.Chain, folder: str) -> dict[str, tuple[Job, str]]:
    """Every solver that is installed."""
    path = str(Path(folder) / "arm.urdf")
    Path(path).write_text(urdf(chain))
    numeric = rd.IkSolver(chain, closed_form=False)
    jobs: dict[str, tuple[Job, str]] = {"**this library, numeric**": (lambda pose: numeric.solve(pose).q, "")}
    exact = rd.IkSolver(chain)
    if exact.closed_form:
        jobs["**this library, closed form**"] = (lambda pose: exact.solve(pose).q, exact.closed_form)
    makers: dict[str, tuple[str, Callable[[Any], Job], str]] = {
        "EAIK": (
            "eaik.IK_Homogeneous",
            lambda m: with_eaik(m, chain, 6 if chain.name == "panda" else 2),
            f"one joint locked on a grid of {LOCKS}",
        ),
        "ssik": ("ssik", lambda m: with_ssik(m, chain), "closed forms, first solution"),
        "roboticstoolbox `ik_LM`": ("roboticstoolbox", lambda m: with_roboticstoolbox(m, chain), "tol 1e-13"),
        "OptIK": ("optik", lambda m: with_optik(m, chain, path), "tol_f 1e-14"),
        "TRAC-IK": ("pytracik", lambda m: with_trac_ik(m, chain, path), "eps 1e-6"),
    }
    for name, (module, make, remark) in makers.items():
        found = optional(module)
        if found is None:
            continue
        if name == "EAIK" and chain.dof == 6:
            continue
        try:
            jobs[name] = (make(found), remark)
        except Exception as error:  # a neighbour that cannot load the arm is a line, not the end
            print(f"skipped: {name} on {chain.name} ({type(error).__name__}: {error})")
    return jobs


def compare(chain: rd.Chain) -> list[list[str]]:
    """Rows of one arm."""
    poses = chain.forward(random_q(chain, POSES, seed=2))
    with tempfile.TemporaryDirectory() as folder:
        jobs = jobs_of(chain, folder)
        times: dict[str, list[float]] = {name: [] for name in jobs}
        cold: dict[str, list[float]] = {name: [] for name in jobs}
        good = dict.fromkeys(jobs, 0)
        for first in range(0, POSES, BLOCK):
            for name, (job, _) in jobs.items():
                job(poses[first])
                for pose in poses[first : first + BLOCK]:
                    q, seconds = timed(job, pose)
                    times[name].append(seconds)
                    good[name] += is_answer(chain, q, pose)
        for pose in poses[:COLD]:
            for name, (job, _) in jobs.items():
                cold[name].append(timed(job, pose)[1])
    rows = []
    for name, (_, remark) in jobs.items():
        median, tail = np.percentile(times[name], [50, 99])
        success = f"{100 * good[name] / POSES:.1f} %"
        between = time_text(np.median(cold[name]))
        rows.append([chain.name, name, success, time_text(median), time_text(tail), between, remark])
    return rows


def timed(job: Job, pose: Array) -> tuple[Any, float]:
    """An answer and the seconds that it took."""
    begin = time.perf_counter()
    q = job(pose)
    return q, time.perf_counter() - begin


def is_answer(chain: rd.Chain, q: Any, pose: Array) -> bool:
    """Within limits, and at the pose."""
    if q is None or len(q) != chain.dof or not np.isfinite(q).all():
        return False
    q = np.asarray(q, float)
    inside = (q >= chain.lower - 1e-9).all() and (q <= chain.upper + 1e-9).all()
    return bool(inside and np.abs(chain.forward(q) - pose).max() < TIGHT)


def batches() -> list[list[str]]:
    """Poses per second of `solve_batch`."""
    rows = []
    for name in ("iiwa14", "panda", "puma560"):
        chain = rd.catalog.load(name)
        poses = chain.forward(random_q(chain, BATCH, seed=3))
        for closed_form in (False, True):
            ik = rd.IkSolver(chain, closed_form=closed_form)
            if closed_form and not ik.closed_form:
                continue
            best, rate = float("inf"), 0.0
            for _ in range(5):
                begin = time.perf_counter()
                result = ik.solve_batch(poses)
                best = min(best, time.perf_counter() - begin)
                rate = float((result.status == "converged").mean())
            path = ik.closed_form or "numeric"
            rows.append([name, path, f"{100 * rate:.2f} %", f"{BATCH / best:,.0f} poses/s"])
    return rows


def main() -> None:
    """Print the tables."""
    rows = [row for name in ("iiwa14", "panda") for row in compare(rd.catalog.load(name))]
    print(table(HEAD, rows), "\n")
    print(table(("arm", "path", "success", "batch, best of 5"), batches()), "\n")
    print(machine())


if __name__ == "__main__":
    main()
