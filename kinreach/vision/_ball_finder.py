"""Find a red ball of known radius in one RGB-D picture. Pure functions on arrays.

Two pipelines:

- `thesis`: Canny's edges and the Hough circle transform on the grey picture, the depth at the circle's centre, and the
  ray through it (thesis 2.2 and 3.4.2).
- `hybrid`: the Hough circle transform on the map of what is red finds where to look; then the centroid of the red
  pixels there, corrected for perspective, and the depths of all pixels around it. OpenCV's circle is off by up to a
  third of the radius, the centroid by 0.15 pixels at most.

In both the depth is that of the ball's surface: its centre is farther by the radius, *along the ray*. A circle that
contradicts the depth (the ball would have another size) is refused; `hybrid` also asks whether the surface is round.
`python -m benchmarks.studies.ball_detection` measures both, `python -m benchmarks.studies.light_and_clutter` in other
light and beside other things.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import MAX_DISTANCE, Floats, as_array, as_floats, check_known, check_number, shown
from kinreach.errors import InputError
from kinreach.vision._cameras import Intrinsics
from kinreach.vision._circles import Circle, grey_circles, red_circles, red_mask

#: How near and how far the ball may be [m]: bounds the radius of the circle. The goals are 0.33 to 0.71 m away.
NEAREST, FARTHEST = 0.25, 1.0
#: Radius of a ball [m]: a smaller one has no pixel, and a larger one would reach the camera.
MIN_RADIUS, MAX_RADIUS = 1e-4, 0.2
#: Largest ratio, either way, between the radius of the thesis's circle and the one that the depth asks for: OpenCV's
#: radius is off by ratios from 0.69 to 1.31.
RADIUS_TOLERANCE = 1.6
#: The same for the area of the red pixels, which is off by 0.94 to 1.02. A ball cut by this much moves the centroid by
#: 3 mm.
AREA_TOLERANCE = 1.15
#: Pixels count for the centroid up to this many radii from its last estimate: the outline of a ball reaches 1.1 at the
#: picture's edge, the rest is for OpenCV's circle.
REACH = 1.5
#: And where there is depth, up to this many radii from the ball's centre: this leaves out red things beside the ball or
#: behind it, and so much of a flat square that the rest is too small for a ball.
SHELL = 1.25
#: Ring in which roundness is tested, in radii of the outline: there the surface of a ball is one radius from its centre
#: in the median; that of a ball 1.6 times as large is 1.09, of a flat thing 1.23.
ROUND_REACH = (0.5, 0.85)
ROUND_TOLERANCE = 1.07
#: Steps of the centroid; from a third of the radius off it arrives in two, beside other red things in four.
STEPS = 4


@dataclass(frozen=True, eq=False)
class BallFix:
    """A detected ball.

    Attributes:
        circle: Where it is in the picture [pixels].
        position: Its centre in the camera frame (x right, y down, z forward) [m], shape (3,).
    """

    circle: Circle
    position: Floats


def find_ball(
    rgb: NDArray[np.uint8],
    depth: NDArray[np.floating],
    intrinsics: Intrinsics,
    radius: float,
    *,
    pipeline: str = "hybrid",
) -> BallFix | None:
    """Find the red ball.

    Args:
        rgb: Colours, uint8, shape (height, width, 3).
        depth: Distance along the optical axis [m], shape (height, width); not finite or 0 where there is none.
        intrinsics: Of the camera that took both.
        radius: Of the ball [m].
        pipeline: `"hybrid"` or `"thesis"`, as the module describes.

    Returns:
        The ball, or None if there is none, never a guess. `hybrid` also refuses a ball that the picture's edge or
        something else cuts. Of several that fit, the one whose outline has the most votes.

    Raises:
        UnknownNameError: Unknown pipeline.
        InputError: Pictures of another type or size than the camera's, or a radius outside 0.1 mm … 0.2 m.

    Examples:
        >>> import numpy as np
        >>> from kinreach.vision import Intrinsics, find_ball
        >>> black = np.zeros((90, 160, 3), np.uint8)
        >>> find_ball(black, np.ones((90, 160)), Intrinsics.from_fovy(0.8, 160, 90), 0.025) is None
        True
    """
    check_known("pipeline", pipeline, PIPELINES)
    if not isinstance(intrinsics, Intrinsics):
        raise InputError(f"intrinsics must be Intrinsics, got {shown(intrinsics)}")
    radius = check_number("the ball's radius", radius, least=MIN_RADIUS, most=MAX_RADIUS)
    rgb, depth = as_array("rgb", rgb), as_array("depth", depth)
    if depth.dtype.kind != "f":
        depth = as_floats("depth", depth)
    size = (intrinsics.height, intrinsics.width)
    if rgb.dtype != np.uint8 or rgb.shape != (*size, 3) or depth.shape != size:
        raise InputError(
            f"the camera takes {size[1]}x{size[0]} pictures: rgb must be uint8 of shape {(*size, 3)} and depth of "
            f"shape {size}, got {rgb.dtype} {rgb.shape} and {depth.shape}"
        )
    return PIPELINES[pipeline](np.ascontiguousarray(rgb), depth, intrinsics, radius)


def _thesis(rgb: NDArray[np.uint8], depth: NDArray[np.floating], camera: Intrinsics, radius: float) -> BallFix | None:
    mask = red_mask(rgb)
    for circle in grey_circles(rgb, _radii(camera, radius)):
        row, column = min(round(circle.v), camera.height - 1), min(round(circle.u), camera.width - 1)
        if mask[_disk(circle, 0.5, mask.shape)].mean() < 0.5:  # the goal is known to be a red ball
            continue
        surface = camera.deproject(circle.u, circle.v, depth[row, column])
        if not _measured(surface[2]):
            continue
        position = surface * (1 + radius / np.linalg.norm(surface))
        ratio = circle.r / _outline_radius(camera, position, radius)
        if 1 / RADIUS_TOLERANCE < ratio < RADIUS_TOLERANCE:
            return BallFix(circle, position)
    return None


def _hybrid(rgb: NDArray[np.uint8], depth: NDArray[np.floating], camera: Intrinsics, radius: float) -> BallFix | None:
    mask = red_mask(rgb)
    for circle in red_circles(mask, _radii(camera, radius)):
        fix = _around(circle, mask, depth, camera, radius)
        if fix is not None:
            return fix
    return None


def _around(
    circle: Circle, mask: NDArray[np.bool_], depth: NDArray[np.floating], camera: Intrinsics, radius: float
) -> BallFix | None:
    """The ball that a circle announces, from the red pixels and their depths, or None."""
    found = circle
    position = np.full(3, np.nan)  # not known yet: nothing is too far from it
    for _ in range(STEPS):
        rows, columns = _disk(found, REACH, mask.shape)
        ball = mask[rows, columns] & ~(_from_centre(position, rows, columns, depth, camera) > SHELL * radius)
        rows, columns = rows[ball], columns[ball]
        if len(rows) == 0 or _touches_edge(rows, columns, mask.shape):
            return None
        found = Circle(float(columns.mean()), float(rows.mean()), math.sqrt(len(rows) / math.pi))
        centre = _centre(found, depth, camera, radius)
        if centre is None:
            return None
        position = centre
    ratio = (found.r / _outline_radius(camera, position, radius)) ** 2
    rows, columns = _disk(found, ROUND_REACH[1], mask.shape)
    outer = (rows - found.v) ** 2 + (columns - found.u) ** 2 > (ROUND_REACH[0] * found.r) ** 2
    surface = _from_centre(position, rows[outer], columns[outer], depth, camera)
    is_ball = 1 / AREA_TOLERANCE < ratio < AREA_TOLERANCE and not np.nanmedian(surface) > ROUND_TOLERANCE * radius
    return BallFix(found, position) if is_ball else None


def _from_centre(
    centre: Floats,
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    depth: NDArray[np.floating],
    camera: Intrinsics,
) -> Floats:
    """Distances of the points that pixels show from a point in the camera frame [m], NaN without depth."""
    z = depth[rows, columns].astype(np.float64)
    seen = _measured(z)
    found = np.full(len(z), np.nan)
    found[seen] = np.linalg.norm(camera.deproject(columns[seen], rows[seen], z[seen]) - centre, axis=1)
    return found


def _centre(circle: Circle, depth: NDArray[np.floating], camera: Intrinsics, radius: float) -> Floats | None:
    r"""The ball's centre [m] from its outline and the depths in the inner half of it, shape (3,).

    A pixel whose ray makes the angle $\varphi$ with the ray to the ball's centre and that sees the ball at the
    distance $s$ puts the centre at the distance $s \cos\varphi + \sqrt{r^2 - s^2 \sin^2\varphi}$; the median of these
    is taken. The middle of the outline is not the image of the centre $(X, Y, Z)$ but $Z^2 / (Z^2 - r^2)$ times as
    far from the optical axis: up to 2.8 pixels at 1280x720.
    """
    rows, columns = _disk(circle, 0.5, depth.shape)
    z = depth[rows, columns].astype(np.float64)
    seen = _measured(z)
    if not seen.any():
        return None
    points = camera.deproject(columns[seen], rows[seen], z[seen])
    middle = camera.deproject(circle.u, circle.v, 1.0)
    nearest = float(np.median(points[:, 2])) + radius  # of the centre, good enough for the correction
    middle[:2] *= 1 - (radius / nearest) ** 2
    ray = middle / np.linalg.norm(middle)
    along = points @ ray
    across = (points**2).sum(axis=1) - along**2
    distances = along + np.sqrt(np.maximum(radius**2 - across, 0.0))
    return ray * float(np.median(distances))


def _disk(circle: Circle, reach: float, shape: tuple[int, ...]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of the pixels within `reach` radii of a circle's centre."""
    r = max(circle.r * reach, 1.0)
    top, left = max(math.ceil(circle.v - r), 0), max(math.ceil(circle.u - r), 0)
    rows, columns = np.mgrid[
        top : min(math.floor(circle.v + r) + 1, shape[0]), left : min(math.floor(circle.u + r) + 1, shape[1])
    ]
    inside = (rows - circle.v) ** 2 + (columns - circle.u) ** 2 <= r * r
    return rows[inside], columns[inside]


