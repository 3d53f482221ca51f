"""Cameras: the pinhole model, and RGB-D pictures of a simulation.

Camera frame (the optical convention of OpenCV and ROS): origin in the optical centre, x to the picture's right, y
down, z forward along the optical axis; metres. MuJoCo's own camera frame (x right, y up, z backward) is turned from it
by half a turn about x. Pixel coordinates (u, v) are column and row, whole numbers at the *centres* of pixels: the upper
left pixel covers u and v from -0.5 to 0.5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import MAX_DISTANCE, Floats, as_floats, check_count, check_entries, check_number, shown
from kinreach.errors import InputError
from kinreach.sim import ArmSimulation
from kinreach.sim.inside import FrameRenderer, camera_id, mujoco

#: Largest width and height of a picture [pixels].
MAX_PIXELS = 2**16
#: Bounds of focal lengths, and of how far from the upper left pixel the optical axis may be [pixels].
MIN_FOCAL_LENGTH, MAX_LENGTH = 1e-6, 1e9
#: From the optical frame to the frame that MuJoCo and OpenGL give a camera.
OPTICAL_IN_GL: Floats = np.diag([1.0, -1.0, -1.0])
#: Largest factor of an exposure: of 255 levels hardly one is left.
MAX_EXPOSURE = 100.0


@dataclass(frozen=True)
class Intrinsics:
    """Pinhole model of a camera.

    Attributes:
        width, height: Size of the picture [pixels].
        fx, fy: Focal length in pixels along u and v.
        cx, cy: Pixel coordinates of the optical axis.

    Raises:
        InputError: A value out of range.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            check_count(name, getattr(self, name), most=MAX_PIXELS)
        for name in ("fx", "fy"):
            check_number(name, getattr(self, name), least=MIN_FOCAL_LENGTH, most=MAX_LENGTH)
        for name in ("cx", "cy"):
            check_number(name, getattr(self, name), least=-MAX_LENGTH, most=MAX_LENGTH)

    @classmethod
    def from_fovy(cls, fovy: float, width: int, height: int) -> Intrinsics:
        """Make a camera with square pixels and the optical axis in the middle, as MuJoCo's.

        Args:
            fovy: Vertical field of view [degrees].
            width: Of the picture [pixels].
            height: Of the picture [pixels].

        Raises:
            InputError: The field of view is not above 0 and at most 179.9 degrees, or the picture is empty.
        """
        fovy = check_number("fovy", fovy, above=0.0, most=179.9)
        width, height = (check_count("width", width, most=MAX_PIXELS), check_count("height", height, most=MAX_PIXELS))
        f = height / 2 / math.tan(math.radians(fovy) / 2)
        return cls(width, height, f, f, (width - 1) / 2, (height - 1) / 2)

    def project(self, p_camera: ArrayLike) -> Floats:
        """Project points; return pixel coordinates (u, v), shape (..., 2).

        Args:
            p_camera: Points in the camera frame [m], shape (..., 3), in front of the camera.

        Raises:
            InputError: Wrong shape, or a point that is not in front of the camera (z > 0), or farther than any.
        """
        p = as_floats("p_camera", p_camera)
        if p.ndim == 0 or p.shape[-1] != 3:
            raise InputError(f"p_camera must have shape (..., 3), got {p.shape}")
        check_entries("p_camera", p, MAX_DISTANCE)
        if not (p[..., 2] >= 1e-6).all():
            raise InputError(
                f"points to project must be in front of the camera, z > 0; got z = {p[..., 2].min():.6g} m"
            )
        return p[..., :2] / p[..., 2:] * (self.fx, self.fy) + (self.cx, self.cy)

    def deproject(self, u: ArrayLike, v: ArrayLike, depth: ArrayLike) -> Floats:
        """Return points in the camera frame [m], shape (..., 3), of pixels and their depths; inverse of `project`.

        Args:
            u: Column; may be between pixels. All three shapes broadcast together.
            v: Row.
            depth: Distance along the optical axis [m], not along the ray. Where it is not finite, as in pictures where
                nothing was measured, the point is not either.

        Raises:
            InputError: No numbers, pixels that are not finite, or shapes that do not fit together.
        """
        columns, rows, z = as_floats("u", u), as_floats("v", v), as_floats("depth", depth)
        try:
            columns, rows, z = np.broadcast_arrays(columns, rows, z)
        except ValueError:
            raise InputError(
                f"u, v and depth must fit together, got the shapes {columns.shape}, {rows.shape} and {z.shape}"
            ) from None
        check_entries("u", columns, MAX_LENGTH)
        check_entries("v", rows, MAX_LENGTH)
        with np.errstate(over="ignore", invalid="ignore"):
            return np.stack([(columns - self.cx) / self.fx * z, (rows - self.cy) / self.fy * z, z], axis=-1)


