"""Whether JSON that a file holds is a section of results: by the schema, and by what a schema cannot say."""

from __future__ import annotations

import json
from math import isfinite
from pathlib import Path
from typing import Any

from benchmarks.speed.suite import Section

#: Apart from 0, what a benchmark measures is no nearer to 0 and no farther from it than this and its inverse.
SMALLEST = 1e-18
#: Longest text, and longest name in a figure [characters].
LONGEST_TEXT, LONGEST_NAME = 20_000, 200
#: More panels, and more bars or lines, are no figure of ours.
MOST_CHARTS, MOST_MARKS = 40, 400
#: Keywords of JSON Schema that are understood here: `results.schema.json` uses no others below `section`.
KEYWORDS = frozenset(
    {"$ref", "type", "enum", "properties", "required", "additionalProperties", "items", "minItems", "maxItems",
     "description", "minimum"}
)  # fmt: skip
_TYPES = {"string": str, "boolean": bool, "null": type(None), "array": list, "object": dict}
_DEFINITIONS: dict[str, Any] = {}


def definitions() -> dict[str, Any]:
    """The schemas of a section and its parts, by name."""
    if not _DEFINITIONS:
        schema = json.loads(Path(__file__).with_name("results.schema.json").read_text(encoding="utf-8"))
        _DEFINITIONS.update(schema["$defs"])
    return _DEFINITIONS


def check_sections(values: Any) -> list[Section]:
    """The sections of all suites that somebody's file holds, as they can be shown and drawn.

    Args:
        values: A list of what may be sections, as JSON types.

    Raises:
        ValueError: Something in them is of another type, missing, too much, not finite, or nothing to be printed.
    """
    sections = []
    for value in values:
        _check(value, definitions()["section"])
        section = Section.from_json(value)
        if any(len(row) != len(section.columns) for row in section.rows):
            raise ValueError("a row has as many cells as there are columns")
        sections.append(section)
    charts = [chart for section in sections for chart in section.charts]
    names = [name for c in charts for name in (c.title, c.x, c.y, *c.bars, *c.lines)]
    if len(charts) > MOST_CHARTS or len(names) > 3 * len(charts) + MOST_MARKS:
        raise ValueError("too much for a figure")
    if any(len(name) > LONGEST_NAME for name in names):
        raise ValueError("too long a name for a figure")
    return sections


def _check(value: Any, schema: dict[str, Any]) -> None:
    if "$ref" in schema:
        schema = definitions()[schema["$ref"].rpartition("/")[2]]
    wanted = schema.get("type", [])
    if wanted and not any(_is(value, name) for name in ([wanted] if isinstance(wanted, str) else wanted)):
        raise ValueError(f"of type {type(value).__name__}, not {wanted}")
    if "enum" in schema and value not in schema["enum"]:
        raise ValueError(f"not one of {schema['enum']}")
    if isinstance(value, str):
        _check_text(value)
    elif isinstance(value, dict):
        _check_object(value, schema)
    elif isinstance(value, list):
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
            raise ValueError(f"{len(value)} items")
        for item in value:
            _check(item, schema["items"])
    elif _is(value, "number"):
        _check_size(value, schema)


def _check_object(value: dict[str, Any], schema: dict[str, Any]) -> None:
    if missing := [name for name in schema.get("required", ()) if name not in value]:
        raise ValueError(f"without {missing}")
    for name, entry in value.items():
        inner = schema.get("properties", {}).get(name, schema["additionalProperties"])
        if inner is False:
            raise ValueError("an entry that is none of a section's")
        _check_text(name)
        _check(entry, inner)


def _check_size(value: float, schema: dict[str, Any]) -> None:
    size = abs(float(value))  # an integer of too many digits raises OverflowError
    if not isfinite(size) or (size and not SMALLEST <= size <= 1 / SMALLEST) or value < schema.get("minimum", value):
        raise ValueError("a number that is nothing measured")


def _check_text(text: str) -> None:
    """What a terminal would obey instead of printing it is refused."""
    if len(text) > LONGEST_TEXT or not text.replace("\n", "").isprintable():
        raise ValueError("a text that cannot be printed")


def _is(value: Any, name: str) -> bool:
    if name == "number":
        return isinstance(value, int | float) and not isinstance(value, bool)
    return isinstance(value, _TYPES[name])
