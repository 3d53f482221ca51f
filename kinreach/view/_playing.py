"""The base of the parts of the page that play something: play, pause, start, and a slider."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from kinreach.view._messages import error_message
from kinreach.view._panel import Panel

PLAY, PAUSE, START = "play", "pause", "start"


class PlayedPanel(Panel):
    """A part that shows one of several frames; it has a `_verdict`, and a `_button` that makes the frames.

    Attributes:
        at: Index of the frame that is shown.
    """

    _verdict: Any
    _button: Any

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.at = 0
        self._shown = True
        self._still, self._gone = threading.Event(), threading.Event()
        self._still.set()

    @property
    def last(self) -> int:
        """Index of the last frame; -1 without any."""
        return -1

    @property
    def playing(self) -> bool:
        return not self._still.is_set()

    def show(self, visible: bool) -> None:
        with self._lock:
            self.pause()
            super().show(visible)
            self._shown = visible

    def close(self) -> None:
        self._gone.set()
        self._still.set()
        super().close()

    def go(self, index: int) -> None:
        """Show a frame; an index out of range means the first or the last one."""
        with self._lock:
            if self.last >= 0:
                self.at = int(np.clip(index, 0, self.last))
                self._draw()

    def run(self) -> None:
        """Play from the frame on the screen; from the start if that is the last one."""
        with self._lock:
            if self.last < 0 or self.playing or self._gone.is_set():
                return
            if self.at == self.last:
                self.go(0)
            self._still = threading.Event()
            self._start(self._play, self._still)

    def pause(self) -> None:
        self._still.set()

    def _build_player(self, buttons: Sequence[str], more: Mapping[str, Callable[[], None]]) -> None:
        """Add buttons, among them `more` than those of every player."""
        react = {PLAY: self.run, PAUSE: self.pause, START: lambda: self._scrubbed(0), **more}
        group = self._client.gui.add_button_group("player", buttons)
        group.on_click(lambda event: react[event.target.value]())

    def _scrubbed(self, index: int) -> None:
        self.pause()
        self.go(index)

    def _draw(self) -> None:
        """Draw the frame `at`."""

    def _pause_after(self, index: int) -> float:
        """Return how long a frame stays [s]."""
        return 0.0

    def _start(self, work: Callable[..., None], *arguments: Any) -> None:
        """Work in a thread of its own and report errors in the page."""

        def run() -> None:
            try:
                work(*arguments)
            except Exception as error:  # an environment or a policy from outside may raise anything
                if self._gone.is_set():
                    return
                with self._lock:
                    self._button.disabled = False
                    self._verdict.content = error_message(error)

        threading.Thread(target=run, daemon=True, name=f"kinreach {work.__name__}").start()

    def _play(self, still: threading.Event) -> None:
        while not still.wait(self._pause_after(self.at)):
            with self._lock:
                if still.is_set():
                    return
                self.go(self.at + 1)
                if self.at == self.last:
                    still.set()
