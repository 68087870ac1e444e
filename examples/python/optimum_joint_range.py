"""Every optimum of the joint range of an iiwa for one pose: on which self-motion curve, and whether within limits."""

import numpy as np

import redundancy as rd

arm = rd.catalog.load("iiwa14")
h = rd.JointRange(arm)
pose = arm.forward(np.radians([20, 40, 10, -80, 15, 60, 0]))

for curve in rd.self_motion_curves(arm, pose, step=0.02):
    legal = sum(high - low for low, high in curve.intervals())
    print(
        f"curve of length {curve.length:6.3f} rad, within joint limits on {100 * legal / curve.length:5.1f} %"
    )

points = rd.constrained_optima(arm, pose, h)
print(f"\n{len(points)} critical points of the joint range, best first:")
for point in points[:6]:
    where = "within limits" if point.within_limits else "outside limits"
    print(f"  {point.kind!s:8} h = {point.value:.6f}  {where}  q = {np.degrees(point.q).round(2)} deg")

# The closed form's own minimum over all legal arcs agrees.
best = rd.SrsArm(arm).self_motion(pose).best(h)
legal_minimum = min(p.value for p in points if p.within_limits and p.kind == "minimum")
print(
    f"\nbest within limits by the closed form: {best.value:.12f}, among the critical points: {legal_minimum:.12f}"
)
