"""Wishes, blocked tasks, criteria of torque, energy and one's own, priorities, the acceleration level."""

import os
import pickle
import signal
import threading
import time

import numpy as np
import pinocchio as pin
import pytest
from arms import as_pinocchio
from scipy.optimize import lsq_linear

import redundancy as rd

Q = np.array([0.3, 0.6, -0.2, -1.2, 0.1, 0.9, 0.4])
DOWN = np.array([0.0, 0.0, -9.81])


@pytest.fixture(scope="module")
def iiwa() -> rd.Chain:
    return rd.catalog.load("iiwa14")


def random_q(rng: np.random.Generator, chain: rd.Chain) -> np.ndarray:
    return rng.uniform(np.maximum(chain.lower, -np.pi), np.minimum(chain.upper, np.pi))


def everything(arm: rd.Chain, h: rd.Criterion) -> dict[str, rd.Resolver]:
    """Every scheme with a criterion."""
    return {
        "projected": rd.ProjectedGradient(arm, h, 1.0),
        "optimal": rd.ProjectedGradient(arm, h, "optimal"),
        "reduced": rd.ReducedGradient(arm, h, 1.0),
        "extended": rd.ExtendedJacobian(arm, h),
        "saturated": rd.SaturatedNullspace(arm, h),
    }


def test_a_wish_is_projected(iiwa: rd.Chain) -> None:
    v, wish = np.array([0.02, 0.0, 0.01, 0.0, 0.05, 0.0]), np.linspace(-0.1, 0.1, 7)
    jacobian = iiwa.jacobian(Q)
    expected = wish + np.linalg.pinv(jacobian) @ (v - jacobian @ wish)
    for name, scheme in everything(iiwa, rd.JointRange(iiwa)).items():
        step = scheme.step(Q, v, 0.01, None, wish)
        assert np.array_equal(step.qd, scheme.step(Q, v, dt=0.01, wish=wish).qd)
        assert np.abs(jacobian @ step.qd - v).max() < 1e-12
        if name != "reduced":
            assert np.abs(step.qd - expected).max() < 1e-12, name
    with pytest.raises(rd.RedundancyError, match="wish"):
        rd.ProjectedGradient(iiwa, None, 1.0).step(Q, v, wish=[0.0] * 6)


def test_closest_is_the_least_error_within_limits(iiwa: rd.Chain) -> None:
    rng = np.random.default_rng(0)
    blocked = 0
    for _ in range(60):
        q = random_q(rng, iiwa)
        room = rng.integers(0, 2, (2, 7)).astype(float)
        arm = iiwa.with_limits(q - room[0] - 1e-9, q + room[1] + 1e-9, velocity=rng.uniform(0.3, 2.0, 7))
        v = rng.uniform(-0.5, 0.5, 6)
        scheme = rd.SaturatedNullspace(arm, when_blocked="closest")
        step = scheme.step(q, v, 0.01)
        if rd.SaturatedNullspace(arm).step(q, v, 0.01).scale > 1e-6:
            continue
        blocked += 1
        speed = arm.velocity_limit
        low = np.where(room[0] > 0, -speed, -1e-7)
        high = np.where(room[1] > 0, speed, 1e-7)
        best = lsq_linear(arm.jacobian(q), v, (low, high), method="bvls", tol=1e-14, max_iter=500)
        assert best.success
        error = np.linalg.norm(arm.jacobian(q) @ step.qd - v)
        assert abs(error - np.linalg.norm(arm.jacobian(q) @ best.x - v)) < 1e-6
        assert step.status == "limits" and step.scale == 0.0 and abs(step.residual - error) < 1e-12
        again = pickle.loads(pickle.dumps(scheme))
        assert np.array_equal(again.step(q, v, 0.01).qd, step.qd)
    assert blocked > 20
    with pytest.raises(rd.RedundancyError, match="closest"):
        rd.SaturatedNullspace(iiwa, when_blocked="never")


