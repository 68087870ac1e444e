"""The page: one viser server, its panels, and the thread that does what the browsers ask for."""

import contextlib
import io
import logging
import threading
import webbrowser
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Any, TypeVar

import imageio.v3
import numpy as np
import viser

import redundancy as rd
from redundancy.explorer import drawing, guard, pictures
from redundancy.explorer import state as states
from redundancy.explorer.arm import Array
from redundancy.explorer.file_panel import FilePanel
from redundancy.explorer.mailbox import Mailbox
from redundancy.explorer.map_model import MapModel
from redundancy.explorer.map_panel import MapPanel
from redundancy.explorer.model import PoseModel
from redundancy.explorer.path_model import PathModel
from redundancy.explorer.path_panel import PathPanel, shares
from redundancy.explorer.pose_panel import PosePanel, paragraph
from redundancy.explorer.scene_model import SceneModel
from redundancy.explorer.scene_panel import ScenePanel
from redundancy.explorer.servo_model import ServoModel
from redundancy.explorer.servo_panel import ServoPanel

T = TypeVar("T")
LOOPBACK = "127.0.0.1"
PANEL_WIDTH = 400
"""Width of the panel, pixels."""
RECORDED_STEP = 1.0 / 25.0
"""Time between the pictures of a recording, s."""
MOST_RECORDED = 3000
"""Pictures of a recording at most."""
SELF_MOTION_PICTURES = 150
"""Pictures of a recorded self-motion."""
NEAREST = (150, 156, 163)
"""Colour of the lines from links to their nearest obstacles."""
LONGEST_NOTICE = 300
"""Characters of a notice."""

_log = logging.getLogger("redundancy.explorer")


