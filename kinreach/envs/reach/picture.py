"""What a person sees of an environment: the viewer, or frames."""

from __future__ import annotations

from typing import Any

import numpy as np

from kinreach.envs.rendering import FrameRenderer
from kinreach.envs.rgbd import RGBDCamera
from kinreach.envs.simulation import ArmSimulation
from kinreach.kinematics.goals import Floats

WIDTH, HEIGHT = 640, 360
CAMERA = "overview"


class ScenePicture:
    """Frames of a simulation's scene.

    Args:
        simulation: With its good looks on.
        mode: `"human"`, `"rgb_array"`, `"rgb_array_list"` or `"depth_array"`.
        fps: Frames per second of simulated time in a list of frames.
    """

    def __init__(self, simulation: ArmSimulation, *, mode: str, fps: int) -> None:
        self._simulation = simulation
        self._mode = mode
        self._period = 1.0 / fps
        self._drawer: Any = None
        self._motion: list[Any] = []
        self._next_frame = 0.0
        if mode in ("human", "rgb_array_list"):
            simulation.watch = self._moving

    def follow(self, q: Floats, goal: Floats) -> None:
        """Show the arm in posture `q` [rad], shape (6,), and the ball at `goal` [m], shape (3,)."""
        limits = self._simulation.controller
        self._simulation.reset(np.clip(q, limits.lower, limits.upper))
        self._simulation.place_ball(goal)

    def frame(self) -> Any:
        """The present frame, or the frames of the motion since the last call; None in the viewer."""
        if self._mode == "human":
            return self._update_viewer()
        if self._mode == "depth_array":
            return self._depth_camera().capture().depth
        if self._mode == "rgb_array":
            return self._rgb()
        frames, self._motion = [*self._motion, self._rgb()], []
        return frames

    def close(self) -> None:
        """Close the viewer or free the renderer."""
        if self._drawer is not None:
            self._drawer.close()
            self._drawer = None

    def _moving(self) -> None:
        """Called by the simulation in every control period."""
        time = self._simulation.data.time
        if time < self._next_frame - self._period:  # the simulation was reset
            self._next_frame = 0.0
        if time >= self._next_frame:
            self._next_frame = time + self._period
            if self._mode == "human":
                self._update_viewer()
            else:
                self._motion.append(self._rgb())

    def _rgb(self) -> Any:
        if self._drawer is None:
            # without shadows, which take most of the time of a frame
            self._drawer = FrameRenderer(self._simulation.model, width=WIDTH, height=HEIGHT, shadows=False)
        return self._drawer.rgb(self._simulation.data, CAMERA)

    def _depth_camera(self) -> Any:
        if self._drawer is None:
            self._drawer = RGBDCamera(self._simulation, CAMERA, width=WIDTH, height=HEIGHT)
        return self._drawer

    def _update_viewer(self) -> None:
        import mujoco.viewer  # a window is opened here and nowhere else

        if self._drawer is None:
            self._drawer = mujoco.viewer.launch_passive(self._simulation.model, self._simulation.data)
        mujoco.mj_forward(self._simulation.model, self._simulation.data)
        self._drawer.sync()
