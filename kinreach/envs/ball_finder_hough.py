"""Edges and circles in pictures, by OpenCV: from an RGB picture to circles that may be the ball.

`grey_circles` is what the thesis describes (2.2): Gaussian filter, Sobel operator, Canny's edges, Hough circle
transform. `red_circles` does the same on a map of what is red.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

#: Red minus the larger of green and blue, from which on a pixel is red [levels]. Rendered, the ball has 80 at least
#: (in its own shadow) and everything else 19 at most: with noise of 6 levels the bound is 3.5 sigma from both.
RED_LEVEL = 50
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
    """Which pixels are red, single stray ones removed; shape (height, width)."""
    red, green, blue = cv2.split(rgb)
    redness = cv2.subtract(red, cv2.max(green, blue))
    mask = (redness > RED_LEVEL).astype(np.uint8)
    return cv2.medianBlur(mask, 3).astype(bool)


def red_circles(mask: NDArray[np.bool_], radii: tuple[float, float]) -> list[Circle]:
    """Circles around what is red, those with most votes first.

    Args:
        mask: From `red_mask`.
        radii: Smallest and largest radius [pixels].
    """
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
