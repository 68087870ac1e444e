"""Times with which an arm can run what `track`, `plan` and `paint` write: from rest to rest, within its limits."""

from dataclasses import dataclass
from pathlib import Path as File
from typing import Any

import numpy as np
from numpy.typing import NDArray

import redundancy as rd

SECONDS_TO_SPEED = 0.5
"""Where an arm has no acceleration limit: it takes this long from rest to its speed limit."""
ASSUMED_ACCELERATION = 1.0
"""Where it has no speed limit either, rad/s^2 or m/s^2."""
SECONDS_TO_ACCELERATION = 0.1
"""Time from no acceleration to the limit: files carry accelerations, so they must not jump."""
LEAD_ROWS = 10
"""Rows of a lead-in or a lead-out."""
LEAD_PLACES = 10
"""Places of each of their intervals at which limits are looked at."""
LEAD_TRIALS = 10
"""How often a lead is made a tenth longer: between its ends the accelerations add up to at most twice the bound."""
SHORTEST_LEAD = 5e-3
"""Shortest lead, s: some cycles of a controller."""
TRIALS = 90
"""How often leads are made again so that they stay within the limits."""
SHARPER, SHARPER_TRIALS = 1.3, 20
"""By how much assumed accelerations are raised each time, and how often at most."""
SLOWER = 1.05
"""By how much a path is slowed down each time where they are the arm's, or where that was not enough."""
PLACES = 10
"""Places between two rows at which a motion at constant speed is looked at."""
SHOWN = 5
"""Violations that a summary lists."""


@dataclass(frozen=True)
class Accelerations:
    """What a motion may accelerate with; `assumed` where the arm does not say."""

    limits: NDArray[np.float64]
    assumed: bool

    @property
    def jerks(self) -> NDArray[np.float64]:
        """Jerk limits, rad/s^3 or m/s^3."""
        return self.limits / SECONDS_TO_ACCELERATION


def accelerations(chain: rd.Chain) -> Accelerations:
    """The acceleration limits of the chain, and gentle ones where it has none."""
    known = np.isfinite(chain.acceleration_limit)
    speed = chain.velocity_limit
    gentle = np.where(np.isfinite(speed), speed / SECONDS_TO_SPEED, ASSUMED_ACCELERATION)
    return Accelerations(np.where(known, chain.acceleration_limit, gentle), not bool(known.all()))


def has_limits(chain: rd.Chain) -> bool:
    """Whether some joint has a limit of speed or acceleration: without, no time is better than another."""
    return bool(np.isfinite(chain.velocity_limit).any() or np.isfinite(chain.acceleration_limit).any())


def timed(chain: rd.Chain, plan: rd.Trajectory, keep: bool) -> tuple[rd.Trajectory, dict[str, Any]]:
    """The rows of a plan with the times that are written, and what the summary says about them.

    Args:
        chain: The arm.
        plan: Rows of the path, in order.
        keep: Whether the times of the plan are the path's own; they stay, and what they break is reported.
    """
    if keep or not has_limits(chain):
        kept = with_accelerations(plan)
        return kept, {"times": "path" if keep else "no_limits", **violations(chain, kept)}
    allowed = accelerations(chain)
    moved = rd.retime(
        chain,
        plan,
        acceleration_limits=allowed.limits,
        jerk_limits=allowed.jerks,
        rows_between=False,
    )
    about: dict[str, Any] = {
        "times": "retimed",
        "acceleration_limits": allowed.limits.tolist(),
        "acceleration_limits_assumed": allowed.assumed,
        "jerk_limits": allowed.jerks.tolist(),
        "jerk_limits_assumed": True,
        "stretched": moved.stretched,
        "stops": moved.stops,
    }
    return moved, {**about, **violations(chain, moved)}


def with_accelerations(plan: rd.Trajectory) -> rd.Trajectory:
    """The same motion with the accelerations of its own interpolation at the rows."""
    if plan.qdd is not None or len(plan) < 2:
        return plan
    qdd = plan.sample(plan.t)[2]
    return rd.Trajectory(plan.joint_names, plan.t, plan.q, plan.qd, qdd=qdd)


def write_csv(motion: rd.Trajectory, file: File) -> None:
    """Times, positions, velocities and accelerations, and the section where there is more than the path."""
    section = None if motion.section is None else list(motion.section)
    if section is not None and set(section) == {"path"}:
        section = None
    rd.Trajectory(motion.joint_names, motion.t, motion.q, motion.qd, qdd=motion.qdd, section=section).to_csv(
        file
    )


def violations(chain: rd.Chain, motion: rd.Trajectory) -> dict[str, Any]:
    """What `redundancy check` says about a motion."""
    report = rd.check(chain, motion, singularity=0.0)
    found = [finding.message for finding in report.findings if finding.severity == "error"]
    return {"violations": len(found), "first_violations": found[:SHOWN]}


def lines(about: dict[str, Any]) -> list[str]:
    """What the terminal says about the times; nothing where there is nothing to know."""
    out = []
    if about.get("violations"):
        word = "1 error" if about["violations"] == 1 else f"{about['violations']} errors"
        out.append(
            f"the motion violates limits with these times, {word}; the first: {about['first_violations'][0]}"
        )
        if about["times"] == "path":
            out.append("the times are those of the path; --retime replaces them")
    if about.get("acceleration_limits_assumed") and about["times"] == "retimed":
        out.append(
            f"the arm has no acceleration limits; assumed: {SECONDS_TO_SPEED} s from rest to the speed limit"
        )
    return out


