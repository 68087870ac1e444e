"""What the explorer shows of one pose: the state and what follows from it, without a browser."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

import redundancy as rd
from redundancy.explorer.arm import Array, Body

SPIN_STEP = np.deg2rad(3.0)
"""Step between the spins that are tried, rad."""
CURVE_SAMPLES = 181
"""Points of the elbow's curve."""
POSTURES = 400
"""Random configurations of which the first one that is shown is chosen."""
LARGEST_TARGET = 1e3
"""Largest coordinate of a target, m."""
NOT_WITHIN = 1e-9
"""How far beyond its limit a joint may be before it is called outside, rad or m: rounding."""


class RefusedError(ValueError):
    """A value from outside that cannot be used; the message says why."""


@dataclass(frozen=True)
class Facts:
    """Figures of the present configuration."""

    margins: dict[str, float]
    """Distance to the nearer position limit per joint, rad or m; joints without limits are left out."""
    manipulability: float | None
    sigma_min: float | None
    kind: str
    clearances: dict[str, float] = field(default_factory=dict)
    """Distance from the obstacles per link, m."""
    self_clearance: tuple[float, str, str] | None = None
    nearest: tuple[Array, Array] | None = None
    """The nearest points of arm and obstacles."""
    nearest_of_links: list[tuple[Array, Array]] = field(default_factory=list)
    """The nearest points of every other link and the obstacles."""


