"""Every configuration of a PUMA 560 for a pose, the one nearest to a given one, and why another pose has none."""

import numpy as np

import redundancy as rd

arm = rd.SphericalWristArm(rd.catalog.load("puma560"))
here = np.array([0.3, 0.8, -1.2, 0.4, 0.6, -0.5])
pose = arm.chain.forward(here)

for q, signs in zip(arm.configurations(pose).q, arm.configurations(pose).branches, strict=True):
    miss = np.abs(arm.chain.forward(q) - pose).max()
    print(signs, np.round(q, 4), f"misses the pose by {miss:.0e}")

moved = pose.copy()
moved[2, 3] -= 0.05
print("5 cm lower:", np.round(arm.nearest(moved, here), 4))

moved[0, 3] += 1.0
print("1 m further:", arm.configurations(moved).reason)
