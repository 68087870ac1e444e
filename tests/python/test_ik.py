"""From poses to configurations, through the Python face."""

import os
import pickle

import numpy as np
import pytest
from arms import Robot, robots

import redundancy as rd

ROBOTS = robots()
FULL = os.environ.get("REDUNDANCY_TEST_FULL") == "1"


def random_q(chain: rd.Chain, n: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform(np.maximum(chain.lower, -np.pi), np.minimum(chain.upper, np.pi), (n, chain.dof))


def load(name: str) -> rd.Chain:
    if name in ROBOTS:
        robot: Robot = ROBOTS[name]
        return rd.Chain.from_urdf(robot.path, robot.base, robot.tip)
    return rd.catalog.load(name)


# SphericalWristArm


@pytest.fixture(scope="module", params=["puma560", "rtb puma560"])
def wrist_arm(request: pytest.FixtureRequest) -> rd.SphericalWristArm:
    return rd.SphericalWristArm(load(request.param))


def test_every_branch_closes(wrist_arm: rd.SphericalWristArm) -> None:
    chain = wrist_arm.chain
    position, orientation = wrist_arm.defect
    for q in random_q(chain, 200, 0):
        pose = chain.forward(q)
        rows = wrist_arm.solve(pose, limits=False)
        assert rows.shape in {(4, 6), (8, 6)}
        np.testing.assert_allclose(
            chain.forward(rows),
            np.broadcast_to(pose, (len(rows), 4, 4)),
            atol=1e-11 + 2 * max(position, orientation),
        )
        signs = wrist_arm.branch(rows)
        order = [4 * (a < 0) + 2 * (b < 0) + (c < 0) for a, b, c in signs]
        assert order == sorted(order)
        inside = wrist_arm.solve(pose)
        assert ((inside >= chain.lower) & (inside <= chain.upper)).all()
        turns = (inside - q) / (2 * np.pi)
        assert np.abs(turns - turns.round()).max(axis=1).min() < 1e-4
        all_of_them = wrist_arm.configurations(pose)
        assert all_of_them.status == "converged" and all_of_them.reason == "" and all_of_them.distance == 0
        np.testing.assert_array_equal(all_of_them.q, inside)
        np.testing.assert_array_equal(all_of_them.branches, wrist_arm.branch(inside))


def test_nearest_and_batches(wrist_arm: rd.SphericalWristArm) -> None:
    chain = wrist_arm.chain
    q = random_q(chain, 300, 1)
    poses = chain.forward(q)
    batch = wrist_arm.solve_batch(poses)
    assert batch.q.shape == (300, 8, 6) and batch.valid.shape == (300, 8) and batch.valid.any(axis=1).all()
    for i in range(0, 300, 29):
        np.testing.assert_array_equal(batch.q[i][batch.valid[i]], wrist_arm.solve(poses[i]))
    one = wrist_arm.solve_batch(poses, threads=1)
    np.testing.assert_array_equal(one.q, batch.q)
    near = wrist_arm.nearest(poses, q)
    assert near.q.shape == (300, 6) and near.valid.all()
    np.testing.assert_allclose(near.q, q, atol=1e-4)
    single = wrist_arm.nearest(poses[7], q[7])
    np.testing.assert_array_equal(single, near.q[7])


def test_reasons_of_the_wrist_arm() -> None:
    chain = rd.catalog.load("puma560")
    arm = rd.SphericalWristArm(chain)
    far = np.eye(4)
    far[:3, 3] = 2.0, 0.0, 0.0
    out = arm.configurations(far)
    assert out.status == rd.Status.UNREACHABLE and out.q.shape == (0, 6)
    # The wrist centre is at the tool here; the arm is 0.4318 + hypot(0.4318, 0.0203) long and 0.15005 to the side.
    reach = np.hypot(0.4318 + np.hypot(0.4318, 0.0203), 0.15005)
    assert abs(out.distance - (2.0 - reach)) < 1e-9
    assert f"{1e3 * out.distance:.6f} mm" in out.reason
    assert arm.nearest(far, np.zeros(6)) is None
    assert arm.solve(far).shape == (0, 6)
    tight = rd.SphericalWristArm(chain.with_limits(lower=-0.1, upper=0.1))
    limited = tight.configurations(chain.forward([0.0, 0.8, 0.0, 0.3, 0.4, 0.5]))
    assert limited.status == "limits" and "joint 'joint" in limited.reason and "rad outside" in limited.reason


def test_wrist_arm_pickles_and_prints() -> None:
    arm = rd.SphericalWristArm(rd.catalog.load("puma560"))
    again = pickle.loads(pickle.dumps(arm))
    assert again.chain == arm.chain and repr(again) == repr(arm)
    assert "puma560" in repr(arm)
    assert arm.lengths == pytest.approx((0.4318, np.hypot(0.4318, 0.0203)))
    assert arm.shoulder_offset == pytest.approx(0.0) and arm.lateral_offset == pytest.approx(0.15005)


def test_other_arms_are_refused() -> None:
    with pytest.raises(rd.NotSphericalWristError, match="'panda' has 7 joints, 6 are needed"):
        rd.SphericalWristArm(rd.catalog.load("panda"))
    with pytest.raises(
        rd.NotSphericalWristError, match=r"axes 4 and 6 cross axis 5 at points 94\.650 mm apart"
    ):
        rd.SphericalWristArm(load("ur5"))


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda a, p: a.solve(np.full((4, 4), np.nan)), "pose: entry 0 is NaN"),
        (lambda a, p: a.solve(p * 1.01), "pose is not a rigid transform"),
        (lambda a, p: a.solve(p[:3]), "pose has shape (3, 4)"),
        (lambda a, p: a.nearest(p, [0.0] * 5), "q: expected 6 entries, got 5"),
        (lambda a, p: a.nearest(p[None], np.zeros((2, 6))), "rows of q: expected 1 entries, got 2"),
        (lambda a, p: a.solve_batch(p, threads=0), "threads is 0"),
    ],
)
def test_bad_input_of_the_wrist_arm(call, text: str) -> None:
    arm = rd.SphericalWristArm(rd.catalog.load("puma560"))
    with pytest.raises(rd.RedundancyError) as error:
        call(arm, arm.chain.forward(np.full(6, 0.3)))
    assert text in str(error.value)


