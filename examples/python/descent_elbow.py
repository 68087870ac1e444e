"""Section 9.1 of [FromGravdahl2007]: the five algorithms with and without an elbow term (eq. 43) in the cost.

The arm has seven joints, so that pose and elbow can be met together: the term attracts the elbow to its position in
the target configuration. An iteration costs the same with the term, but the two terms compete, and fewer runs
converge. Writes a PNG into the folder that is named, or a temporary one.
Needs matplotlib (`pip install '.[plot]'`).
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import redundancy as rd

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp(prefix="redundancy-"))
folder.mkdir(parents=True, exist_ok=True)

METHODS = (
    "coordinate_descent",
    "gauss_southwell",
    "gauss_southwell_rate",
    "weighted_descent",
    "gradient_estimate",
)
ITERATIONS, TARGETS = 300, 60
chain = rd.catalog.load("pa10").with_limits(lower=-np.inf, upper=np.inf)
elbow = "link4"  # its origin is the elbow
targets, starts = np.random.default_rng(0).uniform(-np.pi, np.pi, (2, TARGETS, 7))
poses, elbows = chain.forward(targets), chain.forward(targets, elbow)[:, :3, 3]


def run(method: str, term: bool) -> tuple[np.ndarray, float, float]:
    """Errors `(TARGETS, ITERATIONS + 1)`, the elbow's mean distance from its point at the end (m), s per iteration."""
    errors, away, begin, iterations = [], [], time.perf_counter(), 0
    for pose, q0, point in zip(poses, starts, elbows, strict=True):
        attractions = [(elbow, tuple(point), 1.0)] if term else None
        solver = rd.IkSolver(
            chain,
            method,
            tol_position=1e-6,
            tol_orientation=1e-6,
            max_iterations=ITERATIONS,
            attractions=attractions,
        )
        trace = solver.trace(pose, q0)
        error = np.maximum(trace.position_error, trace.orientation_error)
        iterations += len(trace) - 1
        errors.append(np.r_[error, np.full(ITERATIONS + 1, error[-1])][: ITERATIONS + 1])
        away.append(np.linalg.norm(chain.forward(trace.q, elbow)[:3, 3] - point))
    return np.array(errors), float(np.mean(away)), (time.perf_counter() - begin) / iterations


figure = Figure(figsize=(9, 3.8), layout="constrained")
left, right = figure.subplots(1, 2, sharey=True)
print(f"{'':22} {'without the term':^36} {'with it':^36}")
print(f"{'':22}" + 2 * f" {'1e-3':>6} {'1e-6':>6} {'elbow':>9} {'iteration':>10}  ")
for method in METHODS:
    cells = []
    for axes, term in ((left, False), (right, True)):
        errors, away, seconds = run(method, term)
        rough, fine = 100 * (errors[:, -1] < 1e-3).mean(), 100 * (errors[:, -1] <= 1e-6).mean()
        cells.append(f" {rough:4.0f} % {fine:4.0f} % {1e3 * away:6.0f} mm {1e6 * seconds:7.1f} us  ")
        axes.plot(100 * (errors < 1e-3).mean(axis=0), label=method.replace("_", " "))
    print(f"{method:22}" + "".join(cells))
for axes, title in ((left, "without an elbow term"), (right, "with an elbow term")):
    axes.set(xscale="symlog", xlabel="iteration", title=title, xlim=(0, ITERATIONS), ylim=(0, 102))
    axes.grid(color="#dddddd")
left.set_ylabel("runs within 1e-3 (%)")
left.legend(fontsize="small")
figure.savefig(folder / "descent_elbow.png", dpi=100)
print("picture in", folder)
