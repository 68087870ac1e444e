"""Where the base should stand: coarse by the margins of the points, exact by the planner, best bound first."""

import json
import math
import os
import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from redundancy import _core
from redundancy._core import RedundancyError
from redundancy.maps._metrics import metrics
from redundancy.maps._progress import Progress, Report
from redundancy.maps._store import chain_to_text, differences, digest, import_zarr, locked
from redundancy.status import Status

__all__ = ["Placement", "PlacementJob", "place"]

FORMAT = 1
SCREENED = 40
"""Points of the path that every placement is screened by."""
BATCH = 64
"""Placements that one task screens."""
KEPT = 10
"""Placements that are wanted: planning ends when no other one can be among them."""
REASON = 600
"""Bytes of a reason in the store."""
STATUSES = tuple(Status)


@dataclass(frozen=True)
class Placement:
    """One place of the base and what the arm can do from there."""

    base: NDArray[np.float64]
    """Pose `(4, 4)` for `chain.with_base`."""
    xyz_yaw: tuple[float, float, float, float]
    """Shift (m) and turn about the world's z axis (rad) of the chain's own base."""
    status: Status | None
    """Of the plan; `unreachable` or `limits` where a point already rules the placement out. `None`: not planned,
    because its bound cannot be among the best."""
    margin: float
    """Least distance from a joint limit along the plan, rad or m; what it is at most where there is no plan."""
    clearance: float
    """Least distance from the scene along the plan, m; `inf` without one."""
    travel: float
    """Length of the plan in joint space, rad or m."""
    duration: float
    """Time of the plan, s; 0 without times."""
    reason: str
    """Why it is not possible, or not planned; empty otherwise."""


@dataclass(frozen=True)
class PlacementJob:
    """All placements, best first."""

    path: Path
    status: Status
    placements: list[Placement]
    planned: int
    """Calls of the planner, those of earlier calls that were resumed included."""
    best: list[Placement] = field(default_factory=list)
    """Those that can follow the path, at most ten."""


@dataclass(frozen=True)
class _Question:
    """What a worker needs to judge a placement."""

    chain: _core.Chain
    path: _core.Path | None
    poses: NDArray[np.float64]
    freedom: _core.ToolFreedom | None
    options: dict[str, Any]

    def bounds(self, shifts: Sequence[tuple[float, float, float, float]], threads: int | None) -> list[Any]:
        """For each placement the least of the best margins of the points, and the point where it is."""
        count = len(self.poses)
        index = np.unique(np.linspace(0, count - 1, min(count, SCREENED)).round().astype(int))
        seen = np.concatenate([np.linalg.inv(_shift(s)) @ self.poses[index] for s in shifts])
        margin = metrics(self.chain, seen, ["margin"], self.freedom, threads=threads)["margin"]
        rows = margin.reshape(len(shifts), len(index))
        worst = rows.argmin(axis=1)
        return [(float(row[k]), int(index[k])) for row, k in zip(rows, worst, strict=True)]

    def judge(self, shift: tuple[float, float, float, float]) -> dict[str, Any]:
        """The verdict of the planner."""
        if self.path is None:
            found = metrics(self.chain, np.linalg.inv(_shift(shift)) @ self.poses, ["margin"], self.freedom)[
                "margin"
            ]
            worst = int(found.argmin())
            return _verdict(float(found[worst]), worst, Status.CONVERGED)
        plan = _core.plan(
            self.chain.with_base(_shift(shift) @ self.chain.base), self.path, self.freedom, **self.options
        )
        rows = len(plan)
        step = np.linalg.norm(np.diff(plan.q, axis=0), axis=1).sum() if rows else 0.0
        timed = self.path.t is not None or self.options.get("tool_speed") is not None
        return {
            "status": str(plan.status),
            "margin": float(np.min(plan.margin)) if rows and plan.margin is not None else -math.inf,
            "clearance": float(np.min(plan.clearance)) if rows and plan.clearance is not None else math.inf,
            "travel": float(step),
            "duration": float(plan.t[-1] - plan.t[0]) if rows and timed else 0.0,
            "reason": plan.reason,
        }


