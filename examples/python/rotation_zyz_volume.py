"""A ZYZ volume: membership, margin, nearest member, and a picture."""

from pathlib import Path

import numpy as np

import redundancy as rd

turn = (-np.pi, np.pi)
tilted = rd.QuaternionVolume.zyz(turn, (0, np.radians(25)), np.radians([-40, 40]))
on_the_table = tilted.reoriented([0, 0, 1, 0])  # the same set for a tool that points down

q = rd.quaternion.from_zyz(np.radians([30, 40, 10]))
print("member:", tilted.contains(q), " margin:", round(np.degrees(tilted.margin(q)), 3), "deg")
near = tilted.nearest(q)
print("nearest member:", np.degrees(rd.quaternion.to_zyz(near)).round(3), "deg, away by", end=" ")
print(round(np.degrees(rd.quaternion.angle(q, near)), 3), "deg")
assert tilted.contains(near)

members = on_the_table.sample(1000, seed=1)
assert on_the_table.contains(members).all()
print("visualising quaternion of a member:", on_the_table.visualising(members[0]).round(4))
print("cross-section 0.4 m below:", rd.QuaternionVolume.cone([0, 0, 1], np.radians(25)).cross_section(0.4))

try:
    from redundancy.plot_rotation import quaternion_volume
except ImportError:
    print("no picture without matplotlib")
else:
    out = Path("out")
    out.mkdir(exist_ok=True)
    quaternion_volume(tilted).savefig(out / "zyz_volume.png", dpi=150)
