"""Whether the tests notice: meaningful mistakes, made one at a time in a copy of this checkout.

    python -m tools.mutants.by_hand [--only kinematics,sim-rest] [--full] [--out FILE] [--fresh]

`by_hand.toml` is the list: each mutant replaces a text that occurs once in a module by another, and names fast tests
that cover it. Those run first, up to the first failure; with `--full` what survives them meets the whole fast suite
(`-m "not slow"`). That the covering tests pass without a mutant is checked before. Mutants that were killed are kept
from one call to the next in the file of results, survivors run again.

The exit code is 0 if as many as `GOAL` says were killed, of those that were asked for, else 1.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from benchmarks.studies.tables import head, line
from kinreach._files import make_writable, write_text
from kinreach.cli import Parser, finish
from kinreach.errors import InputError

PROG = "python -m tools.mutants.by_hand"

ROOT = Path(__file__).resolve().parents[2]
TABLE = Path(__file__).with_name("by_hand.toml")
#: What was found, which docs/reference/promises.md reports.
RESULTS = ROOT / "docs/mutants.json"
#: Share of the mutants that the fast suite is to kill.
GOAL = 0.95
#: What notices a mutant of any kind, by reading the sources: it does not count.
READERS = ("tests/tools/test_mutants.py",)
#: Longest time for the covering tests of a mutant [s]; one that makes them take longer is noticed.
PATIENCE = 600
PYTEST = (sys.executable, "-m", "pytest", "-q", "-m", "not slow", "--tb=no", "-p", "no:cacheprovider")
_FAILED = re.compile(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", re.MULTILINE)


class Change(Protocol):
    """A mistake in one module."""

    @property
    def file(self) -> str:
        """Module, from the root of the checkout."""

    def applied(self, text: str) -> str:
        """The text of the module with the mistake in it."""


@dataclass(frozen=True)
class Mutant:
    """A mistake.

    Attributes:
        id: Its name; begins with the area.
        area: Part of the package that it is in, or "named" for those that others found to survive.
        file: Module, from the root of the checkout.
        old, new: What is replaced, and by what.
        breaks: What goes wrong, for people.
        tests: Files or node ids of pytest that cover it.
    """

    id: str
    area: str
    file: str
    old: str
    new: str
    breaks: str
    tests: tuple[str, ...]

    @property
    def digest(self) -> str:
        """What it does, in 12 hex digits."""
        return hashlib.sha256("\0".join((self.file, self.old, self.new)).encode()).hexdigest()[:12]

    def applied(self, text: str) -> str:
        """The text of the module with the mistake in it.

        Raises:
            InputError: `old` is not there just once, or nothing would change.
        """
        if text.count(self.old) != 1 or self.old == self.new:
            raise InputError(f"mutant {self.id}: its old text occurs {text.count(self.old)} times in {self.file}")
        return text.replace(self.old, self.new)


def read_mutants(path: Path = TABLE) -> list[Mutant]:
    """The list, in its order.

    Raises:
        InputError: Two mutants of one name.
    """
    areas = tomllib.loads(path.read_text(encoding="utf-8"))
    found = [
        Mutant(area=area, **{**entry, "id": f"{area}-{entry['id']}", "tests": tuple(entry["tests"])})
        for area, entries in areas.items()
        for entry in entries
    ]
    if len({mutant.id for mutant in found}) < len(found):
        raise InputError(f"{path}: two mutants of one name")
    return found


def main(argv: list[str] | None = None) -> int:
    """Run the mutants, print what became of each, and a summary by area."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", metavar="A,B", default="", help="mutants whose names begin so; all by default")
    parser.add_argument("--full", action="store_true", help="run the whole fast suite on what covering tests let live")
    parser.add_argument("--out", type=Path, default=RESULTS, help="results, kept between calls (docs/mutants.json)")
    parser.add_argument("--fresh", action="store_true", help="forget earlier results")
    arguments = parser.parse_args(argv)
    listed = read_mutants()
    chosen = [mutant for mutant in listed if mutant.id.startswith(tuple(arguments.only.split(",")))]
    if not chosen:
        raise InputError(f"there is no mutant {arguments.only}")
    make_writable(arguments.out.parent)
    results = {} if arguments.fresh else _read(arguments.out)
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        copy = copied(Path(folder))
        pending = [mutant for mutant in chosen if not _killed(results.get(mutant.id), mutant)]
        check_passing(copy, {test: None for mutant in pending for test in mutant.tests})
        for mutant in pending:
            which = {"id": mutant.id, "area": mutant.area, "mutant": mutant.digest}
            results[mutant.id] = which | verdict(copy, mutant, full=arguments.full)
            ordered = {each.id: results[each.id] for each in listed if each.id in results}
            write_text(arguments.out, json.dumps(ordered, indent=1) + "\n")
            print(_line(results[mutant.id]), flush=True)
    rows = [results[mutant.id] for mutant in chosen]
    print("\n".join(["", *summary(rows)]))
    return 0 if sum(row["killed_by"] is not None for row in rows) >= GOAL * len(rows) else 1


