"""How fast a spray gun can move: with constant orientation, the rules of the papers, and a short plan."""

import numpy as np

import redundancy as rd

gun = np.eye(4)
gun[:3, 3] = (-0.15, 0.0, 0.4)
arm = rd.catalog.load("puma560").with_tool(gun)
path = rd.paths.raster((0.44, -0.25, -0.3), 0.5, 0.21, 3, corner=0.17912615734826384)

rules = {
    "constant": rd.orientation_rules.constant(),
    "pointing": rd.orientation_rules.pointing(),
    "tilt, 10 deg": rd.orientation_rules.tilt_square(np.deg2rad(10)),
    "barriers, 20 deg": rd.orientation_rules.barrier_two_cones(),
}
constant = rd.max_speed(arm, path, rules["constant"]).speed
for name, rule in rules.items():
    found = rd.max_speed(arm, path, rule)
    where = f"{found.limit} of {found.limiting_joint_name} at {path.s[found.at]:.2f} m"
    print(f"{name:17s} {found.speed:.3f} m/s  x{found.speed / constant:.2f}  {where}")

plan = rd.plan_orientation(arm, path, half_angle=np.deg2rad(20), time_limit=3.0)
print(f"{'plan, 20 deg':17s} {plan.speed:.3f} m/s  x{plan.speed / constant:.2f}  {plan.status} after 3 s")
tilt = np.rad2deg(np.linalg.norm(plan.tilt, axis=1))
spin = np.rad2deg([plan.spin.min(), plan.spin.max()])
print(f"tilt up to {tilt.max():.1f} deg, spin from {spin[0]:.0f} to {spin[1]:.0f} deg")
assert plan.speed > constant
