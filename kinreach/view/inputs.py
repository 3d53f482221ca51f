"""Inputs of a page, and who changed them."""

from __future__ import annotations

from collections.abc import Callable
from threading import RLock
from typing import Any


def by_user(handle: Any, react: Callable[[Any], None]) -> None:
    """Call `react` with the value of an input when the user changes it, not when the page does."""

    def changed(event: Any) -> None:
        if event.client is not None:
            react(event.target.value)

    handle.on_update(changed)


class Latest:
    """Work that is asked for faster than it is done: of all that wait, only the last is done.

    Args:
        lock: Held while working.
    """

    def __init__(self, lock: RLock) -> None:
        self._lock = lock
        self._asked = 0

    def __call__(self, work: Callable[[], None]) -> None:
        """Do this, unless something else is asked for before it begins."""
        self._asked += 1
        mine = self._asked
        with self._lock:
            if mine == self._asked:
                work()
