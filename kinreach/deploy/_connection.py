"""A connection that a thread of its own keeps empty: a robot disconnects a client that does not read."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

from kinreach.errors import RobotError

#: Longest time for an answer [s]; bytes that are read at once.
TIMEOUT, CHUNK = 3.0, 65536


class LostError(RobotError, ConnectionError):
    """The connection to a robot broke, or its state no longer comes."""


class Taker(Protocol):
    """Who gets what a connection receives, in the connection's thread."""

    def take(self, data: bytes, *, more: bool) -> None:
        """Take bytes; `more` if others may wait already."""

    def lose(self, error: Exception) -> None:
        """Learn that nothing more comes, and why."""


class Connection:
    """A TCP connection to a robot. Only the process that opened it uses it.

    Args:
        address: Host name or IP address.
        port: Of the robot.

    Raises:
        RobotError: Nobody answers.
    """

    def __init__(self, address: str, port: int) -> None:
        self.address = address
        try:
            self.socket = socket.create_connection((address, port), TIMEOUT)
        except (OSError, UnicodeError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise RobotError(f"no robot answers at {address}:{port}: {reason}") from None
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._process = os.getpid()
        self._thread: threading.Thread | None = None

    def deliver(self, taker: Taker) -> None:
        """Give all that comes from now on to someone, in a thread that ends with the connection."""
        self._thread = threading.Thread(
            target=_deliver, args=(self.socket, taker.take, taker.lose), name=f"from {self.address}", daemon=True
        )
        self._thread.start()

    def send(self, data: bytes, *, patience: float = TIMEOUT) -> None:
        """Send within some seconds.

        Raises:
            RobotError: The connection is lost, or another process opened it.
        """
        self.check_process()
        try:
            self.socket.settimeout(patience)
            self.socket.sendall(data)
        except OSError as error:
            raise self.lost(error) from None

    def check_process(self) -> None:
        """Refuse a process that was forked: its parent has the thread, and both would share the robot's answers."""
        if os.getpid() != self._process:
            raise RobotError(
                f"the connection to the robot at {self.address} belongs to the process that opened it; connect anew"
            )

    def close(self) -> None:
        """Close the connection and wait for its thread; in a forked process the parent's connection stays."""
        if os.getpid() == self._process:
            with suppress(OSError):
                self.socket.shutdown(socket.SHUT_RDWR)
            if self._thread is not None and self._thread is not threading.current_thread():
                self._thread.join()
        self.socket.close()

    def lost(self, error: OSError) -> LostError:
        reason = error.strerror or str(error)
        return LostError(f"the connection to the robot at {self.address} is lost: {reason}")


def _deliver(connection: socket.socket, take: Callable[..., None], lose: Callable[[Exception], None]) -> None:
    try:
        while True:
            try:
                data = connection.recv(CHUNK)
            except TimeoutError:
                continue
            if not data:
                raise ConnectionError("the connection was closed")
            take(data, more=len(data) == CHUNK)
    except Exception as error:  # whatever it is, it ends the connection, and its user is told
        lose(error)
