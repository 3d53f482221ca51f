"""Every error kinreach raises on purpose descends from `KinreachError`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NoReturn


class KinreachError(Exception):
    """Root of all errors that kinreach raises on purpose."""


class InputError(KinreachError, ValueError):
    """A value, shape or range that cannot be used; the message says which and why."""


class UnknownNameError(InputError):
    """A name that is not registered; the message lists the available ones."""


class InstallationError(KinreachError, ImportError):
    """A package that kinreach needs is missing or does not fit the others."""


class OutputError(KinreachError, OSError):
    """A result cannot be written where it was asked to go."""


def raise_unknown(kind: str, name: str, available: Iterable[str]) -> NoReturn:
    """Raise `UnknownNameError` that names the value and what could have been said instead."""
    raise UnknownNameError(f"unknown {kind} {name!r}; available: {', '.join(sorted(available))}")
