"""What an unfinished comparison has measured so far, kept on disk so that it can go on after an interruption."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Generic, TypeVar

from kinreach.compare.trials import Trial
from kinreach.errors import OutputError
from kinreach.files import write_text

T = TypeVar("T", bound=Trial)


class Checkpoint(Generic[T]):
    """The finished trials of one comparison, one line of JSON each, appended as they come.

    The first line is the identity of the comparison: settings, versions, code and machine. Trials of another
    identity are not mixed in: they are dropped and the comparison starts over.

    Args:
        path: The file.
        identity: What must be equal for old trials to count, as JSON types.
        kind: Class of the trials.
        fresh: Drop old trials in any case.

    Attributes:
        trials: Everything finished so far.

    Raises:
        OutputError: The file cannot be written.
    """

    def __init__(self, path: Path, identity: Mapping[str, Any], kind: type[T], *, fresh: bool = False) -> None:
        self.path = path
        self.trials: list[T] = [] if fresh else _read(path, identity, kind)
        # Written anew, not appended to: a line that a crash cut short must go before the next one is added.
        lines = [json.dumps(identity), *(trial.to_json() for trial in self.trials)]
        write_text(path, "\n".join(lines) + "\n")

    def add(self, trial: T) -> None:
        """Keep a finished trial, in memory and on disk."""
        line = trial.to_json() + "\n"
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(line)
        except OSError as error:
            raise OutputError(f"cannot write {self.path}: {error.strerror or error}") from error
        self.trials.append(trial)

    def remove(self) -> None:
        """Delete the file: the comparison is complete and its results are written."""
        self.path.unlink(missing_ok=True)


def _read(path: Path, identity: Mapping[str, Any], kind: type[T]) -> list[T]:
    """Trials of this identity, up to the first line that is not whole."""
    try:
        first, *lines = path.read_text(encoding="utf-8").splitlines()
        if json.loads(first) != json.loads(json.dumps(identity)):
            return []
    except (OSError, ValueError):
        return []
    trials: list[T] = []
    for line in lines:
        try:
            trials.append(kind.from_dict(json.loads(line)))
        except (ValueError, KeyError, TypeError):
            break
    return trials
