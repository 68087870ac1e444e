"""An explorer in the browser: the arm, every configuration over a pose, plans along a path, obstacles.

`redundancy.explore(chain)` serves a page on this machine. Needs the extra `explorer` (`pip install
redundancy[explorer]`), which is imported when it is called.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import redundancy as rd

if TYPE_CHECKING:
    from redundancy.explorer.view import View

__all__ = ["explore"]


def explore(
    chain: Any,
    path: rd.Path | None = None,
    plan: Any = None,
    scene: rd.Scene | None = None,
    links: rd.LinkGeometry | None = None,
    port: int = 8080,
    open_browser: bool = True,
    *,
    host: str = "127.0.0.1",
    q: Any = None,
    freedom: rd.ToolFreedom | None = None,
    task: str | None = None,
    capability: Any = None,
) -> View:
    """Show an arm and its freedom in the browser; returns at once, the page is served until `close()`.

    Args:
        chain: The arm, or an arm object such as `SrsArm`.
        path: A path, shown with its tool axes, and planned on request.
        plan: A plan along the path, or two, which are shown side by side.
        scene: Obstacles; they can be dragged and resized in the page.
        links: Shapes of the links, for distances.
        port: Port of the page; the next free one is taken when it is in use, 0 for any.
        open_browser: Whether to open the page.
        host: Address to listen on. By default only this machine can open the page.
        q: Configuration `(n,)` to begin with, rad or m.
        freedom: How far the tool may tilt and spin against the gizmo, and in plans.
        task: Which coordinates of the pose count, by name; all by default.
        capability: A map of `redundancy.maps.capability`, or its folder: slices of it are shown as coloured points.

    Returns:
        The view, with `.url` and `.close()`.

    Raises:
        ImportError: The extra `explorer` is missing.
        RedundancyError: An arm with more than one spare freedom at a fixed tool; no map in that folder.
        ValueError: A plan or a map of another arm.

    Example:
        >>> import redundancy as rd
        >>> view = rd.explore(rd.catalog.load("iiwa14"), port=0, open_browser=False)  # doctest: +SKIP
        >>> view.close()  # doctest: +SKIP
    """
    try:
        from redundancy.explorer import view as viewing  # noqa: PLC0415 - the extra is needed only here
    except ImportError as error:
        missing = "rd.explore needs the extra 'explorer': pip install redundancy[explorer]"
        raise ImportError(f"{missing} ({error})") from error

    from redundancy.explorer.map_model import MapModel  # noqa: PLC0415
    from redundancy.explorer.model import PoseModel  # noqa: PLC0415
    from redundancy.explorer.path_model import PathModel  # noqa: PLC0415
    from redundancy.explorer.scene_model import SceneModel  # noqa: PLC0415

    arm = getattr(chain, "chain", chain)
    plans = [] if plan is None else [plan] if isinstance(plan, rd.Plan) else list(plan)
    obstacles = SceneModel(scene)
    found = rd.maps.open(capability) if isinstance(capability, str | os.PathLike) else capability
    out = viewing.View(
        PoseModel(arm, q, obstacles.scene, links, freedom, task),
        PathModel(arm, path, plans, links, freedom, task),
        obstacles,
        host,
        port,
        MapModel(arm, found),
    )
    if open_browser:
        viewing.show_in_browser(out.url)
    return out
