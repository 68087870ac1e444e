"""What is drawn in space, on viser's scene."""

from typing import Any

import numpy as np

import redundancy as rd
from redundancy.explorer import pictures, shapes
from redundancy.explorer.arm import NO_LENGTH, Array, Body, rods, segments, turned_z

LINK = (206, 211, 217)
"""Colour of the links."""
SECOND_LINK = (233, 196, 148)
"""Colour of the links of a second arm."""
LINK_OPACITY = 0.8
"""Of the shapes of links: the joints inside are seen through them."""
GHOST = (120, 140, 165)
GHOST_OPACITY = 0.16
CURVE = 0.006
"""Thickness of the elbow's curve, m per metre of reach."""
UPRIGHT = (1.0, 0.0, 0.0, 0.0)


class ArmDrawing:
    """An arm as rods from frame to frame and a short cylinder on every joint, coloured by its margin.

    Args:
        scene: Of viser.
        name: Its node.
        body: The arm.
        colour: Of the links.
        offset: `(3,)` where its base is drawn, m.
        links: Shapes of the links; rods from frame to frame without them.
    """

    def __init__(
        self,
        scene: Any,
        name: str,
        body: Body,
        colour: tuple[int, int, int] = LINK,
        offset: Any = (0.0, 0.0, 0.0),
        links: rd.LinkGeometry | None = None,
    ) -> None:
        self.body = body
        self.root = scene.add_frame(name, show_axes=False, position=tuple(offset))
        origins = body.origins(np.zeros(body.chain.dof))
        self._apart = np.linalg.norm(np.diff(origins, axis=0), axis=1) > NO_LENGTH
        count, radius = int(self._apart.sum()), body.radius
        vertices, faces = shapes.cylinder()
        ball, ball_faces = shapes.capsule(0.0, 0.99)
        n = body.chain.dof

        def batch(part: str, mesh: Any, triangles: Any, size: int, tint: Any) -> Any:
            return scene.add_batched_meshes_simple(
                f"{name}/{part}",
                mesh.astype(np.float32),
                triangles,
                batched_wxyzs=np.tile(UPRIGHT, (size, 1)),
                batched_positions=np.zeros((size, 3)),
                batched_scales=np.full((size, 3), radius),
                batched_colors=np.tile(np.array(tint, dtype=np.uint8), (size, 1)),
                lod="off",
                cast_shadow=False,
                receive_shadow=False,
            )

        self.links = batch("links", vertices, faces, count, colour)
        self.ends = batch("ends", ball, ball_faces, 2 * count, colour)
        self.joints = batch("joints", vertices, faces, n, pictures.rgb(pictures.BLUE))
        self.joints.batched_scales = np.tile(
            np.array([1.25, 1.25, 2.3], dtype=np.float32) * np.float32(radius), (n, 1)
        )
        self.carriers = self._shapes(scene, name, links, colour)
        if self.carriers:
            self.links.visible = self.ends.visible = False
        self.tool = scene.add_frame(f"{name}/tool", axes_length=2.2 * radius, axes_radius=0.12 * radius)

    def _shapes(
        self, scene: Any, name: str, links: rd.LinkGeometry | None, colour: tuple[int, int, int]
    ) -> dict[int, Any]:
        """The shapes of the links on frames that move with them, by the index of the frame."""
        carriers: dict[int, Any] = {}
        for k, one in enumerate([] if links is None else shapes.of_links(links, self.body)):
            index = self.body.frame_after(one.joints_before - 1) if one.joints_before else -1
            node = f"{name}/link{index}"
            if index not in carriers:
                carriers[index] = scene.add_frame(node, show_axes=False)
            scene.add_mesh_simple(
                f"{node}/{k}",
                np.asarray(one.vertices, dtype=np.float32),
                one.faces,
                color=colour,
                opacity=LINK_OPACITY,
                flat_shading=True,
                cast_shadow=False,
                receive_shadow=False,
            )
        return carriers

    def show(self, q: Array, share: Array) -> None:
        """Draw a configuration; `share` is the margin per joint as a share of half its range."""
        frames = self.body.frames(q)
        origins = frames[:, :3, 3]
        ends = np.stack([origins[:-1], origins[1:]], axis=1)[self._apart]
        wxyz, middle, scale = rods(ends, self.body.radius)
        self.links.batched_wxyzs = wxyz.astype(np.float32)
        self.links.batched_positions = middle.astype(np.float32)
        self.links.batched_scales = scale.astype(np.float32)
        self.ends.batched_positions = ends.reshape(-1, 3).astype(np.float32)
        points, axes = self.body.joints(q)
        self.joints.batched_wxyzs = turned_z(axes).astype(np.float32)
        self.joints.batched_positions = points.astype(np.float32)
        colours = np.array([pictures.rgb(pictures.margin_colour(float(s))) for s in share], dtype=np.uint8)
        if not np.array_equal(colours, self.joints.batched_colors):
            self.joints.batched_colors = colours
        for index, carrier in self.carriers.items():
            if index >= 0:
                carrier.position, carrier.wxyz = frames[index, :3, 3], quaternion(frames[index])
        self.tool.position = frames[-1, :3, 3]
        self.tool.wxyz = quaternion(frames[-1])

    def remove(self) -> None:
        """Take it out of the scene."""
        self.root.remove()


