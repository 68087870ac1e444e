"""A PA10 follows a circle with a planned elbow: files for a controller, and a picture."""

import tempfile
from pathlib import Path

import numpy as np

import redundancy as rd
from redundancy import plot

arm = rd.SrsArm(rd.catalog.load("pa10"))
path = rd.paths.circle((0.45, 0.0, 0.5), 0.12, orientation=np.diag([-1.0, 1.0, -1.0]))
plan = rd.plan_swivel(arm, path)
assert plan.status == rd.Status.CONVERGED, plan.reason

miss = np.abs(arm.chain.forward(plan.q) - path.poses).max()
room = np.minimum(plan.q - arm.chain.lower, arm.chain.upper - plan.q).min()
print(
    f"{len(plan)} rows in {plan.t[-1]:.2f} s, pose error {miss:.1e}, {np.rad2deg(room):.1f} deg from the limits"
)

folder = Path(tempfile.mkdtemp())
plan.to_csv(folder / "trajectory.csv")
plan.to_json(folder / "trajectory.json")
band = plot.swivel_band(arm, path.poses, plan.branch[0])
plot.track(plan, arm.chain, path.s, plan.swivel, band).savefig(folder / "track.png")
print("written:", *sorted(f.name for f in folder.iterdir()))
