"""Chains up to a common ancestor and down again, rails, payloads, and Jacobians of links: against pinocchio."""

import itertools
import pickle

import numpy as np
import pinocchio as pin
import pytest
from arms import as_pinocchio, example_robots, random_q

import redundancy as rd

TOLERANCE = 1e-12


def inertial(seed: int) -> str:
    rng = np.random.default_rng(seed)
    a = rng.uniform(-1, 1, (3, 3))
    tensor = a @ a.T * 0.02 + 0.01 * np.eye(3)
    words = " ".join(f'{n}="{tensor[i, j]}"' for n, (i, j) in {
        "ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2),
    }.items())  # fmt: skip
    xyz, rpy = (" ".join(map(str, rng.uniform(-0.2, 0.2, 3))) for _ in range(2))
    return (
        f'<inertial><origin xyz="{xyz}" rpy="{rpy}"/><mass value="{rng.uniform(1, 5)}"/>'
        f"<inertia {words}/></inertial>"
    )


class Tree:
    """A URDF that grows joint by joint, with crooked origins and axes, and bodies everywhere."""

    def __init__(self, root: str) -> None:
        self.links, self.joints = [root], ""
        self.rng = np.random.default_rng(len(root))

    def add(self, parent: str, child: str, kind: str, axis: str = "0 0 1") -> "Tree":
        self.links.append(child)
        xyz, rpy = (" ".join(map(str, self.rng.uniform(-0.5, 0.5, 3))) for _ in range(2))
        low, high = sorted(self.rng.uniform(-3, 3, 2))
        limit = "" if kind == "fixed" else f'<limit lower="{low}" upper="{high}" velocity="2" effort="30"/>'
        self.joints += (
            f'<joint name="{child}_joint" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>{limit}</joint>\n'
        )
        return self

    @property
    def xml(self) -> str:
        links = "".join(f'<link name="{n}">{inertial(i)}</link>\n' for i, n in enumerate(self.links))
        return f'<robot name="tree">{links}{self.joints}</robot>'


def arm(tree: Tree, parent: str, name: str) -> None:
    kinds = ["revolute", "continuous", "revolute", "prismatic", "revolute", "revolute"]
    axes = ["0 0 1", "0 1 0", "0.3 -0.5 0.8", "1 0 0", "0 -1 0", "0 0 -1"]
    for i, (kind, axis) in enumerate(zip(kinds, axes, strict=True)):
        tree.add(parent, f"{name}{i}", kind, axis)
        parent = f"{name}{i}"
    tree.add(parent, f"{name}_tool", "fixed")


def turntable() -> Tree:
    """A cell with a turntable that tilts and turns, and an arm on a pedestal beside it."""
    tree = Tree("cell").add("cell", "frame", "fixed").add("frame", "tilt", "revolute", "0 1 0.1")
    tree.add("tilt", "top", "continuous", "0 0 1").add("top", "fixture", "fixed")
    tree.add("cell", "pedestal", "fixed")
    arm(tree, "pedestal", "a")
    return tree


def two_arms() -> Tree:
    """A torso on a lift that is fixed to the floor, with two arms."""
    tree = Tree("floor").add("floor", "column", "prismatic").add("column", "torso", "fixed")
    arm(tree, "torso", "left")
    arm(tree, "torso", "right")
    return tree


CASES = {
    "turntable to tool": (turntable(), "top", "a_tool"),
    "fixture to tool": (turntable(), "fixture", "a_tool"),
    "hand to hand": (two_arms(), "left_tool", "right_tool"),
    "hand to the other arm's middle": (two_arms(), "right_tool", "left3"),
    "tool to floor": (two_arms(), "right_tool", "floor"),
    "swapped": (turntable(), "a_tool", "pedestal"),
}


