"""How soon the page answers, and what open and closed tabs leave behind: `python -m benchmarks.studies.page`.

No browser: a connection that says what a browser says, so that what is measured is the server. Printed are, for the
nominal and the calibrated UR5, the times from the message of a dragged target to the answer's being on its way, with
all postures; then memory and threads of the server after tabs that were opened, used and closed.

Options: `--drags N`, `--tabs N`.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

import msgspec
import viser
from websockets.sync.client import connect

from kinreach.checks import Floats
from kinreach.view.page import Page
from kinreach.view.server import Server

#: Nothing of the page takes longer [s].
PATIENCE = 120.0
_CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": (1.0, 0.0, 0.0, 0.0), "position": (2.0, 0.0, 1.0), "fov": 0.8, "near": 0.01,
    "far": 100.0, "image_height": 600, "image_width": 800, "look_at": (0.0, 0.0, 0.0), "up_direction": (0.0, 0.0, 1.0),
}  # fmt: skip


class Tab(contextlib.AbstractContextManager["Tab"]):
    """A tab without a browser: connects, says what a browser says, and takes what comes.

    Args:
        server: Of the page.

    Attributes:
        page: As the server has it.
    """

    def __init__(self, server: Server) -> None:
        before = set(server.pages)
        self._socket = connect(
            server.address.replace("http:", "ws:"), subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
            max_size=None, compression=None,
        )  # fmt: skip
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self.send(_CAMERA)
        wait_for(lambda: set(server.pages) - before)
        (number,) = set(server.pages) - before
        self.page: Page = server.pages[number]

    def send(self, message: dict[str, Any]) -> None:
        """Say something to the server."""
        self._socket.send(msgspec.msgpack.encode(message))

    def drag(self, handle: Any, position: Floats) -> None:
        """Drag arrows of the scene to a position [m]."""
        w, x, y, z = (float(value) for value in handle.wxyz)
        place = tuple(float(value) for value in position)
        message = {"type": "TransformControlsUpdateMessage", "name": handle.name, "wxyz": (w, x, y, z)}
        self.send({**message, "position": place, "owner": handle._impl.api._owner_id})

    def click(self, handle: Any, *, instance: int) -> None:
        """Click one of the instances of a batch in the scene."""
        ray = {"ray_origin": (0.0, 0.0, 1.0), "ray_direction": (0.0, 0.0, -1.0), "screen_pos": (0.5, 0.5)}
        message = {"type": "SceneNodeClickMessage", "name": handle.name, "instance_index": instance, "modifier": None}
        self.send({**message, **ray, "owner": handle._impl.api._owner_id})

    def set(self, handle: Any, value: Any) -> None:
        """Change an input, or click a button with `True`."""
        self.send({"type": "GuiUpdateMessage", "uuid": handle._impl.uuid, "updates": {"value": value}})

    def _read(self) -> None:
        for _ in self._socket:
            pass

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self.page.lock:  # not while it draws
            self._socket.close()
        self._reader.join(PATIENCE)


def wait_for(condition: Callable[[], object]) -> None:
    """Until something holds.

    Raises:
        TimeoutError: It does not for `PATIENCE`.
    """
    deadline = time.monotonic() + PATIENCE
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError("the page does not answer")
        time.sleep(0.002)
