"""Pairs of joint angles and poses of the tool, from the files that an owner of an arm has.

Recordings of UR's RTDE client and of ur_rtde, PolyScope's exported programs, and tables as typed from a pendant or
written by a tracker. Units are taken from the header, or from the size of the numbers; every guess is a note.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from kinreach._checks import Floats, check_path, listed, shown
from kinreach._files import decoded, read_bytes
from kinreach._rotations import pose, rotation
from kinreach._rotations import turns as turns_of
from kinreach._tables import Table, table_of
from kinreach.errors import InputError
from kinreach.robots._polyscope import is_program, read_export
from kinreach.robots._ur import JOINTS

#: Largest file [bytes].
MAX_BYTES = 2**28
#: No joint of a UR turns further [rad], and no tool is farther from its base [m]: more are degrees and millimetres.
MAX_TURN, MAX_REACH = 2 * np.pi + 0.1, 8.0
#: A rotation vector may be a turn and a half long; a longer one is in degrees [rad].
MAX_ROTATION = 3 * np.pi
#: Rows whose rotations are tried as the tool's, and how far others may be off to count: [rad], and in medians.
CANDIDATES, ALIKE, TORN = 60, 0.05, 3.0
_MILLIMETRES, _DEGREES = "mm", "deg"
_POSE = ("x", "y", "z", "rx", "ry", "rz")
_RPY = ("roll", "pitch", "yaw")
_PENDANT = ["base", "shoulder", "elbow", "wrist1", "wrist2", "wrist3"]
_ROS = [joint.removesuffix("_joint") for joint in JOINTS]
#: Units as people write them.
_UNITS = dict.fromkeys(("mm", "millimetres", "millimeters"), "mm") | dict.fromkeys(("m", "metres", "meters"), "m")
_UNITS |= dict.fromkeys(("deg", "degree", "degrees", "°"), "deg") | dict.fromkeys(("rad", "radians"), "rad")
#: A column's name and the unit that may follow it: q1_deg, x [mm], rx(rad), base in °.
_HEADING = re.compile(rf"^(.*?)(?:[\s_]+in\s+|[\s_]*)[\[(]?({'|'.join(sorted(_UNITS, key=len, reverse=True))})?[\])]?$")


@dataclass(frozen=True, eq=False)
class PosePairs:
    """Postures of an arm, and where its tool was in them.

    Attributes:
        source: Name of the file, for messages.
        q: Joint angles [rad], shape (m, n).
        seen: Poses of the tool, shape (m, 4, 4), or its positions [m], shape (m, 3).
        tcp: Pose of the tool centre point on the flange in each row, shape (m, 4, 4); None if it is not recorded.
        places: Where each row is from, such as "line 12".
        steps: Last digit of the joint angles [rad], the positions [m] and the rotation vectors [rad].
        notes: What was assumed, a line each.
        velocity: Joint speeds [rad/s] and the tool's linear and angular speed [m/s, rad/s], shapes (m, n) and (m, 6);
            None if they are not recorded.
        target: Joint angles that were commanded [rad], shape (m, n); None if they are not recorded.
    """

    source: str
    q: Floats
    seen: Floats
    tcp: Floats | None = None
    places: tuple[str, ...] = ()
    steps: tuple[float, float, float] = (1e-12, 1e-12, 1e-12)
    notes: tuple[str, ...] = ()
    velocity: tuple[Floats, Floats] | None = None
    target: Floats | None = None

    def __len__(self) -> int:
        return len(self.q)

    @property
    def positions(self) -> Floats:
        """Of the tool [m], shape (m, 3)."""
        return self.seen[:, :3, 3] if self.has_rotations else self.seen

    @property
    def has_rotations(self) -> bool:
        return self.seen.ndim == 3

    @property
    def only_tcp(self) -> Floats | None:
        """The tool centre point if it is known and the same in all rows, shape (4, 4)."""
        return None if self.tcp is None or np.abs(self.tcp - self.tcp[0]).max() > 1e-9 else self.tcp[0]

    def place(self, row: int) -> str:
        """Where a row is from."""
        return self.places[row] if self.places else f"row {row + 1}"

    def rows(self, chosen: Sequence[int] | np.ndarray) -> PosePairs:
        """Return some of the rows."""
        chosen = np.asarray(chosen)
        chosen = np.flatnonzero(chosen) if chosen.dtype == np.bool_ else chosen
        return replace(
            self,
            q=self.q[chosen],
            seen=self.seen[chosen],
            tcp=None if self.tcp is None else self.tcp[chosen],
            places=tuple(self.places[row] for row in chosen) if self.places else (),
            velocity=None if self.velocity is None else (self.velocity[0][chosen], self.velocity[1][chosen]),
            target=None if self.target is None else self.target[chosen],
        )

    def with_tcp(self, T: Floats) -> PosePairs:
        """Return the same with one tool centre point in all rows."""
        return replace(self, tcp=np.tile(T, (len(self), 1, 1)))

    @classmethod
    def read(cls, file: str | Path, *, joints: Sequence[str] = ()) -> PosePairs:
        """Read pairs from an exported program (`.script`), or a table separated by commas, semicolons, tabs or spaces.

        Args:
            file: Its path.
            joints: Names that the arm's joints may have in the header.

        Raises:
            InputError: It is neither, lacks a column, or has cells that are no numbers, or rows of different units.
        """
        path = check_path("file", file)
        return pairs_of(read_bytes(path, "the recording", most=MAX_BYTES), path.name, joints=joints)

    def tool_on(self, flange: Floats) -> Floats:
        """Return the tool that explains the poses best on frames of the flange (m, 4, 4): the medians, shape (4, 4)."""
        tool = np.eye(4)
        if not self.has_rotations:
            back = np.einsum("mji,mj->mi", flange[:, :3, :3], self.seen - flange[:, :3, 3])
            tool[:3, 3] = np.median(back, axis=0)
            return tool
        from scipy.spatial.transform import Rotation  # takes as long to import as numpy

        X = np.linalg.inv(flange) @ self.seen
        turns = Rotation.from_matrix(X[:, :3, :3])
        middle = turns[int(np.argmin([np.median((turns * one.inv()).magnitude()) for one in turns[:CANDIDATES]]))]
        for _ in range(2):  # rows of two moments are off by more than the others
            apart = (turns * middle.inv()).magnitude()
            near = apart <= min(ALIKE, max(TORN * float(np.median(apart)), 1e-9))
            middle = turns[near].mean() if near.any() else middle
        tool[:3, :3] = middle.as_matrix()
        tool[:3, 3] = np.median(X[:, :3, 3], axis=0)
        return tool

    def joined(self, other: PosePairs) -> PosePairs:
        """Return the rows of both."""
        for what, one, two in (("joints", self.q, other.q), ("numbers a pose", self.seen[0], other.seen[0])):
            if one.shape[1:] != two.shape[1:]:
                raise InputError(f"{self.source} and {other.source} do not have the same number of {what}")
        if (self.tcp is None) != (other.tcp is None):
            without = self.source if self.tcp is None else other.source
            raise InputError(f"{without} does not say its tool centre point, the other file does: give it with tool=")
        places = (
            *(f"{place} of {self.source}" for place in self.places),
            *(f"{p} of {other.source}" for p in other.places),
        )
        return PosePairs(
            f"{self.source}, {other.source}",
            np.concatenate([self.q, other.q]),
            np.concatenate([self.seen, other.seen]),
            None if self.tcp is None or other.tcp is None else np.concatenate([self.tcp, other.tcp]),
            places,
            tuple(map(max, self.steps, other.steps)),  # type: ignore[arg-type]
            (*self.notes, *other.notes),
        )


def pairs_of(content: bytes, name: str, *, joints: Sequence[str] = ()) -> PosePairs:
    """As `PosePairs.read`, from the content of the file of that name."""
    if is_program(content):
        raise InputError(
            f"{name} has joint angles and a robot's figures, but no poses: needed is its export, a .script"
        )
    text = decoded(content, otherwise="latin-1")
    if "\0" in text:
        raise InputError(f"{name} is no text: it must be a .urp, a .script or a table of numbers")
    if _SCRIPT.search(content):
        return _from_export(text, name)
    table = table_of(text, name)
    if not table.cells:
        raise InputError(f"{name} has no rows of numbers")
    return _from_table(table, name, joints)


#: What a program in URScript has, and a table not.
_SCRIPT = re.compile(rb"^\s*def\s+\w+\s*\(|_p\s*=\s*p\[", re.MULTILINE)


def looks_like_rows(content: bytes) -> bool:
    """Whether a file's content is an exported program, or has a line of six numbers or more."""
    numbers = rb"[-+\d.eE,\"]+"
    return bool(
        _SCRIPT.search(content) or re.search(rb"^" + numbers + rb"(?:[;,\t ]+" + numbers + rb"){5}", content, re.M)
    )


