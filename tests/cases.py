"""Cases of a parametrised test that `make test` leaves out, and stand-ins for a class wherever it is used."""

from typing import Any

import pytest


def slow(*cases: Any) -> list[Any]:
    """Cases that `make test-all` and CI run; a tuple is one case of several arguments."""
    return [pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.slow) for case in cases]


def stand_in(monkeypatch: pytest.MonkeyPatch, kind: type, other: type) -> None:
    """Give a class the attributes and methods that another one defines, for one test."""
    for name, value in vars(other).items():
        if name == "__init__" or not name.startswith("__"):
            monkeypatch.setattr(kind, name, value, raising=False)
