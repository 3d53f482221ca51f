"""A tab of the page without a browser: it receives and sends what a browser would."""

from __future__ import annotations

import contextlib
import re
import threading
import time
from collections import deque
from collections.abc import Callable
from types import TracebackType
from typing import Any

import msgspec
import numpy as np
import viser
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from kinreach._checks import Floats
from kinreach.view._page import Page
from kinreach.view._server import Server

#: Nothing of the page takes longer [s].
PATIENCE = 120.0
_CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": (1.0, 0.0, 0.0, 0.0), "position": (2.0, 0.0, 1.0), "fov": 0.8, "near": 0.01,
    "far": 100.0, "image_height": 600, "image_width": 800, "look_at": (0.0, 0.0, 0.0), "up_direction": (0.0, 0.0, 1.0),
}  # fmt: skip
#: Messages that set one property of a node of the scene -> the property.
_NODE_PROPERTIES = {
    "SetPositionMessage": "position", "SetOrientationMessage": "wxyz", "SetSceneNodeVisibilityMessage": "visible",
}  # fmt: skip


class Tab(contextlib.AbstractContextManager["Tab"]):
    """A connection of a browser.

    Args:
        server: Of the page.

    Attributes:
        page: As the server has it.
        taken: Number of messages that have arrived.
    """

    def __init__(self, server: Server) -> None:
        before = set(server.pages)
        self.taken = 0
        self._elements: dict[str, dict[str, Any]] = {}
        self._nodes: dict[str, dict[str, Any]] = {}
        self._settings: dict[str, dict[str, Any]] = {}
        self._received: deque[bytes] = deque()
        self._socket = connect(
            server.address.replace("http:", "ws:"), subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
            max_size=None, compression=None, origin=server.address,  # type: ignore[arg-type]
        )  # fmt: skip
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self.send(_CAMERA)
        try:
            wait_for(lambda: set(server.pages) - before)
        except TimeoutError:
            self._socket.close()
            raise
        (number,) = set(server.pages) - before
        self.page: Page = server.pages[number]

    @property
    def elements(self) -> dict[str, dict[str, Any]]:
        """Texts, inputs and folders of the page that have arrived, by their ids."""
        self._take_all()
        return self._elements

    @property
    def nodes(self) -> dict[str, dict[str, Any]]:
        """Nodes of the scene that have arrived, by name; arrays are flat."""
        self._take_all()
        return self._nodes

    @property
    def settings(self) -> dict[str, dict[str, Any]]:
        """The last message of each kind that is of no element or node: theme, camera, lights."""
        self._take_all()
        return self._settings

    @property
    def inputs(self) -> list[dict[str, Any]]:
        """All inputs of the page, hidden ones too."""
        return [element for element in self.elements.values() if "value" in element]

    @property
    def text(self) -> str:
        """The texts of the page that are not hidden."""
        elements = self.elements.values()
        return "\n".join(element["content"] for element in elements if "content" in element and self._shown(element))

    @property
    def part(self) -> str:
        """Name of the part of the page that is marked as shown; empty where none is."""
        marked = re.search('aria-selected="true"[^>]*>([^<]*)<', self.text)
        return marked[1] if marked else ""

    def press(self, text: str, *, does: str = "press") -> None:
        """Do what the page does when a text is pressed, or with `does="point"` when the mouse is over it."""
        wait_for(lambda: text in self.text)
        name, index = re.findall(f'data-{does}="(.*?) (\\d+)"', self.text.partition(text)[0])[-1]
        group = self.element(name)
        self.set(group, group["options"][int(index)])

    def shows(self, label: str) -> bool:
        """Whether an input or folder of a label is on the screen."""
        return self._find(label) is not None

    def element(self, label: str) -> dict[str, Any]:
        """The input or folder of a label that is on the screen, waited for.

        Raises:
            TimeoutError: There is none.
        """
        wait_for(lambda: self.shows(label))
        found = self._find(label)
        assert found is not None
        return found

    def state_at_server(self, element: dict[str, Any]) -> dict[str, Any]:
        """What the server has of an input, its `value` among it."""
        handles: Any = self.page.client.gui._gui_input_handle_from_uuid  # viser has no other way to it
        return vars(handles[element["uuid"]]._impl).copy()

    def send(self, message: dict[str, Any] | bytes | str) -> None:
        """Send a message, or what is none."""
        self._socket.send(msgspec.msgpack.encode(message) if isinstance(message, dict) else message)

    @property
    def disconnected(self) -> bool:
        """Whether the server has ended the connection."""
        return not self._reader.is_alive()

    def drag(self, name: str, position: Floats) -> None:
        """Drag the arrows of a name in the scene to a position [m]."""
        wait_for(lambda: name in self.nodes)
        node = self.nodes[name]
        place = tuple(float(value) for value in position)
        message = {"type": "TransformControlsUpdateMessage", "name": name, "wxyz": node.get("wxyz", (1.0, 0, 0, 0))}
        self.send({**message, "position": place, "owner": node["owner"]})

    def click(self, name: str, *, instance: Any) -> None:
        """Click one of the instances of a batch in the scene."""
        wait_for(lambda: name in self.nodes)
        ray = {"ray_origin": (0.0, 0.0, 1.0), "ray_direction": (0.0, 0.0, -1.0), "screen_pos": (0.5, 0.5)}
        message = {"type": "SceneNodeClickMessage", "name": name, "instance_index": instance, "modifier": None}
        self.send({**message, **ray, "owner": self.nodes[name]["owner"]})

    def set(self, what: str | dict[str, Any], value: Any) -> None:
        """Change an input, given by its label or itself; `True` clicks a button."""
        element = self.element(what) if isinstance(what, str) else what
        element["value"] = value
        self.send({"type": "GuiUpdateMessage", "uuid": element["uuid"], "updates": {"value": value}})

    def _find(self, label: str) -> dict[str, Any] | None:
        elements = self.elements.values()
        return next((e for e in elements if e.get("label") == label and self._shown(e)), None)

    def _shown(self, element: dict[str, Any] | None) -> bool:
        while element is not None and element["visible"]:
            if element["container"] == "root":
                return True
            element = self._elements.get(element["container"])
        return False

    def _read(self) -> None:
        with contextlib.suppress(ConnectionClosed):
            for data in self._socket:
                self._received.append(data if isinstance(data, bytes) else data.encode())

    def _take_all(self) -> None:
        while self._received:
            for message in _messages(self._received.popleft()):
                self._take(message)
                self.taken += 1

    def _take(self, message: dict[str, Any]) -> None:
        kind, name = message["type"], message.get("name", "")
        if kind in _NODE_PROPERTIES:
            self._nodes.setdefault(name, {})[_NODE_PROPERTIES[kind]] = message[_NODE_PROPERTIES[kind]]
        elif kind == "SceneNodeUpdateMessage":
            self._nodes[name] |= message["updates"]
        elif kind == "RemoveSceneNodeMessage":
            for node in [node for node in self._nodes if node == name or node.startswith(f"{name}/")]:
                del self._nodes[node]
        elif kind == "GuiUpdateMessage":
            self._elements[message["uuid"]] |= message["updates"]
        elif kind == "GuiModalMessage":
            own = {name: message[name] for name in ("uuid", "title")}
            self._elements[message["uuid"]] = {**own, "visible": True, "container": "root"}
        elif kind in ("GuiRemoveMessage", "GuiCloseModalMessage"):
            self._elements.pop(message["uuid"], None)
        elif "props" in message and "container_uuid" in message:
            own = {name: message[name] for name in ("uuid", "type", "value") if name in message}
            self._elements[message["uuid"]] = {**message["props"], **own, "container": message["container_uuid"]}
        elif "props" in message and name:
            self._nodes.setdefault(name, {}).update(message["props"], owner=message["owner"])
        else:
            self._settings[kind] = message

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self.page.lock:  # not while it draws
            self._socket.close()
        self._reader.join(PATIENCE)


