"""Solutions over a pose through the Python face: one interface for circles, points and traced curves."""

import pickle

import numpy as np
import pytest

import redundancy as rd

TURN = 2 * np.pi
POSTURES = {
    "iiwa14": [0.1, 0.5, 0.2, -1.2, 0.3, 0.8, 0.0],
    "puma560": [0.3, 0.5, -0.2, 1.1, 0.4, 0.7],
    "panda": [0.1, 0.4, -0.2, -1.9, 0.3, 1.7, 0.5],
}


@pytest.fixture(scope="module", params=list(POSTURES))
def case(request: pytest.FixtureRequest) -> tuple[rd.Chain, np.ndarray, rd.Solutions]:
    chain = rd.catalog.load(request.param)
    q = np.array(POSTURES[request.param])
    return chain, q, rd.solutions(chain, chain.forward(q))


def room(chain: rd.Chain, q: np.ndarray) -> np.ndarray:
    """Distance of the worst joint from its limits in its best winding, row by row."""
    wound = np.stack([q + TURN * k for k in range(-3, 4)])
    return np.minimum(wound - chain.lower, chain.upper - wound).max(axis=0).min(axis=-1)


def test_closed_forms_are_recognised_once_for_all() -> None:
    srs = rd.closed_form(rd.catalog.load("iiwa14"))
    assert isinstance(srs, rd.SrsArm)
    assert (srs.name, srs.parameter) == ("srs", "swivel")
    assert max(srs.defect) < 1e-9 and rd.closed_form(srs) is srs
    wrist = rd.closed_form(rd.catalog.load("puma560"))
    assert isinstance(wrist, rd.SphericalWristArm)
    assert (wrist.name, wrist.parameter) == ("spherical_wrist", None)
    assert rd.closed_form(rd.catalog.load("planar3r")) is None
    with pytest.raises(rd.RedundancyError, match="expected a Chain"):
        rd.closed_form("iiwa14")  # type: ignore[arg-type]


def test_pieces_close_and_have_tangents(case: tuple[rd.Chain, np.ndarray, rd.Solutions]) -> None:
    chain, q, s = case
    pose, rng = chain.forward(q), np.random.default_rng(0)
    assert str(s.status) == "converged" and s.pieces and s.chain is chain
    assert s.proven or "starts" in s.reason
    for piece in s.pieces:
        lo, hi = piece.range
        if s.dimension == 0:
            assert not piece.closed and (lo, hi) == (0.0, 0.0)
            np.testing.assert_allclose(chain.forward(piece.q()), pose, atol=1e-11)
            np.testing.assert_array_equal(piece.q(0.0), piece.q())
            with pytest.raises(rd.RedundancyError, match="no tangent"):
                piece.tangent(0.0)
            continue
        u = rng.uniform(lo, hi, 50)
        rows = piece.q(u)
        np.testing.assert_allclose(chain.forward(rows), np.broadcast_to(pose, (50, 4, 4)), atol=1e-11)
        np.testing.assert_array_equal(piece.q(u[0]), rows[0])
        tangents = piece.tangent(u)
        assert np.isfinite(tangents).all() and (np.linalg.norm(tangents, axis=1) > 0.1).all()
        # In the kernel of the Jacobian, where the joints do not rush.
        for row, tangent in zip(rows, tangents, strict=True):
            assert np.abs(chain.jacobian(row) @ tangent).max() < 1e-8 * max(1.0, np.abs(tangent).max())
        h = 1e-6
        step = (piece.q(u + h) - piece.q(u - h) + np.pi) % TURN - np.pi
        calm = np.linalg.norm(tangents, axis=1) < 20
        np.testing.assert_allclose(step[calm] / (2 * h), tangents[calm], atol=1e-4, rtol=1e-4)
        with pytest.raises(rd.RedundancyError, match="u is missing"):
            piece.q()
    parameter = getattr(rd.closed_form(chain), "parameter", None)
    if parameter == "swivel":
        np.testing.assert_allclose(s.pieces[0].parameter([0.3, -0.2]), [0.3, -0.2])
    elif parameter is None:
        assert s.pieces[0].parameter(0.0) is None


