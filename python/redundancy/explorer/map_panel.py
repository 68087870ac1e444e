"""Map mode: a slice of a capability map as coloured points."""

from typing import TYPE_CHECKING, Any

import numpy as np

from redundancy.explorer import pictures
from redundancy.explorer.map_model import AXES, MapModel
from redundancy.explorer.pose_panel import paragraph

if TYPE_CHECKING:
    from redundancy.explorer.view import View

POINT = 0.28
"""Radius of a point, in distances of neighbouring cells."""
NODE = "/map"


class MapPanel:
    """Controls and drawing of a `MapModel`.

    Args:
        view: The page.
        model: What is shown.
    """

    def __init__(self, view: "View", model: MapModel) -> None:
        self.view, self.model = view, model
        self.status = view.server.gui.add_html("")
        self.legend: Any = None
        if model.found is not None:
            self._controls()
        self.push()

    def _controls(self) -> None:
        gui, model, on = self.view.server.gui, self.model, self.view.on
        self.shown = gui.add_checkbox("show the slice", True)
        self.layer = gui.add_dropdown("colour by", tuple(model.layers))
        self.legend = gui.add_html("")
        self.axis = gui.add_dropdown("slice across", AXES, initial_value=AXES[model.axis])
        low, high = self._ends()
        self.at = gui.add_slider("at (m)", low, high, self._step(), model.at)
        on(self.shown, "show the map", lambda _: self.push())
        on(self.layer, "layer", self.choose)
        on(self.axis, "slice across", self.turn)
        on(self.at, "slice at", self.cut)

    # --- what a user does ---------------------------------------------------------------------------------

    def choose(self, layer: str) -> None:
        """Another layer."""
        self.model.choose(layer)
        self.push()

    def turn(self, axis: str) -> None:
        """Slices across another axis, from its middle."""
        self.model.cut(axis, self.model.middle(AXES.index(axis)))
        self.push()

    def cut(self, at: float) -> None:
        """Another slice across the same axis."""
        self.model.cut(AXES[self.model.axis], at)
        self.push()

    # --- what is shown ------------------------------------------------------------------------------------

    def _ends(self) -> tuple[float, float]:
        """Ends of the slider; a map of one slice has a slider that cannot move."""
        levels = self.model.levels(self.model.axis)
        low, high = float(levels[0]), float(levels[-1])
        return low, high if high > low else low + self.model.spacing

    def _step(self) -> float:
        """Finer than a cell, so that every slice can be met: ends of the slider need not be multiples of it."""
        return 0.1 * self.model.spacing

    def push(self) -> None:
        """Show the slice."""
        model, scene = self.model, self.view.server.scene
        self.status.content = paragraph(model.words(), pictures.INK)
        if model.found is None:
            return
        low, high = self._ends()
        if (self.at.min, self.at.max) != (low, high):
            self.at.min, self.at.max = low, high
        self.layer.value, self.axis.value, self.at.value = model.layer, AXES[model.axis], model.at
        layer = model.layers[model.layer]
        unit = f" ({layer.unit})" if layer.unit else ""
        self.legend.content = pictures.colour_bar(f"{layer.name}{unit}", layer.low, layer.high)
        places, values = model.cells()
        if not self.shown.value or not len(places):
            scene.remove_by_name(NODE)
            return
        scene.add_point_cloud(
            NODE,
            points=places.astype(np.float32),
            colors=pictures.ramp(values, layer.low, layer.high),
            point_size=POINT * model.spacing,
            point_shape="circle",
            point_shading="flat",
            precision="float32",
        )
