"""Cases of a parametrised test that `make test` leaves out."""

from typing import Any

import pytest


def slow(*cases: Any) -> list[Any]:
    """Cases that `make test-all` and CI run; a tuple is one case of several arguments."""
    return [pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.slow) for case in cases]
