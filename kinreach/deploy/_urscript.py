"""A strict parser of the URScript that kinreach writes. Nothing is evaluated by Python.

    program    = "def" NAME "():" body "end" | statement
    statement  = NAME "=" expression | call | "if" expression ":" body ["else:" body] "end"
    expression = term {"-" term} [">" term {"-" term}] {"or" ...}
    term       = NUMBER | STRING | "True" | "False" | NAME | NAME "[" expression "]" | call | list | "p" list | "-" term

A function that is not in `FUNCTIONS`, an argument that it does not have, and a name that was not assigned before are
refused when the text is read, before anything moves, as a controller refuses them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from kinreach._checks import shown
from kinreach.errors import InputError

#: Longest program that is read [characters], and deepest expression.
MAX_CHARACTERS, MAX_DEPTH = 2**25, 50
#: The functions and their parameters with the defaults of Universal Robots' manual; None must be given.
FUNCTIONS: Mapping[str, Mapping[str, float | bool | str | None]] = {
    "get_actual_joint_positions": {},
    "movej": {"q": None, "a": 1.4, "v": 1.05, "t": 0.0, "r": 0.0},
    "movel": {"pose": None, "a": 1.2, "v": 0.25, "t": 0.0, "r": 0.0},
    "norm": {"a": None},
    "popup": {"s": None, "title": "Popup", "warning": False, "error": False, "blocking": False},
    "servoj": {"q": None, "a": 0.0, "v": 0.0, "t": 0.002, "lookahead_time": 0.1, "gain": 300.0},
    "set_payload": {"m": None, "cog": None},
    "set_tcp": {"pose": None},
    "sleep": {"t": None},
    "stopj": {"a": None},
    "textmsg": {"s1": None, "s2": ""},
    "write_output_integer_register": {"output_id": None, "value": None},
}
#: Functions that return a value, only for expressions.
VALUES = ("get_actual_joint_positions", "norm")
_TOKEN = re.compile(
    r"(?P<space>[ \t\r]+|\#[^\n]*)|(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<string>\"[^\"\n]*\")|"
    r"(?P<pose>p(?=\[))|(?P<name>[A-Za-z_]\w*)|(?P<line>\n)|(?P<sign>[()\[\],:=>-])"
)
_KEYWORDS = ("def", "end", "if", "else", "or", "True", "False")


class ScriptError(InputError):
    """A program that is not run; the message has the line."""

    def __init__(self, line: int, text: str) -> None:
        super().__init__(f"line {line}: {text}")
        self.line = line


@dataclass(frozen=True)
class Constant:
    """A number, a truth value or a text."""

    value: float | bool | str


@dataclass(frozen=True)
class Numbers:
    """A list, or a pose."""

    entries: tuple[Expression, ...]
    is_pose: bool


@dataclass(frozen=True)
class Name:
    name: str


@dataclass(frozen=True)
class Entry:
    """An entry of a variable."""

    name: str
    index: Expression


@dataclass(frozen=True)
class Negative:
    value: Expression


@dataclass(frozen=True)
class Operation:
    """`-`, `>` or `or` between two values."""

    sign: str
    left: Expression
    right: Expression


@dataclass(frozen=True)
class Call:
    """A function with all of its parameters."""

    function: str
    arguments: Mapping[str, Expression]
    line: int


@dataclass(frozen=True)
class Assignment:
    name: str
    value: Expression
    line: int


@dataclass(frozen=True)
class Choice:
    condition: Expression
    then: tuple[Statement, ...]
    otherwise: tuple[Statement, ...]
    line: int


Expression = Constant | Numbers | Name | Entry | Negative | Operation | Call
Statement = Assignment | Call | Choice


@dataclass(frozen=True)
class Script:
    name: str  # empty for a single statement
    body: tuple[Statement, ...]


def parse(text: str) -> Script:
    if len(text) > MAX_CHARACTERS:
        raise ScriptError(1, f"a program may have {MAX_CHARACTERS} characters, got {len(text)}")
    return _Parser(text).program()


class _Parser:
    def __init__(self, text: str) -> None:
        self.tokens: list[tuple[str, str, int]] = []
        self.place, self.depth, self.known = 0, 0, set[str]()
        line, at = 1, 0
        for found in _TOKEN.finditer(text):
            if found.start() != at:
                break
            kind, at = str(found.lastgroup), found.end()
            if kind == "line":
                self.tokens.append((kind, "\n", line))
                line += 1
            elif kind != "space":
                self.tokens.append((kind, found[0], line))
        if at < len(text):
            raise ScriptError(line, f"syntax error at {shown(text[at])}")
        self.tokens.append(("line", "\n", line))
        self.tokens.append(("end of the program", "", line))

    @property
    def line(self) -> int:
        return self.tokens[self.place][2]

    def next_is(self, text: str) -> bool:
        return self.tokens[self.place][1] == text

    def take(self, text: str) -> None:
        if not self.next_is(text):
            self.refuse(f"{shown(text)} is expected")
        self.place += 1

    def take_kind(self, kind: str) -> str:
        if self.tokens[self.place][0] != kind:
            self.refuse(f"a {kind} is expected")
        self.place += 1
        return self.tokens[self.place - 1][1]

    def refuse(self, why: str) -> None:
        kind, text, line = self.tokens[self.place]
        raise ScriptError(line, f"syntax error: {why}, got {shown(text) if text else kind}")

    def skip_lines(self) -> None:
        while self.tokens[self.place][0] == "line":
            self.place += 1

    def program(self) -> Script:
        self.skip_lines()
        name, body = "", []
        if self.next_is("def"):
            self.place += 1
            name = self.take_kind("name")
            for sign in "():":
                self.take(sign)
            body = self.body("end")
            self.take("end")
            self.take("\n")
        else:
            body = [self.statement()]
        self.skip_lines()
        if self.tokens[self.place][1]:
            self.refuse("nothing more is expected")
        return Script(name, tuple(body))

    def body(self, *ends: str) -> list[Statement]:
        self.take("\n")
        self.go_deeper()
        statements: list[Statement] = []
        self.skip_lines()
        while not any(map(self.next_is, ends)):
            statements.append(self.statement())
            self.skip_lines()
        self.depth -= 1
        return statements

    def statement(self) -> Statement:
        line = self.line
        if self.next_is("if"):
            return self.choice()
        name = self.take_kind("name")
        if self.next_is("="):
            self.check_name(name)
            self.place += 1
            value = self.expression()
            self.take("\n")
            self.known.add(name)
            return Assignment(name, value, line)
        if not self.next_is("("):
            raise ScriptError(line, f"compile error: {shown(name)} is not in the URScript that kinreach runs")
        if name in VALUES:
            raise ScriptError(line, f"compile error: the value of {name} is not used")
        call = self.call(name, line)
        self.take("\n")
        return call

    def choice(self) -> Choice:
        line = self.line
        self.take("if")
        condition = self.expression()
        self.take(":")
        before = set(self.known)
        then = self.body("else", "end")
        in_then, self.known = self.known, set(before)
        otherwise: list[Statement] = []
        if self.next_is("else"):
            self.place += 1
            self.take(":")
            otherwise = self.body("end")
        self.known &= in_then
        self.take("end")
        self.take("\n")
        return Choice(condition, tuple(then), tuple(otherwise), line)

    def expression(self) -> Expression:
        if (number := self.plain_number()) is not None:
            return number
        value = self.comparison()
        while self.next_is("or"):
            self.place += 1
            value = Operation("or", value, self.comparison())
        return value

    def comparison(self) -> Expression:
        value = self.difference()
        if self.next_is(">"):
            self.place += 1
            value = Operation(">", value, self.difference())
        return value

    def difference(self) -> Expression:
        value = self.term()
        while self.next_is("-"):
            self.place += 1
            value = Operation("-", value, self.term())
        return value

    def term(self) -> Expression:
        kind, text, line = self.tokens[self.place]
        self.place += 1
        if kind == "number":
            if not math.isfinite(float(text)):
                raise ScriptError(line, f"syntax error: {shown(text)} is too large")
            return Constant(float(text))
        if kind == "string":
            return Constant(text[1:-1])
        if text == "-":
            self.go_deeper()
            value = self.term()
            self.depth -= 1
            if isinstance(value, Constant) and isinstance(value.value, float):
                return Constant(-value.value)
            return Negative(value)
        if text in ("True", "False"):
            return Constant(text == "True")
        if kind == "pose" or text == "[":
            if kind == "pose":
                self.take("[")
            return Numbers(tuple(self.entries("]")), kind == "pose")
        if kind != "name" or text in _KEYWORDS:
            self.place -= 1
            self.refuse("a value is expected")
        if self.next_is("("):
            if text in FUNCTIONS and text not in VALUES:
                raise ScriptError(line, f"compile error: {text} returns no value")
            return self.call(text, line)
        if text not in self.known:
            raise ScriptError(line, f"compile error: name {shown(text)} is not defined")
        if not self.next_is("["):
            return Name(text)
        self.place += 1
        index = self.expression()
        self.take("]")
        return Entry(text, index)

    def entries(self, end: str) -> list[Expression]:
        self.go_deeper()
        values: list[Expression] = []
        while not self.next_is(end):
            if values:
                self.take(",")
            values.append(self.expression())
        self.place += 1
        self.depth -= 1
        return values

    def plain_number(self) -> Constant | None:
        """Parse a number that is a whole argument or entry, as most of a long program is; None if it is not one."""
        negative = self.tokens[self.place][1] == "-"
        kind, text, _ = self.tokens[self.place + negative]
        if kind != "number" or self.tokens[self.place + negative + 1][1] not in (",", "]", ")"):
            return None
        value = float(text)
        if not math.isfinite(value):
            return None
        self.place += 1 + negative
        return Constant(-value if negative else value)

    def call(self, function: str, line: int) -> Call:
        if function not in FUNCTIONS:
            raise ScriptError(line, f"compile error: function {shown(function)} is not in the URScript that kinreach "
                              f"runs: {', '.join(FUNCTIONS)}")  # fmt: skip
        parameters = FUNCTIONS[function]
        self.take("(")
        self.go_deeper()
        given: dict[str, Expression] = {}
        while not self.next_is(")"):
            if given:
                self.take(",")
            name = self.parameter(function, given, line)
            given[name] = self.expression()
        self.place += 1
        self.depth -= 1
        for name, default in parameters.items():
            if name not in given:
                if default is None:
                    raise ScriptError(line, f"compile error: {function} needs the argument {name}")
                given[name] = Constant(default)
        return Call(function, given, line)

    def parameter(self, function: str, given: Mapping[str, Expression], line: int) -> str:
        """Name of the next argument: as it is written, or by its place."""
        parameters = list(FUNCTIONS[function])
        if self.tokens[self.place][0] == "name" and self.tokens[self.place + 1][1] == "=":
            name = self.take_kind("name")
            self.take("=")
            if name in given or name not in parameters:
                known = ", ".join(parameters) or "none"
                raise ScriptError(
                    line, f"compile error: {function} has no free argument {shown(name)}; it has: {known}"
                )
            return name
        if len(given) >= len(parameters) or list(given) != parameters[: len(given)]:
            raise ScriptError(line, f"compile error: {function} has {len(parameters)} arguments, by place before name")
        return parameters[len(given)]

    def check_name(self, name: str) -> None:
        if name in _KEYWORDS or name in FUNCTIONS:
            raise ScriptError(self.line, f"compile error: {shown(name)} cannot be a variable")

    def go_deeper(self) -> None:
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise ScriptError(self.line, f"more than {MAX_DEPTH} levels within one another")


def is_number(value: object) -> bool:
    """Return whether a value is a number; truth values are not."""
    return isinstance(value, float | int) and not isinstance(value, bool)


def number_text(value: float) -> str:
    """Write a number so that it is read back as it is, without an exponent where that is short."""
    text = f"{value:.12f}".rstrip("0").rstrip(".")
    return (text if text != "-0" else "0") if float(text) == value else repr(float(value))


def list_text(values: Sequence[float]) -> str:
    return f"[{', '.join(map(number_text, values))}]"