class PoseModel:
    """A pose of the tool, the configurations over it, and the one that is chosen.

    Args:
        chain: The arm.
        q: Configuration to begin with; near the middle of the ranges by default.
        scene: Obstacles, for the clearance.
        links: Shapes of the links, for the clearance.
        freedom: How far the tool may tilt and spin against the gizmo.
        task: Which coordinates of the pose count; all by default.
    """

    def __init__(
        self,
        chain: rd.Chain,
        q: Any = None,
        scene: rd.Scene | None = None,
        links: rd.LinkGeometry | None = None,
        freedom: rd.ToolFreedom | None = None,
        task: str | None = None,
    ) -> None:
        self.chain, self.scene, self.links = chain, scene, links
        self.freedom, self.task = freedom, task
        self.body = Body(chain)
        form = rd.closed_form(chain) if task is None else None
        self.arm: Any = chain if form is None else form
        self.parameter: str | None = getattr(form, "parameter", None)
        self.criteria: dict[str, rd.Criterion] = {"joint range": rd.JointRange(chain)}
        measured = rd.Manipulability(chain, task=task or "pose")
        start = posture(chain) if q is None else checked_q(chain, q)
        if chain.dof >= task_rows(task):
            self.criteria["manipulability"] = measured
        self.criterion = "joint range"
        self.tilt, self.spin = np.zeros(2), 0.0
        self.target: Array = chain.forward(start)
        self.q: Array = start
        self.piece: int | None = None
        self.u = 0.0
        self.reason = ""
        self.solutions = self._solve(self.target)
        self._adopt(start)

    # --- what a user does ---------------------------------------------------------------------------------

    def move(self, pose: Any) -> bool:
        """Place the tool at a pose `(4, 4)` and take the nearest configuration; False when there is none."""
        self.target = checked_pose(pose)
        self.solutions = self._solve(self.wanted)
        return self._adopt(self.q)

    def turn_tool(self, tilt: Any = None, spin: float | None = None) -> bool:
        """Tilt `(2,)` and spin (rad) of the tool against the target, within the freedom."""
        freedom = self.freedom
        if freedom is None:
            raise RefusedError("the tool has no freedom: start with freedom=rd.ToolFreedom(...)")
        if tilt is not None:
            wanted = finite(tilt, (2,), "tilt")
            size = float(np.linalg.norm(wanted))
            self.tilt = wanted * min(1.0, freedom.half_angle / size) if size > 0.0 else wanted
        if spin is not None:
            most = np.pi if freedom.spin == "free" else float(freedom.spin)
            self.spin = float(np.clip(finite(spin, (), "spin"), -most, most))
        return self.move(self.target)

    def choose(self, index: int) -> None:
        """Another piece, at the member nearest to the present configuration."""
        if not 0 <= index < len(self.pieces):
            raise RefusedError(f"there is no piece {index}: this pose has {len(self.pieces)}")
        self.piece, self.u = index, self._nearest_on(index)
        self._take()

    def slide(self, u: float) -> None:
        """Along the present piece, to the parameter `u`."""
        if self.piece is None:
            raise RefusedError(f"there is no curve to slide on: {self.reason}")
        low, high = self.pieces[self.piece].range
        self.u = float(np.clip(finite(u, (), "the slider's value"), low, high))
        self._take()

    def best(self) -> rd.Solution:
        """The best configuration by the chosen criterion."""
        found = self.solutions.best(self.criteria[self.criterion])
        self._accept(found)
        return found

    def nearest(self, q: Any = None) -> rd.Solution:
        """The configuration within the limits that is nearest to `q`, the present one by default."""
        found = self.solutions.nearest(self.q if q is None else checked_q(self.chain, q))
        self._accept(found)
        return found

    def choose_criterion(self, name: str) -> None:
        """The criterion of `best` and of the kind of optimum, by name."""
        if name not in self.criteria:
            raise RefusedError(f"there is no criterion '{name}': {', '.join(self.criteria)}")
        self.criterion = name

    def adopt(self, q: Any) -> None:
        """Show a configuration: the target goes where its tool is."""
        start = checked_q(self.chain, q)
        self.tilt, self.spin = np.zeros(2), 0.0
        self.target = self.chain.forward(start)
        self.solutions = self._solve(self.target)
        self._adopt(start)

    def restore(self, target: Array, q: Array, label: str | None, u: float) -> None:
        """A target, and the configuration that was shown: on the piece of that name, or `q` out of reach."""
        self.q, self.target = q, target
        self.solutions = self._solve(self.wanted)
        self._adopt(q)
        names = [piece.label for piece in self._pieces]
        if label in names:
            self.piece = names.index(label)
            self.slide(u)

    def carry(self, q: Array) -> None:
        """Show a configuration that something else chose, on the way to the target: on no piece."""
        self.q, self.piece, self.reason = q, None, ""

    def set_scene(self, scene: rd.Scene | None) -> None:
        """Other obstacles."""
        self.scene = scene

    # --- what follows -------------------------------------------------------------------------------------

    @property
    def wanted(self) -> Array:
        """The pose that is solved: the target, tilted and spun."""
        if self.freedom is None or not (self.tilt.any() or self.spin):
            return self.target
        axis = np.asarray(self.freedom.axis, dtype=float)
        axis /= np.linalg.norm(axis)
        swing = across(axis) @ self.tilt
        out = self.target.copy()
        out[:3, :3] = out[:3, :3] @ rotation(swing) @ rotation(axis * self.spin)
        return out

    @property
    def pieces(self) -> list[rd.Piece]:
        """All pieces over the pose."""
        return self._pieces

    @property
    def reached(self) -> bool:
        """Whether the configuration shown is at the target."""
        return self.piece is not None

    @property
    def labels(self) -> list[str]:
        """The pieces by name, with the share of each on which all limits hold."""
        return [
            f"{piece.label}: {share_text(piece, arcs)}"
            for piece, arcs in zip(self._pieces, self._arcs, strict=True)
        ]

    def bands(self, index: int | None = None) -> Array:
        """Where all joint limits hold on a piece: `(k, 2)`, as `piece.intervals()`."""
        which = self.piece if index is None else index
        return np.zeros((0, 2)) if which is None else self._arcs[which]

    def within(self, u: Array) -> NDArray[np.bool_]:
        """Whether all limits hold at parameters of the present piece."""
        if self.piece is None:
            return np.zeros(len(u), dtype=bool)
        return inside(self._arcs[self.piece], u, self._pieces[self.piece].closed)

    def spin_bands(self) -> list[tuple[float, float]]:
        """Spins of the tool with a configuration within the limits, by samples; none without a closed form."""
        freedom = self.freedom
        if freedom is None or freedom.spin == 0.0 or self.arm is self.chain:
            return []
        most = np.pi if freedom.spin == "free" else float(freedom.spin)
        kept, spins = self.spin, np.linspace(-most, most, max(3, int(np.ceil(2.0 * most / SPIN_STEP)) + 1))
        good = []
        for spin in spins:
            self.spin = float(spin)
            pieces = rd.solutions(self.arm, self.wanted, task=self.task).pieces
            good.append(any(len(piece.intervals()) for piece in pieces))
        self.spin = kept
        half = 0.5 * float(spins[1] - spins[0])
        parts: list[tuple[float, float]] = []
        for spin in spins[np.array(good)]:
            low, high = max(float(spin) - half, -most), min(float(spin) + half, most)
            if parts and low <= parts[-1][1] + half:
                parts[-1] = (parts[-1][0], high)
            else:
                parts.append((low, high))
        return parts

    def curve(self) -> tuple[str, Array, NDArray[np.bool_]]:
        """The elbow along the present piece: the frame's name, `(N, 3)`, and whether the limits hold there."""
        if self.piece is None or self.solutions.dimension == 0:
            return "", np.zeros((0, 3)), np.zeros(0, dtype=bool)
        piece = self._pieces[self.piece]
        u = np.linspace(*piece.range, CURVE_SAMPLES)
        name, points = self.body.elbow(piece.q(u))
        return name, points, self.within(u)

    def ghosts(self) -> dict[str, Array]:
        """A configuration of every other piece within the limits, by its label."""
        out = {}
        for index, piece in enumerate(self._pieces):
            arcs = self._arcs[index]
            if index == self.piece or not len(arcs):
                continue
            longest = arcs[int(np.argmax(arcs[:, 1] - arcs[:, 0]))]
            out[piece.label] = piece.q(wrapped(float(longest.mean()), piece))
        return out

    @property
    def margins(self) -> Array:
        """Distance to the nearer limit per joint, rad or m; infinite without limits."""
        return np.minimum(self.q - self.chain.lower, self.chain.upper - self.q)

    @property
    def shares(self) -> Array:
        """Margin per joint as a share of half its range: 1 in the middle, 0 at a limit; 1 without limits."""
        half = 0.5 * (self.chain.upper - self.chain.lower)
        out = np.ones(self.chain.dof)
        finite_range = np.isfinite(half) & (half > 0.0)
        out[finite_range] = self.margins[finite_range] / half[finite_range]
        return out

    @property
    def sliding(self) -> list[bool]:
        """Which joints slide."""
        return [bool(np.linalg.norm(axis) < 0.5) for axis in self.chain.jacobian(self.q)[3:].T]

    def facts(self) -> Facts:
        """Figures of the present configuration."""
        margins = {
            name: float(margin)
            for name, margin in zip(self.chain.joint_names, self.margins, strict=True)
            if np.isfinite(margin)
        }
        measure, sigma = self._measures()
        clearances: dict[str, float] = {}
        between, others = None, []
        if self.scene is not None and len(self.scene):
            near = self.scene.clearance(self.chain, self.q, self.shapes)
            clearances = {name: float(one.distance) for name, one in near.by_link.items()}
            between = (near.on_link, near.on_obstacle)
            others = [
                (one.on_link, one.on_obstacle) for name, one in near.by_link.items() if name != near.link
            ]
        own = None
        if self.links is not None and self.links.pairs:
            self_near = self.links.self_clearance(self.q)
            own = (float(self_near.distance), str(self_near.first), str(self_near.second))
        return Facts(margins, measure, sigma, self._kind(), clearances, own, between, others)

    @property
    def shapes(self) -> rd.LinkGeometry | float:
        """What the arm is when it comes near something."""
        return self.body.radius if self.links is None else self.links

    def words(self) -> str:
        """What there is over this pose, in a sentence."""
        if not self.reached:
            return f"{self.solutions.status}: {self.reason}"
        text = self._count()
        return text if not self.reason else f"{text}; {self.reason}"

    # --- inside -------------------------------------------------------------------------------------------

    def _solve(self, pose: Array) -> rd.Solutions:
        found = rd.solutions(self.arm, pose, task=self.task)
        self._pieces = found.pieces
        self._arcs = [piece.intervals() for piece in self._pieces]
        return found

    def _adopt(self, q: Array) -> bool:
        """The configuration nearest to `q`; without one within the limits the piece and parameter that were shown."""
        if not self._pieces:
            self.piece, self.reason = None, self.solutions.reason
            return False
        found = self.solutions.nearest(q)
        if self._accept(found):
            return True
        closest = [(self._distance(i, q), i) for i in range(len(self._pieces))]
        _, index = min(closest)
        self.piece, self.u = index, self._nearest_on(index)
        self._take()
        return True

    def _accept(self, found: rd.Solution) -> bool:
        if found.q is None or found.piece is None:
            self.reason = found.reason
            return False
        self.piece = found.piece.index
        self.u = 0.0 if found.u is None else found.u
        self.q = found.q
        self.reason = ""
        return True

    def _take(self) -> None:
        assert self.piece is not None
        piece = self._pieces[self.piece]
        self.q = piece.q() if self.solutions.dimension == 0 else piece.q(self.u)
        out = np.flatnonzero(self.margins < -NOT_WITHIN)
        self.reason = ""
        if len(out):
            worst = int(out[np.argmin(self.margins[out])])
            name, beyond = self.chain.joint_names[worst], -float(self.margins[worst])
            self.reason = f"joint '{name}' is {beyond:.3f} rad outside its limits"

    def _nearest_on(self, index: int) -> float:
        """Parameter of a piece at which it is nearest to the present configuration, by samples; inside arcs if any."""
        piece, arcs = self._pieces[index], self._arcs[index]
        if self.solutions.dimension == 0:
            return 0.0
        u = np.linspace(*piece.range, CURVE_SAMPLES)
        ok = inside(arcs, u, piece.closed)
        if not ok.any() and len(arcs):
            return wrapped(float(arcs[0].mean()), piece)
        u = u[ok] if ok.any() else u
        return float(u[int(np.argmin(np.linalg.norm(piece.q(u) - self.q, axis=1)))])

    def _distance(self, index: int, q: Array) -> float:
        piece = self._pieces[index]
        if self.solutions.dimension == 0:
            return float(np.linalg.norm(piece.q() - q))
        rows = piece.q(np.linspace(*piece.range, CURVE_SAMPLES))
        return float(np.linalg.norm(rows - q, axis=1).min())

    def _count(self) -> str:
        count, held = len(self._pieces), sum(bool(len(a)) for a in self._arcs)
        noun = "point" if self.solutions.dimension == 0 else "curve"
        plural = "" if count == 1 else "s"
        sure = "" if self.solutions.proven else " found (a finite search)"
        return f"{count} {noun}{plural} of configurations{sure}, {held} within the joint limits"

    def _measures(self) -> tuple[float | None, float | None]:
        measure = self.criteria.get("manipulability")
        if measure is None:
            return None, None
        value = float(np.sqrt(max(0.0, measure.value(self.q))))
        sigma = None
        if self.task is None:
            sigma = float(np.linalg.svd(self.chain.jacobian(self.q), compute_uv=False)[-1])
        return value, sigma

    def _kind(self) -> str:
        if self.solutions.dimension == 0:
            return "isolated configuration"
        found = rd.classify(self.chain, self.q, self.criteria[self.criterion], task=self.task)
        return str(found.kind)


