"""A full turn, and angles without those that they have too many."""

from __future__ import annotations

from math import pi

import numpy as np

from kinreach.checks import Floats

#: A full turn [rad].
TURN = 2 * pi


def wrap(angle: float) -> float:
    """The angle in [-pi, pi]; one that is there already stays as it is, to the last digit."""
    return angle - TURN * round(angle / TURN) if not -pi <= angle <= pi else angle


def wrapped(q: Floats) -> Floats:
    """Angles in [-pi, pi], of any shape."""
    return q - TURN * np.rint(q / TURN)
