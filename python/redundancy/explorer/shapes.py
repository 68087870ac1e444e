"""Triangles of what is drawn: unit bodies, and obstacles."""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError  # type: ignore[import-untyped]

import redundancy as rd
from redundancy.explorer.arm import Array, Body, turned_z

SIDES = 28
"""Corners of a round outline."""
RINGS = 7
"""Rings of a half sphere."""
SHOWN_PLANE = 2.0
"""Half of the edge of the square that stands for a half-space, m."""
SAME_PLACE = 1e-9
"""Distance below which two points, or two unit vectors, are the same."""
THIN = 1e-3
"""Size below which a body is drawn with this size, m: it could not be seen."""


@dataclass(frozen=True)
class Triangles:
    """A mesh and where it is."""

    vertices: Array
    faces: NDArray[np.uint32]
    wxyz: Array
    position: Array


def cylinder() -> tuple[Array, NDArray[np.uint32]]:
    """Radius 1 about z, from -1/2 to 1/2; the rims are doubled, so that the edges look sharp."""
    angle = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    levels = (-0.5, 0.5, -0.5, 0.5)
    rims = [np.column_stack([ring, np.full(SIDES, z)]) for z in levels]
    vertices = np.vstack([*rims, [[0.0, 0.0, -0.5], [0.0, 0.0, 0.5]]])
    here = np.arange(SIDES)
    after = (here + 1) % SIDES
    side = np.vstack(
        [np.column_stack([here, after, SIDES + after]), np.column_stack([here, SIDES + after, SIDES + here])]
    )
    below = np.column_stack([2 * SIDES + after, 2 * SIDES + here, np.full(SIDES, 4 * SIDES)])
    above = np.column_stack([3 * SIDES + here, 3 * SIDES + after, np.full(SIDES, 4 * SIDES + 1)])
    return vertices, np.vstack([side, below, above]).astype(np.uint32)


def capsule(half: float, radius: float) -> tuple[Array, NDArray[np.uint32]]:
    """About z, its segment from `-half` to `half`; a sphere for 0."""
    polar = np.linspace(0.0, 0.5 * np.pi, RINGS + 1)
    polar = np.concatenate([polar, np.pi - polar[::-1]])
    shift = np.repeat([half, -half], RINGS + 1)
    angle = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)
    rings = [
        np.column_stack(
            [
                radius * np.sin(p) * np.cos(angle),
                radius * np.sin(p) * np.sin(angle),
                np.full(SIDES, radius * np.cos(p) + h),
            ]
        )
        for p, h in zip(polar, shift, strict=True)
    ]
    here = np.arange(SIDES)
    after = (here + 1) % SIDES
    faces = []
    for k in range(len(rings) - 1):
        a, b = k * SIDES, (k + 1) * SIDES
        faces += [
            np.column_stack([a + here, b + here, b + after]),
            np.column_stack([a + here, b + after, a + after]),
        ]
    return np.vstack(rings), np.vstack(faces).astype(np.uint32)


def box(half: Array) -> tuple[Array, NDArray[np.uint32]]:
    """With half extents `(3,)`; every face has its own corners."""
    vertices: list[Array] = []
    faces: list[list[int]] = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            u, v = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
            middle = sign * np.eye(3)[axis]
            corners = [middle + a * u + b * v for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            first = len(vertices)
            vertices += [corner * half for corner in corners]
            order = [(0, 1, 2), (0, 2, 3)] if sign > 0.0 else [(0, 2, 1), (0, 3, 2)]
            faces += [[first + i for i in three] for three in order]
    return np.array(vertices), np.array(faces, dtype=np.uint32)


def cone(half_angle: float, length: float) -> tuple[Array, NDArray[np.uint32]]:
    """Apex at the origin, opening along z."""
    angle = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)
    radius = length * np.sin(half_angle)
    ring = np.column_stack(
        [radius * np.cos(angle), radius * np.sin(angle), np.full(SIDES, length * np.cos(half_angle))]
    )
    here = np.arange(SIDES)
    faces = np.column_stack([np.full(SIDES, SIDES), here, (here + 1) % SIDES])
    return np.vstack([ring, np.zeros((1, 3))]), faces.astype(np.uint32)


@dataclass(frozen=True)
class LinkShape:
    """One shape of a link: the number of joints that move it, and its triangles in the frame that they move."""

    joints_before: int
    vertices: Array
    faces: NDArray[np.uint32]


def of_links(links: rd.LinkGeometry, body: Body) -> list[LinkShape]:
    """The shapes of a geometry, each in the frame of `body` that moves with it (in the world for 0 joints).

    A geometry keeps them in the frames of the joints, with z along the joint's axis. Where those are not the frames of
    the links with that turn (arms of Denavit-Hartenberg rows), nothing is returned and rods are drawn.
    """
    frames = body.frames(np.zeros(body.chain.dof))
    turns = joint_frames(body, frames)
    if turns is None:
        return []
    out = []
    for one in kept(links):
        vertices, faces = of_body(one["kind"], one["numbers"], float(one["radius"]))
        before = int(one["joints_before"])
        turn = np.array(one["rotation"]).reshape(3, 3).T  # column by column
        vertices = vertices @ turn.T + np.array(one["origin"])
        if before > 0:
            vertices = vertices @ turns[before - 1].T
        out.append(LinkShape(before, vertices, faces))
    return out


