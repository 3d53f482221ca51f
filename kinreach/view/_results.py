"""Results of a comparison, goal by goal, read from files that are checked."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from kinreach._checks import MAX_ANGLE, MAX_DISTANCE, Floats, check_path, shown
from kinreach._files import read_text
from kinreach._tables import Table, read_table
from kinreach.errors import InputError
from kinreach.plots.inside import method_colours
from kinreach.robots import arm_names

#: Names of the files; a trial has about 700 bytes.
RESULTS, TRIALS = "results.json", "results.csv"
MAX_BYTES = 256 * 1024 * 1024
#: Largest number of goals and methods.
MAX_GOALS, MAX_METHODS = 20_000, 64


@dataclass(frozen=True, eq=False)
class End:
    """The end of a method on a goal.

    Attributes:
        reached: Whether it met the task's criterion.
        distance: Tip to goal [m].
        reason: Why it was impossible; empty if it was not.
        tip: In the world [m], shape (3,); None if not written.
        q: Posture [rad], shape (n,); None if not written.
    """

    reached: bool
    distance: float
    reason: str
    tip: Floats | None
    q: Floats | None


@dataclass(frozen=True, eq=False)
class Results:
    """A comparison.

    Attributes:
        file: Of its summary.
        title: Of its task.
        arm: Name of the arm; empty if it is not in the package.
        colours: Of the methods, by name, red, green and blue of 0 to 255.
        goals: In the world [m], shape (count, 3).
        ends: Of each goal, by method.
    """

    file: Path
    title: str
    arm: str
    colours: Mapping[str, tuple[int, int, int]]
    goals: Floats
    ends: tuple[Mapping[str, End], ...]

    def reached(self, method: str) -> list[bool]:
        """Return whether a method reached each of the goals that it tried."""
        return [ends[method].reached for ends in self.ends if method in ends]

    def distances(self, method: str) -> Floats:
        """Return the distances of a method from the goals [m], shape (count,); NaN if unknown."""
        return np.array([ends[method].distance if method in ends else np.nan for ends in self.ends])


def read_results(file: str | Path) -> Results:
    """Read the results of `kinreach compare`: `results.json`, and `results.csv` beside it.

    Args:
        file: The JSON, or its folder.

    Raises:
        InputError: A file cannot be read or has wrong content; the message names both.
    """
    path = check_path("results", file)
    if path.is_dir():
        path = path / RESULTS
    text = read_text(path, "the results", most=MAX_BYTES)
    try:
        content = json.loads(text, parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is not JSON: {error}") from None
    try:
        names, settings = _summary(content)
    except InputError as error:
        raise InputError(f"{path} was not written by a comparison: {error}") from None
    trials = path.parent / TRIALS
    table = read_table(trials, "the trials", most=MAX_BYTES)
    try:
        goals, ends = _trials(table, names)
    except InputError as error:
        raise InputError(f"{trials} was not written by a comparison: {error}") from None
    task, arm = str(settings.get("task", "")), str(settings.get("arm", ""))
    colours = {name: _rgb(colour) for name, colour in method_colours(names).items()}
    return Results(path, str(settings.get("title", task)), arm if arm in arm_names() else "", colours, goals, ends)


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is not a JSON number")


def _rgb(colour: str) -> tuple[int, int, int]:
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue


def _summary(content: Any) -> tuple[list[str], dict[str, Any]]:
    """Names of the methods, and settings."""
    if not isinstance(content, dict) or not isinstance(content.get("methods"), list):
        raise InputError("it has no list 'methods'")
    settings = content.get("settings")
    if not isinstance(settings, dict):
        raise InputError("it has no 'settings'")
    names: list[str] = []
    for entry in content["methods"]:
        name = entry.get("name") if isinstance(entry, dict) else None
        if not isinstance(name, str) or not name.isprintable() or name in names:
            raise InputError(f"a method needs a name of its own, got {shown(name)}")
        names.append(name)
    if not 0 < len(names) <= MAX_METHODS:
        raise InputError(f"it must have 1 to {MAX_METHODS} methods, got {len(names)}")
    return names, settings


def _trials(table: Table, methods: Collection[str]) -> tuple[Floats, tuple[Mapping[str, End], ...]]:
    needed = ("goal_index", "method", "goal", "distance", "reached")
    missing = [name for name in needed if name not in table.header]
    if missing:
        raise InputError(f"it has no column {missing[0]!r}")
    goals: dict[int, Floats] = {}
    ends: dict[int, dict[str, End]] = {}
    for row in table.rows:
        if row["method"] in methods:
            index, goal, end = _trial(row)
            goals.setdefault(index, goal)
            ends.setdefault(index, {})[row["method"]] = end
        if len(goals) > MAX_GOALS:
            raise InputError(f"it has more than {MAX_GOALS} goals")
    if not goals:
        raise InputError("it has no trials")
    order = sorted(goals)
    return np.array([goals[index] for index in order]), tuple(ends[index] for index in order)


def _trial(row: Mapping[str, str]) -> tuple[int, Floats, End]:
    """Index of the goal, the goal, and the end of a row."""
    (index,) = _vector(row, "goal_index", MAX_DISTANCE, size=1)
    distance = _vector(row, "distance", MAX_DISTANCE, size=1) if row["distance"] else np.array([np.nan])
    tip = _vector(row, "tip", MAX_DISTANCE, size=3) if row.get("tip") else None
    q = _vector(row, "q", MAX_ANGLE) if row.get("q") else None
    end = End(row["reached"] in ("1", "True"), float(distance[0]), row.get("impossible_reason") or "", tip, q)
    return int(index), _vector(row, "goal", MAX_DISTANCE, size=3), end


def _vector(row: Mapping[str, str], name: str, most: float, *, size: int | None = None) -> Floats:
    """A field's numbers, shape (size,)."""
    try:
        values = np.array([float(word) for word in (row[name] or "").split()])
    except ValueError:
        values = np.array([np.nan])
    if (size is not None and len(values) != size) or not len(values) or not (np.abs(values) <= most).all():
        raise InputError(f"{name} must be {size or 'some'} numbers within ±{most:g}, got {shown(row[name])}")
    return values