# --- helpers ------------------------------------------------------------------------------------------------


def finite(value: Any, shape: tuple[int, ...], what: str) -> Array:
    """An array of finite numbers of a shape.

    Raises:
        RefusedError: Anything else; it names the value.
    """
    try:
        out = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise RefusedError(f"{what} is no number: {str(value)[:60]}") from None
    if out.shape != shape:
        raise RefusedError(f"{what} has the shape {out.shape}, it must be {shape}")
    if not np.isfinite(out).all():
        raise RefusedError(f"{what} is not finite: {out.tolist()}")
    return out


def checked_pose(pose: Any) -> Array:
    """A rigid pose `(4, 4)` within reach of arithmetic."""
    out = finite(pose, (4, 4), "the pose")
    largest = float(np.abs(out[:3, 3]).max())
    if largest > LARGEST_TARGET:
        raise RefusedError(f"the target is {largest:.3g} m away, at most {LARGEST_TARGET:.0f} m are allowed")
    return out


def checked_q(chain: rd.Chain, q: Any) -> Array:
    """A configuration `(n,)`."""
    return finite(q, (chain.dof,), "q")


def posture(chain: rd.Chain) -> Array:
    """A configuration to begin with: of seeded random ones, in front of the base and far from singular."""
    lower, upper = np.maximum(chain.lower, -np.pi), np.minimum(chain.upper, np.pi)
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    rows: Array = middle + 0.6 * half * np.random.default_rng(0).uniform(-1.0, 1.0, (POSTURES, chain.dof))
    tools = chain.forward(rows)[:, :3, 3] - chain.base[:3, 3]
    jacobians = chain.jacobian(rows)
    measure = np.sqrt(np.maximum(np.linalg.det(jacobians @ jacobians.transpose(0, 2, 1)), 0.0))
    ahead = (tools[:, 0] > 0.0) & (tools[:, 2] > 0.15 * np.linalg.norm(tools, axis=1).max())
    out: Array = rows[int(np.argmax(np.where(ahead, 1.0 + measure, measure)))]
    return out


