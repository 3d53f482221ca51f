"""Runs the code of a URScript program: its functions, variables and threads, a bounded number of steps at a time.

Threads take turns in every control cycle. One that waits, in a move or for `sync`, goes on in the next cycle. One that
never waits goes on where it was when its steps of this cycle are used up: it delays nothing, and ends when the
program is ended.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Generator, Mapping
from typing import Any, Protocol

from kinreach._checks import shown
from kinreach.deploy._script_code import Code, Op
from kinreach.deploy._script_functions import (
    COMPUTED,
    MAX_ENTRIES,
    MAX_TEXT,
    Pose,
    ValueProblem,
    a_truth,
    number,
    text_of,
    whole,
)
from kinreach.deploy._script_tree import Place, ScriptError, is_number

#: Steps of a program in a control cycle, and what a function costs that computes with poses, or solves for a posture.
STEPS, POSE_COST, SOLVER_COST = 3000, 20, 300
#: Calls within one another, threads, and lists within lists.
MAX_CALLS, MAX_THREADS, MAX_LEVELS = 100, 50, 10

_COSTS = {
    **dict.fromkeys(("get_forward_kin", "get_actual_tcp_pose", "get_target_tcp_pose", "pose_trans", "pose_inv",
                     "pose_add", "pose_sub", "pose_dist", "interpolate_pose", "rpy2rotvec", "rotvec2rpy"), POSE_COST),
    **dict.fromkeys(("get_inverse_kin", "get_inverse_kin_has_solution", "movej", "movel", "movep", "movec"),
                    SOLVER_COST),
}  # fmt: skip
_SIGNS: Mapping[str, Callable[[float, float], Any]] = {
    "-": operator.sub, "*": operator.mul, "/": operator.truediv, "%": math.fmod,
    "<": operator.lt, ">": operator.gt, "<=": operator.le, ">=": operator.ge,
}  # fmt: skip

Waiting = Generator[None, None, Any]


class Robot(Protocol):
    """What the functions of a program act on."""

    def call(self, function: str, values: Mapping[str, Any], place: Place, thread: object) -> Any:
        """Call a function: return its value, or a generator that yields at the end of each control cycle it takes."""


class Thread:
    """A thread of a program.

    Attributes:
        handle: What `run` returns.
        place: Of the instruction that it is at.
    """

    def __init__(self, machine: Machine, code: Code, variables: dict[str, Any], handle: int) -> None:
        self._machine, self.handle = machine, handle
        self._frames = [_Frame(code, variables)]
        self._stack: list[Any] = []
        self._waiting: Waiting | None = None
        self.is_done = False
        self.place = Place(1)

    def end(self) -> None:
        self.is_done = True
        if self._waiting is not None:
            self._waiting.close()
        self._waiting = None

    def run(self, steps: int) -> int:
        """Go on until it waits, ends, or has made its steps; return the steps that are left."""
        while not self.is_done:
            if self._waiting is not None:
                try:
                    next(self._waiting)
                except StopIteration as end:
                    self._waiting = None
                    self._stack.append(end.value)
                else:
                    return steps
            steps = self._step(steps)
            if steps <= 0:
                break
        return steps

    def _step(self, steps: int) -> int:
        """Execute instructions until something has to be waited for."""
        frame, stack = self._frames[-1], self._stack
        try:
            while steps > 0:
                op, argument, self.place = frame.code.instructions[frame.next]
                frame.next += 1
                steps -= 1
                if op is Op.CONSTANT:
                    stack.append(argument)
                elif op is Op.LOAD:
                    stack.append(self._variable(argument, frame))
                elif op is Op.CALL:
                    function, names = argument
                    steps -= _COSTS.get(function, 1)
                    if self._call(function, names):
                        return steps
                elif op is Op.STORE:
                    name, scope = argument
                    self._store(name, scope, stack.pop(), frame)
                elif op is Op.POP:
                    stack.pop()
                elif op is Op.OPERATE:
                    right = stack.pop()
                    stack[-1] = _operated(argument, stack[-1], right)
                elif op is Op.ELEMENT:
                    index = stack.pop()
                    stack[-1] = _entry(argument, stack[-1], index)
                elif op is Op.JUMP:
                    frame.next = argument
                elif op is Op.JUMP_IF_FALSE:
                    if not a_truth(stack.pop()):
                        frame.next = argument
                elif op is Op.JUMP_IF_SETTLED:
                    sign, target = argument
                    if _truth(sign, stack[-1]) is (sign == "or"):
                        frame.next = target
                    else:
                        stack.pop()
                elif op is Op.LIST:
                    self._make_list(*argument)
                elif op is Op.OWN_CALL or op is Op.RETURN:
                    if op is Op.OWN_CALL:
                        self._enter(argument)
                    else:
                        self._frames.pop()
                        if not self._frames:
                            self.end()
                            return steps
                    frame = self._frames[-1]
                else:
                    if self._rarely(op, argument, frame):
                        return steps
        except ValueProblem as problem:
            raise ScriptError(self.place, f"runtime error: {problem}") from None
        return steps

    def _rarely(self, op: Op, argument: Any, frame: _Frame) -> bool:
        """Execute an instruction of the others; return whether the thread waits or has ended."""
        stack = self._stack
        if op is Op.MINUS:
            stack[-1] = -number(stack[-1])
        elif op is Op.NOT:
            stack[-1] = not a_truth(stack[-1])
        elif op is Op.TRUTH:
            _truth(argument, stack[-1])
        elif op is Op.STORE_ELEMENT:
            name, count = argument
            self._store_element(name, count, frame)
        elif op is Op.RUN:
            stack.append(float(self._machine.begin(argument)))
        elif op is Op.KILL:
            self._machine.kill(stack.pop())
        elif op is Op.JOIN:
            self._waiting = self._machine.ended(stack.pop())
            return True
        elif op is Op.HALT:
            self._machine.halt()
            return True
        elif op is Op.ENTER:
            self._machine.critical = self
        elif op is Op.EXIT:
            self._machine.critical = None
        elif op is Op.LACKING:
            raise ValueProblem(argument)
        return False

    def _call(self, function: str, names: tuple[str, ...]) -> bool:
        """Call a function of the robot; return whether it takes time."""
        count, stack = len(names), self._stack
        values = stack[len(stack) - count :]
        del stack[len(stack) - count :]
        try:
            if function in COMPUTED:
                found = COMPUTED[function](*values)
            else:
                found = self._machine.robot.call(function, dict(zip(names, values, strict=True)), self.place, self)
        except (ValueError, ArithmeticError) as error:
            raise ValueProblem(f"{function}: {error}") from None
        if isinstance(found, str) and len(found) > MAX_TEXT:
            raise ValueProblem(f"a text may have {MAX_TEXT} signs")
        if isinstance(found, Generator):
            self._waiting = found
            return True
        stack.append(found)
        return False

    def _enter(self, code: Code) -> None:
        if len(self._frames) >= MAX_CALLS:
            raise ValueProblem(f"more than {MAX_CALLS} functions call one another")
        count, stack = len(code.parameters), self._stack
        values = stack[len(stack) - count :]
        del stack[len(stack) - count :]
        self._frames.append(_Frame(code, dict(zip(code.parameters, values, strict=True))))

    def _variable(self, name: str, frame: _Frame) -> Any:
        for variables in (frame.variables, self._machine.variables):
            if name in variables:
                return variables[name]
        raise ValueProblem(f"name {shown(name)} has no value yet")

    def _store(self, name: str, scope: str, value: Any, frame: _Frame) -> None:
        if value is None:
            raise ValueProblem(f"{name} is set to the value of a function that returns none")
        shared = self._machine.variables
        is_shared = scope == "global" or (scope == "" and name not in frame.variables and name in shared)
        (shared if is_shared else frame.variables)[name] = value

    def _store_element(self, name: str, count: int, frame: _Frame) -> None:
        value = self._stack.pop()
        indices = self._stack[len(self._stack) - count :]
        del self._stack[len(self._stack) - count :]
        self._store(name, "", _replaced(name, self._variable(name, frame), indices, value), frame)

    def _make_list(self, count: int, is_pose: bool) -> None:
        stack = self._stack
        values = stack[len(stack) - count :]
        del stack[len(stack) - count :]
        if is_pose:
            if count != 6:
                raise ValueProblem(f"a pose has six numbers, got {count}")
            stack.append(Pose(number(value) for value in values))
            return
        if any(value is None for value in values) or _size(tuple(values)) > MAX_ENTRIES + 1:
            raise ValueProblem(f"a list has values, and at most {MAX_ENTRIES}")
        stack.append(tuple(values))


class _Frame:
    """A function that runs: its code, the next instruction, and its own variables."""

    __slots__ = ("code", "next", "variables")

    def __init__(self, code: Code, variables: dict[str, Any]) -> None:
        self.code, self.next, self.variables = code, 0, variables


class Machine:
    """A program that runs.

    Args:
        code: Of the program.
        robot: What its functions act on.

    Attributes:
        variables: Of the program.
        critical: The thread that alone may run; None if all may.
        has_halted: Whether it was ended by `halt`.
    """

    def __init__(self, code: Code, robot: Robot) -> None:
        self.robot, self.variables = robot, dict[str, Any]()
        self.critical: Thread | None = None
        self._main = Thread(self, code, self.variables, -1)  # programs set a handle to 0 while they have no thread
        self._threads = [self._main]
        self._made = 0
        self.has_halted = False

    @property
    def is_done(self) -> bool:
        """Whether the program has come to its end."""
        return self._main.is_done or self.has_halted

    def cycle(self) -> None:
        """Let all threads go on for a control cycle.

        Raises:
            ScriptError: A statement cannot be executed.
        """
        steps = STEPS
        for thread in list(self._threads):
            if thread.is_done or self.critical not in (None, thread):
                continue
            share = max(1, steps // max(1, len(self._threads)))
            steps -= share - thread.run(share)
            if self.is_done:
                break
        if self.critical is not None and self.critical.is_done:
            self.critical = None
        self._threads = [thread for thread in self._threads if not thread.is_done]

    def end(self) -> None:
        for thread in self._threads:
            thread.end()

    def halt(self) -> None:
        self.has_halted = True
        self.end()

    def begin(self, code: Code) -> int:
        """Start a thread, and return its handle."""
        if len(self._threads) >= MAX_THREADS:
            raise ValueProblem(f"a program may have {MAX_THREADS} threads at a time")
        self._made += 1
        self._threads.append(Thread(self, code, {}, self._made))
        return self._made

    def kill(self, handle: object) -> None:
        thread = self._thread(handle)
        if thread is not None:
            thread.end()

    def ended(self, handle: object) -> Waiting:
        """Wait until a thread has ended."""
        thread = self._thread(handle)
        while thread is not None and not thread.is_done:
            yield

    def _thread(self, handle: object) -> Thread | None:
        number = whole(handle)
        return next((thread for thread in self._threads if thread.handle == number), None)


def _operated(sign: str, left: Any, right: Any) -> Any:
    if sign == "+" and isinstance(left, str) and isinstance(right, str):
        if len(left) + len(right) > MAX_TEXT:
            raise ValueProblem(f"a text may have {MAX_TEXT} signs")
        return left + right
    if sign == "xor":
        return a_truth(left) is not a_truth(right)
    if sign in ("==", "!="):
        return (left == right and isinstance(left, bool) is isinstance(right, bool)) is (sign == "==")
    one, other = number(left), number(right)
    if sign == "+":
        return one + other
    try:
        return _SIGNS[sign](one, other)
    except (ValueError, ArithmeticError):
        raise ValueProblem(f"{text_of(one)} {sign} {text_of(other)} has no value") from None


def _truth(sign: str, value: object) -> bool:
    if not isinstance(value, bool):
        raise ValueProblem(f"{sign} is for truth values, got {shown(value)}")
    return value


def _entry(name: str, values: object, index: object) -> Any:
    if not isinstance(values, tuple | str) or not _is_index(index, values):
        raise ValueProblem(f"{name} has no entry {text_of(index)}")
    return values[int(index)]  # type: ignore[call-overload]


def _is_index(index: object, values: tuple[Any, ...] | str) -> bool:
    return is_number(index) and float(index).is_integer() and 0 <= index < len(values)  # type: ignore[arg-type,operator]


def _replaced(name: str, values: Any, indices: list[Any], value: Any) -> Any:
    """Return a list with another entry."""
    index, *others = indices
    if not isinstance(values, tuple) or not _is_index(index, values):
        raise ValueProblem(f"{name} has no entry {text_of(index)}")
    at = int(index)
    new = _replaced(name, values[at], others, value) if others else value
    if new is None:
        raise ValueProblem(f"an entry of {name} is set to the value of a function that returns none")
    if isinstance(values, Pose):
        return Pose((*values[:at], number(new), *values[at + 1 :]))
    changed = (*values[:at], new, *values[at + 1 :])
    if _size(changed) > MAX_ENTRIES:
        raise ValueProblem(f"a list may have {MAX_ENTRIES} values")
    return changed


def _size(value: object, depth: int = 0) -> int:
    """Count the values of a list and of the lists in it."""
    if depth > MAX_LEVELS:
        raise ValueProblem(f"lists may be {MAX_LEVELS} levels within one another")
    return 1 + sum(_size(entry, depth + 1) for entry in value) if isinstance(value, tuple) else 1
