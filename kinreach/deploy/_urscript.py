r"""The grammar of URScript, and its reader: from a text to a tree. Nothing is evaluated by Python.

A statement is a line, and so is each of "def", "if", "elif", "else:", "while", "thread" and "end". A value may begin in
the line after its "=", and "global" or "local" may follow in the same line: ur_rtde's control script is written so.
`$` begins the label of a program line, which does nothing, nor does `set real`. Names, functions and their arguments
are checked when a text is read, before anything moves, as a controller checks them.
"""

from __future__ import annotations

import re
from collections.abc import Generator
from functools import cache
from sys import float_info
from typing import TYPE_CHECKING, Any

from kinreach._checks import shown
from kinreach.deploy._script_code import Code, compiling
from kinreach.deploy._script_functions import FUNCTIONS, Required, bound
from kinreach.deploy._script_tree import (
    Assignment,
    Call,
    Choice,
    Constant,
    Definition,
    Element,
    Expression,
    Name,
    Negative,
    Numbers,
    Operation,
    Order,
    OwnCall,
    Place,
    ScriptError,
    Statement,
    While,
)

if TYPE_CHECKING:
    from lark import Lark, Token

#: Longest program that is read, and longest line [characters]; most statements, deepest expression or block, and most
#: signs of operations in a line.
MAX_CHARACTERS, MAX_LINE, MAX_STATEMENTS, MAX_DEPTH, MAX_OPERATIONS = 2**25, 2**13, 2**18, 50, 300
#: Lines without a statement, and words, that are read at a time.
EMPTY_LINES, WORDS = 100, 16

_GRAMMAR = r"""
start: _NL* _line*
block: _NL+ _line*
_line: statement scoped* _NL+
?statement: NAME "=" _NL* _value -> assigned
    | scoped
    | NAME _index+ "=" _NL* _value -> assigned_element
    | (POSE | POSE_BEGIN _value "]") _index* "=" _NL* _value -> assigned_element_of_p
    | call
    | (DEF | THREAD | SEC) NAME "(" [parameters] ")" COLON block END -> definition
    | IF _value COLON block (ELIF _value COLON block)* [ELSE COLON block] END -> choice
    | WHILE _value COLON block END -> loop
    | (RETURN | KILL | JOIN) _value -> order
    | (RETURN | BREAK | CONTINUE | HALT | ENTER_CRITICAL | EXIT_CRITICAL) -> order
    | RUN NAME "(" ")" -> started
    | (LABEL | MODE) -> label
?scoped: (GLOBAL | LOCAL) NAME "=" _NL* _value -> assigned_in
parameters: parameter ("," parameter)*
parameter: NAME ["=" _value]
_index: LSQB _value "]"
_value: or_
?or_: and_ | or_ (OR | XOR) and_ -> operation
?and_: not_ | and_ AND not_ -> operation
?not_: compared | NOT not_ -> negative
?compared: sum | sum COMPARISON sum -> operation
?sum: product | sum (PLUS | MINUS) product -> operation
?product: unary | product (STAR | SLASH | PERCENT) unary -> operation
?unary: part | MINUS unary -> negative
?part: atom | part LSQB _value "]" -> element
?atom: NUMBER -> number
    | STRING -> string
    | TRUE -> truth
    | FALSE -> truth
    | NAME -> name
    | LIST -> numbers
    | LSQB [_value ("," _value)*] "]" -> entries
    | POSE -> numbers
    | POSE_BEGIN _value ("," _value)* "]" -> entries
    | LPAR _value ")" -> within
    | RUN NAME "(" ")" -> started
    | call
call: NAME LPAR [argument ("," argument)*] ")"
    | FLAT_CALL -> flat_call
argument: NAME "=" _value -> keyword
    | _value -> positional

DEF: "def"
THREAD: "thread"
SEC: "sec"
IF: "if"
ELIF: "elif"
ELSE: "else"
WHILE: "while"
END: "end"
RETURN: "return"
BREAK: "break"
CONTINUE: "continue"
HALT: "halt"
RUN: "run"
KILL: "kill"
JOIN: "join"
ENTER_CRITICAL: "enter_critical"
EXIT_CRITICAL: "exit_critical"
GLOBAL: "global"
LOCAL: "local"
OR: "or"
XOR: "xor"
AND: "and"
NOT: "not"
TRUE.2: /(True|true)\b/
FALSE.2: /(False|false)\b/
COLON: ":"
LPAR: "("
LSQB: "["
PLUS: "+"
MINUS: "-"
STAR: "*"
SLASH: "/"
PERCENT: "%"
COMPARISON: "==" | "!=" | "<=" | ">=" | "<" | ">"
LABEL: /\$[^\n]*/
MODE.5: /set[ \t]+(sim|real)\b[^\n]*/
NAME: /[A-Za-z_][A-Za-z0-9_]*/
NUMBER: /@(?![\w.])/
STRING: /"[^"\n]*"/
FLAT_CALL.4: /[A-Za-z_]\w*\(&(,&)*\)/
LIST.2: /~/
POSE.3: /p~/
POSE_BEGIN.2: "p["
COMMENT: /#[^\n]*/
_NL: /(\n[ \t\r]*(#[^\n]*)?){1,LINES}/
%ignore /[ \t\r]+/
%ignore COMMENT
"""
#: A number, a list or pose of numbers, and an argument that is one of both, in the grammar's `@`, `~` and `&`.
_NUMBER = r"(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?"
_LIST = r"\[[ \t]*-?@[ \t]*(,[ \t]*-?@[ \t]*)*\]"
_FLAT = r"[ \t]*([A-Za-z_]\w*[ \t]*=[ \t]*)?(p?~|-?@)[ \t]*"
#: An argument of a `FLAT_CALL`: its name, a list, a number.
_ARGUMENT = re.compile(r"\s*(?:([A-Za-z_]\w*)\s*=\s*)?(?:(p?\[[^\]]*\])|([^,)]+))[\s,)]*")
#: What words are called that were expected.
_WORDS = {
    "_NL": "the end of the line", "COLON": "':'", "END": "'end'", "RPAR": "')'", "RSQB": "']'", "COMMA": "','",
    "EQUAL": "'='", "LPAR": "'('", "LSQB": "'['", "NAME": "a name", "ELSE": "'else'", "ELIF": "'elif'",
}  # fmt: skip


