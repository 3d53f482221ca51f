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
from kinreach.inputs import check_count, check_number
from kinreach.kinematics.goals import MOST_DISTANCE, Floats, as_floats, check_entries

#: Largest width and height of a picture [pixels].
MOST_PIXELS = 2**16
#: Bounds of focal lengths, and of how far from the upper left pixel the optical axis may be [pixels].
LEAST_FOCAL_LENGTH, MOST_LENGTH = 1e-6, 1e9
#: Largest field of view [degrees].
MOST_FOVY = 179.9
#: Nearest point that is projected [m].
LEAST_DEPTH = 1e-6


@dataclass(frozen=True)
class Intrinsics:
    """What a camera does to points in its own frame.

    Attributes:
        width, height: Size of the picture [pixels].
        fx, fy: Focal length in pixels along u and v.
        cx, cy: Pixel coordinates of the optical axis.

    Raises:
        InputError: A size is no positive integer, a focal length not positive, or a number not finite.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            check_count(name, getattr(self, name), most=MOST_PIXELS)
        for name in ("fx", "fy"):
            check_number(name, getattr(self, name), least=LEAST_FOCAL_LENGTH, most=MOST_LENGTH)
        for name in ("cx", "cy"):
            check_number(name, getattr(self, name), least=-MOST_LENGTH, most=MOST_LENGTH)

    @classmethod
    def from_fovy(cls, fovy: float, width: int, height: int) -> Intrinsics:
        """A camera with square pixels and the optical axis in the middle, as MuJoCo's are.

        Args:
            fovy: Vertical field of view [degrees].
            width: Of the picture [pixels].
            height: Of the picture [pixels].

        Raises:
            InputError: The field of view is not above 0 and at most 179.9 degrees, or the picture is empty.
        """
        fovy = check_number("fovy", fovy, above=0.0, most=MOST_FOVY)
        width, height = (check_count("width", width, most=MOST_PIXELS), check_count("height", height, most=MOST_PIXELS))
        f = height / 2 / math.tan(math.radians(fovy) / 2)
        return cls(width, height, f, f, (width - 1) / 2, (height - 1) / 2)

    def project(self, p_camera: ArrayLike) -> Floats:
        """Pixel coordinates of points, shape (..., 2) as (u, v).

        Args:
            p_camera: Points in the camera frame [m], shape (..., 3), in front of the camera.

        Raises:
            InputError: Wrong shape, or a point that is not in front of the camera (z > 0), or farther than any.
        """
        p = as_floats("p_camera", p_camera)
        if p.ndim == 0 or p.shape[-1] != 3:
            raise InputError(f"p_camera must have shape (..., 3), got {p.shape}")
        check_entries("p_camera", p, MOST_DISTANCE)
        if not (p[..., 2] >= LEAST_DEPTH).all():
            raise InputError(
                f"points to project must be in front of the camera, z > 0; got z = {p[..., 2].min():.6g} m"
            )
        return p[..., :2] / p[..., 2:] * (self.fx, self.fy) + (self.cx, self.cy)

    def deproject(self, u: ArrayLike, v: ArrayLike, depth: ArrayLike) -> Floats:
        """Points in the camera frame [m], shape (..., 3), from pixels and their depths; inverse of `project`.

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
        check_entries("u", columns, MOST_LENGTH)
        check_entries("v", rows, MOST_LENGTH)
        with np.errstate(over="ignore", invalid="ignore"):
            return np.stack([(columns - self.cx) / self.fx * z, (rows - self.cy) / self.fy * z, z], axis=-1)
