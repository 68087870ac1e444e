"""Obstacles that can be added, moved and resized; no browser."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import redundancy as rd
from redundancy.explorer.arm import Array, turned_z
from redundancy.explorer.model import RefusedError, checked_pose, finite

SIZES: dict[str, tuple[str, ...]] = {
    "sphere": ("radius",),
    "box": ("half x", "half y", "half z"),
    "capsule": ("radius", "half length"),
    "cylinder": ("radius", "half length"),
    "half_space": (),
    "mesh": (),
}
"""What can be resized, by kind."""
LARGEST_SIZE = 100.0
"""Largest size of an obstacle, m."""
MOST_OBSTACLES = 200
"""Obstacles at most: a page cannot draw any number of them."""


@dataclass(frozen=True)
class Obstacle:
    """One obstacle: its kind, where it is, how large."""

    kind: str
    name: str
    pose: Array
    sizes: tuple[float, ...]
    source: Any = None
    """The obstacle that it was made from: velocity, link, triangles."""

    @property
    def attached_to(self) -> str | None:
        """The link that carries it; its pose is then in the frame of that link."""
        return None if self.source is None else self.source.attached_to

    def built(self) -> Any:
        """The obstacle of the library."""
        options: dict[str, Any] = {"name": self.name}
        if self.source is not None:
            if self.source.velocity.any():
                options["velocity"] = self.source.velocity
            if self.source.attached_to is not None:
                options["attached_to"] = self.source.attached_to
        centre, axis = self.pose[:3, 3], self.pose[:3, 2]
        if self.kind == "sphere":
            return rd.Sphere(centre, self.sizes[0], **options)
        if self.kind == "box":
            return rd.Box(self.pose, self.sizes, **options)
        if self.kind == "capsule":
            half = axis * self.sizes[1]
            return rd.Capsule(centre - half, centre + half, self.sizes[0], **options)
        if self.kind == "cylinder":
            return rd.Cylinder(self.pose, self.sizes[0], self.sizes[1], **options)
        if self.kind == "half_space":
            return rd.HalfSpace(centre, axis, **options)
        return rd.Mesh(
            self.source.vertices, self.source.faces, pose=self.pose, solid=self.source.solid, **options
        )


class SceneModel:
    """The obstacles of the page.

    Args:
        scene: Obstacles to begin with.
    """

    def __init__(self, scene: rd.Scene | None = None) -> None:
        self.obstacles: list[Obstacle] = []
        self.allowed: list[tuple[str, str]] = []
        self.selected: int | None = None
        self.scene = rd.Scene([])
        if scene is not None:
            self.set_scene(scene)

    def set_scene(self, scene: rd.Scene) -> None:
        """Other obstacles instead of all."""
        names: list[str] = []
        obstacles = []
        for one in scene.obstacles:
            kind = kind_of(one)
            names.append(free_name(one.name or kind, names))
            obstacles.append(Obstacle(kind, names[-1], pose_of(one), sizes_of(one), one))
        self._replace(obstacles, None, list(scene.allowed))

    def select(self, index: int | None) -> None:
        """The obstacle that is dragged and resized."""
        if index is not None and not 0 <= index < len(self.obstacles):
            raise RefusedError(f"there is no obstacle {index}, the scene has {len(self.obstacles)}")
        self.selected = index

    def add(self, kind: str, position: Any, size: float) -> None:
        """One more obstacle, which is then selected."""
        if kind not in SIZES or not SIZES[kind]:
            raise RefusedError(f"there is no obstacle '{kind}': sphere, box, capsule or cylinder")
        if len(self.obstacles) >= MOST_OBSTACLES:
            raise RefusedError(f"the scene has {MOST_OBSTACLES} obstacles, more are not drawn")
        pose = np.eye(4)
        pose[:3, 3] = finite(position, (3,), "the position")
        name = free_name(kind, [one.name for one in self.obstacles])
        one = Obstacle(kind, name, pose, checked_sizes((size,) * len(SIZES[kind])))
        self._replace([*self.obstacles, one], len(self.obstacles))

    def remove(self) -> None:
        """Without the selected obstacle."""
        index = self._chosen()
        self._replace([o for k, o in enumerate(self.obstacles) if k != index], None)

    def move(self, pose: Any) -> None:
        """The selected obstacle to a pose `(4, 4)`."""
        self._change(pose=checked_pose(pose))

    def resize(self, sizes: Any) -> None:
        """The selected obstacle with other sizes, m."""
        one = self.obstacles[self._chosen()]
        values = tuple(sizes)[: len(one.sizes)]
        if len(values) != len(one.sizes):
            raise RefusedError(f"a {one.kind} has {len(one.sizes)} sizes, {len(values)} were given")
        self._change(sizes=checked_sizes(values))

    def _chosen(self) -> int:
        if self.selected is None:
            raise RefusedError("no obstacle is chosen")
        return self.selected

    def _change(self, **what: Any) -> None:
        index = self._chosen()
        changed = list(self.obstacles)
        changed[index] = replace(changed[index], **what)
        self._replace(changed, index)

    def _replace(
        self, obstacles: list[Obstacle], selected: int | None, allowed: list[tuple[str, str]] | None = None
    ) -> None:
        """All or nothing: what the library refuses leaves everything as it was."""
        names = {one.name for one in obstacles}
        pairs = self.allowed if allowed is None else allowed
        gone = {one.name for one in self.obstacles} - names
        pairs = [pair for pair in pairs if not gone & set(pair)]
        scene = rd.Scene([one.built() for one in obstacles], allowed=pairs)
        self.obstacles, self.allowed, self.scene, self.selected = obstacles, pairs, scene, selected


def checked_sizes(sizes: Any) -> tuple[float, ...]:
    """Sizes that a scene can have, m."""
    values = finite(sizes, (len(sizes),), "the size")
    for value in values:
        if not 0.0 < value <= LARGEST_SIZE:
            raise RefusedError(f"the size is {value:g} m, it must be above 0 and at most {LARGEST_SIZE:g} m")
    return tuple(float(v) for v in values)


def kind_of(obstacle: Any) -> str:
    """The word of scene files for a kind of obstacle."""
    return {"HalfSpace": "half_space"}.get(type(obstacle).__name__, type(obstacle).__name__.lower())


def pose_of(obstacle: Any) -> Array:
    """Where an obstacle is: z along the axis of a capsule and the normal of a half-space."""
    out = np.eye(4)
    if isinstance(obstacle, rd.Sphere):
        out[:3, 3] = obstacle.center
    elif isinstance(obstacle, rd.Capsule | rd.HalfSpace):
        along = obstacle.normal if isinstance(obstacle, rd.HalfSpace) else obstacle.end - obstacle.start
        length = float(np.linalg.norm(along))
        if length > 0.0:
            out[:3, :3] = rd.quaternion.to_matrix(turned_z(along[None] / length)[0])
        middle = (
            obstacle.point if isinstance(obstacle, rd.HalfSpace) else 0.5 * (obstacle.start + obstacle.end)
        )
        out[:3, 3] = middle
    else:
        out = np.array(obstacle.pose)
    return out


def sizes_of(obstacle: Any) -> tuple[float, ...]:
    """What can be resized of an obstacle."""
    if isinstance(obstacle, rd.Sphere):
        return (obstacle.radius,)
    if isinstance(obstacle, rd.Box):
        return tuple(float(v) for v in obstacle.half_extents)
    if isinstance(obstacle, rd.Capsule):
        return obstacle.radius, 0.5 * float(np.linalg.norm(obstacle.end - obstacle.start))
    if isinstance(obstacle, rd.Cylinder):
        return obstacle.radius, obstacle.half_length
    return ()


def free_name(wanted: str, taken: list[str]) -> str:
    """A name that no obstacle has."""
    if wanted not in taken:
        return wanted
    return next(f"{wanted} {k}" for k in range(2, len(taken) + 3) if f"{wanted} {k}" not in taken)