def _messages(data: bytes) -> list[dict[str, Any]]:
    """The messages of one packet: sizes, MessagePack in zstd, then arrays that begin at multiples of 8 bytes."""
    unpacked, packed = (int.from_bytes(data[start : start + 8], "little") for start in (0, 8))
    text = zstandard.ZstdDecompressor().decompress(data[16 : 16 + packed], max_output_size=unpacked)
    content = msgspec.msgpack.decode(text)
    at, arrays = 16 + packed, []
    for length in content["binaryBufferLengths"]:
        at += -at % 8
        arrays.append(data[at : at + length])
        at += length

    def filled(value: Any) -> Any:
        if isinstance(value, list):
            return [filled(entry) for entry in value]
        if not isinstance(value, dict):
            return value
        if "__binary_index" in value:
            return np.frombuffer(arrays[value["__binary_index"]], value["dtype"])
        return {name: filled(entry) for name, entry in value.items()}

    messages: list[dict[str, Any]] = filled(content["messages"])
    return messages


def wait_for(condition: Callable[[], object], *, patience: float = PATIENCE) -> None:
    """Wait until a condition holds.

    Raises:
        TimeoutError: It does not for so many seconds.
    """
    deadline = time.monotonic() + patience
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError("the page does not answer")
        time.sleep(0.002)