def _from_export(text: str, name: str) -> PosePairs:
    export = read_export(text)
    if not export.names:
        raise InputError(f"{name} has no waypoint with joint angles and a pose (NAME_q=[...] and NAME_p=p[...])")
    steps = _last_digit(export.q), *(_last_digit([row[part] for row in export.poses]) for part in _PARTS)
    known = [row for row, tcp in enumerate(export.tcps) if tcp is not None]
    tcps = {tcp for tcp in export.tcps if tcp is not None}
    kept = known or list(range(len(export.names)))
    q, numbers = (np.array([rows[row] for row in kept], dtype=float) for rows in (export.q, export.poses))
    names = tuple(export.names[row] for row in kept)
    notes = []
    if len(tcps) > 1:
        notes.append(
            f"{name} sets {len(tcps)} tool centre points: each waypoint has the one that is set before its use"
        )
    if known and len(known) < len(export.names):
        left = listed([name for name, tcp in zip(export.names, export.tcps, strict=True) if tcp is None])
        notes.append(f"{left} of {name} are left out: which tool centre point they have is not known")
    tcp = pose(np.array([export.tcps[row].split(",") for row in known], dtype=float)) if known else None  # type: ignore[union-attr]
    return PosePairs(name, q, pose(numbers), tcp, names, steps, tuple(notes))  # type: ignore[arg-type]