class Script:
    """A program that was read.

    Attributes:
        name: Empty for a single statement.
        body: Its statements.
        is_secondary: Whether it runs beside another program: `sec` in place of `def`.
        code: For the interpreter.
    """

    __slots__ = ("body", "code", "is_secondary", "name")

    def __init__(self, name: str, body: tuple[Statement, ...], *, is_secondary: bool, code: Code) -> None:
        self.name, self.body, self.is_secondary, self.code = name, body, is_secondary, code


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
    statements = yield from _tree(text)
    name, body, is_secondary = _program(statements)
    code = yield from compiling(body, is_secondary=is_secondary)
    return Script(name, body, is_secondary=is_secondary, code=code)


def _program(statements: tuple[Statement, ...]) -> tuple[str, tuple[Statement, ...], bool]:
    """Return name and statements of the program that a text is: one definition, which may be called, or a statement."""
    if not statements:
        raise ScriptError(1, "syntax error: the program ends where a statement is expected")
    first, *others = statements
    if not isinstance(first, Definition):
        if others:
            raise ScriptError(others[0].place, "syntax error: nothing more is expected after a statement")
        return "", statements, False
    if first.kind == "thread":
        raise ScriptError(first.place, "compile error: a thread belongs into a program")
    calls = [other for other in others if isinstance(other, OwnCall) and other.function == first.name]
    if len(others) > 1 or len(calls) != len(others):
        raise ScriptError(others[0].place, "syntax error: nothing more is expected after the end of a program")
    if first.parameters or (calls and (calls[0].positional or calls[0].keywords)):
        if not calls:
            raise ScriptError(
                first.place, f"compile error: the program {first.name} has arguments, and nothing calls it"
            )
        return first.name, (first, calls[0]), first.kind == "sec"
    return first.name, first.body, first.kind == "sec"


def _tree(text: str) -> Generator[None, None, tuple[Statement, ...]]:
    from lark.exceptions import UnexpectedCharacters, UnexpectedToken, VisitError

    yield from _checked_lines(text)
    reading = grammar().parse_interactive(text + "\n")
    bounds, words = _Bounds(), 0
    try:
        for token in reading.iter_parse():
            bounds.count(token)
            words += 1
            if token.type == "_NL" or words == WORDS:
                words = 0
                yield
        tree: tuple[Statement, ...] = reading.feed_eof()  # type: ignore[no-untyped-call]
        return tree
    except VisitError as error:
        raise error.orig_exc from None
    except UnexpectedCharacters as error:
        place = Place(error.line, error.column)
        raise ScriptError(place, f"syntax error at {shown(error.char)}") from None
    except UnexpectedToken as error:
        token = error.token
        if token.type == "$END":
            raise ScriptError(
                text.count("\n") + 1, "syntax error: the program ends where 'end' or a statement is expected"
            ) from None
        expected = [_WORDS.get(word, word) for word in sorted(error.expected)]
        wanted = f": {' or '.join(expected)} is expected" if len(expected) <= 3 else ""
        got = "the end of the line" if token.type == "_NL" else shown(str(token))
        raise ScriptError(Place(token.line, token.column), f"syntax error at {got}{wanted}") from None


