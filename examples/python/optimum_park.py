"""The planar arm of [Park1996]: which optimum of manipulability can be followed around a circle, and which ends early.

Prints tables 1 and 2 of the paper and where each path ends.
"""

import math

import numpy as np

import redundancy as rd

arm = rd.catalog.load("planar3r")
h = rd.Manipulability(arm, task="planar")

print("table 1: where optima vanish      q2 (deg)   q3 (deg)   radius (m)")
for point in rd.algorithmic_singularities(arm, h, task="planar"):
    q2, q3 = np.degrees(point.q[1:])
    print(f"{'':30}{q2:12.4f}{q3:11.4f}{np.linalg.norm(point.position):13.4f}")

circle = rd.paths.circle((3.5, 0, 0), 1.5, start=math.pi, n=201)
circle = circle.with_times(circle.s / circle.length)
print("\ntable 2: the starts at x = 2     q (deg)                        H         A   end of the path")
for start in rd.rank_starts(arm, circle, h, task="planar"):
    a = rd.cofactor_condition(arm, start.q, h, task="planar").condition
    degrees = " ".join(f"{x:9.4f}" for x in np.degrees(start.q))
    followed = start.trajectory
    if start.completed:
        gap = np.abs(followed.q[-1] - followed.q[0]).max()
        end = f"completes, joints closed to {gap:.0e} rad"
    else:
        event = followed.events[-1]
        end = f"{event.kind} at t = {event.t:.10f}"
    print(f"{start.kind!s:>10} {degrees} {start.value:11.4f}{a:10.2f}   {end}")
