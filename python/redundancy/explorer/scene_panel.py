"""Scene mode: obstacles added, dragged and resized; the path is planned again when they change."""

from typing import TYPE_CHECKING, Any

import numpy as np

import redundancy as rd
from redundancy.explorer import drawing, pictures, shapes
from redundancy.explorer.pose_panel import paragraph
from redundancy.explorer.scene_model import SIZES, SceneModel

if TYPE_CHECKING:
    from redundancy.explorer.view import View

NONE = "none"
OBSTACLE = (150, 110, 160)
CHOSEN = (190, 120, 60)
NEW_SIZE = 0.08
"""Size of a new obstacle, in reaches."""


class ScenePanel:
    """Controls and drawing of a `SceneModel`.

    Args:
        view: The page.
        model: What is shown.
    """

    def __init__(self, view: "View", model: SceneModel) -> None:
        self.view, self.model = view, model
        gui, scene = view.server.gui, view.server.scene
        self.status = gui.add_html("")
        self.chosen = gui.add_dropdown("obstacle", (NONE,), hint="The one that the gizmo moves")
        self.kinds = tuple(kind for kind, sizes in SIZES.items() if sizes)
        self.add = gui.add_button_group("add", self.kinds)
        self.sizes = [gui.add_number(f"size {k + 1}", 0.1, step=0.001, visible=False) for k in range(3)]
        self.remove = gui.add_button("remove it", disabled=True)
        self.replan = gui.add_checkbox("re-plan on change", True)
        self.progress = gui.add_progress_bar(0.0)
        self.cancel = gui.add_button("cancel the plan")
        self.outcome = gui.add_html("")
        self.gizmo = scene.add_transform_controls(
            "/obstacle_gizmo",
            scale=0.22 * view.pose.body.reach,
            line_width=3.0,
            depth_test=False,
            visible=False,
        )
        self._drawn: list[str] = []
        self._listen()
        self.push()

    def _listen(self) -> None:
        on, view = self.view.on, self.view
        on(self.chosen, "obstacle", self.select)
        for handle in self.sizes:
            on(handle, "size", lambda _: self.resize())

        @self.add.on_click
        async def _(event: Any) -> None:
            kind = event.target.value
            view.post(f"add {kind}", lambda: self.add_one(kind))

        @self.remove.on_click
        async def _(_: Any) -> None:
            view.post("remove", self.remove_one)

        @self.cancel.on_click
        async def _(_: Any) -> None:
            view.path_panel.cancel()

        @self.gizmo.on_update
        async def _(event: Any) -> None:
            position, wxyz = np.array(event.target.position), np.array(event.target.wxyz)
            ended = event.phase == "end"
            view.post("obstacle moved", lambda: self.move(position, wxyz, ended))

    # --- what a user does ---------------------------------------------------------------------------------

    def select(self, name: str) -> None:
        """Choose an obstacle by name."""
        names = [one.name for one in self.model.obstacles]
        self.model.select(names.index(name) if name in names else None)
        self.push()

    def add_one(self, kind: str) -> None:
        """One more, beside the arm."""
        body = self.view.pose.body
        base = self.view.pose.chain.base[:3, 3]
        self.model.add(kind, base + body.reach * np.array([0.35, -0.35, 0.35]), NEW_SIZE * body.reach)
        self.changed()

    def remove_one(self) -> None:
        """Without the chosen one."""
        self.model.remove()
        self.changed()

    def move(self, position: Any, wxyz: Any, ended: bool = True) -> None:
        """The gizmo was dragged; the path is planned again at the end of the drag."""
        try:
            size = max(float(np.linalg.norm(wxyz)), 1e-300)
            self.model.move(rd.pose(position, quaternion_wxyz=np.asarray(wxyz) / size))
        except (ValueError, rd.RedundancyError):
            self.push()
            raise
        self.changed(ended)

    def resize(self) -> None:
        """A size was entered."""
        try:
            self.model.resize([handle.value for handle in self.sizes])
        except (ValueError, rd.RedundancyError):
            self.push()
            raise
        self.changed()

    def changed(self, plan: bool = True) -> None:
        """The obstacles are other ones."""
        self.push()
        self.view.scene_changed(plan and bool(self.replan.value))

    # --- what is shown ------------------------------------------------------------------------------------

    def push(self) -> None:
        """Show the obstacles."""
        model, scene = self.model, self.view.server.scene
        names = (NONE, *(one.name for one in model.obstacles))
        if names != tuple(self.chosen.options):
            self.chosen.options = names
        chosen = None if model.selected is None else model.obstacles[model.selected]
        self.chosen.value = NONE if chosen is None else chosen.name
        self.remove.disabled = chosen is None
        labels = () if chosen is None else SIZES[chosen.kind]
        for k, handle in enumerate(self.sizes):
            handle.visible = k < len(labels)
            if chosen is not None and k < len(labels):
                handle.label, handle.value = f"{labels[k]} (m)", chosen.sizes[k]
        movable = chosen is not None and chosen.attached_to is None
        self.gizmo.visible = movable
        if chosen is not None and movable:
            self.gizmo.position, self.gizmo.wxyz = chosen.pose[:3, 3], drawing.quaternion(chosen.pose)
        nodes = []
        for k, (one, built) in enumerate(zip(model.obstacles, model.scene.obstacles, strict=True)):
            nodes.append(f"/obstacles/{k}")
            drawn = shapes.of_obstacle(built)
            scene.add_mesh_simple(
                nodes[-1],
                np.asarray(drawn.vertices, dtype=np.float32),
                np.asarray(drawn.faces, dtype=np.uint32),
                color=CHOSEN if one is chosen else OBSTACLE,
                opacity=0.3 if one.kind == "half_space" else 0.85,
                flat_shading=one.kind in {"mesh"},
                wxyz=drawn.wxyz,
                position=drawn.position,
                cast_shadow=False,
                receive_shadow=False,
            )
        for gone in set(self._drawn) - set(nodes):
            scene.remove_by_name(gone)
        self._drawn = nodes
        self.carry(self.view.pose.q)
        count = len(model.obstacles)
        words = "no obstacles" if count == 0 else f"{count} obstacle{'' if count == 1 else 's'}"
        self.status.content = paragraph(f"{words}; choose one to drag and resize it", pictures.INK)

    def show_plan(self) -> None:
        """What became of the plan for these obstacles."""
        model = self.view.path
        good = all(line.plan.legal for line in model.lines)
        self.outcome.content = paragraph(model.words(), pictures.INK if good else pictures.VERMILION)

    def carry(self, q: Any) -> None:
        """Draw obstacles that a link carries where the link is."""
        chain = self.view.pose.chain
        for node, one, built in zip(
            self._drawn, self.model.obstacles, self.model.scene.obstacles, strict=False
        ):
            link = one.attached_to
            handle = self.view.server.scene.get_handle_by_name(node) if link is not None else None
            if handle is None or link not in chain.link_names:
                continue
            at, drawn = chain.forward(q, link=link), shapes.of_obstacle(built)
            inner = np.eye(4)
            inner[:3, :3], inner[:3, 3] = rd.quaternion.to_matrix(drawn.wxyz), drawn.position
            handle.position, handle.wxyz = (at @ inner)[:3, 3], drawing.quaternion(at @ inner)
