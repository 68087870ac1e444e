"""Unit quaternions, scalar first `(w, x, y, z)`: Euler angles, swing and twist, shortest arc, error.

Angles are rad. Sequences are about the moving axes: `from_zyz([a, b, c])` is `Rz(a) Ry(b) Rz(c)`, `from_xyz` is
`Rx(a) Ry(b) Rz(c)` and `from_rpy([phi, theta, psi])` is `Rz(phi) Ry(theta) Rx(psi)`. Where the middle angle leaves
only one of the outer angles determined, the one about the first axis (for RPY the roll `psi`) is set to 0.
Arguments may have a leading axis `(N, ...)` in the six conversions, and then the result has it too.

Example:
    >>> from redundancy import quaternion
    >>> [round(float(a), 12) for a in quaternion.to_zyz(quaternion.from_zyz([0.5, 0.2, -0.3]))]
    [0.5, 0.2, -0.3]
"""

from redundancy import _core

__all__ = [
    "angle",
    "error",
    "from_rpy",
    "from_xyz",
    "from_zyz",
    "shortest_arc",
    "swing_twist",
    "to_rpy",
    "to_xyz",
    "to_zyz",
]

angle = _core.quaternion_angle
error = _core.quaternion_error
from_rpy = _core.quaternion_from_rpy
from_xyz = _core.quaternion_from_xyz
from_zyz = _core.quaternion_from_zyz
shortest_arc = _core.quaternion_shortest_arc
swing_twist = _core.quaternion_swing_twist
to_rpy = _core.quaternion_to_rpy
to_xyz = _core.quaternion_to_xyz
to_zyz = _core.quaternion_to_zyz