_PARTS = (slice(0, 3), slice(3, 6))


class _Columns:
    """Numbers of a table by the names that their columns may have."""

    def __init__(self, table: Table, name: str) -> None:
        self.table, self._name = table, name
        titles = [title.strip().lower() for title in table.header]
        headings = [_HEADING.match(title) for title in titles]
        self._header = [_plain(title) for title in titles]
        self._titles = [_plain(match[1]) if match else "" for match in headings]
        self._units = [_UNITS.get(match[2] or "", "") if match else "" for match in headings]
        if titles and table.cells and any(table.cells[0]):  # a line of units below that of the names
            below = [cell.strip(" []()").lower() for cell in table.cells[0]]
            if all(not cell or cell in _UNITS or cell in _OTHER_UNITS for cell in below):
                self._units = [_UNITS.get(cell, unit) for cell, unit in zip(below, self._units, strict=True)]
                self.table = replace(table, cells=table.cells[1:], lines=table.lines[1:])

    def find(self, *choices: Sequence[str]) -> list[int] | None:
        """Return the places of the first set of columns that is complete."""
        for names in choices:
            wanted = [_plain(name.lower()) for name in names]
            for titles in (self._header, self._titles):
                if all(name in titles for name in wanted):
                    for place in map(titles.index, wanted):
                        if (count := titles.count(titles[place])) > 1:
                            raise InputError(f"{self._name} has {count} columns {self.table.header[place].lower()}")
                    return [titles.index(name) for name in wanted]
        return None

    def text(self, places: Sequence[int]) -> list[list[str]]:
        return [[row[place] for place in places] for row in self.table.cells]

    def numbers(self, places: Sequence[int]) -> Floats:
        return self.table.numbers(places)

    def unit(self, places: Sequence[int]) -> str:
        units = {self._units[place] for place in places} if self.table.header else {""}
        return units.pop() if len(units) == 1 else ""


