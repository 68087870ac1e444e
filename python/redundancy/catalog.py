"""The built-in catalogue of arms.

| name | arm | joints | limits | inertias |
|---|---|---|---|---|
| `dexter` | Scienza Machinale DEXTER | 8R | position | - |
| `fr3` | Franka Research 3 | 7R | position, velocity, torque | yes |
| `gen3` | Kinova Gen3, seven joints | 7R | position, velocity, torque | - |
| `iiwa14` | KUKA LBR iiwa 14 R820 | 7R | position, velocity, torque | yes |
| `irb2400` | ABB IRB 2400 | 6R | position, velocity | - |
| `kr6_r900` | KUKA KR 6 R900 sixx | 6R | position, velocity | - |
| `openarm` | Enactic OpenArm v1.0, one arm | 7R | position, velocity, torque | - |
| `pa10` | Mitsubishi PA10-7C | 7R | position, velocity | - |
| `panda` | Franka Emika Panda (FER) | 7R | position, velocity, acceleration, torque | yes |
| `planar3r` | Park's planar arm, 3, 2.5, 2 m | 3R | - | - |
| `planar4r` | the same with a fourth link of 1.5 m | 4R | - | - |
| `puma560` | Unimation PUMA 560 | 6R | position, torque | yes, with rotors |
| `rby1` | Rainbow Robotics RB-Y1, right arm | 7R | position, velocity, acceleration, torque | - |
| `rizon4` | Flexiv Rizon 4 | 7R | position, velocity, torque | - |
| `sawyer` | Rethink Robotics Sawyer | 7R | position, velocity, torque | - |
| `unitree_g1` | Unitree G1, left arm | 7R | position, velocity, torque | - |
| `ur3e`, `ur5e`, `ur10e`, `ur16e`, `ur20`, `ur30` | Universal Robots | 6R | position, velocity, torque | - |
| `xarm7` | UFACTORY xArm 7 | 7R | position, velocity, torque | - |

The sources are cited in `docs/chain.md` and in the Rust documentation of `chain::catalog`.
"""

from redundancy._core import Chain, catalog_load, catalog_names

__all__ = ["load", "names"]


def load(name: str) -> Chain:
    """Load an arm by name.

    Args:
        name: One of `names()`.

    Raises:
        RedundancyError: The name is unknown; the message lists the known ones.

    Example:
        >>> import redundancy as rd
        >>> rd.catalog.load("pa10").dof
        7
    """
    return catalog_load(name)


def names() -> list[str]:
    """Names that `load` knows, in alphabetical order."""
    return catalog_names()
