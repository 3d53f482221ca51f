"""Signals that end a process, while a robot moves: they interrupt one block, once, and never what stops the robot."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Self

#: Ctrl-C, `kill`, and a terminal that is closed.
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interruption:
    """A context in which signals are kept, until `check` raises KeyboardInterrupt for the first one, or its end.

    Code of this package is never interrupted between two of its lines: a lock that is not released would keep the robot
    from being heard. Code of others is, by `armed`. After the first signal no further one does anything. Signals that
    the process ignores stay ignored. Only the main thread gets signals; in others this does nothing.
    """

    def __init__(self) -> None:
        self._came, self._raised, self._is_armed = False, False, False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            handlers = {number: signal.getsignal(number) for number in SIGNALS}
            self._before = {number: handler for number, handler in handlers.items()
                            if handler not in (None, signal.SIG_IGN)}  # fmt: skip
            try:
                for number in self._before:
                    signal.signal(number, self._on_signal)
            except BaseException:  # by a signal whose handler is not yet replaced
                self._restore()
                raise
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._restore()
        if kind is None:
            self.check()

    def _restore(self) -> None:
        """Put the handlers back, all of them, also if one of them interrupts that."""
        interrupt: BaseException | None = None
        restored = False
        while not restored:
            try:
                for number, handler in self._before.items():
                    signal.signal(number, handler)
                restored = True
            except BaseException as error:
                interrupt = error
        if interrupt is not None:
            raise interrupt

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal came that has not done so."""
        if self._came and not self._raised:
            self._raised = True
            raise KeyboardInterrupt

    @contextmanager
    def armed(self) -> Iterator[None]:
        """Let a signal interrupt what is within, at any line."""
        self._is_armed = True
        try:
            yield
        finally:
            self._is_armed = False

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self._came = True
        if self._is_armed:
            self._is_armed = False
            self.check()