#: Units of columns that are not needed.
_OTHER_UNITS = ("s", "ms", "-", "#", "rad/s", "deg/s", "°/s", "m/s", "mm/s", "n", "nm", "a", "kg")


def _plain(title: str) -> str:
    """A title without what people put between its words and digits."""
    return re.sub(r"[\s_.\-]+", "", title)


def _indexed(name: str, count: int = 6, first: int = 0) -> list[str]:
    return [f"{name}{index}" for index in range(first, first + count)]


class _Places(NamedTuple):
    """Where a table has what, as places of columns; None for what it does not have.

    Attributes:
        angles, position: Of joint angles, and of x, y, z.
        turn: Of a rotation vector, or of roll, pitch and yaw.
        rpy: Whether `turn` is the latter.
        offset: Of the tool centre point's six numbers.
    """

    angles: list[int]
    position: list[int]
    turn: list[int] | None
    rpy: bool
    offset: list[int] | None


def _places_by_width(width: int, count: int, name: str) -> _Places:
    """Columns without names: joint angles, position, rotation vector, tool centre point."""
    if width not in (count + 3, count + 6, count + 12):
        raise InputError(
            f"{name} has no header and {width} columns; needed are {count} joint angles and x, y, z, rx, ry, rz, "
            "or a first line that names the columns"
        )
    ends = [list(range(start, end)) for start, end in ((0, count), (count, count + 3), (count + 3, count + 6))]
    offset = list(range(count + 6, count + 12)) if width == count + 12 else None
    return _Places(ends[0], ends[1], ends[2] if width > count + 3 else None, False, offset)


def _places_by_name(columns: _Columns, header: Sequence[str], joints: Sequence[str], name: str) -> _Places:
    count = len(joints) or 6
    own = [list(joints), [joint.removesuffix("_joint") for joint in joints]] if joints else [JOINTS, _ROS, _PENDANT]
    angles = columns.find(
        _indexed("actual_q_", count), _indexed("q", count, 1), _indexed("q", count), _indexed("j", count, 1),
        _indexed("joint", count, 1), _indexed("theta", count, 1), _indexed("axis", count, 1), *own,
    )  # fmt: skip
    tool = columns.find(_indexed("actual_tcp_pose_"))
    position = tool[:3] if tool else columns.find(_POSE[:3])
    turn, rpy = tool[3:] if tool else columns.find(_POSE[3:]), columns.find(_RPY)
    of_tcp = [f"tcp_{part}" for part in _POSE]  # the tool's pose where there is no other, else its offset
    if position is None and (found := columns.find(of_tcp)):
        position, turn, of_tcp = found[:3], found[3:], []
    elif position is None and (found := columns.find(of_tcp[:3])):
        position, of_tcp = found, []
    for what, found, example in (("joint angles", angles, "actual_q_0 or q1"), ("positions", position, "x or X (mm)")):
        if found is None:
            raise InputError(
                f"{name} has no columns of {what} ({example}, ...); its first line must name them, got "
                f"{shown(', '.join(header))}"
            )
    offset = columns.find(_indexed("tcp_offset_"), *[of_tcp] * bool(of_tcp))
    return _Places(angles or [], position or [], turn or rpy, turn is None, offset)


