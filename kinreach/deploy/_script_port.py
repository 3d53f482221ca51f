"""The port that takes scripts, from the side of a client: it sends programs, and hears what the controller says."""

from __future__ import annotations

import threading
from time import monotonic

from kinreach._checks import printable
from kinreach.deploy._connection import TIMEOUT, Connection, LostError
from kinreach.deploy._model import DhFigures
from kinreach.deploy._primary import KEY, RUNTIME_EXCEPTION, STARTED, STOPPED, Message, news_in
from kinreach.errors import RobotError

#: So long a reason may come later than the state that it explains [s].
LATER = 0.2


class ScriptPort:
    """A connection to the script port, opened anew where it broke.

    Args:
        address: Host name or IP address.
        port: For scripts.

    Attributes:
        figures: Of the robot's kinematics; None until it says them, as on connecting it does.
        started: Names of the programs that began since `forget`, if the port announces them, as 30001 does.

    Raises:
        RobotError: Nobody answers.
    """

    def __init__(self, address: str, port: int) -> None:
        self._place = address, port
        self._heard = threading.Condition()
        self.figures: DhFigures | None = None
        self.started: list[str] = []
        self._reason, self._closed = "", False
        self._open()

    def close(self) -> None:
        self._closed = True
        self._connection.close()

    def send(self, script: str, *, patience: float = TIMEOUT, anew: bool = False) -> None:
        """Send a program.

        Args:
            script: The program.
            patience: Longest time that it may take [s].
            anew: Over a new connection, even if the one that there is seems to be whole.

        Raises:
            RobotError: The connection is lost, and cannot be opened again.
        """
        self.check_usable()
        if anew or self._broken:
            self._connection.close()
            self._open()
        self._connection.send(script.encode(), patience=patience)

    def check_usable(self) -> None:
        """Refuse a connection that was closed here, or belongs to another process."""
        if self._closed:
            raise LostError(f"the connection to the robot at {self._place[0]} is lost: it was closed")
        self._connection.check_process()

    def forget(self) -> None:
        """Forget what was said before."""
        with self._heard:
            self._reason = ""
            self.started.clear()

    def reason(self, before: str = "") -> str:
        """Return the robot's last words about its program, with `before` in front; empty if there are none."""
        deadline = monotonic() + LATER
        with self._heard:
            while not self._reason and not self._broken and (remaining := deadline - monotonic()) > 0.0:
                self._heard.wait(remaining)
            return f"{before}{printable(self._reason)}" if self._reason else ""

    def wait_for_figures(self, seconds: float) -> DhFigures | None:
        """Return the figures of the robot's kinematics, or None if it does not say them in time."""
        with self._heard:
            self._heard.wait_for(lambda: self.figures is not None or self._broken, seconds)
            return self.figures

    def take(self, data: bytes, *, more: bool) -> None:
        self._buffer += data
        with self._heard:
            for news in news_in(self._buffer):
                self._hear(news)
            self._heard.notify_all()

    def lose(self, error: Exception) -> None:
        with self._heard:
            self._broken = True
            self._heard.notify_all()

    def _hear(self, news: Message | DhFigures) -> None:
        if isinstance(news, DhFigures):
            self.figures = news
        elif news.title == STARTED:
            self.started.append(news.text)
        elif news.title != STOPPED and news.kind in (KEY, RUNTIME_EXCEPTION):
            self._reason = news.text

    def _open(self) -> None:
        try:
            self._connection = Connection(*self._place)
        except RobotError:
            self._broken = True
            raise
        self._buffer, self._broken = bytearray(), False
        self._connection.deliver(self)
