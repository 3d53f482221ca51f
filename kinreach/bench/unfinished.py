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
    """

    def __init__(self, path: Path, identity: Mapping[str, Any], *, fresh: bool = False) -> None:
        self._path = path
        self._identity = json.loads(json.dumps(identity))
        self.suites: dict[str, list[dict[str, Any]]] = {} if fresh else _read(path, self._identity)

    def add(self, suite: str, sections: Sequence[Section]) -> None:
        """Keep a finished suite, in memory and on disk.

        Raises:
            OutputError: The file cannot be written.
        """
        self.suites[suite] = [section.to_json() for section in sections]
        write_text(self._path, json.dumps({"identity": self._identity, "suites": self.suites}))

    def remove(self) -> None:
        """Delete the file: the benchmark is complete and its results are written."""
        self._path.unlink(missing_ok=True)


def _read(path: Path, identity: Mapping[str, Any]) -> dict[str, list[dict[str, Any]]]:
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        if kept["identity"] != identity:
            return {}
        suites: dict[str, list[dict[str, Any]]] = kept["suites"]
        for sections in suites.values():
            for section in sections:
                Section.from_json(section)
        return suites
    except (OSError, ValueError, KeyError, TypeError, AttributeError):  # missing, cut short, or somebody else's
        return {}
