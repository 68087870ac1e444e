"""The closed form and the circle of solutions, through the Python face."""

import pickle

import numpy as np
import pytest

import redundancy as rd

TURN = 2 * np.pi


@pytest.fixture(scope="module", params=["pa10", "iiwa14"])
def arm(request: pytest.FixtureRequest) -> rd.SrsArm:
    return rd.SrsArm(rd.catalog.load(request.param))


def random_q(chain: rd.Chain, n: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform(np.maximum(chain.lower, -np.pi), np.minimum(chain.upper, np.pi), (n, chain.dof))


def test_solve_shapes_and_branch_order(arm: rd.SrsArm) -> None:
    q = random_q(arm.chain, 1, 0)[0]
    pose = arm.chain.forward(q)
    rows = arm.solve(pose, arm.swivel(q), limits=False)
    assert rows.shape == (8, 7)
    np.testing.assert_allclose(arm.chain.forward(rows), np.broadcast_to(pose, (8, 4, 4)), atol=1e-12)
    signs = [(a, b, c) for a in (1, -1) for b in (1, -1) for c in (1, -1)]
    assert [arm.branch(row) for row in rows] == signs
    np.testing.assert_allclose(rows[signs.index(arm.branch(q))], q, atol=1e-9)
    # u = (cos s, sin s) is the same swivel.
    u = (np.cos(0.7), np.sin(0.7))
    np.testing.assert_allclose(arm.solve(pose, u), arm.solve(pose, 0.7), atol=1e-12)


def test_out_of_reach_is_a_status(arm: rd.SrsArm) -> None:
    pose = np.eye(4)
    pose[:3, 3] = 5.0, 0.0, 0.0
    assert arm.solve(pose, 0.0, limits=False).shape == (0, 7)
    motion = arm.self_motion(pose)
    assert motion.status == rd.Status.UNREACHABLE == "unreachable"
    assert str(motion.status) == "unreachable"
    assert "mm too far from the shoulder" in motion.reason
    assert motion.branches == []
    best = motion.best(rd.JointRange(arm.chain))
    assert best.q is None and best.value is None and best.reason == motion.reason
    assert arm.nearest(pose, np.zeros(7)) is None


def test_limits_reason_names_the_joint() -> None:
    chain = rd.catalog.load("iiwa14")
    tight = chain.with_limits(lower=-0.2, upper=0.2)
    motion = rd.SrsArm(tight).self_motion(chain.forward([0.0, 0.8, 0.0, -1.2, 0.0, 0.5, 0.0]))
    assert motion.status == "limits"
    assert "joint '" in motion.reason and "rad outside [-0.200000, 0.200000]" in motion.reason
    assert all(len(b.intervals()) == 0 for b in motion.branches)


def test_branch_arrays_and_tangent(arm: rd.SrsArm) -> None:
    q = random_q(arm.chain, 1, 1)[0]
    motion = arm.self_motion(arm.chain.forward(q))
    s = np.linspace(-3, 3, 11)
    for branch in motion.branches:
        rows, rates = branch.q(s), branch.tangent(s)
        assert rows.shape == rates.shape == (11, 7)
        np.testing.assert_array_equal(branch.q(float(s[3])), rows[3])
        jacobians = arm.chain.jacobian(rows)
        speed = np.linalg.norm(rates, axis=1)
        drift = np.linalg.norm(np.einsum("nij,nj->ni", jacobians, rates), axis=1)
        assert (drift < 1e-12 * np.maximum(speed, 1)).all()


def test_intervals_hold_and_margins_shrink_them(arm: rd.SrsArm) -> None:
    for q in random_q(arm.chain, 20, 2):
        motion = arm.self_motion(arm.chain.forward(q))
        for branch in motion.branches:
            wide, narrow = branch.intervals(), branch.intervals(margin=0.1)
            for lo, hi in narrow:
                middle = (lo + hi) / 2
                assert any((middle - a) % TURN <= b - a for a, b in wide)
                at = branch.q(middle)
                assert (at > arm.chain.lower + 0.1 - 1e-9).all()
                assert (at < arm.chain.upper - 0.1 + 1e-9).all()


@pytest.mark.parametrize("offset", [0.0, 0.2, 0.7, 1.2, 3.0])
def test_a_range_of_exactly_half_a_turn(offset: float) -> None:
    # The middle of such a range is lo + hi = 0 as vectors: its rounding once decided.
    h, free = np.pi / 2, [np.inf] * 6
    rows = [[0, 0.3, -h, offset], [0, 0, h, 0], [0, 0.45, -h, 0], [0, 0, h, 0], [0, 0.5, -h, 0], [0, 0, h, 0]]
    rows.append([0, 0.08, 0, 0])
    arm = rd.SrsArm(rd.Chain.from_dh(rows, lower=[0, *np.negative(free)], upper=[np.pi, *free]))
    rng = np.random.default_rng(6)
    for q in rng.uniform([0.2] * 7, [2.9] * 7, (50, 7)):
        motion, s = arm.self_motion(arm.chain.forward(q)), arm.swivel(q)
        branch = next(b for b in motion.branches if b.signs == arm.branch(q))
        assert any((s - lo) % TURN <= hi - lo for lo, hi in branch.intervals())


def test_windings_hold_up_to_the_ends_of_intervals() -> None:
    # A joint that meets its limit up to rounding must not take the windings of the others with it.
    chain = rd.catalog.load("pa10").with_limits(
        lower=[-1, -1.5, 4, 0, 5, -1.5, 7], upper=[1, 1.5, 8, 2, 9, 1.5, 12]
    )
    arm, count = rd.SrsArm(chain), 0
    rng = np.random.default_rng(7)
    for q in rng.uniform(chain.lower, chain.upper, (300, 7)):
        for branch in arm.self_motion(chain.forward(q)).branches:
            for lo, hi in branch.intervals():
                rows = branch.q(np.linspace(lo, hi, 9))
                count += 1
                assert (rows > chain.lower - 1e-8).all() and (rows < chain.upper + 1e-8).all()
    assert count > 300


def test_batches_agree_with_single_calls(arm: rd.SrsArm) -> None:
    chain = arm.chain
    q = random_q(chain, 200, 3)
    poses = chain.forward(q)
    poses[7, :3, 3] = 9.0
    swivels = np.linspace(-3, 3, len(q))
    batch = arm.solve_batch(poses, swivels)
    assert batch.q.shape == (200, 8, 7) and batch.valid.shape == (200, 8) and batch.valid.dtype == bool
    assert np.isfinite(batch.q).all() and not batch.valid[7].any()
    for i in (0, 7, 50, 199):
        np.testing.assert_array_equal(batch.q[i][batch.valid[i]], arm.solve(poses[i], swivels[i]))
    out = (np.empty((200, 8, 7)), np.empty((200, 8), bool))
    again = arm.solve_batch(poses, swivels, out=out, threads=1)
    assert again.q is out[0] and (out[1] == batch.valid).all()
    np.testing.assert_array_equal(out[0], batch.q)
    u = np.column_stack([np.cos(swivels), np.sin(swivels)])
    np.testing.assert_allclose(arm.solve_batch(poses, u).q[:7], batch.q[:7], atol=1e-9)

    owners, bounds = arm.intervals_batch(poses)
    motion = arm.self_motion(poses[5])
    single = np.vstack([b.intervals() for b in motion.branches])
    np.testing.assert_array_equal(bounds[owners[:, 0] == 5], single)

    near = arm.nearest_batch(poses, q)
    assert near.valid.sum() == 199 and not near.valid[7]
    np.testing.assert_allclose(np.delete(near.q, 7, 0), np.delete(q, 7, 0), atol=1e-6)
    assert arm.nearest(poses, q).q.shape == (200, 7)

    criterion = rd.JointRange(chain)
    best = arm.best_batch(poses, criterion)
    assert (best.value[best.valid] <= np.delete(criterion.value(q), 7) + 1e-12).all()
    np.testing.assert_allclose(best.value[best.valid], criterion.value(best.q[best.valid]), rtol=1e-12)


def test_urdf_of_somebody_else_closes_within_twice_its_defect() -> None:
    pybullet_data = pytest.importorskip("pybullet_data")
    file = f"{pybullet_data.getDataPath()}/kuka_iiwa/model.urdf"
    chain = rd.Chain.from_urdf(file, missing_limits="unbounded")
    arm = rd.SrsArm(chain)
    metres, radians = arm.defect
    assert 0 <= metres < 1e-4 and 0 <= radians < 1e-4
    q = random_q(chain, 2_000, 4)
    poses = chain.forward(q)
    batch = arm.solve_batch(poses, arm.swivel(q), limits=False)
    error = chain.forward(batch.q.reshape(-1, 7)).reshape(-1, 8, 4, 4) - poses[:, None]
    assert np.linalg.norm(error[..., :3, 3], axis=-1).max() < 1e-12 + 2 * metres
    # |A - B|_F = 2 sqrt(2) sin(angle / 2)
    angle = np.linalg.norm(error[..., :3, :3], axis=(-2, -1)) / np.sqrt(2)
    assert angle.max() < 1e-12 + 2 * radians
    found = np.abs((batch.q - q[:, None] + np.pi) % TURN - np.pi).max(axis=2).min(axis=1)
    assert found.max() < 1e-3


def test_reference_and_base_frames() -> None:
    chain = rd.catalog.load("pa10")
    q = np.array([0.3, 0.5, -0.2, 1.1, 0.4, 0.7, -0.9])
    base = rd.SrsArm(chain)
    # Mounting the arm elsewhere takes its swivel frame along.
    mount = np.array([[0.0, 0, 1, 0.3], [0, 1, 0, -0.2], [-1, 0, 0, 1.1], [0, 0, 0, 1]])
    moved = rd.SrsArm(chain.with_base(mount))
    assert moved.swivel(q) == pytest.approx(base.swivel(q), abs=1e-12)
    assert moved.branch(q) == base.branch(q)
    a = rd.SrsArm(chain, chart="shortest_arc", reference=(1.0, 0.2, 0.0))
    b = rd.SrsArm(chain, chart="stereographic", reference=(-1.0, -0.2, 0.0))
    assert a.swivel(q) == pytest.approx(b.swivel(q), abs=1e-12)
    turn = base.chart_change(a, chain.forward(q))
    assert (base.swivel(q) + turn - a.swivel(q) + np.pi) % TURN - np.pi == pytest.approx(0, abs=1e-12)


def test_criteria() -> None:
    chain = rd.catalog.load("iiwa14")
    q = random_q(chain, 5, 5)
    h = 2.0 * rd.JointRange(chain) + rd.Posture(chain, np.zeros(7), weights=np.arange(7.0))
    assert h.sense == "minimize" and (-h).sense == "maximize"
    step = 1e-6
    for row in q:
        numeric = [(h.value(row + d) - h.value(row - d)) / (2 * step) for d in np.eye(7) * step]
        np.testing.assert_allclose(h.gradient(row), numeric, atol=1e-8)
        numeric = [(h.gradient(row + d) - h.gradient(row - d)) / (2 * step) for d in np.eye(7) * step]
        np.testing.assert_allclose(h.hessian(row), numeric, atol=1e-8)
    assert h.value(q).shape == (5,) and h.gradient(q).shape == (5, 7) and h.hessian(q).shape == (5, 7, 7)
    # Bettini, De Luca, Oriolo, eq. (6), written out.
    middle, width = (chain.lower + chain.upper) / 2, chain.upper - chain.lower
    expected = (((q - middle) / width) ** 2).sum(axis=1) / 14
    np.testing.assert_allclose(rd.JointRange(chain).value(q), expected, rtol=1e-14)
    copy = pickle.loads(pickle.dumps(h))
    assert copy.value(q[0]) == h.value(q[0])


def test_pickle_and_repr(arm: rd.SrsArm) -> None:
    copy = pickle.loads(pickle.dumps(arm))
    assert repr(copy) == repr(arm) and copy.chain == arm.chain
    motion = arm.self_motion(arm.chain.forward(np.full(7, 0.3)))
    for value in (motion, motion.branches[0], motion.best(rd.JointRange(arm.chain))):
        assert type(value).__module__ == "redundancy" and repr(value)


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda a, p: a.solve(p, np.nan), "swivel: entry 0 is NaN"),
        (lambda a, p: a.solve(p, (0.0, 0.0)), "swivel (cos s, sin s) has length 0"),
        (lambda a, p: a.solve(p[:3], 0.0), "pose has shape (3, 4), expected (4, 4)"),
        (lambda a, p: a.solve(2 * p, 0.0), "is not a rigid transform"),
        (lambda a, p: a.solve(np.stack([p, p]), 0.0), "expected one pose (4, 4), got a batch"),
        (lambda a, p: a.solve_batch(np.stack([p, p]), [0.0] * 3), "swivels has shape (3,)"),
        (lambda a, p: a.solve_batch(p[None], 0.0, threads=0), "threads is 0, it must be at least 1"),
        (
            lambda a, p: a.solve_batch(p[None], 0.0, out=(np.empty(3), np.empty(3))),
            "C-contiguous of shape [1, 8, 7]",
        ),
        (lambda a, p: a.solve_batch(np.stack([p, 2 * p]), 0.0), "pose 1"),
        (lambda a, p: a.swivel(np.zeros(6)), "q has shape (6,), expected (7,)"),
        (lambda a, p: a.self_motion(p).branches[0].intervals(-0.1), "margin is -0.1, it must be >= 0"),
        (lambda a, p: a.nearest(p, [np.inf] * 7), "entry 0 is inf"),
        (
            lambda a, p: a.self_motion(p).best(rd.JointRange(rd.catalog.load("puma560"))),
            "expected 7 entries, got 6",
        ),
        (lambda a, p: rd.SrsArm(a.chain, chart="polar"), "expected one of: shortest_arc, stereographic"),
        (lambda a, p: rd.SrsArm(a.chain, reference=(0, 0, 0)), "reference has length 0"),
        (lambda a, p: rd.JointRange(a.chain) + -rd.JointRange(a.chain), "multiply one of them by -1"),
        (
            lambda a, p: rd.Posture(a.chain, np.zeros(7), weights=-np.ones(7)),
            "weight 0 is -1, it must be >= 0",
        ),
    ],
)
def test_bad_input_is_named(call, text: str) -> None:
    arm = rd.SrsArm(rd.catalog.load("pa10"))
    with pytest.raises(rd.RedundancyError) as error:
        call(arm, arm.chain.forward(np.full(7, 0.3)))
    assert text in str(error.value)