def test_intervals_agree_with_a_scan(case: tuple[rd.Chain, np.ndarray, rd.Solutions]) -> None:
    chain, _, s = case
    for margin in (0.0, 0.3):
        for piece in s.pieces:
            arcs = piece.intervals(margin)
            assert arcs.shape[1:] == (2,)
            if s.dimension == 0:
                assert len(arcs) == int(room(chain, piece.q()) >= margin)
                continue
            u = np.linspace(-np.pi, np.pi, 1500, endpoint=False)
            inside = np.zeros(len(u), bool)
            near = np.zeros(len(u), bool)
            for lo, hi in arcs:
                inside |= (u - lo) % TURN <= hi - lo
                near |= (np.abs((u - lo + np.pi) % TURN - np.pi) < 1e-6) | (
                    np.abs((u - hi + np.pi) % TURN - np.pi) < 1e-6
                )
            scan = room(chain, piece.q(u)) >= margin
            np.testing.assert_array_equal(inside[~near], scan[~near])


def test_nearest_and_best_beat_a_scan(case: tuple[rd.Chain, np.ndarray, rd.Solutions]) -> None:
    chain, q, s = case
    rng = np.random.default_rng(1)
    wish = q + rng.uniform(-0.4, 0.4, chain.dof)
    criteria = [rd.JointRange(chain), rd.Posture(chain, wish), rd.Manipulability(chain)]
    rows = []
    for piece in s.pieces:
        for lo, hi in piece.intervals():
            rows.append(piece.q(np.linspace(lo, hi, 400 if hi > lo else 1)))
    scanned = np.concatenate(rows)
    for criterion in criteria:
        best = s.best(criterion)
        assert str(best.status) == "converged"
        sign = 1 if criterion.sense == "minimize" else -1
        assert sign * best.value <= (sign * criterion.value(scanned)).min() + 1e-9
        assert criterion.value(best.q) == best.value
        assert ((chain.lower <= best.q) & (best.q <= chain.upper)).all()
        np.testing.assert_allclose(chain.forward(best.q), chain.forward(q), atol=1e-9)
        assert best.proven or best.reason
    near = s.nearest(wish)
    assert near.value <= np.linalg.norm(scanned - wish, axis=1).min() + 1e-12
    assert near.value == pytest.approx(np.linalg.norm(near.q - wish))
    assert near.piece.index in range(len(s.pieces)) and (s.proven or not near.proven)
    assert s.nearest(q).value < 1e-7


def test_status_and_reason_where_there_is_none(case: tuple[rd.Chain, np.ndarray, rd.Solutions]) -> None:
    chain, q, _ = case
    far = np.eye(4)
    far[0, 3] = 7.0
    none = rd.solutions(chain, far)
    assert str(none.status) == "unreachable" and none.proven and "mm" in none.reason and not none.pieces
    best = none.best(rd.JointRange(chain))
    assert best.q is best.u is best.value is best.piece is None and best.reason == none.reason
    tight = chain.with_limits(lower=q + 0.3, upper=q + 0.31)
    none = rd.solutions(tight, chain.forward(q), starts=30)
    if none.proven:
        assert str(none.status) == "limits" and "outside" in none.reason
    else:
        assert str(none.status) in {"limits", "unreachable"} and "30 starts" in none.reason
    assert none.nearest(q).q is None