def task_rows(task: str | None) -> int:
    """Number of coordinates of a task."""
    return {None: 6, "pose": 6, "position": 3, "pointing": 5, "planar": 2, "planar_pose": 3}.get(task, 6)


def inside(arcs: Array, u: Array, closed: bool) -> NDArray[np.bool_]:
    """Whether parameters lie in arcs `(k, 2)`."""
    out = np.zeros(len(u), dtype=bool)
    for low, high in arcs:
        offset = (u - low) % (2.0 * np.pi) if closed else u - low
        out |= (offset >= 0.0) & (offset <= high - low)
    return out


def wrapped(u: float, piece: rd.Piece) -> float:
    """A parameter in the range of its piece."""
    return float((u + np.pi) % (2.0 * np.pi) - np.pi) if piece.closed else u


def share_text(piece: rd.Piece, arcs: Array) -> str:
    """How much of a piece is within the limits, in words."""
    low, high = piece.range
    if high <= low:
        return "within limits" if len(arcs) else "outside limits"
    share = float((arcs[:, 1] - arcs[:, 0]).sum()) / (high - low) if len(arcs) else 0.0
    return "outside limits" if share == 0.0 else f"{100.0 * share:.0f} % within limits"


def across(axis: Array) -> Array:
    """Two unit vectors across an axis, as columns `(3, 2)`: x and y for z."""
    helper = (
        np.eye(3)[int(np.argmin(np.abs(axis)))] if abs(axis[2]) < 1.0 - 1e-12 else np.array([1.0, 0.0, 0.0])
    )
    first = helper - axis * float(axis @ helper)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(axis, first)])


def rotation(vector: Array) -> Array:
    """Rotation matrix of a rotation vector."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    return rd.quaternion.to_matrix(rd.quaternion.from_axis_angle(vector / angle, angle))
