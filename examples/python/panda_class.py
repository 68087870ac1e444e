"""The picture of docs/panda_class.md: the self-motion of a Panda over joint 7, with its folds.

Writes a PNG into the folder that is named, or into a temporary one. Needs matplotlib (`pip install '.[plot]'`).
"""

import sys
import tempfile
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import redundancy as rd

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp(prefix="redundancy-"))
folder.mkdir(parents=True, exist_ok=True)

chain = rd.catalog.load("panda")
arm = rd.closed_form(chain)
assert isinstance(arm, rd.PandaClassArm)
pose = chain.forward([0.3, 0.4, -0.2, -1.9, 0.5, 1.7, 0.6])
s = rd.solutions(arm, pose)
print(f"{arm.name}: {len(s.pieces)} closed curves over the pose, status {s.status}, proven {s.proven}")

figure, axes = plt.subplots(1, 3, figsize=(12, 4), constrained_layout=True)
u = np.linspace(-np.pi, np.pi, 2001)
for number, piece in enumerate(s.pieces):
    rows = np.array([piece.q(x) for x in u])
    q7 = np.unwrap(rows[:, 6])
    q7 -= 2 * np.pi * np.round(q7.mean() / (2 * np.pi))
    inside = np.zeros(len(u), bool)
    for lo, hi in piece.intervals():
        inside |= (u - lo) % (2 * np.pi) <= hi - lo
    shown = piece.label.startswith("+")  # the other shoulder has the same joints 4 to 7
    for axis, joint in zip(axes, (3, 4, 5), strict=True):
        values = np.where(np.abs(np.diff(rows[:, joint], append=rows[0, joint])) > 3, np.nan, rows[:, joint])
        color = f"C{number // 2}"
        if shown:
            axis.plot(q7, values, "--", color=color, linewidth=0.8)
        axis.plot(
            q7, np.where(inside, values, np.nan), color=color, linewidth=2.5, alpha=1.0 if shown else 0.6
        )
        axis.set(xlabel="joint 7, rad", ylabel=f"joint {joint + 1}, rad")
    for lo, hi in piece.intervals():
        ends = [piece.parameter(lo), piece.parameter(hi)]
        print(
            f"  {piece.label}: limits hold for u in [{lo:.4f}, {hi:.4f}], q7 from {ends[0]:.4f} to {ends[1]:.4f}"
        )
best = s.best(rd.JointRange(chain))
for axis, joint in zip(axes, (3, 4, 5), strict=True):
    axis.plot(best.q[6], best.q[joint], "k*", markersize=10)
print("best in the joint ranges:", np.round(best.q, 4))
figure.suptitle("Self-motion of a Panda: thick where all limits hold, star: best in the joint ranges")
figure.savefig(folder / "panda_self_motion.png", dpi=100)
print("picture in", folder)
