"""Where the tests find robots, and the same robots as pinocchio models."""

import importlib.util
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

import redundancy as rd


class Parts(NamedTuple):
    """What a chain pickles to."""

    name: str
    joints: list[tuple[str, str, list[float], list[float], list[float]]]
    links: list[tuple[str, int, list[float]]]
    inertias: list[tuple[float, list[float], list[float], float]] | None
    base: list[float]
    tool: list[float]


def parts(chain: rd.Chain) -> Parts:
    """The description inside a chain."""
    return Parts(*chain.__reduce__()[1])  # type: ignore[arg-type]


def se3(row_major: list[float]) -> Any:
    """Sixteen numbers as pinocchio's transform."""
    return pin.SE3(np.array(row_major).reshape(4, 4))


def as_pinocchio(chain: rd.Chain) -> Any:
    """A pinocchio model with the same joints, and a frame per link and for the tool."""
    model, description = pin.Model(), parts(chain)
    parent, placed = 0, se3(description.base)
    ids = [0]
    for name, kind, placement, axis, _ in description.joints:
        unit = np.array(axis)
        joint = (
            pin.JointModelPrismaticUnaligned(unit)
            if kind == "prismatic"
            else pin.JointModelRevoluteUnaligned(unit)
        )
        parent = model.addJoint(parent, joint, placed * se3(placement), name)
        placed = pin.SE3.Identity()
        ids.append(parent)
    last = pin.SE3.Identity()
    for name, before, offset in description.links:
        last = se3(offset)
        at = se3(description.base) * last if before == 0 else last
        model.addFrame(pin.Frame(f"link {name}", ids[before], at, pin.FrameType.OP_FRAME))
    for joint, (mass, center, tensor, rotor) in zip(ids[1:], description.inertias or [], strict=False):
        body = pin.Inertia(mass, np.array(center), np.array(tensor).reshape(3, 3))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
        model.armature[model.idx_vs[joint]] = rotor
    model.addFrame(pin.Frame("tool", ids[-1], last * se3(description.tool), pin.FrameType.OP_FRAME))
    return model


def site(package: str) -> Path:
    """The site-packages folder that holds a package."""
    spec = importlib.util.find_spec(package)
    assert spec is not None and spec.submodule_search_locations
    return Path(spec.submodule_search_locations[0]).parent


def example_robots() -> Path:
    """Folder of the PyPI package example-robot-data."""
    return site("pinocchio").parents[2] / "share" / "example-robot-data" / "robots"


class Robot(NamedTuple):
    """A URDF that nobody here wrote."""

    path: Path
    base: str | None
    tip: str


def robots() -> dict[str, Robot]:
    """URDFs of PyPI packages: revolute, continuous and prismatic joints, fixed ones between."""
    data, bullet, rtb = (
        example_robots(),
        site("pybullet_data") / "pybullet_data",
        site("rtbdata") / "rtbdata" / "xacro",
    )
    return {
        "panda hand": Robot(data / "panda_description/urdf/panda.urdf", "panda_link0", "panda_hand_tcp"),
        "panda finger (prismatic)": Robot(
            data / "panda_description/urdf/panda.urdf", None, "panda_leftfinger"
        ),
        "ur5": Robot(data / "ur_description/urdf/ur5_robot.urdf", "base_link", "tool0"),
        "kinova (continuous)": Robot(
            data / "kinova_description/robots/kinova.urdf", None, "j2s6s200_end_effector"
        ),
        "talos arm": Robot(data / "talos_data/robots/talos_left_arm.urdf", None, "wrist_left_ft_tool_link"),
        "tiago (prismatic torso)": Robot(
            data / "tiago_description/robots/tiago_no_hand.urdf", "base_link", "wrist_ft_tool_link"
        ),
        "pr2 (continuous, prismatic)": Robot(
            data / "pr2_description/urdf/pr2.urdf", "base_link", "r_gripper_tool_frame"
        ),
        "baxter": Robot(data / "baxter_description/urdf/baxter.urdf", "base", "left_gripper"),
        "xarm7": Robot(data / "xarm_description/urdf/xarm7.urdf", None, "link_eef"),
        "pybullet iiwa": Robot(bullet / "kuka_iiwa/model.urdf", None, "lbr_iiwa_link_7"),
        "rtb iiwa14": Robot(
            rtb / "kuka_description/kuka_lbr_iiwa/urdf/lbr_iiwa_14_r820.urdf", "base_link", "tool0"
        ),
        "rtb puma560": Robot(rtb / "unimation_puma560_description/urdf/puma560_robot.urdf", None, "link7"),
    }


def random_q(chain: rd.Chain, seed: int, n: int = 20) -> NDArray[np.float64]:
    """Configurations (n, dof), within +-3 rad, +-0.5 m where a joint slides."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-3.0, 3.0, (n, chain.dof))
    slides = np.array([kind == "prismatic" for _, kind, *_ in parts(chain).joints])
    q[:, slides] /= 6.0
    return q
