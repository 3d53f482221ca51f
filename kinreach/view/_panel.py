"""The base of the parts of the page: a folder of inputs and a branch of the scene, shown or hidden together."""

from __future__ import annotations

from threading import RLock
from typing import Any

from kinreach.view._draw import Surroundings
from kinreach.view._inputs import Latest
from kinreach.view._setup import Setup


class Panel:
    """One part of one tab's page; empty until it is built.

    Args:
        client: viser's handle of the tab.
        surroundings: Boxes that turn red; hidden if a part has its own.
        lock: Held while the scene changes.
        title: Of its branch of the scene.
    """

    def __init__(self, client: Any, setup: Setup, surroundings: Surroundings, lock: RLock, *, title: str) -> None:
        self._client, self._setup, self._surroundings, self._lock = client, setup, surroundings, lock
        self._root = f"/{title.lower().replace(' ', '_')}"
        self._branch = client.scene.add_frame(self._root, show_axes=False)
        self._latest = Latest(lock)
        self._folder = client.gui.add_folder(None)

    def build(self) -> None:
        """Add the inputs, and draw the initial state."""

    def show(self, visible: bool) -> None:
        """Show or hide its inputs and its branch of the scene."""
        with self._lock:
            self._branch.visible = self._folder.visible = visible
            if not visible:
                self._surroundings.mark(())

    def program(self) -> str:
        """Write Python code for what is on the screen."""
        return "# Nothing is shown.\n"

    def close(self) -> None:
        self._latest.end()

    def remove(self) -> None:
        self._latest.end()
        self._folder.remove()
        self._branch.remove()
