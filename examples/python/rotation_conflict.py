"""Two cones that exclude each other, and the result in this case; then with a spin and a larger weight."""

import numpy as np

import redundancy as rd

tool, down = [0, 0, 1], [0, 0, -1]
for apart in (30, 70, 100):
    aside = [np.sin(np.radians(apart)), 0, -np.cos(np.radians(apart))]
    wishes = [(1.0, rd.Cone(tool, down, np.radians(30))), (3.0, rd.Cone(tool, aside, np.radians(50)))]
    best = rd.OrientationOptimizer(wishes).solve()
    tilt = np.degrees(wishes[0][1].angle(best.q))
    print(
        f"{apart:3d} deg apart: {best.status}, {tilt:5.2f} deg from down, margins {best.margins.round(4)}, "
        f"the cones miss each other by {np.degrees(best.miss_angle):.1f} deg"
    )
assert best.status == "infeasible"

# A third wish: stay within 40 degrees of a spin. The closed form still holds.
facing = rd.Spin([0, 0, 1, 0], np.radians(40))
aside = [np.sin(0.7), 0.2, -np.cos(0.7)]
wishes = [
    (1.0, rd.Cone(tool, down, np.radians(30))),
    (3.0, rd.Cone(tool, aside, np.radians(50))),
    (1.0, facing),
]
best = rd.OrientationOptimizer(wishes).solve()
print(f"with a spin: {best.status} by {best.method}, twist {np.degrees(facing.twist(best.q)):.1e} deg")
assert best.method == "closed_form"
