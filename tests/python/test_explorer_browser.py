"""The explorer in a real browser: Debian's Chromium, driven by Playwright; skipped, with the reason, without it.

With REDUNDANCY_DOCS_IMAGES=1 the pictures of docs/explorer.md are written, at 1280 x 800.
"""

import os
import shutil
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import redundancy as rd

pytest.importorskip("viser", reason="the extra 'explorer' is not installed")
sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
if CHROMIUM is None:
    pytest.skip("no chromium: apt-get install chromium", allow_module_level=True)

FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
DOWN = np.diag([1.0, -1.0, -1.0])
SMALL = {"width": 760, "height": 420}
DOCS = Path(__file__).parents[2] / "docs" / "images"
MET = 1e-9
WAIT = 90_000
"""How long a page may take, ms: browsers that draw in software on a busy machine are slow."""


@pytest.fixture(scope="module")
def chromium():
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """A map of three planes beside each other; finer for the pictures of the documentation."""
    pytest.importorskip("zarr", reason="the extra 'maps' is not installed")
    folder, chain = tmp_path_factory.mktemp("maps") / "iiwa.zarr", rd.catalog.load("iiwa14")
    spacing = 0.05 if os.environ.get("REDUNDANCY_DOCS_IMAGES") == "1" else 0.1
    region = ((-1.0, 1.0), (-spacing, spacing), (-0.4, 1.4))
    rd.maps.capability(
        chain, out=folder, spacing=spacing, directions=12, metrics=("reachable", "margin"), region=region
    )
    return folder


@pytest.fixture(scope="module")
def view(store):
    chain = rd.catalog.load("iiwa14")
    path = rd.paths.raster((0.5, -0.1, 0.4), 0.25, 0.08, 3, orientation=DOWN, step=0.01)
    scene = rd.Scene([rd.Sphere((0.42, -0.42, 0.55), 0.09, name="ball")])
    plan = rd.plan(chain, path, scene=scene)
    shown = rd.explore(chain, path=path, plan=plan, scene=scene, port=0, open_browser=False, capability=store)
    with shown:
        shown.map_panel.shown.value = False
        shown.call(shown.map_panel.push)
        yield shown


class Page:
    """A page of the explorer that notes errors and what it asks for."""

    def __init__(self, chromium, url, size=SMALL):
        self.errors, self.requests = [], []
        self.page = chromium.new_page(viewport=size)
        self.page.set_default_timeout(WAIT)
        self.page.on("console", lambda m: self.errors.append(m.text) if m.type == "error" else None)
        self.page.on("pageerror", lambda e: self.errors.append(str(e)))
        self.page.on("request", lambda r: self.requests.append(r.url))
        self.page.goto(url)

    def ready(self):
        self.page.get_by_text("kind of optimum").wait_for()
        return self.quiet()

    def quiet(self):
        """Without notices, such as the one that the browser draws in software."""
        self.page.evaluate(
            "document.querySelectorAll('[class*=Notification-closeButton]').forEach(b => b.click())"
        )
        return self

    def tab(self, name):
        self.page.get_by_role("tab", name=name).click()

    def input(self, label):
        row = self.page.get_by_text(label, exact=True).locator(
            "xpath=ancestor::div[.//input[@type='text']][1]"
        )
        return row.locator("input[type=text]").first

    def frames(self, count=2):
        self.page.evaluate(
            "n => new Promise(done => {const f = () => n-- > 0 ? requestAnimationFrame(f) : done(); f()})",
            count,
        )

    def close(self):
        self.page.close()


@pytest.fixture(scope="module")
def page(chromium, view):
    opened = Page(chromium, view.url).ready()
    yield opened
    opened.close()


