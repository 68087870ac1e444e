"""What `redundancy plan` does."""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path as File
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

import redundancy as rd
from redundancy import _motion, plot_plan

SHOWN_ANGLE = 1e-6
"""Tilt and spin that the terminal shows, rad: less is rounding."""

# What `plan` leaves behind.
RESULTS = (
    "trajectory.csv",
    "trajectory.json",
    "plan.npz",
    "summary.json",
    "joints.png",
    "freedom.png",
    "speed.png",
)


@dataclass
class Job:
    """One run of `plan`."""

    chain: rd.Chain
    robot: str
    path_file: File
    path: rd.Path
    out: File
    options: dict[str, Any]
    plots: bool = True
    progress: Callable[[float], None] | None = None
    plan: rd.Plan | None = None
    retime: bool = False
    motion: rd.Trajectory | None = None
    summary: dict[str, Any] = field(default_factory=dict)

    def run(self) -> list[str]:
        """Plan, measure, write; the names of the files."""
        begin = time.perf_counter()
        self.out.mkdir(parents=True, exist_ok=True)
        for name in RESULTS:  # nothing of an earlier run may stand beside the new summary
            (self.out / name).unlink(missing_ok=True)
        plan = rd.plan(self.chain, self.path, progress=self.progress, **self.options)
        self.plan = plan
        self.summary = self._measure(plan)
        written = ["summary.json"]
        if len(plan):
            own = self.path.t is not None or self.options.get("tool_speed") is not None
            # A jump from configuration to configuration has no times.
            keep = (own and not self.retime) or not plan.legal or len(plan) < 2
            motion, self.summary["timing"] = _motion.timed(self.chain, plan, keep)
            self.motion = motion
            self.summary["duration_s"] = float(motion.t[-1] - motion.t[0])
            self.summary["peak_joint_speed"] = dict(
                zip(motion.joint_names, np.abs(motion.qd).max(axis=0).tolist(), strict=True)
            )
            _motion.write_csv(motion, self.out / "trajectory.csv")
            motion.to_json(self.out / "trajectory.json")
            plan.to_npz(self.out / "plan.npz")
            written = ["trajectory.csv", "trajectory.json", "plan.npz", *written]
            if self.plots:
                for name, figure in plot_plan.figures(self.chain, plan).items():
                    figure.savefig(self.out / name, dpi=120)
                    written.append(name)
        self.summary["seconds"] = time.perf_counter() - begin
        text = json.dumps(self.summary, indent=2, allow_nan=False)
        (self.out / "summary.json").write_text(text + "\n")
        return written

    def _measure(self, plan: rd.Plan) -> dict[str, Any]:
        out: dict[str, Any] = {
            "robot": self.chain.name,
            "robot_source": self.robot,
            "path": str(self.path_file),
            "points": len(self.path),
            "length_m": self.path.length,
            "status": str(plan.status),
            "reason": plan.reason,
            "legal": plan.legal,
            "proven": plan.proven,
            "blocked": plan.blocked,
            "reconfigurations": plan.reconfigurations,
        }
        if not len(plan):
            return out
        steps = np.diff(plan.q, axis=0)
        out |= {
            "cost": plan.cost,
            **travel_and_margin(self.chain, plan),
            "sum_of_squared_steps": float((steps**2).sum()),
        }
        if plan.tilt is not None:
            out["largest_tilt_deg"] = float(np.degrees(np.linalg.norm(plan.tilt, axis=1).max()))
        if plan.spin is not None:
            out["spin_deg"] = [float(np.degrees(plan.spin.min())), float(np.degrees(plan.spin.max()))]
        for name in ("clearance", "self_clearance"):
            values = getattr(plan, name)
            if values is not None and np.isfinite(values).any():
                out[f"least_{name}_m"] = float(values.min())
        return out


def spin_of(text: str) -> Literal["free"] | float:
    """`free`, or degrees to either side as radians."""
    if text == "free":
        return "free"
    try:
        return float(np.deg2rad(float(text)))
    except ValueError:
        raise rd.RedundancyError(f"--spin is '{text}', it must be free or an angle in degrees") from None


def sliding_joints(chain: rd.Chain) -> np.ndarray:
    """Which joints slide: those that turn nothing."""
    turning = np.abs(chain.jacobian(np.zeros(chain.dof))[3:]).max(axis=0)
    return np.asarray(turning == 0.0)


def travel_and_margin(chain: rd.Chain, plan: rd.Plan) -> dict[str, float]:
    """Travel (Euclidean length in joint space) and least distance from a limit; turning and sliding joints apart."""
    out: dict[str, float] = {}
    slides = sliding_joints(chain)
    margins = np.minimum(plan.q - chain.lower, chain.upper - plan.q).min(axis=0)
    for chosen, unit in ((~slides, "rad"), (slides, "m")):
        if not chosen.any():
            continue
        out[f"joint_travel_{unit}"] = float(np.linalg.norm(np.diff(plan.q[:, chosen], axis=0), axis=1).sum())
        least = float(margins[chosen].min())
        if np.isfinite(least):
            out[f"least_margin_{unit}"] = least
    return out


def rows(chain: rd.Chain, plan: rd.Plan, motion: rd.Trajectory) -> list[tuple[str, str]]:
    """What the terminal shows."""
    out = [("status", str(plan.status))]
    if plan.reason:
        out.append(("reason", plan.reason))
    if not len(plan):
        return out
    figures = travel_and_margin(chain, plan)
    out.append(("joint travel", f"{figures.get('joint_travel_rad', 0.0):.4f} rad"))
    if "joint_travel_m" in figures:
        out.append(("travel of sliding joints", f"{figures['joint_travel_m']:.4f} m"))
    out.append(("duration", f"{motion.t[-1] - motion.t[0]:.3f} s"))
    if "least_margin_rad" in figures:
        out.append(("least margin", f"{np.degrees(figures['least_margin_rad']):.2f} deg"))
    if "least_margin_m" in figures:
        out.append(("least margin of sliding joints", f"{figures['least_margin_m']:.4f} m"))
    if plan.tilt is not None and np.abs(plan.tilt).max() > SHOWN_ANGLE:
        out.append(("largest tilt", f"{np.degrees(np.linalg.norm(plan.tilt, axis=1).max()):.2f} deg"))
    if plan.spin is not None and np.abs(plan.spin).max() > SHOWN_ANGLE:
        low, high = np.degrees(plan.spin.min()), np.degrees(plan.spin.max())
        out.append(("spin", f"{low:.1f} to {high:.1f} deg"))
    if plan.reconfigurations:
        out.append(("reconfigurations", ", ".join(map(str, plan.reconfigurations))))
    return out


def vector(text: str, option: str, count: int) -> NDArray[np.float64]:
    """Numbers with commas."""
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        values = np.array([])
    if len(values) != count or not np.isfinite(values).all():
        raise rd.RedundancyError(f"{option} is '{text}', it must be {count} comma-separated numbers")
    return values


def per_joint(text: str, option: str, joints: int) -> NDArray[np.float64]:
    """One number for each joint, or one for all of them."""
    if "," not in text and joints > 1:
        try:
            value = float(text)
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise rd.RedundancyError(
                f"{option} is '{text}', it must be one number for all joints or {joints} comma-separated numbers"
            )
        return np.full(joints, value)
    return vector(text, option, joints)


def on_rail(chain: rd.Chain, text: str) -> rd.Chain:
    """The arm on a rail `x,y,z,lower,upper`."""
    values = vector(text, "--rail", 5)
    return chain.with_rail(values[:3], float(values[3]), float(values[4]))
