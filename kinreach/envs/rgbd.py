"""RGB-D cameras of a simulation: colour and depth pictures, and where the camera is.

The camera frame is the optical one of `kinreach.envs.pinhole`: x right, y down, z forward. MuJoCo's own camera frame
(x right, y up, z backward) is turned by half a turn about x.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from kinreach.envs.engine import mujoco
from kinreach.envs.pinhole import Intrinsics
from kinreach.envs.rendering import FrameRenderer, camera_id
from kinreach.envs.simulation import ArmSimulation
from kinreach.errors import InputError
from kinreach.inputs import check_number
from kinreach.kinematics.goals import Floats

#: From the optical frame to the frame that MuJoCo and OpenGL give a camera.
OPTICAL_IN_GL: Floats = np.diag([1.0, -1.0, -1.0])
#: Largest standard deviation of a sensor's noise, in the unit of either picture: far more than leaves a picture.
MOST_SIGMA = 1e3


@dataclass(frozen=True, eq=False)
class RGBDImage:
    """What a camera saw.

    Attributes:
        rgb: Colours, uint8, shape (height, width, 3).
        depth: Distance along the optical axis [m], float32, shape (height, width).
    """

    rgb: NDArray[np.uint8]
    depth: NDArray[np.float32]


@dataclass(frozen=True)
class SensorNoise:
    """Normal noise of a sensor, independent from pixel to pixel.

    Attributes:
        rgb_sigma: Of each colour channel [levels of 255].
        depth_sigma: Of the depth [m].

    Raises:
        InputError: A sigma is negative, above 1000, or no number.
    """

    rgb_sigma: float = 0.0
    depth_sigma: float = 0.0

    def __post_init__(self) -> None:
        for name in ("rgb_sigma", "depth_sigma"):
            check_number(name, getattr(self, name), least=0.0, most=MOST_SIGMA)

    def apply(self, image: RGBDImage, rng: np.random.Generator) -> RGBDImage:
        """The picture with noise; colours are rounded and kept in 0 … 255, depths at or above 0."""
        rgb, depth = image.rgb, image.depth
        if self.rgb_sigma > 0:
            noisy = rgb + np.float32(self.rgb_sigma) * rng.standard_normal(rgb.shape, dtype=np.float32)
            rgb = np.rint(noisy).clip(0, 255).astype(np.uint8)
        if self.depth_sigma > 0:
            noise = np.float32(self.depth_sigma) * rng.standard_normal(depth.shape, dtype=np.float32)
            depth = np.maximum(depth + noise, np.float32(0.0))
        return RGBDImage(rgb, depth)


class RGBDCamera:
    """A camera of the scene; to be closed, or used as a context manager.

    It loads no graphics library before its first picture.

    Args:
        simulation: What it looks at, always in the current state.
        name: Of one of the arm's cameras.
        width, height: Size of the pictures [pixels].
        renderer: Draws for this camera and others of the same scene and size, and is closed by whoever made it. By
            default the camera makes its own with the first picture, which takes 0.4 s.

    Attributes:
        simulation, name: As given.
        intrinsics: Focal lengths and optical axis [pixels].

    Raises:
        UnknownNameError: There is no such camera; the message lists those there are.
        InputError: The renderer draws another scene or another size.
    """

    def __init__(
        self,
        simulation: ArmSimulation,
        name: str,
        *,
        width: int = 640,
        height: int = 360,
        renderer: FrameRenderer | None = None,
    ) -> None:
        model = simulation.model
        self._id = camera_id(model, name)
        if renderer is not None and (
            renderer.model is not model or (renderer.width, renderer.height) != (width, height)
        ):
            raise InputError(
                f"the renderer must draw the simulation's own scene at {width}x{height}, "
                f"got one of {renderer.width}x{renderer.height}"
            )
        self.simulation = simulation
        self.name = name
        self.intrinsics = Intrinsics.from_fovy(float(model.cam_fovy[self._id]), width, height)
        self._shared = renderer
        self._own: FrameRenderer | None = None

    @property
    def T_world_camera(self) -> Floats:
        """Pose of the camera frame (optical: x right, y down, z forward) in the world now, shape (4, 4)."""
        model, data = self.simulation.model, self.simulation.data
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        T = np.eye(4)
        T[:3, :3] = data.cam_xmat[self._id].reshape(3, 3) @ OPTICAL_IN_GL
        T[:3, 3] = data.cam_xpos[self._id]
        return T

    def capture(self, *, noise: SensorNoise | None = None, rng: np.random.Generator | None = None) -> RGBDImage:
        """Take a picture, without shadows.

        Args:
            noise: Of the sensor; none by default.
            rng: Draws the noise; the same generator state gives the same picture.

        Raises:
            InputError: Noise without a generator, or a picture larger than the scene's off-screen buffer.
            InstallationError: There is no library to draw with; the message names the packages.
        """
        if noise is not None and rng is None:
            raise InputError("sensor noise needs a numpy Generator: capture(noise=..., rng=...)")
        renderer, data = self._renderer(), self.simulation.data
        image = RGBDImage(renderer.rgb(data, self.name), renderer.depth(data, self.name))
        return image if noise is None or rng is None else noise.apply(image, rng)

    def _renderer(self) -> FrameRenderer:
        if self._shared is not None:
            return self._shared
        if self._own is None:
            k = self.intrinsics
            self._own = FrameRenderer(self.simulation.model, width=k.width, height=k.height, shadows=False)
        return self._own

    def close(self) -> None:
        """Free the graphics memory that is the camera's own; the next picture would ask for it again."""
        if self._own is not None:
            self._own.close()
            self._own = None

    def __enter__(self) -> RGBDCamera:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
