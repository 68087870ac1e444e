"""Velocity schemes from Python: the paper's vector and table, limits, reports, what is refused."""

import pickle

import numpy as np
import pytest

import redundancy as rd

Q_IN = np.deg2rad([40.0, 0, 90, 180, -90, 180, -90, 0])
BASIS = (0, 2, 3, 4, 5, 7)
PUMA = rd.catalog.load("puma560")


@pytest.fixture(scope="module")
def dexter() -> rd.Chain:
    return rd.catalog.load("dexter")


@pytest.fixture(scope="module")
def iiwa() -> rd.Chain:
    return rd.catalog.load("iiwa14")


def schemes(chain: rd.Chain, h: rd.Criterion) -> list[rd.Resolver]:
    return [
        rd.ProjectedGradient(chain, h, 2.0),
        rd.ProjectedGradient(chain, h, "optimal", damping=None),
        rd.ReducedGradient(chain, h, 2.0, "pose"),
        rd.ReducedGradient(
            chain, h, 2.0, rd.Task("pose"), rd.Damping(0.1, 0.2, 0.25), BASIS if chain.dof == 8 else range(6)
        ),
        rd.ExtendedJacobian(chain, h),
        rd.SaturatedNullspace(chain, h, gain=2.0),
    ]


def test_the_vector_of_dexter(dexter: rd.Chain) -> None:
    h = rd.JointRange(dexter)
    projected = rd.ProjectedGradient(dexter, h, 10.0).step(Q_IN, np.zeros(6)).qd
    reduced = rd.ReducedGradient(dexter, h, 10.0, basis=BASIS).step(Q_IN, np.zeros(6)).qd
    assert np.abs(projected[:3] - [0.006430796215, 0.034719426863, 0.008335097797]).max() < 1e-11
    assert np.abs(reduced[:3] - [0.016891013009, 0.20777011991, 0.021892817097]).max() < 1e-11


def test_the_task_is_met_and_the_freedom_stays_off_it(iiwa: rd.Chain) -> None:
    rng = np.random.default_rng(0)
    h = rd.Posture(iiwa, np.zeros(7)) + rd.Posture(iiwa, np.full(7, 0.3))
    for scheme in schemes(iiwa, h):
        for _ in range(50):
            q = rng.uniform(iiwa.lower, iiwa.upper)
            v = rng.uniform(-0.05, 0.05, 6)
            step = scheme.step(q, v, dt=0.01)
            if step.sigma_min > 0.05 and step.damping == 0.0:
                speed = max(1.0, np.abs(step.qd).max())
                assert np.abs(iiwa.jacobian(q) @ step.qd - step.scale * v).max() < 1e-12 * speed
                sigma = np.linalg.svd(iiwa.jacobian(q), compute_uv=False)[-1]
                assert abs(step.sigma_min - sigma) < 1e-12


def test_limits_hold_and_are_named(iiwa: rd.Chain) -> None:
    chain = iiwa.with_limits(acceleration=np.full(7, 5.0))
    scheme = rd.SaturatedNullspace(chain, rd.JointRange(chain), gain=5.0)
    rng = np.random.default_rng(1)
    q, qd, dt = np.array([0.3, 0.6, -0.2, -1.2, 0.1, 0.9, 0.4]), np.zeros(7), 0.01
    named = set()
    for k in range(500):
        if k % 50 == 0:
            v = rng.uniform(-1, 1, 6)
        step = scheme.step(q, v, dt, qd)
        assert np.all(np.abs(step.qd) <= chain.velocity_limit + 1e-9)
        assert np.all(np.abs(step.qd - qd) <= 5.0 * dt + 1e-9)
        named |= {limit[1] for limit in step.active_limits}
        q, qd = q + dt * step.qd, step.qd
        assert np.all(q <= chain.upper + 1e-9) and np.all(q >= chain.lower - 1e-9)
    assert {"velocity", "acceleration"} <= named


