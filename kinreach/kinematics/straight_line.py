"""Formulas on many postures at once, written once and run without overhead: straight-line programs on arrays.

A formula is traced on symbols: what is constant is folded, factors of 0 and 1 vanish, what occurs twice is computed
once, and what no result needs is left out. What remains is a list of numpy calls, in which an operand that is not
needed again is overwritten, so that everything stays in the cache.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

#: What gives floats from floats, and so may overwrite an operand of the same kind.
_FLOATING: tuple[np.ufunc, ...] = (
    *(np.add, np.subtract, np.multiply, np.divide, np.minimum, np.maximum),
    *(np.negative, np.absolute, np.cos, np.sin, np.tan),
)


class Symbol:
    """A value in a formula: an input, or what a function makes of its operands. Two are equal if they are the same."""

    def __init__(self, function: Callable[..., Any] | None, operands: tuple[Entry, ...], known: Known) -> None:
        self.function, self.operands, self.known = function, operands, known

    def __add__(self, other: Entry) -> Entry:
        if _is(other, 0.0):
            return self
        if isinstance(other, Symbol) and other.function is np.negative:
            return self - other.operands[0]
        if self.function is np.negative:
            return other - self.operands[0]
        return apply(np.add, self, other)

    def __sub__(self, other: Entry) -> Entry:
        return self if _is(other, 0.0) else apply(np.subtract, self, other)

    def __rsub__(self, other: float) -> Entry:
        return -self if _is(other, 0.0) else apply(np.subtract, other, self)

    def __mul__(self, other: Entry) -> Entry:
        if _is(other, 0.0):
            return 0.0
        if _is(other, 1.0):
            return self
        if _is(other, -1.0):
            return -self
        if self.function is np.negative:
            return -(self.operands[0] * other)
        if isinstance(other, Symbol) and other.function is np.negative:
            return -(self * other.operands[0])
        return apply(np.multiply, self, other)

    def __rtruediv__(self, other: float) -> Entry:
        return apply(np.divide, other, self)

    def __neg__(self) -> Entry:
        return self.operands[0] if self.function is np.negative else apply(np.negative, self)

    __radd__, __rmul__ = __add__, __mul__


#: A symbol, or a number that is the same for all postures.
Entry = Symbol | float
Known = dict[tuple[object, ...], Symbol]


def apply(function: Callable[..., Any], *operands: Entry) -> Entry:
    """A function of one or two entries, for what operators do not say: `np.cos`, `np.less`, a table's `take`."""
    for operand in operands:
        if isinstance(operand, Symbol):
            known = operand.known
            return known.setdefault((function, *operands), Symbol(function, operands, known))
    return float(function(*operands))


def all_of(flags: Sequence[Entry]) -> Entry:
    """Whether all of these are so."""
    return reduce(lambda a, b: apply(np.logical_and, a, b), flags)


def any_of(flags: Sequence[Entry]) -> Entry:
    """Whether one of these is so."""
    return reduce(lambda a, b: apply(np.logical_or, a, b), flags)


class _Step(NamedTuple):
    """One call of a function of one or two operands, by the registers it reads and fills."""

    function: Callable[..., Any]
    first: int
    second: int | None
    target: int
    in_place: bool


class Program:
    """A formula, ready to run on arrays of one length.

    Args:
        formula: Takes the inputs as symbols and returns the results, built from them by operators and `apply`.
        inputs: How many inputs there are.
    """

    def __init__(self, formula: Callable[[Sequence[Symbol]], Iterable[Entry]], inputs: int) -> None:
        known: Known = {}
        symbols = [Symbol(None, (), known) for _ in range(inputs)]
        results = list(formula(symbols))
        needed = _needed(results)
        order = [symbol for symbol in known.values() if symbol in needed]
        last = {operand: step for step, symbol in enumerate(order) for operand in symbol.operands}
        register: dict[Entry, int] = {symbol: index for index, symbol in enumerate(symbols)}
        self._registers: list[Any] = [None] * inputs

        def new(value: float | None) -> int:
            self._registers.append(value)
            return len(self._registers) - 1

        def read(entry: Entry) -> int:
            if entry not in register:
                register[entry] = new(float(entry))  # type: ignore[arg-type]
            return register[entry]

        self._steps: list[_Step] = []
        free: list[int] = []
        kept = {result for result in results if isinstance(result, Symbol)}
        for step, symbol in enumerate(order):
            sources = tuple(read(operand) for operand in symbol.operands)
            dying = [
                operand
                for operand in dict.fromkeys(symbol.operands)
                if isinstance(operand, Symbol) and operand.function and operand not in kept and last[operand] == step
            ]
            floats = [operand for operand in dying if operand.function in _FLOATING]
            in_place = bool(floats) and symbol.function in _FLOATING
            free.extend(register[operand] for operand in dying)
            if in_place:
                target = register[floats[0]]
                free.remove(target)
            else:
                target = free.pop() if free else new(None)
            register[symbol] = target
            first, second = sources if len(sources) == 2 else (*sources, None)
            self._steps.append(_Step(symbol.function, first, second, target, in_place))  # type: ignore[arg-type]
        self._results = [read(result) for result in results]

    def __call__(self, inputs: Sequence[Any] | NDArray[Any]) -> list[Any]:
        """The results, arrays or numbers, for inputs of one length; they are computed in the inputs' precision."""
        values = self._registers.copy()
        values[: len(inputs)] = inputs
        # Keyword arguments and argument lists would cost as much as the calls themselves.
        for function, first, second, target, in_place in self._steps:
            if second is None:
                if in_place:
                    function(values[first], values[target])
                else:
                    values[target] = function(values[first])
            elif in_place:
                function(values[first], values[second], values[target])
            else:
                values[target] = function(values[first], values[second])
        return [values[result] for result in self._results]


def _needed(results: Iterable[Entry]) -> set[Entry]:
    """The symbols that the results are made of."""
    needed: set[Entry] = set()
    open_ends = [result for result in results if isinstance(result, Symbol)]
    while open_ends:
        symbol = open_ends.pop()
        if symbol not in needed:
            needed.add(symbol)
            open_ends.extend(operand for operand in symbol.operands if isinstance(operand, Symbol))
    return needed


def _is(entry: Entry, number: float) -> bool:
    return isinstance(entry, float) and entry == number
