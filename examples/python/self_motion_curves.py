"""The pictures of docs/self_motion.md: joints over the swivel, and the swivel map of a path.

Writes PNGs into the folder that is named, or into a temporary one. Needs matplotlib (`pip install '.[plot]'`).
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import redundancy as rd
from redundancy import plot

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp(prefix="redundancy-"))
folder.mkdir(parents=True, exist_ok=True)

# The second test vector of the closed form: joint 3 and the wrist cut the circle, two arcs are left.
pa10 = rd.SrsArm(rd.catalog.load("pa10"))
w, x, y, z = np.array([1, 2, 3, 4]) / np.sqrt(30)
pose = np.eye(4)
pose[:3, :3] = [
    [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
]
pose[:3, 3] = 0.4, -0.3, 0.6
motion = pa10.self_motion(pose)
figure = plot.self_motion(motion, pa10.chain, branch=(1, -1, 1))
figure.savefig(folder / "self_motion.png", dpi=100)
print("branch +-+, feasible swivels (rad):", motion.branches[2].intervals().round(4).tolist())

# A raster on a table: where may the elbow be, on which branch, and what does the planner choose?
iiwa = rd.SrsArm(rd.catalog.load("iiwa14"))
path = rd.paths.raster((0.45, -0.3, 0.3), 0.6, 0.06, 4, corner=0.05, orientation=np.diag([1, -1, -1]))
path = path.resampled(0.02)
plan = rd.plan_swivel(iiwa, path)
plot.swivel_map(iiwa, path, plan).savefig(folder / "swivel_map.png", dpi=100)
print(f"{len(path)} points, plan {plan.status}, branch {plan.branch[0].tolist()}")
print("pictures in", folder)