# IkSolver


# Without a spherical wrist: ur5. With a prismatic joint: the torso of Tiago. The Panda is that of example-robot-data.
@pytest.mark.parametrize(
    "name",
    [
        "iiwa14",
        "panda hand",
        "pa10",
        "dexter",
        "puma560",
        "xarm7",
        "ur5",
        "tiago (prismatic torso)",
        "rtb iiwa14",
    ],
)
def test_every_reachable_pose_is_met_within_limits(name: str) -> None:
    chain = load(name)
    many = 10_000 if name in ("iiwa14", "panda hand") else 1_000
    poses = chain.forward(random_q(chain, many if FULL else 100, 7))
    for closed_form in (False, True):
        ik = rd.IkSolver(chain, closed_form=closed_form)
        batch = ik.solve_batch(poses)
        assert (batch.status == "converged").all()
        assert (batch.position_error <= 1e-6).all() and (batch.orientation_error <= 1e-6).all()
        assert (batch.q >= chain.lower).all() and (batch.q <= chain.upper).all()
        reached = chain.forward(batch.q)
        distance = np.linalg.norm(reached[:, :3, 3] - poses[:, :3, 3], axis=1)
        np.testing.assert_allclose(distance, batch.position_error, atol=1e-12)
        turn = np.linalg.norm(reached[:, :3, :3] - poses[:, :3, :3], axis=(1, 2)) / np.sqrt(2)
        np.testing.assert_allclose(turn, batch.orientation_error, atol=1e-9)


