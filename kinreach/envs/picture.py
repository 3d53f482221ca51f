"""What a person sees of an environment: the viewer, or frames."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Protocol

from kinreach.envs.engine import mujoco
from kinreach.envs.rendering import FrameRenderer
from kinreach.envs.viewer import SceneViewer

WIDTH, HEIGHT = 640, 360
CAMERA = "overview"


class Scene(Protocol):
    """A simulation that can be drawn.

    Attributes:
        model, data: MuJoCo's model, with its good looks on, and state.
        watch: Called in the course of a motion; set by who draws.
    """

    model: Any
    data: Any

    @property
    def watch(self) -> Callable[[], object] | None:
        """Called in the course of a motion."""
        ...

    @watch.setter
    def watch(self, watch: Callable[[], object] | None) -> None: ...


class ScenePicture:
    """Frames of a simulation's scene.

    Args:
        scene: What is drawn.
        mode: `"human"`, `"rgb_array"`, `"rgb_array_list"` or `"depth_array"`.
        fps: Frames per second of simulated time, in the viewer and in a list of frames.
    """

    def __init__(self, scene: Scene, *, mode: str, fps: int) -> None:
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
        """The present frame, or the frames of the motion since the last call; None in the viewer."""
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
        """Called by the simulation in the course of a motion."""
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
        """Wait, so that the viewer runs no faster than the clock."""
        time.sleep(max(0.0, self._due - time.monotonic()))
        self._due = time.monotonic() + self._period

    def _drawer(self) -> FrameRenderer:
        if self._renderer is None:
            # without shadows, which take most of the time of a frame
            self._renderer = FrameRenderer(self._scene.model, width=WIDTH, height=HEIGHT, shadows=False)
        return self._renderer

    def _rgb(self) -> Any:
        return self._drawer().rgb(self._scene.data, CAMERA)

    def _update_viewer(self) -> None:
        mujoco.mj_forward(self._scene.model, self._scene.data)
        if self._viewer is None:
            self._viewer = SceneViewer(self._scene.model, self._scene.data, camera=CAMERA)
        self._viewer.sync()
