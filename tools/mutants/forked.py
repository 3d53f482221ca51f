"""Tests of a mutant in a copy of a process that has collected them all: seconds, where a new process takes a minute.

`pytest -p tools.mutants.forked` collects, and then waits for jobs: a change of a module, and tests in their order. For
each it forks; in the child the functions of kinreach that differ get their new code, what was cached is forgotten, and
the tests run up to the first failure. A change outside of functions is answered with nothing: it needs a new process.
"""

from __future__ import annotations

import functools
import gc
import json
import os
import select
import signal
from collections import defaultdict
from inspect import CO_OPTIMIZED
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

import pytest

#: File descriptors of the jobs and of the answers; taken out of the environment, as what a test starts forks nothing.
PIPES = os.environ.pop("KINREACH_PIPES", "")
ROOT = f"{Path(__file__).resolve().parents[2]}/"

_functions: dict[tuple[str, str, int], list[FunctionType]] = defaultdict(list)
_caches: list[Any] = []


if PIPES:

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_finish() -> None:
        """Find the functions and what is cached, before conftest.py hides them from the collector."""
        for found in gc.get_objects():
            if type(found) is FunctionType and found.__code__.co_filename.startswith(f"{ROOT}kinreach/"):
                _functions[_place(found.__code__)].append(found)
            elif type(found) is functools._lru_cache_wrapper and found.__module__.startswith("kinreach"):
                _caches.append(found)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(session: pytest.Session) -> bool:
        """Answer jobs until there are no more."""
        tests = {item.nodeid: item for item in session.items}
        reading, writing = map(int, PIPES.split())
        with os.fdopen(reading) as jobs, os.fdopen(writing, "w", buffering=1) as answers:
            for line in jobs:
                job = json.loads(line)
                items = [tests[name] for name in job["tests"] if name in tests]
                answers.write(json.dumps(_answered(items, job)) + "\n")
        return True


def _place(code: CodeType) -> tuple[str, str, int]:
    return code.co_filename, code.co_qualname, code.co_firstlineno


def _answered(items: list[pytest.Item], job: dict[str, Any]) -> dict[str, Any]:
    """Answer a job in a process of its own, which ends with all that it started."""
    end, start = os.pipe()
    child = os.fork()
    if child == 0:
        os.setsid()
        try:
            inside = _changed(job["file"], job["old"], job["new"])
            os.write(start, json.dumps({"killed_by": _first_failing(items)} if inside else {}).encode())
        finally:
            os._exit(0)
    os.close(start)
    said = os.read(end, 4096) if select.select([end], [], [], job["patience"])[0] else None
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    os.close(end)
    missing = f"more than {job['patience']:.0f} s" if said is None else "the process ended"
    found: dict[str, Any] = json.loads(said) if said else {"killed_by": missing}
    return found


def _first_failing(items: list[pytest.Item]) -> str | None:
    failed: list[str] = []

    class Failures:
        def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
            if report.failed:
                failed.append(report.nodeid)

    for item, following in zip(items, [*items[1:], None], strict=True):
        item.config.pluginmanager.register(Failures(), "failures")
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        item.config.pluginmanager.unregister(name="failures")
        if failed:
            return failed[0]
    return None


def _changed(file: str, old: str, new: str) -> bool:
    """Give functions their new code, and forget what was cached; return whether that is all of a change."""
    before, after = (compile(text, f"{ROOT}{file}", "exec", dont_inherit=True) for text in (old, new))
    pairs: list[tuple[CodeType, CodeType]] = []
    if not _paired(before, after, pairs):
        return False
    for code, other in pairs:
        for function in _functions[_place(code)]:
            function.__code__ = other
    for cache in _caches:
        cache.cache_clear()
    return any(_functions[_place(code)] for code, _ in pairs)


def _paired(before: CodeType, after: CodeType, pairs: list[tuple[CodeType, CodeType]]) -> bool:
    """Add functions that differ, with what they become; return whether nothing outside of functions differs."""
    inside, now = ([each for each in code.co_consts if isinstance(each, CodeType)] for code in (before, after))
    if _own(before) != _own(after) or len(inside) != len(now):
        if not before.co_flags & CO_OPTIMIZED or before.co_freevars != after.co_freevars:
            return False  # the body of a module or class, which ran when it was imported, or a closure's variables
        pairs.append((before, after))
        return True
    different = len(pairs)
    if not all(_paired(one, other, pairs) for one, other in zip(inside, now, strict=True)):
        return False
    if before.co_flags & CO_OPTIMIZED and len(pairs) > different:
        pairs.append((before, after))  # it makes the functions in it anew when it is called
    return True


def _own(code: CodeType) -> tuple[Any, ...]:
    """What a function does without the functions in it."""
    constants = [repr(each) for each in code.co_consts if not isinstance(each, CodeType)]
    return code.co_code, constants, code.co_names, code.co_varnames
