"""Errors of kinreach, all of them subclasses of `KinreachError`."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any, NoReturn

#: Names in messages are cut at this length [characters].
LONGEST_NAME = 100


class KinreachError(Exception):
    """Root of all errors that kinreach raises on purpose."""


class InputError(KinreachError, ValueError):
    """A value, shape or range that cannot be used; the message names it and gives the reason."""


class NoShapesError(InputError):
    """An arm without collision shapes was asked what collides; the message says why it has none."""


class UnknownNameError(InputError):
    """A name that is not registered; the message lists the available ones."""


class MethodError(InputError):
    """A solver or policy of the user's own failed; the message names it, the goal, and what it raised."""


class OtherResultsError(InputError):
    """A folder holds the finished results of another comparison."""


class UnknownOptionError(UnknownNameError, TypeError):
    """An unknown keyword of an environment; a `TypeError` too, as libraries expect."""


class NoDynamicsError(KinreachError, AttributeError):
    """An environment without dynamics was asked for MuJoCo's model or state; so `hasattr(env, "model")` is False."""


class PathError(KinreachError):
    """No path was found, or a motion cannot be made; the message gives the place and the reason.

    Attributes:
        index: Number of the waypoint or pose before the failure; -1 if the failure has no place.
        fraction: Share of the way from there to the next one, from 0 to 1.
        q: The posture there [rad], or None.
        branches: Of a line of the tool: other branches without a failure.
        starts: Postures with which these begin [rad], shape (k, n).
    """

    def __init__(
        self,
        message: str,
        *,
        index: int = -1,
        fraction: float = 0.0,
        q: Any = None,
        branches: tuple[int, ...] = (),
        starts: Any = (),
    ) -> None:
        super().__init__(message)
        self.index, self.fraction, self.q = index, fraction, q
        self.branches, self.starts = branches, starts


class TrainingError(KinreachError, ArithmeticError):
    """Something became NaN or infinite while a policy was trained; the message names it."""


class InstallationError(KinreachError, ImportError):
    """A package that kinreach needs is missing or does not fit the others."""


class OutputError(KinreachError, OSError):
    """A result cannot be written where it was asked to go."""


class ClusterError(KinreachError, RuntimeError):
    """A cluster does not answer, or died; what was finished is on disk."""


class RobotError(KinreachError, RuntimeError):
    """A robot cannot be reached, refuses a program, or did not come to its end.

    Attributes:
        recording: What was recorded of a motion until then; None if nothing was sent.
    """

    recording: Any = None


class DrawingError(KinreachError, RuntimeError):
    """The graphics library was there and failed all the same."""


def raise_unknown(kind: str, name: str, available: Iterable[str]) -> NoReturn:
    """Raise `UnknownNameError` with the value, the available names, and those that have it as a part or are close."""
    available = sorted(set(available))
    near = [each for each in available if name in each.split("-")]
    if not near and len(name) <= LONGEST_NAME:
        near = get_close_matches(name.lower(), available, n=1)
    guess = f"; did you mean {' or '.join(near)}?" if near else ""
    short = name if len(name) <= LONGEST_NAME else f"{name[:LONGEST_NAME]}…"
    raise UnknownNameError(f"unknown {kind} {short!r}; available: {', '.join(available)}{guess}")