def test_torque_and_energy_agree_with_pinocchio(iiwa: rd.Chain) -> None:
    rng = np.random.default_rng(1)
    model = as_pinocchio(iiwa)
    data = model.createData()
    model.gravity.linear[:] = DOWN
    speed = rng.uniform(-1, 1, 7)
    norm, peak = rd.GravityTorque(iiwa), rd.GravityTorque(iiwa, measure="peak")
    energy, whole = rd.KineticEnergy(iiwa, qd=speed), rd.KineticEnergy(iiwa)
    for _ in range(20):
        q = random_q(rng, iiwa)
        at = pin.integrate(model, pin.neutral(model), q)
        torque = pin.computeGeneralizedGravity(model, data, at)
        assert abs(norm.value(q) - np.linalg.norm(torque)) < 1e-10
        assert abs(peak.value(q) - np.abs(torque).max()) < 1e-10
        slope = pin.computeGeneralizedGravityDerivatives(model, data, at).T @ torque
        assert np.abs(norm.gradient(q) - slope / np.linalg.norm(torque)).max() < 1e-9
        mass = pin.crba(model, data, at)
        mass = np.triu(mass) + np.triu(mass, 1).T
        assert abs(energy.value(q) - 0.5 * speed @ mass @ speed) < 1e-10
        assert abs(whole.value(q) - 0.5 * np.trace(mass)) < 1e-10
    assert norm.sense == energy.sense == "minimize"
    with pytest.raises(rd.RedundancyError, match="inertias"):
        rd.GravityTorque(rd.catalog.load("planar3r"))


def test_new_criteria_everywhere(iiwa: rd.Chain) -> None:
    arm = rd.SrsArm(iiwa)
    pose = iiwa.forward(Q)
    own = rd.CustomCriterion(lambda q: float(((q - Q) ** 2).sum()), lambda q: 2 * (q - Q))
    path = rd.paths.circle([0.5, 0.0, 0.4], 0.08, n=12)
    for h in (
        rd.GravityTorque(iiwa),
        rd.GravityTorque(arm, "peak", weights=1 / iiwa.effort_limit),
        rd.KineticEnergy(iiwa),
        rd.Swivel(arm, 0.4),
        own,
        own + 2.0 * rd.JointRange(iiwa),
        rd.CustomCriterion(lambda q: q[1] ** 2, chain=iiwa),
    ):
        for scheme in everything(iiwa, h).values():
            step = scheme.step(Q, np.zeros(6), 0.01)
            assert np.abs(iiwa.jacobian(Q) @ step.qd).max() < 1e-9
        best = rd.solutions(iiwa, pose).best(h)
        assert best.value <= h.value(Q) + 1e-9
        assert abs(arm.self_motion(pose).best(h).value - best.value) < 1e-6
        made = rd.plan(iiwa, path, criterion=h, criterion_weight=0.1, time_limit=20.0)
        assert made.status == "converged", (h, made.reason)
    wanted = arm.swivel(Q) + 0.05
    swivel = rd.Swivel(arm, wanted)
    best = arm.self_motion(pose).best(swivel)
    assert abs(arm.swivel(best.q) - wanted) < 1e-4
    for h in (rd.GravityTorque(arm, "peak"), rd.KineticEnergy(iiwa, qd=[0.1] * 7), swivel):
        again = pickle.loads(pickle.dumps(h))
        assert again.value(Q) == h.value(Q) and repr(again) == repr(h)


def test_gradients_of_own_criteria(iiwa: rd.Chain) -> None:
    given = rd.CustomCriterion(lambda q: np.sin(q[0]) * q[1], sense="maximize")
    assert given.sense == "maximize" and given.dof is None
    assert np.abs(given.gradient(Q) - [np.cos(Q[0]) * Q[1], np.sin(Q[0]), 0, 0, 0, 0, 0]).max() < 1e-9
    assert given.gradient(np.array([Q, Q])).shape == (2, 7)
    hessian = given.hessian(Q)
    assert abs(hessian[0, 1] - np.cos(Q[0])) < 1e-6 and abs(hessian[0, 0] + np.sin(Q[0]) * Q[1]) < 1e-6
    assert (given + -rd.JointRange(iiwa)).dof == 7


class OwnError(Exception):
    pass


def fails(q: np.ndarray) -> float:
    raise OwnError(f"at {q[0]:.1f}")


