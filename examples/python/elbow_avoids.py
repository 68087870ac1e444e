"""A 7R arm whose elbow avoids a sphere while the tool stands still, within all limits."""

import numpy as np

import redundancy as rd

chain = rd.catalog.load("iiwa14")
q0 = np.array([0.2, 0.7, -0.3, -1.4, 0.2, 0.9, 0.1])
tool = chain.forward(q0)

# A sphere beside the elbow: 2 cm from the arm.
elbow = chain.forward(q0, "link_4")[:3, 3]
centre = elbow + np.array([0.0, 0.22, 0.0])
scene = rd.Scene([rd.Sphere(centre, 0.12)])
before = scene.clearance(chain, q0, link_radius=0.06).distance

# The freedom follows the gradient of the clearance; positions, velocities and accelerations are bounded.
limited = chain.with_limits(acceleration=np.full(7, 10.0))
away = rd.Clearance(limited, scene, link_radius=0.06)
scheme = rd.SaturatedNullspace(limited, away, gain=2.0)
still = rd.Path([tool, tool], t=[0.0, 3.0])
run = rd.track(limited, scheme, still, q0, dt=0.005, feedback=20.0)

after = scene.clearance(chain, run.q[-1], link_radius=0.06).distance
moved = np.linalg.norm(chain.forward(run.q, "link_4")[-1][:3, 3] - elbow)
print(
    f"clearance {before:.3f} -> {after:.3f} m, the elbow moved {moved:.3f} m, "
    f"the tool {1e6 * run.position_error:.3f} um"
)
assert after > before + 0.02
assert run.position_error < 1e-5
assert np.all(np.abs(np.diff(run.qd, axis=0)) <= 10.0 * 0.005 + 1e-9)