def test_single_calls_and_batches_agree() -> None:
    chain = load("panda")
    q = random_q(chain, 60, 8)
    poses = chain.forward(q)
    ik = rd.IkSolver(chain)
    for q0 in (None, q[0], q[::-1].copy()):
        batch = ik.solve_batch(poses, q0, seed=3)
        assert len(batch) == 60
        one = ik.solve_batch(poses, q0, seed=3, threads=1)
        for field in ("q", "status", "iterations", "position_error", "orientation_error"):
            np.testing.assert_array_equal(getattr(batch, field), getattr(one, field))
        for i in range(0, 60, 7):
            start = q0 if q0 is None or q0.ndim == 1 else q0[i]
            single = ik.solve(poses[i], start, seed=3)
            np.testing.assert_array_equal(single.q, batch.q[i])
            assert (single.status, single.iterations) == (batch.status[i], batch.iterations[i])


def test_out_of_reach_with_the_distance() -> None:
    chain = load("iiwa14")
    top = chain.forward(np.zeros(7))
    for closed_form in (False, True):
        ik = rd.IkSolver(chain, closed_form=closed_form)
        for excess in (1e-5, 1e-3, 0.1):
            pose = top.copy()
            pose[2, 3] += excess
            result = ik.solve(pose)
            assert result.status == rd.Status.UNREACHABLE
            assert abs(result.position_error - excess) < 1e-2 * excess
            assert "out of reach" in result.reason


def test_tasks_and_short_targets() -> None:
    planar = load("planar4r")
    pose = np.eye(4)
    pose[:2, 3] = 4.0, 3.0
    for target in ([4.0, 3.0], [4.0, 3.0, 0.0], pose):
        result = rd.IkSolver(planar, task="planar").solve(target)
        assert result.status == "converged"
        np.testing.assert_allclose(planar.forward(result.q)[:2, 3], [4.0, 3.0], atol=1e-6)
    batch = rd.IkSolver(planar, task="planar_pose").solve_batch(
        np.array([[4.0, 3.0, 2.0], [3.0, -4.0, -1.0]])
    )
    reached = planar.forward(batch.q)
    np.testing.assert_allclose(np.arctan2(reached[:, 1, 0], reached[:, 0, 0]), [2.0, -1.0], atol=1e-6)
    with pytest.raises(rd.RedundancyError, match="row 1: target: entry 0 is inf"):
        rd.IkSolver(planar, task="planar").solve_batch(np.array([[4.0, 3.0], [np.inf, 1.0]]))
    panda = load("panda")
    place = rd.IkSolver(panda, task=rd.Task("position")).solve([0.4, 0.1, 0.5])
    np.testing.assert_allclose(panda.forward(place.q)[:3, 3], [0.4, 0.1, 0.5], atol=1e-6)
    pose = panda.forward([0.3, 0.5, -0.2, -1.1, 0.4, 1.7, -0.9])
    pointing = rd.IkSolver(panda, task=rd.Task.pointing([0, 0, 1])).solve(pose)
    np.testing.assert_allclose(panda.forward(pointing.q)[:3, 2:], pose[:3, 2:], atol=2e-6)


def test_orientation_set_and_criterion() -> None:
    chain = load("panda")
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = 0.45, 0.1, 0.3
    cone = rd.Cone([0, 0, 1], [0, 0, -1], 0.2)
    volume = rd.QuaternionVolume.cone([0, 0, 1], 0.2).reoriented([0.0, 1.0, 0.0, 0.0])
    for orientation_set in (cone, volume):
        tilted = pose.copy()
        tilted[:3, :3] = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
        result = rd.IkSolver(chain, orientation_set=orientation_set).solve(tilted)
        assert result.status == "converged" and result.orientation_error <= 1e-6
        assert chain.forward(result.q)[2, 2] <= -np.cos(0.2 + 1e-6)
    middle = (chain.lower + chain.upper) / 2
    posture = rd.Posture(chain, middle)
    plain, soft = rd.IkSolver(chain).solve(pose), rd.IkSolver(chain, criterion=posture).solve(pose)
    assert soft.status == "converged" and posture.value(soft.q) < posture.value(plain.q)
    null = np.linalg.svd(chain.jacobian(soft.q))[2][6]
    assert abs(null @ posture.gradient(soft.q)) < 1e-4