class View:
    """An explorer that is running. Made by `redundancy.explore`.

    Attributes:
        pose: The `PoseModel`: what pose mode shows.
        path: The `PathModel`.
        scene: The `SceneModel`.
        servo: The `ServoModel`.
        map: The `MapModel`.
    """

    def __init__(
        self,
        pose: PoseModel,
        path: PathModel,
        scene: SceneModel,
        host: str = LOOPBACK,
        port: int = 8080,
        capability: MapModel | None = None,
    ) -> None:
        self.pose, self.path, self.scene = pose, path, scene
        self.map = MapModel(pose.chain) if capability is None else capability
        self.servo = ServoModel(pose.chain)
        self._closed = threading.Event()
        self.mailbox = Mailbox(self.failed)
        with _quiet():
            self.server: Any = viser.ViserServer(
                host=host, port=port, label=f"redundancy: {pose.chain.name}", verbose=False
            )
        guard.watch(self.server, self._refused)
        self.refused = 0
        self._host = host
        self._set_up()
        self.notices = self.server.gui.add_html("")
        self.tabs = self.server.gui.add_tab_group()
        self.ready = False
        with self.tabs.add_tab("Pose"):
            self.pose_panel = PosePanel(self, pose)
        with self.tabs.add_tab("Path"):
            self.path_panel = PathPanel(self, path)
        with self.tabs.add_tab("Scene"):
            self.scene_panel = ScenePanel(self, scene)
        with self.tabs.add_tab("Servo"):
            self.servo_panel = ServoPanel(self, self.servo)
        with self.tabs.add_tab("Map"):
            self.map_panel = MapPanel(self, self.map)
        with self.tabs.add_tab("File"):
            self.file_panel = FilePanel(self)
        self.ready = True
        self.scene_panel.show_plan()
        if path.lines:
            self.show_configuration(path.lines[0].at(0.0))

    # --- for users ----------------------------------------------------------------------------------------

    @property
    def url(self) -> str:
        """Address of the page."""
        host = "localhost" if self._host in {"0.0.0.0", "::"} else self._host
        return f"http://{host}:{self.server.get_port()}"

    def close(self) -> None:
        """Stop serving; the servo ends, plans in progress are cancelled."""
        if self._closed.is_set():
            return
        self._closed.set()
        self.servo_panel.halt()
        self.path_panel.planner.close()
        self.mailbox.close()
        with _quiet():
            self.server.stop()

    @property
    def closed(self) -> bool:
        """Whether it was closed."""
        return self._closed.is_set()

    def state(self) -> str:
        """What a user changed, as JSON text that `load` and the page read."""
        return self.call(lambda: states.to_json(self))

    def load(self, text: str) -> None:
        """Restore what `state` returned.

        Raises:
            ValueError: No such JSON, or one of another arm; nothing is changed.
        """
        self.call(lambda: states.load(self, text))

    def picture(self, width: int = 1280, height: int = 800, seconds: float = 30.0) -> bytes:
        """A PNG of the scene as the first browser sees it, as bytes.

        Raises:
            RuntimeError: No browser has the page open.
            TimeoutError: It does not answer.
        """
        clients = list(self.server.get_clients().values())
        if not clients:
            raise RuntimeError("a picture is made by a browser that has the page open, and none has")
        return picture_bytes(clients[0], width, height, seconds)

    def picture_of(self, client: Any, seconds: float) -> bytes:
        """A PNG of the scene as one browser sees it."""
        return picture_bytes(client, client.camera.image_width, client.camera.image_height, seconds)

    def recording(self) -> str:
        """One HTML file that shows the first plan, or the arm along its self-motion, and needs no network."""
        return self.call(lambda: record(self))

    def wait(self) -> None:
        """Serve until `close` or Ctrl-C."""
        while not self._closed.wait(0.2):
            pass

    def __enter__(self) -> "View":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"View({self.url!r}, {self.pose.chain.name!r}{', closed' if self._closed.is_set() else ''})"

    # --- for the panels -----------------------------------------------------------------------------------

    def post(self, name: str, item: Callable[[], None]) -> None:
        """Do something on the explorer's thread, in order; a newer item replaces a waiting one of the same name."""
        self.mailbox.post(name, item)

    def call(self, item: Callable[[], T]) -> T:
        """Do something on the explorer's thread and wait for it; its exception is raised here."""
        if self.mailbox.own_thread or self.closed:
            return item()
        out: Future[T] = Future()

        def work() -> None:
            try:
                out.set_result(item())
            except BaseException as error:  # raised by `result`
                out.set_exception(error)

        self.post(f"call {id(out)}", work)
        return out.result()

    def settle(self, seconds: float = 10.0) -> None:
        """Wait until everything that was asked for is done, plans too.

        Raises:
            TimeoutError: It is not after that many seconds.
        """
        done = all(box.settle(seconds) for box in (self.mailbox, self.path_panel.planner, self.mailbox))
        if not done:
            raise TimeoutError(f"the explorer is still busy after {seconds} s")

    def on(self, handle: Any, name: str, action: Callable[[Any], None]) -> None:
        """Call `action` with the value of a control when a browser changes it."""

        @handle.on_update
        async def _(event: Any) -> None:
            if event.client is None:  # set by the server itself
                return
            value = event.target.value

            def act() -> None:
                self.notice("")
                action(value)

            self.post(name, act)

    def notice(self, words: str) -> None:
        """Show a message above the panels, in every browser; an empty one clears it."""
        self.notices.content = paragraph(words[:LONGEST_NOTICE], pictures.VERMILION) if words else ""

    def pose_changed(self) -> None:
        """The configuration of pose mode changed."""
        if self.ready:
            self.scene_panel.carry(self.pose.q)

    @property
    def servo_running(self) -> bool:
        """Whether the servo moves the arm."""
        return self.ready and self.servo_panel.running

    def take_the_arm(self) -> None:
        """Pose or path mode moves the arm: the servo stops."""
        if self.servo_running:
            self.servo_panel.stop()

    def show_servo(self, q: Array) -> None:
        """Draw the arm where the servo has it, and how near the obstacles are that it does not look at."""
        pose = self.pose
        pose.carry(q)
        self.pose_panel.arm.show(q, pose.shares)
        self.scene_panel.carry(q)
        ends = None
        if pose.scene is not None and len(pose.scene):
            near = pose.scene.clearance(pose.chain, q, pose.shapes)
            ends = near.on_link, near.on_obstacle
        self.nearest_line(ends)

    def show_configuration(self, q: Array) -> None:
        """Draw the arm in a configuration of a plan; pose mode follows when nothing is playing."""
        if self.servo_running:
            return
        if self.ready and not self.path_panel.play.value:
            self.pose.adopt(q)
            self.pose_panel.follow()
            self.pose_panel.push()
            return
        self.pose_panel.arm.show(q, shares(self.pose, q))
        if self.ready:
            self.scene_panel.carry(q)

    def scene_changed(self, plan: bool) -> None:
        """Other obstacles: distances change, and the path is planned again when `plan`."""
        self.pose.set_scene(self.scene.scene)
        self.pose_panel.push()
        if plan and self.path.path is not None:
            self.path_panel.plan()

    def show_everything(self) -> None:
        """Show all models anew."""
        self.map_panel.push()
        self.scene_panel.push()
        self.pose_panel.criterion.value = self.pose.criterion
        self.pose_panel.follow()
        self.pose_panel.push()

    def nearest_line(self, ends: tuple[Any, Any] | None, others: Sequence[tuple[Any, Any]] = ()) -> None:
        """Draw the shortest line between arm and obstacles, and thinner ones from other links."""
        more = np.array(others).reshape(-1, 2, 3)
        drawing.lines(self.server.scene, "/nearest_of_links", more, NEAREST, 0.0015 * self.pose.body.reach)
        rows = np.zeros((0, 2, 3)) if ends is None else np.array([ends])
        thickness = 0.004 * self.pose.body.reach
        drawing.lines(self.server.scene, "/nearest", rows, pictures.rgb(pictures.VERMILION), thickness)

    # --- inside -------------------------------------------------------------------------------------------

    def _set_up(self) -> None:
        server, reach = self.server, self.pose.body.reach
        server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(0, 114, 178))
        server.gui.main_panel.dock_right()
        server.gui.main_panel.set_width(PANEL_WIDTH)
        base = self.pose.chain.base[:3, 3]
        # Shadows and image-based light cost most of the time of a browser that draws in software.
        server.scene.configure_default_lights(cast_shadow=False)
        server.scene.configure_environment_map(None)
        server.scene.add_light_ambient("/ambient", intensity=0.8)
        ground = np.array([base[0], base[1], min(0.0, base[2])])
        drawing.grid(server.scene, "/ground", ground, reach)
        server.initial_camera.position = tuple(base + reach * np.array([0.8, 0.68, 0.62]))
        server.initial_camera.look_at = tuple(base + reach * np.array([0.1, 0.0, 0.3]))

    def _refused(self, reason: str) -> None:
        self.refused += 1
        words = f"refused: {reason} ({self.refused} so far)"
        self.post("refused", lambda: self.notice(words))

    def failed(self, error: Exception) -> None:
        """Say in the page what went wrong; what is no mistake of the user's is logged as well."""
        if not isinstance(error, ValueError | rd.RedundancyError):
            _log.exception("in the explorer", exc_info=error)
        with contextlib.suppress(Exception):  # the page may be gone
            self.notice(f"{error}" if str(error) else type(error).__name__)


