"""The explorer without a browser: what it shows, what it refuses, and that nothing sent to its socket ends it."""

import json
import threading

import numpy as np
import pytest
from arms import example_robots

import redundancy as rd
from redundancy.explorer import pictures
from redundancy.explorer.arm import Body
from redundancy.explorer.mailbox import Mailbox
from redundancy.explorer.map_model import MapModel
from redundancy.explorer.model import PoseModel, RefusedError, inside
from redundancy.explorer.path_model import PathModel, merged
from redundancy.explorer.scene_model import SceneModel
from redundancy.explorer.servo_model import ServoModel, limit_words
from redundancy.explorer.ticker import Ticker

DOWN = np.diag([1.0, -1.0, -1.0])
MET = 1e-9


def raster():
    return rd.paths.raster((0.5, -0.1, 0.4), 0.2, 0.1, 2, orientation=DOWN, step=0.02)


@pytest.mark.parametrize("name", ["iiwa14", "panda", "puma560", "ur5e", "gen3"])
def test_a_moved_target_is_met(name):
    chain = rd.catalog.load(name)
    model = PoseModel(chain)
    rng = np.random.default_rng(0)
    start = model.target.copy()
    for _ in range(3 if name == "gen3" else 20):
        pose = start.copy()
        pose[:3, 3] += rng.uniform(-0.03, 0.03, 3)
        assert model.move(pose)
        np.testing.assert_allclose(chain.forward(model.q), pose, atol=MET)
        assert (model.q >= chain.lower - MET).all()
        assert (model.q <= chain.upper + MET).all()


@pytest.mark.parametrize("name", ["iiwa14", "panda", "gen3"])
def test_the_slider_is_the_piece(name):
    chain = rd.catalog.load(name)
    model = PoseModel(chain)
    for index, piece in enumerate(rd.solutions(model.arm, model.target).pieces):
        model.choose(index)
        low, high = piece.range
        for u in np.linspace(low, high, 7)[1:-1]:
            model.slide(float(u))
            np.testing.assert_allclose(model.q, piece.q(float(u)), atol=MET)
            np.testing.assert_allclose(chain.forward(model.q), model.target, atol=MET)


@pytest.mark.parametrize("name", ["iiwa14", "panda"])
def test_bands_are_the_intervals(name):
    model = PoseModel(rd.catalog.load(name))
    for index, piece in enumerate(model.pieces):
        np.testing.assert_array_equal(model.bands(index), piece.intervals())
    # What is coloured as within the limits is within them, judged by the joints themselves.
    _, points, good = model.curve()
    rows = model.pieces[model.piece].q(np.linspace(*model.pieces[model.piece].range, len(points)))
    margin = np.minimum(rows - model.chain.lower, model.chain.upper - rows).min(axis=1)
    clear = np.abs(margin) > 1e-6
    np.testing.assert_array_equal(good[clear], margin[clear] > 0.0)


def test_bands_are_drawn_where_the_arcs_are():
    arcs = np.array([[2.5, 4.0], [-1.0, 0.5]])
    parts = pictures.within_turn(arcs, True)
    u = np.linspace(-np.pi, np.pi, 2001)
    drawn = np.zeros(len(u), dtype=bool)
    for low, high in parts:
        assert -np.pi <= low <= high <= np.pi
        drawn |= (u >= low) & (u <= high)
    np.testing.assert_array_equal(drawn, inside(arcs, u, closed=True))
    assert pictures.within_turn(np.array([[-np.pi, np.pi]]), True) == [(-np.pi, np.pi)]


def test_a_target_out_of_reach_gives_the_reason_and_keeps_the_arm():
    model = PoseModel(rd.catalog.load("iiwa14"))
    q = model.q.copy()
    pose = model.target.copy()
    pose[:3, 3] = (3.0, 0.0, 0.4)
    assert not model.move(pose)
    assert not model.reached
    np.testing.assert_array_equal(model.q, q)
    assert "unreachable" in model.words()
    assert rd.solutions(model.arm, pose).reason in model.words()
    with pytest.raises(RefusedError, match="no curve to slide on"):
        model.slide(0.1)


def test_best_is_not_worse_than_any_sample():
    model = PoseModel(rd.catalog.load("panda"))
    criterion = model.criteria["joint range"]
    model.best()
    best = criterion.value(model.q)
    for index, piece in enumerate(model.pieces):
        u = np.linspace(*piece.range, 400)
        rows = piece.q(u[inside(model.bands(index), u, piece.closed)])
        assert len(rows) == 0 or best <= criterion.value(rows).min() + 1e-9
    assert model.facts().kind in {"minimum", "not_critical"}


