"""From the tree of a program to code for the interpreter: a list of instructions for each of its functions."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from enum import IntEnum, auto
from typing import Any

from kinreach._checks import shown
from kinreach.deploy._script_functions import FUNCTIONS, Pose, bound, lack_of
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

#: Statements that are compiled at a time.
STATEMENTS = 20


class Op(IntEnum):
    """What an instruction does; values come from a stack and go onto it."""

    CONSTANT = auto()
    LOAD = auto()
    STORE = auto()
    CALL = auto()
    OWN_CALL = auto()
    POP = auto()
    OPERATE = auto()
    MINUS = auto()
    NOT = auto()
    LIST = auto()
    ELEMENT = auto()
    STORE_ELEMENT = auto()
    JUMP = auto()
    JUMP_IF_FALSE = auto()
    JUMP_IF_SETTLED = auto()  # of `and` and `or`: where the left side decides
    TRUTH = auto()
    RETURN = auto()
    RUN = auto()
    KILL = auto()
    JOIN = auto()
    HALT = auto()
    ENTER = auto()
    EXIT = auto()
    LACKING = auto()


Instruction = tuple[Op, Any, Place]


class Code:
    """The instructions of a function or a program.

    Attributes:
        parameters: Names of the arguments, which are on the stack when it begins.
        called: Functions of the program that it certainly calls, or starts as threads.
        lacks: What it certainly calls and the simulated robot lacks.
    """

    def __init__(self, name: str, parameters: tuple[str, ...] = ()) -> None:
        self.name, self.parameters = name, parameters
        self.instructions = list[Instruction]()
        self.called = list[Code]()
        self.lacks = list[ScriptError]()


def compiling(body: Sequence[Statement], *, is_secondary: bool = False) -> Generator[None, None, Code]:
    """Compile a program in small parts, each of which ends in a `yield`.

    Raises:
        ScriptError: A name or a function that is not there, or what the simulated robot lacks and is certainly reached.
    """
    shared = set[str]()
    for count, statement in enumerate(_inner(body, functions=True)):
        if isinstance(statement, Assignment) and statement.scope == "global":
            shared.add(statement.name)
        if count % (10 * STATEMENTS) == 0:
            yield
    for count, statement in enumerate(_inner(body, functions=False)):
        if isinstance(statement, Assignment) and not statement.indices:
            shared.add(statement.name)
        if count % (10 * STATEMENTS) == 0:
            yield
    main = Code("")
    compiler = _Compiler(main, shared, frozenset(), {}, is_secondary=is_secondary)
    yield from compiler.function(body)
    reached, waiting = {id(main)}, [main]
    while waiting:
        code = waiting.pop()
        if code.lacks:
            raise code.lacks[0]
        for called in code.called:
            if id(called) not in reached:
                reached.add(id(called))
                waiting.append(called)
    return main


def _inner(statements: Iterable[Statement], *, functions: bool) -> Iterator[Statement]:
    """Yield statements and those within them, with the bodies of functions or without them."""
    waiting = list(statements)
    while waiting:
        statement = waiting.pop()
        yield statement
        if isinstance(statement, Choice):
            waiting += [*statement.then, *statement.otherwise]
        elif isinstance(statement, While) or (functions and isinstance(statement, Definition)):
            waiting += statement.body


class _Compiler:
    """Compiles one function.

    Args:
        code: To be filled.
        shared: Variables of the program, which all of its functions see.
        own: Variables of the function alone.
        functions: Functions of the program that can be called here, with their definitions.
    """

    def __init__(
        self,
        code: Code,
        shared: set[str],
        own: frozenset[str],
        functions: Mapping[str, tuple[Code, Definition]],
        *,
        is_secondary: bool,
    ) -> None:
        self._code, self._shared, self._own, self._functions = code, shared, own, dict(functions)
        self._is_secondary = is_secondary
        self._loops: list[tuple[int, list[int]]] = []  # where each begins, and the jumps to its end
        self._conditions = 0
        self._count = 0

    def function(self, body: Sequence[Statement]) -> Generator[None, None, None]:
        yield from self._block(body)
        self._emit(Op.CONSTANT, None, Place(1))
        self._emit(Op.RETURN, None, Place(1))

    def _emit(self, op: Op, argument: Any, place: Place) -> int:
        self._code.instructions.append((op, argument, place))
        return len(self._code.instructions) - 1

    def _land(self, jump: int) -> None:
        """Let a jump lead to the next instruction."""
        op, argument, place = self._code.instructions[jump]
        target = len(self._code.instructions)
        self._code.instructions[jump] = op, (argument, target) if op is Op.JUMP_IF_SETTLED else target, place

    def _block(self, body: Sequence[Statement]) -> Generator[None, None, None]:
        for definition in body:
            if isinstance(definition, Definition):
                if definition.name in self._functions and self._functions[definition.name][1] in body:
                    raise ScriptError(definition.place, f"compile error: {definition.name} is defined twice")
                if definition.kind == "sec":
                    raise ScriptError(definition.place, "compile error: a secondary program within another program")
                code = Code(definition.name, tuple(definition.parameters))
                self._functions[definition.name] = code, definition
        for statement in body:
            self._count += 1
            if self._count % STATEMENTS == 0:
                yield
            yield from self._statement(statement)

    def _statement(self, statement: Statement) -> Generator[None, None, None]:
        if isinstance(statement, Call):
            self._call(statement)
            self._emit(Op.POP, None, statement.place)
        elif isinstance(statement, OwnCall):
            self._own_call(statement)
            self._emit(Op.POP, None, statement.place)
        elif isinstance(statement, Assignment):
            self._assignment(statement)
        elif isinstance(statement, Choice):
            yield from self._choice(statement)
        elif isinstance(statement, While):
            yield from self._while(statement)
        elif isinstance(statement, Definition):
            code, _ = self._functions[statement.name]
            own = frozenset({*statement.parameters, *_local(statement.body)})
            inner = _Compiler(code, self._shared, own, self._functions, is_secondary=self._is_secondary)
            yield from inner.function(statement.body)
        else:
            self._order(statement)

    def _assignment(self, statement: Assignment) -> None:
        if statement.name in self._functions:
            raise ScriptError(
                statement.place, f"compile error: {shown(statement.name)} is a function, and cannot be a variable"
            )
        if statement.indices:
            self._known(statement.name, statement.place)
            for index in statement.indices:
                self._value(index)
            self._value(statement.value)
            self._emit(Op.STORE_ELEMENT, (statement.name, len(statement.indices)), statement.place)
            return
        self._value(statement.value)
        self._emit(Op.STORE, (statement.name, statement.scope), statement.place)

    def _choice(self, choice: Choice) -> Generator[None, None, None]:
        ends = list[int]()
        while True:
            self._value(choice.condition)
            past = self._emit(Op.JUMP_IF_FALSE, None, choice.place)
            self._conditions += 1
            yield from self._block(choice.then)
            ends.append(self._emit(Op.JUMP, None, choice.place))
            self._land(past)
            if len(choice.otherwise) == 1 and isinstance(choice.otherwise[0], Choice):  # elif, of which there are many
                self._conditions -= 1
                choice = choice.otherwise[0]
                continue
            yield from self._block(choice.otherwise)
            self._conditions -= 1
            break
        for end in ends:
            self._land(end)

    def _while(self, loop: While) -> Generator[None, None, None]:
        begin = len(self._code.instructions)
        self._value(loop.condition)
        past = self._emit(Op.JUMP_IF_FALSE, None, loop.place)
        self._loops.append((begin, [past]))
        yield from self._block(loop.body)
        self._emit(Op.JUMP, begin, loop.place)
        for jump in self._loops.pop()[1]:
            self._land(jump)

    def _order(self, order: Order) -> None:
        place = order.place
        match order.word:
            case "label":
                return
            case "break" | "continue":
                if not self._loops:
                    raise ScriptError(place, f"compile error: {order.word} outside of a loop")
                begin, ends = self._loops[-1]
                jump = self._emit(Op.JUMP, begin, place)
                if order.word == "break":
                    ends.append(jump)
            case "return":
                if order.value is None:
                    self._emit(Op.CONSTANT, None, place)
                else:
                    self._value(order.value)
                self._emit(Op.RETURN, None, place)
            case "kill" | "join":
                if order.value is not None:
                    self._value(order.value)
                self._emit(Op.KILL if order.word == "kill" else Op.JOIN, None, place)
            case word:
                op = {"halt": Op.HALT, "enter_critical": Op.ENTER, "exit_critical": Op.EXIT}[word]
                self._emit(op, None, place)

    def _known(self, name: str, place: Place) -> None:
        if name not in self._own and name not in self._shared:
            raise ScriptError(place, f"compile error: name {shown(name)} is not defined")

    def _value(self, value: Expression) -> None:
        """Compile an expression: its value is on the stack afterwards."""
        if isinstance(value, Constant):
            self._emit(Op.CONSTANT, value.value, Place(1))
        elif isinstance(value, Numbers):
            self._numbers(value)
        elif isinstance(value, Name):
            self._known(value.name, value.place)
            self._emit(Op.LOAD, value.name, value.place)
        elif isinstance(value, Element):
            self._value(value.of)
            self._value(value.index)
            self._emit(Op.ELEMENT, value.of.name if isinstance(value.of, Name) else "the list", value.place)
        elif isinstance(value, Negative):
            self._value(value.value)
            self._emit(Op.MINUS if value.sign == "-" else Op.NOT, None, value.place)
        elif isinstance(value, Operation):
            self._operation(value)
        elif isinstance(value, Call):
            if not FUNCTIONS[value.function].returns:
                raise ScriptError(value.place, f"compile error: {value.function} returns no value")
            self._call(value)
        else:
            self._own_call(value)

    def _numbers(self, value: Numbers) -> None:
        if value.is_pose and len(value.entries) == 1 and "p" in self._own | self._shared:  # an entry of a variable p
            self._value(Element(Name("p", value.place), value.entries[0], value.place))
            return
        if all(isinstance(entry, Constant) for entry in value.entries) and len(value.entries) == 6:
            numbers = tuple(entry.value for entry in value.entries if isinstance(entry, Constant))
            if all(isinstance(number, float) for number in numbers):
                self._emit(Op.CONSTANT, Pose(numbers) if value.is_pose else numbers, value.place)  # type: ignore[arg-type]
                return
        for entry in value.entries:
            self._value(entry)
        self._emit(Op.LIST, (len(value.entries), value.is_pose), value.place)

    def _operation(self, value: Operation) -> None:
        self._value(value.left)
        if value.sign in ("and", "or"):
            past = self._emit(Op.JUMP_IF_SETTLED, value.sign, value.place)
            self._value(value.right)
            self._emit(Op.TRUTH, value.sign, value.place)
            self._land(past)
            return
        self._value(value.right)
        self._emit(Op.OPERATE, value.sign, value.place)

    def _call(self, call: Call) -> None:
        if self._is_secondary and (FUNCTIONS[call.function].is_moving or call.function in ("sleep", "sync")):
            raise ScriptError(
                call.place, f"compile error: a secondary program cannot move the arm or take time: {call.function}"
            )
        for argument in call.arguments.values():
            self._value(argument)
        self._emit(Op.CALL, (call.function, tuple(call.arguments)), call.place)

    def _own_call(self, call: OwnCall) -> None:
        place = call.place
        if call.function not in self._functions:
            self._refuse_unknown(call)
            return
        code, definition = self._functions[call.function]
        if call.is_run is not (definition.kind == "thread"):
            kind = "is no thread" if call.is_run else "is a thread: run starts it"
            raise ScriptError(place, f"compile error: {call.function} {kind}")
        if not self._conditions:
            self._code.called.append(code)
        given = bound(call.function, definition.parameters, call.positional, call.keywords, place)
        for argument in given.values():
            self._value(argument)
        self._emit(Op.RUN if call.is_run else Op.OWN_CALL, code, place)

    def _refuse_unknown(self, call: OwnCall) -> None:
        """Refuse a function: one that UR has and the simulated robot lacks only where it is certainly called."""
        name = shown(call.function)
        if call.is_run or not (lack := lack_of(call.function)):
            raise ScriptError(call.place, f"compile error: function {name} is not in the URScript that kinreach runs")
        refusal = ScriptError(call.place, f"compile error: function {name}: the simulated robot {lack}")
        if not self._conditions:
            self._code.lacks.append(refusal)
        for argument in (*call.positional, *call.keywords.values()):
            self._value(argument)
            self._emit(Op.POP, None, call.place)
        self._emit(Op.LACKING, f"function {name}: the simulated robot {lack}", call.place)


def _local(body: Iterable[Statement]) -> Iterator[str]:
    """Yield the names that a function assigns without `global`."""
    for statement in _inner(body, functions=False):
        if isinstance(statement, Assignment) and not statement.indices and statement.scope != "global":
            yield statement.name
