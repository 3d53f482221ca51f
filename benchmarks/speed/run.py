"""A whole benchmark: suite after suite, kept on disk as they finish."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.speed.registry import load_suite
from benchmarks.speed.report import FORMAT, PACKAGES, write_results
from benchmarks.speed.suite import Options, Progress, Section
from benchmarks.speed.unfinished import Unfinished
from kinreach.files import make_writable
from kinreach.provenance import machine, versions

#: Called with the name of a suite, its sections, and whether they were kept from an interrupted run.
OnSuite = Callable[[str, Sequence[Section], bool], None]


def run_suites(
    suites: Sequence[str],
    options: Options,
    out: Path,
    *,
    command: str,
    fresh: bool = False,
    progress: Progress = lambda what, done, total: None,
    on_suite: OnSuite = lambda suite, sections, kept: None,
) -> dict[str, Any]:
    """Run suites and write `results.json`, `results.md` and `results.png`.

    After an interruption the same call goes on behind the last finished suite.

    Args:
        suites: Names.
        options: Rounds, sizes, seed.
        out: Where results go.
        command: The command that does this again.
        fresh: Do not go on from an interrupted run.
        progress: Called while a suite runs.
        on_suite: Called after each suite.

    Returns:
        What `results.json` holds.

    Raises:
        KinreachError: A suite cannot run, or results cannot be written.
    """
    make_writable(out)
    found, here = versions(PACKAGES), machine()
    identity = {"format": FORMAT, "options": asdict(options), "versions": found, "machine": here}
    unfinished = Unfinished(out / "unfinished.json", identity, fresh=fresh)
    for suite in suites:
        kept = suite in unfinished.suites
        if not kept:
            start = time.perf_counter()
            sections = load_suite(suite).run(options, progress)
            unfinished.add(suite, sections, time.perf_counter() - start)
        on_suite(suite, [Section.from_json(section) for section in unfinished.suites[suite]], kept)
    results = {
        "format": FORMAT,
        "command": command,
        "options": asdict(options),
        "seconds": round(sum(unfinished.seconds[suite] for suite in suites), 1),
        "machine": here,
        "versions": found,
        "suites": {suite: unfinished.suites[suite] for suite in suites},
    }
    write_results(results, out)
    unfinished.remove()
    return results
