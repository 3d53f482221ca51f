"""A plugin of pytest: which tests enter which functions of kinreach, and the tests of a list, in its order.

`KINREACH_MAP=FILE pytest -p tools.mutants.covering tests` writes the map; `KINREACH_TESTS=FILE` runs the list.
"""

from __future__ import annotations

import json
import os
import sys
import threading
from collections import defaultdict
from collections.abc import Iterator
from inspect import CO_OPTIMIZED
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest

#: Taken out of the environment: what a test starts itself writes no map and runs no list.
MAP, TESTS = os.environ.pop("KINREACH_MAP", None), os.environ.pop("KINREACH_TESTS", None)
ROOT = f"{Path(__file__).resolve().parents[2]}/"

#: Functions by what was going on when they were entered: a test, a fixture that several tests share, or `""`.
_entered: dict[str, set[CodeType]] = defaultdict(set)
_tests: dict[str, dict[str, Any]] = {}
_now = ""


def _trace(frame: FrameType, event: str, argument: object) -> None:
    code = frame.f_code
    if code.co_flags & CO_OPTIMIZED and code.co_filename.startswith(f"{ROOT}kinreach/"):  # no module, no class
        _entered[_now].add(code)


def _key(fixture: Any) -> str:
    return f"fixture {fixture.baseid}::{fixture.argname}"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Keep the tests of the list, in its order."""
    if TESTS:
        order = {test: place for place, test in enumerate(json.loads(Path(TESTS).read_text(encoding="utf-8")))}
        items[:] = sorted((item for item in items if item.nodeid in order), key=lambda item: order[item.nodeid])


if MAP:
    sys.settrace(_trace)
    threading.settrace(_trace)

    @pytest.hookimpl(hookwrapper=True, tryfirst=True)
    def pytest_runtest_protocol(item: Any) -> Iterator[None]:
        """What is entered from here on is entered by this test."""
        global _now
        fixtures = [_key(one) for each in item._fixtureinfo.name2fixturedefs.values() for one in each]
        _tests[item.nodeid] = {"fixtures": fixtures, "seconds": 0.0}
        _now = item.nodeid
        sys.settrace(_trace)  # a test may have taken it away
        yield
        _now = ""

    @pytest.hookimpl(hookwrapper=True)
    def pytest_fixture_setup(fixturedef: Any) -> Iterator[None]:
        """What a shared fixture enters is entered by all tests that ask for it."""
        global _now
        before, _now = _now, _now if fixturedef.scope == "function" else _key(fixturedef)
        yield
        _now = before

    def pytest_runtest_logreport(report: pytest.TestReport) -> None:
        """How long tests take."""
        _tests[report.nodeid]["seconds"] += report.duration

    def pytest_unconfigure() -> None:
        """Write the map: tests with their times [s], and for every line the tests that enter its function."""
        sys.settrace(None)
        threading.settrace(None)  # type: ignore[arg-type]
        lines: dict[str, dict[int, set[int]]] = defaultdict(lambda: defaultdict(set))
        for number, (test, about) in enumerate(_tests.items()):
            for code in set().union(*(_entered[name] for name in (test, *about["fixtures"]))):
                for *_, line in code.co_lines():
                    if line is not None:
                        lines[code.co_filename.removeprefix(ROOT)][line].add(number)
        write_map(Path(MAP), {test: about["seconds"] for test, about in _tests.items()}, lines)


def write_map(path: Path, seconds: dict[str, float], lines: dict[str, dict[int, set[int]]]) -> None:
    """Write tests with their times [s], and by file and line the numbers of the tests."""
    listed = {file: {line: sorted(tests) for line, tests in found.items()} for file, found in lines.items()}
    path.write_text(json.dumps({"seconds": seconds, "lines": listed}), encoding="utf-8")