def kept(links: rd.LinkGeometry) -> list[dict[str, Any]]:
    """The shapes as a geometry pickles them."""
    text: Any = links.__reduce__()[1]
    shapes: list[dict[str, Any]] = json.loads(text[1])["bodies"]
    return shapes


def joint_frames(body: Body, frames: Array) -> list[Array] | None:
    """Per joint the rotation from its own frame, z along its axis, to the link that it moves; None if it is not one.

    Checked with the capsules from joint to joint, whose ends are known in both frames.
    """
    chain = body.chain
    jacobian = chain.jacobian(np.zeros(chain.dof))
    turns = []
    for j in range(chain.dof):
        column = jacobian[3:, j] if np.linalg.norm(jacobian[3:, j]) > 0.5 else jacobian[:3, j]
        turns.append(axis_onto_z(frames[body.frame_after(j)][:3, :3].T @ column))
    for one in kept(rd.LinkGeometry(chain, body.radius)):
        j = int(one["joints_before"]) - 1
        at = frames[body.frame_after(j)]
        end = at[:3, :3] @ turns[j] @ (2.0 * np.array(one["origin"])) + at[:3, 3]
        expected = frames[body.frame_after(j + 1)][:3, 3] if j + 1 < chain.dof else frames[-1][:3, 3]
        if np.linalg.norm(end - expected) > SAME_PLACE:
            return None
    return turns


def axis_onto_z(axis: Array) -> Array:
    """The rotation whose z is an axis and whose x and y the library chooses for it; the identity for z itself."""
    z = axis / np.linalg.norm(axis)
    if np.linalg.norm(z - np.array([0.0, 0.0, 1.0])) < SAME_PLACE:
        return np.eye(3)
    y = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    y /= np.linalg.norm(y)
    return np.column_stack([np.cross(y, z), y, z])


def of_body(kind: str, numbers: Any, radius: float) -> tuple[Array, NDArray[np.uint32]]:
    """Triangles of a shape in its own coordinates; a radius around a box, cylinder or hull is not drawn."""
    if kind == "sphere":
        return capsule(0.0, max(radius, THIN))
    if kind == "capsule":
        half = np.array(numbers)
        length = float(np.linalg.norm(half))
        vertices, faces = capsule(length, max(radius, THIN))
        if length > 0.0:
            vertices = vertices @ rd.quaternion.to_matrix(turned_z(half[None] / length)[0]).T
        return vertices, faces
    if kind == "box":
        return box(np.maximum(numbers, THIN))
    if kind == "cylinder":
        vertices, faces = cylinder()
        return vertices * np.maximum((numbers[0], numbers[0], 2.0 * numbers[1]), THIN), faces
    return hull(np.array(numbers))


def hull(points: Array) -> tuple[Array, NDArray[np.uint32]]:
    """Triangles of a convex hull, seen from outside; flat ones are drawn as a small box around them."""
    try:
        found = ConvexHull(points)
    except QhullError:
        middle, half = 0.5 * (points.max(axis=0) + points.min(axis=0)), 0.5 * np.ptp(points, axis=0)
        vertices, faces = box(np.maximum(half, THIN))
        return vertices + middle, faces
    corners = points[found.simplices]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normals, found.equations[:, :3]) < 0.0
    faces = np.where(inward[:, None], found.simplices[:, ::-1], found.simplices)
    return points, faces.astype(np.uint32)


def of_obstacle(obstacle: Any) -> Triangles:
    """An obstacle as it stands in the world."""
    upright, origin = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
    if isinstance(obstacle, rd.Sphere):
        vertices, faces = capsule(0.0, max(obstacle.radius, THIN))
        return Triangles(vertices, faces, upright, obstacle.center)
    if isinstance(obstacle, rd.Capsule):
        along = obstacle.end - obstacle.start
        length = float(np.linalg.norm(along))
        vertices, faces = capsule(0.5 * length, max(obstacle.radius, THIN))
        wxyz = turned_z(along[None] / length)[0] if length > 0.0 else upright
        return Triangles(vertices, faces, wxyz, 0.5 * (obstacle.start + obstacle.end))
    if isinstance(obstacle, rd.HalfSpace):
        vertices, faces = box(np.array([SHOWN_PLANE, SHOWN_PLANE, THIN]))
        wxyz = turned_z(obstacle.normal[None])[0]
        return Triangles(vertices, faces, wxyz, obstacle.point - THIN * obstacle.normal)
    pose = obstacle.pose
    wxyz = rd.quaternion.from_matrix(pose[:3, :3])
    if isinstance(obstacle, rd.Box):
        vertices, faces = box(np.maximum(obstacle.half_extents, THIN))
    elif isinstance(obstacle, rd.Cylinder):
        vertices, faces = cylinder()
        sizes = (obstacle.radius, obstacle.radius, 2.0 * obstacle.half_length)
        vertices = vertices * np.maximum(sizes, THIN)
    else:
        vertices, faces = obstacle.vertices, obstacle.faces
    return Triangles(vertices, faces, wxyz, pose[:3, 3] + origin)
