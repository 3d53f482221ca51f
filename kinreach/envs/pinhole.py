"""The pinhole model of a camera: points in its frame to pixels, and pixels with their depth back to points.

Camera frame (the optical convention of OpenCV and ROS): origin in the optical centre, x to the picture's right, y
down, z forward along the optical axis; metres. Pixel coordinates (u, v) are column and row, whole numbers at the
*centres* of pixels: the upper left pixel covers u and v from -0.5 to 0.5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kinreach.errors import InputError
from kinreach.kinematics.goals import Floats, as_floats


@dataclass(frozen=True)
class Intrinsics:
    """What a camera does to points in its own frame.

    Attributes:
        width, height: Size of the picture [pixels].
        fx, fy: Focal length in pixels along u and v.
        cx, cy: Pixel coordinates of the optical axis.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    @classmethod
    def from_fovy(cls, fovy: float, width: int, height: int) -> Intrinsics:
        """A camera with square pixels and the optical axis in the middle, as MuJoCo's are.

        Args:
            fovy: Vertical field of view [degrees].
            width: Of the picture [pixels].
            height: Of the picture [pixels].

        Raises:
            InputError: The field of view is not between 0 and 180 degrees, or the picture is empty.
        """
        if not 0 < fovy < 180 or width < 1 or height < 1:
            raise InputError(f"a camera needs 0 < fovy < 180 and a picture, got {fovy} degrees, {width}x{height}")
        f = height / 2 / math.tan(math.radians(fovy) / 2)
        return cls(width, height, f, f, (width - 1) / 2, (height - 1) / 2)

    def project(self, p_camera: ArrayLike) -> Floats:
        """Pixel coordinates of points, shape (..., 2) as (u, v).

        Args:
            p_camera: Points in the camera frame [m], shape (..., 3), in front of the camera.

        Raises:
            InputError: Wrong shape, or a point that is not in front of the camera (z > 0).
        """
        p = as_floats("p_camera", p_camera)
        if p.ndim == 0 or p.shape[-1] != 3:
            raise InputError(f"p_camera must have shape (..., 3), got {p.shape}")
        if not (p[..., 2] > 0).all():
            raise InputError(
                f"points to project must be in front of the camera, z > 0; got z = {p[..., 2].min():.6g} m"
            )
        return p[..., :2] / p[..., 2:] * (self.fx, self.fy) + (self.cx, self.cy)

    def deproject(self, u: ArrayLike, v: ArrayLike, depth: ArrayLike) -> Floats:
        """Points in the camera frame [m], shape (..., 3), from pixels and their depths; inverse of `project`.

        Args:
            u: Column; may be between pixels. All three shapes broadcast together.
            v: Row.
            depth: Distance along the optical axis [m], not along the ray.
        """
        z = as_floats("depth", depth)
        x = (as_floats("u", u) - self.cx) / self.fx * z
        y = (as_floats("v", v) - self.cy) / self.fy * z
        return np.stack(np.broadcast_arrays(x, y, z), axis=-1)