def _verdict(margin: float, point: int, good: Status) -> dict[str, Any]:
    """From the least margin of the points alone."""
    status, reason = good, ""
    if margin == -math.inf:
        status, reason = Status.UNREACHABLE, f"point {point} is out of reach"
    elif margin < 0:
        status = Status.LIMITS
        reason = f"point {point}: even the best configuration leaves a joint {-margin:.6f} outside its limits"
    return {
        "status": str(status),
        "margin": margin,
        "clearance": math.inf,
        "travel": 0.0,
        "duration": 0.0,
        "reason": reason,
    }


def _shift(shift: Sequence[float]) -> NDArray[np.float64]:
    """The transform of a shift and a turn about z."""
    x, y, z, yaw = shift
    pose = np.eye(4)
    pose[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
    pose[:3, 3] = x, y, z
    return pose


def _key(shift: Sequence[float]) -> tuple[float, ...]:
    """The same for the same placement, turns aside."""
    x, y, z, yaw = shift
    return (*(round(v, 9) for v in (x, y, z)), round(math.cos(yaw), 9), round(math.sin(yaw), 9))


def _moves(varies: NDArray[np.bool_]) -> list[NDArray[np.float64]]:
    """Directions of a pattern search: all neighbours on the grid of positions, and turns to either side.

    The margin is the least of several joints': it has ridges, which a search along the axes alone does not follow.
    """
    own = [(-1.0, 0.0, 1.0) if varies[axis] else (0.0,) for axis in range(3)]
    moves = [np.array([x, y, z, 0.0]) for x in own[0] for y in own[1] for z in own[2] if x or y or z]
    return moves + ([np.array([0.0, 0.0, 0.0, turn]) for turn in (1.0, -1.0)] if varies[3] else [])


def judge_placement(question: _Question, shift: tuple[float, float, float, float]) -> dict[str, Any]:
    """One placement. Runs on a worker."""
    return question.judge(shift)


def screen_placements(question: _Question, shifts: list[tuple[float, float, float, float]]) -> list[Any]:
    """Bounds of some placements. Runs on a worker."""
    return question.bounds(shifts, 1)


def place(
    chain: Any,
    path: Any,
    region: ArrayLike,
    spacing: float,
    yaw_steps: int,
    client: Any = None,
    out: str | os.PathLike[str] = "place.zarr",
    *,
    freedom: _core.ToolFreedom | None = None,
    refine: int = 3,
    progress: Callable[[float], None] | str | None = None,
    time_limit: float | None = None,
    threads: int | None = None,
    **plan_options: Any,
) -> PlacementJob:
    """Find where the base of an arm should stand for a path or a set of poses.

    Placements are the points of a grid of `region` with `yaw_steps` turns about the world's z axis, applied to the
    chain's own base. First the core gives the largest margin from the joint limits over points of the path: the least
    of them bounds the margin of every plan from there, and rules out placements without a configuration. The others go
    to `rd.plan`, best bound first, until no other one can be among the best ten. Then the best one is refined by a
    pattern search without derivatives.

    Args:
        chain: The arm, a `Chain` or an arm with a closed form.
        path: A `Path` to follow, or poses `(N, 4, 4)` that must be reached one by one.
        region: `((x0, x1), (y0, y1))` or with `(z0, z1)`, m: shifts of the base.
        spacing: Distance of neighbouring placements, m.
        yaw_steps: Turns over a whole turn; 1 keeps the base's own.
        client: A `distributed.Client`: screening and planning go to its workers. `None`: this process.
        out: Folder of the results; a call that was interrupted goes on from there.
        freedom: How far the tool may tilt and spin.
        refine: Halvings of the grid around the best placement; 0 for none.
        progress: `"bar"`, or a function of the share that is done.
        time_limit: Seconds after which the call returns the best so far.
        threads: Threads for screening without Dask.
        **plan_options: Options of `rd.plan`, such as `scene=`, `links=`, `tool_speed=`.

    Returns:
        The job: `.placements` best first with `.base`, `.status`, `.margin`, `.clearance`, `.travel`, `.duration`,
        `.reason`; `.best` are the ten best that can follow the path.

    Raises:
        RedundancyError: A region or step out of its range, results of another question in the folder, or a folder
            that another process is filling.
        ModuleNotFoundError: The extra `maps` is missing.

    Example:
        >>> import redundancy as rd
        >>> job = rd.maps.place(chain, path, ((-0.3, 0.3), (-0.3, 0.3)), 0.1, 4)  # doctest: +SKIP
        >>> job.placements[0].base  # doctest: +SKIP
    """
    plain = chain if isinstance(chain, _core.Chain) else getattr(chain, "chain", None)
    if not isinstance(plain, _core.Chain):
        raise TypeError(f"chain: expected a Chain or an arm with a closed form, got {type(chain).__name__}")
    is_path = isinstance(path, _core.Path)
    poses = _poses(path.poses if is_path else path)
    shifts = _grid(region, spacing, yaw_steps)
    question = _Question(plain, path if is_path else None, poses, freedom, plan_options)
    provenance = {
        "format": FORMAT,
        "chain": chain_to_text(plain),
        "version": _core.__version__,
        "settings": {
            "path": digest(pickle.dumps(path) if is_path else poses.tobytes()),
            "region": np.asarray(region, dtype=float).tolist(),
            "spacing": float(spacing),
            "yaw_steps": int(yaw_steps),
            "freedom": None if freedom is None else repr(freedom),
            "options": {key: digest(pickle.dumps(value)) for key, value in sorted(plan_options.items())},
        },
    }
    file = Path(out)
    answers = _Answers(file, provenance, len(shifts))
    with locked(file), Progress(progress, 0, len(shifts) + 1, 1, time_limit) as report:
        search = _Placements(question, shifts, answers, client, report, threads)
        status = search.run(refine)
    placements = search.placements()
    best = [p for p in placements if p.status is Status.CONVERGED][:KEPT]
    return PlacementJob(file, status, placements, search.planned, best)


def _poses(poses: ArrayLike) -> NDArray[np.float64]:
    try:
        rows = np.asarray(poses, dtype=float)
    except (TypeError, ValueError):
        rows = np.empty(())
    if rows.ndim == 0:
        raise TypeError(f"path: expected a Path or poses (N, 4, 4), got {type(poses).__name__}")
    if rows.shape[-2:] != (4, 4) or rows.ndim > 3 or not rows.size:
        raise RedundancyError(f"path has the shape {rows.shape}, expected a Path or poses (N, 4, 4), N >= 1")
    return rows.reshape(-1, 4, 4)


def _grid(region: ArrayLike, spacing: float, yaw_steps: int) -> list[tuple[float, float, float, float]]:
    """The shifts, in C order over x, y, z, yaw."""
    bounds = np.asarray(region, dtype=float)
    ok = (
        bounds.shape in ((2, 2), (3, 2))
        and np.all(np.isfinite(bounds))
        and np.all(bounds[:, 1] >= bounds[:, 0])
    )
    if not ok:
        message = f"region is {region!r}, expected ((x0, x1), (y0, y1)) or with (z0, z1) in m, ascending"
        raise RedundancyError(message)
    if not (np.isfinite(spacing) and spacing > 0):
        raise RedundancyError(f"spacing is {spacing}, it must be above 0 m and finite")
    if yaw_steps < 1:
        raise RedundancyError(f"yaw_steps is {yaw_steps}, it must be at least 1")
    axes = [lo + spacing * np.arange(int((hi - lo) / spacing + 1e-9) + 1) for lo, hi in bounds]
    axes += [np.zeros(1)] * (3 - len(axes))
    axes.append(2.0 * math.pi * np.arange(yaw_steps) / yaw_steps)
    rows = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 4)
    return [(float(x), float(y), float(z), float(yaw)) for x, y, z, yaw in rows]