class Pinocchio:
    """Placements and Jacobians relative to a frame, from a model of the whole tree."""

    def __init__(self, model: pin.Model, chain: rd.Chain) -> None:
        self.model, self.data = model, model.createData()
        self.ids = [model.getJointId(name) for name in chain.joint_names]
        self.columns = [model.joints[i].idx_v for i in self.ids]

    def full(self, q: np.ndarray) -> np.ndarray:
        full = pin.neutral(self.model)
        for i, value in zip(self.ids, q, strict=True):
            joint = self.model.joints[i]
            full[joint.idx_q : joint.idx_q + joint.nq] = (
                [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
            )
        return full

    def placed(self, q: np.ndarray) -> None:
        full = self.full(q)
        pin.computeJointJacobians(self.model, self.data, full)
        pin.updateFramePlacements(self.model, self.data)

    def pose(self, frame: str) -> pin.SE3:
        return self.data.oMf[self.model.getFrameId(frame)]

    def relative_jacobian(self, base: str, tip: str) -> np.ndarray:
        """Of the tip's origin as seen by one who sits on the base, in axes of the base."""
        world = pin.LOCAL_WORLD_ALIGNED
        of = [
            pin.getFrameJacobian(self.model, self.data, self.model.getFrameId(f), world) for f in (base, tip)
        ]
        arm = self.pose(tip).translation - self.pose(base).translation
        carried = of[0].copy()
        carried[:3] += np.cross(of[0][3:].T, arm).T
        turn = self.pose(base).rotation.T
        return np.vstack([turn @ (of[1] - carried)[:3], turn @ (of[1] - carried)[3:]])[:, self.columns]


@pytest.mark.parametrize("case", CASES)
def test_relative_placement_and_jacobian(case: str) -> None:
    tree, base, tip = CASES[case]
    chain = rd.Chain.from_urdf_string(tree.xml, base, tip)
    reference = Pinocchio(pin.buildModelFromXML(tree.xml), chain)
    model = reference.model
    assert (chain.link_names[0], chain.link_names[-1]) == (base, tip)
    for i, joint in zip(reference.ids, chain.joint_names, strict=True):
        k = chain.joint_names.index(joint)
        if model.joints[i].nq == 1:
            at = model.joints[i].idx_q
            assert (chain.lower[k], chain.upper[k]) == (
                model.lowerPositionLimit[at],
                model.upperPositionLimit[at],
            )
    for q in random_q(chain, seed=5, n=30):
        reference.placed(q)
        for link in chain.link_names:
            expected = reference.pose(base).actInv(reference.pose(link)).homogeneous
            assert np.abs(chain.forward(q, link) - expected).max() < TOLERANCE
            ours = chain.jacobian(q, link=link)
            assert np.abs(ours - reference.relative_jacobian(base, link)).max() < TOLERANCE
        assert np.abs(chain.jacobian(q) - reference.relative_jacobian(base, tip)).max() < TOLERANCE
        # The Hessian against differences of the Jacobian.
        steps = 1e-6 * np.eye(chain.dof)
        slopes = (chain.jacobian(q + steps) - chain.jacobian(q - steps)) / 2e-6
        assert np.abs(chain.hessian(q) - np.moveaxis(slopes, 0, 2)).max() < 1e-8
    assert pickle.loads(pickle.dumps(chain)) == chain


@pytest.mark.parametrize("case", CASES)
def test_torques_while_the_new_base_stands(case: str) -> None:
    """Pinocchio's whole tree on a free root that moves so that the chain's base stands still.

    The base is held by a wrench f: `rnea = [0; tau] + J_base^T f`, six equations of the root for f, the rest gives tau.
    """
    tree, base, tip = CASES[case]
    chain = rd.Chain.from_urdf_string(tree.xml, base, tip)
    model = pin.buildModelFromXML(tree.xml, pin.JointModelFreeFlyer())
    # What hangs on joints beside the way is not part of the chain: no mass there.
    kept = {model.frames[model.getFrameId(link)].parentJoint for link in chain.link_names}
    for i in set(range(1, model.njoints)) - kept:
        model.inertias[i] = pin.Inertia.Zero()
    data = model.createData()
    rng = np.random.default_rng(8)
    frame, gravity = model.getFrameId(base), np.array([0.3, -0.4, -9.81])
    ids = [model.getJointId(name) for name in chain.joint_names]
    columns = [model.joints[i].idx_v for i in ids]
    reference = Pinocchio(model, chain)
    for q in random_q(chain, seed=6, n=10):
        qd, qdd = rng.uniform(-1, 1, (2, chain.dof))
        full = reference.full(q)
        pin.framesForwardKinematics(model, data, full)
        # The root stands where it puts the base at the origin.
        full[:7] = pin.SE3ToXYZQUAT(data.oMf[frame].inverse() * data.oMi[1])
        v, a = np.zeros((2, model.nv))
        v[columns], a[columns] = qd, qdd
        jacobian = pin.computeFrameJacobian(model, data, full, frame, pin.LOCAL)
        v[:6] = -np.linalg.solve(jacobian[:, :6], jacobian[:, 6:] @ v[6:])
        pin.forwardKinematics(model, data, full, v, a)
        rest = pin.getFrameAcceleration(model, data, frame, pin.LOCAL).vector
        a[:6] -= np.linalg.solve(jacobian[:, :6], rest)
        model.gravity.linear = gravity
        torques = pin.rnea(model, data, full, v, a)
        wrench = np.linalg.solve(jacobian[:, :6].T, torques[:6])
        expected = (torques - jacobian.T @ wrench)[columns]
        ours = chain.inverse_dynamics(q, qd, qdd, gravity=tuple(gravity))
        assert np.abs(ours - expected).max() < 1e-10 * (1 + np.abs(expected).max())


def test_no_common_ancestor_names_both_roots() -> None:
    xml = turntable().xml.replace("</robot>", '<link name="island"/></robot>')
    with pytest.raises(rd.DescriptionError, match="'island' is 'island', the root above 'a_tool' is 'cell'"):
        rd.Chain.from_urdf_string(xml, "island", "a_tool")


def test_tiago_from_hand_to_head() -> None:
    """A URDF that nobody here wrote."""
    path = example_robots() / "tiago_description/robots/tiago_no_hand.urdf"
    chain = rd.Chain.from_urdf(path, "wrist_ft_tool_link", "head_2_link")
    reference = Pinocchio(pin.buildModelFromUrdf(str(path)), chain)
    for q in random_q(chain, seed=9):
        reference.placed(q)
        expected = reference.pose("wrist_ft_tool_link").actInv(reference.pose("head_2_link")).homogeneous
        assert np.abs(chain.forward(q) - expected).max() < TOLERANCE
        ours = reference.relative_jacobian("wrist_ft_tool_link", "head_2_link")
        assert np.abs(chain.jacobian(q) - ours).max() < TOLERANCE


def test_inverse_kinematics_over_a_common_ancestor() -> None:
    tree, base, tip = CASES["turntable to tool"]
    chain = rd.Chain.from_urdf_string(tree.xml, base, tip)
    solver = rd.IkSolver(chain)
    rng = np.random.default_rng(4)
    low, high = np.maximum(chain.lower, -3.0), np.minimum(chain.upper, 3.0)
    for _ in range(10):
        target = chain.forward(rng.uniform(low, high))
        result = solver.solve(target)
        assert result.status == "converged"
        assert np.abs(chain.forward(result.q) - target).max() < 1e-5


# Jacobians of links in any axes -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["panda", "dexter", "puma560"])
def test_jacobians_of_links_agree_with_pinocchio(name: str) -> None:
    chain = rd.catalog.load(name).with_base(pin.SE3.Random()).with_tool(pin.SE3.Random())
    model = as_pinocchio(chain)
    data = model.createData()
    rng = np.random.default_rng(3)
    frames = {link: model.getFrameId(f"link {link}") for link in chain.link_names} | {
        None: model.getFrameId("tool")
    }
    for q in random_q(chain, seed=1, n=5):
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        for link, frame in frames.items():
            aligned = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
            assert np.abs(chain.jacobian(q, link) - aligned).max() < TOLERANCE
            local = pin.getFrameJacobian(model, data, frame, pin.LOCAL)
            own = "tool" if link is None else link
            if own != "base":
                assert np.abs(chain.jacobian(q, link, own) - local).max() < TOLERANCE
            point = rng.uniform(-0.5, 0.5, 3)
            moved = aligned.copy()
            moved[:3] += np.cross(aligned[3:].T, data.oMf[frame].rotation @ point).T
            for other, axes in itertools.islice(frames.items(), 0, None, 3):
                turn = data.oMf[axes].rotation.T
                if other == "base":
                    continue
                expected = np.vstack([turn @ moved[:3], turn @ moved[3:]])
                ours = chain.jacobian(q, link=link, frame=other or "tool", point=point)
                assert np.abs(ours - expected).max() < TOLERANCE


def test_jacobians_of_links_in_batches() -> None:
    chain = rd.catalog.load("iiwa14")
    q = random_q(chain, seed=2, n=3000)
    options = {"link": "link_4", "frame": "tool", "point": (0.1, 0.2, -0.3)}
    many = chain.jacobian(q, **options)
    assert many.shape == (3000, 6, 7)
    assert np.array_equal(many[1234], chain.jacobian(q[1234], **options))
    assert np.array_equal(many, chain.jacobian(q, threads=1, **options))
    assert np.array_equal(chain.jacobian(q[0], frame="base"), chain.jacobian(q[0]))
    with pytest.raises(rd.RedundancyError, match="unknown frame 'world', expected one of: base, tool, "):
        chain.jacobian(q[0], frame="world")
    with pytest.raises(rd.RedundancyError, match="unknown link 'hand'"):
        chain.jacobian(q[0], link="hand")
    with pytest.raises(rd.RedundancyError, match="point: expected 3 entries, got 2"):
        chain.jacobian(q[0], point=(0.0, 1.0))


# Rails and payloads ------------------------------------------------------------------------------------------------


def test_a_rail_is_one_more_joint_for_everyone() -> None:
    arm7 = rd.catalog.load("panda")
    chain = arm7.with_rail((0, 2, 0), -1.0, 1.0, velocity=0.5, name="track")
    assert chain.joint_names == ["track", *arm7.joint_names]
    assert (chain.lower[0], chain.upper[0], chain.velocity_limit[0]) == (-1.0, 1.0, 0.5)
    assert np.isinf(chain.effort_limit[0]) and chain.link_names[:2] == ["track_base", arm7.link_names[0]]
    q = np.array([0.4, 0.1, 0.3, -0.2, -1.5, 0.2, 1.8, 0.5])
    moved = arm7.forward(q[1:])
    moved[1, 3] += 0.4
    assert np.abs(chain.forward(q) - moved).max() < 1e-15
    assert pickle.loads(pickle.dumps(chain)) == chain
    # Out of the arm's own reach, within the rail's.
    target = moved.copy()
    target[1, 3] += 0.55
    assert rd.IkSolver(arm7).solve(target).status != "converged"
    result = rd.IkSolver(chain).solve(target)
    assert result.status == "converged" and -1.0 <= result.q[0] <= 1.0
    assert np.abs(chain.forward(result.q) - target).max() < 1e-5
    # One spare freedom of a six-joint arm on a rail: traced.
    puma = rd.catalog.load("puma560").with_rail((1, 0, 0), -0.3, 0.3)
    start = np.array([0.05, 0.3, -0.9, 0.4, 0.2, 0.7, -0.3])
    curve = rd.trace_self_motion(puma, start)
    poses = puma.forward(curve.q)
    assert len(curve.q) > 10 and np.abs(poses - puma.forward(start)).max() < 1e-8
    criterion = rd.JointRange(chain)
    assert np.isfinite(criterion.gradient(q)).all()
    model = as_pinocchio(chain)
    data = model.createData()
    qd, qdd = np.random.default_rng(1).uniform(-1, 1, (2, 8))
    expected = pin.rnea(model, data, q, qd, qdd)
    assert np.abs(chain.inverse_dynamics(q, qd, qdd) - expected).max() < 1e-10


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda c: c.with_rail((0, 0, 0), 0, 1), "axis of joint 'rail' has length 0"),
        (lambda c: c.with_rail((0, 0, 1), 1, 0), "lower limit 1 is above upper limit 0"),
        (lambda c: c.with_rail((0, 0, 1), 0, 1, velocity=0.0), "joint 'rail': velocity limit is 0"),
        (lambda c: c.with_rail((0, 0, 1), 0, 1, name=c.joint_names[2]), "is used twice"),
        (lambda c: c.with_payload(-1.0, (0, 0, 0)), "payload: mass is -1"),
        (
            lambda c: c.with_payload(1.0, (0, np.nan, 0)),
            "center_of_mass: entry 1 is NaN|centre of mass: entry 1",
        ),
        (lambda c: c.with_payload(1.0, (0, 0, 0), np.diag([1, 1, -1])), "eigenvalue"),
        (lambda c: rd.catalog.load("pa10").with_payload(1.0, (0, 0, 0)), "has no inertias"),
    ],
)
def test_bad_rails_and_payloads(call, text: str) -> None:
    with pytest.raises(rd.RedundancyError, match=text):
        call(rd.catalog.load("iiwa14"))


