"""Single steps against their formulas in numpy: a wrong sign, factor or bound shows here."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.linalg import null_space
from scipy.optimize import minimize_scalar

import redundancy as rd

DT = 0.01


def best_share(arm, h, q, least, freedom, dt):
    """Interval and best factor of the freedom after one step, found by search."""
    a, b = q + dt * least, dt * freedom
    reach = dt * arm.velocity_limit
    bottom, top = np.maximum(arm.lower, q - reach), np.minimum(arm.upper, q + reach)
    # The elbow of an S-R-S arm is moved by the task alone.
    moves = np.abs(b) > 1e-9
    ends = np.sort(np.array([(bottom - a)[moves] / b[moves], (top - a)[moves] / b[moves]]), axis=0)
    low, high = ends[0].max(), ends[1].min()
    if low > high or np.any((a < bottom) & ~moves) or np.any((a > top) & ~moves):
        return None
    sign = 1.0 if h.sense == "minimize" else -1.0
    found = minimize_scalar(
        lambda x: sign * h.value(a + x * b), bounds=(low, high), method="bounded", options={"xatol": 1e-12}
    )
    free = minimize_scalar(lambda x: sign * h.value(a + x * b)).x
    return low, high, found.x, free


@pytest.mark.parametrize("scheme", [rd.ProjectedGradient, rd.ReducedGradient])
def test_the_optimal_step_is_the_best_within_its_interval(scheme):
    arm = rd.catalog.load("iiwa14")
    rng = np.random.default_rng(3)
    seen = {"free": 0, "high": 0, "low": 0, "none": 0}
    for k in range(800):
        q = rng.uniform(0.8 * arm.lower, 0.8 * arm.upper)
        jacobian = arm.jacobian(q)
        if np.linalg.svd(jacobian, compute_uv=False)[-1] < 0.1:
            continue
        # Near its optimum the freedom is needed for the limits alone: there the lower end counts.
        h = rd.Posture(arm, q + 0.02 * rng.normal(size=7)) if k % 2 else rd.JointRange(arm)
        dt = rng.choice([0.01, 0.3, 1.0])
        v = jacobian @ (rng.normal(size=7) * arm.velocity_limit * rng.choice([0.02, 0.4, 0.8]))
        options = {"damping": None}
        if scheme is rd.ReducedGradient:
            options["basis"] = (0, 1, 2, 3, 4, 5)
        least = scheme(arm, h, 0.0, **options).step(q, v).qd
        freedom = scheme(arm, h, 1.0, **options).step(q, np.zeros(6)).qd
        if np.abs(np.delete(freedom, 3)).min() < 1e-4:
            continue
        if k % 3 == 0:
            # One joint is too fast for the task alone: the freedom has to help.
            limits = 0.5 + 2.0 * np.abs(least)
            limits[5] = 0.9 * np.abs(least[5])
            slow = arm.with_limits(velocity=limits)
        else:
            slow = arm
        step = scheme(slow, h, "optimal", **options).step(q, v, dt)
        found = best_share(slow, h, q, least, freedom, dt)
        if found is None:
            seen["none"] += 1
            assert step.status == "limits"
            np.testing.assert_allclose(step.qd, least, atol=1e-9)
            continue
        low, high, best, free = found
        seen["high" if free > high else "low" if free < low else "free"] += 1
        size = np.abs(freedom).max()
        share = (step.qd - least) @ freedom / (freedom @ freedom)
        assert abs(share - np.clip(free, low, high)) * size < 1e-5 * max(1.0, abs(free) * size)
        assert abs(share - best) * size < 1e-3 * max(1.0, abs(best) * size)
        np.testing.assert_allclose(
            step.qd, least + share * freedom, atol=1e-8 * max(1.0, np.abs(step.qd).max())
        )
        assert np.all(np.abs(step.qd) <= slow.velocity_limit * (1 + 1e-9))
    assert min(seen.values()) >= 3, seen


def test_a_change_of_basis_is_blended_over_three_steps():
    arm = rd.catalog.load("dexter")
    h = rd.JointRange(arm)
    q = np.radians([40.0, 0.0, 90.0, 180.0, -90.0, 180.0, -90.0, 0.0])
    v = np.array([0.1, 0.0, -0.05, 0.0, 0.2, 0.0])
    first, second = (0, 2, 3, 4, 5, 7), (0, 2, 3, 5, 6, 7)
    options = {"task": "pose_rpy", "damping": None}
    old, new = (rd.ReducedGradient(arm, h, 5.0, basis=b, **options).step(q, v).qd for b in (first, second))
    assert np.abs(old - new).max() > 1e-2
    scheme = rd.ReducedGradient(arm, h, 5.0, basis=first, schedule=[(2 * DT, second)], **options)
    steps = [scheme.step(q, v, DT) for _ in range(8)]
    assert [k for k, step in enumerate(steps) if step.basis_changed] == [2]
    for step, share in zip(steps, [1.0, 1.0, 0.75, 0.5, 0.25, 0.0, 0.0, 0.0], strict=True):
        np.testing.assert_allclose(step.qd, share * old + (1.0 - share) * new, atol=1e-9)


def test_the_reduced_gradient_is_that_of_its_formula():
    arm = rd.catalog.load("iiwa14")
    h = rd.JointRange(arm)
    basis, free = [0, 1, 3, 4, 5, 6], [2]
    q = np.array([0.3, 0.6, -0.2, 1.2, 0.1, -0.5, 0.4])
    v = np.array([0.1, 0.0, -0.05, 0.0, 0.2, 0.0])
    jacobian, eta = arm.jacobian(q), -5.0 * h.gradient(q)
    reduced = np.linalg.solve(jacobian[:, basis], jacobian[:, free])
    wanted = np.empty(7)
    wanted[free] = eta[free] - reduced.T @ eta[basis]
    wanted[basis] = np.linalg.solve(jacobian[:, basis], v - jacobian[:, free] @ wanted[free])
    step = rd.ReducedGradient(arm, h, 5.0, basis=basis, damping=None).step(q, v)
    np.testing.assert_allclose(step.qd, wanted, atol=1e-9)


def test_a_double_sweep_goes_there_and_back():
    arm = rd.catalog.load("iiwa14")
    rng = np.random.default_rng(5)

    def sweep(order, pose, q):
        return rd.IkSolver(arm, "coordinate_descent", order=order, max_iterations=1).trace(pose, q).q

    for _ in range(5):
        goal, q = rng.uniform(0.8 * arm.lower, 0.8 * arm.upper, size=(2, 7))
        pose = arm.forward(goal)
        there = sweep("tip_to_base", pose, q)
        back = sweep("base_to_tip", pose, there)
        assert np.abs(back - there).max() > 1e-3
        np.testing.assert_allclose(sweep("double", pose, q), back, atol=1e-9)


def srs_pose():
    arm = rd.SrsArm(rd.catalog.load("iiwa14"))
    return arm, arm.chain.forward([0.0, 0.6, 0.0, 1.2, 0.0, 0.8, 0.0])


def test_the_robust_flow_takes_the_sine_of_the_error():
    arm, pose = srs_pose()
    for error in (3.0, 0.2, -2.9, 2 * np.pi - 0.5):
        flow = rd.SwivelFlow(arm, 0.1 + error, weights=(1, 0, 0, 0), tau=0.5, max_rate=100.0)
        assert flow.step(pose, 0.1, DT) == pytest.approx(0.1 + DT * np.sin(error) / 0.5, abs=1e-9)


def test_the_paper_flow_on_u_takes_the_shorter_way():
    arm, pose = srs_pose()
    for s, desired in ((3.0, -3.0), (-3.0, 3.0), (1.0, 1.5)):
        flow = rd.SwivelFlow(arm, desired, form="paper_u", tau=0.2, lambda_=0.5)
        error = np.angle(np.exp(1j * (desired - s)))
        moved = flow.step(pose, s, DT) - s
        assert np.angle(np.exp(1j * moved)) == pytest.approx(DT * 0.5 * np.tanh(error) / 0.2, abs=1e-9)


def test_the_barrier_sees_the_motion_of_obstacles():
    arm, pose = srs_pose()
    s = 0.4
    elbow = arm.chain.forward(arm.solve(pose, s)[0], "link_4")[:3, 3]
    side = np.cross([0.0, 0.0, 1.0], elbow)
    side /= np.linalg.norm(side)

    def moved(velocity):
        ball = rd.Sphere(elbow + 0.25 * side, 0.08, velocity=velocity * side)
        flow = rd.SwivelFlow(arm, s, rd.Scene([ball]), weights=(1, 0, 0, 0), max_rate=3.0)
        return flow.step(pose, s, DT) - s

    assert moved(0.0) == 0.0
    assert moved(1.0) == 0.0
    # It comes at 2 m/s: the arm has to give way, and does so away from it.
    away = moved(-2.0)
    assert abs(away) > 1e-3
    there = arm.chain.forward(arm.solve(pose, s + away)[0], "link_4")[:3, 3]
    assert (there - elbow) @ side < 0.0


def test_the_gain_of_the_extended_jacobian_draws_to_the_stationary_point():
    arm = rd.catalog.load("iiwa14")
    h = rd.JointRange(arm)
    gain, dt = 4.0, 1e-5
    scheme = rd.ExtendedJacobian(arm, h, gain=gain, damping=None)
    rng = np.random.default_rng(7)
    seen = 0
    for _ in range(20):
        q = rng.uniform(0.6 * arm.lower, 0.6 * arm.upper)
        basis = null_space(arm.jacobian(q))
        if basis.shape[1] != 1:
            continue
        for v in (np.zeros(6), 0.05 * rng.normal(size=6)):
            qd = scheme.step(q, v).qd
            if np.abs(qd).max() > 20.0:
                continue

            def condition(q, basis=basis[:, 0]):
                n = null_space(arm.jacobian(q))[:, 0]
                return np.sign(n @ basis) * (n @ h.gradient(q))

            slope = (condition(q + dt * qd) - condition(q - dt * qd)) / (2 * dt)
            assert slope == pytest.approx(-gain * condition(q), abs=1e-4 * (1.0 + abs(condition(q))))
            seen += 1
    assert seen >= 20


def test_the_optimal_step_where_there_is_no_best_one_ends_at_its_bound():
    arm = rd.catalog.load("iiwa14")
    h = rd.Manipulability(arm, measure="sqrt")
    rng = np.random.default_rng(11)
    dt, seen = 0.1, 0
    for _ in range(60):
        q = rng.uniform(0.6 * arm.lower, 0.6 * arm.upper)
        jacobian = arm.jacobian(q)
        if np.linalg.svd(jacobian, compute_uv=False)[-1] < 0.05:
            continue
        v = jacobian @ (0.1 * rng.normal(size=7))
        least = rd.ProjectedGradient(arm, h, 0.0, damping=None).step(q, v).qd
        freedom = rd.ProjectedGradient(arm, h, 1.0, damping=None).step(q, np.zeros(6)).qd
        found = best_share(arm, h, q, least, freedom, dt)
        if found is None:
            continue
        a, size = q + dt * least, np.abs(freedom).max()
        ends = [h.value(a + e * freedom / size) for e in (-1e-3, 0.0, 1e-3)]
        slope, bend = ends[2] - ends[0], ends[2] - 2 * ends[1] + ends[0]
        # It is maximised: with a positive second derivative the local model has no maximum.
        if slope > 1e-6 and bend > 1e-8:
            step = rd.ProjectedGradient(arm, h, "optimal", damping=None).step(q, v, dt).qd
            share = (step - least) @ freedom / (freedom @ freedom)
            # The step moves q by dt times the joint velocity.
            assert share * size == pytest.approx(found[1] * size, rel=1e-6)
            seen += 1
    assert seen >= 5


def test_damping_near_a_singularity_is_that_of_its_formula():
    arm = rd.catalog.load("iiwa14")
    rng = np.random.default_rng(12)
    damping = rd.Damping(0.1, 0.3, 0.25)
    for _ in range(20):
        q = rng.uniform(0.6 * arm.lower, 0.6 * arm.upper)
        q[3] = 0.2 * rng.normal()
        u, sigma, vt = np.linalg.svd(arm.jacobian(q), full_matrices=False)
        x = 2 * np.pi * (sigma - 0.25 * 0.3) / (0.75 * 0.3)
        share = np.where(sigma >= 0.3, 0.0, np.where(x <= 0.0, 1.0, 1.0 - (x - np.sin(x)) / (2 * np.pi)))
        v = rng.normal(size=6)
        wanted = vt.T @ (sigma / (sigma**2 + 0.1**2 * share) * (u.T @ v))
        step = rd.ProjectedGradient(arm, None, 0.0, damping=damping).step(q, v)
        np.testing.assert_allclose(step.qd, wanted, atol=1e-9 * np.abs(wanted).max())


def test_a_rail_goes_to_the_mean_of_target_and_attractions():
    arm = rd.catalog.load("iiwa14").with_rail((1, 0, 0), -5.0, 5.0)
    rng = np.random.default_rng(13)
    for _ in range(10):
        inside = 0.6 * np.where(np.isfinite(arm.lower), arm.lower, -1.0)
        q, goal = rng.uniform(inside, -inside, size=(2, 8))
        place, weight = rng.normal(size=3), 5.0
        options = {"order": "base_to_tip", "max_iterations": 1, "position_weight": 10.0}
        solver = rd.IkSolver(arm, "coordinate_descent", attractions=[("link_4", place, weight)], **options)
        moved = solver.trace(arm.forward(goal), q).q[0] - q[0]
        away = arm.forward(goal)[0, 3] - arm.forward(q)[0, 3]
        drawn = place[0] - arm.forward(q, "link_4")[0, 3]
        assert moved == pytest.approx((10.0 * away + weight * drawn) / (10.0 + weight), abs=1e-9)


def differences(function, q, step=1e-5):
    return np.stack(
        [(function(q + step * e) - function(q - step * e)) / (2 * step) for e in np.eye(len(q))], axis=-1
    )


def test_the_second_derivatives_of_criteria_are_those_of_their_gradients():
    rng = np.random.default_rng(14)
    for name in ("iiwa14", "dexter", "planar4r"):
        arm = rd.catalog.load(name)
        criteria = [
            rd.Elbow(arm, rng.normal(size=3)),
            rd.Manipulability(arm, task="planar" if name == "planar4r" else "pose"),
            rd.JointRange(arm) + 2.0 * rd.Posture(arm, 0.1 * rng.normal(size=arm.dof)),
        ]
        for h in criteria:
            q = rng.uniform(-1.0, 1.0, size=arm.dof)
            np.testing.assert_allclose(differences(h.value, q), h.gradient(q), atol=1e-6)
            np.testing.assert_allclose(differences(h.gradient, q), h.hessian(q), atol=1e-6)


def test_at_the_largest_speed_some_limit_is_reached():
    arm = rd.catalog.load("puma560")
    rng = np.random.default_rng(15)
    directions = set()
    for _ in range(30):
        u = np.linspace(0.0, 1.0, 60)
        bend = rng.uniform(-1.0, 1.0, size=(2, arm.dof))
        q = np.array([0.0, -0.5, 1.0, 0.2, 0.4, 0.0]) + np.sin(6 * u[:, None] * bend[0]) * bend[1]
        s = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(arm.forward(q)[:, :3, 3], axis=0), axis=1))]
        path = rd.Path(arm.forward(q), s=s)
        # Half of what gravity leaves: it matters in which direction it acts.
        held = np.abs(arm.inverse_dynamics(q, 0 * q, 0 * q)).max(axis=0)
        limits = 1.3 * held + 2.0
        best = rd.max_speed(arm, path, q=q, torque_limits=limits, velocity_limits=None)
        used = best.torques / limits
        assert np.abs(used).max() == pytest.approx(1.0, abs=1e-9)
        assert abs(used[best.at, best.limiting_joint]) == pytest.approx(1.0, abs=1e-9)
        directions.add(np.sign(used[best.at, best.limiting_joint]))
        rates = CubicSpline(s, q).derivative()(s)
        speeds = rng.uniform(0.3, 3.0, size=arm.dof)
        best = rd.max_speed(arm, path, q=q, torque_limits=None, velocity_limits=speeds)
        used = np.abs(best.speed * rates / speeds)
        assert used.max() == pytest.approx(1.0, abs=1e-9)
        assert used[best.at, best.limiting_joint] == pytest.approx(1.0, abs=1e-9)
        np.testing.assert_allclose(
            (best.point_speeds[:, None] * np.abs(rates) / speeds).max(axis=1), 1.0, atol=1e-9
        )
    assert directions == {-1.0, 1.0}


def test_the_barrier_stops_at_the_safe_distance():
    arm, pose = srs_pose()
    start = 0.4
    elbow = arm.chain.forward(arm.solve(pose, start)[0], "link_4")[:3, 3]
    side = np.cross([0.0, 0.0, 1.0], elbow)
    side /= np.linalg.norm(side)
    scene = rd.Scene([rd.Sphere(elbow + 0.25 * side, 0.08)])

    def distance(s):
        return scene.clearance(arm.chain, arm.solve(pose, s)[0], link_radius=0.05).distance

    towards = 1.0 if distance(start + 0.1) < distance(start - 0.1) else -1.0
    flow = rd.SwivelFlow(
        arm, start + 1.2 * towards, scene, weights=(1, 0, 0, 0), safe_distance=0.03, link_radius=0.05
    )
    s, before = start, distance(start)
    for _ in range(800):
        s = flow.step(pose, s, DT)
        # By the distance that is left above the safe one, 5 times a second; to second order in the step.
        assert distance(s) - before >= -5.0 * (before - 0.03) * DT - 1e-4
        before = distance(s)
    assert distance(s) == pytest.approx(0.03, abs=1e-3)


def test_at_its_limits_the_saturated_scheme_stays_nearest_to_the_wish():
    arm = rd.catalog.load("iiwa14")
    rng = np.random.default_rng(16)
    held = 0
    for _ in range(60):
        q = rng.uniform(0.7 * arm.lower, 0.7 * arm.upper)
        jacobian = arm.jacobian(q)
        if np.linalg.svd(jacobian, compute_uv=False)[-1] < 0.1:
            continue
        n = null_space(jacobian)[:, 0]
        v = jacobian @ (0.1 * rng.normal(size=7))
        h, gain = rd.Posture(arm, rng.uniform(-1, 1, size=7)), rng.choice([0.5, 20.0])
        least = np.linalg.pinv(jacobian) @ v
        bound = arm.velocity_limit
        ends = np.sort([(-bound - least) / n, (bound - least) / n], axis=0)
        moves = np.abs(n) > 1e-9
        low, high = ends[0][moves].max(), ends[1][moves].min()
        wish = -gain * (n @ h.gradient(q))
        step = rd.SaturatedNullspace(arm, h, gain).step(q, v, 1e-6)
        assert step.scale == 1.0
        assert n @ (step.qd - least) == pytest.approx(np.clip(wish, low, high), abs=1e-8)
        held += not low < wish < high
    assert held >= 10


def test_small_angles_keep_their_digits():
    arm = rd.catalog.load("iiwa14")
    solver, q = rd.IkSolver(arm, "newton", max_iterations=1), np.full(7, 0.3)
    for angle in (1e-6, 1e-4, 3e-4, 4.9e-4, 5.1e-4, 1e-3, 0.1, 3.1):
        turn = np.eye(4)
        turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        measured = solver.trace(arm.forward(q) @ turn, q).orientation_error[0]
        assert measured == pytest.approx(angle, rel=1e-9, abs=1e-14)


def test_without_a_wish_the_middle_of_the_longest_arc_is_taken():
    arm = rd.catalog.load("iiwa14")
    # A narrow range of joint 3 leaves short arcs that a few swivels miss.
    lower, upper = arm.lower.copy(), arm.upper.copy()
    lower[2], upper[2] = 0.3, 0.42
    narrow = rd.SrsArm(arm.with_limits(lower=lower, upper=upper))
    solver, rng = rd.IkSolver(narrow.chain), np.random.default_rng(17)
    middles = 0
    for _ in range(200):
        found = solver.solve(narrow.chain.forward(rng.uniform(lower, upper)))
        assert found.status == "converged"
        motion = narrow.self_motion(narrow.chain.forward(found.q))
        arcs = [(hi - lo, 0.5 * (lo + hi)) for b in motion.branches for lo, hi in b.intervals()]
        swivel = narrow.swivel(found.q)
        hit = [length for length, middle in arcs if abs(np.angle(np.exp(1j * (swivel - middle)))) < 1e-6]
        if hit:
            middles += 1
            assert max(hit) >= max(length for length, _ in arcs) - 1e-6
    assert middles >= 10


def test_the_cost_of_a_plan_is_that_of_its_formula():
    arm = rd.SrsArm(rd.catalog.load("iiwa14"))
    tool = np.diag([-1.0, 1.0, -1.0])
    poses = rd.paths.circle((0.5, -0.1, 0.4), 0.1, turns=0.6, orientation=tool, n=40).poses
    t = np.cumsum(np.r_[0.0, np.random.default_rng(18).uniform(0.2, 2.0, size=39)])
    plan = rd.plan_swivel(arm, rd.Path(poses, t=t), limit_weight=2.0, motion_weight=0.3)
    assert plan.status == "converged"
    parts = np.diff(t) / (t[-1] - t[0])
    shares = 0.5 * (np.r_[parts, 0.0] + np.r_[0.0, parts])
    lower, upper = arm.chain.lower, arm.chain.upper
    x = (plan.q - 0.5 * (lower + upper)) / (0.5 * (upper - lower))
    limits = 2.0 * ((x**2 / (1 - x**2)) ** 2).sum(axis=1)
    motion = 0.3 * (np.diff(plan.q, axis=0) ** 2).sum(axis=1) / parts
    assert plan.cost == pytest.approx(shares @ limits + motion.sum(), rel=1e-9)