@dataclass(frozen=True, eq=False)
class RGBDImage:
    """An RGB-D picture.

    Attributes:
        rgb: Colours, uint8, shape (height, width, 3).
        depth: Distance along the optical axis [m], float32, shape (height, width).
    """

    rgb: NDArray[np.uint8]
    depth: NDArray[np.float32]


@dataclass(frozen=True)
class SensorNoise:
    """Normal noise of a sensor, independent from pixel to pixel, and random exposure.

    Attributes:
        rgb_sigma: Of each colour channel [levels of 255].
        depth_sigma: Of the depth [m].
        exposure: Largest factor by which a picture's colours are brighter or darker than the scene's. The factor of a
            picture is drawn from 1/exposure to exposure, uniformly in its logarithm.

    Raises:
        InputError: A sigma is negative, above 1000, or not a number; or an exposure below 1 or above 100.
    """

    rgb_sigma: float = 0.0
    depth_sigma: float = 0.0
    exposure: float = 1.0

    def __post_init__(self) -> None:
        for name in ("rgb_sigma", "depth_sigma"):
            check_number(name, getattr(self, name), least=0.0, most=1e3)  # far more than leaves a picture
        check_number("exposure", self.exposure, least=1.0, most=MAX_EXPOSURE)

    def apply(self, image: RGBDImage, rng: np.random.Generator) -> RGBDImage:
        """Add noise to a picture; colours are rounded and kept in 0 … 255, depths at or above 0."""
        rgb, depth = image.rgb, image.depth
        if self.exposure > 1:
            factor = np.float32(self.exposure ** rng.uniform(-1.0, 1.0))
            rgb = np.rint(factor * rgb).clip(0, 255).astype(np.uint8)
        if self.rgb_sigma > 0:
            noisy = rgb + np.float32(self.rgb_sigma) * rng.standard_normal(rgb.shape, dtype=np.float32)
            rgb = np.rint(noisy).clip(0, 255).astype(np.uint8)
        if self.depth_sigma > 0:
            noise = np.float32(self.depth_sigma) * rng.standard_normal(depth.shape, dtype=np.float32)
            depth = np.maximum(depth + noise, np.float32(0.0))
        return RGBDImage(rgb, depth)


def check_noise(noise: Any) -> None:
    if noise is not None and not isinstance(noise, SensorNoise):
        raise InputError(f"noise must be a SensorNoise or None, got {shown(noise)}")


class RGBDCamera:
    """A camera of the scene; to be closed, or used as a context manager.

    The graphics library is loaded with the first picture.

    Args:
        simulation: The scene, in its current state.
        name: Of one of the arm's cameras.
        width, height: Size of the pictures [pixels].
        renderer: Draws for this camera and others of the same scene and size, and is closed by its maker. By
            default the camera makes its own with the first picture, which takes 0.4 s.

    Attributes:
        simulation, name: As given.
        intrinsics: Focal lengths and optical axis [pixels].

    Raises:
        UnknownNameError: Unknown camera.
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
        """Pose of the camera's optical frame (x right, y down, z forward) in the world now, shape (4, 4)."""
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
            InputError: Noise that is not a `SensorNoise`, or without a generator, or a picture larger than the scene's
                off-screen buffer.
            InstallationError: No OpenGL library works; the message names the packages.
        """
        check_noise(noise)
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

    def __exit__(self, *_: object) -> None:
        self.close()
