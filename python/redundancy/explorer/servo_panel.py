"""Servo mode: the gizmo streams a target to `rd.Servo`, and what limits the arm is shown as it moves."""

from typing import TYPE_CHECKING, Any

import numpy as np

from redundancy.explorer import pictures
from redundancy.explorer.pose_panel import block, heading, paragraph
from redundancy.explorer.servo_model import ServoModel, Tick, limit_words
from redundancy.explorer.ticker import Ticker

if TYPE_CHECKING:
    from redundancy.explorer.view import View

PICTURE = 1.0 / 25.0
"""Time between pictures of the arm, s."""
PANEL_EVERY = 5
"""Pictures per update of the panel."""
OFF = "The servo is off. Switch it on, and drag the gizmo."


class ServoPanel:
    """Controls and drawing of a `ServoModel`.

    Args:
        view: The page.
        model: What is shown.
    """

    def __init__(self, view: "View", model: ServoModel) -> None:
        self.view, self.model = view, model
        gui = view.server.gui
        self.status = gui.add_html("")
        self.on = gui.add_checkbox("follow the gizmo", False, hint="The arm follows within its limits")
        self.figures = gui.add_html("")
        self.strips = gui.add_html("")
        self.ticker: Ticker | None = None
        self._every = max(1, round(PICTURE / model.dt))
        self._pictures = 0
        view.on(self.on, "servo", self.switch)
        self.push()

    # --- what a user does ---------------------------------------------------------------------------------

    def switch(self, wanted: bool) -> None:
        """Start at the configuration that is shown, or stop."""
        if not wanted:
            self.stop()
        elif not self.running:
            self.start()

    def start(self) -> None:
        """From the configuration that is shown, towards the gizmo."""
        pose = self.view.pose
        self.view.path_panel.play.value = False
        try:
            self.model.start(pose.q, pose.target)
        except ValueError:
            self.on.value = False
            raise
        self.on.value = True
        self._pictures = 0
        self.ticker = Ticker(self.model.dt, self._tick, self._failed)
        self.view.pose_panel.lend("the servo moves the arm: switch it off to choose configurations")

    def stop(self) -> None:
        """The arm rests where it is, and pose mode goes on from there."""
        if self.ticker is None:
            return
        self.halt()
        self.on.value = False
        latest = self.model.latest
        self.view.pose_panel.give_back(self.view.pose.q if latest is None else latest.q)
        self.push()

    def halt(self) -> None:
        """End the ticks."""
        if self.ticker is not None:
            self.ticker.stop()
            self.ticker = None

    def aim(self, pose: Any) -> None:
        """The gizmo was dragged."""
        self.model.aim(pose)
        self.view.pose.target = self.model.target

    @property
    def running(self) -> bool:
        """Whether the servo has the arm."""
        return self.ticker is not None

    # --- ticks --------------------------------------------------------------------------------------------

    def _tick(self) -> None:
        self.model.tick()
        if self.ticker is not None and self.ticker.ticks % self._every == 0:
            self.view.post("servo picture", self.picture)

    def _failed(self, error: Exception) -> None:
        """A tick that raises ends the servo; the page goes on."""
        self.view.failed(error)
        self.view.post("servo", self.stop)

    def picture(self) -> None:
        """Draw the arm where the last tick left it."""
        latest = self.model.latest
        if latest is None or not self.running:
            return
        self.view.show_servo(latest.q)
        if self._pictures % PANEL_EVERY == 0:
            self.push()
        self._pictures += 1

    # --- what is shown ------------------------------------------------------------------------------------

    def push(self) -> None:
        """Show the figures."""
        latest = self.model.latest
        if latest is None or not self.running:
            self.status.content = paragraph(OFF, pictures.INK)
            self.figures.content = self._limits()
            self.strips.content = ""
            return
        good = latest.status in {"converged", "tracking"}
        self.status.content = paragraph(self.model.words(), pictures.INK if good else pictures.VERMILION)
        self.figures.content = self._figures(latest)
        rows = self.model.history()
        if len(rows) > 1:
            t = rows[:, 0]
            self.strips.content = pictures.strip(
                "distance from the target (mm)", t, [("", rows[:, 1], pictures.BLUE)], None
            ) + pictures.strip(
                "largest joint speed, share of its limit",
                t,
                [("", rows[:, 2], pictures.BLUE)],
                None,
                (1.0,),
                "time (s)",
            )

    def _limits(self) -> str:
        """The limits that the servo will hold, before it is on."""
        assumed = int((~self.model.given).sum())
        words = (
            f"One tick takes {1e3 * self.model.dt:g} ms. Position, speed, acceleration and jerk are limited."
        )
        if assumed:
            words += (
                f" {assumed} of {len(self.model.given)} joints have no acceleration limit in their description: "
                "theirs is one that reaches full speed in half a second."
            )
        if len(self.view.scene.scene):
            words += " Obstacles are not looked at."
        return block(words)

    def _figures(self, latest: Tick) -> str:
        ticker = self.ticker
        turn = np.degrees(latest.orientation_error)
        stop = f"{latest.time_to_stop:.2f} s" if np.isfinite(latest.time_to_stop) else "none seen"
        lines = [
            f"<b>from the target</b> {1e3 * latest.position_error:.1f} mm, {turn:.1f}\N{DEGREE SIGN}",
            f"<b>scale</b> {100.0 * latest.scale:.0f} % of the target's velocity",
            f"<b>limits the step</b> {limit_words(latest.limits)}",
            f"<b>time to stop</b> {stop}",
        ]
        if ticker is not None:
            dropped = f", {ticker.dropped} dropped" if ticker.dropped else ""
            late = f"at most {1e3 * ticker.late:.1f} ms late"
            lines.append(f"<b>ticks</b> {ticker.ticks} of {1e3 * ticker.dt:g} ms, {late}{dropped}")
        pose = self.view.pose
        names, sliding = pose.chain.joint_names, pose.sliding
        out = block("<br>".join(lines)) + heading("joint speed, share of its limit")
        out += pictures.loads(names, self.model.speeds(latest))
        out += heading("distance from the joint limits")
        return out + pictures.margins(names, pose.margins, pose.shares, sliding)
