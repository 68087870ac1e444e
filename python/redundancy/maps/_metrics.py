"""Metrics of poses, from the core."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from redundancy import _core

__all__ = ["METRICS", "best_margin", "metrics"]

METRICS = ("reachable", "margin", "proven", "swivel_measure", "manipulability", "spin_share", "clearance")
"""Every metric, in the order of the docs."""


def metrics(
    chain: Any,
    poses: ArrayLike,
    metrics: Sequence[str] = ("reachable", "margin", "swivel_measure", "manipulability"),
    freedom: _core.ToolFreedom | None = None,
    *,
    scene: _core.Scene | None = None,
    links: _core.LinkGeometry | None = None,
    self_collision: str | bool = "auto",
    out: Mapping[str, NDArray[Any]] | None = None,
    threads: int | None = None,
) -> dict[str, NDArray[Any]]:
    """What an arm can do at many poses.

    Args:
        chain: The arm, a `Chain` or an arm with a closed form.
        poses: Poses `(N, 4, 4)` or `(4, 4)` in the world, m.
        metrics: Names out of `METRICS`. `reachable`: a configuration within the joint limits exists. `margin`: see
            `best_margin`. `proven`: whether that margin is proven to be the largest. `swivel_measure`: how much of the
            self-motion holds the limits, in the union of all branches; radians of the swivel (S-R-S arms) or of q7
            (Panda class), otherwise the length in joint space. `manipulability`: `det(J J^T)` in the configuration of
            the margin. `spin_share`: the share of the allowed spins at which a configuration exists. `clearance`: least
            distance (m) in the configuration of the margin.
        freedom: How far the tool may tilt and spin away from each pose.
        scene: Obstacles, for the clearance.
        links: Shapes of the links, for the clearance.
        self_collision: Whether links count among each other; `"auto"`: if `links` has pairs.
        out: Arrays by name that are filled instead of new ones: bool for `reachable` and `proven`, else float64.
        threads: Threads to use; all cores by default. The bits do not depend on it.

    Returns:
        Arrays `(N,)` by name.

    Raises:
        RedundancyError: An unknown metric, a pose that is not rigid or finite, an array of another kind or length.

    Example:
        >>> import redundancy as rd
        >>> chain = rd.catalog.load("panda")
        >>> found = rd.maps.metrics(chain, chain.forward([0.3, 0.5, -0.2, -1.1, 0.4, 1.7, -0.9]), ["reachable"])
        >>> bool(found["reachable"][0])
        True
    """
    return _core.pose_metrics(
        chain,
        poses,
        list(metrics),
        freedom,
        scene=scene,
        links=links,
        self_collision=self_collision,
        out=None if out is None else dict(out),
        threads=threads,
    )


def best_margin(
    chain: Any,
    poses: ArrayLike,
    freedom: _core.ToolFreedom | None = None,
    out: NDArray[np.float64] | None = None,
    *,
    threads: int | None = None,
) -> NDArray[np.float64]:
    """The largest margin from the joint limits that any configuration over each pose has.

    The margin of a configuration is the least distance (rad or m) of a joint from a limit, each joint in its best
    winding. Its maximum is taken over all branches and the whole self-motion: exact for arms with a closed form.
    `metrics(..., ["margin", "proven"])` says where it is proven.

    Args:
        chain: The arm, a `Chain` or an arm with a closed form.
        poses: Poses `(N, 4, 4)` or `(4, 4)` in the world, m.
        freedom: How far the tool may tilt and spin; the margin is then the best that a search finds.
        out: Array `(N,)` of float64 that is filled and returned.
        threads: Threads to use; all cores by default. The bits do not depend on it.

    Returns:
        Margins `(N,)`. Negative by how much the worst joint misses its limits in the best configuration; `-inf` where
        no configuration exists.

    Raises:
        RedundancyError: A pose that is not rigid or finite, an array of another kind or length.

    Example:
        >>> import redundancy as rd
        >>> chain = rd.catalog.load("iiwa14")
        >>> float(rd.maps.best_margin(chain, chain.forward([0.3, 0.5, -0.2, 1.1, 0.4, 0.7, -0.9]))[0]) > 0.5
        True
    """
    given = None if out is None else {"margin": out}
    return metrics(chain, poses, ["margin"], freedom, out=given, threads=threads)["margin"]