def test_payloads_agree_with_pinocchio() -> None:
    tool = pin.SE3.Random()
    chain = rd.catalog.load("panda").with_tool(tool)
    mass, center, tensor = 2.3, np.array([0.05, -0.02, 0.11]), np.diag([0.01, 0.02, 0.015])
    tensor[0, 1] = tensor[1, 0] = 0.002
    loaded = chain.with_payload(mass, center, tensor)
    model = as_pinocchio(chain)
    tip = model.frames[model.getFrameId(f"link {chain.link_names[-1]}")]
    model.appendBodyToJoint(tip.parentJoint, pin.Inertia(mass, center, tensor), tip.placement)
    data = model.createData()
    for q in random_q(chain, seed=3):
        qd, qdd = np.random.default_rng(2).uniform(-1, 1, (2, 7))
        expected = pin.rnea(model, data, q, qd, qdd)
        assert np.abs(loaded.inverse_dynamics(q, qd, qdd) - expected).max() < 1e-10
    assert np.array_equal(loaded.forward(np.zeros(7)), chain.forward(np.zeros(7)))
    twice = chain.with_payload(1.0, center).with_payload(1.3, center, np.diagonal(tensor))
    once = chain.with_payload(2.3, center, np.diagonal(tensor))
    zero = np.zeros(7)
    change = twice.inverse_dynamics(zero, zero, zero + 1) - once.inverse_dynamics(zero, zero, zero + 1)
    assert np.abs(change).max() < 1e-12
    # The gun's mass counts in the speed of a stroke.
    path = rd.paths.circle((0.45, 0.0, 0.4), 0.1, n=60, orientation=np.diag([1.0, -1.0, -1.0]))
    plain = rd.catalog.load("panda")
    fast, slow = (rd.max_speed(c, path).speed for c in (plain, plain.with_payload(5.0, (0, 0, 0.2))))
    assert slow < fast
