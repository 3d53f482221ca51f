"""Edges and circles in pictures, by OpenCV: from an RGB picture to circles that may be the ball.

`grey_circles` is what the thesis describes (2.2): Gaussian filter, Sobel operator, Canny's edges, Hough circle
transform. `red_circles` does the same on a map of what is red. `edge_steps` and `circle_votes` show what happens inside
OpenCV, step by step, as pictures to look at; the votes are those of the thesis's formula, circles of one known radius
drawn around every edge.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats, as_array, check_number
from kinreach.errors import InputError

#: Red minus the larger of green and blue, as a share of red, from which on a pixel is red. In light from a quarter to
#: twice the usual the ball has 0.72 at least, the table 0.10 at most, a ball in orange 0.5.
RED_SHARE = 0.6
#: The same difference in levels: below it, colours are those of the noise. In a quarter of the light the ball has 19.
RED_LEVEL = 10
#: Gaussian filter before the edges [pixels], the first step of Canny's, which OpenCV leaves to the caller; 1.5 and 2
#: are no more accurate.
SMOOTHING = 1.0
#: Upper threshold of Canny's hysteresis; the lower is half of it (OpenCV's `param1`, its default).
CANNY = 100.0
#: Votes that make a centre (`param2`). From 10 to 14 every ball of 50 was found by both cameras at 1280x720, 640x360
#: and 320x180, with noise and without; from 18 on the smallest ones, 6 pixels in radius, begin to be missed.
VOTES = 12.0


class Circle(NamedTuple):
    """A circle in a picture: centre (u, v), whole numbers at the centres of pixels, and radius [pixels]."""

    u: float
    v: float
    r: float


def red_mask(rgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return which pixels are red, single stray ones removed; shape (height, width)."""
    red, green, blue = cv2.split(
        cv2.medianBlur(rgb, 3)
    )  # in a quarter of the light, noise is as large as a third of red
    redness = cv2.subtract(red, cv2.max(green, blue))
    least = np.maximum(cv2.convertScaleAbs(red, alpha=RED_SHARE), np.uint8(RED_LEVEL))
    return cv2.medianBlur(cv2.compare(redness, least, cv2.CMP_GT), 3).astype(bool)


def red_circles(mask: NDArray[np.bool_], radii: tuple[float, float]) -> list[Circle]:
    """Circles around what is red, those with most votes first; `radii` are the smallest and the largest [pixels]."""
    u, v, width, height = cv2.boundingRect(mask.astype(np.uint8))
    if width == 0:
        return []
    # Only the part of the picture that holds red is searched, with room for the smoothed edge: at 1280x720 that is
    # 4 ms instead of 26.
    margin = 5
    left, top = max(u - margin, 0), max(v - margin, 0)
    part = mask[top : v + height + margin, left : u + width + margin].astype(np.uint8) * np.uint8(255)
    return [Circle(c.u + left, c.v + top, c.r) for c in _circles(part, radii)]


def grey_circles(rgb: NDArray[np.uint8], radii: tuple[float, float]) -> list[Circle]:
    """Circles in the brightness of a picture, those with most votes first; `radii` as for `red_circles`."""
    return _circles(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), radii)


def _circles(grey: NDArray[Any], radii: tuple[float, float]) -> list[Circle]:
    low, high = max(int(radii[0]), 2), int(np.ceil(radii[1]))
    found = cv2.HoughCircles(
        cv2.GaussianBlur(grey, (0, 0), SMOOTHING),
        cv2.HOUGH_GRADIENT,
        dp=1,
        minDist=low,
        param1=CANNY,
        param2=VOTES,
        minRadius=low,
        maxRadius=high,
    )
    if found is None:
        return []
    return [Circle(float(u), float(v), float(r)) for u, v, r in found.reshape(-1, 3)]


class EdgeSteps(NamedTuple):
    """Pictures of shape (height, width).

    Attributes:
        grey: Brightness after the Gaussian filter, 0 to 255.
        sobel: Length of the brightness's gradient by the Sobel operator.
        edges: Whether Canny's detector keeps the pixel as an edge.
    """

    grey: Floats
    sobel: Floats
    edges: NDArray[np.bool_]


def edge_steps(rgb: NDArray[np.uint8]) -> EdgeSteps:
    """Gaussian filter, Sobel operator and Canny's edges of a picture.

    Args:
        rgb: Colours, uint8, shape (height, width, 3).

    Raises:
        InputError: A picture of another type or shape, or without a pixel.
    """
    rgb = as_array("rgb", rgb)
    if rgb.dtype != np.uint8 or rgb.ndim != 3 or rgb.shape[2] != 3 or not rgb.size:
        raise InputError(f"rgb must be uint8 of shape (height, width, 3) with a pixel, got {rgb.dtype} {rgb.shape}")
    grey = cv2.GaussianBlur(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), (0, 0), SMOOTHING)
    dx, dy = (cv2.Sobel(grey, cv2.CV_64F, *order) for order in ((1, 0), (0, 1)))
    edges = cv2.Canny(grey, CANNY / 2, CANNY) > 0
    return EdgeSteps(grey.astype(np.float64), np.hypot(dx, dy), edges)


def circle_votes(edges: NDArray[np.bool_], radius: float) -> NDArray[np.intp]:
    """Add up circles of a radius around all edge pixels: how many edge pixels are so far from each pixel.

    Where most of them cross is the centre of a circle of that radius, r^2 = (x - a)^2 + (y - b)^2 (section 2.2.2).

    Args:
        edges: Shape (height, width).
        radius: Of the circles [pixels].

    Returns:
        Shape (height, width).

    Raises:
        InputError: Edges of another type or shape, or a radius below half a pixel or above 1024 pixels.
    """
    edges, radius = as_array("edges", edges), check_number("radius", radius, least=0.5, most=1024.0)
    if edges.dtype != np.bool_ or edges.ndim != 2:
        raise InputError(f"edges must be bool of shape (height, width), got {edges.dtype} {edges.shape}")
    reach = int(np.ceil(radius + 0.5))
    dv, du = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    on_circle = np.abs(np.hypot(dv, du) - radius) < 0.5
    height, width = edges.shape
    votes = np.zeros((height + 2 * reach, width + 2 * reach), dtype=np.intp)
    rows, columns = np.nonzero(edges)
    for v, u in zip(dv[on_circle], du[on_circle], strict=True):
        votes[rows + v + reach, columns + u + reach] += 1  # no pixel twice: every edge is shifted alike
    return votes[reach : height + reach, reach : width + reach]
