"""A spray gun may tilt by 20 degrees and spin freely: which orientation keeps the wrist near the middle?

Along a stroke the gun has two aims: to stay close to the surface normal, and to point away from the middle of the
surface. Each solution is the start of the next, so the tool never spins unnecessarily.
"""

import numpy as np

import redundancy as rd

on_the_normal = rd.Cone.downward(np.radians(20))
allowed = rd.QuaternionVolume.cone([0, 0, 1], np.radians(20), [0, 0, -1])
q, steps = None, []
for y in np.linspace(-0.25, 0.25, 101):
    away_from_the_middle = rd.Cone.z([0.1, y, -0.4], np.radians(60))
    best = rd.OrientationOptimizer([(1.0, on_the_normal), (1.0, away_from_the_middle)]).solve(q)
    assert best.status == "converged"
    assert allowed.contains(best.q)
    if q is not None:
        steps.append(rd.quaternion.angle(q, best.q))
    q = best.q
print(
    f"largest tilt {np.degrees(on_the_normal.angle(q)):.2f} deg, largest step {np.degrees(max(steps)):.3f} deg"
)

# The same for all points at once, when only the tool axis matters.
points = np.stack([np.full(101, 0.1), np.linspace(-0.25, 0.25, 101), np.full(101, -0.4)], axis=1)
axes, status = rd.optimal_directions([0, 0, -1], points, np.radians(20), np.radians(60))
assert (status == "converged").all()
print("last tool axis:", axes[-1].round(6))
