"""Pose mode: drag the tool, slide along the self-motion, see what the limits allow."""

from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

import redundancy as rd
from redundancy.explorer import drawing, pictures
from redundancy.explorer.model import PoseModel

if TYPE_CHECKING:
    from redundancy.explorer.view import View

NO_PIECE = "none"
"""The choice that is shown when there is no configuration."""


class PosePanel:
    """Controls and drawing of a `PoseModel`.

    Args:
        view: The page.
        model: What is shown.
    """

    def __init__(self, view: "View", model: PoseModel) -> None:
        self.view, self.model = view, model
        gui, scene = view.server.gui, view.server.scene
        self.arm = drawing.ArmDrawing(scene, "/arm", model.body, links=model.links)
        self.gizmo = scene.add_transform_controls(
            "/target",
            scale=0.3 * model.body.reach,
            line_width=3.0,
            depth_test=False,
            position=model.target[:3, 3],
            wxyz=drawing.quaternion(model.target),
        )
        self.status = gui.add_html("")
        self.piece = gui.add_dropdown(
            "piece", (NO_PIECE,), hint="Every curve or point of configurations here"
        )
        self.slider = gui.add_slider("along it", -180.0, 180.0, 0.1, 0.0, hint="Moves the arm, not the tool")
        self.bands = gui.add_html("")
        self.criterion = gui.add_dropdown("criterion", tuple(model.criteria))
        self.buttons = gui.add_button_group("go to", ("best", "nearest"))
        self.show_ghosts = gui.add_checkbox("other branches as ghosts", True)
        self.freedom = self._freedom_controls(gui)
        self.spin_band = gui.add_html("") if "spin" in self.freedom else None
        self.facts = gui.add_html("")
        self._listen()
        self.push()

    def _freedom_controls(self, gui: Any) -> dict[str, Any]:
        freedom = self.model.freedom
        if freedom is None:
            return {}
        most = 180.0 if freedom.spin == "free" else float(np.degrees(freedom.spin))
        half = float(np.degrees(freedom.half_angle))
        out = {}
        if most > 0.0:
            out["spin"] = gui.add_slider("spin (deg)", -most, most, 0.1, 0.0)
        if half > 0.0:
            out["tilt x"] = gui.add_slider("tilt x (deg)", -half, half, 0.1, 0.0)
            out["tilt y"] = gui.add_slider("tilt y (deg)", -half, half, 0.1, 0.0)
        return out

    def _listen(self) -> None:
        on, model = self.view.on, self.model
        on(self.piece, "piece", self.choose)
        on(self.slider, "slide", self.slide)
        on(self.criterion, "criterion", lambda name: self.act(lambda: model.choose_criterion(name)))
        on(self.show_ghosts, "ghosts", lambda _: self.push())
        for name, handle in self.freedom.items():
            on(handle, name, lambda _: self.turn_tool())
        view = self.view

        @self.buttons.on_click
        async def _(event: Any) -> None:
            name = event.target.value
            view.post(f"go to {name}", lambda: self.go_to(name))

        @self.gizmo.on_update
        async def _(event: Any) -> None:
            position, wxyz = np.array(event.target.position), np.array(event.target.wxyz)
            view.post("gizmo", lambda: self.dragged(position, wxyz))

    # --- what a user does ---------------------------------------------------------------------------------

    def dragged(self, position: Any, wxyz: Any) -> None:
        """The gizmo was dragged: the servo follows it when it is on, else the arm is put there."""
        if self.view.servo_running:
            self._take(position, wxyz, self.view.servo_panel.aim)
        else:
            self.move(position, wxyz)

    def move(self, position: Any, wxyz: Any) -> None:
        """Put the tool at a pose of the gizmo."""
        self._take(position, wxyz, self.model.move)
        self.push()

    def _take(self, position: Any, wxyz: Any, action: Any) -> None:
        """Do something with a pose of the gizmo; it goes back when that is refused."""
        try:
            size = max(float(np.linalg.norm(wxyz)), 1e-300)
            action(rd.pose(position, quaternion_wxyz=np.asarray(wxyz) / size))
        except (ValueError, rd.RedundancyError):
            self.gizmo.position = self.model.target[:3, 3]
            self.gizmo.wxyz = drawing.quaternion(self.model.target)
            raise

    def lend(self, words: str) -> None:
        """Something else moves the arm: what is known of one pose only is not shown."""
        scene = self.view.server.scene
        for node in ("/elbow", "/ghosts"):
            scene.remove_by_name(node)
        self.status.content = paragraph(words, pictures.INK)
        self.bands.content = self.facts.content = ""
        self.model.carry(self.model.q)

    def give_back(self, q: Any) -> None:
        """Go on from a configuration."""
        self.model.adopt(q)
        self.follow()
        self.push()

    def choose(self, label: str) -> None:
        """A piece was chosen from the list."""
        self.view.take_the_arm()
        if label in self.piece.options and label != NO_PIECE:
            self.act(lambda: self.model.choose(self.piece.options.index(label)))

    def slide(self, value: float) -> None:
        """The slider was moved; degrees on a closed piece."""
        self.act(lambda: self.model.slide(self.parameter(value)))

    def parameter(self, value: float) -> float:
        """The piece's parameter of a value of the slider."""
        return float(np.deg2rad(value)) if self._closed else value

    def go_to(self, name: str) -> None:
        """Best or nearest."""
        self.view.take_the_arm()
        found = self.model.best() if name == "best" else self.model.nearest()
        self.push()
        if found.q is None:
            self.view.notice(f"no {name} configuration: {found.reason}")

    def turn_tool(self) -> None:
        """Spin or tilt was moved."""
        values = {name: float(np.deg2rad(handle.value)) for name, handle in self.freedom.items()}
        tilt = (values.get("tilt x", 0.0), values.get("tilt y", 0.0))
        self.act(lambda: self.model.turn_tool(tilt, values.get("spin", 0.0)))

    def follow(self) -> None:
        """Put the gizmo and the freedom's sliders where the model is."""
        self.gizmo.position = self.model.target[:3, 3]
        self.gizmo.wxyz = drawing.quaternion(self.model.target)
        now = {"spin": self.model.spin, "tilt x": self.model.tilt[0], "tilt y": self.model.tilt[1]}
        for name, handle in self.freedom.items():
            handle.value = float(np.degrees(now[name]))

    def act(self, what: Any) -> None:
        """Change the model, then show it."""
        self.view.take_the_arm()
        what()
        self.push()

    # --- what is shown ------------------------------------------------------------------------------------

    @property
    def _closed(self) -> bool:
        index = self.model.piece
        return index is None or self.model.pieces[index].closed

    def push(self) -> None:
        """Show the model; not what something else does with the arm."""
        model = self.model
        if self.view.servo_running:
            return
        self.arm.show(model.q, model.shares)
        self._push_space()
        self._push_controls()
        self._push_words()
        self.view.pose_changed()

    def _push_space(self) -> None:
        model, scene = self.model, self.view.server.scene
        _, points, good = model.curve()
        drawing.curve(scene, "/elbow", points, good, drawing.CURVE * model.body.reach)
        shown = list(model.ghosts().values()) if self.show_ghosts.value else []
        drawing.ghosts(scene, "/ghosts", model.body, shown)

    def _push_controls(self) -> None:
        model = self.model
        labels = tuple(model.labels) or (NO_PIECE,)
        if labels != tuple(self.piece.options):
            self.piece.options = labels
        index = model.piece
        if index is not None and self.piece.value != labels[index]:
            self.piece.value = labels[index]
        moves = index is not None and model.solutions.dimension == 1
        if self.slider.disabled is moves:
            self.slider.disabled = not moves
        if not moves or index is None:
            return
        low, high = model.pieces[index].range
        low, high, value = (np.degrees(v) if self._closed else v for v in (low, high, model.u))
        if (self.slider.min, self.slider.max) != (low, high):
            self.slider.min, self.slider.max = float(low), float(high)
        self.slider.value = float(value)

    def _push_words(self) -> None:
        model = self.model
        colour = pictures.INK if model.reached and not model.reason else pictures.VERMILION
        self.status.content = paragraph(model.words(), colour)
        rows = [
            (piece.label, model.bands(i), piece.range, piece.closed)
            for i, piece in enumerate(model.pieces)
            if model.solutions.dimension == 1
        ]
        unit = model.parameter if model.parameter == "swivel" else "along the self-motion"
        self.bands.content = pictures.bands(rows, model.piece, model.u, unit) if rows else ""
        if self.spin_band is not None:
            parts = np.array(model.spin_bands()).reshape(-1, 2)
            most = float(np.deg2rad(self.freedom["spin"].max))
            row = ("spin", parts, (-most, most), False)
            self.spin_band.content = pictures.bands(
                [row], 0, model.spin, "reachable within the limits (samples)"
            )
        facts = model.facts()
        self.view.nearest_line(facts.nearest, facts.nearest_of_links)
        self.facts.content = self._figures(facts)

    def _figures(self, facts: Any) -> str:
        model = self.model
        lines = [f"<b>kind of optimum</b> ({model.criterion}): {facts.kind.replace('_', ' ')}"]
        if facts.manipulability is not None:
            lines.append(f"<b>manipulability</b> {facts.manipulability:.4g}")
        if facts.sigma_min is not None:
            lines.append(f"<b>least singular value</b> {facts.sigma_min:.3g}")
        if facts.self_clearance is not None:
            distance, first, second = facts.self_clearance
            lines.append(f"<b>self-distance</b> {1e3 * distance:.0f} mm ({first}, {second})")
        out = (
            block("<br>".join(lines))
            + heading("distance from the joint limits")
            + pictures.margins(model.chain.joint_names, model.margins, model.shares, model.sliding)
        )
        if facts.clearances:
            out += heading("distance from the obstacles, per link")
            out += pictures.clearances(facts.clearances, most=0.5 * model.body.reach)
        return out


def block(html: str) -> str:
    """Text of the panel."""
    return f'<div style="padding:2px 12px;font-size:13px;line-height:1.45;color:{pictures.INK}">{html}</div>'


def heading(words: str) -> str:
    """A heading inside a panel."""
    return block(f"<b>{words}</b>")


def paragraph(words: str, colour: str) -> str:
    """A sentence, escaped."""
    return block(f'<span style="color:{colour}">{escape(words)}</span>')
