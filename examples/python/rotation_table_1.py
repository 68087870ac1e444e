"""Table I of 'Real-time Optimal Trajectory Planning ...' (From and Gravdahl, 2009) compared with this library.

The printed maximum times of rows 2 and 3 are those of 60 iterations, not 50. The paper's times are those of an
Intel T7200 at 2 GHz; those of this library include the Python call, about a microsecond.
`cargo bench --bench rotation` measures the core alone.
"""

import time

import numpy as np

import redundancy as rd

rng = np.random.default_rng(1)
paper = {"z-axis cone": 0.00232, "z-axis cone & x-axis cone": 0.00268, "z-axis cone & restr x-axis": 0.00605}
printed_maximum = {
    "z-axis cone": 0.116,
    "z-axis cone & x-axis cone": 0.1608,
    "z-axis cone & restr x-axis": 0.363,
}


def problem(kind):
    """A random instance of a row."""
    azimuth, omega = rng.uniform(-np.pi, np.pi), np.radians(rng.uniform(5, 45))
    c = [np.sin(omega) * np.cos(azimuth), np.sin(omega) * np.sin(azimuth), -np.cos(omega)]
    constraints = [(1.0, rd.Cone.downward(np.radians(20))), (1.0, rd.Cone.z(c, np.radians(60)))]
    psi = rng.uniform(-0.7, 0.7)
    if "x-axis cone" in kind:
        constraints.append((1.0, rd.Cone.x([-np.cos(psi), -np.sin(psi), 0], np.radians(60))))
    elif "restr" in kind:
        reference = [0.0, np.sin(psi / 2), np.cos(psi / 2), 0.0]
        constraints.append((1.0, rd.Spin(reference, np.radians(60))))
    return constraints


def measure(optimizers, starts, repeat=5):
    """Best time per solve in ms, and the iterations of each problem."""
    best = np.inf
    for _ in range(repeat):
        start = time.perf_counter()
        solutions = [optimizer.solve(q0) for optimizer, q0 in zip(optimizers, starts, strict=True)]
        best = min(best, (time.perf_counter() - start) / len(optimizers))
    assert all(s.status == "converged" for s in solutions)
    return 1e3 * best, np.array([s.iterations for s in solutions])


print(f"{'':28s}{'iteration [ms]':>24s}{'iterations, max':>26s}{'solution, max [ms]':>22s}")
print(
    f"{'algorithm':28s}{'paper':>12s}{'fixed step':>12s}{'paper':>8s}{'fixed':>9s}{'Newton':>9s}"
    f"{'paper':>12s}{'auto':>10s}"
)
for kind, paper_step in paper.items():
    problems = [problem(kind) for _ in range(300)]
    fixed = [rd.OrientationOptimizer(p, "gradient", backtracking=False, tolerance=2e-7) for p in problems]
    newton = [rd.OrientationOptimizer(p, "newton") for p in problems]
    auto = [rd.OrientationOptimizer(p) for p in problems]
    # The paper's cold start [0, 0, 1, 0]; where it is outside, an orientation inside that one step finds.
    first = [rd.OrientationOptimizer(p, "gradient", max_iterations=1) for p in problems]
    starts = [optimizer.solve([0, 0, 1, 0]).q for optimizer in first]
    per_fixed, steps = measure(fixed, starts)
    _, newton_steps = measure(newton, starts)
    per_auto, _ = measure(auto, starts)
    print(
        f"{kind:28s}{paper_step:12.5f}{per_fixed / steps.mean():12.5f}{50 if kind == 'z-axis cone' else 60:8d}"
        f"{steps.max():9d}{newton_steps.max():9d}{printed_maximum[kind]:12.4f}{per_auto:10.4f}"
    )
