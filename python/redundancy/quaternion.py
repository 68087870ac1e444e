"""Unit quaternions, scalar first `(w, x, y, z)`: algebra, axis and angle, Euler angles, swing and twist, error.

Angles are rad. `product(a, b)` rotates by b and then, about fixed axes, by a: `rotate(product(a, b), v)` is
`rotate(a, rotate(b, v))`. Sequences are about the moving axes: `from_zyz([a, b, c])` is `Rz(a) Ry(b) Rz(c)`, `from_xyz`
is `Rx(a) Ry(b) Rz(c)` and `from_rpy([phi, theta, psi])` is `Rz(phi) Ry(theta) Rx(psi)`: phi about z comes first, unlike
in `redundancy.pose(rpy=...)`, which takes roll, pitch, yaw as a URDF does. At the gimbal, where only
a combination of the outer angles is determined, the one about the first axis (for RPY `psi`, about x) is set to 0.
In products and conversions, arguments may have a leading axis `(N, ...)`, and then the result has it too; a single row
is used for all rows.

Example:
    >>> from redundancy import quaternion
    >>> [round(float(a), 12) for a in quaternion.to_zyz(quaternion.from_zyz([0.5, 0.2, -0.3]))]
    [0.5, 0.2, -0.3]
    >>> quarter = quaternion.from_axis_angle([0, 0, 1], 1.5707963267948966)
    >>> quaternion.rotate(quaternion.product(quarter, quarter), [1, 0, 0]).round(12).tolist()
    [-1.0, 0.0, 0.0]
"""

from redundancy import _core

__all__ = [
    "angle",
    "conjugate",
    "error",
    "from_axis_angle",
    "from_matrix",
    "from_rpy",
    "from_xyz",
    "from_zyz",
    "product",
    "rotate",
    "shortest_arc",
    "swing_twist",
    "to_axis_angle",
    "to_matrix",
    "to_rpy",
    "to_xyz",
    "to_zyz",
]

angle = _core.quaternion_angle
conjugate = _core.quaternion_conjugate
error = _core.quaternion_error
from_axis_angle = _core.quaternion_from_axis_angle
from_matrix = _core.quaternion_from_matrix
from_rpy = _core.quaternion_from_rpy
from_xyz = _core.quaternion_from_xyz
from_zyz = _core.quaternion_from_zyz
product = _core.quaternion_product
rotate = _core.quaternion_rotate
shortest_arc = _core.quaternion_shortest_arc
swing_twist = _core.quaternion_swing_twist
to_axis_angle = _core.quaternion_to_axis_angle
to_matrix = _core.quaternion_to_matrix
to_rpy = _core.quaternion_to_rpy
to_xyz = _core.quaternion_to_xyz
to_zyz = _core.quaternion_to_zyz