def test_a_start_outside_the_limits_is_brought_back_and_reported(iiwa: rd.Chain) -> None:
    q = np.array([0.3, 0.6, -0.2, -1.2, 0.1, 0.9, 0.4])
    q[3] = iiwa.lower[3] - 0.1
    path = rd.Path([iiwa.forward(q)] * 2, t=[0.0, 2.0])
    run = rd.track(iiwa, rd.SaturatedNullspace(iiwa), path, q, 0.01)
    assert run.q[-1][3] >= iiwa.lower[3] - 1e-12
    assert np.all(np.abs(run.qd) <= iiwa.velocity_limit + 1e-9)
    assert {str(event.kind) for event in run.events} >= {"joint_limit", "limit"}


def test_singularities_are_passed_at_a_bounded_speed(iiwa: rd.Chain) -> None:
    # Stretched in the middle of the way: out, and back.
    q0 = np.array([0.0, 0.5, 0.0, -0.6, 0.0, 0.5, 0.0])
    start = iiwa.forward(q0)
    poses = np.repeat(start[None], 101, axis=0)
    poses[:, :3, 3] += 0.12 * np.sin(np.linspace(0, np.pi, 101))[:, None] * np.array([0.6, 0.0, 0.8])
    path = rd.Path(poses, t=np.linspace(0, 4, 101))
    h = rd.JointRange(iiwa)
    for scheme in (rd.ProjectedGradient(iiwa, h, 1.0), rd.ReducedGradient(iiwa, h, 1.0)):
        run = rd.track(iiwa, scheme, path, q0, 0.005, 5.0)
        assert np.isfinite(run.q).all() and np.abs(run.qd).max() < 60.0
        assert run.position_error < 0.2
        kinds = {str(event.kind) for event in run.events}
        assert "damping" in kinds or run.position_error < 1e-3


def test_other_tasks(iiwa: rd.Chain) -> None:
    circle = rd.paths.circle((0.5, 0.0, 0.5), 0.1, n=200)  # positions only, no times
    srs = rd.SrsArm(iiwa)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.diag([1.0, -1, -1]), circle.poses[0][:3, 3]
    q0 = srs.self_motion(pose).best(rd.JointRange(iiwa)).q
    assert q0 is not None
    scheme = rd.ProjectedGradient(iiwa, rd.JointRange(iiwa), 1.0, task="position")
    run = rd.track(iiwa, scheme, circle, q0, 0.01, 20.0)
    assert run.position_error < 2e-3
    assert np.all(np.abs(run.qd) <= iiwa.velocity_limit)
    with pytest.raises(rd.RedundancyError, match="positions only"):
        rd.track(iiwa, rd.ProjectedGradient(iiwa, None, 1.0), circle, q0, 0.01)
    pointing = rd.ProjectedGradient(iiwa, rd.JointRange(iiwa), 1.0, task="pointing")
    axis = iiwa.forward(q0)[:3, 2]
    free = pointing.step(q0, np.r_[0, 0, 0, axis])  # the spin about the tool axis does not count
    assert np.array_equal(free.qd, pointing.step(q0, np.zeros(6)).qd) or np.allclose(
        free.qd, pointing.step(q0, np.zeros(6)).qd, atol=1e-12
    )
    assert pointing.task == rd.Task("pointing")


def test_pickles(dexter: rd.Chain) -> None:
    for scheme in schemes(dexter, rd.JointRange(dexter)):
        again = pickle.loads(pickle.dumps(scheme))
        assert type(again) is type(scheme) and repr(again) == repr(scheme)
        a, b = (s.step(Q_IN, np.full(6, 0.01), 0.01) for s in (scheme, again))
        assert np.array_equal(a.qd, b.qd)
        step = pickle.loads(pickle.dumps(a))
        assert np.array_equal(step.qd, a.qd) and step.status == a.status
        assert step.active_limits == a.active_limits and step.sigma_min == a.sigma_min
    damping = rd.Damping(0.1, 0.2, 0.25)
    assert pickle.loads(pickle.dumps(damping)) == damping
    assert abs(damping.square(0.1) - 0.008044988905) < 1e-12
    path = rd.Path([dexter.forward(Q_IN)] * 2, t=[0.0, 0.1])
    run = rd.track(dexter, rd.ProjectedGradient(dexter, None, 0.0), path, Q_IN, 0.01)
    same = pickle.loads(pickle.dumps(run))
    assert same.position_error == run.position_error and np.array_equal(same.q, run.q)


