"""Programs of PolyScope, the program of a UR's pendant: the kinematics and waypoints in a `.urp`, and its export.

A `.urp` is XML, mostly packed by gzip. Every waypoint carries the Denavit-Hartenberg figures of the robot that it was
taught on. The export, a `.script`, has pairs of joint angles and poses instead. Nothing in a file is executed.
"""

from __future__ import annotations

import re
import zlib
from bisect import bisect
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, NoReturn
from xml.parsers import expat

import numpy as np

from kinreach._checks import Floats, shown
from kinreach.errors import InputError

#: Largest unpacked program [bytes], and deepest nesting of its elements.
MAX_BYTES, MAX_DEPTH = 2**26, 500
#: Largest angle [rad] and length [m] in a program: controllers slide frames along joints that are almost parallel.
MAX_ANGLE, MAX_SLIDE = 13.0, 1e4
GZIP = b"\x1f\x8b"
#: Figures of a block of kinematics.
_FIGURES = ("deltaTheta", "a", "d", "alpha")
_NUMBERS = re.compile(r"[-+\d.eE,\s]*")
_PAIR = r"\b(\w+)_{}\s*=\s*{}\[([^\]]*)\]"
_QS, _PS = re.compile(_PAIR.format("q", "")), re.compile(_PAIR.format("p", "p"))
#: A tool centre point that is set, by numbers or by a variable; a variable's pose; where a waypoint is used.
_SET_TCP = re.compile(r"\bset_tcp\s*\(\s*(?:p\[([^\]]*)\]|(\w*))")
_POSE_OF = re.compile(r"\b(\w+)\s*=\s*p\[([^\]]*)\]")
_USE = re.compile(r"\b(\w+)_[pq]\b(?!\s*=[^=])")
_COMMENT = re.compile(r"^\s*#.*$", re.MULTILINE)


class Kinematics(NamedTuple):
    """The figures of one robot, as its controller has them.

    Attributes:
        figures: Rows delta theta [rad], a [m], d [m], alpha [rad], one column a joint, shape (4, 6).
        waypoints: Names of the waypoints that were taught on it.
        checksums: One number a joint, as text; empty if there is none.
    """

    figures: Floats
    waypoints: tuple[str, ...]
    checksums: str


class PolyScopeProgram(NamedTuple):
    """What a program says of its robots.

    Attributes:
        robots: Their figures, that with most waypoints first.
        unusable: Why other blocks are not used, such as `"NOT_INITIALIZED"`, a line each.
        tcps: Tool centre points of the waypoints, `[x, y, z, rx, ry, rz]`, without repetitions, shape (k, 6).
    """

    robots: tuple[Kinematics, ...]
    unusable: tuple[str, ...]
    tcps: Floats


def is_program(content: bytes) -> bool:
    """Whether a file's content is a `.urp`: packed, or XML that begins with URProgram."""
    return content.startswith(GZIP) or b"<URProgram" in content[:4096]


def unpacked(content: bytes, name: str) -> bytes:
    """Return the XML of a `.urp`, unpacked as far as `MAX_BYTES`."""
    too_large = InputError(f"{name} has more than {MAX_BYTES >> 20} MiB of XML, which is no program of PolyScope")
    if not content.startswith(GZIP):
        if len(content) > MAX_BYTES:
            raise too_large
        return content
    packed = zlib.decompressobj(wbits=31)
    try:
        text = packed.decompress(content, MAX_BYTES)
    except zlib.error as error:
        raise InputError(f"{name} is a damaged .urp: gzip: {error}") from None
    if packed.unconsumed_tail:
        raise too_large
    if not packed.eof:
        raise InputError(f"{name} is a damaged .urp: its end is missing")
    return text


def read_program(content: bytes, name: str) -> PolyScopeProgram:
    """Return the kinematics that the waypoints of a `.urp` carry.

    Raises:
        InputError: It is damaged, no program of PolyScope, or declares entities; a figure is no number or out of
            bounds.
    """
    reader = _Reader(name)
    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = reader.refuse_declarations
    parser.StartElementHandler, parser.EndElementHandler = reader.begin, reader.end
    try:
        parser.Parse(unpacked(content, name), True)
    except expat.ExpatError as error:
        raise InputError(f"{name} is not a .urp: its XML is damaged: {error}") from None
    if not reader.blocks and not reader.unusable:
        raise InputError(f"{name} has no waypoint with a robot's kinematics; save the program again on the robot")
    robots: dict[bytes, Kinematics] = {}
    for figures, waypoint, checksums in reader.blocks:
        known = robots.get(figures.tobytes(), Kinematics(figures, (), checksums))
        names = known.waypoints if waypoint in ("", *known.waypoints) else (*known.waypoints, waypoint)
        robots[figures.tobytes()] = known._replace(waypoints=names)
    ranked = sorted(robots.values(), key=lambda robot: -len(robot.waypoints))
    tcps = np.unique(np.array(reader.tcps).reshape(-1, 6), axis=0)
    return PolyScopeProgram(tuple(ranked), tuple(dict.fromkeys(reader.unusable)), tcps)


