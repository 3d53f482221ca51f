"""Inputs of a page, and who changed them."""

from __future__ import annotations

from collections.abc import Callable
from threading import RLock
from typing import Any

import numpy as np

from kinreach.checks import Floats
from kinreach.engines import load

pin: Any = load("pinocchio")

#: How far a frame may be dragged [m].
FARTHEST = 3.0


def by_user(handle: Any, react: Callable[[Any], None]) -> None:
    """Call `react` with the value of an input when the user changes it, not when the page does."""

    def changed(event: Any) -> None:
        if event.client is not None:
            react(event.target.value)

    handle.on_update(changed)


def say(handle: Any, values: Floats) -> None:
    """Show numbers in an input, unless it has them already: whoever is typing "-0.2" has typed "-0" on the way."""
    if not np.array_equal(handle.value, values):
        handle.value = tuple(values.tolist())


class Latest:
    """Work that is asked for faster than it is done: of all that wait, only the last is done.

    Args:
        lock: Held while working.
    """

    def __init__(self, lock: RLock) -> None:
        self._lock = lock
        self._asked = 0
        self._ended = False

    def __call__(self, work: Callable[[], None]) -> None:
        """Do this, unless something else is asked for before it begins."""
        self._asked += 1
        mine = self._asked
        with self._lock:
            if mine == self._asked and not self._ended:
                work()

    def end(self) -> None:
        """Do nothing any more."""
        self._ended = True


def frame_of(gizmo: Any) -> Floats:
    """The frame (4, 4) to which the user has dragged arrows and arcs."""
    w, x, y, z = np.asarray(gizmo.wxyz, dtype=np.float64) / np.linalg.norm(gizmo.wxyz)
    T = np.eye(4)
    T[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    T[:3, 3] = np.clip(gizmo.position, -FARTHEST, FARTHEST)
    return T


def put(gizmo: Any, T: Floats) -> None:
    """Move arrows and arcs to a frame (4, 4)."""
    x, y, z, w = pin.Quaternion(np.ascontiguousarray(T[:3, :3])).coeffs().tolist()
    gizmo.position, gizmo.wxyz = T[:3, 3], (w, x, y, z)