def test_a_position_outside_the_limits_is_named():
    model = PoseModel(rd.catalog.load("iiwa14"))
    for index, piece in enumerate(model.pieces):
        u = np.linspace(*piece.range, 721)
        out = u[~inside(model.bands(index), u, True)]
        if len(out):
            model.choose(index)
            model.slide(float(out[len(out) // 2]))
            break
    worst = int(np.argmin(model.margins))
    assert model.margins[worst] < 0.0
    assert f"joint '{model.chain.joint_names[worst]}'" in model.words()
    assert pictures.margin_colour(float(model.shares[worst])) == pictures.VERMILION


def test_spin_and_tilt_stay_within_the_freedom():
    freedom = rd.ToolFreedom(0.3, 0.5)
    model = PoseModel(rd.catalog.load("iiwa14"), freedom=freedom)
    model.turn_tool((0.9, 0.0), 2.0)
    assert np.linalg.norm(model.tilt) == pytest.approx(0.3)
    assert model.spin == 0.5
    turn = model.target[:3, :3].T @ model.wanted[:3, :3]
    assert np.arccos(turn[2, 2]) == pytest.approx(0.3)
    if model.reached:
        np.testing.assert_allclose(model.chain.forward(model.q), model.wanted, atol=MET)
    with pytest.raises(RefusedError, match="no freedom"):
        PoseModel(rd.catalog.load("iiwa14")).turn_tool(spin=0.1)


def test_the_convention_of_tilt_and_spin_is_the_planners():
    chain = rd.catalog.load("iiwa14")
    path, freedom = raster(), rd.ToolFreedom(0.3, 0.5)
    plan = rd.plan(chain, path, freedom)
    model = PoseModel(chain, freedom=freedom)
    for row in (0, len(plan) // 2):
        model.target, model.tilt, model.spin = path.poses[row], plan.tilt[row], float(plan.spin[row])
        np.testing.assert_allclose(model.wanted, plan.poses[row], atol=1e-12)


@pytest.mark.parametrize("value", [np.nan, np.inf, "x", None, [1.0], {}])
def test_values_that_are_no_numbers_are_refused(value):
    model = PoseModel(rd.catalog.load("iiwa14"))
    q = model.q.copy()
    with pytest.raises(RefusedError):
        model.slide(value)
    pose = np.eye(4).tolist()
    pose[0][3] = value
    with pytest.raises(RefusedError):
        model.move(pose)
    np.testing.assert_array_equal(model.q, q)


def test_the_shapes_of_links_are_drawn_where_they_are():
    shapes = pytest.importorskip("redundancy.explorer.shapes", reason="the extra 'explorer' is not installed")
    file = example_robots() / "panda_description" / "urdf" / "panda.urdf"
    chain = rd.Chain.from_urdf(file, "panda_link0", "panda_hand")
    links = rd.LinkGeometry.from_urdf(chain, file, package_dirs=[example_robots().parents[1]])
    body = Body(chain)
    drawn = shapes.of_links(links, body)
    rng = np.random.default_rng(0)
    for _ in range(40):
        q = chain.lower + rng.uniform(0.2, 0.8, 7) * (chain.upper - chain.lower)
        one = drawn[rng.integers(len(drawn))]
        corner = one.vertices[one.faces[rng.integers(len(one.faces)), 0]]
        if one.joints_before:
            at = body.frames(q)[body.frame_after(one.joints_before - 1)]
            corner = at[:3, :3] @ corner + at[:3, 3]
        # A corner of a drawn triangle is a point of the geometry: the distance from it is 0, or another link covers it.
        assert rd.Scene([rd.Sphere(corner, 0.0)]).clearance(chain, q, links).distance < 1e-9


def test_bands_of_the_spin_hold_configurations():
    model = PoseModel(rd.catalog.load("ur5e"), freedom=rd.ToolFreedom(0.0, "free"))
    parts = model.spin_bands()
    assert parts
    for spin in np.linspace(-3.1, 3.1, 23):
        model.turn_tool(spin=float(spin))
        held = model.reached and bool((model.margins >= -MET).all())
        if min(abs(spin - edge) for part in parts for edge in part) > 0.06:
            assert held == any(low <= spin <= high for low, high in parts)
    # Another pose of the target, so that some spins are out of reach or limits.
    model = PoseModel(rd.catalog.load("iiwa14"), freedom=rd.ToolFreedom(0.1, 1.0))
    spin = model.spin
    assert all(-1.0 <= low <= high <= 1.0 for low, high in model.spin_bands())
    assert model.spin == spin


# --- path ---------------------------------------------------------------------------------------------------


def test_a_plan_is_shown_as_it_is():
    chain, path = rd.catalog.load("iiwa14"), raster()
    plan = rd.plan(chain, path)
    model = PathModel(chain, path, [plan])
    model.set_time(1e9)
    np.testing.assert_allclose(model.lines[0].at(model.time), plan.q[-1], atol=1e-12)
    middle = 0.5 * model.duration
    np.testing.assert_array_equal(model.lines[0].at(middle), plan.sample(plan.t[0] + middle)[0])
    model.set_time(0.0)
    assert model.advance(0.5 * model.duration)
    assert model.time == pytest.approx(middle)
    assert not model.advance(2.0 * model.duration)
    name, lengths, columns = model.spare_map()
    assert name == "swivel"
    assert len(lengths) == len(columns)
    rows = pictures.shown(len(plan), len(lengths))
    values = rd.SrsArm(chain).swivel(plan.q)[rows]
    for column, value in zip(columns, values, strict=True):
        assert inside(np.array(column), np.array([value]), closed=True).all()


def test_the_map_of_a_panda_and_of_a_spin_hold_the_plan():
    chain, path = rd.catalog.load("panda"), raster()
    plan = rd.plan(chain, path)
    name, lengths, columns = PathModel(chain, path, [plan]).spare_map()
    assert name == "q7"
    values = plan.q[pictures.shown(len(plan), len(lengths)), -1]
    for column, value in zip(columns, values, strict=True):
        assert any(low - 0.05 <= value <= high + 0.05 for low, high in column)
    six = rd.catalog.load("ur5e")
    freedom = rd.ToolFreedom(0.0, "free")
    plan = rd.plan(six, path, freedom)
    name, lengths, columns = PathModel(six, path, [plan], freedom=freedom).spare_map()
    assert name == "spin"
    values = plan.spin[pictures.shown(len(plan), len(lengths))]
    for column, value in zip(columns, values, strict=True):
        assert inside(np.array(column).reshape(-1, 2), np.array([value]), closed=True).all()


def test_plans_that_cannot_be_shown_are_refused():
    chain, path = rd.catalog.load("iiwa14"), raster()
    far = path.transformed(rd.pose((5.0, 0.0, 0.0)))
    with pytest.raises(RefusedError, match="has no rows"):
        PathModel(chain, far, [rd.plan(chain, far)])
    with pytest.raises(RefusedError, match="joints"):
        PathModel(rd.catalog.load("ur5e"), path, [rd.plan(chain, path)])
    with pytest.raises(RefusedError, match="no path"):
        PathModel(chain, None).replan(None)


def test_intervals_that_touch_are_one():
    assert merged([(0.5, 1.0), (-1.0, 0.2), (0.1, 0.3), (1.0, 2.0)]) == [(-1.0, 0.3), (0.5, 2.0)]


# --- scene --------------------------------------------------------------------------------------------------


def test_a_scene_comes_through_the_page_unchanged():
    obstacles = [
        rd.Sphere((0.4, 0.1, 0.2), 0.1, name="ball"),
        rd.Box(rd.pose((0.1, 0.5, 0.2), rpy=(0.1, 0.2, 0.3)), (0.1, 0.2, 0.3), velocity=(0.1, 0.0, 0.0)),
        rd.Capsule((0.5, 0.0, 0.0), (0.5, 0.3, 0.4), 0.05),
        rd.Cylinder(rd.pose((0.3, 0.3, 0.3)), 0.1, 0.2, attached_to="link_7"),
        rd.HalfSpace((0.0, 0.0, -0.1), (0.0, 0.1, 1.0)),
    ]
    chain = rd.catalog.load("iiwa14")
    scene = rd.Scene(obstacles, allowed=[("link_1", "ball")])
    shown = SceneModel(scene).scene
    q = np.full(7, 0.3)
    before, after = scene.clearance(chain, q), shown.clearance(chain, q)
    assert after.distance == pytest.approx(before.distance, abs=1e-12)
    assert {k: float(v) for k, v in after.by_link.items()} == pytest.approx(
        {k: float(v) for k, v in before.by_link.items()}, abs=1e-12
    )
    assert shown.allowed == scene.allowed
    assert [o.attached_to for o in shown.obstacles] == [o.attached_to for o in scene.obstacles]


def test_obstacles_are_moved_and_resized():
    model = SceneModel()
    for kind in ("sphere", "box", "capsule", "cylinder"):
        model.add(kind, (0.5, 0.0, 0.5), 0.1)
    model.select(1)
    model.resize((0.2, 0.3, 0.4))
    model.move(rd.pose((1.0, 2.0, 3.0)))
    box = model.scene.obstacles[1]
    np.testing.assert_array_equal(box.half_extents, (0.2, 0.3, 0.4))
    np.testing.assert_array_equal(box.pose[:3, 3], (1.0, 2.0, 3.0))
    model.remove()
    assert [type(o).__name__ for o in model.scene.obstacles] == ["Sphere", "Capsule", "Cylinder"]
    with pytest.raises(RefusedError, match="no obstacle is chosen"):
        model.remove()


@pytest.mark.parametrize("size", [0.0, -1.0, 1e9, np.nan, np.inf])
def test_sizes_that_no_obstacle_has_are_refused(size):
    model = SceneModel(rd.Scene([rd.Sphere((0.0, 0.0, 1.0), 0.1)]))
    model.select(0)
    with pytest.raises(RefusedError):
        model.resize((size,))
    with pytest.raises(RefusedError):
        model.add("box", (0.0, 0.0, 0.0), size)
    assert len(model.scene) == 1
    assert model.scene.obstacles[0].radius == 0.1


# --- servo --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["iiwa14", "panda", "ur5e"])
def test_the_servo_reaches_its_target_within_all_limits(name):
    chain = rd.catalog.load(name)
    q = PoseModel(chain).q
    model, target = ServoModel(chain), chain.forward(q)
    model.start(q, target)
    middle = 0.5 * (np.maximum(chain.lower, -3.0) + np.minimum(chain.upper, 3.0))
    rows = []
    for k in range(400):
        if k < 100:
            target = chain.forward(q + 0.002 * (k + 1) * (middle - q))
            model.aim(target)
        model.tick()
        rows.append(model.latest.q)
    assert model.latest.status == "converged"
    np.testing.assert_allclose(chain.forward(model.latest.q), target, atol=MET)
    assert model.latest.position_error < MET
    rows, dt = np.array([q, *rows]), model.dt
    speeds = np.diff(rows, axis=0) / dt
    changes = np.diff(np.vstack([np.zeros(chain.dof), speeds]), axis=0) / dt
    assert (rows >= chain.lower - MET).all()
    assert (rows <= chain.upper + MET).all()
    assert (np.abs(speeds) <= model.velocity_limits + 1e-9).all()
    assert (np.abs(changes) <= model.acceleration_limits * (1.0 + 1e-9)).all()
    history = model.history()
    assert len(history) == 100
    np.testing.assert_allclose(np.diff(history[:, 0]), 4.0 * dt, atol=1e-12)


def test_a_servo_says_why_it_cannot_start_or_arrive():
    chain = rd.catalog.load("iiwa14")
    model = ServoModel(chain)
    q = PoseModel(chain).q
    with pytest.raises(RefusedError, match="not started"):
        model.tick()
    outside = q.copy()
    outside[3] = chain.upper[3] + 0.1
    with pytest.raises(RefusedError, match="joint 'A4'"):
        model.start(outside, chain.forward(q))
    target = chain.forward(q)
    model.start(q, target)
    target[:3, 3] = (0.0, 0.0, 3.0)
    model.aim(target)
    for _ in range(300):
        model.tick()
    assert model.latest.status in {"unreachable", "limits"}
    assert model.words().startswith(f"{model.latest.status}: ")
    assert len(model.words()) > 20
    error = np.linalg.norm(chain.forward(model.latest.q)[:3, 3] - target[:3, 3])
    assert model.latest.position_error == pytest.approx(error, abs=1e-12)
    for bad in (np.nan, 1e9):
        target[0, 3] = bad
        with pytest.raises(RefusedError):
            model.aim(target)
    assert limit_words([]) == "nothing"
    assert limit_words([("A4", "velocity", "upper")]) == "A4 velocity (upper)"


def test_ticks_keep_their_rate_and_end():
    import time

    times, failures = [], []
    ticker = Ticker(0.01, lambda: times.append(time.perf_counter()), failures.append)
    threading.Event().wait(0.3)
    ticker.stop()
    assert not ticker.running
    count = len(times)
    assert count == ticker.ticks
    # Late ticks do not delay the ones after them, unless they were so late that they were dropped.
    assert count + ticker.dropped >= 25
    threading.Event().wait(0.05)
    assert len(times) == count
    broken = Ticker(0.01, lambda: 1 // 0, failures.append)
    broken.stop()
    assert isinstance(failures[0], ZeroDivisionError)


# --- map ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    pytest.importorskip("zarr", reason="the extra 'maps' is not installed")
    folder = tmp_path_factory.mktemp("maps") / "iiwa.zarr"
    chain = rd.catalog.load("iiwa14")
    metrics = ("reachable", "margin", "swivel_measure", "manipulability")
    rd.maps.capability(chain, out=folder, spacing=0.3, directions=8, metrics=metrics)
    return folder


def test_slices_hold_the_reached_cells_and_their_values(store):
    chain, found = rd.catalog.load("iiwa14"), rd.maps.open(store)
    model = MapModel(chain, found)
    values = {
        name: np.concatenate([found.chunk(k)[name] for k in range(len(found.done))]) for name in found.metrics
    }
    reached = values["reachable"].any(axis=1).reshape(found.shape)
    share = found.share("reachable")
    margin = np.where(values["reachable"], values["margin"], -np.inf).max(axis=1).reshape(found.shape)
    assert 0.0 < reached.mean() < 1.0
    seen = 0
    for axis, name in enumerate("xyz"):
        for level in range(found.shape[axis]):
            model.cut(name, float(model.levels(axis)[level]))
            assert model.index == level
            here = tuple(level if k == axis else slice(None) for k in range(3))
            for layer, wanted in (
                ("reachable: share of the directions", share),
                ("margin: best direction", margin),
            ):
                model.choose(layer)
                places, shown = model.cells()
                assert len(places) == reached[here].sum()
                np.testing.assert_allclose(shown, wanted[here][reached[here]])
                np.testing.assert_array_equal(
                    places, found.positions.reshape(*found.shape, 3)[here][reached[here]]
                )
            seen += len(places)
    assert seen == 3 * reached.sum()
    # What is shown is what the core says of the poses there.
    model.choose("margin: best direction")
    model.cut("y", 0.0)
    places, shown = model.cells()
    poses = np.concatenate([found.poses(k) for k in range(len(found.done))])
    at = poses[np.abs(poses[:, :3, 3] - places[0]).max(axis=1) < 1e-9]
    assert shown[0] == pytest.approx(rd.maps.best_margin(chain, at).max(), abs=1e-6)


def test_colours_follow_the_values():
    values = np.linspace(-2.0, 5.0, 200)
    colours = pictures.ramp(values, -2.0, 5.0).astype(float)
    lightness = colours @ (0.2126, 0.7152, 0.0722)
    # Never darker, up to the rounding of two colours to bytes: told apart without hues.
    assert (np.diff(lightness) >= -1.0).all()
    assert lightness[-1] - lightness[0] > 120.0
    np.testing.assert_array_equal(pictures.ramp(np.array([-9.0, 9.0]), -2.0, 5.0), colours[[0, -1]])
    assert "margin" in pictures.colour_bar("margin (rad)", 0.0, 1.5)
    assert pictures.ramp(np.array([1.0]), 1.0, 1.0).shape == (1, 3)


def test_maps_that_cannot_be_shown_are_refused(store):
    found = rd.maps.open(store)
    with pytest.raises(RefusedError, match="7 joints, this arm 'ur5e' has 6"):
        MapModel(rd.catalog.load("ur5e"), found)
    with pytest.raises(RefusedError, match="limits"):
        MapModel(rd.catalog.load("panda"), found)
    moved = rd.catalog.load("iiwa14").with_base(rd.pose((0.1, 0.0, 0.0)))
    with pytest.raises(RefusedError, match="tool is elsewhere"):
        MapModel(moved, found)
    model = MapModel(rd.catalog.load("iiwa14"), found)
    for bad in (np.nan, "x", None):
        with pytest.raises(RefusedError):
            model.cut("x", bad)
    with pytest.raises(RefusedError, match="no axis"):
        model.cut("w", 0.0)
    with pytest.raises(RefusedError, match="no layer"):
        model.choose("luck")
    assert "no map" in MapModel(rd.catalog.load("iiwa14")).words()


def test_the_state_holds_the_slice(store):
    pytest.importorskip("viser", reason="the extra 'explorer' is not installed")
    with rd.explore(rd.catalog.load("iiwa14"), port=0, open_browser=False, capability=store) as view:
        view.call(lambda: view.map_panel.turn("x"))
        view.call(lambda: view.map_panel.choose("manipulability: best direction"))
        view.call(lambda: view.map_panel.cut(0.35))
        text, at = view.state(), view.map.at
        view.call(lambda: view.map_panel.turn("z"))
        view.load(text)
        assert (view.map.axis, view.map.at, view.map.layer) == (0, at, "manipulability: best direction")
        for change in ({"axis": "w"}, {"at": float("nan")}, {"layer": 3}, 5):
            values = json.loads(text)
            values["map"] = values["map"] | change if isinstance(change, dict) else change
            with pytest.raises(ValueError):
                view.load(json.dumps(values))
        assert view.state() == text


# --- the page -----------------------------------------------------------------------------------------------


def test_the_mailbox_keeps_one_item_per_name():
    failures, done = [], []
    box = Mailbox(failures.append)
    gate = threading.Event()
    box.post("first", gate.wait)
    for k in range(1000):
        box.post("slider", lambda k=k: done.append(k))
    box.post("bad", lambda: 1 // 0)
    assert len(box) <= 3
    gate.set()
    assert box.settle(10.0)
    box.close()
    assert done == [999]
    assert isinstance(failures[0], ZeroDivisionError)


@pytest.fixture(scope="module")
def view():
    pytest.importorskip("viser", reason="the extra 'explorer' is not installed")
    chain, path = rd.catalog.load("iiwa14"), raster()
    scene = rd.Scene([rd.Sphere((0.4, -0.4, 0.5), 0.1)])
    shown = rd.explore(
        chain, path=path, plan=rd.plan(chain, path, scene=scene), scene=scene, port=0, open_browser=False
    )
    with shown:
        yield shown


def test_it_listens_on_this_machine_only(view):
    assert view.url.startswith("http://127.0.0.1:")
    sockets = view.server._websock_server
    assert sockets._host == "127.0.0.1"
    import urllib.request

    with urllib.request.urlopen(view.url) as page:
        assert page.status == 200


def test_the_state_opens_again(view):
    view.call(lambda: view.pose_panel.slide(40.0))
    text = view.state()
    q, target = view.pose.q.copy(), view.pose.target.copy()
    view.call(lambda: view.pose_panel.slide(-60.0))
    view.call(lambda: view.scene_panel.add_one("box"))
    view.call(lambda: view.path_panel.seek(0.3))
    view.load(text)
    np.testing.assert_allclose(view.pose.q, q, atol=MET)
    np.testing.assert_array_equal(view.pose.target, target)
    assert len(view.scene.scene) == 1
    assert view.path.time == 0.0


@pytest.mark.parametrize(
    "change",
    [
        {"joint_names": ["a"]},
        {"q": [0.0]},
        {"q": [float("nan")] * 7},
        {"target": 3},
        {"scene": {"obstacles": [{"type": "sphere", "center": [0, 0, 0], "radius": -1}]}},
        {"criterion": "luck"},
        {"speed": 1e9},
        {"redundancy_explorer": 99},
    ],
)
def test_a_broken_state_changes_nothing(view, change):
    before = view.state()
    values = json.loads(before) | change
    with pytest.raises(ValueError):
        view.load(json.dumps(values))
    assert view.state() == before
    for text in ("", "[]", "{", "[" * 100_000):
        with pytest.raises(ValueError):
            view.load(text)


def test_planning_again_reports_progress_and_can_be_cancelled(view):
    lines = list(view.path.lines)
    view.call(view.path_panel.plan)
    view.path_panel.cancel()
    view.settle(20.0)
    assert view.path.lines == lines
    assert "cancelled" in view.notices.content
    view.call(view.path_panel.plan)
    view.settle(20.0)
    assert view.path.lines[0].name == "new plan"
    assert view.path.lines[0].plan.legal
    assert view.path_panel.progress.value == 100.0


def test_the_servo_takes_the_arm_and_gives_it_back(view):
    panel = view.servo_panel
    view.call(lambda: view.pose_panel.go_to("best"))
    view.call(lambda: panel.switch(True))
    ticker = panel.ticker
    at, wxyz = view.pose.target[:3, 3] + (0.0, 0.0, 0.02), rd.quaternion.from_matrix(view.pose.target[:3, :3])
    view.call(lambda: view.pose_panel.dragged(at, wxyz))
    for _ in range(500):
        threading.Event().wait(0.02)
        if view.servo.latest.position_error < 0.1 * MET:
            break
    view.settle()
    np.testing.assert_allclose(view.pose.chain.forward(view.servo.latest.q)[:3, 3], at, atol=MET)
    assert "time to stop" in panel.figures.content
    # Whatever pose mode is asked for, it takes the arm.
    view.call(lambda: view.pose_panel.go_to("nearest"))
    assert not ticker.running
    assert not panel.on.value
    assert view.pose.reached
    assert "kind of optimum" in view.pose_panel.facts.content
    # A configuration outside of the limits is refused, in words.
    model = view.pose
    q = model.q.copy()
    model.q = q + 9.0
    view.post("servo", lambda: panel.switch(True))
    view.settle()
    assert "cannot start" in view.notices.content
    assert not panel.running
    model.q = q
    # Closing ends it.
    with rd.explore(model.chain, port=0, open_browser=False) as other:
        other.call(lambda: other.servo_panel.switch(True))
        ticker = other.servo_panel.ticker
        assert ticker.running
    assert not ticker.running


def test_two_plans_stand_side_by_side():
    pytest.importorskip("viser", reason="the extra 'explorer' is not installed")
    chain, path, freedom = rd.catalog.load("iiwa14"), raster(), rd.ToolFreedom(0.2, "free")
    plans = [rd.plan(chain, path), rd.plan(chain, path, freedom)]
    with rd.explore(chain, path=path, plan=plans, port=0, open_browser=False, freedom=freedom) as view:
        assert view.path_panel.second is not None
        view.call(lambda: view.path_panel.seek(0.5 * view.path.duration))
        tool = view.path_panel.second.tool.position
        second = chain.forward(view.path.lines[1].at(view.path.time))[:3, 3]
        np.testing.assert_allclose(tool, second, atol=MET)
        assert view.path_panel.second.root.position[1] > view.pose.body.reach
        assert "plan 2" in view.path_panel.status.content
        assert "clearance" not in view.path_panel.strips.content
        assert view.server.scene.get_handle_by_name("/cone") is not None


def test_the_command_serves_until_it_is_interrupted(tmp_path):
    pytest.importorskip("viser", reason="the extra 'explorer' is not installed")
    import os
    import signal
    import subprocess
    import sys
    import urllib.request

    file = tmp_path / "path.csv"
    raster().to_csv(file)
    command = [sys.executable, "-m", "redundancy", "explore", "--robot", "ur5e", "--path", str(file)]
    process = subprocess.Popen(
        [*command, "--spin", "free", "--port", "0", "--no-browser"],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    try:
        url = process.stdout.readline().split()[0]
        with urllib.request.urlopen(url) as page:
            assert page.status == 200
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0
    finally:
        process.kill()
        process.stdout.close()


def test_the_command_wants_an_arm_or_a_map(capsys, store):
    from redundancy import _commands

    assert _commands.run(["explore", "--no-browser"]) == 2
    assert "--robot, or --map" in capsys.readouterr().err
    assert _commands.run(["explore", "--robot", "ur5e", "--map", str(store), "--no-browser"]) == 2
    assert "this arm 'ur5e' has 6" in " ".join(capsys.readouterr().err.split())


def test_malformed_messages_end_nothing(view):
    import msgspec
    import viser
    from websockets.sync.client import connect

    rng = np.random.default_rng(1)
    encode = msgspec.msgpack.encode
    slider, gizmo = view.pose_panel.slider._impl.uuid, "/target"
    nan = float("nan")
    crafted = [
        b"",
        encode({"type": "NoSuchMessage"}),
        encode({"type": "ShareUrlRequest"}),
        encode({"type": "GuiUpdateMessage", "uuid": slider, "updates": {"value": nan}}),
        encode({"type": "GuiUpdateMessage", "uuid": slider, "updates": {"value": "x" * 200_000}}),
        encode({"type": "GuiUpdateMessage", "uuid": slider, "updates": {"update_cb": 5}}),
        encode({"type": "GuiUpdateMessage", "uuid": slider, "updates": 3}),
        encode(
            {
                "type": "TransformControlsUpdateMessage",
                "name": gizmo,
                "wxyz": [1, 0, 0, 0],
                "position": [nan, 0, 0],
            }
        ),
        encode(
            {"type": "TransformControlsUpdateMessage", "name": gizmo, "wxyz": [1, 0], "position": [0, 0, 0]}
        ),
        encode({"type": "TransformControlsUpdateMessage", "name": gizmo}),
        "text",
    ]
    q, refused = view.pose.q.copy(), view.refused
    address = view.url.replace("http", "ws")
    with connect(address, subprotocols=[f"viser-v{viser.__version__}"], max_size=None) as socket:
        for k in range(1000):
            bad = crafted[k % len(crafted)] if k % 2 else rng.bytes(int(rng.integers(1, 200)))
            socket.send(bad)
        # The connection lives: a good message of the same client still arrives.
        socket.send(encode({"type": "GuiFormDirtyMessage", "uuid": "none"}))
        for _ in range(200):
            if view.refused - refused >= 1000:
                break
            threading.Event().wait(0.05)
    assert view.refused - refused >= 990
    view.settle()
    assert "refused" in view.notices.content
    np.testing.assert_array_equal(view.pose.q, q)
    view.call(lambda: view.pose_panel.slide(10.0))
    assert view.pose.u == pytest.approx(np.deg2rad(10.0))


def test_pages_of_other_addresses_cannot_steer_it(view):
    import msgspec
    import viser
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect

    u = view.pose.u
    slider = view.pose_panel.slider._impl.uuid
    moved = msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": slider, "updates": {"value": 77.0}})
    address, protocol = view.url.replace("http", "ws"), [f"viser-v{viser.__version__}"]
    origin = "http://elsewhere.example"
    with (
        connect(address, subprotocols=protocol, origin=origin, max_size=None) as socket,
        pytest.raises(ConnectionClosed),
    ):
        for _ in range(200):
            socket.send(moved)
            socket.recv(timeout=5.0)
    view.settle()
    assert view.pose.u == u
    assert "another address" in view.notices.content


def test_values_that_cannot_be_are_said_in_the_page(view):
    view.call(lambda: view.scene_panel.add_one("sphere"))
    for size in (0.0, 1e9):
        view.scene_panel.sizes[0].value = size
        view.post("size", view.scene_panel.resize)
        view.settle()
        assert f"the size is {size:g} m" in view.notices.content
        assert view.scene_panel.sizes[0].value == pytest.approx(view.scene.obstacles[-1].sizes[0])
    target = view.pose.target.copy()
    view.post("gizmo", lambda: view.pose_panel.move((1e9, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)))
    view.settle()
    assert "at most 1000 m" in view.notices.content
    np.testing.assert_array_equal(view.pose.target, target)
    view.call(view.scene_panel.remove_one)


def test_a_recording_is_one_file_that_names_no_other_machine(view):
    html = view.recording()
    assert html.startswith("<!doctype html>")
    assert "__VISER_EMBED_DATA__" in html
    import re

    hosts = set(re.findall(r"""(?:src|href)=["'](https?://[^"']+)""", html))
    assert not hosts


def test_the_missing_extra_is_named():
    import subprocess
    import sys

    code = (
        "import sys; sys.modules['viser'] = None\n"
        "import redundancy as rd\n"
        "try:\n    rd.explore(rd.catalog.load('iiwa14'), open_browser=False)\n"
        "except ImportError as error:\n    print(error)\n"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "extra 'explorer'" in out.stdout


def test_a_soak_leaves_no_queue_and_no_memory(view):
    """Ten minutes of a dragged gizmo with REDUNDANCY_TEST_FULL=1, some hundred moves without it.

    The servo follows the gizmo in the second half of the time.
    """
    import os
    import time

    import msgspec
    import viser
    from websockets.sync.client import connect

    full = os.environ.get("REDUNDANCY_TEST_FULL") == "1"
    encode = msgspec.msgpack.encode
    camera = {
        "type": "ViewerCameraMessage",
        **{"wxyz": [1, 0, 0, 0], "position": [2, 2, 2], "look_at": [0, 0, 0], "up_direction": [0, 0, 1]},
        **{"fov": 1.0, "near": 0.01, "far": 100.0, "image_height": 400, "image_width": 400},
    }
    start, waiting, sizes, moves = view.pose.target.copy(), 0, [], 0
    wxyz = rd.quaternion.from_matrix(start[:3, :3]).tolist()
    begin, length = time.monotonic(), 600.0 if full else 1.0
    end = begin + length
    with connect(
        view.url.replace("http", "ws"), subprotocols=[f"viser-v{viser.__version__}"], max_size=None
    ) as s:
        reader = threading.Thread(target=lambda: [None for _ in s], daemon=True)
        reader.start()
        s.send(encode(camera))
        while time.monotonic() < end:
            position = (start[:3, 3] + 0.05 * np.sin(0.02 * moves + np.arange(3.0))).tolist()
            s.send(
                encode(
                    {
                        "type": "TransformControlsUpdateMessage",
                        "name": "/target",
                        "wxyz": wxyz,
                        "position": position,
                    }
                )
            )
            moves += 1
            if not view.servo_running and time.monotonic() > begin + 0.5 * length:
                view.call(lambda: view.servo_panel.switch(True))
            waiting = max(waiting, len(view.mailbox))
            threading.Event().wait(0.005)
            if moves % 2000 == 0:
                sizes.append((resident(), len(view.server._websock_server._broadcast_buffer.message_from_id)))
        assert reader.is_alive()
        wanted = np.array(position)
        ticker = view.servo_panel.ticker
        assert view.servo_running
        for _ in range(200):
            view.settle()
            if np.allclose(view.servo.target[:3, 3], wanted, atol=MET):
                break
            threading.Event().wait(0.02)
        np.testing.assert_allclose(view.servo.target[:3, 3], wanted, atol=MET)
        view.call(lambda: view.servo_panel.switch(False))
        np.testing.assert_allclose(view.pose.q, view.servo.latest.q, atol=MET)
    reader.join(10.0)
    assert moves > 20
    assert waiting <= 3
    np.testing.assert_allclose(view.pose.chain.forward(view.pose.q), view.pose.target, atol=MET)
    assert not ticker.running
    assert (ticker.ticks + ticker.dropped) * ticker.dt > 0.4 * length
    if full:
        print(
            f"{moves} moves, {ticker.ticks} ticks, at most {1e3 * ticker.late:.1f} ms late, {ticker.dropped} dropped"
        )
        print("resident memory (MB) and messages kept:", [(round(m / 1e6, 1), k) for m, k in sizes])
        settled = sizes[len(sizes) // 4 :]
        assert settled[-1][0] - settled[0][0] < 20e6, sizes
        assert settled[-1][1] - settled[0][1] < 200, sizes


def resident():
    """Memory of this process, bytes."""
    import os
    from pathlib import Path

    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")
