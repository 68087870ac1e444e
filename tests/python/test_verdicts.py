"""Verdicts that are true: statuses, reasons and bounds of what the library returns."""

import pickle

import numpy as np
import pytest

import redundancy as rd

DOWN = np.diag([-1.0, 1.0, -1.0])


def park_lap(q0, gain=10.0, dt=1e-3):
    arm = rd.catalog.load("planar3r")
    circle = rd.paths.circle((3.5, 0, 0), 1.5, start=np.pi, n=401)
    path = rd.Path(circle.poses, t=np.linspace(0.0, 1.0, 401))
    h = rd.Manipulability(arm, task="planar")
    extended = rd.ExtendedJacobian(arm, h, task="planar")
    projected = rd.ProjectedGradient(arm, h, 0.01, task="planar")
    return arm, [rd.track(arm, scheme, path, q0, dt, 50.0) for scheme in (extended, projected)]


def test_extended_jacobian_is_bounded_on_the_laps_of_the_paper():
    arm = rd.catalog.load("planar3r")
    h = rd.Manipulability(arm, task="planar")
    points = rd.constrained_optima(arm, np.array([2.0, 0.0]), h, task="planar")
    # Minima of the manipulability lead to singularities of J: there the bound is that of `slow_down` alone.
    points = [point for point in points if point.kind == rd.Kind.MAXIMUM]
    assert len(points) >= 3
    bounded = 0
    for point in points:
        arm, (extended, projected) = park_lap(point.q)
        fastest = np.abs(projected.qd).max()
        assert np.abs(extended.qd).max() <= 2.0 * fastest, (point, np.abs(extended.qd).max(), fastest)
        t = extended.t
        wanted = np.c_[3.5 - 1.5 * np.cos(2 * np.pi * t), -1.5 * np.sin(2 * np.pi * t)]
        error = np.linalg.norm(arm.forward(extended.q)[:, :2, 3] - wanted, axis=1)
        assert error.max() <= 15e-3, (point, error.max())
        bounded += any(str(e.kind) == "speed_bounded" for e in extended.events)
    assert bounded > 0


def test_criteria_of_another_arm_are_refused():
    iiwa, pa10 = rd.catalog.load("iiwa14"), rd.catalog.load("pa10")
    q = np.full(7, 0.3)
    for h in (rd.JointRange(pa10), rd.Posture(pa10, q), rd.Manipulability(pa10), 2.0 * rd.JointRange(pa10)):
        for call in (
            lambda h=h: rd.ProjectedGradient(iiwa, h, 0.1),
            lambda h=h: rd.ExtendedJacobian(iiwa, h),
            lambda h=h: rd.IkSolver(iiwa, criterion=h),
            lambda h=h: rd.classify(iiwa, q, h),
            lambda h=h: rd.SrsArm(iiwa).self_motion(iiwa.forward(q)).best(h),
        ):
            with pytest.raises(rd.RedundancyError, match="made for 'pa10'"):
                call()
    # Limits, base and tool may differ.
    rd.ProjectedGradient(iiwa.with_limits(velocity=np.ones(7)), rd.JointRange(iiwa), 0.1)


def test_a_start_whose_rail_leaves_its_limits_does_not_complete():
    arm = rd.catalog.load("planar3r").with_rail((1, 0, 0), -0.05, 0.05)
    path = rd.paths.circle((3.5, 0, 0), 1.5, start=np.pi, n=41)
    ranked = rd.rank_starts(arm, path, rd.Manipulability(arm, task="planar"), task="planar", starts=8)
    for start in ranked:
        q = start.trajectory.q
        inside = bool(np.all((q >= arm.lower - 1e-9) & (q <= arm.upper + 1e-9)))
        assert not start.completed or inside
        assert start.completed == (start.status == "converged") == (start.reason == "")
    assert len(ranked) == 0 or ranked.status == "converged" or ranked.reason
    assert type(pickle.loads(pickle.dumps(ranked))) is type(ranked)


def test_rank_starts_says_why_there_is_none():
    arm = rd.catalog.load("planar3r")
    path = rd.paths.circle((30, 0, 0), 1.5, n=11)
    ranked = rd.rank_starts(arm, path, rd.Manipulability(arm, task="planar"), task="planar", starts=4)
    assert ranked == [] and ranked.status == "unreachable" and "reach" in ranked.reason


def test_branches_as_signs_or_text():
    arm = rd.SrsArm(rd.catalog.load("iiwa14"))
    path = rd.paths.circle((0.5, -0.3, 0.4), 0.1, orientation=DOWN, n=12)
    text, signs = rd.plan_swivel(arm, path, branch="+++"), rd.plan_swivel(arm, path, branch=(1, 1, 1))
    assert np.array_equal(text.q, signs.q)
    for bad in ("++", "+++-", "+x+", 5, (1, 2, 1)):
        with pytest.raises(rd.RedundancyError, match="branch is"):
            rd.plan_swivel(arm, path, branch=bad)


def test_a_large_margin_blames_the_margin():
    arm = rd.SrsArm(rd.catalog.load("iiwa14"))
    path = rd.paths.circle((0.5, -0.3, 0.4), 0.1, orientation=DOWN, n=12)
    plan = rd.plan_swivel(arm, path, margin=5)
    assert plan.status == "limits" and "margin of 5 rad" in plan.reason and "given" not in plan.reason
