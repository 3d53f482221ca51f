"""Inputs of a page, and changes by the user."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from threading import Lock, RLock
from typing import Any

import numpy as np

from kinreach._checks import Floats
from kinreach._engines import load
from kinreach.view import _html as html

pin: Any = load("pinocchio")

#: How far a frame may be dragged [m].
FARTHEST = 3.0


def by_user(handle: Any, react: Callable[[Any], None]) -> None:
    """Call `react` with the value of an input when the user changes it, not when the page does."""
    newest: deque[Any] = deque(maxlen=1)

    async def note(event: Any) -> None:  # before anything else is done: the page may write to the input, too
        if event.client is not None:
            newest.append(event.target.value)

    def changed(event: Any) -> None:
        if event.client is not None:
            react(newest[0])

    handle.on_update(note)
    handle.on_update(changed)


def add_unseen(
    gui: Any, name: str, options: Sequence[str], react: Callable[[str], object], *, order: float | None = None
) -> Any:
    """Add buttons that only texts press, by `data-press` in `head.html`; what follows them is not seen either.

    Args:
        gui: viser's.
        name: Of the group.
        options: Of the buttons.
        react: Called with the option that was pressed.
        order: As viser has it.
    """
    gui.add_html(html.UNSEEN, order=order)
    group = gui.add_button_group(name, options, order=order)
    group.on_click(lambda event: react(event.target.value))
    return group


class Entry:
    """A number, or several, that the user and the page both write: what the user wrote is not written over unread.

    Args:
        handle: viser's, of the input.
        react: Called when there is something to be taken.
    """

    def __init__(self, handle: Any, react: Callable[[], None]) -> None:
        self._handle = handle
        self._written: deque[Any] = deque(maxlen=1)
        self._known = handle.value

        async def note(event: Any) -> None:
            if event.client is not None:
                self._written.append(event.target.value)

        handle.on_update(note)
        by_user(handle, lambda value: react())

    def take(self) -> Any:
        """Return what the user has written since the last call; None for nothing."""
        try:
            self._known = self._written.pop()
        except IndexError:
            return None
        return self._known

    def show(self, value: Any) -> None:
        """Show a value, unless it is shown already: on the way to "-0.2" a user types "-0".

        What differs from the value last taken or shown was written by the user since, noted or not.
        """
        unread = self._written or not np.array_equal(self._handle.value, self._known)
        if not unread and not np.array_equal(self._known, value):
            self._known = value
            self._handle.value = value


class Latest:
    """Work that is asked for faster than it is done: of all that wait, only the last is done.

    Args:
        lock: Held while working.

    Attributes:
        ended: Whether nothing is done any more.
    """

    def __init__(self, lock: RLock) -> None:
        self._lock = lock
        self._numbering = Lock()
        self._asked = 0
        self.ended = False

    def __call__(self, work: Callable[[], None]) -> None:
        """Do this, unless something else is asked for before it begins."""
        with self._numbering:
            self._asked += 1
            mine = self._asked
        with self._lock:
            if mine == self._asked and not self.ended:
                work()

    def end(self) -> None:
        """Do nothing any more."""
        self.ended = True


def frame_of(gizmo: Any) -> Floats:
    """Return the frame (4, 4) to which the user has dragged arrows and arcs."""
    T = np.eye(4)
    T[:3, :3] = pin.Quaternion(*map(float, gizmo.wxyz)).normalized().matrix()
    T[:3, 3] = np.clip(gizmo.position, -FARTHEST, FARTHEST)
    return T


def put(gizmo: Any, T: Floats) -> None:
    """Move arrows and arcs to a frame (4, 4)."""
    x, y, z, w = pin.Quaternion(np.ascontiguousarray(T[:3, :3])).coeffs().tolist()
    gizmo.position, gizmo.wxyz = T[:3, 3], (w, x, y, z)
