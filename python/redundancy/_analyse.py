"""What `redundancy analyse` does: critical points over a pose, and how far each can be followed along a path."""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path as File
from typing import Any

import numpy as np
from numpy.typing import NDArray

import redundancy as rd
from redundancy import plot_optimum

__all__ = ["RESULTS", "Analysis"]

# What `analyse` leaves behind; which pictures there are depends on the arm.
RESULTS = (
    "trajectory.csv",
    "trajectory.json",
    "summary.json",
    "loci.png",
    "paths.png",
    "values.png",
    "self_motion.png",
)

_CRITERIA: dict[str, Callable[[rd.Chain, str], rd.Criterion]] = {
    "manipulability": lambda chain, task: rd.Manipulability(chain, task=task),
    "joint_range": lambda chain, _: rd.JointRange(chain),
}


@dataclass
class Analysis:
    """One run of `analyse`."""

    chain: rd.Chain
    source: str
    out: File
    criterion_name: str = "manipulability"
    task: str = "pose"
    path_file: File | None = None
    q: NDArray[np.float64] | None = None
    plots: bool = True
    summary: dict[str, Any] = field(default_factory=dict)

    def run(self) -> tuple[list[str], list[str]]:
        """Compute, write, and return the lines of a report and the names of the files written.

        Whether any start completes the path is `summary["completed"]`.

        Raises:
            RedundancyError: bad input.
        """
        begin = time.perf_counter()
        if self.criterion_name not in _CRITERIA:
            names = ", ".join(_CRITERIA)
            raise rd.RedundancyError(f"--criterion is '{self.criterion_name}', expected one of: {names}")
        task = rd.Task(self.task)
        criterion = _CRITERIA[self.criterion_name](self.chain, self.task)
        path, pose = self._path_and_pose()
        points = rd.constrained_optima(self.chain, pose, criterion, task)
        spare = self.chain.dof - task.dim
        curves = rd.self_motion_curves(self.chain, pose, task, step=0.05) if spare == 1 else []
        planar = spare == 1 and self.chain.dof == 3 and task.dim == 2
        crossings = rd.algorithmic_singularities(self.chain, criterion, task) if planar else []
        ranked = [] if path is None else rd.rank_starts(self.chain, path, criterion, task)
        self.out.mkdir(parents=True, exist_ok=True)
        for name in RESULTS:  # nothing of an earlier run may stand beside the new summary
            (self.out / name).unlink(missing_ok=True)
        written = []
        if ranked:
            ranked[0].trajectory.to_csv(self.out / "trajectory.csv")
            ranked[0].trajectory.to_json(self.out / "trajectory.json")
            written += ["trajectory.csv", "trajectory.json"]
        self.summary = {
            "robot": self.chain.name,
            "robot_source": self.source,
            "task": self.task,
            "criterion": self.criterion_name,
            "spare_freedoms": spare,
            "target_position_m": np.asarray(pose)[:3, 3].tolist(),
            "critical_points": [self._point(point, criterion) for point in points],
            "self_motion_curves": [
                {
                    "closed": curve.closed,
                    "length_rad": curve.length,
                    "feasible_arcs": curve.intervals().tolist(),
                }
                for curve in curves
            ],
            "algorithmic_singularities": [
                {"q_rad": point.q.tolist(), "position_m": point.position.tolist(), "residual": point.residual}
                for point in crossings
            ],
            "starts": [self._start(start, path, crossings) for start in ranked],
            "completed": any(start.completed for start in ranked) if ranked else None,
        }
        if self.plots:
            written += self._draw(criterion, task, planar, curves, points, crossings, ranked)
        self.summary["seconds"] = time.perf_counter() - begin
        text = json.dumps(self.summary, indent=2, allow_nan=False)
        (self.out / "summary.json").write_text(text + "\n")
        return self._report(points, crossings, ranked), [*written, "summary.json"]

    def _path_and_pose(self) -> tuple[rd.Path | None, NDArray[np.float64]]:
        """The path of the file, or the paper's circle for its arm, and its start; or the pose of a configuration."""
        if self.path_file is not None and self.q is not None:
            raise rd.RedundancyError("give --path or --q, not both")
        if self.path_file is not None:
            path = rd.Path.from_csv(self.path_file)
            return path, path.poses[0]
        if self.q is not None:
            return None, self.chain.forward(self.q)
        if self.chain.name == "planar3r" and self.task == "planar":
            circle = rd.paths.circle((3.5, 0.0, 0.0), 1.5, start=np.pi, n=201)
            path = circle.with_times(circle.s / circle.length)
            return path, path.poses[0]
        raise rd.RedundancyError("give --path (a CSV file) or --q (joint angles in degrees)")

    def _point(self, point: rd.CriticalPoint, criterion: rd.Criterion) -> dict[str, Any]:
        record = {
            "kind": str(point.kind),
            "q_rad": point.q.tolist(),
            "value": point.value,
            "eigenvalues": point.eigenvalues.tolist(),
            "multipliers": point.multipliers.tolist(),
            "residual": point.residual,
            "sigma_min": point.sigma_min,
            "within_limits": point.within_limits,
        }
        if len(point.eigenvalues) == 1:
            record["condition_A"] = rd.cofactor_condition(self.chain, point.q, criterion, self.task).condition
        return record

    def _start(
        self, start: rd.RankedStart, path: rd.Path | None, crossings: list[rd.SingularPoint]
    ) -> dict[str, Any]:
        followed = start.trajectory
        record: dict[str, Any] = {
            "kind": str(start.kind),
            "q_rad": start.q.tolist(),
            "value": start.value,
            "completed": start.completed,
            "rows": len(followed),
            "least_sigma_min": float(followed.sigma_min.min()),
            "events": [
                {"kind": str(e.kind), "index": e.index, "t": e.t, "s": e.s, "message": e.message}
                for e in followed.events
            ],
        }
        if start.completed and path is not None:
            record["joint_gap_rad"] = float(np.abs(followed.q[-1] - followed.q[0]).max())
        if crossings:
            distance = rd.singularity_distance(self.chain, followed.q, crossings)
            record["least_distance_to_algorithmic_singularity_rad"] = float(distance.min())
        if followed.stop_q is not None:
            record["stop_q_rad"] = followed.stop_q.tolist()
        return record

    def _draw(
        self,
        criterion: rd.Criterion,
        task: rd.Task,
        planar: bool,
        curves: list[rd.SelfMotionCurve],
        points: list[rd.CriticalPoint],
        crossings: list[rd.SingularPoint],
        ranked: list[rd.RankedStart],
    ) -> list[str]:
        figures = {}
        if planar:
            figures["loci.png"] = plot_optimum.loci(self.chain, criterion, task, crossings)
            if ranked:
                figures["paths.png"] = plot_optimum.resolved_paths(
                    self.chain, criterion, task, curves, ranked
                )
        if curves:
            figures["self_motion.png"] = plot_optimum.self_motion_values(criterion, curves, points)
        if ranked:
            figures["values.png"] = plot_optimum.values_along_path(ranked)
        for name, figure in figures.items():
            figure.savefig(self.out / name, dpi=110)
        return list(figures)

    def _report(
        self,
        points: list[rd.CriticalPoint],
        crossings: list[rd.SingularPoint],
        ranked: list[rd.RankedStart],
    ) -> list[str]:
        kinds = [str(point.kind) for point in points]
        counts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds)) or "none"
        lines = [f"critical points of {self.criterion_name} for the pose: {counts}"]
        if not ranked:
            for point in points:
                degrees = ", ".join(f"{x:.2f}" for x in np.degrees(point.q))
                outside = "" if point.within_limits else ", outside joint limits"
                lines.append(f"  {point.kind}  h = {point.value:.6g}  q = {degrees} deg{outside}")
        if crossings:
            lines.append(f"algorithmic singularities: {len(crossings)}")
        for start in ranked:
            degrees = ", ".join(f"{x:.2f}" for x in np.degrees(start.q))
            stops = [event for event in start.trajectory.events if str(event.kind).endswith("singularity")]
            end = "completes" if start.completed else f"stops at t = {stops[-1].t:.10g}: {stops[-1].kind}"
            lines.append(f"  {start.kind}  h = {start.value:.6g}  q = {degrees} deg  {end}")
        return lines
