"""Path mode: plans animated, the map of the spare coordinate, strips of clearance, speed and torque."""

import math
import threading
import time
from typing import TYPE_CHECKING, Any

import numpy as np

import redundancy as rd
from redundancy.explorer import drawing, pictures, shapes
from redundancy.explorer.arm import turned_z
from redundancy.explorer.mailbox import Mailbox
from redundancy.explorer.model import PoseModel
from redundancy.explorer.path_model import SPEEDS, STRIP_POINTS, PathModel
from redundancy.explorer.pose_panel import paragraph

if TYPE_CHECKING:
    from redundancy.explorer.view import View

FRAME = 1.0 / 25.0
"""Time between pictures while playing, s."""
STRIP_EVERY = 4
"""Pictures per update of the drawings in the panel while playing."""
TOOL_AXES = 40
"""Tool axes that are drawn along a path at most."""
COLOURS = (pictures.BLUE, pictures.ORANGE)
"""Of the first and the second plan."""
ASIDE = 1.1
"""Distance of the second arm from the first, in reaches."""


class CancelledError(Exception):
    """The plan in progress is not wanted any more."""


class PathPanel:
    """Controls and drawing of a `PathModel`.

    Args:
        view: The page.
        model: What is shown.
    """

    def __init__(self, view: "View", model: PathModel) -> None:
        self.view, self.model = view, model
        gui = view.server.gui
        self.status = gui.add_html("")
        self.play = gui.add_checkbox("play", False)
        self.time = gui.add_slider("time (s)", 0.0, top_of(model.duration), 1e-3, 0.0)
        self.speed = gui.add_dropdown("speed", tuple(f"{s:g} x" for s in SPEEDS), initial_value="1 x")
        self.map = gui.add_html("")
        self.strips = gui.add_html("")
        with gui.add_folder("plan", expand_by_default=True):
            self.buttons = gui.add_button_group("plan the path", ("plan", "cancel"))
            self.beside = gui.add_checkbox("keep the old plan beside it", False)
            self.progress = gui.add_progress_bar(0.0)
        self.second: drawing.ArmDrawing | None = None
        self.planner = Mailbox(view.failed)
        self._cancel = threading.Event()
        self._ticks = 0
        self._strip_cache: list[tuple[str, Any, Any, Any]] = []
        self._listen()
        self.push_path()
        self.push()

    def _listen(self) -> None:
        on, view = self.view.on, self.view
        on(self.time, "time", self.seek)
        on(self.speed, "speed", lambda text: self.model.set_speed(float(text.split()[0])))
        on(self.play, "play", self.start)

        @self.buttons.on_click
        async def _(event: Any) -> None:
            if event.target.value == "cancel":
                self.cancel()
            else:
                view.post("plan", self.plan)

    # --- playing ------------------------------------------------------------------------------------------

    def seek(self, time: float) -> None:
        """Show a time."""
        self.view.take_the_arm()
        self.model.set_time(time)
        self.push()

    def start(self, wanted: bool) -> None:
        """Play or stop; from the beginning when it has ended."""
        if wanted:
            self.view.take_the_arm()
        if wanted and self.model.time >= self.model.duration:
            self.model.set_time(0.0)
        if wanted:
            threading.Thread(target=self._play, name="explorer-play", daemon=True).start()

    def _play(self) -> None:
        last = time.monotonic()
        while self.play.value and not self.view.closed:
            time.sleep(FRAME)
            now = time.monotonic()
            seconds, last = now - last, now
            self.view.post("tick", lambda passed=seconds: self.tick(passed))  # type: ignore[misc]
            self.view.mailbox.settle(1.0)

    def tick(self, seconds: float) -> None:
        """One picture of the animation."""
        if not self.play.value:
            return
        self._ticks += 1
        more = self.model.advance(seconds)
        if not more:
            self.play.value = False
        self.push(panels=not more or self._ticks % STRIP_EVERY == 0)

    # --- planning -----------------------------------------------------------------------------------------

    def plan(self) -> None:
        """Plan the path on a thread of its own; a plan in progress is cancelled first."""
        self.cancel()
        self._cancel = cancel = threading.Event()
        self._show_progress(0.0)
        scene = self.view.pose.scene
        self.planner.post("plan", lambda: self._plan(scene, cancel))

    def cancel(self) -> None:
        """Give up the plan in progress."""
        self._cancel.set()

    def _plan(self, scene: rd.Scene | None, cancel: threading.Event) -> None:
        def report(share: float) -> None:
            if cancel.is_set() or self.view.closed:
                raise CancelledError
            self._show_progress(share)

        try:
            report(0.0)
            plan = self.model.replan(scene, report)
        except CancelledError:
            self.view.post("cancelled", lambda: self.view.notice("the plan was cancelled"))
        else:
            self.view.post("planned", lambda: None if cancel.is_set() else self.take(plan))

    def _show_progress(self, share: float) -> None:
        for bar in (self.progress, self.view.scene_panel.progress):
            bar.value = 100.0 * share

    def take(self, plan: rd.Plan) -> None:
        """Show a plan that was just made."""
        self._show_progress(1.0)
        if not len(plan):
            self.view.notice(f"no plan: {plan.reason or plan.status}")
            return
        if not plan.legal:
            self.view.notice(f"{plan.status}: {plan.reason}")
        self.model.take(plan, keep=bool(self.beside.value))
        self.push_path()
        self.push()

    # --- what is shown ------------------------------------------------------------------------------------

    def push_path(self) -> None:
        """Show the path, its tool axes, and what does not change with time."""
        model, scene, reach = self.model, self.view.server.scene, self.view.pose.body.reach
        poses = model.poses
        points = poses[:, :3, 3]
        drawing.lines(
            scene,
            "/path",
            np.stack([points[:-1], points[1:]], axis=1),
            pictures.rgb(pictures.INK),
            0.004 * reach,
        )
        few = poses[pictures.shown(len(poses), TOOL_AXES)] if len(poses) else poses
        axis = np.array([0.0, 0.0, 1.0]) if model.freedom is None else np.asarray(model.freedom.axis)
        tips = few[:, :3, 3] - 0.06 * reach * (few[:, :3, :3] @ axis)
        drawing.lines(
            scene, "/tool_axes", np.stack([few[:, :3, 3], tips], axis=1), (110, 118, 128), 0.002 * reach
        )
        self._strip_cache = self._strip_data()
        if model.lines:
            top = top_of(model.duration)
            if self.time.max != top:
                self.time.max = top
        self._second_arm()

    def _second_arm(self) -> None:
        body = self.view.pose.body
        if len(self.model.lines) < 2:
            if self.second is not None:
                self.second.remove()
                self.second = None
            return
        if self.second is None:
            aside = (0.0, ASIDE * body.reach, 0.0)
            self.second = drawing.ArmDrawing(
                self.view.server.scene, "/second", body, drawing.SECOND_LINK, aside, self.model.links
            )

    def push(self, panels: bool = True) -> None:
        """Show the time."""
        model = self.model
        if model.lines:
            q = model.lines[0].at(model.time)
            self.view.show_configuration(q)
            if self.second is not None:
                other = model.lines[1].at(model.time)
                self.second.show(other, shares(self.view.pose, other))
            self._cone()
            self.time.value = model.time
        if not panels:
            return
        colour = pictures.INK if all(line.plan.legal for line in model.lines) else pictures.VERMILION
        self.status.content = paragraph(model.words(), colour)
        if self.view.ready:
            self.view.scene_panel.show_plan()
        self._push_map()
        at = model.time
        self.strips.content = "".join(
            pictures.strip(title, t, rows, at, limits, "time (s)" if last else "")
            for last, (title, t, rows, limits) in self._last_marked()
        )

    def _last_marked(self) -> list[tuple[bool, tuple[str, Any, Any, Any]]]:
        return [(k == len(self._strip_cache) - 1, one) for k, one in enumerate(self._strip_cache)]

    def _push_map(self) -> None:
        model = self.model
        found = model.spare_map()
        if found is None or not model.lines:
            self.map.content = ""
            return
        name, lengths, columns = found
        rows = pictures.shown(len(model.lines[0].q), len(lengths))
        drawn, marker = [], None
        for k, line in reversed(list(enumerate(model.lines))):
            spare = model.spare_of(line)
            if spare is None or len(line.q) != len(model.lines[0].q):
                continue
            drawn.append((np.asarray(spare[1])[rows], COLOURS[k]))
            if k == 0:
                row = line.row(model.time)
                marker = (float(model.lengths[row]), float(np.asarray(spare[1])[row]))
        title = f"{name} along the path: light blue within all joint limits"
        self.map.content = pictures.spare_map(title, lengths, columns, drawn, marker)

    def _strip_data(self) -> list[tuple[str, Any, Any, Any]]:
        kinds: list[tuple[str, str, tuple[float, ...], float]] = [
            ("clearance", "clearance (mm)", (0.0,), 1e3),
            ("speeds", "largest share of a speed limit", (1.0,), 1.0),
            ("torques", "largest share of a torque limit", (1.0,), 1.0),
        ]
        out = []
        for what, title, limits, factor in kinds:
            rows, common = [], None
            for k, line in enumerate(self.model.lines):
                values = getattr(line, what)()
                if values is None:
                    continue
                few = pictures.shown(len(values), STRIP_POINTS)
                t = line.t[few] - line.t[0]
                common = t if common is None or t[-1] > common[-1] else common
                rows.append((line.name, t, factor * values[few], COLOURS[k]))
            if common is not None:
                curves = [
                    (name, np.interp(common, t, v, right=np.nan), colour) for name, t, v, colour in rows
                ]
                out.append((title, common, curves, limits))
        return out

    def _cone(self) -> None:
        freedom = self.model.freedom
        if freedom is None or not freedom.half_angle > 0.0 or self.model.path is None:
            return
        line, scene = self.model.lines[0], self.view.server.scene
        pose = self.model.poses[min(line.row(self.model.time), len(self.model.poses) - 1)]
        if scene.get_handle_by_name("/cone") is None:
            vertices, faces = shapes.cone(float(freedom.half_angle), 0.3 * self.view.pose.body.reach)
            axis = -np.asarray(freedom.axis, dtype=float)

            turn = rd.quaternion.to_matrix(turned_z(axis[None] / np.linalg.norm(axis))[0])
            scene.add_mesh_simple(
                "/cone",
                vertices @ turn.T,
                faces,
                color=pictures.rgb(pictures.ORANGE),
                opacity=0.4,
                side="double",
            )
        handle = scene.get_handle_by_name("/cone")
        if handle is not None:
            handle.position, handle.wxyz = pose[:3, 3], drawing.quaternion(pose)


def top_of(duration: float) -> float:
    """End of the time slider: whole milliseconds."""
    return max(math.ceil(1e3 * duration - 1e-6), 1) / 1e3


def shares(model: PoseModel, q: Any) -> Any:
    """Margin per joint as a share of half its range, for another configuration."""
    half = 0.5 * (model.chain.upper - model.chain.lower)
    margin = np.minimum(q - model.chain.lower, model.chain.upper - q)
    good = np.isfinite(half) & (half > 0.0)
    return np.where(good, margin / np.where(good, half, 1.0), 1.0)
