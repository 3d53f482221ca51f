"""What an unfinished comparison has measured so far, kept on disk so that it can go on after an interruption."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Generic, TypeVar

from kinreach.compare.trials import Trial
from kinreach.errors import OutputError
from kinreach.files import write_text

T = TypeVar("T", bound=Trial)

#: A line of the file that is longer is none of ours [characters].
LONGEST_LINE = 2**20


class Checkpoint(Generic[T]):
    """The finished trials of one comparison, one line of JSON each, appended as they come.

    The first line is the identity of the comparison: settings, versions, code and machine. Trials of another
    identity are not mixed in: they are dropped and the comparison starts over.

    Args:
        path: The file.
        identity: What must be equal for old trials to count, as JSON types.
        kind: Class of the trials.
        belongs: Whether a trial is one of this comparison.
        fresh: Drop old trials in any case.

    Attributes:
        trials: Everything finished so far.

    Raises:
        OutputError: The file cannot be written.
    """

    def __init__(
        self,
        path: Path,
        identity: Mapping[str, Any],
        kind: type[T],
        *,
        belongs: Callable[[T], bool] = lambda trial: True,
        fresh: bool = False,
    ) -> None:
        self.path = path
        self.trials: list[T] = [] if fresh else _read(path, identity, kind, belongs)
        # Written anew, not appended to: a line that a crash cut short must go before the next one is added.
        lines = [json.dumps(identity), *(trial.to_json() for trial in self.trials)]
        write_text(path, "\n".join(lines) + "\n")

    def add(self, trial: T) -> None:
        """Keep a finished trial, in memory and on disk.

        Raises:
            OutputError: The file system refused; what was there before is there still.
        """
        line, end = trial.to_json() + "\n", None
        try:
            with self.path.open("a", encoding="utf-8") as file:
                end = file.tell()
                file.write(line)
        except OSError as error:
            if end is not None:
                with suppress(OSError):  # what comes next must not be added to half a line
                    os.truncate(self.path, end)
            raise OutputError(f"cannot write {self.path}: {error.strerror or error}") from error
        self.trials.append(trial)

    def remove(self) -> None:
        """Delete the file: the comparison is complete and its results are written."""
        self.path.unlink(missing_ok=True)


def _read(path: Path, identity: Mapping[str, Any], kind: type[T], belongs: Callable[[T], bool]) -> list[T]:
    """Trials of this identity, each once, up to the first line that is not whole or not one of them."""
    trials: dict[tuple[int, str], T] = {}
    if not path.is_file():
        return []
    try:
        with path.open(encoding="utf-8") as file:
            if json.loads(file.readline(LONGEST_LINE)) != json.loads(json.dumps(identity)):
                return []
            while line := file.readline(LONGEST_LINE):
                trial = kind.from_dict(json.loads(line))
                if (trial.goal, trial.method) in trials or not belongs(trial):
                    break
                trials[trial.goal, trial.method] = trial
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        pass  # what was read until then counts
    return list(trials.values())
