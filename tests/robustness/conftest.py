"""Counts the fuzzed cases of a session; `KINREACH_FUZZ=full` runs thousands instead of hundreds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from tests.robustness.fuzzing import PROFILE, Tally, fuzz

_TALLIES: dict[str, Tally] = {}


@pytest.fixture
def fuzzed(request: pytest.FixtureRequest) -> Iterator[Callable[..., Tally]]:
    """`fuzz`, with what it counted kept for the summary."""
    total = [0, 0]

    def run(*arguments: Any, **options: Any) -> Tally:
        tally = fuzz(*arguments, **options)
        total[0] += tally.cases
        total[1] += tally.refused
        return tally

    yield run
    _TALLIES[request.node.nodeid] = Tally(*total)


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """How many cases there were; where tests run in several processes, each has its own count and this one none."""
    modules: dict[str, list[Tally]] = {}
    for test, tally in _TALLIES.items():
        modules.setdefault(test.partition("::")[0], []).append(tally)
    for name, tallies in [*sorted(modules.items()), ("all", list(_TALLIES.values()))] if modules else ():
        cases, refused = (sum(tally[i] for tally in tallies) for i in (0, 1))
        said = f"{cases} cases in {len(tallies)} tests, {refused} refused, {cases - refused} good"
        terminalreporter.write_line(f"fuzzing, profile {PROFILE}, {name}: {said}")
