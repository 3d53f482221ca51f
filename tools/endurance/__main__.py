"""`python -m tools.endurance`: everything that does not fit into a test suite, with a table of what was checked.

Each check has a process of its own. A full run takes about an hour on one core, `--quick` some minutes.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import time
from concurrent.futures import ProcessPoolExecutor

from rich.console import Console
from rich.table import Table
from rich.text import Text

from tools.endurance.checks import CHECKS, run
from tools.endurance.outcome import BrokenPromiseError, Outcome

WIDTH = 150
#: Instead of a number of cases.
BROKEN, NOT_CHECKED = FAILED = "BROKEN", "NOT CHECKED"


def main() -> int:
    """Run checks one after the other; the exit code is 1 if a promise was broken, or could not be checked here."""
    parser = argparse.ArgumentParser(prog="python -m tools.endurance", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few cases of everything")
    parser.add_argument("--only", nargs="+", choices=CHECKS, metavar="CHECK", help=f"of: {', '.join(CHECKS)}")
    arguments = parser.parse_args()
    console = Console(width=WIDTH, highlight=False)
    table = Table("check", "promise", "cases", "seconds", "found")
    held = True
    for name in arguments.only or CHECKS:
        began = time.perf_counter()
        found = _in_a_process(name, quick=arguments.quick)
        seconds = f"{time.perf_counter() - began:.0f}"
        cases, detail = _said(found)
        held &= cases not in FAILED
        row = (name, CHECKS[name].promise, cases, seconds, detail)
        console.print(": ".join((row[0], row[2], row[4])), style="dim", soft_wrap=True, markup=False)
        table.add_row(*map(Text, row))
    console.print(table)
    return int(not held)


def _said(found: Outcome | str) -> tuple[str, str]:
    """How many cases of what there were, or one of `FAILED`; and what was found."""
    if isinstance(found, str):
        return BROKEN, found
    return (f"{found.count:,} {found.of}" if found.count else NOT_CHECKED), found.detail


def _in_a_process(name: str, *, quick: bool) -> Outcome | str:
    """What a check found, or why it failed."""
    check = CHECKS[name]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        try:
            return pool.submit(run, name, check.quick if quick else check.full).result()
        except BrokenPromiseError as error:
            return str(error)
        except Exception as error:
            return f"{type(error).__name__}: {error}"


if __name__ == "__main__":
    sys.exit(main())
