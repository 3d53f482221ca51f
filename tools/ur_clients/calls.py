"""What the scripts of this folder share: they run in the environment of the clients, without kinreach."""

import json
import time
from collections.abc import Callable
from typing import Any

#: How long a robot may take to do something, on a busy machine [s].
PATIENCE = 60.0

Call = Callable[[], object]


def eventually(condition: Call) -> bool:
    """Wait until something holds, or for `PATIENCE`."""
    deadline = time.monotonic() + PATIENCE
    while not (found := condition()) and time.monotonic() < deadline:
        time.sleep(0.01)
    return bool(found)


def connected(connect: Callable[[], Any], refused: type[Exception]) -> Any:
    """Return what connects, as soon as it does: a client's own limit of some seconds runs out on a busy machine."""
    found = []

    def is_there() -> bool:
        try:
            found.append(connect())
        except refused:
            return False
        return True

    assert eventually(is_there)
    return found[0]


def near(values: list[float], wanted: list[float], tolerance: float = 2e-3) -> bool:
    """Return whether two lists of numbers agree."""
    return len(values) == len(wanted) and all(
        abs(one - other) < tolerance for one, other in zip(values, wanted, strict=True)
    )


def report(part: str, version: str, calls: dict[str, Call]) -> None:
    """Try the calls of a part of a client, and print for each whether it did what it is for, as lines of JSON."""
    for name, call in calls.items():
        try:
            works, why = call() is not False, ""
        except Exception as error:
            works, why = False, f"{type(error).__name__}: {error}"
        print(json.dumps({"part": part, "version": version, "call": name, "works": works, "why": why}), flush=True)
