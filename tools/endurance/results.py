"""What is checked by other tools of the project, with more cases than the tests have: fuzzing, and digests."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from tools import digest
from tools.endurance.outcome import Outcome, demand

ROOT = Path(__file__).resolve().parents[2]
TESTS = ROOT / "tests" / "robustness"
#: Modules with fuzz tests, those first that take little time.
FUZZED = (
    "geometry", "policies", "solvers", "simulation", "kinematics", "environments", "vision", "commands",
)  # fmt: skip
HOSTILE = ("files", "urdfs")
MODULES = (*(f"test_bad_input_{name}.py" for name in FUZZED), *(f"test_hostile_{name}.py" for name in HOSTILE))
#: Cases of one test, about: of the shortest module there are several times as many.
LEAST = 260
_SUMMARY = re.compile(r"^fuzzing, profile full, all: (\d+) cases in (\d+) tests, (\d+) refused", re.MULTILINE)


def fuzzing(count: int) -> Outcome:
    """Everything that the fuzz tests of `count` modules of `MODULES` can draw.

    Raises:
        BrokenPromiseError: A test has failed, or has not run.
    """
    modules = MODULES[:count]
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-c",
        "pyproject.toml",
        "-m",
        "not slow",
        "-p",
        "no:cacheprovider",
        "--color=no",
    ]
    done = subprocess.run(
        [*command, *(str(TESTS / name) for name in modules)],
        cwd=ROOT,
        env={**os.environ, "KINREACH_FUZZ": "full"},
        capture_output=True,
        text=True,
        check=False,
    )
    demand(done.returncode == 0, f"exit code {done.returncode}: {done.stdout[-2000:]}{done.stderr[-1000:]}")
    summary = _SUMMARY.search(done.stdout)
    demand(summary, f"no count of cases: {done.stdout[-1000:]}")
    cases, tests, refused = map(int, summary.groups())  # type: ignore[union-attr]
    demand(cases >= LEAST * len(modules), f"only {cases} cases of {len(modules)} modules")
    return Outcome(cases, "cases", f"{tests} tests, {refused:,} refused, the others right")


def digests(count: int) -> Outcome:
    """The first `count` kinds of result beside the digests of `tools/digest.txt`, rounded ones.

    Raises:
        BrokenPromiseError: A result is another.
    """
    known = digest.read(digest.REFERENCE)
    demand(known.keys() == digest.RESULTS.keys(), f"{digest.REFERENCE.name} is not of these results: {sorted(known)}")
    numbers, exact = 0, 0
    for name in list(digest.RESULTS)[:count]:
        found = digest.digests(digest.RESULTS[name])
        verdict = digest.compare(name, found, known)
        demand(verdict not in digest.FAILED, f"{name}: {verdict}")
        numbers += found[2]
        exact += verdict == digest.EXACT
    return Outcome(count, "kinds of result", f"{numbers:,} numbers, {exact} of {count} to the last bit")
