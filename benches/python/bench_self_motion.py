"""The closed form beside EAIK and ssik, and FK with the Jacobian beside pinocchio: one run, as a user calls them.

Prints a Markdown table. Times are medians; in every round each library has its turn, so compare the ratios.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import redundancy as rd

sys.path.insert(0, str(Path(__file__).parent))
from neighbours import (
    Array,
    axes_and_points,
    closure,
    machine,
    medians,
    optional,
    random_q,
    table,
    time_text,
)

POSES = 1_000
BATCH = 100_000
SWIVEL = 0.7
LOCKED = 0.4
"""Value of the third joint where a neighbour must lock one; its poses are made with it."""
TURN = 2 * np.pi
HEAD = ("arm", "job", "this library", "neighbour", "ratio", "success", "largest FK error", "remark")


class Comparison:
    """The rows of one arm."""

    def __init__(self, name: str, eaik: Any, ssik: Any, pinocchio: Any) -> None:
        self.chain = rd.catalog.load(name)
        self.arm = rd.SrsArm(self.chain)
        self.q = random_q(self.chain, POSES, seed=1)
        self.poses = self.chain.forward(self.q)
        self.rows: list[list[str]] = []
        self.limits = np.column_stack([self.chain.lower, self.chain.upper])
        self.ssik = None if ssik is None else self._ssik(ssik)
        self.eaik = None if eaik is None else self._eaik(eaik)
        self.pinocchio = pinocchio

    def _ssik(self, ssik: Any) -> Any:
        axes, points, tool = axes_and_points(self.chain)
        transforms = np.tile(np.eye(4), (8, 1, 1))
        transforms[:7, :3, 3] = np.diff(points, axis=0, prepend=0.0)
        transforms[7] = tool
        transforms[7, :3, 3] -= points[6]
        return ssik.Manipulator.from_transforms(transforms, axes, limits=self.limits)

    def _eaik(self, eaik: Any) -> Any:
        axes, points, tool = axes_and_points(self.chain)
        frames = np.tile(np.eye(4), (8, 1, 1))
        for frame, z, point in zip(frames[:7], axes, points, strict=True):
            x = np.roll(z, 1)
            frame[:3, :3] = np.column_stack([x, np.cross(z, x), z])
            frame[:3, 3] = point
        frames[7] = tool
        return eaik.HomogeneousRobot(frames, fixed_axes=[(2, LOCKED)])

    def row(
        self,
        job: str,
        seconds: dict[str, float],
        *,
        success: str = "",
        error: str = "",
        remark: str = "",
        rate: int = 0,
    ) -> None:
        """One line: the first entry of `seconds` is this library, a second one the neighbour."""
        (ours, *theirs) = seconds.items()
        text = (lambda s: f"{rate / s / 1e6:.3g} million/s") if rate else time_text
        name, other = theirs[0] if theirs else ("", 0.0)
        self.rows.append(
            [
                self.chain.name,
                job,
                text(ours[1]),
                f"{name} {text(other)}" if theirs else "-",
                f"{other / ours[1]:.1f}" if theirs else "-",
                success,
                error,
                remark,
            ]
        )

    def run(self) -> list[list[str]]:
        """Every job."""
        self.branches_at_a_swivel()
        self.self_motion_object()
        self.intervals()
        self.best()
        self.nearest()
        self.batches()
        self.kinematics()
        return self.rows

    def ours_at(self, limits: bool) -> tuple[Callable[[int], object], float, float]:
        """The job, its success rate and its FK error."""
        arm, poses, swivels = self.arm, self.poses, np.asarray(self.arm.swivel(self.q))
        found, error = 0, 0.0
        for pose, s, q in zip(poses, swivels, self.q, strict=True):
            rows = arm.solve(pose, s, limits=limits)
            error = max(error, closure(self.chain, rows, pose))
            found += bool((np.abs(rows - q).max(axis=1) < 1e-6).any()) if len(rows) else 0
        return lambda i: arm.solve(poses[i], SWIVEL, limits=limits), found / POSES, error

    def branches_at_a_swivel(self) -> None:
        """Eight branches at one swivel; success: the configuration that made the pose is among them."""
        free, found, error = self.ours_at(limits=False)
        jobs = {"ours": free}
        success, errors, remark = f"{found:.1%}", f"{error:.0e}", ""
        if self.eaik is not None:
            made = self.q.copy()
            made[:, 2] = LOCKED
            locked = np.asfortranarray(self.chain.forward(made))
            list_of = [np.asfortranarray(pose) for pose in locked]
            robot = self.eaik
            jobs["EAIK"] = lambda i: robot.IK(list_of[i])
            hits, worst = 0, 0.0
            for pose, q in zip(locked, made, strict=True):
                rows = np.atleast_2d(np.asarray(robot.IK(pose).Q))
                hits += bool((np.abs((rows - q + np.pi) % TURN - np.pi).max(axis=1) < 1e-6).any())
                worst = max(worst, closure(self.chain, rows, pose))
            success, errors = f"{success} / {hits / POSES:.1%}", f"{errors} / {worst:.0e}"
            remark = "EAIK: third joint locked, no swivel"
        self.row(
            "8 branches at a swivel, limits off",
            medians(jobs, POSES),
            success=success,
            error=errors,
            remark=remark,
        )
        if self.ssik is not None:
            ssik, poses = self.ssik, self.poses
            charts = [ssik.self_motion(pose).charts for pose in poses]
            worst = max(
                closure(self.chain, np.stack([c.q(SWIVEL) for c in chart]), pose)
                for pose, chart in zip(poses, charts, strict=True)
            )
            eight = sum(len(chart) == 8 for chart in charts) / POSES
            jobs = {"ours": free, "ssik": lambda i: [c.q(SWIVEL) for c in ssik.self_motion(poses[i]).charts]}
            self.row(
                "the same",
                medians(jobs, POSES),
                success=f"{found:.1%} / {eight:.1%}",
                error=f"{error:.0e} / {worst:.0e}",
                remark="ssik: self_motion, then q(t) on every chart; success: eight charts",
            )
        held, found, error = self.ours_at(limits=True)
        self.row(
            "8 branches at a swivel, limits on",
            medians({"ours": held}, POSES),
            success=f"{found:.1%}",
            error=f"{error:.0e}",
        )

    def self_motion_object(self) -> None:
        """The circle of solutions, nothing asked of it."""
        arm, poses, ssik = self.arm, self.poses, self.ssik
        jobs: dict[str, Callable[[int], object]] = {"ours": lambda i: arm.self_motion(poses[i])}
        if ssik is not None:
            jobs["ssik"] = lambda i: ssik.self_motion(poses[i])
        self.row("self-motion object", medians(jobs, POSES))

    def intervals(self) -> None:
        """In-limit arcs of all branches, the object included; success: total length as the neighbour finds it."""
        arm, poses, ssik = self.arm, self.poses, self.ssik

        def ours(i: int) -> list[Array]:
            return [b.intervals() for b in arm.self_motion(poses[i]).branches]

        jobs: dict[str, Callable[[int], object]] = {"ours": ours}
        success = remark = ""
        if ssik is not None:

            def theirs(i: int) -> list[Any]:
                return [c.in_limits() for c in ssik.self_motion(poses[i]).charts]

            jobs["ssik"] = theirs
            checked = range(0, POSES, 10)
            same = [
                abs(
                    sum(float(np.diff(a).sum()) for a in ours(i))
                    - sum(hi - lo for arcs in theirs(i) for lo, hi in arcs)
                )
                < 1e-6
                for i in checked
            ]
            success = f"{np.mean(same):.1%} agree"
            remark = f"total length within 1e-6 rad over {len(same)} poses"
        self.row("exact intervals of 8 branches", medians(jobs, POSES), success=success, remark=remark)
        assert remark or ours(0)

    def _ssik_samples(self, i: int, n: int) -> Array:
        arcs = [(c, arc) for c in self.ssik.self_motion(self.poses[i]).charts for arc in c.in_limits()]
        if not arcs:
            return np.empty((0, 7))
        rows = np.vstack([c.q(np.linspace(lo, hi, n)) for c, (lo, hi) in arcs])
        return np.asarray((rows + np.pi) % TURN - np.pi)

    def best(self) -> None:
        """Least distance from mid-range over all branches; the neighbour samples its arcs."""
        arm, poses, criterion = self.arm, self.poses, rd.JointRange(self.chain)
        jobs: dict[str, Callable[[int], object]] = {
            "ours": lambda i: arm.self_motion(poses[i]).best(criterion)
        }
        found = [arm.self_motion(pose).best(criterion) for pose in poses]
        q = np.array([choice.q for choice in found if choice.q is not None])
        error = f"{closure(self.chain, q, poses[[c.q is not None for c in found]]):.0e}"
        success, remark = f"{len(q) / POSES:.1%}", ""
        if self.ssik is not None:
            middle, width = self.limits.mean(axis=1), self.limits[:, 1] - self.limits[:, 0]

            def theirs(i: int) -> float:
                rows = self._ssik_samples(i, 21)
                return float((((rows - middle) / width) ** 2).sum(axis=1).min(initial=np.inf) / 14)

            jobs["ssik, 21 samples per arc"] = theirs
            checked = range(0, POSES, 10)
            values = [found[i].value for i in checked]
            worse = [theirs(i) / v - 1 for i, v in zip(checked, values, strict=True) if v is not None]
            remark = (
                f"its best is worse by {np.median(worse):.1%} (median), {max(worse):.0%} (largest); "
                f"least difference {min(worse):+.0e}"
            )
        self.row("best by JointRange", medians(jobs, POSES), success=success, error=error, remark=remark)

    def nearest(self) -> None:
        """The configuration over the pose nearest to one that is 0.3 rad away in each joint at most."""
        arm, poses, ssik = self.arm, self.poses, self.ssik
        rng = np.random.default_rng(2)
        seeds = np.clip(self.q + rng.uniform(-0.3, 0.3, self.q.shape), *self.limits.T)
        found = np.array([arm.nearest(pose, seed) for pose, seed in zip(poses, seeds, strict=True)])
        distance = np.linalg.norm(found - seeds, axis=1)
        jobs: dict[str, Callable[[int], object]] = {"ours": lambda i: arm.nearest(poses[i], seeds[i])}
        error, success = f"{closure(self.chain, found, poses):.0e}", f"{len(found) / POSES:.1%}"
        remark = f"distance {np.median(distance):.2f} rad (median)"
        if ssik is not None:

            def theirs(i: int) -> Any:
                return ssik.solve(poses[i], q_seed=seeds[i], max_solutions=1, seed_metric="wrap_l2")

            jobs["ssik solve"] = theirs
            answers = {i: np.asarray(rows[0].q) for i in range(0, POSES, 10) if (rows := theirs(i))}
            index = list(answers)
            rows = np.array(list(answers.values()))
            success += f" / {len(rows) / (POSES // 10):.1%}"
            error += f" / {closure(self.chain, rows, poses[index]):.0e}"
            theirs_away = np.linalg.norm(rows - seeds[index], axis=1)
            remark += f"; ssik samples the swivel: {np.median(theirs_away):.2f} rad"
            remark += f", nearer in {np.mean(theirs_away < distance[index] - 1e-9):.0%}"
        self.row(
            "nearest to a configuration", medians(jobs, POSES), success=success, error=error, remark=remark
        )

    def batches(self) -> None:
        """Many poses into arrays that are there already."""
        arm = self.arm
        made = random_q(self.chain, BATCH, seed=3)
        made[:, 2] = LOCKED
        poses = self.chain.forward(made)
        swivels = np.asarray(arm.swivel(made))
        out = (np.empty((BATCH, 8, 7)), np.empty((BATCH, 8), dtype=bool))
        for limits in (False, True):
            arm.solve_batch(poses, swivels, limits=limits, out=out)
            hit = (np.abs((out[0] - made[:, None] + np.pi) % TURN - np.pi).max(axis=2) < 1e-6) & out[1]
            rows = out[0][out[1]]
            owner = np.repeat(np.arange(BATCH), out[1].sum(axis=1))
            error = f"{closure(self.chain, rows[:80_000], poses[owner[:80_000]]):.0e}"
            success = f"{hit.any(axis=1).mean():.1%}"
            jobs: dict[str, Callable[[int], object]] = {
                "ours": lambda _, limits=limits: arm.solve_batch(poses, swivels, limits=limits, out=out)
            }
            remark = ""
            seconds = medians(jobs, 3)
            if self.eaik is not None and not limits:
                some, run = BATCH // 10, self.eaik.IK_batched
                times = medians({"EAIK": lambda _, run=run, few=poses[:some]: run(few, 2)}, 1)
                seconds["EAIK"] = times["EAIK"] * (BATCH / some)
                remark = "EAIK: 2 threads, third joint locked"
            word = "on" if limits else "off"
            self.row(
                f"batch of {BATCH:_} x 8 branches, limits {word}".replace("_", " "),
                seconds,
                success=success,
                error=error,
                remark=remark,
                rate=BATCH,
            )

    def kinematics(self) -> None:
        """Tool pose and Jacobian in one pass."""
        chain, q, pin = self.chain, self.q, self.pinocchio
        jobs: dict[str, Callable[[int], object]] = {"ours": lambda i: chain.kinematics(q[i])}
        error = ""
        if pin is not None:
            axes, points, tool = axes_and_points(chain)
            model, parent, before = pin.Model(), 0, np.zeros(3)
            for i, (axis, point) in enumerate(zip(axes, points, strict=True)):
                place = pin.SE3(np.eye(3), point - before)
                parent = model.addJoint(parent, pin.JointModelRevoluteUnaligned(axis), place, f"j{i}")
                before = point
            place = pin.SE3(tool[:3, :3], tool[:3, 3] - before)
            frame = model.addFrame(pin.Frame("tool", parent, place, pin.FrameType.OP_FRAME))
            data, axes_of = model.createData(), pin.LOCAL_WORLD_ALIGNED

            def theirs(i: int) -> tuple[Any, Array]:
                jacobian = pin.computeFrameJacobian(model, data, q[i], frame, axes_of)
                return pin.updateFramePlacement(model, data, frame), jacobian

            jobs["pinocchio"] = theirs
            apart = 0.0
            for i in range(POSES):
                (pose, jacobian), (placed, other) = chain.kinematics(q[i]), theirs(i)
                apart = max(apart, np.abs(pose - placed.homogeneous).max(), np.abs(jacobian - other).max())
            error = f"{apart:.0e} between the two"
        self.row("FK and Jacobian, `kinematics(q)`", medians(jobs, POSES), error=error)


def main() -> None:
    """Measure and print."""
    eaik, ssik, pin = optional("eaik.IK_Homogeneous"), optional("ssik"), optional("pinocchio")
    rows = []
    for name in ("iiwa14", "pa10"):
        rows += Comparison(name, eaik, ssik, pin).run()
    print(table(HEAD, rows))
    print(f"\nMedians of one run of `python benches/python/bench_self_motion.py`; {machine()}.")


if __name__ == "__main__":
    main()
