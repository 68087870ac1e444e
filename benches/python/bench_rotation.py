"""The best orientation: this library, scipy's SLSQP and the paper's figures in one table.

Needs scipy. Every row of one run uses the same seeded problems and the same machine; compare ratios, not days.
`python benches/python/bench_rotation.py [problems]`
"""

import math
import sys
import time

import numpy as np
from scipy.optimize import minimize

import redundancy as rd

COLD = np.array([0.0, 0.0, 1.0, 0.0])
PAPER = {"two cones": (2.32, 50), "and an x cone": (2.68, 60), "and a spin": (6.05, 60)}


def problem(rng, kind):
    """Paper 2's variants: cone half-angles 5 to 45 and 20 to 80 deg, weights 0.1 to 10, directions that meet."""
    while True:
        beta, alpha = np.radians(rng.uniform(5, 45)), np.radians(rng.uniform(20, 80))
        omega, azimuth = rng.uniform(0, 0.9) * (alpha + beta), rng.uniform(-np.pi, np.pi)
        c = [np.sin(omega) * np.cos(azimuth), np.sin(omega) * np.sin(azimuth), -np.cos(omega)]
        k = np.exp(rng.uniform(np.log(0.1), np.log(10), 3)).tolist()
        psi, gamma = rng.uniform(-np.pi, np.pi), np.radians(rng.uniform(30, 80))
        constraints = [(k[0], rd.Cone.downward(beta)), (k[1], rd.Cone.z(c, alpha))]
        if kind == "and an x cone":
            constraints.append((k[2], rd.Cone.x([-np.cos(psi), -np.sin(psi), 0], gamma)))
        elif kind == "and a spin":
            constraints.append((k[2], rd.Spin([0, np.sin(psi / 2), np.cos(psi / 2), 0], gamma)))
        if rd.OrientationOptimizer(constraints).solve().status == "converged":
            return constraints


def forms(constraints):
    """(weight, numerator, denominator) of every margin as quadratic forms of q, for a solver that knows no cones."""
    basis = np.eye(4)
    pairs = basis[:, None, :] + basis[None, :, :]
    rows = []
    for weight, item in constraints:
        if isinstance(item, rd.Cone):
            # Polarisation: the margin of unit quaternions is a quadratic form.
            norms = np.linalg.norm(pairs, axis=2)
            unit = pairs / np.where(norms > 0, norms, 1)[..., None]
            values = np.array(
                [[item.margin(unit[i, j]) * norms[i, j] ** 2 for j in range(4)] for i in range(4)]
            )
            single = np.diag(values) / 4
            rows.append((weight, (values - single[:, None] - single[None, :]) / 2, np.eye(4)))
        else:
            e = item.reference
            scalar, along = e.copy(), np.array([-e[3], -e[2], e[1], e[0]])  # r0 and r3 as linear forms of q
            top = math.tan(item.max_angle / 2) ** 2 * np.outer(scalar, scalar) - np.outer(along, along)
            rows.append((weight, top, np.outer(scalar, scalar)))
    return rows


def slsqp(rows, q0):
    """Minimise with scipy's SLSQP and gradients on the unit sphere."""

    def value(q):
        total, gradient = 0.0, np.zeros(4)
        for weight, top, bottom in rows:
            n, d = q @ top @ q, q @ bottom @ q
            if n <= 1e-14 * d or d <= 0:
                return 1e3 + 1e3 * max(0.0, -n), -2e3 * (top @ q)
            total -= weight * math.log(n / d)
            gradient -= 2 * weight * (top @ q / n - bottom @ q / d)
        return total, gradient

    sphere = {"type": "eq", "fun": lambda q: q @ q - 1, "jac": lambda q: 2 * q}
    found = minimize(
        value, q0, jac=True, constraints=[sphere], method="SLSQP", options={"ftol": 1e-12, "maxiter": 200}
    )
    q = found.x / np.linalg.norm(found.x)
    return value(q)[0], found.nit


def timed(call, items, repeat=1):
    """Median time per item in us of the best of `repeat` runs, and the results."""
    best = None
    for _ in range(repeat):
        times, results = [], []
        for item in items:
            start = time.perf_counter()
            results.append(call(item))
            times.append(time.perf_counter() - start)
        times = 1e6 * np.array(times)
        if best is None or np.median(times) < np.median(best):
            best = times
    return best, results


def main(count):
    """Print the table."""
    rng = np.random.default_rng(1)
    print(
        f"{count} problems each, through Python; median and 99 % in us, iterations, share within 1e-6 of the best value"
    )
    print(f"{'problem':16s}{'solver':26s}{'median':>9s}{'99 %':>9s}{'iterations':>12s}{'share':>8s}")
    for kind, (paper_step, paper_steps) in PAPER.items():
        problems = [problem(rng, kind) for _ in range(count)]
        first = [rd.OrientationOptimizer(p, "gradient", max_iterations=1) for p in problems]
        starts = [o.solve(COLD).q for o in first]
        runs = {}
        for label, settings in {
            "auto": {},
            "newton": {"method": "newton"},
            "gradient, backtracking": {"method": "gradient", "tolerance": 2e-7},
            "gradient, fixed step": {"method": "gradient", "backtracking": False, "tolerance": 2e-7},
        }.items():
            made = [rd.OrientationOptimizer(p, **settings) for p in problems]
            times, found = timed(
                lambda pair: pair[0].solve(pair[1]), list(zip(made, starts, strict=True)), repeat=5
            )
            runs[label] = (times, [s.value for s in found], [s.iterations for s in found])
        rows = [forms(p) for p in problems]
        times, found = timed(lambda pair: slsqp(*pair), list(zip(rows, starts, strict=True)))
        runs["scipy SLSQP, gradient"] = (times, [v for v, _ in found], [n for _, n in found])
        best = np.min([values for _, values, _ in runs.values()], axis=0)
        for label, (times, values, steps) in runs.items():
            share = np.mean(np.array(values) <= best + 1e-6 * np.maximum(1, np.abs(best)))
            print(
                f"{kind:16s}{label:26s}{np.median(times):9.2f}{np.quantile(times, 0.99):9.2f}"
                f"{np.median(steps):7.0f} /{np.max(steps):4.0f}{100 * share:7.1f}%"
            )
        print(
            f"{kind:16s}{'the paper (T7200, printed)':26s}{paper_step * paper_steps:9.1f}{'':9s}{paper_steps:12d}"
        )
    u = rng.normal(size=(1_000_000, 3)) * 0.2 - [0, 0, 1]
    c = rng.normal(size=(1_000_000, 3)) * 0.2 - [0, 0, 1]
    best = math.inf
    for _ in range(5):
        start = time.perf_counter()
        _, status = rd.optimal_directions(u, c, 0.5, 1.0)
        best = min(best, time.perf_counter() - start)
    share = 100 * np.mean(status == "converged")
    print(f"optimal_directions: {1 / best:.2f} million problems/s, {share:.2f} % feasible")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 300)