def picture_bytes(client: Any, width: int, height: int, seconds: float) -> bytes:
    """A PNG of the scene from a browser."""
    pixels = client.get_render(height=height, width=width, transport_format="png", timeout=seconds)
    # Where nothing is drawn the picture is transparent: white, as in the page.
    solid = pixels[..., 3:] / 255.0
    flat = np.rint(pixels[..., :3] * solid + 255.0 * (1.0 - solid)).astype(np.uint8)
    return bytes(imageio.v3.imwrite("<bytes>", flat, extension=".png"))


def record(view: View) -> str:
    """The animation of `View.recording`."""
    arm, lines = view.pose_panel.arm, view.path.lines
    second = view.path_panel.second
    gizmos = view.pose_panel.gizmo, view.scene_panel.gizmo
    shown = [gizmo.visible for gizmo in gizmos]
    for gizmo in gizmos:  # nothing can be dragged in a recording
        gizmo.visible = False
    recorder = view.server.get_scene_serializer()
    if lines:
        count = min(int(np.ceil(view.path.duration / RECORDED_STEP)) + 1, MOST_RECORDED)
        for t in np.linspace(0.0, view.path.duration, count):
            q = lines[0].at(float(t))
            arm.show(q, shares(view.pose, q))
            if second is not None:
                other = lines[1].at(float(t))
                second.show(other, shares(view.pose, other))
            recorder.insert_sleep(view.path.duration / max(count - 1, 1))
    elif view.pose.piece is not None and view.pose.solutions.dimension == 1:
        piece = view.pose.pieces[view.pose.piece]
        for q in piece.q(np.linspace(*piece.range, SELF_MOTION_PICTURES)):
            arm.show(q, shares(view.pose, q))
            recorder.insert_sleep(RECORDED_STEP)
    else:
        recorder.insert_sleep(RECORDED_STEP)
    html = str(recorder.as_html())
    for gizmo, before in zip(gizmos, shown, strict=True):
        gizmo.visible = before
    arm.show(view.pose.q, view.pose.shares)
    return html


@contextlib.contextmanager
def _quiet() -> Any:
    """Without what viser prints when it starts and stops."""
    with contextlib.redirect_stdout(io.StringIO()):
        yield


def show_in_browser(url: str) -> None:
    """Open the page; a machine without a browser is none of our business."""
    with contextlib.suppress(webbrowser.Error):
        webbrowser.open(url)