def _checked_lines(text: str) -> Generator[None, None, None]:
    """Refuse a line that is too long."""
    place, line = 0, 1
    while place <= len(text):
        end = text.find("\n", place)
        end = len(text) if end < 0 else end
        if end - place > MAX_LINE:
            raise ScriptError(
                Place(line, MAX_LINE + 1), f"syntax error: a line may have {MAX_LINE} signs, got {end - place}"
            )
        place, line = end + 1, line + 1
        if line % 1000 == 0:
            yield


class _Bounds:
    """Counts what a program is made of, and refuses what is too much before the tree has it."""

    def __init__(self) -> None:
        self._statements = self._blocks = self._brackets = self._operations = 0
        self._before = "_NL"

    def count(self, token: Token) -> None:
        kind = token.type
        if kind == "_NL":
            self._statements += self._before not in ("_NL", "COLON", "END")
            self._operations = 0
        elif kind in ("GLOBAL", "LOCAL"):
            self._statements += self._before not in ("_NL", "COLON")  # the second one of a line
        elif kind in ("DEF", "THREAD", "SEC", "IF", "WHILE"):
            self._blocks += 1
        elif kind == "END":
            self._blocks -= 1
        elif kind in ("LPAR", "LSQB", "POSE_BEGIN"):
            self._brackets += 1
        elif kind in ("RPAR", "RSQB"):
            self._brackets -= 1
        elif kind in ("PLUS", "MINUS", "STAR", "SLASH", "PERCENT", "OR", "XOR", "AND", "NOT", "COMPARISON"):
            self._operations += 1
        self._before = kind
        place = _place(token)
        if max(self._blocks, self._brackets) > MAX_DEPTH:
            raise ScriptError(place, f"more than {MAX_DEPTH} levels within one another")
        if self._operations > MAX_OPERATIONS:
            raise ScriptError(place, f"a line may have {MAX_OPERATIONS} operations")
        if self._statements > MAX_STATEMENTS:
            raise ScriptError(place, f"a program may have {MAX_STATEMENTS} statements")


@cache
def grammar() -> Lark:
    """Return the parser; making it takes some 0.1 s."""
    from lark import Lark

    text = _GRAMMAR.replace("&", _FLAT).replace("~", _LIST).replace("@", _NUMBER).replace("LINES", f"{EMPTY_LINES}")
    return Lark(text, parser="lalr", transformer=_Builder(), maybe_placeholders=True)


