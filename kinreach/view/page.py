"""The page of one browser tab: what the user does goes to the models, what they answer is drawn."""

from __future__ import annotations

import threading
from html import escape
from typing import Any

import numpy as np

from kinreach.view import html
from kinreach.view.draw import Surroundings
from kinreach.view.setup import Setup
from kinreach.view.target_panel import TargetPanel

#: How far the scene is moved to the side, by its distance.
ASIDE = 0.13
#: Pixels of a screenshot.
WIDTH, HEIGHT = 1600, 1000


class Page:
    """One tab. Nothing in it is shared with another.

    Args:
        client: viser's handle of the tab.
        setup: What the command line asked for.
    """

    def __init__(self, client: Any, setup: Setup) -> None:
        self._client = client
        self.lock = threading.RLock()
        overview = next((mount for mount in setup.arm.cameras if mount.name == "overview"), None)
        if overview is not None:
            position, target = np.array(overview.position), np.array(overview.target)
            aside = ASIDE * np.cross(target - position, (0.0, 0.0, 1.0))  # to the left of the panel
            client.camera.position, client.camera.look_at = position + aside, target + aside
            client.camera.fov = np.radians(overview.fovy)
        client.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        client.gui.add_html(html.block(f"<b>{escape(setup.arm.title)}</b>"))
        surroundings = Surroundings(client.scene, setup.arm.workcell.obstacles)
        self.target = TargetPanel(client, setup, surroundings, self.lock)
        self._buttons()

    def _buttons(self) -> None:
        gui = self._client.gui
        take = gui.add_button("Screenshot", icon="camera", hint="Save the scene as a PNG")
        copy = gui.add_button("Copy as Python", icon="code", hint="The program that reproduces what is on the screen")

        take.on_click(lambda _: self.screenshot())
        copy.on_click(lambda _: self.show_program())

    def show_program(self) -> None:
        """Open a window with the program that reproduces what is on the screen."""
        gui = self._client.gui
        with gui.add_modal("What is on the screen, as a program", size="xl") as modal:
            gui.add_html(html.code(self.target.program()))
            close = gui.add_button("Close")
        close.on_click(lambda _: modal.close())

    def picture(self, height: int, width: int) -> Any:
        """The scene as the browser draws it, RGBA, shape (height, width, 4)."""
        return self._client.get_render(height, width, transport_format="png", timeout=60.0)

    def screenshot(self) -> None:
        """Send the scene to the browser as a PNG file."""
        import cv2

        picture = self.picture(HEIGHT, WIDTH)
        _, data = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGBA2BGRA))
        self._client.send_file_download("kinreach.png", data.tobytes())
