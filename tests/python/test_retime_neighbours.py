"""`retime` beside toppra, a direct transcription by IPOPT, and Ruckig.

Seeded subsets by default, all 200 paths with REDUNDANCY_TEST_FULL=1. Run as a script this file prints the figures.
"""

import itertools
import os
import sys
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from joint_paths import COUNT, GOLDEN, JointPath, curve, joint_path, random_smooth

import redundancy as rd

FULL = os.environ.get("REDUNDANCY_TEST_FULL") == "1"
PATHS = range(COUNT) if FULL else (0, 1, 3, 57, 112, 118, 120, 194)
SMOOTH = range(20) if FULL else (0, 4)
LINES = 200 if FULL else 40
FINER = 10
FR3_ACCELERATION, FR3_JERK = 10.0, 5000.0
SLACK = 1e-6
"""Relative excess of a limit that is rounding."""
COARSE = 0.02
"""Excess of toppra's motion between its gridpoints above which it is no reference as it stands."""


def finer(t: np.ndarray) -> np.ndarray:
    """Times ten times as dense as `t`, its own included, both sides of each row."""
    u = np.linspace(1e-9, 1 - 1e-9, FINER + 1)
    return np.append((t[:-1, None] + u * np.diff(t)[:, None]).ravel(), t[-1])


def excess(chain, states, velocity, acceleration, torque=None, jerk=None) -> float:
    """Largest share of a limit minus 1, at the most 0 where all hold."""
    q, qd, qdd, qddd = states
    worst = max(np.abs(qd / velocity).max(), np.abs(qdd / acceleration).max())
    if jerk is not None:
        worst = max(worst, np.abs(qddd / jerk).max())
    if torque is not None:
        tau = np.array([chain.inverse_dynamics(*row) for row in zip(q, qd, qdd, strict=True)])
        worst = max(worst, np.abs(tau / torque).max())
    return max(worst - 1.0, 0.0)


def chords(q: np.ndarray) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(q, axis=0), axis=1))])


