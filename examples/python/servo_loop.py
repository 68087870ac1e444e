"""A servo in a loop of 1 kHz: a noisy hand-held target, a jump, and a second without any.

    python examples/python/servo_loop.py [FOLDER]

prints the errors and the times of a tick; with a folder it also draws the run there.
"""

import sys
import time
from pathlib import Path

import numpy as np

import redundancy as rd

DT = 0.001
arm = rd.catalog.load("iiwa14")
servo = rd.Servo(arm, DT, acceleration_limits=np.full(7, 10.0), jerk_limits=np.full(7, 1000.0))
q = np.array([0.3, 0.6, -0.2, -1.2, 0.1, 0.9, 0.4])
servo.reset(q)
rng = np.random.default_rng(0)
start = arm.forward(q)

meant, rows, speeds, seconds, statuses = [], [], [], [], []
for k in range(4000):
    t = k * DT
    pose = start.copy()
    pose[:3, 3] += 0.08 * np.array([np.sin(t), 1 - np.cos(t), 0.5 * np.sin(2 * t)])
    if t > 2.0:
        pose[2, 3] += 0.1
    meant.append(pose[:3, 3].copy())
    pose[:3, 3] += rng.normal(0, 1e-3, 3)
    began = time.perf_counter()
    out = servo.update(None if t > 3.0 else pose)
    seconds.append(time.perf_counter() - began)
    rows.append(arm.forward(out.q)[:3, 3])
    speeds.append(np.abs(out.qd / arm.velocity_limit).max())
    statuses.append(str(out.status))

error = np.linalg.norm(np.array(rows) - np.array(meant), axis=1)
calm = slice(500, 2000)
print(
    f"error before the jump: median {np.median(error[calm]) * 1e3:.1f} mm, largest {error[calm].max() * 1e3:.1f} mm"
)
print(f"largest share of a velocity limit: {max(speeds):.3f}; last status: {statuses[-1]}")
median, p99, p999 = np.quantile(seconds, [0.5, 0.99, 0.999]) * 1e6
print(f"time of a tick: median {median:.0f} us, p99 {p99:.0f} us, p99.9 {p999:.0f} us")
assert max(speeds) <= 1 + 1e-9 and statuses[-1] == "no_target" and speeds[-1] < 1e-9

if len(sys.argv) > 1:
    import matplotlib.pyplot as plt

    figure, (above, below) = plt.subplots(2, sharex=True)
    axis = np.arange(len(error)) * DT
    above.plot(axis, error * 1e3)
    above.set_ylabel("distance from what was meant, mm")
    below.plot(axis, speeds)
    below.set_ylabel("largest speed / limit")
    below.set_xlabel("s")
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "servo_loop.png", dpi=120)
