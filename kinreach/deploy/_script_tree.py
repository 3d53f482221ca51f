"""What a URScript program is made of, and how one is refused."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from kinreach.errors import InputError


class Place(NamedTuple):
    """Where something stands in a program; column 0 is the whole line."""

    line: int
    column: int = 0


class ScriptError(InputError):
    """A program that is not run, or not run any further; the message has the line, and the column if one is known."""

    def __init__(self, place: Place | int, text: str) -> None:
        place = place if isinstance(place, Place) else Place(place)
        column = f", column {place.column}" if place.column else ""
        super().__init__(f"line {place.line}{column}: {text}")
        self.line, self.column = place


@dataclass(frozen=True, slots=True)
class Constant:
    """A number, a truth value or a text; None where an argument is left out that has no default value."""

    value: float | bool | str | None


@dataclass(frozen=True, slots=True)
class Numbers:
    """A list, or a pose."""

    entries: tuple[Expression, ...]
    is_pose: bool
    place: Place = field(default=Place(1), compare=False)


@dataclass(frozen=True, slots=True)
class Name:
    name: str
    place: Place = field(default=Place(1), compare=False)


@dataclass(frozen=True, slots=True)
class Element:
    """An entry of a list, a pose or a text."""

    of: Expression
    index: Expression
    place: Place = field(default=Place(1), compare=False)


@dataclass(frozen=True, slots=True)
class Negative:
    """`-` or `not` before a value."""

    value: Expression
    sign: str = "-"
    place: Place = field(default=Place(1), compare=False)


@dataclass(frozen=True, slots=True)
class Operation:
    """A sign between two values."""

    sign: str
    left: Expression
    right: Expression
    place: Place = field(default=Place(1), compare=False)


@dataclass(frozen=True, slots=True)
class Call:
    """A function of the controller with all of its parameters."""

    function: str
    arguments: Mapping[str, Expression]
    place: Place = field(default=Place(1), compare=False)


@dataclass(frozen=True, slots=True)
class OwnCall:
    """A function that the program defines, with the arguments as they are written; `run` starts a thread."""

    function: str
    positional: tuple[Expression, ...]
    keywords: Mapping[str, Expression]
    is_run: bool = False
    place: Place = field(default=Place(1), compare=False)


@dataclass(frozen=True, slots=True)
class Assignment:
    """`name = value`; `indices` if an element is assigned, `scope` is "", "global" or "local"."""

    name: str
    value: Expression
    place: Place = field(default=Place(1), compare=False)
    indices: tuple[Expression, ...] = ()
    scope: str = ""


@dataclass(frozen=True, slots=True)
class Choice:
    condition: Expression
    then: tuple[Statement, ...]
    otherwise: tuple[Statement, ...]
    place: Place = field(default=Place(1), compare=False)


@dataclass(frozen=True, slots=True)
class While:
    condition: Expression
    body: tuple[Statement, ...]
    place: Place = field(default=Place(1), compare=False)


@dataclass(frozen=True, slots=True)
class Order:
    """A word that is a statement: `break`, `halt`, `return value`, `join thread`, and others."""

    word: str
    value: Expression | None = None
    place: Place = field(default=Place(1), compare=False)


@dataclass(frozen=True, slots=True)
class Definition:
    """A function, a thread, or a program; `parameters` with their default values, or `Required`."""

    kind: str
    name: str
    parameters: Mapping[str, Any]
    body: tuple[Statement, ...]
    place: Place = field(default=Place(1), compare=False)


Expression = Constant | Numbers | Name | Element | Negative | Operation | Call | OwnCall
Statement = Assignment | Call | OwnCall | Choice | While | Order | Definition


def is_number(value: object) -> bool:
    """Return whether a value is a number; truth values are not."""
    return isinstance(value, float | int) and not isinstance(value, bool)


def number_text(value: float) -> str:
    """Write a number so that it is read back as it is, without an exponent where that is short."""
    text = f"{value:.12f}".rstrip("0").rstrip(".")
    return (text if text != "-0" else "0") if float(text) == value else repr(float(value))


def list_text(values: Sequence[float]) -> str:
    return f"[{', '.join(map(number_text, values))}]"
