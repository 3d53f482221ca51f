"""Tests of benchmarks and studies are slow: `make test` is about the package."""

from __future__ import annotations

from pathlib import Path

import pytest

#: What guards the package and its pages on every run.
QUICK = {"test_trainings_interval.py"}


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what is in this folder, except `QUICK`."""
    for item in items:
        if Path(__file__).parent in item.path.parents and item.path.name not in QUICK:
            item.add_marker(pytest.mark.slow)
