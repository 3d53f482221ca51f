"""Angles modulo full turns."""

from __future__ import annotations

from math import pi

import numpy as np

from kinreach._checks import Floats

#: A full turn [rad].
TURN = 2 * pi


def wrap(angle: float) -> float:
    """Wrap an angle into [-pi, pi]; one within it stays as it is, to the last digit."""
    return angle - TURN * round(angle / TURN) if not -pi <= angle <= pi else angle


def wrapped(q: Floats) -> Floats:
    """Wrap angles of any shape into [-pi, pi]."""
    return q - TURN * np.rint(q / TURN)
