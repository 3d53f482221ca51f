"""Studies that are a list of parts, none of which knows of the others: one after the other, or as tasks of Ray.

What a part found can be kept in a file, so that an interrupted study goes on.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import Progress

from kinreach import _provenance as provenance
from kinreach._files import write_text
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


def kept(folder: Path, key: Mapping[str, Any], measure: Callable[[], Value]) -> Value:
    """Return what a measurement found: from its file in a folder, or measured now and written there.

    Args:
        folder: Of the files.
        key: What the measurement depends on; its digest is the file's name.
        measure: The measurement. What it returns must be JSON.
    """
    file = folder / f"{provenance.digest(json.dumps(key, sort_keys=True).encode())}.json"
    if file.exists():
        found: Value = json.loads(file.read_text(encoding="utf-8"))["found"]
        return found
    found = measure()
    write_text(file, json.dumps({**key, "found": found}) + "\n")
    return found


@contextmanager
def counted(total: int) -> Iterator[Callable[[], None]]:
    """Show on a terminal how many parts are done, where tables do not go; what is yielded counts one more."""
    errors = Console(stderr=True)
    with Progress(console=errors, transient=True, disable=not errors.is_terminal, redirect_stdout=False) as bar:
        task = bar.add_task("", total=total)
        yield lambda: bar.advance(task)


def _values(function: Callable[..., Value], numbered: Sequence[tuple[int, Any]]) -> Iterator[tuple[int, Value]]:
    for number, part in numbered:
        yield number, function(*part)