@dataclass
class Toppra:
    """The same stretches by toppra, each from rest to rest."""

    duration: float = 0.0
    excess: float = 0.0
    problems: list[Any] = field(default_factory=list)

    def solve(self, case: JointPath, stops: list[int], judge: bool = True, density: int = 1) -> "Toppra":
        for job in self.prepare(case, stops, density):
            trajectory = job()
            if trajectory is None:
                self.duration = np.inf
                return self
            self.duration += trajectory.duration
            if judge:
                times = np.asarray(trajectory.spline.x) if hasattr(trajectory, "spline") else None
                times = (
                    np.linspace(0, trajectory.duration, FINER * len(case.q))
                    if times is None
                    else finer(times)
                )
                states = [trajectory(times, order) for order in range(3)]
                over = excess(
                    case.chain, (*states, None), case.chain.velocity_limit, case.acceleration, case.torque
                )
                self.excess = max(self.excess, over)
        return self

    def prepare(self, case: JointPath, stops: list[int], density: int = 1) -> list[Any]:
        """A job per stretch: everything that a user of toppra calls again for another path is inside."""
        import toppra
        from toppra import algorithm as algo
        from toppra import constraint

        toppra.setup_logging("ERROR")
        between = constraint.DiscretizationType.Interpolation
        both = lambda limit: np.stack([-limit, limit], axis=1)  # noqa: E731

        def job(rows):
            s = chords(rows)
            path = toppra.SplineInterpolator(s, rows, "not-a-knot" if len(rows) > 3 else "natural")
            limits = [
                constraint.JointVelocityConstraint(both(case.chain.velocity_limit)),
                constraint.JointAccelerationConstraint(
                    both(case.acceleration), discretization_scheme=between
                ),
            ]
            if case.torque is not None:
                limits.append(
                    constraint.JointTorqueConstraint(
                        case.chain.inverse_dynamics,
                        both(case.torque),
                        np.zeros(case.chain.dof),
                        discretization_scheme=between,
                    )
                )
            parts = density * max(1, -(-100 // (len(s) - 1)))
            grid = np.interp(np.linspace(0, len(s) - 1, (len(s) - 1) * parts + 1), np.arange(len(s)), s)
            solver = algo.TOPPRA(limits, path, gridpoints=grid, parametrizer="ParametrizeConstAccel")
            return solver.compute_trajectory(0, 0)

        cuts = [0, *stops, len(case.q) - 1]
        return [lambda a=a, b=b: job(case.q[a : b + 1]) for a, b in itertools.pairwise(cuts)]


def second_order(case: JointPath) -> rd.RetimedTrajectory:
    return rd.retime(case.chain, case.q, acceleration_limits=case.acceleration, torque_limits=case.torque)


def third_order(case: JointPath, kind: str) -> tuple[rd.RetimedTrajectory, np.ndarray, np.ndarray]:
    """Jerk limits of two kinds: `fr3`, constant, and `slow`, five times the acceleration limits per second."""
    n = case.chain.dof
    acceleration = np.full(n, FR3_ACCELERATION) if kind == "fr3" else case.acceleration
    jerk = np.full(n, FR3_JERK) if kind == "fr3" else 5.0 * acceleration
    return (
        rd.retime(case.chain, case.q, acceleration_limits=acceleration, jerk_limits=jerk),
        acceleration,
        jerk,
    )


@dataclass
class Beside:
    """One path by both."""

    name: str
    rows: int
    stops: int
    ours: float
    theirs: float
    excess: float
    their_excess: float
    stretched: float


def beside_toppra(index: int) -> Beside:
    case = joint_path(index)
    move = second_order(case)
    their = Toppra().solve(case, move.stops)
    over = excess(
        case.chain, move.sample(finer(move.t)), case.chain.velocity_limit, case.acceleration, case.torque
    )
    return Beside(
        case.name,
        len(case.q),
        len(move.stops),
        move.t[-1],
        their.duration,
        over,
        their.excess,
        move.stretched,
    )


def with_jerk(index: int, kind: str) -> Beside:
    case = joint_path(index)
    move, acceleration, jerk = third_order(case, kind)
    over = excess(case.chain, move.sample(finer(move.t)), case.chain.velocity_limit, acceleration, jerk=jerk)
    free = rd.retime(case.chain, case.q, acceleration_limits=acceleration).t[-1]
    return Beside(case.name, len(case.q), len(move.stops), move.t[-1], free, over, 0.0, move.stretched)


def transcription(index: int, intervals: int = 150) -> tuple[float, float]:
    """Durations of a smooth path with slow jerk limits: ours, and the best that IPOPT finds from ours and from slow.

    The unknowns are the duration and, at evenly spaced times, the curve's parameter u and its three derivatives; the
    jerk of u is constant between. The limits are asked for at both ends of each interval.
    """
    import casadi as ca

    chain = rd.catalog.load("panda")
    q, waves = random_smooth(chain, 300, 9000 + index)
    acceleration = chain.acceleration_limit
    jerk = 5.0 * acceleration
    move = rd.retime(chain, q, jerk_limits=jerk)
    middle, a, f, phase, b, g = (ca.DM(w) for w in waves)
    u, v, w, j = (ca.SX.sym(name) for name in "uvwj")
    rows = middle + a * ca.sin(f * u + phase) + b * ca.cos(g * u)
    first = ca.jacobian(rows, u)
    second = ca.jacobian(first, u)
    third = ca.jacobian(second, u)
    limits = ca.vertcat(
        first * v / ca.DM(chain.velocity_limit),
        (first * w + second * v**2) / ca.DM(acceleration),
        (first * j + 3 * second * v * w + third * v**3) / ca.DM(jerk),
    )
    shares = ca.Function("shares", [u, v, w, j], [limits])
    opti = ca.Opti()
    states = opti.variable(3, intervals + 1)
    jerks = opti.variable(1, intervals)
    duration = opti.variable()
    h = duration / intervals
    left, right = states[:, :-1], states[:, 1:]
    opti.subject_to(right[0, :] == left[0, :] + h * (left[1, :] + h * (left[2, :] / 2 + h * jerks / 6)))
    opti.subject_to(right[1, :] == left[1, :] + h * (left[2, :] + h * jerks / 2))
    opti.subject_to(right[2, :] == left[2, :] + h * jerks)
    opti.subject_to(states[:, 0] == ca.DM([0, 0, 0]))
    opti.subject_to(states[:, -1] == ca.DM([1, 0, 0]))
    opti.subject_to(states[1, :] >= 0)
    for side in (left, right):
        value = shares.map(intervals)(side[0, :], side[1, :], side[2, :], jerks)
        opti.subject_to(opti.bounded(-1, ca.vec(value), 1))
    opti.minimize(duration)
    opti.solver(
        "ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes", "max_iter": 2000, "tol": 1e-7}
    )
    # Where the parameter is on our motion: chord lengths grow with u, so both are functions of time.
    times = np.linspace(0, move.t[-1], intervals + 1)
    dense = np.linspace(0, 1, 20001)
    length = chords(curve(dense, waves))
    reached = chords(move.sample(np.linspace(0, move.t[-1], 20001))[0])
    place = np.interp(
        np.interp(times, np.linspace(0, move.t[-1], 20001), reached) / reached[-1], length / length[-1], dense
    )
    best = np.inf
    for slower in (1.02, 2.0):
        t = times * slower
        speed = np.gradient(place, t)
        opti.set_initial(duration, t[-1])
        opti.set_initial(states, np.stack([place, speed, np.gradient(speed, t)]))
        opti.set_initial(jerks, np.diff(np.gradient(speed, t)) / np.diff(t))
        try:
            best = min(best, float(opti.solve().value(duration)))
        except RuntimeError:
            continue
    return float(move.t[-1]), best


def line(seed: int) -> tuple[float, float, float, float, float]:
    """A straight line: our duration, Ruckig's and its deviation from the line, the optimum on the line, our excess."""
    import ruckig

    rng = np.random.default_rng(seed)
    n = 7
    start, rise = rng.uniform(-1, 1, n), rng.uniform(-1, 1, n) * 10 ** rng.uniform(-2, 0.3)
    velocity, acceleration = rng.uniform(0.5, 3, n), rng.uniform(1, 15, n)
    jerk = acceleration * rng.uniform(2, 100, n)
    chain = rd.catalog.load("panda").with_limits(velocity=velocity, acceleration=acceleration)
    move = rd.retime(chain, np.stack([start, start + rise]), jerk_limits=jerk)
    over = excess(chain, move.sample(finer(move.t)), velocity, acceleration, jerk=jerk)

    def solve(size, v, a, j, end):
        given = ruckig.InputParameter(size)
        given.current_position, given.target_position = np.zeros(size).tolist(), np.asarray(end).tolist()
        for name in ("current_velocity", "current_acceleration", "target_velocity", "target_acceleration"):
            setattr(given, name, np.zeros(size).tolist())
        given.max_velocity, given.max_acceleration, given.max_jerk = (
            np.asarray(x).tolist() for x in (v, a, j)
        )
        given.synchronization = ruckig.Synchronization.Phase
        out = ruckig.Trajectory(size)
        assert ruckig.Ruckig(size).calculate(given, out) == ruckig.Result.Working
        return out

    theirs = solve(n, velocity, acceleration, jerk, rise)
    unit = rise / np.linalg.norm(rise)
    places = np.array([theirs.at_time(t)[0] for t in np.linspace(0, theirs.duration, 400)])
    off = np.linalg.norm(places - np.outer(places @ unit, unit), axis=1).max()
    share = [np.min(limit / np.abs(unit)) for limit in (velocity, acceleration, jerk)]
    on_line = solve(1, *[[s] for s in share], [np.linalg.norm(rise)])
    return float(move.t[-1]), theirs.duration, float(off), on_line.duration, over


# --- tests ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("index", PATHS)
def test_as_fast_as_toppra_without_violation(index):
    pytest.importorskip("toppra")
    both = beside_toppra(index)
    assert both.excess <= SLACK, both
    # On coarse rows toppra's own motion exceeds limits between its gridpoints; then it is as slow as its largest excess
    # of an acceleration asks for that the motions are compared.
    honest = both.theirs * (np.sqrt(1 + both.their_excess) if both.their_excess > COARSE else 1.0)
    assert both.ours <= 1.005 * honest, both


@pytest.mark.parametrize("kind", ["fr3", "slow"])
@pytest.mark.parametrize("index", PATHS)
def test_jerk_limits_hold_between_the_rows(index, kind):
    made = with_jerk(index, kind)
    assert made.excess <= SLACK, made
    assert made.ours >= made.theirs * (1 - 2e-3), made


@pytest.mark.parametrize("index", SMOOTH)
def test_near_the_optimum_that_a_transcription_finds(index):
    pytest.importorskip("casadi")
    ours, best = transcription(index)
    assert np.isfinite(best)
    assert ours <= 1.05 * best, (ours, best)


def test_straight_lines_are_those_of_ruckig():
    pytest.importorskip("ruckig")
    same = 0
    for seed in range(LINES):
        ours, theirs, off, on_line, over = line(seed)
        assert over <= SLACK
        assert abs(ours - on_line) <= 1e-6 * max(1.0, on_line), (seed, ours, on_line)
        if off < 1e-6:
            same += 1
            assert abs(ours - theirs) <= 1e-6 * max(1.0, theirs), (seed, ours, theirs)
    assert same >= 1


def test_the_golden_paths_are_the_last_ones():
    with np.load(GOLDEN) as golden:
        assert len(golden.files) == COUNT - 194


# --- figures ----------------------------------------------------------------------------------------------


def figures(what: str) -> None:
    """Prints what is measured on all paths."""
    if what in {"toppra", "fr3", "slow"}:
        rows = [beside_toppra(i) if what == "toppra" else with_jerk(i, what) for i in range(COUNT)]
        ratio = np.array([row.ours / row.theirs for row in rows])
        for row, r in zip(rows, ratio, strict=True):
            if row.excess > SLACK or (what == "toppra" and r > 1.005) or row.stretched > 1.01:
                print(row)
        print(what, "ours/theirs: median", np.median(ratio), "max", ratio.max(), "min", ratio.min())
        over = np.array([row.excess for row in rows])
        print("  worst excess", over.max(), "paths above slack", int(np.sum(over > SLACK)))
        their = np.array([row.their_excess for row in rows])
        print(
            "  their worst excess",
            their.max(),
            "median",
            np.median(their),
            "above",
            int(np.sum(their > SLACK)),
        )
        stretch = np.array([row.stretched for row in rows])
        print(
            "  stretched: max",
            stretch.max(),
            "median",
            np.median(stretch),
            "above 1.01:",
            int(np.sum(stretch > 1.01)),
        )
    elif what == "ipopt":
        found = np.array([transcription(i) for i in range(20)])
        print("ipopt: ratio", np.sort(found[:, 0] / found[:, 1]))
    elif what == "ruckig":
        found = np.array([line(i) for i in range(200)])
        on = found[:, 2] < 1e-6
        print(
            "ruckig: on the line",
            int(on.sum()),
            "worst difference",
            np.abs(found[on, 0] - found[on, 1]).max(initial=0),
        )
        print("  against the optimum on the line: worst", np.abs(found[:, 0] - found[:, 3]).max())
        print("  worst excess", found[:, 4].max())


if __name__ == "__main__":
    for word in sys.argv[1:] or ["toppra", "fr3", "slow", "ipopt", "ruckig"]:
        figures(word)
