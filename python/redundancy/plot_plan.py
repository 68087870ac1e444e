"""Figures of a plan: joints, freedom of the tool, joint speeds. Needs the extra `plot`."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

import redundancy as rd

__all__ = ["figures", "freedom", "joints", "speed"]


PALETTE = ("#0072b2", "#a84300", "#007d5c", "#8a4f7d", "#8c6d00", "#24292f", "#3d8fc4", "#6b7280")
"""Colours that colour-blind readers tell apart [Okabe, Ito], dark enough for thin lines on white."""
STYLES = ("-", "-", "-", "-", "--", "--", "--", "--")
LIMIT, CHANGE = "#a84300", "#8a4f7d"
IN_VIEW = 0.65
"""Share of the limit from which on the limit is in view."""


def figures(chain: rd.Chain, plan: rd.Plan) -> dict[str, Figure]:
    """All figures of a plan by file name."""
    out = {"joints.png": joints(chain, plan), "speed.png": speed(chain, plan)}
    known = [values is not None and np.any(values) for values in (plan.tilt, plan.spin)]
    if any(known) or plan.spare or plan.clearance is not None or plan.self_clearance is not None:
        out["freedom.png"] = freedom(plan)
    return out


def joints(chain: rd.Chain, plan: rd.Plan) -> Figure:
    """Each joint over the path, with its limits, and where the arm changes its configuration."""
    figure, axes = _axes(chain.dof, "position")
    for i, ax in enumerate(axes):
        scale = _scale(chain, i)
        ax.plot(_along(plan), plan.q[:, i] * scale, color=PALETTE[0], lw=1.4)
        low, high = chain.lower[i] * scale, chain.upper[i] * scale
        values = plan.q[:, i] * scale
        room = 0.15 * max(np.ptp(values), 5.0 if scale != 1.0 else 0.05)
        for limit in (low, high):
            if values.min() - 4 * room <= limit <= values.max() + 4 * room:
                ax.axhline(limit, color=LIMIT, lw=0.8, ls="--")
        _marks(ax, plan)
        ax.set_ylabel(f"{plan.joint_names[i]}\n({'deg' if scale != 1.0 else 'm'})", fontsize=7)
    return figure


def speed(chain: rd.Chain, plan: rd.Plan) -> Figure:
    """Speed of each joint from row to row, as a share of its limit where it has one."""
    figure, axes = _axes(1, "speed")
    ax = axes[0]
    steps = np.diff(plan.q, axis=0) / np.diff(plan.t)[:, None]
    along = _along(plan)
    middle = 0.5 * (along[1:] + along[:-1])
    for i, name in enumerate(plan.joint_names):
        limit = chain.velocity_limit[i]
        share = np.abs(steps[:, i]) / (limit if np.isfinite(limit) else 1.0)
        colour, style = PALETTE[i % len(PALETTE)], STYLES[i % len(STYLES)]
        label = name if np.isfinite(limit) else f"{name} (rad/s or m/s)"
        ax.plot(middle, share, color=colour, ls=style, lw=1.2, label=label)
    top = max((float(line.get_ydata().max()) for line in ax.lines), default=1.0)
    ax.set_ylim(0.0, 1.1 * max(top, 1.0 if top > IN_VIEW else 0.0, 1e-3))
    if top > IN_VIEW:
        ax.axhline(1.0, color=LIMIT, lw=1.0, ls="--")
    ax.set_ylabel("joint speed / limit")
    ax.legend(fontsize=7, ncols=2)
    return figure


def freedom(plan: rd.Plan) -> Figure:
    """Tilt, spin, named spare coordinates and clearances over the path."""
    rows: list[tuple[str, Any]] = []
    if plan.tilt is not None and np.any(plan.tilt):
        rows.append(("tilt (deg)", np.degrees(np.linalg.norm(plan.tilt, axis=1))))
    if plan.spin is not None and np.any(plan.spin):
        rows.append(("spin (deg)", np.degrees(plan.spin)))
    rows += [(name, values) for name, values in plan.spare.items()]
    for name in ("clearance", "self_clearance"):
        values = getattr(plan, name)
        if values is not None:
            rows.append((f"{name.replace('_', ' ')} (m)", np.where(np.isfinite(values), values, np.nan)))
    figure, axes = _axes(len(rows), "freedom")
    for ax, (label, values) in zip(axes, rows, strict=True):
        ax.plot(_along(plan), values, color=PALETTE[0], lw=1.4)
        _marks(ax, plan)
        ax.set_ylabel(label, fontsize=8)
    return figure


def _axes(count: int, title: str) -> tuple[Figure, list[Any]]:
    figure = Figure(figsize=(8, max(3.0, 1.2 * count)))
    axes = figure.subplots(count, 1, sharex=True, squeeze=False)
    figure.suptitle(title, fontsize=10)
    axes[-1, 0].set_xlabel("path (m)")
    figure.align_ylabels()
    return figure, list(axes[:, 0])


def _along(plan: rd.Plan) -> Any:
    return plan.t if plan.s is None else plan.s


def _marks(ax: Any, plan: rd.Plan) -> None:
    for row in plan.reconfigurations:
        ax.axvline(_along(plan)[row], color=CHANGE, lw=0.8)


def _scale(chain: rd.Chain, joint: int) -> float:
    """Degrees for joints that turn."""
    moved = chain.jacobian(np.zeros(chain.dof))[3:, joint]
    return float(np.degrees(1.0)) if np.any(moved) else 1.0