def at_constant_speed(
    chain: rd.Chain, motion: rd.Trajectory, hold_velocities: bool
) -> tuple[rd.Trajectory, float, dict[str, Any]]:
    """A motion at constant tool speed with a lead-in and a lead-out.

    Args:
        chain: The arm.
        motion: Rows at constant tool speed.
        hold_velocities: Whether the velocity limits of the chain hold.

    Returns:
        The motion with its leads, by which factor it is slower than the one given, and what the summary says.
    """
    motion = with_accelerations(motion)
    assert motion.qdd is not None
    u = np.linspace(0.0, 1.0, PLACES, endpoint=False)
    places = np.append((motion.t[:-1, None] + u * np.diff(motion.t)[:, None]).ravel(), motion.t[-1])
    _, qd, qdd, _ = motion.sample(places)
    factor = 1.0
    if hold_velocities:
        factor = max(factor, float((np.abs(qd) / chain.velocity_limit).max()))
    factor = max(factor, float(np.sqrt((np.abs(qdd) / chain.acceleration_limit).max())))
    names = motion.joint_names
    allowed = accelerations(chain)
    sharper = 1.0
    for trial in range(TRIALS):
        t, qd, qdd = motion.t * factor, motion.qd / factor, motion.qdd / factor**2
        before = _lead(allowed.limits * sharper, motion.q[0], qd[0], qdd[0])
        after = _lead(allowed.limits * sharper, motion.q[-1], -qd[-1], qdd[-1])
        if all(_fits(chain, lead, hold_velocities) for lead in (before, after)):
            break
        # A shorter lead where the accelerations are assumed, else a slower path: both need less room.
        if allowed.assumed and trial < SHARPER_TRIALS:
            sharper *= SHARPER
        else:
            factor *= SLOWER
    before, after = _thinned(before), _thinned(after)
    parts = [before, (t - t[0], motion.q, qd, qdd), _backwards(after)]
    times, start = [], 0.0
    for part in parts:
        times.append(part[0] + start)
        start += float(part[0][-1])
    # The row at which two parts meet is the path's.
    keep = [slice(None, -1), slice(None), slice(1, None)]
    joined = [
        np.concatenate([column[k] for column, k in zip(columns, keep, strict=True)])
        for columns in (times, *([part[i] for part in parts] for i in (1, 2, 3)))
    ]
    rows = [len(before[0]) - 1, len(t), len(after[0]) - 1]
    words = ("lead_in", "path", "lead_out")
    section = [word for word, count in zip(words, rows, strict=True) for _ in range(count)]
    whole = rd.Trajectory(names, joined[0], joined[1], joined[2], qdd=joined[3], section=section)
    about: dict[str, Any] = {
        "times": "constant_speed",
        "slowed_down_by": factor,
        "acceleration_limits_assumed": allowed.assumed,
        "lead_in_s": float(before[0][-1]),
        "lead_out_s": float(after[0][-1]),
        **violations(chain, whole),
    }
    return whole, factor, about


_Part = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def _fits(chain: rd.Chain, lead: _Part, hold_velocities: bool) -> bool:
    """Whether a lead stays within the position limits, and within those of velocity."""
    _, q, qd, _ = lead
    slow = (np.abs(qd) <= chain.velocity_limit * (1.0 + 1e-4)).all() or not hold_velocities
    return bool(slow and (q >= chain.lower).all() and (q <= chain.upper).all())


def _lead(
    limits: NDArray[np.float64],
    q: NDArray[np.float64],
    qd: NDArray[np.float64],
    qdd: NDArray[np.float64],
) -> _Part:
    """From rest to a state: the velocity is a cubic in time, as short as the accelerations allow.

    `qd = v (3 u^2 - 2 u^3) + a T (u^3 - u^2)` with `u = t / T` meets the velocity v and the acceleration a at T.
    """
    u = np.linspace(0.0, 1.0, LEAD_ROWS * LEAD_PLACES + 1)[:, None]
    # Where the accelerations are assumed the path may need more; then all joints may.
    bounds = limits * max(1.0, float((np.abs(qdd) / limits).max()))
    duration = max(1.5 * float((np.abs(qd) / bounds).max()), SHORTEST_LEAD)

    def rows(seconds: float) -> _Part:
        ramp = qdd * seconds
        speed = qd * (3 * u**2 - 2 * u**3) + ramp * (u**3 - u**2)
        travel = qd * (u**3 - 0.5 * u**4 - 0.5) + ramp * (0.25 * u**4 - u**3 / 3 + 1.0 / 12.0)
        slope = qd * (6 * u - 6 * u**2) + ramp * (3 * u**2 - 2 * u)
        return u[:, 0] * seconds, q + travel * seconds, speed, slope / seconds

    part = rows(duration)
    for _ in range(LEAD_TRIALS):
        if (np.abs(part[3]) <= bounds * (1.0 + 1e-9)).all():
            break
        duration *= 1.1
        part = rows(duration)
    return part


def _thinned(part: _Part) -> _Part:
    t, q, qd, qdd = (column[::LEAD_PLACES] for column in part)
    return t, q, qd, qdd


def _backwards(part: _Part) -> _Part:
    t, q, qd, qdd = part
    return t[-1] - t[::-1], q[::-1], -qd[::-1], qdd[::-1]