class _Answers:
    """Verdicts of the planner on the placements of the grid, kept on disk."""

    def __init__(self, path: Path, provenance: dict[str, Any], count: int) -> None:
        zarr = import_zarr()
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            building = path.with_name(f"{path.name}.{os.getpid()}.new")
            group = zarr.open_group(str(building), mode="w")
            group.create_array(
                "answer", shape=(count, REASON), chunks=(1, REASON), dtype="uint8", fill_value=0
            )
            group.attrs["redundancy_place"] = provenance
            building.rename(path)
        if not path.is_dir():
            raise RedundancyError(f"'{path}' is a file, expected a folder of placements")
        try:
            self.group = zarr.open_group(str(path), mode="r+")
        except (FileNotFoundError, ValueError) as error:
            raise RedundancyError(f"'{path}' holds no placements: {error}") from error
        lines = differences(dict(self.group.attrs).get("redundancy_place", {}), provenance)
        if lines:
            message = (
                f"'{path}' holds placements of another question: {'; '.join(lines)}. Choose another folder"
            )
            raise RedundancyError(message)
        rows = np.asarray(self.group["answer"][:])
        texts = [row.tobytes().rstrip(b"\0") for row in rows]
        self.known = {k: json.loads(text) for k, text in enumerate(texts) if text}

    def add(self, index: int, answer: dict[str, Any]) -> None:
        """Stores a verdict."""
        self.known[index] = answer
        text = json.dumps(answer).encode()
        cut = dict(answer)
        while len(text) > REASON and cut["reason"]:
            cut["reason"] = cut["reason"][: -max(1, len(text) - REASON)]
            text = json.dumps(cut).encode()
        row = np.zeros(REASON, dtype=np.uint8)
        row[: len(text)] = np.frombuffer(text, dtype=np.uint8)
        self.group["answer"][index] = row


