"""[Park1996]: figures 1 to 3, the loci, the paths on them, and h and A along the circle up to each event.

Writes PNGs into the folder that is named, or a temporary one. Needs matplotlib (`pip install '.[plot]'`).
"""

import math
import sys
import tempfile
from pathlib import Path

import redundancy as rd
from redundancy import plot_optimum

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp(prefix="redundancy-"))
folder.mkdir(parents=True, exist_ok=True)
arm = rd.catalog.load("planar3r")
h = rd.Manipulability(arm, task="planar")
circle = rd.paths.circle((3.5, 0, 0), 1.5, start=math.pi, n=201)
circle = circle.with_times(circle.s / circle.length)

singularities = rd.algorithmic_singularities(arm, h, task="planar")
plot_optimum.loci(arm, h, "planar", singularities).savefig(folder / "park_figure_1.png", dpi=100)
curves = rd.self_motion_curves(arm, [2.0, 0.0], task="planar")
ranked = rd.rank_starts(arm, circle, h, task="planar")
plot_optimum.resolved_paths(arm, h, "planar", curves, ranked).savefig(folder / "park_figure_2.png", dpi=100)
figure = plot_optimum.values_along_path(ranked, chain=arm, criterion=h, task="planar")
figure.savefig(folder / "park_figure_3.png", dpi=100)

print("start        h at t = 0      A at t = 0   ends at t      h there      A there")
for start in ranked[::2]:  # of each pair of mirror images one
    t, value, condition = plot_optimum.along_path(arm, h, "planar", start.trajectory)
    event = "path completed" if start.completed else start.trajectory.events[-1].kind
    begin = f"{start.kind!s:8} {value[0]:14.4f} {condition[0]:15.2f}"
    print(f"{begin} {t[-1]:11.7f} {value[-1]:12.4f} {condition[-1]:12.2e}  {event}")
    # At an algorithmic singularity A vanishes, at a kinematic one h as well.
    assert start.completed or abs(condition[-1]) < 1e-3
print("pictures in", folder)