class _Builder:
    """Makes the nodes of the tree: each method is called with the parts of its rule."""

    def start(self, parts: list[Any]) -> tuple[Statement, ...]:
        return tuple(parts)

    block = start

    def assigned(self, parts: list[Any]) -> Assignment:
        name, value = parts
        return Assignment(_own(name), value, _place(name))

    def assigned_in(self, parts: list[Any]) -> Assignment:
        scope, name, value = parts
        return Assignment(_own(name), value, _place(name), scope=str(scope))

    def assigned_element(self, parts: list[Any]) -> Assignment:
        name, *indices, value = parts
        return Assignment(_own(name), value, _place(name), indices=tuple(indices[1::2]))

    def assigned_element_of_p(self, parts: list[Any]) -> Assignment:
        """An element of a variable p: its name and bracket are those of a pose."""
        begin, *indices, value = parts
        if begin.type == "POSE":  # with its number
            entries = self.numbers([begin]).entries
            if len(entries) != 1:
                raise ScriptError(_place(begin), f"syntax error: {shown(str(begin))} cannot be set")
            indices = [entries[0], *indices]
        return Assignment("p", value, _place(begin), indices=tuple(indices[::2]))

    def definition(self, parts: list[Any]) -> Definition:
        kind, name, parameters, _, body, _ = parts
        return Definition(str(kind), _own(name), parameters or {}, body, _place(name))

    def parameters(self, parts: list[Any]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for token, default in parts:
            if token in found:
                raise ScriptError(_place(token), f"compile error: two arguments are called {shown(str(token))}")
            found[_own(token)] = default
        return found

    def parameter(self, parts: list[Any]) -> tuple[Token, Any]:
        return parts[0], parts[1] if len(parts) > 1 else Required

    def choice(self, parts: list[Any]) -> Choice:
        *parts, _ = parts  # the end
        otherwise: tuple[Statement, ...] = parts[-1] or ()
        branches = parts[:-3]  # each four parts: its word, the condition, the colon, the block
        for word, condition, _, block in reversed([branches[at : at + 4] for at in range(0, len(branches), 4)]):
            otherwise = (Choice(condition, block, otherwise, _place(word)),)
        return otherwise[0]  # type: ignore[return-value]

    def loop(self, parts: list[Any]) -> While:
        word, condition, _, block, _ = parts
        return While(condition, block, _place(word))

    def order(self, parts: list[Any]) -> Order:
        return Order(str(parts[0]), parts[1] if len(parts) > 1 else None, _place(parts[0]))

    def started(self, parts: list[Any]) -> OwnCall:
        return OwnCall(str(parts[1]), (), {}, is_run=True, place=_place(parts[1]))

    def label(self, parts: list[Any]) -> Order:
        return Order("label", place=_place(parts[0]))

    def operation(self, parts: list[Any]) -> Operation:
        left, sign, right = parts
        return Operation(str(sign), left, right, _place(sign))

    def negative(self, parts: list[Any]) -> Expression:
        sign, value = parts
        if sign == "-" and isinstance(value, Constant) and isinstance(value.value, float):
            return Constant(-value.value)
        return Negative(value, str(sign), _place(sign))

    def element(self, parts: list[Any]) -> Element:
        of, bracket, index = parts
        return Element(of, index, _place(bracket))

    def number(self, parts: list[Any]) -> Constant:
        return Constant(_finite(parts[0], parts[0]))

    def string(self, parts: list[Any]) -> Constant:
        return Constant(str(parts[0][1:-1]))

    def truth(self, parts: list[Any]) -> Constant:
        return Constant(parts[0].lower() == "true")

    def name(self, parts: list[Any]) -> Name:
        return Name(str(parts[0]), _place(parts[0]))

    def numbers(self, parts: list[Any]) -> Numbers:
        """A list or a pose of which all entries are numbers, which is one word: trajectories are made of these."""
        token = parts[0]
        is_pose = token.startswith("p")
        entries = tuple(Constant(_finite(text, token)) for text in token[is_pose + 1 : -1].split(","))
        return Numbers(entries, is_pose, _place(token))

    def entries(self, parts: list[Any]) -> Numbers:
        begin, *entries = parts
        return Numbers(tuple(entry for entry in entries if entry is not None), begin != "[", _place(begin))

    def within(self, parts: list[Any]) -> Expression:
        return parts[1]

    def keyword(self, parts: list[Any]) -> tuple[Token, Expression]:
        return parts[0], parts[1]

    def positional(self, parts: list[Any]) -> tuple[None, Expression]:
        return None, parts[0]

    def flat_call(self, parts: list[Any]) -> Call | OwnCall:
        """A call of which all arguments are numbers and lists of numbers, which is one word as in `numbers`."""
        token = parts[0]
        name, _, rest = token.partition("(")
        given = list[tuple[str | None, Expression]]()
        for keyword, entries, text in _ARGUMENT.findall(rest):
            value: Expression
            if entries:
                is_pose = entries.startswith("p")
                numbers = entries[is_pose + 1 : -1].split(",")
                value = Numbers(tuple(Constant(_finite(text, token)) for text in numbers), is_pose, _place(token))
            else:
                value = Constant(_finite(text, token))
            given.append((keyword or None, value))
        return self._called(name, _place(token), given)

    def call(self, parts: list[Any]) -> Call | OwnCall:
        token, _, *given = parts
        return self._called(str(token), _place(token), [argument for argument in given if argument is not None])

    def _called(self, name: str, place: Place, given: list[tuple[Any, Expression]]) -> Call | OwnCall:
        positional, keywords = list[Expression](), dict[str, Expression]()
        for keyword, value in given:
            if keyword is None:
                if keywords:
                    raise ScriptError(
                        place, f"compile error: {name} has an argument without a name after one with a name"
                    )
                positional.append(value)
            elif keyword in keywords:
                raise ScriptError(place, f"compile error: {name} has no free argument {shown(str(keyword))}: "
                                  "it is there twice")  # fmt: skip
            else:
                keywords[str(keyword)] = value
        if name not in FUNCTIONS:
            return OwnCall(name, tuple(positional), keywords, place=place)
        return Call(name, bound(name, FUNCTIONS[name].parameters, positional, keywords, place), place)


def _place(token: Token) -> Place:
    return Place(token.line or 1, token.column or 0)


def _own(token: Token) -> str:
    """Return a name that a program may give."""
    if token in FUNCTIONS:
        raise ScriptError(_place(token), f"compile error: {shown(str(token))} cannot be a variable or a function of a "
                          "program: the robot has a function of that name")  # fmt: skip
    return str(token)


def _finite(text: str, token: Token) -> float:
    value = float(text)
    if not abs(value) <= float_info.max:
        raise ScriptError(_place(token), f"syntax error: {shown(text[:40])} is too large")
    return value