def test_solver_pickles_and_prints() -> None:
    chain = load("iiwa14")
    ik = rd.IkSolver(
        chain,
        "newton",
        "pointing",
        tol_position=1e-5,
        restarts=7,
        criterion=rd.JointRange(chain),
        time_limit=2.0,
    )
    again = pickle.loads(pickle.dumps(ik))
    assert repr(again) == repr(ik) and "newton" in repr(ik) and "pointing" in repr(ik)
    pose = chain.forward(np.full(7, 0.3))
    result = ik.solve(pose)
    copy = pickle.loads(pickle.dumps(again.solve(pose)))
    np.testing.assert_array_equal(copy.q, result.q)
    assert (copy.status, copy.iterations, repr(copy)) == (result.status, result.iterations, repr(result))
    batch = pickle.loads(pickle.dumps(ik.solve_batch(pose[None])))
    np.testing.assert_array_equal(batch.q[0], result.q)
    assert batch.status[0] is rd.Status.CONVERGED
    assert (
        rd.IkSolver(chain).closed_form == "srs" and rd.IkSolver(chain, closed_form=False).closed_form is None
    )


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (
            lambda c, p: rd.IkSolver(c, "magic"),
            "'magic', expected one of: hybrid, newton, coordinate_descent",
        ),
        (lambda c, p: rd.IkSolver(c, task="pos"), "unknown task 'pos'"),
        (lambda c, p: rd.IkSolver(c, task=3), "task is 3, expected a name or a Task"),
        (lambda c, p: rd.IkSolver(c, tol_position=-1.0), "tol_position is -1, it must be > 0"),
        (lambda c, p: rd.IkSolver(c, max_iterations=0), "max_iterations is 0, it must be >= 1"),
        (lambda c, p: rd.IkSolver(c, orientation_set=3), "orientation_set is 3, expected a Cone"),
        (lambda c, p: rd.IkSolver(c, criterion=rd.JointRange(load("dexter"))), "expected 7 entries, got 8"),
        (lambda c, p: rd.IkSolver(c).solve(p + 1e-3), "not a rigid transform"),
        (lambda c, p: rd.IkSolver(c).solve(p, q0=np.zeros(6)), "q0: expected 7 entries, got 6"),
        (
            lambda c, p: rd.IkSolver(c).solve_batch(np.stack([p, p * 2])),
            "pose 1: pose is not a rigid transform",
        ),
        (
            lambda c, p: rd.IkSolver(c).solve_batch(p[None], np.zeros((2, 7))),
            "rows of q0: expected 1 entries, got 2",
        ),
    ],
)
def test_bad_input_of_the_solver(call, text: str) -> None:
    chain = load("panda")
    with pytest.raises(rd.RedundancyError) as error:
        call(chain, chain.forward(np.full(7, 0.3)))
    assert text in str(error.value)


def test_a_rotation_that_is_not_orthonormal_is_measured() -> None:
    chain = load("panda")
    pose = chain.forward(np.full(7, 0.3))
    pose[0, 0] += 4e-3
    with pytest.raises(
        rd.RedundancyError, match=r"nearest rotation is 0\.00[1-4]\d+, it must be at most 1e-3"
    ):
        rd.IkSolver(chain).solve(pose)


# The best value of one joint, and the five descent algorithms


