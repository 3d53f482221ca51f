"""A whole benchmark: suite after suite, kept on disk as they finish."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.speed.report import FORMAT, PACKAGES, write_results
from benchmarks.speed.sections import Options, Progress, Section
from benchmarks.speed.suites import load_suite
from kinreach._files import make_writable, write_text
from kinreach._provenance import machine, versions

#: Sections of a suite, and how long it took [s].
Finished = tuple[list[Section], float]
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
    say: Callable[[str], None] = lambda line: None,
) -> dict[str, Any]:
    """Run suites and write `results.json`, `results.md` and the figures.

    After an interruption the same call goes on behind the last finished suite; what was measured with other options,
    code, versions or on another machine is measured again.

    Args:
        suites: Names.
        options: Rounds, sizes, seed.
        out: Where results go.
        command: The command that does this again.
        fresh: Do not go on from an interrupted run.
        progress: Called while a suite runs.
        on_suite: Called after each suite.
        say: Called with what there is to say besides.

    Returns:
        What `results.json` holds.

    Raises:
        KinreachError: A suite cannot run, or results cannot be written.
    """
    make_writable(out)
    found, here = versions(PACKAGES), machine()
    identity = json.loads(
        json.dumps({"format": FORMAT, "options": asdict(options), "versions": found, "machine": here})
    )
    unfinished = out / "unfinished.json"
    finished = {} if fresh else _read(unfinished, identity, say)
    for suite in suites:
        kept = suite in finished
        if not kept:
            start = time.perf_counter()
            sections = load_suite(suite)(options, progress)
            finished[suite] = sections, time.perf_counter() - start
            _write(unfinished, identity, finished)
        on_suite(suite, finished[suite][0], kept)
    results = {
        "format": FORMAT,
        "command": command,
        "options": asdict(options),
        "seconds": round(sum(finished[suite][1] for suite in suites), 1),
        "machine": here,
        "versions": found,
        "suites": {suite: [section.to_json() for section in finished[suite][0]] for suite in suites},
    }
    write_results(results, out)
    unfinished.unlink(missing_ok=True)
    return results


def _write(path: Path, identity: Mapping[str, Any], finished: Mapping[str, Finished]) -> None:
    suites = {name: [section.to_json() for section in sections] for name, (sections, _) in finished.items()}
    seconds = {name: seconds for name, (_, seconds) in finished.items()}
    write_text(path, json.dumps({"identity": identity, "suites": suites, "seconds": seconds}))


def _read(path: Path, identity: Mapping[str, Any], say: Callable[[str], None]) -> dict[str, Finished]:
    """What `_write` kept of a run like this one; nothing, with a line that says so, of what it cannot have written."""
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        if kept["identity"] != identity:
            return {}
        return {
            name: ([Section.from_json(section) for section in sections], float(kept["seconds"][name]))
            for name, sections in kept["suites"].items()
        }
    except FileNotFoundError:
        return {}
    except Exception as error:  # whatever reading something else raises
        say(f"{path} cannot be read ({type(error).__name__}): starting over")
        return {}
