"""Where may the elbow of a PA10 be along a circle? The exact feasible swivels, and how narrow they become."""

import numpy as np

import redundancy as rd

arm = rd.SrsArm(rd.catalog.load("pa10"))
tool_down = np.diag([-1.0, 1.0, -1.0])
path = rd.paths.circle((0.45, 0.0, 0.5), 0.12, orientation=tool_down, n=200)

owners, intervals = arm.intervals_batch(path.poses)
widths = np.zeros((len(path), 8))
np.add.at(widths, (owners[:, 0], owners[:, 1]), intervals[:, 1] - intervals[:, 0])
narrowest = widths.min(axis=0)
print("least freedom of the elbow on each branch (deg):", np.rad2deg(narrowest).round(1))

branch = arm.self_motion(path.poses[0]).branches[int(narrowest.argmax())]
lo, hi = branch.intervals()[0]
q = branch.q(0.5 * (lo + hi))
print("branch", branch.signs, "in the middle of its band: q (deg) =", np.rad2deg(q).round(1))
assert np.allclose(arm.chain.forward(q), path.poses[0], atol=1e-12)
