"""Inverse kinematics of a seven-joint arm without iteration: branches, swivel, limits, the nearest configuration."""

import numpy as np

import redundancy as rd

chain = rd.catalog.load("iiwa14")
arm = rd.SrsArm(chain)
q = np.array([0.3, 0.7, -0.4, -1.2, 0.5, 0.9, -0.2])
pose = chain.forward(q)

# Where the elbow is on its circle, and on which of the eight branches.
swivel = arm.swivel(q)
print(f"swivel {np.rad2deg(swivel):.2f} deg, signs of shoulder, elbow, wrist: {arm.branch(q)}")

# All eight branches at that swivel; those within the joint limits; u = (cos s, sin s) does the same without the angle.
eight = arm.solve(pose, swivel, limits=False)
legal = arm.solve(pose, swivel)
print(f"{len(eight)} configurations, {len(legal)} within the limits")
assert np.allclose(chain.forward(eight), pose, atol=1e-12)
assert any(np.allclose(row, q, atol=1e-9) for row in legal)
assert np.allclose(arm.solve(pose, (np.cos(swivel), np.sin(swivel))), legal, atol=1e-12)

# The set as an object: where each branch holds all limits, exactly, and its best members.
motion = arm.self_motion(pose)
for branch in motion.branches:
    print(branch.signs, np.rad2deg(branch.intervals()).round(2).tolist())
best = motion.best(rd.JointRange(chain))
assert best.q is not None
assert rd.JointRange(chain).value(best.q) <= rd.JointRange(chain).value(q)

# The tool moves on by 5 mm: the configuration over the new pose that is nearest to this one.
moved = pose.copy()
moved[0, 3] += 0.005
near = arm.nearest(moved, q)
assert near is not None
print("joint steps for 5 mm (deg):", np.rad2deg(near - q).round(3))
assert np.abs(near - q).max() < 0.05

# A pose out of reach is an answer, not an error.
moved[0, 3] = 3.0
print(arm.self_motion(moved).reason)