def ghosts(scene: Any, name: str, body: Body, rows: list[Array]) -> None:
    """Faint arms, all in one node."""
    ends = np.concatenate([segments(body.origins(q)) for q in rows]) if rows else np.zeros((0, 2, 3))
    if not len(ends):
        scene.remove_by_name(name)
        return
    vertices, faces = shapes.cylinder()
    wxyz, middle, scale = rods(ends, 0.7 * body.radius)
    handle = scene.get_handle_by_name(name)
    if handle is not None and len(handle.batched_positions) == len(ends):
        handle.batched_wxyzs, handle.batched_positions = wxyz.astype(np.float32), middle.astype(np.float32)
        handle.batched_scales = scale.astype(np.float32)
        return
    scene.add_batched_meshes_simple(
        name,
        vertices.astype(np.float32),
        faces,
        batched_wxyzs=wxyz,
        batched_positions=middle,
        batched_scales=scale,
        batched_colors=GHOST,
        opacity=GHOST_OPACITY,
        lod="off",
        cast_shadow=False,
        receive_shadow=False,
    )


def curve(scene: Any, name: str, points: Array, good: Any, thickness: float) -> None:
    """A line in space, blue where `good`, vermilion elsewhere."""
    if len(points) < 2:
        scene.remove_by_name(name)
        return
    tint = np.where(
        np.asarray(good)[:, None], pictures.rgb(pictures.BLUE), pictures.rgb(pictures.VERMILION)
    ).astype(np.uint8)
    ends = np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)
    colours = np.stack([tint[:-1], tint[:-1]], axis=1)
    handle = scene.get_handle_by_name(name)
    if handle is None or handle.points.shape != ends.shape:
        scene.add_line_segments(name, ends, colours, thickness=thickness)
        return
    handle.points = ends
    if not np.array_equal(handle.colors, colours):
        handle.colors = colours


def lines(scene: Any, name: str, ends: Array, colour: tuple[int, int, int], thickness: float) -> None:
    """Straight lines `(M, 2, 3)`; none removes the node."""
    if not len(ends):
        scene.remove_by_name(name)
        return
    rows = np.asarray(ends, dtype=np.float32)
    handle = scene.get_handle_by_name(name)
    if handle is None or handle.points.shape != rows.shape:
        scene.add_line_segments(name, rows, colour, thickness=thickness)
    else:
        handle.points = rows


def grid(scene: Any, name: str, centre: Array, reach: float) -> None:
    """A square grid on the ground, with lines a fifth of the reach apart."""
    at = np.linspace(-1.6 * reach, 1.6 * reach, 17)
    most, level = np.full_like(at, at[-1]), np.zeros_like(at)
    along = np.stack([np.column_stack([at, -most, level]), np.column_stack([at, most, level])], axis=1)
    rows = np.concatenate([along, along[:, :, [1, 0, 2]]]) + centre
    scene.add_line_segments(
        name, rows.astype(np.float32), (214, 218, 223), thickness=1.0, thickness_units="screen"
    )


def quaternion(pose: Array) -> Array:
    """Quaternion wxyz of a pose."""
    return rd.quaternion.from_matrix(pose[:3, :3])
