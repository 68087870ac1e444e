"""What the explorer shows along a path: plans, a time, strips and the map of the spare coordinate; no browser."""

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import redundancy as rd
from redundancy.explorer.arm import Array
from redundancy.explorer.model import RefusedError, finite
from redundancy.explorer.pictures import shown, within_turn

MAP_COLUMNS = 90
"""Points of the path that the map shows at most."""
MAP_SAMPLES = 181
"""Values of the spare coordinate that are tried where the allowed ones have no closed form."""
STRIP_POINTS = 300
"""Points of a strip at most."""
SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0)
"""Choices of the speed of playing."""


class Line:
    """A plan that is shown: where the arm is at a time, and curves over the time.

    Args:
        chain: The arm.
        plan: With at least one row.
        name: What it is called.
    """

    def __init__(self, chain: rd.Chain, plan: rd.Plan, name: str) -> None:
        if not len(plan):
            raise RefusedError(f"{name} has no rows: {plan.reason or plan.status}")
        if plan.q.shape[1] != chain.dof:
            raise RefusedError(f"{name} has {plan.q.shape[1]} joints, the arm {chain.dof}")
        self.chain, self.plan, self.name = chain, plan, name
        self.t, self.q = plan.t, plan.q
        self.continuous = not plan.reconfigurations

    @property
    def duration(self) -> float:
        """From the first row to the last, s."""
        return float(self.t[-1] - self.t[0])

    def at(self, time: float) -> Array:
        """The configuration `time` seconds after the first row; between rows of a jump, the row before it."""
        t = float(np.clip(self.t[0] + time, self.t[0], self.t[-1]))
        if self.continuous and len(self.t) > 1:
            now: Array = self.plan.sample(t)[0]
            return now
        row: Array = self.q[self.row(time)]
        return row

    def row(self, time: float) -> int:
        """The last row that is not after `time` seconds."""
        t = self.t[0] + time
        return int(np.clip(np.searchsorted(self.t, t + 1e-12, side="right") - 1, 0, len(self.t) - 1))

    def speeds(self) -> Array | None:
        """The largest joint speed of each row as a share of its limit `(N,)`; None without limits."""
        limits = self.chain.velocity_limit
        bounded = np.isfinite(limits)
        if not bounded.any() or len(self.t) < 2:
            return None
        out: Array = (np.abs(self.plan.qd[:, bounded]) / limits[bounded]).max(axis=1)
        return out

    def torques(self) -> Array | None:
        """The largest joint torque of each row as a share of its limit `(N,)`; None without limits or inertias."""
        limits = self.chain.effort_limit
        bounded = np.isfinite(limits)
        if not bounded.any() or len(self.t) < 2:
            return None
        accelerations = self.plan.qdd
        if accelerations is None:
            if not self.continuous:
                return None
            accelerations = self.plan.sample(self.t)[2]
        try:
            torques = self.chain.inverse_dynamics(self.q, self.plan.qd, accelerations)
        except rd.RedundancyError:  # no inertias in the description
            return None
        out: Array = (np.abs(torques[:, bounded]) / limits[bounded]).max(axis=1)
        return out

    def clearance(self) -> Array | None:
        """The least distance of each row from obstacles and from itself, m; None where nothing was near."""
        rows = [v for v in (self.plan.clearance, self.plan.self_clearance) if v is not None]
        if not rows:
            return None
        out = np.minimum.reduce(rows)
        return out if np.isfinite(out).any() else None