def test_vector_computed_independently() -> None:
    from scipy.spatial.transform import RigidTransform, Rotation

    axis, origin = np.array([1.0, 2.0, 2.0]) / 3, [0.1, -0.2, 0.3]
    pose = RigidTransform.from_components([0.5, 0.4, -0.1], Rotation.from_quat([0.5, 0.5, 0.5, 0.5]))
    target = RigidTransform.from_components([-0.2, 0.3, 0.6], Rotation.from_quat([0.0, 0.6, 0.0, 0.8]))
    coefficients = rd.joint_cost(axis, origin, pose, target, 2.0, 0.5)
    np.testing.assert_allclose(
        coefficients, [4.508888888888889, -0.488888888888889, -0.493333333333333], atol=1e-14
    )
    np.testing.assert_allclose(
        rd.sinusoid_minimum(*coefficients), [0.7899230193939042, 3.8143457847860613], atol=1e-14
    )
    half = rd.half_angle_minimum(*rd.joint_cost(axis, origin, pose, target, 2.0, 0.5, "quaternions"))
    np.testing.assert_allclose(half, [1.472141448515392, 0.9944508960034008], atol=1e-13)
    with pytest.raises(rd.RedundancyError, match="a: entry 0 is NaN"):
        rd.sinusoid_minimum(0.0, np.nan, 0.0)


DESCENTS = [
    "coordinate_descent",
    "gauss_southwell",
    "gauss_southwell_rate",
    "weighted_descent",
    "gradient_estimate",
]


@pytest.mark.parametrize("method", DESCENTS)
def test_descents_descend_and_solve(method: str) -> None:
    chain = load("puma560")
    q = random_q(chain, 2, 11)
    pose = chain.forward(q[0])
    ik = rd.IkSolver(chain, method, tol_position=1e-3, tol_orientation=1e-3, max_iterations=60)
    trace = ik.trace(pose, q[1])
    assert len(trace) == len(trace.cost) <= 61 and repr(trace).startswith("IkTrace(")
    if method != "weighted_descent":
        assert (np.diff(trace.cost) <= 1e-12).all()
    reached = chain.forward(trace.q)
    cost = 10 * np.sum((reached[:3, 3] - pose[:3, 3]) ** 2) + np.sum((reached[:3, :3] - pose[:3, :3]) ** 2)
    assert abs(cost - trace.cost[-1]) < 1e-10
    many = rd.IkSolver(chain, method, tol_position=1e-3, tol_orientation=1e-3, max_iterations=100_000)
    result = many.solve(pose)
    assert result.status == "converged" and result.position_error <= 1e-3
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(trace)).cost, trace.cost)
    assert repr(pickle.loads(pickle.dumps(ik))) == repr(ik)


def test_settings_of_the_descents() -> None:
    chain = load("iiwa14")
    q = random_q(chain, 2, 12)
    pose = chain.forward(q[0])
    pulled = rd.IkSolver(
        chain,
        "coordinate_descent",
        max_iterations=50,
        order="double",
        attractions=[("link_4", [0.3, 0.3, 0.6], 5.0)],
    )
    plain = rd.IkSolver(
        chain, "coordinate_descent", max_iterations=50, order="base_to_tip", measure="quaternions"
    )

    def away(trace: rd.IkTrace) -> float:
        return float(np.linalg.norm(chain.forward(trace.q, "link_4")[:3, 3] - [0.3, 0.3, 0.6]))

    assert away(pulled.trace(pose, q[1])) < away(plain.trace(pose, q[1]))
    assert away(pickle.loads(pickle.dumps(pulled)).trace(pose, q[1])) == away(pulled.trace(pose, q[1]))
    for options, text in [
        ({"order": "sideways"}, "unknown order 'sideways', expected one of: tip_to_base"),
        ({"measure": "x"}, "unknown measure 'x'"),
        ({"gradient": "x"}, "unknown gradient 'x'"),
        ({"joint_weights": [2.0] * 7}, "joint weight is 2"),
        ({"attractions": [("elbow", [0, 0, 0], 1.0)]}, "unknown link 'elbow'"),
        ({"task": "pointing"}, "needs the task pose"),
    ]:
        with pytest.raises(rd.RedundancyError, match=text):
            rd.IkSolver(chain, "weighted_descent", **options)
