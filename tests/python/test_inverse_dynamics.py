"""Torques and their derivatives: agreement with pinocchio, batches, what is refused."""

import numpy as np
import pinocchio as pin
import pytest
from arms import as_pinocchio, random_q, robots

import redundancy as rd

ARMS = ["puma560", "iiwa14", "panda"]
URDFS = ["ur5", "kinova (continuous)", "tiago (prismatic torso)", "panda finger (prismatic)"]
GRAVITY = np.array([0.7, -1.2, -9.3])
TOLERANCE = 1e-10


def load(name: str) -> rd.Chain:
    if name in ARMS:
        chain = rd.catalog.load(name)
    else:
        robot = robots()[name]
        chain = rd.Chain.from_urdf(robot.path, robot.base, robot.tip)
    return chain.with_base(pin.SE3(pin.utils.rpyToMatrix(0.3, -0.4, 0.5), np.array([0.2, -0.3, 0.4])))


@pytest.mark.parametrize("name", ARMS + URDFS)
def test_torques_and_derivatives_agree_with_pinocchio(name: str) -> None:
    chain = load(name)
    model = as_pinocchio(chain)
    model.gravity.linear = GRAVITY
    data = model.createData()
    qs, qds, qdds = (random_q(chain, seed, 100) for seed in (1, 2, 3))
    batch = chain.inverse_dynamics(qs, qds, qdds, GRAVITY)
    for q, qd, qdd, row in zip(qs, qds, qdds, batch, strict=True):
        turning = pin.neutral(model)
        for j in range(chain.dof):
            joint = model.joints[j + 1]
            turning[joint.idx_q : joint.idx_q + joint.nq] = q[j]
        expected = pin.rnea(model, data, turning, qd, qdd)
        tau = chain.inverse_dynamics(q, qd, qdd, GRAVITY)
        assert np.array_equal(tau, row)
        assert np.abs(tau - expected).max() <= TOLERANCE * np.abs(expected).max()
        pin.computeRNEADerivatives(model, data, turning, qd, qdd)
        mass = np.triu(data.M) + np.triu(data.M, 1).T
        for ours, theirs in zip(
            chain.inverse_dynamics_derivatives(q, qd, qdd, GRAVITY),
            (data.dtau_dq, data.dtau_dv, mass),
            strict=True,
        ):
            assert np.abs(ours - theirs).max() <= TOLERANCE * np.abs(theirs).max()


def test_puma_is_the_arm_of_the_paper() -> None:
    # What the shoulder holds with the arm stretched out, from masses and centres of mass by hand.
    chain = rd.catalog.load("puma560")
    zero = np.zeros(6)
    links = (
        17.4 * (0.4318 - 0.3638) + 4.8 * (0.4318 + 0.0203 - 0.0203) + (0.82 + 0.34 + 0.09) * (0.4318 + 0.0203)
    )
    # Link 4's centre of mass lies .019 along its y, which is -z here.
    assert chain.inverse_dynamics(zero, zero, zero)[1] == pytest.approx(9.81 * links, rel=1e-12)
    only_rotor = chain.inverse_dynamics_derivatives(zero, zero, zero)[2][5, 5] - 0.04e-3
    assert only_rotor == pytest.approx(76.686**2 * 3.3e-5, rel=1e-12)


def test_single_rows_count_for_the_batch() -> None:
    chain = rd.catalog.load("iiwa14")
    q, zero = random_q(chain, 5, 700), np.zeros(7)
    many = chain.inverse_dynamics(q, zero, zero)
    assert many.shape == (700, 7)
    assert np.array_equal(many, chain.inverse_dynamics(q, np.zeros((700, 7)), zero, threads=1))
    assert np.array_equal(many[3], chain.inverse_dynamics(q[3], zero, zero))


def test_what_is_wrong_is_named() -> None:
    chain, zero = rd.catalog.load("puma560"), np.zeros(6)
    with pytest.raises(rd.RedundancyError, match="'pa10' has no inertias"):
        rd.catalog.load("pa10").inverse_dynamics(np.zeros(7), np.zeros(7), np.zeros(7))
    with pytest.raises(rd.RedundancyError, match=r"qd has shape \(5,\)"):
        chain.inverse_dynamics(zero, np.zeros(5), zero)
    with pytest.raises(rd.RedundancyError, match=r"qdd \(rows\)"):
        chain.inverse_dynamics(np.zeros((3, 6)), zero, np.zeros((4, 6)))
    with pytest.raises(rd.RedundancyError, match="gravity"):
        chain.inverse_dynamics(zero, zero, zero, (0.0, np.nan, 0.0))
    with pytest.raises(rd.RedundancyError, match="qdd"):
        chain.inverse_dynamics_derivatives(zero, zero, np.full(6, np.inf))
