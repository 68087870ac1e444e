"""URDFs that nobody here wrote: agreement with pinocchio, bad files, mutated files."""

import os
import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from arms import Robot, example_robots, parts, random_q, robots, site

import redundancy as rd

ROBOTS = robots()
TOLERANCE = 1e-12
FULL = os.environ.get("REDUNDANCY_TEST_FULL") == "1"


@pytest.mark.parametrize("name", ROBOTS)
def test_agrees_with_pinocchio(name: str) -> None:
    robot = ROBOTS[name]
    chain = rd.Chain.from_urdf(robot.path, robot.base, robot.tip)
    model = pin.buildModelFromUrdf(str(robot.path))
    data = model.createData()
    base = model.getFrameId(chain.link_names[0])
    ids = [model.getJointId(joint) for joint in chain.joint_names]
    columns = [model.joints[i].idx_v for i in ids]
    tip = model.getFrameId(robot.tip)
    for q in random_q(chain, seed=4):
        full = pin.neutral(model)
        for i, value in zip(ids, q, strict=True):
            joint = model.joints[i]
            full[joint.idx_q : joint.idx_q + joint.nq] = (
                [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
            )
        pin.framesForwardKinematics(model, data, full)
        start = data.oMf[base]
        for link in chain.link_names:
            expected = start.actInv(data.oMf[model.getFrameId(link)]).homogeneous
            assert np.abs(chain.forward(q, link) - expected).max() < TOLERANCE
        jacobian = pin.computeFrameJacobian(model, data, full, tip, pin.LOCAL_WORLD_ALIGNED)[:, columns]
        turned = np.vstack([start.rotation.T @ jacobian[:3], start.rotation.T @ jacobian[3:]])
        pose, ours = chain.kinematics(q)
        assert np.array_equal(pose, chain.forward(q))
        assert np.abs(ours - turned).max() < TOLERANCE


@pytest.mark.parametrize(
    "name", ["panda hand", "ur5", "kinova (continuous)", "talos arm", "xarm7", "pybullet iiwa"]
)
def test_limits_and_inertias_agree_with_pinocchio(name: str) -> None:
    robot = ROBOTS[name]
    chain = rd.Chain.from_urdf(robot.path, robot.base, robot.tip)
    model = pin.buildModelFromUrdf(str(robot.path))
    bodies = parts(chain).inertias
    assert bodies is not None
    kinds = [kind for _, kind, *_ in parts(chain).joints]
    for i, joint in enumerate(chain.joint_names):
        index = model.getJointId(joint)
        q, v = model.joints[index].idx_q, model.joints[index].idx_v
        if kinds[i] != "continuous":
            assert (
                chain.lower[i] == model.lowerPositionLimit[q]
                and chain.upper[i] == model.upperPositionLimit[q]
            )
        else:
            assert np.isinf([chain.lower[i], chain.upper[i]]).all()
        assert (
            chain.velocity_limit[i] == model.velocityLimit[v]
            and chain.effort_limit[i] == model.effortLimit[v]
        )
        mass, center, tensor, rotor = bodies[i]
        theirs = model.inertias[index]
        assert abs(mass - theirs.mass) < 1e-14 and rotor == 0
        assert np.abs(np.array(center) - theirs.lever).max() < 1e-14
        assert np.abs(np.array(tensor).reshape(3, 3) - theirs.inertia).max() < 1e-13


def every_urdf() -> list[Path]:
    return sorted(
        p
        for folder in (example_robots(), site("pybullet_data") / "pybullet_data", site("rtbdata") / "rtbdata")
        for p in folder.rglob("*.urdf")
    )


def leaves(xml: str) -> list[str]:
    xml = re.sub(r"<!--.*?-->", "", xml, flags=re.DOTALL)
    links = re.findall(r"<link\s+[^>]*?name=\"([^\"]+)\"", xml)
    parents = set(re.findall(r"<parent\s+[^>]*?link=\"([^\"]+)\"", xml))
    return [link for link in dict.fromkeys(links) if link not in parents]


def test_every_urdf_at_hand_gives_a_chain_or_a_reason() -> None:
    """More than a hundred files, every leaf: what pinocchio reads, we read, and the tips agree at zero."""
    files = every_urdf()
    assert len(files) > 100
    chains = 0
    reasons: dict[str, int] = {}
    for path in files if FULL else files[::4]:
        xml = path.read_text(errors="replace")
        for leaf in leaves(xml):
            try:
                chain = rd.Chain.from_urdf_string(xml, tip=leaf, missing_limits="unbounded")
            except rd.RedundancyError as error:
                reason = re.sub(r"'[^']*'|\d+", "_", str(error))[:120]
                reasons[reason] = reasons.get(reason, 0) + 1
                continue
            chains += 1
            assert np.isfinite(chain.forward(np.zeros(chain.dof))).all()
    assert chains > (400 if FULL else 80), reasons
    known = (
        "no moving joint",
        "same link",
        "mimic",
        "planar",
        "floating",
        "spherical",
        "above",
        "XML",
        "<inertia",
        "twice",
        "length",
        "child of two",
        "unknown link",
        "type definitions",
        "number",
        "finite",
        "no name",
        "has no",
    )
    assert all(any(word in reason for word in known) for reason in reasons), reasons


def test_iiwa_of_the_catalogue_is_that_of_others() -> None:
    """Same geometry as the URDFs, up to the defects they have."""
    ours = rd.catalog.load("iiwa14")
    theirs = rd.Chain.from_urdf(ROBOTS["rtb iiwa14"].path, "base_link", "tool0")
    q = random_q(ours, seed=5)
    assert np.abs(ours.forward(q) - theirs.forward(q)).max() < 1e-3  # 0.44 mm offsets in that file
    assert (
        np.abs(ours.upper - theirs.upper).max() < 3e-4
        and np.abs(ours.velocity_limit - theirs.velocity_limit).max() < 3e-4
    )
    bullet = rd.Chain.from_urdf(ROBOTS["pybullet iiwa"].path, None, "lbr_iiwa_link_7")
    assert np.abs(ours.forward(q, "link_7")[:, :3, 3] - bullet.forward(q)[:, :3, 3]).max() < 1e-9


def test_panda_of_the_catalogue_is_that_of_franka() -> None:
    ours = rd.catalog.load("panda")
    theirs = rd.Chain.from_urdf(ROBOTS["panda hand"].path, "panda_link0", "panda_link8")
    q = random_q(ours, seed=6)
    assert np.abs(ours.forward(q) - theirs.forward(q)).max() < 1e-14
    for limit in ("lower", "upper", "velocity_limit", "effort_limit"):
        assert np.array_equal(getattr(ours, limit), getattr(theirs, limit))
    # their link 7 carries the hand and the fingers' palm, the links before are the same numbers
    for (m, c, t, _), (n, d, u, _) in zip(parts(ours).inertias[:6], parts(theirs).inertias[:6], strict=True):  # type: ignore[index]
        assert m == n and np.allclose(c, d, rtol=0, atol=1e-16) and np.allclose(t, u, rtol=0, atol=1e-16)


def test_path_objects_and_left_out_ends() -> None:
    robot = ROBOTS["panda hand"]
    by_path = rd.Chain.from_urdf(robot.path, tip=robot.tip)
    assert by_path == rd.Chain.from_urdf(str(robot.path), robot.base, robot.tip)
    assert by_path == rd.Chain.from_urdf_string(robot.path.read_text(), robot.base, robot.tip)
    with pytest.raises(rd.DescriptionError, match=r"panda\.urdf: tip is needed.*panda_leftfinger"):
        rd.Chain.from_urdf(robot.path)


LIMIT = '<limit lower="-1" upper="1" velocity="1" effort="1"/>'


def joint(kind: str = "revolute", inside: str = LIMIT) -> str:
    return (
        '<robot name="r"><link name="a"/><link name="b"/>'
        f'<joint name="j" type="{kind}"><parent link="a"/><child link="b"/>{inside}</joint></robot>'
    )


@pytest.mark.parametrize(
    ("xml", "words"),
    [
        ("<robot", ["XML"]),
        ("<sdf/>", ["<sdf>", "<robot>"]),
        (joint("floating"), ["'j'", "floating"]),
        (joint("planar"), ["'j'", "planar"]),
        (joint(inside=LIMIT + '<mimic joint="k"/>'), ["'j'", "mimics"]),
        (joint(inside=""), ["'j'", "no <limit>", "unbounded"]),
        (joint(inside='<limit lower="2" upper="1"/>'), ["'j'", "2", "above", "1"]),
        ('<!DOCTYPE r [<!ENTITY a "b">]>' + joint(), ["document type definitions"]),
        (joint(inside=LIMIT + '<axis xyz="0 0"/>'), ["'j'", "axis", "'0 0'", "3 numbers"]),
    ],
)
def test_bad_descriptions_are_named(xml: str, words: list[str]) -> None:
    with pytest.raises(rd.DescriptionError) as caught:
        rd.Chain.from_urdf_string(xml)
    for word in words:
        assert word in str(caught.value), f"{caught.value} lacks {word}"


def test_other_bad_input() -> None:
    with pytest.raises(rd.RedundancyError, match="unknown link 'z', expected one of: a, b"):
        rd.Chain.from_urdf_string(joint(), tip="z")
    assert rd.Chain.from_urdf_string(joint(), "b", "a").dof == 1
    with pytest.raises(rd.RedundancyError, match="axis of joint 'j' has length 0"):
        rd.Chain.from_urdf_string(joint(inside=LIMIT + '<axis xyz="0 0 0"/>'))
    with pytest.raises(rd.RedundancyError, match="origin xyz: entry 1 is NaN"):
        rd.Chain.from_urdf_string(joint(inside=LIMIT + '<origin xyz="0 nan 0"/>'))
    with pytest.raises(
        rd.RedundancyError, match="unknown missing_limits 'x', expected one of: error, unbounded"
    ):
        rd.Chain.from_urdf_string(joint(), missing_limits="x")  # type: ignore[arg-type]
    assert np.isinf(rd.Chain.from_urdf_string(joint(inside=""), missing_limits="unbounded").upper).all()


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"no\.urdf"):
        rd.Chain.from_urdf(tmp_path / "no.urdf")
    (tmp_path / "latin.urdf").write_bytes(joint().replace('"r"', '"\xe9"').encode("latin-1"))
    with pytest.raises(rd.FileFormatError, match=r"latin\.urdf: not UTF-8"):
        rd.Chain.from_urdf(tmp_path / "latin.urdf")
    with pytest.raises(rd.FileFormatError):
        rd.Chain.from_urdf(tmp_path)


@pytest.mark.parametrize("name", ["pybullet iiwa", "panda hand", "tiago (prismatic torso)"])
def test_mutated_files_give_a_chain_or_an_error(name: str) -> None:
    robot: Robot = ROBOTS[name]
    data = robot.path.read_bytes()
    rng = np.random.default_rng(7)
    chains = errors = 0
    for _ in range(20_000 if FULL else 400):
        mutated = bytearray(data)
        for _ in range(rng.integers(1, 6)):
            at = int(rng.integers(len(mutated)))
            if rng.random() < 0.7:
                mutated[at] = int(rng.choice(list(b'0123456789.-eE abjlnx"/<>&=')))
            else:
                del mutated[at : at + int(rng.integers(1, 50))]
        try:
            chain = rd.Chain.from_urdf_string(mutated.decode(errors="replace"), robot.base, robot.tip)
            assert not np.isnan(chain.forward(np.zeros(chain.dof))).any()
            chains += 1
        except rd.RedundancyError:
            errors += 1
    assert chains > 0 and errors > 0
