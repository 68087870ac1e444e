"""From poses to configurations, through the Python face."""

import pickle

import numpy as np
import pytest
from arms import Robot, robots

import redundancy as rd

ROBOTS = robots()


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