@pytest.mark.parametrize(
    ("call", "parts"),
    [
        (lambda a, h: rd.ProjectedGradient(a, h, -1.0), ["gain", "-1", ">= 0"]),
        (lambda a, h: rd.ProjectedGradient(a, h, "best"), ["gain", "best", "optimal"]),
        (lambda a, h: rd.ProjectedGradient(a, h, np.nan), ["gain", "NaN"]),
        (lambda a, h: rd.ProjectedGradient(a, rd.JointRange(rd.catalog.load("puma560")), 1.0), ["7", "6"]),
        (lambda a, h: rd.ProjectedGradient(a, h, 1.0, task="tcp"), ["tcp", "pose_rpy"]),
        (lambda a, h: rd.ProjectedGradient(a, h, 1.0, task=3), ["task", "3"]),
        (lambda a, h: rd.ProjectedGradient(a, h, 1.0, damping="on"), ["damping", "on", "auto"]),
        (lambda a, h: rd.Damping(0.0, 0.1, 0.5), ["maximum", "0", "> 0"]),
        (lambda a, h: rd.Damping(0.1, 0.1, 1.0), ["rho", "1", "[0, 1)"]),
        (lambda a, h: rd.ReducedGradient(a, h, 1.0, basis=(0, 1)), ["basis", "6", "2"]),
        (lambda a, h: rd.ReducedGradient(a, h, 1.0, basis=(0, 1, 2, 3, 4, 7)), ["basis", "7", "< 7"]),
        (lambda a, h: rd.ReducedGradient(a, h, 1.0, basis=(0, 1, 2, 3, 4, -1)), ["basis", "-1", ">= 0"]),
        (lambda a, h: rd.ReducedGradient(a, h, 1.0, basis=(0, 1, 2, 3, 4, 4)), ["4", "twice"]),
        (
            lambda a, h: rd.ExtendedJacobian(
                rd.catalog.load("puma560"), rd.JointRange(rd.catalog.load("puma560"))
            ),
            ["6"],
        ),
        (
            lambda a, h: rd.ProjectedGradient(rd.catalog.load("planar3r"), None, 1.0),
            ["6 coordinates", "3 joints"],
        ),
        (lambda a, h: rd.ProjectedGradient(a, h, 1.0).step(np.zeros(6), np.zeros(6)), ["q", "7", "6"]),
        (
            lambda a, h: rd.ProjectedGradient(a, h, 1.0).step(np.zeros(7), np.zeros(5)),
            ["task_velocity", "6", "5"],
        ),
        (lambda a, h: rd.ProjectedGradient(a, h, 1.0).step(np.full(7, np.nan), np.zeros(6)), ["q", "NaN"]),
        (
            lambda a, h: rd.ProjectedGradient(a, h, 1.0).step(np.zeros(7), np.zeros(6), 0.0),
            ["dt", "0", "> 0"],
        ),
        (lambda a, h: rd.SaturatedNullspace(a, h).step(np.zeros(7), np.zeros(6)), ["dt", "missing"]),
        (
            lambda a, h: rd.SaturatedNullspace(a, h).step(np.zeros(7), np.zeros(6), 0.1, np.zeros(6)),
            ["qd", "7"],
        ),
        (
            lambda a, h: rd.ProjectedGradient(a, h, "optimal").step(np.zeros(7), np.zeros(6)),
            ["dt", "optimal"],
        ),
    ],
)
def test_what_is_refused(iiwa: rd.Chain, call, parts: list[str]) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(rd.RedundancyError) as caught:
        call(iiwa, rd.JointRange(iiwa))
    for part in parts:
        assert part in str(caught.value), str(caught.value)


def test_what_track_refuses(iiwa: rd.Chain) -> None:
    q0 = np.full(7, 0.3)
    path = rd.Path([iiwa.forward(q0)] * 2, t=[0.0, 1.0])
    scheme = rd.ProjectedGradient(iiwa, None, 0.0)
    with pytest.raises(rd.RedundancyError, match="dt is 0"):
        rd.track(iiwa, scheme, path, q0, 0.0)
    with pytest.raises(rd.RedundancyError, match="feedback is 300"):
        rd.track(iiwa, scheme, path, q0, 0.01, 300.0)
    with pytest.raises(rd.RedundancyError, match="another chain"):
        rd.track(rd.catalog.load("pa10"), scheme, path, q0, 0.01)
    with pytest.raises(rd.RedundancyError, match="10 million"):
        rd.track(iiwa, scheme, path, q0, 1e-9)
    with pytest.raises(rd.RedundancyError, match="q"):
        rd.track(iiwa, scheme, path, np.full(6, 0.3), 0.01)


