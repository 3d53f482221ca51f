"""What the thesis's search for the ball does inside OpenCV, step by step, as pictures to look at (section 2.2).

The search itself is `ball_finder_hough.grey_circles`, which does all of this in one call. The steps here use its
settings; the votes are those of the thesis's formula, circles of one known radius drawn around every edge.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from kinreach.envs.ball_finder_hough import CANNY, SMOOTHING
from kinreach.errors import InputError
from kinreach.inputs import check_number
from kinreach.kinematics.goals import Floats, as_array

#: Of circles that are drawn around every edge [pixels]; wider than any picture that is looked at.
MOST_RADIUS = 1024.0


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
    """How many edge pixels have each pixel at a distance: the circles of that radius around them, drawn and added up.

    Where most of them cross is the centre of a circle of that radius, r^2 = (x - a)^2 + (y - b)^2 (section 2.2.2).

    Args:
        edges: Shape (height, width).
        radius: Of the circles [pixels].

    Returns:
        Shape (height, width).

    Raises:
        InputError: Edges of another type or shape, or a radius below half a pixel or above `MOST_RADIUS`.
    """
    edges, radius = as_array("edges", edges), check_number("radius", radius, least=0.5, most=MOST_RADIUS)
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
