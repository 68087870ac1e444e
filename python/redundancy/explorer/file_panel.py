"""Pictures, recordings and the state."""

from typing import TYPE_CHECKING, Any

from redundancy.explorer import state
from redundancy.explorer.pose_panel import block

if TYPE_CHECKING:
    from redundancy.explorer.view import View

PICTURE_SECONDS = 30.0
"""How long a browser may take for a picture, s."""


class FilePanel:
    """Buttons that save and open.

    Args:
        view: The page.
    """

    def __init__(self, view: "View") -> None:
        self.view = view
        gui = view.server.gui
        gui.add_html(block("Files are made on this machine and downloaded by your browser."))
        self.picture = gui.add_button("picture (PNG)")
        self.recording = gui.add_button("recording (HTML)", hint="The plan, or the slider's way, as one file")
        self.save = gui.add_button("save the state (JSON)")
        self.open = gui.add_upload_button("open a state (JSON)", mime_type="application/json")
        self._listen()

    def _listen(self) -> None:
        view = self.view

        @self.picture.on_click
        def _(event: Any) -> None:  # on a thread of viser's: it waits for the browser
            if event.client is None:
                return
            try:
                content = view.picture_of(event.client, PICTURE_SECONDS)
            except Exception as error:  # shown in the page
                view.failed(error)
                return
            event.client.send_file_download("explorer.png", content, save_immediately=True)

        @self.recording.on_click
        async def _(event: Any) -> None:
            client = event.client
            view.post(
                "recording",
                lambda: client.send_file_download(
                    "explorer.html", view.recording().encode(), save_immediately=True
                ),
            )

        @self.save.on_click
        async def _(event: Any) -> None:
            client = event.client
            view.post(
                "save",
                lambda: client.send_file_download(
                    "explorer.json", state.to_json(view).encode(), save_immediately=True
                ),
            )

        @self.open.on_upload
        async def _(event: Any) -> None:
            content = event.target.value.content
            view.post("open", lambda: state.load(view, content.decode(errors="replace")))