class _Reader:
    """Handlers of the XML parser; only elements that are needed are kept."""

    def __init__(self, name: str) -> None:
        self._name, self._depth = name, 0
        self._waypoint = ""
        self._block: dict[str, Any] | None = None
        self.blocks: list[tuple[Floats, str, str]] = []
        self.unusable: list[str] = []
        self.tcps: list[list[float]] = []

    def refuse_declarations(self, *declared: object) -> NoReturn:
        raise InputError(f"{self._name} declares a document type, which no program of PolyScope does")

    def begin(self, tag: str, attributes: Mapping[str, str]) -> None:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise InputError(f"{self._name} is nested deeper than {MAX_DEPTH} elements")
        if tag == "Waypoint":
            self._waypoint = attributes.get("name", "")
        elif tag.lower() == "kinematics":
            self._block = {"status": attributes.get("status", ""), "valid": attributes.get("validChecksum", "")}
        elif self._block is not None and tag in (*_FIGURES, "jointChecksum"):
            self._block[tag] = attributes.get("value", "")
        elif tag == "TCPOffset" and "pose" in attributes:
            self.tcps.append(self._numbers("TCPOffset", attributes["pose"]))

    def end(self, tag: str) -> None:
        self._depth -= 1
        if tag == "Waypoint":
            self._waypoint = ""
        elif tag.lower() == "kinematics" and self._block is not None:
            self._keep(self._block)
            self._block = None

    def _keep(self, block: Mapping[str, str]) -> None:
        missing = [figure for figure in _FIGURES if figure not in block]
        if missing:
            self.unusable.append(f"a block of kinematics lacks {', '.join(missing)}")
        elif block["status"] == "NOT_INITIALIZED":
            self.unusable.append(
                "its kinematics is NOT_INITIALIZED: the data sheet's, not a calibration; the program was written off "
                "the robot, open and save it on the robot"
            )
        elif block["valid"] != "true":
            self.unusable.append(f"its kinematics has no valid checksum (validChecksum={shown(block['valid'])})")
        else:
            figures = np.array([self._numbers(figure, block[figure]) for figure in _FIGURES])
            self.blocks.append((figures, self._waypoint, block.get("jointChecksum", "")))

    def _numbers(self, what: str, text: str) -> list[float]:
        bound = MAX_ANGLE if what in ("deltaTheta", "alpha") else MAX_SLIDE
        return six_numbers(f"{what} of {self._name}", text, bound)


def six_numbers(what: str, text: str, bound: float) -> list[float]:
    """Return six finite numbers, separated by commas, within ± a bound."""
    try:
        values = [float(word) for word in text.split(",")] if _NUMBERS.fullmatch(text) else []
    except ValueError:
        values = []
    if len(values) != 6 or not np.abs(values).max() <= bound:
        raise InputError(f"{what} must be six numbers within ±{bound:g}, got {shown(text)}")
    return values


class Export(NamedTuple):
    """Pairs of an exported program.

    Attributes:
        names: Of the waypoints.
        q: Numbers of `NAME_q=[...]`, as text, six a row.
        poses: Numbers of `NAME_p=p[...]`, as text, six a row.
        tcps: Tool centre point of each waypoint, as text; None where the program does not say it.
    """

    names: tuple[str, ...]
    q: list[list[str]]
    poses: list[list[str]]
    tcps: list[str | None]


def read_export(text: str) -> Export:
    """Return the waypoints of a `.script` that have joint angles and a pose, without repetitions."""
    angles, poses = (
        {name: numbers.split(",") for name, numbers in kind.findall(text) if _are_numbers(numbers)}
        for kind in (_QS, _PS)
    )
    names, seen = [], set()
    for name in angles:
        if name in poses and (key := (*angles[name], *poses[name])) not in seen:
            names.append(name)
            seen.add(key)
    tcps = _tcps_of(text, names)
    return Export(tuple(names), [angles[name] for name in names], [poses[name] for name in names], tcps)


def _tcps_of(text: str, names: Sequence[str]) -> list[str | None]:
    """The tool centre point that is set last before each waypoint's first use; if there is just one, that of all."""
    text = _COMMENT.sub("", text)
    variables = {name: numbers for name, numbers in _POSE_OF.findall(text) if _are_numbers(numbers)}
    places, tcps = [], []
    for found in _SET_TCP.finditer(text):
        numbers = found[1] if found[1] is not None else variables.get(found[2], "")
        places.append(found.start())
        tcps.append(",".join(repr(float(word)) for word in numbers.split(",")) if _are_numbers(numbers) else None)
    if len(set(tcps)) < 2:
        return [tcps[0] if tcps else None] * len(names)
    first: dict[str, int] = {}
    for use in _USE.finditer(text):
        first.setdefault(use[1], use.start())
    before = [bisect(places, first.get(name, 0)) for name in names]
    return [tcps[count - 1] if count else None for count in before]


def _are_numbers(text: str) -> bool:
    try:
        return len([float(word) for word in text.split(",")]) == 6
    except ValueError:
        return False
