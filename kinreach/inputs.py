"""Checks of single values that users give: all raise an `InputError` that names the value and its bound.

Arrays are checked in `kinreach.kinematics.goals`.
"""

from __future__ import annotations

import operator
from collections.abc import Collection
from math import inf
from numbers import Real
from pathlib import Path
from reprlib import Repr
from typing import Any

from kinreach.errors import InputError, raise_unknown

#: More threads than any machine has that this is for.
MOST_THREADS = 1024

_SHORT = Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 60


def shown(value: object) -> str:
    """A value as an error message shows it: short, whatever it is."""
    try:
        return _SHORT.repr(value)
    except Exception:  # a number of too many digits, or an object whose own code fails
        return f"an object of type {type(value).__name__}"


def check_count(name: str, value: object, *, least: int = 1, most: int | None = None) -> int:
    """An integer within bounds.

    Raises:
        InputError: It is no integer (a float is none, nor is a truth value), or it is outside the bounds.
    """
    try:
        count = operator.index(value)  # type: ignore[arg-type]
    except Exception:  # no integer, or an object whose own code fails
        raise InputError(f"{name} must be an integer, got {shown(value)}") from None
    if isinstance(value, bool):
        raise InputError(f"{name} must be an integer, got {value}")
    if count < least:
        raise InputError(f"{name} must be at least {least}, got {shown(count)}")
    if most is not None and count > most:
        raise InputError(f"{name} must be at most {most}, got {shown(count)}")
    return count


def check_number(name: str, value: object, *, least: float = -inf, most: float = inf, above: float = -inf) -> float:
    """A finite number within bounds, of which `above` is excluded.

    Raises:
        InputError: It is no number (a truth value is none), not finite, or outside the bounds.
    """
    try:
        number = None if isinstance(value, bool) or not isinstance(value, Real) else float(value)
    except OverflowError:
        number = inf
    if number is None:
        raise InputError(f"{name} must be a number, got {shown(value)}")
    if not (least <= number <= most and above < number and -inf < number < inf):
        said = (
            (f"at least {least:g}", least > above),
            (f"above {above:g}", above > -inf),
            (f"at most {most:g}", most < inf),
        )
        bounds = " and ".join(["finite", *(text for text, bound in said if bound)])
        raise InputError(f"{name} must be {bounds}, got {shown(value)}")
    return number


def check_known(kind: str, value: object, available: Collection[str]) -> None:
    """Refuse what is not one of the names there are.

    Raises:
        UnknownNameError: The message lists those there are.
    """
    if not isinstance(value, str) or value not in available:
        raise_unknown(kind, value if isinstance(value, str) else shown(value), available)


def check_path(name: str, value: Any) -> Path:
    """A path that can be, and can be looked at.

    Raises:
        InputError: It is no path, is too long, has characters that are no text, or leads through a closed folder.
    """
    try:
        path = Path(value)
        str(path).encode()  # what cannot be printed cannot be reported either
        if "\0" in str(path):
            raise ValueError("a path has no null character")
        path.exists()  # raises where a name is too long
    except (TypeError, ValueError, OSError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"{name} cannot be a path, got {shown(value)}: {reason}") from None
    return path
