"""MuJoCo's viewer: a window on a scene, in which a person can turn the view."""

from __future__ import annotations

import importlib
import math
import platform
import threading
from typing import Any

import numpy as np

from kinreach.errors import InstallationError

#: How long a window may take to close [s].
CLOSING = 5.0


class SceneViewer:
    """A window on a simulation; to be closed.

    Args:
        model: A scene (`mujoco.MjModel`).
        data: Its state, which `sync` shows.
        camera: From where the scene is looked at in the beginning, the name of one of its cameras.

    Raises:
        InstallationError: There is no screen, or no library to open a window with.
    """

    def __init__(self, model: Any, data: Any, *, camera: str) -> None:
        _check_screen()
        others = set(threading.enumerate())
        viewer = importlib.import_module("mujoco.viewer")
        self._handle = viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=False)
        self._threads = [thread for thread in threading.enumerate() if thread not in others]
        fixed = data.camera(camera)
        ahead = -fixed.xmat.reshape(3, 3)[:, 2]
        with self._handle.lock():
            view = self._handle.cam
            view.distance = float((model.stat.center - fixed.xpos) @ ahead)
            view.lookat[:] = fixed.xpos + view.distance * ahead
            view.azimuth = math.degrees(math.atan2(ahead[1], ahead[0]))
            view.elevation = math.degrees(math.asin(np.clip(ahead[2], -1.0, 1.0)))
        self.sync()

    def sync(self) -> None:
        """Show the present state; does nothing once the window was closed."""
        self._handle.sync()

    def close(self) -> None:
        """Close the window; further calls do nothing."""
        self._handle.close()
        for thread in self._threads:  # a thread that still draws when the interpreter ends takes it down
            thread.join(CLOSING)


def _check_screen() -> None:
    """Say now that no window can be opened: MuJoCo's own thread would die of it, and its caller wait for ever."""
    if platform.system() != "Linux":
        return
    try:
        glfw = importlib.import_module("glfw")
    except ImportError as error:
        reason = str(error)
    else:
        said: list[str] = []

        def note(code: int, what: bytes) -> None:
            said.append(f"({code}) {what.decode(errors='replace')}")

        before = glfw.set_error_callback(note)  # by default it warns, and warnings are caught for all threads or none
        try:
            if glfw.init():
                return
        finally:
            glfw.set_error_callback(before)
        reason = "; ".join(said)
    raise InstallationError(
        f'cannot open a window: {reason}. Without a screen use render_mode="rgb_array", or a virtual screen: '
        "apt install xvfb, then xvfb-run python ..."
    )
