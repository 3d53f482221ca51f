"""Tests of benchmarks and studies are slow: `make test` is about the package."""

from __future__ import annotations

from pathlib import Path

import pytest

#: What guards the package and its pages on every run.
QUICK = {"test_trainings_interval.py"}


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Where slow tests are left out they are not even imported: they load a dozen other solvers."""
    left_out = collection_path.name.startswith("test_") and collection_path.name not in QUICK
    return True if left_out and config.option.markexpr == "not slow" else None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what is in this folder, except `QUICK`."""
    for item in items:
        if Path(__file__).parent in item.path.parents and item.path.name not in QUICK:
            item.add_marker(pytest.mark.slow)