def test_a_step_longer_than_the_path() -> None:
    arm = rd.catalog.load("iiwa14")
    q = np.array([0.3, 0.6, -0.2, -1.2, 0.1, 0.5, 0.4])
    path = rd.Path(arm.forward(np.array([q, q + 0.01]))).with_times(np.array([0.0, 1.0]))
    with pytest.raises(rd.RedundancyError, match="dt is 2, it must be <= 1 s, the duration of the path"):
        rd.track(arm, rd.ProjectedGradient(arm, None, 0.0), path, q, 2.0, 0.1)


@pytest.mark.parametrize("factor", [0.0, 1e308, 1e-300])
def test_factors_that_would_overflow(factor: float) -> None:
    with pytest.raises(
        rd.RedundancyError,
        match=r"factor is (0|1e308|1e-300), it must be not 0 and of a magnitude up to 1e60",
    ):
        factor * rd.JointRange(rd.catalog.load("iiwa14"))


def test_a_middle_frame_and_the_formula_of_the_paper(dexter: rd.Chain) -> None:
    h = rd.JointRange(dexter)
    q = np.deg2rad([40.0, 10, 80, 170, -80, 170, -80, 10])
    basis = (0, 2, 3, 4, 5, 7)
    middle = rd.ReducedGradient(dexter, h, 10.0, task="pose_rpy", damping=None, basis=basis, frame="link4")
    plain = rd.ReducedGradient(dexter, h, 10.0, task="pose_rpy", damping=None, basis=basis)
    assert (middle.frame, plain.frame) == ("link4", None)
    # Eq. (7), written out: S = +skew(r).
    pose, fourth = dexter.forward(q), dexter.forward(q, "link4")
    r = pose[:3, 3] - fourth[:3, 3]
    skew = np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
    turn = fourth[:3, :3].T
    change = np.block([[turn, turn @ skew], [np.zeros((3, 3)), turn]])
    assert np.abs(middle.jacobian(q) - change @ dexter.jacobian(q)).max() < 1e-15
    assert plain.jacobian(q).shape == (6, 8)
    v = [0.1, -0.2, 0.1, 0.2, 0.1, -0.3]
    assert np.abs(middle.step(q, v).qd - plain.step(q, v).qd).max() < 1e-12
    projected = rd.ProjectedGradient(dexter, h, 10.0, task="pose_rpy", damping=None, frame="link4")
    assert np.abs(plain.jacobian(q) @ projected.step(q, v).qd - v).max() < 1e-12
    again = pickle.loads(pickle.dumps(projected))
    assert again.frame == "link4" and np.all(again.step(q, v).qd == projected.step(q, v).qd)
    with pytest.raises(rd.RedundancyError, match="'position'"):
        rd.ProjectedGradient(dexter, h, 10.0, task="position", frame="link4")
    with pytest.raises(rd.RedundancyError, match="robust"):
        rd.ReducedGradient(dexter, h, 10.0, form="papr")  # type: ignore[arg-type]


def test_a_scheduled_basis(dexter: rd.Chain) -> None:
    q = np.deg2rad([40.0, 0, 90, 180, -90, 180, -90, 0])
    later = (0, 2, 3, 5, 6, 7)
    scheme = rd.ReducedGradient(
        dexter, rd.JointRange(dexter), 10.0, damping=None, basis=(0, 2, 3, 4, 5, 7), schedule=[(0.05, later)]
    )
    scheme = pickle.loads(pickle.dumps(scheme))
    changed = [scheme.step(q, np.zeros(6), dt=0.025).basis_changed for _ in range(5)]
    assert changed == [False, False, True, False, False]
    assert scheme.basis == list(later)
    with pytest.raises(rd.RedundancyError, match="basis of the start"):
        rd.ReducedGradient(dexter, None, 0.0, schedule=[(1.0, later)])
    with pytest.raises(rd.RedundancyError, match="dt is missing"):
        scheme.step(q, np.zeros(6))
