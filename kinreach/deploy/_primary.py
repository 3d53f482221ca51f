"""The primary interface: what a controller sends on the ports that take scripts, for server and client.

A package is a big-endian header, its size as `int32` and its kind as `uint8`, and a payload. Kinds and layouts are
those of Universal Robots' client interfaces. Of the two kinds that are sent, the client reads the messages, and in the
state of the robot the figures of its kinematics.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from kinreach.deploy._model import DhFigures

PRIMARY_PORT = 30001
#: Kinds of packages; kinds of messages; kinds of the parts of a state.
ROBOT_STATE, ROBOT_MESSAGE = 16, 20
KEY, RUNTIME_EXCEPTION = 7, 10
_PARTS = {"mode": 0, "joints": 1, "tool": 2, "masterboard": 3, "cartesian": 4, "kinematics": 5, "force": 7,
          "additional": 8}  # fmt: skip
#: Titles of the messages by which a controller announces a program, whose text is its name.
STARTED, STOPPED = "PROGRAM_XXX_STARTED", "PROGRAM_XXX_STOPPED"
#: Longest package of a robot [bytes], far above those of real ones.
MAX_PACKAGE = 2**20
_HEADER, _PART = struct.Struct(">iB"), struct.Struct(">IB")
#: Of a message: time stamp, source, kind. Of a key message: code, argument, length of its title. Of the kinematics:
#: checksums, theta, a, d, alpha, and whether it is calibrated.
_MESSAGE, _TITLE, _KINEMATICS = struct.Struct(">QbB"), struct.Struct(">iiB"), struct.Struct(">6I24dI")
#: Of the other parts of a state.
STATE_PARTS: Mapping[str, struct.Struct] = {
    "mode": struct.Struct(">Q7?BBdddB"), "joints": struct.Struct(">" + 6 * "3d4fB"),
    "tool": struct.Struct(">BBddfBffB"), "masterboard": struct.Struct(">IIBBddBBddffffBBBI"),
    "cartesian": struct.Struct(">12d"), "force": struct.Struct(">7d"), "additional": struct.Struct(">B??B"),
}  # fmt: skip


class Message(NamedTuple):
    """A message of a controller.

    Attributes:
        kind: `KEY` or `RUNTIME_EXCEPTION`.
        title: Of a key message; empty for others.
    """

    kind: int
    title: str
    text: str


def message_package(message: Message, time: float, *, line: int = 1) -> bytes:
    """Return a message as a package; `time` is that of the controller [s], `line` that of a runtime exception."""
    title = message.title.encode()
    head = _TITLE.pack(0, 0, len(title)) + title if message.kind == KEY else struct.pack(">ii", line, 1)
    body = _MESSAGE.pack(int(1e6 * time), -1, message.kind) + head + message.text.encode("utf-8", "replace")[:2000]
    return _HEADER.pack(_HEADER.size + len(body), ROBOT_MESSAGE) + body


def figures_package(figures: DhFigures) -> bytes:
    """Return the figures of an arm as a package."""
    numbers = np.concatenate([figures.theta, figures.a, figures.d, figures.alpha]).tolist()
    return state_package([("kinematics", _KINEMATICS.pack(*[0] * 6, *numbers, 1))])


def state_package(parts: Iterable[tuple[str, bytes]]) -> bytes:
    """Return parts of a state, by their names, as a package."""
    body = b"".join(_PART.pack(_PART.size + len(part), _PARTS[name]) + part for name, part in parts)
    return _HEADER.pack(_HEADER.size + len(body), ROBOT_STATE) + body


def news_in(buffer: bytearray) -> Iterator[Message | DhFigures]:
    """Remove the complete packages from a buffer and yield what they say; a stream of other bytes is discarded."""
    while len(buffer) >= _HEADER.size:
        size, kind = _HEADER.unpack_from(buffer)
        if not _HEADER.size <= size <= MAX_PACKAGE:
            buffer.clear()
            return
        if len(buffer) < size:
            return
        body = bytes(buffer[_HEADER.size : size])
        del buffer[:size]
        if kind == ROBOT_MESSAGE and (message := _message(body)) is not None:
            yield message
        elif kind == ROBOT_STATE:
            yield from _figures(body)


def _message(body: bytes) -> Message | None:
    if len(body) < _MESSAGE.size:
        return None
    kind, rest = body[_MESSAGE.size - 1], body[_MESSAGE.size :]
    if kind == RUNTIME_EXCEPTION and len(rest) >= 8:
        return Message(kind, "", rest[8:].decode("utf-8", "replace"))
    if kind == KEY and len(rest) >= _TITLE.size:
        end = _TITLE.size + rest[_TITLE.size - 1]
        return Message(kind, *(part.decode("utf-8", "replace") for part in (rest[_TITLE.size : end], rest[end:])))
    return None


def _figures(body: bytes) -> Iterator[DhFigures]:
    """Yield the figures in a state, whose parts have a header each."""
    while len(body) >= _PART.size:
        size, kind = _PART.unpack_from(body)
        if not _PART.size <= size <= len(body):
            return
        if kind == _PARTS["kinematics"] and size == _PART.size + _KINEMATICS.size:
            numbers = np.array(_KINEMATICS.unpack_from(body, _PART.size)[6:30])
            if np.isfinite(numbers).all():
                yield DhFigures(*numbers.reshape(4, 6))
        body = body[size:]
