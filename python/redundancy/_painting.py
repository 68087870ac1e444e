"""What `redundancy paint` does: measure rules, plan, write. Needs the extra `cli`."""

import base64
import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from html import escape as html
from io import BytesIO
from pathlib import Path as File
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import redundancy as rd
from redundancy import _motion, orientation_rules, plot_painting

RULES = (
    "constant",
    "pointing",
    "tilt_square",
    "tilt_disc",
    "barrier_cone",
    "barrier_two_cones",
    "barrier_spin",
)
PLAN = "plan"
PICTURES = ("speeds.png", "torques.png", "orientation.png", "path.png")
# What `paint` leaves behind.
RESULTS = ("trajectory.csv", "trajectory.json", "summary.json", "report.html", *PICTURES)


@dataclass
class Choice:
    """One line of the table."""

    name: str
    speed: float | None = None
    gain: float | None = None
    limit: str = ""
    at: str = ""
    reason: str = ""


@dataclass
class Painted:
    """The motion that is written."""

    name: str
    speed: float
    s: NDArray[np.float64]
    poses: NDArray[np.float64]
    torques: NDArray[np.float64]
    trajectory: rd.Trajectory
    tilt: NDArray[np.float64]
    spin: NDArray[np.float64]


@dataclass
class Job:
    """One run of `paint`."""

    chain: rd.Chain
    robot: str
    path_file: File
    out: File
    rules: tuple[str, ...]
    angle: float
    half_angle: float
    spin: str | float = "free"
    plan: bool = False
    torque_limits: Any = "chain"
    torque_margin: float = 0.0
    velocity_limits: Any = None
    joint_limits: bool = True
    max_rate: float | None = None
    time_limit: float = 60.0
    plots: bool = True
    progress: Callable[[float, float], object] | None = None
    choices: list[Choice] = field(default_factory=list)
    best: Painted | None = None
    constant: rd.MaxSpeed | None = None
    summary: dict[str, Any] = field(default_factory=dict)

    def run(self) -> list[str]:
        """Measure, plan, write; the names of the files."""
        begin = time.perf_counter()
        path = rd.Path.from_csv(self.path_file)
        # Rules and plan refer to the orientation that a tool without freedom has at the start.
        self.base = path.poses[0, :3, :3] if path.has_orientation else np.diag([-1.0, 1.0, -1.0])
        self.out.mkdir(parents=True, exist_ok=True)
        for name in RESULTS:  # nothing of an earlier run may stand beside the new summary
            (self.out / name).unlink(missing_ok=True)
        failures: list[rd.RedundancyError] = []
        for name in self.rules:
            self._rule(path, name, failures)
        if self.plan:
            self._plan(path)
        self.summary = {
            "robot": self.chain.name,
            "robot_source": self.robot,
            "path": str(self.path_file),
            "points": len(path),
            "length_m": path.length,
            "tool": self.chain.tool.tolist(),
            "half_angle_rad": self.half_angle,
            "rule_angle_rad": self.angle,
            "spin": self.spin,
            "torque_margin": self.torque_margin,
            "joint_limits": self.joint_limits,
            "status": "converged" if self.best else "infeasible",
            "choices": [vars(choice) for choice in self.choices],
            **self.summary,
        }
        if self.best is None:
            self.summary["reason"] = self.choices[-1].reason
            self._write_summary()
            if failures and not any(isinstance(error, rd.CannotFollowError) for error in failures):
                raise failures[0]
            raise rd.CannotFollowError(self.choices[-1].reason)
        motion, slower, timing = _motion.at_constant_speed(
            self.chain, self.best.trajectory, self.velocity_limits is not None
        )
        # Rules and plan find the speed that torques and velocities allow; accelerations may allow less.
        speed = self.best.speed / slower
        self.summary |= {"written": self.best.name, "speed_m_s": speed, "timing": timing}
        _motion.write_csv(motion, self.out / "trajectory.csv")
        motion.to_json(self.out / "trajectory.json")
        written = ["trajectory.csv", "trajectory.json", "summary.json"]
        self.summary["seconds"] = time.perf_counter() - begin
        self._write_summary()
        if self.plots:
            written += self._draw()
        return written

    def _limits(self) -> Any:
        if self.torque_limits is None:
            return None
        limits = self.chain.effort_limit if isinstance(self.torque_limits, str) else self.torque_limits
        return np.asarray(limits) * (1.0 - self.torque_margin)

    def _rule(self, path: rd.Path, name: str, failures: list[rd.RedundancyError]) -> None:
        make = getattr(orientation_rules, name)
        choice = Choice(name)
        self.choices.append(choice)
        constants: dict[str, Any] = {"orientation": self.base}
        if name.startswith("tilt"):
            constants["angle"] = self.angle
        elif name.startswith("barrier"):
            constants |= {"beta": self.half_angle, "alpha": self.half_angle}
        try:
            rule = make(**constants)
            found = rd.max_speed(
                self.chain,
                path,
                rule,
                torque_limits=self._limits(),
                velocity_limits=self.velocity_limits,
                joint_limits=self.joint_limits,
            )
        except rd.RedundancyError as error:
            choice.reason = str(error)
            failures.append(error)
            return
        if name == "constant":
            self.constant = found
        self._note(choice, found.speed, found.limiting_joint_name, found.limit, path.s[found.at])
        if self.best is None or found.speed > self.best.speed:
            poses = path.poses
            poses[:, :3, :3] = rule(poses[:, :3, 3])
            s = path.s
            moving = np.r_[True, np.diff(s) > 0]
            t = (s - s[0])[moving] / found.speed
            trajectory = rd.Trajectory(self.chain.joint_names, t, found.q[moving])
            tilt, spin = self._tilt_spin(poses)
            self.best = Painted(name, found.speed, s, poses, found.torques, trajectory, tilt, spin)

    def _plan(self, path: rd.Path) -> None:
        choice = Choice(PLAN)
        self.choices.append(choice)
        plan = rd.plan_orientation(
            self.chain,
            path,
            self.half_angle,
            self.spin,  # type: ignore[arg-type]
            torque_limits=self.torque_limits,
            torque_margin=self.torque_margin,
            velocity_limits=self.velocity_limits,
            joint_limits=self.joint_limits,
            max_rate=self.max_rate,
            time_limit=self.time_limit,
            progress=self.progress,
        )
        self.summary["plan"] = {
            "status": str(plan.status),
            "reason": plan.reason,
            "speed_m_s": plan.speed,
            "rows": len(plan),
            "starts": plan.starts,
            "steps": plan.steps,
        }
        choice.reason = plan.reason
        if len(plan) == 0:
            return
        joint = plan.limiting_joint_name or "tool orientation"
        self._note(choice, plan.speed, joint, plan.limit, plan.s[plan.at])
        # Asked for, so written; `plan` starts from what the rules do, and is slower only when stopped at once.
        tilt, spin = np.linalg.norm(plan.tilt, axis=1), plan.spin
        self.best = Painted(PLAN, plan.speed, plan.s, plan.poses, plan.torques, plan, tilt, spin)

    def _note(self, choice: Choice, speed: float, joint: str, limit: str, s: float) -> None:
        choice.speed = speed
        choice.gain = speed / self.constant.speed if self.constant else None
        choice.limit, choice.at = f"{limit} of {joint}", f"{s:.3f} m"

    def _tilt_spin(self, poses: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Angle of the tool axis against the base's, and the twist that is left about it."""
        r = self.base.T @ poses[:, :3, :3]
        tilt = np.arctan2(np.hypot(r[:, 0, 2], r[:, 1, 2]), r[:, 2, 2])
        spin = np.arctan2(r[:, 1, 0] - r[:, 0, 1], r[:, 0, 0] + r[:, 1, 1])
        return tilt, np.unwrap(spin)

    def _write_summary(self) -> None:
        text = json.dumps(self.summary, indent=2, allow_nan=False)
        (self.out / "summary.json").write_text(text + "\n")

    def _draw(self) -> list[str]:
        best = self.best
        assert best is not None
        done = [choice for choice in self.choices if choice.speed is not None]
        limits = self._limits()
        limits = np.full(self.chain.dof, np.inf) if limits is None else limits
        before = None
        if self.constant is not None and best.name != "constant":
            length = len(self.constant.torques)
            before = (np.linspace(best.s[0], best.s[-1], length), self.constant.torques)
        figures = {
            "speeds.png": plot_painting.speeds([c.name for c in done], np.array([c.speed for c in done])),
            "torques.png": plot_painting.torques(
                best.s, best.torques, limits, self.chain.joint_names, before
            ),
            "orientation.png": plot_painting.orientation(best.s, best.tilt, best.spin, self.half_angle),
            "path.png": plot_painting.path_from_above(best.poses[:, :3, 3], best.poses[:, :3, 2]),
        }
        pictures: dict[str, bytes] = {}
        for name, figure in figures.items():
            pictures[name] = _png(figure)
            (self.out / name).write_bytes(pictures[name])
        (self.out / "report.html").write_text(self._report(pictures), encoding="utf-8")
        return ["report.html", *figures]

    def _report(self, pictures: dict[str, bytes]) -> str:
        rows = "".join(
            "<tr>" + "".join(f"<td>{html(cell)}</td>" for cell in cells(choice)) + "</tr>"
            for choice in self.choices
        )
        images = "".join(
            f'<figure><img alt="{html(name)}" src="data:image/png;base64,{base64.b64encode(data).decode()}">'
            f"<figcaption>{html(CAPTIONS[name])}</figcaption></figure>"
            for name, data in pictures.items()
        )
        head = "".join(f"<th>{html(title)}</th>" for title in HEADER)
        best = self.best
        assert best is not None
        what = (
            f"{len(best.s)} rows, {self.summary['length_m']:.3f} m in {best.trajectory.t[-1]:.3f} s at "
            f"{best.speed:.4f} m/s ({html(best.name)})"
        )
        return _PAGE.format(
            title=html(f"{self.chain.name} paints {self.path_file.name}"),
            what=what,
            head=head,
            rows=rows,
            images=images,
        )


HEADER = ("orientation", "speed (m/s)", "gain", "limited by", "at", "remark")
CAPTIONS = {
    "speeds.png": "Highest constant tool speed.",
    "torques.png": "Torques of the written motion (blue) against their limits (dashed), and those of the constant "
    "orientation at its own highest speed (grey).",
    "orientation.png": "Tilt against the cone (dashed), and spin about the tool axis.",
    "path.png": "The path from above.",
}


def cells(choice: Choice) -> tuple[str, ...]:
    """A line of the table as text."""
    speed = "-" if choice.speed is None else f"{choice.speed:.4f}"
    gain = "-" if choice.gain is None else f"x{choice.gain:.3f}"
    return choice.name, speed, gain, choice.limit, choice.at, choice.reason


def _png(figure: Figure) -> bytes:
    buffer = BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return buffer.getvalue()


_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<style>
body {{ font: 15px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #222; }}
table {{ border-collapse: collapse; width: 100%; }}
th, td {{ text-align: left; padding: .3rem .7rem; border-bottom: 1px solid #ddd; }}
img {{ max-width: 100%; }}
figure {{ margin: 2rem 0; }}
figcaption {{ color: #666; }}
</style></head>
<body><h1>{title}</h1><p>{what}</p>
<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>
{images}
</body></html>
"""
