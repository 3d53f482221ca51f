"""`Outcome`: what a check of endurance found."""

from __future__ import annotations

from dataclasses import dataclass


class BrokenPromiseError(Exception):
    """What was promised did not hold; the message says how."""


@dataclass(frozen=True)
class Outcome:
    """A check that did not fail.

    Attributes:
        count: How many cases there were; 0 where it cannot be checked here, which is no success.
        of: What a case was, in the plural.
        detail: What was measured on the way, or why there were no cases.
    """

    count: int
    of: str
    detail: str = ""


def demand(holds: object, message: str) -> None:
    """Raise `BrokenPromiseError` unless it holds."""
    if not holds:
        raise BrokenPromiseError(message)