class _Placements:
    """The search over placements."""

    def __init__(
        self,
        question: _Question,
        shifts: list[tuple[float, float, float, float]],
        answers: _Answers,
        client: Any,
        report: Report,
        threads: int | None,
    ) -> None:
        self.question, self.shifts, self.answers = question, list(shifts), answers
        self.client, self.report, self.threads = client, report, threads
        self.bounds: list[tuple[float, int]] = []
        self.verdicts: dict[int, dict[str, Any]] = {}
        self.skipped: set[int] = set()
        self.planned = 0

    def run(self, refine: int) -> Status:
        """Screens, plans and refines."""
        try:
            self._screen()
            if not self._plan_best() or not self._refine(refine):
                return Status.TIME_LIMIT
        except KeyboardInterrupt:
            return Status.CANCELLED
        return Status.CONVERGED

    def _screen(self) -> None:
        batches = [self.shifts[k : k + BATCH] for k in range(0, len(self.shifts), BATCH)]
        if self.client is None:
            found = [self.question.bounds(batch, self.threads) for batch in batches]
        else:
            futures = self.client.map(screen_placements, [self.question] * len(batches), batches, pure=False)
            found = self.client.gather(futures)
        self.bounds = [bound for batch in found for bound in batch]

    def _judge(self, indices: list[int]) -> None:
        todo = [k for k in indices if k not in self.answers.known]
        if self.client is None:
            for k in todo:
                self.answers.add(k, self.question.judge(self.shifts[k]))
        else:
            import distributed  # noqa: PLC0415 - an extra

            as_completed: Any = distributed.as_completed

            shifts = [self.shifts[k] for k in todo]
            futures = self.client.map(judge_placement, [self.question] * len(todo), shifts, pure=False)
            index = dict(zip(futures, todo, strict=True))
            for future in as_completed(futures):
                self.answers.add(index[future], future.result())
        for k in indices:
            self.verdicts[k] = self.answers.known[k]
            self.planned += 1

    def _bar(self) -> float:
        """The margin that a placement must be able to have to be among the best."""
        good = sorted(
            (v["margin"] for v in self.verdicts.values() if v["status"] == "converged"), reverse=True
        )
        return good[KEPT - 1] if len(good) >= KEPT else 0.0

    def _plan_best(self) -> bool:
        order = sorted(range(len(self.shifts)), key=lambda k: (-self.bounds[k][0], k))
        wave = 1 if self.client is None else max(1, sum(self.client.nthreads().values()))
        k = 0
        while k < len(order) and self.bounds[order[k]][0] >= max(self._bar(), 0.0):
            bar = self._bar()
            chosen = [i for i in order[k : k + wave] if self.bounds[i][0] >= bar]
            self._judge(chosen)
            k += len(chosen)
            if not self.report(len(chosen)):
                self.skipped.update(order[k:])
                return False
        self.skipped.update(order[k:])
        return True

    def _refine(self, rounds: int) -> bool:
        """A pattern search around the best placement; its verdicts are not kept on disk."""
        best = max(
            (k for k, v in self.verdicts.items() if v["status"] == "converged"),
            key=lambda k: self.verdicts[k]["margin"],
            default=None,
        )
        if best is None:
            return True
        axes = np.ptp(np.asarray(self.shifts), axis=0)
        grid = sorted({s[0] for s in self.shifts}), sorted({s[3] for s in self.shifts})
        step = min(np.diff(grid[0])) if len(grid[0]) > 1 else 0.0
        yaw = (grid[1][1] - grid[1][0]) if len(grid[1]) > 1 else 0.0
        steps = np.where(axes > 0, [step, step or 0.0, step, yaw], 0.0)
        low, high = np.asarray(self.shifts).min(axis=0), np.asarray(self.shifts).max(axis=0)
        seen = {_key(shift) for shift in self.shifts}
        moves = _moves(axes > 0)
        for _ in range(rounds):
            steps = 0.5 * steps
            center = np.array(self.shifts[best])
            near = []
            for move in moves:
                shift = center + move * steps
                x, y, z, turn = (float(v) for v in shift)
                if (
                    np.any(shift[:3] < low[:3])
                    or np.any(shift[:3] > high[:3])
                    or _key((x, y, z, turn)) in seen
                ):
                    continue
                seen.add(_key((x, y, z, turn)))
                near.append((x, y, z, turn))
            bounds = self.question.bounds(near, self.threads) if near else []
            for bound, place in sorted(zip(bounds, near, strict=True), key=lambda one: -one[0][0]):
                if bound[0] <= self.verdicts[best]["margin"]:
                    continue
                self.shifts.append(place)
                self.bounds.append(bound)
                new = len(self.shifts) - 1
                self.verdicts[new] = verdict = self.question.judge(place)
                self.planned += 1
                if verdict["status"] == "converged" and verdict["margin"] > self.verdicts[best]["margin"]:
                    best = new
                if not self.report(0):
                    return False
        return True

    def placements(self) -> list[Placement]:
        """All placements, best first."""
        own = self.question.chain.base
        rows = []
        for k, shift in enumerate(self.shifts):
            verdict = self.verdicts.get(k)
            if verdict is None and k < len(self.bounds):
                bound, point = self.bounds[k]
                verdict = _verdict(bound, point, Status.CONVERGED)
                if bound >= 0:
                    verdict["status"] = None
                    verdict["reason"] = f"not planned: its margin is at most {bound:.6f}"
            if verdict is None:
                continue
            status = None if verdict["status"] is None else Status(verdict["status"])
            numbers = {
                name: verdict[name] for name in ("margin", "clearance", "travel", "duration", "reason")
            }
            rows.append(Placement(_shift(shift) @ own, shift, status, **numbers))
        rank = {Status.CONVERGED: 0, None: 2}
        return sorted(
            rows, key=lambda p: (rank.get(p.status, 1 if p.status not in _RULED_OUT else 3), -p.margin)
        )


_RULED_OUT = (Status.UNREACHABLE, Status.LIMITS)
