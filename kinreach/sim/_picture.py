"""Draw a simulation: in MuJoCo's viewer, or as frames."""

from __future__ import annotations

import importlib
import platform
import threading
import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from kinreach._checks import Floats
from kinreach.errors import InstallationError
from kinreach.sim._engine import mujoco
from kinreach.sim._rendering import FrameRenderer, Viewpoint, aim, camera_id

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

    def __init__(self, model: Any, data: Any, *, camera: Viewpoint) -> None:
        _check_screen()
        others = set(threading.enumerate())
        viewer = importlib.import_module("mujoco.viewer")
        self._handle = viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=False)
        self._threads = [thread for thread in threading.enumerate() if thread not in others]
        if isinstance(camera, str):
            place, target = data.camera(camera).xpos, _middle(model, data, camera)
        else:
            place, target = np.array(camera[:3]), np.array(camera[3:])
        with self._handle.lock():
            aim(self._handle.cam, place, target)
        self.sync()

    def sync(self) -> None:
        """Show the present state; does nothing once the window was closed."""
        self._handle.sync()

    def close(self) -> None:
        """Close the window; further calls do nothing."""
        self._handle.close()
        for thread in self._threads:  # one that still draws when the interpreter ends makes it crash
            thread.join(CLOSING)


def _middle(model: Any, data: Any, camera: str) -> Floats:
    """Return the point ahead of a camera that is as far as the middle of the scene [m], shape (3,)."""
    fixed = data.camera(camera)
    ahead = -fixed.xmat.reshape(3, 3)[:, 2]
    return np.asarray(fixed.xpos + ((model.stat.center - fixed.xpos) @ ahead) * ahead)


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

    Args:
        scene: What is drawn.
        mode: As Gymnasium's environments have it: "human", "rgb_array", "rgb_array_list" or "depth_array".
        fps: Frames a second of a motion.
        camera: Its name; its place [m], three numbers, from which it looks at the middle of the scene; or, with three
            more, its place and what it looks at.
        size: Width and height of a frame [pixels].

    Attributes:
        size: As given; to be set before the first frame.
        drawn: Called with the scene after each colour frame.

    Raises:
        UnknownNameError: Unknown camera.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        mode: str,
        fps: int = FPS,
        camera: Viewpoint = CAMERA,
        size: tuple[int, int] = (WIDTH, HEIGHT),
    ) -> None:
        self.size = size
        self.drawn: Callable[[Scene], object] | None = None
        self._camera = camera
        self._mode = mode
        self._period = 1.0 / fps
        self._renderer: FrameRenderer | None = None
        self._viewer: SceneViewer | None = None
        self._due = 0.0
        self._motion: list[Any] = []
        self._next_frame = 0.0
        self._drawn_at: float | None = None
        self._scene = scene
        self._watch()

    def show(self, scene: Scene) -> None:
        """Draw this scene from now on."""
        if scene is not self._scene:
            self.close()
            self._scene = scene
            self._watch()

    def _watch(self) -> None:
        if isinstance(self._camera, str):
            camera_id(self._scene.model, self._camera)
        if self._mode in ("human", "rgb_array_list"):
            self._scene.watch = self._moving

    def _view(self) -> Viewpoint:
        if isinstance(self._camera, str) or len(self._camera) == 6:
            return self._camera
        model, data = self._scene.model, self._scene.data
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        return [*self._camera, *_middle(model, data, CAMERA)]

    def frame(self) -> Any:
        """Draw the present frame, or return those of the motion since the last call; None in the viewer."""
        if self._mode == "human":
            return self._update_viewer()
        if self._mode == "depth_array":
            return self._drawer().depth(self._scene.data, self._view())
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
        frame = self._drawer().rgb(self._scene.data, self._view())
        if self.drawn is not None:
            self.drawn(self._scene)
        return frame

    def _update_viewer(self) -> None:
        mujoco.mj_forward(self._scene.model, self._scene.data)
        if self._viewer is None:
            self._viewer = SceneViewer(self._scene.model, self._scene.data, camera=self._view())
        self._viewer.sync()