def test_solver_results_say_whether_they_are_proven() -> None:
    far = np.eye(4)
    far[0, 3] = 1.2
    for name, proven in [("iiwa14", True), ("planar4r", False)]:
        chain = rd.catalog.load(name)
        task = None if proven else "planar_pose"
        if not proven:
            far[0, 3] = 40.0
        solver = rd.IkSolver(chain, task=task)
        result = solver.solve(far)
        assert str(result.status) == "unreachable" and result.proven is proven
        assert result.starts > 0
        assert ("starts" in result.reason) is not proven
        batch = solver.solve_batch(far[None])
        np.testing.assert_array_equal(batch.proven, [proven])
    arm = rd.SrsArm(rd.catalog.load("iiwa14"))
    q = np.array(POSTURES["iiwa14"])
    motion = arm.self_motion(arm.chain.forward(q))
    assert motion.proven and motion.best(rd.JointRange(arm.chain)).proven and motion.nearest(q).proven
    dexterity = motion.best(rd.Manipulability(arm.chain))
    assert not dexterity.proven and "scan" in dexterity.reason
    assert arm.nearest_batch(arm.chain.forward(q)[None], q).proven.all()
    wrist = rd.SphericalWristArm(rd.catalog.load("puma560"))
    assert wrist.configurations(wrist.chain.forward(POSTURES["puma560"])).proven
    assert not wrist.configurations(wrist.chain.forward([0.3, 0.5, -0.2, 1.1, 0.0, 0.7])).proven


def test_arms_tasks_and_settings() -> None:
    chain = rd.catalog.load("iiwa14")
    pose = chain.forward(POSTURES["iiwa14"])
    # The chart of an arm object holds for u.
    arm = rd.SrsArm(chain, chart="stereographic", reference=(-1.0, 0.0, 0.2))
    s = rd.solutions(arm, pose)
    u = arm.swivel(POSTURES["iiwa14"])
    assert any(np.allclose(piece.q(u), POSTURES["iiwa14"], atol=1e-9) for piece in s.pieces)
    # Traced, the same circles are found.
    traced = rd.solutions(chain, pose, closed_form=False, starts=60, seed=3)
    assert not traced.proven and traced.dimension == 1
    assert traced.best(rd.JointRange(chain)).value == pytest.approx(
        s.best(rd.JointRange(chain)).value, rel=1e-9
    )
    again = rd.solutions(chain, pose, closed_form=False, starts=60, seed=3)
    np.testing.assert_array_equal(traced.pieces[0].q(0.4), again.pieces[0].q(0.4))
    planar = rd.catalog.load("planar3r")
    q = [0.3, 0.4, -0.9]
    assert rd.solutions(planar, planar.forward(q), task="planar").nearest(q).value < 1e-7
    assert rd.solutions(planar, planar.forward(q), task="planar_pose").dimension == 0
    with pytest.raises(rd.RedundancyError, match="freedom"):
        rd.solutions(chain, pose, freedom=1.0)  # type: ignore[arg-type]
    with pytest.raises(rd.RedundancyError, match="4 dimensions"):
        rd.solutions(chain, pose, task="position")
    with pytest.raises(rd.RedundancyError, match="starts is 0"):
        rd.solutions(chain, pose, starts=0)
    with pytest.raises(rd.RedundancyError, match="seed is -1"):
        rd.solutions(chain, pose, seed=-1)


def test_everything_pickles_and_shows_itself(case: tuple[rd.Chain, np.ndarray, rd.Solutions]) -> None:
    chain, q, s = case
    copy = pickle.loads(pickle.dumps(s))
    assert repr(copy) == repr(s) and repr(s).startswith("Solutions(converged, ")
    piece = pickle.loads(pickle.dumps(s.pieces[-1]))
    np.testing.assert_array_equal(piece.q(0.2), s.pieces[-1].q(0.2))
    assert repr(piece).startswith("Piece(")
    best = s.best(rd.JointRange(chain))
    again = pickle.loads(pickle.dumps(best))
    np.testing.assert_array_equal(again.q, best.q)
    assert (again.u, again.value, again.proven) == (best.u, best.value, best.proven)
    assert repr(best).startswith("Solution(value ")
    assert s.nearest(q).piece.label in repr(s.nearest(q))