def test_exceptions_of_own_criteria_are_raised(iiwa: rd.Chain) -> None:
    arm, pose = rd.SrsArm(iiwa), iiwa.forward(Q)
    path = rd.paths.circle(pose[:3, 3] - [0.08, 0.0, 0.0], 0.08, orientation=pose, n=12)
    bad = rd.CustomCriterion(fails)
    for h in (bad, 2.0 * bad + rd.JointRange(iiwa)):
        for name, scheme in everything(iiwa, h).items():
            with pytest.raises(OwnError, match=r"at 0\.3"):
                scheme.step(Q, np.zeros(6), 0.01)
            with pytest.raises(OwnError):
                rd.track(iiwa, scheme, path, Q, 0.05)
            assert scheme.step(Q, np.zeros(6), 0.01, wish=[0.0] * 7).scale == 1.0 or name == "saturated"
        calls = [
            lambda h=h: h.value(Q),
            lambda h=h: h.gradient(Q),
            lambda h=h: h.hessian(Q),
            lambda h=h: rd.solutions(iiwa, pose).best(h),
            lambda h=h: arm.self_motion(pose).best(h),
            lambda h=h: arm.best_batch([pose, pose], h),
            lambda h=h: rd.plan(iiwa, path, criterion=h),
            lambda h=h: rd.classify(iiwa, Q, h),
            lambda h=h: rd.constrained_optima(iiwa, pose, h, starts=20),
            lambda h=h: rd.follow_optimum(iiwa, path, Q, h),
            lambda h=h: rd.rank_starts(iiwa, path, h, starts=20),
            lambda h=h: rd.algorithmic_singularities(iiwa, h, starts=20),
            lambda h=h: rd.IkSolver(iiwa, criterion=h).solve(pose, Q),
            lambda h=h: rd.IkSolver(iiwa, criterion=h).solve_batch([pose, pose], Q),
        ]
        for call in calls:
            with pytest.raises(OwnError):
                call()
    # The next call is a new one.
    flag = [True]
    moody = rd.CustomCriterion(lambda q: fails(q) if flag[0] else 1.0)
    with pytest.raises(OwnError):
        moody.value(Q)
    flag[0] = False
    assert moody.value(Q) == 1.0
    with pytest.raises(rd.RedundancyError, match="NaN"):
        rd.CustomCriterion(lambda q: float("nan")).value(Q)
    with pytest.raises(rd.RedundancyError, match="gradient of the CustomCriterion"):
        rd.CustomCriterion(lambda q: 0.0, lambda q: [0.0]).gradient(Q)
    with pytest.raises(TypeError):
        rd.CustomCriterion(lambda q: "high").value(Q)
    with pytest.raises(rd.RedundancyError, match="function"):
        rd.CustomCriterion(3.0)


def test_a_resolver_may_not_call_itself(iiwa: rd.Chain) -> None:
    made: list[rd.Resolver] = []
    h = rd.CustomCriterion(lambda q: made[0].step(q, [0.0] * 6).scale, chain=iiwa)
    made.append(rd.ProjectedGradient(iiwa, h, 1.0))
    with pytest.raises(rd.RedundancyError, match="called this resolver"):
        made[0].step(Q, [0.0] * 6)


def test_threads_share_a_resolver_with_an_own_criterion(iiwa: rd.Chain) -> None:
    h = rd.CustomCriterion(lambda q: float(sum(x * x for x in q)))
    scheme = rd.ProjectedGradient(iiwa, h, 1.0)
    expected, wrong = scheme.step(Q, [0.0] * 6).qd, []

    def work() -> None:
        wrong.extend(1 for _ in range(50) if not np.array_equal(scheme.step(Q, [0.0] * 6).qd, expected))

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=60)
        assert not thread.is_alive()
    assert not wrong


def test_control_c_stops_an_own_criterion(iiwa: rd.Chain) -> None:
    def slow(q: np.ndarray) -> float:
        until = time.perf_counter() + 0.005
        while time.perf_counter() < until:
            pass
        return float(q @ q)

    pose = iiwa.forward(Q)
    path = rd.paths.circle(pose[:3, 3] - [0.08, 0.0, 0.0], 0.08, orientation=pose, n=40)
    timer = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        rd.rank_starts(iiwa, path, rd.CustomCriterion(slow))
    timer.join()


