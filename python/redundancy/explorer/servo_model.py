"""A servo that follows the gizmo: its limits, its ticks and what a page shows of them; no browser."""

import threading
from collections import deque
from dataclasses import dataclass

import numpy as np

import redundancy as rd
from redundancy.explorer.arm import Array
from redundancy.explorer.model import RefusedError, checked_pose, checked_q

DT = 0.01
"""Length of a tick, s."""
FULL_SPEED = 0.5
"""Time in which a joint without an acceleration limit reaches its full speed, s."""
WITHOUT_SPEED = 10.0
"""Acceleration limit of a joint without any other limit, rad/s^2 or m/s^2."""
JERK = 20.0
"""Jerk limits, as accelerations per second: the acceleration builds up within a twentieth of a second."""
STILL = 1e-3
"""Largest share of a joint's speed limit at which the arm is said to stand still."""
FAR = 1e-3
"""Distance from the target that is worth a word when the arm stands still, m."""
KEPT_SECONDS = 10.0
"""Length of the history."""
KEPT_EVERY = 4
"""Ticks per row of the history."""


@dataclass(frozen=True)
class Tick:
    """One tick, as the page shows it."""

    time: float
    """Since the start of the servo, s."""
    q: Array
    qd: Array
    qdd: Array
    status: str
    reason: str
    position_error: float
    """Distance of the tool from the target, m."""
    orientation_error: float
    """Angle of the tool to the target, rad."""
    scale: float
    time_to_stop: float
    """s; infinite if none is seen."""
    limits: list[tuple[str, str, str]]
    """Limits that acted: joint, which limit, which side."""


class ServoModel:
    """A servo that moves an arm after a target, one call of `tick` every `dt` seconds.

    `aim` and `tick` may be called from different threads.

    Args:
        chain: The arm.
        dt: Length of a tick, s.
    """

    def __init__(self, chain: rd.Chain, dt: float = DT) -> None:
        self.chain, self.dt = chain, dt
        self.velocity_limits = np.asarray(chain.velocity_limit, dtype=float)
        own = np.asarray(chain.acceleration_limit, dtype=float)
        guess = np.where(np.isfinite(self.velocity_limits), self.velocity_limits / FULL_SPEED, WITHOUT_SPEED)
        self.given = np.isfinite(own)
        """Which acceleration limits are the arm's; the others are assumed."""
        self.acceleration_limits: Array = np.where(self.given, own, guess)
        self.jerk_limits: Array = JERK * self.acceleration_limits
        self._lock = threading.Lock()
        self._servo: rd.Servo | None = None
        self._target: Array = np.eye(4)
        self._latest: Tick | None = None
        self._ticks = 0
        self._history: deque[tuple[float, float, float]] = deque(maxlen=int(KEPT_SECONDS / (dt * KEPT_EVERY)))

    def start(self, q: Array, target: Array) -> None:
        """From rest at `q`, towards `target`.

        Raises:
            RefusedError: A configuration outside of the limits; the message names joint, value and bound.
        """
        start, aim = checked_q(self.chain, q), checked_pose(target)
        try:
            servo = rd.Servo(
                self.chain,
                self.dt,
                acceleration_limits=self.acceleration_limits,
                jerk_limits=self.jerk_limits,
                target_noise=None,
            )
            servo.reset(start)
        except rd.RedundancyError as error:
            raise RefusedError(f"the servo cannot start here: {error}") from error
        with self._lock:
            self._servo, self._target, self._latest, self._ticks = servo, aim, None, 0
            self._history.clear()

    def aim(self, target: Array) -> None:
        """Another target, from the next tick on."""
        checked = checked_pose(target)
        with self._lock:
            self._target = checked

    @property
    def target(self) -> Array:
        """The pose that is followed."""
        return self._target

    def tick(self) -> None:
        """One step of the servo."""
        with self._lock:
            servo, target = self._servo, self._target
        if servo is None:
            raise RefusedError("the servo was not started")
        out = servo.update(target)
        distance, angle = errors(self.chain.forward(out.q), target)
        now = Tick(
            self._ticks * self.dt,
            out.q,
            out.qd,
            out.qdd,
            str(out.status),
            out.reason or "",
            distance,
            angle,
            out.scale,
            out.time_to_stop,
            list(out.active_limits),
        )
        with self._lock:
            if self._ticks % KEPT_EVERY == 0:
                self._history.append((now.time, 1e3 * distance, self._speed(now)))
            self._ticks += 1
            self._latest = now

    @property
    def latest(self) -> Tick | None:
        """The last tick; None before the first one."""
        return self._latest

    def history(self) -> Array:
        """Rows `(N, 3)` of the last seconds: time (s), distance from the target (mm), largest share of a speed."""
        with self._lock:
            return np.array(self._history).reshape(-1, 3)

    def speeds(self, tick: Tick) -> Array:
        """Joint speeds as shares of their limits `(n,)`; 0 without a limit."""
        out: Array = np.abs(tick.qd) / self.velocity_limits
        return out

    def _speed(self, tick: Tick) -> float:
        return float(self.speeds(tick).max())

    def words(self) -> str:
        """What the servo does, in a sentence."""
        now = self._latest
        if now is None:
            return "the servo is off"
        meaning = {
            "converged": "on the target",
            "tracking": "behind the target",
            "unreachable": "the target is out of reach",
            "limits": "a joint limit keeps the tool away from the target",
            "no_target": "no target",
        }.get(now.status, now.status)
        words = f"{now.status}: {now.reason or meaning}"
        if self._speed(now) < STILL and now.position_error > FAR:
            words += f"; the arm stands still {1e3 * now.position_error:.0f} mm from the target"
        return words


def limit_words(limits: list[tuple[str, str, str]]) -> str:
    """What limits the step, in words."""
    if not limits:
        return "nothing"
    return ", ".join(f"{joint} {which} ({side})" for joint, which, side in limits)


def errors(pose: Array, target: Array) -> tuple[float, float]:
    """Distance (m) and angle (rad) of two poses."""
    turn = pose[:3, :3].T @ target[:3, :3]
    w = rd.quaternion.from_matrix(turn)
    angle = 2.0 * float(np.arctan2(np.linalg.norm(w[1:]), abs(w[0])))
    return float(np.linalg.norm(target[:3, 3] - pose[:3, 3])), angle