def copied(folder: Path) -> Path:
    """A copy of the checkout with what git knows of, or would know of, changes included."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    for name in filter(None, listed.stdout.split("\0")):
        if (ROOT / name).is_file():  # not what was deleted since
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)
    if (folder / "hatch_build.py").is_file():
        subprocess.run([sys.executable, "hatch_build.py"], cwd=folder, check=True, capture_output=True)
    return folder


def check_passing(copy: Path, tests: Iterable[str]) -> None:
    """Have the covering tests pass where nothing is mutated.

    Raises:
        InputError: One fails, or there is none.
    """
    chosen = list(tests)
    if chosen and (code := _run(copy, chosen, timeout=None, PYTHONDONTWRITEBYTECODE="")).returncode:
        raise InputError(f"without a mutant the covering tests fail: {code.stdout.splitlines()[-5:]}")


def verdict(copy: Path, mutant: Mutant, *, full: bool) -> dict[str, Any]:
    """Which test kills a mutant, what was run for it, and how long it took [s]."""
    start = time.perf_counter()
    with applied(copy, mutant):
        scope, killed_by = "covering", killer(copy, mutant.tests)
        if killed_by is None and full:
            scope, killed_by = "suite", killer(copy, [*(f"--ignore={name}" for name in READERS), "tests"])
    return {"killed_by": killed_by, "scope": scope, "seconds": round(time.perf_counter() - start, 1)}


@contextmanager
def applied(copy: Path, change: Change) -> Iterator[None]:
    """In the block, the copy has the mistake in it."""
    path = copy / change.file
    times = path.stat().st_atime_ns, path.stat().st_mtime_ns
    text = path.read_text(encoding="utf-8")
    path.write_text(change.applied(text), encoding="utf-8")
    try:
        _built(copy, change)
        yield
    finally:
        path.write_text(text, encoding="utf-8")
        os.utime(path, ns=times)  # compiled modules are told apart by it
        _built(copy, change)


def _built(copy: Path, change: Change) -> None:
    """Build the compiled core anew if the change is one of it."""
    if change.file.endswith(".c"):
        subprocess.run([sys.executable, "hatch_build.py"], cwd=copy, check=True, capture_output=True)


def killer(copy: Path, arguments: Sequence[str], *, patience: float = PATIENCE, **environment: str) -> str | None:
    """The first test that fails, None if none does.

    Args:
        copy: Where they run.
        arguments: Of pytest.
        patience: Longest time [s]; the whole suite has all the time that it needs.
        **environment: More of it.

    Raises:
        InputError: pytest could not run them.
    """
    try:
        done = _run(copy, ["-x", *arguments], timeout=None if "tests" in arguments else patience, **environment)
    except subprocess.TimeoutExpired:
        return f"more than {patience:.0f} s"
    if done.returncode == 0:
        return None
    failed = _FAILED.search(done.stdout)
    if failed is not None:
        return failed[1]
    if done.returncode < 0:
        return f"signal {-done.returncode}"
    if "while loading conftest" in done.stderr:
        return "tests/conftest.py"
    raise InputError(f"pytest {' '.join(arguments)} cannot run: {(done.stdout + done.stderr)[-500:]}")


def environment_in(copy: Path) -> dict[str, str]:
    """The environment of pytest in a copy."""
    settings = {"PYTHONPATH": str(copy), "OMP_NUM_THREADS": "1", "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    return {**os.environ, "PYTHONDONTWRITEBYTECODE": "1", **settings}


def _run(
    copy: Path, arguments: Sequence[str], *, timeout: float | None, **more: str
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*PYTEST, *arguments],
        cwd=copy,
        env=environment_in(copy) | more,
        capture_output=True,
        text=True,
        check=False,
        timeout=timeout,
    )


def _read(path: Path) -> dict[str, Any]:
    """Earlier results by name; none where they cannot be read."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _killed(result: Any, mutant: Mutant) -> bool:
    """Whether a result is of this very mutant, and says that it was killed."""
    return isinstance(result, dict) and result.get("mutant") == mutant.digest and result["killed_by"] is not None


def _line(row: dict[str, Any]) -> str:
    verdict = row["killed_by"] or f"SURVIVES the {'covering tests' if row['scope'] == 'covering' else 'fast suite'}"
    return f"{row['id']:<42} {verdict}"


def summary(rows: Sequence[dict[str, Any]]) -> list[str]:
    """A Markdown table of how many were killed, by area, and the survivors."""
    lines = [head("area", "mutants", "killed", "survivors")]
    for area in [*dict.fromkeys(row["area"] for row in rows), "all"]:
        own = [row for row in rows if area in (row["area"], "all")]
        alive = [f"`{row['id']}`" for row in own if row["killed_by"] is None]
        lines.append(line(area, len(own), len(own) - len(alive), ", ".join(alive) or "-"))
    return lines


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