def test_arms_that_are_not_srs() -> None:
    with pytest.raises(rd.NotSrsError, match=r"axes 6 and 7 miss each other by 88\.000 mm"):
        rd.SrsArm(rd.catalog.load("panda"))
    with pytest.raises(rd.NotSrsError, match="has 6 joints, 7 are needed"):
        rd.SrsArm(rd.catalog.load("puma560"))


def test_the_quantities_of_the_paper() -> None:
    arm = rd.SrsArm(rd.catalog.load("pa10"))
    motion = arm.self_motion(rd.pose((0.5, 0.1, 1.0), quaternion_wxyz=(0.5**0.5, 0, 0.5**0.5, 0)))
    assert np.allclose(motion.center, (0.1948, 0.04638, 0.6327), atol=5e-5)
    assert np.allclose(motion.axis, (0.5187, 0.1235, 0.846), atol=5e-5)
    assert abs(motion.radius - 0.2480) < 5e-5
    assert np.allclose(motion.q_a, (0.9607, -0.06428, 0.27, 0.0), atol=6e-5)
    assert np.allclose(motion.frame, np.eye(3), atol=1e-15)
    assert np.allclose(motion.elbow(0.0), (0.4066, 0.03777, 0.5041), atol=5e-5)
    s = np.linspace(-3.0, 3.0, 7)
    elbows = motion.elbow(s)
    assert elbows.shape == (7, 3)
    assert np.allclose(np.linalg.norm(elbows - motion.center, axis=1), motion.radius, atol=1e-14)
    turned = rd.quaternion.rotate(motion.q_a, [1.0, 0.0, 0.0])
    assert np.allclose(motion.center + motion.radius * turned, motion.elbow(0.0), atol=1e-14)
    for branch in motion.branches:
        q3, q4, wrist = branch.quaternions(s)
        up = rd.quaternion.rotate(q3, np.tile([0.0, 0.0, 1.0], (7, 1)))
        assert np.allclose(arm.shoulder + arm.lengths[0] * up, elbows, atol=1e-14)
        # conj(q_4) q, from the angles of joints 5 to 7 of the paper's arm.
        pose = rd.quaternion.from_matrix(arm.chain.forward(branch.q(0.3))[:3, :3])
        _, one, rest = branch.quaternions(0.3)
        assert rd.quaternion.angle(rd.quaternion.product(one, rest), pose) < 1e-12
        assert q4.shape == wrist.shape == (7, 4)
    with pytest.raises(rd.RedundancyError, match="s: entry 0 is NaN"):
        motion.elbow(np.nan)


def test_all_windings_of_a_branch() -> None:
    chain = rd.catalog.load("pa10")
    arm = rd.SrsArm(chain)
    motion = arm.self_motion(chain.forward([0.3, 0.5, -0.2, 1.1, 0.4, 0.7, -0.9]))
    for branch in motion.branches:
        for low, high in branch.intervals():
            s = 0.5 * (low + high)
            rows = branch.windings(s)
            assert (rows >= chain.lower).all() and (rows <= chain.upper).all()
            assert np.allclose(chain.forward(rows), chain.forward(branch.q(s)), atol=1e-9)
            turns = [np.arange(-3, 4) * 2 * np.pi + x for x in branch.q(s)]
            pairs = zip(turns, chain.lower, chain.upper, strict=True)
            assert len(rows) == np.prod([((t >= lo) & (t <= hi)).sum() for t, lo, hi in pairs])
    assert branch.windings(0.0).shape[1] == 7
