"""What figures check before they draw: all raise an `InputError` that names the value."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from matplotlib.cbook import is_math_text
from matplotlib.mathtext import MathTextParser
from numpy.typing import ArrayLike

from kinreach.checks import Floats, as_floats, as_vector, shown
from kinreach.errors import InputError

#: Beyond this matplotlib's axes give up, or take minutes.
MOST_DRAWN = 1e15
#: Nearer to each other the ends of an axis could be taken for one, as a share of the larger.
LEAST_SPAN = 1e-9


def as_drawn(name: str, values: ArrayLike) -> Floats:
    """Numbers that an axis can hold; what is not a number is left out of a drawing.

    Raises:
        InputError: No array of numbers, or one that is infinite or too large.
    """
    array = as_floats(name, values)
    if (wild := np.abs(array) > MOST_DRAWN).any():
        raise InputError(f"{name} must be within ±{MOST_DRAWN:g} to be drawn, got {array[wild][0]:g}")
    return array


def as_point(name: str, value: ArrayLike) -> tuple[float, float]:
    """Two finite numbers, (x, y).

    Raises:
        InputError: It is none.
    """
    x, y = as_vector(name, value, 2, most=MOST_DRAWN).tolist()
    return x, y


def as_limits(name: str, value: ArrayLike, *, positive: bool = False) -> tuple[float, float]:
    """Two finite numbers of which the first is the smaller, and above zero if they have to be `positive`.

    Raises:
        InputError: They are not, or too near to each other for an axis.
    """
    low, high = as_point(name, value)
    if not high - low > LEAST_SPAN * max(abs(low), abs(high)) or (positive and low <= 0):
        raise InputError(f"{name} must be {'positive and ' if positive else ''}increasing, got {shown(value)}")
    return low, high


def check_mapping(name: str, value: Mapping[str, object]) -> None:
    """Refuse what is no mapping with names as its keys.

    Raises:
        InputError: It is another object, or a key is no text.
    """
    given: object = value
    if not isinstance(given, Mapping):
        raise InputError(f"{name} must be a mapping, got {shown(given)}")
    for key in given:
        check_text(f"a name in {name}", key)


def check_names(name: str, value: Collection[str]) -> None:
    """Refuse what is no collection of names.

    Raises:
        InputError: It is another object, or a name is no text.
    """
    given: object = value
    try:
        good = isinstance(given, Collection) and all(isinstance(each, str) for each in given)
    except TypeError:  # an array of no dimension says that it is a collection
        good = False
    if not good:
        raise InputError(f"{name} must be a collection of names, got {shown(given)}")


def check_text(name: str, value: object) -> None:
    """Refuse what is no text that can be written.

    Raises:
        InputError: It is another object, or has characters that are no text.
    """
    if not isinstance(value, str) or any("\ud800" <= each <= "\udfff" for each in value):
        raise InputError(f"{name} must be text, got {shown(value)}")


def check_label(name: str, value: object) -> None:
    """Refuse what is no text in which dollar signs may enclose formulas.

    Raises:
        InputError: It is another object, or a formula is wrong.
    """
    check_text(name, value)
    try:
        for line in filter(is_math_text, str(value).split("\n")):
            MathTextParser("path").parse(line)
    except ValueError:
        raise InputError(f"{name} has a formula that cannot be drawn, got {shown(value)}") from None