def eventually(condition, seconds=60.0):
    """Wait until something holds; False after a while."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        threading.Event().wait(0.02)
    return True


def on_screen(view, points):
    """Pixels of points in the first browser."""
    camera = next(iter(view.server.get_clients().values())).camera
    turn = rd.quaternion.to_matrix(np.asarray(camera.wxyz))
    inside = (np.atleast_2d(points) - np.asarray(camera.position)) @ turn
    scale = 0.5 * camera.image_height / np.tan(0.5 * camera.fov)
    centre = (0.5 * camera.image_width, 0.5 * camera.image_height)
    return inside[:, :2] / inside[:, 2:] * scale + centre


def drag(page, view, pose, scale):
    """Drag the arrow along x of a gizmo of a size with the mouse, by a quarter of that size."""
    # The arrow is near the end of its axis.
    along = scale * pose[:3, 0]
    grip, aim = on_screen(view, [pose[:3, 3] + 0.85 * along, pose[:3, 3] + 1.1 * along])
    mouse = page.page.mouse
    mouse.move(*grip)
    page.frames(3)
    mouse.down()
    mouse.move(*(0.5 * (grip + aim)))
    page.frames(2)
    mouse.move(*aim)
    page.frames(2)
    mouse.up()
    page.frames(3)


def test_the_slider_moves_the_arm(page, view):
    page.tab("Pose")
    field = page.input("along it")
    for value in (70.0, -100.5):
        field.fill(str(value))
        field.press("Enter")
        u = np.deg2rad(value)
        assert eventually(lambda u=u: abs(view.pose.u - u) < 1e-12), view.pose.u
        view.settle()
        piece = rd.solutions(view.pose.arm, view.pose.target).pieces[view.pose.piece]
        np.testing.assert_allclose(view.pose.q, piece.q(u), atol=MET)
        np.testing.assert_allclose(view.pose.chain.forward(view.pose.q), view.pose.target, atol=MET)
    bands = page.page.get_by_role("img", name="where all joint limits hold along each self-motion")
    assert bands.locator("text").count() == 8 + 3
    thumb = page.page.get_by_role("slider").first
    thumb.focus()
    before = view.pose.u
    thumb.press("ArrowRight")
    assert eventually(lambda: view.pose.u > before)


def test_the_gizmo_moves_the_tool(page, view):
    view.call(lambda: view.show_configuration(view.path.lines[0].at(0.0)))
    view.settle()
    page.frames(4)
    start = view.pose.target.copy()
    drag(page, view, start, 0.3 * view.pose.body.reach)
    assert eventually(lambda: not np.array_equal(view.pose.target, start))
    page.frames(3)  # the end of the drag is on its way too
    view.settle()
    moved = view.pose.target[:3, 3] - start[:3, 3]
    assert 0.01 < moved @ start[:3, 0] < 0.3
    assert np.linalg.norm(moved - start[:3, 0] * (moved @ start[:3, 0])) < 1e-6
    assert view.pose.reached
    np.testing.assert_allclose(view.pose.chain.forward(view.pose.q), view.pose.target, atol=MET)
    np.testing.assert_allclose(view.pose_panel.gizmo.position, view.pose.target[:3, 3], atol=MET)


def test_out_of_reach_says_why(page, view):
    position, wxyz = (2.0, 0.0, 0.5), (1.0, 0.0, 0.0, 0.0)
    view.call(lambda: view.pose_panel.move(position, wxyz))
    assert not view.pose.reached
    page.page.get_by_text(f"unreachable: {view.pose.solutions.reason}").wait_for()
    view.call(lambda: view.show_configuration(view.path.lines[0].at(0.0)))


def test_a_plan_is_played_to_its_end(page, view):
    page.tab("Path")
    view.call(lambda: view.path_panel.seek(0.0))
    page.page.get_by_role("checkbox", name="play").or_(page.page.get_by_label("play")).first.check()
    assert eventually(lambda: view.path.time > 0.0)
    assert eventually(lambda: view.path.time >= view.path.duration)
    assert eventually(lambda: not view.path_panel.play.value)
    view.settle()
    np.testing.assert_allclose(view.pose.q, view.path.lines[0].q[-1], atol=1e-6)
    assert page.page.get_by_role("img", name="swivel along the path").count() == 1


def test_an_obstacle_is_moved_and_the_path_planned_again(page, view):
    page.tab("Scene")
    before = view.path.lines[0]
    view.call(lambda: view.scene_panel.select("ball"))
    assert page.input("radius (m)").input_value() == "0.09"
    field = page.input("radius (m)")
    field.fill("0.12")
    field.press("Enter")
    assert eventually(lambda: view.scene.scene.obstacles[0].radius == 0.12)
    assert eventually(lambda: view.path.lines[0] is not before)
    assert view.path.lines[0].plan.legal
    before = view.path.lines[0]
    # As the gizmo of the obstacle sends it, at the end of a drag.
    view.call(lambda: view.scene_panel.move((0.45, -0.45, 0.6), (1.0, 0.0, 0.0, 0.0), True))
    assert eventually(lambda: view.path.lines[0] is not before)
    near = view.scene.scene.clearance(view.pose.chain, view.path.lines[0].q)
    assert near.distance.min() > 0.0
    for entered, said in (("0", "the size is 0 m"), ("1000000000", "the size is 1e+09 m")):
        field.fill(entered)
        field.press("Enter")
        page.page.get_by_text(said).wait_for()
        assert view.scene.scene.obstacles[0].radius == 0.12


def test_what_a_client_sent_wrong_is_said_in_every_page(page, view):
    import msgspec
    import viser
    from websockets.sync.client import connect

    name, nan = "/obstacle_gizmo", float("nan")
    bad = {
        "type": "TransformControlsUpdateMessage",
        "name": name,
        "wxyz": [1, 0, 0, 0],
        "position": [nan, 0, 0],
    }
    address, scene = view.url.replace("http", "ws"), view.scene.scene
    with connect(address, subprotocols=[f"viser-v{viser.__version__}"], max_size=None) as socket:
        socket.send(msgspec.msgpack.encode(bad))
        page.page.get_by_text("position is not finite (nan)").wait_for()
        for _ in range(1000):
            socket.send(b"\xc1 nonsense")
        page.page.get_by_text("a message that cannot be decoded").wait_for()
    assert view.scene.scene is scene
    view.call(lambda: view.notice(""))


def test_a_slice_of_the_map_is_drawn(page, view):
    page.tab("Map")
    page.page.get_by_label("show the slice").check()
    assert eventually(lambda: view.server.scene.get_handle_by_name("/map") is not None)
    found = view.map.found
    rows = [found.chunk(k) for k in range(len(found.done))]
    good = np.concatenate([row["reachable"] for row in rows])
    share = good.mean(axis=1).reshape(found.shape)
    margin = np.where(good, np.concatenate([row["margin"] for row in rows]), -np.inf).max(axis=1)
    margin = margin.reshape(found.shape)
    page.page.get_by_text("cells of this slice are reached within the joint limits").wait_for()
    assert page.page.get_by_role("img", name="reachable: share of the directions").count() == 1
    for k, at in enumerate(view.map.levels(1)):
        page.input("at (m)").fill(f"{at:.4f}")
        page.input("at (m)").press("Enter")
        assert eventually(lambda k=k: view.map.index == k)
        view.settle()
        node = view.server.scene.get_handle_by_name("/map")
        reached = share[:, k] > 0.0
        assert len(node.points) == reached.sum()
        # Colours follow the values: never darker for a larger one, and equal for equal ones.
        order = np.argsort(share[:, k][reached], kind="stable")
        lightness = node.colors[order].astype(float) @ (0.2126, 0.7152, 0.0722)
        assert (np.diff(lightness) >= -1.0).all()
        np.testing.assert_allclose(node.points[:, 1], at, atol=1e-6)
    page.page.get_by_label("colour by").click()
    page.page.get_by_role("option", name="margin: best direction").click()
    page.page.get_by_role("img", name="margin: best direction (rad)").wait_for()
    view.settle()
    node = view.server.scene.get_handle_by_name("/map")
    order = np.argsort(margin[:, -1][share[:, -1] > 0.0], kind="stable")
    lightness = node.colors[order].astype(float) @ (0.2126, 0.7152, 0.0722)
    assert (np.diff(lightness) >= -1.0).all()
    page.page.get_by_label("show the slice").uncheck()
    assert eventually(lambda: view.server.scene.get_handle_by_name("/map") is None)


def test_an_obstacle_is_dragged_by_the_mouse(page, view):
    page.tab("Scene")
    view.call(lambda: view.scene_panel.select("ball"))
    page.frames(4)
    plan, before = view.path.lines[0], view.scene.obstacles[0].pose.copy()
    drag(page, view, before, 0.22 * view.pose.body.reach)
    assert eventually(lambda: view.path.lines[0] is not plan)
    moved = view.scene.scene.obstacles[0].center - before[:3, 3]
    assert 0.01 < moved @ before[:3, 0] < 0.3
    assert np.linalg.norm(moved - before[:3, 0] * (moved @ before[:3, 0])) < 1e-6
    near = view.scene.scene.clearance(view.pose.chain, view.path.lines[0].q)
    assert near.distance.min() > 0.0
    view.call(lambda: view.scene_panel.select("none"))


def test_the_servo_follows_the_gizmo(page, view):
    chain = view.pose.chain
    view.call(lambda: view.show_configuration(view.path.lines[0].at(0.0)))
    page.tab("Servo")
    start = view.pose.target.copy()
    rows = []
    tick = view.servo.tick

    def noted():
        tick()
        rows.append(view.servo.latest)

    view.servo.tick = noted
    page.page.get_by_label("follow the gizmo").check()
    assert eventually(lambda: view.servo_running)
    drag(page, view, start, 0.3 * view.pose.body.reach)
    assert eventually(lambda: not np.array_equal(view.servo.target, start))
    assert eventually(
        lambda: view.servo.latest.status == "converged" and view.servo.latest.position_error < MET
    )
    target = view.servo.target
    np.testing.assert_allclose(chain.forward(view.servo.latest.q), target, atol=MET)
    np.testing.assert_allclose(view.pose_panel.gizmo.position, target[:3, 3], atol=MET)
    assert 0.01 < (target - start)[:3, 3] @ start[:3, 0] < 0.3
    page.page.get_by_text("time to stop").wait_for()
    # Out of reach: said in words, and the arm stays within its limits.
    view.call(lambda: view.pose_panel.dragged((0.2, 0.1, 1.9), (1.0, 0.0, 0.0, 0.0)))
    page.page.get_by_text("out of reach").wait_for()
    page.page.get_by_role("checkbox").first.uncheck()
    assert eventually(lambda: not view.servo_running)
    view.settle()
    del view.servo.tick
    q = np.array([row.q for row in rows])
    steps = np.diff(q, axis=0) / view.servo.dt
    assert len(rows) > 50
    assert np.linalg.norm(np.diff(q, axis=0), axis=1).max() > 1e-4
    assert (q >= chain.lower - MET).all()
    assert (q <= chain.upper + MET).all()
    assert (np.abs(steps) <= chain.velocity_limit + 1e-6).all()
    changes = np.diff(steps, axis=0) / view.servo.dt
    assert (np.abs(changes) <= view.servo.acceleration_limits * (1.0 + 1e-6)).all()
    # Pose mode goes on where the servo left the arm.
    np.testing.assert_allclose(view.pose.q, rows[-1].q, atol=MET)
    assert view.pose.reached


def test_two_browsers_see_the_same_and_one_may_vanish(chromium, page, view):
    page.tab("Pose")
    other = Page(chromium, view.url).ready()
    assert eventually(lambda: len(view.server.get_clients()) == 2)
    field = other.input("along it")
    field.fill("-140")
    field.press("Enter")
    assert eventually(lambda: abs(view.pose.u - np.deg2rad(-140.0)) < 1e-12)
    shown = page.input("along it")
    assert eventually(lambda: shown.input_value() == "-140")
    # Gone while a plan is in progress: the plan goes on.
    before = view.path.lines[0]
    view.post("plan", view.path_panel.plan)
    other.close()
    assert eventually(lambda: len(view.server.get_clients()) == 1)
    assert eventually(lambda: view.path.lines[0] is not before)
    assert not other.errors


def test_a_plan_is_cancelled_by_its_button_and_outlives_the_last_page(chromium, monkeypatch):
    chain = rd.catalog.load("iiwa14")
    path = rd.paths.raster((0.5, -0.1, 0.4), 0.25, 0.08, 3, orientation=DOWN, step=0.01)
    with rd.explore(chain, path=path, port=0, open_browser=False) as shown:
        planned, go_on, replan = threading.Event(), threading.Event(), shown.path.replan

        def slowly(scene, report):
            planned.set()
            assert go_on.wait(60.0)
            return replan(scene, report)

        monkeypatch.setattr(shown.path, "replan", slowly)
        last = Page(chromium, shown.url).ready()
        last.tab("Path")
        last.page.get_by_role("button", name="plan", exact=True).click()
        assert planned.wait(60.0)
        last.page.get_by_role("button", name="cancel", exact=True).click()
        assert eventually(shown.path_panel._cancel.is_set)
        go_on.set()
        last.page.get_by_text("the plan was cancelled").wait_for()
        assert not any(line.plan.legal for line in shown.path.lines)
        # Gone while the next one is made.
        planned.clear()
        go_on.clear()
        last.page.get_by_role("button", name="plan", exact=True).click()
        assert planned.wait(60.0)
        last.close()
        assert eventually(lambda: not shown.server.get_clients())
        go_on.set()
        assert eventually(lambda: any(line.plan.legal for line in shown.path.lines))
        assert not last.errors


def test_the_files(page, view, tmp_path):
    page.tab("File")
    with page.page.expect_download() as saved:
        page.page.get_by_role("button", name="save the state").click()
    text = Path(saved.value.path()).read_text()
    assert text == view.state()
    with page.page.expect_download() as picture:
        page.page.get_by_role("button", name="picture (PNG)").click()
    content = Path(picture.value.path()).read_bytes()
    assert content.startswith(b"\x89PNG")
    import imageio.v3

    assert np.ptp(imageio.v3.imread(content)) > 50  # something is drawn


def show_slice(view, wanted):
    """The middle slice of the map, or none."""
    view.map_panel.shown.value = wanted
    view.map.choose("reachable: share of the directions")
    view.map_panel.cut(0.0)


def stream(view):
    """Let the servo follow a moving gizmo for a second."""
    view.call(lambda: view.servo_panel.switch(True))
    gizmo = view.pose_panel.gizmo
    start = np.array(gizmo.position)
    for k in range(25):
        gizmo.position = start + k * np.array([-0.002, 0.01, 0.004])
        view.call(lambda: view.pose_panel.dragged(gizmo.position, gizmo.wxyz))
        threading.Event().wait(0.04)


def test_pictures_of_each_mode(page, view, tmp_path):
    folder = DOCS if os.environ.get("REDUNDANCY_DOCS_IMAGES") == "1" else tmp_path
    view.call(lambda: view.path_panel.seek(0.55 * view.path.duration))
    opened = page
    opened.page.set_viewport_size({"width": 1280, "height": 800})
    for mode in ("Pose", "Path", "Scene", "File", "Map", "Servo"):
        opened.tab(mode)
        view.call(lambda mode=mode: view.scene_panel.select("ball" if mode == "Scene" else "none"))
        view.call(lambda mode=mode: show_slice(view, mode == "Map"))
        if mode == "Servo":
            stream(view)
        opened.quiet().frames(4)
        file = folder / f"explorer_{mode.lower()}.png"
        opened.page.screenshot(path=file, timeout=WAIT)
        assert file.stat().st_size > 20_000
    view.call(lambda: view.servo_panel.switch(False))
    assert not opened.errors
    # No drawing of the panel is wider than the panel, and nothing of it is cut off at the side.
    opened.tab("Pose")
    for box in (one.bounding_box() for one in opened.page.locator("svg[role=img]").all()):
        assert box is None or box["x"] + box["width"] <= 1280


def test_the_page_asks_nothing_outside_and_reports_no_error(page, view):
    assert not page.errors
    here = (view.url, "blob:" + view.url, "data:", view.url.replace("http", "ws"))
    assert all(url.startswith(here) for url in page.requests), page.requests


def test_a_recording_opens_from_a_file(chromium, view, tmp_path):
    file = tmp_path / "explorer.html"
    file.write_text(view.recording())
    opened = Page(chromium, file.as_uri(), {"width": 480, "height": 360})
    opened.page.locator("canvas").first.wait_for()
    # The player of the file runs: its time goes on. (Chromium in software takes no picture of it in a reasonable time.)
    clock = opened.page.locator("input").first
    clock.wait_for()
    first = clock.input_value()
    assert eventually(lambda: clock.input_value() != first)
    assert not opened.errors
    assert all(url.startswith(("file:", "blob:", "data:")) for url in opened.requests), opened.requests
    opened.close()
