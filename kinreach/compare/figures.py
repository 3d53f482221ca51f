"""The comparison as pictures: which there are is a matter of the task."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from kinreach.compare.contests import CONTESTS
from kinreach.compare.trials import Trial
from kinreach.files import replacing

#: Of the files.
DPI = 160


def write_all(out: Path, trials: Sequence[Trial], results: Mapping[str, Any]) -> dict[str, Path]:
    """Write the figures of the task into a directory, as PNG.

    Returns:
        The files by the titles of the figures.

    Raises:
        OutputError: The file system refused.
    """
    written = {}
    for name, draw in CONTESTS[results["settings"]["task"]].figures.items():
        figure = draw(trials, results)
        path = written[figure.get_suptitle()] = out / f"{name}.png"
        with replacing(path) as temporary:
            figure.savefig(temporary, dpi=DPI, facecolor="white")
    return written
