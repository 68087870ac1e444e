"""[FromGravdahl2007], figures 1, 3, 4, 5, and [FromGravdahl2009], figures 1 and 3: sets, path, tilts, torques at 1 m/s.

The path, the gun and the torque limits are those of docs/painting.md (REF-B), because the papers do not print theirs.
Writes PNGs into the folder that is named, or a temporary one. Needs matplotlib (`pip install '.[plot]'`).
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import redundancy as rd
from redundancy import plot_painting, plot_rotation

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp(prefix="redundancy-"))
folder.mkdir(parents=True, exist_ok=True)

# 2007, figure 1: a rotation about z, and all directions of a cap without rotation about them.
turn, none = (-np.pi, np.pi), (0.0, 0.0)
for number, volume in (
    ("upper", rd.QuaternionVolume.zyz((0.3, 0.3), (0.5, 0.5), (-np.pi / 2, np.pi / 2))),
    ("lower", rd.QuaternionVolume.zyz(turn, (0.0, np.pi / 4), (0.8, 0.8))),
):
    plot_rotation.quaternion_volume(volume).savefig(folder / f"from2007_figure_1_{number}.png", dpi=100)

gun = np.eye(4)
gun[:3, 3] = (-0.15, 0.0, 0.4)
arm = rd.catalog.load("puma560").with_tool(gun)
path = rd.paths.raster((0.44, -0.25, -0.3), 0.5, 0.21, 3, corner=0.17912615734826384)
positions = path.poses[:, :3, 3]

# 2007, figure 3 and 2009, figure 1: the path from above, with the leans of section 7.
square = rd.orientation_rules.tilt_square(np.deg2rad(10))
leaning = square(positions)
plot_painting.path_from_above(positions, leaning[:, :, 2]).savefig(folder / "from2007_figure_3.png", dpi=100)

# 2007, figure 4: the orientation error about each axis over the position.
figure = Figure(figsize=(8, 3.2), layout="constrained")
for axis, coordinate, across, label in (
    (figure.add_subplot(121), 0, 0, "lean about y over x"),
    (figure.add_subplot(122), 1, 1, "lean about x over y"),
):
    lean = np.rad2deg(np.arctan2(leaning[:, across, 2], -leaning[:, 2, 2]))
    order = np.argsort(positions[:, coordinate])
    axis.plot(positions[order, coordinate], lean[order], color="#1b5e8c")
    axis.set(xlabel="xy"[coordinate] + " (m)", ylabel="lean (deg)", title=label)
    axis.grid(color="#dddddd")
figure.savefig(folder / "from2007_figure_4.png", dpi=100)

# 2007, figure 5: constant, pointing, leaning. 2009, figure 3: constant and the three barrier rules. All at 1 m/s.
rules = {
    "constant": rd.orientation_rules.constant(),
    "pointing (section 6)": rd.orientation_rules.pointing(),
    "leaning 10 deg (sections 7, 8)": square,
    "z cone": rd.orientation_rules.barrier_cone(),
    "z cone and x cone": rd.orientation_rules.barrier_two_cones(),
    "z cone and restricted x": rd.orientation_rules.barrier_spin(),
}
found = {name: rd.max_speed(arm, path, rule, velocity_limits=None) for name, rule in rules.items()}
names = list(found)
for file, chosen in (("from2007_figure_5", names[:3]), ("from2009_figure_3", [names[0], *names[3:]])):
    results = {name: found[name] for name in chosen}
    plot_painting.torques_of_rules(arm, path.s, results, speed=1.0).savefig(folder / f"{file}.png", dpi=100)

print("rule                             max speed    largest torque at 1 m/s, joints 1 and 2 (N m)")
for name, result in found.items():
    used = np.abs(plot_painting.torques_at_speed(arm, result, 1.0)).max(axis=0)
    over = [" over its limit" if used[j] > arm.effort_limit[j] else "" for j in (0, 1)]
    print(f"{name:32} {result.speed:.3f} m/s   {used[0]:6.1f}{over[0]}, {used[1]:6.1f}{over[1]}")
# At its own speed the torque that stops a rule is at its limit.
at_limit = np.abs(plot_painting.torques_at_speed(arm, found["constant"], found["constant"].speed))
joint = found["constant"].limiting_joint
assert abs(at_limit[:, joint].max() - arm.effort_limit[joint]) < 1e-9
print("pictures in", folder)
