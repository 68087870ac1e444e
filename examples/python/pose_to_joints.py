"""Inverse kinematics of any chain within its limits, and the reason when no solution exists."""

import numpy as np

import redundancy as rd

chain = rd.catalog.load("panda")
ik = rd.IkSolver(chain)

pose = np.diag([1.0, -1.0, -1.0, 1.0])  # the tool points down
pose[:3, 3] = 0.5, 0.1, 0.3
result = ik.solve(pose)
print(result)

# The spare freedom: as near to mid-range as the pose allows.
middle = (chain.lower + chain.upper) / 2
soft = rd.IkSolver(chain, criterion=rd.Posture(chain, middle)).solve(pose)
print("mid-range:", np.round(soft.q, 3))

# Any orientation within 20 degrees of the vertical.
cone = rd.Cone([0, 0, 1], [0, 0, -1], np.deg2rad(20))
far = pose.copy()
far[:3, 3] = 0.75, 0.0, 0.3
print("strictly down:", ik.solve(far).reason or "reached")
print("within the cone:", rd.IkSolver(chain, orientation_set=cone).solve(far).status)

# Many poses at once.
rng = np.random.default_rng(0)
poses = chain.forward(rng.uniform(chain.lower, chain.upper, (1000, 7)))
batch = ik.solve_batch(poses)
print(
    f"{(batch.status == 'converged').sum()} of {len(batch)} reached, {batch.iterations.mean():.1f} iterations each"
)
