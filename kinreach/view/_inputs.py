"""Inputs that the user and the page change."""

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

#: Largest coordinate of a dragged frame [m].
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
    """Add hidden buttons that texts press by `data-press` of `head.html`; later inputs of the folder are hidden too."""
    gui.add_html(html.UNSEEN, order=order)
    group = gui.add_button_group(name, options, order=order)
    group.on_click(lambda event: react(event.target.value))
    return group


class TypedInput:
    """Numbers that the user and the page both write: unread ones of the user are not overwritten.

    `react` is called when `take` has a value.
    """

    def __init__(self, handle: Any, react: Callable[[], None]) -> None:
        self._handle = handle
        self._written: deque[Any] = deque(maxlen=1)
        self._known = handle.value

        async def note(event: Any) -> None:
            if event.client is None:
                return
            if np.array_equal(event.target.value, self._known):  # taken already, or typed back
                self._written.clear()
            else:
                self._written.append(event.target.value)

        handle.on_update(note)
        by_user(handle, lambda value: react())

    def take(self) -> Any:
        """Return what the user wrote since the last call, or None; `react` may come here before `note` was called."""
        try:
            self._known = self._written.pop()
        except IndexError:
            if np.array_equal(self._handle.value, self._known):
                return None
            self._known = self._handle.value
        return self._known

    def show(self, value: Any) -> None:
        """Show a value, unless it is already there: on the way to "-0.2" a user types "-0".

        A value that differs from the last one taken or shown is the user's, even if `note` was not called yet.
        """
        unread = self._written or not np.array_equal(self._handle.value, self._known)
        if not unread and not np.array_equal(self._known, value):
            self._known = value
            self._handle.value = value


class Latest:
    """Work that is requested faster than it is done: of the requests that wait, only the last is done."""

    def __init__(self, lock: RLock) -> None:
        self._lock = lock
        self._numbering = Lock()
        self._asked = 0
        self.ended = False

    def __call__(self, work: Callable[[], object]) -> None:
        with self._numbering:
            self._asked += 1
            mine = self._asked
        with self._lock:
            if mine == self._asked and not self.ended:
                work()

    def end(self) -> None:
        self.ended = True


def frame_of(gizmo: Any) -> Floats:
    """Return the frame (4, 4) of arrows and arcs that the user dragged."""
    T = np.eye(4)
    T[:3, :3] = pin.Quaternion(*map(float, gizmo.wxyz)).normalized().matrix()
    T[:3, 3] = np.clip(gizmo.position, -FARTHEST, FARTHEST)
    return T


def put(gizmo: Any, T: Floats) -> None:
    """Move arrows and arcs to a frame (4, 4)."""
    x, y, z, w = pin.Quaternion(np.ascontiguousarray(T[:3, :3])).coeffs().tolist()
    gizmo.position, gizmo.wxyz = T[:3, 3], (w, x, y, z)
