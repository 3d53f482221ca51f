"""What an interrupted benchmark has measured so far: whole suites, one file."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from kinreach.bench.suite import Section
from kinreach.files import write_text


class Unfinished:
    """The finished suites of one run.

    Suites that were measured with other options, code, versions or on another machine are dropped.

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
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        if kept["identity"] != identity:
            return {}, {}
        suites: dict[str, list[dict[str, Any]]] = kept["suites"]
        for sections in suites.values():
            for section in sections:
                Section.from_json(section)
        return suites, {suite: float(kept["seconds"][suite]) for suite in suites}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):  # missing, cut short, or somebody else's
        return {}, {}