class PathModel:
    """A path, one or two plans along it, and a time.

    Args:
        chain: The arm.
        path: The path; a plan alone brings its own poses.
        plans: Plans, or none.
        scene: Obstacles of new plans.
        links: Shapes of the links of new plans.
        freedom: Of the tool, in new plans.
        task: Of new plans.
    """

    def __init__(
        self,
        chain: rd.Chain,
        path: rd.Path | None,
        plans: Sequence[rd.Plan] = (),
        links: rd.LinkGeometry | None = None,
        freedom: rd.ToolFreedom | None = None,
        task: str | None = None,
    ) -> None:
        self.chain, self.path = chain, path
        self.links, self.freedom, self.task = links, freedom, task
        self.lines = [Line(chain, plan, f"plan {k + 1}") for k, plan in enumerate(plans)]
        self.form: Any = rd.closed_form(chain) if task is None else None
        self.time, self.speed = 0.0, 1.0
        self._map: tuple[str, Array, list[list[tuple[float, float]]]] | None = None

    @property
    def duration(self) -> float:
        """Of the longest plan, s."""
        return max((line.duration for line in self.lines), default=0.0)

    def set_time(self, time: float) -> None:
        """Show a time, s after the first row."""
        self.time = float(np.clip(finite(time, (), "the time"), 0.0, self.duration))

    def advance(self, seconds: float) -> bool:
        """Let time pass at the chosen speed; False at the end."""
        self.set_time(self.time + seconds * self.speed)
        return self.time < self.duration

    def set_speed(self, speed: float) -> None:
        """Seconds of the plan per second."""
        self.speed = checked_speed(speed)

    def replan(
        self, scene: rd.Scene | None, progress: Callable[[float], object] | None = None, **options: Any
    ) -> rd.Plan:
        """A new plan of the path; it is not shown before `take`."""
        if self.path is None:
            raise RefusedError("there is no path to plan: give one with path=")
        return rd.plan(
            self.chain,
            self.path,
            self.freedom,
            task=self.task,
            scene=scene,
            links=self.links,
            progress=progress,
            **options,
        )

    def take(self, plan: rd.Plan, keep: bool = False) -> None:
        """Show a plan: instead of the first one, which stays beside it with `keep`."""
        line = Line(self.chain, plan, "new plan" if self.lines else "plan 1")
        before = self.lines[:1] if keep else []
        self.lines = [line, *before]
        self._map = None
        self.set_time(min(self.time, self.duration))

    # --- what is drawn ------------------------------------------------------------------------------------

    @property
    def poses(self) -> Array:
        """The poses of the path `(N, 4, 4)`; those of the first plan without a path."""
        if self.path is not None:
            return self.path.poses
        if not self.lines:
            return np.zeros((0, 4, 4))
        return self.chain.forward(self.lines[0].q)

    @property
    def lengths(self) -> Array:
        """Length along the path of each row of the first plan, m."""
        line = self.lines[0]
        own = line.plan.s
        if own is not None and len(own) == len(line.q):
            return np.asarray(own)
        steps = np.linalg.norm(np.diff(self.chain.forward(line.q)[:, :3, 3], axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def spare_of(self, line: Line) -> tuple[str, Array] | None:
        """The spare coordinate of a plan: its name and values `(N,)`, rad."""
        name = getattr(self.form, "parameter", None)
        if name == "swivel":
            return name, np.asarray(self.form.swivel(line.q))
        if name == "q7":
            return name, line.q[:, -1]
        if line.plan.spin is not None and float(np.ptp(line.plan.spin)) > 0.0:
            return "spin", line.plan.spin
        return None

    def spare_map(self) -> tuple[str, Array, list[list[tuple[float, float]]]] | None:
        """What the joint limits allow of the spare coordinate along the first plan.

        Returns:
            Its name, lengths `(M,)` of the points that are shown, and per point the allowed parts of [-pi, pi];
            None for arms without a closed form, or without a spare coordinate.
        """
        if self._map is not None or not self.lines or self.form is None:
            return self._map
        line = self.lines[0]
        spare = self.spare_of(line)
        if spare is None:
            return None
        rows = shown(len(line.q), MAP_COLUMNS)
        poses = self.chain.forward(line.q[rows])
        find = {"swivel": self._swivels, "q7": self._last_joint}.get(spare[0])
        if find is not None:
            columns = [find(pose, q) for pose, q in zip(poses, line.q[rows], strict=True)]
        else:
            turns = np.asarray(spare[1])[rows]
            columns = [self._spins(pose, float(now)) for pose, now in zip(poses, turns, strict=True)]
        self._map = (spare[0], self.lengths[rows], columns)
        return self._map

    def _swivels(self, pose: Array, q: Array) -> list[tuple[float, float]]:
        """Exact arcs of the plan's branch."""
        index = sum(w for w, sign in zip((4, 2, 1), self.form.branch(q), strict=True) if sign < 0)
        pieces = rd.solutions(self.form, pose).pieces
        return within_turn(pieces[index].intervals(), True) if index < len(pieces) else []

    def _last_joint(self, pose: Array, q: Array) -> list[tuple[float, float]]:
        """Values of joint 7 on the arcs of the plan's piece: between neighbouring samples of an arc."""
        found = rd.solutions(self.form, pose).nearest(q)
        if found.piece is None:
            return []
        parts = []
        for low, high in found.piece.intervals():
            values = np.asarray(found.piece.parameter(np.linspace(low, high, MAP_SAMPLES // 3)))
            parts += [(float(min(a, b)), float(max(a, b))) for a, b in itertools.pairwise(values)]
        return merged(parts)

    def _spins(self, pose: Array, now: float) -> list[tuple[float, float]]:
        """Spins at which any configuration holds the limits, by samples; `pose` is at the spin `now`."""
        freedom = self.freedom or rd.ToolFreedom(0.0, "free")
        axis = np.asarray(freedom.axis, dtype=float)
        angles = np.linspace(-np.pi, np.pi, MAP_SAMPLES)
        turns = rd.quaternion.to_matrix(
            np.array([rd.quaternion.from_axis_angle(axis, a - now) for a in angles])
        )
        poses = np.tile(pose, (len(angles), 1, 1))
        poses[:, :3, :3] = pose[:3, :3] @ turns
        good = self.form.solve_batch(poses).valid.any(axis=1)
        half = 0.5 * (angles[1] - angles[0])
        return merged([(float(a - half), float(a + half)) for a in angles[good]])

    def words(self) -> str:
        """What the plans are, in a sentence each."""
        if not self.lines:
            return "no plan yet: press plan" if self.path is not None else "no path: give one with path="
        return "; ".join(
            f"{line.name}: {line.plan.status}, {line.duration:.2f} s, {len(line.q)} rows"
            + (f", {line.plan.reason}" if line.plan.reason else "")
            for line in self.lines
        )


def checked_speed(speed: Any) -> float:
    """Seconds of a plan per second."""
    value = float(finite(speed, (), "the speed"))
    if not 0.0 < value <= SPEEDS[-1]:
        raise RefusedError(f"the speed is {value}, it must be above 0 and at most {SPEEDS[-1]}")
    return value


def merged(parts: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Intervals that overlap or touch, as one."""
    out: list[tuple[float, float]] = []
    for low, high in sorted(parts):
        if out and low <= out[-1][1] + 1e-12:
            out[-1] = (out[-1][0], max(out[-1][1], high))
        else:
            out.append((low, high))
    return out
