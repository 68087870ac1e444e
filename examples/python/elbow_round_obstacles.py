"""A PA10 follows a circle while its elbow avoids a ball, a post and a table: with a plan, and step by step."""

import numpy as np

import redundancy as rd

arm = rd.SrsArm(rd.catalog.load("pa10"))
path = rd.paths.circle((0.45, 0.0, 0.5), 0.12, orientation=np.diag([-1.0, 1.0, -1.0]), n=300)
path = path.with_times(np.linspace(0.0, 6.0, len(path)))
table = np.eye(4)
table[:3, 3] = (0.6, 0.0, -0.05)
scene = rd.Scene(
    [
        rd.Sphere((0.2842, -0.3539, 0.4817), 0.06),
        rd.Capsule((0.25, 0.55, 0.0), (0.25, 0.55, 0.9), 0.04),
        rd.Box(table, (0.3, 0.5, 0.05)),
    ]
)

# The whole path at once: a closed line that keeps 3 cm, with the elbow hanging down where it can.
plan = rd.plan_swivel(arm, path, scene, cyclic=True, desired=-np.pi / 2)
assert plan.status == rd.Status.CONVERGED, plan.reason
assert plan.clearance is not None and plan.clearance.min() >= 0.029
assert np.abs(plan.q[-1] - plan.q[0]).max() < 1e-9
print(
    f"plan: {1e3 * plan.clearance.min():.1f} mm at least, swivel {plan.swivel.min():.2f} to {plan.swivel.max():.2f}"
)

# Step by step, as in a control loop that does not know the path: the joints and the rate of the step before go in.
flow = rd.SwivelFlow(arm, -np.pi / 2, scene)
dt, s, rate, q, least = 0.02, float(plan.swivel[0]), 0.0, plan.q[0], np.inf
for k in range(1, len(path)):
    now = flow.step(path.poses[k], s, dt, t=k * dt, q=q, rate=rate)
    rate, s = (now - s) / dt, now
    rows = arm.self_motion(path.poses[k]).branches[0].q(s)
    q = rows - 2 * np.pi * np.round((rows - q) / (2 * np.pi))
    least = min(least, float(scene.clearance(arm.chain, q, link_radius=0.05).distance))
print(f"flow: {1e3 * least:.1f} mm at least")
assert least >= 0.0199