def _from_table(table: Table, name: str, joints: Sequence[str]) -> PosePairs:
    columns = _Columns(table, name)
    count = len(joints) or 6
    if table.header:
        places = _places_by_name(columns, table.header, joints, name)
    else:
        places = _places_by_width(len(table.cells[0]), count, name)
    table = columns.table
    if not table.cells:
        raise InputError(f"{name} has no rows of numbers")
    q, q_note = _in_radians(columns, places.angles, name, "joint angles", MAX_TURN)
    seen, p_note = _in_metres(columns, places.position, name)
    r_note, last_turn = "", 1e-12
    if places.turn is not None:
        turns, r_note = _in_radians(columns, places.turn, name, "rotations", MAX_ROTATION)
        last_turn = _last_digit(columns.text(places.turn)) * (np.pi / 180 if r_note else 1.0)
        rotations = np.array([rotation(each) for each in turns]) if places.rpy else turns_of(turns)
        seen, points = np.tile(np.eye(4), (len(q), 1, 1)), seen
        seen[:, :3, :3], seen[:, :3, 3] = rotations, points
    tcp = None
    if places.offset is not None:
        numbers = columns.numbers(places.offset)
        numbers[:, :3] *= 1e-3 if np.abs(numbers[:, :3]).max() > MAX_REACH else 1.0
        tcp = pose(numbers)
    speeds = [columns.find(_indexed("actual_qd_", count)), columns.find(_indexed("actual_tcp_speed_"))]
    target = columns.find(_indexed("target_q_", count))
    return PosePairs(
        name,
        q,
        seen,
        tcp,
        tuple(f"line {line}" for line in table.lines),
        (
            _last_digit(columns.text(places.angles)) * (np.pi / 180 if q_note else 1.0),
            _last_digit(columns.text(places.position)) * (1e-3 if p_note else 1.0),
            last_turn,
        ),
        tuple(note for note in (q_note, p_note, r_note) if note),
        None if speeds[0] is None or speeds[1] is None else (columns.numbers(speeds[0]), columns.numbers(speeds[1])),
        None if target is None else columns.numbers(target),
    )


def _in_radians(columns: _Columns, places: Sequence[int], name: str, what: str, most: float) -> tuple[Floats, str]:
    values = columns.numbers(places)
    unit = columns.unit(places)
    beyond = np.abs(values).max(axis=1) > most
    if unit in ("", "rad") and beyond.any():
        _refuse_mixed(columns, beyond, name, what, "degrees", "radians")
        return np.radians(values), f"the {what} of {name} are larger than radians can be: read as degrees"
    if unit == _DEGREES:
        return np.radians(values), f"the {what} of {name} are degrees, by its header"
    return values, ""


def _in_metres(columns: _Columns, places: Sequence[int], name: str) -> tuple[Floats, str]:
    values = columns.numbers(places)
    unit = columns.unit(places)
    beyond = np.linalg.norm(values, axis=1) > MAX_REACH
    if unit == _MILLIMETRES:
        return 1e-3 * values, f"the positions of {name} are millimetres, by its header"
    if unit == "" and beyond.any():
        _refuse_mixed(columns, beyond, name, "positions", "millimetres", "metres")
        return 1e-3 * values, f"the positions of {name} are larger than metres can be: read as millimetres"
    return values, ""


def _refuse_mixed(columns: _Columns, beyond: np.ndarray, name: str, what: str, one: str, other: str) -> None:
    """Refuse rows of two units: where most are beyond the bound, a row that is not may be at home."""
    if beyond.all():
        return
    lines = [columns.table.lines[row] for row in np.flatnonzero(beyond if beyond.mean() < 0.5 else ~beyond)]
    shown_lines = ", ".join(map(str, lines[:5])) + (", ..." if len(lines) > 5 else "")
    few, many = (one, other) if beyond.mean() < 0.5 else (other, one)
    raise InputError(f"{name} mixes units: the {what} of line {shown_lines} look like {few}, the others like {many}")


def _last_digit(rows: Sequence[Sequence[str]]) -> float:
    """Return the last decimal place that the numbers of some rows are written with."""
    places = [0]
    for row in rows[:200]:
        for cell in row:
            mantissa, _, exponent = cell.strip().lower().partition("e")
            places.append(len(mantissa.partition(".")[2]) - int(exponent or 0))
    return 10.0 ** -min(max(places), 15)