def _touches_edge(rows: NDArray[np.intp], columns: NDArray[np.intp], shape: tuple[int, ...]) -> bool:
    return bool(rows.min() == 0 or columns.min() == 0 or rows.max() == shape[0] - 1 or columns.max() == shape[1] - 1)


def _measured(depth: Floats) -> NDArray[np.bool_]:
    return (depth > 0) & (depth < MAX_DISTANCE)


def _radii(camera: Intrinsics, radius: float) -> tuple[float, float]:
    return camera.fx * radius / FARTHEST, camera.fx * radius / NEAREST


def _outline_radius(camera: Intrinsics, position: Floats, radius: float) -> float:
    r"""Radius [pixels] of the disk that is as large as the image of a ball at `position` in the camera frame [m].

    The outline is an ellipse with the half axes $f r / \sqrt{Z^2 - r^2}$ and
    $f r \sqrt{D^2 - r^2} / (Z^2 - r^2)$, $D$ the distance of the ball.
    """
    distance_2 = float(position @ position)
    depth_2 = max(float(position[2]) ** 2 - radius**2, radius**2)
    return camera.fx * radius * (distance_2 - radius**2) ** 0.25 / depth_2**0.75


#: Name -> function of rgb, depth, intrinsics and the ball's radius.
PIPELINES: Mapping[str, Callable[..., BallFix | None]] = MappingProxyType({"hybrid": _hybrid, "thesis": _thesis})
