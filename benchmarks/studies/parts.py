"""Studies that are a list of parts, none of which knows of the others: here one after the other, or as tasks of Ray."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, TypeVar

from kinreach._jobs import open_engine

Value = TypeVar("Value")


def each(arguments: argparse.Namespace, function: Callable[..., Value], parts: Sequence[Any]) -> Iterator[Value]:
    """Yield what a function makes of each part, in their order, as soon as it is known.

    Args:
        arguments: With those of `kinreach._jobs.add_options`.
        function: Of the arguments that a part is.
        parts: Tuples.

    Raises:
        KinreachError: As `open_engine`, or what a part raised.
    """
    found: dict[int, Value] = {}
    following = 0
    with open_engine(arguments.engine, arguments.address) as engine:
        jobs = engine.split(list(enumerate(parts)), 1)
        for _, (number, value) in engine.map(partial(_values, function), jobs):
            found[number] = value
            while following in found:
                yield found.pop(following)
                following += 1


def _values(function: Callable[..., Value], numbered: Sequence[tuple[int, Any]]) -> Iterator[tuple[int, Value]]:
    for number, part in numbered:
        yield number, function(*part)