def test_priorities(iiwa: rd.Chain) -> None:
    elbow = iiwa.link_names[4]
    tasks = [
        ("half_space", None, [0.0, 0.0, 0.1], [0.0, 0.0, 1.0]),
        ("pose", None),
        ("position", elbow),
        ("cone", elbow, [0, 0, 1], [0, 0, 1], 3.0),
    ]
    scheme = rd.PrioritizedNullspace(iiwa, tasks, criterion=rd.JointRange(iiwa), gain=2.0)
    v, up = [0.05, 0, 0, 0, 0.1, 0], [0, 0.05, 0]
    step = scheme.step(Q, [None, v, up, None], 0.01, np.zeros(7))
    assert step.scales.shape == step.residuals.shape == (4,)
    assert step.scales[0] == 1.0 and step.residuals[2] > 0
    assert np.abs(iiwa.jacobian(Q) @ step.qd - step.scales[1] * np.array(v)).max() < 1e-12
    assert np.array_equal(scheme.step(Q, [v, up], 0.01, np.zeros(7)).qd, step.qd)
    for thing in (scheme, step):
        again = pickle.loads(pickle.dumps(thing))
        assert repr(again) == repr(thing)
    wish = np.linspace(-0.2, 0.2, 7)
    one = rd.PrioritizedNullspace(iiwa, [("pose", None)])
    same = rd.SaturatedNullspace(iiwa).step(Q, v, 0.01, np.zeros(7), wish)
    assert np.abs(one.step(Q, [v], 0.01, np.zeros(7), wish).qd - same.qd).max() < 1e-9
    for wrong, words in (
        ([], "at least one"),
        ([("pose", "nowhere")], "nowhere"),
        ([("poses", None)], "poses"),
        ([("cone", None, [0, 0, 1])], "entries"),
        ([("half_space", None, [0, 0, 0], [0, 0, 0])], "normal"),
        (["pose"], "expected"),
    ):
        with pytest.raises(rd.RedundancyError, match=words):
            rd.PrioritizedNullspace(iiwa, wrong)
    with pytest.raises(rd.RedundancyError, match="one per task"):
        one.step(Q, [v, v], 0.01)
    with pytest.raises(rd.RedundancyError, match="must be None"):
        scheme.step(Q, [1.0, v, up, None], 0.01)


@pytest.mark.parametrize("name", ["iiwa14", "dexter"])
def test_accelerations_agree_with_pinocchio(name: str) -> None:
    chain = rd.catalog.load(name)
    model = as_pinocchio(chain)
    data = model.createData()
    frame = model.nframes - 1
    rng = np.random.default_rng(2)
    h = rd.JointRange(chain)
    schemes = [
        rd.ProjectedGradient(chain, h, 5.0, level="acceleration"),
        rd.ReducedGradient(chain, h, 5.0, level="acceleration"),
        rd.ProjectedGradient(
            chain, h, 5.0, level="acceleration", weights=list(rng.uniform(0.5, 2, chain.dof))
        ),
    ]
    if name == "iiwa14":
        schemes.append(rd.ProjectedGradient(chain, h, 5.0, level="acceleration", inverse="inertia"))
    worst = 0.0
    for _ in range(30):
        q, qd = random_q(rng, chain), rng.uniform(-1, 1, chain.dof)
        a = rng.uniform(-1, 1, 6)
        if np.linalg.svd(chain.jacobian(q), compute_uv=False)[-1] < 0.1:
            continue
        at = pin.integrate(model, pin.neutral(model), q)
        for scheme in schemes:
            step = scheme.step_acceleration(q, qd, a)
            pin.forwardKinematics(model, data, at, qd, step.qdd)
            seen = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED).vector
            pose = pin.updateFramePlacement(model, data, frame)
            assert np.abs(pose.homogeneous - chain.forward(q)).max() < 1e-9, "the frame is the tool"
            worst = max(worst, np.abs(seen - a).max() / (1 + np.abs(step.qdd).max()))
    assert worst < 1e-12
    assert [scheme.level for scheme in schemes[:2]] == ["acceleration"] * 2
    again = pickle.loads(pickle.dumps(schemes[0]))
    assert np.array_equal(again.step_acceleration(q, qd, a).qdd, schemes[0].step_acceleration(q, qd, a).qdd)
    again = pickle.loads(pickle.dumps(step))
    assert repr(again) == repr(step)
    with pytest.raises(rd.RedundancyError, match="step_acceleration"):
        schemes[0].step(q, a)
    with pytest.raises(rd.RedundancyError, match="velocity level"):
        rd.ProjectedGradient(chain, h, 5.0).step_acceleration(q, qd, a)
    with pytest.raises(rd.RedundancyError, match="acceleration"):
        rd.ExtendedJacobian(chain, h).step_acceleration(q, qd, a)
    with pytest.raises(rd.RedundancyError, match="level"):
        rd.ProjectedGradient(chain, h, 5.0, level="jerk")
