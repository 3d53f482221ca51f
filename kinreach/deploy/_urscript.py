"""A strict parser of the URScript that kinreach writes. Nothing is evaluated by Python.

    program    = "def" NAME "():" body "end" | statement
    statement  = NAME "=" expression | call | "if" expression ":" body ["else:" body] "end"
    expression = term {"-" term} [">" term {"-" term}] {"or" ...}
    term       = NUMBER | STRING | "True" | "False" | NAME | NAME "[" expression "]" | call | list | "p" list | "-" term

A statement is a line, and so is each of "def", "if", "else:" and "end". Expressions are written as in Python. A STRING
has no backslash, and a variable's NAME is no keyword of Python.

A function that is not in `FUNCTIONS`, an argument that it does not have, and a name that was not assigned before are
refused when the text is read, before anything moves, as a controller refuses them.
"""

from __future__ import annotations

import ast
import re
import threading
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from keyword import iskeyword
from sys import float_info

from kinreach._checks import shown
from kinreach.errors import InputError

#: Longest program that is read, and longest line [characters]; most statements, and deepest expression.
MAX_CHARACTERS, MAX_LINE, MAX_STATEMENTS, MAX_DEPTH = 2**25, 2048, 2**18, 50
#: Lines without a statement that are read at a time.
EMPTY_LINES = 100
#: The functions and their parameters with the defaults of Universal Robots' manual; None must be given.
FUNCTIONS: Mapping[str, Mapping[str, float | bool | str | None]] = {
    "get_actual_joint_positions": {},
    "get_forward_kin": {"q": None, "tcp": None},
    "movej": {"q": None, "a": 1.4, "v": 1.05, "t": 0.0, "r": 0.0},
    "movel": {"pose": None, "a": 1.2, "v": 0.25, "t": 0.0, "r": 0.0},
    "norm": {"a": None},
    "pose_inv": {"p_from": None},
    "pose_trans": {"p_from": None, "p_from_to": None},
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
VALUES = ("get_actual_joint_positions", "get_forward_kin", "norm", "pose_inv", "pose_trans")
#: What a line may have before its comment; other signs are refused.
_TOKEN = re.compile(
    r"[ \t\r]+|(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?(?![\w.])|(?<!\w)\"[^\"\\]*\"(?!\s*\")"
    r"|[A-Za-z_]\w*|[()\[\],:=>-]",
    re.ASCII,
)
#: CPython 3.11 counts the depth of what it parses for all threads together, and fails where two parse.
_ONE_AT_A_TIME = threading.Lock()
_DEF, _IF = re.compile(r"def\s+([A-Za-z_]\w*)\s*\(\s*\)\s*:"), re.compile(r"if\b(.*):")
_ASSIGNMENT = re.compile(r"([A-Za-z_]\w*)\s*=(?!=)(.*)")


class ScriptError(InputError):
    """A program that is not run; the message has the line."""

    def __init__(self, line: int, text: str) -> None:
        super().__init__(f"line {line}: {text}")
        self.line = line


@dataclass(frozen=True, slots=True)
class Constant:
    """A number, a truth value or a text."""

    value: float | bool | str


@dataclass(frozen=True, slots=True)
class Numbers:
    """A list, or a pose."""

    entries: tuple[Expression, ...]
    is_pose: bool


@dataclass(frozen=True, slots=True)
class Name:
    name: str


@dataclass(frozen=True, slots=True)
class Element:
    """An element of a variable."""

    name: str
    index: Expression


@dataclass(frozen=True, slots=True)
class Negative:
    value: Expression


@dataclass(frozen=True, slots=True)
class Operation:
    """`-`, `>` or `or` between two values."""

    sign: str
    left: Expression
    right: Expression


@dataclass(frozen=True, slots=True)
class Call:
    """A function with all of its parameters."""

    function: str
    arguments: Mapping[str, Expression]
    line: int


@dataclass(frozen=True, slots=True)
class Assignment:
    name: str
    value: Expression
    line: int


@dataclass(frozen=True, slots=True)
class Choice:
    condition: Expression
    then: tuple[Statement, ...]
    otherwise: tuple[Statement, ...]
    line: int


Expression = Constant | Numbers | Name | Element | Negative | Operation | Call
Statement = Assignment | Call | Choice


@dataclass(frozen=True, slots=True)
class Script:
    name: str  # empty for a single statement
    body: tuple[Statement, ...]


def parse(text: str) -> Script:
    reading = parsing(text)
    while True:
        try:
            next(reading)
        except StopIteration as end:
            return end.value


def parsing(text: str) -> Generator[None, None, Script]:
    """Parse a program in parts of some 0.2 ms, each of which ends in a `yield`."""
    if len(text) > MAX_CHARACTERS:
        raise ScriptError(1, f"a program may have {MAX_CHARACTERS} characters, got {len(text)}")
    reader = _Reader(text)
    line, code = yield from reader.next()
    if found := _DEF.fullmatch(code):
        statements, _ = yield from reader.body("end")
        script = Script(found[1], statements)
    else:
        statement = yield from reader.statement(line, code)
        script = Script("", (statement,))
    if rest := (yield from reader.rest()):
        raise ScriptError(rest[0], f"syntax error: nothing more is expected, got {shown(rest[1])}")
    return script


class _Reader:
    """Reads a program line by line; Python's own parser, which runs nothing, divides what is within a line."""

    def __init__(self, text: str) -> None:
        self._text, self._place, self._line = text, 0, 0
        self.depth, self.statements, self.known = 0, 0, set[str]()

    def next(self) -> Generator[None, None, tuple[int, str]]:
        """Return the number of the next line that has code, and its code."""
        if found := (yield from self.rest()):
            return found
        raise ScriptError(self._line, "syntax error: the program ends where a statement is expected")

    def rest(self) -> Generator[None, None, tuple[int, str] | None]:
        """Return the same as `next`, or None at the end."""
        while self._place <= len(self._text):
            end = self._text.find("\n", self._place)
            end = len(self._text) if end < 0 else end
            content, self._place, self._line = self._text[self._place : end], end + 1, self._line + 1
            if code := _code(content, self._line):
                return self._line, code
            if self._line % EMPTY_LINES == 0:
                yield
        return None

    def body(self, *ends: str) -> Generator[None, None, tuple[tuple[Statement, ...], str]]:
        """Read statements up to one of the ends; return that, too."""
        self.depth += 1
        statements: list[Statement] = []
        while (found := (yield from self.next()))[1] not in ends:
            if self.depth > MAX_DEPTH:
                raise ScriptError(found[0], f"more than {MAX_DEPTH} levels within one another")
            if self.statements == MAX_STATEMENTS:
                raise ScriptError(found[0], f"a program may have {MAX_STATEMENTS} statements")
            self.statements += 1
            statement = yield from self.statement(*found)
            statements.append(statement)
            yield
        self.depth -= 1
        return tuple(statements), found[1]

    def statement(self, line: int, code: str) -> Generator[None, None, Statement]:
        if found := _IF.fullmatch(code):
            return (yield from self.choice(line, found[1]))
        if found := _ASSIGNMENT.fullmatch(code):
            name = found[1]
            if iskeyword(name) or name == "end" or name in FUNCTIONS:
                raise ScriptError(line, f"compile error: {shown(name)} cannot be a variable")
            value = self.expression(found[2], line)
            self.known.add(name)
            return Assignment(name, value, line)
        tree = self.tree(code, line)
        if not isinstance(tree, ast.Call):
            raise ScriptError(line, f"compile error: {shown(code)} is not in the URScript that kinreach runs")
        call = self.call(tree, line)
        if call.function in VALUES:
            raise ScriptError(line, f"compile error: the value of {call.function} is not used")
        return call

    def choice(self, line: int, condition: str) -> Generator[None, None, Choice]:
        asked = self.expression(condition, line)
        before = set(self.known)
        then, end = yield from self.body("else:", "end")
        in_then, self.known = self.known, before
        otherwise: tuple[Statement, ...] = ()
        if end == "else:":
            otherwise, _ = yield from self.body("end")
        self.known &= in_then
        return Choice(asked, then, otherwise, line)

    def expression(self, code: str, line: int) -> Expression:
        return self.value(self.tree(code, line), line)

    def tree(self, code: str, line: int) -> ast.expr:
        try:
            with _ONE_AT_A_TIME:
                return ast.parse(code.strip(), mode="eval").body
        except SyntaxError as error:
            reason = error.msg.partition(";")[0]  # what follows is advice on Python
            raise ScriptError(line, f"syntax error: {reason}, in {shown(code)}") from None
        except (ValueError, MemoryError, RecursionError):  # a number of too many digits, or too many brackets
            raise ScriptError(line, f"syntax error in {shown(code)}") from None

    def value(self, tree: ast.expr, line: int, depth: int = 0) -> Expression:
        if depth > MAX_DEPTH:
            raise ScriptError(line, f"more than {MAX_DEPTH} levels within one another")

        def inner(part: ast.expr) -> Expression:
            return self.value(part, line, depth + 1)

        match tree:
            case ast.Constant(value=bool() | str() as value):
                return Constant(value)
            case ast.Constant(value=int() | float() as number):
                if not abs(number) <= float_info.max:
                    raise ScriptError(line, f"syntax error: {shown(number)} is too large")
                return Constant(float(number))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                negated = inner(operand)
                if isinstance(negated, Constant) and isinstance(negated.value, float):
                    return Constant(-negated.value)
                return Negative(negated)
            case ast.List(elts=entries):
                return Numbers(tuple(map(inner, entries)), is_pose=False)
            case ast.Subscript(value=ast.Name(id="p"), slice=entries):
                parts = entries.elts if isinstance(entries, ast.Tuple) else [entries]
                return Numbers(tuple(map(inner, parts)), is_pose=True)
            case ast.Subscript(value=ast.Name(id=name), slice=index):
                return Element(self.defined(name, line), inner(index))
            case ast.Name(id=name):
                return Name(self.defined(name, line))
            case ast.BinOp(op=ast.Sub(), left=left, right=right):
                return Operation("-", inner(left), inner(right))
            case ast.Compare(left=left, ops=[ast.Gt()], comparators=[right]):
                return Operation(">", inner(left), inner(right))
            case ast.BoolOp(op=ast.Or(), values=sides) if len(sides) <= MAX_DEPTH:
                return reduce(partial(Operation, "or"), map(inner, sides))
            case ast.Call():
                call = self.call(tree, line, depth)
                if call.function not in VALUES:
                    raise ScriptError(line, f"compile error: {call.function} returns no value")
                return call
        raise ScriptError(line, "syntax error: a value is expected that the URScript of kinreach has")

    def defined(self, name: str, line: int) -> str:
        if name not in self.known:
            raise ScriptError(line, f"compile error: name {shown(name)} is not defined")
        return name

    def call(self, tree: ast.Call, line: int, depth: int = 0) -> Call:
        function = tree.func.id if isinstance(tree.func, ast.Name) else ""
        if function not in FUNCTIONS:
            raise ScriptError(line, f"compile error: function {shown(function)} is not in the URScript that kinreach "
                              f"runs: {', '.join(FUNCTIONS)}")  # fmt: skip
        parameters = FUNCTIONS[function]
        if len(tree.args) > len(parameters):
            raise ScriptError(line, f"compile error: {function} has {len(parameters)} arguments, got {len(tree.args)}")
        given = dict(zip(parameters, tree.args, strict=False))
        for keyword in tree.keywords:
            if keyword.arg is None or keyword.arg in given or keyword.arg not in parameters:
                known = ", ".join(parameters) or "none"
                raise ScriptError(
                    line, f"compile error: {function} has no free argument {shown(keyword.arg)}; it has: {known}"
                )
            given[keyword.arg] = keyword.value
        arguments: dict[str, Expression] = {name: self.value(value, line, depth + 1) for name, value in given.items()}
        for name, default in parameters.items():
            if name not in given:
                if default is None:
                    raise ScriptError(line, f"compile error: {function} needs the argument {name}")
                arguments[name] = Constant(default)
        return Call(function, arguments, line)


def _code(content: str, line: int) -> str:
    """Return what a line has before its comment, in the signs that are known."""
    if len(content) > MAX_LINE:
        raise ScriptError(line, f"syntax error at sign {MAX_LINE + 1}: a line may have {MAX_LINE}, got {len(content)}")
    end = 0
    while end < len(content) and content[end] != "#":
        found = _TOKEN.match(content, end)
        if found is None:
            raise ScriptError(line, f"syntax error at {shown(content[end])}")
        end = found.end()
    return re.sub(r"\s+:$", ":", content[:end].strip())


def is_number(value: object) -> bool:
    """Return whether a value is a number; truth values are not."""
    return isinstance(value, float | int) and not isinstance(value, bool)


def number_text(value: float) -> str:
    """Write a number so that it is read back as it is, without an exponent where that is short."""
    text = f"{value:.12f}".rstrip("0").rstrip(".")
    return (text if text != "-0" else "0") if float(text) == value else repr(float(value))


def list_text(values: Sequence[float]) -> str:
    return f"[{', '.join(map(number_text, values))}]"
