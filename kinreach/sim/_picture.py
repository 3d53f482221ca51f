"""Draw a simulation: in MuJoCo's viewer, or as frames."""

from __future__ import annotations

import importlib
import math
import platform
import threading
import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from kinreach.errors import InstallationError
from kinreach.sim._engine import mujoco
from kinreach.sim._rendering import FrameRenderer

#: Size of a frame [pixels], and the camera that a person looks through.
WIDTH, HEIGHT = 640, 360
CAMERA = "overview"
#: Frames per second of simulated time.
FPS = 25
#: How long a window may take to close [s].
CLOSING = 5.0


class SceneViewer:
    """A window on a simulation; to be closed.

    Raises:
        InstallationError: No screen, or no library that opens a window.
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
        for thread in self._threads:  # one that still draws when the interpreter ends makes it crash
            thread.join(CLOSING)


def _check_screen() -> None:
    """Raise if no window can be opened: MuJoCo's own thread would end, and its caller wait forever."""
    if platform.system() != "Linux":
        return
    try:
        glfw = importlib.import_module("glfw")
    except ImportError as error:
        reason = str(error)
    else:
        errors: list[str] = []

        def note(code: int, what: bytes) -> None:
            errors.append(f"({code}) {what.decode(errors='replace')}")

        before = glfw.set_error_callback(note)  # by default it warns, and warnings are caught for all threads or none
        try:
            if glfw.init():
                return
        finally:
            glfw.set_error_callback(before)
        reason = "; ".join(errors)
    raise InstallationError(
        f'cannot open a window: {reason}. Without a screen use render_mode="rgb_array", or a virtual screen: '
        "apt install xvfb, then xvfb-run python ..."
    )


class Scene(Protocol):
    """A simulation that can be drawn.

    Attributes:
        model, data: MuJoCo's model, with visuals, and state.
        watch: Called in the course of a motion, to draw it.
    """

    model: Any
    data: Any
    watch: Callable[[], object] | None


class ScenePicture:
    """Frames of a simulation's scene.

    Attributes:
        size: Width and height of a frame [pixels]; to be set before the first one.
        drawn: Called with the scene after each colour frame.
    """

    def __init__(self, scene: Scene, *, mode: str, fps: int = FPS) -> None:
        self.size = (WIDTH, HEIGHT)
        self.drawn: Callable[[Scene], object] | None = None
        self._scene = scene
        self._mode = mode
        self._period = 1.0 / fps
        self._renderer: FrameRenderer | None = None
        self._viewer: SceneViewer | None = None
        self._due = 0.0
        self._motion: list[Any] = []
        self._next_frame = 0.0
        self._drawn_at: float | None = None
        if mode in ("human", "rgb_array_list"):
            scene.watch = self._moving

    def frame(self) -> Any:
        """Draw the present frame, or return those of the motion since the last call; None in the viewer."""
        if self._mode == "human":
            return self._update_viewer()
        if self._mode == "depth_array":
            return self._drawer().depth(self._scene.data, CAMERA)
        if self._mode == "rgb_array":
            return self._rgb()
        frames, self._motion = self._motion, []
        if not frames or self._drawn_at != self._scene.data.time:  # else the last one is the present one
            frames.append(self._rgb())
        return frames

    def close(self) -> None:
        """Close the viewer or free the renderer."""
        for drawer in (self._renderer, self._viewer):
            if drawer is not None:
                drawer.close()
        self._renderer = self._viewer = None

    def _moving(self) -> None:
        now = self._scene.data.time
        if now < self._next_frame - self._period:  # the simulation was reset
            self._next_frame = 0.0
        if now >= self._next_frame:
            self._next_frame = now + self._period
            if self._mode == "human":
                self._keep_pace()
                self._update_viewer()
            else:
                self._motion.append(self._rgb())
                self._drawn_at = now

    def _keep_pace(self) -> None:
        """Wait, so that the viewer does not run faster than the clock."""
        time.sleep(max(0.0, self._due - time.monotonic()))
        self._due = time.monotonic() + self._period

    def _drawer(self) -> FrameRenderer:
        if self._renderer is None:
            # without shadows, which take most of the time of a frame
            width, height = self.size
            self._renderer = FrameRenderer(self._scene.model, width=width, height=height, shadows=False)
        return self._renderer

    def _rgb(self) -> Any:
        frame = self._drawer().rgb(self._scene.data, CAMERA)
        if self.drawn is not None:
            self.drawn(self._scene)
        return frame

    def _update_viewer(self) -> None:
        mujoco.mj_forward(self._scene.model, self._scene.data)
        if self._viewer is None:
            self._viewer = SceneViewer(self._scene.model, self._scene.data, camera=CAMERA)
        self._viewer.sync()
