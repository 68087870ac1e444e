"""The spray experiment: plans under a clock, and the largest constant speed.

Usage: python benches/python/bench_painting.py [seconds]. Wall and processor time: on a busy machine the second counts.
"""

import sys
import time
from pathlib import Path

import numpy as np

import redundancy as rd

GOLDEN = Path(__file__).parents[2] / "tests" / "golden"
RATES = np.deg2rad([288.0, 240.0, 300.0, 400.0, 405.0, 600.0])
CASES = {
    "torque limits": {"joint_limits": False},
    "10 % margin, rates": {"joint_limits": False, "torque_margin": 0.1, "velocity_limits": RATES},
    "10 % margin, rates, joint limits": {"torque_margin": 0.1, "velocity_limits": RATES},
}


def gun(offset: float) -> rd.Chain:
    tool = np.eye(4)
    tool[:3, 3] = (offset, 0.0, 0.4)
    return rd.catalog.load("puma560").with_tool(tool)


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    for name, offset in (("a", 0.0), ("b", -0.15)):
        arm, path = gun(offset), rd.Path.from_csv(GOLDEN / f"spray_ref_{name}_path.csv")
        rule = rd.orientation_rules.constant()
        found = rd.max_speed(arm, path, rule)
        runs = []
        for _ in range(50):
            begin = time.perf_counter()
            rd.max_speed(arm, path, q=found.q)
            runs.append(time.perf_counter() - begin)
        print(
            f"REF-{name.upper()} constant {found.speed:.4f} m/s; max_speed with q {1e3 * np.median(runs):.2f} ms"
        )
        for label, options in CASES.items():
            limits = arm.effort_limit * (1.0 - options.get("torque_margin", 0.0))
            rates = options.get("velocity_limits")
            constant = rd.max_speed(arm, path, rule, torque_limits=limits, velocity_limits=rates).speed
            wall, cpu = time.perf_counter(), time.process_time()
            plan = rd.plan_orientation(arm, path, np.deg2rad(20.0), time_limit=seconds, **options)
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
            gain = plan.speed / constant
            print(
                f"  {label:34s} {plan.speed:.4f} m/s  x{gain:.3f} of {constant:.4f}  {plan.status}, "
                f"{plan.starts} starts, {plan.steps} steps, {wall:.1f} s wall, {cpu:.1f} s processor",
                flush=True,
            )


if __name__ == "__main__":
    main()
