"""What an interrupted benchmark has measured so far: whole suites, one file."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.speed.checks import check_sections
from benchmarks.speed.registry import SUITES
from benchmarks.speed.suite import Section
from kinreach.checks import check_known, check_number
from kinreach.errors import InputError
from kinreach.files import write_text

#: A longer file is none of ours.
MOST_BYTES = 2**23


class Unfinished:
    """The finished suites of one run.

    Suites that were measured with other options, code, versions or on another machine are dropped, and so is a file
    that is damaged: what is kept is shown and drawn like what was measured now.

    Args:
        path: The file.
        identity: What must be equal for old suites to count, as JSON types.
        fresh: Drop old suites in any case.

    Attributes:
        suites: Sections by suite, as JSON types.
        seconds: How long each of them took.
    """

    def __init__(self, path: Path, identity: Mapping[str, Any], *, fresh: bool = False) -> None:
        self._path = path
        self._identity = json.loads(json.dumps(identity))
        self.suites: dict[str, list[dict[str, Any]]] = {}
        self.seconds: dict[str, float] = {}
        if not fresh:
            self.suites, self.seconds = _read(path, self._identity)

    def add(self, suite: str, sections: Sequence[Section], seconds: float) -> None:
        """Keep a finished suite, in memory and on disk.

        Raises:
            OutputError: The file cannot be written.
        """
        self.suites[suite] = [section.to_json() for section in sections]
        self.seconds[suite] = seconds
        kept = {"identity": self._identity, "suites": self.suites, "seconds": self.seconds}
        write_text(self._path, json.dumps(kept))

    def remove(self) -> None:
        """Delete the file: the benchmark is complete and its results are written."""
        self._path.unlink(missing_ok=True)


def _read(path: Path, identity: Mapping[str, Any]) -> tuple[dict[str, list[dict[str, Any]]], dict[str, float]]:
    """What the file holds of a run like this one; nothing if any of it is not as `Unfinished.add` writes it."""
    try:
        if not path.is_file() or path.stat().st_size > MOST_BYTES:
            return {}, {}
        kept = json.loads(path.read_text(encoding="utf-8"))
        if kept["identity"] != identity:
            return {}, {}
        suites: dict[str, list[dict[str, Any]]] = kept["suites"]
        for name, sections in suites.items():
            check_known("suite", name, SUITES)
            if not isinstance(sections, list):
                raise TypeError("the sections of a suite are a list")
        check_sections([section for sections in suites.values() for section in sections])
        seconds = {name: check_number("seconds", kept["seconds"][name], least=0.0) for name in suites}
        return suites, seconds
    # missing, cut short, damaged, or somebody else's
    except (OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError, InputError):
        return {}, {}
